"""Which subscriptions of a ULog are followed: those whose fields fit the rows of the file."""

from __future__ import annotations

from struct import pack

import pytest

from tgl_soar.analysis.logs.subscriptions import Message, unfounded

PADDING = 64  # fields that a row may lack


class Made:
    """Bodies of messages one after the other, as a file has them behind its header."""

    def __init__(self) -> None:
        self.data = b"header"
        self.messages: list[Message] = []

    def add(self, kind: str, body: bytes) -> int:
        """Where the body begins."""
        begin = len(self.data)
        self.data += body
        self.messages.append(Message(ord(kind), begin, len(self.data)))
        return begin

    def format(self, text: str) -> Made:
        self.add("F", text.encode())
        return self

    def subscribe(self, name: str, number: int = 1) -> int:
        return self.add("A", b"\0" + pack("<H", number) + name.encode())

    def row(self, size: int, number: int = 1) -> Made:
        self.add("D", pack("<H", number) + bytes(size))
        return self

    def left_out(self) -> tuple[set[int], list[str]]:
        return unfounded(self.data, self.messages)


def damage(name: str) -> list[str]:
    return [f"damaged: a subscription to {name} does not fit its rows"]


def test_a_subscription_with_a_row_that_fits_is_followed() -> None:
    made = Made().format("att:uint64_t timestamp;float[4] q;")
    made.subscribe("att")
    assert made.row(24).left_out() == (set(), [])


def test_one_without_a_row_yet_is_left_out_and_is_no_damage() -> None:
    made = Made().format("big:float[90] v;")
    at = made.subscribe("big")
    assert made.left_out() == ({at}, [])
    made.row(10, number=2)  # another's
    assert made.left_out() == ({at}, [])


def test_a_short_format_needs_no_row() -> None:
    """Sixty-four fields may be missing of any row."""
    made = Made().format("small:float[63] v;")
    made.subscribe("small")
    assert made.left_out() == (set(), [])
    more = Made().format("small:float[64] v;")
    at = more.subscribe("small")
    assert more.left_out() == ({at}, [])


@pytest.mark.parametrize("size", [10, 33])
def test_a_row_stands_for_twice_its_bytes_in_fields_and_the_padding(size: int) -> None:
    """The format itself counts as one."""
    for count, fits in ((2 * size + PADDING - 1, True), (2 * size + PADDING, False)):
        made = Made().format(f"v:uint8_t[{count}] v;")
        at = made.subscribe("v")
        made.row(size)
        expected = (set(), []) if fits else ({at}, damage("v"))
        assert made.left_out() == expected, count


def test_the_longest_row_counts_wherever_it_stands() -> None:
    made = Made().format("v:uint8_t[100] v;")
    made.subscribe("v")
    assert made.row(40).row(2).left_out() == (set(), [])
    number = Made().format("v:uint8_t[100] v;")
    number.subscribe("v", number=0x0203)
    assert number.row(40, number=0x0203).left_out() == (set(), [])
    other = Made().format("v:uint8_t[100] v;")
    at = other.subscribe("v", number=0x0203)
    assert other.row(40, number=0x0302).left_out() == ({at}, [])


def test_formats_in_formats_count_with_all_their_fields() -> None:
    """outer: itself, a timestamp, and five times (inner itself and its 20 fields): 107."""
    made = Made().format("inner:float[20] v;").format("outer:uint64_t timestamp;inner[5] parts;")
    made.subscribe("outer")
    assert made.row(22).left_out() == (set(), [])  # 44 + 64
    less = Made().format("inner:float[20] v;").format("outer:uint64_t timestamp;inner[5] parts;")
    at = less.subscribe("outer")
    assert less.row(21).left_out() == ({at}, damage("outer"))


def test_a_number_is_followed_once() -> None:
    made = Made().format("att:float q;").format("pos:float x;")
    made.subscribe("att")
    again = made.subscribe("pos")
    other = made.subscribe("pos", number=2)
    assert made.row(8).row(8, number=2).left_out() == ({again}, damage("pos"))
    assert other != again


def test_damage_is_named_once_and_in_order() -> None:
    made = Made()
    begins = {made.subscribe("z", 1), made.subscribe("a", 2), made.subscribe("z", 3)}
    for number in (1, 2, 3):
        made.row(4, number)
    assert made.left_out() == (begins, damage("a") + damage("z"))


@pytest.mark.parametrize(
    "text",
    [
        "v:nothing x;",  # a type that is no format
        "v:v x;",  # itself
        "v:float[x] x;",
        "v:float[-1] x;",
        "v:float[100000] x;",  # six digits
        f"v:float {'x' * 101};",
    ],
)
def test_what_cannot_be_followed_is_left_out(text: str) -> None:
    made = Made().format(text)
    at = made.subscribe("v")
    assert made.row(60000).left_out() == ({at}, damage("v"))


def test_names_of_a_hundred_letters_and_counts_of_five_digits_are_followed() -> None:
    made = Made().format(f"v:float[10000] {'x' * 100};")
    made.subscribe("v")
    assert made.row(40000).left_out() == (set(), [])


def test_every_basic_type_is_a_field() -> None:
    sizes = [f"{sign}int{n}_t" for sign in ("", "u") for n in (8, 16, 32, 64)]
    for kind in (*sizes, "float", "double", "bool", "char"):
        made = Made().format(f"v:{kind} x;")
        made.subscribe("v")
        assert made.row(8).left_out() == (set(), []), kind


def test_an_empty_format_is_followed_and_a_count_of_none_is_one() -> None:
    made = Made().format("v:")
    made.subscribe("v")
    assert made.left_out() == (set(), [])
    none = Made().format("v:float[0] x;")
    none.subscribe("v")
    assert none.row(4).left_out() == (set(), [])


def test_formats_are_followed_eight_deep() -> None:
    """f0 holds f1, f1 holds f2, and so on: the ninth below the first still counts, no further."""
    for depth, followed in ((9, True), (10, False)):
        made = Made()
        for i in range(depth - 1):
            made.format(f"f{i}:f{i + 1} x;")
        made.format(f"f{depth - 1}:float x;")
        at = made.subscribe("f0")
        assert made.row(60).left_out() == ((set(), []) if followed else ({at}, damage("f0"))), depth


def test_messages_that_are_cut_short_say_nothing() -> None:
    made = Made().format("v:float x;")
    made.add("A", b"\0\1")
    made.add("D", b"\1")
    assert made.left_out() == (set(), [])
    nameless = made.add("A", b"\0\1\0")
    assert made.left_out() == ({nameless}, [])
    made.row(0)
    assert made.left_out() == ({nameless}, damage(""))
