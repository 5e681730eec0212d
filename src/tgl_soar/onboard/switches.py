"""Switches that act from tick to tick and go back by themselves: the multisine's, the search's,
the survey's, a launch's, the way home's, beating's; and the firmware's landing."""

from __future__ import annotations

from tgl_soar.autopilot import Output
from tgl_soar.link.session import Session
from tgl_soar.onboard.excitation_switch import ExcitationSwitch
from tgl_soar.onboard.firmware_landing import FirmwareLanding
from tgl_soar.onboard.launch_landing_switch import LaunchLandingSwitch
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.search_switch import SearchEngine, SearchSwitch
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.survey_switch import SurveySwitch


class Switches:
    """All of them."""

    def __init__(
        self,
        setup: ModuleSetup,
        settings: FlightSettings,
        session: Session,
        outbox: Outbox,
        search: SearchEngine | None,
    ) -> None:
        self._excitation = ExcitationSwitch(settings, outbox)
        self._search = SearchSwitch(setup, settings, outbox, search)
        self._survey = SurveySwitch(setup, settings, outbox)
        self._launch_landing = LaunchLandingSwitch(settings, outbox)
        self._firmware = FirmwareLanding(setup, settings, session, outbox)
        self._active = False

    def tick(self, output: Output) -> None:
        """A tick has gone by, and its command is on its way."""
        self._excitation.tick(output.excitation)
        self._search.tick(output)
        self._survey.tick(output)
        self._launch_landing.tick(output)
        self._firmware.tick(output)
        self._active = output.active

    def refusal(self, name: str, value: float) -> str:
        """Why a value may not be set; "" if it may."""
        if name in ("LNC_START", "ESC_START", "BEAT_START"):
            return self._launch_landing.refusal(name, value, active=self._active)
        if name == "LND_BY":
            return self._firmware.refusal(value)
        if name == "SRV_START":
            return self._survey.refusal(value)
        if name != "SRCH_START" or value == 0.0:
            return ""
        if value != 1.0:
            return "set 1 to search, 0 to end it: the others are what the module shows"
        return self._search.refusal()

    def was_set(self, name: str) -> None:
        """An operator has set a parameter."""
        if name == "FC_ACT":
            self._search.act_was_set()
        if name.startswith("TGL_"):
            self._search.taken_back()
            self._survey.taken_back(name)
