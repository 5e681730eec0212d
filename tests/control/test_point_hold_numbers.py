"""The numbers of a held point: its way, its law, how it stands at each limit, and how it gives way.

Gains are round ones, so that what is expected is a sum by hand.
"""

from __future__ import annotations

from math import cos, hypot, inf, nan, pi, radians, sin
from typing import Any

import pytest
from samples import STILL
from test_point_hold import ETA, TARGET, around, laws

from tgl_soar.control.brake_watch import (
    ACTS,
    DOES_NOT,
    NOT_TRIED,
    NOT_WATCHED,
    NOTHING,
    EvenState,
    pulls,
)
from tgl_soar.control.point_hold import (
    ABOVE_BAND,
    BELOW_BAND,
    DEAD,
    GIVES_WAY,
    HOLDS,
    LINE_ONLY,
    NO_BRAKE,
    NO_POINT,
    POINT_TEXTS,
    RESTS,
    TRIES,
    UNEVEN,
    Around,
    BrakeGains,
    BrakeState,
    acts,
    brake_effect,
    brake_step,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.types import Aerodynamics, VehicleState, polar_slope

DT_S = 0.01
SPEED_MPS = 10.0
MOST_MPS = 0.4  # sink that all of the brake adds at that speed
GAINS = BrakeGains(
    wanted=True,
    gives_way=False,
    available=True,
    along_m=0.0,
    kp_per_s=0.8,
    speed_max_mps=0.3,
    kv=0.5,
    ki_per_s=0.25,
    bias=0.4,
    sink=MOST_MPS / SPEED_MPS**3,
    lift_rad=0.02,
    elevator=0.05,
)
AERO: Aerodynamics = laws().wind.aerodynamics
AT_POINT = NO_POINT._replace(
    standing=HOLDS,
    weight=1.0,
    x_m=TARGET.x_m,
    z_m=TARGET.z_m,
    ordered_x_m=TARGET.x_m,
    ordered_z_m=TARGET.z_m,
    brake=0.4,
    mean=0.4,
)


def at(along_m: float, speed_mps: float = 0.0, aside_m: float = 0.0) -> VehicleState:
    """Up along the line from its own point, sliding up, and beside it."""
    return STILL._replace(
        x_m=TARGET.x_m + along_m * cos(ETA) - aside_m * sin(ETA),
        z_m=TARGET.z_m + along_m * sin(ETA) + aside_m * cos(ETA),
        velocity_x_mps=speed_mps * cos(ETA),
        climb_mps=speed_mps * sin(ETA),
    )


def step(
    state: BrakeState = AT_POINT,
    vehicle: VehicleState | None = None,
    *,
    gains: BrakeGains = GAINS,
    target: TargetLine = TARGET,
    now: dict[str, Any] | None = None,
    aero: Aerodynamics = AERO,
    dt_s: float = DT_S,
) -> BrakeState:
    given: Around = around(state)._replace(**(now or {}))
    vehicle = at(0.0) if vehicle is None else vehicle
    return brake_step(gains, aero, state, target, ETA, vehicle, SPEED_MPS, given, dt_s)


# --- the law ------------------------------------------------------------------------------------


@pytest.mark.parametrize("along_m", [-0.2, 0.1])
@pytest.mark.parametrize("speed_mps", [-0.05, 0.08])
def test_the_sink_that_is_added_is_by_the_speed_that_leads_back(
    along_m: float, speed_mps: float
) -> None:
    slope = polar_slope(AERO.polar, SPEED_MPS)
    sinks = sin(ETA) - slope * cos(ETA)
    error = sinks * (speed_mps + 0.8 * along_m)
    state = step(vehicle=at(along_m, speed_mps))
    # Its integral grows by this step's part of K_i.
    fraction = 0.4 + (0.5 + 0.25 * DT_S) * error / MOST_MPS
    assert state.brake == pytest.approx(fraction, abs=0.3 * DT_S * abs(error) / MOST_MPS)
    assert 0.0 < state.brake < 1.0
    assert state.pid.integral == pytest.approx(0.25 * DT_S * error)
    assert state.off_m == pytest.approx(along_m)


def test_it_leads_back_no_faster_than_it_may() -> None:
    """At 0.8 /s that is all of 0.3 m/s from 0.375 m on."""
    near, far, opposite = (step(vehicle=at(m)).pid.integral for m in (0.3749, 5.0, -5.0))
    assert far == pytest.approx(near, rel=1e-3)
    assert opposite == -far


def test_what_lies_beside_the_line_is_not_the_brakes() -> None:
    assert step(vehicle=at(0.1, aside_m=0.5)).off_m == pytest.approx(0.1)
    assert step(vehicle=at(0.1, aside_m=0.5)).brake == pytest.approx(step(vehicle=at(0.1)).brake)


def test_who_moves_with_the_point_is_in_no_error() -> None:
    """The point slides up at its 0.3 m/s, towards an order 1 m further up."""
    gains = GAINS._replace(along_m=1.0)
    ordered = AT_POINT._replace(
        ordered_x_m=TARGET.x_m + cos(ETA), ordered_z_m=TARGET.z_m + sin(ETA)
    )
    state = step(ordered, at(0.003, 0.3), gains=gains)
    assert state.off_m == pytest.approx(0.0, abs=1e-9)
    assert state.pid.integral == pytest.approx(0.0, abs=1e-9)
    assert state.brake == pytest.approx(0.4)


def test_the_brake_goes_from_nothing_to_all_of_it() -> None:
    stretched = GAINS._replace(kv=50.0)
    assert step(vehicle=at(0.3, 0.5), gains=stretched).brake == 1.0
    assert step(vehicle=at(-0.3, -0.5), gains=stretched).brake == 0.0


@pytest.mark.parametrize("brake", [0.25, 1.0])
def test_a_brake_turns_the_setpoint_and_the_trim(brake: float) -> None:
    """S_b / V at 10 m/s: 0.04."""
    effect = brake_effect(GAINS, brake, SPEED_MPS)
    assert effect.pitch_rad == pytest.approx(brake * (0.02 - 0.04))
    assert effect.elevator == pytest.approx(brake * 0.05)
    assert brake_effect(GAINS._replace(available=False), brake, SPEED_MPS) == (0.0, 0.0)
    assert brake_effect(GAINS, 0.0, SPEED_MPS) == (0.0, 0.0)


# --- the point that is flown --------------------------------------------------------------------


@pytest.mark.parametrize("along_m", [0.5, -0.5])
def test_a_point_that_is_ordered_elsewhere_goes_there_step_by_step(along_m: float) -> None:
    gains = GAINS._replace(along_m=along_m)
    state = step(gains=gains)
    where = TARGET.x_m + along_m * cos(ETA), TARGET.z_m + along_m * sin(ETA)
    assert (state.ordered_x_m, state.ordered_z_m) == pytest.approx(where)
    assert hypot(state.x_m - TARGET.x_m, state.z_m - TARGET.z_m) == pytest.approx(0.3 * DT_S)
    # It is off by the way of the point, and by nothing else.
    assert state.off_m == pytest.approx(-0.3 * DT_S * along_m / 0.5)
    last = state._replace(x_m=where[0] + 0.002, z_m=where[1])
    arrived = step(last, gains=gains)
    assert (arrived.x_m, arrived.z_m) == pytest.approx(where)


def test_a_point_of_a_line_that_moved_follows_it() -> None:
    moved = TARGET._replace(x_m=TARGET.x_m + 1.0)
    state = step(target=moved)
    assert (state.ordered_x_m, state.ordered_z_m) == (moved.x_m, moved.z_m)
    assert (state.x_m, state.z_m) == pytest.approx((TARGET.x_m + 0.3 * DT_S, TARGET.z_m))


def test_without_a_point_it_starts_at_the_aircraft() -> None:
    begun = AT_POINT._replace(x_m=nan, z_m=nan)
    state = step(begun, at(0.002))
    assert state.off_m == pytest.approx(0.002)  # it has gone all of the way in one step
    state = step(begun, at(0.1))
    assert state.off_m == pytest.approx(0.3 * DT_S)


def test_a_time_that_stands_still_moves_nothing() -> None:
    state = step(vehicle=at(0.1), gains=GAINS._replace(along_m=1.0), dt_s=0.0)
    assert (state.x_m, state.z_m) == (TARGET.x_m, TARGET.z_m)
    assert state.pid.integral == 0.0
    assert state.off_m == pytest.approx(0.1)


# --- how it stands ------------------------------------------------------------------------------


@pytest.mark.parametrize("standing", range(len(POINT_TEXTS)))
def test_a_fault_lasts_until_the_operator_asks_again(standing: int) -> None:
    state = AT_POINT._replace(standing=standing)
    assert step(state, gains=GAINS._replace(wanted=False)).standing == LINE_ONLY
    expected = standing if standing in (DEAD, UNEVEN) else NO_BRAKE
    assert step(state, gains=GAINS._replace(available=False)).standing == expected
    expected = standing if standing in (DEAD, UNEVEN) else DEAD
    assert step(state, now={"answers": False}).standing == expected
    # Off the line what holds a point rests, and what does not stays as it is.
    off = step(state, now={"on_the_line": False}).standing
    assert off == (standing if standing in (DEAD, UNEVEN) else RESTS)


def test_a_point_is_held_by_five_of_ten() -> None:
    assert [n for n in range(len(POINT_TEXTS)) if acts(n)] == [
        HOLDS, ABOVE_BAND, BELOW_BAND, TRIES, GIVES_WAY,
    ]  # fmt: skip
    assert len(set(POINT_TEXTS)) == 10
    words = {
        LINE_ONLY: "the line alone", HOLDS: "held", ABOVE_BAND: "above the band",
        BELOW_BAND: "below the band", NO_BRAKE: "no brake", DEAD: "does not answer",
        UNEVEN: "pulls to one side", TRIES: "trying it", GIVES_WAY: "gives way",
        RESTS: "not held yet",
    }  # fmt: skip
    for standing, text in words.items():
        assert text in POINT_TEXTS[standing]


@pytest.mark.parametrize(("sink_mps", "standing"), [(0.019, NO_BRAKE), (0.021, HOLDS)])
def test_a_brake_that_adds_less_than_two_centimetres_a_second_holds_nothing(
    sink_mps: float, standing: int
) -> None:
    assert step(gains=GAINS._replace(sink=sink_mps / SPEED_MPS**3)).standing == standing
    assert step(gains=GAINS._replace(sink=nan)).standing == NO_BRAKE


@pytest.mark.parametrize("watch", ["trial", "shake"])
def test_a_brake_that_was_found_not_to_act_is_dead(watch: str) -> None:
    for found, standing in ((DOES_NOT, DEAD), (NOTHING, HOLDS)):
        watched = getattr(AT_POINT, watch)._replace(found=found)
        assert step(AT_POINT._replace(**{watch: watched})).standing == standing


def test_a_brake_that_pulls_to_one_side_ends_it() -> None:
    """An aileron of 0.3 of a brake that has moved by 0.2: nothing is left of it that is chance."""
    even = EvenState(
        brake=0.4, aileron=0.0, brake_2=0.04, both=0.012, aileron_2=0.0036, watched=1.0
    )
    assert pulls(even)
    assert step(AT_POINT._replace(even=even)).standing == UNEVEN
    assert step(AT_POINT._replace(even=even._replace(both=0.0))).standing == HOLDS


@pytest.mark.parametrize(
    ("before", "ended", "standing"),
    [
        (HOLDS, 0.81, BELOW_BAND), (HOLDS, 0.79, HOLDS), (HOLDS, -0.81, ABOVE_BAND),
        (HOLDS, -0.79, HOLDS), (BELOW_BAND, 0.51, BELOW_BAND), (BELOW_BAND, 0.49, HOLDS),
        (ABOVE_BAND, -0.51, ABOVE_BAND), (ABOVE_BAND, -0.49, HOLDS),
        (BELOW_BAND, -0.81, ABOVE_BAND), (TRIES, 0.6, HOLDS), (GIVES_WAY, -0.6, HOLDS),
    ],
)  # fmt: skip
def test_four_fifths_at_an_end_are_outside_the_band_and_a_half_is_inside_again(
    before: int, ended: float, standing: int
) -> None:
    state = AT_POINT._replace(standing=before, ended=ended)
    assert step(state, dt_s=1e-9).standing == standing


def test_while_it_fades_in_it_rests() -> None:
    state = step(AT_POINT._replace(weight=0.5, brake=0.2))
    assert (state.standing, state.weight) == (RESTS, 0.505)
    assert state.brake == pytest.approx(0.505 * 0.4)
    assert (state.even, state.trial, state.shake) == (AT_POINT.even, NOT_TRIED, AT_POINT.shake)
    full = step(AT_POINT._replace(weight=0.998))
    assert (full.standing, full.weight) == (HOLDS, 1.0)


@pytest.mark.parametrize(
    ("along_m", "blocked", "fraction"), [(3.0, 1, 1.0), (-3.0, -1, -1.0), (0.0, 0, 0.0)]
)
def test_the_fraction_at_an_end_and_the_mean_are_averages_over_three_seconds(
    along_m: float, blocked: int, fraction: float
) -> None:
    begun = AT_POINT._replace(ended=0.2, mean=0.3)
    state = step(begun, at(along_m, along_m), gains=GAINS._replace(kv=10.0))
    weight = DT_S / (3.0 + DT_S)
    assert state.ended == pytest.approx(0.2 + (fraction - 0.2) * weight)
    asked = 0.4 if blocked == 0 else 0.5 * (1.0 + blocked)
    assert state.mean == pytest.approx(0.3 + (asked - 0.3) * weight)


@pytest.mark.parametrize(
    ("bias", "rises", "room", "which"),
    [
        (0.97, 1, 1.0, 0), (0.985, 1, 1.0, 1), (0.985, -1, 1.0, 0), (0.57, 1, 0.6, 0),
        (0.585, 1, 0.6, 1), (0.03, -1, 1.0, 0), (0.015, -1, 1.0, -1), (0.015, 1, 1.0, 0),
    ],
)  # fmt: skip
def test_within_two_hundredths_of_an_end_that_it_goes_on_to_it_is_there(
    bias: float, rises: int, room: float, which: int
) -> None:
    state = step(vehicle=at(0.0, 1e-4 * rises), gains=GAINS._replace(bias=bias), now={"room": room})
    assert (state.ended > 0.0) - (state.ended < 0.0) == which


def test_at_an_end_that_blocks_it_the_integral_stands_still() -> None:
    assert step(vehicle=at(0.1), now={"blocked": 1}).pid.integral == 0.0
    assert step(vehicle=at(0.1), now={"blocked": -1}).pid.integral > 0.0
    assert step(vehicle=at(-0.1), now={"blocked": -1}).pid.integral == 0.0


def test_it_fades_out_in_proportion_and_forgets_all_but_how_it_stands() -> None:
    held = step(vehicle=at(0.1))
    out = step(held, gains=GAINS._replace(wanted=False))
    assert out == NO_POINT._replace(
        standing=LINE_ONLY, weight=1.0 - 0.5 * DT_S, brake=held.brake * (1.0 - 0.5 * DT_S)
    )
    last = step(out._replace(weight=0.004), gains=GAINS._replace(wanted=False))
    assert (last.weight, last.brake) == (0.0, 0.0)
    gone = step(last._replace(brake=0.3), gains=GAINS._replace(wanted=False))
    assert gone.brake == 0.0


@pytest.mark.parametrize("lost", ["x_m", "z_m", "velocity_x_mps", "climb_mps"])
def test_who_does_not_know_where_they_are_holds_nothing(lost: str) -> None:
    for value in (nan, inf):
        assert step(vehicle=at(0.0)._replace(**{lost: value})).standing == RESTS


# --- what is watched ----------------------------------------------------------------------------


def test_whether_it_pulls_is_watched_where_the_brake_is_where_it_is_wanted() -> None:
    for apart, watched in ((0.0049, True), (-0.0049, True), (0.0051, False), (-0.0051, False)):
        state = step(now={"brake": 0.4 + apart, "aileron": 0.1})
        assert (state.even != NOT_WATCHED) is watched
        if watched:  # the first is the mean
            assert state.even.brake == pytest.approx(0.4 + apart)
            assert state.even.aileron == 0.1


def test_with_accelerations_and_lift_it_is_shaken_and_else_tried() -> None:
    pressed = AT_POINT._replace(
        trial=NOT_TRIED._replace(pressed=0.1), shake=AT_POINT.shake._replace(pressed=0.1)
    )
    for inertial, lift, shaken in (
        (True, 0.051, True), (True, -0.051, True), (True, 0.049, False), (False, 0.3, False),
    ):  # fmt: skip
        state = step(pressed, now={"inertial": inertial}, aero=AERO._replace(CL_brake=lift))
        assert (state.shake.pressed > 0.09) is shaken
        assert (state.trial.pressed > 0.09) is not shaken


def test_a_shake_begins_so_far_in_that_it_goes_both_ways() -> None:
    """A fifth from either end where the law stands there, and as it is asked for elsewhere."""
    shaking = AT_POINT.shake._replace(on=True, climb_mps=0.0, time_s=0.0625)  # sin φ = 1
    for ended, along_m, asked in ((0.6, 3.0, 0.8), (-0.6, -3.0, 0.2), (0.4, 0.0, 0.4)):
        state = step(
            AT_POINT._replace(shake=shaking, ended=ended),
            at(along_m),
            gains=GAINS._replace(kv=10.0, kp_per_s=8.0, speed_max_mps=3.0),
            now={"inertial": True},
        )
        assert state.shake.shaken == pytest.approx(0.2)
        assert state.brake == pytest.approx(asked + 0.2)


@pytest.mark.parametrize("speed_mps", [8.0, 12.0])
def test_a_shake_is_recognised_by_the_lift_that_all_of_the_brake_takes(speed_mps: float) -> None:
    """0.5 rho V² S C_L / m, of which 0.88 is observed."""
    aero = AERO._replace(CL_brake=-0.3, mass_kg=0.8, wing_area_m2=0.2, air_density_kgpm3=1.2)
    shaking = AT_POINT._replace(shake=AT_POINT.shake._replace(on=True, climb_mps=0.0))
    rises = at(0.0)._replace(climb_mps=0.02)
    now = around(shaking)._replace(inertial=True)
    gains = GAINS._replace(sink=MOST_MPS / speed_mps**3)
    found = brake_step(
        gains, aero, shaking, TARGET, ETA, rises, airspeed_mps=speed_mps, around=now, dt_s=DT_S
    )
    lifts = 0.5 * 1.2 * speed_mps**2 * 0.2 * -0.3 / 0.8
    assert found.shake.rise == pytest.approx(0.02 / DT_S / lifts / 0.88)


def test_while_the_brake_is_tried_the_law_rests() -> None:
    trial = NOT_TRIED._replace(on=True, low=0.3)
    before = AT_POINT._replace(trial=trial, ended=0.9, mean=0.7, brake=0.3)
    state = step(before, at(0.2), now={"brake": 0.3})
    assert state.standing == TRIES
    assert (state.pid, state.ended, state.mean) == (before.pid, 0.9, 0.7)
    assert state.brake == pytest.approx(0.3)
    assert state.trial.time_s == pytest.approx(DT_S)


@pytest.mark.parametrize(("apart", "goes_on"), [(0.049, True), (-0.049, True), (0.051, False)])
def test_a_brake_that_is_held_elsewhere_ends_its_trial(apart: float, goes_on: bool) -> None:
    trial = NOT_TRIED._replace(on=True, low=0.3, time_s=0.5)
    before = AT_POINT._replace(trial=trial, brake=0.3)
    assert step(before, now={"brake": 0.3 + apart}).trial.on is goes_on


# --- giving way ---------------------------------------------------------------------------------


YIELDS = GAINS._replace(gives_way=True)


def yielding(mean: float, standing: int = GIVES_WAY, **changed: Any) -> BrakeState:
    found = {"trial": NOT_TRIED._replace(found=ACTS, rest_s=9.0)}
    return AT_POINT._replace(standing=standing, mean=mean, **{**found, **changed})


@pytest.mark.parametrize(
    ("mean", "clipped"), [(0.5, 0.2), (0.3, -0.2), (0.95, 1.0), (0.9, 1.0), (-0.2, -1.0)]
)
def test_it_gives_way_a_third_as_fast_as_the_law_moves(mean: float, clipped: float) -> None:
    """c clip(2 (mean b - bias)), with c a third of 0.3 m/s."""
    state = step(yielding(mean), gains=YIELDS)
    assert state.given_way_m == pytest.approx(0.1 * clipped * DT_S)
    again = step(state._replace(standing=GIVES_WAY, mean=mean), gains=YIELDS)
    assert again.given_way_m == pytest.approx(0.2 * clipped * DT_S)
    # The point that is flown goes there, along the line.
    assert state.x_m - TARGET.x_m == pytest.approx(state.given_way_m * cos(ETA))
    assert state.z_m - TARGET.z_m == pytest.approx(state.given_way_m * sin(ETA))


def test_it_gives_way_where_there_is_room_alone() -> None:
    for mean, shut, open_ in ((0.9, "up_free", "down_free"), (0.1, "down_free", "up_free")):
        assert step(yielding(mean), gains=YIELDS, now={shut: False}).given_way_m == 0.0
        assert step(yielding(mean), gains=YIELDS, now={open_: False}).given_way_m != 0.0


def test_another_order_is_flown_as_it_is_given() -> None:
    given = yielding(0.9, given_way_m=0.5)
    for other in ({"x_m": TARGET.x_m + 0.1}, {"z_m": TARGET.z_m + 0.1}):
        assert step(given, gains=YIELDS, target=TARGET._replace(**other)).given_way_m == 0.0
    assert step(given, gains=YIELDS._replace(along_m=0.2)).given_way_m == 0.0
    assert step(given, gains=GAINS).given_way_m == 0.0  # it is not to give way any more
    for standing in (HOLDS, BELOW_BAND, ABOVE_BAND, TRIES):  # it does not go back by itself
        assert step(given._replace(standing=standing), gains=YIELDS).given_way_m == 0.5


@pytest.mark.parametrize(
    ("before", "mean", "ended", "standing"),
    [
        (BELOW_BAND, 0.9, 0.81, GIVES_WAY), (BELOW_BAND, 0.9, 0.79, BELOW_BAND),
        (ABOVE_BAND, 0.1, -0.81, GIVES_WAY), (HOLDS, 0.9, 0.79, HOLDS),
        (GIVES_WAY, 0.51, 0.0, GIVES_WAY), (GIVES_WAY, 0.49, 0.0, HOLDS),
        (GIVES_WAY, 0.29, 0.0, GIVES_WAY), (GIVES_WAY, 0.31, 0.0, HOLDS),
    ],
)  # fmt: skip
def test_it_begins_outside_the_band_and_ends_where_the_brake_is_near_its_bias(
    before: int, mean: float, ended: float, standing: int
) -> None:
    state = yielding(mean, before, ended=ended)
    assert step(state, gains=YIELDS, dt_s=1e-9).standing == standing


def test_it_gives_way_only_once_the_brake_was_found_to_act_and_is_to() -> None:
    outside = yielding(0.9, BELOW_BAND, ended=0.9)
    assert step(outside, gains=YIELDS, dt_s=1e-9).standing == GIVES_WAY
    assert step(outside, gains=GAINS, dt_s=1e-9).standing == BELOW_BAND
    unknown = outside._replace(trial=NOT_TRIED._replace(rest_s=9.0))
    assert step(unknown, gains=YIELDS, dt_s=1e-9).standing == BELOW_BAND
    shaken = unknown._replace(shake=unknown.shake._replace(found=ACTS))
    now = {"inertial": True}
    lifts = AERO._replace(CL_brake=-0.3)
    assert step(shaken, gains=YIELDS, dt_s=1e-9, now=now, aero=lifts).standing == GIVES_WAY
    for mean, shut in ((0.9, "up_free"), (0.1, "down_free")):
        stuck = outside._replace(mean=mean, ended=0.9 if mean > 0.4 else -0.9)
        end = BELOW_BAND if mean > 0.4 else ABOVE_BAND
        assert step(stuck, gains=YIELDS, dt_s=1e-9, now={shut: False}).standing == end


def test_a_line_leans_the_way_it_is_given() -> None:
    """The order is along the line as it is wanted."""
    level = TargetLine(1.0, 2.0, pi)
    state = step(gains=GAINS._replace(along_m=0.5), target=level)
    assert (state.ordered_x_m, state.ordered_z_m) == pytest.approx((0.5, 2.0))
    assert radians(105.0) == ETA
