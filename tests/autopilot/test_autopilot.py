"""One tick, flown: engagement, the line, every fault, and inputs that are no numbers.

The plant is a glider of the published size in a wind whose updraft falls with height: small
enough to be read, and wrong enough that nothing is tuned to it.  The real aircraft model is
flown in tests/sim.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from copy import copy
from itertools import pairwise
from math import cos, inf, isfinite, nan, pi, radians, sin
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import attitude_sample, imu_sample, position_fix

from tgl_soar.autopilot import (
    DT_MAX_S,
    ON_LINE_S,
    AutopilotState,
    Output,
    initial_state,
    mode_name,
    reason_text,
    step,
)
from tgl_soar.config.parameters import PARAMETERS, ParameterSet
from tgl_soar.control import supervisor as modes
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.target_line import e_rho
from tgl_soar.geometry import (
    SoaringFrame,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_from_euler,
)
from tgl_soar.types import (
    STEPPED_SOURCE,
    THEIRS,
    AttitudeSample,
    AutopilotStatus,
    Ground,
    Inputs,
    PositionFix,
    SurfaceCommand,
)

DT = 0.005
FRAME = SoaringFrame(3.0, -4.0, 5.0, radians(240.0))

# Our own, so that retuned defaults change nothing here.
VALUES = ParameterSet().changed(
    {
        "TGL_X": 0.0, "TGL_Z": 1.5, "TGL_LEAN": 15.0, "TGL_LEAN_MIN": 5.0, "TGL_LEAN_MAX": 45.0,
        "TGL_SLEW": 0.3, "TGL_ACCEL": 0.5, "TGL_ROT_SLEW": 5.0, "TGL_CAPTURE": 0.05,
        "RHO_P": 0.75, "RHO_I": 0.2, "RHO_D": 0.36, "RHO_D_FILT": 6.0, "RHO_I_MAX": 8.0,
        "PITCH_TRIM": -2.0, "PITCH_MIN": -15.0, "PITCH_MAX": 8.0, "PITCH_SLEW": 120.0,
        "ELE_P": 4.4, "ELE_I": 4.0, "ELE_D": 0.25, "ELE_D_FILT": 40.0, "ELE_TRIM": 0.0,
        "AIL_P": 1.2, "AIL_I": 0.5, "AIL_D": 0.06, "AIL_D_FILT": 40.0, "AIL_TRIM": 0.0,
        "RUD_P": 1.2, "RUD_D": 0.2, "RUD_D_FILT": 40.0, "RUD_TRIM": 0.0,
        "WPT_X": -8.0, "WPT_R_MIN": 3.0, "PSI_MAX": 20.0, "SURF_MAX": 1.0, "SURF_RATE": 20.0,
        "EST_FIX_SD": 0.003, "EST_VEL_SD": 0.05, "EST_CV_SD": 3.0, "EST_DELAY": 0.0,
        "AGE_POS_HOLD": 0.25, "AGE_POS_MAX": 1.5, "AGE_ATT_MAX": 0.2, "AGE_AP_MAX": 3.0,
        "CAPTURE_MAX": 1.5, "TILT_MAX": 60.0,
    }
)  # fmt: skip
LAWS = laws_from(VALUES, FRAME)


def laws_with(**changes: float) -> Laws:
    return laws_from(VALUES.changed(changes), FRAME)


class Glider:
    """A point mass with lift and drag, and three axes that follow their surfaces.

    0.7 kg, 0.18 m², CL = 0.3 + 4.5 alpha, CD = 0.056 + 0.107 CL²; surface effectiveness 31, 67
    and 18 rad/s² at full throw as published.  Wind 8.6 m/s; updraft equals the sink of that speed
    at the height of 1.5 m and falls by 0.4 m/s for each metre.
    """

    def __init__(self, x: float, y: float, z: float) -> None:
        self.x, self.y, self.z = x, y, z
        self.v, self.gamma = 8.7, -0.155
        self.theta, self.phi, self.psi = -0.04, 0.0, 0.0
        self.q = self.p = self.r = 0.0

    def move(self, command: SurfaceCommand, dt: float) -> None:
        alpha = self.theta - self.gamma
        lift = 0.3 + 4.5 * max(-0.2, min(0.2, alpha))
        press = 0.5 * 1.225 * 0.18 / 0.7 * self.v * self.v
        drag = press * (0.056 + 0.107 * lift * lift)
        self.v += (-drag - 9.81 * sin(self.gamma)) * dt
        self.gamma += (press * lift - 9.81 * cos(self.gamma)) / self.v * dt
        self.q += (31.0 * command.elevator - 11.0 * self.q - 64.0 * (alpha - 0.115)) * dt
        self.p += (67.0 * command.aileron - 20.0 * self.p) * dt
        self.r += (18.0 * command.rudder - 3.0 * self.r) * dt
        self.theta += self.q * dt
        self.phi += self.p * dt
        self.psi += self.r * dt
        vx, vy, climb = self.velocity()
        self.x, self.y, self.z = self.x + vx * dt, self.y + vy * dt, self.z + climb * dt

    def velocity(self) -> tuple[float, float, float]:
        along = self.v * cos(self.gamma)
        updraft = 1.32 - 0.4 * (self.z - 1.5)
        return (
            8.6 - along * cos(self.psi),
            along * sin(self.psi),
            updraft + self.v * sin(self.gamma),
        )

    def fix(self, sequence: int, time: float) -> PositionFix:
        where = ned_from_soaring(FRAME, self.x, self.y, self.z)
        return position_fix(sequence, time, where, ned_vector_from_soaring(FRAME, *self.velocity()))

    def attitude(self, sequence: int, time: float) -> AttitudeSample:
        q = quaternion_from_euler(self.phi, self.theta, FRAME.wind_from_rad + self.psi)
        return attitude_sample(sequence, time, q, (self.p, self.q, self.r))


Corrupt = Callable[[int, Inputs], Inputs]


class Flight:
    """A glider, the tick, and everything that went through it.  Fixes come at 50 Hz.

    It begins ready, after some ticks in a pilot's hand, by default.
    """

    def __init__(
        self,
        laws: Laws = LAWS,
        x: float = 0.25,
        y: float = 0.1,
        z: float = 1.4,
        *,
        ready: bool = True,
    ) -> None:
        self.laws = laws
        self.glider = Glider(x, y, z)
        self.state = initial_state()
        self.inputs: list[Inputs] = []
        self.outputs: list[Output] = []
        self.engage = True
        self.clock = 100.0
        self.latest = PositionFix(
            sequence=0,
            time_s=nan,
            north_m=nan,
            east_m=nan,
            down_m=nan,
            velocity_north_mps=nan,
            velocity_east_mps=nan,
            velocity_down_mps=nan,
        )
        self.ticks = 0
        if ready:
            self.engage = False
            self.fly(4 * DT)
            assert self.outputs[-1].mode == modes.READY
            self.engage = True
            self.glider = Glider(x, y, z)
            self.inputs, self.outputs = [], []

    def fly(self, seconds: float, corrupt: Corrupt = lambda _, i: i) -> Flight:
        for k in range(round(seconds / DT)):
            self.ticks += 1
            n = self.ticks
            now = self.clock + n * DT
            if n % 4 == 1:
                self.latest = self.glider.fix(n, now)
            status = AutopilotStatus(
                time_s=self.clock + (n - n % 200) * DT, accepts_surfaces=True, armed=True
            )
            attitude = self.glider.attitude(n, now)
            inputs = corrupt(
                k,
                Inputs(
                    time_s=now,
                    position=self.latest,
                    attitude=attitude,
                    autopilot=status,
                    engage=self.engage,
                ),
            )
            self.state, output = step(self.laws, self.state, inputs)
            self.inputs.append(inputs)
            self.outputs.append(output)
            self.glider.move(output.command, DT)
        return self

    def changes(self) -> list[tuple[str, str]]:
        """(mode, reason) of every change of mode."""
        rows = [(mode_name(o.mode), reason_text(o.reason)) for o in self.outputs]
        return [row for row in rows if row[1]]

    def distance(self) -> float:
        """e_rho to the operator's line."""
        t = self.laws.target
        return e_rho(t.x_m, t.z_m, t.eta_rad, self.glider.x, self.glider.z)

    def last(self, seconds: float) -> list[Output]:
        return self.outputs[-round(seconds / DT) :]


def soaring() -> Flight:
    """On the line, after a capture."""
    flight = copy(SOARING)
    flight.glider = copy(SOARING.glider)
    flight.inputs, flight.outputs = list(SOARING.inputs), []
    return flight


SOARING = Flight().fly(8.0)


def assert_inside(outputs: list[Output], laws: Laws = LAWS) -> None:
    """Every command a number, within travel, and within rate of the one before."""
    for before, after in zip([None, *outputs], outputs, strict=False):
        assert all(isfinite(u) and abs(u) <= laws.envelope.deflection_max for u in after.command)
        if before is not None and before.active and after.active:
            dt = max(0.0, min(DT_MAX_S, after.time_s - before.time_s))
            most = laws.envelope.rate_max_per_s * dt + 1e-12
            for u, v in zip(before.command, after.command, strict=True):
                assert abs(v - u) <= most


# --- a flight -------------------------------------------------------------------------------


def test_it_engages_captures_and_soars() -> None:
    assert SOARING.changes() == [("capturing", "engaged"), ("soaring", "on the line")]
    flight = Flight()
    flight.engage = False
    flight.fly(0.2)
    assert not flight.outputs[-1].active
    flight.engage = True
    flight.fly(10.0)
    assert flight.changes() == [("capturing", "engaged"), ("soaring", "on the line")]
    assert_inside(flight.outputs)
    # The line starts 0.27 m away and takes d/v + v/a = 1.5 s; the loop's slowest root, ki/kp =
    # 0.17 /s, wears off what the trim is wrong by, a centimetre or two.
    (captured,) = [o.time_s for o in flight.outputs if o.reason == modes.REASON_ON_LINE]
    assert 1.5 + ON_LINE_S <= captured - flight.clock <= 5.0
    assert abs(flight.distance()) < 0.02
    # It rests: pitch holds the wind's speed, height holds where updraft equals sink.
    vx, vy, climb = flight.glider.velocity()
    assert (vx, vy, climb) == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert abs(flight.glider.y) < 0.02
    assert flight.glider.z == pytest.approx(1.5, abs=0.1)


def test_the_line_it_flies_starts_at_the_aircraft_and_ends_on_the_target() -> None:
    flight = Flight().fly(6.0)
    first, last = flight.outputs[0], flight.outputs[-1]
    assert first.line.e_rho_m == pytest.approx(0.0, abs=1e-9)
    assert (first.line.x_m, first.line.z_m) == pytest.approx((0.25, 1.4), abs=1e-3)
    t = LAWS.target
    assert (last.line.x_m, last.line.z_m, last.line.eta_rad) == t
    assert not last.line.moving
    # At every tick the aircraft is near the line that it flies, not the operator's.
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.1


def test_the_operator_moves_the_line_in_flight() -> None:
    flight = soaring()
    flight.laws = laws_with(TGL_X=-0.3, TGL_LEAN=25.0)
    flight.fly(10.0)
    assert flight.changes() == [("capturing", "line moves"), ("soaring", "on the line")]
    assert flight.outputs[0].reason == modes.REASON_LINE_MOVED  # at once
    assert abs(flight.distance()) < 0.02
    # 0.3 m/s from rest within 0.6 s is a mild thing: the aircraft follows within a hand.
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.1
    assert_inside(flight.outputs)


def test_the_first_command_is_the_trim_and_nothing_jumps() -> None:
    laws = laws_with(ELE_TRIM=0.1, AIL_TRIM=-0.05, RUD_TRIM=0.02)
    flight = Flight(laws).fly(0.5)
    first = flight.outputs[0]
    assert (mode_name(first.mode), first.active) == ("capturing", True)
    assert first.command == laws.trim
    assert first.elevator.output == pytest.approx(laws.trim.elevator)
    assert first.aileron.output == pytest.approx(laws.trim.aileron)
    assert first.setpoints.pitch_rad == pytest.approx(first.vehicle.pitch_rad)
    assert_inside(flight.outputs)
    # The elevator follows the pitch, not a step: 2.2 per rad of what the nose has moved.
    assert abs(flight.outputs[1].command.elevator - laws.trim.elevator) < 0.02


def test_the_operator_disengages() -> None:
    flight = soaring()
    flight.engage = False
    flight.fly(0.1)
    assert flight.changes() == [("standby", "operator disengaged"), ("ready", "can be engaged")]
    assert all(not o.active for o in flight.outputs)
    assert all(o.command == SurfaceCommand(0.0, 0.0, 0.0) for o in flight.outputs)
    flight.engage = True
    flight.fly(0.1)
    assert flight.changes()[2:] == [("capturing", "engaged")]


# --- what it is refused, and what it disengages for ----------------------------------------------


def no_position(_: int, inputs: Inputs) -> Inputs:
    return inputs._replace(
        position=PositionFix(
            sequence=0,
            time_s=nan,
            north_m=nan,
            east_m=nan,
            down_m=nan,
            velocity_north_mps=nan,
            velocity_east_mps=nan,
            velocity_down_mps=nan,
        )
    )


def no_attitude(_: int, inputs: Inputs) -> Inputs:
    return inputs._replace(
        attitude=AttitudeSample(
            sequence=0,
            time_s=nan,
            qw=nan,
            qx=nan,
            qy=nan,
            qz=nan,
            roll_rate_frd_radps=nan,
            pitch_rate_frd_radps=nan,
            yaw_rate_frd_radps=nan,
        )
    )


def no_heartbeat(_: int, inputs: Inputs) -> Inputs:
    return inputs._replace(autopilot=AutopilotStatus(time_s=nan, accepts_surfaces=True, armed=True))


def mode_taken(_: int, inputs: Inputs) -> Inputs:
    return inputs._replace(autopilot=inputs.autopilot._replace(accepts_surfaces=False))


def upset(_: int, inputs: Inputs) -> Inputs:
    q = quaternion_from_euler(radians(61.0), 0.0, FRAME.wind_from_rad)
    a = inputs.attitude
    return inputs._replace(attitude=attitude_sample(a.sequence, a.time_s, q))


REFUSALS = [
    (no_position, "position lost"),
    (no_attitude, "attitude lost"),
    (no_heartbeat, "autopilot silent"),
    (mode_taken, "autopilot not in the mode that obeys"),
    (upset, "roll or pitch beyond TILT_MAX"),
]


@pytest.mark.parametrize(("fault", "reason"), REFUSALS)
def test_it_refuses_to_engage_and_stays_released_until_the_request_is_withdrawn(
    fault: Corrupt, reason: str
) -> None:
    flight = Flight(ready=False).fly(0.2, fault)
    assert flight.changes() == [("released", reason)]
    flight.fly(0.5)  # all is well again, and the request still stands
    assert flight.changes() == [("released", reason)]
    assert not any(o.active for o in flight.outputs)
    flight.engage = False
    flight.fly(0.05)
    assert flight.changes()[1:] == [
        ("standby", "engagement withdrawn"),
        ("ready", "can be engaged"),
    ]
    flight.engage = True
    flight.fly(0.05)
    assert flight.changes()[3:] == [("capturing", "engaged")]


def frozen(field: str, flight: Flight) -> Corrupt:
    """One of the inputs stays as it was last."""
    last = getattr(flight.inputs[-1], field)
    return lambda _, inputs: inputs._replace(**{field: last})


@pytest.mark.parametrize(
    ("field", "limit", "reason"),
    [
        ("position", LAWS.guards.position_age_max_s + LAWS.guards.recover_s, "position lost"),
        ("attitude", LAWS.health.attitude_age_max_s, "attitude lost"),
        ("autopilot", LAWS.health.heartbeat_age_max_s, "autopilot silent"),
    ],
)
def test_it_disengages_for_a_silent_input_when_its_age_says(
    field: str, limit: float, reason: str
) -> None:
    flight = soaring()
    stamp = getattr(flight.inputs[-1], field).time_s
    flight.fly(4.0, frozen(field, flight))
    assert flight.changes()[-1] == ("released", reason)
    (when,) = [o.time_s for o in flight.outputs if o.reason and o.mode == modes.RELEASED]
    assert when - stamp == pytest.approx(limit, abs=DT + 1e-6)  # the first tick beyond
    assert when - stamp > limit
    assert_inside(flight.outputs)
    assert not any(o.active for o in flight.outputs if o.time_s >= when)


def banked(_: int, inputs: Inputs) -> Inputs:
    q = quaternion_from_euler(radians(26.0), 0.0, FRAME.wind_from_rad)
    a = inputs.attitude
    return inputs._replace(attitude=attitude_sample(a.sequence, a.time_s, q))


def pitched(_: int, inputs: Inputs) -> Inputs:
    q = quaternion_from_euler(0.0, radians(-26.0), FRAME.wind_from_rad)
    a = inputs.attitude
    return inputs._replace(attitude=attitude_sample(a.sequence, a.time_s, q))


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (mode_taken, REFUSALS[3][1]),
        (banked, REFUSALS[4][1]),
        (pitched, REFUSALS[4][1]),
    ],
)
def test_it_disengages_at_once(fault: Corrupt, reason: str) -> None:
    flight = soaring()
    flight.laws = laws_with(TILT_MAX=25.0)  # less than what no aircraft can turn by in a tick
    flight.fly(0.05, fault)
    assert flight.changes() == [("released", reason)]
    assert flight.outputs[0].mode == modes.RELEASED
    assert not flight.outputs[0].active


def test_it_disengages_from_a_line_that_it_has_lost() -> None:
    # Blown 1.6 m downstream between two fixes.
    def blown(_: int, inputs: Inputs) -> Inputs:
        p = inputs.position
        north, east, down = ned_vector_from_soaring(FRAME, 1.7, 0.0, 0.0)
        moved = p._replace(
            north_m=p.north_m + north, east_m=p.east_m + east, down_m=p.down_m + down
        )
        return inputs._replace(position=moved)

    # Within the gate's reach, so that it is accepted at once.
    flight = soaring()
    flight.laws = laws_with(EST_GATE=5.0)
    flight.fly(0.5, blown)
    assert flight.changes() == [("released", "e_rho beyond CAPTURE_MAX")]


def test_a_place_accepted_after_uncertainty_is_a_new_line_and_no_step() -> None:
    """The tracker has moved its origin: held through, then flown on from where the aircraft is."""

    def moved(_: int, inputs: Inputs) -> Inputs:
        p = inputs.position
        return inputs._replace(position=p._replace(down_m=p.down_m - 1.2))

    flight = soaring()
    flight.laws = laws_with(EST_RESET_MAX=0.0)  # or else the line would move with it
    flight.fly(1.0, moved)
    assert flight.changes() == [
        ("holding", "position gap, holding pitch"),
        ("capturing", "position is back"),
    ]
    flown = [o for o in flight.outputs if o.mode in (modes.CAPTURING, modes.SOARING)]
    assert all(abs(b.line.e_rho_m - a.line.e_rho_m) < 0.05 for a, b in pairwise(flown))


def test_a_reset_moves_the_line_until_the_flight_ends() -> None:
    """Then there is no line to be kept, and an operator is shown what the source reports."""

    def moved(_: int, inputs: Inputs) -> Inputs:
        p = inputs.position
        return inputs._replace(position=p._replace(down_m=p.down_m - 1.2))

    def ended(k: int, inputs: Inputs) -> Inputs:
        return moved(k, inputs)._replace(engage=False)

    flight = soaring().fly(1.0, moved)
    assert flight.changes() == []
    assert flight.outputs[-1].quality.shift_z_m == pytest.approx(1.2, abs=0.05)
    flown = len(flight.outputs)
    flight.fly(0.5, ended)
    assert flight.outputs[flown].quality.shift_z_m != 0.0  # of the tick that ends it
    assert all(output.quality.shift_z_m == 0.0 for output in flight.outputs[flown + 1 :])
    step_m = flight.outputs[flown + 1].vehicle.z_m - flight.outputs[flown].vehicle.z_m
    assert step_m == pytest.approx(1.2, abs=0.05)


def test_a_gap_is_held_through_and_flown_on_from() -> None:
    """0.6 s without a fix: from 0.25 s on pitch, wings and heading are held."""
    flight = soaring()
    flight.fly(0.6, frozen("position", flight)).fly(6.0)
    assert flight.changes() == [
        ("holding", "position gap, holding pitch"),
        ("capturing", "position is back"),
        ("soaring", "on the line"),
    ]
    held = [o for o in flight.outputs if o.mode == modes.HOLDING]
    assert len({o.setpoints for o in held}) == 1
    # The pitch held is the one that held the line: what the integral has reached.
    before = flight.outputs[0]
    expected = LAWS.pitch_trim.trim_pitch_rad + before.soaring.i
    assert held[0].setpoints.pitch_rad == pytest.approx(expected, abs=1e-3)
    back = next(o for o in flight.outputs if o.reason == modes.REASON_POSITION_BACK)
    assert back.line.e_rho_m == 0.0  # the line starts at the aircraft again
    assert abs(flight.distance()) < 0.02
    assert_inside(flight.outputs)


def test_a_gap_while_the_line_moves_leaves_nothing_of_its_speed() -> None:
    """The line starts at the aircraft again, at rest: e_rho's rate is the aircraft's own."""
    flight = soaring()
    flight.laws = laws_with(TGL_X=1.0)
    flight.fly(1.5)
    assert flight.outputs[-1].line.moving
    flight.fly(0.6, frozen("position", flight)).fly(0.1)
    back = next(o for o in flight.outputs if o.reason == modes.REASON_POSITION_BACK)
    v = back.vehicle
    across = e_rho(0.0, 0.0, back.line.eta_rad, v.velocity_x_mps, v.climb_mps)
    assert back.line.e_rho_rate_mps == pytest.approx(across, abs=1e-12)
    assert back.soaring.d == pytest.approx(LAWS.soaring.pid.kd * across, abs=1e-12)


def test_a_short_gap_leaves_the_line_where_it_is() -> None:
    """Fixes at 3 Hz: each interval ends in a hold of 0.1 s, and the line is never dropped."""
    flight = soaring()
    for _ in range(6):
        flight.fly(0.35, frozen("position", flight)).fly(0.1)
    assert flight.outputs[-1].mode in (modes.CAPTURING, modes.SOARING)
    assert sum(o.reason == modes.REASON_POSITION_BACK for o in flight.outputs) == 6
    t = LAWS.target
    assert {(o.line.x_m, o.line.z_m, o.line.eta_rad) for o in flight.outputs} == {tuple(t)}
    assert abs(flight.distance()) < 0.05
    assert_inside(flight.outputs)


def sinking_out_of_sight(inputs: Inputs, since_s: float) -> Inputs:
    """The last positions that are received, for a tenth of a second: it sinks at 0.8 m/s."""
    p = inputs.position
    age = min(0.1, inputs.time_s - since_s)
    lower = p._replace(down_m=p.down_m + 0.8 * age, velocity_down_mps=0.8)
    return inputs._replace(position=lower)


def lost_while_sinking(laws: Laws) -> Flight:
    """The position is lost of an aircraft that sinks, by its estimate, by a metre more."""
    flight = soaring()
    flight.laws = laws
    since = flight.inputs[-1].time_s
    flight.fly(0.1, lambda _, inputs: sinking_out_of_sight(inputs, since))
    return flight.fly(1.3, frozen("position", flight))


GROUND = Ground(2, (-9.0, 9.0, *[0.0] * 6), (0.0,) * 8)


def test_holding_looks_at_the_ground_below_the_estimate() -> None:
    low = laws_from(VALUES.changed({"CLEAR_MIN": 1.0}), FRAME, ground=GROUND)
    flight = lost_while_sinking(low)
    assert flight.changes()[:2] == [
        ("holding", "position gap, holding pitch"),
        ("recovering", "too low"),
    ]
    assert_inside(flight.outputs)


def test_holding_looks_at_the_fence_around_the_estimate() -> None:
    flight = lost_while_sinking(laws_with(FENCE_Z_MIN=1.0))
    assert flight.changes() == [
        ("holding", "position gap, holding pitch"),
        ("released", "outside the fence"),
    ]
    assert flight.outputs[-1].vehicle.z_m < 1.0
    assert_inside(flight.outputs)


def test_recovering_looks_at_the_fence_though_the_position_is_lost() -> None:
    flight = soaring()
    flight.fly(1.6, frozen("position", flight))
    assert flight.outputs[-1].mode == modes.RECOVERING
    place = flight.outputs[-1].vehicle.z_m
    flight.laws = laws_with(FENCE_Z_MIN=place + 0.1)  # as the estimate would come to lie
    flight.fly(2 * DT, frozen("position", flight))
    assert flight.changes()[-1] == ("released", "outside the fence")


def test_fixes_that_never_make_the_position_confident_do_not_keep_it() -> None:
    """One every 1.2 s: in time by its age, and the place is as uncertain before each as ever."""
    held: dict[int, PositionFix] = {}

    def seldom(k: int, inputs: Inputs) -> Inputs:
        return inputs._replace(position=held.setdefault(k // 240, inputs.position))

    flight = soaring().fly(6.0, seldom)
    limit = LAWS.guards.position_age_max_s
    (lost,) = [o.time_s for o in flight.outputs if o.mode == modes.RECOVERING and o.reason]
    assert [change[0] for change in flight.changes()[:2]] == ["holding", "recovering"]
    began = flight.outputs[0].time_s
    assert lost - began == pytest.approx(limit, abs=5 * DT)  # the last good fix is 4 ticks old
    assert flight.changes()[-1][0] == "released"


def test_a_long_gap_is_recovered_from() -> None:
    """Beyond AGE_POS_MAX it glides, wings level, as long as it may; then the line is reset."""
    flight = soaring()
    flight.fly(2.4, frozen("position", flight))
    assert flight.outputs[-1].mode == modes.RECOVERING
    assert flight.outputs[-1].setpoints.pitch_rad == LAWS.envelope.glide_pitch_rad
    level = flight.state.sideways.integral  # as it was learnt
    assert flight.outputs[-1].setpoints.roll_rad == level
    assert abs(level) < radians(1.0)
    flight.laws = laws_with(CAPTURE_MAX=10.0)
    flight.fly(1.0)
    assert flight.changes() == [
        ("holding", "position gap, holding pitch"),
        ("recovering", "position lost"),
        ("capturing", "recovered"),
    ]
    back = next(o for o in flight.outputs if o.reason == modes.REASON_RECOVERED)
    assert back.line.e_rho_m == 0.0
    assert_inside(flight.outputs)


# --- faults of the data -----------------------------------------------------------------------

POSITION_FIELDS = ("time_s", "north_m", "east_m", "down_m", "velocity_north_mps")
ATTITUDE_FIELDS = ("time_s", "qw", "qx", "qy", "qz")


BAD = [
    (part, field, value)
    for part, fields in (("position", POSITION_FIELDS), ("attitude", ATTITUDE_FIELDS))
    for field in fields
    for value in (nan, inf, -inf, 1e300)
    if (part, value) != ("position", 1e300)  # a fix like any other, only far away
]


@pytest.mark.parametrize(("part", "field", "value"), BAD)
def test_one_sample_that_is_no_number_is_flown_through(part: str, field: str, value: float) -> None:
    def corrupt(k: int, inputs: Inputs) -> Inputs:
        if k != 8:
            return inputs
        sample = getattr(inputs, part)._replace(**{"sequence": 10**6, field: value})
        return inputs._replace(**{part: sample})

    flight = soaring().fly(1.0, corrupt)
    assert flight.changes() == []
    assert_inside(flight.outputs)
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.02


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("down_m", []),  # an outlier, and refused
        ("velocity_down_mps", []),  # left out, and the place taken
    ],
)
@pytest.mark.parametrize("value", [1e300, -1e300, 1e308])
def test_a_number_beyond_all_bounds_does_no_harm(
    field: str, changes: list[tuple[str, str]], value: float
) -> None:
    wild: dict[str, Any] = {"sequence": 10**6, field: value}

    def corrupt(k: int, inputs: Inputs) -> Inputs:
        far = inputs.position._replace(time_s=inputs.time_s, **wild)
        return inputs._replace(position=far) if k == 8 else inputs

    flight = soaring().fly(0.2, corrupt)
    assert flight.changes() == changes
    assert_inside(flight.outputs)


def test_a_law_that_has_overflowed_is_caught_behind_it() -> None:
    """No input can leave inf in a filter; were it there all the same: the last limiter holds the
    surfaces, and the next tick disengages."""
    flight = soaring().fly(8 * DT)
    loops = flight.state.loops
    overflowed = loops._replace(heading=loops.heading._replace(rate=inf))
    flight.state = flight.state._replace(loops=overflowed)
    flight.fly(0.2)
    assert flight.changes() == [("failed", "command not finite")]
    assert_inside(flight.outputs)
    held = [o for o in flight.outputs if o.active]
    assert held[-1].command == held[-2].command
    flight.engage = False
    flight.fly(0.05)
    flight.engage = True
    flight.fly(0.5)
    assert flight.changes() == [("failed", "command not finite")]  # until it is started again


@pytest.mark.parametrize(
    "field", ["roll_rate_frd_radps", "pitch_rate_frd_radps", "yaw_rate_frd_radps"]
)
def test_lost_gyros_are_flown_without(field: str) -> None:
    # The rates are then differences of the angles, for as long as it lasts.
    lost: dict[str, Any] = {field: nan}

    def corrupt(_: int, inputs: Inputs) -> Inputs:
        return inputs._replace(attitude=inputs.attitude._replace(**lost))

    flight = soaring().fly(3.0, corrupt)
    assert flight.changes() == []
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.02


def test_a_hundred_bad_attitudes_are_too_many() -> None:
    """0.5 s without an attitude is longer than may be flown blind."""

    def corrupt(_: int, inputs: Inputs) -> Inputs:
        return inputs._replace(attitude=inputs.attitude._replace(qw=nan))

    flight = soaring().fly(100 * DT, corrupt)
    assert flight.changes() == [("released", "attitude lost")]
    assert_inside(flight.outputs)
    assert flight.outputs[-1].health.rejected == 100


def test_a_hundred_bad_positions_are_a_gap() -> None:
    def corrupt(k: int, inputs: Inputs) -> Inputs:
        bad = inputs.position._replace(sequence=10**6 + k, down_m=nan)
        return inputs._replace(position=bad) if k < 100 else inputs

    flight = soaring().fly(6.0, corrupt)
    assert [mode for mode, _ in flight.changes()] == ["holding", "capturing", "soaring"]
    assert_inside(flight.outputs)
    assert abs(flight.distance()) < 0.02


def test_half_a_second_of_silence_ends_the_flight_and_not_the_module() -> None:
    flight = soaring()
    last = flight.inputs[-1]
    flight.fly(0.5, lambda _, i: last._replace(time_s=i.time_s))
    assert flight.changes()[-1] == ("released", "attitude lost")
    flight.engage = False
    flight.fly(0.1)
    flight.glider.theta, flight.glider.gamma, flight.glider.v = -0.04, -0.155, 8.7  # the pilot
    flight.glider.q = 0.0
    flight.engage = True
    flight.fly(0.1)
    assert flight.changes()[-1] == ("capturing", "engaged")
    assert_inside(flight.outputs)


def test_one_sample_in_five_lost_costs_nothing() -> None:
    """Of attitude and position each, at random: the ages stay far below their limits."""
    dice = random.Random(7)
    kept: dict[str, Any] = {}

    def lossy(_: int, inputs: Inputs) -> Inputs:
        for part in ("position", "attitude"):
            if part not in kept or dice.random() >= 0.2:
                kept[part] = getattr(inputs, part)
        return inputs._replace(**kept)

    flight = soaring().fly(5.0, lossy)
    assert flight.changes() == []
    # A surface that is commanded 5 ms later now and then moves the line by less than a centimetre.
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.01
    assert_inside(flight.outputs)


def test_reordered_samples_are_left_out_and_cost_nothing() -> None:
    """Every tenth tick brings a sample of before under a new number: the newest is flown with."""
    earlier: list[Inputs] = []

    def reordered(k: int, inputs: Inputs) -> Inputs:
        earlier.append(inputs)
        if k % 10 != 9:
            return inputs
        old = earlier[k - 6]
        return inputs._replace(
            position=old.position._replace(sequence=10**6 + k),
            attitude=old.attitude._replace(sequence=10**6 + k),
        )

    flight = soaring().fly(2.0, reordered)
    assert flight.changes() == []
    assert flight.outputs[-1].health.rejected >= 40  # a fix may also repeat the one before
    assert max(abs(o.line.e_rho_m) for o in flight.outputs) < 0.01
    assert_inside(flight.outputs)


def test_duplicates_change_no_command() -> None:
    """Every other tick repeats the last samples under new numbers."""

    def doubled(k: int, inputs: Inputs) -> Inputs:
        p, a = inputs.position, inputs.attitude
        return inputs._replace(position=p._replace(sequence=2 * k + 10**6 + p.sequence), attitude=a)

    plain, twice = soaring().fly(1.0), soaring().fly(1.0, doubled)
    assert [o.command for o in twice.outputs] == [o.command for o in plain.outputs]
    assert twice.outputs[-1].health.rejected > 0


def jump(seconds: float) -> Corrupt:
    """From tick 10 on every time stamp is off: the clock itself has jumped."""

    def corrupt(k: int, inputs: Inputs) -> Inputs:
        if k < 10:
            return inputs
        p, a, s = inputs.position, inputs.attitude, inputs.autopilot
        fresh = p.sequence > 1600 + 10  # what was stamped before keeps its stamp
        return Inputs(
            time_s=inputs.time_s + seconds,
            position=p._replace(time_s=p.time_s + seconds) if fresh else p,
            attitude=a._replace(time_s=a.time_s + seconds),
            autopilot=s,
            engage=inputs.engage,
        )

    return corrupt


@pytest.mark.parametrize(
    ("seconds", "then"),
    [
        (0.02, []),
        (0.5, ["holding", "capturing", "soaring"]),  # the last fix is half a second old
        (1.0, ["holding", "capturing", "soaring"]),
        # The first fix after it resets the place, and it is confident again 0.4 s later:
        # beyond AGE_POS_MAX.
        (1.2, ["holding", "recovering", "capturing", "soaring"]),
        (60.0, ["released"]),
    ],
)
def test_a_clock_that_jumps_forward(seconds: float, then: list[str]) -> None:
    # What is old by the clock is old: nothing, a gap, or a loss.
    flight = soaring().fly(3.0, jump(seconds))
    assert [mode for mode, _ in flight.changes()] == then
    assert_inside(flight.outputs)


@pytest.mark.parametrize("seconds", [-0.02, -0.5, -60.0])
def test_a_clock_that_goes_back(seconds: float) -> None:
    flight = soaring().fly(2.0, jump(seconds))
    assert_inside(flight.outputs)
    if seconds == -0.02:
        assert flight.changes() == []
        assert abs(flight.distance()) < 0.02
    else:
        # Samples of the future are of unknown age: what is known of the position expires in
        # the tick of the jump, and a heartbeat that far ahead counts as silence.
        changes = [mode for mode, _ in flight.changes()]
        if seconds == -0.5:
            assert changes == ["holding", "recovering", "capturing", "soaring"]
            assert flight.outputs[10].mode == modes.HOLDING
        else:
            assert changes == ["released"]
            assert flight.outputs[10].mode == modes.RELEASED


def test_after_the_clock_has_gone_back_it_can_be_engaged_again() -> None:
    flight = soaring().fly(0.5, jump(-60.0))
    flight.clock -= 60.0
    flight.glider = Glider(0.1, 0.0, 1.5)
    flight.engage = False
    flight.fly(1.5)
    flight.glider = Glider(0.1, 0.0, 1.5)
    flight.engage = True
    flight.fly(1.0)
    assert flight.changes()[-1] == ("capturing", "engaged")
    assert abs(flight.outputs[-1].vehicle.x_m - flight.glider.x) < 0.01


@pytest.mark.parametrize("now", [nan, inf, -inf])
def test_a_tick_without_a_time_disengages(now: float) -> None:
    def corrupt(k: int, inputs: Inputs) -> Inputs:
        return inputs._replace(time_s=now) if k == 5 else inputs

    flight = soaring().fly(0.1, corrupt)
    assert [mode for mode, _ in flight.changes()] == ["released"]
    assert_inside(flight.outputs[:5] + flight.outputs[6:])
    assert all(isfinite(u) for u in flight.outputs[5].command)


@pytest.mark.parametrize("flies", [False, True])
@pytest.mark.parametrize("now", [nan, inf, -inf])
def test_after_a_tick_without_a_time_the_estimates_are_numbers_again(
    now: float, flies: bool
) -> None:
    def corrupt(k: int, inputs: Inputs) -> Inputs:
        imu = imu_sample(flight.ticks, inputs.time_s, (0.0, 0.0, -9.81))
        return inputs._replace(imu=imu, time_s=now if k == bad else inputs.time_s)

    flight, bad = Flight(ready=flies), 100 if flies else 0  # accelerations are in use by then
    flight.engage = flies
    flight.fly(2.0, corrupt)
    output, memory = flight.outputs[-1], flight.state.memory
    assert output.quality.inertial
    assert all(isfinite(number) for number in output.vehicle)
    assert all(isfinite(number) for number in memory.motion.errors[:-1])
    assert all(isfinite(number) for number in memory.motion.errors.covariance)
    assert isfinite(memory.wind.average.forward_mps)
    assert mode_name(output.mode) == ("failed" if flies else "ready")


# --- the tick itself --------------------------------------------------------------------------


def test_two_ticks_of_the_same_time_are_one() -> None:
    flight = soaring()
    state, inputs = flight.state, flight.inputs[-1]
    again, output = step(LAWS, state, inputs)
    assert output.command == flight.state.loops.limited.command
    assert again.loops.pitch == state.loops.pitch
    assert again.loops.roll == state.loops.roll
    assert again.soaring.pid == state.soaring.pid
    assert again.line == state.line


def standing(
    k: int, roll: float = 0.0, pitch: float = -0.04, x: float = 0.0, frame: SoaringFrame = FRAME
) -> Inputs:
    """An aircraft that nothing moves: nailed to a place, at an attitude."""
    now = 50.0 + k * DT
    where = ned_from_soaring(frame, x, 0.0, 1.5)
    still = ned_vector_from_soaring(frame, 0.0, 0.0, 0.0)
    q = quaternion_from_euler(roll, pitch, frame.wind_from_rad)
    return Inputs(
        time_s=now,
        position=position_fix(k + 3, now, where, still),
        attitude=attitude_sample(k + 3, now, q),
        autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
        engage=True,
    )


def ready(laws: Laws = LAWS, **place: Any) -> AutopilotState:
    """After two ticks that find all that is needed; the next one engages."""
    state = initial_state()
    for k in (-2, -1):
        state, _ = step(laws, state, standing(k, **place))
    return state


def stood(laws: Laws, ticks: int, **place: Any) -> Iterator[Output]:
    """By a source that may say the same again."""
    state = ready(laws, **place)
    for k in range(ticks):
        inputs = standing(k, **place)
        again = inputs.position._replace(source=STEPPED_SOURCE)
        state, output = step(laws, state, inputs._replace(position=again))
        yield output


def test_every_loop_runs_once_a_tick() -> None:
    """A standing error, integral gains alone: after n ticks each integral is ki e n dt."""
    laws = laws_with(
        RHO_P=0.0, RHO_D=0.0, RHO_I=0.02, TGL_X=0.2, PITCH_SLEW=1000.0,
        ELE_P=0.0, ELE_D=0.0, ELE_I=1.0,
        AIL_P=0.0, AIL_D=0.0, AIL_I=1.0,
        TGL_SLEW=1.0, TGL_ACCEL=5.0, AGE_FROZEN=10.0,
    )  # fmt: skip
    outputs = list(stood(laws, 601, roll=0.1))
    assert {o.mode for o in outputs} == {modes.CAPTURING}
    # Roll: from the first tick on, at which dt is zero.
    assert outputs[200].aileron.i == pytest.approx(-0.1 * 1.0 * 200 * DT, rel=1e-9)
    # e_rho: once the line has arrived, so many ticks, so many equal steps.
    arrived = next(k for k, o in enumerate(outputs) if not o.line.moving)
    distance = outputs[-1].line.e_rho_m
    assert distance == pytest.approx(0.2 * cos(radians(15.0)), rel=1e-6)
    n = 600 - arrived
    assert n > 100
    gained = outputs[600].soaring.i - outputs[arrived].soaring.i
    assert gained == pytest.approx(0.02 * distance * n * DT, rel=1e-6)
    # Pitch: the sum of its errors, tick by tick.
    errors = [o.setpoints.pitch_rad - o.vehicle.pitch_rad for o in outputs[1:]]
    expected = outputs[0].elevator.i + sum(errors) * DT
    assert outputs[-1].elevator.i == pytest.approx(expected, rel=1e-9)
    # And no tick left out.
    for name in ("soaring", "elevator", "aileron"):
        integrals = [getattr(o, name).i for o in outputs[arrived:]]
        assert len(set(integrals)) == len(integrals), name


def test_the_line_moves_once_a_tick() -> None:
    outputs = list(stood(laws_with(TGL_X=-1.0, AGE_FROZEN=10.0), 400))
    cruising = outputs[200:300]
    moved = cruising[0].line.x_m - cruising[-1].line.x_m
    # Sideways at 0.3 m/s: along its normal, of which cos(lean) is along x.
    assert moved == pytest.approx(0.3 * cos(radians(15.0)) * 99 * DT, rel=1e-6)


def test_a_turning_aircraft_is_damped_from_the_first_tick() -> None:
    """The filters start at the rates that are flown, not at rest: damping needs no time to wake."""
    first = standing(0)
    turning = first.attitude._replace(
        roll_rate_frd_radps=0.3, pitch_rate_frd_radps=-0.4, yaw_rate_frd_radps=0.5
    )
    _, output = step(LAWS, ready(), first._replace(attitude=turning))
    v = output.vehicle
    assert output.active
    assert output.aileron.d == pytest.approx(-LAWS.roll.kd * v.roll_rate_radps)
    assert output.elevator.d == pytest.approx(-LAWS.pitch.kd * v.pitch_rate_radps)
    assert output.rudder.d == pytest.approx(-LAWS.heading.pid.kd * v.heading_rate_radps)
    assert v.pitch_rate_radps < 0.0 < v.heading_rate_radps


def test_where_the_elevator_cannot_follow_the_outer_loop_waits() -> None:
    """It integrates e_rho on unless that would pitch further to the side that is blocked."""
    flight = Flight().fly(1.0)  # captured, off the line
    laws, state, inputs = flight.laws, flight.state, flight.inputs[-1]
    later = inputs._replace(time_s=inputs.time_s + DT)

    def integrated(blocked: int) -> float:
        limited = state.loops.limited._replace(elevator_blocked=blocked)
        before = state._replace(loops=state.loops._replace(limited=limited))
        after, output = step(laws, before, later)
        assert output.active
        return after.soaring.pid.integral - state.soaring.pid.integral

    free = integrated(0)
    assert abs(free) > 1e-9
    side = 1 if free > 0.0 else -1
    assert integrated(-side) == free
    assert integrated(side) == 0.0


@pytest.mark.parametrize(
    ("loop", "blocked"), [("pitch", "elevator_blocked"), ("roll", "aileron_blocked")]
)
def test_where_a_surface_cannot_follow_its_loop_waits(loop: str, blocked: str) -> None:
    """Each loop gets the limit of its own surface, and of no other."""
    flight = Flight().fly(1.0)
    state, last = flight.state, flight.inputs[-1]
    laws = flight.laws._replace(
        pitch=flight.laws.pitch._replace(ki=1.0), roll=flight.laws.roll._replace(ki=1.0)
    )
    turned = last.attitude._replace(qx=last.attitude.qx + 0.05)
    later = last._replace(time_s=last.time_s + DT, attitude=turned)

    def integrated(name: str, side: int) -> float:
        limits: dict[str, Any] = {name: side}
        limited = state.loops.limited._replace(**limits)
        before = state._replace(loops=state.loops._replace(limited=limited))
        after, output = step(laws, before, later)
        assert output.active
        then, now = getattr(state.loops, loop), getattr(after.loops, loop)
        return float(now.integral - then.integral)

    free = integrated(blocked, 0)
    assert abs(free) > 1e-6
    side = 1 if free > 0.0 else -1
    # The outer loop gets the limit as well, and moves the setpoint a little.
    assert integrated(blocked, -side) == pytest.approx(free, rel=0.01)
    assert integrated(blocked, side) == 0.0
    (other,) = {"elevator_blocked", "aileron_blocked"} - {blocked}
    assert integrated(other, side) == pytest.approx(free, rel=0.01)


def test_a_long_pause_is_not_integrated_over() -> None:
    laws = laws_with(AIL_P=0.0, AIL_D=0.0, AIL_I=1.0)
    state = ready(laws, roll=0.1)
    for k in (0, 1, 2, 200):  # a second's pause
        state, output = step(laws, state, standing(k, roll=0.1))
    assert output.aileron.i == pytest.approx(-0.1 * (2 * DT + DT_MAX_S), rel=1e-9)


def test_the_same_inputs_give_the_same_outputs_bit_for_bit() -> None:
    """A replay of a recorded flight, with a gap, noise and a moved line in it."""
    dice = random.Random(3)

    def noisy(_: int, inputs: Inputs) -> Inputs:
        p = inputs.position
        return inputs._replace(position=p._replace(down_m=p.down_m + dice.gauss(0.0, 0.001)))

    flight = Flight(ready=False).fly(4.0, noisy)
    flight.fly(0.6, frozen("position", flight)).fly(2.0)
    states, outputs = [initial_state()], []
    for inputs in flight.inputs:
        state, output = step(LAWS, states[-1], inputs)
        states.append(state)
        outputs.append(output)
    assert repr(outputs) == repr(flight.outputs)  # NaN is not equal to itself, its repr is
    assert repr(states[-1]) == repr(flight.state)
    # Out of order too: nothing is kept but the state that is handed in.
    for k in random.Random(1).sample(range(len(outputs)), 50):
        state, output = step(LAWS, states[k], flight.inputs[k])
        assert repr((state, output)) == repr((states[k + 1], outputs[k]))


def test_the_log_holds_what_makes_up_each_output() -> None:
    """On the line, through a gap, and back."""
    flight = soaring()
    flight.fly(0.6, frozen("position", flight)).fly(1.0)
    assert {o.mode for o in flight.outputs} >= {modes.SOARING, modes.HOLDING, modes.CAPTURING}
    for o in flight.outputs:
        for terms in (o.soaring, o.elevator, o.aileron, o.rudder, o.sideways):
            assert terms.saturated == 0
            parts = terms.feedforward + terms.p + terms.i + terms.d
            assert terms.output == pytest.approx(parts, abs=1e-12)
        if o.mode != modes.HOLDING:
            assert o.soaring.p == pytest.approx(LAWS.soaring.pid.kp * o.line.e_rho_m)
        assert o.setpoints.roll_rad == o.sideways.output


# --- inputs that are anything -----------------------------------------------------------------

anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-20.0, 20.0),
    st.sampled_from([nan, inf, -inf, 0.0, 1.0, 1e308, -1e308, 5e-324]),
)
times = st.one_of(anything, st.floats(107.9, 109.0))
sequences = st.integers(0, 3000)
any_inputs = st.builds(
    Inputs,
    times,
    st.builds(PositionFix, sequences, times, *([anything] * 6)),
    st.builds(AttitudeSample, sequences, times, *([anything] * 7)),
    st.builds(AutopilotStatus, times, st.booleans(), st.booleans()),
    st.booleans(),
)
START: tuple[tuple[AutopilotState, Inputs], ...] = (
    (initial_state(), SOARING.inputs[0]),
    (SOARING.state, SOARING.inputs[-1]),
)


@settings(deadline=None, max_examples=300)
@given(data=st.data(), start=st.sampled_from(START), ticks=st.lists(any_inputs, max_size=6))
def test_no_inputs_raise_and_no_command_leaves_the_envelope(
    data: st.DataObject, start: tuple[AutopilotState, Inputs], ticks: list[Inputs]
) -> None:
    """From standby and from the middle of a flight; good parts and bad ones in any mixture."""
    state, last = start
    command = state.loops.limited.command
    was_active, before = modes.is_flying(state.supervisor.mode), state.time_s
    for k, wild in enumerate(ticks, 1):
        good = last._replace(
            time_s=last.time_s + k * DT,
            attitude=last.attitude._replace(
                sequence=last.attitude.sequence + k, time_s=last.time_s + k * DT
            ),
        )
        parts = data.draw(st.sets(st.sampled_from(Inputs._fields)))
        inputs = good._replace(**{name: getattr(wild, name) for name in parts})
        state, output = step(LAWS, state, inputs)
        assert all(-1.0 <= u <= 1.0 for u in output.command)  # false for NaN
        assert output.active == modes.is_flying(output.mode)
        if output.active and was_active:
            passed = inputs.time_s - before
            dt = min(DT_MAX_S, passed) if passed > 0.0 else 0.0
            for u, v in zip(command, output.command, strict=True):
                assert abs(v - u) <= 20.0 * dt + 1e-12
        command, was_active, before = output.command, output.active, inputs.time_s


@settings(deadline=None)
@given(data=st.data())
def test_any_parameters_within_range_give_laws_that_fly(data: st.DataObject) -> None:
    names = data.draw(st.sets(st.sampled_from(list(PARAMETERS)), max_size=12))
    values = VALUES
    for p in names:
        value = data.draw(st.floats(p.minimum, p.maximum))
        try:
            values = values.changed({p.name: round(value) if p.integer else value})
        except ValueError:
            continue  # contradicts another
    laws = laws_from(values, FRAME)
    for output in stood(laws, 30, roll=0.2, pitch=0.1, x=0.3):
        travel = laws.envelope.deflection_max
        assert all(-travel <= u <= travel for u in output.command)
        if output.active:
            low, high = laws.soaring.pid.output_min, laws.soaring.pid.output_max
            assert low - 1e-9 <= output.setpoints.pitch_rad <= high + 1e-9


# --- parameters to laws -----------------------------------------------------------------------

LINE = {"TGL_X", "TGL_Z", "TGL_LEAN", "TGL_SLEW", "TGL_ACCEL", "TGL_ROT_SLEW", "TGL_CAPTURE"}
TOPICS = {
    "RHO",
    "PITCH",
    "ELE",
    "AIL",
    "RUD",
    "WPT",
    "PSI",
    "SURF",
    "EST",
    "AGE",
    "REC",
    "ALPHA",
    "SPEED",
    "SINK",
    "CLEAR",
    "FENCE",
    "TILT",
    "CAPTURE",
}


@pytest.mark.parametrize(
    "name", [p.name for p in PARAMETERS if p.name in LINE or p.name.split("_")[0] in TOPICS]
)
def test_every_parameter_of_the_laws_reaches_them(name: str) -> None:
    # ELE_FREQ and its like act where another airframe is known.
    other = {"DYN_SPEED": 9.0, "DYN_FREQ": 9.0, "DYN_DAMP": 0.7, "DYN_EFFECT": 20.0}
    known = VALUES.changed({**other, "DYN_SERVO": 0.06})
    before = laws_from(known, FRAME)
    p = next(p for p in PARAMETERS if p.name == name)
    for part in (0.02, -0.02):
        changed = known[name] + part * (p.maximum - p.minimum)
        if p.integer:  # a switch
            changed = p.maximum if known[name] == p.minimum else p.minimum
        try:
            values = known.changed({name: changed})
        except ValueError:
            continue
        assert laws_from(values, FRAME) != before
        return
    pytest.fail("could not be changed either way")


def test_units_are_turned_to_si() -> None:
    hertz = ("RHO_D_FILT", "ELE_D_FILT", "AIL_D_FILT", "RUD_D_FILT")
    laws = laws_with(
        PITCH_TRIM=-2.0, PITCH_MIN=-11.0, PITCH_MAX=7.0, PITCH_SLEW=50.0, RHO_I_MAX=6.0,
        TGL_LEAN=20.0, TGL_ROT_SLEW=4.0, TILT_MAX=45.0, PSI_MAX=15.0,
        **{name: 3.0 + n for n, name in enumerate(hertz)},
    )  # fmt: skip
    assert (
        laws.soaring.pid.rate_filter_radps,
        laws.pitch.rate_filter_radps,
        laws.roll.rate_filter_radps,
        laws.heading.pid.rate_filter_radps,
    ) == pytest.approx([2.0 * pi * (3.0 + n) for n in range(4)])
    assert (
        laws.pitch_trim.trim_pitch_rad,
        laws.soaring.pid.output_min,
        laws.soaring.pid.output_max,
        laws.soaring.slew_radps,
        laws.soaring.pid.integral_max,
        laws.target.eta_rad,
        laws.line.turn_rate_radps,
        laws.guards.tilt_max_rad,
        laws.heading.heading_max_rad,
    ) == pytest.approx([radians(d) for d in (-2.0, -11.0, 7.0, 50.0, 6.0, 110.0, 4.0, 45.0, 15.0)])
    assert laws.heading.pid.ki == 0.0  # eq. 18 has none


def test_a_turned_site_is_flown_with_the_same_commands() -> None:
    """The same flight at a site with wind from elsewhere: no sign hides in a direction."""
    elsewhere = SoaringFrame(-30.0, 7.0, 1.0, radians(17.0))
    here = stood(LAWS, 200, roll=0.1, x=0.2)
    there = stood(laws_from(VALUES, elsewhere), 200, roll=0.1, x=0.2, frame=elsewhere)
    for a, b in zip(here, there, strict=True):
        assert a.command == pytest.approx(b.command, abs=1e-9)


def test_gains_for_accelerations_are_those_of_our_own_inner_loops_alone() -> None:
    values = VALUES.changed({"RHO_P": 0.7, "RHO_P_IMU": 1.8})
    ours, theirs = laws_from(values, FRAME), laws_from(values, FRAME, loops=THEIRS)
    assert ours.soaring_imu.pid.kp == pytest.approx(1.8)
    assert ours.soaring.pid.kp == pytest.approx(0.7)
    assert theirs.soaring_imu == theirs.soaring == ours.soaring
