"""The air as measured in flight: the page's map against the air that was flown in."""

from __future__ import annotations

from functools import cache
from math import hypot, inf, nan

import numpy as np
import pytest
from page_flight import AIRFRAME, SITE, SOARING, Flown

from tgl_soar.air.zeuc import excess_at
from tgl_soar.cli.page.desk import Desk
from tgl_soar.cli.page.measured_air import (
    CELLS,
    FEWEST,
    AirSample,
    MeasuredAir,
    box_of,
    zero_segments,
)
from tgl_soar.cli.page.scene import Place, place_of
from tgl_soar.cli.page.station import Station
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading
from tgl_soar.sim.world import build_field
from tgl_soar.types import NO_GROUND, Ground

FENCE = {"FENCE_X_MIN": -0.5, "FENCE_X_MAX": 2.5, "FENCE_Z_MIN": 0.15, "FENCE_Z_MAX": 2.85}
VIEW = [-1.0, 3.0, 0.0, 3.2]


@cache
def tunnel() -> Place:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    return place_of(airframe, site, load_parameters(airframe, AIRFRAME, site, SITE), SITE.parent)


def sample(time_s: float, **changed: float) -> AirSample:
    still = {"x_m": 0.3, "z_m": 1.2, "velocity_x_mps": 0.0, "wind_mps": 8.5, "updraft_mps": 0.6}
    return AirSample(time_s=time_s, **{**still, **changed})


def air() -> MeasuredAir:
    return MeasuredAir(NO_GROUND, tunnel().polar, VIEW)


def test_on_a_flight_it_finds_the_contour_of_the_air() -> None:
    """From the module's own telemetry, soaring on one line and then another."""
    flown = Flown()
    station = Station(1, 191, 253, None, 1.8e9)
    desk = Desk(tunnel(), station, None, None)

    def fly(seconds: float) -> None:
        for slice_ in range(round(seconds / 0.1)):
            for data in flown.run(0.1):
                station.receive(data, flown.simulation.time_s, 1.8e9)
            if slice_ % 10 == 0:
                station.step(flown.simulation.time_s)
            for frame in station.take_datagrams():
                flown.receive(frame)
            desk.show(flown.simulation.time_s)

    fly(5.0)
    assert desk._state(0.0)["measured"] is None  # it is held: nothing of the air is measured
    flown.onboard.settings.assign("OP_ENGAGE", 1.0)
    fly(12.0)
    flown.onboard.settings.assign("TGL_PRESET", 2.0)
    fly(14.0)
    assert flown.mode == SOARING
    drawing = desk._state(0.0)["measured"]
    assert drawing["readings"] > 40
    assert drawing["loose"] < 0.5  # the board is where the site says
    known = [w for row in drawing["cells"] for w in row if w is not None]
    assert len(known) > 20
    # Near the way that was flown the contour is the one of the air: E, there zero, is known to
    # the 0.3 m/s of docs/search.md at this distance, and its slope is 1 /s or so.
    site, airframe = load_site(SITE), load_airframe(AIRFRAME)
    assert site.air is not None
    field, polar = build_field(site.air, SITE.parent), airframe.polar.as_polar()
    x, z = flown.place
    near = [p for pair in drawing["contour"] for p in pair if hypot(p[0] - x, p[1] - z) < 0.3]
    assert near
    assert max(abs(excess_at(field, polar, *p)) for p in near) < 0.3


def test_what_is_far_from_the_way_that_was_flown_is_not_drawn() -> None:
    measured = air()
    for i in range(30):
        measured.take(sample(0.5 * i), flying=True)
    measured.draw_whole()
    drawing = measured.drawing
    assert drawing is not None
    height = VIEW[3] - VIEW[2]
    found = 0
    for j, row in enumerate(drawing["cells"]):
        for i, w in enumerate(row):
            x, z = drawing["x"] + i * drawing["step"], drawing["z"] + j * drawing["step_z"]
            if w is not None:
                found += 1
                assert hypot(x - 0.3, z - 1.2) <= 0.3 * height + 1e-9
    assert found > 10


def test_below_the_ground_nothing_is_drawn() -> None:
    measured = air()
    for i in range(30):
        measured.take(sample(0.5 * i, updraft_mps=0.5), flying=True)
    measured.draw_whole()
    assert measured.drawing is not None
    points = [p for pair in measured.drawing["contour"] for p in pair]
    z_m = float(np.median([p[1] for p in points]))
    measured._ground = Ground(2, (-9.0, 9.0, *[9.0] * 6), (z_m,) * 8)
    measured.take(sample(15.0, updraft_mps=0.5), flying=True)
    measured.draw_whole()
    drawing = measured.drawing
    assert all(p[1] > z_m for pair in drawing["contour"] for p in pair)
    heights = [drawing["z"] + j * drawing["step_z"] for j in range(len(drawing["cells"]))]
    rows = [z for z, row in zip(heights, drawing["cells"], strict=True) if any(row)]
    assert z_m - drawing["step_z"] < min(rows) < z_m  # one below its edge


def test_what_is_climbed_by_slowing_down_is_no_updraft() -> None:
    """V v' / g of climb is the energy of the speed that is given up."""
    still, zooming = air(), air()
    change_mps2 = 0.8
    climb_mps = 8.5 / 9.80665 * change_mps2
    for i in range(12):
        t = 0.5 * i
        still.take(sample(t), flying=True)
        # Up and down, to and fro: the same places, and half of a swing of speed.
        side = 1.0 if i % 2 else -1.0
        zooming.take(
            sample(
                t,
                velocity_x_mps=side * 0.25 * change_mps2,
                z_m=1.2 + side * 0.25 * climb_mps,
            ),
            flying=True,
        )
    assert zooming.readings > 5
    for measured in (still, zooming):
        measured.draw_whole()
        assert measured.drawing is not None
    assert still.drawing is not None
    assert zooming.drawing is not None
    pairs = zip(still.drawing["cells"], zooming.drawing["cells"], strict=True)
    both = [(a, b) for x, y in pairs for a, b in zip(x, y, strict=True) if a and b]
    assert both
    assert max(abs(a - b) for a, b in both) < 5  # cm/s


def test_only_what_is_measured_in_flight_is_taken() -> None:
    measured = air()
    for i in range(4):
        measured.take(sample(0.5 * i), flying=False)
    assert measured.readings == 0
    for i in range(4):
        measured.take(sample(10.0 + 0.5 * i), flying=True)
    assert measured.readings == 3
    measured.take(sample(20.0), flying=True)  # a gap: there is nothing to difference
    assert measured.readings == 3
    measured.take(sample(20.0), flying=True)  # the same again
    measured.take(sample(19.0), flying=True)  # the clock was set back
    assert measured.readings == 3


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e30, -1e30])
@pytest.mark.parametrize("name", AirSample._fields)
def test_what_is_no_measurement_changes_nothing(name: str, bad: float) -> None:
    measured = air()
    for i in range(4):
        measured.take(sample(0.5 * i), flying=True)
    measured.draw_whole()
    before = measured.drawing
    measured.take(sample(2.0)._replace(**{name: bad}), flying=True)
    measured.draw_whole()
    assert measured.readings == 3
    assert measured.drawing is before
    for i in range(2):
        measured.take(sample(2.5 + 0.5 * i), flying=True)
    measured.draw_whole()
    assert measured.readings == 4


def test_the_climb_of_a_propeller_is_no_lift(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[Reading] = []
    monkeypatch.setattr(LiftMap, "take", lambda _map, reading: taken.append(reading))
    measured = air()
    for i, pushed_mps in enumerate((0.3, 0.3, 0.1, 0.0)):
        measured.take(sample(0.5 * i, z_m=1.2 + 0.1 * i, pushed_mps=pushed_mps), flying=True)
    assert [r.energy_mps for r in taken] == pytest.approx([-0.1, 0.0, 0.15])


def test_whatever_is_sent_the_drawing_is_finite_and_bounded() -> None:
    measured, random = air(), np.random.default_rng(3)
    for i in range(200):
        x, z, speed, wind, updraft = random.normal(size=5) * (1.0, 1.0, 40.0, 50.0, 50.0)
        measured.take(
            AirSample(
                time_s=0.5 * i,
                x_m=0.5 + x,
                z_m=1.5 + z,
                velocity_x_mps=speed,
                wind_mps=abs(wind),
                updraft_mps=updraft,
            ),
            flying=True,
        )
        measured.draw_on()
    measured.draw_whole()
    assert measured.drawing is not None
    cells = measured.drawing["cells"]
    assert len(cells) * len(cells[0]) <= CELLS * CELLS
    assert all(w is None or abs(w) < 1e6 for row in cells for w in row)


def test_the_box_is_the_fence_where_it_is_set() -> None:
    assert box_of(FENCE, VIEW) == tuple(FENCE.values())
    assert box_of({**FENCE, "FENCE_X_MIN": -5000.0}, VIEW).x_min_m == VIEW[0]
    measured = air()
    for i in range(3):
        measured.take(sample(0.5 * i), flying=True)
    measured.bound({"FENCE_X_MIN": -0.2})  # the others are not known yet
    assert measured.readings == 2
    measured.bound({**FENCE, "FENCE_X_MIN": 9.0})  # none at all
    assert measured.readings == 2
    measured.bound(FENCE)
    assert measured.readings == 0


def test_a_row_is_drawn_at_a_time_and_nothing_twice() -> None:
    measured = air()
    for i in range(3):
        measured.take(sample(0.5 * i), flying=True)
    rows = 0
    while measured.drawing is None:
        measured.draw_on()
        rows += 1
    assert FEWEST <= rows <= CELLS
    drawn = measured.drawing
    for _ in range(2 * rows):
        measured.draw_on()
    assert measured.drawing is drawn


def test_zero_is_found_between_nodes_and_not_beside_the_unknown() -> None:
    x, z = np.linspace(0.0, 4.0, 5), np.linspace(0.0, 3.0, 4)
    values = np.add.outer(0.0 * z, x) - 1.25  # zero at x = 1.25
    segments = zero_segments(x, z, values)
    assert len(segments) == 3
    for start, end in segments:
        assert start[0] == pytest.approx(1.25)
        assert end[0] == pytest.approx(1.25)
    values[1, 1] = nan
    assert len(zero_segments(x, z, values)) == 1
    saddle = np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert len(zero_segments(x[:2], z[:2], saddle)) == 2
