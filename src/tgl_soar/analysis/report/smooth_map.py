"""A shaded map whose edge is as smooth as what it shows, and not as coarse as its grid.

Values are known at some nodes of a grid only.  Shading stops at the last known node, in teeth of
a cell's size.  Here it is drawn on beyond the edge, and what lies there is covered again up to
the edge itself: in the cells that the edge runs through, by the fraction of them that is known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter, minimum_filter

Floats = NDArray[np.float64]
Outline = list[tuple[float, float]]
Known = Callable[[Floats, Floats], NDArray[np.bool_]]  # at places x, z [m] of one shape

FINER: Final = 8  # places in each direction, in a cell that an edge runs through


def draw_smooth_map(
    axes: Any,
    x_m: Floats,
    z_m: Floats,
    values: Floats,
    known: Known,
    ground: Outline | None = None,
    background: str = "white",
    **look: Any,
) -> Any:
    """Shade values on a grid, shape (z, x), NaN where unknown; the shading.

    known: whether there is a value at any place.  ground: its corners; it is drawn above all this,
    and with its own edge.  look: as `contourf` takes it.
    """

    def is_shaded(x: Floats, z: Floats) -> NDArray[np.bool_]:
        cell = z_m[1] - z_m[0]  # nearer to the ground than that, what is shaded above reaches it
        near = _is_in(ground, x, z - cell) & known(x, z + 2.0 * cell)
        return known(x, z) | _is_in(ground, x, z) | near

    shades = axes.contourf(x_m, z_m, beyond_the_edge(values), **look)
    fraction = known_fraction(is_shaded, x_m, z_m, is_shaded(*np.meshgrid(x_m, z_m)))
    if np.any(fraction < 0.5):
        axes.contourf(x_m, z_m, fraction, levels=[-1.0, 0.5], colors=[background], zorder=1.5)
    return shades


def _is_in(outline: Outline | None, x: Floats, z: Floats) -> NDArray[np.bool_]:
    if not outline:
        return np.zeros(x.shape, dtype=bool)
    from matplotlib.path import Path

    places = np.stack([x.ravel(), z.ravel()], axis=1)
    return np.asarray(Path(outline).contains_points(places)).reshape(x.shape)


def beyond_the_edge(values: Floats) -> Floats:
    """Each unknown value as the nearest known one; as they are where none is known."""
    unknown = ~np.isfinite(values)
    if not unknown.any() or unknown.all():
        return values
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def known_fraction(known: Known, x_m: Floats, z_m: Floats, nodes: NDArray[np.bool_]) -> Floats:
    """Around each node of an even grid, the fraction of a cell that is known."""
    fraction = nodes.astype(float)
    edge = maximum_filter(nodes, 3) != minimum_filter(nodes, 3)
    rows, columns = np.nonzero(edge)
    if not rows.size:
        return fraction
    steps = (np.arange(FINER) + 0.5) / FINER - 0.5
    dx, dz = np.meshgrid(steps * (x_m[1] - x_m[0]), steps * (z_m[1] - z_m[0]))
    x = np.clip(x_m[columns, None] + dx.ravel(), x_m[0], x_m[-1])
    z = np.clip(z_m[rows, None] + dz.ravel(), z_m[0], z_m[-1])
    finer = known(x, z)
    fraction[rows, columns] = finer.mean(axis=1)
    return fraction
