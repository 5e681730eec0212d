"""Buffers between loop and disk: when they are handed over and to which side, and what is full."""

from __future__ import annotations

import queue
import threading
import time

import pytest

from tgl_soar.onboard.flightlog import spool
from tgl_soar.onboard.flightlog.spool import BUFFER_BYTES, BUFFERS, Buffers, Order, Orders, Spool


class Log:
    """One file's end in the loop, and what has been handed to the thread."""

    def __init__(self, count: int = 3) -> None:
        self.orders: Orders = queue.SimpleQueue()
        self.free = Buffers(count, patient=False)
        self.spool = Spool("ulg", self.free, self.orders)

    def handed(self) -> list[Order]:
        found = []
        while not self.orders.empty():
            order = self.orders.get()
            assert order is not None
            found.append(order)
        return found


def test_a_spool_begins_with_no_buffer_and_takes_one_when_it_is_needed() -> None:
    log = Log(1)
    assert (log.spool.at, log.spool.part_bytes, len(log.spool.buffer)) == (0, 0, 0)
    log.spool.hand_over()
    assert log.handed() == []  # nothing is there
    assert log.spool.write(b"abc")
    assert (log.spool.at, log.spool.part_bytes) == (3, 3)
    assert len(log.spool.buffer) == BUFFER_BYTES
    assert log.free.take() is None


def test_what_is_written_lies_one_behind_the_other_until_the_buffer_is_full() -> None:
    log = Log()
    first = bytes(range(256)) * (BUFFER_BYTES // 256 - 1)
    assert log.spool.write(first)
    assert log.spool.write(b"x" * 256)  # to the last byte
    assert log.handed() == []
    assert log.spool.at == BUFFER_BYTES
    assert log.spool.write(b"y")
    (order,) = log.handed()
    assert (order.ending, order.length, order.begins_us) == ("ulg", BUFFER_BYTES, -1)
    assert order.buffer == first + b"x" * 256
    assert (log.spool.at, log.spool.part_bytes) == (1, BUFFER_BYTES + 1)
    assert log.spool.buffer[:1] == b"y"
    assert log.spool.buffer is not order.buffer


def test_what_does_not_fit_into_the_rest_goes_whole_into_the_next_one() -> None:
    log = Log()
    log.spool.write(b"a" * (BUFFER_BYTES - 10))
    assert log.spool.write(b"b" * 11)
    (order,) = log.handed()
    assert order.length == BUFFER_BYTES - 10
    assert log.spool.buffer[:11] == b"b" * 11
    assert log.spool.part_bytes == BUFFER_BYTES + 1


def test_what_is_larger_than_a_buffer_finds_no_room_and_what_is_as_large_does() -> None:
    log = Log()
    assert not log.spool.room(BUFFER_BYTES + 1)
    assert not log.spool.write(b"c" * (BUFFER_BYTES + 1))
    assert (log.spool.at, log.spool.part_bytes, log.handed()) == (0, 0, [])
    assert log.spool.room(BUFFER_BYTES)
    assert log.spool.write(b"c" * BUFFER_BYTES)


def test_without_a_free_buffer_there_is_no_room_until_the_thread_gives_one_back() -> None:
    log = Log(1)
    log.spool.write(b"d" * BUFFER_BYTES)
    assert not log.spool.write(b"e")
    (order,) = log.handed()
    assert not log.spool.room(1)
    assert log.handed() == []  # nothing is handed over twice
    log.free.give_back(order.buffer)
    assert log.spool.write(b"e")
    assert log.spool.buffer is order.buffer
    assert log.spool.part_bytes == BUFFER_BYTES + 1


def test_a_part_begins_with_what_comes_next_and_its_bytes_are_counted_from_there() -> None:
    log = Log(4)
    log.spool.write(b"old")
    log.spool.begin_part(77)
    assert log.spool.part_bytes == 0
    log.spool.write(b"new one")
    log.spool.hand_over()
    log.spool.write(b"more")
    log.spool.hand_over()
    before, begins, goes_on = log.handed()
    assert (before.begins_us, before.length) == (-1, 3)
    assert (begins.begins_us, begins.length) == (77, 7)
    assert (goes_on.begins_us, goes_on.length) == (-1, 4)
    assert log.spool.part_bytes == 11
    log.spool.begin_part(0)  # a time like any other
    log.spool.write(b"z")
    log.spool.hand_over()
    assert log.handed()[-1].begins_us == 0


@pytest.mark.parametrize(("count", "least"), [(4, 3), (5, 3), (1, 1)])
def test_the_disk_keeps_up_while_more_than_half_of_the_buffers_are_free(
    count: int, least: int
) -> None:
    free = Buffers(count, patient=False)
    for left in range(count, -1, -1):
        assert free.plenty == (left >= least)
        taken = free.take()
        assert (taken is None) == (left == 0)
    patient = Buffers(1, patient=True)
    patient.take()
    assert patient.plenty  # it is waited for


def test_a_patient_loop_waits_for_a_buffer_and_another_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    free = Buffers(1, patient=True)
    buffer = free.take()
    assert buffer is not None
    later = threading.Timer(0.02, free.give_back, [buffer])
    later.start()
    assert free.take() is buffer
    later.join()
    # It does not wait for ever, and a loop that flies not at all.
    monkeypatch.setattr(spool, "STOP_S", 0.01)
    assert free.take() is None
    began_s = time.monotonic()
    monkeypatch.setattr(spool, "STOP_S", 9.0)
    assert Buffers(0, patient=False).take() is None
    assert time.monotonic() - began_s < 5.0


def test_the_buffers_of_a_log_hold_nearly_a_minute() -> None:
    """Wire and rows together are 60 kB in a second at the most; 3 MB are what they may cost."""
    held = BUFFER_BYTES * BUFFERS
    assert 50.0 * 60e3 <= held <= 3.3e6
