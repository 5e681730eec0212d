"""The numbers that the loop must keep on the real aircraft model, flown by `autopilot.step`."""

from __future__ import annotations

from functools import lru_cache
from math import radians
from types import SimpleNamespace

import numpy as np
import pytest

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import stable_crossing
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
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.closed_loop import Change, ClosedLoop, Trajectory, fly
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.score import LegScore, score_leg
from tgl_soar.sim.sensors import AUTOPILOT_POSITION
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import SurfaceCommand

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
LEG_S = 20.0


@lru_cache(maxsize=1)
def tunnel() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    return airframe, site, load_parameters(airframe, AIRFRAME, site, SITE), build_field(site.air)


@pytest.mark.parametrize(("faults", "throttle"), [((), 1.0), (("link.up start=0 for=9",), 0.0)])
def test_a_propeller_turns_as_the_autopilot_lets_it(
    monkeypatch: pytest.MonkeyPatch, faults: tuple[str, ...], throttle: float
) -> None:
    _, site, _, field = tunnel()
    propeller = shipped("airframes/eclipson_c_propeller.toml")
    airframe = load_airframe(propeller)
    world = make_world(airframe, site, field=field)
    values = load_parameters(airframe, propeller, site, SITE)
    loop = ClosedLoop(world, values, Injection(parse_faults(faults)))
    output = SimpleNamespace(
        active=True,
        command=SurfaceCommand(0.5, 0.0, 0.0),
        throttle=SimpleNamespace(fraction=1.0),
    )
    monkeypatch.setattr(loop, "_decide", lambda _inputs: output)
    for _ in range(20):
        loop.tick()
    assert world.throttle == throttle


def fly_legs(
    seed: int,
    turbulence: float,
    parameters: dict[str, float] | None = None,
    leg_s: float = LEG_S,
) -> tuple[Trajectory, list[LegScore]]:
    """The three legs of `make run`, in process; scores of those that were reached."""
    airframe, site, values, field = tunnel()
    values = values.changed(parameters or {})
    world = make_world(airframe, site, seed=seed, turbulence=turbulence, field=field)
    changes = [
        Change(i * leg_s, line_parameters(line)) for i, line in enumerate(site.lines.values())
    ]
    flight = fly(world, values, changes, leg_s * len(changes))
    scores = []
    for i, (name, line) in enumerate(site.lines.items()):
        rows = (flight["target_changes"] == i + 1) & (flight["line_moving"] == 0.0)
        if np.count_nonzero(rows) < 2:
            continue
        lean = line.lean_deg if line.lean_deg is not None else values["TGL_LEAN"]
        eta = eta_from_lean(radians(lean))
        place = (line.x_m, line.z_m, eta)
        there = stable_crossing(field, airframe.polar.as_polar(), place)
        crossing = None if there is None else (there.x_m, there.z_m)
        columns = (flight[c][rows] for c in ("time_s", "x_m", "z_m"))
        scores.append(score_leg(name, place, crossing, *columns))
    return flight, scores


def test_calm_air_settles_on_the_line_and_at_the_crossing() -> None:
    flight, scores = fly_legs(seed=1, turbulence=0.0)
    assert not flight.ended
    assert [s.name for s in scores] == ["a", "b", "c"]
    for score in scores:
        assert score.settling_s <= 3.0
        assert score.crossing_m <= 0.05


def test_one_percent_turbulence_keeps_e_rho_within_a_centimetre() -> None:
    flight, scores = fly_legs(seed=1, turbulence=0.01)
    assert not flight.ended
    for score in scores:
        assert score.rms_e_rho_m <= 0.01


@pytest.mark.parametrize(
    "first",
    [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 32, 2))],
)
def test_three_percent_turbulence_loses_no_flight(first: int) -> None:
    """32 seeds, in groups so that they share the machine's cores."""
    for seed in range(first, first + 2):
        flight, scores = fly_legs(seed, turbulence=0.03)
        assert not flight.ended, f"seed {seed}: {flight.ended}"
        assert len(scores) == 3
        for score in scores:
            assert score.rms_e_rho_m <= 0.03, f"seed {seed}, leg {score.name}"


@pytest.mark.parametrize("factor", [0.5, 1.8])
def test_outer_gains_keep_their_margin(factor: float) -> None:
    """Half and almost twice the outer gains still settle: airspeed and mass are never known."""
    _, _, values, _ = tunnel()
    gains = {name: factor * values[name] for name in ("RHO_P", "RHO_I", "RHO_D")}
    flight, scores = fly_legs(1, 0.0, gains)
    assert not flight.ended
    assert all(score.settled for score in scores)
    assert len(scores) == 3


def test_every_loop_runs_at_the_rate_it_claims() -> None:
    """One tick, one attitude sample and one world step each 5 ms; a fix at the sensor's rate."""
    airframe, site, values, field = tunnel()
    world = make_world(airframe, site, field=field)
    loop = ClosedLoop(world, values)
    seconds = 4
    ticks = attitudes = fixes = 0
    integral_steps = 0
    last_integral = 0.0
    last = (0, 0)
    for _ in range(seconds * world.step_hz):
        output = loop.tick()
        ticks += 1
        attitudes += world.attitude.sequence - last[0]
        fixes += world.position.sequence - last[1]
        last = (world.attitude.sequence, world.position.sequence)
        if output.active and loop.state.loops.pitch.integral != last_integral:
            integral_steps += 1
            last_integral = loop.state.loops.pitch.integral
    assert values["LOOP_RATE"] == world.step_hz == 200
    assert ticks == seconds * 200
    # The delays of the sensors hold back the last few samples.
    assert seconds * 200 - 10 <= attitudes <= seconds * 200
    due = seconds * AUTOPILOT_POSITION.rate_hz
    assert due - 1 - AUTOPILOT_POSITION.rate_hz * AUTOPILOT_POSITION.delay_s <= fixes <= due
    # The elevator's integrator moves in every flying tick: the loop is not run at half its rate.
    assert integral_steps >= 0.95 * (seconds - 0.2) * 200


def test_the_same_seed_gives_the_same_flight_bit_for_bit() -> None:
    first, _ = fly_legs(7, 0.03, leg_s=5.0)
    second, _ = fly_legs(7, 0.03, leg_s=5.0)
    third, _ = fly_legs(8, 0.03, leg_s=5.0)
    assert all(np.array_equal(first[c], second[c], equal_nan=True) for c in first.columns)
    assert not np.array_equal(first["x_m"], third["x_m"])


@pytest.mark.parametrize("bank_deg", [-20.0, 20.0, 35.0])
def test_engaging_in_a_bank_levels_the_wings(bank_deg: float) -> None:
    """Half of the bank is gone within 0.3 s: the roll loop's own time constant is 0.1 s."""
    airframe, site, values, field = tunnel()
    world = make_world(airframe, site, field=field)
    loop = ClosedLoop(world, values)
    s = world.state
    _, pitch, yaw = euler_from_quaternion(s.qw, s.qx, s.qy, s.qz)
    qw, qx, qy, qz = quaternion_from_euler(radians(bank_deg), pitch, yaw)
    world.state = s._replace(qw=qw, qx=qx, qy=qy, qz=qz)
    engaged_s = None
    while engaged_s is None or world.time_s < engaged_s + 0.3:
        if loop.tick().active and engaged_s is None:
            engaged_s = world.time_s
    assert abs(world.truth.roll_rad) < 0.5 * radians(abs(bank_deg))


def test_one_wrong_fix_does_not_end_the_flight() -> None:
    """A marker swap of the motion capture: one fix 3 m away."""
    airframe, site, values, field = tunnel()
    world = make_world(airframe, site, field=field)
    loop = ClosedLoop(world, values)
    for _ in range(6 * world.step_hz):
        if world.steps == 4 * world.step_hz:
            sequence = world.position.sequence + 1
            world.position = world.position._replace(
                sequence=sequence, time_s=world.position.time_s + 0.01, down_m=3.0
            )
        output = loop.tick()
    assert output.active
    assert loop.state.memory.motion.rejected == 1
    assert not world.crashed
