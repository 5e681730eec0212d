"""Faults in the bridge: on what the autopilot reports, on datagrams, and on the autopilot."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.sim.bridge.process import main
from tgl_soar.sim.faults import CATALOGUE, parse_fault
from tgl_soar.sim.routing import RoutedFrame, split_frames
from tgl_soar.sim.simulation import Options, Simulation
from tgl_soar.sim.sitl import fly, passed
from tgl_soar.sim.sitl_options import SitlOptions
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
COMPANION = 1

Inbound = list[tuple[float, RoutedFrame]]
MakeSimulation = Callable[..., Simulation]


@pytest.fixture
def simulation() -> Iterator[MakeSimulation]:
    made: list[Simulation] = []

    def make(*faults: str) -> Simulation:
        options = Options(faults=tuple(parse_fault(text) for text in faults), truth=False)
        made.append(
            Simulation(
                load_airframe(AIRFRAME_PATH), load_site(SITE_PATH), options, SITE_PATH.parent
            )
        )
        made[-1].add_link(COMPANION, ground=False)
        return made[-1]

    yield make
    for each in made:
        each.close()


def listened(simulation: Simulation, seconds: float, *also: tuple[int, float]) -> Inbound:
    """What a companion receives that has asked for attitude at 200 Hz and position at 50 Hz.

    also: further messages and their rates.
    """
    asking, decoder = mavlink.MAVLink(None, 1, 191), mavlink.MAVLink(None)
    simulation.receive(COMPANION, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(asking))
    for message_id, rate_hz in ((31, 200.0), (32, 50.0), *also):
        request = mavlink.MAVLink_command_long_message(
            1, 1, 511, 0, message_id, 1e6 / rate_hz, 0, 0, 0, 0, 0
        )
        simulation.receive(COMPANION, request.pack(asking))
    received: Inbound = []
    for _ in range(round(seconds * 200)):
        simulation.step()
        for _, data in simulation.take_datagrams():
            received += [(simulation.time_s, frame) for frame in split_frames(decoder, data)[0]]
    return received


def kinds(received: Inbound, begin_s: float, end_s: float) -> set[str]:
    return {frame.message.get_type() for t, frame in received if begin_s <= t < end_s}


def test_a_lost_position_is_not_streamed_and_the_attitude_is(simulation: MakeSimulation) -> None:
    received = listened(simulation("position.dropout start=1 for=0.5"), 2.0)
    assert "LOCAL_POSITION_NED" in kinds(received, 0.5, 1.0)
    assert kinds(received, 1.1, 1.5) - {"HEARTBEAT"} == {"ATTITUDE_QUATERNION"}
    assert "LOCAL_POSITION_NED" in kinds(received, 1.5, 2.0)


def test_the_autopilot_itself_flies_by_the_true_attitude(simulation: MakeSimulation) -> None:
    flown = simulation("attitude.bias start=0 for=9 roll=40 pitch=0 heading=0")
    flown.world.held = False
    flown.pixhawk.set_mode(FBWA, "test")
    received = listened(flown, 2.0)
    reported = [f.message.q2 for _, f in received if f.message.get_type() == "ATTITUDE_QUATERNION"]
    assert reported[-1] > 0.25  # half of 40 degrees, less what the aircraft banks
    assert abs(flown.world.truth.roll_rad) < 0.1


def test_a_reboot_is_silence_then_a_new_clock_without_memory(simulation: MakeSimulation) -> None:
    rebooted = simulation("autopilot.reboot start=1 for=0.5")
    received = listened(rebooted, 2.0)
    assert kinds(received, 1.01, 1.5) == set()
    assert kinds(received, 1.5, 2.1) == {"HEARTBEAT"}  # they were not asked for again
    assert rebooted.pixhawk.boot_ms == 500
    assert rebooted.pixhawk.mode == MANUAL


def test_lockstep_goes_on_while_the_autopilot_restarts(simulation: MakeSimulation) -> None:
    rebooted = simulation("autopilot.reboot start=0.5 for=5")
    listened(rebooted, 1.0)
    answer = mavlink.MAVLink_timesync_message(1, 77).pack(mavlink.MAVLink(None, 1, 191))
    rebooted.receive(COMPANION, answer)
    assert rebooted.pixhawk.timesync_answer_ns(COMPANION) == 77


def test_a_duplicate_speaks_with_the_same_identity_and_another_clock(
    simulation: MakeSimulation,
) -> None:
    received = listened(simulation("autopilot.second start=1 for=0.5"), 2.0)
    assert {(f.system, f.component) for _, f in received} == {(1, 1)}
    attitudes = [
        (t, f.message.time_boot_ms * 1e-3)
        for t, f in received
        if f.message.get_type() == "ATTITUDE_QUATERNION"
    ]
    assert {t for t, stamp in attitudes if stamp > 3600.0} <= {
        t for t, _ in attitudes if 1.0 <= t < 1.5
    }
    assert sum(stamp > 3600.0 for _, stamp in attitudes) == pytest.approx(100, abs=2)


RAW_IMU, VFR_HUD = (mavlink.MAVLINK_MSG_ID_RAW_IMU, 200.0), (mavlink.MAVLINK_MSG_ID_VFR_HUD, 20.0)


def test_accelerations_are_lost(simulation: MakeSimulation) -> None:
    received = listened(simulation("imu.dropout start=1 for=0.5"), 2.0, RAW_IMU)
    assert "RAW_IMU" in kinds(received, 0.5, 1.0)
    assert kinds(received, 1.01, 1.49) - {"HEARTBEAT"} == {
        "ATTITUDE_QUATERNION",
        "LOCAL_POSITION_NED",
    }
    assert "RAW_IMU" in kinds(received, 1.5, 2.0)


def test_accelerations_that_are_no_numbers_are_integers_of_zero(
    simulation: MakeSimulation,
) -> None:
    received = listened(simulation("imu.nan start=1 for=0.5 fraction=1"), 2.0, RAW_IMU)
    reported = [(t, f.message) for t, f in received if f.message.get_type() == "RAW_IMU"]
    weightless = [t for t, m in reported if (m.xacc, m.yacc, m.zacc) == (0, 0, 0)]
    assert weightless == [t for t, _ in reported if 1.0 <= t < 1.5]
    assert len(weightless) == pytest.approx(100, abs=2)


def test_an_airspeed_that_is_frozen_is_shown(simulation: MakeSimulation) -> None:
    received = listened(simulation("airspeed.freeze start=1 for=0.5"), 2.0, VFR_HUD)
    reported = [(t, f.message.airspeed) for t, f in received if f.message.get_type() == "VFR_HUD"]
    frozen = [v for t, v in reported if 1.11 <= t < 1.5]  # it is read every 0.1 s
    live = [v for t, v in reported if 0.5 <= t < 1.0]
    assert max(frozen) - min(frozen) < 1e-3  # what is left is the height's: it shows EAS
    assert max(live) - min(live) > 1e-2


def test_the_pilot_takes_the_mode_and_gives_it_back(simulation: MakeSimulation) -> None:
    taken = simulation("pilot.takes start=1 for=0.5")
    listened(taken, 1.2)
    assert taken.pixhawk.mode == FBWA
    listened(taken, 0.5)
    assert taken.pixhawk.mode == MANUAL
    reported = taken.take_events()
    assert any(text.startswith("fault begins: pilot.takes") for text in reported)
    assert any(text.startswith("fault is over: pilot.takes") for text in reported)


# --- the command line --------------------------------------------------------------------------


def test_the_catalogue_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--fault", "list"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in CATALOGUE)
    listed = CliRunner().invoke(app, ["sitl", "--fault", "list"])
    assert listed.exit_code == 0
    assert "position.dropout" in listed.stdout
    assert "on motion capture: --mocap-option" in listed.stdout


def test_a_reader_of_the_catalogue_may_go_before_its_end() -> None:
    """As `--fault list | head -1` does."""
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        listed = subprocess.run(
            [sys.executable, "-m", "tgl_soar.sim.bridge", "--fault", "list"],
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (listed.returncode, listed.stderr) == (0, "")


def test_a_mistake_ends_the_bridge_before_it_begins(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--airframe", str(AIRFRAME_PATH), "--site", str(SITE_PATH)]
    with pytest.raises(SystemExit) as ended:
        main([*given, "--fault", "position.dropout by=2"])
    assert ended.value.code == 2
    assert "it takes start, for" in capsys.readouterr().err
    assert CliRunner().invoke(app, ["sitl", "--fault", "nonsense"]).exit_code == 2


# --- over sockets ------------------------------------------------------------------------------


def options(out: Path, **changes: Any) -> SitlOptions:
    return SitlOptions(AIRFRAME_PATH, SITE_PATH, out, legs=("a",), stay_s=3.0, **changes)


def test_lost_datagrams_are_the_same_ones_in_every_lockstep_flight(tmp_path: Path) -> None:
    faults = (
        "link.loss start=2 for=9 fraction=0.15",
        "link.jitter start=2 for=9 by=0.02",
        "link.corrupt start=2 for=9 fraction=0.05",
    )
    logs = []
    for name in ("first", "second"):
        fly(options(tmp_path / name, faults=faults), lambda _operator: None)
        logs.append((tmp_path / name / "truth.csv").read_bytes().splitlines()[:-1])
    shorter = min(len(rows) for rows in logs)
    assert shorter > 150  # at 50 Hz: on the line, with all faults at work
    assert logs[0][:shorter] == logs[1][:shorter]


def test_silence_of_the_autopilot_does_not_stop_the_clock_of_lockstep(tmp_path: Path) -> None:
    flight = fly(options(tmp_path, faults=("link.down start=4 for=3",)), lambda _operator: None)
    assert flight.flown[-1].released == "attitude lost"
    assert not passed(flight)
