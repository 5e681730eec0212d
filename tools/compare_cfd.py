#!/usr/bin/env python3
"""Hold the jet model against a CFD plane of the paper's test section.

    python tools/compare_cfd.py PLANE.csv --slope-deg 21.3 --board 2.42 --foot 5.5 0.5

A plane has columns x, z, v_x, v_z [m, m/s]; its x grows upstream.  Where the board stands in it is
not in the file: slope, length and foot are those of the plane's own description.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from math import cos, inf, isfinite, radians, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tgl_soar.air.grid import GridError, GridField
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.jet import JetShape, SlopeJet

BELOW_EDGE_M = 0.3  # the soaring region ends so far below the jet's upper edge
ABOVE_BOARD_M = 0.4
BY_THE_BOARD_M = 0.15  # three cells of the public planes, whose boards are made of steps
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
    model_u, _, model_w = SlopeJet(wind, *shape).wind(x[keep], 0.0, z[keep])
    du, dw = (model_u - u) / wind, (model_w - w) / wind
    return FieldDifference(
        nozzle_wind_mps=wind,
        wind_rms=float(np.sqrt((du**2).mean())),
        wind_bias=float(du.mean()),
        updraft_rms=float(np.sqrt((dw**2).mean())),
        updraft_bias=float(dw.mean()),
    )


def stands_there(plane: GridField, slope_rad: float, board_m: float) -> bool:
    """Whether the plane is solid a little under the board, and air a little over it."""
    along_m = np.linspace(0.1, 0.9, 9) * board_m
    x, z = along_m * cos(slope_rad), along_m * sin(slope_rad)
    over_u, _, over_w = plane.wind(x, 0.0, z + BY_THE_BOARD_M)
    under_u, _, under_w = plane.wind(x, 0.0, z - BY_THE_BOARD_M)
    over, under = np.hypot(over_u, over_w), np.hypot(under_u, under_w)
    return bool(np.all(over > 0.0) and np.all(np.nan_to_num(under) == 0.0))


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
    if not stands_there(plane, slope_rad, options.board):
        print(
            f"{options.plane}: no board of {options.board:g} m at {options.slope_deg:g} degrees"
            f" from {foot_x_m:g}, {foot_z_m:g} m: there is air within it, or none above it",
            file=sys.stderr,
        )
        return 2
    print("model                                wind rms   bias   updraft rms   bias   [% of wind]")
    for name, width, suction in MODELS:
        shape = JetShape(
            slope_rad=slope_rad,
            board_length_m=options.board,
            jet_width_m=width,
            wake_speed_ratio=suction,
        )
        d = compare_jet(plane, shape)
        print(
            f"{name:36} {100 * d.wind_rms:7.1f} {100 * d.wind_bias:+7.1f}"
            f" {100 * d.updraft_rms:10.1f} {100 * d.updraft_bias:+8.1f}"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
