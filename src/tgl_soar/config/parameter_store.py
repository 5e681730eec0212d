"""Parameters changed over the air, kept over a restart.

What differs from the airframe's and the site's files is written to a file of QGroundControl's
format, named after both, with a checksum on its last line.  Nothing is ever written over:

    FILE.previous   first becomes what FILE holds
    FILE            then becomes the new text
    each            as another file that is synced to the disk and renamed

so that at every moment a kill or a loss of power leaves at least one good copy.  A damaged FILE
is set aside as FILE.damaged, the previous copy is taken, and the operator is told.

The disk may take seconds (an SD card tidying up), so a thread does the writing; the loop only
hands over and looks for the outcome.  It is started after the process has become real-time and
inherits its priority: while it holds the interpreter it must not have to wait for a processor.
"""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from tgl_soar.config.line_changes import Presets, with_changes
from tgl_soar.config.parameter_files import LARGEST_BYTES, read_text, written
from tgl_soar.config.parameters import ParameterError, ParameterSet

INTERVAL_S: Final = 1.0  # between two writes
RETRY_S: Final = 10.0  # after one that failed
STOP_S: Final = 2.0  # so long the end of the process waits for the disk
STACK_BYTES: Final = 256 * 1024  # memory is locked: a thread's stack of 8 MB would be resident
_CHECKSUM: Final = b"# checksum: "


class StoreError(ValueError):
    """A file that cannot be believed; the message says why."""


class Identity(NamedTuple):
    """What the parameters were changed for."""

    airframe: str
    site: str
    system: int = 1
    component: int = 191


class Restored(NamedTuple):
    """What a start begins with."""

    values: ParameterSet
    kept: Mapping[str, float]  # of these, those that come from the store
    notes: tuple[str, ...]  # for the operator
    damaged: bool  # something of it is bad news


def state_folder(environment: Mapping[str, str]) -> Path | None:
    """Where a user's programs keep their state; None if there is no such place."""
    state, home = environment.get("XDG_STATE_HOME", ""), environment.get("HOME", "")
    if state.startswith("/"):
        return Path(state) / "tgl_soar"
    return Path(home) / ".local" / "state" / "tgl_soar" if home.startswith("/") else None


def state_file(folder: Path, airframe: str | Path, site: str | Path) -> Path:
    """The file for an airframe file and a site file."""
    return folder / f"{Path(airframe).stem}-{Path(site).stem}.params"


def to_keep(values: ParameterSet, base: ParameterSet) -> dict[str, float]:
    """What differs from the files' values and may be kept."""
    return {p.name: v for p, v in values if p.in_files and v != base[p.name]}


def state_text(identity: Identity, kept: Mapping[str, float]) -> bytes:
    """The file."""
    rows = written(
        kept.items(), "qgroundcontrol", system=identity.system, component=identity.component
    )
    text = f"{_header(identity)}{rows}".encode()
    return text + _CHECKSUM + f"{crc32(text):08x}\n".encode()


def _header(identity: Identity) -> str:
    return (
        "# tgl_soar: parameters changed over the air. Edit with `tgl-soar params import`.\n"
        f"# airframe: {json.dumps(identity.airframe)}\n"
        f"# site: {json.dumps(identity.site)}\n"
    )


def read_state(data: bytes, identity: Identity, source: str) -> tuple[dict[str, float], list[str]]:
    """Values, and what was passed over.  Errors: `StoreError`."""
    text, mark, checksum = data.rpartition(_CHECKSUM)
    if not mark or checksum != f"{crc32(text):08x}\n".encode():
        raise StoreError("damaged: its checksum is wrong")
    if not text.startswith(_header(identity).encode()):
        raise StoreError("kept for an airframe or a site of another name")
    read = read_text(
        text.decode("utf-8", "replace"), source, component=identity.component, strict=False
    )
    return read.values, list(read.notes)


def restored(
    base: ParameterSet, kept: Mapping[str, float], presets: Presets
) -> tuple[ParameterSet, list[str]]:
    """The files' values with the kept ones on top, as far as they fit; what does not, and why."""
    left, notes = dict(kept), []
    while True:
        try:
            values = with_changes(base, left, presets)
        except ParameterError as error:
            notes.append(f"{error}: passed over")
            if left.pop(error.name, None) is None:
                return base, [*notes, "none of the kept parameters is used"]
            continue
        if values["TGL_PRESET"] != left.get("TGL_PRESET", values["TGL_PRESET"]):
            notes.append("TGL_PRESET = 0: the line stands where it stood, the site's lines do not")
        return values, notes


def write_state(path: Path, data: bytes, previous: bytes | None) -> None:
    """Put a new text in place of the file, whole or not at all, and its last good one beside it; a
    file that is replaced keeps who may read it.  Errors: OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if previous is not None:
        _replace(_beside(path, ".previous"), previous)
    _replace(path, data)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _replace(path: Path, data: bytes) -> None:
    new = _beside(path, ".new")
    try:
        with new.open("wb") as file:
            file.write(data)
            file.flush()
            with suppress(FileNotFoundError):
                os.fchmod(file.fileno(), path.stat().st_mode & 0o777)
            os.fsync(file.fileno())
        new.replace(path)
    except OSError:
        with suppress(OSError):
            new.unlink(missing_ok=True)
        raise


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)


class ParameterStore:
    """One file, read at the start and written while flying."""

    def __init__(
        self, path: Path, identity: Identity, base: ParameterSet, presets: Presets = ()
    ) -> None:
        """`base`: the values of the airframe's and the site's files."""
        self.path = path
        self.writes = 0
        self._identity = identity
        self._base = base
        self._presets = presets
        self._good: bytes | None = None  # what FILE holds, if it is good
        self._kept: dict[str, float] | None = {}  # what it says; None: it has to be written
        self._seen: ParameterSet | None = None
        self._pending = False
        self._failing = False
        self._due_s = float("-inf")
        self._handed_s = float("nan")
        self._handed: dict[str, float] | None = None  # to the writer, outcome not yet known
        self._orders: queue.SimpleQueue[dict[str, float] | None] = queue.SimpleQueue()
        self._outcomes: queue.SimpleQueue[str] = queue.SimpleQueue()  # "": written
        self._writer: threading.Thread | None = None

    @property
    def is_writing(self) -> bool:
        """Whether something was handed to the thread whose outcome has not been seen."""
        return self._handed is not None

    # --- at the start -------------------------------------------------------------------------

    def restore(self, *, looking: bool = False) -> Restored:
        """What was kept, from the file or else from its previous copy.

        A damaged file is set aside, unless one is only `looking`.
        """
        notes: list[str] = []
        for path in (self.path, _beside(self.path, ".previous")):
            try:
                with path.open("rb") as file:
                    data = file.read(LARGEST_BYTES)
                kept, passed_over = read_state(data, self._identity, str(path))
            except FileNotFoundError:
                if path == self.path:
                    notes.append(f"{path}: missing")
            except (OSError, StoreError) as error:
                reason = error.strerror if isinstance(error, OSError) else error
                notes.append(f"{path}: {reason}")
                if isinstance(error, StoreError) and not looking:
                    self._set_aside(path)
            else:
                values, unfit = restored(self._base, kept, self._presets)
                unfit = [f"{path}: {note}" for note in unfit]
                is_main = path == self.path
                if is_main:
                    self._good = data
                    self._kept = to_keep(values, self._base)
                else:
                    self._kept = None
                    notes.append(f"{path}: used in its place")
                notes += [*passed_over, *unfit]
                return Restored(values, to_keep(values, self._base), tuple(notes), bool(notes))
        if len(notes) == 1 and notes[0].endswith(": missing"):
            return Restored(self._base, {}, (), False)  # the first start
        self._kept = None
        notes.append("changed parameters are LOST: the values of the files are used")
        return Restored(self._base, {}, tuple(notes), True)

    def _set_aside(self, path: Path) -> None:
        try:
            path.replace(_beside(path, ".damaged"))
        except OSError:
            return  # it will be told again at the next start

    def save(self, values: ParameterSet) -> None:
        """Write now, and wait for it: not for a process that flies.  Errors: OSError."""
        self._write(to_keep(values, self._base))

    def forget(self) -> bool:
        """Remove the file and its previous copy; whether there was any.  Errors: OSError."""
        paths = [p for p in (self.path, _beside(self.path, ".previous")) if p.exists()]
        for path in paths:
            path.unlink()
        return bool(paths)

    # --- while flying -------------------------------------------------------------------------

    def start(self) -> None:
        """Begin the thread that writes."""
        before = threading.stack_size(STACK_BYTES)
        try:
            self._writer = threading.Thread(target=self._work, name="parameters", daemon=True)
            self._writer.start()
        finally:
            threading.stack_size(before)

    def poll(self, values: ParameterSet, now_s: float) -> list[str]:
        """Have the values written if they have changed; what is to be told the operator."""
        said = self._outcome(now_s)
        if values is not self._seen:
            self._seen = values
            self._pending = to_keep(values, self._base) != self._kept
        late = now_s < self._handed_s  # the clock was changed
        if self._pending and self._handed is None and (now_s >= self._due_s or late):
            self._hand_over(values, now_s)
        return said

    def stop(self, values: ParameterSet) -> list[str]:
        """The process ends: the last changes, unless the disk takes too long."""
        if self._writer is None:
            return []
        said = self._await()  # what it is writing now
        if self._handed is None and to_keep(values, self._base) != self._kept:
            self._hand_over(values, float("-inf"))
            said += self._await()
        self._orders.put(None)
        return said

    def _await(self) -> list[str]:
        if self._handed is None:
            return []
        try:
            outcome = self._outcomes.get(timeout=STOP_S)
        except queue.Empty:
            return [f"parameters are not kept: {self.path}: the disk does not answer"]
        return self._take(outcome, float("-inf"))

    def _hand_over(self, values: ParameterSet, now_s: float) -> None:
        self._handed = to_keep(values, self._base)
        self._handed_s = now_s
        self._due_s = now_s + INTERVAL_S
        self._pending = False
        self._orders.put(self._handed)

    def _outcome(self, now_s: float) -> list[str]:
        if self._handed is None:
            return []
        try:
            outcome = self._outcomes.get_nowait()
        except queue.Empty:
            return []
        return self._take(outcome, now_s)

    def _take(self, error: str, now_s: float) -> list[str]:
        handed, self._handed = self._handed, None
        failed_before, self._failing = self._failing, bool(error)
        if error:
            self._kept = None
            self._pending = True
            self._due_s = now_s + RETRY_S
            return [] if failed_before else [f"parameters are not kept: {error}; flying on"]
        self.writes += 1
        self._kept = handed
        if self._seen is not None:  # taken back while the disk wrote: the old ones count again
            self._pending = to_keep(self._seen, self._base) != handed
        return ["parameters are kept again"] if failed_before else []

    # --- in the thread ------------------------------------------------------------------------

    def _work(self) -> None:
        while (kept := self._orders.get()) is not None:
            try:
                self._write(kept)
            except OSError as error:
                self._outcomes.put(f"{self.path}: {error.strerror or error}")
            else:
                self._outcomes.put("")

    def _write(self, kept: Mapping[str, float]) -> None:
        data = state_text(self._identity, kept)
        write_state(self.path, data, self._good)
        self._good = data
