"""The closed loop as a Gymnasium environment: for whoever trains something to soar.

    import gymnasium
    import tgl_soar.gym

    env = gymnasium.make("tgl_soar/Pitch-v0", turbulence=0.02)

What flies is the world and the tick of every other simulation here, compiled
(`sim.commanded_flight`); what is learnt commands in the place of the line (`tgl_soar/Line-v0`), of
the soaring law (`tgl_soar/Pitch-v0`) or of all laws (`tgl_soar/Surfaces-v0`).  The module's
estimators, limits and supervisor stay: where it would hand over to the pilot, an episode ends.

The task is one for all: come to a place in the rising air, and stay there.  The place is where
some line between the site's first and last meets the contour of zero excess updraft; it is drawn
for each episode, and so is all that is random in the air and the sensors.

    reward of a tick   the time that it lasts [s], times 1 − d / 1 m, not less than 0
    reward of a step   the sum of its ticks'
    d                  true distance from the place [m]

The bound is each tick's own, so that a flight's reward does not hang on the period.  An episode
gives at most its length in seconds, and one that ends early (crash, fence, stall, off the line)
gives nothing more.  docs/gym.md has tables of actions and observations.
"""

from __future__ import annotations

from functools import lru_cache
from math import radians
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np

try:
    import gymnasium
    from gymnasium.spaces import Box
except ImportError as error:
    raise ImportError("tgl_soar.gym needs gymnasium: pip install 'tgl_soar[gym]'") from error

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.autopilot import mode_name
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.sim.commanded_flight import (
    LINE,
    PITCH,
    SURFACES,
    KnownAboard,
    OutsideCommand,
    Standing,
    fly_given_in_cells,
)
from tgl_soar.sim.compiled import cell, compiled
from tgl_soar.sim.compiled_flight import Prepared, begun, prepare, why_it_stands_so
from tgl_soar.sim.flight import FLIES, HELD_S, Row
from tgl_soar.sim.world import make_world, site_field
from tgl_soar.types import SurfaceCommand

KINDS: Final = {"line": LINE, "pitch": PITCH, "surfaces": SURFACES}
IDS: Final = {name: f"tgl_soar/{name.capitalize()}-v0" for name in KINDS}
SIZES: Final = {"line": 2, "pitch": 1, "surfaces": 3}
# A line takes seconds to act, the pitch loop follows its setpoint within 0.3 s, and the aircraft
# turns about its axes within 0.1 s: some ten commands in each of these times, five in the last.
PERIODS_S: Final = {"line": 1.0, "pitch": 0.05, "surfaces": 0.02}
SHIFT_M: Final = 0.5  # of the line, at most: most of the way between the tunnel's lines
LEAN_RAD: Final = radians(8.0)  # of the line, likewise: the tunnel's 15 degrees stay above 5
REACH_M: Final = 1.0  # from the place: further away there is no reward
STEP_HZ: Final = 200
# Held, then the module's tick in which it engages, then one under an action.
SECONDS_MIN: Final = HELD_S + 2.0 / STEP_HZ
SECONDS_MAX: Final = 3600.0  # noise and rows of a whole flight are held in memory
WHOLE: Final = 1e-6  # of a tick: what a decimal number of seconds may be off by in binary
OPTIONS: Final = ("goal", "flight")
FLIGHT_MAX: Final = 2**63 - 1


class Observed(NamedTuple):
    """One number of an observation: its name with its unit, and its range."""

    name: str
    low: float
    high: float


# What is known aboard; what is not known (yet) is 0, and what is out of its range at its edge.
OBSERVATION: Final = (
    Observed("goal_x_m", -5.0, 5.0),  # from the aircraft to the place, downstream
    Observed("goal_z_m", -5.0, 5.0),  # and up
    Observed("y_m", -5.0, 5.0),  # from the middle
    Observed("velocity_x_mps", -20.0, 20.0),
    Observed("velocity_y_mps", -20.0, 20.0),
    Observed("climb_mps", -20.0, 20.0),
    Observed("roll_rad", -3.2, 3.2),
    Observed("pitch_rad", -1.6, 1.6),
    Observed("heading_rad", -3.2, 3.2),  # from straight upwind
    Observed("roll_rate_radps", -20.0, 20.0),
    Observed("pitch_rate_radps", -20.0, 20.0),
    Observed("heading_rate_radps", -20.0, 20.0),
    Observed("e_rho_m", -5.0, 5.0),  # from the line that is flown
    Observed("e_rho_rate_mps", -20.0, 20.0),
    Observed("lean_rad", -1.6, 1.6),  # of that line
    Observed("airspeed_mps", 0.0, 30.0),
    Observed("alpha_rad", -1.6, 1.6),
    Observed("wind_mps", -30.0, 30.0),
    Observed("updraft_mps", -20.0, 20.0),
    Observed("excess_mps", -20.0, 20.0),
    Observed("stall_rad", -1.0, 1.0),  # margin
    Observed("clearance_m", -10.0, 10.0),
    Observed("elevator", -1.0, 1.0),  # commanded last, as it was let through
    Observed("aileron", -1.0, 1.0),
    Observed("rudder", -1.0, 1.0),
)
_LOW: Final = np.array([each.low for each in OBSERVATION], dtype=np.float32)
_HIGH: Final = np.array([each.high for each in OBSERVATION], dtype=np.float32)
_AT: Final = {name: n for n, name in enumerate(KnownAboard._fields)}
_ALIKE: Final = [_AT.get(each.name, 0) for each in OBSERVATION]
_LEAN: Final = [each.name for each in OBSERVATION].index("lean_rad")
_PLACE: Final = [Row._fields.index(name) for name in ("x_m", "y_m", "z_m")]

_Step = tuple[np.ndarray[Any, Any], float, bool, bool, dict[str, Any]]


class GymPlace(NamedTuple):
    """Where an environment flies, and what its aircraft is given."""

    airframe: Airframe
    site: Site
    values: ParameterSet
    field: WindField


@lru_cache(maxsize=4)
def _place(airframe_path: Path, site_path: Path) -> GymPlace:
    """Errors: `ConfigError`; ValueError for a site without air."""
    airframe, site, values = load_flight(airframe_path, site_path)
    if site.air is None:
        raise ValueError(f"{site_path}: no [air] table, so there is no wind to fly in")
    return GymPlace(airframe, site, values, site_field(site, site_path.parent, site_path))


def _found(given: str | Path, folder: str) -> Path:
    """A file, or one that is shipped, by its name."""
    path = Path(given)
    return path if path.suffix == ".toml" else shipped(f"{folder}/{given}.toml")


def _whole_ticks(period_s: float, hz: float) -> int:
    """Errors: ValueError for what is no whole number of ticks."""
    if 0.0 < period_s <= SECONDS_MAX:
        count = round(period_s * hz)
        if count >= 1 and abs(period_s * hz - count) <= WHOLE:
            return count
    tick = 1.0 / hz
    raise ValueError(
        f"period_s {period_s}: a whole multiple of {tick:g}, one tick, from {tick:g} to"
        f" {SECONDS_MAX:g}"
    )


def _checked_options(options: dict[str, Any]) -> dict[str, Any]:
    """Of `SoaringEnv.reset`.  Errors: ValueError naming the option."""
    unknown = [name for name in options if name not in OPTIONS]
    if unknown:
        raise ValueError(f"reset option {unknown[0]!r}: one of {', '.join(OPTIONS)}")
    checked: dict[str, Any] = {}
    if "goal" in options:
        x, z = (PARAMETERS[INDEX[name]] for name in ("TGL_X", "TGL_Z"))  # a line leads through it
        says = (
            f"reset option goal {options['goal']!r}: x from {x.minimum:g} to {x.maximum:g} and"
            f" z from {z.minimum:g} to {z.maximum:g} m"
        )
        try:
            x_m, z_m = (float(number) for number in options["goal"])
        except (TypeError, ValueError):
            raise ValueError(says) from None
        if not (x.minimum <= x_m <= x.maximum and z.minimum <= z_m <= z.maximum):
            raise ValueError(says)
        checked["goal"] = x_m, z_m
    if "flight" in options:
        flight = options["flight"]
        if not isinstance(flight, int | np.integer) or not 0 <= flight <= FLIGHT_MAX:
            raise ValueError(
                f"reset option flight {flight!r}: a whole number from 0 to {FLIGHT_MAX}"
            )
        checked["flight"] = int(flight)
    return checked


class SoaringEnv(gymnasium.Env):  # type: ignore[misc]
    """One flight an episode, in a vertical plane of rising air."""

    metadata: Final[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        action: str = "line",
        *,
        airframe: str | Path = "eclipson_c",
        site: str | Path = "tunnel",
        turbulence: float = 0.02,
        seconds: float = 30.0,
        period_s: float | None = None,
        dispersion: bool = False,
        compile: bool = True,
        render_mode: None = None,
    ) -> None:
        """action: "line", "pitch" or "surfaces".  airframe, site: a file, or the name of one that
        is shipped.  turbulence: its intensity.  period_s: between two actions; None: `PERIODS_S`.
        dispersion: each episode another aircraft and other air than the files say.  compile:
        False flies in plain Python, a thousand times slower, with nothing to be compiled first.

        Errors: ValueError; `ConfigError`; ImportError without numba.
        """
        if action not in KINDS:
            raise ValueError(f"action {action!r}: one of {', '.join(KINDS)}")
        if not 0.0 <= turbulence <= 0.5:
            raise ValueError(f"turbulence {turbulence}: 0 to 0.5")
        if not SECONDS_MIN - WHOLE <= seconds <= SECONDS_MAX:
            raise ValueError(
                f"seconds {seconds}: from {SECONDS_MIN:g} to {SECONDS_MAX:g}; for the first"
                f" {HELD_S:g} the aircraft is held"
            )
        if render_mode is not None:
            raise ValueError(f"render_mode {render_mode!r}: there is none")
        self.action, self.render_mode = action, render_mode
        self._named = str(site)  # for a message
        self.seconds, self._dispersed = seconds, dispersion
        # One kind of air for all, so that it is compiled once.
        self._turbulence = max(turbulence, 1e-6)
        self._place = _place(_found(airframe, "airframes"), _found(site, "sites"))
        self._prepared = self._world(None)
        self._hz = STEP_HZ
        period = PERIODS_S[action] if period_s is None else period_s
        self._period = _whole_ticks(period, self._hz)
        values = self._place.values
        self._lean_rad = radians(values["TGL_LEAN"])
        self._pitches_rad = radians(values["PITCH_MIN"]), radians(values["PITCH_MAX"])
        self._trim = SurfaceCommand(values["ELE_TRIM"], values["AIL_TRIM"], values["RUD_TRIM"])
        self._laws: Laws = laws_from(
            values,
            self._place.site.frame(),
            self._place.airframe.aerodynamics(),
            self._place.site.known_ground(),
        )
        self._fly: Any = compiled(fly_given_in_cells) if compile else fly_given_in_cells
        self._cell: Any = cell if compile else lambda value: SimpleNamespace(value=value)
        self._laws_cell = self._cell(self._laws)
        self._known = np.full((1, len(KnownAboard._fields)), np.nan)
        self._rows = np.empty((self._prepared.ticks, len(Row._fields)))
        self._steps = 0
        self._engaged = False
        self.goal = (0.0, 0.0)
        self.action_space = Box(-1.0, 1.0, (SIZES[action],), np.float32)
        self.observation_space = Box(_LOW, _HIGH, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
        """A new flight, from its start to the tick in which the module takes the surfaces.

        options: `goal`, a place (x, z) [m]; `flight`, the seed of one flight's air and sensors.
        Errors: ValueError for other options or bad ones; RuntimeError where the module does not
        engage.
        """
        options = _checked_options(options or {})
        self._engaged = False
        super().reset(seed=seed)
        # Both are drawn in any case: what comes after does not hang on the options.
        flight, along = int(self.np_random.integers(2**31)), float(self.np_random.random())
        flight = options.get("flight", flight)
        self.goal = options["goal"] if "goal" in options else self._goal(along)
        if self._dispersed:
            self._prepared = self._world(flight)
        parts, start = begun(self._prepared, flight)
        self._parts_cell, self._flight_cell = self._cell(parts), self._cell(start)
        self._steps = 0
        standing = self._flown(self._given(np.zeros(SIZES[self.action])), self._prepared.ticks)
        if standing.held or standing.standing != FLIES:
            raise RuntimeError(
                "the module does not engage at this start: fly it with tgl-soar sitl"
            )
        self._engaged = True
        return self._observation(), self._info(standing)

    def step(self, action: Any) -> _Step:
        """Fly on under an action for one period.  Errors: ValueError for one of another shape or
        that is not finite; `gymnasium.error.ResetNeeded` before a reset."""
        if not self._engaged:
            raise gymnasium.error.ResetNeeded("step: call reset first, which begins a flight")
        numbers = np.asarray(action, dtype=np.float64).reshape(-1)
        if numbers.shape != self.action_space.shape or not np.isfinite(numbers).all():
            raise ValueError(f"action {action}: {SIZES[self.action]} finite numbers")
        begin, ticks = self._steps, self._prepared.ticks
        given = self._given(np.clip(numbers, -1.0, 1.0))
        standing = self._flown(given, min(ticks, begin + self._period))
        ended = standing.standing != FLIES
        info = self._info(standing)
        flown = self._rows[begin : self._steps, _PLACE]
        away = np.linalg.norm(flown - (self.goal[0], 0.0, self.goal[1]), axis=1)
        reward = float(np.maximum(0.0, 1.0 - away / REACH_M).sum()) / self._hz
        return self._observation(), reward, ended, not ended and self._steps >= ticks, info

    def _world(self, flight: int | None) -> Prepared:
        """What flies: the files' own, or what is drawn for a flight."""
        airframe, site, _, field = self._place
        sensors = SENSORS[EVERY_SENSOR]
        if flight is not None:
            airframe, site, field, sensors = mismatched(airframe, site, field, sensors, flight)
        world = make_world(
            airframe,
            site,
            step_hz=STEP_HZ,
            turbulence=self._turbulence,
            field=field,
            sensors=sensors,
        )
        return prepare(world, self.seconds)

    def _goal(self, along: float) -> tuple[float, float]:
        """A place on the contour; along: from the site's first line, 0, to its last, 1.

        Errors: ValueError where the line there meets no contour.
        """
        site, values = self._place.site, self._place.values
        lines = [(line.x_m, line.z_m) for line in site.lines.values()]
        points = lines or [(values["TGL_X"], values["TGL_Z"])]
        at = np.linspace(0.0, 1.0, len(points))
        x_m, z_m = (float(np.interp(along, at, axis)) for axis in zip(*points, strict=True))
        polar = self._place.airframe.polar.as_polar()
        place = stable_crossing(self._place.field, polar, (x_m, z_m, eta_from_lean(self._lean_rad)))
        if place is None:
            raise ValueError(
                f"site {self._named!r}: no place can be drawn: its line through x {x_m:g},"
                f" z {z_m:g} m meets no contour of zero excess updraft; give one,"
                " reset(options={'goal': (x, z)}), or name another site"
            )
        return place.x_m, place.z_m

    def _given(self, action: np.ndarray[Any, Any]) -> OutsideCommand:
        """What an action of -1 … 1 commands."""
        (x_m, z_m), lean = self.goal, self._lean_rad
        pitch, surfaces = 0.0, self._trim
        if self.action == "line":
            x_m, lean = x_m + SHIFT_M * float(action[0]), lean + LEAN_RAD * float(action[1])
        elif self.action == "pitch":
            low, high = self._pitches_rad
            pitch = 0.5 * (low + high) + 0.5 * (high - low) * float(action[0])
        else:
            elevator, aileron, rudder = (float(deflection) for deflection in action)
            surfaces = SurfaceCommand(elevator, aileron, rudder, 0.0)
        return OutsideCommand(
            kind=KINDS[self.action],
            target=TargetLine(x_m, z_m, eta_from_lean(lean)),
            pitch_rad=pitch,
            surfaces=surfaces,
        )

    def _flown(self, given: OutsideCommand, until: int) -> Standing:
        """Fly on to a step."""
        standing: Standing = self._fly(
            self._parts_cell,
            self._laws_cell,
            self._flight_cell,
            given,
            until,
            self._rows,
            self._known,
        )
        self._steps = standing.steps
        return standing

    def _observation(self) -> np.ndarray[Any, Any]:
        """What is known now."""
        known = self._known[0]
        observed = known[_ALIKE]
        observed[0] = self.goal[0] - known[_AT["x_m"]]
        observed[1] = self.goal[1] - known[_AT["z_m"]]
        observed[_LEAN] = known[_AT["eta_rad"]] - 0.5 * np.pi
        observed[~np.isfinite(observed)] = 0.0
        within: np.ndarray[Any, Any] = np.clip(observed.astype(np.float32), _LOW, _HIGH)
        return within

    def _info(self, standing: Standing) -> dict[str, Any]:
        """What is not known aboard, and how the flight stands."""
        x_m, y_m, z_m = (float(number) for number in self._rows[self._steps - 1, _PLACE])
        ended = ""
        if standing.standing != FLIES:
            # A row is of the tick's beginning: what was hit lies a step further.
            hit = 2.0 * self._rows[self._steps - 1, _PLACE] - self._rows[self._steps - 2, _PLACE]
            x, y, z = (float(number) for number in hit)
            world = self._prepared.world
            there = world.state._replace(x_m=x, y_m=y, z_m=z)
            ended = why_it_stands_so(world, standing.standing, standing.reason, there)
        return {
            "time_s": self._steps / self._hz,
            "x_m": x_m,
            "y_m": y_m,
            "z_m": z_m,
            "goal_x_m": self.goal[0],
            "goal_z_m": self.goal[1],
            "mode": mode_name(int(self._known[0, _AT["mode"]])),
            "ended": ended,
        }


for _name in KINDS:
    gymnasium.register(
        id=IDS[_name],
        entry_point="tgl_soar.gym:SoaringEnv",
        kwargs={"action": _name},
        order_enforce=True,
    )
