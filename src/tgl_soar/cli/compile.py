"""`tgl-soar compile`: native code of what flies, by mypyc, for `tgl-soar run`."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Final

import typer

from tgl_soar.cli.console import AIRFRAME, SITE, console, fail
from tgl_soar.cli.direct_tuples import IN_C, direct, fields_of, kinds_of
from tgl_soar.onboard import native

# No product and sum in one rounding: native code gives the very numbers of the source.  Nobody
# else's functions stand in for ours: they are called without asking.
_FLAGS: Final = "-ffp-contract=off -fno-semantic-interposition -fno-plt"
_CONFIG: Final = "[mypy]\nignore_missing_imports = True\n"
_SETUP: Final = """\
from mypyc.build import mypycify
from setuptools import Extension, setup

modules = mypycify({files!r})
setup(name="tgl_soar", ext_modules=[*modules, Extension("tgl_soar_tuples", [{in_c!r}])])
"""
_WORK: Final = "making-native-"  # what a folder to work in is called
_LAST_LINES: Final = 20  # of what the compiler said
_STAY_S: Final = 4.0  # on each line, in the flight that is flown by both
_NEEDED: Final = (
    "a C compiler and Python's headers are needed (Debian, Ubuntu: apt install gcc python3-dev)"
)


class CompileError(Exception):
    """Why there is no native code."""


def compile_command(
    again: Annotated[
        bool, typer.Option("--again", help="Compile again, even if it exists already.")
    ] = False,
    remove: Annotated[
        bool,
        typer.Option("--remove", help="Remove the native code; then the source is interpreted."),
    ] = False,
) -> None:
    """Make native code of the flying modules: ticks are then over twice as fast. It takes minutes.

    It is stored beside the package, or in the folder that TGL_SOAR_NATIVE names.
    """
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # nothing is left behind
    try:
        if remove:
            for path in (native.folder(), *native.others()):
                shutil.rmtree(path, ignore_errors=True)
            console.print("removed: the source flies")
            return
        if again or not native.is_made():
            make(lambda words: console.print(words, highlight=False, soft_wrap=True))
        console.print(f"ready: {native.folder()}", highlight=False, soft_wrap=True)
    except CompileError as error:
        fail(error, 1)
    except OSError as error:
        fail(f"{error}; TGL_SOAR_NATIVE may name another folder to keep native code in", 1)
    finally:
        signal.signal(signal.SIGTERM, before)


def make(say: Callable[[str], None]) -> None:
    """Compile, fly it beside the source, and keep it.

    Errors: `CompileError`; OSError where it cannot be kept.
    """
    if find_spec("mypyc") is None or find_spec("setuptools") is None:
        raise CompileError("mypyc is not installed: pip install 'tgl_soar[native]'")
    kept = native.folder()
    base = kept.parent
    base.mkdir(parents=True, exist_ok=True)
    try:
        with native.trusted(base):
            pass
    except PermissionError as error:
        raise CompileError(f"native code in {base} would not be used: {error}") from None
    with _alone(base), TemporaryDirectory(prefix=_WORK, dir=base) as name:
        work = Path(name)
        made = work / "made" / kept.name
        made.parent.mkdir(mode=0o700)
        say(f"compiling {len(native.MODULES)} modules: four minutes on a server")
        _compile(work)
        _collect(work, made)
        say("flying the source and the native code of it: the same flight, to the last bit")
        _check(made.parent, work)
        stale = native.others()
        if kept.exists():  # never half of the one and half of the other
            kept.rename(work / "before")
        made.rename(kept)
        for path in stale:
            shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _alone(base: Path) -> Iterator[None]:
    """One compiles at a time; what an earlier one left behind when it was killed goes."""
    with (base / "native.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise CompileError(f"somebody else is compiling into {base}") from None
        for left in base.glob(f"{_WORK}*"):
            shutil.rmtree(left, ignore_errors=True)
        yield


def _compile(work: Path) -> None:
    """mypyc on a copy of what flies: nothing of its work is to lie about beside the source."""
    for file in native.sources():
        to = work / file.relative_to(native.SOURCE.parent)
        to.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, to)
    _make_tuples_direct(work)
    (work / "mypy.ini").write_text(_CONFIG, encoding="utf-8")
    files = [str(native.file_of(name).relative_to(native.SOURCE.parent)) for name in native.MODULES]
    files.append(f"{native.COMPILED_IN}.py")
    (work / files[-1]).write_text(f'KEY = "{native.source_key()}"\n', encoding="utf-8")
    shutil.copy(Path(__file__).with_name(IN_C), work)
    (work / "setup.py").write_text(_SETUP.format(files=files, in_c=IN_C), encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "setup.py", "build_ext", "--inplace"],
        cwd=work,
        env={**os.environ, "CFLAGS": _FLAGS},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as run:
        try:
            output, _ = run.communicate()
        except BaseException:
            os.killpg(run.pid, signal.SIGKILL)  # the compiler that it has called too
            raise
    if run.returncode != 0:
        last = "\n".join(output.splitlines()[-_LAST_LINES:])
        raise CompileError(f"{last}\nit could not be compiled; {_NEEDED}")


def _make_tuples_direct(work: Path) -> None:
    """In the copy; what a tick makes most of is tuples."""
    sources = {
        ".".join(file.relative_to(work).with_suffix("").parts): file.read_text(encoding="utf-8")
        for file in work.joinpath("tgl_soar").rglob("*.py")
    }
    declared = {name: kinds_of(source) for name, source in sources.items()}
    for name in native.MODULES:
        file = work / native.file_of(name).relative_to(native.SOURCE.parent)
        file.write_text(direct(name, sources[name], declared), encoding="utf-8")


def _collect(work: Path, made: Path) -> None:
    """What the compiler made, and what it left out."""
    for file in [*work.glob("*.so"), *work.joinpath("tgl_soar").rglob("*.so")]:
        to = made / file.relative_to(work)
        to.parent.mkdir(parents=True, exist_ok=True)
        file.rename(to)
    fields = {
        name: fields_of(native.file_of(name).read_text(encoding="utf-8")) for name in native.MODULES
    }
    manifest = {
        "compiler": f"mypyc {version('mypy')}",
        "python": sys.version,
        "source": str(native.SOURCE),
        "key": native.source_key(),
        "fields": fields,
        "sums": native.sums(made),
    }
    (made / native.MANIFEST).write_text(json.dumps(manifest, indent=1), encoding="utf-8")
    for path in (made, *made.rglob("*")):  # for all to read, as the package, and on the disk
        path.chmod(0o755 if path.is_dir() else 0o644)
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _check(base: Path, work: Path) -> None:
    """One flight between real processes by both: where the aircraft was, byte by byte."""
    flown = {}
    for name, kept, code in (
        ("source", work / "none", "interpreted"),
        ("native", base, "native"),
    ):
        flown[name] = _flown(work / name, kept)
        printed = (work / name / "module.log").read_text(encoding="utf-8")
        if f"code: {code}" not in printed:
            raise CompileError(f"it cannot be loaded here: {printed.partition('code: ')[2][:300]}")
    if flown["source"] != flown["native"]:
        raise CompileError(
            "native code flies differently from its source, and is not kept: the compiler errs"
        )


def _flown(out: Path, kept: Path) -> bytes:
    """A short flight, and by what the module flew: the truth of the simulation."""
    from tgl_soar.sim.sitl import fly
    from tgl_soar.sim.sitl_options import SitlError, SitlOptions

    before = os.environ.get("TGL_SOAR_NATIVE")
    os.environ["TGL_SOAR_NATIVE"] = str(kept)  # the module's process inherits it
    try:
        fly(SitlOptions(AIRFRAME, SITE, out, stay_s=_STAY_S), lambda _operator: None)
    except SitlError as error:
        raise CompileError(f"the flight that should check it failed: {error}") from None
    finally:
        if before is None:
            del os.environ["TGL_SOAR_NATIVE"]
        else:
            os.environ["TGL_SOAR_NATIVE"] = before
    return (out / "truth.csv").read_bytes()
