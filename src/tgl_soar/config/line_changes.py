"""What setting the line's parameters means: presets, staged moves, what is refused.

    preset   TGL_PRESET = n puts TGL_X, TGL_Z and TGL_LEAN on the site's n-th line as one change.
             It goes back to 0 as soon as the line stands elsewhere.
    place    TGL_PLACE = d puts TGL_X and TGL_Z where d metres along the site's contour end, its
             longest part, from the upstream end: one number moves the aircraft along what a
             survey has drawn.  It goes back to -1 as soon as the point is elsewhere.
    staging  TGL_STAGE = 1: sets of TGL_X, TGL_Z, TGL_LEAN and TGL_SLEW are checked one by one
             and held; 0: all of them at once, or none; 2: dropped.  From 2 there is no way to 0
             but over 1, so that a repeated commit that was refused is refused again.  What nobody
             goes on with is dropped after a while (`onboard.operators`, which has the time).
    bounds   A line by which no aircraft can be held (`line_bounds`) is refused, and so is one
             in flight whose point is farther than TGL_STEP_MAX from the one that stands.
    loop     A gain, a latency or a figure of the airframe is refused in flight where the loop would
             swing with it and did not before (a margin below `loop_margin.RINGS`), and warned of
             where less is left than a line is engaged with (`loop_margin.FLOOR`), or where nothing
             can be said of it.
    force    OP_FORCE = 1: the next move, or a bound that is refused, passes all the same, and
             OP_FORCE is 0 again, as it is where nothing was forced for a while
             (`onboard.engage_switch`).

TGL_X and TGL_Z typed one after the other pass over a line of both: the fence, a box, never
refuses it if both lines lie inside, and it is nearer to either than they are to each other.  What
else refuses it has a way round: the other one first, or both staged.  On the ground, where the
line that stands is itself no good (a new site), one step towards a better one is only warned of;
what engages asks again.

Pure: a set of values in, another one out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from math import cos, dist, hypot, pi, radians, sin
from typing import Final, NamedTuple

from tgl_soar.config.parameters import (
    PARAMETERS,
    ParameterError,
    ParameterSet,
    as_wire_value,
    checked_value,
)

LINE: Final = ("TGL_X", "TGL_Z", "TGL_LEAN")
STAGED: Final = (*LINE, "TGL_SLEW")
SIDES: Final = ("FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Z_MIN", "FENCE_Z_MAX")  # of the plane
BOUNDS: Final = (*SIDES, "CLEAR_MIN")
# What the margins of the loops are made of, apart from the line's lean.
_LOOPS: Final = ("RHO_", "ELE_", "DYN_", "AIL_", "RUD_", "SIDE_", "LAT_")
LOOP: Final = (
    *(p.name for p in PARAMETERS if p.name.startswith(_LOOPS) and not p.name.endswith("_TRIM")),
    *("CMD_DELAY", "EST_IMU", "LOOP_RATE"),
)
OVERRIDE: Final = "OP_FORCE 1 overrides once"
MOVED, STAGING, DROPPED = 0.0, 1.0, 2.0  # of TGL_STAGE
ELSEWHERE: Final = -1.0  # TGL_PLACE of a point that it has not placed

# Lines through (x, z) [m] where excess updraft is zero; rising air is on their left.
Contour = tuple[tuple[tuple[float, float], ...], ...]


class PresetLine(NamedTuple):
    """A line that the site names."""

    name: str
    x_m: float
    z_m: float
    lean_deg: float

    def parameters(self) -> dict[str, float]:
        """The parameters that put the line there."""
        return {"TGL_X": self.x_m, "TGL_Z": self.z_m, "TGL_LEAN": self.lean_deg}


Presets = tuple[PresetLine, ...]


class Answer(NamedTuple):
    """What came of one set."""

    values: ParameterSet  # that stand from now on
    reported: tuple[str, ...]  # whose values are to be sent, the one that was set first
    refusal: str = ""  # why a staged move was not made
    warning: str = ""


def _never(_values: ParameterSet) -> str:
    """Where nothing is known of the place, every line will do."""
    return ""


class LineChanges:
    """Knows the site's lines and bounds, and holds what is staged."""

    def __init__(
        self,
        presets: Presets = (),
        fault: Callable[[ParameterSet], str] = _never,
        contour: Contour = (),
        ringing: Callable[[ParameterSet], str] = _never,
        warning: Callable[[ParameterSet], str] = _never,
    ) -> None:
        """`fault`: why no aircraft can be held by a line; "" if it can (`line_bounds`).  `contour`:
        the site's, for TGL_PLACE.  `ringing`: why its loop would swing, likewise; `warning`: what
        is to be said of margins that refuse nothing."""
        self.staged: dict[str, float] = {}
        self._was_left = False  # what was staged was dropped, and nobody has set TGL_STAGE since
        self.fault = fault
        self.ringing = ringing
        self.warning = warning
        self._presets = presets
        self._contour = contour

    def set(self, values: ParameterSet, name: str, value: float, *, flying: bool) -> Answer:
        """What one set makes of the values that stand.

        Errors: `ParameterError`; then nothing has changed, here neither.
        """
        if name == "TGL_STAGE":
            wanted = checked_value(name, value)
            self._was_left &= wanted == MOVED  # which is refused
            return self._stage(values, wanted, flying)
        if name in STAGED and self._was_left:
            raise ParameterError(
                name,
                f"{value:g}",
                "a staged move was dropped: set TGL_STAGE to 1 to stage again, to 2 to end it",
            )
        if values["TGL_STAGE"] == STAGING:
            if name in STAGED:
                self.staged[name] = checked_value(name, value, flying=flying)
                return Answer(values, (name,))
            if name in ("TGL_PRESET", "TGL_PLACE"):
                raise ParameterError(
                    name, f"{value:g}", "a move is being staged: set TGL_STAGE to 0 or 2 first"
                )
        if name == "TGL_PRESET":
            after = _selected(values, {name: value}, self._presets, flying)
        elif name == "TGL_PLACE":
            after = settled(_placed(values, value, self._contour, flying), self._presets)
        else:
            after = settled(values.changed({name: value}, flying=flying), self._presets)
        return self._answer(name, values, after, flying)

    def leave(self, values: ParameterSet) -> Answer:
        """What was staged is dropped by the module itself: whoever staged it may not know, and go
        on with the rest of a move, half of which is gone."""
        answer = self._stage(values, DROPPED, flying=False)
        self._was_left = True
        return answer

    def shown(self, values: ParameterSet, name: str) -> float:
        """The value to answer with: a staged one hides the one that stands."""
        return self.staged.get(name, values[name])

    def _stage(self, values: ParameterSet, wanted: float, flying: bool) -> Answer:
        standing, staged = values["TGL_STAGE"], self.staged
        if wanted == standing:
            return Answer(values, ("TGL_STAGE",))
        if wanted == MOVED and standing == DROPPED:
            raise ParameterError(
                "TGL_STAGE", "0", "nothing is staged, the last was dropped: set 1 to stage again"
            )
        self.staged = {}
        after = values.changed({"TGL_STAGE": wanted})
        if wanted != MOVED:
            return Answer(after, ("TGL_STAGE", *staged))
        try:
            after = settled(after.changed(staged, flying=flying), self._presets)
            answer = self._answer("TGL_STAGE", values, after, flying)
        except ParameterError as error:
            dropped = values.changed({"TGL_STAGE": DROPPED})
            return Answer(dropped, ("TGL_STAGE", *staged), f"staged move dropped: {error}")
        return answer._replace(reported=tuple(dict.fromkeys((*answer.reported, *staged))))

    def _answer(self, name: str, before: ParameterSet, after: ParameterSet, flying: bool) -> Answer:
        """Errors: `ParameterError` for a line that is refused."""
        after = _no_place_elsewhere(before, after)
        other = {name for name in (*BOUNDS, *LOOP) if before[name] != after[name]}
        moved = _line(before) != _line(after) or _held(after) not in (None, _held(before))
        fault = ""
        if moved or other:
            fault = self.fault(after) or (_step_fault(before, after) if flying and moved else "")
        loop_alone = not moved and other.issubset(LOOP)
        is_refused = fault != "" and self._is_refused(before, after, moved, loop_alone, flying)
        if (moved or is_refused) and before["OP_FORCE"] != 0.0:
            after = after.changed({"OP_FORCE": 0.0})
        elif is_refused:
            raise ParameterError(name, f"{after[name]:g}", f"{fault}; {OVERRIDE}")
        changed = [p.name for (p, old), (_, new) in zip(before, after, strict=True) if old != new]
        reported = (name, *(other for other in changed if other != name))
        warning = self.warning(after) if other.intersection(LOOP) else ""
        return Answer(after, reported, warning=fault or warning)

    def _is_refused(
        self,
        before: ParameterSet,
        after: ParameterSet,
        moved: bool,
        loop_alone: bool,
        flying: bool,
    ) -> bool:
        """Whether a line with a fault is: where it is flown, or where the one before had none.

        A fence or a clearance that shuts the line out is refused only in flight: it ends it.  So is
        what changes the loop alone, where it would swing with it and did not before.
        """
        if loop_alone:
            return flying and self.ringing(after) != "" and not self.ringing(before)
        if moved and flying:
            return True
        return (moved or flying) and not self.fault(before)


END_M: Final = 0.001


def _placed(values: ParameterSet, value: float, contour: Contour, flying: bool) -> ParameterSet:
    """TGL_PLACE, and the point that it means."""
    along_m = checked_value("TGL_PLACE", value)
    if along_m == ELSEWHERE:
        return values.changed({"TGL_PLACE": along_m}, flying=flying)
    if not contour:
        raise ParameterError(
            "TGL_PLACE", f"{value:g}", "the site file has no [contour] for this airframe"
        )
    length_m = contour_length(contour)
    if not 0.0 <= along_m <= as_wire_value(length_m):
        raise ParameterError(
            "TGL_PLACE", f"{value:g}", f"the contour runs from 0 to {length_m:g} m"
        )
    # A line through the very end misses the contour by rounding.
    within_m = min(max(along_m, END_M), max(END_M, length_m - END_M))
    x_m, z_m = contour_place(contour, within_m)
    place = {"TGL_PLACE": along_m, "TGL_X": x_m, "TGL_Z": z_m}
    try:
        return values.changed(place, flying=flying)
    except ParameterError as error:
        raise ParameterError("TGL_PLACE", f"{value:g}", str(error)) from None


def _no_place_elsewhere(before: ParameterSet, after: ParameterSet) -> ParameterSet:
    """Values whose TGL_PLACE is true: -1 where something else has moved the point."""
    stays = _line(before)[:2] == _line(after)[:2]
    if after["TGL_PLACE"] == ELSEWHERE or after["TGL_PLACE"] != before["TGL_PLACE"] or stays:
        return after
    return after.changed({"TGL_PLACE": ELSEWHERE})


def contour_length(contour: Contour) -> float:
    """Of its longest part [m]; 0 where there is none."""
    return max((_length(part) for part in contour), default=0.0)


def contour_place(contour: Contour, along_m: float) -> tuple[float, float]:
    """x and z [m] of a place of the longest part, at a distance from its upstream end.

    Rising air is on the left of a part, and below it where an aircraft settles: it runs upstream.
    Beyond its ends it is the end.  Errors: ValueError for no contour.
    """
    points = max(contour, key=_length)[::-1]
    left_m = along_m
    for a, b in pairwise(points):
        step_m = dist(a, b)
        if left_m <= step_m:
            way = max(0.0, left_m) / step_m if step_m > 0.0 else 0.0
            return a[0] + way * (b[0] - a[0]), a[1] + way * (b[1] - a[1])
        left_m -= step_m
    return points[-1]


def _length(part: tuple[tuple[float, float], ...]) -> float:
    return sum(dist(a, b) for a, b in pairwise(part))


def _step_fault(before: ParameterSet, after: ParameterSet) -> str:
    step_m = hypot(after["TGL_X"] - before["TGL_X"], after["TGL_Z"] - before["TGL_Z"])
    if step_m <= after["TGL_STEP_MAX"]:
        return ""
    return (
        f"{step_m:.2f} m from where the line is to be now (TGL_STEP_MAX is"
        f" {after['TGL_STEP_MAX']:g} m)"
    )


def with_changes(
    values: ParameterSet, changes: Mapping[str, float], presets: Presets
) -> ParameterSet:
    """Values with the changes that a file gives.

    A preset stands for its line where the file places none.  Errors: `ParameterError`.
    """
    if "TGL_PRESET" in changes and "TGL_X" not in changes and "TGL_Z" not in changes:
        return _selected(values, changes, presets, False)
    return settled(values.changed(changes), presets)


def settled(values: ParameterSet, presets: Presets) -> ParameterSet:
    """Values whose TGL_PRESET is true: 0 where the line is not where that preset has it."""
    number = int(values["TGL_PRESET"])
    if number == 0:
        return values
    if number <= len(presets):
        there = presets[number - 1].parameters()
        if all(values[name] == as_wire_value(value) for name, value in there.items()):
            return values
    return values.changed({"TGL_PRESET": 0.0})


def _selected(
    values: ParameterSet, changes: Mapping[str, float], presets: Presets, flying: bool
) -> ParameterSet:
    number = int(checked_value("TGL_PRESET", changes["TGL_PRESET"]))
    if number == 0:
        return values.changed(changes, flying=flying)
    if number > len(presets):
        known = ", ".join(f"{i} {preset.name}" for i, preset in enumerate(presets, 1))
        reason = f"the site's lines are {known}" if presets else "the site file names no lines"
        raise ParameterError("TGL_PRESET", number, f"no such line: {reason}")
    preset = presets[number - 1]
    try:
        return values.changed({**changes, **preset.parameters()}, flying=flying)
    except ParameterError as error:
        if error.name not in LINE:
            raise
        raise ParameterError("TGL_PRESET", number, f"line {preset.name}: {error}") from None


def _line(values: ParameterSet) -> tuple[float, float, float]:
    return values["TGL_X"], values["TGL_Z"], values["TGL_LEAN"]


def _held(values: ParameterSet) -> float | None:
    """Where on its line a point is held [m]; None: nowhere."""
    return values["TGL_ALONG"] if values["TGL_HOLD"] != 0.0 else None


class ContourCrossing(NamedTuple):
    """Where a line meets the contour."""

    x_m: float
    z_m: float
    settles: bool  # excess updraft falls going up the line there


def crossings(contour: Contour, x_m: float, z_m: float, lean_deg: float) -> list[ContourCrossing]:
    """Where the line meets the contour.

    With rising air on its left, a contour that passes from downstream of the line (e_rho < 0)
    to upstream of it runs across the line with the rising air below.
    """
    eta = radians(lean_deg) + 0.5 * pi
    found = []
    for part in contour:
        e_rho = [cos(eta) * (z - z_m) - sin(eta) * (x - x_m) for x, z in part]
        for (a, b), ((x_a, z_a), (x_b, z_b)) in zip(pairwise(e_rho), pairwise(part), strict=True):
            if (a < 0.0) != (b < 0.0):
                way = a / (a - b)  # from one point to the next
                x, z = x_a + way * (x_b - x_a), z_a + way * (z_b - z_a)
                found.append(ContourCrossing(x, z, b >= 0.0))
    return found
