"""The multisine: its tones, its peak, its beginning and end, and everything that stops it."""

from __future__ import annotations

from functools import lru_cache
from math import cos, degrees, inf, nan, pi, radians

import numpy as np
import pytest

from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.control.conditions import excitation_hindrance
from tgl_soar.control.envelope import MARGIN_FULL, Margins
from tgl_soar.control.excitation import (
    BANKED,
    CLOCK,
    DONE,
    EXCITATION_TEXTS,
    FAULTY,
    GAINS_CHANGE,
    IDLE,
    LEAD_S,
    LIMITED,
    LIMITED_S,
    LINE_MOVES,
    NEAR_STALL,
    NOT_SOARING,
    OFF_LINE,
    PEAK,
    PERIODS,
    PHASES_RAD,
    RUNNING,
    TAIL_S,
    TONES,
    TOO_LOW,
    WHOLE_S,
    WINDOW_S,
    WITHDRAWN,
    Excitation,
    ExcitationState,
    at_rest,
    excitation_step,
    faded,
    multisine,
)
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidState
from tgl_soar.control.soaring import SoaringState
from tgl_soar.control.supervisor import CAPTURING, HOLDING, RECOVERING, SOARING
from tgl_soar.control.target_line import LineTracking
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.telemetry import CHUNK
from tgl_soar.types import VehicleState

REQUESTED = Excitation(radians(1.0), wanted=True)
NOT_REQUESTED = REQUESTED._replace(wanted=False)
DT_S = 0.005
BEGIN_S = 100.0


def stepped(
    seconds: float, hindrances: dict[int, int] | None = None, dt_s: float = DT_S
) -> list[ExcitationState]:
    """From rest, with a hindrance in some ticks."""
    state, states = at_rest(IDLE), []
    for k in range(round(seconds / dt_s)):
        now_s = BEGIN_S + k * dt_s
        state = excitation_step(REQUESTED, state, now_s, dt_s, (hindrances or {}).get(k, IDLE))
        states.append(state)
    return states


def rests(state: ExcitationState, standing: int) -> bool:
    """NaN equals NaN: in native code a field is not the very object that was put into it."""
    return repr(state) == repr(at_rest(standing))


@lru_cache(maxsize=1)
def whole() -> np.ndarray:
    """What is added in each tick of a whole run."""
    return np.array([state.pitch_rad for state in stepped(WHOLE_S)])


# --- the signal ---------------------------------------------------------------------------------


def test_it_holds_six_tones_of_one_size_and_nothing_else() -> None:
    window = whole()[round(LEAD_S / DT_S) : round((LEAD_S + WINDOW_S) / DT_S)]
    lines = 2.0 * np.abs(np.fft.rfft(window)) / len(window)
    assert lines[list(TONES)] == pytest.approx(np.full(6, REQUESTED.amplitude_rad / PEAK), rel=1e-9)
    lines[list(TONES)] = 0.0
    assert np.max(lines) < 1e-12


def test_its_tones_lie_between_2_and_20_radps_and_its_periods_are_alike() -> None:
    radps = [2.0 * pi * n / WINDOW_S for n in TONES]
    assert len(radps) == 6
    assert min(radps) > 2.0
    assert max(radps) < 20.0
    assert all(n % PERIODS == 0 for n in TONES)
    period_s = WINDOW_S / PERIODS
    for t in (0.0, 1.234, 4.9):
        assert multisine(t + period_s) == pytest.approx(multisine(t), abs=1e-12)


def crest(phases: tuple[float, ...]) -> float:
    turn = np.linspace(0.0, 2.0 * pi, 8192) / PERIODS
    total = sum(np.cos(n * turn + phase) for n, phase in zip(TONES, phases, strict=True))
    return float(np.max(np.abs(total)) / np.sqrt(np.mean(np.square(total))))


def test_its_peak_is_its_amplitude_and_its_crest_is_low() -> None:
    """Of Schroeder's phases for a flat spectrum, phi_n = -pi n (n - 1) / N, the crest is 3.09."""
    assert np.max(np.abs(whole())) == pytest.approx(REQUESTED.amplitude_rad, rel=5e-3)
    assert np.max(np.abs(whole())) <= REQUESTED.amplitude_rad
    schroeder = tuple(-pi * n * (n - 1) / 6.0 for n in range(1, 7))
    assert crest(schroeder) == pytest.approx(3.09, abs=0.01)
    assert crest(PHASES_RAD) == pytest.approx(1.71, abs=0.01)


def test_it_begins_and_ends_smoothly() -> None:
    """No tick changes it by more than its fastest tones do: 20 rad/s of 1 deg in 5 ms."""
    added = whole()
    assert added[0] == 0.0
    assert abs(added[-1]) < 1e-4 * REQUESTED.amplitude_rad
    assert np.max(np.abs(np.diff(added))) < 20.0 * REQUESTED.amplitude_rad * DT_S
    assert [faded(t) for t in (0.0, LEAD_S / 2.0, LEAD_S, LEAD_S + WINDOW_S)] == pytest.approx(
        [0.0, 0.5, 1.0, 1.0]
    )
    assert faded(WHOLE_S - TAIL_S / 2.0) == pytest.approx(0.5)


def test_it_fades_in_for_two_seconds_lasts_twenty_and_fades_out_in_one() -> None:
    times_s = (0.0, 0.5, 1.0, 2.0, 12.0, 22.0, 22.5, 23.0)
    fractions = (0.0, 0.5 - 0.125**0.5, 0.5, 1.0, 1.0, 1.0, 0.5, 0.0)
    assert [faded(t) for t in times_s] == pytest.approx(list(fractions))
    begun = stepped(0.1)[-1]
    assert excitation_step(REQUESTED, begun, begun.begun_s + 22.9, DT_S, IDLE).standing == RUNNING
    assert rests(excitation_step(REQUESTED, begun, begun.begun_s + 23.1, DT_S, IDLE), DONE)


@pytest.mark.parametrize(("limited_s", "goes_on"), [(0.039, True), (0.046, False)])
def test_a_limit_is_none_for_a_twentieth_of_a_second(limited_s: float, goes_on: bool) -> None:
    """With another tick of 5 ms, 0.044 and 0.051 s."""
    begun = stepped(0.1)[-1]._replace(limited_s=limited_s)
    now_s = begun.begun_s + 10.0
    after = excitation_step(REQUESTED, begun, now_s, 0.005, LIMITED)
    assert (after.standing == RUNNING) is goes_on
    free = excitation_step(REQUESTED, begun, now_s, 0.005, IDLE)
    assert (free.standing, free.limited_s) == (RUNNING, 0.0)


def test_it_is_a_function_of_time_and_not_of_ticks() -> None:
    """At another rate, and with ticks that come late, it is the same."""
    state = excitation_step(REQUESTED, at_rest(IDLE), BEGIN_S, DT_S, IDLE)
    for elapsed_s in (0.3, 1.7, 2.0, 9.123, 21.9):
        state = excitation_step(REQUESTED, state, BEGIN_S + elapsed_s, DT_S, IDLE)
        expected = sum(
            cos(2.0 * pi * n * (elapsed_s - LEAD_S) / WINDOW_S + phase)
            for n, phase in zip(TONES, PHASES_RAD, strict=True)
        )
        wanted_rad = REQUESTED.amplitude_rad * faded(elapsed_s) * expected / PEAK
        assert state.pitch_rad == pytest.approx(wanted_rad)


# --- how it begins and ends ---------------------------------------------------------------------


def test_it_runs_once_for_each_request() -> None:
    states = stepped(WHOLE_S + 1.0)
    assert states[0].standing == RUNNING
    assert rests(states[-1], DONE)
    taken_back = excitation_step(NOT_REQUESTED, states[-1], 200.0, DT_S, IDLE)
    assert rests(taken_back, IDLE)
    assert excitation_step(REQUESTED, taken_back, 201.0, DT_S, IDLE).standing == RUNNING


def test_the_operator_ends_it_in_that_tick() -> None:
    running = stepped(10.0)[-1]
    assert running.standing == RUNNING
    stopped = excitation_step(NOT_REQUESTED, running, BEGIN_S + 10.0, DT_S, IDLE)
    assert rests(stopped, WITHDRAWN)
    assert rests(excitation_step(NOT_REQUESTED, stopped, BEGIN_S + 10.1, DT_S, IDLE), IDLE)
    # A request that comes back at once starts again, from its beginning.
    again = excitation_step(REQUESTED, stopped, BEGIN_S + 10.1, DT_S, IDLE)
    assert (again.standing, again.begun_s) == (RUNNING, BEGIN_S + 10.1)


@pytest.mark.parametrize(
    "hindrance",
    [n for n in range(NOT_SOARING, CLOCK) if n != LIMITED],
    ids=EXCITATION_TEXTS.__getitem__,
)
def test_a_hindrance_refuses_it_and_ends_it_in_that_tick(hindrance: int) -> None:
    assert rests(stepped(1.0, {0: hindrance})[-1], hindrance)  # and it does not try again
    states = stepped(10.0, {1500: hindrance})
    assert states[1499].standing == RUNNING
    assert rests(states[1500], hindrance)
    assert rests(states[-1], hindrance)


def test_a_limit_ends_it_only_when_it_lasts() -> None:
    """A tick or two of a rate limit are noise."""
    few = round(LIMITED_S / DT_S)
    assert stepped(10.0, dict.fromkeys(range(1500, 1500 + few), LIMITED))[-1].standing == RUNNING
    broken = {k: LIMITED for k in range(1500, 1600) if k % few}
    assert stepped(10.0, broken)[-1].standing == RUNNING
    lasting = stepped(10.0, dict.fromkeys(range(1500, 1502 + few), LIMITED))
    assert rests(lasting[-1], LIMITED)


@pytest.mark.parametrize("now_s", [BEGIN_S - 1.0, nan])
def test_a_clock_that_goes_back_ends_it(now_s: float) -> None:
    assert rests(excitation_step(REQUESTED, stepped(5.0)[-1], now_s, DT_S, IDLE), CLOCK)


def test_a_time_that_is_no_number_ends_it() -> None:
    assert rests(excitation_step(REQUESTED, stepped(5.0)[-1], inf, DT_S, IDLE), DONE)


def test_another_amplitude_counts_from_the_next_run_on() -> None:
    """A step of it would be no multisine."""
    running = stepped(5.0)[-1]
    smaller = REQUESTED._replace(amplitude_rad=radians(0.5))
    now_s = BEGIN_S + 5.0
    assert excitation_step(smaller, running, now_s, DT_S, IDLE) == excitation_step(
        REQUESTED, running, now_s, DT_S, IDLE
    )


def test_the_amplitude_is_between_a_fifth_and_one_degree() -> None:
    assert degrees(laws().excitation.amplitude_rad) == pytest.approx(1.0)
    for amplitude in (0.1, 1.5):
        with pytest.raises(ParameterError):
            ParameterSet().changed({"EXC_AMP": amplitude})


def test_every_standing_has_its_words() -> None:
    assert len(EXCITATION_TEXTS) == CLOCK + 1
    assert all(EXCITATION_TEXTS[DONE:])
    assert max(len("multisine: refused: " + text) for text in EXCITATION_TEXTS) <= CHUNK


# --- what is against it -------------------------------------------------------------------------


@lru_cache(maxsize=1)
def laws() -> Laws:
    values = ParameterSet().changed({"CLEAR_MIN": 0.3})
    return laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0))


LINE = LineTracking(x_m=0.0, z_m=1.0, eta_rad=1.8, moving=False, e_rho_m=0.01, e_rho_rate_mps=0.0)
VEHICLE = VehicleState(
    time_s=1.0,
    x_m=0.0,
    y_m=0.0,
    z_m=1.0,
    velocity_x_mps=0.0,
    velocity_y_mps=0.0,
    climb_mps=0.0,
    roll_rad=0.0,
    pitch_rad=0.0,
    heading_rad=0.0,
    roll_rate_radps=0.0,
    pitch_rate_radps=0.0,
    heading_rate_radps=0.0,
)
STEADY = SoaringState(PidState(0.0, 0.0), 0.0, 0)
FAR = Margins(stall_rad=0.15, clearance_m=1.0, outside=0)
SAFE: dict[str, object] = {
    "begun": False,
    "mode": SOARING,
    "tracking": LINE,
    "on_line": True,
    "vehicle": VEHICLE,
    "margins": FAR,
    "faults": 0,
    "imu_weight": 1.0,
    "soaring": STEADY,
    "elevator_blocked": 0,
}


def hindered(**changes: object) -> int:
    return excitation_hindrance(laws(), **{**SAFE, **changes})  # type: ignore[arg-type]


def test_nothing_is_against_a_steady_flight_on_the_line() -> None:
    assert hindered() == IDLE
    assert hindered(imu_weight=0.0) == IDLE
    assert hindered(margins=Margins(inf, inf, 0)) == IDLE  # what is not known does not hinder
    assert hindered(begun=True, on_line=False) == IDLE


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        *(({"mode": mode}, NOT_SOARING) for mode in (CAPTURING, HOLDING, RECOVERING)),
        ({"tracking": LINE._replace(moving=True)}, LINE_MOVES),
        ({"tracking": LINE._replace(e_rho_m=-0.16)}, OFF_LINE),
        ({"tracking": LINE._replace(e_rho_m=nan)}, OFF_LINE),
        ({"vehicle": VEHICLE._replace(roll_rad=-0.36)}, BANKED),
        ({"vehicle": VEHICLE._replace(roll_rad=nan)}, BANKED),
        ({"faults": 1}, FAULTY),
        ({"margins": FAR._replace(stall_rad=0.4 * MARGIN_FULL)}, NEAR_STALL),
        ({"margins": FAR._replace(stall_rad=nan)}, NEAR_STALL),
        ({"margins": FAR._replace(clearance_m=0.59)}, TOO_LOW),
        ({"vehicle": VEHICLE._replace(climb_mps=-3.1)}, TOO_LOW),
        ({"vehicle": VEHICLE._replace(climb_mps=nan)}, TOO_LOW),
        ({"imu_weight": 0.5}, GAINS_CHANGE),
        ({"elevator_blocked": -1}, LIMITED),
        ({"soaring": STEADY._replace(slewing=1)}, LIMITED),
        ({"soaring": STEADY._replace(pitch_setpoint_rad=radians(11.5))}, LIMITED),
        ({"soaring": STEADY._replace(pitch_setpoint_rad=radians(-14.5))}, LIMITED),
        ({"soaring": STEADY._replace(pitch_setpoint_rad=nan)}, LIMITED),
    ],
)
def test_each_hindrance_is_found(begun: bool, changes: dict[str, object], expected: int) -> None:
    assert hindered(begun=begun, **changes) == expected


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"on_line": False}, OFF_LINE),
        ({"tracking": LINE._replace(e_rho_m=0.06)}, OFF_LINE),
        ({"vehicle": VEHICLE._replace(roll_rad=0.2)}, BANKED),
        ({"margins": FAR._replace(stall_rad=MARGIN_FULL + 0.01)}, NEAR_STALL),
    ],
)
def test_less_ends_no_run_than_keeps_one_from_beginning(
    changes: dict[str, object], expected: int
) -> None:
    assert hindered(**changes) == expected
    assert hindered(begun=True, **changes) == IDLE


def test_what_the_envelope_would_cut_off_the_setpoint_is_a_limit() -> None:
    """Near the stall the setpoint may be above the pitch by the margin and no more."""
    near = FAR._replace(stall_rad=0.9 * MARGIN_FULL)
    assert hindered(begun=True, margins=near) == IDLE
    risen = STEADY._replace(pitch_setpoint_rad=0.9 * MARGIN_FULL - radians(0.9))
    assert hindered(begun=True, margins=near, soaring=risen) == LIMITED
