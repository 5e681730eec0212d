"""Asking the autopilot for its messages at the rates that the loop needs.

One MAV_CMD_SET_MESSAGE_INTERVAL at a time, for its acknowledgement does not name the message.  On a
slow line it may come when the next one is asked for already: a refusal that may be that of the one
before is not accepted until it comes once more.
A stream that does not come, or comes too slowly, is requested again, ever less often.  A rate that
is refused is reported once, with the way out, and a lower one is requested.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from tgl_soar.link.messages import (
    COMMAND_SET_MESSAGE_INTERVAL,
    COMPONENT_AUTOPILOT,
    RESULT_ACCEPTED,
    RESULT_DENIED,
    RESULT_FAILED,
    RESULT_IN_PROGRESS,
    RESULT_TEMPORARILY_REJECTED,
    RESULT_UNSUPPORTED,
    CommandLong,
)

ACK_WAIT_S: Final = 0.5
ACK_LATE_S: Final = 2.0  # after that none comes any more
CHECK_S: Final = 2.0  # a rate is measured over this long
CHECK_MAX_S: Final = 16.0
ENOUGH: Final = 0.7  # of the rate asked for: a lossy link is not asked again and again
LOWER_RATES_HZ: Final[tuple[float, ...]] = (
    *(160.0, 125.0, 100.0, 80.0, 50.0, 40.0, 25.0, 20.0, 10.0, 5.0, 2.0, 1.0),
)

_RESULT_WORDS: Final = {
    RESULT_DENIED: "denied",
    RESULT_UNSUPPORTED: "unsupported",
    RESULT_FAILED: "failed",
}


@dataclass(slots=True)
class RequestedStream:
    """One message that we want."""

    message_id: int
    name: str
    rate_hz: float  # that is asked for now
    wanted_hz: float  # that was wanted; more than `rate_hz` where it was denied
    due_s: float = -inf  # when to measure and perhaps ask
    since_s: float = float("nan")  # when the measurement began; NaN: never asked for
    count: int = 0
    wait_s: float = CHECK_S
    measured_hz: float = 0.0
    given_up: bool = False
    reported: bool = False
    refused_once: bool = False  # it was refused once, or the one before it


class StreamRequests:
    """The streams of one autopilot."""

    def __init__(self, target_system: int) -> None:
        self.requests = 0
        self.notices: list[
            tuple[RequestedStream, str, float]
        ] = []  # (stream, result, rate refused)
        self._target_system = target_system
        self._streams: dict[int, RequestedStream] = {}
        self._waiting: RequestedStream | None = None
        self._waiting_until_s = 0.0
        self._unanswered_s = -inf  # when a request was given up whose answer may still come
        self._due_s = -inf  # nothing is to be done before

    def want(self, message_id: int, name: str, rate_hz: float, *, urgent: bool = False) -> None:
        """Ask for a message at a rate, from now on; an urgent one before all others."""
        standing = self._streams.get(message_id)
        if standing is None or standing.wanted_hz != rate_hz:
            wanted = {message_id: RequestedStream(message_id, name, rate_hz, rate_hz)}
            self._streams = wanted | self._streams | wanted if urgent else self._streams | wanted
            self._due_s = -inf

    def all_wanted(self) -> list[RequestedStream]:
        """Every stream that is asked for."""
        return [stream for stream in self._streams.values() if not stream.given_up]

    def wanted(self, message_id: int) -> RequestedStream | None:
        """A stream that was asked for."""
        return self._streams.get(message_id)

    def received(self, message_id: int) -> None:
        """One message has come."""
        stream = self._streams.get(message_id)
        if stream is not None:
            stream.count += 1

    def restart(self) -> None:
        """The autopilot has restarted: ask again for what was wanted.

        At the rate that was wanted: it may have restarted to allow it.
        """
        self._waiting, self._unanswered_s = None, -inf
        self._due_s = -inf
        for stream in self._streams.values():
            stream.due_s = -inf
            stream.since_s = float("nan")
            stream.wait_s = CHECK_S
            stream.rate_hz = stream.wanted_hz
            stream.given_up = stream.reported = stream.refused_once = False

    def acknowledged(self, result: int, now_s: float) -> None:
        """The answer to the one request that waits for one."""
        stream, self._waiting = self._waiting, None
        self._due_s = -inf
        if stream is None or result in (RESULT_ACCEPTED, RESULT_IN_PROGRESS):
            return
        if result == RESULT_TEMPORARILY_REJECTED:
            return  # asked again when the measurement ends
        if now_s - self._unanswered_s <= ACK_LATE_S and not stream.refused_once:
            stream.refused_once = True
            return  # likewise
        refused_hz = stream.rate_hz
        lower = next((rate for rate in LOWER_RATES_HZ if rate < stream.rate_hz), None)
        if result == RESULT_DENIED and lower is not None:
            stream.rate_hz = lower
            stream.since_s = float("nan")
            stream.due_s = now_s
        else:
            stream.given_up = True
        if not stream.reported or stream.given_up:
            stream.reported = True
            word = _RESULT_WORDS.get(result, f"answered with result {result}")
            self.notices.append((stream, word, refused_hz))

    def poll(self, now_s: float) -> list[CommandLong]:
        """At most one request."""
        if now_s < self._due_s or (self._waiting is not None and now_s < self._waiting_until_s):
            return []
        if self._waiting is not None:
            self._waiting, self._unanswered_s = None, now_s
        next_s = inf
        for stream in self._streams.values():
            if stream.given_up:
                continue
            if now_s < stream.due_s:
                next_s = min(next_s, stream.due_s)
                continue
            elapsed = now_s - stream.since_s  # NaN: never asked for
            stream.measured_hz = stream.count / elapsed if elapsed > 0.0 else 0.0
            stream.since_s, stream.count = now_s, 0
            if stream.measured_hz >= ENOUGH * stream.rate_hz:
                stream.wait_s = CHECK_S
                stream.due_s = now_s + CHECK_S
                next_s = min(next_s, stream.due_s)
                continue
            stream.due_s = now_s + stream.wait_s
            stream.wait_s = min(CHECK_MAX_S, 1.5 * stream.wait_s)
            self._waiting, self._waiting_until_s = stream, now_s + ACK_WAIT_S
            self.requests += 1
            return [self._request(stream)]
        self._due_s = next_s
        return []

    def _request(self, stream: RequestedStream) -> CommandLong:
        interval_us = float(round(1e6 / stream.rate_hz))
        params = (float(stream.message_id), interval_us, 0.0, 0.0, 0.0, 0.0, 0.0)
        return CommandLong(
            target_system=self._target_system,
            target_component=COMPONENT_AUTOPILOT,
            command=COMMAND_SET_MESSAGE_INTERVAL,
            confirmation=0,
            params=params,
        )
