"""A run of splitting whose parts are kept as they are done, so that a run that is stopped is gone
on with.

pilot/      the levels
ladders/    each ladder, a row of rows.parquet: its levels and its losses
plain/      how many were lost of each batch of plain flights, a row
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from tgl_soar.analysis.rare.splitting import Ladder, Process, climb, pilot_levels, plain_seeds
from tgl_soar.sim.campaign.executors import Executor, InLine
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import CampaignFolder
from tgl_soar.sim.campaign.run import Progress, fly_all

# So many are flown again at most where a run is stopped: minutes; and to begin a batch takes less
# than a second.
BATCH: Final = 5000
PILOT, LADDERS, PLAIN = PARTS = ("pilot", "ladders", "plain")  # folders, each with a manifest


class RareRequest(NamedTuple):
    """What is to be flown."""

    effort: int  # trajectories at each level
    ladders: int
    plain: int  # flights beside them
    seed: int


class RareRun(NamedTuple):
    """What came of it."""

    levels: tuple[float, ...]
    ladders: tuple[Ladder, ...]
    lost: int  # of the plain flights


class PlainBatch(NamedTuple):
    """Plain flights that are flown, and counted, together."""

    first_seed: int
    flights: int


class _Lost(NamedTuple):
    lost: int


OnPart = Callable[[str, Progress], None]


def fly_kept(
    process: Process,
    request: RareRequest,
    executor: Executor,
    folder: Path,
    *,
    parameters: dict[str, Any],
    resume: bool = False,
    restart: bool = False,
    on_part: OnPart = lambda _title, _progress: None,
) -> RareRun:
    """Fly what is missing.

    parameters: all that the process depends on, as a manifest shows it.
    Errors: those of `CampaignFolder` and of `sim.campaign.run`; ValueError of the pilot.
    """

    def pilot(_: int) -> tuple[float, ...]:
        return pilot_levels(process, request.effort, request.seed, executor)

    def ladder(number: int) -> Ladder:
        return climb(process, levels, request.effort, request.seed, executor, ladder=number)

    def batch(of: PlainBatch) -> _Lost:
        those = range(of.first_seed, of.first_seed + of.flights)
        return _Lost(sum(fly_all(partial(is_lost, process), those, executor)))

    seeds = plain_seeds(request.plain, request.seed)
    asked = {**parameters, **request._asdict()}
    with ExitStack() as opened:

        def part(name: str, fly: Callable[[Any], Any], jobs: Sequence[Any]) -> Any:
            campaign = Campaign(name=f"rare {name}", fly=fly, jobs=jobs, parameters=asked)
            kept = CampaignFolder(folder / name, campaign, resume=resume, restart=restart)
            return opened.enter_context(kept)

        def flown(title: str, kept: Any) -> list[Any]:
            # In this process: what flies many trajectories at once is within.
            kept.fly(InLine(), partial(on_part, title), size=1)
            return list(kept)

        batches = [
            PlainBatch(seeds[n], min(BATCH, len(seeds) - n)) for n in range(0, len(seeds), BATCH)
        ]
        # All are opened before any is flown: what may not be gone on with is refused at once.
        to_pilot = part(PILOT, pilot, [0])
        to_climb = part(LADDERS, ladder, range(request.ladders))
        to_fly = part(PLAIN, batch, batches)
        (levels,) = flown("pilot", to_pilot)
        ladders = flown("ladders", to_climb)
        lost = sum(each.lost for each in flown("plain flights", to_fly))
        for each in (to_climb, to_fly):
            each.tabulate()
        for each in (to_pilot, to_climb, to_fly):
            each.conclude(keep=True)  # the last seconds of losses are in no table
    return RareRun(levels, tuple(ladders), lost)


def is_lost(process: Process, seed: int) -> bool:
    """Whether a plain flight of this seed is."""
    return process.passage(process.begun(seed), seed, 0.0).state is not None
