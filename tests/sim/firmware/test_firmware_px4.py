"""PX4's simulator interface against a stand-in for PX4: a small TCP client, no firmware."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from firmware_step import AIRFRAME, NO_STICKS, READINGS, leg
from pymavlink.dialects.v20 import common as mavlink

from tgl_soar.config.files import shipped
from tgl_soar.link.autopilots.px4 import MODE_OFFBOARD
from tgl_soar.sim.firmware import FirmwareError, px4
from tgl_soar.sim.firmware.px4 import (
    Px4Physics,
    Px4Program,
    flight_parameters,
    hil_gps,
    hil_sensor,
    output_parameters,
    rc_channels,
)
from tgl_soar.sim.firmware.sensors import GpsPlace
from tgl_soar.sim.firmware.simulation import Sticks
from tgl_soar.sim.sitl import fly, passed
from tgl_soar.types import SurfaceCommand

MODE_HOLD = 4 << 16 | 3 << 24
BARE = READINGS._replace(magnetic_frd_gauss=None, pressure_pa=None, differential_pressure_pa=None)


class FakePx4(threading.Thread):
    """Connects, and answers every HIL_SENSOR after the first `mute` ones."""

    def __init__(self, port: int, controls: list[float], *, mute: int = 0, ends_after: int = 0):
        super().__init__(daemon=True)
        self.received: list[Any] = []
        self._controls, self._mute, self._ends_after = controls, mute, ends_after
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=5.0)

    def run(self) -> None:
        codec = mavlink.MAVLink(None, 1, 1)
        codec.robust_parsing = True
        steps = 0
        with self._socket:
            while True:
                try:
                    data = self._socket.recv(4096)
                except OSError:
                    return
                if not data:
                    return
                for message in codec.parse_buffer(bytearray(data)) or ():
                    self.received.append(message)
                    if message.get_type() != "HIL_SENSOR":
                        continue
                    steps += 1
                    if steps == self._ends_after:
                        return
                    if steps > self._mute:
                        answer = mavlink.MAVLink_hil_actuator_controls_message(
                            message.time_usec, self._controls, 128 | 1, 1
                        )
                        self._socket.sendall(answer.pack(codec))


@pytest.fixture
def physics() -> Iterator[Px4Physics]:
    made = Px4Physics(AIRFRAME.surfaces, 0)
    yield made
    made.close()


def controls(**by_channel: float) -> list[float]:
    values = [0.0] * 16
    for name, value in by_channel.items():
        values[int(name[1:]) - 1] = value
    return values


def connected(physics: Px4Physics, values: list[float], **kinds: int) -> FakePx4:
    fake = FakePx4(physics.port, values, **kinds)
    fake.start()
    assert physics.connect(5.0)
    return fake


def test_every_step_is_answered_with_the_outputs_of_the_airframe_files_channels(
    physics: Px4Physics,
) -> None:
    # Elevator on channel 2, aileron on 1, rudder on 4.
    fake = connected(physics, controls(c1=0.1, c2=-0.2, c4=0.3, c3=0.9))
    for i in range(20):
        reading = READINGS._replace(time_s=1.0 + 0.004 * i)
        answer = physics.exchange(reading, NO_STICKS)
        assert answer == pytest.approx((-0.2, 0.1, 0.3, 0.0))
    assert physics.armed
    assert physics.answers == 20
    stamps = [m.time_usec for m in fake.received if m.get_type() == "HIL_SENSOR"]
    assert stamps == [1_000_000 + 4_000 * i for i in range(20)]
    assert sum(m.get_type() == "RC_CHANNELS" for m in fake.received) == 4


def test_time_goes_on_unanswered_until_the_firmware_runs(
    physics: Px4Physics, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(px4, "UNANSWERED_S", 0.001)
    connected(physics, controls(c2=0.5), mute=3)
    answers = [physics.exchange(READINGS, NO_STICKS).elevator for _ in range(3)]
    assert answers == [0.0, 0.0, 0.0]
    monkeypatch.setattr(px4, "UNANSWERED_S", 5.0)
    assert physics.exchange(READINGS, NO_STICKS).elevator == 0.5


def test_what_is_not_a_number_leaves_a_surface_neutral(physics: Px4Physics) -> None:
    connected(physics, controls(c1=float("nan"), c2=0.25))
    assert physics.exchange(READINGS, NO_STICKS) == (0.25, 0.0, 0.0, 0.0)


def test_an_end_of_the_firmware_is_reported(physics: Px4Physics) -> None:
    connected(physics, controls(), ends_after=2)
    physics.exchange(READINGS, NO_STICKS)
    with pytest.raises(FirmwareError, match="closed the connection"):
        physics.exchange(READINGS, NO_STICKS)


def test_a_firmware_that_hangs_is_reported(
    physics: Px4Physics, monkeypatch: pytest.MonkeyPatch
) -> None:
    connected(physics, controls())
    physics.exchange(READINGS, NO_STICKS)
    monkeypatch.setattr(px4, "PATIENCE_S", 0.0)
    with pytest.raises(FirmwareError, match="not answered a step for 0 s"):
        physics.exchange(READINGS, NO_STICKS)


def test_a_step_without_a_firmware_is_refused(physics: Px4Physics) -> None:
    with pytest.raises(FirmwareError, match="has not connected"):
        physics.exchange(READINGS, NO_STICKS)


def test_a_port_in_use_is_named(physics: Px4Physics) -> None:
    with pytest.raises(FirmwareError, match=f"TCP port {physics.port}"):
        Px4Physics(AIRFRAME.surfaces, physics.port)


def test_only_new_readings_are_marked_as_updated() -> None:
    """Bits of HIL_SENSOR_UPDATED_FLAGS."""
    flags = {
        name: getattr(mavlink, f"HIL_SENSOR_UPDATED_{name}")
        for name in (
            "XACC",
            "ZGYRO",
            "XMAG",
            "ZMAG",
            "ABS_PRESSURE",
            "DIFF_PRESSURE",
            "TEMPERATURE",
        )
    }
    every, few = hil_sensor(READINGS).fields_updated, hil_sensor(BARE).fields_updated
    assert all(every & flag for flag in flags.values())
    assert few & flags["XACC"]
    assert few & flags["ZGYRO"]
    assert few == 0x3F
    reported = hil_sensor(READINGS)
    assert (reported.abs_pressure, reported.diff_pressure) == pytest.approx((1012.0, 0.44))  # hPa


def test_gps_is_reported_in_the_units_of_its_message() -> None:
    fix = hil_gps(GpsPlace(51.99, 4.375, 12.34, (1.5, -2.0, 0.25)), 5_000_000)
    assert (fix.lat, fix.lon, fix.alt) == (519900000, 43750000, 12340)
    assert (fix.vn, fix.ve, fix.vd) == (150, -200, 25)
    assert fix.vel == 251
    assert fix.fix_type == 3


def test_the_pilots_sticks_move_as_px4_reads_them() -> None:
    """Pulled back (nose up) is low on the pitch channel; beyond full is full."""
    reported = rc_channels(Sticks(SurfaceCommand(0.5, -0.25, 3.0), takes=True), 0)
    assert reported.chan1_raw == 1375
    assert reported.chan2_raw == 1250
    assert reported.chan3_raw == 1000
    assert reported.chan4_raw == 2000
    assert reported.chan5_raw == 2000


def test_surfaces_are_put_on_the_airframe_files_channels() -> None:
    parameters = output_parameters(AIRFRAME.surfaces)
    assert parameters["PWM_MAIN_FUNC2"] == 201  # elevator
    assert parameters["PWM_MAIN_FUNC1"] == 202
    assert parameters["PWM_MAIN_FUNC4"] == 203
    assert parameters["CA_SV_CS0_TRQ_P"] == 1.0
    assert parameters["CA_SV_CS1_TRQ_R"] == 1.0
    assert parameters["CA_SV_CS2_TRQ_Y"] == 1.0
    assert sum(value for name, value in parameters.items() if "_TRQ_" in name) == 3.0


def test_without_satellites_it_is_set_to_fuse_poses() -> None:
    without = flight_parameters(AIRFRAME, gps=False, by_sticks=False)
    assert (without["EKF2_EV_CTRL"], without["EKF2_HGT_REF"]) == (11, 3)
    assert (without["EKF2_MAG_TYPE"], without["EKF2_GPS_CTRL"]) == (5, 0)
    assert without["COM_RC_IN_MODE"] == 0
    with_gps = flight_parameters(AIRFRAME, gps=True, by_sticks=True)
    assert "EKF2_EV_CTRL" not in with_gps
    assert with_gps["COM_RC_IN_MODE"] == 6


def test_a_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FirmwareError, match="there is no program"):
        Px4Program(tmp_path / "px4", tmp_path, AIRFRAME.surfaces, {})
    alone = tmp_path / "bin" / "px4"
    alone.parent.mkdir()
    alone.write_text("")
    alone.chmod(0o755)
    with pytest.raises(FirmwareError, match="rcS beside it"):
        Px4Program(alone, tmp_path, AIRFRAME.surfaces, {})


REAL = pytest.mark.skipif(
    "TGL_SOAR_PX4" not in os.environ,
    reason="needs a real PX4: set TGL_SOAR_PX4 to its program",
)


@REAL
@pytest.mark.parametrize("route", ["attitude", "manual_control"])
def test_a_leg_through_a_real_px4(tmp_path: Path, route: str) -> None:
    flight = fly(
        leg(
            tmp_path,
            "px4",
            os.environ["TGL_SOAR_PX4"],
            route,
            stay_s=8.0,
            mocap_options=("--mocap-rate=125",),  # of its 250 steps a second
        ),
        lambda _: None,
    )
    assert passed(flight)


@REAL
@pytest.mark.parametrize("exempt", [True, False])
def test_a_radio_that_is_lost_in_offboard_on_a_real_px4(tmp_path: Path, exempt: bool) -> None:
    """Set up as preflight asks, the module flies on.  Else PX4 circles, and the module disengages
    from it: OFFBOARD does not return with the radio when nothing commands it."""
    fails_s = 30.0
    options = replace(
        leg(tmp_path, "px4", os.environ["TGL_SOAR_PX4"], "attitude", stay_s=30.0),
        site=shipped("sites/hill.toml"),
        mocap=False,
        faults=(f"transmitter.silent start={fails_s:g} for=2",),
        autopilot_parameters=() if exempt else ("COM_RCL_EXCEPT=0",),
        settings=() if exempt else (("OP_FORCE", 1.0),),  # the module refuses that
        watch_s=5.0,
    )
    flight = fly(options, lambda _: None)
    after = flight.truth["time_s"] > fails_s
    modes = flight.truth["mode"][after]
    log = (tmp_path / "module.log").read_text()
    if exempt:
        assert (modes == MODE_OFFBOARD).all()
        assert flight.truth["flying"][after].all()
        assert passed(flight)
    else:
        changes = modes[:1].tolist() + modes[1:][modes[1:] != modes[:-1]].tolist()
        assert changes == [MODE_OFFBOARD, MODE_HOLD]
        assert "released: autopilot in failsafe" in log
