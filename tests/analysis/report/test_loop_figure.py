"""The figure of the loop that was flown: what is drawn of gain, phase and discs, and its words."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tgl_soar.analysis.loop_response import (
    AT_ELEVATOR,
    AT_SETPOINT,
    TONES_RADPS,
    Bounded,
    FlownMargins,
    LoopResponse,
    interpolated,
    open_loop_discs,
)
from tgl_soar.analysis.report.figure_style import PALETTE, drawing
from tgl_soar.analysis.report.loop_figure import loop_figure, loop_words

NONE = Bounded(nan, nan, nan)
LOOP = np.array([4.0, 2.5, 1.2, 0.7, 0.4, 0.2]) * np.exp(
    1j * np.radians([-140.0, -150.0, -165.0, -185.0, -200.0, -230.0])
)


def response(
    at: str = AT_SETPOINT, radius: float = 0.02, loop: Any = LOOP, **margins: Bounded
) -> LoopResponse:
    """Of a loop whose sensitivity is known to within a radius."""
    plain = LoopResponse(
        at=at,
        sensitivity=np.asarray(1.0 / (1.0 + loop)),
        variance=np.ones(6),
        coherence=np.ones(6),
        periods=4,
        margins=FlownMargins(
            **{name: margins.get(name, NONE) for name in ("gain_db", "phase_deg", "alpha")}
        ),
    )
    return plain._replace(variance=np.full(6, (radius / plain.radius[0]) ** 2))


@pytest.fixture
def plt() -> Iterator[Any]:
    with drawing() as found:
        yield found
        found.close("all")


# --- words --------------------------------------------------------------------------------------


def test_each_margin_is_reported_with_its_interval() -> None:
    loop = response(
        gain_db=Bounded(7.83, 6.9, 8.81),
        phase_deg=Bounded(46.0, 41.0, 52.0),
        alpha=Bounded(0.81, 0.7, 0.9),
    )
    assert loop_words([loop]).endswith(
        "Broken at the pitch setpoint, 4 periods of 5 s: gain margin 7.8 (6.9 to 8.8) dB, phase"
        " margin 46 (41 to 52)°, disk margin 0.81 (0.7 to 0.9)."
    )


def test_a_margin_that_does_not_lie_between_the_tones_is_left_out() -> None:
    only = response(phase_deg=Bounded(46.0, 41.0, 52.0))
    words = loop_words([only, response(AT_ELEVATOR)])
    assert "5 s: phase margin 46 (41 to 52)°. Broken at the elevator, 4 periods" in words
    assert words.endswith("5 s: no margin lies between the tones.")
    assert "95 % confidence" in words


# --- what is drawn ------------------------------------------------------------------------------


def bars(axes: Any) -> tuple[Any, Any]:
    """Middles and ends of the error bars."""
    (found,) = axes.containers
    middles = found.lines[0].get_ydata()
    segments = np.array(found.lines[2][0].get_segments())
    assert found.lines[0].get_xdata() == pytest.approx(TONES_RADPS)
    return middles, segments[:, :, 1]


def test_without_a_loop_there_is_no_figure(plt: Any) -> None:
    assert loop_figure(plt, []) is None


def test_gain_is_drawn_in_decibels_with_what_it_may_be_wrong_by(plt: Any) -> None:
    loop = response()
    gain = loop_figure(plt, [loop]).axes[0]
    radps, between = interpolated(loop.open_loop)
    line = gain.lines[0]
    assert line.get_xdata() == pytest.approx(radps)
    assert line.get_ydata() == pytest.approx(20.0 * np.log10(np.abs(between)))
    middles, ends = bars(gain)
    assert middles == pytest.approx(20.0 * np.log10(np.abs(LOOP)))
    relative = open_loop_discs(loop)[1] / np.abs(LOOP)
    assert relative.max() < 0.9
    assert ends[:, 0] == pytest.approx(middles + 20.0 * np.log10(1.0 - relative))
    assert ends[:, 1] == pytest.approx(middles + 20.0 * np.log10(1.0 + relative))


@pytest.mark.parametrize("radius", [0.25, 2.0])
def test_a_loop_that_may_be_nought_or_anything_is_drawn_to_nine_tenths_of_it(
    plt: Any, radius: float
) -> None:
    """The last tone's L is small beside its radius of 0.2; with the other nothing is known."""
    gain, phase, _ = loop_figure(plt, [response(radius=radius)]).axes
    middles, ends = bars(gain)
    assert ends[-1] == pytest.approx(middles[-1] + 20.0 * np.log10([0.1, 1.9]))
    middles, ends = bars(phase)
    widest = np.degrees(np.arcsin(0.9))
    assert ends[-1] == pytest.approx([middles[-1] - widest, middles[-1] + widest])


def test_the_phase_begins_near_minus_150_degrees_and_goes_on_without_a_jump(plt: Any) -> None:
    loop = response()
    phase = loop_figure(plt, [loop]).axes[1]
    middles, ends = bars(phase)
    assert middles == pytest.approx([-140.0, -150.0, -165.0, -185.0, -200.0, -230.0], abs=0.3)
    relative = open_loop_discs(loop)[1] / np.abs(LOOP)
    assert ends[:, 1] - middles == pytest.approx(np.degrees(np.arcsin(relative)))
    assert np.abs(np.diff(phase.lines[0].get_ydata())).max() < 5.0


@pytest.mark.parametrize(("turned_deg", "begins"), [(0.0, -140.0), (165.0, 25.0), (175.0, -325.0)])
def test_of_all_turns_that_nearest_to_minus_150_degrees_is_taken(
    plt: Any, turned_deg: float, begins: float
) -> None:
    turned = LOOP * np.exp(1j * np.radians(turned_deg))
    phase = loop_figure(plt, [response(loop=turned)]).axes[1]
    assert phase.lines[0].get_ydata()[0] == pytest.approx(begins)


def test_each_disc_is_drawn_in_the_plane_where_it_is_known(plt: Any) -> None:
    """At the smallest S, of the first tone (0.3), a radius of 0.33 leaves nothing known."""
    for radius, known in ((0.02, range(6)), (0.33, range(1, 6))):
        loop = response(radius=radius)
        plane = loop_figure(plt, [loop]).axes[2]
        centres, radii = open_loop_discs(loop)
        circles = [line for line in plane.lines if len(line.get_xdata()) == 61]
        assert len(circles) == len(known)
        for line, n in zip(circles, known, strict=True):
            edge = line.get_xdata() + 1j * line.get_ydata()
            assert np.abs(edge - centres[n]) == pytest.approx(np.full(61, radii[n]))
            assert edge[0] == pytest.approx(edge[-1])
            assert abs(edge[30] - edge[0]) == pytest.approx(2.0 * radii[n])
        tones = [line.get_xydata()[0] for line in plane.lines if line.get_marker() == "o"]
        assert [complex(*place) for place in tones] == pytest.approx(LOOP.tolist())


def test_the_plane_shows_the_unit_circle_and_minus_one(plt: Any) -> None:
    plane = loop_figure(plt, [response(), response(AT_ELEVATOR)]).axes[2]
    assert (plane.get_xlim(), plane.get_ylim()) == ((-3.0, 1.5), (-3.0, 1.5))
    (circle,) = (line for line in plane.lines if len(line.get_xdata()) == 181)
    around = circle.get_xdata() + 1j * circle.get_ydata()
    assert np.abs(around) == pytest.approx(np.ones(181))
    assert around[[0, 45, 90]] == pytest.approx([1.0, 1j, -1.0])
    (critical,) = (line for line in plane.lines if line.get_marker() == "+")
    assert critical.get_xydata().tolist() == [[-1.0, 0.0]]
    words = [text.get_text() for text in plane.get_legend().get_texts()]
    assert words == [AT_SETPOINT, AT_ELEVATOR]
    assert plane.get_aspect() == 1.0


def test_loops_are_told_apart_by_colour_and_the_axes_by_their_marks(plt: Any) -> None:
    gain, phase, _ = loop_figure(plt, [response(), response(AT_ELEVATOR, loop=0.5 * LOOP)]).axes
    for axes, mark in ((gain, 0.0), (phase, -180.0)):
        drawn = [line for line in axes.lines if len(line.get_xdata()) > 10]
        assert [line.get_color() for line in drawn] == list(PALETTE[:2])
        (across,) = (line for line in axes.lines if np.ptp(line.get_ydata()) == 0.0)
        assert across.get_ydata()[0] == mark
        assert axes.get_xscale() == "log"
        assert axes.get_xticks() == pytest.approx(TONES_RADPS)
        labels = [text.get_text() for text in axes.get_xticklabels()]
        assert labels == ["2.51", "3.77", "6.28", "8.8", "12.6", "18.8"]
