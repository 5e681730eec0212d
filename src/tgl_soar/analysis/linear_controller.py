"""The controller, linear: sensors, estimator and laws, from the truth to the elevator's command.

Everything is made of what flies: the laws `soaring_step` and `attitude_step`, and the estimator's
`spread`, `position_taken` and `velocity_taken`.  Fixes come every N ticks, so that it is periodic.

With accelerations the estimate of place and velocity follows the truth by itself (the
accelerometers feel what the aircraft does), so that the filter's errors come from noise alone; the
delay of fixes then only makes them older, and is left out of them.
"""

from __future__ import annotations

from functools import lru_cache
from math import inf
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.analysis.linear_plant import TRUTH, Condition, Matrix, Periodic
from tgl_soar.control.attitude import attitude_step, followed_rate
from tgl_soar.control.gain_blend import pid_between, soaring_between
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.pitch_schedule import pitch_gains, schedule_at_age, soaring_gains
from tgl_soar.control.soaring import SoaringGains, SoaringState, soaring_step
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    position_taken,
    spread,
    velocity_taken,
)
from tgl_soar.estimation.motion_state import ACCELERATION_S, BIAS_S, MotionGains
from tgl_soar.sim.aircraft import glide_at
from tgl_soar.sim.sensors import Sensors, SensorTiming, sensor_timing

NOISES: Final = 5  # white: fix's place, fix's velocity, attitude, gyro, specific force
_LAWS: Final = 5  # integral and rate of both, and the last setpoint


class _PlaceEstimate(NamedTuple):
    """What the laws go by, and what is remembered for it."""

    e_rho_m: float
    rate_mps: float
    fixes: list[Matrix]  # on their way, the newest first
    estimate: Matrix


class _Controller(NamedTuple):
    """All that a tick needs.  Its states: attitudes on their way, fixes on theirs, the filter's
    estimate (with accelerations: its error), the laws' integrals and rates, the last setpoint."""

    dt_s: float
    soaring: SoaringGains
    pitch: PidGains
    setpoint_weight: float
    inertial: bool  # it goes by accelerations
    errors: bool  # with what noise makes of the estimate, where it is inertial
    late: int  # ticks, of the attitude
    fixes: SensorTiming
    period: int  # ticks
    gives_velocity: bool
    take: Matrix
    carry: Matrix

    @property
    def fix_line(self) -> int:
        """Fixes on their way."""
        return 0 if self.inertial else self.fixes.delay_steps

    @property
    def filter_size(self) -> int:
        """States of the filter."""
        return 2 if not self.inertial else 3 if self.errors else 0

    @property
    def size(self) -> int:
        """States."""
        return self.late * TRUTH + 2 * self.fix_line + self.filter_size + _LAWS

    def tick(self, phase: int, vector: Matrix) -> Matrix:
        """States, the truth, an injection, noises to next states, command and setpoint."""
        size, late = self.size, self.late
        truth, injected = vector[size : size + TRUTH], vector[size + TRUTH]
        noises = vector[size + TRUTH + 1 :]
        delay_line = [vector[TRUTH * i : TRUTH * (i + 1)] for i in range(late)]
        sample = truth + np.array([0.0, 0.0, noises[2], noises[3]])
        delayed = delay_line[-1] if late else sample
        after_line = [sample, *delay_line[:-1]] if late else []
        # What is late is carried on by its rate, as the estimator does.
        pitch_rad, rate_radps = delayed[2] + late * self.dt_s * delayed[3], delayed[3]
        remembered = vector[late * TRUTH : size - _LAWS]
        place = (self._with_accelerations if self.inertial else self._fixed)(
            phase, remembered, delayed, truth, noises
        )
        outer, outer_rate, inner, inner_rate, before = vector[size - _LAWS : size]
        soared, outer_terms = soaring_step(
            self.soaring,
            SoaringState(PidState(float(outer), float(outer_rate)), 0.0, 0),
            0.0,
            float(place.e_rho_m),
            float(place.rate_mps),
            self.dt_s,
            0,
        )
        setpoint_rad = outer_terms.output + float(injected)
        weight, dt = self.setpoint_weight, self.dt_s
        flown, inner_terms = attitude_step(
            self.pitch,
            PidState(float(inner), float(inner_rate)),
            setpoint_rad,
            float(pitch_rad),
            float(rate_radps),
            0.0,
            self.dt_s,
            0,
            setpoint_rate_radps=followed_rate(weight, setpoint_rad, float(before), inf, dt),
        )
        return np.concatenate(
            [
                *after_line,
                *place.fixes,
                place.estimate,
                [soared.pid.integral, soared.pid.rate, flown.integral, flown.rate, setpoint_rad],
                [inner_terms.output, outer_terms.output],
            ]
        )

    def _with_accelerations(
        self, phase: int, estimate: Matrix, delayed: Matrix, _truth: Matrix, noises: Matrix
    ) -> _PlaceEstimate:
        """With accelerations; the state is truth less estimate, driven by noise alone."""
        dt = self.dt_s
        e, rate = delayed[0] + self.late * dt * delayed[1], delayed[1]
        if self.errors:
            estimate = self.carry @ estimate + np.array([0.5 * dt * dt, dt, 0.0]) * noises[4]
            if phase == 0:
                noise = np.array([noises[0], self.gives_velocity * noises[1]])
                estimate = estimate - self.take @ (noise + estimate[:2])
            e, rate = e - estimate[0], rate - estimate[1]
        return _PlaceEstimate(e, rate, [], estimate)

    def _fixed(
        self, phase: int, remembered: Matrix, _delayed: Matrix, truth: Matrix, noises: Matrix
    ) -> _PlaceEstimate:
        """By fixes alone, between which it goes on as it was."""
        line, dt = self.fix_line, self.dt_s
        fixes = [remembered[2 * i : 2 * i + 2] for i in range(line)]
        estimate = remembered[2 * line :]
        fix = np.array([truth[0] + noises[0], truth[1] + noises[1]])
        arrived = fixes[-1] if line else fix
        since = (phase - line) % self.period
        if since == 0:
            predicted = np.array([estimate[0] + self.period * dt * estimate[1], estimate[1]])
            estimate = predicted + self.take @ (arrived - predicted)
        age = (line + since) * dt
        after = [fix, *fixes[:-1]] if line else []
        return _PlaceEstimate(estimate[0] + age * estimate[1], estimate[1], after, estimate)


def linear_controller(laws: Laws, condition: Condition, errors: bool = False) -> Periodic:
    """Inputs: the truth's four, an injection into the pitch setpoint, noises.  Outputs: elevator
    command, pitch setpoint before the injection.

    errors: with what the filter's errors add where accelerations are used (no margin needs it).
    """
    controller = _controller(laws, condition, errors)
    size = controller.size
    a, b, c, d = [], [], [], []
    for phase in range(controller.period):
        inputs = np.eye(size + TRUTH + 1 + NOISES)  # no limit acts: it is linear as it stands
        jacobian = np.array([controller.tick(phase, unit) for unit in inputs]).T
        a.append(jacobian[:size, :size])
        b.append(jacobian[:size, size:])
        c.append(jacobian[size:, :size])
        d.append(jacobian[size:, size:])
    return Periodic(a, b, c, d)


def goes_by_accelerations(laws: Laws, sensors: Sensors) -> bool:
    """Whether the gains with accelerometers are flown."""
    return sensors.imu is not None and laws.motion.use_imu


def _controller(laws: Laws, condition: Condition, errors: bool) -> _Controller:
    sensors, dt = condition.sensors, 1.0 / condition.step_hz
    position = sensors.position
    timing = sensor_timing("position", position.rate_hz, position.delay_s, condition.step_hz)
    inertial = goes_by_accelerations(laws, sensors)
    source = sensors.imu if sensors.imu is not None and inertial else sensors.attitude
    late = sensor_timing("attitude", source.rate_hz, source.delay_s, condition.step_hz).delay_steps
    take, carry = fix_matrices(laws.motion, timing.period_steps * dt, dt, sensors, inertial)
    soaring, pitch = _unlimited(laws, condition, late * dt, 1.0 if inertial else 0.0)
    return _Controller(
        dt_s=dt,
        soaring=soaring,
        pitch=pitch,
        setpoint_weight=laws.setpoint_weight if inertial else 0.0,
        inertial=inertial,
        errors=errors,
        late=late,
        fixes=timing,
        period=timing.period_steps if errors or not inertial else 1,
        gives_velocity=position.gives_velocity,
        take=take,
        carry=carry,
    )


def _unlimited(
    laws: Laws, condition: Condition, late_s: float, weight: float
) -> tuple[SoaringGains, PidGains]:
    """The gains as they are scheduled there, and no limit acts; weight: of the accelerations'."""
    airspeed = glide_at(condition.model, condition.speed_mps).airspeed_mps
    schedule = schedule_at_age(laws.schedule, late_s)
    soaring = soaring_gains(
        soaring_between(laws.soaring, laws.soaring_imu, weight),
        schedule,
        weight,
        airspeed,
        eta_from_lean(condition.lean_rad),
    )
    pitch = pitch_gains(pid_between(laws.pitch, laws.pitch_imu, weight), schedule, airspeed)
    wide = {"output_min": -1e9, "output_max": 1e9, "integral_max": 1e9}
    soaring = soaring._replace(slew_radps=1e9, pid=soaring.pid._replace(**wide))
    return soaring, pitch._replace(**wide)


# A minute of ticks, whatever the gains of the loop: its results are read only.
@lru_cache(maxsize=64)
def fix_matrices(
    gains: MotionGains, interval_s: float, dt_s: float, sensors: Sensors, inertial: bool
) -> tuple[Matrix, Matrix]:
    """The filter at rest: what a fix's innovations (place, velocity before it) add to the errors,
    and how errors (place, velocity, bias) are carried on over a tick."""
    coupling = 1.0 if inertial else 0.0
    if inertial:
        assert sensors.imu is not None
        density = gains.force_sd_mps2**2 / sensors.imu.rate_hz
        bias_density = gains.bias_sd_mps2**2 / BIAS_S
    else:
        density = 2.0 * gains.unknown_sd_mps2**2 * ACCELERATION_S
        bias_density = 0.0
    velocity = sensors.position.gives_velocity

    def taken(covariance: Covariance, place: float, rate: float) -> Errors:
        none = Errors._make((*[0.0] * 10, covariance))
        errors = position_taken(none, place, 0.0, 0.0, gains.fix_sd_m**2)
        if velocity:
            left = rate - errors.velocity_x_mps
            errors = velocity_taken(errors, left, 0.0, 0.0, gains.velocity_sd_mps**2)
        return errors

    bias = gains.bias_sd_mps2**2 if inertial else 0.0
    covariance = Covariance(pp=1.0, pv=0.0, pb=0.0, vv=1.0, vb=0.0, bb=bias)
    # A filter of bandwidth ω settles in a few / ω; the slowest here, the bias, in about 10 s.
    for _ in range(round(60.0 / interval_s)):
        covariance = Covariance._make(
            spread(covariance, interval_s, coupling, density, bias_density)
        )
        settled = covariance
        covariance = taken(covariance, 0.0, 0.0).covariance
    columns = []
    for place, rate in ((1.0, 0.0), (0.0, 1.0)):
        errors = taken(settled, place, rate)
        columns.append([errors.x_m, errors.velocity_x_mps, errors.bias_x_mps2])
    take = np.array(columns).T
    carry = np.array([[1.0, dt_s, -0.5 * dt_s * dt_s], [0.0, 1.0, -dt_s], [0.0, 0.0, 1.0]])
    return (take if inertial else take[:2]), carry
