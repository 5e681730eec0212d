"""Logs of ours and of others: what is read is what was flown."""

from __future__ import annotations

from math import radians
from pathlib import Path

import flown
import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.DFReader import DFReader_binary

from tgl_soar.analysis.logs.flight_data import COLUMNS, FlightData, on_line, placed, steered
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.config.files import load_airframe, load_site
from tgl_soar.geometry import euler_from_quaternion

Floats = NDArray[np.float64]

WRITERS = {
    "ours": flown.our_log,
    "px4": flown.px4_log,
    "dataflash": flown.dataflash_log,
    "tlog": flown.tlog,
}


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FlightData]:
    folder = tmp_path_factory.mktemp("logs")
    return {name: read_flight(write(folder)) for name, write in WRITERS.items()}


def of_the_flight(values: list[float]) -> tuple[Floats, Floats]:
    return np.array([tick.inputs.time_s for tick in flown.flight()]), np.array(values)


def differs(flight: FlightData, kind: str, column: str, truth: list[float]) -> float:
    """The greatest difference between a column and what was flown, at the column's times.

    A log's time begins with its first sample, which may be the flight's second tick.
    """
    series = flight.series()[kind]
    times, values = of_the_flight(truth)
    best = np.inf
    for shift in (0.0, 0.005, 0.01):
        expected = np.interp(series.time_s + shift, times, values)
        known = np.isfinite(series[column]) & np.isfinite(expected)
        assert np.count_nonzero(known) > 0.9 * len(series) - 100
        best = min(best, float(np.max(np.abs(series[column] - expected)[known])))
    return best


@pytest.mark.parametrize("writer", WRITERS)
def test_every_series_has_its_columns_and_runs_forward(
    flights: dict[str, FlightData], writer: str
) -> None:
    found = flights[writer].series()
    for name, series in found.items():
        if name in COLUMNS:
            assert set(COLUMNS[name]) == set(series.columns), name
        assert np.all(np.diff(series.time_s) >= 0.0), name
        assert all(len(values) == len(series) for values in series.columns.values())
    assert {"position", "velocity", "attitude", "setpoints"} <= found.keys()
    assert writer != "ours" or {"margins", "forecast"} <= found.keys()


@pytest.mark.parametrize("writer", WRITERS)
def test_attitude_and_position_are_those_that_were_flown(
    flights: dict[str, FlightData], writer: str
) -> None:
    flight, ticks = flights[writer], flown.flight()
    angles = [euler_from_quaternion(*tick.inputs.attitude[2:6]) for tick in ticks]
    for i, name in enumerate(COLUMNS["attitude"]):
        # ArduPilot keeps hundredths of a degree; between samples the truth moves on.
        assert differs(flight, "attitude", name, [a[i] for a in angles]) < radians(0.3)
    fixes = [tick.inputs.position for tick in ticks]
    assert differs(flight, "position", "north_m", [f.north_m for f in fixes]) < 0.05
    assert differs(flight, "position", "down_m", [f.down_m for f in fixes]) < 0.05  # taken earlier


@pytest.mark.parametrize("writer", ["px4", "dataflash", "tlog"])
def test_airspeed_is_read(flights: dict[str, FlightData], writer: str) -> None:
    truth = [tick.truth.airspeed_mps for tick in flown.flight()]
    assert differs(flights[writer], "airspeed", "airspeed_mps", truth) < 0.1


def test_the_path_of_another_autopilot_lies_in_the_sites_frame(
    flights: dict[str, FlightData],
) -> None:
    frame = load_site(flown.SITE).frame()
    for writer in ("px4", "dataflash", "tlog"):
        flight = placed(flights[writer], frame)
        assert flight.path is not None
        truth = [tick.truth.x_m for tick in flown.flight()]
        assert differs(flight, "path", "x_m", truth) < 0.08  # sensor's delay and noise
        assert flight.heading is not None


def test_surfaces_come_from_pulse_widths(flights: dict[str, FlightData]) -> None:
    surfaces = load_airframe(flown.AIRFRAME).surfaces
    commands = [tick.output.command for tick in flown.flight()]
    direction = -1.0 if surfaces.elevator.reversed else 1.0
    for writer in ("dataflash", "tlog"):
        assert flights[writer].surfaces is None
        flight = steered(flights[writer], surfaces)
        truth = [direction * c.elevator for c in commands]
        assert differs(flight, "surfaces", "elevator", truth) < 0.03
    truth = [c.elevator for c in commands]
    assert differs(flights["px4"], "surfaces", "elevator", truth) < 1e-6


def test_our_log_holds_what_the_laws_did(flights: dict[str, FlightData]) -> None:
    flight = flights["ours"]
    outputs = [tick.output for tick in flown.flight()]
    assert differs(flight, "tracking", "e_rho_m", [o.line.e_rho_m for o in outputs]) < 1e-6
    assert differs(flight, "path", "z_m", [o.vehicle.z_m for o in outputs]) < 1e-6
    assert differs(flight, "line", "x_m", [o.line.x_m for o in outputs]) < 1e-6
    assert [m.name for m in flight.modes][-1] == "soaring"
    assert set(flight.files) == {"airframe", "site"}
    assert any("TGL_X" in event.text for event in flight.events)


def test_a_log_in_parts_is_one_flight(flights: dict[str, FlightData], tmp_path: Path) -> None:
    parts = flown.our_parts(tmp_path, largest_bytes=7_000_000)
    assert len(parts) > 2
    flight, whole = read_flight(parts[0]), flights["ours"]
    assert flight.duration_s == pytest.approx(whole.duration_s, abs=0.01)
    assert [m.name for m in flight.modes] == [m.name for m in whole.modes]
    assert {e.text for e in flight.events} == {e.text for e in whole.events}
    for name, series in whole.series().items():
        again = flight.series()[name]
        column = next(iter(series.columns))
        times = np.linspace(1.0, whole.duration_s - 1.0, 200)
        np.testing.assert_allclose(
            again.at(column, times), series.at(column, times), atol=0.02, err_msg=name
        )
    assert read_flight(parts[1]).duration_s < 0.6 * whole.duration_s  # that part alone
    parts[2].write_bytes(b"")
    without = read_flight(parts[0])
    assert without.duration_s > 0.3 * whole.duration_s
    assert any(parts[2].name in text for text in without.lost)


def test_the_wire_tells_line_and_modes(flights: dict[str, FlightData]) -> None:
    flight = flights["tlog"]
    assert [m.name for m in flight.modes][-1] == "soaring"
    assert [m.name for m in flight.autopilot_modes] == ["MANUAL"]
    assert flight.line is not None
    last = flown.flight()[-1].output
    assert flight.line["x_m"][-1] == pytest.approx(last.line.x_m, abs=1e-3)
    assert flight.line["eta_rad"][-1] == pytest.approx(last.line.eta_rad, abs=1e-3)
    assert flight.line["moving"][-1] == 0.0
    assert flight.line["moving"].max() == 1.0
    texts = [event.text for event in flight.events]
    assert "soaring: on the line" in texts
    assert "TGL_X 0.2 → 0.6" in texts


def test_e_rho_follows_from_path_and_line_where_nobody_reported_it(tmp_path: Path) -> None:
    flight = read_flight(flown.tlog(tmp_path))
    without = FlightData(
        name="", kind="", path=placed(flight, load_site(flown.SITE).frame()).path, line=flight.line
    )
    reckoned = on_line(without)
    assert reckoned.tracking is not None
    late = reckoned.tracking.within(9.0, 12.5)["e_rho_m"]
    assert np.sqrt(np.mean(late**2)) < 0.04


def test_others_name_modes_messages_and_parameters(flights: dict[str, FlightData]) -> None:
    px4, ardupilot = flights["px4"], flights["dataflash"]
    assert [m.name for m in px4.autopilot_modes] == ["Manual", "Offboard"]
    assert [m.name for m in ardupilot.autopilot_modes] == ["MANUAL", "FBWA"]
    assert px4.metadata["system"] == "PX4"
    assert ardupilot.metadata["firmware"].startswith("ArduPlane V4")
    assert {e.text for e in px4.events} == {"FW_AIRSPD_TRIM 8.5 → 9", "Stall warning"}
    assert "AIRSPEED_CRUISE 8.5 → 9" in [e.text for e in ardupilot.events]
    assert px4.parameters["FW_AIRSPD_TRIM"] == 8.5
    assert ardupilot.parameters["AIRSPEED_CRUISE"] == 8.5


@pytest.mark.parametrize("writer", WRITERS)
def test_what_a_log_never_held_is_reported_in_words(
    flights: dict[str, FlightData], writer: str
) -> None:
    missing = " ".join(flights[writer].missing)
    held = {"ours": set(), "tlog": {"air"}}.get(writer, {"tracking", "line", "air"})
    for word, name in (("e_rho", "tracking"), ("line", "line"), ("updraft", "air")):
        if name in held:
            assert word in missing
    assert flights[writer].lost == ()


# --- pymavlink reads the same -----------------------------------------------------------------


def test_dataflash_agrees_with_pymavlink(tmp_path: Path) -> None:
    path = flown.dataflash_log(tmp_path)
    flight = read_flight(path)
    theirs = DFReader_binary(str(path))
    pitches = []
    while (message := theirs.recv_match(type=["ATT"], strict=True)) is not None:
        pitches.append(radians(message.Pitch))
    assert flight.attitude is not None
    np.testing.assert_allclose(flight.attitude["pitch_rad"], pitches, atol=1e-12)


def test_tlog_agrees_with_pymavlink(tmp_path: Path) -> None:
    path = flown.tlog(tmp_path)
    flight = read_flight(path)
    theirs = mavutil.mavlink_connection(str(path))
    north, count = [], 0
    while (message := theirs.recv_match()) is not None:
        count += 1
        if message.get_type() == "LOCAL_POSITION_NED":
            north.append(message.x)
    assert flight.position is not None
    np.testing.assert_array_equal(flight.position["north_m"], north)
    assert sum(came for came, _ in flight.loss.values()) == count
    assert all(lost == 0 for _, lost in flight.loss.values())


def test_lost_frames_are_counted_by_their_numbering(tmp_path: Path) -> None:
    path = flown.tlog(tmp_path)
    whole = read_flight(path)
    log = mavutil.mavlink_connection(str(path))
    parts = []
    k = 0
    while (message := log.recv_match()) is not None:
        k += 1
        if k % 10:
            us = round(message._timestamp * 1e6)
            parts.append(us.to_bytes(8, "big") + bytes(message.get_msgbuf()))
    thinned = tmp_path / "thinned.tlog"
    thinned.write_bytes(b"".join(parts))
    flight = read_flight(thinned)
    before = sum(came for came, _ in whole.loss.values())
    came = sum(came for came, _ in flight.loss.values())
    lost = sum(lost for _, lost in flight.loss.values())
    assert came + lost == pytest.approx(before, abs=2)  # the last are not missed
    assert lost > 0.09 * before


def test_positions_without_a_local_frame_are_said_to_be_so(tmp_path: Path) -> None:
    flight = read_flight(flown.tlog(tmp_path, leave_out=["LOCAL_POSITION_NED"]))
    assert not flight.absolute_positions
    assert flight.position is not None
    assert any("first fix" in text for text in flight.missing)
    fixes = [tick.inputs.position for tick in flown.flight() if tick.inputs.position.sequence]
    moved = [fix.north_m - fixes[0].north_m for fix in fixes]
    assert np.max(np.abs(flight.position["north_m"])) == pytest.approx(
        max(map(abs, moved)), abs=0.02
    )
    assert placed(flight, load_site(flown.SITE).frame()).path is not None  # as reported
