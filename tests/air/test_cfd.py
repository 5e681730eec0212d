"""The jet against a computed plane of the test section, where that file is at hand.

The file is public data of the laboratory and no part of this project: TGL_SOAR_CFD names it.
Its x grows upstream; foot of the board at (5.5, 0.5) m, tip at (3.25, 1.40) m, mean speed in the
nozzle 24.3 m²/s through 2.85 m.  Nothing in the model is fitted to it.
"""

from __future__ import annotations

import os
from math import hypot, inf, radians

import numpy as np
import pytest

from tgl_soar.air.grid import GridField
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.jet import SlopeJet

CFD = os.environ.get("TGL_SOAR_CFD", "")
pytestmark = pytest.mark.skipif(not CFD, reason="TGL_SOAR_CFD names no file")
LAYOUT = Layout(u="v_x", w="v_z", x_sign=-1, origin_x_m=5.5, origin_z_m=0.5)


@pytest.fixture(scope="module")
def plane() -> GridField:
    return read_grid(CFD, LAYOUT, reference_wind_mps=8.52, zero_cells="solid")


def _errors(plane: GridField, field: SlopeJet) -> tuple[float, float, float, float]:
    """rms and bias of wind, rms and bias of updraft, in shares of the nozzle's mean wind."""
    x, z = np.meshgrid(np.linspace(0, 2.25, 46), np.linspace(0.4, 2.55, 44), indexing="ij")
    keep = z >= 0.4 * x + 0.4
    u, _, w = plane.wind(x[keep], 0.0, z[keep])
    flow = np.linspace(0.0, 2.85, 571)
    wind = float(np.trapezoid(plane.wind(-0.45, 0.0, flow)[0], flow)) / 2.85
    model = SlopeJet(wind, field.shape.slope_rad, *field.shape[1:])
    du = (model.wind(x[keep], 0.0, z[keep])[0] - u) / wind
    dw = (model.wind(x[keep], 0.0, z[keep])[2] - w) / wind
    return (
        float(np.sqrt((du**2).mean())),
        float(du.mean()),
        float(np.sqrt((dw**2).mean())),
        float(dw.mean()),
    )


@pytest.mark.parametrize(("width", "ratio"), [(inf, 1.0), (2.85, 1.0), (inf, 1.15)])
def test_wind_and_updraft_agree_within_twelve_percent(
    plane: GridField, width: float, ratio: float
) -> None:
    """12 %: the least that is useful, the difference of updraft between slopes 3° apart."""
    field = SlopeJet(
        8.5, radians(21.3), hypot(2.25, 0.9), jet_width_m=width, wake_speed_ratio=ratio
    )
    wind_rms, _, updraft_rms, _ = _errors(plane, field)
    assert wind_rms < 0.12
    assert updraft_rms < 0.12


def test_plane_is_two_dimensional_and_its_wake_sucks(plane: GridField) -> None:
    """Why the two-dimensional model with suction is its nearest: what the rest consists of."""
    length = hypot(2.25, 0.9)
    vented = _errors(plane, SlopeJet(8.5, radians(21.3), length, jet_width_m=inf))
    # Speeds of the lower and upper free edges one metre behind the tip, from the plane itself.
    edge = plane.wind(3.25, 0.0, np.linspace(1.4, 3.2, 73))[0]
    ratio = float(edge.max() / edge[-9])
    assert ratio > 1.1
    drawn = _errors(
        plane, SlopeJet(8.5, radians(21.3), length, jet_width_m=inf, wake_speed_ratio=ratio)
    )
    square = _errors(plane, SlopeJet(8.5, radians(21.3), length, jet_width_m=2.85))
    assert drawn[0] < vented[0] < square[0]
    assert drawn[2] < vented[2] < square[2]
