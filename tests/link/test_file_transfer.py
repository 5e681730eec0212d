"""Files over MAVLink: read-only, bounded; MAVProxy, where it is there, reads the answers."""

from __future__ import annotations

from struct import pack, unpack_from

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tgl_soar.link import file_transfer as ft
from tgl_soar.link.file_transfer import FileServer
from tgl_soar.link.messages import FileTransferProtocol, Source

STATION = Source(255, 190)
LONG = bytes(range(256)) * 40  # in more than one burst
FILES = {"/general.json": b"{}", "/long.bin": LONG}
ANSWERED = (ft.TERMINATE, ft.RESET, ft.LIST, ft.OPEN, ft.READ, ft.BURST_READ)


def request(
    opcode: int,
    data: bytes = b"",
    *,
    sequence: int = 7,
    session: int = 3,
    offset: int = 0,
    size: int | None = None,
) -> FileTransferProtocol:
    length = len(data) if size is None else size
    head = pack("<HBBBBBxI", sequence, session, opcode, length, 0, 0, offset)
    return FileTransferProtocol(1, 191, (head + data).ljust(ft.PAYLOAD, b"\0"))


def answered(answer: FileTransferProtocol | None) -> tuple[int, int, int, int, int, int, bytes]:
    """Sequence, session, opcode, opcode asked for, burst complete, offset, data."""
    assert answer is not None
    assert answer[:2] == STATION
    assert len(answer.payload) == ft.PAYLOAD
    sequence, session, opcode, size, asked, complete, offset = unpack_from(
        "<HBBBBBxI", answer.payload
    )
    return sequence, session, opcode, asked, complete, offset, answer.payload[12 : 12 + size]


def server() -> FileServer:
    return FileServer(FILES)


def ask(at: FileServer, message: FileTransferProtocol, source: Source = STATION) -> bytes:
    """The data of an ACK; of a NAK its opcode and error."""
    answer = at.handle(source, message, 0, 0.0)
    assert answer is not None
    *_, opcode, _, _, _, data = answered(answer._replace(target_system=255, target_component=190))
    return data if opcode == ft.ACK else bytes((opcode,)) + data


def pieces(at: FileServer) -> list[tuple[int, int, int, int, int, int, bytes]]:
    found = []
    while (piece := at.take()) is not None:
        found.append(answered(piece.message))
    return found


NAK = bytes((ft.NAK,))


def test_a_file_is_read_in_bursts_as_it_is() -> None:
    at = server()
    assert ask(at, request(ft.OPEN, b"/long.bin")) == pack("<I", len(LONG))
    read, sequence, bursts = b"", 10, 0
    while len(read) < len(LONG):
        asked = request(ft.BURST_READ, sequence=sequence, offset=len(read), size=ft.DATA)
        assert at.handle(STATION, asked, 0, 0.0) is None
        assert at.is_reading
        for got in pieces(at):
            sequence += 1
            assert got[:4] == (sequence, 3, ft.ACK, ft.BURST_READ)
            assert got[5] == len(read)
            read += got[6]
        assert got[4] == 1  # the last one of a burst says so
        bursts += 1
    assert read == LONG
    assert bursts == -(-len(LONG) // (ft.DATA * ft.BURST)) == 3
    end = request(ft.BURST_READ, offset=len(LONG), size=ft.DATA)
    assert ask(at, end) == NAK + bytes((ft.END_OF_FILE,))
    assert ask(at, request(ft.TERMINATE)) == b""
    assert ask(at, request(ft.TERMINATE)) == NAK + bytes((ft.INVALID_SESSION,))


def test_single_reads_are_answered_in_their_order() -> None:
    at = server()
    ask(at, request(ft.OPEN, b"long.bin"))
    for n, offset in enumerate((500, 0, len(LONG) - 5)):
        asked = request(ft.READ, sequence=65534 + n & 0xFFFF, offset=offset, size=80)
        assert at.handle(STATION, asked, 0, 0.0) is None
    got = pieces(at)
    assert [g[0] for g in got] == [65535, 0, 1]  # the sequence wraps
    assert [g[6] for g in got] == [LONG[500:580], LONG[:80], LONG[-5:]]
    assert [g[4] for g in got] == [0, 0, 0]


def test_sessions_have_their_turns_and_a_link_of_their_own() -> None:
    at = server()
    for session, link in ((1, 0), (2, 5)):
        at.handle(STATION, request(ft.OPEN, b"/long.bin", session=session), link, 0.0)
        asked = request(ft.BURST_READ, session=session, size=ft.DATA)
        at.handle(STATION, asked, link, 0.0)
    taken = [at.take() for _ in range(4)]
    assert [piece.link for piece in taken if piece is not None] == [0, 5, 0, 5]


def test_the_files_are_listed() -> None:
    listed = ask(server(), request(ft.LIST, b"/"))
    assert listed == b"Fgeneral.json\t2\0Flong.bin\t10240\0"
    assert ask(server(), request(ft.LIST, b"/", offset=1)) == b"Flong.bin\t10240\0"
    assert ask(server(), request(ft.LIST, b"/", offset=2)) == NAK + bytes((ft.END_OF_FILE,))
    assert ask(server(), request(ft.LIST, b"/etc")) == NAK + bytes((ft.FILE_NOT_FOUND,))


@pytest.mark.parametrize(
    "path",
    [b"/etc/passwd", b"../general.json", b"/../general.json", b"", b"/", b"@PARAM/param.pck"],
)
def test_no_other_file_can_be_opened(path: bytes) -> None:
    assert ask(server(), request(ft.OPEN, path)) == NAK + bytes((ft.FILE_NOT_FOUND,))


@pytest.mark.parametrize("opcode", sorted(set(range(ft.FIRST_ANSWER)) - {*ANSWERED}))
def test_every_other_request_is_answered_by_a_nak(opcode: int) -> None:
    answer = server().handle(STATION, request(opcode, b"/general.json", sequence=65535), 0, 0.0)
    unknown = bytes((ft.UNKNOWN_COMMAND,))
    assert answered(answer) == (0, 3, ft.NAK, opcode, 0, 0, unknown)


@pytest.mark.parametrize("opcode", range(ft.FIRST_ANSWER, 256))
def test_an_answer_is_not_answered(opcode: int) -> None:
    assert server().handle(STATION, request(opcode), 0, 0.0) is None


def test_a_read_without_a_session_or_with_a_bad_size_is_refused() -> None:
    at = server()
    assert ask(at, request(ft.READ, size=80)) == NAK + bytes((ft.INVALID_SESSION,))
    ask(at, request(ft.OPEN, b"/long.bin"))
    for size in (0, 240, 255):
        assert ask(at, request(ft.READ, size=size)) == NAK + bytes((ft.INVALID_SIZE,))
    of_another = at.handle(Source(254, 190), request(ft.READ, size=80), 0, 0.0)
    assert of_another is not None
    assert of_another.payload[12] == ft.INVALID_SESSION
    assert not at.is_reading


def test_sessions_are_bounded_and_an_idle_one_makes_room() -> None:
    at = server()
    for session in range(ft.SESSIONS):
        ask(at, request(ft.OPEN, b"/long.bin", session=session))
    ask(at, request(ft.OPEN, b"/long.bin", session=0))  # again: it is the same one
    full = request(ft.OPEN, b"/long.bin", session=9)
    assert ask(at, full) == NAK + bytes((ft.NO_SESSIONS,))
    later = at.handle(STATION, full, 0, ft.IDLE_S + 0.1)
    assert answered(later)[2] == ft.ACK
    ask(at, request(ft.RESET))
    assert ask(at, request(ft.READ, session=9, size=80)) == NAK + bytes((ft.INVALID_SESSION,))


frames = st.builds(
    request,
    st.integers(0, 255),
    st.sampled_from((b"/long.bin", b"/general.json", b"/", b"\xff\xfe")) | st.binary(max_size=239),
    sequence=st.integers(0, 2**16 - 1),
    session=st.integers(0, 255),
    offset=st.integers(0, 2**32 - 1) | st.integers(0, 300),
    size=st.integers(0, 255),
)
odd = st.builds(FileTransferProtocol, st.just(1), st.just(191), st.binary(max_size=ft.PAYLOAD))


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(1, 9), frames | odd, st.booleans()), max_size=60))
def test_whatever_is_requested_stays_bounded(
    asked: list[tuple[int, FileTransferProtocol, bool]],
) -> None:
    """Any opcodes, offsets, sizes and paths, of many stations: every answer is a whole payload,
    every piece is of a file at its offset, and what waits has an end."""
    at = server()
    for n, (system, message, takes) in enumerate(asked):
        answer = at.handle(Source(system, 190), message, 0, 0.1 * n)
        assert answer is None or len(answer.payload) == ft.PAYLOAD
        if takes and (piece := at.take()) is not None:
            data = answered(piece.message._replace(target_system=255, target_component=190))
            assert data[6]
            assert any(f[data[5] : data[5] + len(data[6])] == data[6] for f in FILES.values())
    waiting = 0
    while at.take() is not None:
        waiting += 1
    assert waiting <= ft.SESSIONS * (ft.READS + ft.BURST)


def test_mavproxy_reads_it() -> None:
    ftp = pytest.importorskip("MAVProxy.modules.mavproxy_ftp")
    answer = server().handle(STATION, request(ft.OPEN, b"@PARAM/param.pck"), 0, 0.0)
    assert answer is not None
    parsers = [c.op_parse for c in vars(ftp).values() if hasattr(c, "op_parse")]
    assert parsers
    message = type("Message", (), {"payload": list(answer.payload)})()
    op = parsers[0](None, message)
    assert (op.seq, op.session, op.opcode, op.req_opcode) == (8, 3, ftp.OP_Nack, ftp.OP_OpenFileRO)
    assert bytes(op.payload) == bytes((ftp.ERR_FileNotFound,))
