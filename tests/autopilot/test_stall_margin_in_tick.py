"""The margin to the stall without a pitot tube: where it is known, and what it does."""

from __future__ import annotations

from itertools import pairwise
from math import cos, degrees, hypot, inf, isfinite, nan, radians, sin

import pytest

from tgl_soar.autopilot import Output
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.envelope import CUT_NOSE_UP, PITCH_PER_SPEED
from tgl_soar.control.envelope_margins import STALL_UNCERTAINTY_MAX_RAD, stall_uncertainty
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, READ_BACK, USUAL_SENSORS, Sensors
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import NO_AIR, AirEstimate

REC_PITCH = -8.0  # deg
WITH_IMU = Sensors(imu=MEMS_IMU, surfaces=READ_BACK)


def air(wind_sigma_mps: float, updraft_sigma_mps: float, alpha_rad: float = 0.1) -> AirEstimate:
    return AirEstimate(
        cross_wind_mps=0.0,
        trim_alpha_rad=alpha_rad,
        airspeed_mps=10.0,
        alpha_rad=alpha_rad,
        wind_mps=10.0,
        updraft_mps=0.5,
        excess_mps=0.0,
        wind_sigma_mps=wind_sigma_mps,
        updraft_sigma_mps=updraft_sigma_mps,
        measured=False,
    )


def test_in_level_flight_through_the_air_updraft_turns_alpha_and_wind_is_airspeed() -> None:
    assert stall_uncertainty(air(0.0, 0.2), 0.1) == pytest.approx(0.02)
    assert stall_uncertainty(air(0.3, 0.0), 0.1) == pytest.approx(0.3 * PITCH_PER_SPEED)
    assert stall_uncertainty(air(0.3, 0.2), 0.1) == pytest.approx(0.02)  # the larger of the two


def test_on_a_steep_path_each_does_some_of_either() -> None:
    gamma = -0.4
    across = hypot(cos(gamma) * 0.1, sin(gamma) * 0.2) / 10.0
    assert stall_uncertainty(air(0.2, 0.1), 0.1 + gamma) == pytest.approx(across)


@pytest.mark.parametrize("unknown", [NO_AIR, air(nan, nan), air(0.1, 0.1, nan)])
def test_what_is_not_known_is_uncertain(unknown: AirEstimate) -> None:
    assert not stall_uncertainty(unknown, 0.0) <= STALL_UNCERTAINTY_MAX_RAD


def flown(sensors: Sensors, **changes: float) -> tuple[list[Output], list[float]]:
    """The ticks of a flight of the Eclipson on line b, and the true angle of attack at each."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    assert site.air is not None
    values = load_parameters(airframe, airframe_path, site, site_path).changed(changes)
    field = build_field(site.air, site_path.parent)
    world = make_world(airframe, site, seed=1, turbulence=0.02, field=field, sensors=sensors)
    loop = ClosedLoop(world, values)
    outputs, alpha = [], []
    for _ in range(1600):
        alpha.append(world.truth.alpha_rad)
        outputs.append(loop.tick())
    assert not world.crashed
    return outputs, alpha


def test_with_accelerometers_the_margin_is_known_in_flight_and_right() -> None:
    outputs, alpha = flown(WITH_IMU, ALPHA_MAX=15.0, SPEED_MIN=1.0)
    assert all(o.margins.stall_rad == inf for o in outputs if not o.active)  # held in a hand
    flies = [(o, a) for o, a in zip(outputs, alpha, strict=True) if o.active][400:]
    known = [(15.0 - degrees(o.margins.stall_rad), degrees(a)) for o, a in flies
             if isfinite(o.margins.stall_rad)]  # fmt: skip
    assert len(known) > 0.8 * len(flies)
    rms = (sum((estimate - a) ** 2 for estimate, a in known) / len(known)) ** 0.5
    assert rms < degrees(STALL_UNCERTAINTY_MAX_RAD)


def test_with_a_pose_alone_nothing_is_known_and_nothing_limited() -> None:
    outputs, _ = flown(USUAL_SENSORS, ALPHA_MAX=5.0)
    assert all(o.margins.stall_rad == inf for o in outputs)
    assert not any(o.cut & CUT_NOSE_UP for o in outputs)


def test_near_the_limit_the_nose_is_kept_from_rising() -> None:
    outputs, _ = flown(WITH_IMU, ALPHA_MAX=10.0, SPEED_MIN=1.0, REC_PITCH=REC_PITCH)
    near = [o for o in outputs if o.active and o.margins.stall_rad < 0.0]
    assert near
    for output in near:
        highest = max(radians(REC_PITCH), output.vehicle.pitch_rad + output.margins.stall_rad)
        assert output.setpoints.pitch_rad <= highest
    assert any(output.cut & CUT_NOSE_UP for output in near)


def test_what_the_envelope_cuts_off_the_setpoint_winds_up_no_integral() -> None:
    """Upstream of its line and near the stall the law asks for more nose than it may have."""
    outputs, _ = flown(WITH_IMU, ALPHA_MAX=10.0, SPEED_MIN=1.0, REC_PITCH=REC_PITCH)
    flown_on = [
        (before, after)
        for before, after in pairwise(outputs)
        if before.mode == after.mode and after.mode in (CAPTURING, SOARING)
    ]
    cut = [
        (before, after)
        for before, after in flown_on
        if before.cut & CUT_NOSE_UP and after.line.e_rho_m > 0.0
    ]
    assert len(cut) > 10
    for before, after in cut:
        assert after.soaring.i <= before.soaring.i


def test_whatever_the_pitch_loop_asks_the_elevator_holds_no_stall() -> None:
    """With a pose alone nothing is known of the air, and a gain that is too large asks for more."""
    outputs, _ = flown(USUAL_SENSORS, ELE_P=20.0, ALPHA_MAX=9.0)
    aero = load_airframe(shipped("airframes/eclipson_c.toml")).aerodynamics()
    glide = ((aero.CD0 / aero.CD_lift) ** 0.5 - aero.CL0) / aero.CL_alpha  # the best one
    more = radians(9.0) + radians(8.1) - glide
    held = -aero.Cm_alpha / aero.Cm_elevator * more
    flies = [o for o in outputs if o.active]
    cut = [o for o in flies if o.cut & CUT_NOSE_UP]
    assert len(cut) >= 5
    assert not any(isfinite(o.margins.stall_rad) for o in flies)
    for output in flies:
        turning = -0.5 * aero.Cm_q * aero.chord_m * max(0.0, output.vehicle.pitch_rate_radps)
        most = held + turning / (9.0 * aero.Cm_elevator)  # the best glide is at 9.25 m/s
        assert output.command.elevator <= most
