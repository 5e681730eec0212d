"""The margin of the loop along the line."""

from __future__ import annotations

from math import radians

import pytest

from tgl_soar.analysis.brake_loop import BrakeMargin, brake_margin
from tgl_soar.analysis.linear_plant import Condition
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftModel
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.sim.world import flown_aircraft

PATH, SITE = shipped("airframes/eclipson_c_spoilers.toml"), shipped("sites/tunnel.toml")
# du/dx, du/dz, dw/dx, dw/dz [1/s] at the tunnel's place b.
GRADIENT = (0.11, 0.76, 0.76, -0.75)


def margin(
    speed_mps: float = 9.0, lean_deg: float = 15.0, delay_s: float = 0.0075, **changed: float
) -> BrakeMargin:
    airframe, site = load_airframe(PATH), load_site(SITE)
    values = load_parameters(airframe, PATH, site, SITE).changed({"TGL_HOLD": 1.0, **changed})
    laws = laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics())
    model = flown_aircraft(airframe)
    assert isinstance(model, AircraftModel)
    return brake_margin(
        laws,
        Condition(
            model=model,
            servo=servo_params(airframe.model),
            speed_mps=speed_mps,
            lean_rad=radians(lean_deg),
            sensors=Sensors(imu=MEMS_IMU),
            command_delay_s=delay_s,
            gradient_per_s=GRADIENT,
        ),
    )


@pytest.mark.parametrize("delay_s", [0.0075, 0.0245])
@pytest.mark.parametrize("speed_mps", [8.7, 10.0, 12.0])
@pytest.mark.parametrize("lean_deg", [10.0, 15.0, 25.0])
def test_the_loop_along_the_line_bears_half(
    speed_mps: float, lean_deg: float, delay_s: float
) -> None:
    found = margin(speed_mps, lean_deg, delay_s)
    assert found.alpha >= 0.5
    assert 0.5 < found.crossover_radps < 15.0
    if delay_s < 0.01:  # the link that gains are for
        # What the brake does to pitch is undone before it: little is lost across the line.
        assert found.elevator_alpha >= 0.9 * found.line_alpha
        assert found.elevator_alpha >= 0.5


def test_too_much_of_it_does_not() -> None:
    assert margin(BRK_V=5.0, BRK_P=10.0, BRK_I=10.0, delay_s=0.1).alpha < 0.3
