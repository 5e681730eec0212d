"""The board in the jet as it is flown in: baked, mixed, bounded, and of use to a soarer."""

from __future__ import annotations

from math import erf, inf, radians, tan

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.freestream import FreeJetMap, solve_free_jet
from tgl_soar.air.gusts import BlendedField, Schedule
from tgl_soar.air.jet import SHIFT, SPREADING, JetShape, SlopeJet
from tgl_soar.air.relief import relieve, relieved_velocity
from tgl_soar.air.zeuc import contour, crossings
from tgl_soar.config.files import load_site, shipped
from tgl_soar.types import GlidePolar

# Sink 1.34 m/s at 8.55 m/s, best glide at 9.2 m/s: an airframe of glide ratio 6.5.
POLAR = GlidePolar(
    c0=5.0068, c1=-0.93464, c2=0.059155, c3=0.0, speed_min_mps=7.4, speed_max_mps=11.0
)


def _soaring_region(slope_rad: float) -> tuple[FloatArray, FloatArray]:
    """Between foot and tip, 0.4 m above the board to 0.3 m below the height of the nozzle."""
    x, z = np.meshgrid(np.linspace(0.02, 2.2, 60), np.linspace(0.4, 2.55, 70), indexing="ij")
    keep = z >= x * tan(slope_rad) + 0.4
    return x[keep], z[keep]


@pytest.mark.parametrize("width", [2.85, inf])
def test_interpolation_costs_less_than_a_fifth_of_a_percent(width: float) -> None:
    slope = radians(23.0)
    field = SlopeJet(9.0, slope, jet_width_m=width)
    jet = solve_free_jet(slope, 2.85, 2.45, 0.5)
    net = FreeJetMap(jet, 0.5 + 1.6 * 2.85, 2.45 + 1.6 * 2.85)
    relief = relieve(net, width) if width < inf else None
    x, z = _soaring_region(slope)
    u, w = relieved_velocity(net, relief, net.locate(x, z))
    baked_u, _, baked_w = field.wind(x, 0.0, z)
    scale = 9.0 / jet.nozzle_speed
    # 0.2 % of the wind; mixing begins 0.3 m below the edge with less than that.
    near_edge = z > 2.3
    assert np.abs(baked_u - u * scale)[~near_edge].max() < 0.002 * 9.0
    assert np.abs(baked_w - w * scale)[~near_edge].max() < 0.002 * 9.0


@pytest.mark.parametrize("slope_deg", [15.0, 35.0])
@pytest.mark.parametrize("width", [2.85, inf])
def test_every_slope_gives_a_whole_field_proportional_to_wind(
    slope_deg: float, width: float
) -> None:
    slope = radians(slope_deg)
    slow, fast = (SlopeJet(wind, slope, jet_width_m=width) for wind in (5.0, 15.0))
    x, z = _soaring_region(slope)
    u, v, w = slow.wind(x, 0.0, z)
    assert np.isfinite(u).all()
    assert np.isfinite(w).all()
    assert not v.any()
    for thrice, once in zip(fast.wind(x, 0.0, z), (u, v, w), strict=True):
        assert thrice == pytest.approx(3.0 * once)
    # Nowhere faster than the free edges could be with a lossless nozzle, nowhere backwards.
    assert u.min() > 0.3 * 5.0
    assert u.max() < 1.6 * 5.0
    assert (w > 0.0).all()


def test_nozzle_mean_is_the_wind_that_names_the_field() -> None:
    field = SlopeJet(8.5, radians(21.3), jet_width_m=inf)
    z = np.linspace(0.0, 2.84, 400)
    u, _, _ = field.wind(-1.5, 0.0, z)
    assert np.trapezoid(u, z) / 2.84 == pytest.approx(8.5, rel=3e-3)


def test_a_steeper_board_lifts_more_and_the_blend_is_the_slope_between() -> None:
    x, z = _soaring_region(radians(25.0))
    fields = [SlopeJet(9.0, radians(deg)) for deg in (23.0, 24.0, 25.0)]
    lifts = [field.wind(x, 0.0, z)[2] for field in fields]
    assert (lifts[2] > lifts[0]).all()
    half = BlendedField(fields[0], fields[2], Schedule([0.0], [0.5]))
    # The blend errs by (1°)² / 2 times the second derivative with slope: under 0.3 % of wind.
    for part, true in zip(half.wind(x, 0.0, z), fields[1].wind(x, 0.0, z), strict=True):
        assert np.abs(part - true).max() < 0.003 * 9.0


def test_mixing_edge_has_the_width_of_its_law_and_keeps_momentum() -> None:
    field = SlopeJet(9.0, radians(15.0), jet_width_m=inf)
    # Above the foot the edge is nearly level: 0.5 m from the lip.
    z = np.linspace(2.2, 3.6, 1401)
    u, _, _ = field.wind(0.4, 0.0, z)
    fastest = float(u.max())
    high, low = (float(z[np.flatnonzero(u > part * fastest)[-1]]) for part in (0.9, 0.1))
    # erf⁻¹(0.8) = 0.906 on either side; the path from the lip is 0.9 m plus the bend's 2 %.
    assert low - high == pytest.approx(2.0 * 0.906 * 0.92 / SPREADING, rel=0.1)
    xi = np.linspace(-6.0, 6.0, 4001)
    fraction = np.array([0.5 * (1.0 + erf(value + SHIFT)) for value in xi])
    assert np.trapezoid(fraction**2 - (xi > 0.0), xi) == pytest.approx(0.0, abs=2e-3)


def test_the_edge_grows_as_fast_as_plane_mixing_layers_have_been_measured_to() -> None:
    """Momentum thickness ∫ f (1 − f) dn of air that mixes into air at rest grows by 0.035 of the
    way (Liepmann and Laufer, NACA TN 1257), as laboratories since have it within a tenth."""
    field = SlopeJet(9.0, radians(15.0), jet_width_m=inf)
    stations = (0.0, 0.4, 0.8)  # from the lip on, while the edge is nearly level
    thickness = []
    for x in stations:
        z = np.linspace(2.2, 3.8, 1601)
        u, _, _ = field.wind(x, 0.0, z)
        core = int(np.argmax(u))
        part = np.clip(u[core:] / u[core], 0.0, 1.0)
        thickness.append(float(np.trapezoid(part * (1.0 - part), z[core:])))
    assert np.diff(thickness) / np.diff(stations) == pytest.approx(0.035, abs=0.0035)


def test_the_nozzle_ends_where_the_laboratory_s_does() -> None:
    """In its public planes the lip stands at x = 6.0 m and the board's foot at 5.5 m, x growing
    upstream.  Above the roof there is no air; past the lip that of the room is drawn in."""
    field, lip_x_m = SlopeJet(8.5, radians(23.0)), 5.5 - 6.0
    cell = field.jet.table.dx_m
    above = field.shape.nozzle_height_m + 0.1
    assert field.wind_at(lip_x_m - 2.0 * cell, 0.0, above, 0.0) == (0.0, 0.0, 0.0)
    assert field.wind_at(lip_x_m + 2.0 * cell, 0.0, above, 0.0)[2] < 0.0
    assert JetShape(slope_rad=radians(23.0)) == field.shape
    # The site's fence keeps the aircraft out of the nozzle.
    site = load_site(shipped("sites/tunnel.toml"))
    assert site.parameters["FENCE_X_MIN"] == lip_x_m


def test_room_is_still_but_for_entrainment_towards_the_jet() -> None:
    field = SlopeJet(9.0, radians(23.0))
    u, _, w = field.wind([0.5, 1.5, 2.5], 0.0, 5.0)
    assert np.abs(u).max() < 0.02 * 9.0
    assert (w < 0.0).all()  # down, onto the jet
    assert (w > -0.05 * 1.3 * 9.0).all()  # 3.6 % of the edge's speed
    behind, under = field.wind_at(3.2, 0.0, 0.3, 0.0), field.wind_at(1.5, 0.0, 0.2, 0.0)
    assert abs(behind[0]) < 0.05 * 9.0
    assert behind[2] > 0.0  # up, onto the jet's lower edge
    assert under == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("slope_deg", [21.3, 23.0, 25.0])
def test_air_without_friction_slips_along_the_board(slope_deg: float) -> None:
    """Between the surface and the first nodes of the grid, too: no boundary layer of a cell."""
    field = SlopeJet(9.0, radians(slope_deg))
    for x in np.arange(0.6, 2.0, 0.037):
        surface = field.board_height_m(x)
        u, _, w = field.wind_at(x, 0.0, surface + 1e-3, 0.0)
        above = field.wind_at(x, 0.0, surface + 0.04, 0.0)
        assert np.hypot(u, w) == pytest.approx(np.hypot(above[0], above[2]), rel=0.06)
        assert w / u == pytest.approx(tan(radians(slope_deg)), rel=0.06)


def test_outside_is_defined_and_reported() -> None:
    field = SlopeJet(9.0, radians(23.0))
    assert field.inside(1.0, 0.0, 1.0)
    assert not field.inside(1.0, 0.0, 0.3)  # in the board
    assert not field.inside(1.0, 1.5, 1.0)  # beside the jet
    assert not field.inside(0.0, 0.0, -0.1)
    assert not field.inside(-50.0, 0.0, 1.0)
    edge = field.wind_at(field.jet.table.x0_m, 0.0, 1.0, 0.0)
    assert field.wind_at(-50.0, 0.0, 1.0, 0.0) == edge
    assert edge[0] == pytest.approx(9.0, rel=0.05)


def test_arrays_equal_single_queries() -> None:
    field = SlopeJet(9.0, radians(23.0))
    x, z = np.meshgrid(np.linspace(-3.0, 6.0, 41), np.linspace(-0.5, 6.0, 37), indexing="ij")
    u, v, w = field.wind(x, 0.0, z)
    single = [field.wind_at(a, 0.0, b, 0.0) for a, b in zip(x.flat, z.flat, strict=True)]
    assert np.stack([u, v, w], axis=-1).reshape(-1, 3) == pytest.approx(np.array(single))


@pytest.mark.parametrize("slope_deg", [21.3, 23.0, 25.0])
def test_a_line_leaning_upwind_finds_one_stable_place(slope_deg: float) -> None:
    """The square jet: the contour leans with the board, 0.4 … 2 m above it, and can be flown."""
    field = SlopeJet(8.5, radians(slope_deg))
    lines = contour(field, POLAR, (-0.4, 2.0, 0.1, 2.5), 0.05)
    upper = lines[0]
    above = upper[:, 1] - np.maximum(0.0, upper[:, 0]) * tan(radians(slope_deg))
    middle = (upper[:, 0] > 0.1) & (upper[:, 0] < 1.5)
    assert middle.sum() > 10
    assert above[middle].min() > 0.4
    assert above[middle].max() < 2.0
    places = [c for c in crossings(field, POLAR, 0.3, 1.2, radians(105.0), 0.7) if c.stable]
    assert len(places) == 1
    assert 8.0 < places[0].wind_mps < 9.3


def test_a_two_dimensional_jet_stands_its_contour_up_at_the_foot() -> None:
    """The whole jet is turned: far up it rises as well, so no arch closes over the board."""
    line = contour(
        SlopeJet(9.0, radians(23.0), jet_width_m=inf), POLAR, (-0.9, 1.5, 0.4, 2.3), 0.05
    )
    span = np.ptp(np.vstack(line), axis=0)
    assert span[0] < 0.5 * span[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wind_mps": 4.0}, "5 to 15 m/s"),
        ({"slope_rad": radians(40.0)}, "15 to 35 degrees"),
        ({"slope_rad": 23.0}, "15 to 35 degrees"),
        ({"board_length_m": 0.0}, "board_length_m"),
        ({"lip_ahead_m": -0.5}, "lip_ahead_m"),
        ({"nozzle_height_m": inf}, "nozzle_height_m"),
        ({"jet_width_m": 0.5}, "jet_width_m"),
        ({"jet_width_m": float("nan")}, "jet_width_m"),
        ({"wake_speed_ratio": 0.5}, "wake_speed_ratio"),
    ],
)
def test_refuses_what_is_no_such_jet(change: dict[str, float], message: str) -> None:
    arguments: dict[str, float] = {"wind_mps": 9.0, "slope_rad": radians(23.0), **change}
    with pytest.raises(ValueError, match=message):
        SlopeJet(**arguments)
