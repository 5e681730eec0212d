"""Launching, breaking off and landing in the tick, over the shipped hill."""

from __future__ import annotations

from math import degrees, isfinite, isnan, nan, radians
from typing import Any

import pytest

from tgl_soar.autopilot import Output, entry_lacks, initial_state, step
from tgl_soar.config.files import (
    airframe_file,
    load_airframe,
    load_parameters,
    load_site,
    site_file,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Start
from tgl_soar.control.estimates import estimate
from tgl_soar.control.glide_home import STILL_S
from tgl_soar.control.landing import FINAL_M, FLARE_MIN_M, SOAR_ON
from tgl_soar.control.launch_landing import (
    SLOW_S,
    Lull,
    phase_conditions,
    phase_guide,
    phase_step,
    with_way_home,
)
from tgl_soar.control.laws import laws_from
from tgl_soar.control.supervisor import (
    AWAY,
    BREAK_OFF,
    BREAKING_OFF,
    CAPTURING,
    HOLDING,
    LANDING,
    LAUNCHING,
    NEAR_LINE,
    ON_GROUND,
    POSITION_SANE,
    READY,
    REASON_BREAK,
    REASON_FENCE,
    REASON_LANDED,
    REASON_POSITION_LOST,
    REASON_SOAR_ON,
    RECOVERING,
    RELEASED,
    SETTLES,
    SOARING,
    STANDBY,
)
from tgl_soar.control.throttle import LOW_S
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.flight import inputs_at
from tgl_soar.sim.throw import Throw, ThrownWorld
from tgl_soar.sim.world import World, make_world

AIRFRAME, SITE = airframe_file("eclipson_c"), site_file("hill")


def values_of(**changes: float) -> ParameterSet:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    return load_parameters(airframe, AIRFRAME, site, SITE).changed(changes)


def world_of(start: Start | None = None, turbulence: float = 0.02) -> World:
    site = load_site(SITE)
    if start is not None:
        import msgspec

        site = msgspec.structs.replace(site, start=start)
    return make_world(load_airframe(AIRFRAME), site, seed=7, turbulence=turbulence)


class Flown:
    """A flight that can be stopped, and its modes in order."""

    def __init__(self, world: World, values: ParameterSet) -> None:
        self.loop = ClosedLoop(world, values)
        self.modes: list[tuple[int, int]] = []

    def fly(self, seconds: float, until: int = -1) -> Flown:
        for _ in range(round(seconds * self.loop.world.step_hz)):
            output = self.loop.tick()
            if not self.modes or self.modes[-1][0] != output.mode:
                self.modes.append((output.mode, output.reason))
            if output.mode in (until, RELEASED) or self.loop.world.crashed:
                break
        return self

    @property
    def output(self) -> Output:
        assert self.loop.output is not None
        return self.loop.output


def soaring(**changes: float) -> Flown:
    flown = Flown(world_of(), values_of(**changes)).fly(30.0, SOARING)
    assert flown.output.mode == SOARING
    return flown


def test_it_breaks_off_by_command_and_touches_down_at_the_place() -> None:
    flown = soaring()
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(90.0)
    assert [mode for mode, _ in flown.modes[-2:]] == [BREAKING_OFF, LANDING]
    assert flown.modes[-2][1] == REASON_BREAK
    world, values = flown.loop.world, flown.loop.values
    assert "ground" in world.crashed
    assert abs(world.state.x_m - values["LND_X"]) < 10.0
    assert abs(world.state.y_m - values["LND_Y"]) < 5.0


@pytest.mark.parametrize("mode", [BREAKING_OFF, LANDING])
@pytest.mark.parametrize("clear_min_m", [0.0, 0.05, 1.0])
def test_on_the_ground_the_way_home_is_over_whatever_clear_min_is(
    mode: int, clear_min_m: float
) -> None:
    """It lies at 0.15 m, half of what counts as height, and far from ESC_X: that of a slope that it
    slid down, or of a landing place that it never reached."""
    flown = soaring(CLEAR_MIN=clear_min_m)
    values = values_of(CLEAR_MIN=clear_min_m, ESC_X=-60.0)
    world = flown.loop.world
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
    before = flown.loop.state
    inputs = inputs_at(world.time_s, world.now.samples, True)
    now = estimate(laws, before.memory, inputs, True, before.loops.limited, 0.005)
    vehicle = now.vehicle._replace(
        x_m=-30.0, z_m=0.15, velocity_x_mps=0.0, velocity_y_mps=0.0, climb_mps=0.0
    )
    state, found, at = before.launch_landing, 0, now
    for k in range(round(1.2 / 0.05)):
        at = now._replace(
            vehicle=vehicle._replace(time_s=now.vehicle.time_s + 0.05 * k),
            margins=now.margins._replace(clearance_m=0.15, outside=0),
        )
        state = phase_step(laws, state, mode, inputs, at, before.line, 0.05)
        found = phase_conditions(laws, mode, state, at)
        assert bool(found & ON_GROUND) == (0.05 * k >= STILL_S - 1e-9)
    assert found & AWAY
    higher = at._replace(margins=at.margins._replace(clearance_m=0.6))
    assert bool(phase_conditions(laws, mode, state, higher) & AWAY) == (clear_min_m == 1.0)


def test_breaking_off_ends_on_a_ground_that_no_clearance_is_kept_to() -> None:
    """The slope is never left behind, and CLEAR_MIN is 0: it lands where it comes down."""
    flown = soaring(CLEAR_MIN=0.0, ESC_X=-200.0)
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(60.0, LANDING)
    assert flown.output.mode == LANDING
    assert flown.output.margins.clearance_m <= FLARE_MIN_M


def test_the_height_left_is_watched_in_every_flight_and_breaks_off_only_where_asked() -> None:
    for auto, mode in ((0.0, SOARING), (1.0, BREAKING_OFF)):
        flown = soaring(ESC_AUTO=auto).fly(3.0)
        had = flown.output.launch_landing.height_left_m
        assert isfinite(had)
        # More is to be spared than there is: the last moment has gone by.
        flown.loop.change({"ESC_SPARE": 1.0 + had + 3.0})
        flown.fly(4.0, BREAKING_OFF)
        assert flown.output.mode == mode
        assert flown.output.launch_landing.height_left_m < 0.0
        assert flown.output.launch_landing.time_left_s == 0.0


@pytest.mark.parametrize("auto", [0.0, 1.0])
def test_low_over_the_ground_it_goes_home_where_it_may(auto: float) -> None:
    flown = soaring(ESC_AUTO=auto, ESC_CLEAR=0.0).fly(3.0)
    assert flown.output.launch_landing.height_left_m > 0.0
    flown.loop.change({"ESC_CLEAR": 50.0})
    flown.fly(2.0, BREAKING_OFF)
    assert flown.output.mode == (BREAKING_OFF if auto else SOARING)


def test_a_lull_is_counted_while_it_lasts_and_off_while_it_does_not() -> None:
    flown = soaring(ESC_AUTO=1.0).fly(3.0)
    laws, state, world = flown.loop._laws, flown.loop.state, flown.loop.world
    inputs = inputs_at(world.time_s, world.now.samples, True)
    now = estimate(laws, state.memory, inputs, True, state.loops.limited, 0.005)
    least = laws.landing.polar.speed_min_mps
    high = now.margins.clearance_m - laws.landing.clearance_m

    def after(
        mode: int = SOARING,
        wind: float = least,
        cross: float = nan,
        climb: float = 0.0,
        before_s: float = 0.1,
    ) -> Lull:
        air = now.air._replace(wind_mps=wind, wind_sigma_mps=0.5, cross_wind_mps=cross)
        then = now._replace(air=air, vehicle=now.vehicle._replace(climb_mps=climb))
        there = state.launch_landing._replace(lull=Lull(before_s, before_s))
        return phase_step(laws, there, mode, inputs, then, state.line, 0.005).lull

    more, less = pytest.approx(0.105), pytest.approx(0.095)
    for wind, slow in ((least - 0.4, less), (least - 0.6, more), (nan, less)):
        assert after(wind=wind).slow_s == slow
        assert after(CAPTURING, wind=wind).slow_s == slow
    assert after(wind=least - 0.6, cross=4.0).slow_s == less  # it blows from the side as well
    for climb, low in ((-0.45 * high, less), (-0.55 * high, more), (9.0, less), (nan, less)):
        assert after(climb=climb).low_s == low
    assert after(CAPTURING, climb=-9.0 * high).low_s == less
    assert after(HOLDING, wind=0.0) == Lull(0.1, 0.1)
    assert after(RECOVERING, wind=0.0) == Lull(0.0, 0.0)
    # However long it has lasted, two seconds and a third of one are all there is to make good.
    assert after(wind=least - 0.6, climb=-0.55 * high, before_s=3600.0) == (4.0, 0.6)


def test_a_line_that_is_given_up_is_left_for_home_where_there_is_height_for_it() -> None:
    flown = soaring(ESC_AUTO=1.0).fly(3.0)
    laws, state, world = flown.loop._laws, flown.loop.state, flown.loop.world
    inputs = inputs_at(world.time_s, world.now.samples, True)
    now = estimate(laws, state.memory, inputs, True, state.loops.limited, 0.005)
    assert state.launch_landing.escape.left_m > 0.0

    def breaks(found: int, mode: int = SOARING, **changes: Any) -> bool:
        supervisor = state.supervisor._replace(mode=mode)
        home = laws._replace(landing=laws.landing._replace(**changes))
        return bool(with_way_home(home, supervisor, state.launch_landing, now, found) & BREAK_OFF)

    assert not breaks(SETTLES | NEAR_LINE)
    for lacking in (SETTLES, NEAR_LINE):
        given_up = (SETTLES | NEAR_LINE) & ~lacking
        assert breaks(given_up)
        assert breaks(given_up, CAPTURING)
        assert not breaks(given_up, HOLDING)
        assert not breaks(given_up, auto=False)
        assert not breaks(given_up, asked=SOAR_ON)
    for lull, goes in (
        (Lull(SLOW_S - 0.01, LOW_S - 0.01), False),
        (Lull(SLOW_S, 0.0), True),
        (Lull(0.0, LOW_S), True),
    ):
        weak = state.launch_landing._replace(lull=lull)
        found = with_way_home(laws, state.supervisor, weak, now, SETTLES | NEAR_LINE)
        assert bool(found & BREAK_OFF) == goes
    recovering = state.supervisor._replace(mode=RECOVERING)
    for fraction, goes in ((0.49, False), (0.51, True)):  # of its longest time
        begun_s = now.vehicle.time_s - fraction * laws.guards.recover_s
        since = recovering._replace(since_s=begun_s)
        found = with_way_home(laws, since, state.launch_landing, now, SETTLES | NEAR_LINE)
        assert bool(found & BREAK_OFF) == goes
    gone = state.launch_landing._replace(escape=state.launch_landing.escape._replace(left_m=-0.1))
    assert not with_way_home(laws, state.supervisor, gone, now, SETTLES) & BREAK_OFF


@pytest.mark.parametrize(("over_m", "bank_deg"), [(20.0, 15.0), (0.5, 10.0)])
def test_a_weave_high_up_banks_by_half_as_much_again(over_m: float, bank_deg: float) -> None:
    """To either side; the estimate moves sideways so that all of the bank is asked for."""
    flown = soaring()
    laws, state, world = flown.loop._laws, flown.loop.state, flown.loop.world
    inputs = inputs_at(world.time_s, world.now.samples, True)
    now = estimate(laws, state.memory, inputs, True, state.loops.limited, 0.005)
    error = state.launch_landing.glide.airspeed_error._replace(
        nose=0.0, sideways_mps=0.0, weight=40.0, by_nose2=6.0
    )
    z_m = laws.landing.place.z_m + FINAL_M + over_m
    for side in (1.0, -1.0):
        vehicle = now.vehicle._replace(z_m=z_m, velocity_y_mps=-20.0 * side)
        air = now.air._replace(airspeed_mps=9.3, wind_mps=8.5, measured=False)
        then = now._replace(vehicle=vehicle, air=air)
        glide = state.launch_landing.glide._replace(
            speed_mps=9.2, weave_rad=0.9 * side, goes_right=side > 0.0, airspeed_error=error
        )
        there = state.launch_landing._replace(glide=glide)
        *_, sideways, _ = phase_guide(
            laws, there, LANDING, then, state.soaring, state.sideways, state.loops.limited, 0.005
        )
        assert degrees(sideways.output) == pytest.approx(side * bank_deg)


def test_without_a_landing_place_nothing_is_known_of_the_height() -> None:
    flown = soaring(LND_LEN=0.0)
    assert isnan(flown.output.launch_landing.height_left_m)
    assert isnan(flown.output.launch_landing.time_left_s)


def test_the_operator_soars_on_and_it_stays_so() -> None:
    flown = soaring(ESC_AUTO=1.0)
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(1.0)
    assert flown.output.mode == BREAKING_OFF
    flown.loop.change({"ESC_START": 2.0, "ESC_SPARE": 50.0})
    flown.fly(0.5, CAPTURING)
    assert flown.modes[-1] == (CAPTURING, REASON_SOAR_ON)
    assert abs(flown.output.line.e_rho_m) < 0.05  # the line starts at the aircraft
    flown.fly(3.0)
    assert flown.output.launch_landing.height_left_m < 0.0
    assert flown.output.mode in (CAPTURING, SOARING)


def test_who_disengages_on_the_way_home_has_it() -> None:
    flown = soaring()
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(1.0)
    flown.loop.engage = False
    assert flown.fly(0.1).output.mode in (STANDBY, READY)


def blind_ticks(flown: Flown, seconds: float) -> list[Output]:
    """Flown on with the last fix, as long as the module is in control."""
    laws, state = flown.loop._laws, flown.loop.state
    world, last, output = flown.loop.world, flown.loop.world.position, flown.output
    outputs = []
    for _ in range(round(seconds * world.step_hz)):
        world.step(output.command)
        samples = world.now.samples._replace(position=last)
        state, output = step(laws, state, inputs_at(world.time_s, samples, True))
        outputs.append(output)
        if output.mode == RELEASED:
            break
    return outputs


def test_a_position_that_is_lost_on_the_way_home_ends_it_as_recovering_would() -> None:
    flown = soaring()
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(1.0)
    begin_s = flown.loop.world.time_s
    outputs = blind_ticks(flown, 10.0)
    for output in outputs[:-1]:
        assert output.mode == BREAKING_OFF  # a lost position is not away
        assert isfinite(output.command.elevator + output.setpoints.pitch_rad)
    assert not outputs[-2].health.position_ok
    assert abs(outputs[-2].setpoints.roll_rad) < radians(6.0)
    last, values = outputs[-1], flown.loop.values
    assert (last.mode, last.reason) == (RELEASED, REASON_POSITION_LOST)
    blind_s = values["AGE_POS_MAX"] + values["REC_TIME"]
    assert last.time_s - begin_s == pytest.approx(blind_s, abs=0.2)


def test_a_lost_position_does_not_break_off_by_itself() -> None:
    """What the estimate coasts to is no height that is gone: holding and recovering end it."""
    flown = soaring(ESC_AUTO=1.0).fly(3.0)
    had = flown.output.launch_landing.height_left_m
    assert had > 0.0
    world, loop = flown.loop.world, flown.loop
    last = world.position
    for _ in range(round(0.6 * world.step_hz)):
        world.step(flown.output.command)
        samples = world.now.samples._replace(position=last)
        loop.state, _ = step(loop._laws, loop.state, inputs_at(world.time_s, samples, True))
    assert loop.state.supervisor.mode == HOLDING
    loop.change({"ESC_SPARE": 1.0 + had + 3.0})
    outputs = blind_ticks(flown, 10.0)
    assert BREAKING_OFF not in [output.mode for output in outputs]
    assert outputs[-1].mode == RELEASED


def reckoned_ticks(flown: Flown, seconds: float, until: int = -1) -> list[Output]:
    """Flown on with positions that the autopilot says it only dead reckons."""
    laws, state = flown.loop._laws, flown.loop.state
    world, output = flown.loop.world, flown.output
    outputs = []
    for _ in range(round(seconds * world.step_hz)):
        world.step(output.command)
        fix = world.position._replace(reckoned=True)
        samples = world.now.samples._replace(position=fix)
        state, output = step(laws, state, inputs_at(world.time_s, samples, True))
        outputs.append(output)
        if output.mode in (until, RELEASED) or world.crashed:
            break
    return outputs


def test_by_itself_it_breaks_off_when_it_was_dead_reckoned_for_too_long_and_comes_home() -> None:
    flown = soaring(ESC_AUTO=1.0, AGE_POS_DR=1.5).fly(3.0)
    assert flown.output.launch_landing.height_left_m > 0.0
    begin_s = flown.loop.world.time_s
    outputs = reckoned_ticks(flown, 90.0)
    breaks = next(output for output in outputs if output.mode != SOARING)
    assert (breaks.mode, breaks.reason) == (BREAKING_OFF, REASON_BREAK)
    assert breaks.time_s - begin_s == pytest.approx(1.5, abs=0.05)
    world, values = flown.loop.world, flown.loop.values
    assert "ground" in world.crashed
    assert abs(world.state.x_m - values["LND_X"]) < 10.0
    assert abs(world.state.y_m - values["LND_Y"]) < 5.0


def test_without_leave_it_is_held_and_handed_over_as_without_a_position() -> None:
    flown = soaring(AGE_POS_DR=1.5).fly(3.0)
    outputs = reckoned_ticks(flown, 20.0)
    modes = [output.mode for output in outputs]
    assert modes.index(HOLDING) < modes.index(RECOVERING)
    assert BREAKING_OFF not in modes
    assert modes[-1] == RELEASED


def test_a_dead_reckoned_position_is_enough_for_the_way_home_and_not_to_be_engaged() -> None:
    flown = soaring(AGE_POS_DR=0.0)
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(1.0)
    outputs = reckoned_ticks(flown, 90.0)
    assert not any(output.health.position_ok for output in outputs[10:])
    assert {output.mode for output in outputs} == {BREAKING_OFF, LANDING}
    assert "ground" in flown.loop.world.crashed
    on_ground = Flown(world_of(), values_of())
    on_ground.loop.engage = False
    laws, world = on_ground.fly(0.5).loop._laws, on_ground.loop.world
    for reckons in (True, False):
        fix = world.position._replace(sequence=10_000, time_s=world.time_s, reckoned=reckons)
        samples = world.now.samples._replace(position=fix)
        inputs = inputs_at(world.time_s, samples, False)
        state, output = step(laws, on_ground.loop.state, inputs)
        assert bool(entry_lacks(laws, state, inputs, output) & POSITION_SANE) == reckons


def test_beyond_the_fence_downstream_the_way_home_disengages() -> None:
    flown = soaring()
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(0.5)
    x = flown.output.vehicle.x_m
    flown.loop.change({"FENCE_X_MIN": x + 1.0, "FENCE_X_MAX": x + 9.0})
    assert flown.fly(0.1).output.mode == BREAKING_OFF  # upstream it is left on purpose
    flown.loop.change({"FENCE_X_MIN": x - 9.0, "FENCE_X_MAX": x - 1.0})
    flown.fly(0.1)
    assert flown.modes[-1] == (RELEASED, REASON_FENCE)


def test_in_a_tunnel_standing_still_over_the_board_is_no_ground() -> None:
    airframe_path, site_path = airframe_file("eclipson_c"), site_file("tunnel")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    values = values.changed({"ESC_X": 5.0})  # it lands where it soars
    flown = Flown(make_world(airframe, site, seed=7, turbulence=0.01), values)
    flown.fly(30.0, SOARING).fly(3.0)
    assert flown.output.mode == SOARING
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(30.0)
    assert LANDING in [mode for mode, _ in flown.modes]
    assert REASON_LANDED not in [reason for _, reason in flown.modes]


def test_without_a_known_best_glide_it_lands_all_the_same() -> None:
    flown = soaring(DYN_BEST=0.0)
    flown.loop.change({"ESC_START": 1.0})
    for _ in range(200 * 20):
        output = flown.loop.tick()
        assert isfinite(output.setpoints.pitch_rad + output.setpoints.heading_rad)
        if flown.loop.world.crashed:
            break
    assert output.mode in (LANDING, BREAKING_OFF)


@pytest.mark.parametrize("name", ["LND_BEAR", "ESC_BEAR"])
def test_a_bearing_that_cannot_be_flown_is_no_place(name: str) -> None:
    """Not another one in its stead."""
    world, wind_deg = world_of(), load_site(SITE).site.wind_from_deg
    for off, known in ((59.9, True), (-60.0, True), (61.0, False), (-90.0, False)):
        values = values_of(**{name: (wind_deg + off) % 360.0})
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        assert (laws.landing.place.length_m > 0.0) == known


def test_the_end_on_the_ground_disengages() -> None:
    flown = soaring()
    flown.loop.change({"ESC_START": 1.0})
    flown.fly(90.0)
    world, state, laws = flown.loop.world, flown.loop.state, flown.loop._laws
    modes = []
    for _ in range(500):  # it lies where it has touched down, and the sensors go on
        world.step(flown.output.command)
        state, output = step(laws, state, inputs_at(world.time_s, world.now.samples, True))
        modes.append((output.mode, output.reason))
        if output.mode == RELEASED:
            break
    assert modes[-1] == (RELEASED, REASON_LANDED)


@pytest.mark.parametrize("pitch_deg", [-20.0, 20.0])
def test_a_launch_from_the_hand_is_captured_without_a_step(pitch_deg: float) -> None:
    throw = Throw(
        time_s=1.5, speed_mps=3.0, roll_rad=0.0, pitch_rad=radians(pitch_deg), heading_rad=0.2
    )
    world = ThrownWorld(world_of(Start(x_m=-4.5, z_m=8.4)), throw)
    flown = Flown(world, values_of(LNC_START=1.0)).fly(1.4)
    assert flown.output.mode == LAUNCHING
    assert flown.output.launch_landing.launch == 1
    # In the hand nothing is learnt, whatever the hand does.
    assert flown.output.elevator.i == pytest.approx(0.0, abs=1e-3)
    before, most = flown.output.setpoints.pitch_rad, 0.0
    for _ in range(200 * 25):
        output = flown.loop.tick()
        most = max(most, abs(output.setpoints.pitch_rad - before))
        before = output.setpoints.pitch_rad
        if output.mode == SOARING:
            break
    assert output.mode == SOARING
    assert most <= radians(120.0) * 0.005 + 1e-9  # PITCH_SLEW


def test_nobody_throws() -> None:
    never = Throw(time_s=1e9, speed_mps=3.0, roll_rad=0.0, pitch_rad=0.0, heading_rad=0.0)
    world = ThrownWorld(world_of(Start(x_m=-4.5, z_m=8.4)), never)
    flown = Flown(world, values_of(LNC_START=1.0, LNC_WAIT=2.0)).fly(3.0)
    assert [mode for mode, _ in flown.modes[-2:]] == [LAUNCHING, RELEASED]


def test_in_the_hand_neither_height_nor_speed_is_asked_for() -> None:
    low = Start(x_m=-12.0, z_m=0.6)  # below CLEAR_MIN
    for asked, mode in ((0.0, STANDBY), (1.0, READY)):
        flown = Flown(world_of(low), values_of(LNC_START=asked))
        flown.loop.engage = False
        assert flown.fly(0.5).output.mode == mode


def test_what_flies_already_is_not_launched_and_keeps_its_entry_checks() -> None:
    flown = Flown(world_of(), values_of(LNC_START=1.0, LNC_SPEED=10.0, SPEED_MIN=7.0))
    assert flown.fly(30.0, SOARING).output.mode == SOARING
    assert flown.output.margins.clearance_m > 4.0
    assert LAUNCHING not in [mode for mode, _ in flown.modes]


def test_the_modes_without_a_search_stay_as_they_were() -> None:
    """No landing place, no launch: the state of these modes is never begun."""
    flown = soaring(LND_LEN=0.0)
    launch_landing = flown.loop.state.launch_landing
    assert launch_landing.launch.standing == 0
    assert isnan(launch_landing.glide.speed_mps)
    assert initial_state().launch_landing.launch == launch_landing.launch
    assert HOLDING not in [mode for mode, _ in flown.modes]
    assert nan != launch_landing.escape.left_m
