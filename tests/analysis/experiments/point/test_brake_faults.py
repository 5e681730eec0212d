"""Flights with jammed brakes: how they are drawn, what is reported, and some of them flown."""

from __future__ import annotations

from math import nan

import pytest

from tgl_soar.analysis.experiments.point.brake_faults import (
    KINDS,
    ROLL,
    START_S,
    TURBULENCE,
    FaultyFlight,
    faults_claim,
    faults_table,
    faulty_jobs,
    fly_faulty,
)
from tgl_soar.analysis.experiments.point.hold_point import band, with_point
from tgl_soar.analysis.experiments.scenario import Scenario, load_scenario, prepare
from tgl_soar.config.files import shipped
from tgl_soar.control.point_hold import HOLDS, UNEVEN
from tgl_soar.sim.faults import parse_faults


def held(name: str) -> Scenario:
    base = load_scenario(shipped(f"scenarios/{name}.toml"))
    return with_point(base, band(prepare(base))[1])


def places() -> list[Scenario]:
    return [held("point"), held("point_hill")]


def test_flights_are_drawn_by_number_and_seed_alone_and_spread_over_all_kinds() -> None:
    jobs = faulty_jobs(places(), 16, 90)
    assert jobs[:8] == faulty_jobs(places(), 8, 90)
    assert jobs[0] != faulty_jobs(places(), 1, 91)[0]
    assert [job.seed for job in jobs] == list(range(90, 106))
    drawn = [(job, parse_faults(job.scenario.faults)[0]) for job in jobs]
    assert {fault.kind.name for _, fault in drawn} == set(KINDS)
    for kind in KINDS:
        for site in ("tunnel", "hill"):
            own = [
                fault.start_s
                for job, fault in drawn
                if fault.kind.name == kind and site in str(job.scenario.site)
            ]
            assert len(own) == 4
            assert sum(start < START_S[0][1] for start in own) == 2
    for job, fault in drawn:
        assert job.scenario.turbulence is not None
        assert TURBULENCE[0] <= job.scenario.turbulence.intensity <= TURBULENCE[1]
        assert fault.end_s > job.scenario.duration_s  # it never mends
        if fault.way == "one_side":
            assert abs(fault["roll"]) <= ROLL


def flight(kind: str, lost: str = "", reported_s: float = nan, over: str = "") -> FaultyFlight:
    return FaultyFlight(
        place="tunnel",
        kind=kind,
        seed=1,
        turbulence=0.02,
        fault=kind,
        lost=lost,
        handed_over=over,
        reported_s=reported_s,
        standing=UNEVEN if reported_s == reported_s else HOLDS,
        duration_s=90.0,
    )


def test_one_lost_flight_is_one_too_many_and_is_named() -> None:
    good = [flight(KINDS[0]), flight(KINDS[1], reported_s=20.0), flight(KINDS[1], reported_s=30.0)]
    assert faults_claim(good).holds
    assert faults_claim([*good, flight(KINDS[0], over="off the line")]).holds
    bad = faults_claim([*good, flight(KINDS[0], lost="hit the board")])
    assert not bad.holds
    assert "1 of 4 lost" in bad.measured
    assert "hit the board" in bad.measured
    rows = faults_table([*good, flight(KINDS[0], lost="hit the board")]).rows
    assert rows == (
        ("brake.stuck, tunnel", "2", "1", "0", "1", "0", "–"),
        ("brake.one_side, tunnel", "2", "2", "0", "0", "2", "25"),
    )


@pytest.mark.long
def test_jammed_brakes_lose_no_flight() -> None:
    flights = [fly_faulty(job) for job in faulty_jobs(places(), 8, 61)]
    assert faults_claim(flights).holds, faults_claim(flights).measured
    # A half that pulls by 0.1 or more of the aileron is reported within 40 s of the 60 left.
    strong = [
        f
        for f in flights
        if f.kind == "brake.one_side" and abs(float(f.fault.split("roll=")[1])) > 0.1
    ]
    assert strong
    assert all(f.standing == UNEVEN for f in strong)
