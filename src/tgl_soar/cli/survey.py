"""`tgl-soar survey`: the contour of a place, as a survey has drawn it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import AIRFRAME_FILE, SITE_FILE, fail, hint, say
from tgl_soar.cli.contour_file import write_contour
from tgl_soar.cli.log_argument import airframe_of
from tgl_soar.cli.site import contour_table
from tgl_soar.config.files import ConfigError

if TYPE_CHECKING:
    from tgl_soar.analysis.survey.contour_fit import DrawnContour


def survey(
    log: Annotated[
        Path, typer.Argument(help="The module's flight log, or another log of that flight.")
    ],
    into: Annotated[
        Path | None,
        typer.Option(
            help="Site file into which \\[contour] is written. Default: print it.", **SITE_FILE
        ),
    ] = None,
    airframe: Annotated[
        Path | None,
        typer.Option(help="Airframe file. Default: that of the module's log.", **AIRFRAME_FILE),
    ] = None,
    number: Annotated[
        int, typer.Option(min=0, help="Number of the survey in the flight, from 1; 0: the last.")
    ] = 0,
) -> None:
    """Draw the contour that a survey has flown, as the \\[contour] table of a site file.

    Nothing else of the site file is changed. Exit code 2: the log has no survey to draw it from.
    """
    from tgl_soar.analysis.logs.open_log import read_flight
    from tgl_soar.analysis.survey.contour_fit import SurveyError, drawn_contour
    from tgl_soar.analysis.survey.surveys_from_log import surveys_of

    try:
        flight = read_flight(log)
        plane, _, _ = airframe_of(flight, airframe, log)
        surveys = surveys_of(flight)
        if number > len(surveys):
            raise SurveyError(f"--number {number}: the flight has surveys 1 to {len(surveys)}")
        drawn = drawn_contour(surveys[number - 1])
        text = _table(drawn, plane.airframe.name, log)
        if into is not None:
            write_contour(into, text)
    except SurveyError as error:
        fail(f"{log}: {error}")
    except (LogError, ConfigError, ImportError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or into}: cannot be written: {error.strerror}")
    words = (
        f"{drawn.length_m:.2f} m of contour, ± {100.0 * float(np.median(drawn.sigma_m)):.1f} cm"
        f" along the line, at its ends ± {100.0 * float(drawn.sigma_m[[0, -1]].max()):.1f} cm"
    )
    if into is None:
        print(text, end="")
        hint(words)
    else:
        say(f"{into}: {words}")


def _table(drawn: DrawnContour, airframe: str, log: Path) -> str:
    comment = (
        "# Where updraft equals sink, rising air on the left, as a survey has drawn it"
        f"\n# (`tgl-soar survey {log.name}`). A line that does not cross it is refused."
    )
    points = list(zip(drawn.x_m.tolist(), drawn.z_m.tolist(), strict=True))
    return contour_table(comment, airframe, [points])
