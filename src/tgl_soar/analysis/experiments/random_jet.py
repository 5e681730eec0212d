"""The air of a jet unlike its file's: another slope of the board, edge, and shear.

A jet is worked out for the corners of the ranges and no other, and is blended between them:

    wind = (1 + shear (z − H / 2)) Σ weight · corner,    weight bilinear in slope and edge

The edge is moved by the height H of the nozzle, at the same wind in it: the free surface moves with
its mixing layer, and the flow under it is that of the other jet.  The shear is of the whole jet,
about the middle of the nozzle, where its wind is measured.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridTable, grid_wind_many
from tgl_soar.air.jet import JetShape, SlopeJet, unit_jet

Range = tuple[float, float]


class JetRanges(NamedTuple):
    """From and to, added to the shape's own."""

    slope_rad: Range
    edge_m: Range


def altered_jet(
    jet: SlopeJet, ranges: JetRanges, *, slope_rad: float, edge_m: float, shear_per_m: float
) -> SlopeJet:
    """The jet with its board steeper by slope_rad, its edge higher by edge_m, both within their
    ranges, and its wind growing with height by a fraction shear_per_m of itself [1/m].

    With another slope a place must lie in the jets of both ends of the range, and so clear of the
    steeper board: that is the board of what is returned.  Errors: ValueError for a slope whose
    range leaves that of `SlopeJet`.
    """
    shape, (low, high) = jet.shape, ranges.slope_rad
    sloped = slope_rad != 0.0
    board = shape._replace(slope_rad=shape.slope_rad + high) if sloped else shape
    slopes = [(shape.slope_rad, 1.0)]
    if sloped:
        weight = (slope_rad - low) / (high - low)
        slopes = [(shape.slope_rad + low, 1.0 - weight), (shape.slope_rad + high, weight)]
    edges = [(0.0, 1.0)]
    if edge_m != 0.0:
        lower, upper = ranges.edge_m
        weight = (edge_m - lower) / (upper - lower)
        edges = [(lower, 1.0 - weight), (upper, weight)]
    corners = [
        by_slope * by_edge * _corner(shape, board, slope, edge)
        for slope, by_slope in slopes
        for edge, by_edge in edges
    ]
    grid = unit_jet(board)
    height_m = grid.z0_m + grid.dz_m * np.arange(grid.nz)
    growth = 1.0 + shear_per_m * (height_m - 0.5 * shape.nozzle_height_m)
    return _boarded(jet.wind_mps, board).with_unit_wind(
        growth[:, np.newaxis] * np.sum(corners, axis=0)
    )


@lru_cache(maxsize=8)
def _boarded(wind_mps: float, board: JetShape) -> SlopeJet:
    return SlopeJet(wind_mps, *board)


@lru_cache(maxsize=32)
def _corner(shape: JetShape, board: JetShape, slope_rad: float, edge_m: float) -> FloatArray:
    """Wind (nx, nz, 2) of a corner's jet at the nodes of board's grid; 1 m/s in the nozzle."""
    corner = unit_jet(
        shape._replace(slope_rad=slope_rad, nozzle_height_m=shape.nozzle_height_m + edge_m)
    )
    x_m, z_m = _nodes(unit_jet(board))
    return np.stack(grid_wind_many(corner, x_m, z_m), axis=-1)


def _nodes(grid: GridTable) -> tuple[FloatArray, FloatArray]:
    x_m, z_m = np.meshgrid(
        grid.x0_m + grid.dx_m * np.arange(grid.nx),
        grid.z0_m + grid.dz_m * np.arange(grid.nz),
        indexing="ij",
    )
    return x_m, z_m
