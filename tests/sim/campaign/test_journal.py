"""Flights on disk: each once or not at all, whatever becomes of the file."""

from __future__ import annotations

import os
import resource
import signal
import struct
import subprocess
import sys
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cheap_flights import CheapResult, cheap_jobs, fly_cheaply
from numpy.typing import NDArray

from tgl_soar.sim.campaign.encoding import decoder, digest, encode, result_type
from tgl_soar.sim.campaign.journal import Journal, JournalError

RESULTS = [fly_cheaply(job) for job in cheap_jobs(10)]


def journal(path: Path, digest: str = "d", count: int = 10) -> Journal:
    return Journal(path, digest, count, CheapResult)


def test_what_was_put_is_there_in_order_and_what_is_missing_is_known(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "flights"
    with journal(path) as kept:
        kept.put(6, RESULTS[6:8])
        kept.put(0, RESULTS[0:3])
        assert kept.missing() == [range(3, 6), range(8, 10)]
    with journal(path) as again:
        assert (again.flown, again.missing()) == (5, [range(3, 6), range(8, 10)])
        again.put(3, RESULTS[3:6])
        again.put(8, RESULTS[8:])
        assert again.missing() == []
        assert list(again) == RESULTS


def test_a_file_cut_anywhere_is_as_good_as_its_whole_records(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    with journal(path) as kept:
        kept.put(0, RESULTS[:2])
        one = path.stat().st_size
        kept.put(5, RESULTS[5:9])
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with journal(path) as cut:
            assert cut.missing()[0] == range(2 if length >= one else 0, 10)
            cut.put(5, RESULTS[5:9])
        with journal(path) as again:
            assert again.flown == (6 if length >= one else 4)
            assert list(again)[-4:] == RESULTS[5:9]


def test_ctrl_c_finds_a_record_counted_once_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with journal(tmp_path / "flights") as kept:
            with monkeypatch.context() as patched:
                patched.setattr(os, "fsync", lambda _: signal.raise_signal(signal.SIGINT))
                with pytest.raises(KeyboardInterrupt):
                    kept.put(0, RESULTS[:3])
            assert kept.flown == 3
            kept.put(3, RESULTS[3:])
            assert list(kept) == RESULTS
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_damaged_record_is_flown_again(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    with journal(path) as kept:
        kept.put(0, RESULTS[:2])
        kept.put(2, RESULTS[2:4])
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    with journal(path) as again:
        assert again.missing() == [range(2, 10)]
        assert again.damaged > 0


@pytest.mark.parametrize("where", [3, 11, 17, 25])  # in its head, and in what it holds
def test_what_comes_after_a_damaged_record_is_kept(tmp_path: Path, where: int) -> None:
    path = tmp_path / "flights"
    with journal(path) as kept:
        kept.put(0, RESULTS[:2])
        before = path.stat().st_size
        kept.put(2, RESULTS[2:4])
        kept.put(4, RESULTS[4:9])
    data = bytearray(path.read_bytes())
    data[before + where] ^= 4
    path.write_bytes(data)
    with journal(path) as again:
        assert again.missing() == [range(2, 4), range(9, 10)]
        assert again.damaged > where
        again.put(2, RESULTS[2:4])
        assert list(again) == RESULTS[:9]
    with journal(path) as last:
        assert list(last) == RESULTS[:9]


def test_flights_that_are_there_twice_count_once(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    with journal(path) as kept:
        before = path.stat().st_size
        kept.put(0, RESULTS[:2])
    data = path.read_bytes()
    path.write_bytes(data + data[before:])
    with journal(path) as again:
        assert again.flown == 2
        assert list(again) == RESULTS[:2]


def test_flights_of_another_campaign_are_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    journal(path).close()
    for other in (("e", 10), ("d", 11)):
        with pytest.raises(JournalError, match=r"another campaign.*--restart"):
            journal(path, *other)
    path.write_bytes(b"something else\n")
    with pytest.raises(JournalError, match="another campaign"):
        journal(path)


def test_two_processes_do_not_write_one_file(tmp_path: Path) -> None:
    with (
        journal(tmp_path / "flights"),
        pytest.raises(JournalError, match="another process flies this campaign"),
    ):
        journal(tmp_path / "flights")


def test_where_nothing_can_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(JournalError, match="cannot be written"):
        journal(tmp_path / "file" / "flights")


FULL = """
import resource, sys
from pathlib import Path
from cheap_flights import cheap_jobs, fly_cheaply, CheapResult
from tgl_soar.sim.campaign.journal import Journal, JournalError
path = Path(sys.argv[1])
with Journal(path, "d", 10, CheapResult) as kept:
    kept.put(0, [fly_cheaply(job) for job in cheap_jobs(2)])
    size = path.stat().st_size + 30  # room for half a record
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    try:
        kept.put(2, [fly_cheaply(job) for job in cheap_jobs(10)[2:]])
    except JournalError as error:
        print(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    kept.put(2, [fly_cheaply(job) for job in cheap_jobs(4)[2:]])
"""


FULL_AT_ONCE = """
import resource, signal, sys
from pathlib import Path
from cheap_flights import CheapResult
from tgl_soar.sim.campaign.journal import Journal, JournalError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    Journal(Path(sys.argv[1]), "d", 10, CheapResult)
except JournalError as error:
    print(error)
"""


@pytest.mark.parametrize("bytes_left", [0, 10])
def test_a_disk_that_is_full_at_the_start_is_named_and_leaves_nothing(
    tmp_path: Path, bytes_left: int
) -> None:
    path = tmp_path / "flights"
    words = [sys.executable, "-c", FULL_AT_ONCE, str(path), str(bytes_left)]
    here = str(Path(__file__).parent)
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True, cwd=here)
    assert f"{path}: cannot be written: File too large; nothing has been flown" in done.stdout
    assert not path.exists()


def test_a_disk_that_fills_leaves_what_was_there(tmp_path: Path) -> None:
    """A file that may not grow, the half of a record written: as a full disk has it."""
    path = tmp_path / "flights"
    words = [sys.executable, "-c", FULL, str(path)]
    here = str(Path(__file__).parent)
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True, cwd=here)
    assert "2 of 10 flights are kept: make room, then go on with --resume" in done.stdout
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    with journal(path) as again:
        assert list(again) == RESULTS[:4]


# --- results as bytes -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Rich:
    """All that a result may hold."""

    flags: dict[bool, NDArray[np.float64]]
    legs: tuple[CheapResult, ...]
    place: tuple[float, float] | None
    number: float


def test_every_bit_of_a_result_comes_back() -> None:
    odd = struct.unpack("<d", struct.pack("<Q", 0x7FF8_0000_0000_1234))[0]  # a NaN of its own
    table = np.array([[1.0, -0.0, nan], [inf, 5e-324, odd]])
    rich = Rich({True: table, False: table[:0]}, (RESULTS[0],), None, odd)
    back = decoder(Rich).decode(encode(rich))
    assert back.flags[True].tobytes() == table.tobytes()
    assert back.flags[True].shape == (2, 3)
    assert back.flags[False].shape == (0, 3)
    assert (back.legs, back.place) == (rich.legs, None)
    assert struct.pack("<d", back.number) == struct.pack("<d", odd)


class Holds(NamedTuple):
    """Something that is written nowhere."""

    what: object


def test_what_has_no_form_on_disk_is_refused() -> None:
    with pytest.raises(TypeError, match="is not written to a file of flights"):
        encode(Holds(object()))
    assert result_type(fly_cheaply) is CheapResult

    def says_nothing(job):  # type: ignore[no-untyped-def]
        return job

    with pytest.raises(TypeError, match="says what it returns"):
        result_type(says_nothing)


def test_a_digest_is_of_values_alone() -> None:
    one: dict[str, Any] = {"a": 1.0, "b": (Path("x"), np.float64(2.0))}
    two: dict[str, Any] = {"b": [Path("x"), 2.0], "a": 1.0}
    assert digest(one) == digest(two)
    assert digest(one) != digest({**one, "a": 1.5})
