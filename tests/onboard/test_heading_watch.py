"""The word about a heading that disagrees with the way through the air."""

from __future__ import annotations

from math import cos, nan, radians, sin
from typing import Any

import pytest
from test_reports import Scene, tick

from tgl_soar.autopilot import Output
from tgl_soar.control.supervisor import (
    BEATING,
    CAPTURING,
    HOLDING,
    LANDING,
    RELEASED,
    SOARING,
    STANDBY,
)
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.heading_watch import HeadingWords

# The receiver of the reports is a stand-in here, which native code refuses.
pytestmark = pytest.mark.interpreted

DT = 0.02
ADVICE = "compass off, or wind turned"


class Watched:
    """A watch, and an aircraft that stands over the ground in a wind straight from ahead."""

    def __init__(self, veer_max_deg: float = 0.0) -> None:
        self.veer_max_rad = radians(veer_max_deg)
        self.watch, self.time_s = HeadingWords(), 50.0

    def look(self, output: Output) -> list[tuple[int, str]]:
        return self.watch.look(output, self.veer_max_rad)

    def output(
        self, heading_deg: float, wind_mps: float = 8.0, drift_mps: float = 0.0, **changes: Any
    ) -> Output:
        """Its nose points straight ahead; heading_deg is the reported heading."""
        vehicle = {"heading_rad": radians(heading_deg), "velocity_y_mps": drift_mps}
        air = {"airspeed_mps": wind_mps, "wind_mps": wind_mps}
        return tick(vehicle=vehicle, air=air)._replace(time_s=self.time_s, **changes)

    def fly(self, heading_deg: float, seconds: float, **changes: Any) -> list[tuple[int, str]]:
        words = []
        for _ in range(round(seconds / DT)):
            self.time_s += DT
            words += self.look(self.output(heading_deg, **changes))
        return words


@pytest.mark.parametrize(("heading_deg", "side"), [(20.0, "right"), (-20.0, "left")])
def test_a_heading_that_is_off_is_reported_once_and_that_it_is_over(
    heading_deg: float, side: str
) -> None:
    watched = Watched()
    # 10 of 20 degrees are averaged after 6 s ln 2 = 4.2 s, and have to last for 5 s.
    assert watched.fly(heading_deg, 9.0) == []
    (word,) = watched.fly(heading_deg, 0.5)
    assert word[0] == SEVERITY_WARNING
    assert f" deg {side} of the way through the air: {ADVICE}" in word[1]
    assert watched.fly(heading_deg, 60.0) == []
    # 5 of 20 degrees are left after 6 s ln 4 = 8.3 s, and less has to last for 5 s.
    assert watched.fly(0.0, 12.5) == []
    assert watched.fly(0.0, 1.0) == [(SEVERITY_INFO, "heading and drift agree again")]
    assert len(watched.fly(-heading_deg, 30.0)) == 1


def test_up_to_ten_degrees_nothing_is_said_and_a_swing_that_is_back_before_neither() -> None:
    watched = Watched()
    assert watched.fly(25.0, 4.0) == []
    assert watched.fly(0.0, 60.0) == []
    assert watched.fly(9.5, 60.0) == []
    assert len(watched.fly(11.0, 60.0)) == 1


def test_what_the_nose_may_follow_is_no_disagreement() -> None:
    watched = Watched(veer_max_deg=25.0)
    assert watched.fly(32.0, 60.0) == []
    assert len(watched.fly(50.0, 60.0)) == 1
    watched.veer_max_rad = radians(45.0)
    assert watched.fly(50.0, 5.1) == [(SEVERITY_INFO, "heading and drift agree again")]


def test_a_nose_that_points_aside_because_the_aircraft_goes_there_is_right() -> None:
    watched = Watched()
    assert watched.fly(30.0, 60.0, drift_mps=8.0 * sin(radians(30.0))) == []
    turned = Watched()  # banked and pitched it slips down: what counts is the flow along its axes
    vehicle = {"heading_rad": 0.0, "roll_rad": 0.3, "pitch_rad": 0.0, "velocity_y_mps": 0.0}
    air = {"airspeed_mps": 8.0, "alpha_rad": 0.1, "wind_mps": 8.0 * cos(0.1)}
    words = []
    for _ in range(3000):
        turned.time_s += DT
        words += turned.look(tick(vehicle=vehicle, air=air)._replace(time_s=turned.time_s))
    assert words == []


@pytest.mark.parametrize("wind_mps", [3.9, nan])
def test_a_wind_that_is_slow_or_not_known_has_no_side(wind_mps: float) -> None:
    assert Watched().fly(40.0, 60.0, wind_mps=wind_mps) == []


@pytest.mark.parametrize(
    "changes", [{"mode": BEATING}, {"mode": LANDING}, {"mode": HOLDING}, {"active": False}]
)
def test_away_from_a_line_nothing_is_watched_and_back_on_it_begins_again(changes: Any) -> None:
    watched = Watched()
    assert watched.fly(20.0, 60.0, **changes) == []
    assert watched.fly(20.0, 9.0, mode=CAPTURING) == []
    assert watched.fly(20.0, 9.0, **changes) == []
    assert watched.fly(20.0, 9.0) == []
    assert len(watched.fly(20.0, 1.0)) == 1
    # It is reported once in a flight, and again in another.
    assert watched.fly(20.0, 1.0, mode=HOLDING) == watched.fly(20.0, 30.0, mode=SOARING) == []
    assert watched.fly(20.0, 1.0, mode=STANDBY, active=False) == []
    assert len(watched.fly(20.0, 30.0)) == 1


@pytest.mark.parametrize("veer_max_deg", [0.0, 30.0, 45.0])
def test_a_gap_says_neither_that_they_agree_nor_the_same_again(veer_max_deg: float) -> None:
    watched = Watched(veer_max_deg)
    assert len(watched.fly(85.0, 60.0, wind_mps=8.0)) == (1 if veer_max_deg < 45.0 else 0)
    for _ in range(3):
        assert watched.fly(85.0, 0.1, mode=HOLDING) == []
        assert watched.fly(85.0, 60.0) == []
    if veer_max_deg < 45.0:  # two time constants on a line, and five seconds of agreement
        assert watched.fly(85.0, 0.1, mode=HOLDING) == watched.fly(0.0, 16.9) == []
        assert watched.fly(0.0, 0.2) == [(SEVERITY_INFO, "heading and drift agree again")]


def test_a_calm_between_resets_the_seconds() -> None:
    watched = Watched()
    assert watched.fly(20.0, 8.9) == []  # 4.7 s of it stand
    assert watched.fly(20.0, 1.0, wind_mps=3.0) == []
    assert watched.fly(20.0, 4.9) == []
    assert len(watched.fly(20.0, 0.2)) == 1


def test_a_number_that_is_missing_or_time_that_stands_changes_nothing() -> None:
    watched = Watched()
    assert watched.fly(20.0, 9.0) == []
    assert watched.fly(nan, 60.0) == []
    stood = watched.output(20.0)
    assert [watched.look(stood) for _ in range(1000)] == [[]] * 1000
    late = watched.output(20.0)._replace(time_s=watched.time_s + 100.0)
    assert watched.look(late) == []
    assert watched.look(late._replace(mode=RELEASED, active=False)) == []


def test_the_reports_of_a_tick_have_it() -> None:
    scene, watched = Scene(), Watched()
    counters: Any = None
    values: Any = {"VEER_MAX": 0.0}
    for _ in range(round(12.0 / DT)):
        watched.time_s += DT
        scene.reports.show(watched.output(20.0), watched.time_s, counters, values)
    assert [text for _, text in scene.texts if ADVICE in text] != []
