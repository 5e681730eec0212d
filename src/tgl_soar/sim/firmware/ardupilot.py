"""ArduPlane's simulator interface: our world as the physics behind a real ArduPlane.

Its software in the loop with `--model JSON` sends the servos' commands to a UDP port, here
one of ours, and stands still until it is sent where the aircraft is then:

    ArduPlane → bridge    magic 18458, frame rate, frame count, 16 pulse widths; little-endian
    bridge → ArduPlane    a line of JSON: time, specific force and rates, position, velocity,
                          attitude, airspeed, the pilot's transmitter

The lines' numbers are the truth: it makes its own barometer, magnetometer, GPS and pitot tube of
them, with its own noise (SIM_…).  Its parser looks for names by text: no space may stand
behind a colon, nor may a name stand in an earlier one.  Time is ours: the timestamp moves
its clock.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Airframe, Surfaces
from tgl_soar.config.site import HomePosition, Site
from tgl_soar.link.autopilots.ardupilot import (
    FUNCTIONS,
    MODE_FBWA,
    MODE_GUIDED,
    MODE_MANUAL,
    RCIN,
    THROTTLE,
    ArduPilot,
)
from tgl_soar.sim.channels import (
    NEUTRAL,
    command_of,
    deflection_from_pwm,
    deflections_of,
    pwm_from_deflection,
    throttle_from_pwm,
)
from tgl_soar.sim.firmware import FirmwareError, program
from tgl_soar.sim.firmware.relay import FirmwareLink, Relay
from tgl_soar.sim.firmware.sensors import SOMEWHERE, Readings
from tgl_soar.sim.firmware.simulation import NO_PULSES, THROTTLE_LOW, Sticks
from tgl_soar.sim.ports import Address
from tgl_soar.sim.sensor_messages import geodetic
from tgl_soar.types import SurfaceCommand

MAGIC: Final = 18458
SERVOS: Final = struct.Struct("<HHI16H")
STEP_HZ: Final = 400
ATTITUDE_HZ: Final = 200
BOOT_S: Final = 30.0
PATIENCE_S: Final = 10.0  # wall: for the answer to one step
SEED_STEPS: Final = 80  # between two GPS fixes that help it start
POSES_USED: Final = "using external nav data"
GPS_WEEK: Final = 2400
SPEEDUP: Final = 100  # of real time, at most: so that it waits for nobody but us
MODE_CHANNEL: Final = 8
THROTTLE_CHANNEL: Final = 3
RC_CHANNELS: Final = 8
THROTTLE_LOST_US: Final = 900  # below THR_FS_VALUE, 950
# Before its estimator has aligned a simpler one takes its place, and it could be armed.
READY: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_AHRS


class ArduPlanePhysics:
    """One ArduPlane at the other end of a UDP socket."""

    name = "ArduPlane"
    step_hz = STEP_HZ
    first_item = 0
    manual_mode = MODE_MANUAL
    obeys: Mapping[str, int] = {
        "RC_CHANNELS_OVERRIDE": MODE_MANUAL,
        "SET_ATTITUDE_TARGET": MODE_GUIDED,
    }
    codec = ArduPilot.codec
    reads_ours = False

    def __init__(
        self, surfaces: Surfaces, home: HomePosition | None = None, *, by_poses: bool = False
    ) -> None:
        """`by_poses`: its position comes from poses that a companion forwards, not from GPS."""
        self._home = SOMEWHERE if home is None else home
        self._by_poses = by_poses
        self._helps = 0
        self._file = surfaces
        self._surfaces = surfaces.driven()
        self._remote: Address | None = None
        self._frame = -1
        self._pulses: tuple[int, ...] = ()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]

    def connect(self, timeout_s: float) -> bool:
        """Wait for its first outputs; whether they came."""
        return self._receive(timeout_s)

    def helped(self, readings: Readings, texts: Collection[str]) -> Any | None:
        """GPS fixes until its estimator has begun with them and uses poses instead."""
        if not self._by_poses or any(POSES_USED in text for text in texts):
            return None
        self._helps += 1
        if self._helps % SEED_STEPS:
            return None
        return gps_input(self._home, readings)

    def ask_for_mode(self, system: int, custom_mode: int) -> Any:
        """MAV_CMD_DO_SET_MODE."""
        nothing = (0.0, 0.0, 0.0, 0.0, 0.0)
        return mavlink.MAVLink_command_long_message(
            system, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, float(custom_mode), *nothing
        )

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        """One step: where the aircraft is, then the servos' commands.

        Errors: `FirmwareError` when it has gone.
        """
        assert self._remote is not None
        self._socket.sendto(state_line(readings, self._transmitter(sticks)), self._remote)
        if not self._receive(PATIENCE_S):
            raise FirmwareError(f"ArduPlane has not answered a step for {PATIENCE_S:g} s")
        return self._reported()

    @property
    def throttle(self) -> float:
        """What a propeller's motor is commanded, 0 … 1; 0 without one."""
        motor = self._file.throttle
        if motor is None or not self._pulses:
            return 0.0
        return throttle_from_pwm(motor, self._pulses[motor.channel - 1])

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _receive(self, timeout_s: float) -> bool:
        """The next outputs; those that it repeats, as it received nothing for a while, are old."""
        until = time.monotonic() + timeout_s
        while (left := until - time.monotonic()) > 0.0:
            if not select.select([self._socket], [], [], left)[0]:
                continue
            data, sender = self._socket.recvfrom(2048)
            if len(data) != SERVOS.size:
                continue
            magic, _, frame, *pulses = SERVOS.unpack(data)
            if magic == MAGIC and (frame != self._frame or sender != self._remote):
                self._frame, self._remote, self._pulses = frame, sender, tuple(pulses)
                return True
        return False

    def _reported(self) -> SurfaceCommand:
        """Outputs are zero until its channels are set up."""
        pulses = [self._pulses[surface.channel - 1] for surface in self._surfaces]
        if not all(pulses):
            return NEUTRAL
        each = [deflection_from_pwm(s, p) for s, p in zip(self._surfaces, pulses, strict=True)]
        return command_of(self._file, each)

    def _transmitter(self, sticks: Sticks) -> list[int]:
        """Pulse widths of the pilot's channels; none: the receiver sends none."""
        if sticks.signal == NO_PULSES:
            return []
        channels = [1500] * RC_CHANNELS
        if sticks.signal == THROTTLE_LOW:
            channels[THROTTLE_CHANNEL - 1] = THROTTLE_LOST_US
            channels[MODE_CHANNEL - 1] = 1900  # as it was
            return channels
        channels[THROTTLE_CHANNEL - 1] = 1000
        channels[MODE_CHANNEL - 1] = 1000 if sticks.takes else 1900
        each = deflections_of(self._file, sticks.deflections)
        for surface, stick in zip(self._surfaces, each, strict=True):
            if surface.channel <= RC_CHANNELS:
                channels[surface.channel - 1] = pwm_from_deflection(surface, stick)
        return channels


def state_line(readings: Readings, transmitter: list[int]) -> bytes:
    """One line of its protocol."""
    motion = readings.motion
    state = {
        "timestamp": round(readings.time_s, 6),
        "imu": {"gyro": readings.rate_frd_radps, "accel_body": readings.force_frd_mps2},
        "position": motion.position_ned_m,
        "quaternion": motion.attitude,
        "velocity": motion.velocity_ned_mps,
        "airspeed": motion.airspeed_mps,
        "rc": {f"rc_{i}": pulse for i, pulse in enumerate(transmitter, 1)},
    }
    return b"\n" + json.dumps(state, separators=(",", ":")).encode() + b"\n"


def gps_input(home: HomePosition, readings: Readings) -> Any:
    """GPS_INPUT: a fix at the aircraft's place."""
    motion = readings.motion
    latitude, longitude, altitude = geodetic(home, *motion.position_ned_m)
    north, east, down = motion.velocity_ned_mps
    return mavlink.MAVLink_gps_input_message(
        time_usec=round(readings.time_s * 1e6),
        gps_id=0,
        ignore_flags=0,
        time_week_ms=round(readings.time_s * 1e3) % 604_800_000,
        time_week=GPS_WEEK,
        fix_type=3,
        lat=round(latitude * 1e7),
        lon=round(longitude * 1e7),
        alt=altitude,
        hdop=0.7,
        vdop=0.7,
        vn=north,
        ve=east,
        vd=down,
        speed_accuracy=0.1,
        horiz_accuracy=0.2,
        vert_accuracy=0.3,
        satellites_visible=12,
    )


# --- its parameters, and its process ---------------------------------------------------------


def channel_parameters(surfaces: Surfaces) -> dict[str, float]:
    """Stick and servo of every surface alike, so that an override passes as it was meant."""
    parameters: dict[str, float] = {"SERVO3_FUNCTION": 0}
    functions = list(FUNCTIONS)
    if surfaces.brake is not None:
        functions.append(RCIN + surfaces.brake.channel)
    if surfaces.brake_throw != 0.0:
        functions[1] = RCIN + surfaces.aileron.channel
    for surface, function in zip(surfaces.driven(), functions, strict=True):
        for prefix in ("RC", "SERVO"):
            name = f"{prefix}{surface.channel}"
            parameters[f"{name}_MIN"] = surface.pwm_min
            parameters[f"{name}_TRIM"] = surface.pwm_trim
            parameters[f"{name}_MAX"] = surface.pwm_max
            parameters[f"{name}_REVERSED"] = surface.reversed
        parameters[f"RC{surface.channel}_DZ"] = 0
        parameters[f"SERVO{surface.channel}_FUNCTION"] = function
    if (motor := surfaces.throttle) is not None:
        parameters["RCMAP_THROTTLE"] = motor.channel
        parameters[f"SERVO{motor.channel}_FUNCTION"] = THROTTLE
        for prefix in ("RC", "SERVO"):
            parameters[f"{prefix}{motor.channel}_MIN"] = motor.pwm_min
            parameters[f"{prefix}{motor.channel}_MAX"] = motor.pwm_max
    return parameters


def flight_parameters(airframe: Airframe, *, gps: bool) -> dict[str, float]:
    """All that it is set to; gps: its position comes from satellites, else from poses that a
    companion forwards."""
    own = {
        "SYSID_THISMAV": airframe.autopilot.system_id,
        "SYSID_MYGCS": airframe.autopilot.override_system_id,
    }
    external = {} if gps else POSE_PARAMETERS
    return {**BENCH, **GAINS, **channel_parameters(airframe.surfaces), **external, **own}


# Nothing takes the aircraft from whoever flies it; a lost radio glides, as preflight asks for.
BENCH: Final[Mapping[str, float]] = {
    "SCHED_LOOP_RATE": 400,
    "SERIAL2_PROTOCOL": -1,  # what would wait for a client
    "SR0_EXT_STAT": 2,  # what it sends ground stations unasked
    "SR0_POSITION": 4,
    "SR0_EXTRA1": 4,
    "SR0_EXTRA2": 4,
    "SR0_RC_CHAN": 2,
    "RC_OVERRIDE_TIME": 0.5,
    "RC_OPTIONS": 32,
    "FLTMODE_CH": MODE_CHANNEL,
    **{f"FLTMODE{i}": MODE_FBWA for i in range(1, 6)},
    "FLTMODE6": MODE_MANUAL,
    "THR_FAILSAFE": 1,
    "FS_SHORT_ACTN": 2,
    "FS_LONG_ACTN": 2,
    "FENCE_ACTION": 0,
    "FS_GCS_ENABL": 0,
    "ARMING_RUDDER": 0,
    "ARMING_CHECK": 6,  # barometer and compass: others judge how fast this computer is
    "BRD_SAFETY_DEFLT": 0,
    "LOG_DISARMED": 0,
    "LOG_BACKEND_TYPE": 0,
    "ARSPD_SKIP_CAL": 1,  # it boots in the wind
    "ARSPD_OFFSET": 2013,
    "ARSPD_RATIO": 2,
    "ARSPD_USE": 1,
    "CRASH_DETECT": 0,
    # Accelerometers count as calibrated where their offsets are not nought.
    **{f"INS_ACC{n}OFFS_{axis}": 0.001 for n in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{n}SCAL_{axis}": 1.001 for n in ("", "2") for axis in "XYZ"},
}
POSE_PARAMETERS: Final[Mapping[str, float]] = {
    "VISO_TYPE": 1,
    "VISO_DELAY_MS": 0,
    "EK3_SRC1_POSXY": 6,
    "EK3_SRC1_VELXY": 0,
    "EK3_SRC1_POSZ": 6,
    "EK3_SRC1_VELZ": 0,
    "EK3_SRC1_YAW": 6,
    "GPS1_TYPE": 14,  # by MAVLink: only until poses are used
}
# Of the inner loops, for the aircraft of the airframe file.
GAINS: Final[Mapping[str, float]] = {
    "AIRSPEED_MIN": 7,
    "AIRSPEED_CRUISE": 9,
    "AIRSPEED_MAX": 15,
    "SCALING_SPEED": 8.7,
    "PTCH_LIM_MIN_DEG": -15,
    "PTCH_LIM_MAX_DEG": 12,
    "PTCH2SRV_TCONST": 0.15,
    "PTCH2SRV_RMAX_UP": 0,
    "PTCH2SRV_RMAX_DN": 0,
    "PTCH_RATE_FF": 0.54,
    "PTCH_RATE_P": 0.25,
    "PTCH_RATE_I": 0.5,
    "PTCH_RATE_D": 0.0,
    "RLL2SRV_TCONST": 0.2,
    "RLL_RATE_FF": 0.23,
    "RLL_RATE_P": 0.1,
    "RLL_RATE_I": 0.2,
    "RLL_RATE_D": 0.0,
    "STALL_PREVENTION": 0,
}


class ArduPlane(ArduPlanePhysics):
    """An ArduPlane of our own, started with its links relayed.

    Ends with the process that made it.
    """

    def __init__(
        self,
        binary: Path,
        folder: Path,
        surfaces: Surfaces,
        parameters: Mapping[str, float],
        home: HomePosition | None,
        *,
        by_poses: bool,
    ) -> None:
        """`folder`: where it keeps its parameters, emptied first.  Errors: `FirmwareError`."""
        program.require(binary)
        super().__init__(surfaces, home, by_poses=by_poses)
        folder.mkdir(parents=True, exist_ok=True)
        defaults = folder / "parameters.parm"
        defaults.write_text("".join(f"{n} {v:.9g}\n" for n, v in parameters.items()))
        self._ground, self._companion = FirmwareLink(None), FirmwareLink(None)
        at = self._home
        options = (
            *("--wipe", "--model", "JSON:127.0.0.1"),
            *("--sim-port-out", str(self.port)),
            *("--rate", str(STEP_HZ), "--speedup", str(SPEEDUP)),
            *("--home", f"{at.latitude_deg},{at.longitude_deg},{at.altitude_m},0"),
            *("--defaults", str(defaults.resolve())),
            *("--serial0", _client(self._ground)),
            *("--serial1", _client(self._companion)),
        )
        log = folder / "arduplane.log"
        self._process = program.launch(binary, options, log, {})
        if not self.connect(BOOT_S):
            self.close()
            raise FirmwareError(f"ArduPlane does not come: see {log}")

    def relay(self, system: int) -> Relay:
        """Its links to a ground station and to a companion."""
        return Relay(
            system,
            self.step_hz,
            self._ground,
            self._companion,
            attitude_hz=ATTITUDE_HZ,
            ready=READY,
            has_threads=False,
        )

    def close(self) -> None:
        """End it; while it waits for our next step it takes no request to end."""
        self._process.kill()
        self._process.wait()
        super().close()


def _client(link: FirmwareLink) -> str:
    return f"udpclient:{link.local[0]}:{link.local[1]}"


def start(
    binary: Path, folder: Path, airframe: Airframe, site: Site, parameters: Mapping[str, float]
) -> tuple[ArduPlane, Relay]:
    """An ArduPlane set up for an airframe, a site and what differs.

    Errors: `FirmwareError`, OSError.
    """
    usual = flight_parameters(airframe, gps=site.mocap is None)
    plane = ArduPlane(
        binary,
        folder,
        airframe.surfaces,
        {**usual, **parameters},
        site.position.home,
        by_poses=site.mocap is not None,
    )
    return plane, plane.relay(airframe.autopilot.system_id)
