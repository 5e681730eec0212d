"""A `.tlog` frame by frame: what pymavlink packs is read as it was sent."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import cos, degrees, nan, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v10 import ardupilotmega as first
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.logs.tlog import Tlog, read_tlog
from tgl_soar.analysis.logs.ulog_reader import LogError

PATH = Path("station.tlog")
EPOCH_US = 1_700_000_000_000_000  # November 2023
PILOT, MODULE, STATION = (1, 1), (1, 191), (255, 190)
STANDARD_GRAVITY_MPS2 = 9.80665
EARTH_RADIUS_M = 6_371_000.0  # mean radius
CHECKSUM = 2  # bytes at the end of a frame

Sent = tuple[float, tuple[int, int], Any]  # when [s], by which sender, what


def frames(sent: Sequence[Sent], version: Any = mavlink) -> list[bytes]:
    """Each as it is recorded: microseconds since 1970, the highest byte first, then the frame."""
    numbering: dict[tuple[int, int], int] = {}
    found = []
    for time_s, sender, message in sent:
        link = version.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1])
        link.seq = numbering.get(sender, 0)
        numbering[sender] = (link.seq + 1) % 256
        stamp = struct.pack(">Q", EPOCH_US + round(1e6 * time_s))
        found.append(stamp + message.pack(link))
    return found


def log_of(sent: Sequence[Sent], version: Any = mavlink) -> Tlog:
    return Tlog(PATH, b"".join(frames(sent, version)))


def flight_of(sent: Sequence[Sent]) -> FlightData:
    return read_tlog("station", log_of(sent))


def beat(autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mode: int = 5) -> Any:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING,
        autopilot,
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        mode,
        mavlink.MAV_STATE_ACTIVE,
        3,
    )


def attitude(boot_ms: int = 0, roll: float = 0.0) -> Any:
    return mavlink.MAVLink_attitude_message(boot_ms, roll, 0.2, 0.3, 0.4, 0.5, 0.6)


def value(name: str, number: float) -> Any:
    return mavlink.MAVLink_named_value_float_message(0, name.encode(), number)


def reported(*rows: tuple[float, str, float]) -> FlightData:
    """A flight of which the module reported these numbers."""
    return flight_of([(time_s, MODULE, value(name, number)) for time_s, name, number in rows])


def rounded(rows: Sequence[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
    """Events or changes, with times that no clock of a log is finer than."""
    return [(round(row[0], 6), *row[1:]) for row in rows]


# --- frames ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [mavlink, first])
def test_frames_of_both_versions_are_read_with_their_senders(version: Any) -> None:
    sent = [
        (0.25 * i, sender, version.MAVLink_attitude_message(0, 0.1 * i, 0.2, 0.3, 0.4, 0.5, 0.6))
        for i, sender in enumerate((PILOT, PILOT, MODULE, PILOT))
    ]
    log = log_of(sent, version)
    own = log.get("ATTITUDE", *PILOT)
    assert own is not None
    assert own.time_s == pytest.approx([0.0, 0.25, 0.75])
    assert own.columns["roll"] == pytest.approx([0.0, 0.1, 0.3])
    assert own.columns["yawspeed"] == pytest.approx([0.6] * 3)
    assert own.component.tolist() == [1, 1, 1]
    other = log.get("ATTITUDE", *MODULE)
    assert other is not None
    assert other.columns["roll"] == pytest.approx([0.2])
    assert other.system.tolist() == [1]
    assert log.get("ATTITUDE", *STATION) is None
    assert log.get("VFR_HUD", *PILOT) is None
    assert log.lost == []


def test_a_signed_frame_is_as_long_as_its_signature_says() -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.sign_outgoing = True
    link.signing.secret_key = bytes(range(32))
    link.signing.timestamp = 1
    stamp = struct.pack(">Q", EPOCH_US)
    signed = [stamp + attitude(roll=0.1 * i).pack(link) for i in range(3)]
    log = Tlog(PATH, b"".join(signed))
    assert log.lost == []
    assert log.kinds["ATTITUDE"].columns["roll"] == pytest.approx([0.0, 0.1, 0.2])


def test_trailing_zeros_that_were_not_sent_and_arrays_and_texts_are_read() -> None:
    text = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, b"ready")
    battery = mavlink.MAVLink_battery_status_message(
        0, 0, 0, 2500, [4100, 4090, 4080] + [0] * 7, 150, 0, 0, 55
    )
    log = log_of([(0.0, PILOT, text), (0.1, PILOT, battery), (0.2, PILOT, attitude())])
    assert log.kinds["STATUSTEXT"].columns["text"].tolist() == [b"ready"]
    assert log.kinds["BATTERY_STATUS"].columns["voltages"][0, :4].tolist() == [4100, 4090, 4080, 0]
    assert log.kinds["BATTERY_STATUS"].columns["battery_remaining"].tolist() == [55]
    assert log.kinds["BATTERY_STATUS"].columns["temperature"].tolist() == [2500]


def test_bytes_between_frames_are_counted_and_the_next_frame_is_found() -> None:
    """The frame before them is kept, as its checksum is right."""
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(4)])
    rubbish = b"\x00" * 29
    log = Tlog(PATH, rows[0] + rows[1] + rubbish + rows[2] + rows[3])
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 1.0, 2.0, 3.0]
    whole = sum(map(len, rows)) + len(rubbish)
    assert log.lost == [f"{len(rubbish)} of {whole} bytes belong to no whole frame"]


def test_a_frame_that_the_end_cuts_off_is_skipped_whole() -> None:
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(3)])
    cut = rows[2][:-1]
    log = Tlog(PATH, rows[0] + rows[1] + cut)
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 1.0]
    assert log.lost == [f"{len(cut)} of {sum(map(len, rows)) - 1} bytes belong to no whole frame"]


def test_wrong_checksums_and_unknown_messages_are_counted_apart() -> None:
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(6)])
    for i in (1, 2):  # their checksums
        rows[i] = rows[i][:-CHECKSUM] + bytes(byte ^ 0xFF for byte in rows[i][-CHECKSUM:])
    number = slice(8 + 7, 8 + 10)  # of the message, in a frame of version 2 behind its stamp
    strange = bytearray(rows[4])
    strange[number] = (0xFFFFFE).to_bytes(3, "little")
    rows[4] = bytes(strange)
    log = Tlog(PATH, b"".join(rows))
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 3.0, 5.0]
    assert log.lost == [
        "1 frames of messages that are not known here",
        "2 frames with a wrong checksum",
    ]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\xfd" + b"\x00" * 40, "holds not one whole frame"),
        (frames([(0.0, PILOT, attitude())])[0][:-CHECKSUM] + b"\0\0", "not one MAVLink frame"),
    ],
)
def test_what_holds_no_frame_is_refused_by_name(data: bytes, words: str) -> None:
    with pytest.raises(LogError, match=rf"station\.tlog: .*{words}"):
        Tlog(PATH, data)


def numbered(sequence: Sequence[int]) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=7, srcComponent=9)
    data = b""
    for i, number in enumerate(sequence):
        link.seq = number
        data += struct.pack(">Q", EPOCH_US + i) + attitude().pack(link)
    return data


@pytest.mark.parametrize(
    ("sequence", "lost"),
    [
        ([3, 4, 5], 0),
        ([3, 4, 7], 2),
        ([254, 255, 0, 1], 0),  # it starts again after 255
        ([254, 1], 2),
        ([10, 10, 11], 0),  # received twice
        ([10, 12, 11, 13], 2),  # late, not lost: a step back is no loss of 254
        ([0, 199], 198),
        ([0, 200], 0),  # rather a step back by 56
    ],
)
def test_gaps_in_the_numbering_are_losses(sequence: list[int], lost: int) -> None:
    assert Tlog(PATH, numbered(sequence)).loss == {"system 7, component 9": (len(sequence), lost)}


# --- time -----------------------------------------------------------------------------------------


def test_time_is_the_autopilots_once_it_tells_it_ten_times() -> None:
    """A simulation at double speed: the recorder's clock counts half of the flight's time."""

    def double(n: int) -> Tlog:
        return log_of([(0.05 * i, PILOT, attitude(boot_ms=7000 + 100 * i)) for i in range(n)])

    assert double(10).kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(10))
    assert double(9).kinds["ATTITUDE"].time_s == pytest.approx(0.05 * np.arange(9))
    assert double(9).lost == double(10).lost == []


def test_what_has_no_clock_of_its_own_came_between_its_neighbours() -> None:
    sent: list[Sent] = []
    for i in range(12):
        sent.append((0.05 * i, PILOT, attitude(boot_ms=1000 + 100 * i)))
        sent.append((0.05 * i + 0.01, STATION, beat()))
    log = log_of(sent)
    assert log.kinds["HEARTBEAT"].time_s[:11] == pytest.approx(0.1 * np.arange(11) + 0.05)
    assert log.kinds["ATTITUDE"].time_s[0] == 0.0


def test_another_components_clock_is_not_the_autopilots() -> None:
    sent = [(0.05 * i, MODULE, attitude(boot_ms=1000 + 100 * i)) for i in range(12)]
    assert log_of(sent).kinds["ATTITUDE"].time_s == pytest.approx(0.05 * np.arange(12))


def clocked(boot_ms: Sequence[int], step_s: float = 0.1) -> Tlog:
    return log_of([(step_s * i, PILOT, attitude(boot_ms=ms)) for i, ms in enumerate(boot_ms)])


def test_after_a_reset_of_the_autopilots_clock_times_are_the_recorders() -> None:
    steady = [1000 + 100 * i for i in range(5)]
    log = clocked([9000 + ms for ms in steady] + steady)
    assert log.kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(10))
    assert log.lost == ["the autopilot's clock was reset: times are the recorder's"]


def test_a_sample_that_came_late_resets_no_clock() -> None:
    """Four tenths late: less than the half second by which a clock counts as set back."""
    boots = [1000 + 100 * i for i in range(12)]
    boots[6] -= 500  # a step of -0.4 s from its predecessor
    log = clocked(boots)
    assert log.lost == []
    times = log.kinds["ATTITUDE"].time_s
    assert np.all(np.diff(times) >= 0.0)
    assert times[5:8] == pytest.approx([0.5, 0.5, 0.7])


def test_a_recorders_clock_that_leaps_is_named_and_not_used() -> None:
    sent = [(0.1 * i, PILOT, attitude(boot_ms=1000 + 100 * i)) for i in range(12)]
    back = [(t - (5.0 if i > 5 else 0.0), who, what) for i, (t, who, what) in enumerate(sent)]
    ahead = [(t + (9e4 if i > 5 else 0.0), who, what) for i, (t, who, what) in enumerate(sent)]
    for leapt in (back, ahead):
        log = log_of(leapt)
        assert log.lost == ["the recorder's clock leaps: times are the autopilot's"]
        assert log.kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(12))


def test_a_stamp_decades_away_is_accepted_of_a_whole_frame_alone() -> None:
    """A recorder that boots in 1970 and is set in flight; bytes that only look like a frame."""
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(4)])
    booted = [struct.pack(">Q", 1_000_000 + i) + row[8:] for i, row in enumerate(rows[:2])]
    set_in_flight = b"".join([*booted, *rows[2:]])
    log = Tlog(PATH, set_in_flight)
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 1.0, 2.0, 3.0]
    wrong = rows[2][:-1] + bytes([rows[2][-1] ^ 1])
    log = Tlog(PATH, b"".join([*booted, wrong, rows[3]]))
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 1.0, 3.0]
    assert log.lost[0].startswith(f"{len(wrong)} of ")
    late = struct.pack(">Q", EPOCH_US + 86_400_000_000) + wrong[8:]  # a day: that it may be
    log = Tlog(PATH, b"".join([*rows[:2], late]))
    assert log.lost[0] == "1 frames with a wrong checksum"


# --- what stands in the messages ------------------------------------------------------------------


def test_the_vehicle_is_the_system_whose_autopilot_beats_most() -> None:
    station = beat(mavlink.MAV_AUTOPILOT_INVALID)
    sent = [(0.1 * i, STATION, station) for i in range(5)]
    sent += [(0.6 + 0.1 * i, (4, 1), beat()) for i in range(3)]
    sent += [(1.0, PILOT, beat()), (1.1, (4, 1), attitude()), (1.2, PILOT, attitude(roll=0.5))]
    flight = flight_of(sent)
    assert flight.attitude is not None
    assert flight.attitude["roll_rad"] == pytest.approx([0.0])
    assert rounded(flight.autopilot_modes) == [(0.6, "FBWA")]


def test_without_any_autopilots_heartbeat_the_vehicle_is_who_sends_most() -> None:
    sent = [(0.0, (3, 1), attitude(roll=0.3)), (0.1, (3, 1), attitude()), (0.2, PILOT, attitude())]
    flight = flight_of(sent)
    assert flight.attitude is not None
    assert flight.attitude["roll_rad"] == pytest.approx([0.3, 0.0])


def test_changes_of_the_autopilots_mode_have_its_firmwares_names() -> None:
    """ArduPlane's custom modes: 5 is FBWA, 11 RTL."""
    sent = [(float(i), PILOT, beat(mode=mode)) for i, mode in enumerate((5, 5, 11, 5))]
    changes = [(0.0, "FBWA"), (2.0, "RTL"), (3.0, "FBWA")]
    assert rounded(flight_of(sent).autopilot_modes) == changes


def test_a_local_position_is_taken_as_it_is_with_its_velocity() -> None:
    local = mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, -3.0, 0.4, 0.5, -0.6)
    world = mavlink.MAVLink_global_position_int_message(0, 470_000_000, 0, 0, 0, 100, 0, 0, 0)
    flight = flight_of([(0.0, PILOT, local), (0.1, PILOT, world)])
    assert flight.position is not None
    assert flight.velocity is not None
    assert [flight.position[c][0] for c in ("north_m", "east_m", "down_m")] == [1.0, 2.0, -3.0]
    assert [flight.velocity[c][0] for c in ("north_mps", "east_mps", "down_mps")] == pytest.approx(
        [0.4, 0.5, -0.6]
    )
    assert flight.position.source == flight.velocity.source == "LOCAL_POSITION_NED"
    assert flight.absolute_positions
    assert not any("first fix" in words for words in flight.missing)


LAT, LON, ALT_MM = 470_000_000, 85_000_000, 400_000  # 47 deg north, 8.5 deg east, 400 m
STEP = 1000  # 1e-4 deg


def moved(at: float) -> Sent:
    """One step north, two east, three metres up, at 1, 2 and -3 m/s."""
    place = (LAT + STEP, LON + 2 * STEP, ALT_MM + 3000)
    message = mavlink.MAVLink_global_position_int_message(0, *place, 0, 100, 200, -300, 0)
    return at, PILOT, message


def begun(at: float) -> Sent:
    message = mavlink.MAVLink_global_position_int_message(0, LAT, LON, ALT_MM, 0, 0, 0, 0, 0)
    return at, PILOT, message


def assert_moved(flight: FlightData) -> None:
    arc_m = 2.0 * pi * EARTH_RADIUS_M * 1e-4 / 360.0
    assert flight.position is not None
    assert flight.position.source == "GLOBAL_POSITION_INT"
    assert flight.position["north_m"][-1] == pytest.approx(arc_m)
    assert flight.position["east_m"][-1] == pytest.approx(2.0 * arc_m * cos(radians(47.0)))
    assert flight.position["down_m"][-1] == pytest.approx(-3.0)


def test_a_global_position_is_measured_from_the_first_and_says_so() -> None:
    flight = flight_of([begun(0.0), moved(1.0)])
    assert_moved(flight)
    assert flight.position is not None
    assert [flight.position[c][0] for c in ("north_m", "east_m", "down_m")] == [0.0, 0.0, 0.0]
    assert flight.velocity is not None
    assert [flight.velocity[c][1] for c in ("north_mps", "east_mps", "down_mps")] == pytest.approx(
        [1.0, 2.0, -3.0]
    )
    assert flight.velocity.source == "GLOBAL_POSITION_INT"
    assert not flight.absolute_positions
    assert flight.missing[0].startswith("positions are measured from the first fix")


def test_a_global_position_is_measured_from_the_origin_that_was_reported_last() -> None:
    early = mavlink.MAVLink_gps_global_origin_message(LAT + 5000, LON - 5000, 0)
    last = mavlink.MAVLink_gps_global_origin_message(LAT, LON, ALT_MM)
    origins = (early, early, last)
    flight = flight_of([*((0.1 * i, PILOT, each) for i, each in enumerate(origins)), moved(1.0)])
    assert_moved(flight)
    assert flight.absolute_positions


def test_without_any_position_none_is_missing_its_origin() -> None:
    flight = flight_of([(0.0, PILOT, attitude())])
    assert flight.position is flight.velocity is None
    assert "the log holds no position (local NED)" in flight.missing
    assert not any("first fix" in words for words in flight.missing)


def turned() -> Any:
    """A quarter turn to the right, with its rates."""
    half = 0.5**0.5
    return mavlink.MAVLink_attitude_quaternion_message(0, half, 0.0, 0.0, half, 1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("quaternions", "angles", "source"),
    [(1, 0, True), (2, 2, True), (3, 2, True), (2, 3, False), (0, 1, False)],
)
def test_attitude_and_rates_are_of_the_message_that_comes_oftener(
    quaternions: int, angles: int, source: bool
) -> None:
    sent: list[Sent] = [(0.1 * i, PILOT, turned()) for i in range(quaternions)]
    sent += [(0.5 + 0.1 * i, PILOT, attitude(roll=0.1)) for i in range(angles)]
    flight = flight_of(sent)
    assert flight.attitude is not None
    assert flight.rates is not None
    expected = (0.0, 0.0, 0.5 * pi, 1.0, 2.0, 3.0) if source else (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    names = ("roll_rad", "pitch_rad", "yaw_rad")
    assert [flight.attitude[name][0] for name in names] == pytest.approx(expected[:3], abs=1e-6)
    axes = ("roll", "pitch", "yaw")
    rates = [flight.rates[f"{axis}_rate_frd_radps"][0] for axis in axes]
    assert rates == pytest.approx(expected[3:])
    name = "ATTITUDE_QUATERNION" if source else "ATTITUDE"
    assert flight.attitude.source == flight.rates.source == name


def imu_of(flight: FlightData) -> list[float]:
    assert flight.imu is not None
    return [float(values[0]) for values in flight.imu.columns.values()]


@pytest.mark.parametrize("kind", ["scaled_imu", "raw_imu"])
def test_scaled_accelerations_are_thousandths_of_gravity_and_of_a_radian(kind: str) -> None:
    make = getattr(mavlink, f"MAVLink_{kind}_message")
    message = make(0, 100, -200, -1000, 10, 20, -30, 0, 0, 0)
    flight = flight_of([(0.0, PILOT, message)])
    g = STANDARD_GRAVITY_MPS2
    assert imu_of(flight) == pytest.approx([0.1 * g, -0.2 * g, -g, 0.01, 0.02, -0.03])
    assert flight.imu is not None
    assert flight.imu.source == kind.upper()


def test_accelerations_that_are_reported_finely_come_first() -> None:
    fine = mavlink.MAVLink_highres_imu_message(
        0, 1.0, 2.0, -9.5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    )
    rough = mavlink.MAVLink_scaled_imu_message(0, 1, 1, 1, 1, 1, 1, 0, 0, 0)
    flight = flight_of([(0.0, PILOT, rough), (0.1, PILOT, fine)])
    assert imu_of(flight) == pytest.approx([1.0, 2.0, -9.5, 0.1, 0.2, 0.3])
    assert flight_of([(0.0, PILOT, beat())]).imu is None


def test_the_outputs_are_all_channels_that_are_ever_moved() -> None:
    pulses = {1: 1501, 2: 1502, 8: 1508, 9: 1509, 16: 1516}
    channels = [pulses.get(channel, 0) for channel in range(1, 17)]
    message = mavlink.MAVLink_servo_output_raw_message(0, 0, *channels)
    still = mavlink.MAVLink_servo_output_raw_message(0, 0, *([0] * 16))
    flight = flight_of([(0.0, PILOT, still), (0.1, PILOT, message)])
    assert flight.outputs is not None
    found = {name: values.tolist() for name, values in flight.outputs.columns.items()}
    assert found == {str(channel): [0.0, float(us)] for channel, us in pulses.items()}


def test_a_second_ports_outputs_are_not_the_firsts() -> None:
    rows = [
        (0.1 * k, PILOT, mavlink.MAVLink_servo_output_raw_message(0, port, *([us] * 8)))
        for k, (port, us) in enumerate(((0, 1500), (1, 1900), (0, 1600), (1, 1000)))
    ]
    outputs = flight_of(rows).outputs
    assert outputs is not None
    assert outputs["1"].tolist() == [1500.0, 1600.0]
    assert flight_of(rows[1:2]).outputs is None


def hud(airspeed: float, height: float = 0.0) -> Any:
    return mavlink.MAVLink_vfr_hud_message(airspeed, 12.0, 180, 55, height, 1.0)


def pitot(health: int, present: int = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE) -> Any:
    return mavlink.MAVLink_sys_status_message(present, present, health, *([0] * 10))


PITOT = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE


def test_an_airspeed_is_one_while_a_pitot_tube_is_healthy() -> None:
    """Without one an autopilot shows an estimate in the same field."""
    sent = [
        (0.0, PILOT, hud(9.0)),  # nothing is known yet
        (0.1, PILOT, pitot(PITOT)),
        (0.2, PILOT, hud(9.1)),
        (0.3, PILOT, pitot(~PITOT & 0xFFFF)),
        (0.4, PILOT, hud(9.2)),
        (0.5, PILOT, pitot(PITOT)),
        (0.6, PILOT, hud(9.3)),
    ]
    airspeed = flight_of(sent).airspeed
    assert airspeed is not None
    assert airspeed["airspeed_mps"] == pytest.approx([nan, 9.1, nan, 9.3], nan_ok=True)


@pytest.mark.parametrize("status", [[], [pitot(0)], [pitot(PITOT, present=0)]])
def test_without_a_pitot_tube_there_is_no_airspeed(status: list[Any]) -> None:
    flight = flight_of([*((0.0, PILOT, each) for each in status), (0.1, PILOT, hud(0.0))])
    assert flight.airspeed is None
    assert "the log holds no airspeed" in flight.missing


def test_an_airspeed_is_the_true_one() -> None:
    """At 1500 m the standard atmosphere has 0.8638 of the density of sea level (ICAO)."""
    airspeed = flight_of([(0.0, PILOT, pitot(PITOT)), (0.1, PILOT, hud(10.0, 1500.0))]).airspeed
    assert airspeed is not None
    assert airspeed["airspeed_mps"] == pytest.approx([10.0 / 0.8638**0.5], rel=1e-4)


def test_texts_and_streams_are_reported() -> None:
    text = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_INFO, "höher ".encode())
    flight = flight_of([(0.0, PILOT, hud(9.5, 400.0)), (2.0, MODULE, text)])
    assert rounded(flight.events) == [(2.0, "message", "höher")]
    assert sorted(flight.streams) == ["STATUSTEXT", "VFR_HUD"]
    assert flight.streams["STATUSTEXT"] == pytest.approx([2.0])
    assert flight.loss == {"system 1, component 1": (1, 0), "system 1, component 191": (1, 0)}
    assert (flight.name, flight.kind) == ("station", "MAVLink telemetry log (.tlog)")


def test_a_parameter_is_as_it_was_first_reported_and_a_change_is_an_event() -> None:
    def parameter(number: float) -> Any:
        real = mavlink.MAV_PARAM_TYPE_REAL32
        return mavlink.MAVLink_param_value_message(b"PIT_P", number, real, 1, 0)

    flight = flight_of([(float(i), MODULE, parameter(n)) for i, n in enumerate((0.5, 0.5, 0.75))])
    assert flight.parameters == {"PIT_P": 0.5}
    assert rounded(flight.events) == [(2.0, "parameter", "PIT_P 0.5 → 0.75")]


def whole(number: int) -> float:
    """Its four bytes as a float's."""
    return float(struct.unpack("<f", struct.pack("<i", number))[0])


def test_whole_numbers_of_px4_are_their_four_bytes_and_the_modules_their_values() -> None:
    def sent(name: str, number: float, kind: int = mavlink.MAV_PARAM_TYPE_INT32) -> Any:
        return mavlink.MAVLink_param_value_message(name.encode(), number, kind, 1, 0)

    rows = [
        (0.0, PILOT, beat(mavlink.MAV_AUTOPILOT_PX4)),
        (1.0, PILOT, sent("COM_FLTMODE1", whole(-1))),
        (2.0, PILOT, sent("COM_FLTMODE1", whole(-1))),
        (3.0, PILOT, sent("COM_FLTMODE1", whole(2))),
        (4.0, PILOT, sent("FW_P", 0.5, mavlink.MAV_PARAM_TYPE_REAL32)),
        (5.0, MODULE, sent("TGL_HOLD", 1.0)),
    ]
    flight = flight_of(rows)
    assert flight.parameters == {"COM_FLTMODE1": -1.0, "FW_P": 0.5, "TGL_HOLD": 1.0}
    assert rounded(flight.events) == [(3.0, "parameter", "COM_FLTMODE1 -1 → 2")]
    ardupilot = flight_of([(0.0, PILOT, beat()), (1.0, PILOT, sent("LIM", 3.0))])
    assert ardupilot.parameters == {"LIM": 3.0}


def test_what_is_no_number_and_what_other_vehicles_have_is_no_change() -> None:
    real = mavlink.MAV_PARAM_TYPE_REAL32
    sent = [(PILOT, 0.5), (PILOT, nan), ((2, 1), 0.7), (PILOT, 0.5)]
    rows = [
        (1.0 + i, who, mavlink.MAVLink_param_value_message(b"PIT_P", number, real, 1, 0))
        for i, (who, number) in enumerate(sent)
    ]
    flight = flight_of([(0.0, PILOT, beat()), *rows])
    assert flight.parameters == {"PIT_P": 0.5}
    assert flight.events == ()


def test_what_the_log_does_not_hold_is_listed() -> None:
    words = " ".join(flight_of([(0.0, PILOT, beat())]).missing)
    for lacking in ("position", "attitude", "airspeed", "setpoints", "e_rho", "line", "updraft"):
        assert lacking in words


# --- what the module reports, in the operator's units ---------------------------------------------


def test_setpoint_and_stall_margin_are_reported_in_degrees() -> None:
    flight = reported((0.0, "pitch_sp", -6.0), (1.0, "clearance", 12.5), (1.0, "stall", 3.0))
    assert flight.setpoints is not None
    assert np.degrees(flight.setpoints["pitch_rad"]) == pytest.approx([-6.0])
    assert np.isnan([flight.setpoints[c][0] for c in ("roll_rad", "heading_rad")]).all()
    assert flight.margins is not None
    assert flight.margins["clearance_m"] == pytest.approx([12.5])
    assert [degrees(angle) for angle in flight.margins["stall_rad"]] == pytest.approx([3.0])


def test_a_lean_is_reported_from_the_upright_and_the_line_from_the_horizontal() -> None:
    flight = reported((0.0, "line_x", -4.0), (0.0, "line_z", 7.0), (0.0, "line_lean", 15.0))
    assert flight.line is not None
    assert flight.line["x_m"] == pytest.approx([-4.0])
    assert flight.line["z_m"] == pytest.approx([7.0])
    assert np.degrees(flight.line["eta_rad"]) == pytest.approx([105.0])
    assert reported((0.0, "line_x", -4.0), (0.0, "line_z", 7.0)).line is None


@pytest.mark.parametrize(
    ("series", "names"),
    [
        ("tracking", {"e_rho_m": "e_rho"}),
        ("path", {"x_m": "soar_x", "z_m": "soar_z"}),
        (
            "ages",
            {"position_age_s": "age_pos", "attitude_age_s": "age_att", "heartbeat_age_s": "age_ap"},
        ),
        (
            "forecast",
            {"standing": "fc_state", "chance": "fc_chance", "ahead_s": "fc_time", "z_m": "fc_z"},
        ),
        ("point", {"standing": "pt_state", "off_m": "pt_off", "brake": "brake"}),
        ("air", {"wind_mps": "wind", "updraft_mps": "updraft"}),
    ],
)
def test_each_number_that_is_reported_goes_to_its_column(
    series: str, names: dict[str, str]
) -> None:
    numbers = {column: 1.5 + i for i, column in enumerate(names)}
    rows = [(0.0, names[column], number) for column, number in numbers.items()]
    found = getattr(reported(*rows), series)
    for column, number in numbers.items():
        assert found[column] == pytest.approx([number])
    if series not in ("tracking", "air"):  # one of them alone says nothing
        assert getattr(reported(*rows[1:]), series) is None


def test_numbers_reported_in_turn_stand_until_they_are_reported_again() -> None:
    flight = reported(
        (0.0, "soar_x", 1.0), (1.0, "soar_z", 20.0), (2.0, "soar_x", 3.0), (3.0, "soar_z", 40.0)
    )
    assert flight.path is not None
    assert flight.path.time_s == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert flight.path["x_m"] == pytest.approx([1.0, 1.0, 3.0, 3.0])
    assert flight.path["z_m"] == pytest.approx([nan, 20.0, 20.0, 40.0], nan_ok=True)
    assert np.isnan(flight.path["y_m"]).all()


def test_the_updraft_alone_is_reported_without_a_wind() -> None:
    flight = reported((0.0, "updraft", 0.8), (1.0, "updraft", 0.9))
    assert flight.air is not None
    assert flight.air["updraft_mps"] == pytest.approx([0.8, 0.9])
    assert np.isnan(flight.air["wind_mps"]).all()
    assert reported((0.0, "wind", 6.0)).air is None


def test_the_modules_modes_are_reported_by_number() -> None:
    rows = ((0.0, 0.0), (1.0, 1.0), (2.0, nan), (3.0, 1.0), (4.0, 0.0))
    flight = reported(*((t, "soar_mode", number) for t, number in rows))
    assert rounded(flight.modes) == [(0.0, "boot"), (1.0, "standby"), (4.0, "boot")]
