"""Positions that come, and cannot be flown with: never lost with the surfaces in hand.

Fixes that come too seldom for the estimate to be confident between them, or that say of
themselves that they are uncertain by metres, in rough air, without accelerometers, over the
board: with clearance and fence set as an operator sets them for one line.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import nan
from random import Random
from typing import NamedTuple

import pytest

from tgl_soar.air.field import WindField
from tgl_soar.autopilot import Output, mode_name, reason_text
from tgl_soar.config import (
    Airframe,
    Site,
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.control.envelope import Fence, outside
from tgl_soar.control.supervisor import CAPTURING, HOLDING, RECOVERING, RELEASED, SOARING
from tgl_soar.parameters import ParameterSet
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import Inputs, PositionFix

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AROUND_LINE_B = {
    "CLEAR_MIN": 0.4, "FENCE_Z_MIN": 0.8, "FENCE_Z_MAX": 2.6, "FENCE_Y_MAX": 1.2,
    "FENCE_X_MIN": -1.0, "FENCE_X_MAX": 2.2,
}  # fmt: skip
FENCE = Fence(-1.0, 2.2, 1.2, 0.8, 2.6)  # the same
TURBULENCE = 0.05
START_S = 4.0  # of what goes wrong; on the line since the third second
LONGEST_S = 20.0  # of a flight; long before that it is released
DT_S = 0.005

Spoil = Callable[[Inputs], Inputs]


class Seldom:
    """A fix every so many seconds, with an uncertainty, noise of that size or none, with a velocity
    or without."""

    def __init__(
        self, interval_s: float, sigma_m: float, noise_m: float, velocity: bool, seed: int
    ) -> None:
        self._interval_s, self._sigma_m, self._noise_m = interval_s, sigma_m, noise_m
        self._velocity = velocity
        self._gauss = Random(seed).gauss
        self._taken_s = -1.0
        self._fix: PositionFix | None = None

    def __call__(self, inputs: Inputs) -> Inputs:
        fix = inputs.position
        if self._fix is None or fix.time_s - self._taken_s >= self._interval_s - 1e-9:
            self._taken_s, noise = fix.time_s, self._noise_m
            fix = fix._replace(
                sigma_m=self._sigma_m,
                north_m=fix.north_m + self._gauss(0.0, noise),
                east_m=fix.east_m + self._gauss(0.0, noise),
                down_m=fix.down_m + self._gauss(0.0, noise),
            )
            if not self._velocity:
                fix = fix._replace(
                    velocity_north_mps=nan, velocity_east_mps=nan, velocity_down_mps=nan
                )
            self._fix = fix
        return inputs._replace(position=self._fix)


class Flown(NamedTuple):
    """What came of a flight."""

    outputs: list[Output]  # of the ticks in control, and the one that ends it
    crashed: str  # what it ran into with the surfaces in hand
    outside_s: float  # truly outside the fence with the surfaces in hand

    def changes(self) -> list[tuple[str, str]]:
        return [(mode_name(o.mode), reason_text(o.reason)) for o in self.outputs if o.reason]


@cache
def tunnel() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    values = values.changed({**line_parameters(site.lines["b"]), **AROUND_LINE_B})
    return airframe, site, values, build_field(site.air)


def fly(seed: int, spoil: Spoil, turbulence: float = TURBULENCE) -> Flown:
    """On line b, until it is released, crashes, or the time is over."""
    airframe, site, values, field = tunnel()
    world = make_world(airframe, site, seed=seed, turbulence=turbulence, field=field)
    loop = SpoiltLoop(world, values)
    loop.spoil = spoil
    outputs: list[Output] = []
    outside_s = 0.0
    for _ in range(round(LONGEST_S / DT_S)):
        truth = world.truth
        output = loop.tick()
        outputs.append(output)
        if output.mode == RELEASED:
            break
        if output.active and outside(FENCE, truth.x_m, truth.y_m, truth.z_m):
            outside_s += DT_S
        if world.crashed:
            return Flown(outputs, world.crashed, outside_s)
    return Flown(outputs, "", outside_s)


class SpoiltLoop(ClosedLoop):
    """The closed loop with something between sensors and module."""

    spoil: Spoil

    def _decide(self, inputs: Inputs) -> Output:
        return super()._decide(self.spoil(inputs) if inputs.time_s >= START_S else inputs)


@pytest.mark.parametrize(
    ("interval_s", "sigma_m", "noise_m", "velocity", "seed"),
    [
        # Each starts the place afresh; none makes it confident for long.
        *((1.2, nan, 0.0, True, seed) for seed in (1, 2, 3, 4)),
        (0.8, nan, 0.0, True, 1),
        (1.6, nan, 0.0, False, 1),
        # Every fix of the source, and each says that it may be 1 m off.
        *((0.0, 1.0, 0.0, False, seed) for seed in (1, 2, 3, 4)),
        (0.2, 1.0, 1.0, False, 2),  # and is
        (0.0, 3.0, 0.0, False, 4),
    ],
)
def test_uncertain_or_rare_fixes_end_in_the_pilots_hands(
    interval_s: float, sigma_m: float, noise_m: float, velocity: bool, seed: int
) -> None:
    flown = fly(seed, Seldom(interval_s, sigma_m, noise_m, velocity, seed))
    assert not flown.crashed
    last = flown.outputs[-1]
    assert last.mode == RELEASED
    assert reason_text(last.reason) in ("position lost", "outside the fence", "too low")
    # In control without a position for no longer than it may hold and recover.
    in_hand = [o for o in flown.outputs if o.mode in (CAPTURING, SOARING)]
    assert last.time_s - in_hand[-1].time_s <= 2.0 + 2.0 + DT_S + 1e-9
    # Of the fence the estimate is judged: 0.3 m are the most that a confident one may be wrong
    # by (three times EST_SD_MAX), and at the 1 m/s of a sinking flight that takes 0.3 s.
    assert flown.outside_s <= 0.3


def test_what_is_confident_again_in_time_is_flown_on_with() -> None:
    """Half a second without a fix is no reason to hand over."""
    last: list[PositionFix] = []

    def gap(inputs: Inputs) -> Inputs:
        if inputs.time_s >= START_S + 0.5:
            return inputs
        last.append(inputs.position)
        return inputs._replace(position=last[0])

    flown = fly(1, gap, turbulence=0.01)
    modes = [mode for mode, _ in flown.changes()]
    assert modes[-3:] == ["holding", "capturing", "soaring"]
    assert not any(o.mode in (RECOVERING, RELEASED) for o in flown.outputs)
    assert any(o.mode == HOLDING for o in flown.outputs)
