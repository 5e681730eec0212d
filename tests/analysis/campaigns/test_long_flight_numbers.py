"""A long flight by its parts: what the wire takes, when the clock wraps, the report of each part,
and what ends it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.campaigns import long_flight as e
from tgl_soar.analysis.campaigns.drawn_faults import place
from tgl_soar.control.supervisor import RELEASED, SOARING
from tgl_soar.sim.world import make_world as make_any_world

SURFACES = place().airframe.surfaces
WRAP_MS = 2**32


def overrides(*pwm: int) -> bytes:
    """The frame of a module that sets these eight channels."""
    message = mavlink.MAVLink_rc_channels_override_message(1, 1, *pwm, *[0] * 10)
    return bytes(message.pack(mavlink.MAVLink(None, 255, 190)))


def channels(elevator: int, aileron: int, rudder: int) -> list[int]:
    found = [1000] * 8
    driven = SURFACES.driven()
    for surface, value in zip(driven, (elevator, aileron, rudder), strict=True):
        found[surface.channel - 1] = value
    return found


def test_a_command_is_what_the_overrides_say_of_each_surface() -> None:
    wire = e._Wire(SURFACES)
    assert wire.command is None
    assert wire.take(overrides(*channels(1500, 1500, 1500)))
    assert wire.command is not None
    assert wire.command[:3] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert wire.take(overrides(*channels(1700, 1400, 1900)))
    sizes = [abs(each) for each in wire.command[:3]]
    assert sizes == pytest.approx([0.5, 0.25, 1.0])
    assert {(each.pwm_trim, each.pwm_max) for each in SURFACES.driven()} == {(1500, 1900)}


@pytest.mark.parametrize("surface", [0, 1, 2])
def test_a_surface_that_is_released_releases_all(surface: int) -> None:
    wire = e._Wire(SURFACES)
    wire.take(overrides(*channels(1700, 1400, 1900)))
    values = [1500, 1500, 1500]
    values[surface] = 0
    wire.take(overrides(*channels(*values)))
    assert wire.command is None


def test_no_other_frame_is_a_command() -> None:
    wire = e._Wire(SURFACES)
    other = mavlink.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0)
    assert wire.take(bytes(other.pack(mavlink.MAVLink(None, 255, 190))))
    frame = overrides(*channels(1700, 1400, 1900))
    assert wire.take(b"\xfe" + frame[1:])  # of the older protocol
    assert wire.command is None
    assert wire.take(frame)
    assert wire.command is not None


def test_both_ends_have_names_of_their_own() -> None:
    wire = e._Wire(SURFACES)
    for sender, system, component in ((wire.vehicle, 1, 1), (wire.station, 255, 190)):
        assert (sender.srcSystem, sender.srcComponent) == (system, component)


@pytest.mark.parametrize(
    ("time_s", "boot_ms"),
    [(0.0, 0), (1.2345, 1234), (WRAP_MS / 1e3 - 0.001, WRAP_MS - 1), (WRAP_MS / 1e3, 0),
     (WRAP_MS / 1e3 + 2.5, 2500)],
)  # fmt: skip
def test_the_autopilots_clock_has_32_bits_of_milliseconds(time_s: float, boot_ms: int) -> None:
    assert e._ms(time_s) == boot_ms


def test_memory_is_what_linux_counts_or_the_most_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    assert e.resident_kib() > 10_000
    for answer in ("Name: x\nVmRSS:\t  12345 kB\nVmSwap: 7 kB\n", "Name: x\n", OSError("none")):

        def read_text(_path: Path, encoding: str, answer: Any = answer) -> str:
            assert encoding == "ascii"
            if isinstance(answer, OSError):
                raise answer
            return str(answer)

        monkeypatch.setattr(Path, "read_text", read_text)
        monkeypatch.setattr(
            e, "resource", SimpleNamespace(RUSAGE_SELF=3, getrusage=most_memory)
        )  # fmt: skip
        assert e.resident_kib() == (12345 if isinstance(answer, str) and "RSS" in answer else 777)


def most_memory(who: int) -> Any:
    assert who == 3
    return SimpleNamespace(ru_maxrss=777)


def part(kib: int) -> e.Part:
    return e.Part(flown_s=1.0, resident_kib=kib, tick_us=1.0, late_s=0.0, largest_e_rho_m=0.0)


def test_memory_has_grown_since_the_first_part() -> None:
    assert e.LongFlight(1.0).grown_kib == 0
    assert e.LongFlight(1.0, parts=[part(700), part(950), part(800)]).grown_kib == 100


# --- a short one ----------------------------------------------------------------------------------


def test_it_wraps_half_way_and_is_reported_in_24_parts() -> None:
    parts: list[e.Part] = []
    flight = e.fly_long(2.4, on_part=parts.append)
    assert flight.wrapped
    assert (flight.duration_s, flight.ended) == (2.4, "")
    assert flight.ticks == flight.expected_ticks == 480
    assert (flight.reboots, flight.stale, flight.lost) == (0, 0, 0)
    assert flight.parts == parts
    assert [each.flown_s for each in parts] == pytest.approx([0.1 * n for n in range(1, 25)])
    assert {each.late_s for each in parts} == {0.0}
    assert all(each.tick_us > 1.0 for each in parts)
    assert flight.is_well
    # The aircraft is held until the module engages, at two seconds.
    assert all(each.largest_e_rho_m == 0.0 for each in parts if each.flown_s < 1.95)
    assert 0.0 < parts[-1].largest_e_rho_m < 0.5


class ScriptedModule:
    """A module that says in which mode it is, and how far from its line, tick by tick."""

    script: Callable[[float], tuple[bool, int, float]] = staticmethod(
        lambda _t: (True, SOARING, 0.0)
    )
    made: list[ScriptedModule] = []  # noqa: RUF012 - of one test

    def __init__(self, _setup: Any, send: Any, now_s: float, options: Any) -> None:
        assert now_s == 0.0
        assert options.lockstep
        self.send = send
        self.output: Any = None
        self.frames: list[tuple[float, bytes]] = []
        self.counters = SimpleNamespace(ticks=11)
        self.session = SimpleNamespace(counters=SimpleNamespace(reboots=2, stale=3))
        self.decoder = SimpleNamespace(counters=SimpleNamespace(lost=5))
        ScriptedModule.made.append(self)

    def event(self, frame: bytes, now_s: float) -> None:
        self.frames.append((now_s, frame))
        active, mode, e_rho_m = self.script(now_s)
        if active and now_s > 0.5:
            self.send(overrides(*channels(1500, 1500, 1500)))
        line = SimpleNamespace(e_rho_m=e_rho_m)
        self.output = SimpleNamespace(active=active, mode=mode, line=line, time_s=now_s)


def flown(
    monkeypatch: pytest.MonkeyPatch, script: Any, duration_s: float = 2.4, **more: Any
) -> tuple[e.LongFlight, ScriptedModule]:
    ScriptedModule.made = []
    monkeypatch.setattr(ScriptedModule, "script", staticmethod(script))
    monkeypatch.setattr(e, "Onboard", ScriptedModule)
    flight = e.fly_long(duration_s, **more)
    return flight, ScriptedModule.made[0]


def number_of(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


def test_the_vehicle_says_all_that_it_would(monkeypatch: pytest.MonkeyPatch) -> None:
    flight, module = flown(monkeypatch, lambda _t: (False, SOARING, 0.0))
    kinds = [number_of(frame) for _, frame in module.frames]
    assert kinds.count(mavlink.MAVLINK_MSG_ID_HEARTBEAT) == 3  # one a second
    beats = [time_s for time_s, f in module.frames if number_of(f) == 0]
    assert beats == pytest.approx([0.005, 1.005, 2.005])
    assert kinds.count(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION) == flight.expected_ticks
    (set_,) = [(time_s, f) for time_s, f in module.frames if number_of(f) == 23]
    assert set_[0] == pytest.approx(2.0)  # then the operator engages
    assert b"OP_ENGAGE" in set_[1]
    # Each sender counts its frames from 0, and begins again after 255.
    for system in (1, 255):
        counted = [frame[4] for _, frame in module.frames if frame[5] == system]
        assert counted == [n % 256 for n in range(len(counted))]
    assert len(module.frames) > 256
    # Half of it before the wrap.
    stamps = [
        (time_s, struct.unpack_from("<I", frame, 10)[0])
        for time_s, frame in module.frames
        if number_of(frame) in (31, 32)
    ]
    before = [boot_ms for time_s, boot_ms in stamps if time_s < 1.19]
    after = [boot_ms for time_s, boot_ms in stamps if time_s > 1.4]
    assert min(before) > WRAP_MS - 1300
    assert max(after) < 1300
    assert (flight.ticks, flight.reboots, flight.stale, flight.lost) == (11, 2, 3, 5)
    assert flight.wrapped
    assert not flight.is_well


def test_a_module_that_disengages_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    flight, _ = flown(monkeypatch, lambda t: (t < 1.0, SOARING if t < 1.0 else RELEASED, 0.1))
    assert flight.ended == "released"
    assert not flight.wrapped
    assert flight.parts[-1].flown_s < 1.05
    assert not flight.is_well


def test_before_it_engages_nothing_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    flight, _ = flown(monkeypatch, lambda _t: (False, RELEASED, 9.0))
    assert flight.ended == ""
    assert len(flight.parts) == 24
    assert {each.largest_e_rho_m for each in flight.parts} == {0.0}


def test_what_is_hit_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    flight, _ = flown(monkeypatch, lambda _t: (True, SOARING, 0.0), duration_s=60.0)
    assert " at x " in flight.ended  # without control it leaves the air, or hits something
    assert flight.expected_ticks < 2000


def test_the_farthest_off_its_line_is_of_each_part_to_either_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def script(time_s: float) -> tuple[bool, int, float]:
        return True, SOARING, -0.3 if 0.9 < time_s <= 1.0 else 0.02

    flight, _ = flown(monkeypatch, script, duration_s=2.4)
    found = [each.largest_e_rho_m for each in flight.parts]
    assert found[9] == pytest.approx(0.3)
    assert max(found[:9] + found[11:]) == pytest.approx(0.02)
    assert inf not in found


def test_any_model_can_be_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def make_world(airframe: Any, site: Any, **wanted: Any) -> Any:
        asked.append((airframe, wanted))
        return make_any_world(airframe, site, **wanted)

    monkeypatch.setattr(e, "make_world", make_world)
    flown(monkeypatch, lambda _t: (False, SOARING, 0.0), 0.1, seed=4, model="point_mass")
    ((airframe, wanted),) = asked
    assert airframe.model_kind == "point_mass"
    assert (wanted["seed"], wanted["turbulence"]) == (4, 0.01)
    assert wanted["field"] is place().field
