"""The bytes of each answer to a reader of a file, its sessions and pieces, and when one is idle."""

from __future__ import annotations

import struct
from typing import NamedTuple

import pytest
from pymavlink import mavftp_op

from tgl_soar.link.file_transfer import FileServer, path_of, request_of
from tgl_soar.link.messages import FileTransferProtocol, Source

ME, YOU = Source(255, 190), Source(250, 190)
LONG = bytes(i % 251 for i in range(239 * 20 + 5))
FILES = {"/a.json": b"0123456789", "/long.xz": LONG, "/empty": b""}
OPEN, READ, BURST = mavftp_op.OP_OpenFileRO, mavftp_op.OP_ReadFile, mavftp_op.OP_BurstReadFile
LIST, END = mavftp_op.OP_ListDirectory, mavftp_op.OP_TerminateSession
RESET, ACK, NAK = mavftp_op.OP_ResetSessions, mavftp_op.OP_Ack, mavftp_op.OP_Nack
INVALID_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, NOT_FOUND = 3, 4, 5, 6, 10


class Answer(NamedTuple):
    """A payload, as the protocol has it."""

    sequence: int
    session: int
    opcode: int
    size: int
    asked_opcode: int
    complete: int
    padding: int
    offset: int
    data: bytes


def read(message: FileTransferProtocol | None, target: Source = ME) -> Answer:
    assert message is not None
    assert (message.target_system, message.target_component) == target
    assert len(message.payload) == 251
    head = struct.unpack("<HBBBBBBI", message.payload[:12])
    answer = Answer._make((*head, message.payload[12 : 12 + head[3]]))
    assert set(message.payload[12 + answer.size :]) <= {0}
    return answer


def asked(
    opcode: int, data: bytes = b"", *, offset: int = 0, size: int = -1, session: int = 0,
    sequence: int = 7,
) -> FileTransferProtocol:  # fmt: skip
    head = struct.pack(
        "<HBBBBBBI", sequence, session, opcode, len(data) if size < 0 else size, 0, 0, 0, offset
    )
    return FileTransferProtocol(1, 191, (head + data).ljust(251, b"\0"))


@pytest.fixture
def server() -> FileServer:
    return FileServer(FILES)


def opened(server: FileServer, path: bytes, session: int = 0, source: Source = ME) -> Answer:
    return read(server.handle(source, asked(OPEN, path, session=session), 2, 10.0), source)


def error_of(answer: Answer) -> int:
    assert (answer.opcode, answer.size) == (NAK, 1)
    return answer.data[0]


# --- opening and closing --------------------------------------------------------------------------


def test_a_file_that_is_opened_tells_its_size(server: FileServer) -> None:
    answer = opened(server, b"/a.json", session=3)
    assert answer == Answer(
        sequence=8,
        session=3,
        opcode=ACK,
        size=4,
        asked_opcode=OPEN,
        complete=0,
        padding=0,
        offset=0,
        data=struct.pack("<I", 10),
    )
    assert error_of(opened(server, b"/b.json")) == NOT_FOUND


def test_an_answer_s_number_is_the_next_of_sixteen_bits(server: FileServer) -> None:
    message = asked(OPEN, b"/a.json", sequence=0xFFFF)
    assert read(server.handle(ME, message, 0, 0.0)).sequence == 0


def test_what_was_closed_or_reset_is_no_session(server: FileServer) -> None:
    opened(server, b"/a.json", session=1)
    opened(server, b"/a.json", session=2)
    opened(server, b"/a.json", source=YOU)
    assert read(server.handle(ME, asked(END, session=1), 0, 10.0)).opcode == ACK
    assert error_of(read(server.handle(ME, asked(END, session=1), 0, 10.0))) == INVALID_SESSION
    assert read(server.handle(ME, asked(RESET), 0, 10.0)).opcode == ACK
    assert error_of(read(server.handle(ME, asked(END, session=2), 0, 10.0))) == INVALID_SESSION
    assert read(server.handle(YOU, asked(END), 0, 10.0), YOU).opcode == ACK  # another's stays


@pytest.mark.parametrize(("idle_s", "is_dropped"), [(9.9, False), (10.1, True)])
def test_four_files_are_open_and_one_that_nobody_reads_for_ten_seconds_makes_room(
    server: FileServer, idle_s: float, is_dropped: bool
) -> None:
    for session in range(4):
        assert opened(server, b"/a.json", session).opcode == ACK
    server.handle(ME, asked(READ, size=5, session=0), 0, 10.0 + idle_s)  # but for this one
    assert opened(server, b"/a.json", 3).opcode == ACK  # one of them again
    answer = read(server.handle(ME, asked(OPEN, b"/a.json", session=9), 0, 10.0 + idle_s))
    assert (answer.opcode == ACK) is is_dropped
    if not is_dropped:
        assert error_of(answer) == NO_SESSIONS
    kept = read(server.handle(ME, asked(END, session=0), 0, 10.0))
    assert kept.opcode == ACK


def test_another_clock_closes_all(server: FileServer) -> None:
    opened(server, b"/a.json")
    server.handle(ME, asked(READ, size=5), 0, 10.0)
    assert server.is_reading
    server.rebase()
    assert not server.is_reading
    assert server.take() is None


# --- reading --------------------------------------------------------------------------------------


def test_a_piece_has_its_place_its_size_and_the_link_that_asked_last(server: FileServer) -> None:
    opened(server, b"/a.json", session=3)
    assert server.handle(ME, asked(READ, size=4, offset=5, session=3), 1, 11.0) is None
    piece = server.take()
    assert piece is not None
    assert piece.link == 1
    assert read(piece.message) == Answer(
        sequence=8,
        session=3,
        opcode=ACK,
        size=4,
        asked_opcode=READ,
        complete=0,
        padding=0,
        offset=5,
        data=b"5678",
    )
    assert not server.is_reading
    assert server.take() is None


@pytest.mark.parametrize(
    ("size", "offset", "error"),
    [(0, 0, INVALID_SIZE), (240, 0, INVALID_SIZE), (4, 10, END_OF_FILE), (4, 11, END_OF_FILE)],
)
def test_what_cannot_be_read_is_refused(
    server: FileServer, size: int, offset: int, error: int
) -> None:
    opened(server, b"/a.json")
    for opcode in (READ, BURST):
        answer = server.handle(ME, asked(opcode, size=size, offset=offset), 0, 10.0)
        assert error_of(read(answer)) == error
    assert not server.is_reading
    assert server.handle(ME, asked(READ, size=239, offset=9), 0, 10.0) is None  # the last byte


def test_of_an_empty_file_there_is_nothing_to_read(server: FileServer) -> None:
    opened(server, b"/empty")
    assert error_of(read(server.handle(ME, asked(READ, size=1), 0, 10.0))) == END_OF_FILE


def pieces(server: FileServer) -> list[Answer]:
    found = []
    while (piece := server.take()) is not None:
        found.append(read(piece.message))
    return found


def test_a_burst_is_sixteen_pieces_of_which_the_last_says_so(server: FileServer) -> None:
    opened(server, b"/long.xz")
    server.handle(ME, asked(BURST, size=239), 0, 10.0)
    first = pieces(server)
    assert [each.complete for each in first] == [0] * 15 + [1]
    assert [each.sequence for each in first] == list(range(8, 24))
    assert [each.offset for each in first] == [239 * i for i in range(16)]
    server.handle(ME, asked(BURST, size=239, offset=239 * 16), 0, 10.0)
    rest = pieces(server)
    assert [each.size for each in rest] == [239] * 4 + [5]
    assert [each.complete for each in rest] == [0] * 4 + [1]
    assert b"".join(each.data for each in (*first, *rest)) == LONG


def test_eight_single_reads_wait_and_a_ninth_takes_the_place_of_the_first(
    server: FileServer,
) -> None:
    opened(server, b"/a.json")
    for i in range(9):
        server.handle(ME, asked(READ, size=1, offset=i), 0, 10.0)
    assert b"".join(each.data for each in pieces(server)) == b"12345678"


def test_a_burst_takes_the_place_of_all_that_waits(server: FileServer) -> None:
    opened(server, b"/a.json")
    server.handle(ME, asked(READ, size=1, offset=3), 0, 10.0)
    server.handle(ME, asked(BURST, size=6, offset=2), 0, 10.0)
    assert [each.data for each in pieces(server)] == [b"234567", b"89"]


# --- listing and paths ----------------------------------------------------------------------------


def test_files_are_listed_by_name_with_their_sizes_from_the_entry_that_is_asked_for(
    server: FileServer,
) -> None:
    whole = b"Fa.json\t10\0Fempty\t0\0Flong.xz\t4785\0"
    answer = read(server.handle(ME, asked(LIST, b"/"), 0, 0.0))
    assert (answer.opcode, answer.asked_opcode, answer.data) == (ACK, LIST, whole)
    answer = read(server.handle(ME, asked(LIST, b"/", offset=2), 0, 0.0))
    assert answer.data == b"Flong.xz\t4785\0"
    assert error_of(read(server.handle(ME, asked(LIST, b"/", offset=3), 0, 0.0))) == END_OF_FILE
    assert error_of(read(server.handle(ME, asked(LIST, b"/etc"), 0, 0.0))) == NOT_FOUND


@pytest.mark.parametrize(("names", "listed"), [(23, 23), (24, 23)])
def test_a_listing_ends_where_a_payload_does(names: int, listed: int) -> None:
    """An entry has ten bytes here, and a payload 239."""
    server = FileServer({f"/f{i:04d}": bytes(10) for i in range(names)})
    answer = read(server.handle(ME, asked(LIST, b"/"), 0, 0.0))
    assert answer.data.count(b"\0") == listed == answer.size // 10


@pytest.mark.parametrize(("length", "fits"), [(239, True), (240, False)])
def test_an_entry_may_fill_a_payload(length: int, fits: bool) -> None:
    name = "x" * (length - len("F\t1\0"))
    answer = read(FileServer({f"/{name}": b"1"}).handle(ME, asked(LIST, b"/"), 0, 0.0))
    assert (answer.size == length) is fits
    assert (answer.opcode == NAK) is not fits


@pytest.mark.parametrize(
    ("data", "path"),
    [
        (b"/a.json\0junk", "/a.json"),
        (b"a.json", "/a.json"),
        (b"./a.json", "/a.json"),
        (b"//a.json", "/a.json"),
        (b"", "/"),
        (b"/\xff", "/\ufffd"),
    ],
)
def test_a_path_is_from_the_root(data: bytes, path: str) -> None:
    assert path_of(data) == path


def test_a_payload_that_is_too_short_or_an_answer_asks_for_nothing() -> None:
    assert request_of(FileTransferProtocol(1, 191, bytes(11))) is None
    assert request_of(FileTransferProtocol(1, 191, bytes(12))) is not None
    assert request_of(asked(127)) is not None
    assert request_of(asked(128)) is None
    found = request_of(asked(OPEN, b"abc", size=2, offset=9, session=4))
    assert found == (7, 4, OPEN, 2, 9, b"ab")
