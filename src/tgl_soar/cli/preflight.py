"""`tgl-soar preflight`: is the vehicle set up as the module needs it?"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from rich.table import Table

from tgl_soar.cli.console import AIRFRAME_FILE, SITE_FILE, console, fail
from tgl_soar.cli.conversation import Conversation, KeyOption, LinkOption, TimeoutOption
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, gains_words, load_flight, preset_lines
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.laws import dynamics_of
from tgl_soar.control.line_bounds import open_sides
from tgl_soar.control.loop_margin import FLOOR, is_known
from tgl_soar.link.autopilots.requirements import MUST, remedy
from tgl_soar.link.checks.preflight import Preflight
from tgl_soar.link.open_link import baud_of
from tgl_soar.link.signing_keys import SigningError
from tgl_soar.link.transports.base import LinkError
from tgl_soar.onboard.link_load import load_of
from tgl_soar.onboard.setup import bounds_from, flavour_of, needs_of, setup_from
from tgl_soar.types import OURS


class CheckedPart(NamedTuple):
    """What one part of the check has to say of the verdict."""

    good: bool  # nothing of it must be changed
    warnings: tuple[str, ...] = ()  # what is to be known before a flight all the same


def preflight(
    link: LinkOption,
    airframe: Annotated[
        Path, typer.Option(help="Airframe file: firmware and route.", **AIRFRAME_FILE)
    ],
    site: Annotated[
        Path, typer.Option(help="Site file: where the position comes from.", **SITE_FILE)
    ],
    show_all: Annotated[
        bool, typer.Option("--all", help="Also show parameters that are as needed.")
    ] = False,
    timeout: TimeoutOption = 10.0,
    signing_key: KeyOption = None,
) -> None:
    """Read the autopilot's parameters and list what to change before flight; change nothing.

    It also checks fence and lines of the site file, and computes the margins of pitch, line, roll
    and heading with the airframe file's gains.

    The last line is the verdict over all of it. Exit code 0: ready, with what is in doubt behind
    it; 1: something must be changed; 2: not possible.
    """
    try:
        plane, place, values = load_flight(airframe, site)
        flavour = flavour_of(plane)
        check = Preflight(flavour, needs_of(plane, place, values), plane.autopilot.system_id)
        baud = baud_of(link)
        load = load_of(setup_from(plane, place, values), signed=signing_key is not None)
        with Conversation(link, plane, flavour, signing_key) as conversation:
            _read(check, conversation, timeout)
    except (ConfigError, LinkError, SigningError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("stopped", 130)
    too_slow = "" if baud is None else load.refusal(baud)
    parts = [_place_reported(plane, place, values)]
    if whose := gains_words(plane, place, values):
        console.print(whose, highlight=False, markup=False, soft_wrap=True)
    parts.append(_margin_reported(plane, values))
    parts.append(_reported(check, too_slow, show_all=show_all))
    raise typer.Exit(_concluded(parts))


def _concluded(parts: Sequence[CheckedPart]) -> int:
    """The one verdict, as the last line, and its exit code."""
    if not all(part.good for part in parts):
        console.print(
            "[red]not ready[/red]: change what is shown above in red, then run this again",
            soft_wrap=True,
        )
        return 1
    warnings = [warning for part in parts for warning in part.warnings]
    console.print("[green]ready[/green]" + (", but " if warnings else ""), end="")
    console.print("; ".join(warnings), highlight=False, markup=False, soft_wrap=True)
    return 0


def _read(check: Preflight, conversation: Conversation, timeout_s: float) -> None:
    """Until every parameter has answered or will not.  Errors: `LinkError`."""
    begun_s = time.monotonic()
    while True:
        for message in conversation.turn():
            check.take(message)
        now_s = time.monotonic()
        if not check.received:
            if now_s - begun_s > timeout_s:
                raise LinkError(
                    f"no heartbeat of autopilot {conversation.autopilot.system}"
                    f" within {timeout_s:g} s: check the link, its rate, and system_id of the"
                    " airframe file"
                )
            continue
        if check.mismatch:
            raise LinkError(check.mismatch)
        for request in check.poll(now_s):
            conversation.say(request)
        if check.done(now_s):
            return


_QUARTERS: Final = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)


def _place_reported(plane: Airframe, place: Site, values: ParameterSet) -> CheckedPart:
    """What is to be said of wind, fence and lines; whether the files' line can be engaged on."""
    wind_deg = place.site.wind_from_deg % 360.0
    quarter = _QUARTERS[round(wind_deg / 45.0) % len(_QUARTERS)]
    console.print(
        f"by the site file the wind comes from {wind_deg:g} deg ({quarter})",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    bounds = bounds_from(plane, place)
    faults = bounds.preset_faults(values, preset_lines(place, values))
    fence, margins = open_sides(values), bounds.warning(values)
    contour = place.contour_words(plane.airframe.name)
    for words in (fence, margins, contour, *faults):
        if words:
            console.print(words, style="yellow", highlight=False, markup=False, soft_wrap=True)
    fault = bounds.fault(values)
    if fault:
        text = f"cannot be engaged: {fault}"
        console.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    warnings = [fence, "no line is checked" if contour else "", *faults]
    if flavour_of(plane).route.loops == OURS:  # on other routes nobody needs to judge them
        warnings.append(margins)
    return CheckedPart(not fault, tuple(filter(None, warnings)))


def _margin_reported(plane: Airframe, values: ParameterSet) -> CheckedPart:
    """What the loops of these files can bear at the best glide's speed, by the linear model, roll
    and heading too; whether it is enough, or not known."""
    from tgl_soar.analysis.linear_plant import Gusts
    from tgl_soar.analysis.margins import case_margins, grid, worst

    if flavour_of(plane).route.loops != OURS:
        return CheckedPart(True)
    best = values["DYN_BEST"]
    cases = grid(values, [best], [values["TGL_LEAN"]], [values["CMD_DELAY"]])
    try:
        least = worst(list(case_margins(plane, values, cases, Gusts(0.0, best))))
    except ValueError as error:
        text = f"no gain is checked, the margin of the loops is not known: {error}"
        console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
        by_rule = is_known(dynamics_of(values))  # else the rule says that it judges none
        return CheckedPart(True, ("no margin of roll and heading is computed",) if by_rule else ())
    names = ("elevator", "line", "aileron", "rudder")
    name, found = min(zip(names, least.breaks, strict=True), key=lambda each: each[1].alpha)
    text = (
        f"least margin of the loops: {found.alpha:.2f} of {FLOOR:g}, at the {name},"
        f" {best:.1f} m/s, lean {values['TGL_LEAN']:g} deg, commands"
        f" {1e3 * values['CMD_DELAY']:.3g} ms late"
    )
    is_enough = found.alpha >= FLOOR
    console.print(text, style=None if is_enough else "red", highlight=False, soft_wrap=True)
    return CheckedPart(is_enough)


def _reported(check: Preflight, too_slow: str, *, show_all: bool) -> CheckedPart:
    """The table and the way out.  `too_slow`: why the line is, if it is."""
    route, findings, wrong = check.flavour.route, check.findings(), check.wrong()
    refusal = check.refusal()
    console.print(
        f"{check.flavour.name} by {route.message} in {route.mode}:"
        f" {len(findings)} parameters, {len(findings) - len(wrong)} as needed"
    )
    if not findings:
        console.print("its set-up cannot be read over the link: see docs/hardware.md")
    if findings and not check.answers:
        console.print("no parameter was answered: does the link carry parameters?", style="red")
    shown = findings if show_all else wrong
    if shown:
        table = Table("", "now", "what to do", "why")
        for finding in shown:
            must = finding.requirement.level == MUST
            mark = "ok" if finding.ok else "[red]MUST[/red]" if must else "[yellow]should[/yellow]"
            now = "no answer" if finding.value is None else f"{finding.value:g}"
            do = finding.name if finding.ok else remedy(finding)
            table.add_row(mark, now, do, finding.requirement.why)
        console.print(table)
    for words in (refusal, too_slow):
        if words:
            console.print(words, style="red", highlight=False, soft_wrap=True)
    console.print(
        f"when the module falls silent: {route.after_silence}\n"
        f"the pilot takes over by: {route.takeover}",
        highlight=False,
        soft_wrap=True,
    )
    unfit = [finding for finding in wrong if finding.requirement.level == MUST]
    warning = "some parameters should be changed" if wrong else ""
    if not findings:
        warning = "its set-up cannot be read over the link"
    return CheckedPart(not (unfit or refusal or too_slow), (warning,) if warning else ())
