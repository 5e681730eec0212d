"""Where a draft's lines stand on its contour, and the slope that carries no aircraft."""

from __future__ import annotations

from math import hypot, inf

import pytest

from tgl_soar.analysis.terrain.draft import _along, _length, best_glide_slope, farthest
from tgl_soar.types import GlidePolar

RUN = [(-40.0, 0.0), (-40.0, 30.0), (0.0, 60.0)]  # 30 m up, then 50 m on: 80 m


def test_a_run_is_as_long_as_its_pieces() -> None:
    assert _length(RUN) == pytest.approx(30.0 + 50.0)
    assert _length(RUN[:1]) == _length([]) == 0.0


def test_three_lines_stand_a_quarter_of_the_run_apart_about_its_middle() -> None:
    """At 20, 40 and 60 m along it; beyond the corner a metre along is 0.8 m on and 0.6 m up."""
    lines = _along(RUN, 100.0)
    assert lines["a"] == (-40.0, 20.0)
    assert lines["b"] == pytest.approx((-32.0, 36.0))
    assert lines["c"] == pytest.approx((-16.0, 48.0))


def test_they_stand_no_further_apart_than_is_asked_for() -> None:
    lines = _along(RUN, 5.0)
    assert lines["a"] == pytest.approx((-36.0, 33.0))
    assert lines["b"] == pytest.approx((-32.0, 36.0))
    assert lines["c"] == pytest.approx((-28.0, 39.0))


def test_a_run_that_was_found_from_its_other_end_has_the_same_lines() -> None:
    assert _along(RUN[::-1], 100.0) == _along(RUN, 100.0)


def test_the_farthest_lines_are_those_of_the_ends() -> None:
    lines = _along(RUN, 100.0)
    assert farthest(lines) == pytest.approx(hypot(24.0, 28.0))
    assert farthest({"a": (1.0, 2.0)}) == 0.0
    assert farthest({}) == inf


def test_the_flattest_glide_is_the_tangent_to_the_polar() -> None:
    """Sink a + b V² is flattest at V = sqrt(a / b), where its slope is 2 sqrt(a b)."""
    a, b = 0.4, 0.005
    polar = GlidePolar(c0=a, c1=0.0, c2=b, c3=0.0, speed_min_mps=6.0, speed_max_mps=14.0)
    assert best_glide_slope(polar) == pytest.approx(2.0 * (a * b) ** 0.5, rel=1e-4)
    slow = polar._replace(speed_max_mps=8.0)  # it flies no faster
    assert best_glide_slope(slow) == pytest.approx(a / 8.0 + b * 8.0)
    fast = polar._replace(speed_min_mps=11.0)
    assert best_glide_slope(fast) == pytest.approx(a / 11.0 + b * 11.0)
