"""The bytes that Motive sends: NatNet 3.0 to 4.2.

The layout is described in `tgl_soar.link.natnet.layout`.  This is written from the same public
sources and apart from it, so that our decoder never talks only to itself.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

Version = tuple[int, int]
Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w

VERSIONS: Final = ((3, 0), (3, 1), (4, 0), (4, 1), (4, 2))
CONNECT, SERVER_INFO, REQUEST, RESPONSE, MODELS_REQUEST, MODELS = 0, 1, 2, 3, 4, 5
FRAME, DISCONNECT, KEEP_ALIVE, ECHO_REQUEST, ECHO_RESPONSE, UNRECOGNIZED = 7, 9, 10, 12, 13, 100
CLOCK_HZ: Final = 10_000_000  # as Windows counts


class SimulatedBody(NamedTuple):
    """A rigid body, in the hall's axes."""

    name: str
    id: int
    position_m: Triple
    quaternion: Quaternion
    error_m: float = 0.0004
    tracked: bool = True
    markers: tuple[Triple, ...] = ()  # in the hall's axes


@dataclass
class Scene:
    """All that one frame holds.  Ticks are of the server's clock."""

    number: int
    bodies: Sequence[SimulatedBody]
    time_s: float
    exposed_ticks: int
    received_ticks: int
    sent_ticks: int
    others: Sequence[Triple] = ()  # markers of nothing
    skeletons: Sequence[tuple[int, Sequence[SimulatedBody]]] = ()
    assets: Sequence[tuple[int, Sequence[SimulatedBody]]] = ()
    plates: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    devices: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    timecode: tuple[int, int] = (0, 0)
    precision: tuple[int, int] = (0, 0)
    recording: bool = False
    models_changed: bool = False


def encode_frame(version: Version, scene: Scene, *, precise_4_0: bool = True) -> bytes:
    """A frame.  `precise_4_0`: whether 4.0 has the precision time stamp, which is disputed."""
    bodies = scene.bodies
    names = [(body.name, body.markers) for body in bodies]
    names.append(("all", tuple(marker for body in bodies for marker in body.markers)))
    labelled = [
        struct.pack("<i3ffhf", (body.id & 0x7FFF) << 16 | i, *marker, 0.014, 0x0A, 0.0003)
        for body in bodies
        for i, marker in enumerate(body.markers, 1)
    ]
    sections = [
        [_text(name) + _counted([struct.pack("<3f", *m) for m in own]) for name, own in names],
        [struct.pack("<3f", *marker) for marker in scene.others],
        [_pose(body) for body in bodies],
        [struct.pack("<i", k) + _counted([_pose(b) for b in own]) for k, own in scene.skeletons],
        [_asset(number, own) for number, own in scene.assets],
        labelled,
        [_channels(number, channels) for number, channels in scene.plates],
        [_channels(number, channels) for number, channels in scene.devices],
    ]
    sized = version >= (4, 1)
    if not sized:
        del sections[4]
    payload = struct.pack("<i", scene.number)
    for entries in sections:
        content = b"".join(entries)
        payload += struct.pack("<i", len(entries))
        payload += struct.pack("<i", len(content)) * sized + content
    payload += struct.pack("<IId", *scene.timecode, scene.time_s)
    payload += struct.pack("<QQQ", scene.exposed_ticks, scene.received_ticks, scene.sent_ticks)
    if sized or (version == (4, 0) and precise_4_0):
        payload += struct.pack("<II", *scene.precision)
    payload += struct.pack("<hi", scene.recording | scene.models_changed << 1, 0)
    return message(FRAME, payload)


def encode_models(version: Version, bodies: Sequence[SimulatedBody]) -> bytes:
    """The definitions: a marker set, a rigid body and a camera of each kind that there is."""
    models: list[tuple[int, bytes]] = []
    for body in bodies:
        names = [_text(f"Marker{i}") for i, _ in enumerate(body.markers, 1)]
        models.append((0, _text(body.name) + _counted(names)))
    for body in bodies:
        model = _text(body.name) + struct.pack("<ii3f", body.id, -1, 0.0, 0.0, 0.0)
        if version >= (4, 2):
            model += struct.pack("<4f", 0.0, 0.0, 0.0, 1.0)
        offsets = [_less(marker, body.position_m) for marker in body.markers]
        model += _counted([struct.pack("<3f", *offset) for offset in offsets])
        model += struct.pack(f"<{len(offsets)}i", *([0] * len(offsets)))
        if version >= (4, 0):
            model += b"".join(_text(f"Marker{i}") for i, _ in enumerate(offsets, 1))
        models.append((1, model))
    models.append((5, _text("Prime 13 #1") + struct.pack("<3f4f", 0, 3, 0, 0, 0, 0, 1)))
    payload = struct.pack("<i", len(models))
    for kind, model in models:
        payload += struct.pack("<i", kind)
        payload += struct.pack("<i", len(model)) * (version >= (4, 1)) + model
    return message(MODELS, payload)


def encode_server_info(
    version: Version, *, clock_hz: int = CLOCK_HZ, data_port: int, group: str, multicast: bool
) -> bytes:
    """How the server presents itself."""
    return message(
        SERVER_INFO,
        struct.pack(
            "<256s4B4BQHB4B", b"Motive", 3, 1, 0, 0, *version, 0, 0, clock_hz, data_port,
            multicast, *socket.inet_aton(group),
        ),
    )  # fmt: skip


def message(number: int, payload: bytes) -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


def _text(text: str) -> bytes:
    return text.encode() + b"\0"


def _counted(entries: Sequence[bytes]) -> bytes:
    return struct.pack("<i", len(entries)) + b"".join(entries)


def _pose(body: SimulatedBody) -> bytes:
    pose = (*body.position_m, *body.quaternion)
    return struct.pack("<i7ffh", body.id, *pose, body.error_m, body.tracked)


def _asset(number: int, bodies: Sequence[SimulatedBody]) -> bytes:
    markers = [
        struct.pack("<i3ffhf", i, *marker, 0.014, 0, 0.0003)
        for i, marker in enumerate(m for body in bodies for m in body.markers)
    ]
    return struct.pack("<i", number) + _counted([_pose(b) for b in bodies]) + _counted(markers)


def _channels(number: int, channels: Sequence[Sequence[float]]) -> bytes:
    own = [struct.pack(f"<i{len(values)}f", len(values), *values) for values in channels]
    return struct.pack("<i", number) + _counted(own)


def _less(one: Triple, other: Triple) -> Triple:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]
