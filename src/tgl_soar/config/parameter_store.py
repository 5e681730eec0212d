"""Parameters changed over the air, kept over a restart.

What differs from the airframe's and the site's files is written to a file of QGroundControl's
format, with a checksum on its last line.  Its name and its first lines say for which vehicle: both
files' names, the names in them, and the MAVLink ids.  What is kept for another vehicle is never
used, moved or written over, wherever it lies.  Nothing of our own is written over either:

    FILE.previous   first becomes what FILE holds
    FILE            then becomes the new text
    each            as another file that is synced to the disk and renamed

so that at every moment a kill or a loss of power leaves at least one good copy.  A damaged FILE
is set aside as FILE.damaged, the previous copy is taken, which is reported to the operator.

Up to version 0.1.0 the name had no ids, so that vehicles shared a file.  One of such a name is
read, with its previous copy, as long as there is none of the new name; it is left as it is.

The disk may take seconds (an SD card tidying up), so a thread does the writing; the loop only
hands over and looks for the outcome.  It is started after the process has become real-time and
inherits its priority: while it holds the interpreter it must not have to wait for a processor.
"""

from __future__ import annotations

import errno
import json
import os
import queue
import re
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from tgl_soar.config.airframe import COMPONENT_ID
from tgl_soar.config.line_changes import Presets, with_changes
from tgl_soar.config.parameter_files import LARGEST_BYTES, read_text, written
from tgl_soar.config.parameters import (
    ANCHORS,
    INDEX,
    PARAMETERS,
    PITCH_GAINS,
    ParameterError,
    ParameterSet,
    as_wire_value,
)

INTERVAL_S: Final = 1.0  # between two writes
RETRY_S: Final = 10.0  # after one that failed
STOP_S: Final = 2.0  # so long the end of the process waits for the disk
STACK_BYTES: Final = 256 * 1024  # memory is locked: a thread's stack of 8 MB would be resident
_CHECKSUM: Final = b"# checksum: "
# What `state_file` puts behind the stems.
_OWN_ENDING: Final = re.compile(r"-\d+-\d+-[0-9a-f]{8}\.params$")


class StoreError(ValueError):
    """A file that cannot be trusted; the message says why."""


class OtherVehicleError(StoreError):
    """A good file that was kept for another vehicle."""


class Identity(NamedTuple):
    """The vehicle that parameters were changed for: names inside its files, and its ids."""

    airframe: str
    site: str
    system: int = 1
    component: int = COMPONENT_ID


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


def state_file(folder: Path, airframe: str | Path, site: str | Path, identity: Identity) -> Path:
    """The file for a vehicle that an airframe file and a site file describe."""
    ids = f"{identity.system}-{identity.component}"
    names = f"{crc32(_header(identity).encode()):08x}"
    return folder / f"{Path(airframe).stem}-{Path(site).stem}-{ids}-{names}.params"


def old_state_file(folder: Path, airframe: str | Path, site: str | Path) -> Path:
    """What it was called up to version 0.1.0, whatever the vehicle."""
    return folder / f"{Path(airframe).stem}-{Path(site).stem}.params"


def to_keep(values: ParameterSet, base: ParameterSet) -> dict[str, float]:
    """What differs from the files' values and may be kept.

    Of gains that are not the declared aircraft's the whole set, with the aircraft that they are
    for: where they are sought again (`control.pitch_design`), one alone would be for another.
    """
    kept = {p.name: v for p, v in values if p.in_files and v != base[p.name]}
    if has_own_anchors(base) and not kept.keys().isdisjoint(_GAINS):
        kept.update({name: values[name] for name in _GAINS})
    return kept


_GAINS: Final = (*PITCH_GAINS, *ANCHORS)


def has_own_anchors(values: ParameterSet) -> bool:
    """Whether gains of pitch are of another aircraft, speed or lean than the declared one."""
    return any(values[name] != as_wire_value(PARAMETERS[INDEX[name]].default) for name in ANCHORS)


def state_text(identity: Identity, kept: Mapping[str, float]) -> bytes:
    """The file."""
    rows = written(
        kept.items(), "qgroundcontrol", system=identity.system, component=identity.component
    )
    text = f"{_header(identity)}{rows}".encode()
    return text + _CHECKSUM + f"{crc32(text):08x}\n".encode()


def _header(identity: Identity) -> str:
    ids = f"# vehicle: system {identity.system}, component {identity.component}\n"
    return _old_header(identity) + ids


def _old_header(identity: Identity) -> str:
    """As up to version 0.1.0, without the ids."""
    return (
        "# tgl_soar: parameters changed over the air. Edit with `tgl-soar params import`.\n"
        f"# airframe: {json.dumps(identity.airframe)}\n"
        f"# site: {json.dumps(identity.site)}\n"
    )


def read_state(data: bytes, identity: Identity, source: str) -> tuple[dict[str, float], list[str]]:
    """Values, and what was passed over.  Errors: `StoreError`, `OtherVehicleError`."""
    text, mark, checksum = data.rpartition(_CHECKSUM)
    if not mark or checksum != f"{crc32(text):08x}\n".encode():
        raise StoreError("damaged: its checksum is wrong")
    if not _is_for(identity, text):
        raise OtherVehicleError("kept for a vehicle of another name or another MAVLink id")
    read = read_text(
        text.decode("utf-8", "replace"), source, component=identity.component, strict=False
    )
    return read.values, list(read.notes)


def _is_for(identity: Identity, text: bytes) -> bool:
    """Whether a good file is this vehicle's; where its header has no ids, its rows say so."""
    if text.startswith(_header(identity).encode()):
        return True
    start = f"{_old_header(identity)}# Onboard parameters for Vehicle {identity.system}\n".encode()
    row = f"{identity.system}\t{identity.component}\t".encode()
    rows = [line for line in text.splitlines() if not line.startswith(b"#")]
    return text.startswith(start) and all(line.startswith(row) for line in rows)


def restored(
    base: ParameterSet, kept: Mapping[str, float], presets: Presets
) -> tuple[ParameterSet, list[str]]:
    """The files' values with the kept ones on top, as far as they fit; what does not, and why."""
    left, notes = dict(kept), []
    alone = [name for name in kept if name in _GAINS]
    if has_own_anchors(base) and 0 < len(alone) < len(_GAINS):
        notes.append(
            f"{', '.join(alone)}: kept without the aircraft they were for, and its gains may have"
            " been sought since: check the margins, or `tgl-soar params reset`"
        )
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


def _both(path: Path) -> tuple[Path, Path]:
    """A file and its previous copy."""
    return path, _beside(path, ".previous")


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)


class ParameterStore:
    """One file, read at the start and written while flying."""

    def __init__(
        self,
        path: Path,
        identity: Identity,
        base: ParameterSet,
        presets: Presets = (),
        old: Path | None = None,
    ) -> None:
        """`base`: the values of the airframe's and the site's files; `old`: what the file was
        called in earlier versions."""
        self.path = path
        self._old = old
        self.writes = 0
        self.refused = ""  # why nothing can be written there, as `restore` has found
        self._identity = identity
        self._base = base
        self._presets = presets
        self._others: list[Path] = []  # another vehicle's, where ours would lie
        self._good: bytes | None = None  # what FILE holds, if it is good
        self._kept: dict[str, float] | None = {}  # what it says; None: it has to be written
        self._observed: ParameterSet | None = None
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
        """What was kept, from the file or else from its previous copy, or from those of the old
        name.

        A damaged file is set aside, and that nothing can be written is reported, unless one is
        only `looking`.
        """
        found = self._restored(looking=looking)
        self.refused = "" if looking else self.refusal()
        if self.refused:
            found = found._replace(notes=(*found.notes, self.refused), damaged=True)
        return found

    def refusal(self) -> str:
        """Why nothing can be kept where it is to be, in words; "" if it can.  It leaves neither
        file nor folder behind."""
        folder, probe = self.path.parent, _beside(self.path, ".new")
        missing: list[Path] = []
        try:
            missing += [each for each in (folder, *folder.parents) if not each.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            probe.open("ab").close()
            probe.unlink()
        except OSError as error:
            reason = error.strerror or str(error)
            return f"{self.path}: cannot be written: {reason}: changed parameters are NOT stored"
        finally:
            for each in missing:  # the innermost first
                with suppress(OSError):
                    each.rmdir()
        return ""

    def _restored(self, *, looking: bool) -> Restored:
        self._others = [path for path in _both(self.path) if self._is_ours(path) is False]
        found = self._restored_from(self.path, sets_aside=not looking)
        if found is None and self._old is not None:
            found = self._restored_from(self._old, sets_aside=False)
        if found is None:  # the first start
            return Restored(self._base, {}, tuple(self._of_other_ids()), False)
        return found

    def _of_other_ids(self) -> list[str]:
        """What is kept beside it for files of the same names under other ids or names: where a
        file's id was changed, that is what the operator misses."""
        stems = _OWN_ENDING.sub("", self.path.name)
        try:
            names = sorted(path.name for path in self.path.parent.iterdir())
        except OSError:
            return []
        others = [n for n in names if n != self.path.name and _OWN_ENDING.sub("", n) == stems != n]
        who = f"system {self._identity.system}, component {self._identity.component}"
        return [f"nothing is stored for {who}; not used: {', '.join(others)}"] if others else []

    def _restored_from(self, main: Path, *, sets_aside: bool) -> Restored | None:
        """From a file or its previous copy; None: there is nothing of ours."""
        notes: list[str] = []
        is_lost = False
        for path in _both(main):
            try:
                data, kept, passed_over = self._read(path)
            except FileNotFoundError:
                if path == main:
                    notes.append(f"{path}: missing")
            except OtherVehicleError as error:
                if main == self.path:  # an old name may well be another's
                    notes.append(f"{path}: {error}: neither used nor written over")
            except (OSError, StoreError) as error:
                is_lost = True
                reason = error.strerror if isinstance(error, OSError) else error
                notes.append(f"{path}: {reason}")
                if isinstance(error, StoreError) and sets_aside:
                    self._set_aside(path)
            else:
                return self._taken(path, data, kept, [*notes, *passed_over])
        if is_lost:
            self._kept = None
            notes.append("changed parameters are LOST: the values of the files are used")
        elif all(note.endswith(": missing") for note in notes):
            return None
        return Restored(self._base, {}, tuple(notes), True)

    def _taken(self, path: Path, data: bytes, kept: dict[str, float], notes: list[str]) -> Restored:
        """From a good file.  `notes`: what there is to be reported already."""
        values, unfit = restored(self._base, kept, self._presets)
        if path == self.path:
            self._good = data
            self._kept = to_keep(values, self._base)
        else:
            self._kept = None
            if path == self._old:
                notes.append(f"{path}: of an earlier version: kept as {self.path.name} from now on")
            else:
                notes.append(f"{path}: used in its place")
        notes += [f"{path}: {note}" for note in unfit]
        return Restored(values, to_keep(values, self._base), tuple(notes), bool(notes))

    def _read(self, path: Path) -> tuple[bytes, dict[str, float], list[str]]:
        """A file's bytes, its values, and what was passed over.  Errors: OSError, `StoreError`."""
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES)
        return data, *read_state(data, self._identity, str(path))

    def _is_ours(self, path: Path) -> bool | None:
        """Whether a good file is this vehicle's; None: there is none that is good."""
        try:
            self._read(path)
        except OtherVehicleError:
            return False
        except (OSError, StoreError):
            return None
        return True

    def _leave_others(self) -> None:
        """Errors: OSError, where a file of ours would take the place of another vehicle's."""
        if self._others:
            reason = f"{self._others[0].name} is another vehicle's: move it elsewhere"
            raise FileExistsError(errno.EEXIST, reason)

    def _set_aside(self, path: Path) -> None:
        try:
            path.replace(_beside(path, ".damaged"))
        except OSError:
            return  # it will be reported again at the next start

    def save(self, values: ParameterSet) -> None:
        """Write now, and wait for it: not for a process that flies.  Errors: OSError."""
        self._write(to_keep(values, self._base))

    def forget(self) -> bool:
        """Remove the file and its previous copy, and ours of the old name, which would be read
        again; whether there was any.  Errors: OSError."""
        self._leave_others()
        paths = [path for path in _both(self.path) if path.exists()]
        if self._old is not None:
            paths += [path for path in _both(self._old) if self._is_ours(path)]
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
        """Have the values written if they have changed; what is to be reported to the operator."""
        reports = self._outcome(now_s)
        if values is not self._observed:
            self._observed = values
            self._pending = to_keep(values, self._base) != self._kept
        late = now_s < self._handed_s  # the clock was changed
        if self._pending and self._handed is None and (now_s >= self._due_s or late):
            self._hand_over(values, now_s)
        return reports

    def stop(self, values: ParameterSet) -> list[str]:
        """The process ends: the last changes, unless the disk takes too long."""
        if self._writer is None:
            return []
        reports = self._await()  # what it is writing now
        if self._handed is None and to_keep(values, self._base) != self._kept:
            self._hand_over(values, float("-inf"))
            reports += self._await()
        self._orders.put(None)
        return reports

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
        if self._observed is not None:  # taken back while the disk wrote: the old ones count again
            self._pending = to_keep(self._observed, self._base) != handed
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
        self._leave_others()
        data = state_text(self._identity, kept)
        write_state(self.path, data, self._good)
        self._good = data
