"""Presets, staged moves, crossings with the contour, pure and as a ground station meets them."""

from itertools import pairwise
from math import nan, radians, tan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.line_changes import (
    LineChanges,
    PresetLine,
    contour_length,
    contour_place,
    crossings,
    settled,
    with_changes,
)
from tgl_soar.config.parameters import ParameterError, ParameterSet, as_wire_value
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.link.messages import (
    Outbound,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Source,
    StatusText,
)
from tgl_soar.link.parameter_server import ParameterServer
from tgl_soar.types import NO_GROUND

A, B, C = PresetLine("a", 0.2, 1.15, 15), PresetLine("b", 0.6, 1.6, 15), PresetLine("c", 1, 2, 20)
PRESETS = (A, B, C)
REAL32 = 9
# Rising air below z = 1: its upper edge runs to the left (upstream is -x), the air on its left.
EDGE = (((5.0, 1.0), (-5.0, 1.0)),)


def a_line(values: ParameterSet) -> tuple[float, float, float]:
    return values["TGL_X"], values["TGL_Z"], values["TGL_LEAN"]


class Station:
    """A ground station at a server, and its copy of the values."""

    def __init__(self, line: LineChanges | None = None) -> None:
        line = line or LineChanges(PRESETS)
        wide = ParameterSet().changed({"TGL_STEP_MAX": 10.0})
        self.server = ParameterServer(Source(1, 191), wide, line=line)
        self.shown: dict[str, float] = {}
        self.words = ""

    def set(self, name: str, value: float, *, flying: bool = True) -> list[str]:
        """Names of the values that came in answer."""
        answers = self.server.handle(
            Source(255, 190),
            ParamSet(
                target_system=1,
                target_component=191,
                param_id=name,
                param_value=value,
                param_type=REAL32,
            ),
            0.0,
            flying=flying,
        )
        return self._take(answers)

    def read(self, name: str) -> float:
        message = ParamRequestRead(1, 191, name, -1)
        self.server.handle(Source(255, 190), message, 0.0, flying=True)
        self._take(self.server.poll(1.0))
        return self.shown[name]

    def _take(self, answers: list[Outbound]) -> list[str]:
        values = [m for m in answers if isinstance(m, ParamValue)]
        self.shown |= {m.param_id: m.param_value for m in values}
        self.words = "".join(m.text for m in answers if isinstance(m, StatusText))
        return [m.param_id for m in values]

    @property
    def line(self) -> tuple[float, float, float]:
        return a_line(self.server.values)


# --- presets ----------------------------------------------------------------------------------


def test_a_preset_moves_the_line_as_one_and_tells_every_value() -> None:
    station = Station()
    assert station.set("TGL_PRESET", 3) == ["TGL_PRESET", "TGL_X", "TGL_Z", "TGL_LEAN"]
    assert station.line == (1.0, 2.0, 20.0)
    assert station.shown == {"TGL_PRESET": 3.0, "TGL_X": 1.0, "TGL_Z": 2.0, "TGL_LEAN": 20.0}


def test_moving_the_line_by_hand_ends_the_preset() -> None:
    station = Station()
    station.set("TGL_PRESET", 2)
    assert station.set("TGL_SLEW", 0.2) == ["TGL_SLEW"]  # no move: still on b
    assert station.set("TGL_X", as_wire_value(0.6)) == ["TGL_X"]  # where it is: no move either
    assert station.set("TGL_X", 0.7) == ["TGL_X", "TGL_PRESET"]
    assert station.shown["TGL_PRESET"] == 0.0


def test_preset_0_leaves_the_line_where_it_is() -> None:
    station = Station()
    station.set("TGL_PRESET", 2)
    before = station.line
    station.set("TGL_PRESET", 0)
    assert station.line == before


def test_a_preset_that_the_site_does_not_have_is_refused_with_its_lines() -> None:
    station = Station()
    station.set("TGL_PRESET", 1)
    assert station.set("TGL_PRESET", 4) == ["TGL_PRESET"]
    assert station.shown["TGL_PRESET"] == 1.0
    assert "the site's lines are 1 a, 2 b, 3 c" in station.words
    bare = Station(LineChanges())
    bare.set("TGL_PRESET", 1)
    assert "names no lines" in bare.words


def test_a_preset_that_may_not_be_flown_now_is_refused() -> None:
    station = Station()
    station.set("TGL_LEAN_MAX", 18.0)
    station.set("TGL_PRESET", 3)
    assert station.line == a_line(ParameterSet())
    assert "line c: TGL_LEAN = 20" in station.words


def test_files_may_name_a_preset_in_place_of_a_line() -> None:
    values = with_changes(ParameterSet(), {"TGL_PRESET": 2.0, "RHO_P": 0.5}, PRESETS)
    assert a_line(values)[1] == pytest.approx(1.6)
    assert values["RHO_P"] == 0.5
    # A line beside it counts, and the preset only where they agree.
    moved = with_changes(values, {"TGL_PRESET": 2.0, "TGL_X": 9.0}, PRESETS)
    assert (moved["TGL_PRESET"], moved["TGL_X"]) == (0.0, 9.0)
    assert with_changes(values, {"TGL_PRESET": 2.0, "TGL_X": 0.6}, PRESETS) == values
    with pytest.raises(ParameterError, match=r"no such line: the site's lines are"):
        with_changes(values, {"TGL_PRESET": 7.0}, PRESETS)
    assert settled(values, (A,))["TGL_PRESET"] == 0.0  # the site has fewer lines by now


# --- staging ----------------------------------------------------------------------------------


def test_a_staged_move_is_shown_at_once_and_made_at_once() -> None:
    station = Station()
    station.set("TGL_STAGE", 1)
    before = station.server.values
    for name, value in (("TGL_X", 2.0), ("TGL_Z", 3.0), ("TGL_LEAN", 20.0), ("TGL_SLEW", 0.5)):
        assert station.set(name, value) == [name]
        assert station.shown[name] == station.read(name) == value
    assert station.server.values is before
    answered = station.set("TGL_STAGE", 0)
    assert answered == ["TGL_STAGE", "TGL_X", "TGL_Z", "TGL_LEAN", "TGL_SLEW"]
    assert station.line == (2.0, 3.0, 20.0)
    assert station.server.values["TGL_SLEW"] == 0.5


def test_staged_values_are_checked_alone_at_once_and_together_at_the_end() -> None:
    station = Station()
    station.set("TGL_STAGE", 1)
    station.set("TGL_X", 501.0)
    assert "allowed -500 to 500" in station.words
    station.set("TGL_Z", nan)
    assert "not finite" in station.words
    station.set("TGL_X", 4.0)
    assert station.set("TGL_LEAN", 2.0) == ["TGL_LEAN"]
    assert station.words == ""
    assert station.set("TGL_STAGE", 0) == ["TGL_STAGE", "TGL_X", "TGL_LEAN"]
    assert station.words.startswith("staged move dropped: TGL_LEAN = 2: the line must lean upwind")
    assert station.line == a_line(ParameterSet())
    assert station.shown == {"TGL_STAGE": 2.0, "TGL_Z": 0.0, "TGL_X": 0.0, "TGL_LEAN": 15.0}


def test_a_repeated_commit_is_answered_as_the_first_was() -> None:
    """A station that lost the answer asks again."""
    station = Station()
    station.set("TGL_STAGE", 1)
    station.set("TGL_LEAN", 2.0)
    station.set("TGL_STAGE", 0)
    assert station.set("TGL_STAGE", 0) == ["TGL_STAGE"]
    assert station.shown["TGL_STAGE"] == 2.0
    assert "nothing is staged" in station.words
    station.set("TGL_STAGE", 1)
    station.set("TGL_LEAN", 20.0)
    station.set("TGL_STAGE", 1)  # begun twice: what is staged is kept
    station.set("TGL_STAGE", 0)
    station.set("TGL_STAGE", 0)
    assert (station.shown["TGL_STAGE"], station.words) == (0.0, "")
    assert station.line[2] == 20.0


def test_what_is_dropped_is_reported_as_it_stands() -> None:
    station = Station()
    station.set("TGL_STAGE", 1)
    station.set("TGL_X", 5.0)
    assert station.set("TGL_STAGE", 2) == ["TGL_STAGE", "TGL_X"]
    assert station.shown == {"TGL_STAGE": 2.0, "TGL_X": 0.0}
    station.set("TGL_X", 1.0)
    assert station.line[0] == 1.0


def test_all_else_acts_at_once_while_a_move_is_staged() -> None:
    station = Station()
    station.set("TGL_STAGE", 1)
    station.set("TGL_X", 5.0)
    station.set("RHO_P", 0.5)
    station.set("OP_ENGAGE", 1)
    assert station.server.values["RHO_P"] == 0.5
    assert station.server.values["OP_ENGAGE"] == 1.0
    assert station.line[0] == 0.0
    station.set("TGL_PRESET", 1)
    assert "a move is being staged" in station.words
    assert station.line[0] == 0.0


def test_a_staged_move_ends_a_preset_only_when_it_is_made() -> None:
    station = Station()
    station.set("TGL_PRESET", 1)
    station.set("TGL_STAGE", 1)
    station.set("TGL_X", 5.0)
    assert station.server.values["TGL_PRESET"] == 1.0
    assert station.set("TGL_STAGE", 0) == ["TGL_STAGE", "TGL_PRESET", "TGL_X"]
    assert station.shown["TGL_PRESET"] == 0.0


# --- the contour ------------------------------------------------------------------------------


def test_rising_air_below_is_a_place_to_settle_and_above_it_is_none() -> None:
    upside_down = tuple(reversed(EDGE[0]))
    found = crossings((EDGE[0], upside_down), 0.0, 0.0, 15.0)
    assert [crossing.settles for crossing in found] == [True, False]
    for crossing in found:  # a line that leans upwind by 15 deg, at the height of the edge
        assert crossing[:2] == pytest.approx((-tan(radians(15.0)), 1.0))


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-60, 60),
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=2, max_size=6),
)  # fmt: skip
def test_a_crossing_lies_where_e_rho_changes_sign(
    x: float, z: float, lean: float, part: list[tuple[float, float]]
) -> None:
    """Against the control law's own distance; a closed part is crossed as often out as in."""
    eta = eta_from_lean(radians(lean))
    upstream = [e_rho(x, z, eta, *point) >= 0.0 for point in part]
    found = crossings((tuple(part),), x, z, lean)
    assert len(found) == sum(a != b for a, b in pairwise(upstream))
    closed = crossings(((*part, part[0]),), x, z, lean)
    assert sum(crossing.settles for crossing in closed) * 2 == len(closed)
    for crossing in found:
        assert abs(e_rho(x, z, eta, crossing.x_m, crossing.z_m)) < 1e-9


@given(st.data())
def test_no_sequence_of_sets_leaves_an_inconsistent_set(data: st.DataObject) -> None:
    line, values = LineChanges(PRESETS), ParameterSet()
    names = ("TGL_X", "TGL_Z", "TGL_LEAN", "TGL_SLEW", "TGL_PRESET", "TGL_STAGE", "TGL_LEAN_MAX")
    for _ in range(data.draw(st.integers(1, 12))):
        name = data.draw(st.sampled_from(names))
        value = float(data.draw(st.integers(-1, 25)))
        before, staged = values, dict(line.staged)
        try:
            answer = line.set(values, name, value, flying=data.draw(st.booleans()))
        except ParameterError:
            assert line.staged == staged
            continue
        values = answer.values
        assert answer.reported[0] == name
        changed = {p.name for (p, a), (_, b) in zip(before, values, strict=True) if a != b}
        assert changed | (staged.keys() ^ line.staged.keys()) <= set(answer.reported)
        assert settled(values, PRESETS) == values
        assert values.changed({}) == values
        assert not line.staged or values["TGL_STAGE"] == 1.0


# --- a place along the contour ------------------------------------------------------------------

# Upstream, as all of a contour whose rising air is on its left and below: 5 m, and a shorter part.
CONTOUR = (((5.0, 1.0), (4.0, 1.0)), ((3.0, 4.0), (0.0, 0.0)))


def placed() -> Station:
    return Station(LineChanges(PRESETS, contour=CONTOUR))


def test_a_place_puts_the_point_on_the_longest_part_from_its_upstream_end() -> None:
    station = placed()
    assert station.set("TGL_PLACE", 2.5) == ["TGL_PLACE", "TGL_X", "TGL_Z"]
    assert station.server.values["TGL_X"] == pytest.approx(1.5)
    assert station.server.values["TGL_Z"] == pytest.approx(2.0)
    assert contour_length(CONTOUR) == 5.0
    assert contour_place(CONTOUR, 0.0) == (0.0, 0.0)
    assert contour_place(CONTOUR, 5.0) == (3.0, 4.0)
    assert contour_place(CONTOUR, 9.0) == (3.0, 4.0)


def test_a_place_goes_back_to_none_where_the_point_is_moved_and_not_where_it_leans() -> None:
    station = placed()
    station.set("TGL_PLACE", 2.5)
    station.set("TGL_LEAN", 20.0)
    assert station.server.values["TGL_PLACE"] == 2.5
    assert "TGL_PLACE" in station.set("TGL_X", 1.6)
    assert station.server.values["TGL_PLACE"] == -1.0
    station.set("TGL_PLACE", 1.0)
    station.set("TGL_PRESET", 2)
    assert station.server.values["TGL_PLACE"] == -1.0
    station.set("TGL_PLACE", 1.0)
    assert station.server.values["TGL_PRESET"] == 0.0
    station.set("TGL_PLACE", -1.0)
    assert station.server.values["TGL_X"] == pytest.approx(0.6)  # it stays


@pytest.mark.parametrize(
    ("contour", "value", "why"),
    [(CONTOUR, 5.1, "from 0 to 5 m"), (CONTOUR, -0.5, "from 0 to 5 m"), ((), 1.0, "contour")],
)
def test_a_place_that_is_not_there_is_refused(contour: Any, value: float, why: str) -> None:
    changes = LineChanges(PRESETS, contour=contour)
    with pytest.raises(ParameterError, match=why):
        changes.set(ParameterSet(), "TGL_PLACE", value, flying=False)


def test_a_place_is_checked_as_any_move_is() -> None:
    changes = LineChanges(PRESETS, contour=CONTOUR)
    with pytest.raises(ParameterError, match="TGL_STEP_MAX"):
        changes.set(ParameterSet(), "TGL_PLACE", 4.9, flying=True)
    no = LineChanges(PRESETS, lambda _: "nowhere to settle", CONTOUR)
    with pytest.raises(ParameterError, match="nowhere to settle"):
        no.set(ParameterSet(), "TGL_PLACE", 1.0, flying=True)
    staging = changes.set(ParameterSet(), "TGL_STAGE", 1.0, flying=False).values
    with pytest.raises(ParameterError, match="a move is being staged"):
        changes.set(staging, "TGL_PLACE", 1.0, flying=False)


@pytest.mark.parametrize("end", [0, 1])
def test_both_ends_of_a_contour_can_be_flown_to(end: int) -> None:
    """A point in 32 bits lies beside the end, and a line through it may miss the contour."""
    contour = (((2.3, 3.1), (0.9, 1.3), (0.1, 0.7)),)
    length_m = as_wire_value(contour_length(contour))
    bounds = LineBounds(contour, NO_GROUND)
    changes = LineChanges(PRESETS, bounds.fault, contour)
    values = changes.set(ParameterSet(), "TGL_PLACE", end * length_m, flying=False).values
    assert values["TGL_PLACE"] == end * length_m
    assert not bounds.fault(values)
