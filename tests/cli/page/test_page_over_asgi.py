"""What the page's server answers, asked without a socket: who is refused, the headers of every
answer, the place and the recording for who has the token, and the desk that works meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra `page` is not installed")

from tgl_soar.cli.page.server import Access, app_of

TOKEN = "a-token-for-the-tests"
OURS = "127.0.0.1:8191"


class Desk:
    """What is served of a desk; it works until it is closed."""

    def __init__(self, recording: str | None = None) -> None:
        self.scene, self.recording = '{"scene": 1}', recording
        self.done: list[str] = []

    async def work(self) -> None:
        self.done.append("works")
        try:
            await asyncio.Event().wait()
        finally:
            self.done.append("stopped")

    def close(self) -> None:
        self.done.append("closed")


def answered(
    path: str,
    desk: Desk | None = None,
    kind: str = "http",
    headers: Mapping[str, str] = MappingProxyType({}),
) -> list[dict[str, Any]]:
    """All that is sent back."""
    named = {"host": OURS, **headers}
    scope = {
        "type": kind,
        "http_version": "1.1",
        "method": "GET",
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": [(k.encode(), v.encode()) for k, v in named.items()],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8191),
    }
    sent: list[dict[str, Any]] = []
    requests = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> dict[str, Any]:
        if not requests:  # no page disconnects
            await asyncio.Event().wait()
        return requests.pop()

    async def send(message: Any) -> None:
        sent.append(message)

    given: Any = desk or Desk()
    asked: Any = scope
    asyncio.run(app_of(given, Access(TOKEN, "tent.local"))(asked, receive, send))
    return sent


def status(sent: list[dict[str, Any]]) -> int:
    return int(sent[0]["status"])


def text(sent: list[dict[str, Any]]) -> str:
    return b"".join(part.get("body", b"") for part in sent[1:]).decode()


def headers(sent: list[dict[str, Any]]) -> dict[str, str]:
    return {name.decode(): value.decode() for name, value in sent[0]["headers"]}


@pytest.mark.parametrize(
    ("path", "code"), [("/", 200), ("/static/main.js", 200), ("/scene", 403), ("/nothing", 404)]
)
def test_every_answer_is_kept_by_nobody_and_loads_nothing_from_elsewhere(
    path: str, code: int
) -> None:
    sent = answered(path)
    assert status(sent) == code
    found = headers(sent)
    assert found["cache-control"] == "no-cache"
    assert found["x-content-type-options"] == "nosniff"
    assert found["referrer-policy"] == "no-referrer"
    policy = {rule.strip() for rule in found["content-security-policy"].split(";")}
    assert policy == {
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    }


@pytest.mark.parametrize(("given", "let_in"), [
    (f"Bearer {TOKEN}", True), (TOKEN, True), ("Bearer wrong", False), ("", False), (None, False),
])  # fmt: skip
def test_the_place_and_the_recording_want_the_token(given: str | None, let_in: bool) -> None:
    named = {} if given is None else {"authorization": given}
    desk = Desk(recording='{"flight": 2}')
    for path, words in (("/scene", desk.scene), ("/recording", desk.recording)):
        sent = answered(path, desk, headers=named)
        if let_in:
            assert (status(sent), text(sent)) == (200, words)
            assert headers(sent)["content-type"] == "application/json"
        else:
            assert status(sent) == 403
            assert text(sent) == "wrong token: open the address that was printed\n"


def test_a_flight_has_no_recording() -> None:
    sent = answered("/recording", headers={"authorization": f"Bearer {TOKEN}"})
    assert (status(sent), text(sent)) == (404, "there is no recording: this is a flight\n")


@pytest.mark.parametrize(
    ("named", "let_in"),
    [
        ({}, True),
        ({"host": "tent.local:8191"}, True),
        ({"origin": f"http://{OURS}"}, True),
        ({"host": "evil.example:8191"}, False),
        ({"host": "evil.example:8191", "origin": "http://evil.example:8191"}, False),
        ({"origin": "http://evil.example"}, False),
        ({"origin": f"https://{OURS}"}, False),
    ],
)
def test_strangers_are_sent_away(named: dict[str, str], let_in: bool) -> None:
    sent = answered("/", headers=named)
    assert status(sent) == (200 if let_in else 403)
    if not let_in:
        assert text(sent) == "not from here\n"
        assert answered("/live", kind="websocket", headers=named) == [
            {"type": "websocket.close", "code": 1008}
        ]


def test_the_desk_works_while_the_server_runs_and_is_closed_behind_it() -> None:
    desk, sent = Desk(), []

    async def ran() -> list[str]:
        orders: asyncio.Queue[dict[str, str]] = asyncio.Queue()
        given: Any = desk
        scope: Any = {"type": "lifespan", "asgi": {"version": "3.0"}, "state": {}}

        async def send(message: Any) -> None:
            sent.append(message["type"])
            if message["type"] == "lifespan.startup.complete":
                await asyncio.sleep(0)
                assert desk.done == ["works"]
                await orders.put({"type": "lifespan.shutdown"})

        await orders.put({"type": "lifespan.startup"})
        receive: Any = orders.get
        await app_of(given, Access(TOKEN, "127.0.0.1"))(scope, receive, send)
        return desk.done

    assert asyncio.run(ran()) == ["works", "stopped", "closed"]
    assert sent == ["lifespan.startup.complete", "lifespan.shutdown.complete"]
