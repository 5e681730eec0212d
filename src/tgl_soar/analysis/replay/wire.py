"""A flight replayed from the wire: a `.tlog`, as this module or a ground station has recorded it.

The frames of the autopilot go through the whole module again, as they came.  What the module said
its parameters were is set again when it said so; `OP_ENGAGE` among them engages it.  Where the
recording begins in flight, it is engaged when telemetry first tells so.  Its other words are
compared with those that it has now.

This is no replay bit for bit.  A frame that the ground station lost is missing, times are those
of arrival at whoever recorded it, and what the module itself saw may have been more.  Where the
vehicle's own clock did not run with the recorder's (a simulation faster than real time) each
attitude is one tick, at its own stamp.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.tlog import STAMP
from tgl_soar.analysis.logs.ulog_reader import Array, LogError
from tgl_soar.analysis.replay.logged import NEVER_DEAD
from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.config.files import load_flight
from tgl_soar.config.parameters import INDEX, ParameterError
from tgl_soar.control.supervisor import is_flying
from tgl_soar.link.clock import ClockMap
from tgl_soar.link.frames import first_frame
from tgl_soar.onboard.flightlog.recorder import Recorder
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.onboard.telemetry_values import FAST, fast_value
from tgl_soar.types import Inputs

GAP_S: Final = 5.0  # a silence that is passed over
_SEARCHED: Final = 300  # a frame is no longer
_SAME_PACE: Final = 0.1  # by how much the vehicle's clock may differ from the recorder's
_LATE_S: Final = 0.1  # against the earliest, for so long as below: no link, a clock that stood
_LATE_FOR_S: Final = 0.5


class TlogFrame(NamedTuple):
    """One frame of a `.tlog`."""

    unix_us: int
    data: bytes


class WireFlight(NamedTuple):
    """A number that the module reported, then and now."""

    time_s: float
    reported: float
    replayed: float


@dataclass(frozen=True)
class WireReplay:
    """What the module makes of the frames."""

    outputs: list[Output]
    inputs: list[Inputs]
    compared: Mapping[str, list[WireFlight]]  # by `telemetry_values.FAST`
    seconds: float  # of the recording
    missed: bool  # then it flew, now it never did
    took_s: float
    notes: list[str]
    losses: list[str]  # what of the recording could not be read; among the notes too

    def column(self, name: str) -> Array:
        """A field of the outputs over the ticks, by its dotted name."""
        values: list[Any] = list(self.outputs)
        for part in name.split("."):
            values = [getattr(value, part) for value in values]
        return np.array(values)


def read_wire(path: str | Path) -> tuple[list[TlogFrame], list[str]]:
    """The frames of a `.tlog`, and what of it is none.  Errors: `LogError`."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    if not data:
        raise LogError(f"{path}: empty: nothing was recorded")
    frames: list[TlogFrame] = []
    lost = at = right = 0
    while at < len(data):
        length, checked = _length(data, at + STAMP)
        right += checked
        if length:
            end = at + STAMP + length
            frames.append(
                TlogFrame(int.from_bytes(data[at : at + STAMP], "big"), data[at + STAMP : end])
            )
            at = end
        else:
            at, lost = at + 1, lost + 1
    if not right:
        raise LogError(f"{path}: not a .tlog: not one MAVLink frame with a right checksum in it")
    losses = [f"{lost} bytes are no frame with a time stamp"] if lost else []
    back = sum(b.unix_us < a.unix_us for a, b in pairwise(frames))
    if back:
        losses.append(f"the recorder's clock goes back {back} times")
    return frames, losses


def _length(data: bytes, at: int) -> tuple[int, bool]:
    """Of the frame that begins here, 0 if none does; and whether its checksum is known and right.

    Unknown ones must be followed by another.
    """
    head = data[at : at + 10]
    if len(head) < 8 or head[0] not in (0xFD, 0xFE):
        return 0, False
    if frame := first_frame(data[at : at + _SEARCHED]):
        return len(frame), True
    is_v2 = head[0] == 0xFD
    if (int.from_bytes(head[7:10], "little") if is_v2 else head[5]) in mavlink.mavlink_map:
        return 0, False  # its checksum is wrong
    length = head[1] + (12 + 13 * (head[2] & 1) if is_v2 else 8)
    end = at + length
    follows = end == len(data) or data[end + STAMP : end + STAMP + 1] in (b"\xfd", b"\xfe")
    return length if follows else 0, False


class _Memory(Recorder):
    """Keeps every tick in memory."""

    def __init__(self) -> None:
        self.inputs: list[Inputs] = []
        self.outputs: list[Output] = []

    def tick(self, inputs: Inputs, output: Output, state: AutopilotState) -> None:  # noqa: ARG002
        self.inputs.append(inputs)
        self.outputs.append(output)


class _Again:
    """What was recorded happens to the module again; its own words are compared."""

    def __init__(
        self, onboard: Onboard, own: tuple[int, int], operator: int, changes: Mapping[str, float]
    ) -> None:
        """own: the module's system and component.  changes: parameters that are not set again."""
        self.now_s = 0.0
        self.compared: dict[str, list[WireFlight]] = {name: [] for name in FAST}
        self.was_flying = False  # as the recording has it
        self.notes: list[str] = []
        self._onboard = onboard
        self._own = own
        self._operator = mavlink.MAVLink(None, operator, 190)
        self._changes = changes
        self._asked = False  # to engage

    def take(self, frame: TlogFrame, message: Any, now_s: float) -> None:
        """One frame, and its message; None: it is none that pymavlink knows."""
        self.now_s = now_s
        source = (message.get_srcSystem(), message.get_srcComponent()) if message else (0, 0)
        kind = message.get_type() if message else ""
        if source == (self._own[0], 1):
            self._onboard.event(frame.data, now_s)
        elif source == self._own and kind == "PARAM_VALUE":
            self._asked |= message.param_id == "OP_ENGAGE"
            self._set_again(message.param_id, message.param_value)
        elif source == self._own and kind == "NAMED_VALUE_FLOAT":
            self._compare(message.name, message.value)

    def _compare(self, name: str, value: float) -> None:
        """A number of the telemetry with that of now; `soar_mode` engages too."""
        output = self._onboard.output
        if name == "soar_mode" and isfinite(value) and is_flying(int(value)):
            self.was_flying = True
            if not self._asked and (output is None or not output.active):  # refused until it can
                self._set("OP_ENGAGE", 1.0)
            elif not self._asked:
                self._asked = True
                self.notes.append(
                    f"it flies when first received: engaged before {self.now_s:.1f} s"
                )
        if name in self.compared and output is not None:
            replayed = fast_value(output, FAST.index(name))
            self.compared[name].append(WireFlight(self.now_s, value, replayed))

    def _set_again(self, name: str, value: float) -> None:
        """What the recorded module reports as its parameter, this one is set to."""
        if name in self._changes or name not in INDEX or not isfinite(value):
            return
        stands = self._onboard.parameters.values[name]
        if name == "OP_ENGAGE":  # 2 is shown, 1 is set
            value, stands = min(value, 1.0), min(stands, 1.0)
        if value != stands:
            self._set(name, value)

    def _set(self, name: str, value: float) -> None:
        order = mavlink.MAVLink_param_set_message(*self._own, name.encode(), value, 9)
        self._onboard.event(bytes(order.pack(self._operator)), self.now_s)


def replay_wire(
    path: str | Path,
    airframe_path: str | Path,
    site_path: str | Path,
    changes: Mapping[str, float] | None = None,
) -> WireReplay:
    """Send the autopilot's frames of a `.tlog` through the module again.

    Errors: `LogError`, `ConfigError`, `ParameterError`.
    """
    frames, losses = read_wire(path)
    notes = list(losses)
    airframe, site, values = load_flight(airframe_path, site_path)
    link = airframe.autopilot
    own = (link.system_id, link.component_id)
    decoded = list(_decoded(frames))
    arrivals_s = _arrivals(frames)
    reported = _first_values(decoded, own)
    changes = {**NEVER_DEAD, **(changes or {})}
    try:
        values = values.changed({**reported, **changes})
    except ParameterError as error:
        if error.name in changes:
            raise
        notes.append(f"{error}: the values of the files are used")
        values = values.changed(changes)
    lockstep = not _keeps_pace(decoded, arrivals_s, own[0])
    notes.insert(0, "replayed from the wire: not bit for bit, the module may have received more")
    if not reported:
        notes.append("it said no parameters: those of the files are used")
    if lockstep:
        notes.append("the vehicle's clock did not run with the recorder's: a tick each attitude")

    memory = _Memory()
    onboard = Onboard(
        setup_from(airframe, site, values),
        lambda _frame: True,
        0.0,
        ModuleOptions(lockstep=lockstep, recorder=memory),
    )
    began = time.perf_counter()
    again = _Again(onboard, own, min(link.operators), changes)
    for (frame, message), at_s in zip(decoded, arrivals_s, strict=True):
        while not lockstep and onboard.clocking.wake_s(again.now_s) < at_s:
            again.now_s = onboard.clocking.wake_s(again.now_s)
            onboard.periodic(again.now_s)
        again.take(frame, message, at_s)
        if onboard.clocking.due(at_s):
            onboard.periodic(at_s)
    took = time.perf_counter() - began
    notes += again.notes
    missed = again.was_flying and not any(output.active for output in memory.outputs)
    if missed:
        notes.append(
            "it flew, and does not in the replay: what it needs to engage is not in the recording,"
            " or its files are others (--airframe, --site)"
        )
    return WireReplay(
        outputs=memory.outputs,
        inputs=memory.inputs,
        compared=again.compared,
        seconds=again.now_s,
        missed=missed,
        took_s=took,
        notes=notes,
        losses=losses,
    )


def _decoded(frames: list[TlogFrame]) -> Iterator[tuple[TlogFrame, Any]]:
    """Every frame with its message; None where pymavlink makes nothing of it."""
    decoder = mavlink.MAVLink(None)
    for frame in frames:
        try:
            yield frame, decoder.decode(bytearray(frame.data))
        except mavlink.MAVError:
            yield frame, None


def _first_values(decoded: list[tuple[TlogFrame, Any]], own: tuple[int, int]) -> dict[str, float]:
    """What the module first said of each of its parameters, unless it was set before."""
    found: dict[str, float] = {}
    was_set: set[str] = set()
    for _, message in decoded:
        kind = message.get_type() if message is not None else ""
        if kind == "PARAM_SET" and (message.target_system, message.target_component) == own:
            was_set.add(message.param_id)
        elif (
            kind == "PARAM_VALUE"
            and message.param_id not in was_set
            and (message.get_srcSystem(), message.get_srcComponent()) == own
        ):
            found.setdefault(message.param_id, message.param_value)
    return {n: v for n, v in found.items() if n in INDEX and n not in ("OP_ENGAGE", "TGL_STAGE")}


def _arrivals(frames: list[TlogFrame]) -> list[float]:
    """When each frame was recorded, from the first on, without silences and leaps of the clock."""
    times_s = [0.0]
    for before, after in pairwise(frames):
        step_s = (after.unix_us - before.unix_us) * 1e-6
        times_s.append(times_s[-1] + (step_s if 0.0 <= step_s <= GAP_S else 0.0))
    return times_s


def _keeps_pace(decoded: list[tuple[TlogFrame, Any]], arrivals_s: list[float], system: int) -> bool:
    """Whether the vehicle's clock runs with the recorder's, all the time.

    The clock of a simulation that waits for a slow computer stands meanwhile: from then on every
    frame is late, and not one of them as early as before.
    """
    stamps = [
        (arrival_s, message.time_boot_ms * 1e-3)
        for (_, message), arrival_s in zip(decoded, arrivals_s, strict=True)
        if message is not None
        and message.get_type() == "ATTITUDE_QUATERNION"
        and message.get_srcSystem() == system
    ]
    if len(stamps) < 2:
        return True
    (ours, theirs), (ours_last, theirs_last) = stamps[0], stamps[-1]
    passed, reported = ours_last - ours, theirs_last - theirs
    clocks = ClockMap()
    timely_s = ours
    for arrival_s, stamp_s in stamps:
        if arrival_s - clocks.observe(stamp_s, arrival_s) <= _LATE_S:
            timely_s = arrival_s
        elif arrival_s - timely_s > _LATE_FOR_S:
            return False
    return bool(abs(reported - passed) <= _SAME_PACE * abs(passed))


def rms(received: list[WireFlight]) -> float:
    """Of the differences between then and now; NaN where there is nothing to compare."""
    squares = [
        (h.reported - h.replayed) ** 2 for h in received if isfinite(h.reported - h.replayed)
    ]
    return float(np.sqrt(np.mean(squares))) if squares else nan
