"""A frame of every tick through our codec, beside pymavlink and beside MAVLink's C library.

All do the same work: find the frame, check it, read its fields; or fill in the fields, number and
check the frame.  The three take turns in small batches, C in a process of its own that answers to
a byte, and of each the quickest batch counts: what else the machine does can only slow one down.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from time import perf_counter_ns

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import RcChannelsOverride, Source
from tgl_soar.link.signing import Signing

from . import c_reference
from .c_reference import NoCompilerError
from .lengths import length
from .result import Result

ROUNDS, BATCH = 200, 50
C_BATCH = 2000  # as long as a batch of ours, about
FASTER = 6.0  # than pymavlink
SLOWER = 5.0  # than C
CHANNELS = (1500, 1510, 1490, 1500, *(65535,) * 4, *(0,) * 10)

FRAMES = (
    ("ATTITUDE_QUATERNION", mavlink.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 1, 2, 3)),
    ("RAW_IMU", mavlink.MAVLink_raw_imu_message(1000, 1, 2, -1000, 4, 5, 6, 7, 8, 9)),
    ("LOCAL_POSITION_NED", mavlink.MAVLink_local_position_ned_message(1, 1, 2, 3, 4, 5, 6)),
    ("SERVO_OUTPUT_RAW", mavlink.MAVLink_servo_output_raw_message(1, 0, *range(1500, 1508))),
    (
        "ODOMETRY",
        mavlink.MAVLink_odometry_message(
            *(1000, 1, 12, 1, 2, 3, [1, 0, 0, 0], 4, 5, 6, 7, 8, 9), [1.0] * 21, [2.0] * 21
        ),
    ),
)


def codec() -> Iterator[Result]:
    """Each hot frame read, then the override written, unsigned and signed."""
    for name, message in FRAMES:
        frame = bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
        ours, theirs = Decoder(stream=False), mavlink.MAVLink(None)
        yield from _compared(
            f"reading {name}",
            lambda frame=frame, ours=ours: ours.feed(frame),  # type: ignore[misc]
            lambda frame=frame, theirs=theirs: theirs.parse_buffer(frame),  # type: ignore[misc]
            frame.hex(),
        )
    encoder, theirs = Encoder(Source(255, 191)), mavlink.MAVLink(None, 255, 191)
    yield from _compared(
        "writing RC_CHANNELS_OVERRIDE",
        lambda: encoder.encode(RcChannelsOverride(1, 1, CHANNELS)),
        lambda: mavlink.MAVLink_rc_channels_override_message(1, 1, *CHANNELS).pack(theirs),
        "pack",
    )
    signing = Signing(bytes(range(32)), 1.8e9, 0.0)
    signer = Encoder(Source(255, 191), signing)
    signed = mavlink.MAVLink(None, 255, 191)
    signed.signing.secret_key, signed.signing.sign_outgoing = bytes(range(32)), True
    ours_ns, theirs_ns = _quickest(
        _timed(lambda: signer.encode(RcChannelsOverride(1, 1, CHANNELS))),
        _timed(lambda: mavlink.MAVLink_rc_channels_override_message(1, 1, *CHANNELS).pack(signed)),
    )
    yield Result(
        what="the same, signed",
        value=ours_ns / 1e3,
        reference=theirs_ns / 1e3,
        unit="µs",
        reference_what="pymavlink",
    )


BENCHMARKS = (codec,)


def _compared(
    what: str, ours: Callable[[], object], theirs: Callable[[], object], of_c: str
) -> Iterator[Result]:
    """`of_c`: the frame in hex, or what else the C program is to do."""
    batches = [_timed(ours), _timed(theirs)]
    with ExitStack() as stack:
        try:
            batches.append(stack.enter_context(in_c(of_c)))
        except NoCompilerError as error:
            print(error)
        ours_ns, theirs_ns, *c_ns = _quickest(*batches)
    yield Result(
        what=what,
        value=ours_ns / 1e3,
        reference=theirs_ns / 1e3,
        unit="µs",
        reference_what="pymavlink",
        aim=1.0 / FASTER,
    )
    for ns in c_ns:
        yield Result(
            what=what,
            value=ours_ns / 1e3,
            reference=ns / 1e3,
            unit="µs",
            reference_what="MAVLink's C library",
            aim=SLOWER,
        )


@contextmanager
def in_c(task: str, batch: int = C_BATCH) -> Iterator[Callable[[], float]]:
    """A process that makes a batch when it is called; ns of one frame.  Errors: NoCompilerError."""
    program = c_reference.program("codec")
    with subprocess.Popen(
        [program, str(batch), task], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
    ) as process:
        asked, answers = process.stdin, process.stdout
        assert asked is not None
        assert answers is not None

        def one_batch() -> float:
            asked.write(b".")
            return float(answers.readline())

        try:
            yield one_batch
        finally:
            asked.close()


def _quickest(*batches: Callable[[], float]) -> list[float]:
    """ns of one call of each, taking turns."""
    best = [float("inf")] * len(batches)
    for _ in range(length(ROUNDS)):
        for i, batch in enumerate(batches):
            best[i] = min(best[i], batch())
    return best


def _timed(call: Callable[[], object]) -> Callable[[], float]:
    """A batch of calls; ns of one, the quickest calling of nothing left out."""

    def batch() -> float:
        return _batch_ns(call) - _calling_ns()

    return batch


def _batch_ns(call: Callable[[], object]) -> float:
    begun = perf_counter_ns()
    for _ in range(BATCH):
        call()
    return (perf_counter_ns() - begun) / BATCH


@cache
def _calling_ns() -> float:
    return min(_batch_ns(_nothing) for _ in range(ROUNDS))


def _nothing() -> None:
    return None
