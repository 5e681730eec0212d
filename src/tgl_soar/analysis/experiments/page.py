"""docs/experiments.md, written from the results: every number in it was measured by this run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tgl_soar.analysis.experiments.result import Result, as_markdown, versions

IMAGES: Final = "images/experiments"
VERDICTS: Final = {"agrees": "agrees", "agrees in part": "in part", "differs": "differs"}


def page(results: Sequence[Result]) -> str:
    """The page, in Markdown."""
    made = versions()
    head = [
        "# The paper's experiments, flown in simulation",
        "",
        "This page is written by `tgl-soar experiment all --docs docs` from what it measured;"
        " do not edit it by hand. Each experiment flies a scenario of `config/scenarios/` with the"
        " very tick that flies the aircraft (`autopilot.step`), through simulated sensors, servos"
        " and air, and holds what comes out against what Suys, Hwang, de Croon and Remes (ICRA"
        " 2023) report or explain. Where the two part, the section says so and why.",
        "",
        "Read the numbers as the simulation's: the aircraft is a model of its class, its gains are"
        " ours, the air is computed, and turbulence is Dryden's with a length of 1.5 m. Places are"
        " not the paper's either: they are found on the contour of this air, by the local wind as a"
        " fraction of best glide's speed, so that they move with the model. Equations, signs and"
        " sources are in [theory.md](theory.md).",
        "",
        "Scored apart: **e_rho**, the distance from the line, which the law controls; and"
        " **dispersion**, the standard deviation along the line, which follows from turbulence and"
        " the slope of excess updraft and which no still line changes. The letters a, b, c, d name"
        " lines or places of their own section and nothing else.",
        "",
        "| experiment | what | verdict |",
        "|---|---|---|",
    ]
    head += [
        f"| [`{r.name}`](#{r.name}) | {r.title} | {VERDICTS[r.verdict]}:"
        f" {sum(c.holds for c in r.claims)} of {len(r.claims)} claims |"
        for r in results
    ]
    body = [f'<a id="{r.name}"></a>\n\n{as_markdown(r, IMAGES)}' for r in results]
    foot = (
        f"---\n\nMade with tgl_soar {made['tgl_soar']}, Python {made['python']}, numpy"
        f" {made['numpy']}, {made['machine']}. The same seeds give the same flights on one machine;"
        " another processor's rounding may change the last digits.\n"
    )
    return "\n".join(head) + "\n\n" + "\n".join(body) + "\n" + foot
