"""The module in the air without sockets, for benchmarks: frames in, frames out, tick by tick."""

from __future__ import annotations

from time import perf_counter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER, Recorder
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from

from .hanging import REPORTED

TICK_S = 0.005
WARM_UP = 400


class ModuleFlight:
    """The module in the air, and a vehicle and a station that talk to it."""

    def __init__(self, recorder: Recorder = NO_RECORDER) -> None:
        airframe_path, site_path = (
            shipped("airframes/eclipson_c.toml"),
            shipped("sites/tunnel.toml"),
        )
        airframe, site = load_airframe(airframe_path), load_site(site_path)
        values = load_parameters(airframe, airframe_path, site, site_path).changed(REPORTED)
        self.frames: list[bytes] = []
        self.now_s = 100.0
        self.onboard = Onboard(
            setup_from(airframe, site, values),
            self._take,
            self.now_s,
            ModuleOptions(recorder=recorder),
        )
        self._vehicle = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._reader = mavlink.MAVLink(None)
        self._servos = (1500, 1500, 1500, 1500)
        self._ticks = 0
        self.custom_mode = 0  # MANUAL
        self.quaternion = (1.0, 0.0, 0.0, 0.0)  # of an aircraft that hangs where it is
        self.sends_attitude = self.sends_heartbeat = True

    def _take(self, frame: bytes) -> bool:
        self.frames.append(frame)
        return True

    def ask(self, message: mavlink.MAVLink_message) -> bytes:
        """A frame of the station's."""
        frame = bytes(message.pack(self._station))
        self._station.seq = (self._station.seq + 1) % 256
        return frame

    def receive(self, message: mavlink.MAVLink_message) -> None:
        """A message of the vehicle comes."""
        self.onboard.event(bytes(message.pack(self._vehicle)), self.now_s)

    def _attitude(self, noise: float) -> tuple[float, float, float, float]:
        qw, qx, qy, qz = self.quaternion
        return qw, qx + noise, qy, qz

    def heartbeat(self) -> mavlink.MAVLink_message:
        """The vehicle's, in the mode that it is in."""
        return mavlink.MAVLink_heartbeat_message(1, 3, 81, self.custom_mode, 4, 3)

    def piece(self) -> bytes:
        """All that an autopilot with accelerometers says in one period, in one datagram.

        Its servos do as commanded.
        """
        for frame in self.frames:
            reported = self._reader.decode(bytearray(frame))
            if reported.get_type() == "RC_CHANNELS_OVERRIDE" and reported.chan2_raw:
                self._servos = (
                    reported.chan1_raw,
                    reported.chan2_raw,
                    reported.chan3_raw,
                    reported.chan4_raw,
                )
        self.frames.clear()
        self._ticks += 1
        self.now_s += TICK_S
        ms, i = round(self._ticks * TICK_S * 1e3), self._ticks
        noise = 1e-6 * (ms % 7)  # nothing that is measured repeats itself
        messages = [
            mavlink.MAVLink_raw_imu_message(1000 * ms, i % 10, 0, -1000 + i % 5, *(0,) * 6),
            mavlink.MAVLink_attitude_quaternion_message(ms, *self._attitude(noise), 0, 0, 0),
        ]
        if i % 4 == 1:
            at = mavlink.MAVLink_local_position_ned_message(ms, 0.2, 0, -1.15 + noise, 0, 0, 0)
            servos = mavlink.MAVLink_servo_output_raw_message(
                1000 * ms, 0, *self._servos, 0, 0, 0, 0
            )
            messages = [at, servos, *messages]
        if i % 200 == 1:
            messages = [self.heartbeat(), *messages]
        return b"".join(bytes(message.pack(self._vehicle)) for message in messages)

    def tick(self) -> float:
        """What a vehicle says in one period, then the tick; the tick's time."""
        self._ticks += 1
        self.now_s += TICK_S
        stamp = round(self._ticks * TICK_S * 1e3)
        noise = 1e-6 * (stamp % 7)  # nothing that is measured repeats itself
        messages = []
        if self.sends_attitude:
            messages.append(
                mavlink.MAVLink_attitude_quaternion_message(stamp, *self._attitude(noise), 0, 0, 0)
            )
        if self._ticks % 4 == 1:
            messages.append(
                mavlink.MAVLink_local_position_ned_message(stamp, 0.2, 0, -1.15 + noise, 0, 0, 0)
            )
        if self.sends_heartbeat and self._ticks % 200 == 1:
            messages.append(self.heartbeat())
        for message in messages:
            self.receive(message)
        before = perf_counter()
        if self.onboard.clocking.due(self.now_s):
            self.onboard.periodic(self.now_s)
        return perf_counter() - before

    def engaged(self) -> ModuleFlight:
        """In the air."""
        for _ in range(WARM_UP):
            self.tick()
        self.onboard.event(
            self.ask(mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)), self.now_s
        )
        for _ in range(WARM_UP):
            self.tick()
        assert self.onboard.output is not None
        assert self.onboard.output.active
        self.frames.clear()
        return self
