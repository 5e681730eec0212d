"""Roll's and heading's rule on board against the linear model, and what it refuses."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians

import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.lateral_model import BREAKS, lateral_loop
from tgl_soar.analysis.linear_model import margin
from tgl_soar.analysis.linear_plant import Condition
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.lateral_dynamics import UNKNOWN
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.config.line_changes import LineChanges
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.control import loop_margin
from tgl_soar.control.lateral_margin import disk_margins, sideways_flown
from tgl_soar.control.laws import laws_from
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.loop_margin import (
    FLOOR,
    RINGS,
    WAY_STEP_M,
    lateral_margins,
    line_margins,
    margin_fault,
)
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.types import THEIRS

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
KNOWN = lateral_dynamics(AIRFRAME)
BOUNDS = LineBounds(lateral=KNOWN)
# As the elevator's rule (test_loop_margin.py): what a margin of 0.5 is known to anyway, 1 dB.
AGREES = 0.1


def both(
    changes: Mapping[str, float], speed: float, inertial: bool
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The margins at aileron and rudder by the rule and by the linear model."""
    values = VALUES.changed(changes)
    laws = laws_from(values, SITE.frame())
    condition = Condition(
        model=MODEL,
        servo=servo_params(AIRFRAME.model),
        speed_mps=speed,
        lean_rad=radians(15.0),
        sensors=Sensors(imu=MEMS_IMU) if inertial else USUAL_SENSORS,
        command_delay_s=values["CMD_DELAY"],
    )
    loop = lateral_loop(laws, condition)
    late_s = values["DYN_SERVO"] + values["CMD_DELAY"]
    rule = disk_margins(sideways_flown(laws, KNOWN, late_s, speed, inertial))
    return rule, tuple(margin(loop, at).alpha for at in BREAKS)


def raised(name: str, factor: float) -> dict[str, float]:
    return {name: factor * VALUES[name]}


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize("late_s", [0.0075, 0.04])
def test_with_shipped_gains_the_rule_and_the_model_have_margin(
    inertial: bool, late_s: float
) -> None:
    for speed in (7.8, 10.0, 14.0):
        rule, model = both({"CMD_DELAY": late_s}, speed, inertial)
        assert min(*rule, *model) > 0.6
        assert rule == pytest.approx(model, abs=AGREES)


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize(
    ("name", "factor"),
    [
        *(("AIL_P", 3.0), ("AIL_D", 3.0), ("RUD_D", 4.0), ("RUD_D", 10.0), ("RUD_P", 5.0)),
        *(("SIDE_P", 2.0), ("SIDE_I", 8.0), ("AIL_I", 8.0)),
    ],
)
def test_beside_the_floor_the_rule_agrees_with_the_model(
    name: str, factor: float, inertial: bool
) -> None:
    rule, model = both(raised(name, factor), 10.0, inertial)
    assert min(rule) == pytest.approx(min(model), abs=AGREES)


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize(("name", "factor"), [("AIL_P", 7.5), ("AIL_D", 8.0), ("SIDE_P", 4.0)])
def test_the_rule_knows_what_is_unstable(name: str, factor: float, inertial: bool) -> None:
    rule, model = both(raised(name, factor), 10.0, inertial)
    assert min(model) == 0.0
    assert min(rule) < RINGS


@pytest.mark.parametrize(
    "changes", [{"SIDE_P": 0.0, "SIDE_I": 0.0}, {"SIDE_I": 0.0}, {"AIL_I": 0.0}, {"RUD_P": 0.0}]
)
def test_a_loop_without_one_of_its_gains_is_not_taken_for_unstable(
    changes: dict[str, float],
) -> None:
    rule, _ = both(changes, 10.0, True)
    assert min(rule) > FLOOR


@pytest.mark.parametrize(
    ("name", "factor", "loop"),
    [("AIL_P", 7.5, "roll"), ("AIL_D", 8.0, "roll"), ("RUD_P", 10.0, "heading")],
)
def test_a_gain_that_swings_is_refused_in_flight_and_warned_of_on_the_ground(
    name: str, factor: float, loop: str
) -> None:
    changes = LineChanges(fault=BOUNDS.fault, ringing=BOUNDS.ringing)
    value = factor * VALUES[name]
    with pytest.raises(ParameterError, match=f"{name} = .*: no margin in {loop} at .*OP_FORCE 1"):
        changes.set(VALUES, name, value, flying=True)
    warned = changes.set(VALUES, name, value, flying=False)
    assert warned.warning.startswith(f"no margin in {loop} at ")


def test_a_gain_that_leaves_little_is_taken_in_flight_with_a_warning() -> None:
    changes = LineChanges(fault=BOUNDS.fault, ringing=BOUNDS.ringing, warning=BOUNDS.warning)
    taken = changes.set(VALUES, "AIL_P", 3.2 * VALUES["AIL_P"], flying=True)
    assert taken.values["AIL_P"] == pytest.approx(3.2 * VALUES["AIL_P"])
    assert taken.warning.startswith("little margin in roll at ")
    assert BOUNDS.fault(taken.values) == ""  # nor is it a reason not to engage
    assert changes.set(VALUES, "AIL_TRIM", 0.1, flying=True).warning == ""


def test_without_lateral_dynamics_or_by_another_s_loops_nothing_is_reported() -> None:
    swings = VALUES.changed(raised("AIL_P", 7.5))
    assert margin_fault(swings) == ""
    assert margin_fault(swings, lateral=UNKNOWN) == ""
    assert margin_fault(swings, lateral=KNOWN) != ""
    theirs = LineBounds(lateral=KNOWN, loops=THEIRS)
    assert theirs.fault(swings) == theirs.ringing(swings) == ""


def test_every_loop_is_named_once() -> None:
    """Two sets of gains, three speeds: the line's six, and roll and heading likewise."""
    names = [each.name for each in (*line_margins(VALUES), *lateral_margins(VALUES, KNOWN))]
    assert len(names) == len(set(names)) == 18
    without = VALUES.changed({"EST_IMU": 0.0})
    assert len(line_margins(without)) == 3
    assert len(lateral_margins(without, KNOWN)) == 6


def at_way(way_m: float, changes: Mapping[str, float] | None = None) -> ParameterSet:
    return VALUES.changed({"WPT_X": -5.5, "TGL_X": way_m - 5.5, **(changes or {})})


def test_moving_the_line_within_a_step_asks_the_model_nothing() -> None:
    """R from 6 m on: 6.0 and 6.49 are one step, 6.51 is the next."""
    loop_margin._lateral_margins.cache_clear()
    for way_m in (6.01, 6.3, 6.49):
        assert lateral_margins(at_way(way_m), KNOWN) == lateral_margins(at_way(6.01), KNOWN)
    assert loop_margin._lateral_margins.cache_info().misses == 1
    assert lateral_margins(at_way(6.51), KNOWN) != lateral_margins(at_way(6.49), KNOWN)
    assert loop_margin._lateral_margins.cache_info().misses == 2
    assert loop_margin._lateral_margins.cache_info().maxsize is not None


def test_an_aileron_gain_is_judged_again_on_the_same_line() -> None:
    first = lateral_margins(at_way(6.2), KNOWN)
    assert lateral_margins(at_way(6.2, raised("AIL_P", 3.0)), KNOWN) != first


def everything(values: ParameterSet) -> loop_margin._Alike:
    return loop_margin._Alike(values, loop_margin.LATERAL_NAMES)


@pytest.mark.parametrize("late_s", [0.0075, 0.04])
def test_alpha_hardly_moves_within_a_step_and_its_shortest_way_has_the_least(
    late_s: float,
) -> None:
    """By less of itself than V / R does, a tenth: the far end of each step, without keeping,
    beside what is kept for it."""
    for step in range(6, 60, 3):
        way_m = (step + 1) * WAY_STEP_M - 0.01
        values = at_way(way_m, {"CMD_DELAY": late_s})
        kept = lateral_margins(values, KNOWN)
        exact = loop_margin._lateral_margins.__wrapped__(everything(values), KNOWN)
        for near, far in zip(kept, exact, strict=True):
            if "heading" in near.name:  # the waypoint is too slow to be of any weight
                assert far.alpha == pytest.approx(near.alpha, abs=0.005)
            else:
                assert -0.001 <= far.alpha - near.alpha <= 0.1 * near.alpha


def test_a_spiral_that_grows_by_itself_is_no_instability_of_the_loop() -> None:
    """Without dihedral, and with twice the roll by yaw, the glide alone turns ever steeper; the
    bank's loop is hundreds of times faster."""
    alone = KNOWN._replace(roll_of_slip_per_s2=0.0, roll_of_yaw_per_s=2.0 * KNOWN.roll_of_yaw_per_s)
    open_loops = VALUES.changed(
        dict.fromkeys(("AIL_P", "AIL_I", "AIL_D", "RUD_P", "RUD_D", "SIDE_P", "SIDE_I"), 0.0)
    )
    laws, closed = (laws_from(values, SITE.frame()) for values in (open_loops, VALUES))
    assert disk_margins(sideways_flown(laws, alone, 0.026, 9.0, True)) == (0.0, 0.0)
    assert min(disk_margins(sideways_flown(closed, alone, 0.026, 9.0, True))) > FLOOR


def test_an_aircraft_that_turns_its_tail_to_the_wind_is_unstable_by_one_root() -> None:
    """Its fin pulls the wrong way by as much, faster than the rudder can hold: the root that
    grows is a single one, half a turn less than of those that swing."""
    wrong = KNOWN._replace(yaw_stiffness_per_s2=-KNOWN.yaw_stiffness_per_s2)
    laws = laws_from(VALUES, SITE.frame())
    assert min(laws.roll.ki, laws.sideways.ki) > 0.0
    assert disk_margins(sideways_flown(laws, wrong, 0.026, 9.0, True)) == (0.0, 0.0)
    condition = Condition(
        model=MODEL._replace(Cn_beta=-MODEL.Cn_beta),
        servo=servo_params(AIRFRAME.model),
        speed_mps=9.0,
        lean_rad=radians(15.0),
        sensors=Sensors(imu=MEMS_IMU),
        command_delay_s=0.0075,
    )
    assert margin(lateral_loop(laws, condition), BREAKS[0]).alpha == 0.0


def test_an_integral_too_slow_for_the_sweep_is_not_taken_for_a_growing_root() -> None:
    slow = {"AIL_I": 1e-4 * VALUES["AIL_P"], "SIDE_I": 0.0}
    assert min(both(slow, 10.0, True)[0]) > FLOOR


def test_a_line_far_from_its_waypoint_is_judged_too() -> None:
    far = VALUES.changed({"WPT_X": -2000.0, "TGL_X": 500.0})
    assert min(lateral_margins(far, KNOWN)).alpha > FLOOR
