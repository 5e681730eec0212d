"""A rangefinder in a whole flight over the shipped hill, where the profile is known."""

from __future__ import annotations

from math import isfinite
from typing import Any, NamedTuple

import pytest

from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.autopilot import fault_text
from tgl_soar.control.supervisor import SOARING
from tgl_soar.estimation.health import RANGE
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import (
    AUTOPILOT_POSITION,
    LASER_RANGE,
    MEMS_IMU,
    PositionParams,
    Sensors,
)
from tgl_soar.sim.world import make_world

HILL = shipped_hill().blown(7.0).on_line("a")
SECONDS = 12.0
DRIFTS = AUTOPILOT_POSITION._replace(noise_m=0.02, drift_up_m=2.0)


class Recorded(NamedTuple):
    """What is looked at, tick by tick."""

    time_s: list[float]
    z_m: list[float]  # the truth
    estimated_m: list[float]
    correction_m: list[float]
    clearance_m: list[float]
    faults: list[int]
    modes: list[int]


def flown(
    use: int,
    *faults: str,
    ranged: bool = True,
    position: PositionParams = AUTOPILOT_POSITION,
    seconds: float = SECONDS,
) -> Recorded:
    sensors = Sensors(position=position, imu=MEMS_IMU, rangefinder=LASER_RANGE if ranged else None)
    world = make_world(HILL.airframe, HILL.site, seed=4, turbulence=0.01, sensors=sensors)
    injection = Injection(tuple(parse_fault(text) for text in faults), 4)
    loop = ClosedLoop(world, HILL.values.changed({"RNG_USE": float(use)}), injection)
    recorded = Recorded._make([] for _ in Recorded._fields)
    while world.time_s < seconds:
        output = loop.tick()
        state = world.state
        row = (
            *(world.time_s, state.z_m, output.vehicle.z_m, output.ground_range.correction_m),
            *(output.margins.clearance_m, output.health.faults, output.mode),
        )
        columns: tuple[list[Any], ...] = recorded
        for column, value in zip(columns, row, strict=True):
            column.append(value)
    assert not world.crashed
    return recorded


@pytest.fixture(scope="module")
def plain() -> Recorded:
    return flown(1, ranged=False)


def test_where_it_says_what_the_position_says_it_only_makes_the_ground_nearer(
    plain: Recorded,
) -> None:
    """With a right position a bound of three noisy samples is above it as often as below: the
    flight is the same, the clearance never larger, and smaller by centimetres."""
    bound = flown(1)
    assert bound.z_m == plain.z_m
    pairs = zip(plain.clearance_m, bound.clearance_m, strict=True)
    nearer = [a - b for a, b in pairs if isfinite(a)]  # from the first fix on
    assert len(nearer) > 2300
    assert min(nearer) == 0.0
    assert 0.0 < max(nearer) < 0.3


def test_a_height_that_drifts_is_corrected_where_it_is_asked_for() -> None:
    """2 m, one standard deviation, of which the slope's gain K leaves less than a third."""
    off = flown(1, position=DRIFTS, seconds=6.0)
    corrected = flown(2, position=DRIFTS, seconds=6.0)
    wrong_m = abs(off.estimated_m[-1] - off.z_m[-1])
    left_m = abs(corrected.estimated_m[-1] - corrected.z_m[-1])
    assert wrong_m > 0.5
    assert left_m < 0.5 * wrong_m
    assert off.correction_m[-1] == 0.0


@pytest.mark.parametrize(
    "fault",
    ["rangefinder.bias away=-9", "rangefinder.bias away=12", "rangefinder.freeze"],
)
def test_a_rangefinder_that_is_wrong_is_reported_and_moves_little(
    fault: str, plain: Recorded
) -> None:
    """Within a gate of nothing it is off by more than the receiver could be, or does not move."""
    wrong = flown(2, f"{fault} start=7 for=4")
    words = [fault_text(faults) for faults in wrong.faults if faults & RANGE]
    assert words
    assert all("rangefinder not used" in text for text in words)
    moved = [abs(a - b) for a, b in zip(wrong.z_m, plain.z_m, strict=True)]
    assert max(moved) < 0.5
    assert wrong.modes[-1] == SOARING
    assert not wrong.faults[-1] & RANGE


def test_drop_outs_and_lost_numbers_are_no_fault(plain: Recorded) -> None:
    silent = flown(
        2, "rangefinder.dropout start=7 for=2", "rangefinder.nan start=9 for=2 fraction=1"
    )
    assert not any(faults & RANGE for faults in silent.faults)
    assert silent.modes[-1] == SOARING
    assert max(abs(a - b) for a, b in zip(silent.z_m, plain.z_m, strict=True)) < 0.5
