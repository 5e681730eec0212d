"""The stand-in for Motive on the network: our client and PyPI's, over real sockets."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from free_ports import free_port
from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame
from natnet.nat_net_client import NatNetClient
from typer.testing import CliRunner

from tgl_soar.analysis.alignment import AlignmentError
from tgl_soar.cli.align import average_pose
from tgl_soar.cli.app import app
from tgl_soar.cli.console import console
from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.config.site import Mocap
from tgl_soar.link.natnet.sockets import NatNetError, NatNetNotReadyError, NatNetSockets
from tgl_soar.onboard.mocap import MocapFeed, from_server, server_address
from tgl_soar.sim.bridge.process import main as bridge_main
from tgl_soar.sim.motive import HallFault, Motive, MotiveOptions, MotiveServer
from tgl_soar.types import PositionFix

PLACE = (1.0, 2.0, -1.5)
STILL = (1.0, 0.0, 0.0, 0.0)
GROUP = "239.255.42.98"


@contextmanager
def streaming(options: MotiveOptions, mocap: Mocap) -> Iterator[MotiveServer]:
    """A server that streams in a thread of its own, in real time."""
    motive = Motive(options, mocap.hall(), mocap.body)
    server = MotiveServer(motive, ("127.0.0.1", 0), time.monotonic, step_hz=200)
    stop = threading.Event()

    def run() -> None:
        step = 0
        while not stop.wait(0.005):
            server.serve(step * 0.005)
            server.step(step, step * 0.005, PLACE, STILL)
            step += 1

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield server
    finally:
        stop.set()
        thread.join()
        server.close()


def site_of(server: MotiveServer, **keys: object) -> Mocap:
    return Mocap(server="127.0.0.1", command_port=server.port.local[1], body="aircraft", **keys)  # type: ignore[arg-type]


def listen(feed: MocapFeed, fixes: int) -> list[PositionFix]:
    """The first fixes, or what has come within some seconds."""
    found: list[PositionFix] = []
    deadline = time.monotonic() + 8.0
    while len(found) < fixes and time.monotonic() < deadline:
        for request in feed.client.poll(time.monotonic()):
            feed.send(request)
        if feed.client.stream is not None:
            feed.follow(feed.client.stream)
        for data, sender in feed.receive():
            fix = feed.client.take(data, sender, time.monotonic())
            found += [] if fix is None else [fix]
        time.sleep(0.002)
    return found


@pytest.mark.parametrize("multicast", [False, True])
def test_fixes_come_over_the_network(multicast: bool) -> None:
    port = free_port()
    options = MotiveOptions(version=(4, 2), multicast=multicast, group=GROUP, data_port=port)
    with streaming(options, Mocap(server="-", body="aircraft")) as server:
        stream = "multicast" if multicast else "unicast"
        # The site need not know the group and port: the server reports them.
        feed = MocapFeed(site_of(server, stream=stream, interface="127.0.0.1", data_port=port))
        try:
            fixes = listen(feed, 20)
        finally:
            feed.close()
    assert len(fixes) >= 20  # more where some come together
    now = time.monotonic()
    for fix in fixes:
        assert (fix.north_m, fix.east_m, fix.down_m) == pytest.approx(PLACE, abs=0.004)
        assert now - 10.0 < fix.time_s < now


def test_a_multicast_server_is_followed_to_its_port() -> None:
    port = free_port()
    options = MotiveOptions(multicast=True, group=GROUP, data_port=port)
    with streaming(options, Mocap(server="-", body="aircraft")) as server:
        feed = MocapFeed(site_of(server, interface="127.0.0.1", data_port=free_port()))
        try:
            assert len(listen(feed, 5)) >= 5
        finally:
            feed.close()


def test_a_second_server_is_not_listened_to() -> None:
    options = MotiveOptions(faults=(HallFault("second", 0.0, 99.0),))
    with streaming(options, Mocap(server="-", body="aircraft")) as server:
        feed = MocapFeed(site_of(server, stream="unicast"))
        try:
            fixes = listen(feed, 20)
        finally:
            feed.close()
    assert feed.client.counters.foreign > 10
    assert all(fix.north_m == pytest.approx(PLACE[0], abs=0.004) for fix in fixes)


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
def test_natnet_reads_the_stand_in_over_the_network(version: tuple[int, int]) -> None:
    frames: list[DataFrame] = []
    models: list[DataDescriptions] = []
    options = MotiveOptions(version=version, noise_m=0.0)
    with streaming(options, Mocap(server="-", body="aircraft", up="z")) as server:
        client = NatNetClient(use_multicast=False, command_port=server.port.local[1])
        client.on_data_frame_received_event.handlers.append(frames.append)
        client.on_data_description_received_event.handlers.append(models.append)
        client.connect(timeout=5.0)
        try:
            client.request_modeldef()
            deadline = time.monotonic() + 5.0
            while (len(frames) < 5 or not models) and time.monotonic() < deadline:
                client.update_sync()
                time.sleep(0.01)
            assert str(client.protocol_version).startswith(f"{version[0]}.{version[1]}")
        finally:
            client.shutdown()
    assert [body.name for body in models[0].rigid_bodies] == ["aircraft", "other 1", "other 2"]
    assert frames[-1].rigid_bodies[0].pos == pytest.approx((PLACE[0], -PLACE[1], -PLACE[2]))


# --- what cannot be opened, and the commands -------------------------------------------------


def test_what_cannot_be_opened_names_the_key() -> None:
    with pytest.raises(NatNetError, match=r"mocap\.server 'no\.such\.host\.invalid'"):
        MocapFeed(Mocap(server="no.such.host.invalid", body=1))
    # Its network may come up later; a mistyped server is not retried.
    with pytest.raises(NatNetNotReadyError, match=r"mocap\.interface 203\.0\.113\.7"):
        MocapFeed(Mocap(server="127.0.0.1", body=1, interface="203.0.113.7"))
    with pytest.raises(NatNetError, match=r"mocap\.interface camera net") as caught:
        NatNetSockets("127.0.0.1", 1510, interface="camera net")
    assert not isinstance(caught.value, NatNetNotReadyError)


def test_another_server_may_be_given_on_the_command_line() -> None:
    site = load_site(shipped("sites/tunnel_mocap.toml"))
    changed = from_server(site, "10.1.2.3:1600").mocap
    assert changed is not None
    assert (changed.server, changed.command_port) == ("10.1.2.3", 1600)
    assert server_address("--mocap-server", "host:65535") == ("host", 65535)
    assert server_address("--mocap-server", "host:1") == ("host", 1)
    for text in ("", ":1510", "host:0", "host:65536", "host:x"):
        with pytest.raises(ConfigError, match="write HOST or HOST:PORT"):
            from_server(site, text)
    with pytest.raises(ConfigError, match=r"has no \[mocap\] table"):
        from_server(load_site(shipped("sites/tunnel.toml")), "10.1.2.3")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--mocap-rate", "130"], "--mocap-rate 130: must divide the 200 steps"),
        (["--mocap-loss", "2"], "--mocap-loss 2: a number from 0 to 1"),
        (["--mocap-local", "nowhere"], "--mocap-local 'nowhere': write HOST:PORT"),
        (["--site", str(shipped("sites/tunnel.toml"))], "needs a [mocap] table"),
    ],
)
def test_the_bridge_names_a_wrong_option(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["--airframe", str(shipped("airframes/eclipson_c.toml"))]
    files += ["--site", str(shipped("sites/tunnel_mocap.toml"))]
    local = ["--gcs-local", "127.0.0.1:0", "--companion-local", "127.0.0.1:0"]
    assert bridge_main([*files, *local, "--mocap", "natnet", *options]) == 2
    assert words in capsys.readouterr().err


def test_a_pose_is_averaged_where_the_body_stands() -> None:
    with streaming(MotiveOptions(noise_m=0.001), Mocap(server="-", body="aircraft")) as server:
        feed = MocapFeed(site_of(server, stream="unicast"))
        try:
            hall, spread_m = average_pose(feed, 0.5)
        finally:
            feed.close()
    assert hall == pytest.approx((PLACE[0], -PLACE[2], PLACE[1]), abs=0.001)
    assert spread_m == pytest.approx(0.001 * 3**0.5, rel=0.5)
    with streaming(MotiveOptions(noise_m=0.05), Mocap(server="-", body="aircraft")) as server:
        feed = MocapFeed(site_of(server, stream="unicast"))
        try:
            with pytest.raises(AlignmentError, match="the body moves by"):
                average_pose(feed, 0.5)
        finally:
            feed.close()


# --- what is streamed -------------------------------------------------------------------------


def row_of(output: str, name: str) -> list[str]:
    (row,) = [line for line in output.splitlines() if f" {name} " in line]
    return [cell.strip() for cell in row.strip("│ ").split("│")]


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
@pytest.mark.parametrize("multicast", [False, True])
def test_the_bodies_that_are_streamed_are_listed(
    version: tuple[int, int], multicast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The aircraft is lost at times; how the server streams is found out."""
    monkeypatch.setattr(console, "width", 160)  # where there is no terminal it has taken 80
    options = MotiveOptions(
        version=version, multicast=multicast, group=GROUP, data_port=free_port(), noise_m=0.0,
        faults=(HallFault("untracked", 0.4, 99.0),),
    )  # fmt: skip
    with streaming(options, Mocap(server="127.0.0.1", body="aircraft")) as server:
        where = f"127.0.0.1:{server.port.local[1]}"
        words = ["mocap", "list", "--server", where, "--seconds", "1.5"]
        words += ["--interface", "127.0.0.1"]
        ran = CliRunner().invoke(app, words)
    assert ran.exit_code == 0, ran.output
    assert f"NatNet {version[0]}.{version[1]}" in ran.output
    assert ("multicast" if multicast else "unicast") + ": 3 rigid bodies" in ran.output
    number, _, tracked, rate, age, last, place = row_of(ran.output, "aircraft")
    assert number == "1"
    assert tracked.startswith("no")
    assert rate.endswith(" Hz")
    assert age.endswith(" ms")
    assert last == "now"
    assert place == "1.000, 1.500, 2.000 m"
    assert row_of(ran.output, "other 1")[2] == "yes"


def test_the_list_has_a_time_limit_and_says_why() -> None:
    words = ["mocap", "list", "--server", f"127.0.0.1:{free_port()}", "--timeout", "0.5"]
    ran = CliRunner().invoke(app, words)
    assert ran.exit_code == 2
    assert "no frame in 0.5 s: nobody has answered" in " ".join(ran.output.split())
    wrong = CliRunner().invoke(app, ["mocap", "list", "--server", "hall:x"])
    assert "--server 'hall:x': write HOST or HOST:PORT" in " ".join(wrong.output.split())
    wrong = CliRunner().invoke(
        app, ["mocap", "list", "--server", "127.0.0.1", "--interface", "eth0", "--timeout", "0.5"]
    )
    assert wrong.exit_code == 2
    assert "--interface 'eth0': must be an IPv4 address" in " ".join(wrong.output.split())
    without = CliRunner().invoke(
        app, ["mocap", "list", "--site", str(shipped("sites/tunnel.toml"))]
    )
    assert "no [mocap] table; name the server with --server" in " ".join(without.output.split())
