"""The safety pilot, part by part with its limits, in a mode that helps and in manual flight."""

from __future__ import annotations

from math import atan, cos, radians, sin
from typing import Any

import pytest

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.pilot import SafetyPilot
from tgl_soar.sim.vehicle.level_flight import LevelFlight
from tgl_soar.types import AttitudeSample, SurfaceCommand

DT_S = 0.01
FULL_STICK_RAD = 0.26
# Upstream normal of a line that leans 15 degrees upwind: up, it goes towards the wind (x falls).
UPSTREAM = -cos(radians(15.0)), -sin(radians(15.0))
STILL = (0.0, 0.0, 0.0)


def attitude(roll: float = 0.0, pitch: float = 0.0) -> AttitudeSample:
    qw, qx, qy, qz = quaternion_from_euler(roll, pitch, 0.0)
    return AttitudeSample(
        sequence=1,
        time_s=0.0,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    )


class Flown:
    """A pilot who has taken over at a place."""

    def __init__(self, *, manual: bool = False, elevator: float = 0.0) -> None:
        self.pilot = SafetyPilot(0.05, DT_S)
        self.manual, self.elevator = manual, elevator
        self.first = self.sticks((5.0, 0.0, 12.0))

    def sticks(
        self, place: tuple[float, float, float], velocity: Any = STILL, heading: float = 0.0
    ) -> SurfaceCommand:
        return self.pilot.sticks(place, velocity, heading, attitude(), self.manual, self.elevator)

    def moved(self, along_m: float) -> tuple[float, float, float]:
        """So far upstream of where they took over."""
        return 5.0 + along_m * UPSTREAM[0], 0.0, 12.0 + along_m * UPSTREAM[1]


def test_where_they_took_over_there_is_nothing_to_correct() -> None:
    assert Flown().first == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("along_m", [0.2, -0.2])
def test_upwind_of_the_line_the_nose_is_held_up_by_half_a_radian_a_metre(along_m: float) -> None:
    """And by what a step of 10 ms adds to the sum: a tenth of it."""
    found = Flown().sticks(Flown().moved(along_m))
    asked = 0.5 * along_m + 0.1 * along_m * DT_S
    assert found.elevator * FULL_STICK_RAD == pytest.approx(asked)
    assert (found.aileron, found.rudder, found.brake) == (0.0, 0.0, 0.0)


def test_along_the_line_nothing_is_corrected() -> None:
    found = Flown().sticks((5.0 - 3.0 * sin(radians(15.0)), 0.0, 12.0 + 3.0 * cos(radians(15.0))))
    assert found.elevator == pytest.approx(0.0, abs=1e-12)


def test_going_upwind_is_damped_by_a_quarter_of_a_radian_for_each_metre_a_second() -> None:
    velocity = (0.4 * UPSTREAM[0], 9.0, 0.4 * UPSTREAM[1])
    found = Flown().sticks((5.0, 0.0, 12.0), velocity)
    assert found.elevator * FULL_STICK_RAD == pytest.approx(0.1)


@pytest.mark.parametrize("along_m", [9.0, -9.0])
def test_no_more_than_015_radians_are_asked_for(along_m: float) -> None:
    found = Flown().sticks(Flown().moved(along_m))
    assert found.elevator * FULL_STICK_RAD == pytest.approx(0.15 if along_m > 0.0 else -0.15)


@pytest.mark.parametrize("along_m", [0.1, -0.1])
def test_what_stays_is_summed_up_to_a_tenth_of_a_radian(along_m: float) -> None:
    flown = Flown()
    place = flown.moved(along_m)
    for _ in range(100):
        found = flown.sticks(place)
    assert found.elevator * FULL_STICK_RAD == pytest.approx(0.5 * along_m + 0.1 * along_m)
    for _ in range(3000):
        found = flown.sticks(place)
    sign = 1.0 if along_m > 0.0 else -1.0
    assert found.elevator * FULL_STICK_RAD == pytest.approx(sign * min(0.15, 0.05 + 0.1))
    for _ in range(200):  # 0.02 rad of it back
        flown.sticks(flown.moved(-along_m))
    found = flown.sticks(flown.moved(0.0))
    assert found.elevator * FULL_STICK_RAD == pytest.approx(sign * 0.08, abs=0.001)


@pytest.mark.parametrize(
    ("y_m", "heading", "rudder"),
    [
        (0.0, 0.1, -1.2 * 0.1),
        (2.0, 0.0, -1.2 * atan(0.25)),
        (-8.0, 0.0, 1.2 * atan(1.0)),
        (0.0, 2.0, -1.0),
        (0.0, -2.0, 1.0),
    ],
)
def test_the_rudder_heads_for_the_middle_and_upwind(
    y_m: float, heading: float, rudder: float
) -> None:
    found = Flown().sticks((5.0, y_m, 12.0), STILL, heading)
    assert found.rudder == pytest.approx(rudder)


def test_who_has_handed_over_begins_again_where_they_take_over() -> None:
    flown = Flown()
    for _ in range(500):
        flown.sticks(flown.moved(0.2))
    flown.pilot.hand_over()
    assert flown.sticks((1.0, 0.0, 1.0)) == (0.0, 0.0, 0.0, 0.0)
    assert flown.sticks((1.0, 0.0, 1.0)) == (0.0, 0.0, 0.0, 0.0)


def test_in_manual_flight_they_move_the_surfaces_as_level_flight_would() -> None:
    flown = Flown(manual=True, elevator=0.3)
    law = LevelFlight(0.05)
    law.enter(0.3)
    assert flown.first == law.step(SurfaceCommand(0.0, 0.0, 0.0), attitude(), DT_S)
    place = flown.moved(0.1)
    asked = SurfaceCommand((0.05 + 0.1 * 0.1 * DT_S) / FULL_STICK_RAD, 0.0, 0.0)
    assert flown.sticks(place) == pytest.approx(law.step(asked, attitude(), DT_S))
    helped = Flown(elevator=0.3)
    assert helped.first == (0.0, 0.0, 0.0, 0.0)
