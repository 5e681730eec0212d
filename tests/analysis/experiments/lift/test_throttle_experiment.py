"""The search with a propeller: what counts as soared, and what is claimed of it."""

from __future__ import annotations

from tgl_soar.analysis.experiments.lift import throttle as e
from tgl_soar.analysis.search.places import place

GOOD = e.PoweredFlown(
    oracle_like=True,
    soared=True,
    false_claim=False,
    ended="",
    given_up="",
    used_s=0.0,
    height_lost_m=0.3,
    flown_s=40.0,
)


def flown(with_it: list[e.PoweredFlown]) -> dict[e.PoweredJob, e.PoweredFlown]:
    found = {}
    for seed, each in enumerate(with_it):
        found[e.PoweredJob("tunnel", seed, e.ORACLE)] = GOOD
        found[e.PoweredJob("tunnel", seed, e.WITHOUT)] = GOOD._replace(soared=False, ended="fell")
        found[e.PoweredJob("tunnel", seed, e.WITH)] = each
    return found


def test_who_is_only_held_by_the_throttle_does_not_soar() -> None:
    held = GOOD._replace(soared=False, used_s=9.0)
    claim = e._claim("tunnel", flown([GOOD] * 97 + [held] * 3))
    assert not claim.holds
    assert "97 of 100" in claim.measured
    assert e._claim("tunnel", flown([GOOD] * 99 + [held])).holds
    assert not e._claim("hill", flown([GOOD])).holds  # nothing was flown there
    row = e._table("tunnel", flown([GOOD, held])).rows[1]
    assert row[1].startswith("1 of 2")
    assert row[2] == "1"


def test_places_that_the_oracle_does_not_soar_are_not_asked_for() -> None:
    found = flown([GOOD, GOOD._replace(soared=False)])
    found[e.PoweredJob("tunnel", 1, e.ORACLE)] = GOOD._replace(soared=False)
    assert e._claim("tunnel", found).holds
    assert "1 of 2 places" in e._table("tunnel", found).title


def test_a_flight_with_a_budget_tells_what_it_used() -> None:
    there = place("tunnel", 7)._replace(duration_s=6.0)
    without, with_it = (e.fly_at(there, name, plain=True) for name in (e.WITHOUT, e.WITH))
    assert without.used_s == 0.0
    assert 0.0 <= with_it.used_s <= e.BUDGET_S
    assert with_it.flown_s > 0.0
