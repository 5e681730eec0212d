"""A world in which somebody holds the aircraft in a hand, and throws it.

Until the throw it stands where the start is, turned as it will be thrown.  The throw speeds it up
along its own x axis, evenly, from rest to the speed of the throw; then it flies.  What the
accelerometers feel of the hand is what a hand does: it carries the weight, and pushes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, sin
from typing import Final, NamedTuple

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.world import World
from tgl_soar.sim.world_step import WorldNow, world_step
from tgl_soar.types import SurfaceCommand

PUSH_S: Final = 0.25  # an arm swings through 0.6 m
# Who throws stands where the ground has come to this part of the crest's height, before the crest:
# thrown from farther down, the aircraft flies beyond where the wind carries it back to a line.
UP: Final = 0.9
SHOULDER_M: Final = 1.9  # a hand over the ground


def place_to_throw(profile: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """x and z [m] of a hand before the crest.  profile: of the ground, x growing; the wind comes
    from small x.  Errors: ValueError where it does not rise."""
    top = max(range(len(profile)), key=lambda i: profile[i][1])
    foot_m = min((z for _, z in profile[: top + 1]))
    wanted_m = foot_m + UP * (profile[top][1] - foot_m)
    for (x0, z0), (x1, z1) in reversed([*pairwise(profile[: top + 1])]):
        if z0 <= wanted_m:
            return x0 + (x1 - x0) * (wanted_m - z0) / (z1 - z0), wanted_m + SHOULDER_M
    raise ValueError("the ground does not rise towards a crest, so there is nowhere to throw from")


class Throw(NamedTuple):
    """How the aircraft is thrown; angles from straight upwind and from level."""

    time_s: float  # when the arm begins to swing
    speed_mps: float  # over the ground; 0: it is released
    roll_rad: float
    pitch_rad: float
    heading_rad: float


class ThrownWorld(World):
    """A world as it was made, from a hand."""

    def __init__(self, world: World, throw: Throw) -> None:
        vars(self).update(vars(world))  # in place of `World`'s own: it is made already
        self.throw = throw
        self._set(self.now._replace(aircraft=self._in_hand(0.0)))

    @property
    def is_free(self) -> bool:
        """Whether it has left the hand."""
        return self.time_s > self._until_s

    @property
    def _until_s(self) -> float:
        return self.throw.time_s + (PUSH_S if self.throw.speed_mps > 0.0 else 0.0)

    def _stepped(self, command: SurfaceCommand) -> WorldNow:
        """`self.steps` counts this step already."""
        if self.is_free:
            return world_step(self.parts, self.now, self.steps, command, held=False)
        held = self.now._replace(aircraft=self._in_hand(self.time_s))
        now = world_step(self.parts, held, self.steps, command, held=True)
        if not self.throw.time_s <= self.time_s or now.samples.imu.sequence == 0:
            return now
        imu = now.samples.imu
        push = self.throw.speed_mps / PUSH_S if self.throw.speed_mps > 0.0 else 0.0
        measured = imu._replace(force_x_frd_mps2=imu.force_x_frd_mps2 + push)
        return now._replace(samples=now.samples._replace(imu=measured))

    def _in_hand(self, time_s: float) -> AircraftState:
        throw = self.throw
        swung_s = min(PUSH_S, max(0.0, time_s - throw.time_s))
        speed = throw.speed_mps * swung_s / PUSH_S
        way = 0.5 * speed * swung_s
        level = cos(throw.pitch_rad)
        along = (
            -level * cos(throw.heading_rad),
            level * sin(throw.heading_rad),
            sin(throw.pitch_rad),
        )
        qw, qx, qy, qz = quaternion_from_euler(throw.roll_rad, throw.pitch_rad, throw.heading_rad)
        start = self.start
        return self.now.aircraft._replace(
            x_m=start.x_m + way * along[0],
            y_m=start.y_m + way * along[1],
            z_m=start.z_m + way * along[2],
            velocity_x_mps=speed * along[0],
            velocity_y_mps=speed * along[1],
            velocity_z_mps=speed * along[2],
            qw=qw,
            qx=qx,
            qy=qy,
            qz=qz,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        )
