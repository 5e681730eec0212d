"""How much sooner a place is found, of made-up flights: one that is never found counts as well."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest

from tgl_soar.analysis.experiments.lift import search as e
from tgl_soar.analysis.experiments.result import Claim
from tgl_soar.analysis.search.places import DURATION_S, KINDS, SearchPlace
from tgl_soar.analysis.search.scoring import Score

FOUND = Score(
    kind="tunnel",
    seed=1,
    words="",
    change=1.0,
    begins=0.5,
    searcher=e.MAP,
    soared=True,
    settled_s=1.5,
    found_s=6.0,
    claimed_s=6.0,
    false_claim=False,
    given_up="",
    in_time=False,
    aloft=True,
    ended="",
    height_left_m=1.5,
    height_lost_m=0.2,
    room_m=nan,
    flown_s=40.0,
)
NEVER = replace(FOUND, soared=False, found_s=inf, claimed_s=inf, aloft=False, settled_s=inf)


def flown(walk: list[float], patient: list[float]) -> list[Score]:
    """Places that all soar but the walk, which finds one by these times, and given longer these."""
    scores = []
    for seed, (soon, late) in enumerate(zip(walk, patient, strict=True)):
        scores += [replace(FOUND, seed=seed, searcher=name) for name in e.MANY]
        scores[-2] = replace(FOUND if soon < inf else NEVER, seed=seed, found_s=soon)
        scores[-2] = replace(scores[-2], searcher=e.WALK)
        scores.append(replace(NEVER, seed=seed, searcher=e.PATIENT, claimed_s=late))
    return scores


def sooner(scores: list[Score]) -> Claim:
    return next(c for c in e._claims("tunnel", scores) if "sooner" in c.text)


def test_a_walk_that_claims_nothing_in_ten_times_as_long_is_ten_times_slower() -> None:
    assert (e.MANY[-2], e.MANY[-1]) == (e.WALK, e.ORACLE)
    claim = sooner(flown([inf, inf, 20.0], [inf, inf, 20.0]))
    assert claim.holds
    assert claim.measured == "6.0 s, not in half of them given 100 s: at least 16.7 times"
    late = sooner(flown([inf, inf, 20.0], [30.0, inf, 20.0]))
    assert not late.holds
    assert late.measured == "6.0 s, 30.0 s given 100 s: 5.0 times"


def test_who_finds_none_is_without_a_place_to_the_end() -> None:
    rows = {row[0]: row for row in e._sooner("tunnel", flown([inf, 20.0, 6.0], [inf] * 3)).rows}
    walk = rows[e.WALK]
    assert walk[1].startswith("1 of 3")
    assert walk[2].startswith("2 of 3")
    assert walk[3] == "6.0"
    assert walk[4] == f"{(40.0 + 20.0 + 6.0) / 3.0:.1f}"
    # 34, 14 and 0 s more: 16 s, and 1.96 times their standard error.
    assert walk[5] == "+16.0 ± 19.3"
    assert rows[e.MAP][4:] == ("6.0", "+0.0 ± 0.0")
    none = {row[0]: row for row in e._sooner("tunnel", flown([inf] * 3, [inf] * 3)).rows}[e.WALK]
    assert none[3] == "–"


def test_each_place_is_walked_once_more_for_longer() -> None:
    jobs = [job for block in e.jobs_of(2) for job in block]
    assert sum(job.searcher == e.PATIENT for job in jobs) == 4
    assert min(e.GIVEN_S[kind] / DURATION_S[kind] for kind in KINDS) >= 2.0


def test_who_still_flies_where_the_oracle_does_not_soar_is_flown_on_and_counts_as_it_ends() -> None:
    nowhere = [replace(NEVER, seed=n, searcher=name) for n in range(5) for name in e.MANY]
    nowhere += [replace(NEVER, seed=n, searcher=e.PATIENT) for n in range(5)]
    soars = [replace(FOUND, seed=5, searcher=name) for name in (*e.MANY, e.PATIENT)]
    ours = [s for s in nowhere if s.searcher == e.MAP]
    flies = [replace(each, aloft=True) for each in ours[1:4]]
    gave = [replace(ours[0], given_up="x", in_time=True), *flies, ours[4]]
    scores = [s for s in nowhere if s.searcher != e.MAP] + gave + soars
    jobs = e.undecided(scores)
    assert [(job.kind, job.seed) for job in jobs] == [("tunnel", 1), ("tunnel", 2), ("tunnel", 3)]
    assert {job.searcher for job in jobs} == {e.FLOWN_ON}
    later = [replace(each, searcher=e.FLOWN_ON) for each in flies]
    later = [replace(later[0], in_time=True), replace(later[1], soared=True), later[2]]
    claim = next(c for c in e._claims("tunnel", scores + later) if "in time" in c.text)
    assert not claim.holds
    assert claim.measured.startswith("3 of 5")
    assert claim.measured.endswith("; 3 of them flown on, 1 of which soar after 100 s")


def test_where_all_are_decided_nothing_is_said_of_flying_on() -> None:
    nowhere = [replace(NEVER, seed=n, searcher=s, in_time=True) for n in range(2) for s in e.MANY]
    nowhere += [replace(NEVER, seed=n, searcher=e.PATIENT) for n in range(2)]
    assert e.undecided(nowhere) == []
    claim = next(c for c in e._claims("tunnel", nowhere) if "in time" in c.text)
    assert claim.holds
    assert claim.measured == "2 of 2 (16–100 %)"  # exactly: 0.025 ** 0.5 = 0.158


@pytest.mark.parametrize("called", [e.PATIENT, e.FLOWN_ON, e.MAP])
def test_who_is_flown_on_flies_for_longer_in_the_same_air(
    called: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[float, str]] = []

    def fly(there: SearchPlace, name: str) -> tuple[Score]:
        asked.append((there.duration_s, name))
        return (FOUND,)

    monkeypatch.setattr(e, "_flown", fly)
    e.fly_search(e.SearchJob("tunnel", 1, called))
    lasts_s = DURATION_S["tunnel"] if called == e.MAP else e.GIVEN_S["tunnel"]
    assert asked == [(lasts_s, e.WALK if called == e.PATIENT else e.MAP)]


@pytest.mark.parametrize(
    ("values", "of_them", "expected"), [([3.0, 1.0, 2.0, 4.0], 0.25, 1.0), ([], 0.5, inf)]
)
def test_a_quantile_is_the_time_by_which_so_many_have_found(
    values: list[float], of_them: float, expected: float
) -> None:
    assert e._quantile(values, of_them) == expected
