"""What the module tells its operator: texts, and numbers for plots."""

from __future__ import annotations

from typing import Final

from .messages import NamedValueFloat, StatusText

CHUNK: Final = 50  # characters of one STATUSTEXT
MAX_CHUNKS: Final = 5


class StatusTexts:
    """Cuts texts into chunks; each long text has a number of its own."""

    def __init__(self) -> None:
        self._id = 0

    def chunks(self, severity: int, text: str) -> list[StatusText]:
        """A text as STATUSTEXT messages; what is longer than `MAX_CHUNKS` is cut off."""
        text = text.encode("ascii", "replace").decode("ascii")
        if len(text) <= CHUNK:
            return [StatusText(severity, text)]
        self._id = self._id % 0xFFFF + 1
        pieces = [text[i : i + CHUNK] for i in range(0, min(len(text), CHUNK * MAX_CHUNKS), CHUNK)]
        if len(pieces[-1]) == CHUNK and len(pieces) < MAX_CHUNKS:
            pieces.append("")  # a full chunk does not say that it is the last one
        return [StatusText(severity, piece, self._id, i) for i, piece in enumerate(pieces)]


class NamedValues:
    """Takes turns among named numbers so that each goes out at the same slow rate."""

    def __init__(self, names: tuple[str, ...], rate_hz: float) -> None:
        self._names = names
        self._interval_s = 1.0 / (rate_hz * len(names))
        self._turn = 0
        self._due_s = float("-inf")

    def due(self, now_s: float) -> int | None:
        """The index of the number whose turn it is, if it is anyone's."""
        if now_s < self._due_s:
            return None
        behind = now_s - self._due_s > 4.0 * self._interval_s
        self._due_s = (now_s if behind else self._due_s) + self._interval_s
        turn = self._turn
        self._turn = (turn + 1) % len(self._names)
        return turn

    def message(self, index: int, vehicle_time_s: float, value: float) -> NamedValueFloat:
        """One number, stamped with the vehicle's time."""
        stamp_ms = int(vehicle_time_s * 1e3) if vehicle_time_s == vehicle_time_s else 0
        return NamedValueFloat(stamp_ms & 0xFFFFFFFF, self._names[index], value)

    def rebase(self) -> None:
        """The clock was changed: begin again."""
        self._due_s = float("-inf")
        self._turn = 0
