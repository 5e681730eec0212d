"""Buffers between the loop, which fills them, and the thread that writes them to the disk."""

from __future__ import annotations

import queue
from typing import Final, NamedTuple

BUFFER_BYTES: Final = 65536
BUFFERS: Final = 48  # 3 MB: nearly a minute of a disk that does not answer
STOP_S: Final = 2.0  # so long the end of the process waits for the disk


class Order(NamedTuple):
    """For the thread: a buffer to write, and the file that it belongs to."""

    ending: str  # "ulg" or "tlog"
    buffer: bytearray
    length: int
    begins_us: (
        int  # the buffer begins a new part, at this time of the loop's clock; -1: it does not
    )


Orders = queue.SimpleQueue[Order | None]


class Buffers:
    """Those that are free."""

    def __init__(self, count: int, patient: bool) -> None:
        self._count = count
        self._patient = patient
        self._free: queue.SimpleQueue[bytearray] = queue.SimpleQueue()
        for _ in range(count):
            self._free.put(bytearray(BUFFER_BYTES))

    def take(self) -> bytearray | None:
        """One, if there is one; a patient loop waits for it."""
        try:
            return self._free.get(self._patient, STOP_S)
        except queue.Empty:
            return None

    def give_back(self, buffer: bytearray) -> None:
        self._free.put(buffer)

    @property
    def plenty(self) -> bool:
        """Whether the disk keeps up, or is waited for."""
        return self._patient or self._free.qsize() > self._count // 2


class Spool:
    """The loop's end of one file: fills buffers and hands them over."""

    def __init__(self, ending: str, free: Buffers, orders: Orders) -> None:
        self.ending = ending
        self.buffer = bytearray()  # empty: none is there
        self.at = 0
        self._handed_bytes = 0  # of this part
        self._begins_us = -1
        self._free = free
        self._orders = orders

    @property
    def part_bytes(self) -> int:
        """Of this part so far."""
        return self._handed_bytes + self.at

    def room(self, size: int) -> bool:
        """Whether so much can be put at `at`; a full buffer is handed over for it."""
        if self.at + size <= len(self.buffer):
            return True
        self.hand_over()
        if not self.buffer:
            self.buffer = self._free.take() or bytearray()
        return size <= len(self.buffer)

    def write(self, data: bytes) -> bool:
        """Whether it found room."""
        size = len(data)
        if not self.room(size):
            return False
        self.buffer[self.at : self.at + size] = data
        self.at += size
        return True

    def hand_over(self) -> None:
        """What is there goes to the thread."""
        if self.at > 0:
            self._orders.put(Order(self.ending, self.buffer, self.at, self._begins_us))
            self._handed_bytes += self.at
            self.buffer, self.at, self._begins_us = bytearray(), 0, -1

    def begin_part(self, time_us: int) -> None:
        """What comes next goes into another file."""
        self.hand_over()
        self._handed_bytes = 0
        self._begins_us = time_us
