"""The search: it finds what is known to be best, and goes on where it was killed."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf, log
from pathlib import Path

import pytest

from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.progress_file import ProgressError, ProgressFile
from tgl_soar.analysis.tuning.search import (
    RESERVE,
    Candidate,
    Search,
    Values,
    best,
    cost,
    finalists,
    front,
    searched,
)

pytest.importorskip("cma", reason="tuning needs cma")

START = (1.0, 2.0, 3.0)
SEARCH = Search(
    start=START, low=(0.01,) * 3, high=(100.0,) * 3, generations=25, seed=3, price_m=0.0
)


def known(gains: Values) -> Given:
    """e_rho falls as the first gain grows, margin too; of the others the start is best."""
    away = sum((log(g / s)) ** 2 for g, s in zip(gains[1:], START[1:], strict=True))
    size = log(gains[0])
    return Given(alpha=0.7 - 0.5 * size, e_rho_m=exp(-size + away), elevator=0.1, worst="here")


class Counted:
    """Evaluates, counts, and is killed at a call."""

    def __init__(self, killed_at: int = 10**9) -> None:
        self.calls, self.killed_at = 0, killed_at

    def __call__(self, points: Sequence[Values]) -> list[Given]:
        self.calls += 1
        if self.calls == self.killed_at:
            raise KeyboardInterrupt
        return [known(point) for point in points]


def run(path: Path, evaluate: Counted) -> list[Candidate]:
    return searched("x", SEARCH, evaluate, ProgressFile(path, "task"), lambda *_: None)


def test_the_best_lies_on_the_constraint(tmp_path: Path) -> None:
    """alpha = floor + reserve = 0.55 at ln(gain) = 0.3; the others stay where they are."""
    found = best(run(tmp_path / "p", Counted()), SEARCH)
    assert found.gains == pytest.approx((exp(0.3), 2.0, 3.0), rel=0.03)
    assert found.given.alpha == pytest.approx(SEARCH.floor + RESERVE, abs=0.01)


@pytest.mark.parametrize("killed_at", [1, 2, 14, 26])
def test_a_killed_search_goes_on_as_if_it_had_not_been(tmp_path: Path, killed_at: int) -> None:
    whole = run(tmp_path / "whole", Counted())
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed", Counted(killed_at))
    rest = Counted()
    assert run(tmp_path / "killed", rest) == whole
    assert rest.calls == 26 - (killed_at - 1)  # what was found before is not sought again


def test_what_is_half_written_is_not_the_file(tmp_path: Path) -> None:
    """A kill while writing leaves a file beside it; the progress is that of the step before."""
    path = tmp_path / "p"
    progress = ProgressFile(path, "task")
    progress.answer("one", lambda: [1])
    (tmp_path / "p.new").write_bytes(b'{"task":"ta')
    again = ProgressFile(path, "task")
    assert again.answer("one", lambda: pytest.fail("sought again")) == [1]


def test_progress_of_another_task_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p"
    ProgressFile(path, "one").answer("q", lambda: 1)
    with pytest.raises(ProgressError, match="--restart"):
        ProgressFile(path, "other")
    path.write_bytes(b"{")
    with pytest.raises(ProgressError, match="delete it"):
        ProgressFile(path, "one")


def candidate(alpha: float, e_rho_m: float, elevator: float) -> Candidate:
    return Candidate((alpha, e_rho_m, elevator), Given(alpha, e_rho_m, elevator, ""))


def test_what_lacks_margin_costs_more_than_any_e_rho_saves() -> None:
    """0.01 of margin against 20 % of e_rho; instability against everything."""
    enough, lacking = Given(0.55, 0.0120, 0.0, ""), Given(0.54, 0.0101, 0.0, "")
    assert cost(enough, SEARCH) < cost(lacking, SEARCH)
    assert cost(Given(0.3, 0.5, 0.3, ""), SEARCH) < cost(Given(0.0, inf, inf, ""), SEARCH)


def test_finalists_have_more_margin_each() -> None:
    found = [candidate(a, e, 0.1) for a, e in ((0.56, 0.01), (0.66, 0.011), (0.76, 0.013))]
    search = SEARCH._replace(floor=0.5)
    assert finalists([*found, candidate(0.56, 0.02, 0.1)], search) == found


def test_the_front_is_what_nothing_beats() -> None:
    kept = [candidate(0.6, 0.01, 0.1), candidate(0.7, 0.02, 0.1), candidate(0.5, 0.02, 0.05)]
    beaten = [candidate(0.6, 0.02, 0.1), candidate(0.0, 0.001, 0.0)]
    assert front([*kept, *beaten]) == kept
