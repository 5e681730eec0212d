"""What `margins` computes and says: its conditions, each claim at its very bound, and the cells of
its tables, of margins that are written by hand."""

from __future__ import annotations

from functools import cache
from math import exp, log, radians, sqrt
from types import SimpleNamespace
from typing import Any

import pytest
from by_hand import ScriptedFlyer, signs
from msgspec.structs import asdict
from test_margin_tables import FAR, NONE, bears, found, has

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.loop import margin_tables
from tgl_soar.analysis.experiments.loop.lateral_rule import RuleFound, RuleJob
from tgl_soar.analysis.experiments.loop.margin_tables import (
    FOUND,
    REFUSED_LEANS_DEG,
    DrawnFound,
    DrawnJob,
    RefusedFound,
    TableFound,
    TableJob,
    _condition,
    _shipped,
    drawn_claims,
    drawn_margins,
    margins,
    refused,
    refused_table,
    shipped_claims,
    table_margins,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.control import loop_margin
from tgl_soar.control.found_gains import INERTIAL, PLAIN
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS

SPEEDS = (7.7, 8.5, 10.0, 12.0, 14.0)
LEANS = (5.0, 15.0, 30.0, 45.0)
DELAYS = (0.0075, 0.0245, 0.040)
LATE = (0.005, 0.020, 0.050, 0.100, 0.150, 0.200)


def job(speed: float, lean: float, delay_s: float, inertial: bool, **more: Any) -> TableJob:
    return TableJob(speed_mps=speed, lean_deg=lean, delay_s=delay_s, inertial=inertial, **more)


# --- what is computed ---------------------------------------------------------------------------


def test_a_condition_is_that_of_its_job() -> None:
    airframe, _ = _shipped()
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    at = _condition(model, airframe, job(9.5, 30.0, 0.02, True))
    assert (at.speed_mps, at.lean_rad, at.command_delay_s) == (9.5, radians(30.0), 0.02)
    assert at.sensors.imu == MEMS_IMU
    assert at.sensors.attitude == USUAL_SENSORS.attitude
    assert at.model == model
    late = _condition(model, airframe, job(9.5, 30.0, 0.02, True, late_s=0.1)).sensors
    assert late.attitude == USUAL_SENSORS.attitude._replace(delay_s=0.1)
    assert late.imu == MEMS_IMU._replace(delay_s=0.1)
    plain = _condition(model, airframe, job(9.5, 30.0, 0.02, False, late_s=0.0)).sensors
    assert plain.imu is None
    assert plain.attitude.delay_s == 0.0


def test_a_later_link_leaves_less_and_old_attitudes_nothing_to_say_sideways() -> None:
    early, late = (table_margins(FOUND._replace(delay_s=delay_s)) for delay_s in (0.0075, 0.040))
    assert 0.5 < late.elevator.alpha < early.elevator.alpha
    assert 0.5 < late.aileron < early.aileron
    assert early.rudder > 0.5
    assert early.alpha == min(early.elevator.alpha, early.line.alpha)
    assert early.elevator != early.line
    aged = table_margins(FOUND._replace(late_s=0.005))
    assert (aged.aileron, aged.rudder) == (0.0, 0.0)
    assert aged.elevator.alpha == pytest.approx(early.elevator.alpha, rel=0.2)


def test_an_aircraft_is_refused_by_the_least_of_six_loops_at_each_lean(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two sensors at three speeds; the floor itself is no refusal.  With gains that are carried the
    path of the lag is none."""
    _, base = _shipped()
    asked: list[tuple[float, float, bool, bool]] = []

    def flown(laws: Any, values: Any, speed: float, lean_deg: float, inertial: bool) -> float:
        firm = laws.schedule.path_s == 0.0
        asked.append((lean_deg, round(speed / values["DYN_BEST"], 3), inertial, firm))
        weak = lean_deg in ((10.0, 20.0, 45.0) if firm else (20.0,))
        low = 0.499 if weak and inertial and speed > 1.1 * values["DYN_BEST"] else 0.5
        return low if lean_deg != 30.0 else 0.9

    monkeypatch.setattr(margin_tables, "values_of", lambda base, *_, **__: base)
    monkeypatch.setattr(margin_tables, "drawn_aircraft", lambda *_: None)
    monkeypatch.setattr(loop_margin, "flown", flown)
    monkeypatch.setattr(loop_margin, "disk_margin", lambda alpha: alpha)
    answer = refused(3)
    assert tuple(5.0 * k for k in range(1, 10)) == REFUSED_LEANS_DEG
    assert answer.before == tuple(lean in (10.0, 20.0, 45.0) for lean in REFUSED_LEANS_DEG)
    assert answer.now == tuple(lean == 20.0 for lean in REFUSED_LEANS_DEG)
    assert set(asked) == {
        (lean, speed, inertial, firm)
        for lean in REFUSED_LEANS_DEG
        for speed in (0.92, 1.0, 1.15)
        for inertial in (False, True)
        for firm in (False, True)
    }
    assert base["DYN_BEST"] > 0.0


def test_a_drawn_aircraft_is_judged_at_three_places_near_and_three_far(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Near: 0.92 to 1.15 of the best glide's speed and 10 to 30 degrees; far: 0.85 to 1.5 and 5 to
    45, never slower than it can fly; what no file knows at the near ones.  e_rho at 15 degrees and
    the best glide's speed, with the gains sought for it and with those of the shipped aircraft."""
    asked: list[tuple[Any, float, float, bool]] = []
    gusts: list[tuple[float, float, float, float]] = []

    def alpha(drawn: Any, model: Any, values: Any, speed: float, lean: float, each: Any) -> float:
        best = values["DYN_BEST"]
        is_true = model is drawn.true
        asked.append((is_true, speed / best, lean, each.kind == INERTIAL))
        return len(asked) / 100.0

    def activity(_: Any, at: Any, gust: Any) -> Any:
        gusts.append((at.speed_mps, at.lean_rad, *gust[:2]))
        return SimpleNamespace(e_rho_m=0.01 * len(gusts))

    _, base = _shipped()
    monkeypatch.setattr(margin_tables, "values_of", lambda base, *_, **__: base)
    monkeypatch.setattr(margin_tables, "_drawn_alpha", alpha)
    monkeypatch.setattr(margin_tables, "activity", activity)
    answers = [drawn_margins(DrawnJob(INERTIAL, number)) for number in range(12)]
    assert answers[0].near == pytest.approx(0.01)
    assert answers[0].far == pytest.approx(0.04)
    assert answers[0].with_errors == pytest.approx(0.07)
    assert (answers[0].e_rho_m, answers[0].carried_m) == pytest.approx((0.01, 0.02))
    by_place = [asked[9 * k : 9 * k + 9] for k in range(12)]
    near = [one for nine in by_place for one in nine[:3]]
    far = [one for nine in by_place for one in nine[3:6]]
    true = [one for nine in by_place for one in nine[6:]]
    for several, slow, fast, low, high in (
        (near, 0.92, 1.15, 10.0, 30.0), (far, 0.85, 1.5, 5.0, 45.0),
    ):  # fmt: skip
        speeds, leans = [one[1] for one in several], [one[2] for one in several]
        assert max(speeds) <= fast
        assert max(speeds) > fast - 0.1 * (fast - slow) - 0.02
        assert min(speeds) >= slow - 1e-6
        assert low <= min(leans) < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < max(leans) <= high
    assert not any(one[0] for one in (*near, *far))
    assert all(one[0] for one in true)
    assert [one[2] for one in true] == [one[2] for one in near]
    assert all(one[3] for one in asked)
    assert len(gusts) == 24
    assert {round(lean, 9) for _, lean, *_ in gusts} == {round(radians(15.0), 9)}
    assert {intensity for *_, intensity, _ in gusts} == {0.03}
    assert {round(speed, 6) for speed, *_ in gusts} == {round(base["DYN_BEST"], 6)}
    assert {round(mps, 6) for *_, mps in gusts} == {round(base["DYN_BEST"], 6)}


def test_a_drawn_aircraft_is_not_asked_of_speeds_at_which_it_cannot_fly(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A thousandth above the slowest glide at the least, for pitch and for e_rho."""
    _, base = _shipped()
    slowest = 1.2 * base["DYN_BEST"]
    speeds: list[float] = []

    def alpha(_: Any, __: Any, ___: Any, speed: float, *____: Any) -> float:
        speeds.append(speed)
        return 0.5

    def activity(_: Any, at: Any, __: Any) -> Any:
        speeds.append(at.speed_mps)
        return SimpleNamespace(e_rho_m=0.01)

    glide = SimpleNamespace(horizontal_mps=slowest)
    monkeypatch.setattr(margin_tables, "highest_pitch_glide", lambda _: glide)
    monkeypatch.setattr(margin_tables, "values_of", lambda base, *_, **__: base)
    monkeypatch.setattr(margin_tables, "_drawn_alpha", alpha)
    monkeypatch.setattr(margin_tables, "activity", activity)
    drawn_margins(DrawnJob(PLAIN, 0))
    assert len(speeds) == 11
    assert min(speeds) == pytest.approx(1.001 * slowest)
    assert speeds[-2:] == pytest.approx([1.001 * slowest] * 2)


def test_nothing_is_flown_and_so_nothing_lasts() -> None:
    lasted: list[Any] = [
        found(bears()),
        RefusedFound(NONE, NONE),
        has(0.5, 0.5, 0.5),
        RuleFound(0.5, 0.5),
    ]
    assert [each.duration_s for each in lasted] == [0.0] * 4


# --- the whole ----------------------------------------------------------------------------------


def alpha_of(one: TableJob) -> float:
    """Of its own for each: less with speed and delay, and with age that is not known."""
    alpha = 0.9 - 0.01 * one.speed_mps - 0.001 * one.lean_deg - one.delay_s
    alpha -= 0.02 * (not one.inertial)
    if one.late_s is not None:
        alpha -= one.late_s * (1.0 if one.known else 3.0)
    return alpha


def answer(one: Any) -> Any:
    if isinstance(one, TableJob):
        alpha = alpha_of(one)
        return TableFound(
            elevator=bears(alpha + 0.1), line=bears(alpha), aileron=alpha + 0.2, rudder=alpha + 0.3
        )
    if isinstance(one, DrawnJob):
        near = 0.6 + 0.001 * one.number
        return DrawnFound(
            near=near,
            far=near - 0.1,
            with_errors=near - 0.2,
            e_rho_m=0.006 if one.kind == INERTIAL else 0.008,
            carried_m=0.010,
        )
    if isinstance(one, RuleJob):
        return RuleFound(0.8, 0.8)
    before = tuple((one + k) % 100 == 0 for k in range(9))
    return RefusedFound(before, tuple(is_now and one % 500 == 0 for is_now in before))


@cache
def concluded(quick: bool = False) -> tuple[Result, list[Any]]:
    flyer = ScriptedFlyer(answer)
    return margins(Context(flyer=flyer, quick=quick)), flyer.jobs


def test_the_shipped_aircraft_is_asked_over_speed_lean_latency_and_age() -> None:
    jobs = [one for one in concluded()[1] if isinstance(one, TableJob)]
    grid = [
        job(speed, lean, delay_s, inertial)
        for speed in SPEEDS
        for lean in LEANS
        for delay_s in DELAYS
        for inertial in (True, False)
    ]
    aged = [
        job(8.5, 15.0, 0.0075, inertial, late_s=late_s, known=known)
        for inertial in (True, False)
        for known in (False, True)
        for late_s in LATE
    ]
    assert jobs == [*grid, *aged]


def test_so_many_others_are_drawn() -> None:
    jobs = concluded()[1]
    assert [one for one in jobs if isinstance(one, int)] == list(range(1000))
    drawn = [one for one in jobs if isinstance(one, DrawnJob)]
    assert drawn == [
        *(DrawnJob(INERTIAL, k) for k in range(60)),
        *(DrawnJob(PLAIN, k) for k in range(30)),
    ]
    rule = [one for one in jobs if isinstance(one, RuleJob)]
    assert len(rule) == 2 * 3 * 60
    assert rule[0].seed == (2027, 2, 0)
    assert concluded()[0].seeds == (2027,)


def test_a_quick_one_asks_one_of_each() -> None:
    jobs = concluded(quick=True)[1]
    tables = [one for one in jobs if isinstance(one, TableJob)]
    assert tables[:2] == [FOUND, FOUND._replace(inertial=False)]
    assert [(one.inertial, one.known, one.late_s) for one in tables[2:]] == [
        (inertial, known, late_s)
        for inertial in (True, False)
        for known in (False, True)
        for late_s in (0.005, 0.200)
    ]
    assert [one for one in jobs if isinstance(one, int)] == [0, 1]
    assert len([one for one in jobs if isinstance(one, DrawnJob)]) == 4
    assert len([one for one in jobs if isinstance(one, RuleJob)]) == 6


def test_what_has_a_margin_everywhere_agrees_everywhere() -> None:
    result = concluded()[0]
    assert signs(result.claims) == "✓" * 12
    least = alpha_of(job(14.0, 45.0, 0.040, False))
    assert result.claims[0].measured == (f"{least:.2f} at least, at 14 m/s, 45°, 40 ms, without")
    assert result.claims[1].measured.startswith(f"{least + 0.2:.2f} at least, at 14 m/s, 45°")
    oldest = alpha_of(job(8.5, 15.0, 0.0075, False, late_s=0.2))
    assert result.claims[4].measured == f"{oldest:.2f} at least, 200 ms late, without"
    assert result.claims[5].measured.startswith("at most 2 of 1000")
    assert result.claims[7].measured == "0.60"
    assert result.claims[8].measured == "0.80"
    assert result.numbers["least"][PLAIN] == pytest.approx([0.6 + 0.001 * k for k in range(30)])
    assert sum(result.numbers["refused"]) == 2
    assert result.numbers["sideways"][0] == (0.8, 0.8)


def test_pitch_has_a_cell_for_each_link_with_accelerometers_first() -> None:
    pitch, lateral, *_ = concluded()[0].tables
    heads = [
        f"{imu}, {ms} ms"
        for imu in ("with accelerometers", "without")
        for ms in ("7.5", "24.5", "40")
    ]
    assert list(pitch.columns[1:]) == list(lateral.columns[1:]) == heads
    assert [row[0] for row in pitch.rows] == [
        f"{speed:g} m/s, {lean:g}°" for speed in SPEEDS for lean in LEANS
    ]
    links = [(inertial, delay_s) for inertial in (True, False) for delay_s in DELAYS]
    assert pitch.rows[5][1:] == tuple(f"{alpha_of(job(8.5, 15.0, d, i)):.2f}" for i, d in links)
    assert [row[0] for row in lateral.rows] == [f"{speed:g} m/s" for speed in SPEEDS]
    alphas = [alpha_of(job(10.0, 5.0, d, i)) for i, d in links]
    assert lateral.rows[2][1:] == tuple(f"{a + 0.2:.2f} / {a + 0.3:.2f}" for a in alphas)


def test_age_has_a_row_for_what_the_schedule_knows() -> None:
    age = concluded()[0].tables[2]
    assert list(age.columns[1:]) == ["5 ms", "20 ms", "50 ms", "100 ms", "150 ms", "200 ms"]
    rows = {row[0]: row[1:] for row in age.rows}
    assert list(rows) == [
        f"{imu}, age {known}"
        for imu in ("with accelerometers", "without")
        for known in ("unknown", "in the schedule")
    ]
    for words, inertial, known in (
        ("with accelerometers, age unknown", True, False),
        ("without, age in the schedule", False, True),
    ):
        cells = [alpha_of(job(8.5, 15.0, 0.0075, inertial, late_s=s, known=known)) for s in LATE]
        assert rows[words] == tuple(f"{alpha:.2f}" for alpha in cells)


def test_drawn_aircraft_are_reported_by_the_least_and_the_fiftieth_part() -> None:
    """Of 60 the second, of 30 the first."""
    counts, drawn = concluded()[0].tables[3:5]
    assert [row[0] for row in drawn.rows] == [
        "60 aircraft, with accelerometers",
        "30 aircraft, without",
    ]
    assert drawn.rows[0][1:] == ("0.60 (0.60)", "0.50 (0.50)", "0.40 (0.40)", "0.60")
    assert drawn.rows[1][1:] == ("0.60 (0.60)", "0.50 (0.50)", "0.40 (0.40)", "0.80")
    assert counts.columns[1:] == tuple(f"{5 * k}°" for k in range(1, 10))
    assert counts.rows[0][1:] == ("10",) * 9
    assert [int(cell) for cell in counts.rows[1][1:]] == concluded()[0].numbers["refused"]
    for table in concluded()[0].tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_a_fiftieth_is_below_what_stands_in_brackets() -> None:
    def one(drawn: Any) -> Any:
        if not isinstance(drawn, DrawnJob):
            return answer(drawn)
        return has(0.9 - 0.01 * drawn.number, 0.5 + 0.01 * drawn.number, 0.5)

    drawn = margins(Context(flyer=ScriptedFlyer(one))).tables[4]
    assert drawn.rows[0][1:3] == ("0.31 (0.32)", "0.50 (0.51)")
    assert drawn.rows[1][1:3] == ("0.61 (0.61)", "0.50 (0.50)")


# --- claims at their bounds ---------------------------------------------------------------------

BY_FIXES = FOUND._replace(inertial=False)


def with_here(**of: Any) -> str:
    good = {one: found(bears()) for one in (FOUND, BY_FIXES, FAR)}
    return signs(shipped_claims({**good, FOUND: found(**of)}))


@pytest.mark.parametrize(
    ("of", "held"),
    [
        ({"line": bears(0.5)}, "✓✓✓✓"),
        ({"line": bears(0.499)}, "✗✓✓✓"),
        ({"line": bears(), "elevator": bears(0.499)}, "✗✓✓✓"),
        ({"line": bears(), "aileron": 0.5}, "✓✓✓✓"),
        ({"line": bears(), "aileron": 0.499}, "✓✗✓✓"),
        ({"line": bears(), "rudder": 0.499}, "✓✗✓✓"),
        ({"line": bears(gain_db=6.0)}, "✓✓✓✓"),
        ({"line": bears(gain_db=5.99)}, "✓✓✗✓"),
        ({"line": bears()._replace(gain_down_db=-6.0)}, "✓✓✓✓"),
        ({"line": bears()._replace(gain_down_db=-5.99)}, "✓✓✗✓"),
        ({"line": bears(), "elevator": bears()._replace(gain_down_db=-5.99)}, "✓✓✗✓"),
        ({"line": bears(phase_deg=45.0)}, "✓✓✓✓"),
        ({"line": bears(phase_deg=44.9)}, "✓✓✗✓"),
    ],
)
def test_the_shipped_aircraft_meets_its_bounds(of: dict[str, Any], held: str) -> None:
    """0.5 everywhere; 6 dB and 45 degrees where gains were found."""
    assert with_here(**of) == held


def test_the_words_are_of_the_least_gain_and_phase() -> None:
    good = {one: found(bears()) for one in (FOUND, BY_FIXES, FAR)}
    here = found(bears(gain_db=9.0, phase_deg=50.0), elevator=bears(phase_deg=47.0))
    here = here._replace(line=here.line._replace(gain_down_db=-6.5))
    assert shipped_claims({**good, FOUND: here})[2].measured == "6.5 dB and 47°"


def test_what_the_schedule_does_not_know_is_not_judged() -> None:
    def late(one: Any) -> Any:
        if isinstance(one, TableJob) and one.late_s == 0.2:
            alpha = 0.5 if one.known else 0.0
            return found(bears(alpha))
        return answer(one)

    assert signs(margins(Context(flyer=ScriptedFlyer(late))).claims) == "✓" * 12

    def too_late(one: Any) -> Any:
        known = isinstance(one, TableJob) and one.late_s == 0.05 and one.known
        return found(bears(0.49)) if known else answer(one)

    claims = margins(Context(flyer=ScriptedFlyer(too_late))).claims
    assert [i for i, claim in enumerate(claims) if not claim.holds] == [4]
    assert claims[4].measured == "0.49 at least, 50 ms late, with accelerometers"


STABLE = {INERTIAL: [has(0.6, 0.5, 0.5)], PLAIN: [has(0.6, 0.5, 0.5)]}


@pytest.mark.parametrize(("times", "holds"), [(10, True), (11, False)])
def test_one_of_a_hundred_may_be_refused_at_any_one_lean(times: int, holds: bool) -> None:
    second = (False, True, *NONE[2:])
    counts = [RefusedFound(NONE, second)] * times + [RefusedFound(second, NONE)] * (1000 - times)
    claim = drawn_claims(counts, STABLE)[0]
    assert claim.holds is holds
    assert claim.measured == f"at most {times} of 1000, at 10°"
    assert refused_table(counts).rows[1][1:4] == ("0", str(times), "0")
    assert refused_table(counts).rows[0][1:4] == ("0", str(1000 - times), "0")


@pytest.mark.parametrize("column", [0, 1, 2])
@pytest.mark.parametrize(("alpha", "holds"), [(0.0, False), (0.001, True)])
def test_no_drawn_aircraft_is_without_any_margin(column: int, alpha: float, holds: bool) -> None:
    figures = [0.6, 0.5, 0.5]
    figures[column] = alpha
    drawn = {INERTIAL: [has(*figures), has(0.6, 0.5, 0.5)], PLAIN: [has(0.6, 0.5, 0.5)]}
    claim = drawn_claims([RefusedFound(NONE, NONE)], drawn)[1]
    assert claim.holds is holds
    assert claim.measured == f"{int(not holds)} of 3"


@pytest.mark.parametrize(("fraction", "holds"), [(0.849, True), (0.851, False)])
def test_gains_that_were_sought_are_worth_fifteen_per_cent(fraction: float, holds: bool) -> None:
    """As the geometric mean of those drawn."""
    pair = [has(0.6, 0.5, 0.5, fraction * 2.0), has(0.6, 0.5, 0.5, fraction / 2.0)]
    assert sqrt(fraction * 2.0 * fraction / 2.0) == pytest.approx(exp(0.5 * 2.0 * log(fraction)))
    for kind in (INERTIAL, PLAIN):
        claims = drawn_claims([RefusedFound(NONE, NONE)], {**STABLE, kind: pair})
        assert claims[2 if kind == INERTIAL else 3].holds is holds
        assert claims[3 if kind == INERTIAL else 2].holds
