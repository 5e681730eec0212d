"""Doublets in a glide, and the aircraft that they identify."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.experiments.aircraft.identification import (
    AIRFRAME,
    logged,
    true_effect,
    true_period,
    truth,
)
from tgl_soar.analysis.identification import (
    HELD_OUT,
    IdentificationError,
    Identified,
    body_from,
    identify,
    short_period,
)
from tgl_soar.analysis.logs.gliding import MeanWind, longitudinal
from tgl_soar.analysis.manoeuvres import LongitudinalLog, manoeuvres
from tgl_soar.config.files import load_airframe
from tgl_soar.sim.glide_test import WIND_MPS, fly

DELAY_S = 0.0223  # no multiple of a step
DOUBLETS = 8


@lru_cache(maxsize=1)
def log() -> LongitudinalLog:
    ticks = list(fly(load_airframe(AIRFRAME), seed=5, servo_delay_s=DELAY_S, speeds_mps=(9.4,)))
    return longitudinal(logged(ticks), MeanWind(WIND_MPS, 0.0))


@lru_cache(maxsize=1)
def found() -> Identified:
    return identify(log(), truth()[1])


def test_every_doublet_is_found_and_nothing_else() -> None:
    assert len(manoeuvres(log())) == DOUBLETS
    assert len(found().held_out) == DOUBLETS // HELD_OUT
    assert len(found().manoeuvres) == DOUBLETS - DOUBLETS // HELD_OUT


def test_the_model_that_flew_is_found_again() -> None:
    model, body = truth()
    result = found()
    period, effect = true_period(model, body, result.airspeed_mps), true_effect(model, body, result)
    assert result.frequency.value == pytest.approx(period, rel=0.05)
    assert result.effectiveness.value == pytest.approx(effect, rel=0.07)
    assert result["delay"].value == pytest.approx(DELAY_S, abs=0.004)
    assert result["Cm_q"].value == pytest.approx(model.Cm_q, rel=0.15)
    assert result.explained > 0.95
    for estimate, true in ((result.frequency, period), (result["delay"], DELAY_S)):
        assert estimate.low <= true <= estimate.high
        assert estimate.high - estimate.low < 0.5 * true


def test_another_delay_is_told_apart() -> None:
    later = replace(log(), elevator=np.roll(log().elevator, -1))  # logged a step earlier
    result = identify(later, truth()[1])
    assert result["delay"].value == pytest.approx(found()["delay"].value + 0.01, abs=0.002)


def test_a_touch_of_the_stick_before_a_doublet_is_none() -> None:
    elevator = log().elevator.copy()
    begin = manoeuvres(log())[2].start
    elevator[begin - 100 : begin - 95] += 0.03  # a second before it: detected by both
    assert manoeuvres(replace(log(), elevator=elevator)) == manoeuvres(log())


@pytest.mark.parametrize("column", ["elevator", "pitch_rate_radps", "airspeed_mps"])
def test_what_was_not_measured_is_not_used(column: str) -> None:
    values = getattr(log(), column).copy()
    begin = manoeuvres(log())[2].start
    values[begin : begin + 20] = np.nan
    changes: dict[str, Any] = {column: values}
    assert len(manoeuvres(replace(log(), **changes))) == DOUBLETS - 1


def test_banked_or_stalled_manoeuvres_are_not_used() -> None:
    rows = manoeuvres(log())[1]
    banked, stalled = log().roll_rad.copy(), log().path_angle_rad.copy()
    banked[rows.start + 5] = 0.6
    stalled[rows.start + 5] = -0.6
    assert len(manoeuvres(replace(log(), roll_rad=banked))) == DOUBLETS - 1
    assert len(manoeuvres(replace(log(), path_angle_rad=stalled))) == DOUBLETS - 1


def test_without_accelerometers_the_uncertainty_is_larger_and_still_right() -> None:
    model, body = truth()
    result = identify(replace(log(), lift_force_mps2=None), body)
    assert result.frequency.value == pytest.approx(
        true_period(model, body, result.airspeed_mps), rel=0.1
    )
    assert result["CL_alpha"].standard_error > found()["CL_alpha"].standard_error


def test_a_log_without_doublets_says_how_to_fly_them() -> None:
    still = replace(log(), elevator=np.zeros_like(log().elevator))
    with pytest.raises(IdentificationError, match=r"0 manoeuvres found, 4 are needed.*doublet"):
        identify(still, truth()[1])
    no = np.zeros(3)
    assert (
        manoeuvres(
            LongitudinalLog(
                time_s=no,
                elevator=no,
                pitch_rad=no,
                pitch_rate_radps=no,
                roll_rad=no,
                airspeed_mps=no,
                path_angle_rad=no,
            )
        )
        == []
    )


def test_what_the_airframe_file_lacks_is_named() -> None:
    airframe = load_airframe(AIRFRAME)
    airframe_table = {"mass_kg": 0.7, "wing_area_m2": 0.18, "chord_m": 0.16}
    with pytest.raises(IdentificationError, match="iyy_kgm2"):
        body_from(airframe_table, airframe.model)


def test_the_short_period_is_that_of_its_matrix() -> None:
    model, body = truth()
    v = 9.0
    lift = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 / body.mass_kg
    moment = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 * body.chord_m / body.iyy_kgm2
    matrix = np.array(
        [
            [-lift * v * model.CL_alpha, 1.0],
            [moment * v * v * model.Cm_alpha, moment * v * 0.5 * body.chord_m * model.Cm_q],
        ]
    )
    root = np.linalg.eigvals(matrix)[0]
    frequency, damping = short_period(model.CL_alpha, model.Cm_alpha, model.Cm_q, body, v)
    assert frequency == pytest.approx(abs(root))
    assert damping == pytest.approx(-root.real / abs(root))
    assert np.isnan(short_period(model.CL_alpha, 5.0, model.Cm_q, body, v)[0])  # it has none
