"""Switches that act from tick to tick and go back by themselves: the multisine's, the search's."""

from __future__ import annotations

from tgl_soar.autopilot import Output
from tgl_soar.onboard.excitation_switch import ExcitationSwitch
from tgl_soar.onboard.outbound import Outbox
from tgl_soar.onboard.search_switch import SearchEngine, SearchSwitch
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup


class Switches:
    """Both of them."""

    def __init__(
        self,
        setup: ModuleSetup,
        settings: FlightSettings,
        outbox: Outbox,
        search: SearchEngine | None,
    ) -> None:
        self._excitation = ExcitationSwitch(settings, outbox)
        self._search = SearchSwitch(setup, settings, outbox, search)

    def tick(self, output: Output) -> None:
        """A tick has gone by, and its command is on its way."""
        self._excitation.tick(output.excitation)
        self._search.tick(output)

    def refusal(self, name: str, value: float) -> str:
        """Why a value may not be set; "" if it may."""
        if name != "SRCH_START" or value == 0.0:
            return ""
        if value != 1.0:
            return "set 1 to search, 0 to end it: the others are what the module shows"
        return self._search.refusal()

    def was_set(self, name: str) -> None:
        """An operator has set a parameter."""
        if name.startswith("TGL_"):
            self._search.taken_back()
