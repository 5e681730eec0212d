"""One tick from a flight on its line, and what a single number in it does to the output.

What a part gives is put in its place: the tick is what adds it up.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isnan, nan, radians
from typing import Any

import pytest
from test_autopilot import DT, FRAME, LAWS, VALUES, Flight, laws_with, soaring

import tgl_soar.autopilot
from tgl_soar.autopilot import (
    AutopilotState,
    Output,
    entry_lacks,
    fault_text,
    initial_state,
    reason_text,
    step,
)
from tgl_soar.control import supervisor as modes
from tgl_soar.control.envelope import CUT_MODE, CUT_NOSE_UP
from tgl_soar.control.estimates import estimate
from tgl_soar.control.excitation import IDLE, RUNNING
from tgl_soar.control.heading import bank_setpoint, heading_setpoint
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidState
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.target_line import LineState, TargetLine, e_rho
from tgl_soar.estimation.health import STREAM_FAULTS, fault_words
from tgl_soar.types import THEIRS, Inputs, SurfaceCommand

autopilot: Any = tgl_soar.autopilot
SMALL_RAD = 1e-3  # less than a tick's slew rate lets through


def next_inputs(flight: Flight) -> Inputs:
    """What the tick after a flight's last is given."""
    last = flight.inputs[-1]
    now_s = last.time_s + DT
    attitude = last.attitude._replace(sequence=last.attitude.sequence + 1, time_s=now_s)
    return last._replace(time_s=now_s, attitude=attitude)


def tick(
    flight: Flight, laws: Laws = LAWS, engage: bool = True, **changes: Any
) -> tuple[AutopilotState, Output]:
    inputs = next_inputs(flight)._replace(engage=engage)
    return step(laws, flight.state._replace(**changes), inputs)


def replaced(monkeypatch: pytest.MonkeyPatch, name: str, change: Callable[[Any], Any]) -> None:
    """What a part of the tick gives is changed behind it."""
    part = getattr(autopilot, name)
    monkeypatch.setattr(autopilot, name, lambda *given, **named: change(part(*given, **named)))


def braking(pitch_rad: float) -> Callable[[Any], Any]:
    return lambda held: (held[0], BrakeEffect(pitch_rad, 0.0))


def gust(pitch_rad: float, veer_rad: float = 0.0) -> Callable[[Any], Any]:
    def change(found: Any) -> Any:
        memory = found.memory._replace(gust_pitch_rad=pitch_rad)
        return found._replace(memory=memory, veer_rad=found.veer_rad + veer_rad)

    return change


def in_mode(flight: Flight, mode: int, since_s: float = 0.0) -> Any:
    return flight.state.supervisor._replace(
        mode=mode, since_s=flight.state.time_s - since_s, conditions=-1
    )


# --- before it flies ----------------------------------------------------------------------------


def test_before_it_flies_every_number_of_the_laws_is_at_rest() -> None:
    flight = Flight(ready=False)
    flight.engage = False
    first = flight.fly(DT).outputs[0]
    assert not first.active
    assert first.command == SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    assert first.cut == 0
    assert not first.line.moving
    assert isnan(first.line.e_rho_rate_mps)
    state = initial_state()
    assert state.loops.limited.command == SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    still = PidState(0.0, 0.0)
    assert (state.sideways, state.loops.pitch, state.loops.roll) == (still, still, still)
    assert (state.soaring.pid, state.soaring.pitch_setpoint_rad) == (still, 0.0)
    assert (state.soaring.slewing, state.heading_setpoint_rad) == (0, 0.0)
    assert (state.line.speed_mps, state.line.moving) == (0.0, False)


def test_e_rho_is_that_of_the_operator_s_line_before_it_flies() -> None:
    flight = Flight(ready=False)
    flight.engage = False
    output = flight.fly(0.5).outputs[-1]
    target, vehicle = LAWS.target, output.vehicle
    assert output.mode == modes.READY
    assert output.line[:3] == target[:3]
    assert output.line.e_rho_m == e_rho(*target[:3], vehicle.x_m, vehicle.z_m)


@pytest.mark.parametrize("capture_max_m", [0.3, 1.5])
def test_engaging_asks_for_no_distance_to_the_line(capture_max_m: float) -> None:
    """The line starts at the aircraft, however far the operator's is and near the limit is."""
    flight = Flight(laws_with(CAPTURE_MAX=capture_max_m)).fly(0.05)
    assert flight.outputs[-1].mode == modes.CAPTURING


def test_what_an_entry_lacks_is_named_bit_by_bit() -> None:
    flight = Flight(ready=False)
    flight.engage = False
    flight.fly(0.5)
    inputs, output = flight.inputs[-1], flight.outputs[-1]

    def lacks(laws: Laws = LAWS, changed: Inputs = inputs, earlier: Output = output) -> int:
        return entry_lacks(laws, flight.state, changed, earlier)

    assert lacks() == 0
    disarmed = inputs.autopilot._replace(accepts_surfaces=False)
    assert lacks(changed=inputs._replace(autopilot=disarmed)) == modes.SURFACES_OBEY
    failing = inputs.autopilot._replace(failsafe=True)
    assert lacks(changed=inputs._replace(autopilot=failing)) == modes.NO_FAILSAFE
    rolled = output.vehicle._replace(roll_rad=radians(70.0))
    assert lacks(earlier=output._replace(vehicle=rolled)) == modes.UPRIGHT
    # What an entry does not ask for is not lacked, and nothing else is.
    nowhere = LAWS._replace(target=TargetLine(nan, 1.5, LAWS.target.eta_rad))
    assert lacks(nowhere) == modes.LINE_VALID
    assert lacks(nowhere, inputs._replace(autopilot=failing)) == (
        modes.LINE_VALID | modes.NO_FAILSAFE
    )


def test_faults_of_the_streams_alone_have_words() -> None:
    assert fault_text(STREAM_FAULTS) == fault_words(STREAM_FAULTS) != ""
    others = ~STREAM_FAULTS & 0xFFFF
    assert fault_text(others) == fault_text(0) == fault_words(0)
    assert fault_text(others | STREAM_FAULTS) == fault_words(STREAM_FAULTS)


# --- the first tick in control ------------------------------------------------------------------


def test_the_first_tick_has_no_history() -> None:
    """Integrals are empty, and each derivative is of what the aircraft does already."""
    flight = Flight()
    flight.glider.q, flight.glider.p, flight.glider.r = 0.3, -0.2, 0.1
    flight.fly(DT)
    output, state = flight.outputs[-1], flight.state
    vehicle = output.vehicle
    assert output.mode == modes.CAPTURING
    assert reason_text(output.reason)
    for terms in (output.elevator, output.aileron, output.sideways):
        assert terms.i == 0.0
    assert state.loops.pitch == PidState(0.0, -vehicle.pitch_rate_radps)
    assert state.loops.roll == PidState(0.0, -vehicle.roll_rate_radps)
    assert state.loops.heading == PidState(0.0, -vehicle.heading_rate_radps)
    assert state.off_line_s == output.time_s
    assert not state.line.moving or state.line.speed_mps == 0.0
    # e_rho changes as the aircraft leaves the line that starts at it.
    line, h = state.line, 1e-6
    away = e_rho(
        *(line.x_m, line.z_m, line.eta_rad),
        vehicle.x_m + h * vehicle.velocity_x_mps,
        vehicle.z_m + h * vehicle.climb_mps,
    )
    before = e_rho(line.x_m, line.z_m, line.eta_rad, vehicle.x_m, vehicle.z_m)
    assert output.line.e_rho_rate_mps == pytest.approx((away - before) / h, rel=1e-4)


# --- what a tick adds up ------------------------------------------------------------------------


@pytest.mark.interpreted
@pytest.mark.parametrize("mode", [modes.SOARING, modes.HOLDING])
def test_what_the_brake_needs_of_the_pitch_is_added_to_it(
    monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    flight = soaring().fly(0.2)
    replaced(monkeypatch, "supervise", lambda given: (given[0], given[1]._replace(mode=mode)))
    found = []
    for effect in (0.0, SMALL_RAD):
        with monkeypatch.context() as patch:
            replaced(patch, "point_step", braking(effect))
            found.append(tick(flight)[1])
    plain, braked = found
    assert plain.mode == braked.mode == mode
    assert braked.soaring.feedforward == pytest.approx(plain.soaring.feedforward + SMALL_RAD)


@pytest.mark.interpreted
def test_what_a_gust_takes_out_is_added_too(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = soaring().fly(0.2)
    plain = tick(flight)[1]
    replaced(monkeypatch, "estimate", gust(SMALL_RAD, 0.01))
    met = tick(flight)[1]
    assert met.soaring.feedforward == pytest.approx(plain.soaring.feedforward + SMALL_RAD)
    # And the heading follows where the wind comes from now.
    assert met.setpoints.heading_rad == pytest.approx(plain.setpoints.heading_rad + 0.01)


@pytest.mark.interpreted
def test_the_heading_is_to_the_waypoint_about_where_the_wind_comes_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = soaring().fly(0.2)

    def beside(found: Any) -> Any:
        return found._replace(vehicle=found.vehicle._replace(y_m=0.5), veer_rad=0.02)

    replaced(monkeypatch, "estimate", beside)
    output = tick(flight)[1]
    course = heading_setpoint(LAWS.heading, output.vehicle.x_m, 0.5)
    assert course < -0.03
    assert output.setpoints.heading_rad == pytest.approx(0.02 + course)


@pytest.mark.interpreted
def test_an_excitation_is_added_to_the_setpoint_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = soaring().fly(0.2)
    plain = tick(flight)[1]
    replaced(monkeypatch, "excitation_step", lambda found: found._replace(pitch_rad=SMALL_RAD))
    excited = tick(flight)[1]
    assert excited.setpoints.pitch_rad == pytest.approx(plain.setpoints.pitch_rad + SMALL_RAD)
    assert excited.soaring == plain.soaring


@pytest.mark.interpreted
def test_what_the_envelope_keeps_is_what_the_line_took(monkeypatch: pytest.MonkeyPatch) -> None:
    """theta_0, the line's integral and the brake's pitch: what holds the line at rest."""
    flight = soaring().fly(0.2)
    asked: list[tuple[float, float, float]] = []
    part = autopilot.pitch_kept

    def kept(*given: Any) -> Any:
        asked.append(given[3:])
        return part(*given)

    monkeypatch.setattr(autopilot, "pitch_kept", kept)
    replaced(monkeypatch, "point_step", braking(0.02))
    integral = radians(3.0)
    before = flight.state.soaring
    state, output = tick(flight, soaring=before._replace(pid=PidState(integral, 0.0)))
    ((wanted, held, _),) = asked
    trim = state.memory.pitch_trim.pitch_rad
    assert held == pytest.approx(trim + state.soaring.pid.integral + 0.02)
    assert state.soaring.pid.integral == pytest.approx(integral, abs=1e-3)
    assert wanted == output.setpoints.pitch_rad == state.soaring.pitch_setpoint_rad


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("mode", "fraction"), [(modes.SOARING, 1.0), (modes.CAPTURING, 0.0), (modes.SEARCHING, 0.0)]
)
def test_only_who_soars_on_a_line_is_blown_behind_it(
    monkeypatch: pytest.MonkeyPatch, mode: int, fraction: float
) -> None:
    """An aircraft that captures it is behind it because that is where it began."""
    flight = soaring().fly(0.2)
    asked: list[float] = []

    def kept(*given: Any) -> Any:
        asked.append(given[5])
        return given[3], 0

    monkeypatch.setattr(autopilot, "pitch_kept", kept)
    replaced(monkeypatch, "_decide", lambda found: (found[0], found[1]._replace(mode=mode)))
    _, output = tick(flight)
    assert output.line.e_rho_m != 0.0
    assert asked == [-output.line.e_rho_m * fraction]


@pytest.mark.interpreted
def test_the_last_limiter_asks_of_the_mode_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were the laws flown in a mode that is not in control, they would still move nothing."""
    flight = soaring().fly(0.2)
    control = autopilot._control
    monkeypatch.setattr(
        autopilot, "_control", lambda laws, _, *rest: control(laws, modes.READY, *rest)
    )
    _, output = tick(flight)
    assert output.command == SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    assert output.cut & CUT_MODE


@pytest.mark.interpreted
@pytest.mark.parametrize(("cut", "slewing"), [(CUT_NOSE_UP, 1), (1 << 9, -1), (0, 0)])
def test_a_pitch_that_is_cut_holds_the_integral_back(
    monkeypatch: pytest.MonkeyPatch, cut: int, slewing: int
) -> None:
    """As the slew rate does; and the log has what was cut here and by the surfaces' limits."""
    flight = soaring().fly(0.2)
    kept = flight.outputs[-1].setpoints.pitch_rad
    monkeypatch.setattr(autopilot, "pitch_kept", lambda *_: (kept, cut))

    def limited(found: Any) -> Any:
        loops, terms = found
        return loops._replace(limited=loops.limited._replace(cut=1 << 7)), terms

    replaced(monkeypatch, "surfaces_step", limited)
    state, output = tick(flight)
    assert state.soaring.slewing == slewing
    assert output.cut == 1 << 7 | cut


def test_who_turns_by_banking_is_given_a_bank() -> None:
    laws = LAWS._replace(loops=THEIRS)
    flight = soaring().fly(0.2)
    flight.glider.psi = 0.2
    flight.fly(0.05)
    state, output = tick(flight, laws)
    wanted = bank_setpoint(laws.bank, output.setpoints.heading_rad, output.vehicle.heading_rad)
    assert output.setpoints.roll_rad == wanted != 0.0
    assert state.sideways == flight.state.sideways
    own, _ = tick(flight)
    assert own.sideways != flight.state.sideways


@pytest.mark.interpreted
def test_who_turns_by_banking_is_level_where_it_holds_or_recovers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    laws = LAWS._replace(loops=THEIRS)
    flight = soaring().fly(0.2)
    flight.glider.psi = 0.2
    flight.fly(0.05)
    monkeypatch.setattr(autopilot.way, "keeps_level", lambda *_: True)
    _, output = tick(flight, laws)
    assert output.setpoints.roll_rad == 0.0


def test_a_line_that_begins_again_under_power_keeps_the_pitch() -> None:
    """The propeller's part is in the pitch that is flown, and added to what the line asks for."""
    flight = soaring().fly(0.2)
    flown, wanted = flight.outputs[-1].vehicle.pitch_rad, []
    for up_rad in (0.0, radians(4.0)):
        state = flight.state._replace(throttle=flight.state.throttle._replace(pitch_rad=up_rad))
        estimated = estimate(LAWS, state.memory, next_inputs(flight), True, state.loops.limited, DT)
        begun = autopilot._line_from_aircraft(LAWS, state, estimated).soaring
        wanted.append(begun.pid.integral + up_rad)
        assert begun.pitch_setpoint_rad == pytest.approx(flown, abs=1e-3)
    assert wanted[1] == pytest.approx(wanted[0])


@pytest.mark.interpreted
@pytest.mark.parametrize("in_hand", [False, True])
def test_loops_begin_again_in_a_hand_and_in_no_other_tick(
    monkeypatch: pytest.MonkeyPatch, in_hand: bool
) -> None:
    flight = soaring().fly(0.2)
    asked: list[Any] = []
    part = autopilot.way.loops_in_hand

    def loops(*given: Any) -> Any:
        asked.append(given[0])
        return part(*given)

    monkeypatch.setattr(autopilot.way, "loops_in_hand", loops)
    monkeypatch.setattr(autopilot.way, "is_in_hand", lambda _: in_hand)
    tick(flight)
    assert asked == ([flight.state.loops] if in_hand else [])


@pytest.mark.interpreted
def test_accelerations_count_for_the_brake_once_they_have_all_the_weight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = soaring().fly(0.2)
    asked: list[bool] = []
    part = autopilot.point_step

    def point(*given: Any, inertial: bool, **named: Any) -> Any:
        asked.append(inertial)
        return part(*given, inertial=inertial, **named)

    monkeypatch.setattr(autopilot, "point_step", point)

    def weighed(weight: float) -> Callable[[Any], Any]:
        return lambda found: found._replace(memory=found.memory._replace(imu_weight=weight))

    for weight in (0.0, 0.99, 1.0):
        with monkeypatch.context() as patch:
            replaced(patch, "estimate", weighed(weight))
            tick(flight)
    assert asked == [False, False, True]


# --- the line -----------------------------------------------------------------------------------


def line_beside(flight: Flight, off_m: float, **changes: Any) -> dict[str, Any]:
    """A line whose e_rho is this, at rest."""
    vehicle = flight.outputs[-1].vehicle
    eta = LAWS.target.eta_rad
    h = 1e-6
    slope = (e_rho(h, 0.0, eta, 0.0, 0.0) - e_rho(0.0, 0.0, eta, 0.0, 0.0)) / h
    line = LineState(
        x_m=vehicle.x_m + off_m / slope, z_m=vehicle.z_m, eta_rad=eta, speed_mps=0.0, moving=False
    )
    return {"line": line._replace(**changes)}


def aimed_at(line: LineState) -> Laws:
    return LAWS._replace(target=TargetLine(line.x_m, line.z_m, line.eta_rad))


@pytest.mark.parametrize(("since_s", "soars"), [(0.99, False), (1.01, True)])
def test_a_line_counts_as_captured_after_a_second_on_it(since_s: float, soars: bool) -> None:
    flight = soaring().fly(0.2)
    changes = line_beside(flight, 0.0)
    now_s = flight.state.time_s + DT
    _, output = tick(
        flight,
        aimed_at(changes["line"]),
        **changes,
        supervisor=in_mode(flight, modes.CAPTURING, 5.0),
        off_line_s=now_s - since_s,
    )
    assert (output.mode == modes.SOARING) == soars


@pytest.mark.parametrize(
    ("off_m", "on"), [(0.045, True), (-0.045, True), (0.055, False), (-0.055, False)]
)
def test_it_is_on_its_line_within_5_cm_on_either_side(off_m: float, on: bool) -> None:
    flight = soaring().fly(0.2)
    changes = line_beside(flight, off_m)
    state, output = tick(flight, aimed_at(changes["line"]), **changes, off_line_s=1.0)
    assert output.line.e_rho_m == pytest.approx(off_m, abs=4e-3)
    assert state.off_line_s == (1.0 if on else output.time_s)


@pytest.mark.parametrize("surveys", [False, True])
def test_a_line_on_its_way_is_not_captured_but_for_that_of_a_survey(surveys: bool) -> None:
    flight = soaring().fly(0.2)
    changes = line_beside(flight, 0.0, moving=True)
    target = aimed_at(changes["line"]).target
    laws = LAWS._replace(surveys=surveys, target=target._replace(x_m=target.x_m + 2.0))
    state, output = tick(flight, laws, **changes, off_line_s=1.0)
    assert output.line.moving
    assert state.off_line_s == (1.0 if surveys else output.time_s)


@pytest.mark.parametrize(
    ("mode", "slides"), [(modes.SOARING, True), (modes.CAPTURING, True), (modes.RECOVERING, False)]
)
def test_the_line_slides_where_it_is_flown(mode: int, slides: bool) -> None:
    flight = soaring().fly(0.2)
    laws = laws_from(VALUES.changed({"TGL_X": -1.0}), FRAME)
    state, _ = tick(flight, laws, supervisor=in_mode(flight, mode))
    assert (state.line != flight.state.line) == slides


@pytest.mark.interpreted
def test_a_new_line_begins_at_the_aircraft_with_the_speed_of_the_old_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """e_rho of a line at rest: the aircraft's speed over the ground, and none of the line's."""
    flight = soaring().fly(0.2)
    laws = laws_from(VALUES.changed({"TGL_X": -1.0}), FRAME)
    replaced(
        monkeypatch,
        "supervise",
        lambda found: (found[0], found[1]._replace(action=modes.NEW_LINE)),
    )
    moving = flight.state.line._replace(speed_mps=0.25, moving=True)
    state, output = tick(flight, laws, line=moving)
    vehicle, line = output.vehicle, output.line
    assert (line.x_m, line.z_m, line.e_rho_m) == pytest.approx((vehicle.x_m, vehicle.z_m, 0.0))
    own = e_rho(0.0, 0.0, line.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps)
    assert line.e_rho_rate_mps == pytest.approx(own, abs=1e-6)
    assert state.off_line_s == output.time_s
    assert state.line.speed_mps == 0.0


@pytest.mark.interpreted
def test_a_launch_that_comes_to_its_line_begins_with_the_pitch_it_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And at a rate of nothing: the integral is what its pitch needs beyond theta_0."""
    flight = soaring().fly(0.2)
    asked: list[tuple[float, ...]] = []
    part = autopilot.soaring_reset

    def reset(*given: Any) -> Any:
        asked.append(given[1:])
        return part(*given)

    monkeypatch.setattr(autopilot, "soaring_reset", reset)
    tick(flight)
    assert asked == []
    monkeypatch.setattr(autopilot.way, "starts_line", lambda *_: True)
    state, _ = tick(flight)
    pitch = flight.state.soaring.pitch_setpoint_rad
    assert asked == [(state.memory.pitch_trim.pitch_rad, 0.0, pitch)]


# --- numbers that are none ----------------------------------------------------------------------


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize(
    "part", ["line x", "line z", "pitch setpoint", "heading setpoint", "sideways integral"]
)
def test_a_law_that_carries_no_number_on_ends_the_flight(part: str, value: float) -> None:
    flight = soaring().fly(0.2)
    state = flight.state
    states: dict[str, dict[str, Any]] = {
        "line x": {"line": state.line._replace(x_m=value)},
        "line z": {"line": state.line._replace(z_m=value)},
        "pitch setpoint": {"soaring": state.soaring._replace(pitch_setpoint_rad=value)},
        "heading setpoint": {"heading_setpoint_rad": value},
        "sideways integral": {"sideways": PidState(value, 0.0)},
    }
    _, output = tick(flight, **states[part])
    assert not output.active
    assert output.command == SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    assert tick(flight)[1].active


def test_a_command_that_was_no_number_ends_the_flight_and_hinders_no_next_one() -> None:
    flight = soaring().fly(0.2)
    limited = flight.state.loops.limited
    assert limited.finite
    corrupted = flight.state.loops._replace(limited=limited._replace(finite=False))
    assert not tick(flight, loops=corrupted)[1].active
    # What a flight has left behind is none of the next one's.
    ready = Flight()
    ready.state = ready.state._replace(
        loops=corrupted, soaring=ready.state.soaring._replace(pitch_setpoint_rad=nan)
    )
    assert ready.fly(2 * DT).outputs[-1].active


def test_a_tick_that_ends_the_flight_says_why_and_the_first_one_that_it_began() -> None:
    flight = soaring().fly(0.2)
    assert tick(flight)[1].reason == modes.REASON_NONE
    ended = tick(flight, engage=False)[1]
    assert ended.reason != modes.REASON_NONE
    began = Flight().fly(DT).outputs[-1]
    assert began.reason not in (modes.REASON_NONE, ended.reason)


def test_without_control_an_excitation_rests() -> None:
    flight = soaring().fly(0.2)
    running = flight.state.excitation._replace(
        begun_s=flight.state.time_s - 1.0, pitch_rad=0.02, amplitude_rad=0.03
    )
    _, output = tick(flight, engage=False, excitation=running)
    assert not output.active
    assert output.excitation.pitch_rad == 0.0
    assert output.excitation.limited_s == 0.0


# --- what the parts are asked -------------------------------------------------------------------


def asked_of(monkeypatch: pytest.MonkeyPatch, name: str) -> list[tuple[Any, ...]]:
    """What a part of the tick is given, call by call."""
    asked: list[tuple[Any, ...]] = []
    part = getattr(autopilot, name)

    def listens(*given: Any, **named: Any) -> Any:
        asked.append((*given, *named.values()))
        return part(*given, **named)

    monkeypatch.setattr(autopilot, name, listens)
    return asked


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("flies", "in_hand", "airborne"),
    [(True, False, True), (True, True, False), (False, False, False), (False, True, False)],
)
def test_the_air_is_read_in_flight_and_in_no_hand(
    monkeypatch: pytest.MonkeyPatch, flies: bool, in_hand: bool, airborne: bool
) -> None:
    flight = soaring().fly(0.2)
    if not flies:
        flight.engage = False
        flight.fly(0.1)
    asked = asked_of(monkeypatch, "estimate")
    monkeypatch.setattr(autopilot.way, "is_in_hand", lambda _: in_hand)
    tick(flight, engage=flies)
    assert asked[0][3] == airborne


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("after_s", "dt_s"), [(0.005, 0.005), (0.09, 0.09), (0.15, 0.1), (0.0, 0.0), (-0.5, 0.0)]
)
def test_a_tick_s_interval_is_since_the_last_and_a_tenth_at_most(
    monkeypatch: pytest.MonkeyPatch, after_s: float, dt_s: float
) -> None:
    flight = soaring().fly(0.2)
    asked = asked_of(monkeypatch, "estimate")
    step(LAWS, flight.state, flight.inputs[-1]._replace(time_s=flight.state.time_s + after_s))
    assert asked[0][5] == pytest.approx(dt_s, abs=1e-9)


@pytest.mark.interpreted
def test_before_it_flies_the_line_s_conditions_are_those_of_a_line_at_the_aircraft(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At a distance of nothing, at rest, and not captured yet."""
    flight = Flight(laws_with(CAPTURE_MAX=0.3))
    asked = asked_of(monkeypatch, "supervise")
    flight.fly(DT)
    found = asked[0][2]
    for bit in (modes.NEAR_LINE, modes.SETTLES, modes.FINITE, modes.SANE, modes.LINE_VALID):
        assert found & bit
    assert not found & (modes.ON_LINE | modes.LINE_MOVING)


@pytest.mark.interpreted
def test_an_engagement_begins_with_the_aircraft_s_own_rates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where it moves as seen from a line through it, whatever place that line has."""
    flight = Flight(x=0.25, z=1.4)
    asked = asked_of(monkeypatch, "soaring_reset")
    flight.fly(DT)
    vehicle, eta = flight.outputs[-1].vehicle, LAWS.target.eta_rad
    (_, trim, rate, pitch), h = asked[0], 1e-6
    moved = (h * vehicle.velocity_x_mps, h * vehicle.climb_mps)
    assert rate == pytest.approx(e_rho(0.0, 0.0, eta, *moved) / h)
    assert pitch == vehicle.pitch_rad
    assert trim == flight.state.memory.pitch_trim.pitch_rad


@pytest.mark.interpreted
@pytest.mark.parametrize("runs", [False, True])
def test_an_excitation_is_asked_whether_it_may_run_on(
    monkeypatch: pytest.MonkeyPatch, runs: bool
) -> None:
    flight = soaring().fly(0.2)
    asked = asked_of(monkeypatch, "excitation_hindrance")
    steps = asked_of(monkeypatch, "excitation_step")
    standing = RUNNING if runs else IDLE
    excitation = flight.state.excitation._replace(standing=standing, begun_s=flight.state.time_s)
    tick(flight, excitation=excitation)
    assert asked[0][1] == runs
    assert steps[0][3] == pytest.approx(DT)
    tick(flight, engage=False)
    assert steps[1][3] == 0.0  # at rest no time goes by
