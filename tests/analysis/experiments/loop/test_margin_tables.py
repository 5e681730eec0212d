"""What `margins` says of made-up margins, and that it asks for what it says."""

from __future__ import annotations

import json

from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.loop.margin_tables import (
    FOUND,
    REFUSED_LEANS_DEG,
    DrawnFound,
    RefusedFound,
    TableFound,
    TableJob,
    drawn_claims,
    refused,
    refused_table,
    shipped_claims,
    table_margins,
)
from tgl_soar.analysis.experiments.result import as_json
from tgl_soar.analysis.linear_model import Margin
from tgl_soar.control.found_gains import INERTIAL, PLAIN

HERE, BY_FIXES = FOUND, FOUND._replace(inertial=False)
FAR = TableJob(speed_mps=14.0, lean_deg=45.0, delay_s=0.04, inertial=False)
NONE = tuple(False for _ in REFUSED_LEANS_DEG)


def bears(alpha: float = 0.8, gain_db: float = 7.0, phase_deg: float = 46.0) -> Margin:
    return Margin(
        alpha=alpha,
        at_radps=5.0,
        gain_up_db=gain_db,
        gain_down_db=-20.0,
        phase_deg=phase_deg,
        delay_s=0.1,
    )


def found(
    line: Margin, elevator: Margin | None = None, aileron: float = 0.9, rudder: float = 1.0
) -> TableFound:
    return TableFound(elevator=elevator or bears(), line=line, aileron=aileron, rudder=rudder)


def test_the_worst_case_is_judged_and_named() -> None:
    good = {job: found(bears()) for job in (HERE, BY_FIXES, FAR)}
    assert all(claim.holds for claim in shipped_claims(good))
    pitch, side, *_ = shipped_claims({**good, FAR: found(bears(0.49))})
    assert not pitch.holds
    assert pitch.measured == "0.49 at least, at 14 m/s, 45°, 40 ms, without"
    assert side.holds
    for weak in (found(bears(), aileron=0.45), found(bears(), rudder=0.45)):
        pitch, side, *_ = shipped_claims({**good, BY_FIXES: weak})
        assert pitch.holds
        assert not side.holds
        assert side.measured.startswith("0.45 at least, at 8.5 m/s")


def test_decibels_and_degrees_are_asked_of_both_breaks_where_gains_were_found() -> None:
    good = {job: found(bears()) for job in (HERE, BY_FIXES, FAR)}
    for weak in (bears(gain_db=5.9), bears(phase_deg=44.0)):
        for here in (found(weak), found(bears(), elevator=weak)):
            *_, inertial, plain = shipped_claims({**good, HERE: here})
            assert not inertial.holds
            assert plain.holds
    *_, inertial, plain = shipped_claims({**good, FAR: found(bears(gain_db=3.0))})
    assert inertial.holds
    assert plain.holds


def has(near: float, far: float, errors: float, e_rho_m: float = 0.8) -> DrawnFound:
    return DrawnFound(
        near=near, far=far, with_errors=errors, e_rho_m=0.01 * e_rho_m, carried_m=0.01
    )


def test_gains_that_were_sought_are_compared_by_the_mean_of_logarithms() -> None:
    halves = [has(0.6, 0.5, 0.5, 0.25), has(0.6, 0.5, 0.5, 1.0)]
    drawn = {INERTIAL: halves, PLAIN: [has(0.6, 0.5, 0.5, 0.86)]}
    _, _, inertial, plain = drawn_claims([RefusedFound(NONE, NONE)], drawn)
    assert (inertial.holds, inertial.measured) == (True, "0.50")
    assert (plain.holds, plain.measured) == (False, "0.86")


def test_each_lean_is_judged_alone_and_nobody_unstable() -> None:
    late = (*NONE[:-1], True)
    stable = {INERTIAL: [has(0.6, 0.5, 0.5)], PLAIN: [has(0.6, 0.5, 0.1)]}
    one_of_100 = [RefusedFound(NONE, late)] + [RefusedFound(late, NONE)] * 99
    few, none, *_ = drawn_claims(one_of_100, stable)
    assert few.holds
    assert few.measured == "at most 1 of 100, at 45°"
    assert none.holds
    two, *_ = drawn_claims([RefusedFound(NONE, late)] * 2 + one_of_100[2:], stable)
    assert not two.holds
    for unstable in (has(0, 0.5, 0.5), has(0.5, 0, 0.5), has(0.5, 0.5, 0)):
        _, some, *_ = drawn_claims(one_of_100, {**stable, PLAIN: [unstable]})
        assert not some.holds
    assert refused_table(one_of_100).rows[0][-1] == "99"
    assert refused_table(one_of_100).rows[1][-1] == "1"


def test_a_drawn_aircraft_is_refused_on_a_flat_line_only_with_gains_that_do_not_yield() -> None:
    """The first of its seed."""
    first = refused(0)
    assert first.before[REFUSED_LEANS_DEG.index(5.0)]
    assert first.now == NONE


def test_old_attitudes_are_unstable_where_the_schedule_does_not_know_them() -> None:
    late = FOUND._replace(late_s=0.1)
    assert table_margins(late).alpha > 0.5
    assert table_margins(late._replace(known=False)).alpha == 0.0


def test_it_is_reported_whole() -> None:
    result = run("margins", Context(flyer=Flyer(), quick=True))
    assert [len(table.rows) for table in result.tables] == [1, 1, 4, 2, 2, 6]
    assert all(len(row) == len(t.columns) for t in result.tables for row in t.rows)
    assert json.dumps(as_json(result))
