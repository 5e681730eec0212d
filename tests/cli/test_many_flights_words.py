"""Commands that fly many flights, without a flight: tables, exit codes, folders, refusals."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.analysis.campaigns.drawn_faults import Counted, FaultRow, Survival, wilson
from tgl_soar.analysis.campaigns.long_flight import LongFlight, Part
from tgl_soar.analysis.campaigns.report import (
    FlightGroup,
    Proportion,
    Report,
    TwoCampaigns,
    TwoProportions,
)
from tgl_soar.analysis.experiments.catalogue import EXPERIMENTS, RIGID_BODY_ALONE, TITLES, TOGETHER
from tgl_soar.analysis.experiments.result import Claim, Result
from tgl_soar.cli import batch_options, campaign, experiment
from tgl_soar.cli.app import app
from tgl_soar.cli.batch_options import (
    COMPILES,
    FlightBar,
    FlightLines,
    duration,
    files_of,
    flight_bar,
    pace_words,
    page_to_write,
    to_resume,
)
from tgl_soar.cli.console import AIRFRAME, SITE, FlightModel
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST
from tgl_soar.sim.campaign.run import fly_all

Out = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (campaign, experiment):
        monkeypatch.setattr(module, "console", Console(width=200))


def rows(output: str) -> list[list[str]]:
    found = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    return [row for row in found if row]


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "200"})
    return done.exit_code, done.output


# --- what all of them share --------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "words"), [
    (0.4, "0 s"), (89.9, "90 s"), (90.0, "2 min"), (150.0, "2 min"), (3569.0, "59 min"),
    (3571.0, "1 h 0 min"), (4800.0, "1 h 20 min"), (7200.0, "2 h 0 min"), (90_000.0, "25 h 0 min"),
])  # fmt: skip
def test_time_left_is_in_the_words_of_a_person_who_waits(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_a_pace_that_is_not_known_is_not_reported(capsys: Out) -> None:
    assert pace_words(2.0, 42.0) == "2 a second, 42 s left"
    assert pace_words(2.0, float("inf")) == ""
    now = [0.0]
    lines = FlightLines("faults", clock=lambda: now[0])
    lines.title("another")
    now[0] = 30.0
    lines.show(1, 10, 0.5, float("inf"))
    now[0] = 59.9
    lines.show(2, 10, 0.5, 16.0)
    assert capsys.readouterr().err == "another: 1 of 10 flights\n"
    assert lines.still() == ""  # a moment ago
    now[0] = 60.1
    assert lines.still() == "another: 2 of 10 flights"  # no pace: it may be an hour's
    lines.title("a third")
    now[0] = 90.2
    assert lines.still() == "a third: no flight yet"
    lines.show(0, 10, 0.0, float("inf"))
    now[0] = 120.3
    assert lines.still() == f"a third: 0 of 10 flights; {COMPILES}"


class Slow(NamedTuple):
    """A flight that takes as long as compiling one."""

    seconds: float


def take_long(job: Slow) -> float:
    time.sleep(job.seconds)
    return job.seconds


def test_while_a_first_flight_is_waited_for_the_reason_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    monkeypatch.setattr(batch_options, "LINE_S", 0.02)
    with flight_bar("rare") as bar:
        fly_all(take_long, [Slow(0.3)], InLine(), on_progress=lambda shown: bar.show(*shown))
    lines = capsys.readouterr().err.splitlines()
    assert lines.count(f"rare: 0 of 1 flights; {COMPILES}") > 2
    time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_a_pipe_that_nobody_reads_takes_no_other_output_with_it() -> None:
    program = (
        "import time; from tgl_soar.cli import batch_options as b; b.LINE_S = 0.02\n"
        "with b.flight_bar('rare'): time.sleep(0.3)\n"
        "print('done')"
    )
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=write, timeout=60, check=True)
    os.close(write)
    assert done.stdout == b"done\n"


def test_a_terminal_has_a_bar_and_a_pipe_has_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    updates: list[tuple[Any, dict[str, Any]]] = []
    progress: Any = SimpleNamespace(update=lambda task, **what: updates.append((task, what)))
    bar = FlightBar(progress, 7)  # type: ignore[arg-type]
    bar.title("faults")
    bar.show(3, 10, 2.0, 3.5)
    assert updates == [
        (7, {"description": "faults"}),
        (7, {"completed": 3, "total": 10, "pace": "2 a second, 4 s left"}),
    ]
    with flight_bar("x") as lines:
        assert isinstance(lines, FlightLines)
    monkeypatch.setattr(batch_options, "errors", Console(stderr=True, force_terminal=True))
    with flight_bar("x") as shown:
        assert isinstance(shown, FlightBar)


@pytest.mark.parametrize("name", [JOURNAL, MANIFEST, None])
def test_flights_are_gone_on_with_where_there_are_some(name: str | None, tmp_path: Path) -> None:
    assert to_resume(tmp_path, False) == tmp_path
    if name is None:
        with pytest.raises(typer.Exit) as ended:
            to_resume(tmp_path, True)
        assert ended.value.exit_code == 2
        return
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / name).touch()
    assert to_resume(tmp_path, True) == tmp_path


def test_a_line_of_the_site_is_its_parameters(capsys: Out) -> None:
    own = files_of(AIRFRAME, SITE, None)[2]
    assert [own["TGL_X"], own["TGL_Z"]] == pytest.approx([0.2, 1.15])
    b = files_of(AIRFRAME, SITE, "b")[2]
    assert [b["TGL_X"], b["TGL_Z"]] == pytest.approx([0.6, 1.6])
    with pytest.raises(typer.Exit):
        files_of(AIRFRAME, SITE, "z")
    assert f"--line z: no line of {SITE}; it has a, b, c" in capsys.readouterr().err


def test_a_page_is_written_between_its_marks(tmp_path: Path, capsys: Out) -> None:
    with pytest.raises(typer.Exit):
        page_to_write(tmp_path, "p.md", ("<a>", "<b>"))
    assert f"--docs {tmp_path}: there is no {tmp_path / 'p.md'}" in capsys.readouterr().err
    (tmp_path / "p.md").write_text("no marks", encoding="utf-8")
    with pytest.raises(typer.Exit):
        page_to_write(tmp_path, "p.md", ("<a>", "<b>"))
    (tmp_path / "p.md").write_text("x <a> y <b> z", encoding="utf-8")
    assert page_to_write(tmp_path, "p.md", ("<a>", "<b>")) == tmp_path / "p.md"


def test_a_folder_that_is_flown_again_says_what_was_damaged(tmp_path: Path, capsys: Out) -> None:
    def stopped(*_given: Any, **_named: Any) -> None:
        raise KeyboardInterrupt

    asked: list[Any] = []
    folder: Any = SimpleNamespace(
        damaged=12, path=tmp_path, flown=3,
        campaign=SimpleNamespace(name="faults", jobs=[1, 2, 3, 4]),
        fly=lambda *_given, **named: asked.append(named),
    )  # fmt: skip
    batch_options.fly_folder(folder, None, first_here=True)  # type: ignore[arg-type]
    assert f"{tmp_path / JOURNAL}: 12 bytes were damaged" in capsys.readouterr().err
    assert asked == [{"first_here": True}]
    folder.damaged, folder.fly = 0, stopped
    with pytest.raises(typer.Exit) as ended:
        batch_options.fly_folder(folder, None)  # type: ignore[arg-type]
    assert ended.value.exit_code == 130
    output = capsys.readouterr().err
    assert "stopped: 3 of 4 flights are kept; --resume goes on" in output
    assert "damaged" not in output


# --- faults ------------------------------------------------------------------------------------


def counted(troubles: list[Any] | None = None) -> Counted:
    results = Counter({"soaring": 8, "released": 2})
    return Counted(
        rows=[FaultRow("position.dropout", 10, results, Counter({"late": 1, "low": 2}))],
        survivals=[Survival(fault="f", turbulence=0.05, aboard="imu", flights=200, survived=190)],
        results=results,
        bad_commands=0,
        raised=0,
        troubles=troubles or [],
    )


def test_what_became_of_the_flights_of_each_fault(capsys: Out) -> None:
    campaign._print(counted())
    output = capsys.readouterr().out
    assert rows(output) == [["position.dropout", "10", "8", "·", "2", "·", "low (2), late (1)"]]
    low, high = wilson(190, 200)
    words = " ".join(output.split())
    assert "f at 5 %, imu: 190 of 200 survived," in words
    assert f"{100 * low:.1f} to {100 * high:.1f} % at 95 %" in words


class Flown:
    """A campaign's folder of which nothing is flown."""

    tabulated = True
    asked: Any = None

    def __init__(self, out: Path, of: Any, **more: Any) -> None:
        Flown.asked = out, of, more

    def __enter__(self) -> Flown:
        return self

    def __exit__(self, *_given: Any) -> None: ...

    def finish(self) -> bool:
        return Flown.tabulated


@pytest.mark.parametrize(("troubles", "code"), [([], 0), (["one", "two"], 1)])
def test_a_flight_that_was_lost_is_an_exit_code(
    troubles: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "CampaignFolder", Flown)
    monkeypatch.setattr(campaign, "fly_folder", lambda *_given, **_named: None)
    monkeypatch.setattr(
        "tgl_soar.analysis.campaigns.drawn_faults.count", lambda _folder: counted(troubles)
    )
    found, output = run("campaign", "faults", "--flights", 5, "--dropouts", 0, "--out", tmp_path)
    assert found == code
    assert "5 flights in 0 s; every one of them in" in output
    assert Flown.asked[2] == {"resume": False, "restart": False}
    if code:
        assert "2 flights were lost, or had bad commands; first: one" in output


@pytest.mark.parametrize(("words", "reported"), [
    (("--dispersion", "--model", "point-mass"), "--dispersion needs the rigid body"),
    (("--docs", "nowhere"), "--docs nowhere: there is no nowhere/safety.md"),
    (("--resume", "--out", "nowhere"), "--resume: no flights of an earlier run are in nowhere"),
])  # fmt: skip
def test_faults_that_cannot_be_flown_are_refused(
    words: tuple[str, ...], reported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "fly_folder", lambda *_given, **_named: pytest.fail("flown"))
    code, output = run("campaign", "faults", *words)
    assert (code, reported in output) == (2, True), output


# --- a report ----------------------------------------------------------------------------------


def test_classes_are_counted_and_numbers_averaged(capsys: Out) -> None:
    groups = [
        FlightGroup("low", Counter({"soaring": 3, "lost": 1})),
        FlightGroup("high", Counter({"lost": 2})),
    ]  # fmt: skip
    campaign._print_report(Report("row", "result", groups))
    output = capsys.readouterr().out
    low, high = wilson(3, 4)
    found = rows(output)
    order = [name for name, _ in Counter({"soaring": 3, "lost": 3}).most_common()]
    assert order == ["soaring", "lost"]
    assert found[0] == ["low", "4", "3", "1", f"{100 * low:.3g} to {100 * high:.3g} %"]
    assert found[1][:4] == ["high", "2", "·", "2"]
    assert "result, by row" in output
    numbers = FlightGroup("all", numbers=[1.0, 2.0, 3.0, float("nan")])
    campaign._print_report(Report("", "alpha", [numbers]))
    output = capsys.readouterr().out
    assert rows(output) == [["all", "4", "1", "2", "0.8165", "1.1", "2", "2.9"]]
    assert "alpha, by nothing" in output


def test_two_campaigns_stand_side_by_side(capsys: Out) -> None:
    pairs = [
        TwoProportions("low", (Proportion(90, 100), Proportion(10, 100))),
        TwoProportions("high", (Proportion(5, 10), Proportion(5, 10))),
    ]
    two = TwoCampaigns(by="", of="result", counted="soaring", rows=pairs, alone=(["x", "y"], []))
    campaign._print_two(two, Path("one"), Path("two"))
    output = capsys.readouterr().out
    low, high = wilson(90, 100)
    found = rows(output)
    assert found[0][:3] == ["low", "90 of 100", f"{100 * low:.3g} to {100 * high:.3g} %"]
    assert [row[5] for row in found] == ["apart", ""]
    assert "result soaring, by nothing" in output
    assert "in one alone: x, y" in output
    assert "in two alone" not in output


def test_a_campaign_is_named_by_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "rows.parquet").touch()
    assert campaign._folder(folder) == campaign._folder(folder / "rows.parquet") == "mine"


# --- hours -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ended", "code"), [("", 0), ("it fell", 1)])
def test_hours_are_reported_part_by_part(
    ended: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def fly(duration_s: float, *, seed: int, on_part: Any, model: Any) -> LongFlight:
        asked.append((duration_s, seed, model))
        parts = [
            Part(flown_s=part * 1800.0, resident_kib=1024 * part, tick_us=61.4, late_s=0.5,
                 largest_e_rho_m=0.123)
            for part in (1, 3)
        ]  # fmt: skip
        for part in parts:
            on_part(part)
        flight = LongFlight(duration_s, ticks=1_000_000, expected_ticks=1_000_000, reboots=1,
                            stale=2, lost=3, ended=ended, wrapped=True, parts=parts)  # fmt: skip
        monkeypatch.setattr(LongFlight, "is_well", not ended)
        return flight

    monkeypatch.setattr(campaign, "fly_long", fly)
    found, output = run("campaign", "long", "--hours", "1.5", "--seed", "4")
    assert found == code
    assert asked == [(5400.0, 4, None)]
    assert rows(output) == [
        ["0.500 h", "1.0 MiB", "61 µs", "0.5 s", "12.3 cm"],
        ["1.500 h", "3.0 MiB", "61 µs", "0.5 s", "12.3 cm"],
    ]
    assert "1,000,000 ticks of 1,000,000; 1 restarts seen, 2 stale and 3 lost frames" in output
    assert "2048 KiB more memory" in output
    assert ("ended early: it fell" in output) == bool(code)


# --- experiments -------------------------------------------------------------------------------


def result(name: str = "wind", **more: Any) -> Result:
    fields: dict[str, Any] = {
        "title": "a title", "flown": "flown [so]", "claims": (Claim("it does", True, "1 cm"),),
        "why": "", "tables": (), "numbers": {"n": 1.5}, **more,
    }  # fmt: skip
    return Result(name=name, **fields)


def test_all_are_listed_with_their_titles() -> None:
    code, output = run("experiment", "list")
    assert code == 0
    assert run("experiment")[1] == output
    for name, title in TITLES.items():
        assert any(
            line.split()[:1] == [name] and title[:30] in line for line in output.splitlines()
        ), name


@pytest.mark.parametrize("verdict", [
    "agrees", "agrees in part", "differs", "undecided", "by construction", "met", "met in part",
    "missed",
])  # fmt: skip
def test_every_verdict_has_a_colour(verdict: str) -> None:
    assert experiment.COLOURS[verdict]


def test_numbers_are_written_and_what_flew_otherwise_is_printed_too(
    tmp_path: Path, capsys: Out
) -> None:
    also = result("wind", title="of a point mass", badly=("seed 3: it fell",))
    experiment._put_out("wind", result(also={"point mass": also}), tmp_path)
    written = json.loads((tmp_path / "wind.json").read_text(encoding="utf-8"))
    assert written["numbers"] == {"n": 1.5}
    output = capsys.readouterr().out
    assert output.index("a title") < output.index("of a point mass")
    assert "flown [so]" in output
    assert "  - seed 3: it fell" in output
    with pytest.raises(typer.Exit):
        experiment._put_out("wind", result(), tmp_path / "no" / "such")
    assert "wind.json: cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "model", "words"), [
    ("wind", None, ""), ("paper", None, ""), ("all", "point-mass", "about the rigid body alone"),
    ("aims", None, "not flown: search, throttle"), ("all", "rigid-body", "not flown: search, thr"),
])  # fmt: skip
def test_a_name_of_several_means_all_that_the_model_can_fly(
    name: str, model: str | None, words: str, capsys: Out
) -> None:
    chosen = None if model is None else FlightModel(model)
    found = experiment._named(name, chosen)
    expected = list(TOGETHER.get(name, (name,)))
    if model == "point-mass":
        expected = [each for each in expected if each not in RIGID_BODY_ALONE]
        assert len(expected) < len(TOGETHER[name])
    assert found == expected
    output = capsys.readouterr().err
    assert (words in output) if words else output == ""


def test_an_experiment_that_is_none_is_named_beside_those_that_are() -> None:
    code, output = run("experiment", "windd")
    assert code == 2
    assert (
        f"no experiment named 'windd'; there are {', '.join((*EXPERIMENTS, *TOGETHER))}" in output
    )


def test_figures_are_named_or_the_way_to_them(capsys: Out) -> None:
    experiment._print_figures(Path("there"))
    experiment._print_figures(None)
    out, err = capsys.readouterr()
    assert out == "figures in there/\n"
    assert "no figures: they need matplotlib: pip install 'tgl_soar[figures]'" in err
    assert experiment.FLIGHTS == "flights"


def test_flights_in_another_air_are_kept_apart(tmp_path: Path, capsys: Out) -> None:
    own = experiment._folder(tmp_path / "new", None, resume=False, restart=False)
    other = experiment._folder(tmp_path / "new", SITE, resume=False, restart=False)
    assert (tmp_path / "new").is_dir()
    assert own is not other
    with pytest.raises(typer.Exit):
        experiment._folder(tmp_path, tmp_path / "none.toml", resume=False, restart=False)
    (tmp_path / "file").touch()
    with pytest.raises(typer.Exit):
        experiment._folder(tmp_path / "file", None, resume=False, restart=False)
    assert "cannot be written: File exists; name another folder" in capsys.readouterr().err
    own.close()
    other.close()


def test_an_experiments_missing_tables_are_reported_before_and_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    flyer: Any = SimpleNamespace(flown=7, simulated_s=140.0)
    experiment._folder(tmp_path, None, resume=False, restart=False).close()
    experiment._print_flown(flyer, 3.0, tmp_path, True)
    assert capsys.readouterr() == (
        f"7 flights, 140 s of flight, in 3 s; numbers in {tmp_path}/\n",
        "",
    )
    monkeypatch.setattr(batch_options, "available", lambda: False)
    experiment._folder(tmp_path, None, resume=False, restart=False).close()
    assert "there will be no rows.parquet, but flights.journal: " in capsys.readouterr().err
    experiment._print_flown(flyer, 3.0, tmp_path, False)
    words = (
        "no table: Parquet needs pyarrow: pip install 'tgl_soar[parquet]', then the same command"
    )
    assert f"flights in {tmp_path / 'flights'}, {words} with --resume" in capsys.readouterr().err


def test_several_are_summed_up_with_the_time_each_took(capsys: Out) -> None:
    experiment._print_summary([result("a", seconds=12.4), result("b", own=True, seconds=3.0)])
    assert rows(capsys.readouterr().out) == [
        ["a", "agrees: 1 of 1", "12 s"], ["b", "met: 1 of 1", "3 s"]
    ]  # fmt: skip
