"""The pitch setpoint's rate in the elevator's derivative (eq. 16): how much of it, and when."""

from __future__ import annotations

from math import exp, inf, nan

import pytest

from tgl_soar.config.files import load_flight, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control import pitch_design
from tgl_soar.control.attitude import attitude_step, followed_rate
from tgl_soar.control.envelope import unlimited
from tgl_soar.control.found_gains import INERTIAL, SHIPPED
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.surface_loops import LoopsState, loops_begun, surface_gains, surfaces_step
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_SURFACES,
    THEIRS,
    Setpoints,
    SurfaceCommand,
    VehicleState,
)

DT_S = 0.005
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
GAINS = PidGains(
    kp=0.0,
    ki=0.0,
    kd=0.4,
    rate_filter_radps=100.0,
    integral_max=1.0,
    output_min=-1.0,
    output_max=1.0,
)
LEVEL = VehicleState._make([0.0] * len(VehicleState._fields))
UNSEEN = shipped("scenarios/unseen/glider.toml"), shipped("scenarios/unseen/jet.toml")


@pytest.mark.parametrize("weight", [0.25, 1.0])
@pytest.mark.parametrize("moved_rad", [0.001, -0.002])
def test_it_is_the_difference_of_two_setpoints_over_a_tick(weight: float, moved_rad: float) -> None:
    found = followed_rate(weight, 0.1 + moved_rad, 0.1, 2.0, DT_S)
    assert found == pytest.approx(weight * moved_rad / DT_S)


@pytest.mark.parametrize("jump_rad", [0.3, -0.3])
def test_a_setpoint_that_begins_elsewhere_slews_there(jump_rad: float) -> None:
    assert followed_rate(0.5, 0.1 + jump_rad, 0.1, 2.0, DT_S) == pytest.approx(
        1.0 if jump_rad > 0.0 else -1.0
    )


@pytest.mark.parametrize(
    ("weight", "before_rad", "dt_s"),
    [(0.0, 0.0, DT_S), (1.0, nan, DT_S), (1.0, inf, DT_S), (1.0, 0.0, 0.0)],
    ids=["no weight", "none before", "no number", "no time"],
)
def test_there_is_none_where_nothing_is_followed(
    weight: float, before_rad: float, dt_s: float
) -> None:
    assert followed_rate(weight, 0.1, before_rad, 2.0, dt_s) == 0.0


def test_the_derivative_acts_on_the_rate_of_the_error() -> None:
    """An aircraft that turns as its setpoint does is not damped."""
    _, terms = attitude_step(GAINS, PidState(0.0, 0.0), 0.0, 0.0, 0.3, 0.0, DT_S, 0, 0.3)
    assert terms.d == 0.0
    state, d = PidState(0.0, 0.0), []
    for _ in range(200):  # alone, it is kd times it, behind the filter
        state, terms = attitude_step(GAINS, state, 0.0, 0.0, 0.0, 0.0, DT_S, 0, 0.3)
        d.append(terms.d)
    assert d[-1] == pytest.approx(0.4 * 0.3)
    assert d[3] == pytest.approx(0.4 * 0.3 * (1.0 - 1.5**-4))  # a step of 0.5 of its time constant
    assert d[3] < 0.4 * 0.3 * (1.0 - exp(-2.5))


# --- in a tick -----------------------------------------------------------------------------------


def laws_with(weight: float, loops: int | None = None) -> Laws:
    changes = {"ELE_DSP_IMU": weight, "ELE_D_IMU": 0.2, "ELE_D": 0.2}
    values = ParameterSet().changed(changes)
    return laws_from(values, FRAME) if loops is None else laws_from(values, FRAME, loops=loops)


def derivative(
    laws: Laws, state: LoopsState, pitch_rad: float, imu_weight: float = 1.0
) -> tuple[LoopsState, float]:
    """Of a level aircraft whose setpoint is so: the state after a tick, and the elevator's D."""
    state, terms = surfaces_step(
        laws,
        surface_gains(laws, imu_weight, 9.0, 0.0),
        state,
        LEVEL,
        Setpoints(pitch_rad, 0.0, 0.0),
        brake=0.0,
        brake_max=1.0,
        braked=BrakeEffect(0.0, 0.0),
        stall_rad=inf,
        surfaces=NO_SURFACES,
        flies=True,
        dt_s=DT_S,
    )
    return state, terms.elevator.d


def begun() -> LoopsState:
    return loops_begun(unlimited(SurfaceCommand(0.0, 0.0, 0.0)), LEVEL)


def after_a_move(laws: Laws, imu_weight: float = 1.0) -> float:
    state, first = derivative(laws, begun(), 0.05, imu_weight)
    assert first == 0.0  # nothing was followed before
    return derivative(laws, state, 0.055, imu_weight)[1]


def test_a_part_of_it_moves_the_elevator_with_accelerometers() -> None:
    whole = after_a_move(laws_with(1.0))
    assert whole > 0.0
    assert after_a_move(laws_with(0.5)) == pytest.approx(0.5 * whole)
    assert after_a_move(laws_with(0.0)) == 0.0


def test_it_comes_and_goes_with_the_gains_of_accelerometers() -> None:
    laws = laws_with(1.0)
    assert after_a_move(laws, 0.0) == 0.0
    assert after_a_move(laws, 0.5) == pytest.approx(0.5 * after_a_move(laws))


def test_a_setpoint_that_stays_adds_nothing() -> None:
    laws = laws_with(1.0)
    state, _ = derivative(laws, begun(), 0.05)
    state, found = derivative(laws, state, 0.05)
    assert found == 0.0
    assert state.pitch_setpoint_rad == 0.05


def test_where_the_firmware_holds_the_pitch_nothing_is_followed() -> None:
    laws = laws_with(1.0, THEIRS)
    state, _ = derivative(laws, begun(), 0.05)
    assert state.pitch_setpoint_rad != state.pitch_setpoint_rad


# --- sought --------------------------------------------------------------------------------------


def test_gains_that_are_sought_have_it_and_a_fifth_less_e_rho(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At the same margins, and with no more elevator than a fortieth of its travel."""
    _, _, values = load_flight(*UNSEEN)
    assert values["ELE_DSP_IMU"] == pytest.approx(0.3)
    assert SHIPPED["ELE_DSP_IMU"] == 0.0
    judged = judge(values)
    monkeypatch.setattr(pitch_design, "SETPOINT_WEIGHT", 0.0)
    pitch_design._own_gains.cache_clear()
    _, _, without = load_flight(*UNSEEN)
    pitch_design._own_gains.cache_clear()
    assert without["ELE_DSP_IMU"] == 0.0
    damped = judge(without)
    assert judged.short <= 0.01
    assert damped.short <= 0.01
    assert judged.e_rho_m < 0.8 * damped.e_rho_m
    assert judged.elevator < 0.025
    for name in ("RHO_P", "RHO_D", "ELE_P", "ELE_D"):  # fixes have their own, and none of it
        assert values[name] == without[name]


def judge(values: ParameterSet) -> pitch_design.DesignCost:
    return pitch_design._DesignTask(values, INERTIAL).judged(values)
