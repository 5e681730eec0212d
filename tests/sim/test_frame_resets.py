"""The autopilot's estimator is reset in flight: the aircraft stays where its lift is."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from math import dist, radians
from typing import NamedTuple

import pytest
from test_wrong_measurements import SpoiltLoop, turned

from tgl_soar.autopilot import Output, mode_name, reason_text
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.control.supervisor import CAPTURING, RECOVERING, RELEASED, SOARING
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.geometry import SoaringFrame, ned_vector_from_soaring
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.reports import FrameWords, ReckoningWords
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import Inputs

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/hill.toml")
TURBULENCE = 0.01
DT_S = 0.005
RESET_S, STAY_S = 8.0, 8.0  # soaring since the sixth second
E_RHO_M = 0.05  # as far as a reset may move e_rho; gusts of 1 % make a centimetre of it

Words = tuple[int, str]
Corrupt = Callable[[SoaringFrame, Inputs], Inputs]


class Flown(NamedTuple):
    """A flight on the hill, from the reset on."""

    outputs: list[Output]
    places: list[tuple[float, float]]  # x and z [m], in truth

    @property
    def modes(self) -> list[str]:
        return [mode_name(o.mode) for o in self.outputs if o.reason]


def fly(corrupt: Corrupt, line_moves_m: float = 0.0, **parameters: float) -> Flown:
    """line_moves_m: downstream, by the operator, when the reset begins."""
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    line = next(iter(site.lines.values()))
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    values = values.changed({**line_parameters(line), **parameters})
    world = make_world(airframe, site, seed=3, turbulence=TURBULENCE, field=build_field(site.air))

    loop = SpoiltLoop(world, values)
    loop.corrupt, loop.start_s = partial(corrupt, world.frame), RESET_S + 0.5 * DT_S
    for _ in range(round(RESET_S / DT_S)):
        output = loop.tick()
    assert output.mode == SOARING
    if line_moves_m != 0.0:
        loop.change({"TGL_X": values["TGL_X"] + line_moves_m})
    outputs, places = [], []
    for _ in range(round(STAY_S / DT_S)):
        outputs.append(loop.tick())
        places.append((world.truth.x_m, world.truth.z_m))
    return Flown(outputs, places)


@cache
def undisturbed() -> Flown:
    return fly(lambda _, inputs: inputs)


def apart(flown: Flown) -> float:
    """How far [m] it ever was from where it would have been, in the same gusts."""
    return max(map(dist, flown.places, undisturbed().places))


def moved(x_m: float, z_m: float) -> Corrupt:
    def corrupt(frame: SoaringFrame, inputs: Inputs) -> Inputs:
        north, east, down = ned_vector_from_soaring(frame, x_m, 0.0, z_m)
        fix = inputs.position
        return inputs._replace(
            position=fix._replace(
                north_m=fix.north_m + north, east_m=fix.east_m + east, down_m=fix.down_m + down
            )
        )

    return corrupt


@pytest.mark.parametrize(("x_m", "z_m"), [(5.0, 0.0), (-4.0, 3.0)])
def test_a_reset_of_the_position_moves_nothing(x_m: float, z_m: float) -> None:
    flown = fly(moved(x_m, z_m))
    assert flown.modes == []
    assert max(abs(o.line.e_rho_m) for o in flown.outputs) < E_RHO_M
    assert apart(flown) < E_RHO_M
    words = FrameWords()
    reported = [word for output in flown.outputs for word in words.look(output)]
    moves = f"position was reset by {x_m:+.1f} +0.0 {z_m:+.1f} m (x y z): the line moves with it"
    assert reported == [(SEVERITY_WARNING, moves)]
    last = flown.outputs[-1].quality
    assert (last.shift_x_m, last.shift_z_m) == pytest.approx((x_m, z_m), abs=0.05)


def test_not_followed_it_drags_the_aircraft_after_the_frame() -> None:
    """What EST_RESET_MAX is for: the same flight without it."""
    flown = fly(moved(5.0, 0.0), EST_RESET_MAX=0.0)
    assert "capturing" in flown.modes
    assert any(o.mode == CAPTURING for o in flown.outputs)
    assert apart(flown) > 1.0


def test_no_law_sees_a_jump_that_comes_right_behind_a_change_of_mode() -> None:
    """A mode that has not settled is not left for holding at once: the line begins again in it."""
    flown = fly(moved(1.2, 0.0), line_moves_m=0.1, EST_RESET_MAX=0.0)
    assert flown.modes[:2] == ["capturing", "holding"]
    jumped = [o for o in flown.outputs if o.quality.jumped]
    assert jumped[0].mode == CAPTURING
    assert max(abs(o.line.e_rho_m) for o in flown.outputs) < 0.1


def test_a_reset_of_the_heading_moves_the_line_no_more() -> None:
    """By 10 degrees: the bank's slow correction of a biased attitude takes it up."""
    flown = fly(lambda _, inputs: turned(inputs, 0.0, radians(10.0)))
    assert flown.modes == []
    assert max(abs(o.line.e_rho_m) for o in flown.outputs) < E_RHO_M
    assert max(abs(o.vehicle.y_m) for o in flown.outputs) < 0.5


@pytest.mark.parametrize(
    ("x_m", "z_m", "reason"), [(9.0, 0.0, "outside the fence"), (0.0, -9.9, "too low")]
)
def test_fence_and_ground_hold_in_the_frame_of_before_and_in_the_new_one(
    x_m: float, z_m: float, reason: str
) -> None:
    """It is unknown which of the two is right: 9 m downstream is behind the top, and 9.9 m further
    down is in the hill."""
    ended = [o for o in fly(moved(x_m, z_m)).outputs if o.mode in (RECOVERING, RELEASED)]
    assert reason_text(ended[0].reason) == reason
    # Five fixes, and what is wrong must last for longer than noise does.
    assert ended[0].time_s - RESET_S < 0.5


def dead_reckoned(
    reported_s: float, lasts_s: float = 15.0
) -> tuple[list[Output], list[Words], float]:
    """Fixes missing for so long, and as long again: how far [m] it truly is off its line then.

    reported_s: after how long the autopilot reports it.
    """
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    values = values.changed({**line_parameters(next(iter(site.lines.values()))), "AGE_POS_DR": 20})
    world = make_world(airframe, site, seed=3, turbulence=TURBULENCE, field=build_field(site.air))
    # 1.7 m at last, along the wind of this site: what was measured through a real autopilot.
    fault = (
        f"position.reckoned start={RESET_S} for={lasts_s} north=0 east=-0.015 reported={reported_s}"
    )
    loop = ClosedLoop(world, values, Injection([parse_fault(fault)]))
    frame, reckoning = FrameWords(), ReckoningWords()
    outputs, words = [], []
    for k in range(round((RESET_S + 2.0 * lasts_s) / DT_S)):
        output = loop.tick()
        if k >= round(RESET_S / DT_S):
            outputs.append(output)
            words += frame.look(output) + reckoning.look(output)
    eta_rad = eta_from_lean(radians(values["TGL_LEAN"]))
    off_m = e_rho(values["TGL_X"], values["TGL_Z"], eta_rad, world.truth.x_m, world.truth.z_m)
    return outputs, words, abs(off_m)


def test_what_is_corrected_after_dead_reckoning_moves_no_frame() -> None:
    outputs, words, off_m = dead_reckoned(reported_s=7.0)
    assert outputs[-1].quality.shift_x_m == 0.0
    assert outputs[-1].mode in (CAPTURING, SOARING)
    assert off_m < E_RHO_M
    assert words == [
        (SEVERITY_WARNING, "position is only dead reckoned: fixes are missing"),
        (SEVERITY_INFO, "position is measured again"),
    ]


def test_not_reported_of_it_the_line_stays_where_the_reckoning_ended() -> None:
    """What the autopilot's word is asked for: the same flight without it."""
    outputs, _, off_m = dead_reckoned(reported_s=1e6)
    assert abs(outputs[-1].quality.shift_x_m) > 1.0
    assert off_m > 1.0
