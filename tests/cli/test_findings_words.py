"""What commands print of what was found: gains, models, loops, chances of a loss, layouts."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.analysis.loop_response import TONES_RADPS
from tgl_soar.analysis.rare.kramers import WellExit
from tgl_soar.analysis.rare.splitting import RareEstimate
from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.tune import FlownRow, Judged
from tgl_soar.cli import identify, log, log_layouts, rare, tune
from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.control.supervisor_texts import REASON_TEXTS

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
NAN = float("nan")
Out = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (identify, log, rare, tune):
        monkeypatch.setattr(module, "console", Console(width=200))


def rows(output: str) -> list[list[str]]:
    found = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    return [row for row in found if row]


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "200"})
    return done.exit_code, done.output


# --- gains -------------------------------------------------------------------------------------


def tuned() -> Any:
    before = Given(alpha=0.412, e_rho_m=0.0512, elevator=0.1234, worst="here")
    after = Given(alpha=0.556, e_rho_m=0.0312, elevator=0.2345, worst="there")
    return SimpleNamespace(
        before={"fixes": before},
        after={"fixes": after},
        judged_before={"fixes": Judged(50, 3, 7, 0.123)},
        judged={"fixes": Judged(50, 0, 2, 0.456)},
        flown=[
            FlownRow(
                "fixes", 0.03,
                before=SimpleNamespace(up=8, of=10, rms_e_rho_m=0.0456),  # type: ignore[arg-type]
                after=SimpleNamespace(up=9, of=10, rms_e_rho_m=0.0345),  # type: ignore[arg-type]
            )
        ],
    )  # fmt: skip


def test_gains_stand_beside_those_before(capsys: Out) -> None:
    tune._print(tuned())
    output = capsys.readouterr().out
    found = [line.split() for line in output.splitlines() if line.strip().startswith("fixes  ")]
    assert found == [
        ["fixes", "before", "0.41", "5.12", "cm", "0.123", "0.12", "7", "of", "50", "3"],
        ["fixes", "after", "0.56", "3.12", "cm", "0.234", "0.46", "2", "of", "50", "0"],
    ]
    assert "fixes at 3 %: up 9 of 10, before 8; e_rho 3.45 cm, before 4.56 cm" in output


def test_a_task_is_what_the_options_ask_for() -> None:
    pytest.importorskip("cma", reason="tuning needs cma")
    from tgl_soar.analysis.tuning.tune import QUICK, Effort

    usual = tune._task(AIRFRAME, SITE, None, None, (False, None))
    assert usual.effort == Effort()
    assert usual.lean_deg == usual.values["RHO_LEAN"]
    assert usual.site_path == SITE
    assert tune._task(AIRFRAME, SITE, None, None, (True, None)).effort == QUICK
    assert tune._task(AIRFRAME, SITE, None, 20.0, (False, None)).lean_deg == 20.0
    few = tune._task(AIRFRAME, SITE, "b", None, (False, 3))
    assert (few.effort.judging, few.effort.choosing) == (3, min(3, Effort().choosing))
    assert few.values["TGL_Z"] == pytest.approx(1.6)
    none = tune._task(AIRFRAME, SITE, None, None, (False, 0)).effort
    assert (none.judging, none.choosing) == (0, 0)
    assert tune._task(AIRFRAME, SITE, None, None, (False, 10**6)).effort.choosing == (
        Effort().choosing
    )


# --- a model -----------------------------------------------------------------------------------


def estimate(name: str, value: float, unit: str = "") -> Any:
    return SimpleNamespace(
        name=name, value=value, unit=unit, low=0.5 * value, high=2.0 * value, half_band=0.25
    )


@pytest.mark.parametrize(("explained", "words"), [
    (0.912, "the model explains 91.2% of the manoeuvres held out"), (NAN, ""),
])  # fmt: skip
@pytest.mark.parametrize("brake", [0.0, 0.3])
def test_what_was_identified_stands_beside_the_file(
    explained: float, words: str, brake: float, capsys: Out
) -> None:
    found: Any = SimpleNamespace(
        manoeuvres=[1, 2, 3, 4], held_out=[5, 6], airspeed_mps=8.567, explained=explained,
        frequency=estimate("frequency", 11.5, "rad/s"), damping=estimate("damping", 0.75),
        effectiveness=estimate("effectiveness", 31.0), response_delay=estimate("response", 0.03),
        derivatives=[estimate("Cm_q", -8.0)], no_brake="it was not moved",
    )  # fmt: skip
    gliding: Any = SimpleNamespace(written={"CD0": estimate("CD0", 0.5)}, words="by six glides")
    identify._print(found, gliding, {"Cm_q": -7.5, "CD0": 0.0563, "CL_brake": brake})
    output = capsys.readouterr().out
    assert "4 manoeuvres fitted, 2 held out; at 8.57 m/s" in output
    lines = [" ".join(line.split()) for line in output.splitlines()]
    assert "short period, undamped 11.5 rad/s 5.75 … 23" in lines
    assert "short period, damping 0.75 0.375 … 1.5" in lines
    assert "pitch acceleration of full elevator 31 15.5 … 62" in lines
    assert "servo: delay and lag together 0.03 0.015 … 0.06" in lines
    assert "CD0 0.5 0.25 … 0.75 0.0563" in lines
    assert "by six glides" in output
    assert ("brake: it was not moved" in output) == bool(brake)
    assert (words in output) if words else "explains" not in output
    assert identify.EXPLAINED_MIN == 0.8
    assert identify.WORDS["delay"] == "servo: delay alone"


# --- loops -------------------------------------------------------------------------------------


def test_the_open_loop_at_each_tone(capsys: Out, monkeypatch: pytest.MonkeyPatch) -> None:
    count = len(TONES_RADPS)
    loop = np.array([2.0j] * count)  # 6.02 dB, 90 degrees
    radius = np.array([0.5, NAN, *[1.0] * (count - 2)])
    response: Any = SimpleNamespace(
        at="elevator", periods=4, open_loop=loop, coherence=np.full(count, 0.987)
    )
    monkeypatch.setattr(
        "tgl_soar.analysis.loop_response.open_loop_discs", lambda _response: (loop, radius)
    )
    Console(width=200).print(log._tones_of(response))
    output = capsys.readouterr().out
    assert "broken at the elevator, 4 periods of 5 s" in output
    found = rows(output)
    assert len(found) == count
    tones = TONES_RADPS.tolist()
    assert found[0] == [f"{tones[0]:.2f}", "6.0", "90", "25 %", "0.99"]
    assert found[1][3] == "unknown"
    assert found[-1] == [f"{tones[-1]:.2f}", "6.0", "90", "50 %", "0.99"]


@pytest.mark.parametrize(("words", "reported"), [
    (("log", "info", "a.tlog"), "a.tlog: a .tlog holds frames, no topics"),
    (("log", "info", "none.ulg"), "none.ulg"),
    (("log", "export", "a.ulg", "--to", "xls"), "--to xls: must be csv, netcdf, mcap"),
])  # fmt: skip
def test_what_is_no_log_or_no_format_is_refused(words: tuple[str, ...], reported: str) -> None:
    code, output = run(*words)
    assert (code, reported in output) == (2, True), output


@pytest.mark.parametrize("losses", [[], ["12 bytes"]])
def test_a_log_is_reported_topic_by_topic(
    losses: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(bytes(2_500_000))
    made = SimpleNamespace(
        losses=losses, info={"b": "2", "a": "1 [x]"}, duration_s=10.0, changes=[1, 2],
        topics={"tick": {"timestamp": [0] * 2000}, "slow": {"timestamp": [0] * 15}},
        words=[SimpleNamespace(time_s=1.23456, text="ready [x]")],
    )  # fmt: skip
    monkeypatch.setattr(log, "read_log", lambda _path: made)
    code, output = run("log", "info", path)
    assert code == bool(losses)
    assert output.index("a: 1 [x]") < output.index("b: 2")
    assert "10.0 s, 2.50 MB, 2 changes" in output
    assert rows(output) == [["tick", "2000", "200.0 Hz"], ["slow", "15", "1.5 Hz"]]
    assert "     1.235 s  ready [x]" in output
    assert ("a.ulg: 12 bytes" in output) == bool(losses)
    made.duration_s = 0.0
    assert rows(run("log", "info", path)[1])[0] == ["tick", "2000", "–"]
    made.topics = {"tick": {"timestamp": []}}
    code, output = run("log", "info", path)
    assert (code, "no row of any topic is in it" in output) == (2, True)


def test_modes_and_reasons_are_listed_by_number_in_lines_that_can_be_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "a.ulg"
    path.touch()
    made = SimpleNamespace(
        losses=[], info={"modes": "boot;standby", "reasons": ";".join(REASON_TEXTS)},
        duration_s=0.0, changes=[], topics={"tick": {"timestamp": [0]}}, words=[],
    )  # fmt: skip
    monkeypatch.setattr(log, "read_log", lambda _path: made)
    _, output = run("log", "info", path)
    assert "modes, by number:\n    0 boot; 1 standby\nreasons, by number:\n    0 –; 1 " in output
    reasons = output.partition("reasons, by number:\n")[2].partition("0.0 s,")[0]
    assert max(map(len, reasons.splitlines())) <= 100
    words = " ".join(reasons.split()).split("; ")
    assert words == [f"{i} {text or '–'}" for i, text in enumerate(REASON_TEXTS)]


# --- a rare loss -------------------------------------------------------------------------------


def test_a_ladder_is_summed_rung_by_rung(capsys: Out, monkeypatch: pytest.MonkeyPatch) -> None:
    def rung(level: float, tried: int, passed: int) -> Any:
        return SimpleNamespace(level=level, tried=tried, passed=passed)

    ladders: Any = [
        SimpleNamespace(probability=1e-3, rungs=[rung(0.5, 100, 50), rung(0.25, 50, 10)]),
        SimpleNamespace(probability=3e-3, rungs=[rung(0.5, 100, 30)]),
    ]
    process: Any = SimpleNamespace(
        exits=(
            WellExit(s_m=-0.5, barrier=1.0, rate_per_s=0.01, smooth=True),
            WellExit(s_m=0.75, barrier=1.0, rate_per_s=0.02, smooth=False),
        )
    )
    causes = [SimpleNamespace(fraction=0.75, text="it sank", losses=3)]
    monkeypatch.setattr(rare, "pooled_causes", lambda _climbed: causes)
    found = RareEstimate(probability=0.002, low=0.001, high=0.004, trajectories=1234)
    rare._print(process, ladders, found, 20.0)
    output = capsys.readouterr().out
    assert rows(output) == [["0.500", "200", "80", "0.400"], ["0.250", "50", "10", "0.200"]]
    assert "ladders: 0.001, 0.003" in output
    assert (
        "lost within 20 s: 0.002, 0.001 to 0.004 at 95 %; a minute: 0.006; by 1234 traj" in output
    )
    assert "Kramers, below: 0.6 a minute (-0.50 m along the line, a rim of the air)" in output
    assert (
        "Kramers, above: 1.2 a minute (+0.75 m along the line, cut off by ground, fence" in output
    )
    assert " 75.00 %  it sank (3 losses)" in output


def test_the_last_seconds_of_a_loss_are_in_four_digits() -> None:
    loss: Any = SimpleNamespace(last=np.array([[0.123456, 1.0]]), cause="fence")
    assert rare._last(2, 0.5, loss) == {
        "ladder": 2,
        "weight": 0.5,
        "cause": "fence",
        "rows": [[0.1235, 1.0]],
    }


# --- layouts -----------------------------------------------------------------------------------

PANELS = {
    "distance to the line [m]": ["tick/e_rho_m"],
    "pitch [rad]": ["tick/setpoints_pitch_rad", "tick/vehicle_pitch_rad"],
    "commands [of full travel]": [
        *("tick/command_elevator", "tick/command_aileron", "tick/command_rudder")
    ],
    "air [m/s]": ["slow/air_wind_mps", "slow/air_updraft_mps", "slow/air_excess_mps"],
    "mode, and the reason of its change": ["tick/mode", "tick/reason"],
    "clearance [m]": ["tick/margins_clearance_m"],
    "age of the last fix [s]": ["tick/health_position_age_s"],
}


def test_plotjuggler_shows_each_panel_and_the_vertical_plane() -> None:
    root = ElementTree.fromstring(log_layouts.plotjuggler())
    areas = {area.get("name"): area for area in root.iter("DockArea")}
    *over_time, plane = areas
    found = {name: [curve.get("name") for curve in areas[name].iter("curve")] for name in over_time}
    assert found == PANELS
    curves = [dict(curve.attrib) for curve in areas[plane].iter("curve")]
    assert [(c["name"], c["curve_x"], c["curve_y"]) for c in curves] == [
        ("aircraft", "tick/vehicle_x_m", "tick/vehicle_z_m"),
        ("line", "tick/line_x_m", "tick/line_z_m"),
    ]
    tabs = list(root.iter("Tab"))
    assert [tab.get("tab_name") for tab in tabs] == ["flight", "vertical plane"]
    for area in areas.values():  # curves of one panel are told apart
        colours = [curve.get("color") for curve in area.iter("curve")]
        assert len(set(colours)) == len(colours)
    (splitter, _) = root.iter("DockSplitter")
    assert splitter.get("sizes") == ";".join(["0.142857"] * 7)


def test_foxglove_stacks_equal_panels() -> None:
    layout = json.loads(log_layouts.foxglove())
    plots = layout["configById"]
    assert {
        plot["title"]: [path["value"] for path in plot["paths"]] for plot in plots.values()
    } == {
        title: [f"/{curve.replace('/', '.')}" for curve in curves]
        for title, curves in PANELS.items()
    }
    for plot in plots.values():
        assert plot["isSynced"]
        assert plot["showLegend"]
        assert plot["showXAxisLabels"]
        assert plot["showYAxisLabels"]
        assert all(path["enabled"] for path in plot["paths"])
    assert layout["playbackConfig"] == {"speed": 1}
    part, rest, heights = layout["layout"], 1.0, []
    while isinstance(part, dict):
        assert part["direction"] == "column"
        heights.append(rest * part["splitPercentage"] / 100.0)
        rest -= heights[-1]
        part = part["second"]
    assert [*heights, rest] == pytest.approx([1.0 / 7.0] * 7)
