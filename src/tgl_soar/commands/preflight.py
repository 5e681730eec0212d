"""`tgl-soar preflight`: is the vehicle set up as the module needs it?"""

from __future__ import annotations

import select
import time
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.table import Table

from tgl_soar.config import ConfigError, load_airframe, load_parameters, load_site
from tgl_soar.link.autopilots.requirements import MUST, Needs, wish
from tgl_soar.link.keys import Secret, SigningError, peers_of, signing_from
from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    COMPONENT_AUTOPILOT,
    STATE_ACTIVE,
    TYPE_ONBOARD_CONTROLLER,
    Heartbeat,
    Said,
    Source,
)
from tgl_soar.link.routes import Route
from tgl_soar.link.transport import LinkError, Transport, open_link
from tgl_soar.onboard import flavour_of
from tgl_soar.preflight import Preflight

from .console import AIRFRAME, SITE, console, fail

HEARTBEAT_S: Final = 1.0
LOOK_S: Final = 0.02


def preflight(
    link: Annotated[str, typer.Option(help="To the autopilot, as for `tgl-soar run`.")],
    airframe: Annotated[Path, typer.Option(help="Airframe file: firmware and route.")] = AIRFRAME,
    site: Annotated[Path, typer.Option(help="Site file: where the position comes from.")] = SITE,
    show_all: Annotated[
        bool, typer.Option("--all", help="Show also what is as it should be.")
    ] = False,
    timeout: Annotated[
        float, typer.Option(help="Seconds to wait for the autopilot.", min=1.0, max=600.0)
    ] = 10.0,
    signing_key: Annotated[Path | None, typer.Option(help="Sign with the key of a file.")] = None,
) -> None:
    """Read the autopilot's parameters and list what to change before flight; change nothing.

    Exit code 0: all as needed; 1: something must be changed; 2: not possible.
    """
    transport: Transport | None = None
    try:
        plane, place = load_airframe(airframe), load_site(site)
        values = load_parameters(plane, airframe, place, site)
        flavour = flavour_of(plane)
        needs = Needs(
            override_system=plane.autopilot.override_system_id,
            loop_rate_hz=values["LOOP_RATE"],
            external_pose=place.forward is not None,
            gps=place.mocap is None,
        )
        check = Preflight(flavour, needs, plane.autopilot.system_id)
        own = Source(plane.autopilot.system_id, plane.autopilot.component_id)
        signing = signing_from(Secret(signing_key))
        transport = open_link(link, peers_of(signing, None), time.monotonic())
        route = Route(0, own, own, transport.send, signing, stream=transport.is_stream)
        _read(check, route, transport, timeout)
    except (ConfigError, LinkError, SigningError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("stopped", 130)
    finally:
        if transport is not None:
            transport.close()
    raise typer.Exit(_told(check, show_all=show_all))


def _read(check: Preflight, route: Route, transport: Transport, timeout_s: float) -> None:
    """Until every parameter has answered or will not.  Errors: `LinkError`."""
    autopilot = Source(route.own.source.system, COMPONENT_AUTOPILOT)
    begun_s, beat_s = time.monotonic(), float("-inf")

    def say(message: Said) -> None:
        route.send(route.own.encode(message))

    while True:
        fd = transport.fileno()
        select.select([fd] if fd >= 0 else [], [], [], LOOK_S)
        now_s = time.monotonic()
        for data in transport.receive(now_s):
            for received in route.decoder.feed(data):
                route.match_version()
                if received.source == autopilot:
                    check.hear(received.message)
        if now_s - beat_s >= HEARTBEAT_S:
            beat_s = now_s
            say(Heartbeat(TYPE_ONBOARD_CONTROLLER, AUTOPILOT_INVALID, 0, 0, STATE_ACTIVE))
        if not check.heard:
            if now_s - begun_s > timeout_s:
                raise LinkError(
                    f"no heartbeat of autopilot {autopilot.system} within {timeout_s:g} s: check"
                    " the link, its rate, and system_id of the airframe file"
                )
            continue
        if check.mismatch:
            raise LinkError(check.mismatch)
        for request in check.poll(now_s):
            say(request)
        if check.done(now_s):
            return


def _told(check: Preflight, *, show_all: bool) -> int:
    """The table, the way out, and the exit code."""
    route, findings, wrong = check.flavour.route, check.findings(), check.wrong()
    refusal = check.refusal()
    console.print(
        f"{check.flavour.name} by {route.message} in {route.mode}:"
        f" {len(findings)} parameters, {len(findings) - len(wrong)} as needed"
    )
    if not findings:
        console.print("nothing of its set-up can be read over the link: see docs/hardware.md")
    if findings and not check.answers:
        console.print("none of them has answered: does the link carry parameters?", style="red")
    shown = findings if show_all else wrong
    if shown:
        table = Table("", "now", "what to do", "why")
        for finding in shown:
            must = finding.requirement.level == MUST
            mark = "ok" if finding.ok else "[red]MUST[/red]" if must else "[yellow]should[/yellow]"
            now = "no answer" if finding.value is None else f"{finding.value:g}"
            do = finding.name if finding.ok else wish(finding)
            table.add_row(mark, now, do, finding.requirement.why)
        console.print(table)
    if refusal:
        console.print(refusal, style="red", highlight=False, soft_wrap=True)
    console.print(
        f"when the module falls silent: {route.after_silence}\n"
        f"the pilot takes over by: {route.takeover}",
        highlight=False,
        soft_wrap=True,
    )
    unfit = [finding for finding in wrong if finding.requirement.level == MUST]
    if unfit or refusal:
        console.print("[red]not ready[/red]: change what stands above as MUST, then ask again")
        return 1
    if findings:
        console.print("[green]ready[/green]" + (", though it could be better" if wrong else ""))
    return 0
