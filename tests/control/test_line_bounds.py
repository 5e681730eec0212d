"""An operator's slip: a line by which no aircraft can be held is refused, unless forced."""

from itertools import permutations
from pathlib import Path

import pytest
from test_line_changes import EDGE, Station, a_line

from tgl_soar.config.files import load_airframe, load_parameters, load_site, preset_lines, shipped
from tgl_soar.config.line_changes import LINE, LineChanges, PresetLine, Presets
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.line_bounds import FENCE, LineBounds, open_sides
from tgl_soar.types import Ground

BOX = {"FENCE_X_MIN": -3.0, "FENCE_X_MAX": 3.0, "FENCE_Z_MIN": 0.0, "FENCE_Z_MAX": 4.0}
# Level at 0 up to x = 0, then a slope of 45 degrees.
GROUND = Ground(3, (-9.0, 0.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0), (0.0, 0.0, 9.0, 9.0, 9.0, 9, 9, 9))
AIRFRAME = shipped("airframes/eclipson_c.toml")
SITES = [
    shipped(f"sites/{name}.toml")
    for name in ("tunnel", "tunnel_mocap", "tunnel_polynomial", "hill")
]


def values_of(**changes: float) -> ParameterSet:
    return ParameterSet().changed({"TGL_Z": 1.0, **BOX, **changes})


def station(bounds: LineBounds, presets: Presets = (), **changes: float) -> Station:
    """At a server that flies inside the box."""
    made = Station(LineChanges(presets, bounds.fault))
    made.server.values = values_of(**changes)
    return made


# --- the place --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({}, ""),
        ({"TGL_X": 3.5}, "the line's point is outside the fence (FENCE_X_MAX is 3 m)"),
        ({"TGL_X": -3.5}, "FENCE_X_MIN is -3 m"),
        ({"TGL_Z": -0.5}, "FENCE_Z_MIN is 0 m"),
        ({"TGL_Z": 17.0}, "FENCE_Z_MAX is 4 m"),
        ({"TGL_Z": 0.4, "CLEAR_MIN": 0.5}, "0.40 m from the ground (CLEAR_MIN is 0.5 m)"),
        # Across the slope, not above it: 0.6 / sqrt 2.
        ({"TGL_X": 1.0, "TGL_Z": 1.6, "CLEAR_MIN": 0.5}, "0.42 m from the ground"),
        ({"TGL_X": 1.0, "TGL_Z": 0.9}, "0.00 m from the ground (CLEAR_MIN is 0 m)"),
        # The point that is held, not that of a line alone.
        ({"TGL_HOLD": 1.0, "TGL_ALONG": -0.5}, ""),
        ({"TGL_HOLD": 0.0, "TGL_ALONG": -3.0}, ""),
        (
            {"TGL_HOLD": 1.0, "TGL_ALONG": -3.0},
            "the point that is held (TGL_ALONG) is outside the fence (FENCE_Z_MIN is 0 m)",
        ),
        ({"TGL_HOLD": 2.0, "TGL_ALONG": -0.6, "CLEAR_MIN": 0.5}, "TGL_ALONG) is 0."),
    ],
)
def test_where_a_line_s_point_may_be(changes: dict[str, float], reported: str) -> None:
    fault = LineBounds(ground=GROUND).fault(values_of(**changes))
    assert reported in fault
    assert bool(fault) == bool(reported)


def test_a_line_must_cross_the_contour_inside_the_fence_and_clear_of_the_ground() -> None:
    bounds = LineBounds(EDGE, GROUND)
    assert bounds.fault(values_of(TGL_X=-1.0)) == ""
    far = {"FENCE_X_MIN": -50.0, "FENCE_X_MAX": 50.0}
    assert "does not cross the known contour" in bounds.fault(values_of(TGL_X=-9.0, **far))
    upside_down = LineBounds((EDGE[0][::-1],), GROUND)
    assert "only where excess updraft grows" in upside_down.fault(values_of(TGL_X=-1.0))
    # Its point is at 3.9 m; 2.9 m lower, at the contour, it is 0.78 m farther downstream.
    lower = values_of(TGL_X=-1.0, TGL_Z=3.9, FENCE_Z_MIN=1.5)
    assert "crosses the known contour is outside the fence (FENCE_Z_MIN" in bounds.fault(lower)
    near = values_of(TGL_X=-1.0, TGL_Z=3.9, CLEAR_MIN=1.2)
    assert "crosses the known contour is 1.00 m from the ground" in bounds.fault(near)
    # One crossing of two is enough.
    both = LineBounds((EDGE[0], ((5.0, 3.0), (-5.0, 3.0))), GROUND)
    assert both.fault(lower) == ""


def test_a_fence_that_is_not_set_is_reported() -> None:
    assert "no fence" in open_sides(ParameterSet())
    assert open_sides(values_of()) == "the fence is open: FENCE_Y_MAX not set"
    assert open_sides(values_of(FENCE_Y_MAX=2.0)) == ""


# --- what is set ------------------------------------------------------------------------------


@pytest.mark.parametrize("flying", [False, True])
def test_a_point_that_slips_is_refused_and_one_can_always_be_released(flying: bool) -> None:
    there = station(LineBounds(EDGE, GROUND), (), TGL_HOLD=1.0)
    there.set("TGL_ALONG", -17.0, flying=flying)
    assert there.shown["TGL_ALONG"] == 0.0
    assert "TGL_ALONG = -17: the point that is held (TGL_ALONG) is outside" in there.words
    there.set("TGL_HOLD", 0.0, flying=flying)
    there.set("TGL_ALONG", -17.0, flying=flying)  # of no account while nothing is held
    assert there.server.values["TGL_ALONG"] == -17.0
    there.set("TGL_HOLD", 1.0, flying=flying)
    assert there.server.values["TGL_HOLD"] == 0.0
    assert there.words.startswith("TGL_HOLD = 1: the point that is held")


@pytest.mark.parametrize("flying", [False, True])
def test_a_slip_is_refused_and_nothing_has_changed(flying: bool) -> None:
    there = station(LineBounds(EDGE, GROUND), (PresetLine("far", 0.0, 9.0, 15.0),))
    before = there.server.values
    for name, value in (("TGL_Z", 17.0), ("TGL_X", 400.0), ("TGL_PRESET", 1.0)):
        assert there.set(name, value, flying=flying) == [name]
        assert there.shown[name] == before[name]
        assert there.words.startswith(f"{name} = {value:g}: the line's point is outside the fence")
        assert there.words.endswith("OP_FORCE 1 overrides once")
    assert there.server.values is before


def test_a_staged_move_is_checked_as_one() -> None:
    there = station(LineBounds((), GROUND), CLEAR_MIN=0.5)
    there.set("TGL_STAGE", 1)
    there.set("TGL_X", 1.0)  # alone it would touch the slope
    there.set("TGL_Z", 2.0)
    there.set("TGL_STAGE", 0)
    assert there.line[:2] == (1.0, 2.0)
    there.set("TGL_STAGE", 1)
    there.set("TGL_Z", 1.2)
    assert there.set("TGL_STAGE", 0) == ["TGL_STAGE", "TGL_Z"]
    assert there.shown == {"TGL_STAGE": 2.0, "TGL_X": 1.0, "TGL_Z": 2.0}
    assert "staged move dropped" in there.words
    assert "0.14 m from the ground" in there.words


def test_a_step_is_as_long_as_it_may_be_only_in_flight() -> None:
    there = station(LineBounds(), TGL_STEP_MAX=1.0)
    there.set("TGL_X", 1.25)
    assert there.line[0] == 0.0
    assert "1.25 m from where the line is to be now (TGL_STEP_MAX is 1 m)" in there.words
    there.set("TGL_X", 1.0)
    there.set("TGL_X", 2.0)
    assert (there.line[0], there.words) == (2.0, "")
    there.set("TGL_X", -2.0, flying=False)  # no aircraft is on it
    assert there.line[0] == -2.0


def test_force_acts_once_and_is_reported() -> None:
    there = station(LineBounds())
    assert there.set("OP_FORCE", 1) == ["OP_FORCE"]
    assert there.set("RHO_P", 0.5) == ["RHO_P"]  # no move: it waits
    assert there.set("TGL_X", 3.5) == ["TGL_X", "OP_FORCE"]
    assert "outside the fence" in there.words  # made, and reported
    assert (there.line[0], there.shown["OP_FORCE"]) == (3.5, 0.0)
    assert there.set("TGL_X", 3.5) == ["TGL_X"]  # repeated: it stands there
    assert there.words == ""
    there.set("TGL_X", 3.6)
    assert there.line[0] == 3.5
    there.set("TGL_X", 2.5)  # and the way back is open
    assert there.line[0] == 2.5
    there.set("OP_FORCE", 1)
    there.set("TGL_X", 2.4)  # needless, and used up all the same
    assert there.shown["OP_FORCE"] == 0.0


def test_on_the_ground_a_line_that_is_no_good_is_left_one_parameter_at_a_time() -> None:
    there = station(LineBounds((), GROUND), TGL_X=2.0, TGL_Z=0.5)  # a new site: it is in the slope
    there.set("TGL_X", 2.5, flying=True)
    assert there.line[0] == 2.0
    there.set("TGL_X", 2.5, flying=False)
    assert there.line[0] == 2.5
    assert "0.00 m from the ground" in there.words
    there.set("TGL_Z", 3.5, flying=False)
    assert (there.line[1], there.words) == (3.5, "")
    there.set("TGL_X", 9.0, flying=False)  # from now on it is good
    assert there.line[0] == 2.5


def test_a_fence_that_shuts_the_line_out_is_refused_in_flight_only() -> None:
    there = station(LineBounds((), GROUND))
    there.set("FENCE_Z_MAX", 0.5, flying=True)
    assert there.shown["FENCE_Z_MAX"] == 4.0
    assert "FENCE_Z_MAX = 0.5: the line's point is outside the fence" in there.words
    there.set("FENCE_Z_MAX", 0.5, flying=False)
    assert there.shown["FENCE_Z_MAX"] == 0.5
    assert "outside the fence" in there.words
    there.set("FENCE_Z_MAX", 0.8, flying=True)  # nearer to what is right, though not there
    assert there.shown["FENCE_Z_MAX"] == pytest.approx(0.8)


# --- the sites --------------------------------------------------------------------------------


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_the_shipped_sites_have_a_fence_and_lines_that_can_be_typed_one_value_at_a_time(
    path: Path,
) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(path)
    values = load_parameters(airframe, AIRFRAME, site, path)
    assert open_sides(values) == ""
    assert all(name in site.parameters for name in FENCE)
    presets = preset_lines(site, values)
    bounds = LineBounds(site.contour_for(airframe.airframe.name), site.known_ground())
    assert bounds.fault(values) == ""
    assert bounds.preset_faults(values, presets) == []
    for here, there in permutations(presets, 2):
        for first, *others in permutations(LINE):
            server = Station(LineChanges(presets, bounds.fault))
            server.server.values = values.changed(here.parameters())
            for name in (first, *others):
                server.set(name, there.parameters()[name])
                assert server.words == ""
            assert server.line == a_line(values.changed(there.parameters()))


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
@pytest.mark.parametrize(("name", "factor"), [("TGL_Z", 10.0), ("TGL_Z", 0.1), ("TGL_X", 10.0)])
def test_a_decimal_point_that_slips_is_refused_at_every_shipped_line(
    path: Path, name: str, factor: float
) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(path)
    values = load_parameters(airframe, AIRFRAME, site, path)
    presets = preset_lines(site, values)
    bounds = LineBounds(site.contour_for(airframe.airframe.name), site.known_ground())
    for preset in presets:
        server = Station(LineChanges(presets, bounds.fault))
        server.server.values = values.changed(preset.parameters())
        slip = preset.parameters()[name] * factor
        server.set(name, slip)
        if (preset.name, slip) != ("a", 2.0):  # of the tunnel: over the board's end, yet flyable
            assert "OP_FORCE" in server.words
