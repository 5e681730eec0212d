"""`tgl-soar campaign rare`: the ladder, plain flights and theory beside it, and what it writes."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridField
from tgl_soar.air.grid_files import write_npz
from tgl_soar.analysis.rare import checkpoint
from tgl_soar.analysis.rare.kramers import WellExit
from tgl_soar.analysis.rare.soaring_process import SHOWN, SoaringCase, SoaringProcess
from tgl_soar.analysis.rare.splitting import Passage
from tgl_soar.cli import batch_options, rare
from tgl_soar.cli.app import app
from tgl_soar.cli.console import AIRFRAME
from tgl_soar.sim.campaign import folder, rows
from tgl_soar.sim.campaign.manifest import read_manifest
from tgl_soar.sim.campaign.rows import read_rows


class Fallen(NamedTuple):
    """A state of the process below."""

    margin: float
    last: FloatArray
    cause: str


class Halving:
    """From anywhere it comes halfway to a loss in one of two trajectories, and on from there; below
    a tenth it is lost, by the ground.  Before its first step it is handed over one time in a
    hundred, past all levels at once.  A cause is known where it happens, and is kept."""

    exits = (WellExit(-0.5, 0.3, 1e-6, smooth=False), WellExit(0.7, 0.2, 2e-6, smooth=True))

    def __init__(self, case: SoaringCase) -> None:
        self.case = case

    def begun(self, seed: int) -> Fallen:
        del seed
        return Fallen(1.0, np.zeros((4, len(SHOWN))), "")

    def shown(self, state: Fallen) -> FloatArray:
        return state.last

    def passage(self, state: Fallen, seed: int, level: float) -> Passage:
        draw = random.Random(seed)
        margin, cause = state.margin, state.cause
        if margin == 1.0 and draw.random() < 0.01:
            margin, cause = 0.0, "handed over"
        while margin > level and draw.random() < 0.5:
            margin = 0.5 * margin if margin > 0.1 else 0.0
            cause = "" if margin > 0.0 else "ground"
        there = margin <= level
        fallen = state._replace(margin=margin, cause=cause)
        return Passage(margin, fallen if there else None, cause if there else "")


WORDS = ["campaign", "rare", "--workers", "0"]


@pytest.fixture
def halving(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rare, "SoaringProcess", Halving)
    monkeypatch.setattr(rare, "available", lambda: True)


@pytest.mark.usefixtures("halving")
def test_the_ladder_is_printed_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "BATCH", 150)  # three of them and a part
    words = [*WORDS, "--effort", "200", "--ladders", "6"]
    done = CliRunner().invoke(app, [*words, "--plain", "500", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "rare.json").read_text())
    # Five halvings, from 1 to below a tenth and on to 0: one in thirty-two; or handed over.
    exactly = 0.01 + 0.99 / 32
    assert content["estimate"]["low"] < exactly < content["estimate"]["high"]
    assert content["plain"]["flights"] == 500
    assert 5 <= content["plain"]["lost"] <= 39  # 20.5 and four standard deviations
    losses = content["last_seconds"]["losses"]
    assert {loss["cause"] for loss in losses} == {"ground", "handed over"}
    fractions = {cause["text"]: cause["fraction"] for cause in content["causes"]}
    assert sum(fractions.values()) == pytest.approx(1.0)
    # A quarter; 1,200 trajectories of the first rung see 12 hand-overs, give or take 3.5.
    assert fractions["handed over"] == pytest.approx(0.01 / exactly, abs=4 * 3.5 / 1200 / exactly)
    assert sum(loss["weight"] for loss in losses) / 6 == pytest.approx(
        content["estimate"]["probability"]
    )
    first, second = done.stdout.index("  ground"), done.stdout.index("  handed over")
    assert first < second  # ranked
    assert "Kramers, below: 6e-05 a minute (-0.50 m along the line, cut off" in done.stdout
    assert "Kramers, above: 0.00012 a minute" in done.stdout


@pytest.mark.usefixtures("halving")
def test_ladders_and_plain_flights_are_rows_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(checkpoint, "BATCH", 150)
    words = [*WORDS, "--effort", "200", "--ladders", "3", "--plain", "500", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    content = json.loads((tmp_path / "rare.json").read_text())
    ladders = list(read_rows(tmp_path / "flights/ladders/rows.parquet"))
    assert [row["rungs"] for row in ladders] == content["ladders"]
    causes = [loss["cause"] for row in ladders for loss in row["losses"]]
    assert causes == [loss["cause"] for loss in content["last_seconds"]["losses"]]
    batches = list(read_rows(tmp_path / "flights/plain/rows.parquet"))
    assert [row["flights"] for row in batches] == [150, 150, 150, 50]
    assert sum(row["lost"] for row in batches) == content["plain"]["lost"]
    first = batches[0]["first_seed"]
    assert [row["first_seed"] - first for row in batches] == [0, 150, 300, 450]
    report = CliRunner().invoke(app, ["campaign", "report", str(tmp_path / "flights/plain")])
    assert report.exit_code == 0, report.output
    # What the table lacks, the last seconds, is still there to be drawn again.
    assert CliRunner().invoke(app, [*words, "--resume"]).exit_code == 0
    assert json.loads((tmp_path / "rare.json").read_text())["ladders"] == content["ladders"]


@pytest.mark.usefixtures("halving")
def test_tables_that_will_be_missing_are_reported_before_and_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    words = [*WORDS, "--effort", "60", "--ladders", "2", "--plain", "10", "--out", str(tmp_path)]
    with monkeypatch.context() as patched:
        for each in (batch_options, folder, rows):
            patched.setattr(each, "available", lambda: False)
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    before, after = done.stderr.splitlines()
    assert before.startswith("there will be no rows.parquet, but flights.journal: Parquet needs")
    assert after.startswith(f"ladders and plain flights in {tmp_path / 'flights'}, no table: ")
    assert after.endswith("then the same command with --resume")
    assert CliRunner().invoke(app, [*words, "--resume"]).exit_code == 0
    assert (tmp_path / "flights/ladders/rows.parquet").exists()


@pytest.mark.usefixtures("halving")
def test_the_result_says_where_it_comes_from(tmp_path: Path) -> None:
    words = [*WORDS, "--effort", "60", "--ladders", "2", "--plain", "10", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    content = json.loads((tmp_path / "rare.json").read_text())
    assert {"numpy", "numba", "llvmlite"} <= content["provenance"]["libraries"].keys()
    manifests = [read_manifest(tmp_path / name) for name in content["manifests"]]
    assert len(manifests) == 3
    for manifest in manifests:
        assert manifest is not None
        for name in ("version", "commit", "source"):
            assert content["provenance"][name] == getattr(manifest, name)
        for name, version in content["provenance"]["libraries"].items():
            assert manifest.runs[0][name] == version


@pytest.mark.usefixtures("halving")
def test_the_chance_in_a_minute_is_that_of_the_time_flown_by_its_length(tmp_path: Path) -> None:
    """Rare losses come as a Poisson process: in half the time half of them."""
    words = [*WORDS, "--effort", "60", "--ladders", "3", "--seconds", "30", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    found = re.search(r"lost within 30 s: (\S+), .* a minute: (\S+);", done.stdout)
    assert found
    assert float(found[2]) == pytest.approx(2.0 * float(found[1]), rel=0.01)


@pytest.mark.usefixtures("halving")
def test_an_earlier_result_is_not_written_over_unasked(tmp_path: Path) -> None:
    words = [*WORDS, "--effort", "100", "--ladders", "2", "--out", str(tmp_path)]
    (tmp_path / "rare.json").write_text("earlier")
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert "--restart overwrites it" in " ".join(refused.stderr.split())
    assert (tmp_path / "rare.json").read_text() == "earlier"
    done = CliRunner().invoke(app, [*words, "--restart"])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "rare.json").read_text() != "earlier"


@pytest.mark.usefixtures("halving")
def test_neighbouring_seeds_share_no_ladder(tmp_path: Path) -> None:
    """Rungs of 300 passed by one in five scatter by 7, so that two are equal one time in 25: all of
    a ladder, for any of 28 pairs, once in thousands of seeds; the seeds are fixed."""
    ladders: list[object] = []
    for seed in ("1", "2"):
        words = [*WORDS, "--effort", "300", "--ladders", "4", "--seed", seed]
        done = CliRunner().invoke(app, [*words, "--out", str(tmp_path / seed)])
        assert done.exit_code == 0, done.output
        content = json.loads((tmp_path / seed / "rare.json").read_text())
        ladders += [[rung["passed"] for rung in rungs] for rungs in content["ladders"]]
    assert all(ladders.count(ladder) == 1 for ladder in ladders)


@pytest.mark.usefixtures("halving")
def test_a_run_that_is_stopped_is_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped at any time, and gone on with, it says what it says when it is never stopped."""
    monkeypatch.setattr(checkpoint, "BATCH", 100)
    words = [*WORDS, "--effort", "60", "--ladders", "9", "--plain", "350"]
    whole = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "whole")])
    assert whole.exit_code == 0, whole.output
    flown = 0
    passage = Halving.passage

    def stopped(self: Halving, state: Fallen, seed: int, level: float) -> Passage:
        nonlocal flown
        flown += 1
        if flown == 700:
            raise KeyboardInterrupt
        return passage(self, state, seed, level)

    monkeypatch.setattr(Halving, "passage", stopped)
    words += ["--out", str(tmp_path / "parts")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 130
    assert "--resume goes on" in " ".join(done.stderr.split())
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert "go on with --resume" in " ".join(refused.stderr.split())
    stops = 1
    while done.exit_code == 130:
        flown = 0
        done = CliRunner().invoke(app, [*words, "--resume"])
        stops += done.exit_code == 130
    assert done.exit_code == 0, done.output
    assert stops >= 2
    ours, theirs = ((tmp_path / name / "rare.json").read_text() for name in ("parts", "whole"))
    assert ours == theirs
    flown = 0
    again = CliRunner().invoke(app, [*words, "--resume"])  # nothing is left to fly
    assert again.exit_code == 0, again.output
    assert flown == 0


@pytest.mark.usefixtures("halving")
def test_what_was_kept_of_other_air_is_not_gone_on_with(tmp_path: Path) -> None:
    words = [*WORDS, "--effort", "60", "--ladders", "2", "--out", str(tmp_path)]
    assert CliRunner().invoke(app, words).exit_code == 0
    for other in (["--turbulence", "0.02"], ["--dispersion"], ["--seed", "2"]):
        refused = CliRunner().invoke(app, [*words, "--resume", *other])
        assert refused.exit_code == 2, refused.output
        assert "of another" in " ".join(refused.stderr.split()), refused.stderr


def gridded(folder: Path, updraft_mps: float) -> Path:
    """A site whose air is a file beside it, as `site init` writes one."""
    folder.mkdir(exist_ok=True)
    x, z = np.linspace(-4.0, 4.0, 9), np.linspace(0.0, 4.0, 5)
    still = np.ones((9, 5))
    falling = updraft_mps - 0.5 * z - 0.1 * x[:, None]
    wind = GridField(x, None, z, 8.5 * still, None, falling, reference_wind_mps=8.5)
    write_npz(folder / "air.npz", wind)
    site = folder / "site.toml"
    site.write_text(
        '[site]\nname = "grid"\n[air]\nkind = "grid"\nfile = "air.npz"\nwind_mps = 8.5\n'
        "[start]\nx_m = 0.0\nz_m = 2.0\n[parameters]\nTGL_X = 0.0\nTGL_Z = 2.0\n"
        "FENCE_X_MIN = -3.5\nFENCE_X_MAX = 3.5\nFENCE_Z_MIN = 0.5\nFENCE_Z_MAX = 3.5\n"
        "FENCE_Y_MAX = 3.0\n",
        encoding="utf-8",
    )
    return site


def test_the_air_is_found_beside_the_site_file(tmp_path: Path) -> None:
    case = rare.case_of(AIRFRAME, gridded(tmp_path / "hill", 2.4), None, 0.02, 1.0)
    process = SoaringProcess(case)
    assert process.prepared.world.field.reference_wind_mps == 8.5


@pytest.mark.usefixtures("halving")
def test_what_was_kept_of_an_air_whose_file_has_changed_is_not_gone_on_with(
    tmp_path: Path,
) -> None:
    site = gridded(tmp_path / "hill", 2.4)
    words = [*WORDS, "--effort", "60", "--ladders", "2", "--site", str(site)]
    words += ["--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, words).exit_code == 0
    gridded(tmp_path / "hill", 2.5)
    refused = CliRunner().invoke(app, [*words, "--resume"])
    assert refused.exit_code == 2, refused.output
    assert "of another" in " ".join(refused.stderr.split()), refused.stderr


@pytest.mark.usefixtures("halving")
def test_a_site_without_air_is_refused(tmp_path: Path) -> None:
    site = tmp_path / "bare.toml"
    site.write_text('[site]\nname = "bare"\n', encoding="utf-8")
    refused = CliRunner().invoke(app, [*WORDS, "--site", str(site), "--out", str(tmp_path)])
    assert refused.exit_code == 2, refused.output
    assert "no [air] table" in refused.stderr


def test_without_numba_it_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rare, "available", lambda: False)
    refused = CliRunner().invoke(app, ["campaign", "rare"])
    assert refused.exit_code == 2
    assert "tgl_soar[fast]" in refused.stderr
