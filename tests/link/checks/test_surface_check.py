"""The check of the surfaces on the ground: what it refuses, what it finds, how it ends."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
from random import Random

import pytest
from bench_bridge import AIRFRAME
from msgspec.structs import replace

from tgl_soar.cli.surfaces import latency_words
from tgl_soar.config.files import load_airframe, load_flight, load_parameters, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.loop_margin import margin_when_late
from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.checks.surface_check import (
    HEARTBEAT_MAX_S,
    NO_SPEED,
    SIGHTS,
    STOPS,
    SurfaceCheck,
    finding,
)
from tgl_soar.link.messages import (
    MODE_FLAG_ARMED,
    Heartbeat,
    LocalPositionNed,
    RcChannelsOverride,
    ServoOutputRaw,
)

SITE = shipped("sites/tunnel.toml")
CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900, reversed=True),
    aileron=SurfaceChannel(channel=1, pwm_min=1000, pwm_trim=1480, pwm_max=2000),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
MANUAL, FBWA = 0, 5
DISARMED = 1 | 64


class Bench:
    """A check, and an autopilot that drives its servos as commanded, or nearly."""

    def __init__(self, *, armed_on_ground: bool = False) -> None:
        flavour = ArduPilot(CHANNELS, 1)
        self.check = SurfaceCheck(CHANNELS, flavour, 0.5, 1.0, armed_on_ground=armed_on_ground)
        self.now_s = 10.0
        self.mode, self.base_mode = MANUAL, DISARMED
        self.outputs = {1: 1, 2: 2, 4: 4}  # which channel each output follows
        self.offset_us, self.gain = 0, 1.0
        self.beats = self.reads_back = True
        self.speed_mps: float | None = None  # as it is reported with each heartbeat
        self._pulses = {1: 1480, 2: 1500, 4: 1500}
        self.receive_heartbeat()

    def receive_heartbeat(self) -> None:
        self.check.take(
            Heartbeat(
                type=1,
                autopilot=3,
                base_mode=self.base_mode,
                custom_mode=self.mode,
                system_status=3,
            ),
            self.now_s,
        )
        if self.speed_mps is not None:
            self.check.take(
                LocalPositionNed(time_boot_ms=0, x=0, y=0, z=0, vx=self.speed_mps, vy=0.0, vz=0.0),
                self.now_s,
            )

    def run(self) -> list[str]:
        """To the end, or to a refusal; what a person was to look for."""
        sights: list[str] = []
        while not self.check.done:
            self.now_s += 0.05
            if self.beats:
                self.receive_heartbeat()
            if self.check.refusal(self.now_s):
                break
            for message in self.check.step(self.now_s):
                assert isinstance(message, RcChannelsOverride)
                self._pulses = {c: message.channels[c - 1] for c in (1, 2, 4)}
            if self.reads_back:
                servos = [0] * 16
                for output, channel in self.outputs.items():
                    pulse = self._pulses[channel] - 1500
                    servos[output - 1] = round(1500 + self.gain * pulse + self.offset_us)
                self.check.take(ServoOutputRaw(0, 0, tuple(servos)), self.now_s)
            if self.check.held(self.now_s):
                sights.append(self.check.sight)
                self.check.move_on()
        return sights

    def faults(self) -> dict[str, str]:
        self.run()
        return {f.surface: "; ".join(f.faults) for f in self.check.findings()}


def test_every_surface_goes_both_ways_and_back_and_all_is_as_in_the_file() -> None:
    bench = Bench()
    sights = bench.run()
    assert sights == [
        sight
        for name in ("elevator", "aileron", "rudder")
        for sight in ("", SIGHTS[name, 1], SIGHTS[name, -1], "")
    ]
    elevator, aileron, rudder = bench.check.findings()
    assert elevator == ("elevator", (), 1500, 1700, 1300)  # reversed
    assert aileron == ("aileron", (), 1480, 1240, 1740)
    assert rudder == ("rudder", (), 1500, 1300, 1700)


def test_outputs_of_another_port_are_not_those_of_the_surfaces() -> None:
    """An ArduPlane sends its outputs from 17 on as port 1, a PX4 those of its second board."""
    bench = Bench()
    take = bench.check.take

    def both(message: object, now_s: float) -> None:
        take(message, now_s)
        if isinstance(message, ServoOutputRaw):
            take(ServoOutputRaw(0, 1, (0,) * 16), now_s)

    bench.check.take = both  # type: ignore[method-assign]
    assert not any(bench.faults().values())


def test_commands_go_out_often_enough_to_be_kept() -> None:
    bench = Bench()
    sent = 0
    for _ in range(100):
        bench.now_s += 0.01
        sent += len(bench.check.step(bench.now_s))
    assert 15 <= sent <= 21


def latencies_s(late_s: Callable[[], float]) -> tuple[float, float]:
    """Least and most that a check finds: outputs at 50 Hz, each command as late as is drawn."""
    check = SurfaceCheck(CHANNELS, ArduPilot(CHANNELS, 1), 0.5, 1.0)
    pulses, waiting = {1: 1480, 2: 1500, 4: 1500}, []
    for n in range(40_000):
        now_s = 10.0 + 0.001 * n
        if check.done:
            break
        for message in check.step(now_s):
            assert isinstance(message, RcChannelsOverride)
            waiting.append((now_s + late_s(), {c: message.channels[c - 1] for c in (1, 2, 4)}))
        while waiting and waiting[0][0] <= now_s:
            pulses = waiting.pop(0)[1]
        if n % 20 == 0:
            servos = tuple(pulses.get(output, 0) for output in range(1, 17))
            check.take(ServoOutputRaw(0, 0, servos), now_s)
        if check.held(now_s):
            check.move_on()
    assert check.done
    return check.latencies_s


@pytest.mark.parametrize("late_s", [0.01, 0.04])
def test_the_latency_is_that_of_the_least_late_step(late_s: float) -> None:
    """Outputs at 50 Hz: an output shows a step within 20 ms of the servo having it."""
    least, most = latencies_s(lambda: late_s)
    assert late_s - 1e-6 <= least <= most <= late_s + 0.021


def test_of_a_link_that_is_late_at_times_both_ends_are_reported() -> None:
    """10 to 40 ms: of nine steps the latest is later than 25 ms but 1 time of 500."""
    draw = Random(1)
    least, most = latencies_s(lambda: draw.uniform(0.01, 0.04))
    assert 0.01 - 1e-6 <= least < 0.025 < most <= 0.061


def test_the_latency_is_compared_with_what_the_schedule_knows() -> None:
    plane = load_airframe(AIRFRAME)
    values = ParameterSet().changed(plane.all_parameters())
    least, most, far = (margin_when_late(values, late_s) for late_s in (0.010, 0.012, 0.06))
    assert min(least, most) > 0.5 > far
    good = latency_words((0.010, 0.012), plane)
    assert "10 to 12 ms, the way back and the wait for an output with it; CMD_DELAY is 7.5" in good
    assert good.endswith(f"it would leave a margin of {least:.2f} to {most:.2f}")
    at_times = latency_words((0.010, 0.06), plane)
    assert f"{least:.2f} to {far:.2f}, of 0.5: if the link is that late at times, set" in at_times
    bad = latency_words((0.06, 0.06), plane)
    assert f"{far:.2f} to {far:.2f}, of 0.5: make the link faster, or set CMD_DELAY" in bad
    assert "not measured" in latency_words((float("nan"), float("nan")), plane)


def test_of_an_aircraft_whose_file_gives_no_gains_those_are_judged_that_it_flies_with() -> None:
    """A glider of 2 m: the shipped aircraft's gains, as they are, would leave it no margin."""
    shipped_one, site, _ = load_flight(AIRFRAME, SITE)
    bench = replace(
        shipped_one.airframe, name="2 m", mass_kg=1.3, span_m=2.0, chord_m=0.2, wing_area_m2=0.39,
        ixx_kgm2=0.09, iyy_kgm2=0.05, izz_kgm2=0.13,
    )  # fmt: skip
    plane = replace(shipped_one, airframe=bench, parameters={})
    flown = load_parameters(plane, AIRFRAME, site, SITE)
    late_s = flown["CMD_DELAY"]
    left = margin_when_late(flown, late_s)
    assert margin_when_late(ParameterSet().changed(plane.all_parameters()), late_s) < 0.5 <= left
    words = latency_words((late_s, late_s), plane)
    assert words.endswith(f"it would leave a margin of {left:.2f} to {left:.2f}")


@pytest.mark.parametrize(
    ("change", "surface", "words"),
    [
        ({"offset_us": 40}, "aileron", "trim: 1520 us, the file says 1480 us"),
        ({"gain": 0.6}, "elevator", "travel to +: 1380 us, the file says 1300 us"),
        ({"gain": -1.0}, "rudder", "moves the other way"),
        ({"gain": 0.0}, "rudder", "output 4 does not move"),
        ({"outputs": {1: 1, 2: 1, 4: 4}}, "aileron", "moves output 2 too"),
        ({"outputs": {1: 1, 2: 1, 4: 4}}, "elevator", "output 2 does not move"),
        ({"outputs": {1: 1, 4: 4}}, "elevator", "cannot be read back"),
        ({"reads_back": False}, "aileron", "cannot be read back"),
    ],
)
def test_what_differs_from_the_file_is_named(
    change: dict[str, object], surface: str, words: str
) -> None:
    bench = Bench()
    for name, value in change.items():
        setattr(bench, name, value)
    assert words in bench.faults()[surface]


def test_what_was_not_read_back_has_no_numbers() -> None:
    bench = Bench()
    bench.reads_back = False
    bench.run()
    assert all(isnan(f.trim_us) and isnan(f.high_us) for f in bench.check.findings())


def test_a_surface_that_sticks_is_seen_when_it_does_not_come_back() -> None:
    bench = Bench()
    bench.run()
    stops = [s._replace(servos_us=(1500, 1500, 0, 1500)) for s in bench.check.stops]
    last = stops[3]._replace(servos_us=(1500, 1560, 0, 1500))
    found = finding("elevator", CHANNELS.elevator, [*stops[:3], last])
    assert any("does not come back" in fault for fault in found.faults)


def test_after_three_heartbeats_that_did_not_come_nothing_is_moved() -> None:
    bench = Bench()
    assert bench.check.refusal(bench.now_s + 2.9) == ""
    assert "no heartbeat" in bench.check.refusal(bench.now_s + 3.1)


def test_nothing_is_moved_on_an_armed_aircraft() -> None:
    bench = Bench()
    bench.base_mode |= MODE_FLAG_ARMED
    bench.receive_heartbeat()
    assert "armed" in bench.check.refusal(bench.now_s)
    assert bench.run() == []


def test_armed_and_held_on_the_ground_it_must_stand_still() -> None:
    bench = Bench(armed_on_ground=True)
    bench.base_mode |= MODE_FLAG_ARMED
    bench.receive_heartbeat()
    assert "no speed of it was received" in bench.check.refusal(bench.now_s)
    bench.check.take(
        LocalPositionNed(time_boot_ms=0, x=0, y=0, z=0, vx=2.0, vy=0.0, vz=0.5), bench.now_s
    )
    assert "moves at 2.1 m/s" in bench.check.refusal(bench.now_s)
    bench.speed_mps = 0.1
    assert len(bench.run()) == 3 * len(STOPS)


def test_armed_it_is_left_alone_once_its_speed_is_not_reported_any_more() -> None:
    bench = Bench(armed_on_ground=True)
    bench.base_mode |= MODE_FLAG_ARMED
    bench.speed_mps = 0.1
    bench.receive_heartbeat()
    assert bench.check.refusal(bench.now_s) == ""
    bench.speed_mps, reported_s = None, bench.now_s
    assert len(bench.run()) < len(STOPS)
    assert bench.now_s - reported_s == pytest.approx(HEARTBEAT_MAX_S, abs=0.1)
    assert bench.check.refusal(bench.now_s) == NO_SPEED


@pytest.mark.parametrize(
    ("mode", "base_mode", "beats", "words"),
    [
        (FBWA, DISARMED, True, "put it into MANUAL"),
        (MANUAL, DISARMED | MODE_FLAG_ARMED, True, "armed"),
        (MANUAL, DISARMED, False, "no heartbeat"),
    ],
)
def test_it_stops_half_way_when_that_changes(
    mode: int, base_mode: int, beats: bool, words: str
) -> None:
    bench = Bench()
    for _ in range(30):
        bench.now_s += 0.05
        bench.receive_heartbeat()
        bench.check.step(bench.now_s)
    bench.check.move_on()
    bench.mode, bench.base_mode, bench.beats = mode, base_mode, beats
    bench.run()
    assert words in bench.check.refusal(bench.now_s)
    assert not bench.check.done
