"""What happens to the autopilot, in words for an onlooker's console."""

from __future__ import annotations

from typing import Final

_ONCE_AT_MOST: Final = 100  # different ones; of a flood no more are reported


class OnlookerEvents:
    """Events in order, until somebody takes them."""

    def __init__(self) -> None:
        self._waiting: list[str] = []
        self._reported_once: set[str] = set()

    def add(self, text: str) -> None:
        """Something happened."""
        self._waiting.append(text)

    def add_once(self, text: str) -> None:
        """Something that happens again and again, and is reported the first time only."""
        if text not in self._reported_once and len(self._reported_once) < _ONCE_AT_MOST:
            self._reported_once.add(text)
            self._waiting.append(text)

    def take(self) -> list[str]:
        """All that wait."""
        taken, self._waiting = self._waiting, []
        return taken
