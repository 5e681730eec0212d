"""What can go wrong: every fault by name, with its numbers, units and ranges, declared once.

    position.dropout start=20 for=1.5

reads: from 20 s on nothing arrives of the position for 1.5 s.  A number that is left out has
the default that the catalogue names.  `sim.injection` shows how each of them acts.

The same text stands behind `--fault`, in scenario files and in the table of a campaign.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite
from random import Random
from typing import Final, NamedTuple


class FaultError(ValueError):
    """A fault that is not in the catalogue; the message says what is."""


class Number(NamedTuple):
    """One number of a fault: its range, and from where a campaign draws it."""

    name: str
    unit: str
    low: float
    high: float
    default: float
    drawn: tuple[float, float]
    what: str

    @property
    def allowed(self) -> str:
        """The range, in words."""
        return f"a number from {self.low:g} to {self.high:g} {self.unit}".rstrip()


class FaultKind(NamedTuple):
    """One fault of the catalogue."""

    name: str  # of what, and what becomes of it
    what: str
    numbers: tuple[Number, ...]


@dataclass(frozen=True)
class Fault:
    """One fault of one flight."""

    kind: FaultKind
    values: Mapping[str, float]

    def __getitem__(self, number: str) -> float:
        return self.values[number]

    @property
    def of(self) -> str:
        """What it happens to."""
        return self.kind.name.partition(".")[0]

    @property
    def way(self) -> str:
        """What becomes of it."""
        return self.kind.name.partition(".")[2]

    @property
    def start_s(self) -> float:
        """When it begins."""
        return self.values["start"]

    @property
    def end_s(self) -> float:
        """When it is over."""
        return self.values["start"] + self.values["for"]

    @property
    def offsets(self) -> tuple[float, ...]:
        """Its numbers beside start and duration, in the catalogue's order."""
        return tuple(self.values.values())[2:]

    def acts(self, time_s: float) -> bool:
        """Whether it acts at a time."""
        return self.start_s <= time_s < self.end_s

    def __str__(self) -> str:
        numbers = (f"{name}={value:g}" for name, value in self.values.items())
        return " ".join((self.kind.name, *numbers))


# --- the catalogue ---------------------------------------------------------------------------

_LONGEST_S: Final = 1e6
_START: Final = Number(
    name="start",
    unit="s",
    low=0.0,
    high=_LONGEST_S,
    default=10.0,
    drawn=(5.0, 11.0),
    what="when it begins",
)


def _for(default: float, low: float, high: float) -> Number:
    return Number(
        name="for",
        unit="s",
        low=0.0,
        high=_LONGEST_S,
        default=default,
        drawn=(low, high),
        what="how long it lasts",
    )


def _fraction(default: float, low: float, high: float) -> Number:
    return Number(
        name="fraction",
        unit="",
        low=0.0,
        high=1.0,
        default=default,
        drawn=(low, high),
        what="of all that passes",
    )


def _by(unit: str, largest: float, default: float, low: float, high: float, what: str) -> Number:
    return Number(
        name="by",
        unit=unit,
        low=-largest,
        high=largest,
        default=default,
        drawn=(low, high),
        what=what,
    )


def _late(default: float, low: float, high: float, what: str) -> Number:
    return Number(
        name="by", unit="s", low=0.0, high=10.0, default=default, drawn=(low, high), what=what
    )


# What passes on a way, and what can become of anything that passes.
_PASSING: Final = {
    "position": "positions",
    "attitude": "attitudes",
    "imu": "accelerations and rates",
    "airspeed": "airspeeds",
    "all": "measurements",
    "link": "datagrams of both directions",
}
_GAP_S: Final = {"attitude": _for(0.2, 0.02, 1.0), "all": _for(0.2, 0.02, 1.0)}


def _ways(of: str, passing: str) -> list[FaultKind]:
    lasting = _for(3.0, 0.5, 6.0)
    kinds = []
    if of != "link":
        gap = _GAP_S.get(of, _for(1.0, 0.05, 3.0))
        kinds.append(FaultKind(f"{of}.dropout", f"no {passing} arrive", (_START, gap)))
    kinds += [
        FaultKind(
            f"{of}.delay",
            f"{passing} arrive later",
            (_START, lasting, _late(0.1, 0.01, 0.3, "later than they would")),
        ),
        FaultKind(
            f"{of}.jitter",
            f"{passing} arrive later, each by a time of its own",
            (_START, lasting, _late(0.05, 0.01, 0.2, "at most")),
        ),
        FaultKind(
            f"{of}.reorder",
            f"some {passing} are overtaken by later ones",
            (_START, lasting, _fraction(0.2, 0.05, 0.5), _late(0.05, 0.01, 0.2, "overtaken by")),
        ),
        FaultKind(
            f"{of}.duplicate",
            f"some {passing} arrive twice",
            (_START, lasting, _fraction(0.3, 0.05, 1.0), _late(0.02, 0.0, 0.1, "the second later")),
        ),
        FaultKind(
            f"{of}.loss",
            f"some {passing} never arrive",
            (_START, lasting, _fraction(0.2, 0.02, 0.6)),
        ),
    ]
    return kinds


def _lies(of: str, passing: str) -> list[FaultKind]:
    lasting = _for(2.0, 0.05, 4.0)
    return [
        FaultKind(
            f"{of}.freeze", f"{passing} repeat one value under new stamps", (_START, lasting)
        ),
        FaultKind(
            f"{of}.nan",
            f"some {passing} are not numbers",
            (_START, lasting, _fraction(0.5, 0.02, 1.0)),
        ),
    ]


def _errors(
    of: str, passing: str, unit: str, axes: tuple[str, ...], usual: float
) -> list[FaultKind]:
    largest = 1e3
    lasting = _for(2.0, 0.1, 6.0)
    offsets = tuple(
        Number(
            name=axis,
            unit=unit,
            low=-largest,
            high=largest,
            default=usual if i == 0 else 0.0,
            drawn=(-usual, usual),
            what="added to it",
        )
        for i, axis in enumerate(axes)
    )
    sigma = Number(
        name="sigma",
        unit=unit,
        low=0.0,
        high=largest,
        default=0.5 * usual,
        drawn=(0.05 * usual, usual),
        what="standard deviation",
    )
    return [
        FaultKind(f"{of}.bias", f"{passing} are off by a constant", (_START, lasting, *offsets)),
        FaultKind(
            f"{of}.noise", f"{passing} have noise, the same on each axis", (_START, lasting, sigma)
        ),
    ]


_SERVO_FOR: Final = _for(2.0, 0.1, 5.0)


def _servo(surface: str) -> list[FaultKind]:
    return [
        FaultKind(f"{surface}.stuck", f"the {surface} stays where it is", (_START, _SERVO_FOR)),
        FaultKind(
            f"{surface}.slow",
            f"the {surface} moves slowly",
            (
                _START,
                _SERVO_FOR,
                Number(
                    name="rate",
                    unit="1/s",
                    low=0.01,
                    high=100.0,
                    default=1.0,
                    drawn=(0.2, 4.0),
                    what="half-throws a second",
                ),
            ),
        ),
    ]


_OF_THE_BRAKE: Final = (
    *_servo("brake"),
    FaultKind(
        "brake.one_side",
        "one half of the brake stays where it is, and the other half works",
        (
            _START,
            _SERVO_FOR,
            # A spoiler of the shipped airframe, with half of its lift at 0.22 of the span from the
            # middle: 0.22 0.15 / 2 of rolling moment, by 0.0994 of a full aileron.
            Number(
                name="roll",
                unit="",
                low=-2.0,
                high=2.0,
                default=0.17,
                drawn=(-0.3, 0.3),
                what="aileron that rolls as much as the whole difference of both halves",
            ),
        ),
    ),
)

# What a real firmware answers with failsafes of its own.
_OF_A_FIRMWARE: Final = (
    FaultKind(
        "transmitter.silent",
        "the pilot's receiver has no signal and sends no pulses (real firmwares only)",
        (_START, _for(3.0, 0.5, 10.0)),
    ),
    FaultKind(
        "transmitter.failsafe",
        "the pilot's receiver has no signal: sticks centred, throttle low (real firmwares only)",
        (_START, _for(3.0, 0.5, 10.0)),
    ),
    FaultKind(
        "station.silent",
        "no message of any ground station arrives (real firmwares only)",
        (_START, _for(10.0, 5.0, 30.0)),
    ),
)


def _off(unit: str, usual: float, *axes: str) -> tuple[Number, ...]:
    """By how much a firmware's sensor is wrong, the first axis by so much where nothing is said."""
    return tuple(
        Number(
            name=axis,
            unit=unit,
            low=-1e4,
            high=1e4,
            default=usual if i == 0 else 0.0,
            drawn=(-usual, usual),
            what="added to it",
        )
        for i, axis in enumerate(axes)
    )


def _sensor(name: str, what: str, *numbers: Number) -> FaultKind:
    return FaultKind(name, f"{what} (PX4 only)", (_START, _for(5.0, 1.0, 30.0), *numbers))


_OF_ITS_SENSORS: Final[tuple[FaultKind, ...]] = (
    _sensor("satellites.lost", "the receiver reports that it has no fix"),
    _sensor("satellites.silent", "nothing of the receiver arrives"),
    _sensor("satellites.bias", "fixes are off", *_off("m", 3.0, "north", "east", "down")),
    _sensor("barometer.silent", "no pressures arrive"),
    _sensor("barometer.drift", "the barometer's height drifts", *_off("m/s", 0.02, "by")),
    _sensor("compass.silent", "nothing of the compass arrives"),
    _sensor("compass.bias", "its field is off", *_off("mG", 60.0, "x", "y", "z")),
    _sensor("accelerometer.bias", "specific force is off", *_off("m/s²", 3.0, "x", "y", "z")),
)


def _drift(axis: str, default: float) -> Number:
    return Number(
        name=axis,
        unit="m/s²",
        low=-10.0,
        high=10.0,
        default=default,
        drawn=(-0.04, 0.04),
        what="by which its accelerations are wrong",
    )


# g times a tilt that is 0.2 deg off is 0.03 m/s^2; EKF3 says so after 7 s.
_RECKONED: Final = FaultKind(
    "position.reckoned",
    "no fixes: the autopilot's estimator dead reckons, reports it late, and is reset at the end",
    (
        _START,
        _for(15.0, 1.0, 30.0),
        _drift("north", 0.03),
        _drift("east", 0.0),
        Number(
            name="reported",
            unit="s",
            low=0.0,
            high=_LONGEST_S,
            default=7.0,
            drawn=(5.0, 10.0),
            what="since it began, when it says so",
        ),
    ),
)

_RANGES: Final = "distances to the ground"

_KINDS: Final[tuple[FaultKind, ...]] = (
    _RECKONED,
    *_OF_THE_BRAKE,
    *_OF_A_FIRMWARE,
    *(kind for of, passing in _PASSING.items() for kind in _ways(of, passing)),
    *(
        kind
        for of, passing in _PASSING.items()
        if of not in ("link", "all")
        for kind in _lies(of, passing)
    ),
    *_errors("position", _PASSING["position"], "m", ("north", "east", "down"), 0.4),
    *_errors("attitude", _PASSING["attitude"], "deg", ("roll", "pitch", "heading"), 8.0),
    *_errors("imu", _PASSING["imu"], "m/s²", ("x", "y", "z"), 2.0),
    *_errors("airspeed", _PASSING["airspeed"], "m/s", ("ahead",), 2.0),
    *_lies("rangefinder", _RANGES),
    *_errors("rangefinder", _RANGES, "m", ("away",), 2.0),
    FaultKind("rangefinder.dropout", f"no {_RANGES} arrive", (_START, _for(3.0, 0.5, 10.0))),
    FaultKind(
        "link.corrupt",
        "bits of some datagrams of both directions are inverted",
        (_START, _for(3.0, 0.5, 6.0), _fraction(0.2, 0.02, 0.6)),
    ),
    FaultKind("link.down", "nothing of the autopilot arrives", (_START, _for(0.3, 0.02, 4.0))),
    FaultKind("link.up", "nothing arrives at the autopilot", (_START, _for(0.3, 0.02, 2.0))),
    *(kind for surface in ("elevator", "aileron", "rudder") for kind in _servo(surface)),
    FaultKind(
        "air.gust",
        "a gust of 1 − cos in all of the air",
        (
            _START,
            Number(
                name="for",
                unit="s",
                low=0.01,
                high=_LONGEST_S,
                default=1.0,
                drawn=(0.3, 3.0),
                what="how long it lasts",
            ),
            Number(
                name="along",
                unit="m/s",
                low=-30.0,
                high=30.0,
                default=1.0,
                drawn=(-2.0, 2.0),
                what="at most, downstream",
            ),
            Number(
                name="across",
                unit="m/s",
                low=-30.0,
                high=30.0,
                default=0.0,
                drawn=(-1.0, 1.0),
                what="at most, to the right",
            ),
            Number(
                name="up",
                unit="m/s",
                low=-30.0,
                high=30.0,
                default=0.0,
                drawn=(-1.0, 1.0),
                what="at most, upwards",
            ),
        ),
    ),
    FaultKind(
        "air.stop",
        "the wind falls to a fraction of itself, and comes back",
        (
            _START,
            _for(2.0, 0.2, 6.0),
            Number(
                name="to",
                unit="",
                low=0.0,
                high=2.0,
                default=0.5,
                drawn=(0.0, 0.95),
                what="share of the wind",
            ),
            Number(
                name="over",
                unit="s",
                low=0.05,
                high=1e3,
                default=1.0,
                drawn=(0.2, 2.0),
                what="time to fall, and to rise",
            ),
        ),
    ),
    FaultKind(
        "autopilot.reboot",
        "the autopilot restarts: silent, then without memory",
        (_START, _for(1.5, 0.2, 3.0)),
    ),
    FaultKind(
        "autopilot.second",
        "another autopilot with the same system id sends, from elsewhere",
        (_START, _for(2.0, 0.1, 6.0)),
    ),
    FaultKind(
        "pilot.takes", "the pilot takes over by the mode switch", (_START, _for(5.0, 0.5, 6.0))
    ),
)

CATALOGUE: Final[dict[str, FaultKind]] = {kind.name: kind for kind in _KINDS}
# Of the sensors of a real firmware, which no campaign draws.
FIRMWARE_SENSORS: Final[dict[str, FaultKind]] = {kind.name: kind for kind in _OF_ITS_SENSORS}
_NAMED: Final = {**CATALOGUE, **FIRMWARE_SENSORS}


# --- faults from text, and by lot --------------------------------------------------------------


def parse_fault(text: str) -> Fault:
    """A fault as it is written: its name, then NAME=NUMBER.  Errors: `FaultError`."""
    name, *given = text.split() or [""]
    kind = _NAMED.get(name)
    if kind is None:
        near = get_close_matches(name, _NAMED, 3, 0.5)
        hint = f"; near it: {', '.join(near)}" if near else ""
        raise FaultError(f"no fault named {name!r}{hint}; `--fault list` shows all")
    values = {number.name: number.default for number in kind.numbers}
    allowed = {number.name: number for number in kind.numbers}
    for assignment in given:
        key, equals, number_text = assignment.partition("=")
        if not equals or key not in allowed:
            raise FaultError(f"{name}: {assignment!r}: it takes {', '.join(allowed)}, as for=1.5")
        values[key] = _checked(name, allowed[key], number_text)
    return Fault(kind, values)


def _checked(fault: str, number: Number, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not (isfinite(value) and number.low <= value <= number.high):
        raise FaultError(f"{fault}: {number.name} = {text!r}: must be {number.allowed}")
    return value


def parse_faults(texts: Iterable[str]) -> tuple[Fault, ...]:
    """Several faults.  Errors: `FaultError`."""
    return tuple(parse_fault(text) for text in texts)


def refusal(faults: Iterable[Fault], autopilot: str) -> str:
    """Which of them this autopilot's sensors cannot have, and why; "": they can have all."""
    of_sensors = [fault.kind.name for fault in faults if fault.kind.name in FIRMWARE_SENSORS]
    if autopilot == "px4" or not of_sensors:
        return ""
    return (
        f"{of_sensors[0]}: only a PX4 (--autopilot px4) reads sensors that the bridge can let fail;"
        " ArduPlane has SIM_… parameters for it (--autopilot-parameter NAME=NUMBER@SECONDS)"
    )


def drawn_fault(kind: FaultKind, random: Random) -> Fault:
    """A fault of a kind, with numbers drawn from where campaigns draw them."""
    return Fault(
        kind, {number.name: round(random.uniform(*number.drawn), 3) for number in kind.numbers}
    )


def catalogue_text() -> str:
    """The catalogue for a terminal."""
    lines = [
        "A fault is written NAME start=10 for=1.5, and more numbers where it has them.",
        "position.* acts on what the autopilot reports; on motion capture: --mocap-option fault=….",
    ]
    for kind in _NAMED.values():
        numbers = ", ".join(
            f"{n.name}={n.default:g}{' ' + n.unit if n.unit else ''}" for n in kind.numbers
        )
        lines.append(f"  {kind.name:<20} {kind.what} ({numbers})")
    return "\n".join(lines)
