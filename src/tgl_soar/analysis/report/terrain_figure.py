"""A drafted site on the map, and in its vertical plane."""

from __future__ import annotations

from math import cos, radians, sin, tan
from pathlib import Path

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.air.wind_record import oblique_field
from tgl_soar.analysis.report.figure_style import GROUND, PALETTE, drawing, save
from tgl_soar.analysis.report.zeuc_figure import (
    DrawnLine,
    draw_excess_map,
    draw_line,
    draw_undefined,
)
from tgl_soar.analysis.terrain.draft import LEAN_DEG, SiteDraft
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import ned_from_soaring
from tgl_soar.types import GlidePolar

_POSTS = 181  # of the map, a side


def map_figure(path: Path, draft: SiteDraft, title: str) -> None:
    """Contour lines over shaded relief, north up, with profile, ridge, wind, fence and places.

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    frame = draft.frame
    reach = min(float(draft.x_m[-1]), 1.3 * max(-draft.bounds[0], draft.half_width_m))
    sides = np.linspace(-reach, reach, _POSTS)
    east, north = np.meshgrid(sides + frame.origin_east_m, sides + frame.origin_north_m)
    height = draft.terrain.up_m(north, east) + draft.terrain.home.altitude_m
    with drawing() as plt:
        from matplotlib.colors import LightSource

        figure, axes = plt.subplots(figsize=(7.5, 7.5), layout="constrained")
        extent = (east.min(), east.max(), north.min(), north.max())
        step = 2.0 * reach / (_POSTS - 1)
        shade = LightSource(azdeg=315, altdeg=45).hillshade(height, vert_exag=1.5, dx=step, dy=step)
        axes.imshow(shade, extent=extent, origin="lower", cmap="gray", vmin=-0.6, vmax=1.1)
        lines = axes.contour(east, north, height, levels=12, colors=GROUND, linewidths=0.6)
        axes.clabel(lines, fmt="%.0f m", fontsize=7)
        axes.plot(*_on_map(draft, [-reach, reach], [0.0, 0.0]), color="black", lw=1.4,
                  label="profile, across the ridge")  # fmt: skip
        ridge = radians(draft.ridge_deg)
        along = np.array([-reach, reach])
        crest_east, crest_north = frame.origin_east_m, frame.origin_north_m
        axes.plot(crest_east + along * sin(ridge), crest_north + along * cos(ridge), "--",
                  color=PALETTE[3], lw=1.4, label="ridge")  # fmt: skip
        x0, x1, y = draft.bounds[0], draft.bounds[1], draft.half_width_m
        box = _on_map(draft, [x0, x1, x1, x0, x0], [-y, -y, y, y, -y])
        axes.plot(*box, color=PALETTE[0], lw=1.6, label="fence")
        beside = tan(radians(draft.oblique_deg))  # y of where the wind comes from, for each -x
        # Aside of the profile, on which places and lines are.
        aside = -0.5 if draft.oblique_deg >= 0.0 else 0.5
        wind = _on_map(
            draft,
            [-0.825 * reach, -0.575 * reach],
            [(aside + 0.125 * beside) * reach, (aside - 0.125 * beside) * reach],
        )
        arrow = {"width": 4, "headwidth": 12, "color": PALETTE[1]}
        (tail_east, head_east), (tail_north, head_north) = wind
        axes.annotate("", (head_east, head_north), (tail_east, tail_north), arrowprops=arrow)
        axes.fill([], [], color=PALETTE[1],
                  label=f"wind from {draft.wind_from_deg:.0f}°")  # fmt: skip
        axes.plot(0.0, 0.0, "s", ms=8, mfc="white", mec="black", label="home")
        axes.plot(frame.origin_east_m, frame.origin_north_m, "+", ms=12, mew=2, color="black",
                  label="origin, on the crest")  # fmt: skip
        if draft.landing is not None:
            axes.plot(*_on_map(draft, [draft.landing[0]], [0.0]), "P", ms=10, mfc="yellow",
                      mec="black", label="level, to land")  # fmt: skip
        for i, (name, (x, _)) in enumerate(draft.lines.items()):
            axes.plot(*_on_map(draft, [x], [0.0]), "o", ms=7, mec="black",
                      mfc=PALETTE[i % len(PALETTE)], label=f"line {name}")  # fmt: skip
        axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="east of home [m]")
        axes.set_ylabel("north of home [m]")
        axes.set_aspect("equal")
        axes.set_title(title)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4,
                      frameon=False)  # fmt: skip
        save(plt, figure, path)


def _on_map(draft: SiteDraft, x: list[float], y: list[float]) -> tuple[FloatArray, FloatArray]:
    """East and north of home [m] of places in the soaring frame."""
    places = [ned_from_soaring(draft.frame, a, b, 0.0) for a, b in zip(x, y, strict=True)]
    return np.array([p[1] for p in places]), np.array([p[0] for p in places])


def plane_figure(path: Path, draft: SiteDraft, polar: GlidePolar, title: str) -> None:
    """Ground, excess updraft, guessed contour, lines and fence in the vertical plane.

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    x0, x1, z0, z1 = draft.bounds
    pad = 0.1 * max(x1 - x0, z1 - z0)
    near = (draft.x_m >= x0 - 2.0 * pad) & (draft.x_m <= x1 + 2.0 * pad)
    x, z = draft.x_m[near], draft.z_m[near]
    deep = float(z.min()) - pad
    outline = [(float(x[0]), deep), *zip(x.tolist(), z.tolist(), strict=True), (float(x[-1]), deep)]
    with drawing() as plt:
        figure, axes = plt.subplots(figsize=(8.0, 6.0), layout="constrained")
        area = (x0 - pad, x1 + pad, z0 - pad, z1 + pad)
        field = oblique_field(draft.field, radians(draft.oblique_deg))
        shades = draw_excess_map(
            axes, field, polar, area, outline,
            contour_style={"label": "contour, A GUESS by potential flow"},
        )  # fmt: skip
        undefined = draw_undefined(axes, field, polar, area)
        figure.colorbar(shades, ax=axes, label="excess updraft w − sink(u) [m/s]", shrink=0.8)
        for i, (name, (line_x, line_z)) in enumerate(draft.lines.items()):
            eta = eta_from_lean(radians(LEAN_DEG))
            drawn = DrawnLine(
                name=name, x0_m=line_x, z0_m=line_z, eta_rad=eta, crossings=[(line_x, line_z, True)]
            )
            draw_line(axes, drawn, PALETTE[i % len(PALETTE)], 0.2 * (z1 - z0), f"TGL {name}")
        axes.plot([x0, x1, x1, x0, x0], [z0, z0, z1, z1, z0], color=PALETTE[0], lw=1.6,
                  zorder=6, label="fence")  # fmt: skip
        axes.plot([p[0] for p in draft.ground.points], [p[1] for p in draft.ground.points], ".-",
                  color="black", zorder=6, label="[ground], highest of the strip")  # fmt: skip
        axes.set_title(f"{title}, wind {draft.wind_mps:g} m/s")
        handles, _ = axes.get_legend_handles_labels()
        figure.legend(handles=[*handles, *undefined], loc="outside lower center", ncols=3,
                      frameon=False)  # fmt: skip
        save(plt, figure, path)
