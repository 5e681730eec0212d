"""Every topic of the flight log and every field in it, declared once.

Writer, reader, replay and docs/logs.md all read `TOPICS`.  It is not written by hand: topics are
made of the named tuples that flow through a tick, flattened field by field, so that what the
laws, the estimator or the supervisor add is in the log and on the page by itself:

    tick        `Output`, and of `Inputs` the plain fields           one row a tick
    slow        what of `Output` changes slowly                      every eighth tick
    NAME        each named tuple in `Inputs`, in doubles             a row when it has changed
    state       `AutopilotState`, in doubles                         a row now and then
    parameter   the parameters that have changed
    link        how the link and the loop's timing did

A nested field's name begins with that of what it is in: `Output.vehicle.x_m` is `vehicle_x_m`.
Its unit is the ending of its name, or stands in `UNITS`; its meaning is the comment beside it in
its named tuple, or stands in `MEANINGS`.

Derived numbers are 32-bit floats.  Times, inputs, states and the surface commands are doubles:
with them a flight is replayed bit for bit.  Attitudes and accelerations come in single precision
and are logged in it: nothing of them is lost.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, Final, NamedTuple, get_args, get_origin, get_type_hints

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.types import Inputs

VERSION: Final = 2  # of this layout: a log says with which it was written

_CODES: Final = {
    "uint64_t": "Q",
    "uint32_t": "I",
    "uint16_t": "H",
    "uint8_t": "B",
    "int64_t": "q",
    "int32_t": "i",
    "int8_t": "b",
    "double": "d",
    "float": "f",
    "bool": "?",
}

SUFFIXES: Final = (
    ("_per_s", "1/s"),
    ("_mps2", "m/s²"),
    ("_mps", "m/s"),
    ("_radps", "rad/s"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_us", "µs"),
    ("_ms", "ms"),
    ("_m", "m"),
    ("_s", "s"),
)

# Units that no ending tells: by the name in the topic, or by what it begins with.
UNITS: Final = {
    "command_": "of full travel",
    "soaring_": "rad",
    "elevator_": "of full travel",
    "aileron_": "of full travel",
    "rudder_": "of full travel",
    "sideways_": "rad",
    "elevator": "of full travel",
    "aileron": "of full travel",
    "rudder": "of full travel",
    "timestamp": "µs",
}

# What is small enough for less than 64 bits.
_SMALL: Final = {
    "Output.mode": "uint8_t",
    "Output.reason": "uint8_t",
    "PidTerms.saturated": "int8_t",
    "PositionFix.source": "uint8_t",
    "MotionQuality.source": "uint8_t",
    "Health.surfaces_answer": "int8_t",
    "Health.faults": "uint32_t",
    "Margins.outside": "uint8_t",
    "Output.cut": "uint16_t",
    "ExcitationState.standing": "uint8_t",
    "Forecast.standing": "uint8_t",
    "GroundRange.standing": "uint8_t",
    "RangeState.standing": "uint8_t",
    "PointReport.standing": "uint8_t",
    "BrakeState.standing": "uint8_t",
    "LaunchState.standing": "uint8_t",
    "ThrottleReport.standing": "uint8_t",
    "ThrottleReport.called": "uint8_t",
    "ThrottleState.standing": "uint8_t",
    "ThrottleState.called": "uint8_t",
}

# Samples whose numbers, but for their times, the wire brings in single precision.
_SINGLE: Final = frozenset({"AttitudeSample", "ImuSample"})

# Of the output, what the row says elsewhere.
_LEFT_OUT: Final = frozenset(
    {
        "Output.time_s",
        "VehicleState.time_s",
        "ExcitationState.begun_s",
        "ExcitationState.amplitude_rad",
        "ExcitationState.limited_s",
        "LaunchLandingReport.launch",
        "GroundRange.bound_m",  # in the clearance
        "GroundRange.refused",  # in the faults
    }
)

# Of the output, what need not be in every row: a replay gives all of it for every tick.
_SLOW: Final = re.compile(
    r"air_\w+|sideways_\w+|\w+_feedforward|health_(rejected|gaps|heartbeat_age_s|attitude_age_s)"
    r"|health_\w+_(interval|jitter)_s|setpoints_(roll|heading)_rad|rudder_i|line_eta_rad"
    r"|ground_range_\w+|quality_\w+|gains_\w+|forecast_\w+|launch_landing_\w+|throttle_\w+|imu_weight"
    r"|(elevator|aileron|rudder)_output"
)

# Columns that are not called by the tuples they come from: a field of these, or all that is in it
# (then "": the name begins with that of what is inside).
_NAMED: Final = {
    "AutopilotState.memory": "",
    "AutopilotState.loops": "",
    "LineTracking.e_rho_m": "e_rho_m",
    "LineTracking.e_rho_rate_mps": "e_rho_rate_mps",
}

# In which order a state's columns stand, by how their names begin; what is not here comes last.
_STATE_ORDER: Final = (
    *("time_s", "supervisor_", "off_line_s", "motion_", "line_", "soaring_"),
    *("pitch_integral", "pitch_rate", "roll_", "heading_integral", "heading_rate"),
    *("heading_setpoint_rad", "sideways_", "limited_", "wind_"),
)

FRAMES: Final = {
    "PositionFix": "NED",
    "VehicleState": "soaring",
    "MotionState": "soaring",
    "Offset": "soaring",
    "Innovation": "soaring",
    "Outliers": "soaring",
    "MotionQuality": "soaring",
    "Track": "soaring",
    "Node": "soaring",
    "Errors": "soaring",
    "AttitudeTrack": "soaring",
    "LineState": "soaring",
    "BrakeState": "soaring",
    "AirEstimate": "soaring",
    "ForecastState": "soaring",
    "Forecast": "soaring",
}

MEANINGS: Final = {
    "Inputs.engage": "the operator wants the module to fly",
    "Inputs.time_s": "the time of this tick, loop's clock",
    "PositionFix.north_m": "position",
    "PositionFix.east_m": "position",
    "PositionFix.down_m": "position",
    "PositionFix.velocity_east_mps": "NaN where the source gives no velocity",
    "PositionFix.velocity_down_mps": "NaN where the source gives no velocity",
    "AttitudeSample.qw": "rotation from FRD to NED",
    "AttitudeSample.qx": "rotation from FRD to NED",
    "AttitudeSample.qy": "rotation from FRD to NED",
    "AttitudeSample.qz": "rotation from FRD to NED",
    "AttitudeSample.pitch_rate_frd_radps": "NaN where the source gives no rates",
    "AttitudeSample.yaw_rate_frd_radps": "NaN where the source gives no rates",
    "ImuSample.force_y_frd_mps2": "specific force: gravity is not in it",
    "ImuSample.force_z_frd_mps2": "specific force: gravity is not in it",
    "ImuSample.pitch_rate_frd_radps": "NaN where the source gives no rates",
    "ImuSample.yaw_rate_frd_radps": "NaN where the source gives no rates",
    "AirspeedSample.airspeed_mps": "as the pitot tube measures it",
    "AutopilotStatus.armed": "it is armed",
    "SurfacesSample.aileron": "as the elevator",
    "SurfacesSample.rudder": "as the elevator",
    "AirEstimate.updraft_sigma_mps": "standard deviation of the updraft",
    "GroundRange.standing": "of the last distance: 0 none, 1 used, 2 tilted, 3 frozen, 4 far off,"
    " 5 stamp refused, 6 no number",
    "RangeState.standing": "as ground_range_standing",
    "RangeState.off_m": "the height over the ground as measured, less as the position has it",
    "RangeState.off_1_m": "the same of the sample before",
    "RangeState.off_2_m": "the same of the one before that",
    "RangeState.correction_m": "of the position's height, as it is known",
    "RangeState.corrects": "off_m may correct the height; else it only bounds",
    "RangeState.proof_off_m": "off_m of the first of the samples that have agreed since",
    "Output.mode": "by number: Modes, below",
    "Output.reason": "why the mode changed in this tick, by number: Reasons, below",
    "LineTracking.x_m": "of the line's point, downstream",
    "LineTracking.z_m": "of the line's point, height",
    "LineTracking.eta_rad": "the line's inclination from the downstream axis",
    "LineTracking.moving": "the line is on its way to its target",
    "LineTracking.e_rho_rate_mps": "how fast e_rho grows, as the law sees it",
    "VehicleState.x_m": "downstream",
    "VehicleState.y_m": "to the right of an aircraft facing upwind",
    "VehicleState.z_m": "height",
    "VehicleState.velocity_x_mps": "downstream",
    "VehicleState.velocity_y_mps": "to the right of an aircraft facing upwind",
    "VehicleState.climb_mps": "up",
    "VehicleState.roll_rad": "right wing down is positive",
    "VehicleState.pitch_rad": "nose up is positive",
    "VehicleState.pitch_rate_radps": "of the angle above",
    "VehicleState.heading_rate_radps": "of the angle above",
    "Health.attitude_age_s": "age of the last sample that was used; inf: none",
    "Health.heartbeat_age_s": "since the autopilot's last heartbeat; inf: none",
    "Health.position_ok": "it may be flown with",
    "Health.attitude_ok": "it may be flown with",
    "Health.autopilot_ok": "its heartbeat is fresh",
    "Setpoints.pitch_rad": "of the attitude loop; NaN: the module does not fly",
    "Setpoints.roll_rad": "of the attitude loop; NaN: the module does not fly",
    "Setpoints.heading_rad": "of the heading loop, towards the waypoint; NaN: it does not fly",
    "SurfaceCommand.elevator": "what is sent; up is positive",
    "SurfaceCommand.aileron": "what is sent; rolling right is positive",
    "SurfaceCommand.rudder": "what is sent; yawing right is positive",
    "PidTerms.output": "the sum of the terms, limited",
    "PidTerms.p": "proportional to the error",
    "PidTerms.i": "the integral",
    "PidTerms.d": "proportional to the error's rate",
    "PidTerms.feedforward": "independent of the error",
    "SupervisorState.mode": "by number: Modes, below",
    "MotionQuality.fix_refused": "a fix was refused in this tick",
    "Node.time_s": "time of a point of the track",
    "Track.time_s": "time up to which accelerations are integrated",
    "Errors.time_s": "time for which these errors of the track hold",
    "AttitudeTrack.by_gyros": "the rates are those of the gyros",
    "LineState.moving": "it is on its way to its target",
    "Limited.aileron_blocked": "as the elevator's",
    "Limited.brake_blocked": "as the elevator's",
    "Limited.brake_max": "the furthest that the brake might go: stall, height and roll come first",
    "Lull.slow_s": "for how long the wind has been too slow to stand in, less since",
    "Lull.low_s": "for how long it has sunk to the least height, less since",
    "BrakeState.standing": "as point_standing",
    "PointReport.standing": "the point on the line: 0 the line alone, 1 held, 2 above the band,"
    " 3 below, 4 no brake, 5 it does not answer, 6 it pulls to one side, 7 it is tried,"
    " 8 the point gives way, 9 it is not held yet",
    "BrakeState.z_m": "height of the point that is flown",
    "BrakeState.ordered_z_m": "height of the point as it was ordered last",
    "EvenState.brake": "mean of some seconds, of the brake as it was commanded",
    "EvenState.aileron": "the same, of the aileron",
    "EvenState.brake_2": "mean square of the brake about that mean",
    "EvenState.both": "mean product of both about their means",
    "EvenState.aileron_2": "as the brake's, of the aileron",
    "TrialState.speed_sum_mps": "of the speeds along the line in this half",
    "TrialState.found": "0 nothing, 1 it acts, 2 it does not",
    "TrialState.q_sum": "of what the brake did in each, by what it should",
    "TrialState.q_2_sum": "of its squares",
    "Limited.finite": "the last command was finite",
    "ThrottleReport.standing": "0 off, 1 closed, 2 open, 3 the budget is used up",
    "ThrottleReport.called": "by: 0 nothing, 1 no place to settle, 2 way home, 3 low and sinks",
    "ThrottleReport.fraction": "what is sent, 0 … 1",
    "ThrottleState.standing": "as throttle_standing",
    "ExcitationState.standing": "multisine: 0 none, 1 running, 2 done, 3 … why it ended or did not"
    " begin",
}


class Leaf(NamedTuple):
    """One number of a tuple of tuples."""

    name: str
    kind: type  # float, int or bool
    owner: str  # "NamedTuple.field" that declares it
    place: str  # how to get at it from the outermost tuple: "[4][0]"


class Field(NamedTuple):
    """One column of a topic."""

    name: str
    kind: str  # ULog's name of the type
    owner: str = ""  # "NamedTuple.field"; "": declared here
    meaning: str = ""  # where it is declared here

    @property
    def code(self) -> str:
        """The type as `struct` has it."""
        return _CODES[self.kind]


class Topic(NamedTuple):
    """One kind of row."""

    name: str
    number: int  # the subscription's in every log
    fields: tuple[Field, ...]
    meaning: str
    leaves: tuple[Leaf, ...] = ()  # of the tuple it is made from
    source: type | None = None

    @property
    def layout(self) -> str:
        """A row as `struct` has it."""
        return "<" + "".join(field.code for field in self.fields)

    @property
    def format(self) -> str:
        """As a ULog declares it."""
        return f"{self.name}:" + "".join(f"{field.kind} {field.name};" for field in self.fields)


def is_named_tuple(kind: object) -> bool:
    """Whether a type is a named tuple."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")


def leaves_of(kind: type, name: str = "", owner: str = "", place: str = "") -> Iterator[Leaf]:
    """The numbers in a tuple of tuples, in order.

    A fixed-length tuple of plain numbers counts through: `p_0`, `p_1`.  Errors: `TypeError` for
    what is none of both.
    """
    if kind in (float, int, bool):
        yield Leaf(name, kind, owner, place)
    elif is_named_tuple(kind):
        for i, (field, hint) in enumerate(get_type_hints(kind).items()):
            declared = f"{kind.__name__}.{field}"
            inner = _NAMED.get(declared, f"{name}_{field}" if name else field)
            yield from leaves_of(hint, inner, declared, f"{place}[{i}]")
    elif get_origin(kind) is tuple and Ellipsis not in get_args(kind):
        for i, hint in enumerate(get_args(kind)):
            yield from leaves_of(hint, f"{name}_{i}", owner, f"{place}[{i}]")
    else:
        raise TypeError(f"{owner}: the log knows no {kind}")


@cache
def _hints(kind: type) -> tuple[type, ...]:
    return tuple(get_type_hints(kind).values())


def rebuilt(kind: type, numbers: Iterator[Any]) -> Any:
    """The tuple of tuples whose leaves, in order, these numbers are."""
    if kind in (float, int, bool):
        return kind(next(numbers))
    if is_named_tuple(kind):
        return kind(*(rebuilt(hint, numbers) for hint in _hints(kind)))
    return tuple(rebuilt(hint, numbers) for hint in get_args(kind))


def _field(leaf: Leaf, *, exact: bool) -> Field:
    if leaf.kind is bool:
        return Field(leaf.name, "bool", leaf.owner)
    if leaf.kind is int:
        usual = "uint32_t" if leaf.name == "sequence" else "int64_t" if exact else "int32_t"
        return Field(leaf.name, _SMALL.get(leaf.owner, usual), leaf.owner)
    exact = exact and leaf.owner.partition(".")[0] not in _SINGLE
    exact = exact or leaf.name.endswith("time_s") or leaf.name.startswith("command_")
    return Field(leaf.name, "double" if exact else "float", leaf.owner)


_HEAD: Final = (
    Field("timestamp", "uint64_t", meaning="time of the tick, loop's clock"),
    Field("tick", "uint32_t", meaning="number of the tick, from 1"),
)

STREAMS: Final[dict[str, type]] = {
    name: hint for name, hint in get_type_hints(Inputs).items() if is_named_tuple(hint)
}
_PLAIN_INPUTS: Final = tuple(leaf for leaf in leaves_of(Inputs) if leaf.place.count("[") == 1)
_ALL_OUTPUTS: Final = tuple(leaf for leaf in leaves_of(Output) if leaf.owner not in _LEFT_OUT)
_OUTPUTS: Final = tuple(leaf for leaf in _ALL_OUTPUTS if not _SLOW.fullmatch(leaf.name))
_SLOW_OUTPUTS: Final = tuple(leaf for leaf in _ALL_OUTPUTS if _SLOW.fullmatch(leaf.name))


def _state_order(leaf: Leaf) -> int:
    begins = (i for i, begin in enumerate(_STATE_ORDER) if leaf.name.startswith(begin))
    return next(begins, len(_STATE_ORDER))


def _topics() -> Iterator[Topic]:
    plain = [_field(leaf, exact=True) for leaf in _PLAIN_INPUTS]
    outputs = [_field(leaf, exact=False) for leaf in _OUTPUTS]
    yield Topic(
        name="tick",
        number=0,
        fields=(*_HEAD, *plain, *outputs),
        meaning="What one tick decided, and why: one row for every tick.",
    )
    number = 1
    for name, kind in STREAMS.items():
        leaves = tuple(leaves_of(kind))
        fields = (*_HEAD, *(_field(leaf, exact=True) for leaf in leaves))
        meaning = "An input of the ticks from this one on; one row for each new value."
        yield Topic(
            name=name, number=number, fields=fields, meaning=meaning, leaves=leaves, source=kind
        )
        number += 1
    leaves = tuple(sorted(leaves_of(AutopilotState), key=_state_order))
    yield Topic(
        name="state",
        number=number,
        fields=(
            *_HEAD,
            Field("reset", "bool", meaning="the module was reset to this state"),
            *(_field(leaf, exact=True) for leaf in leaves),
        ),
        meaning="The memory that the tick left to the next; a replay can begin at any of these"
        " rows.",
        leaves=leaves,
        source=AutopilotState,
    )
    yield Topic(
        name="parameter",
        number=number + 1,
        fields=(
            *_HEAD,
            Field("index", "uint16_t", meaning="which, in the order of docs/parameters.md"),
            Field("value", "float", meaning="as it stands after that tick"),
        ),
        meaning="A parameter that has changed, as in ULog's own parameter messages.",
    )
    yield Topic(
        name="link",
        number=number + 2,
        fields=(
            *_HEAD,
            Field("loss", "float", meaning="fraction of the autopilot's frames that were lost"),
            Field("round_trip_s", "float", meaning="to the autopilot and back; NaN: not measured"),
            Field("frames", "uint32_t", meaning="good frames from the autopilot's link so far"),
            Field("bad_checksums", "uint32_t", meaning="frames with a wrong checksum so far"),
            Field("unsent", "uint32_t", meaning="frames that the links did not take so far"),
            Field("late", "uint32_t", meaning="ticks that began late so far"),
            Field("skipped", "uint32_t", meaning="periods without a tick so far"),
            Field("over_run", "uint32_t", meaning="ticks longer than their period so far"),
            Field("worst_late_s", "float", meaning="the latest tick so far"),
        ),
        meaning="Counters of the link and of the loop's timing, every two seconds.",
    )
    slow = [_field(leaf, exact=False) for leaf in _SLOW_OUTPUTS]
    yield Topic(
        name="slow",
        number=number + 3,
        fields=(*_HEAD, *slow),
        meaning="Those outputs of a tick that change slowly: one row every eighth tick. A replay"
        " gives them for every tick.",
    )


TOPICS: Final[dict[str, Topic]] = {topic.name: topic for topic in _topics()}


def unit_of(field: Field) -> str:
    """The unit of a field; "" for a pure number."""
    for suffix, unit in SUFFIXES:
        if field.name.endswith(suffix):
            return unit
    if field.kind not in ("float", "double"):
        return UNITS.get(field.name, "")
    if field.name in UNITS:
        return UNITS[field.name]
    return next((u for begin, u in UNITS.items() if field.name.startswith(begin)), "")


def frame_of(field: Field) -> str:
    """The frame of a field, where it has one."""
    name = field.name
    if name.endswith(("_ok", "time_s", "sequence", "_age_s")):
        return ""
    if "_frd" in name:
        return "FRD"
    owner = field.owner.partition(".")[0]
    spatial = re.search(r"_(m|mps|mps2|rad|radps)$", name) is not None
    if owner in FRAMES:
        return FRAMES[owner] if spatial else ""
    return "soaring" if spatial and name.startswith(("line_", "heading", "setpoints_")) else ""


def flattener(leaves: tuple[Leaf, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """A function from the tuple of tuples to its numbers, as fast as Python can say it."""
    made: Callable[[Any], tuple[Any, ...]] = eval(f"lambda t: ({expression(leaves, 't')},)")
    return made


def expression(leaves: tuple[Leaf, ...], variable: str) -> str:
    """The leaves of a variable as arguments; a tuple in it is fetched once and named:
    `t[0], (t_4 := t[4])[0], t_4[1]`."""
    made: list[str] = []
    named: set[str] = set()
    for leaf in leaves:
        inside, _, last = leaf.place[:-1].rpartition("[")
        name = variable + "".join(f"_{i}" for i in re.findall(r"\d+", inside))
        made.append(
            f"{name}[{last}]"
            if name in named or not inside
            else f"({name} := {variable}{inside})[{last}]"
        )
        named.add(name)
    return ", ".join(made)


@cache
def packer(name: str) -> Callable[..., None]:
    """A function that puts a record of a topic into a buffer.

    `(buffer, offset, timestamp, tick, *rest)`, where `rest` is `(inputs, output)` for "tick",
    `(tuple,)` for a stream, `(output,)` for "slow", `(reset, state)` for "state", and the
    numbers for the others.
    """
    from struct import Struct

    topic = TOPICS[name]
    record = Struct("<HBH" + topic.layout[1:])
    if name == "tick":
        given = "i, o"
        numbers = f"{expression(_PLAIN_INPUTS, 'i')}, {expression(_OUTPUTS, 'o')}"
    elif name == "slow":
        given, numbers = "o", expression(_SLOW_OUTPUTS, "o")
    elif name == "state":
        given, numbers = "reset, t", f"reset, {expression(topic.leaves, 't')}"
    elif topic.source is not None:
        given, numbers = "t", expression(topic.leaves, "t")
    else:
        given = numbers = "*numbers"
    head = f"{record.size - 3}, 68, {topic.number}, timestamp, tick"
    text = f"lambda b, at, timestamp, tick, {given}: pack(b, at, {head}, {numbers})"
    made: Callable[..., None] = eval(text, {"pack": record.pack_into})
    return made


def rows_type(name: str) -> list[tuple[str, str]]:
    """A record of a topic as numpy's structured types have it."""
    fields = [(field.name, "<" + field.code) for field in TOPICS[name].fields]
    return [("record_size", "<u2"), ("record_kind", "u1"), ("record_topic", "<u2"), *fields]


def record_size(name: str) -> int:
    """Bytes of a record of a topic."""
    from struct import calcsize

    return 5 + calcsize(TOPICS[name].layout)
