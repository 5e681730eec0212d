"""Frames over a serial line: a pseudo-terminal at 921600, and all that such a line does."""

from __future__ import annotations

import os
import pty
import random
import select
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.messages import AttitudeQuaternion, Heartbeat
from tgl_soar.link.open_link import open_link
from tgl_soar.link.transports.base import Transport
from tgl_soar.link.transports.byte_stream import RETRY_S
from tgl_soar.link.transports.serial_line import SerialLink


class Line:
    """The far end, and a device name that can be pulled out and plugged in again."""

    def __init__(self, folder: Path) -> None:
        self.device = folder / "ttyTEST"
        self.far = -1
        self.plug()

    def plug(self) -> None:
        self.far, near = pty.openpty()
        tty.setraw(near)
        self.device.unlink(missing_ok=True)
        self.device.symlink_to(os.ttyname(near))
        os.close(near)

    def pull(self) -> None:
        os.close(self.far)
        self.far = -1
        self.device.unlink()


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    made = Line(tmp_path)
    yield made
    if made.far >= 0:
        os.close(made.far)


def opened(line: Line) -> SerialLink:
    link = open_link(f"serial:{line.device}:921600", lambda _: True)
    assert isinstance(link, SerialLink)
    return link


def attitudes(count: int, first: int = 0) -> list[bytes]:
    mav = mavlink.MAVLink(None, 1, 1)
    frames = []
    for i in range(first, first + count):
        mav.seq = i & 0xFF
        message = mavlink.MAVLink_attitude_quaternion_message(i, 1, 0, 0, 0, 0.5, 0, 0)
        frames.append(bytes(message.pack(mav)))
    return frames


def stamps(link: SerialLink, decoder: Decoder, now_s: float = 0.0) -> list[int]:
    """Of what has come."""
    found = []
    while link.fileno() >= 0 and select.select([link.fileno()], [], [], 0.05)[0]:
        for data in link.receive(now_s):
            for received in decoder.feed(data):
                assert isinstance(received.message, AttitudeQuaternion | Heartbeat)
                if isinstance(received.message, AttitudeQuaternion):
                    found.append(received.message.time_boot_ms)
    return found


def test_the_line_has_the_rate_that_was_asked_for_and_passes_every_byte(line: Line) -> None:
    link = opened(line)
    settings = termios.tcgetattr(link.fileno())
    assert settings[4] == settings[5] == termios.B921600
    assert not settings[3] & (termios.ICANON | termios.ECHO)
    assert not settings[0] & (termios.IXON | termios.ICRNL)
    os.write(line.far, bytes(range(256)))
    select.select([link.fileno()], [], [], 2.0)
    assert link.receive(0.0) == [bytes(range(256))]
    link.close()


@pytest.mark.parametrize("seed", range(3))
def test_pieces_and_garbage_between_them_cost_no_frame(line: Line, seed: int) -> None:
    noise = random.Random(seed)
    link, decoder = opened(line), Decoder(stream=True)
    frames = attitudes(200)
    stream = b"".join(
        frame + (noise.randbytes(noise.randrange(30)).replace(b"\xfd", b"?").replace(b"\xfe", b"?"))
        for frame in frames
    )
    found, at = [], 0
    while at < len(stream):
        size = noise.randrange(1, 120)
        os.write(line.far, stream[at : at + size])
        at += size
        if noise.random() < 0.3:
            found += stamps_now(link, decoder)
    found += stamps(link, decoder)
    assert found == list(range(200))
    assert decoder.counters.bad_checksums == 0
    link.close()


def stamps_now(link: SerialLink, decoder: Decoder) -> list[int]:
    """One read, as the loop does it."""
    return [
        received.message.time_boot_ms
        for data in link.receive(0.0)
        for received in decoder.feed(data)
        if isinstance(received.message, AttitudeQuaternion)
    ]


def test_markers_in_the_garbage_hold_frames_back_but_cost_none(line: Line) -> None:
    link, decoder = opened(line), Decoder(stream=True)
    frames = attitudes(40)
    os.write(line.far, b"\xfd\xff\x00" + b"".join(frames[:20]))
    os.write(line.far, b"\xfe\xff" + b"".join(frames[20:]))
    assert stamps(link, decoder) == list(range(40))
    link.close()


def test_a_frame_cut_by_a_hang_up_is_forgotten_and_the_next_ones_are_read(line: Line) -> None:
    link, decoder = opened(line), Decoder(stream=True)
    before, after = attitudes(3), attitudes(3, first=10)
    os.write(line.far, b"".join(before)[:-5])
    assert stamps(link, decoder, 1.0) == [0, 1]
    generation = link.generation
    line.pull()
    assert stamps(link, decoder, 1.1) == []
    assert link.fileno() == -1
    assert not link.send(b"lost")
    line.plug()
    link.receive(1.1 + RETRY_S)
    assert link.fileno() >= 0
    assert link.generation == generation + 1
    decoder.reset()  # as the module does when the generation has changed
    os.write(line.far, b"".join(after))
    assert stamps(link, decoder, 3.0) == [10, 11, 12]
    assert link.send(b"back")
    assert os.read(line.far, 100) == b"back"
    link.close()


def received(link: Transport, now_s: float = 0.0) -> list[bytes]:
    select.select([link.fileno()], [], [], 2.0)
    return link.receive(now_s)


def test_a_serial_line_carries_both_ways(line: Line) -> None:
    far, link = line.far, opened(line)
    assert link.is_stream
    assert link.receive(0.0) == []
    os.write(far, b"\xfd\x00half a fra")
    assert received(link) == [b"\xfd\x00half a fra"]
    assert link.send(b"\x00\x11\x13\xff")
    assert os.read(far, 100) == b"\x00\x11\x13\xff"
    link.close()
    link.close()


def test_a_serial_line_that_does_not_drain_drops_whole_frames(line: Line) -> None:
    far = line.far
    link = open_link(f"serial:{line.device}", lambda _: True)
    frames = [bytes((i % 251,)) * 100 for i in range(3000)]
    sent = [frame for frame in frames if link.send(frame)]
    assert link.counters.dropped_out == len(frames) - len(sent) > 0
    got = b""
    while len(got) < 100 * len(sent):
        got += os.read(far, 4096)
        link.receive(0.0)
    assert got == b"".join(sent)
    link.close()


def test_a_serial_line_that_hangs_up_is_tried_once_a_second(line: Line) -> None:
    link = open_link(f"serial:{line.device}:115200", lambda _: True)
    line.pull()
    assert received(link, 1.0) == []
    assert link.fileno() == -1
    assert link.receive(2.5) == []
    assert link.fileno() == -1
    line.plug()
    assert link.receive(2.6) == []
    assert link.fileno() == -1  # not yet: it was tried at 2.5
    link.receive(3.6)
    assert link.fileno() >= 0
    os.write(line.far, b"back")
    assert received(link, 3.7) == [b"back"]
    link.close()
