"""docs/sites.md, "A wind field of your own": what it writes is flown, from .npz and from .csv."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.air.grid import GridField
from tgl_soar.air.hill import HillField
from tgl_soar.cli.app import app
from tgl_soar.config.files import load_site, manual, shipped
from tgl_soar.sim.world import site_field

PAGE = (manual() / "sites.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## A wind field of your own\n")[2].partition("\n## ")[0]
HILL = shipped("sites/hill.toml").read_text(encoding="utf-8")
PLACES = ((-20.0, 5.0), (-9.0, 3.0), (-6.0, 11.5), (0.0, 20.0))


def blocks() -> list[str]:
    """The indented ones, their margin removed."""
    found = re.findall(r"(?m)(?:^    .*\n)+", SECTION)
    return [re.sub(r"(?m)^    ", "", block) for block in found]


def written(folder: Path, air: str) -> Path:
    text, count = re.subn(r"(?ms)^\[air\].*?(?=^\[)", lambda _: f"{air}\n", HILL)
    assert count == 1
    site = folder / "my_hill" / "site.toml"
    site.write_text(text, encoding="utf-8")
    return site


@pytest.fixture
def arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the page's snippet makes, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_hill").mkdir()
    (snippet,) = re.findall(r"(?ms)^```python\n(.*?)^```$", SECTION)
    made: dict[str, Any] = {}
    exec(snippet, made)
    return made


@pytest.mark.parametrize("file", ["air.npz", "air.csv"])
def test_the_field_of_the_page_is_the_wind_of_the_site(
    file: str, arrays: dict[str, Any], tmp_path: Path
) -> None:
    head, air = blocks()
    rows = [
        (float(x), float(z), float(arrays["u"][i, k]), float(arrays["w"][i, k]))
        for i, x in enumerate(arrays["x"])
        for k, z in enumerate(arrays["z"])
    ]
    lines = ["x,z,u,w", *(",".join(map(repr, row)) for row in rows)]
    assert lines[0] == head.splitlines()[0]
    for line, shown in zip(lines[1:3], head.splitlines()[1:], strict=True):
        assert [float(n) for n in line.split(",")] == pytest.approx(
            [float(n) for n in shown.split(",")], abs=1e-5
        )
    (tmp_path / "my_hill" / "air.csv").write_text("\n".join(lines) + "\n")
    site = written(tmp_path, air.replace("air.npz", file))
    field, truth = site_field(load_site(site), site.parent), HillField(7.0, 8.0)
    for x, z in PLACES:
        expected = truth.wind_at(x, 0.0, z, 0.0)
        assert field.wind_at(x, 0.0, z, 0.0) == pytest.approx(expected, abs=0.05)
    assert isinstance(field, GridField)
    assert not field.inside(-3.0, 0.0, 3.0)
    drawn = CliRunner().invoke(app, ["zeuc", "--site", str(site), "--bounds=-40,5,1,40"])
    assert drawn.exit_code == 0, drawn.output


@pytest.mark.usefixtures("arrays")
@pytest.mark.parametrize("command", [("zeuc",), ("site", "contour"), ("site", "misfit")])
def test_a_file_that_is_no_wind_is_named_with_the_site_file_and_the_line(
    command: tuple[str, ...], tmp_path: Path
) -> None:
    table = tmp_path / "my_hill" / "f4.csv"
    table.write_text("x,z,u,w\n" + "".join(f"{i},{i},1,1\n" for i in range(48)) + "48,48,1,abc\n")
    site = written(tmp_path, blocks()[1].replace("air.npz", "f4.csv"))
    words = [*command, "--site", str(site)]
    if command != ("site", "misfit"):
        words.append("--bounds=-40,5,1,40")
    ran = CliRunner().invoke(app, words, env={"COLUMNS": "400"})
    assert ran.exit_code == 2
    assert f"{site}: air.file: {table}: not a table of numbers: line 50: w = 'abc'" in ran.output
