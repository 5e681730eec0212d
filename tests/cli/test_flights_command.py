"""`tgl-soar campaign flights`: flown, stopped, gone on with, and what it writes and prints."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from math import inf, nan
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from tgl_soar.analysis.campaigns import many_flights
from tgl_soar.analysis.campaigns.many_flights import LegFlight, LegJob
from tgl_soar.analysis.experiments.random_aircraft import drawn_mismatch
from tgl_soar.cli import batch_options
from tgl_soar.cli import flights as module
from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.sim.campaign import folder
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS, ROWS_CSV

flown: list[int] = []
stop: dict[str, int] = {}


def fly(job: LegJob) -> LegFlight:
    """It takes no time, and the flight of seed 2 is lost; Ctrl-C may be pressed."""
    if len(flown) == stop.get("after"):
        raise KeyboardInterrupt
    flown.append(job.seed)
    lost = job.seed == 2
    figure = nan if lost else 0.01 * job.seed
    return LegFlight(
        leg=job.leg,
        turbulence=job.turbulence,
        seed=job.seed,
        result="lost" if lost else "soaring",
        reason="hit the board" if lost else "",
        ended_s=1.0 if lost else 60.0,
        settling_s=inf if lost else 1.0,
        rms_e_rho_m=figure,
        peak_e_rho_m=figure,
        rms_along_m=figure,
        rms_y_m=figure,
        rms_bank_rad=figure,
        rms_elevator_rate_per_s=figure,
        mean_x_m=figure,
        mean_z_m=figure,
        off_contour_m=figure,
        off_own_contour_m=figure if job.dispersed else None,
        scored_s=0.0 if lost else 55.0,
        drawn=drawn_mismatch(job.seed) if job.dispersed else None,
    )


Command = Callable[..., Result]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    monkeypatch.setattr(many_flights, "fly_leg", fly)
    monkeypatch.setattr(module, "available", lambda: True)
    flown.clear()
    stop.clear()

    def invoke(*options: str) -> Result:
        words = ["campaign", "flights", "--workers", "0", "--flights", "5", "--legs", "a, b"]
        words += ["--turbulence", "0.01,0.03", "--out", str(tmp_path / "out"), *options]
        return CliRunner().invoke(app, words, env={"COLUMNS": "240"})

    return invoke


def without_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    for each in (batch_options, folder):
        monkeypatch.setattr(each, "available", lambda: False)


def test_a_row_for_each_flight_and_a_table(command: Command, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    done = command("--dispersion", "--param", "rho_p=0.5", "--seed", "1")
    assert done.exit_code == 0, done.output
    assert flown == [1, 2, 3, 4, 5] * 4
    assert "4 of 5" in done.stdout
    assert "28.4 to 99.5 %" in done.stdout  # exact
    assert "20 flights in" in done.stdout
    assert done.stderr == ""
    out = tmp_path / "out"
    rows = parquet.read_table(out / ROWS).to_pylist()
    assert [row["flight"] for row in rows] == list(range(20))
    assert rows[7]["drawn_lift"] == drawn_mismatch(3).lift
    assert not (out / ROWS_CSV).exists()
    page = (out / module.TABLE).read_text(encoding="utf-8")
    assert page.startswith(
        "5 flights of 60 s of each leg in each turbulence: eclipson_c.toml over tunnel.toml,"
        " aircraft and air dispersed, RHO_P = 0.5; seeds 1 to 5.\n"
    )
    assert "| b | 3 % | 4 of 5 | 28.4 to 99.5 % | 1.0, never | 3.50, 5.00 (4 of 5) |" in page
    with (out / module.TABLE_CSV).open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [(row["leg"], row["turbulence"]) for row in table] == [
        ("a", "0.01"), ("a", "0.03"), ("b", "0.01"), ("b", "0.03")
    ]  # fmt: skip
    assert float(table[0]["off_own_contour_m_worst"]) == 0.05
    report = CliRunner().invoke(app, ["campaign", "report", str(out)])
    assert "result, by leg" in report.stdout
    manifest = json.loads((out / MANIFEST).read_text())
    assert (manifest["flights"], manifest["seeds"], manifest["complete"]) == (20, [1, 5], True)


def test_stopped_and_gone_on_with_it_flies_every_flight_once(
    command: Command, tmp_path: Path
) -> None:
    assert "no flights of an earlier run are in" in command("--resume").stderr
    stop["after"] = 7
    stopped = command()
    assert stopped.exit_code == 130
    assert "7 of 20 flights are kept; --resume goes on" in stopped.stderr
    assert not (tmp_path / "out" / module.TABLE).exists()
    stop.clear()
    refused = command()
    assert refused.exit_code == 2
    assert "--resume" in refused.stderr
    assert command("--resume", "--seconds", "30").exit_code == 2  # another campaign
    assert command("--resume").exit_code == 0
    assert flown == [1, 2, 3, 4, 5] * 4


def test_without_pyarrow_there_are_rows_as_csv_and_this_is_reported_beforehand(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        without_pyarrow(patched)
        stop["after"] = 0
        early = command()
        assert flown == []
        assert (
            "there will be no rows.parquet, but rows.csv: Parquet needs pyarrow: pip install"
            " 'tgl_soar[parquet]'"
        ) in early.stderr
        stop.clear()
        done = command("--resume")
        assert done.exit_code == 0, done.output
        assert "'tgl_soar[parquet]', then the same command with --resume" in done.stdout
    with (out / ROWS_CSV).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["seed"]) for row in rows] == [1, 2, 3, 4, 5] * 4
    assert [rows[0]["rms_e_rho_m"], rows[1]["rms_e_rho_m"], rows[1]["settling_s"]] == [
        "0.01", "nan", "inf"
    ]  # fmt: skip
    assert rows[0]["drawn_lift"] == ""
    assert (out / JOURNAL).exists()
    flown.clear()
    assert command("--resume").exit_code == 0
    assert flown == []  # the table is of the flights that are kept
    assert (out / ROWS).exists()
    assert not (out / JOURNAL).exists()


@pytest.mark.parametrize(("words", "reported"), [
    (("--legs", "z"), "--legs z: no line of"),
    (("--turbulence", "3"), "--turbulence 3: must be fractions of the wind, 0 to 0.5"),
    (("--turbulence", "nan"), "--turbulence nan: must be"),
    (("--turbulence", ""), "--turbulence : must be"),
    (("--param", "RHO_P"), "--param RHO_P: must be NAME=VALUE"),
    (("--param", "RHO_PP=1"), "RHO_PP"),
    (("--site", "nowhere.toml"), "nowhere.toml"),
    (("--airframe", "{bare}"), "[model]: missing, and nothing is simulated without"),
])  # fmt: skip
def test_what_cannot_be_flown_is_refused_before_anything_is_written(
    words: tuple[str, ...], reported: str, command: Command, tmp_path: Path
) -> None:
    text = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
    before, _, after = text.partition("\n[model]\n")
    bare = tmp_path / "bare.toml"
    bare.write_text(before + after[after.index("\n[autopilot]") :], encoding="utf-8")
    refused = command(*(str(bare) if word == "{bare}" else word for word in words))
    assert refused.exit_code == 2, refused.output
    assert reported in refused.stderr
    assert flown == []
    assert not (tmp_path / "out").exists()


def test_without_numba_the_way_to_it_is_named(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "available", lambda: False)
    refused = command()
    assert refused.exit_code == 2
    assert "needs numba: pip install 'tgl_soar[fast]'" in refused.stderr
