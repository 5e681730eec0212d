"""What of a `.tlog` is a frame, whether its clocks run alike, and what is set again from it."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, nan, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.analysis.replay.wire import (
    TlogFrame,
    WireFlight,
    _Again,
    _arrivals,
    _decoded,
    _first_values,
    _keeps_pace,
    read_wire,
    replay_wire,
    rms,
)
from tgl_soar.config.files import shipped
from tgl_soar.config.parameters import ParameterError
from tgl_soar.control import supervisor as modes
from tgl_soar.onboard.telemetry_values import FAST

BEGIN_US = 1_700_000_000_000_000
VEHICLE, OWN, OPERATOR = (1, 1), (1, 191), 250
UNKNOWN = 0x0FFFF0  # a message that no dialect has


def framed(message: Any, source: tuple[int, int] = VEHICLE) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, *source)))


def attitude(boot_ms: int, system: int = 1) -> bytes:
    numbers = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return framed(mavlink.MAVLink_attitude_quaternion_message(boot_ms, *numbers), (system, 1))


def param_value(name: str, value: float, source: tuple[int, int] = OWN) -> bytes:
    message = mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)
    return framed(message, source)


def param_set(name: str, value: float, target: tuple[int, int] = OWN) -> bytes:
    message = mavlink.MAVLink_param_set_message(*target, name.encode(), value, 9)
    return framed(message, (OPERATOR, 190))


def unknown(size: int, signed: bool = False) -> bytes:
    head = bytes((0xFD, size, int(signed), 0, 0, 1, 1)) + UNKNOWN.to_bytes(3, "little")
    return head + bytes(size + 2 + 13 * signed)


def stamped(frames: Sequence[bytes], step_us: int = 10_000) -> bytes:
    return b"".join(
        (BEGIN_US + n * step_us).to_bytes(8, "big") + each for n, each in enumerate(frames)
    )


def read(folder: Path, data: bytes) -> tuple[list[TlogFrame], list[str]]:
    path = folder / "made.tlog"
    path.write_bytes(data)
    return read_wire(path)


def decoded(frames: Sequence[bytes]) -> list[tuple[TlogFrame, Any]]:
    return list(_decoded([TlogFrame(BEGIN_US, each) for each in frames]))


# --- frames -------------------------------------------------------------------------------------


def test_frames_are_read_with_their_stamps(tmp_path: Path) -> None:
    sent = [attitude(n) for n in range(3)]
    frames, losses = read(tmp_path, stamped(sent, 2_500))
    assert frames == [TlogFrame(BEGIN_US + 2_500 * n, each) for n, each in enumerate(sent)]
    assert losses == []


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("size", [0, 7, 255])
def test_a_frame_that_nobody_knows_is_one_where_another_follows_it(
    tmp_path: Path, size: int, signed: bool
) -> None:
    sent = [attitude(1), unknown(size, signed), attitude(2)]
    frames, losses = read(tmp_path, stamped(sent))
    assert [frame.data for frame in frames] == sent
    assert losses == []
    # At the end, too; cut off it is none.
    frames, losses = read(tmp_path, stamped(sent[:2]))
    assert [frame.data for frame in frames] == sent[:2]
    frames, losses = read(tmp_path, stamped(sent[:2])[:-1])
    assert [frame.data for frame in frames] == sent[:1]
    assert losses == [f"{8 + len(sent[1]) - 1} bytes are no frame with a time stamp"]


def test_a_first_version_frame_that_nobody_knows_has_eight_bytes_more_than_its_payload(
    tmp_path: Path,
) -> None:
    number = next(n for n in range(255, 0, -1) if n not in mavlink.mavlink_map)
    old = bytes((0xFE, 5, 0, 1, 1, number)) + bytes(5 + 2)
    sent = [attitude(1), old, attitude(2)]
    frames, losses = read(tmp_path, stamped(sent))
    assert [frame.data for frame in frames] == sent
    assert losses == []


def test_a_frame_with_a_wrong_checksum_is_left_out_and_counted(tmp_path: Path) -> None:
    broken = bytearray(attitude(2))
    broken[-1] ^= 0xFF
    sent = [attitude(1), bytes(broken), attitude(3)]
    frames, losses = read(tmp_path, stamped(sent))
    assert [frame.data for frame in frames] == [sent[0], sent[2]]
    assert losses == [f"{8 + len(broken)} bytes are no frame with a time stamp"]


def test_damage_between_frames_costs_its_own_bytes(tmp_path: Path) -> None:
    one, other = stamped([attitude(1)]), stamped([attitude(2)])
    frames, losses = read(tmp_path, one + b"abc" + other)
    assert len(frames) == 2
    assert losses == ["3 bytes are no frame with a time stamp"]


def test_a_recorders_clock_that_goes_back_is_reported(tmp_path: Path) -> None:
    stamps = [5, 6, 2, 3, 3, 1]
    data = b"".join(n.to_bytes(8, "big") + attitude(n) for n in stamps)
    assert read(tmp_path, data)[1] == ["the recorder's clock goes back 2 times"]


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"made\.tlog: empty: nothing was recorded"):
        read(tmp_path, b"")
    with pytest.raises(LogError, match="not one MAVLink frame with a right checksum"):
        read(tmp_path, b"x" * 400)
    with pytest.raises(LogError, match="not one MAVLink frame with a right checksum"):
        read(tmp_path, stamped([unknown(3), unknown(4)]))
    with pytest.raises(LogError, match=r"missing\.tlog: cannot be read"):
        read_wire(tmp_path / "missing.tlog")


# --- times --------------------------------------------------------------------------------------


def test_silences_and_leaps_of_the_recorders_clock_take_no_time() -> None:
    steps_us = [10_000, 5_000_000, 5_000_001, -1, 0, 20_000]
    stamps = [BEGIN_US]
    for step in steps_us:
        stamps.append(stamps[-1] + step)
    found = _arrivals([TlogFrame(stamp, b"") for stamp in stamps])
    assert found == pytest.approx([0.0, 0.01, 5.01, 5.01, 5.01, 5.01, 5.03])


def paced(times_s: Sequence[float], stamps_s: Sequence[float], system: int = 1) -> bool:
    frames = decoded([attitude(round(1e3 * stamp), system) for stamp in stamps_s])
    return _keeps_pace(frames, list(times_s), 1)


@pytest.mark.parametrize(("faster", "keeps"), [(1.0, True), (1.09, True), (1.11, False)])
def test_a_clock_that_differs_by_a_tenth_does_not_keep_pace(faster: float, keeps: bool) -> None:
    times = [0.05 * n for n in range(100)]
    assert paced(times, [3.0 + faster * t for t in times]) == keeps


@pytest.mark.parametrize(("slower", "keeps"), [(0.91, True), (0.89, False)])
def test_a_clock_that_is_a_tenth_slower_does_not_keep_pace(slower: float, keeps: bool) -> None:
    """In less than a second, of which no frame is a tenth late."""
    times = [0.05 * n for n in range(19)]
    assert paced(times, [3.0 + slower * t for t in times]) == keeps


def test_a_clock_that_runs_twice_as_slowly_does_not_keep_pace() -> None:
    times = [0.05 * n for n in range(100)]
    assert not paced(times, [0.5 * t for t in times])


@pytest.mark.parametrize(("late_s", "lasts_s", "keeps"), [
    (0.15, 0.4, True), (0.15, 0.7, False), (0.05, 5.0, True),
])  # fmt: skip
def test_frames_that_are_all_late_for_half_a_second_come_from_a_clock_that_stood(
    late_s: float, lasts_s: float, keeps: bool
) -> None:
    times = [0.02 * n for n in range(500)]
    late = [late_s if 4.0 < t <= 4.0 + lasts_s else 0.0 for t in times]
    assert paced(times, [1.0 + t - off for t, off in zip(times, late, strict=True)]) == keeps


def test_only_the_vehicles_own_attitudes_tell_and_one_alone_tells_nothing() -> None:
    times = [0.05 * n for n in range(100)]
    assert paced(times, [0.0 * t for t in times], system=2)
    assert paced([0.0], [7.0])
    others = decoded([param_value("TGL_X", 1.0)] * 100)
    assert _keeps_pace(others, times, 1)


# --- values -------------------------------------------------------------------------------------


def test_the_first_value_that_the_module_reported_counts_unless_it_was_set_before() -> None:
    frames = [
        param_value("TGL_X", 1.0, VEHICLE),  # the autopilot's own
        param_value("TGL_X", 1.0, (1, 192)),
        param_value("TGL_X", 2.0),
        param_value("TGL_X", 3.0),
        param_set("TGL_Z", 4.0),
        param_value("TGL_Z", 4.0),
        param_set("TGL_LEAN", 4.0, VEHICLE),  # not to the module
        param_value("TGL_LEAN", 12.0),
        param_value("OP_ENGAGE", 1.0),
        param_value("TGL_STAGE", 1.0),
        param_value("UNKNOWN", 1.0),
        unknown(4),
    ]
    assert _first_values(decoded(frames), OWN) == {"TGL_X": 2.0, "TGL_LEAN": 12.0}


def test_what_pymavlink_makes_nothing_of_has_no_message() -> None:
    broken = bytearray(attitude(8))
    broken[-1] ^= 0xFF
    found = decoded([attitude(7), bytes(broken), attitude(9)])
    assert [message is None for _, message in found] == [False, True, False]
    assert found[0][1].time_boot_ms == 7


def test_the_difference_is_over_what_is_known_both_then_and_now() -> None:
    rows = [WireFlight(0.0, 3.0, 0.0), WireFlight(0.1, nan, 1.0), WireFlight(0.2, -1.0, 3.0)]
    assert rms(rows) == pytest.approx(sqrt((9.0 + 16.0) / 2.0))
    assert isnan(rms([]))
    assert isnan(rms([WireFlight(0.0, 1.0, nan)]))


# --- again --------------------------------------------------------------------------------------


class Aboard:
    """A module that does nothing with what it is sent."""

    def __init__(self, **values: float) -> None:
        self.parameters = SimpleNamespace(values=values)
        self.output: Any = None
        self.events: list[tuple[bytes, float]] = []

    def event(self, data: bytes, now_s: float) -> None:
        self.events.append((data, now_s))

    def was_set(self) -> list[tuple[str, float]]:
        decoder = mavlink.MAVLink(None)
        found = [decoder.decode(bytearray(data)) for data, _ in self.events]
        assert all((m.target_system, m.target_component) == OWN for m in found)
        assert all((m.get_srcSystem(), m.get_srcComponent()) == (OPERATOR, 190) for m in found)
        return [(m.param_id, m.param_value) for m in found]


def again(aboard: Aboard, *frames: bytes, changes: dict[str, float] | None = None) -> _Again:
    onboard: Any = aboard
    made = _Again(onboard, OWN, OPERATOR, changes or {})
    for n, (frame, message) in enumerate(decoded(frames)):
        made.take(frame, message, 0.5 * (n + 1))
    return made


def reported(name: str, value: float) -> bytes:
    return framed(mavlink.MAVLink_named_value_float_message(0, name.encode(), value), OWN)


def test_the_autopilots_frames_go_through_the_module_again() -> None:
    aboard = Aboard()
    sent = [attitude(1), attitude(2, system=2), unknown(3), attitude(3)]
    made = again(aboard, *sent)
    assert aboard.events == [(sent[0], 0.5), (sent[3], 2.0)]
    assert made.now_s == 2.0


def test_a_parameter_is_set_again_when_it_was_reported_and_stands_otherwise() -> None:
    aboard = Aboard(TGL_X=1.0, TGL_Z=2.0, RHO_P=0.5)
    frames = [
        param_value("TGL_X", 1.0),  # as it stands
        param_value("TGL_Z", 3.0),
        param_value("RHO_P", 0.7),  # changed on purpose
        param_value("UNKNOWN", 0.7),
        param_value("TGL_X", nan),
        param_value("TGL_X", 5.0, VEHICLE),
    ]
    again(aboard, *frames[:5], changes={"RHO_P": 0.6})
    assert aboard.was_set() == [("TGL_Z", 3.0)]


@pytest.mark.parametrize(
    ("stands", "shown", "sets"),
    [(0.0, 2.0, [1.0]), (2.0, 1.0, []), (1.0, 2.0, []), (2.0, 0.0, [0.0]), (0.0, 0.0, [])],
)
def test_engaged_is_shown_as_two_and_set_as_one(
    stands: float, shown: float, sets: list[float]
) -> None:
    aboard = Aboard(OP_ENGAGE=stands)
    again(aboard, param_value("OP_ENGAGE", shown))
    assert aboard.was_set() == [("OP_ENGAGE", value) for value in sets]


def test_a_recording_that_begins_in_flight_engages_until_it_flies_and_says_so_once() -> None:
    aboard = Aboard(OP_ENGAGE=0.0)
    soaring = reported("soar_mode", float(modes.SOARING))
    made = again(aboard, reported("soar_mode", float(modes.READY)), reported("soar_mode", nan))
    assert not made.was_flying
    assert aboard.was_set() == []
    made = again(aboard, soaring, soaring)
    assert made.was_flying
    assert aboard.was_set() == [("OP_ENGAGE", 1.0)] * 2
    assert made.notes == []


def test_who_was_engaged_in_the_recording_is_not_engaged_again() -> None:
    aboard = Aboard(OP_ENGAGE=1.0)
    made = again(aboard, param_value("OP_ENGAGE", 2.0), reported("soar_mode", float(modes.SOARING)))
    assert made.was_flying
    assert aboard.was_set() == []
    assert made.notes == []


def test_numbers_of_the_telemetry_are_compared_with_those_of_now(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "tgl_soar.analysis.replay.wire.fast_value", lambda output, n: (output.number, n)
    )
    aboard = Aboard(OP_ENGAGE=1.0)
    name = FAST[2]
    assert again(aboard, reported(name, 3.0)).compared[name] == []  # there is no output yet
    aboard.output = SimpleNamespace(number=7.0, active=True)
    made = again(aboard, reported("other", 1.0), reported(name, 3.0))
    (compared,) = made.compared[name]
    replayed: Any = compared.replayed
    assert (compared.time_s, compared.reported, replayed) == (1.0, 3.0, (7.0, 2))
    assert set(made.compared) == set(FAST)
    flying = again(aboard, reported("soar_mode", float(modes.SOARING)))
    assert flying.notes == ["it flies when first received: engaged before 0.5 s"]
    assert aboard.was_set() == []


# --- the whole of it ----------------------------------------------------------------------------

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
FROM_THE_WIRE = "replayed from the wire: not bit for bit, the module may have received more"
NO_PARAMETERS = "it said no parameters: those of the files are used"
OWN_PACE = "the vehicle's clock did not run with the recorder's: a tick each attitude"


def written(folder: Path, frames: Sequence[bytes], step_us: int = 5_000) -> Path:
    path = folder / "made.tlog"
    path.write_bytes(stamped(frames, step_us))
    return path


def test_where_the_clocks_run_alike_the_module_keeps_its_own_ticks(tmp_path: Path) -> None:
    """Attitudes each 20 ms for a second: 200 ticks of 5 ms, and each takes the newest of them."""
    path = written(tmp_path, [attitude(20 * n) for n in range(51)], 20_000)
    found = replay_wire(path, AIRFRAME, SITE)
    assert found.notes == [FROM_THE_WIRE, NO_PARAMETERS]
    assert (found.losses, found.missed) == ([], False)
    assert found.seconds == pytest.approx(1.0)
    assert 198 <= len(found.outputs) == len(found.inputs) <= 203
    steps = [b.time_s - a.time_s for a, b in zip(found.inputs, found.inputs[1:], strict=False)]
    assert sorted(steps)[len(steps) // 2] == pytest.approx(0.005, abs=1e-6)
    assert found.column("health.attitude_age_s")[100:].max() < 0.1
    assert list(found.column("mode")) == [output.mode for output in found.outputs]
    assert found.took_s > 0.0


def test_where_they_do_not_each_attitude_is_a_tick(tmp_path: Path) -> None:
    """Recorded three times as fast as the vehicle's clock ran."""
    path = written(tmp_path, [attitude(15 * n) for n in range(60)])
    found = replay_wire(path, AIRFRAME, SITE)
    assert found.notes == [FROM_THE_WIRE, NO_PARAMETERS, OWN_PACE]
    assert 55 <= len(found.outputs) <= 60


def test_a_recorded_flight_that_cannot_be_flown_again_is_missed(tmp_path: Path) -> None:
    soaring = reported("soar_mode", float(modes.SOARING))
    frames = [attitude(5 * n) if n % 10 else soaring for n in range(60)]
    found = replay_wire(written(tmp_path, frames), AIRFRAME, SITE)
    assert found.missed
    assert found.notes[-1].startswith("it flew, and does not in the replay: what it needs")
    # By then there was an output to compare with: not at the first frame of all.
    rows = found.compared["soar_mode"]
    assert 4 <= len(rows) <= 6
    assert all(row.reported == modes.SOARING for row in rows)


def test_what_the_module_reported_is_flown_with_unless_it_is_out_of_range(tmp_path: Path) -> None:
    attitudes = [attitude(5 * n) for n in range(1, 20)]
    replayed = replay_wire(
        written(tmp_path, [param_value("TGL_X", 0.25), *attitudes]), AIRFRAME, SITE
    )
    assert replayed.notes == [FROM_THE_WIRE]
    broken = [param_value("TGL_X", 1e9), *attitudes]
    refused = replay_wire(written(tmp_path, broken), AIRFRAME, SITE)
    assert any(
        note.startswith("TGL_X") and note.endswith(": the values of the files are used")
        for note in refused.notes
    )


def test_a_change_that_is_out_of_range_is_an_error(tmp_path: Path) -> None:
    path = written(tmp_path, [attitude(5 * n) for n in range(3)])
    with pytest.raises(ParameterError, match="RHO_P"):
        replay_wire(path, AIRFRAME, SITE, {"RHO_P": 1e9})


def test_damage_is_among_the_notes(tmp_path: Path) -> None:
    path = written(tmp_path, [attitude(5 * n) for n in range(5)])
    path.write_bytes(path.read_bytes() + b"abc")
    found = replay_wire(path, AIRFRAME, SITE)
    assert found.losses == ["3 bytes are no frame with a time stamp"]
    assert found.notes[:2] == [FROM_THE_WIRE, *found.losses]
