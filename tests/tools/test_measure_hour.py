"""The measurement of an hour by a firmware's own modes, with a firmware that holds all still."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import measure_hour
import pytest
from measure_hour import LOITER, Hour, fly_hour

from tgl_soar.analysis.experiments.outdoors.hour import POWERED, HourCase
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.types import SurfaceCommand

CASE = HourCase(8.0, 7.0, 0, POWERED)


class Plane:
    """Its throttle is half open once it loiters, its surfaces stay where they are."""

    def __init__(self, relay: Relay) -> None:
        self.relay = relay
        self.closed = False

    @property
    def throttle(self) -> float:
        return 0.5 if self.relay.custom_mode == LOITER else 0.0

    def exchange(self, readings: Any, sticks: Any) -> SurfaceCommand:  # noqa: ARG002
        return NEUTRAL

    def ask_for_mode(self, system: int, custom_mode: int) -> Any:
        return ("mode", system, custom_mode)

    def close(self) -> None:
        self.closed = True


class Relay:
    """Obeys a step later, in words; `deaf`: nothing."""

    def __init__(self, *, deaf: bool = False) -> None:
        self.armed, self.ready, self.custom_mode, self.deaf = False, False, -1, deaf
        self.asked: list[str] = []
        self.closed = False

    def step(self, time_s: float) -> None:
        self.ready = time_s > 0.5

    def greet(self) -> None:
        pass

    def command(self, message: Any) -> None:
        if self.deaf:
            return
        if isinstance(message, tuple):
            self.asked.append("mode")
            self.custom_mode = message[2]
            return
        self.asked.append(f"{message.get_type()} {message.command}")
        self.armed = True

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def relay(monkeypatch: pytest.MonkeyPatch) -> Relay:
    relay = Relay()
    plane = Plane(relay)
    monkeypatch.setattr(measure_hour, "start", lambda *_: (plane, relay))
    return relay


def flown(seconds: float, upwind_m: float = 0.0) -> Hour:
    return fly_hour(Path("arduplane"), Path("folder"), CASE, 9201, seconds / 60.0, upwind_m)


def test_it_is_armed_given_its_home_and_then_released(relay: Relay) -> None:
    found = flown(1.0)
    assert relay.asked == ["COMMAND_LONG 400", "COMMAND_INT 179", "mode"]
    assert found.aloft_s == pytest.approx(1.0)
    assert found.throttle_s == pytest.approx(0.5)
    assert found.ended == ""
    low, middle, high = found.heights_m
    assert -2.0 < low < middle < high < 1.0
    assert 0.0 < found.away_m < 5.0
    assert relay.closed


def test_it_begins_as_far_upwind_as_it_is_set(relay: Relay) -> None:
    assert 30.0 < flown(0.2, 40.0).away_m < 45.0
    assert relay.closed


def test_a_firmware_that_does_not_obey_is_not_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    deaf = Relay(deaf=True)
    plane = Plane(deaf)
    monkeypatch.setattr(measure_hour, "start", lambda *_: (plane, deaf))
    monkeypatch.setattr(measure_hour, "PATIENCE_S", 1.5)
    with pytest.raises(FirmwareError, match="not armed and loitering"):
        flown(1.0)
    assert plane.closed
    assert deaf.closed


@pytest.mark.skipif("TGL_SOAR_ARDUPLANE" not in os.environ, reason="TGL_SOAR_ARDUPLANE not set")
def test_a_real_arduplane_loiters_with_its_throttle(tmp_path: Path) -> None:
    found = fly_hour(Path(os.environ["TGL_SOAR_ARDUPLANE"]), tmp_path, CASE, 9201, 0.4, 40.0)
    assert found.aloft_s == pytest.approx(24.0)
    assert found.throttle_s > 1.0
    assert found.away_m < 120.0
