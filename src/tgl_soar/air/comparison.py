"""The jet model against a computed or measured plane of a tunnel's test section."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tgl_soar.air.grid import GridField
from tgl_soar.air.jet import JetShape, SlopeJet

BELOW_EDGE_M = 0.3  # the soaring region ends so far below the jet's upper edge
ABOVE_BOARD_M = 0.4


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
