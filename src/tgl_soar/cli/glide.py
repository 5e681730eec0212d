"""`tgl-soar glide`: a simulated gliding test flight, and its log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, console, fail
from tgl_soar.config.files import ConfigError, check_simulated, load_airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder


def glide(
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise and errors.", min=0)] = 1,
    turbulence: Annotated[
        float, typer.Option(help="Turbulence, a fraction of the wind.", min=0.0, max=0.2)
    ] = 0.0,
    pitot: Annotated[bool, typer.Option("--pitot", help="With a pitot tube.")] = False,
    brake: Annotated[
        list[float] | None,
        typer.Option(help="Position of the brake, 0 to 1, for glides at all speeds; repeatable."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the log.")] = Path("out/glide"),
) -> None:
    """Glide at ten speeds and fly eight elevator doublets, in a simulated uniform wind.

    `tgl-soar polar fit` and `tgl-soar identify` read the log.
    """
    from tgl_soar.sim.glide_test import fly, wind_of

    try:
        plane = load_airframe(airframe)
        check_simulated(airframe, plane)
        texts = {"airframe": airframe.read_text(encoding="utf-8")}
    except (ConfigError, OSError) as error:
        fail(error)
    brakes = tuple(brake or (0.0,))
    if any(not 0.0 <= b <= 1.0 for b in brakes):
        fail(f"--brake {' '.join(map(str, brakes))}: each must be from 0 to 1")
    if max(brakes) > 0.0 and plane.surfaces.brake is None:
        fail(f"--brake: {airframe} has no brake: [surfaces] flap, spoiler, or two ailerons")
    words = {
        "sys_name": "tgl_soar",
        "ver_log": str(VERSION),
        "flight": f"simulated glide, seed {seed}",
        "airframe_file": str(airframe),
    }
    recorder = FlightRecorder(out, LogMetadata(words, texts), 0.0, patient=True)
    recorder.start()
    recorder.parameters(ParameterSet())
    for tick in fly(plane, seed=seed, turbulence=turbulence, pitot=pitot, brakes=brakes):
        recorder.tick(tick.inputs, tick.output, tick.state)
        for text in recorder.poll():
            console.print(text, highlight=False, soft_wrap=True)
    for text in recorder.stop():
        console.print(text, highlight=False, soft_wrap=True)
    if recorder.path is None:
        fail(f"--out {out}: no log could be written")
    console.print(f"the wind was {wind_of(plane):g} m/s from north, the same everywhere")
