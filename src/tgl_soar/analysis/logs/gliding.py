"""What a log tells of gliding: the air that was met, steady glides, and the elevator's manoeuvres.

Speed and climb through the air are those over the ground less a wind that somebody names (none:
still air), or, with a pitot tube, the airspeed itself and the climb.  Only flight in air that
does not rise or sink tells anything: nothing in the log itself can say that it did not.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.analysis.logs.flight_data import FlightData, Floats, Series
from tgl_soar.analysis.logs.module_log import COMMANDED
from tgl_soar.analysis.manoeuvres import STEP_S, LongitudinalLog
from tgl_soar.estimation.polar import BRAKE_SLACK, GlideStretch, glides_from_log

GRID_S: Final = 0.02  # of glides
GAP_MAX_S: Final = 0.15  # over a longer one nothing is interpolated
SAME_GLIDE_MPS: Final = 0.25
LEVEL_ROLL_RAD: Final = 0.2
WHOLE: Final = 0.8  # share of the flight that an airspeed must cover to be used
RATE_SMOOTHING_S: Final = 0.02  # of a pitch rate that is a difference of angles


class MeanWind(NamedTuple):
    """A steady horizontal wind."""

    speed_mps: float
    from_rad: float  # clockwise from north


STILL: Final = MeanWind(0.0, 0.0)


class ThroughAir(NamedTuple):
    """How the aircraft went through the air, columns of shape (n,), NaN in gaps."""

    time_s: Floats
    horizontal_mps: Floats
    climb_mps: Floats
    how: str  # where it comes from, in words


def through_air(flight: FlightData, wind: MeanWind, time_s: Floats) -> ThroughAir:
    """At these times.  Errors: ValueError where the log holds no velocity."""
    velocity, motion = flight.velocity, flight.motion
    if velocity is not None:
        north = on_grid(velocity, "north_mps", time_s) + wind.speed_mps * cos(wind.from_rad)
        east = on_grid(velocity, "east_mps", time_s) + wind.speed_mps * sin(wind.from_rad)
        horizontal, climb = np.hypot(north, east), -on_grid(velocity, "down_mps", time_s)
        source = velocity.source
    elif motion is not None:
        if wind.from_rad != 0.0:
            raise ValueError(
                "the log's velocity is that of the soaring frame: its wind blows along x, so"
                " leave out --wind-from"
            )
        along = on_grid(motion, "velocity_x_mps", time_s) - wind.speed_mps
        across = on_grid(motion, "velocity_y_mps", time_s)
        horizontal, climb = np.hypot(along, across), on_grid(motion, "climb_mps", time_s)
        source = motion.source
    else:
        raise ValueError("the log holds no velocity: neither a glide nor its angle can be found")
    airspeed = flight.airspeed
    if airspeed is not None and len(airspeed):
        measured = on_grid(airspeed, "airspeed_mps", time_s)
        if np.isfinite(measured).mean() >= WHOLE * np.isfinite(horizontal).mean():
            with np.errstate(invalid="ignore"):
                horizontal = np.sqrt(np.maximum(measured**2 - climb**2, 0.0))
            return ThroughAir(time_s, horizontal, climb, f"{airspeed.source} and {source}")
    words = f"less a wind of {wind.speed_mps:g} m/s" if wind.speed_mps else "in still air"
    return ThroughAir(time_s, horizontal, climb, f"{source} {words}")


def glides(
    flight: FlightData,
    wind: MeanWind = STILL,
    *,
    window_s: float = 2.0,
    pitch_spread_rad: float = 0.01,
) -> tuple[GlideStretch, ...]:
    """Steady glides, wings level; stretches of one glide are one, for they err together.

    Errors: ValueError saying what the log lacks.
    """
    attitude = flight.attitude
    if attitude is None:
        raise ValueError("the log holds no attitude: a steady pitch cannot be found")
    times = np.arange(float(attitude.time_s[0]), float(attitude.time_s[-1]), GRID_S)
    air = through_air(flight, wind, times)
    pitch, roll = on_grid(attitude, "pitch_rad", times), on_grid(attitude, "roll_rad", times)
    level = np.abs(roll) <= LEVEL_ROLL_RAD
    good = level & np.isfinite(pitch) & np.isfinite(air.horizontal_mps) & np.isfinite(air.climb_mps)
    # A log that knows of no brake is one of an aircraft without.
    brake = np.zeros_like(times) if flight.brake is None else on_grid(flight.brake, "brake", times)
    if np.isfinite(brake[good]).any():
        good &= np.isfinite(brake)
    else:
        brake = np.zeros_like(times)
    if good.sum() < 2:
        raise ValueError("the log holds no level flight with a velocity and an attitude")
    found = glides_from_log(
        times[good].tolist(),
        pitch[good].tolist(),
        air.horizontal_mps[good].tolist(),
        air.climb_mps[good].tolist(),
        brake[good].tolist(),
        window_s=window_s,
        pitch_spread_rad=pitch_spread_rad,
    )
    falling = _joined([g for g in found if 0.0 < g.sink_mps < g.speed_mps])
    if not falling:
        raise ValueError(
            f"{len(found)} steady stretches, and none of them sinks: that was no gliding in still"
            " air"
        )
    return tuple(falling)


def _joined(stretches: Sequence[GlideStretch]) -> list[GlideStretch]:
    """Stretches one after the other at nearly one speed, as one each."""
    joined: list[GlideStretch] = []
    for new in stretches:
        last = joined[-1] if joined else None
        if (
            last is None
            or abs(new.speed_mps - last.speed_mps) > SAME_GLIDE_MPS
            or abs(new.brake - last.brake) > BRAKE_SLACK
        ):
            joined.append(new)
            continue
        whole_s = last.duration_s + new.duration_s
        fraction = new.duration_s / whole_s
        joined[-1] = GlideStretch(
            pitch_rad=last.pitch_rad + fraction * (new.pitch_rad - last.pitch_rad),
            speed_mps=last.speed_mps + fraction * (new.speed_mps - last.speed_mps),
            sink_mps=last.sink_mps + fraction * (new.sink_mps - last.sink_mps),
            duration_s=whole_s,
            brake=last.brake + fraction * (new.brake - last.brake),
        )
    return joined


def longitudinal(flight: FlightData, wind: MeanWind = STILL) -> LongitudinalLog:
    """The columns that identification takes.  Errors: ValueError saying what the log lacks."""
    attitude, surfaces = flight.attitude, flight.surfaces
    if attitude is None or surfaces is None:
        what = "attitude" if attitude is None else "surface deflections (give --airframe)"
        raise ValueError(f"the log holds no {what}: nothing can be identified")
    times = np.arange(float(attitude.time_s[0]), float(attitude.time_s[-1]), STEP_S)
    # Of what is seen at one sample and not at the one before, the middle is the best guess.
    step_s = float(np.median(np.diff(surfaces.time_s))) if len(surfaces) > 1 else STEP_S
    ahead_s = 0.0 if surfaces.source == COMMANDED else 0.5 * step_s
    air = through_air(flight, wind, times)
    pitch = on_grid(attitude, "pitch_rad", times)
    lift: Floats | None = None
    path_angle = np.arctan2(air.climb_mps, air.horizontal_mps)
    imu = flight.imu
    if imu is not None:
        fx, fz = (on_grid(imu, f"force_{axis}_frd_mps2", times) for axis in "xz")
        if np.isfinite(fz).any():
            alpha = pitch - path_angle
            lift = fx * np.sin(alpha) - fz * np.cos(alpha)
    return LongitudinalLog(
        time_s=times,
        elevator=_held(surfaces, "elevator", times + ahead_s),
        pitch_rad=pitch,
        pitch_rate_radps=_pitch_rate(flight, pitch, times),
        roll_rad=on_grid(attitude, "roll_rad", times),
        airspeed_mps=np.hypot(air.horizontal_mps, air.climb_mps),
        path_angle_rad=path_angle,
        lift_force_mps2=lift,
        elevator_step_s=step_s,
        brake=None if flight.brake is None else _held(flight.brake, "brake", times + ahead_s),
    )


def _pitch_rate(flight: FlightData, pitch_rad: Floats, time_s: Floats) -> Floats:
    """From whatever tells it oftenest; from the pitch where nothing does."""
    name = "pitch_rate_frd_radps"
    tell = [s for s in (flight.imu, flight.rates) if s is not None and np.isfinite(s[name]).any()]
    if not tell:
        return _difference(pitch_rad)
    return on_grid(max(tell, key=lambda s: np.count_nonzero(np.isfinite(s[name]))), name, time_s)


def _held(samples: Series, name: str, time_s: Floats) -> Floats:
    """The mean of a column over each step of the grid, every sample holding until the next.

    NaN over a gap: `GAP_MAX_S`, or five usual distances of samples where they come less often.
    """
    known = np.isfinite(samples[name])
    at, values = samples.time_s[known], samples[name][known]
    if at.size < 2:
        return np.full(len(time_s), np.nan)
    # The integral of a staircase is straight between its samples.
    integral = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(at))])
    begin = np.interp(time_s, at, integral, left=np.nan, right=np.nan)
    end = np.interp(time_s + STEP_S, at, integral, left=np.nan, right=np.nan)
    gaps = np.diff(at)
    wide = gaps > max(GAP_MAX_S, 5.0 * float(np.median(gaps)))
    last = len(gaps) - 1
    first_in = (np.searchsorted(at, time_s, side="right") - 1).clip(0, last)
    last_in = (np.searchsorted(at, time_s + STEP_S, side="left") - 1).clip(0, last)
    known_there = ~(wide[first_in] | wide[last_in])
    return np.where(known_there, (end - begin) / STEP_S, np.nan)


def on_grid(samples: Series, name: str, time_s: Floats) -> Floats:
    """A column at other times, linear between samples that are not too far apart; else NaN."""
    values = samples.at(name, time_s)
    known = samples.time_s[np.isfinite(samples[name])]
    if not known.size:
        return values
    after = np.searchsorted(known, time_s, side="left").clip(0, known.size - 1)
    before = (np.searchsorted(known, time_s, side="right") - 1).clip(0, known.size - 1)
    gap: Floats = known[after] - known[before]
    return np.where(gap <= GAP_MAX_S, values, np.nan)


def _difference(angle_rad: Floats) -> Floats:
    """The rate of an angle on the grid, over a little more than a step."""
    wide = max(1, round(RATE_SMOOTHING_S / (2.0 * STEP_S)))
    rate = np.full_like(angle_rad, np.nan)
    if len(angle_rad) > 2 * wide:
        rate[wide:-wide] = (angle_rad[2 * wide :] - angle_rad[: -2 * wide]) / (2 * wide * STEP_S)
    return rate
