"""The flights of `outdoors`: throws, break-offs and lulls as they are drawn, what is read off a
path, and what its tables make of it."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, inf, isinf, isnan, log, nan
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.gusts import ScaledField
from tgl_soar.analysis.experiments import random_aircraft
from tgl_soar.analysis.experiments.outdoors import outdoors
from tgl_soar.analysis.experiments.outdoors.outdoors import (
    LAND,
    LAUNCH,
    LULLED,
    WITH_IMU,
    FlownPassage,
    PassageJob,
    fraction_within,
    is_lost,
    span,
    stays_claim,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.control.supervisor import BREAKING_OFF, CAPTURING, LANDING, LAUNCHING, SOARING
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.score import touches_down_well
from tgl_soar.sim.sensors import MEMS_IMU
from tgl_soar.sim.throw import Throw, ThrownWorld
from tgl_soar.types import Ground

HILL = shipped_hill()
FLAT = Ground(2, (-90.0, 90.0, *[90.0] * 6), (0.0,) * 8)


class Begun(Exception):
    """A flight was to begin."""


class Asked:
    """What was to be flown."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.worlds: list[tuple[Any, dict[str, Any]]] = []
        self.flights: list[tuple[Any, ...]] = []
        made = random_aircraft.flown_world

        def flown_world(airframe: Any, site: Any, seed: int, **wanted: Any) -> Any:
            self.worlds.append((site, wanted))
            return made(airframe, site, seed, **wanted)

        def fly(*what: Any) -> Any:
            self.flights.append(what)
            raise Begun

        monkeypatch.setattr(outdoors, "available", lambda: False)
        monkeypatch.setattr(outdoors, "shipped_hill", lambda: HILL)
        monkeypatch.setattr(outdoors, "flown_world", flown_world)
        monkeypatch.setattr(outdoors, "fly", fly)

    def of(self, kind: str, seeds: range) -> None:
        for seed in seeds:
            with pytest.raises(Begun):
                outdoors.fly_passage(PassageJob(kind, seed))


def test_a_launch_is_a_push_into_the_wind_before_the_crest(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch)
    asked.of(LAUNCH, range(60))
    throws: list[Throw] = []
    for (site, wanted), (world, values, changes, duration_s) in zip(
        asked.worlds, asked.flights, strict=True
    ):
        assert isinstance(world, ThrownWorld)
        throws.append(world.throw)
        assert (site.start.x_m, site.start.z_m) == (-4.5, 8.4)
        assert 6.8 <= site.air.wind_mps <= 7.6
        assert 0.0 <= wanted["turbulence"] <= 0.05
        assert wanted["already"] == ("wind",)
        assert values["LNC_START"] == 1.0
        assert (changes, duration_s) == ((), 30.0)
    assert {throw.time_s for throw in throws} == {2.0}
    assert {throw.roll_rad for throw in throws} == {0.0}
    for numbers, low, high in (
        ([throw.speed_mps for throw in throws], 2.0, 4.0),
        ([degrees(throw.pitch_rad) for throw in throws], -20.0, 20.0),
        ([degrees(throw.heading_rad) for throw in throws], -20.0, 20.0),
        ([site.air.wind_mps for site, _ in asked.worlds], 6.8, 7.6),
        ([wanted["turbulence"] for _, wanted in asked.worlds], 0.0, 0.05),
    ):
        near = 0.1 * (high - low)
        assert low <= min(numbers) < low + near
        assert high - near < max(numbers) <= high


@pytest.mark.parametrize("kind", [LAND, WITH_IMU])
def test_a_break_off_is_by_command_after_3_to_15_s_from_any_line(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Asked(monkeypatch)
    asked.of(kind, range(40))
    times, lines = [], set()
    for (site, wanted), (world, values, changes, duration_s) in zip(
        asked.worlds, asked.flights, strict=True
    ):
        ((time_s, parameters),) = changes
        times.append(time_s)
        assert parameters == {"ESC_START": 1.0}
        assert wanted["field"] is None
        assert world.sensors.imu == (MEMS_IMU if kind == WITH_IMU else None)
        assert values["ESC_AUTO"] == HILL.values["ESC_AUTO"] == 0.0
        assert duration_s == 75.0
        lines.add((site.start.x_m, site.start.z_m))
    assert lines == {(line.x_m, line.z_m - 0.5) for line in HILL.site.lines.values()}
    assert 3.0 <= min(times) < 4.0
    assert 14.0 < max(times) <= 15.0


def test_in_a_lull_nobody_commands_and_the_wind_falls_to_0_88_in_six_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = Asked(monkeypatch)
    asked.of(LULLED, range(4))
    for (site, wanted), (world, values, changes, _) in zip(
        asked.worlds, asked.flights, strict=True
    ):
        assert changes == ()
        assert values["ESC_AUTO"] == 1.0
        assert world.sensors.imu is None
        field = wanted["field"]
        assert isinstance(field, ScaledField)
        winds = [field.wind_at(-500.0, 0.0, 0.1, t)[0] for t in (0.0, 12.0, 15.0, 18.0, 60.0)]
        full = site.air.wind_mps
        assert winds == pytest.approx([full, full, 0.94 * full, 0.88 * full, 0.88 * full], rel=1e-3)


def test_a_seed_is_one_flight_and_each_kind_has_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch)
    for kind in (LAND, LAND, LAUNCH):
        asked.of(kind, range(5, 6))
    one, again, launch = (site.air.wind_mps for site, _ in asked.worlds)
    assert one == again != launch


# --- what is read off a path ----------------------------------------------------------------------

STEP_S = 0.05


def path(ended: str = "", **columns: Any) -> Trajectory:
    """Twenty seconds: launched for two, to the line until 6 s, broken off at 12, landing at 16."""
    time = np.arange(0.0, 20.0, STEP_S)
    mode = np.select(
        [time < 2.0, time < 6.0, time < 12.0, time < 16.0],
        [LAUNCHING, CAPTURING, SOARING, BREAKING_OFF],
        LANDING,
    )
    made = {
        "time_s": time,
        "mode": mode.astype(float),
        "reason": np.where(np.isclose(time, 12.0), 45.0, 0.0),
        "x_m": -4.0 - time,
        "y_m": 0.1 * time,
        "z_m": 12.0 - 0.4 * time,
        "height_left_m": 7.0 - 0.5 * time,
    }
    made |= {name: np.asarray(column, dtype=float) for name, column in columns.items()}
    return Trajectory(made, ended, len(time))


def outcome(flown: Trajectory, throw: Throw | None = None) -> FlownPassage:
    return outdoors._outcome(PassageJob(LAUNCH, 9), HILL, 0.02, throw, FLAT, flown)


def test_a_path_tells_its_modes_and_where_it_broke_off_and_ended() -> None:
    throw = Throw(time_s=2.0, speed_mps=3.5, roll_rad=0.0, pitch_rad=0.1, heading_rad=-0.2)
    found = outcome(path("hit the ground"), throw)
    assert [(time_s, mode) for time_s, mode, _ in found.modes] == [
        (0.0, "launching"),
        (pytest.approx(2.0), "capturing"),
        (pytest.approx(6.0), "soaring"),
        (pytest.approx(12.0), "breaking off"),
        (pytest.approx(16.0), "landing"),
    ]
    assert [why for _, _, why in found.modes] == ["", "", "", REASON_TEXTS[45], ""]
    # The height left is that of the tick before: then the way home was chosen.
    assert found.left_m == pytest.approx(7.0 - 0.5 * 11.95)
    assert found.broke_at_m == pytest.approx(12.0 - 4.8 - HILL.values["LND_Z"])
    # From a second after the throw until it broke off.
    assert found.over_ground_m == pytest.approx(12.0 - 0.4 * 11.95)
    assert found.along_m == pytest.approx(HILL.values["LND_X"] + 4.0 + 19.95)
    assert found.across_m == pytest.approx(1.995 - HILL.values["LND_Y"])
    assert found.sink_mps == pytest.approx(0.4)
    assert (found.throw_mps, found.throw_pitch_deg) == pytest.approx((3.5, degrees(0.1)))
    assert found.throw_heading_deg == pytest.approx(degrees(-0.2))
    assert found.duration_s == pytest.approx(19.95)
    assert (found.wind_mps, found.intensity, found.seed) == (HILL.air.wind_mps, 0.02, 9)
    assert found.broke_off
    assert not found.soars


def test_a_drawn_path_has_a_point_each_tenth_of_a_second_in_centimetres() -> None:
    drawn = outcome(path()).path
    assert len(drawn) == 200
    assert drawn[0] == (-4.0, 0.0, 12.0)
    assert drawn[1] == (-4.1, 0.01, 11.96)
    assert drawn[33] == (-7.3, 0.33, 10.68)


def test_the_least_clearance_leaves_out_the_hand_and_the_way_home() -> None:
    time = np.arange(0.0, 20.0, STEP_S)
    dips = np.full(len(time), 9.0)
    dips[time < 3.0] = 1.0
    dips[time >= 12.0] = 0.5
    dips[np.isclose(time, 3.1)] = 4.0
    assert outcome(path(z_m=dips)).over_ground_m == pytest.approx(4.0)
    dips[np.isclose(time, 3.05)] = 3.0
    assert outcome(path(z_m=dips)).over_ground_m == pytest.approx(3.0)


def test_who_never_broke_off_has_no_height_to_tell() -> None:
    steady = outcome(path(mode=np.full(400, SOARING)))
    assert isnan(steady.left_m)
    assert isnan(steady.broke_at_m)
    assert isnan(steady.throw_mps)
    assert isnan(steady.throw_pitch_deg)
    assert isnan(steady.throw_heading_deg)
    assert steady.soars
    assert not steady.broke_off
    home = outcome(path(mode=np.full(400, BREAKING_OFF)))
    assert home.left_m == pytest.approx(7.0)  # there is no tick before the first
    assert isinf(home.over_ground_m)


# --- limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("along_m", "across_m", "sink_mps", "well"),
    [
        (10.0, 5.0, 1.5, True), (-10.0, -5.0, 1.5, True), (10.01, 0.0, 0.0, False),
        (-10.01, 0.0, 0.0, False), (0.0, 5.01, 0.0, False), (0.0, -5.01, 0.0, False),
        (0.0, 0.0, 1.51, False), (nan, 0.0, 0.0, False), (0.0, nan, 0.0, False),
        (0.0, 0.0, nan, False),
    ],
)  # fmt: skip
def test_touching_down_well_is_within_10_and_5_m_at_1_5_mps(
    along_m: float, across_m: float, sink_mps: float, well: bool
) -> None:
    assert touches_down_well(along_m, across_m, sink_mps) is well


def test_who_lands_softly_anywhere_is_not_lost() -> None:
    assert not is_lost("hit the ground", True, 1.5)
    assert is_lost("hit the ground", True, 1.51)
    assert is_lost("hit the ground", False, 0.1)
    assert not is_lost("disengaged: too low", False, 3.0)
    assert not is_lost("", False, 0.0)


def test_a_span_is_least_median_and_most_of_what_is_known() -> None:
    assert span([3.0, nan, 1.0, inf, 2.0, 10.0]) == "1.0, 2.5, 10.0"
    assert span([1.234], 2) == "1.23, 1.23, 1.23"
    assert span([nan, inf]) == span([]) == "–"


def test_within_is_a_fraction_of_all_ticks_to_either_side() -> None:
    assert fraction_within([0.3, -0.3, 0.31, -0.31]) == 0.5
    assert fraction_within([]) == 0.0
    assert fraction_within([0.1]) == 1.0


class Near:
    """A flight beside its lift."""

    def __init__(self, off_m: float, within: float, gone: bool = False) -> None:
        self.off_m, self.within, self.gone = off_m, within, gone


def test_each_flight_stays_within_30_cm_to_the_end_or_the_claim_fails() -> None:
    near, at, off, lost = Near(0.1, 1.0), Near(0.3, 1.0), Near(0.31, 0.5), Near(0.1, 1.0, True)
    assert stays_claim("kind", [near, at]).holds
    assert not stays_claim("kind", [near, off]).holds
    assert not stays_claim("kind", [near, lost]).holds
    found = stays_claim("kind", [near, off, lost])
    assert found.text == "kind: the aircraft stays within 0.3 m of its lift"
    assert found.measured.startswith("1 of 3")
    assert found.measured.endswith("at every instant, 83 % of the time")
    assert stays_claim("kind", []).measured.endswith(" 0 % of the time")


def test_so_many_flights_show_a_fraction_if_all_end_well() -> None:
    """The exact interval of n of n begins at 0.025 to the power of one n-th."""
    for least, wanted in ((0.99, 368), (0.95, 72), (0.9, 36)):
        assert outdoors.flights_to_show(least) == wanted
        assert 0.025 ** (1.0 / wanted) >= least > 0.025 ** (1.0 / (wanted - 1))
        assert wanted - 1 < log(0.025) / log(least) <= wanted


# --- tables ---------------------------------------------------------------------------------------

GOOD = FlownPassage(
    kind=LAND, seed=1, duration_s=40.0, wind_mps=7.0, intensity=0.02, throw_mps=nan,
    throw_pitch_deg=nan, throw_heading_deg=nan,
    modes=((0.0, "capturing", "engaged"), (12.0, "breaking off", "x"), (30.0, "landing", "y")),
    ended="hit the ground", left_m=1.0, broke_at_m=10.0, over_ground_m=3.0, along_m=2.0,
    across_m=1.0, sink_mps=0.8, path=(),
)  # fmt: skip


def test_launches_are_told_apart_by_what_became_of_them() -> None:
    thrown = replace(GOOD, kind=LAUNCH, throw_mps=3.0, throw_pitch_deg=5.0)
    captured = replace(
        thrown, modes=((0.0, "launching", ""), (9.0, "soaring", "on the line")), ended="",
        left_m=nan, broke_at_m=nan, over_ground_m=2.0,
    )  # fmt: skip
    lost = replace(captured, modes=((0.0, "launching", ""),), ended="hit the ground")
    table = outdoors._launches([thrown, captured, captured, lost])
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["captured"] == ("2", *["3.0, 3.0, 3.0"], "5.0, 5.0, 5.0", "7.0, 7.0, 7.0",
                                "2.0, 2.0, 2.0", "–")  # fmt: skip
    assert rows["given up, of these landed"][3:] == (
        "10.0, 10.0, 10.0", "3.0, 3.0, 3.0", "2.0, 2.0, 2.0",
    )  # fmt: skip
    assert rows["lost or disengaged"][0] == "1"
    assert rows["lost or disengaged"][3] == "–"  # it neither soared nor broke off


def test_break_offs_are_told_apart_by_the_height_that_was_left() -> None:
    less = replace(GOOD, left_m=-0.1, along_m=20.0)
    imu, lull = replace(GOOD, kind=WITH_IMU), replace(GOOD, kind=LULLED)
    given_up = replace(GOOD, kind=LAUNCH)
    by_kind = {
        LAND: [GOOD, replace(GOOD, left_m=0.0), less],
        WITH_IMU: [imu, replace(imu, left_m=-1.0), replace(imu, left_m=-2.0)],
        LULLED: [lull, replace(lull, broke_at_m=nan)],
        LAUNCH: [given_up] * 3 + [replace(given_up, broke_at_m=nan)],
    }
    table = outdoors._landings(by_kind)
    counts = {row[0]: row[1].partition(" (")[0] for row in table.rows}
    assert [words.split(" of ")[1].split(",")[0].split(" ")[0] for words in counts.values()] == [
        "2", "1", "1", "2", "1", "3",
    ]  # fmt: skip
    first, second = table.rows[:2]
    assert first[2:] == (
        "0.0, 0.5, 1.0", "10.0, 10.0, 10.0", "2.0, 2.0, 2.0", "1.0, 1.0, 1.0", "0.80, 0.80, 0.80",
    )  # fmt: skip
    assert second[1].startswith("0 of 1")


def test_a_flight_that_ends_badly_tells_its_last_modes() -> None:
    modes = tuple((float(t), f"mode {t}", f"why {t}") for t in range(5))
    far = replace(GOOD, modes=modes, along_m=12.34, ended="")
    (line,) = outdoors._badly([GOOD, far])
    assert line == (
        "landing 1 (7.00 m/s, 2 %): 3 s mode 3 (why 3), 4 s mode 4 (why 4); flies, along 12.3 m,"
        " across 1.0 m, sink 0.80 m/s, height left 1.0 m"
    )


def test_ends_are_listed_by_kind_the_most_frequent_first() -> None:
    ends = ["", "b", "a", "a"]
    flights = {"one": [replace(GOOD, ended=end) for end in ends], "two": []}
    assert outdoors.ends_by_kind(flights) == "one: a (2); one: b (1)"
