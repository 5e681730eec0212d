"""The multisine through the whole tick: it is added where it says, and the limits stay over it."""

from __future__ import annotations

from functools import lru_cache
from math import radians

import pytest

from tgl_soar.autopilot import AutopilotState, Output, step
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.control.envelope import CUT_NOSE_UP, MARGIN_FULL
from tgl_soar.control.excitation import FAULTY, IDLE, NEAR_STALL, NOT_SOARING, RUNNING
from tgl_soar.control.laws import Laws
from tgl_soar.control.supervisor import CAPTURING, SOARING, STANDBY
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import Inputs

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
STARTED_S, FLOWN_S = 8.0, 12.0


class Recorded(ClosedLoop):
    """A closed loop that keeps what each tick was flown with."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self.ticks: list[tuple[Laws, AutopilotState, Inputs, Output]] = []

    def _decide(self, inputs: Inputs) -> Output:
        before = self.state
        output = super()._decide(inputs)
        self.ticks.append((self._laws, before, inputs, output))
        return output


@lru_cache(maxsize=1)
def flight() -> tuple[tuple[Laws, AutopilotState, Inputs, Output], ...]:
    """On the line, then with the multisine, at 1 %."""
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    values = load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH)
    assert site.air is not None
    world = make_world(
        airframe,
        site,
        seed=1,
        turbulence=0.01,
        field=build_field(site.air),
        sensors=Sensors(imu=MEMS_IMU),
    )
    loop = Recorded(world, values.changed(line_parameters(site.lines["b"])), None)
    for k in range(round(FLOWN_S * 200)):
        if k == round(STARTED_S * 200):
            loop.change({"EXC_START": 1.0})
        loop.tick()
    return tuple(loop.ticks)


def test_it_is_added_to_the_soaring_laws_setpoint_and_to_nothing_else() -> None:
    running = [tick for tick in flight() if tick[3].excitation.standing == RUNNING]
    assert len(running) == round((FLOWN_S - STARTED_S) * 200)
    assert max(abs(o.excitation.pitch_rad) for *_, o in running) > radians(0.5)
    for laws, state, inputs, output in running[::50]:
        quiet = laws._replace(excitation=laws.excitation._replace(wanted=False))
        _, without = step(quiet, state, inputs)
        added = output.setpoints.pitch_rad - without.setpoints.pitch_rad
        assert added == pytest.approx(output.excitation.pitch_rad, abs=1e-12)
        assert output.soaring == without.soaring
        assert output.command[1:] == without.command[1:]
        gain = output.gains.ele_p + output.gains.ele_i * 0.005
        moved = output.elevator.output - without.elevator.output
        assert moved == pytest.approx(gain * added, abs=1e-9)


def test_without_a_request_a_tick_adds_nothing() -> None:
    before = [output for *_, output in flight() if output.time_s < STARTED_S - 0.01]
    assert {output.excitation.standing for output in before} == {IDLE}
    assert {output.excitation.pitch_rad for output in before} == {0.0}


def test_the_envelopes_limit_of_the_setpoint_stays_over_the_sum() -> None:
    """A margin between what ends the multisine and what the envelope leaves alone."""
    laws, state, inputs, output = flight()[-1]
    alpha_max_rad = output.air.alpha_rad + 0.6 * MARGIN_FULL
    tight = laws._replace(envelope=laws.envelope._replace(alpha_max_rad=alpha_max_rad))
    risen = state.soaring._replace(pitch_setpoint_rad=output.vehicle.pitch_rad + MARGIN_FULL)
    _, limited = step(tight, state._replace(soaring=risen), inputs)
    assert limited.excitation.standing == RUNNING
    assert limited.excitation.pitch_rad == output.excitation.pitch_rad
    highest_rad = limited.vehicle.pitch_rad + limited.margins.stall_rad
    assert limited.setpoints.pitch_rad == pytest.approx(highest_rad)
    assert limited.cut & CUT_NOSE_UP
    stalling = laws._replace(envelope=laws.envelope._replace(alpha_max_rad=output.air.alpha_rad))
    _, stopped = step(stalling, state, inputs)
    assert stopped.excitation.standing == NEAR_STALL


@pytest.mark.parametrize("what", ["line", "fault", "release"])
def test_whatever_is_odd_ends_it_in_that_tick(what: str) -> None:
    laws, state, inputs, output = flight()[-1]
    assert output.mode == SOARING
    if what == "line":
        target = laws.target._replace(x_m=laws.target.x_m + 0.3)
        laws, expected, mode = laws._replace(target=target), NOT_SOARING, CAPTURING
    elif what == "fault":
        inputs = inputs._replace(
            attitude=inputs.attitude._replace(
                sequence=inputs.attitude.sequence + 1, qw=float("nan")
            )
        )
        expected, mode = FAULTY, SOARING
    else:
        inputs = inputs._replace(engage=False)
        expected, mode = NOT_SOARING, STANDBY
    state, after = step(laws, state, inputs)
    assert (after.excitation.standing, after.excitation.pitch_rad) == (expected, 0.0)
    assert after.mode == mode
    # It stays so while the request stands, whatever gets better.
    state, later = step(laws, state, inputs._replace(time_s=inputs.time_s + 0.005, engage=True))
    assert later.excitation == after.excitation
