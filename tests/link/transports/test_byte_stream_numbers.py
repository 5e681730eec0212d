"""What waits for a line, how much of it, and when a line that is lost is tried again.

The kernel is made up: it takes so many bytes, or none, or says that the line is gone.
"""

from __future__ import annotations

import errno
import os

import pytest

from tgl_soar.link.transports.byte_stream import ByteStream

# The kernel's part is put in the place of the real one.
pytestmark = pytest.mark.interpreted


class Kernel:
    """The far side of a descriptor."""

    def __init__(self) -> None:
        self.takes = 10**9  # bytes at once; 0: it would block
        self.taken = b""
        self.has = b""  # to be read
        self.is_gone = False
        self.hung_up = False

    def write(self, _fd: int, data: bytes) -> int:
        if self.is_gone:
            raise OSError(errno.EIO, "gone")
        if self.takes == 0:
            raise BlockingIOError
        self.taken += bytes(data[: self.takes])
        return min(self.takes, len(data))

    def read(self, _fd: int, most: int) -> bytes:
        if self.is_gone:
            raise OSError(errno.EIO, "gone")
        if not self.has and not self.hung_up:
            raise BlockingIOError
        data, self.has = self.has[:most], self.has[most:]
        return data


class Line(ByteStream):
    """One that can be opened again, or not."""

    def __init__(self) -> None:
        super().__init__("line")
        self.tried_s: list[float] = []
        self.released = 0
        self.is_there = True

    def _reopen(self, now_s: float) -> bool:
        self.tried_s.append(now_s)
        if self.is_there:
            self._fd = 7
        return self.is_there

    def _release(self) -> None:
        self.released += 1


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Kernel:
    made = Kernel()
    monkeypatch.setattr(os, "write", made.write)
    monkeypatch.setattr(os, "read", made.read)
    return made


@pytest.fixture
def line(kernel: Kernel) -> Line:
    assert kernel.takes > 0
    made = Line()
    assert made.receive(0.0) == []
    assert made.fileno() == 7
    made.counters.reconnects = made.generation = 0
    return made


def test_a_line_is_a_stream_on_which_nothing_is_cut_for_a_release(line: Line) -> None:
    assert line.is_stream
    assert not line.clear_for_release()
    assert line.name == "line"


def test_a_line_that_was_never_open_is_tried_at_once(kernel: Kernel) -> None:
    line = Line()
    assert line.fileno() == -1
    assert not line.send(b"frame")
    assert (line.counters.dropped_out, line.counters.bytes_out) == (1, 0)
    line.close()
    assert line.released == 0  # there is nothing to close
    kernel.has = b"abc"
    assert line.receive(0.5) == [b"abc"]
    assert line.tried_s == [0.5]
    assert (line.counters.reconnects, line.generation) == (1, 1)


def test_a_kibibyte_waits_and_what_would_be_more_is_dropped_whole(
    kernel: Kernel, line: Line
) -> None:
    kernel.takes = 0
    assert line.send(b"a" * 1000)
    assert not line.send(b"b" * 25)
    assert line.send(b"c" * 24)
    assert not line.send_command(b"d")
    assert (line.counters.dropped_out, line.counters.bytes_out) == (2, 0)
    kernel.takes = 600
    assert line.receive(0.0) == []  # which writes, too
    assert (len(kernel.taken), line.counters.bytes_out) == (600, 600)
    assert line.send(b"e" * 300)
    assert line.counters.bytes_out == 1200
    kernel.takes = 10**9
    line.receive(0.0)
    assert kernel.taken == b"a" * 1000 + b"c" * 24 + b"e" * 300
    assert line.counters.bytes_out == len(kernel.taken)
    assert line.counters.dropped_out == 2


def test_a_frame_goes_out_at_once_where_there_is_room(kernel: Kernel, line: Line) -> None:
    assert line.send(b"one")
    assert line.send_command(b"two")
    assert kernel.taken == b"onetwo"
    assert line.counters.bytes_out == 6


def test_what_a_broken_line_does_not_take_is_dropped_and_counted_once(
    kernel: Kernel, line: Line
) -> None:
    kernel.takes = 0
    line.send(b"waits")
    kernel.is_gone = True
    assert not line.send(b"frame")
    assert line.counters.dropped_out == 1
    kernel.is_gone, kernel.takes = False, 100
    assert line.send(b"next")
    assert kernel.taken == b"next"  # nothing of before


def test_one_read_takes_sixteen_kibibytes_and_the_next_the_rest(kernel: Kernel, line: Line) -> None:
    kernel.has = bytes(range(256)) * 80
    first, second = line.receive(0.0), line.receive(0.0)
    assert [len(part) for part in (*first, *second)] == [16384, 20480 - 16384]
    assert line.counters.bytes_in == 20480
    assert line.receive(0.0) == []
    assert line.fileno() == 7  # that nothing comes is no end


@pytest.mark.parametrize("end", ["is_gone", "hung_up"])
def test_a_lost_line_is_closed_once_and_tried_again_after_a_second_each_time(
    kernel: Kernel, line: Line, end: str
) -> None:
    setattr(kernel, end, True)
    line.tried_s.clear()
    line.is_there = False
    assert line.receive(50.0) == []
    assert (line.fileno(), line.released) == (-1, 1)
    for hundredths in range(5000, 5350):
        line.receive(hundredths / 100.0)
    assert line.tried_s == pytest.approx([51.0, 52.0, 53.0])
    assert (line.counters.reconnects, line.generation) == (0, 0)
    setattr(kernel, end, False)
    line.is_there = True
    kernel.has = b"again"
    assert line.receive(54.0) == [b"again"]
    assert (line.counters.reconnects, line.generation) == (1, 1)
    line.close()
    line.close()
    assert line.released == 2
