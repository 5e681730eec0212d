"""`tgl-soar params show | diff | export | import | reset`, as an operator at a desk uses them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.mavparm import MAVParmDict
from typer.testing import CliRunner

from tgl_soar.cli import params
from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.config.parameter_files import read_file, written
from tgl_soar.config.parameter_store import Identity, state_text
from tgl_soar.config.parameters import PARAMETERS, ParameterSet, as_wire_value

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
Command = Callable[..., str]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str, code: int = 0) -> str:
        files = ["--airframe", str(AIRFRAME), "--site", str(SITE), "--state", "state"]
        ran = CliRunner().invoke(app, ["params", *arguments, *files])
        assert ran.exit_code == code, ran.output
        return ran.output

    return run


def begins(folder: Path) -> ParameterSet:
    return params.beginning(AIRFRAME, SITE, folder / "state").values


def test_without_a_word_all_parameters_are_listed() -> None:
    listed = CliRunner().invoke(app, ["params"], env={"COLUMNS": "200"}).output
    for p in PARAMETERS:
        assert p.name in listed


def test_show_tells_where_each_value_is_from(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.parm").write_text("RHO_D 0.34\n")
    command("import", "mine.parm")
    rows = {line.split()[0]: line.split() for line in command("show").splitlines() if line}
    assert rows["RHO_D"] == ["RHO_D", "0.34", "rad", "s/m", "stored"]
    assert rows["RHO_P"] == ["RHO_P", "0.4", "rad/m", "airframe"]
    assert rows["TGL_X"] == ["TGL_X", "0.2", "m", "site"]
    assert rows["TGL_CAPTURE"][-1] == "default"


@pytest.mark.parametrize("text", ["", "# nothing\n", "SYSID_THISMAV 1\n", "OP_ENGAGE 1\n"])
def test_a_file_without_any_of_our_parameters_is_refused(
    command: Command, tmp_path: Path, text: str
) -> None:
    (tmp_path / "none.parm").write_text(text)
    output = command("import", "none.parm", code=2)
    assert "none.parm: no parameter of this module in it" in output
    assert "passed over" in output or "1" not in text
    assert not (tmp_path / "state").exists()


def test_where_nothing_is_stored_it_says_so(command: Command, tmp_path: Path) -> None:
    assert "\nnothing is stored in state/" in command("show")
    (tmp_path / "mine.parm").write_text("RHO_D 0.34\n")
    command("import", "mine.parm")
    assert "\nstored in state/" in command("show")


def test_gains_that_were_sought_are_named_as_such(tmp_path: Path) -> None:
    """And no file has them."""
    glider, jet = shipped("scenarios/unseen/glider.toml"), shipped("scenarios/unseen/jet.toml")
    files = ["--airframe", str(glider), "--site", str(jet), "--state", str(tmp_path)]
    ran = CliRunner().invoke(app, ["params", "show", *files], env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    rows = {line.split()[0]: line.split() for line in ran.output.splitlines() if line}
    assert {rows[name][-1] for name in ("RHO_P", "ELE_D_IMU", "ELE_FREQ")} == {"sought"}
    assert {rows[name][-1] for name in ("PITCH_TRIM", "AIL_P", "LAT_SPEED")} == {"airframe"}
    assert "gains of pitch: sought for this aircraft" in ran.output


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ((), []),
        (
            (("[lines]\n", "[lines]\nlow = { x_m = 0.2, z_m = 0.01 }\n"),),
            ["{}: lines.low: x_m = 0.2, z_m = 0.01, lean_deg = 15: the line's point is outside the"
             " fence (FENCE_Z_MIN is 0.15 m)"],
        ),
        (
            (
                ("[lines]\n", "[lines]\nfar = { x_m = 30, z_m = 1, lean_deg = 9 }\n"),
                ("WPT_X = -5.5", "WPT_X = 40"),
            ),
            ["{}: lines.far: x_m = 30, z_m = 1, lean_deg = 9: the line's point is outside the"
             " fence (FENCE_X_MAX is 2.25 m)",
             "{}: parameters.WPT_X = 40: the virtual waypoint must be upwind of line a by"
             " WPT_R_MIN: at most -2.8"],
        ),
        ((("WPT_X = -5.5", "WPT_X = -2.8"),), []),
        (
            (("WPT_X = -5.5", "WPT_X = -2.7"),),
            ["{}: parameters.WPT_X = -2.7: the virtual waypoint must be upwind of line a by"
             " WPT_R_MIN: at most -2.8"],
        ),
        (
            (("TGL_Z = 1.15", "TGL_Z = 0.2"),),
            ["{}: parameters.TGL_X = 0.2, TGL_Z = 0.2, TGL_LEAN = 15: the line's point is 0.1"],
        ),
        (
            (("CLEAR_MIN = 0.30", "CLEAR_MIN = 1.0"),),
            ["{}: lines.a: x_m = 0.2, z_m = 1.15, lean_deg = 15: the line's point is 0.98 m from"
             " the ground (CLEAR_MIN is 1 m)"],
        ),
    ],
)  # fmt: skip
def test_a_line_that_no_aircraft_can_be_held_by_is_named_with_file_and_key(
    changes: tuple[tuple[str, str], ...], wrong: list[str], tmp_path: Path
) -> None:
    site = tmp_path / "site.toml"
    text = SITE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    site.write_text(text, encoding="utf-8")
    files = ["--airframe", str(AIRFRAME), "--site", str(site), "--state", str(tmp_path)]
    ran = CliRunner().invoke(app, ["params", "show", *files], env={"COLUMNS": "400"})
    assert ran.exit_code == (2 if wrong else 0), ran.output
    assert "WPT_X" in ran.stdout  # the values all the same
    for words in wrong:
        assert words.format(site) in ran.stderr
    assert ran.stderr.count("error: ") == len(wrong)


def test_a_stored_line_is_named_with_the_file_that_it_is_stored_in(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "mine.parm").write_text("TGL_X 30\nTGL_Z 1\n")
    command("import", "mine.parm", "--force")
    output = command("show", code=2)
    (stored,) = (tmp_path / "state").glob("*")
    assert f"error: state/{stored.name}: parameters.TGL_X = 30, TGL_Z = 1, " in output


def test_a_contour_of_another_airframe_is_named_with_the_way_out(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(AIRFRAME.read_text().replace('"Eclipson Model C"', '"own"'))
    site = ["--site", str(shipped("sites/hill.toml")), "--state", str(tmp_path)]
    for file, is_reported in ((AIRFRAME, False), (own, True)):
        ran = CliRunner().invoke(app, ["params", "show", "--airframe", str(file), *site])
        output = " ".join(ran.output.split())
        assert ("no line is checked: the site's contour is of" in output) == is_reported
        assert ("`tgl-soar site contour`" in output) == is_reported
        words = "into the site file, in place of [contour], as its option --into does"
        assert (words in output) == is_reported


def test_diff_tells_what_differs(command: Command, tmp_path: Path) -> None:
    assert "no differences" in command("diff")
    (tmp_path / "mine.parm").write_text("RHO_D 0.34\nTGL_X 0.2\n")
    command("import", "mine.parm")
    (row,) = [line for line in command("diff", code=1).splitlines() if "RHO_D" in line]
    assert row.split() == ["RHO_D", "0.33", "0.34", "rad", "s/m"]
    assert "TGL_X" not in command("diff", code=1)
    command("diff", "mine.parm", "state")
    assert "TGL_Z" in command("diff", "default", "files", code=1)
    assert "cannot be read" in command("diff", "default", "none.parm", code=2)


@pytest.mark.parametrize("name", ["all.params", "all.parm"])
def test_an_exported_file_imports_as_the_same_values(
    command: Command, tmp_path: Path, name: str
) -> None:
    (tmp_path / "mine.parm").write_text("RHO_D 0.34\nTGL_X -0.123456\nLOOP_RATE 150\n")
    command("import", "mine.parm")
    before = begins(tmp_path)
    command("export", name)
    command("reset")
    assert begins(tmp_path) != before
    command("import", name)
    assert begins(tmp_path) == before


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-500, 500), st.floats(-100, 1000), st.floats(5, 45), st.floats(0, 5),
    st.integers(100, 250), st.sampled_from(["f.params", "f.parm"]),
)  # fmt: skip
def test_export_then_import_is_the_identity(
    tmp_path_factory: pytest.TempPathFactory,
    x: float, z: float, lean: float, gain: float, rate: int, name: str,
) -> None:  # fmt: skip
    """Through the store and both formats, for any valid set."""
    folder = tmp_path_factory.mktemp("identity")
    files = ["--airframe", str(AIRFRAME), "--site", str(SITE), "--state"]
    first = params.beginning(AIRFRAME, SITE, folder / "first")
    values = first.files.changed(
        {"TGL_X": x, "TGL_Z": z, "TGL_LEAN": lean, "RHO_P": gain, "LOOP_RATE": rate}
    )
    first.store.save(values)
    for words, state in ((["export"], "first"), (["import", "--force"], "second")):
        ran = CliRunner().invoke(
            app, ["params", *words, str(folder / name), *files, str(folder / state)]
        )
        assert ran.exit_code == 0, ran.output
    assert params.beginning(AIRFRAME, SITE, folder / "second").values == values


def test_a_file_of_mavproxys_loads(command: Command, tmp_path: Path) -> None:
    known = MAVParmDict()
    known.update({p.name: value for p, value in ParameterSet()})
    known.update({"RHO_P": 0.9, "OP_ENGAGE": 1.0, "SYSID_THISMAV": 1.0, "TGL_Z": 1.2})
    known.save(str(tmp_path / "saved.parm"))
    reported = command("import", "saved.parm")
    assert "OP_ENGAGE: never set from a file: passed over" in reported
    assert "SYSID_THISMAV: no such parameter here" in reported
    values = begins(tmp_path)
    assert values["RHO_P"] == as_wire_value(0.9)
    assert values["OP_ENGAGE"] == 0.0


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("RHO_P 0.5\nRHO_D\n", "bad.parm:2: 'RHO_D': neither"),
        ("RHO_P 0.5\nRHO_D 99\n", "bad.parm:2: RHO_D = 99: allowed"),
        ("RHO_P 0.5\nTGL_LEAN 2\n", "bad.parm: TGL_LEAN = 2: the line must lean upwind"),
        ("RHO_P 0.5\nTGL_PRESET 9\n", "bad.parm: TGL_PRESET = 9: no such line"),
        ("RHO_P 0.5\nTGL_Z 17\n", "bad.parm: the line's point is outside the fence (FENCE_Z_MAX"),
    ],
)
def test_a_bad_file_changes_nothing(
    command: Command, tmp_path: Path, text: str, reported: str
) -> None:
    (tmp_path / "bad.parm").write_text(text)
    assert reported in command("import", "bad.parm", code=2)
    assert not (tmp_path / "state").exists()


def test_presets_in_files(command: Command, tmp_path: Path) -> None:
    (tmp_path / "b.parm").write_text("TGL_PRESET 2\n")
    command("import", "b.parm")
    values = begins(tmp_path)
    assert (values["TGL_PRESET"], values["TGL_X"]) == (2.0, as_wire_value(0.6))
    command("export", "all.params")
    command("import", "all.params")
    assert begins(tmp_path) == values
    (tmp_path / "odd.parm").write_text("TGL_PRESET 2\nTGL_X 0.9\n")
    assert "TGL_PRESET is 0" in command("import", "odd.parm")


def test_looking_changes_nothing_on_a_damaged_store(command: Command, tmp_path: Path) -> None:
    (tmp_path / "f.parm").write_text("RHO_P 0.5\n")
    command("import", "f.parm")
    (kept,) = (tmp_path / "state").iterdir()
    kept.write_bytes(b"damaged")
    assert "LOST" in command("show")
    assert kept.read_bytes() == b"damaged"


def test_a_folder_that_takes_nothing_is_named(command: Command, tmp_path: Path) -> None:
    (tmp_path / "state").write_text("")
    (tmp_path / "f.params").write_text(written([("RHO_P", 0.5)], "qgroundcontrol"))
    assert read_file(tmp_path / "f.params").values == {"RHO_P": 0.5}
    assert "cannot be written" in command("import", "f.params", code=2)
    assert "cannot be written" in command("export", "state/f.params", code=2)


def test_vehicles_of_files_of_the_same_name_have_each_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of aircraft whose folders `tgl-soar init` made, with names or system ids of their own."""
    monkeypatch.chdir(tmp_path)
    text = AIRFRAME.read_text(encoding="utf-8")
    changes = {
        "first": text,
        "second": re.sub(r"(?m)^system_id = 1$", "system_id = 2", text),
        "third": re.sub(r'(?m)^name = ".*"$', 'name = "Another"', text),
    }
    for name, changed in changes.items():
        assert (changed == text) == (name == "first")
        (tmp_path / name).mkdir()
        (tmp_path / name / "airframe.toml").write_text(changed, encoding="utf-8")

    def ran(name: str, *words: str) -> str:
        files = ["--airframe", f"{name}/airframe.toml", "--site", str(SITE), "--state", "state"]
        got = CliRunner().invoke(app, ["params", *words, *files])
        assert got.exit_code == 0, got.output
        return got.output

    def gain(name: str) -> float:
        files = tmp_path / name / "airframe.toml", SITE
        return params.beginning(*files, tmp_path / "state").values["RHO_D"]

    # What an earlier version kept is the second's: the others neither take nor lose it.
    old = tmp_path / "state" / "airframe-tunnel.params"
    old.parent.mkdir()
    begun = params.beginning(tmp_path / "second" / "airframe.toml", SITE, tmp_path / "state")
    who = Identity(begun.airframe.airframe.name, begun.site.site.name, system=2)
    old.write_bytes(state_text(who, {"RHO_D": 0.75}))
    assert [gain(name) for name in changes] == [as_wire_value(v) for v in (0.33, 0.75, 0.33)]
    for name, value in (("first", 0.34), ("third", 0.35)):
        (tmp_path / "mine.parm").write_text(f"RHO_D {value}\n")
        ran(name, "import", "mine.parm")
    assert [gain(name) for name in changes] == [as_wire_value(v) for v in (0.34, 0.75, 0.35)]
    ran("first", "reset")
    assert [gain(name) for name in changes] == [as_wire_value(v) for v in (0.33, 0.75, 0.35)]
    assert "removed" in ran("second", "reset")
    assert [gain(name) for name in changes] == [as_wire_value(v) for v in (0.33, 0.33, 0.35)]


def test_another_vehicles_file_is_neither_written_over_nor_removed(
    command: Command, tmp_path: Path
) -> None:
    path = params.beginning(AIRFRAME, SITE, tmp_path / "state").store.path
    path.parent.mkdir()
    data = state_text(Identity("Other", "Hill"), {"RHO_D": 0.5})
    path.write_bytes(data)
    (tmp_path / "mine.parm").write_text("RHO_D 0.34\n")
    for words in (["import", "mine.parm"], ["reset"]):
        assert "is another vehicle's: move it elsewhere" in command(*words, code=2)
        assert path.read_bytes() == data
