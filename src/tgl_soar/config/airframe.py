"""The airframe file: what flies.

Its autopilot, which channel moves which surface and which way, its gains, its glide polar, and the
coefficients that the simulation needs.
"""

from __future__ import annotations

from math import inf
from typing import Annotated, Final, Literal, cast

from msgspec import Meta, field
from msgspec.structs import force_setattr, replace

from tgl_soar.config.dynamics import MeasuredDynamics, dynamics_parameters
from tgl_soar.config.glide_limits import pitch_limits, slowest_airspeed
from tgl_soar.config.stall_limit import stall_limit
from tgl_soar.config.strict import Finite, Measured, Strict, SystemId
from tgl_soar.types import NO_AERODYNAMICS, Aerodynamics, GlidePolar, polar_sink

Pwm = Annotated[int, Meta(ge=800, le=2200)]
Channel = Annotated[int, Meta(ge=1, le=18)]


class Surface(Strict, frozen=True):
    """How one normalised deflection becomes a channel's pulse width."""

    channel: Channel
    pwm_min: Pwm = 1100  # at deflection -1 (+1 where reversed)
    pwm_trim: Pwm = 1500
    pwm_max: Pwm = 1900
    reversed: bool = False

    def __post_init__(self) -> None:
        if not self.pwm_min < self.pwm_trim < self.pwm_max:
            raise ValueError(
                f"pwm_min {self.pwm_min} < pwm_trim {self.pwm_trim} < pwm_max {self.pwm_max}"
                " must hold"
            )


class Mixing(Strict, frozen=True):
    """How two ailerons are the brake as well; roll has priority over it within their travel."""

    brake_throw: Annotated[float, Meta(ge=0.05, le=1.0)]  # of each aileron's, that all of it takes
    brake: Literal["up", "down"] = "up"  # the way that both go


class Throttle(Strict, frozen=True):
    """The channel of a propeller: its pulse goes from pwm_min, closed, to pwm_max, all of it."""

    channel: Channel
    pwm_min: Pwm = 1000
    pwm_max: Pwm = 2000

    def __post_init__(self) -> None:
        if not self.pwm_min < self.pwm_max:
            raise ValueError(f"pwm_min {self.pwm_min} < pwm_max {self.pwm_max} must hold")


class Surfaces(Strict, frozen=True):
    """The surfaces of the aircraft: elevator, rudder, and one aileron channel or two.

    What brakes is both ailerons together, each on a channel of its own, or a flap or a spoiler: its
    pulse goes from pwm_min, retracted, to pwm_max, all of it.
    """

    elevator: Surface
    rudder: Surface
    aileron: Surface = cast(Surface, None)  # the left one where there are two
    aileron_left: Surface | None = None
    aileron_right: Surface | None = None
    flap: Surface | None = None
    spoiler: Surface | None = None
    mixing: Mixing | None = None
    throttle: Throttle | None = None  # of a propeller, which THR_BUDGET lets the module use

    def __post_init__(self) -> None:
        left, right = self.aileron_left, self.aileron_right
        if (left is None) != (right is None):
            missing = "aileron_left" if left is None else "aileron_right"
            raise ValueError(f"{missing} is missing: two ailerons on channels of their own, or one")
        if (self.aileron is None) == (left is None):
            raise ValueError("give either aileron, or aileron_left and aileron_right")
        if (left is None) != (self.mixing is None):
            raise ValueError("mixing belongs to aileron_left and aileron_right: give all or none")
        if sum(each is not None for each in (left, self.flap, self.spoiler)) > 1:
            raise ValueError("one brake only: aileron_left and aileron_right, flap, or spoiler")
        if left is not None:
            force_setattr(self, "aileron", left)
        channels = [surface.channel for surface in self.driven()]
        if len(set(channels)) != len(channels):
            raise ValueError(f"two surfaces share a channel: {self._shared()}; give each its own")
        if self.throttle is not None and self.throttle.channel in channels:
            raise ValueError(f"throttle shares channel {self.throttle.channel} with a surface")

    def _shared(self) -> str:
        one = "aileron" if self.aileron_left is None else "aileron_left"
        names = (one, "elevator", "rudder", "aileron_right", "flap", "spoiler")
        moved = [(n, s.channel) for n in names if (s := getattr(self, n)) is not None]
        both = [channel for _, channel in moved]
        return ", ".join(f"{name} {channel}" for name, channel in moved if both.count(channel) > 1)

    @property
    def brake(self) -> Surface | None:
        """What brakes beside or as the other half of the aileron; None: nothing does."""
        return self.aileron_right or self.flap or self.spoiler

    @property
    def brake_throw(self) -> float:
        """Of each aileron's, positive upwards; 0: the brake is a surface of its own, or none."""
        if self.mixing is None:
            return 0.0
        return self.mixing.brake_throw if self.mixing.brake == "up" else -self.mixing.brake_throw

    def driven(self) -> tuple[Surface, ...]:
        """Elevator, aileron and rudder, and what brakes."""
        three = self.elevator, self.aileron, self.rudder
        return three if self.brake is None else (*three, self.brake)

    def channels(self) -> frozenset[int]:
        """Of all that the module may move: none of them can be a switch of the pilot's."""
        moved = [surface.channel for surface in self.driven()]
        return frozenset(moved if self.throttle is None else (*moved, self.throttle.channel))


# Who is an operator unless the airframe file says otherwise: the ids that ground stations use
# (MAVSDK's 245, and 255 of QGroundControl, Mission Planner and MAVProxy) with a few beside it.
OPERATORS: Final = frozenset((245, *range(250, 256)))


COMPONENT_ID: Final = 191  # of the module; 1 is the autopilot itself


class AutopilotLink(Strict, frozen=True):
    """The autopilot that moves the surfaces, and the identities used towards it."""

    firmware: Literal["ardupilot", "px4", "paparazzi", "bridge"]
    route: str | None = None  # by which it is commanded; None: the firmware's usual one
    system_id: SystemId = 1
    component_id: Annotated[int, Meta(ge=2, le=255)] = COMPONENT_ID
    override_system_id: SystemId = 255  # what the firmware's SYSID_MYGCS names
    operators: frozenset[SystemId] = OPERATORS  # who may set parameters and command
    # The message that brings accelerations; "usual" is what the firmware does best.
    imu: Literal["usual", "raw_imu", "scaled_imu", "highres_imu", "none"] = "usual"
    rangefinder: bool = False  # one that looks down is fitted: its distances are asked for

    @property
    def holds_attitude(self) -> bool:
        """Whether the firmware's own loops hold pitch and bank by this route."""
        return self.route == "attitude" or (self.firmware == "px4" and self.route is None)


# What the simulation flies: six degrees of freedom, or the paper's point mass.
ModelKind = Literal["rigid_body", "point_mass"]
MODEL_KINDS: Final[tuple[ModelKind, ...]] = ("rigid_body", "point_mass")

# As the command line spells them.
MODEL_OPTIONS: Final[dict[str, ModelKind]] = {kind.replace("_", "-"): kind for kind in MODEL_KINDS}


Inertia = Annotated[float, Meta(ge=1e-6, le=1e4)]


class AirframeMetadata(Strict, frozen=True):
    """What can be read off the bench: of anything from a model of 10 cm to a sailplane's size."""

    name: str
    mass_kg: Annotated[float, Meta(ge=0.02, le=100.0)]
    wing_area_m2: Annotated[float, Meta(ge=0.001, le=50.0)]
    span_m: Annotated[float, Meta(ge=0.1, le=20.0)]
    chord_m: Annotated[float, Meta(ge=0.01, le=5.0)]
    ixx_kgm2: Inertia
    iyy_kgm2: Inertia
    izz_kgm2: Inertia


class Polar(Strict, frozen=True):
    """The glide polar, as in `types.GlidePolar`."""

    c0: Finite
    c1: Finite
    c2: Finite
    c3: Finite
    speed_min_mps: Measured
    speed_max_mps: Measured

    def __post_init__(self) -> None:
        if not self.speed_min_mps < self.speed_max_mps:
            raise ValueError(
                f"speed_min_mps = {self.speed_min_mps:g}: must be below speed_max_mps ="
                f" {self.speed_max_mps:g}"
            )
        polar, low, high = self.as_polar(), self.speed_min_mps, self.speed_max_mps
        parts = [k / _SPEEDS for k in range(_SPEEDS + 1)]
        speeds = [(1.0 - part) * low + part * high for part in parts]
        sink, speed = min((polar_sink(polar, speed), speed) for speed in speeds)
        if not sink > 0.0:
            raise ValueError(
                f"c0, c1, c2, c3: a sink of {sink:.3g} m/s at {speed:.3g} m/s: must be above 0"
                " from speed_min_mps to speed_max_mps"
            )

    def as_polar(self) -> GlidePolar:
        """The polar that the laws and the contour take."""
        return GlidePolar(
            c0=self.c0,
            c1=self.c1,
            c2=self.c2,
            c3=self.c3,
            speed_min_mps=self.speed_min_mps,
            speed_max_mps=self.speed_max_mps,
        )


# `kind` stands among the numbers of [model] in a file; here it has a type of its own, under a name
# that no key of TOML has by chance.
MODEL_KIND_FIELD: Final = "kind of [model]"


class Airframe(Strict, frozen=True):
    """One airframe file."""

    airframe: AirframeMetadata
    autopilot: AutopilotLink
    surfaces: Surfaces
    polar: Polar
    parameters: dict[str, float] = field(default_factory=dict)
    # The simulation's; whether that has all it needs, tgl_soar.sim.aircraft checks.
    model: dict[str, Finite] = field(default_factory=dict)
    dynamics: MeasuredDynamics = field(default_factory=MeasuredDynamics)  # in pitch, as measured
    model_kind: ModelKind = field(default="rigid_body", name=MODEL_KIND_FIELD)  # model.kind

    def __post_init__(self) -> None:
        for key in self.model:
            if key not in MODEL_KEYS:
                known = ", ".join(MODEL_KEYS)
                raise ValueError(f"model.{key}: unknown key; known here: kind, {known}")
        for key in POSITIVE_KEYS:
            if not self.model.get(key, 1.0) > 0.0:
                raise ValueError(f"model.{key} = {self.model[key]:g}: must be above 0")
        _check_size(self.airframe)
        _check_signs(self.model)
        _check_ranges(self.model)
        _check_propeller(self.model)

    def all_parameters(self) -> dict[str, float]:
        """What the file gives: of the airframe in pitch, its stall and glide, and `[parameters]`,
        which come first."""
        table = self.airframe
        bench = {name: getattr(table, name) for name in (*_ON_THE_BENCH, "iyy_kgm2")}
        polar, route = self.polar.as_polar(), (self.autopilot.firmware, self.autopilot.route)
        derived = dynamics_parameters(self.dynamics, bench, self.model, polar, route)
        fastest = polar.speed_max_mps / derived.get("DYN_BEST", inf)
        return {
            **stall_limit(self.model),
            **pitch_limits(self.model, self.parameters, fastest),
            **slowest_airspeed(polar.speed_min_mps),
            **derived,
            **self.parameters,
        }

    def flown_as(self, kind: ModelKind | None) -> Airframe:
        """The same with another kind of model; None: its own."""
        return self if kind is None else replace(self, model_kind=kind)

    def aerodynamics(self) -> Aerodynamics:
        """Lift and drag as the flying module knows them; `NO_AERODYNAMICS` without a model."""
        model, table = self.model, self.airframe
        if not all(key in model for key in _AERODYNAMIC):
            return NO_AERODYNAMICS
        bench = {key: getattr(table, key) for key in _ON_THE_BENCH}
        known = {**dict.fromkeys((*OF_THE_BRAKE, *OF_THE_PROPELLER), 0.0), **bench, **model}
        if self.surfaces.brake is None:  # nothing moves it
            known.update(dict.fromkeys(OF_THE_BRAKE, 0.0))
        if self.surfaces.throttle is None:  # nor that
            known.update(dict.fromkeys(OF_THE_PROPELLER, 0.0))
        known.update(brake_throw=abs(self.surfaces.brake_throw))
        figures = (known[name] for name in Aerodynamics._fields if name != "polar")
        return Aerodynamics._make((*figures, self.polar.as_polar()))

    def model_lacks(self) -> tuple[str, ...]:
        """What is missing of [model] for lift and drag to be known, where there is some of it."""
        return tuple(key for key in _AERODYNAMIC if key not in self.model) if self.model else ()


def _check_size(bench: AirframeMetadata) -> None:
    """Errors: ValueError for figures that cannot be of one aircraft, such as in other units."""
    rectangle = bench.span_m * bench.chord_m
    low, high = (factor * rectangle for factor in _OF_SPAN_TIMES_CHORD)
    if not low <= bench.wing_area_m2 <= high:
        raise ValueError(
            f"airframe.wing_area_m2 = {bench.wing_area_m2:g}: must be from {low:.3g} to {high:.3g},"
            f" by span_m = {bench.span_m:g} and chord_m = {bench.chord_m:g}"
        )
    low, high = (bench.mass_kg * (part * bench.span_m) ** 2 for part in _GYRATION_OF_SPAN)
    for key in ("ixx_kgm2", "iyy_kgm2", "izz_kgm2"):
        if not low <= getattr(bench, key) <= high:
            raise ValueError(
                f"airframe.{key} = {getattr(bench, key):g}: must be from {low:.2g} to {high:.2g},"
                f" by mass_kg = {bench.mass_kg:g} and span_m = {bench.span_m:g}"
            )


def _check_signs(model: dict[str, float]) -> None:
    """Errors: ValueError for lift or a stall that no wing has, and for what would turn it over."""
    low, high = _LIFT_SLOPE
    if not low <= model.get("CL_alpha", low) <= high:
        slope = f"model.CL_alpha = {model['CL_alpha']:g}"
        raise ValueError(f"{slope}: must be from {low:g} to {high:g} (per radian)")
    for key in _BELOW_STALL_MAX:
        if not model.get(key, 0.0) <= STALL_MAX_RAD:
            allowed = f"above 0, up to {STALL_MAX_RAD:g} (radians)"
            raise ValueError(f"model.{key} = {model[key]:g}: must be {allowed}")
    for key in NEGATIVE_KEYS:
        if not model.get(key, -1.0) < 0.0:
            raise ValueError(f"model.{key} = {model[key]:g}: must be below 0")


def _check_ranges(model: dict[str, float]) -> None:
    """Errors: ValueError for figures such as in other units."""
    for key, low, high in _RANGES:
        value = model.get(key)
        if value is not None and not low <= value <= high:
            raise ValueError(f"model.{key} = {value:g}: must be from {low:g} to {high:g}")
    lag_s = 1.0 / model.get("servo_lag_radps", inf)
    if not model.get("servo_delay_s", 0.0) + lag_s <= SERVO_LATE_MAX_S:
        raise ValueError(
            f"model.servo_delay_s = {model['servo_delay_s']:g}: must be up to"
            f" {SERVO_LATE_MAX_S:g} s, together with 1 / servo_lag_radps = {lag_s:.3g} s"
        )


def _check_propeller(model: dict[str, float]) -> None:
    """Errors: ValueError for half of a propeller's figures."""
    given = [key for key in OF_THE_PROPELLER[:2] if key in model]
    if len(given) == 1:
        missing = next(key for key in OF_THE_PROPELLER if key not in model)
        raise ValueError(f"model.{missing}: missing, where {given[0]} is given")


_SPEEDS: Final = 20  # of a polar that are looked at: a cubic bends no faster
# A mean chord makes it 1; a delta's aerodynamic one 0.75, the root's of any wing 0.5 and more.
_OF_SPAN_TIMES_CHORD: Final = (0.4, 2.0)
# Radii of gyration: 0.12 to 0.17 in roll and yaw, 0.06 to 0.12 in pitch; 0.5 is a mass at the tips.
_GYRATION_OF_SPAN: Final = (0.02, 1.0)
STALL_MAX_RAD: Final = 0.8  # 46 degrees
_BELOW_STALL_MAX: Final = ("stall_alpha_rad", "stall_width_rad")
NEGATIVE_KEYS: Final = ("stall_alpha_negative_rad", "Cl_p", "Cm_alpha", "Cm_q", "Cn_r")
# A wing of aspect ratio 1 has some 1.5, a thin aerofoil 6.28, a thick one somewhat more; by degrees
# it would be 0.11 at most.
_LIFT_SLOPE: Final = (0.5, 8.0)
_ON_THE_BENCH: Final = ("mass_kg", "wing_area_m2", "chord_m")
OF_THE_BRAKE: Final = ("CL_brake", "CD_brake", "Cm_brake")  # 0 where [model] has none
# Without one there are none of them; a lag that is not given is none.
OF_THE_PROPELLER: Final = ("propeller_thrust_n", "propeller_speed_mps", "propeller_lag_s")
SERVO_LATE_MAX_S: Final = 0.3  # a slower one holds no line; DYN_SERVO goes no farther
_RANGES: Final = (
    ("air_density_kgpm3", 0.3, 1.6),  # at 12 km; at sea level, at 60 degrees below zero
    ("CD0", 0.0, 0.5),  # more than any aircraft with its brakes out
    ("servo_lag_radps", 3.4, 1e4),
    ("servo_delay_s", 0.0, SERVO_LATE_MAX_S),
    ("propeller_thrust_n", 0.0, 1e4),
    ("propeller_speed_mps", 1.0, 200.0),
    ("propeller_lag_s", 0.0, 2.0),
)
_AERODYNAMIC: Final = tuple(
    name
    for name in Aerodynamics._fields
    if name not in ("polar", "brake_throw", *_ON_THE_BENCH, *OF_THE_BRAKE, *OF_THE_PROPELLER)
)
# All that the simulation's models take (`sim.aircraft`, `sim.servos`, `sim.point_mass`).
MODEL_KEYS: Final = (
    *("gravity_mps2", "air_density_kgpm3"),
    *("CL0", "CL_alpha", "CL_elevator"),
    *("stall_alpha_rad", "stall_alpha_negative_rad", "stall_width_rad"),
    *("CD0", "CD_lift", "CD_separated", "CD_beta", "CY_beta", "CY_rudder"),
    *("Cl_beta", "Cl_p", "Cl_r", "Cl_aileron"),
    *("Cm0", "Cm_alpha", "Cm_q", "Cm_elevator"),
    *("Cn_beta", "Cn_p", "Cn_r", "Cn_rudder", "Cn_aileron"),
    *OF_THE_BRAKE,
    *OF_THE_PROPELLER,
    *("servo_lag_radps", "servo_rate_per_s", "servo_travel", "servo_delay_s", "thrust_n"),
)
# Of these all that the simulation cannot do without.
SIMULATED_KEYS: Final = tuple(
    key for key in MODEL_KEYS if key not in (*OF_THE_BRAKE, *OF_THE_PROPELLER, "thrust_n")
)
POSITIVE_KEYS: Final = (
    "gravity_mps2",
    "stall_alpha_rad",
    "stall_width_rad",
    "CD0",
    "Cl_aileron",
    "Cm_elevator",
    "Cn_rudder",
)
