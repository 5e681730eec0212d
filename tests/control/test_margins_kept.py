"""Margins that are kept: a parameter that they do not follow from has nothing computed again, and
one that they do follow from always has."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tgl_soar.config.files import load_airframe, load_flight, shipped
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.config.parameters import PARAMETERS, Parameter, ParameterError, ParameterSet
from tgl_soar.control import loop_margin
from tgl_soar.control.loop_margin import (
    LATERAL_NAMES,
    PITCH_NAMES,
    LoopMargin,
    lateral_margins,
    line_margins,
)

AIRFRAME_PATH = shipped("airframes/eclipson_c.toml")
VALUES = load_flight(AIRFRAME_PATH, shipped("sites/tunnel.toml"))[2]
LATERAL = lateral_dynamics(load_airframe(AIRFRAME_PATH))
Both = tuple[tuple[LoopMargin, ...], tuple[LoopMargin, ...]]


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    forget()
    yield
    forget()


def forget() -> None:
    for kept in (loop_margin._line_margins, loop_margin._lateral_margins, loop_margin._loops):
        kept.cache_clear()


def computed(values: ParameterSet) -> Both:
    forget()
    return line_margins(values), lateral_margins(values, LATERAL)


def others(parameter: Parameter) -> Iterator[ParameterSet]:
    """The same with another value of one parameter, as far as that is allowed."""
    low, high, now = parameter.minimum, parameter.maximum, VALUES[parameter.name]
    for value in (low, high, 1.07 * now + 0.013):
        try:
            changed = VALUES.changed({parameter.name: min(high, max(low, value))})
        except ParameterError:
            continue
        if changed[parameter.name] != now:
            yield changed


FOLLOWED = {*PITCH_NAMES, *LATERAL_NAMES, "TGL_X"}


@pytest.mark.parametrize(
    "parameter", [p for p in PARAMETERS if p.name in FOLLOWED], ids=lambda parameter: parameter.name
)
def test_what_is_kept_is_what_would_be_computed(parameter: Parameter) -> None:
    for values in others(parameter):
        forget()
        line_margins(VALUES), lateral_margins(VALUES, LATERAL)
        assert (line_margins(values), lateral_margins(values, LATERAL)) == computed(values)


@pytest.mark.parametrize(
    "parameter",
    [p for p in PARAMETERS if p.name not in FOLLOWED],
    ids=lambda parameter: parameter.name,
)
def test_they_follow_from_no_other_parameter(parameter: Parameter) -> None:
    usual = computed(VALUES)
    for values in others(parameter):
        assert computed(values) == usual


@pytest.mark.parametrize("name", ["TEL_BUDGET", "TGL_SLEW", "TGL_Z", "TGL_X", "FENCE_X_MAX"])
def test_a_parameter_that_says_nothing_of_the_loops_costs_nothing(name: str) -> None:
    values = next(others(PARAMETERS[[p.name for p in PARAMETERS].index(name)]))
    line_margins(VALUES)
    line_margins(values)
    assert loop_margin._line_margins.cache_info().misses == 1


@pytest.mark.parametrize(("name", "line", "sideways"), [("SIDE_P", 1, 2), ("RHO_P", 2, 1)])
def test_gains_of_one_plane_leave_the_other_as_it_is(name: str, line: int, sideways: int) -> None:
    values = VALUES.changed({name: 0.9 * VALUES[name]})
    for each in (VALUES, values):
        line_margins(each), lateral_margins(each, LATERAL)
    assert loop_margin._line_margins.cache_info().misses == line
    assert loop_margin._lateral_margins.cache_info().misses == sideways
