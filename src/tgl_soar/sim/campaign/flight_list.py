"""A campaign: a list of flights, each a pure function of its job.

A flight's result depends on its job alone: on no other flight, no clock, no order, and not on who
flies it.  So flights may be divided into shards in any way, flown again where a worker was lost,
and put together by their number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

Job = TypeVar("Job")
Flown = TypeVar("Flown")

# So many shards a worker, that no worker is left with the last long flights alone; and no more
# flights in one than are soon flown again where a worker is lost.
SHARDS_PER_WORKER: Final = 16
SHARD_MOST: Final = 1000


class Shard(NamedTuple):
    """Flights that are flown one after the other by one worker."""

    first: int  # number of its first flight
    jobs: Sequence[Any]

    @property
    def numbers(self) -> str:
        """For a message."""
        last = self.first + len(self.jobs) - 1
        return f"flight {last}" if len(self.jobs) == 1 else f"flights {self.first} to {last}"


@dataclass(frozen=True)
class Campaign(Generic[Job, Flown]):
    """What is to be flown."""

    name: str
    fly: Callable[[Job], Flown]  # pure; of a module, that other machines find it too
    jobs: Sequence[Job]  # they may be made when they are asked for: a slice at a time
    # All that the jobs depend on, as a manifest shows it: numbers and texts.
    parameters: Mapping[str, Any] = field(default_factory=dict)
    seeds: tuple[int, int] | None = None  # the least and the greatest


def shard_size(count: int, workers: int) -> int:
    """How many of `count` flights make a shard."""
    return max(1, min(SHARD_MOST, count // (SHARDS_PER_WORKER * max(1, workers))))


def shards(jobs: Sequence[Any], missing: Iterable[range], size: int) -> Iterator[Shard]:
    """The flights that are missing, in order, at most `size` together."""
    for gap in missing:
        for first in range(gap.start, gap.stop, size):
            yield Shard(first, jobs[first : min(first + size, gap.stop)])
