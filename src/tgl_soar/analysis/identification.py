"""The short period, the elevator's effect and the servo's delay, from doublets in gliding flight.

Output error: the model flies each manoeuvre from the commands that were given, and its unknowns
are those with which it lies closest to what was measured.

    α̇ = q − (ρ S V / 2m) C_L + (g / V) cos(θ − α)         C_L = C_L0 + C_Lα α + C_Lδ δ + C_Lb b
    q̇ = (ρ S c V² / 2I) (C_m0 + C_mα sin α + C_mδ δ + C_mb b + (c / 2V) C_mq q)
    θ̇ = q,     δ = servo(command(t − T))                  V as measured: it changes slowly

α  rad    angle of attack          q  rad/s  pitch rate         θ  rad  pitch (wings level)
V  m/s    true airspeed            δ  –      elevator, −1 … 1    T  s    pure delay
b  –      brake, 0 … 1, by a servo of the same kind
ρ  kg/m³  S m²  c m  m kg  I kg m² (pitch): from the airframe file, as are the servo's lag and rate

Measured are q, θ, the angle of attack θ − γ (γ from the velocity through the air: in still air
that over the ground) and, with accelerometers, C_L.  Each may have a constant error.  Every
manoeuvre begins at values of its own.  What the brake does is asked where it stands in different
places: moved in a manoeuvre, or glided with.

Gauss–Newton, outputs weighted by their residuals.  Residuals are coloured (turbulence, what the
model leaves out), so the covariance is not (JᵀJ)⁻¹ but (JᵀJ)⁻¹ M (JᵀJ)⁻¹ with M the sum of the
scores' autocovariances over `COLOUR_S` (Newey and West 1987).  The last manoeuvres are held out:
the fitted model flies them, and the share of what happened that it explains is reported.

The same symbols as in `sim.aircraft`.  Textbook: Jategaonkar, Flight Vehicle System
Identification, chapter 4.  For the ground only: takes arrays, imports numpy when called.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import TYPE_CHECKING, Final, NamedTuple

from tgl_soar.analysis.manoeuvres import (
    AFTER_S,
    LEAST_STEP,
    LONGEST_S,
    QUIET_S,
    STEP_S,
    LongitudinalLog,
    brakings,
    manoeuvres,
)
from tgl_soar.estimation.polar import BRAKE_SPAN, student_t
from tgl_soar.types import GRAVITY_MPS2

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

DELAY_MAX_S: Final = 0.3
FEWEST: Final = 3  # manoeuvres to fit
HELD_OUT: Final = 4  # one of so many
COLOUR_S: Final = 0.4
_ROUNDS: Final = 25
_WEIGHINGS: Final = 3
_CONVERGED: Final = 1e-7  # of the cost, in one round

NAMES: Final = ("CL0", "CL_alpha", "CL_elevator", "Cm0", "Cm_alpha", "Cm_q", "Cm_elevator", "delay")
BRAKE_NAMES: Final = ("CL_brake", "Cm_brake")
_FIRST: Final = (0.3, 4.5, -0.1, 0.05, -0.6, -8.0, 0.25, 0.02)
_STEPS: Final = (1e-3, 1e-2, 1e-3, 1e-4, 1e-3, 1e-1, 1e-3, 0.5 * STEP_S)
_BRAKE_STEPS: Final = (1e-3, 1e-3)
# Starting values of one manoeuvre, and the measurements' constant errors in it.
_STARTS: Final = ("alpha", "q", "theta")
_START_STEPS: Final = (1e-3, 1e-2, 1e-3)
_ERRORS: Final = ("q", "alpha", "lift")
_ERROR_STEPS: Final = (1e-3, 1e-3, 1e-3)
_FIRST_WEIGHTS: Final = (1.0 / 0.01, 1.0 / 0.002, 1.0 / 0.005, 1.0 / 0.02)  # of the outputs
_DELAY: Final = NAMES.index("delay")


class IdentificationError(ValueError):
    """A log from which nothing can be identified; the message says what would help."""


class KnownAircraft(NamedTuple):
    """What is known of the aircraft beforehand."""

    mass_kg: float
    wing_area_m2: float
    chord_m: float
    iyy_kgm2: float
    air_density_kgpm3: float
    servo_lag_radps: float
    servo_rate_per_s: float


class Estimate(NamedTuple):
    """One figure with its band of 95 %."""

    name: str
    value: float
    standard_error: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Identified:
    """What the manoeuvres tell."""

    derivatives: tuple[Estimate, ...]  # as `NAMES`; of a brake that moved also `BRAKE_NAMES`
    no_brake: str  # why there is nothing of the brake; "" where there is
    frequency: Estimate  # undamped natural, of the short period [rad/s]
    damping: Estimate
    effectiveness: Estimate  # pitch acceleration of a full deflection [rad/s²]
    response_delay: Estimate  # of the whole servo: pure delay and lag [s]
    airspeed_mps: float  # at which the last four hold
    manoeuvres: tuple[float, ...]  # when those began that were fitted [s]
    held_out: tuple[float, ...]  # and those that were not
    explained: float  # share of the pitch rate's variance in those held out; NaN: there are none
    fits: tuple[Fit, ...]  # of every manoeuvre, for a figure

    def __getitem__(self, name: str) -> Estimate:
        return self.derivatives[(*NAMES, *BRAKE_NAMES).index(name)]


@dataclass(frozen=True)
class Fit:
    """One manoeuvre, measured and as the model flies it."""

    time_s: Floats
    elevator: Floats
    pitch_rate_radps: Floats
    model_pitch_rate_radps: Floats
    fitted: bool  # False: held out


def identify(log: LongitudinalLog, body: KnownAircraft) -> Identified:
    """Fit the model to the manoeuvres of a log.  Errors: `IdentificationError`."""
    import numpy as np

    found = manoeuvres(log)
    held = [rows for i, rows in enumerate(found) if i % HELD_OUT == HELD_OUT - 1]
    fitted = [rows for i, rows in enumerate(found) if i % HELD_OUT != HELD_OUT - 1]
    if len(fitted) < FEWEST:
        raise IdentificationError(
            f"{len(found)} manoeuvres found, {FEWEST + 1} are needed: let the elevator stand for"
            f" {QUIET_S:g} s, move it by {LEAST_STEP:g} or more to one side and the other within"
            f" {LONGEST_S:g} s (a doublet), let it stand for {AFTER_S:g} s, wings level, in still"
            " air"
        )
    beside = brakings(log, found)
    no_brake = _brake_lacks(log, fitted + beside)
    if not no_brake:
        held += beside[HELD_OUT - 1 :: HELD_OUT]
        fitted += [rows for i, rows in enumerate(beside) if i % HELD_OUT != HELD_OUT - 1]
    problem = _Problem(log, body, fitted, brake=not no_brake)
    unknowns, covariance = problem.solve()
    freedom = max(1, len(fitted) * 3)
    t = student_t(0.95, freedom)

    def estimate(name: str, value: float, gradient: Floats, unit: str) -> Estimate:
        error = sqrt(max(0.0, float(gradient @ covariance @ gradient)))
        return Estimate(
            name=name,
            value=value,
            standard_error=error,
            low=value - t * error,
            high=value + t * error,
            unit=unit,
        )

    eye = np.eye(len(unknowns))
    units = ("", "1/rad", "", "", "1/rad", "", "", "s", "", "")
    names = (*NAMES, *BRAKE_NAMES)[: len(unknowns)]
    derivatives = tuple(
        estimate(name, float(unknowns[i]), eye[i], units[i]) for i, name in enumerate(names)
    )
    speed = float(np.mean([log.airspeed_mps[rows].mean() for rows in fitted]))
    derived = []
    for i, (name, unit) in enumerate(
        (("frequency", "rad/s"), ("damping", ""), ("effectiveness", "rad/s²"), ("response", "s"))
    ):
        gradient = np.array(
            [
                (
                    _derived(unknowns + step * row, body, speed)[i]
                    - _derived(unknowns - step * row, body, speed)[i]
                )
                / (2.0 * step)
                for row, step in zip(eye, problem.steps, strict=True)
            ]
        )
        derived.append(estimate(name, _derived(unknowns, body, speed)[i], gradient, unit))
    fits = [*problem.fits(unknowns, fitted=True)]
    explained = float("nan")
    if held:
        check = _Problem(log, body, held, brake=not no_brake)
        checked = check.fits(unknowns, fitted=False)
        explained = _explained(checked)
        fits += checked
    return Identified(
        derivatives=derivatives,
        no_brake=no_brake,
        frequency=derived[0],
        damping=derived[1],
        effectiveness=derived[2],
        response_delay=derived[3],
        airspeed_mps=speed,
        manoeuvres=tuple(float(log.time_s[rows.start]) for rows in fitted),
        held_out=tuple(float(log.time_s[rows.start]) for rows in held),
        explained=explained,
        fits=tuple(sorted(fits, key=lambda fit: float(fit.time_s[0]))),
    )


def _brake_lacks(log: LongitudinalLog, rows: Sequence[slice]) -> str:
    """What the manoeuvres lack to tell what the brake does; "": nothing."""
    import numpy as np

    if log.brake is None:
        return "the log holds no brake"
    stands = np.concatenate([log.brake[each] for each in rows])
    if not np.all(np.isfinite(stands)):
        return "the log does not hold the brake in all manoeuvres"
    if np.ptp(stands) >= BRAKE_SPAN:
        return ""
    return (
        f"the brake stays within {stands.min():.2f} and {stands.max():.2f}: move it by {BRAKE_SPAN}"
        f" or more out of rest, and back within {LONGEST_S:g} s, or glide with it further out; what"
        " is identified is the aircraft with it as it stood"
    )


def short_period(
    cl_alpha: float, cm_alpha: float, cm_q: float, body: KnownAircraft, airspeed_mps: float
) -> tuple[float, float]:
    """(undamped natural frequency [rad/s], damping) of α̇ = Z_α α + q, q̇ = M_α α + M_q q."""
    v = airspeed_mps
    lift = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 / body.mass_kg
    moment = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 * body.chord_m / body.iyy_kgm2
    z_alpha = -lift * v * cl_alpha
    m_alpha = moment * v * v * cm_alpha
    m_q = moment * v * 0.5 * body.chord_m * cm_q
    square = z_alpha * m_q - m_alpha
    if not square > 0.0:
        return float("nan"), float("nan")
    frequency = sqrt(square)
    return frequency, -(z_alpha + m_q) / (2.0 * frequency)


def _derived(
    unknowns: Floats, body: KnownAircraft, speed: float
) -> tuple[float, float, float, float]:
    _, cl_alpha, _, _, cm_alpha, cm_q, cm_elevator, delay = (float(u) for u in unknowns[:8])
    moment = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 * body.chord_m / body.iyy_kgm2
    frequency, damping = short_period(cl_alpha, cm_alpha, cm_q, body, speed)
    return (
        frequency,
        damping,
        moment * speed * speed * cm_elevator,
        delay + 1.0 / body.servo_lag_radps,
    )


def _explained(fits: Sequence[Fit]) -> float:
    import numpy as np

    error = np.concatenate([f.pitch_rate_radps - f.model_pitch_rate_radps for f in fits])
    moved = np.concatenate([f.pitch_rate_radps - f.pitch_rate_radps.mean() for f in fits])
    return 1.0 - float(error @ error) / float(moved @ moved)


class _Point(NamedTuple):
    """Where a fit stands."""

    unknowns: Floats  # as `NAMES`, with the brake's also `BRAKE_NAMES`
    starts: Floats  # (3, manoeuvres), as `_STARTS`
    errors: Floats  # (3,), as `_ERRORS`

    def moved(self, step: Floats) -> _Point:
        """By a step of the stacked unknowns; the delay stays possible."""
        own = len(self.unknowns)
        shared = own + len(_ERRORS)
        unknowns = self.unknowns + step[:own]
        unknowns[_DELAY] = min(max(unknowns[_DELAY], 0.0), DELAY_MAX_S)
        return _Point(
            unknowns,
            self.starts + step[shared:].reshape(len(_STARTS), -1),
            self.errors + step[own:shared],
        )


class _Problem:
    """Some manoeuvres, stacked: arrays of shape (steps, manoeuvres), the shorter ones masked."""

    def __init__(
        self, log: LongitudinalLog, body: KnownAircraft, rows: Sequence[slice], *, brake: bool
    ) -> None:
        import numpy as np

        self._brake = log.brake if brake else None
        self.steps = (*_STEPS, *_BRAKE_STEPS) if brake else _STEPS

        self._body = body
        self._log = log
        self._rows = list(rows)
        self._steps = max(r.stop - r.start for r in rows)
        # rows beyond a manoeuvre's own end repeat its last one and do not count
        take = np.stack(
            [np.minimum(np.arange(r.start, r.start + self._steps), r.stop - 1) for r in rows],
            axis=1,
        )
        self._counts = np.stack([np.arange(self._steps) < r.stop - r.start for r in rows], axis=1)
        self._speed = _smoothed(log.airspeed_mps)[take]
        self._alpha = (log.pitch_rad - log.path_angle_rad)[take]
        measured = [log.pitch_rate_radps[take], log.pitch_rad[take], self._alpha]
        lift = log.lift_force_mps2
        pressure = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 / body.mass_kg
        self._has_lift = lift is not None and bool(np.all(np.isfinite(lift[take])))
        if lift is not None and self._has_lift:
            measured.append(lift[take] / (pressure * self._speed**2))
        self._measured = np.stack(measured)  # (outputs, steps, manoeuvres)

    def solve(self) -> tuple[Floats, Floats]:
        """(unknowns, their covariance), of those in `NAMES`.  Errors: `IdentificationError`."""
        import numpy as np

        first = np.array((*_FIRST, *(0.0 for _ in self.steps[len(_FIRST) :])))
        point = _Point(first, self._starts(), np.zeros(len(_ERRORS)))
        weights = np.array(_FIRST_WEIGHTS[: len(self._measured)])
        for _ in range(_WEIGHINGS):
            point = self._descend(point, weights)
            weights = self._weights(self._residuals(point))
        if not np.all(np.isfinite(point.unknowns)):
            raise IdentificationError("the fit does not converge: are the units and signs right?")
        residuals, jacobian = self._linearised(point)
        covariance = self._covariance(residuals, jacobian, weights)
        # Nobody has measured when between two samples the elevator was commanded: that much the
        # delay may be off, and the other unknowns with it.
        _, a = self._stacked(residuals, jacobian, weights)
        others = np.arange(a.shape[1]) != _DELAY
        drift = np.ones(a.shape[1])
        drift[others] = -np.linalg.lstsq(a[:, others], a[:, _DELAY], rcond=None)[0]
        covariance += np.outer(drift, drift) * self._log.elevator_step_s**2 / 12.0
        turn = self._measured_alpha(point)
        shared = len(turn[0])
        known = np.concatenate([point.unknowns, point.errors])
        return turn @ known, turn @ covariance[:shared, :shared] @ turn.T

    def _measured_alpha(self, point: _Point) -> Floats:
        """From unknowns and errors to unknowns that go with the angle of attack as it is measured.

        Lift and moment do not tell an error of that angle from C_L0 and C_m0 of a wing set at
        another one; whoever flies has the same attitude, with the same error in it.
        """
        import numpy as np

        own = len(self.steps)
        turn = np.eye(own, own + len(_ERRORS))
        askew = own + _ERRORS.index("alpha")
        for level, slope in (("CL0", "CL_alpha"), ("Cm0", "Cm_alpha")):
            turn[NAMES.index(level), askew] = -point.unknowns[NAMES.index(slope)]
        return turn

    def _starts(self) -> Floats:
        """Each manoeuvre's first measurements, shape (3, manoeuvres)."""
        import numpy as np

        return np.stack([self._alpha[0], self._measured[0, 0], self._measured[1, 0]])

    def _weights(self, residuals: Floats) -> Floats:
        import numpy as np

        rms: Floats = np.sqrt((residuals**2).sum(axis=(1, 2)) / self._counts.sum())
        return 1.0 / np.maximum(rms, 1e-6)

    def _descend(self, point: _Point, weights: Floats, first: int = 0) -> _Point:
        """Levenberg and Marquardt; unknowns before `first` stay as they are."""
        import numpy as np

        damping, w = 1e-3, weights[:, None, None]
        residuals, jacobian = self._linearised(point)
        cost = float(((residuals * w) ** 2).sum())
        for _ in range(_ROUNDS):
            r, a = self._stacked(residuals, jacobian, weights)
            normal, slope = a[:, first:].T @ a[:, first:], a[:, first:].T @ r
            scale = np.diag(np.maximum(np.diag(normal), 1e-12))
            step = np.concatenate(
                [np.zeros(first), np.linalg.solve(normal + damping * scale, slope)]
            )
            tried = point.moved(step)
            new = float(((self._residuals(tried) * w) ** 2).sum())
            if new < cost:
                gain, cost, point = cost - new, new, tried
                damping = max(1e-9, 0.1 * damping)
                if gain < _CONVERGED * cost:
                    break
                residuals, jacobian = self._linearised(point)
            else:
                damping *= 10.0
                if damping > 1e4:
                    break
        return point

    def fits(self, unknowns: Floats, *, fitted: bool) -> list[Fit]:
        """How the model flies each manoeuvre, from the starting values that suit it best."""
        import numpy as np

        point = _Point(unknowns, self._starts(), np.zeros(len(_ERRORS)))
        weights = np.array(_FIRST_WEIGHTS[: len(self._measured)])
        point = self._descend(point, weights, len(unknowns))
        modelled = self._fly(*(part[None] for part in point))[0]
        result = []
        for i, rows in enumerate(self._rows):
            n = rows.stop - rows.start
            result.append(
                Fit(
                    time_s=self._log.time_s[rows],
                    elevator=self._log.elevator[rows],
                    pitch_rate_radps=self._log.pitch_rate_radps[rows],
                    model_pitch_rate_radps=modelled[0, :n, i],
                    fitted=fitted,
                )
            )
        return result

    # --- the model --------------------------------------------------------------------------

    def _residuals(self, point: _Point) -> Floats:
        """(outputs, steps, manoeuvres)"""
        import numpy as np

        flown = self._fly(*(part[None] for part in point))[0]
        return np.where(self._counts, self._measured - flown, 0.0)

    def _linearised(self, point: _Point) -> tuple[Floats, Floats]:
        """(residuals, derivatives of what is flown): (outputs, steps, manoeuvres), the latter by
        unknowns, errors and starts in turn.  Central differences, all flown at once."""
        import numpy as np

        own = len(self.steps)
        steps = np.array((*self.steps, *_ERROR_STEPS, *_START_STEPS))
        sets = 2 * len(steps) + 1
        unknowns, starts, errors = (np.repeat(part[None], sets, axis=0) for part in point)
        for i, step in enumerate(steps):
            for row, change in ((2 * i + 1, step), (2 * i + 2, -step)):
                if i < own:
                    unknowns[row, i] += change
                elif i < own + len(_ERRORS):
                    errors[row, i - own] += change
                else:
                    starts[row, i - own - len(_ERRORS)] += change
        flown = self._fly(unknowns, starts, errors)
        residuals = np.where(self._counts, self._measured - flown[0], 0.0)
        change = (flown[1::2] - flown[2::2]) / (2.0 * steps[:, None, None, None])
        return residuals, np.where(self._counts, change, 0.0)

    def _fly(self, unknowns: Floats, starts: Floats, errors: Floats) -> Floats:
        """Outputs (sets, outputs, steps, manoeuvres) of many sets of unknowns at once, Heun."""
        import numpy as np

        body = self._body
        lift = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 / body.mass_kg
        moment = 0.5 * body.air_density_kgpm3 * body.wing_area_m2 * body.chord_m / body.iyy_kgm2
        cl0, cl_a, cl_e, cm0, cm_a, cm_q, cm_e, delay = (
            unknowns[:, i, None] for i in range(len(NAMES))
        )
        elevator = self._servo(self._log.elevator, delay[:, 0])  # (sets, steps, manoeuvres)
        braked_l, braked_m = np.zeros_like(elevator), np.zeros_like(elevator)
        if self._brake is not None:
            out = self._servo(self._brake, delay[:, 0])
            braked_l, braked_m = (unknowns[:, i, None, None] * out for i in (-2, -1))
        alpha, q, theta = starts[:, 0], starts[:, 1], starts[:, 2]
        flown = np.empty((len(unknowns), len(self._measured), self._steps, len(self._rows)))

        def rates(a: Floats, w: Floats, pitch: Floats, k: int) -> tuple[Floats, Floats]:
            d, v = elevator[:, k], self._speed[k]
            cl = cl0 + cl_a * a + cl_e * d + braked_l[:, k]
            a_dot = w - lift * v * cl + (GRAVITY_MPS2 / v) * np.cos(pitch - a)
            cm = (
                cm0
                + cm_a * np.sin(a)
                + cm_e * d
                + braked_m[:, k]
                + (0.5 * body.chord_m / v) * cm_q * w
            )
            return a_dot, moment * v * v * cm

        for k in range(self._steps):
            flown[:, 0, k] = q + errors[:, 0, None]
            flown[:, 1, k] = theta
            flown[:, 2, k] = alpha + errors[:, 1, None]
            if self._has_lift:
                flown[:, 3, k] = (
                    cl0 + cl_a * alpha + cl_e * elevator[:, k] + braked_l[:, k] + errors[:, 2, None]
                )
            if k + 1 == self._steps:
                break
            a_dot, q_dot = rates(alpha, q, theta, k)
            a1, q1, t1 = alpha + STEP_S * a_dot, q + STEP_S * q_dot, theta + STEP_S * q
            a_dot2, q_dot2 = rates(a1, q1, t1, k + 1)
            alpha = alpha + 0.5 * STEP_S * (a_dot + a_dot2)
            theta = theta + 0.5 * STEP_S * (q + q1)
            q = q + 0.5 * STEP_S * (q_dot + q_dot2)
        return flown

    def _servo(self, command: Floats, delay_s: Floats) -> Floats:
        """Where a servo stands (sets, steps, manoeuvres): lag and rate known, delay not."""
        import numpy as np

        lag, rate = self._body.servo_lag_radps, self._body.servo_rate_per_s
        warm = round(QUIET_S / STEP_S)  # the servo's own start is forgotten by then
        begins = np.array([r.start for r in self._rows])
        at = begins[None, None, :] + np.arange(-warm, self._steps)[None, :, None]
        # a command counts from the step at which it was given: held, not drawn to the next
        place = at - delay_s[:, None, None] / STEP_S
        low = np.floor(place).astype(np.int64)
        fraction = place - low
        last = len(command) - 1
        first, second = command[np.clip(low, 0, last)], command[np.clip(low + 1, 0, last)]
        wanted = first + fraction * (second - first)
        fade = 1.0 - np.exp(-lag * STEP_S)
        stands = wanted[:, 0]
        result = np.empty_like(wanted[:, warm:])
        for k in range(wanted.shape[1]):
            if k >= warm:
                result[:, k - warm] = stands
            change = fade * (wanted[:, k] - stands)
            stands = stands + np.clip(change, -rate * STEP_S, rate * STEP_S)
        return result

    # --- the numbers ------------------------------------------------------------------------

    def _stacked(
        self, residuals: Floats, jacobian: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        """Weighted residuals (n,) and derivatives (n, shared + one each of the manoeuvres')."""
        import numpy as np

        w = weights[:, None, None]
        shared = len(self.steps) + len(_ERRORS)
        several = len(self._rows)
        r = (residuals * w).ravel()
        columns = [(jacobian[i] * w).ravel() for i in range(shared)]
        for i in range(shared, shared + len(_STARTS)):
            for m in range(several):
                only = np.zeros_like(residuals)
                only[:, :, m] = (jacobian[i] * w)[:, :, m]
                columns.append(only.ravel())
        return r, np.stack(columns, axis=1)

    def _covariance(self, residuals: Floats, jacobian: Floats, weights: Floats) -> Floats:
        """The sandwich: scores of one time are correlated with those shortly after."""
        import numpy as np

        r, a = self._stacked(residuals, jacobian, weights)
        bread = np.linalg.pinv(a.T @ a)
        shape = (len(self._measured), self._steps, len(self._rows), a.shape[1])
        scores = (a * r[:, None]).reshape(shape).sum(axis=0)  # (steps, manoeuvres, unknowns)
        lags = round(COLOUR_S / STEP_S)
        meat = np.einsum("kmi,kmj->ij", scores, scores)
        for lag in range(1, min(lags, self._steps - 1)):
            part = np.einsum("kmi,kmj->ij", scores[lag:], scores[:-lag])
            meat += (1.0 - lag / lags) * (part + part.T)
        n = float(self._counts.sum() * len(self._measured))
        covariance: Floats = bread @ meat @ bread * (n / max(1.0, n - a.shape[1]))
        return covariance


def _smoothed(speed: Floats) -> Floats:
    """Without what an airspeed cannot do: a mean over a fifth of a second."""
    import numpy as np

    width = round(0.2 / STEP_S) | 1
    known = np.isfinite(speed)
    if not known.any():
        return speed
    filled = np.interp(np.arange(len(speed)), np.flatnonzero(known), speed[known])
    padded = np.pad(filled, width // 2, mode="edge")
    mean = np.convolve(padded, np.ones(width) / width, mode="valid")
    return np.where(known, mean, np.nan)


def body_from(airframe: dict[str, float], model: dict[str, float]) -> KnownAircraft:
    """From an airframe file's tables.  Errors: `IdentificationError` naming what is missing."""
    values = []
    for name in KnownAircraft._fields:
        table, where = (airframe, "airframe") if name in airframe else (model, "model")
        value = table.get(name)
        if value is None or not isfinite(value) or value <= 0.0:
            raise IdentificationError(f"{where}.{name} = {value}: needed, and positive")
        values.append(float(value))
    return KnownAircraft._make(values)
