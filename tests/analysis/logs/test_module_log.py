"""The module's own log as a flight, from topics that are made up: which column is which, when a
sample was true, and what the module flew."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tgl_soar.analysis.logs.flight_data import COLUMNS, Event, FlightData, LoggedMode
from tgl_soar.analysis.logs.module_log import read_module_log
from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError, Words
from tgl_soar.control import supervisor as modes
from tgl_soar.control.excitation import RUNNING
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS

N = 20
BEGIN_S = 50.0
TIME_S = 0.1 * np.arange(N)
STAMPS = np.round((BEGIN_S + TIME_S) * 1e6).astype(np.uint64)
FLOWN = np.arange(N) >= 5
# Where a series' columns stand in the topic of the ticks.
PREFIXES = {
    "path": "vehicle_",
    "motion": "vehicle_",
    "heading": "vehicle_",
    "setpoints": "setpoints_",
    "surfaces": "command_",
    "air": "air_",
    "ages": "health_",
    "margins": "margins_",
    "forecast": "forecast_",
    "throttle": "throttle_",
    "line": "line_",
    "tracking": "",
}


def about(time_s: float) -> Any:
    """Stamps are whole microseconds."""
    return pytest.approx(time_s)


def ticks(**changes: Any) -> dict[str, Any]:
    """Numbers of which each column has its own."""
    columns: dict[str, Any] = {
        "timestamp": STAMPS,
        "mode": np.where(FLOWN, modes.SOARING, modes.READY),
        "reason": np.zeros(N, dtype=int),
        "active": FLOWN,
    }
    for n, (kind, prefix) in enumerate(PREFIXES.items()):
        for k, name in enumerate(COLUMNS[kind]):
            columns.setdefault(prefix + name, 100.0 * n + 10.0 * k + TIME_S)
    columns |= {"excitation_standing": np.zeros(N), "excitation_pitch_rad": np.zeros(N)}
    columns |= {"vehicle_pitch_rad": 0.1 * TIME_S, "elevator_p": TIME_S, "elevator_i": -TIME_S}
    columns |= {"point_standing": np.ones(N), "point_off_m": TIME_S, "command_brake": 0.5 * TIME_S}
    return {**columns, **changes}


def sampled(age_s: Any = 0.02, **columns: Any) -> dict[str, Any]:
    """Samples that were so old when a tick had them."""
    return {"timestamp": STAMPS, "time_s": STAMPS * 1e-6 - age_s, **columns}


def read(tick: dict[str, Any] | None = None, **given: Any) -> FlightData:
    topics = {"tick": ticks() if tick is None else tick, **given.pop("topics", {})}
    return read_module_log(FlightLog(path=Path("ours.ulg"), topics=topics, parameters={}, **given))


@pytest.mark.parametrize("kind", sorted(PREFIXES))
def test_every_series_of_the_ticks_has_its_own_columns(kind: str) -> None:
    found = read().series()[kind]
    assert tuple(found.columns) == COLUMNS[kind]
    assert found.time_s == pytest.approx(TIME_S)
    # Of a module that only watches, nothing that it would have flown.
    shown = FLOWN if kind in ("surfaces", "setpoints", "tracking") else np.ones(N, dtype=bool)
    for name in COLUMNS[kind]:
        expected = np.where(shown, ticks()[PREFIXES[kind] + name], nan)
        assert found[name] == pytest.approx(expected, nan_ok=True), name


def test_modes_are_reported_where_they_change() -> None:
    flight = read()
    assert flight.modes == (LoggedMode(0.0, "ready"), LoggedMode(about(0.5), "soaring"))
    assert flight.kind == "flight log of the module (ULog)"
    assert flight.name == "ours.ulg"
    assert flight.start_s == pytest.approx(BEGIN_S)


def test_modes_and_reasons_are_those_of_the_version_that_wrote_the_log() -> None:
    reason = np.zeros(N, dtype=int)
    reason[5] = 1
    tick = ticks(mode=np.where(FLOWN, 1, 0), reason=reason)
    flight = read(tick, info={"modes": "resting;gliding", "reasons": "none;because"})
    assert [mode.name for mode in flight.modes] == ["resting", "gliding"]
    (event,) = flight.events
    assert event.text == "gliding: because"


def test_why_the_mode_changed_is_reported_unless_words_said_so() -> None:
    reason = np.zeros(N, dtype=int)
    reason[5], reason[9] = 2, 3
    texts = [f"soaring: {REASON_TEXTS[n]}" for n in (2, 3)]
    flight = read(ticks(reason=reason))
    assert flight.events == (
        Event(about(0.5), "mode", texts[0]),
        Event(about(0.9), "mode", texts[1]),
    )
    reported = read(ticks(reason=reason), words=[Words(BEGIN_S + 0.5, 4, f" {texts[0]} ")])
    assert [(event.kind, event.text) for event in reported.events] == [
        ("message", texts[0]),
        ("mode", texts[1]),
    ]
    reason[5] = 999
    unknown = read(ticks(reason=reason)).events[0].text
    assert unknown == f"{MODE_NAMES[modes.SOARING]}: reason unknown"


def test_a_sample_stands_at_the_time_when_it_was_true() -> None:
    place = {f"{axis}_m": n + TIME_S for n, axis in enumerate(("north", "east", "down"))}
    speed = {
        f"velocity_{axis}_mps": 10.0 + n + TIME_S
        for n, axis in enumerate(("north", "east", "down"))
    }
    flight = read(topics={"position": sampled(0.04, **place, **speed)})
    position, velocity = flight.position, flight.velocity
    assert position is not None
    assert velocity is not None
    assert position.time_s == pytest.approx(TIME_S - 0.04)
    assert position["east_m"] == pytest.approx(1.0 + TIME_S)
    assert [velocity[f"{axis}_mps"][0] for axis in ("north", "east", "down")] == [10.0, 11.0, 12.0]


@pytest.mark.parametrize(
    ("age_s", "kept"), [(1.99, True), (2.01, False), (-1.99, True), (-2.01, False)]
)
def test_a_sample_of_another_clock_is_left_out(age_s: float, kept: bool) -> None:
    """Two seconds older or newer than when a tick had it, of all samples alike."""
    flight = read(topics={"airspeed": sampled(age_s, airspeed_mps=8.0 + TIME_S)})
    assert (flight.airspeed is not None) == kept


def test_a_sample_that_is_older_than_the_one_before_is_left_out() -> None:
    ages = np.full(N, 0.02)
    ages[7], ages[12] = 0.5, nan
    flight = read(topics={"airspeed": sampled(ages, airspeed_mps=8.0 + TIME_S)})
    assert flight.airspeed is not None
    kept = [n for n in range(N) if n not in (7, 12)]
    assert flight.airspeed["airspeed_mps"] == pytest.approx(8.0 + TIME_S[kept])


def test_attitudes_are_angles_and_what_is_no_rotation_is_left_out() -> None:
    x, y, z, w = Rotation.from_euler("ZYX", [1.0, 0.2, -0.3]).as_quat().tolist()
    ones = np.ones(N)
    q = {"qw": w * ones, "qx": x * ones, "qy": y * ones, "qz": z * ones}
    for name in q:
        q[name][4] = 0.0
    rates = {
        f"{axis}_rate_frd_radps": n + TIME_S for n, axis in enumerate(("roll", "pitch", "yaw"))
    }
    flight = read(topics={"attitude": sampled(0.0, **q, **rates)})
    assert flight.attitude is not None
    assert len(flight.attitude) == N - 1
    angles = [flight.attitude[f"{name}_rad"][0] for name in ("roll", "pitch", "yaw")]
    assert angles == pytest.approx([-0.3, 0.2, 1.0])
    assert flight.rates is not None
    assert flight.rates["yaw_rate_frd_radps"][0] == 2.0


def test_a_multisine_is_there_where_one_ran() -> None:
    assert read().excitation is None
    standing = np.where(np.arange(N) > 9, RUNNING, 0).astype(float)
    tick = ticks(excitation_standing=standing, excitation_pitch_rad=0.3 * TIME_S)
    found = read(tick).excitation
    assert found is not None
    assert found["standing"].tolist() == standing.tolist()
    for name, column in {
        "injected_rad": "excitation_pitch_rad",
        "setpoint_rad": "setpoints_pitch_rad",
        "pitch_rad": "vehicle_pitch_rad",
        "elevator": "command_elevator",
        "elevator_p": "elevator_p",
        "elevator_i": "elevator_i",
    }.items():
        assert found[name] == pytest.approx(tick[column]), name


def test_the_point_that_is_held_and_the_brake_are_read() -> None:
    flight = read(topics={"surfaces": sampled(0.0, brake=0.25 + 0.0 * TIME_S)})
    assert flight.point is not None
    assert flight.point["off_m"] == pytest.approx(TIME_S)
    assert flight.point["brake"] == pytest.approx(0.5 * TIME_S)
    assert flight.brake is not None
    assert flight.brake["brake"] == pytest.approx(np.full(N, 0.25))


def test_where_the_module_did_not_fly_the_surfaces_are_those_that_were_read_back() -> None:
    back = {name: np.full(N, 7.0 + n) for n, name in enumerate(("elevator", "aileron", "rudder"))}
    topics = {"surfaces": sampled(0.0, **back)}
    found = read(topics=topics).surfaces
    assert found is not None
    for n, name in enumerate(("elevator", "aileron", "rudder")):
        assert found[name] == pytest.approx(np.where(FLOWN, ticks()[f"command_{name}"], 7.0 + n))
    watched = read(ticks(active=np.zeros(N, dtype=bool)), topics=topics).surfaces
    assert watched is not None
    assert watched.source == "surfaces"
    assert watched["aileron"].tolist() == [8.0] * N


def test_streams_metadata_and_files_are_the_logs() -> None:
    flight = read(
        topics={"parameter": {"timestamp": STAMPS}, "imu": {"timestamp": STAMPS}},
        info={"sys_name": "tgl_soar", "ver_sw": "1.2", "site_file": "a.toml", "other": "x"},
        texts={"site": "text"},
    )
    assert set(flight.streams) == {"tick", "imu"}
    assert flight.metadata == {
        "system": "tgl_soar",
        "software version": "1.2",
        "site file": "a.toml",
    }
    assert flight.files == {"site": "text"}
    assert [words for words in flight.missing if "airspeed" in words]


def test_a_log_without_a_tick_is_refused() -> None:
    with pytest.raises(LogError, match=r"ours\.ulg: no tick of the module is in it"):
        read({"timestamp": STAMPS})
