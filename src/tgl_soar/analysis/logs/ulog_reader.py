"""Reading a ULog, ours or another's, as far as it can be read.  On the ground only.

`read_log(path)` gives a `FlightLog`:

    topics      {"tick": {"timestamp": array, "vehicle_x_m": array, …}, …}, arrays of shape (n,)
                of the row's own type; times in µs in `timestamp`, and in `time_s` where a topic
                has it; a second instance of a topic is "name#1" (only others' logs have any)
                what our logs hold every eighth tick, `slow`, is also spread over `tick`
    parameters  at the beginning, by name
    changes     parameters that changed, in order
    words       texts for the operator, in order
    info        versions, names, how it was started
    texts       whole files: of our logs "airframe" and "site", TOML
    losses      what could not be read, in words; empty: nothing is missing

What the fields of our topics mean: docs/logs.md.  A power loss cuts a log anywhere, a full disk
fills its end with zeros, a bad card flips bits: whole messages before and after are used.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.subscriptions import Message, unfounded
from tgl_soar.onboard.flightlog.topics import VERSION

Array = NDArray[Any]
Topic = dict[str, Array]

_MAGIC: Final = b"ULog\x01\x12\x35"
_HEADER: Final = 16
_KINDS: Final = frozenset(b"BFIMPQARDLCSO")
_DEFINITIONS: Final = frozenset(b"BFIMPQ")
_BEGINNINGS: Final = frozenset(b"ALC")  # of the data
_ALIKE: Final = 4  # so many messages in a row are no accident
_SEARCHED: Final = 1_000_000  # bytes after damage
_FORMAT: Final = 1  # the file format's newest version
_CHANGE: Final = ("tick", "timestamp", "index", "value")  # of our topic `parameter`
# How names of columns began in our layout 1, and how the same ones begin now.
_LAYOUT_1: Final = (
    ("afresh", "reset"),
    ("imu_share", "imu_weight"),
    ("throttle_share", "throttle_fraction"),
    ("wind_belief_", "wind_posterior_"),
    ("motion_turning_", "motion_attitude_track_"),
    ("passage_glide_turning_", "launch_landing_glide_airspeed_error_"),
    ("passage_", "launch_landing_"),
)
_LAYOUTS: Final = ("1", str(VERSION))  # that are read without a loss
LEAP_S: Final = 60.0  # no row of any topic for so long: the clock leapt, or nothing was logged


class LogError(ValueError):
    """A file of which nothing can be read; the message says why."""


class ParameterChange(NamedTuple):
    """A parameter has changed."""

    tick: int  # it acts from the tick after this one on; 0 in others' logs
    time_s: float
    name: str
    value: float


class Words(NamedTuple):
    """A text for the operator."""

    time_s: float
    severity: int  # MAVLink's: 0 the worst, 6 information
    text: str


@dataclass(frozen=True)
class FlightLog:
    """What a ULog holds; the module's docstring says how."""

    path: Path
    topics: Mapping[str, Topic]
    parameters: Mapping[str, float]
    changes: list[ParameterChange] = field(default_factory=list)
    words: list[Words] = field(default_factory=list)
    info: Mapping[str, Any] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)

    @property
    def is_ours(self) -> bool:
        """Whether tgl_soar wrote it."""
        return self.info.get("sys_name") == "tgl_soar"

    @property
    def duration_s(self) -> float:
        """From the first tick to the last; of others' logs, from the first row to the last."""
        topics = [self.topics["tick"]] if "tick" in self.topics else list(self.topics.values())
        times = [t["timestamp"] for t in topics if len(t.get("timestamp", ()))]
        if not times:
            return 0.0
        return float(max(t.max() for t in times) - min(t.min() for t in times)) * 1e-6


def read_log(path: str | Path) -> FlightLog:
    """Read a ULog.  Errors: `LogError`; ImportError without pyulog."""
    path = Path(path)
    return log_from(bytes_of(path), path)


def bytes_of(path: Path) -> bytes:
    """All of a file.  Errors: `LogError`."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None


def log_from(data: bytes, path: Path) -> FlightLog:
    """A ULog's bytes; path: what it and its errors call it.  Errors: as `read_log`."""
    try:
        from pyulog import ULog
    except ImportError as error:
        raise ImportError("reading logs needs pyulog: install tgl_soar[logs]") from error
    if not data:
        raise LogError(f"{path}: empty: nothing was logged")
    if len(data) < _HEADER or not data.startswith(_MAGIC):
        raise LogError(f"{path}: not a ULog: it does not begin as one")
    whole, losses = _whole_messages(data)
    if data[len(_MAGIC)] > _FORMAT:
        losses.append(f"ULog of version {data[len(_MAGIC)]}, read as version {_FORMAT}")
    try:
        with redirect_stdout(io.StringIO()):  # what it would say is said by `losses`
            ulog = ULog(io.BytesIO(whole), disable_str_exceptions=True)
    except MemoryError:  # no fault of the file's, or one that must not be taken for an answer
        raise
    except Exception as error:  # whatever pyulog thinks of these bytes
        raise LogError(f"{path}: cannot be read: {error}") from None
    topics: dict[str, Topic] = {}
    for dataset in ulog.data_list:
        name = dataset.name if dataset.multi_id == 0 else f"{dataset.name}#{dataset.multi_id}"
        flags = {f.field_name for f in dataset.field_data if f.type_str == "bool"}
        topics[name] = {
            key: column.astype(bool) if key in flags else column
            for key, column in dataset.data.items()
        }
    info = dict(ulog.msg_info_dict)
    if info.get("sys_name") == "tgl_soar" and info.get("ver_log") == "1":
        topics = {name: _renamed(topic) for name, topic in topics.items()}
    _spread_slow(topics)
    log = FlightLog(
        path=path,
        topics=topics,
        parameters=dict(ulog.initial_parameters),
        changes=_changes(topics, ulog),
        words=[
            Words(m.timestamp * 1e-6, m.log_level - ord("0"), m.message)
            for m in ulog.logged_messages
        ],
        info=info,
        texts={
            key: "".join(map(str, values[0])) for key, values in ulog.msg_info_multiple_dict.items()
        },
        losses=losses,
    )
    losses += [
        f"nothing was written for {d.duration} ms: disk or computer were too slow"
        for d in ulog.dropouts
    ]
    losses += _gaps(log)
    return log


def _renamed(topic: Topic) -> Topic:
    """The columns of a topic of layout 1 by today's names."""
    renamed = {}
    for name, column in topic.items():
        old, new = next((pair for pair in _LAYOUT_1 if name.startswith(pair[0])), ("", ""))
        renamed[new + name.removeprefix(old)] = column
    return renamed


def _spread_slow(topics: dict[str, Topic]) -> None:
    """Put what is logged every eighth tick into the rows of the ticks."""
    tick, slow = topics.get("tick", {}), topics.get("slow", {})
    if not len(slow.get("tick", ())) or "tick" not in tick:
        return
    nearest = np.searchsorted(slow["tick"], tick["tick"]).clip(max=len(slow["tick"]) - 1)
    for name, column in slow.items():
        tick.setdefault(name, column[nearest])


def _whole_messages(data: bytes) -> tuple[bytes, list[str]]:
    """The file without what is no message, and what was left out."""
    pieces, losses = [data[:_HEADER]], []
    begin = at = _HEADER
    end = len(data)
    while at < end:
        after = _after(data, at, end)
        if after:
            at = after
            continue
        pieces.append(data[begin:at])
        begin = _next_message(data, at, end)
        losses.append(
            f"damaged: {begin - at} bytes at byte {at} are left out"
            if begin < end
            else f"cut off: the last {end - at} bytes are no whole message"
        )
        at = begin
    pieces.append(data[begin:at])
    whole = b"".join(pieces)
    left_out, damaged = unfounded(whole, _messages(whole))
    losses += damaged
    return _defined_first(_without(whole, left_out), losses), losses


def _messages(whole: bytes) -> Iterator[Message]:
    """The messages of a file that holds whole ones only."""
    at, end = _HEADER, len(whole)
    while at < end:
        after = _after(whole, at, end)
        yield Message(whole[at + 2], at + 3, after)
        at = after


def _without(whole: bytes, bodies: set[int]) -> bytes:
    """The file without the messages whose bodies begin at these places."""
    pieces, at = [], 0
    for body in sorted(bodies):
        pieces.append(whole[at : body - 3])
        at = _after(whole, body - 3, len(whole))
    return b"".join((*pieces, whole[at:]))


def _defined_first(whole: bytes, losses: list[str]) -> bytes:
    """Whole messages without data that come before anything is subscribed to.

    No reader can use them, and among them pyulog (1.3.0) seeks back without end.
    """
    kept, left_out = [whole[:_HEADER]], 0
    at, end = _HEADER, len(whole)
    while at < end and whole[at + 2] not in _BEGINNINGS:
        after = _after(whole, at, end)
        if whole[at + 2] in _DEFINITIONS:
            kept.append(whole[at:after])
        else:
            left_out += 1
        at = after
    if left_out:
        losses.append(f"damaged: {left_out} messages before the first subscription are left out")
    return b"".join((*kept, whole[at:]))


def _after(data: bytes, at: int, end: int) -> int:
    """Where the message ends that begins here; 0 if none does."""
    if at + 3 > end or data[at + 2] not in _KINDS:
        return 0
    after = at + 3 + (data[at] | data[at + 1] << 8)
    return after if after <= end else 0


def _next_message(data: bytes, at: int, end: int) -> int:
    """Where, after damage, messages begin again; the end if nowhere."""
    for start in range(at + 1, min(end, at + _SEARCHED)):
        follows, found = start, 0
        while found < _ALIKE and follows < end:
            follows = _after(data, follows, end)
            if not follows:
                break
            found += 1
        if found == _ALIKE or (follows == end and found > 1):
            return start
    return end


def _changes(topics: Mapping[str, Topic], ulog: Any) -> list[ParameterChange]:
    """Parameters that changed: of our logs with the tick, of others' without."""
    ours = topics.get("parameter", {})
    if not ours.keys() >= set(_CHANGE):
        return [
            ParameterChange(0, t * 1e-6, name, float(value))
            for t, name, value in ulog.changed_parameters
            if isinstance(value, int | float)  # damage may have made it no number
        ]
    rows = zip(*(ours[name].tolist() for name in _CHANGE), strict=True)
    names = list(ulog.initial_parameters)  # the log's own: another version may have others
    return [
        ParameterChange(tick, t * 1e-6, names[index], value)
        for tick, t, index, value in rows
        if index < len(names)
    ]


def _gaps(log: FlightLog) -> list[str]:
    """What is missing between the rows, or stands in them in a wrong order."""
    losses = []
    ticks = log.topics.get("tick", {})
    if log.is_ours:
        if (version := log.info.get("ver_log")) not in _LAYOUTS:
            losses.append(f"written with layout {version}, read with {VERSION}: fields may differ")
        if not len(ticks.get("tick", ())):
            losses.append("no tick was logged")
    if "tick" in ticks:
        steps = np.diff(ticks["tick"].astype(np.int64))
        losses += [
            f"{steps[i] - 1} ticks are missing after tick {ticks['tick'][i]}"
            for i in np.flatnonzero(steps != 1)[:10]
        ]
    for name, topic in log.topics.items():
        times = topic.get("timestamp")
        if times is not None and np.any(back := np.diff(times.astype(np.int64)) < 0):
            at = times[int(np.argmax(back))] * 1e-6
            losses.append(f"{name}: the clock goes back after {at:.3f} s, {int(back.sum())} times")
    every = [topic["timestamp"] for topic in log.topics.values() if "timestamp" in topic]
    times_s = np.sort(np.concatenate(every)) * 1e-6 if every else np.empty(0)
    gaps_s = np.diff(times_s)
    losses += [
        f"{gaps_s[i]:.4g} s without a row after {times_s[i]:.3f} s: the clock leapt or nothing was"
        " logged"
        for i in np.flatnonzero(gaps_s > LEAP_S)[:10]
    ]
    return losses
