"""A propeller in reserve through the whole tick, in flight, on a line without a place to settle."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any, Final

import msgspec
import numpy as np
import pytest

from tgl_soar.autopilot import Output, step
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.site import HillAir, Start
from tgl_soar.control import power
from tgl_soar.control.forecast import NO_FORECAST, SETTLES
from tgl_soar.control.search.glimpse import Glimpse, task_of
from tgl_soar.control.search.lift_search import LiftSearch, guards_of, sighting_of
from tgl_soar.control.supervisor import (
    BREAKING_OFF,
    CAPTURING,
    FAILED,
    RELEASED,
    SOARING,
)
from tgl_soar.control.throttle import CLOSED, HOME, NO_THROTTLE, NOT_CALLED, OPEN, USED_UP
from tgl_soar.onboard.reports import PowerWords
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, READ_BACK, Sensors
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import AutopilotStatus, Inputs, PositionFix

SITE_PATH = shipped("sites/hill.toml")
# Upstream of the hill: at rest it sinks all the way down the line.
WIND_MPS = 9.5
START = Start(x_m=-21.0, z_m=8.0)
LINE = {"TGL_X": -21.0, "TGL_Z": 8.0}
DT_S: Final = 0.005


def loop_of(budget_s: float, kind: type[ClosedLoop] = ClosedLoop) -> ClosedLoop:
    path = shipped("airframes/eclipson_c_propeller.toml")
    airframe = load_airframe(path)
    site = load_site(SITE_PATH)
    assert isinstance(site.air, HillAir)
    air = msgspec.structs.replace(site.air, wind_mps=WIND_MPS)
    site = msgspec.structs.replace(site, start=START, air=air)
    values = load_parameters(airframe, path, site, SITE_PATH)
    world: World = make_world(
        airframe, site, seed=3, turbulence=0.01, sensors=Sensors(imu=MEMS_IMU, surfaces=READ_BACK)
    )
    return kind(world, values.changed({**LINE, "THR_BUDGET": budget_s}))


@lru_cache(maxsize=4)
def flown(budget_s: float, seconds: float) -> tuple[list[Output], list[float], World]:
    loop = loop_of(budget_s)
    outputs, heights = [], []
    for _ in range(round(200 * seconds)):
        outputs.append(loop.tick())
        heights.append(loop.world.state.z_m)
        if loop.world.crashed or outputs[-1].mode in (RELEASED, FAILED):
            break
    return outputs, heights, loop.world


def test_without_a_budget_the_line_ends_the_flight() -> None:
    outputs, heights, _ = flown(0.0, 20.0)
    assert outputs[-1].mode in (RELEASED, FAILED)
    assert heights[-1] < 3.0
    assert all(output.throttle.fraction == 0.0 for output in outputs)


def test_with_one_it_stays_on_the_line_with_its_height() -> None:
    outputs, heights, world = flown(30.0, 20.0)
    assert not world.crashed
    assert outputs[-1].mode in (CAPTURING, SOARING)
    assert min(heights) > 4.5
    assert {output.throttle.standing for output in outputs} >= {OPEN, CLOSED}
    on_line = [abs(o.line.e_rho_m) for o in outputs if o.mode == SOARING]
    assert on_line
    assert max(on_line) < 0.05
    # The integral that is reported is that of what was sent, and so of what moved the aircraft.
    sent = sum(output.throttle.fraction for output in outputs) / 200.0
    assert outputs[-1].throttle.used_s == pytest.approx(sent)
    assert 0.0 < sent < 30.0


def test_the_search_reads_the_air_without_the_propeller() -> None:
    """With it a place that is half a metre a second short of lift would be one to soar at."""
    loop = loop_of(30.0)
    guards = guards_of(task_of(loop._laws))
    search = LiftSearch(loop._laws.wind.aerodynamics.polar)
    before, read = None, []
    for k in range(int(12.0 / DT_S)):
        output = loop.tick()
        read.append((output.air.wind_mps, output.air.updraft_mps, output.throttle.climb_mps))
        if k % 40 != 39:
            continue
        if before is not None and output.active:
            wind, updraft, pushed = np.mean(read, axis=0).tolist()
            glimpse = Glimpse(
                before=before,
                now=output.vehicle,
                line=output.line,
                wind_mps=wind,
                updraft_mps=updraft,
                pitot=False,
                seeks=True,
                refused=None,
                pushed_mps=pushed,
            )
            look = sighting_of(guards, glimpse)
            assert look is not None
            search.listen(look)
        before, read = output.vehicle, []
    here = loop.world.state
    assert output.throttle.used_s > 1.0
    air_here = search.map.at(here.x_m, here.z_m)
    assert float(np.ravel(air_here.excess_mps)[0]) < -0.3


@pytest.mark.interpreted
def test_who_soars_needs_no_power_for_the_way_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """The height for it is gone, but it soars, and keeps its budget for where it does not."""
    monkeypatch.setattr(power, "time_left", lambda _: 0.0)
    level: Any = SimpleNamespace(
        vehicle=SimpleNamespace(climb_mps=0.0, roll_rad=0.0, pitch_rad=0.0),
        margins=SimpleNamespace(clearance_m=10.0),
        air=SimpleNamespace(airspeed_mps=9.0),
        health=SimpleNamespace(position_ok=True, attitude_ok=True, autopilot_ok=True),
    )
    short: Any = SimpleNamespace(escape=SimpleNamespace(armed=True, left_m=-5.0))
    laws, state = loop_of(20.0)._laws, NO_THROTTLE
    settled = NO_FORECAST._replace(standing=SETTLES, excess_mps=-0.1)
    for mode, forecast, called in (
        (SOARING, settled, NOT_CALLED),
        (BREAKING_OFF, settled, HOME),
        (SOARING, settled._replace(excess_mps=-0.6), HOME),
        (SOARING, NO_FORECAST, NOT_CALLED),  # by what it does: it does not sink
    ):
        after = power.power_step(laws, state, mode, forecast, short, level, DT_S)
        assert after.called == called


def test_the_air_is_read_without_the_propeller() -> None:
    outputs, _, world = flown(30.0, 20.0)
    powered = [o for o in outputs if o.throttle.fraction > 0.2]
    assert len(powered) > 400
    foreseen = np.array([o.forecast.excess_mps for o in powered])
    # It climbs, and there is no lift: -0.5 to -0.7 m/s, as without power at these heights.
    assert -0.9 < np.mean(foreseen) < -0.4
    assert max(o.vehicle.climb_mps for o in powered) > 0.2
    assert abs(outputs[-1].air.updraft_mps - world.wind[2]) < 0.5


def test_a_budget_that_is_used_up_ends_as_without_one() -> None:
    outputs, _, _ = flown(1.5, 30.0)
    assert outputs[-1].mode in (RELEASED, FAILED)
    assert max(output.throttle.used_s for output in outputs) == 1.5
    assert USED_UP in {output.throttle.standing for output in outputs}
    assert len(outputs) > len(flown(0.0, 20.0)[0])


class Silent(ClosedLoop):
    """Fixes stop while there is power."""

    stops_at = 0.0
    last: PositionFix

    def _decide(self, inputs: Inputs) -> Output:
        if self.output is not None and self.output.throttle.fraction > 0.2 and not self.stops_at:
            self.stops_at = inputs.time_s
            self.last = inputs.position
        if self.stops_at:
            inputs = inputs._replace(position=self.last)
        return super()._decide(inputs)


def test_a_place_that_is_lost_closes_it() -> None:
    loop = loop_of(30.0, Silent)
    assert isinstance(loop, Silent)
    fractions = []
    for _ in range(200 * 12):
        output = loop.tick()
        if not output.active and loop.stops_at:
            break
        if loop.stops_at:
            fractions.append((output.health.position_ok, output.throttle.fraction))
    assert fractions
    assert any(fraction > 0.0 for known, fraction in fractions if known)
    assert all(fraction == 0.0 for known, fraction in fractions if not known)
    assert output.throttle.fraction == 0.0


def test_who_disengages_closes_it_and_keeps_the_account() -> None:
    loop = loop_of(30.0)
    while not (loop.output is not None and loop.output.throttle.used_s > 0.2):
        loop.tick()
        assert loop.world.time_s < 20.0
    used_s = loop.output.throttle.used_s
    loop.engage = False
    output = loop.tick()
    assert not output.active
    assert output.throttle.fraction == loop.world.throttle == 0.0
    assert output.throttle.used_s == used_s
    state = loop.state.throttle
    assert (state.push_mps2, state.pitch_rad) == (0.0, 0.0)


def test_disarming_begins_another_flight() -> None:
    loop = loop_of(30.0)
    while not (loop.output is not None and loop.output.throttle.used_s > 0.2):
        loop.tick()
    inputs = Inputs(
        time_s=loop.world.time_s,
        position=loop.world.position,
        attitude=loop.world.attitude,
        autopilot=AutopilotStatus(time_s=loop.world.time_s, accepts_surfaces=True, armed=False),
        engage=False,
    )
    _, output = step(loop._laws, loop.state, inputs)
    assert output.mode not in (CAPTURING, SOARING)
    assert output.throttle.used_s == 0.0


def test_it_is_reported_why_it_opens_what_was_used_and_that_nothing_is_left() -> None:
    reporter = PowerWords()
    outputs, _, _ = flown(1.5, 30.0)
    words = [text for output in outputs for _, text in reporter.look(output)]
    assert words[0] == "throttle: height for the way home"
    assert words[-1] == "throttle used up: 1.5 s"
    reporter = PowerWords()
    outputs, _, _ = flown(30.0, 20.0)
    words = [text for output in outputs for _, text in reporter.look(output)]
    assert any(word.startswith("throttle closed: ") for word in words)
    assert len(words) < 20  # and not at every gust
    reporter = PowerWords()
    assert [word for output in flown(0.0, 20.0)[0] for word in reporter.look(output)] == []
