"""The bridge: the simulation behind it, and its bad input."""

from __future__ import annotations

import hashlib
import signal
import socket
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import Site
from tgl_soar.sim.bridge.process import main
from tgl_soar.sim.channels import LEAVE, pwm_from_deflection
from tgl_soar.sim.ports import MAX_STRANGERS, Port, Ports
from tgl_soar.sim.routing import split_frames
from tgl_soar.sim.simulation import LOG_COLUMNS, Options, Simulation
from tgl_soar.sim.vehicle.modes import MANUAL

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
SURFACES = load_airframe(AIRFRAME).surfaces
ATTITUDE_QUATERNION = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
LOCAL_POSITION_NED = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
COMPANION, GROUND = 1, 2


@pytest.fixture(scope="module")
def airframe() -> Airframe:
    return load_airframe(AIRFRAME)


@pytest.fixture(scope="module")
def site() -> Site:
    return load_site(SITE)


class Companion:
    """A scripted companion: asks for streams, then overrides the surfaces by the attitude."""

    def __init__(self, answers: bool = True) -> None:
        self.own = mavlink.MAVLink(None, 1, 191)
        self.master = mavlink.MAVLink(None, 255, 191)
        self.decoder = mavlink.MAVLink(None)
        self.attitudes: list[Any] = []
        self.answers = answers
        self.flies = True
        self._asked = False

    def take(self, data: bytes) -> list[bytes]:
        out = []
        for frame in split_frames(self.decoder, data)[0]:
            message = frame.message
            kind = message.get_type()
            if kind == "HEARTBEAT":
                out.append(
                    self._pack(self.own, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
                )
                if not self._asked:
                    self._asked = True
                    out.append(self.request(ATTITUDE_QUATERNION, 200))
                    out.append(self.request(LOCAL_POSITION_NED, 50))
            elif kind == "ATTITUDE_QUATERNION":
                self.attitudes.append(message)
                if self.flies:
                    out.append(
                        self.override(1500 - round(200 * message.q3 + 20 * message.pitchspeed))
                    )
            elif kind == "TIMESYNC" and message.tc1 == 0 and self.answers:
                out.append(self._pack(self.own, mavlink.MAVLink_timesync_message(1, message.ts1)))
        return out

    def request(self, message_id: int, rate_hz: float) -> bytes:
        message = mavlink.MAVLink_command_long_message(
            1, 1, 511, 0, message_id, 1e6 / rate_hz, 0, 0, 0, 0, 0
        )
        return self._pack(self.own, message)

    def override(self, elevator: float) -> bytes:
        values = [LEAVE] * 8
        for surface, deflection in zip(SURFACES.driven(), (elevator, 0.0, 0.0), strict=True):
            values[surface.channel - 1] = pwm_from_deflection(surface, deflection)
        return self._pack(self.master, mavlink.MAVLink_rc_channels_override_message(1, 1, *values))

    def _pack(self, codec: mavlink.MAVLink, message: Any) -> bytes:
        data = bytes(message.pack(codec))
        codec.seq = (codec.seq + 1) % 256
        return data


# --- the simulation, without sockets -----------------------------------------------------------


def simulate(
    airframe: Airframe, site: Site, options: Options, seconds: float
) -> tuple[Simulation, Companion, str, list[str]]:
    """Flown by a scripted companion; the digest of all that went out, and the console."""
    simulation = Simulation(airframe, site, options, Path())
    simulation.pixhawk.add_link(COMPANION, ground=False)
    simulation.pixhawk.add_link(GROUND, ground=True)
    companion = Companion()
    digest = hashlib.sha256()
    events = []
    for _ in range(round(seconds * options.step_hz)):
        simulation.step()
        events += simulation.take_events()
        for link, data in simulation.pixhawk.take_datagrams():
            digest.update(bytes([link]) + data)
            if link == COMPANION:
                for answer in companion.take(data):
                    simulation.pixhawk.receive(COMPANION, answer)
    simulation.close()
    return simulation, companion, digest.hexdigest(), events


@pytest.mark.parametrize("step_hz", [200, 400])
def test_the_same_seed_gives_the_same_bytes(airframe: Airframe, site: Site, step_hz: int) -> None:
    def digest(seed: int) -> str:
        options = Options(seed=seed, turbulence=0.02, step_hz=step_hz)
        return simulate(airframe, site, options, 3.0)[2]

    assert digest(4) == digest(4)
    assert digest(4) != digest(5)


@pytest.mark.parametrize("step_hz", [200, 400])
def test_the_streams_run_at_the_rate_that_was_asked_for(
    airframe: Airframe, site: Site, step_hz: int
) -> None:
    options = Options(step_hz=step_hz)
    simulation, companion, _, _ = simulate(airframe, site, options, 4.0)
    assert simulation.world.steps == simulation.pixhawk.steps == 4 * step_hz
    stamps = [message.time_boot_ms for message in companion.attitudes]
    # Asked for after the first step: at 200 steps a second a sample has come by then.
    assert len(stamps) == 4 * 200 - (step_hz == 200)
    assert {b - a for a, b in pairwise(stamps)} == {5}


def test_the_aircraft_is_held_until_the_first_override(airframe: Airframe, site: Site) -> None:
    simulation = Simulation(airframe, site, Options(), Path())
    simulation.pixhawk.add_link(COMPANION, ground=False)
    companion = Companion()
    for _ in range(100):
        simulation.step()
    assert not simulation.flying
    assert simulation.world.truth.climb_mps == 0.0
    simulation.pixhawk.receive(COMPANION, companion.override(0.0))
    simulation.step()
    simulation.step()
    assert simulation.flying
    assert any("launched" in event for event in simulation.take_events())


def test_after_the_timeout_the_pilot_takes_over_and_keeps_it_up(
    airframe: Airframe, site: Site
) -> None:
    """kill -9 of the module, seen from the other end; then control is handed over in flight."""
    simulation = Simulation(airframe, site, Options(turbulence=0.01), Path())
    simulation.pixhawk.add_link(COMPANION, ground=False)
    companion = Companion()
    simulation.pixhawk.receive(COMPANION, companion.override(0.0))
    for _ in range(3 * 200 + 2):
        simulation.step()
    assert simulation.pixhawk.mode == MANUAL
    assert not simulation.pixhawk.is_overridden()
    for _ in range(30 * 200):
        simulation.step()
    assert simulation.crashes == 0
    place = simulation.world.truth
    for _ in range(10 * 200):
        simulation.step()
    assert abs(simulation.world.truth.x_m - place.x_m) < 0.2  # the pilot holds it
    simulation.pixhawk.set_mode(MANUAL, "test")
    for _ in range(10 * 200):
        simulation.step()
    assert simulation.crashes == 0
    assert abs(simulation.world.truth.x_m - place.x_m) < 0.3


def test_without_a_pilot_an_attitude_is_held_but_no_place(airframe: Airframe, site: Site) -> None:
    """No mode of a firmware keeps an aircraft without a propeller in the air of a jet."""
    simulation = Simulation(airframe, site, Options(pilot=False), Path())
    simulation.pixhawk.add_link(COMPANION, ground=False)
    simulation.pixhawk.receive(COMPANION, Companion().override(0.0))
    events = []
    for _ in range(60 * 200):
        simulation.step()
        events += simulation.take_events()
    assert simulation.crashes == 1
    assert any(event.startswith("lost: ") for event in events)
    assert any("carried back" in event for event in events)
    assert not simulation.flying
    assert simulation.pixhawk.mode == MANUAL


def test_the_log_has_its_columns_its_rate_and_both_formats(
    airframe: Airframe, site: Site, tmp_path: Path
) -> None:
    for name in ("truth.csv", "truth.npz"):
        simulate(airframe, site, Options(log=tmp_path / name, uptime_s=7.0), 2.0)
    lines = (tmp_path / "truth.csv").read_text().splitlines()
    assert lines[0] == ",".join(LOG_COLUMNS)
    table = np.array([[float(v) for v in line.split(",")] for line in lines[1:]])
    assert table.shape == (101, len(LOG_COLUMNS))
    assert table[:, 0] == pytest.approx(7.0 + np.arange(101) / 50)  # the autopilot's clock
    with np.load(tmp_path / "truth.npz") as arrays:
        for i, column in enumerate(LOG_COLUMNS):
            assert arrays[column] == pytest.approx(table[:, i], rel=1e-8, abs=1e-12)


def test_ground_stations_are_sent_the_truth(airframe: Airframe, site: Site) -> None:
    simulation = Simulation(airframe, site, Options(), Path())
    simulation.pixhawk.add_link(GROUND, ground=True)
    decoder = mavlink.MAVLink(None)
    reported: dict[str, list[float]] = {}
    for _ in range(2 * 200):
        simulation.step()
        for _, data in simulation.pixhawk.take_datagrams():
            for frame in split_frames(decoder, data)[0]:
                if frame.message.get_type() == "NAMED_VALUE_FLOAT":
                    reported.setdefault(frame.message.name, []).append(frame.message.value)
    assert set(reported) == {"updraft", "sink", "true_x", "true_y", "true_z", "airspeed"}
    assert {len(values) for values in reported.values()} == {10}  # 5 Hz
    assert reported["true_x"][0] == pytest.approx(site.start.x_m if site.start else 0.0)


# --- its arguments ------------------------------------------------------------------------------


def bridge_command(companion: str, gcs: str, *more: str) -> list[str]:
    return [
        *(sys.executable, "-m", "tgl_soar.sim.bridge"),
        *("--airframe", str(AIRFRAME), "--site", str(SITE)),
        *("--companion", companion, "--gcs", gcs),
        *("--companion-local", "127.0.0.1:0", "--gcs-local", "127.0.0.1:0"),
        *more,
    ]


def test_a_port_in_use_is_named_with_its_option(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        arguments = bridge_command("127.0.0.1:9", "127.0.0.1:10")[3:]
        for option in ("--gcs-local", "--companion-local"):
            assert main([*arguments, option, f"127.0.0.1:{port}"]) == 2
            message = capsys.readouterr().err
            assert f"{option} 127.0.0.1:{port}" in message
            assert "in use" in message


def test_a_flood_of_strangers_takes_no_more_than_its_share() -> None:
    own = (Port("ground", "--gcs-local", ("127.0.0.1", 0), ground=True),) * 2
    ports = Ports(*own)
    ports.add(own[0], ("127.0.0.1", 14550), configured=True)
    talker = ports.add(own[0], ("127.0.0.1", 1), configured=False)
    talker.datagrams = 100
    for number in range(2, 500):
        ports.add(own[0], ("127.0.0.1", number), configured=False).datagrams = 1
        ports.surplus()
    assert len(ports.peers) == 1 + MAX_STRANGERS
    assert talker in ports.peers.values()  # a peer that sends messages stays
    assert ports.strangers == 499
    ports.close()


def test_one_machine_only_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = bridge_command("127.0.0.1:9", "192.0.2.7:14550")[3:]
    assert main(arguments) == 2
    assert "add --gcs-local 0.0.0.0:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--turbulence", "nan"], "from 0 to 0.5"),
        (["--turbulence", "3"], "from 0 to 0.5"),
        (["--gcs", "14550"], "HOST:PORT"),
        (["--seed", "-1"], "a whole number"),
        (["--duration", "soon"], "'soon': a number"),
        (["--step-rate", "150"], "150"),
        (["--autopilot-parameter", "SYSID_MYGCS"], "NAME=NUMBER"),
        (["--autopilot-parameter", "SYSID_MYGCS=1@soon"], "NAME=NUMBER@SECONDS"),
        (["--autopilot-parameter", "SYSID_MYGCS=1@9"], "needs a firmware"),
        (["--autopilot-parameter", "NONSENSE=1"], "no such parameter"),
        (["--airframe", "/nowhere.toml"], "/nowhere.toml: cannot be read"),
        (["--log", "/proc/nowhere/log.csv"], "--log /proc/nowhere/log.csv"),
    ],
)
def test_wrong_arguments_are_named_and_end_with_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    base = bridge_command("127.0.0.1:9", "127.0.0.1:10")[3:]
    try:
        code = main([*base, "--duration", "0", *arguments])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else -1
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGINT, before[1])
    assert code == 2
    assert words in capsys.readouterr().err
