"""Ground stations' parameter files: what is written reads back, what is bad is named."""

from contextlib import suppress
from pathlib import Path
from typing import Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.mavparm import MAVParmDict

from tgl_soar.config.parameter_files import (
    Format,
    ParameterFileError,
    format_of,
    read_file,
    read_text,
    shortest,
    written,
)
from tgl_soar.config.parameters import PARAMETERS, ParameterError, ParameterSet, as_wire_value

IN_FILES = [p for p in PARAMETERS if p.in_files]
QGC: Final = "qgroundcontrol"
MAVPROXY: Final = "mavproxy"
FORMATS: tuple[Format, ...] = (QGC, MAVPROXY)


@st.composite
def parameter_sets(draw: st.DrawFn) -> ParameterSet:
    """Any valid set: changes in any order, those that contradict what stands left out."""
    values = ParameterSet()
    for p in draw(st.lists(st.sampled_from(IN_FILES), max_size=12)):
        value = draw(
            st.integers(int(p.minimum), int(p.maximum)).map(float)
            if p.integer
            else st.floats(p.minimum, p.maximum, allow_subnormal=False)
        )
        try:
            values = values.changed({p.name: value})
        except ParameterError:
            continue
    return values


def rows(values: ParameterSet) -> list[tuple[str, float]]:
    return [(p.name, value) for p, value in values if p.in_files]


@pytest.mark.parametrize("form", FORMATS)
@given(values=parameter_sets())
def test_what_is_written_reads_back_exactly(form: Format, values: ParameterSet) -> None:
    read = read_text(written(rows(values), form), "f")
    assert read.notes == ()
    assert ParameterSet().changed(read.values) == values


@given(st.floats(-1e6, 1e6, width=32))
def test_the_short_decimal_is_the_same_float(value: float) -> None:
    text = shortest(value)
    assert as_wire_value(float(text)) == value
    assert len(text) <= 15
    if value:
        digits = text.partition("e")[0].replace(".", "").replace("-", "").lstrip("0")
        assert len(digits) <= 9


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.1, "0.1"),
        (123.456, "123.456"),
        (1234.567, "1234.567"),
        (98.76543, "98.76543"),  # by eight digits 98.765427
        (1.0 / 3.0, "0.33333334"),
    ],
)
def test_no_more_digits_are_written_than_tell_the_value(value: float, text: str) -> None:
    """Of six, seven and eight the first that reads back as the same 32-bit float."""
    wire = as_wire_value(value)
    assert shortest(wire) == text
    fewer = len(text.replace("0.", "").replace(".", "")) - 1
    assert fewer < 6 or as_wire_value(float(f"{wire:.{fewer}g}")) != wire


def test_the_rows_are_those_of_each_ground_station() -> None:
    values = [("TGL_X", as_wire_value(0.1)), ("LOOP_RATE", 200.0)]
    assert written(values, MAVPROXY) == "TGL_X            0.1\nLOOP_RATE        200\n"
    assert written(values, QGC, system=3).splitlines() == [
        "# Onboard parameters for Vehicle 3",
        "#",
        "# Vehicle-Id Component-Id Name Value Type",
        "3\t191\tTGL_X\t0.1\t9",
        "3\t191\tLOOP_RATE\t200\t9",
    ]
    vehicle, *_, row = written(values, QGC).splitlines()  # the first one by default
    assert vehicle == "# Onboard parameters for Vehicle 1"
    assert row == "1\t191\tLOOP_RATE\t200\t9"


def test_pymavlink_reads_what_we_write_and_we_what_it_writes(tmp_path: Path) -> None:
    """MAVProxy's `param load` and `param save`."""
    values = ParameterSet().changed({"RHO_P": 0.73, "TGL_X": -1.25, "LOOP_RATE": 150.0})
    ours, theirs = tmp_path / "ours.parm", tmp_path / "theirs.parm"
    ours.write_text(written(rows(values), MAVPROXY))
    known = MAVParmDict()
    assert known.load(str(ours))
    assert {name: as_wire_value(v) for name, v in known.items()} == dict(rows(values))
    known.save(str(theirs))
    assert ParameterSet().changed(read_file(theirs).values) == values


def test_comments_other_components_and_what_no_file_sets_are_passed_over_and_reported() -> None:
    text = (
        "# Onboard parameters for Vehicle 1\r\n"
        "\r\n"
        "1\t1\tARSPD_FBW_MIN\t9\t9\r\n"
        "1\t1\tTGL_X\t7\t9\r\n"
        "1\t191\tTGL_X\t0.25\t9\r\n"
        "TGL_Z,1.5   # Mission Planner\n"
        "RHO_P 0.5\n"
        "OP_ENGAGE 1\n"
        "TGL_STAGE 1\n"
        "SYSID_THISMAV 1\n"
        "RHO_P 0.6"
    )
    read = read_text(text, "x.parm")
    assert read.values == {"TGL_X": 0.25, "TGL_Z": 1.5, "RHO_P": as_wire_value(0.6)}
    assert read.notes == (
        "x.parm:8: OP_ENGAGE: never set from a file: passed over",
        "x.parm:9: TGL_STAGE: never set from a file: passed over",
        "x.parm:10: SYSID_THISMAV: no such parameter here: passed over",
        "x.parm:11: RHO_P: given before: the last one counts",
        "x.parm: 2 rows of component 1: passed over",
    )


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        ("TGL_X", "neither `NAME VALUE` nor"),
        ("1 191 TGL_X 0.5", "neither"),
        ("1 191 TGL_X 0.5 9 9", "neither"),
        ("TGL_X zero", "TGL_X = zero: not a number"),
        ("TGL_X 1_0", "TGL_X = 1_0: not a number"),
        ("TGL_X nan", "not a number"),
        ("TGL_X 0x10", "not a number"),
        ("TGL_X 1e999", "TGL_X = inf: not finite"),
        ("TGL_X 501", "TGL_X = 501: allowed -500 to 500 m"),
        ("LOOP_RATE 150.5", "whole numbers only"),
        ("one\t191\tTGL_X\t1\t9", "'one': system, component and type are whole numbers"),
    ],
)
def test_every_bad_line_is_named(line: str, reported: str) -> None:
    with pytest.raises(ParameterFileError) as caught:
        read_text(f"# first\n{line}\nRHO_P 99\nTGL_Z 1", "dir/f.params")
    first, second = str(caught.value).splitlines()
    assert first.startswith("dir/f.params:2: ")
    assert reported in first
    assert second.startswith("dir/f.params:3: RHO_P = 99: allowed")
    lenient = read_text(f"# first\n{line}\nTGL_Z 1", "f", strict=False)
    assert lenient.values == {"TGL_Z": 1.0}
    assert lenient.notes[0].endswith("passed over")


def test_a_file_of_bad_lines_is_reported_briefly() -> None:
    with pytest.raises(ParameterFileError) as caught:
        read_text("x\n" * 1000, "f")
    assert len(str(caught.value).splitlines()) == 21
    assert str(caught.value).endswith("\nand 980 lines more")
    with pytest.raises(ParameterFileError) as caught:
        read_text("x\n" * 21, "f")
    assert str(caught.value).endswith("\nand 1 lines more")
    with pytest.raises(ParameterFileError) as caught:
        read_text("x\n" * 20, "f")
    lines = str(caught.value).splitlines()
    assert (len(lines), lines[-1][:5]) == (20, "f:20:")


@given(st.text(max_size=300))
@example("\x00\ufeff#")
@example("TGL_X \u0663")
def test_any_text_is_read_or_refused(text: str) -> None:
    with suppress(ParameterFileError):
        read_text(text, "f")
    read_text(text, "f", strict=False)


word = st.one_of(
    st.sampled_from([p.name for p in PARAMETERS]),
    st.sampled_from(["1", "191", "9", "#", ",", "-0", "1e400", "TGL_"]),
    st.floats().map(str),
    st.text(max_size=6),
)


@given(st.lists(st.lists(word, max_size=6).map(" ".join), max_size=6).map("\n".join))
def test_anything_like_a_file_is_read_or_refused(text: str) -> None:
    try:
        values = read_text(text, "f").values
    except ParameterFileError:
        return
    assert all(as_wire_value(value) == value for value in values.values())


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.parm"
    path.write_bytes(data)
    with suppress(ParameterFileError):
        read_file(path)


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.parm", tmp_path, Path("a\0b")):
        with pytest.raises(ParameterFileError, match="cannot be read"):
            read_file(path)
    huge = tmp_path / "huge.parm"
    huge.write_bytes(b"#" * 1_000_001)
    with pytest.raises(ParameterFileError, match="too long"):
        read_file(huge)
    huge.write_bytes(b"#" * 1_000_000)
    assert read_file(huge).values == {}


def test_the_name_of_a_file_tells_its_format() -> None:
    assert format_of(Path("a.parm")) == format_of(Path("a.PARAM")) == MAVPROXY
    assert format_of(Path("a.params")) == format_of(Path("a")) == QGC
