"""Real autopilot firmwares in the loop: our air and aircraft as their physics."""


class FirmwareError(RuntimeError):
    """A firmware cannot be flown; the message says why and what to do."""
