"""Which bytes of a datagram are frames, and where a router like ArduPilot's sends each of them."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim import routing
from tgl_soar.sim.routing import MAX_ROUTES, RoutedFrame, Router, split_frames

SYSTEM, COMPONENT = 1, 1
OURS = SYSTEM, COMPONENT


def beat() -> Any:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def ping(system: int, component: int) -> Any:
    return mavlink.MAVLink_ping_message(0, 0, system, component)


def packed(message: Any, system: int = 9, component: int = 190, *, old: bool = False) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, system, component), force_mavlink1=old))


def framed(message: Any, system: int = 9, component: int = 190) -> RoutedFrame:
    [frame] = split(packed(message, system, component))[0]
    return frame


def split(data: bytes) -> tuple[list[RoutedFrame], int]:
    return split_frames(mavlink.MAVLink(None), data)


# --- frames in a datagram -------------------------------------------------------------------------


@pytest.mark.parametrize("old", [False, True])
def test_frames_are_found_one_after_the_other(old: bool) -> None:
    first, second = packed(beat(), old=old), packed(ping(1, 2), 7, 8, old=old)
    frames, lost = split(first + second)
    assert lost == 0
    assert [frame.raw for frame in frames] == [first, second]
    assert [(f.system, f.component) for f in frames] == [(9, 190), (7, 8)]
    assert [f.message.get_type() for f in frames] == ["HEARTBEAT", "PING"]


def test_bytes_of_no_frame_are_counted() -> None:
    frame = packed(beat())
    assert split(b"")[1] == 0
    assert split(b"ab" + frame + b"cde") == (split(frame)[0], 5)


def test_a_frame_that_is_cut_off_is_lost() -> None:
    for frame in (packed(beat()), packed(beat(), old=True)):
        for cut in range(1, len(frame)):
            assert split(frame[:cut]) == ([], cut)


def test_a_frame_with_a_wrong_check_sum_is_lost_and_the_next_one_found() -> None:
    bad, good = bytearray(packed(beat())), packed(ping(0, 0))
    bad[-1] ^= 0xFF
    frames, lost = split(bytes(bad) + good)
    assert [frame.raw for frame in frames] == [good]
    assert lost == len(bad)


def test_a_frame_of_an_unknown_message_is_lost() -> None:
    for frame, at in ((packed(beat()), 7), (packed(beat(), old=True), 5)):
        changed = bytearray(frame)
        changed[at] = 3  # no message has this number
        assert 3 not in mavlink.mavlink_map
        assert split(bytes(changed)) == ([], len(frame))


@pytest.mark.parametrize("byte", [8, 9])
def test_a_message_s_number_has_three_bytes(byte: int) -> None:
    frame = bytearray(packed(beat()))
    frame[byte] = 0x77
    assert routing._frame_length(bytes(frame), 0) == 0
    frame[byte] = 0
    assert routing._frame_length(bytes(frame), 0) == len(frame)


def test_a_number_beyond_one_byte_is_found() -> None:
    frame = packed(mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    assert frame[7:10] == b"\x00\x01\x00"  # 256
    assert [f.message.get_type() for f in split(frame)[0]] == ["SETUP_SIGNING"]


def test_a_signature_is_carried() -> None:
    codec = mavlink.MAVLink(None, 9, 190)
    codec.signing.secret_key = b"k" * 32
    codec.signing.sign_outgoing = True
    signed = bytes(beat().pack(codec))
    plain = packed(beat())
    assert len(signed) == len(plain) + 13
    frames, lost = split(signed + plain)
    assert [frame.raw for frame in frames] == [signed, plain]
    assert lost == 0
    assert split(signed[:-1])[0] == []


def test_a_frame_of_unknown_flags_is_lost() -> None:
    frame = bytearray(packed(beat()))
    frame[2] = 0x02
    assert split(bytes(frame))[0] == []


def test_after_32_false_starts_a_datagram_is_not_worth_the_time() -> None:
    """Each looks like a whole frame, and its check sum is wrong."""
    false = bytearray(packed(beat()))
    false[-1] ^= 0xFF
    good = packed(beat())
    assert len(split(bytes(false) * 31 + good)[0]) == 1
    frames, lost = split(bytes(false) * 32 + good)
    assert frames == []
    assert lost == 32 * len(false) + len(good)


# --- where a frame goes ---------------------------------------------------------------------------


@pytest.fixture
def router() -> Router:
    """Three links; a ground station (255, 190) on the first, a companion (1, 191) on the second."""
    made = Router()
    for link in (1, 2, 3):
        made.add(link)
    made.route(1, framed(beat(), 255, 190), *OURS)
    made.route(2, framed(beat(), 1, 191), *OURS)
    return made


def test_a_link_is_there_once(router: Router) -> None:
    router.add(2)
    assert router.links == [1, 2, 3]


def test_it_learns_who_sends_on_which_link(router: Router) -> None:
    assert router.routes_to(255, 190) == (1,)
    assert router.routes_to(1, 191) == (2,)
    assert router.routes_to(7, 7) == ()
    router.route(3, framed(beat(), 255, 190), *OURS)
    router.route(3, framed(beat(), 255, 190), *OURS)
    assert router.routes_to(255, 190) == (1, 3)


def test_a_sender_without_a_system_is_not_learnt(router: Router) -> None:
    router.route(3, framed(beat(), 0, 5), *OURS)
    assert router.routes_to(0, 5) == ()


def test_a_link_that_is_gone_takes_its_routes_with_it(router: Router) -> None:
    router.route(3, framed(beat(), 255, 190), *OURS)
    router.forget(1)
    assert router.links == [2, 3]
    assert router.routes_to(255, 190) == (3,)
    assert router.routes_to(1, 191) == (2,)
    router.forget(3)
    assert router.routes_to(255, 190) == ()
    router.forget(3)  # a second removal does no harm
    assert router.links == [2]


@pytest.mark.parametrize("kind", ["timesync", "radio", "radio_status"])
def test_what_is_between_neighbours_goes_no_further(router: Router, kind: str) -> None:
    messages = {
        "timesync": mavlink.MAVLink_timesync_message(0, 1),
        "radio": mavlink.MAVLink_radio_message(0, 0, 0, 0, 0, 0, 0),
        "radio_status": mavlink.MAVLink_radio_status_message(0, 0, 0, 0, 0, 0, 0),
    }
    assert router.route(1, framed(messages[kind], 255, 190), *OURS) == ([], True)


def test_a_heartbeat_goes_to_links_on_which_its_sender_is_not(router: Router) -> None:
    assert router.route(1, framed(beat(), 255, 190), *OURS) == ([2, 3], True)
    router.route(3, framed(beat(), 255, 190), *OURS)
    assert router.route(1, framed(beat(), 255, 190), *OURS) == ([2], True)


def test_a_broadcast_goes_to_every_other_link_and_to_us(router: Router) -> None:
    assert router.route(2, framed(ping(0, 0), 1, 191), *OURS) == ([1, 3], True)
    assert router.route(2, framed(ping(0, 7), 1, 191), *OURS) == ([1, 3], True)


def test_a_message_without_a_target_is_a_broadcast(router: Router) -> None:
    text = mavlink.MAVLink_statustext_message(6, b"hello")
    assert router.route(1, framed(text, 255, 190), *OURS) == ([2, 3], True)


def test_the_target_of_manual_control_is_a_system(router: Router) -> None:
    """Its field is called target."""
    control = mavlink.MAVLink_manual_control_message(255, 0, 0, 0, 0, 0)
    assert router.route(2, framed(control, 1, 191), *OURS) == ([1], False)
    # It names no component: all of the system are meant.
    control = mavlink.MAVLink_manual_control_message(SYSTEM, 0, 0, 0, 0, 0)
    assert router.route(1, framed(control, 255, 190), *OURS) == ([2], True)


def test_what_is_for_us_goes_no_further(router: Router) -> None:
    assert router.route(1, framed(ping(*OURS), 255, 190), *OURS) == ([], True)


def test_what_is_for_all_of_our_system_is_for_us_too(router: Router) -> None:
    assert router.route(1, framed(ping(1, 0), 255, 190), *OURS) == ([2], True)


def test_what_is_for_a_component_of_ours_goes_to_its_link_alone(router: Router) -> None:
    assert router.route(1, framed(ping(1, 191), 255, 190), *OURS) == ([2], False)


def test_what_is_for_a_component_that_is_not_known_is_executed_by_us(router: Router) -> None:
    """The trap, as measured on the real firmware."""
    assert router.route(1, framed(ping(1, 77), 255, 190), *OURS) == ([], True)


def test_what_is_for_another_system_goes_to_all_links_of_that(router: Router) -> None:
    """Another vehicle sorts out its components by itself."""
    router.route(3, framed(beat(), 255, 200), *OURS)
    assert router.route(2, framed(ping(255, 190), 1, 191), *OURS) == ([1, 3], False)
    assert router.route(2, framed(ping(255, 0), 1, 191), *OURS) == ([1, 3], False)
    assert router.route(2, framed(ping(88, 1), 1, 191), *OURS) == ([], False)


def test_nothing_goes_back_where_it_came_from_nor_twice(router: Router) -> None:
    router.route(1, framed(beat(), 255, 200), *OURS)
    assert router.route(2, framed(ping(255, 0), 1, 191), *OURS) == ([1], False)
    assert router.route(1, framed(ping(255, 200), 255, 190), *OURS) == ([], False)


def test_sixty_four_identities_are_remembered() -> None:
    assert MAX_ROUTES == 64
    router = Router()
    for component in range(1, 67):
        router.route(component, framed(beat(), 5, component), *OURS)
    assert router.routes_to(5, 64) == (64,)
    assert router.routes_to(5, 65) == ()
    router.route(99, framed(beat(), 5, 64), *OURS)  # of one that is known a link is still learned
    assert router.routes_to(5, 64) == (64, 99)
