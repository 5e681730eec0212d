"""How a tracked body is to be defined: the pages say what the module takes it for."""

from __future__ import annotations

import re
from math import radians
from pathlib import Path

import pytest

from tgl_soar.geometry import (
    HallFrame,
    euler_from_quaternion,
    hall_from_ned,
    ned_attitude_from_hall,
)

DOCS = Path(__file__).parents[2] / "docs"
RULE = "while the aircraft stands level with its nose to the north of local NED"


def page(name: str) -> str:
    return re.sub(r"\s+", " ", (DOCS / name).read_text(encoding="utf-8"))


def hall(*, z_up: bool, yaw_deg: float) -> HallFrame:
    return HallFrame(
        z_up=z_up,
        yaw_rad=radians(yaw_deg),
        origin_north_m=0.0,
        origin_east_m=0.0,
        origin_down_m=0.0,
    )


@pytest.mark.parametrize("name", ["optitrack.md", "sensors.md"])
def test_a_body_is_defined_with_its_nose_to_the_north(name: str) -> None:
    text = page(name)
    assert RULE in text
    assert not re.search(r"level,? with its nose along the hall's x", text)


@pytest.mark.parametrize("z_up", [True, False])
@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -35.0])
def test_as_it_was_defined_its_attitude_is_level_and_north(z_up: bool, yaw_deg: float) -> None:
    attitude = ned_attitude_from_hall(hall(z_up=z_up, yaw_deg=yaw_deg), 1.0, 0.0, 0.0, 0.0)
    assert euler_from_quaternion(*attitude) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("z_up", "axis", "words"),
    [(True, (0.0, 1.0, 0.0), "`+y` if z is up"), (False, (0.0, 0.0, -1.0), "`-z` if y is up")],
)
def test_the_example_of_the_page_points_to_the_north(
    z_up: bool, axis: tuple[float, float, float], words: str
) -> None:
    assert words in page("optitrack.md")
    found = hall_from_ned(hall(z_up=z_up, yaw_deg=90.0), 1.0, 0.0, 0.0)
    assert found == pytest.approx(axis, abs=1e-12)
