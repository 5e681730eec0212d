"""The decoder against the stand-in's bytes, against both packaged clients, and against nonsense.

What the packaged clients get wrong, so that nothing is compared there:

    natnet 0.3.0      never reads the precision time stamp, so from 4.1 on (and from 4.0 on where
                      4.0 has it) it takes its first half for the flags; drops the server's clock
                      frequency, data port and multicast address; takes ids as unsigned
    natnetsdk 4.1.1   reads the precision time stamp from 4.0 on, whether or not it is there; takes
                      clock ticks as signed; gives residuals in millimetres; does not know the
                      quaternion of a 4.2 rigid body's definition; prints every frame it is fed
"""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.server_info import ServerInfo
from natnet.version import Version
from natnetsdk.NatNetClient import NatNetClient

from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.layout import Malformed, MocapFrame, RigidBody
from tgl_soar.sim.natnet_frames import (
    VERSIONS,
    Scene,
    SimulatedBody,
    encode_frame,
    encode_models,
    encode_server_info,
)

TICKS = 10_000_000
BODIES = tuple(
    SimulatedBody(
        name=name,
        id=number,
        position_m=(0.5 * number, 1.25, -0.75),
        quaternion=(0.0, 0.6, 0.0, 0.8),
        error_m=0.0005 * number,
        tracked=number != 2,
        markers=tuple((0.1 * i, 1.0, float(number)) for i in range(3)),
    )
    for name, number in (("aircraft", 1), ("Stuhl Ä", 2), ("wand", 70000))
)
SCENE = Scene(
    number=4711,
    bodies=BODIES,
    time_s=12.625,
    exposed_ticks=7 * TICKS,
    received_ticks=7 * TICKS + 40_000,
    sent_ticks=7 * TICKS + 90_000,
    others=((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
    skeletons=((9, BODIES[:2]),),
    assets=((3, BODIES[1:]),),
    plates=((1, ((0.5, 1.5), (2.5,))),),
    devices=((2, ((0.25,), ())),),
    timecode=(11, 22),
    precision=(33, 44),
    models_changed=True,
)
CASES = [*((version, True) for version in VERSIONS), ((4, 0), False)]
each = pytest.mark.parametrize(("version", "precise"), CASES)


def encoded(version: layout.Version, precise: bool = True, scene: Scene = SCENE) -> bytes:
    return encode_frame(version, scene, precise_4_0=precise)


def as_float32(*values: float) -> tuple[float, ...]:
    return struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values))


# --- what the stand-in sends ----------------------------------------------------------------


@each
def test_a_frame_is_read_back(version: layout.Version, precise: bool) -> None:
    data = encoded(version, precise)
    assert layout.message_of(data) == layout.FRAME
    for body in BODIES:
        frame = layout.frame_of(data, version, body.id)
        assert frame.body is not None
        pose = as_float32(*body.position_m, *body.quaternion, body.error_m)
        assert frame.body == (body.id, *pose, int(body.tracked))
        assert frame.body.is_tracked == body.tracked
        has_precision = version >= (4, 1) or (version == (4, 0) and precise)
        assert frame[2:] == (
            3, 11, 22, 12.625, 7 * TICKS, 7 * TICKS + 40_000, 7 * TICKS + 90_000,
            *((33, 44) if has_precision else (0, 0)), 2,
        )  # fmt: skip
        assert (frame.number, frame.models_changed) == (4711, True)
    assert layout.frame_of(data, version, 5).body is None


@each
def test_all_bodies_of_a_frame_are_listed(version: layout.Version, precise: bool) -> None:
    data = encoded(version, precise)
    found = layout.bodies_of(data, version)
    assert found == [layout.frame_of(data, version, body.id).body for body in BODIES]


def test_bodies_that_say_to_be_longer_than_the_frame_are_refused() -> None:
    data = encoded((4, 2))
    found = layout.bodies_of(data, (4, 2))
    at = data.index(struct.pack("<i", BODIES[0].id) + struct.pack("<f", BODIES[0].position_m[0]))
    size = struct.calcsize("<i8fh") * len(found)
    count = struct.pack("<ii", len(found), size)
    assert data[at - 8 : at] == count
    for wrong in ((len(found), len(data)), (len(found), size - 1), (-1, size)):
        bad = data[: at - 8] + struct.pack("<ii", *wrong) + data[at:]
        with pytest.raises(Malformed, match=rf"{wrong[0]} rigid bodies in {wrong[1]} bytes"):
            layout.bodies_of(bad, (4, 2))


@each
def test_a_frame_may_lack_its_end_mark(version: layout.Version, precise: bool) -> None:
    data = encoded(version, precise)
    assert layout.frame_of(data[:-4], version, 1) == layout.frame_of(data, version, 1)


@pytest.mark.parametrize("version", VERSIONS)
def test_definitions_are_read_back(version: layout.Version) -> None:
    data = encode_models(version, BODIES)
    assert layout.message_of(data) == layout.MODELS
    assert layout.models_of(data, version) == {"aircraft": 1, "Stuhl Ä": 2, "wand": 70000}


def test_a_server_is_read_back() -> None:
    data = encode_server_info((4, 2), data_port=1511, group="239.255.42.99", multicast=True)
    info = layout.server_info_of(data)
    assert info[2:] == ((4, 2), TICKS, 1511, True, "239.255.42.99")
    assert (info.name, info.application) == ("Motive", (3, 1, 0, 0))


def test_later_versions_are_stepped_through_by_their_sizes() -> None:
    """4.3 may lengthen a rigid body and add to the end: what is known keeps its place."""
    data = bytearray(
        encoded(
            (4, 2),
            scene=Scene(
                number=1,
                bodies=BODIES[:1],
                time_s=0.0,
                exposed_ticks=5,
                received_ticks=6,
                sent_ticks=7,
            ),
        )
    )
    at = data.index(struct.pack("<i", 1) + struct.pack("<i", 38)) + 4
    data[at : at + 4] = struct.pack("<i", 46)
    data[at + 42 : at + 42] = bytes(8)
    frame = layout.frame_of(bytes(data) + bytes(12), (4, 3), 1)
    assert frame.body is not None
    assert frame.body.x_m == 0.5
    assert frame[6:9] == (5, 6, 7)


# --- the packaged clients -------------------------------------------------------------------


def by_natnet(data: bytes, version: layout.Version) -> Any:
    buffer = PacketBuffer(data)
    buffer.pointer = 4
    return DataFrame.read_from_buffer(buffer, Version(*version))


def by_natnetsdk(data: bytes, version: layout.Version) -> Any:
    unpack = NatNetClient()._NatNetClient__unpack_mocap_data
    offset, frame = unpack(data[4:], len(data) - 4, *version)
    assert offset == len(data) - 8, "it has read all but the end mark"
    return frame


@each
def test_natnet_agrees(version: layout.Version, precise: bool) -> None:
    data = encoded(version, precise)
    theirs = by_natnet(data, version)
    assert theirs.prefix.frame_number == 4711
    assert [b.id_num for b in theirs.rigid_bodies] == [1, 2, 70000]
    for body in theirs.rigid_bodies:
        ours = layout.frame_of(data, version, body.id_num).body
        assert ours is not None
        assert (*body.pos, *body.rot, body.marker_error) == ours[1:9]
        assert body.tracking_valid == ours.is_tracked
    suffix, frame = theirs.suffix, layout.frame_of(data, version, 1)
    assert (suffix.timecode, suffix.timecode_sub, suffix.timestamp) == frame[3:6]
    stamps = (
        suffix.stamp_camera_mid_exposure, suffix.stamp_data_received, suffix.stamp_transmit,
    )  # fmt: skip
    assert stamps == frame[6:9]
    if version < (4, 0) or not precise:
        assert suffix.param == frame.flags
    else:
        assert suffix.param == frame.precision_s  # its fault
    assert [m.model_name for m in theirs.marker_sets] == ["aircraft", "Stuhl Ä", "wand", "all"]
    assert len(theirs.labeled_markers) == 9
    assert theirs.skeletons[0].rigid_bodies[1].id_num == 2
    assert theirs.devices[0].channel_arrays == ((0.25,), ())


@each
def test_natnetsdk_agrees(version: layout.Version, precise: bool) -> None:
    if not precise:
        with pytest.raises((struct.error, AssertionError)):  # its fault: it reads what is not there
            by_natnetsdk(encoded(version, precise), version)
        return
    data = encoded(version, precise)
    theirs = by_natnetsdk(data, version)
    assert theirs.prefix_data.frame_number == 4711
    bodies = theirs.rigid_body_data.rigid_body_list
    assert [b.id_num for b in bodies] == [1, 2, 70000]
    for body in bodies:
        ours = layout.frame_of(data, version, body.id_num).body
        assert ours is not None
        assert (*body.pos, *body.rot, body.error) == ours[1:9]
        assert body.tracking_valid == ours.is_tracked
    suffix, frame = theirs.suffix_data, layout.frame_of(data, version, 1)
    assert (suffix.timecode, suffix.timecode_sub, suffix.timestamp) == frame[3:6]
    stamps = (
        suffix.stamp_camera_mid_exposure, suffix.stamp_data_received, suffix.stamp_transmit,
    )  # fmt: skip
    assert stamps == frame[6:9]
    if version >= (4, 0):
        precision = (suffix.prec_timestamp_secs, suffix.prec_timestamp_frac_secs)
        assert precision == frame[9:11]
    assert suffix.param == frame.flags
    assert suffix.tracked_models_changed == frame.models_changed
    assert theirs.labeled_marker_data.get_labeled_marker_count() == 9
    assert theirs.skeleton_data.get_skeleton_count() == 1


@pytest.mark.parametrize("version", VERSIONS)
def test_both_agree_on_definitions(version: layout.Version) -> None:
    data = encode_models(version, BODIES)
    ours = layout.models_of(data, version)
    buffer = PacketBuffer(data)
    buffer.pointer = 4
    theirs: Any = DataDescriptions.read_from_buffer(buffer, Version(*version))
    assert {body.name: body.id_num for body in theirs.rigid_bodies} == ours
    if version >= (4, 2):
        return  # natnetsdk's fault: it does not step over the quaternion
    unpack = NatNetClient()._NatNetClient__unpack_data_descriptions
    _, found = unpack(data[4:], len(data) - 4, *version)
    assert {b.sz_name.decode(): b.id_num for b in found.rigid_body_list} == ours


def test_both_agree_on_the_server() -> None:
    data = encode_server_info((4, 1), data_port=1511, group="239.255.42.99", multicast=False)
    ours = layout.server_info_of(data)
    buffer = PacketBuffer(data)
    buffer.pointer = 4
    theirs: Any = ServerInfo.read_from_buffer(buffer, Version())
    assert (theirs.application_name, theirs.nat_net_protocol_version) == (
        ours.name, Version(*ours.version, 0, 0),
    )  # fmt: skip
    assert not hasattr(theirs, "clock_hz")  # its fault
    client = NatNetClient()
    client._NatNetClient__process_message(data)
    assert client.get_nat_net_version_server()[:2] == list(ours.version)
    assert client.get_application_name() == ours.name


# --- nonsense -------------------------------------------------------------------------------

versions = st.sampled_from(VERSIONS)


def read(data: bytes, version: layout.Version) -> MocapFrame | None:
    try:
        return layout.frame_of(data, version, 1)
    except Malformed:
        return None


@given(versions, st.integers(0, len(encoded((4, 2))) - 5))
def test_whatever_is_cut_off_is_no_frame(version: layout.Version, length: int) -> None:
    data = encoded(version)[:-4]
    if length < len(data):
        cut = data[:length]
        with pytest.raises(Malformed):
            layout.message_of(cut)
        # 4.0 without its last 8 bytes is a 4.0 of the other reading.
        whole = version == (4, 0) and len(data) - length in (4, 8)
        assert (read(cut, version) is None) or whole


@settings(max_examples=300)
@given(versions, st.data())
def test_changed_bytes_never_raise(version: layout.Version, drawn: st.DataObject) -> None:
    data = bytearray(encoded(version))
    for _ in range(drawn.draw(st.integers(1, 6))):
        at = drawn.draw(st.integers(4, len(data) - 4))
        number = drawn.draw(st.sampled_from((-(2**31), -1, 0, 1, 255, 65535, 2**31 - 1)))
        data[at : at + 4] = struct.pack("<i", number)
    frame = read(bytes(data), version)
    assert frame is None or frame.body is None or isinstance(frame.body, RigidBody)


@settings(max_examples=200)
@given(versions, st.binary(max_size=600))
def test_any_bytes_never_raise(version: layout.Version, payload: bytes) -> None:
    data = struct.pack("<HH", layout.FRAME, len(payload)) + payload
    read(data, version)
    for decode in (lambda: layout.models_of(data, version), lambda: layout.server_info_of(data)):
        try:
            decode()
        except Malformed:
            continue


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("count", [-1, 65000, 2**31 - 1])
def test_counts_are_not_accepted(version: layout.Version, count: int) -> None:
    """Where a count claims more than is there, or more than is walked, nothing is read."""
    payload = struct.pack("<ii", 1, count) + bytes(65000)
    data = struct.pack("<HH", layout.FRAME, len(payload)) + payload
    with pytest.raises(Malformed):
        layout.frame_of(data, version, 1)
    with pytest.raises(Malformed):
        layout.models_of(data[:4] + data[8:], version)


def test_the_work_for_a_frame_is_bounded() -> None:
    """The most entries that fit into a datagram are not all walked."""
    entry = b"\0" + struct.pack("<i", 0)
    payload = struct.pack("<ii", 1, 13000) + entry * 13000
    data = struct.pack("<HH", layout.FRAME, len(payload)) + payload
    with pytest.raises(Malformed, match="more than 4096 entries"):
        layout.frame_of(data, (3, 0), 1)
