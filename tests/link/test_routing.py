"""One link: what of it is read in a tick, whom it leads to, whose frames it lets in, and how the
frames of ours that go over it look."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import MESSAGE_TRIES
from tgl_soar.link.frames import MARKER_V1, MARKER_V2
from tgl_soar.link.messages import Heartbeat, RcChannelsOverride, Source
from tgl_soar.link.routing import MAX_SENDERS, READ_TRIES, TRIES, Route
from tgl_soar.link.signing import EPOCH_S, Signing

AUTOPILOT, STATION = Source(1, 1), Source(255, 190)
OWN, OVERRIDE = Source(1, 191), Source(255, 191)
KEY = bytes(range(1, 33))
PERIOD_S = 0.005  # of the loop
TRY_S = 5e-6  # of interpreted Python, as measured
ALIVE = Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
MOVES = RcChannelsOverride(1, 1, tuple(range(1000, 1018)))


class Wire:
    """The far end: keeps what comes."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.tapped: list[tuple[bytes, bool]] = []

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def tap(self, frame: bytes, wanted: bool) -> None:
        self.tapped.append((frame, wanted))


def unsigned() -> Signing:
    return Signing(None, 0.0, 0.0)


def route(number: int = 1, wire: Wire | None = None, signing: Signing | None = None) -> Route:
    """Of a link that cuts no frames; the first (0) leads to the autopilot."""
    return Route(number, OWN, OVERRIDE, (wire or Wire()).send, signing or unsigned(), stream=False)


def heartbeat(source: Source = STATION, *, count: int = 0, version1: bool = False) -> bytes:
    codec = mavlink.MAVLink(None, source.system, source.component)
    codec.seq = count
    message = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return bytes(message.pack(codec, force_mavlink1=version1))


# --- how much is read in a tick ------------------------------------------------------------------


def test_all_tries_of_a_tick_take_a_tenth_of_its_period() -> None:
    assert pytest.approx(0.1 * PERIOD_S) == TRIES * TRY_S


def read_tick(link: Route) -> int:
    """As the loop reads a link until its limit: messages in datagrams of their own."""
    count = 0
    while link.may_read():
        count += len(link.take(heartbeat(count=count)))
    return count


def test_a_station_that_sends_a_message_a_datagram_is_read_1200_times_a_second() -> None:
    assert read_tick(route()) / PERIOD_S == pytest.approx(1200.0)


def test_a_link_where_nothing_comes_is_read_thirteen_times_in_a_tick() -> None:
    """A read takes the time of 8 tries: after twelve, 4 of the 100 are left for one more."""
    link = route()
    reads = 0
    while link.may_read():
        assert link.take(b"") == []
        reads += 1
    assert reads == 13
    assert link.tries_left == 100 - 13 * 8


def test_a_link_that_has_had_exactly_its_share_is_not_read_again() -> None:
    link = route()
    link.tries_left = READ_TRIES
    assert link.may_read()
    assert link.tries_left == 0
    assert not link.may_read()
    assert link.tries_left == 0  # a read that is refused costs nothing
    link.tries_left = 1
    assert link.may_read()


def test_a_tick_gives_all_tries_back_and_no_more_and_a_debt_is_paid() -> None:
    link = route()
    link.tries_left = -30
    link.refill()
    assert link.tries_left == TRIES - 30
    link.refill()
    assert link.tries_left == TRIES


def test_one_call_reads_no_more_than_the_tries_that_are_left_and_the_rest_waits() -> None:
    link = route()
    ten = b"".join(heartbeat(count=count) for count in range(10))
    link.tries_left = 2 * (1 + MESSAGE_TRIES)
    assert len(link.take(ten)) == 2
    assert link.tries_left == 0
    assert link.decoder.is_waiting
    link.refill()
    assert len(link.take(b"")) == 8
    assert link.tries_left == TRIES - 8 * (1 + MESSAGE_TRIES)


def test_the_autopilot_s_link_is_read_whole_and_never_counted() -> None:
    link = route(0)
    many = b"".join(heartbeat(AUTOPILOT, count=count & 0xFF) for count in range(300))
    before = link.tries_left
    assert len(link.take(many)) == 300
    assert link.tries_left == before
    link.tries_left = -1  # whatever stands there
    assert len(link.take(heartbeat(AUTOPILOT))) == 1
    link.refill()
    assert link.tries_left == -1


# --- its destination -----------------------------------------------------------------------------


def test_a_link_leads_to_those_who_have_sent_over_it() -> None:
    link = route()
    link.received(STATION)
    assert link.leads_to(STATION)
    assert not link.leads_to(Source(255, 191))
    assert not link.leads_to(AUTOPILOT)


def test_where_systems_are_known_no_other_is_remembered() -> None:
    link = Route(1, OWN, OVERRIDE, Wire().send, unsigned(), stream=False, known=(1, 255))
    for source in (AUTOPILOT, STATION, Source(77, 1)):
        link.received(source)
    assert link.leads_to(AUTOPILOT)
    assert link.leads_to(STATION)
    assert not link.leads_to(Source(77, 1))


def test_of_thirty_three_senders_the_first_is_forgotten_until_it_sends_again() -> None:
    """32: an autopilot, a station or two and their components, many times over."""
    link = route()
    senders = [Source(system, 1) for system in range(1, 34)]
    assert len(senders) == MAX_SENDERS + 1 == 33
    for source in senders[:32]:
        link.received(source)
    assert all(link.leads_to(source) for source in senders[:32])
    link.received(senders[32])
    assert [source for source in senders if not link.leads_to(source)] == senders[:1]
    link.received(senders[0])
    assert [source for source in senders if not link.leads_to(source)] == senders[1:2]


def test_a_sender_that_is_known_already_pushes_nobody_out() -> None:
    link = route()
    senders = [Source(system, 1) for system in range(1, 33)]
    for source in (*senders, senders[5], Source(*senders[5]), senders[31]):
        link.received(source)
    assert all(link.leads_to(source) for source in senders)


def test_another_peer_begins_with_nothing() -> None:
    link = route()
    link.greeted = link.asked = True
    link.received(STATION)
    link.take(heartbeat(version1=True))
    assert link.decoder.only_v1
    link.reset()
    assert not link.leads_to(STATION)
    assert (link.greeted, link.asked, link.decoder.only_v1) == (False, False, False)
    link.received(STATION)  # the very one that sent last
    assert link.leads_to(STATION)


def test_a_new_link_has_greeted_and_asked_nobody() -> None:
    link = route()
    assert (link.greeted, link.asked) == (False, False)
    assert not link.leads_to(STATION)


# --- who sends, and how --------------------------------------------------------------------------


def test_overrides_go_out_under_a_name_of_their_own_or_under_ours_if_that_is_the_same() -> None:
    apart, same = route(), Route(1, OWN, OWN, Wire().send, unsigned(), stream=False)
    decode = mavlink.MAVLink(None).decode
    first = [decode(bytearray(encoder.encode(MOVES))) for encoder in (apart.own, apart.override)]
    assert [(m.get_srcSystem(), m.get_srcComponent()) for m in first] == [OWN, OVERRIDE]
    assert [m.get_seq() for m in first] == [0, 0]  # each sender counts its own frames
    second = [decode(bytearray(encoder.encode(MOVES))) for encoder in (same.own, same.override)]
    assert [m.get_seq() for m in second] == [0, 1]


def test_ours_are_of_mavlink_1_as_long_as_nothing_else_has_come() -> None:
    link = route()
    assert link.own.encode(ALIVE)[0] == MARKER_V2
    for version1, marker in ((True, MARKER_V1), (False, MARKER_V2), (True, MARKER_V2)):
        link.take(heartbeat(version1=version1))
        link.match_version()
        assert link.own.encode(ALIVE)[0] == marker
        assert link.override.encode(MOVES)[0] == marker


def test_commands_and_all_else_go_one_way_where_the_transport_has_no_other() -> None:
    wire = Wire()
    link = route(wire=wire)
    assert link.send_command(b"command")
    assert link.send(b"else")
    assert wire.sent == [b"command", b"else"]
    assert not link.clear_for_release()  # nothing waits there


@pytest.mark.parametrize("waits", [True, False])
def test_a_transport_s_own_way_for_commands_is_used(waits: bool) -> None:
    plain, urgent = Wire(), Wire()
    link = Route(
        1,
        OWN,
        OVERRIDE,
        plain.send,
        unsigned(),
        stream=False,
        send_command=urgent.send,
        clear_for_release=lambda: waits,
    )
    link.send_command(b"command")
    assert (plain.sent, urgent.sent) == ([], [b"command"])
    assert link.clear_for_release() == waits


@pytest.mark.parametrize(("stream", "messages"), [(True, 1), (False, 0)])
def test_only_a_stream_goes_on_with_a_frame_that_was_cut(stream: bool, messages: int) -> None:
    link = Route(1, OWN, OVERRIDE, Wire().send, unsigned(), stream=stream)
    frame = heartbeat()
    assert link.take(frame[:9]) == []
    assert len(link.take(frame[9:])) == messages


# --- signatures, and what the log is shown -------------------------------------------------------


def keyed() -> Signing:
    return Signing(KEY, EPOCH_S + 1e8, 0.0)


def test_without_a_key_everything_is_let_in() -> None:
    assert len(route().take(heartbeat())) == 1


@pytest.mark.parametrize(
    ("excused", "sender", "messages"),
    [
        (None, STATION, 0),
        (AUTOPILOT, STATION, 0),
        (AUTOPILOT, AUTOPILOT, 1),
        (AUTOPILOT, Source(1, 2), 0),
    ],
)
def test_with_a_key_only_who_is_excused_need_not_sign(
    excused: Source | None, sender: Source, messages: int
) -> None:
    link = Route(1, OWN, OVERRIDE, Wire().send, keyed(), stream=False, excused=excused)
    assert len(link.take(heartbeat(sender))) == messages
    assert link.decoder.counters.refused == 1 - messages


def test_frames_of_ours_are_signed_with_the_link_s_number() -> None:
    """MAVLink: each link of a sender has an id of its own, the first byte of the signature."""
    link = route(3, signing=keyed())
    for frame in (link.own.encode(ALIVE), link.override.encode(MOVES)):
        assert frame[2] & mavlink.MAVLINK_IFLAG_SIGNED
        assert frame[-mavlink.MAVLINK_SIGNATURE_BLOCK_LEN] == 3


@pytest.mark.parametrize(
    ("signing", "sender", "wanted"),
    [
        (unsigned(), STATION, True),
        (unsigned(), Source(77, 190), False),  # of an unknown sender
        (keyed(), STATION, False),  # not signed
    ],
)
def test_the_log_is_shown_every_frame_and_whether_it_is_wanted(
    signing: Signing, sender: Source, wanted: bool
) -> None:
    wire = Wire()
    link = Route(1, OWN, OVERRIDE, wire.send, signing, stream=False, known=(1, 255), tap=wire.tap)
    frame = heartbeat(sender)
    link.take(frame)
    assert wire.tapped == [(frame, wanted)]
