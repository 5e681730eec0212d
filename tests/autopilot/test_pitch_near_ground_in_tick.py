"""Near the ground in fast air: a pitch that the line needs is no dive."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
from msgspec.structs import replace

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.sim.closed_loop import fly
from tgl_soar.sim.sensors import MEMS_IMU, READ_BACK, Sensors
from tgl_soar.sim.world import build_field, make_world

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
WIND_MPS = 9.5
DOWNSTREAM = {"TGL_X": 1.6, "TGL_Z": 2.38}  # where line and contour cross in that wind


@pytest.mark.parametrize("seed", [1, 2])
def test_fast_air_near_the_ground_is_flown_at_the_pitch_that_it_needs(seed: int) -> None:
    """At the downstream edge the glide's pitch is -4.9 degrees, and REC_PITCH is -4.

    A floor at REC_PITCH lets the aircraft drift downstream, out of the fence: its clearance of
    1.57 m there is within twice this CLEAR_MIN.
    """
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    assert site.air is not None
    site = replace(site, air=replace(site.air, wind_mps=WIND_MPS))
    assert site.air is not None
    values = load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH)
    values = values.changed({**DOWNSTREAM, "CLEAR_MIN": 0.8})
    world = make_world(
        airframe,
        site,
        seed=seed,
        turbulence=0.01,
        field=build_field(site.air),
        sensors=Sensors(imu=MEMS_IMU, surfaces=READ_BACK),
    )
    assert world.trim_pitch_rad > radians(values["REC_PITCH"])  # at the start the air is slower
    flight = fly(world, values, (), 15.0)
    assert flight.ended == ""
    held = flight["time_s"] > 10.0
    assert float(np.mean(flight["pitch_rad"][held])) < radians(values["REC_PITCH"])
    assert float(np.sqrt(np.mean(flight["e_rho_m"][held] ** 2))) < values["TGL_CAPTURE"]
