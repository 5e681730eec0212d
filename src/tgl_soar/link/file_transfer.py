"""Files over MAVLink, read-only: those of `component_metadata`, and a NAK to all else.

    payload   sequence (16 bits), session, opcode, size, opcode asked for, burst, padding,
              offset (32 bits), data; little-endian

    OpenFileRO      a session under the number that the station has chosen; again: from its start
    ReadFile        one piece;  BurstReadFile: up to `BURST` pieces, the last one marked
    ListDirectory   names and sizes
    TerminateSession, ResetSessions

Every request is answered: a station may look for a list of parameters among files before it asks
for the parameters themselves, and repeats what nobody answers: MAVProxy for ten seconds.

Whatever is requested, there are no more than `SESSIONS` sessions with `READS` reads each, and
nothing is held but their places in files that are there anyway.  Short answers are made at once;
pieces of files wait until `take` is called, which its caller does as the budget permits.

https://mavlink.io/en/services/ftp.html
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from struct import Struct
from typing import Final, NamedTuple

from tgl_soar.link.messages import FileTransferProtocol, Source

TERMINATE: Final = 1
RESET: Final = 2
LIST: Final = 3
OPEN: Final = 4
READ: Final = 5
BURST_READ: Final = 15
ACK: Final = 128
NAK: Final = 129
FIRST_ANSWER: Final = 128  # this opcode and all above are answers: two servers must not converse

INVALID_SIZE: Final = 3
INVALID_SESSION: Final = 4
NO_SESSIONS: Final = 5
END_OF_FILE: Final = 6
UNKNOWN_COMMAND: Final = 7
FILE_NOT_FOUND: Final = 10

PAYLOAD: Final = 251
DATA: Final = 239
SESSIONS: Final = 4  # two stations that read two files each
IDLE_S: Final = 10.0  # then a session may be taken by another station; clients give up sooner
READS: Final = 8  # of one session, that wait; clients ask again for what is missing
BURST: Final = 16  # pieces of one request: a longer file is asked for in several
_HEAD: Final = Struct("<HBBBBBxI")
_SIZE: Final = Struct("<I")


class FileRequest(NamedTuple):
    """What a payload asks for."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes


class FilePiece(NamedTuple):
    """An answer, and the link that it goes to."""

    link: int
    message: FileTransferProtocol


@dataclass(slots=True)
class _FileRead:
    """Pieces that were asked for and not sent yet."""

    opcode: int
    sequence: int  # of the next answer
    offset: int
    size: int  # of a piece
    pieces: int


@dataclass(slots=True)
class _FileSession:
    """A file that a station has opened."""

    link: int
    data: bytes
    used_s: float
    reads: list[_FileRead] = field(default_factory=list)


class FileServer:
    """Answers every station; pure logic, time is an argument."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        """files: by their paths, which begin with a slash."""
        self._files = dict(files)
        self._sessions: dict[tuple[Source, int], _FileSession] = {}

    @property
    def is_reading(self) -> bool:
        """Whether a piece of a file is to be sent."""
        return self._next() is not None

    def handle(
        self, source: Source, message: FileTransferProtocol, link: int, now_s: float
    ) -> FileTransferProtocol | None:
        """The answer that is to be sent at once; None: to what is no request, or `take` has it."""
        asked = request_of(message)
        if asked is None:
            return None
        opcode = asked.opcode
        if opcode == OPEN:
            return self._open(source, asked, link, now_s)
        if opcode in (READ, BURST_READ):
            return self._read(source, asked, link, now_s)
        if opcode == LIST:
            return self._list(source, asked)
        if opcode == TERMINATE:
            known = self._sessions.pop((source, asked.session), None) is not None
            return _ack(source, asked) if known else refused(source, asked, INVALID_SESSION)
        if opcode == RESET:
            for key in [key for key in self._sessions if key[0] == source]:
                del self._sessions[key]
            return _ack(source, asked)
        return refused(source, asked, UNKNOWN_COMMAND)

    def take(self) -> FilePiece | None:
        """The next piece; sessions have their turns."""
        key = self._next()
        if key is None:
            return None
        source, number = key
        session = self._sessions.pop(key)
        self._sessions[key] = session  # behind the others
        read = session.reads[0]
        end = read.offset + read.size
        data = session.data[read.offset : end]
        read.pieces -= 1
        is_last = read.pieces <= 0 or end >= len(session.data)
        answer = _answer(
            source,
            FileRequest(
                sequence=read.sequence - 1,
                session=number,
                opcode=read.opcode,
                size=len(data),
                offset=read.offset,
                data=b"",
            ),
            data,
            is_burst_complete=is_last and read.opcode == BURST_READ,
        )
        read.sequence, read.offset = read.sequence + 1, end
        if is_last:
            session.reads.pop(0)
        return FilePiece(session.link, answer)

    def _next(self) -> tuple[Source, int] | None:
        """The session whose turn it is; None: nothing is to be read."""
        for key, session in self._sessions.items():
            if session.reads:
                return key
        return None

    def rebase(self) -> None:
        """The clock was changed: every file is closed."""
        self._sessions.clear()

    # --- requests -------------------------------------------------------------------------------

    def _open(
        self, source: Source, asked: FileRequest, link: int, now_s: float
    ) -> FileTransferProtocol:
        data = self._files.get(path_of(asked.data))
        if data is None:
            return refused(source, asked, FILE_NOT_FOUND)
        key = source, asked.session
        self._sessions.pop(key, None)
        if len(self._sessions) >= SESSIONS and not self._drop_idle(now_s):
            return refused(source, asked, NO_SESSIONS)
        self._sessions[key] = _FileSession(link, data, now_s)
        return _answer(source, asked, _SIZE.pack(len(data)))

    def _drop_idle(self, now_s: float) -> bool:
        """Close what nobody has read of lately; whether there was any."""
        idle = [key for key, s in self._sessions.items() if now_s - s.used_s > IDLE_S]
        for key in idle:
            del self._sessions[key]
        return len(idle) > 0

    def _read(
        self, source: Source, asked: FileRequest, link: int, now_s: float
    ) -> FileTransferProtocol | None:
        session = self._sessions.get((source, asked.session))
        if session is None:
            return refused(source, asked, INVALID_SESSION)
        if asked.size == 0 or asked.size > DATA:
            return refused(source, asked, INVALID_SIZE)
        session.used_s, session.link = now_s, link
        if asked.offset >= len(session.data):
            return refused(source, asked, END_OF_FILE)
        is_burst = asked.opcode == BURST_READ
        if is_burst:  # it asks for all that it still wants
            session.reads.clear()
        elif len(session.reads) >= READS:
            session.reads.pop(0)
        session.reads.append(
            _FileRead(
                opcode=asked.opcode,
                sequence=asked.sequence + 1,
                offset=asked.offset,
                size=asked.size,
                pieces=BURST if is_burst else 1,
            )
        )
        return None

    def _list(self, source: Source, asked: FileRequest) -> FileTransferProtocol:
        """The offset counts entries."""
        if path_of(asked.data) != "/":
            return refused(source, asked, FILE_NOT_FOUND)
        entries = [f"F{path[1:]}\t{len(data)}\0" for path, data in sorted(self._files.items())]
        listed = b""
        for entry in entries[asked.offset :]:
            written = entry.encode("ascii")
            if len(listed) + len(written) > DATA:
                break
            listed += written
        return _answer(source, asked, listed) if listed else refused(source, asked, END_OF_FILE)


def request_of(message: FileTransferProtocol) -> FileRequest | None:
    """What a payload asks for; None: it is too short, or an answer."""
    payload = message.payload
    if len(payload) < _HEAD.size:
        return None
    sequence, session, opcode, size, _, _, offset = _HEAD.unpack_from(payload)
    if opcode >= FIRST_ANSWER:
        return None
    end = _HEAD.size + size
    return FileRequest(
        sequence=sequence,
        session=session,
        opcode=opcode,
        size=size,
        offset=offset,
        data=payload[_HEAD.size : end],
    )


def path_of(data: bytes) -> str:
    """The path that a request names, from the root; what is not ASCII names nothing of ours."""
    text = data.partition(b"\0")[0].decode("ascii", "replace")
    return "/" + text.lstrip("/").removeprefix("./")


def refused(source: Source, asked: FileRequest, error: int) -> FileTransferProtocol:
    """The answer to a request that is not carried out."""
    return _payload(source, asked, NAK, bytes((error,)), 0)


def _ack(source: Source, asked: FileRequest) -> FileTransferProtocol:
    return _answer(source, asked, b"")


def _answer(
    source: Source, asked: FileRequest, data: bytes, *, is_burst_complete: bool = False
) -> FileTransferProtocol:
    return _payload(source, asked, ACK, data, 1 if is_burst_complete else 0)


def _payload(
    source: Source, asked: FileRequest, opcode: int, data: bytes, complete: int
) -> FileTransferProtocol:
    sequence = (asked.sequence + 1) % 2**16
    head = _HEAD.pack(
        sequence, asked.session, opcode, len(data), asked.opcode, complete, asked.offset
    )
    return FileTransferProtocol(
        source.system, source.component, (head + data).ljust(PAYLOAD, b"\0")
    )
