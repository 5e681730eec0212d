"""A ULog written here byte by byte: what is read of it, and what damage costs and is called."""

from __future__ import annotations

from pathlib import Path
from struct import pack

import numpy as np
import pytest

from tgl_soar.analysis.logs.ulog_reader import (
    FlightLog,
    LogError,
    ParameterChange,
    Words,
    bytes_of,
    log_from,
    read_log,
)
from tgl_soar.onboard.flightlog.topics import VERSION

pytest.importorskip("pyulog")

PATH = Path("flight.ulg")
HEADER = 16
POSE = "uint64_t timestamp;float x;bool known;"


def header(version: int = 1) -> bytes:
    return b"ULog\x01\x12\x35" + bytes([version]) + pack("<Q", 0)


def message(kind: str, body: bytes) -> bytes:
    return pack("<H", len(body)) + kind.encode() + body


def layout(name: str, fields: str) -> bytes:
    return message("F", f"{name}:{fields}".encode())


def subscribed(name: str, number: int, instance: int = 0) -> bytes:
    return message("A", pack("<BH", instance, number) + name.encode())


def pose(stamp_us: int, x: float, known: bool = True, number: int = 0) -> bytes:
    return message("D", pack("<HQf?", number, stamp_us, x, known))


def keyed(kind: str, key: str, value: bytes, before: bytes = b"") -> bytes:
    return message(kind, before + bytes([len(key)]) + key.encode() + value)


def info(name: str, value: str) -> bytes:
    return keyed("I", f"char[{len(value)}] {name}", value.encode())


def parameter(name: str, value: float) -> bytes:
    return keyed("P", f"float {name}", pack("<f", value))


def words(level: int, stamp_us: int, text: str) -> bytes:
    return message("L", f"{level}".encode() + pack("<Q", stamp_us) + text.encode())


DEFINED = layout("pose", POSE)
POSES = tuple(pose(1_000_000 + 100_000 * n, float(n), n % 2 == 0) for n in range(12))


def log(*parts: bytes, defined: bytes = DEFINED, version: int = 1) -> FlightLog:
    """With these messages after the definitions and the subscription."""
    return log_from(header(version) + defined + subscribed("pose", 0) + b"".join(parts), PATH)


# --- what is read -------------------------------------------------------------------------------


def test_rows_are_columns_by_topic_and_truths_are_truths() -> None:
    found = log(*POSES)
    assert list(found.topics) == ["pose"]
    rows = found.topics["pose"]
    assert rows["timestamp"].tolist() == [1_000_000 + 100_000 * n for n in range(12)]
    assert rows["x"].tolist() == [float(n) for n in range(12)]
    assert rows["known"].dtype == bool
    assert rows["known"].tolist() == [True, False] * 6
    assert found.losses == []
    assert found.path == PATH
    assert found.duration_s == pytest.approx(1.1)
    assert not found.is_ours


def test_a_second_instance_of_a_topic_has_its_number() -> None:
    found = log(subscribed("pose", 1, instance=1), *POSES, pose(5, 7.0, number=1))
    assert found.topics["pose#1"]["x"].tolist() == [7.0]
    assert len(found.topics["pose"]["x"]) == 12


def test_the_duration_is_that_of_the_ticks_where_there_are_any() -> None:
    ticks = layout("tick", "uint64_t timestamp;uint32_t tick;")
    rows = [message("D", pack("<HQI", 1, 2_000_000 + 5_000 * n, n)) for n in range(3)]
    found = log(subscribed("tick", 1), *POSES, *rows, defined=DEFINED + ticks)
    assert found.duration_s == pytest.approx(0.010)
    assert log().duration_s == 0.0


def test_parameters_their_changes_words_and_texts_are_read() -> None:
    found = log(
        words(4, 1_500_000, "first"),
        *POSES[:5],
        parameter("GAIN", 3.5),
        words(6, 2_500_000, "second"),
        *POSES[5:],
        defined=DEFINED
        + info("sys_name", "PX4")
        + parameter("GAIN", 2.5)
        + keyed("M", "char[3] site", b"abc", b"\0")
        + keyed("M", "char[2] site", b"de", b"\1"),
    )
    assert found.parameters == {"GAIN": 2.5}
    (change,) = found.changes
    assert (change.tick, change.name, change.value) == (0, "GAIN", 3.5)
    assert change.time_s == pytest.approx(1.4)  # when the row before it was logged
    assert found.words == [Words(1.5, 4, "first"), Words(2.5, 6, "second")]
    assert found.info["sys_name"] == "PX4"
    assert found.texts == {"site": "abcde"}


def test_our_own_changes_carry_their_tick_and_are_named_by_the_logs_own_list() -> None:
    """The index counts the parameters of the version that wrote it; one beyond them is left out."""
    changes = layout("parameter", "uint64_t timestamp;uint32_t tick;uint16_t index;double value;")
    rows = [
        message("D", pack("<HQIHd", 1, 2_000_000, 40, 1, 0.75)),
        message("D", pack("<HQIHd", 1, 3_000_000, 50, 2, 9.0)),
    ]
    found = log(
        subscribed("parameter", 1),
        *rows,
        defined=DEFINED + changes + parameter("AAA", 1.0) + parameter("BBB", 2.0),
    )
    assert found.changes == [ParameterChange(40, 2.0, "BBB", 0.75)]


def test_what_is_logged_every_eighth_tick_is_spread_over_the_ticks() -> None:
    """Each tick has the next one that was logged, the last ones the last."""
    topics = layout("tick", "uint64_t timestamp;uint32_t tick;") + layout(
        "slow", "uint64_t timestamp;uint32_t tick;float wind;"
    )
    ticks = [message("D", pack("<HQI", 1, 5_000 * n, n)) for n in range(20)]
    slow = [message("D", pack("<HQIf", 2, 5_000 * n, n, 1.0 + n)) for n in (0, 8, 16)]
    found = log(
        subscribed("tick", 1), subscribed("slow", 2), *ticks, *slow, defined=DEFINED + topics
    )
    expected = [1.0, *[9.0] * 8, *[17.0] * 11]
    assert found.topics["tick"]["wind"].tolist() == expected
    assert found.topics["tick"]["tick"].tolist() == list(range(20))
    alone = log(subscribed("tick", 1), *ticks, defined=DEFINED + topics)
    assert "wind" not in alone.topics["tick"]


# --- damage -------------------------------------------------------------------------------------


@pytest.mark.parametrize("garbage", [b"\xff", b"\0" * 7, b"\xff" * 400])
def test_damage_between_messages_costs_its_own_bytes(garbage: bytes) -> None:
    before = header() + DEFINED + subscribed("pose", 0) + b"".join(POSES[:3])
    found = log_from(before + garbage + b"".join(POSES[3:]), PATH)
    assert len(found.topics["pose"]["x"]) == 12
    assert found.losses == [f"damaged: {len(garbage)} bytes at byte {len(before)} are left out"]


@pytest.mark.parametrize("cut", [1, 5, 16])
def test_a_file_that_is_cut_off_keeps_its_whole_messages(cut: int) -> None:
    whole = header() + DEFINED + subscribed("pose", 0) + b"".join(POSES)
    found = log_from(whole[:-cut], PATH)
    assert len(found.topics["pose"]["x"]) == 11
    left = len(POSES[-1]) - cut
    assert found.losses == [f"cut off: the last {left} bytes are no whole message"]


@pytest.mark.parametrize(
    ("following", "found_again"), [(2, True), (3, True), (4, True), (1, False)]
)
def test_after_damage_messages_begin_where_four_or_all_that_follow_are_whole(
    following: int, found_again: bool
) -> None:
    before = header() + DEFINED + subscribed("pose", 0) + b"".join(POSES[:3])
    found = log_from(before + b"\xff\xff\xff" + b"".join(POSES[3 : 3 + following]), PATH)
    assert len(found.topics["pose"]["x"]) == 3 + following * found_again
    if found_again:
        assert found.losses == [f"damaged: 3 bytes at byte {len(before)} are left out"]
    else:
        left = 3 + len(POSES[3])
        assert found.losses == [f"cut off: the last {left} bytes are no whole message"]


def test_messages_that_come_before_anything_is_subscribed_to_are_left_out() -> None:
    early = POSES[0] + message("O", pack("<H", 5))
    found = log_from(header() + early + DEFINED + subscribed("pose", 0) + b"".join(POSES), PATH)
    assert len(found.topics["pose"]["x"]) == 12
    assert found.losses == ["damaged: 2 messages before the first subscription are left out"]


def test_a_subscription_without_a_format_is_left_out_and_its_rows_with_it() -> None:
    found = log(subscribed("other", 3), pose(1, 2.0, number=3), *POSES)
    assert list(found.topics) == ["pose"]
    assert found.losses == ["damaged: a subscription to other does not fit its rows"]


def test_a_newer_version_of_the_format_is_reported() -> None:
    assert log(*POSES, version=2).losses == ["ULog of version 2, read as version 1"]
    assert log(*POSES, version=0).losses == []


def test_dropouts_are_reported() -> None:
    found = log(POSES[0], message("O", pack("<H", 350)), *POSES[1:])
    assert found.losses == ["nothing was written for 350 ms: disk or computer were too slow"]


def test_missing_ticks_are_reported_and_ten_at_most() -> None:
    ticks = layout("tick", "uint64_t timestamp;uint32_t tick;")

    def gapped(numbers: list[int]) -> list[str]:
        rows = [message("D", pack("<HQI", 1, 5_000 * n, n)) for n in numbers]
        return log(subscribed("tick", 1), *rows, defined=DEFINED + ticks).losses

    assert gapped([3, 4, 5]) == []
    assert gapped([3, 4, 9, 10, 12]) == [
        "4 ticks are missing after tick 4",
        "1 ticks are missing after tick 10",
    ]
    assert len(gapped(list(range(0, 60, 2)))) == 10


def test_a_clock_that_goes_back_or_leaps_is_reported() -> None:
    back = log(*(pose(stamp, 0.0) for stamp in (5_000_000, 6_000_000, 2_000_000, 3_000_000, 1)))
    assert "pose: the clock goes back after 6.000 s, 2 times" in back.losses
    near, far = (log(pose(0, 0.0), pose(stamp, 0.0)) for stamp in (59_000_000, 61_000_000))
    assert near.losses == []
    assert far.losses == ["61 s without a row after 0.000 s: the clock leapt or nothing was logged"]


def test_our_own_log_says_its_layout_and_whether_a_tick_was_logged() -> None:
    def ours(version: int) -> FlightLog:
        head = info("sys_name", "tgl_soar") + info("ver_log", str(version))
        return log(*POSES, defined=DEFINED + head)

    assert ours(VERSION).is_ours
    assert ours(VERSION).losses == ["no tick was logged"]
    other = f"written with layout {VERSION + 1}, read with {VERSION}: fields may differ"
    assert ours(VERSION + 1).losses == [other, "no tick was logged"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("afresh", "reset"),
        ("imu_share", "imu_weight"),
        ("throttle_share", "throttle_fraction"),
        ("wind_belief_p_xx", "wind_posterior_p_xx"),
        ("motion_turning_time_s", "motion_attitude_track_time_s"),
        ("passage_glide_turning_nose", "launch_landing_glide_airspeed_error_nose"),
        ("passage_launch_since_s", "launch_landing_launch_since_s"),
        ("turns", "turns"),
    ],
)
def test_columns_of_the_first_layout_are_found_by_the_names_of_today(old: str, new: str) -> None:
    state = layout("state", f"uint64_t timestamp;float {old};")
    row = message("D", pack("<HQf", 1, 1_000_000, 2.5))

    def written(name: str, version: int) -> FlightLog:
        head = info("sys_name", name) + info("ver_log", str(version))
        return log(subscribed("state", 1), row, *POSES, defined=DEFINED + state + head)

    found = written("tgl_soar", 1)
    assert found.topics["state"][new].tolist() == [2.5]
    assert set(found.topics["state"]) == {"timestamp", new}
    assert not any("layout" in loss for loss in found.losses)  # all of it has a name of today
    for other in (written("tgl_soar", 2), written("somebody", 1)):
        assert set(other.topics["state"]) == {"timestamp", old}


# --- files --------------------------------------------------------------------------------------


def test_what_is_no_ulog_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"flight\.ulg: empty: nothing was logged"):
        log_from(b"", PATH)
    for data in (header()[: HEADER - 1], b"x" * 100, b"\0" + header()):
        with pytest.raises(LogError, match=r"flight\.ulg: not a ULog: it does not begin as one"):
            log_from(data, PATH)
    with pytest.raises(LogError, match=r"none\.ulg: cannot be read"):
        bytes_of(tmp_path / "none.ulg")
    there = tmp_path / "there.ulg"
    there.write_bytes(header() + DEFINED + subscribed("pose", 0) + b"".join(POSES))
    assert np.array_equal(read_log(str(there)).topics["pose"]["x"], np.arange(12.0))
