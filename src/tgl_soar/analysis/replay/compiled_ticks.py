"""Many ticks of a log through the compiled kernel of `autopilot.step`.

What numba makes of the laws is kept in `$XDG_CACHE_HOME/tgl_soar` (or ~/.cache), under a name that
changes with the source of any module below it: nothing stale is ever flown.  To compile takes
some two minutes of a processor, once for each version; to load it a second.

A tick's inputs are one row of numbers, its output another, in the order of their leaves.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, get_type_hints

from numpy.typing import NDArray

from tgl_soar import types
from tgl_soar.autopilot import AutopilotState, Output, step
from tgl_soar.control.laws import Laws
from tgl_soar.onboard.flightlog.topics import is_named_tuple, leaves_of
from tgl_soar.sim.compiled import MODULES, available, compiled

INPUT_LEAVES: Final = tuple(leaves_of(types.Inputs))
OUTPUT_LEAVES: Final = tuple(leaves_of(Output))

# (laws, state, inputs (n, len(INPUT_LEAVES)), outputs (n, len(OUTPUT_LEAVES))) -> state
Ticks = Callable[[Laws, AutopilotState, NDArray[Any], NDArray[Any]], AutopilotState]


def _made_of(kind: type, first: int) -> tuple[str, int]:
    """The expression that makes a tuple of tuples from the row `r`, and the number that is next."""
    if kind is bool:
        return f"r[{first}] != 0.0", first + 1
    if kind in (float, int):
        return f"{kind.__name__}(r[{first}])", first + 1
    assert is_named_tuple(kind)
    arguments = []
    for hint in get_type_hints(kind).values():
        text, first = _made_of(hint, first)
        arguments.append(text)
    return f"{kind.__name__}({', '.join(arguments)})", first


def plain_ticks(tick: Callable[..., Any] = step) -> Ticks:
    """The loop over the rows, in plain Python: the one that is compiled."""
    made, _ = _made_of(types.Inputs, 0)
    lines = (
        "def ticks(laws, state, given, taken):",
        "    for k in range(len(given)):",
        "        r, w = given[k], taken[k]",
        f"        state, output = step(laws, state, {made})",
        *(f"        w[{i}] = output{leaf.place}" for i, leaf in enumerate(OUTPUT_LEAVES)),
        "    return state",
    )
    space: dict[str, Any] = {**vars(types), "step": tick}
    # In this file's name: numba looks for one beside which to keep what it has made.
    exec(compile("\n".join(lines), __file__, "exec"), space)
    ticks: Ticks = space["ticks"]
    return ticks


@cache
def folder() -> Path:
    """Where the kernel of just this source is kept.  Errors: RuntimeError without a home folder."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    source = sha256(f"{sys.version} {version('numba')}".encode())
    for module in (*MODULES, "tgl_soar.onboard.flightlog.topics", __name__):
        spec = find_spec(module)
        assert spec is not None
        assert spec.origin is not None
        source.update(Path(spec.origin).read_bytes())
    return Path(base) / "tgl_soar" / source.hexdigest()[:16]


def is_ready() -> bool:
    """Whether it has been compiled already."""
    try:
        return available() and any(folder().rglob("*.nbi"))
    except (OSError, RuntimeError):
        return False


@cache
def compiled_ticks() -> Ticks:
    """The compiled loop.  Errors: ImportError without numba."""
    plain = plain_ticks(compiled(step))
    import numba
    from numba.core import config

    settings = vars(config)
    before = settings["CACHE_DIR"]
    try:
        settings["CACHE_DIR"] = str(folder())
        made: Ticks = numba.njit(cache=True, nogil=True)(plain)
    except (OSError, RuntimeError):  # nowhere to keep it
        made = numba.njit(nogil=True)(plain)
    finally:
        settings["CACHE_DIR"] = before
    return made
