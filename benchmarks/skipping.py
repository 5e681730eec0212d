"""The least that finds one body in a frame of motion capture and skips the rest.

For `natnet`: the layout is that of `tgl_soar.link.natnet.layout`, read with nothing checked and
nothing kept but the body's numbers and the clock's, as one would who trusts the sender.
"""

from __future__ import annotations

from struct import Struct

_COUNT, _SECTION = Struct("<i"), Struct("<ii")
_BODY = Struct("<i3f4ffh")
_TICKS = Struct("<IIdQQQ")
_HEADER_BYTES = 8  # message, length, frame's number
_SECTIONS, _BODIES = 8, 2
_POSITION_BYTES, _LABELLED_BYTES = 12, 26


def body_of(
    data: bytes, version: tuple[int, int], wanted: int
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The body's id, position, quaternion, error and flags, and time codes, time and ticks."""
    end, body = (_sized if version >= (4, 1) else _walked)(data, wanted)
    return None if body is None else (body, _TICKS.unpack_from(data, end))


def _find(data: bytes, at: int, count: int, wanted: int) -> tuple[float, ...] | None:
    pattern = _COUNT.pack(wanted)
    for place in range(at, at + count * _BODY.size, _BODY.size):
        if data.startswith(pattern, place):
            return _BODY.unpack_from(data, place)
    return None


def _sized(data: bytes, wanted: int) -> tuple[int, tuple[float, ...] | None]:
    at, body = _HEADER_BYTES, None
    for section in range(_SECTIONS):
        count, size = _SECTION.unpack_from(data, at)
        at += _SECTION.size
        if section == _BODIES:
            body = _find(data, at, count, wanted)
        at += size
    return at, body


def _walked(data: bytes, wanted: int) -> tuple[int, tuple[float, ...] | None]:
    def skip(at: int, size: int) -> int:
        (count,) = _COUNT.unpack_from(data, at)
        return at + _COUNT.size + int(count) * size

    (sets,) = _COUNT.unpack_from(data, _HEADER_BYTES)
    at = _HEADER_BYTES + _COUNT.size
    for _ in range(sets):
        at = skip(data.index(0, at) + 1, _POSITION_BYTES)
    at = skip(at, _POSITION_BYTES)
    (bodies,) = _COUNT.unpack_from(data, at)
    body = _find(data, at + _COUNT.size, bodies, wanted)
    at = skip(at, _BODY.size)
    (skeletons,) = _COUNT.unpack_from(data, at)
    at += _COUNT.size
    for _ in range(skeletons):
        at = skip(at + _COUNT.size, _BODY.size)
    at = skip(at, _LABELLED_BYTES)
    for _ in range(2):  # force plates, devices
        (plates,) = _COUNT.unpack_from(data, at)
        at += _COUNT.size
        for _ in range(plates):
            (channels,) = _COUNT.unpack_from(data, at + _COUNT.size)
            at += 2 * _COUNT.size
            for _ in range(channels):
                at = skip(at, 4)
    return at, body
