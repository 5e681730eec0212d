"""The surfaces: commanded by a tick, handed over when it is over, and the mode that obeys.

Where a firmware obeys only in a mode of its own, that is entered before the first command and left
after the last one (`link.mode_change`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.link.autopilots.base import Flavour, is_finite
from tgl_soar.link.messages import SEVERITY_WARNING
from tgl_soar.link.mode_change import ModeChange
from tgl_soar.link.session import Session
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.types import OURS, THEIRS, AutopilotStatus, Setpoints, SurfaceCommand, isfinite

LONGEST_FRAME: Final = 280  # bytes of a MAVLink 2 frame with a full payload and a signature
RELEASE_FRAMES: Final = 5  # a lost frame must not leave the aircraft to the overrides' time-out
RELEASE_INTERVAL_S: Final = 0.1


class SurfaceControl:
    """Whether surfaces are commanded, and what goes out for it."""

    def __init__(
        self,
        flavour: Flavour,
        outbox: Outbox,
        counters: Counters,
        before_first: Callable[[], None] = lambda: None,
    ) -> None:
        """`before_first`: is called before the first frame that takes the surfaces is sent."""
        self.mode_change = ModeChange(flavour)
        self.is_active = False  # they are commanded
        self.enters_mode = flavour.route.mode_to_enter is not None
        self._flavour = flavour
        self._loops = flavour.route.loops
        self._outbox = outbox
        self._counters = counters
        self._before_first = before_first
        self._releases = 0  # still to be sent
        self._release_due_s = 0.0

    @property
    def in_control(self) -> bool:
        """Whether surfaces are commanded or being handed over, or their mode is being changed."""
        return self.is_active or self._releases > 0 or self.mode_change.is_changing

    def tick(self, output: Output, time_s: float, status: AutopilotStatus) -> None:
        """Command them as a tick has decided, or hand them over."""
        if output.active and is_finite_command(output, self._loops):
            if not self.is_active:
                self._before_first()
            fraction = output.throttle.fraction
            self._outbox.command(self._flavour.commands(output.command, output.setpoints, fraction))
            self._counters.surface_frames += 1
            self._releases = 0
        elif self.is_active and not output.active:
            self._releases = RELEASE_FRAMES
            self._release_due_s = time_s
            self._clear_for_release()
            if status.accepts_surfaces:
                self.mode_change.leave(time_s, status.time_s, failsafe=status.failsafe)
            elif status.failsafe:
                self.mode_change.give_way()
            else:  # the pilot has left it
                self.mode_change.stop()
        if self._releases > 0 and time_s >= self._release_due_s:
            self._release_due_s = time_s + RELEASE_INTERVAL_S
            self._releases -= 1
            self._release()
        self.is_active = output.active

    def change_mode(
        self, time_s: float, session: Session, *, engage: bool, ready: bool, pitch_rad: float
    ) -> str:
        """Engaged: the autopilot first has to come into the mode that obeys; why it did not.

        Until then it is sent what keeps the aircraft as it is (`pitch_rad`, wings level): some
        firmwares enter only where setpoints stream already.
        """
        change, status = self.mode_change, session.status
        obeys, received_s = status.accepts_surfaces, status.time_s
        unseen = change.is_unseen  # `comes_back` forgets it
        if change.comes_back(received_s, obeys, session.custom_mode, status.failsafe):
            mode = self._flavour.route.mode
            text = f"back in {mode} after the autopilot's failsafe: asking it to leave"
            if unseen:
                text = f"still in {mode}: asking the autopilot to leave"
            self._outbox.tell(SEVERITY_WARNING, text)
            change.leave(time_s, float("-inf"))  # right after this heartbeat
        if not engage and change.is_entering:
            change.leave(time_s, received_s)  # it may have been asked for already
        asked = change.poll(time_s, received_s, obeys, session.custom_mode)
        self._outbox.say_all(asked, self._outbox.autopilot)
        if change.failed:
            failed, change.failed = change.failed, ""
            return failed
        if engage and ready and not obeys and not change.is_changing:
            self._before_first()
            change.enter(time_s, received_s, session.custom_mode)
        if change.is_entering and isfinite(pitch_rad):
            level = Setpoints(pitch_rad, 0.0, 0.0)
            self._outbox.command(self._flavour.commands(SurfaceCommand(0, 0, 0), level))
        return ""

    def stop(self, *, obeys: bool) -> None:
        """The process ends: hand them over at once.  `obeys`: the autopilot is in our mode."""
        parting = self.mode_change.parting(obeys=obeys)
        if self.in_control:
            self._clear_for_release()
            for _ in range(RELEASE_FRAMES):
                self._release()
                self._outbox.say_all(parting, self._outbox.autopilot)
        self.is_active = False
        self._releases = 0

    def restart(self) -> None:
        """The clock is another one: what was timed by the old one is forgotten."""
        self.mode_change.stop()
        self.is_active = False
        self._releases = 0

    def _release(self) -> int:
        """Hand the surfaces over once; the bytes of it."""
        self._counters.release_frames += 1
        return self._outbox.hand_over(self._flavour.release())

    def _clear_for_release(self) -> None:
        """What is still on its way is older."""
        if self._outbox.autopilot.clear_for_release():
            outlast_cut_frame(self._release)


def outlast_cut_frame(release: Callable[[], int]) -> None:
    """Release until it is read for certain.

    A frame that was cut takes what comes behind it for its own end, up to its length: so releases
    go out at once until even the longest frame has ended, and one more after it.  `release`: sends
    one; the bytes of it, 0 where a route has none.
    """
    swallowed = 0
    while swallowed < LONGEST_FRAME:
        swallowed += release() or LONGEST_FRAME
    release()


def is_finite_command(output: Output, loops: int) -> bool:
    """Whether all that a route says of a tick are numbers."""
    if loops == OURS:
        return is_finite(output.command)
    rudder_rad = output.command.rudder if loops != THEIRS else 0.0
    return isfinite(output.setpoints.pitch_rad + output.setpoints.roll_rad + rudder_rad)
