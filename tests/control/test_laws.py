"""A switch among the parameters is what is set: on at 1 and off at 0, and nothing else moves."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.geometry import SoaringFrame

FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
SWITCHES: dict[str, Callable[[Laws], bool]] = {
    "ESC_AUTO": lambda laws: laws.landing.auto,
    "EST_IMU": lambda laws: laws.motion.use_imu,
    "LNC_START": lambda laws: laws.launch.wanted,
    "SRV_START": lambda laws: laws.surveys,
    "TGL_HOLD": lambda laws: laws.brake.wanted,
}


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_is_on_at_1_and_off_at_0(name: str) -> None:
    for value in (0.0, 1.0):
        laws = laws_from(ParameterSet().changed({name: value}), FRAME)
        assert {each: SWITCHES[each](laws) for each in SWITCHES} == {
            each: (value if each == name else ParameterSet()[each]) != 0.0 for each in SWITCHES
        }


def test_only_the_second_way_to_hold_a_point_gives_way() -> None:
    for value, gives_way in ((0.0, False), (1.0, False), (2.0, True)):
        laws = laws_from(ParameterSet().changed({"TGL_HOLD": value}), FRAME)
        assert laws.brake.gives_way is gives_way


def test_a_survey_moves_the_line_no_faster_than_it_is_to() -> None:
    slow = {"TGL_SLEW": 0.3, "SRV_SPEED": 0.1}
    for changes, speed_mps in (
        ({**slow, "SRV_START": 0.0}, 0.3),
        ({**slow, "SRV_START": 1.0}, 0.1),
        ({"TGL_SLEW": 0.05, "SRV_SPEED": 0.1, "SRV_START": 1.0}, 0.05),
    ):
        laws = laws_from(ParameterSet().changed(changes), FRAME)
        assert laws.line.speed_mps == pytest.approx(speed_mps)
