"""What was tuned, in writing: every number of the file and of the figure, from made-up results."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.analysis.report import figure_style
from tgl_soar.analysis.report.figure_style import PALETTE
from tgl_soar.analysis.tuning import result as module
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.flights import Outcomes
from tgl_soar.analysis.tuning.result import airframe_with, as_toml, pareto_figure
from tgl_soar.analysis.tuning.search import Candidate
from tgl_soar.analysis.tuning.tune import Effort, FlownRow, Judged, Tuned
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SETS

BEFORE = {PLAIN: Given(0.4, 0.02, 0.1, "here"), INERTIAL: Given(0.5, 0.018, 0.09, "there")}
AFTER = {PLAIN: Given(0.56, 0.015, 0.12, 'at "7" m/s'), INERTIAL: Given(0.6, inf, nan, "")}


def made(**changes: Any) -> Tuned:
    parts: dict[str, Any] = {
        "values": ParameterSet(),
        "parameters": {"RHO_P": 0.5, "RHO_SPEED": 9.25},
        "before": BEFORE,
        "after": AFTER,
        "judged_before": dict.fromkeys(SETS, Judged(60, 3, 20, 0.123)),
        "judged": dict.fromkeys(SETS, Judged(60, 1, 2, 0.4567)),
        "flown": [],
        "candidates": {kind: [] for kind in SETS},
        "flights": [],
    }
    return Tuned(**{**parts, **changes})


TASK: Any = SimpleNamespace(
    airframe=SimpleNamespace(airframe=SimpleNamespace(name="one")),
    site_path=Path("sites/my hill.toml"),
    values=ParameterSet().changed({"CMD_DELAY": 0.0125, "TGL_LEAN_MIN": 5.0, "TGL_LEAN_MAX": 30.0}),
    lean_deg=15.0,
    seed=7,
    effort=Effort(generations=12),
    floor=0.5,
    ranges=Ranges(),
)


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Any:
    found = SimpleNamespace(version="1.2", commit="abc+", source="0123")
    monkeypatch.setattr(module, "manifest", lambda task: found if task is TASK else None)
    monkeypatch.setattr(module, "key_of", lambda each: "key" if each is found else "")

    def write(tuned: Tuned) -> tuple[str, dict[str, Any]]:
        text = as_toml(TASK, tuned, "my.toml", "b")
        return text, tomllib.loads(text)

    return write


def test_the_file_has_gains_and_what_they_are_for(written: Any) -> None:
    text, table = written(made())
    assert text.startswith("# Gains for one, by `tgl-soar tune`.")
    assert table["parameters"] == {"RHO_P": 0.5, "RHO_SPEED": 9.25}
    tuned = table["tuned"]
    assert {name: value for name, value in tuned.items() if not isinstance(value, dict)} == {
        "version": "1.2", "commit": "abc+", "source": "0123", "airframe": "my.toml",
        "site": "my hill.toml", "line": "b", "task": "key", "lean_deg": 15, "latency_ms": 12.5,
        "seed": 7, "generations": 12, "floor": 0.5, "elevator_price_m": 0.03,
    }  # fmt: skip
    assert "floor = 0.5  # of the disk margin; sought with 0.05 more" in text
    assert tuned["grid"] == {"lean_deg": [5, 30]}
    assert tuned["ranges"].keys() == {*Ranges._fields}
    assert tuned["ranges"]["latency_s"] == [0.005, 0.04]
    assert tuned["ranges"]["short_period"] == pytest.approx([0.5217, 1.304])


def test_the_file_has_what_each_set_gave_before_and_after(written: Any) -> None:
    _, table = written(made())
    after, before = (table["tuned"][PLAIN][name] for name in ("after", "before"))
    assert after == {
        "alpha": 0.56, "alpha_at": 'at "7" m/s', "e_rho_m": 0.015, "elevator": 0.12,
        "other_aircraft": 60, "unstable": 1, "below_floor": 2, "least_alpha": 0.457,
    }  # fmt: skip
    assert before == {
        "alpha": 0.4, "alpha_at": "here", "e_rho_m": 0.02, "elevator": 0.1, "other_aircraft": 60,
        "unstable": 3, "below_floor": 20, "least_alpha": 0.123,
    }  # fmt: skip
    other = table["tuned"][INERTIAL]
    assert other["before"]["alpha"] == 0.5
    assert str(other["after"]["e_rho_m"]) == str(other["after"]["elevator"]) == "nan"
    assert "flown" not in table["tuned"]


def test_the_file_has_a_table_for_each_kind_of_flight(written: Any) -> None:
    rows = [
        FlownRow(PLAIN, 0.03, Outcomes(14, 16, 0.0321), Outcomes(16, 16, 0.0123)),
        FlownRow(INERTIAL, 0.05, Outcomes(15, 16, 0.02), Outcomes(16, 16, 0.01)),
    ]
    _, table = written(made(flown=rows))
    first, second = table["tuned"]["flown"]
    assert first == {
        "gains": PLAIN, "turbulence": 0.03, "flights": 16, "up_before": 14, "up": 16,
        "rms_e_rho_m_before": 0.0321, "rms_e_rho_m": 0.0123,
    }  # fmt: skip
    assert (second["gains"], second["turbulence"]) == (INERTIAL, 0.05)


def test_words_are_quoted_whatever_stands_in_them() -> None:
    for words in ('a "b"', "back\\slash", "ü"):
        assert tomllib.loads(f"x = {module._text(words)}") == {"x": words}
    assert tomllib.loads(f"x = {module._text('a' + chr(10) + 'b')}") == {"x": "a b"}


# --- into an airframe file ------------------------------------------------------------------------


def test_a_key_that_stands_there_is_replaced_and_no_other() -> None:
    text = "[model]\nRHO_P = 1\n[parameters]\nRHO_P = 0.1 # old\nRHO_PP = 3\n[polar]\nRHO_P = 2\n"
    assert airframe_with(text, {"RHO_P": 0.5}) == (
        "[model]\nRHO_P = 1\n[parameters]\nRHO_P = 0.5  # tuned\nRHO_PP = 3\n[polar]\nRHO_P = 2\n"
    )


def test_a_key_that_is_not_there_is_put_at_the_tables_top() -> None:
    text = "a = 1\n[parameters]  # mine\nX = 1\n\n[polar]\nc0 = 1\n"
    assert airframe_with(text, {"RHO_P": 0.5, "RHO_D": 0.25}, "by hand") == (
        "a = 1\n[parameters]  # mine\nRHO_P = 0.5  # by hand\nRHO_D = 0.25  # by hand\nX = 1\n\n"
        "[polar]\nc0 = 1\n"
    )


def test_a_file_without_the_table_gets_one_at_its_end() -> None:
    text = airframe_with("[airframe]\na = 1\n\n\n", {"RHO_P": 0.5})
    assert text == "[airframe]\na = 1\n\n[parameters]\nRHO_P = 0.5  # tuned\n"


# --- the figure -----------------------------------------------------------------------------------


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Figures instead of files."""
    pytest.importorskip("matplotlib")
    figures: list[Any] = []
    monkeypatch.setattr(figure_style, "save", lambda _plt, figure, _path: figures.append(figure))
    yield figures
    import matplotlib.pyplot as plt

    plt.close("all")


def test_every_candidate_and_the_front_are_drawn_over_margin_and_activity(kept: list[Any]) -> None:
    beaten, kept_one, ringing = (
        Candidate((1.0,), Given(0.5, 0.03, 0.2, "")),
        Candidate((2.0,), Given(0.55, 0.02, 0.15, "")),
        Candidate((3.0,), Given(0.0, inf, inf, "")),
    )
    candidates = {PLAIN: [beaten, kept_one, ringing], INERTIAL: [kept_one]}
    pareto_figure(Path("x.svg"), made(candidates=candidates), 0.45, "my aircraft")
    (figure,) = kept
    margins, activities = figure.axes[0:2], figure.axes[2:4]
    for panel, field in ((margins[0], "alpha"), (activities[0], "elevator")):
        found = {line.get_label(): line.get_xydata().tolist() for line in panel.lines[:4]}
        assert found == {
            "sought": [
                [getattr(c.given, field), pytest.approx(100.0 * c.given.e_rho_m)]
                for c in (beaten, kept_one)
            ],
            "beaten by none": [[getattr(kept_one.given, field), pytest.approx(2.0)]],
            "before": [[getattr(BEFORE[PLAIN], field), pytest.approx(2.0)]],
            "after": [[getattr(AFTER[PLAIN], field), pytest.approx(1.5)]],
        }
        colours = [line.get_color() for line in panel.lines[:4]]
        assert colours == ["0.75", PALETTE[1], PALETTE[0], PALETTE[2]]
        markers = [line.get_marker() for line in panel.lines[:4]]
        assert markers == [".", ".", "s", "*"]
        assert panel.get_ylabel() == "e_rho in gusts [cm]"
        # A fifth above what matters: the gains of before, here, and the front.
        assert panel.get_ylim() == pytest.approx((0.0, 1.2 * 2.0))
    assert [panel.get_title() for panel in margins] == ["without", "with accelerometers"]
    for panel in margins:
        (floor,) = (line for line in panel.lines if line.get_label() == "floor")
        assert [*floor.get_xdata()] == [0.45, 0.45]
        assert panel.get_xlabel() == "least disk margin α"
    for panel in activities:
        assert panel.get_xlabel() == "elevator activity (standard deviation)"
        assert not [line for line in panel.lines if line.get_label() == "floor"]
    assert [panel.get_legend() is not None for panel in (*margins, *activities)] == [
        False, True, False, False,
    ]  # fmt: skip
    assert figure.get_suptitle() == "my aircraft"


def test_a_picture_of_nothing_stable_is_not_zoomed() -> None:
    called: list[Any] = []
    panel = SimpleNamespace(set_ylim=lambda *limits: called.append(limits))
    module._zoom(panel, [inf, nan])
    assert called == []
    module._zoom(panel, [inf, 2.0, 3.0])
    assert called == [(0.0, pytest.approx(3.6))]
