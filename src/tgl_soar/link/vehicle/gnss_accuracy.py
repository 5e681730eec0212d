"""What the receiver of satellites says of its own accuracy: GPS_RAW_INT's h_acc and v_acc.

They are standard deviations of its place, horizontally and in height, in whole millimetres.  0, and
all bits set, stand for a receiver that reports none; eph and epv beside them are dilutions of
precision, which say how the satellites stand and not what the place is worth.

They are not the sigma of a fix that the estimator weighs: such errors change over minutes, and a
filter that took them for noise would average over seconds what stays, and follow the
accelerometers' biases instead.  They are to be known before an engagement, and reported when they
get worse.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import ID_GPS_RAW_INT, GpsRawInt
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.types import NAN

ACCURACY_AGE_MAX_S: Final = 5.0  # it comes once a second: after that nothing is known
_NOT_REPORTED: Final = 0xFFFFFFFF
FIX_3D: Final = 3  # GPS_FIX_TYPE: with less there is no height


class GnssAccuracy:
    """The receiver's own figures, while they are of now."""

    def __init__(self, ledger: Ledger, *, counts: bool) -> None:
        """`counts`: the position that is flown with comes from satellites."""
        self.counts = counts
        self._streams = ledger.streams
        self.restarted()

    def restarted(self) -> None:
        """The autopilot, or the clock, is another one from here on."""
        self._received_s = NAN
        self._horizontal_m = self._vertical_m = NAN

    def take(self, message: GpsRawInt, now_s: float) -> None:
        """A report of the first receiver has come."""
        self._streams.received(ID_GPS_RAW_INT)
        self._received_s = now_s
        has_fix = message.fix_type >= FIX_3D
        self._horizontal_m = _metres(message.h_acc) if has_fix else NAN
        self._vertical_m = _metres(message.v_acc) if has_fix else NAN

    def known(self, now_s: float) -> tuple[float, float]:
        """Standard deviations [m], horizontally and in height; NaN: not known."""
        if not 0.0 <= now_s - self._received_s <= ACCURACY_AGE_MAX_S:  # false for NaN
            return NAN, NAN
        return self._horizontal_m, self._vertical_m


def _metres(millimetres: int) -> float:
    return NAN if millimetres in (0, _NOT_REPORTED) else 1e-3 * millimetres
