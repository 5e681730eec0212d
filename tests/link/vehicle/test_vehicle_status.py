"""The autopilot's state as its heartbeats report it: whose they are, and what is kept of them."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.messages import Heartbeat
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.status import VehicleStatus

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
MANUAL, FBWA = 0, 5
BEAT = Heartbeat(
    type=mavlink.MAV_TYPE_FIXED_WING,
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    base_mode=mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    custom_mode=MANUAL,
    system_status=mavlink.MAV_STATE_ACTIVE,
)
ARMED = BEAT.base_mode | mavlink.MAV_MODE_FLAG_SAFETY_ARMED


class NotedStatus:
    """The state, and what it writes to."""

    def __init__(self) -> None:
        self.counters = SessionCounters()
        self.notices: list[tuple[int, str]] = []
        ledger = Ledger(self.counters, self.notices, StreamRequests(1))
        self.known = VehicleStatus(flavour("ardupilot", "override", CHANNELS, 1), ledger)

    def receive(self, now_s: float, **fields: Any) -> None:
        self.known.on_heartbeat(BEAT._replace(**fields), now_s)


def test_before_the_first_nothing_is_known() -> None:
    known = NotedStatus().known
    assert not known.is_known
    assert known.custom_mode == -1
    assert known.mismatch == ""
    assert not known.status.accepts_surfaces
    assert not known.status.armed
    known.rebase(5.0)
    assert not known.is_known


def test_a_heartbeat_says_its_mode_its_time_and_whether_it_is_armed() -> None:
    vehicle = NotedStatus()
    vehicle.receive(12.0, base_mode=ARMED)
    status = vehicle.known.status
    assert vehicle.known.is_known
    assert (status.time_s, status.armed, status.accepts_surfaces) == (12.0, True, True)
    assert not status.failsafe
    vehicle.receive(13.0, custom_mode=FBWA)
    status = vehicle.known.status
    assert vehicle.known.custom_mode == FBWA
    assert (status.time_s, status.armed, status.accepts_surfaces) == (13.0, False, False)
    assert vehicle.counters.heartbeats == 2


@pytest.mark.parametrize(
    "other",
    [{"autopilot": mavlink.MAV_AUTOPILOT_INVALID}, {"type": mavlink.MAV_TYPE_GCS}],
)
def test_a_heartbeat_of_no_autopilot_says_nothing(other: dict[str, int]) -> None:
    vehicle = NotedStatus()
    vehicle.receive(1.0, custom_mode=FBWA)
    vehicle.receive(2.0, **other)
    assert vehicle.known.custom_mode == FBWA
    assert vehicle.known.status.time_s == 1.0
    assert vehicle.counters.heartbeats == 1


def test_another_firmware_accepts_nothing_and_is_reported_once_as_an_error() -> None:
    vehicle = NotedStatus()
    for now_s in (1.0, 2.0):
        vehicle.receive(now_s, autopilot=mavlink.MAV_AUTOPILOT_PX4)
    assert not vehicle.known.status.accepts_surfaces
    ((severity, words),) = vehicle.notices
    assert severity == mavlink.MAV_SEVERITY_ERROR
    assert words == vehicle.known.mismatch
    assert "MAV_AUTOPILOT 12, not 3" in words
    vehicle.receive(3.0)  # the right one: nothing is reported
    assert vehicle.known.mismatch == ""
    assert vehicle.known.status.accepts_surfaces
    assert len(vehicle.notices) == 1
    vehicle.receive(4.0, autopilot=mavlink.MAV_AUTOPILOT_PX4)
    assert len(vehicle.notices) == 2


def test_restarts_are_counted_from_its_next_word_on_or_when_they_are_noticed() -> None:
    vehicle = NotedStatus()
    vehicle.receive(1.0)
    assert vehicle.known.status.boots == 0
    vehicle.counters.reboots = 1
    vehicle.receive(2.0)
    assert vehicle.known.status.boots == 1
    vehicle.counters.reboots = 2
    vehicle.known.restarted()
    assert (vehicle.known.status.boots, vehicle.known.status.time_s) == (2, 2.0)


def test_a_clock_that_is_changed_is_the_heartbeat_s_too() -> None:
    vehicle = NotedStatus()
    vehicle.receive(1000.0, base_mode=ARMED)
    vehicle.known.rebase(3.0)
    assert vehicle.known.status.time_s == 3.0
    assert vehicle.known.status.armed


@pytest.mark.parametrize(
    ("state", "failsafe"),
    [(mavlink.MAV_STATE_ACTIVE, False), (mavlink.MAV_STATE_CRITICAL, True)],
)
def test_a_failsafe_that_it_reports_is_known(state: int, failsafe: bool) -> None:
    vehicle = NotedStatus()
    vehicle.receive(1.0, system_status=state)
    assert vehicle.known.status.failsafe is failsafe
