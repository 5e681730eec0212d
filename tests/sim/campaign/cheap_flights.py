"""Flights that cost nothing, and a program that flies them and may be killed.

python cheap_flights.py FOLDER FLIGHTS WORKERS NAP_S
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path
from typing import NamedTuple

from tgl_soar.sim.campaign.executors import local
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import CampaignFolder


class CheapJob(NamedTuple):
    """One flight."""

    seed: int
    nap_s: float = 0.0
    deadly: str = ""  # a file: whoever finds it removes it and dies; "always": dies
    raises: bool = False


class CheapResult(NamedTuple):
    """What it came to."""

    value: float
    name: str


def fly_cheaply(job: CheapJob) -> CheapResult:
    """A draw that depends on the seed alone."""
    if job.raises:
        raise ArithmeticError(f"seed {job.seed}")
    if job.deadly == "always":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.deadly and Path(job.deadly).exists():
        Path(job.deadly).unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(job.nap_s)
    return CheapResult(random.Random(job.seed).gauss(0.0, 1.0), f"n{job.seed % 3}")


def cheap_jobs(count: int, nap_s: float = 0.0) -> list[CheapJob]:
    """So many, of seeds from 0 on."""
    return [CheapJob(seed, nap_s) for seed in range(count)]


def cheap_campaign(count: int, nap_s: float = 0.0) -> Campaign[CheapJob, CheapResult]:
    """They as a campaign; the nap changes no result."""
    return Campaign(
        name="cheap",
        fly=fly_cheaply,
        jobs=cheap_jobs(count, nap_s),
        parameters={"count": count},
        seeds=(0, count),
    )


def main() -> None:
    """Fly, and print how many flights are kept as it goes on."""
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # ignored where a shell started it as a job
    path, count, workers, nap_s = sys.argv[1:5]
    campaign = cheap_campaign(int(count), float(nap_s))
    with CampaignFolder(Path(path), campaign, resume=True) as folder:
        try:
            folder.fly(local(int(workers)), lambda p: print(p.flown, flush=True), size=5)
        except KeyboardInterrupt:
            print("stopped", folder.flown, flush=True)
            sys.exit(130)


if __name__ == "__main__":
    import cheap_flights  # the flight function has the name that it has in the tests

    cheap_flights.main()
