"""What the autopilot's estimator says of its own position: measured, or only dead reckoned.

A position goes on coming, and looks as good as ever, when satellites or cameras are gone: the
estimator goes on by its accelerometers.  After some seconds it says so by its flags of an absolute
position and of one relative to where it began:

    level      2 absolute, 1 relative, 0 neither
    reckoned   level 0, or below the highest since the autopilot's start

A level needs both of its flags, POS_HORIZ_… and PRED_POS_HORIZ_…: PX4's EKF2 calls a position
absolute for as long as the wind aids it, and withdraws what it predicts when fixes stop.  With
CONST_POS_MODE the level of an ArduPilot is 0, whatever else it says: EKF3 calls a position relative
that the wind alone aids.  PX4 sets that flag for an aircraft at rest too, where it says nothing.

It is said late: EKF3 waits for 7 s without fixes, with velocities for 10 s.

Nothing said is no doubt: ArduPilot's DCM sends no report.  The last word holds until the next, or
until the autopilot restarts.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import (
    ESTIMATOR_POSITION_ABSOLUTE,
    ESTIMATOR_POSITION_CONSTANT,
    ESTIMATOR_POSITION_RELATIVE,
    ESTIMATOR_PREDICTS_ABSOLUTE,
    ESTIMATOR_PREDICTS_RELATIVE,
    ID_EKF_STATUS_REPORT,
    ID_ESTIMATOR_STATUS,
    EkfStatusReport,
    EstimatorStatus,
)
from tgl_soar.link.vehicle.ledger import Ledger

_ABSOLUTE: Final = ESTIMATOR_POSITION_ABSOLUTE | ESTIMATOR_PREDICTS_ABSOLUTE
_RELATIVE: Final = ESTIMATOR_POSITION_RELATIVE | ESTIMATOR_PREDICTS_RELATIVE


class EstimatorAids:
    """Whether the autopilot's own position is measured."""

    def __init__(self, ledger: Ledger) -> None:
        self.reckons = False  # it says that its position is only dead reckoned
        self._best = 0  # level since its start
        self._streams = ledger.streams

    def on_status(self, message: EkfStatusReport | EstimatorStatus) -> None:
        """Take what the estimator says of itself."""
        flags = message.flags
        level = 2 if flags & _ABSOLUTE == _ABSOLUTE else 1 if flags & _RELATIVE == _RELATIVE else 0
        if isinstance(message, EkfStatusReport):
            self._streams.received(ID_EKF_STATUS_REPORT)
            if flags & ESTIMATOR_POSITION_CONSTANT:
                level = 0
        else:
            self._streams.received(ID_ESTIMATOR_STATUS)
        self._best = max(self._best, level)
        self.reckons = level == 0 or level < self._best

    def restarted(self) -> None:
        """The autopilot has restarted: nothing is known of it."""
        self.reckons, self._best = False, 0
