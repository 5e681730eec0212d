"""Positions as they come over MAVLink, for the choice among all sources (`sources`)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from tgl_soar.geometry import is_rotation, quaternion_from_euler, rotated
from tgl_soar.link.messages import (
    FRAME_BODY_FRD,
    FRAME_BODY_NED,
    FRAME_LOCAL_FRD,
    FRAME_LOCAL_NED,
    ID_GLOBAL_POSITION_INT,
    ID_LOCAL_POSITION_NED,
    ID_ODOMETRY,
    SEVERITY_WARNING,
    GlobalPositionInt,
    LocalPositionNed,
    Odometry,
    Source,
    VisionPositionEstimate,
)
from tgl_soar.link.sensor_units import sigma_of
from tgl_soar.link.sources import (
    EXTERNAL,
    GLOBAL_POSITION,
    LOCAL_POSITION,
    ODOMETRY,
    VISION,
    PositionSources,
    Quaternion,
)
from tgl_soar.link.tangent_plane import Home, TangentPlane
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.link.vehicle.estimator_status import EstimatorAids
from tgl_soar.link.vehicle.sample_times import SampleTimes
from tgl_soar.link.vehicle.sensor_samples import SensorSamples
from tgl_soar.types import NAN, PositionFix, isfinite

FAR_M: Final = 100_000.0  # from the home: no place of this flight

_LOCAL_FRAMES: Final = (FRAME_LOCAL_NED, FRAME_LOCAL_FRD)
_BODY_FRAMES: Final = (FRAME_BODY_FRD, FRAME_BODY_NED)


class PositionSamples:
    """Makes fixes of messages and offers them to the sources."""

    def __init__(
        self,
        sources: PositionSources,
        home: Home | None,
        vision_from: Collection[Source],
        samples: SensorSamples,
        times: SampleTimes,
        aids: EstimatorAids,
        ledger: Ledger,
    ) -> None:
        """`samples`: take the attitude of ODOMETRY; their newest stamp is the time in lockstep."""
        self._sources = sources
        self._plane = TangentPlane(home) if home is not None else None
        self._vision_from = frozenset(vision_from)
        self._samples = samples
        self._times = times
        self._aids = aids
        self._counters, self._notices, self._streams = ledger

    def on_local_position(self, m: LocalPositionNed, now_s: float) -> None:
        """Offer a position of the autopilot's estimator."""
        self._streams.received(ID_LOCAL_POSITION_NED)
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self._counters.not_finite += 1
            return
        times = self._times.of_milliseconds(ID_LOCAL_POSITION_NED, m.time_boot_ms, now_s)
        if times is not None:
            self._offer(LOCAL_POSITION, times[0], (m.x, m.y, m.z), (m.vx, m.vy, m.vz), now_s)

    def on_global_position(self, m: GlobalPositionInt, now_s: float) -> None:
        """Offer a position by latitude and longitude, if there is a home."""
        self._streams.received(ID_GLOBAL_POSITION_INT)
        times = self._times.of_milliseconds(ID_GLOBAL_POSITION_INT, m.time_boot_ms, now_s)
        if times is None or self._plane is None:
            return
        at = self._plane.ned_m(m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3)
        if not max(abs(at[0]), abs(at[1]), abs(at[2])) < FAR_M:
            if self._counters.far == 0:
                where = f"{m.lat * 1e-7:.4f}, {m.lon * 1e-7:.4f}"
                text = f"GLOBAL_POSITION_INT at {where}: no fix, or not near position.home"
                self._notices.append((SEVERITY_WARNING, text))
            self._counters.far += 1
            return
        velocity = m.vx * 0.01, m.vy * 0.01, m.vz * 0.01
        self._offer(GLOBAL_POSITION, times[0], at, velocity, now_s)

    def on_vision(self, source: Source, m: VisionPositionEstimate, now_s: float) -> None:
        """Offer what another bridge sends to the autopilot."""
        if source not in self._vision_from:
            self._counters.foreign += 1
            return
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self._counters.not_finite += 1
            return
        times = self._times.of_microseconds(source, m.usec, now_s, foreign=True)
        if times is not None:
            has_attitude = all(isfinite(angle) for angle in (m.roll, m.pitch, m.yaw))
            attitude = quaternion_from_euler(m.roll, m.pitch, m.yaw) if has_attitude else None
            sigma_m = sigma_of(m.covariance)
            unknown = (NAN, NAN, NAN)
            self._offer(VISION, times[0], (m.x, m.y, m.z), unknown, now_s, sigma_m, attitude)

    def on_odometry(self, m: Odometry, now_s: float) -> None:
        """Offer a position, and use the attitude with it.

        LOCAL_FRD is the hall's frame: NED by agreement.
        """
        self._streams.received(ID_ODOMETRY)
        in_body = m.child_frame_id in _BODY_FRAMES
        if m.frame_id not in _LOCAL_FRAMES or not (in_body or m.child_frame_id in _LOCAL_FRAMES):
            if self._counters.wrong_frame == 0:
                text = f"ODOMETRY in frames {m.frame_id}, {m.child_frame_id}: send LOCAL_NED or"
                self._notices.append((SEVERITY_WARNING, f"{text} LOCAL_FRD with BODY_FRD"))
            self._counters.wrong_frame += 1
            return
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self._counters.not_finite += 1
            return
        times = self._times.of_microseconds(ID_ODOMETRY, m.time_usec, now_s)
        if times is None:
            return
        has_attitude = all(isfinite(q) for q in m.q)
        velocity = (m.vx, m.vy, m.vz)
        if in_body:
            velocity = rotated(m.q, velocity) if is_rotation(*m.q) else (NAN, NAN, NAN)
        sigma_m = sigma_of(m.pose_covariance)
        self._offer(ODOMETRY, times[0], (m.x, m.y, m.z), velocity, now_s, sigma_m)
        if has_attitude:
            self._samples.on_odometry(m, times, now_s)

    def _offer(
        self,
        source: int,
        time_s: float,
        at: tuple[float, float, float],
        velocity: tuple[float, float, float],
        now_s: float,
        sigma_m: float = NAN,
        attitude: Quaternion | None = None,
    ) -> None:
        """A position for the choice among all sources."""
        (x, y, z), (u, v, w) = at, velocity
        fix = PositionFix(
            sequence=0,
            time_s=time_s,
            north_m=x,
            east_m=y,
            down_m=z,
            velocity_north_mps=u,
            velocity_east_mps=v,
            velocity_down_mps=w,
            source=source,
            sigma_m=sigma_m,
            reckoned=source not in EXTERNAL and self._aids.reckons,
        )
        if self._times.lockstep:  # the vehicle's time is at least this, though attitudes be lost
            newest_s = self._samples.vehicle_time_s
            now_s = time_s if time_s > newest_s else newest_s
        if self._sources.take(source, fix, now_s, attitude):
            self._counters.positions += 1
