"""Measurements that come, and cannot be flown with: never lost while in control.

Fixes that come too seldom for the estimate to be confident between them, or that say of
themselves that they are uncertain by metres; positions and attitudes that stand, jump, or are
wrong for good.  In rough air, without accelerometers, over the board: with clearance and fence set
as an operator sets them for one line.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, nan, radians
from random import Random
from typing import Any, NamedTuple

import pytest

from tgl_soar.air.field import WindField
from tgl_soar.autopilot import Output, mode_name, reason_text
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.envelope import Fence, outside
from tgl_soar.control.supervisor import CAPTURING, HOLDING, RECOVERING, RELEASED, SOARING
from tgl_soar.geometry import quaternion_from_euler, quaternion_product
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import STEPPED_SOURCE, Inputs, PositionFix

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AROUND_LINE_B = {
    "CLEAR_MIN": 0.4, "FENCE_Z_MIN": 0.8, "FENCE_Z_MAX": 2.6, "FENCE_Y_MAX": 1.2,
    "FENCE_X_MIN": -1.0, "FENCE_X_MAX": 2.2,
}  # fmt: skip
FENCE = Fence(x_min_m=-1.0, x_max_m=2.2, y_max_m=1.2, z_min_m=0.8, z_max_m=2.6)  # the same
TURBULENCE = 0.05
START_S = 4.0  # of what goes wrong; on the line since the third second
LONGEST_S = 20.0  # of a flight; long before that it is released
DT_S = 0.005

Corrupt = Callable[[Inputs], Inputs]


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


class AtRandom:
    """A fix after 0.5 to 1.9 s, without a velocity, true and as certain as ever."""

    def __init__(self, seed: int) -> None:
        self._uniform = Random(seed).uniform
        self._due_s = -1.0
        self._fix: PositionFix | None = None

    def __call__(self, inputs: Inputs) -> Inputs:
        fix = inputs.position
        if self._fix is None or fix.time_s >= self._due_s:
            self._due_s = fix.time_s + self._uniform(0.5, 1.9)
            self._fix = fix._replace(
                velocity_north_mps=nan, velocity_east_mps=nan, velocity_down_mps=nan
            )
        return inputs._replace(position=self._fix)


class Flown(NamedTuple):
    """What came of a flight."""

    outputs: list[Output]  # of the ticks in control, and the one that ends it
    crashed: str  # what it ran into while in control
    outside_s: float  # truly outside the fence while in control

    def changes(self) -> list[tuple[str, str]]:
        return self.changes_since(0.0)

    def changes_since(self, time_s: float) -> list[tuple[str, str]]:
        rows = [o for o in self.outputs if o.reason and o.time_s >= time_s]
        return [(mode_name(o.mode), reason_text(o.reason)) for o in rows]


@cache
def tunnel() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    values = values.changed({**line_parameters(site.lines["b"]), **AROUND_LINE_B})
    return airframe, site, values, build_field(site.air)


def fly(
    seed: int, corrupt: Corrupt, turbulence: float = TURBULENCE, longest_s: float = LONGEST_S
) -> Flown:
    """On line b, until it is released, crashes, or the time is over."""
    airframe, site, values, field = tunnel()
    world = make_world(airframe, site, seed=seed, turbulence=turbulence, field=field)
    loop = SpoiltLoop(world, values)
    loop.corrupt = corrupt
    outputs: list[Output] = []
    outside_s = 0.0
    for _ in range(round(longest_s / DT_S)):
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

    corrupt: Corrupt
    start_s = START_S

    def _decide(self, inputs: Inputs) -> Output:
        return super()._decide(self.corrupt(inputs) if inputs.time_s >= self.start_s else inputs)


@pytest.mark.parametrize(
    ("interval_s", "sigma_m", "noise_m", "velocity", "seed"),
    [
        # Each resets the place; none makes it confident for long.
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


@pytest.mark.parametrize("seed", [21, 33])
def test_nobody_glides_blindly_into_the_ground_or_through_the_fence(seed: int) -> None:
    """Each of these fixes restarts the estimate at rest: it stays where it is while the aircraft
    glides away from it.  So what a glide sinks in still air counts as height that is gone."""
    flown = fly(seed, AtRandom(seed))
    assert not flown.crashed
    assert [mode for mode, _ in flown.changes()][-2:] == ["recovering", "released"]
    assert reason_text(flown.outputs[-1].reason) == "too low"
    assert flown.outside_s == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_position_that_is_frozen_is_as_good_as_none(seed: int) -> None:
    """Where it repeats itself and where nothing comes, all is flown alike, from the first tick."""

    def nothing() -> Corrupt:
        last: list[PositionFix] = []

        def corrupt(inputs: Inputs) -> Inputs:
            last.append(inputs.position)
            return inputs._replace(position=last[0])

        return corrupt

    silent, frozen = fly(seed, nothing()), fly(seed, standing("position"))
    assert [o.command for o in frozen.outputs] == [o.command for o in silent.outputs]
    assert frozen.changes() == silent.changes()
    assert not frozen.crashed


class InSteps:
    """As GLOBAL_POSITION_INT: numbers in steps, so wide that the noise of these fixes, unlike an
    autopilot's estimate, hides within them.  Counts those that repeat the one before."""

    def __init__(self, step_m: float, step_mps: float) -> None:
        self._steps = {"_m": step_m, "_mps": step_mps}
        self.repeated = 0
        self._last: tuple[float, ...] = ()

    def __call__(self, inputs: Inputs) -> Inputs:
        fix = inputs.position
        stepped: dict[str, Any] = {
            name: step * round(getattr(fix, name) / step)
            for name in fix._fields
            for ending, step in self._steps.items()
            if name.endswith(ending) and name != "sigma_m"
        }
        self.repeated += self._last == tuple(stepped.values())
        self._last = tuple(stepped.values())
        return inputs._replace(position=fix._replace(source=STEPPED_SOURCE, **stepped))


def test_a_hover_in_calm_air_repeats_what_has_steps_and_is_flown_on() -> None:
    steps = InSteps(0.02, 0.1)
    flown = fly(1, steps, turbulence=1e-6)
    assert not flown.crashed
    assert steps.repeated > 0.5 * len(flown.outputs)
    assert {o.mode for o in flown.outputs if o.time_s > START_S} == {SOARING}
    assert not any(o.quality.fix_refused for o in flown.outputs if o.active)


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


# --- attitude and position that stand, jump, or are wrong --------------------------------------


def standing(part: str, **still: float) -> Corrupt:
    """One stream goes on with the sample of the first tick, and says that it stands still."""
    first: list[Any] = []

    def corrupt(inputs: Inputs) -> Inputs:
        sample = getattr(inputs, part)
        first.append(sample)
        again = first[0]._replace(sequence=sample.sequence, time_s=sample.time_s, **still)
        return inputs._replace(**{part: again})

    return corrupt


NO_RATES = {
    "roll_rate_frd_radps": 0.0, "pitch_rate_frd_radps": 0.0, "yaw_rate_frd_radps": 0.0,
}  # fmt: skip
NO_VELOCITY = {
    "velocity_north_mps": 0.0, "velocity_east_mps": 0.0, "velocity_down_mps": 0.0,
}  # fmt: skip


def turned(inputs: Inputs, roll_rad: float, heading_rad: float) -> Inputs:
    """The attitude turned: about the vertical first, then about the nose."""
    a = inputs.attitude
    q = quaternion_product(*quaternion_from_euler(0.0, 0.0, heading_rad), a.qw, a.qx, a.qy, a.qz)
    q = quaternion_product(*q, *quaternion_from_euler(roll_rad, 0.0, 0.0))
    return inputs._replace(attitude=a._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3]))


def rolls_from_side_to_side(inputs: Inputs) -> Inputs:
    side = 1.0 if inputs.attitude.sequence % 2 else -1.0
    return turned(inputs, side * radians(60.0), 0.0)


def every_other_is_rolled(inputs: Inputs) -> Inputs:
    side = (0.0, 1.0, 0.0, -1.0)[inputs.attitude.sequence % 4]
    return turned(inputs, side * radians(60.0), 0.0)


def points_backwards(inputs: Inputs) -> Inputs:
    return turned(inputs, 0.0, radians(170.0))


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("corrupt", "modes", "reason", "within_s"),
    [
        # AGE_FROZEN, and for a position what it may be held, and recovered while the height lasts.
        (lambda: standing("attitude", **NO_RATES), ["released"], "attitude lost", 1.0),
        (
            lambda: standing("position", **NO_VELOCITY),
            *(["holding", "recovering", "released"], "too low", 4.0),
        ),
        # All refused: AGE_ATT_MAX.
        (lambda: rolls_from_side_to_side, ["released"], "attitude lost", 0.2),
        # Half of them refused; those that are right may be flown with for AGE_FROZEN.
        (lambda: every_other_is_rolled, ["released"], "attitude lost", 1.0),
        # Refused until five agree: then it is so, or the autopilot is confident in it.
        (lambda: points_backwards, ["released"], "nose does not point upwind", 5 * DT_S),
    ],
)
def test_what_stands_jumps_or_is_wrong_is_handed_over_for(
    seed: int, corrupt: Callable[[], Corrupt], modes: list[str], reason: str, within_s: float
) -> None:
    flown = fly(seed, corrupt())
    assert not flown.crashed
    changes = [(o.time_s, mode_name(o.mode)) for o in flown.outputs if o.reason]
    assert [mode for when, mode in changes if when >= START_S] == modes
    last = flown.outputs[-1]
    assert reason_text(last.reason) == reason
    assert last.time_s - START_S <= within_s + 2 * DT_S  # what was on its way arrives first
    assert flown.outside_s <= 0.3  # as above


@pytest.mark.parametrize("rate", [30.0, -30.0, 69.0, 1e3, 1e30, -1e300, inf, nan])
@pytest.mark.parametrize("field", list(NO_RATES))
def test_one_attitude_with_a_huge_rate_hardly_moves_a_surface(field: str, rate: float) -> None:
    """Rates that no gyro measures, or that an aircraft cannot have a tick later, count as none: for
    two samples they are the differences of the angles, of 0.1 deg noise each.  That is 0.35 rad/s
    or some hundredths of travel; and it is gone within a time constant of the filters or two."""
    wild: dict[str, Any] = {field: rate}
    corrupted_s: list[float] = []

    def once(inputs: Inputs) -> Inputs:
        if not corrupted_s:
            corrupted_s.append(inputs.time_s)
            return inputs._replace(attitude=inputs.attitude._replace(**wild))
        return inputs

    (plain, corrupted) = (fly(1, way, 0.01, START_S + 0.5) for way in (lambda i: i, once))
    assert not corrupted.changes_since(START_S)
    off = [
        max(abs(u - v) for u, v in zip(a.command, b.command, strict=True))
        for a, b in zip(plain.outputs, corrupted.outputs, strict=True)
        if a.active
    ]
    assert max(off) <= 0.1
    assert sum(u > 0.03 for u in off) <= 6
