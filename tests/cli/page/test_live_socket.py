"""A page's connection from its hello to its end, over a socket that is written here: what is
passed on, with which word it is closed, and that a page that has gone is removed."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra `page` is not installed")

from starlette.websockets import WebSocketDisconnect

from tgl_soar.cli.page import server
from tgl_soar.cli.page.broadcast import Broadcast, Viewer
from tgl_soar.cli.page.browser_requests import AT_ONCE, Request
from tgl_soar.cli.page.server import MOST_VIEWERS, Access, _live

TOKEN = "a-token-for-the-tests"


def asked(do: str, token: str = TOKEN, **fields: Any) -> dict[str, Any]:
    return {"type": "websocket.receive", "text": json.dumps({"do": do, "token": token, **fields})}


HELLO = asked("hello", name="Anna")
GONE = {"type": "websocket.disconnect", "code": 1001}


class Socket:
    """Receives scripted messages, then nothing more: the page is gone, or waits for ever."""

    def __init__(self, messages: Iterable[dict[str, Any]], *, waits: bool = False) -> None:
        self.messages, self.waits = list(messages), waits
        self.accepted = False
        self.sent: list[Any] = []
        self.closed: list[tuple[int, str]] = []

    async def accept(self) -> None:
        self.accepted = True

    async def receive(self) -> dict[str, Any]:
        assert self.accepted
        if self.messages:
            return self.messages.pop(0)
        if self.waits:
            await asyncio.Event().wait()
        return GONE

    async def send_json(self, words: Any) -> None:
        self.sent.append(words)

    async def send_text(self, text: str) -> None:
        self.sent.append(text)

    async def close(self, code: int, reason: str) -> None:
        self.closed.append((code, reason))


class Desk:
    """Notes who asks for what, and who leaves."""

    def __init__(self, viewers: int = 0) -> None:
        self.pages = Broadcast()
        for _ in range(viewers):
            self.pages.add("", Socket([]).send_text)
        self.taken: list[tuple[str, Request]] = []
        self.left: list[str] = []

    def take(self, viewer: Viewer, request: Request, now_s: float) -> None:
        assert now_s > 0.0
        self.taken.append((viewer.name, request))

    def leave(self, viewer: Viewer) -> None:
        self.left.append(viewer.name)


def lived(socket: Socket, desk: Desk | None = None) -> Desk:
    desk = desk or Desk()
    given: Any = socket, desk, Access(TOKEN, "127.0.0.1")
    asyncio.run(_live(*given))
    return desk


def test_a_page_is_sent_its_number_requests_and_is_forgotten_when_it_has_gone() -> None:
    socket = Socket([HELLO, asked("hold"), asked("preset", number=3)])
    desk = lived(socket, Desk(viewers=2))
    assert socket.sent == [{"you": 3}]
    assert [(name, type(request).__name__) for name, request in desk.taken] == [
        ("Anna", "Hold"),
        ("Anna", "Preset"),
    ]
    assert socket.closed == []
    assert desk.left == ["Anna"]


@pytest.mark.parametrize(
    ("first", "word"),
    [
        (asked("hold"), "the first request is hello"),
        (asked("hello", token="wrong"), "wrong token: open the address that was printed"),
        ({"type": "websocket.receive", "bytes": b"\x00"}, "this is no request"),
        ({"type": "websocket.receive", "text": "{"}, "this is no request"),
    ],
)
def test_without_a_hello_it_is_closed_with_a_word_and_was_never_there(
    first: dict[str, Any], word: str
) -> None:
    socket = Socket([first, HELLO])
    desk = lived(socket)
    assert socket.closed == [(1008, word)]
    assert (socket.sent, desk.taken, desk.left, desk.pages.viewers) == ([], [], [], {})


def test_a_page_that_goes_before_its_hello_was_never_there() -> None:
    socket = Socket([])
    desk = lived(socket)
    assert (socket.closed, desk.left) == ([], [])


def test_a_page_that_says_no_hello_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert server.HELLO_S == 5.0
    monkeypatch.setattr(server, "HELLO_S", 0.0)
    socket = Socket([], waits=True)
    desk = lived(socket)
    assert socket.closed == [(1008, "no hello came")]
    assert desk.left == []


@pytest.mark.parametrize(("others", "let_in"), [(31, True), (32, False)])
def test_thirty_two_pages_may_be_open(others: int, let_in: bool) -> None:
    assert MOST_VIEWERS == 32
    socket = Socket([HELLO])
    desk = lived(socket, Desk(viewers=others))
    if let_in:
        assert (socket.sent, socket.closed, desk.left) == ([{"you": 32}], [], ["Anna"])
    else:
        assert socket.closed == [(1008, "32 pages are open already: close one")]
        assert (socket.sent, desk.left) == ([], [])


def test_a_flood_ends_the_page_which_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "time", SimpleNamespace(monotonic=lambda: 7.0))
    socket = Socket([HELLO, *[asked("hold")] * (int(AT_ONCE) + 5)])
    desk = lived(socket)
    assert socket.closed == [(1008, "too many requests: open the page again")]
    assert len(desk.taken) == AT_ONCE
    assert desk.left == ["Anna"]


def test_a_bad_request_later_ends_the_page_which_is_forgotten() -> None:
    socket = Socket([HELLO, asked("engage", token=f"{TOKEN}x"), asked("engage")])
    desk = lived(socket)
    assert socket.closed == [(1008, "wrong token: open the address that was printed")]
    assert (desk.taken, desk.left) == ([], ["Anna"])


@pytest.mark.parametrize("error", [RuntimeError("it was closed"), WebSocketDisconnect(1006)])
def test_a_page_that_cannot_be_sent_its_number_is_forgotten(error: Exception) -> None:
    socket = Socket([HELLO])

    async def fails(_words: Any) -> None:
        raise error

    socket.send_json = fails  # type: ignore[assignment, method-assign]
    assert lived(socket).left == ["Anna"]


@pytest.mark.parametrize("error", [RuntimeError("it was closed"), WebSocketDisconnect(1006)])
def test_a_page_that_has_gone_need_not_be_closed(error: Exception) -> None:
    for first, waits in ((asked("hold"), False), (None, True)):
        socket = Socket([] if first is None else [first], waits=waits)

        async def fails(_code: int, _reason: str) -> None:
            raise error

        socket.close = fails  # type: ignore[assignment, method-assign]
        with pytest.MonkeyPatch.context() as patch:
            if waits:
                patch.setattr(server, "HELLO_S", 0.0)
            assert lived(socket).left == []
