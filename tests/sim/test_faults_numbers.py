"""Every number of the catalogue: what may be written, what it is when left out, what is drawn."""

from __future__ import annotations

from random import Random

import pytest

from tgl_soar.sim.faults import (
    CATALOGUE,
    FIRMWARE_SENSORS,
    FaultError,
    catalogue_text,
    drawn_fault,
    parse_fault,
)

PASSING = ("position", "attitude", "imu", "airspeed", "all", "link")
SENSORS = ("position", "attitude", "imu", "airspeed")
WAYS = ("dropout", "delay", "jitter", "reorder", "duplicate", "loss")
SURFACES = ("elevator", "aileron", "rudder", "brake")
# A campaign's flight engages within 5 s and ends at 30: all begins and most ends within it.
START = "start 10 s in 0..1e+06 drawn 5..11"


def lasts(default: str, drawn: str) -> str:
    return f"for {default} s in 0..1e+06 drawn {drawn}"


def fraction(default: str, drawn: str) -> str:
    return f"fraction {default} in 0..1 drawn {drawn}"


def later(default: str, drawn: str) -> str:
    return f"by {default} s in 0..10 drawn {drawn}"


def error(unit: str, axes: tuple[str, ...], usual: float) -> dict[str, list[str]]:
    """A constant on the first axis by default; noise of half of it."""
    unit = f"{unit} in"
    offsets = [
        f"{axis} {usual if i == 0 else 0:g} {unit} -1000..1000 drawn -{usual:g}..{usual:g}"
        for i, axis in enumerate(axes)
    ]
    sigma = f"sigma {usual / 2:g} {unit} 0..1000 drawn {usual / 20:g}..{usual:g}"
    lasting = lasts("2", "0.1..6")
    return {"bias": [lasting, *offsets], "noise": [lasting, sigma]}


LASTING = lasts("3", "0.5..6")
SERVO = lasts("2", "0.1..5")
# Gaps: the attitude is missed within tenths of a second, the position within seconds.
GAPS = {
    **dict.fromkeys(("position", "imu", "airspeed"), lasts("1", "0.05..3")),
    **dict.fromkeys(("attitude", "all"), lasts("0.2", "0.02..1")),
}
DECLARED: dict[str, list[str]] = {
    **{f"{of}.dropout": [gap] for of, gap in GAPS.items()},
    **{f"{of}.delay": [LASTING, later("0.1", "0.01..0.3")] for of in PASSING},
    **{f"{of}.jitter": [LASTING, later("0.05", "0.01..0.2")] for of in PASSING},
    **{
        f"{of}.reorder": [LASTING, fraction("0.2", "0.05..0.5"), later("0.05", "0.01..0.2")]
        for of in PASSING
    },
    **{
        f"{of}.duplicate": [LASTING, fraction("0.3", "0.05..1"), later("0.02", "0..0.1")]
        for of in PASSING
    },
    **{f"{of}.loss": [LASTING, fraction("0.2", "0.02..0.6")] for of in PASSING},
    **{f"{of}.freeze": [lasts("2", "0.05..4")] for of in (*SENSORS, "rangefinder")},
    **{
        f"{of}.nan": [lasts("2", "0.05..4"), fraction("0.5", "0.02..1")]
        for of in (*SENSORS, "rangefinder")
    },
    **{
        f"{of}.{way}": numbers
        for of, unit, axes, usual in (
            ("position", "m", ("north", "east", "down"), 0.4),
            ("attitude", "deg", ("roll", "pitch", "heading"), 8.0),
            ("imu", "m/s²", ("x", "y", "z"), 2.0),
            ("airspeed", "m/s", ("ahead",), 2.0),
            ("rangefinder", "m", ("away",), 2.0),
        )
        for way, numbers in error(unit, axes, usual).items()
    },
    "rangefinder.dropout": [lasts("3", "0.5..10")],
    # 0.2° of tilt are 0.03 m/s², and EKF3 says after 7 s that it has no fixes.
    "position.reckoned": [
        lasts("15", "1..30"),
        "north 0.03 m/s² in -10..10 drawn -0.04..0.04",
        "east 0 m/s² in -10..10 drawn -0.04..0.04",
        "reported 7 s in 0..1e+06 drawn 5..10",
    ],
    **{f"{surface}.stuck": [SERVO] for surface in SURFACES},
    **{f"{s}.slow": [SERVO, "rate 1 1/s in 0.01..100 drawn 0.2..4"] for s in SURFACES},
    "brake.one_side": [SERVO, "roll 0.17 in -2..2 drawn -0.3..0.3"],
    "transmitter.silent": [lasts("3", "0.5..10")],
    "transmitter.failsafe": [lasts("3", "0.5..10")],
    "station.silent": [lasts("10", "5..30")],
    "link.corrupt": [LASTING, fraction("0.2", "0.02..0.6")],
    "link.down": [lasts("0.3", "0.02..4")],
    "link.up": [lasts("0.3", "0.02..2")],
    "air.gust": [
        "for 1 s in 0.01..1e+06 drawn 0.3..3",  # one that lasts no time is none
        "along 1 m/s in -30..30 drawn -2..2",
        "across 0 m/s in -30..30 drawn -1..1",
        "up 0 m/s in -30..30 drawn -1..1",
    ],
    "air.stop": [
        lasts("2", "0.2..6"),
        "to 0.5 in 0..2 drawn 0..0.95",
        "over 1 s in 0.05..1000 drawn 0.2..2",
    ],
    "autopilot.reboot": [lasts("1.5", "0.2..3")],
    "autopilot.second": [lasts("2", "0.1..6")],
    "pilot.takes": [lasts("5", "0.5..6")],
}


def off(unit: str, usual: float, *axes: str) -> list[str]:
    return [lasts("5", "1..30")] + [
        f"{axis} {usual if i == 0 else 0:g} {unit} in -10000..10000 drawn -{usual:g}..{usual:g}"
        for i, axis in enumerate(axes)
    ]


OF_SENSORS: dict[str, list[str]] = {
    **{f"{of}.silent": off("", 0.0) for of in ("satellites", "barometer", "compass")},
    "satellites.lost": off("", 0.0),
    "satellites.bias": off("m", 3.0, "north", "east", "down"),
    "barometer.drift": off("m/s", 0.02, "by"),
    "compass.bias": off("mG", 60.0, "x", "y", "z"),
    "accelerometer.bias": off("m/s²", 3.0, "x", "y", "z"),
}
NUMBERS = [(kind, number) for kind, numbers in DECLARED.items() for number in (START, *numbers)]


class _Ends(Random):
    """Draws one end of every range."""

    def __init__(self, end: int) -> None:
        super().__init__(1)
        self._end = end

    def uniform(self, a: float, b: float) -> float:
        return (a, b)[self._end]


def ends(text: str) -> tuple[float, float]:
    low, high = text.split("..")
    return float(low), float(high)


def test_the_catalogue_has_these_faults_and_no_others() -> None:
    assert sorted(CATALOGUE) == sorted(DECLARED)


def test_no_campaign_draws_a_fault_of_a_firmwares_sensors() -> None:
    assert sorted(FIRMWARE_SENSORS) == sorted(OF_SENSORS)
    assert not FIRMWARE_SENSORS.keys() & CATALOGUE.keys()
    for name, numbers in OF_SENSORS.items():
        fault = parse_fault(name)
        assert list(fault.values) == [number.split()[0] for number in (START, *numbers)]
        assert fault.kind.what.endswith("(PX4 only)")


@pytest.mark.parametrize(("kind", "declared"), NUMBERS)
def test_a_number_is_taken_within_its_range_alone_and_drawn_within_less(
    kind: str, declared: str
) -> None:
    named, rest = declared.split(" in ")
    allowed, drawn = rest.split(" drawn ")
    name, default, *unit = named.split()
    assert parse_fault(kind)[name] == float(default)
    low, high = ends(allowed)
    for value in (low, high):
        assert parse_fault(f"{kind} {name}={value}")[name] == value
    says = f"must be a number from {low:g} to {high:g} {' '.join(unit)}".rstrip()
    for beyond in (low - 1e-3, high * 1.001):
        with pytest.raises(FaultError, match=f"{kind}: {name} = ") as caught:
            parse_fault(f"{kind} {name}={beyond!r}")
        assert str(caught.value).endswith(says)
    for end, value in enumerate(ends(drawn)):
        assert drawn_fault(CATALOGUE[kind], _Ends(end))[name] == value


@pytest.mark.parametrize("kind", sorted(DECLARED))
def test_a_fault_has_no_number_beside_these_and_in_this_order(kind: str) -> None:
    names = [number.split()[0] for number in (START, *DECLARED[kind])]
    assert list(parse_fault(kind).values) == names
    assert len(parse_fault(kind).offsets) == len(names) - 2


def test_a_draw_is_written_to_a_thousandth() -> None:
    drawn = drawn_fault(CATALOGUE["position.bias"], Random(3))
    assert all(value == round(value, 3) for value in drawn.values.values())
    assert any(value != round(value, 2) for value in drawn.values.values())


def test_the_catalogue_prints_each_fault_with_its_numbers_and_their_units() -> None:
    head, hint, *lines = catalogue_text().splitlines()
    assert "NAME start=10 for=1.5" in head
    assert "position.*" in hint
    assert [line.split()[0] for line in lines] == [*CATALOGUE, *FIRMWARE_SENSORS]
    for line in lines:
        kind = line.split()[0]
        assert {**CATALOGUE, **FIRMWARE_SENSORS}[kind].what in line
        shown = line[line.rindex("(") + 1 : -1].split(", ")
        numbers = {**DECLARED, **OF_SENSORS}[kind]
        declared = (number.split(" in ")[0].split() for number in (START, *numbers))
        assert shown == [" ".join((f"{name}={value}", *unit)) for name, value, *unit in declared], (
            kind
        )


def test_numbers_are_words_of_what_happens_to_what() -> None:
    fault = parse_fault("brake.one_side start=2 for=3 roll=-0.5")
    assert (fault.of, fault.way, fault.offsets) == ("brake", "one_side", (-0.5,))
    assert str(fault) == "brake.one_side start=2 for=3 roll=-0.5"
    assert (fault["roll"], fault.start_s, fault.end_s) == (-0.5, 2.0, 5.0)


def test_at_most_three_names_near_a_mistake_are_named_and_none_where_none_is() -> None:
    with pytest.raises(FaultError, match="near it: ") as caught:
        parse_fault("position.nois")
    near = str(caught.value).split("near it: ")[1].split(";")[0].split(", ")
    assert near[0] == "position.noise"
    assert len(near) == 3
    with pytest.raises(FaultError) as caught:
        parse_fault("zzzzzz")
    assert "near" not in str(caught.value)
