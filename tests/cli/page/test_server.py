"""The page's server over real sockets: who is let in, and what bad requests do to it."""

from __future__ import annotations

import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import pytest
from page_flight import PATIENCE_S, READY, SOARING, TOKEN, Flying, Served, page_on_a_flight

pytest.importorskip("starlette", reason="the extra `page` is not installed")
pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
client = pytest.importorskip("websockets.sync.client", reason="websockets are not installed")
exceptions = pytest.importorskip("websockets.exceptions")

WINDOW = ("127.0.0.1", "localhost", "[::1]", "192.168.1.20")


@pytest.fixture(scope="module")
def both() -> Iterator[tuple[Flying, Served]]:
    with page_on_a_flight() as (flying, served):
        flying.until(lambda flown: flown.mode == READY)
        yield flying, served


@pytest.fixture
def flying(both: tuple[Flying, Served]) -> Flying:
    return both[0]


@pytest.fixture
def served(both: tuple[Flying, Served]) -> Served:
    return both[1]


def get(served: Served, path: str, **headers: str) -> tuple[int, bytes, Any]:
    request = urllib.request.Request(f"http://127.0.0.1:{served.port}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return answer.status, answer.read(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read(), error.headers


def opened(served: Served, **options: Any) -> Any:
    """A socket of the server's."""
    address = f"ws://127.0.0.1:{served.port}/live"
    return client.connect(address, ping_interval=None, **options).__enter__()


class Page:
    """A browser's page without the browser."""

    def __init__(self, served: Served, name: str = "", **options: Any) -> None:
        self.socket = opened(served, **options)
        self.state: dict[str, Any] = {}
        self.notices: list[str] = []
        self.request("hello", name=name)

    def request(self, what: str, **fields: Any) -> None:
        self.socket.send(json.dumps({"do": what, "token": TOKEN, **fields}))

    def until(self, condition: Any) -> None:
        ends_s = time.monotonic() + PATIENCE_S
        while not condition(self):
            frame = json.loads(self.socket.recv(timeout=max(0.0, ends_s - time.monotonic())))
            self.notices += [notice["text"] for notice in frame.get("notices", ())]
            for name, value in frame.items():
                if isinstance(value, dict) and isinstance(self.state.get(name), dict):
                    self.state[name].update(value)
                else:
                    self.state[name] = value

    def closed(self) -> tuple[int, str]:
        """The code and the words it was closed with."""
        try:
            while True:
                self.socket.recv(timeout=PATIENCE_S)
        except exceptions.ConnectionClosed as closed:
            return (0, "") if closed.rcvd is None else (closed.rcvd.code, closed.rcvd.reason)

    def end(self) -> None:
        self.socket.close()


# --- who is let in ----------------------------------------------------------------------------


def test_the_page_and_its_files_are_served_and_nothing_else(served: Served) -> None:
    status, page, headers = get(served, "/")
    assert status == 200
    assert b"/static/main.js" in page
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert get(served, "/static/main.js")[0] == 200
    for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/etc/passwd", "/static/"):
        assert get(served, path)[0] in (404, 405), path


def test_the_page_loads_nothing_from_elsewhere_and_is_small(served: Served) -> None:
    from tgl_soar.cli.page.server import STATIC

    files = [path for path in STATIC.iterdir() if path.is_file()]
    size = sum(len(get(served, f"/static/{path.name}")[1]) for path in files)
    for path in files:
        text = path.read_text().replace("http://www.w3.org/2000/svg", "").replace("/^http/", "")
        assert "http" not in text, path
        assert "innerHTML" not in text, path
    scene = get(served, "/scene", Authorization=f"Bearer {TOKEN}")[1]
    assert size + len(scene) <= 300_000


@pytest.mark.parametrize("path", ["/scene", "/recording"])
@pytest.mark.parametrize("given", ["", "Bearer wrong", f"Bearer {TOKEN}x"])
def test_without_the_token_nothing_is_reported(served: Served, path: str, given: str) -> None:
    status, text, _ = get(served, path, Authorization=given)
    assert status == 403
    assert b"wrong token" in text


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
        {"Host": "evil.example"},
        {"Host": "evil.example:80", "Origin": "http://evil.example:80"},
    ],
)
def test_a_strangers_page_or_name_is_refused(served: Served, headers: dict[str, str]) -> None:
    assert get(served, "/", **headers)[0] == 403
    status, _, _ = get(served, "/scene", Authorization=f"Bearer {TOKEN}", **headers)
    assert status == 403
    origin = headers.get("Origin")
    if origin is not None and "Host" not in headers:
        with pytest.raises(exceptions.InvalidStatus):
            opened(served, origin=origin)


def test_a_name_is_ours_by_its_address_or_as_it_is_served() -> None:
    from tgl_soar.cli.page.server import is_own_name

    for name in WINDOW:
        assert is_own_name(name, "127.0.0.1")
        assert is_own_name(f"{name}:8191", "127.0.0.1")
    assert is_own_name("tent.local:8191", "tent.local")
    assert not is_own_name("evil.example:8191", "tent.local")
    assert not is_own_name("", "127.0.0.1")


# --- what bad requests do ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("garbage", "no request"),
        (b"\x00\xff", "no request"),
        (json.dumps({"do": "engage", "token": "wrong"}), "wrong token"),
        (json.dumps({"do": "hello", "token": "wrong"}), "wrong token"),
        (json.dumps({"do": "engage", "token": TOKEN}), "first request is hello"),
    ],
)
def test_a_bad_beginning_is_closed_with_a_word(
    served: Served, flying: Flying, text: str | bytes, words: str
) -> None:
    page = Page.__new__(Page)
    page.socket = opened(served)
    page.socket.send(text)
    code, reason = page.closed()
    assert code == 1008
    assert words in reason
    assert flying.flown.value("OP_ENGAGE") == 0.0


def test_garbage_and_floods_close_the_page_and_change_nothing(
    served: Served, flying: Flying
) -> None:
    watcher = Page(served)
    garbage = Page(served)
    garbage.socket.send("{" * 500)
    assert garbage.closed() == (1008, "this is no request")
    large = Page(served)
    large.socket.send("x" * 100_000)
    assert large.closed()[0] in (1008, 1009)
    flood = Page(served)
    with suppress(exceptions.ConnectionClosed):
        for _ in range(5000):
            flood.request("look", x=0.2, z=1.2, lean=15)
    assert flood.closed() == (1008, "too many requests: open the page again")
    watcher.until(lambda page: page.state.get("holder") == 0)
    now = dict(watcher.state["now"])
    watcher.until(lambda page: page.state["now"] != now)  # it still receives
    assert flying.flown.value("TGL_Z") == pytest.approx(1.15)
    watcher.end()


@pytest.mark.parametrize("what", ["engage", "abort", "hold"])
def test_a_token_that_is_wrong_later_ends_the_page_too(
    served: Served, flying: Flying, what: str
) -> None:
    watcher, page = Page(served), Page(served)
    page.until(lambda page: page.state.get("you"))
    page.socket.send(json.dumps({"do": what, "token": f"{TOKEN}x"}))
    assert page.closed() == (1008, "wrong token: open the address that was printed")
    watcher.until(lambda watcher: watcher.state.get("pages") == 1)
    assert watcher.state["holder"] == 0
    assert watcher.notices == []
    assert flying.flown.value("OP_ENGAGE") == 0.0
    watcher.end()


def test_ten_pages_and_one_that_takes_nothing(served: Served) -> None:
    pages = [Page(served) for _ in range(9)]
    stalled = socket.create_connection(("127.0.0.1", served.port))
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    request = (
        f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n"
    )
    stalled.sendall(request.encode())
    assert stalled.recv(64).startswith(b"HTTP/1.1 101")
    hello = json.dumps({"do": "hello", "token": TOKEN}).encode()
    stalled.sendall(bytes((0x81, 0x80 | len(hello), 0, 0, 0, 0)) + hello)

    def watch(page: Page) -> None:
        """All pages are connected, and go on receiving."""
        page.until(lambda page: page.state.get("pages", 0) >= 10)
        before = page.state["received"]
        page.until(lambda page: page.state["received"] > before)

    with ThreadPoolExecutor(len(pages)) as pool:
        list(pool.map(watch, pages))
        list(pool.map(Page.end, pages))
    stalled.close()


# --- hands ------------------------------------------------------------------------------------


def test_of_two_operators_one_holds_the_line(served: Served, flying: Flying) -> None:
    anna, bert = Page(served, "Anna"), Page(served, "Bert")
    anna.request("hold")
    bert.until(lambda page: page.state.get("holder_name") == "Anna")
    bert.request("move", x=0.5, z=1.5, lean=15)
    bert.until(lambda page: "the line is held by Anna" in page.notices)
    assert flying.flown.value("TGL_X") == pytest.approx(0.2)
    anna.end()  # a reload while it is held: it is free, and stays where it was
    bert.until(lambda page: page.state["holder"] == 0)
    bert.request("look", x=0.6, z=1.6, lean=15)
    bert.until(lambda page: page.state.get("ghost"))
    assert bert.state["ghost"]["refusal"] == ""
    bert.request("drop")
    bert.until(lambda page: page.state["ghost"] is None)
    assert flying.flown.value("TGL_X") == pytest.approx(0.2)
    bert.end()


def test_engage_a_parameter_and_the_death_of_the_page(served: Served, flying: Flying) -> None:
    page = Page(served)
    page.until(lambda page: len(page.state.get("parameters", ())) > 80)
    page.request("engage")
    flying.until(lambda flown: flown.mode == SOARING)
    page.request("set", name="RHO_P", value=0.6)
    page.until(lambda page: "RHO_P = 0.6: confirmed" in page.notices)
    page.request("set", name="RHO_P", value=77)
    page.until(lambda page: any("RHO_P = 77" in notice for notice in page.notices))
    page.request("set", name="NO_SUCH", value=1)
    page.until(lambda page: "NO_SUCH: no such parameter" in page.notices)
    page.request("preset", number=9)
    page.until(lambda page: "the site has no line 9" in page.notices)
    page.socket.socket.close()  # dies in the middle of it
    before = flying.flown.simulation.time_s
    flying.until(lambda flown: flown.simulation.time_s > before + 3.0)
    assert flying.flown.mode == SOARING
    page = Page(served)
    page.request("release")
    flying.until(lambda flown: flown.value("OP_ENGAGE") == 0.0)
    page.end()
