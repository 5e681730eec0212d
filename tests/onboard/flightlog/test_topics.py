"""Topics and fields: the page that people read them by, and the bytes that programs read."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import numpy as np
import pytest

from tgl_soar.analysis.logs.meanings import meaning_of
from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.onboard.flightlog.topics import (
    STREAMS,
    TOPICS,
    VERSION,
    Field,
    Topic,
    expression,
    flattener,
    frame_of,
    is_named_tuple,
    leaves_of,
    packer,
    rebuilt,
    record_size,
    rows_type,
    unit_of,
)
from tgl_soar.types import Inputs

PAGE = Path(__file__).parents[3] / "docs/logs.md"
# Types of ULog's specification, with the bytes that each of them has.
BYTES = {
    "int8_t": 1, "uint8_t": 1, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
    "int64_t": 8, "uint64_t": 8, "float": 4, "double": 8, "bool": 1,
}  # fmt: skip
DATA = ord("D")  # the kind of a ULog's message with a row
HEAD = 5  # bytes before a row: its size, the message's kind, and the topic's number
STAMP_US, TICK = 12_345_678, 77


def rows_of_the_page() -> Iterator[tuple[str, list[str]]]:
    """(topic, cells) of each field that the page has."""
    topic = ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            topic = line.removeprefix("## ")
        elif topic in TOPICS and line.startswith("| `"):
            yield topic, [cell.strip() for cell in line[2:-2].split(" | ")]


PRINTED = list(rows_of_the_page())
FIELDS = [field for topic in TOPICS.values() for field in topic.fields]


# --- the page -------------------------------------------------------------------------------------


@pytest.mark.interpreted  # meanings are read from the source
@pytest.mark.parametrize("name", TOPICS)
def test_each_field_is_on_the_page_as_it_is_in_a_log(name: str) -> None:
    printed = [cells for topic, cells in PRINTED if topic == name]
    declared = [
        [f"`{f.name}`", f.kind, unit_of(f), frame_of(f), meaning_of(f)] for f in TOPICS[name].fields
    ]
    assert declared == printed
    assert len(printed) > 2


def test_a_log_names_the_layout_of_the_readers_that_there_are() -> None:
    """Logs of another number are refused (`ulog_reader`): it changes with what a column means."""
    assert VERSION == 2


def test_topics_are_numbered_in_their_order_and_none_is_missing() -> None:
    names = ["tick", *STREAMS, "state", "parameter", "link", "slow"]
    assert list(TOPICS) == names
    assert [topic.number for topic in TOPICS.values()] == list(range(len(names)))
    assert {name for name, hint in get_type_hints(Inputs).items() if is_named_tuple(hint)} == set(
        STREAMS
    )


@pytest.mark.parametrize("topic", TOPICS.values(), ids=lambda topic: topic.name)
def test_a_topic_begins_with_the_ticks_time_and_number_and_names_each_field_once(
    topic: Topic,
) -> None:
    names = [field.name for field in topic.fields]
    assert names[:2] == ["timestamp", "tick"]
    assert len(set(names)) == len(names)


def test_outputs_are_in_every_row_or_in_the_slow_ones_once() -> None:
    tick, slow = (
        {field.owner for field in TOPICS[name].fields if field.owner} for name in ("tick", "slow")
    )
    own = {leaf.owner for leaf in leaves_of(Output)}
    elsewhere = own - tick - slow  # of the output, what a row says by another column
    assert elsewhere == {
        "Output.time_s",
        "VehicleState.time_s",
        "ExcitationState.begun_s",
        "ExcitationState.amplitude_rad",
        "ExcitationState.limited_s",
        "LaunchLandingReport.launch",
        "GroundRange.bound_m",
        "GroundRange.refused",
    }


# --- what fits -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "size"), BYTES.items())
def test_a_field_has_a_type_of_ulog_s_in_its_width(kind: str, size: int) -> None:
    assert struct.calcsize("<" + Field("any", kind).code) == size
    assert {field.kind for field in FIELDS} <= set(BYTES)


def test_columns_that_number_modes_and_reasons_have_room_for_them() -> None:
    kinds = {field.name: field.kind for field in TOPICS["tick"].fields}
    assert len(MODE_NAMES) <= 256 ** BYTES[kinds["mode"]]
    assert len(REASON_TEXTS) <= 256 ** BYTES[kinds["reason"]]


def test_with_inputs_states_times_and_commands_a_flight_is_replayed_bit_for_bit() -> None:
    """In doubles, but for what the wire itself brings in single precision."""
    single = {"AttitudeSample", "ImuSample"}
    for name in (*STREAMS, "state"):
        for field in TOPICS[name].fields[2:]:
            brought = field.owner.partition(".")[0] in single
            if field.kind in ("float", "double"):
                exact = not brought or field.name.endswith("time_s")
                assert field.kind == ("double" if exact else "float"), field
    for field in TOPICS["tick"].fields:
        if field.kind in ("float", "double"):
            exact = field.name.endswith("time_s") or field.name.startswith("command_")
            assert field.kind == ("double" if exact else "float"), field


# --- units and frames -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [
        ("fall_m", "float", "m"),
        ("fall_mps", "float", "m/s"),
        ("fall_mps2", "float", "m/s²"),
        ("fall_s", "float", "s"),
        ("fall_per_s", "float", "1/s"),
        ("fall_ms", "float", "ms"),
        ("fall_us", "float", "µs"),
        ("fall_hz", "float", "Hz"),
        ("fall_rad", "float", "rad"),
        ("fall_radps", "float", "rad/s"),
        ("fall", "float", ""),
        ("soaring_p", "float", "rad"),
        ("elevator_p", "float", "of full travel"),
        ("rudder", "double", "of full travel"),
        ("rudder_saturated", "int8_t", ""),
        ("timestamp", "uint64_t", "µs"),
    ],
)
def test_a_unit_is_the_ending_of_a_name_or_that_of_its_law(name: str, kind: str, unit: str) -> None:
    assert unit_of(Field(name, kind)) == unit


@pytest.mark.parametrize(
    ("name", "owner", "frame"),
    [
        ("north_m", "PositionFix.north_m", "NED"),
        ("time_s", "PositionFix.time_s", ""),
        ("sequence", "PositionFix.sequence", ""),
        ("source", "PositionFix.source", ""),
        ("force_x_frd_mps2", "ImuSample.force_x_frd_mps2", "FRD"),
        ("vehicle_x_m", "VehicleState.x_m", "soaring"),
        ("line_x_m", "LineTracking.x_m", "soaring"),
        ("setpoints_heading_rad", "Setpoints.heading_rad", "soaring"),
        ("heading_setpoint_rad", "Loops.heading_setpoint_rad", "soaring"),
        ("margins_clearance_m", "Margins.clearance_m", ""),
        ("health_position_age_s", "VehicleState.position_age_s", ""),
        ("line_ok", "VehicleState.ok", ""),
        ("line_moving", "LineTracking.moving", ""),
    ],
)
def test_a_length_speed_or_angle_of_a_vector_has_its_frame(
    name: str, owner: str, frame: str
) -> None:
    assert frame_of(Field(name, "float", owner)) == frame


# --- tuples of tuples -----------------------------------------------------------------------------


class Inner(NamedTuple):
    """Nested once."""

    a_m: float
    b: bool


class Outer(NamedTuple):
    """Nested twice, with numbers that have no names."""

    first: int
    inner: Inner
    row: tuple[float, float]
    last: Inner


class Endless(NamedTuple):
    """The count of these numbers is unknown."""

    row: tuple[float, ...]


class Wordy(NamedTuple):
    """A word is no number."""

    word: str


OUTER = Outer(1, Inner(2.0, True), (3.0, 4.0), Inner(5.0, False))


def test_the_leaves_of_a_tuple_of_tuples_are_named_by_where_they_are() -> None:
    leaves = tuple(leaves_of(Outer))
    assert [leaf.name for leaf in leaves] == [
        "first", "inner_a_m", "inner_b", "row_0", "row_1", "last_a_m", "last_b",
    ]  # fmt: skip
    assert [leaf.owner for leaf in leaves[1:4]] == ["Inner.a_m", "Inner.b", "Outer.row"]
    assert [leaf.kind for leaf in leaves[:3]] == [int, float, bool]
    numbers = (1, 2.0, True, 3.0, 4.0, 5.0, False)
    assert flattener(leaves)(OUTER) == numbers
    assert tuple(eval(f"t{leaf.place}", {"t": OUTER}) for leaf in leaves) == numbers
    assert rebuilt(Outer, iter(numbers)) == OUTER


def test_a_tuple_inside_is_fetched_once_however_many_of_its_numbers_are_wanted() -> None:
    text = expression(tuple(leaves_of(Outer)), "t")
    assert text.count("t[1]") == text.count("t[2]") == text.count("t[3]") == 1
    names: dict[str, Any] = {"t": OUTER}
    assert eval(f"({text})", names) == (1, 2.0, True, 3.0, 4.0, 5.0, False)


@pytest.mark.parametrize(("kind", "field"), [(Endless, "Endless.row"), (Wordy, "Wordy.word")])
def test_what_is_no_fixed_count_of_numbers_is_refused(kind: type, field: str) -> None:
    with pytest.raises(TypeError, match=f"{field}: the log knows no "):
        list(leaves_of(kind))


def test_a_plain_tuple_is_no_named_one() -> None:
    assert is_named_tuple(Inner)
    assert not is_named_tuple(tuple)
    assert not is_named_tuple(tuple[float, float])
    assert not is_named_tuple(float)


# --- rows -----------------------------------------------------------------------------------------


def tree_leaves(value: Any) -> Iterator[Any]:
    """The numbers in a tuple of tuples, however it is nested."""
    if isinstance(value, tuple):
        for each in value:
            yield from tree_leaves(each)
    else:
        yield value


def by_place(topic: Topic, whole: Any) -> dict[str, Any]:
    """By column, what a tuple holds at the place where the column's tuple declares it."""
    kind = type(whole)
    owners = [(leaf.name, leaf.owner) for leaf in leaves_of(kind)]
    values = dict(zip(owners, tree_leaves(whole), strict=True))
    return {
        field.name: values[field.name, field.owner]
        for field in topic.fields
        if (field.name, field.owner) in values
    }


def filled(kind: type, start: int) -> Any:
    """A tuple of tuples whose numbers all differ and fit into a byte and a float."""
    return rebuilt(kind, (1 + (start + k) % 100 for k in count()))


def unpacked(name: str, *given: Any) -> dict[str, Any]:
    """What a reader finds in the row that a topic's packer writes."""
    size = record_size(name)
    buffer = bytearray(size + 7)
    packer(name)(buffer, 3, STAMP_US, TICK, *given)
    assert buffer[:3] == bytes(3)  # it is put where it was asked for
    row = bytes(buffer[3 : 3 + size])
    length, kind, number = struct.unpack_from("<HBH", row)
    assert (length, kind, number) == (size - 3, DATA, TOPICS[name].number)
    topic = TOPICS[name]
    at, found = HEAD, {}
    for field in topic.fields:
        (found[field.name],) = struct.unpack_from("<" + field.code, row, at)
        at += BYTES[field.kind]
    assert at == size
    (record,) = np.frombuffer(row, dtype=np.dtype(rows_type(name)))
    assert {field: record[field].item() for field in found} == pytest.approx(found)
    assert (record["record_size"], record["record_kind"]) == (size - 3, DATA)
    assert record["record_topic"] == topic.number
    assert (found.pop("timestamp"), found.pop("tick")) == (STAMP_US, TICK)
    return found


@pytest.mark.parametrize("start", [0, 37])
def test_a_row_of_a_tick_holds_its_plain_inputs_and_quick_outputs(start: int) -> None:
    inputs, output = filled(Inputs, start), filled(Output, start + 50)
    topic = TOPICS["tick"]
    wanted = {**by_place(topic, output), "time_s": inputs.time_s, "engage": inputs.engage}
    assert unpacked("tick", inputs, output) == pytest.approx(wanted)
    assert len(wanted) == len(topic.fields) - 2


def test_a_slow_row_holds_the_other_outputs() -> None:
    output = filled(Output, 11)
    wanted = by_place(TOPICS["slow"], output)
    assert unpacked("slow", output) == pytest.approx(wanted)
    assert len(wanted) == len(TOPICS["slow"].fields) - 2


def test_a_row_of_a_state_holds_all_of_it_and_whether_it_was_reset() -> None:
    state = filled(AutopilotState, 5)
    wanted = by_place(TOPICS["state"], state)
    for is_reset in (True, False):
        found = unpacked("state", is_reset, state)
        assert found.pop("reset") is is_reset
        assert found == wanted
    assert len(wanted) == sum(1 for _ in leaves_of(AutopilotState))
    columns = [field.name for field in TOPICS["state"].fields]
    order = ("time_s", "supervisor_mode", "motion_", "line_", "sideways_", "limited_", "wind_")
    first = [next(i for i, c in enumerate(columns) if c.startswith(begin)) for begin in order]
    assert first == sorted(first)


@pytest.mark.parametrize("name", STREAMS)
def test_a_row_of_an_input_holds_all_of_it(name: str) -> None:
    sample = filled(STREAMS[name], 3)
    assert list(unpacked(name, sample).values()) == list(tree_leaves(sample))


def test_a_row_of_plain_numbers_holds_them_in_their_order() -> None:
    assert list(unpacked("parameter", 3, 0.5).values()) == [3, 0.5]
    numbers = [0.25, 0.5, *range(3, 9), 0.125]
    assert list(unpacked("link", *numbers).values()) == numbers


def test_a_ulog_declares_a_topic_by_its_fields_in_order() -> None:
    topic = TOPICS["parameter"]
    assert topic.format == "parameter:uint64_t timestamp;uint32_t tick;uint16_t index;float value;"
    assert struct.calcsize(topic.layout) == record_size("parameter") - HEAD == 8 + 4 + 2 + 4
    assert topic.layout.startswith("<")  # ULog is little-endian
    assert list(islice(topic.fields, 2)) == list(TOPICS["tick"].fields[:2])
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", field.name) for field in FIELDS)
