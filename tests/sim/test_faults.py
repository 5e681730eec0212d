"""The catalogue of faults and how they are written."""

from __future__ import annotations

from math import isfinite
from random import Random

import pytest

from tgl_soar.sim.faults import (
    CATALOGUE,
    FaultError,
    catalogue_text,
    drawn_fault,
    parse_fault,
    parse_faults,
)

KINDS = sorted(CATALOGUE)


def test_a_fault_reads_as_it_is_written() -> None:
    fault = parse_fault("position.dropout start=20 for=1.5")
    assert (fault.of, fault.way) == ("position", "dropout")
    assert (fault.start_s, fault.end_s) == (20.0, 21.5)
    assert not fault.acts(19.999)
    assert fault.acts(20.0)
    assert fault.acts(21.499)
    assert not fault.acts(21.5)


def test_what_is_left_out_has_its_default() -> None:
    fault = parse_fault("link.loss fraction=0.4")
    declared = {number.name: number.default for number in CATALOGUE["link.loss"].numbers}
    assert fault.values == {**declared, "fraction": 0.4}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no fault named ''"),
        ("position.drop", "near it: position.dropout"),
        ("position.dropout by=1", "it takes start, for"),
        ("position.dropout start", "it takes start, for"),
        ("position.dropout start=soon", "must be a number from 0 to 1e+06 s"),
        ("position.dropout start=nan", "must be a number from 0"),
        ("position.dropout for=-1", "for = '-1': must be a number from 0"),
        ("link.loss fraction=1.5", "fraction = '1.5': must be a number from 0 to 1"),
    ],
)
def test_a_mistake_is_reported_with_what_is_allowed(text: str, says: str) -> None:
    with pytest.raises(FaultError) as caught:
        parse_faults([text])
    assert says in str(caught.value)


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_is_declared_well(name: str) -> None:
    kind = CATALOGUE[name]
    assert kind.name == name
    assert [number.name for number in kind.numbers[:2]] == ["start", "for"]
    for number in kind.numbers:
        assert number.low <= number.default <= number.high
        assert number.low <= number.drawn[0] <= number.drawn[1] <= number.high
        assert number.what
    assert name in catalogue_text()


@pytest.mark.parametrize("name", KINDS)
def test_a_drawn_fault_repeats_and_can_be_written_down(name: str) -> None:
    fault = drawn_fault(CATALOGUE[name], Random(7))
    assert fault == drawn_fault(CATALOGUE[name], Random(7))
    assert parse_fault(str(fault)) == fault
    assert all(isfinite(value) for value in fault.values.values())
