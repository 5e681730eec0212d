"""The angle of attack as it is read: which wings are flown, each range and claim at its edge."""

from __future__ import annotations

from functools import cache
from math import isnan, nan, sqrt

import numpy as np
import pytest
from by_hand import ScriptedFlyer, flight, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates.incidence import (
    _claims,
    angles,
    bands,
    fraction_beyond,
    incidence,
)
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import prepare

EDGES = (0.0, 4.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0)


def test_there_is_a_range_between_each_two_edges_and_none_outside() -> None:
    true = np.repeat([-0.1, *EDGES], 50)  # an edge belongs to what is above it
    found = bands(true, true, 12.6)
    assert [(each.low_deg, each.high_deg) for each in found] == [
        (0.0, 4.0), (4.0, 8.0), (8.0, 10.0), (10.0, 12.0), (12.0, 14.0), (14.0, 16.0),
        (16.0, 18.0), (18.0, 20.0), (20.0, 22.0), (22.0, 25.0),
    ]  # fmt: skip
    assert {each.fraction for each in found} == {50 / 600}
    assert [each.beyond for each in found] == [0.0] * 5 + [1.0] * 5  # of 12 and of 14 degrees


@pytest.mark.parametrize(("rows", "reported"), [(49, 0), (50, 1)])
def test_a_second_of_flight_is_enough(rows: int, reported: int) -> None:
    assert len(bands(np.full(rows, 5.0), np.full(rows, 5.0), 12.6)) == reported


def test_a_range_of_which_nothing_was_read_is_not_reported() -> None:
    true = np.full(100, 5.0)
    read = np.full(100, nan)
    assert bands(true, read, 12.6) == []
    read[0] = 6.0
    (one,) = bands(true, read, 12.6)
    assert (one.mean_deg, one.deviation_deg) == pytest.approx((1.0, 0.0))
    assert one.unknown == pytest.approx(0.99)


def test_errors_have_a_mean_and_a_deviation_and_part_of_them_is_beyond() -> None:
    true = np.full(100, 13.0)
    read = np.array([12.0] * 50 + [15.0] * 25 + [nan] * 25)
    (one,) = bands(true, read, 12.6)
    assert one.mean_deg == pytest.approx((-1.0 * 50 + 2.0 * 25) / 75)
    assert one.deviation_deg == pytest.approx(sqrt(2.0))
    assert one.beyond == pytest.approx(0.25)
    assert one.unknown == pytest.approx(0.25)


def test_the_fraction_beyond_is_of_the_time_between_and_of_none_there_is_none() -> None:
    true, read = np.array([5.0, 9.0, 10.0, 11.0]), np.array([20.0, 12.6, 12.7, nan])
    assert fraction_beyond(true, read, 12.6, (9.0, 11.0)) == pytest.approx(0.5)
    assert fraction_beyond(true, read, 12.6, (9.0, 11.1)) == pytest.approx(1.0 / 3.0)
    assert isnan(fraction_beyond(true, read, 12.6, (12.0, 14.0)))


def test_angles_are_of_all_flights_from_two_seconds_on() -> None:
    def one(alpha_deg: float) -> FlownScenario:
        time = np.array([0.0, 1.99, 2.0, 3.0])
        alpha = np.radians([50.0, 50.0, alpha_deg, alpha_deg])
        return flight(path={"time_s": time, "alpha_rad": alpha, "air_alpha_rad": alpha + 0.01})

    true, read = angles([one(3.0), one(7.0)])
    assert true == pytest.approx([3.0, 3.0, 7.0, 7.0])
    assert read - true == pytest.approx(np.degrees([0.01] * 4))


# --- claims -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("true_deg", "is_deep"), [(15.99, False), (16.0, True), (24.99, True), (25.0, False)]
)
def test_a_deep_stall_is_from_sixteen_degrees_to_25(true_deg: float, is_deep: bool) -> None:
    true = np.array([true_deg] * 5 + [20.0] * 5)
    read = np.array([10.0] * 5 + [14.0] * 5)  # of that angle none is detected
    deep, _ = _claims({"a wing": (true, read)}, 12.6)
    assert deep.holds is not is_deep
    assert deep.measured == ("50 %" if is_deep else "100 %")


@pytest.mark.parametrize(("shown", "holds"), [(8, True), (7, False)])
def test_most_of_each_stall_is_seen(shown: int, holds: bool) -> None:
    true = np.array([18.0] * 10)
    deep, _ = _claims({"w": (true, np.array([14.0] * shown + [9.0] * (10 - shown)))}, 12.6)
    assert deep.holds is holds
    never, _ = _claims({"w": (np.full(9, 5.0), np.full(9, 5.0))}, 12.6)
    assert not never.holds
    assert never.measured == "never flown"


@pytest.mark.parametrize(
    ("true_deg", "invented", "holds"),
    [(9.59, 1, True), (9.59, 2, False), (9.6, 2, True), (0.0, 2, False), (-0.1, 2, True)],
)
def test_an_attached_wing_is_read_beyond_the_limit_in_a_hundredth_of_the_time(
    true_deg: float, invented: int, holds: bool
) -> None:
    true = np.array([true_deg] * invented + [5.0] * (100 - invented))
    read = np.where(true == true_deg, 14.0, 5.0)
    _, attached = _claims({"w": (true, read)}, 12.6)
    assert attached.holds is holds


# --- the whole ----------------------------------------------------------------------------------


def flown(job: ScenarioJob) -> FlownScenario:
    """A minute at 6 degrees and ten seconds at 17, read a degree high; with another wing low."""
    time = np.arange(0.0, 70.0, 0.02)
    alpha = np.where(time < 60.0, 6.0, 17.0)
    error = 1.0 if not job.aircraft else -6.0
    return flight(
        seed=job.seed,
        path={
            "time_s": time,
            "alpha_rad": np.radians(alpha),
            "air_alpha_rad": np.radians(alpha + error),
        },
    )


@cache
def concluded() -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(flown)
    return incidence(Context(flyer=flyer)), flyer.jobs


def test_each_wing_is_flown_at_each_place_with_accelerometers_and_no_pitot() -> None:
    jobs = concluded()[1]
    model = prepare(jobs[0].scenario).airframe.model
    wings = [
        (),
        (("model.stall_alpha_rad", 0.87), ("model.CL_alpha", 0.95)),
        (("model.stall_alpha_rad", 1.13), ("model.CL_alpha", 1.05)),
    ]
    flights = [(wing, place, seed) for wing in wings for place in "abc" for seed in range(1, 17)]
    assert len(jobs) == len(flights)
    for job, (wing, place, seed) in zip(jobs, flights, strict=True):
        assert (job.scenario.first_line, job.seed) == (place, seed)
        factors = [(key, value / model[key.split(".")[1]]) for key, value in job.aircraft]
        assert [key for key, _ in factors] == [key for key, _ in wing]
        assert [f for _, f in factors] == pytest.approx([f for _, f in wing])
        assert job.scenario.sensors.imu
        assert not job.scenario.sensors.pitot
        assert job.scenario.turbulence is not None
        assert job.scenario.turbulence.intensity == 0.05


def test_each_wing_has_its_ranges_and_its_claims() -> None:
    result = concluded()[0]
    wings = ["as the file", "stall 1.5° earlier, lift − 5 %", "stall 1.5° later, lift + 5 %"]
    (table,) = result.tables
    fraction = (f"{100 * 58 / 68:.2f}", f"{100 * 10 / 68:.2f}")
    assert table.rows[0] == (wings[0], "4 to 8", fraction[0], "+1.0", "0.0", "0", "0")
    assert table.rows[1] == (wings[0], "16 to 18", fraction[1], "+1.0", "0.0", "100", "0")
    assert table.rows[3] == (wings[1], "16 to 18", fraction[1], "-6.0", "0.0", "0", "0")
    assert [row[0] for row in table.rows] == [wing for wing in wings for _ in range(2)]
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert signs(result.claims) == "✓✓✗✓✗✓"
    for wing, pair in zip(
        wings, (result.claims[:2], result.claims[2:4], result.claims[4:]), strict=True
    ):
        assert all(claim.text.endswith(f"({wing})") for claim in pair)
    assert result.claims[0].measured == "100 %"
    assert list(result.numbers) == wings
    assert result.seeds == tuple(range(1, 17))
