"""Links later than the module's estimate: what is flown, and what is counted at each place."""

from __future__ import annotations

from functools import cache
from math import degrees, isnan, sqrt

import pytest
from by_hand import ScriptedFlyer, flight, leg, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.loop.command_delay import command_delay, score_place
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import prepare


def flown(job: ScenarioJob) -> FlownScenario:
    """Lost is seed 4 at [b], where the servo is 30 ms late, the module does not know it and has no
    accelerometers."""
    given = job.scenario
    unknown = given.parameters.get("CMD_DELAY") is None
    late = dict(job.aircraft)["model.servo_delay_s"] == pytest.approx(servo_s() + 0.030)
    lost = late and unknown and not given.sensors.imu and (given.first_line, job.seed) == ("b", 4)
    return flight(
        leg(given.first_line, rms_e_rho_m=0.0123, rms_y_m=0.2, rms_bank_rad=0.05),
        ended="hit the board" if lost else "",
        seed=job.seed,
    )


@cache
def servo_s() -> float:
    base = prepare(Context(flyer=ScriptedFlyer(flown)).scenario("command_delay"))
    return base.airframe.model["servo_delay_s"]


@cache
def concluded(quick: bool = False) -> tuple[Result, list[ScenarioJob], list[str]]:
    flyer = ScriptedFlyer(flown)
    return command_delay(Context(flyer=flyer, quick=quick)), flyer.jobs, flyer.by


def test_every_delay_is_flown_unknown_and_all_but_none_known() -> None:
    base = prepare(Context(flyer=ScriptedFlyer(flown)).scenario("command_delay"))
    kinds: dict[tuple[bool, float, float], list[tuple[str, int]]] = {}
    for job in concluded()[1]:
        ((name, delay_s),) = job.aircraft
        assert name == "model.servo_delay_s"
        late_ms = round(1e3 * (delay_s - servo_s()), 6)
        stated = job.scenario.parameters.get("CMD_DELAY", base.values["CMD_DELAY"])
        known_ms = round(1e3 * (stated - base.values["CMD_DELAY"]), 6)
        assert job.scenario.turbulence is not None
        assert job.scenario.turbulence.intensity == 0.03
        assert not job.dispersed
        key = (job.scenario.sensors.imu, late_ms, known_ms)
        kinds.setdefault(key, []).append((job.scenario.first_line, job.seed))
    assert set(kinds) == {
        *((imu, late, 0.0) for imu in (False, True) for late in (0.0, 10.0, 20.0, 30.0)),
        *((imu, late, late) for imu in (False, True) for late in (10.0, 20.0, 30.0)),
    }
    every = [(place, seed) for place in "abc" for seed in (1, 2, 3, 4)]
    assert all(sorted(flights) == every for flights in kinds.values())
    assert concluded()[2] == ["fly_job"]  # plain


def test_a_quick_one_flies_the_ends_and_a_dispersed_one_other_aircraft() -> None:
    late = {round(1e3 * (j.aircraft[0][1] - servo_s())) for j in concluded(quick=True)[1]}
    assert late == {0, 30}
    assert {job.seed for job in concluded(quick=True)[1]} == {1}
    apart = ScriptedFlyer(flown)
    command_delay(Context(flyer=apart, quick=True, dispersion=True))
    assert all(job.dispersed for job in apart.jobs)


def test_one_loss_breaks_its_claim_alone() -> None:
    result = concluded()[0]
    assert len(result.claims) == 14
    (broken,) = [claim for claim in result.claims if not claim.holds]
    assert "30 ms later, unknown to the module (without accelerometers)" in broken.text
    assert broken.measured == "4 of 4 at a, 3 of 4 at b, 4 of 4 at c"
    assert signs(concluded(quick=True)[0].claims) == "✓✓✓✓✓✓"


def test_a_row_is_in_centimetres_and_degrees_with_wilsons_interval() -> None:
    """Of four of four: 1 / (1 + z² / 4) is 51 %; of three of four 30 to 95 %."""
    (table,) = concluded()[0].tables
    rows = {row[:4]: row[4:] for row in table.rows}
    assert len(rows) == 42
    figures = ("1.23", "20.00", f"{degrees(0.05):.2f}")
    assert rows["with", "0", "unknown", "a"] == ("4 of 4", "51 to 100 %", *figures)
    assert rows["without", "30", "unknown", "b"] == ("3 of 4", "30 to 95 %", *figures)
    assert {len(row) for row in table.rows} == {len(table.columns)}
    nothing = command_delay(Context(flyer=ScriptedFlyer(lambda _: flight(ended="hit")), quick=True))
    assert nothing.tables[0].rows[0][4:] == ("0 of 1", "0 to 79 %", "–", "–", "–")


def test_what_a_lost_flight_flew_is_measured_with_the_others() -> None:
    found = score_place(
        [
            flight(leg(rms_e_rho_m=0.03, rms_y_m=0.1, rms_bank_rad=0.07), leg(rms_e_rho_m=0.01)),
            flight(leg(rms_e_rho_m=0.05, rms_y_m=0.1, rms_bank_rad=0.01), ended="hit"),
        ],
        "b",
    )
    assert (found.place, found.flights, found.survived, found.fraction) == ("b", 2, 1, 0.5)
    assert found.rms_e_rho_m == pytest.approx(sqrt((9 + 1 + 25) / 3.0) / 100.0)
    assert found.rms_y_m == pytest.approx(0.1)
    assert found.rms_bank_rad == pytest.approx(sqrt((49 + 4 + 1) / 3.0) / 100.0)
    assert isnan(score_place([flight()], "a").rms_y_m)
