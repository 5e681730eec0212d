"""A polynomial wind named in a site file: what it follows, its ground, and how far it is off."""

from __future__ import annotations

from math import radians, tan
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import inspect
from typer.testing import CliRunner

from tgl_soar.air.hill import HillField
from tgl_soar.air.polynomial import DEGREE_MAX, PolynomialField, fit_polynomial, lowest_floor
from tgl_soar.analysis.experiments.scenario import search_bounds
from tgl_soar.cli.app import app
from tgl_soar.config.files import ConfigError, load_airframe, load_site, shipped
from tgl_soar.config.site import GridAir, HillAir, JetAir, PolynomialAir, Site, TurbulenceSettings
from tgl_soar.sim.world import build_field, ground_outline, make_world, wind_misfit_text

SITE = load_site(shipped("sites/tunnel_polynomial.toml"))
JET = JetAir(wind_mps=8.5, slope_deg=23.0)
HILL = HillAir(wind_mps=7.0, radius_m=8.0)


def polynomial(of: JetAir | HillAir | GridAir, **changes: object) -> PolynomialAir:
    box = {"x_m": (-0.5, 2.25), "z_m": (0.15, 2.85)}
    return PolynomialAir(of=of, **{"degree": 8, **box, **changes})  # type: ignore[arg-type]


def test_a_polynomial_stands_in_for_the_jet_it_follows() -> None:
    """Where the places of the site are it is as near as its misfit, and not the jet itself."""
    assert isinstance(SITE.air, PolynomialAir)
    followed, field = build_field(JET), build_field(SITE.air)
    assert isinstance(field, PolynomialField)
    assert field.misfit is not None
    assert field.reference_wind_mps == followed.reference_wind_mps == SITE.air.wind_mps
    assert 0.0 < field.misfit.w_rms_mps < 0.02
    for line in SITE.lines.values():
        ours = field.wind_at(line.x_m, 0.0, line.z_m, 0.0)
        theirs = followed.wind_at(line.x_m, 0.0, line.z_m, 0.0)
        assert ours == pytest.approx(theirs, abs=0.05)
        assert ours != theirs


def test_before_an_oblique_ridge_only_what_blows_across_it_is_lifted() -> None:
    """As of the air that it follows: cos 30° of the wind is, and sin 30° blows along the ridge."""
    air = polynomial(HILL, x_m=(-16.0, -4.0), z_m=(8.0, 16.0))
    straight, askew = build_field(air), build_field(air, oblique_rad=radians(30.0))
    for x_m, z_m in ((-6.2, 14.2), (-10.0, 9.0)):
        u, _, w = straight.wind_at(x_m, 0.0, z_m, 0.0)
        across, along, up = askew.wind_at(x_m, 0.0, z_m, 0.0)
        assert (across, up) == pytest.approx((0.75**0.5 * u, 0.75**0.5 * w))
        assert along == pytest.approx(-0.5 * 7.0)


def test_its_ground_and_its_sides_are_those_of_what_it_follows() -> None:
    air = polynomial(JET)
    field = build_field(air)
    assert ground_outline(air) == ground_outline(JET)
    on_board = 1.0 * tan(radians(23.0))
    assert not field.inside(1.0, 0.0, on_board - 0.01)
    assert field.inside(1.0, 0.0, on_board + 0.01)
    assert not field.inside(2.3, 0.0, 2.0)  # beyond the box
    site = msgspec.structs.replace(SITE, air=air)
    bounds = make_world(load_airframe(shipped("airframes/eclipson_c.toml")), site).bounds
    assert bounds is not None
    assert bounds.name == "board"
    assert search_bounds(site) == (-0.5, 2.25, 0.15, 2.85)


def test_it_follows_a_hill() -> None:
    field = build_field(polynomial(HILL, x_m=(-12.0, 0.0), z_m=(0.5, 20.0), step_m=0.3))
    assert not field.inside(-1.0, 0.0, 7.9)
    assert field.inside(-1.0, 0.0, 8.1)
    assert field.wind_at(-6.0, 0.0, 12.0, 0.0) == pytest.approx(
        HillField(7.0, 8.0).wind_at(-6.0, 0.0, 12.0, 0.0), abs=0.05
    )


def test_it_follows_a_grid_whose_ground_is_found(tmp_path: Path) -> None:
    """Half a slope of solid nodes: the floor is the lowest height with air all the way up."""
    hill = HillField(7.0, 8.0)
    x, z = np.arange(-14.0, 0.01, 0.25), np.arange(0.0, 20.01, 0.25)
    u, _, w = hill.wind(x[:, None], 0.0, z[None, :])
    solid = x[:, None] ** 2 + z[None, :] ** 2 < 64.0
    u, w = np.where(solid, 0.0, u), np.where(solid, 0.0, w)
    np.savez(tmp_path / "hill.npz", x=x, z=z, u=u, w=w)
    grid = GridAir(file="hill.npz", wind_mps=7.0, zero_cells="solid")
    air = polynomial(grid, x_m=(-12.0, -0.5), z_m=(0.5, 19.5), step_m=0.25)
    field = build_field(air, tmp_path)
    assert isinstance(field, PolynomialField)
    followed = build_field(grid, tmp_path)
    for x_m in (-11.0, -6.0, -1.0):
        lowest = min(z for z in np.arange(0.5, 19.0, 0.05) if field.inside(x_m, 0.0, z))
        assert followed.inside(x_m, 0.0, lowest + 0.25)
        assert lowest <= max(0.5, (64.0 - x_m * x_m) ** 0.5 if x_m > -8.0 else 0.0) + 0.6
    assert ground_outline(air) is None


def test_a_floor_is_found_below_the_air_and_not_in_a_gap() -> None:
    class Gap(HillField):
        def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
            return 1.0 <= z_m <= 4.0 and not 1.9 < z_m < 2.1 and x_m < 1.0

    floor = lowest_floor(Gap(7.0, 0.5), (0.0, 2.0, 0.0, 5.0), 0.5)
    assert floor == ((0.0, 2.5), (0.5, 2.5))


def test_what_cannot_be_fitted_is_named() -> None:
    with pytest.raises(ConfigError, match=r"^air: degree 12: 91 coefficients for"):
        build_field(polynomial(JET, degree=12, step_m=0.5))
    outside = polynomial(GridAir(file="none.csv", wind_mps=8.0))
    with pytest.raises(ConfigError, match=r"air\.file: .*none\.csv"):
        build_field(outside, Path("/nowhere"))


def test_the_file_s_degrees_are_those_of_the_fit() -> None:
    kind = inspect.type_info(PolynomialAir)
    assert isinstance(kind, inspect.StructType)
    (degree,) = (field.type for field in kind.fields if field.name == "degree")
    assert isinstance(degree, inspect.IntType)
    assert (degree.ge, degree.le) == (1, DEGREE_MAX)


def test_turbulence_is_that_of_the_site() -> None:
    air = polynomial(JET, turbulence=TurbulenceSettings(intensity=0.02))
    site = msgspec.structs.replace(SITE, air=air)
    assert isinstance(site, Site)
    world = make_world(load_airframe(shipped("airframes/eclipson_c.toml")), site)
    assert world.parts.turbulence.blows


def test_the_misfit_is_printed() -> None:
    assert wind_misfit_text(build_field(JET)) == ""
    reported = CliRunner().invoke(app, ["site", "misfit", "--site", "tunnel_polynomial"])
    assert reported.exit_code == 0, reported.output
    assert SITE.air is not None
    field = build_field(SITE.air)
    assert reported.output.strip() == wind_misfit_text(field)
    assert isinstance(field, PolynomialField)
    assert field.misfit is not None
    assert f"degree 8, fitted at {field.misfit.places} places" in reported.output
    assert f"{field.misfit.u_rms_mps:.3f} m/s rms along the wind" in reported.output
    other = CliRunner().invoke(app, ["site", "misfit", "--site", "tunnel"])
    assert other.exit_code == 2
    assert 'air.kind: only the wind of kind = "polynomial"' in other.output.replace("\n", " ")


def test_a_fit_carries_its_misfit() -> None:
    field, misfit = fit_polynomial(HillField(7.0, 8.0), (-12.0, -8.5, 0.5, 12.0), 5)
    assert field.misfit == misfit
