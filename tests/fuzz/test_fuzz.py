"""Everything that reads bytes, given bytes: the targets of tools/fuzz.py, quickly."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from random import Random

import fuzz
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tgl_soar.config.parameter_store import read_state

ROOT = Path(__file__).parents[2]
NAMES = sorted(fuzz.TARGETS)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.binary(max_size=300))
def test_no_bytes_do_harm(name: str, data: bytes) -> None:
    fuzz.TARGETS[name](data)


@pytest.mark.parametrize("name", NAMES)
def test_no_mutation_of_good_input_does_harm(name: str) -> None:
    random, known = Random(name), fuzz.examples(name)
    for example in known:
        fuzz.TARGETS[name](example)
    for _ in range(60):
        fuzz.TARGETS[name](fuzz.mutated(random, random.choice(known)))


def test_a_target_that_finds_something_says_so() -> None:
    flight = fuzz.Flight()
    flight.expected = flight.expected.changed({"TGL_X": 0.3})
    with pytest.raises(fuzz.WrongError, match="parameters were changed"):
        flight.take(b"")


def test_a_state_file_with_a_right_checksum_is_among_them() -> None:
    values, _ = read_state(fuzz._summed(b"1\t191\tTGL_X\t0.5\t9"), fuzz.IDENTITY, "state")
    assert values == {"TGL_X": 0.5}


def test_the_tool_runs_by_lot() -> None:
    done = subprocess.run(
        [sys.executable, "tools/fuzz.py", "natnet", "--seconds", "0.2", "--by-lot"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert "nothing found" in done.stdout
