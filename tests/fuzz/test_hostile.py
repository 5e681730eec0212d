"""The whole module in flight under hostile frames.

`python -m benchmarks.hostile --frames 1000000` is the long version, with times.
"""

from __future__ import annotations

from itertools import islice
from random import Random

import pytest
from benchmarks.hostile import Flown, fire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.sim.hostile import RECEIVED_NAMES, HostileFrames, hostile_message


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


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=LONG) for seed in range(2, 12))])
def test_no_number_of_the_autopilot_itself_or_of_an_operator_raises_or_leaves_the_envelope(
    seed: int,
) -> None:
    """Whole frames of all kinds that the module reads, of those that it listens to, with any
    numbers: they may end the flight, in order."""
    random = Random(seed)
    flown = Flown()
    senders = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
    flying = 0
    for _ in range(300):
        for _ in range(random.randrange(3)):
            message = hostile_message(random, random.choice(RECEIVED_NAMES))
            flown.onboard.event(bytes(message.pack(random.choice(senders))), flown.now_s)
        flown.tick()
        output = flown.onboard.output
        assert output is not None
        assert all(abs(value) <= 1.0 for value in output.command)  # NaN: not <= 1
        flying += output.active
    assert flying
