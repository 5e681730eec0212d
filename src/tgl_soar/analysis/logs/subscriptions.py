"""The subscriptions of a ULog that rows stand behind.

A subscription names a format, and a format may be a few bytes that stand for millions of fields:
arrays in arrays.  What follows one makes an object of each field, so those alone are kept of which
the file holds a row that is long enough.  A field is a byte of its row or more: all that is made
of a log is so bound by its length.
"""

from __future__ import annotations

from collections.abc import Iterable
from struct import unpack_from
from typing import Final, NamedTuple

_BASIC: Final = (
    b"int8_t", b"uint8_t", b"int16_t", b"uint16_t", b"int32_t", b"uint32_t", b"int64_t",
    b"uint64_t", b"float", b"double", b"bool", b"char",
)  # fmt: skip
_DEEPEST: Final = 8  # formats in formats: PX4's are three deep at most
_LONGEST_NAME: Final = 100  # of a field: PX4's have 64 at most
# Fields at the end of a format that its rows may lack, and the timestamp's own.
_PADDING: Final = 64


class Message(NamedTuple):
    """One message of a file: its kind, and where its body begins and ends."""

    kind: int
    begin: int
    end: int


def unfounded(data: bytes, messages: Iterable[Message]) -> tuple[set[int], list[str]]:
    """Where the bodies begin of the subscriptions to leave out, and what of that is damage.

    One of which the file merely has no row yet is none.
    """
    formats: dict[bytes, list[tuple[bytes, int]] | None] = {}
    asked: list[tuple[int, int, bytes]] = []  # place, number, format
    longest: dict[int, int] = {}  # row of each number [bytes]
    for kind, begin, end in messages:
        if kind == ord("F"):
            name, _, fields = data[begin:end].partition(b":")
            formats[name] = _fields(fields)
        elif kind == ord("A") and end - begin >= 3:
            asked.append((begin, unpack_from("<H", data, begin + 1)[0], data[begin + 3 : end]))
        elif kind == ord("D") and end - begin >= 2:
            number = data[begin] | data[begin + 1] << 8
            longest[number] = max(longest.get(number, 0), end - begin - 2)
    costs: dict[bytes, int] = {}
    left_out: set[int] = set()
    damaged: set[str] = set()
    followed: set[int] = set()
    for begin, number, name in asked:
        cost = _cost(name, formats, costs)
        fits = 0 < cost <= 2 * longest.get(number, 0) + _PADDING
        if fits and number not in followed:
            followed.add(number)
            continue
        left_out.add(begin)
        if number in longest:
            damaged.add(name.decode("utf-8", "replace"))
    return left_out, [
        f"damaged: a subscription to {name} does not fit its rows" for name in sorted(damaged)
    ]


def _fields(text: bytes) -> list[tuple[bytes, int]] | None:
    """Type and count of each field; None where the text is no format."""
    found = []
    for field in text.split(b";"):
        if not field:
            continue
        kind, _, name = field.partition(b" ")
        kind, _, count = kind.partition(b"[")
        number = count.partition(b"]")[0]
        if (count and not number.isdigit()) or len(name) > _LONGEST_NAME or len(number) > 5:
            return None
        found.append((kind, max(1, int(number or 1))))
    return found


def _cost(
    name: bytes,
    formats: dict[bytes, list[tuple[bytes, int]] | None],
    costs: dict[bytes, int],
    depth: int = 0,
) -> int:
    """Fields of a format, and formats in it; 0: it cannot be followed."""
    if name in costs:
        return costs[name]
    fields = formats.get(name)
    cost = 1
    if fields is None or depth > _DEEPEST:
        return 0
    for kind, count in fields:
        one = 1 if kind in _BASIC else _cost(kind, formats, costs, depth + 1)
        if not one:
            return 0
        cost += count * one
    costs[name] = cost
    return cost
