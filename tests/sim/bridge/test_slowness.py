"""The bridge by the clock, on a machine that cannot keep up: time is made up."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from tgl_soar.config.files import shipped
from tgl_soar.onboard import realtime
from tgl_soar.sim.bridge import bridge
from tgl_soar.sim.bridge.bridge import Bridge
from tgl_soar.sim.bridge.options import BridgeOptions, Pace, PortOptions
from tgl_soar.sim.bridge.slowness import TOO_SLOW, Slowness
from tgl_soar.sim.bridge.traffic import Traffic
from tgl_soar.sim.ports import Port, Ports
from tgl_soar.sim.simulation import Simulation

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def reported(losses: dict[float, float], seconds: float) -> list[str]:
    """The reports while so much is lost at these times [s]."""
    slowness, reports = Slowness(100.0), []
    for tenth in range(1, round(seconds * 10) + 1):
        now_s = tenth / 10
        if now_s in losses:
            slowness.lose(losses[now_s])
        if text := slowness.report(100.0 + now_s):
            reports.append(f"{now_s:g}: {text}")
    assert slowness.given_up_s == pytest.approx(sum(losses.values()))
    return reports


def test_a_hiccup_is_reported_at_once_and_little_ones_are_not() -> None:
    (report,) = reported({3.0: 0.4}, 25.0)
    assert report.startswith("3: this machine is too slow for real time: 0.40 s of the last 3.0 s")
    assert "0.40 s at once; close other programs, or fly in lockstep" in report
    assert reported({3.0: 0.03, 7.0: 0.1}, 25.0) == []
    assert reported({}, 25.0) == []


def test_a_machine_that_is_always_late_is_reported_once_in_ten_seconds() -> None:
    reports = reported({tenth / 10: 0.03 for tenth in range(1, 301)}, 30.0)
    assert [text.partition(":")[0] for text in reports] == ["10", "20", "30"]
    assert "3.00 s of the last 10.0 s" in reports[0]
    # One hiccup after another: no more than once a second.
    assert len(reported({tenth / 10: 0.2 for tenth in range(1, 51)}, 5.0)) == 5


class Machine:
    """A bridge on a clock of our own, whose steps take as long as we say."""

    def __init__(self, patched: pytest.MonkeyPatch, *, priority: bool = True) -> None:
        self.now_s = 50.0
        self.asked = 0
        self.reports: list[str] = []
        self.simulation: Simulation
        patched.setattr(bridge, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        patched.setattr(realtime, "_set_priority", self._ask(priority))
        patched.setattr(Ports, "wait", self._wait)
        patched.setattr(Traffic, "report", lambda _traffic, text: self.reports.append(text))

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
        anywhere = ("127.0.0.1", 0)
        made = Bridge(
            BridgeOptions(
                AIRFRAME,
                SITE,
                pace=Pace(lockstep=False, duration_s=seconds),
                ports=PortOptions(ground_local=anywhere, companion_local=anywhere),
            )
        )
        assert isinstance(made.simulation, Simulation)
        self.simulation = made.simulation
        step = self.simulation.step

        def slow() -> None:
            step()
            self.now_s += takes_s.get(self.simulation.world.steps, 0.001)

        self.simulation.step = slow  # type: ignore[method-assign]
        made.run()
        made.close()
        return made


def test_the_bridge_asks_for_priority_and_reports_where_it_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(monkeypatch)
    machine.run(3.0, {})
    assert (machine.asked, machine.reports) == (1, [])
    without = Machine(monkeypatch, priority=False)
    without.run(0.1, {})
    assert without.reports == ["no real-time priority: a busy machine may interrupt the flight"]


def test_a_machine_that_stands_still_is_reported_and_its_time_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(monkeypatch)
    ran = machine.run(3.0, {400: 0.5})
    (report,) = [text for text in machine.reports if TOO_SLOW in text]
    assert "0.49 s at once" in report  # a step before it was due when it began
    # Its clock runs on as this computer's does; with its offset known nothing is late.
    assert machine.simulation.pixhawk.boot_ms == pytest.approx(3490, abs=15)
    assert ran.slowness.given_up_s == pytest.approx(0.5, abs=0.01)
    assert machine.now_s - 50.0 == pytest.approx(3.5, abs=0.02)
