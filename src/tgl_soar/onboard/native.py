"""Native code of what flies, made by mypyc from the source that stands here.

`tgl-soar compile` makes it once; `tgl-soar run` takes it wherever it was made of just this source
for just this interpreter, and flies the source as it stands where not.  Nothing else takes it:
simulations, replays and tests go by the source, unless they ask for it.

It lies beside the byte code, or in the folder that $TGL_SOAR_NATIVE names, under a name that
changes with the source of anything that flies.

Whoever can put a file there flies the aircraft, as root perhaps.  So it is taken only where nobody
but root and the user that flies can write, from the root of the file system down, and is never
looked up twice: the folder is held open while it is checked, each file while its bytes are summed,
and what is loaded is that open file (`/proc/self/fd`), whatever has become of its name since.  The
sum of the source stands in the manifest and, compiled in, in the library itself: a folder of
another version under this version's name is refused.

mypyc leaves out what the fields of named tuples
are; the log's declaration reads them, so they are written down beside the code and put back here.
"""

from __future__ import annotations

import errno
import grp
import json
import os
import platform
import pwd
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, Final

SOURCE: Final = Path(__file__).parents[1]
MANIFEST: Final = "manifest.json"
COMPILED_IN: Final = "tgl_soar_source"  # a module that says of what source its library was made
SUFFIX: Final = EXTENSION_SUFFIXES[0]  # of native code for just this interpreter
LIBRARY: Final = "__mypyc"  # the end of its name: it holds the code of all modules
DOORS: Final = ("config", "control", "estimation", "link", "onboard")  # folders of what flies
_MADE_BY: Final = ("compile.py", "direct_tuples.py", "direct_tuples.c")  # of the command line

# What a tick spends its time in.  What reads files, declares or starts things, and the switches and
# watches that look a few times a second, stay as they are.
MODULES: Final = (
    "tgl_soar.types",
    "tgl_soar.geometry",
    "tgl_soar.control.attitude",
    "tgl_soar.control.envelope",
    "tgl_soar.control.brake_watch",
    "tgl_soar.control.brake_shake",
    "tgl_soar.control.point_hold",
    "tgl_soar.control.excitation",
    "tgl_soar.control.line_room",
    "tgl_soar.control.forecast",
    "tgl_soar.control.heading",
    "tgl_soar.control.airspeed_error",
    "tgl_soar.control.wind_triangle",
    "tgl_soar.control.weaving",
    "tgl_soar.control.airspeed_hold",
    "tgl_soar.control.landing",
    "tgl_soar.control.ridge_beat",
    "tgl_soar.control.glide_home",
    "tgl_soar.control.lateral_schedule",
    "tgl_soar.control.launch",
    "tgl_soar.control.pitch_schedule",
    "tgl_soar.control.pid",
    "tgl_soar.control.gain_blend",
    "tgl_soar.control.soaring",
    "tgl_soar.control.supervisor",
    "tgl_soar.control.target_line",
    "tgl_soar.control.throttle",
    "tgl_soar.estimation.fix_filter",
    "tgl_soar.estimation.ground_range",
    "tgl_soar.estimation.health",
    "tgl_soar.estimation.inertial_track",
    "tgl_soar.estimation.motion_state",
    "tgl_soar.estimation.position_fixes",
    "tgl_soar.estimation.motion",
    "tgl_soar.estimation.attitude_track",
    "tgl_soar.estimation.aerodynamics",
    "tgl_soar.estimation.body_axes",
    "tgl_soar.estimation.accelerometer_bias",
    "tgl_soar.estimation.pitot_watch",
    "tgl_soar.estimation.wind",
    "tgl_soar.estimation.cross_wind",
    "tgl_soar.control.laws",
    "tgl_soar.control.envelope_margins",
    "tgl_soar.control.conditions",
    "tgl_soar.control.point",
    "tgl_soar.control.estimates",
    "tgl_soar.control.surface_loops",
    "tgl_soar.control.launch_landing",
    "tgl_soar.control.power",
    "tgl_soar.autopilot",
    "tgl_soar.onboard.flightlog.allowance",
    "tgl_soar.onboard.flightlog.recorder",
    "tgl_soar.onboard.flightlog.ulog_messages",
    "tgl_soar.onboard.flightlog.spool",
    "tgl_soar.onboard.flightlog.disk",
    "tgl_soar.onboard.flightlog.writer",
    "tgl_soar.onboard.telemetry_values",
    "tgl_soar.link.autopilots.ardupilot",
    "tgl_soar.link.autopilots.base",
    "tgl_soar.link.autopilots.bridge",
    "tgl_soar.link.autopilots.paparazzi",
    "tgl_soar.link.autopilots.px4",
    "tgl_soar.link.clock",
    "tgl_soar.link.commands",
    "tgl_soar.link.decoder",
    "tgl_soar.link.encoder",
    "tgl_soar.link.engagement",
    "tgl_soar.link.file_transfer",
    "tgl_soar.link.frames",
    "tgl_soar.link.hot_frames",
    "tgl_soar.link.inbound_messages",
    "tgl_soar.link.autopilot_setup_check",
    "tgl_soar.link.mode_change",
    "tgl_soar.link.natnet.clock",
    "tgl_soar.link.natnet.frame_times",
    "tgl_soar.link.natnet.layout",
    "tgl_soar.link.natnet.diagnostics",
    "tgl_soar.link.natnet.pose_filter",
    "tgl_soar.link.natnet.server",
    "tgl_soar.link.natnet.settings",
    "tgl_soar.link.natnet.track",
    "tgl_soar.link.optitrack",
    "tgl_soar.link.outbound_messages",
    "tgl_soar.link.parameter_server",
    "tgl_soar.link.pose_forwarding",
    "tgl_soar.link.presence",
    "tgl_soar.link.routing",
    "tgl_soar.link.sensor_units",
    "tgl_soar.link.sensor_clock",
    "tgl_soar.link.session",
    "tgl_soar.link.signing",
    "tgl_soar.link.sources",
    "tgl_soar.link.stream_requests",
    "tgl_soar.link.tangent_plane",
    "tgl_soar.link.telemetry",
    "tgl_soar.link.timesync",
    "tgl_soar.link.open_link",
    "tgl_soar.link.transports.addresses",
    "tgl_soar.link.transports.base",
    "tgl_soar.link.transports.byte_stream",
    "tgl_soar.link.transports.serial_line",
    "tgl_soar.link.transports.tcp",
    "tgl_soar.link.transports.udp",
    "tgl_soar.link.vehicle.diagnostics",
    "tgl_soar.link.vehicle.message_rates",
    "tgl_soar.link.vehicle.position_samples",
    "tgl_soar.link.vehicle.sample_times",
    "tgl_soar.link.vehicle.sensor_samples",
    "tgl_soar.link.vehicle.status",
    "tgl_soar.onboard.clocking",
    "tgl_soar.onboard.counters",
    "tgl_soar.onboard.engage_switch",
    "tgl_soar.onboard.links",
    "tgl_soar.onboard.operators",
    "tgl_soar.onboard.outbox",
    "tgl_soar.onboard.external_positions",
    "tgl_soar.onboard.heading_watch",
    "tgl_soar.onboard.reports",
    "tgl_soar.onboard.settings",
    "tgl_soar.onboard.surface_control",
    "tgl_soar.onboard.warm_up",
    "tgl_soar.onboard.module",
    "tgl_soar.onboard.loop",
    "tgl_soar.onboard.pacing",
    "tgl_soar.onboard.realtime",
)

_reported = "interpreted"


def words() -> str:
    """What flies: native code, or the source and why."""
    return _reported


def base() -> Path:
    """Where native code is kept, of any source."""
    return Path(os.environ.get("TGL_SOAR_NATIVE") or SOURCE / "__pycache__")


def source_key() -> str:
    """The sum of this source and of this interpreter."""
    key = sha256(f"{sys.version} {platform.machine()} {SUFFIX}".encode())
    for file in [*sources(), *(SOURCE / "cli" / name for name in _MADE_BY)]:
        if file.is_file():
            key.update(file.read_bytes())
    return key.hexdigest()


def folder() -> Path:
    """Where native code of just this source, for just this interpreter, is kept."""
    return base() / f"native-{source_key()[:16]}"


def sources() -> list[Path]:
    """Every file of what flies."""
    in_doors = (sorted((SOURCE / door).rglob("*.py")) for door in DOORS)
    return [*sorted(SOURCE.glob("*.py")), *(file for files in in_doors for file in files)]


def others() -> list[Path]:
    """Folders with native code of another version of this source, for this interpreter."""
    mine = folder()
    return [
        path
        for path in sorted(base().glob("native-*"))
        if path != mine and _made_for(path) == [sys.version, str(SOURCE)]
    ]


def _made_for(kept: Path) -> list[str]:
    """The interpreter and the source whose native code lies in a folder; empty: it is none."""
    try:
        manifest = json.loads((kept / MANIFEST).read_text(encoding="utf-8"))
        return [manifest["python"], manifest["source"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def is_made() -> bool:
    """Whether there is native code of just this source, as whole as it was made."""
    try:
        _held(folder(), source_key()).close()
    except Exception:
        return False
    return True


def sums(kept: Path) -> dict[str, str]:
    """Every file of native code in a folder, and the sum of its bytes."""
    return {
        file.relative_to(kept).as_posix(): sha256(file.read_bytes()).hexdigest()
        for file in sorted(kept.rglob(f"*{SUFFIX}"))
    }


class _Held:
    """A folder of native code: what its manifest says, and its files, open."""

    def __init__(self, manifest: dict[str, Any], files: dict[str, int]) -> None:
        self.manifest = manifest
        self.files = files  # descriptors by their place in the folder

    def close(self) -> None:
        for descriptor in self.files.values():
            os.close(descriptor)


def _held(kept: Path, key: str) -> _Held:
    """Native code, checked and held open.

    Errors: whatever shows that it is not as it was made, not of this source, or that others than
    root and we could have put it there.
    """
    files: dict[str, int] = {}
    try:
        with trusted(kept.parent) as parent, _opened(kept.name, parent, kept) as opened:
            with _opened(MANIFEST, opened, kept / MANIFEST) as text:
                _check_trust(text, kept / MANIFEST)
                manifest: dict[str, Any] = json.loads(_bytes_of(text))
            if manifest.get("key") != key:
                raise ValueError("it was made of another version of the source: compile it again")
            found = {}
            for name, descriptor in _files_in(opened, kept):
                files[name] = descriptor
                found[name] = sha256(_bytes_of(descriptor)).hexdigest()
            if found != manifest["sums"]:
                raise ValueError("it is damaged: compile it again")
    except BaseException:
        _Held({}, files).close()
        raise
    return _Held(manifest, files)


@contextmanager
def trusted(path: Path) -> Iterator[int]:
    """A folder, held open, that nobody but root and we can put another in place of.

    Errors: PermissionError, which names the folder above it where others can.
    """
    real = Path(os.path.realpath(path))
    descriptor = os.open("/", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for at, name in enumerate(real.parts):
            where = Path(*real.parts[: at + 1])
            if at > 0:
                with _opened(name, descriptor, where, os.O_PATH) as below:
                    above, descriptor = descriptor, os.dup(below)
                    os.close(above)
            _check_trust(descriptor, where, sticky_will_do=True)
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def _opened(name: str, folder: int, where: Path, how: int = os.O_RDONLY) -> Iterator[int]:
    """What has this name in a folder that is open, if that is no link."""
    flags = how | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(name, flags, dir_fd=folder)
        is_link = stat.S_ISLNK(os.fstat(descriptor).st_mode)  # O_PATH opens the link itself
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise OSError(error.errno, error.strerror, str(where)) from None
        raise PermissionError(f"{where} is a symbolic link") from None
    try:
        if is_link:
            raise PermissionError(f"{where} is a symbolic link")
        yield descriptor
    finally:
        os.close(descriptor)


def _check_trust(descriptor: int, where: Path, *, sticky_will_do: bool = False) -> None:
    """Whether only root and we may write to what is open.  Errors: PermissionError.

    `sticky_will_do`: of a folder above: others may make files of their own there, but neither
    rename nor remove ours (/tmp).
    """
    about = os.fstat(descriptor)
    if about.st_uid not in (0, os.geteuid()):
        raise PermissionError(f"{where} belongs to another user (uid {about.st_uid})")
    by_group = about.st_mode & stat.S_IWGRP and not _is_private(about)
    is_sticky = sticky_will_do and about.st_mode & stat.S_ISVTX
    if (by_group or about.st_mode & stat.S_IWOTH) and not is_sticky:
        raise PermissionError(f"others may write to {where}: chmod go-w {where}")


def _is_private(about: os.stat_result) -> bool:
    """Whether its group is its owner's alone, as Debian and Ubuntu make one for each user."""
    if about.st_gid != about.st_uid:
        return False
    try:
        return set(grp.getgrgid(about.st_gid).gr_mem) <= {pwd.getpwuid(about.st_uid).pw_name}
    except KeyError:  # it has no name, and so no members
        return True


def _files_in(opened: int, kept: Path) -> Iterator[tuple[str, int]]:
    """The place of each file of native code in a folder, and the file, open, for the caller."""
    for root, _, names, folder in os.fwalk(".", dir_fd=opened):
        _check_trust(folder, kept / root)
        for name in sorted(names):
            if name.endswith(SUFFIX):
                where = kept / root / name
                with _opened(name, folder, where) as file:
                    _check_trust(file, where)
                    yield Path(root, name).as_posix(), os.dup(file)


def _bytes_of(descriptor: int) -> bytes:
    with open(descriptor, "rb", closefd=False) as file:
        return file.read()


def file_of(module: str) -> Path:
    """The source of a module."""
    return SOURCE.joinpath(*module.split(".")[1:]).with_suffix(".py")


def use() -> bool:
    """Take native code wherever a module is imported from now on; whether there is any that fits.

    Never raises: what cannot be used is reported, and the source flies.
    """
    global _reported
    held = None
    try:
        key = source_key()
        kept = folder()
        if not os.path.lexists(kept):
            stale = " (what was compiled is of another version)" if others() else ""
            _reported = f"interpreted{stale}; `tgl-soar compile` makes it more than twice as fast"
            return False
        if early := [name for name in MODULES if name in sys.modules]:
            raise ImportError(f"{early[0]} was imported before it")  # never half of each
        held = _held(kept, key)
        finder = _Finder(kept, held)
        sys.meta_path.insert(0, finder)
        for library in finder.libraries:  # what this computer cannot load shows here
            import_module(library)
        if key != import_module(COMPILED_IN).KEY:
            raise ImportError("its code is of another version of the source: compile it again")
        _reported = f"native, by {held.manifest['compiler']}"
    except Exception as error:  # it must fly all the same
        sys.meta_path[:] = [f for f in sys.meta_path if not isinstance(f, _Finder)]
        if held is not None:
            held.close()
        _reported = f"interpreted: what was compiled cannot be used: {error}"
        return False
    return True


Fields = dict[str, dict[str, str]]  # of each named tuple, as its source has it


class _Finder:
    """Finds modules in a folder of native code, before Python looks for their source.

    Native modules import each other without asking anybody: whatever has been loaded by the time
    of the next question gets its fields back then.
    """

    def __init__(self, kept: Path, held: _Held) -> None:
        self._kept = kept
        self._waiting: dict[str, Fields] = held.manifest["fields"]
        self._files = {
            name.partition(".")[0].replace("/", "."): (name, descriptor)
            for name, descriptor in held.files.items()
        }
        self.libraries = [name for name in self._files if name.endswith(LIBRARY)]

    def find_spec(
        self,
        name: str,
        _path: Sequence[str] | None = None,
        _target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """As `importlib` asks for it."""
        self.give_back()
        if name not in self._files:
            return None
        place, descriptor = self._files[name]
        loader = _Loader(name, f"/proc/self/fd/{descriptor}", self._kept / place, self)
        return spec_from_file_location(name, loader.path, loader=loader)

    def give_back(self) -> None:
        """The fields of the named tuples of all modules that are whole."""
        for module in [name for name in self._waiting if name in sys.modules]:
            kinds = vars(sys.modules[module])
            if kinds.keys() >= self._waiting[module].keys():
                for name, fields in self._waiting.pop(module).items():
                    kinds[name].__annotations__ = fields


class _Loader(ExtensionFileLoader):
    """Loads a native module from a file that is open."""

    def __init__(self, name: str, path: str, place: Path, finder: _Finder) -> None:
        """`path`: of the open file; `place`: where it lies, for whoever asks the module."""
        super().__init__(name, path)
        self._place = place
        self._finder = finder

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """As `importlib` asks for it."""
        try:
            return super().create_module(spec)
        except ImportError as error:  # it names the descriptor
            raise ImportError(str(error).replace(self.path, str(self._place))) from None

    def exec_module(self, module: ModuleType) -> None:
        """As `importlib` asks for it."""
        super().exec_module(module)
        module.__file__ = str(self._place)
        self._finder.give_back()
