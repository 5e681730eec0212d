"""Native code of what flies, made by mypyc from the source that stands here.

`tgl-soar compile` makes it once; `tgl-soar run` takes it wherever it was made of just this source
for just this interpreter, and flies the source as it stands where not.  Nothing else takes it:
simulations, replays and tests go by the source, unless they ask for it.

It lies beside the byte code, or in the folder that $TGL_SOAR_NATIVE names, under a name that
changes with the source of anything that flies.  mypyc leaves out what the fields of named tuples
are; the log's declaration reads them, so they are written down beside the code and put back here.
"""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Sequence
from hashlib import sha256
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, Final

SOURCE: Final = Path(__file__).parent
MANIFEST: Final = "manifest.json"
SUFFIX: Final = EXTENSION_SUFFIXES[0]  # of native code for just this interpreter
LIBRARY: Final = "__mypyc"  # the end of its name: it holds the code of all modules
FOLDERS: Final = (
    *("", "control", "estimation", "flightlog"),
    *("link", "link/autopilots", "link/natnet"),
)  # of what flies
_MADE_BY: Final = ("compile.py", "direct_tuples.py", "direct_tuples.c")  # of the commands

# What every tick goes through.  What reads files, declares or starts things stays as it is.
MODULES: Final = (
    "tgl_soar.types",
    "tgl_soar.geometry",
    "tgl_soar.control.attitude",
    "tgl_soar.control.envelope",
    "tgl_soar.control.heading",
    "tgl_soar.control.pid",
    "tgl_soar.control.scheduling",
    "tgl_soar.control.soaring",
    "tgl_soar.control.supervisor",
    "tgl_soar.control.target_line",
    "tgl_soar.estimation.fix_filter",
    "tgl_soar.estimation.health",
    "tgl_soar.estimation.inertial_track",
    "tgl_soar.estimation.motion",
    "tgl_soar.estimation.turning",
    "tgl_soar.estimation.wind",
    "tgl_soar.autopilot",
    "tgl_soar.flightlog.allowance",
    "tgl_soar.flightlog.recorder",
    "tgl_soar.flightlog.writer",
    "tgl_soar.instruments",
    "tgl_soar.link.autopilots.ardupilot",
    "tgl_soar.link.autopilots.base",
    "tgl_soar.link.autopilots.bridge",
    "tgl_soar.link.autopilots.paparazzi",
    "tgl_soar.link.autopilots.px4",
    "tgl_soar.link.clock",
    "tgl_soar.link.codec",
    "tgl_soar.link.commands",
    "tgl_soar.link.engagement",
    "tgl_soar.link.file_transfer",
    "tgl_soar.link.hot_frames",
    "tgl_soar.link.inquiry",
    "tgl_soar.link.mode_change",
    "tgl_soar.link.natnet.clock",
    "tgl_soar.link.natnet.layout",
    "tgl_soar.link.natnet.track",
    "tgl_soar.link.optitrack",
    "tgl_soar.link.parameters",
    "tgl_soar.link.pose_forwarding",
    "tgl_soar.link.presence",
    "tgl_soar.link.routes",
    "tgl_soar.link.sensing",
    "tgl_soar.link.sensor_clock",
    "tgl_soar.link.session",
    "tgl_soar.link.signing",
    "tgl_soar.link.sources",
    "tgl_soar.link.streams",
    "tgl_soar.link.tangent_plane",
    "tgl_soar.link.telemetry",
    "tgl_soar.link.timesync",
    "tgl_soar.link.transport",
    "tgl_soar.onboard",
    "tgl_soar.loop",
    "tgl_soar.realtime",
)

_told = "interpreted"


def told() -> str:
    """What flies: native code, or the source and why."""
    return _told


def base() -> Path:
    """Where native code is kept, of any source."""
    return Path(os.environ.get("TGL_SOAR_NATIVE") or SOURCE / "__pycache__")


def folder() -> Path:
    """Where native code of just this source, for just this interpreter, is kept."""
    key = sha256(f"{sys.version} {platform.machine()} {SUFFIX}".encode())
    files = [file for name in FOLDERS for file in sorted((SOURCE / name).glob("*.py"))]
    for file in [*files, *(SOURCE / "commands" / name for name in _MADE_BY)]:
        if file.is_file():
            key.update(file.read_bytes())
    return base() / f"native-{key.hexdigest()[:16]}"


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
        _manifest_of(folder())
    except Exception:
        return False
    return True


def sums(kept: Path) -> dict[str, str]:
    """Every file of native code in a folder, and the sum of its bytes."""
    return {
        file.relative_to(kept).as_posix(): sha256(file.read_bytes()).hexdigest()
        for file in sorted(kept.rglob(f"*{SUFFIX}"))
    }


def _manifest_of(kept: Path) -> dict[str, Any]:
    """What was written down beside the code.

    Errors: whatever shows that it is not as it was made, or not made by whom we trust.
    """
    about = kept.stat()
    if about.st_uid not in (0, os.getuid()) or about.st_mode & 0o022:
        raise PermissionError(f"others may write to {kept}")
    manifest: dict[str, Any] = json.loads((kept / MANIFEST).read_text(encoding="utf-8"))
    if manifest["sums"] != sums(kept):
        raise ValueError("it is damaged: compile it again")
    return manifest


def file_of(module: str) -> Path:
    """The source of a module."""
    return SOURCE.joinpath(*module.split(".")[1:]).with_suffix(".py")


def use() -> bool:
    """Take native code wherever a module is imported from now on; whether there is any that fits.

    Never raises: what cannot be used is told, and the source flies.
    """
    global _told
    try:
        kept = folder()
        if not kept.exists():
            stale = " (what was compiled is of another version)" if others() else ""
            _told = f"interpreted{stale}; `tgl-soar compile` makes it four times as quick"
            return False
        manifest = _manifest_of(kept)
        if early := [name for name in MODULES if name in sys.modules]:
            raise ImportError(f"{early[0]} was imported before it")  # never half of each
        finder = _Finder(kept, manifest["fields"])
        sys.meta_path.insert(0, finder)
        for library in finder.libraries:  # what this computer cannot load shows here
            import_module(library)
        _told = f"native, by {manifest['compiler']}"
    except Exception as error:  # it must fly all the same
        sys.meta_path[:] = [f for f in sys.meta_path if not isinstance(f, _Finder)]
        _told = f"interpreted: what was compiled cannot be used: {error}"
        return False
    return True


Fields = dict[str, dict[str, str]]  # of each named tuple, as its source has it


class _Finder:
    """Finds modules in a folder of native code, before Python looks for their source.

    Native modules import each other without asking anybody: whatever has been loaded by the time
    of the next question gets its fields back then.
    """

    def __init__(self, kept: Path, fields: dict[str, Fields]) -> None:
        self._waiting = fields
        self._files = {
            ".".join([*file.relative_to(kept).parts[:-1], file.name.partition(".")[0]]): file
            for file in kept.rglob(f"*{SUFFIX}")
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
        file = self._files.get(name)
        if file is None:
            return None
        return spec_from_file_location(name, file, loader=_Loader(name, str(file), self))

    def give_back(self) -> None:
        """The fields of the named tuples of all modules that are whole."""
        for module in [name for name in self._waiting if name in sys.modules]:
            kinds = vars(sys.modules[module])
            if kinds.keys() >= self._waiting[module].keys():
                for name, fields in self._waiting.pop(module).items():
                    kinds[name].__annotations__ = fields


class _Loader(ExtensionFileLoader):
    """Loads a native module."""

    def __init__(self, name: str, path: str, finder: _Finder) -> None:
        super().__init__(name, path)
        self._finder = finder

    def exec_module(self, module: ModuleType) -> None:
        """As `importlib` asks for it."""
        super().exec_module(module)
        self._finder.give_back()
