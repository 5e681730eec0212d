"""A pitot tube that ices in flight."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import pytest

from tgl_soar.autopilot import Output
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.supervisor import SOARING
from tgl_soar.estimation.health import AIRSPEED, fault_words
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import Inputs

ICES_S, THAWS_S, END_S = 5.0, 14.0, 24.0
# The nose goes down with what the tube says for as long as the watch takes, two seconds, and the
# aircraft forward with it; over the board there is 0.6 m of room.
OFF_LINE_M = 0.6
BACK_M = 0.1


class Flown(NamedTuple):
    """What there is of a tick."""

    time_s: float
    output: Output
    e_rho_m: float


class Icing(ClosedLoop):
    """The tube reads ever less, for six seconds, and is thawed later."""

    thaws_s = inf

    def _decide(self, inputs: Inputs) -> Output:
        frozen = min(1.0, max(0.0, (inputs.time_s - ICES_S) / 6.0))
        if inputs.time_s > self.thaws_s:
            frozen = 0.0
        read = inputs.airspeed._replace(airspeed_mps=(1.0 - frozen) * inputs.airspeed.airspeed_mps)
        return super()._decide(inputs._replace(airspeed=read))


def flown(sensors: Sensors, seconds: float, thaws_s: float = inf) -> list[Flown]:
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    assert site.air is not None
    values = load_parameters(airframe, airframe_path, site, site_path)
    field = build_field(site.air, site_path.parent)
    world = make_world(airframe, site, seed=1, turbulence=0.02, field=field, sensors=sensors)
    loop = Icing(world, values)
    loop.thaws_s = thaws_s
    ticks = []
    for _ in range(round(seconds * world.step_hz)):
        now = world.time_s
        output = loop.tick()
        ticks.append(Flown(now, output, output.line.e_rho_m))
    assert not world.crashed
    return ticks


@pytest.mark.parametrize(
    "sensors",
    [
        Sensors(imu=MEMS_IMU, airspeed=PITOT, surfaces=READ_BACK),
        Sensors(airspeed=PITOT, surfaces=READ_BACK),
    ],
    ids=["with accelerometers", "without"],
)
def test_it_soars_on_with_what_the_wing_carries(sensors: Sensors) -> None:
    ticks = flown(sensors, THAWS_S)
    assert ticks[-1].output.mode == SOARING
    assert all(each.output.active for each in ticks if each.time_s > 1.0)
    assert max(abs(each.e_rho_m) for each in ticks if each.time_s > ICES_S) < OFF_LINE_M
    assert max(abs(each.e_rho_m) for each in ticks[-200:]) < BACK_M
    assert "airspeed stale or senseless" in fault_words(ticks[-1].output.health.faults)
    assert not any(each.output.health.faults & AIRSPEED for each in ticks if each.time_s < ICES_S)
    assert not ticks[-1].output.air.measured


def test_thawed_it_is_used_again() -> None:
    ticks = flown(Sensors(imu=MEMS_IMU, airspeed=PITOT), END_S, THAWS_S)
    assert not ticks[-1].output.health.faults & AIRSPEED
    assert ticks[-1].output.air.measured
    assert ticks[-1].output.mode == SOARING
