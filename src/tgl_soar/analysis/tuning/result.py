"""What was tuned, in writing: a TOML file, an airframe file with the new gains, a figure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isfinite
from operator import attrgetter
from pathlib import Path
from typing import Final

from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.search import PRICE_M, RESERVE, front
from tgl_soar.analysis.tuning.tune import FlownRow, Judged, Task, Tuned, manifest
from tgl_soar.config.parameter_files import shortest
from tgl_soar.control.found_gains import SETS
from tgl_soar.sim.campaign.manifest import key_of

# A number that is not known, or of an unstable loop.
_NONE: Final = "nan"


def as_toml(task: Task, tuned: Tuned, airframe_name: str, line: str) -> str:
    """`[parameters]`, and all that they were tuned for."""
    effort = task.effort
    ranges = task.ranges._asdict()
    found = manifest(task)
    lines = [
        f"# Gains for {task.airframe.airframe.name}, by `tgl-soar tune`.  What flies is in",
        "# [parameters], which belongs into the airframe file; the rest says what they are for.",
        "",
        "[parameters]",
        *(f"{name} = {shortest(value)}" for name, value in tuned.parameters.items()),
        "",
        "[tuned]",
        f'version = "{found.version}"',
        f'commit = "{found.commit}"  # +: with changes; "": no working copy',
        f'source = "{found.source}"  # digest of the program',
        f"airframe = {_text(airframe_name)}",
        f"site = {_text(task.site_path.name)}",
        f"line = {_text(line)}",
        f'task = "{key_of(found)}"  # digest of source, libraries, files and options',
        f"lean_deg = {task.lean_deg:g}",
        f"latency_ms = {1e3 * task.values['CMD_DELAY']:.4g}",
        f"seed = {task.seed}",
        f"generations = {effort.generations}",
        f"floor = {task.floor:g}  # of the disk margin; sought with {RESERVE:g} more",
        f"elevator_price_m = {PRICE_M:g}  # of a standard deviation of full travel",
        "",
        "[tuned.grid]  # of the airframe itself",
        f"lean_deg = [{task.values['TGL_LEAN_MIN']:g}, {task.values['TGL_LEAN_MAX']:g}]",
        "",
        "[tuned.ranges]  # of the drawn aircraft; factors of the airframe file's own",
        *(f"{name} = [{low:.4g}, {high:.4g}]" for name, (low, high) in ranges.items()),
    ]
    for kind in SETS:
        lines += [
            "",
            *_given(f"tuned.{kind}.before", tuned.before[kind], tuned.judged_before[kind]),
            "",
            *_given(f"tuned.{kind}.after", tuned.after[kind], tuned.judged[kind]),
        ]
    for row in tuned.flown:
        lines += ["", *_row(row)]
    return "\n".join(lines) + "\n"


def _given(table: str, given: Given, judged: Judged) -> list[str]:
    return [
        f"[{table}]",
        f"alpha = {given.alpha:.3f}",
        f"alpha_at = {_text(given.worst)}",
        f"e_rho_m = {_number(given.e_rho_m)}",
        f"elevator = {_number(given.elevator)}",
        f"other_aircraft = {judged.aircraft}  # on the linear model; none served in the search",
        f"unstable = {judged.unstable}",
        f"below_floor = {judged.below_floor}",
        f"least_alpha = {judged.least_alpha:.3f}",
    ]


def _row(row: FlownRow) -> list[str]:
    return [
        "[[tuned.flown]]",
        f"gains = {_text(row.kind)}",
        f"turbulence = {row.turbulence:g}",
        f"flights = {row.after.of}",
        f"up_before = {row.before.up}",
        f"up = {row.after.up}",
        f"rms_e_rho_m_before = {row.before.rms_e_rho_m:.5f}",
        f"rms_e_rho_m = {row.after.rms_e_rho_m:.5f}",
    ]


def _text(words: str) -> str:
    escaped = words.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else " " for c in escaped) + '"'


def _number(value: float) -> str:
    return f"{value:.5f}" if isfinite(value) else _NONE


def airframe_with(text: str, parameters: Mapping[str, float], note: str = "tuned") -> str:
    """An airframe file's text with these in its [parameters]: in place, or added to the table.

    note: a comment on each.
    """
    table = re.search(r"(?m)^[ \t]*\[[ \t]*parameters[ \t]*\].*$", text)
    if table is None:
        head, rest = f"{text.rstrip()}\n\n[parameters]\n", ""
    else:
        head, rest = text[: table.end()] + "\n", text[table.end() + 1 :]
    following = re.search(r"(?m)^[ \t]*\[", rest)
    end = following.start() if following is not None else len(rest)
    body, tail = rest[:end], rest[end:]
    added = []
    for name, value in parameters.items():
        line = f"{name} = {shortest(value)}  # {note}"
        body, count = re.subn(rf"(?m)^[ \t]*[\"']?{name}[\"']?[ \t]*=.*$", line, body)
        if count == 0:
            added.append(line + "\n")
    return head + "".join(added) + body + tail


def pareto_figure(path: Path, tuned: Tuned, floor: float, title: str) -> None:
    """e_rho against margin and against activity: every candidate, and those that none beats.

    Errors: ImportError without matplotlib, ValueError for a kind of file that it does not know,
    OSError.
    """
    from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

    with drawing() as plt:
        figure, axes = plt.subplots(2, len(SETS), figsize=(8.0, 6.4), layout="constrained")
        for column, kind in enumerate(SETS):
            found = [c.given for c in tuned.candidates[kind] if isfinite(c.given.e_rho_m)]
            best = [c.given for c in front(tuned.candidates[kind])]
            marked = (("before", tuned.before[kind], "s"), ("after", tuned.after[kind], "*"))
            for row, (axis_name, field) in enumerate(
                (
                    ("least disk margin α", "alpha"),
                    ("elevator activity (standard deviation)", "elevator"),
                )
            ):
                of = attrgetter(field)
                panel = axes[row][column]
                for rows, colour, label in (
                    (found, "0.75", "sought"),
                    (best, PALETTE[1], "beaten by none"),
                ):
                    panel.plot(
                        [of(given) for given in rows],
                        [100.0 * given.e_rho_m for given in rows],
                        *(".",),
                        color=colour,
                        label=label,
                    )
                for (label, given, marker), colour in zip(marked, PALETTE[::2], strict=False):
                    panel.plot(
                        *([of(given)], [100.0 * given.e_rho_m], marker),
                        color=colour,
                        markersize=9,
                        label=label,
                    )
                panel.set_xlabel(axis_name)
                panel.set_ylabel("e_rho in gusts [cm]")
                _zoom(panel, [100.0 * given.e_rho_m for given in (*best, marked[0][1])])
            axes[0][column].axvline(floor, color="0.4", linestyle="--", label="floor")
            axes[0][column].set_title("with accelerometers" if kind != SETS[0] else "without")
        axes[0][-1].legend()
        figure.suptitle(title)
        save(plt, figure, path)


def _zoom(panel: object, shown: list[float]) -> None:
    """To what matters: candidates far off the front may leave the picture."""
    finite = [value for value in shown if isfinite(value)]
    if finite:
        panel.set_ylim(0.0, 1.2 * max(finite))  # type: ignore[attr-defined]
