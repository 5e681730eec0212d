"""The module with all its sensors: what a tick is given, and what the autopilot is sent."""

from __future__ import annotations

from itertools import pairwise
from math import cos, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest
from free_ports import free_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar import autopilot
from tgl_soar.config.files import ConfigError, load_airframe, load_parameters, load_site, shipped
from tgl_soar.link.natnet.sockets import NatNetSockets
from tgl_soar.link.sources import GLOBAL_POSITION, MOCAP, VISION
from tgl_soar.onboard import loop
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import ModuleSetup, setup_from
from tgl_soar.types import NAN, NO_FIX, Inputs, PositionFix

AIRFRAME = shipped("airframes/eclipson_c.toml")
BRIDGE = (1, 197)
VISION_TABLE = """
sources = ["vision", "local_position"]
vision_from = [{ system = 1, component = 197 }]
"""
HALL_TABLE = """
sources = ["mocap", "local_position"]
[mocap]
server = "discover"
body = "aircraft"
"""
FORWARD = "[forward]\nrate_hz = 50.0\n"


def setup_of(tmp_path: Path, position: str = "", forward: str = "") -> ModuleSetup:
    site_path = tmp_path / "site.toml"
    site_path.write_text(f'[site]\nname = "test"\n[position]\n{position}\n{forward}')
    airframe, site = load_airframe(AIRFRAME), load_site(site_path)
    return setup_from(airframe, site, load_parameters(airframe, AIRFRAME, site, site_path))


class Bench:
    """The module, an autopilot on its first link and a bridge on the second."""

    def __init__(self, setup: ModuleSetup) -> None:
        self.now_s = 100.0
        self.frames: list[bytes] = []
        self.onboard = Onboard(setup, self._send, self.now_s)
        self.onboard.add_link(lambda _: True)
        self.codecs = {s: mavlink.MAVLink(None, *s) for s in ((1, 1), BRIDGE, (9, 1))}
        self.receives(mavlink.MAVLink_heartbeat_message(1, 3, 81 | 128, 0, 4, 3))

    def _send(self, frame: bytes) -> bool:
        self.frames.append(frame)
        return True

    def receives(self, message: Any, *, of: tuple[int, int] = (1, 1), link: int = 0) -> None:
        self.onboard.event(bytes(message.pack(self.codecs[of])), self.now_s, link)

    def runs(self, seconds: float, *, tracked: bool = False) -> None:
        """An autopilot with all its streams; a tracker in the hall, too, if it is tracked."""
        for _ in range(round(seconds * 200)):
            self.now_s += 0.005
            ms, us = round(self.now_s * 1e3) - 90_000, round(self.now_s * 1e6) - 90_000_000
            self.receives(mavlink.MAVLink_raw_imu_message(us, 10, 0, -1000, 1, 2, 3, 0, 0, 0))
            self.receives(mavlink.MAVLink_sys_status_message(16, 16, 16, *[0] * 10))
            self.receives(mavlink.MAVLink_vfr_hud_message(8.5, 0, 0, 0, 0, 0))
            self.receives(mavlink.MAVLink_servo_output_raw_message(us & 0xFFFFFFFF, 0, *[1500] * 8))
            self.receives(mavlink.MAVLink_local_position_ned_message(ms, 1, 2, -3, 0, 0, 0))
            self.receives(mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0, 0, 0, 0, 0))
            if tracked:
                fix = PositionFix(
                    sequence=0,
                    time_s=self.now_s - 0.01,
                    north_m=1.0,
                    east_m=2.0,
                    down_m=-3.0,
                    velocity_north_mps=NAN,
                    velocity_east_mps=NAN,
                    velocity_down_mps=NAN,
                    source=0,
                    sigma_m=0.001,
                )
                turned = (1.0, 0.0, 0.0, 0.0)
                self.onboard.session.sources.take(MOCAP, fix, self.now_s, turned)
            self.onboard.periodic(self.now_s)

    def reported(self, kind: str) -> list[Any]:
        decoder = mavlink.MAVLink(None)
        messages = decoder.parse_buffer(b"".join(self.frames)) or []
        return [m for m in messages if m.get_type() == kind]


def vision(time_s: float) -> Any:
    return mavlink.MAVLink_vision_position_estimate_message(
        round(time_s * 1e6), 7.0, 8.0, -9.0, 0.0, 0.0, 0.0, [0.0] * 21
    )


@pytest.mark.interpreted
def test_a_tick_is_given_all_that_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench, given = Bench(setup_of(tmp_path)), []
    step = autopilot.step

    def spied(laws: Any, state: Any, inputs: Inputs) -> Any:
        given.append(inputs)
        return step(laws, state, inputs)

    monkeypatch.setattr(autopilot, "step", spied)
    bench.runs(0.5)
    last = given[-1]
    assert min(last.position.sequence, last.attitude.sequence, last.imu.sequence) > 90
    assert last.imu.force_z_frd_mps2 == pytest.approx(-9.80665)
    assert last.airspeed.airspeed_mps == pytest.approx(8.5)
    assert last.surfaces[2:5] == (0.0, 0.0, 0.0)
    for sample in (last.position, last.attitude, last.imu, last.airspeed, last.surfaces):
        assert last.time_s - 0.01 < sample.time_s <= last.time_s + 1e-3
    assert last.autopilot[1:] == (True, True, False, 0)


@pytest.mark.interpreted
@pytest.mark.parametrize("asked", [True, False])
def test_the_tracker_s_attitude_is_flown_with_where_the_site_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: bool
) -> None:
    table = HALL_TABLE + ("attitude = true\n" if asked else "")
    bench, given = Bench(setup_of(tmp_path, table)), []
    step = autopilot.step

    def spied(laws: Any, state: Any, inputs: Inputs) -> Any:
        given.append(inputs.attitude)
        return step(laws, state, inputs)

    class Client:
        """Poses of a body that is turned by 0.2 rad, 10 ms late."""

        attitude = (cos(0.1), 0.0, 0.0, sin(0.1))
        notices: ClassVar[list[tuple[int, str]]] = []
        stream = None

        def poll(self, _now_s: float) -> list[bytes]:
            return []

        def follow(self, _stream: object) -> None:
            raise AssertionError

        def take(self, _data: bytes, _sender: Any, now_s: float) -> PositionFix:
            return NO_FIX._replace(
                time_s=now_s - 0.01, north_m=1.0, east_m=2.0, down_m=-3.0, sigma_m=0.001
            )

    monkeypatch.setattr(autopilot, "step", spied)
    client: Any = Client()
    bench.onboard.positions.add_mocap(client, client)
    for _ in range(500):
        bench.runs(0.005)
        bench.onboard.positions.pose(b"", ("", 0), bench.now_s)
    flown = given[-1].qz
    assert flown == pytest.approx(sin(0.1) if asked else 0.0)
    assert all(a.sequence <= b.sequence for a, b in pairwise(given))
    words = b"".join(bench.frames)
    assert (b"attitude: the tracker's" in words) is asked


def test_a_bridge_on_any_link_is_accepted_and_nobody_else(tmp_path: Path) -> None:
    bench = Bench(setup_of(tmp_path, VISION_TABLE))
    for of, link in (((9, 1), 1), ((1, 1), 1), ((9, 1), 0)):
        bench.receives(vision(5.0), of=of, link=link)
    assert bench.onboard.session.position.sequence == 0
    bench.receives(vision(5.0), of=BRIDGE, link=1)
    assert bench.onboard.session.position.source == VISION
    bench.receives(mavlink.MAVLink_local_position_ned_message(5, 1, 2, 3, 0, 0, 0), link=1)
    assert bench.onboard.session.position.sequence == 1


def test_our_own_positions_are_not_accepted(tmp_path: Path) -> None:
    """PX4 passes what it receives on to every link, us among them."""
    with pytest.raises(ConfigError, match="this module itself"):
        setup_of(tmp_path, VISION_TABLE.replace("197", "191"))


def test_a_tracked_pose_is_forwarded_at_its_rate_and_stops_with_the_tracker(
    tmp_path: Path,
) -> None:
    bench = Bench(setup_of(tmp_path, HALL_TABLE, FORWARD))
    bench.runs(2.0)
    assert bench.reported("VISION_POSITION_ESTIMATE") == []  # its own position is not for it
    bench.runs(4.0, tracked=True)
    poses = bench.reported("VISION_POSITION_ESTIMATE")
    assert 90 <= len(poses) <= 102  # 50 Hz, once the tracker has been steady for two seconds
    assert (poses[-1].x, poses[-1].y, poses[-1].z) == (1.0, 2.0, -3.0)
    assert poses[-1].covariance[0] == pytest.approx(1e-6)
    # By the clock in which a TIMESYNC is answered.
    assert poses[-1].usec * 1e-6 == pytest.approx(bench.now_s - 0.01, abs=0.03)
    bench.runs(1.0)
    assert len(bench.reported("VISION_POSITION_ESTIMATE")) - len(poses) <= 6


def test_a_bridge_that_speaks_to_the_autopilot_itself_is_not_repeated(tmp_path: Path) -> None:
    for link, repeated in ((1, True), (0, False)):
        bench = Bench(setup_of(tmp_path, VISION_TABLE, FORWARD))
        for _ in range(130):
            bench.runs(0.02)
            bench.receives(vision(bench.now_s), of=BRIDGE, link=link)
        bench.runs(1.0)
        assert bool(bench.reported("VISION_POSITION_ESTIMATE")) == repeated


def test_a_hill_needs_no_more_than_its_home(tmp_path: Path) -> None:
    home = "home = { latitude_deg = 51.99, longitude_deg = 4.375, altitude_m = 20.0 }"
    bench = Bench(setup_of(tmp_path, f'sources = ["global_position"]\n{home}'))
    place = mavlink.MAVLink_global_position_int_message(
        5, 519_900_000, 43_750_000, 25_000, 5_000, 0, 0, 0, 0
    )
    bench.receives(place)
    assert bench.onboard.session.position[2:5] == pytest.approx((0.0, 0.0, -5.0), abs=1e-6)
    assert bench.onboard.session.position.source == GLOBAL_POSITION


def test_a_server_that_streams_elsewhere_does_not_end_the_loop(tmp_path: Path) -> None:
    """Another socket follows it, and the first one is closed: the loop does not wait on it."""
    group = "239.255.42.98"
    feed: Any = NatNetSockets(
        "127.0.0.1", free_port(), interface="127.0.0.1", group=group, port=free_port()
    )
    silent: Any = SimpleNamespace(generation=0, fileno=lambda: -1, is_stream=False)
    silent.receive = lambda _now_s, _most: []
    rounds = 0

    def stop() -> bool:
        nonlocal rounds
        rounds += 1
        if rounds == 3:
            before = feed.filenos()
            feed.follow(group, free_port())
            assert feed.filenos() != before
        return rounds == 6

    try:
        onboard = Bench(setup_of(tmp_path, HALL_TABLE)).onboard
        assert loop.run(onboard, [silent], stop, print, mocap=feed)
    finally:
        feed.close()
    assert rounds == 6
