"""`tgl-soar campaign faults`: flown, stopped, gone on with, and where its rows are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.table import Table
from typer.testing import CliRunner, Result

from tgl_soar.analysis.campaigns import drawn_faults
from tgl_soar.analysis.campaigns.drawn_faults import FaultJob, Outcome
from tgl_soar.cli import batch_options
from tgl_soar.cli.app import app
from tgl_soar.cli.batch_options import FlightLines, duration
from tgl_soar.cli.console import show
from tgl_soar.sim.campaign import folder
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS

flown: list[int] = []
stop: dict[str, int] = {}


def fly(job: FaultJob) -> Outcome:
    """It takes no time, and one flight is lost; Ctrl-C may be pressed."""
    if len(flown) == stop.get("after"):
        raise KeyboardInterrupt
    flown.append(job.seed)
    return Outcome(
        row=job.row,
        seed=job.seed,
        faults="; ".join(map(str, job.faults)),
        result=drawn_faults.LOST if job.seed == 5 else drawn_faults.SOARING,
        reason="hit the board" if job.seed == 5 else "",
        ended_s=30.0,
        bad_commands=0,
        error="",
    )


Command = Callable[..., Result]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    monkeypatch.setattr(drawn_faults, "fly_fault_job", fly)
    flown.clear()
    stop.clear()

    def invoke(*options: str) -> Result:
        words = ["campaign", "faults", "--workers", "0", "--flights", "40", "--dropouts", "2"]
        return CliRunner().invoke(app, [*words, "--out", str(tmp_path / "out"), *options])

    return invoke


def test_nothing_is_resumed_where_nothing_was_flown(command: Command, tmp_path: Path) -> None:
    refused = command("--resume")
    assert refused.exit_code == 2
    assert f"no flights of an earlier run are in {tmp_path / 'out'}" in refused.stderr
    assert flown == []


def test_progress_is_reported_to_a_pipe_every_half_minute(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = [100.0]
    lines = FlightLines("faults", clock=lambda: now[0])
    for seconds, done in ((0.0, 1), (29.9, 50), (30.0, 60), (59.0, 90), (60.1, 120)):
        now[0] = 100.0 + seconds
        lines.show(done, 1000, 2.0, 0.5 * (1000 - done))
    reported = capsys.readouterr().err.splitlines()
    assert reported == [
        "faults: 60 of 1000 flights, 2 a second, 8 min left",
        "faults: 120 of 1000 flights, 2 a second, 7 min left",
    ]


def test_no_name_is_cut_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    cells = [f"{'a_long_name_of_a_fault.' * 2}{i}" for i in range(4)]
    table = Table(*cells)
    table.add_row(*cells)
    show(table)
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert all(shown.count(cell) == 2 for cell in cells)


def test_stopped_and_gone_on_with_it_flies_every_flight_once(
    command: Command, tmp_path: Path
) -> None:
    stop["after"] = 17
    stopped = command()
    assert stopped.exit_code == 130
    assert "17 of 48 flights are kept; --resume goes on" in stopped.stderr
    stop.clear()
    refused = command()
    assert refused.exit_code == 2
    assert "--resume" in refused.stderr
    done = command("--resume")
    assert done.exit_code == 1  # one was lost
    assert "48 flights" in done.stdout
    assert "first: Outcome(row=" in done.stderr
    assert len(flown) == 48
    manifest = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert (manifest["flights"], manifest["seeds"], manifest["complete"]) == (48, [1, 40], True)
    assert manifest["parameters"]["flights"] == 40
    assert [run["from"] for run in manifest["runs"]] == [0, 17]


def test_a_page_that_cannot_be_written_is_reported_before_anything_is_flown(
    command: Command, tmp_path: Path
) -> None:
    """Not after hours, by a traceback."""
    page = tmp_path / "safety.md"
    for text in ("", drawn_faults.MARKS[0], drawn_faults.DISPERSED_MARKS[0]):
        page.write_text(text)
        refused = command("--docs", str(tmp_path))
        assert refused.exit_code == 2, refused.output
        assert str(page) in refused.stderr
        assert drawn_faults.MARKS[1] in refused.stderr
    assert not flown
    assert not (tmp_path / "out").exists()


def test_a_timeline_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    words = ["campaign", "timeline", "--out", str(tmp_path / "file" / "deeper" / "figure.png")]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2, refused.output
    assert "Not a directory" in refused.stderr


def test_every_flight_is_a_row(command: Command, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    command()
    rows = parquet.read_table(tmp_path / "out" / ROWS).to_pylist()
    assert [row["flight"] for row in rows] == list(range(48))
    assert [row["seed"] for row in rows[:40]] == list(range(1, 41))
    assert [row["result"] for row in rows].count("lost") == 1
    assert {"turbulence", "aboard", "model"} <= set(rows[0])  # of the job
    assert not (tmp_path / "out" / JOURNAL).exists()


def test_a_table_that_will_be_missing_is_reported_before_the_first_flight(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    with monkeypatch.context() as patched:
        for each in (batch_options, folder):
            patched.setattr(each, "available", lambda: False)
        stop["after"] = 0
        early = command()
        assert flown == []
        assert (
            "there will be no rows.parquet, but flights.journal: Parquet needs pyarrow: pip"
            " install 'tgl_soar[parquet]'"
        ) in early.stderr
        stop.clear()
        done = command("--resume")
        assert "'tgl_soar[parquet]', then the same command with --resume" in done.stdout
    before = len(flown)
    assert command("--resume").exit_code == 1  # one was lost
    assert len(flown) == before == 48
    assert (tmp_path / "out" / ROWS).exists()


def test_a_cluster_that_is_not_there_is_reported(command: Command) -> None:
    pytest.importorskip("distributed")
    refused = command("--scheduler", "nonsense://nowhere")
    assert refused.exit_code == 2
    assert "nonsense://nowhere: a scheduler is tcp://HOST:PORT" in refused.stderr
    assert "nothing has been flown" in refused.stderr


def test_a_cluster_that_is_not_there_costs_no_flights(command: Command, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    pytest.importorskip("pyarrow")
    command()
    before = (tmp_path / "out" / ROWS).read_bytes()
    refused = command("--restart", "--scheduler", "nonsense://nowhere")
    assert refused.exit_code == 2
    assert (tmp_path / "out" / ROWS).read_bytes() == before
    again = command()
    assert again.exit_code == 2
    assert "a finished campaign's flights are there" in again.stderr


def test_a_drop_out_that_is_lost_is_trouble_like_any_flight() -> None:
    name = drawn_faults.FaultJobs(0, 1, 1)[0].row
    of = drawn_faults.Outcome(
        row=name, seed=1, faults="", result=drawn_faults.LOST, reason="hit the board", ended_s=1.0,
        bad_commands=2, error="ValueError",
    )  # fmt: skip
    counted = drawn_faults.count([of])
    assert (counted.bad_commands, counted.raised, counted.troubles) == (2, 1, [of])
    assert counted.survivals[0].survived == 0


@pytest.mark.parametrize(
    ("seconds", "words"), [(42.3, "42 s"), (89.6, "90 s"), (180.0, "3 min"), (4800.0, "1 h 20 min")]
)
def test_time_left_is_in_the_words_of_a_person(seconds: float, words: str) -> None:
    assert duration(seconds) == words
