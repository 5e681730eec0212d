"""`tgl-soar sitl`: the three-leg flight between real processes."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.live import Live
from rich.table import Table

from tgl_soar.analysis.logs.reader import LogError
from tgl_soar.autopilot import mode_name
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    SITE_MOCAP,
    console,
    fail,
    hint,
    say,
)
from tgl_soar.cli.report import Named, write
from tgl_soar.config.files import ConfigError, load_airframe, load_site
from tgl_soar.onboard.flightlog.files import kept_in

if TYPE_CHECKING:
    from tgl_soar.sim.operator import Operator
    from tgl_soar.sim.sitl import Flight, SitlOptions


class Autopilot(StrEnum):
    """Who moves the surfaces: the bridge's own Pixhawk, or a real firmware in its place."""

    BUILTIN = "builtin"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


OBTAINED = {
    Autopilot.PX4: "build the target px4_sitl_default of PX4's public sources, v1.14 or newer;"
    " the program is build/px4_sitl_default/bin/px4 (name it by --px4 or TGL_SOAR_PX4)",
    Autopilot.ARDUPILOT: "build ArduPlane 4.6 or newer for the board sitl from ArduPilot's public"
    " sources (./waf configure --board sitl, ./waf plane); the program is"
    " build/sitl/bin/arduplane (name it by --ardupilot or TGL_SOAR_ARDUPLANE)",
}


class Mocap(StrEnum):
    """Where the position comes from: the autopilot, or a motion-capture hall."""

    NONE = "none"
    NATNET = "natnet"


def sitl(
    context: typer.Context,
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    site: Annotated[
        Path | None,
        typer.Option(help="Site file; of the tunnel, with \\[mocap] where needed.", **SITE_FILE),
    ] = None,
    legs: Annotated[str, typer.Option(help="Names of lines, by commas; all of the site's.")] = "",
    stay: Annotated[float, typer.Option(help="Seconds on each line.", min=2.0, max=600.0)] = 16.0,
    seed: Annotated[int, typer.Option(help="Of noise and turbulence.", min=0)] = 1,
    turbulence: Annotated[
        float | None,
        typer.Option(help="Fraction of the wind; the site's where not given.", min=0.0, max=0.5),
    ] = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="By the clock, open to other ground stations.")
    ] = False,
    gcs_local: Annotated[
        str,
        typer.Option(
            metavar="HOST:PORT",
            help="In real time: the bridge's own port towards ground stations; port 0: any.",
        ),
    ] = "127.0.0.1:18570",
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="What goes wrong, as 'position.dropout start=20 for=1.5'; repeat for more;"
            " `list` shows all. Of the position: as the autopilot tells it, also with --mocap."
        ),
    ] = None,
    mocap: Annotated[
        Mocap, typer.Option(help="The position comes from OptiTrack: a stand-in streams NatNet.")
    ] = Mocap.NONE,
    mocap_option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Of the stand-in, as tools/sitl_bridge.py --help tells them: version=4.2,"
            " loss=0.1, fault=untracked:20:21.5; repeat for more.",
        ),
    ] = None,
    autopilot: Annotated[
        Autopilot, typer.Option(help="The bridge's own Pixhawk, or a real firmware.")
    ] = Autopilot.BUILTIN,
    px4: Annotated[
        Path | None,
        typer.Option(envvar="TGL_SOAR_PX4", help="PX4's program: …/px4_sitl_default/bin/px4."),
    ] = None,
    ardupilot: Annotated[
        Path | None,
        typer.Option(envvar="TGL_SOAR_ARDUPLANE", help="ArduPlane's program: …/bin/arduplane."),
    ] = None,
    route: Annotated[
        str | None,
        typer.Option(help="By which a firmware is commanded, as attitude or manual_control."),
    ] = None,
    autopilot_parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Of the autopilot; repeat for more."),
    ] = None,
    kill_module: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Kill the module so long after its first line stood, and see what becomes of the"
            " aircraft.",
            min=0.0,
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for logs and the figure.")] = Path("out/sitl"),
    report: Annotated[
        bool, typer.Option("--report", help="Write the page of the flight as well.")
    ] = False,
) -> None:
    """Fly the line from a to b to c between real processes; exit code 1 if a leg fails."""
    from tgl_soar.sim.faults import FaultError, catalogue_text, parse_faults
    from tgl_soar.sim.sitl import SitlError, SitlOptions, fly, passed

    faults = tuple(fault or ())
    if "list" in faults:
        console.print(catalogue_text(), markup=False, highlight=False, soft_wrap=True)
        return
    try:
        parse_faults(faults)
    except FaultError as error:
        fail(f"--fault: {error}")
    firmware = {Autopilot.PX4: px4, Autopilot.ARDUPILOT: ardupilot}.get(autopilot)
    if autopilot != Autopilot.BUILTIN and firmware is None:
        fail(f"--autopilot {autopilot}: no program of it is named: {OBTAINED[autopilot]}")
    if autopilot == Autopilot.BUILTIN and route is not None:
        fail(
            f"--route {route}: the bridge's own Pixhawk is commanded one way only; name a firmware"
            " by --autopilot px4 or --autopilot ardupilot, or leave it out"
        )
    if mocap_option and mocap == Mocap.NONE and (autopilot == Autopilot.BUILTIN or site):
        fail(
            f"--mocap-option {mocap_option[0]}: no motion capture is flown with: add --mocap"
            " natnet, or leave it out"
        )
    for named, of in (("px4", Autopilot.PX4), ("ardupilot", Autopilot.ARDUPILOT)):
        given = str(context.get_parameter_source(named)).endswith("COMMANDLINE")
        if given and autopilot != of:  # one of the environment may stand there for other days
            fail(f"--{named}: is flown with --autopilot {of} only; add it, or leave this out")
    by_poses = autopilot != Autopilot.BUILTIN and site is None
    flown_by = mocap == Mocap.NATNET or by_poses
    mocap_option = mocap_option or []
    if flown_by and autopilot == Autopilot.PX4:
        mocap_option = ["rate=125", *mocap_option]  # of its 250 steps a second
    options = SitlOptions(
        airframe=airframe,
        site=site or (SITE_MOCAP if flown_by else SITE),
        out=out,
        legs=tuple(name.strip() for name in legs.split(",") if name.strip()),
        stay_s=stay,
        seed=seed,
        turbulence=turbulence,
        realtime=realtime,
        faults=faults,
        mocap=flown_by,
        mocap_options=tuple(f"--mocap-{option}" for option in mocap_option),
        autopilot=autopilot.value,
        firmware=firmware,
        route=route,
        autopilot_parameters=tuple(autopilot_parameter or ()),
        kill_s=kill_module,
        gcs_local=gcs_local,
    )
    try:
        with Live(console=console, refresh_per_second=10, transient=True) as live:

            def progress(operator: Operator) -> None:
                live.update(_progress(operator))

            flight = fly(options, progress)
    except (SitlError, ConfigError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail("stopped", 130)

    title = "from the truth of the simulation"
    table = Table(
        "leg",
        "settled after",
        "rms e_rho",
        "peak e_rho",
        "wander",
        "mean to TGL ∩ ZEUC",
        title=title,
    )
    for score, flown in zip(flight.scores, flight.flown, strict=True):
        settled = f"{score.settling_s:.1f} s" if score.settled else "[red]not held[/red]"
        table.add_row(
            score.name,
            "moved by hand" if flown.by_hand else settled,
            f"{score.rms_e_rho_m * 100:.2f} cm",
            f"{score.peak_e_rho_m * 100:.1f} cm",
            f"{score.wander_m * 100:.1f} cm",
            f"{score.crossing_m * 100:.1f} cm" if score.crossing_m == score.crossing_m else "–",
        )
    console.print(table)
    for note in flight.notes:
        console.print(note, style="yellow", markup=False, highlight=False, soft_wrap=True)
    simulated = flight.truth["time_s"][-1]
    say(f"{simulated:.0f} s of flight in {flight.wall_s:.0f} s; logs and figure in {out}/")
    log = newest_log(out / "logs")
    try:
        _draw(options, flight, out / "flight.png")
        if report and log is not None:
            page = out / "report.html"
            write(log, page, Named(), lambda _words: None)
            say(f"its report: {page}")
    except (ImportError, LogError) as error:
        hint(f"no figure: {error}")
    if log is not None and not report:
        console.print(f"its report: tgl-soar report {log}", soft_wrap=True, highlight=False)
    if not passed(flight):
        fail("a leg did not settle", 1)


def newest_log(folder: Path) -> Path | None:
    """The module's log of the last flight, its first part."""
    logs = [kept for kept in kept_in(folder) if kept.path.suffix == ".ulg"]
    return next((log.path for log in logs if log.flight == logs[-1].flight), None)


def _draw(options: SitlOptions, flight: Flight, path: Path) -> None:
    """The flight in the vertical plane, as it truly was.  Errors: ImportError."""
    from tgl_soar.analysis.logs.flight_data import FlightData, Series
    from tgl_soar.analysis.report.flight_figures import Surroundings, plane_figure
    from tgl_soar.analysis.report.legs import Leg
    from tgl_soar.analysis.report.style import drawing, save
    from tgl_soar.sim.world import build_field, ground_outline

    site = load_site(options.site)
    assert site.air is not None  # it was flown in
    truth = flight.truth
    flying = truth["time_s"] <= flight.flown[-1].ended_s
    columns = {name: truth[name][flying] for name in ("x_m", "y_m", "z_m")}
    legs = [
        Leg(score.name, line, flown.stopped_s, flown.ended_s, score, crossing, float("nan"))
        for flown, line, score, crossing in zip(
            flight.flown, flight.lines, flight.scores, flight.crossings, strict=True
        )
    ]
    surroundings = Surroundings(
        field=build_field(site.air, options.site.parent),
        polar=load_airframe(options.airframe).polar.as_polar(),
        ground=ground_outline(site.air),
    )
    path_flown = Series(truth["time_s"][flying], columns, "truth.csv")
    with drawing() as plt:
        data = FlightData(path.name, "simulation", path=path_flown)
        save(plt, plane_figure(plt, data, legs, surroundings), path)


def _progress(operator: Operator) -> Table:
    """One line of the flight as the ground station sees it."""
    seen = operator.seen.values
    leg = operator.flown[-1].leg.name if operator.flown else "–"

    def number(name: str, form: str, unit: str) -> str:
        value = seen.get(name)
        return "–" if value is None else f"{value:{form}} {unit}"

    mode = seen.get("soar_mode")
    table = Table("time", "leg", "mode", "e_rho", "x", "z", "updraft", "sink", box=None)
    table.add_row(
        f"{operator.seen.time_s:.1f} s",
        leg,
        "–" if mode is None or mode != mode else mode_name(int(mode)),
        number("e_rho", "+.3f", "m"),
        number("soar_x", ".2f", "m"),
        number("soar_z", ".2f", "m"),
        number("updraft", ".2f", "m/s"),
        number("sink", ".2f", "m/s"),
    )
    return table
