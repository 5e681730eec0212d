"""What PX4's parameters must be, held against right and wrong ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from tgl_soar.config.files import load_airframe
from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.autopilots.requirements import MUST, Finding, Needs, compare, remedy
from tgl_soar.sim.firmware.px4 import flight_parameters

AIRFRAME = load_airframe(Path(__file__).parents[3] / "config/airframes/eclipson_c.toml")
CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
HALL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=True, gps=False)
HILL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
DEFAULTS = {  # of the firmware, as a fixed wing
    "MAV_TYPE": 1.0,
    "NAV_RCL_ACT": 2.0,
    "NAV_DLL_ACT": 0.0,
    "MAV_0_FORWARD": 1.0,
    "MAV_1_FORWARD": 0.0,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": -1.0,
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 0.0,
    "COM_RC_IN_MODE": 3.0,
    "COM_RC_LOSS_T": 0.5,
    "COM_RCL_EXCEPT": 0.0,
    "COM_LOW_BAT_ACT": 0.0,
    "COM_FLTT_LOW_ACT": 0.0,
    "COM_FLT_TIME_MAX": -1.0,
    "COM_WIND_MAX_ACT": 0.0,
    "GF_ACTION": 2.0,
    "EKF2_EV_CTRL": 0.0,
    "EKF2_HGT_REF": 1.0,
    "EKF2_MAG_TYPE": 0.0,
    "EKF2_GPS_CTRL": 7.0,
    "SYS_HAS_GPS": 1.0,
}


def wrong(route: str, needs: Needs, **changes: float) -> list[Finding]:
    """What must be changed of the parameters that our own flights are flown with."""
    flown = flight_parameters(AIRFRAME, gps=needs.gps, by_sticks=route == "manual_control")
    answers = {**DEFAULTS, **{k: float(v) for k, v in flown.items()}, **changes}
    rows = flavour("px4", route, CHANNELS, 1).requirements(needs)
    return [f for f in compare(rows, answers) if not f.ok and f.requirement.level == MUST]


@pytest.mark.parametrize("route", ["attitude", "manual_control"])
@pytest.mark.parametrize("needs", [HALL, HILL])
def test_what_we_have_flown_with_is_right(route: str, needs: Needs) -> None:
    assert wrong(route, needs) == []


@pytest.mark.parametrize("route", ["attitude", "manual_control"])
def test_a_vehicle_as_it_comes_is_wrong_in_a_hall(route: str) -> None:
    rows = flavour("px4", route, CHANNELS, 1).requirements(HALL)
    names = {f.name for f in compare(rows, DEFAULTS) if not f.ok and f.requirement.level == MUST}
    assert {"COM_DISARM_LAND", "EKF2_EV_CTRL", "EKF2_HGT_REF", "EKF2_GPS_CTRL"} <= names


@pytest.mark.parametrize(
    ("route", "name", "value", "words"),
    [
        ("attitude", "COM_OF_LOSS_T", 5.0, "set COM_OF_LOSS_T to at most 1"),
        ("attitude", "COM_OBL_RC_ACT", 7.0, "set COM_OBL_RC_ACT to 2"),
        ("attitude", "COM_RC_IN_MODE", 4.0, "set COM_RC_IN_MODE to anything but 4"),
        ("attitude", "NAV_RCL_ACT", 6.0, "set NAV_RCL_ACT to anything but 6"),
        ("attitude", "MAV_TYPE", 2.0, "set MAV_TYPE to 1"),
        ("attitude", "COM_RCL_EXCEPT", 3.0, "set bit 2 of COM_RCL_EXCEPT (to 7)"),
        ("attitude", "NAV_DLL_ACT", 2.0, "set NAV_DLL_ACT to 0"),
        ("attitude", "COM_LOW_BAT_ACT", 3.0, "set COM_LOW_BAT_ACT to 0"),
        ("attitude", "COM_FLTT_LOW_ACT", 3.0, "set COM_FLTT_LOW_ACT to at most 1"),
        ("manual_control", "GF_ACTION", 2.0, "set GF_ACTION to at most 1"),
        ("manual_control", "COM_FLT_TIME_MAX", 600.0, "set COM_FLT_TIME_MAX to at most 0"),
        ("manual_control", "COM_WIND_MAX_ACT", 3.0, "set COM_WIND_MAX_ACT to at most 1"),
        ("manual_control", "COM_RC_IN_MODE", 0.0, "set COM_RC_IN_MODE to anything but 0"),
        ("manual_control", "COM_RC_IN_MODE", 2.0, "set COM_RC_IN_MODE to anything but 2"),
        ("manual_control", "COM_RC_IN_MODE", 3.0, "set COM_RC_IN_MODE to anything but 3"),
        ("manual_control", "COM_RC_IN_MODE", 5.0, "set COM_RC_IN_MODE to anything but 5"),
        ("manual_control", "COM_DISARM_LAND", 2.0, "set COM_DISARM_LAND to at most 0"),
        ("attitude", "EKF2_EV_CTRL", 3.0, "set bit 3 of EKF2_EV_CTRL (to 11)"),
        ("attitude", "EKF2_GPS_CTRL", 7.0, "set EKF2_GPS_CTRL to 0"),
    ],
)
def test_each_wrong_one_is_named_with_the_way_out(
    route: str, name: str, value: float, words: str
) -> None:
    (found,) = wrong(route, HALL, **{name: value})
    assert remedy(found) == words
    assert found.requirement.why


def test_what_matters_in_one_route_alone_is_not_asked_of_the_other() -> None:
    assert wrong("manual_control", HILL, COM_OBL_RC_ACT=7.0, COM_RCL_EXCEPT=0.0) == []
    assert wrong("attitude", HILL, COM_RC_IN_MODE=0.0) == []


def test_an_old_release_answers_by_its_own_names() -> None:
    old = {name: value for name, value in DEFAULTS.items() if not name.startswith("EKF2_")}
    old |= {"EKF2_AID_MASK": 24.0, "EKF2_HGT_MODE": 3.0, "EKF2_MAG_TYPE": 5.0}
    old |= {"COM_DISARM_LAND": -1.0, "COM_OBL_RC_ACT": 2.0, "COM_RCL_EXCEPT": 4.0, "GF_ACTION": 1.0}
    rows = flavour("px4", "attitude", CHANNELS, 1).requirements(HALL)
    assert [f for f in compare(rows, old) if not f.ok and f.requirement.level == MUST] == []
    old["EKF2_AID_MASK"] = 1.0
    wanted = [remedy(f) for f in compare(rows, old) if not f.ok and f.requirement.level == MUST]
    assert wanted == ["set bit 3 of EKF2_AID_MASK (to 9)", "set bit 4 of EKF2_AID_MASK (to 17)"]
