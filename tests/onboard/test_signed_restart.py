"""With a key: what was recorded of an engagement is worth nothing after a kill -9 and a restart."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from module_process import PATIENCE_S, Module
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.signing import EPOCH_S, TICKS_PER_S
from tgl_soar.link.signing_keys import save_key

KEY = bytes(range(1, 33))
REPLAYS = 20  # of all that was recorded


class SignedModule(Module):
    """Its station signs, follows the module's stamps, and is recorded by a third party."""

    def __init__(self, key: Path) -> None:
        super().__init__("--signing-key", str(key), "--unsigned-autopilot")
        self.recorded: list[bytes] = []
        self.stamps: dict[tuple[int, int], list[int]] = {}  # of what the module sent, by sender
        self._station.signing.secret_key = KEY
        self._station.signing.sign_outgoing = True
        self._follow(round((time.time() - EPOCH_S) * TICKS_PER_S))

    def _follow(self, stamp: int) -> None:
        signing = self._station.signing
        signing.timestamp = max(signing.timestamp, stamp)

    def receive(self) -> Any:
        message = super().receive()
        stamp = int.from_bytes(bytes(message.get_msgbuf())[-12:-6], "little")
        sender = message.get_srcSystem(), message.get_srcComponent()
        self.stamps.setdefault(sender, []).append(stamp)
        self._follow(stamp + 1)
        return message

    def command(self, message: Any) -> None:
        super().command(message)
        self.recorded.append(bytes(message.get_msgbuf()))

    def order(self, number: int) -> None:
        self.command(mavlink.MAVLink_command_long_message(1, 191, number, 0, *[0] * 7))

    def replay(self, frames: list[bytes]) -> None:
        """What an attacker without the key can do."""
        assert self.address is not None
        for frame in frames:
            self.vehicle.sendto(frame, self.address)

    def pump_until(self, holds: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end, self.texts
            self.pump()

    def is_flown_after(self, replayed: list[bytes]) -> bool:
        """Whether a replay makes it command anything."""
        self.pump_until(lambda: any(text.startswith("ready") for text in self.texts))
        self.overrides.clear()
        for _ in range(REPLAYS):
            self.replay(replayed)
            for _ in range(10):
                self.pump()
        return any(pulse != 0 for _, pulse in self.overrides)


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "flight.key"
    save_key(path, KEY)
    return path


def child_of(module: Module) -> int:
    pid = module.process.pid
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def test_a_recorded_engagement_is_refused_by_the_process_that_is_started_again(key: Path) -> None:
    """The flying process is killed, the watchdog starts another: it listens, and only to those
    that sign now."""
    module = SignedModule(key)
    try:
        assert module.receive().get_type() == "HEARTBEAT"
        module.engage()
        module.order(31010)
        os.kill(child_of(module), signal.SIGKILL)
        module.texts.clear()
        module.pump_until(lambda: any("restarted" in text for text in module.texts))
        assert not module.is_flown_after(list(module.recorded))
        module.overrides.clear()
        module.engage()  # the operator, who knows the key
        assert any(pulse != 0 for _, pulse in module.overrides)
        # Of the killed one, of the watchdog, which repeats its frames as they are, and of the next.
        for stamps in module.stamps.values():
            assert all(after >= before for before, after in pairwise(stamps))
    finally:
        module.close()


def test_a_recorded_engagement_is_refused_after_all_of_it_was_killed(key: Path) -> None:
    first = SignedModule(key)
    try:
        assert first.receive().get_type() == "HEARTBEAT"
        first.engage()
        first.order(31010)
        flying = child_of(first)
        first.process.kill()
        os.kill(flying, signal.SIGKILL)
    finally:
        first.close()
    second = SignedModule(key)
    try:
        second.pump_until(lambda: second.address is not None)
        assert not second.is_flown_after(first.recorded)
        second.overrides.clear()
        second.engage()
        assert any(pulse != 0 for _, pulse in second.overrides)
    finally:
        second.close()
