"""The attitude that a tick is given: a tracker's in place of the autopilot's, where a site asks.

The tracker's is taken while it is steady and agrees, and the autopilot's otherwise:

    left        when the newest pose is older than FRESH_S: a tick is worse off with it than with
                the autopilot's, which is 5 ms old
    refused     a pose whose vertical is off the autopilot's by more than TILT_RAD: a marker
                mistaken for another turns a body by tens of degrees.  Headings are not compared:
                among steel the autopilot's is the one that is wrong
    taken back  after RETURN_S without either

Rates are the autopilot's gyros': cameras have none.  Without any attitude of the autopilot's there
is nothing to compare with, and the tracker's is taken.  Times are on the loop's clock; time is an
argument.
"""

from __future__ import annotations

from math import acos, degrees, sqrt
from typing import Final

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.sources import RETURN_S, Quaternion
from tgl_soar.types import NAN, NO_ATTITUDE, AttitudeSample

# 0.6 rad of phase of a short period of 12 rad/s: what a delay of the attitude may cost at most.
FRESH_S: Final = 0.05
# An autopilot's vertical is off by 2 to 3 degrees in curved flight, a body's by 1 when it is made.
TILT_RAD: Final = 0.17
RATES_S: Final = 0.1  # no older rates go with a pose


class TrackedAttitude:
    """Chooses between a tracker's attitude and the autopilot's."""

    def __init__(self) -> None:
        self.is_chosen = False  # the tracker's
        self.used = self.refused = self.switches = 0  # poses, poses, changes to the autopilot's
        self.notices: list[tuple[int, str]] = []  # (severity, text)
        self._pose: AttitudeSample = NO_ATTITUDE
        self._steady_s = NAN  # since when poses come and agree
        self._given: AttitudeSample = NO_ATTITUDE  # as it came, whichever source's
        self._sample: AttitudeSample = NO_ATTITUDE  # the same, numbered for the tick

    def take(self, turned: Quaternion, time_s: float, reported: AttitudeSample) -> None:
        """A pose, FRD to local NED, that was true at `time_s` [s]; reported: the autopilot's."""
        known = reported.sequence > 0 and abs(time_s - reported.time_s) <= FRESH_S
        if known and not _tilt_between(turned, reported) <= TILT_RAD:  # NaN: one is no rotation
            self.refused += 1
            apart_deg = degrees(_tilt_between(turned, reported))
            if self._steady_s == self._steady_s:
                self._leave(f"the tracked attitude is {apart_deg:.0f} degrees off: not used")
            self._pose, self._steady_s = NO_ATTITUDE, NAN
            return
        # The first; the first after a gap; or after the attitude was left, with or without a gap:
        # poses that were only late are as close together as ever.
        if self._steady_s != self._steady_s or not time_s - self._pose.time_s <= FRESH_S:
            self._steady_s = time_s
        self.used += 1
        p = q = r = NAN
        if reported.sequence > 0 and abs(time_s - reported.time_s) <= RATES_S:
            p, q, r = reported.rates_frd_radps
        self._pose = AttitudeSample(
            sequence=self.used,
            time_s=time_s,
            qw=turned[0],
            qx=turned[1],
            qy=turned[2],
            qz=turned[3],
            roll_rate_frd_radps=p,
            pitch_rate_frd_radps=q,
            yaw_rate_frd_radps=r,
        )

    def choose(self, now_s: float, reported: AttitudeSample) -> AttitudeSample:
        """What a tick is given now; its number grows with every sample that is another one."""
        pose = self._pose
        fresh = pose.sequence > 0 and now_s - pose.time_s <= FRESH_S
        if self.is_chosen and not fresh:
            self._leave(f"no tracked attitude for {1e3 * FRESH_S:.0f} ms: the autopilot's is used")
        # Before the autopilot has reported any, nothing is gained by waiting.
        steady = pose.time_s - self._steady_s >= RETURN_S or reported.sequence == 0
        if fresh and steady and not self.is_chosen:
            self.is_chosen = True
            self.notices.append((SEVERITY_INFO, "attitude: the tracker's"))
        given = pose if self.is_chosen else reported
        if given is not self._given:
            self._given = given
            self._sample = given._replace(sequence=self._sample.sequence + 1)
        return self._sample

    def reset(self) -> None:
        """The clock is another one: what was timed by the old one is forgotten."""
        self.is_chosen = False
        self._pose, self._given, self._steady_s = NO_ATTITUDE, NO_ATTITUDE, NAN

    def _leave(self, why: str) -> None:
        self._steady_s = NAN
        if self.is_chosen:
            self.is_chosen = False
            self.switches += 1
            self.notices.append((SEVERITY_WARNING, why))


def _tilt_between(turned: Quaternion, reported: AttitudeSample) -> float:
    """The angle [rad] between the verticals of two attitudes; NaN where one is no rotation."""
    ax, ay, az = _down_frd(*turned)
    bx, by, bz = _down_frd(reported.qw, reported.qx, reported.qy, reported.qz)
    length = sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    if not length > 0.0:
        return NAN
    return acos(max(-1.0, min(1.0, (ax * bx + ay * by + az * bz) / length)))


def _down_frd(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """Down, in the axes of the body."""
    return (
        2.0 * (qx * qz - qw * qy),
        2.0 * (qy * qz + qw * qx),
        qw * qw - qx * qx - qy * qy + qz * qz,
    )
