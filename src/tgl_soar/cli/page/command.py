"""`tgl-soar page`: the operator's page, on a flight or on a log of one."""

from __future__ import annotations

import ipaddress
import secrets
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final
from urllib.parse import quote

import typer

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, SITE, SITE_FILE, fail, hint, say
from tgl_soar.cli.log_argument import File, Files, of_the_log
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_from,
    load_airframe,
    load_parameters,
    load_site,
    site_from,
)
from tgl_soar.config.site import Site, air_files
from tgl_soar.link.open_link import FORMS, LinkError, open_link
from tgl_soar.link.signing_keys import SigningError, load_key

if TYPE_CHECKING:
    import uvicorn
    from starlette.types import ASGIApp

    from tgl_soar.analysis.logs.flight_data import FlightData
    from tgl_soar.cli.page.desk import Desk

EXTRA: Final = "the page needs the extra: pip install 'tgl_soar[page]'"
SHORTEST_TOKEN: Final = 16
LONGEST_TOKEN: Final = 128  # as a request may carry
PORT: Final = 8191


def page(
    link: Annotated[
        str | None, typer.Option(metavar="LINK", help=f"To the module: {FORMS}.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Show this log instead of a flight.")
    ] = None,
    airframe: Annotated[
        Path | None,
        typer.Option(
            help="Airframe file. Default: the log's own, else eclipson_c.", **AIRFRAME_FILE
        ),
    ] = None,
    site: Annotated[
        Path | None,
        typer.Option(help="Site file. Default: the log's own, else tunnel.", **SITE_FILE),
    ] = None,
    port: Annotated[
        int, typer.Option(help="Port of the page; 0: any free one.", min=0, max=65535)
    ] = PORT,
    host: Annotated[
        str,
        typer.Option(help="Address to serve at; one that is not local opens the page to others."),
    ] = "127.0.0.1",
    token: Annotated[
        str | None,
        typer.Option(
            envvar="TGL_SOAR_PAGE_TOKEN", help="Token in the page's address; a new one by default."
        ),
    ] = None,
    signing_key: Annotated[
        Path | None, typer.Option(help="Sign with the key of a file, as `tgl-soar run` does.")
    ] = None,
    measure: Annotated[
        bool, typer.Option("--map/--no-map", help="Measure the air from telemetry, and draw it.")
    ] = True,
    system: Annotated[
        int, typer.Option(help="This station's MAVLink system, one of `operators`.", min=1, max=255)
    ] = 253,
) -> None:
    """Open the operator's page: one more ground station, with the line to drag.

    It ends with Ctrl-C. Nothing happens to the flight when it does.
    """
    if (link is None) == (log is None):
        fail(f"give --link (a flight: {FORMS}) or --log (a file), one of them")
    if token is not None:
        _check_token(token)
    try:
        import uvicorn

        from tgl_soar.cli.page.server import Access, app_of
    except ImportError as error:
        fail(f"{EXTRA} ({error.name} is missing)")
    try:
        if log is not None:
            desk, notes = recorded_desk(log, airframe, site, maps=measure)
            for note in notes:
                hint(note)
        else:
            airframe, site = airframe or AIRFRAME, site or SITE
            plane, place = load_airframe(airframe), load_site(site)
            key = None if signing_key is None else load_key(signing_key)
            if system not in plane.autopilot.operators:
                hint(f"system {system} is none of the airframe file's operators: it only watches")
            desk = live_desk(plane, airframe, place, site, link or "", key, system, maps=measure)
        listener = _listener(host, port)
    except (ConfigError, LinkError, SigningError, LogError, ImportError) as error:
        fail(error)
    access = Access(token or secrets.token_urlsafe(SHORTEST_TOKEN), _reachable(host))
    _announce(listener, access.token, host)
    try:
        uvicorn.Server(config_of(app_of(desk, access))).run(sockets=[listener])
    except KeyboardInterrupt:
        pass
    finally:
        listener.close()


def config_of(app: ASGIApp) -> uvicorn.Config:
    """How it is served: short messages in, nothing about requests on the console."""
    import uvicorn

    return uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        ws_max_size=4096,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
    )


def live_desk(
    plane: Airframe,
    plane_file: Path,
    place: Site,
    place_file: Path,
    link: str,
    key: bytes | None,
    system: int,
    *,
    maps: bool = True,
) -> Desk:
    """A desk on a flight, its link open.  Errors: `ConfigError`, `LinkError`."""
    from tgl_soar.cli.page.desk import Desk
    from tgl_soar.cli.page.scene import place_of
    from tgl_soar.cli.page.station import Station

    values = load_parameters(plane, plane_file, place, place_file)
    own = plane.autopilot
    station = Station(own.system_id, own.component_id, system, key, time.time())
    shown = place_of(plane, place, values, place_file.parent)
    opened = open_link(link, station.vouches, time.monotonic())
    return Desk(shown, station, opened, None, maps=maps)


def recorded_desk(
    log: Path, airframe: Path | None = None, site: Path | None = None, *, maps: bool = True
) -> tuple[Desk, list[str]]:
    """A desk on a log, and what is to be known of the files that it is shown with.

    airframe, site: files in the place of the log's own.  Errors: `ConfigError`, `LogError`.
    """
    import msgspec

    from tgl_soar.analysis.logs.open_log import read_flight
    from tgl_soar.cli.page.desk import Desk
    from tgl_soar.cli.page.recording import recording_of
    from tgl_soar.cli.page.scene import place_of

    flight = read_flight(log)
    files = load_airframe, airframe_from
    plane, notes = _shown_with(flight, "airframe", airframe, AIRFRAME, files)
    place, more = _shown_with(flight, "site", site, SITE, (load_site, site_from))
    notes += more
    folder = SITE.parent if site is None else site.parent
    is_own = site is None and "site" in flight.files
    if is_own and place.air is not None and (grids := air_files(place.air, Path())):
        # A log may be a stranger's, and would choose which file of this computer is shown.
        place = msgspec.structs.replace(place, air=None)
        notes.append(
            f"the site's air is in a file that the log does not hold, {grids[0]}, and that is"
            " not opened at its word: name the site file by --site"
        )
    values = load_parameters(plane, airframe or "airframe", place, site or "site")
    shown = place_of(plane, place, values, folder)
    air = shown.measured_air() if maps else None
    recording = recording_of(flight, place, air) | {"notes": notes}
    return Desk(shown, None, None, msgspec.json.encode(recording)), notes


def _shown_with(
    flight: FlightData, kind: str, path: Path | None, default: Path, files: Files[File]
) -> tuple[File, list[str]]:
    """The file that a log is shown with, and what is to be known of it.

    Errors: `ConfigError`, also where the log's own is needed and not understood.
    """
    own, unread = of_the_log(flight, kind, None, files)
    if path is not None:
        named = files[0](path)
        other = own is not None and own != named
        return named, [f"--{kind} {path}: not what the log's flight was flown with"] * other
    if own is not None:
        return own, []
    if unread:
        raise ConfigError(f"{unread[0]}; name one by --{kind}")
    missing = f"the log holds no {kind} file: it is shown with {default.stem}; name its by --{kind}"
    return files[0](default), [missing]


def _check_token(token: str) -> None:
    """End the command if no address and no request could carry it."""
    if len(token) < SHORTEST_TOKEN:
        fail(f"--token has {len(token)} characters: give {SHORTEST_TOKEN} or more, or leave it out")
    if len(token) > LONGEST_TOKEN:
        fail(f"--token has {len(token)} characters: give {LONGEST_TOKEN} or fewer, or leave it out")
    if not (token.isascii() and token.isprintable()) or " " in token:
        fail("--token: give letters, digits and signs of ASCII without a space, or leave it out")


def _listener(host: str, port: int) -> socket.socket:
    """A socket that listens there.  Errors: `LinkError`."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise LinkError(
            f"--host {host} --port {port}: cannot be served at: {error.strerror};"
            " another --port (0: any) may be free"
        ) from None


def _announce(listener: socket.socket, token: str, host: str) -> None:
    """The address, for a browser."""
    port = listener.getsockname()[1]
    if not _is_loopback(host):
        hint(
            "the page is open to the network: whoever has its address can move the aircraft, and"
            " whoever listens on the network can read it; without a network you trust, tunnel it"
            f" (ssh -L {port}:127.0.0.1:{port})"
        )
    shown = _reachable(host)
    shown = f"[{shown}]" if ":" in shown else shown
    say(f"the operator's page: http://{shown}:{port}/#token={quote(token, safe='')}")


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _reachable(host: str) -> str:
    """The address as another computer has it, where all of this one's are served at."""
    if host not in ("0.0.0.0", "::"):  # compared, not bound
        return host
    return socket.gethostname()
