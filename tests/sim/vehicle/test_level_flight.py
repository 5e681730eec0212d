"""FBWA's law by hand: each stick, each angle, each rate, and the integral's limits."""

from __future__ import annotations

from math import nan

import pytest
from samples import attitude_sample

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.vehicle.level_flight import LevelFlight
from tgl_soar.types import AttitudeSample, SurfaceCommand

CENTRED = SurfaceCommand(0.0, 0.0, 0.0)
TRIM_RAD, DT = 0.05, 0.005


def attitude(
    roll: float = 0.0,
    pitch: float = TRIM_RAD,
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> AttitudeSample:
    return attitude_sample(1, 0.0, quaternion_from_euler(roll, pitch, 0.7), rates)


def step(
    sticks: SurfaceCommand, sample: AttitudeSample, dt_s: float = 0.0
) -> tuple[float, float, float]:
    return LevelFlight(TRIM_RAD).step(sticks, sample, dt_s)[:3]


def test_level_at_trim_with_centred_sticks_nothing_moves() -> None:
    assert step(CENTRED, attitude(), DT) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("sticks", "sample", "deflections"),
    [
        (CENTRED, attitude(pitch=TRIM_RAD - 0.1), (0.2, 0.0, 0.0)),
        (CENTRED, attitude(roll=0.1), (0.0, -0.12, 0.0)),
        (CENTRED, attitude(rates=(1.0, 1.0, 1.0)), (-0.19, -0.06, -0.2)),
        # A whole stick asks for 0.26 rad of pitch and 0.52 rad of bank.
        (SurfaceCommand(1.0, 0.0, 0.0), attitude(pitch=TRIM_RAD + 0.26), (0.0, 0.0, 0.0)),
        (SurfaceCommand(-0.5, 0.0, 0.0), attitude(pitch=TRIM_RAD - 0.13), (0.0, 0.0, 0.0)),
        (SurfaceCommand(0.0, 1.0, 0.0), attitude(roll=0.52), (0.0, 0.0, 0.0)),
        (SurfaceCommand(0.0, 0.0, 0.4), attitude(), (0.0, 0.0, 0.4)),
        # All of it has an end.
        (SurfaceCommand(0.0, 0.0, 1.0), attitude(-1.0, -0.7, (0.0, 0.0, -1.0)), (1.0, 1.0, 1.0)),
        (SurfaceCommand(0.0, 0.0, -1.0), attitude(1.0, 0.7, (0.0, 0.0, 1.0)), (-1.0, -1.0, -1.0)),
    ],
)
def test_each_part_moves_its_surface(
    sticks: SurfaceCommand, sample: AttitudeSample, deflections: tuple[float, float, float]
) -> None:
    assert step(sticks, sample) == pytest.approx(deflections, abs=1e-9)


def test_an_error_of_pitch_is_integrated_to_four_fifths() -> None:
    """Of 0.1 rad: 0.2 a second, beside the 0.2 at once."""
    for sign in (1.0, -1.0):
        law = LevelFlight(TRIM_RAD)
        low = attitude(pitch=TRIM_RAD - sign * 0.1)
        for _ in range(200):
            elevator = law.step(CENTRED, low, DT).elevator
        assert elevator == pytest.approx(sign * 0.4)
        for _ in range(2000):
            law.step(CENTRED, low, DT)
        assert law.step(CENTRED, attitude(), DT).elevator == pytest.approx(sign * 0.8)


@pytest.mark.parametrize(("had", "kept"), [(0.3, 0.3), (-0.3, -0.3), (1.0, 0.8), (-1.0, -0.8)])
def test_it_begins_with_the_elevator_that_was_there(had: float, kept: float) -> None:
    law = LevelFlight(TRIM_RAD)
    law.enter(had)
    assert law.step(CENTRED, attitude(), DT).elevator == pytest.approx(kept)


def test_where_there_is_no_attitude_nothing_moves() -> None:
    lost = attitude_sample(1, 0.0, (nan, nan, nan, nan), (nan, nan, nan))
    assert step(SurfaceCommand(0.5, 0.5, 0.5), lost) == (0.0, 0.0, 0.0)
