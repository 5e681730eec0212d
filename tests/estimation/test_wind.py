"""The air as it is estimated from the forces on the aircraft.

The truth is the simulated aircraft's own equations (tgl_soar.sim.aircraft): the estimator has
its formulas from the same textbook but no line of code.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from math import atan2, cos, inf, isfinite, isnan, nan, radians, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import asdict, replace

from tgl_soar.config.files import ConfigError, load_airframe, shipped
from tgl_soar.estimation.aerodynamics import glide_pitch, lift_drag
from tgl_soar.estimation.body_axes import body_axes, through_air
from tgl_soar.estimation.wind import (
    DRAG_ERROR,
    FORCE_NOISE_MPS2,
    GLIDE_RATIO,
    LIFT_ERROR,
    PITOT_BIAS_MPS,
    PITOT_NOISE_MPS,
    STALL_NOISE_MPS2,
    TRIM_ERROR_RAD,
    WindParams,
    WindState,
    _take_forces,
    initial_wind,
    wind_step,
)
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim import aircraft
from tgl_soar.sim.aircraft import (
    air_data,
    aircraft_model,
    glide_at,
    gliding_state,
)
from tgl_soar.sim.sensors import measure_airspeed, measure_imu
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_AIR,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AirEstimate,
    AirspeedSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    VehicleState,
    polar_sink,
)

DT = 0.005
AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
AERO = AIRFRAME.aerodynamics()
EXACT = 0.0  # of a velocity over the ground that is the true one
PARAMS = WindParams(AERO, 0.8, radians(0.5))
NONE = (0.0, 0.0, 0.0)


def vehicle_of(state: aircraft.AircraftState, time_s: float) -> VehicleState:
    roll, pitch, heading = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
    return VehicleState(
        time_s=time_s,
        x_m=state.x_m,
        y_m=state.y_m,
        z_m=state.z_m,
        velocity_x_mps=state.velocity_x_mps,
        velocity_y_mps=state.velocity_y_mps,
        climb_mps=state.velocity_z_mps,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
        roll_rate_radps=state.roll_rate_frd_radps,
        pitch_rate_radps=state.pitch_rate_frd_radps,
        heading_rate_radps=state.yaw_rate_frd_radps,
    )


def inputs_at(
    time_s: float, imu: ImuSample = NO_IMU, airspeed: AirspeedSample = NO_AIRSPEED
) -> Inputs:
    status = AutopilotStatus(time_s=time_s, accepts_surfaces=True, armed=True)
    return Inputs(
        time_s=time_s,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=status,
        engage=True,
        imu=imu,
        airspeed=airspeed,
        surfaces=NO_SURFACES,
    )


def imu_of(
    state: aircraft.AircraftState, air: aircraft.Wind, sequence: int, time_s: float
) -> ImuSample:
    return measure_imu(MODEL, state, air, False, sequence, time_s, NONE, NONE)


class Glide:
    """A steady glide in a steady wind, with sensors that make no error."""

    def __init__(self, speed_mps: float, air: tuple[float, float, float]) -> None:
        glide = glide_at(MODEL, speed_mps)
        self.air = air
        self.elevator = glide.elevator
        self.state = gliding_state(glide, air, 0.0, 0.0, 0.0)
        self.truth = air_data(self.state, air)

    def measured(
        self, seconds: float, *, imu: bool, pitot: bool, pitot_mps: float | None = None
    ) -> Iterator[tuple[WindState, AirEstimate]]:
        state = initial_wind()
        for n in range(1, round(seconds / DT) + 1):
            now = n * DT
            force, speed = NO_IMU, NO_AIRSPEED
            if imu:
                force = imu_of(self.state, self.air, n, now)
            if pitot:
                speed = measure_airspeed(MODEL, self.state, self.air, n // 4, now, 0.0)
                if pitot_mps is not None:
                    speed = speed._replace(airspeed_mps=pitot_mps)
            state, air = wind_step(
                PARAMS, state, vehicle_of(self.state, now), inputs_at(now, force, speed),
                EXACT, self.elevator, True,
            )  # fmt: skip
            yield state, air


def test_a_polar_that_ends_soon_is_enough_to_read_the_air_by() -> None:
    """The first guess lies within it: beyond its end there is no sink to begin with."""
    polar = AERO.polar._replace(speed_max_mps=1.1 * AERO.polar.speed_min_mps)
    params = PARAMS._replace(aerodynamics=AERO._replace(polar=polar))
    glide = Glide(1.05 * polar.speed_min_mps, (8.5, 0.0, 1.4))
    state = initial_wind()
    for n in range(1, 400):
        vehicle, force = vehicle_of(glide.state, n * DT), imu_of(glide.state, glide.air, n, n * DT)
        state, air = wind_step(
            params, state, vehicle, inputs_at(n * DT, force), EXACT, glide.elevator, True
        )
    assert air.airspeed_mps == pytest.approx(glide.truth.airspeed_mps, abs=0.5)


@pytest.mark.parametrize("speed_mps", [7.8, 9.0, 11.0])
@pytest.mark.parametrize(
    ("imu", "pitot"), [(True, True), (True, False), (False, True), (False, False)]
)
def test_a_steady_glide_is_read_as_it_is(speed_mps: float, imu: bool, pitot: bool) -> None:
    glide = Glide(speed_mps, (8.5, 0.0, 1.4))
    *_, (_, air) = glide.measured(8.0, imu=imu, pitot=pitot)
    # What is left is how far 8 s of noise-free samples have brought the first guess.
    assert air.airspeed_mps == pytest.approx(glide.truth.airspeed_mps, abs=0.06)
    assert air.alpha_rad == pytest.approx(glide.truth.alpha_rad, abs=0.01)
    assert air.wind_mps == pytest.approx(8.5, abs=0.06)
    assert air.updraft_mps == pytest.approx(1.4, abs=0.06)
    sink = polar_sink(AERO.polar, speed_mps)
    assert air.excess_mps == pytest.approx(1.4 - sink, abs=0.07)
    assert air.measured == pitot


def test_more_sensors_leave_less_unknown() -> None:
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    ends = []
    for imu, pitot in ((True, True), (True, False), (False, False)):
        *_, (_, air) = glide.measured(5.0, imu=imu, pitot=pitot)
        ends.append((air.wind_sigma_mps, air.updraft_sigma_mps))
    assert ends == sorted(ends)
    # With a pitot most of what is left is the pitch's error times the airspeed.
    assert 1.0 < ends[0][1] / (9.0 * radians(0.5)) < 1.6


@pytest.mark.parametrize(("imu", "pitot"), [(False, False), (False, True), (True, True)])
@pytest.mark.parametrize("climb_mps", [0.0, 1.4])
def test_the_pitch_s_error_is_counted_as_it_acts(imu: bool, pitot: bool, climb_mps: float) -> None:
    """What the alignment δ adds to a variance is (dŴ/dδ)² σ_δ², to first order in σ_δ² (there the
    gains change nothing, as they are the best ones); dŴ/dδ from an attitude that is turned."""
    glide = Glide(9.0, (8.5, 0.0, climb_mps))
    truth = vehicle_of(glide.state, 0.0)

    def settled(alignment_rad: float, turned_rad: float) -> AirEstimate:
        params = PARAMS._replace(alignment_rad=alignment_rad)
        state, air, speed = initial_wind(), NO_AIR, NO_AIRSPEED
        for n in range(1, 800):
            now = n * DT
            read = truth._replace(time_s=now, pitch_rad=truth.pitch_rad + turned_rad)
            force = imu_of(glide.state, glide.air, n, now) if imu else NO_IMU
            if pitot:
                speed = measure_airspeed(MODEL, glide.state, glide.air, n // 4, now, 0.0)
            state, air = wind_step(
                params, state, read, inputs_at(now, force, speed), EXACT, glide.elevator, True
            )
        return air

    sigma, turn = radians(0.1), radians(0.1)
    with_it, without = settled(sigma, 0.0), settled(0.0, 0.0)
    up, down = settled(0.0, turn), settled(0.0, -turn)
    # Of the wind itself accelerometers' bias, found by the same attitude, takes a part: not here.
    for name in ("updraft_mps",) if imu else ("wind_mps", "updraft_mps"):
        slope = (getattr(up, name) - getattr(down, name)) / (2.0 * turn)
        one, other = (
            getattr(air, name.replace("_mps", "_sigma_mps")) ** 2 for air in (with_it, without)
        )
        assert one - other == pytest.approx((slope * sigma) ** 2, rel=0.2, abs=1e-6), name


def test_two_forces_taken_one_after_the_other_are_taken_at_once() -> None:
    """Both are linear about the same place: the same as one update with both of them."""
    frame = body_axes(vehicle_of(Glide(9.0, (8.5, 0.0, 1.4)).state, 0.0))
    elevator, noise = 0.0, 0.05
    mean, covariance = np.array([8.1, 1.1]), np.array([[1.0, 0.2], [0.2, 0.8]])
    k = 0.5 * AERO.air_density_kgpm3 * AERO.wing_area_m2 / AERO.mass_kg

    def forces(at: Any) -> Any:
        """Specific normal force upward and axial one forward."""
        u, w = through_air(frame, at[0], at[1])
        speed = sqrt(u * u + w * w)
        cl, _, cd, _ = lift_drag(AERO, atan2(w, u), elevator)
        return np.array([k * speed * (cl * u + cd * w), k * speed * (cl * w - cd * u)])

    step_mps = 1e-5
    slopes = [(forces(mean + d) - forces(mean - d)) / (2 * step_mps) for d in step_mps * np.eye(2)]
    h = np.column_stack(slopes)
    _, cl_alpha, _, _ = lift_drag(AERO, atan2(*through_air(frame, *mean)[::-1]), elevator)
    rough = (STALL_NOISE_MPS2 * (1.0 - cl_alpha / AERO.CL_alpha)) ** 2
    own = (LIFT_ERROR * AERO.gravity_mps2) ** 2, (DRAG_ERROR * AERO.gravity_mps2 / GLIDE_RATIO) ** 2
    measured = forces(mean) + np.array([0.6, -0.1])
    s = h @ covariance @ h.T + np.diag([noise**2 + rough + each for each in own])
    wanted = mean + covariance @ h.T @ np.linalg.solve(s, measured - forces(mean))

    posterior = (mean[0], mean[1]), (1.0, 0.2, 0.8), (0.0,) * 10
    (found, _, _), taken = _take_forces(
        AERO, posterior, frame, 0.0, (measured[1], -measured[0]), (noise, noise), elevator
    )
    assert taken == 2
    assert found == pytest.approx(tuple(wanted), abs=1e-6)


VELOCITY_SD_MPS = 0.1
DRAWS = 60


def drawn(seed: int, pitot: bool) -> tuple[float, float]:
    """(wind's, updraft's) squared error over its variance, all that is wrong drawn as supposed."""
    gauss = random.Random(seed).gauss
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    truth = vehicle_of(glide.state, 0.0)
    lift, drag = 1.0 + gauss(0.0, LIFT_ERROR), 1.0 + gauss(0.0, DRAG_ERROR)
    wing = AERO._replace(
        CL0=AERO.CL0 * lift,
        CL_alpha=AERO.CL_alpha * lift,
        CD0=AERO.CD0 * drag,
        CD_lift=AERO.CD_lift * drag / lift**2,
        Cm0=AERO.Cm0 + AERO.Cm_alpha * gauss(0.0, TRIM_ERROR_RAD),
    )
    params = PARAMS._replace(aerodynamics=wing)
    read = truth._replace(
        pitch_rad=truth.pitch_rad + gauss(0.0, PARAMS.alignment_rad),
        velocity_x_mps=truth.velocity_x_mps + gauss(0.0, VELOCITY_SD_MPS),
        climb_mps=truth.climb_mps + gauss(0.0, VELOCITY_SD_MPS),
    )
    bias = gauss(0.0, 0.1), gauss(0.0, 0.1)
    pitot_bias = gauss(0.0, PITOT_BIAS_MPS)
    state, speed = initial_wind(), NO_AIRSPEED
    for n in range(1, 800):
        now = n * DT
        noise = bias[0] + gauss(0.0, FORCE_NOISE_MPS2), 0.0, bias[1] + gauss(0.0, FORCE_NOISE_MPS2)
        force = measure_imu(MODEL, glide.state, glide.air, False, n, now, noise, NONE)
        if pitot and n % 4 == 0:
            u = glide.truth.airspeed_mps * cos(glide.truth.alpha_rad)
            speed = AirspeedSample(n // 4, now, u + pitot_bias + gauss(0.0, PITOT_NOISE_MPS))
        state, air = wind_step(
            params, state, read, inputs_at(now, force, speed), VELOCITY_SD_MPS, glide.elevator, True
        )
    return (
        ((air.wind_mps - glide.air[0]) / air.wind_sigma_mps) ** 2,
        ((air.updraft_mps - glide.air[2]) / air.updraft_sigma_mps) ** 2,
    )


@pytest.mark.parametrize("pitot", [True, False])
def test_the_errors_are_as_large_as_it_says(pitot: bool) -> None:
    """Everything that is wrong is drawn as the estimator supposes, but for two things.

    The wind does not change, and what is constant is not also rough as near the stall: its
    uncertainty of the wind may be too large by that, of the updraft it hardly is.  The mean of
    squares of DRAWS normal numbers is 1, give or take 3 sqrt(2 / DRAWS).
    """
    draws = [drawn(seed, pitot) for seed in range(DRAWS)]
    wind, updraft = (sum(column) / DRAWS for column in zip(*draws, strict=True))
    assert 0.4 < wind < 1.55
    assert 0.65 < updraft < 1.55


def test_the_wing_is_that_of_the_simulated_aircraft() -> None:
    for alpha in (-0.1, 0.0, 0.1, 0.15, 0.2, 0.24, 0.3):
        cl, cl_alpha, cd, cd_alpha = lift_drag(AERO, alpha, 0.3)
        truth = aircraft.lift_drag(MODEL, alpha, 0.3)
        # Left out: what an incidence across the stream takes of the lift, and the negative stall.
        assert (cl, cd) == pytest.approx(truth, abs=0.02)
        above = lift_drag(AERO, alpha + 1e-6, 0.3)
        assert (above[0] - cl) / 1e-6 == pytest.approx(cl_alpha, abs=1e-3)
        assert (above[2] - cd) / 1e-6 == pytest.approx(cd_alpha, abs=1e-3)


def test_a_blocked_pitot_is_refused() -> None:
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    *_, (state, air) = glide.measured(4.0, imu=True, pitot=True, pitot_mps=0.0)
    assert air.airspeed_mps == pytest.approx(glide.truth.airspeed_mps, abs=0.1)
    assert not air.measured
    assert state.refused > 100


@pytest.mark.parametrize("late_s", [0.4, 0.6, 3.0, nan])
def test_a_pitot_s_sample_that_comes_late_is_of_other_air(late_s: float) -> None:
    """Half a second at most: in a wind's own gusts, of 5 m, the next half second is another."""
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    *_, (state, _) = glide.measured(4.0, imu=True, pitot=False)
    now = 4.0 + DT
    speed = AirspeedSample(1, now - late_s, glide.truth.airspeed_mps + 1.0)
    force = imu_of(glide.state, glide.air, 801, now)
    after = [
        wind_step(PARAMS, state, vehicle_of(glide.state, now), inputs_at(now, force, each),
                  EXACT, glide.elevator, True)
        for each in (NO_AIRSPEED, speed)
    ]  # fmt: skip
    (_, without), (with_it, air) = after
    taken = late_s < 0.5
    assert (air.airspeed_mps > without.airspeed_mps + 0.01) == taken
    assert air.measured == taken
    assert with_it.airspeed_sequence == 1, "it is not looked at again"
    assert with_it.refused == state.refused, "what is late is not wrong"


def test_accelerations_that_were_refused_leave_no_trace() -> None:
    """20 spikes of 40 g that the estimator of motion has refused; averaged they stay for BIAS_S."""
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    worst = []
    for spiked in (False, True):
        *_, (state, _) = glide.measured(4.0, imu=True, pitot=False)
        updrafts = []
        for n in range(801, 1600):
            now = n * DT
            force = imu_of(glide.state, glide.air, n, now)
            bad = n < 821
            if bad and spiked:
                force = force._replace(force_z_frd_mps2=390.0)
            inputs = inputs_at(now, force)
            vehicle = vehicle_of(glide.state, now)
            state, air = wind_step(PARAMS, state, vehicle, inputs, EXACT, glide.elevator, not bad)
            updrafts.append(abs(air.updraft_mps - 1.4))
        worst.append(max(updrafts))
    assert worst[1] == worst[0]
    assert worst[0] < 0.1


def test_accelerations_that_always_come_too_late_are_as_good_as_none() -> None:
    """Not worse: with neither theirs nor those of steady flight nothing would hold the airspeed."""
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    *_, (_, without) = glide.measured(8.0, imu=False, pitot=False)
    state = initial_wind()
    for n in range(1, round(8.0 / DT) + 1):
        now = n * DT
        inputs = inputs_at(now, imu_of(glide.state, glide.air, n, now - 0.12))
        vehicle = vehicle_of(glide.state, now)
        state, air = wind_step(PARAMS, state, vehicle, inputs, EXACT, glide.elevator, False)
    assert air == without


def test_what_is_not_known_is_not_reported() -> None:
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    vehicle, inputs = vehicle_of(glide.state, 1.0), inputs_at(1.0)
    for params, state_now, sigma in (
        (PARAMS._replace(aerodynamics=NO_AERODYNAMICS), vehicle, EXACT),
        (PARAMS, vehicle._replace(pitch_rad=nan), EXACT),
        (PARAMS, vehicle._replace(climb_mps=inf), EXACT),
        (PARAMS, vehicle, nan),
        (PARAMS, vehicle, inf),
    ):
        state, air = wind_step(params, initial_wind(), state_now, inputs, sigma, 0.0, True)
        assert all(isnan(number) for number in air[:7])
        assert not air.measured
        assert isnan(state.time_s)


def test_it_is_reset_after_a_gap_and_after_bad_numbers() -> None:
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    *_, (state, air) = glide.measured(3.0, imu=True, pitot=True)
    later, _ = wind_step(
        PARAMS, state, vehicle_of(glide.state, 5.0), inputs_at(5.0), EXACT, 0.0, True
    )
    assert later.posterior.p_xx > 10.0 * state.posterior.p_xx
    lost, nothing = wind_step(
        PARAMS,
        state,
        vehicle_of(glide.state, 3.005)._replace(roll_rad=nan),
        inputs_at(3.005),
        EXACT,
        0.0,
        True,
    )
    assert isnan(nothing.airspeed_mps)
    _, again = wind_step(
        PARAMS, lost, vehicle_of(glide.state, 3.01), inputs_at(3.01), EXACT, 0.0, True
    )
    assert isfinite(again.airspeed_mps)
    assert again.updraft_sigma_mps > air.updraft_sigma_mps


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(NUMBERS, min_size=18, max_size=18), st.integers(0, 3))
@example([0.0] * 18, 1)
@example([1e308] * 18, 3)
@example([-1e308] * 18, 3)
def test_no_number_makes_it_raise_and_it_recovers(numbers: list[float], sensors: int) -> None:
    glide = Glide(9.0, (8.5, 0.0, 1.4))
    *_, (state, _) = glide.measured(0.1, imu=True, pitot=True)
    bad: Any = numbers
    force = ImuSample._make((99, 0.105, *bad[:6])) if sensors & 1 else NO_IMU
    speed = AirspeedSample(99, 0.105, bad[6]) if sensors & 2 else NO_AIRSPEED
    state, air = wind_step(
        PARAMS,
        state,
        VehicleState._make((0.105, *bad[6:18])),
        inputs_at(0.105, force, speed),
        bad[1],
        bad[0],
        True,
    )
    assert air == NO_AIR or isnan(air.airspeed_mps) or 0.0 < air.airspeed_mps < 30.0
    for n in range(800):
        now = 0.11 + n * DT
        force = imu_of(glide.state, glide.air, 100 + n, now)
        speed = measure_airspeed(MODEL, glide.state, glide.air, 100 + n // 4, now, 0.0)
        vehicle = vehicle_of(glide.state, now)
        state, air = wind_step(
            PARAMS, state, vehicle, inputs_at(now, force, speed), EXACT, glide.elevator, True
        )
    assert air.airspeed_mps == pytest.approx(glide.truth.airspeed_mps, abs=0.3)


def test_an_airframe_without_a_model_has_no_aerodynamics() -> None:
    assert replace(AIRFRAME, model={}).aerodynamics() is NO_AERODYNAMICS
    partly = {k: v for k, v in AIRFRAME.model.items() if k != "CD_lift"}
    assert replace(AIRFRAME, model=partly).aerodynamics() is NO_AERODYNAMICS
    assert AERO.mass_kg == 0.699
    assert AERO.polar == AIRFRAME.polar.as_polar()


def test_a_wing_that_lifts_downward_is_refused(tmp_path: Any) -> None:
    text = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
    path = tmp_path / "bad.toml"
    path.write_text(text.replace("CL_alpha = 4.6", "CL_alpha = -4.6"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"model.CL_alpha = -4.6: must be from 0\.5 to 8"):
        load_airframe(path)


@pytest.mark.parametrize("speed_mps", [8.0, 9.0, 11.0])
def test_the_pitch_of_a_glide_is_that_of_the_simulated_one(speed_mps: float) -> None:
    """The polar is a cubic of that model's glides, good to 0.03 m/s at the slow end."""
    found = glide_pitch(AERO, speed_mps)
    assert found == pytest.approx(glide_at(MODEL, speed_mps).pitch_rad, abs=0.012)
    assert isnan(glide_pitch(AERO, 5.0))
