"""Files over MAVLink: every request is refused; MAVProxy, where it is there, reads the answer."""

from __future__ import annotations

from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.link.file_transfer import FIRST_ANSWER, NAK, PAYLOAD, UNKNOWN_COMMAND, refused
from tgl_soar.link.messages import FileTransferProtocol, Source

STATION = Source(255, 190)
OPEN_RO, BURST_READ = 4, 15


def request(opcode: int, *, sequence: int = 7, session: int = 3, offset: int = 0) -> bytes:
    data = b"@PARAM/param.pck"
    head = pack("<HBBBBBxI", sequence, session, opcode, len(data), 0, 0, offset)
    return (head + data).ljust(PAYLOAD, b"\0")


@pytest.mark.parametrize("opcode", range(FIRST_ANSWER))
def test_every_request_is_answered_by_a_nak(opcode: int) -> None:
    asked = FileTransferProtocol(1, 191, request(opcode, sequence=65535, offset=80))
    answer = refused(STATION, asked)
    assert answer is not None
    assert answer[:2] == STATION
    head = pack("<HBBBBBxI", 0, 3, NAK, 1, opcode, 0, 80)  # the sequence goes on, and wraps
    assert answer.payload == (head + bytes((UNKNOWN_COMMAND,))).ljust(PAYLOAD, b"\0")


@pytest.mark.parametrize("opcode", range(FIRST_ANSWER, 256))
def test_an_answer_is_not_answered(opcode: int) -> None:
    assert refused(STATION, FileTransferProtocol(1, 191, request(opcode))) is None


@given(st.binary(max_size=PAYLOAD))
def test_no_payload_is_too_odd(payload: bytes) -> None:
    answer = refused(STATION, FileTransferProtocol(1, 191, payload))
    assert answer is None or len(answer.payload) == PAYLOAD


def test_mavproxy_reads_it() -> None:
    ftp = pytest.importorskip("MAVProxy.modules.mavproxy_ftp")
    answer = refused(STATION, FileTransferProtocol(1, 191, request(OPEN_RO)))
    assert answer is not None
    parsers = [c.op_parse for c in vars(ftp).values() if hasattr(c, "op_parse")]
    assert parsers
    message = type("Message", (), {"payload": list(answer.payload)})()
    op = parsers[0](None, message)
    assert (op.seq, op.session, op.opcode, op.req_opcode) == (8, 3, ftp.OP_Nack, ftp.OP_OpenFileRO)
    assert bytes(op.payload) == bytes((ftp.ERR_UnknownCommand,))
