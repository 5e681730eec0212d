"""The stand-in for Motive without sockets: times, numbers, noise and each fault, read by PyPI's
`natnet`."""

from __future__ import annotations

import struct
from itertools import combinations
from math import dist, pi
from statistics import fmean, pstdev

import pytest
from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame, RigidBody
from natnet.packet_buffer import PacketBuffer
from natnet.version import Version as NatNetVersion

from tgl_soar.geometry import HallFrame
from tgl_soar.sim.motive import HALL_FAULTS, HallFault, Motive, MotiveOptions, MotiveServer
from tgl_soar.sim.natnet_frames import Triple

# NatNet's numbers of messages, as its SDK has them.
CONNECT, SERVER_INFO, MODELS_REQUEST, MODELS, FRAME = 0, 1, 4, 5, 7
DISCONNECT, KEEP_ALIVE, ECHO_REQUEST, ECHO_RESPONSE, UNRECOGNIZED = 9, 10, 12, 13, 100
TICKS_HZ = 1e7
CLIENT, OTHER = ("10.0.0.9", 40000), ("10.0.0.8", 40001)
PLACE, STILL = (3.0, 1.0, -1.5), (1.0, 0.0, 0.0, 0.0)
LEVEL = HallFrame(z_up=False, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0)
IN_HALL = (3.0, 1.5, 1.0)  # y up: north, up, east
CLOCK_S = 400.0  # the server's, where the simulation begins
STEP_S = 0.01


def request(number: int, payload: bytes = b"") -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


def asking_for(*version: int, length: int = 270) -> bytes:
    """A connection request: 265 bytes of a name and the program's version, then NatNet's."""
    payload = bytes(265) + bytes(version) + bytes(length)
    return request(CONNECT, payload[:length])


def motive_with(*faults: HallFault, body: str | int = "aircraft", **keys: object) -> Motive:
    options = MotiveOptions(**{"noise_m": 0.0, "faults": faults, **keys})  # type: ignore[arg-type]
    return Motive(options, LEVEL, body)


def answers(motive: Motive, data: bytes, clock_s: float = CLOCK_S, now_s: float = 0.0) -> list[int]:
    """Numbers of the messages that answer."""
    motive.receive(data, CLIENT, clock_s, now_s)
    out = motive.take_datagrams()
    assert all(datagram.to == CLIENT for datagram in out)
    return [struct.unpack_from("<H", datagram.data)[0] for datagram in out]


def decoded(data: bytes, version: tuple[int, int] = (4, 1)) -> DataFrame:
    number, size = struct.unpack_from("<HH", data)
    assert (number, size) == (FRAME, len(data) - 4)
    return DataFrame.read_from_buffer(PacketBuffer(data[4:]), NatNetVersion(*version))


def streamed(motive: Motive, seconds: float, *, moves: bool = True) -> list[DataFrame]:
    """What a client is sent: an exposure every 10 ms of an aircraft that goes north at 1 m/s."""
    assert answers(motive, request(CONNECT)) == [SERVER_INFO]
    found = []
    for i in range(round(seconds / STEP_S) + 1):
        now = i * STEP_S
        place = (PLACE[0] + now * moves, PLACE[1], PLACE[2])
        motive.step(CLOCK_S + now, now, place, STILL)
        motive.send(CLOCK_S + now, now)
        if i % 100 == 99:
            motive.receive(request(KEEP_ALIVE), CLIENT, CLOCK_S + now, now)
        version = motive.options.version
        found += [decoded(datagram.data, version) for datagram in motive.take_datagrams()]
    return found


def aircraft_of(frame: DataFrame, number: int = 1) -> RigidBody:
    (body,) = [body for body in frame.rigid_bodies if body.id_num == number]
    return body


# --- what is asked -----------------------------------------------------------------------------


def test_a_client_is_answered_what_it_asks_and_nobody_else_is() -> None:
    motive = motive_with()
    assert answers(motive, request(MODELS_REQUEST)) == []  # it has not connected
    assert answers(motive, request(CONNECT)) == [SERVER_INFO]
    assert not motive.is_followed
    assert answers(motive, request(KEEP_ALIVE)) == []
    assert answers(motive, request(6, b"?")) == [UNRECOGNIZED]
    assert answers(motive, request(MODELS_REQUEST)) == [MODELS]
    assert motive.is_followed
    assert answers(motive, request(ECHO_REQUEST, bytes(8))) == [ECHO_RESPONSE]
    # Without a whole stamp there is nothing to echo.
    assert answers(motive, request(ECHO_REQUEST, bytes(7))) == [UNRECOGNIZED]
    assert answers(motive, request(DISCONNECT)) == []
    assert not motive.is_followed
    assert answers(motive, request(KEEP_ALIVE)) == []
    assert answers(motive, request(MODELS_REQUEST)) == []
    assert motive.counts["refused"] == 0
    assert answers(motive, b"\0\0\0") == []
    assert motive.counts["refused"] == 1


def test_an_echo_has_the_clients_stamp_and_the_servers_ticks() -> None:
    motive = motive_with()
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.receive(request(ECHO_REQUEST, b"\1\2\3\4\5\6\7\10"), CLIENT, CLOCK_S + 0.25, 0.25)
    echo = motive.take_datagrams()[-1].data
    assert echo[:4] == struct.pack("<HH", ECHO_RESPONSE, 16)
    assert echo[4:12] == b"\1\2\3\4\5\6\7\10"
    assert struct.unpack("<Q", echo[12:]) == (round((CLOCK_S + 0.25) * TICKS_HZ),)


@pytest.mark.parametrize(
    ("asked", "own", "multicast", "spoken"),
    [
        (asking_for(3, 1), (4, 1), False, (3, 1)),
        (asking_for(3, 0), (4, 1), False, (3, 0)),
        (asking_for(4, 2), (4, 1), False, (4, 1)),  # newer than the server
        (asking_for(2, 9), (4, 1), False, (4, 1)),  # older than any that it supports
        (asking_for(0, 0), (4, 1), False, (4, 1)),
        (asking_for(3, 1), (4, 1), True, (4, 1)),  # the group's is for all of them
        (asking_for(3, 1, length=269), (4, 1), False, (3, 1)),
        (asking_for(3, 1, length=268), (4, 1), False, (4, 1)),
        (request(CONNECT), (3, 1), False, (3, 1)),
    ],
)
def test_a_client_may_ask_for_an_older_version(
    asked: bytes, own: tuple[int, int], multicast: bool, spoken: tuple[int, int]
) -> None:
    motive = motive_with(version=own, multicast=multicast)
    motive.receive(asked, CLIENT, CLOCK_S, 0.0)
    (info,) = motive.take_datagrams()
    name_and_program = 4 + 256 + 4
    assert tuple(info.data[name_and_program : name_and_program + 2]) == spoken
    if not multicast:  # and is answered so
        motive.step(CLOCK_S, 0.0, PLACE, STILL)
        motive.send(CLOCK_S, 1.0)
        (frame,) = motive.take_datagrams()
        assert aircraft_of(decoded(frame.data, spoken)).pos == pytest.approx(IN_HALL)


def test_who_the_server_is_and_where_it_streams_is_reported() -> None:
    motive = motive_with(multicast=True, group="239.1.2.3", data_port=1600)
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    (info,) = motive.take_datagrams()
    fields = struct.unpack("<256s4B4BQHB4B", info.data[4:])
    assert fields[0].rstrip(b"\0") == b"Motive"
    assert fields[9:11] == (round(TICKS_HZ), 1600)
    assert fields[11:] == (1, 239, 1, 2, 3)
    # What a new installation of Motive has.
    usual = MotiveOptions()
    assert (usual.group, usual.data_port, usual.multicast) == ("239.255.42.99", 1511, False)


def test_models_name_the_bodies_with_their_markers() -> None:
    motive = motive_with(body="glider", bodies=2, markers=5)
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.receive(request(MODELS_REQUEST), CLIENT, CLOCK_S, 0.0)
    models = DataDescriptions.read_from_buffer(
        PacketBuffer(motive.take_datagrams()[-1].data[4:]), NatNetVersion(4, 1)
    )
    assert [(b.name, b.id_num) for b in models.rigid_bodies] == [("glider", 1), ("other 1", 2)]
    for body in models.rigid_bodies:
        places = [marker.pos for marker in body.markers]
        assert len(places) == 5
        # Cameras tell markers apart that stand a centimetre from one another; a glider has 2 m.
        assert min(dist(a, b) for a, b in combinations(places, 2)) > 0.01
        assert max(dist(a, b) for a, b in combinations(places, 2)) < 0.2
        assert {round(place[0], 6) for place in places} == {-0.05, 0.0, 0.05}


@pytest.mark.parametrize("bodies", [0, 1, 3])
def test_other_bodies_stand_about_in_the_hall_under_the_next_numbers(bodies: int) -> None:
    motive = motive_with(body=7, bodies=bodies)
    frames = streamed(motive, 0.03)
    ids = [body.id_num for body in frames[-1].rigid_bodies]
    assert ids == [7, *range(8, 7 + bodies)]  # the aircraft is there always
    for body in frames[-1].rigid_bodies[1:]:
        x, y, z = body.pos
        assert abs(x) <= 3.0
        assert 0.0 <= y <= 2.0
        assert abs(z) <= 3.0
        assert body.pos == aircraft_of(frames[0], body.id_num).pos
        assert body.rot == (0.0, 0.0, 0.0, 1.0)


def test_where_the_others_stand_fills_the_hall() -> None:
    motive = motive_with(bodies=400, markers=0)
    places = [body.pos for body in streamed(motive, 0.01)[0].rigid_bodies[1:]]
    for axis, (low, high) in enumerate(((-3.0, 3.0), (0.0, 2.0), (-3.0, 3.0))):
        values = [place[axis] for place in places]
        # 399 draws: the ends are met within 2 % of the range, the middle within 10 %.
        assert min(values) == pytest.approx(low, abs=0.02 * (high - low))
        assert max(values) == pytest.approx(high, abs=0.02 * (high - low))
        assert fmean(values) == pytest.approx(0.5 * (low + high), abs=0.05 * (high - low))


# --- times -------------------------------------------------------------------------------------


def test_a_frame_is_sent_after_the_latency_with_ticks_of_exposure_and_sending() -> None:
    motive = motive_with(latency_s=0.01)
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.take_datagrams()
    motive.step(CLOCK_S + 2.0, 2.0, PLACE, STILL)
    motive.send(CLOCK_S + 2.0099, 2.0099)
    assert motive.take_datagrams() == []
    motive.send(CLOCK_S + 2.012, 2.01)
    (datagram,) = motive.take_datagrams()
    frame = decoded(datagram.data)
    exposed, sent = round((CLOCK_S + 2.0) * TICKS_HZ), round((CLOCK_S + 2.012) * TICKS_HZ)
    assert frame.prefix.frame_number == 1
    assert frame.suffix.timestamp == CLOCK_S + 2.0
    assert frame.suffix.stamp_camera_mid_exposure == exposed
    assert frame.suffix.stamp_transmit == sent
    assert frame.suffix.stamp_data_received == (exposed + sent) // 2
    assert motive.counts == {"frames": 1, "lost": 0, "refused": 0}


def test_a_usual_server_is_ten_milliseconds_late_and_not_jittery() -> None:
    assert (MotiveOptions().latency_s, MotiveOptions().jitter_s) == (0.01, 0.0)


def test_jitter_makes_each_later_by_another_time_up_to_its_bound() -> None:
    motive = motive_with(latency_s=0.01, jitter_s=0.05)
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    late = []
    for i in range(2000):
        now = i * 0.001
        if i % 10 == 0:
            motive.step(CLOCK_S + now, now, PLACE, STILL)
        motive.send(CLOCK_S + now, now)
        frames = [decoded(datagram.data) for datagram in motive.take_datagrams() if i]
        late += [now - (frame.suffix.timestamp - CLOCK_S) for frame in frames]
    assert min(late) == pytest.approx(0.01, abs=0.003)
    assert max(late) == pytest.approx(0.06, abs=0.003)
    assert fmean(late) == pytest.approx(0.0355, abs=0.004)  # half a step after the middle


def test_a_client_that_says_nothing_for_five_seconds_is_forgotten() -> None:
    motive = motive_with()
    for address in (CLIENT, OTHER):
        motive.receive(request(CONNECT), address, CLOCK_S, 0.0)
    motive.receive(request(KEEP_ALIVE), OTHER, CLOCK_S + 3.0, 3.0)
    motive.take_datagrams()
    for since_s, streamed_to in ((4.9, {CLIENT, OTHER}), (5.1, {OTHER}), (8.1, set())):
        motive.step(CLOCK_S + since_s, since_s, PLACE, STILL)
        motive.send(CLOCK_S + since_s, since_s + 0.02)
        assert {datagram.to for datagram in motive.take_datagrams()} == streamed_to


# --- noise -------------------------------------------------------------------------------------


def test_without_noise_the_aircraft_is_where_and_as_it_is() -> None:
    for frame in streamed(motive_with(), 0.05, moves=False):
        assert aircraft_of(frame).pos == pytest.approx(IN_HALL)
        assert aircraft_of(frame).rot == pytest.approx((0.0, 0.0, 0.0, 1.0))
        assert aircraft_of(frame).tracking_valid
        assert 0.0 < aircraft_of(frame).marker_error < 0.001  # of a good calibration


def test_a_turned_hall_turns_the_attitude_with_the_place() -> None:
    """Facing east in a hall whose x points east: no turn is left."""
    hall = LEVEL._replace(yaw_rad=pi / 2)
    motive = Motive(MotiveOptions(noise_m=0.0, bodies=1), hall, "aircraft")
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.take_datagrams()
    rolled = (0.9**0.5, 0.1**0.5, 0.0, 0.0)  # about north, which is the hall's −z
    motive.step(CLOCK_S, 0.0, (3.0, 1.0, -1.5), rolled)
    motive.send(CLOCK_S, 0.02)
    body = aircraft_of(decoded(motive.take_datagrams()[0].data))
    assert body.pos == pytest.approx((1.0, 1.5, -3.0))
    assert body.rot == pytest.approx((0.0, 0.0, -(0.1**0.5), 0.9**0.5), abs=1e-6)


def test_places_have_the_noise_asked_for_on_each_axis_and_attitudes_that_over_the_arm() -> None:
    noise_m, arm_m = 0.002, 0.2
    frames = streamed(motive_with(noise_m=noise_m), 8.0, moves=False)
    for number in (1, 2):
        for axis in range(3):
            values = [aircraft_of(frame, number).pos[axis] for frame in frames]
            # 800 draws: three standard deviations of a deviation are 7.5 %.
            assert pstdev(values) == pytest.approx(noise_m, rel=0.075)
    for axis in range(3):
        halves = [aircraft_of(frame).rot[axis] for frame in frames]
        assert 2.0 * pstdev(halves) == pytest.approx(noise_m / arm_m, rel=0.075)
    assert fmean(aircraft_of(frame).pos[0] for frame in frames) == pytest.approx(3.0, abs=3e-4)


def test_turns_are_turns_however_large() -> None:
    """A tenth of a radian about each axis; a rotation's quaternion has the length 1."""
    for frame in streamed(motive_with(noise_m=0.02), 0.5):
        assert sum(q * q for q in aircraft_of(frame).rot) == pytest.approx(1.0, abs=1e-5)


def test_a_body_lies_in_the_aircraft_a_third_of_a_degree_off_and_stays_so() -> None:
    made_rad = 0.005
    turns: list[Triple] = []
    for seed in range(150):
        motive = motive_with(noise_m=1e-7, seed=seed, bodies=1, markers=0)
        body = aircraft_of(streamed(motive, 0.01)[0])
        turns.append((2.0 * body.rot[0], 2.0 * body.rot[1], 2.0 * body.rot[2]))
    for axis in range(3):
        # 150 draws: three standard deviations of a deviation are 17 %.
        assert pstdev(turn[axis] for turn in turns) == pytest.approx(made_rad, rel=0.17)


def test_frames_are_lost_and_poses_untracked_in_the_fraction_asked_for() -> None:
    motive = motive_with(loss=0.3, untracked=0.2)
    frames = streamed(motive, 10.0)
    assert motive.counts["frames"] == len(frames)
    assert motive.counts["frames"] + motive.counts["lost"] == 1000
    assert motive.counts["lost"] == pytest.approx(300, abs=44)  # three standard deviations
    blind = [frame for frame in frames if not aircraft_of(frame).tracking_valid]
    assert len(blind) / len(frames) == pytest.approx(0.2, abs=0.046)
    assert all(aircraft_of(frame, 2).tracking_valid for frame in frames)
    usual = MotiveOptions()
    assert (usual.loss, usual.untracked) == (0.0, 0.0)


# --- what goes wrong ---------------------------------------------------------------------------


def exposed_s(frame: DataFrame) -> float:
    return float(frame.suffix.timestamp) - CLOCK_S


def among(frame: DataFrame, from_s: float, until_s: float) -> bool:
    return from_s - 1e-6 <= exposed_s(frame) < until_s - 1e-6


def test_the_faults_of_a_hall_are_those_below() -> None:
    kinds = "silent untracked frozen vanish jump swap late restart garbage second"
    assert sorted(HALL_FAULTS) == sorted(kinds.split())


def test_a_silent_server_answers_nothing_and_streams_nothing() -> None:
    motive = motive_with(HallFault("silent", 0.5, 1.0))
    frames = streamed(motive, 1.5)
    # Sent 10 ms after its exposure.
    assert [frame for frame in frames if among(frame, 0.49, 0.99)] == []
    assert len(frames) == 100
    assert motive.counts["lost"] == 50
    refused = motive.counts["refused"]
    assert answers(motive, request(CONNECT), now_s=0.7) == []
    assert motive.counts["refused"] == refused + 1
    assert answers(motive, request(CONNECT), now_s=1.0) == [SERVER_INFO]


def test_an_untracked_body_is_marked_and_comes_again() -> None:
    for frame in streamed(motive_with(HallFault("untracked", 0.2, 0.3)), 0.5):
        assert aircraft_of(frame).tracking_valid != among(frame, 0.2, 0.3)


def test_a_frozen_body_repeats_its_place_and_one_frozen_later_another() -> None:
    faults = HallFault("frozen", 0.2, 0.3), HallFault("frozen", 0.4, 0.5)
    for frame in streamed(motive_with(*faults), 0.6):
        expected = IN_HALL[0] + exposed_s(frame)
        for from_s, until_s in ((0.2, 0.3), (0.4, 0.5)):
            if among(frame, from_s, until_s):
                expected = IN_HALL[0] + from_s
        assert aircraft_of(frame).pos[0] == pytest.approx(expected, abs=1e-5)


def test_a_body_that_vanishes_is_not_in_the_frame() -> None:
    for frame in streamed(motive_with(HallFault("vanish", 0.2, 0.3)), 0.5):
        ids = [body.id_num for body in frame.rigid_bodies]
        assert ids == ([2, 3] if among(frame, 0.2, 0.3) else [1, 2, 3])


def test_a_jump_is_one_and_a_half_metres_along_the_hall() -> None:
    for frame in streamed(motive_with(HallFault("jump", 0.2, 0.3)), 0.5):
        jump = 1.5 if among(frame, 0.2, 0.3) else 0.0
        x, y, z = aircraft_of(frame).pos
        assert x == pytest.approx(IN_HALL[0] + exposed_s(frame) + jump, abs=1e-5)
        assert (y, z) == pytest.approx(IN_HALL[1:])


def test_swapped_numbers_are_reported_when_they_change_and_change_back() -> None:
    # From 4.0 on `natnet` takes a time stamp of two numbers for the flags behind it.
    frames = streamed(motive_with(HallFault("swap", 0.2, 0.3), version=(3, 1)), 0.5)
    announced = [frame for frame in frames if frame.suffix.tracked_models_changed]
    assert [exposed_s(frame) for frame in announced] == pytest.approx([0.2, 0.3])
    other = aircraft_of(frames[0], 2).pos
    for frame in frames:
        swapped = among(frame, 0.2, 0.3)
        assert aircraft_of(frame, 1 if swapped else 2).pos == other
        assert [body.id_num for body in frame.rigid_bodies] == [1, 2, 3]


def test_alone_a_body_has_nobody_to_swap_with() -> None:
    frames = streamed(motive_with(HallFault("swap", 0.0, 1.0), bodies=1), 0.1)
    assert {body.id_num for frame in frames for body in frame.rigid_bodies} == {1}


def test_late_frames_come_six_tenths_of_a_second_later() -> None:
    motive = motive_with(HallFault("late", 0.2, 0.3))
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.take_datagrams()
    for i in range(150):
        now = i * STEP_S
        motive.step(CLOCK_S + now, now, PLACE, STILL)
        motive.send(CLOCK_S + now, now)
        for datagram in motive.take_datagrams():
            frame = decoded(datagram.data)
            late_s = 0.61 if among(frame, 0.2, 0.3) else 0.01
            assert now - exposed_s(frame) == pytest.approx(late_s, abs=1e-6)


@pytest.mark.parametrize(("restarted_clock", "apart_s"), [(True, 1000.0), (False, 0.0)])
def test_a_restarted_server_forgets_its_clients_and_counts_again(
    restarted_clock: bool, apart_s: float
) -> None:
    assert MotiveOptions().restarted_clock
    faults = HallFault("restart", 0.2, 0.3), HallFault("restart", 0.5, 0.6)
    motive = motive_with(*faults, restarted_clock=restarted_clock)
    before = streamed(motive, 0.4)
    assert [frame.prefix.frame_number for frame in before] == list(range(1, 20))
    for restarts, now in ((1, 0.42), (2, 0.7)):
        if restarts == 2:
            motive.send(CLOCK_S + 0.55, 0.55)
        assert answers(motive, request(CONNECT), CLOCK_S + now, now) == [SERVER_INFO]
        motive.step(CLOCK_S + now, now, PLACE, STILL)
        motive.send(CLOCK_S + now, now + 0.02)
        frame = decoded(motive.take_datagrams()[-1].data)
        ticks = round((CLOCK_S + now + restarts * apart_s) * TICKS_HZ)
        assert frame.suffix.stamp_camera_mid_exposure == ticks
        # 0.21 … 0.40 s are twenty exposures; the second time none was in between.
        assert frame.prefix.frame_number == (21 if restarts == 1 else 1)
    assert answers(motive, request(CONNECT), now_s=0.55) == []  # the server is away meanwhile


def test_garbage_is_cut_has_more_behind_it_or_is_another_inside() -> None:
    motive = motive_with(HallFault("garbage", 0.0, 9.0), bodies=1)
    motive.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    motive.take_datagrams()
    whole = motive_with(bodies=1)
    whole.receive(request(CONNECT), CLIENT, CLOCK_S, 0.0)
    whole.take_datagrams()
    kinds = dict.fromkeys(("cut", "more", "other"), 0)
    for i in range(300):
        now = i * STEP_S
        for server in (motive, whole):
            server.step(CLOCK_S, now, PLACE, STILL)
            server.send(CLOCK_S, now + 0.01)
        (bad,), (good,) = motive.take_datagrams(), whole.take_datagrams()
        if len(bad.data) < len(good.data):
            kinds["cut"] += good.data.startswith(bad.data)
        elif len(bad.data) > len(good.data):
            kinds["more"] += bad.data[:-40] == good.data
        else:
            kinds["other"] += bad.data[:8] == good.data[:8] and bad.data != good.data
    assert sum(kinds.values()) == 300
    assert min(kinds.values()) > 75  # a third each, less three standard deviations


@pytest.mark.parametrize("multicast", [False, True])
def test_a_second_server_streams_to_the_same_clients_from_a_place_apart(multicast: bool) -> None:
    motive = motive_with(HallFault("second", 0.0, 0.015), multicast=multicast)
    for address in (CLIENT, OTHER):
        motive.receive(request(CONNECT), address, CLOCK_S, 0.0)
    motive.take_datagrams()
    motive.step(CLOCK_S, 0.0, PLACE, STILL)
    motive.send(CLOCK_S, 0.01)
    out = motive.take_datagrams()
    receivers = [None] if multicast else [CLIENT, OTHER]
    assert [(datagram.to, datagram.second) for datagram in out] == [
        *((to, True) for to in receivers), *((to, False) for to in receivers)
    ]  # fmt: skip
    first, *_, last = (decoded(datagram.data) for datagram in out)
    for body in last.rigid_bodies:
        moved = aircraft_of(first, body.id_num).pos
        expected = (body.pos[0] + 1.5, body.pos[1], body.pos[2])
        assert moved == pytest.approx(expected, abs=1e-5)
    motive.step(CLOCK_S, 0.02, PLACE, STILL)
    motive.send(CLOCK_S, 0.03)
    assert not any(datagram.second for datagram in motive.take_datagrams())


# --- on the network ----------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [0, -100, 130, 400])
def test_a_rate_that_does_not_divide_the_steps_is_refused(rate_hz: int) -> None:
    with pytest.raises(ValueError, match=f"--mocap-rate {rate_hz}: must divide the 200 steps"):
        MotiveServer(motive_with(rate_hz=rate_hz), ("127.0.0.1", 0), lambda: 0.0, step_hz=200)


@pytest.mark.parametrize(("rate_hz", "every"), [(1, 200), (100, 2), (200, 1)])
def test_the_cameras_expose_at_their_rate(rate_hz: int, every: int) -> None:
    motive = motive_with(rate_hz=rate_hz, latency_s=0.0, multicast=True, group="127.0.0.1")
    server = MotiveServer(motive, ("127.0.0.1", 0), lambda: 5.0, step_hz=200)
    try:
        for step in range(2 * every):
            server.step(step, step * 0.005, PLACE, STILL)
            assert motive.counts["frames"] + motive.counts["lost"] == 1 + step // every
    finally:
        server.close()
