"""What the autopilot's heartbeats say: its mode, whether it obeys us, and which firmware it is."""

from __future__ import annotations

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    ID_HEARTBEAT,
    MODE_FLAG_ARMED,
    SEVERITY_ERROR,
    TYPE_GCS,
    Heartbeat,
)
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.types import NAN, AutopilotStatus


class VehicleStatus:
    """The state of the autopilot as its last heartbeat says."""

    def __init__(self, flavour: Flavour, ledger: Ledger) -> None:
        self.status = AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False)
        self.custom_mode = -1
        self.mismatch = ""  # why this is not the autopilot of the airframe file
        self._flavour = flavour
        self._counters, self._notices, self._streams = ledger

    @property
    def is_known(self) -> bool:
        """Whether the autopilot has ever sent a heartbeat."""
        return self.status.time_s == self.status.time_s

    def on_heartbeat(self, message: Heartbeat, now_s: float) -> None:
        """Take the state from a heartbeat; one that is no autopilot's is ignored."""
        if message.autopilot == AUTOPILOT_INVALID or message.type == TYPE_GCS:
            return
        self._counters.heartbeats += 1
        self._streams.received(ID_HEARTBEAT)
        self.custom_mode = message.custom_mode
        mismatch = self._flavour.mismatch(message)
        if mismatch != self.mismatch:
            self.mismatch = mismatch
            if mismatch:
                self._notices.append((SEVERITY_ERROR, mismatch))
        self.status = AutopilotStatus(
            time_s=now_s,
            accepts_surfaces=not mismatch and self._flavour.obeys(message),
            armed=message.base_mode & MODE_FLAG_ARMED != 0,
            failsafe=self._flavour.failsafe(message),
            boots=self._counters.reboots,
        )

    def restarted(self) -> None:
        """The autopilot has restarted."""
        self.status = self.status._replace(boots=self._counters.reboots)

    def rebase(self, now_s: float) -> None:
        """The loop's clock was changed to now_s."""
        if self.is_known:
            self.status = self.status._replace(time_s=now_s)
