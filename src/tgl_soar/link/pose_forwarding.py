"""Telling the autopilot the pose that a tracker has measured, so that its own filter has it too.

EKF2 (PX4) and EKF3 (ArduPilot) both take VISION_POSITION_ESTIMATE in local NED, and ODOMETRY
in LOCAL_FRD with velocities in BODY_FRD; what their parameters must be is in
docs/sensors.md.  Their filters want 30 to 50 poses a second, none of them twice.

    time         of the measurement, by the clock in which we answer TIMESYNC: PX4 turns that into
                 its own by our answers, ArduPilot by the smallest delay
    attitude     of the tracker, never the autopilot's own back to itself: a tracker that has
                 none has nothing to forward, for a yaw must stand in the message
    covariance   variances on the diagonal; NaN in the first place where nothing is known, so
                 that the autopilot's own parameters count, and nowhere else: EKF3 drops such a pose
    estimator    VISION, whatever it is: EKF2 does not look at what calls itself MOCAP
    quaternion   normalised: EKF2 refuses what is not a unit by more than 1e-5

Only a source that is not the autopilot's own is forwarded, and only a fix that is new and not
older than `STALE_S`: with the source the messages stop.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

from tgl_soar.geometry import euler_from_quaternion, rotated
from tgl_soar.link.messages import (
    ESTIMATOR_VISION,
    FRAME_BODY_FRD,
    FRAME_LOCAL_FRD,
    SEVERITY_WARNING,
    UNKNOWN_COVARIANCE,
    Odometry,
    Outbound,
    VisionPositionEstimate,
)
from tgl_soar.link.sources import EXTERNAL, NAMES, PositionSources, Quaternion
from tgl_soar.types import NAN, isfinite

STALE_S: Final = 0.1
UNIT: Final = 0.02  # a quaternion whose norm is further from 1 is no rotation
EARLY: Final = 0.25  # of an interval that a pose may go out before its time: sources jitter

VISION_POSITION_ESTIMATE: Final = "vision_position_estimate"
ODOMETRY: Final = "odometry"


class PoseForwarding:
    """Gives out what is due; time is an argument."""

    def __init__(
        self, message: str, rate_hz: float, *, sigma_m: float = NAN, sigma_rad: float = 0.02
    ) -> None:
        """`sigma_m`: of a source that does not send its own; NaN: not known."""
        self.sent = 0
        self.known: set[int] = set()  # sources that reach the autopilot without us
        self.notices: list[tuple[int, str]] = []
        self._message = message
        self._interval_s = 1.0 / rate_hz
        self._sigma_m, self._sigma_rad = sigma_m, sigma_rad
        self._due_s = float("-inf")
        self._sequence = 0
        self._reported = False

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._due_s = float("-inf")

    def poll(self, sources: PositionSources, now_s: float) -> Outbound | None:
        """The pose of the chosen source, if it is to be forwarded now."""
        fix, measured = sources.position, sources.attitude
        if sources.chosen not in EXTERNAL or sources.chosen in self.known:
            return None
        if fix.sequence == self._sequence:
            return None
        if not 0.0 <= now_s - fix.time_s <= STALE_S:
            return None
        if now_s < self._due_s - EARLY * self._interval_s:
            return None
        attitude = normalised(measured)
        if attitude is None:
            self._report(f"{NAMES[sources.chosen]} is not forwarded: it has no attitude")
            return None
        # On the grid of the first one, unless there was a pause.
        late = now_s - self._due_s > self._interval_s
        self._due_s = (now_s if late else self._due_s) + self._interval_s
        self._sequence = fix.sequence
        self.sent += 1
        velocity = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
        covariance = self._covariance(fix.sigma_m)
        stamp_us = max(1, round(fix.time_s * 1e6))
        if self._message == VISION_POSITION_ESTIMATE:
            roll, pitch, yaw = euler_from_quaternion(*attitude)
            return VisionPositionEstimate(
                usec=stamp_us,
                x=fix.north_m,
                y=fix.east_m,
                z=fix.down_m,
                roll=roll,
                pitch=pitch,
                yaw=yaw,
                covariance=covariance,
            )
        conjugate = attitude[0], -attitude[1], -attitude[2], -attitude[3]
        vx, vy, vz = rotated(conjugate, velocity)
        return Odometry(
            time_usec=stamp_us,
            frame_id=FRAME_LOCAL_FRD,
            child_frame_id=FRAME_BODY_FRD,
            x=fix.north_m,
            y=fix.east_m,
            z=fix.down_m,
            q=attitude,
            vx=vx,
            vy=vy,
            vz=vz,
            rollspeed=NAN,
            pitchspeed=NAN,
            yawspeed=NAN,
            pose_covariance=covariance,
            velocity_covariance=UNKNOWN_COVARIANCE,
            estimator_type=ESTIMATOR_VISION,
        )

    def _covariance(self, reported_m: float) -> tuple[float, ...]:
        sigma_m = reported_m if isfinite(reported_m) and reported_m > 0.0 else self._sigma_m
        if not isfinite(sigma_m):
            return UNKNOWN_COVARIANCE
        place, turn = sigma_m * sigma_m, self._sigma_rad * self._sigma_rad
        upper = [0.0] * 21
        for diagonal, variance in zip(_DIAGONAL, (place,) * 3 + (turn,) * 3, strict=True):
            upper[diagonal] = variance
        return tuple(upper)

    def _report(self, text: str) -> None:
        if not self._reported:
            self._reported = True
            self.notices.append((SEVERITY_WARNING, text))


_DIAGONAL: Final = (0, 6, 11, 15, 18, 20)  # of an upper triangle, row by row


def normalised(q: Quaternion | None) -> Quaternion | None:
    """The unit quaternion, to a double's precision; None: this is no rotation."""
    if q is None or not all(isfinite(part) for part in q):
        return None
    norm = sqrt(sum(part * part for part in q))
    if abs(norm - 1.0) > UNIT:
        return None
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm
