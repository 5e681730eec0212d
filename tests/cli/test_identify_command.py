"""From a real flight log to a polar and to an airframe file."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.experiments.aircraft.identification import AIRFRAME
from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, manual
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.sim.glide_test import WIND_MPS, fly, wind_of
from tgl_soar.types import polar_sink


@pytest.fixture(scope="module")
def glide_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The module on board of a gliding test flight."""
    folder = tmp_path_factory.mktemp("glide")
    metadata = LogMetadata({"sys_name": "tgl_soar", "ver_log": str(VERSION), "ver_sw": "0"}, {})
    recorder = FlightRecorder(folder, metadata, 0.0, patient=True)
    recorder.start()
    recorder.parameters(ParameterSet())
    speeds = (9.2, 8.4, 7.9, 8.8, 9.8, 10.6, 11.4)
    for tick in fly(load_airframe(AIRFRAME), seed=2, speeds_mps=speeds, doublets=5):
        recorder.tick(tick.inputs, tick.output, tick.state)
        recorder.poll()
    recorder.stop()
    (path,) = folder.rglob("*.ulg")
    return path


def trim(model: dict[str, float]) -> float:
    """The elevator at the lift of a glide at 9 m/s or so."""
    alpha = (0.77 - model["CL0"]) / model["CL_alpha"]
    return -(model["Cm0"] + model["Cm_alpha"] * alpha) / model["Cm_elevator"]


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    return result.exit_code, result.output


def test_a_polar_from_a_log(glide_log: Path, tmp_path: Path) -> None:
    figure = tmp_path / "polar.png"
    code, output = run(
        "polar", "fit", glide_log, "--wind", WIND_MPS, "--compare", AIRFRAME, "--out", figure
    )
    assert code == 0, output
    assert "steady glides" in output
    assert "[polar]" in output
    assert figure.stat().st_size > 10_000


def test_an_airframe_file_from_a_log(glide_log: Path, tmp_path: Path) -> None:
    new, figure = tmp_path / "new.toml", tmp_path / "doublets.svg"
    code, output = run(
        "identify", glide_log, "--wind", WIND_MPS, "--airframe", AIRFRAME, "-o", new,
        "--figure", figure,
    )  # fmt: skip
    assert code == 0, output
    before, after = load_airframe(AIRFRAME).model, load_airframe(new).model
    assert after["Cm_elevator"] == pytest.approx(before["Cm_elevator"], rel=0.1)
    assert after["servo_delay_s"] == pytest.approx(0.0, abs=0.005)
    changed = {key for key in before if before[key] != after[key]}
    assert {"CL0", "CL_alpha", "Cm_alpha", "Cm_q", "Cm_elevator", "CD0", "CD_lift"} <= changed
    assert not changed & {"CD_separated", "Cl_p", "servo_lag_radps"}
    assert not set(after) & {"CL_brake", "Cm_brake"}
    assert after["CD0"] == pytest.approx(before["CD0"], rel=0.06)
    assert after["CD_lift"] == pytest.approx(before["CD_lift"], rel=0.08)
    was, fitted = (load_airframe(path).polar.as_polar() for path in (AIRFRAME, new))
    assert fitted != was
    assert polar_sink(fitted, 9.4) == pytest.approx(polar_sink(was, 9.4), rel=0.03)
    # Where the elevator trims: of lift and moment together, that no error of the pitch moves.
    assert trim(after) == pytest.approx(trim(before), abs=0.02)
    assert "identified: ±" in new.read_text(encoding="utf-8")
    assert figure.read_text(encoding="utf-8").count("<svg") == 1


def test_the_file_that_it_is_compared_with_is_not_overwritten(glide_log: Path) -> None:
    before = AIRFRAME.read_bytes()
    code, output = run("identify", glide_log, "--airframe", AIRFRAME, "-o", AIRFRAME)
    assert (code, AIRFRAME.read_bytes()) == (2, before)
    assert "another name" in output.replace("\n", " ")


def test_a_figure_that_cannot_be_written_is_a_plain_error(glide_log: Path) -> None:
    code, output = run("polar", "fit", glide_log, "--wind", WIND_MPS, "--out", "/proc/none/p.png")
    assert code == 2
    assert "no figure: /proc/none/p.png" in output.replace("\n", " ")


def test_what_the_airframe_file_lacks_is_not_blamed_on_the_log(
    glide_log: Path, tmp_path: Path
) -> None:
    lacking = tmp_path / "lacking.toml"
    text = AIRFRAME.read_text(encoding="utf-8")
    lacking.write_text(text.replace("servo_lag_radps = 54.0", ""), encoding="utf-8")
    code, output = run("identify", glide_log, "--airframe", lacking)
    assert code == 2
    assert str(lacking) in output.replace("\n", "")
    assert "servo_lag_radps" in output


def test_a_log_that_holds_no_airframe_is_fitted_to_none_of_ours(glide_log: Path) -> None:
    code, output = run("identify", glide_log, "--wind", WIND_MPS)
    assert code == 2
    assert "holds no airframe file: name one with --airframe" in output.replace("\n", " ")


def test_without_an_airframe_file_the_one_that_the_log_holds_is_fitted(tmp_path: Path) -> None:
    """Of an aircraft whose lift is not that of the shipped one."""
    text = AIRFRAME.read_text(encoding="utf-8")
    other, count = re.subn(
        r"(?m)^CL_alpha = ([\d.]+)", lambda found: f"CL_alpha = {0.85 * float(found[1]):.4f}", text
    )
    assert count == 1
    mine = tmp_path / "mine.toml"
    mine.write_text(other.replace('name = "', 'name = "my ', 1), encoding="utf-8")
    truth, new = load_airframe(mine), tmp_path / "new.toml"
    run("glide", "--airframe", mine, "--out", tmp_path)
    code, output = run("identify", tmp_path, "--wind", wind_of(truth), "--out", new)
    assert code == 0, output
    fitted = load_airframe(new)
    assert fitted.airframe.name == truth.airframe.name
    # The shipped aircraft's is 18 % more; lift over the incidences that are flown is not straight.
    assert fitted.model["CL_alpha"] == pytest.approx(truth.model["CL_alpha"], rel=0.08)


def test_the_commands_of_the_page_run_as_often_as_they_are_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (manual() / "identification.md").read_text(encoding="utf-8")
    example = page.partition("## Trying it without an aircraft\n")[2].partition("\n## ")[0]
    commands = [shlex.split(line)[1:] for line in re.findall(r"(?m)^    (tgl-soar .+)$", example)]
    assert [command[0] for command in commands] == ["glide", "polar", "identify"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").symlink_to(AIRFRAME.parents[1])
    assert run(*commands[0])[0] == 0
    for command in commands:
        code, output = run(*command)
        assert code == 0, output
    assert len([*(tmp_path / "out" / "glide").rglob("*.ulg")]) == 2
    assert (tmp_path / "out" / "doublets.png").is_file()
    assert (tmp_path / "out" / "polar.png").is_file()


def test_a_simulated_glide_leaves_a_log_that_both_take(tmp_path: Path) -> None:
    code, output = run("glide", "--out", tmp_path, "--seed", 3)
    assert code == 0, output
    (log,) = tmp_path.rglob("*.ulg")
    code, output = run("polar", "fit", log, "--wind", WIND_MPS)
    assert code == 0, output
    code, output = run("identify", log, "--wind", WIND_MPS)
    assert code == 0, output
    assert f"airframe: Eclipson Model C, of {log}, airframe file" in output.replace("\n", "")
    blocked = tmp_path / "file"
    blocked.touch()
    assert run("glide", "--out", blocked)[0] == 2


def test_of_a_log_that_breaks_off_the_glides_are_used_and_the_loss_is_reported(
    glide_log: Path, tmp_path: Path
) -> None:
    """Power is lost among the doublets: a polar is still in it, and too few of those."""
    data = glide_log.read_bytes()
    cut = tmp_path / "cut.ulg"
    end = 16  # of the file's header; then messages of size, type and what the size says
    while end < 0.72 * len(data):
        end += 3 + int.from_bytes(data[end : end + 2], "little")
    cut.write_bytes(data[: end + 5])  # in the midst of a message: between two nothing would be lost
    code, output = run("polar", "fit", cut, "--wind", WIND_MPS)
    assert code == 0, output
    assert "lost: cut off" in output
    assert "[polar]" in output
    code, output = run("identify", cut, "--wind", WIND_MPS, "--airframe", AIRFRAME)
    assert code == 2
    assert "lost: cut off" in output
    assert "manoeuvres found, 4 are needed" in output.replace("\n", " ")


def test_mistakes_are_reported(glide_log: Path, tmp_path: Path) -> None:
    code, output = run("identify", tmp_path / "none.ulg")
    assert code == 2
    assert "none.ulg" in output
    empty = tmp_path / "empty.ulg"
    empty.touch()
    code, output = run("polar", "fit", empty)
    assert code == 2
    assert "empty" in output
    code, output = run("polar", "fit", glide_log)  # without the wind it glided backwards
    assert code == 2
    assert str(glide_log) in output.replace("\n", "")
