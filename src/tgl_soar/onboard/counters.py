"""What the module counts of its own work; its parts have counters of their own."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Counters:
    """One object for all parts of a module."""

    ticks: int = 0
    surface_frames: int = 0
    release_frames: int = 0
    unsent: int = 0  # frames that the link did not take
    left_out: int = 0  # of these, commands that would have come too late
    unsendable: int = 0  # messages that could not be packed: a mistake of ours
    laws_changed: int = 0
    telemetry_shed: int = 0  # messages that were due while ticks came late
    mode_changes: dict[int, int] = field(default_factory=dict)  # by the new mode

    def count_mode(self, mode: int) -> None:
        """The module has come into a mode."""
        self.mode_changes[mode] = self.mode_changes.get(mode, 0) + 1
