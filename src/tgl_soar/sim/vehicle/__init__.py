"""The simulated Pixhawk: an ArduPlane as a companion computer and ground stations meet it."""
