"""The simulator bridge: one process that is the Pixhawk and the world around it.

    ground stations  127.0.0.1:14550 ◄──►  :18570 ┐
                                                  ├ Pixhawk ◄─► servos, aircraft, air, sensors
    companion        127.0.0.1:14540 ◄──►  :14580 ┘

Real time: every step has an absolute deadline, so time does not drift; where the machine falls
more than a few steps behind, that time is given up and counted, never hurried after: the world
stands still for so long while the clocks run on.  A machine that is too slow is told.  The bridge
asks for the priority that comes after the module's loop.

Lockstep: after every step the companion gets the attitude, even unasked, what else its streams
have due, and a TIMESYNC request.
The bridge waits for the answer before time goes on; all that the companion sent before the
answer acts at this very step.  With `--lockstep-gcs` the ground stations are asked in the same
way every 50 ms.  So nothing depends on the machine's speed: the same seed gives the same
flight, bit for bit.  Who dies is waited for once, named, and let go; time then goes on at its
natural pace until they speak again.

With `--mocap natnet` a stand-in for OptiTrack's Motive (`sim.motive`) streams the aircraft's
place as well.  A step's poses are sent before its MAVLink, and in lockstep the stand-in's clock
is simulated time and the bridge waits at the start until a client knows all that it needs: so a
flight by motion capture repeats bit for bit, too.

The aircraft is held at the start, in the wind, until the first override reaches a surface.
Whenever nobody overrides the surfaces the safety pilot flies (`sim.pilot`).  An aircraft that
hits something lies there for 3 s and is then held at the start again.

`tools/sitl_bridge.py` and `python -m tgl_soar.sim.bridge` are the same program.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, airframe_file, load_airframe, load_site, site_file
from tgl_soar.config.site import Site
from tgl_soar.geometry import ned_from_soaring
from tgl_soar.onboard import realtime
from tgl_soar.sim.faults import Fault, FaultError, catalogue_text, parse_fault
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.motive import MotiveServer, add_motive_options, motive_server
from tgl_soar.sim.ports import BURST, Address, Peer, Port, PortError, Ports, resolved
from tgl_soar.sim.routing import LinkId
from tgl_soar.sim.sensors import measure_attitude
from tgl_soar.sim.simulation import Options, Simulation
from tgl_soar.sim.world import World

GROUND_BARRIER_S: Final = 0.05
BEHIND_STEPS: Final = 5  # so far behind, real time gives up catching up
TOO_SLOW: Final = "this machine is too slow for real time"
HICCUP_S: Final = 0.15  # without a step: an attitude older than AGE_ATT_MAX (0.2 s) ends a flight
SLOW_SHARE: Final = 0.05  # of the time, given up: the aircraft is flown in another time's air
SLOW_EVERY_S: Final = 10.0  # between two words about it
BARRIER_OFFSET_NS: Final = 1_000_000_000  # so that no barrier's stamp is zero
STRANGERS_NAMED: Final = 20  # on the console; the rest of a flood is not
REPEAT_S: Final = 1.0  # a barrier's request is repeated, should a datagram have been lost

TIMESYNC_ID: Final = mavlink.MAVLINK_MSG_ID_TIMESYNC.to_bytes(3, "little")


class BridgeError(RuntimeError):
    """The bridge cannot run; the message says why and what to do."""


@dataclass(frozen=True)
class Pace:
    """How time goes on."""

    lockstep: bool = False
    lockstep_ground: bool = False
    duration_s: float | None = None  # simulated
    patience_s: float = 5.0  # wall: a silent participant is waited for so long
    start_timeout_s: float = 30.0  # wall: for all participants to appear


class Autopilot(Protocol):
    """What speaks for the vehicle on its links."""

    @property
    def step_hz(self) -> int:
        """Steps per second."""
        ...

    def send(self, link: LinkId, message: Any) -> None:
        """Say something on one link."""
        ...

    def announce(self) -> None:
        """Show on every link that the vehicle is there."""
        ...

    def set_pace(self, link: LinkId) -> None:
        """Lockstep: send the attitude of every step on a link, unasked."""
        ...

    def heartbeats(self, link: LinkId) -> int:
        """How many came over a link."""
        ...

    def timesync_answer_ns(self, link: LinkId) -> int:
        """The stamp of the last TIMESYNC answered on a link; 0: none."""
        ...


class Simulated(Protocol):
    """World and autopilot, one step at a time: `Simulation`, or a real firmware in its place."""

    injection: Injection
    world: World
    crashes: int

    @property
    def pixhawk(self) -> Autopilot:
        """What speaks for the vehicle."""
        ...

    @property
    def booted(self) -> bool:
        """Whether it speaks yet."""
        ...

    @property
    def time_s(self) -> float:
        """Simulated time."""
        ...

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station or to a companion."""
        ...

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        ...

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link."""
        ...

    def take_datagrams(self, links: Sequence[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What goes out on some links, or on all."""
        ...

    def step(self) -> None:
        """One step of everything."""
        ...

    def pass_over(self, seconds: float) -> None:
        """So long no step was made; the clock of an autopilot does not stand still for that."""
        ...

    def take_events(self) -> list[str]:
        """What the console should say, each once."""
        ...

    def summary(self) -> str:
        """What became of a companion's commands."""
        ...

    def close(self) -> None:
        """It is over."""
        ...


class Slowness:
    """What of real time is given up, and when that is worth a word."""

    def __init__(self, now_s: float) -> None:
        self.given_up_s = 0.0
        self._since_s = now_s
        self._lost_s = self._worst_s = 0.0  # since then

    def lose(self, lost_s: float) -> None:
        """So much is not caught up with."""
        self.given_up_s += lost_s
        self._lost_s += lost_s
        self._worst_s = max(self._worst_s, lost_s)

    def told(self, now_s: float) -> str:
        """What is to be said now; "" if nothing is.  A hiccup at once, the rest once in a while."""
        over_s = now_s - self._since_s
        if over_s < SLOW_EVERY_S and (self._worst_s < HICCUP_S or over_s < 1.0):
            return ""
        lost_s, worst_s = self._lost_s, self._worst_s
        self._since_s, self._lost_s, self._worst_s = now_s, 0.0, 0.0
        if worst_s < HICCUP_S and lost_s < SLOW_SHARE * over_s:
            return ""
        return (
            f"{TOO_SLOW}: {lost_s:.2f} s of the last {over_s:.1f} s were given up,"
            f" {worst_s:.2f} s at once; close other programs, or fly in lockstep"
        )


class Bridge:
    """Carries datagrams between sockets and the simulation, and lets time go on."""

    def __init__(
        self,
        simulation: Simulated,
        ports: Ports,
        pace: Pace,
        motive: MotiveServer | None = None,
    ) -> None:
        self.simulation, self.ports, self.pace = simulation, ports, pace
        self.motive = motive
        self.stopping = False
        self.slowness = Slowness(time.monotonic())
        self.wall_s = 0.0
        self._pixhawk = simulation.pixhawk
        self._down = simulation.injection.wire("down")  # to companions
        self._up = simulation.injection.wire("up")
        self._waited_for: dict[LinkId, Peer] = {}
        self._missed: dict[LinkId, int] = {}  # datagrams from it when it was let go
        self._dt_s = 1.0 / simulation.pixhawk.step_hz
        self._ground_every = round(GROUND_BARRIER_S / self._dt_s)
        for peer in ports.peers.values():
            simulation.add_link(peer.link, ground=peer.port.ground)

    def run(self) -> None:
        """Until the duration is over or somebody stops it.  Errors: `BridgeError`."""
        self._boot()
        if self.pace.lockstep:
            self._gather()
        begun = time.monotonic()
        try:
            if self.pace.lockstep:
                self._run_lockstep()
            else:
                self._run_realtime()
        finally:
            self.wall_s = time.monotonic() - begun

    def _boot(self) -> None:
        """A real firmware must have booted before anybody can be asked to wait for it."""
        while not self.simulation.booted and not self.stopping:
            self._step()
            self._drain(self.ports.ground)
            self._drain(self.ports.companion)
            self._flush()

    def stop(self, *_: object) -> None:
        """End after this step."""
        self.stopping = True

    def _over(self) -> bool:
        duration = self.pace.duration_s
        return self.stopping or (
            duration is not None and self.simulation.time_s >= duration - 0.5 * self._dt_s
        )

    # --- real time ---------------------------------------------------------------------

    def _run_realtime(self) -> None:
        if not realtime.accompany():
            self._say("no real-time priority: a busy machine may interrupt the flight")
        deadline = time.monotonic()
        self.slowness = Slowness(deadline)
        while not self._over():
            deadline = self._keep_pace(deadline)
            self._step()
            self._flush()

    def _keep_pace(self, deadline: float) -> float:
        """Serve the ports until the deadline; the next one."""
        ports = self.ports
        while True:
            left = deadline - time.monotonic()
            if left <= 0.0 or self.stopping:
                break
            waited_for = [ports.ground, ports.companion]
            if self.motive is not None:
                waited_for.append(self.motive.port)
            if ports.wait(left, *waited_for):
                self._serve_mocap()
                self._drain(ports.companion)
                self._drain(ports.ground)
                self._flush()
        if -left > BEHIND_STEPS * self._dt_s:
            self.slowness.lose(-left)
            if not self.pace.lockstep:
                self.simulation.pass_over(-left)
            deadline -= left
        if words := self.slowness.told(deadline):
            self._say(words)
        self._drain(ports.companion)
        self._drain(ports.ground)
        return deadline + self._dt_s

    # --- lockstep ----------------------------------------------------------------------

    def _run_lockstep(self) -> None:
        deadline = time.monotonic()
        while not self._over():
            self._step()
            if self._missed:
                # Somebody is missing: natural pace, and an ear for their return.
                self._flush()
                deadline = self._keep_pace(max(deadline, time.monotonic() - self._dt_s))
                self._readmit()
                self._barrier([link for link in self._waited_for if self._is_companion(link)])
                continue
            self._barrier([link for link in self._waited_for if self._is_companion(link)])
            if not self.pace.lockstep_ground:
                self._drain(self.ports.ground)
                self._flush()
            elif self.simulation.world.steps % self._ground_every == 0:
                self._barrier([link for link in self._waited_for if not self._is_companion(link)])

    def _is_companion(self, link: LinkId) -> bool:
        return not self.ports.peers[link].port.ground

    def _barrier(self, links: list[LinkId]) -> None:
        """Ask each whether it is through with this step, and take all it says until then."""
        stamp = self._stamp()
        if self._down is not None:
            self._flush()  # so that the question below goes alone, past all faults
        for link in links:
            self._pixhawk.send(link, mavlink.MAVLink_timesync_message(0, stamp))
        if links:
            ground = self.ports.peers[links[0]].port.ground
            asked = [p.link for p in self.ports.peers.values() if p.port.ground == ground]
            self._flush(asked, corrupted=False)
        for link in links:
            self._await(link, stamp)

    def _stamp(self) -> int:
        return BARRIER_OFFSET_NS + round(self.simulation.time_s * 1e9)

    def _await(self, link: LinkId, stamp: int) -> None:
        peer = self.ports.peers.get(link)
        if peer is None or self._pixhawk.timesync_answer_ns(link) == stamp:
            return
        begun = repeated = time.monotonic()
        while self._pixhawk.timesync_answer_ns(link) != stamp and not self.stopping:
            if self._take_one(peer.port):
                continue
            if self.ports.wait(0.1, peer.port):
                continue
            now = time.monotonic()
            if now - begun > self.pace.patience_s:
                self._let_go(peer)
                return
            if now - repeated > REPEAT_S:
                repeated = now
                self._pixhawk.send(link, mavlink.MAVLink_timesync_message(0, stamp))
                self._flush([link], corrupted=False)

    def _let_go(self, peer: Peer) -> None:
        self._waited_for.pop(peer.link, None)
        self._missed[peer.link] = peer.datagrams
        self._say(
            f"{_who(peer)} has been silent for {self.pace.patience_s:g} s:"
            " going on at natural pace without it"
        )

    def _readmit(self) -> None:
        """Wait again for those who speak again, and for a companion that has taken over."""
        for peer in list(self.ports.peers.values()):
            heard = peer.datagrams > self._missed.get(peer.link, peer.datagrams)
            successor = not peer.port.ground and self._pixhawk.heartbeats(peer.link) > 0
            if peer.link in self._missed:
                if heard:
                    del self._missed[peer.link]
                    self._waited_for[peer.link] = peer
                    self._say(f"{_who(peer)} is back")
            elif successor and peer.link not in self._waited_for:
                self._wait_for(peer)
                self._say(f"{_who(peer)} takes part")
                for link in [m for m in self._missed if self._is_companion(m)]:
                    del self._missed[link]

    def _gather(self) -> None:
        """Wait for the first heartbeat of all, then make sure that all have read their mail."""
        begun = said = time.monotonic()
        greeted = float("-inf")
        while True:
            now = time.monotonic()
            if self.stopping:
                return
            self._serve_mocap()
            self._drain(self.ports.companion)
            self._drain(self.ports.ground)
            missing = self._missing()
            if not missing:
                break
            if now - greeted > 0.2:
                greeted = now
                self._pixhawk.announce()
            self._flush()
            if now - begun > self.pace.start_timeout_s:
                raise BridgeError(
                    f"no heartbeat from {' or '.join(missing)} within"
                    f" {self.pace.start_timeout_s:g} s: start it, or use --speed realtime"
                )
            if now - said > 2.0:
                said = now + 3600.0
                self._say(f"waiting for the first heartbeat of {' and of '.join(missing)}")
            self.ports.wait(0.05, self.ports.ground, self.ports.companion)
        for peer in self.ports.peers.values():
            takes_part = not peer.port.ground or self.pace.lockstep_ground
            if takes_part and self._pixhawk.heartbeats(peer.link):
                self._wait_for(peer)
        self._pixhawk.announce()
        companions = [link for link in self._waited_for if self._is_companion(link)]
        stations = [link for link in self._waited_for if not self._is_companion(link)]
        self._barrier(companions)
        self._barrier(stations)

    def _wait_for(self, peer: Peer) -> None:
        self._waited_for[peer.link] = peer
        if not peer.port.ground:
            self._pixhawk.set_pace(peer.link)

    def _missing(self) -> list[str]:
        peers = self.ports.peers.values()
        missing = []
        if self.motive is not None and not self.motive.motive.is_followed:
            missing.append("a NatNet client")
        if not any(not p.port.ground and self._pixhawk.heartbeats(p.link) for p in peers):
            configured = [p for p in peers if not p.port.ground and p.configured]
            missing += [_who(peer) for peer in configured] or ["a companion"]
        if self.pace.lockstep_ground:
            missing += [
                _who(peer)
                for peer in peers
                if peer.port.ground and peer.configured and not self._pixhawk.heartbeats(peer.link)
            ]
        return missing

    # --- both --------------------------------------------------------------------------

    def _step(self) -> None:
        if self._up is not None:
            for link, data in self._up.arrived(self.simulation.time_s):
                self.simulation.receive(link, data)
        self._serve_mocap()
        self.simulation.step()
        self._expose()
        for event in self.simulation.take_events():
            self._say(event)

    def _serve_mocap(self) -> None:
        if self.motive is not None:
            self.motive.serve(self.simulation.time_s)

    def _expose(self) -> None:
        """The hall's cameras see the aircraft as it is now."""
        if self.motive is None:
            return
        world = self.simulation.world
        state, none = world.state, (0.0, 0.0, 0.0)
        place = ned_from_soaring(world.frame, state.x_m, state.y_m, state.z_m)
        q = measure_attitude(world.frame, state, 1, world.time_s, none, none)
        self.motive.step(world.steps, world.time_s, place, (q.qw, q.qx, q.qy, q.qz))

    def _flush(self, links: Sequence[LinkId] | None = None, *, corrupted: bool = True) -> None:
        """Send what is due on some links, or on all; companions get it as faults leave it."""
        down, now = self._down, self.simulation.time_s
        for link, data in self.simulation.take_datagrams(links):
            if down is not None and corrupted and self._is_companion(link):
                down.send(now, (link, data))
            else:
                self.ports.send(link, data)
        if down is not None:
            for link, data in down.arrived(now):
                self.ports.send(link, data)

    def _drain(self, port: Port) -> None:
        for _ in range(BURST):
            if not self._take_one(port):
                return

    def _take_one(self, port: Port) -> bool:
        received = self.ports.receive(port)
        if received is None:
            return False
        peer, data, new = received
        if new:
            self.simulation.add_link(peer.link, ground=port.ground)
            if self.ports.strangers <= STRANGERS_NAMED:
                self._say(f"{_who(peer)} spoke first")
            surplus = self.ports.surplus()
            if surplus is not None:
                self.simulation.remove_link(surplus.link)
                self._waited_for.pop(surplus.link, None)
                self._missed.pop(surplus.link, None)
        if self._up is None or port.ground or _answers_barrier(data):
            self.simulation.receive(peer.link, data)
        else:
            self._up.send(self.simulation.time_s, (peer.link, data))
            for link, arrived in self._up.arrived(self.simulation.time_s):
                self.simulation.receive(link, arrived)
        return True

    def _say(self, text: str) -> None:
        print(f"[{self.simulation.time_s:9.3f} s] {text}", flush=True)

    def summary(self) -> str:
        """One line of what happened."""
        simulation = self.simulation
        ratio = simulation.time_s / self.wall_s if self.wall_s > 0.0 else 0.0
        return (
            f"{simulation.world.steps} steps, {simulation.time_s:.3f} s simulated in"
            f" {self.wall_s:.2f} s ({ratio:.1f} x real time); {simulation.summary()};"
            f" {simulation.crashes} crashes; {self.slowness.given_up_s:.2f} s given up"
        )


def _answers_barrier(data: bytes) -> bool:
    """Whether a datagram is one TIMESYNC: faults leave lockstep alone."""
    return data[:1] == b"\xfd" and data[7:10] == TIMESYNC_ID


def _who(peer: Peer) -> str:
    role = "ground station" if peer.port.ground else "companion"
    return f"the {role} at {peer.address[0]}:{peer.address[1]}"


# --- the command line ------------------------------------------------------------------------


def _address(text: str) -> Address:
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r}: write HOST:PORT, such as 127.0.0.1:14550")
    return host, int(port)


def _number(low: float, high: float) -> Any:
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: a number from {low:g} to {high:g}")
        return value

    return parse


def _whole(low: int, high: int) -> Any:
    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: a whole number from {low} to {high}")
        return int(text)

    return parse


def _setting(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}: write NAME=NUMBER, such as SYSID_MYGCS=255"
        ) from None


def _fault(text: str) -> Fault:
    try:
        return parse_fault(text)
    except FaultError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sitl_bridge",
        description="A simulated Pixhawk with its aircraft and its air, over MAVLink on UDP.",
    )
    add = parser.add_argument
    add("--airframe", type=airframe_file, required=True, help="airframe file, or a shipped name")
    add(
        "--site", type=site_file, required=True,
        help="site file with [air] and [start], or a shipped name",
    )  # fmt: skip
    add(
        "--gcs", type=_address, action="append", metavar="HOST:PORT",
        help="where a ground station listens; repeat for more (default 127.0.0.1:14550)",
    )  # fmt: skip
    add(
        "--companion", type=_address, default=("127.0.0.1", 14540), metavar="HOST:PORT",
        help="where the companion listens (default 127.0.0.1:14540)",
    )  # fmt: skip
    add(
        "--gcs-local", type=_address, default=("127.0.0.1", 18570), metavar="HOST:PORT",
        help="own port towards ground stations (default 127.0.0.1:18570; port 0: any)",
    )  # fmt: skip
    add(
        "--companion-local", type=_address, default=("127.0.0.1", 14580), metavar="HOST:PORT",
        help="own port towards the companion (default 127.0.0.1:14580; port 0: any)",
    )  # fmt: skip
    add("--seed", type=_whole(0, 2**63), default=1, help="of noise and turbulence (default 1)")
    add(
        "--turbulence", type=_number(0.0, 0.5), metavar="FRACTION",
        help="of the reference wind, 0.03 is 3 %% (default: the site's)",
    )  # fmt: skip
    add("--speed", choices=("realtime", "lockstep"), default="realtime")
    add("--lockstep-gcs", action="store_true", help="lockstep waits for ground stations too")
    add("--duration", type=_number(0.0, 1e9), metavar="S", help="simulated seconds to run")
    add("--log", type=Path, metavar="FILE", help="truth as CSV, or .npz")
    add("--log-rate", type=_whole(1, 400), default=50, metavar="HZ", help="(default 50)")
    add("--step-rate", type=int, choices=(200, 400), default=200, help="steps per second")
    add(
        "--pilot", choices=("steady", "none"), default="steady",
        help="who flies while nobody overrides the surfaces (default: a steady safety pilot)",
    )  # fmt: skip
    add(
        "--launch", choices=("held", "free", "bench"), default="held",
        help="held at the start until the first override, let go at once, or disarmed on a bench",
    )  # fmt: skip
    add(
        "--autopilot", choices=("builtin", "px4", "ardupilot"), default="builtin",
        help="the simulated Pixhawk, or a real firmware in its place (default: builtin)",
    )  # fmt: skip
    add("--firmware", type=Path, metavar="PATH", help="the firmware's program")
    add(
        "--firmware-folder", type=Path, default=Path("out/firmware"), metavar="DIR",
        help="where the firmware runs and keeps its files (default out/firmware)",
    )  # fmt: skip
    add("--record", type=Path, metavar="FILE", help="traffic of firmware and companion, as .tlog")
    add("--no-truth", action="store_true", help="send no truth to ground stations")
    add("--odometry", action="store_true", help="stream ODOMETRY, which ArduPlane denies")
    add("--no-pitot", action="store_true", help="VFR_HUD then shows a guess, as ArduPlane does")
    add(
        "--autopilot-parameter", type=_setting, action="append", default=[],
        metavar="NAME=NUMBER", help="a parameter of the autopilot; repeat for more",
    )  # fmt: skip
    add(
        "--uptime", type=_number(0.0, 1e7), default=0.0, metavar="S",
        help="time since boot at the start",
    )  # fmt: skip
    add(
        "--fault", type=_fault, action="append", default=[], metavar="'NAME start=S for=S'",
        help="what goes wrong, as 'position.dropout start=20 for=1.5'; repeat for more;"
        " `--fault list` shows all",
    )  # fmt: skip
    add_motive_options(parser)
    add("--patience", type=_number(0.1, 3600.0), default=5.0, metavar="S", help="(default 5)")
    add("--start-timeout", type=_number(0.1, 3600.0), default=30.0, metavar="S")
    return parser


def _open_ports(arguments: argparse.Namespace) -> Ports:
    ground = Port("ground", "--gcs-local", arguments.gcs_local, ground=True)
    try:
        companion = Port("companion", "--companion-local", arguments.companion_local, ground=False)
    except PortError:
        ground.socket.close()
        raise
    ports = Ports(ground, companion)
    try:
        _add_peer(ports, companion, "--companion", arguments.companion)
        for address in arguments.gcs or [("127.0.0.1", 14550)]:
            _add_peer(ports, ground, "--gcs", address)
    except PortError:
        ports.close()
        raise
    return ports


def _add_peer(ports: Ports, port: Port, option: str, address: Address) -> None:
    host, number = resolved(option, address)
    if port.local[0].startswith("127.") and not host.startswith("127."):
        raise PortError(
            f"{option} {host}:{number} is another machine, and {port.option}"
            f" {port.local[0]}:{port.local[1]} serves this one only:"
            f" add {port.option} 0.0.0.0:{port.local[1]}"
        )
    ports.add(port, (host, number), configured=True)


def _simulation(
    arguments: argparse.Namespace, airframe: Airframe, site: Site, options: Options
) -> Simulated:
    """The simulated Pixhawk, or a real firmware.  Errors: ValueError, OSError, `BridgeError`."""
    folder = arguments.site.parent
    if arguments.autopilot == "builtin":
        return Simulation(airframe, site, options, folder)
    # What a firmware needs is loaded only where there is one.
    from tgl_soar.sim.firmware.simulation import FirmwareSimulation
    from tgl_soar.sim.firmware.starts import STARTS

    if arguments.firmware is None:
        raise ValueError(f"--autopilot {arguments.autopilot}: give its program with --firmware")
    physics, relay = STARTS[arguments.autopilot](
        arguments.firmware, arguments.firmware_folder, airframe, site, dict(options.parameters)
    )
    arguments.step_rate = physics.step_hz
    return FirmwareSimulation(airframe, site, options, folder, physics, relay)


def _list_faults() -> None:
    """Print the catalogue, to its end or as far as it is read: `head` goes when it has enough."""
    try:
        print(catalogue_text(), flush=True)
    except BrokenPipeError:
        # What is still in the buffer would fail once more when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bridge; the exit code: 0 well, 2 wrong set-up, 3 nobody came."""
    words = list(sys.argv[1:] if argv is None else argv)
    if ["--fault", "list"] in [words[i : i + 2] for i in range(len(words))]:
        _list_faults()
        return 0
    arguments = _parser().parse_args(words)
    options = Options(
        seed=arguments.seed,
        turbulence=arguments.turbulence,
        step_hz=arguments.step_rate,
        pilot=arguments.pilot == "steady",
        held=arguments.launch != "free",
        armed=arguments.launch != "bench",
        truth=not arguments.no_truth,
        uptime_s=arguments.uptime,
        allow_odometry=arguments.odometry,
        faults=tuple(arguments.fault),
        pitot=not arguments.no_pitot,
        parameters=tuple(arguments.autopilot_parameter),
        record=arguments.record,
        log=arguments.log,
        log_hz=arguments.log_rate,
    )
    pace = Pace(
        lockstep=arguments.speed == "lockstep",
        lockstep_ground=arguments.lockstep_gcs,
        duration_s=arguments.duration,
        patience_s=arguments.patience,
        start_timeout_s=arguments.start_timeout,
    )
    try:
        airframe, site = load_airframe(arguments.airframe), load_site(arguments.site)
        ports = _open_ports(arguments)
    except (ConfigError, PortError) as error:
        print(f"sitl_bridge: {error}", file=sys.stderr)
        return 2
    try:
        simulation = _simulation(arguments, airframe, site, options)
        motive = motive_server(arguments, site, lambda: simulation.time_s)
    except (ConfigError, PortError, FirmwareError, ValueError) as error:
        print(f"sitl_bridge: {error}", file=sys.stderr)
        ports.close()
        return 2
    except OSError as error:
        print(f"sitl_bridge: --log {options.log}: {error.strerror}", file=sys.stderr)
        ports.close()
        return 2
    bridge = Bridge(simulation, ports, pace, motive)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, bridge.stop)
    code = 0
    try:
        bridge.run()
    except (BridgeError, FirmwareError) as error:
        print(f"sitl_bridge: {error}", file=sys.stderr)
        code = 3
    finally:
        simulation.close()
        ports.close()
        if motive is not None:
            motive.close()
    print(bridge.summary(), flush=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
