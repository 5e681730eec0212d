"""NatNet's bytes, laid out here by hand: each size, each count from both sides, each request.

Numbers are those of PacketClient.cpp and NatNetTypes.h of the NatNet SDK.
"""

from __future__ import annotations

import struct
from typing import Any

import pytest
from natnet.nat_net_client import NatNetClient as OtherClient
from natnetsdk.NatNetClient import NatNetClient

from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.layout import Malformed

FRAME, MODELS, SERVER_INFO, ECHO_RESPONSE = 7, 5, 1, 13
WANTED = 7
SUFFIX = struct.pack("<IIdQQQh", 11, 22, 12.5, 1000, 2000, 3000, 2)
PRECISE = struct.pack("<IIdQQQIIh", 11, 22, 12.5, 1000, 2000, 3000, 33, 44, 2)
STEPS = 4096  # entries that are walked
NOTHING = struct.pack("<i", 0)


def message(number: int, payload: bytes) -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


def body(number: int, x: float = 0.5, *, flags: int = 1, more: bytes = b"") -> bytes:
    return struct.pack("<i3f4ffh", number, x, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8, 0.001, flags) + more


def counted(*entries: bytes) -> bytes:
    return struct.pack("<i", len(entries)) + b"".join(entries)


def walked(
    *bodies: bytes,
    sets: bytes = NOTHING,
    others: bytes = NOTHING,
    skeletons: bytes = NOTHING,
    labelled: bytes = NOTHING,
    plates: bytes = NOTHING,
    devices: bytes = NOTHING,
    end: bytes = SUFFIX,
) -> bytes:
    """A frame of a version whose sections have no sizes."""
    sections = (sets, others, counted(*bodies), skeletons, labelled, plates, devices)
    return message(FRAME, struct.pack("<i", 4711) + b"".join(sections) + end)


def sized(
    *bodies: bytes, count: int | None = None, size: int | None = None, end: bytes = PRECISE
) -> bytes:
    """A frame of a version whose eight sections have them; count and size of the bodies may lie."""
    data = struct.pack("<i", 4711)
    for section in range(8):
        entries = b"".join(bodies) if section == 2 else bytes(3 * section)
        numbers = (len(bodies), len(entries)) if section == 2 else (section, len(entries))
        if section == 2:
            numbers = (
                numbers[0] if count is None else count,
                numbers[1] if size is None else size,
            )
        data += struct.pack("<ii", *numbers) + entries
    return message(FRAME, data + end)


def x_of(data: bytes, version: layout.Version, wanted: int = WANTED) -> float | None:
    found = layout.frame_of(data, version, wanted).body
    return None if found is None else found.x_m


# --- messages ------------------------------------------------------------------------------------


def test_a_message_is_as_long_as_it_says_or_longer() -> None:
    assert layout.message_of(message(300, b"")) == 300
    assert layout.message_of(message(7, b"abc") + b"more") == 7
    for size in range(4):
        with pytest.raises(Malformed, match=f"{size} bytes are no message"):
            layout.message_of(message(7, b"")[:size])
    with pytest.raises(Malformed, match="cut off: 2 of 3 bytes"):
        layout.message_of(message(7, b"abc")[:-1])


def test_every_field_of_a_frame_has_its_place() -> None:
    for data, version, precise in ((walked(body(WANTED)), (3, 0), (0, 0)),
                                   (sized(body(WANTED)), (4, 2), (33, 44))):  # fmt: skip
        frame = layout.frame_of(data, version, WANTED)
        assert frame.number == 4711
        assert frame.bodies == 1
        assert frame[3:] == (11, 22, 12.5, 1000, 2000, 3000, *precise, 2)
        assert frame.body is not None
        assert frame.body[1:8] == pytest.approx((0.5, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8))
        assert frame.body.error_m == pytest.approx(0.001)


@pytest.mark.parametrize(("flags", "tracked"), [(0, False), (1, True), (2, False), (3, True)])
def test_a_body_is_tracked_by_the_lowest_bit_of_its_flags(flags: int, tracked: bool) -> None:
    found = layout.frame_of(walked(body(WANTED, flags=flags)), (3, 0), WANTED).body
    assert found is not None
    assert found.is_tracked == tracked


@pytest.mark.parametrize(("flags", "changed"), [(0, False), (1, False), (2, True), (3, True)])
def test_definitions_have_changed_by_the_second_bit_of_a_frame_s(flags: int, changed: bool) -> None:
    data = walked(body(WANTED), end=SUFFIX[:-2] + struct.pack("<h", flags))
    assert layout.frame_of(data, (3, 0), WANTED).models_changed == changed


# --- one body among others -----------------------------------------------------------------------


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
def test_a_number_that_only_looks_like_the_wanted_id_is_no_body(version: layout.Version) -> None:
    """The float of 7.0 · 2⁻¹⁴⁹ has the bytes of the number 7."""
    (looks,) = struct.unpack("<f", struct.pack("<i", WANTED))
    make = walked if version < (4, 1) else sized
    assert x_of(make(body(3, looks), body(WANTED, 5.0)), version) == 5.0
    assert x_of(make(body(3, looks), body(4), body(WANTED, 6.0), body(9)), version) == 6.0
    assert x_of(make(body(3, looks), body(4)), version) is None
    assert x_of(make(), version) is None


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
def test_what_stands_behind_the_bodies_is_none(version: layout.Version) -> None:
    end = SUFFIX if version < (4, 1) else PRECISE
    looks = struct.pack("<i", WANTED) + end[4:]  # the time code
    make = walked if version < (4, 1) else sized
    assert x_of(make(body(3), end=looks), version) is None


def test_bodies_of_a_later_version_may_be_longer() -> None:
    data = sized(body(3, more=bytes(8)), body(WANTED, 5.0, more=bytes(8)))
    assert x_of(data, (4, 2)) == 5.0
    assert [found.id for found in layout.bodies_of(data, (4, 2))] == [3, WANTED]


@pytest.mark.parametrize(
    ("count", "size"), [(2, 74), (2, 75), (2, 77), (3, 76), (-1, 76), (2, 10_000), (2, -1), (1, 0)]
)
def test_bodies_that_do_not_fill_their_section_evenly_are_refused(count: int, size: int) -> None:
    data = sized(body(3), body(WANTED), count=count, size=size)
    with pytest.raises(Malformed, match=f"{count} .*{size} bytes"):
        layout.frame_of(data, (4, 2), WANTED)


def test_a_section_without_entries_may_have_bytes_and_one_with_them_none() -> None:
    data = sized(body(3), count=0)
    assert layout.frame_of(data, (4, 2), WANTED).bodies == 0
    assert layout.bodies_of(data, (4, 2)) == []


@pytest.mark.parametrize("section", range(8))
def test_no_section_reaches_beyond_the_end(section: int) -> None:
    """The bytes that are left are all that a size may claim."""
    for excess, fits in ((0, True), (1, False)):
        data = struct.pack("<i", 1) + struct.pack("<ii", 0, 0) * section
        data += struct.pack("<ii", 0, 5 + excess) + bytes(5)
        with pytest.raises(Malformed, match="ends too early" if fits else f"section {section} of"):
            layout.frame_of(message(FRAME, data), (4, 2), WANTED)


@pytest.mark.parametrize("version", [(3, 0), (4, 0), (4, 1), (4, 2)])
@pytest.mark.parametrize(("tail", "fits"), [(0, True), (4, True), (1, False), (8, False)])
def test_nothing_but_an_end_mark_may_follow(version: layout.Version, tail: int, fits: bool) -> None:
    make, end = (walked, SUFFIX) if version < (4, 1) else (sized, PRECISE)
    data = make(body(WANTED), end=end + bytes(tail))
    if version == (4, 0) and tail == 8:  # it has the length of a frame with precision time
        assert layout.frame_of(data, version, WANTED).flags == 0  # the last of the eight
        return
    if fits:
        assert layout.frame_of(data, version, WANTED).sent_ticks == 3000
    else:
        with pytest.raises(Malformed, match=f"{tail} bytes follow its end"):
            layout.frame_of(data, version, WANTED)


def test_behind_a_frame_of_a_newer_version_there_may_be_more() -> None:
    data = sized(body(WANTED), end=PRECISE + bytes(9))
    assert layout.frame_of(data, (4, 3), WANTED).sent_ticks == 3000
    with pytest.raises(Malformed):
        layout.frame_of(data, (4, 2), WANTED)


# --- what is walked ------------------------------------------------------------------------------


def test_sections_without_sizes_are_walked_by_their_entries() -> None:
    data = walked(
        body(WANTED, 5.0),
        sets=counted(b"one\0" + counted(bytes(12), bytes(12)), b"\0" + counted()),
        others=counted(bytes(12), bytes(12), bytes(12)),
        skeletons=counted(struct.pack("<i", 1) + counted(body(1), body(2))),
        labelled=counted(bytes(26), bytes(26)),
        plates=counted(struct.pack("<i", 1) + counted(counted(bytes(4), bytes(4)), counted())),
        devices=counted(struct.pack("<i", 1) + counted(counted(bytes(4)))),
    )
    frame = layout.frame_of(data, (3, 0), WANTED)
    assert frame.body is not None
    assert (frame.body.x_m, frame.sent_ticks) == (5.0, 3000)
    assert [found.id for found in layout.bodies_of(data, (3, 0))] == [WANTED]


@pytest.mark.parametrize(("devices", "fits"), [(1, True), (2, False)])
def test_4096_entries_are_walked_and_no_more(devices: int, fits: bool) -> None:
    """A set takes two steps, its name and its markers; then come other markers, bodies, labelled
    markers, and each device."""
    sets = (STEPS - 4) // 2
    data = walked(
        sets=counted(*[b"\0" + NOTHING] * sets),
        devices=counted(*[NOTHING + NOTHING] * devices),
    )
    if fits:
        assert layout.frame_of(data, (3, 0), WANTED).sent_ticks == 3000
    else:
        with pytest.raises(Malformed, match="more than 4096 entries"):
            layout.frame_of(data, (3, 0), WANTED)


@pytest.mark.parametrize(("letters", "fits"), [(255, True), (256, False)])
def test_a_name_ends_within_256_bytes(letters: int, fits: bool) -> None:
    data = walked(sets=counted(b"x" * letters + b"\0" + NOTHING))
    if fits:
        assert layout.frame_of(data, (3, 0), WANTED).sent_ticks == 3000
    else:
        with pytest.raises(Malformed, match="a name without an end"):
            layout.frame_of(data, (3, 0), WANTED)


def test_no_more_is_counted_than_there_are_bytes() -> None:
    left = len(walked()) - 4 - 2 * 4  # behind the header, the frame's number and the count
    for count in (-1, left + 1, 10**9):
        data = walked(sets=struct.pack("<i", count))
        with pytest.raises(Malformed, match=f"{count} entries in {left} bytes"):
            layout.frame_of(data, (3, 0), WANTED)
    end = message(FRAME, struct.pack("<ii", 1, 3) + b"ab\0")  # as many as bytes: each could be one
    with pytest.raises(Malformed, match="it ends too early"):
        layout.frame_of(end, (3, 0), WANTED)


def test_bodies_may_be_the_last_that_there_is() -> None:
    whole = sized(body(3), body(WANTED))
    behind = whole[: whole.index(body(WANTED)) + len(body(WANTED))]
    assert [found.id for found in layout.bodies_of(behind, (4, 2))] == [3, WANTED]
    with pytest.raises(Malformed, match="2 rigid bodies in 76 bytes"):
        layout.bodies_of(behind[:-1], (4, 2))


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
def test_bodies_that_are_cut_off_are_refused(version: layout.Version) -> None:
    data = message(FRAME, struct.pack("<i", 1) + bytes(3))
    for read in (lambda: layout.bodies_of(data, version), lambda: x_of(data, version)):
        with pytest.raises(Malformed, match="it ends too early"):
            read()


# --- the server ----------------------------------------------------------------------------------


def server(clock_hz: int, name: bytes = b"Motive", multicast: int = 1) -> bytes:
    """sSender_Server: sender, clock frequency, port, whether it is multicast, group."""
    payload = name.ljust(256, b"\0") + bytes((3, 1, 2, 4)) + bytes((4, 2, 9, 9))
    payload += struct.pack("<QHB", clock_hz, 1511, multicast) + bytes((239, 255, 42, 99))
    return message(SERVER_INFO, payload)


def test_a_server_s_presentation_is_read_field_by_field() -> None:
    info = layout.server_info_of(server(10_000_000, "Bühne".encode()))
    assert info.name == "Bühne"
    assert (info.application, info.version) == ((3, 1, 2, 4), (4, 2))
    assert (info.clock_hz, info.data_port, info.group) == (10_000_000, 1511, "239.255.42.99")
    assert info.is_multicast
    assert not layout.server_info_of(server(1000, multicast=0)).is_multicast
    with pytest.raises(Malformed, match="ends too early"):
        layout.server_info_of(server(1000)[:-1])


@pytest.mark.parametrize(
    ("clock_hz", "fits"), [(999, False), (1000, True), (10**10, True), (10**10 + 1, False)]
)
def test_a_clock_counts_from_a_thousand_to_ten_thousand_million_a_second(
    clock_hz: int, fits: bool
) -> None:
    if fits:
        assert layout.server_info_of(server(clock_hz)).clock_hz == clock_hz
    else:
        with pytest.raises(Malformed, match=f"a clock of {clock_hz} Hz"):
            layout.server_info_of(server(clock_hz))


# --- definitions ---------------------------------------------------------------------------------


def body_model(name: bytes, number: int, version: layout.Version, markers: int = 2) -> bytes:
    """Name, id, parent, position, and the markers' positions, labels and (from 4.0 on) names."""
    data = name + b"\0" + struct.pack("<ii3f", number, -1, 1.0, 2.0, 3.0)
    if version >= (4, 2):
        data += bytes(16)  # an orientation
    data += struct.pack("<i", markers) + bytes(12 * markers) + bytes(4 * markers)
    return data + (b"m\0" * markers if version >= (4, 0) else b"")


PLATE = struct.pack("<i", 1) + b"serial\0" + struct.pack("<5f", *range(5)) + bytes(4 * 144)
PLATE += bytes(4 * 12) + struct.pack("<iii", 1, 2, 2) + b"Fx\0Fy\0"
DEVICE = struct.pack("<i", 1) + b"name\0serial\0" + struct.pack("<iii", 1, 2, 2) + b"a\0bc\0"
CAMERA = b"Prime\0" + bytes(12 + 16)
OTHERS = {0: b"set\0" + struct.pack("<i", 2) + b"a\0b\0", 3: PLATE, 4: DEVICE, 5: CAMERA}


def models(version: layout.Version, *entries: tuple[int, bytes]) -> bytes:
    data = struct.pack("<i", len(entries))
    for kind, content in entries:
        size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
        data += struct.pack("<i", kind) + size + content
    return message(MODELS, data)


@pytest.mark.parametrize("version", [(3, 0), (4, 0), (4, 1), (4, 2)])
@pytest.mark.parametrize("kind", OTHERS)
def test_definitions_of_other_kinds_are_stepped_over(version: layout.Version, kind: int) -> None:
    first, second = body_model(b"one", 5, version), body_model(b"two", 6, version, markers=0)
    data = models(version, (kind, OTHERS[kind]), (1, first), (kind, OTHERS[kind]), (1, second))
    assert layout.models_of(data, version) == {"one": 5, "two": 6}


@pytest.mark.parametrize("kind", [2, 6, 40])
def test_of_skeletons_and_what_is_not_known_only_a_size_tells_the_length(kind: int) -> None:
    for version, found in (((4, 0), {"one": 5}), ((4, 1), {"one": 5, "two": 6})):
        first, second = body_model(b"one", 5, version), body_model(b"two", 6, version)
        data = models(version, (1, first), (kind, bytes(10)), (1, second))
        assert layout.models_of(data, version) == found


def test_definitions_that_are_cut_off_are_refused() -> None:
    data = models((3, 0), (1, body_model(b"one", 5, (3, 0))))
    for cut in (1, 5, 30):
        with pytest.raises(Malformed, match=r"it ends too early|entries in"):
            layout.models_of(data[:-cut], (3, 0))


# --- asking --------------------------------------------------------------------------------------


class Sent:
    """In a socket's place: keeps what a packaged client would send."""

    def __init__(self) -> None:
        self.data = b""

    def sendto(self, data: bytes, _address: Any) -> int:
        self.data = data
        return len(data)


def test_the_question_who_is_there_is_the_vendor_s_with_our_version_in_it() -> None:
    """Its sample counts one byte more than the 270 that it fills, and leaves sSender's versions."""
    sent = Sent()
    NatNetClient().send_request(sent, NatNetClient.NAT_CONNECT, "", ("", 1510))
    asked = layout.connect_request((4, 1))
    assert asked[:4] == struct.pack("<HH", 0, 270)
    assert len(asked) == 4 + 270
    sender = slice(4 + 256, 4 + 264)
    assert asked[sender] == bytes((4, 1, 0, 0)) * 2
    assert asked[4 : 4 + 256] == sent.data[4 : 4 + 256]
    assert asked[4 + 264 :] == sent.data[4 + 264 : 4 + 270]
    assert layout.connect_request() == layout.connect_request((4, 2))  # the newest that is read


def test_the_other_questions_have_the_numbers_of_both_packaged_clients() -> None:
    for client in (NatNetClient, OtherClient):
        assert layout.message_of(layout.keep_alive()) == client.NAT_KEEPALIVE
        assert layout.message_of(layout.disconnect()) == client.NAT_DISCONNECT
        assert layout.message_of(layout.models_request()) == client.NAT_REQUEST_MODELDEF
        assert layout.message_of(layout.connect_request()) == client.NAT_CONNECT
        assert layout.SERVER_INFO == client.NAT_SERVERINFO
        assert (layout.MODELS, layout.FRAME) == (client.NAT_MODELDEF, client.NAT_FRAMEOFDATA)
        assert layout.UNRECOGNIZED == client.NAT_UNRECOGNIZED_REQUEST
    assert [len(layout.keep_alive()), len(layout.disconnect())] == [4, 4]
    assert layout.models_request() == struct.pack("<HH", 4, 0)
    # A mask of kinds: bit 1 for rigid bodies, which are kind 1.
    assert layout.models_request(masked=True) == struct.pack("<HHi", 4, 4, 0b10)


def test_an_echo_brings_our_stamp_back_with_the_server_s_ticks() -> None:
    stamp, ticks = 2**63 + 5, 2**60 + 7
    asked = layout.echo_request(stamp)
    assert asked == struct.pack("<HHQ", 12, 8, stamp)
    answer = message(ECHO_RESPONSE, asked[4:] + struct.pack("<Q", ticks))
    assert layout.message_of(answer) == layout.ECHO_RESPONSE
    assert layout.echo_of(answer) == (stamp, ticks)
    with pytest.raises(Malformed, match="ends too early"):
        layout.echo_of(answer[:-1])
