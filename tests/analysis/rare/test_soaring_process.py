"""The closed loop as a process: it parts where it stands, and its margin is what it says."""

from __future__ import annotations

from functools import lru_cache
from math import exp, inf
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")

from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS, place
from tgl_soar.analysis.rare import soaring_process
from tgl_soar.analysis.rare.soaring_process import (
    EDGE,
    OUTLOOK,
    SHOWN,
    SHOWN_EVERY,
    PartedFlight,
    SoaringCase,
    SoaringProcess,
)
from tgl_soar.analysis.rare.splitting import Passage
from tgl_soar.sim import compiled_flight
from tgl_soar.sim.flight import CRASHED, Row

HALF_S = 0.5


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling would take longer than these flights."""
    monkeypatch.setattr(compiled_flight, "compiled", lambda function: function)


@lru_cache(maxsize=1)
def process() -> SoaringProcess:
    airframe, site, values, _ = place()
    sensors = SENSORS[EVERY_SENSOR]
    return SoaringProcess(
        SoaringCase(
            airframe=airframe,
            site=site,
            values=values,
            sensors=sensors,
            turbulence=0.05,
            duration_s=2 * HALF_S,
        )
    )


@lru_cache(maxsize=1)
def halfway() -> Passage:
    """Half a second of the flight of seed 1."""
    return parted(process(), process().begun(1), 1, HALF_S)


def parted(ours: SoaringProcess, state: PartedFlight, seed: int, time_s: float) -> Passage:
    """Whatever the margin is by then."""

    def low_from_then_on(shown: Any) -> Any:
        return np.where(shown[:, SHOWN.index("time_s")] > time_s - 0.006, 0.5, 1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ours, "margins", low_from_then_on)
        return ours.passage(state, seed, 0.5)


def end_of(passage: Passage) -> tuple[float, ...]:
    here = passage.state.flight.world.aircraft
    return tuple(here)


def test_it_goes_on_as_if_nothing_had_been() -> None:
    ours = process()
    parts, flight = compiled_flight.begun(ours.prepared, 1)
    rows = np.empty((ours.prepared.ticks, len(Row._fields)))
    whole = compiled_flight.fly_on(parts, ours.laws, flight, ours.prepared.ticks, 0, rows)
    assert halfway().state.flight.steps == round(HALF_S * ours.prepared.world.step_hz)
    on = parted(ours, halfway().state._replace(margin=inf), 1, 2 * HALF_S)
    assert on.state.flight.steps == whole.steps == ours.prepared.ticks
    assert tuple(whole.world.aircraft) == end_of(on)
    assert on.state.last.shape[1] == len(SHOWN)
    assert np.all(np.diff(on.state.last[:, 0]) > 0.0)


def test_with_other_noise_it_goes_another_way_from_the_same_place() -> None:
    ours, state = process(), halfway().state
    state = state._replace(margin=inf)
    one, again, other = (end_of(parted(ours, state, seed, 2 * HALF_S)) for seed in (5, 5, 6))
    assert one == again
    assert one != other
    own = compiled_flight.continued(ours.prepared, 1, state.lines, 1)
    changed = compiled_flight.continued(ours.prepared, 1, state.lines, 5)
    assert changed.sensors.attitude.bias_rad == own.sensors.attitude.bias_rad
    assert list(changed.turbulence.white[0]) != list(own.turbulence.white[0])
    assert list(changed.sensors.attitude.white[0]) != list(own.sensors.attitude.white[0])


def margin(velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), **where: float) -> float:
    """Where it hovers, but for what is given, and moving so [m/s]."""
    ours = process()
    there = {
        "x_m": ours.place[0],
        "y_m": 0.0,
        "z_m": ours.place[1],
        "airspeed_mps": ours.prepared.world.trim.airspeed_mps,
        "pitch_rad": ours.prepared.world.trim.pitch_rad,
        "updraft_mps": ours._updraft_mps,
        **where,
        "time_s": 7.0,
    }
    before = {**there, "time_s": 6.95}
    for name, speed in zip(("x_m", "y_m", "z_m"), velocity, strict=True):
        before[name] = there[name] - 0.05 * speed
    rows = [[row.get(name, 0.0) for name in SHOWN] for row in (before, there)]
    return float(ours.margins(np.array(rows))[1])


def test_the_margin_is_the_least_fraction_of_what_it_usually_is() -> None:
    ours = process()
    _, z_m = ours.place
    fence = ours.laws.fence
    assert margin() == pytest.approx(1.0)
    assert margin(z_m=0.5 * (z_m + fence.z_max_m)) == pytest.approx(0.5)
    assert margin(y_m=0.8 * fence.y_max_m) == pytest.approx(0.2)
    past, further = margin(y_m=1.1 * fence.y_max_m), margin(y_m=1.2 * fence.y_max_m)
    assert EDGE * exp(-1.0) > past > further > 0.0  # past the fence, and still flying


def test_the_margin_looks_ahead() -> None:
    """An aircraft that sinks is as near to its loss as one that will be there and stands still."""
    _, z_m = process().place
    ahead = margin(z_m=z_m - 0.4)
    assert margin((0.0, 0.0, -0.4 / OUTLOOK.motion_s)) == pytest.approx(ahead)
    assert ahead < 1.0
    assert margin((0.0, 0.0, 0.2 / OUTLOOK.motion_s), z_m=z_m - 0.2) == pytest.approx(1.0)


def test_a_lull_of_the_updraft_is_on_the_way_down() -> None:
    ours = process()
    lull = margin(updraft_mps=ours._updraft_mps - 2.0)
    assert lull == pytest.approx(margin(z_m=ours.place[1] - 2.0 * OUTLOOK.gust_s))
    assert lull < 1.0


def test_slow_and_with_its_nose_down_it_is_on_the_way_down() -> None:
    ours = process()
    trim = ours.prepared.world.trim
    slow = margin(airspeed_mps=trim.airspeed_mps - 1.0)
    assert slow == pytest.approx(margin(z_m=ours.place[1] - OUTLOOK.speed_s))
    down = margin(pitch_rad=trim.pitch_rad - 0.2)
    assert down == pytest.approx(margin(z_m=ours.place[1] - 0.2 * OUTLOOK.nose_m))
    assert max(slow, down) < 1.0


def test_gusts_of_incidence_are_no_way_to_a_loss() -> None:
    """At 5 % of turbulence they pass the stall's angle every few seconds: nothing comes of it."""
    assert margin(alpha_rad=0.5) == margin()


def test_a_loss_keeps_its_cause_on_all_rungs_that_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Handed over above the first level, it passes them all, and the last knows why."""
    ours = process()

    def handed_over(parts: Any, laws: Any, flight: Any, until: int, changes: int, rows: Any) -> Any:
        del parts, laws, changes, rows
        return flight._replace(steps=min(until, SHOWN_EVERY - 1), standing=CRASHED)

    monkeypatch.setattr(soaring_process, "fly_on", handed_over)
    first = ours.passage(ours.begun(1), 2, 0.5)
    assert first.cause
    assert first.state.margin == 0.0
    for level in (0.2, 0.0):
        later = ours.passage(first.state, 3, level)
        assert later.cause == first.cause


def test_a_dispersed_flight_has_an_aircraft_of_its_own_all_along() -> None:
    """Drawn by the seed that it began with, whatever noise it is gone on with; aboard the file is
    known, and margins are those of the file's aircraft."""
    ours = SoaringProcess(process().case._replace(dispersed=True))
    one, other = ours._prepared(1).world, ours._prepared(2).world
    file = process().prepared.world
    assert one.model != other.model != file.model
    assert one.aerodynamics == file.aerodynamics
    assert ours._usual.tolist() == process()._usual.tolist()
    state = parted(ours, ours.begun(1), 1, HALF_S).state
    flown: list[object] = []

    def watched(parts: Any, *rest: Any) -> Any:
        flown.append(parts.model)
        return compiled_flight.fly_on(parts, *rest)

    patch = pytest.MonkeyPatch()
    with patch.context() as patched:
        patched.setattr(soaring_process, "fly_on", watched)
        ours.passage(state._replace(margin=inf), 99, 1e9)
    begun, _ = compiled_flight.begun(ours._prepared(1), 1)
    assert flown[0] == begun.model


def test_theory_knows_the_ends_of_the_well() -> None:
    low, high = process().exits
    assert low.s_m < 0.0 < high.s_m
    assert low.barrier > 0.0
    assert high.barrier > 0.0
    assert 0.0 < low.rate_per_s < 1.0
