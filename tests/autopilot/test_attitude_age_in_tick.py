"""Old attitudes through the whole tick: the gains that it flies with follow their age."""

from __future__ import annotations

import pytest

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.lateral_schedule import lateral_bandwidth
from tgl_soar.control.laws import laws_from
from tgl_soar.control.pitch_schedule import AGE_FOUND_S, pitch_gains, schedule_at_age
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import USUAL_SENSORS
from tgl_soar.sim.world import build_field, make_world

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AGE_S = 0.050


def loop_with(delay_s: float) -> ClosedLoop:
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    assert site.air is not None
    world = make_world(
        airframe,
        site,
        seed=1,
        turbulence=0.0,
        field=build_field(site.air),
        sensors=USUAL_SENSORS._replace(attitude=USUAL_SENSORS.attitude._replace(delay_s=delay_s)),
    )
    return ClosedLoop(world, load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH))


@pytest.mark.parametrize("delay_s", [0.005, AGE_S])
def test_every_gain_follows_the_age_of_attitudes(delay_s: float) -> None:
    """1 s is three times what the average takes."""
    loop = loop_with(delay_s)
    for _ in range(200):
        output = loop.tick()
    age = loop.state.memory.gain_age_s
    assert output.active
    assert age == pytest.approx(delay_s, rel=0.1)
    laws = laws_from(loop.values, loop.world.frame, loop.world.aerodynamics, loop.world.ground)
    schedule = schedule_at_age(laws.schedule, age)
    airspeed = output.gains.airspeed_mps
    expected, young = (pitch_gains(laws.pitch, s, airspeed) for s in (schedule, laws.schedule))
    assert output.gains.ele_d == pytest.approx(expected.kd)
    assert output.gains.ele_p == pytest.approx(expected.kp)
    stands = laws.roll.kd * (loop.values["LAT_SPEED"] / airspeed) ** 2
    f = lateral_bandwidth(laws.lateral_schedule, age)
    assert output.gains.ail_d == pytest.approx(f * stands)
    if delay_s < AGE_FOUND_S:
        assert f == 1.0
        assert schedule is laws.schedule
    else:
        # Roll's gains are for 40 ms of latency, of which 7.5 are used: they have to spare.
        assert 0.8 < f < 0.9
        assert output.gains.ele_d < 0.5 * young.kd
