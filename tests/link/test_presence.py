"""Our heartbeat: every mode can be told from it, and whose it is."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.control import supervisor, supervisor_texts
from tgl_soar.link.messages import Heartbeat
from tgl_soar.link.presence import ALONE_S, ENGAGED, STATES, Presence


def beat_in(mode: int, start: int = 7) -> tuple[int, int]:
    presence = Presence(start)
    presence.mode = mode
    beat = presence.heartbeat()
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED == 0  # never taken for armed
    return beat.custom_mode, beat.system_status


def test_every_mode_of_the_supervisor_has_its_state() -> None:
    assert list(STATES) == list(range(len(supervisor_texts.MODE_NAMES)))
    state = {name: beat_in(mode)[1] for mode, name in enumerate(supervisor_texts.MODE_NAMES)}
    assert state["boot"] == mavlink.MAV_STATE_BOOT
    assert state["standby"] == state["ready"] == mavlink.MAV_STATE_STANDBY
    assert state["capturing"] == state["soaring"] == mavlink.MAV_STATE_ACTIVE
    assert state["holding"] == state["recovering"] == mavlink.MAV_STATE_CRITICAL
    assert state["released"] == mavlink.MAV_STATE_CRITICAL
    assert state["failed"] == mavlink.MAV_STATE_EMERGENCY


def test_the_low_byte_is_the_mode_and_the_rest_the_start() -> None:
    for mode in range(len(STATES)):
        for start in (1, 0x5A5A5A, 2**24 - 1):
            assert beat_in(mode, start)[0] == start * 256 + mode
    assert beat_in(4, 0)[0] == beat_in(4, 2**24)[0] == 256 + 4  # never that of none


def test_a_duplicate_is_distinguished_from_our_own_echo() -> None:
    ours, theirs = Presence(7), Presence(8)
    assert ours.is_alone(0.0)
    for mode in range(len(STATES)):
        ours.mode = mode  # an echo may be old: of another mode than ours is now
        assert not Presence(7).take(ours.heartbeat(), 1.0)
        theirs.mode = mode
        assert ours.take(theirs.heartbeat(), 1.0)
        assert ours.duplicate_is_engaged == supervisor.is_flying(mode)
    assert frozenset(filter(supervisor.is_flying, STATES)) == ENGAGED
    assert not ours.is_alone(1.0 + ALONE_S)
    assert ours.is_alone(1.1 + ALONE_S)
    ours.take(theirs.heartbeat(), 1.0)
    ours.rebase()
    assert ours.is_alone(1.0)


def test_a_module_that_tells_no_mode_is_a_duplicate_too() -> None:
    ours = Presence(7)
    assert ours.take(
        Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4), 1.0
    )
    assert not ours.duplicate_is_engaged
