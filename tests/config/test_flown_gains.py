"""Whose gains of pitch a flight begins with, as reported to operators."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config import flown_gains
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.dynamics import SHORT_PERIOD_KEYS
from tgl_soar.config.files import gains_words, load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import SHIPPED

FILE, SITE_FILE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
PLANE, SITE = load_airframe(FILE), load_site(SITE_FILE)
REST = {name: value for name, value in PLANE.parameters.items() if name not in SHIPPED}


def words(plane: Airframe) -> str:
    return gains_words(plane, SITE, load_parameters(plane, FILE, SITE, SITE_FILE))


@pytest.mark.parametrize("parameters", [REST, PLANE.parameters])
@pytest.mark.parametrize(
    ("missing", "why"),
    [
        ([*PLANE.model], "the airframe file has no [model]"),
        (["Cm_q"], "[model] of the airframe file has no Cm_q"),
        (SHORT_PERIOD_KEYS, "no CL_alpha, Cm_alpha, Cm_q, Cm_elevator"),
    ],
)
def test_gains_of_another_aircraft_are_named_as_such(
    parameters: dict[str, float], missing: list[str], why: str
) -> None:
    """None were found for an unknown aircraft."""
    model = {name: value for name, value in PLANE.model.items() if name not in missing}
    text = words(replace(PLANE, model=model, parameters=parameters))
    assert text.startswith("gains of pitch: those of the Eclipson Model C: ")
    assert text.endswith(f"{why} (`tgl-soar docs files`)")


def test_seeking_runs_no_code_of_the_folder_that_it_is_started_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("open('run', 'w').close()\nraise SystemExit(3)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "numpy", raising=False)
    monkeypatch.setattr(flown_gains, "_SEEKS", "import json; print('{\"ELE_P\": 2.5}')")
    assert flown_gains._sought(ParameterSet()) == {"ELE_P": 2.5}
    assert not (tmp_path / "run").exists()


def test_an_aircraft_without_a_short_period_is_reported() -> None:
    """One whose coefficients are all there, and whose polar has no glide that it could have."""
    model = {name: value for name, value in PLANE.model.items() if name not in ("CD0", "CD_lift")}
    sinking = replace(PLANE.polar, c0=30.0, c1=0.0, c2=0.0, c3=0.0)
    plane = replace(PLANE, model=model, polar=sinking, parameters=REST)
    assert words(plane).endswith("give no motion in pitch: DYN_GLIDE = 0.4 (`tgl-soar docs files`)")


def test_an_aircraft_like_the_shipped_one_has_its_gains() -> None:
    assert words(PLANE) == ""
    assert words(replace(PLANE, parameters=REST)) == (
        "gains of pitch: those of the Eclipson Model C, which this aircraft is like"
    )


def test_given_gains_of_an_unknown_aircraft_are_named() -> None:
    given = {**PLANE.parameters, "RHO_P": 0.5}
    assert words(replace(PLANE, parameters=given)) == ""
    text = words(replace(PLANE, model={}, parameters=given))
    assert text == "gains of pitch: as the files give them (RHO_P); none are sought"


def without(ending: str | tuple[str, ...]) -> dict[str, float]:
    return {n: v for n, v in PLANE.parameters.items() if n in SHIPPED and not n.endswith(ending)}


@pytest.mark.parametrize(
    ("given", "missing"),
    [
        ({"RHO_P": 0.5}, "RHO_I = 0.11, RHO_D = 0.25, RHO_D_FILT = 6.5 and others"),
        ({"RHO_P": SHIPPED["RHO_P"]}, "RHO_I = 0.11, RHO_D = 0.25, RHO_D_FILT = 6.5 and others"),
        (without("ELE_D"), "ELE_D = 0.19"),
        (without(("ELE_D", "RHO_I", "RHO_D")), "RHO_I = 0.11, RHO_D = 0.25, ELE_D = 0.19"),
        (without("ELE_I_IMU") | {"RHO_P": 0.5}, "ELE_I_IMU = 0"),
        (without("ELE_DSP_IMU") | {"RHO_P": 0.5}, ""),
        (without("_IMU"), ""),
    ],
)
def test_gains_that_are_missing_beside_others_are_warned_of(
    given: dict[str, float], missing: str
) -> None:
    """On the aircraft that the shipped ones were found on, too, whatever is given of them."""
    text = words(replace(PLANE, parameters={**REST, **given}))
    if missing:
        assert f"flown as declared: {missing}, which nobody found" in text
    else:
        assert text == ""


def test_show_does_not_call_them_sought(tmp_path: Path) -> None:
    """With neither a model nor gains in the file: the shipped ones, and none are the file's."""
    text = FILE.read_text(encoding="utf-8")
    start, end = text.index("[model]"), text.index("[autopilot]")
    kept = [line for line in (text[:start] + text[end:]).splitlines() if not line.startswith("RHO")]
    file = tmp_path / "own.toml"
    file.write_text("\n".join(line for line in kept if not line.startswith("ELE")))
    command = ["params", "show", "--airframe", str(file), "--site", str(SITE_FILE)]
    ran = CliRunner().invoke(app, [*command, "--state", str(tmp_path)], env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    rows = {line.split()[0]: line.split() for line in ran.output.splitlines() if line}
    assert {rows[name][-1] for name in ("RHO_P", "ELE_D_IMU")} == {"shipped"}
    assert {rows[name][-1] for name in ("RHO_SPEED", "ELE_FREQ")} == {"default"}
    assert "those of the Eclipson Model C: the airframe file has no [model]" in ran.output
    assert "sought" not in ran.output
