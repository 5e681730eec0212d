"""What the OptiTrack client counts, says and asks, by datagram, on both sides of each limit.

In lockstep the server's clock is the loop's, so that every age is as written here.
"""

from __future__ import annotations

from math import isnan

import pytest

from tgl_soar.geometry import HallFrame
from tgl_soar.link.messages import SEVERITY_WARNING
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.optitrack import Optitrack
from tgl_soar.sim.natnet_frames import (
    CLOCK_HZ,
    Scene,
    SimulatedBody,
    Version,
    encode_frame,
    encode_models,
    encode_server_info,
)
from tgl_soar.sim.natnet_frames import message as encoded
from tgl_soar.types import PositionFix

SERVER = ("10.0.0.2", 1510)
SETTINGS = OptitrackSettings(
    server=SERVER[0],
    body="glider",
    unicast=True,
    hall=HallFrame(
        z_up=True, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0
    ),
    noise_m=0.001,
    max_error_m=0.02,
    max_speed_mps=25.0,
    max_age_s=0.3,
    max_rate_hz=1000.0,
)
INFO = encode_server_info((4, 1), data_port=1511, group="239.0.0.1", multicast=False)
OTHER_INFO = encode_server_info((4, 2), data_port=1511, group="239.0.0.1", multicast=False)
GARBAGE = encoded(layout.FRAME, b"\xff" * 40)
BROKEN_MODELS = encoded(layout.MODELS, b"\xff" * 8)
GLIDER = SimulatedBody(
    name="glider", id=7, position_m=(1.0, 2.0, 3.0), quaternion=(0.0, 0.0, 0.0, 1.0)
)
PLAIN = "OptiTrack: "


class Talk:
    """A client in lockstep, and a server that sends what a test sets."""

    def __init__(
        self, given: OptitrackSettings = SETTINGS, begin_s: float = 10.0, *, greeted: bool = True
    ) -> None:
        self.client = Optitrack(given, lockstep=True)
        self.now_s = begin_s
        self._number = self._count = 0
        if greeted:
            self.gives(INFO)
            self.gives(encode_models((4, 1), [GLIDER]))
            self.words()

    def gives(self, data: bytes, sender: tuple[str, int] = SERVER) -> PositionFix | None:
        return self.client.take(data, sender, self.now_s)

    def frame(
        self,
        *,
        age_s: float = 0.0,
        body: SimulatedBody | None = GLIDER,
        number: int = 0,
        changed: bool = False,
        version: Version = (4, 1),
    ) -> bytes:
        """The next one; its pose differs from the last as noise makes it."""
        self._number = number or self._number + 1
        self._count += 1
        ticks = round((self.now_s - age_s) * CLOCK_HZ)
        bodies = []
        if body is not None:
            x, y, z = body.position_m
            bodies = [body._replace(position_m=(x + 1e-4 * (self._count % 7), y, z))]
        scene = Scene(
            number=self._number,
            bodies=bodies,
            time_s=0.0,
            exposed_ticks=ticks,
            received_ticks=ticks,
            sent_ticks=ticks,
            models_changed=changed,
        )
        return encode_frame(version, scene)

    def sees(self, step_s: float = 0.01, **frame: float) -> PositionFix | None:
        """A frame, some time after the last."""
        self.now_s += step_s
        return self.gives(self.frame(**frame))  # type: ignore[arg-type]

    def words(self) -> list[str]:
        """What it has reported since the last time."""
        texts = [text.removeprefix(PLAIN) for _, text in self.client.notices]
        self.client.notices.clear()
        return texts

    def requests(self, after_s: float = 0.0) -> list[int]:
        """The messages that it sends."""
        self.now_s += after_s
        return [layout.message_of(data) for data in self.client.poll(self.now_s)]


def test_a_pose_becomes_a_fix_that_is_as_old_as_its_exposure() -> None:
    talk = Talk()
    client = talk.client
    assert isnan(client.age_s)
    assert isnan(client.latency_s)
    assert client.pose is None
    assert client.attitude is None
    fix = talk.sees(age_s=0.02)
    assert fix is not None
    assert fix.time_s == pytest.approx(9.99)
    # z up: x of the hall is north, y west, z up.
    assert (fix.north_m, fix.east_m, fix.down_m) == pytest.approx((1.0001, -2.0, -3.0))
    assert client.age_s == pytest.approx(0.02)
    assert client.latency_s == pytest.approx(0.02)
    assert client.pose is not None
    assert client.pose.id == 7
    assert client.attitude == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert (client.counters.frames, client.counters.fixes) == (1, 1)
    assert client.version == (4, 1)
    assert client.models == {"glider": 7}
    assert client.summary() == "1 frames, 1 fixes; the last was 20.0 ms old, give or take 0.00 ms"


def test_a_summary_says_how_old_only_after_a_fix_and_how_wrong_only_where_it_is_known() -> None:
    talk = Talk(greeted=False)
    assert talk.client.summary() == "nothing came"
    talk.gives(b"\0")
    assert talk.client.summary() == "1 truncated"
    # Without lockstep and without echoes only the network's own delay is unknown.
    client = Optitrack(SETTINGS._replace(body=7))
    client.take(INFO, SERVER, 10.0)
    assert client.take(talk.frame(), SERVER, 10.0) is not None
    assert client.summary() == "1 frames, 1 fixes; the last was 0.0 ms old"


# --- whose datagrams ----------------------------------------------------------------------------


def test_only_the_server_of_the_site_is_listened_to_and_another_is_reported_once() -> None:
    talk = Talk(greeted=False)
    for _ in range(3):
        assert talk.gives(INFO, ("10.0.0.3", 1510)) is None
    assert talk.client.counters.foreign == 3
    assert talk.client.info is None
    assert talk.client.notices == [
        (SEVERITY_WARNING, f"{PLAIN}10.0.0.3 streams too: it is not listened to")
    ]
    talk.gives(INFO)
    assert talk.client.info is not None


def test_where_no_server_is_named_the_first_that_answers_is_it() -> None:
    talk = Talk(SETTINGS._replace(server=""), greeted=False)
    talk.gives(INFO, ("10.0.0.3", 1510))
    assert talk.client.info is not None
    talk.gives(INFO)
    assert talk.client.counters.foreign == 1


@pytest.mark.parametrize(("silent_s", "used"), [(0.99, False), (1.01, True)])
def test_a_second_stream_of_the_server_is_used_only_once_the_first_was_silent_for_a_second(
    silent_s: float, used: bool
) -> None:
    talk = Talk()
    assert talk.sees() is not None
    talk.now_s += silent_s
    fix = talk.gives(talk.frame(), (SERVER[0], 1599))
    assert (fix is not None) == used
    assert talk.client.counters.foreign == (0 if used else 1)
    assert talk.client.counters.frames == 2
    expected = "two streams, from ports 1510 and 1599: one is used"
    assert (expected in talk.words()) != used
    # From here on the one that is used is not the other one's.
    talk.now_s += 0.01
    assert (talk.gives(talk.frame()) is None) == used


def test_the_other_stream_does_not_keep_a_silent_one_alive() -> None:
    talk = Talk()
    talk.sees()
    talk.now_s += 0.6
    assert talk.gives(talk.frame(), (SERVER[0], 1599)) is None
    talk.now_s += 0.6
    assert talk.gives(talk.frame(), (SERVER[0], 1599)) is not None


def test_a_frame_that_is_longer_than_it_says_is_not_read() -> None:
    talk = Talk()
    talk.now_s += 0.01
    assert talk.gives(talk.frame() + b"\0") is None
    assert talk.client.counters.oversized == 1
    assert talk.words() == ["a frame is longer than it says"]
    assert talk.sees() is not None
    assert talk.client.counters.oversized == 1


def test_a_datagram_that_is_shorter_than_it_says_is_truncated() -> None:
    talk = Talk()
    for data in (b"\x07\0\0", talk.frame()[:-1]):
        assert talk.gives(data) is None
    assert talk.client.counters.truncated == 2
    assert talk.client.counters.frames == 0
    assert talk.words() == ["a message is 3 bytes are no message"]


def test_before_the_handshake_answers_are_not_known_and_frames_are_not_ready() -> None:
    talk = Talk(greeted=False)
    talk.gives(encode_models((4, 1), [GLIDER]))
    talk.gives(encoded(layout.ECHO_RESPONSE, bytes(16)))
    talk.gives(encoded(layout.UNRECOGNIZED, b""))
    assert talk.client.counters.unknown == 3
    assert talk.client.models == {}
    assert talk.sees() is None
    assert talk.client.counters.unready == 1
    talk.gives(INFO)
    assert talk.sees() is None  # it is not known which id the body has
    assert talk.client.counters.unready == 2
    assert not talk.client.is_ready
    talk.gives(encode_models((4, 1), [GLIDER]))
    assert talk.client.is_ready
    assert talk.sees() is not None
    talk.gives(encoded(layout.ECHO_RESPONSE, bytes(16)))  # known, and odd in lockstep
    assert (talk.client.counters.unknown, talk.client.counters.odd) == (3, 1)


# --- what cannot be read ------------------------------------------------------------------------


@pytest.mark.parametrize("data", [GARBAGE, BROKEN_MODELS])
def test_after_fifty_messages_that_cannot_be_read_it_is_asked_who_it_is(data: bytes) -> None:
    talk = Talk()
    for _ in range(49):
        assert talk.gives(data) is None
    assert talk.client.info is not None
    assert talk.client.counters.malformed == 49
    assert len(talk.words()) == 1
    talk.gives(data)
    assert talk.client.info is None
    talk.requests()
    talk.gives(INFO)
    for _ in range(49):  # and it is counted from the beginning
        talk.gives(data)
    assert talk.client.info is not None


def test_they_are_fifty_from_the_first_one_on_too() -> None:
    client = Optitrack(SETTINGS._replace(body=7), lockstep=True)
    client.take(INFO, SERVER, 10.0)
    for _ in range(49):
        client.take(GARBAGE, SERVER, 10.0)
    assert client.info is not None


@pytest.mark.parametrize("good", ["frame", "models"])
def test_fifty_in_a_row_are_not_those_between_which_something_could_be_read(good: str) -> None:
    talk = Talk()
    for _ in range(49):
        talk.gives(GARBAGE)
    if good == "frame":
        assert talk.sees() is not None
    else:
        talk.gives(encode_models((4, 1), [GLIDER]))
    for _ in range(49):
        talk.gives(GARBAGE)
    assert talk.client.info is not None
    talk.gives(GARBAGE)
    assert talk.client.info is None
    assert talk.client.counters.malformed == 99


# --- how old, and whose -------------------------------------------------------------------------


@pytest.mark.parametrize(("age_s", "used"), [(0.299, True), (0.301, False)])
def test_a_pose_may_be_as_old_as_the_site_says(age_s: float, used: bool) -> None:
    talk = Talk()
    assert (talk.sees(age_s=age_s) is not None) == used
    assert talk.client.age_s == pytest.approx(age_s)
    assert talk.client.counters.stale == (0 if used else 1)
    assert talk.words() == ([] if used else ["a pose is 301 ms old: not used"])


def test_a_body_that_is_not_in_the_frame_is_absent_and_may_have_another_id() -> None:
    talk = Talk()
    talk.requests()
    talk.now_s += 1.0
    talk.gives(talk.frame())
    assert layout.MODELS_REQUEST not in talk.requests()
    assert talk.gives(talk.frame(age_s=-0.001, body=None)) is None
    assert talk.client.counters.absent == 1
    assert talk.words() == ["'glider' is not in the frames"]
    assert layout.MODELS_REQUEST in talk.requests()
    # Meanwhile the old id is used.
    assert talk.sees() is not None


def test_a_jump_may_be_another_bodys_id() -> None:
    talk = Talk()
    for _ in range(3):
        assert talk.sees() is not None
    assert layout.MODELS_REQUEST not in talk.requests(0.005)
    far = GLIDER._replace(position_m=(2.0, 2.0, 3.0))
    talk.now_s += 0.01
    assert talk.gives(talk.frame(body=far)) is None
    assert talk.client.counters.jumps == 1
    assert layout.MODELS_REQUEST in talk.requests()


def test_definitions_that_have_changed_are_asked_for_once_and_nothing_is_used_until_then() -> None:
    talk = Talk()
    talk.sees()
    talk.now_s += 0.01
    assert talk.gives(talk.frame(changed=True)) is None
    assert talk.client.counters.unready == 1
    assert talk.client.models == {}
    assert layout.MODELS_REQUEST in talk.requests()
    talk.gives(encode_models((4, 1), [GLIDER]))
    talk.now_s += 0.01
    assert talk.gives(talk.frame(changed=True)) is not None  # the flag stands for a while
    assert talk.sees() is not None
    talk.now_s += 0.01
    assert talk.gives(talk.frame(changed=True)) is None  # and comes again


def test_the_first_frame_may_say_it_too() -> None:
    talk = Talk()
    assert talk.gives(talk.frame(changed=True)) is None
    assert layout.MODELS_REQUEST in talk.requests()


@pytest.mark.parametrize(("number", "used"), [(501, True), (500, False), (3, False)])
def test_frames_that_are_numbered_again_are_of_other_definitions(number: int, used: bool) -> None:
    talk = Talk()
    talk.sees(number=500)
    assert (talk.sees(number=number) is not None) == used
    assert (talk.client.models == {}) != used
    assert talk.client.counters.unready == (0 if used else 1)
    # Where the site gives the id nothing is asked for.
    numbered = Talk(SETTINGS._replace(body=7))
    numbered.sees(number=500)
    assert numbered.sees(number=number) is not None


def test_a_frame_without_a_time_is_counted_as_odd_alone() -> None:
    talk = Talk()
    assert talk.sees(age_s=1.5, number=9) is None  # in lockstep no clock is so far off
    assert (talk.client.counters.odd, talk.client.counters.unready) == (1, 0)
    assert isnan(talk.client.age_s)
    # Its number counts neither.
    assert talk.sees(number=2) is not None


# --- another server, another clock --------------------------------------------------------------


def test_another_version_is_another_server_and_nothing_of_the_first_is_kept() -> None:
    talk = Talk()
    talk.sees(number=100)
    talk.gives(INFO)
    assert talk.client.counters.restarts == 0  # the same again
    assert talk.words() == []
    talk.gives(OTHER_INFO)
    assert talk.client.counters.restarts == 1
    assert "it is another server now, or another version" in talk.words()
    assert talk.client.models == {}
    talk.gives(encode_models((4, 2), [GLIDER]))
    # From another port, with another number, in another place, and older: it is the first.
    talk.now_s += 0.01
    far = GLIDER._replace(position_m=(9.0, 9.0, 9.0))
    frame = talk.frame(body=far, number=3, version=(4, 2), age_s=0.05)
    assert talk.gives(frame, (SERVER[0], 1599)) is not None
    assert talk.client.counters.foreign == 0


def test_the_first_server_is_no_restart() -> None:
    talk = Talk(greeted=False)
    talk.gives(INFO)
    assert talk.client.counters.restarts == 0
    assert talk.words() == ["Motive at 10.0.0.2 speaks NatNet 4.1, clock 10000000 Hz"]


def test_a_body_with_another_id_begins_another_track() -> None:
    """Its first pose is no jump, and neither is it one where the same definitions come again."""
    for number, used in ((8, True), (7, False)):
        talk = Talk()
        talk.sees()
        other = SimulatedBody(
            name="glider", id=number, position_m=(5.0, 2.0, 3.0), quaternion=(0.0, 0.0, 0.0, 1.0)
        )
        talk.gives(encode_models((4, 1), [other]))
        talk.now_s += 0.01
        assert (talk.gives(talk.frame(body=other)) is not None) == used
        assert talk.client.counters.jumps == (0 if used else 1)


def clocked(now_s: float, ticks_s: float, number: int) -> bytes:
    ticks = round(ticks_s * CLOCK_HZ)
    body = GLIDER._replace(position_m=(1.0 + 1e-4 * number, 2.0, 3.0))
    scene = Scene(
        number=number, bodies=[body], time_s=now_s, exposed_ticks=ticks,
        received_ticks=ticks, sent_ticks=ticks,
    )  # fmt: skip
    return encode_frame((4, 1), scene)


def test_a_clock_that_has_become_another_one_is_another_start_of_the_server() -> None:
    """0.1 s of stamps that fit each other and nothing before: the server is sought again."""
    client = Optitrack(SETTINGS._replace(body=7))
    client.poll(9.9)
    client.take(INFO, SERVER, 9.9)
    used = [
        client.take(clocked(10.0 + 0.01 * i, 50.0 + 0.01 * i, i + 1), SERVER, 10.0 + 0.01 * i)
        for i in range(10)
    ]
    assert None not in used
    assert layout.CONNECT not in [layout.message_of(data) for data in client.poll(10.1)]
    for i in range(12):
        assert client.counters.restarts == 0
        assert client.info is not None
        now_s = 10.1 + 0.0095 * i
        assert client.take(clocked(now_s, 900.0 + 0.0095 * i, i + 50), SERVER, now_s) is None
    assert client.counters.restarts == 1
    assert client.info is None
    assert client.notices[-1][1] == f"{PLAIN}the server has restarted, with another clock"
    assert layout.CONNECT in [layout.message_of(data) for data in client.poll(10.205)]
    # It is reported once, and the clock counts on.
    client.take(INFO, SERVER, 10.22)
    assert client.take(clocked(10.23, 900.13, 70), SERVER, 10.23) is not None
    assert client.counters.restarts == 1


def test_echoes_find_a_clock_that_has_become_another_one_too() -> None:
    client = Optitrack(SETTINGS._replace(body=7))
    client.take(INFO, SERVER, 9.9)
    assert client.take(clocked(10.0, 50.0, 1), SERVER, 10.0) is not None
    for i in range(12):
        asked_s = 10.01 + 0.01 * i
        ours_ns, ticks = round(asked_s * 1e9), round((900.0 + 0.01 * i) * CLOCK_HZ)
        echo = encoded(
            layout.ECHO_RESPONSE, ours_ns.to_bytes(8, "little") + ticks.to_bytes(8, "little")
        )
        client.take(echo, SERVER, asked_s + 0.001)
    assert client.counters.restarts == 1
    assert client.info is None
    assert client.uncertainty_s == pytest.approx(0.0005, rel=1e-3)


# --- silence ------------------------------------------------------------------------------------


def streamed(given: OptitrackSettings = SETTINGS) -> Optitrack:
    """One that is not in lockstep and has had a frame at 10 s."""
    client = Optitrack(given)
    client.poll(9.9)
    client.take(INFO, SERVER, 9.9)
    client.take(clocked(10.0, 50.0, 1), SERVER, 10.0)
    client.notices.clear()
    return client


def connects(client: Optitrack, now_s: float) -> bool:
    return layout.CONNECT in [layout.message_of(data) for data in client.poll(now_s)]


def test_a_stream_that_is_silent_for_a_second_is_asked_for_again() -> None:
    client = streamed()
    assert not connects(client, 10.99)
    assert not client.notices
    assert connects(client, 11.01)
    assert client.notices == [(SEVERITY_WARNING, f"{PLAIN}no frame for 1 s: asking again")]
    assert not connects(client, 12.0)
    assert connects(client, 12.02)
    assert len(client.notices) == 1


@pytest.mark.parametrize(
    ("server", "greeted", "words"),
    [
        (SERVER[0], False, f"no answer from {SERVER[0]}: does Motive stream?"),
        ("", False, "no answer from anywhere: does Motive stream?"),
        ("", True, "it answers, but no frame comes: see mocap.stream, group and interface"),
    ],
)
def test_a_server_may_be_silent_for_three_seconds_at_first(
    server: str, greeted: bool, words: str
) -> None:
    client = Optitrack(SETTINGS._replace(server=server))
    client.poll(10.0)
    if greeted:
        client.take(INFO, SERVER, 10.0)
        client.poll(10.0)
        client.notices.clear()
    client.poll(12.99)
    assert not client.notices
    client.poll(13.01)
    assert client.notices == [(SEVERITY_WARNING, f"{PLAIN}{words}")]


def test_a_simulation_begins_when_all_have_come() -> None:
    client = Optitrack(SETTINGS, lockstep=True)
    for now_s in (10.0, 12.0, 20.0):
        client.poll(now_s)
    assert not client.notices


def test_an_answer_is_given_time_for_its_stream_to_begin() -> None:
    client = streamed()
    client.poll(11.5)
    client.notices.clear()
    client.take(OTHER_INFO, SERVER, 11.5)
    assert not connects(client, 11.6)  # counted from here
    assert not connects(client, 12.59)
    assert connects(client, 12.61)


def test_another_clock_of_ours_forgets_what_was_timed_by_the_old_one() -> None:
    client = streamed(SETTINGS._replace(body=7))
    assert client.clock.is_known
    client.poll(10.5)
    client.rebase()
    client.poll(3.0)  # it has gone back, and no silence is counted
    assert not client.notices
    assert not client.clock.is_known
    # Nor is a place that is far from the old one a jump.
    far = GLIDER._replace(position_m=(9.0, 9.0, 9.0))
    ticks = round(50.6 * CLOCK_HZ)
    scene = Scene(
        number=2, bodies=[far], time_s=0.0, exposed_ticks=ticks,
        received_ticks=ticks, sent_ticks=ticks,
    )  # fmt: skip
    fix = client.take(encode_frame((4, 1), scene), SERVER, 3.01)
    assert fix is not None
    assert fix.time_s == pytest.approx(3.01)
    assert client.counters.jumps == 0
    assert not connects(client, 4.0)
    assert connects(client, 4.02)


def test_reports_of_an_outage_may_come_again_by_another_clock() -> None:
    client = streamed()
    client.poll(11.01)
    client.rebase()
    client.notices.clear()
    client.poll(1.0)
    client.poll(2.5)
    assert [text for _, text in client.notices] == [f"{PLAIN}no frame for 1 s: asking again"]
