"""A flight as a log tells it, whoever wrote the log.

Each kind of measurement is a `Series` with time stamps of its own, or None where the log has
none of it: nothing is interpolated before somebody asks.  Time is in seconds from the first
sample of the flight; lengths, angles and rates are SI.  `missing` tells in words what the log
never held, `lost` what it held and could not be read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.config.airframe import Surface, Surfaces
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.geometry import SoaringFrame, soaring_from_ned, soaring_vector_from_ned

Floats = NDArray[np.float64]

RATES: Final = ("roll_rate_frd_radps", "pitch_rate_frd_radps", "yaw_rate_frd_radps")
# The columns of every series, in their order.
COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "position": ("north_m", "east_m", "down_m"),  # local NED
    "velocity": ("north_mps", "east_mps", "down_mps"),  # local NED
    "attitude": ("roll_rad", "pitch_rad", "yaw_rad"),  # FRD to local NED
    "rates": RATES,  # those that come with the attitude
    "airspeed": ("airspeed_mps",),
    "imu": ("force_x_frd_mps2", "force_y_frd_mps2", "force_z_frd_mps2", *RATES),
    "path": ("x_m", "y_m", "z_m"),  # soaring frame
    "motion": ("velocity_x_mps", "velocity_y_mps", "climb_mps"),  # soaring frame
    "heading": ("heading_rad",),  # from straight upwind, positive to the right
    "surfaces": ("elevator", "aileron", "rudder"),  # commanded, -1 … 1
    "brake": ("brake",),  # as it was put, 0 … 1
    "setpoints": ("pitch_rad", "roll_rad", "heading_rad"),
    "tracking": ("e_rho_m",),
    "line": ("x_m", "z_m", "eta_rad", "moving"),  # the line that is flown; moving: 1 or 0
    "air": ("wind_mps", "updraft_mps"),  # as estimated on board
    "ages": ("position_age_s", "attitude_age_s", "heartbeat_age_s"),
    "margins": ("clearance_m", "stall_rad"),  # to the ground, of the angle of attack
    "forecast": ("standing", "chance", "ahead_s", "z_m"),  # as `control.forecast` has them
    "throttle": ("fraction", "climb_mps"),  # sent, 0 … 1, and what climb the propeller gives
    # How a point of the line is held (`control.point_hold`), how far along the line the aircraft is
    # off it, and the brake as it is commanded.
    "point": ("standing", "off_m", "brake"),
    "excitation": (  # a multisine on the pitch setpoint, at every tick of a flight that had one
        *("standing", "injected_rad", "setpoint_rad", "pitch_rad"),  # setpoint: with it
        *("elevator", "elevator_p", "elevator_i"),  # commanded, and terms of the pitch law
    ),
}

WORDS: Final[dict[str, str]] = {
    "position": "position (local NED)",
    "velocity": "velocity",
    "attitude": "attitude",
    "rates": "rates beside the attitude",
    "airspeed": "airspeed",
    "imu": "accelerations and rates",
    "surfaces": "surface commands",
    "brake": "brake",
    "setpoints": "attitude setpoints",
    "tracking": "e_rho",
    "line": "target gradient line",
    "air": "estimate of wind and updraft",
    "ages": "ages of the inputs",
    "margins": "margins to ground and stall",
    "forecast": "forecast of where it settles",
    "throttle": "throttle",
    "point": "point of the line that is held",
    "excitation": "multisine on the pitch setpoint",
    "path": "path in the soaring frame",
    "motion": "velocity in the soaring frame",
    "heading": "heading from upwind",
}


@dataclass(frozen=True)
class Series:
    """Samples in the order of their times, each column of shape (n,)."""

    time_s: Floats  # never decreasing
    columns: Mapping[str, Floats]
    source: str  # what of the log they were read from

    def __getitem__(self, name: str) -> Floats:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.time_s)

    def at(self, name: str, time_s: ArrayLike) -> Floats:
        """A column at other times, linear between samples; NaN outside of them."""
        times = np.asarray(time_s, dtype=float)
        known = np.isfinite(self.columns[name])
        if not known.any():
            return np.full(times.shape, np.nan)
        values = np.interp(
            times, self.time_s[known], self.columns[name][known], left=np.nan, right=np.nan
        )
        return np.asarray(values, dtype=float)

    def last_at(self, name: str, time_s: ArrayLike) -> Floats:
        """A column as it stood at other times: the newest sample's value; NaN before the first."""
        i = np.searchsorted(self.time_s, np.asarray(time_s, dtype=float), side="right") - 1
        return np.where(i >= 0, self.columns[name][np.maximum(i, 0)], np.nan)

    def within(self, begin_s: float, end_s: float) -> Series:
        """The samples from begin to end, both included."""
        rows = (self.time_s >= begin_s) & (self.time_s <= end_s)
        columns = {name: values[rows] for name, values in self.columns.items()}
        return Series(self.time_s[rows], columns, self.source)


class Event(NamedTuple):
    """Something that happened at a time."""

    time_s: float
    kind: str  # "message", "parameter", "lost" …
    text: str


class LoggedMode(NamedTuple):
    """From here on this mode; "" where nothing is known of it."""

    time_s: float
    name: str


@dataclass(frozen=True)
class FlightData:
    """One flight.  The columns of each series stand in `COLUMNS`."""

    name: str  # of the log
    kind: str  # what sort of log it is, in words
    position: Series | None = None
    velocity: Series | None = None
    attitude: Series | None = None
    rates: Series | None = None
    airspeed: Series | None = None
    imu: Series | None = None
    path: Series | None = None
    motion: Series | None = None
    heading: Series | None = None
    surfaces: Series | None = None
    brake: Series | None = None
    outputs: Series | None = None  # pulse widths by channel: "1", "2" … [µs]
    setpoints: Series | None = None
    tracking: Series | None = None
    line: Series | None = None
    air: Series | None = None
    ages: Series | None = None
    margins: Series | None = None
    forecast: Series | None = None
    throttle: Series | None = None
    point: Series | None = None
    excitation: Series | None = None
    modes: tuple[LoggedMode, ...] = ()  # of the module that soars
    autopilot_modes: tuple[LoggedMode, ...] = ()  # of the firmware
    events: tuple[Event, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)  # versions, files, dates: name, words
    files: Mapping[str, str] = field(default_factory=dict)  # "airframe", "site": whole files
    streams: Mapping[str, Floats] = field(default_factory=dict)  # times at which each arrived
    loss: Mapping[str, tuple[int, int]] = field(default_factory=dict)  # frames: arrived, lost
    start_s: float = 0.0  # by the log's own clock
    absolute_positions: bool = True  # False: measured from the first fix, wherever that was
    missing: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    def series(self) -> dict[str, Series]:
        """Every series that is there, by name."""
        found = {name: getattr(self, name) for name in (*COLUMNS, "outputs")}
        return {name: s for name, s in found.items() if s is not None}

    @property
    def duration_s(self) -> float:
        """From the first sample to the last; an event before the first is none."""
        ends = [float(s.time_s[-1]) for s in self.series().values()]
        return max([0.0, *ends, *(event.time_s for event in self.events)])


def series(time_s: ArrayLike, source: str, **columns: ArrayLike) -> Series | None:
    """A series of what is there; None without a sample.  The times must not decrease."""
    times = np.asarray(time_s, dtype=float)
    if not times.size:
        return None
    return Series(times, {k: np.asarray(v, dtype=float) for k, v in columns.items()}, source)


def euler(qw: Floats, qx: Floats, qy: Floats, qz: Floats) -> tuple[Floats, Floats, Floats]:
    """(roll, pitch, yaw) [rad] of many rotations from FRD to NED; NaN where there is none."""
    norm = np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    with np.errstate(invalid="ignore", divide="ignore"):
        w, x, y, z = (q / norm for q in (qw, qx, qy, qz))
    return (
        np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def placed(flight: FlightData, frame: SoaringFrame) -> FlightData:
    """The flight with path, motion and heading in a site's soaring frame, where it has none."""
    path, motion, heading = flight.path, flight.motion, flight.heading
    # Plain arithmetic: arrays pass through it as numbers do.
    place: Any = soaring_from_ned
    turn: Any = soaring_vector_from_ned
    partial = path is None or not np.isfinite(path["y_m"]).any()  # as telemetry tells it
    if partial and flight.position is not None and flight.absolute_positions:
        p = flight.position
        x, y, z = place(frame, p["north_m"], p["east_m"], p["down_m"])
        path = Series(p.time_s, {"x_m": x, "y_m": y, "z_m": z}, p.source)
    if motion is None and flight.velocity is not None:
        v = flight.velocity
        vx, vy, climb = turn(frame, v["north_mps"], v["east_mps"], v["down_mps"])
        columns = {"velocity_x_mps": vx, "velocity_y_mps": vy, "climb_mps": climb}
        motion = Series(v.time_s, columns, v.source)
    if heading is None and flight.attitude is not None:
        yaw = flight.attitude["yaw_rad"] - frame.wind_from_rad
        wrapped = (yaw + np.pi) % (2.0 * np.pi) - np.pi
        heading = Series(flight.attitude.time_s, {"heading_rad": wrapped}, flight.attitude.source)
    return replace(flight, path=path, motion=motion, heading=heading)


def steered(flight: FlightData, surfaces: Surfaces) -> FlightData:
    """The flight with surfaces and brake from the outputs' pulse widths, each where the log has no
    commands of it."""
    outputs = flight.outputs
    if outputs is not None and flight.brake is None:
        flight = replace(flight, brake=_braked(outputs, surfaces))
    if flight.surfaces is not None or outputs is None:
        return flight
    columns = {}
    for name in COLUMNS["surfaces"]:
        surface: Surface = getattr(surfaces, name)
        pulse = outputs.columns.get(str(surface.channel))
        if pulse is None:
            return flight
        ends = [surface.pwm_min, surface.pwm_trim, surface.pwm_max]
        values = np.interp(pulse, ends, [1.0, 0.0, -1.0] if surface.reversed else [-1.0, 0.0, 1.0])
        columns[name] = np.where(pulse > 0.0, values, np.nan)  # 0: the output is off
    moved = Series(outputs.time_s, columns, outputs.source)
    return replace(flight, surfaces=moved)


def _braked(outputs: Series, surfaces: Surfaces) -> Series | None:
    """The brake from its pulse widths; None where none of the channels brakes."""
    known = surfaces.brake
    pulse = None if known is None else outputs.columns.get(str(known.channel))
    if known is None or pulse is None or surfaces.brake_throw != 0.0:
        return None
    out = np.interp(pulse, [known.pwm_min, known.pwm_max], [1.0, 0.0] if known.reversed else [0, 1])
    columns = {"brake": np.where(pulse > 0.0, out, np.nan)}
    return Series(outputs.time_s, columns, outputs.source)


def on_line(flight: FlightData) -> FlightData:
    """The flight with e_rho from its path and line, where the log holds none at the path's rate.

    e_rho as it was flown, on board, stays as it is.
    """
    if flight.tracking is not None or flight.path is None or flight.line is None:
        return flight
    path, line = flight.path, flight.line
    x0, z0, eta = (line.last_at(name, path.time_s) for name in ("x_m", "z_m", "eta_rad"))
    e = np.cos(eta) * (path["z_m"] - z0) - np.sin(eta) * (path["x_m"] - x0)
    tracking = Series(path.time_s, {"e_rho_m": e}, f"{path.source} and {line.source}")
    return replace(flight, tracking=tracking)


def with_missing(flight: FlightData, wanted: tuple[str, ...]) -> FlightData:
    """The flight saying what of these series it does not hold."""
    there = flight.series()
    lacking = (f"the log holds no {WORDS[name]}" for name in wanted if name not in there)
    return replace(flight, missing=(*flight.missing, *lacking))


def parameter_events(
    first: dict[str, float], changes: Sequence[tuple[float, str, float]]
) -> list[Event]:
    """A line for each change of a parameter."""
    known = dict(first)
    events = []
    for time_s, name, value in changes:
        if known.get(name) == value:
            continue
        before = f"{known[name]:.6g} → " if name in known else ""
        events.append(Event(time_s, "parameter", f"{name} {before}{value:.6g}"))
        known[name] = value
    return events


def changes_of(time_s: Floats, names: Sequence[str]) -> tuple[LoggedMode, ...]:
    """Modes, one name a sample, as the changes between them."""
    found: list[LoggedMode] = []
    for t, name in zip(time_s.tolist(), names, strict=True):
        if not found or found[-1].name != name:
            found.append(LoggedMode(t, name))
    return tuple(found)


def mode_words(numbers: NDArray[Any], names: Sequence[str] = MODE_NAMES) -> list[str]:
    """The module's modes by their numbers; names: those of the version that wrote them."""
    known = dict(enumerate(names))
    return [known.get(int(number), f"mode {int(number)}") for number in numbers]


def line_series(parts: dict[str, Series], source: str) -> Series | None:
    """A line that was reported number by number ("x_m", "z_m", "eta_rad"), as one series.

    It counts as moving from a sample that differs from the one before until one that does not.
    """
    if not {"x_m", "z_m", "eta_rad"} <= parts.keys():
        return None
    times = np.unique(np.concatenate([p.time_s for p in parts.values()]))
    columns = {name: p.last_at(name, times) for name, p in parts.items()}
    known = np.all(np.isfinite(list(columns.values())), axis=0)
    moving = np.zeros(len(times))
    for name, part in parts.items():
        values = part[name]
        changed = np.concatenate([np.abs(np.diff(values)) > 1e-4, [False]])
        changed[1:] |= changed[:-1].copy()
        own = Series(part.time_s, {"moving": changed.astype(float)}, source)
        moving = np.maximum(moving, np.nan_to_num(own.last_at("moving", times)))
    columns = {name: values[known] for name, values in columns.items()}
    if not known.any():
        return None
    return Series(times[known], {**columns, "moving": moving[known]}, source)
