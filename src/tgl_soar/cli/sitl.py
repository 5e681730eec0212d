"""`tgl-soar sitl`: the three-leg flight between real processes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from math import inf, isfinite
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.live import Live

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    MODEL_HELP,
    SITE,
    SITE_FILE,
    SITE_MOCAP,
    SITE_SEARCH,
    FlightModel,
    console,
    fail,
    hint,
    say,
)
from tgl_soar.cli.log_argument import newest_log
from tgl_soar.cli.report import Named, write
from tgl_soar.cli.sitl_table import progress_of, show_flight
from tgl_soar.config.airframe import MODEL_OPTIONS
from tgl_soar.config.files import (
    ConfigError,
    check_simulated,
    load_airframe,
    load_flight,
    load_site,
)
from tgl_soar.config.site import PolynomialAir, air_files

if TYPE_CHECKING:
    from tgl_soar.sim.operator import Operator
    from tgl_soar.sim.sitl import SitlFlight
    from tgl_soar.sim.sitl_options import SitlOptions


class SitlAutopilot(StrEnum):
    """Who moves the surfaces: the bridge's own Pixhawk, or a real firmware in its place."""

    BUILTIN = "builtin"
    PX4 = "px4"
    ARDUPILOT = "ardupilot"


OBTAINED = {
    SitlAutopilot.PX4: "build the target px4_sitl_default of PX4's public sources, v1.14 or newer;"
    " the program is build/px4_sitl_default/bin/px4 (name it by --px4 or TGL_SOAR_PX4)",
    SitlAutopilot.ARDUPILOT: "build ArduPlane 4.6 or newer for the board sitl from ArduPilot's"
    " public sources (./waf configure --board sitl, ./waf plane); the program is"
    " build/sitl/bin/arduplane (name it by --ardupilot or TGL_SOAR_ARDUPLANE)",
}


class SitlMocap(StrEnum):
    """Where the position comes from: the autopilot, or a motion-capture hall."""

    NONE = "none"
    NATNET = "natnet"


class SitlLaunch(StrEnum):
    """How the flight begins."""

    HELD = "held"
    HAND = "hand"


class SitlReceiver(StrEnum):
    """What the simulated Pixhawk takes its position from."""

    LOCAL = "local"
    SATELLITES = "satellites"
    RTK = "rtk"


AirframeFile = Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)]
SiteFile = Annotated[
    Path | None,
    typer.Option(help="Site file. Default: the tunnel, with \\[mocap] where needed.", **SITE_FILE),
]
ModelChoice = Annotated[FlightModel | None, typer.Option(help=MODEL_HELP)]
Legs = Annotated[str, typer.Option(help="Names of lines, with commas. Default: all of the site's.")]
Stay = Annotated[float, typer.Option(help="Seconds on each line.", min=2.0, max=600.0)]
Seed = Annotated[int, typer.Option(help="Seed of noise and turbulence.", min=0)]
Turbulence = Annotated[
    float | None,
    typer.Option(help="Turbulence, a fraction of the wind. Default: the site's.", min=0.0, max=0.5),
]
ReceiverChoice = Annotated[
    SitlReceiver,
    typer.Option(
        help="Positions of the simulated Pixhawk: a local system, satellites that drift by a metre,"
        " and by two in height, or satellites with carrier-phase corrections."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=NUMBER", help="A parameter of the module; repeat for more."
    ),
]
Realtime = Annotated[
    bool, typer.Option("--realtime", help="Fly in real time, open to other ground stations.")
]
GroundLocal = Annotated[
    str,
    typer.Option(
        metavar="HOST:PORT",
        help="In real time: the bridge's own port towards ground stations; port 0: any.",
    ),
]
WithPage = Annotated[
    bool,
    typer.Option(
        "--page", help="Fly in real time with the operator's page, until Ctrl-C; engage there."
    ),
]
PagePort = Annotated[
    int, typer.Option(help="Port of that page; 0: any free one.", min=0, max=65535)
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        help="A fault, as 'position.dropout start=20 for=1.5'; repeat for more;"
        " `list` shows all. Position faults act on the autopilot's reports, also with --mocap."
    ),
]
MocapChoice = Annotated[
    SitlMocap, typer.Option(help="The position comes from OptiTrack: a stand-in streams NatNet.")
]
MocapSettings = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Option of the stand-in, as tools/sitl_bridge.py --help lists: version=4.2,"
        " loss=0.1, fault=untracked:20:21.5; repeat for more.",
    ),
]
AutopilotChoice = Annotated[
    SitlAutopilot, typer.Option(help="The bridge's own Pixhawk, or a real firmware.")
]
Px4Program = Annotated[
    Path | None,
    typer.Option(envvar="TGL_SOAR_PX4", help="PX4's program: …/px4_sitl_default/bin/px4."),
]
ArduPlaneProgram = Annotated[
    Path | None,
    typer.Option(envvar="TGL_SOAR_ARDUPLANE", help="ArduPlane's program: …/bin/arduplane."),
]
Route = Annotated[
    str | None,
    typer.Option(help="How the firmware is commanded: override, attitude or manual_control."),
]
AutopilotParameters = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=NUMBER[@S]",
        help="A parameter of the autopilot; with @S a real firmware's, in flight. Repeatable.",
    ),
]
WithSearch = Annotated[
    bool,
    typer.Option(
        "--search",
        help="Search for lift first, from where no line holds the aircraft; then --legs, if any.",
    ),
]
WithSurvey = Annotated[
    bool, typer.Option("--survey", help="Survey the contour from the last line of --legs.")
]
LaunchChoice = Annotated[
    SitlLaunch,
    typer.Option(help="Begin in the air, or in a hand before the crest, which throws it."),
]
WithLanding = Annotated[
    bool,
    typer.Option(
        "--land", help="After the last leg break off and land; the site needs \\[landing]."
    ),
]
KillModule = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Kill the module this long after it settled on line one, and watch the aircraft.",
        min=0.0,
    ),
]
Out = Annotated[Path, typer.Option(help="Folder for logs and the figure.")]
WithReport = Annotated[bool, typer.Option("--report", help="Write the page of the flight as well.")]


def sitl(
    context: typer.Context,
    airframe: AirframeFile = AIRFRAME,
    site: SiteFile = None,
    model: ModelChoice = None,
    legs: Legs = "",
    stay: Stay = 16.0,
    seed: Seed = 1,
    turbulence: Turbulence = None,
    receiver: ReceiverChoice = SitlReceiver.LOCAL,
    settings: Settings = None,
    realtime: Realtime = False,
    gcs_local: GroundLocal = "127.0.0.1:18570",
    page: WithPage = False,
    page_port: PagePort = 8191,
    fault: Faults = None,
    mocap: MocapChoice = SitlMocap.NONE,
    mocap_option: MocapSettings = None,
    autopilot: AutopilotChoice = SitlAutopilot.BUILTIN,
    px4: Px4Program = None,
    ardupilot: ArduPlaneProgram = None,
    route: Route = None,
    autopilot_parameter: AutopilotParameters = None,
    search: WithSearch = False,
    survey: WithSurvey = False,
    launch: LaunchChoice = SitlLaunch.HELD,
    land: WithLanding = False,
    kill_module: KillModule = None,
    out: Out = Path("out/sitl"),
    report: WithReport = False,
) -> None:
    """Fly the line from a to b to c between real processes.

    Exit code 1: a leg was not held, or a landing was too far from its place or too hard.
    """
    from tgl_soar.sim.faults import catalogue_text
    from tgl_soar.sim.sitl_options import SitlOptions

    faults = tuple(fault or ())
    if "list" in faults:
        console.print(catalogue_text(), markup=False, highlight=False, soft_wrap=True)
        return
    _check_faults(faults, autopilot)
    programs = {SitlAutopilot.PX4: px4, SitlAutopilot.ARDUPILOT: ardupilot}
    _check_autopilot(context, autopilot, programs, route)
    if autopilot != SitlAutopilot.BUILTIN:
        _check_of_bridge(context, autopilot, receiver, launch)
    if not (realtime or page) and _is_given(context, "gcs_local"):
        fail(f"--gcs-local {gcs_local}: ground stations join in real time only; add --realtime")
    by_mocap = mocap == SitlMocap.NATNET or (autopilot != SitlAutopilot.BUILTIN and site is None)
    options = SitlOptions(
        airframe=airframe,
        site=site or (SITE_MOCAP if by_mocap else SITE_SEARCH if search else SITE),
        out=out,
        legs=tuple(name.strip() for name in legs.split(",") if name.strip()),
        stay_s=stay,
        settings=_numbers(settings or []),
        model=None if model is None else model.value,
        seed=seed,
        turbulence=turbulence,
        receiver=receiver.value,
        realtime=realtime or page,
        faults=faults,
        mocap=by_mocap,
        mocap_options=_mocap_settings(mocap_option or [], autopilot, by_mocap=by_mocap),
        autopilot=autopilot.value,
        firmware=programs.get(autopilot),
        route=route,
        autopilot_parameters=tuple(autopilot_parameter or ()),
        search=search,
        survey=survey,
        by_hand=launch == SitlLaunch.HAND,
        goes_home=land,
        kill_s=kill_module,
        gcs_local=gcs_local,
    )
    _say_what_flies(options)
    if page:
        _host(options, page_port)
    _fly_to_the_end(options, report=report)


def _say_what_flies(options: SitlOptions) -> None:
    """How far the air and the aircraft are from what they stand for, where either is fitted."""
    from tgl_soar.sim.world import polar_misfit_text, site_field, wind_misfit_text

    try:
        airframe, site = load_airframe(options.airframe), load_site(options.site)
        check_simulated(options.airframe, airframe)
        kind = None if options.model is None else MODEL_OPTIONS[options.model]
        wind = ""
        if isinstance(site.air, PolynomialAir):
            wind = wind_misfit_text(site_field(site, options.site.parent, options.site))
        for words in (wind, polar_misfit_text(airframe.flown_as(kind))):
            if words:
                say(words)
    except ValueError as error:  # `ConfigError` too
        fail(error)


def _numbers(settings: list[str]) -> tuple[tuple[str, float], ...]:
    """Names and numbers of NAME=NUMBER."""
    found = []
    for text in settings:
        name, _, number = text.partition("=")
        try:
            found.append((name.strip(), float(number)))
        except ValueError:
            fail(f"--set {text}: write NAME=NUMBER, such as TGL_HOLD=1")
    return tuple(found)


def _check_faults(faults: tuple[str, ...], autopilot: SitlAutopilot) -> None:
    from tgl_soar.sim.faults import FaultError, parse_faults, refusal

    try:
        parsed = parse_faults(faults)
    except FaultError as error:
        fail(f"--fault: {error}")
    if why := refusal(parsed, autopilot):
        fail(f"--fault {why}")


def _check_autopilot(
    context: typer.Context,
    autopilot: SitlAutopilot,
    programs: Mapping[SitlAutopilot, Path | None],
    route: str | None,
) -> None:
    """Whether what was chosen of a firmware belongs to the one that is flown with."""
    if autopilot != SitlAutopilot.BUILTIN and programs[autopilot] is None:
        fail(f"--autopilot {autopilot}: its program is not named: {OBTAINED[autopilot]}")
    if autopilot == SitlAutopilot.BUILTIN and route is not None:
        fail(
            f"--route {route}: the bridge's own Pixhawk has only one route; name a firmware"
            " by --autopilot px4 or --autopilot ardupilot, or leave it out"
        )
    for of in programs:
        if autopilot != of and _is_given(
            context, of.value
        ):  # one of the environment may stand there for other days
            fail(f"--{of}: is flown with --autopilot {of} only; add it, or leave this out")


def _check_of_bridge(
    context: typer.Context,
    autopilot: SitlAutopilot,
    receiver: SitlReceiver,
    launch: SitlLaunch,
) -> None:
    """Whether nothing was chosen that only the bridge's own Pixhawk has."""
    if _is_given(context, "receiver"):
        fail(f"--receiver {receiver.value}: a real firmware has its own; see its parameters")
    if launch == SitlLaunch.HAND:
        fail(f"--launch hand --autopilot {autopilot}: a real firmware is launched in the air")


def _is_given(context: typer.Context, option: str) -> bool:
    """Whether an option stands on the command line."""
    return str(context.get_parameter_source(option)).endswith("COMMANDLINE")


def _mocap_settings(
    given: list[str], autopilot: SitlAutopilot, *, by_mocap: bool
) -> tuple[str, ...]:
    """The stand-in's, as options of the bridge."""
    if given and not by_mocap:
        fail(
            f"--mocap-option {given[0]}: there is no motion capture: add --mocap natnet, or"
            " leave it out"
        )
    if by_mocap and autopilot == SitlAutopilot.PX4:
        given = ["rate=125", *given]  # of its 250 steps a second
    return tuple(f"--mocap-{setting}" for setting in given)


def _fly_to_the_end(options: SitlOptions, *, report: bool) -> None:
    """Fly, show what was flown, and fail where it did not pass."""
    from tgl_soar.sim.sitl import passed

    flight = _fly(options)
    show_flight(options, flight)
    _write_pages(options, flight, report=report)
    if not passed(flight):
        why = "" if flight.landing is None else flight.landing.fault()
        ends = [f"{each.leg.name}: the module disengaged: {each.released}"
                for each in flight.flown if each.released]  # fmt: skip
        fail("; ".join(ends) or why or "a leg did not settle", 1)


def _fly(options: SitlOptions) -> SitlFlight:
    """Fly, with a line of the flight on the console."""
    from tgl_soar.sim.sitl import fly
    from tgl_soar.sim.sitl_options import SitlError

    try:
        _check_lines(options)
        with Live(console=console, refresh_per_second=10, transient=True) as live:

            def progress(operator: Operator) -> None:
                live.update(progress_of(operator))

            return fly(options, progress)
    except (SitlError, ConfigError) as error:
        fail(error)
    except OSError as error:
        _fail_of_disk(options, error)
    except KeyboardInterrupt:
        fail("stopped", 130)


def _check_lines(options: SitlOptions) -> None:
    """Fail where the module would refuse one of the flight's lines, before anything is started."""
    from tgl_soar.cli.sitl_lines import refused_line

    if why := refused_line(options):
        fail(f"{why}; change this line, or choose others by --legs")


def _fail_of_disk(options: SitlOptions, error: OSError) -> NoReturn:
    """What cannot be written of a flight, such as on a disk that has become full."""
    file = error.filename or options.out
    fail(f"--out {options.out}: {file} cannot be written: {error.strerror}")


def _host(options: SitlOptions, port: int) -> NoReturn:
    """Fly beside the operator's page until somebody ends it."""
    from tgl_soar.sim.sitl_options import SitlError
    from tgl_soar.sim.sitl_page import host

    if options.goes_home:
        fail("--page --land: beside the page nobody but its user lands: set ESC_START 1 there")
    if options.autopilot != SitlAutopilot.BUILTIN:
        fail(
            f"--page --autopilot {options.autopilot}: the page flies with the bridge's own Pixhawk"
        )
    say("computing the air, and seeking gains if the airframe file has none: up to half a minute …")
    try:
        host(
            options,
            port,
            lambda address: say(f"the operator's page: {address}\nengage there; Ctrl-C ends it"),
        )
    except (SitlError, ConfigError) as error:
        fail(error)
    except KeyboardInterrupt:
        say(f"ended; its logs are in {options.out}/logs")
        raise typer.Exit from None


def _write_pages(options: SitlOptions, flight: SitlFlight, *, report: bool) -> None:
    """The figure, and the report where it is asked for."""
    out = options.out
    log = newest_log(out / "logs")
    try:
        _draw(options, flight, out / "flight.png")
        if options.search and log is not None:
            _draw_map(options, log, out / "search.png")
        if report and log is not None:
            page = out / "report.html"
            write(log, page, Named(site=_site_to_name(options)), lambda _words: None)
            say(f"its report: {page}")
    except (ImportError, LogError) as error:
        hint(f"no figure: {error}")
    except OSError as error:
        _fail_of_disk(options, error)
    if log is not None and not report:
        named = _site_to_name(options)
        more = "" if named is None else f" --site {quote(str(named))}"
        say(f"its report: tgl-soar report {quote(str(log))}{more}")
    if log is not None and options.survey:
        say(f"its contour: tgl-soar survey {quote(str(log))}")


def _site_to_name(options: SitlOptions) -> Path | None:
    """The site file, where a report must be given it: its air is in files that no log holds."""
    air = load_site(options.site).air
    return options.site if air is not None and air_files(air, options.site.parent) else None


def _draw(options: SitlOptions, flight: SitlFlight, path: Path) -> None:
    """The flight in the vertical plane, as it truly was.  Errors: ImportError."""
    from tgl_soar.analysis.logs.flight_data import FlightData, Series
    from tgl_soar.analysis.report.figure_style import drawing, save
    from tgl_soar.analysis.report.flight_report_figures import Surroundings, plane_figure
    from tgl_soar.analysis.report.legs import ReportLeg
    from tgl_soar.sim.world import ground_outline, site_field

    site = load_site(options.site)
    assert site.air is not None  # it was flown in
    truth = flight.truth
    until_s = flight.flown[-1].ended_s if flight.landing is None else flight.landing.time_s
    flying = truth["time_s"] <= (until_s if isfinite(until_s) else inf)
    columns = {name: truth[name][flying] for name in ("x_m", "y_m", "z_m")}
    legs = [
        ReportLeg(
            name=score.name,
            line=line,
            begin_s=flown.stopped_s,
            end_s=flown.ended_s,
            score=score,
            crossing=crossing,
            crossing_sigma_m=float("nan"),
        )
        for flown, line, score, crossing in zip(
            flight.flown, flight.lines, flight.scores, flight.crossings, strict=True
        )
    ]
    surroundings = Surroundings(
        field=site_field(site, options.site.parent, options.site),
        polar=load_airframe(options.airframe).polar.as_polar(),
        ground=ground_outline(site.air),
    )
    path_flown = Series(truth["time_s"][flying], columns, "truth.csv")
    with drawing() as plt:
        data = FlightData(path.name, "simulation", path=path_flown)
        save(plt, plane_figure(plt, data, legs, surroundings), path)


def _draw_map(options: SitlOptions, log: Path, path: Path) -> None:
    """How the lift map grew under the search.  Errors: ImportError, `LogError`."""
    from tgl_soar.analysis.logs.open_log import read_flight
    from tgl_soar.analysis.search.map_from_log import glimpses_of, map_figure
    from tgl_soar.control.search.glimpse import task_of
    from tgl_soar.onboard.setup import laws_of, setup_from
    from tgl_soar.sim.world import site_field

    airframe, site, values = load_flight(options.airframe, options.site)
    assert site.air is not None  # it was flown in
    flown = read_flight(log)
    modes = [mode for mode in flown.modes if mode.name in ("capturing", "searching", "soaring")]
    if not modes:
        return
    setup = setup_from(airframe, site, values)
    glimpses = glimpses_of(flown, modes[0].time_s, flown.duration_s)
    task = task_of(laws_of(setup, values))
    if map_figure(path, glimpses, task, site, site_field(site, options.site.parent, options.site)):
        say(f"how its map grew: {path}")
