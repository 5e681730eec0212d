"""How a firmware of our own is started and ended: its ports, its files, its arguments, and what is
reported where it does not come.  What would be its program connects from this process."""

from __future__ import annotations

import socket
import struct
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from firmware_step import AIRFRAME, NO_STICKS, READINGS

from tgl_soar.config.files import load_site, shipped
from tgl_soar.config.site import HomePosition
from tgl_soar.sim.firmware import FirmwareError, ardupilot, program, px4
from tgl_soar.sim.firmware.ardupilot import ArduPlane
from tgl_soar.sim.firmware.px4 import Px4Program
from tgl_soar.sim.firmware.starts import STARTS

SITE, HALL = load_site(shipped("sites/tunnel.toml")), load_site(shipped("sites/tunnel_mocap.toml"))
OUTPUTS = struct.pack("<HHI16H", 18458, 400, 1, *[1500] * 16)  # of ArduPilot's SIM_JSON
HOME = HomePosition(latitude_deg=47.5, longitude_deg=8.25, altitude_m=440.0)


class Process:
    """What was started: it records how it was ended, and may not end when it is asked to."""

    def __init__(self) -> None:
        self.binary = Path()
        self.options: list[str] = []
        self.log = Path()
        self.settings: dict[str, str] = {}
        self.ended: list[str] = []
        self.obeys = True
        self.connects: Callable[[Process], None] = lambda _: None

    def launch(
        self, binary: Path, options: Sequence[str], log: Path, settings: Mapping[str, str]
    ) -> Process:
        self.binary, self.options, self.log = binary, list(options), log
        self.settings = dict(settings)
        self.connects(self)
        return self

    def value(self, option: str) -> str:
        assert self.options.count(option) == 1
        return self.options[self.options.index(option) + 1]

    def terminate(self) -> None:
        self.ended.append("asked")

    def kill(self) -> None:
        self.ended.append("killed")

    def wait(self, timeout: float | None = None) -> int:
        self.ended.append(f"waited for {timeout}")
        if timeout is not None and not self.obeys:
            raise subprocess.TimeoutExpired("px4", timeout)
        return 0


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Process:
    made = Process()
    monkeypatch.setattr(program, "launch", made.launch)
    monkeypatch.setattr(px4, "BOOT_S", 0.01)
    monkeypatch.setattr(ardupilot, "BOOT_S", 0.01)
    return made


@pytest.fixture
def binary(tmp_path: Path) -> Path:
    made = tmp_path / "build" / "bin" / "firmware"
    for path in (made, tmp_path / "build" / "etc" / "init.d-posix" / "rcS"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/sh\n")
    made.chmod(0o755)
    return made


@pytest.fixture
def clients() -> Iterator[list[socket.socket]]:
    made: list[socket.socket] = []
    yield made
    for client in made:
        client.close()


def connecting(clients: list[socket.socket]) -> Callable[[Process], None]:
    """A PX4 that connects to the simulator of its instance."""

    def connects(process: Process) -> None:
        port = px4.SIMULATOR_PORT + int(process.value("-i"))
        clients.append(socket.create_connection(("127.0.0.1", port)))

    return connects


# --- PX4 ------------------------------------------------------------------------------------------


def test_a_px4_is_given_its_instance_its_files_and_its_parameters(
    tmp_path: Path, process: Process, binary: Path, clients: list[socket.socket]
) -> None:
    process.connects = connecting(clients)
    folder = tmp_path / "new" / "run"
    made = Px4Program(binary, folder, AIRFRAME.surfaces, {"FW_P_TC": 0.07, "MAV_SYS_ID": 3})
    assert made.instance in range(20, 100)
    assert made.port == 4560 + made.instance
    assert process.binary == binary
    assert process.options == [
        *("-i", str(made.instance), "-d", str((tmp_path / "build" / "etc").resolve()))
    ]
    assert process.log == folder / "px4.log"
    assert process.settings == {
        "PX4_SYS_AUTOSTART": "1030",
        "PX4_PARAM_FW_P_TC": "0.07",
        "PX4_PARAM_MAV_SYS_ID": "3",
    }
    assert process.ended == []
    made.close()
    assert process.ended == ["asked", "waited for 5.0"]
    with socket.socket() as again:  # its port is free
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(("127.0.0.1", made.port))


def test_a_px4_begins_without_what_the_last_one_stored(
    tmp_path: Path, process: Process, binary: Path, clients: list[socket.socket]
) -> None:
    process.connects = connecting(clients)
    for name in ("parameters.bson", "parameters_backup.bson", "dataman", "mine.txt"):
        (tmp_path / name).write_text("old")
    Px4Program(binary, tmp_path, AIRFRAME.surfaces, {}).close()
    left = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert left == {"mine.txt"}


def test_a_px4_whose_port_is_taken_is_another_instance(
    tmp_path: Path,
    process: Process,
    binary: Path,
    clients: list[socket.socket],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    process.connects = connecting(clients)
    first = Px4Program(binary, tmp_path / "1", AIRFRAME.surfaces, {})
    second = Px4Program(binary, tmp_path / "2", AIRFRAME.surfaces, {})
    assert second.instance > first.instance
    monkeypatch.setattr(px4, "INSTANCES", range(first.instance, first.instance + 1))
    with pytest.raises(FirmwareError, match=f"TCP port {first.port}, where PX4 looks for its"):
        Px4Program(binary, tmp_path / "3", AIRFRAME.surfaces, {})
    first.close()
    second.close()


def test_a_px4_that_does_not_come_is_ended(tmp_path: Path, process: Process, binary: Path) -> None:
    with pytest.raises(FirmwareError, match=f"PX4 does not come: see {tmp_path / 'px4.log'}"):
        Px4Program(binary, tmp_path, AIRFRAME.surfaces, {})
    assert process.ended == ["asked", "waited for 5.0"]


def test_a_px4_that_does_not_end_is_killed(
    tmp_path: Path, process: Process, binary: Path, clients: list[socket.socket]
) -> None:
    process.connects = connecting(clients)
    process.obeys = False
    Px4Program(binary, tmp_path, AIRFRAME.surfaces, {}).close()
    assert process.ended == ["asked", "waited for 5.0", "killed", "waited for None"]


def test_a_px4_is_flown_through_links_of_its_instance(
    tmp_path: Path, process: Process, binary: Path, clients: list[socket.socket]
) -> None:
    process.connects = connecting(clients)
    made, relay = STARTS["px4"](binary, tmp_path, AIRFRAME, SITE, {"FW_P_TC": 0.5})
    assert isinstance(made, Px4Program)
    assert process.settings["PX4_PARAM_FW_P_TC"] == "0.5"  # rather than the usual one
    assert process.settings["PX4_PARAM_FW_RR_P"] == "0.08"
    assert "PX4_PARAM_EKF2_EV_CTRL" not in process.settings
    assert (relay.step_hz, relay.attitude_hz) == (250, 250)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground, suppress(OSError):
        ground.bind(("127.0.0.1", 18570 + made.instance))
        ground.settimeout(5.0)
        relay.greet()
        assert ground.recv(300)[:1] == b"\xfd"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion, suppress(OSError):
        companion.bind(("127.0.0.1", 14580 + made.instance))
        companion.settimeout(5.0)
        relay.greet()
        assert companion.recv(300)[:1] == b"\xfd"
    relay.close()
    made.close()
    other, relay = STARTS["px4"](binary, tmp_path, AIRFRAME, HALL, {})
    assert process.settings["PX4_PARAM_EKF2_EV_CTRL"] == "11"
    relay.close()
    other.close()


# --- ArduPlane ------------------------------------------------------------------------------------


def address_of(client: str) -> tuple[str, int]:
    kind, host, port = client.split(":")
    assert kind == "udpclient"
    return host, int(port)


def plane_of(
    process: Process, binary: Path, folder: Path, parameters: Mapping[str, float]
) -> ArduPlane:
    """One that sends first, as its simulator's loop does."""

    def speaks(started: Process) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.sendto(OUTPUTS, ("127.0.0.1", int(started.value("--sim-port-out"))))

    process.connects = speaks
    return ArduPlane(binary, folder, AIRFRAME.surfaces, parameters, HOME, by_poses=False)


def test_an_arduplane_is_given_its_place_its_pace_and_where_we_are(
    tmp_path: Path, process: Process, binary: Path
) -> None:
    folder = tmp_path / "new" / "run"
    plane = plane_of(process, binary, folder, {"RC_OVERRIDE_TIME": 0.5, "SYSID_THISMAV": 1})
    assert process.options[0] == "--wipe"
    assert process.value("--model") == "JSON:127.0.0.1"
    assert process.value("--sim-port-out") == str(plane.port)
    assert process.value("--rate") == str(ardupilot.STEP_HZ)
    assert process.value("--speedup") == str(ardupilot.SPEEDUP)
    assert process.value("--home") == "47.5,8.25,440.0,0"
    defaults = Path(process.value("--defaults"))
    assert defaults == (folder / "parameters.parm").resolve()
    assert defaults.read_text() == "RC_OVERRIDE_TIME 0.5\nSYSID_THISMAV 1\n"
    assert process.log == folder / "arduplane.log"
    relay = plane.relay(1)
    for number, serial in ((1, "--serial0"), (2, "--serial1")):
        relay.add_link(number, ground=number == 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.sendto(serial.encode(), address_of(process.value(serial)))
    assert relay.take_datagrams() == [(1, b"--serial0"), (2, b"--serial1")]
    relay.close()
    plane.close()
    assert process.ended == ["killed", "waited for None"]


def test_an_arduplane_that_does_not_come_is_killed(
    tmp_path: Path, process: Process, binary: Path
) -> None:
    log = tmp_path / "arduplane.log"
    with pytest.raises(FirmwareError, match=f"ArduPlane does not come: see {log}"):
        ArduPlane(binary, tmp_path, AIRFRAME.surfaces, {}, None, by_poses=False)
    assert process.ended == ["killed", "waited for None"]


def test_a_program_that_cannot_be_run_is_named(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.write_text("no program")
    for missing in (plain, tmp_path, tmp_path / "none"):
        with pytest.raises(FirmwareError, match=f"{missing}: there is no program"):
            program.require(missing)
    plain.chmod(0o755)
    program.require(plain)


def test_a_px4_that_has_not_connected_is_not_stepped() -> None:
    physics = px4.Px4Physics(AIRFRAME.surfaces, 0)
    try:
        with pytest.raises(FirmwareError, match="PX4 has not connected"):
            physics.exchange(READINGS, NO_STICKS)
    finally:
        physics.close()
