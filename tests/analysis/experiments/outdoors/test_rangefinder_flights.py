"""The flights of `rangefinder`: what is wrong, in which world, and what is looked at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, inf, isnan, nan, radians, sin, sqrt
from random import Random
from typing import Any

import pytest
from scripted import Moment, ScriptedLoop, air_of_seeds

from tgl_soar.analysis.experiments.outdoors import rangefinder as ranges
from tgl_soar.analysis.experiments.outdoors.rangefinder import RangeFlight, RangeJob
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.control.supervisor import CAPTURING, FAILED, REASON_FENCE, RELEASED, SOARING
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.estimation.ground_range import RANGE_CORRECTS
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.sensors import AUTOPILOT_POSITION, DRIFTING_POSITION, LASER_RANGE, MEMS_IMU
from tgl_soar.types import Ground


def test_a_wrong_rangefinder_is_off_by_up_to_12_m_or_noisy_by_up_to_3() -> None:
    drawn = [parse_fault(ranges._drawn_fault(Random(f"x {seed}"))) for seed in range(400)]
    begins = [fault.start_s for fault in drawn]
    assert 16.0 <= min(begins) < 16.05
    assert 16.95 < max(begins) <= 17.0
    assert {fault["for"] for fault in drawn} == {20.0}
    off = [fault["away"] for fault in drawn if fault.way == "bias"]
    assert -12.0 <= min(off) < -11.0
    assert 11.0 < max(off) <= 12.0
    noise = [fault["sigma"] for fault in drawn if fault.way == "noise"]
    assert 0.3 <= min(noise) < 0.5
    assert 2.8 < max(noise) <= 3.0
    for way in ("freeze", "bias", "noise", "dropout"):  # each in turn by chance
        assert 60 < sum(fault.way == way for fault in drawn) < 140


@pytest.mark.parametrize("kind", ranges.KINDS)
def test_each_kind_has_its_position_and_its_rangefinder(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ranges, "available", lambda: False)
    ranged = kind in (ranges.RECEIVER_RANGED, ranges.HEIGHT_RANGED, ranges.WRONG)
    assert ranged == (kind in ranges.RANGED)
    loop = ranges._loop(RangeJob(kind, 3), ranged, (), 30.0)
    world, values = loop.world, loop.values
    plain = shipped_hill().on_line("a").values
    if kind == ranges.WRONG:
        assert world.sensors.position == AUTOPILOT_POSITION
        assert values["EST_FIX_SD"] == plain["EST_FIX_SD"]
    else:
        drift_m = 1.0 if "receiver" in kind else 0.0
        assert world.sensors.position == DRIFTING_POSITION._replace(drift_m=drift_m)
        assert world.sensors.position.drift_up_m == 2.0
        assert values["EST_FIX_SD"] == pytest.approx(0.02)
    assert world.sensors.imu == MEMS_IMU
    assert world.sensors.airspeed is None
    assert world.sensors.rangefinder == (LASER_RANGE if ranged else None)
    assert values["RNG_USE"] == (RANGE_CORRECTS if ranged else plain["RNG_USE"])
    assert plain["RNG_USE"] != RANGE_CORRECTS
    assert (values["TGL_X"], values["TGL_Z"]) == pytest.approx((-6.2, 14.2))
    assert 6.9 <= world.field.reference_wind_mps <= 7.4


def test_wind_and_gusts_are_the_seeds_and_fill_their_ranges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    winds, gusts = air_of_seeds(
        monkeypatch,
        ranges,
        lambda seed: ranges._loop(RangeJob(ranges.RECEIVER, seed), False, (), 30.0),
    )
    assert 6.9 <= min(winds) < 6.95
    assert 7.35 < max(winds) <= 7.4
    assert 0.0 < min(gusts) < 0.004
    assert 0.026 < max(gusts) <= 0.03


# --- what is looked at ----------------------------------------------------------------------------

ETA = radians(105.0)
VALUES = {"TGL_X": -6.0, "TGL_Z": 14.0, "TGL_LEAN": 15.0}
FLAT = Ground(2, (-50.0, 50.0, *[50.0] * 6), (0.0,) * 8)


def beside(off_m: float) -> Moment:
    """So far upstream of the line."""
    return Moment(x_m=-6.0 - sin(ETA) * off_m, z_m=14.0 + cos(ETA) * off_m)


def looked_at(
    monkeypatch: pytest.MonkeyPatch, kind: str, script: Callable[[float], Moment]
) -> tuple[Any, ScriptedLoop]:
    loop = ScriptedLoop(script, VALUES, FLAT)
    asked: list[float] = []

    def made(_job: RangeJob, _ranged: bool, _faults: Any, seconds: float) -> ScriptedLoop:
        asked.append(seconds)
        return loop

    monkeypatch.setattr(ranges, "_loop", made)
    found = ranges._fly(RangeJob(kind, 1), False, ())
    assert asked == [57.0 if kind == ranges.WRONG else 180.0]
    return found, loop


def test_e_rho_and_clearance_are_counted_from_the_sixteenth_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, loop = looked_at(monkeypatch, ranges.WRONG, lambda t: beside(0.01 * t))
    assert found.duration_s == pytest.approx(57.0)
    assert len(found.off_m) == 411
    assert found.off_m[0] == pytest.approx(0.16)
    assert found.off_m[-1] == pytest.approx(0.57)
    assert found.least_m == pytest.approx(14.0 + cos(ETA) * 0.57)
    assert (found.ended, found.captures) == ("", 0)
    assert loop.changes == []
    assert all(loop.engaged)


def test_a_height_is_wrong_by_fix_and_correction_less_what_it_was_before_the_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The line is moved by both axes of the estimate, with the rangefinder's correction."""

    def script(t: float) -> Moment:
        held = t <= 1.0
        return beside(0.0)._replace(
            fix_x_m=0.7,
            fix_z_m=-1.5 if held else -1.2,
            correction_m=1.0 if held else 0.9,
        )

    found, loop = looked_at(monkeypatch, ranges.RECEIVER, script)
    ((time_s, moved),) = loop.changes
    assert time_s == pytest.approx(1.0)
    assert moved == pytest.approx({"TGL_X": -6.0 + 0.7, "TGL_Z": 14.0 - 0.5})
    assert loop.engaged[:10] == [False] * 10
    assert all(loop.engaged[10:])
    assert found.height_off_m == pytest.approx([-0.3 + 0.5] * len(found.height_off_m))


def test_e_rho_is_to_the_line_where_the_lift_is_and_not_where_the_operator_put_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, _ = looked_at(
        monkeypatch, ranges.HEIGHT, lambda _t: beside(0.3)._replace(fix_x_m=1.0, fix_z_m=-2.0)
    )
    assert found.off_m == pytest.approx([0.3] * len(found.off_m))


def test_captures_ends_and_disengagements_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    captured = ((5.0, 6.0), (15.5, 16.5), (20.0, 21.0))

    def script(t: float) -> Moment:
        capturing = any(begin <= t < end for begin, end in captured)
        return beside(0.0)._replace(mode=CAPTURING if capturing else SOARING)

    assert looked_at(monkeypatch, ranges.WRONG, script)[0].captures == 1

    def hits(t: float) -> Moment:
        return beside(0.0)._replace(crashed="hit the hill at x 1.0, z 2.0 m" if t >= 30 else "")

    hit, _ = looked_at(monkeypatch, ranges.WRONG, hits)
    assert (hit.ended, hit.duration_s) == ("hit the hill", pytest.approx(30.0))
    assert len(hit.off_m) == 140
    for mode in (RELEASED, FAILED):

        def leaves(t: float, mode: int = mode) -> Moment:
            return beside(0.0)._replace(mode=mode if t >= 30 else SOARING, reason=REASON_FENCE)

        gone, _ = looked_at(monkeypatch, ranges.WRONG, leaves)
        assert gone.ended == f"disengaged: {REASON_TEXTS[REASON_FENCE]}"
        assert gone.duration_s == pytest.approx(30.0)


# --- what is reported of one ----------------------------------------------------------------------

FLOWN = ranges._RangedFlight(
    ended="", duration_s=57.0, captures=1, off_m=[0.1, -0.4, 0.2, 0.0], height_off_m=[3.0, -4.0],
    least_m=5.0,
)  # fmt: skip


def judge(monkeypatch: pytest.MonkeyPatch, kind: str, flights: Sequence[Any]) -> RangeFlight:
    asked: list[tuple[bool, int]] = []
    given = iter(flights)

    def fly(_job: RangeJob, ranged: bool, faults: Sequence[Any]) -> Any:
        asked.append((ranged, len(faults)))
        return next(given)

    monkeypatch.setattr(ranges, "_fly", fly)
    found = ranges.fly_range(RangeJob(kind, 4))
    if kind == ranges.WRONG:
        assert asked == [(True, 1), (False, 0)]
    else:
        assert asked == [(kind in ranges.RANGED, 0)]
    return found


def test_a_flight_tells_roots_of_mean_squares_and_the_largest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = judge(monkeypatch, ranges.HEIGHT_RANGED, [FLOWN])
    assert found.off_rms_m == pytest.approx(sqrt((0.01 + 0.16 + 0.04) / 4.0))
    assert found.off_m == 0.4
    assert found.within == 0.75
    assert found.height_rms_m == pytest.approx(sqrt(12.5))
    assert (found.least_m, found.captures, found.duration_s) == (5.0, 1, 57.0)
    assert (found.fault, found.seed, found.kind) == ("", 4, ranges.HEIGHT_RANGED)
    assert isnan(found.apart_m)
    assert not found.gone


def test_a_wrong_rangefinder_is_compared_with_none_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    without = FLOWN._replace(off_m=[0.1, -0.1, 0.3])
    found = judge(monkeypatch, ranges.WRONG, [FLOWN, without])
    assert found.apart_m == pytest.approx(0.3)
    assert found.fault.startswith("rangefinder.")
    for pair in (
        [FLOWN._replace(ended="hit the hill"), without],
        [FLOWN, without._replace(ended="hit the hill")],
    ):
        assert judge(monkeypatch, ranges.WRONG, pair).apart_m == inf


def test_of_a_flight_without_a_tick_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    short = FLOWN._replace(off_m=[], height_off_m=[], least_m=nan, ended="disengaged: x")
    found = judge(monkeypatch, ranges.RECEIVER, [short])
    assert isnan(found.off_m)
    assert isnan(found.off_rms_m)
    assert isnan(found.height_rms_m)
    assert found.within == 0.0
    assert found.gone
