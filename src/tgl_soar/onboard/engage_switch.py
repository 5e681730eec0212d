"""OP_ENGAGE, the switch that engages and disengages: who may turn it, and what turns it back.

An operator turns it by a parameter or a command (`operators`), the pilot by a channel of their
transmitter, and the module itself turns it back: when it has released, when the pilot's switch or
the last ground station has fallen silent, when another module with our identity is engaged.
Progress is reported to the station that has asked to engage.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.config.line_changes import OVERRIDE
from tgl_soar.control.supervisor import (
    BOOT,
    FAILED,
    READY,
    RELEASED,
    SOARING,
    STANDBY,
    is_flying,
)
from tgl_soar.link.commands import ABORT, ENGAGE, NOTHING, RELEASE, CommandServer
from tgl_soar.link.engagement import GONE_S, SILENCE_S, Engagement
from tgl_soar.link.messages import (
    ID_RC_CHANNELS,
    SEVERITY_ERROR,
    SEVERITY_WARNING,
    Heartbeat,
    RcChannels,
    Source,
)
from tgl_soar.link.session import Session
from tgl_soar.onboard.gnss_watch import GnssWatch
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.station_watch import StationWatch
from tgl_soar.onboard.surface_control import SurfaceControl

ENGAGED: Final = 2.0  # OP_ENGAGE of a module that is in control
SHOW_ENGAGED_S: Final = 1.0
# Stations repeat a PARAM_SET that they have not seen confirmed: MAVProxy and QGroundControl three
# times, a second apart.  What asked for this engagement must not ask for the next one: neither
# after the module has disengaged by itself, nor where the pilot or another station has released.
REPEATS_S: Final = 4.0
FORCE_S: Final = 60.0  # to type or stage what OP_FORCE is meant for; what comes later is not it
IDENTITY_REMEDY: Final = "stop one, or give it another component_id in [autopilot]"
DUPLICATE_REPORT_S: Final = 10.0  # between two words about a module with our identity


class EngageSwitch:
    """Whether the module is to be engaged, by whom, and why not."""

    def __init__(
        self,
        own: Source,
        settings: FlightSettings,
        session: Session,
        engagement: Engagement,
        commands: CommandServer,
        surfaces: SurfaceControl,
        outbox: Outbox,
        now_s: float,
    ) -> None:
        self._own = own
        self._settings = settings
        self._session = session
        self._engagement = engagement
        self._commands = commands
        self._surfaces = surfaces
        self._outbox = outbox
        self.stations = StationWatch(settings, outbox)
        self._receiver = GnssWatch(settings, session.receiver, outbox)
        self._engaged_s = now_s
        self._turned_back_s = float("-inf")  # the module has disengaged by itself
        self._released_s = float("-inf")  # somebody has released what was engaged
        self._released_by: Source | None = None  # who; None: the pilot, by their switch
        self._unforced_s = now_s  # when OP_FORCE was 0 last
        self._silence_reported = False  # of the pilot's switch
        self._duplicate_reported_s = float("-inf")

    @property
    def mode(self) -> int:
        """The module's, as its heartbeat shows it."""
        return self._session.presence.mode

    def restart(self, now_s: float) -> None:
        """The clock is another one from here on."""
        self._engagement.switch.reset()
        self.stations.restart()
        self._engaged_s = self._unforced_s = now_s
        self._turned_back_s = self._released_s = float("-inf")

    def watch(self, now_s: float) -> None:
        """What is looked at beside the ticks: its own value and force, pilot, stations."""
        self.show_engaged(now_s)
        self.end_force(now_s)
        self.watch_pilot_switch(now_s)
        self._receiver.look(now_s)
        if lost := self.stations.look(now_s):
            self.end(f"disengaged: {lost}", now_s)

    # --- may it -------------------------------------------------------------------------------

    def refusal(self, now_s: float, station: Source | None = None) -> str:
        """Why nobody can engage now; "" if it can be tried.  `station`: that asks; None: none."""
        mode = self.mode
        if mode == RELEASED:
            return "it has just disengaged: try again"
        is_idle = not self._settings.engage
        if is_idle and 0.0 <= now_s - self._turned_back_s < REPEATS_S:
            return f"it has disengaged by itself: try again after {REPEATS_S:g} s"
        is_others = station is not None and station != self._released_by
        if is_idle and is_others and 0.0 <= now_s - self._released_s < REPEATS_S:
            return f"somebody else has released: try again after {REPEATS_S:g} s"
        if mode == FAILED:
            return "it has failed: start it again"
        if not self._surfaces.is_active and not self._session.presence.is_alone(now_s):
            return f"another module has our identity: {IDENTITY_REMEDY}"
        silence = self._pilot_switch_silence(now_s)
        if silence:
            return f"the pilot's switch: {silence}"
        return self._engagement.held_back() or self.stations.refusal(now_s) or self._unfit(now_s)

    def request_refusal(self, now_s: float, station: Source | None = None) -> str:
        """The same to somebody who asks to engage, who may have corrected what is wrong."""
        refusal = self.refusal(now_s, station)
        if refusal:
            self._session.inquiry.ask_again()
        return refusal

    def _unfit(self, now_s: float) -> str:
        """Why what stands is not to be flown with; "" once it flies, or by OP_FORCE."""
        values = self._settings.values
        if self._settings.engage or values["OP_FORCE"] != 0.0:
            return ""
        fault = self._settings.server.line.fault(values) or self._session.inquiry.held_back()
        fault = fault or self._receiver.refusal(now_s)
        return f"{fault}; {OVERRIDE}" if fault else ""

    # --- turned -------------------------------------------------------------------------------

    def turn(self, request: int, by: str, now_s: float, station: Source | None = None) -> None:
        """Somebody who may has asked for it.  `station`: which; None: the pilot's switch."""
        if request == ABORT:
            self._note_release(now_s, station)
            self._withdraw()
            self._engagement.abort(by)
            text = f"aborted by {by}: no engagement until released"
            self._outbox.tell(SEVERITY_WARNING, text)
        elif request == RELEASE:
            self.released(now_s, station)
        if request == ENGAGE and self._settings.engage:
            self.report_progress()  # it flies already
        elif self._settings.engage != (request == ENGAGE):
            self._settings.assign("OP_ENGAGE", float(request == ENGAGE))
            self._outbox.console(f"{'engaged' if request == ENGAGE else 'released'} by {by}")

    def released(self, now_s: float, station: Source | None) -> None:
        """An operator has released: an abort holds nobody back any more."""
        self._note_release(now_s, station)
        self._engagement.clear()
        self._withdraw()

    def _note_release(self, now_s: float, station: Source | None) -> None:
        """What others repeat of what asked for this engagement must not ask for the next one."""
        if self._settings.engage or self._engagement.is_aborted:
            self._released_s, self._released_by = now_s, station

    def _withdraw(self) -> None:
        """An engagement whose mode has not come yet: no change of mode will report its end."""
        if self._settings.engage and not is_flying(self.mode):
            self.report_progress()

    def turn_back(self, now_s: float) -> None:
        """The module disengages by itself: the switch goes back, for all to see."""
        if is_flying(self.mode):  # a refused entry may be tried again at once
            self._turned_back_s = now_s
        self._settings.assign("OP_ENGAGE", 0.0)

    def end(self, text: str, now_s: float) -> None:
        """The module disengages for a reason, which is reported to the station that engaged it.

        Before it flew, too: a station's repeat would ask for a mode that the pilot has refused.
        """
        self._outbox.tell(SEVERITY_ERROR, text)
        self.turn_back(now_s)
        self._turned_back_s = now_s
        self.report_progress(ended=True)

    def mode_change_failed(self, text: str, now_s: float) -> None:
        """The autopilot does not come into the mode that obeys, or not out of it."""
        if self._settings.engage:
            self.end(text, now_s)
        else:
            self._outbox.tell(SEVERITY_ERROR, text)

    def report_progress(self, *, ended: bool = False) -> None:
        """Report progress to the station that asked to engage.  `ended`: by the module itself."""
        mode = self.mode
        for ack in self._commands.engagement(
            flying=is_flying(mode) and not ended,
            settled=mode == SOARING and not ended,
            withdrawn=mode in (BOOT, STANDBY, READY) and not ended,
        ):
            self._outbox.say_to(Source(ack.target_system, ack.target_component), ack)

    def show_engaged(self, now_s: float) -> None:
        """OP_ENGAGE becomes what a file may hold and yet engage nothing; not before the station
        that has set 1 could see it confirmed."""
        if not self._surfaces.is_active or self._settings.op_engage != 1.0:
            self._engaged_s = now_s
        elif now_s - self._engaged_s >= SHOW_ENGAGED_S:
            self._settings.assign("OP_ENGAGE", ENGAGED)

    def end_force(self, now_s: float) -> None:
        """OP_FORCE that nothing has used is over: an engagement hours later is not forced by it."""
        if self._settings.values["OP_FORCE"] == 0.0:
            self._unforced_s = now_s
        elif now_s - self._unforced_s >= FORCE_S:
            self._settings.assign("OP_FORCE", 0.0)
            text = f"OP_FORCE is 0 again: nothing was forced within {FORCE_S:g} s"
            self._outbox.tell(SEVERITY_WARNING, text)

    # --- the pilot's switch -------------------------------------------------------------------

    def take_pilot_switch(self, message: RcChannels, now_s: float) -> None:
        """The pilot's channels have come."""
        values = self._settings.values
        self._session.streams.received(ID_RC_CHANNELS)
        switch = self._engagement.switch
        was_low = switch.is_low
        request = switch.take(
            message, now_s, int(values["OP_RC_CHAN"]), values["OP_RC_ON"], values["OP_RC_OFF"]
        )
        if request == RELEASE and was_low and not self._settings.engage:
            return  # a switch that stays low says nothing new
        if request == ENGAGE and (refusal := self.request_refusal(now_s)):
            text = f"the pilot's switch cannot engage: {refusal}"
            self._outbox.tell(SEVERITY_WARNING, text)
        elif request != NOTHING:
            self.turn(request, "the pilot's switch", now_s)

    def watch_pilot_switch(self, now_s: float) -> None:
        """One that has fallen silent in flight: reported, and after a while the engagement ends."""
        silence = self._pilot_switch_silence(now_s) if self._settings.engage else ""
        if silence and self._engagement.switch.silence_s(now_s) > GONE_S:
            self.end(f"disengaged: the pilot's switch is silent: {silence}", now_s)
        elif silence and not self._silence_reported:
            text = f"the pilot's switch is silent, disengaging in {GONE_S - SILENCE_S:g} s"
            self._outbox.tell(SEVERITY_WARNING, f"{text}: {silence}")
        self._silence_reported = silence != ""

    def _pilot_switch_silence(self, now_s: float) -> str:
        channel = int(self._settings.values["OP_RC_CHAN"])
        return self._engagement.switch.missing(now_s, channel)

    # --- another module -----------------------------------------------------------------------

    def meet_duplicate(self, message: Heartbeat, now_s: float) -> None:
        """Another module with our identity: which of the two may be engaged (`presence`)."""
        presence = self._session.presence
        if not presence.take(message, now_s):
            return
        who = f"another module is system {self._own.system}, component {self._own.component}, too"
        is_active = self._surfaces.is_active
        if self._settings.engage and (presence.duplicate_is_engaged or not is_active):
            both = " and engaged" if presence.duplicate_is_engaged else ""
            self._outbox.say(self._session.heartbeat())  # before we are not engaged any more
            self.end(f"disengaged: {who}{both}", now_s)
        elif not 0.0 <= now_s - self._duplicate_reported_s < DUPLICATE_REPORT_S:
            self._duplicate_reported_s = now_s
            self._outbox.tell(SEVERITY_WARNING, f"{who}: {IDENTITY_REMEDY}")
