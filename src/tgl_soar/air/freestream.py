"""Exact free-streamline flow of a two-dimensional jet over an inclined board.

A nozzle (floor z = 0, roof at z = H ending in a lip at x = -d) blows along the floor onto a
board of length L that rises from the foot x = z = 0 at an angle β and ends in a tip.  From the
lip springs the upper free streamline, at the pressure of the room, of speed q_e; from the tip
the lower one, at the pressure of the wake, of speed k q_e (k = 1: the wake has the room's
pressure).  The flow is irrotational and steady (Kirchhoff; see Milne-Thomson, Theoretical
Hydrodynamics, ch. XI).

With φ + iψ the complex potential, t = exp(π (φ + iψ) / Q), and Ω = ln(q/q_e) − iθ (speed q,
direction θ), the half plane t is mapped onto the first quadrant

    T = √((t − b) / (t + a)),    t = b at the tip, −a at the lip, 1 at the foot, 0 upstream

where walls lie on the imaginary axis (foot at T = i c) and free streamlines on the real one.
θ is given on walls and ln q on free streamlines, which is solved by

    Ω = (β/π) ln((T − i c)/(T + i c)) + (ln k / (iπ)) ln((T − 1)/(T + 1))

and the place follows from x + i z = ∫ exp(−Ω)/q_e d(φ + iψ).  a and b follow from the two
lengths d and L.  With k > 1 the jet bends down behind the tip with a curvature that tends to
ln k / (its thickness), as it must between two pressures.
"""

from __future__ import annotations

from math import log, pi, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray

ComplexArray = NDArray[np.complex128]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class FreeJet(NamedTuple):
    """One solved flow, for the speed 1 on the upper free streamline."""

    slope_rad: float  # β
    nozzle_height_m: float  # H
    board_length_m: float  # L
    lip_ahead_m: float  # d
    log_wake_speed: float  # ln k
    lip: float  # a
    tip: float  # b
    nozzle_speed: float  # speed far upstream in the nozzle, of q_e = 1

    @property
    def flow_m2ps(self) -> float:
        """Q, the flow per metre of width, for q_e = 1 m/s."""
        return self.nozzle_speed * self.nozzle_height_m


def solve_free_jet(
    slope_rad: float,
    nozzle_height_m: float,
    board_length_m: float,
    lip_ahead_m: float,
    wake_speed_ratio: float = 1.0,
) -> FreeJet:
    """Find a and b so that the board and the distance from lip to foot have their lengths.

    Errors: ValueError where no such flow was found.
    """
    from scipy.optimize import root

    kappa = log(wake_speed_ratio)

    def misfit(p: FloatArray) -> list[float]:
        length, ahead, _ = _lengths(slope_rad, kappa, nozzle_height_m, *np.exp(p))
        return [log(length / board_length_m), (ahead - lip_ahead_m) / board_length_m]

    found = root(misfit, [0.0, 2.5], tol=1e-12)
    if not found.success or max(abs(v) for v in misfit(found.x)) > 1e-9:
        raise ValueError(
            f"no free-streamline flow for slope {slope_rad:.4f} rad, nozzle {nozzle_height_m} m,"
            f" board {board_length_m} m, lip {lip_ahead_m} m ahead of the foot,"
            f" wake speed ratio {wake_speed_ratio}"
        )
    a, above = (float(v) for v in np.exp(found.x))
    _, _, nozzle_speed = _lengths(slope_rad, kappa, nozzle_height_m, a, above)
    return FreeJet(
        slope_rad=slope_rad,
        nozzle_height_m=nozzle_height_m,
        board_length_m=board_length_m,
        lip_ahead_m=lip_ahead_m,
        log_wake_speed=kappa,
        lip=a,
        tip=1.0 + above,
        nozzle_speed=nozzle_speed,
    )


def _lengths(
    slope_rad: float, kappa: float, nozzle_height_m: float, a: float, above: float
) -> tuple[float, float, float]:
    """Board length, distance from lip to foot, and nozzle speed, for q_e = 1 and b = 1 + above.

    On the walls T = i y and d(phi)/dy is real.  The floor and the roof reach infinitely far
    upstream, where the speed is the nozzle's; both distances are taken as excess over that.
    """
    b = 1.0 + above
    c, c0 = np.sqrt(above / (1.0 + a)), np.sqrt(b / a)
    nodes, weights = np.polynomial.legendre.leggauss(160)
    s, ds = 0.5 * (nodes + 1.0), 0.5 * weights

    def slowness(y: FloatArray) -> FloatArray:
        log_speed = slope_rad / pi * np.log(np.abs((y - c) / (y + c)))
        result: FloatArray = np.exp(-log_speed - kappa * (1.0 - 2.0 / pi * np.arctan(y)))
        return result

    nozzle_speed = float(1.0 / slowness(np.array([c0]))[0])
    flow = nozzle_speed * nozzle_height_m

    def dphi(y: FloatArray) -> FloatArray:
        y2 = y * y
        result: FloatArray = flow / pi * 2.0 * y * (a + b) / (1.0 + y2) / np.abs(b - a * y2)
        return result

    # s^2.5 spreads the nodes towards the foot, where the speed is singular (a corner).
    bunch, dbunch = s**2.5, 2.5 * s**1.5 * ds
    y = c * (1.0 - bunch)
    board = float(np.sum(slowness(y) * dphi(y) * c * dbunch))
    y = c + (c0 - c) * bunch
    floor = float(np.sum((slowness(y) - 1.0 / nozzle_speed) * dphi(y) * (c0 - c) * dbunch))
    y = c0 / s
    roof = float(np.sum((slowness(y) - 1.0 / nozzle_speed) * dphi(y) * c0 / (s * s) * ds))
    return board, floor - roof - float(np.log(a)) * flow / pi / nozzle_speed, nozzle_speed


def slowness(jet: FreeJet, chi: ComplexArray) -> ComplexArray:
    """exp(−Ω) = 1 / (u − i w), for q_e = 1, at χ = π (φ + iψ) / Q with 0 < Im χ < π."""
    t = np.exp(chi)
    big_t = np.sqrt((t - jet.tip) / (t + jet.lip))
    c = np.sqrt((jet.tip - 1.0) / (1.0 + jet.lip))
    omega = jet.slope_rad / pi * np.log((big_t - 1j * c) / (big_t + 1j * c))
    if jet.log_wake_speed != 0.0:
        omega = omega - 1j / pi * jet.log_wake_speed * np.log((big_t - 1.0) / (big_t + 1.0))
    result: ComplexArray = np.exp(-omega)
    return result


def advance(jet: FreeJet, start: ComplexArray, end: ComplexArray) -> ComplexArray:
    """Difference of place between two values of χ: the integral of slowness dφ + i dψ."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    total = np.zeros_like(middle)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        total += weight * slowness(jet, middle + node * half)
    return total * half * (jet.flow_m2ps / pi)


class FreeJetMap:
    """The flow as a net of streamlines: places x + i z, foot at 0, and their inverse."""

    # Im χ of the outermost lines: 1e-5 of the flow inside the boundaries, off their corners.
    BAND = (1e-5 * pi, (1.0 - 1e-5) * pi)

    def __init__(self, jet: FreeJet, upstream_m: float, downstream_m: float) -> None:
        self.jet = jet
        flow = jet.flow_m2ps
        # φ runs as slowly as x · nozzle speed upstream and as fast as x · 1 downstream.
        low = -upstream_m * jet.nozzle_speed * pi / flow
        high = downstream_m * max(1.0, np.exp(jet.log_wake_speed)) * pi / flow * 1.2
        phi = np.linspace(low, high, 500)
        # cosine spacing: lines crowd at the boundaries, where the corners are.
        psi = pi * (0.5 - 0.5 * np.cos(np.linspace(0.0, pi, 60)))
        psi = np.clip(psi, *self.BAND)
        self.chi: ComplexArray = phi[:, None] + 1j * psi[None, :]
        # From the middle line outwards, so that no integral runs past a corner at the border.
        rows = self.chi
        half = rows.shape[1] // 2
        spine = np.concatenate([[0.0], np.cumsum(advance(jet, rows[:-1, half], rows[1:, half]))])
        step = advance(jet, rows[:, :-1], rows[:, 1:])
        outwards = np.concatenate([np.zeros((len(phi), 1)), np.cumsum(step, axis=1)], axis=1)
        place = spine[:, None] + outwards - outwards[:, half : half + 1]
        # The lowest line rounds the corner at the foot; its straight parts meet there.
        place -= 1j * place[0, 0].imag
        middle = place[int(np.searchsorted(phi, 0.5 * log(jet.tip))), 0]
        self.place: ComplexArray = place - (middle.real - middle.imag / tan(jet.slope_rad))

    def locate(self, x_m: FloatArray, z_m: FloatArray) -> ComplexArray:
        """χ at places (any shape); a place outside the jet gets that of its nearest edge."""
        from scipy.spatial import cKDTree

        target = (x_m + 1j * z_m).ravel()
        net = self.place.ravel()
        tree = cKDTree(np.column_stack([net.real, net.imag]))
        nearest = tree.query(np.column_stack([target.real, target.imag]))[1]
        start, base = self.chi.ravel()[nearest], net[nearest]
        chi = start.copy()
        upper, lower = self.place[:, -1], self.place[:, 0]
        inside = target.imag < np.interp(target.real, upper.real, upper.imag)
        inside &= target.imag > np.interp(target.real, lower.real, lower.imag)
        target, start, base, found = target[inside], start[inside], base[inside], chi[inside]
        for _ in range(4):  # Newton; the net is so fine that the first step is nearly right
            miss = target - base - advance(self.jet, start, found)
            step = miss * (pi / self.jet.flow_m2ps) / slowness(self.jet, found)
            step *= np.minimum(1.0, 0.2 / np.maximum(np.abs(step), 1e-300))
            found = found + step
            found = found.real + 1j * np.clip(found.imag, *self.BAND)
        chi[inside] = found
        return chi.reshape(x_m.shape)

    def place_at(self, chi: ComplexArray) -> ComplexArray:
        """Places x + i z of values of χ between the ends of the net."""
        i = np.searchsorted(self.chi[:, 0].real, chi.real).clip(0, self.chi.shape[0] - 1)
        k = np.searchsorted(self.chi[0].imag, chi.imag).clip(0, self.chi.shape[1] - 1)
        place: ComplexArray = self.place[i, k] + advance(self.jet, self.chi[i, k], chi)
        return place
