"""A computer that is too busy: telemetry goes first, then the log, and never the tick."""

from __future__ import annotations

import socket
import time
from math import inf
from types import SimpleNamespace
from typing import Any

import pytest
from module_process import arguments
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import STEP_S, Flight, texts

from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.onboard import loop, process
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.pacing import SHEDDING_TICKS, LoadShedding, TickCounters
from tgl_soar.onboard.realtime import RealtimeOptions
from tgl_soar.onboard.warm_up import PIECE_BYTES, WarmUp


class BusyFlight(Flight):
    """Wakes only now and then."""

    awake_every_s = 0.0

    def run(self, seconds: float) -> None:
        if self.awake_every_s == 0.0:
            super().run(seconds)
            return
        onboard, end_s = self.onboard, self.now_s + seconds
        waiting: list[mavlink.MAVLink_message] = []
        wake_s = self.now_s + self.awake_every_s
        while self.now_s < end_s:
            self.now_s += STEP_S
            stamp_ms = round((self.now_s - self.boot_s) * 1e3)
            noise = 1e-6 * (stamp_ms % 7)  # nothing that is measured repeats itself
            if self._is_due("heartbeat", 1.0):
                waiting.append(mavlink.MAVLink_heartbeat_message(1, 3, 81, self.mode, 4, 3))
            if self._is_due("position", 50.0):
                waiting.append(
                    mavlink.MAVLink_local_position_ned_message(stamp_ms, 0, 0, noise, 0, 0, 0)
                )
            if self._is_due("attitude", 200.0):
                waiting.append(
                    mavlink.MAVLink_attitude_quaternion_message(stamp_ms, 1, noise, 0, 0, 0, 0, 0)
                )
            if self.now_s >= wake_s:
                wake_s += self.awake_every_s
                for message in waiting:
                    self.receive(message)
                waiting.clear()
                if onboard.clocking.due(self.now_s):
                    onboard.periodic(self.now_s)


def test_late_ticks_cost_the_telemetry_and_never_the_surfaces() -> None:
    flight = BusyFlight()
    flight.engaged().run(1.0)
    flight.outbound()
    assert not flight.onboard.load_shedding.no_telemetry
    flight.awake_every_s = 0.02
    flight.run(0.2)
    words = texts(flight.outbound())
    assert any("computer too busy" in text for text in words)
    ticks, surfaces = flight.onboard.counters.ticks, flight.onboard.counters.surface_frames
    flight.run(2.0)
    messages = flight.outbound()
    kinds = {m.get_type() for m in messages}
    assert not kinds & {"NAMED_VALUE_FLOAT", "DEBUG_FLOAT_ARRAY"}
    assert {"RC_CHANNELS_OVERRIDE", "HEARTBEAT"} <= kinds
    ticked = flight.onboard.counters.ticks - ticks
    assert ticked == pytest.approx(100, abs=2)
    assert flight.onboard.counters.surface_frames - surfaces == ticked
    assert flight.mode_now in (CAPTURING, SOARING)
    assert flight.onboard.load_shedding.no_log
    assert flight.onboard.counters.telemetry_shed > 0

    flight.awake_every_s = 0.0
    flight.run(2.0)
    assert not flight.onboard.load_shedding.no_telemetry
    assert "NAMED_VALUE_FLOAT" in {m.get_type() for m in flight.outbound()}


def test_asking_is_answered_however_busy_it_is() -> None:
    flight = BusyFlight()
    flight.engaged()
    flight.awake_every_s = 0.02
    flight.run(0.5)
    flight.outbound()
    flight.set("TGL_CAPTURE", 0.08)
    flight.run(0.1)
    assert [m.param_id for m in flight.outbound("PARAM_VALUE")] == ["TGL_CAPTURE"]


def test_one_late_tick_costs_a_moment_and_many_cost_the_log() -> None:
    load_shedding, counters = LoadShedding(), TickCounters()
    counters.late = 1
    load_shedding.tick(counters, 0, 0)
    assert load_shedding.no_telemetry
    assert not load_shedding.no_log
    for _ in range(SHEDDING_TICKS):
        load_shedding.tick(counters, 1, 0)
    assert not load_shedding.no_telemetry
    for _ in range(SHEDDING_TICKS):
        load_shedding.tick(counters, 0, 0)
    assert load_shedding.no_log


def test_the_wall_clock_may_jump_as_it_likes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = Flight()
    flight.engaged().run(1.0)
    for jump_s in (3600.0, -86400.0 * 365, 0.0, 4e9):
        monkeypatch.setattr(time, "time", lambda jump_s=jump_s: jump_s)
        flight.run(0.5)
        assert flight.mode_now in (CAPTURING, SOARING)
    assert flight.onboard.pacer.counters.skipped == 0


def test_a_flight_with_warm_ups_is_the_same_flight_bit_for_bit() -> None:
    """What is gone through for nothing leaves nothing behind."""
    plain, warmed_up = Flight(), Flight()
    assert warmed_up.onboard.warm_up_s == inf
    warm_ups = 0
    for flight in (plain, warmed_up):
        flight.engaged().run(0.5)
    for _ in range(round(1.0 / STEP_S)):
        if warmed_up.now_s + STEP_S >= warmed_up.onboard.warm_up_s:
            warmed_up.onboard.warm_up()
            warmed_up.onboard.pacer.warmed_up(warmed_up.now_s, warmed_up.now_s + 1e-4)
            warm_ups += 1
        for flight in (plain, warmed_up):
            flight.run(STEP_S)
    assert warm_ups == pytest.approx(200, abs=2)  # one for each tick
    assert repr(plain.onboard.output) == repr(warmed_up.onboard.output)
    assert plain.frames == warmed_up.frames


def test_a_busy_computer_and_a_simulation_warm_up_for_nothing() -> None:
    flight = Flight()
    flight.engaged().run(0.5)
    assert flight.onboard.warm_up_s < inf
    flight.onboard.load_shedding.value = 1.0
    assert flight.onboard.warm_up_s == inf
    simulated = Flight(lockstep=True)
    simulated.run(1.0)
    simulated.onboard.warm_up()
    assert simulated.onboard.warm_up_s == inf


def test_a_backlog_is_not_gone_through_again() -> None:
    """A warm-up is to be done before the sample comes."""
    flight = Flight()
    flight.engaged().run(0.5)
    warm_up_tick = flight.onboard.warm_ups.kept
    assert warm_up_tick is not None
    assert 0 < len(warm_up_tick.piece) <= PIECE_BYTES
    many = mavlink.MAVLink_vfr_hud_message(9.0, 9.0, 0, 0, 0.0, 0.0).pack(mavlink.MAVLink(None, 7))
    flight.onboard.event(bytes(many) * 400, flight.now_s)
    flight.onboard.warm_ups.kept = None
    flight.onboard.tick(flight.now_s)
    again: WarmUp | None = flight.onboard.warm_ups.kept
    assert again is not None
    assert again.piece == b""


@pytest.mark.interpreted
def test_what_has_come_goes_before_a_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(Onboard, "warm_up_s", 0.0)
    monkeypatch.setattr(Onboard, "warm_up", lambda _self: done.append("warmed_up"))
    near, far = socket.socketpair()
    link: Any = SimpleNamespace(generation=0, fileno=near.fileno, is_stream=False)

    def receive(_now_s: float, _most: int) -> list[bytes]:
        done.append("received")
        return [near.recv(10)]

    link.receive = receive
    rounds = iter((False, False, True))
    with near, far:
        far.send(b"!")
        loop.run(Flight().onboard, [link], lambda: next(rounds), print)
    assert done == ["received", "warmed_up"]


@pytest.mark.interpreted
@pytest.mark.parametrize("power_saving", [False, True])
def test_a_power_saving_loop_does_not_warm_up(
    power_saving: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight, warmed_up = Flight(), [0]
    monkeypatch.setattr(Onboard, "warm_up_s", 0.0)
    monkeypatch.setattr(Onboard, "warm_up", lambda _self: warmed_up.append(1))
    silent: Any = SimpleNamespace(generation=0, fileno=lambda: -1, is_stream=False)
    silent.receive = lambda _now_s, _most: []
    rounds = iter((False, False, True))
    loop.run(flight.onboard, [silent], lambda: next(rounds), print, power_saving=power_saving)
    assert sum(warmed_up) == (0 if power_saving else 2)


@pytest.mark.interpreted
def test_crafted_datagrams_in_a_tracker_s_name_hold_up_a_tick_by_one_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each takes 8 ms to be refused; 16 of them wait, always."""
    now_s, onboard = 1000.0, Flight().onboard

    def clock() -> float:
        nonlocal now_s
        now_s += 1e-5
        return now_s

    def pose(*_: object) -> None:
        nonlocal now_s
        now_s += 0.008

    monkeypatch.setattr("tgl_soar.onboard.realtime.clock_s", clock)
    monkeypatch.setattr(onboard.positions, "pose", pose)
    silent: Any = SimpleNamespace(generation=0, fileno=lambda: -1, is_stream=False)
    silent.receive = lambda _now_s, _most: []
    flood: Any = SimpleNamespace(filenos=list)
    flood.receive = lambda most=16: [(b"", ("10.0.0.2", 1510))] * most
    loop.run(onboard, [silent], lambda: now_s > 1002.0, print, mocap=flood)
    assert onboard.counters.ticks > 150  # in 2 s: one in 13 ms, where each waits for one


@pytest.mark.parametrize(
    ("options", "realtime_options"),
    [
        ([], RealtimeOptions(None, None, False)),
        (["--power-saving"], RealtimeOptions(None, 0.0, True)),
        (["--power-saving", "--spin", "50"], RealtimeOptions(None, 50e-6, True)),
        (["--spin", "0"], RealtimeOptions(None, 0.0, False)),
    ],
)
def test_what_is_asked_for_is_requested_of_the_process(
    options: list[str], realtime_options: RealtimeOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[RealtimeOptions] = []
    monkeypatch.setattr(process, "run", lambda options: given.append(options.realtime))
    process.main([*arguments("udp:127.0.0.1:1"), *options])
    (found,) = given
    assert found.spin_s == (
        None if realtime_options.spin_s is None else pytest.approx(realtime_options.spin_s)
    )
    assert found.power_saving == realtime_options.power_saving
