"""What the finite width of an open jet does to the air in front of a board.

In two dimensions the board turns the whole jet.  A jet of width B with open sides gives way:
air escapes sideways, and the deflection dies out above the board within about B / π.  This
module finds the correction, in the plane of symmetry y = 0, of the exact two-dimensional flow
of `freestream`, whose potential is φ (speed 1 on its upper free streamline).

The true potential Φ = φ + h obeys Laplace's equation in x, y, z.  Its sides y = ± B/2 are
free from the lip on (x > −d): there the air has the pressure of the room, hence the speed
1 − ε, and flows straight on to first order,

    φ + h = φ(−d, z) + (1 − ε) (x + d)        h = S(x, z)  at y = ± B/2

Expand h across the width in cos(k_n y), k_n = (2 n + 1) π / B, with the mean weights
c_n = 4 (−1)ⁿ / (π (2 n + 1)) of 1:

    h_xx + h_zz − k_n² (h − c_n S) = 0        h = Σ h_n at y = 0

Nozzle walls, floor and board let nothing through (∂h/∂n = 0), far upstream the nozzle carries
its flow (∂h/∂x = 0).  On the upper free surface the speed is 1 − ε too, h_n = −ε c_n (φ − φ_lip),
on the lower one h_n = c_n (C − ε (φ − φ_tip)).  ε and C follow from the Kutta condition: no
infinite speed at the lip nor at the tip.  Laplace's equation is solved in the strip of φ and ψ
of the exact flow, where it keeps its form and every boundary is straight; k_n² is multiplied by
1 / q².

Approximations, and what they cost: conditions on free surfaces are set where the
two-dimensional jet has them, to first order; the sides stay plane; in the nozzle the modes
exchange nothing.  B → ∞ gives the two-dimensional flow back exactly.
"""

from __future__ import annotations

from itertools import pairwise
from math import log, pi
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.air.freestream import ComplexArray, FreeJetMap, slowness

MODES = 6


class Relief(NamedTuple):
    """The correction h on a graded mesh of the strip χ = π (φ + iψ) / Q."""

    chi_along: FloatArray  # Re χ of the mesh lines, (n,)
    chi_across: FloatArray  # Im χ, (m,)
    potential: FloatArray  # h, (n, m)
    slowing: float  # ε
    jump: float  # C


class _Strip(NamedTuple):
    along: FloatArray
    across: FloatArray
    weight: FloatArray  # area · (Q/π)² / q² around each node, zero in the nozzle
    side: FloatArray  # S for ε = 0
    side_slowing: FloatArray  # ∂S/∂ε
    lip: int  # index along, on the upper line, where the free streamline begins
    tip: int  # the same on the lower line
    flow_per_chi: float  # Q/π


def relieve(net: FreeJetMap, width_m: float) -> Relief:
    """Correction of the two-dimensional flow `net` for a jet of a width [m]."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    strip = _strip(net)
    shape = strip.weight.shape
    laplace = _laplace(strip.along, strip.across)
    fixed = np.zeros(shape, dtype=bool)
    fixed[strip.lip :, -1] = True
    fixed[strip.tip :, 0] = True
    held, free = np.flatnonzero(fixed), np.flatnonzero(~fixed)
    # h is linear in ε and C: solve for (0, 0), for ∂/∂ε and for ∂/∂C.
    surface = np.zeros((3, *shape))
    surface[1, strip.lip :, -1] = (
        strip.flow_per_chi * (strip.along[strip.lip] - strip.along)[strip.lip :]
    )
    surface[1, strip.tip :, 0] = (
        strip.flow_per_chi * (strip.along[strip.tip] - strip.along)[strip.tip :]
    )
    surface[2, strip.tip :, 0] = 1.0
    side = np.stack([strip.side, strip.side_slowing, np.zeros(shape)])
    total = np.zeros((3, laplace.shape[0]))
    for n in range(MODES):
        wave = (2 * n + 1) * pi / width_m
        fraction = 4.0 * (-1) ** n / (pi * (2 * n + 1))
        pull = wave**2 * strip.weight.ravel()
        matrix = (laplace + diags(pull)).tocsr()
        solver = splu(matrix[free][:, free].tocsc())
        coupling = matrix[free][:, held]
        # The series alternates: half of the last term is its best estimate.
        last = 0.5 if n == MODES - 1 else 1.0
        for case in range(3):
            edge = fraction * surface[case].ravel()[held]
            right = (pull * fraction * side[case].ravel())[free] - coupling @ edge
            total[case, held] += last * edge
            total[case, free] += last * solver.solve(right)
    fields = total.reshape(3, *shape)
    strengths = np.array(
        [
            [_edge_strength(strip.along, field[:, -1], strip.lip) for field in fields],
            [_edge_strength(strip.along, field[:, 0], strip.tip) for field in fields],
        ]
    )
    slowing, jump = np.linalg.solve(strengths[:, 1:], -strengths[:, 0])
    potential = fields[0] + slowing * fields[1] + jump * fields[2]
    return Relief(
        chi_along=strip.along,
        chi_across=strip.across,
        potential=potential,
        slowing=float(slowing),
        jump=float(jump),
    )


def relieved_velocity(
    net: FreeJetMap, relief: Relief | None, chi: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """u, w at values of χ, the correction (if any) included; unit as in `freestream`."""
    velocity = 1.0 / slowness(net.jet, chi)  # u − i w
    if relief is not None:
        from scipy.interpolate import RectBivariateSpline

        spline = RectBivariateSpline(relief.chi_along, relief.chi_across, relief.potential)
        along = spline.ev(chi.real.ravel(), chi.imag.ravel(), dx=1).reshape(chi.shape)
        across = spline.ev(chi.real.ravel(), chi.imag.ravel(), dy=1).reshape(chi.shape)
        # ∇h = (h_φ − i h_ψ) dW/dζ as u − i w, with W the exact complex potential.
        velocity = velocity * (1.0 + (along - 1j * across) * (pi / net.jet.flow_m2ps))
    return velocity.real, -velocity.imag


def _graded(low: float, high: float, corners: list[float]) -> FloatArray:
    """Mesh lines from low to high through the corners, dense near them."""
    small, growth, big = 0.01, 0.15, 0.12
    lines = [low]
    for start, end in pairwise(sorted({low, high, *corners})):
        fine = np.linspace(start, end, 4001)
        distance = np.min([np.abs(fine - corner) for corner in corners], axis=0)
        density = 1.0 / np.minimum(big, small + growth * distance)
        count = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        count *= fine[1] - fine[0]
        cells = max(2, int(np.ceil(count[-1])))
        lines.extend(np.interp(np.linspace(0.0, count[-1], cells + 1), count, fine)[1:].tolist())
    return np.array(lines)


def _strip(net: FreeJetMap) -> _Strip:
    jet = net.jet
    lip, tip = log(jet.lip), log(jet.tip)
    along = _graded(float(net.chi[0, 0].real), float(net.chi[-1, 0].real), [lip, 0.0, tip])
    across = _graded(0.0, pi, [0.0, pi])
    chi = along[:, None] + 1j * np.clip(across, *net.BAND)[None, :]
    place = net.place_at(chi)
    unit = jet.flow_m2ps / pi
    lip_x = -jet.lip_ahead_m
    middle = 0.5 * (along[1:] + along[:-1])[:, None] + 0.5j * (across[1:] + across[:-1])[None, :]
    cell = np.abs(slowness(jet, middle)) ** 2 * unit**2
    cell *= np.diff(along)[:, None] * np.diff(across)[None, :]
    cell *= 0.5 * (place.real[1:, 1:] + place.real[:-1, :-1]) > lip_x
    weight = np.zeros(chi.shape)
    for a in (slice(None, -1), slice(1, None)):
        for b in (slice(None, -1), slice(1, None)):
            weight[a, b] += 0.25 * cell
    # φ in the plane of the lip as a function of height
    lines = range(len(across))
    lip_z = [np.interp(lip_x, place[:, k].real, place[:, k].imag) for k in lines]
    lip_chi = [np.interp(lip_x, place[:, k].real, along) for k in lines]
    start = np.interp(place.imag, lip_z, lip_chi)
    beyond = np.maximum(0.0, place.real - lip_x)
    side = np.where(beyond > 0.0, beyond - unit * (along[:, None] - start), 0.0)
    return _Strip(
        along=along,
        across=across,
        weight=weight,
        side=side,
        side_slowing=-beyond,
        lip=int(np.searchsorted(along, lip - 1e-9)),
        tip=int(np.searchsorted(along, tip - 1e-9)),
        flow_per_chi=unit,
    )


def _laplace(along: FloatArray, across: FloatArray):  # type: ignore[no-untyped-def]
    """−∇² by finite volumes on a rectangular mesh, no flux through its border; sparse."""
    from scipy.sparse import csr_matrix

    da, dc = np.diff(along), np.diff(across)
    wa, wc = np.zeros(len(along)), np.zeros(len(across))
    wa[:-1] += 0.5 * da
    wa[1:] += 0.5 * da
    wc[:-1] += 0.5 * dc
    wc[1:] += 0.5 * dc
    node = np.arange(len(along) * len(across)).reshape(len(along), len(across))
    first = np.concatenate([node[:-1].ravel(), node[:, :-1].ravel()])
    second = np.concatenate([node[1:].ravel(), node[:, 1:].ravel()])
    value = np.concatenate([(wc[None, :] / da[:, None]).ravel(), (wa[:, None] / dc[None]).ravel()])
    rows = np.concatenate([first, second, first, second])
    columns = np.concatenate([first, second, second, first])
    values = np.concatenate([value, value, -value, -value])
    return csr_matrix((values, (rows, columns)), shape=(node.size, node.size))


def _edge_strength(along: FloatArray, line: FloatArray, edge: int) -> float:
    """The factor of √r of h on the wall at a distance r ahead of an edge: an infinite speed."""
    r = along[edge] - along[:edge]
    near = (r > 0.02) & (r < 0.3)
    terms = np.column_stack([r[near] ** 0.5, r[near], r[near] ** 1.5])
    return float(np.linalg.lstsq(terms, line[:edge][near] - line[edge], rcond=None)[0][0])
