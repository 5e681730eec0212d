"""What a frame of motion capture costs.

50 rigid bodies and 500 markers at 360 Hz is what a large hall streams.  References: the least that
finds one body and skips the rest, as our client does (`skipping.py`); the packaged clients'
decoders, which read all of it; all on the very same bytes, timed frame by frame in turn, so that
whatever else the machine does meets all alike; and one core, of which the client may take a
twentieth.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from statistics import median
from time import perf_counter

from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.version import Version
from natnetsdk.NatNetClient import NatNetClient

from tgl_soar.geometry import HallFrame
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.optitrack import Optitrack
from tgl_soar.sim.natnet_frames import (
    CLOCK_HZ,
    Scene,
    SimulatedBody,
    encode_frame,
    encode_models,
    encode_server_info,
)

from .result import Result
from .skipping import body_of

RATE_HZ = 360.0
BODIES, MARKERS = 50, 10  # of each
FRAMES = 200
LEAST_TIMES = 2.3  # as the whole module beside a minimal responder
FRACTION = 0.05  # of a core
SERVER = ("10.0.0.2", 1510)


def natnet() -> Iterator[Result]:
    """A frame through the whole client, by version; and its share of a core at 360 Hz."""
    for version in ((3, 1), (4, 2)):
        ours, theirs, vendors, least = _times(version)
        what = (
            f"a NatNet {version[0]}.{version[1]} frame, {BODIES} bodies, {BODIES * MARKERS} markers"
        )
        yield Result(
            what=what,
            value=ours,
            reference=least,
            unit="µs",
            reference_what="the least that finds the body and skips the rest",
            aim=LEAST_TIMES,
        )
        yield Result(
            what=what,
            value=ours,
            reference=theirs,
            unit="µs",
            reference_what="PyPI's natnet decodes all of it",
        )
        yield Result(
            what=what,
            value=ours,
            reference=vendors,
            unit="µs",
            reference_what="the vendor's sample (natnetsdk) decodes all of it",
        )
        fraction = ours * 1e-6 * RATE_HZ
        yield Result(
            what=f"{what}, at {RATE_HZ:g} Hz",
            value=fraction * 100,
            reference=FRACTION * 100,
            unit="%",
            reference_what="of a core at most",
        )


BENCHMARKS = (natnet,)


@cache
def _times(version: layout.Version) -> tuple[float, float, float, float]:
    """Median µs of our whole client, of natnet's decoder, of natnetsdk's, and of the least."""
    client, bodies = _client(version)
    theirs = Version(*version)
    vendors = NatNetClient()._NatNetClient__unpack_mocap_data
    ours_us, theirs_us, vendors_us, least_us = [], [], [], []
    for number in range(1, FRAMES + 1):
        now_s = number / RATE_HZ
        data = _frame(version, bodies, number, now_s)
        begun = perf_counter()
        client.take(data, SERVER, now_s + 0.012)
        done = perf_counter()
        buffer = PacketBuffer(data)
        buffer.pointer = 4
        DataFrame.read_from_buffer(buffer, theirs)
        read = perf_counter()
        with redirect_stdout(StringIO()):
            vendors(data[4:], len(data) - 4, *version)
        ended = perf_counter()
        body = body_of(data, version, bodies[-1].id)
        found = perf_counter()
        assert body is not None
        ours_us.append(done - begun)
        theirs_us.append(read - done)
        vendors_us.append(ended - read)
        least_us.append(found - ended)
    if client.counters.fixes < FRAMES // 2:  # at 360 Hz every second is thinned
        raise RuntimeError(f"{client.counters.fixes} fixes of {FRAMES} frames: {client.notices}")
    ours_s, theirs_s, vendors_s, least_s = map(median, (ours_us, theirs_us, vendors_us, least_us))
    return ours_s * 1e6, theirs_s * 1e6, vendors_s * 1e6, least_s * 1e6


def _client(version: layout.Version) -> tuple[Optitrack, list[SimulatedBody]]:
    """A client that knows its server, and whose body is the last of all."""
    bodies = [
        SimulatedBody(
            name=f"body {i}",
            id=i,
            position_m=(0.1 * i, 1.0, 2.0),
            quaternion=(0.0, 0.0, 0.0, 1.0),
            markers=tuple((0.01 * k, 1.0, 0.1 * i) for k in range(MARKERS)),
        )
        for i in range(1, BODIES + 1)
    ]
    hall = HallFrame(
        z_up=False, yaw_rad=0.3, origin_north_m=1.0, origin_east_m=2.0, origin_down_m=0.0
    )
    name = bodies[-1].name
    client = Optitrack(
        OptitrackSettings(
            server=SERVER[0],
            body=name,
            unicast=False,
            hall=hall,
            noise_m=0.001,
            max_error_m=0.02,
            max_speed_mps=25.0,
            max_age_s=0.3,
            max_rate_hz=200.0,
        )
    )
    info = encode_server_info(version, data_port=1511, group="239.255.42.99", multicast=True)
    for data in (info, encode_models(version, bodies)):
        client.take(data, SERVER, 0.0)
    return client, bodies


def _frame(
    version: layout.Version, bodies: list[SimulatedBody], number: int, now_s: float
) -> bytes:
    last = bodies[-1]
    moved = last._replace(position_m=(last.position_m[0] + 1e-4 * number, 1.0, 2.0))
    exposed = round((5000.0 + now_s) * CLOCK_HZ)
    scene = Scene(
        number,
        [*bodies[:-1], moved],
        now_s,
        exposed_ticks=exposed,
        received_ticks=exposed + CLOCK_HZ // 200,
        sent_ticks=exposed + CLOCK_HZ // 100,
    )
    return encode_frame(version, scene)
