"""How every figure looks: one library, one palette, one way to disk.

The palette (Okabe and Ito's) is told apart by the colour-blind and in grey print.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PALETTE: Final = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GROUND: Final = "#5b4636"

# Of every mode of the supervisor, in its order: grey on the ground and where the pilot flies.
MODE_COLOURS: Final = {
    "boot": "#EEF0F2",
    "standby": "#D9DDE1",
    "ready": "#B5CFE2",
    "capturing": "#E69F00",
    "soaring": "#009E73",
    "holding": "#CC79A7",
    "recovering": "#D55E00",
    "released": "#5A626B",
    "failed": "#1F2429",
    "searching": "#56B4E9",
    "launching": "#F0E442",
    "breaking off": "#B8860B",
    "landing": "#0072B2",
    "beating": "#8FD9C4",
}
DARK_MODES: Final = frozenset(  # a name on them is written in white
    ("soaring", "recovering", "released", "failed", "breaking off", "landing")
)

_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

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
    "text.parse_math": False,  # names come from logs and files: a $ in one is a $
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
    """Write a figure (PNG or SVG by the path's ending), the same bytes for the same picture.

    A PNG is reduced to 200 colours, which no eye tells from all and which halves the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".png":
        from PIL import Image  # comes with matplotlib

        pixels = BytesIO()
        figure.savefig(pixels, format="png", dpi=110)
        picture = Image.open(pixels).convert("RGB")
        picture.quantize(colors=200, dither=Image.Dither.NONE).save(path, optimize=True)
    else:
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
    plt.close(figure)


def power_of_ten(value: float, _place: object = None) -> str:
    """A tick of a logarithmic axis: matplotlib's own are mathematics, which is not parsed here."""
    if not log10(value).is_integer():  # on an axis of less than a decade
        return f"{value:g}"
    return "10" + f"{log10(value):.0f}".translate(_RAISED)
