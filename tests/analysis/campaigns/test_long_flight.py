"""The whole module across the wrap of the autopilot's clock.

For seconds in every run, for an hour by `make long`; `tgl-soar campaign long` flies a day.
"""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.campaigns.long_flight import LongFlight, Part, fly_long
from tgl_soar.cli.app import app


def test_the_wrap_of_the_autopilots_clock_is_flown_through() -> None:
    flight = fly_long(12.0)
    assert flight.wrapped
    assert flight.ended == ""
    assert flight.ticks == flight.expected_ticks == 2400
    assert (flight.reboots, flight.stale, flight.lost) == (0, 0, 0)
    assert [part.late_s for part in flight.parts] == [0.0] * 24
    # After the capture and across the wrap the line is held as ever: 5 cm, at 1 % turbulence.
    assert all(part.largest_e_rho_m < 0.05 for part in flight.parts if part.flown_s > 5.0)
    assert flight.is_well


@pytest.mark.long
def test_an_hour_is_flown_through_and_leaves_memory_as_it_was() -> None:
    flight = fly_long(3600.0)
    assert flight.is_well, flight
    assert flight.ticks == 720_000
    assert flight.stale == 0
    assert flight.grown_kib < 1024  # a byte and a half for each tick
    # After the capture twice as far as turbulence of 1 % ever takes it.
    assert all(part.largest_e_rho_m < 0.05 for part in flight.parts[1:])


@pytest.mark.parametrize(
    "corrupted",
    [
        {"ticks": 1}, {"reboots": 1}, {"lost": 1}, {"ended": "released"}, {"wrapped": False},
        {"parts": [
            Part(flown_s=1.0, resident_kib=1, tick_us=1.0, late_s=0.005, largest_e_rho_m=0.0)
        ]},
    ],
)  # fmt: skip
def test_a_flight_that_is_not_well_says_so(corrupted: dict[str, object]) -> None:
    well = {"ticks": 2, "expected_ticks": 2, "wrapped": True}
    assert LongFlight(1.0, **well).is_well  # type: ignore[arg-type]
    assert not LongFlight(1.0, **{**well, **corrupted}).is_well  # type: ignore[arg-type]


def test_the_command_tells_how_it_went() -> None:
    done = CliRunner().invoke(app, ["campaign", "long", "--hours", "0.001"])
    assert done.exit_code == 0, done.output
    assert "720 ticks of 720; 0 restarts seen, 0 stale and 0 lost frames" in done.output
