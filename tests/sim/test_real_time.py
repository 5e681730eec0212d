"""The bridge by the clock, on a machine that cannot keep up: time is made up."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.onboard import realtime
from tgl_soar.sim import bridge
from tgl_soar.sim.bridge import Bridge, Pace, Slowness
from tgl_soar.sim.ports import Port, Ports
from tgl_soar.sim.simulation import Options, Simulation

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def told(losses: dict[float, float], seconds: float) -> list[str]:
    """What is said while so much is lost at these times [s]."""
    slowness, said = Slowness(100.0), []
    for tenth in range(1, round(seconds * 10) + 1):
        now_s = tenth / 10
        if now_s in losses:
            slowness.lose(losses[now_s])
        if words := slowness.told(100.0 + now_s):
            said.append(f"{now_s:g}: {words}")
    assert slowness.given_up_s == pytest.approx(sum(losses.values()))
    return said


def test_a_hiccup_is_told_at_once_and_little_ones_are_not() -> None:
    (said,) = told({3.0: 0.4}, 25.0)
    assert said.startswith("3: this machine is too slow for real time: 0.40 s of the last 3.0 s")
    assert "0.40 s at once; close other programs, or fly in lockstep" in said
    assert told({3.0: 0.03, 7.0: 0.1}, 25.0) == []
    assert told({}, 25.0) == []


def test_a_machine_that_is_always_late_is_told_once_in_ten_seconds() -> None:
    said = told({tenth / 10: 0.03 for tenth in range(1, 301)}, 30.0)
    assert [text.partition(":")[0] for text in said] == ["10", "20", "30"]
    assert "3.00 s of the last 10.0 s" in said[0]
    # One hiccup after another: no more than once a second.
    assert len(told({tenth / 10: 0.2 for tenth in range(1, 51)}, 5.0)) == 5


class Machine:
    """A bridge on a clock of our own, whose steps take as long as we say."""

    def __init__(self, patched: pytest.MonkeyPatch, *, priority: bool = True) -> None:
        self.now_s = 50.0
        self.asked = 0
        self.said: list[str] = []
        patched.setattr(bridge, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        patched.setattr(realtime, "_set_priority", self._ask(priority))
        patched.setattr(Ports, "wait", self._wait)
        patched.setattr(Bridge, "_say", lambda _bridge, text: self.said.append(text))
        self.simulation = Simulation(
            load_airframe(AIRFRAME), load_site(SITE), Options(), SITE.parent
        )

    def _ask(self, granted: bool) -> Callable[[int], bool]:
        def set_priority(priority: int) -> bool:
            assert priority == realtime.PRIORITY - 1  # after the module's loop
            self.asked += 1
            return granted

        return set_priority

    def _wait(self, seconds: float, *_which: Port) -> bool:
        self.now_s += seconds
        return False

    def run(self, seconds: float, takes_s: dict[int, float]) -> Bridge:
        """`takes_s`: how long some steps take, by their number."""
        step = self.simulation.step

        def slow() -> None:
            step()
            self.now_s += takes_s.get(self.simulation.world.steps, 0.001)

        self.simulation.step = slow  # type: ignore[method-assign]
        anywhere = ("127.0.0.1", 0)
        ports = Ports(
            Port("ground", "--gcs-local", anywhere, ground=True),
            Port("companion", "--companion-local", anywhere, ground=False),
        )
        made = Bridge(self.simulation, ports, Pace(lockstep=False, duration_s=seconds))
        made.run()
        ports.close()
        return made


def test_the_bridge_asks_for_priority_and_says_where_it_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(monkeypatch)
    machine.run(3.0, {})
    assert (machine.asked, machine.said) == (1, [])
    without = Machine(monkeypatch, priority=False)
    without.run(0.1, {})
    assert without.said == ["no real-time priority: a busy machine may interrupt the flight"]


def test_a_machine_that_stands_still_is_told_of_and_its_time_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(monkeypatch)
    ran = machine.run(3.0, {400: 0.5})
    (said,) = [text for text in machine.said if bridge.TOO_SLOW in text]
    assert "0.49 s at once" in said  # a step before it was due when it began
    # Its clock runs on as this computer's does; what has learnt its offset finds nothing late.
    assert machine.simulation.pixhawk.boot_ms == pytest.approx(3490, abs=15)
    assert ran.slowness.given_up_s == pytest.approx(0.5, abs=0.01)
    assert machine.now_s - 50.0 == pytest.approx(3.5, abs=0.02)
