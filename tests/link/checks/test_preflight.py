"""What a vehicle's parameters must be, asked of vehicles that are set up well, badly, or deaf."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from bench_bridge import AIRFRAME

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.link.autopilot_setup_check import ASK_S, ASK_TIMES
from tgl_soar.link.autopilots import FIRMWARES, flavour
from tgl_soar.link.autopilots.requirements import MUST, Finding, Needs, compare
from tgl_soar.link.checks.preflight import Preflight
from tgl_soar.link.messages import (
    AUTOPILOT_ARDUPILOT,
    AUTOPILOT_PX4,
    MODE_FLAG_CUSTOM_MODE,
    PARAM_TYPE_INT32,
    Heartbeat,
    ParamValue,
)
from tgl_soar.onboard.setup import needs_of, surface_channels
from tgl_soar.sim.firmware.ardupilot import flight_parameters

PLANE = load_airframe(AIRFRAME)
SITE = shipped("sites/tunnel.toml")
CHANNELS = surface_channels(PLANE)
HALL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=True, gps=False)
HILL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
DEFAULTS = {  # of ArduPlane, where our own flights do not change them
    "GPS1_TYPE": 1.0,
    "EK3_SRC1_POSXY": 3.0,
    "EK3_SRC1_POSZ": 1.0,
    "EK3_SRC1_YAW": 1.0,
    "EK3_SRC1_VELXY": 3.0,
    "EK3_SRC1_VELZ": 3.0,
    "VISO_TYPE": 0.0,
    "RCMAP_PITCH": 2.0,
    "RCMAP_ROLL": 1.0,
    "RCMAP_YAW": 4.0,
    "STICK_MIXING": 1.0,
}


def flown(needs: Needs) -> dict[str, float]:
    """An ArduPlane as our own flights set it up."""
    return {**DEFAULTS, **flight_parameters(PLANE, gps=needs.gps)}


def wrong(route: str, needs: Needs, **changes: float) -> list[Finding]:
    """What must be changed of an ArduPlane like ours, but for some changes."""
    rows = flavour("ardupilot", route, CHANNELS, 1).requirements(needs)
    found = compare(rows, {**flown(needs), **changes})
    return [finding for finding in found if not finding.ok and finding.requirement.level == MUST]


@pytest.mark.parametrize("route", ["override", "attitude"])
@pytest.mark.parametrize("needs", [HALL, HILL])
def test_what_we_have_flown_with_is_right(route: str, needs: Needs) -> None:
    assert wrong(route, needs) == []


def test_an_arduplane_that_is_to_land_by_its_mission_must_be_armed_with_one() -> None:
    lands = HILL._replace(lands=True)
    assert wrong("override", lands, RTL_AUTOLAND=2.0) == []
    assert [found.name for found in wrong("override", lands, RTL_AUTOLAND=0.0)] == ["RTL_AUTOLAND"]
    assert wrong("override", HILL, RTL_AUTOLAND=0.0) == []
    values = load_parameters(PLANE, AIRFRAME, load_site(SITE), SITE)
    for by, asked in ((0.0, False), (1.0, True), (2.0, False)):
        assert needs_of(PLANE, load_site(SITE), values.changed({"LND_BY": by})).lands is asked


@pytest.mark.parametrize(
    ("route", "needs", "name", "value"),
    [
        ("override", HALL, "RC_OVERRIDE_TIME", 3.0),
        ("override", HALL, "RC_OVERRIDE_TIME", -1.0),
        ("override", HALL, "RC_OVERRIDE_TIME", 0.0),
        ("override", HALL, "RC_OPTIONS", 2.0),
        ("override", HALL, "RC2_TRIM", 1520.0),
        ("override", HALL, "RCMAP_PITCH", 3.0),
        ("override", HALL, "SERVO1_REVERSED", 1.0),
        ("attitude", HALL, "SERVO1_REVERSED", 1.0),
        ("attitude", HALL, "SERVO2_FUNCTION", 0.0),
        ("attitude", HALL, "EK3_SRC1_YAW", 1.0),
        ("attitude", HALL, "VISO_TYPE", 0.0),
        ("attitude", HILL, "EK3_SRC1_POSXY", 6.0),
        ("attitude", HILL, "GPS1_TYPE", 0.0),
        ("attitude", HILL, "CRASH_DETECT", 1.0),
        ("override", HILL, "FS_SHORT_ACTN", 0.0),
        ("attitude", HILL, "FS_SHORT_ACTN", 3.0),
        ("override", HILL, "FS_LONG_ACTN", 1.0),
        ("attitude", HILL, "FS_LONG_ACTN", 0.0),
        ("override", HILL, "THR_FAILSAFE", 2.0),
        ("override", HILL, "BATT_FS_LOW_ACT", 1.0),
        ("attitude", HILL, "BATT_FS_CRT_ACT", 2.0),
        ("override", HILL, "FENCE_ACTION", 6.0),
    ],
)
def test_each_wrong_one_is_found(route: str, needs: Needs, name: str, value: float) -> None:
    assert [finding.name for finding in wrong(route, needs, **{name: value})] == [name]


def test_the_simulated_pixhawk_knows_a_reversed_surface_from_the_airframe_file() -> None:
    channels = CHANNELS._replace(elevator=CHANNELS.elevator._replace(reversed=True))
    rows = flavour("bridge", None, channels, 1).requirements(HALL)
    names = [finding.name for finding in compare(rows, flown(HALL)) if not finding.ok]
    assert names == []


def test_the_attitude_route_asks_nothing_of_overrides() -> None:
    assert wrong("attitude", HALL, RC_OVERRIDE_TIME=3.0, RC2_TRIM=1520.0) == []


def test_a_reversed_surface_is_reversed_there_too() -> None:
    """Its own modes must move it the right way, and a pulse must pass all the same."""
    channels = CHANNELS._replace(elevator=CHANNELS.elevator._replace(reversed=True))
    rows = flavour("ardupilot", "override", channels, 1).requirements(HALL)
    names = [finding.name for finding in compare(rows, flown(HALL)) if not finding.ok]
    assert names == ["RC2_REVERSED", "SERVO2_REVERSED"]


class Vehicle:
    """Answers as a firmware does, now and then not at all."""

    def __init__(self, parameters: dict[str, float], *, deaf: int = 0) -> None:
        self.parameters = parameters
        self.asked: dict[str, int] = {}
        self._deaf = deaf  # times before it answers

    def ask(self, check: Preflight) -> float:
        """Until the check is through; how long that took [s]."""
        now_s = 5.0
        while not check.done(now_s):
            for request in check.poll(now_s):
                name = request.param_id
                self.asked[name] = self.asked.get(name, 0) + 1
                if name in self.parameters and self.asked[name] > self._deaf:
                    check.take(
                        ParamValue(
                            param_id=name,
                            param_value=self.parameters[name],
                            param_type=9,
                            param_count=1,
                            param_index=0,
                        )
                    )
            now_s += 0.02
        return now_s - 5.0


def check_of(firmware: str = "ardupilot", needs: Needs = HALL) -> Preflight:
    return Preflight(flavour(firmware, None, CHANNELS, 1), needs, 1)


def test_lost_answers_are_asked_for_again() -> None:
    vehicle = Vehicle({**flown(HALL), "EK3_SRC1_YAW": 1.0}, deaf=2)
    check = check_of()
    vehicle.ask(check)
    assert [finding.name for finding in check.wrong()] == ["EK3_SRC1_YAW"]
    assert max(vehicle.asked.values()) == ASK_TIMES  # other releases' names, which it has not
    assert vehicle.asked["VISO_TYPE"] == 3


def test_a_vehicle_that_answers_nothing_is_not_ready() -> None:
    check = check_of()
    assert Vehicle({}).ask(check) >= ASK_S * ASK_TIMES
    assert {"VISO_TYPE", "RC_OVERRIDE_TIME"} <= {finding.name for finding in check.wrong()}
    assert all(f.value is None for f in check.wrong())


def test_must_comes_before_should() -> None:
    check = check_of()
    Vehicle({**flown(HALL), "SCHED_LOOP_RATE": 50.0, "EK3_SRC1_YAW": 1.0}).ask(check)
    assert [finding.name for finding in check.wrong()] == ["EK3_SRC1_YAW", "SCHED_LOOP_RATE"]


@pytest.mark.parametrize(
    ("mine", "high", "refused"), [(255.0, 0.0, False), (250.0, 255.0, False), (250.0, 0.0, True)]
)
def test_whose_overrides_it_takes(mine: float, high: float, refused: bool) -> None:
    check = check_of()
    parameters = {**flown(HALL), "MAV_GCS_SYSID": mine, "MAV_GCS_SYSID_HI": high}
    del parameters["SYSID_MYGCS"]
    Vehicle(parameters).ask(check)
    assert bool(check.refusal()) is refused


def test_whole_numbers_of_px4_are_read_as_their_bytes() -> None:
    check = check_of("px4")
    raw = struct.unpack("<f", struct.pack("<i", 11))[0]
    check.take(
        ParamValue(
            param_id="EKF2_EV_CTRL",
            param_value=raw,
            param_type=PARAM_TYPE_INT32,
            param_count=1,
            param_index=0,
        )
    )
    assert check.answers["EKF2_EV_CTRL"] == 11.0


def test_another_firmware_is_named() -> None:
    check = check_of()
    assert not check.received
    check.take(
        Heartbeat(
            type=1,
            autopilot=AUTOPILOT_PX4,
            base_mode=MODE_FLAG_CUSTOM_MODE,
            custom_mode=0,
            system_status=3,
        )
    )
    assert "not an ArduPilot" in check.mismatch
    check.take(
        Heartbeat(
            type=1,
            autopilot=AUTOPILOT_ARDUPILOT,
            base_mode=MODE_FLAG_CUSTOM_MODE,
            custom_mode=0,
            system_status=3,
        )
    )
    assert check.received
    assert check.mismatch == ""


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_names_are_as_long_as_the_protocol_carries(firmware: str) -> None:
    for needs in (HALL, HILL):
        rows = flavour(firmware, None, CHANNELS, 1).requirements(needs)
        assert all(len(name) <= 16 for row in rows for name in row.names)


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_the_hardware_page_names_every_parameter(firmware: str) -> None:
    """Of channels it names one, and the others by their numbers."""
    page = (Path(__file__).parents[3] / "docs" / "hardware.md").read_text()
    for route in (None, "attitude", "manual_control" if firmware == "px4" else "override"):
        for needs in (HALL, HILL):
            for row in flavour(firmware, route, CHANNELS, 1).requirements(needs):
                name = row.names[0]
                channel = name.startswith(("RC1", "RC2", "RC4", "SERVO"))
                stem = name.rpartition("_")[2] if channel else name
                assert f"{stem}`" in page, name


def test_of_paparazzi_nothing_can_be_read() -> None:
    check = check_of("paparazzi")
    assert check.findings() == []
    assert check.poll(0.0) == []
    assert check.done(0.0)
