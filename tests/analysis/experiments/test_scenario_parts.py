"""The parts of a scenario file: what each needs, what is refused, and what it becomes."""

from __future__ import annotations

from math import atan2, cos, degrees, radians, sin
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tgl_soar.air.gusts import BlendedField, ScaledField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.zeuc import Crossing, ZeucError, excess_gradient
from tgl_soar.analysis.experiments.scenario import (
    LineSpec,
    PositionSpec,
    Scenario,
    SensorSpec,
    SlopeSchedule,
    StartSpec,
    TimedChange,
    WindSchedule,
    contour_step,
    load_scenario,
    perpendicular_lean,
    place_at_speed_ratio,
    prepare,
    search_bounds,
    slide_at,
)
from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.config.site import GridAir, HillAir, JetAir
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.sim.sensors import AUTOPILOT_POSITION, MEMS_IMU, PITOT, READ_BACK
from tgl_soar.types import polar_slope

STATIC = load_scenario(shipped("scenarios/static.toml"))
TUNNEL = load_site(shipped("sites/tunnel.toml"))


@pytest.mark.parametrize(
    "given",
    [
        {}, {"x_m": 1.0}, {"z_m": 1.0}, {"x_m": 1.0, "z_m": 1.0, "speed_ratio": 0.9},
        {"speed_ratio": 0.9, "pivot": "a"}, {"x_m": 1.0, "pivot": "a"}, {"x_m": 1.0, "z_m": 2.0,
        "pivot": "a"},
    ],
)  # fmt: skip
def test_a_line_is_given_in_one_way_and_whole(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="a line needs x_m and z_m, or speed_ratio, or pivot"):
        LineSpec(**given)


def test_a_line_may_be_given_in_each_way() -> None:
    assert LineSpec(x_m=0.0, z_m=0.0).below_m == 0.0
    assert LineSpec(speed_ratio=0.9).lean_deg is None
    assert LineSpec(pivot="a", below_m=0.4).below_m == 0.4
    with pytest.raises(ValueError, match="below_m goes with pivot"):
        LineSpec(speed_ratio=0.9, below_m=0.1)


def test_changes_starts_and_drifts_need_what_they_go_with() -> None:
    with pytest.raises(ValueError, match="a change needs a line or parameters"):
        TimedChange(time_s=1.0)
    assert TimedChange(time_s=1.0, line="a").parameters == {}
    assert TimedChange(time_s=1.0, parameters={"RHO_P": 1.0}).line is None
    for given in ({"x_m": 1.0}, {"z_m": 1.0}):
        with pytest.raises(ValueError, match="a place needs both x_m and z_m"):
            StartSpec(**given)
    assert (StartSpec().downstream_m, StartSpec().up_m) == (0.3, 0.0)
    for drift in ({"drift_m": 1.0}, {"drift_up_m": 1.0}):
        with pytest.raises(ValueError, match="a drift needs noise_m above 0"):
            PositionSpec(rate_hz=50, delay_s=0.1, noise_m=0.0, **drift)
        assert PositionSpec(rate_hz=50, delay_s=0.1, noise_m=0.1, **drift)
    assert PositionSpec(rate_hz=50, delay_s=0.1, noise_m=0.0).drift_s == 300.0


def test_schedules_must_grow_in_time() -> None:
    for kind, name in ((WindSchedule, "mps"), (SlopeSchedule, "deg")):
        kind(times_s=[1.0, 2.0], **{name: [20.0, 21.0]})
        with pytest.raises(ValueError, match="increase"):
            kind(times_s=[2.0, 2.0], **{name: [20.0, 21.0]})


def test_a_position_becomes_the_simulations() -> None:
    spec = PositionSpec(
        rate_hz=20, delay_s=0.2, noise_m=0.3, bias_m=0.4, velocity_noise_mps=0.5, drift_m=0.6,
        drift_up_m=0.7, drift_s=80.0,
    )  # fmt: skip
    params = spec.as_params()
    assert params._asdict() == {
        "rate_hz": 20, "delay_s": 0.2, "noise_m": 0.3, "bias_m": 0.4, "velocity_noise_mps": 0.5,
        "gives_velocity": True, "drift_m": 0.6, "drift_up_m": 0.7, "drift_s": 80.0,
    }  # fmt: skip
    bare = PositionSpec(rate_hz=20, delay_s=0.2, noise_m=0.3).as_params()
    assert (bare.gives_velocity, bare.velocity_noise_mps) == (False, 0.0)
    assert (bare.bias_m, bare.drift_m, bare.drift_up_m) == (0.0, 0.0, 0.0)
    exact = PositionSpec(rate_hz=20, delay_s=0.2, noise_m=0.3, velocity_noise_mps=0.0).as_params()
    assert (exact.gives_velocity, exact.velocity_noise_mps) == (True, 0.0)


def test_only_the_sensors_that_are_named_are_carried() -> None:
    none = SensorSpec().as_sensors()
    assert none.position == AUTOPILOT_POSITION
    assert (none.imu, none.airspeed, none.surfaces) == (None, None, None)
    every = SensorSpec(imu=True, pitot=True, surfaces=True).as_sensors()
    assert (every.imu, every.airspeed, every.surfaces) == (MEMS_IMU, PITOT, READ_BACK)
    position = PositionSpec(rate_hz=20, delay_s=0.2, noise_m=0.3)
    assert SensorSpec(position=position).as_sensors().position == position.as_params()


def scenario(**given: Any) -> Scenario:
    made: dict[str, Any] = {
        "title": "t", "duration_s": 20.0, "first_line": "a", "site": "sites/tunnel.toml",
        "lines": {"a": LineSpec(speed_ratio=0.92), "b": LineSpec(pivot="a", below_m=0.4)},
    }  # fmt: skip
    return Scenario(**{**made, **given})


def test_a_scenario_begins_with_what_is_usual() -> None:
    made = scenario()
    assert made.airframe == "airframes/eclipson_c.toml"
    assert made.seeds == (1,)
    assert (made.parameters, made.changes, made.faults, made.unscored_s) == ({}, [], [], [])
    assert (made.start, made.sensors) == (StartSpec(), SensorSpec())
    assert made.model is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"site": None}, "either a site or an"),
        ({"air": JetAir(wind_mps=8.5, slope_deg=23.0)}, "either a site or an"),
        ({"seeds": ()}, "seeds: at least one is needed"),
        ({"first_line": "q"}, "no line named 'q'; there are a, b"),
        ({"changes": [TimedChange(time_s=1.0, line="q")]}, "no line named 'q'; there are a, b"),
        ({"lines": {"a": LineSpec(pivot="q")}}, "lines.a: pivot = 'q': must be a line that has no"),
        ({"lines": {"a": LineSpec(pivot="a")}}, "lines.a: pivot = 'a': must be a line that has no"),
        (
            {"changes": [TimedChange(time_s=20.0, line="b")]},
            "a change at 20 s is after the end, 20",
        ),
        ({"faults": ["nothing.dropout"]}, "nothing"),
    ],
)
def test_what_does_not_go_together_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        scenario(**given)


def test_a_change_just_before_the_end_or_of_parameters_alone_is_flown() -> None:
    changes = [TimedChange(time_s=19.9, line="b"), TimedChange(time_s=1.0, parameters={"RHO_P": 1})]
    assert scenario(changes=changes).changes == changes


# --- what it becomes ------------------------------------------------------------------------------


def whole(**given: Any) -> Scenario:
    return msgspec.structs.replace(STATIC, **given)


def test_a_line_by_its_point_stands_there_and_a_change_goes_to_its_line() -> None:
    lines = {
        "a": LineSpec(x_m=0.5, z_m=1.5, lean_deg=20.0),
        "b": LineSpec(x_m=0.7, z_m=1.7, lean_deg=15.0),
    }
    changes = [TimedChange(time_s=2.0, line="b", parameters={"TGL_X": 0.6})]
    prepared = prepare(whole(lines=lines, first_line="a", changes=changes, duration_s=9.0))
    target = prepared.lines["a"].target
    assert (target.x_m, target.z_m, degrees(target.eta_rad)) == pytest.approx((0.5, 1.5, 110.0))
    given = [prepared.values[name] for name in ("TGL_X", "TGL_Z", "TGL_LEAN")]
    assert given == pytest.approx([0.5, 1.5, 20.0])
    (change,) = prepared.changes
    assert change.time_s == 2.0
    # What is asked for beside a line counts more than the line's own.
    assert change.parameters["TGL_X"] == 0.6
    assert change.parameters["TGL_Z"] == pytest.approx(1.7)
    assert change.parameters["TGL_LEAN"] == pytest.approx(15.0)


def test_a_pivot_is_below_the_other_lines_crossing_along_that_line() -> None:
    lines = {"b": LineSpec(pivot="a", below_m=0.4, lean_deg=25.0), "a": LineSpec(speed_ratio=0.92)}
    prepared = prepare(whole(lines=lines, first_line="a", changes=[]))
    base, found = prepared.lines["a"], prepared.lines["b"].target
    assert base.crossing is not None
    eta = base.target.eta_rad
    assert found.x_m == pytest.approx(base.crossing.x_m - 0.4 * cos(eta))
    assert found.z_m == pytest.approx(base.crossing.z_m - 0.4 * sin(eta))
    assert degrees(found.eta_rad) == pytest.approx(115.0)


def test_a_start_is_beside_the_crossing_or_where_it_is_given() -> None:
    at = prepare(STATIC).lines[STATIC.first_line].crossing
    assert at is not None
    start = prepare(whole(start=StartSpec(downstream_m=0.2, up_m=-0.1))).site.start
    assert start is not None
    assert (start.x_m, start.z_m) == pytest.approx((at.x_m + 0.2, at.z_m - 0.1))
    start = prepare(whole(start=StartSpec(x_m=0.7, z_m=1.4))).site.start
    assert start is not None
    assert (start.x_m, start.z_m) == (0.7, 1.4)


def test_a_line_that_meets_no_contour_has_no_start_and_no_pivot() -> None:
    off = {"a": LineSpec(x_m=-0.4, z_m=0.2), "b": LineSpec(pivot="a")}
    with pytest.raises(ConfigError, match=r"lines\.b: line 'a' meets no contour to pivot about"):
        prepare(whole(lines=off, first_line="a", changes=[]))
    with pytest.raises(ConfigError, match=r"lines\.a: meets no stable place of the contour"):
        prepare(whole(lines={"a": off["a"]}, first_line="a", changes=[]))
    given = StartSpec(x_m=0.7, z_m=1.4)
    assert prepare(whole(lines={"a": off["a"]}, first_line="a", changes=[], start=given))


def test_a_slope_changes_in_a_jet_alone_and_blends_two() -> None:
    tilted = prepare(whole(slope=SlopeSchedule(times_s=[1.0, 3.0, 5.0], deg=[23.0, 24.0, 22.0])))
    field = tilted.field
    assert isinstance(field, BlendedField)
    low, high = field.first, field.second
    assert isinstance(low, SlopeJet)
    assert isinstance(high, SlopeJet)
    assert degrees(low.shape.slope_rad) == pytest.approx(22.0)
    assert degrees(high.shape.slope_rad) == pytest.approx(24.0)
    at = (0.8, 0.0, 1.8)
    for time_s, weight in ((1.0, 0.5), (3.0, 1.0), (5.0, 0.0)):
        wanted = [
            weight * h + (1.0 - weight) * lo
            for lo, h in zip(low.wind_at(*at, 0.0), high.wind_at(*at, 0.0), strict=True)
        ]
        assert field.wind_at(*at, time_s) == pytest.approx(wanted)
    still = prepare(whole(slope=SlopeSchedule(times_s=[1.0, 3.0], deg=[24.0, 24.0]))).field
    assert isinstance(still, SlopeJet)
    assert degrees(still.shape.slope_rad) == pytest.approx(24.0)
    speed = load_scenario(shipped("scenarios/speed.toml"))
    assert isinstance(speed.air, HillAir)
    with pytest.raises(ConfigError, match="slope: only the board in a jet has a slope"):
        prepare(msgspec.structs.replace(speed, slope=SlopeSchedule(times_s=[1.0], deg=[23.0])))


def test_a_wind_is_that_of_the_schedule() -> None:
    field = prepare(whole(wind=WindSchedule(times_s=[2.0, 4.0], mps=[8.5, 10.0]))).field
    assert isinstance(field, ScaledField)
    plain = prepare(STATIC).field
    at = (0.8, 0.0, 1.8)
    for time_s, mps in ((0.0, 8.5), (3.0, 9.25), (9.0, 10.0)):
        by = mps / plain.reference_wind_mps
        assert field.wind_at(*at, time_s) == pytest.approx(
            [by * v for v in plain.wind_at(*at, 0.0)]
        )


def test_a_contour_is_looked_for_about_what_makes_it() -> None:
    assert search_bounds(TUNNEL) == (-1.2, 2.4, 0.05, 3.3)
    hill = load_site(shipped("sites/hill.toml"))
    assert search_bounds(hill) == pytest.approx((-32.0, 0.0, 0.4, 32.0))
    grid = msgspec.structs.replace(
        TUNNEL,
        air=msgspec.convert(
            {"kind": "grid", "file": "x.npz", "wind_mps": 8.0}, GridAir, strict=False
        ),
    )
    sides = {"FENCE_X_MIN": -1.0, "FENCE_X_MAX": 2.0, "FENCE_Z_MIN": 0.1, "FENCE_Z_MAX": 3.0}
    fenced = msgspec.structs.replace(grid, parameters=sides)
    assert search_bounds(fenced) == (-1.0, 2.0, 0.1, 3.0)
    for name in sides:
        some = {k: v for k, v in sides.items() if k != name}
        with pytest.raises(ConfigError, match=rf"\[parameters\] lacks {name}$"):
            search_bounds(msgspec.structs.replace(grid, parameters=some))


def test_a_contours_cells_are_of_2_cm_or_a_160th_of_its_width() -> None:
    assert contour_step((-1.0, 1.0, 0.0, 1.0)) == 0.02
    assert contour_step((-1.6, 1.6, 0.0, 9.0)) == pytest.approx(0.02)
    assert contour_step((-10.0, 6.0, 0.0, 1.0)) == pytest.approx(0.1)


def test_a_place_by_speed_is_the_lowest_of_the_contour_and_stable() -> None:
    prepared = prepare(STATIC)
    field, polar, bounds = prepared.field, prepared.polar, search_bounds(prepared.site)
    best = best_glide_speed(polar)
    for ratio in (0.92, 0.98):
        x, z = place_at_speed_ratio(field, polar, bounds, ratio)
        assert field.wind_at(x, 0.0, z, 0.0)[0] / best == pytest.approx(ratio, abs=2e-3)
        assert excess_gradient(field, polar, x, z)[1] < 0.0
    with pytest.raises(
        ZeucError, match=r"speed_ratio = 1\.9: the contour has local winds of"
    ) as no:
        place_at_speed_ratio(field, polar, bounds, 1.9)
    words = str(no.value).split()
    least, most = float(words[words.index("of") + 1]), float(words[words.index("to") + 1])
    assert 0.5 < least < 0.92 < 0.98 < most < 1.9
    for ratio, there in ((least + 0.005, True), (most - 0.005, True), (most + 0.01, False)):
        if there:
            assert place_at_speed_ratio(field, polar, bounds, ratio)
        else:
            with pytest.raises(ZeucError):
                place_at_speed_ratio(field, polar, bounds, ratio)
    flat = polar._replace(c0=1.0, c1=0.0, c2=0.0, c3=0.0)
    with pytest.raises(ZeucError, match="no best glide within its range"):
        place_at_speed_ratio(field, flat, bounds, 0.9)


def test_a_perpendicular_line_points_where_the_excess_falls() -> None:
    prepared = prepare(STATIC)
    at = prepared.lines["a"].crossing
    assert at is not None
    gx, gz = excess_gradient(prepared.field, prepared.polar, at.x_m, at.z_m)
    lean = perpendicular_lean(prepared.field, prepared.polar, at.x_m, at.z_m)
    assert lean == pytest.approx(atan2(gx, -gz))
    along = np.array([-sin(lean), cos(lean)])
    assert along @ np.array([gx, gz]) == pytest.approx(-np.hypot(gx, gz))


def test_a_slide_back_is_as_fast_as_the_excess_is_steep_over_the_leverage() -> None:
    polar = prepare(STATIC).polar
    crossing = Crossing(
        x_m=0.5, z_m=1.5, wind_mps=9.0, excess_slope_per_s=-0.8, stable=True, **_rest()
    )
    target = TargetLine(0.5, 1.5, radians(110.0))
    found = slide_at(polar, target, crossing)
    slope = polar_slope(polar, 9.0)
    assert found.polar_slope == slope
    assert found.eta_rad == target.eta_rad
    assert found.rate_per_s == pytest.approx(
        0.8 / (sin(radians(110.0)) - slope * cos(radians(110.0)))
    )


def _rest() -> dict[str, Any]:
    known = {"x_m", "z_m", "wind_mps", "excess_slope_per_s", "stable"}
    return {name: 0.0 for name in Crossing._fields if name not in known}


def test_an_airframe_or_a_site_is_looked_for_beside_the_file_first(tmp_path: Path) -> None:
    text = (
        'title = "t"\nsite = "tunnel.toml"\nduration_s = 20.0\nfirst_line = "a"\n'
        "[lines]\na = { speed_ratio = 0.92 }\n"
    )
    path = tmp_path / "s.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"site = 'tunnel\.toml': no such file beside the") as no:
        load_scenario(path)
    assert str(no.value).startswith(str(path))
    own = tmp_path / "tunnel.toml"
    own.write_text(shipped("sites/tunnel.toml").read_text(encoding="utf-8"), encoding="utf-8")
    found = load_scenario(path)
    assert found.site == str(own.resolve())
    assert found.airframe == str(shipped("airframes/eclipson_c.toml").resolve())
    path.write_text(text.replace("20.0", '20.0\nairframe = "x.toml"'), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"airframe = 'x\.toml': no such file"):
        load_scenario(path)
