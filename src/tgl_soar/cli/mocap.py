"""`tgl-soar mocap`: what a motion-capture server streams."""

from __future__ import annotations

import select
import time
from math import isnan
from pathlib import Path
from typing import Annotated, Final

import typer
from msgspec.structs import replace
from rich.table import Table

from tgl_soar.cli.console import SITE_FILE, console, errors, fail
from tgl_soar.config.files import ConfigError, load_site
from tgl_soar.config.site import Mocap
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.listing import BodyListing, BodyRow
from tgl_soar.link.natnet.sockets import NatNetError
from tgl_soar.onboard.mocap import MocapFeed, from_server, server_address

mocap_app = typer.Typer(help="Show what a motion-capture server streams.", no_args_is_help=True)

NOBODY: Final = 2**31 - 1  # an id that nobody gives a body: all are listed, none is used
ASK_S: Final = 0.5  # between two signs of life, and two questions for names
LOOK_S: Final = 0.05


@mocap_app.callback()
def mocap() -> None:
    """Show what a motion-capture server streams."""


@mocap_app.command("list")
def list_(
    site: Annotated[
        Path | None,
        typer.Option(help="Site file with \\[mocap]: server and interface.", **SITE_FILE),
    ] = None,
    server: Annotated[
        str, typer.Option(metavar="HOST[:PORT]", help="Server; replaces the site's.")
    ] = "",
    interface: Annotated[
        str, typer.Option(help="This computer's address on the cameras' network, if several.")
    ] = "",
    seconds: Annotated[float, typer.Option(help="How long to listen.", min=0.5, max=60.0)] = 2.0,
    timeout: Annotated[
        float, typer.Option(help="Seconds to wait for the first frame.", min=0.5, max=600.0)
    ] = 10.0,
) -> None:
    """List the rigid bodies that are streamed: id, name, tracked or not, rate and age.

    Exit code 0: there are some; 1: there are none; 2: the server does not answer or stream.
    """
    try:
        feed = _opened(_wanted(site, server, interface))
        try:
            rows = listed(feed, seconds, timeout)
        finally:
            feed.close()
    except (ConfigError, NatNetError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("stopped", 130)
    info = feed.client.info
    if info is not None:
        version = f"{info.version[0]}.{info.version[1]}"
        way = "multicast" if info.is_multicast else "unicast"
        reported = f"{info.name}, NatNet {version}, {way}: {len(rows)} rigid bodies"
        console.print(reported, markup=False, highlight=False, soft_wrap=True)
    if not rows:
        errors.print("frames arrive without a rigid body: see Motive's streaming pane")
        raise typer.Exit(1)
    console.print(_table(rows))


def _wanted(site: Path | None, server: str, interface: str) -> Mocap:
    """Errors: `ConfigError`."""
    if site is not None:
        place = load_site(site)
        if server:
            place = from_server(place, server)
        if place.mocap is None:
            raise ConfigError(f"{site}: no [mocap] table; name the server with --server")
        found = place.mocap
    elif server:
        host, port = server_address("--server", server)
        found = Mocap(server=host, body=NOBODY)
        found = found if port is None else replace(found, command_port=port)
    else:
        found = Mocap(server="discover", body=NOBODY)
    try:
        return replace(found, body=NOBODY, interface=interface or found.interface)
    except ValueError as error:
        raise ConfigError(f"--{error}") from None


def _opened(wanted: Mocap) -> MocapFeed:
    """For both ways to stream: the server says itself which it is.  Errors: `NatNetError`."""
    try:
        return MocapFeed(replace(wanted, stream="multicast"))
    except NatNetError:  # no group can be joined here
        return MocapFeed(replace(wanted, stream="unicast"))


def listed(feed: MocapFeed, seconds: float, timeout_s: float) -> list[BodyRow]:
    """Listen for so long from the first frame on.  Errors: `NatNetError` if none comes."""
    client, listing = feed.client, BodyListing()
    began_s = now_s = time.monotonic()
    first_s = asked_s = float("-inf")
    while first_s < 0.0 or now_s - first_s < seconds:
        if first_s < 0.0 and now_s - began_s > timeout_s:
            words = "; ".join(text for _, text in client.notices)
            raise NatNetError(f"no frame in {timeout_s:g} s: {words or 'nobody has answered'}")
        for request in client.poll(now_s):
            feed.send(request)
        if client.info is not None and now_s - asked_s >= ASK_S:
            asked_s = now_s
            feed.send(layout.keep_alive())
            if not client.models:
                feed.send(layout.models_request())
        if client.stream is not None:
            feed.follow(client.stream)
        select.select(feed.filenos(), [], [], LOOK_S)
        now_s = time.monotonic()
        for data, sender in feed.receive():
            before = client.counters.absent + client.counters.stale
            client.take(data, sender, now_s)
            if client.counters.absent + client.counters.stale > before:
                first_s = now_s if first_s < 0.0 else first_s
                listing.take(layout.bodies_of(data, client.version), client.age_s, now_s)
    return listing.rows(client.models, now_s)


def _table(rows: list[BodyRow]) -> Table:
    table = Table("id", "name", "tracked", "rate", "age", "last seen", "x, y, z in the hall's axes")
    for row in rows:
        tracked = "yes" if row.tracked else "[red]no[/red]"
        if 0.0 < row.tracked_fraction < 1.0:
            tracked += f" ({100 * row.tracked_fraction:.0f} % of frames)"
        pose = row.pose
        table.add_row(
            str(row.id),
            row.name.replace("[", "\\[") or "–",
            tracked,
            "–" if isnan(row.rate_hz) else f"{row.rate_hz:.0f} Hz",
            "–" if isnan(row.age_s) else f"{1e3 * row.age_s:.0f} ms",
            "now" if row.silent_s < 0.5 else f"{row.silent_s:.1f} s ago",
            f"{pose.x_m:.3f}, {pose.y_m:.3f}, {pose.z_m:.3f} m",
        )
    return table
