"""What of a flight was flown by the module, and what of that on a line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, LoggedMode, Series
from tgl_soar.analysis.report.flight_page import analysed, page_text
from tgl_soar.analysis.report.flight_report_figures import Surroundings, span_of
from tgl_soar.analysis.report.legs import stands
from tgl_soar.control.supervisor import is_flying
from tgl_soar.control.supervisor_texts import MODE_NAMES


def flight(modes: list[str], each_s: float = 60.0) -> FlightData:
    """So long in each mode, on a line that stands all along; reported four times a second."""
    time = np.arange(0.0, each_s * len(modes), 0.25)
    ones = np.ones(len(time))
    line = Series(time, {"x_m": ones, "z_m": ones, "eta_rad": 1.8 * ones, "moving": 0.0 * ones}, "")
    path = Series(time, {"x_m": ones, "y_m": 0.0 * ones, "z_m": ones}, "")
    changes = tuple(LoggedMode(each_s * i, name) for i, name in enumerate(modes))
    return FlightData("", "", path=path, line=line, modes=changes)


def test_a_leg_goes_on_while_the_position_is_held_and_while_it_recovers() -> None:
    """Whoever judges a leg judges its gaps, too: else a flight would seem the better for them."""
    modes = ["capturing", "soaring", "holding", "soaring", "recovering", "soaring"]
    (found,) = stands(flight(modes))
    assert found[:2] == (0.0, 359.75)


@pytest.mark.parametrize("mode", ["launching", "searching", "breaking off", "landing", "beating"])
def test_a_mode_that_holds_no_line_is_no_leg(mode: str) -> None:
    assert stands(flight([mode, mode])) == []


@pytest.mark.parametrize("mode", MODE_NAMES)
def test_what_the_module_has_flown_is_shown_and_counted_in_whatever_mode(mode: str) -> None:
    """An hour of beating, and the way home, are as much of its flight as soaring is."""
    flown = flight(["ready", "soaring", mode, "released"])
    minutes = 2 if is_flying(MODE_NAMES.index(mode)) else 1
    text = page_text(analysed(flown, Surroundings(), None), {})
    (shown,) = re.findall(r"<b>([^<]*)</b><span>flown by the module", text)
    assert shown == f"{minutes} min 00 s"
    margin_s = 0.03 * 60.0 * minutes + 0.5
    assert span_of(flown) == pytest.approx((60.0 - margin_s, 60.0 + 60.0 * minutes + margin_s))
