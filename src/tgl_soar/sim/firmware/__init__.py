"""Real autopilot firmwares in the loop: our air and aircraft as their physics.

ardupilot, px4       each one's interface to a simulator;  starts: which one is started, and how
simulation           a firmware in the place of the simulated Pixhawk;  program: it runs
sensors              what its sensors read;  failing_sensors: or not;  relay: its MAVLink links
mission              a mission that is uploaded to it;  parameters: those that change in flight
"""


class FirmwareError(RuntimeError):
    """A firmware cannot be flown; the message says why and what to do."""
