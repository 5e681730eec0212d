"""`tgl-soar align`: how a motion-capture hall's axes lie in a site's NED."""

from __future__ import annotations

import csv
import json
import select
import time
from math import degrees, isfinite, sqrt
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.table import Table

from tgl_soar.analysis.alignment import (
    TOLERANCE_M,
    Alignment,
    AlignmentError,
    Pair,
    Point,
    fit_alignment,
)
from tgl_soar.cli.console import SITE_FILE, console, errors, fail
from tgl_soar.config.files import ConfigError, load_site
from tgl_soar.config.site import Mocap
from tgl_soar.link.natnet.sockets import NatNetError
from tgl_soar.onboard.mocap import MocapFeed, from_server

COLUMNS: Final = ("hall_x", "hall_y", "hall_z", "north", "east", "down")
STILL_M: Final = 0.005  # standard deviation of a body that somebody holds still
MIN_POSES: Final = 20
MAX_STALE: Final = 1000  # reads that drain what has waited
PATIENCE_S: Final = 10.0  # for the first pose, and beyond what was asked for


def align(
    pairs: Annotated[
        Path | None,
        typer.Argument(help=f"CSV with columns {', '.join(COLUMNS)}, all in metres."),
    ] = None,
    site: Annotated[
        Path | None,
        typer.Option(help="Site file with \\[mocap]: server, body and up axis.", **SITE_FILE),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NORTH,EAST,DOWN",
            help="Measure now, with the body at this point of the site \\[m]; repeat for each.",
        ),
    ] = None,
    server: Annotated[
        str, typer.Option(help="Server, HOST or HOST:PORT, instead of the site's.")
    ] = "",
    up: Annotated[str, typer.Option(help="The hall's up axis, y or z. Default: the site's.")] = "",
    seconds: Annotated[
        float, typer.Option(help="How long each point is averaged.", min=0.5, max=60.0)
    ] = 2.0,
    tolerance: Annotated[
        float, typer.Option(help="Largest residual accepted, rms \\[m].", min=1e-4, max=1.0)
    ] = TOLERANCE_M,
) -> None:
    """Compute yaw and offset between a hall's axes and the site's NED; print them as \\[mocap].

    Put the rigid body at three points or more that are known in the site's NED, not on one line:
    tgl-soar align --site my_site.toml --at 0,0,0 --at 2,0,0 --at 2,1.5,-1
    """
    if (pairs is None) == (not at):
        fail("give a CSV file with pairs, or --site and --at for each point, but not both")
    try:
        place = load_site(site) if site is not None else None
        if place is not None and server:
            place = from_server(place, server)
        mocap = place.mocap if place is not None else None
        if up not in ("", "y", "z"):
            raise ConfigError(f"--up {up!r}: y or z")
        z_up = (up or (mocap.up if mocap is not None else "y")) == "z"
        if pairs is not None:
            measured = read_pairs(pairs)
        elif mocap is None:
            raise ConfigError("--at: needs --site with a [mocap] table")
        else:
            measured = _measure(mocap, [_point(text) for text in at or []], seconds)
        found = fit_alignment(measured, z_up=z_up, tolerance_m=tolerance)
    except (ConfigError, AlignmentError, NatNetError) as error:
        fail(error)
    errors.print(_residuals(measured, found))
    errors.print(
        f"residual {1e3 * found.rms_m:.1f} mm rms; yaw {degrees(found.hall.yaw_rad):.2f} ±"
        f" {degrees(found.yaw_sigma_rad):.2f} degrees",
        highlight=False,
    )
    console.print(mocap_toml(found, mocap), markup=False, highlight=False, soft_wrap=True)


def read_pairs(path: Path) -> list[Pair]:
    """Points of a CSV file.  Errors: `ConfigError`."""
    pairs = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(line for line in file if not line.lstrip().startswith("#"))
            missing = [name for name in COLUMNS if name not in (rows.fieldnames or [])]
            if missing:
                raise ConfigError(f"{path}: no column {missing[0]}; it needs {', '.join(COLUMNS)}")
            for number, row in enumerate(rows, 1):
                x, y, z, north, east, down = (_cell(path, number, row, n) for n in COLUMNS)
                pairs.append(Pair((x, y, z), (north, east, down)))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    return pairs


def _cell(path: Path, number: int, row: dict[str, str | None], name: str) -> float:
    text = row[name] or ""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise ConfigError(f"{path}: point {number}: {name} = {text!r}: must be a number [m]")
    return value


def _point(text: str) -> Point:
    try:
        north, east, down = (float(part) for part in text.split(","))
    except ValueError:
        north = east = down = float("nan")
    if not isfinite(north + east + down):
        raise ConfigError(f"--at {text!r}: write NORTH,EAST,DOWN in metres, such as 1.5,0,-1.2")
    return north, east, down


# --- measured now -------------------------------------------------------------------------------


def _measure(mocap: Mocap, places: list[Point], seconds: float) -> list[Pair]:
    feed = MocapFeed(mocap)
    try:
        pairs = []
        for number, place in enumerate(places, 1):
            where = ", ".join(f"{value:g}" for value in place)
            errors.print(
                f"{number} of {len(places)}: put {mocap.body!r} at north, east, down {where} m,"
                " leave it there and press Enter",
                highlight=False,
            )
            input()
            hall, spread_m = average_pose(feed, seconds)
            errors.print(
                f"  hall {hall[0]:.4f}, {hall[1]:.4f}, {hall[2]:.4f} m ± {1e3 * spread_m:.1f} mm",
                highlight=False,
            )
            pairs.append(Pair(hall, place))
    except EOFError:
        raise ConfigError("stopped: no Enter came") from None
    finally:
        feed.close()
    return pairs


def average_pose(feed: MocapFeed, seconds: float) -> tuple[Point, float]:
    """The mean position of the body in the hall's axes, and its spread [m].

    Errors: `AlignmentError` for a body that is not seen or does not stand still.
    """
    begun: float | None = None
    asked = time.monotonic()
    for _ in range(MAX_STALE):  # what was streamed while it was carried
        if not feed.receive():
            break
    poses: list[Point] = []
    client = feed.client
    while begun is None or time.monotonic() - begun < seconds:
        now = time.monotonic()
        if now - asked > PATIENCE_S + seconds:
            words = "; ".join(text for _, text in client.notices) or "nothing came"
            raise AlignmentError(f"{len(poses)} poses in {now - asked:.0f} s: {words}")
        for request in client.poll(now):
            feed.send(request)
        if client.stream is not None:
            feed.follow(client.stream)
        select.select(feed.filenos(), [], [], 0.05)
        now = time.monotonic()
        for data, sender in feed.receive():
            if client.take(data, sender, now) is not None and client.pose is not None:
                begun = begun or now
                poses.append((client.pose.x_m, client.pose.y_m, client.pose.z_m))
    n = len(poses)
    if n < MIN_POSES:
        raise AlignmentError(f"{n} poses in {seconds:g} s: {MIN_POSES} are needed")
    mean = sum(p[0] for p in poses) / n, sum(p[1] for p in poses) / n, sum(p[2] for p in poses) / n
    squares = sum((p[i] - mean[i]) ** 2 for p in poses for i in range(3))
    spread_m = sqrt(squares / n)
    if spread_m > STILL_M:
        raise AlignmentError(
            f"the body moves by {1e3 * spread_m:.0f} mm: put it down, {1e3 * STILL_M:g} mm are"
            " allowed"
        )
    return mean, spread_m


# --- what is printed ----------------------------------------------------------------------------


def _residuals(pairs: list[Pair], found: Alignment) -> Table:
    table = Table("point", "hall x, y, z", "north, east, down", "residual n, e, d")
    for number, (pair, residual) in enumerate(zip(pairs, found.residuals_m, strict=True), 1):
        table.add_row(
            str(number),
            ", ".join(f"{value:.3f}" for value in pair.hall),
            ", ".join(f"{value:.3f}" for value in pair.site),
            ", ".join(f"{1e3 * value:.1f}" for value in residual) + " mm",
        )
    return table


def mocap_toml(found: Alignment, mocap: Mocap | None) -> str:
    """The `[mocap]` table of a site file; without one to begin with, what goes into it."""
    hall = found.hall
    offset = ", ".join(f"{value:.4f}" for value in hall[2:])
    lines = ["[mocap]"]
    if mocap is None:
        lines.append("# server, body and stream: see config/sites/tunnel_mocap.toml")
    else:
        names = ("server", "body", "stream", "interface", "group", "command_port", "data_port")
        lines += [f"{name} = {json.dumps(getattr(mocap, name))}" for name in names]
    lines += [
        f'up = "{"z" if hall.z_up else "y"}"',
        f"yaw_deg = {degrees(hall.yaw_rad):.3f}",
        f"offset_m = [{offset}]",
    ]
    if mocap is not None:
        limits = ("noise_m", "max_error_m", "max_speed_mps", "max_age_s", "max_rate_hz")
        lines += [f"{name} = {getattr(mocap, name):g}" for name in limits]
    return "\n".join(lines) + "\n"
