"""The thread that writes a flight's log, and all that only it touches."""

from __future__ import annotations

import os
import queue
import struct
import threading
from collections.abc import Callable
from math import inf
from os import write
from pathlib import Path
from typing import Final, TypeVar

from tgl_soar.onboard.flightlog import files
from tgl_soar.onboard.flightlog.spool import STOP_S, Buffers, Order, Orders
from tgl_soar.onboard.flightlog.ulog_messages import MAGIC
from tgl_soar.onboard.realtime import clock_s

SYNC_S: Final = 1.0
STACK_BYTES: Final = 256 * 1024  # memory is locked: a thread's stack of 8 MB would be resident
PARTS: Final = 10  # so many parts make up the largest
FIRST_US: Final = 60_000_000  # of a flight: never deleted while it is flown

_Given = TypeVar("_Given")


class Disk:
    """The thread that writes, and all that only it touches."""

    def __init__(
        self,
        folder: Path,
        preamble: bytes,
        largest_bytes: int,
        unix_s: Callable[[], float],
        free: Buffers,
        orders: Orders,
    ) -> None:
        self.trouble = ""  # why nothing more is written
        self.path: Path | None = None  # the ULog's first part, by which all of it is read
        self._written: Path | None = None  # the part that is being written
        self._folder = folder
        self.preamble_of = preamble
        self._largest_bytes = largest_bytes
        self._unix_s = unix_s
        self._free = free
        self._orders = orders
        self._flight = 0  # the number of this one
        self._stem: Path | None = None  # of this flight's files
        self._messages: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._open: dict[str, int] = {}  # descriptors by ending
        self._parts = {"ulg": 0, "tlog": 0}
        self._begun_us = -1  # the first part
        self._first_parts = 0  # begun in the flight's first minute
        self._synced_s = -inf
        self._worker: threading.Thread | None = None

    def start(self) -> None:
        before = threading.stack_size(STACK_BYTES)
        try:
            self._worker = threading.Thread(target=self._work, name="flight log", daemon=True)
            self._worker.start()
        finally:
            threading.stack_size(before)

    def stop(self) -> bool:
        """Whether all was written in time."""
        self._orders.put(None)
        if self._worker is None:
            return True
        self._worker.join(STOP_S)
        return not self._worker.is_alive()

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            if not self.trouble:
                self._try(self._write, order)
            self._free.give_back(order.buffer)
        for ending in tuple(self._open):
            self._try(self._close, ending)

    def _try(self, action: Callable[[_Given], None], given: _Given) -> None:
        """Whatever goes wrong ends the log and nothing else."""
        try:
            action(given)
        except OSError as error:
            self.trouble = f"{error.filename or self._written or self._folder}: {error.strerror}"
        except Exception as error:
            self.trouble = f"{self._written or self._folder}: {error!r}"

    def _write(self, order: Order) -> None:
        if order.begins_us >= 0:
            self._begin(order.ending, order.begins_us)
        _write_all(self._open[order.ending], memoryview(order.buffer)[: order.length])
        now_s = clock_s()
        if now_s - self._synced_s >= SYNC_S:
            self._synced_s = now_s
            for descriptor in self._open.values():
                os.fsync(descriptor)

    def _begin(self, ending: str, begins_us: int) -> None:
        """The next part of a file."""
        self._close(ending)
        if self._stem is None:
            self._stem = self._name()
        if ending == "ulg":
            if self._parts[ending]:
                self._make_room()
            else:
                self._begun_us = begins_us
            if begins_us - self._begun_us < FIRST_US:
                self._first_parts = self._parts[ending] + 1
        self._parts[ending] += 1
        path = files.part_name(self._stem, self._parts[ending], ending)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._open[ending] = descriptor
        if ending == "ulg":
            self.path, self._written = self.path or path, path
            _write_all(descriptor, memoryview(MAGIC + struct.pack("<Q", begins_us)))
            _write_all(descriptor, memoryview(self.preamble_of))

    def _name(self) -> Path:
        """This flight's: the number after the last one that is there."""
        self._folder.mkdir(parents=True, exist_ok=True)
        self._flight = 1 + max((file.flight for file in files.kept_in(self._folder)), default=0)
        self._make_room()
        stem = files.flight_name(self._folder, self._flight, self._unix_s())
        stem.parent.mkdir(exist_ok=True)
        return stem

    def _make_room(self) -> None:
        """For the next part; which flights lost logs for it is reported."""
        coming_bytes = self._largest_bytes // PARTS
        deleted = files.make_room(
            self._folder, self._largest_bytes, coming_bytes, self._flight, self._first_parts
        )
        if deleted:
            first, last = deleted[0].flight, deleted[-1].flight
            whose = f"flight {first}" if first == last else f"flights {first} to {last}"
            self._messages.put(f"no room: {len(deleted)} log files of {whose} deleted")

    def messages(self) -> list[str]:
        """Messages for the operator since the last call."""
        words = []
        while not self._messages.empty():
            words.append(self._messages.get())
        return words

    def _close(self, ending: str) -> None:
        descriptor = self._open.pop(ending, None)
        if descriptor is not None:
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def _write_all(descriptor: int, data: memoryview) -> None:
    while data:
        written = write(descriptor, data)  # not in the slice: mypyc would call it twice
        data = data[written:]
