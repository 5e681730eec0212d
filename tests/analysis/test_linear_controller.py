"""The linear controller against a second implementation, sample by sample, and its filter
against the Riccati equation."""

from __future__ import annotations

from collections import deque
from functools import lru_cache
from math import radians

import numpy as np
import pytest
from msgspec.structs import asdict
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from tgl_soar.analysis.linear_controller import NOISES, fix_matrices, linear_controller
from tgl_soar.analysis.linear_plant import Condition, Periodic
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.gain_blend import pid_between, soaring_between
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import pitch_gains, schedule_at_age, soaring_gains
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.estimation.motion_state import MotionGains
from tgl_soar.sim.aircraft import aircraft_model, glide_at
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
DT_S = 0.005
TICKS = 50
TRUTH, INPUTS = 4, 4 + 1 + 5
LEAN_RAD = radians(20.0)
GAINS = MotionGains(
    fix_sd_m=0.02,
    velocity_sd_mps=0.05,
    force_sd_mps2=0.3,
    bias_sd_mps2=0.4,
    unknown_sd_mps2=3.0,
    fix_delay_s=0.0,
    fix_gate_m=1.0,
    reset_max_m=0.0,
    use_imu=True,
)

Floats = NDArray[np.float64]


def with_delays(imu: bool, attitude_s: float, fix_s: float, velocity: bool = True) -> Sensors:
    """Fixes at 50 Hz: every fourth tick.  With accelerometers attitudes are theirs, and older ones
    of the autopilot stay unused."""
    unused_s = 0.02 if imu else 0.0
    return USUAL_SENSORS._replace(
        position=USUAL_SENSORS.position._replace(
            rate_hz=50.0, delay_s=fix_s, gives_velocity=velocity
        ),
        attitude=USUAL_SENSORS.attitude._replace(rate_hz=200.0, delay_s=attitude_s + unused_s),
        imu=MEMS_IMU._replace(delay_s=attitude_s) if imu else None,
    )


def condition(sensors: Sensors) -> Condition:
    return Condition(
        model=aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model),
        servo=servo_params(AIRFRAME.model),
        speed_mps=9.5,
        lean_rad=LEAN_RAD,
        sensors=sensors,
    )


@lru_cache(maxsize=2)
def laws(use_imu: bool = True) -> Laws:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
    return laws_from(values.changed({"EST_IMU": float(use_imu)}), SITE.frame())


def gains_there(weight: float, late_s: float) -> tuple[PidGains, PidGains]:
    """Of line and pitch, as the schedule has them at the glide's airspeed."""
    known, there = laws(), condition(USUAL_SENSORS)
    airspeed = glide_at(there.model, there.speed_mps).airspeed_mps
    schedule = schedule_at_age(known.schedule, late_s)
    line = soaring_gains(
        soaring_between(known.soaring, known.soaring_imu, weight),
        schedule,
        weight,
        airspeed,
        eta_from_lean(LEAN_RAD),
    )
    pitch = pitch_gains(pid_between(known.pitch, known.pitch_imu, weight), schedule, airspeed)
    return line.pid, pitch


class Pid:
    """u = kp e + ki ∫ e dt + kd d, d the error's rate behind a low-pass."""

    def __init__(self, gains: PidGains) -> None:
        self._gains = gains
        self._integral = self._rate = 0.0

    def step(self, error: float, rate: float) -> float:
        kp, ki, kd, w = self._gains[:4]
        self._rate = (self._rate + w * DT_S * rate) / (1.0 + w * DT_S)
        self._integral += ki * error * DT_S
        return kp * error + self._integral + kd * self._rate


class Written:
    """Samples late, fixes now and then, and the laws on what is known of the truth then."""

    def __init__(self, sensors: Sensors, late: int, fix_late: int, inertial: bool) -> None:
        take, self._carry = fix_matrices(laws().motion, 0.02, DT_S, sensors, inertial)
        self._take, self._inertial = take, inertial
        line, pitch = gains_there(float(inertial), late * DT_S)
        self._line, self._pitch = Pid(line), Pid(pitch)
        self._late, self._fix_late = late, fix_late
        self._samples = deque([np.zeros(TRUTH)] * (late + 1), maxlen=late + 1)
        self._fixes = deque([np.zeros(2)] * (fix_late + 1), maxlen=fix_late + 1)
        self._estimate, self._fixed = np.zeros(2), 0
        self._error = np.zeros(3)
        self._velocity = sensors.position.gives_velocity

    def tick(self, k: int, inputs: Floats, errors: bool) -> tuple[float, float]:
        truth, injected, noise = inputs[:4], inputs[4], inputs[5:]
        self._samples.append(truth + np.array([0.0, 0.0, noise[2], noise[3]]))
        e0, rate0, pitch0, pitch_rate = self._samples[0]
        age = self._late * DT_S
        if self._inertial:
            e, rate = e0 + age * rate0, rate0
            if errors:
                pushed = noise[4] * np.array([0.5 * DT_S**2, DT_S, 0.0])
                self._error = self._carry @ self._error + pushed
                if k % 4 == 0:
                    measured = noise[:2] * [1.0, float(self._velocity)] + self._error[:2]
                    self._error = self._error - self._take @ measured
                e, rate = e - self._error[0], rate - self._error[1]
        else:
            self._fixes.append(truth[:2] + noise[:2])
            if (k - self._fix_late) % 4 == 0:  # one of the fixes' own times has arrived
                ahead = np.array([[1.0, 4.0 * DT_S], [0.0, 1.0]]) @ self._estimate
                self._estimate = ahead + self._take @ (self._fixes[0] - ahead)
                self._fixed = k - self._fix_late
            e = self._estimate[0] + (k - self._fixed) * DT_S * self._estimate[1]
            rate = self._estimate[1]
        wanted = self._line.step(e, rate)
        error = wanted + injected - (pitch0 + age * pitch_rate)
        return self._pitch.step(error, -pitch_rate), wanted


def predicted(system: Periodic, inputs: Floats) -> Floats:
    x, found = np.zeros(len(system.a[0])), []
    for k, u in enumerate(inputs):
        a, b, c, d = (each[k % len(system.a)] for each in system)
        found.append(c @ x + d @ u)
        x = a @ x + b @ u
    return np.array(found)


def alike(sensors: Sensors, late: int, fix_late: int, inertial: bool, errors: bool = False) -> None:
    inputs = np.random.default_rng(3).standard_normal((TICKS, INPUTS))
    if inertial and not errors:
        inputs[:, [5, 6, 9]] = 0.0  # they act by the filter's errors alone
    written = Written(sensors, late, fix_late, inertial)
    expected = np.array([written.tick(k, u, errors) for k, u in enumerate(inputs)])
    system = linear_controller(laws(inertial or sensors.imu is None), condition(sensors), errors)
    assert len(system.a) == (1 if inertial and not errors else 4)
    assert NOISES == 5
    found = predicted(system, inputs)
    assert found.shape == (TICKS, 2)
    for n in (0, 1):
        scale = float(np.abs(expected[:, n]).max())
        assert found[:, n] == pytest.approx(expected[:, n], abs=1e-9 * scale)


@pytest.mark.parametrize(("attitude_s", "late"), [(0.0, 0), (0.005, 1), (0.015, 3)])
@pytest.mark.parametrize(("fix_s", "fix_late"), [(0.0, 0), (0.01, 2), (0.03, 6)])
def test_by_fixes_alone_it_is_the_controller_that_is_written_down(
    attitude_s: float, late: int, fix_s: float, fix_late: int
) -> None:
    alike(with_delays(False, attitude_s, fix_s), late, fix_late, inertial=False)


@pytest.mark.parametrize(("attitude_s", "late"), [(0.0, 0), (0.015, 3)])
@pytest.mark.parametrize("errors", [False, True])
@pytest.mark.parametrize("velocity", [False, True])
def test_with_accelerations_likewise(
    attitude_s: float, late: int, errors: bool, velocity: bool
) -> None:
    """Fixes' delay only makes the filter's errors older: it is left out."""
    sensors = with_delays(True, attitude_s, 0.03, velocity)
    alike(sensors, late, 0, inertial=True, errors=errors)


def test_accelerometers_that_are_not_used_are_none() -> None:
    """Attitude and its delay are those of the autopilot then."""
    sensors = with_delays(True, 0.0, 0.0)
    sensors = sensors._replace(attitude=sensors.attitude._replace(delay_s=0.01))
    alike(sensors, 2, 0, inertial=False)


# --- the filter ---------------------------------------------------------------------------------


def settled(inertial: bool, velocity: bool, interval_s: float) -> Floats:
    """What a fix's innovations add, by the Riccati equation: P Hᵀ (H P Hᵀ + R)⁻¹."""
    t = interval_s
    if inertial:
        q, q_bias = GAINS.force_sd_mps2**2 / 200.0, GAINS.bias_sd_mps2**2 / 300.0
    else:
        q, q_bias = 2.0 * GAINS.unknown_sd_mps2**2 * 0.1, 0.0
    f = np.array([[1.0, t, -0.5 * t * t], [0.0, 1.0, -t], [0.0, 0.0, 1.0]])
    noise = q * np.array([[t**3 / 3.0, t**2 / 2.0, 0.0], [t**2 / 2.0, t, 0.0], [0.0, 0.0, 0.0]])
    noise += q_bias * np.array(
        [
            [t**5 / 20.0, t**4 / 8.0, -(t**3) / 6.0],
            [t**4 / 8.0, t**3 / 3.0, -(t**2) / 2.0],
            [-(t**3) / 6.0, -(t**2) / 2.0, t],
        ]
    )
    size, measured = (3 if inertial else 2), (2 if velocity else 1)
    f, noise = f[:size, :size], noise[:size, :size]
    h = np.eye(measured, size)
    r = np.diag([GAINS.fix_sd_m**2, GAINS.velocity_sd_mps**2][:measured])
    p = solve_discrete_are(f.T, h.T, noise, r)
    take = np.zeros((size, 2))
    take[:, :measured] = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
    return take


@pytest.mark.parametrize("inertial", [False, True])
@pytest.mark.parametrize("velocity", [False, True])
@pytest.mark.parametrize("interval_s", [0.02, 0.1])
def test_the_filter_is_that_of_the_riccati_equation(
    inertial: bool, velocity: bool, interval_s: float
) -> None:
    sensors = with_delays(inertial, 0.0, 0.0, velocity)
    take, carry = fix_matrices(GAINS, interval_s, DT_S, sensors, inertial)
    expected = settled(inertial, velocity, interval_s)
    assert take == pytest.approx(expected, rel=2e-3, abs=1e-5)
    assert carry[:, 2] == pytest.approx([-0.5 * DT_S**2, -DT_S, 1.0])
    assert carry[:2, :2].tolist() == [[1.0, DT_S], [0.0, 1.0]]
    assert carry[2, :2].tolist() == [0.0, 0.0]
