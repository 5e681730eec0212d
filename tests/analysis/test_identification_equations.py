"""The model that identification flies, against the equations of its page, integrated otherwise.

A made-up aircraft flies doublets by scipy's integrator, with a servo of its own; its sensors are so
good that what is found is what flew.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import cos, sin
from typing import Any

import numpy as np
import pytest
from identified_aircraft import BODY, GRAVITY_MPS2, TRUE
from scipy.integrate import solve_ivp
from scipy.stats import t as student

from tgl_soar.analysis.identification import (
    BRAKE_NAMES,
    NAMES,
    IdentificationError,
    Identified,
    KnownAircraft,
    body_from,
    identify,
)
from tgl_soar.analysis.manoeuvres import LongitudinalLog

STEP_S = 0.01
DOUBLETS = 4
APART_S = 2.5
HELD_OUT = [3]  # every fourth
NOISE = 1e-3  # of the sensors: rad, rad/s, m/s²
# A step of the model is Heun's, a hundredth of a second: its error beside the exact solution.
CLOSE = 0.03


def speed(time_s: Any) -> Any:
    """The airspeed changes slowly, and is taken as it is measured."""
    return 9.0 + 0.3 * np.sin(0.4 * time_s)


def stick(time_s: Any) -> Any:
    phase = time_s % APART_S
    size = 0.1 + 0.02 * np.floor(time_s / APART_S)
    up = (phase >= 1.0) & (phase < 1.25)
    down = (phase >= 1.25) & (phase < 1.5)
    return np.where(up, size, 0.0) - np.where(down, size, 0.0)


def lever(time_s: Any) -> Any:
    """The brake is out in every other doublet, and moved while nothing else is."""
    return np.where((time_s / APART_S).astype(int) % 2 == 1, 0.5, 0.0)


def servo(time_s: Any, command: Any) -> Any:
    """Lag, and a rate that it does not exceed, by small steps of a thousandth of a second."""
    fine = np.arange(0.0, time_s[-1] + 2.0 * STEP_S, 0.001)
    held = np.floor((fine - TRUE["delay"]) / STEP_S + 1e-6).astype(int)  # until the next one
    later = command[np.clip(held, 0, len(command) - 1)]
    stands = np.empty_like(fine)
    at = later[0]
    for i, wanted in enumerate(later.tolist()):
        stands[i] = at
        rate = BODY.servo_lag_radps * (wanted - at)
        at += 0.001 * min(max(rate, -BODY.servo_rate_per_s), BODY.servo_rate_per_s)
    return fine, stands


@lru_cache(maxsize=2)
def flown(brake: bool = False) -> LongitudinalLog:
    time = np.arange(0.0, DOUBLETS * APART_S + 0.5, STEP_S)
    fine, elevator = servo(time, stick(time))
    out = servo(time, lever(time))[1] if brake else np.zeros_like(fine)
    pressure = 0.5 * BODY.air_density_kgpm3 * BODY.wing_area_m2

    def lift(alpha: float, t: float) -> float:
        d, b = np.interp(t, fine, elevator), np.interp(t, fine, out)
        return float(
            TRUE["CL0"] + TRUE["CL_alpha"] * alpha + TRUE["CL_elevator"] * d + TRUE["CL_brake"] * b
        )

    def change(t: float, state: Any) -> list[float]:
        alpha, q, theta = state
        d, b, v = np.interp(t, fine, elevator), np.interp(t, fine, out), float(speed(t))
        gravity = GRAVITY_MPS2 / v * cos(theta - alpha)
        alpha_dot = q - pressure * v / BODY.mass_kg * lift(alpha, t) + gravity
        moment = (
            TRUE["Cm0"]
            + TRUE["Cm_alpha"] * sin(alpha)
            + TRUE["Cm_elevator"] * d
            + TRUE["Cm_brake"] * b
            + TRUE["Cm_q"] * BODY.chord_m / (2.0 * v) * q
        )
        return [alpha_dot, pressure * v * v * BODY.chord_m / BODY.iyy_kgm2 * moment, q]

    start = [0.04, 0.0, -0.03]
    done = solve_ivp(change, (0.0, time[-1]), start, t_eval=time, max_step=0.02, rtol=1e-6)
    alpha, q, theta = done.y
    coefficient = np.array([lift(a, t) for a, t in zip(alpha, time, strict=True)])
    noise = NOISE * np.random.default_rng(4).standard_normal((4, len(time)))
    return LongitudinalLog(
        time_s=time,
        elevator=stick(time),
        pitch_rad=theta + noise[0],
        pitch_rate_radps=q + noise[1],
        roll_rad=np.zeros_like(time),
        airspeed_mps=speed(time),
        path_angle_rad=theta - alpha + noise[2],
        lift_force_mps2=pressure * speed(time) ** 2 / BODY.mass_kg * coefficient + noise[3],
        brake=lever(time) if brake else None,
    )


@lru_cache(maxsize=2)
def found(brake: bool = False) -> Identified:
    return identify(flown(brake), BODY)


@pytest.mark.parametrize("name", NAMES)
def test_what_flew_is_found(name: str) -> None:
    result = found()[name]
    size = {"delay": 0.1, "Cm0": 0.1}.get(name, abs(TRUE[name]))
    assert result.value == pytest.approx(TRUE[name], abs=CLOSE * size)
    assert result.name == name
    assert result.low < result.value < result.high


@pytest.mark.parametrize("name", [*NAMES, *BRAKE_NAMES])
def test_what_flew_with_a_brake_is_found(name: str) -> None:
    result = found(True)[name]
    size = {"delay": 0.1, "Cm0": 0.1, "CL_elevator": 0.3}.get(name, abs(TRUE[name]))
    assert result.value == pytest.approx(TRUE[name], abs=2.0 * CLOSE * size)
    assert found(True).no_brake == ""


def test_without_a_brake_nothing_is_reported_of_one() -> None:
    assert [each.name for each in found().derivatives] == [*NAMES]
    assert [each.name for each in found(True).derivatives] == [*NAMES, *BRAKE_NAMES]
    assert found().no_brake == "the log holds no brake"


def test_units_are_those_of_the_equations() -> None:
    units = {each.name: each.unit for each in found(True).derivatives}
    with_unit = {"CL_alpha": "1/rad", "Cm_alpha": "1/rad", "delay": "s"}
    assert units == dict.fromkeys((*NAMES, *BRAKE_NAMES), "") | with_unit
    result = found()
    derived = (result.frequency, result.damping, result.effectiveness, result.response_delay)
    assert [each.unit for each in derived] == ["rad/s", "", "rad/s²", "s"]
    assert [each.name for each in derived] == ["frequency", "damping", "effectiveness", "response"]


def test_the_short_period_is_that_of_the_linear_equations() -> None:
    """Eigenvalues of the equations' own derivatives, at the speed that is reported."""
    result = found()
    v, s, c = result.airspeed_mps, BODY.wing_area_m2, BODY.chord_m
    assert v == pytest.approx(9.0, abs=0.3)
    q_bar = 0.5 * BODY.air_density_kgpm3 * v * v
    z_a = -q_bar * s / (BODY.mass_kg * v) * TRUE["CL_alpha"]
    m_a = q_bar * s * c / BODY.iyy_kgm2 * TRUE["Cm_alpha"]
    m_q = q_bar * s * c / BODY.iyy_kgm2 * c / (2.0 * v) * TRUE["Cm_q"]
    root = np.linalg.eigvals(np.array([[z_a, 1.0], [m_a, m_q]]))[0]
    assert result.frequency.value == pytest.approx(abs(root), rel=CLOSE)
    assert result.damping.value == pytest.approx(-root.real / abs(root), rel=CLOSE)
    effect = q_bar * s * c / BODY.iyy_kgm2 * TRUE["Cm_elevator"]
    assert result.effectiveness.value == pytest.approx(effect, rel=CLOSE)
    late_s = TRUE["delay"] + 1.0 / BODY.servo_lag_radps
    assert result.response_delay.value == pytest.approx(late_s, abs=0.003)


def test_every_fourth_manoeuvre_is_held_out_and_explained() -> None:
    result = found()
    begins = [i * APART_S + 1.0 - 0.1 for i in range(DOUBLETS)]
    assert result.held_out == pytest.approx([begins[i] for i in HELD_OUT], abs=0.011)
    fitted = [begin for i, begin in enumerate(begins) if i not in HELD_OUT]
    assert result.manoeuvres == pytest.approx(fitted, abs=0.011)
    assert 0.995 < result.explained <= 1.0
    assert [fit.fitted for fit in result.fits] == [i not in HELD_OUT for i in range(DOUBLETS)]
    for fit, begin in zip(result.fits, begins, strict=True):
        assert fit.time_s[0] == pytest.approx(begin, abs=0.011)
        assert fit.time_s[-1] - fit.time_s[0] == pytest.approx(0.1 + 0.5 + 1.2, abs=0.03)
        rows = np.searchsorted(flown().time_s, fit.time_s)
        assert fit.elevator.tolist() == flown().elevator[rows].tolist()
        assert fit.pitch_rate_radps.tolist() == flown().pitch_rate_radps[rows].tolist()
        off = fit.model_pitch_rate_radps - fit.pitch_rate_radps
        assert np.max(np.abs(off)) < 0.05 * np.max(np.abs(fit.pitch_rate_radps))


def test_the_band_of_95_per_cent_is_students_with_three_degrees_of_a_manoeuvre() -> None:
    wide = student.ppf(0.975, 3 * (DOUBLETS - len(HELD_OUT)))
    for each in (*found().derivatives, found().frequency, found().response_delay):
        assert each.standard_error > 0.0
        assert each.high - each.value == pytest.approx(wide * each.standard_error, rel=1e-3)
        assert each.value - each.low == pytest.approx(wide * each.standard_error, rel=1e-3)


def test_the_delay_is_not_better_known_than_the_sticks_samples_tell_it() -> None:
    """Uniform within one of its samples: the twelfth of a square, beside the fit's own error."""
    rare_s = 0.04
    rare = identify(replace(flown(), elevator_step_s=rare_s), BODY)["delay"].standard_error
    fine = found()["delay"].standard_error
    assert rare**2 - fine**2 == pytest.approx((rare_s**2 - STEP_S**2) / 12.0, rel=1e-6)


def test_constant_errors_of_measurements_are_separated_from_the_aircraft() -> None:
    """Of rate and lift wholly; an angle of attack askew is another wing's, with the same slopes."""
    log, askew = flown(), 0.01
    assert log.lift_force_mps2 is not None
    wrong = replace(
        log,
        pitch_rate_radps=log.pitch_rate_radps + 0.02,
        lift_force_mps2=log.lift_force_mps2 + 0.3,
        path_angle_rad=log.path_angle_rad - askew,
    )
    result = identify(wrong, BODY)
    moved = {"CL0": -askew * TRUE["CL_alpha"], "Cm0": -askew * TRUE["Cm_alpha"]}
    for name in NAMES:
        expected = TRUE[name] + moved.get(name, 0.0)
        size = {"delay": 0.1, "Cm0": 0.1}.get(name, abs(TRUE[name]))
        assert result[name].value == pytest.approx(expected, abs=2.0 * CLOSE * size)


def test_two_doublets_are_too_few_whatever_the_brake_does() -> None:
    log = flown(True)
    elevator = np.where(log.time_s < 2 * APART_S, log.elevator, 0.0)
    with pytest.raises(IdentificationError, match="2 manoeuvres found, 4 are needed"):
        identify(replace(log, elevator=elevator), BODY)


def test_three_manoeuvres_are_enough_and_leave_none_to_check_with() -> None:
    log = flown()
    elevator = np.where(log.time_s < 3 * APART_S, log.elevator, 0.0)
    result = identify(replace(log, elevator=elevator, brake=np.full_like(elevator, 0.5)), BODY)
    assert len(result.manoeuvres) == 3
    assert result.held_out == ()
    assert np.isnan(result.explained)
    assert result.no_brake.startswith("the brake stays within 0.50 and 0.50: move it by 0.25")
    assert len(result.derivatives) == len(NAMES)


@pytest.mark.parametrize("name", KnownAircraft._fields)
@pytest.mark.parametrize("bad", [None, 0.0, -1.0, float("nan"), float("inf")])
def test_each_number_of_the_aircraft_is_needed_and_positive(name: str, bad: float | None) -> None:
    whole = BODY._asdict()
    airframe = {"mass_kg": 0.7, "wing_area_m2": 0.18, "chord_m": 0.16}
    model = {key: value for key, value in whole.items() if key not in airframe}
    assert body_from(airframe, model) == BODY
    table = airframe if name in airframe else model
    if bad is None:
        del table[name]
    else:
        table[name] = bad
    where = "airframe" if name in airframe and bad is not None else "model"
    with pytest.raises(IdentificationError, match=rf"{where}\.{name} = .*: needed, and positive"):
        body_from(airframe, model)
