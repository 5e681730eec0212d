"""The campaign: its jobs, its own look at every command, and what it writes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from math import nan

import pytest

from tgl_soar.analysis.campaigns import drawn_faults
from tgl_soar.analysis.campaigns.drawn_faults import (
    DISPERSED_MARKS,
    DRAWN,
    LOST,
    MARKS,
    PAIRS,
    RELEASED,
    SOARING,
    CommandCheck,
    FaultJob,
    FaultJobs,
    Outcome,
    campaign_of,
    count,
    fly_job,
    place,
    wilson,
    with_section,
)
from tgl_soar.autopilot import Output, initial_state, step
from tgl_soar.control.laws import laws_from
from tgl_soar.sim.campaign.executors import InLine, LocalProcesses
from tgl_soar.sim.campaign.run import fly_all
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import parse_fault
from tgl_soar.types import NO_ATTITUDE, NO_FIX, AutopilotStatus, Inputs, SurfaceCommand

SHORT_S = 8.0


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling would take longer than these flights."""
    monkeypatch.setattr(drawn_faults, "available", lambda: False)


def job(*faults: str, seed: int = 1) -> FaultJob:
    return FaultJob(
        row="row", seed=seed, turbulence=0.01, faults=tuple(parse_fault(text) for text in faults)
    )


def test_every_kind_has_its_flights_and_some_have_two_faults() -> None:
    jobs = FaultJobs(400, 0, 1)
    flown = Counter(each.row for each in jobs)
    assert set(flown) == {*DRAWN, PAIRS}
    assert flown[PAIRS] == 100
    assert max(flown[name] for name in DRAWN) - min(flown[name] for name in DRAWN) <= 1
    assert all(len(each.faults) == (2 if each.row == PAIRS else 1) for each in jobs)
    assert len({each.seed for each in jobs}) == 400


def test_jobs_repeat_with_their_seed() -> None:
    assert FaultJobs(40, 2, 5)[:] == list(FaultJobs(40, 2, 5))
    assert FaultJobs(40, 2, 5)[:] != FaultJobs(40, 2, 6)[:]
    assert FaultJobs(40, 2, 5)[3:5] == [FaultJobs(60, 0, 5)[3], FaultJobs(60, 0, 5)[4]]
    assert {each.model for each in FaultJobs(3, 1, 5, "point_mass")} == {"point_mass"}
    with pytest.raises(IndexError):
        FaultJobs(40, 2, 5)[48]


def test_a_short_gap_is_survived_a_pilot_is_obeyed() -> None:
    through = fly_job(job("position.dropout start=4 for=0.3"), SHORT_S)
    assert through.result in (SOARING, drawn_faults.FLYING)
    taken = fly_job(job("pilot.takes start=3 for=5"), SHORT_S)
    assert (taken.result, taken.error, taken.bad_commands) == (RELEASED, "", 0)
    assert taken.reason
    assert taken.ended_s == pytest.approx(3.0, abs=0.1)


def test_a_flight_is_the_same_wherever_it_is_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn_faults, "fly_job", partial(fly_job, duration_s=SHORT_S))
    jobs = [job("position.loss start=2 for=2 fraction=0.5")._replace(seed=s) for s in (1, 2)]
    here = fly_all(drawn_faults.fly_fault_job, jobs, InLine())
    assert here == fly_all(drawn_faults.fly_fault_job, jobs, LocalProcesses(2))
    assert here == [fly_job(each, SHORT_S) for each in jobs]
    assert here[0] != here[1]


def test_a_campaign_says_all_that_its_flights_depend_on() -> None:
    jobs = FaultJobs(20, 2, 7)
    reported = campaign_of(jobs)
    assert (len(reported.jobs), reported.seeds) == (28, (7, 26))
    assert {"flights", "dropouts", "seed", "model", "autopilot"} <= set(reported.parameters)
    assert reported.parameters != campaign_of(replace(jobs, seed=8)).parameters


def test_an_exception_is_an_outcome_and_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_loop: object) -> Output:
        raise ZeroDivisionError("somewhere")

    monkeypatch.setattr(ClosedLoop, "tick", fails)
    outcome = fly_job(job("pilot.takes"), 0.1)
    assert (outcome.result, outcome.error) == (LOST, "ZeroDivisionError('somewhere')")


def sent(command: SurfaceCommand, active: bool = True) -> Output:
    """The output of a tick that sends this."""
    values = place().values
    state = initial_state()
    laws = laws_from(values, place().site.frame())
    inputs = Inputs(
        time_s=0.0,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=0.0, accepts_surfaces=True, armed=True),
        engage=False,
    )
    _, output = step(laws, state, inputs)
    return output._replace(command=command, active=active)


@pytest.mark.parametrize(
    ("commands", "bad"),
    [
        ([(0.0, 0.0, 0.0), (0.1, -0.1, 0.1)], 0),
        ([(0.0, nan, 0.0)], 1),
        ([(1.001, 0.0, 0.0)], 1),
        ([(0.0, 0.0, -1.001)], 1),
        ([(0.0, 0.0, 0.0), (0.0, 0.0, 0.101)], 1),  # 20 travels a second, 200 ticks
        ([(0.0, 0.0, 0.0), (nan, 0.0, 0.0), (0.0, 0.0, 0.0)], 1),
    ],
)
def test_every_command_is_looked_at(commands: list[tuple[float, float, float]], bad: int) -> None:
    check = CommandCheck(place().values, 0.005)
    for command in commands:
        check.look(sent(SurfaceCommand(*command)))
    assert check.bad == bad


def test_a_command_that_is_not_sent_is_none() -> None:
    check = CommandCheck(place().values, 0.005)
    check.look(sent(SurfaceCommand(1.0, 0.0, 0.0)))
    check.look(sent(SurfaceCommand(nan, nan, nan), active=False))
    check.look(sent(SurfaceCommand(-1.0, 0.0, 0.0)))  # engaged again, from anywhere
    assert check.bad == 0


def test_the_interval_is_wilsons() -> None:
    # 95 of 100: the textbook's 0.888 to 0.978.
    assert wilson(95, 100) == pytest.approx((0.8883, 0.9785), abs=1e-3)
    low, high = wilson(50, 50)
    assert high == pytest.approx(1.0)
    assert 0.92 < low < 0.94


def test_survivals_are_counted_by_fault_and_air() -> None:
    jobs = FaultJobs(0, 3, 1)
    outcomes = [
        Outcome(
            row=each.row,
            seed=each.seed,
            faults="",
            result=RELEASED if i == 0 else SOARING,
            reason="",
            ended_s=30.0,
            bad_commands=0,
            error="",
        )
        for i, each in enumerate(jobs)
    ]
    first, *others = count(outcomes).survivals
    assert (first.turbulence, first.survived, first.flights) == (0.03, 2, 3)
    assert [(s.turbulence, s.survived) for s in others] == [(0.03, 3), (0.01, 3), (0.01, 3)]
    assert {s.aboard for s in others} == set(drawn_faults.SENSORS)


def test_the_section_is_written_between_its_marks_and_counts_right() -> None:
    outcomes = [
        Outcome(
            row="link.loss",
            seed=1,
            faults="",
            result=SOARING,
            reason="",
            ended_s=30.0,
            bad_commands=0,
            error="",
        ),
        Outcome(
            row="link.loss",
            seed=2,
            faults="",
            result=RELEASED,
            reason="position lost",
            ended_s=12.0,
            bad_commands=0,
            error="",
        ),
        Outcome(
            row=PAIRS,
            seed=3,
            faults="",
            result=LOST,
            reason="hit the board",
            ended_s=9.0,
            bad_commands=2,
            error="",
        ),
    ]
    written = drawn_faults.section(count(outcomes), "the command")
    assert "2 commands not finite" in written
    assert "| `link.loss` | 2 | 1 | · | 1 | · | position lost (1) |" in written
    assert "| two at once | 1 | · | · | · | 1 | hit the board (1) |" in written
    assert count(outcomes).troubles == outcomes[2:]
    assert "| **all** | **3** | 1 | 0 | 1 | 1 | |" in written
    page = "before\n{}\nold\n{}\nbetween\n{}\nof others\n{}\nafter\n".format(
        *MARKS, *DISPERSED_MARKS
    )
    new = with_section(page, written)
    assert "old" not in new
    assert "of others" in new
    assert new.startswith("before\n")
    assert new.endswith("after\n")
    assert with_section(new, written) == new
    dispersed = with_section(page, written, dispersed=True)
    assert "old" in dispersed
    assert "of others" not in dispersed
    with pytest.raises(ValueError, match="no marks"):
        with_section("nothing", written)


@pytest.mark.parametrize("name", DRAWN)
def test_no_fault_of_the_catalogue_ends_in_an_exception(name: str) -> None:
    assert fly_job(job(f"{name} start=1"), 2.5).error == ""


@pytest.mark.parametrize("of", ["link", "position", "attitude", "all"])
def test_what_comes_twice_is_no_second_autopilot(of: str) -> None:
    """The same frames again do no harm; those of another autopilot stand metres away."""
    assert fly_job(job(f"{of}.duplicate start=1 for=6"), SHORT_S).result == SOARING
