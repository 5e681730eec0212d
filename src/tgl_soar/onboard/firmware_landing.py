"""LND_BY: the firmware's own landing, asked for once the slope is left behind.

The module flies its own approach meanwhile.  It is the autopilot's heartbeat that ends it: in the
mode of its landing our commands do not act any more, and the supervisor lets go.  So nobody waits
for anybody; a firmware that does not take the landing leaves the module to land.

    ask      right after a heartbeat, `TRIES` times, a request may be lost
    done     a heartbeat shows the mode; an acknowledgement alone says nothing

ArduPlane's return circles over home, with a throttle that we do not have, unless RTL_AUTOLAND says
otherwise; that is not read.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.control.supervisor import LANDING
from tgl_soar.link.autopilots.ardupilot import MODE_AUTO
from tgl_soar.link.autopilots.px4 import MODE_MISSION, MODE_RETURN
from tgl_soar.link.messages import (
    COMMAND_DO_LAND_START,
    COMPONENT_AUTOPILOT,
    SEVERITY_NOTICE,
    SEVERITY_WARNING,
    CommandLong,
)
from tgl_soar.link.mode_change import ANSWER_S, TRIES
from tgl_soar.link.session import Session
from tgl_soar.onboard.outbound import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup

BY_MISSION: Final = 1
BY_RETURN: Final = 2
# custom_mode in which each firmware lands, by its name and LND_BY.
LANDING_MODES: Final = {
    "ardupilot": {BY_MISSION: MODE_AUTO},
    "px4": {BY_MISSION: MODE_MISSION, BY_RETURN: MODE_RETURN},
}
NO_PARAMS: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class FirmwareLanding:
    """Asks for it from tick to tick."""

    def __init__(
        self, setup: ModuleSetup, settings: FlightSettings, session: Session, outbox: Outbox
    ) -> None:
        self._setup, self._settings = setup, settings
        self._session, self._outbox = session, outbox
        self._tries = 0
        self._asked_for = -1  # custom_mode
        self._asked_s = self._looked_s = float("-inf")

    def refusal(self, value: float) -> str:
        """Why LND_BY may not be set so; "" if it may."""
        name = self._setup.flavour.name
        modes = LANDING_MODES.get(name)
        if value == 0.0 or (modes and value in modes):
            return ""
        if modes:
            return f"the return of {name} does not land, unless RTL_AUTOLAND says so: 0 or 1"
        return f"no landing of {name} is known: 0"

    def tick(self, output: Output) -> None:
        """A tick has gone by."""
        by = int(self._settings.values["LND_BY"])
        modes = LANDING_MODES.get(self._setup.flavour.name, {})
        if output.mode != LANDING or by not in modes:
            self._ended()
            return
        heard_s = self._session.status.time_s
        if not heard_s > self._looked_s or self._tries > TRIES:
            return
        self._looked_s = heard_s
        if output.time_s - self._asked_s < ANSWER_S:
            return
        self._tries += 1
        self._asked_s = output.time_s
        if self._tries > TRIES:
            self._outbox.tell(
                SEVERITY_WARNING, f"the autopilot does not land ({TRIES} times asked): we do"
            )
            return
        self._asked_for = modes[by]
        self._outbox.say_all((self._request(by, modes[by]),), self._outbox.autopilot)

    def _request(self, by: int, custom_mode: int) -> CommandLong:
        if by == BY_RETURN:
            return self._setup.flavour.ask_for_mode(custom_mode)
        return CommandLong(
            target_system=self._session.autopilot.system,
            target_component=COMPONENT_AUTOPILOT,
            command=COMMAND_DO_LAND_START,
            confirmation=0,
            params=NO_PARAMS,
        )

    def _ended(self) -> None:
        if self._tries and self._session.custom_mode == self._asked_for:
            self._outbox.tell(SEVERITY_NOTICE, "the autopilot lands")
        self._tries = 0
        self._asked_s = self._looked_s = float("-inf")
