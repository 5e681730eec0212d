"""Flights on disk as they are flown: a file that only grows.

Each record holds the results of consecutive flights, with their first number, their count, a
length and a check sum.  A record that a kill, a power cut or a full disk has cut off is found by
these, taken off, and its flights are flown again; one that holds flights that are there already
is passed over.  One that is damaged is passed over, too: what comes after it is found by its check
sum.  So every flight is there once or not at all.
"""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final, NamedTuple, Protocol
from zlib import crc32

from tgl_soar.sim.campaign.encoding import decoder, encode
from tgl_soar.sim.campaign.interrupts import interrupts_later

MAGIC: Final = b"tgl_soar flights 1\n"
_HEAD: Final = struct.Struct("<QIII")  # first flight, flights, bytes, their check sum


class JournalError(ValueError):
    """A file of flights that cannot be read, or written."""


class FlightsKept(Protocol):
    """Where flights are kept."""

    @property
    def flown(self) -> int:
        """How many are there."""
        ...

    def missing(self) -> list[range]:
        """Those that are not."""
        ...

    def put(self, first: int, results: Sequence[Any]) -> None:
        """Consecutive flights from a number on."""
        ...


class InMemory:
    """Flights of this process, in order."""

    def __init__(self, count: int) -> None:
        self.flown = 0
        self._results: list[Any] = [_MISSING] * count

    def missing(self) -> list[range]:
        """Of `FlightsKept`."""
        gaps: list[range] = []
        for number, result in enumerate(self._results):
            if result is _MISSING:
                joins = gaps and gaps[-1].stop == number
                gaps.append(range(gaps.pop().start if joins else number, number + 1))
        return gaps

    def put(self, first: int, results: Sequence[Any]) -> None:
        """Of `FlightsKept`."""
        self._results[first : first + len(results)] = results
        self.flown += len(results)

    def results(self) -> list[Any]:
        """All of them."""
        return self._results


_MISSING: Final = object()


class _Record(NamedTuple):
    first: int
    flights: int
    offset: int  # of its bytes in the file
    size: int


class Journal:
    """One file of one campaign's flights."""

    def __init__(self, path: Path, digest: str, count: int, kind: Any) -> None:
        """Open or begin the file.  digest: of all that the flights depend on; kind: the type of a
        result.

        Errors: `JournalError` for a file of another campaign, one that another process writes,
        and where nothing can be written; TypeError for a type that cannot be kept.
        """
        self.path = path
        self.count = count
        self._decoder = decoder(list[kind])
        self._digest = digest
        self._records: dict[int, _Record] = {}
        self._there = bytearray(count)
        self.flown = 0
        self.damaged = 0  # bytes that are of no use: records cut off or not what they were
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = path.open("a+b", buffering=0)
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise JournalError(f"{path}: another process flies this campaign") from None
        try:
            self._end = self._begun()
            self._file.truncate(self._end)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """No more is written."""
        self._file.close()

    def missing(self) -> list[range]:
        """The flights that are not there, in order."""
        gaps, at = [], 0
        for record in self._in_order():
            if record.first > at:
                gaps.append(range(at, record.first))
            at = record.first + record.flights
        if at < self.count:
            gaps.append(range(at, self.count))
        return gaps

    def put(self, first: int, results: Sequence[Any]) -> None:
        """Consecutive flights, on the disk before it returns.

        Errors: `JournalError` where there is no room; what was there before stays.
        """
        data = encode(list(results))
        with interrupts_later():  # a record is written and counted, or neither
            self._append(first, len(results), data)
            self._enter(_Record(first, len(results), self._end + _HEAD.size, len(data)))
            self._end += _HEAD.size + len(data)

    def __iter__(self) -> Iterator[Any]:
        """All results in the order of their flights, one record in memory at a time."""
        for record in self._in_order():
            data = os.pread(self._file.fileno(), record.size, record.offset)
            yield from self._decoder.decode(data)

    # --- the file ---------------------------------------------------------------------------------

    def _in_order(self) -> list[_Record]:
        return [self._records[first] for first in sorted(self._records)]

    def _enter(self, record: _Record) -> None:
        self._records[record.first] = record
        self._there[record.first : record.first + record.flights] = b"\1" * record.flights
        self.flown += record.flights

    def _append(self, first: int, count: int, data: bytes) -> None:
        record = _HEAD.pack(first, count, len(data), _sum(first, count, data)) + data
        try:
            self._write(record)
        except OSError as error:
            os.ftruncate(self._file.fileno(), self._end)
            raise JournalError(
                f"{self.path}: cannot be written: {error.strerror}; {self.flown} of {self.count}"
                " flights are kept: make room, then go on with --resume"
            ) from None

    def _write(self, data: bytes) -> None:
        """All of it, behind what is there."""
        written = 0
        while written < len(data):
            written += os.write(self._file.fileno(), data[written:])
        os.fsync(self._file.fileno())

    def _begun(self) -> int:
        """Where what is whole ends; a new file gets its head."""
        file = self._file
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        head = MAGIC + f"{self._digest} {self.count}\n".encode()
        found = file.read(len(head))
        if len(found) < len(head) and head.startswith(found):
            try:
                file.truncate(0)
                self._write(head)
            except OSError as error:
                with suppress(OSError):
                    self.path.unlink()  # no flight is in it
                raise JournalError(
                    f"{self.path}: cannot be written: {error.strerror}; nothing has been flown"
                ) from None
            return len(head)
        if found != head:
            raise JournalError(
                f"{self.path}: flights of another campaign, of other options or of another version"
                " of this program: name another folder, or begin again with --restart"
            )
        at = whole_until = len(head)
        while at + _HEAD.size <= size:
            record = self._record_at(at, size)
            if record is None:
                at += 1
                continue
            self.damaged += at - whole_until
            if not any(self._there[record.first : record.first + record.flights]):
                self._enter(record)
            at = whole_until = record.offset + record.size
        self.damaged += size - whole_until
        return whole_until

    def _record_at(self, at: int, size: int) -> _Record | None:
        """None: no whole record of this campaign begins there."""
        descriptor = self._file.fileno()
        first, count, length, expected = _HEAD.unpack(os.pread(descriptor, _HEAD.size, at))
        begin = at + _HEAD.size
        if count == 0 or first + count > self.count or begin + length > size:
            return None
        data = os.pread(descriptor, length, begin)
        if len(data) < length or _sum(first, count, data) != expected:
            return None
        return _Record(first, count, begin, length)


def _sum(first: int, count: int, data: bytes) -> int:
    return crc32(data, crc32(f"{first} {count}".encode()))
