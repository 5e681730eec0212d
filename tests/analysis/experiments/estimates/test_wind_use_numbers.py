"""What the laws may make of the wind they read: what is flown, how uses are compared, and the claim
on both sides of its bound."""

from __future__ import annotations

from functools import cache
from math import degrees
from typing import Any

import pytest
from by_hand import ScriptedFlyer, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    EstimatorFlight,
    Ratios,
    Scored,
)
from tgl_soar.analysis.experiments.estimates.wind_use import Compared, wind_use, worth_claim
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors

USES: dict[str, tuple[tuple[str, float], ...]] = {
    "neither": (),
    "`WIND_FF` 0.3": (("WIND_FF", 0.3),),
    "`WIND_FF` 0.7": (("WIND_FF", 0.7),),
    "`WIND_TRIM` 1": (("WIND_TRIM", 1.0),),
    "`WIND_TRIM` 1, `WIND_TRIM_T` 0.5": (("WIND_TRIM", 1.0), ("WIND_TRIM_T", 0.5)),
}


def flown(flight: EstimatorFlight) -> Scored:
    """A tenth more e_rho and half more activity for each change; in 5 % the last place loses one
    of its seeds."""
    more = 1.0 + 0.1 * len(flight.changes)
    lost = (flight.turbulence, flight.line, flight.seed) == (0.05, "c", 11) and flight.changes
    return Scored(
        duration_s=30.0,
        ended="hit the board" if lost else "",
        e_rho_m2=(0.010 * more) ** 2,
        activity_2ps2=(1.0 + 0.5 * len(flight.changes)) ** 2,
        y_m2=0.2**2,
        bank_rad2=0.05**2,
    )


def concluded(**options: Any) -> tuple[Result, list[EstimatorFlight]]:
    flyer = ScriptedFlyer(flown)
    return wind_use(Context(flyer=flyer, compiled_from=10_000, **options)), flyer.jobs


@cache
def whole() -> tuple[Result, list[EstimatorFlight]]:
    return concluded()


def test_each_use_is_flown_in_three_turbulences_with_pitot_and_accelerometers() -> None:
    flights = [
        EstimatorFlight(
            line=line,
            seed=seed,
            sensors=Sensors(imu=MEMS_IMU, airspeed=PITOT),
            turbulence=turbulence,
            changes=changes,
        )
        for turbulence in (0.01, 0.03, 0.05)
        for changes in USES.values()
        for line in "abc"
        for seed in range(1, 12)
    ]
    assert whole()[1] == flights
    quick = concluded(quick=True, dispersion=True)[1]
    assert len(quick) == 15
    assert {(flight.line, flight.seed, flight.dispersed) for flight in quick} == {("a", 1, True)}


def test_a_row_for_each_use_and_turbulence() -> None:
    (table,) = whole()[0].tables
    assert [row[:2] for row in table.rows] == [
        (t, use) for t in ("1 %", "3 %", "5 %") for use in USES
    ]
    bank = f"{degrees(0.05):.1f}"
    assert table.rows[0][2:] == ("33", "0", "20.0", bank, "10.0", "1.00", "1.00")
    assert table.rows[4][2:] == ("33", "0", "20.0", bank, "12.0", "1.20", "2.00")
    assert table.rows[11][2:] == ("33", "1", "20.0", bank, "11.0", "1.10", "1.50")
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert signs(whole()[0].claims) == "✓"
    assert whole()[0].claims[0].measured == "the best is 1.00 of neither's"
    assert list(whole()[0].numbers) == [f"{use}, {t}" for t in (0.01, 0.03, 0.05) for use in USES]
    assert whole()[0].seeds == tuple(range(1, 12))


def ratio(e_rho: float, left_out: int = 0, lost: int = 0, of_neither: int = 0) -> Compared:
    return Compared(Ratios(e_rho, 1.0, left_out), lost, of_neither)


@pytest.mark.parametrize(
    ("one", "sign"),
    [
        (ratio(0.951), "✓"),
        (ratio(0.95), "✗"),  # 5 % are worth it
        (ratio(0.949), "✗"),
        (ratio(0.949, left_out=1), "?"),
        (ratio(0.949, lost=1), "?"),
        (ratio(0.949, of_neither=1), "?"),
        (ratio(0.949, lost=2, of_neither=2), "✗"),
        (ratio(0.951, left_out=1), "✓"),
    ],
)
def test_five_per_cent_are_worth_it_where_all_flights_were_scored(one: Compared, sign: str) -> None:
    assert signs([worth_claim({"neither": ratio(1.0), "trim": one})]) == sign
    best = one.ratios.e_rho if one.whole else 1.0
    claim = worth_claim({"neither": ratio(1.0), "trim": one})
    assert claim.measured.startswith(f"the best is {best:.2f} of neither's")
    assert ("not to be compared" in claim.measured) is (sign == "?")


def test_where_no_use_is_whole_the_best_is_none_at_all() -> None:
    claim = worth_claim({"trim": ratio(0.9, left_out=3, lost=2, of_neither=1)})
    assert claim.measured.startswith("the best is 1.00 of neither's; not to be compared")
    assert "trim: 0.90, without 3 pairs not scored, 2 lost against 1" in claim.measured
