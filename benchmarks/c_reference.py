"""The C that Python is held against, compiled where the benchmarks run.

The sources are our own few lines in `c/`; MAVLink's headers are made by the generator that comes
with pymavlink, from the definitions that come with it.  Without a C compiler there is no
reference: the rows that need one are left out, with a word.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from pymavlink.dialects import v20
from pymavlink.generator import mavgen

SOURCES = Path(__file__).parent / "c"
PRIORITY = 60  # of the loops that are held against each other, as the module's own
FLAGS = ("-O2", "-Wall", "-Wno-address-of-packed-member")


class NoCompilerError(Exception):
    """There is nothing to hold Python against."""


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Where it is made; gone at the end of the process."""
    return tempfile.TemporaryDirectory(prefix="tgl_soar_bench_")


@cache
def _headers() -> Path:
    """MAVLink's for C, as the generator makes them."""
    folder = Path(_folder().name) / "mavlink"
    options = mavgen.Opts(str(folder), wire_protocol="2.0", language="C", validate=False)
    definitions = Path(v20.__file__).parent / "common.xml"
    with contextlib.redirect_stdout(io.StringIO()):
        mavgen.mavgen(options, [str(definitions)])
    return folder


@cache
def program(name: str) -> str:
    """The path of one of ours, compiled.  Errors: `NoCompilerError`."""
    compiler = next((found for c in ("cc", "gcc", "clang") if (found := shutil.which(c))), None)
    if compiler is None:
        raise NoCompilerError("no C compiler (cc, gcc or clang): the rows beside C are left out")
    made = Path(_folder().name) / name
    command = [compiler, *FLAGS, f"-I{_headers()}", "-o", str(made), str(SOURCES / f"{name}.c")]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode != 0:
        raise NoCompilerError(f"{name}.c cannot be compiled:\n{run.stderr}")
    return str(made)
