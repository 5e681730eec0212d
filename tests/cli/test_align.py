"""`tgl-soar align` with points from a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import load_site, shipped


def test_align_prints_what_goes_into_the_site_file(tmp_path: Path) -> None:
    """The hall's x axis points east of north by 90°, its origin lies 1 m north: y up."""
    points = tmp_path / "points.csv"
    points.write_text(
        "# measured with a tape\n"
        "hall_x,hall_y,hall_z,north,east,down\n"
        "0,0,0,1,0,0\n2,0,0,1,2,0\n0,0.5,1,0,0,-0.5\n2,1,-1,2.001,2,-1\n"
    )
    run = CliRunner().invoke(app, ["align", str(points)])
    assert run.exit_code == 0, run.output
    assert 'up = "y"' in run.output
    assert "yaw_deg = 90.0" in run.output or "yaw_deg = 89.9" in run.output
    site = shipped("sites/tunnel_mocap.toml")
    run = CliRunner().invoke(app, ["align", str(points), "--site", str(site)])
    before = site.read_text().split("\n[mocap]\n")[0]
    (tmp_path / "site.toml").write_text(f"{before}\n{run.stdout}")
    found = load_site(tmp_path / "site.toml").mocap
    assert found is not None
    assert found.offset_m == pytest.approx((1.0, 0.0, 0.0), abs=0.001)
    assert found.yaw_deg == pytest.approx(90.0, abs=0.05)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hall_x,hall_y\n1,2\n", "no column hall_z"),
        ("hall_x,hall_y,hall_z,north,east,down\n1,2,3,4,x,6\n", "point 1: east = 'x': must be"),
        ("hall_x,hall_y,hall_z,north,east,down\n1,2,3,4,5,6\n", "1 points: give 3 or more"),
    ],
)
def test_align_names_a_mistake(tmp_path: Path, text: str, words: str) -> None:
    points = tmp_path / "points.csv"
    points.write_text(text)
    run = CliRunner().invoke(app, ["align", str(points)])
    assert run.exit_code == 2
    assert words in run.output


def test_align_says_in_words_what_it_cannot_read(tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["align", str(tmp_path)])
    assert found.exit_code == 2
    assert "cannot be read: Is a directory" in found.output
    assert "Errno" not in found.output
