"""Out of a log of gliding: each sum and each limit by itself, the numbers worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, Series, series
from tgl_soar.analysis.logs.gliding import (
    STILL,
    MeanWind,
    glides,
    longitudinal,
    on_grid,
    through_air,
)
from tgl_soar.analysis.logs.module_log import COMMANDED

T: Any = np.arange(302) * 0.02  # three windows of two seconds, and what ends the last
ONE: Any = np.ones_like(T)
SECOND: Any = np.where(T < 2.0, 0.0, 1.0)  # from the second window on


def flight(**changes: Any) -> FlightData:
    """Down at 9 m/s over the ground, sinking at 1 m/s, for six seconds."""
    whole = FlightData(
        "made up",
        "numbers",
        attitude=series(T, "a", roll_rad=0.0 * T, pitch_rad=-0.05 * ONE, yaw_rad=0.0 * T),
        velocity=series(T, "v", north_mps=9.0 * ONE, east_mps=0.0 * T, down_mps=ONE),
        surfaces=series(T, "s", elevator=0.0 * T, aileron=0.0 * T, rudder=0.0 * T),
    )
    return replace(whole, **changes)


def turned(**columns: Any) -> Series | None:
    """The attitude with other columns."""
    still = {"roll_rad": 0.0 * T, "pitch_rad": -0.05 * ONE, "yaw_rad": 0.0 * T}
    return series(T, "a", **{**still, **columns})


def moved(**columns: Any) -> Series | None:
    """The velocity with other columns."""
    still = {"north_mps": 9.0 * ONE, "east_mps": 0.0 * T, "down_mps": ONE}
    return series(T, "v", **{**still, **columns})


# --- through the air --------------------------------------------------------------------------


def test_in_still_air_the_speed_is_that_over_the_ground() -> None:
    assert (STILL.speed_mps, STILL.from_rad) == (0.0, 0.0)
    flown = flight(velocity=moved(north_mps=-3.0 * ONE, east_mps=4.0 * ONE))
    met = through_air(flown, STILL, T[5:9])
    assert met.time_s.tolist() == T[5:9].tolist()
    assert met.horizontal_mps == pytest.approx(4 * [5.0])
    assert met.climb_mps == pytest.approx(4 * [-1.0])
    assert met.how == "v in still air"


def test_a_wind_from_the_north_east_adds_to_both_components() -> None:
    flown = flight(velocity=moved(north_mps=3.0 * ONE, east_mps=5.0 * ONE))
    met = through_air(flown, MeanWind(2.0, pi / 6.0), T[5:7])
    expected = hypot(3.0 + 2.0 * cos(pi / 6.0), 5.0 + 2.0 * sin(pi / 6.0))
    assert met.horizontal_mps == pytest.approx(2 * [expected])
    assert met.how == "v less a wind of 2 m/s"


def in_soaring_frame(**changes: Any) -> FlightData:
    motion = series(
        T, "m", velocity_x_mps=-3.0 * ONE, velocity_y_mps=4.0 * ONE, climb_mps=-0.5 * ONE
    )
    return flight(velocity=None, motion=motion, **changes)


def test_in_the_soaring_frame_the_wind_blows_along_x() -> None:
    met = through_air(in_soaring_frame(), MeanWind(6.0, 0.0), T[5:7])
    assert met.horizontal_mps == pytest.approx(2 * [hypot(9.0, 4.0)])
    assert met.climb_mps == pytest.approx(2 * [-0.5])
    assert met.how == "m less a wind of 6 m/s"
    assert through_air(in_soaring_frame(), STILL, T[:1]).horizontal_mps == pytest.approx([5.0])
    with pytest.raises(ValueError, match="leave out --wind-from"):
        through_air(in_soaring_frame(), MeanWind(6.0, -0.1), T)


def test_local_velocities_come_before_those_of_the_soaring_frame() -> None:
    both = replace(in_soaring_frame(), velocity=moved())
    assert through_air(both, STILL, T[:1]).how.startswith("v ")


def pitot(cover: float, mps: float = 10.0) -> Series | None:
    """An airspeed for a fraction of the flight."""
    n = round(cover * len(T))
    return series(T[:n], "pitot", airspeed_mps=np.full(n, mps))


@pytest.mark.parametrize(("cover", "used"), [(0.79, False), (0.81, True)])
def test_an_airspeed_counts_where_it_covers_four_fifths_of_the_velocity(
    cover: float, used: bool
) -> None:
    met = through_air(flight(airspeed=pitot(cover)), MeanWind(1.0, 0.0), T)
    assert met.how == ("pitot and v" if used else "v less a wind of 1 m/s")
    assert met.horizontal_mps[0] == pytest.approx(sqrt(100.0 - 1.0) if used else 10.0)
    assert np.isnan(met.horizontal_mps[-1]) == used  # nothing fills what it does not cover


def test_of_a_velocity_with_holes_an_airspeed_covers_as_many() -> None:
    """Half the velocity and half the airspeed: the airspeed covers all of it."""
    half = moved()
    assert half is not None
    flown = flight(velocity=half.within(0.0, 3.0), airspeed=pitot(0.5))
    assert through_air(flown, STILL, T).how == "pitot and v"


def test_an_airspeed_below_the_climb_is_none_along_the_ground() -> None:
    met = through_air(flight(airspeed=pitot(1.0, 0.5)), STILL, T[5:7])
    assert met.horizontal_mps.tolist() == [0.0, 0.0]
    assert through_air(flight(airspeed=pitot(1.0, 1.25)), STILL, T[:1]).horizontal_mps == (
        pytest.approx([0.75])
    )


# --- glides ------------------------------------------------------------------------------------


def test_a_glide_lies_on_a_grid_of_fiftieths() -> None:
    """A window of two seconds ends a fiftieth before it, and three of them are six of those."""
    (one,) = glides(flight())
    assert one.duration_s == pytest.approx(3 * 1.98)
    assert (one.pitch_rad, one.brake) == pytest.approx((-0.05, 0.0))
    (short,) = glides(flight(), window_s=1.0)
    assert short.duration_s == pytest.approx(6 * 0.98)


def test_a_glide_reaches_to_the_last_point_before_the_attitudes_end() -> None:
    """Attitudes until six seconds: the last point lies a fiftieth before."""
    attitude = turned()
    assert attitude is not None
    (one,) = glides(flight(attitude=attitude.within(0.0, 6.001)))
    assert one.duration_s == pytest.approx(3 * 1.98)


@pytest.mark.parametrize(("spread_rad", "found"), [(0.009, True), (0.011, False)])
def test_the_pitch_of_a_glide_spreads_by_a_hundredth_at_most(
    spread_rad: float, found: bool
) -> None:
    waving = -0.05 + spread_rad * np.where(np.arange(len(T)) % 2 == 0, 1.0, -1.0)
    flown = flight(attitude=turned(pitch_rad=waving))
    if found:
        assert len(glides(flown)) == 1
    else:
        with pytest.raises(ValueError, match="is a steady glide"):
            glides(flown)
        assert len(glides(flown, pitch_spread_rad=0.012)) == 1


@pytest.mark.parametrize(("change_mps", "count"), [(0.24, 1), (0.26, 2), (-0.24, 1), (-0.26, 2)])
def test_stretches_within_a_quarter_of_a_metre_a_second_are_one_glide(
    change_mps: float, count: int
) -> None:
    flown = flight(velocity=moved(north_mps=9.0 + change_mps * SECOND))
    assert len(glides(flown)) == count


@pytest.mark.parametrize(("further", "count"), [(0.019, 1), (0.021, 2), (-0.021, 2)])
def test_stretches_with_the_brake_elsewhere_are_several_glides(further: float, count: int) -> None:
    flown = flight(brake=series(T, "b", brake=0.5 + further * SECOND))
    found = glides(flown)
    assert len(found) == count
    assert found[-1].brake == pytest.approx(0.5 + further * (1.0 if count == 2 else 2.0 / 3.0))


def test_one_glide_of_several_stretches_is_their_mean_by_time() -> None:
    """Of a third of one and two thirds of the other, and after a third stretch in the same way."""
    flown = flight(
        attitude=turned(pitch_rad=-0.05 + 0.03 * SECOND),
        velocity=moved(north_mps=9.0 + 0.15 * SECOND, down_mps=1.0 + 0.06 * SECOND),
        brake=series(T, "b", brake=0.5 + 0.015 * SECOND),
    )
    (one,) = glides(flown)
    found = (one.pitch_rad, one.speed_mps, one.sink_mps, one.brake)
    assert found == pytest.approx((-0.03, 9.1, 1.04, 0.51), abs=1e-9)


@pytest.mark.parametrize(("roll_rad", "level"), [(0.19, True), (0.21, False), (-0.21, False)])
def test_wings_are_level_within_a_fifth_of_a_radian(roll_rad: float, level: bool) -> None:
    flown = flight(attitude=turned(roll_rad=roll_rad * ONE))
    if level:
        assert len(glides(flown)) == 1
    else:
        with pytest.raises(ValueError, match="no level flight with a velocity and an attitude"):
            glides(flown)


def test_a_grids_single_row_is_no_level_flight() -> None:
    rolled = np.where(np.arange(len(T)) < 1, 0.0, 0.5)
    with pytest.raises(ValueError, match="no level flight"):
        glides(flight(attitude=turned(roll_rad=rolled)))


@pytest.mark.parametrize("down_mps", [-0.01, -0.5, 9.5])
def test_what_does_not_sink_or_falls_steeper_than_it_goes_is_no_glide(down_mps: float) -> None:
    with pytest.raises(ValueError, match="3 steady stretches, and none of them sinks"):
        glides(flight(velocity=moved(down_mps=down_mps * ONE)))


def test_a_brake_that_is_known_for_a_while_leaves_out_the_rest() -> None:
    known = series(T[:150], "b", brake=np.full(150, 0.4))
    (one,) = glides(flight(brake=known))
    assert one.brake == pytest.approx(0.4)
    assert one.duration_s == pytest.approx(1.98)  # its second window is not whole
    nothing = series(T, "b", brake=np.full_like(T, np.nan))
    (one,) = glides(flight(brake=nothing))
    assert one.brake == 0.0
    assert one.duration_s == pytest.approx(3 * 1.98)


def test_what_is_missing_of_velocity_or_pitch_is_left_out() -> None:
    gone = np.where(T < 2.5, np.nan, 1.0)
    for changes in (
        {"velocity": moved(north_mps=9.0 * gone)},
        {"velocity": moved(down_mps=gone)},
        {"attitude": turned(pitch_rad=-0.05 * gone)},
    ):
        (one,) = glides(flight(**changes))
        assert one.duration_s < 3.6
        assert one.speed_mps == pytest.approx(9.0)


# --- for identification ---------------------------------------------------------------------------


def test_a_lack_of_attitude_or_surfaces_is_named() -> None:
    with pytest.raises(ValueError, match="holds no attitude: nothing can be identified"):
        longitudinal(flight(attitude=None))
    words = r"holds no surface deflections \(give --airframe\): nothing can be identified"
    with pytest.raises(ValueError, match=words):
        longitudinal(flight(surfaces=None))


def test_the_grid_of_an_identification_is_of_hundredths() -> None:
    found = longitudinal(flight(attitude=turned(roll_rad=0.1 * ONE)))
    assert found.time_s == pytest.approx(np.arange(602) * 0.01)
    assert found.roll_rad[:-1] == pytest.approx(0.1)
    assert found.pitch_rad[:-1] == pytest.approx(-0.05)
    assert found.airspeed_mps[:-1] == pytest.approx(hypot(9.0, 1.0))
    assert found.path_angle_rad[:-1] == pytest.approx(atan2(-1.0, 9.0))
    assert found.brake is None


def test_the_lift_is_the_force_across_the_path() -> None:
    """By vectors: the path's own up direction in the aircraft's axes."""
    fx, fz, path = 0.7, -9.5, atan2(-1.0, 9.0)
    imu = series(T, "i", force_x_frd_mps2=fx * ONE, force_z_frd_mps2=fz * ONE,
                 pitch_rate_frd_radps=np.full_like(T, np.nan))  # fmt: skip
    found = longitudinal(flight(imu=imu)).lift_force_mps2
    pitch = -0.05
    turn = np.array([[cos(pitch), sin(pitch)], [-sin(pitch), cos(pitch)]])  # to north and down
    north, down = turn @ np.array([fx, fz])
    expected = -down * cos(path) - north * sin(path)
    assert found is not None
    assert found[:-1] == pytest.approx(expected)
    silent = series(T, "i", force_x_frd_mps2=fx * ONE, force_z_frd_mps2=np.full_like(T, np.nan),
                    pitch_rate_frd_radps=np.full_like(T, np.nan))  # fmt: skip
    assert longitudinal(flight(imu=silent)).lift_force_mps2 is None


RAMP: Any = np.where(T < 3.0, 0.0, np.minimum(1.0, T - 3.0))


@pytest.mark.parametrize(("source", "ahead_s"), [(COMMANDED, 0.0), ("RCOU", 0.01)])
def test_what_is_read_back_is_looked_for_half_a_sample_ahead(source: str, ahead_s: float) -> None:
    """Of a staircase of fiftieths every hundredth lies on one stair or half on each of two."""
    columns = {"elevator": RAMP, "aileron": 0.0 * T, "rudder": 0.0 * T}
    flown = flight(surfaces=series(T, source, **columns), brake=series(T, source, brake=0.5 * RAMP))
    found = longitudinal(flown)
    assert found.elevator_step_s == pytest.approx(0.02)
    assert found.brake is not None
    for at in (320, 321, 351):
        t = found.time_s[at] + ahead_s
        stair = np.floor(t / 0.02 + 1e-6) * 0.02
        assert found.elevator[at] == pytest.approx(stair - 3.0, abs=1e-6)
        assert found.brake[at] == pytest.approx(0.5 * (stair - 3.0), abs=1e-6)


def test_a_step_of_the_grid_between_two_samples_holds_the_mean_of_both() -> None:
    """Samples at 0, 15 and 40 ms: from 10 to 20 ms half of the first and half of the second."""
    times = np.array([0.0, 0.015, 0.04, 0.06])
    columns = {"aileron": np.zeros(4), "rudder": np.zeros(4)}
    logged = series(times, COMMANDED, elevator=np.array([0.2, 0.6, -1.0, 0.0]), **columns)
    found = longitudinal(flight(surfaces=logged)).elevator
    assert found[:5] == pytest.approx([0.2, 0.4, 0.6, 0.6, -1.0])
    assert np.isnan(found[6:]).all()
    assert longitudinal(flight(surfaces=logged)).elevator_step_s == pytest.approx(0.02)


def test_two_samples_of_the_surfaces_make_a_column_and_one_makes_none() -> None:
    def logged(n: int) -> Series | None:
        columns = dict.fromkeys(("aileron", "rudder"), np.zeros(n))
        return series(np.arange(n) * 0.03, COMMANDED, elevator=np.full(n, 0.3), **columns)

    two = longitudinal(flight(surfaces=logged(2)))
    assert two.elevator[:4] == pytest.approx([0.3, 0.3, 0.3, np.nan], nan_ok=True)
    assert two.elevator_step_s == pytest.approx(0.03)
    one = longitudinal(flight(surfaces=logged(1)))
    assert np.isnan(one.elevator).all()
    assert len(one.elevator) == len(one.time_s)
    assert one.elevator_step_s == 0.01


def rates(n: int, value: float, **columns: Any) -> Series | None:
    logged = np.where(np.arange(len(T)) < n, value, np.nan)
    return series(T, "r", pitch_rate_frd_radps=logged, **columns)


@pytest.mark.parametrize(("of_imu", "of_rates", "value"), [(300, 200, 1.0), (200, 300, 2.0)])
def test_the_pitch_rate_is_that_which_is_reported_oftenest(
    of_imu: int, of_rates: int, value: float
) -> None:
    forces = dict.fromkeys(("force_x_frd_mps2", "force_z_frd_mps2"), 0.0 * T)
    flown = flight(imu=rates(of_imu, 1.0, **forces), rates=rates(of_rates, 2.0))
    assert longitudinal(flown).pitch_rate_radps[10] == value


def test_rates_that_tell_nothing_are_none() -> None:
    climbing = turned(pitch_rad=0.2 * T)
    found = longitudinal(flight(attitude=climbing, rates=rates(0, 1.0))).pitch_rate_radps
    assert found[1:-1] == pytest.approx(0.2)


def test_a_difference_of_pitch_reaches_over_two_steps() -> None:
    bent = np.maximum(0.0, T - 3.0)
    found = longitudinal(flight(attitude=turned(pitch_rad=bent))).pitch_rate_radps
    assert found[[0, 298, 299, 300, 301, 302]] == pytest.approx(
        [np.nan, 0.0, 0.0, 0.5, 1.0, 1.0], nan_ok=True
    )
    assert np.isfinite(found[1:-1]).all()
    assert np.isnan(found[-1])


@pytest.mark.parametrize(("seconds", "known"), [(0.025, 1), (0.015, 0)])
def test_of_three_steps_one_has_a_difference_and_of_two_none(seconds: float, known: int) -> None:
    times = np.array([0.0, seconds])
    columns = {"roll_rad": np.zeros(2), "yaw_rad": np.zeros(2)}
    brief = series(times, "a", pitch_rad=0.4 * times, **columns)
    found = longitudinal(flight(attitude=brief)).pitch_rate_radps
    assert found[np.isfinite(found)] == pytest.approx(known * [0.4])


# --- on a grid ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gap_s", "bridged"), [(0.149, True), (0.151, False)])
def test_a_gap_of_three_twentieths_of_a_second_is_bridged(gap_s: float, bridged: bool) -> None:
    samples = series(np.array([0.0, gap_s]), "x", y=np.array([0.0, gap_s]))
    assert samples is not None
    at = np.array([0.0, 0.1, gap_s])
    assert on_grid(samples, "y", at) == pytest.approx(
        [0.0, 0.1 if bridged else np.nan, gap_s], nan_ok=True
    )


def test_a_sample_that_tells_nothing_makes_a_gap() -> None:
    y = np.array([0.0, np.nan, 2.0, 3.0])
    samples = series(np.array([0.0, 0.1, 0.2, 0.3]), "x", y=y)
    assert samples is not None
    assert on_grid(samples, "y", np.array([0.0, 0.1, 0.2, 0.25])) == pytest.approx(
        [0.0, np.nan, 2.0, 2.5], nan_ok=True
    )
    none = series(np.array([0.0, 0.1]), "x", y=np.array([np.nan, np.nan]))
    assert none is not None
    assert np.isnan(on_grid(none, "y", np.array([0.0, 0.05]))).all()


def test_two_samples_of_one_column_have_one_gap() -> None:
    samples = series(np.array([1.0, 1.1]), "x", y=np.array([5.0, 6.0]))
    assert samples is not None
    assert on_grid(samples, "y", np.array([0.99, 1.0, 1.05, 1.1, 1.11])) == pytest.approx(
        [np.nan, 5.0, 5.5, 6.0, np.nan], nan_ok=True
    )
