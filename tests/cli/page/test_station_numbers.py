"""The page's ground station number by number: times, units, whose frames it accepts, what it sends.

Messages are made and read with pymavlink, as another program would.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import inf, isnan, nan, radians
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.station import (
    FETCHED_AT_ONCE,
    ROW,
    TEXTS,
    Station,
    StationAnswer,
    number,
    without_others,
)
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.onboard.telemetry_values import ARRAY, ARRAY_NAME, FAST, SLOW

OWN, WALL_S = 253, 1.8e9
MODULE, AUTOPILOT = 191, 1


def station(key: bytes | None = None) -> Station:
    return Station(1, MODULE, OWN, key, WALL_S)


def codec(component: int = MODULE, system: int = 1) -> Any:
    return mavlink.MAVLink(None, system, component)


def received(
    listener: Station, *messages: Any, sender: Any = None, now_s: float = 10.0, wall_s: float = 5.0
) -> int:
    sender = sender or codec()
    data = b"".join(bytes(message.pack(sender)) for message in messages)
    return listener.receive(data, now_s, wall_s)


def sent(listener: Station) -> list[Any]:
    reader: Any = codec(0, 0)
    return [reader.decode(bytearray(frame)) for frame in listener.take_datagrams()]


def named(name: str, value: float) -> Any:
    return mavlink.MAVLink_named_value_float_message(0, name.encode(), value)


def beat(start: int = 5, mode: int = 4, armed: int = 0) -> Any:
    return mavlink.MAVLink_heartbeat_message(18, 8, armed, start << 8 | mode, 4, 3)


def text(words: bytes, chunk: int = 0, of: int = 0, severity: int = 6) -> Any:
    return mavlink.MAVLink_statustext_message(severity, words, of, chunk)


def answers(listener: Station, *messages: Any) -> list[StationAnswer]:
    found: list[StationAnswer] = []
    listener.on_answer = found.append
    received(listener, *messages)
    return found


# --- whose frames ------------------------------------------------------------------------------


def test_it_counts_the_messages_of_the_module_and_its_autopilot_only() -> None:
    listener = station()
    assert received(listener, named("e_rho", 1.0), beat()) == 2
    assert received(listener, beat(), sender=codec(AUTOPILOT)) == 1
    assert received(listener, beat(), beat(), sender=codec(7)) == 0
    assert received(listener, beat(), sender=codec(MODULE, 2)) == 0
    assert listener.receive(b"\xfd\x00garbage", 10.0, 5.0) == 0


def test_it_begins_with_nothing() -> None:
    listener = station()
    assert (listener.row_number, listener.text_number, listener.starts) == (0, 0, 0)
    assert listener.silence_s(1e9) == inf
    assert not listener.is_alive(0.0)
    assert listener.take_datagrams() == []
    assert listener.missing == [p.name for p in PARAMETERS]


def test_only_words_of_the_module_end_the_silence() -> None:
    listener = station()
    received(listener, beat(), sender=codec(AUTOPILOT), now_s=10.0)
    assert listener.silence_s(10.0) == inf
    received(listener, beat(), now_s=10.0)
    assert listener.silence_s(11.5) == 1.5
    assert listener.is_alive(12.0)
    assert not listener.is_alive(12.001)


def test_every_name_of_telemetry_is_taken_and_no_other() -> None:
    for name in (*FAST, *SLOW):
        listener = station()
        received(listener, named(name, 0.5))
        assert listener.now == {name: 0.5}
    listener = station()
    received(listener, named("imu_weight", 0.5))
    assert listener.now == {}


def test_the_modules_heartbeat_holds_its_mode_and_the_number_of_its_start() -> None:
    listener = station()
    received(listener, beat(start=0xABCDEF, mode=11))
    assert listener.now["soar_mode"] == 11.0
    assert listener.starts == 0  # the first that is known is no other one
    received(listener, beat(start=0xABCDEF, mode=4))
    assert listener.starts == 0
    received(listener, beat(start=0xABCDEE, mode=4))
    received(listener, beat(start=0xABCDED, mode=4))
    assert listener.starts == 2


def test_what_a_module_reported_before_its_restart_is_forgotten() -> None:
    listener = station()
    received(listener, beat(start=5), named("e_rho", 1.0))
    received(listener, beat(start=6, mode=2))
    assert listener.now == {"soar_mode": 2.0}


def test_a_float_array_is_taken_by_the_names_of_its_places() -> None:
    listener = station()
    taken: list[tuple[float, Sequence[float]]] = []
    listener.on_array = lambda time_s, data: taken.append((time_s, list(data)))
    data = [float(i) for i in range(58)]
    received(listener, mavlink.MAVLink_debug_float_array_message(2_500_000, b"other", 1, data))
    assert listener.now == {}
    assert taken == []
    received(
        listener,
        mavlink.MAVLink_debug_float_array_message(2_500_000, ARRAY_NAME.encode(), 191, data),
    )
    assert taken == [(2.5, data)]
    assert listener.now["roll"] == ARRAY.index("roll")
    assert listener.now["pushed"] == ARRAY.index("pushed")
    # What comes by name more often, or means something else there, is not taken from it.
    assert not {"mode", "x", "z", "e_rho", "wind", "updraft"} & listener.now.keys()


# --- the autopilot's ---------------------------------------------------------------------------


def test_the_autopilots_attitude_is_shown_in_degrees() -> None:
    listener = station()
    message = mavlink.MAVLink_attitude_message(0, radians(30.0), radians(-10.0), 0, 0, 0, 0)
    received(listener, message, sender=codec(AUTOPILOT))
    assert listener.now["roll"] == pytest.approx(30.0, abs=1e-4)
    assert listener.now["pitch"] == pytest.approx(-10.0, abs=1e-4)


@pytest.mark.parametrize(("base_mode", "armed"), [(0, 0.0), (128, 1.0), (127, 0.0), (129, 1.0)])
def test_the_autopilots_heartbeat_tells_whether_it_is_armed(base_mode: int, armed: float) -> None:
    listener = station()
    received(listener, beat(armed=base_mode), sender=codec(AUTOPILOT))
    assert listener.now == {"armed": armed}


@pytest.mark.parametrize(("millivolts", "volts"), [
    (0, nan), (1, 0.001), (11_400, 11.4), (65_534, 65.534), (65_535, nan),
])  # fmt: skip
def test_a_battery_voltage_that_is_not_measured_is_not_known(millivolts: int, volts: float) -> None:
    listener = station()
    message = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, millivolts, 0, 50, *[0] * 6)
    received(listener, message, sender=codec(AUTOPILOT))
    assert listener.now["battery_v"] == pytest.approx(volts, nan_ok=True)
    assert listener.now["battery"] == 0.5


@pytest.mark.parametrize(("percent", "fraction"), [(-1, nan), (0, 0.0), (1, 0.01), (100, 1.0),
                                                (101, nan)])  # fmt: skip
def test_what_is_left_of_a_battery_is_a_fraction(percent: int, fraction: float) -> None:
    listener = station()
    message = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 11_000, 0, percent, *[0] * 6)
    received(listener, message, sender=codec(AUTOPILOT))
    assert listener.now["battery"] == pytest.approx(fraction, nan_ok=True)


# --- texts -------------------------------------------------------------------------------------


def test_texts_are_counted_and_keep_their_source_severity_and_time() -> None:
    listener = station()
    received(listener, text(b"ready", severity=6), wall_s=100.0)
    received(listener, text(b"armed", severity=2), sender=codec(AUTOPILOT), wall_s=101.5)
    first, second = listener.texts
    assert first._asdict() == {
        "number": 1,
        "first": 1,
        "wall_s": 100.0,
        "severity": 6,
        "source": "module",
        "text": "ready",
    }
    assert second.source == "autopilot"
    assert (second.number, second.first, second.wall_s, second.severity) == (2, 2, 101.5, 2)
    assert listener.text_number == 2


def test_a_further_piece_keeps_the_number_of_the_first() -> None:
    listener = station()
    received(listener, text(b"before"))
    received(listener, text(b"one ", 0, 9), text(b"two ", 1, 9), text(b"three", 2, 9))
    assert [(t.number, t.first, t.text) for t in listener.texts] == [
        (1, 1, "before"),
        (4, 2, "one two three"),
    ]


def test_a_piece_is_put_behind_no_text_of_another_source_and_none_that_is_whole() -> None:
    listener = station()
    received(listener, text(b"of the module", 0, 9))
    received(listener, text(b"of the autopilot", 1, 9), sender=codec(AUTOPILOT))
    assert [t.text for t in listener.texts] == ["of the module", "of the autopilot"]
    received(listener, text(b"first", 0, 4), sender=codec(AUTOPILOT))
    received(listener, text(b"without a number", 1, 0), sender=codec(AUTOPILOT))
    assert [t.text for t in listener.texts][2:] == ["first", "without a number"]
    alone = station()
    received(alone, text(b"the rest of a lost one", 1, 9))
    assert [t.text for t in alone.texts] == ["the rest of a lost one"]


def test_the_newest_two_hundred_texts_are_kept() -> None:
    listener = station()
    for i in range(205):
        received(listener, text(f"text {i}".encode()))
    assert len(listener.texts) == TEXTS == 200
    assert listener.texts[0].text == "text 5"
    assert listener.text_number == 205


# --- answers -----------------------------------------------------------------------------------


def test_a_value_of_a_known_parameter_is_kept_and_reported() -> None:
    listener = station()
    known = mavlink.MAVLink_param_value_message(b"TGL_Z", 1.5, 9, 91, 0)
    unknown = mavlink.MAVLink_param_value_message(b"NO_SUCH", 1.5, 9, 91, 0)
    assert answers(listener, unknown, known) == [StationAnswer(kind="value", name="TGL_Z",
                                                               value=1.5)]  # fmt: skip
    assert listener.parameters == {"TGL_Z": 1.5}
    assert "TGL_Z" not in listener.missing


@pytest.mark.parametrize(("system", "is_ours"), [(0, True), (OWN, True), (1, False), (254, False)])
def test_an_acknowledgement_to_another_station_is_not_ours(system: int, is_ours: bool) -> None:
    ack = mavlink.MAVLink_command_ack_message(31010, 2, 0, 0, system, 0)
    expected = [StationAnswer(kind="ack", command=31010, result=2)]
    assert answers(station(), ack) == (expected if is_ours else [])
    error = mavlink.MAVLink_param_error_message(system, 190, b"TGL_Z", -1, 3)
    expected = [StationAnswer(kind="error", name="TGL_Z")]
    assert answers(station(), error) == (expected if is_ours else [])


def test_an_answer_holds_nothing_of_another_kind() -> None:
    assert StationAnswer(kind="ack")._asdict() == {
        "kind": "ack",
        "name": "",
        "value": 0.0,
        "command": 0,
        "result": 0,
    }


# --- what it sends -----------------------------------------------------------------------------


def test_a_set_is_for_the_module_and_of_a_float() -> None:
    listener = station()
    listener.set("TGL_Z", 1.5)
    (message,) = sent(listener)
    assert message.get_type() == "PARAM_SET"
    assert (message.target_system, message.target_component) == (1, MODULE)
    assert (message.param_id, message.param_value, message.param_type) == ("TGL_Z", 1.5, 9)
    assert message.get_srcSystem() == OWN
    assert message.get_srcComponent() == mavlink.MAV_COMP_ID_MISSIONPLANNER
    assert sent(listener) == []  # taken


def test_a_command_has_its_confirmation_and_no_parameters() -> None:
    listener = station()
    listener.command(31011, 3)
    (message,) = sent(listener)
    assert (message.get_type(), message.command, message.confirmation) == ("COMMAND_LONG", 31011, 3)
    assert (message.target_system, message.target_component) == (1, MODULE)
    assert [getattr(message, f"param{i}") for i in range(1, 8)] == [0.0] * 7


def test_frames_are_numbered_one_after_the_other_up_to_255() -> None:
    listener = station()
    for _ in range(258):
        listener.command(31010, 0)
    assert [m.get_seq() for m in sent(listener)] == [*range(256), 0, 1]


def test_it_beats_once_a_second_as_a_ground_station_that_is_active() -> None:
    listener = station()
    counts = []
    for now_s in (10.0, 10.5, 10.99, 11.0, 11.5, 12.0):
        listener.step(now_s)
        beats = [m for m in sent(listener) if m.get_type() == "HEARTBEAT"]
        counts.append(len(beats))
        for message in beats:
            assert message.type == mavlink.MAV_TYPE_GCS
            assert message.autopilot == mavlink.MAV_AUTOPILOT_INVALID
            assert message.system_status == mavlink.MAV_STATE_ACTIVE
            assert (message.base_mode, message.custom_mode) == (0, 0)
    assert counts == [1, 0, 0, 1, 0, 1]


def test_what_is_missing_is_asked_for_by_name_every_two_seconds_while_the_module_speaks() -> None:
    def asked(now_s: float) -> list[str]:
        listener.step(now_s)
        found = [m for m in sent(listener) if m.get_type() == "PARAM_REQUEST_READ"]
        assert all(m.param_index == -1 for m in found)
        assert all((m.target_system, m.target_component) == (1, MODULE) for m in found)
        return [m.param_id for m in found]

    listener = station()
    assert asked(5.0) == []  # nothing was received
    received(listener, beat(), now_s=10.0)
    assert [m.get_type() for m in sent(listener)] == ["PARAM_REQUEST_LIST"]
    assert asked(11.99) == []  # the whole list was asked for
    assert asked(12.0) == [p.name for p in PARAMETERS][:16]
    assert FETCHED_AT_ONCE == 16
    received(listener, beat(), now_s=13.0)
    assert asked(13.9) == []
    first = PARAMETERS[0].name
    received(
        listener, mavlink.MAVLink_param_value_message(first.encode(), 0.5, 9, 91, 0), now_s=13.9
    )
    assert asked(14.0) == [p.name for p in PARAMETERS][1:17]
    assert asked(16.5) == []  # it is silent


def test_the_list_is_asked_for_at_the_modules_first_word_of_a_start_only() -> None:
    listener = station()
    received(listener, beat(5))
    received(listener, beat(5))
    (message,) = sent(listener)
    assert message.get_type() == "PARAM_REQUEST_LIST"
    assert (message.target_system, message.target_component) == (1, MODULE)


# --- the strips --------------------------------------------------------------------------------


def test_rows_are_a_fifth_of_a_second_apart_and_the_last_minute_is_kept() -> None:
    listener = station()
    received(listener, named("e_rho", 0.123456), now_s=0.0)
    for i in range(4001):
        listener.step(i * 0.02)
    # 80 s in fifths of a second, the first at once.
    assert listener.row_number == pytest.approx(401, abs=1)
    assert len(listener.rows) == 300
    times = [row[0] for row in listener.rows]
    assert all(t is not None for t in times)
    gaps = [b - a for a, b in pairwise(times) if a is not None and b is not None]
    assert min(gaps) > 0.17
    assert max(gaps) < 0.23


def test_rows_keep_their_pace_though_turns_come_late() -> None:
    """Turns 0.3 s apart: rows stand 0.2 s apart on average as far as there are turns for them, and
    a pause is not made up for."""
    listener = station()
    for now_s in (0.0, 0.3, 0.45, 0.65):
        listener.step(now_s)
    assert [row[0] for row in listener.rows] == [0.0, 0.3, 0.45, 0.65]
    paused = station()
    for now_s in (0.0, 5.0, 5.1, 5.25):
        paused.step(now_s)
    assert [row[0] for row in paused.rows] == [0.0, 5.0, 5.25]


def test_a_row_has_the_columns_of_the_strips_in_four_digits() -> None:
    listener = station()
    received(listener, named("e_rho", 0.123456), now_s=10.0)
    listener.step(10.12345)
    (row,) = listener.rows
    found = dict(zip(ROW, row, strict=True))
    assert found.pop("t") == 10.12
    assert found.pop("e_rho") == 0.1235
    assert set(found.values()) == {None}


def test_the_strips_have_a_column_for_each_of_these() -> None:
    names = (
        *("soar_x", "soar_z", "e_rho", "pitch", "pitch_sp", "elevator", "updraft", "excess"),
        *("airspeed", "soar_mode", "line_x", "line_z", "line_lean", "roll", "climb", "wind"),
        *("age_pos", "age_att", "age_ap", "clearance", "stall"),
        *("fc_state", "fc_chance", "fc_time", "fc_z"),
    )
    listener = station()
    listener.now.update({name: 0.5 + i for i, name in enumerate(names)})
    received(listener, named("e_rho", 2.5), now_s=10.0)
    listener.step(10.0)
    found = dict(zip(ROW, listener.rows[-1], strict=True))
    assert found == {"t": 10.0} | {name: 0.5 + i for i, name in enumerate(names)}


@pytest.mark.parametrize(("value", "shown"), [
    (None, None), (nan, None), (inf, None), (-inf, None), (0.0, 0.0), (1.23456, 1.2346),
])  # fmt: skip
def test_a_number_as_json_takes_it(value: float | None, shown: float | None) -> None:
    assert number(value) == shown


# --- signing -----------------------------------------------------------------------------------


def test_a_signed_frame_is_stamped_with_the_wall_clock_in_tens_of_microseconds_since_2015() -> None:
    key = bytes(range(32))
    listener = station(key)
    listener.command(31010, 0)
    (frame,) = listener.take_datagrams()
    signature = frame[-13:]
    assert signature[0] == OWN  # the link
    stamp = int.from_bytes(signature[1:7], "little")
    since_2015_s = WALL_S - 1_420_070_400.0  # 2015-01-01 00:00 UTC
    assert stamp * 1e-5 == pytest.approx(since_2015_s, abs=0.01)
    unsigned = station()
    unsigned.command(31010, 0)
    assert unsigned.take_datagrams()[0][2] & 1 == 0


def test_a_forged_frame_from_the_future_does_not_shut_out_the_module() -> None:
    key = bytes(range(32))
    listener = station(key)

    def signed(with_key: bytes, wall_s: float) -> Any:
        sender = codec()
        sender.signing.secret_key, sender.signing.sign_outgoing = with_key, True
        sender.signing.timestamp = int((wall_s - 1_420_070_400.0) * 1e5)
        return sender

    assert received(listener, named("e_rho", 1.0), sender=signed(key, WALL_S)) == 1
    assert received(listener, named("e_rho", 2.0), sender=signed(bytes(32), WALL_S + 1e6)) == 0
    assert received(listener, named("e_rho", 3.0), sender=signed(key, WALL_S + 1.0)) == 1
    assert listener.now["e_rho"] == 3.0


# --- frames that no page shows -----------------------------------------------------------------


def version_1(message: Any) -> bytes:
    sender: Any = codec()
    sender.WIRE_PROTOCOL_VERSION = "1.0"
    return bytes(message.pack(sender, force_mavlink1=True))


def test_frames_of_either_version_are_measured_and_chosen() -> None:
    raw = mavlink.MAVLink_raw_imu_message(0, 1, 2, 3, 4, 5, 6, 7, 8, 9)
    old_raw, old_shown = version_1(raw), version_1(beat())
    assert (old_raw[0], old_shown[0]) == (0xFE, 0xFE)
    new_raw, new_shown = bytes(raw.pack(codec())), bytes(beat().pack(codec()))
    assert without_others(old_raw + new_shown + new_raw + old_shown) == new_shown + old_shown
    assert without_others(old_raw[:5]) == old_raw[:5]  # less than a header
    assert without_others(new_raw + b"\xfd") == b"\xfd"
    assert without_others(new_raw + new_raw[:9]) == new_raw[:9]
    assert without_others(new_shown + old_raw[:4]) == new_shown + old_raw[:4]


def test_a_signature_belongs_to_its_frame() -> None:
    sender = codec()
    sender.signing.secret_key, sender.signing.sign_outgoing = bytes(range(32)), True
    raw = bytes(mavlink.MAVLink_raw_imu_message(0, 1, 2, 3, 4, 5, 6, 7, 8, 9).pack(sender))
    shown = bytes(beat().pack(sender))
    assert raw[2] & 1
    assert without_others(raw + shown + raw) == shown


@pytest.mark.parametrize("message", [
    beat(), text(b"a"), named("e_rho", 1.0),
    mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 1, 0, 1, *[0] * 6),
    mavlink.MAVLink_attitude_message(0, 0.1, 0, 0, 0, 0, 0),
    mavlink.MAVLink_param_value_message(b"TGL_Z", 1.5, 9, 91, 0),
    mavlink.MAVLink_param_error_message(1, 190, b"TGL_Z", -1, 3),
    mavlink.MAVLink_command_ack_message(31010, 2, 0, 0, 1, 0),
    mavlink.MAVLink_debug_float_array_message(1, b"tgl_soar", 191, [1.0] * 58),
], ids=lambda message: message.get_type())  # fmt: skip
def test_all_that_the_page_reads_is_kept(message: Any) -> None:
    frame = bytes(message.pack(codec()))
    assert without_others(frame) == frame


def test_a_number_that_is_none_is_kept_as_it_is() -> None:
    listener = station()
    received(listener, named("e_rho", nan))
    assert isnan(listener.now["e_rho"])
