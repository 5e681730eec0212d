"""Frames for browsers: what has changed since the last one, to all pages alike.

A page is sent the whole first, then what changes.  A page that does not take a frame before the
next one is there is left out, and gets the whole again when it has taken it: it costs neither
memory nor the others' time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

import msgspec

FRAMES_PER_S: Final = 20.0
STALLED_S: Final = 30.0  # a page that takes nothing for so long is gone

BY_KEY: Final = ("now", "parameters")  # all else is sent whole when it changes

State = dict[str, Any]
_encode: Final = msgspec.json.Encoder().encode


class Viewer:
    """One page, and the one frame that is on its way to it."""

    def __init__(self, number: int, name: str, send: Callable[[str], Awaitable[None]]) -> None:
        """send: waits until the page can take more."""
        self.number, self.name = number, name
        self.dropped = 0
        self._send = send
        self._needs_whole = True
        self._sending: asyncio.Task[None] | None = None
        self._since_s = float("inf")

    @property
    def is_sending(self) -> bool:
        """Whether a frame is on its way that the page has not taken yet."""
        return self._sending is not None and not self._sending.done()

    def offer(self, change: str, whole: Callable[[], str], now_s: float) -> bool:
        """The next frame; whether the page is still there."""
        if self.is_sending:
            self._needs_whole = True
            self.dropped += 1
            return now_s - self._since_s < STALLED_S
        if self._sending is not None and self._sending.exception() is not None:
            return False
        self._since_s = now_s
        frame = whole() if self._needs_whole else change
        self._needs_whole = False
        self._sending = asyncio.ensure_future(self._send(frame))
        return True

    def end(self) -> None:
        """It has gone."""
        if self._sending is not None:
            self._sending.cancel()


class Broadcast:
    """All pages."""

    def __init__(self) -> None:
        self.viewers: dict[int, Viewer] = {}
        self.frames = 0
        self._before: State = {}
        self._numbers = 0

    def add(self, name: str, send: Callable[[str], Awaitable[None]]) -> Viewer:
        """One more page."""
        self._numbers += 1
        viewer = Viewer(self._numbers, name or f"page {self._numbers}", send)
        self.viewers[viewer.number] = viewer
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """One less."""
        self.viewers.pop(viewer.number, None)
        viewer.end()

    def show(
        self, state: State, news: dict[str, list[Any]], whole: Callable[[], State], now_s: float
    ) -> list[Viewer]:
        """A frame for all: of the state what has changed, and what is new in lists.

        whole: the state and the lists as a page that has nothing needs them.  The pages that are
        gone.
        """
        self.frames += 1
        change = changed(self._before, state)
        self._before = state
        change.update({name: rows for name, rows in news.items() if rows})
        text = _encode(change).decode()
        made: list[str] = []

        def first() -> str:
            if not made:
                made.append(_encode({"whole": True, **whole()}).decode())
            return made[0]

        viewers = list(self.viewers.values())
        return [viewer for viewer in viewers if not viewer.offer(text, first, now_s)]


def changed(before: State, now: State) -> State:
    """What of a state is another than before; of `BY_KEY` what has changed within."""
    change: State = {}
    for name, value in now.items():
        old = before.get(name, change)
        if name in BY_KEY and old is not change:
            inner = {k: v for k, v in value.items() if k not in old or old[k] != v}
            gone = [k for k in old if k not in value]
            inner.update(dict.fromkeys(gone))
            if inner:
                change[name] = inner
        elif old is change or old != value:
            change[name] = value
    return change
