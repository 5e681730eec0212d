"""Real autopilot firmwares in the loop: our air and aircraft as their physics."""
