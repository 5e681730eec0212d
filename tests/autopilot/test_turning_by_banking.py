"""Flights through a firmware that holds pitch and bank itself and turns by banking, emulated.

Its bank follows the setpoint with a time constant, its rudder coordinates turns, and its heading
may be wrong by an angle that it does not report.  Flights of a real PX4 are in docs/autopilots.md.
"""

from __future__ import annotations

from math import cos, degrees, radians, sin, tan
from typing import Final

import pytest
from test_beating_in_tick import hill

from tgl_soar.autopilot import Output
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.laws import HEADING_OFF_RAD, laws_from
from tgl_soar.control.pid import PidState
from tgl_soar.control.supervisor import (
    BREAKING_OFF,
    LANDING,
    RELEASED,
    SOARING,
    is_flying,
)
from tgl_soar.control.surface_loops import surface_gains
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.world import World
from tgl_soar.types import GRAVITY_MPS2, OURS, THEIRS, Inputs, SurfaceCommand

FOLLOWS_S: Final = 0.4  # FW_R_TC as PX4 comes
STEADY_MPS: Final = 7.5


class ThroughFirmware(ClosedLoop):
    """The closed loop with such a firmware between the module and the surfaces."""

    def __init__(self, world: World, values: ParameterSet, heading_off_rad: float = 0.0) -> None:
        super().__init__(world, values)
        self._off_rad = heading_off_rad
        self._roll = self._pitch = PidState(0.0, 0.0)
        self._bank_rad = 0.0
        self._load()

    def _load(self) -> None:
        world = self.world
        self._laws, self._inner = (
            laws_from(self.values, world.frame, world.aerodynamics, world.ground, loops=loops)
            for loops in (THEIRS, OURS)
        )

    def change(self, parameters: dict[str, float]) -> None:
        super().change(parameters)
        self._load()

    def _decide(self, inputs: Inputs) -> Output:
        c, s, a = cos(0.5 * self._off_rad), sin(0.5 * self._off_rad), inputs.attitude
        turned = a._replace(
            qw=c * a.qw - s * a.qz,
            qx=c * a.qx - s * a.qy,
            qy=c * a.qy + s * a.qx,
            qz=c * a.qz + s * a.qw,
        )
        output = super()._decide(inputs._replace(attitude=turned))
        if not output.active:
            self._bank_rad = 0.0
            return output
        asked, now, memory, dt = output.setpoints, output.vehicle, self.state.memory, self._dt_s
        gains = surface_gains(
            self._inner, memory.imu_weight, memory.gain_speed_mps, memory.gain_age_s
        )
        self._bank_rad += (asked.roll_rad - self._bank_rad) * dt / FOLLOWS_S
        trim = self._inner.trim
        self._pitch, elevator = attitude_step(
            gains.pitch, self._pitch, asked.pitch_rad, now.pitch_rad, now.pitch_rate_radps,
            trim.elevator, dt, 0,
        )  # fmt: skip
        self._roll, aileron = attitude_step(
            gains.roll, self._roll, self._bank_rad, now.roll_rad, now.roll_rate_radps,
            trim.aileron, dt, 0,
        )  # fmt: skip
        turn_radps = GRAVITY_MPS2 * tan(now.roll_rad) / output.air.airspeed_mps
        rudder = trim.rudder + gains.heading.pid.kd * (turn_radps - now.heading_rate_radps)
        moved = SurfaceCommand(
            elevator=elevator.output, aileron=aileron.output, rudder=max(-1.0, min(1.0, rudder))
        )
        return output._replace(command=moved)


class Flight:
    """A flight through it, and what of it counts."""

    def __init__(
        self, seed: int, veer_deg: float = 0.0, off_deg: float = 0.0, **changes: float
    ) -> None:
        """veer_deg: of the wind from 18 s on."""
        quiet = {"BEAT_AUTO": 0.0, "ESC_AUTO": 0.0, "VEER_MAX": 0.0, **changes}
        world, values = hill(seed, steady_mps=STEADY_MPS, veer_deg=veer_deg, **quiet)
        self.loop = ThroughFirmware(world, values, radians(off_deg))
        self.outputs: list[Output] = []

    def fly(self, seconds: float) -> Flight:
        for _ in range(round(seconds * self.loop.world.step_hz)):
            self.outputs.append(self.loop.tick())
            if self.outputs[-1].mode == RELEASED or self.loop.world.crashed:
                break
        return self

    def flown(self, last_s: float) -> list[Output]:
        ticks = self.outputs[-round(last_s * self.loop.world.step_hz) :]
        return [each for each in ticks if is_flying(each.mode)]

    def aside_m(self, last_s: float) -> float:
        return max(abs(each.vehicle.y_m) for each in self.flown(last_s))


def test_laws_with_such_a_firmware_count_the_heading_from_where_it_rests() -> None:
    world, values = hill(1)
    for veer_deg, most_deg in ((0.0, 30.0), (45.0, 45.0)):
        changed = values.changed({"VEER_MAX": veer_deg})
        assert laws_from(changed, world.frame, loops=THEIRS).cross_wind.veer_max_rad == (
            pytest.approx(radians(most_deg))
        )
        theirs = laws_from(changed, world.frame, loops=THEIRS)
        assert theirs.beat.veer_max_rad == theirs.cross_wind.veer_max_rad  # within it it stands
        assert degrees(laws_from(changed, world.frame).cross_wind.veer_max_rad) == (
            pytest.approx(veer_deg)
        )
    assert degrees(HEADING_OFF_RAD) == pytest.approx(30.0)


@pytest.mark.parametrize("off_deg", [20.0, -20.0])
def test_a_heading_that_is_wrong_moves_it_by_little_and_for_a_while(off_deg: float) -> None:
    """20 degrees were 50 m here, where the waypoint is 140 m away."""
    flight = Flight(1, off_deg=off_deg).fly(60.0)
    assert flight.outputs[-1].mode == SOARING
    assert flight.aside_m(60.0) < 15.0
    assert flight.aside_m(15.0) < 3.0


@pytest.mark.parametrize("veer_deg", [25.0, -25.0])
def test_a_wind_from_aside_does_not_carry_it_away_and_the_nose_stays_bounded(
    veer_deg: float,
) -> None:
    """With VEER_MAX 0, which is 30 degrees here."""
    flight = Flight(2, veer_deg=veer_deg).fly(75.0)
    assert flight.outputs[-1].mode == SOARING
    assert flight.aside_m(15.0) < 4.0
    headings = [abs(degrees(each.vehicle.heading_rad)) for each in flight.flown(75.0)]
    assert max(headings) < 50.0  # HEADING_OFF_RAD and PSI_MAX


@pytest.mark.parametrize(("veer_deg", "off_deg"), [(20.0, 0.0), (-20.0, 0.0), (-20.0, 20.0)])
def test_it_lands_in_a_cross_wind_and_never_turns_its_back(veer_deg: float, off_deg: float) -> None:
    """A nose beyond 90 degrees disengages; a bank that sought sideways speed turned it there."""
    flight = Flight(1, veer_deg, off_deg, VEER_MAX=45.0).fly(25.0)
    flight.loop.change({"ESC_START": 1.0})
    flight.fly(150.0)
    assert {BREAKING_OFF, LANDING} <= {each.mode for each in flight.outputs}
    assert "ground" in flight.loop.world.crashed
    assert is_flying(flight.outputs[-1].mode)
    assert abs(flight.loop.world.state.x_m - flight.loop.values["LND_X"]) < 20.0
