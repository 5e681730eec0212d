"""A tracker's attitude in place of the autopilot's: when it is taken, refused and left."""

from __future__ import annotations

import random
from itertools import pairwise
from math import cos, nan, pi, radians, sin

import pytest
from samples import attitude_sample

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.sources import RETURN_S, Quaternion
from tgl_soar.link.tracked_attitude import FRESH_S, TILT_RAD, TrackedAttitude
from tgl_soar.types import NO_ATTITUDE, AttitudeSample


def rolled(rad: float) -> Quaternion:
    return cos(0.5 * rad), sin(0.5 * rad), 0.0, 0.0


def turned(rad: float) -> Quaternion:
    return cos(0.5 * rad), 0.0, 0.0, sin(0.5 * rad)


LEVEL = rolled(0.0)


class Flight:
    """An autopilot's attitudes each 5 ms and poses each 10 ms, 15 ms late."""

    def __init__(self) -> None:
        self.tracked = TrackedAttitude()
        self.now_s = 0.0
        self.given: list[AttitudeSample] = []
        self.words: list[str] = []
        self._steps = 0

    def runs(
        self, seconds: float, pose: Quaternion | None, reported: Quaternion | None = LEVEL
    ) -> Flight:
        for _ in range(round(seconds / 0.005)):
            self._steps += 1
            self.now_s = 0.005 * self._steps
            sample = NO_ATTITUDE
            if reported is not None:
                sample = attitude_sample(self._steps, self.now_s - 0.005, reported, (0.1, 0.2, 0.3))
            if pose is not None and self._steps % 2 == 0:
                self.tracked.take(pose, self.now_s - 0.015, sample)
            self.given.append(self.tracked.choose(self.now_s, sample))
            self.words += [text for _, text in self.tracked.notices]
            self.tracked.notices.clear()
        return self


def test_attitudes_that_are_the_same_stand_at_no_angle() -> None:
    """Rounding makes the cosine between them more than 1 now and then."""
    flight, dice = Flight(), random.Random(5)
    for _ in range(300):
        w, x, y, z = (dice.gauss(0.0, 1.0) for _ in range(4))
        k = dice.uniform(0.5, 2.0)  # of another length, too
        flight.runs(0.01, (w, x, y, z), (k * w, k * x, k * y, k * z))
    assert flight.tracked.refused == 0


def test_a_steady_tracker_is_taken_with_the_gyros_rates() -> None:
    pose = quaternion_from_euler(0.03, -0.05, 0.5)  # no two of its numbers are alike
    flight = Flight().runs(RETURN_S - 0.1, pose)
    assert not flight.tracked.is_chosen
    flight.runs(0.2, pose)
    last = flight.given[-1]
    assert flight.tracked.is_chosen
    assert last[2:6] == pose
    assert last[6:9] == (0.1, 0.2, 0.3)
    assert flight.words == ["attitude: the tracker's"]


def test_numbers_grow_with_every_sample_and_with_no_other() -> None:
    """Estimator and health look at a sample once, whichever source it is of."""
    flight = Flight().runs(3.0, turned(0.5)).runs(1.0, None).runs(3.0, turned(0.5))
    numbers = [sample.sequence for sample in flight.given]
    assert all(b - a in (0, 1) for a, b in pairwise(numbers))
    for a, b in pairwise(flight.given):
        assert (a.sequence == b.sequence) == (a == b)


def test_the_autopilot_s_is_taken_when_the_poses_stop_and_the_tracker_s_again_later() -> None:
    flight = Flight().runs(3.0, turned(0.5)).runs(FRESH_S + 0.02, None)
    assert not flight.tracked.is_chosen
    assert flight.given[-1][2:6] == rolled(0.0)
    assert "no tracked attitude for 50 ms" in flight.words[-1]
    flight.runs(RETURN_S - 0.1, turned(0.5))
    assert not flight.tracked.is_chosen
    flight.runs(0.2, turned(0.5))
    assert flight.tracked.is_chosen
    assert flight.tracked.switches == 1


def test_poses_that_were_late_once_and_none_lost_are_taken_again() -> None:
    """A network that stands still for a moment: no two poses are further apart than ever."""
    flight = Flight().runs(3.0, turned(0.5))
    before_s = flight.now_s
    flight.runs(0.06, None)
    assert not flight.tracked.is_chosen
    for late in range(1, 7):  # what the network held back comes at once
        held_s = before_s - 0.015 + 0.01 * late
        flight.tracked.take(turned(0.5), held_s, attitude_sample(9, held_s, LEVEL))
    flight.runs(RETURN_S - 0.1, turned(0.5))
    assert not flight.tracked.is_chosen
    flight.runs(0.2, turned(0.5))
    assert flight.tracked.is_chosen
    assert flight.words[-1] == "attitude: the tracker's"


@pytest.mark.parametrize(("rad", "taken"), [(0.9 * TILT_RAD, True), (1.1 * TILT_RAD, False)])
def test_a_body_that_is_tilted_against_the_autopilot_s_vertical_is_refused(
    rad: float, taken: bool
) -> None:
    flight = Flight().runs(3.0, rolled(rad))
    assert flight.tracked.is_chosen is taken
    assert (flight.tracked.refused > 0) is not taken


def test_the_first_attitude_of_an_autopilot_is_enough_to_refuse_a_body_that_is_tilted() -> None:
    tracked = TrackedAttitude()
    reported = attitude_sample(1, 10.0, rolled(0.0))
    tracked.take(rolled(2.0 * TILT_RAD), 10.0, reported)
    assert (tracked.used, tracked.refused) == (0, 1)
    tracked.take(rolled(2.0 * TILT_RAD), 10.0, NO_ATTITUDE)  # nothing to compare with
    assert (tracked.used, tracked.refused) == (1, 1)


def test_a_marker_mistaken_in_flight_changes_the_source_at_once() -> None:
    flight = Flight().runs(3.0, turned(0.5)).runs(0.02, rolled(radians(40.0)))
    assert flight.given[-1][2:6] == rolled(0.0)
    assert flight.words[-1] == "the tracked attitude is 40 degrees off: not used"
    flight.runs(5.0, rolled(radians(40.0)))
    assert len(flight.words) == 2  # once


def test_a_heading_may_be_another_by_anything() -> None:
    """Among steel the autopilot's is the one that is wrong."""
    assert Flight().runs(3.0, turned(pi)).tracked.is_chosen


def test_without_an_autopilot_s_attitude_the_tracker_s_is_taken_at_once_without_rates() -> None:
    flight = Flight().runs(0.1, rolled(1.0), None)
    assert flight.tracked.is_chosen
    assert all(rate != rate for rate in flight.given[-1][6:9])


def test_old_poses_are_not_fresher_than_none() -> None:
    tracked = TrackedAttitude()
    reported = attitude_sample(1, 10.0, rolled(0.0))
    for i in range(400):
        now_s = 10.0 + 0.01 * i
        tracked.take(turned(0.5), now_s - FRESH_S - 0.01, reported)
        assert tracked.choose(now_s, reported)[2:6] == rolled(0.0)


def test_what_is_no_rotation_is_no_agreement() -> None:
    """The tick refuses it as it does the autopilot's; nothing is divided by its length."""
    Flight().runs(3.0, (0.0, 0.0, 0.0, 0.0))
    Flight().runs(3.0, (nan, 0.0, 0.0, 0.0))


def test_another_clock_forgets_what_was_timed_by_the_old_one() -> None:
    flight = Flight().runs(3.0, turned(0.5))
    flight.tracked.reset()
    reported = attitude_sample(9, 0.0, rolled(0.0))
    assert flight.tracked.choose(0.0, reported)[2:6] == rolled(0.0)


def test_a_pose_without_a_rotation_is_not_flown_with() -> None:
    flight = Flight().runs(3.0, turned(0.5)).runs(0.2, (0.0, 0.0, 0.0, 0.0))
    assert not flight.tracked.is_chosen
    assert flight.given[-1][2:6] == LEVEL


# --- each limit from both sides -----------------------------------------------------------------


def reported_at(time_s: float, attitude: Quaternion = LEVEL, sequence: int = 1) -> AttitudeSample:
    return attitude_sample(sequence, time_s, attitude, (0.1, 0.2, 0.3))


def steady(until_s: float = 12.5, pose: Quaternion = LEVEL) -> TrackedAttitude:
    """Poses each 10 ms from 10 s on, with an autopilot's attitude beside each."""
    tracked = TrackedAttitude()
    for i in range(round((until_s - 10.0) * 100.0) + 1):
        now_s = 10.0 + 0.01 * i
        tracked.take(pose, now_s, reported_at(now_s))
        tracked.choose(now_s, reported_at(now_s))
    return tracked


@pytest.mark.parametrize(("after_s", "chosen"), [(1.99, False), (2.0, True)])
def test_poses_are_taken_once_they_have_agreed_for_two_seconds(
    after_s: float, chosen: bool
) -> None:
    assert steady(10.0 + after_s + 1e-6).is_chosen == chosen


@pytest.mark.parametrize(("gap_s", "chosen"), [(0.049, True), (0.051, False)])
def test_a_gap_of_five_hundredths_between_poses_begins_the_two_seconds_again(
    gap_s: float, chosen: bool
) -> None:
    tracked = steady(11.97)
    tracked.take(LEVEL, 11.97 + gap_s, reported_at(12.0))
    tracked.take(LEVEL, 12.04, reported_at(12.0))
    tracked.choose(12.04, reported_at(12.04))
    assert tracked.is_chosen == chosen


@pytest.mark.parametrize(("age_s", "given"), [(0.049, True), (0.051, False)])
def test_a_pose_is_flown_with_until_it_is_five_hundredths_old(age_s: float, given: bool) -> None:
    tracked = steady(12.5, turned(0.5))
    sample = tracked.choose(12.5 + age_s, reported_at(12.5))
    assert (sample[2:6] == turned(0.5)) == given
    assert tracked.is_chosen == given
    assert tracked.switches == (0 if given else 1)
    if not given:  # and after that it has to be steady again
        tracked.take(turned(0.5), 12.56, reported_at(12.56))
        tracked.choose(12.56, reported_at(12.56))
        assert not tracked.is_chosen


@pytest.mark.parametrize(("apart_s", "compared"), [(0.049, True), (0.051, False)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_pose_is_compared_with_what_was_reported_within_five_hundredths(
    apart_s: float, compared: bool, sign: float
) -> None:
    tracked = TrackedAttitude()
    tracked.take(rolled(1.0), 10.0, reported_at(10.0 + sign * apart_s))
    assert (tracked.refused, tracked.used) == ((1, 0) if compared else (0, 1))


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0, 3.0])
def test_it_is_the_angle_of_the_verticals_that_is_compared(angle: float) -> None:
    """Nose and wing at once, from an attitude that is turned itself: 0.17 rad and no more."""
    for tilt, refused in ((0.169, 0), (0.171, 1), (-0.169, 0), (-0.171, 1)):
        for axis in ((1.0, 0.0), (0.0, 1.0), (0.6, 0.8)):
            s, c = sin(0.5 * tilt), cos(0.5 * tilt)
            # About a level axis: the vertical is off by all of it.
            tilted = times((c, axis[0] * s, axis[1] * s, 0.0), rolled(angle))
            pose, base = times(turned(0.9), tilted), times(turned(-0.4), rolled(angle))
            tracked = TrackedAttitude()
            tracked.take(pose, 10.0, reported_at(10.0, base))
            assert tracked.refused == refused


def times(a: Quaternion, b: Quaternion) -> Quaternion:
    """One rotation, and before it another."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def test_rounding_makes_no_angle() -> None:
    """The cosine between these, which differ in length alone, is 1 and the last bit."""
    w, x, y, z = 0.37, 0.94, 0.45, 0.06
    tracked = TrackedAttitude()
    tracked.take((w, x, y, z), 10.0, reported_at(10.0, (0.7 * w, 0.7 * x, 0.7 * y, 0.7 * z)))
    assert tracked.used == 1


def test_an_aircraft_on_its_back_is_half_a_turn_off() -> None:
    tracked = TrackedAttitude()
    tracked.take(LEVEL, 9.99, reported_at(9.99))
    tracked.choose(9.99, NO_ATTITUDE)
    assert tracked.is_chosen
    tracked.take(rolled(pi), 10.0, reported_at(10.0))
    assert tracked.notices[-1] == (4, "the tracked attitude is 180 degrees off: not used")
    assert (tracked.switches, tracked.is_chosen) == (1, False)


@pytest.mark.parametrize(("apart_s", "known"), [(0.099, True), (0.101, False)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rates_of_a_tenth_of_a_second_ago_go_with_a_pose(
    apart_s: float, known: bool, sign: float
) -> None:
    tracked = TrackedAttitude()
    tracked.take(turned(0.5), 10.0, reported_at(10.0 + sign * apart_s))
    rates = tracked.choose(10.0, NO_ATTITUDE)[6:9]
    assert (rates == (0.1, 0.2, 0.3)) == known
    assert known or all(rate != rate for rate in rates)


def test_a_pose_that_is_refused_is_forgotten_and_the_next_one_begins_again() -> None:
    tracked = steady(11.5)
    assert tracked.used == 151
    tracked.take(rolled(1.0), 11.51, reported_at(11.51))
    assert tracked.notices == []  # it was not in use: nothing is reported
    assert (tracked.refused, tracked.used, tracked.switches) == (1, 151, 0)
    # Before the autopilot has any, what is fresh is taken at once: this is none.
    assert tracked.choose(11.51, NO_ATTITUDE) is not None
    assert not tracked.is_chosen
    for i in range(100):
        now_s = 11.52 + 0.01 * i
        tracked.take(LEVEL, now_s, reported_at(now_s))
        tracked.choose(now_s, reported_at(now_s))
    assert not tracked.is_chosen
    assert tracked.used == 251


def test_what_is_reported_of_a_change_has_its_severity() -> None:
    tracked = steady(12.5)
    assert tracked.notices == [(6, "attitude: the tracker's")]
    tracked.choose(13.0, reported_at(13.0))
    assert tracked.notices[1:] == [
        (4, "no tracked attitude for 50 ms: the autopilot's is used"),
    ]


def test_samples_of_either_source_are_numbered_one_after_the_other() -> None:
    tracked = TrackedAttitude()
    assert tracked.choose(10.0, NO_ATTITUDE).sequence == 0
    one = reported_at(10.0, sequence=40)
    assert [tracked.choose(10.0, one).sequence for _ in range(3)] == [1, 1, 1]
    assert tracked.choose(10.01, reported_at(10.01, sequence=41)).sequence == 2
    tracked.reset()
    assert tracked.choose(10.02, reported_at(10.02, sequence=42)).sequence == 3
