"""Errors of the airframe file and of parameters say which of two, and what the other one is."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.airframe import SIMULATED_KEYS
from tgl_soar.config.files import ConfigError, check_simulated, load_airframe, shipped
from tgl_soar.config.parameters import ParameterError, ParameterSet

FILE = shipped("airframes/eclipson_c.toml")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"PITCH_MIN": 12.0}, "PITCH_MIN must be below PITCH_MAX (PITCH_MAX = 6)"),
        ({"PITCH_MAX": -20.0}, "PITCH_MIN must be below PITCH_MAX (PITCH_MIN = -12)"),
        ({"FENCE_X_MAX": 0.0, "FENCE_X_MIN": 9.0}, "below FENCE_X_MAX (FENCE_X_MAX = 0)"),
        ({"SURF_MAX": 0.2, "ELE_TRIM": 0.3}, "must lie within SURF_MAX (SURF_MAX = 0.2)"),
    ],
)
def test_of_two_parameters_the_other_one_is_reported(changes: dict[str, float], words: str) -> None:
    base = ParameterSet().changed({"PITCH_MIN": -12.0, "PITCH_MAX": 6.0})
    with pytest.raises(ParameterError) as refused:
        base.changed(changes)
    assert words in str(refused.value)


def test_what_already_tells_a_value_tells_it_once() -> None:
    with pytest.raises(ParameterError) as refused:
        ParameterSet().changed({"TGL_LEAN": 1.0})
    assert "(TGL_LEAN_MIN):" in str(refused.value)
    assert "TGL_LEAN_MIN =" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "shared"),
    [
        ("rudder = { channel = 4", "rudder = { channel = 2", "elevator 2, rudder 2"),
        ("aileron = { channel = 1", "aileron = { channel = 4", "aileron 4, rudder 4"),
        (
            "rudder = {",
            "flap = { channel = 4 }\nrudder = {",
            "rudder 4, flap 4",
        ),
    ],
)
def test_surfaces_of_one_channel_are_named(tmp_path: Path, old: str, new: str, shared: str) -> None:
    text = FILE.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file = tmp_path / "own.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=f"two surfaces share a channel: {shared}; give each"):
        load_airframe(file)


def without_model(folder: Path) -> Path:
    text = FILE.read_text(encoding="utf-8")
    file = folder / "own.toml"
    file.write_text(text[: text.index("[model]")] + text[text.index("[autopilot]") :])
    return file


@pytest.mark.parametrize("command", ["margins", "sitl --out {}/out", "glide --out {}/out"])
def test_what_simulates_names_the_file_without_a_model(tmp_path: Path, command: str) -> None:
    file = without_model(tmp_path)
    words = [word.replace("{}", str(tmp_path)) for word in command.split()]
    ran = CliRunner().invoke(app, [*words, "--airframe", str(file)])
    assert ran.exit_code == 2
    printed = " ".join(ran.output.split())
    assert "own.toml: [model]: missing" in printed
    assert "None" not in printed
    assert not (tmp_path / "out").exists()


def test_what_is_missing_of_a_model_is_named() -> None:
    plane = load_airframe(FILE)
    check_simulated(FILE, plane)
    assert len(SIMULATED_KEYS) == 31
    for key in ("Cn_p", "servo_travel"):
        plane.model.pop(key)
    with pytest.raises(ConfigError) as refused:
        check_simulated(FILE, plane)
    assert f"{FILE}: model.Cn_p, model.servo_travel: missing" in str(refused.value)
