"""A `.tlog`'s two clocks, each limit from both sides, and where frames begin after damage."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_tlog import EPOCH_US, PATH, PILOT, STATION, Sent, attitude, beat, frames, log_of

from tgl_soar.analysis.logs.tlog import Tlog

RECORDERS = "times are the recorder's"
AUTOPILOTS = "the recorder's clock leaps: times are the autopilot's"
DAY_S = 86_400.0


def clocked(boot_s: Sequence[float], recorded_s: Sequence[float]) -> Tlog:
    """Attitudes with their own clock's stamps and the recorder's."""
    rows = zip(recorded_s, boot_s, strict=True)
    return log_of([(at, PILOT, attitude(boot_ms=round(1e3 * boot))) for at, boot in rows])


def even(count: int = 12, jump_s: float = 0.0) -> list[float]:
    """A tenth of a second apart, but for a jump in the middle."""
    return [1.0 + 0.1 * i + (jump_s if i >= count // 2 else 0.0) for i in range(count)]


@pytest.mark.parametrize(
    ("jump_s", "reset"), [(59.0, False), (61.0, True), (-0.5, False), (-0.7, True)]
)
def test_an_autopilots_clock_that_leaps_by_a_minute_or_runs_back_is_not_used(
    jump_s: float, reset: bool
) -> None:
    """Back by half a second is a sample that came late."""
    log = clocked(even(jump_s=jump_s), even())
    if reset:
        assert log.lost == [f"the autopilot's clock was reset: {RECORDERS}"]
        assert log.kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(12))
    else:
        assert log.lost == []
        assert log.kinds["ATTITUDE"].time_s[-1] == pytest.approx(1.1 + jump_s)


@pytest.mark.parametrize(
    ("jump_s", "leaps"), [(59.0, False), (61.0, True), (-0.5, False), (-0.7, True)]
)
def test_a_recorders_clock_leaps_by_a_minute_or_back(jump_s: float, leaps: bool) -> None:
    log = clocked(even(), even(jump_s=jump_s))
    assert log.lost == ([AUTOPILOTS] if leaps else [])
    assert log.kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(12))


def test_a_clock_that_stands_at_zero_is_none() -> None:
    """Ten stamps above it give a time, however many stand at it."""
    stamps = [0.0] * 5 + even(9)
    assert clocked(stamps, even(14)).kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(14))
    stamps = [0.0] * 5 + [2.0 * each for each in even(10)]
    times = clocked(stamps, even(15)).kinds["ATTITUDE"].time_s
    assert times == pytest.approx([0.0] * 5 + (0.2 * np.arange(10)).tolist())


def test_frames_of_all_messages_are_in_one_order_of_time() -> None:
    """A recorder's stamp that is no time has that of its neighbours, and none runs back."""
    sent: list[Sent] = []
    for i in range(6):
        sent += [(0.1 * i, PILOT, attitude()), (0.1 * i + 0.05, STATION, beat())]
    late = [(t - 0.3 if i == 8 else t, who, what) for i, (t, who, what) in enumerate(sent)]
    log = log_of(late)
    attitudes, beats = log.kinds["ATTITUDE"].time_s, log.kinds["HEARTBEAT"].time_s
    assert np.all(np.diff(attitudes) >= 0.0)
    assert np.all(np.diff(beats) >= 0.0)
    assert beats == pytest.approx(0.1 * np.arange(6) + 0.05)
    assert attitudes[4] >= beats[3] - 1e-9
    alone = [(t + 40.0 if i == 4 else t, who, what) for i, (t, who, what) in enumerate(sent)]
    log = log_of(alone)
    assert log.lost == ["recorder: 1 of 12 samples with an impossible time"]
    assert log.kinds["ATTITUDE"].time_s == pytest.approx(0.1 * np.arange(6))


# --- frames ---------------------------------------------------------------------------------------


def restamped(row: bytes, days: float) -> bytes:
    stamp = EPOCH_US + round(1e6 * DAY_S * days)
    return struct.pack(">Q", stamp) + row[8:]


def broken(row: bytes) -> bytes:
    """With a wrong checksum."""
    return row[:-2] + bytes(byte ^ 0xFF for byte in row[-2:])


@pytest.mark.parametrize("days", [3999.0, -3999.0, 4001.0, -4001.0])
def test_a_frame_with_a_wrong_checksum_is_one_within_four_thousand_days(days: float) -> None:
    """Its bytes are reported otherwise, where its stamp says that it is none."""
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(5)])
    rows[2] = restamped(broken(rows[2]), days)
    log = Tlog(PATH, b"".join(rows))
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 1.0, 3.0, 4.0]
    if abs(days) < 4000.0:
        assert log.lost == ["1 frames with a wrong checksum"]
    else:
        whole = sum(map(len, rows))
        assert log.lost == [f"{len(rows[2])} of {whole} bytes belong to no whole frame"]


def test_the_first_frame_may_have_any_stamp() -> None:
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(3)])
    rows[0] = restamped(broken(rows[0]), -9000.0)
    log = Tlog(PATH, b"".join(rows))
    assert log.lost[0] == "1 frames with a wrong checksum"


def test_a_frame_before_damage_counts_only_where_its_checksum_is_right() -> None:
    rows = frames([(0.1 * i, PILOT, attitude(roll=float(i))) for i in range(4)])
    log = Tlog(PATH, rows[0] + broken(rows[1]) + bytes(20) + rows[2] + rows[3])
    assert log.kinds["ATTITUDE"].columns["roll"].tolist() == [0.0, 2.0, 3.0]
    assert log.lost[0].startswith(f"{len(rows[1]) + 20} of ")
    assert len(log.lost) == 1


def test_the_shortest_frame_is_one_at_the_end_too() -> None:
    """Of version 1 without a payload eight bytes, of a message that has none left."""
    row = frames([(0.0, PILOT, attitude())])[0]
    unknown = bytes((0xFE, 0, 1, 1, 1, 255, 0, 0))
    assert 255 not in mavlink.mavlink_map
    log = Tlog(PATH, row + struct.pack(">Q", EPOCH_US) + unknown)
    assert log.lost == ["1 frames of messages that are not known here"]
    cut = Tlog(PATH, row + struct.pack(">Q", EPOCH_US) + unknown[:-1])
    assert cut.lost == [f"15 of {len(row) + 15} bytes belong to no whole frame"]


def test_losses_are_counted_for_each_sender_apart() -> None:
    data = b""
    for number, system, component in ((3, 1, 1), (7, 1, 2), (5, 1, 1), (8, 1, 2), (9, 2, 1)):
        link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        link.seq = number
        data += struct.pack(">Q", EPOCH_US) + attitude().pack(link)
    assert Tlog(PATH, data).loss == {
        "system 1, component 1": (2, 1),
        "system 1, component 2": (2, 0),
        "system 2, component 1": (1, 0),
    }
