"""The bytes of NatNet 3.0 to 4.2, little-endian: what a client reads and what it asks.

Every message begins with its number and the length of what follows (u16, u16).  A frame:

    i32 number, then sections, each i32 count (from 4.1: i32 count, i32 size) and its entries:
      marker sets      name, i32 n, n positions          other markers    position
      rigid bodies     i32 id, position, quaternion xyzw, f32 mean error, i16 flags
      skeletons        i32 id, i32 n, n rigid bodies      assets           from 4.1 on
      labelled markers i32 id, position, f32 size, i16 flags, f32 residual
      force plates, devices                               i32 id, i32 n, n of (i32 m, m f32)
    2 u32 time code, f64 time, 3 u64 clock ticks (mid-exposure, received, sent),
    from 4.1 on 2 u32 precision time, i16 flags, and mostly an i32 end mark

Of all this a flight needs one body and the ticks.  From 4.1 on sections are stepped over by
their size; before, they are walked, entry by entry where entries have no fixed length.  What
does not fit is `Malformed`: no count and no size is accepted beyond the bytes that are there,
and no more than `MAX_STEPS` entries are walked.

4.0 is disputed: the vendor's Python sample reads the precision time from 4.0 on and says in a
comment that it came with 4.1; PyPI's `natnet` never reads it.  The length decides: with it 50 or
54 bytes follow the sections, without it 42 or 46.

Versions after 4.2 are read as 4.2, as new sections would have sizes to step over; servers are
asked for 4.2 first.

Sources: PacketClient.cpp and NatNetTypes.h of the NatNet SDK; the vendor's Python sample.
"""

from __future__ import annotations

from struct import Struct, error
from typing import Final, NamedTuple

Version = tuple[int, int]

OLDEST: Final[Version] = (3, 0)
NEWEST: Final[Version] = (4, 2)  # that is read by its own layout
SIZED: Final[Version] = (4, 1)  # from here on sections carry their size

CONNECT: Final = 0
SERVER_INFO: Final = 1
MODELS_REQUEST: Final = 4
MODELS: Final = 5
FRAME: Final = 7
DISCONNECT: Final = 9
KEEP_ALIVE: Final = 10
ECHO_REQUEST: Final = 12
ECHO_RESPONSE: Final = 13
UNRECOGNIZED: Final = 100

MAX_DATAGRAM_BYTES: Final = 65535
MAX_STEPS: Final = 4096  # entries of a message that are walked: Motive streams some hundreds
MAX_NAME_BYTES: Final = 256

HEADER: Final = Struct("<HH")
_COUNT: Final = Struct("<i")
_SECTION: Final = Struct("<ii")
_BODY: Final = Struct("<i3f4ffh")
_SUFFIX: Final = Struct("<IIdQQQh")
_PRECISE_SUFFIX: Final = Struct("<IIdQQQIIh")
_END_MARK_BYTES: Final = 4
_SERVER: Final = Struct("<256s4B4BQHB4B")
_ECHO: Final = Struct("<QQ")
_POSITION_BYTES: Final = 12
_LABELLED_BYTES: Final = 26

_RIGID_BODIES: Final = 2  # the place of that section
_SIZED_SECTIONS: Final = 8

_TRACKED: Final = 1  # of a body's flags
_MODELS_CHANGED: Final = 2  # of a frame's
_RIGID_BODY_MODEL: Final = 1  # of a definition's kind
_ALL_RIGID_BODIES: Final = 1 << _RIGID_BODY_MODEL  # as a mask of kinds


class Malformed(ValueError):
    """A message that is not what it should be; the text says where."""


class RigidBody(NamedTuple):
    """One tracked body, in the hall's axes."""

    id: int
    x_m: float
    y_m: float
    z_m: float
    qx: float
    qy: float
    qz: float
    qw: float
    error_m: float  # mean of its markers' distances to where they should be
    flags: int

    @property
    def pose(self) -> tuple[float, float, float, float, float, float, float]:
        """Place [m] and quaternion, x, y, z, w."""
        return self.x_m, self.y_m, self.z_m, self.qx, self.qy, self.qz, self.qw

    @property
    def is_tracked(self) -> bool:
        """Whether the server vouches for this pose."""
        return self.flags & _TRACKED != 0


class MocapFrame(NamedTuple):
    """What is wanted of one frame.  Ticks are of the server's clock; 0: not known."""

    number: int
    body: RigidBody | None  # the one that was asked for
    bodies: int  # how many there are
    timecode: int
    timecode_sub: int
    time_s: float  # since the stream began
    exposed_ticks: int  # the middle of the exposure
    received_ticks: int
    sent_ticks: int
    precision_s: int  # 0 where the version has none
    precision_fraction: int
    flags: int

    @property
    def models_changed(self) -> bool:
        """Whether the definitions of what is tracked are others than before."""
        return self.flags & _MODELS_CHANGED != 0


class ServerInfo(NamedTuple):
    """How a server presents itself."""

    name: str
    application: tuple[int, int, int, int]
    version: Version  # of NatNet
    clock_hz: int
    data_port: int
    is_multicast: bool
    group: str  # multicast address


# --- reading ------------------------------------------------------------------------------------


def message_of(data: bytes) -> int:
    """The number of a message.  Errors: `Malformed` for one that is shorter than it says."""
    if len(data) < HEADER.size:
        raise Malformed(f"{len(data)} bytes are no message")
    number, length = HEADER.unpack_from(data)
    if len(data) - HEADER.size < length:
        raise Malformed(f"cut off: {len(data) - HEADER.size} of {length} bytes")
    return int(number)


def frame_of(data: bytes, version: Version, wanted: int) -> MocapFrame:
    """A frame with the rigid body of the wanted id, if it has it.  Errors: `Malformed`."""
    try:
        (number,) = _COUNT.unpack_from(data, HEADER.size)
        offset = HEADER.size + _COUNT.size
        if version >= SIZED:
            offset, body, bodies = _sized_sections(data, offset, wanted)
        else:
            offset, body, bodies = _walked_sections(data, offset, wanted)
        left = len(data) - offset
        if version >= SIZED or (version == (4, 0) and left >= _PRECISE_SUFFIX.size):
            suffix = _PRECISE_SUFFIX.unpack_from(data, offset)
            tail = left - _PRECISE_SUFFIX.size
        else:
            *known, flags = _SUFFIX.unpack_from(data, offset)
            suffix = (*known, 0, 0, flags)
            tail = left - _SUFFIX.size
    except error:
        raise Malformed("it ends too early") from None
    if tail not in (0, _END_MARK_BYTES) and version <= NEWEST:
        raise Malformed(f"{tail} bytes follow its end")
    return MocapFrame._make((number, body, bodies, *suffix))


def bodies_of(data: bytes, version: Version) -> list[RigidBody]:
    """All rigid bodies of a frame.  Errors: `Malformed`."""
    offset = HEADER.size + _COUNT.size
    try:
        if version >= SIZED:
            for _ in range(_RIGID_BODIES):
                offset += _SECTION.size + _SECTION.unpack_from(data, offset)[1]
            count, size = _SECTION.unpack_from(data, offset)
            offset += _SECTION.size
            if count < 0 or size < count * _BODY.size or size > len(data) - offset:
                raise Malformed(f"{count} rigid bodies in {size} bytes")
            stride = size // count if count else 0
        else:
            walk = _Walk(data, offset)
            for _ in range(walk.count()):
                walk.skip_name()
                walk.skip_all(_POSITION_BYTES)
            walk.skip_all(_POSITION_BYTES)
            count, offset, stride = walk.count(), walk.offset, _BODY.size
        found = [_BODY.unpack_from(data, offset + i * stride) for i in range(count)]
    except error:
        raise Malformed("it ends too early") from None
    return [RigidBody._make(values) for values in found]


def _sized_sections(data: bytes, offset: int, wanted: int) -> tuple[int, RigidBody | None, int]:
    body, bodies = None, 0
    for section in range(_SIZED_SECTIONS):
        count, size = _SECTION.unpack_from(data, offset)
        offset += _SECTION.size
        if count < 0 or not 0 <= size <= len(data) - offset:
            raise Malformed(f"section {section} of {count} entries and {size} bytes")
        if section == _RIGID_BODIES:
            bodies = count
            if count and (size < count * _BODY.size or size % count):
                raise Malformed(f"{count} rigid bodies in {size} bytes")
            if count:
                body = _body_of(data, offset, count, size // count, wanted)
        offset += size
    return offset, body, bodies


def _walked_sections(data: bytes, offset: int, wanted: int) -> tuple[int, RigidBody | None, int]:
    walk = _Walk(data, offset)
    for _ in range(walk.count()):
        walk.skip_name()
        walk.skip_all(_POSITION_BYTES)
    walk.skip_all(_POSITION_BYTES)
    bodies = walk.count()
    at = walk.offset
    walk.skip(bodies * _BODY.size)
    body = _body_of(data, at, bodies, _BODY.size, wanted)
    for _ in range(walk.count()):
        walk.skip(_COUNT.size)
        walk.skip_all(_BODY.size)
    walk.skip_all(_LABELLED_BYTES)
    for _ in range(2):  # force plates, devices
        for _ in range(walk.count()):
            walk.skip(_COUNT.size)
            for _ in range(walk.count()):
                walk.skip_all(4)
    return walk.offset, body, bodies


def _body_of(data: bytes, offset: int, count: int, stride: int, wanted: int) -> RigidBody | None:
    pattern, at, end = _COUNT.pack(wanted), offset, offset + count * stride
    while (at := data.find(pattern, at, end)) >= 0:
        into = (at - offset) % stride
        if into == 0:
            return RigidBody._make(_BODY.unpack_from(data, at))
        at += stride - into  # it only looks like the id: on with the next body
    return None


class _Walk:
    """Steps over what is not wanted, never beyond the end and never for long."""

    __slots__ = ("_data", "_steps", "offset")

    def __init__(self, data: bytes, offset: int) -> None:
        self._data = data
        self._steps = 0
        self.offset = offset

    def count(self) -> int:
        """How many entries follow.  Each that is walked takes a step."""
        (count,) = _COUNT.unpack_from(self._data, self.offset)
        self.offset += _COUNT.size
        if not 0 <= count <= len(self._data) - self.offset:
            raise Malformed(f"{count} entries in {len(self._data) - self.offset} bytes")
        return int(count)

    def skip(self, size: int) -> None:
        """Over some bytes that must be there."""
        self._steps += 1
        if self._steps > MAX_STEPS:
            raise Malformed(f"more than {MAX_STEPS} entries")
        if not 0 <= size <= len(self._data) - self.offset:
            raise Malformed("it ends too early")
        self.offset += size

    def skip_all(self, size: int) -> None:
        """Over a count and as many entries of one size."""
        self.skip(self.count() * size)

    def skip_name(self) -> None:
        """Over a text that ends with a zero."""
        end = self._data.find(b"\0", self.offset, self.offset + MAX_NAME_BYTES)
        if end < 0:
            raise Malformed("a name without an end")
        self.skip(end + 1 - self.offset)

    def name(self) -> str:
        """A text that ends with a zero."""
        begin = self.offset
        self.skip_name()
        return self._data[begin : self.offset - 1].decode("utf-8", "replace")


def server_info_of(data: bytes) -> ServerInfo:
    """A server's presentation.  Errors: `Malformed`."""
    try:
        name, *numbers = _SERVER.unpack_from(data, HEADER.size)
    except error:
        raise Malformed("it ends too early") from None
    application, natnet, (clock_hz, port, multicast) = numbers[:4], numbers[4:8], numbers[8:11]
    if not 1_000 <= clock_hz <= 10_000_000_000:
        raise Malformed(f"a clock of {clock_hz} Hz")
    return ServerInfo(
        name=name.partition(b"\0")[0].decode("utf-8", "replace"),
        application=(application[0], application[1], application[2], application[3]),
        version=(natnet[0], natnet[1]),
        clock_hz=clock_hz,
        data_port=port,
        is_multicast=multicast != 0,
        group=".".join(str(number) for number in numbers[11:15]),
    )


def models_of(data: bytes, version: Version) -> dict[str, int]:
    """Ids of the rigid bodies by name.

    Before 4.1 a kind of definition that is not known ends the list: what stands before it is
    given, and Motive lists rigid bodies before skeletons.  Errors: `Malformed`.
    """
    walk = _Walk(data, HEADER.size)
    models: dict[str, int] = {}
    try:
        for _ in range(walk.count()):
            kind = walk.count()
            end = walk.count() + walk.offset if version >= SIZED else None
            if kind == _RIGID_BODY_MODEL:
                name = walk.name()
                (models[name],) = _COUNT.unpack_from(data, walk.offset)
            if end is not None:
                walk.skip(end - walk.offset)
            elif kind == _RIGID_BODY_MODEL:
                _skip_body_model(walk, version)
            elif not _skip_model(walk, kind):
                break
    except error:
        raise Malformed("it ends too early") from None
    return models


def _skip_body_model(walk: _Walk, version: Version) -> None:
    """From the id on: parent, position, and the markers' positions, labels and names."""
    walk.skip(2 * _COUNT.size + _POSITION_BYTES)
    markers = walk.count()
    walk.skip(markers * (_POSITION_BYTES + _COUNT.size))
    if version >= (4, 0):
        for _ in range(markers):
            walk.skip_name()


def _skip_model(walk: _Walk, kind: int) -> bool:
    """Over a definition without a size; False: how long it is is not known."""
    if kind == 0:  # marker set
        walk.skip_name()
    elif kind == 3:  # force plate
        walk.skip(_COUNT.size)
        walk.skip_name()
        walk.skip(4 * (2 + 3 + 12 * 12 + 4 * 3) + 2 * _COUNT.size)
    elif kind == 4:  # device
        walk.skip(_COUNT.size)
        walk.skip_name()
        walk.skip_name()
        walk.skip(2 * _COUNT.size)
    elif kind == 5:  # camera
        walk.skip_name()
        walk.skip(_POSITION_BYTES + 16)
        return True
    else:  # of skeletons' bones two readings are about
        return False
    for _ in range(walk.count()):
        walk.skip_name()
    return True


def echo_of(data: bytes) -> tuple[int, int]:
    """(our stamp that is sent back, the server's ticks when it was there).  Errors: `Malformed`."""
    try:
        ours, ticks = _ECHO.unpack_from(data, HEADER.size)
    except error:
        raise Malformed("it ends too early") from None
    return ours, ticks


# --- asking -------------------------------------------------------------------------------------


def connect_request(version: Version = NEWEST) -> bytes:
    """Asks a server who it is, and to stream a version: a name, versions, and the options."""
    name = b"Ping".ljust(256, b"\0")
    ours = bytes((*version, 0, 0))
    options = b"\0" + ours + b"\0"  # not only subscribed data; the version of the stream
    payload = name + ours + ours + options
    return HEADER.pack(CONNECT, len(payload)) + payload


def models_request(*, masked: bool = False) -> bytes:
    """Asks for definitions: of all, as old servers take it, or of rigid bodies, as new ones do."""
    payload = _COUNT.pack(_ALL_RIGID_BODIES) if masked else b""
    return HEADER.pack(MODELS_REQUEST, len(payload)) + payload


def keep_alive() -> bytes:
    """Tells a server that streams to us alone that we are still there."""
    return HEADER.pack(KEEP_ALIVE, 0)


def echo_request(stamp_ns: int) -> bytes:
    """Asks for the server's clock."""
    return HEADER.pack(ECHO_REQUEST, 8) + stamp_ns.to_bytes(8, "little")


def disconnect() -> bytes:
    """Tells a server that we have gone."""
    return HEADER.pack(DISCONNECT, 0)
