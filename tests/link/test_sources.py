"""The choice among several sources of the position, stepped with time as an argument."""

from itertools import pairwise
from math import inf, nan, sin
from typing import get_args, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.site import PositionSettings
from tgl_soar.link.sources import (
    DEFAULT_ORDER,
    DISTRUST_S,
    DWELL_S,
    FROZEN_S,
    FROZEN_STEPPED_S,
    GLOBAL_POSITION,
    LOCAL_POSITION,
    MOCAP,
    NUMBERS,
    ODOMETRY,
    RETURN_S,
    SILENCE_S,
    VISION,
    PositionSources,
)
from tgl_soar.types import PositionFix


def fix(time_s: float, north_m: float = 1.0) -> PositionFix:
    return PositionFix(
        sequence=0,
        time_s=time_s,
        north_m=north_m,
        east_m=2.0,
        down_m=-3.0,
        velocity_north_mps=nan,
        velocity_east_mps=nan,
        velocity_down_mps=nan,
    )


def play(
    sources: PositionSources,
    until_s: float,
    *,
    start_s: float = 0.0,
    rates: dict[int, float],
    north: dict[int, float] | None = None,
) -> list[tuple[float, int]]:
    """All sources at their rates; (time, source) of every change of the chosen one."""
    changes, chosen = [], sources.chosen
    for i in range(round(start_s * 1000), round(until_s * 1000)):
        now = i * 1e-3
        for source, rate in rates.items():
            if i % round(1000 / rate) == 0:
                sources.take(source, fix(now - 0.01, (north or {}).get(source, 1.0)), now)
                if sources.chosen != chosen:
                    chosen = sources.chosen
                    changes.append((now, chosen))
    return changes


def test_the_site_file_has_a_name_for_every_source() -> None:
    (names,) = get_args(get_type_hints(PositionSettings)["sources"])
    assert set(get_args(names)) == set(NUMBERS)
    assert [NUMBERS[name] for name in PositionSettings().sources] == list(DEFAULT_ORDER)
    assert PositionSettings().silence_s == SILENCE_S
    assert PositionSettings().return_s == RETURN_S


def test_the_first_that_comes_is_taken_and_numbered() -> None:
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    assert sources.position.sequence == sources.chosen == 0
    assert sources.take(LOCAL_POSITION, fix(0.99), 1.0)
    assert sources.take(LOCAL_POSITION, fix(1.01), 1.02)
    assert sources.position[:3] == (2, 1.01, 1.0)
    assert sources.position.source == LOCAL_POSITION


def test_a_source_that_nobody_named_is_not_used() -> None:
    sources = PositionSources((MOCAP,))
    assert not sources.take(VISION, fix(0.0), 0.0)
    assert sources.position.sequence == 0
    assert sources.unused == 1


def test_a_better_source_must_have_been_steady_before_it_takes_over() -> None:
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    play(sources, 5.0, rates={LOCAL_POSITION: 50.0})
    changes = play(sources, 10.0, start_s=5.0, rates={LOCAL_POSITION: 50.0, MOCAP: 100.0})
    ((when, chosen),) = changes
    assert chosen == MOCAP
    assert when == pytest.approx(5.0 + RETURN_S)


def test_a_source_with_gaps_is_not_taken_back() -> None:
    """Half a second of fixes, then 0.2 s of none, again and again: worse than the next best."""
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    play(sources, 1.0, rates={LOCAL_POSITION: 50.0})
    for start in range(20):
        here = 1.0 + 0.7 * start
        assert not play(
            sources, here + 0.5, start_s=here, rates={LOCAL_POSITION: 50.0, MOCAP: 100.0}
        )
        assert not play(sources, here + 0.7, start_s=here + 0.5, rates={LOCAL_POSITION: 50.0})


def test_a_silent_source_is_left_soon_and_for_the_best_of_the_others() -> None:
    sources = PositionSources((MOCAP, VISION, LOCAL_POSITION))
    all_three = {LOCAL_POSITION: 50.0, VISION: 30.0, MOCAP: 100.0}
    play(sources, 5.0, rates=all_three)
    assert sources.chosen == MOCAP
    del all_three[MOCAP]
    ((when, chosen),) = play(sources, 6.0, start_s=5.0, rates=all_three)
    assert chosen == VISION
    assert when <= 5.0 + SILENCE_S + 0.05
    assert "mocap is silent" in sources.notices[-1][1]


def test_a_slow_source_is_given_its_own_periods() -> None:
    """2.5 Hz, as a Paparazzi streams by default: 0.4 s without a fix is its way."""
    sources = PositionSources((ODOMETRY, LOCAL_POSITION))
    play(sources, 10.0, rates={ODOMETRY: 2.5})
    assert play(sources, 20.0, start_s=10.0, rates={ODOMETRY: 2.5, LOCAL_POSITION: 50.0}) == []


def test_the_change_is_no_oftener_than_the_dwell() -> None:
    """The better source comes and goes as it may: each time back it has been steady for long."""
    sources = PositionSources((MOCAP, LOCAL_POSITION), return_s=0.0)
    play(sources, 1.0, rates={LOCAL_POSITION: 50.0})
    changes = []
    for i in range(30):
        here = 1.0 + 0.5 * i
        changes += play(
            sources, here + 0.2, start_s=here, rates={LOCAL_POSITION: 50.0, MOCAP: 100.0}
        )
        changes += play(sources, here + 0.5, start_s=here + 0.2, rates={LOCAL_POSITION: 50.0})
    back = [when for when, source in changes if source == MOCAP]
    assert len(back) >= 3
    assert all(b - a >= DWELL_S for a, b in pairwise(back))


def test_broken_late_and_future_fixes_are_counted_and_keep_no_source_alive() -> None:
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    play(sources, 1.0, rates={MOCAP: 100.0})
    for broken in (fix(1.0, nan), fix(1.0, inf), fix(nan), fix(0.5), fix(1.2)):
        assert not sources.take(MOCAP, broken, 1.0)
    assert not sources.take(LOCAL_POSITION, fix(-0.1), 1.0)
    health = sources.health[MOCAP]
    assert (health.not_finite, health.late, health.future) == (3, 1, 1)
    assert health.rejected == 5
    assert sources.health[LOCAL_POSITION].late == 1
    for i in range(100):
        sources.take(MOCAP, fix(1.0 + 0.01 * i, nan), 1.0 + 0.01 * i)
    assert not sources.is_fresh(MOCAP, 1.5)
    assert sources.take(LOCAL_POSITION, fix(1.99), 2.0)
    assert sources.position.source == LOCAL_POSITION


def moving_fix(time_s: float, *, speed_mps: float = 0.1) -> PositionFix:
    """As an aircraft that hangs in the wind: it moves by millimetres."""
    return fix(time_s, 1e-3 * sin(7.0 * time_s))._replace(
        velocity_north_mps=speed_mps, velocity_east_mps=0.0, velocity_down_mps=0.0
    )


def hang(
    sources: PositionSources, start_s: float, until_s: float, *, frozen: PositionFix | None = None
) -> list[tuple[float, int]]:
    """Both at 100 Hz; what LOCAL_POSITION repeats under new stamps; every change of the chosen."""
    changes, chosen = [], sources.chosen
    for i in range(round(start_s * 100), round(until_s * 100)):
        now = i * 1e-2
        fix = moving_fix(now) if frozen is None else frozen._replace(time_s=now)
        for source, offered in ((LOCAL_POSITION, fix), (MOCAP, moving_fix(now - 0.005))):
            sources.take(source, offered, now)
            if sources.chosen != chosen:
                chosen = sources.chosen
                changes.append((now, chosen))
    return changes


def test_a_frozen_source_is_left_and_taken_back_when_it_has_long_thawed() -> None:
    sources = PositionSources((LOCAL_POSITION, MOCAP))
    hang(sources, 0.0, 5.0)
    ((left, chosen),) = hang(sources, 5.0, 10.0, frozen=moving_fix(5.0))
    assert chosen == MOCAP
    assert left == pytest.approx(5.0 + FROZEN_S, abs=0.03)
    assert sources.notices[-1][1].startswith("position from mocap: local_position is frozen")
    ((back, chosen),) = hang(sources, 10.0, 15.0)
    assert chosen == LOCAL_POSITION
    assert back == pytest.approx(10.0 + RETURN_S, abs=0.02)


def test_a_source_with_steps_may_repeat_itself_as_long_as_a_calm_hover_does() -> None:
    sources = PositionSources((GLOBAL_POSITION, MOCAP))
    left_s = None
    for i in range(600):
        now = 0.01 * i
        held = moving_fix(min(now, 2.0))
        sources.take(GLOBAL_POSITION, held._replace(time_s=now, sequence=i + 1), now)
        sources.take(MOCAP, moving_fix(now), now)
        if left_s is None and sources.chosen == MOCAP:
            left_s = now
    assert left_s == pytest.approx(2.0 + FROZEN_STEPPED_S, abs=0.03)


def test_a_source_that_reckons_is_left_for_one_that_measures_and_kept_where_there_is_none() -> None:
    sources, alone = PositionSources((LOCAL_POSITION, MOCAP)), PositionSources((LOCAL_POSITION,))
    chosen = []
    for i in range(1000):
        now = i * 1e-2
        reckons = moving_fix(now)._replace(reckoned=i >= 500)
        for source, offered in ((LOCAL_POSITION, reckons), (MOCAP, moving_fix(now - 0.005))):
            sources.take(source, offered, now)
        alone.take(LOCAL_POSITION, reckons, now)
        chosen.append(sources.chosen)
    assert chosen[499] == LOCAL_POSITION
    assert chosen.index(MOCAP) < 560
    assert chosen[-1] == MOCAP
    assert "local_position is dead reckoned" in sources.notices[-1][1]
    assert alone.chosen == LOCAL_POSITION


def test_who_stands_still_may_say_so_as_often_as_it_likes() -> None:
    sources = PositionSources((LOCAL_POSITION, MOCAP))
    assert hang(sources, 0.0, 5.0, frozen=moving_fix(0.0, speed_mps=0.0))[1:] == []
    assert sources.chosen == LOCAL_POSITION


def test_what_stands_still_for_all_is_not_frozen() -> None:
    """A tracker reports no velocity; the autopilot's own estimate does not change either."""
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    for i in range(1000):
        stands = moving_fix(0.0, speed_mps=0.0)._replace(time_s=1e-2 * i)
        sources.take(LOCAL_POSITION, stands, 1e-2 * i)
        sources.take(MOCAP, fix(1e-2 * i), 1e-2 * i)
    assert sources.chosen == MOCAP
    assert sources.switches == 1


def test_a_frozen_source_is_given_while_there_is_no_better_one() -> None:
    sources = PositionSources((LOCAL_POSITION, MOCAP))
    play(sources, 5.0, rates={LOCAL_POSITION: 50.0})
    assert sources.health[LOCAL_POSITION].repeats_itself
    assert sources.position.time_s == pytest.approx(4.97)


def test_what_is_not_sane_is_left_for_what_may_be() -> None:
    sources = PositionSources((LOCAL_POSITION, MOCAP))
    hang(sources, 0.0, 5.0)
    sources.distrust(5.0)
    ((left, chosen),) = hang(sources, 5.0, 15.0)
    assert chosen == MOCAP
    assert left == pytest.approx(5.0, abs=0.02)
    sources.distrust(left + 0.1)  # an echo of the one before
    assert sources.chosen == MOCAP
    ((back, chosen),) = hang(sources, 15.0, 18.0)
    assert chosen == LOCAL_POSITION
    assert back == pytest.approx(5.0 + DISTRUST_S, abs=0.02)


def test_what_was_found_of_the_source_before_is_not_held_against_the_next() -> None:
    """Within `DWELL_S` the estimate may still be that of the source before, which was not sane.
    Taken for the next one, both would be suspect, and the first be taken back at once."""
    sources = PositionSources((LOCAL_POSITION, MOCAP))
    hang(sources, 0.0, 5.0)
    sources.distrust(5.0)
    ((left, _),) = hang(sources, 5.0, 5.5)
    for after_s in (0.5, DWELL_S - 0.01):
        sources.distrust(left + after_s)
    assert hang(sources, 5.5, 14.9) == []
    assert sources.chosen == MOCAP
    sources.distrust(14.9)  # long after: of this one
    ((_, chosen),) = hang(sources, 14.9, 15.1)
    assert chosen == LOCAL_POSITION


def test_rate_and_distance_are_known() -> None:
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    play(
        sources,
        5.0,
        rates={LOCAL_POSITION: 50.0, MOCAP: 100.0},
        north={LOCAL_POSITION: 3.5, MOCAP: 1.0},
    )
    assert sources.health[MOCAP].rate_hz == pytest.approx(100.0)
    assert sources.health[LOCAL_POSITION].rate_hz == pytest.approx(50.0)
    assert sources.health[LOCAL_POSITION].apart_m == pytest.approx(2.5)
    notices = [text for _, text in sources.notices if "share a frame" in text]
    assert notices == ["mocap is 2.5 m from local_position: do they share a frame?"]


def test_a_new_clock_does_not_lock_anything_out() -> None:
    sources = PositionSources((MOCAP, LOCAL_POSITION))
    play(sources, 500.0, start_s=499.0, rates={MOCAP: 100.0})
    sources.rebase()
    assert sources.take(MOCAP, fix(0.99), 1.0)
    assert sources.position[:2] == (101, 0.99)


times = st.one_of(st.floats(0, 100), st.floats(), st.sampled_from([nan, inf, -inf]))


@given(st.lists(st.tuples(st.integers(0, 6), times, times, st.floats(0, 1)), max_size=60))
def test_whatever_comes_positions_are_finite_in_order_and_of_a_named_source(
    samples: list[tuple[int, float, float, float]],
) -> None:
    sources = PositionSources((MOCAP, VISION, LOCAL_POSITION))
    now, sequence = 0.0, 0
    for source, time_s, north_m, step_s in samples:
        now += step_s
        if sources.take(source, fix(time_s, north_m), now):
            sequence += 1
            position = sources.position
            assert position.sequence == sequence
            assert abs(position.north_m) < inf
            assert now - 1.0 <= position.time_s <= now + 0.05
            assert position.source == source == sources.chosen
        assert sources.position.sequence == sequence


@pytest.mark.parametrize(
    ("every_s", "silent_s"), [(0.2, 0.6), (0.1, 0.3), (0.03, 0.15), (0.5, 1.0)]
)
def test_a_source_may_be_silent_for_three_of_its_periods(every_s: float, silent_s: float) -> None:
    """A fast one for SILENCE_S, and none for longer than a fix may be old."""
    sources = PositionSources((MOCAP,))
    for i in range(1, 12):
        sources.take(MOCAP, fix(i * every_s, float(i)), i * every_s)
    last_s = 11 * every_s
    assert sources.is_fresh(MOCAP, last_s + silent_s - 1e-3)
    assert not sources.is_fresh(MOCAP, last_s + silent_s + 1e-3)
