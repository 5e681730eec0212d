"""The whole module in flight under frames that nobody should send.

`python -m benchmarks.hostile --frames 1000000` is the long version, with times.
"""

from __future__ import annotations

from itertools import islice

import pytest
from benchmarks.hostile import fire

from tgl_soar.link.decoder import Decoder
from tgl_soar.sim.hostile import HostileFrames


def test_the_supply_repeats_and_every_sort_of_frame_is_in_it() -> None:
    frames = list(islice(HostileFrames(1), 4000))
    assert frames == list(islice(HostileFrames(1), 4000))
    assert frames != list(islice(HostileFrames(2), 4000))
    decoder = Decoder(stream=False)
    received = {type(r.message).__name__ for frame in frames for r in decoder.feed(frame)}
    assert {"AttitudeQuaternion", "ParamSet", "CommandLong", "Odometry", "SetupSigning"} <= received
    counters = decoder.counters
    assert counters.bad_checksums > 100
    assert counters.skipped_bytes > 1000
    assert {frame[0] for frame in frames if frame} >= {0xFD, 0xFE}


LONG = pytest.mark.long


@pytest.mark.parametrize("frames", [8_000, pytest.param(30_000, marks=LONG)])
def test_nothing_that_arrives_raises_sets_anything_or_ends_the_flight(frames: int) -> None:
    fired = fire(frames)
    assert not fired.changed
    assert fired.still_flying
    assert fired.refused > frames // 10  # counted: cut, unknown, undecodable, a stranger's


def test_what_arrives_leaves_no_memory_behind() -> None:
    """A tenth of it is spent before memory is looked at; what grows later would grow for ever."""
    fired = fire(8_000, trace=True)
    assert not fired.changed
    assert fired.still_flying
    assert fired.grown_bytes < 96 * 1024
