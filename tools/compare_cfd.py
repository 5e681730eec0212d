#!/usr/bin/env python3
"""Hold the jet model against a CFD plane of the paper's test section.

    python tools/compare_cfd.py PLANE.csv --slope-deg 21.3 --board 2.42 --foot 5.5 0.5

A plane has columns x, z, v_x, v_z [m, m/s]; its x grows upstream.  Where the board stands in it is
not in the file: slope, length and foot are those of the plane's own description, and are held
against its solid cells.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from math import cos, degrees, inf, isfinite, nan, radians, sin, tan
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.air.grid import GridError, GridField
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.jet import JetShape, SlopeJet

BELOW_EDGE_M = 0.3  # the soaring region ends so far below the jet's upper edge
ABOVE_BOARD_M = 0.4
EDGES_M = (0.0, 0.5, 1.0, 1.5, 2.0)  # x
# A board is made of steps of a cell.  A line through some 45 of them is known to a fifth of a
# degree, 5 cm / sqrt(12) over the root of 45 times their scatter along it; three times that.
SLOPE_OFF_RAD = radians(0.6)
MODELS = (
    ("square nozzle (the default)", 2.85, 1.0),
    ("two-dimensional, vented wake", inf, 1.0),
    ("two-dimensional, sucking wake 1.15", inf, 1.15),
)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The jet model against a CFD plane.")
    parser.add_argument("plane", type=Path)
    add = parser.add_argument
    add("--slope-deg", type=within(1.0, 60.0), required=True, metavar="DEG", help="1 to 60")
    add("--board", type=within(0.1, 50.0), required=True, metavar="M", help="its length, 0.1 to 50")
    add("--foot", type=within(-100.0, 100.0), nargs=2, required=True, metavar=("X", "Z"))
    return parser.parse_args()


def within(least: float, most: float) -> Callable[[str], float]:
    def value(text: str) -> float:
        number = float(text)
        if not (isfinite(number) and least <= number <= most):
            raise argparse.ArgumentTypeError(f"{text} is not within {least:g} to {most:g}")
        return number

    return value


class FieldDifference(NamedTuple):
    """Model less plane over the soaring region, as fractions of the nozzle's mean wind."""

    nozzle_wind_mps: float
    wind_rms: float
    wind_bias: float
    updraft_rms: float
    updraft_bias: float
    shear_per_m: float  # of the wind, at the same x
    edge_m: tuple[float, ...]  # of the height at which it has half its speed, at EDGES_M


def compare_jet(plane: GridField, shape: JetShape) -> FieldDifference:
    """Differences between foot and tip of the board, at equal flow through the nozzle.

    plane: its frame has the foot of the board at x = z = 0 and reaches from the nozzle to the
    tip; shape: board and jet as in the plane.
    """
    tip_x = shape.board_length_m * float(np.cos(shape.slope_rad))
    top = shape.nozzle_height_m - BELOW_EDGE_M
    x, z = np.meshgrid(
        np.linspace(0.0, tip_x, 46), np.linspace(ABOVE_BOARD_M, top, 44), indexing="ij"
    )
    keep = z >= x * np.tan(shape.slope_rad) + ABOVE_BOARD_M
    u, _, w = plane.wind(x[keep], 0.0, z[keep])
    height = np.linspace(0.0, shape.nozzle_height_m, 571)
    flow = np.trapezoid(plane.wind(0.05 - shape.lip_ahead_m, 0.0, height)[0], height)
    wind = float(flow) / shape.nozzle_height_m
    model = SlopeJet(wind, *shape)
    model_u, _, model_w = model.wind(x[keep], 0.0, z[keep])
    du, dw = (model_u - u) / wind, (model_w - w) / wind
    return FieldDifference(
        nozzle_wind_mps=wind,
        wind_rms=float(np.sqrt((du**2).mean())),
        wind_bias=float(du.mean()),
        updraft_rms=float(np.sqrt((dw**2).mean())),
        updraft_bias=float(dw.mean()),
        shear_per_m=float(np.linalg.lstsq(np.c_[np.ones(len(du)), x[keep], z[keep]], du)[0][2]),
        edge_m=tuple(
            _edge(model, at, shape.nozzle_height_m) - _edge(plane, at, shape.nozzle_height_m)
            for at in EDGES_M
        ),
    )


def _edge(field: WindField, x_m: float, about_m: float) -> float:
    """The height [m] at which the wind has half the speed that it has 0.8 m below the lip;
    nan: it has so much up to 0.8 m above."""
    z = about_m + np.linspace(-0.8, 0.8, 1601)
    speed = np.hypot(*field.wind(x_m, 0.0, z)[::2])
    slow = np.nan_to_num(speed) < 0.5 * speed[0]
    return float(z[np.argmax(slow)]) if slow.any() else nan


def nozzle_shear(plane: GridField, shape: JetShape) -> float:
    """How the plane's wind grows with height in the nozzle, but at its walls [1/m]."""
    z = np.linspace(0.1, shape.nozzle_height_m - 0.1, 551)
    wind = plane.wind(0.05 - shape.lip_ahead_m, 0.0, z)[0]
    return float(np.polyfit(z, wind / wind.mean(), 1)[0])


class Board(NamedTuple):
    """What the solid cells of a plane say of it, in the frame of the plane."""

    slope_rad: float
    x_m: float  # of the foot
    z_m: float
    length_m: float


def board_of(plane: GridField, somewhere_m: float) -> Board | None:
    """The board of which the cells of the column somewhere_m are part; None: there is none, or its
    tip is not in the plane.

    A line through the tops of the solid cells, from the level floor up to where they fall off.
    """
    table = plane.table
    x = table.x0_m + table.dx_m * np.arange(table.nx)
    floor = np.logical_and.accumulate(plane.solid, axis=1).sum(axis=1)  # cells, from below
    top = table.z0_m + table.dz_m * (floor - 1.0)
    inside = int(np.argmin(np.abs(x - somewhere_m)))
    levels, columns = np.unique(top[: inside + 1], return_counts=True)
    level = float(levels[np.argmax(columns)])
    first = last = inside
    while first > 0 and level + table.dz_m < top[first - 1] <= top[first]:
        first -= 1
    while last + 1 < len(x) and top[last + 1] >= top[last]:
        last += 1
    if last == len(x) - 1 or last - first < 2 or top[last] - top[first] < 2.0 * table.dz_m:
        return None
    rise, height = np.polyfit(x[first : last + 1], top[first : last + 1], 1)
    foot_x = (level - height) / rise
    slope = float(np.arctan(rise))
    return Board(
        slope, float(foot_x), level, float(x[last] + 0.5 * table.dx_m - foot_x) / cos(slope)
    )


def why_another(plane: GridField, slope_rad: float, board_m: float) -> str:
    """Why a board from x = z = 0 is not the plane's, by a cell at foot or tip, or by its slope."""
    found = board_of(plane, 0.5 * board_m * cos(slope_rad))
    if found is None:
        return "there is no board there that ends within the plane"
    tip = found.x_m + found.length_m * cos(found.slope_rad)
    off = {
        "the foot's height": found.z_m,
        "the height half-way": (tan(found.slope_rad) - tan(slope_rad)) * 0.5 * tip
        - tan(found.slope_rad) * found.x_m
        + found.z_m,
        "the tip's height": found.z_m
        + found.length_m * sin(found.slope_rad)
        - tan(slope_rad) * tip,
        "the tip": tip - board_m * cos(slope_rad),
    }
    what, worst = max(off.items(), key=lambda each: abs(each[1]))
    turned = abs(found.slope_rad - slope_rad) > SLOPE_OFF_RAD
    if abs(worst) <= max(plane.table.dx_m, plane.table.dz_m) and not turned:
        return ""
    return (
        f"the plane's own is {found.length_m:.2f} m long at {degrees(found.slope_rad):.1f} degrees,"
        f" and {what} is {worst:+.2f} m off"
    )


def main() -> int:
    options = parsed()
    foot_x_m, foot_z_m = options.foot
    layout = Layout(u="v_x", w="v_z", x_sign=-1, origin_x_m=foot_x_m, origin_z_m=foot_z_m)
    try:
        plane = read_grid(options.plane, layout, reference_wind_mps=1.0, zero_cells="solid")
    except GridError as error:
        print(error, file=sys.stderr)
        return 2
    slope_rad = radians(options.slope_deg)
    if another := why_another(plane, slope_rad, options.board):
        print(
            f"{options.plane}: no board of {options.board:g} m at {options.slope_deg:g} degrees"
            f" from {foot_x_m:g}, {foot_z_m:g} m: {another}",
            file=sys.stderr,
        )
        return 2
    print("model                                wind rms   bias   updraft rms   bias   [% of wind]")
    found = [
        (
            name,
            JetShape(
                slope_rad=slope_rad,
                board_length_m=options.board,
                jet_width_m=width,
                wake_speed_ratio=suction,
            ),
        )
        for name, width, suction in MODELS
    ]
    for name, shape in found:
        d = compare_jet(plane, shape)
        print(
            f"{name:36} {100 * d.wind_rms:7.1f} {100 * d.wind_bias:+7.1f}"
            f" {100 * d.updraft_rms:10.1f} {100 * d.updraft_bias:+8.1f}"
        )
    shape = found[0][1]
    d = compare_jet(plane, shape)
    print(
        "the default's wind grows with height by"
        f" {100 * d.shear_per_m:+.1f} % of the wind a metre more than the plane's, which grows by"
        f" {100 * nozzle_shear(plane, shape):+.1f} % a metre in the nozzle"
    )
    edges = zip(EDGES_M, d.edge_m, strict=True)
    higher = [f"{100 * edge:+.1f} cm at x {x:g} m" for x, edge in edges if isfinite(edge)]
    print(f"its free edge is higher by {', '.join(higher) or '– (the plane has none)'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
