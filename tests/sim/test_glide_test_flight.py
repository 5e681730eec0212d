"""The gliding test flight: when it glides at which speed and brake, when it throws which surface,
how its pilot holds pitch, wings and heading, and how another aircraft's speeds lie."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, sqrt
from typing import Any

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim import glide_test
from tgl_soar.sim.aircraft import aircraft_model, braked, glide_at, highest_pitch_glide
from tgl_soar.sim.glide_test import (
    STEP_S,
    EvenAir,
    GlideTick,
    _Pilot,
    fly,
    pace_of,
    sensors_of,
    wind_of,
)
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors
from tgl_soar.sim.world import World
from tgl_soar.types import AttitudeSample, AutopilotStatus, Inputs, PositionFix, SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
SPOILERS = load_airframe(shipped("airframes/eclipson_c_spoilers.toml"))
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
GLIDE = glide_at(MODEL, 9.0)


# --- the air --------------------------------------------------------------------------------------


def test_the_wind_is_the_same_everywhere_and_for_ever() -> None:
    air = EvenAir(9.2)
    assert air.reference_wind_mps == 9.2
    assert air.wind_at(1.0, 2.0, 3.0, 4.0) == (9.2, 0.0, 0.0)
    u, v, w = air.wind([0.0, 5.0], 1.0, [[2.0], [3.0], [4.0]], 7.0)
    assert u.shape == v.shape == w.shape == (3, 2)
    assert (u == 9.2).all()
    assert not v.any()
    assert not w.any()
    assert air.inside(0.0, 0.0, 0.1)
    assert not air.inside(0.0, 0.0, 0.0)


def test_the_aircraft_carries_what_it_is_asked_to() -> None:
    assert sensors_of() == Sensors(imu=MEMS_IMU, airspeed=None, surfaces=glide_test.READ_BACK)
    assert sensors_of(pitot=True, imu=False) == Sensors(
        imu=None, airspeed=PITOT, surfaces=glide_test.READ_BACK
    )
    assert glide_test.READ_BACK == (200.0, 0.005)


# --- another aircraft -----------------------------------------------------------------------------


def scaled(airframe: Airframe, mass: float) -> Airframe:
    metadata = type(airframe.airframe)(
        **{**asdict(airframe.airframe), "mass_kg": mass * airframe.airframe.mass_kg}
    )
    return type(airframe)(**{**asdict(airframe), "airframe": metadata})


@pytest.mark.parametrize(("mass", "pace"), [(1.0, 1.0), (4.0, 2.0), (0.25, 0.5), (1.21, 1.1)])
def test_speeds_go_with_the_root_of_the_weight_in_steps_of_a_twentieth(
    mass: float, pace: float
) -> None:
    """L = W at the best glide: V² ~ W."""
    model = MODEL._replace(mass_kg=mass * MODEL.mass_kg)
    assert pace_of(model) == pytest.approx(pace)


def test_the_best_glide_is_where_friction_and_lift_draw_alike() -> None:
    """C_L = √(C_D0 / k), so V = √(2 W / (ρ S C_L)), of the usual aircraft 9.2 m/s."""
    weight = 0.699 * 9.80665
    lift = sqrt(0.0563 / 0.1067)
    assert sqrt(2.0 * weight / (1.225 * 0.180 * lift)) == pytest.approx(9.2, abs=0.1)
    assert pace_of(MODEL) == 1.0
    assert wind_of(AIRFRAME) == 9.2


def test_a_heavier_aircraft_glides_against_more_wind() -> None:
    assert wind_of(scaled(AIRFRAME, 4.0)) == pytest.approx(2.0 * 9.2)


def test_the_usual_aircraft_has_the_usual_speeds() -> None:
    usual = (9.0, 8.6, 8.2, 7.9, 7.6, 8.4, 9.3, 10.0, 10.7, 11.4)
    assert usual == glide_test.SPEEDS_MPS
    assert glide_test._speeds(MODEL, 1.0, usual) == list(usual)


def test_another_aircrafts_speeds_lie_between_its_own_slowest_and_twice_the_usual() -> None:
    """Above the best glide's all goes with the pace, below it with how far the slowest is."""
    model = MODEL._replace(mass_kg=4.0 * MODEL.mass_kg)
    best = 2.0 * 9.2
    slowest = highest_pitch_glide(model).horizontal_mps
    below = round((best - slowest) / (9.2 - 7.4), 1)
    speeds = glide_test._speeds(model, 2.0, (7.4, 9.2, 10.2))
    assert speeds == pytest.approx([best - 1.8 * below, best, best + 2.0])
    assert speeds[0] == pytest.approx(slowest, abs=0.1)
    assert slowest == pytest.approx(2.0 * highest_pitch_glide(MODEL).horizontal_mps, rel=1e-6)


def test_a_pilot_moves_surfaces_that_do_more_by_less() -> None:
    assert glide_test._hand(MODEL, 1.0) == (1.0, 1.0)
    twice = MODEL._replace(Cm_elevator=2.0 * MODEL.Cm_elevator, Cl_aileron=2.0 * MODEL.Cl_aileron)
    assert glide_test._hand(twice, 1.0) == (0.5, 0.5)
    lighter = MODEL._replace(iyy_kgm2=0.5 * MODEL.iyy_kgm2, ixx_kgm2=0.25 * MODEL.ixx_kgm2)
    assert glide_test._hand(lighter, 1.0) == pytest.approx((0.5, 0.3), abs=0.051)
    assert glide_test._hand(MODEL, 0.5) == (4.0, 4.0)  # a quarter of the pressure


def test_the_hand_is_for_31_and_67_radians_a_second_squared_at_8_5_metres_a_second() -> None:
    """Full elevator and ailerons, by q S c Cm / Iyy and q S b Cl / Ixx."""
    pressure = 0.5 * 1.225 * 8.5**2 * 0.180
    assert pressure * 0.164 * 0.273 / 0.0115 == pytest.approx(31.0, abs=0.1)
    assert pressure * 1.10 * 0.0994 / 0.0130 == pytest.approx(67.0, abs=0.3)
    assert (glide_test.HAND_RADPS2, glide_test.HAND_MPS) == ((31.0, 67.0), 8.5)


def test_a_speed_below_the_slowest_is_flown_2_per_cent_above_it() -> None:
    slowest = highest_pitch_glide(MODEL).horizontal_mps
    assert glide_test._glide(MODEL, 0.5 * slowest, 0.0).horizontal_mps == pytest.approx(
        1.02 * slowest, abs=1e-4
    )
    assert glide_test._glide(MODEL, 9.0, 0.0).horizontal_mps == pytest.approx(9.0, abs=1e-4)
    spoilers = aircraft_model(asdict(SPOILERS.airframe), SPOILERS.model)
    sinks = [glide_test._glide(spoilers, 10.0, brake).sink_mps for brake in (0.0, 1.0)]
    assert sinks[1] > sinks[0] + 0.1
    assert sinks[1] == pytest.approx(glide_at(braked(spoilers, 1.0), 10.0).sink_mps)


# --- the pilot's hand -----------------------------------------------------------------------------


def inputs_of(
    *,
    euler: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
    north_mps: float = 0.0,
    fixes: int = 1,
    attitudes: int = 1,
) -> Inputs:
    qw, qx, qy, qz = quaternion_from_euler(*euler)
    return Inputs(
        time_s=0.0,
        position=PositionFix(
            sequence=fixes,
            time_s=0.0,
            north_m=0.0,
            east_m=0.0,
            down_m=-500.0,
            velocity_north_mps=north_mps,
            velocity_east_mps=0.0,
            velocity_down_mps=1.0,
            source=0,
            sigma_m=0.01,
            reckoned=False,
        ),
        attitude=AttitudeSample(
            sequence=attitudes,
            time_s=0.0,
            qw=qw,
            qx=qx,
            qy=qy,
            qz=qz,
            roll_rate_frd_radps=rates[0],
            pitch_rate_frd_radps=rates[1],
            yaw_rate_frd_radps=rates[2],
        ),
        autopilot=AutopilotStatus(time_s=0.0, accepts_surfaces=True, armed=True),
        engage=False,
    )


def command(inputs: Inputs, *, since_s: float = inf, throws: bool = True) -> SurfaceCommand:
    """Of a pilot whose aircraft needs half of the usual elevator and a quarter of the ailerons."""
    return _Pilot(9.2, 0.5, 0.25).command(inputs, GLIDE, since_s, throws=throws)


# In the trim's attitude at the glide's speed there is nothing to correct.
TRIMMED = {
    "euler": (0.0, GLIDE.pitch_rad, 0.0),
    "north_mps": GLIDE.horizontal_mps - 9.2,
}


@pytest.mark.parametrize(("fixes", "attitudes"), [(0, 1), (1, 0), (0, 0)])
def test_blind_the_pilot_holds_the_trim(fixes: int, attitudes: int) -> None:
    inputs = inputs_of(euler=(0.3, 0.3, 0.3), fixes=fixes, attitudes=attitudes)
    assert command(inputs) == (GLIDE.elevator, 0.0, 0.0, 0.0)


def test_in_trim_nothing_is_corrected() -> None:
    held = command(inputs_of(**TRIMMED))  # type: ignore[arg-type]
    assert held == pytest.approx((GLIDE.elevator, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("change", "corrected"),
    [
        ({"euler": (0.1, GLIDE.pitch_rad, 0.0)}, (0.0, -0.25 * 1.2 * 0.1, 0.0)),
        ({"rates": (1.0, 0.0, 0.0)}, (0.0, -0.25 * 0.06, 0.0)),
        ({"euler": (0.0, GLIDE.pitch_rad, 0.1)}, (0.0, 0.0, -0.6 * 0.1)),
        ({"rates": (0.0, 0.0, 1.0)}, (0.0, 0.0, -0.2)),
        ({"rates": (0.0, 1.0, 0.0)}, (-0.5 * 0.15, 0.0, 0.0)),
        # Half of 1.5 of a pitch that is missing, and what a step of 5 ms adds to its sum.
        ({"euler": (0.0, GLIDE.pitch_rad - 0.1, 0.0)}, (0.5 * 0.1 * (1.5 + 0.005), 0.0, 0.0)),
    ],
)
def test_each_deviation_has_its_own_surface(
    change: dict[str, Any], corrected: tuple[float, float, float]
) -> None:
    held = command(inputs_of(**{**TRIMMED, **change}))
    moved = held.elevator - GLIDE.elevator, held.aileron, held.rudder
    assert moved == pytest.approx(corrected, abs=1e-12)


@pytest.mark.parametrize(("too_fast_mps", "counts_mps"), [(0.5, 0.5), (3.0, 1.0), (-3.0, -1.0)])
def test_too_fast_is_trimmed_nose_up_by_a_metre_a_second_at_most(
    too_fast_mps: float, counts_mps: float
) -> None:
    """0.008 rad a second for each m/s."""
    north = GLIDE.horizontal_mps - 9.2 + too_fast_mps
    inputs = inputs_of(euler=(0.0, GLIDE.pitch_rad, 0.0), north_mps=north)
    pilot = _Pilot(9.2, 1.0, 1.0)
    for _ in range(200):
        held = pilot.command(inputs, GLIDE, inf, throws=True)
    trim = 0.008 * counts_mps
    summed = trim * 0.5 * (1.0 + STEP_S)  # of a ramp over a second
    assert held.elevator - GLIDE.elevator == pytest.approx(1.5 * trim + summed, rel=1e-6)


def test_a_pitch_that_stays_away_is_summed_up() -> None:
    inputs = inputs_of(
        euler=(0.0, GLIDE.pitch_rad - 0.1, 0.0), north_mps=GLIDE.horizontal_mps - 9.2
    )
    pilot = _Pilot(9.2, 1.0, 1.0)
    for _ in range(200):
        held = pilot.command(inputs, GLIDE, inf, throws=True)
    assert held.elevator - GLIDE.elevator == pytest.approx(0.1 * (1.5 + 1.0))


@pytest.mark.parametrize(
    ("since_s", "throw"),
    [
        (0.0, 0.0),
        (0.39, 0.0),
        (0.41, 0.2),  # after 0.4 s of rest, to one side for 0.25 s
        (0.64, 0.2),
        (0.66, -0.2),  # and to the other
        (0.89, -0.2),
        (0.91, 0.0),  # let stand for 1.3 s
        (2.19, 0.0),
    ],
)
def test_a_doublet_is_thrown_about_where_the_elevator_stood(since_s: float, throw: float) -> None:
    """Of half the usual elevator: 0.1 to each side."""
    pilot = _Pilot(9.2, 0.5, 0.25)
    low = inputs_of(euler=(0.0, GLIDE.pitch_rad - 0.1, 0.0), north_mps=GLIDE.horizontal_mps - 9.2)
    stood = pilot.command(low, GLIDE, inf, throws=True).elevator
    # Whatever the pitch then is, the elevator is let stand; wings and heading are held.
    other = inputs_of(euler=(0.1, 0.3, 0.1), rates=(0.0, 2.0, 0.0), north_mps=3.0)
    thrown = pilot.command(other, GLIDE, since_s, throws=True)
    assert thrown.elevator == pytest.approx(stood + 0.5 * throw)
    assert thrown.aileron == pytest.approx(-0.25 * 1.2 * 0.1)
    assert thrown.rudder == pytest.approx(-0.06)
    let = _Pilot(9.2, 0.5, 0.25)
    let.command(low, GLIDE, inf, throws=False)
    assert let.command(other, GLIDE, since_s, throws=False).elevator == pytest.approx(stood)


def test_after_a_doublet_pitch_is_held_again() -> None:
    inputs = inputs_of(
        euler=(0.0, GLIDE.pitch_rad - 0.1, 0.0), north_mps=GLIDE.horizontal_mps - 9.2
    )
    assert command(inputs, since_s=2.19).elevator == 0.0  # nothing stood yet
    assert command(inputs, since_s=2.21).elevator == pytest.approx(
        GLIDE.elevator + 0.5 * 0.1 * 1.505
    )


# --- the flight -----------------------------------------------------------------------------------


@pytest.fixture
def unwatched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the module on board, whose tick takes most of the time and moves nothing here."""
    monkeypatch.setattr(glide_test, "step", lambda _laws, state, _inputs: (state, None))


class Asked:
    """What the pilot was asked for in each tick."""

    def __init__(self, patched: pytest.MonkeyPatch) -> None:
        self.speeds: list[float] = []
        self.since: list[float] = []
        self.throws: list[bool] = []
        self.pilots: list[tuple[float, float, float]] = []
        original: Callable[..., SurfaceCommand] = _Pilot.command
        built: Callable[..., None] = _Pilot.__init__

        def command(
            pilot: _Pilot, inputs: Inputs, glide: Any, since_s: float, *, throws: bool
        ) -> SurfaceCommand:
            self.speeds.append(glide.horizontal_mps)
            self.since.append(since_s)
            self.throws.append(throws)
            return original(pilot, inputs, glide, since_s, throws=throws)

        def init(pilot: _Pilot, *hand: float) -> None:
            self.pilots.append(hand)  # type: ignore[arg-type]
            built(pilot, *hand)

        patched.setattr(_Pilot, "command", command)
        patched.setattr(_Pilot, "__init__", init)


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight's plan with a quarter of a second where it has eight and four."""
    monkeypatch.setattr(glide_test, "GLIDE_S", 0.25)
    monkeypatch.setattr(glide_test, "DOUBLET_EVERY_S", 0.25)


def at(ticks: list[GlideTick]) -> list[float]:
    return [tick.inputs.time_s for tick in ticks]


def test_the_plans_times_are_those_that_identification_counts_on() -> None:
    assert (glide_test.GLIDE_S, glide_test.DOUBLET_EVERY_S, glide_test.DOUBLETS) == (8.0, 4.0, 8)
    assert (glide_test.PULSES, glide_test.PULSE_S, glide_test.REST_S) == (4, 0.6, 0.4)
    assert (
        *(9.4, 500.0),
        9.2,
    ) == (glide_test.DOUBLET_SPEED_MPS, glide_test.HEIGHT_M, glide_test.WIND_MPS)
    assert STEP_S == 0.005


@pytest.mark.usefixtures("unwatched", "short")
def test_every_speed_is_glided_and_then_doublets_are_thrown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = Asked(monkeypatch)
    ticks = list(fly(AIRFRAME, speeds_mps=(9.0, 10.0), doublets=2))
    # Two glides, the way to the doublets' speed, two doublets: five quarters of a second.
    assert at(ticks) == pytest.approx([STEP_S * i for i in range(250)])
    speeds = np.array(asked.speeds)
    assert speeds[:50] == pytest.approx(9.0, abs=1e-3)
    assert speeds[50:100] == pytest.approx(10.0, abs=1e-3)
    assert speeds[100:] == pytest.approx(9.4, abs=1e-3)
    since = np.array(asked.since)
    assert np.isinf(since[:150]).all()
    assert since[150:200] == pytest.approx([STEP_S * i for i in range(50)], abs=1e-9)
    assert since[201:250] == pytest.approx([STEP_S * i for i in range(1, 50)], abs=1e-9)
    assert all(asked.throws)
    assert asked.pilots == [(9.2, 1.0, 1.0)]


@pytest.mark.usefixtures("unwatched", "short")
def test_without_doublets_it_ends_after_the_glides() -> None:
    assert len(list(fly(AIRFRAME, speeds_mps=(9.0,), doublets=0))) == 50


@pytest.mark.usefixtures("unwatched", "short")
def test_every_speed_is_glided_at_every_brake_and_at_last_the_brake_is_pulsed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(glide_test, "REST_S", 0.05)
    monkeypatch.setattr(glide_test, "PULSE_S", 0.1)
    asked = Asked(monkeypatch)
    moved: list[float] = []
    world_step: Callable[..., None] = World.step

    def stepped(world: Any, surfaces: SurfaceCommand) -> None:
        moved.append(surfaces.brake)
        world_step(world, surfaces)

    monkeypatch.setattr(World, "step", stepped)
    flight = fly(SPOILERS, speeds_mps=(9.5, 10.5), doublets=1, brakes=(0.2, 0.8), pulses=2)
    ticks = list(flight)
    # Four glides, the way, a doublet, two pulses.
    assert len(ticks) == 50 * (4 + 1 + 1 + 2)
    pulse = [0.2] * 10 + [0.8] * 20 + [0.2] * 20
    expected = [0.2] * 100 + [0.8] * 100 + [0.2] * 100 + pulse + pulse
    different = [i for i, (a, b) in enumerate(zip(moved, expected, strict=True)) if a != b]
    assert len(different) <= 4  # a tick at an edge is on either side by rounding
    assert asked.throws == [True] * 300 + [False] * 100
    speeds = np.array(asked.speeds)[::50]
    assert speeds[:4] == pytest.approx([9.5, 10.5, 9.5, 10.5], abs=0.05)


@pytest.mark.usefixtures("unwatched", "short")
def test_one_brake_alone_is_not_pulsed() -> None:
    assert len(list(fly(SPOILERS, speeds_mps=(), doublets=1, brakes=(0.5,)))) == 100


@pytest.mark.usefixtures("unwatched")
def test_the_module_on_board_sees_all_that_is_carried_and_does_not_engage() -> None:
    flight = fly(AIRFRAME, speeds_mps=(9.0,), doublets=0, pitot=True)
    ticks = [next(flight) for _ in range(60)]
    inputs = ticks[-1].inputs
    assert not inputs.engage
    assert inputs.autopilot.accepts_surfaces
    assert inputs.autopilot.armed
    assert inputs.autopilot.time_s == inputs.time_s
    for sample in (inputs.position, inputs.attitude, inputs.imu, inputs.airspeed, inputs.surfaces):
        assert sample.sequence > 0
    plain = fly(AIRFRAME, speeds_mps=(9.0,), doublets=0, imu=False)
    inputs = [next(plain) for _ in range(60)][-1].inputs
    assert (inputs.imu.sequence, inputs.airspeed.sequence) == (0, 0)
    own = fly(AIRFRAME, speeds_mps=(9.0,), doublets=0, sensors=Sensors(airspeed=PITOT))
    inputs = [next(own) for _ in range(60)][-1].inputs
    assert inputs.imu.sequence == 0
    assert inputs.airspeed.sequence > 0


@pytest.mark.usefixtures("unwatched")
def test_it_begins_500_m_up_in_a_wind_of_9_2_that_it_glides_against() -> None:
    first = next(fly(AIRFRAME, speeds_mps=(9.0,), doublets=0)).truth
    assert (first.x_m, first.y_m, first.z_m) == (0.0, 0.0, 500.0)
    assert (first.wind_x_mps, first.wind_y_mps, first.updraft_mps) == (9.2, 0.0, 0.0)
    assert first.heading_rad == 0.0


@pytest.mark.usefixtures("unwatched")
def test_turbulence_and_its_seed_are_chosen() -> None:
    def winds(**chosen: Any) -> list[float]:
        flight = fly(AIRFRAME, speeds_mps=(9.0,), doublets=0, **chosen)
        return [next(flight).truth.updraft_mps for _ in range(20)]

    assert set(winds()) == {0.0}
    rough = winds(turbulence=0.05, seed=1)
    assert np.std(rough) > 0.0
    assert rough == winds(turbulence=0.05)
    assert rough != winds(turbulence=0.05, seed=2)


@pytest.mark.usefixtures("unwatched")
def test_a_servos_delay_may_be_another_than_the_airframe_files() -> None:
    """The surfaces stand for so long after the first command."""
    for delay_s in (None, 0.05):
        flight = fly(AIRFRAME, speeds_mps=(11.0,), doublets=0, servo_delay_s=delay_s)
        elevators = [next(flight).truth.elevator for _ in range(20)]
        moved = next((i for i, e in enumerate(elevators) if e != elevators[0]), 99)
        assert moved >= 10 if delay_s else moved <= 3


def test_a_tick_holds_what_the_module_made_of_it() -> None:
    flight = fly(AIRFRAME, speeds_mps=(9.0,), doublets=0)
    for _ in range(3):
        tick = next(flight)
    assert isinstance(tick, GlideTick)
    assert tick.output.mode == tick.state.supervisor.mode
    assert tick.truth.time_s == tick.inputs.time_s == pytest.approx(2 * STEP_S)
