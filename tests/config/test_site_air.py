"""Which files an air of a site file names, wherever it stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from tgl_soar.config.site import GridAir, HillAir, JetAir, PolynomialAir, air_files

FOLDER = Path("sites")
GRID = GridAir(file="field.csv", wind_mps=8.0)


@pytest.mark.parametrize(
    ("air", "names"),
    [
        (JetAir(wind_mps=8.5, slope_deg=23.0), []),
        (HillAir(wind_mps=7.0, radius_m=8.0), []),
        (HillAir(wind_mps=7.0, radius_m=8.0, record="hour.csv"), ["hour.csv"]),
        (GRID, ["field.csv"]),
        (GridAir(file="field.csv", wind_mps=8.0, record="hour.csv"), ["field.csv", "hour.csv"]),
        (PolynomialAir(of=GRID, degree=4, x_m=(0.0, 2.0), z_m=(0.0, 2.0)), ["field.csv"]),
    ],
)
def test_files_are_named_from_the_folder_of_the_site(
    air: JetAir | HillAir | GridAir | PolynomialAir, names: list[str]
) -> None:
    assert air_files(air, FOLDER) == [FOLDER / name for name in names]


def test_the_reference_wind_of_a_polynomial_is_that_of_the_air_it_follows() -> None:
    assert PolynomialAir(of=GRID, degree=4, x_m=(0.0, 2.0), z_m=(0.0, 2.0)).wind_mps == 8.0
