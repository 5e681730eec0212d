"""Which bodies a server streams: how often, how well and how lately each was in a frame."""

from __future__ import annotations

from math import isnan, nan

import pytest

from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.link.natnet.listing import BodyListing

TRACKED, LOST = 1, 0  # the first bit of a body's flags


def body(number: int, flags: int = TRACKED, x_m: float = 0.0) -> RigidBody:
    return RigidBody(
        id=number,
        x_m=x_m,
        y_m=0.0,
        z_m=0.0,
        qx=0.0,
        qy=0.0,
        qz=0.0,
        qw=1.0,
        error_m=0.0,
        flags=flags,
    )


def test_where_nothing_came_there_is_no_row() -> None:
    listing = BodyListing()
    listing.take([], 0.0, 1.0)
    assert listing.rows({"glider": 1}, 2.0) == []


def test_bodies_stand_by_their_numbers_with_their_names_where_these_are_known() -> None:
    listing = BodyListing()
    listing.take([body(7), body(2)], 0.01, 1.0)
    listing.take([body(5)], 0.01, 2.0)
    rows = listing.rows({"glider": 5, "wand": 2, "gone": 9}, 3.0)
    assert [(row.id, row.name) for row in rows] == [(2, "wand"), (5, "glider"), (7, "")]


def test_frames_are_counted_from_the_body_s_first_to_its_last() -> None:
    """Five intervals of 0.1 s between six frames; of a body's own frames, no other's."""
    listing = BodyListing()
    listing.take([body(2)], 0.0, 9.0)
    for i in range(6):
        flags = TRACKED if i in (0, 1, 5) else LOST
        listing.take([body(1, flags, x_m=float(i))], 0.001 * i, 10.0 + 0.1 * i)
    first, second = listing.rows({}, 12.0)
    assert first.rate_hz == pytest.approx(10.0)
    assert first.tracked_fraction == pytest.approx(0.5)
    assert first.tracked is True
    assert first.silent_s == pytest.approx(1.5)
    assert first.age_s == pytest.approx(0.005)
    assert first.pose.x_m == 5.0
    assert isnan(second.rate_hz)  # one frame has no rate
    assert second.tracked_fraction == 1.0
    assert second.silent_s == pytest.approx(3.0)


def test_a_body_that_is_lost_in_its_last_frame_is_not_tracked_however_often_it_was() -> None:
    listing = BodyListing()
    for now_s in (1.0, 2.0, 3.0):
        listing.take([body(1, LOST if now_s == 3.0 else TRACKED)], nan, now_s)
    (row,) = listing.rows({}, 3.0)
    assert not row.tracked
    assert row.tracked_fraction == pytest.approx(2.0 / 3.0)
    assert isnan(row.age_s)
    assert row.silent_s == 0.0
    assert row.rate_hz == pytest.approx(1.0)
