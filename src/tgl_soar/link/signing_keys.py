"""The signing key and the timestamp to begin with, as files that nobody else may read.

A key over the air is taken only where that was allowed, and then kept here.

The timestamp that a file holds is always ahead of all that were used or accepted: a block of
stamps is reserved on the disk before any of it is used, the first at the start, the next ones by
a thread (a disk can be slow, and the loop must not wait for it).  So whatever ends the process,
the next one begins behind every stamp of this one, and no record of it is good again.  The price:
after a kill we sign up to `RESERVE_S` ahead of the clock.  An end in order writes down the very
last stamp, and costs nothing.
"""

from __future__ import annotations

import os
import stat
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar.link.frames import first_frame
from tgl_soar.link.messages import Source
from tgl_soar.link.signing import KEY_BYTES, LAST_STAMP, TICKS_PER_S, Signing, source_of

RESERVE_S: Final = 4.0  # a disk may take half of it to answer; a write every two seconds
STOP_S: Final = 2.0  # so long the end of the process waits for the disk
LOOK_S: Final = 0.25  # between two looks whether to reserve more
DAMAGED: Final = -1  # no stamp of anybody's
_RESERVE: Final = int(RESERVE_S * TICKS_PER_S)


class SigningError(Exception):
    """A key file that cannot be used; the message names it and the way out."""


class Secret(NamedTuple):
    """How links are signed, as the command line gives it."""

    key_file: Path | None = None
    unsigned_autopilot: bool = False  # it need not sign on its own link
    allow_setup: bool = False  # take another key over the air


UNSIGNED: Final = Secret()


def signing_from(secret: Secret, now_s: float, *, reserve: bool = True) -> Signing:
    """The key, if one was given, and a timestamp behind all that were used before.

    `now_s`: of the clock that advances it.  `reserve`: wait for the disk to reserve the next
    block of stamps.  Errors: `SigningError`.
    """
    path = secret.key_file
    if path is None:
        return Signing(None, 0.0, 0.0)
    key = None if secret.allow_setup and _is_missing(path) else load_key(path)
    file = TimestampFile(path)
    signing = Signing(key, time.time(), now_s, file.load())
    if reserve:
        with suppress(OSError):  # the thread tries again, and reports it
            file.reserve(signing)
    return signing


def _is_missing(path: Path) -> bool:
    """Whether a key may be put there yet; what cannot be looked at is for `load_key` to refuse."""
    try:
        path.stat()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return False


def peers_of(signing: Signing, excused: Source | None) -> Callable[[bytes], bool]:
    """Which datagram makes its sender the peer of a link that listens."""

    def is_frame(data: bytes) -> bool:
        frame = first_frame(data)
        if not frame:
            return False
        return signing.vouches(frame) or source_of(frame) == excused

    return is_frame


def keep_timestamp(
    signing: Signing, key_file: Path | None, complain: Callable[[str], None]
) -> Callable[[], None]:
    """Begin to keep the timestamp; the way to end it."""
    if key_file is None:
        return lambda: None
    file = TimestampFile(key_file)
    ended = threading.Event()

    def keep() -> None:
        reported = False
        over = False
        while not over:
            over = ended.wait(LOOK_S)
            try:
                if over:
                    file.save(signing.timestamp)
                elif not file.is_ahead(signing):
                    file.reserve(signing)
            except OSError as error:
                signing.reserved = LAST_STAMP  # operators are not to be shut out by a full disk
                if not reported:
                    reported = True
                    complain(
                        f"the signing timestamp cannot be kept: {error}: after a crash, what was"
                        " recorded of this flight may be accepted again"
                    )

    thread = threading.Thread(target=keep, name="timestamp", daemon=True)
    thread.start()

    def end() -> None:
        ended.set()
        thread.join(STOP_S)

    return end


def load_key(path: Path) -> bytes:
    """The 32 bytes of a key file that nobody else may read.  Errors: `SigningError`."""
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            key = file.read(KEY_BYTES + 1)
    except OSError as error:
        raise SigningError(
            f"{path}: cannot be read: {error.strerror};"
            f" make a key with: (umask 077; head -c {KEY_BYTES} /dev/urandom > {path})"
        ) from None
    if mode & 0o077:
        raise SigningError(
            f"{path}: others may read or write it (mode {mode:04o}), so it is no secret:"
            f" make a new one, and chmod 600 {path}"
        )
    if len(key) != KEY_BYTES:
        size = "more than 32" if len(key) > KEY_BYTES else str(len(key))
        raise SigningError(f"{path}: has {size} bytes; a key has {KEY_BYTES}")
    if key == bytes(KEY_BYTES):
        raise SigningError(f"{path}: all zeros is no key")
    return key


def save_key(path: Path, key: bytes) -> None:
    """Replace a key file in one step.  Errors: OSError."""
    _replace(path, key)


class TimestampFile:
    """A timestamp ahead of all that were used, beside the key: a restart does not go back."""

    def __init__(self, key_path: Path) -> None:
        self._path = key_path.with_name(key_path.name + ".timestamp")
        self._saved = 0

    def load(self) -> int:
        """What was kept; 0 if nothing was, `DAMAGED` if it cannot be read."""
        try:
            return min(LAST_STAMP, int(self._path.read_text(encoding="ascii")))
        except FileNotFoundError:
            return 0
        except (OSError, ValueError):
            return DAMAGED

    def save(self, timestamp: int) -> None:
        """Replace it in one step.  Errors: OSError."""
        _replace(self._path, f"{timestamp}\n".encode())
        self._saved = timestamp

    def is_ahead(self, signing: Signing) -> bool:
        """Whether what it holds is far enough ahead of all that was used."""
        return self._saved >= min(LAST_STAMP, signing.timestamp + _RESERVE // 2)

    def reserve(self, signing: Signing) -> None:
        """The next block of stamps; may be used once it is on the disk.  Errors: OSError."""
        self.save(min(LAST_STAMP, signing.timestamp + _RESERVE))
        signing.reserved = self._saved


def _replace(path: Path, content: bytes) -> None:
    """The whole new content or the whole old one, readable by the owner alone."""
    beside = path.with_name(path.name + ".new")
    fd = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
    try:
        os.fchmod(fd, 0o600)
        os.write(fd, content)
        os.fsync(fd)
    finally:
        os.close(fd)
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)  # the new name, too: power may be lost right now
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
