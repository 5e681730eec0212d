"""`airframes`: aircraft of any size, from a glide's log to the line, no number typed.

Twenty airframes are drawn (`drawn_airframes`).  Of each the module's side is given what can be read
off the bench: mass, size, inertia, the servo's time constant; the mean wind of the test flight; and
the command's latency, as `tgl-soar surfaces` measures it.  All else of the file is the shipped
airframe's, which is wrong:

    1. glide      a simulated test flight in an even wind, and the log that the module writes
    2. identify   as `tgl-soar identify --out` does: lift, moments, drag, polar, the servo's delay
    3. tune       as `tgl-soar tune --own` does, with fewer generations, and none flown to choose
    4. soar       the drawn aircraft, with the file that came of it, over a hill at 1 %

The hill is the shipped one; its wind is the first of `WINDS`, as fractions of the identified best
glide's speed, in which the contour has a place where the wind is `SPEED_RATIO` of it: an operator
waits for that day.  The angle of attack of the stall is not identified; the shipped one stands.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from math import degrees, inf, isfinite
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import asdict, replace

from tgl_soar.air.zeuc import ZeucError, stable_crossing
from tgl_soar.analysis.experiments.aircraft.drawn_airframes import (
    AirframeRanges,
    DrawnAirframe,
    drawn_airframe,
)
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import place_at_speed_ratio, search_bounds
from tgl_soar.analysis.identification import body_from, identify
from tgl_soar.analysis.identified_file import glided, with_identified
from tgl_soar.analysis.logs.flight_data import steered
from tgl_soar.analysis.logs.gliding import MeanWind, glides, longitudinal
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.tuning.aircraft import TICK_S, ranges_of_one
from tgl_soar.analysis.tuning.flights import START_M, DrawnFlight, fly_late, line_of
from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.analysis.tuning.result import airframe_with
from tgl_soar.analysis.tuning.tune import Effort, Task, Tuned, digest, tune
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    airframe_from,
    load_airframe,
    load_flight,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import HillAir, Site, Start
from tgl_soar.control.found_gains import INERTIAL, SETS
from tgl_soar.control.loop_margin import FLOOR
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.glide_test import fly, wind_of
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.world import build_field, make_world

COUNT: Final = 20
SEED: Final = 2026
TURBULENCE: Final = 0.01
RMS_M: Final = 0.02
DURATION_S: Final = 60.0
LEAN_DEG: Final = 15.0
WINDS: Final = (0.76, 0.80, 0.84, 0.88)
SPEED_RATIO: Final = 0.94
USUAL: Final = shipped("airframes/eclipson_c.toml")
HILL: Final = shipped("sites/hill.toml")
# A search of half a minute in the place of four: corners alone of the grid, a third of the drawn
# aircraft, a third of the generations.
EFFORT: Final = Effort(generations=12, aircraft=2, grid=2, choosing=0, judging=0, judging_linear=8)
QUICK_EFFORT: Final = EFFORT._replace(generations=1, aircraft=1, judging_linear=1)
_OF_ANOTHER_WING: Final = ("PITCH_TRIM", "PITCH_MIN", "PITCH_MAX")


class AirframeJob(NamedTuple):
    """One airframe."""

    seed: tuple[int, ...]
    effort: Effort = EFFORT


class BuiltAirframe(NamedTuple):
    """What came of one."""

    name: str
    failed: str  # the step that failed, and why; "": none
    frequency_error: float  # of the identified short period, of the true one
    effect_error: float
    sink_error: float  # of the polar at the place where it soars
    alpha: dict[str, float]  # by set of gains, on the demands of the search
    flights: dict[str, DrawnFlight]  # likewise
    duration_s: float

    @property
    def soars(self) -> bool:
        """Up to the end within `RMS_M`, with accelerometers and without."""
        kept = [each.up and each.rms_e_rho_m <= RMS_M for each in self.flights.values()]
        return not self.failed and len(kept) == len(SETS) and all(kept)


def bench_file(drawn: DrawnAirframe) -> str:
    """The shipped airframe file with what can be read off this aircraft's bench."""
    text = USUAL.read_text(encoding="utf-8")
    own = drawn.airframe
    numbers: dict[str, object] = dict(asdict(own.airframe))
    numbers["servo_lag_radps"] = own.model["servo_lag_radps"]
    for key, value in numbers.items():
        written = f'"{value}"' if isinstance(value, str) else f"{value:.6g}"
        text, count = re.subn(rf"(?m)^{key}\s*=.*$", f"{key} = {written}", text)
        assert count == 1, key
    for name in _OF_ANOTHER_WING:
        text, _ = re.subn(rf"(?m)^{name}\s*=.*\n", "", text)
    return f"{text.rstrip()}\n\n[dynamics]\ncommand_delay_s = {drawn.link_s:.6g}\n"


def glide_log(airframe: Airframe, seed: int, folder: Path) -> Path:
    """The log of a gliding test flight."""
    recorder = FlightRecorder(folder, LogMetadata({"sys_name": "tgl_soar"}, {}), 0.0, patient=True)
    recorder.start()
    recorder.parameters(ParameterSet())
    for tick in fly(airframe, seed=seed):
        recorder.tick(tick.inputs, tick.output, tick.state)
        recorder.poll()
    recorder.stop()
    assert recorder.path is not None
    return recorder.path


def identified(text: str, log: Path, wind: MeanWind) -> str:
    """The airframe file with what the log tells.  Errors: ValueError."""
    plane = airframe_from(text, "bench.toml")
    body = body_from(asdict(plane.airframe), plane.model)
    flight = steered(read_flight(log), plane.surfaces)
    found = identify(longitudinal(flight, wind), body)
    return with_identified(text, "bench.toml", found, glided(glides(flight, wind), body))


def site_for(airframe: Airframe) -> tuple[Site, tuple[float, float]]:
    """The hill on the day to soar this aircraft there, and the place.  Errors: `ZeucError`."""
    site = load_site(HILL)
    assert isinstance(site.air, HillAir)
    best = airframe.all_parameters()["DYN_BEST"]
    polar = airframe.polar.as_polar()
    for fraction in WINDS:
        air = replace(site.air, wind_mps=fraction * best)
        day = replace(site, air=air, contour=None)
        try:
            return day, place_at_speed_ratio(
                build_field(air), polar, search_bounds(day), SPEED_RATIO
            )
        except ZeucError as error:
            reason = error
    raise reason


def tuned_for(text: str, name: str, effort: Effort, folder: Path) -> tuple[str, Tuned]:
    """The airframe file with gains for it, and what they give.  Errors: ValueError."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    plane, _, values = load_flight(path, HILL)
    task = Task(
        airframe=plane,
        site_path=HILL,
        values=values,
        lean_deg=LEAN_DEG,
        effort=effort,
        ranges=ranges_of_one(plane, values["CMD_DELAY"]),
    )
    progress = ProgressFile(folder / f"{name}.progress", digest(task))
    found = tune(task, progress, lambda _words, _done: None, InLine())
    return airframe_with(text, found.parameters), found


def soar(drawn: DrawnAirframe, text: str, kind: str, seed: int, folder: Path) -> DrawnFlight:
    """The drawn aircraft on its line, flown with its file.  Errors: `ZeucError`, `ConfigError`."""
    path = folder / "flown.toml"
    path.write_text(text, encoding="utf-8")
    plane = load_airframe(path)
    site, (x_m, z_m) = site_for(plane)
    values = load_parameters(plane, path, site, HILL).changed(
        {
            "TGL_X": x_m,
            "TGL_Z": z_m,
            "TGL_LEAN": LEAN_DEG,
            "EST_IMU": 1.0 if kind == INERTIAL else 0.0,
        }
    )
    assert site.air is not None
    field = build_field(site.air)
    at = stable_crossing(field, drawn.airframe.polar.as_polar(), line_of(values))
    where = (x_m, z_m) if at is None else (at.x_m, at.z_m)
    world = make_world(
        drawn.airframe,
        replace(site, start=Start(x_m=where[0] + START_M, z_m=where[1])),
        seed=seed,
        turbulence=TURBULENCE,
        field=field,
        sensors=Sensors(imu=MEMS_IMU),
    )
    return fly_late(world, seed, values, drawn.link_s, DURATION_S)


def build_and_soar(job: AirframeJob) -> BuiltAirframe:
    """All four steps with one airframe."""
    drawn = drawn_airframe(load_airframe(USUAL), job.seed)
    drawn = drawn._replace(link_s=max(1, round(drawn.link_s / TICK_S)) * TICK_S)
    step, flights, alpha = "glide", dict[str, DrawnFlight](), dict[str, float]()
    errors = (inf, inf, inf)
    failed = ""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            log = glide_log(drawn.airframe, job.seed[-1], folder)
            step = "identify"
            wind = MeanWind(wind_of(drawn.airframe), 0.0)
            text = identified(bench_file(drawn), log, wind)
            errors = identified_errors(drawn.airframe, airframe_from(text, "identified.toml"))
            step = "tune"
            text, tuned = tuned_for(text, "identified.toml", job.effort, folder)
            alpha = {kind: tuned.after[kind].alpha for kind in SETS}
            step = "soar"
            for kind in SETS:
                flights[kind] = soar(drawn, text, kind, 1000 + job.seed[-1], folder)
        except (ValueError, OSError) as error:
            failed = f"{step}: {error}"
    return BuiltAirframe(
        name=drawn.airframe.airframe.name,
        failed=failed,
        frequency_error=errors[0],
        effect_error=errors[1],
        sink_error=errors[2],
        alpha=alpha,
        flights=flights,
        duration_s=sum(each.duration_s for each in flights.values()),
    )


def identified_errors(true: Airframe, found: Airframe) -> tuple[float, float, float]:
    """Of short period, elevator's effect at one speed, and sink where it soars; relative."""
    was, now = true.all_parameters(), found.all_parameters()
    speed = now["DYN_SPEED"] / was["DYN_SPEED"]
    place = SPEED_RATIO * was["DYN_BEST"]
    sinks = [
        p.c0 + place * (p.c1 + place * (p.c2 + place * p.c3)) for p in (true.polar, found.polar)
    ]
    return (
        now["DYN_FREQ"] / (was["DYN_FREQ"] * speed) - 1.0,
        now["DYN_EFFECT"] / (was["DYN_EFFECT"] * speed**2) - 1.0,
        sinks[1] / sinks[0] - 1.0,
    )


def airframes(context: Context) -> Result:
    """All of them."""
    effort = QUICK_EFFORT if context.quick else EFFORT
    jobs = [AirframeJob((SEED, i), effort) for i in range(2 if context.quick else COUNT)]
    built = context.flyer.each(build_and_soar, jobs, compiled=True)
    of = AirframeRanges()
    return Result(
        name="airframes",
        title="aircraft of any size, from a glide's log to the line",
        flown=f"{len(built)} airframes: span {of.span_m[0]:g} to {of.span_m[1]:g} m,"
        f" {of.loading_npm2[0]:g} to {of.loading_npm2[1]:g} N/m², commands"
        f" {1e3 * of.link_s[0]:g} to {1e3 * of.link_s[1]:g} ms late, servos of"
        f" {1e3 * of.servo_s[0]:g} to {1e3 * of.servo_s[1]:g} ms. Each glides in an even wind;"
        " what its log tells is identified, gains are tuned for that, and the aircraft soars over"
        f" the hill for {DURATION_S:g} s in {100 * TURBULENCE:g} % of turbulence, with the file"
        " that came of it. From the bench: mass, size, inertia, the servo's time constant, the"
        " latency.",
        claims=_claims(built),
        why="",
        tables=(
            Table(
                "",
                (
                    "airframe", "short period off by", "elevator's effect", "sink", "α without",
                    "α with", "e_rho without [cm]", "e_rho with accelerometers [cm]",
                    "y without, with [cm]", "bank without, with [°]", "ended",
                ),
                tuple(_row(each) for each in built),
            ),
        ),
        numbers={each.name: _numbers(each) for each in built},
        figures=(),
        scenarios=(),
        seeds=(SEED,),
    )  # fmt: skip


def _claims(built: list[BuiltAirframe]) -> tuple[Claim, ...]:
    soaring = sum(each.soars for each in built)
    alphas = [alpha for each in built for alpha in each.alpha.values()]
    least = min(alphas, default=0.0)
    return (
        Claim(
            f"every airframe soars within {100 * RMS_M:g} cm rms, with accelerometers and without",
            soaring == len(built),
            f"{soaring} of {len(built)}",
        ),
        Claim(
            f"every tuned loop keeps a disk margin of {FLOOR:g}",
            len(alphas) == len(SETS) * len(built) and least >= FLOOR,
            f"{least:.2f} at least",
        ),
    )


def _row(each: BuiltAirframe) -> tuple[str, ...]:
    ended = each.failed or ", ".join(
        dict.fromkeys(flight.ended for flight in each.flights.values() if flight.ended)
    )
    errors = (each.frequency_error, each.effect_error, each.sink_error)
    return (
        each.name,
        *(f"{100 * error:+.1f} %" if isfinite(error) else "–" for error in errors),
        *(f"{each.alpha[kind]:.2f}" if kind in each.alpha else "–" for kind in SETS),
        *(_rms_cm(each.flights, kind) for kind in SETS),
        _both([100.0 * flight.rms_y_m for flight in each.flights.values()], 0),
        _both([degrees(flight.rms_bank_rad) for flight in each.flights.values()], 1),
        ended or "–",
    )


def _rms_cm(flights: Mapping[str, DrawnFlight], kind: str) -> str:
    return f"{100 * flights[kind].rms_e_rho_m:.2f}" if kind in flights else "–"


def _both(values: Sequence[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values) or "–"


def _numbers(each: BuiltAirframe) -> dict[str, object]:
    flights = {kind: flight._asdict() for kind, flight in each.flights.items()}
    return {**each._asdict(), "flights": flights}
