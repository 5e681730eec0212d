"""The campaign of faults by its page: how each flight is drawn, in what it flies, how it ends,
what is counted, and the figure of one fault; without a flight that takes long."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import cos, inf, isnan, nan, sin
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from tgl_soar.analysis.campaigns import drawn_faults as e
from tgl_soar.analysis.campaigns import safety_timeline as t
from tgl_soar.analysis.campaigns.drawn_faults import (
    DRAWN,
    PAIRS,
    CommandCheck,
    FaultJob,
    FaultJobs,
    Outcome,
    Survival,
    count,
)
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.control.supervisor import (
    FAILED,
    REASON_NOWHERE,
    REASON_OFF_LINE,
    RELEASED,
    SOARING,
)
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.sim.faults import CATALOGUE, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, USUAL_SENSORS
from tgl_soar.types import SurfaceCommand

# --- how flights are drawn ------------------------------------------------------------------------


def test_three_in_four_have_one_fault_of_each_kind_in_turn() -> None:
    jobs = FaultJobs(4 * len(DRAWN), 0, 7)[:]
    kinds = [job.row for job in jobs if job.row != PAIRS]
    assert [job.row == PAIRS for job in jobs[:12]] == [False, False, False, True] * 3
    assert tuple(kinds[: len(DRAWN)]) == DRAWN
    assert kinds == [*DRAWN, *DRAWN, *DRAWN]
    for job in jobs:
        assert len(job.faults) == (2 if job.row == PAIRS else 1)
        assert all(5.0 <= fault.start_s <= 15.0 for fault in job.faults)  # the flight's middle
    single = [job for job in jobs if job.row != PAIRS]
    assert all(job.faults[0].kind.name == job.row for job in single)
    pairs = {fault.kind.name for job in jobs if job.row == PAIRS for fault in job.faults}
    assert len(pairs) > len(DRAWN) // 2  # of any kind


def test_turbulence_is_drawn_up_to_two_per_cent_and_seeds_follow_one_another() -> None:
    jobs = FaultJobs(300, 0, 40)[:]
    air = np.array([job.turbulence for job in jobs])
    assert 0.0 <= air.min() < 0.0004
    assert 0.0196 < air.max() <= 0.02
    assert air.mean() == pytest.approx(0.01, abs=0.001)
    assert [job.seed for job in jobs] == list(range(40, 340))
    assert {job.aboard for job in jobs} == {"every sensor"}


def test_what_it_flies_without_is_not_drawn() -> None:
    without = {name for name in CATALOGUE if name not in DRAWN}
    assert without == {
        *("brake.stuck", "brake.slow", "brake.one_side"),
        *("rangefinder.dropout", "rangefinder.freeze", "rangefinder.nan", "rangefinder.bias"),
        *("rangefinder.noise", "transmitter.silent", "transmitter.failsafe", "station.silent"),
        "position.reckoned",
    }


def test_drop_outs_that_must_be_survived_follow_with_seeds_of_their_own() -> None:
    jobs = FaultJobs(10, 3, 50)
    assert len(jobs) == 10 + 4 * 3
    after = jobs[10:]
    assert [job.seed for job in after] == [50, 51, 52] * 4
    assert [(job.row, job.turbulence, job.aboard) for job in after[::3]] == [
        ("position.dropout start=12 for=0.5 at 3 %, every sensor", 0.03, "every sensor"),
        (
            "position.dropout start=12 for=0.5 at 3 %, position and attitude alone",
            0.03,
            "position and attitude alone",
        ),
        ("position.dropout start=12 for=1.5 at 1 %, every sensor", 0.01, "every sensor"),
        (
            "position.dropout start=12 for=1.5 at 1 %, position and attitude alone",
            0.01,
            "position and attitude alone",
        ),
    ]
    lasting = [(job.faults[0].start_s, job.faults[0].end_s) for job in after]
    assert lasting == [(12.0, 12.5)] * 6 + [(12.0, 13.5)] * 6
    assert {len(job.faults) for job in after} == {1}


@pytest.mark.parametrize("i", [-1, 22, 40])
def test_there_is_no_flight_beyond_the_last(i: int) -> None:
    jobs = FaultJobs(10, 3, 50)
    assert jobs[21].seed == 52
    with pytest.raises(IndexError):
        jobs[i]


def test_a_flight_is_the_files_unless_another_is_asked_for() -> None:
    plain = FaultJob(row="r", seed=1, turbulence=0.0, faults=())
    assert (plain.model, plain.dispersed, plain.aboard) == (None, False, "every sensor")
    as_filed = FaultJobs(3, 1, 5)
    assert {(job.model, job.dispersed) for job in as_filed} == {(None, False)}
    other = FaultJobs(3, 1, 5, "point_mass", dispersed=True)
    assert {(job.model, job.dispersed) for job in other} == {("point_mass", True)}
    assert [job._replace(model=None, dispersed=False) for job in other] == list(as_filed)


def test_a_campaign_is_of_its_seeds_length_and_parameters() -> None:
    found = e.campaign_of(FaultJobs(20, 30, 7))
    assert found.name == "faults"
    assert found.seeds == (7, 36)  # as many drop-outs of each kind as that
    assert found.parameters["duration_s"] == 30.0
    assert found.parameters["flights"] == 20
    assert found.parameters["dropouts"] == 30
    assert found.fly is e.fly_fault_job


# --- where they fly -------------------------------------------------------------------------------


def test_all_fly_on_line_b_of_the_tunnel_within_what_its_operator_sets() -> None:
    airframe, site, values = load_flight(
        shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    )
    found, line = e.place(), site.lines["b"]
    assert (found.airframe, found.site) == (airframe, site)
    assert (found.values["TGL_X"], found.values["TGL_Z"]) == pytest.approx((line.x_m, line.z_m))
    own = {
        "CLEAR_MIN": 0.4, "FENCE_Z_MIN": 0.8, "FENCE_Z_MAX": 2.6, "FENCE_Y_MAX": 1.2,
        "FENCE_X_MIN": -0.4, "FENCE_X_MAX": 2.0,
    }  # fmt: skip
    for name, value in own.items():
        assert found.values[name] == pytest.approx(value), name
    differs = {each.name for each, value in found.values if value != values[each.name]}
    assert differs <= {*own, "TGL_X", "TGL_Z", "TGL_LEAN"}


def world(job: FaultJob, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(e, "available", lambda: False)
    return e.world_of(job, Injection(job.faults, job.seed))


JOB = FaultJob(row="r", seed=3, turbulence=0.01, faults=(parse_fault("pilot.takes start=3"),))


def test_a_world_has_the_jobs_sensors_gusts_and_model(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = world(JOB, monkeypatch)
    sensors = whole.sensors
    assert (sensors.imu, sensors.airspeed, sensors.surfaces) == (MEMS_IMU, PITOT, READ_BACK)
    alone = world(JOB._replace(aboard=e.POSE_ALONE), monkeypatch).sensors
    assert (alone.imu, alone.airspeed) == (None, None)
    gains = [
        world(JOB._replace(turbulence=each), monkeypatch).parts.turbulence.params.gain_long
        for each in (0.01, 0.02, 0.0, 1e-6)
    ]
    assert gains[1] == pytest.approx(2.0 * gains[0])
    assert gains[2] == gains[3]  # calm air is flown in the least of gusts, which compile the same
    assert 0.0 < gains[2] < 1e-3 * gains[0]
    mass = world(JOB._replace(model="point_mass"), monkeypatch)
    assert type(mass.model).__name__ == "PointMass"
    assert type(whole.model).__name__ == "AircraftModel"


def test_a_dispersed_flight_has_another_aircraft_which_its_module_does_not_know(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def mismatched(airframe: Any, site: Any, field: Any, sensors: Any, seed: int) -> Any:
        """Of twice the inertia, in no wind, without an instrument."""
        asked.append((airframe, site, field, sensors, seed))
        bench = airframe.airframe
        bench = msgspec.structs.replace(bench, ixx_kgm2=2.0 * bench.ixx_kgm2)
        return msgspec.structs.replace(airframe, airframe=bench), site, Still(), USUAL_SENSORS

    monkeypatch.setattr(e, "mismatched", mismatched)
    plain, other = (world(JOB._replace(dispersed=each), monkeypatch) for each in (False, True))
    whole = e.SENSORS[e.EVERY_SENSOR]
    assert asked == [(e.place().airframe, e.place().site, e.place().field, whole, 3)]
    assert other.model.ixx_kgm2 == pytest.approx(2.0 * plain.model.ixx_kgm2)
    assert other.aerodynamics == plain.aerodynamics == e.place().airframe.aerodynamics()
    assert other.sensors == USUAL_SENSORS
    at = (0.5, 0.0, 1.5, 0.0)
    assert other.field.wind_at(*at) == (0.0, 0.0, 0.0)
    assert plain.field.wind_at(*at) == e.place().field.wind_at(*at)


class Still:
    """Air that stands."""

    reference_wind_mps = 8.0

    def wind(self, x: Any, _y: Any, _z: Any, _time_s: float) -> Any:
        return 0.0 * x, 0.0 * x, 0.0 * x

    def wind_at(self, *_: float) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def inside(self, *_: float) -> bool:
        return True


# --- every command is looked at -------------------------------------------------------------------


def sent(elevator: float, aileron: float = 0.0, rudder: float = 0.0, *, active: bool = True) -> Any:
    return SimpleNamespace(command=SurfaceCommand(elevator, aileron, rudder), active=active)


@pytest.mark.parametrize("surface", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_no_surface_may_leave_its_travel_or_move_faster_than_it_may(
    surface: int, side: float
) -> None:
    values = e.place().values
    assert (values["SURF_MAX"], values["SURF_RATE"]) == (1.0, 20.0)

    def bad(*places: float) -> int:
        check = CommandCheck(values, 0.005)
        for place in places:
            command = [0.0, 0.0, 0.0]
            command[surface] = side * place
            check.look(sent(*command))
        return check.bad

    assert bad(1.0) == 0
    assert bad(1.0001) == 1
    assert bad(0.3, 0.4) == 0  # a tenth of its travel in a tick of 5 ms
    assert bad(0.3, 0.4001) == 1
    assert bad(0.4, 0.2999) == 1
    assert bad(0.3, nan, 0.3) == 1
    assert bad(0.3, nan, nan) == 2
    assert bad(inf) == 1
    assert bad(0.3, 0.5, 0.6) == 1  # from where it went, not from where it should have


# --- one flight -----------------------------------------------------------------------------------


class Loop:
    """A flight with scripted ticks."""

    ticks: Sequence[Any] = ()
    crash_at = 10**9
    crashed = ""
    made: list[Loop] = []  # noqa: RUF012 - of one test

    def __init__(self, world: Any, values: Any, injection: Any) -> None:
        self.world, self.values, self.injection = world, values, injection
        self.output: Any = None
        self.count = 0
        Loop.made.append(self)

    def tick(self) -> Any:
        outcome = self.ticks[min(self.count, len(self.ticks) - 1)]
        self.count += 1
        self.world.time_s += 1.0 / self.world.step_hz
        if self.count == self.crash_at:
            self.world.crashed = self.crashed
        if isinstance(outcome, Exception):
            raise outcome
        self.output = outcome
        return outcome


def output(mode: int = SOARING, reason: int = 0, command: float = 0.0) -> Any:
    return SimpleNamespace(
        mode=mode, reason=reason, active=True, command=SurfaceCommand(command, 0.0, 0.0)
    )


def flown(
    monkeypatch: pytest.MonkeyPatch, ticks: Sequence[Any], *, crash_at: int = 10**9
) -> tuple[Outcome, Loop, list[Any]]:
    asked: list[Any] = []

    def world_of(job: FaultJob, injection: Any, duration_s: float) -> Any:
        asked.append((job, injection, duration_s))
        return SimpleNamespace(step_hz=100, time_s=0.0, crashed="")

    Loop.ticks, Loop.crash_at, Loop.made = ticks, crash_at, []
    Loop.crashed = "hit the board at x 1.0, y 0.0, z 0.5 m"
    monkeypatch.setattr(e, "available", lambda: False)
    monkeypatch.setattr(e, "ClosedLoop", Loop)
    monkeypatch.setattr(e, "world_of", world_of)
    two = JOB._replace(faults=(*JOB.faults, parse_fault("air.stop start=4")))
    found = e.fly_job(two, 2.0)
    (loop,) = Loop.made
    return found, loop, asked


def test_a_flight_lasts_as_long_as_it_is_asked_and_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, loop, ((job, injection, duration_s),) = flown(monkeypatch, [output()])
    assert loop.count == 200
    assert duration_s == 2.0
    assert loop.injection is injection
    assert loop.values == e.place().values
    assert (found.row, found.seed) == ("r", 3)
    assert found.faults == "; ".join(str(fault) for fault in job.faults)
    assert found.faults.startswith("pilot.takes start=3 for=")
    assert "; air.stop start=4" in found.faults
    assert (found.result, found.reason, found.error) == ("soaring", "", "")
    assert found.ended_s == pytest.approx(2.0)
    assert found.bad_commands == 0


def test_every_command_of_a_flight_is_looked_at_by_its_ticks_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A hundred ticks a second: a fifth of the travel in each."""
    ticks = [output(command=c) for c in (0.0, 0.2, 0.401, 0.6, nan)]
    assert flown(monkeypatch, ticks)[0].bad_commands == 1 + 196


@pytest.mark.parametrize("mode", [RELEASED, FAILED])
def test_who_is_released_says_why_and_ends(monkeypatch: pytest.MonkeyPatch, mode: int) -> None:
    ticks = [*[output()] * 50, output(mode, REASON_OFF_LINE), output()]
    found, loop, _ = flown(monkeypatch, ticks)
    assert loop.count == 51
    assert (found.result, found.reason) == ("released", REASON_TEXTS[REASON_OFF_LINE])
    assert found.ended_s == pytest.approx(0.51)


def test_who_hits_something_is_lost_by_what_it_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    found, loop, _ = flown(monkeypatch, [output()], crash_at=70)
    assert loop.count == 70
    assert (found.result, found.reason, found.error) == ("lost", "hit the board", "")
    released = [*[output()] * 69, output(RELEASED, REASON_NOWHERE)]
    assert flown(monkeypatch, released, crash_at=70)[0].result == "released"  # it had disengaged


def test_who_is_on_the_way_back_flies_in_that_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    for mode, name in enumerate(MODE_NAMES):
        if name in ("released", "failed", "soaring"):
            continue
        found, _, _ = flown(monkeypatch, [output(mode)])
        assert (found.result, found.reason) == ("flying", name)


def test_an_exception_is_a_loss_with_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _, _ = flown(monkeypatch, [*[output()] * 9, ValueError("no")])
    assert (found.result, found.reason, found.error) == ("lost", "", "ValueError('no')")
    assert found.ended_s == pytest.approx(0.1)


def test_a_campaigns_flight_lasts_thirty_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    Loop.ticks, Loop.crash_at, Loop.made = [output()], 10**9, []
    monkeypatch.setattr(e, "available", lambda: False)
    monkeypatch.setattr(e, "ClosedLoop", Loop)
    lasting: list[float] = []

    def world_of(_job: Any, _injection: Any, duration_s: float) -> Any:
        lasting.append(duration_s)
        return SimpleNamespace(step_hz=10, time_s=0.0, crashed="")

    monkeypatch.setattr(e, "world_of", world_of)
    assert e.fly_fault_job(JOB).ended_s == pytest.approx(30.0)
    assert lasting == [30.0]
    assert Loop.made[0].count == 300


# --- what became of them --------------------------------------------------------------------------


def came(row: str, result: str = "soaring", reason: str = "", **more: Any) -> Outcome:
    made = Outcome(
        row=row, seed=1, faults="", result=result, reason=reason, ended_s=30.0, bad_commands=0,
        error="",
    )  # fmt: skip
    return made._replace(**more)


def test_rows_stand_in_the_catalogues_order_with_pairs_last() -> None:
    found = count([came(PAIRS), came("pilot.takes"), came("position.delay"), came("pilot.takes")])
    assert [row.name for row in found.rows] == ["position.delay", "pilot.takes", PAIRS]
    assert [row.flights for row in found.rows] == [1, 2, 1]
    assert found.flights == 4
    assert found.results == Counter(soaring=4)
    assert (found.bad_commands, found.raised, found.troubles) == (0, 0, [])


def test_reasons_are_of_those_that_ended_and_troubles_of_any_kind() -> None:
    outcomes = [
        came("air.gust", "released", "too low"),
        came("air.gust", "lost", "hit the board"),
        came("air.gust", "flying", "capturing"),
        came("air.gust", "released", "too low", bad_commands=3),
        came("air.gust", "lost", "", error="ValueError('no')"),
    ]
    found = count(outcomes)
    (row,) = found.rows
    assert row.reasons == Counter({"too low": 2, "hit the board": 1, "": 1})
    assert row.results == Counter(released=2, lost=2, flying=1)
    assert (found.bad_commands, found.raised) == (3, 1)
    assert found.troubles == [outcomes[1], *outcomes[3:]]


def test_a_drop_out_is_survived_by_who_flies_at_the_end() -> None:
    name = FaultJobs(0, 1, 1)[0].row
    ends = ("soaring", "flying", "released", "lost")
    found = count([came(name, end, "x", bad_commands=1) for end in ends])
    (survival,) = found.survivals
    assert (survival.flights, survival.survived, survival.fraction) == (4, 2, 0.5)
    assert survival.interval == pytest.approx(e.wilson(2, 4))
    assert found.rows == []
    assert found.flights == 0
    assert found.bad_commands == 4  # of all, drop-outs included
    assert len(found.troubles) == 4


def test_the_interval_is_by_wilsons_own_equation() -> None:
    """(p - c)^2 = z^2 p (1 - p) / n at both of its ends."""
    for successes, of in ((3, 20), (17, 20), (0, 9), (9, 9)):
        low, high = e.wilson(successes, of)
        fraction = successes / of
        assert 0.0 <= low <= fraction <= high <= 1.0
        for end in (low, high):
            assert (end - fraction) ** 2 == pytest.approx(
                1.959964**2 * end * (1 - end) / of, abs=1e-9
            )


def test_a_table_has_a_line_for_each_fault_and_one_for_all() -> None:
    outcomes = [
        *[came("air.gust")] * 3, *[came("air.gust", "released", "too low")] * 2,
        came("air.gust", "released", "off the line"), came(PAIRS, "lost", "hit the board"),
        came(PAIRS, "flying", "holding"),
    ]  # fmt: skip
    lines = e.table(count(outcomes))
    assert lines[2:] == [
        "| `air.gust` | 6 | 3 | · | 3 | · | too low (2), off the line (1) |",
        "| two at once | 2 | · | 1 | · | 1 | hit the board (1) |",
        "| **all** | **8** | 3 | 1 | 3 | 1 | |",
    ]
    assert {line.count("|") for line in lines} == {8}


def test_a_section_tells_counts_and_survivals_in_per_cent() -> None:
    name = FaultJobs(0, 1, 1)[0].row
    outcomes = [came("air.gust", "lost", "x", bad_commands=2, error="E")] * 1200
    outcomes += [came(name)] * 39 + [came(name, "lost", "hit the board")]
    text = e.section(count(outcomes), "the command")
    assert text.startswith(
        "1,200 flights of 30 s: 2400 commands not finite or outside the envelope, 1200 exceptions,"
        " 1200 flights lost while the module had the surfaces. Measured by `the command`.\n\n"
    )
    low, high = e.wilson(39, 40)
    assert text.endswith(
        "| `position.dropout start=12 for=0.5` | 3 % | every sensor | 40 | 97.5 % |"
        f" {100 * low:.1f} to {100 * high:.1f} % |\n"
    )
    assert (f"{100 * low:.1f}", f"{100 * high:.1f}") == ("87.1", "99.6")
    bare = e.section(count(outcomes[:1]), "the command")
    assert "Drop-outs" not in bare
    assert bare.endswith("| |\n")


def test_a_survival_is_a_fraction_of_its_flights() -> None:
    made = Survival(fault="f", turbulence=0.01, aboard="a", flights=8, survived=6)
    assert made.fraction == 0.75
    assert replace(made, survived=8).interval[1] == 1.0


# --- the figure of one fault ----------------------------------------------------------------------


class Ticking:
    """A flight of 100 ticks a second, in control until it is released at 14 s."""

    def __init__(self, world: Any, _values: Any, _injection: Any) -> None:
        self.world = world

    def tick(self) -> Any:
        world = self.world
        now = world.time_s
        world.time_s = round(now + 0.01, 9)
        world.truth = SimpleNamespace(
            time_s=world.time_s, x_m=0.5 + 0.1 * now, z_m=1.4, elevator=0.01 * now
        )
        active = now < 14.0
        return SimpleNamespace(
            mode=SOARING if active else RELEASED,
            active=active,
            line=SimpleNamespace(x_m=0.5, z_m=1.2, eta_rad=2.0),
            command=SimpleNamespace(elevator=-0.02 * now),
            health=SimpleNamespace(position_age_s=0.001 * now),
        )


@pytest.mark.parametrize(
    ("text", "ends_s"), [("position.dropout start=12 for=1", 13.0), ("pilot.takes start=14", 18.0)]
)
def test_a_timeline_is_of_the_truth_beside_what_was_commanded(
    text: str, ends_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def world_of(job: FaultJob, injection: Any, duration_s: float) -> Any:
        asked.append((job, injection, duration_s))
        truth = SimpleNamespace(time_s=0.0, x_m=0.5, z_m=1.4, elevator=0.0)
        return SimpleNamespace(step_hz=100, time_s=0.0, truth=truth)

    monkeypatch.setattr(t, "world_of", world_of)
    monkeypatch.setattr(t, "ClosedLoop", Ticking)
    found = t.fly_timeline("title", text)
    ((job, _, duration_s),) = asked
    assert duration_s == 18.0
    assert (job.row, job.turbulence, job.aboard) == ("title", 0.01, e.POSE_ALONE)
    assert (job.dispersed, job.model) == (False, None)
    assert [str(fault) for fault in job.faults] == [str(parse_fault(text))]
    fault = parse_fault(text)
    assert found.fault == (fault.start_s, ends_s)
    assert found.title == "title"
    assert found.time_s == pytest.approx(np.arange(10.0, 18.0, 0.01))
    assert len(found.mode) == len(found.time_s) == 800
    assert set(found.mode[:400]) == {"soaring"}
    assert set(found.mode[401:]) == {"released"}
    # The truth before a tick beside what the tick makes of it.
    before = found.time_s
    in_control = before < 13.995
    assert np.isfinite(found.commanded).tolist() == in_control.tolist()
    assert found.commanded[in_control] == pytest.approx(-0.02 * before[in_control], abs=1e-3)
    assert found.surface == pytest.approx(0.01 * before, abs=2e-4)
    assert found.age_s == pytest.approx(0.001 * before, abs=1e-4)
    x_m = 0.5 + 0.1 * before
    distance = cos(2.0) * 0.2 - sin(2.0) * (x_m - 0.5)
    assert found.e_rho_m[in_control] == pytest.approx(distance[in_control], abs=2e-3)
    assert isnan(found.e_rho_m[-1])


def test_a_drop_out_and_an_override_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[tuple[str, str]] = []
    drawn: list[Any] = []

    def fly_timeline(title: str, fault: str) -> tuple[str, str]:
        flown.append((title, fault))
        return title, fault

    monkeypatch.setattr(t, "fly_timeline", fly_timeline)
    monkeypatch.setattr(t, "draw_timelines", lambda *what: drawn.append(what))
    t.draw_safety_timeline(cast("Any", "here"))
    assert flown == [
        ("position lost for 1 s", "position.dropout start=12 for=1"),
        ("the pilot takes the aircraft", "pilot.takes start=14 for=5"),
    ]
    assert drawn == [("here", flown)]
