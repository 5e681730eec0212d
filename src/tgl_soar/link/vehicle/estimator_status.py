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

Without a word all is certain: some estimators send no report at all, ArduPilot's DCM among them; an
older one sends a report without any flag, which is level 0, and nobody engages with it.  What was
said holds until the next word, for STATUS_AGE_MAX_S, or until the autopilot restarts.  After that

    measured   is not known any more, which is reported: nobody would notice satellites go
    reckoned   holds on: nobody said that it is measured again

Nor is a silence alone uncertain: what silences one message of an estimator that goes on is a
station that sets rates of its own, or a line that is full, and neither has a part in satellites.
To give up the line for it would cost more flights than it could save: of those to which dead
reckoning is reported without leave to break off nearly all end in the pilot's hands, of the others
most soar on (docs/outdoors.md).
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
    SEVERITY_NOTICE,
    SEVERITY_WARNING,
    EkfStatusReport,
    EstimatorStatus,
)
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.types import NAN

_ABSOLUTE: Final = ESTIMATOR_POSITION_ABSOLUTE | ESTIMATOR_PREDICTS_ABSOLUTE
_RELATIVE: Final = ESTIMATOR_POSITION_RELATIVE | ESTIMATOR_PREDICTS_RELATIVE
# A stream that has stopped is missed after 2 s at most and asked for again, 3 s later once more, if
# that request is lost (`link.stream_requests`): before the second nobody can say that it is gone
# for good.
STATUS_AGE_MAX_S: Final = 6.0


class EstimatorAids:
    """Whether the autopilot's own position is measured."""

    def __init__(self, ledger: Ledger) -> None:
        self.reckons = False  # it says that its position is only dead reckoned
        self._best = 0  # level since its start
        self._received_s = NAN  # when it spoke last; NaN: it did not yet
        self._silent = False  # and that was reported
        _, self._notices, self._streams = ledger

    def on_status(self, message: EkfStatusReport | EstimatorStatus, now_s: float) -> None:
        """Take what the estimator says of itself."""
        self._received_s = now_s
        if self._silent:
            self._silent = False
            self._notices.append((SEVERITY_NOTICE, "the autopilot's estimator reports again"))
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

    def poll(self, now_s: float) -> None:
        """Tell where what it said has become too old."""
        age_s = now_s - self._received_s
        if self._silent or not age_s > STATUS_AGE_MAX_S:  # NaN: it never spoke
            return
        self._silent = True
        last = "dead reckoned, which holds" if self.reckons else "measured, which nobody knows now"
        text = (
            f"the autopilot's estimator has been silent for {age_s:.0f} s: its position was {last}"
        )
        self._notices.append((SEVERITY_WARNING, text))

    def restarted(self) -> None:
        """The autopilot has restarted: nothing is known of it."""
        self.reckons, self._best = False, 0
        self._received_s, self._silent = NAN, False

    def rebase(self, now_s: float) -> None:
        """The loop's clock was changed to now_s: it spoke just now, if ever."""
        if self._received_s == self._received_s:
            self._received_s = now_s
