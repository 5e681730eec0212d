"""The stand-in's bytes of NatNet one after the other, read here by hand."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from tgl_soar.sim import natnet_frames
from tgl_soar.sim.natnet_frames import (
    CLOCK_HZ,
    VERSIONS,
    Scene,
    SimulatedBody,
    Version,
    encode_frame,
    encode_models,
    encode_server_info,
    message,
)

KITE = SimulatedBody(
    name="kite",
    id=0x18001,  # more than fits into a marker's half of a number
    position_m=(0.5, 1.25, -0.75),
    quaternion=(0.25, -0.5, 0.75, 0.125),
    error_m=0.0078125,
    markers=((1.0, 2.0, 3.0), (1.5, 2.5, 3.5)),
)
LOST = SimulatedBody(
    name="Ä", id=7, position_m=(4.0, 5.0, 6.0), quaternion=(0.0, 0.0, 0.0, 1.0), tracked=False
)
SCENE = Scene(
    number=4711,
    bodies=(KITE, LOST),
    time_s=12.625,
    exposed_ticks=70,
    received_ticks=71,
    sent_ticks=72,
    others=((7.0, 8.0, 9.0),),
    skeletons=((11, (LOST,)),),
    assets=((12, (LOST, KITE)),),
    plates=((13, ((0.5, 1.5), (2.5,))),),
    devices=((14, ((0.25,), ())),),
    timecode=(21, 22),
    precision=(31, 32),
    recording=True,
)


class Reading:
    """Takes what was packed, one after the other."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, kinds: str) -> tuple[float, ...]:
        found = struct.unpack_from("<" + kinds, self.data, self.at)
        self.at += struct.calcsize("<" + kinds)
        return found

    def whole(self) -> int:
        (number,) = self.take("i")
        return int(number)

    def text(self) -> str:
        end = self.data.index(b"\0", self.at)
        found, self.at = self.data[self.at : end].decode(), end + 1
        return found

    def body(self) -> tuple[float, ...]:
        return self.take("i7ffh")

    def marker(self) -> tuple[float, ...]:
        return self.take("i3ffhf")


KITE_BYTES: tuple[Any, ...] = (0x18001, 0.5, 1.25, -0.75, 0.25, -0.5, 0.75, 0.125, 0.0078125, 1)
LOST_BYTES: tuple[Any, ...] = (7, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 1.0, pytest.approx(0.0004), 0)
CASES = [*((version, True) for version in VERSIONS), ((4, 0), False)]


def test_messages_have_the_numbers_of_the_sdk() -> None:
    assert VERSIONS == ((3, 0), (3, 1), (4, 0), (4, 1), (4, 2))
    names = ("CONNECT", "SERVER_INFO", "REQUEST", "RESPONSE", "MODELS_REQUEST", "MODELS", "FRAME")
    assert [getattr(natnet_frames, name) for name in names] == [0, 1, 2, 3, 4, 5, 7]
    others = ("DISCONNECT", "KEEP_ALIVE", "ECHO_REQUEST", "ECHO_RESPONSE", "UNRECOGNIZED")
    assert [getattr(natnet_frames, name) for name in others] == [9, 10, 12, 13, 100]
    assert CLOCK_HZ == 10_000_000


def test_a_message_begins_with_its_number_and_the_length_of_what_follows() -> None:
    assert message(7, b"abc") == b"\x07\x00\x03\x00abc"
    assert message(100, b"") == b"\x64\x00\x00\x00"


@pytest.mark.parametrize(("version", "precise"), CASES)
def test_a_frame_is_its_sections_in_order_and_no_byte_more(version: Version, precise: bool) -> None:
    data = encode_frame(version, SCENE, precise_4_0=precise)
    assert struct.unpack_from("<HH", data) == (7, len(data) - 4)
    got = Reading(data[4:])
    assert got.whole() == 4711
    ends = []

    def section() -> int:
        count = got.whole()
        if version >= (4, 1):
            ends.append(got.whole() + got.at)
        return count

    def over() -> None:
        if version >= (4, 1):
            assert got.at == ends.pop()

    assert section() == 3  # marker sets: each body's, and all together
    own = [(1.0, 2.0, 3.0), (1.5, 2.5, 3.5)]
    for name, markers in (("kite", own), ("Ä", []), ("all", own)):
        assert (got.text(), got.whole()) == (name, len(markers))
        assert [got.take("3f") for _ in markers] == markers
    over()
    assert section() == 1  # other markers
    assert got.take("3f") == (7.0, 8.0, 9.0)
    over()
    assert section() == 2  # rigid bodies
    assert (got.body(), got.body()) == (KITE_BYTES, LOST_BYTES)
    over()
    assert section() == 1  # skeletons
    assert (got.whole(), got.whole(), got.body()) == (11, 1, LOST_BYTES)
    over()
    if version >= (4, 1):
        assert section() == 1  # assets
        assert (got.whole(), got.whole()) == (12, 2)
        assert (got.body(), got.body(), got.whole()) == (LOST_BYTES, KITE_BYTES, 2)
        for n, place in enumerate(own):
            number, *at, size, flags, residual = got.marker()
            assert (number, tuple(at), flags) == (n, place, 0)
            assert (size, residual) == pytest.approx((0.014, 0.0003))
        over()
    assert section() == 2  # labelled markers: of the body's number what fits, and from 1 on
    for n, place in enumerate(own, 1):
        number, *at, size, flags, residual = got.marker()
        assert (number, tuple(at), flags) == (0x10000 | n, place, 0x0A)
        assert (size, residual) == pytest.approx((0.014, 0.0003))
    over()
    assert section() == 1  # force plates
    assert (got.whole(), got.whole()) == (13, 2)
    assert (got.whole(), got.take("2f"), got.whole(), got.take("f")) == (2, (0.5, 1.5), 1, (2.5,))
    over()
    assert section() == 1  # devices
    assert (got.whole(), got.whole()) == (14, 2)
    assert (got.whole(), got.take("f"), got.whole()) == (1, (0.25,), 0)
    over()
    assert got.take("IId") == (21, 22, 12.625)
    assert got.take("QQQ") == (70, 71, 72)
    if version >= (4, 1) or (version == (4, 0) and precise):
        assert got.take("II") == (31, 32)
    assert got.take("hi") == (1, 0)  # it records, and an end mark
    assert got.at == len(got.data)


def test_a_4_0_has_the_precision_unless_it_is_switched_off() -> None:
    usual = encode_frame((4, 0), SCENE)
    assert usual == encode_frame((4, 0), SCENE, precise_4_0=True)
    assert len(usual) == len(encode_frame((4, 0), SCENE, precise_4_0=False)) + 8
    for version in ((3, 1), (4, 1)):
        assert encode_frame(version, SCENE) == encode_frame(version, SCENE, precise_4_0=False)


@pytest.mark.parametrize(
    ("recording", "changed", "flags"),
    [(False, False, 0), (True, False, 1), (False, True, 2), (True, True, 3)],
)
def test_a_frames_flags_say_what_records_and_what_has_changed(
    recording: bool, changed: bool, flags: int
) -> None:
    scene = Scene(
        number=1, bodies=(), time_s=0.0, exposed_ticks=0, received_ticks=0, sent_ticks=0,
        recording=recording, models_changed=changed,
    )  # fmt: skip
    for version in VERSIONS:
        assert struct.unpack("<hi", encode_frame(version, scene)[-6:]) == (flags, 0)


def test_a_scene_and_a_body_hold_nothing_that_is_not_said() -> None:
    scene = Scene(number=1, bodies=(), time_s=0.0, exposed_ticks=0, received_ticks=0, sent_ticks=0)
    empty = (scene.others, scene.skeletons, scene.assets, scene.plates, scene.devices)
    assert empty == ((), (), (), (), ())
    assert (scene.timecode, scene.precision) == ((0, 0), (0, 0))
    assert (scene.recording, scene.models_changed) == (False, False)
    assert (LOST.error_m, LOST.markers, KITE.tracked) == (0.0004, (), True)


@pytest.mark.parametrize("version", VERSIONS)
def test_definitions_are_marker_sets_then_rigid_bodies_then_a_camera(version: Version) -> None:
    data = encode_models(version, (KITE, LOST))
    assert struct.unpack_from("<HH", data) == (5, len(data) - 4)
    got = Reading(data[4:])
    assert got.whole() == 5
    end = -1

    def model(kind: int) -> None:
        nonlocal end
        assert got.whole() == kind
        if version >= (4, 1):
            assert end in (-1, got.at - 4)
            end = got.whole() + got.at

    for name, markers in (("kite", ["Marker1", "Marker2"]), ("Ä", [])):
        model(0)
        assert (got.text(), got.whole()) == (name, len(markers))
        assert [got.text() for _ in markers] == markers
    # Of the kite its markers' places less its own.
    offsets = [(0.5, 0.75, 3.75), (1.0, 1.25, 4.25)]
    for name, number, places in (("kite", 0x18001, offsets), ("Ä", 7, [])):
        model(1)
        assert (got.text(), got.take("ii3f")) == (name, (number, -1, 0.0, 0.0, 0.0))
        if version >= (4, 2):
            assert got.take("4f") == (0.0, 0.0, 0.0, 1.0)
        assert got.whole() == len(places)
        assert [got.take("3f") for _ in places] == places
        assert [got.whole() for _ in places] == [0] * len(places)
        if version >= (4, 0):
            assert [got.text() for _ in places] == ["Marker1", "Marker2"][: len(places)]
    model(5)
    assert got.text() == "Prime 13 #1"
    assert got.take("7f") == (0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert got.at == len(got.data) == (end if version >= (4, 1) else got.at)


def test_a_server_says_its_name_versions_clock_and_where_it_streams() -> None:
    for multicast in (False, True):
        data = encode_server_info(
            (4, 2), clock_hz=123, data_port=1511, group="239.255.42.99", multicast=multicast
        )
        assert struct.unpack_from("<HH", data) == (1, len(data) - 4)
        name, *numbers = struct.unpack("<256s4B4BQHB4B", data[4:])
        assert name.rstrip(b"\0") == b"Motive"
        assert numbers == [3, 1, 0, 0, 4, 2, 0, 0, 123, 1511, multicast, 239, 255, 42, 99]
    usual = encode_server_info((3, 0), data_port=1, group="0.0.0.0", multicast=False)
    assert struct.unpack_from("<Q", usual, 4 + 264) == (10_000_000,)
