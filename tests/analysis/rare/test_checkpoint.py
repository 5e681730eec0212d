"""A run of splitting that is kept: the same as one that is not, part by part, and gone on with
where it was stopped."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.rare import checkpoint
from tgl_soar.analysis.rare.checkpoint import RareRequest, RareRun, fly_kept, is_lost
from tgl_soar.analysis.rare.splitting import Passage, climb, pilot_levels, plain_seeds
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.run import Progress

REQUEST = RareRequest(effort=20, ladders=3, plain=11, seed=4)
HERE = InLine()


class Stopped(Exception):
    """Ctrl-C was pressed."""


class Stairs:
    """Goes one step of 0.25 down in two of three trajectories, and another: from 1 to a loss.  It
    counts what is flown, and stops at a trajectory that is named."""

    def __init__(self, stops_at: int = 10**9) -> None:
        self.flown: list[int] = []
        self.stops_at = stops_at

    def begun(self, seed: int) -> Any:
        del seed
        return 1.0

    def passage(self, state: Any, seed: int, level: float) -> Passage:
        self.flown.append(seed)
        if len(self.flown) == self.stops_at:
            raise Stopped
        margin = float(state)
        draw = np.random.default_rng(seed)
        while margin > max(level, 0.0) and draw.random() < 0.67:
            margin -= 0.25
        reached = margin <= level
        return Passage(margin, margin if reached else None, "ground" if margin <= 0.0 else "")

    def shown(self, state: Any) -> Any:
        return np.array([[state]])


def flown(folder: Path, process: Stairs | None = None, **more: Any) -> RareRun:
    how = {"parameters": {"air": "calm"}, **more}
    return fly_kept(process or Stairs(), REQUEST, HERE, folder, **how)


def lost_by_hand() -> int:
    process = Stairs()
    seeds = plain_seeds(REQUEST.plain, REQUEST.seed)
    return sum(process.passage(1.0, seed, 0.0).lowest <= 0.0 for seed in seeds)


def test_what_is_kept_is_what_splitting_gives(tmp_path: Path) -> None:
    found = flown(tmp_path)
    levels = pilot_levels(Stairs(), REQUEST.effort, REQUEST.seed, HERE)
    assert found.levels == levels
    ladders = [climb(Stairs(), levels, 20, 4, HERE, ladder=n) for n in range(3)]
    assert [each.rungs for each in found.ladders] == [each.rungs for each in ladders]
    assert [len(each.losses) for each in found.ladders] == [len(each.losses) for each in ladders]
    assert found.lost == lost_by_hand()
    assert 0 < found.lost < REQUEST.plain


@pytest.mark.parametrize("batch", [1, 4, 11, 5000])
def test_each_plain_flight_is_flown_once_whatever_the_batches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    monkeypatch.setattr(checkpoint, "BATCH", batch)
    process = Stairs()
    assert flown(tmp_path, process).lost == lost_by_hand()
    assert process.flown[-11:] == list(plain_seeds(11, 4))
    manifest = json.loads((tmp_path / "plain" / "manifest.json").read_bytes())
    assert manifest["flights"] == -(-11 // batch)


def test_a_batch_is_no_more_than_minutes() -> None:
    assert checkpoint.BATCH == 5000


def test_each_part_has_a_folder_that_says_it_is_done(tmp_path: Path) -> None:
    flown(tmp_path)
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(checkpoint.PARTS)
    for name, flights in (("pilot", 1), ("ladders", 3), ("plain", 1)):
        manifest = json.loads((tmp_path / name / "manifest.json").read_bytes())
        assert manifest["name"] == f"rare {name}"
        assert manifest["flights"] == flights
        assert manifest["complete"]
        assert "ended" in manifest["runs"][0]
        assert manifest["parameters"] == {"air": "calm", **REQUEST._asdict()}


def test_a_run_that_is_stopped_goes_on_with_the_ladder_it_was_at(tmp_path: Path) -> None:
    """Ladders that were climbed are not climbed again, and the result is that of one run."""
    whole = Stairs()
    expected = flown(tmp_path / "whole", whole)
    rungs = [sum(rung.tried for rung in each.rungs) for each in expected.ladders]
    pilot = len(whole.flown) - sum(rungs) - REQUEST.plain
    with pytest.raises(Stopped):
        flown(tmp_path / "stopped", Stairs(stops_at=pilot + rungs[0] + 1))
    manifest = json.loads((tmp_path / "stopped" / "ladders" / "manifest.json").read_bytes())
    assert not manifest["complete"]
    rest = Stairs()
    found = flown(tmp_path / "stopped", rest, resume=True)
    assert rest.flown == whole.flown[pilot + rungs[0] :]
    assert (found.levels, found.lost) == (expected.levels, expected.lost)
    assert [each.rungs for each in found.ladders] == [each.rungs for each in expected.ladders]


def test_what_lies_there_is_neither_gone_on_with_nor_deleted_unasked(tmp_path: Path) -> None:
    with pytest.raises(Stopped):
        flown(tmp_path, Stairs(stops_at=5))
    with pytest.raises(JournalError, match="not finished"):
        flown(tmp_path)
    process = Stairs()
    flown(tmp_path, process, restart=True)
    again = Stairs()
    flown(tmp_path, again, restart=True)
    assert again.flown == process.flown
    with pytest.raises(JournalError, match="finished"):
        flown(tmp_path)


def test_other_parameters_are_another_run(tmp_path: Path) -> None:
    with pytest.raises(Stopped):
        flown(tmp_path, Stairs(stops_at=5))
    with pytest.raises(JournalError):
        flown(tmp_path, resume=True, parameters={"air": "rough"})


def test_each_part_tells_how_far_it_is(tmp_path: Path) -> None:
    reported: list[tuple[str, int, int]] = []

    def on_part(title: str, progress: Progress) -> None:
        reported.append((title, progress.flown, progress.of))

    flown(tmp_path, on_part=on_part)
    ladders = [("ladders", n, 3) for n in range(4)]
    assert reported == [
        *(("pilot", 0, 1), ("pilot", 1, 1)),
        *ladders,
        *(("plain flights", 0, 1), ("plain flights", 1, 1)),
    ]


def test_a_plain_flight_is_lost_that_comes_to_nought_and_no_other() -> None:
    class Falls(Stairs):
        def passage(self, state: Any, seed: int, level: float) -> Passage:
            """To a margin of half of the seed, whatever is asked."""
            margin = 0.5 * seed
            return Passage(margin, state if margin <= level else None, "")

    assert is_lost(Falls(), 0)
    assert not is_lost(Falls(), 1)
