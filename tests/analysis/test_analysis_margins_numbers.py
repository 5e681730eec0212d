"""Margins of cases: each is that of its own loop, and the figure shows them case by case."""

from __future__ import annotations

from functools import lru_cache
from math import isnan, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.lateral_model import lateral_loop
from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import Margin, activity, close_loop, margin
from tgl_soar.analysis.linear_plant import Condition, Gusts, linear_plant
from tgl_soar.analysis.margins import (
    CaseMargins,
    MarginCase,
    case_margins,
    grid,
    least_gain_db,
    margins_figure,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME = load_airframe(AIRFRAME_PATH)
GUSTS = Gusts(0.02, 8.5)


@lru_cache(maxsize=1)
def values() -> ParameterSet:
    return load_parameters(AIRFRAME, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)


@pytest.mark.parametrize("inertial", [True, False])
def test_each_case_has_the_margins_of_its_own_loops(inertial: bool) -> None:
    """Its speed, lean and latency, which is known to the schedule, and its sensors."""
    cases = [MarginCase(9.0, 15.0, 0.02, inertial), MarginCase(9.0, 30.0, 0.02, inertial)]
    rows = list(case_margins(AIRFRAME, values(), cases, GUSTS))
    assert [row.case for row in rows] == cases
    for case, row in zip(cases, rows, strict=True):
        condition = Condition(
            model=aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model),
            servo=servo_params(AIRFRAME.model),
            speed_mps=9.0,
            lean_rad=radians(case.lean_deg),
            sensors=Sensors(imu=MEMS_IMU) if inertial else USUAL_SENSORS,
            command_delay_s=0.02,
        )
        known = values().changed({"CMD_DELAY": 0.02, "TGL_LEAN": case.lean_deg})
        laws = laws_from(known, SoaringFrame(0.0, 0.0, 0.0, 0.0), AIRFRAME.aerodynamics())
        loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
        assert row.elevator == margin(loop, "elevator")
        assert row.line == margin(loop, "e_rho")
        spread = activity(laws, condition, GUSTS)
        assert (row.e_rho_m, row.activity) == (spread.e_rho_m, spread.elevator)
        if case is cases[0]:
            sideways = lateral_loop(laws, condition)
            assert (row.aileron, row.rudder) == (
                margin(sideways, "aileron"),
                margin(sideways, "rudder"),
            )
        assert row.breaks == (row.elevator, row.line, row.aileron, row.rudder)
    # The lateral loops know no lean.
    assert rows[0].aileron is rows[1].aileron
    assert rows[0].elevator != rows[1].elevator


def test_another_speed_latency_or_sensor_has_lateral_loops_of_its_own() -> None:
    first = MarginCase(9.0, 15.0, 0.02, True)
    others = [
        first._replace(speed_mps=10.0),
        first._replace(delay_s=0.03),
        first._replace(inertial=False),
    ]
    rows = list(case_margins(AIRFRAME, values(), [first, *others], GUSTS))
    assert len({row.rudder.alpha for row in rows}) == 4


def test_an_unstable_case_has_no_spread() -> None:
    """Gains as they stand, on a line that leans far, on a late link."""
    stiff = values().changed({"RHO_SPEED": 0.0})
    (row,) = case_margins(AIRFRAME, stiff, [MarginCase(8.5, 45.0, 0.04, True)], GUSTS)
    assert row.alpha == row.elevator.alpha == row.line.alpha == 0.0
    assert isnan(row.e_rho_m)
    assert isnan(row.activity)
    assert least_gain_db(row) == 0.0
    assert row.rudder.alpha > 0.0


def test_the_grid_has_accelerometers_first_and_without_alone_where_none_are_used() -> None:
    speeds, leans, delays = (8.0, 9.0), (5.0, 15.0), (0.01, 0.02)
    both = grid(values().changed({"EST_IMU": 1.0}), speeds, leans, delays)
    assert [case.inertial for case in both] == [True] * 8 + [False] * 8
    assert both[:5] == [
        MarginCase(8.0, 5.0, 0.01, True),
        MarginCase(9.0, 5.0, 0.01, True),
        MarginCase(8.0, 15.0, 0.01, True),
        MarginCase(9.0, 15.0, 0.01, True),
        MarginCase(8.0, 5.0, 0.02, True),
    ]
    without = grid(values().changed({"EST_IMU": 0.0}), speeds, leans, delays)
    assert without == both[8:]


def row_of(case: MarginCase, alpha: float) -> CaseMargins:
    one = Margin(
        alpha=alpha, at_radps=5.0, gain_up_db=9.0, gain_down_db=-9.0, phase_deg=50.0, delay_s=0.1
    )
    return CaseMargins(
        case=case, elevator=one, line=one, aileron=one, rudder=one, e_rho_m=0.0, activity=0.0
    )


@pytest.mark.parametrize(("highest", "top"), [(0.9, 1.0), (1.3, 1.3)])
def test_the_figure_has_a_panel_for_each_latency_and_sensor_and_a_line_for_each_lean(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, highest: float, top: float
) -> None:
    from matplotlib.figure import Figure

    drawn: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: drawn.append((self, path)))
    cases = [
        MarginCase(speed, lean, delay, inertial)
        for inertial in (True, False)
        for delay in (0.0075, 0.04)
        for lean in (5.0, 15.0)
        for speed in (8.0, 9.0, 10.0)
    ]
    alphas = np.linspace(0.3, highest, len(cases)).tolist()
    rows = [row_of(case, alpha) for case, alpha in zip(cases, alphas, strict=True)]
    margins_figure(tmp_path / "m.svg", rows, 0.5, "margins")
    ((figure, path),) = drawn
    assert path == tmp_path / "m.svg"
    assert [axes.get_title() for axes in figure.axes] == [
        "with accelerometers, 40 ms",
        "with accelerometers, 7.5 ms",
        "without accelerometers, 40 ms",
        "without accelerometers, 7.5 ms",
    ]
    panels = [(True, 0.04), (True, 0.0075), (False, 0.04), (False, 0.0075)]
    for axes, (inertial, delay) in zip(figure.axes, panels, strict=True):
        for line, lean in zip(axes.lines[:2], (5.0, 15.0), strict=True):
            expected = [
                [row.case.speed_mps, row.alpha]
                for row in rows
                if row.case[1:] == (lean, delay, inertial)
            ]
            assert len(expected) == 3
            assert line.get_xydata().tolist() == expected
            assert line.get_label() == f"lean {lean:g}°"
        assert axes.lines[2].get_ydata()[0] == 0.5
        assert axes.get_ylim() == pytest.approx((0.0, top))
    assert figure.get_suptitle() == "margins"
    assert figure.axes[-1].get_legend() is not None
