"""What the module reports to whoever keeps a log.

The module calls these as things happen, always after the surfaces have been sent.  `Recorder`
itself keeps nothing; `writer.FlightRecorder` writes a log.
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.types import Inputs


class LinkReport(NamedTuple):
    """How the link and the loop's timing did; fields as of the topic `link`."""

    loss: float
    round_trip_s: float
    frames: int
    bad_checksums: int
    unsent: int
    late: int
    skipped: int
    over_run: int
    worst_late_s: float


class Recorder:
    """Keeps nothing."""

    def parameters(self, values: ParameterSet) -> None:
        """The values with which the next tick flies."""

    def tick(self, inputs: Inputs, output: Output, state: AutopilotState) -> None:
        """A tick is done: what it had, what it decided, what it leaves."""

    def leave_out(self, time_s: float, state: AutopilotState) -> None:
        """A tick is done that there is no time to write down."""

    def reset(self, state: AutopilotState) -> None:
        """The next tick begins from this state, whatever the last one left."""

    def outbound(self, frame: bytes) -> None:
        """A frame of ours went out on any link."""

    def inbound(self, link: int, frame: bytes, wanted: bool) -> None:
        """A frame came on a link; 0: the autopilot's.

        `wanted`: neither refused nor of a stranger.
        """

    def text(self, severity: int, text: str) -> None:
        """Words for the operator; MAVLink's severity."""

    def link(self, report: LinkReport) -> None:
        """How the link did of late."""

    def poll(self) -> list[str]:
        """Time passes; messages for the operator."""
        return []

    def stop(self) -> list[str]:
        """The flight is over; messages for the console."""
        return []


NO_RECORDER = Recorder()
