"""Which tick is gone through once more, with which bytes, and what of it is made."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar import autopilot
from tgl_soar.link.messages import Heartbeat, Source
from tgl_soar.onboard import warm_up
from tgl_soar.onboard.warm_up import WarmUps
from tgl_soar.types import OURS

# The tick and the decoder only record calls.
pytestmark = pytest.mark.interpreted

BEAT = Heartbeat(type=18, autopilot=8, base_mode=1, custom_mode=0, system_status=4)


class Warm:
    """What is recorded, with a tick that does nothing."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done: list[Any] = []
        self.output = SimpleNamespace(active=True, command="command", setpoints="setpoints")
        self.is_finite = True
        flavour: Any = SimpleNamespace(route=SimpleNamespace(loops=OURS), commands=self._commands)
        self.all = WarmUps(flavour, Source(255, 191))
        self.all._decoder = SimpleNamespace(feed=self._feed)  # type: ignore[assignment]
        monkeypatch.setattr(autopilot, "step", self._step)
        monkeypatch.setattr(warm_up, "is_finite_command", lambda *_: self.is_finite)
        monkeypatch.setattr(warm_up, "frame_of", lambda message, _: self.done.append(message))

    def _feed(self, piece: bytes) -> list[Any]:
        self.done.append(piece)
        return []

    def _step(self, laws: Any, state: Any, inputs: Any) -> Any:
        self.done.append((laws, state, inputs.position.sequence))
        return state, self.output

    def _commands(self, command: Any, setpoints: Any) -> tuple[Any, ...]:
        self.done.append((command, setpoints))
        return (BEAT,)

    def keep(self, state: Any, sequence: int) -> None:
        inputs: Any = SimpleNamespace(position=SimpleNamespace(sequence=sequence))
        self.all.keep(state, inputs)

    def run(self) -> list[Any]:
        self.done.clear()
        laws: Any = "laws"
        self.all.run(laws)
        return self.done


@pytest.fixture
def warm(monkeypatch: pytest.MonkeyPatch) -> Warm:
    return Warm(monkeypatch)


def test_before_the_first_tick_there_is_nothing_to_go_through(warm: Warm) -> None:
    warm.all.received(b"piece")
    assert warm.run() == []
    assert warm.all.kept is None


def test_a_tick_is_gone_through_from_its_bytes_to_its_frames(warm: Warm) -> None:
    warm.all.received(b"piece")
    warm.keep("state", 1)
    expected = [b"piece", ("laws", "state", 1), ("command", "setpoints"), BEAT]
    assert warm.run() == expected
    assert warm.run() == expected  # as often as it is asked for


def test_it_is_the_last_one_with_a_new_position(warm: Warm) -> None:
    warm.all.received(b"first")
    warm.keep("first", 1)
    warm.all.received(b"second")
    warm.keep("second", 1)  # the same position
    assert warm.run()[:2] == [b"first", ("laws", "first", 1)]
    warm.keep("third", 2)
    assert warm.run()[:2] == [b"second", ("laws", "third", 2)]


@pytest.mark.parametrize(("size", "kept"), [(512, 512), (513, 0)])
def test_more_than_a_tick_usually_receives_is_not_gone_through(
    warm: Warm, size: int, kept: int
) -> None:
    warm.all.received(bytes(size))
    warm.keep("state", 1)
    assert len(warm.run()[0]) == kept


@pytest.mark.parametrize(("active", "is_finite"), [(False, True), (True, False)])
def test_where_nothing_is_commanded_no_frame_is_made(
    warm: Warm, active: bool, is_finite: bool
) -> None:
    warm.output.active, warm.is_finite = active, is_finite
    warm.keep("state", 1)
    assert warm.run() == [b"", ("laws", "state", 1)]
