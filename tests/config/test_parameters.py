"""Parameters: the declaration itself, and changes that are checked and take hold as one."""

from __future__ import annotations

import re
import struct
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.files import ConfigError, load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.line_changes import LineChanges
from tgl_soar.config.parameter_rules import RECOVERY_MIN_S
from tgl_soar.config.parameters import (
    INDEX,
    PARAMETERS,
    Parameter,
    ParameterError,
    ParameterSet,
    as_wire_value,
)
from tgl_soar.control.supervisor import CLEAR_S

NAMES = [p.name for p in PARAMETERS]
DEFAULTS = ParameterSet()
each = pytest.mark.parametrize("parameter", PARAMETERS, ids=NAMES)


def refusal(values: ParameterSet, changes: dict[str, float], flying: bool = False) -> str:
    """The message of a refused change, which has changed nothing."""
    before = {p.name: v for p, v in values}
    with pytest.raises(ParameterError) as caught:
        values.changed(changes, flying=flying)
    assert {p.name: v for p, v in values} == before
    assert str(caught.value) == f"{caught.value.name} = {caught.value.value}: {caught.value.reason}"
    return str(caught.value)


NOT_REFUSED = ParameterError("", 0, "")


def attempt(changes: dict[str, float]) -> tuple[ParameterSet | None, ParameterError]:
    """The changed defaults, or why not."""
    try:
        return DEFAULTS.changed(changes), NOT_REFUSED
    except ParameterError as error:
        return None, error


# --- the declaration ------------------------------------------------------------------------


@each
def test_a_name_fits_the_wire_and_has_a_prefix(parameter: Parameter) -> None:
    assert len(parameter.name.encode("ascii")) <= 16
    assert re.fullmatch(r"[A-Z]+(_[A-Z]+)+", parameter.name)


def test_names_are_unique() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert [PARAMETERS[i].name for i in INDEX.values()] == list(INDEX) == NAMES


@each
def test_a_declaration_is_whole(parameter: Parameter) -> None:
    assert parameter.minimum < parameter.maximum
    assert parameter.minimum <= parameter.default <= parameter.maximum
    assert parameter.meaning.endswith(".")
    if parameter.integer:
        assert parameter.default == int(parameter.default)


def test_the_defaults_agree_with_each_other() -> None:
    assert DEFAULTS.changed({}) == DEFAULTS
    assert DEFAULTS.changed({p.name: v for p, v in DEFAULTS}) == DEFAULTS


@each
def test_limits_and_default_survive_the_wire(parameter: Parameter) -> None:
    # What a ground station reads back it may set again, to the last bit.
    for value in (parameter.minimum, parameter.maximum, parameter.default):
        on_wire = struct.unpack("<f", struct.pack("<f", value))[0]
        for sent in (value, on_wire):
            kept, refused = attempt({parameter.name: sent})
            if kept is not None:
                assert kept[parameter.name] == on_wire
            else:  # a limit may contradict another's default, but it is in range
                assert "allowed" not in refused.reason


# --- a change -------------------------------------------------------------------------------


@given(value=st.floats(-500.0, 500.0))
def test_a_value_is_kept_as_the_wire_has_it(value: float) -> None:
    kept = DEFAULTS.changed({"TGL_X": value})["TGL_X"]
    assert kept == as_wire_value(value) == as_wire_value(kept)
    assert DEFAULTS.changed({"TGL_X": kept})["TGL_X"] == kept


def test_a_change_makes_a_new_set_and_leaves_the_old() -> None:
    before = DEFAULTS["TGL_X"]
    after = DEFAULTS.changed({"TGL_X": before + 1.0, "TGL_Z": 2.0})
    assert (after["TGL_X"], after["TGL_Z"]) == (before + 1.0, 2.0)
    assert DEFAULTS["TGL_X"] == before
    assert after != DEFAULTS
    assert hash(after.changed({"TGL_X": before, "TGL_Z": DEFAULTS["TGL_Z"]})) == hash(DEFAULTS)
    assert after != 3


@pytest.mark.parametrize("bad", [{"TGL_Z": nan}, {"TGL_Z": 1e9}, {"NO_SUCH": 1.0}])
def test_one_bad_value_among_good_ones_changes_nothing(bad: dict[str, float]) -> None:
    refusal(DEFAULTS, {"TGL_X": 1.0, **bad, "RHO_P": 1.0})


@each
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_what_is_no_number_is_refused_everywhere(parameter: Parameter, value: float) -> None:
    message = refusal(DEFAULTS, {parameter.name: value})
    assert message.startswith(f"{parameter.name} = {value}: not finite; allowed ")


@each
@pytest.mark.parametrize("side", [-1, 1])
def test_out_of_range_names_parameter_value_and_range(parameter: Parameter, side: int) -> None:
    limit = parameter.maximum if side > 0 else parameter.minimum
    value = limit + side * 1.5 * max(1.0, abs(limit))
    message = refusal(DEFAULTS, {parameter.name: value})
    allowed = f"allowed {parameter.minimum:g} to {parameter.maximum:g} {parameter.unit}".rstrip()
    assert message == f"{parameter.name} = {value:g}: {allowed}"


@given(value=st.floats(allow_nan=True, allow_infinity=True), index=st.integers(0, len(NAMES) - 1))
def test_a_value_is_taken_only_within_its_range(value: float, index: int) -> None:
    p = PARAMETERS[index]
    kept, refused = attempt({p.name: value})
    if kept is not None:
        assert as_wire_value(p.minimum) <= kept[p.name] <= as_wire_value(p.maximum)
    else:
        assert refused.name == p.name


def test_an_unknown_name_is_named_with_its_value_and_the_way_out() -> None:
    assert refusal(DEFAULTS, {"TGL_Y": 1.5}) == (
        "TGL_Y = 1.5: no such parameter; `tgl-soar params` lists them"
    )


@pytest.mark.parametrize("value", [True, "3", None])
def test_what_is_not_even_a_number_is_refused(value: object) -> None:
    with pytest.raises(ParameterError, match=r"OP_ENGAGE = .*: not a number; allowed 0 to 2"):
        DEFAULTS.changed({"OP_ENGAGE": value})  # type: ignore[dict-item]


def test_whole_numbers_only_where_declared() -> None:
    (whole, *_) = [p for p in PARAMETERS if p.integer and p.maximum - p.minimum > 1]
    value = whole.minimum + 0.5
    message = refusal(DEFAULTS, {whole.name: value})
    assert message.startswith(f"{whole.name} = {value:g}: whole numbers only; allowed ")


def test_what_may_not_change_in_flight_does_not() -> None:
    for p in PARAMETERS:
        changes = {p.name: DEFAULTS[p.name]}
        if p.in_flight:
            assert DEFAULTS.changed(changes, flying=True) == DEFAULTS
        else:
            assert "not while flying; disengage first" in refusal(DEFAULTS, changes, flying=True)
            assert DEFAULTS.changed(changes) == DEFAULTS


# --- values that must agree -----------------------------------------------------------------

# Of our own choice, so that retuned defaults change nothing here.
BASE = DEFAULTS.changed(
    {
        "TGL_LEAN": 20.0,
        "TGL_LEAN_MIN": 5.0,
        "TGL_LEAN_MAX": 45.0,
        "PITCH_MIN": -12.0,
        "PITCH_TRIM": -2.0,
        "PITCH_MAX": 8.0,
        "AGE_POS_HOLD": 0.25,
        "AGE_POS_MAX": 1.5,
        "REC_PITCH": -4.0,
        "ALPHA_MAX": 14.0,
        "TILT_MAX": 60.0,
        "BANK_MAX": 20.0,
    }
)


@pytest.mark.parametrize(
    ("changes", "blamed", "says"),
    [
        ({"TGL_LEAN": 0.0}, "TGL_LEAN = 0", "by 5 deg or more (TGL_LEAN_MIN)"),
        ({"TGL_LEAN": -20.0}, "TGL_LEAN = -20", "by 5 deg or more (TGL_LEAN_MIN)"),
        ({"TGL_LEAN": 50.0}, "TGL_LEAN = 50", "by 45 deg or less (TGL_LEAN_MAX)"),
        ({"TGL_LEAN_MIN": 30.0}, "TGL_LEAN_MIN = 30", "by 30 deg or more"),
        ({"TGL_LEAN_MAX": 10.0}, "TGL_LEAN_MAX = 10", "by 10 deg or less"),
        ({"TGL_LEAN_MIN": 50.0}, "TGL_LEAN_MIN = 50", "TGL_LEAN_MIN is above TGL_LEAN_MAX"),
        ({"PITCH_MIN": 9.0}, "PITCH_MIN = 9", "PITCH_MIN must be below PITCH_MAX"),
        ({"PITCH_MAX": -12.0}, "PITCH_MAX = -12", "PITCH_MIN must be below PITCH_MAX"),
        ({"PITCH_TRIM": 9.0}, "PITCH_TRIM = 9", "between PITCH_MIN and PITCH_MAX"),
        ({"PITCH_MIN": 0.0}, "PITCH_MIN = 0", "between PITCH_MIN and PITCH_MAX"),
        # Recovering must put the nose down, and may.
        ({"REC_PITCH": 10.0}, "REC_PITCH = 10", "would raise the nose"),
        ({"REC_PITCH": -1.5}, "REC_PITCH = -1.5", "REC_PITCH = -1.5 deg is above PITCH_TRIM = -2"),
        ({"PITCH_TRIM": -5.0}, "PITCH_TRIM = -5", "is above PITCH_TRIM = -5 deg"),
        ({"REC_PITCH": -13.0}, "REC_PITCH = -13", "is below PITCH_MIN = -12 deg"),
        ({"PITCH_MIN": -3.0}, "PITCH_MIN = -3", "could not put the nose down"),
        (
            {"PITCH_MIN": 5.0, "PITCH_TRIM": 6.0},
            *("PITCH_MIN = 5", "REC_PITCH = -4 deg is below PITCH_MIN = 5 deg"),
        ),
        # Nor may what is flown on purpose be what ends the flight.
        ({"PITCH_TRIM": 7.0, "ALPHA_MAX": 7.0}, "PITCH_TRIM = 7", "must be below ALPHA_MAX = 7"),
        ({"TILT_MAX": 20.0}, "TILT_MAX = 20", "BANK_MAX = 20 deg must be within TILT_MAX = 20"),
        ({"PITCH_MIN": -45.0, "TILT_MAX": 45.0}, "PITCH_MIN = -45", "would end the flight"),
        ({"PITCH_MAX": 30.0, "TILT_MAX": 30.0}, "PITCH_MAX = 30", "would end the flight"),
        ({"BANK_MAX": 40.0, "TILT_MAX": 35.0}, "BANK_MAX = 40", "would end the flight"),
        ({"REC_TIME": 0.29}, "REC_TIME = 0.29", "must be 0, to hand over at once, or 0.3 s"),
        ({"TGL_CAPTURE": 1.5}, "TGL_CAPTURE = 1.5", "must be below CAPTURE_MAX = 1.5 m"),
        ({"AGE_POS_HOLD": 2.0}, "AGE_POS_HOLD = 2", "AGE_POS_HOLD is above AGE_POS_MAX"),
        ({"AGE_POS_MAX": 0.2}, "AGE_POS_MAX = 0.2", "AGE_POS_HOLD is above AGE_POS_MAX"),
    ],
)
def test_a_contradiction_blames_what_was_changed(
    changes: dict[str, float], blamed: str, says: str
) -> None:
    message = refusal(BASE, changes)
    assert message.startswith(f"{blamed}: ")
    assert says in message


@pytest.mark.parametrize(
    "changes",
    [
        {"REC_PITCH": -2.0},
        {"REC_PITCH": -12.0},
        {"PITCH_MIN": -4.0},
        {"PITCH_TRIM": -4.0},
        {"PITCH_TRIM": 7.9, "ALPHA_MAX": 8.0},
        {"TILT_MAX": 20.5},
        {"PITCH_MIN": -45.0},
        {"REC_TIME": 0.0},
        {"REC_TIME": RECOVERY_MIN_S},
        {"TGL_CAPTURE": 1.4},
    ],
)
def test_what_just_leaves_a_way_to_recover_is_accepted(changes: dict[str, float]) -> None:
    BASE.changed(changes)


def test_the_shortest_recovery_is_the_time_that_trouble_must_be_over() -> None:
    assert RECOVERY_MIN_S == CLEAR_S


def test_a_contradiction_with_recovering_is_refused_wherever_it_comes_from(tmp_path: Path) -> None:
    """At load, as one PARAM_SET in flight, and in a set whose staged move is committed."""
    text = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
    path = tmp_path / "airframe.toml"
    path.write_text(text.replace("PITCH_MIN = -12.0", "PITCH_MIN = -2.0"), encoding="utf-8")
    site_path = shipped("sites/tunnel.toml")
    with pytest.raises(ConfigError, match=r"airframe.toml: .*PITCH_MIN = -2: .*REC_PITCH = -4 deg"):
        load_parameters(load_airframe(path), path, load_site(site_path), site_path)

    lines = LineChanges()
    with pytest.raises(ParameterError, match=r"REC_PITCH = 10: .*would raise the nose"):
        lines.set(BASE, "REC_PITCH", 10.0, flying=True)

    staging = lines.set(BASE, "TGL_STAGE", 1.0, flying=True).values
    lines.set(staging, "TGL_X", 0.1, flying=True)
    with pytest.raises(ParameterError, match=r"REC_PITCH = 10: .*would raise the nose"):
        lines.set(staging, "REC_PITCH", 10.0, flying=True)  # at once: it is none that is staged
    assert lines.set(staging, "TGL_STAGE", 0.0, flying=True).values["TGL_X"] != BASE["TGL_X"]


def test_two_that_agree_may_change_together() -> None:
    # Either alone would contradict what stands.
    both = {"TGL_LEAN_MIN": -30.0, "TGL_LEAN": -20.0}
    assert BASE.changed(both)["TGL_LEAN"] == -20.0
    refusal(BASE, {"TGL_LEAN": -20.0})
    both = {"PITCH_MIN": -14.0, "PITCH_TRIM": -13.0, "PITCH_MAX": -12.5, "REC_PITCH": -13.5}
    assert BASE.changed(both)["PITCH_MAX"] == -12.5


def test_a_line_may_not_be_horizontal_whatever_the_operator_raises() -> None:
    """A horizontal line, 90 degrees of lean, has no upstream side."""
    for name in ("TGL_LEAN", "TGL_LEAN_MIN", "TGL_LEAN_MAX"):
        p = PARAMETERS[INDEX[name]]
        assert max(abs(p.minimum), abs(p.maximum)) < 80.0
    wide = BASE.changed({"TGL_LEAN_MAX": PARAMETERS[INDEX["TGL_LEAN_MAX"]].maximum})
    for lean in (90.0, -90.0):
        assert "allowed" in refusal(wide, {"TGL_LEAN": lean})


@pytest.mark.parametrize("changes", [{"EST_DELAY": 0.3}, {"EST_DELAY": 0.1, "AGE_POS_HOLD": 0.1}])
def test_a_delay_that_makes_every_position_too_old_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=r"EST_DELAY = .*below AGE_POS_HOLD"):
        ParameterSet().changed(changes)
    assert ParameterSet().changed({"EST_DELAY": 0.3, "AGE_POS_HOLD": 0.5})["EST_DELAY"] > 0.29
