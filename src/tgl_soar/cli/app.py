"""The commands of `tgl-soar` that do not fly, one file each: simulation, figures, reference."""

from __future__ import annotations

from typing import Annotated

import typer

from tgl_soar import __version__
from tgl_soar.cli import (
    align,
    campaign,
    compile,
    docs,
    experiment,
    glide,
    identify,
    init,
    log,
    margins,
    mocap,
    modes,
    params,
    polar,
    preflight,
    replay,
    report,
    site,
    site_init,
    sitl,
    surfaces,
    tune,
    zeuc,
)
from tgl_soar.cli.console import Commands
from tgl_soar.cli.page import command as page

app = Commands(
    help="An autopilot module that soars a slope on a target gradient line, over MAVLink.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"tgl-soar {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[  # its callback prints it
        bool,
        typer.Option("--version", help="Print the version.", callback=_version, is_eager=True),
    ] = False,
) -> None:
    """An autopilot module that soars a slope on a target gradient line, over MAVLink."""


@app.command(
    add_help_option=False,
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
)
def run() -> None:
    """Fly: read position and attitude, command the surfaces. `tgl-soar run --help` tells more."""
    raise AssertionError("tgl_soar.cli hands this on before it gets here")


app.command("init")(init.init)
app.command("docs")(docs.docs)
app.command("align")(align.align)
app.command("report")(report.report)
app.command("sitl")(sitl.sitl)
app.command("page")(page.page)
app.command("glide")(glide.glide)
app.command("identify")(identify.identify_command)
app.command("margins")(margins.margins)
app.command("tune")(tune.tune_command)
app.command("surfaces")(surfaces.surfaces)
app.command("preflight")(preflight.preflight)
app.command("zeuc")(zeuc.zeuc)
app.add_typer(log.log_app, name="log")
app.add_typer(mocap.mocap_app, name="mocap")
app.command("compile")(compile.compile_command)
app.command("modes")(modes.modes)
app.command("replay")(replay.replay)
app.add_typer(params.params_app, name="params")
app.add_typer(polar.polar_app, name="polar")
site.site_app.command("init")(site_init.site_init)
app.add_typer(site.site_app, name="site")
app.command("experiment")(experiment.experiment)
app.add_typer(campaign.campaign_app, name="campaign")
