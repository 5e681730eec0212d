"""The jet model beside a CFD plane: the board's place in the plane is given, and checked."""

from __future__ import annotations

import csv
import subprocess
import sys
from math import radians, tan
from pathlib import Path

import numpy as np
import pytest

TOOL = Path(__file__).parents[2] / "tools" / "compare_cfd.py"
SLOPE_DEG, BOARD_M, FOOT = 21.3, 2.42, (5.5, 0.5)


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Even wind of 8 m/s over a floor and a board, x growing upstream; solid cells are zero."""
    path = tmp_path_factory.mktemp("cfd") / "plane.csv"
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["x", "z", "v_x", "v_z"])
        for x in np.arange(120) * 0.05:
            surface_m = FOOT[1] + max(0.0, FOOT[0] - x) * tan(radians(SLOPE_DEG))
            for z in np.arange(120) * 0.05:
                rows.writerow([x, z, *((8.0, 0.0) if z > surface_m else (0.0, 0.0))])
    return path


def compared(plane: Path, slope_deg: float, foot: tuple[float, float]) -> tuple[int, str, str]:
    board = ["--slope-deg", str(slope_deg), "--board", str(BOARD_M), "--foot", *map(str, foot)]
    done = subprocess.run(
        [sys.executable, str(TOOL), str(plane), *board], capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout, done.stderr


def test_a_plane_is_compared_where_its_board_stands(plane: Path) -> None:
    code, table, errors = compared(plane, SLOPE_DEG, FOOT)
    assert (code, errors) == (0, "")
    square = table.splitlines()[1].removeprefix("square nozzle (the default)").split()
    # The plane's air does not rise at all, that of the model does.
    assert float(square[3]) > 5.0


@pytest.mark.parametrize(
    ("slope_deg", "foot"), [(30.0, FOOT), (12.0, FOOT), (SLOPE_DEG, (5.0, 0.5))]
)
def test_another_board_than_the_plane_s_is_refused(
    plane: Path, slope_deg: float, foot: tuple[float, float]
) -> None:
    code, table, errors = compared(plane, slope_deg, foot)
    assert (code, table) == (2, "")
    assert f"no board of 2.42 m at {slope_deg:g} degrees" in errors


def test_a_slope_out_of_range_is_refused(plane: Path) -> None:
    code, _, errors = compared(plane, float("nan"), FOOT)
    assert code == 2
    assert "nan is not within 1 to 60" in errors
