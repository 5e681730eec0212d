"""Is a wind grid air?  Checks on nodes and axes in the soaring frame, and their evening out.

Every refusal is a `GridError` that names the file, the numbers, and what would help.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError

FASTEST_MPS = 75.0  # no soaring wind: a category 5 hurricane begins at 70 m/s
SLOWEST_MPS = 0.2  # a field without a place faster than this blows nowhere
MOST_NODES = 20_000_000  # about 2 GB as plain floats

BoolArray = NDArray[np.bool_]


def check_speeds(path: Path, wind: list[FloatArray], air: BoolArray) -> None:
    """Refuse speeds (u, v, w) [m/s] that no wind has, or a wind that blows the wrong way."""
    u, v, w = (part[air] for part in wind)
    fastest = float(np.sqrt(u * u + v * v + w * w).max())
    if fastest > FASTEST_MPS:
        raise GridError(
            f"{path}: the greatest wind speed is {fastest:.4g} m/s, above {FASTEST_MPS:.0f}:"
            " another unit?  Set mps_per_speed (km/h: 0.27778, cm/s: 0.01, knots: 0.51444)"
        )
    if fastest < SLOWEST_MPS:
        raise GridError(
            f"{path}: the greatest wind speed is {fastest:.4g} m/s, below {SLOWEST_MPS}: another"
            " unit, or a field divided by its reference wind?  Set mps_per_speed"
        )
    along, up = float(np.abs(u).mean()), float(np.abs(w).mean())
    if up > along:
        raise GridError(
            f"{path}: the air goes up and down faster (mean {up:.3g} m/s) than along ({along:.3g}"
            " m/s): are u and w swapped?"
        )
    if float(u.mean()) <= 0.0:
        raise GridError(
            f"{path}: the mean of u is {u.mean():.3g} m/s, against +x, which points downstream:"
            " set u_sign and x_sign"
        )


def check_mass(path: Path, axes: list[FloatArray], wind: list[FloatArray], air: BoolArray) -> None:
    """Refuse axes under which air springs up, where a turned or swapped axis would mend it.

    The measure is the median of |du/dx + dv/dy + dw/dz| over nodes with air all round: edges
    and shear layers touch few nodes, and a coarse grid all variants alike.  `wind` has as many
    parts as there are axes.  Small grids (fewer than 5 nodes along an axis) are not judged.
    """
    if min(air.shape) < 5:
        return
    as_read = _sources(axes, wind, air, [1.0] * len(axes))
    along = _sources(axes, wind, air, [1.0] + [0.0] * (len(axes) - 1))
    if as_read <= 0.5 * along:
        return
    mends = []
    if _sources(axes, wind, air, [-1.0] + [1.0] * (len(axes) - 1)) < 0.5 * as_read:
        mends.append("x turned round (set x_sign or u_sign)")
    if len(axes) == 3 and _sources(axes, wind, air, [1.0, -1.0, 1.0]) < 0.5 * as_read:
        mends.append("y turned round (set y_sign or v_sign)")
    if air.shape[0] == air.shape[-1]:
        swapped = [np.swapaxes(part, 0, -1) for part in wind]
        air_swapped = np.swapaxes(air, 0, -1)
        if _sources(axes, swapped, air_swapped, [1.0] * len(axes)) < 0.5 * as_read:
            mends.append("the axes x and z of the nodes swapped (transpose them)")
    if mends:
        raise GridError(
            f"{path}: mass is not conserved (median |div| {as_read:.3g} 1/s), but would be with"
            f" {' or with '.join(mends)}; where the file is right, pass check_mass_balance=False"
        )


def _sources(
    axes: list[FloatArray], wind: list[FloatArray], air: BoolArray, signs: list[float]
) -> float:
    """Median of |Σ sign · d part / d axis| [1/s] over nodes whose neighbours are air."""
    inner = air.copy()
    total = np.zeros(air.shape)
    for n, (axis, part, sign) in enumerate(zip(axes, wind, signs, strict=True)):
        inner &= np.roll(air, 1, n) & np.roll(air, -1, n)
        border = [slice(None)] * air.ndim
        for border[n] in (slice(0, 1), slice(-1, None)):
            inner[tuple(border)] = False
        total += sign * np.gradient(part, axis, axis=n)
    return float(np.median(np.abs(total[inner]))) if inner.any() else 0.0


def even_out(
    path: Path, names: list[str], axes: list[FloatArray], wind: list[FloatArray], solid: BoolArray
) -> tuple[list[FloatArray], list[FloatArray], BoolArray]:
    """Resample uneven axes linearly at their least spacing; between air and solid is solid."""
    axes = list(axes)
    for n, axis in enumerate(axes):
        steps = np.diff(axis)
        mean = float(axis[-1] - axis[0]) / len(steps)
        if np.abs(axis - (axis[0] + mean * np.arange(len(axis)))).max() <= 1e-3 * mean:
            continue
        count = round(float(axis[-1] - axis[0]) / float(steps.min())) + 1
        nodes = solid.size // len(axis) * count
        if nodes > MOST_NODES:
            raise GridError(
                f"{path}: axis {names[n]} is uneven (spacing {steps.min():.4g} …"
                f" {steps.max():.4g} m) and would take {count} even places, {nodes} nodes in all;"
                f" the most is {MOST_NODES}: resample it before"
            )
        even = np.linspace(axis[0], axis[-1], count)
        cell = np.clip(np.searchsorted(axis, even, side="right") - 1, 0, len(axis) - 2)
        column = [1] * solid.ndim
        column[n] = count
        weight = (even - axis[cell]) / steps[cell]
        # A place of the axis itself, but for rounding, knows nothing of its neighbours.
        whole = np.round(weight)
        weight = np.where(np.abs(weight - whole) < 1e-9, whole, weight).reshape(column)
        wind = [
            (1.0 - weight) * part.take(cell, axis=n) + weight * part.take(cell + 1, axis=n)
            for part in wind
        ]
        solid = (solid.take(cell, axis=n) & (weight < 1.0)) | (
            solid.take(cell + 1, axis=n) & (weight > 0.0)
        )
        axes[n] = even
    return axes, wind, solid
