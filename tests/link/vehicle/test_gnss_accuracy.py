"""What a receiver of satellites says of its accuracy: its unit, its gaps, how long it is known."""

from __future__ import annotations

from math import isnan, nan

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.messages import GpsRawInt
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.gnss_accuracy import GnssAccuracy

FIX_2D, FIX_3D = mavlink.GPS_FIX_TYPE_2D_FIX, mavlink.GPS_FIX_TYPE_3D_FIX
GOOD = GpsRawInt(FIX_3D, 1250, 2500)


def accuracy() -> GnssAccuracy:
    return GnssAccuracy(Ledger(SessionCounters(), [], StreamRequests(1)), counts=True)


def test_millimetres_are_metres_horizontally_and_in_height() -> None:
    known = accuracy()
    assert all(map(isnan, known.known(100.0)))
    known.take(GOOD, 100.0)
    assert known.known(100.0) == pytest.approx((1.25, 2.5))


@pytest.mark.parametrize("after_s", [0.0, 4.9])
def test_it_is_known_for_five_seconds(after_s: float) -> None:
    known = accuracy()
    known.take(GOOD, 100.0)
    assert known.known(100.0 + after_s) == pytest.approx((1.25, 2.5))


@pytest.mark.parametrize("after_s", [5.1, 1e6, -0.1, nan])
def test_and_not_after_that_nor_before_it_came(after_s: float) -> None:
    known = accuracy()
    known.take(GOOD, 100.0)
    assert all(map(isnan, known.known(100.0 + after_s)))


@pytest.mark.parametrize("nothing", [0, 2**32 - 1])
def test_a_receiver_that_reports_none_of_one_may_report_the_other(nothing: int) -> None:
    known = accuracy()
    known.take(GpsRawInt(FIX_3D, nothing, 1), 100.0)
    horizontal_m, vertical_m = known.known(100.0)
    assert isnan(horizontal_m)
    assert vertical_m == pytest.approx(0.001)
    known.take(GpsRawInt(FIX_3D, 2**32 - 2, nothing), 101.0)
    horizontal_m, vertical_m = known.known(101.0)
    assert horizontal_m == pytest.approx(4_294_967.294)
    assert isnan(vertical_m)


@pytest.mark.parametrize(
    ("fix", "is_known"),
    [(0, False), (FIX_2D, False), (FIX_3D, True), (mavlink.GPS_FIX_TYPE_RTK_FIXED, True)],
)
def test_without_a_fix_in_three_dimensions_nothing_is_known_of_either(
    fix: int, is_known: bool
) -> None:
    known = accuracy()
    known.take(GOOD, 100.0)
    known.take(GOOD._replace(fix_type=fix), 101.0)
    assert [not isnan(metres) for metres in known.known(101.0)] == [is_known] * 2


def test_a_restart_forgets_it() -> None:
    known = accuracy()
    known.take(GOOD, 100.0)
    known.restarted()
    assert all(map(isnan, known.known(100.0)))
    known.take(GpsRawInt(0, 5, 5), 100.0)  # nothing is left of the old one either
    assert all(map(isnan, known.known(100.0)))
    assert known.counts
