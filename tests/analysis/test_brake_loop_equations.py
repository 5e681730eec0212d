"""The loops that hold a point: the line's against the linear model of pitch, the brake's against
what its gains make of the loop, and the formulas on small matrices."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin

import numpy as np
import pytest

from tgl_soar.analysis.brake_loop import (
    FREQUENCIES_RADPS,
    BrakeMargin,
    _disk,
    _is_stable,
    _loop,
    _parts,
    brake_margin,
)
from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import close_loop, margin
from tgl_soar.analysis.linear_plant import Condition, linear_plant
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftModel, braked
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.sim.world import flown_aircraft

PATH, SITE = shipped("airframes/eclipson_c_spoilers.toml"), shipped("sites/tunnel.toml")
GRADIENT = (0.11, 0.76, 0.76, -0.75)  # at the tunnel's place b
DT_S = 0.005


@lru_cache(maxsize=16)
def laws(**changed: float) -> Laws:
    airframe, site = load_airframe(PATH), load_site(SITE)
    values = load_parameters(airframe, PATH, site, SITE).changed({"TGL_HOLD": 1.0, **changed})
    return laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics())


def condition(lean_deg: float = 15.0, delay_s: float = 0.01, imu: bool = True) -> Condition:
    """Attitudes are as old as the accelerations: not at all."""
    airframe = load_airframe(PATH)
    model = flown_aircraft(airframe)
    assert isinstance(model, AircraftModel)
    late = USUAL_SENSORS.attitude._replace(rate_hz=200.0, delay_s=0.0)
    return Condition(
        model=model,
        servo=servo_params(airframe.model)._replace(delay_s=0.0),
        speed_mps=9.0,
        lean_rad=radians(lean_deg),
        sensors=Sensors(attitude=late, imu=MEMS_IMU if imu else None),
        command_delay_s=delay_s,
        gradient_per_s=GRADIENT,
    )


@lru_cache(maxsize=16)
def found(lean_deg: float = 15.0, delay_s: float = 0.01, **changed: float) -> BrakeMargin:
    return brake_margin(laws(**changed), condition(lean_deg, delay_s))


@pytest.mark.parametrize(("lean_deg", "delay_s"), [(15.0, 0.01), (30.0, 0.01), (15.0, 0.02)])
def test_the_lines_loop_is_that_of_the_linear_model_with_half_of_the_brake(
    lean_deg: float, delay_s: float
) -> None:
    """Gains are scheduled at the horizontal airspeed here, at the airspeed there: 1 % apart."""
    there = condition(lean_deg, delay_s)
    there = there._replace(model=braked(there.model, 0.5))
    loop = close_loop(linear_plant(there), linear_controller(laws(), there))
    assert found(lean_deg, delay_s).line_alpha == pytest.approx(
        margin(loop, "elevator").alpha, rel=0.03
    )


def test_without_accelerations_the_gains_are_those_without() -> None:
    with_imu = found().line_alpha
    unused = brake_margin(laws(EST_IMU=0.0), condition())
    none = brake_margin(laws(), condition(imu=False))
    assert unused.line_alpha == pytest.approx(none.line_alpha, rel=1e-9)
    assert abs(none.line_alpha - with_imu) > 0.01


def test_a_command_waits_for_a_tick_at_least() -> None:
    at_once, one = (brake_margin(laws(), condition(delay_s=late)) for late in (0.0, DT_S))
    two = brake_margin(laws(), condition(delay_s=2.0 * DT_S))
    assert at_once == one
    assert two.elevator_alpha < one.elevator_alpha
    assert two.alpha < one.alpha


def test_a_brake_without_gains_leaves_the_elevators_loop_as_it_is() -> None:
    """Next to none: its own loop is far from −1 then, and crosses over nowhere."""
    weak = found(BRK_V=1e-3, BRK_P=1e-3, BRK_I=0.0)
    assert weak.elevator_alpha == pytest.approx(weak.line_alpha, rel=0.01)
    assert weak.alpha == pytest.approx(2.0, abs=0.1)
    assert weak.crossover_radps == 0.0


def test_more_gain_crosses_over_later_and_bears_less() -> None:
    values = laws()
    kv = values.brake.kv
    once, twice = found(), found(BRK_V=2.0 * kv)
    assert 0.5 < once.crossover_radps < twice.crossover_radps < 30.0
    assert twice.alpha < once.alpha
    assert found(BRK_V=5.0, BRK_P=10.0, BRK_I=10.0, delay_s=0.1).elevator_alpha == 0.0


def test_an_aircraft_without_a_brake_has_no_such_loop() -> None:
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    values = load_parameters(airframe, shipped("airframes/eclipson_c.toml"), load_site(SITE), SITE)
    plain = laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics())
    with pytest.raises(ValueError, match="no brake: this airframe has none, or the route does not"):
        brake_margin(plain, condition())


# --- the formulas -------------------------------------------------------------------------------


def test_an_open_loop_is_what_is_asked_for_of_what_was_done() -> None:
    """L = 0.5 / (z − 0.9), of negative feedback."""
    one = np.array([[1.0]])
    loop = _loop(0.9 * one, one, -0.5 * one, DT_S)
    assert loop == pytest.approx(0.5 / (np.exp(1j * FREQUENCIES_RADPS * DT_S) - 0.9))
    two = _loop(np.diag([0.9, 0.5]), np.array([[1.0], [2.0]]), np.array([[-0.5, 3.0]]), DT_S)
    z = np.exp(1j * FREQUENCIES_RADPS * DT_S)
    assert two == pytest.approx(0.5 / (z - 0.9) - 6.0 / (z - 0.5))


def test_frequencies_go_from_a_slow_drift_to_beyond_every_servo() -> None:
    assert FREQUENCIES_RADPS[[0, -1]] == pytest.approx([0.05, 200.0])
    ratios = FREQUENCIES_RADPS[1:] / FREQUENCIES_RADPS[:-1]
    assert ratios.max() < 1.03


@pytest.mark.parametrize(
    ("loop", "alpha"),
    [(-0.5, 2.0 / 3.0), (0.0, 2.0), (-2.0, 2.0 / 3.0), (1j, 2.0), (0.5 - 0.5j, 2.0 * 5.0**0.5)],
)
def test_the_disk_margin_of_one_point(loop: complex, alpha: float) -> None:
    """2 |1 + L| / |1 − L|; the least of all counts."""
    assert _disk(np.array([loop])) == pytest.approx(alpha)
    assert _disk(np.array([10.0j, loop, 20.0j])) == pytest.approx(min(alpha, 2.0))


@pytest.mark.parametrize(("size", "stable"), [(0.99, True), (1.0, True), (1.001, False)])
def test_a_loop_is_stable_that_does_not_grow(size: float, stable: bool) -> None:
    """What stands, stands by rounding: the line's place along itself, where the air is even."""
    turn = np.array([[cos(0.3), sin(0.3)], [-sin(0.3), cos(0.3)]])
    assert _is_stable(size * turn) is stable
    assert _is_stable(np.diag([0.5, -size])) is stable


def test_the_parts_of_a_jacobian_are_state_brake_elevator_and_what_is_asked() -> None:
    """Of six states: x, z and their rates along a line; the last row is the elevator asked for."""
    jacobian = np.arange(7.0 * 8.0).reshape(7, 8)
    parts = _parts(jacobian, 6, radians(100.0))
    assert parts.a.tolist() == jacobian[:6, :6].tolist()
    assert parts.brake.tolist() == jacobian[:6, 6:7].tolist()
    assert parts.elevator.tolist() == jacobian[:6, 7:].tolist()
    assert parts.gains.tolist() == jacobian[6:, :6].tolist()
    assert parts.through == jacobian[6, 6]
    c, s = cos(radians(100.0)), sin(radians(100.0))
    assert parts.along == pytest.approx(np.array([[c, s, 0, 0, 0, 0], [0, 0, c, s, 0, 0]]))
