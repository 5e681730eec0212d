"""The disk margin of the loop that would be flown, from the airframe's parameters alone.

The linear model in short, for the computer on board: what `analysis/linear_model.py` makes of the
whole simulation by differences, here by the textbook, in the frequency domain.  About a glide at
the airspeed V whose path falls by g_d, with v the speed along the path, g its angle, t the pitch:

    (s + 2 g sin g_d / V) v + (g cos g_d - D') g + D' t = -D_δ δ        L' = V / path lag
    -(2 g cos g_d / V) v + (V s + L' + g sin g_d) g - L' t = L_δ δ      D' = L' dD/dL
    M' g + (s² - M_q s - M') t = M δ                                    M_q = L'/V - 2 ζ ω
    de_rho/dt = v cos(l - g_d) - V sin(l - g_d) g                       M'  = -ω² - M_q L'/V

L_δ is the elevator's lift, D_δ = L_δ dD/dL the drag that comes with it.  It answers as
exp(-s (delay + half a tick)) / (1 + s lag).  Fixes are old by A and are carried on by their
velocity: e (1 + s A) exp(-s A), its rate exp(-s A) late; with accelerometers neither.  The loop is
opened at the elevator and at e_rho, and

    alpha = min 1 / |S - 1/2|,     S = 1 / (1 + L)       0 where 1 + L turns the wrong way round 0

The sum of turns of 1 + L is that of a stable loop: half a turn forward; an unstable one turns back.
Beyond the stall it is not exact: within 0.03 of the linear model from 8.5 m/s on
(tests/control/test_loop_margin.py).

Roll and heading are judged likewise (`lateral_margin`), where the airframe file tells their
dynamics.

Not for the tick: a quarter of a millisecond a loop, six loops a line and six sideways; what does
not change is kept.
"""

from __future__ import annotations

from cmath import exp, phase
from functools import lru_cache
from math import atan, cos, radians, sin
from typing import Any, Final, NamedTuple

from tgl_soar.config.lateral_dynamics import UNKNOWN, LateralDynamics
from tgl_soar.config.parameters import PARAMETERS, ParameterSet
from tgl_soar.control.lateral_margin import ATTITUDE_AGE_S, disk_margins, sideways_flown
from tgl_soar.control.laws import Laws, dynamics_of, laws_from
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import (
    FIX_AGE_S,
    HOLD_S,
    SPEED_MIN_MPS,
    Dynamics,
    pitch_gains,
    soaring_gains,
)
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import GRAVITY_MPS2, NAN

FLOOR: Final = 0.5  # 4.4 dB and 28 degrees at once: the least that is flown
# 2.2 dB and 14 degrees: less than the model may be wrong by. Between both an operator who sees that
# the aircraft is not the model's, and goes back with a gain, is warned and has their way.
RINGS: Final = 0.25
WAY_STEP_M: Final = 0.5  # of the way to the waypoint: one answer for roll and heading
FARTHEST_M: Final = 2000.0  # WPT_X reaches no further; nothing changes there
# Of the best glide's speed: where it soars in a tunnel and on a hill, 8.5 to 10.6 m/s for 9.25.
SPEEDS: Final = (0.92, 1.0, 1.15)
TICK_S: Final = 2.0 * HOLD_S
RADPS: Final = tuple(0.25 * 1.115**i for i in range(60))  # to 150 rad/s
# What the loops follow from: no other parameter that is set in flight has them judged again.
_LOOP: Final = ("DYN_", "CMD_", "EST_IMU", "LOOP_RATE", "RHO_P_IMU")
PITCH_NAMES: Final = tuple(
    p.name for p in PARAMETERS if p.name.startswith((*_LOOP, "RHO_", "ELE_", "TGL_LEAN"))
)
LATERAL_NAMES: Final = tuple(
    p.name
    for p in PARAMETERS
    if p.name.startswith((*_LOOP, "AIL_", "RUD_", "SIDE_", "LAT_", "WPT_"))
)
_HERE: Final = SoaringFrame(0.0, 0.0, 0.0, 0.0)


# What of an airframe has to be known of it in pitch.
_NEEDED: Final = (
    *("DYN_SPEED", "DYN_FREQ", "DYN_DAMP", "DYN_EFFECT", "DYN_PATH", "DYN_GLIDE", "DYN_BEST"),
)


class Flown(NamedTuple):
    """A loop: airframe, place, and the gains there."""

    airframe: Dynamics
    lag_s: float  # the servo's
    delay_s: float  # of the servo, and of the command's way to it
    speed_mps: float
    lean_rad: float
    inertial: bool  # accelerations are in use
    lift_mps2: float  # of a full deflection, at the airframe's speed_mps
    soaring: PidGains
    pitch: PidGains
    setpoint_weight: float


class GlideCoefficients(NamedTuple):
    """Of the equations about a glide."""

    falls_rad: float  # g_d
    down_mps2: float  # g sin g_d
    along_mps2: float  # g cos g_d
    lift_mps2: float  # L'
    drag_mps2: float  # D'
    damped_per_s: float  # M_q
    stiff_per_s2: float  # M'
    effect_radps2: float  # M
    lifted_mps2: float  # L_δ
    slowed_mps2: float  # D_δ


class _Frequency(NamedTuple):
    """What is the same for every loop."""

    s: complex
    before: complex  # a tick ago
    old: complex  # fixes, by their age
    late: complex  # attitudes, where no gyroscope carries them on


_SWEEP: Final = tuple(
    _Frequency(s, exp(-s * TICK_S), exp(-s * FIX_AGE_S), exp(-s * ATTITUDE_AGE_S))
    for s in (1j * radps for radps in RADPS)
)


class _Alike:
    """Values that are one and the same where those of some names are."""

    __slots__ = ("_key", "values")

    def __init__(self, values: ParameterSet, names: tuple[str, ...]) -> None:
        self.values = values
        self._key = tuple(values[name] for name in names)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Alike) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


class LoopMargin(NamedTuple):
    """What a loop leaves."""

    alpha: float
    name: str  # of the loop, and where


def margin_fault(
    values: ParameterSet, floor: float = FLOOR, lateral: LateralDynamics = UNKNOWN
) -> str:
    """Why the line of these values cannot be flown with a margin, or why roll or heading would
    swing on any; "" if neither, or if too little is known of the airframe.

    Roll and heading are known within 0.1 (`control.lateral_margin`).  A line that leans otherwise
    would not help them, so that they are refused where they would swing, below RINGS, and what is
    between is warned of.
    """
    for found in line_margins(values):
        if found.alpha < floor:
            return f"no margin {_shown(found, floor)}"
    sideways_floor = min(floor, RINGS)
    for found in lateral_margins(values, lateral):
        if found.alpha < sideways_floor:
            return f"no margin {_shown(found, sideways_floor)}"
    return ""


def margin_warning(values: ParameterSet, lateral: LateralDynamics = UNKNOWN) -> str:
    """What is to be said of margins that refuse nothing: that nobody knows them, or that roll or
    heading has little; "" where all is well."""
    if words := _unjudged(values):
        return words
    least = min(lateral_margins(values, lateral), default=None)
    return "" if least is None or least.alpha >= FLOOR else f"little margin {_shown(least, FLOOR)}"


def _shown(found: LoopMargin, floor: float) -> str:
    shown = int(100.0 * found.alpha) / 100.0  # no 0.497 is 0.5
    return f"{found.name}: {shown:.2f} of {floor:g}"


def _unjudged(values: ParameterSet) -> str:
    missing = [name for name in _NEEDED if not values[name] > 0.0]
    if missing:
        return f"no margin is judged: of the airframe {', '.join(missing)} is not known"
    return "" if is_known(dynamics_of(values)) else "no margin is judged: DYN_GLIDE or DYN_BEST < 1"


def line_margins(values: ParameterSet) -> tuple[LoopMargin, ...]:
    """Of the line's loop, with both sets of gains at three speeds; () where it is not known."""
    return _line_margins(_Alike(values, PITCH_NAMES))


def lateral_margins(
    values: ParameterSet, lateral: LateralDynamics = UNKNOWN
) -> tuple[LoopMargin, ...]:
    """Of roll and heading, on whatever line; () where they are not known.

    Of a line they know the way R to the waypoint alone: lines whose R is within a step of
    WAY_STEP_M have one answer, that of the step's shortest way, so that moving the line costs the
    process that flies nothing.  R is seen as V_l / R = min(V / R, g kv) alone.  Up to V / (g kv),
    5 m and more with a kv as computed (`config.lateral_gains`), nothing changes at all; beyond, a
    step changes V / R by 0.5 m of 5 m and more, a tenth at most, which is half or so of the
    sideways loop where that crosses over: alpha moves by less than a tenth of itself, and the
    shortest way has the least.  To heading R is of no weight.
    """
    return _lateral_margins(_Alike(values.changed(_of_the_way(values)), LATERAL_NAMES), lateral)


def _of_the_way(values: ParameterSet) -> dict[str, float]:
    """Values that stand for all lines with the same step of the way to the waypoint."""
    steps = (values["TGL_X"] - values["WPT_X"]) // WAY_STEP_M
    nearest_m = min(FARTHEST_M, max(values["WPT_R_MIN"], steps * WAY_STEP_M))
    upright = {"TGL_Z": 0.0, "TGL_PRESET": 0.0, "TGL_LEAN": values["TGL_LEAN_MIN"]}
    return {**upright, "TGL_X": 0.0, "WPT_X": -nearest_m}


@lru_cache(maxsize=16)
def _line_margins(alike: _Alike) -> tuple[LoopMargin, ...]:
    values, lean_deg = alike.values, alike.values["TGL_LEAN"]
    return tuple(
        LoopMargin(
            disk_margin(loop),
            f"at lean {lean_deg:g} deg and {_where(values, loop.speed_mps, loop.inertial)}",
        )
        for loop in _loops(alike)
    )


@lru_cache(maxsize=64)
def _lateral_margins(alike: _Alike, lateral: LateralDynamics) -> tuple[LoopMargin, ...]:
    values = alike.values
    best_mps = values["DYN_BEST"]
    if not (lateral.speed_mps >= SPEED_MIN_MPS and best_mps >= SPEED_MIN_MPS):
        return ()
    laws, late_s = laws_from(values, _HERE), dynamics_of(values).late_s
    found = []
    for inertial in _sets(laws, values):
        for fraction in SPEEDS:
            speed = fraction * best_mps
            where = _where(values, speed, inertial)
            loop = sideways_flown(laws, lateral, late_s, speed, inertial)
            both = zip(("roll", "heading"), disk_margins(loop), strict=True)
            found += [LoopMargin(alpha, f"in {name} at {where}") for name, alpha in both]
    return tuple(found)


def _where(values: ParameterSet, speed_mps: float, inertial: bool) -> str:
    return (
        f"{speed_mps:.1f} m/s, {1e3 * values['CMD_DELAY']:.3g} ms late,"
        f" with{'' if inertial else 'out'} accelerometers"
    )


@lru_cache(maxsize=16)
def _loops(alike: _Alike) -> tuple[Flown, ...]:
    """What may be flown on the line of these values; none where too little is known."""
    values = alike.values
    if _unjudged(values):
        return ()
    laws, best_mps = laws_from(values, _HERE), values["DYN_BEST"]
    return tuple(
        flown(laws, values, fraction * best_mps, values["TGL_LEAN"], inertial)
        for inertial in _sets(laws, values)
        for fraction in SPEEDS
    )


def _sets(laws: Laws, values: ParameterSet) -> tuple[bool, ...]:
    """Without accelerometers, and with them where they have gains."""
    return (False, True) if laws.motion.use_imu and values["RHO_P_IMU"] > 0.0 else (False,)


def margin_when_late(values: ParameterSet, delay_s: float) -> float:
    """alpha of the worst speed and set of gains where commands take `delay_s` [s], and the schedule
    is given CMD_DELAY; NaN: too little is known of the airframe."""
    later_s = delay_s - values["CMD_DELAY"]
    loops = _loops(_Alike(values, PITCH_NAMES))
    late = (loop._replace(delay_s=max(0.0, loop.delay_s + later_s)) for loop in loops)
    return min((disk_margin(loop) for loop in late), default=NAN)


def is_known(airframe: Dynamics) -> bool:
    """Whether enough is known for a margin."""
    enough = min(airframe[:4]) > 0.0 and airframe.path_s > 0.0
    return enough and min(airframe.glide_ratio, airframe.best_glide_mps) >= 1.0


def flown(
    laws: Laws, values: ParameterSet, speed_mps: float, lean_deg: float, inertial: bool
) -> Flown:
    """The loop with the gains that the schedule gives there."""
    weight = 1.0 if inertial else 0.0
    soaring = laws.soaring_imu if inertial else laws.soaring
    pitch = laws.pitch_imu if inertial else laws.pitch
    eta = eta_from_lean(radians(lean_deg))
    airframe = dynamics_of(values)
    return Flown(
        airframe=airframe,
        lag_s=airframe.lag_s,
        delay_s=airframe.late_s - airframe.lag_s,
        speed_mps=max(SPEED_MIN_MPS, speed_mps),
        lean_rad=radians(lean_deg),
        inertial=inertial,
        lift_mps2=values["DYN_LIFT"],
        soaring=soaring_gains(soaring, laws.schedule, weight, speed_mps, eta).pid,
        pitch=pitch_gains(pitch, laws.schedule, speed_mps),
        setpoint_weight=laws.setpoint_weight if inertial else 0.0,
    )


def disk_margin(loop: Flown) -> float:
    """alpha of the worse break; 0: unstable."""
    answers = _answers(loop.airframe, loop.lift_mps2, loop.speed_mps, loop.lean_rad)
    least, turned, before = 2.0, 0.0, complex(1.0)
    for k, at in enumerate(_SWEEP):
        at_elevator, at_line = _open_loops(loop, *answers[k], at)
        back = 1.0 + at_elevator
        if k > 0:
            turned += phase(back / before)
        before = back
        for opened in (at_elevator, at_line):
            least = min(least, 1.0 / max(1e-9, abs(1.0 / (1.0 + opened) - 0.5)))
    return least if turned > 0.0 else 0.0


def _open_loops(
    loop: Flown, rate: complex, pitch: complex, at: _Frequency
) -> tuple[complex, complex]:
    """L at the elevator and at e_rho, negative feedback, of what `_answer` says."""
    s = at.s
    surface = exp(-s * (loop.delay_s + HOLD_S)) / (1.0 + s * loop.lag_s)
    outer, inner = loop.soaring, loop.pitch
    slowly, error = (outer.kp + outer.ki / s) / s, inner.kp + inner.ki / s
    quickly = outer.kd / (1.0 + s / outer.rate_filter_radps)
    damps = inner.kd * s / (1.0 + s / inner.rate_filter_radps)
    if loop.inertial:
        setpoint, attitude = slowly + quickly, error + damps
    else:
        setpoint = at.old * (slowly * (1.0 + s * FIX_AGE_S) + quickly)
        attitude = at.late * (error * (1.0 + s * ATTITUDE_AGE_S) + damps)
    held = surface * attitude * pitch
    line = -surface * (error + followed(loop, at.before)) * setpoint * rate
    return held + line, line / (1.0 + held)


def followed(loop: Flown, before: Any) -> Any:
    """From the setpoint to what the derivative makes of its rate: a part of the difference over a
    tick, and the filter of `pid_step`.  before: exp(-s TICK_S), a number or an array."""
    filtered = loop.pitch.rate_filter_radps * TICK_S
    blend = filtered / (1.0 + filtered)
    gain = loop.setpoint_weight * loop.pitch.kd / TICK_S
    return gain * (1.0 - before) * blend / (1.0 - (1.0 - blend) * before)


def glide_coefficients(known: Dynamics, lift_mps2: float, v: float) -> GlideCoefficients:
    """At an airspeed [m/s]; `lift_mps2`: the elevator's, at the airframe's own speed."""
    ratio = v / known.speed_mps
    square = (v / known.best_glide_mps) ** 2
    falls = atan(0.5 / known.glide_ratio * (square + 1.0 / square))
    drag_of_lift = 1.0 / (known.glide_ratio * square)  # dD/dL
    lift = v * ratio / known.path_s
    period = known.short_period_radps * ratio
    damped = lift / v - 2.0 * known.damping * period
    lifted = lift_mps2 * ratio * ratio
    return GlideCoefficients(
        falls_rad=falls,
        down_mps2=GRAVITY_MPS2 * sin(falls),
        along_mps2=GRAVITY_MPS2 * cos(falls),
        lift_mps2=lift,
        drag_mps2=lift * drag_of_lift,
        damped_per_s=damped,
        stiff_per_s2=-period * period - damped * lift / v,
        effect_radps2=known.effect_radps2 * ratio * ratio,
        lifted_mps2=lifted,
        slowed_mps2=lifted * drag_of_lift,
    )


@lru_cache(maxsize=16)
def _answers(
    airframe: Dynamics, lift_mps2: float, speed_mps: float, lean_rad: float
) -> tuple[tuple[complex, complex], ...]:
    """`_answer` over the sweep: whatever the gains, and with accelerometers as without."""
    glide = glide_coefficients(airframe, lift_mps2, speed_mps)
    return tuple(_answer(glide, speed_mps, lean_rad, at.s) for at in _SWEEP)


def _answer(
    glide: GlideCoefficients, v: float, lean_rad: float, s: complex
) -> tuple[complex, complex]:
    """de_rho/dt and pitch, each to a full deflection of the elevator."""
    falls, down, along, lift, drag, damped, stiff, effect, lifted, slows = glide
    # Rows: along the path, across it, in pitch; columns: v, g, t.
    a11, a12, a13 = s + 2.0 * down / v, along - drag, drag
    a21, a22, a23 = -2.0 * along / v, v * s + lift + down, -lift
    a32, a33 = stiff, s * s - damped * s - stiff
    minor = a22 * a33 - a23 * a32
    determinant = a11 * minor - a12 * a21 * a33 + a13 * a21 * a32
    speed = (effect * (a12 * a23 - a13 * a22) + lifted * (a13 * a32 - a12 * a33)) / determinant
    path = (effect * (a13 * a21 - a11 * a23) + lifted * a11 * a33) / determinant
    pitch = (effect * (a11 * a22 - a12 * a21) - lifted * a11 * a32) / determinant
    speed -= slows * minor / determinant
    path += slows * a21 * a33 / determinant
    pitch -= slows * a21 * a32 / determinant
    lean = lean_rad - falls
    return cos(lean) * speed - v * sin(lean) * path, pitch
