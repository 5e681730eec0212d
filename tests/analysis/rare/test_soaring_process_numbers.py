"""The closed loop as a process, with flights that are made up: its six distances, how far ahead it
looks and how often, where a flight parts, and what is kept of it.  Nothing is compiled."""

from __future__ import annotations

from functools import lru_cache
from math import exp, inf, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS, place
from tgl_soar.analysis.rare import soaring_process as module
from tgl_soar.analysis.rare.soaring_process import (
    SHOWN,
    PartedFlight,
    SoaringCase,
    SoaringProcess,
)
from tgl_soar.analysis.rare.splitting import Passage
from tgl_soar.sim.flight import CRASHED, FLIES, HANDED_OVER, Row

DT = 0.005  # 200 ticks a second: a look at the margin every 10
TICKS = 2000
COLUMN = {name: n for n, name in enumerate(Row._fields)}


@lru_cache(maxsize=1)
def case() -> SoaringCase:
    airframe, site, values, _ = place()
    return SoaringCase(
        airframe=airframe,
        site=site,
        values=values,
        sensors=SENSORS[EVERY_SENSOR],
        turbulence=0.05,
        duration_s=TICKS * DT,
    )


@lru_cache(maxsize=1)
def process() -> SoaringProcess:
    return SoaringProcess(case())


@pytest.fixture(autouse=True)
def made() -> None:
    """It is made before a test puts anything in the place of what it is made of."""
    process()


def rows_of(y_m: Any) -> Any:
    """A flight that hovers at its place but for where it is to the side, tick by tick."""
    rows = np.zeros((len(y_m), len(Row._fields)))
    rows[:, COLUMN["time_s"]] = DT * (1.0 + np.arange(len(y_m)))
    rows[:, COLUMN["x_m"]], rows[:, COLUMN["z_m"]] = process().place
    rows[:, COLUMN["y_m"]] = y_m
    rows[:, COLUMN["airspeed_mps"]] = process().prepared.world.trim.airspeed_mps
    rows[:, COLUMN["pitch_rad"]] = process().prepared.world.trim.pitch_rad
    rows[:, COLUMN["updraft_mps"]] = process()._updraft_mps
    rows[:, COLUMN["elevator"]] = np.arange(len(y_m))  # which tick it was
    return rows


def standing(steps: int, how: int = FLIES) -> Any:
    return SimpleNamespace(steps=steps, standing=how)


# --- the margin -----------------------------------------------------------------------------------


def test_it_looks_twenty_times_a_second_and_shows_five_seconds() -> None:
    assert module.OUTLOOK == (0.3, 0.14, 0.1, 0.9)
    assert module.LAST_S == 5.0
    assert (module.EDGE, module.FAR_M, module.SHOWN_EVERY) == (0.1, 1000.0, 10)
    assert SHOWN == (
        "time_s", "x_m", "y_m", "z_m", "e_rho_m", "airspeed_mps", "alpha_rad", "pitch_rad",
        "elevator", "wind_mps", "updraft_mps",
    )  # fmt: skip


def test_unless_it_is_asked_for_all_fly_the_files_aircraft() -> None:
    assert SoaringCase._field_defaults == {"dispersed": False, "folder": None}


def test_six_distances_are_to_the_ground_and_to_the_fences_sides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The fence: x from -0.4 to 2, y to 1.2 either way, z from 0.8 to 2.6; 0.4 m of clearance."""
    monkeypatch.setattr(module, "clearance", lambda _ground, x, z: 10.0 * x + z)
    for y_m in (0.3, -0.3):
        found = process()._distances(0.5, y_m, 1.7)
        assert found == pytest.approx((6.3, 0.9, 1.5, 0.9, 0.9, 0.9), abs=1e-6)
    monkeypatch.setattr(module, "clearance", lambda *_: inf)
    assert process()._distances(0.5, 0.0, 1.7)[0] == 1000.0  # where no ground is known


def margins(looks: list[dict[str, float]], apart_s: float = 0.05) -> list[float]:
    """Of looks that hover but for what is given; y, z [m] from where it hovers, z up."""
    ours = process()
    trim = ours.prepared.world.trim
    usual = {
        "airspeed_mps": trim.airspeed_mps,
        "pitch_rad": trim.pitch_rad,
        "updraft_mps": ours._updraft_mps,
        "x_m": ours.place[0],
    }
    rows = []
    for n, look in enumerate(looks):
        row = {**usual, **look, "time_s": 7.0 + apart_s * n}
        row["z_m"] = ours.place[1] + look.get("z_m", 0.0)
        rows.append([row.get(name, 0.0) for name in SHOWN])
    found: list[float] = ours.margins(np.array(rows)).tolist()
    return found


def margin(
    velocity_mps: float = 0.0, y_m: float = 0.0, z_m: float = 0.0, apart_s: float = 0.05
) -> float:
    """That much to the side and higher than where it hovers, and on its way to the side."""
    there = {"y_m": y_m, "z_m": z_m}
    return margins([{**there, "y_m": y_m - velocity_mps * apart_s}, there], apart_s)[1]


def test_the_margin_is_the_least_fraction_of_what_each_distance_usually_is() -> None:
    top_m = 2.6 - process().place[1]
    assert margin() == 1.0
    assert margin(y_m=0.6) == pytest.approx(0.5, abs=1e-6)
    assert margin(z_m=0.75 * top_m) == pytest.approx(0.25, abs=1e-6)
    assert margin(y_m=0.6, z_m=0.75 * top_m) == pytest.approx(0.25, abs=1e-6)


@pytest.mark.parametrize("apart_s", [0.05, 0.1, 0.3])
def test_the_margin_is_that_of_where_three_tenths_of_a_second_take_it(apart_s: float) -> None:
    assert margin(1.6, apart_s=apart_s) == pytest.approx(1.0 - 0.48 / 1.2, abs=1e-6)
    assert margin(1.6, 0.12, apart_s=apart_s) == pytest.approx(0.5, abs=1e-6)
    assert margin(-1.6, 0.48, apart_s=apart_s) == pytest.approx(1.0, abs=1e-6)


def test_gusts_airspeed_and_pitch_move_it_up_and_down() -> None:
    """A m/s of updraft by 14 cm, of airspeed by 10 cm; a tenth of a radian by 9 cm."""
    top_m, bottom_m = 2.6 - process().place[1], process().place[1] - 0.8
    trim = process().prepared.world.trim
    for name, usual, change, moves_m in (
        ("updraft_mps", process()._updraft_mps, 1.0, 0.14),
        ("airspeed_mps", trim.airspeed_mps, 1.0, 0.1),
        ("pitch_rad", trim.pitch_rad, 0.1, 0.09),
    ):
        up, down = margins([{name: usual + change}, {name: usual - change}])
        assert up == pytest.approx(1.0 - moves_m / top_m, abs=1e-6)
        assert down == pytest.approx(1.0 - moves_m / bottom_m, abs=1e-6)


def test_of_nothing_there_is_no_margin() -> None:
    assert process().margins(np.empty((0, len(SHOWN)))).shape == (0,)


def test_from_a_tenth_on_the_margin_falls_as_an_exponential_and_never_to_nought() -> None:
    assert margin(y_m=1.2 * 0.89) == pytest.approx(0.11, abs=1e-6)
    assert margin(y_m=1.2 * 0.95) == pytest.approx(0.1 * exp(-0.5), abs=1e-6)
    assert margin(y_m=1.2 * 1.1) == pytest.approx(0.1 * exp(-2.0), abs=1e-6)


# --- what can be flown ----------------------------------------------------------------------------


def test_a_line_that_crosses_no_contour_has_no_place_to_hover() -> None:
    far = case().values.changed({"TGL_X": 1.9, "TGL_Z": 400.0})
    with pytest.raises(ValueError, match="crosses the contour nowhere: there is no place to hover"):
        SoaringProcess(case()._replace(values=far))


def test_a_point_mass_is_refused() -> None:
    point = case().airframe.flown_as("point_mass")
    with pytest.raises(ValueError, match="point mass knows no stall: fly the rigid body"):
        SoaringProcess(case()._replace(airframe=point))


def test_a_place_beyond_one_limit_is_refused_with_its_distances() -> None:
    low = case().values.changed({"FENCE_Z_MAX": 1.6})
    with pytest.raises(ValueError, match=r"where it hovers it has no margin: \(0\.9"):
        SoaringProcess(case()._replace(values=low))


def test_the_ends_of_the_well_are_those_of_its_own_turbulence_and_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It returns its own arguments.
    monkeypatch.setattr(module, "well_exits", lambda *what: what)
    ours: Any = SoaringProcess(case())
    field, polar, at, eta, turbulence, allowed = ours.exits
    reference = field.reference_wind_mps
    assert field is ours.prepared.world.field
    assert polar == case().airframe.polar.as_polar()
    assert at == ours.place
    assert eta == pytest.approx(0.5 * pi + np.radians(15.0), abs=1e-6)
    air = case().site.air
    assert air is not None
    assert turbulence == pytest.approx(
        (0.05 * reference, air.turbulence.length_scale_m / reference)
    )
    assert allowed(*ours.place)
    assert allowed(ours.place[0], 2.59)
    assert not allowed(ours.place[0], 2.61)


def test_a_flight_begins_where_the_files_aircraft_hovers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dispersed, an aircraft and air of its own seed; aboard the file is known all the same."""
    made: list[Any] = []
    monkeypatch.setattr(
        module, "make_world", lambda airframe, site, **more: made.append((airframe, site, more))
    )
    monkeypatch.setattr(
        module,
        "mismatched",
        lambda _airframe, site, _field, _sensors, seed: (f"air{seed}", site, "wind", "seen"),
    )
    ours = process()
    ours._world(None)
    ours._world(7)
    (own, site, more), (other, _, drawn) = made
    start = site.start
    assert (start.x_m, start.z_m) == ours.place
    assert own is case().airframe
    assert (more["turbulence"], more["known"]) == (0.05, case().airframe)
    assert (more["field"], more["sensors"]) == (ours._field, case().sensors)
    assert (other, drawn["field"], drawn["sensors"]) == ("air7", "wind", "seen")
    assert drawn["known"] is case().airframe


def test_a_dispersed_flight_is_prepared_for_its_own_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    ours: Any = SoaringProcess(case())
    assert ours._prepared(3) is ours.prepared
    monkeypatch.setattr(ours, "case", case()._replace(dispersed=True))
    monkeypatch.setattr(ours, "_world", lambda seed: ("world", seed))
    monkeypatch.setattr(module, "prepare", lambda world, seconds: (world, seconds))
    assert ours._prepared(3) == (("world", 3), TICKS * DT)


# --- where a flight parts -------------------------------------------------------------------------


def looked(y_m: Any) -> list[tuple[int, float]]:
    """(step, margin) at each look from tick 40 on: a straight line through it and the last one,
    0.3 s on."""
    found = []
    for step in range(50, len(y_m) + 1, 10):
        last = y_m[step - 1]
        moved = last - y_m[step - 11] if step > 50 else 0.0
        found.append((step, 1.0 - abs(last + 0.3 * moved / (10 * DT)) / 1.2))
    return found


def test_it_parts_at_the_first_look_at_or_below_the_level(monkeypatch: pytest.MonkeyPatch) -> None:
    y_m = np.interp(np.arange(200), [0, 95, 190], [0.0, 0.0, 0.1])
    looks = looked(y_m)
    margins = [each for _, each in looks]
    level = 0.5 * (margins[7] + margins[8])
    assert margins[0] == 1.0
    first = next(n for n, each in enumerate(margins) if each <= level)
    Sky(monkeypatch, y_m)
    lowest, state, _ = process().passage(at_tick(40), 9, level)
    assert state.flight.steps == looks[first][0]
    assert state.margin == lowest == pytest.approx(margins[first], abs=1e-5)
    # Exactly at it is there.
    Sky(monkeypatch, np.zeros(200))
    assert process().passage(at_tick(40), 9, 1.0).state.flight.steps == 50


def test_what_stays_above_shows_its_lowest(monkeypatch: pytest.MonkeyPatch) -> None:
    y_m = np.interp(np.arange(175), [0, 60, 100, 175], [0.0, 0.0, 0.05, 0.02])
    margins = [each for _, each in looked(y_m)]  # the last at 170
    assert min(margins) < margins[-1] - 0.05
    Sky(monkeypatch, y_m)
    lowest, state, _ = process().passage(at_tick(40), 9, 0.0)
    assert state is None
    assert lowest == pytest.approx(min(margins), abs=1e-5)
    Sky(monkeypatch, y_m[:49])
    assert process().passage(at_tick(40), 9, 0.0) == Passage(inf, None, "")  # not one look


@pytest.mark.parametrize("how", [CRASHED, HANDED_OVER])
def test_a_flight_that_has_ended_above_every_level_is_lost_all_the_same(
    how: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    Sky(monkeypatch, np.zeros(93), how)
    lowest, state, _ = process().passage(at_tick(40), 9, 0.5)
    assert (lowest, state.margin, state.flight.steps) == (0.0, 0.0, 93)
    assert process().passage(at_tick(40), 9, 1.0).state.flight.steps == 50  # it was there first
    assert process().passage(at_tick(40), 9, -inf) == Passage(0.0, None, "")  # how low it comes


class Sky:
    """Flights as they are written down: to the side by `y_m` at each tick, and how they end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, y_m: Any, end: int = FLIES) -> None:
        self.rows, self.end = rows_of(y_m), end
        self.flights: list[tuple[Any, int, int, int]] = []
        self.noises: list[tuple[int, Any, int]] = []
        for name in ("fly_on", "continued", "lines_of", "why_ended"):
            monkeypatch.setattr(module, name, getattr(self, name))

    def fly_on(self, parts: Any, laws: Any, flight: Any, until: int, n: int, rows: Any) -> Any:
        assert laws is process().laws
        self.flights.append((parts, flight.steps, until, n))
        end = min(until, len(self.rows))
        rows[flight.steps : end] = self.rows[flight.steps : end]
        how = self.end if end == len(self.rows) else FLIES
        return SimpleNamespace(steps=end, standing=how)

    def continued(self, prepared: Any, seed: int, lines: Any, noise_seed: int) -> Any:
        assert prepared is process().prepared
        self.noises.append((seed, lines, noise_seed))
        return f"noise of {noise_seed}"

    def lines_of(self, parts: Any) -> Any:
        return (parts, "lines")

    def why_ended(self, _world: Any, flight: Any) -> str:
        return "hit the board at x = 3 m" if flight.standing == CRASHED else ""


def at_tick(steps: int, last: Any = None, margin: float = inf, cause: str = "") -> PartedFlight:
    return PartedFlight(
        seed=5,
        flight=standing(steps),
        lines=(("before",),),
        margin=margin,
        last=np.empty((0, len(SHOWN))) if last is None else last,
        cause=cause,
    )


def test_who_is_at_the_level_already_is_not_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    sky = Sky(monkeypatch, np.zeros(100))
    state = at_tick(40, margin=0.5, cause="over")
    assert process().passage(state, 9, 0.5) == Passage(0.5, state, "over")
    assert sky.flights == []


def test_who_stays_above_comes_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    sky = Sky(monkeypatch, np.zeros(TICKS))
    assert process().passage(at_tick(40), 9, 0.5) == Passage(1.0, None, "")
    assert sky.noises == [(5, (("before",),), 9)]
    assert sky.flights == [("noise of 9", 40, TICKS, 0)]


def test_where_it_comes_to_the_level_it_is_flown_once_more_as_far_as_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """0.6 m to the side from tick 1400 on, after a slow way out."""
    y_m = np.concatenate([np.linspace(0.0, 0.6, 1400), np.full(TICKS - 1400, 0.6)])
    speed = y_m[1] / DT
    sky = Sky(monkeypatch, y_m)
    lowest, state, cause = process().passage(at_tick(200), 9, 0.6)
    # y + 0.3 v = 0.48 m at 0.4 of 1.2 m.
    expected = next(s for s in range(220, TICKS, 10) if y_m[s - 1] + 0.3 * speed >= 0.48)
    assert sky.flights == [("noise of 9", 200, TICKS, 0), ("noise of 9", 200, expected, 0)]
    assert sky.noises == [(5, (("before",),), 9)] * 2
    assert (state.seed, state.flight.steps, state.cause, cause) == (5, expected, "", "")
    assert state.lines == ("noise of 9", "lines")
    assert (
        state.margin
        == lowest
        == pytest.approx(1.0 - (y_m[expected - 1] + 0.3 * speed) / 1.2, abs=1e-5)
    )
    # Twenty rows a second of the last five.
    ticks = np.arange(209, expected, 10)[-100:]
    shown = dict(zip(SHOWN, state.last.T, strict=True))
    assert shown["elevator"].tolist() == ticks.tolist()
    assert shown["time_s"] == pytest.approx(DT * (1.0 + ticks))
    assert shown["y_m"] == pytest.approx(y_m[ticks])


def test_what_was_shown_before_it_parted_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    Sky(monkeypatch, np.zeros(TICKS))
    before = np.full((98, len(SHOWN)), -1.0)
    before[:, SHOWN.index("elevator")] = -np.arange(98.0, 0.0, -1.0)
    before[:, SHOWN.index("time_s")] = np.linspace(-4.0, 0.8, 98)
    state = process().passage(at_tick(200, before), 9, 1.0).state
    elevator = state.last[:, SHOWN.index("elevator")]
    assert len(elevator) == 99
    assert elevator.tolist() == [*(-np.arange(98.0, 0.0, -1.0)), 209.0]


def test_a_loss_is_reported_without_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    sky = Sky(monkeypatch, np.zeros(333), CRASHED)
    found = process().passage(at_tick(200), 9, 0.5)
    assert (found.lowest, found.cause) == (0.0, "hit the board")
    assert (found.state.cause, found.state.margin) == ("hit the board", 0.0)
    assert len(sky.flights) == 1  # it is there


def test_before_its_first_tick_a_flight_has_all_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = process()
    monkeypatch.setattr(module, "begun", lambda prepared, seed: ((prepared, seed), "flight"))
    monkeypatch.setattr(module, "lines_of", lambda parts: parts)
    state: Any = ours.begun(8)
    assert (state.seed, state.flight, state.margin, state.cause) == (8, "flight", inf, "")
    assert state.lines == (ours.prepared, 8)
    assert state.last.shape == (0, len(SHOWN))
    assert ours.shown(state) is state.last


def test_the_files_of_a_sites_air_are_found_from_its_own_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[Any] = []
    field = process()._field

    def found(_site: Any, folder: Any) -> Any:
        given.append(folder)
        return field

    monkeypatch.setattr(module, "site_field", found)
    SoaringProcess(case()._replace(folder=Path("there")))
    assert given == [Path("there")]


@pytest.mark.parametrize(
    ("where", "side"),
    [
        ({"x_m": -0.41}, "upstream"),
        ({"x_m": 2.01}, "downstream"),
        ({"y_m": -1.21}, "to the side"),
        ({"z_m": 0.79}, "below"),
        ({"z_m": 2.61}, "above"),
    ],
)
def test_of_one_that_leaves_the_fence_the_side_is_reported(
    where: dict[str, float], side: str
) -> None:
    looks = {"x_m": process().place[0], "z_m": process().place[1], **where}
    shown = np.array([[looks.get(name, 0.0) for name in SHOWN]] * 30)
    assert process()._cause("outside the fence", shown) == f"outside the fence, {side}"
    assert process()._cause("hit the board", shown) == "hit the board"
    assert process()._cause("", shown) == ""


def test_a_wing_that_had_stalled_for_a_second_is_reported() -> None:
    """Its stall is at 0.20 rad: on average of the last twenty looks, and not in one gust."""
    shown = np.zeros((60, len(SHOWN)))
    shown[:, SHOWN.index("z_m")] = process().place[1]
    alpha = SHOWN.index("alpha_rad")
    shown[:40, alpha] = 0.5
    shown[40:, alpha] = 0.19
    shown[-1, alpha] = 0.3
    assert process()._cause("hit the board", shown) == "hit the board"
    shown[40:, alpha] = 0.21
    assert process()._cause("hit the board", shown) == "hit the board, stalled"
