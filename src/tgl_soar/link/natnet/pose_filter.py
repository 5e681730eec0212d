"""Position fixes from poses of a rigid body; what is no measurement is counted and not used."""

from __future__ import annotations

from tgl_soar.geometry import ned_attitude_from_hall, ned_from_hall
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet import track
from tgl_soar.link.natnet.diagnostics import OptitrackLedger
from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.natnet.track import PoseTrack
from tgl_soar.types import NAN, PositionFix, isfinite


class PoseFilter:
    """One body's poses, one after another."""

    def __init__(self, settings: OptitrackSettings, ledger: OptitrackLedger) -> None:
        self.pose: RigidBody | None = None  # the last one that was used, hall's axes
        self.latency_s = NAN  # from the exposure to now, of the last fix
        self._settings = settings
        self._counters, self._notices = ledger
        self._track = PoseTrack(settings.max_speed_mps)
        self._used_s = float("-inf")  # when the last fix was true

    @property
    def attitude(self) -> tuple[float, float, float, float] | None:
        """Of the pose that was used last, FRD to local NED."""
        pose = self.pose
        if pose is None:
            return None
        return ned_attitude_from_hall(self._settings.hall, pose.qw, pose.qx, pose.qy, pose.qz)

    def reset(self) -> None:
        """The next pose is the first."""
        self._track.reset()
        self._used_s = float("-inf")

    def fix_of(self, body: RigidBody, time_s: float, now_s: float) -> PositionFix | None:
        """The position of a pose that was true at `time_s`; None: it is not used."""
        counters, settings = self._counters, self._settings
        if not body.is_tracked:
            counters.untracked += 1
            text = f"{settings.body!r} is not tracked: not used"
            self._notices.report("untracked", SEVERITY_INFO, text)
            return None
        if not all(map(isfinite, (*body.pose, body.error_m))):
            counters.not_finite += 1
            self._notices.report("finite", SEVERITY_WARNING, "a pose is not a number")
            return None
        if not self._follows(body, time_s):
            return None
        if body.error_m > settings.max_error_m:
            counters.poor += 1
            text = f"mean marker error {1e3 * body.error_m:.0f} mm: not used"
            self._notices.report("poor", SEVERITY_WARNING, text)
            return None
        # A frame that is early by half a frame's time is not left out.
        if time_s - self._used_s < 0.75 / settings.max_rate_hz:
            counters.thinned += 1
            return None
        counters.fixes += 1
        self._notices.pose_used(now_s)
        self._used_s = time_s
        self.pose = body
        self.latency_s = now_s - time_s
        north, east, down = ned_from_hall(settings.hall, body.x_m, body.y_m, body.z_m)
        return PositionFix(
            sequence=0,
            time_s=time_s,
            north_m=north,
            east_m=east,
            down_m=down,
            velocity_north_mps=NAN,
            velocity_east_mps=NAN,
            velocity_down_mps=NAN,
            source=0,
            sigma_m=max(settings.noise_m, body.error_m),
        )

    def _follows(self, body: RigidBody, time_s: float) -> bool:
        """Whether flight can have led from the poses before to this one."""
        counters, name = self._counters, self._settings.body
        verdict = self._track.judge(body, time_s)
        if verdict == track.FROZEN:
            counters.frozen += 1
            text = f"the pose of {name!r} is frozen: bit for bit the last one"
            self._notices.report("frozen", SEVERITY_WARNING, text)
        elif verdict == track.JUMPED:
            counters.jumps += 1
            text = f"{name!r} has jumped by {self._track.jump_m:.2f} m: not used until it holds"
            self._notices.report("jump", SEVERITY_WARNING, text)
        elif verdict == track.SETTLING:
            counters.settling += 1
        return verdict == track.GOOD
