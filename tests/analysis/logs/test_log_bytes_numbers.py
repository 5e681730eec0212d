"""ULog and DataFlash to the byte: lengths of two bytes, a file that ends on a message, descriptions
that are full, and how many losses are reported."""

from __future__ import annotations

import pytest
from test_dataflash import ARSP, ATT, ERR, EV, MODE, MSG, PATH, Kind, at, read, record, still, text
from test_ulog_reader import DEFINED, POSES, header, log, message, pose, subscribed, words

from tgl_soar.analysis.logs.dataflash import Dataflash
from tgl_soar.analysis.logs.flight_data import LoggedMode
from tgl_soar.analysis.logs.ulog_reader import Words, log_from

# --- ULog -----------------------------------------------------------------------------------------


def test_definitions_alone_are_a_log_without_a_row() -> None:
    pytest.importorskip("pyulog")
    found = log_from(header() + DEFINED, PATH)
    assert found.topics == {}
    assert found.losses == []
    assert found.duration_s == 0.0


@pytest.mark.parametrize("count", [200, 255, 256, 300, 1000])
def test_a_message_may_be_longer_than_a_byte_can_say(count: int) -> None:
    """Its length is two bytes, the lower first."""
    pytest.importorskip("pyulog")
    letters = "x" * (count - 9)  # a level and eight bytes of time stand before it
    found = log(POSES[0], words(6, 1_500_000, letters), *POSES[1:])
    assert found.words == [Words(1.5, 6, letters)]
    assert len(found.topics["pose"]["x"]) == 12
    assert found.losses == []


@pytest.mark.parametrize("cut", [1, 2])
def test_less_than_a_messages_head_at_the_end_is_cut_off(cut: int) -> None:
    pytest.importorskip("pyulog")
    found = log(*POSES, message("D", b"")[:cut])
    assert found.losses == [f"cut off: the last {cut} bytes are no whole message"]
    assert len(found.topics["pose"]["x"]) == 12


def test_of_leaps_of_the_clock_ten_are_reported() -> None:
    pytest.importorskip("pyulog")
    found = log(*(pose(70_000_000 * n, 0.0) for n in range(13)))
    assert len(found.losses) == 10
    assert found.losses[-1].startswith("70 s without a row after 630.000 s")


def test_two_damaged_places_are_told_apart() -> None:
    pytest.importorskip("pyulog")
    before = header() + DEFINED + subscribed("pose", 0) + b"".join(POSES[:4])
    middle = b"".join(POSES[4:8])
    whole = before + b"\xff" * 5 + middle + b"\xff" * 7 + b"".join(POSES[8:])
    found = log_from(whole, PATH)
    assert len(found.topics["pose"]["x"]) == 12
    assert found.losses == [
        f"damaged: 5 bytes at byte {len(before)} are left out",
        f"damaged: 7 bytes at byte {len(before) + 5 + len(middle)} are left out",
    ]


# --- DataFlash ------------------------------------------------------------------------------------


@pytest.mark.parametrize("extra", [1, 2, 3, 7])
def test_bytes_behind_the_last_record_are_counted(extra: int) -> None:
    whole = ATT.head + still(0.0)
    log_ = Dataflash(PATH, whole + b"x" * extra)
    assert log_.lost == [
        f"{extra} of {len(whole) + extra} bytes belong to no whole record: the file is cut off"
        " or damaged there"
    ]
    assert len(log_.columns("ATT")["TimeUS"]) == 1


def test_a_log_that_ends_on_a_record_has_lost_nothing() -> None:
    assert Dataflash(PATH, ATT.head + still(0.0)).lost == []
    assert Dataflash(PATH, ATT.head + still(0.0) + ARSP.head).lost == []


def test_a_description_may_be_full_to_its_last_letter() -> None:
    """Four letters of a name, sixteen columns, sixty-four characters of them."""
    columns = ",".join(["TimeUS", *(f"A{k:02d}" for k in range(13)), "Latest"])
    assert len(columns) == 65
    columns = columns.replace("Latest", "Late1")
    letters = "Q" + "f" * 13 + "B"
    full = Kind(40, "FULL", letters, columns)
    found = Dataflash(PATH, full.head + full(5, *range(13), 9)).columns("FULL")
    assert list(found) == columns.split(",")
    assert [found[name][0] for name in ("TimeUS", "A00", "A12", "Late1")] == [5, 0.0, 12.0, 9]
    many = Kind(41, "MANY", "Q" + "B" * 15, ",".join("abcdefghijklmnop"))
    found = Dataflash(PATH, many.head + many(*range(16))).columns("MANY")
    assert [column[0] for column in found.values()] == list(range(16))


def test_a_record_of_a_number_that_nothing_describes_is_none() -> None:
    whole = ATT.head + record(99, "Qf", 1, 2.0) + still(0.0)
    found = Dataflash(PATH, whole)
    assert found.lost[0].startswith(f"{len(record(99, 'Qf', 1, 2.0))} of {len(whole)} bytes")


def test_the_same_description_again_changes_nothing() -> None:
    found = Dataflash(PATH, ARSP.head + ARSP(1, 2.0) + ARSP.head + ARSP(2, 3.0))
    assert found.columns("ARSP")["Airspeed"].tolist() == [2.0, 3.0]
    assert found.lost == []


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Kind(8, "MSG", "QZ", "TimeUS,Other"), (text("hello"),)),
        (Kind(9, "EV", "QB", "TimeUS,Other"), (10,)),
        (Kind(10, "ERR", "QBB", "TimeUS,Subsys,Other"), (12, 1)),
        (Kind(10, "ERR", "QBB", "TimeUS,Other,ECode"), (12, 1)),
        (Kind(11, "PARM", "QNf", "TimeUS,Other,Value"), (text("TRIM"), 2.0)),
        (Kind(11, "PARM", "QNf", "TimeUS,Name,Other"), (text("TRIM"), 2.0)),
        (Kind(7, "MODE", "QB", "TimeUS,Other"), (5,)),
        (Kind(12, "DSF", "QI", "TimeUS,Other"), (7,)),
    ],
)
def test_records_whose_columns_damage_has_renamed_tell_nothing(
    kind: Kind, values: tuple[object, ...]
) -> None:
    flight = read(kind.head, kind(at(0.0), *values))
    assert flight.events == ()
    assert flight.parameters == {}
    assert flight.autopilot_modes == ()
    assert flight.lost == ()


def test_a_mode_that_is_no_number_is_none() -> None:
    odd = Kind(7, "MODE", "QN", "TimeUS,Mode")
    assert read(odd.head, odd(at(0.0), text("FBWA"))).autopilot_modes == ()


def test_events_of_one_time_are_all_reported() -> None:
    flight = read(
        *(MSG.head, EV.head, ERR.head, MODE.head),
        *(MSG(at(0.0), text("one")), EV(at(0.0), 10), ERR(at(0.0), 3, 2), MODE(at(0.0), 0, 11)),
    )
    assert sorted(event.text for event in flight.events) == [
        "armed",
        "error 2 of subsystem 3",
        "one",
    ]
    assert flight.autopilot_modes == (LoggedMode(0.0, "RTL"),)


def test_a_stamp_is_in_millionths_of_a_second() -> None:
    flight = read(ARSP.head, ARSP(2_000_000, 8.0), ARSP(3_500_000, 9.0))
    assert flight.airspeed is not None
    assert flight.airspeed.time_s.tolist() == [0.0, 1.5]
