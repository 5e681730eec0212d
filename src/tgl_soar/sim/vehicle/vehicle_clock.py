"""Time as the autopilot counts it: whole steps, and its stamps since boot."""

from __future__ import annotations


class VehicleClock:
    """Time is the number of steps taken, of 1/step_hz each.

    uptime_s    how long the autopilot has been running when the simulation begins
    """

    def __init__(self, step_hz: int, uptime_s: float = 0.0) -> None:
        self.step_hz = step_hz
        self.steps = 0
        self.uptime_s = uptime_s

    @property
    def time_s(self) -> float:
        """Time since the simulation began."""
        return self.steps / self.step_hz

    def restart(self) -> None:
        """The autopilot boots now."""
        self.uptime_s = -self.time_s

    def boot_ms(self, time_s: float) -> int:
        """A simulated time as the messages' `time_boot_ms`, which wraps."""
        return round((self.uptime_s + time_s) * 1e3) & 0xFFFFFFFF

    def boot_us(self, time_s: float) -> int:
        """A simulated time in microseconds since boot."""
        return round((self.uptime_s + time_s) * 1e6)

    def boot_ns(self, time_s: float) -> int:
        """A simulated time in nanoseconds since boot."""
        return round((self.uptime_s + time_s) * 1e9)
