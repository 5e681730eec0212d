"""Which switch is asked whether a parameter may be set, and which learns of one that was set."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.onboard.switches import Switches

# Its surroundings only record calls, which native code refuses.
pytestmark = pytest.mark.interpreted


class NamedSwitches:
    """All switches, each of which answers with its own name."""

    def __init__(self, *, active: bool = True) -> None:
        self.calls: list[str] = []
        made: Any = Switches.__new__(Switches)
        made._launch_landing = SimpleNamespace(
            refusal=lambda name, value, active: f"launch {name} {value:g} {active}",
            tick=self._ticks("launch"),
        )
        made._firmware = SimpleNamespace(
            refusal=lambda value: f"firmware {value:g}", tick=self._ticks("firmware")
        )
        made._survey = SimpleNamespace(
            refusal=lambda value: f"survey {value:g}",
            taken_back=lambda name: self.calls.append(f"survey taken back by {name}"),
            tick=self._ticks("survey"),
        )
        made._search = SimpleNamespace(
            refusal=lambda: "search",
            taken_back=lambda: self.calls.append("search taken back"),
            act_was_set=lambda: self.calls.append("act"),
            tick=self._ticks("search"),
        )
        made._excitation = SimpleNamespace(tick=self._ticks("excitation"))
        made._active = active
        self.switches: Switches = made

    def _ticks(self, name: str) -> Any:
        return lambda given: self.calls.append(f"{name} {given}")


@pytest.mark.parametrize(
    ("name", "value", "answer"),
    [
        ("LNC_START", 1.0, "launch LNC_START 1 True"),
        ("ESC_START", 2.0, "launch ESC_START 2 True"),
        ("BEAT_START", 0.0, "launch BEAT_START 0 True"),
        ("LND_BY", 1.0, "firmware 1"),
        ("SRV_START", 1.0, "survey 1"),
        ("SRCH_START", 1.0, "search"),
        ("SRCH_START", 0.0, ""),
        ("SRCH_START", 2.0, "set 1 to search, 0 to end it: the others are what the module shows"),
        ("SRCH_START", -1.0, "set 1 to search, 0 to end it: the others are what the module shows"),
        ("TGL_X", 1.0, ""),
        ("TGL_X", 0.0, ""),
    ],
)
def test_each_parameter_is_its_own_switchs_to_refuse(name: str, value: float, answer: str) -> None:
    assert NamedSwitches().switches.refusal(name, value) == answer


def test_a_launch_is_refused_by_whether_the_last_tick_was_active() -> None:
    switches = NamedSwitches(active=False)
    assert switches.switches.refusal("LNC_START", 1.0) == "launch LNC_START 1 False"
    output: Any = SimpleNamespace(active=True, excitation="multisine")
    switches.switches.tick(output)
    assert switches.switches.refusal("LNC_START", 1.0) == "launch LNC_START 1 True"
    assert switches.calls == [
        "excitation multisine",
        *(f"{name} {output}" for name in ("search", "survey", "launch", "firmware")),
    ]


@pytest.mark.parametrize(
    ("name", "calls"),
    [
        ("FC_ACT", ["act"]),
        ("TGL_X", ["search taken back", "survey taken back by TGL_X"]),
        ("TGL_HOLD", ["search taken back", "survey taken back by TGL_HOLD"]),
        ("ELE_P", []),
        ("FC_OTHER", []),
    ],
)
def test_a_line_that_is_set_is_taken_back_from_search_and_survey(
    name: str, calls: list[str]
) -> None:
    scene = NamedSwitches()
    scene.switches.was_set(name)
    assert scene.calls == calls
