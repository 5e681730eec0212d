"""A host and a port behind the kind of a link, and what is reported where there are none."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from tgl_soar.link.open_link import is_open
from tgl_soar.link.transports.addresses import host_and_port, resolved
from tgl_soar.link.transports.base import LinkError, LinkNotReadyError

NEEDS = "needs a host and a port, as in udp:127.0.0.1:14540"


@pytest.mark.parametrize(
    ("rest", "host", "port"),
    [
        ("127.0.0.1:14540", "127.0.0.1", 14540),
        ("pixhawk:1", "pixhawk", 1),
        ("pixhawk:65535", "pixhawk", 65535),
        ("[::1]:5760", "::1", 5760),
        ("[fe80::1%eth0]:80", "fe80::1%eth0", 80),
    ],
)
def test_the_last_colon_parts_them_and_brackets_hold_an_address_with_colons(
    rest: str, host: str, port: int
) -> None:
    assert host_and_port("link", rest) == (host, port)


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        ("", NEEDS),
        ("host", NEEDS),
        ("14540", NEEDS),
        ("host:", NEEDS),
        (":14540", NEEDS),
        ("[]:14540", NEEDS),
        ("host:-1", NEEDS),
        ("host:١", NEEDS),  # a digit, but no port
        ("host:²", NEEDS),
        ("host:0", "port 0 is not in 1 to 65535"),
        ("host:65536", "port 65536 is not in 1 to 65535"),
    ],
)
def test_what_is_no_host_and_port_is_refused_by_the_link_s_name(rest: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        host_and_port(f"udp:{rest}", rest)
    assert str(caught.value) == f"link {f'udp:{rest}'!r}: {words}"
    assert not isinstance(caught.value, LinkNotReadyError)


@pytest.mark.parametrize("host", ["192.168..1", "my..host", "a" * 64 + ".example"])
def test_what_cannot_be_a_name_is_refused_as_one_that_is_not_known(host: str) -> None:
    with pytest.raises(LinkError, match="is not known: ") as caught:
        resolved(f"udp:{host}:1", host, 1, socket.SOCK_DGRAM)
    assert not isinstance(caught.value, LinkNotReadyError)
    assert is_open(f"udp:{host}:1")


def test_a_numeric_address_is_itself_of_its_own_family() -> None:
    assert resolved("x", "127.0.0.1", 80, socket.SOCK_DGRAM) == (
        socket.AF_INET,
        ("127.0.0.1", 80),
    )
    assert resolved("x", "::1", 81, socket.SOCK_STREAM) == (socket.AF_INET6, ("::1", 81))


def test_of_several_addresses_the_first_is_taken_for_the_kind_of_socket_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def known(host: str, port: int, **kind: int) -> list[Any]:
        asked.append((host, port, kind))
        return [
            (socket.AF_INET, kind["type"], 17, "", ("192.0.2.1", port)),
            (socket.AF_INET, kind["type"], 17, "", ("192.0.2.2", port)),
        ]

    monkeypatch.setattr(socket, "getaddrinfo", known)
    found = resolved("x", "pixhawk", 80, socket.SOCK_DGRAM)
    assert found == (socket.AF_INET, ("192.0.2.1", 80))
    assert asked == [("pixhawk", 80, {"type": socket.SOCK_DGRAM})]


@pytest.mark.parametrize(
    ("number", "passes"), [(socket.EAI_AGAIN, True), (socket.EAI_NONAME, False)]
)
def test_an_unknown_name_is_distinguished_from_one_that_could_not_be_looked_up(
    monkeypatch: pytest.MonkeyPatch, number: int, passes: bool
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise socket.gaierror(number, "not now")

    monkeypatch.setattr(socket, "getaddrinfo", fail)
    with pytest.raises(LinkError) as caught:
        resolved("udp:pixhawk:1", "pixhawk", 1, socket.SOCK_DGRAM)
    assert str(caught.value) == "link 'udp:pixhawk:1': host 'pixhawk' is not known: not now"
    assert isinstance(caught.value, LinkNotReadyError) is passes
