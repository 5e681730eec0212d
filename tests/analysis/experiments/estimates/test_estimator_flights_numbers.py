"""The flights of the experiment on accelerometers: their sensors, what of a flight is scored, and
how flights are compared, each figure computed by hand."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import isnan, nan, sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer

from tgl_soar.analysis.experiments.estimates import estimator_flights
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    ASKED,
    CALM,
    CHAIN,
    FLIGHT_S,
    IMU,
    LAB,
    PLAIN,
    TRACKED_ATTITUDE,
    TURBULENCE,
    EstimatorFlight,
    Ratios,
    Scored,
    WatchedFlight,
    _scored,
    _ticks,
    _values,
    _world,
    fly_each,
    fly_named,
    fly_scored,
    fly_scored_compiled,
    gains_exchanged,
    in_gap,
    known,
    paired_difference,
    paired_ratios,
    places,
    score,
    watch,
)
from tgl_soar.config.files import load_site, shipped
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.sensors import MEMS_IMU

# --- what is flown with -------------------------------------------------------------------------


def test_a_flight_is_half_a_minute_at_three_per_cent_unless_something_else_is_asked() -> None:
    flight = EstimatorFlight(line="a", seed=1, sensors=PLAIN)
    assert (flight.turbulence, flight.duration_s, flight.scale) == (0.03, 30.0, 1.0)
    assert (flight.reception, flight.changes, flight.tracked) == ("all", (), None)
    assert not flight.dispersed
    assert (TURBULENCE, CALM, FLIGHT_S, CHAIN) == (0.03, 0.01, 30.0, 4)
    assert places() == ("a", "b", "c")


def test_the_laws_differ_by_their_accelerometers_alone() -> None:
    assert PLAIN.imu is None
    assert IMU.imu == MEMS_IMU
    assert IMU._replace(imu=None) == PLAIN


@pytest.mark.parametrize(
    ("name", "rate_hz", "delay_s", "noise_m", "position_mm", "velocity_mmps"),
    [
        ("100 Hz, 15 ms, 1 mm", 100.0, 0.015, 0.001, 3.0, 30.0),
        ("28.6 Hz, 60 ms, 5 mm", 200.0 / 7.0, 0.060, 0.005, 15.0, 80.0),
    ],
)
def test_what_is_asked_is_asked_of_the_fixes_that_its_name_says(
    name: str,
    rate_hz: float,
    delay_s: float,
    noise_m: float,
    position_mm: float,
    velocity_mmps: float,
) -> None:
    """3 mm are a tenth of the 3 cm within which a line is held, 15 mm half of them; 3 mm in a tenth
    of a second are 30 mm/s."""
    assert len(ASKED) == 2
    asked = ASKED[name]
    assert (asked.position_mm, asked.velocity_mmps) == (position_mm, velocity_mmps)
    position, imu = asked.sensors.position, asked.sensors.imu
    assert (position.rate_hz, position.delay_s, position.noise_m) == (rate_hz, delay_s, noise_m)
    assert (position.bias_m, position.velocity_noise_mps) == (0.0, 0.0)
    assert not position.gives_velocity
    assert imu is not None
    assert (imu.rate_hz, imu.delay_s) == (200.0, 0.0)
    assert (imu.force_noise_mps2, imu.force_bias_mps2) == (0.2, 0.05)
    assert (imu.rate_noise_radps, imu.rate_bias_radps) == (0.01, 0.002)


def test_the_laboratorys_fixes_are_thirty_a_second_and_late() -> None:
    assert LAB.rate_hz == pytest.approx(28.57, abs=0.01)
    assert 200.0 / LAB.rate_hz == pytest.approx(7.0)  # a whole number of the simulation's steps
    assert (LAB.delay_s, LAB.noise_m, LAB.bias_m) == (0.060, 0.001, 0.0)
    assert (LAB.velocity_noise_mps, LAB.gives_velocity) == (0.0, False)


def test_a_tracked_body_turns_by_the_cameras_noise_over_its_arm() -> None:
    body = TRACKED_ATTITUDE
    assert (body.rate_hz, body.delay_s) == (100.0, 0.015)
    assert body.noise_rad == pytest.approx(0.0005 / 0.2)
    assert body.bias_rad == pytest.approx(np.radians(0.3), rel=0.05)
    assert (body.rate_noise_radps, body.rate_bias_radps) == (0.0, 0.0)


def test_a_flight_begins_downstream_of_its_line_in_its_turbulence() -> None:
    site = load_site(shipped("sites/tunnel.toml"))
    for name, line in site.lines.items():
        world = _world(EstimatorFlight(line=name, seed=1, sensors=PLAIN))
        assert world.truth.x_m == pytest.approx(line.x_m + 0.3)
        assert world.truth.z_m == pytest.approx(line.z_m)

    def gust(turbulence: float, seed: int = 1) -> float:
        flight = EstimatorFlight(line="a", seed=seed, sensors=PLAIN, turbulence=turbulence)
        return _world(flight).truth.wind_x_mps - calm_mps

    calm_mps = 0.0
    calm_mps = gust(0.0)
    assert gust(0.04) == pytest.approx(2.0 * gust(0.02), rel=1e-6) != 0.0
    assert gust(0.02, seed=2) != gust(0.02)


def test_gains_are_scaled_and_changes_stand_before_all_else() -> None:
    flight = EstimatorFlight(line="b", seed=1, sensors=PLAIN)
    usual = _values(flight)
    scaled = _values(flight._replace(scale=0.5))
    for name in ("RHO_P", "RHO_I", "RHO_D", "RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU"):
        assert scaled[name] == pytest.approx(0.5 * usual[name])
        assert usual[name] != 0.0
    assert scaled["ELE_P"] == usual["ELE_P"]
    assert (usual["TGL_X"], usual["TGL_Z"]) == pytest.approx((0.60, 1.60))
    changed = _values(flight._replace(scale=0.5, changes=(("RHO_P", 0.07), ("ELE_P", 0.9))))
    assert (changed["RHO_P"], changed["ELE_P"]) == pytest.approx((0.07, 0.9))


def test_laws_exchange_every_gain_that_they_have_of_their_own() -> None:
    values = _values(EstimatorFlight(line="a", seed=1, sensors=PLAIN))
    pairs = {
        "RHO_P": "RHO_P_IMU",
        "RHO_I": "RHO_I_IMU",
        "RHO_D": "RHO_D_IMU",
        "RHO_D_FILT": "RHO_DF_IMU",
        "ELE_P": "ELE_P_IMU",
        "ELE_I": "ELE_I_IMU",
        "ELE_D": "ELE_D_IMU",
    }
    assert dict(gains_exchanged(True)) == {imu: values[plain] for plain, imu in pairs.items()}
    assert dict(gains_exchanged(False)) == {plain: values[imu] for plain, imu in pairs.items()}


# --- gaps ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reception", "time_s", "is_in"),
    [
        ("with one gap", 13.999, False),
        ("with one gap", 14.0, True),
        ("with one gap", 15.499, True),
        ("with one gap", 15.5, False),
        ("with one gap", 6.0, False),
        ("with gaps", 0.0, False),
        ("with gaps", 5.999, False),
        ("with gaps", 6.0, True),
        ("with gaps", 7.499, True),
        ("with gaps", 7.5, False),
        ("with gaps", 11.999, False),
        ("with gaps", 12.0, True),
        ("with gaps", 14.0, False),
        ("all", 6.0, False),
        ("the laboratory's", 14.0, False),
    ],
)
def test_a_gap_lasts_a_second_and_a_half_from_its_beginning_on(
    reception: estimator_flights.Reception, time_s: float, is_in: bool
) -> None:
    assert in_gap(reception, time_s) is is_in


def test_in_a_gap_the_fix_before_it_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator_flights, "ONE_GAP_S", 0.2)
    monkeypatch.setattr(estimator_flights, "GAP_S", 0.1)
    flight = EstimatorFlight(line="a", seed=1, sensors=PLAIN, duration_s=0.4)
    last: dict[bool, float] = {}
    for gap in (True, False):
        each = flight._replace(reception="with one gap" if gap else "all")
        ticks = list(_ticks(each))
        assert len(ticks) == 80  # of 200 a second
        fixes = {tick.inputs.position.sequence for tick in ticks if 0.2 <= tick.inputs.time_s < 0.3}
        assert (len(fixes) == 1) is gap
        last[gap] = ticks[-1].inputs.position.time_s
    assert last[True] == last[False]
    first = next(_ticks(flight))
    assert first.inputs.engage
    assert first.inputs.autopilot.armed
    assert first.inputs.autopilot.accepts_surfaces
    assert first.inputs.imu is None or first.inputs.imu.sequence == 0


def test_the_laboratory_stamps_a_fix_when_it_arrives() -> None:
    """60 ms after it was measured, which is no fix's age any more."""
    flight = EstimatorFlight(line="a", seed=1, sensors=PLAIN._replace(position=LAB), duration_s=0.4)
    ages = {}
    for reception in ("all", "the laboratory's"):
        each = flight._replace(reception=reception)
        fresh = [t.inputs for t in _ticks(each) if t.inputs.position.sequence > 0]
        ages[reception] = min(i.time_s - i.position.time_s for i in fresh)
    assert ages["all"] == pytest.approx(0.060, abs=0.006)
    assert ages["the laboratory's"] == pytest.approx(0.0, abs=0.006)


def test_a_flight_ends_with_what_ended_it(monkeypatch: pytest.MonkeyPatch) -> None:
    wild = EstimatorFlight(line="a", seed=1, sensors=PLAIN, duration_s=8.0, turbulence=1.0)
    ticks = list(_ticks(wild))
    assert len(ticks) < 1600
    assert ticks[-1].ended
    assert not any(tick.ended for tick in ticks[:-1])
    off = ticks[-1].output.mode in (RELEASED, FAILED)
    assert ticks[-1].ended.startswith("disengaged: ") is off
    # Nothing of it is scored: it ended before all was settled.
    monkeypatch.setattr(estimator_flights, "_ticks", lambda _: iter(ticks))
    lost = fly_scored(wild)
    assert lost.ended == ticks[-1].ended
    assert lost.duration_s == ticks[-1].truth.time_s
    assert isnan(lost.e_rho_m2)
    assert isnan(lost.y_m2)


# --- what is scored -----------------------------------------------------------------------------


def trajectory(until_s: float = 20.0) -> Trajectory:
    """Wild before eight seconds and while the line moves, from 12 to 13 s; else 2 cm off, 30 cm
    aside, banked by a tenth, an elevator that goes by two throws a second."""
    time = np.arange(0.0, until_s, 0.02)
    wild = (time <= 8.001) | ((time > 12.0) & (time < 13.0))
    sign = np.where(np.arange(len(time)) % 2 == 0, 1.0, -1.0)
    columns = {
        "time_s": time,
        "line_moving": ((time > 12.0) & (time < 13.0)).astype(float),
        "e_rho_m": np.where(wild, 0.5, 0.02 * sign),
        "elevator": np.where(wild, 7.0, 0.02 * sign),
        "y_m": np.where(wild, 3.0, -0.3),
        "roll_rad": np.where(wild, 1.0, 0.1 * sign),
    }
    return Trajectory(columns, "hit the board", len(time))


def test_what_is_scored_is_flown_after_eight_seconds_on_a_line_that_stands_still() -> None:
    found = _scored(trajectory())
    assert found.e_rho_m2 == pytest.approx(0.02**2)
    assert found.y_m2 == pytest.approx(0.3**2)
    assert found.bank_rad2 == pytest.approx(0.1**2)
    # From +0.02 to −0.02 in 20 ms; once, over the line's second, in another time.
    assert found.activity_2ps2 == pytest.approx(2.0**2, rel=0.005)
    assert found.duration_s == pytest.approx(19.98)
    assert found.ended == "hit the board"


@pytest.mark.parametrize(("rows", "scored"), [(1, False), (2, True)])
def test_a_flight_is_scored_from_two_ticks_on(rows: int, scored: bool) -> None:
    found = _scored(trajectory(8.0 + 0.02 * rows + 0.01))
    assert isnan(found.e_rho_m2) is not scored
    assert isnan(found.activity_2ps2) is not scored
    assert isnan(found.bank_rad2) is not scored


def made_up_ticks(until_s: float, moving_s: float, idle_s: float) -> Iterator[Any]:
    """Ticks 4 cm across a line that leans by 30°: its direction is 120° from downstream."""
    line = SimpleNamespace(x_m=0.2, z_m=1.0, eta_rad=np.radians(120.0))
    across = np.radians(210.0)
    for time_s in np.arange(0.0, until_s, 0.05).tolist():
        wild = moving_s <= time_s < moving_s + 1.0 or idle_s <= time_s < idle_s + 1.0
        off_m = 1.0 if wild else 0.04
        truth = SimpleNamespace(
            time_s=time_s,
            x_m=0.2 + off_m * np.cos(across),
            z_m=1.0 + off_m * np.sin(across),
            y_m=0.2,
            roll_rad=-0.05,
        )
        here = SimpleNamespace(
            **vars(line), moving=moving_s <= time_s < moving_s + 1.0
        )  # fmt: skip
        output = SimpleNamespace(
            line=here,
            active=not idle_s <= time_s < idle_s + 1.0,
            command=SimpleNamespace(elevator=0.1 * time_s),
        )
        yield SimpleNamespace(truth=truth, output=output, ended="")


def test_a_plain_flight_is_scored_where_line_and_module_are_settled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(estimator_flights, "_ticks", lambda _: made_up_ticks(20.0, 10.0, 14.0))
    found = fly_scored(EstimatorFlight(line="a", seed=1, sensors=PLAIN))
    assert found.e_rho_m2 == pytest.approx(0.04**2)
    assert found.y_m2 == pytest.approx(0.2**2)
    assert found.bank_rad2 == pytest.approx(0.05**2)
    assert found.activity_2ps2 == pytest.approx(0.1**2)
    assert found.duration_s == pytest.approx(19.95)
    assert found.ended == ""


def test_a_compiled_flight_is_of_its_own_seed_gains_and_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The world is prepared once for all flights that differ by these."""
    worlds: list[Any] = []
    flown: list[tuple[Any, ...]] = []

    def prepare(world: Any, duration_s: float) -> str:
        worlds.append((world, duration_s))
        return f"prepared {len(worlds)}"

    def fly(*given: Any) -> Trajectory:
        flown.append(given)
        return trajectory()

    uncached = cache(estimator_flights._prepared.__wrapped__)
    monkeypatch.setattr(estimator_flights, "_prepared", uncached)
    monkeypatch.setattr(estimator_flights, "prepare", prepare)
    monkeypatch.setattr(estimator_flights, "fly_compiled", fly)
    flight = EstimatorFlight(line="c", seed=7, sensors=IMU, duration_s=11.5)
    others = [flight._replace(seed=8, scale=0.5), flight._replace(changes=(("ELE_P", 0.9),))]
    for each in (flight, *others):
        assert fly_scored_compiled(each).e_rho_m2 == pytest.approx(0.02**2)
    assert [each[:2] for each in flown] == [("prepared 1", seed) for seed in (7, 8, 7)]
    assert flown[1][2]["RHO_P"] == pytest.approx(0.5 * flown[0][2]["RHO_P"])
    assert flown[2][2]["ELE_P"] == pytest.approx(0.9)
    assert [(duration_s) for _, duration_s in worlds] == [11.5]
    for seed in (7, 8):
        fly_scored_compiled(flight._replace(dispersed=True, seed=seed))
    assert [each[0] for each in flown[3:]] == ["prepared 2", "prepared 3"]
    assert worlds[1][0].model != worlds[2][0].model


# --- comparisons --------------------------------------------------------------------------------


def one(e_rho_m: float, ended: str = "", **more: Any) -> Scored:
    usual = Scored(
        duration_s=30.0,
        ended=ended,
        e_rho_m2=e_rho_m**2,
        activity_2ps2=1.0,
        y_m2=0.01,
        bank_rad2=0.0004,
    )
    return usual._replace(**more)


def test_a_score_is_the_root_of_the_mean_of_squares_and_counts_what_ended() -> None:
    flown = [
        one(0.03, activity_2ps2=4.0, y_m2=0.04, bank_rad2=0.01),
        one(0.01, "hit the board", activity_2ps2=12.0, y_m2=0.14, bank_rad2=0.07),
    ]
    found = score(flown)
    assert (found.flights, found.lost) == (2, 1)
    assert found.e_rho_m == pytest.approx(sqrt(0.0005))
    assert found.activity_ps == pytest.approx(sqrt(8.0))
    assert found.y_m == pytest.approx(0.3)
    assert found.bank_rad == pytest.approx(0.2)
    nothing = score([one(nan, "hit the board", activity_2ps2=nan, y_m2=nan, bank_rad2=nan)])
    assert (nothing.flights, nothing.lost) == (1, 1)
    assert all(isnan(each) for each in nothing[2:])


def test_ratios_are_of_the_first_to_the_second_and_say_what_they_leave_out() -> None:
    found = paired_ratios(
        [one(0.01, activity_2ps2=9.0)] * 2, [one(0.04, activity_2ps2=1.0), one(nan)]
    )
    assert found[:2] == pytest.approx((0.25, 3.0))
    assert found.left_out == 1
    assert found.words == ", without 1 pairs not scored"
    assert Ratios(1.0, 1.0).words == ""


def wilson_bounds(k: int, n: int) -> tuple[float, float]:
    """The two roots p of (k/n − p)² = z² p (1 − p) / n."""
    z2, fraction = 1.959964**2, k / n
    low, high = sorted(np.roots([1.0 + z2 / n, -2.0 * fraction - z2 / n, fraction**2]).real)
    return float(low), float(high)


@pytest.mark.parametrize(
    ("cells", "phi"),
    [
        ((30, 2, 5, 13), (30 * 13 - 2 * 5 - 25.0)),  # more alike than chance, less n/2
        ((20, 10, 5, 5), (20 * 5 - 10 * 5 - 20.0)),
        ((20, 10, 9, 5), 0.0),  # 10 more than chance: n/2 is more than that
        ((10, 12, 15, 3), (10 * 3 - 12 * 15)),  # less alike: no correction
        ((0, 4, 6, 0), -24.0),
        ((50, 0, 0, 0), 0.0),
        ((40, 0, 3, 0), 0.0),
    ],
)
def test_the_paired_interval_is_newcombes(cells: tuple[int, int, int, int], phi: float) -> None:
    """Method 10: of a + b and a + c of n, correlated by φ."""
    a, b, c, d = cells
    n = sum(cells)
    first, second = wilson_bounds(a + b, n), wilson_bounds(a + c, n)
    root = sqrt((a + b) * (c + d) * (a + c) * (b + d))
    correlation = phi / root if root else 0.0
    below = ((a + c) / n - second[0], first[1] - (a + b) / n)
    above = (second[1] - (a + c) / n, (a + b) / n - first[0])

    def length(x: float, y: float) -> float:
        """Of the difference of two vectors with an angle whose cosine is the correlation."""
        return sqrt((x - correlation * y) ** 2 + (1.0 - correlation**2) * y**2)

    difference = (c - b) / n
    expected = (difference - length(*below), difference + length(*above))
    assert paired_difference(*cells) == pytest.approx(expected, abs=1e-9)


# --- watched ------------------------------------------------------------------------------------


def test_a_watched_flight_holds_two_estimates_beside_the_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(estimator_flights, "SETTLE_S", 0.5)
    flight = EstimatorFlight(line="b", seed=2, sensors=IMU, duration_s=1.0, turbulence=0.01)
    watched, flown = watch(flight), [tick.truth for tick in _ticks(flight)]
    assert watched.flight == flight
    assert watched.ended == ""
    assert watched.duration_s == pytest.approx(0.995)
    after = [truth for truth in flown if truth.time_s > 0.5]
    np.testing.assert_array_equal(watched.time_s, [truth.time_s for truth in after])
    columns = ("x_m", "y_m", "z_m", "velocity_x_mps", "velocity_y_mps", "climb_mps")
    for column, name in enumerate(columns):
        np.testing.assert_array_equal(
            watched.truth[:, column], [getattr(truth, name) for truth in after]
        )
    for imu in (True, False):
        error = watched.read[imu][:, :6] - watched.truth
        assert np.max(np.abs(error[:, :3])) < 0.05
        assert np.max(np.abs(error[:, 3:])) < 0.5
        assert np.all((watched.read[imu][:, 6:] > 0.0) & (watched.read[imu][:, 6:] < 1.0))
        assert watched.read[imu].shape == (len(after), 8)
    assert np.mean(np.abs(watched.read[True] - watched.read[False])) > 1e-4


def test_what_is_known_is_of_all_flights_and_of_one_of_the_two_estimators() -> None:
    def one_watched(error_m: float, error_mps: float, sigma_m: float) -> WatchedFlight:
        truth = np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], (4, 1))
        read = np.column_stack([truth, np.full((4, 1), sigma_m), np.full((4, 1), 0.1)])
        read[:, 1] -= error_m
        read[:, 5] += error_mps
        return WatchedFlight(
            flight=EstimatorFlight(line="a", seed=1, sensors=IMU),
            duration_s=1.0,
            ended="",
            time_s=np.zeros(4),
            truth=truth,
            read={False: read, True: np.column_stack([truth, np.ones((4, 2))])},
        )

    found = known([one_watched(0.03, 0.3, 0.01), one_watched(0.01, 0.1, 0.02)], False)
    assert found.position_mm == pytest.approx(1e3 * sqrt(0.0005))
    assert found.velocity_mmps == pytest.approx(1e3 * sqrt(0.05))
    assert found.position_normalised == pytest.approx((9.0 + 0.25) / 2.0 / 3.0)
    assert found.velocity_normalised == pytest.approx((9.0 + 1.0) / 2.0 / 3.0)
    assert known([one_watched(0.03, 0.3, 0.01)], True)[:2] == (0.0, 0.0)


# --- many flights -------------------------------------------------------------------------------


def test_flights_are_given_back_under_their_names() -> None:
    def seeds(*found: int) -> list[EstimatorFlight]:
        return [EstimatorFlight(line="a", seed=seed, sensors=PLAIN) for seed in found]

    flyer = ScriptedFlyer(lambda job: one(0.0, duration_s=float(job.seed)))
    found = fly_each(flyer, fly_scored, {"one": seeds(3, 1), "none": [], "two": seeds(2)})
    assert {name: [each.duration_s for each in flown] for name, flown in found.items()} == {
        "one": [3.0, 1.0],
        "none": [],
        "two": [2.0],
    }


@pytest.mark.parametrize(
    ("flights", "there", "compiled"), [(200, True, True), (199, True, False), (200, False, False)]
)
def test_from_two_hundred_flights_on_they_are_compiled_but_for_those_with_corrupted_fixes(
    monkeypatch: pytest.MonkeyPatch, flights: int, there: bool, compiled: bool
) -> None:
    monkeypatch.setattr(estimator_flights, "available", lambda: there)
    flight = EstimatorFlight(line="a", seed=1, sensors=PLAIN)
    simple = [flight._replace(seed=seed) for seed in range(flights)]
    flyer = ScriptedFlyer(lambda job: one(0.0, duration_s=float(job.seed)))
    gaps = [flight._replace(seed=900, reception="with gaps")]
    found = fly_named(flyer, {"gaps": gaps}, {"many": simple[:-1], "last": simple[-1:]})
    assert flyer.by == (["fly_scored", "fly_scored_compiled"] if compiled else ["fly_scored"])
    assert [each.duration_s for each in found["gaps"]] == [900.0]
    assert [each.duration_s for each in found["many"]] == [float(s) for s in range(flights - 1)]
    assert [each.duration_s for each in found["last"]] == [float(flights - 1)]
