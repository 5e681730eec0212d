"""A line that the module moves by itself: its parameters, and whose bounds it is asked by."""

from __future__ import annotations

from math import pi, radians
from typing import Any

import numpy as np
import pytest

from tgl_soar.config.line_changes import ELSEWHERE, SIDES
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.target_line import TargetLine
from tgl_soar.onboard.line_moves import is_moved, lean_of, line_parameters_of, moved, open_fence

LINE = TargetLine(x_m=-12.3, z_m=4.5, eta_rad=0.5 * pi + radians(10.0))


class Bounds:
    """What is allowed, and what was asked."""

    def __init__(self, fault: str = "") -> None:
        self.asked: list[ParameterSet] = []
        self._fault = fault

    def fault(self, values: ParameterSet) -> str:
        self.asked.append(values)
        return self._fault


class Settings:
    """Values that are assigned one by one."""

    def __init__(self, **changes: float) -> None:
        self.values = ParameterSet().changed(changes) if changes else ParameterSet()
        self.assigned: list[tuple[str, float]] = []

    def assign(self, name: str, value: float) -> None:
        self.assigned.append((name, value))
        self.values = self.values.changed({name: value})


def single(value: float) -> float:
    return float(np.float32(value))


def test_a_line_is_its_place_and_its_lean_from_upright_in_degrees_of_32_bits() -> None:
    assert lean_of(LINE) == pytest.approx(10.0, abs=1e-5)
    assert lean_of(LINE._replace(eta_rad=0.5 * pi)) == 0.0
    assert lean_of(LINE._replace(eta_rad=0.5 * pi - radians(5.0))) == pytest.approx(-5.0, abs=1e-5)
    assert line_parameters_of(LINE) == {
        "TGL_X": single(-12.3),
        "TGL_Z": 4.5,
        "TGL_LEAN": lean_of(LINE),
    }


def test_the_bounds_are_asked_without_the_point_that_a_brake_holds() -> None:
    bounds: Any = Bounds()
    before = ParameterSet().changed({"TGL_HOLD": 1.0})
    found = moved(before, bounds, LINE)
    assert found is not None
    assert (found["TGL_X"], found["TGL_Z"]) == (single(-12.3), 4.5)
    assert found["TGL_HOLD"] == 1.0
    (asked,) = bounds.asked
    assert (asked["TGL_HOLD"], asked["TGL_X"]) == (0.0, single(-12.3))


def test_a_line_that_is_out_of_bounds_or_of_its_own_ranges_is_none() -> None:
    refusing: Any = Bounds("the line's point is out")
    assert moved(ParameterSet(), refusing, LINE) is None
    allowing: Any = Bounds()
    assert moved(ParameterSet(), allowing, LINE._replace(x_m=1e9)) is None
    assert allowing.asked == []


def test_what_changes_is_assigned_and_a_preset_and_a_place_are_left() -> None:
    settings: Any = Settings()
    bounds: Any = Bounds()
    assert is_moved(settings, bounds, LINE)
    assert settings.values["TGL_X"] == single(-12.3)
    assert settings.values["TGL_Z"] == 4.5
    assert settings.values["TGL_LEAN"] == lean_of(LINE)
    assert settings.values["TGL_PRESET"] == 0.0
    assert settings.values["TGL_PLACE"] == ELSEWHERE
    before = len(settings.assigned)
    assert is_moved(settings, bounds, LINE)
    assert len(settings.assigned) == before  # nothing is sent twice


def test_what_is_refused_assigns_nothing() -> None:
    settings: Any = Settings()
    refusing: Any = Bounds("out")
    assert not is_moved(settings, refusing, LINE)
    assert settings.assigned == []


def test_a_fence_names_each_side_that_it_has_not() -> None:
    settings: Any = Settings()
    words = open_fence(settings)
    assert words.startswith("the fence is open: set ")
    sides = words.removeprefix("the fence is open: set ").split(", ")
    assert set(sides) == set(SIDES)
    values = {name: 0.5 * settings.values[name] for name in sides}
    for name in sides:
        closed: Any = Settings(**{other: at for other, at in values.items() if other != name})
        assert open_fence(closed) == f"the fence is open: set {name}"
    whole: Any = Settings(**values)
    assert open_fence(whole) == ""
