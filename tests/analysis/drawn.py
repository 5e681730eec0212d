"""What figures, claims and tables show, as numbers and words: what is drawn and where, not in what
style; the text of a claim, with the threshold that stands in it, and whether it holds.

    TGL_SOAR_KEEP_DRAWN=1 pytest -n 0 tests/analysis    records them again

`drawn.json` holds what those of some tests showed the last time.  It says that something has
changed, not what is right.  Whoever changes a figure, a threshold or what flies in it on purpose
records them again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from tgl_soar.analysis.experiments.result import Claim, Table

KEPT: Final = Path(__file__).with_name("drawn.json")
KEEP: Final = "TGL_SOAR_KEEP_DRAWN"
SAME: Final = 1e-4
FAR: Final = 1e12  # a band over all of an axis has corners that are no data


def _in(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{folder}/test_{name}.py" for name in names)


# Tests that show the same whenever they are run: nothing in them is of the clock.
FILES: Final = (
    *_in("campaigns", "campaign_report", "safety_timeline"),
    *_in("experiments", "conclusions", "result"),
    *_in("experiments/aircraft", "airframes", "dispersed", "unseen"),
    *_in("experiments/estimates", "estimator_experiment", "incidence", "wind_estimate", "wind_use"),
    *_in("experiments/lift", "forecast_experiment", "lift_map_experiment", "nowhere"),
    *_in("experiments/loop", "command_delay", "leans"),
    *_in("experiments/outdoors", "beating", "hour", "outdoors", "satellites"),
    *_in("experiments/paper", "air_speed", "changing_air", "field", "gust_response", "line_lean"),
    *_in("experiments/paper", "places", "still_lines"),
    *_in("experiments/point", "brake_faults", "hold_point"),
    *_in("report", "figures", "flight_report", "point_figure"),
    *_in("search", "map_from_log", "search_scoring"),
)

Shown = dict[str, Any]


def in_words(made: Claim | Table) -> Shown:
    """A claim or a table, in its words."""
    if isinstance(made, Claim):
        return {"claim": made.text, "holds": bool(made.holds), "measured": made.measured}
    return {"table": made.title, "columns": [*made.columns], "rows": [[*row] for row in made.rows]}


def shown(figure: Any) -> list[Shown]:
    """For each of a figure's axes: words, scales, limits, and the means of what is drawn; then the
    figure's own words, if it has any."""
    own = [word for legend in figure.legends for word in _words(legend.get_texts())]
    own += _words(figure.texts)
    return [*(_axes(axes) for axes in figure.axes), *([{"figure": own}] if own else [])]


def _axes(axes: Any) -> Shown:
    return {
        "words": [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()],
        "scales": [axes.get_xscale(), axes.get_yscale()],
        "limits": _rounded([*axes.get_xlim(), *axes.get_ylim()]),
        "lines": [_rounded(_means(*line.get_data())) for line in axes.lines],
        "patches": [_rounded(_of_path(each.get_path())) for each in axes.patches],
        "collections": [_rounded(_collection(each)) for each in axes.collections],
        "images": [_rounded(_means(each.get_array())) for each in axes.images],
        "texts": [[each.get_text(), *_rounded(_place(each))] for each in axes.texts],
        "legend": [] if axes.get_legend() is None else _words(axes.get_legend().get_texts()),
    }


def _collection(each: Any) -> list[float]:
    values = each.get_array()
    paths = [number for path in each.get_paths()[:4] for number in _of_path(path)]
    return [
        *_means(each.get_offsets()),
        *paths,
        *(_means(values) if values is not None else []),
    ]


def _of_path(path: Any) -> list[float]:
    return _means(path.vertices[:, 0], path.vertices[:, 1])


def _means(*columns: Any) -> list[float]:
    """Of each column how many are known, their mean and their mean square's root."""
    found: list[float] = []
    for column in columns:
        values: Any = np.ma.filled(np.ma.asarray(column, dtype=float), np.nan).ravel()
        values = values[np.abs(values) < FAR]  # false for NaN
        spread = [float(values.mean()), float(values.std())] if values.size else []
        found += [float(values.size), *spread]
    return found


def _place(text: Any) -> list[float]:
    return [each for each in text.get_position() if isinstance(each, int | float)]


def _words(texts: Iterable[Any]) -> list[str]:
    return [each.get_text() for each in texts]


def _rounded(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]


def differences(before: Any, now: Any, place: str = "") -> list[str]:
    """Where two figures show something else."""
    if isinstance(before, dict) and isinstance(now, dict) and before.keys() == now.keys():
        pairs = [(f"{place}.{key}", before[key], now[key]) for key in before]
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = [(f"{place}[{i}]", *pair) for i, pair in enumerate(zip(before, now, strict=True))]
    elif isinstance(before, float) and isinstance(now, float):
        near = abs(before - now) <= SAME * max(abs(before), abs(now)) + 1e-9
        return [] if near else [f"{place}: {before:.6g} -> {now:.6g}"]
    else:
        return [] if before == now else [f"{place}: {before!r} -> {now!r}"]
    return [found for pair in pairs for found in differences(pair[1], pair[2], pair[0])]


def kept() -> dict[str, Any]:
    """What each test showed, in the order in which it was made."""
    if not KEPT.exists():
        return {}
    found: dict[str, Any] = json.loads(KEPT.read_text(encoding="utf-8"))
    return found


def keep(test: str, noted: list[Any]) -> None:
    """Keep what one test showed."""
    found = {name: each for name, each in kept().items() if name != test}
    if noted:
        found[test] = noted
    KEPT.write_text(json.dumps(found, sort_keys=True, indent=0) + "\n", encoding="utf-8")
