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
    heard = {type(r.message).__name__ for frame in frames for r in decoder.feed(frame)}
    assert {"AttitudeQuaternion", "ParamSet", "CommandLong", "Odometry", "SetupSigning"} <= heard
    counters = decoder.counters
    assert counters.bad_checksums > 100
    assert counters.skipped_bytes > 1000
    assert {frame[0] for frame in frames if frame} >= {0xFD, 0xFE}


LONG = (pytest.mark.long, pytest.mark.ci)


@pytest.mark.parametrize("frames", [8_000, pytest.param(30_000, marks=LONG)])
def test_nothing_that_arrives_raises_sets_anything_or_ends_the_flight(frames: int) -> None:
    fired = fire(frames)
    assert not fired.changed
    assert fired.still_flying


@pytest.mark.parametrize("frames", [3_000, pytest.param(8_000, marks=LONG)])
def test_what_arrives_leaves_no_memory_behind(frames: int) -> None:
    """A tenth of it is spent before memory is looked at; what grows later would grow for ever."""
    fired = fire(frames, trace=True)
    assert fired.grown_bytes < 12 * frames
    assert fired.still_flying
