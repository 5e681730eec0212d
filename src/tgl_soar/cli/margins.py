"""`tgl-soar margins`: what the loops can bear, over speed, lean and latency."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import track
from rich.table import Table

from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    console,
    errors,
    fail,
    say,
)
from tgl_soar.config.files import ConfigError, check_simulated, load_flight
from tgl_soar.config.parameters import ParameterError
from tgl_soar.onboard.setup import flavour_of
from tgl_soar.types import OURS

if TYPE_CHECKING:
    from tgl_soar.analysis.margins import CaseMargins


def margins(
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    site: Annotated[Path, typer.Option(help="Site file.", **SITE_FILE)] = SITE,
    speed: Annotated[
        list[float] | None, typer.Option(help="Airspeed \\[m/s]; repeatable.", min=1)
    ] = None,
    lean: Annotated[
        list[float] | None, typer.Option(help="Lean of the line \\[degrees]; repeatable.")
    ] = None,
    delay: Annotated[
        list[float] | None,
        typer.Option(help="Delay from tick to servo \\[ms]; repeatable.", min=0.0, max=200.0),
    ] = None,
    turbulence: Annotated[
        float,
        typer.Option(help="Intensity of turbulence, a fraction of the wind.", min=0.0, max=0.2),
    ] = 0.03,
    floor: Annotated[float, typer.Option(help="Least disk margin.", min=0.0, max=2.0)] = 0.5,
    out: Annotated[Path | None, typer.Option(help="Figure to write, PNG or SVG.")] = None,
) -> None:
    """Compute margins of the scheduled gains, and e_rho and elevator activity in turbulence.

    Disk, gain, phase and delay margins by the linear model of the airframe, at elevator, line,
    aileron and rudder. Exit code 1: one is below the floor.
    """
    from tgl_soar.analysis import margins as found
    from tgl_soar.analysis.linear_plant import Gusts

    if out is not None:
        _check_figure(out)
    try:
        plane, _, values = load_flight(airframe, site)
        check_simulated(airframe, plane)
        is_ours = flavour_of(plane).route.loops == OURS
        best = values["DYN_BEST"]
        cases = found.grid(
            values,
            speed or [round(fraction * best, 1) for fraction in (0.9, 1.0, 1.3)],
            lean or [values["TGL_LEAN"]],
            [ms / 1e3 for ms in delay] if delay else [values["CMD_DELAY"]],
        )
        gusts = Gusts(turbulence, best)
        each = track(
            found.case_margins(plane, values, cases, gusts),
            "linearising",
            total=len(cases),
            console=errors,
            transient=True,
        )
        rows = list(each)
    except (ConfigError, ParameterError, ValueError) as error:
        fail(error)
    console.print(_table(rows, floor))
    if not is_ours:
        say("these are our loops: on this route the firmware's hold the attitude instead")
    least = found.worst(rows)
    case = least.case
    say(
        f"worst: {least.alpha:.2f} at {case.speed_mps:g} m/s, lean {case.lean_deg:g} deg,"
        f" {1e3 * case.delay_s:.3g} ms, with{'' if case.inertial else 'out'} accelerometers"
    )
    if out is not None:
        try:
            found.margins_figure(out, rows, floor, plane.airframe.name)
        except ImportError:
            fail("no figure: figures need matplotlib: pip install 'tgl_soar[figures]'")
        except ValueError as error:
            fail(f"no figure: {error}")
        except OSError as error:
            fail(f"no figure: {out}: {error.strerror}")
        say(f"figure in {out}")
    if least.alpha < floor:
        fail(f"a margin below {floor:g}: measure the airframe, or make the link faster", 1)


def _check_figure(out: Path) -> None:
    """Before anything is computed, whether a figure can be written there."""
    if out.suffix.lower() not in (".png", ".svg") or out.is_dir():
        fail(f"--out {out}: name a file that ends in .png or .svg")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {out}: cannot be written: {error.strerror}")


def _table(rows: list[CaseMargins], floor: float) -> Table:
    from tgl_soar.analysis.margins import least_delay_s, least_gain_db, least_phase_deg

    table = Table(
        *("sensors", "late\nms", "lean\ndeg", "speed\nm/s", "α\nelev.", "α\nline"),
        *("α\nail.", "α\nrud."),
        *("gain\ndB", "phase\ndeg", "later\nms", "e_rho\ncm", "elev.\n"),
        box=None,
        padding=(0, 1, 0, 0),  # 80 columns carry it
        caption="α: disk margins at elevator, line, aileron and rudder; the least gain, phase and"
        " delay that are left; rms in gusts",
    )
    for row in rows:
        case = row.case
        table.add_row(
            "imu" if case.inertial else "fixes",
            f"{1e3 * case.delay_s:.3g}",
            f"{case.lean_deg:g}",
            f"{case.speed_mps:g}",
            f"{row.elevator.alpha:.2f}",
            f"{row.line.alpha:.2f}",
            f"{row.aileron.alpha:.2f}",
            f"{row.rudder.alpha:.2f}",
            f"{least_gain_db(row):.1f}",
            f"{least_phase_deg(row):.0f}",
            f"{1e3 * least_delay_s(row):.0f}",
            f"{100.0 * row.e_rho_m:.2f}",
            f"{row.activity:.3f}",
            style="red" if row.alpha < floor else None,
        )
    return table
