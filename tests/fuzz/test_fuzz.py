"""Everything that reads bytes, given bytes: the targets of tools/fuzz.py, quickly."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from random import Random

import fuzz
import fuzz_logs
import pytest
from fuzz_mutations import (
    Seal,
    mutated_parts,
    parts_of,
    sealed_dataflash,
    sealed_tlog,
    sealed_ulog,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.report.flight_page import analysed, page_text
from tgl_soar.analysis.report.flight_report_figures import Surroundings
from tgl_soar.config.parameter_store import read_state
from tgl_soar.sim.natnet_frames import VERSIONS

ROOT = Path(__file__).parents[2]
NAMES = sorted(fuzz.TARGETS)
REPORTED = {  # by the good logs themselves
    "nothing was written for 40 ms: disk or computer were too slow",
    "the writer dropped 1 records",
}


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.binary(max_size=300))
def test_no_bytes_do_harm(name: str, data: bytes) -> None:
    fuzz.TARGETS[name](data)


@pytest.mark.parametrize("name", NAMES)
def test_no_mutation_of_good_input_does_harm(name: str) -> None:
    random, draw = Random(name), fuzz.supply(name)
    for example in fuzz.examples(name)[:: 4 if name == "figures" else 1]:
        fuzz.TARGETS[name](example)
    for _ in range(3 if name == "figures" else 60):
        fuzz.TARGETS[name](draw(random))


def test_a_target_that_finds_something_says_so() -> None:
    flight = fuzz.Flight()
    flight.expected = flight.expected.changed({"TGL_X": 0.3})
    with pytest.raises(fuzz.WrongError, match="parameters were changed"):
        flight.take(b"")


def test_a_flight_that_no_longer_soars_is_found() -> None:
    flight = fuzz.Flight()
    assert flight.mode == "soaring"
    disengage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 0.0, 9)
    flight._receive(disengage, flight._station)
    flight.expected = flight.onboard.parameters.values
    for _ in range(fuzz.PER_TICK - 1):
        flight.take(b"")
    with pytest.raises(fuzz.WrongError, match=r"(standby|ready) .* by \["):
        flight.take(b"")


def test_a_tracker_that_is_not_ready_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    hall = fuzz.Hall(VERSIONS[0])
    models = hall._models
    monkeypatch.setattr(hall, "_models", b"")
    with pytest.raises(fuzz.WrongError, match="come to know"):
        hall.ready()
    monkeypatch.setattr(hall, "_models", models)
    hall.ready()
    assert hall.tracker.is_ready


@pytest.mark.parametrize("name", sorted(fuzz.LOGS))
def test_every_good_log_is_read_whole_and_its_parts_are_in_order(name: str) -> None:
    for example in fuzz.examples(name):
        assert set(fuzz.flight_in(example).lost) <= REPORTED
        parts, seal = parts_of(example)
        assert b"".join(parts) == example
        assert [seal(part) for part in parts[1:]] == parts[1:]


@pytest.mark.parametrize("seal", [sealed_ulog, sealed_dataflash, sealed_tlog])
def test_messages_of_which_nothing_is_left_can_be_changed(seal: Seal) -> None:
    random = Random(1)
    for _ in range(1000):
        mutated_parts(random, [b"", b"", b"a"], seal)


def test_a_sealed_frame_is_whole_whatever_was_changed_in_it() -> None:
    random, (parts, seal) = Random(1), parts_of(fuzz_logs.tlog(["ATTITUDE"]))
    changed = [seal(part[:18] + random.randbytes(28) + b"??") for part in parts]
    attitude = fuzz.flight_in(b"".join(changed)).attitude
    assert attitude is not None
    assert len(attitude) == len(parts)


@pytest.mark.parametrize("example", [logs[-1] for logs in fuzz.LOGS.values()])
def test_the_markup_in_a_good_log_is_shown_on_its_page(example: bytes) -> None:
    text = page_text(analysed(fuzz.flight_in(example), Surroundings(), fuzz.HILL), {})
    assert "&lt;u&gt;" in text


def test_what_an_input_does_is_noted_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def picky(data: bytes) -> None:
        if data not in fuzz.examples("parameters"):
            raise KeyError("a reader's mistake")

    monkeypatch.setitem(fuzz.TARGETS, "parameters", picky)
    with pytest.raises(KeyError) as caught:
        fuzz.by_lot("parameters", 10.0, seed=1, count=20)
    assert "of seed 1: b'" in caught.value.__notes__[0]


def test_an_input_that_takes_much_memory_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def hungry(data: bytes) -> None:
        bytes(0 if data in fuzz.examples("state") else 2 * fuzz.MOST_BYTES)

    monkeypatch.setitem(fuzz.TARGETS, "state", hungry)
    with pytest.raises(MemoryError):
        fuzz.by_lot("state", 10.0, seed=1, count=20)
    assert bytes(2 * fuzz.MOST_BYTES)  # only while it looks


def test_a_state_file_with_a_right_checksum_is_among_them() -> None:
    values, _ = read_state(fuzz._summed(b"1\t191\tTGL_X\t0.5\t9"), fuzz.IDENTITY, "state")
    assert values == {"TGL_X": 0.5}


def test_the_tool_runs_by_lot() -> None:
    done = subprocess.run(
        [sys.executable, "tools/fuzz.py", "natnet", "--count", "300", "--by-lot"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert "natnet: 300 inputs of seed 1, nothing found" in done.stdout
