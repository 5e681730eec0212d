"""A tracker as a site file names it: which settings go where, and another server in its place."""

from __future__ import annotations

from math import pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.config.files import ConfigError, load_site
from tgl_soar.config.site import Mocap
from tgl_soar.link.natnet import layout
from tgl_soar.onboard import mocap
from tgl_soar.onboard.mocap import MocapFeed, from_server, server_address

# The sockets are put in the place of the real ones.
pytestmark = pytest.mark.interpreted

SITES = Path(__file__).parents[2] / "config/sites"
MULTICAST = Mocap(
    server="10.0.0.5",
    body="glider",
    interface="10.0.0.7",
    group="239.1.2.3",
    command_port=1600,
    data_port=1601,
    up="z",
    yaw_deg=90.0,
    offset_m=(1.0, 2.0, 3.0),
    noise_m=0.002,
    max_error_m=0.03,
    max_speed_mps=20.0,
    max_age_s=0.25,
    max_rate_hz=120.0,
)
UNICAST = Mocap(server="10.0.0.5", body=7, stream="unicast")


class Sockets:
    """What was asked of them."""

    server = "192.0.2.9"  # the address that the name has

    def __init__(self, *given: Any, **named: Any) -> None:
        self.given, self.named = given, named
        self.done: list[Any] = []

    def filenos(self) -> list[int]:
        return [3, 4]

    def receive(self, most: int) -> list[tuple[bytes, tuple[str, int]]]:
        return [(b"data", ("192.0.2.9", most))]

    def send(self, data: bytes) -> None:
        self.done.append(data)

    def follow(self, group: str, port: int) -> None:
        self.done.append((group, port))

    def close(self) -> None:
        self.done.append("closed")


@pytest.fixture(autouse=True)
def sockets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mocap, "NatNetSockets", Sockets)


def made(settings: Mocap) -> tuple[MocapFeed, Any]:
    feed = MocapFeed(settings)
    return feed, feed._sockets


def test_a_multicast_server_is_received_on_its_group() -> None:
    _, asked = made(MULTICAST)
    assert asked.given == ("10.0.0.5", 1600)
    assert asked.named == {"interface": "10.0.0.7", "group": "239.1.2.3", "port": 1601}


def test_a_unicast_server_on_no_group() -> None:
    _, asked = made(UNICAST)
    assert asked.given == ("10.0.0.5", 1510)
    assert asked.named == {"interface": "", "group": "", "port": 1511}


def test_the_client_is_given_what_the_file_says() -> None:
    feed, _ = made(MULTICAST)
    settings = feed.client._settings
    assert settings.server == "192.0.2.9"
    assert settings.body == "glider"
    assert settings.unicast is False
    assert settings.hall.z_up
    assert settings.hall.yaw_rad == pytest.approx(pi / 2)
    hall = settings.hall
    assert (hall.origin_north_m, hall.origin_east_m, hall.origin_down_m) == (1.0, 2.0, 3.0)
    assert (settings.noise_m, settings.max_error_m) == (0.002, 0.03)
    assert (settings.max_speed_mps, settings.max_age_s, settings.max_rate_hz) == (20.0, 0.25, 120.0)
    feed, _ = made(UNICAST)
    assert feed.client._settings.unicast is True
    assert feed.client._settings.body == 7
    assert not feed.client._settings.hall.z_up


@pytest.mark.parametrize(
    ("settings", "done"),
    [(MULTICAST, ["closed"]), (UNICAST, [layout.disconnect(), "closed"])],
)
def test_only_a_server_that_streams_to_us_alone_is_sent_a_goodbye(
    settings: Mocap, done: list[Any]
) -> None:
    feed, asked = made(settings)
    feed.close()
    assert asked.done == done


def test_what_the_sockets_bring_and_take_goes_through() -> None:
    feed, asked = made(MULTICAST)
    assert feed.filenos() == [3, 4]
    assert feed.receive(5) == [(b"data", ("192.0.2.9", 5))]
    assert feed.receive()[0][1][1] == 16  # datagrams of each socket at once
    feed.send(b"request")
    stream: Any = SimpleNamespace(group="239.9.9.9", port=1700)
    feed.follow(stream)
    assert asked.done == [b"request", ("239.9.9.9", 1700)]


@pytest.mark.parametrize(
    ("server", "host", "port"),
    [
        ("motive", "motive", None),
        ("10.0.0.5:1", "10.0.0.5", 1),
        ("10.0.0.5:65535", "10.0.0.5", 65535),
    ],
)
def test_a_server_is_a_host_and_perhaps_a_port(server: str, host: str, port: int | None) -> None:
    assert server_address("--mocap-server", server) == (host, port)


@pytest.mark.parametrize(
    "server", ["", ":1510", "host:", "host:0", "host:65536", "host:-1", "host:many", "a:1:2"]
)
def test_anything_else_is_refused_by_the_option_s_name(server: str) -> None:
    with pytest.raises(ConfigError) as caught:
        server_address("--server", server)
    assert str(caught.value) == f"--server {server!r}: write HOST or HOST:PORT"


def test_another_server_takes_the_place_of_the_site_s_and_nothing_else() -> None:
    site = load_site(SITES / "tunnel_mocap.toml")
    before = site.mocap
    assert before is not None
    moved = from_server(site, "10.9.8.7").mocap
    assert moved is not None
    assert (moved.server, moved.command_port) == ("10.9.8.7", before.command_port)
    ported = from_server(site, "10.9.8.7:1700").mocap
    assert ported is not None
    assert (ported.server, ported.command_port) == ("10.9.8.7", 1700)
    assert (ported.body, ported.data_port, ported.hall()) == (
        *(before.body, before.data_port),
        before.hall(),
    )


def test_a_site_without_a_tracker_has_no_server_to_be_another() -> None:
    site = load_site(SITES / "hill.toml")
    with pytest.raises(ConfigError, match=r"--mocap-server: site .* has no \[mocap\] table"):
        from_server(site, "10.9.8.7")
