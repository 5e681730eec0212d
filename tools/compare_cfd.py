#!/usr/bin/env python3
"""Hold the jet model against the public CFD plane of the paper's test section.

    python tools/compare_cfd.py PLANE.csv

The plane (slope 21.3 degrees) has columns x, z, v_x, v_z; its x grows upstream, the foot of the
board lies at (5.5, 0.5) m, the tip at (3.25, 1.40) m, the nozzle's lip near x = 6.
"""

from __future__ import annotations

import argparse
import sys
from math import hypot, inf, radians
from pathlib import Path

from tgl_soar.air.comparison import compare_jet
from tgl_soar.air.grid import GridError
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.jet import JetShape

LAYOUT = Layout(u="v_x", w="v_z", x_sign=-1, origin_x_m=5.5, origin_z_m=0.5)
MODELS = (
    ("square nozzle (the default)", 2.85, 1.0),
    ("two-dimensional, vented wake", inf, 1.0),
    ("two-dimensional, sucking wake 1.15", inf, 1.15),
)


def main() -> int:
    parser = argparse.ArgumentParser(description="The jet model against a CFD plane.")
    parser.add_argument("plane", type=Path)
    options = parser.parse_args()
    try:
        plane = read_grid(options.plane, LAYOUT, reference_wind_mps=8.52, zero_cells="solid")
    except GridError as error:
        print(error, file=sys.stderr)
        return 2
    print("model                                wind rms   bias   updraft rms   bias   [% of wind]")
    for name, width, suction in MODELS:
        shape = JetShape(
            slope_rad=radians(21.3),
            board_length_m=hypot(2.25, 0.9),
            jet_width_m=width,
            wake_speed_ratio=suction,
        )
        d = compare_jet(plane, shape)
        print(
            f"{name:36} {100 * d.wind_rms:7.1f} {100 * d.wind_bias:+7.1f}"
            f" {100 * d.updraft_rms:10.1f} {100 * d.updraft_bias:+8.1f}"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
