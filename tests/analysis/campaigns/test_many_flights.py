"""Many flights of an airframe file over a site: the jobs, the score of one, and the table."""

from __future__ import annotations

import re
from collections import Counter
from math import cos, degrees, inf, isnan, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from tgl_soar.analysis.campaigns import many_flights
from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS
from tgl_soar.analysis.campaigns.many_flights import (
    FlightsAsked,
    LegFlight,
    LegJob,
    as_markdown,
    as_table,
    campaign_of,
    jobs_of,
    scored,
    summarised,
    table_of,
)
from tgl_soar.analysis.experiments.flights import ScenarioJob, scenario_world
from tgl_soar.analysis.experiments.random_aircraft import drawn_mismatch
from tgl_soar.analysis.experiments.scenario import Scenario, prepare
from tgl_soar.config.files import ConfigError, shipped
from tgl_soar.control.supervisor import RECOVERING
from tgl_soar.control.supervisor import SOARING as SOARING_MODE
from tgl_soar.sim.campaign.rows import columns_of
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.compiled import available

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
ASKED = FlightsAsked(
    airframe=AIRFRAME,
    site=SITE,
    legs=("a", "b"),
    turbulences=(0.0, 0.03),
    flights=3,
    seed=7,
    duration_s=20.0,
    dispersed=True,
    parameters={"RHO_P": 0.5},
)
HZ = 200


def changed(folder: Path, path: Path, pattern: str, instead: str) -> Path:
    """A file with something else in it."""
    text, count = re.subn(pattern, instead, path.read_text(encoding="utf-8"))
    assert count == 1
    new = folder / path.name
    new.write_text(text, encoding="utf-8")
    return new


# --- the jobs ------------------------------------------------------------------------------------


def test_each_leg_is_flown_in_each_turbulence_with_the_same_seeds() -> None:
    jobs = jobs_of(ASKED)
    assert len(jobs) == 12
    assert [(job.leg, job.turbulence, job.seed) for job in jobs[:7]] == [
        ("a", 0.0, 7), ("a", 0.0, 8), ("a", 0.0, 9), ("a", 0.03, 7), ("a", 0.03, 8), ("a", 0.03, 9),
        ("b", 0.0, 7),
    ]  # fmt: skip
    assert jobs[11].dispersed
    with pytest.raises(IndexError):
        jobs[12]
    campaign = campaign_of(jobs)
    assert campaign.seeds == (7, 9)
    assert campaign.parameters["legs"] == ["a", "b"]
    assert campaign.parameters["parameters"] == {"RHO_P": 0.5}
    assert len(jobs_of(ASKED._replace(legs=()))) == 18  # a, b and c


def test_a_flight_is_on_its_leg_in_its_turbulence_with_its_parameters() -> None:
    job = jobs_of(ASKED)[9]
    scenario = msgspec.json.decode(job.scenario, type=Scenario)
    prepared = prepare(scenario)
    values, site = prepared.values, prepared.site
    assert [values["TGL_X"], values["TGL_Z"], values["RHO_P"]] == pytest.approx([0.6, 1.6, 0.5])
    assert site.air is not None
    assert site.air.turbulence.intensity == 0.03
    assert scenario.duration_s == 20.0
    assert scenario.sensors.as_sensors() == SENSORS[EVERY_SENSOR]
    crossing = prepared.lines["b"].crossing
    assert crossing is not None
    assert site.start is not None
    assert [site.start.x_m, site.start.z_m] == [crossing.x_m + 0.3, crossing.z_m]


def test_a_leg_that_meets_no_contour_is_flown_from_the_sites_start(tmp_path: Path) -> None:
    """At the nozzle's lip the wind is level: there is no updraft on the line."""
    site = changed(tmp_path, SITE, r"(?m)^b = .*$", "b = { x_m = -0.4, z_m = 0.5, lean_deg = 15 }")
    job = jobs_of(ASKED._replace(site=site, legs=("b",)))[0]
    prepared = prepare(msgspec.json.decode(job.scenario, type=Scenario))
    assert prepared.lines["b"].crossing is None
    assert prepared.site.start is not None
    assert [prepared.site.start.x_m, prepared.site.start.z_m] == [0.6, 1.2]


def test_what_files_lack_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--legs z: no line of .*tunnel.toml; it has a, b, c"):
        jobs_of(ASKED._replace(legs=("a", "z")))
    bare = changed(tmp_path, AIRFRAME, r"(?s)\n\[model\]\n.*?(?=\n\[autopilot\])", "")
    with pytest.raises(ConfigError, match=r"\[model\]: missing, and nothing is simulated without"):
        jobs_of(ASKED._replace(airframe=bare))
    simple = changed(tmp_path, AIRFRAME, r"\n\[model\]\n", '\n[model]\nkind = "point_mass"\n')
    with pytest.raises(ConfigError, match="--dispersion needs the rigid body"):
        jobs_of(ASKED._replace(airframe=simple))
    assert len(jobs_of(ASKED._replace(airframe=simple, dispersed=False))) == 12
    without = changed(tmp_path, SITE, r"(?s)\n\[air\]\n.*?(?=\n\[start\])", "")
    with pytest.raises(ConfigError, match=r"no \[air\] table"):
        jobs_of(ASKED._replace(site=without))
    without = changed(tmp_path, SITE, r"(?s)\n\[lines\]\n.*?(?=\n# The fence)", "")
    with pytest.raises(ConfigError, match=r"its lines are none: give it a table \[lines\]"):
        jobs_of(ASKED._replace(site=without, legs=()))
    with pytest.raises(ConfigError, match="RHO_PP"):
        jobs_of(ASKED._replace(parameters={"RHO_PP": 1.0}))


def test_another_aircraft_or_site_is_another_campaign(tmp_path: Path) -> None:
    before = campaign_of(jobs_of(ASKED)).parameters
    heavier = changed(tmp_path, AIRFRAME, "mass_kg = 0.699", "mass_kg = 0.7")
    faster = changed(tmp_path, SITE, "wind_mps = 8.5", "wind_mps = 8.6")
    for name, asked in (
        ("airframe", ASKED._replace(airframe=heavier)),
        ("site", ASKED._replace(site=faster)),
        ("duration_s", ASKED._replace(duration_s=21.0)),
    ):
        after = campaign_of(jobs_of(asked)).parameters
        assert [key for key in before if before[key] != after[key]] == [name]


# --- one flight ----------------------------------------------------------------------------------

OFF_M, AWAY_M, SIDE_M, BANK = 0.02, 0.1, 0.3, 0.04


def trajectory(seconds: float, ended: str = "", mode: int = SOARING_MODE) -> Trajectory:
    """On line b: a metre off it for 2 s, then by OFF_M to and fro, AWAY_M above where line and
    contour meet; the elevator moves by 0.01 to and fro, tick by tick."""
    target, at = line_b()
    n = round(seconds * HZ)
    time_s, sign = np.arange(n) / HZ, np.where(np.arange(n) % 2, 1.0, -1.0)
    c, s = cos(target.eta_rad), sin(target.eta_rad)
    e = np.where(time_s < 2.0, 1.0, OFF_M * sign)
    elevator = np.where(time_s < 5.0, 0.5, 0.005) * sign  # not scored until then
    columns = {
        "time_s": time_s, "x_m": at[0] + c * AWAY_M - s * e, "z_m": at[1] + s * AWAY_M + c * e,
        "y_m": SIDE_M * sign, "roll_rad": BANK * sign, "elevator": elevator,
        "line_moving": np.zeros(n), "target_changes": np.zeros(n), "mode": np.full(n, float(mode)),
    }  # fmt: skip
    return Trajectory(columns, ended, n)


def line_b() -> tuple[Any, tuple[float, float]]:
    placed = prepare(scenario_b()).lines["b"]
    assert placed.crossing is not None
    return placed.target, (placed.crossing.x_m, placed.crossing.z_m)


def scenario_b() -> Scenario:
    return msgspec.json.decode(jobs_of(ASKED._replace(legs=("b",)))[0].scenario, type=Scenario)


def score(flown: Trajectory, dispersed: bool = False) -> LegFlight:
    job = LegJob(leg="b", turbulence=0.0, seed=7, dispersed=dispersed, scenario=b"")
    world: Any = SimpleNamespace(step_hz=HZ, model=None, field=None)
    return scored(job, prepare(scenario_b()), world, flown)


def test_a_flight_is_scored_once_it_has_had_time_to_settle() -> None:
    row = score(trajectory(20.0))
    assert (row.result, row.reason, row.ended_s, row.survived) == ("soaring", "", 20.0, True)
    assert row.settling_s == pytest.approx(2.0, abs=0.02)
    assert row.scored_s == pytest.approx(15.0, abs=0.02)
    assert row.rms_e_rho_m == pytest.approx(OFF_M, rel=1e-6)
    assert row.peak_e_rho_m == pytest.approx(OFF_M, rel=1e-6)
    assert row.rms_along_m == pytest.approx(0.0, abs=1e-9)
    assert row.rms_y_m == pytest.approx(SIDE_M)
    assert row.rms_bank_rad == pytest.approx(BANK)
    assert row.rms_elevator_rate_per_s == pytest.approx(0.01 * HZ)
    assert row.off_contour_m == pytest.approx(AWAY_M, abs=1e-3)
    assert (row.off_own_contour_m, row.drawn) == (None, None)
    assert score(trajectory(20.0), dispersed=True).drawn == drawn_mismatch(7)


@pytest.mark.parametrize(("seconds", "ended", "mode", "result", "reason", "survived"), [
    (20.0, "", RECOVERING, "flying", "recovering", True),
    (9.0, "disengaged: outside the fence", SOARING_MODE, "released", "outside the fence", False),
    (9.0, "hit the board at x 0.6 m", SOARING_MODE, "lost", "hit the board", False),
])  # fmt: skip
def test_it_is_known_why_a_flight_ended(
    seconds: float, ended: str, mode: int, result: str, reason: str, survived: bool
) -> None:
    row = score(trajectory(seconds, ended, mode))
    assert (row.result, row.reason, row.survived) == (result, reason, survived)
    assert row.ended_s == seconds
    assert row.rms_e_rho_m == pytest.approx(OFF_M)  # as far as it flew


def test_what_is_lost_at_once_has_no_figures_and_never_settled() -> None:
    row = score(trajectory(3.0, "hit the board at x 0.6 m"))
    assert (row.result, row.settling_s, row.scored_s) == ("lost", inf, 0.0)
    assert all(isnan(getattr(row, name)) for name in ("rms_e_rho_m", "off_contour_m", "rms_y_m"))
    assert isnan(row.rms_elevator_rate_per_s)


def test_an_aircraft_that_cannot_fly_at_its_start_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot(*_given: Any) -> None:
        raise ConfigError("no trim")

    job = jobs_of(ASKED._replace(legs=("b",)))[0]
    monkeypatch.setattr(many_flights, "scenario_world", cannot)
    row = many_flights.fly_leg(job)
    assert (row.result, row.reason, row.ended_s) == ("lost", "no trim", 0.0)
    assert row.drawn == drawn_mismatch(7)


@pytest.mark.skipif(not available(), reason="numba is not installed")
@pytest.mark.xdist_group("kernels")
def test_a_compiled_flight_is_scored_as_the_one_in_plain_python() -> None:
    """The same flight, of a drawn aircraft: sums differ in their last digits alone."""
    asked = ASKED._replace(legs=("b",), turbulences=(0.01,), duration_s=9.0, parameters={})
    job = jobs_of(asked)[1]
    row = many_flights.fly_leg(job)
    scenario = msgspec.json.decode(job.scenario, type=Scenario)
    prepared = prepare(scenario)
    asked_for = ScenarioJob(scenario=scenario, seed=job.seed, dispersed=True)
    world = scenario_world(asked_for, prepared, None)
    plain = scored(job, prepared, world, fly(world, prepared.values, (), 9.0))
    assert (row.leg, row.turbulence, row.seed, row.result) == ("b", 0.01, 8, "soaring")
    assert row.drawn == plain.drawn == drawn_mismatch(8)
    for name in LegFlight._fields:
        if name != "drawn":
            assert getattr(row, name) == pytest.approx(getattr(plain, name), rel=1e-6, abs=1e-9)
    assert 0.0 < row.rms_e_rho_m < row.peak_e_rho_m < 0.2
    # The files' contour is not its own, and it hovers at its own.
    assert row.off_own_contour_m is not None
    assert abs(row.off_own_contour_m) < 0.2


def test_a_row_names_what_was_drawn() -> None:
    names = [column.name for column in columns_of(LegFlight)]
    assert {"leg", "turbulence", "seed", "drawn_lift", "drawn_hill_growth"} <= set(names)
    assert "scenario" not in {column.name for column in columns_of(LegJob)}


# --- the table -----------------------------------------------------------------------------------


def flights() -> list[LegFlight]:
    """Four on leg b, of which the last was lost at once."""
    whole = score(trajectory(20.0))
    return [
        *(
            whole._replace(rms_e_rho_m=0.01 * n, off_contour_m=-0.1 * n, settling_s=float(n))
            for n in (3, 1, 2)
        ),
        score(trajectory(3.0, "hit the board at x 0.6 m")),
    ]


def test_median_and_worst_are_given_with_how_many_they_are_of() -> None:
    (b,) = summarised(flights())
    assert (b.leg, b.turbulence, b.flights, b.survived) == ("b", 0.0, 4, 3)
    assert b.figures["rms_e_rho_m"] == pytest.approx((0.02, 0.03, 3))
    assert b.figures["off_contour_m"] == pytest.approx((0.2, 0.3, 3))
    assert b.figures["settling_s"] == (2.5, inf, 4)  # the lost one too: it never settled
    assert b.figures["off_own_contour_m"].of == 0
    assert b.reasons == Counter({"hit the board": 1})
    # Clopper and Pearson of 3 of 4: 1 - BetaInv(0.975; 2, 3) and so on, by their table.
    assert b.interval == pytest.approx((0.1941, 0.9937), abs=1e-4)


def test_a_table_for_people() -> None:
    head, (row,) = table_of(summarised(flights()))
    assert dict(zip(head, row, strict=True)) == {
        "leg": "b",
        "turbulence": "0 %",
        "to the end": "3 of 4",
        "95 % interval": "19.4 to 99.4 %",
        "settled after [s]": "2.5, never",
        "rms e_rho [cm]": "2.00, 3.00 (3 of 4)",
        "peak e_rho [cm]": "2.0, 2.0 (3 of 4)",
        "rms along [cm]": "0.0, 0.0 (3 of 4)",
        "rms y [cm]": "30.0, 30.0 (3 of 4)",
        "rms bank [°]": f"{degrees(BANK):.1f}, {degrees(BANK):.1f} (3 of 4)",
        "elevator's rate [1/s]": "2.00, 2.00 (3 of 4)",
        "off TGL ∩ ZEUC [cm]": "20.0, 30.0 (3 of 4)",
        "ended by": "hit the board (1)",
    }  # nothing was drawn: no contour of its own
    page = as_markdown("What was flown.", summarised(flights()))
    lines = page.splitlines()
    assert lines[0] == "What was flown."
    assert len({line.count("|") for line in lines if line.startswith("|")}) == 1


def test_a_table_for_programs_is_in_si_units() -> None:
    head, (row,) = as_table(summarised(flights()))
    found = dict(zip(head, row, strict=True))
    assert (found["flights"], found["survived"], found["ended_by"]) == (4, 3, "hit the board: 1")
    assert found["rms_e_rho_m_worst"] == pytest.approx(0.03)
    assert found["rms_e_rho_m_of"] == 3
    assert found["low"] == pytest.approx(0.1941, abs=1e-4)


def test_legs_and_turbulences_are_apart() -> None:
    one, *_ = flights()
    found = summarised([one, one._replace(turbulence=0.03), one._replace(leg="c"), one])
    assert [(s.leg, s.turbulence, s.flights) for s in found] == [
        ("b", 0.0, 2), ("b", 0.03, 1), ("c", 0.0, 1)
    ]  # fmt: skip
