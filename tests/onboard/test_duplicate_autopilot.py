"""Closed loop: a second autopilot with the same identity is received while the module flies.

It is of an aircraft that lies on a bench near the line, level, with another clock.  What it says
must not be flown with: the module flies on with the true one, or disengages in the air.
"""

from __future__ import annotations

from itertools import count
from math import sin
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim import simulation
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.simulation import Options, Simulation
from tgl_soar.types import AttitudeSample, PositionFix

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
COMPANION = 1
BOOTED_S = 1000.0  # our clock when the autopilot's began
ENGAGED_S = 2.0
DUPLICATE_S = 6.0  # from then on the duplicate is received
REPORTED = "two autopilots are 1:1"


_noise = count()


def on_the_bench(sample: Any) -> Any:
    """What its sensors say: it lies still, and they have their noise."""
    noise = 1e-3 * sin(next(_noise))
    if isinstance(sample, PositionFix):
        return sample._replace(
            north_m=0.3 + noise,
            east_m=noise,
            down_m=-1.5 + noise,
            velocity_north_mps=noise,
            velocity_east_mps=noise,
            velocity_down_mps=noise,
        )
    if isinstance(sample, AttitudeSample):
        return sample._replace(qw=1.0, qx=noise, qy=noise, qz=noise)
    return sample


class ClosedLoop:
    """The simulated Pixhawk and the module, each with a clock of its own."""

    def __init__(self, seed: int, fault: str) -> None:
        airframe, site = load_airframe(AIRFRAME), load_site(SITE)
        options = Options(seed=seed, faults=(parse_fault(fault),), truth=False, turbulence=0.01)
        self.simulation = Simulation(airframe, site, options, SITE.parent)
        self.simulation.add_link(COMPANION, ground=False)
        self.texts: list[str] = []
        values = load_parameters(airframe, AIRFRAME, site, SITE)
        self.onboard = Onboard(
            setup_from(airframe, site, values),
            self._send,
            BOOTED_S,
            ModuleOptions(console=self.texts.append),
        )

    def _send(self, frame: bytes) -> bool:
        self.simulation.receive(COMPANION, frame)
        return True

    def fly(self, until_s: float) -> None:
        station = mavlink.MAVLink(None, 255, 190)
        engage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
        engaged = False
        while self.simulation.time_s < until_s and not self.simulation.world.crashed:
            self.simulation.step()
            now_s = BOOTED_S + self.simulation.time_s
            for _, data in self.simulation.take_datagrams():
                self.onboard.event(data, now_s + 0.001)
            if not engaged and self.simulation.time_s >= ENGAGED_S:
                engaged = True
                self.onboard.event(bytes(engage.pack(station)), now_s + 0.001)
            if self.onboard.clocking.due(now_s + 0.004):
                self.onboard.periodic(now_s + 0.004)
            else:
                self.onboard.idle(now_s + 0.004)
            if self.simulation.time_s > ENGAGED_S + 1.0 and not self.is_engaged:
                return

    @property
    def is_engaged(self) -> bool:
        return self.onboard.output is not None and self.onboard.output.active


LONG = pytest.mark.long


@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(n, marks=LONG) for n in range(3, 9))])
def test_a_duplicate_with_a_clock_ahead_is_not_flown_with(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation, "DUPLICATE_UPTIME_S", 400.0)
    monkeypatch.setattr(simulation, "of_duplicate", on_the_bench)
    flown = ClosedLoop(seed, f"autopilot.second start={DUPLICATE_S} for=100")
    flown.fly(DUPLICATE_S - 0.1)
    assert flown.is_engaged
    flown.fly(DUPLICATE_S + 10.0)
    world, output = flown.simulation.world, flown.onboard.output
    assert output is not None
    assert not world.crashed
    assert not flown.is_engaged
    assert world.position.down_m < -0.5
    # CONTEST_S, then AGE_ATT_MAX; until then it has flown on as before.
    assert flown.simulation.time_s < DUPLICATE_S + 2.0
    assert any(REPORTED in text for text in flown.texts)
