"""`tgl-soar campaign rare`: the probability of losses that plain flights never show."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS, wilson
from tgl_soar.analysis.rare.checkpoint import PARTS, RareRequest, fly_kept
from tgl_soar.analysis.rare.soaring_process import SHOWN, SoaringCase, SoaringProcess
from tgl_soar.analysis.rare.splitting import (
    Ladder,
    Loss,
    RareEstimate,
    estimated,
    pooled_causes,
)
from tgl_soar.cli.batch_options import (
    ALL,
    NO_TABLE,
    Dispersion,
    Restart,
    Resume,
    Scheduler,
    Workers,
    executor_of,
    files_of,
    flight_bar,
    to_resume,
    warn_of_no_table,
)
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    console,
    errors,
    fail,
    hint,
    say,
    show,
)
from tgl_soar.config.files import ConfigError
from tgl_soar.config.parameters import ParameterError
from tgl_soar.config.site import air_files
from tgl_soar.sim.campaign import rows
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.encoding import digest
from tgl_soar.sim.campaign.executors import WorkerLost
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.provenance import files_digest, provenance
from tgl_soar.sim.campaign.run import Progress
from tgl_soar.sim.compiled import available

RESULT: Final = "rare.json"
KEPT: Final = "flights"  # of --out


def rare(
    turbulence: Annotated[float, typer.Option(help="Its intensity.", min=0.001, max=0.5)] = 0.03,
    seconds: Annotated[float, typer.Option(help="Flight time.", min=1.0, max=3600.0)] = 60.0,
    effort: Annotated[
        int, typer.Option(help="Trajectories at each level.", min=10, max=1_000_000)
    ] = 200,
    ladders: Annotated[int, typer.Option(help="Independent estimates.", min=2, max=1000)] = 5,
    plain: Annotated[
        int, typer.Option(help="Plain flights to compare with.", min=0, max=100_000_000)
    ] = 0,
    line: Annotated[str | None, typer.Option(help="Line; default: the site's own.")] = None,
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    site: Annotated[Path, typer.Option(help="Site to fly at.", **SITE_FILE)] = SITE,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 1,
    workers: Workers = ALL,
    scheduler: Scheduler = None,
    resume: Resume = False,
    restart: Restart = False,
    dispersion: Dispersion = False,
    out: Annotated[Path, typer.Option(help="Folder for the ladder and the losses.")] = Path(
        "out/rare"
    ),
) -> None:
    """Estimate by multilevel splitting how often a flight is lost; rank the causes.

    For comparison: plain flights (--plain), and Kramers' rate of falling out of the well.
    """
    if not available():
        fail("splitting needs compiled flights: pip install 'tgl_soar[fast]'")
    if (out / RESULT).exists() and not (restart or resume):
        fail(f"{out / RESULT}: an earlier run's; --restart overwrites it, or choose another --out")
    to_resume(out / KEPT, resume)
    executor = executor_of(workers, scheduler)
    warn_of_no_table(JOURNAL)
    try:
        case = case_of(airframe, site, line, turbulence, seconds)._replace(dispersed=dispersion)
        process = SoaringProcess(case)
        with flight_bar("pilot") as bar:

            def on_part(title: str, progress: Progress) -> None:
                bar.title(title)
                bar.show(*progress)

            flown = fly_kept(
                process,
                RareRequest(effort=effort, ladders=ladders, plain=plain, seed=seed),
                executor,
                out / KEPT,
                parameters=_manifest(case),
                resume=resume,
                restart=restart,
                on_part=on_part,
            )
    except (
        *(ConfigError, ParameterError, ClusterError, JournalError, WorkerLost, ValueError),
    ) as error:
        fail(error)
    except KeyboardInterrupt:
        fail(f"stopped: what was done is kept in {out / KEPT}; --resume goes on", 130)
    climbed, lost = flown.ladders, flown.lost
    found = estimated(climbed)
    _print(process, climbed, found, seconds)
    if plain:
        low, high = wilson(lost, plain)
        say(f"plain: {lost} of {plain} lost, {low:.3g} to {high:.3g} at 95 %")
    _write(out, process, climbed, found, (plain, lost))


def case_of(
    airframe: Path, site: Path, line: str | None, turbulence: float, seconds: float
) -> SoaringCase:
    """Of files.  Errors: ConfigError."""
    plane, place, values = files_of(airframe, site, line)
    if place.air is None:
        raise ConfigError(f"{site}: no [air] table, so there is no wind to fly in")
    return SoaringCase(
        airframe=plane,
        site=place,
        values=values,
        sensors=SENSORS[EVERY_SENSOR],
        turbulence=turbulence,
        duration_s=seconds,
        folder=site.parent,
    )


def _manifest(case: SoaringCase) -> dict[str, Any]:
    """All that its flights depend on."""
    assert case.site.air is not None
    return {
        "turbulence": case.turbulence,
        "duration_s": case.duration_s,
        "dispersed": case.dispersed,
        "airframe": digest(case.airframe),
        "site": digest(case.site),
        "air": files_digest(air_files(case.site.air, case.folder or Path())),
        "autopilot": digest(case.values),
        "sensors": digest(case.sensors),
    }


def _print(
    process: SoaringProcess, climbed: Sequence[Ladder], found: RareEstimate, seconds: float
) -> None:
    table = Table("margin", "tried", "passed", "share")
    for rung in range(max(len(ladder.rungs) for ladder in climbed)):
        there = [ladder.rungs[rung] for ladder in climbed if rung < len(ladder.rungs)]
        tried, passed = sum(r.tried for r in there), sum(r.passed for r in there)
        table.add_row(f"{there[0].level:.3f}", str(tried), str(passed), f"{passed / tried:.3f}")
    show(table)
    each = ", ".join(f"{ladder.probability:.2g}" for ladder in climbed)
    console.print(f"ladders: {each}", highlight=False)
    minute = 60.0 / seconds
    say(
        f"lost within {seconds:g} s: {found.probability:.3g}, {found.low:.3g} to {found.high:.3g}"
        f" at 95 %; a minute: {found.probability * minute:.3g};"
        f" by {found.trajectories} trajectories"
    )
    for end, name in zip(process.exits, ("below", "above"), strict=True):
        rim = (
            "a rim of the air" if end.smooth else "cut off by ground, fence or the end of the polar"
        )
        say(
            f"Kramers, {name}: {60.0 * end.rate_per_s:.2g} a minute"
            f" ({end.s_m:+.2f} m along the line, {rim})"
        )
    for cause in pooled_causes(climbed):
        say(f"{100.0 * cause.fraction:6.2f} %  {cause.text} ({cause.losses} losses)")


def _write(
    out: Path,
    process: SoaringProcess,
    climbed: Sequence[Ladder],
    found: RareEstimate,
    plain: tuple[int, int],
) -> None:
    losses = [loss for ladder in climbed for loss in ladder.losses]
    content: dict[str, Any] = {
        "turbulence": process.case.turbulence,
        "seconds": process.case.duration_s,
        "dispersed": process.case.dispersed,
        "provenance": provenance(),
        "manifests": [str(Path(KEPT) / part / MANIFEST) for part in PARTS],  # seeds, runs
        "estimate": found._asdict(),
        "plain": {"flights": plain[0], "lost": plain[1]},
        "kramers": [end._asdict() for end in process.exits],
        "ladders": [[rung._asdict() for rung in ladder.rungs] for ladder in climbed],
        "causes": [cause._asdict() for cause in pooled_causes(climbed)],
        "last_seconds": {
            "columns": SHOWN,
            "losses": [
                _last(number, ladder.weight, loss)
                for number, ladder in enumerate(climbed)
                for loss in ladder.losses
            ],
        },
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / RESULT).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        fail(f"{out}: cannot be written: {error.strerror}")
    _draw(out / "rare.png", climbed, losses)
    say(f"numbers and the last seconds of every loss in {out}/")
    if not rows.available():
        hint(f"ladders and plain flights in {out / KEPT}, {NO_TABLE}")


def _last(ladder: int, weight: float, loss: Loss) -> dict[str, Any]:
    rows = loss.last.round(4).tolist()
    return {"ladder": ladder, "weight": weight, "cause": loss.cause, "rows": rows}


def _draw(path: Path, climbed: Sequence[Ladder], losses: Sequence[Loss]) -> None:
    from tgl_soar.analysis.report.rare_figure import rare_figure

    causes, last = [loss.cause for loss in losses], [loss.last for loss in losses]
    try:
        rare_figure(path, [ladder.rungs for ladder in climbed], causes, last)
    except ImportError as error:
        errors.print(f"no figure: {error}", highlight=False, markup=False)
