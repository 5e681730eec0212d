"""What is reported of a flight to the search, and what it answers: plain numbers, without numpy.

The flying process makes the one and takes the other; the map and its rollouts may be in a process
of their own, late, or dead.
"""

from __future__ import annotations

from math import pi
from typing import Final, NamedTuple

from tgl_soar.control.envelope import Fence
from tgl_soar.control.laws import Laws
from tgl_soar.control.target_line import LineLimits, LineTracking, TargetLine
from tgl_soar.types import NAN, GlidePolar, Ground, VehicleState

LOOK_S: Final = 0.2  # between two glimpses

LOOKING: Final = 0
SOARING: Final = 1
GIVEN_UP: Final = 2

NO_REASON: Final = 0
NO_PLACE: Final = 1  # in no likely field
TOO_LOW: Final = 2
TOO_HIGH: Final = 3
REASONS: Final = (
    "",
    "no line soars in any wind that fits the readings",
    "height for landing is running out before a place to soar",
    "room under the fence's ceiling is running out before a place to soar",
)


class SearchTask(NamedTuple):
    """What stays as it is: the place, the polar, and how the line may be moved."""

    fence: Fence
    ground: Ground
    polar: GlidePolar
    clearance_min_m: float
    line: LineLimits
    eta_min_rad: float = 0.0  # inclinations that a line may have
    eta_max_rad: float = pi


def task_of(laws: Laws) -> SearchTask:
    """What of the laws a search needs."""
    return SearchTask(
        fence=laws.fence,
        ground=laws.ground,
        polar=laws.wind.aerodynamics.polar,
        clearance_min_m=laws.envelope.clearance_min_m,
        line=laws.line,
    )


class Glimpse(NamedTuple):
    """What the module knows at one instant, `now.time_s`, and since the glimpse before it."""

    before: VehicleState
    now: VehicleState
    line: LineTracking  # that is flown
    wind_mps: float  # means since then, as estimated
    updraft_mps: float
    pitot: bool
    seeks: bool  # a line is wanted; else it only listens
    refused: TargetLine | None  # that was requested, since the glimpse before
    pushed_mps: float = 0.0  # mean of the climb that a propeller gave
    carried: bool = False  # what is left of the throttle's budget can keep it from sinking
    search: int = 0  # the search that asks; another number: another search


class LineRequest(NamedTuple):
    """Where the line is to go, and how the search stands."""

    target: TargetLine
    status: int  # LOOKING, SOARING or GIVEN_UP
    reason: int  # of giving up
    place_x_m: float  # where the aircraft is to settle on it; NaN: not known
    place_z_m: float
    over_ground_m: float
    time_s: float = NAN  # of the glimpse that is answered
    search: int = 0  # that had asked

    @property
    def soaring(self) -> bool:
        """Whether it says so."""
        return self.status == SOARING

    @property
    def given_up(self) -> str:
        """The reason; "" where it goes on."""
        return REASONS[self.reason]
