"""What the world asks of an aircraft: its named tuple of figures has these methods.

`sim.aircraft.AircraftModel` is the rigid body with six degrees of freedom.  Another model is
another named tuple, in a module that `sim.compiled.MODULES` lists: numba compiles the methods of
the tuple that it is given, and `world.make_world` chooses.  All models share `AircraftState`; one
with fewer degrees of freedom fills in the rest.
"""

from __future__ import annotations

from typing import Protocol

from tgl_soar.sim.aircraft import AircraftState, Glide, Wind
from tgl_soar.types import SurfaceCommand


class FlownAircraft(Protocol):
    """What is true of the aircraft of one flight."""

    @property
    def gravity_mps2(self) -> float:
        """Where it flies."""

    @property
    def mass_kg(self) -> float:
        """What a pull has to move."""

    @property
    def span_m(self) -> float:
        """Of the wing: over it a gust rolls the aircraft."""

    @property
    def air_density_kgpm3(self) -> float:
        """Where it flies."""

    def step(
        self,
        state: AircraftState,
        surfaces: SurfaceCommand,
        wind_here: Wind,
        wind_ahead: Wind,
        roll_gust_here_radps: float,
        roll_gust_ahead_radps: float,
        dt_s: float,
    ) -> AircraftState:
        """The aircraft `dt_s` [s] later, from the deflections at the end of the step.

        `wind_here` is the wind (u, v, w) [m/s] at the state's place and time, `wind_ahead` that
        at `aircraft.place_ahead`, one step later; the roll gusts are those of the same times.
        """

    def spun(self, throttle: float, wanted: float, dt_s: float) -> float:
        """The throttle that a propeller turns at, `dt_s` [s] later, when another is commanded."""

    def specific_force_frd(self, state: AircraftState, wind: Wind) -> tuple[float, float, float]:
        """What an accelerometer at the centre of gravity feels [m/s², FRD], gravity apart."""

    def highest_pitch_glide(self) -> Glide:
        """The steady glide with the highest pitch: the slowest at which a flight begins."""

    def glide_at(self, horizontal_mps: float) -> Glide:
        """The steady glide at a horizontal airspeed [m/s].  Errors: ValueError: there is none."""
