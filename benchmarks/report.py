"""The report of a long flight: its log, read and turned into a page."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.autopilot import initial_state, step
from tgl_soar.cli.report import Named, write
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.laws import laws_from
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.sim.world import make_world
from tgl_soar.types import AutopilotStatus, Inputs, SurfaceCommand

from .result import ALLOWED, Result

FLIGHT_S = 600.0
ALLOWED_S = 15.0  # for its page
FLOWN_S = 30.0  # of it; the rest is the last of these seconds again and again


def _logged(folder: Path) -> Path:
    """The log of a flight of ten minutes in the tunnel."""
    airframe_file, site_file = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_file), load_site(site_file)
    values = load_parameters(airframe, airframe_file, site, site_file)
    world = make_world(airframe, site, seed=1, turbulence=0.03)
    laws, state = laws_from(values, world.frame), initial_state()
    command = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    texts = {"airframe": airframe_file.read_text(), "site": site_file.read_text()}
    words = {"sys_name": "tgl_soar", "ver_log": "1"}
    recorder = FlightRecorder(folder, LogMetadata(words, texts), 0.0, patient=True)
    recorder.start()
    recorder.parameters(values)
    recorder.reset(state)
    world.held = True
    ticks = []
    for _ in range(round(FLOWN_S * world.step_hz)):
        now = world.time_s
        status = AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True)
        inputs = Inputs(
            time_s=now,
            position=world.position,
            attitude=world.attitude,
            autopilot=status,
            engage=now > 0.3,
        )
        state, output = step(laws, state, inputs)
        if output.active:
            command, world.held = output.command, False
        world.step(command)
        ticks.append((inputs, output, state))
    settled = ticks[len(ticks) // 2 :]
    for k in range(round(FLIGHT_S * world.step_hz)):
        of = ticks[k] if k < len(ticks) else settled[k % len(settled)]
        now = k / world.step_hz
        inputs, output, state = of
        recorder.tick(inputs._replace(time_s=now), output._replace(time_s=now), state)
        recorder.poll()
    recorder.stop()
    (path,) = folder.rglob("*.ulg")
    return path


def page_of_ten_minutes() -> Iterator[Result]:
    """Reading, legs, spectra, figures, page; beside reading the log alone."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = _logged(folder)
        before = perf_counter()
        read_log(log)
        read_s = perf_counter() - before
        before = perf_counter()
        write(log, folder / "page.html", Named(), lambda _words: None)
        page_s = perf_counter() - before
    yield Result(
        what=f"report of a flight of {FLIGHT_S:g} s",
        value=page_s,
        reference=read_s,
        unit="s",
        reference_what="reading its log alone",
    )
    yield Result(
        what=f"report of a flight of {FLIGHT_S:g} s",
        value=page_s,
        reference=ALLOWED_S,
        unit="s",
        reference_what=ALLOWED,
        aim=1.0,
    )
    yield Result(
        what="report: seconds flown in a second",
        value=FLIGHT_S / page_s,
        reference=1.0,
        unit="s/s",
        reference_what="real time",
    )


BENCHMARKS = (page_of_ten_minutes,)
