"""The inertial track: the way of the aircraft by its accelerometers alone.

From sample to sample, acceleration linear in between,

    v(t + h) = v + (a0 + a1) h / 2            p(t + h) = p + v h + (2 a0 + a1) h² / 6

and of the last half second it keeps nodes, between which a cubic through position and velocity
of both ends says where the track was: at the time when a late fix was true.  With nodes every
h = 64 ms that cubic is wrong by h⁴ / 384 times the second derivative of the acceleration, some
ten micrometres in the roughest air.

The track drifts away from the truth and nobody calls it back: `fix_filter` knows by how much it
is wrong.  Where nobody measures accelerations it goes straight on.

x, y, z  m  soaring frame       v  m/s       a  m/s²
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.types import INFINITE

NODES: Final = 8
NODE_S: Final = 0.064  # from one node to the next, or one sample where those are farther apart


Place = tuple[float, float, float, float, float, float]  # x, y, z [m], velocities [m/s]


class Node(NamedTuple):
    """A point of the track."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float


Nodes = tuple[Node, Node, Node, Node, Node, Node, Node, Node]  # NODES of them, oldest first


class Track(NamedTuple):
    """The track up to its last sample, and the acceleration with which it goes on."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    ax_mps2: float
    ay_mps2: float
    az_mps2: float
    nodes: Nodes


def new_track(time_s: float) -> Track:
    """A track that begins here and now, at rest in the origin."""
    node = Node(
        time_s=time_s,
        x_m=0.0,
        y_m=0.0,
        z_m=0.0,
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        climb_mps=0.0,
    )
    two = (node, node)
    four = two + two
    return Track(
        time_s=time_s,
        x_m=0.0,
        y_m=0.0,
        z_m=0.0,
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        climb_mps=0.0,
        ax_mps2=0.0,
        ay_mps2=0.0,
        az_mps2=0.0,
        nodes=four + four,
    )


def track_moved(
    track: Track, time_s: float, ax_mps2: float, ay_mps2: float, az_mps2: float
) -> Track:
    """The track carried on to a later time, at which the acceleration is this."""
    start, x, y, z, vx, vy, vz, bx, by, bz, nodes = track
    h = time_s - start
    half, sixth = 0.5 * h, h * h / 6.0
    x += vx * h + (2.0 * bx + ax_mps2) * sixth
    y += vy * h + (2.0 * by + ay_mps2) * sixth
    z += vz * h + (2.0 * bz + az_mps2) * sixth
    vx += (bx + ax_mps2) * half
    vy += (by + ay_mps2) * half
    vz += (bz + az_mps2) * half
    if time_s - nodes[-1].time_s >= NODE_S:
        nodes = nodes[1:] + (  # noqa: RUF005 - numba takes only this form
            Node(
                time_s=time_s,
                x_m=x,
                y_m=y,
                z_m=z,
                velocity_x_mps=vx,
                velocity_y_mps=vy,
                climb_mps=vz,
            ),
        )
    return Track(
        time_s=time_s,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=vz,
        ax_mps2=ax_mps2,
        ay_mps2=ay_mps2,
        az_mps2=az_mps2,
        nodes=nodes,
    )


def track_at(track: Track, time_s: float) -> Place:
    """Where the track is or was; before its oldest node it is taken as straight."""
    start, x, y, z, vx, vy, vz, ax, ay, az, nodes = track
    if time_s >= start:
        h = time_s - start
        q = 0.5 * h * h
        return (
            x + vx * h + ax * q,
            y + vy * h + ay * q,
            z + vz * h + az * q,
            vx + ax * h,
            vy + ay * h,
            vz + az * h,
        )
    later = Node(
        time_s=start, x_m=x, y_m=y, z_m=z, velocity_x_mps=vx, velocity_y_mps=vy, climb_mps=vz
    )
    for i in range(NODES - 1, -1, -1):
        if nodes[i].time_s <= time_s:
            return _between(nodes[i], later, time_s)
        later = nodes[i]
    h = time_s - later.time_s
    _, x, y, z, vx, vy, vz = later
    return x + vx * h, y + vy * h, z + vz * h, vx, vy, vz


def oldest_s(track: Track) -> float:
    """The time before which nobody knows where the track was; -inf: its beginning is remembered."""
    first, second = track.nodes[0].time_s, track.nodes[1].time_s
    return first if first < second else -INFINITE


def _between(a: Node, b: Node, time_s: float) -> Place:
    """The cubic through both ends' positions and velocities (Hermite)."""
    h = b.time_s - a.time_s  # above 0: a is not after time_s, b is
    s = (time_s - a.time_s) / h
    up = s * s * (3.0 - 2.0 * s)
    out, back = s * (1.0 - s) * (1.0 - s) * h, s * s * (s - 1.0) * h
    slope = 6.0 * s * (1.0 - s) / h
    leave, arrive = (1.0 - s) * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)
    dx, dy, dz = b.x_m - a.x_m, b.y_m - a.y_m, b.z_m - a.z_m
    return (
        a.x_m + up * dx + out * a.velocity_x_mps + back * b.velocity_x_mps,
        a.y_m + up * dy + out * a.velocity_y_mps + back * b.velocity_y_mps,
        a.z_m + up * dz + out * a.climb_mps + back * b.climb_mps,
        slope * dx + leave * a.velocity_x_mps + arrive * b.velocity_x_mps,
        slope * dy + leave * a.velocity_y_mps + arrive * b.velocity_y_mps,
        slope * dz + leave * a.climb_mps + arrive * b.climb_mps,
    )
