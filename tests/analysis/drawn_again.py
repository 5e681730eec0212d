"""A fixture for tests that draw or claim: `conftest.py` has it; a second one beside it would be a
module of the same name."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import drawn
import pytest

from tgl_soar.analysis.experiments.result import Claim, Table


@pytest.fixture(autouse=True)
def shows_what_it_showed(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Every figure, claim and table that a test of `drawn.FILES` makes shows what it showed."""
    here = Path(__file__).parent
    if here not in request.node.path.parents:
        yield
        return
    file = request.node.path.relative_to(here).as_posix()
    groups = [mark.args[0] for mark in request.node.iter_markers("xdist_group")]
    flies_long = "kernels" in groups or request.node.get_closest_marker("long") is not None
    if file not in drawn.FILES or flies_long:
        yield
        return
    noted: list[Any] = []
    with contextlib.suppress(ImportError):
        from matplotlib.figure import Figure

        saves = Figure.savefig

        def saved(figure: Any, *arguments: Any, **options: Any) -> None:
            noted.append(json.loads(json.dumps(drawn.shown(figure))))
            saves(figure, *arguments, **options)

        monkeypatch.setattr(Figure, "savefig", saved)
    for kind in (Claim, Table):
        monkeypatch.setattr(kind, "__init__", _noting(kind.__init__, noted))
    yield
    test = f"{file}::{request.node.name}"
    if os.environ.get(drawn.KEEP):
        drawn.keep(test, noted)
        return
    changed = drawn.differences(drawn.kept().get(test, []), noted, "shown")
    assert not changed, f"meant? {drawn.KEEP}=1 pytest -n 0 tests/analysis/{file}"


def _noting(makes: Callable[..., None], noted: list[Any]) -> Callable[..., None]:
    def made(self: Any, *arguments: Any, **named: Any) -> None:
        makes(self, *arguments, **named)
        noted.append(json.loads(json.dumps(drawn.in_words(self), default=float)))

    return made
