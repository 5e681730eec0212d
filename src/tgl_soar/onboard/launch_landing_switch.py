"""LNC_START, ESC_START and BEAT_START, the switches of a launch, of the way home and of beating.

What the tick makes of them it does by itself; here they go back when what they asked for is over,
so that no file that a station saves meanwhile asks for it again; what cannot be done is refused,
and the height that is left is reported before it is gone.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.control.landing import BREAK, SOAR_ON, STAY
from tgl_soar.control.launch import is_in_no_hand
from tgl_soar.control.supervisor import BEATING, LAUNCHING, goes_home, is_flying
from tgl_soar.link.messages import SEVERITY_NOTICE, SEVERITY_WARNING
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings

# The height left is reported as it falls through these, once each until there is more again.
REPORTED_M: Final = (5.0, 2.0, 0.0)
MORE_M: Final = 2.0
SHOW_BREAK_S: Final = 1.0  # the station that has set it sees it confirmed
WAIT_S: Final = 60.0  # to engage what LNC_START is set for; what comes later is not it


class LaunchLandingSwitch:
    """Follows launch and way home from tick to tick."""

    def __init__(self, settings: FlightSettings, outbox: Outbox) -> None:
        self._settings = settings
        self._outbox = outbox
        self._mode = 0
        self._reported_m = inf  # the last height that was reported
        self._flies = False  # evidently, in control or not
        self._unasked_s = inf  # when LNC_START was 0, or engaged, last
        self._here_s = inf  # when ESC_START was not 1 on the way home, last

    def refusal(self, name: str, value: float, *, active: bool) -> str:
        """Why a value may not be set; "" if it may."""
        if name == "LNC_START" and value == 1.0 and active:
            return "it flies already: a launch begins with the engagement"
        if name == "LNC_START" and value == 1.0 and self._flies:
            return "it is in no hand: too high over the ground, or too fast"
        if name == "ESC_START" and value == BREAK and not active:
            return "it is not in control: nothing to break off"
        if name == "ESC_START" and value == SOAR_ON and not goes_home(self._mode):
            return "it does not break off: 2 is for soaring on from there"
        if name == "BEAT_START" and value == 1.0:
            return self._no_beat(active)
        return ""

    def _no_beat(self, active: bool) -> str:
        """Why it cannot beat along the ridge; "" if it can."""
        if not active or goes_home(self._mode) or self._mode == LAUNCHING:
            return "it flies no line: nothing to leave for the ridge"
        if self._settings.values["BEAT_WIDTH"] <= 0.0:
            return "BEAT_WIDTH is 0: there is no room to beat"
        return ""

    def tick(self, output: Output) -> None:
        """A tick has gone by, and its command is on its way."""
        before, self._mode = self._mode, output.mode
        vehicle, position_ok = output.vehicle, output.health.position_ok
        self._flies = is_in_no_hand(vehicle, position_ok, output.margins.clearance_m)
        ended = not output.active and is_flying(before)
        if ended or (output.mode != before and before == LAUNCHING):
            self._put_back("LNC_START")
        if ended or goes_home(output.mode):  # asked for where there was no room, too
            self._put_back("BEAT_START")
        if before == BEATING and goes_home(output.mode) and self._soars_on():
            self._put_back("ESC_START")  # that was of another way home
        self._end_wait(output)
        self._end_break(output)
        if not output.active:
            if ended:
                self._put_back("ESC_START")
            self._reported_m = inf
        elif not goes_home(output.mode):
            self._tell(output.launch_landing.height_left_m, output.launch_landing.time_left_s)

    def _end_wait(self, output: Output) -> None:
        """A launch that nobody has engaged is over: an engagement hours later is none."""
        now = output.time_s
        if output.active or self._settings.values["LNC_START"] == 0.0 or now < self._unasked_s:
            self._unasked_s = now
        elif now - self._unasked_s >= WAIT_S:
            self._put_back("LNC_START")
            text = f"LNC_START is 0 again: nothing was engaged within {WAIT_S:g} s"
            self._outbox.tell(SEVERITY_WARNING, text)

    def _end_break(self, output: Output) -> None:
        """What has broken off need not be asked for any more."""
        now = output.time_s
        is_requested = goes_home(output.mode) and self._settings.values["ESC_START"] == BREAK
        if not is_requested or now < self._here_s:
            self._here_s = now
        elif now - self._here_s >= SHOW_BREAK_S:
            self._put_back("ESC_START")

    def _soars_on(self) -> bool:
        return self._settings.values["ESC_START"] == SOAR_ON

    def _put_back(self, name: str) -> None:
        if self._settings.values[name] != STAY:
            self._settings.assign(name, STAY)

    def _tell(self, left_m: float, time_s: float) -> None:
        if not isfinite(left_m):
            return
        if left_m > self._reported_m + MORE_M:
            self._reported_m = min((m for m in REPORTED_M if m >= left_m), default=inf)
        passed = [m for m in REPORTED_M if left_m <= m < self._reported_m]
        if not passed:
            return
        self._reported_m = passed[-1]
        minutes = f", {int(time_s) // 60}:{int(time_s) % 60:02d} min" if isfinite(time_s) else ""
        severity = SEVERITY_WARNING if left_m <= REPORTED_M[-1] else SEVERITY_NOTICE
        self._outbox.tell(severity, f"height left for the landing: {left_m:.1f} m{minutes}")
