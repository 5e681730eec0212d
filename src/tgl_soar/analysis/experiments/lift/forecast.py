"""`forecast`: which lines are reported to have no place to settle, how early, which wrongly.

Slides along lines in air that the forecast's thresholds were not chosen in: a board at 26° and a
hill of 14 m.  The line holds the aircraft without error, so that thousands are cheap:

    c s' = E(s) + (V/g) cos(eta) s''

with gusts, an aircraft whose sink is not that of its file, and estimates with bias and noise.  What
a short period, servos and a stall add is not in it.
"""

from __future__ import annotations

from math import cos, exp, radians, sin, sqrt, tan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.analysis.campaigns.drawn_faults import wilson
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.config.site import GroundProfile
from tgl_soar.control.envelope import Fence, clearance, outside
from tgl_soar.control.forecast import (
    DISENGAGE,
    FORECAST_TEXTS,
    WINDOW_S,
    Forecast,
    ForecastParams,
    forecast_step,
    initial_forecast,
    nowhere,
)
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.types import GRAVITY_MPS2, NO_AIR, GlidePolar, Ground, VehicleState

FloatArray = NDArray[np.float64]

FLIGHTS: Final = 500  # of each kind at each place
DT_S: Final = 0.02
EVERY: Final = 5  # steps between two readings
REPORTED_S: Final = 1.5  # after it could be known
START_M: Final = 0.7  # from the crossing, at most, along the line
LEANS_DEG: Final = (10.0, 15.0, 20.0, 25.0)
GUSTS: Final = (0.01, 0.03, 0.05)
WINDS: Final = (0.75, 1.15)  # times the place's
CHANGES: Final = (0.85, 1.2)  # of the wind, in eight seconds, in half of the flights that settle
SINKS: Final = (0.9, 1.1)  # times the file's
UPDRAFT_BIAS_MPS: Final = 0.06
WIND_BIAS_MPS: Final = 0.15


class SlidePlace(NamedTuple):
    """A place to fly at."""

    name: str
    field: WindField
    ground: Ground
    fence: Fence
    clearance_min_m: float
    scale_m: float  # of the gusts
    duration_s: float
    step_m: float  # of E along a line


class SlideStart(NamedTuple):
    """One flight: where and on which line it begins, in which air."""

    x_m: float
    z_m: float
    eta_rad: float
    wind: float  # times the field's
    change: float  # of that, times, from the second second on
    gusts: float
    sink: float  # times the file's


class Slid(NamedTuple):
    """One flight as it ended."""

    start: SlideStart
    foreseen: Forecast | None  # when it was reported; None: never
    time_s: float  # of that, or of the flight's end
    left_m: float  # above the clearance then
    is_outside: bool  # the fence, unreported


def places() -> tuple[SlidePlace, ...]:
    """Air and ground of which no threshold of the forecast knows."""
    slope, radius_m = radians(26.0), 14.0
    board = GroundProfile([(-2.0, 0.0), (0.0, 0.0), (2.2, 2.2 * tan(slope))]).as_ground()
    turns = [radians(180.0 - 180.0 * i / 7.0) for i in range(8)]
    hill = GroundProfile([(radius_m * cos(a), radius_m * sin(a)) for a in turns]).as_ground()
    return (
        SlidePlace(
            name="board at 26°",
            field=SlopeJet(8.5, slope),
            ground=board,
            fence=Fence(x_min_m=-0.5, x_max_m=2.2, y_max_m=1.3, z_min_m=0.15, z_max_m=2.85),
            clearance_min_m=0.3,
            scale_m=1.5,
            duration_s=8.0,
            step_m=0.01,
        ),
        SlidePlace(
            name="hill of 14 m",
            field=HillField(8.0, radius_m),
            ground=hill,
            fence=Fence(x_min_m=-42.0, x_max_m=0.0, y_max_m=28.0, z_min_m=0.5, z_max_m=42.0),
            clearance_min_m=1.5,
            scale_m=8.0,
            duration_s=30.0,
            step_m=0.05,
        ),
    )


def run(context: Context) -> Result:
    """Lines without a crossing and with one, at both places."""
    count = 40 if context.quick else FLIGHTS
    polar = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
    without: dict[str, list[Slid]] = {}
    having: dict[str, list[Slid]] = {}
    for number, place in enumerate(places()):
        for kind, settles in ((without, False), (having, True)):
            rng = np.random.default_rng([number, int(settles)])
            starts = [drawn(place, polar, settles, rng) for _ in range(count)]
            kind[place.name] = fly(place, polar, starts, rng)
    return Result(
        name="forecast",
        title="the place to settle foreseen",
        flown=f"At each place {count} starts at rest on a line that has no place to settle above"
        f" the clearance, inside the fence and the polar, and {count} within {START_M:g} m of one"
        " that has. Wind 0.75 to 1.15 of the place's, in half of the latter changing by 0.85 to"
        " 1.2;"
        " gusts of 1, 3 and 5 %; leans of 10 to 25°; sink 0.9 to 1.1 of the file's. It could be"
        " known when the line has no such place in the true field and the first window of"
        f" {WINDOW_S:g} s is filled.",
        claims=claims(without, having),
        why="",
        tables=(
            Table(
                "No place to settle",
                (
                    "place", "reported", "at the clearance first", "out of the fence first",
                    "neither", "reported after [s], median", "90 %",
                    "reported within 1.5 s, or 1 s before the limit",
                    "height left over the clearance [m], median",
                ),
                tuple(_reported_row(name, flights) for name, flights in without.items()),
            ),
            Table(
                "A place to settle",
                ("place", "flights", "reported wrongly", "95 % interval", "what was said"),
                tuple(_false_row(name, flights) for name, flights in having.items()),
            ),
        ),
        numbers={
            "without": {k: [s.time_s for s in v if s.foreseen] for k, v in without.items()},
            "false": {k: sum(s.foreseen is not None for s in v) for k, v in having.items()},
        },
    )  # fmt: skip


def sank(flight: Slid) -> bool:
    """Whether it reached the clearance unreported."""
    return flight.foreseen is None and flight.left_m < 0.0 and not flight.is_outside


def late(flight: Slid) -> bool:
    """Whether it reached the clearance unreported, REPORTED_S and more after it could be known."""
    return sank(flight) and flight.time_s > WINDOW_S + REPORTED_S


def claims(without: dict[str, list[Slid]], having: dict[str, list[Slid]]) -> tuple[Claim, ...]:
    """None too late, few wrong."""
    lost = {name: sum(late(s) for s in flights) for name, flights in without.items()}
    wrong = {name: sum(s.foreseen is not None for s in v) for name, v in having.items()}
    fractions = [wrong[name] / len(having[name]) for name in having]
    return (
        Claim(
            f"none is at the clearance unreported more than {REPORTED_S:g} s after it could be"
            " known",
            not any(lost.values()),
            ", ".join(f"{n} of {len(without[name])}, {name}" for name, n in lost.items()),
        ),
        Claim(
            "fewer than 1 % of those that would settle are reported otherwise",
            all(fraction < 0.01 for fraction in fractions),
            ", ".join(f"{n} of {len(having[name])}, {name}" for name, n in wrong.items()),
        ),
    )


def _reported_row(name: str, flights: list[Slid]) -> tuple[str, ...]:
    reported = [s for s in flights if s.foreseen is not None]
    first, out = sum(sank(s) for s in flights), sum(s.is_outside for s in flights)
    after = [s.time_s for s in reported]
    early = sum(
        s.time_s <= WINDOW_S + REPORTED_S or (s.foreseen is not None and s.foreseen.ahead_s < 1.0)
        for s in reported
    )
    return (
        name,
        f"{len(reported)} of {len(flights)}",
        f"{first}, {sum(late(s) for s in flights)} of them late",
        f"{out}",
        f"{len(flights) - len(reported) - first - out}",
        f"{np.median(after):.1f}",
        f"{np.percentile(after, 90):.1f}",
        f"{early}",
        f"{np.median([s.left_m for s in reported]):.2f}",
    )


def _false_row(name: str, flights: list[Slid]) -> tuple[str, ...]:
    standings = [FORECAST_TEXTS[s.foreseen.standing] for s in flights if s.foreseen is not None]
    low, high = wilson(len(standings), len(flights))
    words = ", ".join(f"{standings.count(text)} {text}" for text in dict.fromkeys(standings))
    fraction = f"{100 * low:.1f} to {100 * high:.1f} %"
    return (name, f"{len(flights)}", f"{len(standings)}", fraction, words or "–")


# --- the air along a line ----------------------------------------------------------------------


def sinks(polar: GlidePolar, speed_mps: FloatArray, times: FloatArray | float) -> FloatArray:
    """Sink [m/s] at speeds (n,), that of the polar's ends beyond them."""
    return times * sink(polar, np.clip(speed_mps, polar.speed_min_mps, polar.speed_max_mps))


def stops(place: SlidePlace, polar: GlidePolar, start: SlideStart, change: float) -> list[float]:
    """Where the line has a place to settle, up from the start [m]."""
    reach = 1.2 * (place.fence.z_max_m - place.fence.z_min_m)
    s = np.arange(-reach, reach, place.step_m)
    x, z = start.x_m + s * cos(start.eta_rad), start.z_m + s * sin(start.eta_rad)
    inside = (z <= place.fence.z_max_m) & (x >= place.fence.x_min_m) & (x <= place.fence.x_max_m)
    s, x, z = s[inside], x[inside], z[inside]
    wind = start.wind * change
    u, _, w = (wind * part for part in place.field.wind(x, np.zeros_like(x), z))
    excess = w - sinks(polar, u, start.sink)
    flyable = (u >= polar.speed_min_mps) & (u <= polar.speed_max_mps)
    falls = np.nonzero((excess[:-1] >= 0.0) & (excess[1:] < 0.0) & flyable[:-1])[0]
    return [float(s[i]) for i in falls if _left(place, float(x[i]), float(z[i])) >= 0.0]


def _left(place: SlidePlace, x_m: float, z_m: float) -> float:
    """Height over the clearance [m]; negative outside the fence too."""
    if outside(place.fence, x_m, 0.0, z_m):
        return -1.0
    return clearance(place.ground, x_m, z_m) - place.clearance_min_m


def drawn(
    place: SlidePlace, polar: GlidePolar, settles: bool, rng: np.random.Generator
) -> SlideStart:
    """A start on a line with or without a place to settle."""
    fence = place.fence
    while True:
        start = SlideStart(
            x_m=rng.uniform(fence.x_min_m, fence.x_max_m),
            z_m=rng.uniform(fence.z_min_m, fence.z_max_m),
            eta_rad=eta_from_lean(radians(rng.choice(LEANS_DEG))),
            wind=rng.uniform(*WINDS),
            change=rng.uniform(*CHANGES) if settles and rng.uniform() < 0.5 else 1.0,
            gusts=rng.choice(GUSTS),
            sink=rng.uniform(*SINKS),
        )
        if _left(place, start.x_m, start.z_m) < 0.2 * place.clearance_min_m:
            continue
        found = stops(place, polar, start, 1.0)
        if not settles:
            if not found:
                return start
            continue
        if not found:
            continue
        away = found[0] + rng.uniform(-START_M, START_M)
        start = start._replace(
            x_m=start.x_m + away * cos(start.eta_rad), z_m=start.z_m + away * sin(start.eta_rad)
        )
        # In the changed wind too, and by a height's worth of gusts inside clearance and fence.
        room = 0.5 * place.clearance_min_m
        if _left(place, start.x_m, start.z_m) >= room and all(
            _left(place, start.x_m + s * cos(start.eta_rad), start.z_m + s * sin(start.eta_rad))
            >= room
            for s in (stops(place, polar, start, start.change) or [1e9])[:1]
        ):
            return start


# --- the slides --------------------------------------------------------------------------------


def fly(
    place: SlidePlace, polar: GlidePolar, starts: list[SlideStart], rng: np.random.Generator
) -> list[Slid]:
    """All starts at once, then the forecast of each."""
    rows = slides(place, polar, starts, rng)
    return [foreseen(place, polar, start, rows[:, :, i], rng) for i, start in enumerate(starts)]


def slides(
    place: SlidePlace, polar: GlidePolar, starts: list[SlideStart], rng: np.random.Generator
) -> FloatArray:
    """x, z, vx, climb, and wind and updraft as they are estimated; shape (readings, 6, n)."""
    x0, z0, eta, wind, change, gusts, sink = np.array(starts, dtype=np.float64).T
    n, along_x, along_z = len(starts), np.cos(eta), np.sin(eta)
    sigma = gusts * wind * place.field.reference_wind_mps
    keeps = exp(-DT_S * place.field.reference_wind_mps / place.scale_m)
    renewed = sqrt(1.0 - keeps * keeps)
    gust = sigma * rng.normal(size=(2, n))
    bias = np.array([[WIND_BIAS_MPS], [UPDRAFT_BIAS_MPS]]) * rng.normal(size=(2, n))
    s, speed = np.zeros(n), np.zeros(n)
    steps = round(place.duration_s / DT_S)
    rows = np.empty((-(-steps // EVERY), 6, n))
    for k in range(steps):
        x, z = x0 + s * along_x, z0 + s * along_z
        grown = 1.0 + (change - 1.0) * min(1.0, max(0.0, (k * DT_S - 2.0) / 8.0))
        u, _, w = place.field.wind(x, np.zeros(n), z)
        u, w = wind * grown * u + gust[0], wind * grown * w + gust[1]
        if k % EVERY == 0:
            errors = bias + 0.05 * rng.normal(size=(2, n))
            rows[k // EVERY] = x, z, speed * along_x, speed * along_z, u + errors[0], w + errors[1]
        airspeed = np.maximum(4.0, u - speed * along_x)
        force = along_z * speed - w + sinks(polar, airspeed, sink)
        speed = speed + DT_S * force * GRAVITY_MPS2 / (airspeed * along_x)
        s = s + DT_S * speed
        gust = keeps * gust + sigma * renewed * rng.normal(size=(2, n))
    return rows


def foreseen(
    place: SlidePlace,
    polar: GlidePolar,
    start: SlideStart,
    rows: FloatArray,
    rng: np.random.Generator,
) -> Slid:
    """The forecast along one slide, until it is reported or at a limit."""
    values = {name: PARAMETERS[INDEX[name]].default for name in ("FC_TIME", "FC_CHANCE")}
    params = ForecastParams(
        act=DISENGAGE,
        time_s=values["FC_TIME"],
        chance=values["FC_CHANCE"],
        clearance_min_m=place.clearance_min_m,
        speed_min_mps=PARAMETERS[INDEX["SPEED_MIN"]].default,
        polar=polar,
    )
    state, left_m, time_s, x, z = initial_forecast(), 0.0, 0.0, 0.0, 0.0
    noise = rng.normal(size=(len(rows), 4)) * np.array([0.003, 0.003, 0.02, 0.02])
    for k, (measured, added) in enumerate(zip(rows.tolist(), noise.tolist(), strict=True)):
        x, z, vx, climb, wind, updraft = measured
        time_s, left_m = k * EVERY * DT_S, _left(place, x, z)
        if left_m < 0.0:
            break
        vehicle = VehicleState(
            time_s=time_s,
            x_m=x + added[0],
            y_m=0.0,
            z_m=z + added[1],
            velocity_x_mps=vx + added[2],
            velocity_y_mps=0.0,
            climb_mps=climb + added[3],
            roll_rad=0.0,
            pitch_rad=0.0,
            heading_rad=0.0,
            roll_rate_radps=0.0,
            pitch_rate_radps=0.0,
            heading_rate_radps=0.0,
        )
        air = NO_AIR._replace(
            wind_mps=wind,
            updraft_mps=updraft,
            wind_sigma_mps=WIND_BIAS_MPS,
            updraft_sigma_mps=UPDRAFT_BIAS_MPS,
        )
        state = forecast_step(
            params,
            place.fence,
            place.ground,
            state,
            vehicle=vehicle,
            air=air,
            velocity_sigma_mps=0.03,
            eta_rad=start.eta_rad,
            moving=False,
        )
        if nowhere(state.foreseen):
            return Slid(
                start=start,
                foreseen=state.foreseen,
                time_s=time_s,
                left_m=left_m,
                is_outside=False,
            )
    return Slid(
        start=start,
        foreseen=None,
        time_s=time_s,
        left_m=left_m,
        is_outside=outside(place.fence, x, 0.0, z) != 0,
    )
