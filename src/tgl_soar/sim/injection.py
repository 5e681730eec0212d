"""Faults at work: what stands between the world, the autopilot and the module, and corrupts it.

    world ──samples──► Injection.sample ──► autopilot ──┐ link ┌──► module
    world ◄─surfaces── Injection.surfaces ◄─ autopilot ◄┘      └─── module

`FaultChannel` is the one implementation of late, lost, doubled and overtaken: the same code passes
samples where all is one process and datagrams where the bridge has real sockets.  `DirectLink`
stands for the autopilot and its link in the first case; in the second they are there.

Every draw comes from the seed and the fault's place, and time is simulated time: in lockstep the
same seed gives the same faults at the same frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from math import radians
from random import Random
from typing import Any, Final, Generic, TypeVar

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import Gust, GustyField, ScaledField, Schedule
from tgl_soar.geometry import quaternion_from_euler, quaternion_product
from tgl_soar.sim.faults import Fault
from tgl_soar.sim.sensor_sampling import Sample
from tgl_soar.types import (
    NAN,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    PositionFix,
    RangeSample,
    SurfaceCommand,
)

Item = TypeVar("Item")

MEASURED: Final = ("position", "attitude", "imu", "airspeed", "rangefinder")
BOTH_WAYS: Final = ("delay", "jitter", "reorder", "duplicate", "loss", "corrupt")
SURFACES: Final = ("elevator", "aileron", "rudder", "brake")
HEARTBEAT_S: Final = 1.0
OVERRIDE_TIME_S: Final = 0.5  # as the README asks of a real one: 3 s would lose the aircraft
SECOND_AUTOPILOT: Final = "autopilot.second"  # no way of one thing that passes, as `duplicate` is
DUPLICATE_M: Final = (3.0, 4.0, 0.0)  # where the duplicate stands, from the aircraft, NED
DUPLICATE_TURN_RAD: Final = 1.2  # and how it is turned


class FaultChannel(Generic[Item]):
    """A way that items take, in order and at once unless a fault acts on them.

    corrupt: what becomes of an item whose bits are turned; None: it is refused on arrival.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        seed: str,
        corrupt: Callable[[Item, Random], Item | None] = lambda _item, _random: None,
    ) -> None:
        self._faults = [fault for fault in faults if fault.way in _PASSING_WAYS]
        self._random = Random(seed)
        self._corrupt = corrupt
        self._under_way: list[tuple[float, int, Item]] = []
        self._sent = 0
        self._last_s = float("-inf")  # when what was sent last arrives

    def send(self, now_s: float, item: Item) -> None:
        """Send an item on its way."""
        random = self._random
        arrives = now_s
        overtaken = False
        again: list[float] = []
        for fault in self._faults:
            if not fault.acts(now_s):
                continue
            way = fault.way
            if way in _SILENT_WAYS:
                return
            if way == "delay":
                arrives += fault["by"]
            elif way == "jitter":
                arrives += random.uniform(0.0, fault["by"])
            elif random.random() < fault["fraction"]:
                if way == "loss":
                    return
                if way == "corrupt":
                    corrupted = self._corrupt(item, random)
                    if corrupted is None:
                        return
                    item = corrupted
                elif way == "duplicate":
                    again.append(fault["by"])
                else:
                    overtaken = True
                    arrives += fault["by"]
        if not overtaken:  # a way keeps its order, however slow it has become
            arrives = self._last_s = max(arrives, self._last_s)
        self._push(arrives, item)
        for later in again:
            self._push(arrives + later, item)

    def arrived(self, now_s: float) -> list[Item]:
        """What has arrived since the last call, in the order of arrival."""
        items = []
        while self._under_way and self._under_way[0][0] <= now_s:
            items.append(heappop(self._under_way)[2])
        return items

    def _push(self, arrives_s: float, item: Item) -> None:
        self._sent += 1
        heappush(self._under_way, (arrives_s, self._sent, item))


_SILENT_WAYS: Final = frozenset({"dropout", "down", "up", "reboot"})
_PASSING_WAYS: Final = _SILENT_WAYS.union(BOTH_WAYS)


Datagram = tuple[int, bytes]  # the link's number, and what it carries


def _with_bits_turned(datagram: Datagram, random: Random) -> Datagram:
    """As bad radio and good framing leave it."""
    link, data = datagram
    corrupted = bytearray(data)
    for _ in range(random.randint(1, 8)):
        if corrupted:
            corrupted[random.randrange(len(corrupted))] ^= 1 << random.randrange(8)
    return link, bytes(corrupted)


class Measured(Generic[Sample]):
    """The samples of one sensor: their values corrupted, then their way."""

    def __init__(self, of: str, faults: Sequence[Fault], seed: int) -> None:
        self._lies = [fault for fault in faults if fault.of == of]
        self._second = [fault for fault in faults if fault.kind.name == SECOND_AUTOPILOT]
        self._random = Random(f"{seed}/{of} lies")
        self._fault_channel: FaultChannel[Sample] = FaultChannel(faults, f"{seed}/{of} faults")
        self._frozen: Sample | None = None
        self._last_sequence = 0
        self._arrived = 0
        self._newest: Sample | None = None

    def take(self, now_s: float, sample: Sample) -> Sample:
        """The newest sample that has arrived; its sequence number counts arrivals."""
        if self._newest is None:
            self._newest = sample._replace(sequence=0)
        if sample.sequence != self._last_sequence:
            self._last_sequence = sample.sequence
            self._fault_channel.send(now_s, self._reported(now_s, sample))
            if any(fault.acts(now_s) for fault in self._second):
                self._fault_channel.send(now_s, of_duplicate(sample))
        for arrived in self._fault_channel.arrived(now_s):
            self._arrived += 1
            self._newest = arrived._replace(sequence=self._arrived)
        return self._newest

    def _reported(self, now_s: float, sample: Sample) -> Sample:
        """The sample with what is wrong with it."""
        freezes = False
        for fault in self._lies:
            if not fault.acts(now_s):
                continue
            if fault.way == "freeze":
                freezes = True
                self._frozen = self._frozen or sample
                sample = self._frozen._replace(sequence=sample.sequence, time_s=sample.time_s)
            elif fault.way == "nan":
                if self._random.random() < fault["fraction"]:
                    sample = _without_numbers(sample)
            elif fault.way == "bias":
                sample = _wrong_by(sample, fault.offsets)
            elif fault.way == "reckoned":
                sample = _dead_reckoned(sample, fault, now_s)
            elif fault.way == "noise":
                sigma, gauss = fault["sigma"], self._random.gauss
                sample = _wrong_by(sample, (gauss(0, sigma), gauss(0, sigma), gauss(0, sigma)))
        if not freezes:
            self._frozen = None
        return sample


_NO_NUMBERS: Final = ("sequence", "time_s", "source", "reckoned")


def _without_numbers(sample: Sample) -> Sample:
    """As of a filter that has diverged: stamps go on, values are not numbers."""
    lies: dict[str, Any] = {name: NAN for name in sample._fields if name not in _NO_NUMBERS}
    return sample._replace(**lies)


def _wrong_by(sample: Any, error: Sequence[float]) -> Any:
    """A sample wrong by so much, in the catalogue's units: m, deg, m/s² or m/s."""
    if isinstance(sample, PositionFix):
        north, east, down = error
        return sample._replace(
            north_m=sample.north_m + north,
            east_m=sample.east_m + east,
            down_m=sample.down_m + down,
        )
    if isinstance(sample, AttitudeSample):
        roll, pitch, heading = (radians(angle) for angle in error)
        return _turned(sample, quaternion_from_euler(roll, pitch, heading))
    if isinstance(sample, ImuSample):
        return sample._replace(
            force_x_frd_mps2=sample.force_x_frd_mps2 + error[0],
            force_y_frd_mps2=sample.force_y_frd_mps2 + error[1],
            force_z_frd_mps2=sample.force_z_frd_mps2 + error[2],
        )
    if isinstance(sample, RangeSample):
        return sample._replace(range_m=max(0.0, sample.range_m + error[0]))
    return sample._replace(airspeed_mps=max(0.0, sample.airspeed_mps + error[0]))


def _dead_reckoned(sample: Any, fault: Fault, now_s: float) -> Any:
    """A position that is carried on by accelerations which are wrong."""
    lasted_s = now_s - fault.start_s
    north, east = fault["north"] * lasted_s, fault["east"] * lasted_s
    return sample._replace(
        north_m=sample.north_m + 0.5 * lasted_s * north,
        east_m=sample.east_m + 0.5 * lasted_s * east,
        velocity_north_mps=sample.velocity_north_mps + north,
        velocity_east_mps=sample.velocity_east_mps + east,
        reckoned=lasted_s >= fault["reported"],
    )


def _turned(sample: AttitudeSample, by: tuple[float, float, float, float]) -> AttitudeSample:
    """Turned about its own axes."""
    qw, qx, qy, qz = quaternion_product(sample.qw, sample.qx, sample.qy, sample.qz, *by)
    return sample._replace(qw=qw, qx=qx, qy=qy, qz=qz)


def of_duplicate(sample: Any) -> Any:
    """What the duplicate reports at the same time."""
    if isinstance(sample, PositionFix):
        return _wrong_by(sample, DUPLICATE_M)
    if isinstance(sample, AttitudeSample):
        return _turned(sample, quaternion_from_euler(0.0, 0.0, DUPLICATE_TURN_RAD))
    return sample


def _one_sided(command: SurfaceCommand, stood: float, roll: float) -> SurfaceCommand:
    """One half of the brake stands where it stood: half of the rest, and a roll to one side."""
    apart = command.brake - stood
    return command._replace(
        brake=stood + 0.5 * apart,
        aileron=max(-1.0, min(1.0, command.aileron + roll * apart)),
    )


class Injection:
    """All faults of one flight.  Without any, everything passes as it is."""

    def __init__(self, faults: Sequence[Fault] = (), seed: int = 1) -> None:
        self.faults = tuple(faults)
        self._seed = seed
        self._measured: dict[str, Measured[Any]] = {}
        for of in MEASURED:
            own = [fault for fault in faults if fault.of in (of, "all")]
            if own:
                self._measured[of] = Measured(of, own, seed)
        self._servos = [fault for fault in faults if fault.of in SURFACES]
        self._stood = SurfaceCommand(0.0, 0.0, 0.0)
        self._begun: set[int] = set()
        self._over: set[int] = set()

    def turns(self, now_s: float) -> list[tuple[Fault, bool]]:
        """The faults that begin (True) or are over (False), each reported once."""
        turns = []
        for i, fault in enumerate(self.faults):
            if i not in self._begun and now_s >= fault.start_s:
                self._begun.add(i)
                turns.append((fault, True))
            if i not in self._over and now_s >= fault.end_s:
                self._over.add(i)
                turns.append((fault, False))
        return turns

    def field(self, field: WindField) -> WindField:
        """The air with its gusts and lulls."""
        for fault in self.faults:
            if fault.kind.name == "air.stop":
                begin, over = fault.start_s, fault["over"]
                end = max(fault.end_s, begin + over)
                times = (begin, begin + over, end + 1e-3, end + 1e-3 + over)
                field = ScaledField(field, Schedule(times, (1.0, fault["to"], fault["to"], 1.0)))
        gusts = [
            Gust(
                start_s=fault.start_s,
                duration_s=fault["for"],
                u_mps=fault["along"],
                v_mps=fault["across"],
                w_mps=fault["up"],
            )
            for fault in self.faults
            if fault.kind.name == "air.gust"
        ]
        return GustyField(field, gusts) if gusts else field

    def sample(self, of: str, now_s: float, sample: Sample) -> Sample:
        """The newest sample of a sensor that its reader has."""
        measured = self._measured.get(of)
        return sample if measured is None else measured.take(now_s, sample)

    def surfaces(self, now_s: float, commanded: SurfaceCommand, dt_s: float) -> SurfaceCommand:
        """Where the servos go that are commanded so."""
        if not self._servos:
            return commanded
        going = commanded
        for fault in self._servos:
            if not fault.acts(now_s):
                continue
            if fault.way == "one_side":
                going = _one_sided(going, self._stood.brake, fault["roll"])
                continue
            stood = getattr(self._stood, fault.of)
            most = fault["rate"] * dt_s if fault.way == "slow" else 0.0
            wanted = getattr(going, fault.of)
            going = going._replace(**{fault.of: max(stood - most, min(stood + most, wanted))})
        one_sided = any(f.way == "one_side" and f.acts(now_s) for f in self._servos)
        self._stood = going._replace(brake=self._stood.brake) if one_sided else going
        return going

    def of_link(self, silence: str) -> list[Fault]:
        """The faults of the link in one direction, whose silence is "down" or "up"."""
        ways = (*BOTH_WAYS, silence)
        return [fault for fault in self.faults if fault.of == "link" and fault.way in ways]

    def wire(self, silence: str) -> FaultChannel[Datagram] | None:
        """The way of datagrams in one direction; None: no fault acts on it."""
        faults = self.of_link(silence)
        if not faults:
            return None
        return FaultChannel(faults, f"{self._seed}/wire {silence}", _with_bits_turned)

    def named(self, name: str) -> list[Fault]:
        """The faults of one name."""
        return [fault for fault in self.faults if fault.kind.name == name]

    @property
    def seed(self) -> int:
        """Of all that is random in the faults."""
        return self._seed


class DirectLink:
    """Autopilot and link where module and world are one process.

    The autopilot beats once a second and when its mode changes; it releases overrides that
    were not repeated for `OVERRIDE_TIME_S`, and holds the surfaces at their trims and the
    throttle closed when nobody has them.
    """

    def __init__(self, injection: Injection, trim: SurfaceCommand) -> None:
        self._injection = injection
        self._trim = trim
        seed = injection.seed
        reboots = injection.named("autopilot.reboot")
        down = [*injection.of_link("down"), *reboots]
        duplicates = injection.named(SECOND_AUTOPILOT)
        self._down: dict[str, Measured[Any]] = {
            of: Measured(f"link {of}", [*down, *duplicates], seed)
            for of in (*MEASURED, "surfaces")
            if down or duplicates
        }
        self._heartbeats: FaultChannel[AutopilotStatus] = FaultChannel(down, f"{seed}/heartbeats")
        up = [*injection.of_link("up"), *reboots]
        self._up: FaultChannel[tuple[SurfaceCommand, float]] = FaultChannel(up, f"{seed}/commands")
        self._reboots = reboots
        self._takes = injection.named("pilot.takes")
        self._status: AutopilotStatus | None = None
        self._received = AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False)
        self._beaten_s = float("-inf")
        self._command = trim
        self.throttle = 0.0  # what the motor is commanded, 0 … 1
        self._commanded_s = float("-inf")
        self._overridden = False
        self._obeys = True

    def inputs(self, inputs: Inputs) -> Inputs:
        """What the module receives of the world and the autopilot."""
        now, injection, down = inputs.time_s, self._injection, self._down
        measured: dict[str, Any] = {}
        for of in (*MEASURED, "surfaces"):
            sample = getattr(inputs, of)
            if of == "surfaces":
                # Read back is what the servos were commanded, not where a bad one stands.
                if sample.sequence > 0:
                    sample = sample._replace(**self._command._asdict())
            else:
                sample = injection.sample(of, now, sample)
            measured[of] = down[of].take(now, sample) if down else sample
        self._beat(now, inputs.autopilot)
        for status in self._heartbeats.arrived(now):
            self._received = status._replace(time_s=now)
        return inputs._replace(autopilot=self._received, **measured)

    def surfaces(
        self, now_s: float, command: SurfaceCommand | None, throttle: float = 0.0
    ) -> SurfaceCommand:
        """What the servos are commanded, of a command that the module sends; None: none.

        throttle: 0 … 1, sent with the command; what becomes of it is `self.throttle`.
        """
        if command is not None:
            self._up.send(now_s, (command, throttle))
        for arrived in self._up.arrived(now_s):
            self._command, self.throttle = arrived
            self._commanded_s, self._overridden = now_s, True
        if self._overridden and now_s - self._commanded_s >= OVERRIDE_TIME_S:
            self._overridden = self._obeys = False  # it falls into a mode of its own
        for fault in self._reboots:
            if fault.acts(now_s):
                self._overridden = False
        taken = any(fault.acts(now_s) for fault in self._takes)
        if taken or not (self._overridden and self._obeys):
            self._command, self.throttle = self._trim, 0.0
        return self._command

    def _beat(self, now_s: float, status: AutopilotStatus) -> None:
        boots = sum(now_s >= fault.end_s for fault in self._reboots)
        if self._status is not None and boots > self._status.boots:
            self._obeys = True  # it is in the mode of the pilot's switch again
        obeys = self._obeys and not any(fault.acts(now_s) for fault in self._takes)
        status = status._replace(accepts_surfaces=obeys, boots=boots)
        known = self._status
        changed = known is None or known[1:] != status[1:]
        if changed or now_s - self._beaten_s >= HEARTBEAT_S:
            self._status, self._beaten_s = status, now_s
            self._heartbeats.send(now_s, status)
