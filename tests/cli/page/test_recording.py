"""A log in the place of a flight: which number of it stands in which column, and at which times."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import pi, radians
from typing import Any

import msgspec
import numpy as np
import pytest
from page_flight import SITE

from tgl_soar.analysis.logs.flight_data import COLUMNS, Event, FlightData, LoggedMode, Series
from tgl_soar.cli.page.measured_air import AirSample
from tgl_soar.cli.page.recording import MOST_ROWS, ROWS_PER_S, recording_of
from tgl_soar.cli.page.station import ROW
from tgl_soar.config.files import load_site
from tgl_soar.config.site import Site
from tgl_soar.control.supervisor_texts import MODE_NAMES

TIMES = (0.0, 1.0, 2.0)


@cache
def tunnel() -> Site:
    return load_site(SITE)


def series(times_s: Sequence[float] = TIMES, **columns: Sequence[float]) -> Series:
    held = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    return Series(np.asarray(times_s, dtype=float), held, "a test")


def constant(of: str, base: float) -> Series:
    """Every column of a series: base, and one tenth more from column to column."""
    columns = {name: [base + 0.1 * i] * 3 for i, name in enumerate(COLUMNS[of])}
    return series(**columns)


def rows_of(flight: FlightData) -> list[dict[str, Any]]:
    found = recording_of(flight, tunnel())
    return [dict(zip(ROW, row, strict=True)) for row in found["rows"]]


def test_each_column_is_the_logged_number_in_the_units_of_the_strips() -> None:
    flight = FlightData(
        "f.ulg",
        "a log",
        path=constant("path", 1.0),  # x 1.0, y 1.1, z 1.2
        tracking=series(e_rho_m=[0.03] * 3),
        attitude=series(roll_rad=[pi / 6] * 3, pitch_rad=[-pi / 36] * 3, yaw_rad=[0.0] * 3),
        setpoints=series(pitch_rad=[pi / 18] * 3),
        surfaces=series(elevator=[-0.25] * 3),
        air=series(wind_mps=[8.5] * 3, updraft_mps=[0.75] * 3),
        airspeed=series(airspeed_mps=[9.25] * 3),
        motion=series(velocity_x_mps=[0.1] * 3, velocity_y_mps=[0.0] * 3, climb_mps=[-0.4] * 3),
        line=series(x_m=[0.6] * 3, z_m=[1.6] * 3, eta_rad=[radians(105.0)] * 3),
        ages=series(
            position_age_s=[0.01] * 3, attitude_age_s=[0.02] * 3, heartbeat_age_s=[0.3] * 3
        ),
        margins=series(clearance_m=[1.7] * 3, stall_rad=[pi / 60] * 3),
        forecast=series(standing=[1.0] * 3, chance=[0.9] * 3, ahead_s=[4.0] * 3, z_m=[2.2] * 3),
        modes=(LoggedMode(0.0, "soaring"),),
    )
    for row in rows_of(flight):
        del row["t"]
        assert row == {
            "soar_x": 1.0,
            "soar_z": 1.2,
            "e_rho": 0.03,
            "pitch": -5.0,
            "roll": 30.0,
            "pitch_sp": 10.0,
            "elevator": -0.25,
            "updraft": 0.75,
            "wind": 8.5,
            "excess": -0.4,  # what it climbs at, in steady flight
            "airspeed": 9.25,
            "climb": -0.4,
            "soar_mode": MODE_NAMES.index("soaring"),
            "line_x": 0.6,
            "line_z": 1.6,
            "line_lean": 15.0,
            "age_pos": 0.01,
            "age_att": 0.02,
            "age_ap": 0.3,
            "clearance": 1.7,
            "stall": 3.0,
            "fc_state": 1.0,
            "fc_chance": 0.9,
            "fc_time": 4.0,
            "fc_z": 2.2,
        }


def test_what_the_log_lacks_is_not_known() -> None:
    for row in rows_of(FlightData("f", "k", airspeed=series(airspeed_mps=[9.0] * 3))):
        assert row.pop("t") is not None
        assert row.pop("airspeed") == 9.0
        assert set(row.values()) == {None}


def test_a_series_without_the_column_is_not_known() -> None:
    (row, *_) = rows_of(FlightData("f", "k", air=series(wind_mps=[8.0] * 3)))
    assert (row["wind"], row["updraft"]) == (8.0, None)


def test_numbers_of_flight_are_linear_in_between_and_those_of_the_line_stand() -> None:
    flight = FlightData(
        "f",
        "k",
        path=series(x_m=[0.0, 1.0, 2.0], y_m=[0.0] * 3, z_m=[1.0, 1.0, 3.0]),
        line=series(
            x_m=[0.2, 0.2, 0.6],
            z_m=[1.0, 1.0, 1.6],
            eta_rad=[radians(100.0), radians(100.0), radians(110.0)],
        ),
        forecast=series(
            standing=[0.0, 0.0, 3.0],
            chance=[1.0, 1.0, 0.5],
            ahead_s=[9.0, 9.0, 5.0],
            z_m=[1.0, 1.0, 2.0],
        ),
    )
    rows = rows_of(flight)
    row = rows[round(0.75 * (len(rows) - 1))]  # 1.5 s, or nearly: 20 rows over 2 s
    assert row["soar_x"] == pytest.approx(row["t"], abs=1e-4)
    assert row["soar_z"] == pytest.approx(1.0 + 2.0 * (row["t"] - 1.0), abs=1e-3)
    standing = {n: row[n] for n in ("line_x", "line_z", "line_lean")}
    assert standing == {"line_x": 0.2, "line_z": 1.0, "line_lean": 10.0}
    standing = {n: row[n] for n in ("fc_state", "fc_chance", "fc_time", "fc_z")}
    assert standing == {"fc_state": 0.0, "fc_chance": 1.0, "fc_time": 9.0, "fc_z": 1.0}
    assert rows[-1]["line_lean"] == 20.0


@pytest.mark.parametrize(
    ("seconds", "count"), [(0.1, 2), (0.25, 2), (2.0, 20), (60.0, 600), (2000.0, 20_000),
                           (2400.0, 20_000)],
)  # fmt: skip
def test_ten_rows_a_second_at_least_two_and_at_most_those_of_33_minutes(
    seconds: float, count: int
) -> None:
    flight = FlightData("f", "k", airspeed=series((0.0, seconds), airspeed_mps=[9.0, 9.0]))
    found = recording_of(flight, tunnel())
    times = [row[0] for row in found["rows"]]
    assert len(times) == count
    assert (times[0], times[-1]) == (0.0, seconds)
    assert found["duration_s"] == seconds
    assert (ROWS_PER_S, MOST_ROWS) == (10.0, 20_000)


def test_a_mode_stands_from_its_change_on_and_an_unknown_one_is_not_known() -> None:
    flight = FlightData(
        "f",
        "k",
        airspeed=series(airspeed_mps=[9.0] * 3),
        modes=(LoggedMode(0.5, "ready"), LoggedMode(1.0, "capturing"), LoggedMode(1.5, "odd")),
    )
    modes = {row["t"]: row["soar_mode"] for row in rows_of(flight)}
    for t, mode in modes.items():
        if t < 0.5 or t >= 1.5:
            assert mode is None
        else:
            assert mode == MODE_NAMES.index("ready" if t < 1.0 else "capturing")
    assert MODE_NAMES.index("ready") == 2


def test_what_happened_and_what_was_lost_is_reported_in_json() -> None:
    flight = FlightData(
        "f.ulg",
        "a log of the module",
        airspeed=series(airspeed_mps=[9.0] * 3),
        events=(Event(0.12345, "message", "ready"), Event(1.5, "parameter", "RHO_P 0.5")),
        parameters={"RHO_P": 0.123456, "RHO_D": float("nan")},
        missing=("the log holds no attitude",),
        lost=("12 bytes",),
    )
    found = msgspec.json.decode(msgspec.json.encode(recording_of(flight, tunnel())))
    assert found["texts"] == [
        {"time": 0.12, "kind": "message", "text": "ready"},
        {"time": 1.5, "kind": "parameter", "text": "RHO_P 0.5"},
    ]
    assert found["parameters"] == {"RHO_P": 0.1235, "RHO_D": None}
    assert (found["missing"], found["lost"]) == (["the log holds no attitude"], ["12 bytes"])
    assert (found["name"], found["kind"]) == ("f.ulg", "a log of the module")
    assert found["measured"] is None


@pytest.mark.parametrize(("fixes", "by_fixes"), [(2, False), (3, True)])
def test_the_path_as_reported_stands_where_there_are_fewer_fixes(
    fixes: int, by_fixes: bool
) -> None:
    """The tunnel's wind blows along x, so that the fixes are elsewhere than the reported path."""
    times = np.linspace(0.0, 2.0, fixes)
    position = series(
        times.tolist(), north_m=[50.0] * fixes, east_m=[70.0] * fixes, down_m=[-9.0] * fixes
    )
    path = series(x_m=[1.0] * 3, y_m=[np.nan] * 3, z_m=[2.0] * 3)  # as telemetry reports it
    row = rows_of(FlightData("f", "k", position=position, path=path))[0]
    if by_fixes:
        assert row["soar_x"] is not None
        assert abs(row["soar_x"]) > 10.0
    else:
        assert (row["soar_x"], row["soar_z"]) == (1.0, 2.0)


class Watched:
    """What of a flight the air is measured with."""

    def __init__(self) -> None:
        self.samples: list[tuple[AirSample, bool]] = []
        self.bounds: list[dict[str, float]] = []
        self.drawing: Any = None

    def bound(self, parameters: dict[str, float]) -> None:
        assert not self.samples  # before the first: it begins the map again
        self.bounds.append(parameters)

    def take(self, sample: AirSample, *, flying: bool) -> None:
        self.samples.append((sample, flying))

    def draw_whole(self) -> None:
        self.drawing = {"readings": len(self.samples)}


def air_flight(**more: Any) -> FlightData:
    return FlightData(
        "f",
        "k",
        path=series(x_m=[0.0, 1.0, 2.0], y_m=[0.0] * 3, z_m=[1.0] * 3),
        motion=series(velocity_x_mps=[0.3] * 3, velocity_y_mps=[0.0] * 3, climb_mps=[0.2] * 3),
        air=series(wind_mps=[8.0] * 3, updraft_mps=[0.6] * 3),
        modes=(
            *(LoggedMode(0.4, "ready"), LoggedMode(0.9, "soaring")),
            LoggedMode(1.4, "released"),
        ),
        parameters={"FENCE_X_MIN": -1.0},
        **more,
    )


def test_the_air_is_measured_twice_a_second_and_only_where_it_was_flown() -> None:
    watched: Any = Watched()
    found = recording_of(air_flight(), tunnel(), watched)
    assert [sample.time_s for sample, _ in watched.samples] == [0.0, 0.5, 1.0, 1.5]
    assert [sample.x_m for sample, _ in watched.samples] == [0.0, 0.5, 1.0, 1.5]
    assert [flying for _, flying in watched.samples] == [False, False, True, False]
    sample = watched.samples[2][0]
    assert sample == AirSample(
        time_s=1.0,
        x_m=1.0,
        z_m=1.0,
        velocity_x_mps=0.3,
        wind_mps=8.0,
        updraft_mps=0.6,
        pushed_mps=0.0,  # the log has no propeller
    )
    assert watched.bounds == [{"FENCE_X_MIN": -1.0}]
    assert found["measured"] == {"readings": 4}


def test_what_a_propeller_gives_is_passed_to_the_map() -> None:
    watched: Any = Watched()
    recording_of(air_flight(throttle=series(fraction=[1.0] * 3, climb_mps=[1.5] * 3)), tunnel(),
                 watched)  # fmt: skip
    assert {sample.pushed_mps for sample, _ in watched.samples} == {1.5}
