"""The paper's three places: which wind has them, and what their flights are judged by."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.paper.changing_air import Shift
from tgl_soar.analysis.experiments.paper.places import (
    JUDGED,
    RISES_S,
    ROUGH,
    STRONGER,
    FlownPlace,
    _row,
    in_its_wind,
    place_claims,
    places,
    places_why,
    stepped,
    wind_slope,
)
from tgl_soar.analysis.experiments.scenario import Scenario, prepare
from tgl_soar.config.files import ConfigError, shipped
from tgl_soar.types import polar_slope

GRID = """
[site]
name = "a hill, computed elsewhere"
[air]
kind = "grid"
file = "plane.csv"
wind_mps = 7.0
zero_cells = "solid"
"""
FENCE = """
[parameters]
FENCE_X_MIN = -14.0
FENCE_X_MAX = 0.0
FENCE_Z_MIN = 0.5
FENCE_Z_MAX = 18.0
"""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Context(Flyer()).scenario("places")


def test_sink_falls_as_wind_grows_at_the_slow_places_alone(scenario: Scenario) -> None:
    for line in scenario.lines:
        prepared = prepare(in_its_wind(scenario, shipped("sites/hill.toml"), line)[0])
        at = prepared.lines[line].crossing
        assert at is not None
        assert (polar_slope(prepared.polar, at.wind_mps) < 0.0) == (line in ("a", "a2"))


def test_a_place_is_flown_in_the_nearest_wind_that_has_it(scenario: Scenario) -> None:
    """The board's contour has the tunnel's slow place in less wind, its fast one in more."""
    tunnel = shipped("sites/tunnel.toml")
    own = 8.5
    found = {line: in_its_wind(scenario, tunnel, line) for line in scenario.lines}
    winds = {line: wind for line, (_, wind) in found.items()}
    assert winds["a"] < own
    assert winds["b"] == own
    assert winds["c"] > own
    for line, (placed, wind) in found.items():
        assert placed.wind is not None
        assert placed.wind.mps == [wind, wind]
        at = prepare(placed).lines[line].crossing
        assert at is not None
        ratio = scenario.lines[line].speed_ratio
        assert ratio is not None
        assert at.wind_mps == pytest.approx(ratio * 9.2655, abs=0.01)


def test_a_place_that_no_wind_has_is_refused(scenario: Scenario, tmp_path: Path) -> None:
    text = shipped("sites/tunnel.toml").read_text()
    slow = tmp_path / "slow.toml"
    slow.write_text(text.replace("wind_mps = 8.5", "wind_mps = 5.0"))
    with pytest.raises(ConfigError, match=r"lines\.c is nowhere in 85 to 115 % of its wind of 5"):
        in_its_wind(scenario, slow, "c")
    still = tmp_path / "still.toml"
    still.write_text('[site]\nname = "no air"\n')
    with pytest.raises(ConfigError, match=r"no \[air\] table"):
        in_its_wind(scenario, still, "a")


def test_a_site_that_is_given_is_flown_in_alone_and_drawn_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also a changed copy of the hill, which has the hill's name."""
    flown: list[Scenario] = []

    class Asked(Exception):
        """What is flown is known."""

    def fly(_: Context, variants: dict[object, Scenario]) -> None:
        flown.extend(variants.values())
        raise Asked

    monkeypatch.setattr(Context, "fly", fly)
    site = tmp_path / "mine.toml"
    text = shipped("sites/hill.toml").read_text(encoding="utf-8")
    site.write_text(text.replace("wind_mps = 7.0", "wind_mps = 6.9"), encoding="utf-8")
    with pytest.raises(Asked):
        places(Context(flyer=Flyer(), field=site))
    assert {each.site for each in flown} == {str(site)}
    assert len(flown) == 12
    flown.clear()
    with pytest.raises(Asked):
        places(Context(flyer=Flyer()))
    sites = ["hill", "tunnel", "tunnel_polynomial"]
    assert {each.site for each in flown} == {str(shipped(f"sites/{name}.toml")) for name in sites}
    assert len(flown) == 36


def test_a_computed_plane_is_searched_within_its_fence(scenario: Scenario, tmp_path: Path) -> None:
    """The place of the hill is found in a plane of that hill's wind, to a fraction of its step."""
    axes = np.arange(-16.0, 0.1, 0.1), np.arange(0.0, 20.0, 0.1)
    x, z = (axis.ravel() for axis in np.meshgrid(*axes))
    u, _, w = HillField(7.0, 8.0).wind(x, 0.0, z)
    table = np.column_stack([x, z, u, w])
    np.savetxt(tmp_path / "plane.csv", table, "%.9g", ",", header="x,z,u,w", comments="")
    site = tmp_path / "plane.toml"
    site.write_text(GRID)
    with pytest.raises(ConfigError, match="FENCE_X_MIN, FENCE_X_MAX, FENCE_Z_MIN, FENCE_Z_MAX"):
        prepare(msgspec.structs.replace(scenario, site=str(site)))
    site.write_text(GRID + FENCE)
    there = prepare(in_its_wind(scenario, site, "b")[0]).lines["b"].crossing
    here = prepare(in_its_wind(scenario, shipped("sites/hill.toml"), "b")[0]).lines["b"].crossing
    assert there is not None
    assert here is not None
    assert (there.x_m, there.z_m) == pytest.approx((here.x_m, here.z_m), abs=0.02)


def test_the_wind_rises_between_two_legs_that_are_both_settled(scenario: Scenario) -> None:
    placed, wind = in_its_wind(scenario, shipped("sites/hill.toml"), "b")
    risen = stepped(placed, wind)
    assert risen.wind is not None
    assert risen.wind.mps == [wind, pytest.approx(STRONGER * wind)]
    (again,) = risen.changes
    assert (again.line, again.time_s) == ("b", RISES_S[1])
    assert any(a <= RISES_S[0] and RISES_S[1] < b for a, b in risen.unscored_s)


def test_wind_grows_going_down_on_the_hill_and_going_up_before_the_board(
    scenario: Scenario,
) -> None:
    """Over a hill the flow is fastest at its surface, du/dr < 0; a jet is slow at the foot."""
    hill, tunnel = (
        prepare(in_its_wind(scenario, shipped(f"sites/{name}.toml"), "a")[0])
        for name in ("hill", "tunnel")
    )
    assert wind_slope(hill, "a") < 0.0 < wind_slope(tunnel, "a")


def place(
    line: str, slope: float, shift_m: float, rms_m: float = 0.006, lost: int = 0
) -> FlownPlace:
    return FlownPlace(
        site="a hill",
        line=line,
        wind_mps=7.0,
        x_m=0.0,
        z_m=1.0,
        local_mps=8.0,
        speed_ratio=0.9,
        polar_slope=slope,
        margin=0.1,
        leverage=0.95,
        rate_per_s=0.8,
        wind_slope_per_s=0.2,
        flights=8,
        survived={JUDGED: 8 if rms_m < inf else 7, ROUGH: 6},
        rms_e_rho_m={JUDGED: rms_m, ROUGH: inf},
        dispersion_m={JUDGED: 0.03, ROUGH: nan},
        apart_m={JUDGED: 0.01, ROUGH: nan},
        formula_m={JUDGED: 0.03, ROUGH: 0.09},
        shift=Shift(
            line=line,
            flown_m=shift_m,
            predicted_m=shift_m,
            up_m=shift_m,
            error_m=0.01,
            off_m=shift_m - shift_m,
            off_error_m=0.01,
            worst_off_m=0.0,
            worst_glide_m=0.0,
        ),
        shift_lost=lost,
        stalled=0,
        ended=("left the air at x 1, y 0, z 2 m",),
    )


PLACES = [
    place("a", -0.07, 0.1),
    place("a2", -0.03, 0.09),
    place("b", 0.15, -0.01),
    place("c", 0.2, -0.05),
]


@pytest.mark.parametrize(
    ("which", "instead", "holds"),
    [
        (0, PLACES[0], [True, True, True, True]),
        (0, place("a", 0.01, 0.1), [False, True, True, True]),
        (1, place("a2", 0.01, 0.1), [False, True, True, True]),
        (0, place("a", -0.07, 0.1, rms_m=inf), [True, False, True, True]),
        (1, place("a2", -0.03, 0.1, rms_m=0.031), [True, False, True, True]),
        (2, place("b", 0.15, -0.01, rms_m=inf), [True, True, False, True]),
        (3, place("c", 0.2, -0.05, rms_m=0.031), [True, True, False, True]),
        (0, place("a", -0.07, 0.019), [True, True, True, False]),  # within 2.4 standard errors
        (0, place("a", -0.07, nan), [True, True, True, False]),
        (0, place("a", -0.07, 0.1, lost=1), [True, True, True, False]),
        (2, place("b", 0.15, 0.11), [True, True, True, False]),
        (3, place("c", 0.2, -0.019), [True, True, True, False]),
    ],
)
def test_each_claim_is_judged_by_what_it_says(
    which: int, instead: FlownPlace, holds: list[bool]
) -> None:
    claims = place_claims([*PLACES[:which], instead, *PLACES[which + 1 :]])
    assert [claim.holds for claim in claims] == holds
    assert [claim.by_construction for claim in claims] == [True, False, False, False]


def test_losses_and_their_reasons_are_reported_by_air() -> None:
    reported = places_why(PLACES)
    assert "a hill: wind grows by +0.20 m/s for each metre up the line at [a]" in reported
    assert (
        "lost of 24 at 1 % and 3 % of turbulence and in the stronger wind: 2 at [a], 2 at [a2],"
        " 2 at [b], 2 at [c]"
    ) in reported
    assert "Flights ended by: left the air." in reported


def test_what_the_wind_does_along_the_line_is_the_reason_where_the_losses_say_so() -> None:
    near, far = PLACES[:2], PLACES[2:]
    kept = [s._replace(survived={JUDGED: 8, ROUGH: 8}) for s in near]
    grows = [s._replace(site="before it", wind_slope_per_s=-0.1) for s in kept]
    stalled = [s._replace(stalled=2) for s in near]
    for several in ([*stalled, *far], [*stalled, *grows]):
        words = places_why(several)
        assert "All 4 were where the wind falls going down the line" in words
        assert "no more lift to give, stalls and slides" in words
    assert "most of them did not stall" in places_why([*near, *far])
    assert "Near it no flight of 48 was lost" in places_why([*kept, *far])
    lost = [s._replace(survived={JUDGED: 8, ROUGH: 7}) for s in grows]
    assert "4 were lost where the wind falls going down the line, and 2" in places_why(
        [*near, *lost]
    )


def test_losses_near_the_stall_are_of_all_flights_there() -> None:
    """At 1 %, at 3 % and with the step: 2 + 6 + 5."""
    all_three = PLACES[0]._replace(survived={JUDGED: 6, ROUGH: 2}, shift_lost=5, stalled=13)
    assert all_three.lost == 13
    kept = PLACES[1]._replace(survived={JUDGED: 8, ROUGH: 8})
    words = places_why([all_three, kept, *PLACES[2:]])
    assert "Near it 13 flights of 48 were lost; in 13 of them the angle of attack" in words


def test_a_shift_within_its_error_is_undecided() -> None:
    claim = place_claims([place("a", -0.07, 0.023), *PLACES[1:]])[-1]
    assert claim.undecided
    assert not place_claims([place("a", -0.07, -0.1), *PLACES[1:]])[-1].undecided


def test_a_table_has_no_number_of_flights_that_were_lost() -> None:
    assert _row(place("a", -0.07, 0.1))[-3] == "+10.0 ± 1.0"
    lost = _row(place("a", -0.07, nan, rms_m=inf, lost=8))
    assert (lost[10], lost[-3]) == ("lost", "lost")
    assert "nan" not in " ".join(lost)
