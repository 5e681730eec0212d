"""docs/experiments.md and docs/aims.md: every number in them was measured by the same run.

The first holds what the paper reports or explains, and nothing else; the second what this
project asks of itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from tgl_soar.analysis.experiments.result import (
    DISPERSED_AIRCRAFT,
    Result,
    as_markdown,
    versions,
)
from tgl_soar.analysis.experiments.staleness import Ends, sealed

IMAGES: Final = "images/experiments"
PAPER: Final = "experiments.md"
AIMS: Final = "aims.md"
# Experiments whose section stands on a page that is written by hand, between two marks.
OWN_PAGES: Final = {
    "point": "point.md",
    "outdoors": "outdoors.md",
    "satellites": "outdoors.md",
    "rangefinder": "outdoors.md",
    "hour": "outdoors.md",
    "beating": "outdoors.md",
    "unseen": "margins.md",
    "dispersed": "margins.md",
    "leans": "margins.md",
    "airframes": "margins.md",
    "margins": "margins.md",
    "latency": "margins.md",
    "search": "search.md",
    "survey": "search.md",
    "nowhere": "search.md",
    "throttle": "search.md",
    "places --field SITE": "theory.md",
}

# What pages said until 22 November 2026: every claim in one list, by thresholds of which many are
# another today (`CHANGED`), by one model, and lost flights left out of some means.
ONCE: Final = {
    "field": "agrees: 3 of 3",
    "static": "agrees: 2 of 2",
    "translate": "agrees: 2 of 2",
    "back": "agrees: 2 of 2",
    "rotate": "agrees: 3 of 3",
    "slope": "agrees: 3 of 3",
    "wind": "agrees in part: 3 of 4",
    "gust": "agrees in part: 1 of 2",
    "lean": "agrees in part: 2 of 3",
    "speed": "agrees in part: 1 of 2",
    "identification": "met: 8 of 8",
    "estimator": "met: 9 of 9",
    "wind_estimate": "met: 3 of 3",
    "wind_use": "met: 1 of 1",
}

DISPERSED_WORDS: Final = (
    "*Dispersed*: every flight draws an aircraft that is not the airframe file's, and air that is"
    " not the site's where the experiment draws none by itself, while the module on board is given"
    " the files ([what a controller does not know](theory.md#what-a-controller-does-not-know))."
)


def pages(results: Sequence[Result], ends: Callable[[str], Ends]) -> dict[str, str]:
    """The pages that have results, in Markdown by file name; ends: of a page's probes, as
    `staleness_probes.probe_for_page`."""
    paper = [result for result in results if not result.own]
    aims = [result for result in results if result.own]
    written = {PAPER: page(paper, ends(PAPER))} if paper else {}
    return written | ({AIMS: aims_page(aims, ends(AIMS))} if aims else {})


def with_result(text: str, result: Result, name: str, ends: Ends) -> str:
    """A page with an experiment's section between its marks; name: the section's; ends: of its
    probes.  Errors: ValueError without marks."""
    section = as_markdown(result, IMAGES).partition("\n")[2]  # the page has a heading of its own
    if DISPERSED_AIRCRAFT in result.also:
        section += f"\n{DISPERSED_WORDS}\n"
    section += "".join(f"{line}\n" for line in changed_thresholds([result]))
    return between(text, *marks(name), sealed(section, ends))


def marks(name: str) -> tuple[str, str]:
    """Between which an experiment's section stands on a page of `OWN_PAGES`."""
    begin = f"<!-- {name}: begin; written by `tgl-soar experiment {name} --docs docs` -->"
    return begin, f"<!-- {name}: end -->"


def between(text: str, begin: str, end: str, written: str) -> str:
    """A page with what lies between two marks replaced.  Errors: ValueError without marks."""
    before, found_begin, rest = text.partition(begin)
    _, found_end, after = rest.partition(end)
    if not found_begin or not found_end:
        raise ValueError(f"no marks {begin!r} … {end!r} to write between")
    return f"{before}{begin}\n\n{written}\n{end}{after}"


def aims_page(results: Sequence[Result], ends: Ends) -> str:
    """What this project asks of itself."""
    head = [
        "# Aims of our own, flown in simulation",
        "",
        "This page is for everybody who wants to know how good estimate, control and robustness"
        " are, by which measure, and where they fall short. It holds the aims that this project"
        " set itself, and says of each whether it is met. None of it is in the paper: what the"
        " paper reports or explains stands in [experiments.md](experiments.md), flown by the"
        " same command with the same aircraft, sensors and air. `tgl-soar experiment all --docs"
        " docs` writes the page from what it measured; do not edit it by hand.",
    ]
    return _whole(head, results, ends)


def page(results: Sequence[Result], ends: Ends) -> str:
    """The page of the paper's claims."""
    head = [
        "# The paper's experiments, flown in simulation",
        "",
        "This page is for readers of the paper (Suys, Hwang, de Croon and Remes, ICRA 2023) who"
        " want to know which of its results come out here too, and which do not. Each experiment"
        " flies a scenario of `config/scenarios/` with the very tick that flies the aircraft"
        " (`autopilot.step`), through simulated sensors, servos and air, and compares what comes"
        " out with what the paper reports or explains. Where the two differ, the section says so"
        " and why. `tgl-soar experiment all --docs docs` writes the page from what it measured; do"
        " not edit it by hand.",
        "",
        "Read the numbers as the simulation's: the aircraft is a model of its class, its gains are"
        " ours, the air is computed, and turbulence is Dryden's with a length of 1.5 m. Places are"
        " not the paper's either: they are found on the contour of this air, by the local wind as a"
        " fraction of best glide's speed, so that they move with the model. The tunnel's air is"
        " that of a jet whose width we assume: on another public plane of the same laboratory it"
        " missed the wind by 14.6 and the updraft by 9.1 %, made shifts of the contour 23 to 35 %"
        " too large and put places 0.3 to 0.5 m too low. Equations, signs and sources are in"
        " [theory.md](theory.md).",
        "",
        "Scored apart: **e_rho**, the distance from the line, which the law controls; and"
        " **dispersion**, the standard deviation along the line, which follows from turbulence and"
        " the slope of excess updraft and which no still line changes. The letters a, b, c, d name"
        " lines or places of their own section and nothing else. A claim that is an identity of the"
        " model says so and decides no verdict. **?** is a claim that was left undecided: the"
        " bound lies within 2.4 standard errors of what was measured, and it counts as not held."
        " A standard error is that of the flights' own means, as each flight is one draw of"
        " aircraft and air. Our own aims stand in [aims.md](aims.md).",
        "",
        "Each is flown by two models of one aircraft: the **rigid body** with six degrees of"
        " freedom, and the **point mass** that the paper simulates, its equations corrected and"
        " closed ([theory.md](theory.md#the-point-mass)). Where the models differ, what the point"
        " mass lacks is the reason to look for first: a stall, a short period, and what couples the"
        " axes. The rigid body flies a third time, **dispersed**: every flight draws an aircraft"
        " that is not the airframe file's, and air that is not the site's, while the module on"
        " board is given the files"
        " ([what a controller does not know](theory.md#what-a-controller-does-not-know))."
        " Its places are judged flight by flight against the contour of what flew, which is what"
        " the paper's claims are about; what an operator knows is the files' contour alone, and how"
        " far from that they are stands beside it. Figures show the rigid body of the file.",
    ]
    return _whole(head, results, ends)


def counted(result: Result) -> str:
    """A verdict with the claims that it rests on."""
    judged = result.judged
    words = f"{result.verdict}: {sum(c.holds for c in judged)} of {len(judged)}"
    if undecided := sum(c.undecided for c in judged):
        words += f", {undecided} undecided"
    given = len(result.claims) - len(judged)
    return words if not given else f"{words}, and {given} by construction"


def _counted_also(result: Result, name: str) -> str:
    also = result.also.get(name)
    return "–" if also is None else counted(also)


def changed_thresholds(results: Sequence[Result]) -> list[str]:
    """A table of every threshold that is not what it was."""
    rows = [
        f"| `{r.name}` | {c.claim} | {c.was} | {c.now} | {c.why} |"
        for r in results
        for c in r.changed
    ]
    if not rows:
        return []
    return [
        "",
        "Thresholds are argued beside the code, before the flights. Those that have been changed:",
        "",
        "| experiment | claim | was | is | why |",
        "|---|---|---|---|---|",
        *rows,
    ]


def former_verdicts(results: Sequence[Result]) -> list[str]:
    """A table of the verdicts that were published once, beside those of today."""
    rows = [f"| `{r.name}` | {ONCE[r.name]} | {counted(r)} |" for r in results if r.name in ONCE]
    if not rows:
        return []
    return [
        "",
        "What was said until 22 November 2026, of one model and before claims, thresholds and lost"
        " flights were looked at anew, beside what is said of the rigid body today:",
        "",
        "| experiment | once | today |",
        "|---|---|---|",
        *rows,
    ]


def _summary(results: Sequence[Result]) -> list[str]:
    """Every verdict in a table, a column for each model that flew."""
    others = list(dict.fromkeys(name for r in results for name in r.also))
    columns = ["verdict", *(f"of the {name}" for name in others)]
    lines = [
        "| experiment | what | " + " | ".join(columns) + " |",
        "|---" * (2 + len(columns)) + "|",
    ]
    for r in results:
        line = f"| [`{r.name}`](#{r.name}) | {r.title} | {counted(r)} |"
        lines.append(line + "".join(f" {_counted_also(r, name)} |" for name in others))
    return lines


def _whole(head: list[str], results: Sequence[Result], ends: Ends) -> str:
    made = versions()
    head += ["", *_summary(results)]
    head += changed_thresholds(results)
    head += former_verdicts(results)
    body = [f'<a id="{r.name}"></a>\n\n{as_markdown(r, IMAGES)}' for r in results]
    foot = (
        f"---\n\nMade with tgl_soar {made['tgl_soar']}, Python {made['python']}, numpy"
        f" {made['numpy']}, {made['machine']}. The same seeds give the same flights on one machine;"
        " another processor's rounding may change the last digits.\n"
    )
    return sealed("\n".join(head) + "\n\n" + "\n".join(body) + "\n" + foot, ends)
