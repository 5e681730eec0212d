"""A DataFlash log written here byte by byte: kinds, scales, what of a flight is read from which
record, and what damage costs."""

from __future__ import annotations

import struct
from math import nan, pi, radians
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.logs.dataflash import Dataflash, read_dataflash
from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode
from tgl_soar.analysis.logs.ulog_reader import LogError

PATH = Path("flight.bin")
HEAD = b"\xa3\x95"
# Letters of a format, as ArduPilot's documentation has them.
CODES = {"B": "B", "b": "b", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "Q": "Q",
         "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q",
         "n": "4s", "N": "16s", "Z": "64s"}  # fmt: skip


def size_of(letters: str) -> int:
    return struct.calcsize("<" + "".join(CODES[letter] for letter in letters))


def described(number: int, name: str, letters: str, columns: str, length: int = 0) -> bytes:
    """A FMT record."""
    body = struct.pack(
        "<BB4s16s64s",
        number,
        length or 3 + size_of(letters),
        name.encode(),
        letters.encode(),
        columns.encode(),
    )
    return HEAD + b"\x80" + body


def record(number: int, letters: str, *values: object) -> bytes:
    code = "<" + "".join(CODES[letter] for letter in letters)
    return HEAD + bytes([number]) + struct.pack(code, *values)


class Kind:
    """One kind of record."""

    def __init__(self, number: int, name: str, letters: str, columns: str) -> None:
        self._number, self._letters = number, letters
        self.head = described(number, name, letters, columns)

    def __call__(self, *values: object) -> bytes:
        return record(self._number, self._letters, *values)


ATT = Kind(1, "ATT", "Qccccff", "TimeUS,Roll,Pitch,DesRoll,DesPitch,Yaw,Other")
XKF1 = Kind(2, "XKF1", "QBffffff", "TimeUS,C,PN,PE,PD,VN,VE,VD")
NKF1 = Kind(3, "NKF1", "Qffffff", "TimeUS,PN,PE,PD,VN,VE,VD")
IMU = Kind(4, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
ARSP = Kind(5, "ARSP", "Qf", "TimeUS,Airspeed")
RCOU = Kind(6, "RCOU", "QHHf", "TimeUS,C1,C12,Cx")
MODE = Kind(7, "MODE", "QBB", "TimeUS,Mode,ModeNum")
MSG = Kind(8, "MSG", "QZ", "TimeUS,Message")
EV = Kind(9, "EV", "QB", "TimeUS,Id")
ERR = Kind(10, "ERR", "QBB", "TimeUS,Subsys,ECode")
PARM = Kind(11, "PARM", "QNf", "TimeUS,Name,Value")
DSF = Kind(12, "DSF", "QI", "TimeUS,Dp")


def text(words: str) -> bytes:
    return words.encode()


def at(seconds: float) -> int:
    """A stamp: the flight begins 10 s after boot."""
    return round(1e6 * (10.0 + seconds))


def read(*parts: bytes) -> FlightData:
    return read_dataflash("flight.bin", Dataflash(PATH, b"".join(parts)))


def still(seconds: float) -> bytes:
    return ATT(at(seconds), 0, 0, 0, 0, 0.0, 0.0)


# --- records ------------------------------------------------------------------------------------


def test_records_are_read_by_kind_and_scaled() -> None:
    """A centidegree is a hundredth, and a latitude 1e-7 of a degree."""
    place = Kind(20, "GPS", "QLeEChbn", "TimeUS,Lat,Alt,Spd,Dir,A,B,Note")
    log = Dataflash(
        PATH,
        place.head
        + ATT.head
        + place(7, 471234567, -250, 1234, 35999, -300, -5, b"ab")
        + still(0.0),
    )
    assert "GPS" in log
    assert "XKF1" not in log
    assert log.lost == []
    columns = log.columns("GPS")
    assert list(columns) == ["TimeUS", "Lat", "Alt", "Spd", "Dir", "A", "B", "Note"]
    assert [columns[name][0] for name in ("TimeUS", "A", "B", "Note")] == [7, -300, -5, b"ab"]
    assert columns["Lat"][0] == pytest.approx(47.1234567)
    assert [columns[name][0] for name in ("Alt", "Spd", "Dir")] == pytest.approx(
        [-2.5, 12.34, 359.99]
    )


def test_kinds_without_a_time_and_texts_that_are_called_numbers_are_not_used() -> None:
    untimed = Kind(21, "UNIT", "fN", "Value,Name")
    odd = Kind(22, "ODD", "QNff", "TimeUS,Roll,Name,Pitch")
    log = Dataflash(PATH, untimed.head + odd.head + untimed(1.0, b"x") + odd(5, b"text", 1.0, 2.0))
    timed = log.timed()
    assert list(timed) == ["ODD"]
    assert list(timed["ODD"]) == ["TimeUS", "Pitch"]


def test_bytes_of_no_record_are_counted_and_skipped() -> None:
    whole = ATT.head + still(0.0)
    log = Dataflash(PATH, b"junk" + whole + HEAD + b"\x63" + b"ab" + still(1.0) + still(2.0)[:-1])
    assert len(log.columns("ATT")["TimeUS"]) == 2
    lost = 4 + 5 + len(still(2.0)) - 1
    total = 4 + len(whole) + 5 + len(still(1.0)) + len(still(2.0)) - 1
    assert log.lost == [
        f"{lost} of {total} bytes belong to no whole record: the file is cut off or damaged there"
    ]


def test_a_file_without_one_whole_record_is_refused() -> None:
    for data in (HEAD, HEAD + b"\x80" + bytes(20), ATT.head, b"nothing at all"):
        with pytest.raises(LogError, match=r"flight\.bin: begins like a DataFlash log and holds"):
            Dataflash(PATH, data)


@pytest.mark.parametrize(
    "head",
    [
        described(1, "ATT", "Qcc", "TimeUS,Roll,Pitch", length=99),  # another length
        described(1, "ATT", "Q?c", "TimeUS,Roll,Pitch", length=14),  # no letter
        described(1, "ATT", "Qcc", "TimeUS,Roll"),
        described(1, "ATT", "Qcc", "TimeUS,Roll,Roll"),
        described(1, "ATT", "Qcc", "TimeUS,Roll,"),
    ],
)
def test_a_description_that_makes_no_sense_describes_nothing(head: bytes) -> None:
    log = Dataflash(PATH, head + ARSP.head + record(1, "Qcc", 1, 2, 3) + ARSP(1, 2.0))
    assert "ATT" not in log
    assert "ARSP" in log


def test_the_description_of_descriptions_stays_what_it_is() -> None:
    own = described(0x80, "FMT", "Qf", "TimeUS,X")
    log = Dataflash(PATH, own + ARSP.head + ARSP(1, 2.0))
    assert log.columns("ARSP")["Airspeed"].tolist() == [2.0]


def test_a_number_that_is_described_again_stands_for_another_kind_from_there_on() -> None:
    other = Kind(5, "BARO", "Qd", "TimeUS,Alt")
    log = Dataflash(
        PATH, ARSP.head + ARSP(1, 2.0) + ARSP.head + ARSP(2, 3.0) + other.head + other(3, 4.0)
    )
    assert log.columns("ARSP")["Airspeed"].tolist() == [2.0, 3.0]
    assert log.columns("BARO")["Alt"].tolist() == [4.0]
    # Of two descriptions of one name the one with more records is in use.
    longer = Kind(30, "ARSP", "Qff", "TimeUS,Airspeed,Temp")
    log = Dataflash(
        PATH, ARSP.head + longer.head + ARSP(1, 2.0) + longer(2, 5.0, 1.0) + longer(3, 6.0, 1.0)
    )
    assert log.columns("ARSP")["Airspeed"].tolist() == [5.0, 6.0]


# --- a flight -----------------------------------------------------------------------------------


def test_attitudes_are_radians_and_yaw_within_a_half_turn() -> None:
    flight = read(
        ATT.head,
        ATT(at(0.0), 1000, -500, 300, 250, 350.0, 0.0),
        ATT(at(0.5), 0, 0, 0, 0, 90.0, 0.0),
    )
    assert flight.kind == "ArduPilot DataFlash log"
    assert flight.name == "flight.bin"
    attitude, setpoints = flight.attitude, flight.setpoints
    assert attitude is not None
    assert setpoints is not None
    assert attitude.time_s.tolist() == pytest.approx([0.0, 0.5])
    assert attitude["roll_rad"] == pytest.approx([radians(10.0), 0.0])
    assert attitude["pitch_rad"] == pytest.approx([radians(-5.0), 0.0])
    assert attitude["yaw_rad"] == pytest.approx([radians(-10.0), 0.5 * pi], rel=1e-5)
    assert setpoints["roll_rad"] == pytest.approx([radians(3.0), 0.0])
    assert setpoints["pitch_rad"] == pytest.approx([radians(2.5), 0.0])
    assert np.isnan(setpoints["heading_rad"]).all()


def test_of_several_estimators_and_sensors_the_first_is_taken() -> None:
    rows = (XKF1(at(0.0), 0, *range(1, 7)), XKF1(at(0.0), 1, *range(11, 17)))
    older = NKF1(at(0.0), *range(21, 27))
    sensors = (IMU(at(0.0), 1, *range(31, 37)), IMU(at(0.1), 0, *range(41, 47)))
    flight = read(XKF1.head, NKF1.head, IMU.head, *rows, older, *sensors)
    position, velocity, imu = flight.position, flight.velocity, flight.imu
    assert position is not None
    assert velocity is not None
    assert imu is not None
    assert [position[c].tolist() for c in ("north_m", "east_m", "down_m")] == [[1], [2], [3]]
    assert [velocity[c].tolist() for c in ("north_mps", "east_mps", "down_mps")] == [[4], [5], [6]]
    rates = [f"{axis}_rate_frd_radps" for axis in ("roll", "pitch", "yaw")]
    assert [imu[c].tolist() for c in rates] == [[41], [42], [43]]
    forces = [f"force_{axis}_frd_mps2" for axis in "xyz"]
    assert [imu[c].tolist() for c in forces] == [[44], [45], [46]]
    alone = read(NKF1.head, older).position
    assert alone is not None
    assert alone["north_m"].tolist() == [21]


def test_airspeed_and_servo_outputs_are_read() -> None:
    flight = read(ARSP.head, RCOU.head, ARSP(at(0.0), 8.5), RCOU(at(0.2), 1500, 1100, 7.0))
    assert flight.airspeed is not None
    assert flight.airspeed["airspeed_mps"].tolist() == [8.5]
    assert flight.outputs is not None
    assert set(flight.outputs.columns) == {"1", "12"}
    assert flight.outputs["12"].tolist() == [1100]
    assert set(flight.streams) == {"ARSP", "RCOU"}
    assert flight.streams["RCOU"] == pytest.approx([0.2])


HEALTHY = Kind(13, "ARSP", "QfBB", "TimeUS,Airspeed,U,H")


def test_an_airspeed_is_one_while_its_sensor_is_healthy() -> None:
    rows = [HEALTHY(at(t), 8.0 + t, 1, well) for t, well in ((0.0, 1), (1.0, 0), (2.0, 1))]
    airspeed = read(HEALTHY.head, *rows).airspeed
    assert airspeed is not None
    assert airspeed["airspeed_mps"] == pytest.approx([8.0, nan, 10.0], nan_ok=True)
    never = read(HEALTHY.head, HEALTHY(at(0.0), 8.0, 1, 0))
    assert never.airspeed is None
    assert "the log holds no airspeed" in never.missing


@pytest.mark.parametrize("kind", ["POS", "AHR2", "GPS"])
def test_an_airspeed_is_the_true_one(kind: str) -> None:
    """At 1500 m the standard atmosphere has 0.8638 of the density of sea level (ICAO), and at the
    sea all of it."""
    height = Kind(14, kind, "Qf", "TimeUS,Alt")
    heights = (height(at(1.0), 0.0), height(at(2.0), 1500.0))
    speeds = [ARSP(at(t), 10.0) for t in (0.0, 1.0, 2.0, 3.0)]
    airspeed = read(ARSP.head, height.head, *heights, *speeds).airspeed
    assert airspeed is not None
    high = 10.0 / 0.8638**0.5
    assert airspeed["airspeed_mps"] == pytest.approx([10.0, 10.0, high, high], rel=1e-4)


def test_of_several_altitudes_that_of_the_estimate_is_taken() -> None:
    heights = [Kind(14 + i, name, "Qf", "TimeUS,Alt") for i, name in enumerate(("GPS", "POS"))]
    rows = (heights[0](at(0.0), 3000.0), heights[1](at(0.0), 0.0))
    airspeed = read(ARSP.head, *(h.head for h in heights), *rows, ARSP(at(0.0), 10.0)).airspeed
    assert airspeed is not None
    assert airspeed["airspeed_mps"] == pytest.approx([10.0])


def test_what_the_log_lacks_is_named_and_none() -> None:
    flight = read(ARSP.head, ARSP(at(0.0), 8.5))
    assert flight.attitude is None
    assert flight.setpoints is None
    assert flight.position is None
    assert flight.autopilot_modes == ()
    words = " ".join(flight.missing)
    for name in ("position", "attitude", "setpoints"):
        assert name in words
    assert "airspeed" not in words


def test_modes_are_those_of_a_fixed_wing() -> None:
    rows = [MODE(at(t), 0, n) for t, n in ((0.0, 5), (1.0, 5), (2.0, 11), (3.0, 99))]
    flight = read(MODE.head, *rows)
    assert flight.autopilot_modes == (
        LoggedMode(0.0, "FBWA"),
        LoggedMode(2.0, "RTL"),
        LoggedMode(3.0, "mode 99"),
    )
    older = Kind(7, "MODE", "QB", "TimeUS,Mode")
    assert read(older.head, older(at(0.0), 5)).autopilot_modes == (LoggedMode(0.0, "FBWA"),)


def test_messages_events_and_errors_are_reported_in_order() -> None:
    flight = read(
        *(MSG.head, EV.head, ERR.head),
        MSG(at(0.0), text("ArduPlane V4.5 ")),
        EV(at(1.0), 10),
        EV(at(3.0), 11),
        ERR(at(2.0), 12, 1),
        EV(at(4.0), 77),
    )
    assert flight.events == (
        Event(0.0, "message", "ArduPlane V4.5"),
        Event(1.0, "message", "armed"),
        Event(2.0, "message", "error 1 of subsystem 12"),
        Event(3.0, "message", "disarmed"),
        Event(4.0, "message", "event 77"),
    )
    assert flight.metadata == {"firmware": "ArduPlane V4.5"}
    assert read(MSG.head, MSG(at(0.0), text("hello"))).metadata == {}


def test_a_parameters_first_value_is_its_own_and_the_others_are_changes() -> None:
    flight = read(
        PARM.head,
        PARM(at(0.0), text("TRIM"), 2.0),
        PARM(at(0.0), text("RATE"), 7.0),
        PARM(at(5.0), text("TRIM"), 3.0),
    )
    assert flight.parameters == {"TRIM": 2.0, "RATE": 7.0}
    (change,) = [event for event in flight.events if event.kind == "parameter"]
    assert change.time_s == pytest.approx(5.0)
    assert "TRIM" in change.text
    assert "3" in change.text


def test_what_the_writer_dropped_is_reported() -> None:
    flight = read(DSF.head, DSF(at(0.0), 3), DSF(at(1.0), 8), DSF(at(2.0), 8))
    assert "the writer dropped 8 records" in flight.lost
    assert read(DSF.head, DSF(at(0.0), 0)).lost == ()


def test_losses_of_the_file_and_of_its_clock_are_reported_too() -> None:
    flight = read(b"xyz", ARSP.head, *(ARSP(at(0.1 * n), 8.0) for n in range(10)))
    assert len(flight.lost) == 1
    assert flight.lost[0].startswith("3 of ")
    late = read(ARSP.head, *(ARSP(at(0.1 * n + 100.0 * (n > 5)), 8.0) for n in range(12)))
    assert any("without a sample" in words for words in late.lost)
