"""The estimators of one tick, in the order of their needs: what each of them is given.

The parts have tests of their own.  Here they are listened to, or one says something in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, isnan, nan, sin
from typing import Any

import pytest
from samples import attitude_sample, imu_sample, position_fix, surfaces_sample

import tgl_soar.control.estimates
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.envelope import unlimited
from tgl_soar.control.estimates import Estimates, EstimatorMemory, estimate, initial_memory
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.estimation.aerodynamics import glide_pitch
from tgl_soar.estimation.health import AIRSPEED, RANGE
from tgl_soar.estimation.motion_state import FrameShift
from tgl_soar.estimation.pitot_watch import NO_PITOT_WATCH
from tgl_soar.estimation.wind import initial_wind
from tgl_soar.geometry import SoaringFrame, quaternion_from_euler
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_IMU,
    OURS,
    THEIRS,
    THEIRS_WITH_RUDDER,
    AirspeedSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    SurfaceCommand,
)

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies

parts: Any = tgl_soar.control.estimates
DT = 0.005
START_S = 20.0
ROLL, PITCH = 0.3, 0.1
AERO = load_airframe(shipped("airframes/eclipson_c.toml")).aerodynamics()
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)  # upwind is north: x of the frame is south
COMMANDED = unlimited(SurfaceCommand(0.21, 0.0, 0.0, 0.0))
TUBE_MPS = 9.0


def laws_with(loops: int = OURS, **changes: float) -> Laws:
    return laws_from(ParameterSet().changed(changes), FRAME, AERO, loops=loops)


def inputs(tick: int, **changes: Any) -> Inputs:
    """Of an aircraft that stands banked in its wind, without accelerometers or a tube; no fix
    repeats the one before to the bit."""
    now_s = START_S + tick * DT
    place = (1.0 + 1e-9 * (tick % 2), 2.0, -6.0)
    given = Inputs(
        time_s=now_s,
        position=position_fix(tick + 1, now_s, place, (0.0, 0.0, 0.0)),
        attitude=attitude_sample(tick + 1, now_s, quaternion_from_euler(ROLL, PITCH, 0.0)),
        autopilot=AutopilotStatus(time_s=now_s, accepts_surfaces=True, armed=True),
        engage=True,
    )
    return given._replace(**changes)


def memory_after(ticks: int, laws: Laws, **changes: Any) -> EstimatorMemory:
    memory = initial_memory()
    for tick in range(ticks):
        given = inputs(tick, **changes)
        memory = estimate(laws, memory, given, False, COMMANDED, DT if tick else 0.0).memory
    return memory


LAWS = laws_with()
TICKS = 4
KNOWN = memory_after(TICKS, LAWS)


def tick(
    laws: Laws = LAWS, memory: EstimatorMemory = KNOWN, *, flying: bool = True, **changes: Any
) -> Estimates:
    return estimate(laws, memory, inputs(TICKS, **changes), flying, COMMANDED, DT)


def asked_of(monkeypatch: pytest.MonkeyPatch, name: str) -> list[Any]:
    """What a part is given, call by call: in order, and by name."""
    asked: list[Any] = []
    part = getattr(parts, name)

    def listens(*given: Any, **named: Any) -> Any:
        asked.append((given, named))
        return part(*given, **named)

    monkeypatch.setattr(parts, name, listens)
    return asked


def says(monkeypatch: pytest.MonkeyPatch, name: str, change: Callable[[Any], Any]) -> None:
    """What a part gives is changed behind it."""
    part = getattr(parts, name)
    monkeypatch.setattr(parts, name, lambda *given, **named: change(part(*given, **named)))


# --- the place ----------------------------------------------------------------------------------


@pytest.mark.parametrize("flying", [True, False])
def test_a_frame_that_has_moved_is_followed_in_flight_alone(flying: bool) -> None:
    """Without control nothing would feel the step, and the source's own frame is flown next."""
    moved = KNOWN._replace(motion=KNOWN.motion._replace(shift=FrameShift(0.4, 0.0, 0.0)))
    after = tick(memory=moved, flying=flying).memory.motion.shift
    assert after.x_m == (0.4 if flying else 0.0)


def test_a_position_was_confident_when_its_last_fix_was_measured() -> None:
    found = tick()
    assert found.health.position_ok
    assert found.memory.confident_s == pytest.approx(START_S + TICKS * DT)
    # In flight the same again is no fix, on the ground it is.
    again = inputs(TICKS + 1)._replace(position=inputs(TICKS - 1).position)
    again = again._replace(position=again.position._replace(sequence=99, time_s=again.time_s))
    for flying, last in ((True, TICKS - 1), (False, TICKS + 1)):
        repeated = estimate(LAWS, KNOWN, again, flying, COMMANDED, DT)
        assert repeated.memory.confident_s == pytest.approx(START_S + last * DT)
    # An hour later nothing has come: it stays.
    late = inputs(TICKS)._replace(time_s=START_S + 3600.0)
    lost = estimate(LAWS, found.memory, late, True, COMMANDED, DT)
    assert not lost.health.position_ok
    assert lost.memory.confident_s == found.memory.confident_s


@pytest.mark.parametrize(
    ("loops", "flying", "watched"),
    [
        (OURS, True, True),
        (OURS, False, False),
        (THEIRS, True, False),
        (THEIRS_WITH_RUDDER, True, False),
        (THEIRS, False, False),
    ],
)
def test_whether_surfaces_answer_is_watched_where_we_command_all_of_them(
    monkeypatch: pytest.MonkeyPatch, loops: int, flying: bool, watched: bool
) -> None:
    asked = asked_of(monkeypatch, "health_step")
    tick(laws_with(loops), flying=flying)
    ((given, _),) = asked
    assert given[4:7] == (flying, watched, COMMANDED.command)


# --- the rangefinder ----------------------------------------------------------------------------


@pytest.mark.parametrize("correction_m", [0.0, 0.4, -0.7])
def test_a_rangefinder_s_correction_is_of_the_height_and_counts_once(
    monkeypatch: pytest.MonkeyPatch, correction_m: float
) -> None:
    plain = tick()
    asked = asked_of(monkeypatch, "margins_of")
    says(
        monkeypatch,
        "range_step",
        lambda given: (given[0], given[1]._replace(correction_m=correction_m)),
    )
    found = tick()
    assert found.vehicle.z_m == pytest.approx(plain.vehicle.z_m + correction_m)
    assert found.vehicle._replace(z_m=plain.vehicle.z_m) == plain.vehicle
    # The margins add it themselves.
    assert asked[0][0][2].z_m == pytest.approx(plain.vehicle.z_m)


@pytest.mark.parametrize("refused", [True, False])
def test_a_rangefinder_whose_samples_are_refused_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, refused: bool
) -> None:
    before = tick().health.faults
    says(monkeypatch, "range_step", lambda given: (given[0], given[1]._replace(refused=refused)))
    assert tick().health.faults == (before | RANGE if refused else before)


# --- the wind across ----------------------------------------------------------------------------

VEERS = laws_with(VEER_MAX=20.0)
CROSS_MPS = 1.5


@pytest.mark.parametrize(
    ("flying", "position_ok", "changed"),
    [(True, True, True), (True, False, False), (False, True, False), (False, False, False)],
)
def test_a_wind_across_is_learnt_in_flight_with_a_position(
    monkeypatch: pytest.MonkeyPatch, flying: bool, position_ok: bool, changed: bool
) -> None:
    """Without one it stays; a hand turns the aircraft as it likes."""
    monkeypatch.setattr(parts, "cross_wind_step", lambda *_: 2.5)
    says(monkeypatch, "with_uncertainty", lambda health: health._replace(position_ok=position_ok))
    found = tick(VEERS, KNOWN._replace(cross_wind_mps=CROSS_MPS), flying=flying)
    expected = 2.5 if changed else CROSS_MPS if flying else 0.0
    assert found.memory.cross_wind_mps == expected
    assert found.air.cross_wind_mps == expected


@pytest.mark.parametrize("veer_max_deg", [0.0, 0.5])
def test_without_a_veer_no_wind_across_is_estimated(
    monkeypatch: pytest.MonkeyPatch, veer_max_deg: float
) -> None:
    """What the wind's own estimate says of it stays; half a degree of veer is one, too."""
    says(monkeypatch, "wind_step", lambda given: (given[0], given[1]._replace(cross_wind_mps=7.0)))
    monkeypatch.setattr(parts, "cross_wind_step", lambda *_: 2.5)
    found = tick(laws_with(VEER_MAX=veer_max_deg), KNOWN._replace(cross_wind_mps=CROSS_MPS))
    expected = (2.5, 2.5) if veer_max_deg else (0.0, 7.0)
    assert (found.memory.cross_wind_mps, found.air.cross_wind_mps) == expected


def test_the_heading_follows_the_wind_in_flight_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "veer_step", lambda before, *_: before + 0.01)
    veered = KNOWN._replace(veer_rad=0.1)
    flies = tick(VEERS, veered)
    assert flies.veer_rad == flies.memory.veer_rad == pytest.approx(0.11)
    rests = tick(VEERS, veered, flying=False)
    assert (rests.veer_rad, rests.memory.veer_rad) == (0.0, 0.0)


# --- the pitch that the wind asks for -----------------------------------------------------------


@pytest.mark.parametrize(("fraction", "is_requested"), [(0.0, False), (0.5, True), (1.0, True)])
def test_the_trim_follows_the_glide_at_the_wind_less_the_aircraft_s_own_way(
    monkeypatch: pytest.MonkeyPatch, fraction: float, is_requested: bool
) -> None:
    asked = asked_of(monkeypatch, "trim_step")
    says(monkeypatch, "wind_step", lambda given: (given[0], given[1]._replace(wind_mps=9.5)))
    says(
        monkeypatch, "motion_step", lambda given: (given[0], given[1]._replace(velocity_x_mps=-1.0))
    )
    tick(laws_with(WIND_TRIM=fraction))
    glide = asked[0][0][2]
    assert isnan(glide) != is_requested
    if is_requested:
        assert glide == pytest.approx(glide_pitch(AERO, 10.5))


# --- the tube -----------------------------------------------------------------------------------

TUBE = AirspeedSample(5, START_S, TUBE_MPS)


def watched(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> dict[str, Any]:
    """The inputs of the watch of the tube in a tick."""
    with monkeypatch.context() as patch:
        asked = asked_of(patch, "pitot_step")
        tick(airspeed=TUBE, **changes)
    named: dict[str, Any] = asked[0][1]
    return named


@pytest.mark.parametrize(
    ("sequence", "flying", "looks"),
    [(1, True, True), (5, True, True), (0, True, False), (5, False, False), (0, False, False)],
)
def test_a_tube_is_watched_once_it_has_spoken_and_in_flight(
    monkeypatch: pytest.MonkeyPatch, sequence: int, flying: bool, looks: bool
) -> None:
    """In a hand the wing carries nothing that would show the airspeed."""
    asked = asked_of(monkeypatch, "pitot_step")
    found = tick(airspeed=TUBE._replace(sequence=sequence), flying=flying)
    assert (len(asked) == 1) == looks
    if not looks:
        assert found.memory.pitot == NO_PITOT_WATCH


@pytest.mark.parametrize("before", [False, True])
def test_a_tube_that_lies_is_done_without_and_the_wind_begun_again(
    monkeypatch: pytest.MonkeyPatch, before: bool
) -> None:
    """But once: it has had its part in what was known of the wind, and has none from then on."""
    monkeypatch.setattr(parts, "pitot_step", lambda *_, **__: NO_PITOT_WATCH._replace(lies=True))
    asked = asked_of(monkeypatch, "wind_step")
    memory = KNOWN._replace(pitot=NO_PITOT_WATCH._replace(lies=before))
    found = tick(memory=memory, airspeed=TUBE)
    given = asked[0][0]
    assert given[3].airspeed == NO_AIRSPEED
    assert found.health.faults & AIRSPEED
    # By their words: a state has numbers that are none, which equal nothing.
    assert repr(KNOWN.wind) != repr(initial_wind())
    assert repr(given[1]) == repr(KNOWN.wind if before else initial_wind())
    assert found.memory.pitot.lies


def test_nor_is_it_accepted_because_the_pilot_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    """That is no fault: a tube that cannot be accepted again before it flies would never engage."""
    asked = asked_of(monkeypatch, "wind_step")
    memory = KNOWN._replace(pitot=NO_PITOT_WATCH._replace(lies=True, apart_s=0.3))
    found = tick(memory=memory, airspeed=TUBE, flying=False)
    assert found.memory.pitot == NO_PITOT_WATCH._replace(lies=True)
    assert asked[0][0][3].airspeed == NO_AIRSPEED
    assert not found.health.faults & AIRSPEED


def test_a_tube_that_is_accepted_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "pitot_step", lambda *_, **__: NO_PITOT_WATCH)
    asked = asked_of(monkeypatch, "wind_step")
    found = tick(airspeed=TUBE)
    assert asked[0][0][3].airspeed == TUBE
    assert repr(asked[0][0][1]) == repr(KNOWN.wind)
    assert not found.health.faults & AIRSPEED


# --- what the wing carries ----------------------------------------------------------------------


def test_without_accelerations_the_wing_carries_the_weight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As in steady flight: forces against gravity, along the body's axes."""
    force = watched(monkeypatch)["force_mps2"]
    g = AERO.gravity_mps2
    assert force == pytest.approx((g * sin(PITCH), -g * cos(PITCH) * cos(ROLL)), rel=1e-3)


def imu(tick_of: int, force_x: float = 1.1, force_z: float = -9.2) -> ImuSample:
    return imu_sample(tick_of + 1, START_S + tick_of * DT, (force_x, 0.0, force_z))


def with_imu(accepted_tick: int) -> EstimatorMemory:
    """Accelerations have come, and the last that was accepted is of that tick."""
    used = KNOWN.motion.imu._replace(
        sequence=accepted_tick + 1, time_s=START_S + accepted_tick * DT, since_s=START_S - 1.0
    )
    return KNOWN._replace(motion=KNOWN.motion._replace(imu=used))


def test_an_acceleration_that_was_accepted_is_what_the_wing_carries(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given_now = watched(monkeypatch, memory=with_imu(TICKS - 1), imu=imu(TICKS))
    assert given_now["force_mps2"] == (1.1, -9.2)


def test_one_that_was_refused_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    spike = imu(TICKS, force_z=-1e6)
    given_now = watched(monkeypatch, memory=with_imu(TICKS - 1), imu=spike)
    assert all(isnan(force) for force in given_now["force_mps2"])


@pytest.mark.parametrize(("silent_s", "steady"), [(0.9, False), (1.1, True)])
def test_accelerations_that_fall_silent_are_replaced_by_steady_flight(
    monkeypatch: pytest.MonkeyPatch, silent_s: float, steady: bool
) -> None:
    silent_s *= parts.IMU_SILENT_S
    last = imu(TICKS)._replace(sequence=1, time_s=START_S + TICKS * DT - silent_s)
    memory = with_imu(TICKS)
    used = memory.motion.imu._replace(sequence=1, time_s=last.time_s)
    memory = memory._replace(motion=memory.motion._replace(imu=used))
    given_now = watched(monkeypatch, memory=memory, imu=last)
    assert (given_now["force_mps2"] != (1.1, -9.2)) == steady
    assert watched(monkeypatch, memory=KNOWN, imu=NO_IMU)["force_mps2"] != (1.1, -9.2)


# --- the elevator -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reported", "flying", "elevator"),
    [(-0.4, True, -0.4), (-0.4, False, -0.4), (nan, True, 0.21), (nan, False, nan)],
)
def test_the_elevator_is_where_it_is_reported_else_where_we_command_it(
    monkeypatch: pytest.MonkeyPatch, reported: float, flying: bool, elevator: float
) -> None:
    """Without control the effect of the pilot's stick on it is unknown."""
    asked = asked_of(monkeypatch, "wind_step")
    tick(flying=flying, surfaces=surfaces_sample(1, START_S, (reported, 0.0, 0.0)))
    assert asked[0][0][5] == pytest.approx(elevator, nan_ok=True)


def test_before_anything_has_come_gains_are_the_plain_ones_of_no_airspeed() -> None:
    before = initial_memory()
    assert isnan(before.gain_speed_mps)
    assert isnan(before.confident_s)
    nothing = (
        *(before.imu_weight, before.gain_age_s, before.gust_pitch_rad),
        *(before.cross_wind_mps, before.veer_rad),
    )
    assert nothing == (0.0,) * len(nothing)
