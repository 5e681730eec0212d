"""Roll and heading on the linear model: against the textbook, and against their own poles."""

from __future__ import annotations

from math import degrees

import numpy as np
import pytest
from msgspec.structs import asdict, replace

from tgl_soar.analysis.lateral_model import BREAKS, lateral_loop
from tgl_soar.analysis.linear_model import (
    Loop,
    is_stable,
    margin,
    open_loop,
    poles,
    promised_gain_db,
    promised_phase_rad,
)
from tgl_soar.analysis.linear_plant import Condition, Periodic, without_idle
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.control.lateral_margin import disk_margins, sideways_flown
from tgl_soar.control.laws import laws_from
from tgl_soar.control.loop_margin import FLOOR
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
SENSORS = {"with accelerometers": Sensors(imu=MEMS_IMU), "without": USUAL_SENSORS}
IDEAL_SPEED_MPS = 8.5
GAINS = {"aileron": ("AIL_P", "AIL_I", "AIL_D"), "rudder": ("RUD_P", "RUD_D")}


def loop_of(
    changes: dict[str, float] | None = None,
    sensors: Sensors = SENSORS["with accelerometers"],
    delay_s: float = 0.0,
    speed_mps: float = IDEAL_SPEED_MPS,
) -> Loop:
    condition = Condition(
        model=MODEL,
        servo=servo_params(AIRFRAME.model),
        speed_mps=speed_mps,
        lean_rad=0.26,
        sensors=sensors,
        command_delay_s=delay_s,
    )
    known = VALUES.changed({"CMD_DELAY": delay_s, **(changes or {})})
    return lateral_loop(laws_from(known, SITE.frame()), condition)


def test_at_the_aileron_the_fast_loop_is_that_of_the_textbook() -> None:
    """L = effect (kp + ki / s + kd s) / (s (s + damping)) and the servo, from 20 to 40 rad/s: the
    dutch roll, at 6 rad/s, moves it by (6 / 20)² = 9 % at most.

    The command holds for a tick, 2.5 ms on average; the low-pass of the rate adds a little more.
    """
    airframe, model = AIRFRAME.airframe, AIRFRAME.model
    speed = IDEAL_SPEED_MPS
    force = 0.5 * model["air_density_kgpm3"] * speed**2 * airframe.wing_area_m2 * airframe.span_m
    effect = force / airframe.ixx_kgm2 * model["Cl_aileron"]
    damping = -force / airframe.ixx_kgm2 * model["Cl_p"] * 0.5 * airframe.span_m / speed
    radps = np.array([20.0, 30.0, 40.0])
    s = 1j * radps
    slower = VALUES["LAT_SPEED"] / speed
    law = slower * (VALUES["AIL_P"] + VALUES["AIL_I"] / s + slower * VALUES["AIL_D"] * s)
    lag = model["servo_lag_radps"]
    expected = effect * law / (s * (s + damping)) * lag / (s + lag)
    found = open_loop(loop_of(), "aileron", radps)
    assert np.abs(found) == pytest.approx(np.abs(expected), rel=0.1)
    late = -np.angle(found / expected) / radps
    assert np.all((late > 0.0) & (late < 0.010))


@pytest.mark.parametrize("sensors", SENSORS.values(), ids=SENSORS)
@pytest.mark.parametrize("at", BREAKS)
def test_the_classical_margins_are_at_least_what_the_disk_promises(
    sensors: Sensors, at: str
) -> None:
    found = margin(loop_of(sensors=sensors), at)
    assert 0.5 < found.alpha < 2.0
    assert found.gain_up_db >= promised_gain_db(found.alpha)
    assert found.gain_down_db <= -promised_gain_db(found.alpha)
    assert found.phase_deg >= degrees(promised_phase_rad(found.alpha))


@pytest.mark.parametrize("at", BREAKS)
def test_the_loop_is_unstable_beyond_its_gain_margin_and_not_before(at: str) -> None:
    """The law's gains scaled together are the gain of the loop that is opened there."""
    up = 10.0 ** (margin(loop_of(delay_s=0.04), at).gain_up_db / 20.0)
    for factor, stable in ((0.97 * up, True), (1.03 * up, False)):
        changes = {name: factor * VALUES[name] for name in GAINS[at]}
        assert is_stable(loop_of(changes, delay_s=0.04)) == stable


def test_an_aircraft_in_the_middle_comes_back_to_it() -> None:
    """The slowest pole is the bank's integral, SIDE_S or so; then the way to the waypoint."""
    slowest = poles(loop_of())[:2]
    assert np.all(slowest.real < -0.05)
    assert 1.0 / abs(slowest[0].real) == pytest.approx(VALUES["SIDE_P"] / VALUES["SIDE_I"], rel=0.3)


@pytest.mark.parametrize("sensors", SENSORS.values(), ids=SENSORS)
@pytest.mark.parametrize("delay_s", [0.005, 0.040])
@pytest.mark.parametrize("speed_mps", [7.6, 10.0, 14.0])
def test_from_slow_to_fast_air_on_any_link_there_is_a_margin(
    sensors: Sensors, delay_s: float, speed_mps: float
) -> None:
    """0.5 is the floor.  With gains that stand, 0.29 is left in fast air on the late link."""
    loop = loop_of(sensors=sensors, delay_s=delay_s, speed_mps=speed_mps)
    assert min(margin(loop, at).alpha for at in BREAKS) >= 0.5
    if speed_mps == 14.0 and delay_s == 0.040:
        stand = loop_of({"LAT_SPEED": 0.0}, sensors, delay_s, speed_mps)
        assert min(margin(stand, at).alpha for at in BREAKS) < 0.4


@pytest.mark.parametrize("sensors", SENSORS.values(), ids=SENSORS)
def test_old_attitudes_leave_a_margin(sensors: Sensors) -> None:
    """50 ms old: without the schedule's knowing of it, the delay would take half of the margin."""
    late = sensors._replace(attitude=sensors.attitude._replace(delay_s=0.05))
    if sensors.imu is not None:
        late = late._replace(imu=sensors.imu._replace(delay_s=0.05))
    loop = loop_of(sensors=late, delay_s=0.0075)
    assert min(margin(loop, at).alpha for at in BREAKS) >= 0.5


@pytest.mark.parametrize(
    ("changes", "fewer"),
    [({"SIDE_I": 0.0}, 1), ({"AIL_I": 0.0}, 1), ({"SIDE_I": 0.0, "AIL_I": 0.0}, 2)],
)
def test_an_integral_that_nothing_moves_is_no_state_of_the_loop(
    changes: dict[str, float], fewer: int
) -> None:
    """Its pole at 0 would be taken for a loop that does not settle.  The proportional and rate
    parts have a margin, and not a smaller one at the aileron without the integrals' lag."""
    whole, without = loop_of(), loop_of(changes)
    assert len(whole.system.a[0]) - len(without.system.a[0]) == fewer
    assert is_stable(without)
    assert np.max(poles(without).real) < -0.05
    assert margin(without, "aileron").alpha >= margin(whole, "aileron").alpha - 0.01
    assert margin(without, "rudder").alpha > 0.5


def test_an_integral_that_is_used_stays_a_state_however_slow() -> None:
    slow = loop_of({"SIDE_I": 1e-4, "AIL_I": 1e-4})
    assert len(slow.system.a[0]) == len(loop_of().system.a[0])
    assert np.max(poles(slow).real) > -0.01


def test_what_nothing_moves_is_left_out_and_what_grows_is_not() -> None:
    """Three states: one is driven, one is held, one grows by itself; two ticks, in only one of
    which the first is driven."""
    a = np.diag([0.9, 1.0, 1.1])
    a[0, 1] = 0.3
    b = np.array([[1.0], [0.0], [0.0]])
    c, d = np.array([[1.0, 2.0, 3.0]]), np.zeros((1, 1))
    kept = without_idle(Periodic([a, a], [b, 0.0 * b], [c, c], [d, d]))
    for each in kept.a:
        assert each.tolist() == [[0.9, 0.0], [0.0, 1.1]]
    assert kept.b[0].tolist() == [[1.0], [0.0]]
    assert kept.c[1].tolist() == [[1.0, 3.0]]
    for into in ([0.0 * b[:1], b[:1]], [b[:1], 0.0 * b[:1]]):  # in one tick alone
        driven = without_idle(Periodic([np.eye(1)] * 2, into, [c[:, :1]] * 2, [d] * 2))
        assert len(driven.a[0]) == 1


@pytest.mark.parametrize("speed_mps", [7.6, 9.25, 10.6])  # to the fastest that is asked for
def test_the_rule_on_board_knows_what_the_roll_damps_of_the_yaw(speed_mps: float) -> None:
    """A servo of 80 ms and a link of 40, the yaw inertia and C_nr less by 30 %, C_nβ more: what is
    left of the rudder's damping is little, and the nose's own, by way of the roll (C_lr, C_lβ and
    C_np), is what holds the margin.  Without these the rule would refuse it."""
    model = AIRFRAME.model
    nimble = replace(
        AIRFRAME,
        airframe=replace(AIRFRAME.airframe, izz_kgm2=0.7 * AIRFRAME.airframe.izz_kgm2),
        model={
            **model,
            "servo_lag_radps": 1.0 / 0.080,
            "Cn_beta": 1.3 * model["Cn_beta"],
            "Cn_r": model["Cn_r"] / 1.3,
        },
    )
    values = load_parameters(nimble, AIRFRAME_PATH, SITE, SITE_PATH).changed({"CMD_DELAY": 0.040})
    laws = laws_from(values, SITE.frame())
    flown = aircraft_model(asdict(nimble.airframe), nimble.model)
    condition = Condition(
        model=flown,
        servo=servo_params(nimble.model),
        speed_mps=speed_mps,
        lean_rad=0.26,
        sensors=SENSORS["with accelerometers"],
        command_delay_s=0.040,
    )
    alpha = margin(lateral_loop(laws, condition), "rudder").alpha
    late_s, known = values["DYN_SERVO"] + values["CMD_DELAY"], lateral_dynamics(nimble)
    alone = known._replace(roll_of_yaw_per_s=0.0, roll_of_slip_per_s2=0.0, yaw_of_roll_per_s=0.0)
    rule, without = (
        disk_margins(sideways_flown(laws, each, late_s, speed_mps, True))[1]
        for each in (known, alone)
    )
    assert rule == pytest.approx(alpha, abs=0.1)
    assert rule >= FLOOR
    assert without < rule - 0.1
    assert without < FLOOR
