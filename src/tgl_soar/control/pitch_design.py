"""Gains of pitch for one aircraft, sought on the rule's own model of its loop when it is loaded.

The schedule carries gains from the aircraft that they were found on to another one by four ratios,
and what four ratios cannot tell it has to leave as margin (docs/margins.md).  Here the gains are
sought for the very aircraft, among those of both loops (`found_gains.SOUGHT`, filters aside), for

    least sqrt(e² + (ACTIVITY_M δ)²)      e: e_rho, δ: elevator, in gusts on the usual line,

with the disk margins of `loop_margin` at the elevator, at e_rho and of the pitch loop alone as
constraints: at three speeds and six leans, at a fast glide, and with commands later than anybody
knows.  They are anchored to this aircraft: from there the schedule goes by speed, lean and lateness
alone.

A gust w up, and one of u more headwind, enter the model of `loop_margin` as the air's part of
airspeed and angle of attack, in the rows along the path, across it and in pitch:

    (g cos g_d - D') w / V - 2 g sin g_d u / V        L' w / V + 2 g cos g_d u / V        M' w / V

Its spectra are Dryden's (MIL-F-8785C), of two lengths: a tunnel's and a hill's.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import cos, pi, radians, sin
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.config.parameters import ANCHORS, INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.control.found_gains import (
    INERTIAL,
    SETS,
    SHIPPED,
    SOUGHT,
    anchored,
    are_for_another,
    gains_of,
    with_gains,
)
from tgl_soar.control.lateral_margin import ATTITUDE_AGE_S
from tgl_soar.control.laws import dynamics_of, laws_from
from tgl_soar.control.loop_margin import (
    FLOOR,
    RADPS,
    SPEEDS,
    TICK_S,
    Flown,
    flown,
    followed,
    glide_coefficients,
)
from tgl_soar.control.pitch_schedule import FIX_AGE_S, HOLD_S
from tgl_soar.geometry import SoaringFrame

Spectrum = NDArray[np.complexfloating[Any, Any]]
Floats = NDArray[np.float64]

USUAL_LEAN_DEG: Final = 15.0
# A file errs: 10 % of the elevator's effect, of lift or damping takes some 0.05 each.  What has 0.6
# by its file keeps the 0.5 that is asked for.  On lines that are flown seldom half of that is kept.
USUAL_FLOOR: Final = FLOOR + 0.10
SELDOM_FLOOR: Final = FLOOR + 0.05
LEANS_DEG: Final = {
    10.0: USUAL_FLOOR,
    15.0: USUAL_FLOOR,
    20.0: USUAL_FLOOR,
    30.0: USUAL_FLOOR,
    5.0: SELDOM_FLOOR,
    45.0: SELDOM_FLOOR,
}
FAST: Final = 1.5  # of the best glide's speed
# Pitch alone launches, holds, recovers and lands, for seconds: it keeps what is asked for, with
# half of the reserve.
PITCH_FLOOR: Final = SELDOM_FLOOR
# Commands that are later than the file says, at 15 degrees: what a measured link errs by leaves the
# line's loop what is asked for, and pitch alone most of it.  30 ms leave both stable, with an
# elevator that has a tenth more effect than the file says (which is 0.1 of margin).
LATER: Final = {0.010: (FLOOR, 0.4), 0.030: (0.15, 0.15)}  # [s]
# Of eq. 16's derivative of the setpoint, with accelerometers.  Of e_rho 0.78 is left by it for the
# aircraft of `unseen` and 0.42 to 0.77 of eight drawn ones'; with 0.5, the second choice, 0.76 and
# 0.44 to 0.78, and less margin near the stall where commands are late (0.44 of the 0.5 asked for).
# 0.75, the first, lost two of 96 flights more at 5 %, near the stall too.
SETPOINT_WEIGHT: Final = 0.3
ACTIVITY_M: Final = 0.03  # of e_rho that a full deflection is worth: `analysis.tuning` has as much
INTENSITY: Final = 0.03
LENGTHS_M: Final = (1.5, 6.0)
SHORT: Final = 20.0  # of the cost's logarithm: what a margin lacks outweighs what it would bring
# Of the logarithm of a gain's factor: hardly any gain has every margin, and holds nothing.
FARTHEST: Final = 1.8
# Logarithms of the gains' factors: as the schedule has them, all of them higher, and a stiff line
# with little rate gain.  From each a coarse search; from the best end a fine one.  Of 28 on drawn
# aircraft the worst ended 5 % above the least that CMA-ES found in ten times the trials.
STARTS: Final = ((0.0, 0.0, 0.0, 0.0), (0.5, 0.3, 0.6, 0.9), (0.6, 0.3, 0.3, -0.5))
COARSE: Final = {"step": 0.3, "maxfev": 70, "xatol": 0.05, "fatol": 0.01}
FINE: Final = {"step": -0.15, "maxfev": 150, "xatol": 0.01, "fatol": 0.002}
DIGITS: Final = 3  # so that another computer's arithmetic finds the same
_GUST_RADPS: Final[Floats] = np.geomspace(0.1, 40.0, 36)
_MARGIN_RADPS: Final[Floats] = np.array(RADPS)
_HERE: Final = SoaringFrame(0.0, 0.0, 0.0, 0.0)


class Answers(NamedTuple):
    """Of the airframe at a speed and lean, to a full deflection, to w and to u of 1 m/s.

    `rate` and `pitch` are of shape (3, frequencies), all others of (frequencies,).
    """

    radps: Floats
    rate: Spectrum  # de_rho/dt
    pitch: Spectrum
    steps: Floats  # of an integral over frequency, by trapezia
    surface: Spectrum  # servo and link, to a deflection that is wanted
    old: Spectrum  # fixes, by their age
    late: Spectrum  # attitudes, where no gyroscope carries them on


class DesignPlace(NamedTuple):
    """Where gains are judged."""

    speed_mps: float
    lean_deg: float
    floor: float  # of the disk margin
    answers: Answers
    # With commands that are later than known: the loop's floor, and that of pitch alone.
    later: tuple[tuple[Answers, float, float], ...]


class DesignCost(NamedTuple):
    """What gains give by the rule's model."""

    e_rho_m: float
    elevator: float
    short: float  # what margins lack of their floors, together


def own_gains(values: ParameterSet) -> dict[str, float]:
    """Gains and anchors for this aircraft by name of the parameter.

    None where those that are there are not for another aircraft (`found_gains.are_for_another`),
    and where no gains have the margins: what the schedule makes of those that are there is flown
    then.
    """
    if not are_for_another(values):
        return {}
    return dict(_own_gains(tuple((name, values[name]) for name in _FOLLOWS_FROM)))


_FOLLOWS_FROM: Final = (
    *("DYN_SPEED", "DYN_FREQ", "DYN_DAMP", "DYN_EFFECT", "DYN_LIFT", "DYN_SERVO", "DYN_LAG"),
    *("DYN_PATH", "DYN_GLIDE", "DYN_BEST", "CMD_DELAY"),
)


@lru_cache(maxsize=4096)  # of as many aircraft: a campaign draws them again at each place
def _own_gains(known: tuple[tuple[str, float], ...]) -> tuple[tuple[str, float], ...]:
    try:
        given = {**SHIPPED, **dict(known), "ELE_DSP_IMU": SETPOINT_WEIGHT}
        start = anchored(ParameterSet().changed(given), USUAL_LEAN_DEG)
    except ParameterError:  # no anchor may have such a value: it is of no aircraft that soars
        return ()
    found = start
    for kind in SETS:
        best = _searched(_DesignTask(start, kind), start, kind)
        if best is None:
            return ()
        found = with_gains(found, kind, best)
    return tuple((name, found[name]) for name in (*ANCHORS, *SHIPPED))


def _searched(task: _DesignTask, start: ParameterSet, kind: str) -> list[float] | None:
    """The sought gains of a set; None: none has the margins."""
    from scipy.optimize import minimize  # not for a flight whose gains are known

    first = np.array(gains_of(start, kind))
    most = np.array([PARAMETERS[INDEX[name]].maximum for name in SOUGHT[kind]])
    moved = np.array(["FILT" not in name and "_DF_" not in name for name in SOUGHT[kind]])

    def gains(x: Floats) -> list[float]:
        logarithms = np.zeros(len(first))
        logarithms[moved] = x
        wanted = np.minimum(most, first * np.exp(logarithms))
        return [float(f"{gain:.{DIGITS}g}") for gain in wanted]

    def too_far(x: Floats) -> float:
        return float(np.sum(np.maximum(0.0, np.abs(x) - FARTHEST)))

    def cost(x: Floats) -> float:
        judged = task.judged(with_gains(start, kind, gains(x)))
        size = np.hypot(judged.e_rho_m, ACTIVITY_M * judged.elevator)
        return float(np.log(size) + SHORT * (judged.short + too_far(x)))

    def searched(at: Floats, how: Mapping[str, float]) -> tuple[float, Floats]:
        options: Any = {name: value for name, value in how.items() if name != "step"}
        options["initial_simplex"] = np.vstack([at, at + how["step"] * np.eye(len(at))])
        found = minimize(cost, at, method="Nelder-Mead", options=options)
        return float(found.fun), found.x

    coarse = min((searched(np.array(at), COARSE) for at in STARTS), key=itemgetter(0))
    _, at = min(coarse, searched(coarse[1], FINE), key=itemgetter(0))
    lacks = task.judged(with_gains(start, kind, gains(at))).short + too_far(at)
    return gains(at) if lacks <= 0.01 else None


class _DesignTask:
    """One set of gains on one airframe: where it is judged, prepared once."""

    def __init__(self, values: ParameterSet, kind: str) -> None:
        self._inertial = kind == INERTIAL
        self._best_mps = best = values["DYN_BEST"]
        self._margins = [
            _place(values, fraction * best, lean_deg, floor, _MARGIN_RADPS)
            for fraction in SPEEDS
            for lean_deg, floor in LEANS_DEG.items()
        ]
        self._margins.append(
            _place(values, FAST * best, USUAL_LEAN_DEG, SELDOM_FLOOR, _MARGIN_RADPS)
        )
        self._gusts = [
            _place(values, fraction * best, USUAL_LEAN_DEG, 0.0, _GUST_RADPS) for fraction in SPEEDS
        ]

    def judged(self, values: ParameterSet) -> DesignCost:
        """What these gains give; the airframe is that of the task."""
        laws, short = laws_from(values, _HERE), 0.0
        for place in self._margins:
            loop = flown(laws, values, place.speed_mps, place.lean_deg, self._inertial)
            lacks = place.floor - disk_margin(loop, place.answers)
            if place.lean_deg == USUAL_LEAN_DEG:
                lacks = max(lacks, PITCH_FLOOR - pitch_margin(loop, place.answers))
                for late, floor, of_pitch in place.later:
                    lacks = max(lacks, floor - disk_margin(loop, late))
                    lacks = max(lacks, of_pitch - pitch_margin(loop, late))
            short += max(0.0, lacks)
        squares = np.zeros(2)
        for place in self._gusts:
            loop = flown(laws, values, place.speed_mps, place.lean_deg, self._inertial)
            squares += gust_variances(loop, place.answers, INTENSITY * self._best_mps)
        e_rho, elevator = np.sqrt(squares / len(self._gusts))
        return DesignCost(float(e_rho), float(elevator), short)


def _place(
    values: ParameterSet, speed_mps: float, lean_deg: float, floor: float, radps: Floats
) -> DesignPlace:
    known = answers(values, speed_mps, lean_deg, radps)
    late = tuple((later(known, late_s), *floors) for late_s, floors in LATER.items())
    return DesignPlace(
        speed_mps=speed_mps, lean_deg=lean_deg, floor=floor, answers=known, later=late
    )


def answers(values: ParameterSet, speed_mps: float, lean_deg: float, radps: Floats) -> Answers:
    """The airframe's, by the rows of `loop_margin`."""
    known, v, s = dynamics_of(values), speed_mps, 1j * radps
    falls, down, along, lift, drag, damped, stiff, effect, lifted, slows = glide_coefficients(
        known, values["DYN_LIFT"], v
    )
    rows = np.zeros((len(radps), 3, 3), dtype=np.complex128)
    rows[:, 0, 0], rows[:, 0, 1], rows[:, 0, 2] = s + 2.0 * down / v, along - drag, drag
    rows[:, 1, 0], rows[:, 1, 1], rows[:, 1, 2] = -2.0 * along / v, v * s + lift + down, -lift
    rows[:, 2, 1], rows[:, 2, 2] = stiff, s * s - damped * s - stiff
    into = np.array(
        [
            [-slows, (along - drag) / v, -2.0 * down / v],
            [lifted, lift / v, 2.0 * along / v],
            [effect, stiff / v, 0.0],
        ]
    )
    moved = np.linalg.solve(rows, np.broadcast_to(into, rows.shape))
    lean = radians(lean_deg) - falls
    rate = cos(lean) * moved[:, 0, :] - v * sin(lean) * moved[:, 1, :]
    delay_s = known.late_s - known.lag_s + HOLD_S
    return Answers(
        radps=radps,
        rate=rate.T,
        pitch=moved[:, 2, :].T,
        steps=0.5 * (np.diff(radps, prepend=radps[0]) + np.diff(radps, append=radps[-1])),
        surface=np.exp(-s * delay_s) / (1.0 + s * known.lag_s),
        old=np.exp(-s * FIX_AGE_S),
        late=np.exp(-s * ATTITUDE_AGE_S),
    )


def later(known: Answers, late_s: float) -> Answers:
    """With commands that take so much more [s]."""
    return known._replace(surface=known.surface * np.exp(-1j * known.radps * late_s))


class _LoopTransfers(NamedTuple):
    setpoint: Spectrum  # from de_rho/dt to the pitch setpoint
    follows: Spectrum  # from the setpoint to what is wanted of the elevator
    attitude: Spectrum  # from pitch to it


def _transfers(loop: Flown, known: Answers) -> _LoopTransfers:
    s = 1j * known.radps
    outer, inner = loop.soaring, loop.pitch
    slowly, error = (outer.kp + outer.ki / s) / s, inner.kp + inner.ki / s
    quickly = outer.kd / (1.0 + s / outer.rate_filter_radps)
    damps = inner.kd * s / (1.0 + s / inner.rate_filter_radps)
    if loop.inertial:
        return _LoopTransfers(
            setpoint=slowly + quickly,
            follows=error + followed(loop, np.exp(-s * TICK_S)),
            attitude=error + damps,
        )
    return _LoopTransfers(
        setpoint=known.old * (slowly * (1.0 + s * FIX_AGE_S) + quickly),
        follows=error,
        attitude=known.late * (error * (1.0 + s * ATTITUDE_AGE_S) + damps),
    )


def disk_margin(loop: Flown, known: Answers) -> float:
    """alpha of the worse break, as `loop_margin.disk_margin` has it of a loop whose servo and link
    are those of the airframe; 0: unstable."""
    flies = _transfers(loop, known)
    held = known.surface * flies.attitude * known.pitch[0]
    line = -known.surface * flies.follows * flies.setpoint * known.rate[0]
    if not _turns_forward(1.0 + held + line):
        return 0.0
    return min(_alpha(held + line), _alpha(line / (1.0 + held)))


def pitch_margin(loop: Flown, known: Answers) -> float:
    """alpha of the pitch loop alone, as where no line is held; 0: unstable."""
    flies = _transfers(loop, known)
    held = known.surface * flies.attitude * known.pitch[0]
    return _alpha(held) if _turns_forward(1.0 + held) else 0.0


def _turns_forward(back: Spectrum) -> bool:
    return float(np.sum(np.angle(back[1:] / back[:-1]))) > 0.0


def _alpha(opened: Spectrum) -> float:
    return min(2.0, float(np.min(1.0 / np.maximum(1e-9, np.abs(1.0 / (1.0 + opened) - 0.5)))))


def gust_variances(loop: Flown, known: Answers, sigma_mps: float) -> Floats:
    """Of e_rho [m²] and of the elevator in turbulence of this intensity; of e_rho the geometric
    mean of two lengths, so that neither outweighs the other."""
    flies, radps = _transfers(loop, known), known.radps
    closed = (
        1.0
        + known.surface * flies.attitude * known.pitch[0]
        - known.surface * flies.follows * flies.setpoint * known.rate[0]
    )
    moves = (
        known.surface
        * (flies.follows * flies.setpoint * known.rate[1:] - flies.attitude * known.pitch[1:])
        / closed
    )
    e_rho = np.abs((known.rate[1:] + known.rate[0] * moves) / radps) ** 2
    elevator = np.abs(moves) ** 2
    variances = np.array(
        [
            [np.sum(what * spectra * known.steps) for what in (e_rho, elevator)]
            for spectra in (_dryden(radps, length / loop.speed_mps) for length in LENGTHS_M)
        ]
    )
    return sigma_mps**2 * np.array([np.prod(variances[:, 0]) ** 0.5, variances[0, 1]])


def _dryden(radps: Floats, time_s: float) -> Floats:
    """Spectra of w and u for a standard deviation of 1, over positive frequencies."""
    square = (time_s * radps) ** 2
    across = time_s / pi * (1.0 + 3.0 * square) / (1.0 + square) ** 2
    return np.array([across, 2.0 * time_s / pi / (1.0 + square)])
