"""What the module sends to its operator: texts, and numbers for plots, within a budget of bytes.

Texts are always sent; they use up the budget, and the numbers wait.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

from tgl_soar.link.messages import ID_HEARTBEAT, Outbound, StatusText
from tgl_soar.types import NAN

CHUNK: Final = 50  # characters of one STATUSTEXT
MAX_CHUNKS: Final = 5
BURST_S: Final = 0.2  # of the budget, saved up at most
DEBT_S: Final = 1.0
MIN_INTERVAL_US: Final = 20_000.0  # 50 Hz: beyond it, log on board


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
            pieces.append("")  # a full chunk does not mark itself as the last one
        return [StatusText(severity, piece, self._id, i) for i, piece in enumerate(pieces)]


class Budget:
    """Bytes that telemetry may use: so many a second, and a little saved up."""

    def __init__(self) -> None:
        self.spent_bytes = 0  # in all
        self._left = 0.0
        self._filled_s = NAN

    def fill(self, now_s: float, bytes_per_s: float) -> bool:
        """Time has passed; whether anything is left to spend."""
        passed_s = now_s - self._filled_s
        if passed_s > 0.0:
            self._left = min(BURST_S * bytes_per_s, self._left + passed_s * bytes_per_s)
        if passed_s != 0.0:  # NaN: the first time
            self._filled_s = now_s
        return self._left > 0.0

    def spend(self, size: int, bytes_per_s: float) -> None:
        """A frame went out.  What was sent beyond the budget is a debt, of `DEBT_S` at most.

        One frame that is larger than that is paid for in whole.
        """
        self.spent_bytes += size
        self._left = max(min(-DEBT_S * bytes_per_s, -float(size)), self._left - size)

    def rebase(self) -> None:
        """The clock was changed."""
        self._left = 0.0
        self._filled_s = NAN


class Flow:
    """Messages of one kind that go out in turns, each at the same rate."""

    def __init__(
        self,
        message_id: int,
        items: int,
        interval_s: float,
        build: Callable[[int], Outbound | None],
    ) -> None:
        """`build`: the message of a turn, 0 … items - 1.  `interval_s` inf: only when asked."""
        self.message_id = message_id
        self.interval_s = interval_s  # between two of the same turn
        self.default_s = interval_s
        self.build = build
        self._items = items
        self._turn = 0
        self._due_s = -inf

    def lateness(self, now_s: float) -> float:
        """By how many of its own intervals a message is due; negative: it is not."""
        if now_s < self._due_s or self.interval_s == inf:
            return -1.0
        return min((now_s - self._due_s) * self._items / self.interval_s, 1e9)

    def take(self, now_s: float) -> Outbound | None:
        """The message whose turn it is; the next is due on the grid, unless that is long past."""
        interval_s = self.interval_s / self._items
        is_late = now_s - self._due_s > 4.0 * interval_s
        self._due_s = (now_s if is_late else self._due_s) + interval_s
        turn = self._turn
        self._turn = (turn + 1) % self._items
        return self.build(turn)

    def rebase(self) -> None:
        """The clock was changed, or the rate: begin again."""
        self._due_s = -inf
        self._turn = 0


class Telemetry:
    """All flows under one budget; whoever is most behind its own rate goes first."""

    def __init__(self, flows: tuple[Flow, ...]) -> None:
        self.budget = Budget()
        self._flows = flows

    def due(self, now_s: float, bytes_per_s: float) -> Outbound | None:
        """One message, if one is due and may be paid for."""
        if not self.budget.fill(now_s, bytes_per_s):
            return None
        latest, most = None, -1.0
        for flow in self._flows:
            lateness = flow.lateness(now_s)
            if lateness > most:
                latest, most = flow, lateness
        return None if latest is None else latest.take(now_s)

    def once(self, message_id: int) -> Outbound | None:
        """A message now."""
        flow = self._flow(message_id)
        return None if flow is None else flow.build(0)

    def set_interval(self, message_id: int, interval_us: float) -> bool:
        """Another rate for all flows of a message, in proportion; -1 never, 0 as by default."""
        first = self._flow(message_id)
        if first is None or not (interval_us in (-1.0, 0.0) or interval_us >= MIN_INTERVAL_US):
            return False
        for flow in self._flows:
            if flow.message_id == message_id:
                ratio = flow.default_s / first.default_s if flow is not first else 1.0
                flow.interval_s = {-1.0: inf, 0.0: flow.default_s}.get(
                    interval_us, interval_us * 1e-6 * ratio
                )
                flow.rebase()
        return True

    def interval_us(self, message_id: int) -> int:
        """How often a message is sent; -1: not, 0: it is not ours."""
        if message_id == ID_HEARTBEAT:
            return 1_000_000
        flow = self._flow(message_id)
        if flow is None:
            return 0
        endless = flow.interval_s == inf
        return -1 if endless else min(round(flow.interval_s * 1e6), 2**31 - 1)

    def rebase(self) -> None:
        """The clock was changed: begin again."""
        self.budget.rebase()
        for flow in self._flows:
            flow.rebase()

    def _flow(self, message_id: int) -> Flow | None:
        return next((f for f in self._flows if f.message_id == message_id), None)
