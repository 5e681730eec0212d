"""PX4's simulator interface: our world as the physics behind a real PX4 in software in the loop.

PX4 (`simulator_mavlink`) is the TCP client: the bridge listens on 4560 + its instance.  At every
step it is sent what its sensors read, and answers once with its servos' commands:

    bridge → PX4    HIL_SENSOR (id 0) at every step; its time_usec IS PX4's clock: lockstep
                    HIL_GPS as the receiver gives fixes
                    RC_CHANNELS, the pilot's transmitter, 50 times a second
    PX4 → bridge    HIL_ACTUATOR_CONTROLS: -1 … 1 of each output, all zero while it is disarmed

It answers nothing until its own programs run, so time must go on unanswered at first; and what
does not answer later is waited for, as everything hangs on it.
"""

from __future__ import annotations

import select
import socket
import subprocess
import time
from collections.abc import Collection, Mapping
from math import hypot, isfinite
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import common as mavlink

from tgl_soar.config.airframe import Airframe, Surfaces
from tgl_soar.config.site import Site
from tgl_soar.link.autopilots.px4 import MODE_MANUAL, MODE_OFFBOARD, Px4
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.firmware import FirmwareError, program
from tgl_soar.sim.firmware.relay import FirmwareLink, Relay
from tgl_soar.sim.firmware.sensors import GpsPlace, Readings
from tgl_soar.sim.firmware.simulation import RECEIVED, Sticks
from tgl_soar.types import SurfaceCommand

# Ports of instance 0; every instance has its own, so many higher.
SIMULATOR_PORT: Final = 4560
GROUND_PORT: Final = 18570
COMPANION_PORT: Final = 14580
INSTANCES: Final = range(20, 100)  # low ones are people's own
PLANE: Final = "1030"  # SYS_AUTOSTART: a fixed wing behind simulator_mavlink, in all releases
STEP_HZ: Final = 250
RC_STEPS: Final = 5
BOOT_S: Final = 100.0  # wall: its start is a hundred processes, and a machine may be busy
UTC_US: Final = 1_767_225_600_000_000  # that the simulated GPS reports at time 0: 2026-01-01
UNANSWERED_S: Final = 0.02  # wall: between steps that nothing answers yet
PATIENCE_S: Final = 10.0  # wall: for the answer to one step
MODE_ARMED: Final = 128

INERTIAL: Final = 0b0000_0011_1111  # bits of HIL_SENSOR.fields_updated, three for a vector
MAGNETIC: Final = 0b0001_1100_0000
BAROMETER: Final = 0b1_1010_0000_0000  # absolute pressure, its height, temperature
DIFFERENTIAL: Final = 0b0_0100_0000_0000


class Px4Physics:
    """One PX4 at the other end of a TCP connection."""

    name = "PX4"
    step_hz = STEP_HZ
    first_item = 1  # it has its home by itself
    manual_mode = MODE_MANUAL
    obeys: Mapping[str, int] = {
        "SET_ATTITUDE_TARGET": MODE_OFFBOARD,
        "SET_ACTUATOR_CONTROL_TARGET": MODE_OFFBOARD,
        "MANUAL_CONTROL": MODE_MANUAL,
    }
    codec = Px4.codec
    reads_ours = True

    def __init__(self, surfaces: Surfaces, port: int) -> None:
        """Listens at once.  Errors: `FirmwareError` where the port cannot be had."""
        self.armed = False
        self._steps = 0
        self.answers = 0
        self._channels = tuple(surface.channel for surface in surfaces.driven())
        self._codec: Any = mavlink.MAVLink(None, 1, 1)
        self._codec.robust_parsing = True
        self._connection: socket.socket | None = None
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            self._server.close()
            raise FirmwareError(
                f"TCP port {port}, where PX4 looks for its simulator: {error}"
            ) from None
        self._server.listen(1)
        self.port: int = self._server.getsockname()[1]

    def connect(self, timeout_s: float) -> bool:
        """Wait for PX4; whether it came."""
        if self._connection is None and select.select([self._server], [], [], timeout_s)[0]:
            self._connection, _ = self._server.accept()
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._connection is not None

    def helped(self, _readings: Readings, _texts: Collection[str]) -> Any | None:
        """It needs no help."""
        return None

    def ask_for_mode(self, system: int, mode: int) -> Any:
        """MAV_CMD_DO_SET_MODE."""
        return mavlink.MAVLink_command_long_message(
            target_system=system,
            target_component=1,
            command=mavlink.MAV_CMD_DO_SET_MODE,
            confirmation=0,
            param1=1.0,
            param2=float(mode >> 16),
            param3=0.0,
            param4=0.0,
            param5=0.0,
            param6=0.0,
            param7=0.0,
        )

    throttle = 0.0  # it takes none of ours

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        """One step: what the sensors read, then the servos' commands; neutral at first.

        Errors: `FirmwareError` when PX4 has gone or answers no more.
        """
        messages = [hil_sensor(readings)]
        if readings.gps is not None:
            now_us = _microseconds(readings.time_s)
            messages.append(hil_gps(readings.gps, now_us, fixed=readings.gps_fixed))
        # A receiver that has no signal sends none: PX4 knows a failsafe by its pulses only where
        # RC_FAILS_THR is set to them.
        if self._steps % RC_STEPS == 0 and sticks.signal == RECEIVED:
            messages.append(rc_channels(sticks, round(readings.time_s * 1e3)))
        self._steps += 1
        try:
            return self._exchange(b"".join(message.pack(self._codec) for message in messages))
        except OSError as error:
            raise FirmwareError(f"PX4 has closed the connection: {error.strerror}") from None

    def close(self) -> None:
        """Give the port back."""
        self._server.close()
        if self._connection is not None:
            self._connection.close()

    def _exchange(self, data: bytes) -> SurfaceCommand:
        connection = self._connection
        if connection is None:
            raise FirmwareError("PX4 has not connected")
        connection.sendall(data)
        begun = time.monotonic()
        patience_s = PATIENCE_S if self.answers else UNANSWERED_S
        while (left := patience_s - (time.monotonic() - begun)) > 0.0:
            if not select.select([connection], [], [], left)[0]:
                continue
            received = connection.recv(4096)
            if not received:
                raise FirmwareError("PX4 has closed the connection")
            answered = [
                message
                for message in self._codec.parse_buffer(bytearray(received)) or ()
                if message.get_type() == "HIL_ACTUATOR_CONTROLS"
            ]
            if answered:
                self.answers += 1
                return self._take(answered[-1])
        if self.answers:
            raise FirmwareError(f"PX4 has not answered a step for {PATIENCE_S:g} s")
        return NEUTRAL

    def _take(self, message: Any) -> SurfaceCommand:
        self.armed = message.mode & MODE_ARMED != 0
        outputs = [message.controls[channel - 1] for channel in self._channels]
        return SurfaceCommand(*(value if isfinite(value) else 0.0 for value in outputs))


def hil_sensor(readings: Readings) -> Any:
    """All sensors but the GPS; those without a new reading are marked as not updated."""
    magnetic, pressure = readings.magnetic_frd_gauss, readings.pressure_pa
    differential = readings.differential_pressure_pa
    updated = INERTIAL
    updated |= MAGNETIC if magnetic is not None else 0
    updated |= BAROMETER if pressure is not None else 0
    updated |= DIFFERENTIAL if differential is not None else 0
    force_x, force_y, force_z = readings.force_frd_mps2
    roll_rate, pitch_rate, yaw_rate = readings.rate_frd_radps
    magnetic_x, magnetic_y, magnetic_z = magnetic or (0.0, 0.0, 0.0)
    return mavlink.MAVLink_hil_sensor_message(
        time_usec=_microseconds(readings.time_s),
        xacc=force_x,
        yacc=force_y,
        zacc=force_z,
        xgyro=roll_rate,
        ygyro=pitch_rate,
        zgyro=yaw_rate,
        xmag=magnetic_x,
        ymag=magnetic_y,
        zmag=magnetic_z,
        abs_pressure=0.0 if pressure is None else pressure * 1e-2,
        diff_pressure=0.0 if differential is None else differential * 1e-2,
        pressure_alt=readings.height_m,
        temperature=readings.temperature_c,
        fields_updated=updated,
    )


def hil_gps(place: GpsPlace, time_us: int, *, fixed: bool = True) -> Any:
    """A fix in three dimensions of a dozen satellites; not `fixed`: none, where the last was."""
    north, east, down = (_cm(speed) for speed in place.velocity_ned_mps)
    return mavlink.MAVLink_hil_gps_message(
        time_usec=UTC_US + time_us,
        fix_type=3 if fixed else 1,
        lat=round(place.latitude_deg * 1e7),
        lon=round(place.longitude_deg * 1e7),
        alt=round(place.altitude_m * 1e3),
        eph=60 if fixed else 9999,  # [cm]
        epv=80 if fixed else 9999,
        vel=round(hypot(north, east, down)),
        vn=north,
        ve=east,
        vd=down,
        cog=65535,  # no course: the aircraft may stand over the ground
        satellites_visible=12 if fixed else 0,
    )


def _cm(speed_mps: float) -> int:
    return round(max(-327.0, min(327.0, speed_mps)) * 100.0)


def _microseconds(time_s: float) -> int:
    return round(time_s * 1e6)


def rc_channels(sticks: Sticks, time_ms: int) -> Any:
    """The transmitter: roll, pitch (pulled is low), throttle (closed), yaw, mode switch."""
    elevator, aileron, rudder, _ = sticks.deflections
    pulses = [
        round(1500.0 + 500.0 * max(-1.0, min(1.0, stick))) for stick in (aileron, -elevator, rudder)
    ]
    channels = [pulses[0], pulses[1], 1000, pulses[2], 2000 if sticks.takes else 1000]
    return mavlink.MAVLink_rc_channels_message(time_ms, 8, *channels, *[1500] * 13, 255)


# --- its parameters, and its process ---------------------------------------------------------


def output_parameters(surfaces: Surfaces) -> dict[str, float]:
    """Parameters that put the three surfaces on the channels of the airframe file.

    Of PX4's control surfaces a positive deflection turns the aircraft nose up, right wing down
    and nose right, as ours do.
    """
    parameters: dict[str, float] = {"CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 0, "CA_SV_CS_COUNT": 3}
    for i, (surface, kind, axis) in enumerate(
        zip(surfaces.driven(), (3, 15, 4), ("P", "R", "Y"), strict=True)
    ):
        parameters[f"CA_SV_CS{i}_TYPE"] = kind  # elevator, single aileron, rudder
        for other in "RPY":
            parameters[f"CA_SV_CS{i}_TRQ_{other}"] = float(other == axis)
        parameters[f"PWM_MAIN_FUNC{surface.channel}"] = 201 + i
    return parameters


def flight_parameters(airframe: Airframe, *, gps: bool, by_sticks: bool) -> dict[str, float]:
    """All that PX4 is set to: gps: its position comes from satellites, else from poses that a
    companion forwards; by_sticks: a companion commands it with MANUAL_CONTROL."""
    external = {} if gps else POSE_PARAMETERS
    source = {"COM_RC_IN_MODE": 6 if by_sticks else 0}  # MAVLink before radio, or radio alone
    system = {"MAV_SYS_ID": airframe.autopilot.system_id}
    return {
        **BENCH,
        **GAINS,
        **output_parameters(airframe.surfaces),
        **external,
        **source,
        **system,
    }


# Nothing here disarms, terminates or flies home an aircraft without a propeller.
BENCH: Final[Mapping[str, float]] = {
    "SDLOG_MODE": -1,
    "CBRK_SUPPLY_CHK": 894281,
    "COM_LOW_BAT_ACT": 0,
    "COM_DISARM_LAND": -1,
    "COM_DISARM_PRFLT": -1,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 1,  # Hold
    "COM_RCL_EXCEPT": 4,  # not in OFFBOARD
    "GF_ACTION": 0,
    "FD_FAIL_P": 0,
    "FD_FAIL_R": 0,
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 2,  # Stabilized: the pilot's
    "COM_RC_LOSS_T": 0.5,
    "RC_CHAN_CNT": 8,
    "RC_MAP_ROLL": 1,
    "RC_MAP_PITCH": 2,
    "RC_MAP_THROTTLE": 3,
    "RC_MAP_YAW": 4,
    "RC_MAP_FLTMODE": 5,
    "COM_FLTMODE1": 0,  # Manual
    "COM_FLTMODE6": 8,  # Stabilized
    "EKF2_GPS_DELAY": 100,
    "EKF2_FUSE_BETA": 0,
    "EKF2_ARSP_THR": 5.0,
}
POSE_PARAMETERS: Final[Mapping[str, float]] = {
    "SYS_HAS_GPS": 0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_EV_CTRL": 11,  # position, height and yaw
    "EKF2_EV_DELAY": 0,
    "EKF2_HGT_REF": 3,
    "EKF2_MAG_TYPE": 5,
    "COM_ARM_WO_GPS": 1,
}
# Of the inner loops, found by flying the aircraft of the airframe file: pitch within 0.2 s.
GAINS: Final[Mapping[str, float]] = {
    "FW_AIRSPD_MIN": 7.0,
    "FW_AIRSPD_TRIM": 8.7,
    "FW_AIRSPD_MAX": 14.0,
    "FW_AIRSPD_STALL": 6.0,
    "FW_PSP_OFF": 0.0,
    "FW_MAN_P_MAX": 15.0,
    "TRIM_PITCH": 0.0,
    "IMU_GYRO_CUTOFF": 100.0,
    "FW_P_TC": 0.07,
    "FW_P_RMAX_POS": 180.0,
    "FW_P_RMAX_NEG": 180.0,
    "FW_PR_P": 0.45,
    "FW_PR_I": 1.0,
    "FW_PR_FF": 0.5,
    "FW_R_TC": 0.2,
    "FW_RR_P": 0.08,
    "FW_RR_I": 0.2,
    "FW_RR_FF": 0.25,
    "FW_YR_P": 0.2,
    "FW_YR_I": 0.1,
    "FW_YR_FF": 0.3,
}


class Px4Program(Px4Physics):
    """A PX4 of our own, started with its links relayed.

    Ends with the process that made it.
    """

    def __init__(
        self, binary: Path, folder: Path, surfaces: Surfaces, parameters: Mapping[str, float]
    ) -> None:
        """`folder`: where it keeps its parameters, emptied first.  Errors: `FirmwareError`."""
        files = binary.parent.parent / "etc"
        program.require(binary)
        if not (files / "init.d-posix" / "rcS").is_file():
            raise FirmwareError(
                f"{binary}: no {files}/init.d-posix/rcS beside it, as a build has it"
            )
        for instance in INSTANCES:
            try:
                super().__init__(surfaces, SIMULATOR_PORT + instance)
                break
            except FirmwareError:
                if instance == INSTANCES[-1]:
                    raise
        self.instance = instance
        folder.mkdir(parents=True, exist_ok=True)
        for kept in ("parameters.bson", "parameters_backup.bson", "dataman"):
            (folder / kept).unlink(missing_ok=True)
        settings = {f"PX4_PARAM_{name}": f"{value:g}" for name, value in parameters.items()}
        log = folder / "px4.log"
        self._process = program.launch(
            binary,
            ("-i", str(instance), "-d", str(files.resolve())),
            log,
            {"PX4_SYS_AUTOSTART": PLANE, **settings},
        )
        if not self.connect(BOOT_S):
            self.close()
            raise FirmwareError(f"PX4 does not come: see {log}")

    def relay(self, system: int) -> Relay:
        """Its links to a ground station and to a companion."""
        return Relay(
            system,
            self.step_hz,
            FirmwareLink(("127.0.0.1", GROUND_PORT + self.instance)),
            FirmwareLink(("127.0.0.1", COMPANION_PORT + self.instance)),
        )

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        super().close()


def start(
    binary: Path, folder: Path, airframe: Airframe, site: Site, parameters: Mapping[str, float]
) -> tuple[Px4Program, Relay]:
    """A PX4 set up for an airframe, a site and what differs.  Errors: `FirmwareError`, OSError."""
    by_sticks = airframe.autopilot.route == "manual_control"
    usual = flight_parameters(airframe, gps=site.mocap is None, by_sticks=by_sticks)
    px4 = Px4Program(binary, folder, airframe.surfaces, {**usual, **parameters})
    return px4, px4.relay(airframe.autopilot.system_id)
