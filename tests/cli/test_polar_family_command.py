"""`tgl-soar polar fit` on glides at several positions of a brake: a table, a simulated flight."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.glide_test import WIND_MPS

PLANE = shipped("airframes/eclipson_c_spoilers.toml")
K = 4.6e-4


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    return result.exit_code, result.output


def drag(output: str) -> float:
    found = re.search(r"CD_brake = ([\d.]+) ±", output)
    assert found is not None, output
    return float(found[1])


def test_a_table_with_a_column_of_the_brake(tmp_path: Path) -> None:
    rows = ["speed_mps,sink_mps,brake"]
    rows += [
        f"{u},{1.3 + 0.1 * (u - 8.6) ** 2 + K * b * u**3:.5f},{b}"
        for b in (0.0, 1.0)
        for u in (7.4, 7.9, 8.6, 9.4, 10.3, 11.5)
    ]
    table = tmp_path / "glides.csv"
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    code, output = run("polar", "fit", table, "--compare", PLANE)
    assert code == 0, output
    aero = load_airframe(PLANE).aerodynamics()
    made = K * 2.0 * aero.mass_kg * aero.gravity_mps2
    made /= aero.air_density_kgpm3 * aero.wing_area_m2
    assert drag(output) == pytest.approx(made, rel=0.01)
    assert "(the file has 0.03)" in output


@pytest.mark.long
def test_a_flight_that_glides_with_and_without_the_brake(tmp_path: Path) -> None:
    code, output = run(
        "glide", "--airframe", PLANE, "--brake", "0", "--brake", "1", "--out", tmp_path
    )
    assert code == 0, output
    (log,) = tmp_path.rglob("*.ulg")
    code, output = run("polar", "fit", log, "--wind", WIND_MPS, "--compare", PLANE)
    assert code == 0, output
    # The lift that it takes costs induced drag too, and the servos' travel is the brake's: 15 %.
    assert drag(output) == pytest.approx(0.030, rel=0.15)


def test_a_brake_that_is_none_is_refused(tmp_path: Path) -> None:
    code, output = run("glide", "--brake", "1", "--out", tmp_path)
    assert code == 2
    assert "has no brake" in output
    code, output = run("glide", "--airframe", PLANE, "--brake", "1.5", "--out", tmp_path)
    assert code == 2
    assert "from 0 to 1" in output
