"""Who may ask how often, who holds the line and for how long, and what a page is sent in turn."""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tgl_soar.cli.page.broadcast import FRAMES_PER_S, Broadcast, Viewer
from tgl_soar.cli.page.browser_requests import (
    ClientAllowance,
    Hello,
    Holder,
    Preset,
    Refused,
    SetParameter,
    is_token,
    request_of,
)
from tgl_soar.cli.page.command import PORT, _announce, _is_loopback, _listener, _reachable
from tgl_soar.link.transports.base import LinkError

TOKEN = "a-token-for-the-tests"


def asked(**fields: Any) -> str:
    return msgspec.json.encode({"token": TOKEN, **fields}).decode()


# --- requests ----------------------------------------------------------------------------------


def test_a_request_of_1024_bytes_is_read_and_no_longer_one() -> None:
    short = asked(do="hold")
    assert request_of(short + " " * (1024 - len(short)), TOKEN)
    with pytest.raises(Refused, match="a request has at most 1024 bytes"):
        request_of(short + " " * (1025 - len(short)), TOKEN)


@pytest.mark.parametrize(("fields", "is_good"), [
    ({"do": "preset", "number": 1}, True), ({"do": "preset", "number": 99}, True),
    ({"do": "preset", "number": 0}, False), ({"do": "preset", "number": 100}, False),
    ({"do": "set", "name": "X" * 16, "value": 1}, True),
    ({"do": "set", "name": "X" * 17, "value": 1}, False),
    ({"do": "hello", "name": "x" * 24}, True), ({"do": "hello", "name": "x" * 25}, False),
    ({"do": "look", "x": 100_000, "z": -100_000, "lean": 180}, True),
    ({"do": "look", "x": 100_001, "z": 0, "lean": 0}, False),
    ({"do": "look", "x": 0, "z": -100_001, "lean": 0}, False),
    ({"do": "look", "x": 0, "z": 0, "lean": -181}, False),
    ({"do": "look", "x": 0, "z": 0, "lean": 181}, False),
    ({"do": "look", "x": 0, "z": 0, "lean": -180}, True),
    ({"do": "look", "x": -100_001, "z": 0, "lean": 0}, False),
    ({"do": "look", "x": 0, "z": 100_001, "lean": 0}, False),
    ({"do": "move", "x": 0, "z": 0, "lean": 0, "at": 12.5}, True),
])  # fmt: skip
def test_numbers_and_names_of_a_request_have_their_bounds(
    fields: dict[str, Any], is_good: bool
) -> None:
    if is_good:
        assert request_of(asked(**fields), TOKEN)
    else:
        with pytest.raises(Refused, match="this is no request"):
            request_of(asked(**fields), TOKEN)


def test_what_a_request_holds() -> None:
    assert request_of(asked(do="hello"), TOKEN) == Hello(token=TOKEN, name="")
    assert request_of(asked(do="preset", number=3), TOKEN) == Preset(token=TOKEN, number=3)
    wanted = SetParameter(token=TOKEN, name="RHO_P", value=0.5)
    assert request_of(asked(do="set", name="RHO_P", value=0.5), TOKEN) == wanted
    move: Any = request_of(asked(do="move", x=1, z=2, lean=3), TOKEN)
    assert (move.x, move.z, move.lean, move.at) == (1.0, 2.0, 3.0, 0.0)


@pytest.mark.parametrize("given", ["", "a-token-for-the-test", "b-token-for-the-tests", "\ud800"])
def test_another_token_is_refused_with_the_way_out(given: str) -> None:
    assert is_token(TOKEN, TOKEN)
    assert not is_token(given, TOKEN)
    if given.isascii():
        text = msgspec.json.encode({"do": "hold", "token": given}).decode()
        with pytest.raises(Refused, match="wrong token: open the address that was printed"):
            request_of(text, TOKEN)


def test_a_token_has_128_characters_at_most() -> None:
    long = "t" * 128
    assert request_of(msgspec.json.encode({"do": "hold", "token": long}), long)
    with pytest.raises(Refused, match="this is no request"):
        request_of(msgspec.json.encode({"do": "hold", "token": long + "t"}), long + "t")


def test_120_requests_at_once_and_then_60_a_second() -> None:
    allowance = ClientAllowance()
    assert [allowance.spend(10.0) for _ in range(121)] == [True] * 120 + [False]
    assert [allowance.spend(10.5) for _ in range(31)] == [True] * 30 + [False]
    assert not allowance.spend(10.51)
    assert allowance.spend(10.53)
    # A page that asks nothing for long has no more than 120.
    assert sum(allowance.spend(1000.0) for _ in range(200)) == 120


# --- who holds the line ------------------------------------------------------------------------


def test_a_line_is_held_for_five_seconds_from_the_last_word() -> None:
    holder = Holder()
    assert (holder.page(0.0), holder.name(0.0)) == (0, "")
    assert holder.take(1, "Anna", 10.0)
    assert not holder.take(2, "Bert", 15.0)
    assert holder.take(1, "Anna", 15.0)  # and on
    assert (holder.page(20.0), holder.name(20.0)) == (1, "Anna")
    assert holder.take(2, "Bert", 20.01)
    assert (holder.page(20.01), holder.name(20.01)) == (2, "Bert")
    assert (holder.page(26.0), holder.name(26.0)) == (0, "")


def test_only_who_holds_the_line_lets_it_go() -> None:
    holder = Holder()
    holder.take(1, "Anna", 10.0)
    assert not holder.drop(2)
    assert holder.page(10.0) == 1
    assert holder.drop(1)
    assert (holder.page(10.0), holder.name(10.0)) == (0, "")
    assert not holder.drop(1)


# --- frames ------------------------------------------------------------------------------------


def test_pages_are_numbered_and_named_and_each_is_sent_the_whole_first() -> None:
    async def shown() -> tuple[list[Any], list[str], Broadcast]:
        pages = Broadcast()
        got: list[Any] = []
        wholes = 0

        async def take(text: str) -> None:
            got.append(msgspec.json.decode(text))

        def whole() -> dict[str, Any]:
            nonlocal wholes
            wholes += 1
            return {"n": 1, "rows": [1, 2]}

        first, second = pages.add("", take), pages.add("Bert", take)
        names = [first.name, second.name]
        assert (first.number, second.number) == (1, 2)
        assert pages.show({"n": 1}, {"rows": [2], "texts": []}, whole, 0.0) == []
        assert wholes == 1  # made once for both
        await asyncio.sleep(0)
        pages.remove(first)
        pages.remove(first)  # gone already
        assert pages.show({"n": 2}, {"rows": [3], "texts": []}, whole, 0.05) == []
        await asyncio.sleep(0)
        assert pages.add("Carl", take).number == 3
        assert wholes == 1
        return got, names, pages

    got, names, pages = asyncio.run(shown())
    assert names == ["page 1", "Bert"]
    assert got == [{"whole": True, "n": 1, "rows": [1, 2]}] * 2 + [{"n": 2, "rows": [3]}]
    assert pages.frames == 2
    assert list(pages.viewers) == [2, 3]
    assert FRAMES_PER_S == 20.0


def test_a_page_is_offered_nothing_while_a_frame_is_on_its_way() -> None:
    async def offered() -> list[Any]:
        gate = asyncio.Event()
        got: list[str] = []

        async def take(text: str) -> None:
            await gate.wait()
            got.append(text)

        page = Viewer(7, "page", take)
        assert not page.is_sending
        found: list[Any] = [page.offer("change 1", lambda: "whole 1", 0.0)]
        await asyncio.sleep(0)
        assert page.is_sending
        found += [page.offer("change 2", lambda: "whole 2", 29.9), page.dropped]
        found += [page.offer("change 3", lambda: "whole 3", 30.0), page.dropped]
        gate.set()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        found += [page.offer("change 4", lambda: "whole 4", 30.1)]
        await asyncio.sleep(0)
        found += [page.offer("change 5", lambda: "whole 5", 31.0)]
        await asyncio.sleep(0)
        return [*found, got]

    assert asyncio.run(offered()) == [
        *(True, True, 1, False, 2, True, True),
        ["whole 1", "whole 4", "change 5"],
    ]


def test_a_page_that_cannot_be_sent_to_is_gone() -> None:
    async def offered() -> tuple[bool, bool]:
        async def take(_text: str) -> None:
            raise ConnectionError

        page = Viewer(1, "page", take)
        first = page.offer("a", lambda: "b", 0.0)
        await asyncio.sleep(0)
        second = page.offer("a", lambda: "b", 1.0)
        page.end()
        return first, second

    assert asyncio.run(offered()) == (True, False)


# --- where the page is served at ---------------------------------------------------------------


@pytest.mark.parametrize(("host", "is_own"), [
    ("127.0.0.1", True), ("127.0.0.5", True), ("::1", True), ("localhost", True),
    ("0.0.0.0", False), ("192.168.1.5", False), ("example.org", False),
])  # fmt: skip
def test_the_network_is_warned_of_where_the_page_is_open_to_it(
    host: str, is_own: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _is_loopback(host) == is_own
    listener: Any = SimpleNamespace(getsockname=lambda: (host, 4321))
    _announce(listener, "the-token", host)
    out, err = capsys.readouterr()
    shown = socket.gethostname() if host == "0.0.0.0" else f"[{host}]" if ":" in host else host
    assert out == f"the operator's page: http://{shown}:4321/#token=the-token\n"
    assert ("open to the network" in err) == (not is_own)
    if not is_own:
        assert "ssh -L 4321:127.0.0.1:4321" in err


@pytest.mark.parametrize(("host", "shown"), [
    ("0.0.0.0", None), ("::", None), ("127.0.0.1", "127.0.0.1"), ("10.0.0.2", "10.0.0.2"),
])  # fmt: skip
def test_all_addresses_are_reached_by_this_computers_name(host: str, shown: str | None) -> None:
    assert _reachable(host) == (shown or socket.gethostname())


def test_a_listener_listens_at_the_host_and_any_port() -> None:
    with _listener("127.0.0.1", 0) as listener:
        host, port = listener.getsockname()[:2]
        assert ipaddress.ip_address(host).is_loopback
        assert port > 0
        with pytest.raises(LinkError, match=f"--host 127.0.0.1 --port {port}: cannot be served at"):
            _listener("127.0.0.1", port)
    assert PORT == 8191
