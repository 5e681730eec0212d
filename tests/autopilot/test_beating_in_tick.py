"""Beating along the ridge in the tick, over a hill that is large enough for a slow wind."""

from __future__ import annotations

from math import nan, radians
from typing import Any

import numpy as np
import pytest
from test_launch_landing_in_tick import Flown, values_of

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import RecordedField, WindRecord
from tgl_soar.analysis.experiments.outdoors.hour import BEATS, HourCase, HourJob, hour_flown
from tgl_soar.autopilot import step
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.landing import BREAK, STAY
from tgl_soar.control.launch_landing import (
    SLOW_S,
    Lull,
    can_beat,
    turning_bank,
    with_way_home,
)
from tgl_soar.control.laws import laws_from
from tgl_soar.control.ridge_beat import BACK_S, BANK_RAD, VEER_S
from tgl_soar.control.supervisor import (
    BEAT,
    BEATING,
    BREAK_OFF,
    BREAKING_OFF,
    CAPTURING,
    HOLDING,
    NEAR_LINE,
    REASON_BEAT,
    REASON_BREAK,
    REASON_STANDS,
    RECOVERING,
    RELEASED,
    SEARCHING,
    SETTLES,
    SOARING,
)
from tgl_soar.control.throttle import LOW_S
from tgl_soar.sim.flight import inputs_at
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import NO_AIR, THEIRS

RADIUS_M = 30.0
SLOW_MPS = 5.2  # 6.3 m/s at the line: too slow to stand in


WINDS = ((0.0, 7.0), (15.0, 7.0), (18.0, SLOW_MPS), (75.0, SLOW_MPS), (78.0, 7.3))


def hill(
    seed: int, *, steady_mps: float = 0.0, veer_deg: float = 0.0, **changes: float
) -> tuple[World, ParameterSet]:
    """steady_mps: 0: as WINDS has it.  veer_deg: from 18 s on."""
    what = hour_flown(HourJob(HourCase(RADIUS_M, 7.0, 0, BEATS), seed))
    winds = ((0.0, steady_mps),) if steady_mps else WINDS
    record = WindRecord(
        Schedule(*zip(*winds, strict=True)),
        Schedule((0.0, 8.0, 18.0), (0.0, 0.0, radians(veer_deg))),
    )
    field = RecordedField(HillField(7.0, RADIUS_M), record)
    world = make_world(what.airframe, what.site, seed=seed, turbulence=0.03, field=field)
    return world, what.values.changed({"BEAT_AUTO": 2.0, "BEAT_WIDTH": 40.0, **changes})


@pytest.fixture(scope="module")
def beaten() -> tuple[Flown, dict[str, np.ndarray[Any, Any]]]:
    """It stands in 7 m/s; then the wind is too slow; then it is back."""
    flown = Flown(*hill(1)).fly(15.0)
    assert flown.output.mode == SOARING
    path = []
    for _ in range(630):
        flown.fly(0.1)
        vehicle = flown.output.vehicle
        path.append((vehicle.x_m, vehicle.y_m, vehicle.z_m, flown.output.mode))
    flown.fly(60.0, SOARING)
    x, y, z, mode = np.array(path).T
    return flown, {"x": x, "y": y, "z": z, "mode": mode}


def test_it_beats_where_it_cannot_stand_and_stands_again(beaten: Any) -> None:
    flown, path = beaten
    assert [each for each in flown.modes if each[0] >= CAPTURING][2:] == [
        (BEATING, REASON_BEAT),
        (CAPTURING, REASON_STANDS),
        (SOARING, flown.modes[-1][1]),
    ]
    late = path["mode"] == BEATING
    assert late.sum() > 540
    y, z = path["y"][late], path["z"][late]
    assert y.max() > 25.0
    assert y.min() < -25.0
    assert y.max() < 48.0
    assert y.min() > -48.0
    # It does not sink out of the lift in half a minute more.
    assert z[-1] > z[250] - 1.0
    assert abs(flown.output.vehicle.y_m) < 20.0
    assert not flown.loop.world.crashed


def test_it_beats_in_a_wind_that_the_nose_cannot_follow() -> None:
    flown = Flown(*hill(3, steady_mps=7.5, veer_deg=50.0, VEER_MAX=20.0)).fly(70.0)
    assert (BEATING, REASON_BEAT) in flown.modes
    assert flown.output.mode == BEATING
    assert flown.output.vehicle.z_m > 35.0


def test_without_leave_it_does_not() -> None:
    flown = Flown(*hill(1, BEAT_AUTO=0.0)).fly(40.0)
    assert BEATING not in [mode for mode, _ in flown.modes]


def test_it_beats_when_commanded_and_is_back_when_commanded() -> None:
    flown = Flown(*hill(2, steady_mps=7.0, BEAT_AUTO=0.0)).fly(10.0)
    flown.loop.change({"BEAT_START": 1.0})
    flown.fly(25.0)
    assert flown.output.mode == BEATING
    flown.loop.change({"BEAT_START": 0.0})
    flown.fly(40.0, SOARING)
    assert flown.modes[-3:] == [
        (BEATING, REASON_BEAT),
        (CAPTURING, REASON_STANDS),
        (SOARING, flown.modes[-1][1]),
    ]


def test_a_break_off_comes_first() -> None:
    flown = Flown(*hill(2, steady_mps=7.0, BEAT_AUTO=0.0)).fly(10.0)
    flown.loop.change({"BEAT_START": 1.0})
    flown.fly(12.0)
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(0.5)
    assert flown.modes[-1] == (BREAKING_OFF, REASON_BREAK)
    flown.fly(120.0)
    assert "ground" in flown.loop.world.crashed


@pytest.mark.parametrize("bank_max_deg", [8.0, 35.0])
def test_a_firmware_that_turns_by_banking_beats_with_the_bank_of_beating(
    bank_max_deg: float,
) -> None:
    """Whatever BANK_MAX is, which is for standing: there the nose is 50 degrees from where it is
    to be, and so is asked for all of the bank that it may have."""
    world, before = FLOWN.loop.world, FLOWN.loop.state
    values = FLOWN.loop.values.changed({"BANK_MAX": bank_max_deg})
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground, loops=THEIRS)
    assert turning_bank(laws, SOARING, 0.9, 0.0) == pytest.approx(radians(bank_max_deg))
    way = before.launch_landing
    turning = before._replace(
        supervisor=before.supervisor._replace(mode=BEATING, conditions=-1),
        launch_landing=way._replace(glide=way.glide._replace(weave_rad=0.9)),
    )
    _, output = step(laws, turning, inputs_at(world.time_s, world.now.samples, True))
    assert output.mode == BEATING
    assert output.setpoints.heading_rad == pytest.approx(0.9, abs=0.05)
    assert output.setpoints.roll_rad == pytest.approx(BANK_RAD)


# --- when -----------------------------------------------------------------------------------


def conditions_of(
    mode: int,
    found: int = SETTLES | NEAR_LINE,
    lull: Lull = Lull(0.0, 0.0),  # noqa: B008 -- a tuple
    oblique_s: float = 0.0,
    clearance_m: float = 30.0,
    **changes: Any,
) -> int:
    """What is added to the conditions of a tick."""
    flown = FLOWN
    values = flown.loop.values.changed({"BEAT_AUTO": 2.0, "ESC_AUTO": 0.0, **changes})
    world = flown.loop.world
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
    before = flown.loop.state
    estimates = ESTIMATES._replace(margins=ESTIMATES.margins._replace(clearance_m=clearance_m))
    phase = before.launch_landing._replace(
        lull=lull, beat=before.launch_landing.beat._replace(oblique_s=oblique_s)
    )
    supervisor = before.supervisor._replace(mode=mode)
    return with_way_home(laws, supervisor, phase, estimates, found) & ~found


FLOWN: Flown
ESTIMATES: Any


@pytest.fixture(autouse=True, scope="module")
def _soars() -> None:
    from tgl_soar.control.estimates import estimate

    global FLOWN, ESTIMATES
    FLOWN = Flown(*hill(1)).fly(8.0)
    world, state = FLOWN.loop.world, FLOWN.loop.state
    laws = laws_from(FLOWN.loop.values, world.frame, world.aerodynamics, world.ground)
    inputs = inputs_at(world.time_s, world.now.samples, True)
    ESTIMATES = estimate(laws, state.memory, inputs, True, state.loops.limited, 0.005)


SLOW = Lull(SLOW_S, 0.0)


@pytest.mark.parametrize("mode", [CAPTURING, SOARING, SEARCHING])
def test_it_beats_in_a_wind_too_slow_or_too_oblique_to_stand_in(mode: int) -> None:
    assert conditions_of(mode, lull=SLOW) == BEAT
    assert conditions_of(mode, lull=Lull(SLOW_S - 0.01, 0.0)) == 0
    assert conditions_of(mode, oblique_s=VEER_S) == BEAT
    assert conditions_of(mode, oblique_s=VEER_S - 0.01) == 0
    assert conditions_of(mode, lull=SLOW, BEAT_AUTO=1.0) == BEAT


@pytest.mark.parametrize(
    "changes",
    [
        {"BEAT_AUTO": 0.0},
        {"BEAT_WIDTH": 0.0},
        {"clearance_m": 5.9},  # twice ESC_CLEAR
        {"lull": Lull(SLOW_S, LOW_S)},  # it sinks: there is no lift to beat in
        {"mode": HOLDING},
        {"mode": RECOVERING},
        {"mode": BREAKING_OFF},
    ],
)
def test_it_does_not_beat(changes: dict[str, Any]) -> None:
    options: dict[str, Any] = {"mode": SOARING, "lull": SLOW} | changes
    if options["mode"] in (HOLDING, RECOVERING, BREAKING_OFF):
        options |= {"lull": Lull(0.0, 0.0), "oblique_s": VEER_S}
    assert conditions_of(**options) == 0


def test_where_it_may_do_either_it_beats() -> None:
    """And breaks off where it cannot: the way home is known, and there is height for it."""
    home: dict[str, Any] = {"ESC_AUTO": 1.0}
    assert FLOWN.loop.state.launch_landing.escape.armed
    assert conditions_of(SOARING, lull=SLOW, **home) == BEAT
    assert conditions_of(SOARING, lull=SLOW, BEAT_AUTO=0.0, **home) == BREAK_OFF
    assert conditions_of(SOARING, lull=SLOW, clearance_m=5.9, **home) == BREAK_OFF
    # A line that is given up is no lull: there may be no lift elsewhere.
    assert conditions_of(SOARING, found=NEAR_LINE, **home) == BREAK_OFF


@pytest.mark.parametrize("found", [SETTLES, NEAR_LINE])
@pytest.mark.parametrize("auto", [0.0, 2.0])
def test_a_line_that_it_falls_off_in_a_lull_is_left_to_beat(found: int, auto: float) -> None:
    """A wind that dies fast takes it off the line before the two seconds of a lull are over."""
    half = Lull(0.5 * SLOW_S, 0.0)
    assert conditions_of(SOARING, found=found, lull=half, ESC_AUTO=auto) == BEAT
    otherwise = BREAK_OFF if auto else 0
    shorter = Lull(0.5 * SLOW_S - 0.01, 0.0)
    for changes in ({"lull": shorter}, {"lull": half, "BEAT_AUTO": 0.0}):
        assert conditions_of(SOARING, found=found, ESC_AUTO=auto, **changes) == otherwise
    assert conditions_of(SOARING, lull=half) == 0  # it is still on the line


def test_beating_needs_room() -> None:
    world = FLOWN.loop.world

    def can(clearance_m: float = 30.0, position_ok: bool = True, **changes: float) -> bool:
        values = FLOWN.loop.values.changed(changes)
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        margins = ESTIMATES.margins._replace(clearance_m=clearance_m)
        health = ESTIMATES.health._replace(position_ok=position_ok)
        return can_beat(laws, ESTIMATES._replace(margins=margins, health=health))

    assert can()
    assert not can(position_ok=False)
    assert not can(5.9)
    assert can(6.1)
    assert not can(6.1, CLEAR_MIN=4.0)
    assert not can(BEAT_WIDTH=0.0)
    assert not can(nan)


def test_the_fence_bounds_its_width() -> None:
    world = FLOWN.loop.world

    def half_width(**changes: float) -> float:
        values = values_of(**changes)
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        return laws.beat.half_width_m

    assert half_width(BEAT_WIDTH=30.0, FENCE_Y_MAX=100.0) == 30.0
    assert half_width(BEAT_WIDTH=90.0, FENCE_Y_MAX=100.0) == 80.0


def test_what_is_not_known_neither_begins_nor_ends_it() -> None:
    state = FLOWN.loop.state.launch_landing.beat
    from tgl_soar.control.ridge_beat import beat_watch, is_wanted_back

    world = FLOWN.loop.world
    laws = laws_from(FLOWN.loop.values, world.frame, world.aerodynamics, world.ground)
    blind = state
    for _ in range(round(2.0 * BACK_S / 0.05)):
        blind = beat_watch(laws.beat, laws.landing, blind, NO_AIR, 0.05)
    assert (blind.oblique_s, blind.stands_s) == (0.0, 0.0)
    assert not is_wanted_back(laws.beat, blind)
    assert (STAY, BREAK) == (0, 1)
    assert RELEASED not in [mode for mode, _ in FLOWN.modes]
