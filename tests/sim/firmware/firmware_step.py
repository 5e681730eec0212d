"""One step of an aircraft, and one leg, for the tests of the firmwares' simulator interfaces."""

from __future__ import annotations

from pathlib import Path

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.firmware.sensors import Motion, Readings
from tgl_soar.sim.firmware.simulation import Sticks
from tgl_soar.sim.sitl_options import SitlOptions
from tgl_soar.types import SurfaceCommand

AIRFRAME_PATH = shipped("airframes/eclipson_c.toml")
AIRFRAME = load_airframe(AIRFRAME_PATH)
NO_STICKS = Sticks(SurfaceCommand(0.0, 0.0, 0.0))
READINGS = Readings(
    time_s=1.0025,
    force_frd_mps2=(0.1, 0.2, -9.8),
    rate_frd_radps=(0.01, 0.02, 0.03),
    magnetic_frd_gauss=(0.2, 0.0, 0.45),
    pressure_pa=101200.0,
    height_m=10.5,
    temperature_c=15.0,
    differential_pressure_pa=44.0,
    gps=None,
    motion=Motion((1.0, -2.0, -3.0), (0.25, -0.5, 0.125), (0.5, 0.5, -0.5, 0.5), 8.75),
)


def leg(
    out: Path,
    autopilot: str,
    program: str,
    route: str,
    *,
    stay_s: float,
    mocap_options: tuple[str, ...] = (),
) -> SitlOptions:
    """To fly the tunnel's first leg through a real firmware, by motion capture."""
    return SitlOptions(
        airframe=AIRFRAME_PATH,
        site=shipped("sites/tunnel_mocap.toml"),
        out=out,
        legs=("a",),
        stay_s=stay_s,
        mocap=True,
        mocap_options=mocap_options,
        autopilot=autopilot,
        firmware=Path(program),
        route=route,
    )
