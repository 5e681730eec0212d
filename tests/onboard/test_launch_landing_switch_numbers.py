"""The switches of launch and way home, tick by tick: when they go back, and what they say."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest
from test_search_switch_numbers import IDLE

from tgl_soar.control import supervisor as modes
from tgl_soar.control.landing import BREAK, SOAR_ON, STAY
from tgl_soar.link.messages import SEVERITY_NOTICE, SEVERITY_WARNING
from tgl_soar.onboard.launch_landing_switch import LaunchLandingSwitch

Switch: Any = LaunchLandingSwitch


class Bench:
    """Parameters and an operator."""

    def __init__(self) -> None:
        self.values = {"LNC_START": 0.0, "ESC_START": 0.0, "BEAT_START": 0.0}
        self.texts: list[tuple[int, str]] = []
        self.now_s = 100.0
        self.switch = Switch(self, self)

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value

    def tell(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    def tick(
        self,
        mode: int,
        after_s: float = 0.0,
        left: tuple[float, float] = (nan, nan),
        clearance_m: float = 1.0,
    ) -> None:
        self.now_s += after_s
        report = IDLE.launch_landing._replace(height_left_m=left[0], time_left_s=left[1])
        still = IDLE.vehicle._replace(velocity_x_mps=0.0, velocity_y_mps=0.0, climb_mps=0.0)
        self.switch.tick(
            IDLE._replace(
                time_s=self.now_s,
                mode=mode,
                active=modes.is_flying(mode),
                launch_landing=report,
                vehicle=still,
                health=IDLE.health._replace(position_ok=True),
                margins=IDLE.margins._replace(clearance_m=clearance_m),
            )
        )


@pytest.fixture
def bench() -> Bench:
    return Bench()


# --- what may be set ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "active", "why"),
    [
        ("LNC_START", 1.0, True, "it flies already"),
        ("LNC_START", 1.0, False, ""),
        ("LNC_START", 0.0, True, ""),
        ("ESC_START", BREAK, False, "it is not in control"),
        ("ESC_START", BREAK, True, ""),
        ("ESC_START", STAY, False, ""),
        ("ESC_START", SOAR_ON, True, "it does not break off"),
    ],
)
def test_what_cannot_be_done_is_refused(
    bench: Bench, name: str, value: float, active: bool, why: str
) -> None:
    bench.tick(modes.SOARING if active else modes.READY)
    found = bench.switch.refusal(name, value, active=active)
    assert found.startswith(why)
    assert bool(found) == bool(why)


def test_soaring_on_is_for_the_way_home_and_a_launch_for_a_hand(bench: Bench) -> None:
    for mode in (modes.BREAKING_OFF, modes.LANDING):
        bench.tick(mode)
        assert bench.switch.refusal("ESC_START", SOAR_ON, active=True) == ""
    bench.tick(modes.READY, clearance_m=99.0)
    assert "in no hand" in bench.switch.refusal("LNC_START", 1.0, active=False)
    assert bench.switch.refusal("LNC_START", 0.0, active=False) == ""
    assert bench.switch.refusal("ESC_START", STAY, active=False) == ""


# --- going back ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("then", "launch", "home"),
    [
        (modes.LAUNCHING, 1.0, BREAK),
        (modes.SOARING, 0.0, BREAK),
        (modes.READY, 0.0, 0.0),
        (modes.RELEASED, 0.0, 0.0),
    ],
)
def test_a_launch_is_asked_for_until_it_is_over(
    bench: Bench, then: int, launch: float, home: float
) -> None:
    bench.values |= {"LNC_START": 1.0, "ESC_START": BREAK}
    bench.tick(modes.LAUNCHING)
    bench.tick(then)
    started = {"LNC_START": launch, "ESC_START": home, "BEAT_START": 0.0}
    assert bench.values == started
    assert bench.texts == []


def test_before_and_without_a_launch_it_stays_as_it_is_set(bench: Bench) -> None:
    bench.values["LNC_START"] = 1.0
    for mode in (modes.READY, modes.LAUNCHING, modes.LAUNCHING):
        bench.tick(mode)
    assert bench.values["LNC_START"] == 1.0
    other = Bench()
    other.values["LNC_START"] = 1.0
    for mode in (modes.CAPTURING, modes.SOARING):
        other.tick(mode)
    assert other.values["LNC_START"] == 1.0


@pytest.mark.parametrize(
    ("before", "after", "kept"),
    [
        (modes.BEATING, modes.BREAKING_OFF, STAY),
        (modes.BEATING, modes.CAPTURING, SOAR_ON),
        (modes.SOARING, modes.BREAKING_OFF, SOAR_ON),
        (modes.BREAKING_OFF, modes.LANDING, SOAR_ON),
    ],
)
def test_to_soar_on_is_of_the_way_home_that_it_was_asked_on(
    bench: Bench, before: int, after: int, kept: float
) -> None:
    """Beating that breaks off for its height is not turned back by what was asked hours ago."""
    bench.tick(before)
    bench.values["ESC_START"] = SOAR_ON
    bench.tick(after, 0.1)
    assert bench.values["ESC_START"] == kept


def test_a_break_that_is_asked_for_while_it_beats_stays(bench: Bench) -> None:
    bench.tick(modes.BEATING)
    bench.values["ESC_START"] = BREAK
    bench.tick(modes.BREAKING_OFF, 0.1)
    assert bench.values["ESC_START"] == BREAK


@pytest.mark.parametrize(("waits_s", "over"), [(59.9, False), (60.1, True)])
def test_a_launch_that_nobody_engages_within_a_minute_is_none(
    bench: Bench, waits_s: float, over: bool
) -> None:
    bench.tick(modes.READY, 500.0)
    bench.values["LNC_START"] = 1.0
    bench.tick(modes.READY, 0.05)
    bench.tick(modes.READY, waits_s - 0.05)
    assert (bench.values["LNC_START"] == 0.0) == over
    words = (SEVERITY_WARNING, "LNC_START is 0 again: nothing was engaged within 60 s")
    assert bench.texts == ([words] if over else [])


def test_the_minute_begins_with_the_end_of_control_and_with_another_clock(bench: Bench) -> None:
    bench.values["LNC_START"] = 1.0
    bench.tick(modes.SOARING, 100.0)
    bench.tick(modes.SOARING, 100.0)
    bench.values["LNC_START"] = 1.0
    bench.tick(modes.READY)
    bench.values["LNC_START"] = 1.0
    bench.tick(modes.READY, 59.0)
    assert bench.values["LNC_START"] == 1.0
    bench.tick(modes.READY, -80.0)
    bench.tick(modes.READY, 59.0)
    assert bench.values["LNC_START"] == 1.0
    bench.tick(modes.READY, 1.5)
    assert bench.values["LNC_START"] == 0.0


@pytest.mark.parametrize("mode", [modes.BREAKING_OFF, modes.LANDING])
@pytest.mark.parametrize(("after_s", "shown"), [(0.95, True), (1.05, False)])
def test_a_break_is_shown_for_a_second(
    bench: Bench, mode: int, after_s: float, shown: bool
) -> None:
    bench.tick(modes.SOARING, 10.0)
    bench.values["ESC_START"] = BREAK
    bench.tick(modes.SOARING, 10.0)
    assert bench.values["ESC_START"] == BREAK
    bench.tick(mode, after_s)
    assert (bench.values["ESC_START"] == BREAK) == shown
    bench.values["ESC_START"] = SOAR_ON
    bench.tick(mode, 10.0)
    assert bench.values["ESC_START"] == SOAR_ON


def test_the_second_begins_again_with_another_clock(bench: Bench) -> None:
    bench.tick(modes.SOARING)
    bench.values["ESC_START"] = BREAK
    bench.tick(modes.LANDING, 0.5)
    bench.tick(modes.LANDING, -50.0)
    bench.tick(modes.LANDING, 0.9)
    assert bench.values["ESC_START"] == BREAK
    bench.tick(modes.LANDING, 0.2)
    assert bench.values["ESC_START"] == 0.0


# --- the height that is left --------------------------------------------------------------------


def reported(bench: Bench, *lefts_m: float, mode: int = modes.SOARING) -> list[str]:
    bench.texts.clear()
    for left_m in lefts_m:
        bench.tick(mode, left=(left_m, nan))
    return [text.removeprefix("height left for the landing: ") for _, text in bench.texts]


def test_the_height_left_is_reported_at_5_2_and_0_m(bench: Bench) -> None:
    assert reported(bench, 9.0, 5.1, 4.9, 3.0, 2.1, 1.9, 0.1, -0.1, -3.0) == [
        "4.9 m", "1.9 m", "-0.1 m"
    ]  # fmt: skip
    assert bench.texts[-1][0] == SEVERITY_WARNING
    assert {severity for severity, _ in bench.texts[:-1]} == {SEVERITY_NOTICE}


def test_what_falls_through_several_at_once_is_reported_once(bench: Bench) -> None:
    assert reported(bench, 9.0, 0.0) == ["0.0 m"]
    assert bench.texts[0][0] == SEVERITY_WARNING
    assert reported(bench, -1.0) == []


def test_it_is_reported_again_after_there_were_two_metres_more(bench: Bench) -> None:
    assert reported(bench, 4.9, 6.9, 4.9) == ["4.9 m"]
    assert reported(bench, 7.1, 4.9) == ["4.9 m"]
    assert reported(bench, 1.9, 3.9, 1.9) == ["1.9 m"]
    assert reported(bench, 4.1, 1.9) == ["1.9 m"]
    assert reported(bench, 9.0, 1.9) == ["1.9 m"]
    assert reported(bench, 9.0, 4.0, 1.9) == ["4.0 m", "1.9 m"]


def test_on_the_way_home_and_on_the_ground_nothing_is_reported(bench: Bench) -> None:
    assert reported(bench, 4.0, mode=modes.LANDING) == []
    assert reported(bench, 4.0, mode=modes.READY) == []
    assert reported(bench, nan, inf) == []
    assert reported(bench, 4.0) == ["4.0 m"]
    bench.tick(modes.READY)  # another flight
    assert reported(bench, 4.0) == ["4.0 m"]


@pytest.mark.parametrize(
    ("time_s", "words"),
    [(59.9, ", 0:59 min"), (60.0, ", 1:00 min"), (125.0, ", 2:05 min"), (inf, ""), (nan, "")],
)
def test_the_time_left_is_reported_in_minutes(bench: Bench, time_s: float, words: str) -> None:
    bench.tick(modes.SOARING, left=(3.14, time_s))
    assert bench.texts == [(SEVERITY_NOTICE, f"height left for the landing: 3.1 m{words}")]
