"""What every experiment concludes, from made-up flights (`made_up.py`).

Its claims are judged, its tables filled and its figures drawn without the hours that its flights
take; what they show is kept (`drawn.py`), with the words that stand beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from made_up import MadeUp
from plans import PLANNED

from tgl_soar.analysis.experiments import context as contexts
from tgl_soar.analysis.experiments.catalogue import EXPERIMENTS, run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import estimator_flights
from tgl_soar.analysis.experiments.point import good_brakes
from tgl_soar.analysis.experiments.result import Result, Table, plain

# These look for many lines on the contour, which takes seconds each; some are asked for one seed.
LEFT_OUT: Final = ("command_delay", "leans")
FEW: Final = ("back", "incidence", "latency", "lean", "places", "point", "speed", "wind")
NAMES: Final = tuple(name for name in (*PLANNED, "margins") if name not in LEFT_OUT)
# These fly or compute for long to draw.
NOT_DRAWN: Final = ("beating", "hour", "identification", "places", "point", "search")
# Whose flights say all by themselves: no path is scored against an aircraft that is drawn.
UNSCORED: Final = (
    *("beating", "hour", "identification", "nowhere", "outdoors", "rangefinder", "satellites"),
    *("search", "survey", "throttle", "unseen", "wind_estimate", "wind_use"),
)
LOST: Final = (*UNSCORED, "airframes", "dispersed", "point", "static", "translate")


def case(name: str) -> Any:
    """An experiment, and in the test's name the module that it is in: `tools/mutate.py` begins with
    the tests that are named after what it has changed."""
    return pytest.param(name, id=f"{name}-{EXPERIMENTS[name].__module__.rpartition('.')[2]}")


@pytest.fixture(autouse=True)
def the_same_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """With numba and without; and of a figure no pixels are painted."""
    for module in (contexts, estimator_flights):
        monkeypatch.setattr(module, "available", lambda: False)
    monkeypatch.setattr(good_brakes, "available", lambda: True)  # it flies nothing without
    backends = pytest.importorskip("matplotlib.backend_bases", reason="figures need matplotlib")
    monkeypatch.setattr(backends.FigureCanvasBase, "print_figure", speck)


def speck(_canvas: object, file: Any, **_: object) -> None:
    """The least picture that there is, in the place of a figure."""
    from PIL import Image

    Image.new("RGB", (1, 1)).save(file, format="png")


def concluded(result: Result, flyer: MadeUp) -> Table:
    """What stands beside claims, tables and figures."""
    rows = [
        ("flown", result.flown),
        ("why", result.why),
        *(("badly", f"{len(result.badly)}: {each}; …") for each in result.badly[:1]),
        ("verdict", result.verdict),
        ("of", f"{result.scenarios} {result.seeds[:9]} {result.figures} {result.own}"),
        *((f"asked for by {by}", str(count)) for by, count in flyer.lists),
        *((each.claim, f"{each.was} / {each.now} / {each.why}") for each in result.changed),
        *((name, sums(value)) for name, value in list(plain(result.numbers).items())[:12]),
    ]
    return Table(result.title, ("what", "is"), tuple(rows))


def sums(value: Any) -> str:
    """How many numbers something holds, and their sum."""
    found = list(numbers(value))
    return f"{len(found)} of {sum(found):.5g}"


def numbers(value: Any) -> Iterator[float]:
    if isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from numbers(each)
    elif isinstance(value, int | float):
        yield float(value)


@pytest.mark.parametrize("name", list(map(case, NAMES)))
def test_an_experiment_concludes(name: str, tmp_path: Path) -> None:
    flyer = MadeUp()
    figures = None if name in NOT_DRAWN else tmp_path
    result = run(name, Context(flyer=flyer, figures=figures, quick=name in FEW))
    assert all(len(row) == len(table.columns) for table in result.tables for row in table.rows)
    texts = [claim.text for claim in result.claims]
    assert len(set(texts)) == len(texts)  # a page lists them by their text
    concluded(result, flyer)


@pytest.mark.parametrize("name", list(map(case, UNSCORED)))
def test_a_few_dispersed_flights_conclude(name: str) -> None:
    flyer = MadeUp()
    concluded(run(name, Context(flyer=flyer, quick=True, dispersion=True)), flyer)


@pytest.mark.parametrize("name", list(map(case, LOST)))
def test_what_loses_every_flight_is_not_said_to_agree(name: str) -> None:
    """Losses are counted: whatever claims something of flights does not hold of none.  And an
    experiment that loses all has something to report."""
    result = run(name, Context(flyer=MadeUp(lost=True), quick=True))
    assert result.verdict not in ("agrees", "met"), result.claims
