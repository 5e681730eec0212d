"""A logged flight flown again: the same to the last bit, or by how much not."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from math import inf, nextafter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged_flight import AIRFRAME, METADATA, SITE, LoggedFlight, logs_in, recorded
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError, read_log
from tgl_soar.analysis.replay import compiled_ticks as compiled_ticks_module
from tgl_soar.analysis.replay.compiled_ticks import plain_ticks
from tgl_soar.analysis.replay.logged import Replay, ReplayError, read_by_laws, replay
from tgl_soar.analysis.replay.many import ReplayJob, replay_campaign, replay_many
from tgl_soar.analysis.replay.wire import read_wire, replay_wire, rms
from tgl_soar.autopilot import AutopilotState, initial_state, step
from tgl_soar.cli.app import app
from tgl_soar.config.files import ConfigError
from tgl_soar.config.parameters import INDEX, ParameterError, ParameterSet
from tgl_soar.control.laws import Laws
from tgl_soar.control.point_hold import HOLDS
from tgl_soar.onboard.flightlog.topics import (
    TOPICS,
    flattener,
    leaves_of,
    rebuilt,
    record_size,
)
from tgl_soar.onboard.flightlog.writer import BATCH_TICKS, FlightRecorder
from tgl_soar.sim.campaign.executors import InLine, LocalProcesses
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS
from tgl_soar.sim.campaign.manifest import read_manifest
from tgl_soar.sim.campaign.provenance import source_digest
from tgl_soar.sim.campaign.rows import read_rows
from tgl_soar.sim.compiled import available
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlOptions
from tgl_soar.types import Inputs

TICKS = 799
_VEHICLE = mavlink.MAVLink(None, 1, 1)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("replayed"))


@pytest.fixture(scope="module")
def log(path: Path) -> FlightLog:
    return read_log(path)


def is_the_same(result: Replay) -> bool:
    return result.differences == [] and result.notes == []


# --- bit for bit ------------------------------------------------------------------------------


def test_a_flight_replays_bit_for_bit(log: FlightLog) -> None:
    result = replay(log, workers=1)
    assert is_the_same(result)
    assert len(result.time_s) == TICKS
    assert result.left_out == 0
    assert result.logged["active"].sum() > 600  # it flew
    assert set(result.replayed) == {field.name for field in TOPICS["tick"].fields}


def test_stretches_side_by_side_replay_the_same(
    log: FlightLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tgl_soar.analysis.replay.logged.STRETCH", 300)
    alone, together = replay(log, workers=1), replay(log, workers=2)
    assert is_the_same(together)
    for name, column in alone.replayed.items():
        assert column.tobytes() == together.replayed[name].tobytes()


def test_the_loop_that_is_compiled_replays_the_same(
    log: FlightLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here in plain Python; what numba makes of `step` is tested where simulations use it."""
    monkeypatch.setattr("tgl_soar.analysis.replay.logged.compiled_ticks", plain_ticks)
    plain, kernel = replay(log, workers=1, compile=False), replay(log, compile=True)
    assert is_the_same(kernel)
    for name, column in plain.replayed.items():
        assert column.tobytes() == kernel.replayed[name].tobytes(), name
    changed = replay(log, changes={"RHO_P": 0.9}, compile=True)
    assert {"setpoints_pitch_rad", "soaring_p"} <= {d.name for d in changed.differences}


def test_where_a_compiled_kernel_differs_the_plain_laws_decide(
    log: FlightLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last bit of a sine, on a machine whose compiler has another."""

    def other_libm(laws: Laws, state: AutopilotState, inputs: Inputs) -> Any:
        state, output = step(laws, state, inputs)
        pitch = nextafter(output.vehicle.pitch_rad, inf)
        return state, output._replace(command=output.command._replace(elevator=pitch))

    monkeypatch.setattr(
        "tgl_soar.analysis.replay.logged.compiled_ticks", lambda: plain_ticks(other_libm)
    )
    result = replay(log, workers=1, compile=True)
    assert is_the_same(result)
    assert len(result.time_s) == TICKS


@pytest.mark.skipif(not available(), reason="numba is not installed")
def test_a_compiled_kernel_is_kept_by_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiled_ticks_module.folder.cache_clear()
    try:
        assert not compiled_ticks_module.is_ready()
        kept = compiled_ticks_module.folder()
        assert kept.parent == tmp_path / "tgl_soar"
        kept.mkdir(parents=True)
        (kept / "ticks.nbi").touch()
        assert compiled_ticks_module.is_ready()
        monkeypatch.setattr(compiled_ticks_module, "MODULES", ("tgl_soar.types",))
        compiled_ticks_module.folder.cache_clear()
        assert compiled_ticks_module.folder() != kept
        assert not compiled_ticks_module.is_ready()
    finally:
        compiled_ticks_module.folder.cache_clear()


def test_a_flight_between_real_processes_replays_bit_for_bit(tmp_path: Path) -> None:
    options = SitlOptions(airframe=AIRFRAME, site=SITE, out=tmp_path, legs=("a",), stay_s=2.0)
    fly(options, lambda _operator: None)
    (path,) = logs_in(tmp_path / "logs")
    log = read_log(path)
    assert log.losses == []
    result = replay(log)
    assert is_the_same(result)
    assert result.logged["active"].sum() > 400
    assert not replay_wire(path.with_suffix(".tlog"), AIRFRAME, SITE).missed


def test_a_flight_that_holds_a_point_replays_bit_for_bit(tmp_path: Path) -> None:
    with_brake = AIRFRAME.with_name("eclipson_c_spoilers.toml")
    texts = {"airframe": with_brake.read_text(), "site": SITE.read_text()}
    recorder = FlightRecorder(tmp_path, METADATA._replace(texts=texts), 0.0, patient=True)
    recorder.start()
    flight = LoggedFlight(
        recorder, airframe_path=with_brake, parameters={"TGL_HOLD": 1.0, "TGL_ALONG": -0.1}
    )
    flight.run(7.0)
    flight.set("TGL_ALONG", 0.05)
    flight.run(2.0)
    recorder.stop()
    result = replay(read_log(logs_in(tmp_path)[0]), workers=1)
    assert is_the_same(result)
    held = result.logged["point_standing"] == HOLDS
    assert held.sum() > 500
    assert np.ptp(result.logged["command_brake"][held]) > 0.1


def test_every_part_of_a_cut_log_replays_by_itself(tmp_path: Path) -> None:
    recorded(tmp_path, largest_bytes=2_000_000)
    parts = logs_in(tmp_path)
    assert len(parts) > 1
    results = [replay(read_log(part), workers=1) for part in parts]
    assert all(is_the_same(result) for result in results)
    assert sum(len(result.time_s) for result in results) == TICKS


@settings(max_examples=8, deadline=None)
@given(fraction=st.floats(0.2, 1.0))
def test_a_log_that_is_cut_off_replays_up_to_the_cut(path: Path, fraction: float) -> None:
    data = path.read_bytes()
    shorter = path.with_name("shorter.bin")
    shorter.write_bytes(data[: int(fraction * len(data))])
    log = read_log(shorter)
    result = replay(log, workers=1)
    assert is_the_same(result)
    assert len(result.time_s) == len(log.topics["tick"]["tick"])


def test_behind_a_gap_the_next_state_is_taken_up(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, patient=True)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.run(1.0)
    flight.onboard.load_shedding.value = 1.0
    flight.run(0.5)
    flight.onboard.load_shedding.value = 0.0
    flight.run(1.5)
    recorder.stop()
    result = replay(read_log(logs_in(tmp_path)[0]), workers=1)
    assert is_the_same(result)
    assert 0 < result.left_out <= BATCH_TICKS  # until a state is in the log again
    assert len(result.time_s) == 599 - 100 - result.left_out


def test_a_module_that_began_again_in_flight_replays_on(tmp_path: Path) -> None:
    """The simulator was restarted: the vehicle's clock goes back, all is reset."""
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, patient=True)
    recorder.start()
    first = LoggedFlight(recorder)
    first.run(2.5)
    second = LoggedFlight(FlightRecorder(tmp_path / "nowhere", METADATA, 0.0), seed=2)
    first.world = second.world
    first.run(1.0)
    recorder.stop()
    log = read_log(logs_in(tmp_path)[0])
    assert any("the clock goes back" in loss for loss in log.losses)
    result = replay(log, workers=1)
    assert is_the_same(result)
    assert result.left_out == 0


# --- what is not the same ---------------------------------------------------------------------


def test_one_changed_bit_is_found(path: Path, tmp_path: Path) -> None:
    """The smallest possible lie about an elevator command."""
    data = bytearray(path.read_bytes())
    head = struct.pack("<HBH", record_size("tick") - 3, ord("D"), 0)
    at = data.find(head, len(data) // 2)
    names = [field.name for field in TOPICS["tick"].fields]
    codes = [field.code for field in TOPICS["tick"].fields]
    before = struct.calcsize("<" + "".join(codes[: names.index("command_elevator")]))
    data[at + len(head) + before] ^= 1
    (tmp_path / "lie.ulg").write_bytes(data)
    (only,) = replay(read_log(tmp_path / "lie.ulg"), workers=1).differences
    assert only.name == "command_elevator"
    assert only.ticks == 1
    assert 0.0 < only.largest < 1e-15


def test_a_state_that_does_not_follow_is_reported(log: FlightLog) -> None:
    state = dict(log.topics["state"])
    state["line_x_m"] = state["line_x_m"] + np.where(state["tick"] > BATCH_TICKS, 1e-9, 0.0)
    result = replay(replace(log, topics={**log.topics, "state": state}), workers=1)
    assert any("the state after tick 408 is not the logged one" in note for note in result.notes)


def test_a_parameter_that_no_law_reads_is_refused(log: FlightLog) -> None:
    for name in ("OP_ENGAGE", "OP_GCS_S", "TEL_DIV"):
        if name in INDEX:
            with pytest.raises(ParameterError, match="no law reads it"):
                replay(log, changes={name: ParameterSet()[name]})
    assert {"RHO_P", "TGL_X", "AGE_POS_MAX", "FENCE_Z_MIN"} <= read_by_laws()


def test_another_gain_shows_what_would_have_been_commanded(log: FlightLog) -> None:
    result = replay(log, changes={"RHO_P": 0.9, "RHO_SPEED": 0.0})  # as it stands, unscheduled
    assert result.changed
    found = {d.name for d in result.differences}
    assert {"setpoints_pitch_rad", "command_elevator", "soaring_p"} <= found
    assert not found & {"vehicle_x_m", "health_position_age_s", "roll_rad"}
    p, e_rho = result.replayed["soaring_p"], result.replayed["e_rho_m"]
    flying = result.logged["active"] & (np.abs(e_rho) > 1e-3)
    assert p[flying] == pytest.approx(np.float32(0.9) * e_rho[flying], rel=1e-5)


def test_surfaces_that_obeyed_the_logged_commands_do_not_seem_dead(log: FlightLog) -> None:
    """They are read back, and another trim would have put them elsewhere."""
    tick = log.topics["tick"]
    rows = {name: tick[name] for name in ("timestamp", "tick", "time_s")} | {
        "sequence": tick["tick"]
    }
    moved = ("elevator", "aileron", "rudder", "brake")
    rows |= {name: np.roll(tick[f"command_{name}"], 1) for name in moved}
    result = replay(
        replace(log, topics={**log.topics, "surfaces": rows}), changes={"ELE_TRIM": -1.0}
    )
    logged, replayed = result.logged, result.replayed
    assert np.max(np.abs(logged["command_elevator"] - replayed["command_elevator"])) > 0.5
    assert np.array_equal(replayed["active"], logged["active"])
    assert any("surfaces obeyed" in note for note in result.notes)


def test_the_same_gain_given_again_changes_nothing(log: FlightLog) -> None:
    result = replay(log, changes={"RHO_P": log.parameters["RHO_P"]})
    assert result.differences == []


def test_another_airframe_brings_its_parameters(log: FlightLog, tmp_path: Path) -> None:
    text = AIRFRAME.read_text()
    assert "\nRHO_P = " in text
    line = next(line for line in text.splitlines() if line.startswith("RHO_P = "))
    other = tmp_path / "other.toml"
    other.write_text(text.replace(line, "RHO_P = 1.1"))
    result = replay(log, airframe=other)
    assert result.notes[-1] == f"of {other}: 1 parameters are others"
    same = replay(log, changes={"RHO_P": 1.1})
    assert result.replayed["soaring_p"].tobytes() == same.replayed["soaring_p"].tobytes()


def test_what_cannot_be_replayed_is_reported(log: FlightLog, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="no such parameter"):
        replay(log, changes={"NO_SUCH": 1.0})
    with pytest.raises(ParameterError, match="allowed"):
        replay(log, changes={"RHO_P": 1e9})
    with pytest.raises(ConfigError, match="missing"):
        replay(log, airframe=tmp_path / "missing.toml")
    with pytest.raises(ReplayError, match="not a log of tgl_soar"):
        replay(replace(log, info={"sys_name": "PX4"}))
    with pytest.raises(ReplayError, match="does not hold the site file"):
        replay(replace(log, texts={"airframe": ""}))
    with pytest.raises(ReplayError, match="no tick in it"):
        replay(replace(log, topics={}))
    attitude = {k: v for k, v in log.topics["attitude"].items() if k != "qz"}
    with pytest.raises(ReplayError, match="no qz in attitude"):
        replay(replace(log, topics={**log.topics, "attitude": attitude}))


def test_another_version_is_reported_and_replayed(log: FlightLog) -> None:
    tick = {k: v for k, v in log.topics["tick"].items() if k != "e_rho_rate_mps"}
    older = replace(log, info={**log.info, "ver_sw": "0.0.9"}, topics={**log.topics, "tick": tick})
    result = replay(older, workers=1)
    assert "flown with version 0.0.9" in result.notes[0]
    assert "not compared: e_rho_rate_mps" in result.notes[1]
    assert result.differences == []


def test_a_state_goes_through_numbers_and_back() -> None:
    state = initial_state()
    numbers = flattener(tuple(leaves_of(AutopilotState)))(state)
    assert len(numbers) == len(TOPICS["state"].leaves)
    back = rebuilt(AutopilotState, iter(numbers))
    assert repr(back) == repr(state)


# --- from the wire ----------------------------------------------------------------------------


def test_the_wire_replays_as_far_as_it_tells(path: Path, log: FlightLog) -> None:
    """In simulation faster than real time: each attitude is a tick, and the same comes of it."""
    result = replay_wire(path.with_suffix(".tlog"), AIRFRAME, SITE)
    assert "not bit for bit" in result.notes[0]
    assert any("a tick each attitude" in note for note in result.notes)
    assert len(result.outputs) == TICKS
    elevator = result.column("command.elevator")
    assert elevator == pytest.approx(log.topics["tick"]["command_elevator"], abs=0.02)
    assert rms(result.compared["soar_x"]) < 1e-6
    assert rms(result.compared["pitch_sp"]) < 0.2  # degrees
    assert len(result.compared["e_rho"]) > 10


def test_the_wire_replays_with_another_gain(path: Path) -> None:
    wire = path.with_suffix(".tlog")
    changed = replay_wire(wire, AIRFRAME, SITE, {"RHO_P": 0.42})
    assert rms(changed.compared["pitch_sp"]) > 2.0 * rms(
        replay_wire(wire, AIRFRAME, SITE).compared["pitch_sp"]
    )


@settings(max_examples=25, deadline=None)
@given(at=st.floats(0.0, 1.0), garbage=st.binary(max_size=100))
def test_a_damaged_wire_gives_its_whole_frames(path: Path, at: float, garbage: bytes) -> None:
    data = path.with_suffix(".tlog").read_bytes()[:8_000]
    frames, _ = read_wire(_written(path, data))
    place = int(at * len(data))
    found, losses = read_wire(_written(path, data[:place] + garbage + data[place:]))
    assert len(found) >= len(frames) - 3
    assert all(loss for loss in losses)


def test_a_wire_that_begins_in_flight_flies(path: Path, tmp_path: Path) -> None:
    """A ground station that was started late: it does not hold the module's engagement."""
    frames, _ = read_wire(path.with_suffix(".tlog"))
    late = [frame for frame in frames if frame.unix_us > frames[len(frames) // 2].unix_us]
    whole = b"".join(f.unix_us.to_bytes(8, "big") + f.data for f in late)
    (tmp_path / "late.tlog").write_bytes(whole)
    result = replay_wire(tmp_path / "late.tlog", AIRFRAME, SITE)
    assert any("it flies when first received" in note for note in result.notes)
    assert result.outputs[-1].active
    assert not result.missed


@pytest.mark.parametrize("stood_s", [0.0, 0.4])
def test_a_vehicle_s_clock_that_stood_is_not_followed(
    path: Path, tmp_path: Path, stood_s: float
) -> None:
    """A simulation in real time whose computer stopped for a moment: no attitude is late."""
    frames, _ = read_wire(path.with_suffix(".tlog"))
    decoder = mavlink.MAVLink(None)
    wire, at_us = b"", 1_700_000_000_000_000
    for i, frame in enumerate(frames):
        message = decoder.decode(bytearray(frame.data))
        if message.get_type() == "ATTITUDE_QUATERNION":
            stood = i > len(frames) // 2
            at_us = 1_700_000_000_000_000 + message.time_boot_ms * 1000
            at_us += round(stood_s * 1e6) if stood else 0
        wire += at_us.to_bytes(8, "big") + frame.data
    (tmp_path / "paced.tlog").write_bytes(wire)
    result = replay_wire(tmp_path / "paced.tlog", AIRFRAME, SITE)
    assert any("a tick each attitude" in note for note in result.notes) == (stood_s > 0.0)
    flown = result.column("active")
    assert flown.sum() > 600
    assert flown[-1]


def test_a_wire_that_lacks_what_the_flight_needs_is_reported(
    path: Path, tmp_path: Path, tgl_soar: Callable[..., Ran]
) -> None:
    """Without positions nothing engages."""
    kept = [
        frame
        for frame in read_wire(path.with_suffix(".tlog"))[0]
        if frame.data[7:10] != (32).to_bytes(3, "little")
    ]
    file = tmp_path / "blind.tlog"
    file.write_bytes(b"".join(f.unix_us.to_bytes(8, "big") + f.data for f in kept))
    result = replay_wire(file, AIRFRAME, SITE)
    assert result.missed
    assert "does not in the replay" in result.notes[-1]
    run = tgl_soar("replay", file)
    assert run.returncode == 1


def _written(path: Path, data: bytes) -> Path:
    damaged = path.with_name("damaged.tlog")
    damaged.write_bytes(data)
    return damaged


def test_a_file_that_is_no_wire_is_reported(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_wire(tmp_path / "missing.tlog")
    (tmp_path / "x.tlog").write_bytes(b"")
    with pytest.raises(LogError, match="empty"):
        read_wire(tmp_path / "x.tlog")
    (tmp_path / "x.tlog").write_bytes(bytes(1000))
    with pytest.raises(LogError, match=r"not a \.tlog"):
        read_wire(tmp_path / "x.tlog")


# --- the commands -----------------------------------------------------------------------------


class Ran(NamedTuple):
    """How a command ended and what it printed."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def tgl_soar(capfd: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """The command in this process; what libraries print past Python is captured, too."""

    def run(*arguments: object) -> Ran:
        with pytest.raises(SystemExit) as ended:
            app([str(argument) for argument in arguments])
        code = ended.value.code or 0
        assert isinstance(code, int)
        return Ran(code, *capfd.readouterr())

    return run


def test_the_command_tells_that_all_is_the_same_and_what_would_differ(
    path: Path, tmp_path: Path, tgl_soar: Callable[..., Ran]
) -> None:
    run = tgl_soar("replay", path)
    assert run.returncode == 0, run.stderr
    assert "every command is the same, bit for bit" in run.stdout
    figure = tmp_path / "figure.png"
    run = tgl_soar("replay", path, "--param", "rho_p=0.9", "--figure", figure)
    assert run.returncode == 0, run.stderr
    assert "does not answer" in run.stdout
    assert figure.stat().st_size > 10_000


def test_what_was_lost_shows_in_the_exit_code(
    path: Path, tmp_path: Path, tgl_soar: Callable[..., Ran]
) -> None:
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(path.read_bytes()[:-7])
    assert tgl_soar("log", "info", cut).returncode == 1
    assert tgl_soar("replay", cut).returncode == 1
    assert tgl_soar("log", "info", path).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("log", "info", "{wire}"), "tgl-soar report"),
        (("log", "info", "{head}"), "no row of any topic"),
        (("log", "export", "{log}", "--to", "netcdf", "--out", "/proc/x.nc"), "No such file"),
        (("replay", "{random}"), "not one MAVLink frame with a right checksum"),
        (("replay", "{beats}"), "no tick could be run"),
        (("replay", "{x}"), "not a ULog"),
        (("replay", "{log}", "--param", "RHO_P"), "must be NAME=VALUE"),
        (("log", "info", "{x}"), "not a ULog"),
        (("log", "export", "{log}", "--to", "xls"), "must be csv, netcdf, mcap"),
    ],
)
def test_what_is_wrong_is_reported_without_a_traceback(
    path: Path,
    tmp_path: Path,
    arguments: tuple[str, ...],
    why: str,
    tgl_soar: Callable[..., Ran],
) -> None:
    (tmp_path / "x.ulg").write_bytes(b"no log at all, but long enough")
    (tmp_path / "head.ulg").write_bytes(path.read_bytes()[:16])
    (tmp_path / "random.tlog").write_bytes(random.Random(0).randbytes(100_000))
    beat = bytes(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3).pack(_VEHICLE))
    (tmp_path / "beats.tlog").write_bytes((bytes(8) + beat) * 3)
    files = {name.stem: name for name in tmp_path.iterdir()}
    wire = path.with_suffix(".tlog")
    run = tgl_soar(*(a.format(log=path, wire=wire, **files) for a in arguments))
    assert run.returncode == 2
    assert why in run.stderr
    assert "synchronously" not in run.stderr  # HDF5's words
    assert "Traceback" not in run.stderr


def test_several_logs_are_a_line_each(path: Path, tmp_path: Path) -> None:
    (damaged := tmp_path / "damaged.ulg").write_bytes(b"no log")
    jobs = [
        ReplayJob(path),
        ReplayJob(damaged),
        ReplayJob(path, (("RHO_P", 0.9), ("RHO_SPEED", 0.0))),
    ]
    results = [replay_many(jobs, executor) for executor in (InLine(), LocalProcesses(2))]
    assert results[0] == results[1]  # in every bit, however long it took
    for same, unread, changed in results:
        assert (same.ticks, same.differing, same.error) == (TICKS, (), "")
        assert str(damaged) in unread.error
        assert changed.differing
    run = CliRunner()
    well = run.invoke(app, ["replay", str(path), str(path), "--workers", "1"])
    assert well.exit_code == 0, well.output
    assert run.invoke(app, ["replay", str(path), str(damaged)]).exit_code == 1
    refused = run.invoke(app, ["replay", str(path), str(path), "--compile"])
    assert "one log at a time with --compile: 2 are named" in refused.stderr


def test_a_table_of_logs_says_where_it_comes_from(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped, gone on with, refused where a log is no longer what it was."""
    pytest.importorskip("pyarrow")
    (again := tmp_path / "again.ulg").write_bytes(path.read_bytes())
    (damaged := tmp_path / "damaged.ulg").write_bytes(b"no log")
    logs, out, run = (path, again, damaged), tmp_path / "out", CliRunner()
    words = ["replay", *map(str, logs), "--param", "RHO_P=0.9", "--out", str(out)]

    def stopped_at_the_second(log: Path) -> FlightLog:
        if log == again:
            raise KeyboardInterrupt
        return read_log(log)

    monkeypatch.setattr("tgl_soar.cli.replay.executor_of", lambda *_: InLine())
    with monkeypatch.context() as context:
        context.setattr("tgl_soar.analysis.replay.many.read_log", stopped_at_the_second)
        stopped = run.invoke(app, words)
    assert stopped.exit_code == 130
    assert "1 of 3 flights are kept; --resume goes on" in stopped.stderr
    damaged.write_bytes(b"not the same")
    refused = run.invoke(app, [*words, "--resume"])
    assert refused.exit_code == 2
    assert "of another campaign" in refused.stderr
    damaged.write_bytes(b"no log")
    done = run.invoke(app, [*words, "--resume"], env={"COLUMNS": "300"})
    assert done.exit_code == 1  # one cannot be read
    assert f"logs in {out / ROWS}" in done.stdout
    assert not (out / JOURNAL).exists()

    digests = [sha256(log.read_bytes()).hexdigest() for log in logs]
    rows = list(read_rows(out / ROWS))
    assert [row["log"] for row in rows] == [str(log) for log in logs]
    assert [row["sha256"] for row in rows] == digests
    assert [row["ticks"] for row in rows] == [TICKS, TICKS, 0]
    assert [row["duration_s"] for row in rows] == pytest.approx([(TICKS - 1) / 200.0] * 2 + [0.0])
    assert "setpoints_pitch_rad" in rows[0]["differing"]
    assert "not a ULog" in rows[2]["error"]
    manifest = read_manifest(out / MANIFEST)
    assert manifest is not None
    assert manifest.complete
    assert [entry["log"] for entry in manifest.parameters["logs"]] == [str(log) for log in logs]
    assert [entry["sha256"] for entry in manifest.parameters["logs"]] == digests
    assert manifest.parameters["changes"] == {"RHO_P": 0.9}
    assert [each["from"] for each in manifest.runs] == [0, 1]
    assert manifest.source == source_digest()


def test_a_table_is_of_the_airframe_that_it_was_replayed_with(path: Path, tmp_path: Path) -> None:
    """The file's text, not its name alone; of a log that is not there nothing is known."""
    airframe, gone = tmp_path / "a.toml", tmp_path / "gone.ulg"
    found = []
    for text in ("one", "another"):
        airframe.write_text(text)
        found.append(replay_campaign([path, gone], (), airframe).parameters)
    assert found[0]["airframe"] == found[1]["airframe"] == str(airframe)
    assert found[0] != found[1]
    assert found[0]["logs"][1] == {"log": str(gone), "sha256": ""}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--resume",), "--resume goes with --out"),
        (("--restart",), "--restart goes with --out"),
        (("--out", "out", "--figure", "f.png"), "--figure goes with one log, and without --out"),
        (("--out", "out", "--resume"), "no flights of an earlier run are in out"),
    ],
)
def test_what_a_table_goes_without_is_reported(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = CliRunner().invoke(app, ["replay", str(path), *options])
    assert refused.exit_code == 2
    assert says in refused.stderr
    assert not list(tmp_path.iterdir())
