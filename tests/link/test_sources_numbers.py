"""Each time and count by which a source is taken, left and taken back, on both sides."""

from __future__ import annotations

from math import inf, isnan, nan

import pytest

from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, MOCAP, ODOMETRY, PositionSources
from tgl_soar.types import NO_FIX, PositionFix

FIRST, SECOND = MOCAP, LOCAL_POSITION


def fix(time_s: float, north_m: float | None = None, **fields: float) -> PositionFix:
    """One that is elsewhere each time, unless a place is given."""
    moved_m = 0.001 * time_s if north_m is None else north_m
    still = {"velocity_north_mps": 1.0, "velocity_east_mps": 0.0, "velocity_down_mps": 0.0}
    placed = NO_FIX._replace(time_s=time_s, north_m=moved_m, east_m=0.0, down_m=0.0)
    given = {**still, **fields}
    return placed._replace(
        velocity_north_mps=given["velocity_north_mps"],
        velocity_east_mps=given["velocity_east_mps"],
        velocity_down_mps=given["velocity_down_mps"],
        reckoned=bool(given.get("reckoned", False)),
    )


class TwoSources:
    """Two sources of which the first is trusted more."""

    def __init__(self) -> None:
        self.all = PositionSources((FIRST, SECOND))

    def receive(self, source: int, time_s: float, north_m: float | None = None) -> bool:
        return self.all.take(source, fix(time_s, north_m), time_s)

    def run(self, from_s: float, until_s: float, *sources: int) -> None:
        """At 16 Hz, both ends included."""
        for i in range(round((until_s - from_s) * 16) + 1):
            for source in sources:
                self.receive(source, from_s + i / 16)

    @property
    def words(self) -> list[str]:
        return [text for _, text in self.all.notices]


def test_nothing_is_chosen_or_counted_before_anything_came() -> None:
    sources = PositionSources((FIRST, SECOND))
    assert (sources.chosen, sources.switches, sources.unused) == (0, 0, 0)
    for health in sources.health.values():
        assert (health.fixes, health.rejected, health.repeats, health.rate_hz) == (0, 0, 0, 0.0)
        assert not health.reckons
        assert not health.reports_standstill
    assert not sources.is_fresh(FIRST, 0.0)
    assert not sources.is_fresh(GLOBAL_POSITION, 0.0)


# --- what can be used -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time_s", "counts"),
    [
        (100.0, (0, 0, 0)),
        (100.049, (0, 0, 0)),
        (100.051, (0, 0, 1)),
        (99.01, (0, 0, 0)),
        (98.99, (0, 1, 0)),
        (nan, (1, 0, 0)),
        (inf, (1, 0, 0)),
    ],
)
def test_a_fix_is_of_the_last_second_and_not_of_the_future(
    time_s: float, counts: tuple[int, int, int]
) -> None:
    sources = PositionSources((FIRST,))
    assert sources.take(FIRST, fix(time_s, 1.0), 100.0) is not any(counts)
    health = sources.health[FIRST]
    assert (health.not_finite, health.late, health.future) == counts
    assert health.rejected == sum(counts)
    assert health.fixes == (not any(counts))


@pytest.mark.parametrize("axis", range(3))
def test_a_place_that_is_no_number_is_none(axis: int) -> None:
    places = [1.0, 2.0, 3.0]
    places[axis] = nan
    sources = PositionSources((FIRST,))
    broken = fix(100.0)._replace(north_m=places[0], east_m=places[1], down_m=places[2])
    assert not sources.take(FIRST, broken, 100.0)
    assert sources.health[FIRST].not_finite == 1


def test_the_same_time_once_more_is_late() -> None:
    sources = TwoSources()
    assert sources.receive(FIRST, 100.0)
    assert not sources.receive(FIRST, 100.0)
    assert sources.all.health[FIRST].late == 1


def test_sources_that_nobody_named_are_counted() -> None:
    sources = TwoSources()
    assert not sources.receive(ODOMETRY, 100.0)
    assert sources.all.unused == 1


def test_the_mean_interval_follows_by_a_tenth_and_gaps_do_not_count() -> None:
    sources = TwoSources()
    health = sources.all.health[FIRST]
    sources.receive(FIRST, 100.0)
    assert isnan(health.period_s)
    sources.receive(FIRST, 100.5)
    assert (health.period_s, health.rate_hz) == (0.5, 2.0)
    sources.receive(FIRST, 100.75)
    assert health.period_s == pytest.approx(0.5 - 0.1 * 0.25)
    before = health.period_s
    sources.receive(FIRST, 101.8)  # more than a second
    assert health.period_s == before
    sources.receive(FIRST, 102.7)
    assert health.period_s == pytest.approx(before + 0.1 * (0.9 - before))


# --- silence, and the way back --------------------------------------------------------------------


@pytest.mark.parametrize(("silent_s", "is_left"), [(0.149, False), (0.151, True)])
def test_a_quick_source_may_be_silent_for_a_seventh_of_a_second(
    silent_s: float, is_left: bool
) -> None:
    sources = TwoSources()
    for i in range(200):  # at 100 Hz
        sources.receive(FIRST, 100.0 + i / 100)
    assert sources.all.is_fresh(FIRST, 101.99 + silent_s) is not is_left
    assert sources.receive(SECOND, 101.99 + silent_s) is is_left
    assert sources.all.chosen == (SECOND if is_left else FIRST)


@pytest.mark.parametrize(("steady_s", "is_back"), [(1.9375, False), (2.0, True)])
def test_one_that_is_trusted_more_must_have_come_for_two_seconds(
    steady_s: float, is_back: bool
) -> None:
    sources = TwoSources()
    sources.run(100.0, 110.0, SECOND)
    sources.run(110.0, 110.0 + steady_s, FIRST, SECOND)
    assert (sources.all.chosen == FIRST) is is_back
    assert sources.all.switches == is_back


def test_and_the_change_before_must_be_two_seconds_ago() -> None:
    sources = TwoSources()
    sources.all = PositionSources((FIRST, SECOND), return_s=0.0)
    sources.run(100.0, 102.0, FIRST, SECOND)
    sources.run(102.0625, 102.25, SECOND)  # three intervals of silence are borne: it is left then
    assert sources.all.chosen == SECOND
    sources.run(102.3125, 104.125, FIRST, SECOND)
    assert sources.all.chosen == SECOND
    sources.run(104.1875, 104.375, FIRST, SECOND)
    assert sources.all.chosen == FIRST
    assert sources.all.switches == 2


# --- frozen, dead reckoned, not sane --------------------------------------------------------------


@pytest.mark.parametrize(("repeats", "every_s", "is_frozen"), [
    (5, 0.0625, True),  # 0.31 s
    (4, 0.0625, False),
    (5, 0.03, False),  # 0.15 s
    (6, 0.04, True),  # 0.24 s
])  # fmt: skip
def test_the_same_bits_five_times_over_and_for_a_fifth_of_a_second_are_frozen(
    repeats: int, every_s: float, is_frozen: bool
) -> None:
    sources = TwoSources()
    for i in range(repeats + 1):
        sources.receive(FIRST, 100.0 + i * every_s, 7.0)
    assert sources.all.health[FIRST].repeats == repeats
    assert sources.all.health[FIRST].repeats_itself is is_frozen


def test_velocities_of_exactly_zero_are_a_standstill_and_unknown_ones_are_not_compared() -> None:
    sources = PositionSources((FIRST,))
    zero = {f"velocity_{axis}_mps": 0.0 for axis in ("north", "east", "down")}
    sources.take(FIRST, fix(100.0, 7.0, **zero), 100.0)
    assert sources.health[FIRST].reports_standstill
    unknown = dict.fromkeys(zero, nan)
    for i in range(1, 4):
        sources.take(FIRST, fix(100.0 + i, 7.0, **unknown), 100.0 + i)
    assert not sources.health[FIRST].reports_standstill
    assert sources.health[FIRST].repeats == 2


@pytest.mark.parametrize(("after_s", "is_trusted"), [(9.9, False), (10.1, True)])
def test_what_was_not_sane_is_suspect_for_ten_seconds(after_s: float, is_trusted: bool) -> None:
    sources = TwoSources()
    sources.run(100.0, 103.0, FIRST, SECOND)
    sources.all.distrust(103.0)
    sources.run(103.0625, 103.5, FIRST, SECOND)
    assert sources.all.chosen == SECOND
    assert "is not sane" in sources.words[0]
    sources.run(103.5625, 103.0 + after_s, FIRST, SECOND)
    assert (sources.all.chosen == FIRST) is is_trusted


@pytest.mark.parametrize(("since_s", "counts"), [(1.9, False), (2.1, True)])
def test_what_may_still_be_of_the_source_before_is_not_held_against_this_one(
    since_s: float, counts: bool
) -> None:
    sources = TwoSources()
    sources.run(100.0, 100.0 + since_s, FIRST)
    sources.all.distrust(100.0 + since_s)
    assert isnan(sources.all.health[FIRST].distrusted_s) is not counts


# --- what is reported -----------------------------------------------------------------------------


@pytest.mark.parametrize(("apart_m", "is_reported"), [(0.99, False), (1.05, True)])
def test_live_sources_that_are_a_metre_apart_are_reported_once(
    apart_m: float, is_reported: bool
) -> None:
    sources = TwoSources()
    for i in range(5):
        sources.receive(FIRST, 100.0 + i / 16, 3.0 + i * 1e-6)
        sources.receive(SECOND, 100.01 + i / 16, 3.0 + apart_m)
    reported = [text for text in sources.words if "do they share a frame?" in text]
    assert len(reported) == is_reported
    assert all("is 1.1 m from" in text or "is 1.0 m from" in text for text in reported)
    assert sources.all.health[SECOND].apart_m == pytest.approx(apart_m, abs=1e-4)


def test_another_clock_forgets_times_and_keeps_the_choice() -> None:
    sources = TwoSources()
    sources.run(1000.0, 1002.0, FIRST)
    sources.all.rebase()
    assert sources.all.chosen == FIRST
    assert not sources.all.is_fresh(FIRST, 1002.0)
    assert sources.receive(FIRST, 5.0)
    health = sources.all.health[FIRST]
    assert isnan(health.period_s)
    assert health.late == 0
