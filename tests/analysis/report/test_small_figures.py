"""Figures of a replay, of a splitting run and of launches and landings: which numbers are drawn
where, and how many at most."""

from __future__ import annotations

from collections.abc import Iterator
from math import isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tgl_soar.analysis.rare.soaring_process import SHOWN
from tgl_soar.analysis.rare.splitting import Rung
from tgl_soar.analysis.report import passage_figure, rare_figure, replay_figure
from tgl_soar.analysis.report.figure_style import PALETTE

PATH = Path("figure.svg")
TIME_S = np.array([0.0, 0.5, 1.0])


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Figures instead of files."""
    figures: list[Any] = []
    for module in (passage_figure, rare_figure, replay_figure):
        monkeypatch.setattr(module, "save", lambda _plt, figure, _path: figures.append(figure))
    yield figures
    import matplotlib.pyplot as plt

    plt.close("all")


# --- a replay -----------------------------------------------------------------------------------

COMMANDS = ("setpoints_pitch_rad", "command_elevator", "command_aileron", "command_rudder")


def test_a_replay_is_drawn_beside_what_was_logged(kept: list[Any]) -> None:
    """The pitch setpoint in degrees, surfaces as they are."""
    logged = {name: n + TIME_S for n, name in enumerate(COMMANDS)}
    replayed = {name: n - TIME_S for n, name in enumerate(COMMANDS)}
    replay_figure.replay_figure(PATH, TIME_S, logged, replayed, "a replay")
    axes = kept[0].axes
    labels = ["pitch setpoint [deg]", "elevator [-]", "aileron [-]", "rudder [-]"]
    assert [each.get_ylabel() for each in axes] == labels
    for n, each in enumerate(axes):
        scale = np.degrees(1.0) if n == 0 else 1.0
        assert [line.get_label() for line in each.lines] == ["logged", "replayed"]
        assert each.lines[0].get_ydata() == pytest.approx(scale * (n + TIME_S))
        assert each.lines[1].get_ydata() == pytest.approx(scale * (n - TIME_S))
        assert each.lines[0].get_xdata().tolist() == TIME_S.tolist()
        assert each.lines[0].get_color() != each.lines[1].get_color()
    assert axes[-1].get_xlabel() == "time [s]"
    assert kept[0].get_suptitle() == "a replay"
    (legend,) = kept[0].legends
    assert [text.get_text() for text in legend.get_texts()] == ["logged", "replayed"]


def test_what_the_log_lacks_has_no_panel(kept: list[Any]) -> None:
    rows = {"command_rudder": TIME_S}
    replay_figure.replay_figure(PATH, TIME_S, rows, rows, "one")
    assert [each.get_ylabel() for each in kept[0].axes] == ["rudder [-]"]
    assert kept[0].axes[0].get_xlabel() == "time [s]"


# --- a splitting run ----------------------------------------------------------------------------


def lost(height_m: float) -> Any:
    """Two seconds before a loss, each column with a number of its own."""
    rows = np.tile(np.arange(float(len(SHOWN))), (3, 1))
    rows[:, SHOWN.index("time_s")] = [98.0, 99.0, 100.0]
    rows[:, SHOWN.index("z_m")] = height_m
    return rows


def test_a_ladder_goes_from_one_down_by_the_fraction_that_passed(kept: list[Any]) -> None:
    ladders = [
        [Rung(0.5, 100, 20), Rung(0.1, 100, 50), Rung(0.0, 100, 0)],
        [Rung(0.5, 100, 25)],
    ]
    rare_figure.rare_figure(PATH, ladders, [], [])
    axes = kept[0].axes[0]
    first, second = axes.lines
    assert first.get_xdata().tolist() == [1.0, 0.5, 0.1, 0.0]
    assert first.get_ydata()[:3] == pytest.approx([1.0, 0.2, 0.1])
    assert isnan(first.get_ydata()[3])
    assert second.get_ydata() == pytest.approx([1.0, 0.25])
    assert axes.get_yscale() == "log"
    assert axes.get_xlim()[0] > axes.get_xlim()[1]
    assert kept[0].legends == []


def test_losses_are_drawn_by_cause_up_to_their_last_moment(kept: list[Any]) -> None:
    causes = ["ground", "fence", "ground"]
    rare_figure.rare_figure(PATH, [], causes, [lost(3.0), lost(4.0), lost(5.0)])
    _, height, speed, off = kept[0].axes
    assert [line.get_ydata()[0] for line in height.lines[:3]] == [3.0, 4.0, 5.0]
    for axes, name in ((speed, "airspeed_mps"), (off, "e_rho_m")):
        assert [line.get_ydata()[0] for line in axes.lines] == [SHOWN.index(name)] * 3
    for axes in (height, speed, off):
        assert axes.lines[0].get_xdata().tolist() == [-2.0, -1.0, 0.0]
        assert axes.get_xlabel() == "time to the loss [s]"
        colours = [line.get_color() for line in axes.lines[:3]]
        assert colours == [PALETTE[0], PALETTE[1], PALETTE[0]]
    words = [text.get_text() for text in kept[0].legends[0].get_texts()]
    assert words == ["ground", "fence"]
    assert [axes.get_ylabel() for axes in (height, speed, off)] == [
        "height [m]",
        "airspeed [m/s]",
        "e_rho [m]",
    ]


def test_of_many_losses_up_to_forty_of_all_ladders_are_drawn(kept: list[Any]) -> None:
    causes = [*["ground"] * 60, *["fence"] * 60]
    rare_figure.rare_figure(PATH, [], causes, [lost(float(n)) for n in range(120)])
    assert [len(axes.lines) for axes in kept[0].axes[2:]] == [40, 40]
    heights = [line.get_ydata()[0] for line in kept[0].axes[1].lines[:40]]
    assert heights == [3.0 * n for n in range(40)]
    assert [text.get_text() for text in kept[0].legends[0].get_texts()] == ["ground", "fence"]
    many = [f"cause {n}" for n in range(20)]  # more than there are colours
    rare_figure.rare_figure(PATH, [], many, [lost(1.0)] * 20)
    assert len(kept[1].legends[0].get_texts()) == 20


# --- launches and landings ----------------------------------------------------------------------


def passage(n: float, broke_off: bool = False) -> Any:
    path = ((n, 1.0 + n, 2.0 + n), (3.0 + n, 4.0 + n, 5.0 + n))
    return SimpleNamespace(path=path, broke_off=broke_off)


def site(**changes: Any) -> Any:
    ground = SimpleNamespace(profile=[(-20.0, -2.0), (0.0, 3.0)])
    strip = SimpleNamespace(x_m=-30.0, y_m=2.0, z_m=0.5, length_m=16.0)
    return SimpleNamespace(**{"ground": ground, "landing": strip, **changes})


def test_launches_and_landings_are_drawn_from_the_side_and_from_above(kept: list[Any]) -> None:
    """A launch that was broken off is none; of each kind twelve are shown."""
    flights = {
        "launch": [passage(float(n), broke_off=n == 1) for n in range(15)],
        "landing": [passage(100.0)],
    }
    passage_figure.passage_figure(PATH, site(), flights)
    launch_side, land_side, launch_above, _ = kept[0].axes
    assert launch_side.get_title() == "launches, 12 of 14"
    assert land_side.get_title() == "break-offs, 1 of 1"
    assert len(launch_side.lines) == len(launch_above.lines) == 12
    assert launch_side.lines[0].get_xydata().tolist() == [[0.0, 2.0], [3.0, 5.0]]
    assert launch_above.lines[0].get_xydata().tolist() == [[0.0, 1.0], [3.0, 4.0]]
    assert launch_side.lines[1].get_xdata()[0] == 2.0  # the second was broken off
    assert land_side.lines[0].get_xydata().tolist() == [[100.0, 102.0], [103.0, 105.0]]
    assert land_side.get_xlim() == (-42.0, 6.0)
    assert launch_side.get_xlim() == (-20.0, 6.0)
    assert launch_side.get_ylim() == land_side.get_ylim() == (-1.0, 18.0)


def test_the_strip_lies_where_the_site_has_it_and_landings_alone_show_it(kept: list[Any]) -> None:
    passage_figure.passage_figure(PATH, site(), {})
    launch_side, land_side, launch_above, land_above = kept[0].axes
    assert len(launch_side.lines) == len(launch_above.lines) == 0
    assert land_side.lines[0].get_xydata().tolist() == [[-38.0, 0.5], [-22.0, 0.5]]
    corners = [[-38.0, -3.0], [-22.0, -3.0], [-22.0, 7.0], [-38.0, 7.0], [-38.0, -3.0]]
    assert land_above.lines[0].get_xydata().tolist() == corners
    passage_figure.passage_figure(PATH, site(landing=None), {})
    assert not any(axes.lines for axes in kept[1].axes)


@pytest.mark.parametrize("known", [True, False])
def test_the_ground_reaches_from_beyond_the_strip_to_behind_the_crest(
    kept: list[Any], known: bool
) -> None:
    """Flat beyond the site's profile."""
    passage_figure.passage_figure(PATH, site() if known else site(ground=None), {})
    side = kept[0].axes[0]
    (ground,) = side.collections
    corners = {(float(x), float(z)) for x, z in ground.get_paths()[0].vertices}
    given = {(-20.0, -2.0), (0.0, 3.0)} if known else set()
    top = {(-45.0, 0.0), (12.0, 0.0), *given}
    assert top <= corners
    assert {z for _, z in corners - top} == {-1.0}
