"""Aircraft drawn about the airframe file: what is flown, and how it is judged."""

from __future__ import annotations

from math import degrees
from types import SimpleNamespace
from typing import cast

import pytest
from scipy.stats import binom

from tgl_soar.analysis.experiments.aircraft.dispersed import (
    LEAST,
    DispersedCase,
    DispersedScore,
    LinearJob,
    _claims,
    margin_of,
    scored,
)
from tgl_soar.analysis.tuning import flights as tuning_flights
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.flights import (
    CLEAR_OF_GROUND,
    CLEAR_OF_STALL_RAD,
    DrawnFlight,
    FlyingPlace,
    soaring_aircraft,
)
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.control.envelope import clearance
from tgl_soar.control.found_gains import INERTIAL
from tgl_soar.control.supervisor import SOARING
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.aircraft import glide_at
from tgl_soar.sim.closed_loop import ClosedLoop

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH).changed(
    line_parameters(SITE.lines["a"])
)
FIELD = FlyingPlace(airframe=AIRFRAME, site_path=SITE_PATH, ranges=Ranges(), speed_ratio=0.94)


def test_whoever_flies_could_hover_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn evenly, some glide nearer to the stall, or lower, than a place may be; in
    air that takes everyone out of the tunnel there is none."""
    places = []
    for i in range(3):
        drawn, at, on_line = soaring_aircraft(FIELD, VALUES, (3, i))
        assert (at.x_m, at.z_m) == pytest.approx((on_line["TGL_X"], on_line["TGL_Z"]), abs=0.05)
        best_mps = best_glide_speed(drawn.known.polar.as_polar())
        assert at.wind_mps == pytest.approx(0.94 * best_mps, rel=0.01)
        places.append((at.x_m, at.z_m))
        alpha_rad = glide_at(drawn.true, at.wind_mps).alpha_rad
        assert degrees(drawn.true.stall_alpha_rad - alpha_rad) > degrees(CLEAR_OF_STALL_RAD)
        ground = clearance(SITE.known_ground(), at.x_m, at.z_m)
        assert ground > CLEAR_OF_GROUND * VALUES["CLEAR_MIN"]
    assert len(set(places)) == 3
    monkeypatch.setattr(tuning_flights, "REDRAWN_MAX", 2)
    with pytest.raises(ValueError, match="none has a place to soar"):
        soaring_aircraft(FIELD._replace(roughest=0.5), VALUES, (3, 0))


def test_an_unknown_delay_costs_margin() -> None:
    """30 ms at the crossovers of 5 and 20 rad/s are 9 and 34 degrees."""
    early, late = (
        margin_of(LinearJob(FIELD._replace(unknown_late_s=later_s), VALUES, INERTIAL, (3, 1)))
        for later_s in (0.0, 0.03)
    )
    assert early.alpha > late.alpha + 0.05


def flights(up: int, of: int) -> list[DrawnFlight]:
    """So many that lasted, and the rest on the board."""
    lost = DrawnFlight(
        up=False,
        rms_e_rho_m=0.3,
        duration_s=4.0,
        ended="hit the board at x 1.0, y 0.1, z 0.4 m",
        rms_y_m=0.4,
        rms_bank_rad=0.2,
    )
    kept = DrawnFlight(
        up=True, rms_e_rho_m=0.01, duration_s=30.0, ended="", rms_y_m=0.1, rms_bank_rad=0.05
    )
    return [kept] * up + [lost] * (of - up)


def test_the_lost_count_with_their_cause_and_in_the_mean() -> None:
    found = scored(flights(3, 4))
    assert (found.up, found.flights) == (3, 4)
    assert found.causes == (("hit the board", 1),)
    assert found.rms_e_rho_m == pytest.approx(((3 * 0.01**2 + 0.3**2) / 4) ** 0.5)
    assert found.rms_y_m == pytest.approx(((3 * 0.1**2 + 0.4**2) / 4) ** 0.5)
    assert found.rms_bank_rad == pytest.approx(((3 * 0.05**2 + 0.2**2) / 4) ** 0.5)


class Banked:
    """A loop whose aircraft hangs to one side, banked."""

    def __init__(self) -> None:
        q = quaternion_from_euler(-0.1, 0.05, 0.2)
        state = SimpleNamespace(x_m=0.0, y_m=-0.2, z_m=1.0)
        state.qw, state.qx, state.qy, state.qz = q
        self.world = SimpleNamespace(step_hz=200, state=state, crashed=False)

    def tick(self) -> SimpleNamespace:
        return SimpleNamespace(mode=SOARING, reason=0)


def test_side_and_bank_are_measured_where_they_are_flown() -> None:
    flown = tuning_flights._flown(cast(ClosedLoop, Banked()), (0.0, 1.0, 1.8), 0.1)
    assert flown.up
    assert flown.rms_y_m == pytest.approx(0.2)
    assert flown.rms_bank_rad == pytest.approx(0.1)


def test_the_interval_is_exact() -> None:
    """At its ends the observed count, or worse and better, has 2.5 %."""
    low, high = scored(flights(95, 100)).interval
    assert binom.sf(94, 100, low) == pytest.approx(0.025, rel=1e-3)
    assert binom.cdf(95, 100, high) == pytest.approx(0.025, rel=1e-3)
    assert scored(flights(100, 100)).interval[1] == 1.0


def test_each_place_is_judged_alone() -> None:
    """97 % of both together would pass at 5 %."""

    def scores(at_b: int) -> dict[DispersedCase, DispersedScore]:
        return {
            DispersedCase(INERTIAL, 0.05, 0.0, place): scored(flights(up, 100))
            for place, up in (("a", 100), ("b", at_b))
        }

    assert LEAST[0.05, 0.0] == 0.9
    assert _claims(scores(90))[0].holds
    assert not _claims(scores(89))[0].holds
