"""What `tgl-soar preflight` reports of fence, lines and margins, before it asks the vehicle."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest
from bench_bridge import AIRFRAME
from msgspec.structs import replace
from typer.testing import CliRunner

from tgl_soar.cli import preflight
from tgl_soar.cli.app import app
from tgl_soar.cli.preflight import CheckedPart, _margin_reported, _place_reported
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped

PLANE = load_airframe(AIRFRAME)
SITE = shipped("sites/tunnel.toml")


def test_what_is_wrong_with_fence_and_lines_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The fence is never a reason to stay; a line by which nothing can be held is."""

    def reported(text: str) -> tuple[bool, str]:
        path = tmp_path / "site.toml"
        path.write_text(f'[site]\nname = "field"\n{text}')
        site = load_site(path)
        values = load_parameters(PLANE, AIRFRAME, site, path)
        good, warnings = _place_reported(PLANE, site, values)
        for warning in warnings:
            assert warning
        return good, " ".join(capsys.readouterr().out.split())

    lines = "[lines]\nup = { x_m = 0, z_m = 40 }\n"
    assert reported(f"{lines}[parameters]\nTGL_Z = 40\n") == (
        True,
        "by the site file the wind comes from 0 deg (north)"
        " no fence: set FENCE_X_MIN and its like to where the pilot is to have the aircraft",
    )
    good, words = reported(f"{lines}[parameters]\nTGL_Z = 20\nFENCE_Z_MAX = 30\n")
    assert good
    assert "the fence is open: FENCE_X_MIN, FENCE_X_MAX, FENCE_Y_MAX, FENCE_Z_MIN not set" in words
    assert "line up: the line's point is outside the fence (FENCE_Z_MAX is 30 m)" in words
    good, words = reported("[parameters]\nTGL_Z = 40\nFENCE_Z_MAX = 30\n")
    assert not good
    assert "cannot be engaged: the line's point is outside the fence" in words


def test_a_contour_of_another_airframe_checks_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    path = shipped("sites/hill.toml")
    site = load_site(path)
    values = load_parameters(PLANE, AIRFRAME, site, path)
    assert not _place_reported(PLANE, site, values).warnings
    assert "no line is checked" not in capsys.readouterr().out
    other = replace(PLANE, airframe=replace(PLANE.airframe, name="own"))
    assert _place_reported(other, site, values) == CheckedPart(True, ("no line is checked",))
    words = (
        f"no line is checked: the site's contour is of {PLANE.airframe.name!r}, the airframe is"
        " 'own': put what `tgl-soar site contour` prints for it into the site file"
    )
    assert words in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("wind_deg", "words"), [
    (270.0, "270 deg (west)"), (-45.0, "315 deg (north-west)"), (350.0, "350 deg (north)"),
    (67.6, "67.6 deg (east)"), (200.0, "200 deg (south)"),
])  # fmt: skip
def test_where_the_wind_comes_from_is_reported(
    wind_deg: float, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file that leaves it out has it from north, and nobody would be told."""
    path = tmp_path / "site.toml"
    path.write_text(f'[site]\nname = "field"\nwind_from_deg = {wind_deg}\n')
    site = load_site(path)
    _place_reported(PLANE, site, load_parameters(PLANE, AIRFRAME, site, path))
    assert f"the wind comes from {words}\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "is_enough", "words"),
    [
        ({}, True, " of 0.5, at the line, "),
        ({"AIL_D": 1.0}, False, "0.00 of 0.5, at the aileron, "),
        ({"RHO_D": 1.0}, False, "0.00 of 0.5, at the elevator, "),
        ({"RHO_D_IMU": 1.2, "EST_IMU": 0.0}, True, " of 0.5, at the line, "),
    ],
)
def test_the_least_margin_of_all_loops_is_reported(
    changes: dict[str, float], is_enough: bool, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of roll and heading, too, which nothing else refuses."""
    values = load_parameters(PLANE, AIRFRAME, load_site(SITE), SITE).changed(changes)
    assert _margin_reported(PLANE, values) == CheckedPart(is_enough)
    output = " ".join(capsys.readouterr().out.split())
    assert output.startswith("least margin of the loops: ")
    assert words in output


@pytest.mark.parametrize(
    ("missing", "warnings"),
    [("Cm_q", ()), ("CY_beta", ("no margin of roll and heading is computed",))],
)
def test_of_a_model_that_is_not_complete_no_margin_is_known(
    missing: str, warnings: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the first the rule on board judges none either, and says so itself."""
    model = {name: value for name, value in PLANE.model.items() if name != missing}
    plane = replace(PLANE, model=model)
    values = load_parameters(plane, AIRFRAME, load_site(SITE), SITE)
    assert _margin_reported(plane, values) == CheckedPart(True, warnings)
    assert "no gain is checked" in capsys.readouterr().out


def asked(monkeypatch: pytest.MonkeyPatch, *parts: CheckedPart) -> tuple[int, list[str]]:
    """The exit code and all lines, of what line, loops and vehicle have to say."""
    answers: dict[str, object] = {"Conversation": nullcontext(), "_read": None}
    answers |= zip(("_place_reported", "_margin_reported", "_reported"), parts, strict=True)
    for name, answer in answers.items():
        monkeypatch.setattr(preflight, name, lambda *_, answer=answer, **__: answer)
    files = ["--airframe", str(AIRFRAME), "--site", str(SITE)]
    result = CliRunner().invoke(app, ["preflight", "--link", "udp:127.0.0.1:14550", *files])
    return result.exit_code, result.output.splitlines()


def verdict(monkeypatch: pytest.MonkeyPatch, *parts: CheckedPart) -> tuple[int, str]:
    """The exit code and the last line."""
    code, lines = asked(monkeypatch, *parts)
    return code, lines[-1]


def test_whose_gains_are_flown_is_reported_with_the_files_tables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Their names stand in brackets, which are none of a style's."""
    words = "gains of pitch: those of the shipped one: the airframe file has no [model]"
    monkeypatch.setattr(preflight, "gains_words", lambda *_: words)
    code, lines = asked(monkeypatch, CheckedPart(True), CheckedPart(True), CheckedPart(True))
    assert (code, lines) == (0, [words, "ready"])


@pytest.mark.parametrize("wrong", [None, 0, 1, 2])
def test_any_one_thing_that_must_be_changed_is_in_code_and_verdict(
    wrong: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the line, of the loops, of the vehicle: a checklist goes by the code alone, and a person
    by the last line."""
    parts = [CheckedPart(number != wrong, ("no fence",)) for number in range(3)]
    code, last = verdict(monkeypatch, *parts)
    if wrong is None:
        assert (code, last) == (0, "ready, but no fence; no fence; no fence")
    else:
        assert code == 1
        assert last == "not ready: change what is shown above in red, then run this again"


def test_where_nothing_is_uncertain_the_verdict_is_one_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert verdict(monkeypatch, CheckedPart(True), CheckedPart(True), CheckedPart(True)) == (
        0,
        "ready",
    )


def test_what_nobody_judges_is_in_the_verdict(tmp_path: Path) -> None:
    """A fence that is open, a line of the site that cannot be flown, margins that are not known:
    the module engages all the same."""
    path = tmp_path / "site.toml"
    path.write_text(
        '[site]\nname = "field"\n[lines]\nup = { x_m = 0, z_m = 40 }\n'
        "[parameters]\nTGL_Z = 20\nFENCE_Z_MAX = 30\n"
    )
    site, plane = load_site(path), replace(PLANE, model={})
    part = _place_reported(plane, site, load_parameters(plane, AIRFRAME, site, path))
    assert part.good
    fence, line, margin = part.warnings
    assert fence.startswith("the fence is open: ")
    assert line.startswith("line up: the line's point is ")
    assert margin.startswith("no margin is judged: of the airframe DYN_FREQ, ")
    by_attitude = replace(plane, autopilot=replace(plane.autopilot, firmware="px4"))
    found = _place_reported(by_attitude, site, load_parameters(plane, AIRFRAME, site, path))
    assert found.warnings == (fence, line)
