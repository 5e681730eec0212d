"""Which of several sources the position is taken from.

A site file names its sources in the order in which they are trusted.  The best that is in good
health gives the position, all others are only monitored:

    left        when nothing usable has come of it for `silence_s`, or for a few of its own
                periods where that is longer; or while it is suspect and another one is not
    taken       the best of those that are fresh, at its next fix
    taken back  a better one that has been without such a gap for `return_s`, and no earlier
                than `DWELL_S` after the last change

Suspect is a source that repeats itself bit for bit for `FROZEN_S` (`FROZEN_STEPPED_S` where its
numbers have steps that an aircraft in calm air stays within), without reporting a standstill,
while another one changes; and for `DISTRUST_S` one that the module has found not sane.  Where
nothing better is received it is still used: whether to fly with it is not decided here.

Sources of different kinds differ by their biases, and where the site file is wrong by their
frames: how far they are apart is monitored, and reported when one takes over from another.
The step between them is the estimator's to absorb; `PositionFix.source` names the source.

Times are on the loop's clock; time is an argument.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import Final

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.types import NAN, NO_FIX, STEPPED_SOURCE, PositionFix, isfinite

LOCAL_POSITION: Final = 1
ODOMETRY: Final = 2
GLOBAL_POSITION: Final = STEPPED_SOURCE
VISION: Final = 4
MOCAP: Final = 5
NAMES: Final = {
    LOCAL_POSITION: "local_position",
    ODOMETRY: "odometry",
    GLOBAL_POSITION: "global_position",
    VISION: "vision",
    MOCAP: "mocap",
}
NUMBERS: Final = {name: number for number, name in NAMES.items()}
EXTERNAL: Final = frozenset((VISION, MOCAP))  # not the autopilot's own estimate
DEFAULT_ORDER: Final = (LOCAL_POSITION, ODOMETRY)

SILENCE_S: Final = 0.15  # before AGE_POS_HOLD makes the laws hold still
RETURN_S: Final = 2.0
DWELL_S: Final = 2.0
FROZEN_S: Final = 0.2  # the same bits for so long
FROZEN_STEPPED_S: Final = 2.0  # the same of `GLOBAL_POSITION`, which a calm hover repeats for 1.1 s
FROZEN_FIXES: Final = 5  # and so often: a slow source may repeat itself once
DISTRUST_S: Final = 10.0  # after it was found not sane
PERIODS: Final = 3.0  # of its own that a slow source may be silent for
LATE_S: Final = 1.0  # an older fix is no measurement of where the aircraft is
FUTURE_S: Final = 0.05  # the mapping of clocks is not exact
Quaternion = tuple[float, float, float, float]

APART_M: Final = 1.0  # sources that are further apart do not share a frame
RATE_FRACTION: Final = 0.1  # of a new interval in the mean one


class SourceHealth:
    """What is known of one source."""

    __slots__ = (
        "apart_m",
        "changed_s",
        "distrusted_s",
        "fixes",
        "frozen_s",
        "future",
        "late",
        "newest",
        "newest_s",
        "not_finite",
        "period_s",
        "received_s",
        "reckons",
        "repeats",
        "reports_standstill",
        "steady_s",
    )

    def __init__(self, frozen_s: float) -> None:
        """frozen_s: it repeats itself who does for so long."""
        self.frozen_s = frozen_s
        self.fixes = 0  # usable ones
        self.reckons = False  # the newest says that it is dead reckoned
        self.not_finite = 0
        self.late = 0  # out of order, or older than a second
        self.future = 0
        self.received_s = NAN  # when the last usable one came
        self.newest_s = NAN  # when it was true
        self.steady_s = NAN  # since when they have come without a gap
        self.period_s = NAN  # the mean interval
        self.newest: tuple[float, ...] = ()  # where it was last
        self.changed_s = NAN  # when that became true
        self.repeats = 0  # how often it was repeated since
        self.reports_standstill = False  # velocities of exactly zero
        self.distrusted_s = NAN  # when it was found not sane
        self.apart_m = NAN  # from the chosen source, when its last fix came

    @property
    def rejected(self) -> int:
        """What came and could not be used."""
        return self.not_finite + self.late + self.future

    @property
    def rate_hz(self) -> float:
        """Usable fixes in a second; 0: not known."""
        return 1.0 / self.period_s if self.period_s > 0.0 else 0.0

    @property
    def repeats_itself(self) -> bool:
        """Whether it only repeats itself."""
        return self.repeats >= FROZEN_FIXES and self.newest_s - self.changed_s >= self.frozen_s

    def forget_time(self) -> None:
        """The clock is another one."""
        self.received_s = self.newest_s = self.steady_s = self.period_s = NAN
        self.changed_s = self.distrusted_s = NAN
        self.newest, self.repeats = (), 0


class PositionSources:
    """Takes the fixes of all sources, gives those of one."""

    def __init__(
        self,
        order: Sequence[int] = DEFAULT_ORDER,
        *,
        silence_s: float = SILENCE_S,
        return_s: float = RETURN_S,
    ) -> None:
        """`order`: numbers of the sources, the most trusted first."""
        self.position: PositionFix = NO_FIX  # of the chosen source
        self.attitude: Quaternion | None = None  # the attitude that came with it, if any
        self.chosen = 0  # its number; 0: none yet
        self.switches = 0  # from one to another
        self.unused = 0  # fixes of sources that are not in the order
        self.health = {
            source: SourceHealth(FROZEN_STEPPED_S if source == GLOBAL_POSITION else FROZEN_S)
            for source in order
        }
        self.notices: list[tuple[int, str]] = []  # (severity, text)
        self._order = tuple(order)
        self._silence_s = silence_s
        self._return_s = return_s
        self._since_s = NAN  # of the chosen one
        self._reported_apart: set[frozenset[int]] = set()

    def take(
        self,
        source: int,
        measured: PositionFix,
        now_s: float,
        attitude: Quaternion | None = None,
    ) -> bool:
        """Take in one fix; whether it is the position now.

        Of `measured`, sequence and source are set here.  `attitude`: what a tracker
        measured at the same instant, (w, x, y, z) from FRD to local NED.
        """
        health = self.health.get(source)
        if health is None:
            self.unused += 1
            return False
        if not self._is_usable(health, measured, now_s):
            return False
        self._count(health, measured.time_s, now_s)
        self._compare(health, measured, now_s)
        health.apart_m = _distance(measured, self.position) if self.chosen else NAN
        if source != self.chosen:
            if not self._takes_over(source, now_s):
                self._report_apart(source, health, now_s)
                return False
            self._switch(source, now_s)
        _, time_s, x, y, z, u, v, w, _, sigma_m, reckoned = measured
        number = self.position.sequence + 1
        self.position = PositionFix(
            sequence=number,
            time_s=time_s,
            north_m=x,
            east_m=y,
            down_m=z,
            velocity_north_mps=u,
            velocity_east_mps=v,
            velocity_down_mps=w,
            source=source,
            sigma_m=sigma_m,
            reckoned=reckoned,
        )
        self.attitude = attitude
        return True

    def is_fresh(self, source: int, now_s: float) -> bool:
        """Whether usable fixes of a source have been coming until now."""
        health = self.health.get(source)
        return health is not None and now_s - health.received_s <= self._patience_s(health)

    def distrust(self, now_s: float) -> None:
        """The position was found not sane; ignored where it could still be of the source before."""
        if self.chosen and now_s - self._since_s >= DWELL_S:
            health = self.health[self.chosen]
            health.distrusted_s = health.steady_s = now_s

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        for health in self.health.values():
            health.forget_time()
        self._since_s = -inf

    def _is_usable(self, health: SourceHealth, fix: PositionFix, now_s: float) -> bool:
        finite = isfinite(fix.north_m) and isfinite(fix.east_m) and isfinite(fix.down_m)
        if not (finite and isfinite(fix.time_s)):
            health.not_finite += 1
            return False
        if fix.time_s > now_s + FUTURE_S:
            health.future += 1
            return False
        if fix.time_s <= health.newest_s or fix.time_s < now_s - LATE_S:
            health.late += 1
            return False
        return True

    def _count(self, health: SourceHealth, time_s: float, now_s: float) -> None:
        if not now_s - health.received_s <= self._patience_s(health):  # NaN: the first
            health.steady_s = now_s
        interval_s = time_s - health.newest_s
        if not isfinite(health.period_s):
            health.period_s = interval_s
        elif interval_s < LATE_S:  # a longer one is a gap, and does not measure the rate
            health.period_s += RATE_FRACTION * (interval_s - health.period_s)
        health.fixes += 1
        health.received_s = now_s
        health.newest_s = time_s

    def _compare(self, health: SourceHealth, fix: PositionFix, now_s: float) -> None:
        """Compare a fix with the one before."""
        health.reckons = fix.reckoned
        velocity = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
        u, v, w = velocity
        newest: tuple[float, ...] = fix.north_m, fix.east_m, fix.down_m, u, v, w
        if not isfinite(u + v + w):  # what is not known is not compared
            newest = *newest[:3], *[speed for speed in velocity if isfinite(speed)]
        health.reports_standstill = velocity == (0.0, 0.0, 0.0)
        if newest == health.newest:
            health.repeats += 1
            return
        if health.repeats_itself:
            health.steady_s = now_s
        health.newest, health.changed_s, health.repeats = newest, fix.time_s, 0

    def _standing(self, source: int, now_s: float) -> int:
        """0: silent, 1: suspect, 2: in good health."""
        if not self.is_fresh(source, now_s):
            return 0
        distrusted = now_s - self.health[source].distrusted_s < DISTRUST_S
        health = self.health[source]
        return 1 if distrusted or health.reckons or self._is_frozen(source, now_s) else 2

    def _is_frozen(self, source: int, now_s: float) -> bool:
        health = self.health[source]
        return (
            health.repeats_itself
            and not health.reports_standstill
            and any(
                self.is_fresh(other, now_s) and not self.health[other].repeats_itself
                for other in self._order
            )
        )

    def _patience_s(self, health: SourceHealth) -> float:
        """How long a source may be silent; never longer than its fixes may be old."""
        own_s = PERIODS * health.period_s
        return min(own_s, LATE_S) if own_s > self._silence_s else self._silence_s

    def _takes_over(self, source: int, now_s: float) -> bool:
        if self.chosen == 0:
            return True
        rank = self._order.index(source)
        mine, theirs = self._standing(source, now_s), self._standing(self.chosen, now_s)
        steady_s = now_s - self.health[source].steady_s
        if mine > theirs:
            first = all(self._standing(better, now_s) < mine for better in self._order[:rank])
            # When both thaw at once, as on leaving the ground, the one that was chosen stays.
            return first and (theirs == 0 or steady_s >= FROZEN_S)
        return (
            mine == theirs
            and rank < self._order.index(self.chosen)
            and steady_s >= self._return_s
            and now_s - self._since_s >= DWELL_S
        )

    def _switch(self, source: int, now_s: float) -> None:
        before, self.chosen = self.chosen, source
        self._since_s = now_s
        if before == 0:
            return
        self.switches += 1
        better = self._order.index(source) < self._order.index(before)
        text = f"position from {NAMES[source]}"
        if (standing := self._standing(before, now_s)) < 2:
            frozen = self._is_frozen(before, now_s)
            why = "dead reckoned" if self.health[before].reckons else "not sane"
            why = "silent" if standing == 0 else "frozen" if frozen else why
            text += f": {NAMES[before]} is {why}"
        apart_m = self.health[source].apart_m
        if isfinite(apart_m):
            text += f", {apart_m:.2f} m from its last"
        self.notices.append((SEVERITY_INFO if better else SEVERITY_WARNING, text))

    def _report_apart(self, source: int, health: SourceHealth, now_s: float) -> None:
        """Once: two live sources that cannot both be right."""
        pair = frozenset((source, self.chosen))
        live = self.is_fresh(self.chosen, now_s)
        if live and health.apart_m > APART_M and pair not in self._reported_apart:
            self._reported_apart.add(pair)
            text = f"{NAMES[source]} is {health.apart_m:.1f} m from {NAMES[self.chosen]}"
            self.notices.append((SEVERITY_WARNING, f"{text}: do they share a frame?"))


def _distance(one: PositionFix, other: PositionFix) -> float:
    north, east = one.north_m - other.north_m, one.east_m - other.east_m
    down = one.down_m - other.down_m
    return sqrt(north * north + east * east + down * down)
