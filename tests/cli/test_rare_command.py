"""`tgl-soar campaign rare`: the ladder, plain flights and theory beside it, and what it writes."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.rare.kramers import WellExit
from tgl_soar.analysis.rare.soaring import SHOWN, SoaringCase
from tgl_soar.analysis.rare.splitting import Passage
from tgl_soar.cli import rare
from tgl_soar.cli.app import app


class Fallen(NamedTuple):
    """A state of the process below."""

    margin: float
    last: FloatArray


class Halving:
    """From anywhere it comes halfway to a loss in one of two trajectories, and on from there; below
    a tenth it is lost, one time of four by something else."""

    exits = (WellExit(-0.5, 0.3, 1e-6, smooth=False), WellExit(0.7, 0.2, 2e-6, smooth=True))

    def __init__(self, case: SoaringCase) -> None:
        self.case = case

    def begun(self, seed: int) -> Fallen:
        del seed
        return Fallen(1.0, np.zeros((4, len(SHOWN))))

    def passage(self, state: Fallen, seed: int, level: float) -> Passage:
        draw = random.Random(seed)
        margin = state.margin
        while margin > level and draw.random() < 0.5:
            margin = 0.5 * margin if margin > 0.1 else 0.0
        cause = "" if margin > 0.0 else draw.choice(["ground"] * 3 + ["stall"])
        there = margin <= level
        return Passage(margin, state._replace(margin=margin) if there else None, cause)


def test_the_ladder_is_printed_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rare, "SoaringProcess", Halving)
    monkeypatch.setattr(rare, "available", lambda: True)
    words = ["campaign", "rare", "--workers", "0", "--effort", "200", "--ladders", "6"]
    done = CliRunner().invoke(app, [*words, "--plain", "500", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "rare.json").read_text())
    # Five halvings, from 1 to below a tenth and on to 0: one in thirty-two.
    assert content["estimate"]["low"] < 1 / 32 < content["estimate"]["high"]
    assert content["plain"]["flights"] == 500
    assert 5 <= content["plain"]["lost"] <= 32  # 15.6 and four standard deviations
    losses = content["last_seconds"]["losses"]
    assert {loss["cause"] for loss in losses} == {"ground", "stall"}
    first, second = done.stdout.index("  ground"), done.stdout.index("  stall")
    assert first < second  # ranked
    assert "Kramers, below: 6e-05 a minute (-0.50 m along the line, cut off" in done.stdout
    assert "Kramers, above: 0.00012 a minute" in done.stdout


def test_without_numba_it_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rare, "available", lambda: False)
    refused = CliRunner().invoke(app, ["campaign", "rare"])
    assert refused.exit_code == 2
    assert "tgl_soar[fast]" in refused.stderr
