"""The OptiTrack client against the stand-in for Motive, both without sockets."""

from __future__ import annotations

import struct
from collections.abc import Callable
from itertools import pairwise
from math import cos, isfinite, isinf, pi, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tgl_soar.geometry import HallFrame
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.optitrack import Optitrack
from tgl_soar.sim.motive import HallFault, Motive, MotiveOptions
from tgl_soar.sim.natnet_frames import CLOCK_HZ, VERSIONS, encode_server_info
from tgl_soar.types import PositionFix

HALL = HallFrame(
    z_up=False, yaw_rad=0.6, origin_north_m=1.0, origin_east_m=-2.0, origin_down_m=0.25
)
SERVER = ("10.0.0.2", 1510)
OTHER = ("10.0.0.3", 1511)
CLIENT = ("10.0.0.9", 40000)
SETTINGS = OptitrackSettings(
    server=SERVER[0],
    body="aircraft",
    unicast=True,
    hall=HALL,
    noise_m=0.001,
    max_error_m=0.02,
    max_speed_mps=25.0,
    max_age_s=0.3,
    max_rate_hz=200.0,
)
SERVER_BEGAN_S = 3600.0  # before our clock
STEP_S = 0.005
STILL = (1.0, 0.0, 0.0, 0.0)


class Hall:
    """A server, a client, a network with a delay, and an aircraft that flies a slow circle."""

    def __init__(
        self,
        options: MotiveOptions | None = None,
        given: OptitrackSettings = SETTINGS,
        *,
        delay_s: float = 0.001,
        drift: float = 0.0,
        echoes: bool = True,
        lockstep: bool = False,
    ) -> None:
        self.motive = Motive(options or MotiveOptions(noise_m=0.0), given.hall, given.body)
        self.client = Optitrack(given, lockstep=lockstep)
        self.now_s = 100.0
        self.fixes: list[tuple[float, PositionFix]] = []  # with the time at which each came
        self.words: list[str] = []
        self.asked: list[int] = []
        self._delay_s, self._drift, self._echoes = delay_s, drift, echoes
        self._steps = 0
        self._lockstep = lockstep

    @property
    def simulated_s(self) -> float:
        return self._steps * STEP_S

    def clock_s(self) -> float:
        """The server's."""
        if self._lockstep:
            return self.now_s
        return SERVER_BEGAN_S + self.now_s * (1.0 + self._drift)

    def place(self, time_s: float) -> tuple[float, float, float]:
        return 3.0 + 0.3 * cos(0.9 * time_s), 1.0, -1.5 - 0.001 * time_s

    def step(self, change: Callable[[bytes], bytes] = bytes) -> None:
        """5 ms: requests out, an exposure every 10 ms, and what is streamed in."""
        for request in self.client.poll(self.now_s):
            (number,) = struct.unpack_from("<H", request)
            self.asked.append(number)
            if number != layout.ECHO_REQUEST or self._echoes:
                self.motive.receive(request, CLIENT, self.clock_s(), self.simulated_s)
        if self._steps % 2 == 0:
            self.motive.step(self.clock_s(), self.simulated_s, self.place(self.now_s), STILL)
        self.motive.send(self.clock_s(), self.simulated_s)
        arrival_s = self.now_s + self._delay_s
        for datagram in self.motive.take_datagrams():
            sender = OTHER if datagram.second else SERVER
            fix = self.client.take(change(datagram.data), sender, arrival_s)
            if fix is not None:
                self.fixes.append((arrival_s, fix))
        self.words += [text for _, text in self.client.notices]
        self.client.notices.clear()
        self._steps += 1
        self.now_s += STEP_S

    def run(self, seconds: float, change: Callable[[bytes], bytes] = bytes) -> Hall:
        for _ in range(round(seconds / STEP_S)):
            self.step(change)
        return self

    def worst_m(self) -> float:
        """How far a fix was from where the aircraft was at its time."""
        worst = 0.0
        for _, fix in self.fixes:
            truth = self.place(fix.time_s)
            off = (fix.north_m - truth[0], fix.east_m - truth[1], fix.down_m - truth[2])
            worst = max(worst, sqrt(sum(d * d for d in off)))
        return worst


# --- a good stream --------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("multicast", [False, True])
def test_fixes_come_from_every_version(version: layout.Version, multicast: bool) -> None:
    options = MotiveOptions(version=version, multicast=multicast, noise_m=0.0)
    hall = Hall(options, SETTINGS._replace(unicast=not multicast)).run(1.0)
    assert len(hall.fixes) == 99  # the last is on its way
    assert hall.worst_m() < 2e-3
    info = hall.client.info
    assert info is not None
    assert (info.version, info.clock_hz) == (version, CLOCK_HZ)
    assert (hall.client.stream is not None) == multicast
    assert not [words for words in hall.words if "speaks NatNet" not in words]


@pytest.mark.parametrize("z_up", [False, True])
@pytest.mark.parametrize("yaw_rad", [0.0, -2.5, pi / 2])
def test_the_hall_lies_as_the_site_says(z_up: bool, yaw_rad: float) -> None:
    given = SETTINGS._replace(
        hall=HallFrame(
            z_up=z_up, yaw_rad=yaw_rad, origin_north_m=-4.0, origin_east_m=2.0, origin_down_m=0.5
        )
    )
    hall = Hall(given=given).run(0.5)
    assert hall.fixes
    assert hall.worst_m() < 2e-3


def test_the_axes_of_the_hall_are_ned_as_written() -> None:
    """y up: x, y, z of the hall are north, up, east; z up: north, west, up."""
    for z_up, expected in ((False, (1.0, 3.0, -2.0)), (True, (1.0, -2.0, -3.0))):
        client = Optitrack(
            SETTINGS._replace(
                body=1,
                hall=HallFrame(
                    z_up=z_up, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0
                ),
            )
        )
        options = MotiveOptions(noise_m=0.0)
        motive = Motive(
            options,
            HallFrame(
                z_up=z_up, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0
            ),
            1,
        )
        (request,) = client.poll(0.0)
        motive.receive(request, CLIENT, 0.0, 0.0)
        motive.step(0.0, 0.0, expected, STILL)
        motive.send(0.02, 0.02)
        fixes = [client.take(d.data, SERVER, 0.03) for d in motive.take_datagrams()]
        fix, pose = fixes[-1], client.pose
        assert fix is not None
        assert pose is not None
        assert (pose.x_m, pose.y_m, pose.z_m) == (1.0, 2.0, 3.0)
        assert (fix.north_m, fix.east_m, fix.down_m) == expected


def test_a_body_may_be_named_by_its_number() -> None:
    hall = Hall(given=SETTINGS._replace(body=7)).run(0.5)
    assert len(hall.fixes) == 49
    assert layout.MODELS_REQUEST not in hall.asked


def test_sigma_is_the_noise_or_the_marker_error_where_that_is_larger() -> None:
    (_, fix), *_ = Hall().run(0.5).fixes
    assert fix.sigma_m == 0.001
    (_, fix), *_ = Hall(given=SETTINGS._replace(noise_m=1e-4)).run(0.5).fixes
    assert fix.sigma_m == pytest.approx(0.0004)


def test_fixes_are_thinned_to_a_rate() -> None:
    hall = Hall(given=SETTINGS._replace(max_rate_hz=50.0)).run(1.05)
    times = [fix.time_s for _, fix in hall.fixes]
    assert len(times) in range(49, 53)
    assert min(b - a for a, b in pairwise(times)) == pytest.approx(0.02, 0.05)


def test_a_unicast_server_receives_keep_alives() -> None:
    hall = Hall().run(10.0)
    assert hall.asked.count(layout.KEEP_ALIVE) == 10
    assert len(hall.fixes) > 990
    quiet = Hall(given=SETTINGS._replace(unicast=False)).run(10.0)
    assert layout.KEEP_ALIVE not in quiet.asked


def test_in_lockstep_the_servers_clock_is_the_vehicles() -> None:
    hall = Hall(delay_s=0.0, lockstep=True).run(1.0)
    assert [fix.time_s for _, fix in hall.fixes[:3]] == pytest.approx([100.0, 100.01, 100.02])
    assert hall.worst_m() < 1e-6
    assert layout.ECHO_REQUEST not in hall.asked
    assert hall.client.uncertainty_s == 0.0


# --- its time -------------------------------------------------------------------------------


@pytest.mark.parametrize("drift", [-5e-5, 5e-5])
def test_echoes_tell_the_time_and_how_wrong_it_can_be(drift: float) -> None:
    """Echoes are answered at once and their answer takes 1 ms: the truth is within half of it."""
    hall = Hall(drift=drift).run(60.0)
    for arrival_s, fix in hall.fixes:
        exposed_s = round((arrival_s - 0.001 - 0.010) / STEP_S) * STEP_S
        assert abs(fix.time_s - exposed_s) <= 0.0005 + 1e-4 + 2e-6
    assert hall.client.uncertainty_s <= 0.0005 + 1e-4
    assert hall.client.latency_s == pytest.approx(0.011, abs=0.001)


def test_without_echoes_the_smallest_delay_tells_the_time() -> None:
    hall = Hall(drift=3e-5, echoes=False).run(20.0)
    for arrival_s, fix in hall.fixes:
        exposed_s = round((arrival_s - 0.001 - 0.010) / STEP_S) * STEP_S
        assert fix.time_s - exposed_s == pytest.approx(0.001, abs=2e-5)
    assert isinf(hall.client.uncertainty_s)


def test_a_restarted_server_has_another_clock() -> None:
    options = MotiveOptions(noise_m=0.0, faults=(HallFault("restart", 2.0, 2.6),))
    hall = Hall(options).run(6.0)
    assert hall.client.counters.restarts == 1
    assert hall.client.counters.odd > 0
    assert hall.worst_m() < 2e-3
    gaps = [b[0] - a[0] for a, b in pairwise(hall.fixes)]
    assert max(gaps) < 2.0
    assert any("restarted, with another clock" in words for words in hall.words)


def test_a_server_that_counts_again_is_asked_for_its_bodies() -> None:
    """Motive is restarted on the same computer: the clock goes on, ids may be others."""
    faults = (HallFault("restart", 2.0, 2.5), HallFault("swap", 2.0, 9.0))
    hall = Hall(MotiveOptions(noise_m=0.0, faults=faults, restarted_clock=False)).run(6.0)
    assert hall.client.counters.restarts == 0
    assert hall.client.models["aircraft"] == 2
    assert hall.worst_m() < 2e-3
    assert hall.fixes[-1][0] > hall.now_s - 0.02
    assert "the last was 10.5 ms old, give or take 0.5" in hall.client.summary()


def test_frames_that_are_numbered_again_without_a_pause_make_it_ask_for_the_bodies() -> None:
    """A take that is played in a loop, or a server that was restarted: ids may be others."""
    hall = Hall().run(3.0)
    asked, count = hall.asked.count(layout.MODELS_REQUEST), len(hall.fixes)

    def renumbered(data: bytes) -> bytes:
        if data[0] != layout.FRAME:
            return data
        (number,) = struct.unpack_from("<i", data, 4)
        return data[:4] + struct.pack("<i", number - 200) + data[8:]

    hall.run(0.1, renumbered)
    assert hall.asked.count(layout.MODELS_REQUEST) == asked + 1
    assert len(hall.fixes) > count  # and it goes on


def test_one_frame_with_another_clock_is_not_accepted() -> None:
    hall = Hall().run(1.0)
    count = len(hall.fixes)

    def shifted(data: bytes) -> bytes:
        if data[0] != layout.FRAME:
            return data
        ticks = struct.unpack_from("<QQQ", data, len(data) - 38)
        moved = struct.pack("<QQQ", *(t + 100 * CLOCK_HZ for t in ticks))
        return data[:-38] + moved + data[-14:]

    hall.run(0.02, shifted)
    assert (hall.client.counters.odd, len(hall.fixes)) == (2, count)
    hall.run(1.0)
    assert hall.client.counters.restarts == 0
    assert len(hall.fixes) == count + 100


@pytest.mark.interpreted
def test_a_hold_up_is_no_restart() -> None:
    """Frames that were kept back for 2 s come in one burst: old, and their clock is the same."""
    hall = Hall().run(2.0)
    kept: list[bytes] = []
    take = hall.client.take
    hall.client.take = lambda data, *_: kept.append(data)  # type: ignore[method-assign]
    hall.run(2.0)
    hall.client.take = take  # type: ignore[method-assign]
    for data in kept:
        fix = take(data, SERVER, hall.now_s)
        if fix is not None:
            hall.fixes.append((hall.now_s, fix))
    hall.run(1.0)
    assert hall.client.counters.restarts == 0
    assert hall.client.counters.stale > 0
    assert all(arrival_s - fix.time_s <= 0.3 for arrival_s, fix in hall.fixes)
    assert hall.worst_m() < 3e-3


def test_frames_out_of_order_are_not_used() -> None:
    hall = Hall(MotiveOptions(noise_m=0.0, jitter_s=0.04)).run(5.0)
    assert hall.client.counters.out_of_order > 50
    times = [fix.time_s for _, fix in hall.fixes]
    assert times == sorted(times)
    assert len(times) + hall.client.counters.out_of_order in range(490, 500)


# --- faults ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "counter"),
    [
        ("untracked", "untracked"),
        ("frozen", "frozen"),
        ("vanish", "absent"),
        ("jump", "settling"),
        ("late", "out_of_order"),
        ("second", "foreign"),
        ("swap", "unready"),
        ("garbage", "malformed"),
    ],
)
def test_what_is_no_measurement_is_counted_reported_and_not_used(kind: str, counter: str) -> None:
    options = MotiveOptions(noise_m=0.0002, faults=(HallFault(kind, 1.0, 1.5),))
    hall = Hall(options).run(4.0)
    counters = hall.client.counters
    assert getattr(counters, counter) > (0 if kind == "swap" else 15)
    assert hall.worst_m() < 5e-3
    assert len(hall.fixes) > 200
    assert hall.fixes[-1][0] > hall.now_s - 0.02
    if kind != "swap":
        assert [w for w in hall.words if "speaks" not in w], "it is told"
    assert len(set(hall.words)) == len(hall.words), "and once"


def test_a_body_keeps_its_name_when_ids_are_swapped() -> None:
    options = MotiveOptions(noise_m=0.0002, faults=(HallFault("swap", 1.0, 1.5),))
    hall = Hall(options).run(1.3)
    assert hall.client.models == {"aircraft": 2, "other 1": 1, "other 2": 3}
    assert hall.client.pose is not None
    assert hall.client.pose.id == 2
    assert hall.worst_m() < 5e-3


def test_a_jump_that_holds_is_a_new_place_after_a_while() -> None:
    options = MotiveOptions(noise_m=0.0002, faults=(HallFault("jump", 1.0, 99.0),))
    hall = Hall(options).run(4.0)
    jumped_s, found_s = 101.0, hall.fixes[-1][1].time_s
    assert hall.client.counters.jumps == 1
    between = [fix for _, fix in hall.fixes if jumped_s < fix.time_s < jumped_s + 0.99]
    assert not between
    assert found_s > 103.9


def test_a_silent_server_is_asked_again() -> None:
    options = MotiveOptions(noise_m=0.0, faults=(HallFault("silent", 1.0, 8.0),))
    hall = Hall(options).run(8.0)
    assert hall.asked.count(layout.CONNECT) in range(6, 9)
    assert any("no frame for 1 s" in words for words in hall.words)
    hall.run(2.0)
    assert hall.fixes[-1][0] > hall.now_s - 0.02


def test_the_second_outage_of_a_day_is_reported_as_the_first_was_and_so_is_that_it_is_over() -> (
    None
):
    faults = (HallFault("silent", 1.0, 4.0), HallFault("silent", 14.0, 18.0))
    hall = Hall(MotiveOptions(noise_m=0.0002, faults=faults)).run(20.0)
    reported = [words for words in hall.words if "speaks" not in words]
    silent, back = "OptiTrack: no frame for 1 s: asking again", "OptiTrack: stream is back after"
    assert [words == silent for words in reported] == [True, False, True, False]
    assert [words.startswith(back) for words in reported] == [False, True, False, True]
    assert reported[1].endswith(" 3.0 s")
    assert reported[3].endswith(" 4.0 s")


def test_a_body_that_flickers_is_reported_once_in_ten_seconds() -> None:
    """Blind for 0.2 s of each second: two words in ten seconds, whatever comes in between."""
    faults = tuple(HallFault("untracked", 1.0 + i, 1.2 + i) for i in range(30))
    hall = Hall(MotiveOptions(noise_m=0.0002, faults=faults)).run(31.0)
    blind = [words for words in hall.words if "is not tracked" in words]
    back = [words for words in hall.words if "stream is back after 0.2 s" in words]
    assert (len(blind), len(back)) == (3, 3)


def test_an_outage_that_lasts_is_reported_once() -> None:
    faults = (HallFault("untracked", 1.0, 60.0),)
    hall = Hall(MotiveOptions(noise_m=0.0002, faults=faults)).run(40.0)
    assert [words for words in hall.words if "speaks" not in words] == [
        "OptiTrack: 'aircraft' is not tracked: not used"
    ]


def test_nobody_there_is_reported() -> None:
    hall = Hall(MotiveOptions(faults=(HallFault("silent", 0.0, 99.0),))).run(5.0)
    assert hall.words == ["OptiTrack: no answer from 10.0.0.2: does Motive stream?"]


def test_a_name_that_is_not_there_is_reported_with_those_that_are() -> None:
    hall = Hall()
    hall.client = Optitrack(SETTINGS._replace(body="Aircraft"))
    hall.run(2.0)
    assert not hall.fixes
    assert any("no rigid body 'Aircraft'; there are aircraft, other 1" in w for w in hall.words)
    assert layout.models_request(masked=True)[:4] == struct.pack("<HH", 4, 4)


def test_the_first_that_answers_is_the_server_where_none_is_named() -> None:
    hall = Hall(
        MotiveOptions(faults=(HallFault("second", 0.5, 1.0),)), SETTINGS._replace(server="")
    )
    hall.run(2.0)
    assert hall.client.counters.foreign > 20
    assert len(hall.fixes) > 190


@pytest.mark.parametrize("version", [(2, 10), (5, 0), (0, 0)])
def test_a_version_that_cannot_be_read_is_reported(version: layout.Version) -> None:
    client = Optitrack(SETTINGS)
    data = encode_server_info(version, data_port=1511, group="239.0.0.1", multicast=False)
    assert client.take(data, SERVER, 0.0) is None
    assert (client.info, client.counters.wrong_version) == (None, 1)
    assert "3.0 to 4.2 can be read" in client.notices[0][1]


def test_a_stream_of_another_version_is_asked_who_it_is() -> None:
    """A server that was exchanged behind our back: nothing fits, so the handshake is repeated."""
    hall = Hall(MotiveOptions(version=(3, 1), noise_m=0.0)).run(1.0)
    hall.motive = Motive(MotiveOptions(version=(4, 2), noise_m=0.0), HALL, "aircraft")
    hall.motive.receive(layout.connect_request(), CLIENT, hall.clock_s(), 0.0)
    hall.motive.take_datagrams()
    hall.run(4.0)
    assert hall.client.counters.malformed >= 50
    assert hall.client.info is not None
    assert hall.client.info.version == (4, 2)
    assert hall.fixes[-1][0] > hall.now_s - 0.02
    assert hall.worst_m() < 2e-3


def test_markers_far_from_their_places_are_poor() -> None:
    hall = Hall(given=SETTINGS._replace(max_error_m=0.0003)).run(0.5)
    assert (len(hall.fixes), hall.client.counters.poor) == (0, 49)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=8), st.sampled_from((1, 5, 7, 13, 14, 100)))
def test_no_datagram_raises_and_nonsense_is_no_fix(payloads: list[bytes], number: int) -> None:
    hall = Hall().run(0.2)
    before = len(hall.fixes)
    for payload in payloads:
        for data in (payload, struct.pack("<HH", number, len(payload)) + payload):
            assert hall.client.take(data, SERVER, hall.now_s) is None
    hall.run(0.2)
    assert hall.worst_m() < 2e-3
    assert len(hall.fixes) >= before
    assert all(isfinite(fix.time_s) for _, fix in hall.fixes)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_hostile_suffix_or_section_gives_no_wrong_fix(drawn: st.DataObject) -> None:
    """Numbers of a frame are changed while it is on its way: whatever is used is right in time."""
    hall = Hall().run(0.3)

    def corrupted(data: bytes) -> bytes:
        if data[0] != layout.FRAME:
            return data
        at = drawn.draw(st.integers(8, 60) | st.integers(len(data) - 54, len(data) - 8))
        number = drawn.draw(st.sampled_from((-1, 0, 1, 2**31 - 1, -(2**31))))
        return data[:at] + struct.pack("<i", number) + data[at + 4 :]

    hall.run(0.05, corrupted)
    hall.run(0.5)
    for arrival_s, fix in hall.fixes:
        assert 0.0 <= arrival_s - fix.time_s <= 0.3
