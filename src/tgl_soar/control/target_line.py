"""The target gradient line (TGL) and the distance to it, e_rho (eq. 14).

A line in the vertical plane, extruded along y to a plane: a point p0 = (x0, z0) and an
inclination eta from the downstream axis.

    t = (cos eta, sin eta)          up along the line
    n = (-sin eta, cos eta)         across it, upstream
    e_rho = n · (p - p0)            positive when the aircraft is upstream of the line

eta = lean + 90°: operators think in lean from the vertical, positive when the upper end leans
upwind.  The paper prints s |A x1 + B z1 + C| / (A² + B²); the denominator of a distance is
√(A² + B²).  A horizontal line (eta = 0 or 180°) has no upstream side and is refused where
parameters are checked.

The line that is flown follows the operator's at limited speed, because a step of the line
throws the aircraft off.  Its motion, seen at the aircraft, is

    turning     at up to turn_rate about the point of the line nearest the aircraft, so that
                turning alone moves the line by nothing there
    sliding     along n by the distance between the two lines at the aircraft, at up to
                speed, with limited acceleration a, braking in time: v² + a v dt <= 2 a |distance|
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple

from tgl_soar.types import VehicleState


class TargetLine(NamedTuple):
    """A target gradient line."""

    x_m: float
    z_m: float
    eta_rad: float


class LineLimits(NamedTuple):
    """How fast a line may move."""

    speed_mps: float  # across itself, at the aircraft
    acceleration_mps2: float
    turn_rate_radps: float


class LineState(NamedTuple):
    """The line as it is flown now."""

    x_m: float
    z_m: float
    eta_rad: float
    speed_mps: float  # across itself, positive upstream
    moving: bool


class LineTracking(NamedTuple):
    """The line that is flown, or else would be, and where the aircraft is from it."""

    x_m: float
    z_m: float
    eta_rad: float
    moving: bool
    e_rho_m: float  # to the line that is flown
    e_rho_rate_mps: float


def eta_from_lean(lean_rad: float) -> float:
    """Inclination from the downstream axis [rad] of a lean from the vertical [rad]."""
    return lean_rad + 0.5 * pi


def e_rho(x0_m: float, z0_m: float, eta_rad: float, x_m: float, z_m: float) -> float:
    """Signed distance [m] of (x_m, z_m) from the line, positive upstream (eq. 14)."""
    return cos(eta_rad) * (z_m - z0_m) - sin(eta_rad) * (x_m - x0_m)


def line_at(target: TargetLine, x_m: float, z_m: float) -> LineState:
    """A line through (x_m, z_m) at rest, parallel to `target`: where a capture starts."""
    return LineState(x_m=x_m, z_m=z_m, eta_rad=target.eta_rad, speed_mps=0.0, moving=True)


def line_step(
    limits: LineLimits,
    state: LineState,
    target: TargetLine,
    x_m: float,
    z_m: float,
    dt_s: float,
) -> LineState:
    """Move the flown line towards `target` for dt_s seconds, as the aircraft at (x, z) sees it."""
    if (
        state.x_m == target.x_m
        and state.z_m == target.z_m
        and state.eta_rad == target.eta_rad
        and state.speed_mps == 0.0
    ):
        return state if not state.moving else state._replace(moving=False)

    # The point of the line nearest the aircraft: it turns there and slides from there.
    across = e_rho(state.x_m, state.z_m, state.eta_rad, x_m, z_m)
    pivot_x = x_m + across * sin(state.eta_rad)
    pivot_z = z_m - across * cos(state.eta_rad)

    turn = target.eta_rad - state.eta_rad
    turn_most = limits.turn_rate_radps * dt_s
    eta = state.eta_rad + max(-turn_most, min(turn_most, turn))

    to_go = across - e_rho(target.x_m, target.z_m, target.eta_rad, x_m, z_m)
    change = limits.acceleration_mps2 * dt_s
    # Braking in steps of dt, v dt + (v - a dt) dt + … = v² / 2a + v dt / 2: solved for v.
    half = 0.5 * change
    brakes = sqrt(half * half + 2.0 * limits.acceleration_mps2 * abs(to_go)) - half
    wanted = min(limits.speed_mps, brakes)
    if to_go < 0.0:
        wanted = -wanted
    speed = state.speed_mps + max(-change, min(change, wanted - state.speed_mps))

    last_move = min(limits.speed_mps, max(abs(speed), change)) * dt_s
    arrives = abs(to_go) <= last_move and abs(speed) <= 2.0 * change
    if arrives and eta == target.eta_rad:
        return LineState(
            x_m=target.x_m, z_m=target.z_m, eta_rad=target.eta_rad, speed_mps=0.0, moving=dt_s > 0.0
        )
    return LineState(
        x_m=pivot_x - speed * dt_s * sin(eta),
        z_m=pivot_z + speed * dt_s * cos(eta),
        eta_rad=eta,
        speed_mps=speed,
        moving=True,
    )


def line_tracking(line: LineState, vehicle: VehicleState) -> LineTracking:
    """The aircraft's distance from a line, and how fast it grows.

    The rate is the distance of the velocity vector from a line through the origin, less the
    line's own speed.
    """
    across = e_rho(0.0, 0.0, line.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps)
    return LineTracking(
        x_m=line.x_m,
        z_m=line.z_m,
        eta_rad=line.eta_rad,
        moving=line.moving,
        e_rho_m=e_rho(line.x_m, line.z_m, line.eta_rad, vehicle.x_m, vehicle.z_m),
        e_rho_rate_mps=across - line.speed_mps,
    )
