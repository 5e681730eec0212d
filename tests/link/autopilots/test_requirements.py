"""The tables of docs/hardware.md, value by value: what a firmware's parameter may be, what it must
not be, and of which it matters that the vehicle has it at all.

Most have to do with an aircraft that hovers without a propeller: a row that is left out, or a bit
that is another one, shows on the day on which the radio is lost.
"""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

import pytest

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels, ThrottleChannel
from tgl_soar.link.autopilots.requirements import (
    MUST,
    RELATIONS,
    SHOULD,
    Needs,
    Requirement,
    compare,
    remedy,
)

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1510, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1120, pwm_trim=1500, pwm_max=1880),
    rudder=SurfaceChannel(channel=4, pwm_min=1110, pwm_trim=1490, pwm_max=1920, reversed=True),
)
POWERED = CHANNELS._replace(throttle=ThrottleChannel(channel=3, pwm_min=1000, pwm_max=2000))
HALL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=True, gps=False)
HILL = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True, lands=True)


class Row(NamedTuple):
    """Of a parameter: values without a report, and with one."""

    name: str
    good: tuple[float, ...]
    bad: tuple[float, ...]
    level: str = MUST


ARDUPLANE = (
    Row("CRASH_DETECT", (0, 2), (1, 3)),
    Row("FS_SHORT_ACTN", (2,), (0, 1, 3, 4)),
    Row("FS_LONG_ACTN", (2,), (0, 1, 3)),
    Row("THR_FAILSAFE", (1,), (2,)),
    Row("THR_FAILSAFE", (1,), (0,), SHOULD),
    Row("BATT_FS_LOW_ACT", (0,), (1, 2)),
    Row("BATT_FS_CRT_ACT", (0,), (1, 2)),
    Row("FENCE_ACTION", (0,), (1, 2)),
    Row("FS_GCS_ENABL", (0,), (1, 2), SHOULD),
)
BY_OVERRIDE = (
    Row("RC_OVERRIDE_TIME", (0.1, 0.3, 0.5), (-1.0, 0.0, 0.6, 1.0, 3.0)),
    Row("RC_OPTIONS", (0, 1, 32), (2, 3)),
    Row("RCMAP_PITCH", (2,), (1, 3)),
    Row("RCMAP_ROLL", (1,), (2,)),
    Row("RCMAP_YAW", (4,), (3,)),
    *(Row(f"RC{n}_DZ", (0,), (1, 30), SHOULD) for n in (1, 2, 4)),
)
BY_GUIDED = (
    Row("STALL_PREVENTION", (0,), (1,), SHOULD),
    Row("STICK_MIXING", (1, 2), (0,), SHOULD),
)
ARDUPLANE_IN_A_HALL = (
    Row("VISO_TYPE", (1,), (0, 2)),
    Row("EK3_SRC1_POSXY", (6,), (0, 3)),
    Row("EK3_SRC1_POSZ", (6,), (1, 3)),
    Row("EK3_SRC1_YAW", (6,), (1, 3)),
    Row("EK3_SRC1_VELXY", (0, 6), (3,)),
    Row("EK3_SRC1_VELZ", (0, 6), (3,)),
    Row("GPS1_TYPE", (14,), (0, 1), SHOULD),
    Row("GPS_TYPE", (14,), (0, 1), SHOULD),
)
ARDUPLANE_OUTDOORS = (
    Row("GPS1_TYPE", (1, 9), (0,)),
    Row("GPS_TYPE", (1, 9), (0,)),
    Row("EK3_SRC1_POSXY", (3,), (0, 6)),
    Row("RTL_AUTOLAND", (1, 2), (0,)),
)
# A stream comes at 0.8 of the loop's rate at most, and the servos' filter of a slower loop is late.
SURFACES = (
    Row("SCHED_LOOP_RATE", (250, 300, 400), (50, 200, 249), SHOULD),
    Row("SERVO2_FUNCTION", (19,), (4, 21, 52)),
    Row("SERVO1_FUNCTION", (4,), (19,)),
    Row("SERVO4_FUNCTION", (21,), (19,)),
)


def exactly(name: str, value: float) -> Row:
    """Any other value is wrong."""
    return Row(name, (value,), (value + 1, value - 1))


def pulses(*prefixes: str) -> tuple[Row, ...]:
    """A pulse passes from stick to servo unchanged."""
    rows = []
    for prefix in prefixes:
        for surface in (CHANNELS.elevator, CHANNELS.aileron, CHANNELS.rudder):
            values = {
                "MIN": surface.pwm_min,
                "TRIM": surface.pwm_trim,
                "MAX": surface.pwm_max,
                "REVERSED": int(surface.reversed),
            }
            rows += [
                exactly(f"{prefix}{surface.channel}_{what}", value)
                for what, value in values.items()
            ]
    return tuple(rows)


MOTOR = (
    Row("SERVO3_FUNCTION", (70,), (0, 69)),
    Row("RCMAP_THROTTLE", (3,), (1, 4)),
    Row("RC3_DZ", (0,), (1, 30), SHOULD),
    *(
        exactly(f"{prefix}3_{what}", value)
        for prefix in ("RC", "SERVO")
        for what, value in (("MIN", 1000), ("MAX", 2000), ("REVERSED", 0))
    ),
)
PX4 = (
    Row("MAV_TYPE", (1,), (2, 0)),
    Row("COM_DISARM_LAND", (0, -1), (0.5, 2)),
    Row("COM_DISARM_PRFLT", (0, -1), (0.5, 10)),
    Row("NAV_RCL_ACT", (1, 2, 3), (5, 6)),
    Row("NAV_DLL_ACT", (0,), (1, 2)),
    Row("COM_LOW_BAT_ACT", (0,), (1, 2, 3)),
    Row("COM_FLTT_LOW_ACT", (0, 1), (2, 3)),
    Row("GF_ACTION", (0, 1), (2, 3)),
    Row("COM_WIND_MAX_ACT", (0, 1), (2, 3)),
    Row("COM_FLT_TIME_MAX", (0, -1), (1, 600)),
    Row("MAV_0_FORWARD", (1,), (0,), SHOULD),
    Row("MAV_1_FORWARD", (1,), (0,), SHOULD),
    Row("EKF2_FUSE_BETA", (0,), (1,), SHOULD),
    Row("EKF2_ARSP_THR", (0.5, 5), (5.5, 8), SHOULD),
    Row("EKF2_ARSP_THR", (2, 5), (0,), SHOULD),
)
BY_OFFBOARD = (
    Row("COM_OF_LOSS_T", (0.3, 0.5, 1.0), (1.5, 2.0)),
    Row("COM_OF_LOSS_T", (0.3, 0.5), (0.6, 1.0), SHOULD),
    Row("COM_OBL_RC_ACT", (2,), (0, 1, 3, 7)),
    Row("FW_R_TC", (0.2, 0.4), (0.5, 1.0), SHOULD),
    Row("COM_RCL_EXCEPT", (4, 5, 7), (0, 1, 3)),
    Row("COM_RC_IN_MODE", (0, 2, 3), (1, 4)),
)
BY_STICKS = (
    Row("COM_RC_IN_MODE", (1, 6), (0, 2, 3, 4, 5, 7)),
    Row("COM_RC_LOSS_T", (0.3, 0.5), (0.6, 1.0), SHOULD),
)
PX4_IN_A_HALL = (
    Row("EKF2_EV_CTRL", (11, 15), (0, 3, 9, 10)),
    Row("EKF2_AID_MASK", (24, 25), (8, 16)),
    Row("EKF2_HGT_REF", (3,), (0, 1)),
    Row("EKF2_HGT_MODE", (3,), (0, 1)),
    Row("EKF2_MAG_TYPE", (5,), (0, 1)),
    Row("EKF2_GPS_CTRL", (0,), (7,)),
)
PX4_OUTDOORS = (
    Row("EKF2_GPS_CTRL", (1, 7), (0,)),
    Row("SYS_HAS_GPS", (1,), (0,)),
)
CASES = (
    (
        *("ardupilot", "override", HALL),
        ARDUPLANE + BY_OVERRIDE + ARDUPLANE_IN_A_HALL + SURFACES + MOTOR + pulses("RC", "SERVO"),
    ),
    (
        *("ardupilot", "attitude", HILL),
        ARDUPLANE + BY_GUIDED + ARDUPLANE_OUTDOORS + SURFACES + pulses("SERVO"),
    ),
    ("px4", "attitude", HALL, PX4 + BY_OFFBOARD + PX4_IN_A_HALL),
    ("px4", "manual_control", HILL, PX4 + BY_STICKS + PX4_OUTDOORS),
)


# What every release has.
ALWAYS = frozenset(
    ("RC_OVERRIDE_TIME", "VISO_TYPE", "SCHED_LOOP_RATE", "MAV_TYPE", "COM_DISARM_LAND",
     "NAV_RCL_ACT", "COM_OF_LOSS_T", "COM_RC_IN_MODE", "EKF2_HGT_REF", "EKF2_HGT_MODE",
     "EKF2_MAG_TYPE")
)  # fmt: skip


def must_answer(name: str) -> bool:
    """Calibrations of channels are everywhere, too."""
    calibrates = name.endswith(("_MIN", "_TRIM", "_MAX", "_REVERSED"))
    return name in ALWAYS or (calibrates and name.startswith(("RC", "SERVO")))


def asked_by(firmware: str, route: str, needs: Needs) -> tuple[Requirement, ...]:
    """What is asked of a vehicle, with a propeller where one can be."""
    channels = POWERED if route == "override" else CHANNELS
    return flavour(firmware, route, channels, 1).requirements(needs)


def complaints(firmware: str, route: str, needs: Needs, name: str, value: float) -> set[str]:
    """The levels of what is reported of a vehicle that answers with one parameter alone."""
    rows = asked_by(firmware, route, needs)
    answered = [row for row in rows if name in row.names]
    return {f.requirement.level for f in compare(tuple(answered), {name: value}) if not f.ok}


@pytest.mark.parametrize(("firmware", "route", "needs", "rows"), CASES)
def test_every_row_of_the_hardware_page(
    firmware: str, route: str, needs: Needs, rows: tuple[Row, ...]
) -> None:
    for row in rows:
        for value in row.good:
            assert row.level not in complaints(firmware, route, needs, row.name, value), (
                row,
                value,
            )
        for value in row.bad:
            assert row.level in complaints(firmware, route, needs, row.name, value), (row, value)


@pytest.mark.parametrize(("firmware", "route", "needs", "rows"), CASES)
def test_there_is_no_row_that_the_page_lacks(
    firmware: str, route: str, needs: Needs, rows: tuple[Row, ...]
) -> None:
    names = {row.name for row in rows}
    asked = asked_by(firmware, route, needs)
    assert {name for each in asked for name in each.names} == names


@pytest.mark.parametrize(("firmware", "route", "needs", "rows"), CASES)
def test_what_every_release_has_must_answer(
    firmware: str, route: str, needs: Needs, rows: tuple[Row, ...]
) -> None:
    """A name without an answer is either of another release, or a mistake of ours."""
    asked = asked_by(firmware, route, needs)
    silent = {name for f in compare(asked, {}) if not f.ok for name in f.requirement.names}
    assert silent == {row.name for row in rows if must_answer(row.name)}


def test_where_no_propeller_is_flown_no_throttle_is_asked_for() -> None:
    rows = flavour("ardupilot", "override", CHANNELS, 1).requirements(HALL)
    names = {name for row in rows for name in row.names}
    assert not names & {"RCMAP_THROTTLE", "SERVO3_FUNCTION", "RC3_DZ"}
    assert "SERVO2_FUNCTION" in names


def test_a_faster_loop_of_ours_asks_for_a_faster_one_of_arduplane() -> None:
    """It grants 0.8 of it: 400 Hz needs 500."""
    fast = HALL._replace(loop_rate_hz=400.0)
    (row,) = (
        row
        for row in flavour("ardupilot", "override", CHANNELS, 1).requirements(fast)
        if row.names == ("SCHED_LOOP_RATE",)
    )
    assert row.wanted == pytest.approx(500.0)
    assert "500" in flavour("ardupilot", "override", CHANNELS, 1).way_to_rate(400.0)


def test_a_number_that_came_as_a_32_bit_float_is_the_number() -> None:
    assert complaints("ardupilot", "override", HALL, "RC_OVERRIDE_TIME", 0.10000000149) == set()
    assert complaints("ardupilot", "override", HALL, "FS_SHORT_ACTN", 2.001) == {MUST}


@pytest.mark.parametrize(
    ("relation", "wanted", "good", "bad"),
    [
        ("is", 0.1, 0.10000000149, 0.2),
        ("is not", 0.0, 1.0, 0.0),
        ("at most", 0.5, 0.5, 3.0),
        ("at least", 250.0, 400.0, 50.0),
        ("has bit", 1.0, 34.0, 32.0),
        ("lacks bit", 1.0, 32.0, 34.0),
    ],
)
def test_a_requirement_holds_or_says_what_to_set(
    relation: str, wanted: float, good: float, bad: float
) -> None:
    row = Requirement(names=("NEW", "OLD"), relation=relation, wanted=wanted, why="because")
    (fine,), (wrong,), (silent,) = (
        compare((row,), answers) for answers in ({"OLD": good}, {"NEW": bad}, {"OTHER": 1.0})
    )
    assert fine.ok
    assert fine.name == "OLD"
    assert not wrong.ok
    assert "NEW" in remedy(wrong)
    assert silent.value is None
    assert not silent.ok
    assert compare((row._replace(missing_ok=True),), {})[0].ok


@pytest.mark.parametrize("relation", RELATIONS)
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_what_is_no_number_meets_no_requirement(relation: str, value: float) -> None:
    """An autopilot's parameter, or what another sends in its name, ends no flight."""
    row = Requirement(names=("X",), relation=relation, wanted=1.0, why="because")
    (found,) = compare((row,), {"X": value})
    assert not found.ok
    assert "X" in remedy(found)
