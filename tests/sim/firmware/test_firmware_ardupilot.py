"""ArduPlane's simulator interface, with a client that answers as its parser and outputs do."""

import json
import os
import re
import socket
import struct
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from firmware_step import AIRFRAME, NO_STICKS, READINGS, leg

from tgl_soar.config.files import shipped
from tgl_soar.link.autopilots.ardupilot import MODE_AUTO, MODE_FBWA, MODE_GUIDED
from tgl_soar.sim.firmware import FirmwareError, ardupilot
from tgl_soar.sim.firmware.ardupilot import (
    MAGIC,
    ArduPlane,
    ArduPlanePhysics,
    flight_parameters,
    gps_input,
    state_line,
)
from tgl_soar.sim.firmware.sensors import SOMEWHERE
from tgl_soar.sim.firmware.simulation import NO_PULSES, THROTTLE_LOW, Sticks
from tgl_soar.sim.sensor_messages import geodetic
from tgl_soar.sim.sitl import fly, passed
from tgl_soar.types import SurfaceCommand


def outputs(frame: int, pulses: list[int], magic: int = MAGIC) -> bytes:
    return struct.pack("<HHI16H", magic, 400, frame, *pulses, *[0] * (16 - len(pulses)))


class FakeArduPlane(threading.Thread):
    """Sends outputs, and the next ones for every line that it receives."""

    def __init__(self, port: int, answers: list[bytes]) -> None:
        super().__init__(daemon=True)
        self.lines: list[bytes] = []
        self.odd: tuple[bytes, ...] = ()  # sent before every answer
        self._answers = answers
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(5.0)
        self._address = ("127.0.0.1", port)

    def run(self) -> None:
        with self._socket as client:
            client.sendto(self._answers[0], self._address)
            for answer in self._answers[1:]:
                self.lines.append(client.recv(4096))
                for data in self.odd:
                    client.sendto(data, self._address)
                client.sendto(answer, self._address)


@pytest.fixture
def physics() -> Any:
    made = ArduPlanePhysics(AIRFRAME.surfaces)
    yield made
    made.close()


def found(line: bytes, key: str) -> str:
    """What ArduPilot's parser has for a name: from behind its first place in the text."""
    text = line.decode()
    return text[text.index(key) + len(key) + 2 :]


def test_the_line_is_what_its_parser_finds() -> None:
    line = state_line(READINGS, [1500, 1400, 1000, 1600])
    assert line.startswith(b"\n")
    assert line.endswith(b"\n")
    state = json.loads(line)
    assert state["imu"] == {"gyro": [0.01, 0.02, 0.03], "accel_body": [0.1, 0.2, -9.8]}
    assert found(line, "timestamp").startswith("1.0025")
    assert found(line, "position").startswith("[1.0,-2.0,-3.0]")
    assert found(line, "quaternion").startswith("[0.5,0.5,-0.5,0.5]")
    assert found(line, "velocity").startswith("[0.25,-0.5,0.125]")
    assert found(line, "airspeed").startswith("8.75")
    assert "attitude" not in line.decode()  # the quaternion is used
    rc = line.decode()[line.decode().index("rc") :]
    assert [found(rc.encode(), f"rc_{i}")[:4] for i in (1, 2, 3, 4)] == [
        "1500",
        "1400",
        "1000",
        "1600",
    ]


def test_a_step_is_one_line_and_one_answer(physics: ArduPlanePhysics) -> None:
    plane = FakeArduPlane(
        physics.port, [outputs(0, [0] * 8), outputs(1, [0] * 8), outputs(2, [1300, 1700, 0, 1900])]
    )
    plane.start()
    assert physics.connect(5.0)
    assert physics.exchange(READINGS, NO_STICKS) == (0.0, 0.0, 0.0, 0.0)  # outputs not set up yet
    assert physics.exchange(READINGS, NO_STICKS) == (0.5, -0.5, 1.0, 0.0)
    plane.join(5.0)
    assert len(plane.lines) == 2


def test_what_it_repeats_and_what_is_not_its_is_passed_over(physics: ArduPlanePhysics) -> None:
    odd = (b"?", outputs(1, [1900] * 4, magic=1), outputs(0, [1900] * 4))
    plane = FakeArduPlane(physics.port, [outputs(0, [0] * 8), outputs(1, [1500, 1100, 0, 1500])])
    plane.odd = odd
    plane.start()
    assert physics.connect(5.0)
    assert physics.exchange(READINGS, NO_STICKS).elevator == -1.0
    plane.join(5.0)


def test_sticks_and_mode_switch_are_channels(physics: ArduPlanePhysics) -> None:
    plane = FakeArduPlane(physics.port, [outputs(i, [0] * 8) for i in range(3)])
    plane.start()
    physics.connect(5.0)
    physics.exchange(READINGS, Sticks(SurfaceCommand(0.5, -1.0, 0.25)))
    physics.exchange(READINGS, Sticks(SurfaceCommand(0.0, 0.0, 0.0), takes=True))
    plane.join(5.0)
    first, second = (json.loads(line)["rc"] for line in plane.lines)
    assert [first[f"rc_{i}"] for i in range(1, 9)] == [
        1100,
        1700,
        1000,
        1600,
        1500,
        1500,
        1500,
        1900,
    ]
    assert second["rc_8"] == 1000


def test_a_receiver_without_a_signal_sends_nothing_or_a_closed_throttle(
    physics: ArduPlanePhysics,
) -> None:
    plane = FakeArduPlane(physics.port, [outputs(i, [0] * 8) for i in range(3)])
    plane.start()
    physics.connect(5.0)
    pulled = SurfaceCommand(0.5, -1.0, 0.25)
    physics.exchange(READINGS, Sticks(pulled, signal=NO_PULSES))
    physics.exchange(READINGS, Sticks(pulled, signal=THROTTLE_LOW))
    plane.join(5.0)
    silent, low = (json.loads(line)["rc"] for line in plane.lines)
    assert silent == {}
    assert [low[f"rc_{i}"] for i in range(1, 9)] == [1500, 1500, 900, *[1500] * 4, 1900]


def test_silence_is_the_end(physics: ArduPlanePhysics, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ardupilot, "PATIENCE_S", 0.05)
    plane = FakeArduPlane(physics.port, [outputs(0, [0] * 8)])
    plane.start()
    physics.connect(5.0)
    with pytest.raises(FirmwareError, match="has not answered"):
        physics.exchange(READINGS, NO_STICKS)


def test_poses_alone_need_fixes_to_begin_with() -> None:
    for by_poses in (True, False):
        physics = ArduPlanePhysics(AIRFRAME.surfaces, by_poses=by_poses)
        fixes = [physics.helped(READINGS, ()) for _ in range(400)]
        assert len([fix for fix in fixes if fix]) == (5 if by_poses else 0)
        used = "EKF3 IMU0 is using external nav data"
        assert not any(physics.helped(READINGS, (used,)) for _ in range(400))
        physics.close()
    fix = gps_input(SOMEWHERE, READINGS)
    assert fix.lat == pytest.approx(SOMEWHERE.latitude_deg * 1e7 + 90, abs=2)  # a metre north
    assert fix.alt == pytest.approx(SOMEWHERE.altitude_m + 3.0)
    assert (fix.vn, fix.ve, fix.vd) == (0.25, -0.5, 0.125)


def test_stick_and_servo_are_alike() -> None:
    parameters = flight_parameters(AIRFRAME, gps=True)
    for prefix in ("RC", "SERVO"):
        ends = [parameters[f"{prefix}2_{end}"] for end in ("MIN", "TRIM", "MAX")]
        assert ends == [1100, 1500, 1900]
    assert parameters["SERVO2_FUNCTION"] == 19  # elevator
    assert parameters["SYSID_MYGCS"] == AIRFRAME.autopilot.override_system_id
    assert "VISO_TYPE" not in parameters
    assert flight_parameters(AIRFRAME, gps=False)["EK3_SRC1_POSXY"] == 6


def test_a_program_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FirmwareError, match="there is no program"):
        ArduPlane(tmp_path / "arduplane", tmp_path, AIRFRAME.surfaces, {}, None, by_poses=False)


REAL = pytest.mark.skipif(
    "TGL_SOAR_ARDUPLANE" not in os.environ,
    reason="needs a real ArduPlane: set TGL_SOAR_ARDUPLANE to its program",
)


@REAL
@pytest.mark.parametrize("route", ["override", "attitude"])
def test_a_leg_through_a_real_arduplane(tmp_path: Path, route: str) -> None:
    program = os.environ["TGL_SOAR_ARDUPLANE"]
    stay_s = 4.0 if route == "override" else 8.0  # it settles later (docs/autopilots.md)
    flight = fly(leg(tmp_path, "ardupilot", program, route, stay_s=stay_s), lambda _: None)
    assert passed(flight)


SPOILERS = shipped("airframes/eclipson_c_spoilers.toml")
TWO_AILERONS = """
aileron_left = { channel = 1, pwm_min = 1100, pwm_trim = 1500, pwm_max = 1900 }
aileron_right = { channel = 5, pwm_min = 1100, pwm_trim = 1500, pwm_max = 1900 }
mixing = { brake_throw = 0.5, brake = "up" }
"""


@REAL
@pytest.mark.parametrize("kind", ["spoiler", "two ailerons"])
def test_a_point_is_held_through_a_real_arduplane_until_half_of_the_brake_jams(
    tmp_path: Path, kind: str
) -> None:
    airframe = SPOILERS
    if kind == "two ailerons":
        text = re.sub(r"(?m)^(spoiler|aileron) = .*$", "", SPOILERS.read_text())
        airframe = tmp_path / "two_ailerons.toml"
        airframe.write_text(text.replace("[surfaces]\n", f"[surfaces]\n{TWO_AILERONS}"))
    jams_s, point_m = 55.0, -0.12  # it takes 22 s to tell (docs/point.md)
    options = replace(
        leg(tmp_path, "ardupilot", os.environ["TGL_SOAR_ARDUPLANE"], "override", stay_s=80.0),
        airframe=airframe,
        legs=("b",),
        turbulence=0.01,
        settings=(("TGL_HOLD", 1.0), ("TGL_ALONG", point_m)),
        faults=(f"brake.one_side start={jams_s:g} for=999",),
    )
    flight = fly(options, lambda _: None)
    x0, z0, eta = flight.lines[0]
    truth = flight.truth
    held = (truth["time_s"] > jams_s - 12.0) & (truth["time_s"] < jams_s)
    along = np.cos(eta) * (truth["x_m"] - x0) + np.sin(eta) * (truth["z_m"] - z0)
    assert np.std(truth["brake"][held]) > 0.0
    assert np.sqrt(np.mean((along[held] - point_m) ** 2)) < 0.02
    assert passed(flight)  # on the line alone, to the end
    log = (tmp_path / "module.log").read_text()
    assert "point: held" in log
    assert "point: brake pulls to one side: line alone" in log


@REAL
def test_guided_that_a_failsafe_gives_back_is_left_on_a_real_arduplane(tmp_path: Path) -> None:
    """The radio is gone for 2 s: FBWA, and GUIDED by itself as soon as it is back."""
    fails_s = 60.0
    options = replace(
        leg(tmp_path, "ardupilot", os.environ["TGL_SOAR_ARDUPLANE"], "attitude", stay_s=60.0),
        site=shipped("sites/hill.toml"),
        mocap=False,
        faults=(f"transmitter.failsafe start={fails_s:g} for=2",),
        watch_s=10.0,
    )
    flight = fly(options, lambda _: None)
    after = flight.truth["time_s"] > fails_s
    modes = flight.truth["mode"][after]
    changes = modes[:1].tolist() + modes[1:][modes[1:] != modes[:-1]].tolist()
    assert changes == [MODE_GUIDED, MODE_FBWA, MODE_GUIDED, MODE_FBWA]
    assert "back in GUIDED" in (tmp_path / "module.log").read_text()
    assert flight.truth["flying"][after].all()


@REAL
def test_a_search_finds_a_place_over_the_hill_through_a_real_arduplane(tmp_path: Path) -> None:
    """From behind the contour, where a line sinks until it comes to it; by satellites."""
    site = tmp_path / "behind.toml"
    text = shipped("sites/hill.toml").read_text()
    site.write_text(text.replace("x_m = -5.2\nz_m = 12.6", "x_m = -3.0\nz_m = 14.5"))
    options = replace(
        leg(tmp_path, "ardupilot", os.environ["TGL_SOAR_ARDUPLANE"], "override", stay_s=20.0),
        site=site,
        mocap=False,
        legs=(),
        search=True,
    )
    flight = fly(options, lambda _: None)
    truth, (flown,) = flight.truth, flight.flown
    stays = (truth["time_s"] > flown.stopped_s) & (truth["time_s"] < flown.ended_s)
    assert truth["flying"][stays].all()
    assert abs(truth["x_m"][0] + 3.0) < 0.1
    assert np.ptp(truth["z_m"][stays]) < 1.0
    assert "soaring: a place to soar is found" in (tmp_path / "module.log").read_text()


LANDING = ((16, 0.0, 0.0), (189, 0.0, 0.0), (16, -14.0, 9.0), (21, -28.0, 0.0))  # command, x, z


@REAL
def test_a_real_arduplane_takes_over_with_the_landing_of_its_mission(tmp_path: Path) -> None:
    """LND_BY 1, from a break-off by command; home is at the foot of the hill, as in the file."""
    mission = tmp_path / "mission.txt"
    rows = ["QGC WPL 110"]
    for i, (command, x_m, z_m) in enumerate(LANDING):
        latitude, longitude, height = geodetic(SOMEWHERE, 0.0, x_m, -z_m)  # wind from the west
        place = f"{latitude:.8f}\t{longitude:.8f}\t{height:.2f}"
        rows.append(f"{i}\t0\t0\t{command}\t0\t0\t0\t0\t{place}\t1")
    mission.write_text("\n".join(rows))
    options = replace(
        leg(tmp_path, "ardupilot", os.environ["TGL_SOAR_ARDUPLANE"], "override", stay_s=4.0),
        site=shipped("sites/hill.toml"),
        mocap=False,
        settings=(("LND_BY", 1.0),),
        autopilot_parameters=("RTL_AUTOLAND=2",),
        mission=mission,
        goes_home=True,
        watch_s=6.0,
    )
    flight = fly(options, lambda _: None)
    assert flight.truth["mode"][-1] == MODE_AUTO
    assert not flight.truth["overridden"][-1]
    log = (tmp_path / "module.log").read_text()
    assert "landing: away from the slope" in log
    assert "the autopilot lands: item 2 of its mission" in log
    assert "LND_BY" not in log  # the mission has no fault
