"""The jet model beside a CFD plane: the board's place in the plane is given, and checked."""

from __future__ import annotations

import csv
import subprocess
import sys
from math import cos, radians, tan
from pathlib import Path

import compare_cfd
import numpy as np
import pytest

from tgl_soar.air.grid import GridField
from tgl_soar.air.jet import JetShape, SlopeJet

TOOL = Path(__file__).parents[2] / "tools" / "compare_cfd.py"
SLOPE_DEG, BOARD_M, FOOT = 21.3, 2.42, (5.5, 0.5)


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Wind of 8 m/s over a floor, and of 12 m/s over a board, which falls off at its tip; x grows
    upstream; solid cells are zero."""
    path = tmp_path_factory.mktemp("cfd") / "plane.csv"
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["x", "z", "v_x", "v_z"])
        for x in np.arange(120) * 0.05:
            along_m = FOOT[0] - x
            rise_m = max(0.0, along_m) * tan(radians(SLOPE_DEG))
            surface_m = FOOT[1] + (rise_m if along_m <= BOARD_M * cos(radians(SLOPE_DEG)) else 0.0)
            wind_mps = 8.0 if along_m < 0.1 else 12.0
            for z in np.arange(120) * 0.05:
                rows.writerow([x, z, *((wind_mps, 0.0) if z > surface_m else (0.0, 0.0))])
    return path


def compared(
    plane: Path, slope_deg: float, foot: tuple[float, float], board_m: float = BOARD_M
) -> tuple[int, str, str]:
    board = ["--slope-deg", str(slope_deg), "--board", str(board_m), "--foot", *map(str, foot)]
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
    # Over the board it is half as fast again as in the nozzle: the model's is slower.
    assert float(square[1]) < -30.0
    shear, edge = table.splitlines()[4:]
    assert shear.removesuffix("0.0 % a metre in the nozzle")[-11:-1] == " grows by "
    assert edge == "its free edge is higher by – (the plane has none)"


@pytest.mark.parametrize(
    ("slope_deg", "board_m", "foot", "why"),
    [
        (30.0, BOARD_M, FOOT, "long at 21."),
        (23.0, BOARD_M, FOOT, "long at 21."),
        (22.2, BOARD_M, FOOT, "long at 21."),
        (20.4, BOARD_M, FOOT, "long at 21."),
        (SLOPE_DEG, BOARD_M, (5.43, 0.6), "the foot's height is -0.1"),
        (SLOPE_DEG, 1.0, FOOT, "the tip is +1.3"),
        (SLOPE_DEG, 2.3, FOOT, "the tip is +0.1"),
        (SLOPE_DEG, 2.55, FOOT, "the tip is -0.1"),
        (SLOPE_DEG, BOARD_M, (5.3, 0.5), "the tip is -0.1"),
        (SLOPE_DEG, BOARD_M, (5.5, 0.6), "height is -0.1"),
        (SLOPE_DEG, BOARD_M, (0.9, 0.5), "there is no board there"),
    ],
)
def test_another_board_than_the_plane_s_is_refused(
    plane: Path, slope_deg: float, board_m: float, foot: tuple[float, float], why: str
) -> None:
    code, table, errors = compared(plane, slope_deg, foot, board_m)
    assert (code, table) == (2, "")
    assert f"no board of {board_m:g} m at {slope_deg:g} degrees" in errors
    assert why in errors


@pytest.mark.parametrize(("slope_deg", "board_m"), [(21.0, 2.42), (21.6, 2.42), (21.3, 2.44)])
def test_what_a_plane_of_steps_cannot_tell_is_taken(
    plane: Path, slope_deg: float, board_m: float
) -> None:
    assert compared(plane, slope_deg, FOOT, board_m)[0] == 0


def test_a_slope_out_of_range_is_refused(plane: Path) -> None:
    code, _, errors = compared(plane, float("nan"), FOOT)
    assert code == 2
    assert "nan is not within 1 to 60" in errors


def test_how_it_grows_with_height_and_where_it_ends_is_of_both() -> None:
    """The jet beside a plane of its own, blown 1 % a metre more strongly and 5 cm further up."""
    shape = JetShape(slope_rad=radians(SLOPE_DEG), board_length_m=BOARD_M)
    jet = SlopeJet(8.0, *shape)
    x, z = np.arange(-0.5, 2.6, 0.05), np.arange(0.0, 4.0, 0.05)
    grid_x, grid_z = np.meshgrid(x, z, indexing="ij")

    def plane(up_m: float, growth: float) -> GridField:
        u, _, w = jet.wind(grid_x, 0.0, np.maximum(grid_z - up_m, 0.0))
        more = 1.0 + growth * (grid_z - 1.425)
        return GridField(x, None, z, more * u, None, more * w, reference_wind_mps=8.0)

    same, higher, grown = (
        compare_cfd.compare_jet(plane(*each), shape)
        for each in ((0.0, 0.0), (0.05, 0.0), (0.0, 0.01))
    )
    assert same.shear_per_m == pytest.approx(0.0, abs=1e-3)
    assert same.edge_m == pytest.approx((0.0,) * 5, abs=0.02)  # cells of 5 cm
    assert higher.edge_m == pytest.approx((-0.05,) * 5, abs=0.02)
    assert grown.shear_per_m == pytest.approx(-0.01, abs=2e-3)
    own, more = (compare_cfd.nozzle_shear(plane(0.0, growth), shape) for growth in (0.0, 0.01))
    assert more - own == pytest.approx(0.01, abs=1e-3)
