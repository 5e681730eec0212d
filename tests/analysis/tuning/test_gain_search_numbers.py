"""The search's numbers one by one: what a margin, e_rho and the elevator cost, how far a gain is
sought, how wide the first steps are, and what of an answer is kept."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, hypot, inf, log
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.analysis.tuning.search import (
    Candidate,
    Search,
    Values,
    best,
    cost,
    finalists,
    front,
    read,
    searched,
    stored,
    worth,
)

ONE = Search(start=(1.0,), low=(0.01,), high=(100.0,), generations=0, seed=1)


def given(alpha: float, e_rho_m: float = 0.02, elevator: float = 0.0) -> Given:
    return Given(alpha=alpha, e_rho_m=e_rho_m, elevator=elevator, worst="")


def candidate(alpha: float, e_rho_m: float = 0.02, elevator: float = 0.0) -> Candidate:
    return Candidate((alpha, e_rho_m, elevator), given(alpha, e_rho_m, elevator))


# --- cost -----------------------------------------------------------------------------------------


def test_a_third_of_the_elevators_travel_costs_as_a_centimetre() -> None:
    assert (ONE.floor, ONE.price_m) == (0.5, 0.03)
    assert worth(given(1.0, 0.0, 1.0 / 3.0), 0.03) == pytest.approx(0.01)
    assert worth(given(1.0, 0.03, 0.5), 0.08) == pytest.approx(0.05)
    assert worth(given(0.0, inf, inf), 0.03) == inf


def test_margin_costs_from_the_floor_and_its_reserve_downwards() -> None:
    plain = log(hypot(0.02, 0.03 * 0.4))
    for alpha, lacking in ((0.9, 0.0), (0.55, 0.0), (0.54, 0.01), (0.25, 0.3)):
        assert cost(given(alpha, 0.02, 0.4), ONE) == pytest.approx(plain + 20.0 * lacking)
    higher = ONE._replace(floor=0.7)
    assert cost(given(0.65, 0.02, 0.4), higher) == pytest.approx(plain + 20.0 * 0.1)


def test_an_unstable_loop_costs_as_seven_metres() -> None:
    assert cost(given(0.6, inf, inf), ONE) == 2.0
    assert cost(given(0.0, inf, inf), ONE) == pytest.approx(2.0 + 20.0 * 0.55)
    assert log(7.0) < 2.0 < log(8.0)


def test_finalists_have_a_tenth_and_two_tenths_more_and_none_stands_twice() -> None:
    """Each lacks nothing of its own floor with its reserve: 0.55, 0.65 and 0.75."""
    known = [candidate(0.551, 0.010), candidate(0.651, 0.011), candidate(0.751, 0.012)]
    assert finalists(known, ONE) == known
    assert finalists(known[2:], ONE) == known[2:]
    assert finalists([known[0], known[2]], ONE) == [known[0], known[2]]
    assert best(known, ONE) is known[0]


def test_on_the_front_are_those_that_no_other_beats_in_anything() -> None:
    kept = [candidate(0.6, 0.02, 0.1), candidate(0.6, 0.01, 0.2), candidate(0.5, 0.01, 0.1)]
    for beaten in (
        candidate(0.59, 0.02, 0.1),
        candidate(0.6, 0.021, 0.1),
        candidate(0.6, 0.02, 0.11),
        candidate(0.9, inf, 0.0),
        candidate(0.0, 0.001, 0.0),
    ):
        assert front([*kept, beaten]) == kept
    same = candidate(0.6, 0.02, 0.1)
    assert front([kept[0], same]) == [kept[0], same]  # neither beats the other


def test_an_answer_is_kept_without_infinities_and_read_as_it_was() -> None:
    unstable = Given(alpha=0.0, e_rho_m=inf, elevator=inf, worst="9 m/s")
    assert stored(unstable) == [0.0, None, None, "9 m/s"]
    assert read(stored(unstable)) == unstable
    stable = Given(alpha=0.6, e_rho_m=0.01, elevator=0.2, worst="here")
    assert stored(stable) == [0.6, 0.01, 0.2, "here"]
    assert read(stored(stable)) == stable
    assert read([1, 0, 2, ""]) == (1.0, 0.0, 2.0, "")


# --- the search -----------------------------------------------------------------------------------


class NotedEvaluation:
    """Evaluates by a function of the gains, and keeps points and reports."""

    def __init__(self, e_rho_m: object) -> None:
        self.e_rho_m = e_rho_m
        self.points: list[list[Values]] = []
        self.reports: list[tuple[str, int, Candidate]] = []

    def __call__(self, points: Sequence[Values]) -> list[Given]:
        self.points.append(list(points))
        return [given(0.9, self.e_rho_m(point)) for point in points]  # type: ignore[operator]

    def on_generation(self, name: str, n: int, found: Candidate) -> None:
        self.reports.append((name, n, found))


def run(
    folder: Path, search: Search, evaluation: NotedEvaluation, name: str = "name"
) -> list[Candidate]:
    pytest.importorskip("cma", reason="tuning needs cma")
    progress = ProgressFile(folder / "progress", "task")
    return searched(name, search, evaluation, progress, evaluation.on_generation)


def test_what_is_flown_now_comes_first_and_each_generation_is_reported_with_its_best(
    tmp_path: Path,
) -> None:
    search = Search(
        start=(2.0, 3.0), low=(0.1, 0.1), high=(9.0, 9.0), generations=3, seed=1
    )  # fmt: skip
    evaluation = NotedEvaluation(lambda point: point[0])
    found = run(tmp_path, search, evaluation)
    assert evaluation.points[0] == [(2.0, 3.0)]
    assert [each.gains for each in found] == [point for rung in evaluation.points for point in rung]
    assert [(name, n) for name, n, _ in evaluation.reports] == [("name", n) for n in range(4)]
    counts = np.cumsum([len(points) for points in evaluation.points])
    for (_, _, least), count in zip(evaluation.reports, counts, strict=True):
        assert least == min(found[:count], key=lambda each: each.given.e_rho_m)


def test_the_first_steps_change_a_gain_by_a_quarter(tmp_path: Path) -> None:
    """In logarithms, each gain for itself, and to either side alike."""
    n = 60
    search = Search(start=(2.0,) * n, low=(1e-3,) * n, high=(1e3,) * n, generations=1, seed=1)
    evaluation = NotedEvaluation(lambda point: 1.0 + point[0])
    run(tmp_path, search, evaluation)
    steps = np.log(np.array(evaluation.points[1]) / 2.0)
    assert np.std(steps) == pytest.approx(0.25, rel=0.1)
    assert abs(np.mean(steps)) < 0.03


@pytest.mark.parametrize(("sign", "end"), [(1.0, 6.0), (-1.0, 1.0 / 6.0)])
def test_no_gain_is_sought_beyond_six_times_what_is_flown(
    tmp_path: Path, sign: float, end: float
) -> None:
    search = Search(
        start=(3.0, 1.0), low=(1e-3,) * 2, high=(1e3,) * 2, generations=20, seed=1
    )  # fmt: skip
    evaluation = NotedEvaluation(lambda point: (point[0] / 3.0) ** -sign)
    found = run(tmp_path, search, evaluation)
    reached = best(found, search).gains[0] / 3.0
    assert reached == pytest.approx(end, rel=0.05)
    factors = np.array([each.gains for each in found]) / np.array(search.start)
    assert factors.max() <= 6.0 + 1e-9
    assert factors.min() >= 1.0 / 6.0 - 1e-9


@pytest.mark.parametrize(("sign", "end"), [(1.0, 3.6), (-1.0, 2.4)])
def test_no_gain_is_sought_beyond_what_its_parameter_allows(
    tmp_path: Path, sign: float, end: float
) -> None:
    search = Search(
        start=(3.0, 1.0), low=(2.4, 0.1), high=(3.6, 9.0), generations=8, seed=1
    )  # fmt: skip
    evaluation = NotedEvaluation(lambda point: (point[0] / 3.0) ** -sign)
    gains = [each.gains[0] for each in run(tmp_path, search, evaluation)]
    assert (max(gains) if sign > 0.0 else min(gains)) == pytest.approx(end, rel=1e-3)
    assert 2.4 - 1e-9 <= min(gains) <= max(gains) <= 3.6 + 1e-9


def test_one_seed_and_name_is_one_search(tmp_path: Path) -> None:
    def points(folder: str, seed: int, name: str) -> list[list[Values]]:
        search = Search(start=(1.0, 2.0), low=(0.1,) * 2, high=(9.0,) * 2, generations=1, seed=seed)
        evaluation = NotedEvaluation(lambda point: exp(point[0]))
        (tmp_path / folder).mkdir()
        run(tmp_path / folder, search, evaluation, name)
        return evaluation.points

    first = points("a", 1, "fixes")
    assert points("b", 1, "fixes") == first
    assert points("c", 2, "fixes") != first
    assert points("d", 1, "accelerometers") != first
