"""What ArduPlane and the simulation send to one another, number by number, and what it is set to
before a flight, with the reason for each parameter."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from firmware_step import AIRFRAME, NO_STICKS, READINGS
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Mixing, Surface, Surfaces, Throttle
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import HomePosition
from tgl_soar.sim.firmware import FirmwareError, ardupilot, program
from tgl_soar.sim.firmware.ardupilot import (
    ArduPlanePhysics,
    channel_parameters,
    flight_parameters,
    gps_input,
    state_line,
)
from tgl_soar.sim.firmware.sensors import SOMEWHERE
from tgl_soar.sim.firmware.simulation import NO_PULSES, THROTTLE_LOW, Sticks
from tgl_soar.types import SurfaceCommand

HOME = HomePosition(latitude_deg=-33.0, longitude_deg=151.0, altitude_m=420.0)
PLAIN = AIRFRAME.surfaces
SPOILERS = load_airframe(shipped("airframes/eclipson_c_spoilers.toml")).surfaces
ODD = Surfaces(
    elevator=Surface(2, 1000, 1400, 2000, reversed=True),
    aileron=Surface(1, 1100, 1500, 1900),
    rudder=Surface(10, 1200, 1550, 1850),
    throttle=Throttle(3, 1050, 1950),
)
TWO_AILERONS = Surfaces(
    elevator=Surface(2),
    rudder=Surface(4),
    aileron_left=Surface(1),
    aileron_right=Surface(5),
    mixing=Mixing(0.5, "up"),
)


def outputs(frame: int, *pulses: int, magic: int = 18458) -> bytes:
    """By hand: magic, rate, count, 16 pulses, all little-endian."""
    return struct.pack("<HHI", magic, 400, frame) + struct.pack(
        "<16H", *pulses, *[0] * (16 - len(pulses))
    )


class Plane:
    """ArduPlane's end: what it is to answer next is sent ahead."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.physics = ArduPlanePhysics(surfaces)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(5.0)
        self._frame = 0
        self.send(outputs(0))
        assert self.physics.connect(5.0)

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, ("127.0.0.1", self.physics.port))

    def step(self, *pulses: int, sticks: Sticks = NO_STICKS) -> tuple[SurfaceCommand, Any]:
        """What is answered to a step, and what the step's line was."""
        self._frame += 1
        self.send(outputs(self._frame, *pulses))
        command = self.physics.exchange(READINGS, sticks)
        return command, json.loads(self._socket.recv(65536))

    def close(self) -> None:
        self.physics.close()
        self._socket.close()


@pytest.fixture
def plane() -> Iterator[Plane]:
    made = Plane(PLAIN)
    yield made
    made.close()


@pytest.fixture
def odd() -> Iterator[Plane]:
    made = Plane(ODD)
    yield made
    made.close()


# --- one step -------------------------------------------------------------------------------------


def test_modes_are_arduplanes_numbers() -> None:
    """MANUAL 0, FBWA 5, GUIDED 15."""
    assert ArduPlanePhysics.manual_mode == 0
    assert ArduPlanePhysics.obeys == {"RC_CHANNELS_OVERRIDE": 0, "SET_ATTITUDE_TARGET": 15}
    assert (ArduPlanePhysics.name, ArduPlanePhysics.step_hz) == ("ArduPlane", 400)
    assert ArduPlanePhysics.first_item == 0  # of a mission its first item is home


def test_a_mode_is_asked_for_by_its_number(plane: Plane) -> None:
    asked = plane.physics.ask_for_mode(7, 15)
    assert (asked.target_system, asked.target_component) == (7, 1)
    assert (asked.command, asked.confirmation) == (mavlink.MAV_CMD_DO_SET_MODE, 0)
    assert (asked.param1, asked.param2) == (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 15.0)
    rest = [asked.param3, asked.param4, asked.param5, asked.param6, asked.param7]
    assert rest == [0.0] * 5


def test_its_pulses_are_deflections_by_the_airframe_files_calibration(odd: Plane) -> None:
    # Elevator (reversed) on 2, aileron on 1, rudder on 10: halfway to each end.
    pulses = [1300, 1200, 0, 0, 0, 0, 0, 0, 0, 1700]
    command, _ = odd.step(*pulses)
    assert command == pytest.approx((0.5, -0.5, 0.5, 0.0))


@pytest.mark.parametrize("missing", [0, 1, 3])
def test_surfaces_are_neutral_until_all_channels_are_set_up(plane: Plane, missing: int) -> None:
    pulses = [1900, 1900, 0, 1900]
    assert plane.step(*pulses)[0] == (1.0, 1.0, 1.0, 0.0)
    pulses[missing] = 0
    assert plane.step(*pulses)[0] == (0.0, 0.0, 0.0, 0.0)


def test_a_motor_is_commanded_by_its_channels_pulse(odd: Plane) -> None:
    assert odd.physics.throttle == 0.0  # its outputs are 0 yet
    for pulse, throttle in ((1050, 0.0), (1275, 0.25), (1950, 1.0), (2000, 1.0), (900, 0.0)):
        odd.step(1500, 1400, pulse)
        assert odd.physics.throttle == pytest.approx(throttle)


def test_without_a_propeller_there_is_no_throttle(plane: Plane) -> None:
    plane.step(1500, 1500, 2000, 1500)
    assert plane.physics.throttle == 0.0
    new = ArduPlanePhysics(ODD)
    assert new.throttle == 0.0  # nothing has come yet
    new.close()


def test_a_frame_of_another_plane_is_new_though_its_number_is_the_same(plane: Plane) -> None:
    plane.step(1500, 1500, 0, 1500)  # frame 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        other.sendto(outputs(1, 1500, 1900, 0, 1500), ("127.0.0.1", plane.physics.port))
        assert plane.physics.exchange(READINGS, NO_STICKS).elevator == 1.0


def test_what_is_too_short_too_long_or_of_no_plane_is_no_answer(
    plane: Plane, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ardupilot, "PATIENCE_S", 0.02)
    good = outputs(1, 1900, 1900, 0, 1900)
    for bad in (good[:-1], good + b"\0", outputs(2, 1900, magic=18459), b""):
        plane.send(bad)
    with pytest.raises(FirmwareError, match=r"ArduPlane has not answered a step for 0\.02 s"):
        plane.physics.exchange(READINGS, NO_STICKS)


def test_without_a_firmware_nothing_connects() -> None:
    alone = ArduPlanePhysics(PLAIN)
    assert not alone.connect(0.0)
    alone.close()


def test_the_transmitter_is_eight_channels_of_pulses(odd: Plane) -> None:
    """A rudder on channel 10 is on none that the receiver has; 1400 is the elevator's middle."""
    _, line = odd.step(sticks=Sticks(SurfaceCommand(0.5, 0.25, 1.0)))
    rc = [line["rc"][f"rc_{i}"] for i in range(1, 9)]
    assert rc == [1600, 1200, 1000, 1500, 1500, 1500, 1500, 1900]
    assert len(line["rc"]) == 8


def test_a_surface_on_the_last_channel_of_the_receiver_is_moved_by_its_stick() -> None:
    plane = Plane(replace_rudder(PLAIN, 7))
    _, line = plane.step(sticks=Sticks(SurfaceCommand(0.0, 0.0, 0.5)))
    assert line["rc"]["rc_7"] == 1700
    plane.close()


def replace_rudder(surfaces: Surfaces, channel: int) -> Surfaces:
    return Surfaces(
        elevator=surfaces.elevator, aileron=surfaces.aileron, rudder=Surface(channel=channel)
    )


def test_two_ailerons_are_mixed_by_the_sticks_and_unmixed_from_the_pulses() -> None:
    plane = Plane(TWO_AILERONS)
    # roll 0.2, brake 0.6 of half the throw: left 0.2 - 0.3, right 0.2 + 0.3
    _, line = plane.step(sticks=Sticks(SurfaceCommand(0.0, 0.2, 0.0, 0.6)))
    assert (line["rc"]["rc_1"], line["rc"]["rc_5"]) == (1460, 1700)
    command, _ = plane.step(1460, 1500, 0, 1500, 1700)
    assert command == pytest.approx((0.0, 0.2, 0.0, 0.6))
    plane.close()


def test_the_pilots_switch_is_low_where_they_take_over(plane: Plane) -> None:
    for takes, pulse in ((False, 1900), (True, 1000)):
        _, line = plane.step(sticks=NO_STICKS._replace(takes=takes))
        assert line["rc"]["rc_8"] == pulse
        assert line["rc"]["rc_3"] == 1000
    _, line = plane.step(sticks=NO_STICKS._replace(signal=NO_PULSES))
    assert line["rc"] == {}
    _, line = plane.step(sticks=NO_STICKS._replace(signal=THROTTLE_LOW, takes=True))
    assert line["rc"]["rc_3"] == 900  # below THR_FS_VALUE, 950
    assert line["rc"]["rc_8"] == 1900  # as it was


def test_a_line_has_its_time_to_a_microsecond_and_no_blank() -> None:
    line = state_line(READINGS._replace(time_s=2.00000049), [])
    assert b'"timestamp":2.0,' in line
    assert b'"timestamp":2.000001,' in state_line(READINGS._replace(time_s=2.0000006), [])
    assert b" " not in line


# --- fixes that help it start ---------------------------------------------------------------------


def test_a_fix_is_at_the_aircrafts_place() -> None:
    """Position 1 m north, 2 m west, 3 m up of home; a degree of latitude is 110.9 km there."""
    fix = gps_input(HOME, READINGS)
    assert fix.lat == pytest.approx(-33.0e7 + 1e7 / 110_909.0, abs=1)
    assert fix.lon == pytest.approx(151.0e7 - 2e7 / 93_453.0, abs=2)
    assert fix.alt == 423.0
    assert fix.time_usec == 1_002_500
    assert (fix.time_week_ms, fix.time_week) == (1002, 2400)
    assert (fix.gps_id, fix.ignore_flags, fix.fix_type) == (0, 0, 3)
    assert (fix.hdop, fix.vdop, fix.satellites_visible) == (0.7, 0.7, 12)
    assert (fix.speed_accuracy, fix.horiz_accuracy, fix.vert_accuracy) == (0.1, 0.2, 0.3)


def test_the_time_of_the_week_begins_again_after_seven_days() -> None:
    week_s = 7 * 86400
    fix = gps_input(HOME, READINGS._replace(time_s=week_s + 1.5))
    assert fix.time_week_ms == 1500
    assert fix.time_usec == (week_s * 1000 + 1500) * 1000


def test_it_is_helped_five_times_a_second_until_poses_are_used() -> None:
    physics = ArduPlanePhysics(PLAIN, HOME, by_poses=True)
    helped = [step for step in range(1, 401) if physics.helped(READINGS, ("ready",))]
    assert helped == [80, 160, 240, 320, 400]
    for _ in range(79):
        assert physics.helped(READINGS, ()) is None
    fix = physics.helped(READINGS, ())
    assert fix is not None
    assert fix.lat == gps_input(HOME, READINGS).lat
    texts = ("ready", "EKF3 IMU1 is using external nav data")
    assert not any(physics.helped(READINGS, texts) for _ in range(80))
    physics.close()


# --- its parameters -------------------------------------------------------------------------------


def test_stick_and_servo_have_the_airframe_files_calibration() -> None:
    given = channel_parameters(ODD)
    for kind in ("RC", "SERVO"):
        for channel, ends in (
            (2, (1000, 1400, 2000, 1)),
            (1, (1100, 1500, 1900, 0)),
            (10, (1200, 1550, 1850, 0)),
        ):
            names = [f"{kind}{channel}_{end}" for end in ("MIN", "TRIM", "MAX", "REVERSED")]
            assert tuple(given[name] for name in names) == ends
    assert [given[f"RC{channel}_DZ"] for channel in (1, 2, 10)] == [0, 0, 0]
    # Elevator 19, aileron 4, rudder 21, throttle 70.
    assert [given[f"SERVO{i}_FUNCTION"] for i in (2, 1, 10, 3)] == [19, 4, 21, 70]


def test_a_motor_has_its_own_channel_and_ends() -> None:
    given = channel_parameters(ODD)
    assert given["RCMAP_THROTTLE"] == 3
    ends = [given[f"{kind}3_{end}"] for kind in ("RC", "SERVO") for end in ("MIN", "MAX")]
    assert ends == [1050, 1950, 1050, 1950]
    without = channel_parameters(PLAIN)
    assert without["SERVO3_FUNCTION"] == 0
    assert "RCMAP_THROTTLE" not in without


def test_what_brakes_repeats_its_channel() -> None:
    """SERVOn_FUNCTION 51 … 66 repeats channel 1 … 16."""
    brake = SPOILERS.brake
    assert brake is not None
    given = channel_parameters(SPOILERS)
    assert given[f"SERVO{brake.channel}_FUNCTION"] == 50 + brake.channel
    assert given["SERVO1_FUNCTION"] == 4  # the ailerons stay ailerons
    assert given["SERVO4_FUNCTION"] == 21


def test_two_ailerons_both_repeat_their_channels() -> None:
    given = channel_parameters(TWO_AILERONS)
    assert [given[f"SERVO{i}_FUNCTION"] for i in (2, 1, 4, 5)] == [19, 51, 21, 55]


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("SCHED_LOOP_RATE", 400, "Hz, as it is stepped"),
        ("SERIAL2_PROTOCOL", -1, "a port that would wait for a client"),
        ("SR0_EXT_STAT", 2, "Hz, unasked: SYS_STATUS, by which it is known to be ready"),
        ("SR0_POSITION", 4, "Hz"),
        ("SR0_EXTRA1", 4, "Hz"),
        ("SR0_EXTRA2", 4, "Hz"),
        ("SR0_RC_CHAN", 2, "Hz"),
        ("RC_OVERRIDE_TIME", 0.5, "s until a silent companion's overrides end"),
        ("RC_OPTIONS", 32, "bit 5 alone, the default: overrides are not ignored"),
        ("FLTMODE_CH", 8, "the mode switch that `rc_8` is"),
        ("FLTMODE1", 5, "FBWA where the pilot takes over: the switch is low"),
        ("FLTMODE2", 5, "FBWA in between"),
        ("FLTMODE3", 5, "FBWA in between"),
        ("FLTMODE4", 5, "FBWA in between"),
        ("FLTMODE5", 5, "FBWA in between"),
        ("FLTMODE6", 0, "MANUAL at the high end, 1900"),
        ("THR_FAILSAFE", 1, "a low throttle is a lost radio"),
        ("FS_SHORT_ACTN", 2, "which glides, in FBWA"),
        ("FS_LONG_ACTN", 2, "which glides"),
        ("FENCE_ACTION", 0, "no fence"),
        ("FS_GCS_ENABL", 0, "no failsafe without a ground station"),
        ("ARMING_RUDDER", 0, "no arming by rudder"),
        ("ARMING_CHECK", 0b110, "bits 1 and 2: barometer and compass"),
        ("BRD_SAFETY_DEFLT", 0, "no safety switch"),
        ("LOG_DISARMED", 0, "no logs of its own"),
        ("LOG_BACKEND_TYPE", 0, "no logs of its own"),
        ("ARSPD_SKIP_CAL", 1, "it boots in the wind"),
        ("ARSPD_OFFSET", 2013, "that the simulated tube has"),
        ("ARSPD_RATIO", 2, "that the simulated tube has"),
        ("ARSPD_USE", 1, "the tube is used"),
        ("CRASH_DETECT", 0, "not disarmed as it seems to have crashed"),
    ],
)
def test_nothing_takes_the_aircraft_from_whoever_flies_it(
    name: str, value: float, why: str
) -> None:
    assert flight_parameters(AIRFRAME, gps=True)[name] == value, why


@pytest.mark.parametrize("n", ["", "2"])
@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_both_accelerometers_count_as_calibrated(n: str, axis: str) -> None:
    """Offsets that are not zero, and so small that they do not matter."""
    given = flight_parameters(AIRFRAME, gps=True)
    assert given[f"INS_ACC{n}OFFS_{axis}"] == 0.001
    assert given[f"INS_ACC{n}SCAL_{axis}"] == 1.001


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("VISO_TYPE", 1, "poses by MAVLink"),
        ("VISO_DELAY_MS", 0, "poses have stamps"),
        ("EK3_SRC1_POSXY", 6, "external navigation"),
        ("EK3_SRC1_VELXY", 0, "no velocity: poses have none"),
        ("EK3_SRC1_POSZ", 6, "external navigation"),
        ("EK3_SRC1_VELZ", 0, "no velocity"),
        ("EK3_SRC1_YAW", 6, "external navigation"),
        ("GPS1_TYPE", 14, "by MAVLink, until poses are used"),
    ],
)
def test_in_a_hall_poses_take_the_place_of_satellites(name: str, value: float, why: str) -> None:
    assert flight_parameters(AIRFRAME, gps=False)[name] == value, why
    assert name not in flight_parameters(AIRFRAME, gps=True)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("AIRSPEED_MIN", 7),
        ("AIRSPEED_CRUISE", 9),
        ("AIRSPEED_MAX", 15),
        ("SCALING_SPEED", 8.7),  # neutral elevator trims there
        ("PTCH_LIM_MIN_DEG", -15),
        ("PTCH_LIM_MAX_DEG", 12),
        ("PTCH2SRV_TCONST", 0.15),
        ("PTCH2SRV_RMAX_UP", 0),  # no limit
        ("PTCH2SRV_RMAX_DN", 0),
        ("PTCH_RATE_FF", 0.54),
        ("PTCH_RATE_P", 0.25),
        ("PTCH_RATE_I", 0.5),
        ("PTCH_RATE_D", 0.0),
        ("RLL2SRV_TCONST", 0.2),
        ("RLL_RATE_FF", 0.23),
        ("RLL_RATE_P", 0.1),
        ("RLL_RATE_I", 0.2),
        ("RLL_RATE_D", 0.0),
        ("STALL_PREVENTION", 0),
    ],
)
def test_the_inner_loops_have_the_gains_that_were_found_in_flight(name: str, value: float) -> None:
    assert flight_parameters(AIRFRAME, gps=False)[name] == value


def test_the_airframe_file_names_its_system_and_whose_overrides_it_obeys() -> None:
    given = flight_parameters(AIRFRAME, gps=True)
    assert (given["SYSID_THISMAV"], given["SYSID_MYGCS"]) == (1, 255)
    assert given["SERVO2_FUNCTION"] == 19


# --- its program ----------------------------------------------------------------------------------


class Launched:
    """A program that was ended."""

    def __init__(self) -> None:
        self.ended: list[str] = []

    def kill(self) -> None:
        self.ended.append("kill")

    def wait(self) -> None:
        self.ended.append("wait")


def test_it_is_started_to_wait_for_us_at_our_ports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: dict[str, Any] = {}
    process = Launched()

    def launch(binary: Path, options: tuple[str, ...], log: Path, settings: Any) -> Launched:
        started.update(binary=binary, options=options, log=log, settings=settings)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            port = int(options[options.index("--sim-port-out") + 1])
            client.sendto(outputs(0), ("127.0.0.1", port))
        return process

    monkeypatch.setattr(program, "launch", launch)
    binary = tmp_path / "arduplane"
    binary.write_text("")
    binary.chmod(0o755)
    folder = tmp_path / "new" / "run"
    site = load_site(shipped("sites/tunnel_mocap.toml"))
    plane, relay = ardupilot.start(binary, folder, AIRFRAME, site, {"SIM_WIND_SPD": 0.1234567891})
    options = started["options"]
    words = dict(zip(options[1::2], options[2::2], strict=True))
    assert options[0] == "--wipe"
    assert words["--model"] == "JSON:127.0.0.1"
    assert (words["--rate"], words["--speedup"]) == ("400", "100")
    assert words["--home"] == (
        f"{SOMEWHERE.latitude_deg},{SOMEWHERE.longitude_deg},{SOMEWHERE.altitude_m},0"
    )
    assert words["--serial0"].startswith("udpclient:127.0.0.1:")
    assert words["--serial1"].startswith("udpclient:127.0.0.1:")
    assert words["--serial0"] != words["--serial1"]
    rows = dict(line.split() for line in Path(words["--defaults"]).read_text().splitlines())
    assert rows["SIM_WIND_SPD"] == "0.123456789"
    assert rows["VISO_TYPE"] == "1"  # by poses
    assert rows["SYSID_THISMAV"] == "1"
    assert (relay.step_hz, relay.attitude_hz) == (400, 200)
    helped = [plane.helped(READINGS, ()) for _ in range(80)]
    assert helped[-1] is not None
    assert process.ended == []
    plane.close()
    relay.close()
    assert process.ended == ["kill", "wait"]


def test_by_satellites_it_needs_no_help(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def launch(_binary: Path, options: tuple[str, ...], _log: Path, _settings: Any) -> Launched:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            port = int(options[options.index("--sim-port-out") + 1])
            client.sendto(outputs(0), ("127.0.0.1", port))
        return Launched()

    monkeypatch.setattr(program, "launch", launch)
    binary = tmp_path / "arduplane"
    binary.write_text("")
    binary.chmod(0o755)
    site = load_site(shipped("sites/hill.toml"))
    plane, relay = ardupilot.start(binary, tmp_path / "run", AIRFRAME, site, {})
    assert not any(plane.helped(READINGS, ()) for _ in range(160))
    assert "VISO_TYPE" not in (tmp_path / "run" / "parameters.parm").read_text()
    plane.close()
    relay.close()


def test_how_long_it_is_waited_for() -> None:
    assert (ardupilot.BOOT_S, ardupilot.PATIENCE_S) == (30.0, 10.0)


def test_it_is_ready_when_its_estimator_is_too() -> None:
    """SYS_STATUS: bit 21 the attitude, bit 28 the checks before arming."""
    assert ardupilot.READY == 1 << 21 | 1 << 28
