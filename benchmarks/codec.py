"""A frame of every tick through our codec, beside pymavlink and beside MAVLink's C library.

All do the same work: find the frame, check it, read its fields; or fill in the fields, number and
check the frame.  The three take turns in small batches, and of each the quickest batch counts:
what else the machine does can only slow one down.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from time import perf_counter_ns

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import RcChannelsOverride, Source
from tgl_soar.link.signing import Signing

from . import c_reference
from .c_reference import NoCompilerError
from .result import Result

ROUNDS, BATCH = 200, 50
C_ROUNDS, C_BATCH = 10, 20_000
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
            [str(C_BATCH)],
            frame,
        )
    encoder, theirs = Encoder(Source(255, 191)), mavlink.MAVLink(None, 255, 191)
    yield from _compared(
        "writing RC_CHANNELS_OVERRIDE",
        lambda: encoder.encode(RcChannelsOverride(1, 1, CHANNELS)),
        lambda: mavlink.MAVLink_rc_channels_override_message(1, 1, *CHANNELS).pack(theirs),
        [str(C_BATCH), "pack"],
        b"",
    )
    signing = Signing(bytes(range(32)), 1.8e9, 0.0)
    signer = Encoder(Source(255, 191), signing)
    signed = mavlink.MAVLink(None, 255, 191)
    signed.signing.secret_key, signed.signing.sign_outgoing = bytes(range(32)), True
    ours_ns, theirs_ns = _quickest(
        lambda: signer.encode(RcChannelsOverride(1, 1, CHANNELS)),
        lambda: mavlink.MAVLink_rc_channels_override_message(1, 1, *CHANNELS).pack(signed),
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
    what: str,
    ours: Callable[[], object],
    theirs: Callable[[], object],
    arguments: list[str],
    frame: bytes,
) -> Iterator[Result]:
    ours_ns, theirs_ns = _quickest(ours, theirs)
    yield Result(
        what=what,
        value=ours_ns / 1e3,
        reference=theirs_ns / 1e3,
        unit="µs",
        reference_what="pymavlink",
        aim=1.0 / FASTER,
    )
    try:
        program = c_reference.program("codec")
    except NoCompilerError as error:
        print(error)
        return
    runs = [
        subprocess.run([program, *arguments], input=frame, capture_output=True, check=True)
        for _ in range(C_ROUNDS)
    ]
    c_ns = min(float(run.stdout) for run in runs)
    yield Result(
        what=what,
        value=ours_ns / 1e3,
        reference=c_ns / 1e3,
        unit="µs",
        reference_what="MAVLink's C library",
        aim=SLOWER,
    )


def _quickest(*calls: Callable[[], object]) -> list[float]:
    """ns of one call of each, the calling itself left out."""
    best = [float("inf")] * (len(calls) + 1)
    for _ in range(ROUNDS):
        for i, call in enumerate((*calls, _nothing)):
            begun = perf_counter_ns()
            for _ in range(BATCH):
                call()
            best[i] = min(best[i], (perf_counter_ns() - begun) / BATCH)
    return [ns - best[-1] for ns in best[:-1]]


def _nothing() -> None:
    return None
