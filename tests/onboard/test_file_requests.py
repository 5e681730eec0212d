"""Files for a station that asks: answered at once, sent within the budget, never before a tick."""

from __future__ import annotations

import json
import lzma
from struct import pack, unpack_from
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight
from test_operators import Station, kinds

from tgl_soar.link.component_metadata import GENERAL, checksum_of, metadata_files


@pytest.fixture
def flight() -> Flight:
    made = Flight()
    made.run(1.0)
    made.outbound()
    return made


def file_request(opcode: int, data: bytes = b"", *, offset: int = 0, size: int = 0) -> list[int]:
    head = pack("<HBBBBBxI", 7, 1, opcode, size or len(data), 0, 0, offset)
    return list((head + data).ljust(251, b"\0"))


def request_file(station: Station, payload: list[int], component: int = 191) -> None:
    station.say(mavlink.MAVLink_file_transfer_protocol_message(0, 1, component, payload))


def of_files(messages: list[Any]) -> list[Any]:
    return [m for m in messages if m.get_type() == "FILE_TRANSFER_PROTOCOL"]


def test_a_request_for_a_file_is_answered_at_once_and_where_it_was_asked(flight: Flight) -> None:
    station = Station(flight)
    flight.run(0.1)
    station.received()
    flight.outbound()
    opens = file_request(4, b"@PARAM/param.pck")
    for component in (191, 1, 0):
        request_file(station, opens, component)
    (answer,) = of_files(station.received())
    assert (answer.target_system, answer.target_component) == (255, 190)
    assert answer.payload[:4] == [8, 0, 1, 129]
    assert "FILE_TRANSFER_PROTOCOL" not in kinds(flight.outbound())
    for _ in range(500):
        request_file(station, opens)
    assert len(station.received()) <= 20  # a flood is not


def test_a_station_reads_what_our_parameters_mean(flight: Flight) -> None:
    station = Station(flight)
    flight.run(0.1)
    station.received()
    request_file(station, file_request(4, b"/parameters.json.xz"))
    (opened,) = of_files(station.received())
    (size,) = unpack_from("<I", bytes(opened.payload), 12)
    read, bursts = b"", 0
    while len(read) < size and bursts < 5:
        request_file(station, file_request(15, offset=len(read), size=239))
        bursts += 1
        flight.run(4.5)
        for piece in of_files(station.received()):
            payload = bytes(piece.payload)
            assert unpack_from("<I", payload, 8) == (len(read),)
            read += payload[12 : 12 + payload[4]]
    assert json.loads(lzma.decompress(read))["parameters"][0]["name"] == "OP_ENGAGE"


def test_files_take_half_of_the_telemetry_s_budget_and_numbers_keep_coming(flight: Flight) -> None:
    station = Station(flight)
    flight.run(2.0)
    request_file(station, file_request(4, b"/parameters.json.xz"))
    station.received()
    seconds, budget = 10.0, flight.onboard.settings.values["TEL_BUDGET"]
    sent: list[Any] = []
    for _ in range(round(seconds)):
        request_file(station, file_request(15, size=239))  # again and again: no more comes of it
        flight.run(1.0)
        sent += station.received()
    bytes_of = {
        files: sum(len(m.get_msgbuf()) for m in sent if (m in of_files(sent)) == files)
        for files in (True, False)
    }
    one_piece = 275
    assert 0.8 * seconds * budget / 2 < bytes_of[True] <= seconds * budget / 2 + 2 * one_piece
    numbers = [m for m in sent if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert sum(len(m.get_msgbuf()) for m in numbers) > 0.25 * seconds * budget
    heartbeats = 30 * seconds
    assert sum(bytes_of.values()) <= 1.1 * seconds * budget + heartbeats


def test_a_busy_computer_sends_no_files(flight: Flight) -> None:
    station = Station(flight)
    flight.run(0.5)
    request_file(station, file_request(4, b"/parameters.json.xz"))
    station.received()
    operators = flight.onboard._operators
    request_file(station, file_request(15, size=239))
    for n in range(100):
        operators.serve(flight.now_s + 0.02 * n, sheds=True)
    assert of_files(station.received()) == []
    for n in range(100, 200):
        operators.serve(flight.now_s + 0.02 * n, sheds=False)
    assert len(of_files(station.received())) > 3


def test_our_metadata_is_named_when_asked_for(flight: Flight) -> None:
    station = Station(flight)
    flight.run(0.1)
    station.received()
    request_message, of_metadata = 512, 397
    station.say(
        mavlink.MAVLink_command_long_message(1, 191, request_message, 0, of_metadata, *[0.0] * 6)
    )
    ack, metadata = station.frames  # pymavlink does not know the second
    assert mavlink.MAVLink(None).decode(bytearray(ack)).result == 0
    assert int.from_bytes(metadata[7:10], "little") == of_metadata
    assert unpack_from("<I", metadata, 14) == (checksum_of(metadata_files()[GENERAL]),)
    assert metadata[18:-2] == b"mftp:///general.json"
