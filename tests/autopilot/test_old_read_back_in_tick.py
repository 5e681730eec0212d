"""Surfaces that were read back long ago say nothing of where they are now."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isnan, nan

import pytest

from tgl_soar.autopilot import Output
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.estimates import fresh
from tgl_soar.control.supervisor import is_flying
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, READ_BACK, Sensors
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import NO_ATTITUDE, NO_FIX, AutopilotStatus, Inputs, SurfacesSample

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
STICK = SurfacesSample(sequence=1, time_s=0.0, elevator=0.9, aileron=0.3, rudder=-0.3, brake=0.2)


class Reads(ClosedLoop):
    """Its surfaces are read back from a script."""

    def __init__(self, read: Callable[[float], SurfacesSample]) -> None:
        airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
        assert site.air is not None
        world = make_world(
            airframe,
            site,
            seed=1,
            turbulence=0.01,
            field=build_field(site.air),
            sensors=Sensors(imu=MEMS_IMU, surfaces=READ_BACK),
        )
        super().__init__(world, load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH))
        self._read = read

    def _decide(self, inputs: Inputs) -> Output:
        return super()._decide(inputs._replace(surfaces=self._read(inputs.time_s)))

    def last(self, seconds: float) -> Output:
        for _ in range(round(seconds * self.world.step_hz)):
            output = self.tick()
        assert is_flying(output.mode)
        return output


def test_a_stick_before_the_flight_does_not_bend_the_wind() -> None:
    """Its read-back stopped before the module was engaged: as if there were none."""
    nothing = SurfacesSample(sequence=0, time_s=nan, elevator=nan, aileron=nan, rudder=nan)
    without = Reads(lambda _now_s: nothing).last(4.0)
    stopped = Reads(lambda now_s: STICK._replace(time_s=min(now_s, -1.01))).last(4.0)
    assert stopped.air == without.air
    assert stopped.margins.stall_rad == without.margins.stall_rad
    read = Reads(lambda now_s: STICK._replace(time_s=now_s, sequence=1 + round(200 * now_s)))
    for _ in range(200):  # it is accepted while it comes
        bent = read.tick()
    assert bent.air.wind_mps != pytest.approx(without.air.wind_mps, abs=0.2)


def at(time_s: float, read: SurfacesSample) -> Inputs:
    return Inputs(
        time_s=time_s,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=time_s, accepts_surfaces=True, armed=True),
        engage=False,
        surfaces=read,
    )


@pytest.mark.parametrize(("age_s", "is_known"), [(0.0, True), (0.99, True), (1.01, False)])
def test_what_was_read_counts_for_a_second(age_s: float, is_known: bool) -> None:
    found = fresh(at(age_s, STICK)).surfaces
    assert found[:2] == STICK[:2]  # whether they answer is judged by each sample once
    assert [isnan(value) for value in found[2:]] == [not is_known] * 4


@pytest.mark.parametrize("time_s", [nan, inf, -inf])
def test_a_time_that_is_none_changes_nothing_or_makes_it_unknown(time_s: float) -> None:
    read = STICK._replace(time_s=time_s)
    assert isnan(fresh(at(5.0, read)).surfaces.elevator) == (time_s == -inf)
