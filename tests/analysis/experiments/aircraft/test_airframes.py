"""Aircraft of any size: how they are drawn, what is known of them, and which soar."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.experiments.aircraft.airframes import (
    QUICK_EFFORT,
    RMS_M,
    AirframeJob,
    BuiltAirframe,
    _claims,
    bench_file,
    build_and_soar,
    glide_log,
    identified,
    identified_errors,
    site_for,
)
from tgl_soar.analysis.experiments.aircraft.drawn_airframes import (
    FASTEST,
    AirframeRanges,
    DrawnAirframe,
    drawn_airframe,
)
from tgl_soar.analysis.logs.gliding import MeanWind
from tgl_soar.analysis.tuning.flights import DrawnFlight
from tgl_soar.config.files import airframe_from, load_airframe, shipped
from tgl_soar.control.found_gains import SETS
from tgl_soar.sim.aircraft import aircraft_model, glide_at
from tgl_soar.sim.glide_test import wind_of

USUAL = load_airframe(shipped("airframes/eclipson_c.toml"))


@cache
def forty() -> list[DrawnAirframe]:
    return [drawn_airframe(USUAL, (7, i)) for i in range(40)]


def test_they_are_of_every_size_and_all_glide() -> None:
    of = AirframeRanges()
    spans = [d.airframe.airframe.span_m for d in forty()]
    assert min(spans) < 1.1
    assert max(spans) > 2.7
    for drawn in forty():
        bench, known = drawn.airframe.airframe, drawn.airframe.all_parameters()
        loading = bench.mass_kg * 9.80665 / bench.wing_area_m2
        assert of.loading_npm2[0] <= loading <= of.loading_npm2[1]
        assert of.link_s[0] <= drawn.link_s <= of.link_s[1]
        assert of.best_ratio[0] <= known["DYN_GLIDE"] <= of.best_ratio[1]
        model = aircraft_model(asdict(bench), drawn.airframe.model)
        glide = glide_at(model, known["DYN_BEST"])
        assert abs(glide.elevator) < 0.5
        assert glide.alpha_rad < model.stall_alpha_rad - 0.04
        assert drawn.airframe.polar.speed_min_mps < known["DYN_BEST"]
        assert drawn.airframe.polar.speed_max_mps == pytest.approx(
            FASTEST * known["DYN_BEST"], rel=0.02
        )


def test_a_seed_is_one_airframe() -> None:
    assert drawn_airframe(USUAL, (7, 3)) == forty()[3]
    assert drawn_airframe(USUAL, (8, 3)).airframe != forty()[3].airframe


def test_the_bench_knows_mass_size_servo_and_latency_and_nothing_else() -> None:
    drawn = forty()[0]
    bench, own = airframe_from(bench_file(drawn), "bench.toml"), drawn.airframe
    for name, value in asdict(own.airframe).items():
        known = getattr(bench.airframe, name)
        assert known == (value if isinstance(value, str) else pytest.approx(value, rel=1e-5))
    same = {name for name, value in bench.model.items() if value == USUAL.model[name]}
    assert set(bench.model) - same == {"servo_lag_radps"}
    assert bench.all_parameters()["CMD_DELAY"] == pytest.approx(drawn.link_s, rel=1e-5)
    assert bench.polar == USUAL.polar
    assert "PITCH_TRIM" not in bench.parameters


def test_the_day_to_soar_is_found_for_each() -> None:
    for drawn in forty()[:4]:
        day, (x_m, z_m) = site_for(drawn.airframe)
        assert day.air is not None
        assert -24.0 < x_m < 0.0
        assert 8.0 < z_m < 24.0


def flown(rms_m: float, *, up: bool = True) -> DrawnFlight:
    return DrawnFlight(up=up, rms_e_rho_m=rms_m, duration_s=60.0, ended="" if up else "too low")


def built(failed: str = "", **flights: DrawnFlight) -> BuiltAirframe:
    return BuiltAirframe(
        name="one",
        failed=failed,
        frequency_error=0.0,
        effect_error=0.0,
        sink_error=0.0,
        alpha=dict.fromkeys(SETS, 0.55),
        flights=flights,
        duration_s=120.0,
    )


def test_who_soars_stays_up_near_the_line_with_both_sets_of_gains() -> None:
    good = built(fixes=flown(RMS_M), accelerometers=flown(0.01))
    assert good.soars
    for bad in (
        built(fixes=flown(RMS_M + 1e-4), accelerometers=flown(0.01)),
        built(fixes=flown(0.01, up=False), accelerometers=flown(0.01)),
        built(accelerometers=flown(0.01)),
        built("tune: no", fixes=flown(0.01), accelerometers=flown(0.01)),
    ):
        assert not bad.soars
        soaring, margins = _claims([good, bad])
        assert not soaring.holds
        assert soaring.measured == "1 of 2"
        assert margins.holds
    assert _claims([good])[0].holds
    assert not _claims([good._replace(alpha={"fixes": 0.49, "accelerometers": 0.6})])[1].holds
    assert not _claims([good._replace(alpha={})])[1].holds


@pytest.mark.long
def test_a_glide_tells_what_the_bench_does_not(tmp_path: Path) -> None:
    drawn = forty()[1]
    log = glide_log(drawn.airframe, 1, tmp_path)
    text = identified(bench_file(drawn), log, MeanWind(wind_of(drawn.airframe), 0.0))
    found = airframe_from(text, "identified.toml")
    assert max(map(abs, identified_errors(drawn.airframe, found))) < 0.05
    pitches = [a.all_parameters()["PITCH_TRIM"] for a in (drawn.airframe, found)]
    assert pitches[0] == pytest.approx(pitches[1], abs=1.0)


@pytest.mark.long
def test_one_goes_the_whole_way() -> None:
    """One generation of the search: what was flown before is anchored to this aircraft."""
    found = build_and_soar(AirframeJob((2026, 3), QUICK_EFFORT))
    assert found.failed == ""
    assert all(flight.up for flight in found.flights.values())


def test_what_fails_is_reported_with_its_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ValueError("nobody glided")

    monkeypatch.setattr("tgl_soar.analysis.experiments.aircraft.airframes.glide_log", fails)
    found = build_and_soar(AirframeJob((7, 0)))
    assert found.failed == "glide: nobody glided"
    assert not found.soars
