"""A stand-in for OptiTrack's Motive: it sees a simulated hall and streams it as NatNet.

`Motive` is the server without sockets: it answers what clients ask and streams what its cameras
see, late, noisily and with the faults of its options; all that is random comes from one
seed.  `MotiveServer` puts it on the network.

An exposure of step n is sent `latency_s` and some jitter later, at the first step that is not
earlier.  Clock ticks are of the server's own clock, which its owner gives: simulated time in
lockstep, so that nothing depends on the machine; real time otherwise.
"""

from __future__ import annotations

import heapq
import random
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Final, NamedTuple

from tgl_soar.geometry import HallFrame, hall_from_ned, quaternion_product
from tgl_soar.sim.natnet_frames import (
    CLOCK_HZ,
    CONNECT,
    DISCONNECT,
    ECHO_REQUEST,
    ECHO_RESPONSE,
    KEEP_ALIVE,
    MODELS_REQUEST,
    UNRECOGNIZED,
    VERSIONS,
    Quaternion,
    Scene,
    SimulatedBody,
    Triple,
    Version,
    encode_frame,
    encode_models,
    encode_server_info,
    message,
)
from tgl_soar.sim.ports import Address, Port

CLIENT_SILENCE_S: Final = 5.0  # then a client that is streamed to alone is forgotten
BEGAN_S: Final = 5000.0  # before the computer: its clock is another one
RESTART_S: Final = 1000.0  # how far the clock of a server that was restarted is from before
JUMP_M: Final = 1.5
# Markers on fuselage and tail stand so far from the middle of them: an attitude's noise is that of
# their places over it. A body is made with the aircraft laid along the hall's axes by hand.
ARM_M: Final = 0.2
MADE_RAD: Final = 0.005  # 0.3 degrees, as well as an autopilot is levelled
LATE_S: Final = 0.6
BURST: Final = 32
HALL_FAULTS: Final = (
    "silent", "untracked", "frozen", "vanish", "jump", "swap", "late", "restart", "garbage",
    "second",
)  # fmt: skip


class HallFault(NamedTuple):
    """Something that goes wrong for a while, in simulated time."""

    kind: str  # one of HALL_FAULTS
    from_s: float
    until_s: float


@dataclass(frozen=True)
class MotiveOptions:
    """How the server streams; `rate_hz` must divide the simulation's step rate."""

    version: Version = (4, 1)
    multicast: bool = False
    group: str = "239.255.42.99"
    data_port: int = 1511
    rate_hz: int = 100
    latency_s: float = 0.010
    jitter_s: float = 0.0  # at most so much more
    noise_m: float = 0.0005  # standard deviation, each axis
    loss: float = 0.0  # fraction of the frames
    untracked: float = 0.0  # fraction of the poses
    bodies: int = 3  # the aircraft among them
    markers: int = 4  # of each
    precise_4_0: bool = True
    restarted_clock: bool = True  # after a restart it counts from another beginning
    faults: tuple[HallFault, ...] = ()
    seed: int = 1


@dataclass
class _Client:
    version: Version
    received_s: float
    models_sent: bool = False


class Datagram(NamedTuple):
    """What goes out; to nobody in particular: to the group."""

    data: bytes
    to: Address | None
    second: bool = False  # from another server that nobody has asked for


@dataclass(order=True)
class _Waiting:
    due_s: float
    exposed_s: float  # on the server's clock
    number: int = field(compare=False)
    bodies: list[SimulatedBody] = field(compare=False)
    changed: bool = field(compare=False)


class Motive:
    """The server without its sockets: one tracked aircraft, and other bodies that stand about."""

    def __init__(self, options: MotiveOptions, hall: HallFrame, body: str | int) -> None:
        self.options = options
        self.counts = {"frames": 0, "lost": 0, "refused": 0}
        self._hall = hall
        self._name = body if isinstance(body, str) else "aircraft"
        self._id = body if isinstance(body, int) else 1
        self._random = random.Random(f"{options.seed}/motive")
        self._turns = random.Random(f"{options.seed}/motive/turns")
        made = MADE_RAD if options.noise_m > 0.0 else 0.0
        self._made = self._small_turn(made)  # how the body lies in the aircraft
        self._clients: dict[Address, _Client] = {}
        self._waiting: list[_Waiting] = []
        self._out: list[Datagram] = []
        self._number = 0
        self._swapped = False
        self._frozen: SimulatedBody | None = None
        self._restarts = 0
        self._was_restarting = False
        self._stand = [self._place() for _ in range(max(0, options.bodies - 1))]

    @property
    def is_followed(self) -> bool:
        """Whether somebody knows all that it needs to understand the stream."""
        return any(client.models_sent for client in self._clients.values())

    def receive(self, data: bytes, sender: Address, clock_s: float, now_s: float) -> None:
        """A client's request.  `clock_s`: on the server's clock; `now_s`: simulated."""
        if len(data) < 4 or self._has("silent", now_s) or self._has("restart", now_s):
            self.counts["refused"] += 1
            return
        (number,) = struct.unpack_from("<H", data)
        client = self._clients.get(sender)
        if number == CONNECT:
            client = self._clients[sender] = _Client(self._version_for(data), clock_s)
            self._say(self._info(client), sender)
        elif client is None or number == DISCONNECT:
            self._clients.pop(sender, None)
        else:
            client.received_s = clock_s
            if number == MODELS_REQUEST:
                client.models_sent = True
                self._say(encode_models(client.version, self._named()), sender)
            elif number == ECHO_REQUEST and len(data) >= 12:
                answer = data[4:12] + struct.pack("<Q", self._ticks(clock_s))
                self._say(message(ECHO_RESPONSE, answer), sender)
            elif number != KEEP_ALIVE:
                self._say(message(UNRECOGNIZED, b""), sender)

    def step(
        self, clock_s: float, now_s: float, position_ned_m: Triple, attitude: Quaternion
    ) -> None:
        """The cameras expose; `attitude`: w, x, y, z from FRD to local NED."""
        self._number += 1
        changed = self._swap(now_s)
        bodies = self._see(now_s, position_ned_m, attitude)
        late_s = LATE_S if self._has("late", now_s) else 0.0
        due_s = now_s + self.options.latency_s + late_s
        due_s += self._random.random() * self.options.jitter_s
        heapq.heappush(
            self._waiting,
            _Waiting(
                due_s=due_s, exposed_s=clock_s, number=self._number, bodies=bodies, changed=changed
            ),
        )

    def send(self, clock_s: float, now_s: float) -> None:
        """Stream what is due, with ticks of now."""
        restarting = self._has("restart", now_s)
        if restarting and not self._was_restarting:
            self._restarts += 1
            self._number = 0
            self._clients.clear()
        self._was_restarting = restarting
        gone = [a for a, c in self._clients.items() if clock_s - c.received_s > CLIENT_SILENCE_S]
        for address in gone:
            del self._clients[address]
        while self._waiting and self._waiting[0].due_s <= now_s + 1e-9:
            waiting = heapq.heappop(self._waiting)
            silent = restarting or self._has("silent", now_s)
            if silent or self._random.random() < self.options.loss:
                self.counts["lost"] += 1
            else:
                self._stream(waiting, clock_s, now_s)

    def take_datagrams(self) -> list[Datagram]:
        """What is to be sent, in order."""
        out, self._out = self._out, []
        return out

    def _say(self, data: bytes, to: Address) -> None:
        self._out.append(Datagram(data, to))

    def _has(self, kind: str, now_s: float) -> bool:
        return any(f.kind == kind and f.from_s <= now_s < f.until_s for f in self.options.faults)

    def _ticks(self, clock_s: float) -> int:
        began_s = self._restarts * RESTART_S if self.options.restarted_clock else 0.0
        return round((clock_s + began_s) * CLOCK_HZ)

    def _version_for(self, request: bytes) -> Version:
        """A client that we stream to alone may ask for an older version, after its own name."""
        own = self.options.version
        if self.options.multicast or len(request) < 4 + 269:
            return own
        asked = (request[4 + 265], request[4 + 266])
        return min(own, asked) if asked >= VERSIONS[0] else own

    def _info(self, client: _Client) -> bytes:
        options = self.options
        return encode_server_info(
            client.version,
            data_port=options.data_port,
            group=options.group,
            multicast=options.multicast,
        )

    def _stream(self, waiting: _Waiting, clock_s: float, now_s: float) -> None:
        options = self.options
        self.counts["frames"] += 1
        exposed, sent = self._ticks(waiting.exposed_s), self._ticks(clock_s)
        scene = Scene(
            number=waiting.number,
            bodies=waiting.bodies,
            time_s=waiting.exposed_s,
            exposed_ticks=exposed,
            received_ticks=(exposed + sent) // 2,
            sent_ticks=sent,
            models_changed=waiting.changed,
        )
        if self._has("second", now_s):
            elsewhere = [b._replace(position_m=_moved(b.position_m)) for b in waiting.bodies]
            other = encode_frame(options.version, replace(scene, bodies=elsewhere))
            for to in [None] if options.multicast else list(self._clients):
                self._out.append(Datagram(other, to, second=True))
        if options.multicast:
            self._out.append(Datagram(self._encoded(options.version, scene, now_s), None))
            return
        for address, client in self._clients.items():
            self._say(self._encoded(client.version, scene, now_s), address)

    def _encoded(self, version: Version, scene: Scene, now_s: float) -> bytes:
        data = encode_frame(version, scene, precise_4_0=self.options.precise_4_0)
        if not self._has("garbage", now_s):
            return data
        kind = self._random.randrange(3)
        if kind == 0:
            return data[: self._random.randrange(len(data))]
        if kind == 1:
            return data + self._random.randbytes(40)
        return data[:8] + self._random.randbytes(len(data) - 8)

    # --- the hall ---------------------------------------------------------------------------

    def _see(
        self, now_s: float, position_ned_m: Triple, attitude: Quaternion
    ) -> list[SimulatedBody]:
        """All bodies at an exposure."""
        if self.options.noise_m > 0.0:
            attitude = quaternion_product(*attitude, *self._made)
            noise = self._small_turn(self.options.noise_m / ARM_M)
            attitude = quaternion_product(*attitude, *noise)
        w, *axis = attitude
        level = HallFrame(
            z_up=self._hall.z_up,
            yaw_rad=self._hall.yaw_rad,
            origin_north_m=0.0,
            origin_east_m=0.0,
            origin_down_m=0.0,
        )
        turned = (*hall_from_ned(level, axis[0], axis[1], axis[2]), w)
        place = self._noisy(hall_from_ned(self._hall, *position_ned_m))
        aircraft, *others = self._named()
        aircraft = self._formed(aircraft, _moved(place) if self._has("jump", now_s) else place)
        aircraft = aircraft._replace(quaternion=turned)
        blind = self._has("untracked", now_s) or self._random.random() < self.options.untracked
        aircraft = aircraft._replace(tracked=not blind)
        if self._has("frozen", now_s):
            aircraft = self._frozen = self._frozen or aircraft
        else:
            self._frozen = None
        bodies = [self._formed(body, self._noisy(body.position_m)) for body in others]
        if not self._has("vanish", now_s):
            bodies.insert(0, aircraft)
        return sorted(bodies, key=lambda body: body.id)

    def _swap(self, now_s: float) -> bool:
        """Whether the ids are others than at the exposure before."""
        swapped, before = self._has("swap", now_s), self._swapped
        self._swapped = swapped
        return swapped != before

    def _named(self) -> list[SimulatedBody]:
        """The aircraft first; where the others stand."""
        bodies = [
            SimulatedBody(
                name=self._name,
                id=self._id,
                position_m=(0.0, 0.0, 0.0),
                quaternion=(0.0, 0.0, 0.0, 1.0),
            )
        ]
        for i, place in enumerate(self._stand, 1):
            bodies.append(
                SimulatedBody(
                    name=f"other {i}",
                    id=self._id + i,
                    position_m=place,
                    quaternion=(0.0, 0.0, 0.0, 1.0),
                )
            )
        if self._swapped and len(bodies) > 1:
            aircraft, other = bodies[0], bodies[1]
            bodies[:2] = [aircraft._replace(id=other.id), other._replace(id=aircraft.id)]
        return [self._formed(body, body.position_m) for body in bodies]

    def _formed(self, body: SimulatedBody, at: Triple) -> SimulatedBody:
        """A body at a place, with its markers around it."""
        markers = [
            (at[0] + 0.05 * (i % 3 - 1), at[1] + 0.01 * i, at[2] + 0.05 * (i % 2))
            for i in range(self.options.markers)
        ]
        return body._replace(position_m=at, markers=tuple(markers))

    def _place(self) -> Triple:
        uniform = self._random.uniform
        return uniform(-3.0, 3.0), uniform(0.0, 2.0), uniform(-3.0, 3.0)

    def _small_turn(self, sigma_rad: float) -> Quaternion:
        """A rotation by some angle of this standard deviation about each axis."""
        x, y, z = (0.5 * self._turns.gauss(0.0, sigma_rad) for _ in range(3))
        return sqrt(max(0.0, 1.0 - x * x - y * y - z * z)), x, y, z

    def _noisy(self, at: Triple) -> Triple:
        gauss, noise_m = self._random.gauss, self.options.noise_m
        return gauss(at[0], noise_m), gauss(at[1], noise_m), gauss(at[2], noise_m)


def _moved(at: Triple) -> Triple:
    return at[0] + JUMP_M, at[1], at[2]


# --- with sockets -------------------------------------------------------------------------------


class MotiveServer:
    """The stand-in on the network: one port for commands and for what is streamed."""

    def __init__(
        self, motive: Motive, local: Address, clock_s: Callable[[], float], *, step_hz: int
    ) -> None:
        """`clock_s`: the server's clock.  Errors: `PortError`, ValueError for a bad rate."""
        rate_hz = motive.options.rate_hz
        if rate_hz < 1 or step_hz % rate_hz:
            raise ValueError(f"--mocap-rate {rate_hz}: must divide the {step_hz} steps a second")
        self.motive = motive
        self.port = Port("mocap", "--mocap-local", local, ground=False)
        self._clock_s = clock_s
        self._every = step_hz // rate_hz
        self._second: socket.socket | None = None
        outgoing = socket.inet_aton(self.port.local[0])
        self.port.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, outgoing)
        self.port.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)

    def serve(self, now_s: float) -> None:
        """Answer what clients have asked."""
        for _ in range(BURST):
            try:
                data, sender = self.port.socket.recvfrom(4096)
            except OSError:
                break
            self.motive.receive(data, sender, self._clock_s(), now_s)
        self._flush()

    def step(self, step: int, now_s: float, position_ned_m: Triple, attitude: Quaternion) -> None:
        """One step of the simulation: expose where it is time, and stream what is due."""
        if step % self._every == 0:
            self.motive.step(self._clock_s(), now_s, position_ned_m, attitude)
        self.motive.send(self._clock_s(), now_s)
        self._flush()

    def close(self) -> None:
        """Give the ports back."""
        self.port.socket.close()
        if self._second is not None:
            self._second.close()

    def _flush(self) -> None:
        options = self.motive.options
        for data, to, second in self.motive.take_datagrams():
            out = self._other() if second else self.port.socket
            try:
                out.sendto(data, to or (options.group, options.data_port))
            except OSError:
                self.motive.counts["lost"] += 1

    def _other(self) -> socket.socket:
        """Where another server streams from: this computer's second address."""
        if self._second is None:
            self._second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._second.bind(("127.0.0.2", 0))
            outgoing = socket.inet_aton("127.0.0.1")
            self._second.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, outgoing)
        return self._second
