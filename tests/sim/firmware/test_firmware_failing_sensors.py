"""Sensors of a firmware that fail: what arrives of their readings, and when."""

from __future__ import annotations

import pytest
from firmware_step import READINGS

from tgl_soar.sim.faults import FIRMWARE_SENSORS, parse_faults
from tgl_soar.sim.firmware.ardupilot import ArduPlanePhysics
from tgl_soar.sim.firmware.failing_sensors import FailingSensors
from tgl_soar.sim.firmware.px4 import Px4Physics, hil_gps
from tgl_soar.sim.firmware.sensors import GpsPlace, Readings, height_of_pressure_m

PLACE = GpsPlace(51.99, 4.375, 12.34, (3.0, -4.0, 0.5))
WITH_FIX = READINGS._replace(gps=PLACE)


def at(time_s: float, *faults: str, readings: Readings = WITH_FIX) -> Readings:
    return FailingSensors(parse_faults(faults)).of(readings._replace(time_s=time_s))


@pytest.mark.parametrize("name", FIRMWARE_SENSORS)
def test_a_sensor_fails_while_its_fault_acts_and_not_before_or_after(name: str) -> None:
    fault = f"{name} start=2 for=3"
    for time_s in (1.99, 5.0):
        assert at(time_s, fault) == WITH_FIX._replace(time_s=time_s)
    assert at(4.0, fault) != WITH_FIX._replace(time_s=4.0)


@pytest.mark.parametrize("name", FIRMWARE_SENSORS)
def test_nothing_new_stays_nothing(name: str) -> None:
    none = READINGS._replace(magnetic_frd_gauss=None, pressure_pa=None, gps=None)
    found = at(4.0, f"{name} start=2", readings=none)
    assert (found.magnetic_frd_gauss, found.pressure_pa, found.gps) == (None, None, None)


def test_what_is_silent_is_the_one_sensor() -> None:
    gone = WITH_FIX._replace(time_s=4.0)
    assert at(4.0, "satellites.silent start=2") == gone._replace(gps=None)
    assert at(4.0, "barometer.silent start=2") == gone._replace(pressure_pa=None)
    assert at(4.0, "compass.silent start=2") == gone._replace(magnetic_frd_gauss=None)


def test_without_a_fix_the_receiver_repeats_where_it_was_last() -> None:
    failing = FailingSensors(parse_faults(["satellites.lost start=2 for=2"]))
    failing.of(WITH_FIX._replace(time_s=1.9))
    moved = WITH_FIX._replace(gps=PLACE._replace(latitude_deg=52.0), time_s=2.5)
    lost = failing.of(moved)
    assert lost.gps == PLACE._replace(velocity_ned_mps=(0.0, 0.0, 0.0))
    assert not lost.gps_fixed
    assert failing.of(moved._replace(gps=None)).gps is None
    again = failing.of(moved._replace(time_s=4.0))
    assert again.gps == moved.gps
    assert again.gps_fixed


def test_a_receiver_without_a_fix_says_so_to_px4() -> None:
    fix, none = hil_gps(PLACE, 0), hil_gps(PLACE, 0, fixed=False)
    assert (fix.fix_type, fix.satellites_visible) == (3, 12)
    assert (none.fix_type, none.satellites_visible) == (1, 0)
    assert none.eph > fix.eph
    assert none.epv > fix.epv


def test_fixes_are_off_by_metres() -> None:
    place = at(4.0, "satellites.bias start=2 north=30 east=-10 down=2").gps
    assert place is not None
    assert place.latitude_deg - PLACE.latitude_deg == pytest.approx(30.0 / 111_250, rel=1e-3)
    assert place.longitude_deg - PLACE.longitude_deg == pytest.approx(-10 / 68_690, rel=3e-3)
    assert place.altitude_m == pytest.approx(PLACE.altitude_m - 2.0)
    assert place.velocity_ned_mps == PLACE.velocity_ned_mps


def test_a_barometer_drifts_from_when_its_fault_begins() -> None:
    was_m = height_of_pressure_m(101200.0)
    found = at(12.0, "barometer.drift start=2 for=99 by=0.02")
    assert found.pressure_pa is not None
    assert height_of_pressure_m(found.pressure_pa) - was_m == pytest.approx(0.2)
    assert found.height_m - was_m == pytest.approx(0.2)
    assert found.pressure_pa < 101200.0


def test_vectors_are_off_in_the_units_of_the_catalogue() -> None:
    found = at(4.0, "compass.bias start=2 x=60 z=-5", "accelerometer.bias start=2 x=3 y=1")
    assert found.magnetic_frd_gauss == pytest.approx((0.26, 0.0, 0.445))
    assert found.force_frd_mps2 == pytest.approx((3.1, 1.2, -9.8))


def test_only_px4_takes_our_readings() -> None:
    assert Px4Physics.reads_ours
    assert not ArduPlanePhysics.reads_ours
