"""An aircraft that no gain was found on: which gains fly it, and how they are compared."""

from __future__ import annotations

from math import sqrt

import pytest

from tgl_soar.analysis.experiments.aircraft.unseen import (
    NOTHING_ENDS,
    PILOTS,
    PLAIN,
    PLAIN_GAINS,
    ROWS,
    WITH,
    WITHOUT,
    UnseenJob,
    UnseenRow,
    UnseenScore,
    fly_rows,
    fly_unseen,
    pilots_values,
    row_claims,
    scenario_of,
    score_unseen,
)
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.analysis.tuning.flights import DrawnFlight
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.polar import best_glide_speed

SCENARIO = load_scenario(shipped("scenarios/unseen.toml"))
SHIPPED = load_airframe(shipped("airframes/eclipson_c.toml"))
ROW = UnseenRow(name="a row", lean_deg=15.0, turbulence=0.03, places=("a", "b"))


def test_the_module_flies_the_shipped_gains_on_another_aircraft() -> None:
    unseen = load_airframe(SCENARIO.airframe)
    gains = ("RHO", "ELE", "AIL", "RUD", "SIDE")
    own = {k: v for k, v in unseen.parameters.items() if k.startswith(gains)}
    assert own == {k: v for k, v in SHIPPED.parameters.items() if k.startswith(gains)}
    known, before = unseen.all_parameters(), SHIPPED.all_parameters()
    at_8_5 = 8.5 / known["DYN_SPEED"]
    assert known["DYN_FREQ"] * at_8_5 == pytest.approx(6.6, rel=0.01)
    assert known["DYN_FREQ"] < 0.6 * before["DYN_FREQ"]
    assert known["DYN_SERVO"] == pytest.approx(0.030, rel=0.01)


def test_only_the_plain_pid_flies_without_limits_and_schedule() -> None:
    values = prepare(SCENARIO).values
    for pilot in PILOTS:
        own = pilots_values(values, pilot, 1.4)
        assert own["EST_IMU"] == (pilot == WITH)
        assert own["RHO_P_IMU"] == pytest.approx(1.4 * values["RHO_P_IMU"])
        if pilot == PLAIN:
            assert own["RHO_P"] == pytest.approx(1.4 * PLAIN_GAINS["RHO_P"])
            assert all(own[name] == value for name, value in NOTHING_ENDS.items())
            assert own["RHO_SPEED"] == 0.0
        else:
            assert own["RHO_P"] == pytest.approx(1.4 * values["RHO_P"])
            assert own["CLEAR_MIN"] == values["CLEAR_MIN"] > 0.0


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_every_row_has_places_to_settle_at(row: UnseenRow) -> None:
    for place in row.places:
        job = UnseenJob(scenario=SCENARIO, row=row, pilot=WITH, place=place, seed=1)
        prepared = prepare(scenario_of(job))
        at = prepared.lines[place].crossing
        assert at is not None
        ratio = row.speed_ratio or SCENARIO.lines[place].speed_ratio
        assert at.wind_mps / best_glide_speed(prepared.polar) == pytest.approx(ratio, rel=0.01)


def of(up: int, flights: int, rms_m: float) -> list[DrawnFlight]:
    kept = DrawnFlight(up=True, rms_e_rho_m=rms_m, duration_s=30.0, ended="", rms_y_m=0.1)
    lost = kept._replace(up=False, ended="hit the board at x 1.0, y 0.1, z 0.4 m")
    return [kept] * up + [lost] * (flights - up)


def scores(inertial: tuple[int, int], rms_m: float) -> dict[tuple[str, str], UnseenScore]:
    """Six at each of two places; with the plain PID all last, at 2 cm."""
    found = {"a": of(inertial[0], 6, rms_m), "b": of(inertial[1], 6, rms_m)}
    plain = {"a": of(6, 6, 0.02), "b": of(6, 6, 0.02)}
    return {(ROW.name, WITH): score_unseen(found), (ROW.name, PLAIN): score_unseen(plain)}


def test_places_are_compared_one_by_one_and_e_rho_where_all_last() -> None:
    lasting, nearer = row_claims(ROW, scores((6, 6), 0.0099))
    assert lasting.holds
    assert nearer.holds
    assert not row_claims(ROW, scores((6, 6), 0.0101))[1].holds
    lasting, nearer = row_claims(ROW, scores((6, 5), 0.001))
    assert (nearer.holds, nearer.undecided, nearer.measured) == (False, True, "1 and 0 lost")
    assert not lasting.holds


def test_pilots_who_both_lose_every_flight_have_shown_nothing() -> None:
    none = score_unseen({"a": of(0, 6, 0.01), "b": of(0, 6, 0.01)})
    lasting, nearer = row_claims(ROW, {(ROW.name, WITH): none, (ROW.name, PLAIN): none})
    assert (nearer.holds, nearer.undecided) == (False, True)
    assert not lasting.holds
    assert lasting.measured == "0 / 0 and 0 / 0, of 6"
    one = score_unseen({"a": of(1, 6, 0.01), "b": of(0, 6, 0.01)})
    assert row_claims(ROW, {(ROW.name, WITH): one, (ROW.name, PLAIN): none})[0].holds


def test_the_lost_count() -> None:
    found = score_unseen({"a": of(1, 2, 0.01), "b": of(2, 2, 0.03)})
    assert found.up == {"a": 1, "b": 2}
    assert found.lasted == 3
    assert found.causes == (("hit the board", 1),)
    assert found.rms_e_rho_m == pytest.approx(sqrt((0.01**2 + 0.03**2) / 2))
    assert found.rms_y_m == pytest.approx(0.1)


@pytest.mark.long
def test_a_slower_servo_is_in_the_aircraft_alone() -> None:
    """Half a second, the aircraft still held: nothing is lost, and it is flown at all."""
    row = ROW._replace(duration_s=0.5, servo_s=0.08, late_s=0.02)
    job = UnseenJob(scenario=SCENARIO, row=row, pilot=WITHOUT, place="b", seed=1)
    assert job.scenario.airframe == scenario_of(job).airframe
    found = fly_unseen(job)
    assert found.up
    assert found.duration_s == pytest.approx(0.5)


@pytest.mark.long
def test_the_row_at_3_percent_is_flown_by_all_three() -> None:
    row = ROWS[0]._replace(duration_s=20.0)
    flown = fly_rows(Context(flyer=Flyer()), [row], seeds=1)
    assert all(score.lasted == 3 for score in flown.values())
    inertial, plain = flown[row.name, WITH], flown[row.name, PLAIN]
    assert inertial.rms_e_rho_m < plain.rms_e_rho_m
