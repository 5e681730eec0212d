"""A logged flight through the same laws again.

`replay` gives every tick the inputs that it had, and compares what `autopilot.step` makes of them
with what was logged, bit for bit: a log can be trusted because it can be flown again.  With other
parameters, or another airframe's, it shows what would have been commanded instead.  That is an
open loop: the aircraft does not answer to the other commands.

A replay begins at a logged state, and again at the next one where ticks are missing.  Stretches of
a log are replayed in parallel on all processors; each must end in the state that the next has.

Long logs are flown by the laws' compiled kernel (`compiled_ticks`) where there is one, and where
anything of that differs from the log, by the plain laws, whose result counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise, starmap
from pathlib import Path
from typing import Any, Final, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tgl_soar import __version__
from tgl_soar.analysis.logs.ulog_reader import Array, FlightLog, Topic
from tgl_soar.analysis.replay.compiled_ticks import (
    INPUT_LEAVES,
    OUTPUT_LEAVES,
    Ticks,
    compiled_ticks,
    is_ready,
)
from tgl_soar.autopilot import AutopilotState, initial_state, step
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import airframe_from, load_airframe, load_parameters, site_from
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.onboard.flightlog.topics import (
    STREAMS,
    TOPICS,
    flattener,
    is_named_tuple,
    leaves_of,
    packer,
    rebuilt,
    record_size,
    rows_type,
)
from tgl_soar.onboard.flightlog.writer import clamped
from tgl_soar.onboard.setup import ModuleSetup, laws_of, setup_from
from tgl_soar.sim.campaign.executors import LocalProcesses
from tgl_soar.sim.campaign.run import fly_all
from tgl_soar.types import NAN, NO_ATTITUDE, NO_FIX, AutopilotStatus, Inputs

STRETCH: Final = 2000  # ticks: less is not worth another process
LONG: Final = 20_000  # ticks: for less the compiled kernel is not worth loading
SHOWN: Final = (
    "setpoints_pitch_rad",
    "command_elevator",
    "command_aileron",
    "command_rudder",
)
_BEFORE_ANY: Final[dict[str, Any]] = {
    **Inputs._field_defaults,
    "position": NO_FIX,
    "attitude": NO_ATTITUDE,
    "autopilot": AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False),
}


# Surfaces that are read back answered the commands of then.  Held against others they would seem
# dead, and the module would disengaged: nothing is further from a command than this.
NEVER_DEAD: Final = {"SURF_TOL": PARAMETERS[INDEX["SURF_TOL"]].maximum}


class ReplayError(ValueError):
    """A log that cannot be replayed; the message says why."""


class ReplayDifference(NamedTuple):
    """How one field of the replay differs from the log."""

    name: str
    ticks: int  # so many differ in at least one bit
    largest: float  # inf: a number against none
    time_s: float  # where it is largest


@dataclass(frozen=True)
class Replay:
    """A log and its replay beside it."""

    time_s: Array  # of the ticks that were replayed, shape (n,)
    logged: Mapping[str, Array]  # their columns of the topic `tick`, shape (n,) each
    replayed: Mapping[str, Array]
    differences: list[ReplayDifference]  # the largest first; empty: the same in every bit
    left_out: int  # ticks whose state before is not in the log
    took_s: float  # without compiling
    changed: bool  # with other parameters than those of the log
    notes: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float:
        """Of the ticks."""
        return float(np.abs(np.diff(self.time_s)).sum())

    @property
    def speed(self) -> float:
        """Times real time."""
        return self.duration_s / max(self.took_s, 1e-9)


class _Cut(NamedTuple):
    """Something that happens before a tick of the log."""

    state: AutopilotState | None = None
    reset: bool = False
    gap: bool = False
    laws: Laws | None = None


class _Column(NamedTuple):
    """One field of `Inputs` over the ticks."""

    kind: type
    leaves: list[Array]  # of its rows; the first row: before any
    newest: NDArray[np.int64]  # the row of each tick


class _Flight(NamedTuple):
    """All that a replay needs; workers are forked with it in memory."""

    ticks: NDArray[np.int64]
    stamps: NDArray[np.uint64]
    inputs: list[_Column]  # of `Inputs`, in order
    cuts: dict[int, _Cut]
    changed: bool
    kernel: Ticks | None  # where it is compiled


class _LoggedTicks(NamedTuple):
    """What came of a stretch."""

    rows: bytes
    known: list[tuple[int, int]]  # from tick to tick that could be flown
    torn: list[int]  # ticks after which the state is not the logged one


def replay(
    log: FlightLog,
    *,
    changes: Mapping[str, float] | None = None,
    airframe: str | Path | None = None,
    workers: int | None = None,
    compile: bool | None = None,
) -> Replay:
    """Fly the log's inputs again.

    `changes`: parameters that stand from the beginning on, whatever the log says of them.
    `airframe`: a file whose parameters take the place of the logged airframe's.  `workers`: as
    many processes at most.  `compile`: fly the compiled kernel; None: where it has been compiled
    before and the log is long.  Errors: `ReplayError`, `ConfigError`, `ParameterError`;
    ImportError where it is to be compiled without numba.
    """
    tick = _ticks_of(log)
    notes: list[str] = []
    changed = bool(changes) or airframe is not None
    if changed and log.topics.get("surfaces"):
        changes = {**NEVER_DEAD, **(changes or {})}
        notes.append("the surfaces obeyed the logged commands, and are not held against these")
    if compile is None:
        compile = len(tick["tick"]) >= LONG and is_ready()
    kernel = compiled_ticks() if compile else None
    began = time.perf_counter()
    flight = _prepare(log, tick, dict(changes or {}), airframe, changed, notes, kernel)
    began += _load(flight)  # to compile is no replay
    flown = _fly_all(flight, workers or os.cpu_count() or 1)
    rows = np.concatenate(
        [np.frombuffer(stretch.rows, np.dtype(rows_type("tick"))) for stretch in flown]
    )
    known = np.zeros(len(rows), bool)
    for stretch in flown:
        for begin, end in stretch.known:
            known[begin:end] = True
    torn = [number for stretch in flown for number in stretch.torn]
    if torn and not changed:
        notes.append(f"the state after tick {torn[0]} is not the logged one ({len(torn)} of them)")
    names = [f.name for f in TOPICS["tick"].fields if f.name in tick]
    lacking = [f.name for f in TOPICS["tick"].fields if f.name not in tick]
    if lacking:
        notes.append(f"not in the log, so not compared: {', '.join(lacking)}")
    logged = {name: tick[name][known] for name in names}
    replayed = {name: rows[name][known] for name in names}
    differences = _differences(logged, replayed)
    if compile and not changed and (differences or torn):
        return replay(log, workers=workers, compile=False)
    return Replay(
        time_s=logged["time_s"],
        logged=logged,
        replayed=replayed,
        differences=differences,
        left_out=int(np.count_nonzero(~known)),
        took_s=time.perf_counter() - began,
        changed=changed,
        notes=notes,
    )


def _ticks_of(log: FlightLog) -> Topic:
    if not log.is_ours:
        raise ReplayError(f"{log.path}: not a log of tgl_soar: it has no inputs of our ticks")
    tick = log.topics.get("tick", {})
    if not len(tick.get("tick", ())):
        raise ReplayError(f"{log.path}: no tick in it")
    missing = [name for name in ("time_s", "engage") if name not in tick]
    if missing:
        raise ReplayError(f"{log.path}: another layout: no {', '.join(missing)} in its ticks")
    return tick


# --- what a flight is replayed from -----------------------------------------------------------


def _prepare(
    log: FlightLog,
    tick: Topic,
    changes: dict[str, float],
    airframe: str | Path | None,
    changed: bool,
    notes: list[str],
    kernel: Ticks | None,
) -> _Flight:
    version = log.info.get("ver_sw")
    if version != __version__:
        notes.append(f"flown with version {version}, replayed with {__version__}")
    numbers = tick["tick"].astype(np.int64)
    cuts: dict[int, _Cut] = {}

    def cut(index: int, **what: Any) -> None:
        cuts[index] = cuts.get(index, _Cut())._replace(**what)

    for before_gap in np.flatnonzero(np.diff(numbers) != 1).tolist():
        cut(before_gap + 1, gap=True)
    for number, reset, state in _states(log, notes):
        index = int(np.searchsorted(numbers, number, side="right"))
        # A state belongs to what comes next, unless ticks in between are missing.
        if index < len(numbers) and numbers[index] == number + 1:
            cut(index, state=state, reset=reset or cuts.get(index, _Cut()).reset)
    setup, stands = _configuration(log, airframe, notes)
    for number, values in _parameters(log, stands, changes, notes):
        index = int(np.searchsorted(numbers, number, side="right")) if number >= 0 else 0
        if index < len(numbers):
            cut(index, laws=laws_of(setup, values))
    if 0 not in cuts or cuts[0].state is None:
        begins = numbers[0] == 1
        if begins or not any(c.state for c in cuts.values()):
            notes.append("no state at the beginning: from a module's first tick on")
            cut(0, state=initial_state())
    return _Flight(
        ticks=numbers,
        stamps=tick["timestamp"],
        inputs=_columns(log, tick, numbers),
        cuts=cuts,
        changed=changed,
        kernel=kernel,
    )


def _load(flight: _Flight) -> float:
    """Compile the kernel, or load what was compiled, and tell the seconds that it took."""
    laws = [cut.laws for cut in flight.cuts.values() if cut.laws is not None]
    states = [cut.state for cut in flight.cuts.values() if cut.state is not None]
    began = time.perf_counter()
    if flight.kernel is not None and laws and states:
        none = np.empty((0, len(INPUT_LEAVES))), np.empty((0, len(OUTPUT_LEAVES)))
        flight.kernel(laws[0], states[0], *none)
    return time.perf_counter() - began


def _columns(log: FlightLog, tick: Topic, numbers: NDArray[np.int64]) -> list[_Column]:
    """What each tick had: the newest row of every stream, and its own plain fields."""
    columns = []
    for name, kind in get_type_hints(Inputs).items():
        if name not in STREAMS:
            plain = tick.get(name, np.full(len(numbers), NAN))
            columns.append(_Column(kind, [plain], np.arange(len(numbers))))
            continue
        rows = log.topics.get(name, {})
        leaves = TOPICS[name].leaves
        _check_layout(name, rows)
        before = flattener(leaves)(_BEFORE_ANY[name])
        columns.append(
            _Column(
                kind,
                [
                    np.concatenate([np.array([first], column.dtype), column])
                    for first, column in zip(
                        before,
                        (rows.get(leaf.name, np.empty(0, leaf.kind)) for leaf in leaves),
                        strict=True,
                    )
                ],
                np.searchsorted(rows.get("tick", np.empty(0)), numbers, side="right"),
            )
        )
    return columns


def _check_layout(name: str, rows: Topic) -> None:
    missing = [leaf.name for leaf in TOPICS[name].leaves if leaf.name not in rows]
    if rows and missing:
        raise ReplayError(f"another layout: no {', '.join(missing)} in {name}")


def _tuples(kind: type, leaves: list[Array]) -> list[Any]:
    """The rows of some columns as what they were: tuples of tuples, tuples, or plain numbers."""
    columns: list[list[Any]] = [leaf.tolist() for leaf in leaves]
    if not is_named_tuple(kind):
        return columns[0]
    table = zip(*columns, strict=True)
    if any(map(is_named_tuple, get_type_hints(kind).values())):
        return [rebuilt(kind, iter(row)) for row in table]
    return list(starmap(kind, table))


def _states(log: FlightLog, notes: list[str]) -> list[tuple[int, bool, AutopilotState]]:
    rows = log.topics.get("state", {})
    try:
        _check_layout("state", rows)
    except ReplayError as error:
        notes.append(f"{error}: its states are not used")
        return []
    if not rows:
        return []
    states = _tuples(AutopilotState, [rows[leaf.name] for leaf in leaves_of(AutopilotState)])
    return list(zip(rows["tick"].tolist(), rows["reset"].tolist(), states, strict=True))


def _configuration(
    log: FlightLog, airframe: str | Path | None, notes: list[str]
) -> tuple[ModuleSetup, dict[str, float]]:
    """What the module was set up with, and the parameters that another airframe file changes."""
    missing = [name for name in ("airframe", "site") if name not in log.texts]
    if missing:
        raise ReplayError(f"{log.path}: it does not hold the {missing[0]} file")
    names = {name: f"{name} in {log.path.name}" for name in ("airframe", "site")}
    site = site_from(log.texts["site"], names["site"])
    logged = airframe_from(log.texts["airframe"], names["airframe"])
    before = _files_values(logged, names["airframe"], site, log)
    if airframe is None:
        return setup_from(logged, site, before), {}
    other = load_airframe(airframe)
    after = _files_values(other, airframe, site, log)
    stands = {p.name: new for (p, old), (_, new) in zip(before, after, strict=True) if old != new}
    notes.append(f"of {airframe}: {len(stands)} parameters are others")
    return setup_from(other, site, after), stands


def _files_values(airframe: Airframe, path: str | Path, site: Site, log: FlightLog) -> ParameterSet:
    return load_parameters(airframe, path, site, f"site in {log.path.name}")


class _Watched(ParameterSet):
    """Remembers what is read."""

    __slots__ = ("read",)

    def __init__(self) -> None:
        super().__init__()
        self.read: set[str] = set()

    def __getitem__(self, name: str) -> float:
        self.read.add(name)
        return super().__getitem__(name)


@cache
def read_by_laws() -> frozenset[str]:
    """The parameters of which `autopilot.step` takes any notice."""
    values = _Watched()
    laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0))
    return frozenset(values.read)


def _parameters(
    log: FlightLog, stands: dict[str, float], changes: dict[str, float], notes: list[str]
) -> list[tuple[int, ParameterSet]]:
    """(tick after which they act, values), the first at -1."""
    unknown = sorted(name for name in log.parameters if name not in INDEX)
    if unknown:
        notes.append(f"unknown by now, passed over: {', '.join(unknown)}")
    known = {name: float(value) for name, value in log.parameters.items() if name in INDEX}
    for name in changes:
        if name not in INDEX:
            raise ParameterError(name, changes[name], "no such parameter; see `tgl-soar params`")
        if name not in read_by_laws():
            why = (
                "no law reads it, so nothing would be commanded otherwise: a replay has the inputs"
            )
            raise ParameterError(name, changes[name], f"{why} as they were logged")
    values = ParameterSet().changed({**known, **stands, **changes})
    found = [(-1, values)]
    waiting: dict[int, dict[str, float]] = {}
    for change in log.changes:
        if change.name in INDEX and change.name not in changes:
            waiting.setdefault(change.tick, {})[change.name] = float(change.value)
    for number, group in sorted(waiting.items()):
        try:
            values = values.changed(group)
        except ParameterError as error:
            notes.append(f"after tick {number}: {error}: passed over")
            continue
        found.append((number, values))
    return found


# --- flying it --------------------------------------------------------------------------------


def _fly_all(flight: _Flight, workers: int) -> list[_LoggedTicks]:
    """The whole flight, in stretches side by side where that is worth it."""
    stretches = list(pairwise(_edges(flight, workers)))
    if flight.kernel is not None or len(stretches) == 1:
        return [_fly(flight, 0, len(flight.ticks))]
    return fly_all(partial(_fly_stretch, flight), stretches, LocalProcesses(len(stretches)))


def _fly_stretch(flight: _Flight, edges: tuple[int, int]) -> _LoggedTicks:
    return _fly(flight, *edges)


def _edges(flight: _Flight, workers: int) -> list[int]:
    """Where stretches begin and end: at logged states, evenly."""
    count = len(flight.ticks)
    workers = min(workers, count // STRETCH)
    edges = [0, count]
    if flight.changed:
        return edges  # another past leaves another state
    possible = np.array(sorted(i for i, cut in flight.cuts.items() if cut.state is not None))
    for i in range(1, workers):
        at = np.searchsorted(possible, i * count // workers)
        if at < len(possible):
            edges.append(int(possible[at]))
    return sorted(set(edges))


def _fly(flight: _Flight, begin: int, end: int) -> _LoggedTicks:
    """From one tick to before another."""
    size = record_size("tick")
    rows = bytearray(size * (end - begin))
    known: list[tuple[int, int]] = []
    torn: list[int] = []
    laws = next(
        flight.cuts[i].laws
        for i in sorted(flight.cuts, reverse=True)
        if i <= begin and flight.cuts[i].laws is not None
    )
    state: AutopilotState | None = None
    edges = sorted({begin, end, *(i for i in flight.cuts if begin < i < end)})
    for here, there in pairwise(edges):
        cut = flight.cuts.get(here, _Cut())
        state = _taken_up(flight, here, cut, state, torn)
        laws = cut.laws or laws
        assert laws is not None
        if state is not None:
            state = _stretch(flight, laws, state, here, there, rows, (here - begin) * size)
            known.append((here, there))
    last = flight.cuts.get(end)
    if last is not None and end < len(flight.ticks):
        _taken_up(flight, end, last, state, torn)
    return _LoggedTicks(bytes(rows), known, torn)


def _taken_up(
    flight: _Flight,
    index: int,
    cut: _Cut,
    state: AutopilotState | None,
    torn: list[int],
) -> AutopilotState | None:
    """The state from which a tick is flown."""
    if cut.gap:
        state = None
    if cut.state is None:
        return state
    if state is None or cut.reset:
        return cut.state
    if flight.changed:
        return state
    if not _same(state, cut.state):
        torn.append(int(flight.ticks[index]) - 1)
    return cut.state


def _same(a: Any, b: Any) -> bool:
    """Whether two tuples of tuples hold the same, NaN being itself."""
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(a == b or (a != a and b != b))


def _stretch(
    flight: _Flight,
    laws: Laws,
    state: AutopilotState,
    begin: int,
    end: int,
    rows: bytearray,
    at: int,
) -> AutopilotState:
    """Ticks under the same laws, as the writer packs them; the state that they leave."""
    if flight.kernel is not None:
        return _stretch_compiled(flight, flight.kernel, laws, state, begin, end, rows, at)
    pack, size = packer("tick"), record_size("tick")
    numbers, stamps = flight.ticks[begin:end].tolist(), flight.stamps[begin:end].tolist()
    for number, stamp, inputs in zip(numbers, stamps, _inputs(flight, begin, end), strict=True):
        state, output = step(laws, state, inputs)
        try:
            pack(rows, at, stamp, number, inputs, output)
        except OverflowError:
            pack(rows, at, stamp, number, clamped(inputs), clamped(output))
        at += size
    return state


def _inputs(flight: _Flight, begin: int, end: int) -> list[Inputs]:
    """Of some ticks, in plain tuples."""
    columns = []
    for kind, leaves, newest in flight.inputs:
        here = newest[begin:end]
        first, last = int(here.min()), int(here.max())
        rows = _tuples(kind, [leaf[first : last + 1] for leaf in leaves])
        columns.append([rows[i] for i in (here - first).tolist()])
    return [Inputs._make(values) for values in zip(*columns, strict=True)]


def _stretch_compiled(
    flight: _Flight,
    kernel: Ticks,
    laws: Laws,
    state: AutopilotState,
    begin: int,
    end: int,
    rows: bytearray,
    at: int,
) -> AutopilotState:
    given = np.column_stack(
        [
            leaf[newest[begin:end]].astype(np.float64)
            for _, leaves, newest in flight.inputs
            for leaf in leaves
        ]
    )
    taken = np.empty((end - begin, len(OUTPUT_LEAVES)))
    state = kernel(laws, state, given, taken)
    row = np.frombuffer(rows, np.dtype(rows_type("tick")), end - begin, at)
    row["timestamp"], row["tick"] = flight.stamps[begin:end], flight.ticks[begin:end]
    columns = dict(zip((leaf.name for leaf in INPUT_LEAVES), given.T, strict=True))
    columns |= zip((leaf.name for leaf in OUTPUT_LEAVES), taken.T, strict=True)
    with np.errstate(over="ignore"):  # beyond the largest lies infinity
        for field in TOPICS["tick"].fields[len(("timestamp", "tick")) :]:
            kind = row.dtype[field.name]
            row[field.name] = (
                columns[field.name].clip(np.iinfo(kind).min, np.iinfo(kind).max)
                if kind.kind in "iu"
                else columns[field.name]
            )
    return state


def _differences(
    logged: Mapping[str, Array], replayed: Mapping[str, Array]
) -> list[ReplayDifference]:
    """Fields that are not the same in every bit; any NaN is as good as another."""
    found = []
    for name, a in logged.items():
        b = replayed[name]
        if a.tobytes() == b.tobytes():
            continue
        x, y = a.astype(np.float64), b.astype(np.float64)
        unlike = ~((x == y) | (np.isnan(x) & np.isnan(y)))
        if not unlike.any():
            continue
        with np.errstate(invalid="ignore"):
            size = np.where(unlike, np.nan_to_num(np.abs(x - y), nan=np.inf), 0.0)
        worst = int(np.argmax(size))
        at = float(logged["time_s"][worst])
        found.append(ReplayDifference(name, int(unlike.sum()), float(size[worst]), at))
    return sorted(found, key=lambda d: d.largest, reverse=True)
