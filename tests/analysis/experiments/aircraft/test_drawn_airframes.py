"""Drawn airframes by the equations of their docstring: what was drawn is worked out again from the
figures of the file, and each figure from it."""

from __future__ import annotations

from functools import cache
from math import isclose, pi, sqrt
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from tgl_soar.analysis.experiments.aircraft import drawn_airframes as module
from tgl_soar.analysis.experiments.aircraft.drawn_airframes import DrawnAirframe, drawn_airframe
from tgl_soar.config.files import load_airframe, shipped

USUAL = load_airframe(shipped("airframes/eclipson_c.toml"))
G, DENSITY = 9.80665, 1.225
# Within which each is drawn.
RANGES = {
    "span_m": (0.8, 3.0), "loading_npm2": (20.0, 60.0), "aspect": (5.5, 11.0),
    "servo_s": (0.015, 0.060), "best_lift": (0.62, 0.78), "best_ratio": (5.5, 9.0),
    "camber": (0.15, 0.35), "stall_rad": (0.17, 0.22), "tail_arm": (2.7, 3.6),
    "tail_volume": (0.40, 0.60), "static_margin": (0.06, 0.16), "elevator": (0.16, 0.26),
    "gyration": (0.85, 1.15),
}  # fmt: skip


class Again(NamedTuple):
    """What was drawn, by the file's figures."""

    span_m: float
    loading_npm2: float
    aspect: float
    servo_s: float
    best_lift: float
    best_ratio: float
    camber: float
    stall_rad: float
    tail_arm: float
    tail_volume: float
    static_margin: float
    elevator: float
    gyration: float


def again(drawn: DrawnAirframe) -> Again:
    bench, model = drawn.airframe.airframe, drawn.airframe.model
    arm = -model["Cm_elevator"] / model["CL_elevator"]  # in chords
    tail = -model["Cm_q"] / (2.0 * arm)  # a_t V_H
    return Again(
        span_m=bench.span_m,
        loading_npm2=bench.mass_kg * G / bench.wing_area_m2,
        aspect=bench.span_m**2 / bench.wing_area_m2,
        servo_s=1.0 / model["servo_lag_radps"],
        best_lift=sqrt(model["CD0"] / model["CD_lift"]),
        best_ratio=0.5 / sqrt(model["CD0"] * model["CD_lift"]),
        camber=model["CL0"],
        stall_rad=model["stall_alpha_rad"],
        tail_arm=arm,
        tail_volume=tail / 3.5,
        static_margin=-model["Cm_alpha"] / model["CL_alpha"],
        elevator=model["Cm_elevator"] / tail,
        gyration=sqrt(bench.ixx_kgm2 / bench.mass_kg) / (0.124 * bench.span_m),
    )


@cache
def many() -> list[DrawnAirframe]:
    return [drawn_airframe(USUAL, (11, i)) for i in range(40)]


@pytest.mark.parametrize("name", RANGES)
def test_each_is_drawn_evenly_from_its_range(name: str) -> None:
    low, high = RANGES[name]
    found = np.array([getattr(again(drawn), name) for drawn in many()])
    slack = 1e-6 * high
    assert low - slack <= found.min() < low + 0.2 * (high - low)
    assert high - 0.2 * (high - low) < found.max() <= high + slack


def test_a_link_is_5_to_40_ms_late() -> None:
    late = [drawn.link_s for drawn in many()]
    assert 0.005 <= min(late) < 0.008
    assert 0.037 < max(late) <= 0.040


@pytest.mark.parametrize("i", range(12))
def test_the_figures_follow_from_what_was_drawn(i: int) -> None:
    drawn = many()[i]
    bench, model, of = drawn.airframe.airframe, drawn.airframe.model, again(drawn)
    assert bench.chord_m == pytest.approx(bench.wing_area_m2 / of.span_m)
    slope = 6.0 / (1.0 + 6.0 / (pi * of.aspect))
    assert model["CL_alpha"] == pytest.approx(slope)
    arm_m = of.tail_arm * bench.chord_m
    k_y, k_z = (sqrt(each / bench.mass_kg) for each in (bench.iyy_kgm2, bench.izz_kgm2))
    assert k_y == pytest.approx(of.gyration * 0.256 * arm_m)
    assert k_z == pytest.approx(of.gyration * 0.166 * of.span_m)
    # A neutral elevator holds it a twentieth of lift above its best glide.
    neutral = (1.05 * of.best_lift - of.camber) / slope
    assert model["Cm0"] + model["Cm_alpha"] * neutral == pytest.approx(0.0, abs=1e-12)
    assert model["Cm_alpha"] < 0.0 < model["Cm0"]
    assert model["stall_alpha_negative_rad"] == -model["stall_alpha_rad"]
    assert (of.best_lift - of.camber) / slope <= of.stall_rad - 0.06
    assert model["gravity_mps2"] == pytest.approx(G)
    assert model["air_density_kgpm3"] == pytest.approx(DENSITY)
    assert model["servo_delay_s"] == 0.0
    best_mps = sqrt(2.0 * of.loading_npm2 / (DENSITY * of.best_lift))
    # The polar's last glide is one of a grid, up to 1.3 of the best's speed.
    assert drawn.airframe.polar.speed_max_mps == pytest.approx(1.3 * best_mps, rel=0.02)
    assert drawn.airframe.parameters == {}
    assert bench.name == f"drawn, {of.span_m:.2f} m, {of.loading_npm2:.0f} N/m²"


def test_no_wing_is_drawn_that_would_stall_at_its_best_glide(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside as many even draws of the same ranges: all those whose best glide is 0.06 rad below
    the stall are taken, and no others."""
    monkeypatch.setattr(module, "_airframe", lambda _usual, draw, _sides: draw)
    drawn = [cast("Any", drawn_airframe(USUAL, (3, i)).airframe) for i in range(600)]

    def room_rad(aspect: Any, lift: Any, camber: Any, stall_rad: Any) -> Any:
        """From the best glide's angle of attack to the stall's."""
        return stall_rad - (lift - camber) * (1.0 / 6.0 + 1.0 / (pi * aspect))

    room = np.array([room_rad(d.aspect, d.best_lift, d.camber, d.stall_rad) for d in drawn])
    assert 0.06 <= room.min() < 0.063
    even = np.random.default_rng(1).uniform(size=(4, 20_000))
    of = [RANGES[name] for name in ("aspect", "best_lift", "camber", "stall_rad")]
    wide = room_rad(
        *(low + (high - low) * each for (low, high), each in zip(of, even, strict=True))
    )
    taken = wide[wide >= 0.06]
    assert 0.9 < len(taken) / len(wide) < 0.99
    # Their mean is known to a twentieth of their spread.
    assert room.mean() == pytest.approx(taken.mean(), abs=0.2 * taken.std())


SIDES = ("Cl_beta", "Cl_p", "Cl_r", "Cl_aileron", "Cn_beta", "Cn_r", "Cn_rudder")


def test_each_lateral_figure_is_drawn_by_itself_about_the_shipped_one() -> None:
    factors = np.array(
        [[drawn.airframe.model[n] / USUAL.model[n] for n in SIDES] for drawn in many()]
    )
    assert np.all((factors >= 0.8 - 1e-9) & (factors <= 1.25 + 1e-9))
    assert np.all(factors.min(axis=0) < 0.86)
    assert np.all(factors.max(axis=0) > 1.19)
    together = np.abs(np.corrcoef(factors.T) - np.eye(len(SIDES)))
    assert together.max() < 0.5


def test_all_else_is_the_shipped_ones() -> None:
    model = many()[0].airframe.model
    drawn = {
        *SIDES, "gravity_mps2", "air_density_kgpm3", "CL0", "CL_alpha", "CL_elevator",
        "stall_alpha_rad", "stall_alpha_negative_rad", "CD0", "CD_lift", "Cm0", "Cm_alpha", "Cm_q",
        "Cm_elevator", "servo_lag_radps", "servo_delay_s",
    }  # fmt: skip
    assert set(model) == set(USUAL.model)
    for name in set(model) - drawn:
        assert isclose(model[name], USUAL.model[name]), name
