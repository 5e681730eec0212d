"""A flight's series: what a column was at other times, and what follows from others."""

from __future__ import annotations

from math import atan2, cos, nan, pi, radians, sin
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import (
    COLUMNS,
    WORDS,
    Event,
    FlightData,
    LoggedMode,
    Series,
    changes_of,
    euler,
    line_series,
    mode_words,
    on_line,
    parameter_events,
    placed,
    series,
    steered,
    with_missing,
)
from tgl_soar.config.airframe import Surface, Surfaces
from tgl_soar.geometry import SoaringFrame


def of(times: list[float], **columns: list[float]) -> Series:
    found = series(times, "made up", **columns)
    assert found is not None
    return found


def flight(**parts: Any) -> FlightData:
    return FlightData("made up", "of no kind", **parts)


# --- samples --------------------------------------------------------------------------------------


def test_between_samples_a_column_is_linear_and_outside_of_them_it_is_unknown() -> None:
    known = of([0.0, 1.0, 2.0, 3.0], v=[nan, 10.0, nan, 30.0])
    found = known.at("v", [0.5, 1.0, 1.5, 2.0, 3.0, 3.1])
    assert found == pytest.approx([nan, 10.0, 15.0, 20.0, 30.0, nan], nan_ok=True)
    assert np.isnan(of([0.0, 1.0], v=[nan, nan]).at("v", [0.5, 1.0])).all()


def test_the_last_sample_stands_until_the_next_and_nothing_before_the_first() -> None:
    steps = of([1.0, 2.0], v=[10.0, 20.0])
    found = steps.last_at("v", [0.9, 1.0, 1.9, 2.0, 9.0])
    assert found == pytest.approx([nan, 10.0, 10.0, 20.0, 20.0], nan_ok=True)


def test_a_part_has_its_first_and_its_last_sample() -> None:
    part = of([0.0, 1.0, 2.0, 3.0], v=[5.0, 6.0, 7.0, 8.0]).within(1.0, 2.0)
    assert part.time_s.tolist() == [1.0, 2.0]
    assert part["v"].tolist() == [6.0, 7.0]
    assert len(part) == 2
    assert part.source == "made up"


def test_without_a_sample_there_is_no_series() -> None:
    assert series([], "made up", v=[]) is None
    assert series([1.0], "made up", v=[2.0]) is not None


def test_a_flight_lasts_until_its_last_sample_or_event() -> None:
    air = of([0.0, 4.0], updraft_mps=[0.0, 0.0])
    outputs = of([0.0, 5.0], **{"1": [1500.0, 1500.0]})
    assert flight().duration_s == 0.0
    assert flight(air=air).duration_s == 4.0
    assert flight(air=air, outputs=outputs).duration_s == 5.0
    assert flight(air=air, events=(Event(7.0, "message", "end"),)).duration_s == 7.0
    assert flight(events=(Event(-2.0, "message", "early"),)).duration_s == 0.0
    assert set(flight(air=air, outputs=outputs).series()) == {"air", "outputs"}


def test_every_series_that_may_be_there_is_found_and_has_words() -> None:
    names = set(COLUMNS)
    one = of([0.0], v=[0.0])
    assert set(flight(**dict.fromkeys(names, one)).series()) == names
    assert set(WORDS) == names
    assert len(set(WORDS.values())) == len(WORDS)


@pytest.mark.parametrize("name", COLUMNS)
def test_what_is_missing_is_reported_once_and_what_is_there_is_not(name: str) -> None:
    before = flight(missing=("a note",))
    assert with_missing(before, (name,)).missing == ("a note", f"the log holds no {WORDS[name]}")
    there = flight(**{name: of([0.0], v=[0.0])})
    assert with_missing(there, (name,)).missing == ()


# --- angles ---------------------------------------------------------------------------------------


def quaternion(axis: int, angle_rad: float) -> list[float]:
    vector = [0.0, 0.0, 0.0]
    vector[axis] = sin(0.5 * angle_rad)
    return [cos(0.5 * angle_rad), *vector]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle_deg", [-80.0, 30.0, 89.0])
@pytest.mark.parametrize("length", [1.0, 0.3])
def test_a_turn_about_one_axis_is_that_angle_alone(
    axis: int, angle_deg: float, length: float
) -> None:
    q = [np.array([length * each]) for each in quaternion(axis, radians(angle_deg))]
    angles = [float(np.degrees(each[0])) for each in euler(*q)]
    expected = [0.0, 0.0, 0.0]
    expected[axis] = angle_deg
    assert angles == pytest.approx(expected, abs=1e-6)


def test_angles_give_back_the_rotation_that_they_were_taken_from() -> None:
    """By scipy: intrinsic turns by yaw, pitch and roll."""
    from scipy.spatial.transform import Rotation

    rotations = Rotation.random(200, random_state=3)
    x, y, z, w = rotations.as_quat().T
    expected = rotations.as_euler("ZYX")
    found = np.stack(euler(w, x, y, z)[::-1], axis=1)
    assert found == pytest.approx(expected, abs=1e-9)


def test_zeros_report_no_rotation() -> None:
    zero = np.zeros(1)
    assert np.isnan(np.concatenate(euler(zero, zero, zero, zero))).all()


# --- the soaring frame ----------------------------------------------------------------------------

# The wind comes from the east: x, away from it, is west, and y, to the right seen upwind, south.
EASTERLY = SoaringFrame(
    origin_north_m=10.0, origin_east_m=20.0, origin_down_m=-5.0, wind_from_rad=0.5 * pi
)


def flown(**parts: Any) -> FlightData:
    position = of([0.0], north_m=[11.0], east_m=[17.0], down_m=[-9.0])
    velocity = of([0.0], north_mps=[1.0], east_mps=[2.0], down_mps=[3.0])
    attitude = of([0.0], roll_rad=[0.0], pitch_rad=[0.0], yaw_rad=[radians(100.0)])
    given: dict[str, Any] = {"position": position, "velocity": velocity, "attitude": attitude}
    return flight(**(given | parts))


def first(samples: Series | None, *names: str) -> list[float]:
    assert samples is not None
    return [float(samples[name][0]) for name in names]


def test_a_flight_is_placed_in_the_frame_of_its_site() -> None:
    there = placed(flown(), EASTERLY)
    x, y, z = first(there.path, "x_m", "y_m", "z_m")
    assert (x, y, z) == pytest.approx((3.0, -1.0, 4.0))  # three west, one north, four above
    vx, vy, climb = first(there.motion, "velocity_x_mps", "velocity_y_mps", "climb_mps")
    assert (vx, vy, climb) == pytest.approx((-2.0, -1.0, -3.0))  # upwind, north, down
    assert np.degrees(first(there.heading, "heading_rad")) == pytest.approx([10.0])


@pytest.mark.parametrize(
    ("yaw_deg", "heading_deg"), [(90.0, 0.0), (-91.0, 179.0), (-89.0, -179.0), (80.0, -10.0)]
)
def test_heading_is_from_upwind_within_a_half_turn(yaw_deg: float, heading_deg: float) -> None:
    attitude = of([0.0], roll_rad=[0.0], pitch_rad=[0.0], yaw_rad=[radians(yaw_deg)])
    there = placed(flown(attitude=attitude), EASTERLY)
    assert np.degrees(first(there.heading, "heading_rad")) == pytest.approx([heading_deg])


def test_what_the_log_tells_in_that_frame_itself_stays() -> None:
    path = of([0.0], x_m=[1.0], y_m=[2.0], z_m=[3.0])
    motion = of([0.0], velocity_x_mps=[1.0], velocity_y_mps=[2.0], climb_mps=[3.0])
    heading = of([0.0], heading_rad=[0.1])
    there = placed(flown(path=path, motion=motion, heading=heading), EASTERLY)
    assert (there.path, there.motion, there.heading) == (path, motion, heading)


def test_a_path_without_y_gives_way_to_a_position_but_not_to_one_of_unknown_origin() -> None:
    logged = of([0.0], x_m=[1.0], y_m=[nan], z_m=[3.0])
    assert first(placed(flown(path=logged), EASTERLY).path, "x_m") == pytest.approx([3.0])
    relative = placed(flown(path=logged, absolute_positions=False), EASTERLY)
    assert relative.path is logged
    assert placed(flown(absolute_positions=False), EASTERLY).path is None
    assert placed(flight(), EASTERLY) == flight()


# --- e_rho ----------------------------------------------------------------------------------------


def test_e_rho_is_the_distance_to_the_line_above_it_positive() -> None:
    """A line through (1, 2), three up on four: (0, 3) lies above it, (2, 2) below, (5, 5) on it."""
    path = of([1.0, 2.0, 3.0], x_m=[0.0, 2.0, 5.0], y_m=[0.0] * 3, z_m=[3.0, 2.0, 5.0])
    line = of([0.0], x_m=[1.0], z_m=[2.0], eta_rad=[atan2(3.0, 4.0)], moving=[0.0])
    there = on_line(flight(path=path, line=line))
    assert there.tracking is not None
    assert there.tracking["e_rho_m"] == pytest.approx([1.4, -0.6, 0.0])
    assert there.tracking.source == "made up and made up"


def test_e_rho_that_was_reported_stays_and_without_path_or_line_there_is_none() -> None:
    path = of([0.0], x_m=[0.0], y_m=[0.0], z_m=[0.0])
    line = of([0.0], x_m=[0.0], z_m=[1.0], eta_rad=[0.0], moving=[0.0])
    logged = of([0.0], e_rho_m=[0.7])
    assert on_line(flight(path=path, line=line, tracking=logged)).tracking is logged
    assert on_line(flight(path=path)).tracking is None
    assert on_line(flight(line=line)).tracking is None


# --- surfaces -------------------------------------------------------------------------------------


def surface(channel: int, *, backward: bool = False) -> Surface:
    return Surface(channel=channel, pwm_min=1000, pwm_trim=1400, pwm_max=2000, reversed=backward)


PLAIN: dict[str, Any] = {"elevator": surface(2), "rudder": surface(4), "aileron": surface(1)}


def moved(channel: int, pulses: list[float], others: float = 1400.0) -> Series:
    channels = {str(i): [others] * len(pulses) for i in (1, 2, 4, 6)} | {str(channel): pulses}
    return of([float(i) for i in range(len(pulses))], **channels)


@pytest.mark.parametrize("name", ["elevator", "rudder", "aileron"])
@pytest.mark.parametrize(("backward", "sign"), [(False, 1.0), (True, -1.0)])
def test_pulses_are_deflections_about_the_trim(name: str, backward: bool, sign: float) -> None:
    """Below the trim 400 us are a whole deflection, above it 600."""
    own = surface(PLAIN[name].channel, backward=backward)
    outputs = moved(own.channel, [1000.0, 1200.0, 1400.0, 1700.0, 2000.0, 2100.0, 0.0])
    there = steered(flight(outputs=outputs), Surfaces(**(PLAIN | {name: own})))
    assert there.surfaces is not None
    expected = [sign * each for each in (-1.0, -0.5, 0.0, 0.5, 1.0, 1.0)]
    assert there.surfaces[name] == pytest.approx([*expected, nan], nan_ok=True)
    others = [each for each in COLUMNS["surfaces"] if each != name]
    assert all(there.surfaces[each] == pytest.approx([0.0] * 7) for each in others)
    assert there.brake is None


def test_commands_that_the_log_tells_stay_and_a_channel_that_is_not_reported_gives_none() -> None:
    outputs = moved(2, [1400.0])
    logged = of([0.0], elevator=[0.1], aileron=[0.0], rudder=[0.0])
    surfaces = Surfaces(**PLAIN)
    assert steered(flight(outputs=outputs, surfaces=logged), surfaces).surfaces is logged
    assert steered(flight(), surfaces).surfaces is None
    silent = Surfaces(**(PLAIN | {"rudder": surface(9)}))
    assert steered(flight(outputs=outputs), silent).surfaces is None


@pytest.mark.parametrize(
    ("backward", "expected"), [(False, [0.0, 0.4, 1.0, nan]), (True, [1.0, 0.6, 0.0, nan])]
)
def test_a_flap_brakes_from_one_end_of_its_pulses_to_the_other(
    backward: bool, expected: list[float]
) -> None:
    outputs = moved(6, [1000.0, 1400.0, 2000.0, 0.0])
    surfaces = Surfaces(**PLAIN, flap=surface(6, backward=backward))
    there = steered(flight(outputs=outputs), surfaces)
    assert there.brake is not None
    assert there.brake["brake"] == pytest.approx(expected, nan_ok=True)
    elsewhere = Surfaces(**PLAIN, flap=surface(9))
    assert steered(flight(outputs=outputs), elsewhere).brake is None


def test_a_brake_is_read_from_the_pulses_beside_commands_that_the_log_tells() -> None:
    outputs = moved(6, [1000.0, 2000.0])
    logged = of([0.0, 1.0], elevator=[0.1] * 2, aileron=[0.0] * 2, rudder=[0.0] * 2)
    surfaces = Surfaces(**PLAIN, flap=surface(6))
    there = steered(flight(outputs=outputs, surfaces=logged), surfaces)
    assert there.surfaces is logged
    assert there.brake is not None
    assert there.brake["brake"].tolist() == [0.0, 1.0]
    own = of([0.0], brake=[0.3])
    assert steered(flight(outputs=outputs, brake=own), surfaces).brake is own


# --- changes --------------------------------------------------------------------------------------


def test_modes_are_reported_where_they_change() -> None:
    found = changes_of(np.array([0.0, 1.0, 2.0, 3.0]), ["a", "a", "b", "a"])
    assert found == (LoggedMode(0.0, "a"), LoggedMode(2.0, "b"), LoggedMode(3.0, "a"))
    assert mode_words(np.array([0.0, 4.0, 250.0])) == ["boot", "soaring", "mode 250"]
    assert mode_words(np.array([1.0]), ["old", "new"]) == ["new"]


def test_a_change_of_a_parameter_says_from_what_to_what() -> None:
    changes = [(1.0, "A", 2.0), (2.0, "A", 0.123456789), (3.0, "B", 1.0), (4.0, "B", 1.0)]
    assert parameter_events({"A": 2.0}, changes) == [
        Event(2.0, "parameter", "A 2 → 0.123457"),
        Event(3.0, "parameter", "B 1"),
    ]


def logged_line(**parts: list[float]) -> Series | None:
    times = [0.0, 1.0, 2.0, 3.0]
    return line_series({name: of(times, **{name: each}) for name, each in parts.items()}, "told")


def test_a_line_moves_from_a_sample_that_differs_until_one_that_does_not() -> None:
    line = logged_line(x_m=[0.0, 0.0, 1.0, 1.0], z_m=[5.0] * 4, eta_rad=[1.8] * 4)
    assert line is not None
    assert line["x_m"].tolist() == [0.0, 0.0, 1.0, 1.0]
    assert line["moving"].tolist() == [0.0, 1.0, 1.0, 0.0]
    assert line.source == "told"


@pytest.mark.parametrize("name", ["x_m", "z_m", "eta_rad"])
@pytest.mark.parametrize(("step", "moves"), [(5e-5, False), (2e-4, True)])
def test_a_tenth_of_a_millimetre_moves_a_line(name: str, step: float, moves: bool) -> None:
    parts = {"x_m": [0.0] * 4, "z_m": [5.0] * 4, "eta_rad": [1.8] * 4}
    line = logged_line(**(parts | {name: [1.0, 1.0, 1.0 + step, 1.0 + step]}))
    assert line is not None
    assert bool(line["moving"].any()) is moves


@pytest.mark.parametrize("name", ["x_m", "z_m", "eta_rad"])
def test_a_line_is_known_where_all_of_it_is(name: str) -> None:
    parts = {"x_m": [0.0] * 4, "z_m": [5.0] * 4, "eta_rad": [1.8] * 4}
    line = logged_line(**(parts | {name: [nan, 1.0, 1.0, nan]}))
    assert line is not None
    assert line.time_s.tolist() == [1.0, 2.0]
    assert len(line["moving"]) == 2
    assert logged_line(**(parts | {name: [nan] * 4})) is None
    assert logged_line(**{each: parts[each] for each in parts if each != name}) is None
