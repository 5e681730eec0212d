"""How every figure looks: one library, one palette, one way to disk.

The palette (Okabe and Ito's) is told apart by the colour-blind and in grey print.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEG_COLOURS: Final = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GROUND: Final = "#5b4636"

_LOOK: Final[dict[str, Any]] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "legend.fontsize": 8.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "tgl_soar",
}


@contextmanager
def drawing() -> Iterator[Any]:
    """`matplotlib.pyplot` in the project's look, without a display.

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    try:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError:
        raise ImportError("figures need matplotlib: pip install 'tgl_soar[figures]'") from None
    look: Any = _LOOK  # matplotlib's stubs name every key of theirs
    with mpl.rc_context(look):
        yield plt


def save(plt: Any, figure: Figure, path: Path) -> None:
    """Write a figure (PNG or SVG by the path's ending), the same bytes for the same picture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    figure.savefig(path, dpi=110, metadata=metadata)
    plt.close(figure)
