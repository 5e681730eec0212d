"""The baseline of the gym, in its smallest size."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("numba")
pytest.importorskip("cma")

import gym_baseline

from tgl_soar.gym import OBSERVATION


def test_it_trains_tests_and_writes_the_page(tmp_path: Path) -> None:
    page = tmp_path / "gym.md"
    page.write_text(f"before\n{gym_baseline.BEGIN}\nold\n{gym_baseline.END}\nafter\n")
    gym_baseline.main(
        [
            "--actions",
            "line",
            "--plain",
            "--generations",
            "1",
            "--episodes",
            "1",
            "--test",
            "2",
            "--seconds",
            "0.4",
            "--out",
            str(tmp_path),
            "--docs",
            str(tmp_path),
        ]
    )
    found = json.loads((tmp_path / "baseline.json").read_text())
    assert [f["policy"] for f in found["figures"]] == [gym_baseline.OURS, "linear, CMA-ES"]
    assert all(f[who]["flights"] == 2 for f in found["figures"] for who in ("own", "unlike"))
    assert all(f["own"]["gain"] != f["unlike"]["gain"] for f in found["figures"])
    assert len(found["curves"]["line"]) == 1
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert gym_baseline.OURS in text
    assert (tmp_path / "images" / "gym.png").stat().st_size > 1000


def test_a_linear_policy_is_its_matrix() -> None:
    size = len(OBSERVATION)
    weights = np.zeros(size + 1)
    weights[0], weights[1] = 0.1, 0.5  # b, and of the first number
    policy = gym_baseline.linear(weights, 1, np.full(size, 2.0), np.full(size, 4.0))
    observation = np.full(size, 6.0)
    assert policy(observation) == pytest.approx(np.tanh([0.1 + 0.5 * 1.0]))


def test_what_ends_early_is_counted_with_its_cause() -> None:
    own = gym_baseline.Reached(
        flights=4, gain=1.0, error=0.1, there=0.5, lost=0.25, causes={"hit the board": 1}
    )
    unlike = own._replace(gain=0.5, there=0.25, lost=0.5, causes={"outside the fence": 2})
    figure = gym_baseline.Figure(action="pitch", policy="p", parameters=3, own=own, unlike=unlike)
    head, _, row = gym_baseline.table([figure], 30.0).splitlines()
    assert head.count("|") == row.count("|") == 12
    assert row == (
        "| pitch | p | 3 | 1.00 ± 0.10 | 50 % | 25.0 % | hit the board (1)"
        " | 0.50 ± 0.10 | 25 % | 50.0 % | outside the fence (2) |"
    )
