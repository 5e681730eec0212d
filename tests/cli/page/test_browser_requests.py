"""What browsers may ask, who holds the line, and what frames say."""

from __future__ import annotations

import asyncio
import json
from functools import partial
from typing import Any

import msgspec
import pytest

from tgl_soar.cli.page.broadcast import STALLED_S, Broadcast, changed
from tgl_soar.cli.page.browser_requests import (
    AT_ONCE,
    HOLD_S,
    LONGEST,
    PER_S,
    ClientAllowance,
    Holder,
    Move,
    Refused,
    request_of,
)

TOKEN = "a-token-for-the-tests"


def asked(**fields: Any) -> str:
    return json.dumps({"token": TOKEN, **fields})


def test_a_request_is_read() -> None:
    request = request_of(asked(do="move", x=1, z=2.5, lean=15), TOKEN)
    assert request == Move(token=TOKEN, x=1.0, z=2.5, lean=15.0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        "\ud800",
        asked(do="fly"),
        asked(),
        asked(do="move", x=1, z=2),
        asked(do="move", x="1", z=2, lean=15),
        asked(do="move", x=float("nan"), z=2, lean=15),
        asked(do="move", x=1e300, z=2, lean=15),
        asked(do="move", x=1, z=2, lean=1e999),
        asked(do="engage", force=True),
        asked(do="preset", number=0),
        asked(do="preset", number=1.5),
        asked(do="set", name="X" * 17, value=1),
        asked(do="hello", name="x" * 25),
        asked(do="set", name="RHO_P", value=1, more="x" * LONGEST),
    ],
)
def test_what_is_no_request_is_refused(text: str) -> None:
    with pytest.raises(Refused, match="request"):
        request_of(text, TOKEN)


@pytest.mark.parametrize("token", ["", "a-token-for-the-test", "a-token-for-the-testS", "ä\ud7ff"])
def test_without_the_token_nothing_is_obeyed(token: str) -> None:
    with pytest.raises(Refused, match="wrong token"):
        request_of(json.dumps({"token": token, "do": "engage"}), TOKEN)


def test_the_line_is_in_one_hand_at_a_time() -> None:
    holder = Holder()
    assert holder.take(1, "Anna", 0.0)
    assert not holder.take(2, "Bert", 1.0)
    assert holder.name(1.0) == "Anna"
    assert holder.take(1, "Anna", HOLD_S - 0.1)  # still at it
    assert not holder.take(2, "Bert", HOLD_S + 0.1)
    assert holder.take(2, "Bert", 2 * HOLD_S)
    assert not holder.drop(1)
    assert holder.page(2 * HOLD_S) == 2
    assert holder.drop(2)
    assert holder.page(2 * HOLD_S) == 0
    assert holder.name(2 * HOLD_S) == ""


def test_a_flood_uses_up_its_allowance_and_a_hand_does_not() -> None:
    allowance = ClientAllowance()
    flood = [allowance.spend(0.0) for _ in range(int(AT_ONCE) + 1)]
    assert all(flood[:-1])
    assert not flood[-1]
    hand = ClientAllowance()
    assert all(hand.spend(i / (0.9 * PER_S)) for i in range(1000))


def test_a_frame_says_what_has_changed() -> None:
    before = {"now": {"a": 1.0, "b": 2.0, "c": 3.0}, "busy": False, "ghost": {"x": 1}}
    now = {"now": {"a": 1.0, "b": 2.5}, "busy": False, "ghost": None}
    assert changed(before, now) == {"now": {"b": 2.5, "c": None}, "ghost": None}
    assert changed({}, now) == now
    assert changed(now, now) == {}
    ghosts = [{"ghost": {"x": 1, "refusal": ""}}, {"ghost": {"x": 2, "refusal": ""}}]
    assert changed(*ghosts) == ghosts[1]  # a part of it would be none


def test_a_page_that_takes_nothing_misses_frames_and_gets_the_whole_when_it_does() -> None:
    async def reported() -> tuple[list[Any], list[Any], int, list[str]]:
        pages = Broadcast()
        quick: list[Any] = []
        slow: list[Any] = []
        gate = asyncio.Event()

        async def take(text: str) -> None:
            quick.append(msgspec.json.decode(text))

        async def wait(text: str) -> None:
            await gate.wait()
            slow.append(msgspec.json.decode(text))

        pages.add("quick", take)
        stalled = pages.add("slow", wait)
        gone: list[str] = []
        for i in range(5):
            if i == 3:
                gate.set()
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            state = {"now": {"n": i}}
            shown = pages.show(state, {"rows": [[i]]}, partial(dict, state), float(i))
            gone += [viewer.name for viewer in shown]
            await asyncio.sleep(0)
        return quick, slow, stalled.dropped, gone

    quick, slow, dropped, gone = asyncio.run(reported())
    assert quick[0] == {"whole": True, "now": {"n": 0}}
    assert quick[1:] == [{"now": {"n": i}, "rows": [[i]]} for i in range(1, 5)]
    assert dropped == 2
    assert [frame.get("whole", False) for frame in slow] == [True, True, False]
    assert [frame["now"]["n"] for frame in slow] == [0, 3, 4]
    assert gone == []


def test_a_page_that_takes_nothing_for_long_is_gone() -> None:
    async def reported() -> list[str]:
        pages = Broadcast()

        async def never(_text: str) -> None:
            await asyncio.Event().wait()

        viewer = pages.add("dead", never)
        assert pages.show({}, {}, dict, 0.0) == []
        await asyncio.sleep(0)
        assert pages.show({}, {}, dict, STALLED_S - 1.0) == []
        gone = pages.show({}, {}, dict, STALLED_S)
        pages.remove(viewer)
        return [viewer.name for viewer in gone]

    assert asyncio.run(reported()) == ["dead"]
