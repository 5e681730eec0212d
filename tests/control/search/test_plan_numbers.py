"""The plan's numbers: what each candidate is worth, costs, and is refused for, at each limit.

Rollouts are scripted by each test: nothing is flown.
"""

from __future__ import annotations

from math import inf, pi, radians, sin, sqrt, tanh
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm
from test_rollout import BOX, ETA, GRID, GUARDS, POLAR, at_rest

from tgl_soar.control.search import plan
from tgl_soar.control.search.plan import (
    ANY_LINE,
    Keep,
    Leeway,
    LinePlan,
    allowed,
    candidates,
    horizon_of,
    likely_fields,
    plan_in,
    worths,
)
from tgl_soar.control.search.rollout import Fields, Lines, Moving, Rollouts, Well
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.lift_map.basis import Floats

H = BOX.height_m
HORIZON_S = 10.0
TARGET = TargetLine(0.7, 10.0, ETA)
AIR = Fields(np.full((4, 1), 9.0), np.zeros((4, 1)), np.ones(4), np.ones(4))

# --- the worth of one ---------------------------------------------------------------------------


def rollouts(shape: tuple[int, int], **columns: Any) -> Rollouts:
    """That soar far from everything, but for what is given."""
    usual = {"failed_s": inf, "climb_mps": 0.0, "x_m": 0.0, "z_m": 10.0}
    usual |= {"margin_m": 1e3, "speed_margin_mps": 50.0}
    return Rollouts(**{name: np.full(shape, value) for name, value in (usual | columns).items()})


def worth(lull_mps: float = 0.0, landing_m: float = 0.0, **columns: float) -> float:
    return float(worths(rollouts((1, 1), **columns), HORIZON_S, H, landing_m, lull_mps)[0, 0])


def test_who_soars_is_worth_one_and_its_margins() -> None:
    assert worth() == pytest.approx(1.0 + 0.3 + 0.2)
    # A tenth of H, and 1 m/s, are what a margin is measured by.
    assert worth(margin_m=0.1 * H) == pytest.approx(1.2 + 0.3 * tanh(1.0))
    assert worth(speed_margin_mps=1.0) == pytest.approx(1.3 + 0.2 * tanh(1.0))
    assert worth(climb_mps=-0.039) == worth(climb_mps=2.0) == worth()


@pytest.mark.parametrize("lull_mps", [0.0, 0.4])
def test_half_of_it_is_lost_by_who_cannot_be_held(lull_mps: float) -> None:
    """0.3 m/s under the polar's slowest, and a lull more, are flown through and not held."""
    for below, lost in ((0.0, 0.0), (0.15, 0.25), (0.3, 0.5), (0.6, 0.5)):
        aside = 0.3 + lull_mps - below
        found = worth(lull_mps, speed_margin_mps=aside)
        assert found == pytest.approx(1.3 + 0.2 * tanh(max(aside, 0.0)) - lost)


def test_who_sinks_is_worth_up_to_half_by_the_time_that_is_left() -> None:
    assert worth(climb_mps=-0.5, z_m=6.0, landing_m=1.0) == pytest.approx(0.5 * 10.0 / 20.0)
    assert worth(climb_mps=-0.5, z_m=16.0, landing_m=1.0) == pytest.approx(0.5 * 30.0 / 40.0)
    assert worth(climb_mps=-0.5, z_m=0.5, landing_m=1.0) == 0.0  # below it none is left
    assert worth(climb_mps=-0.041, z_m=5.1) == pytest.approx(
        0.5 * (5.1 / 0.041) / (5.1 / 0.041 + 10.0)
    )


def test_who_leaves_a_guard_is_worth_less_than_nothing_and_more_the_later() -> None:
    assert worth(failed_s=0.0, climb_mps=3.0) == -1.0
    assert worth(failed_s=4.0) == pytest.approx(-0.8)
    assert worth(failed_s=HORIZON_S) == worth(failed_s=99.0) == pytest.approx(-0.5)


@pytest.mark.parametrize("sigmas", [-1.0, 0.0, 0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("lull_mps", [0.2, 0.9])
def test_gusts_leave_a_guard_as_likely_as_a_normal_distribution_says(
    sigmas: float, lull_mps: float
) -> None:
    """V sigma / g with V / g of a second; a logistic is it within a hundredth."""
    margin_m = sigmas * lull_mps
    stays = 1.2 + 0.3 * tanh(max(margin_m, 0.0) / (0.1 * H))
    chance = norm.cdf(-sigmas)
    found = worth(lull_mps, margin_m=margin_m)
    assert found == pytest.approx((1.0 - chance) * stays - 0.5 * chance, abs=0.02)
    sinks = worth(lull_mps, margin_m=margin_m, climb_mps=-1.0)
    assert sinks == pytest.approx((1.0 - chance) * 0.25 - 0.5 * chance, abs=0.0075)


def test_without_gusts_a_margin_is_one_or_is_none() -> None:
    assert worth(margin_m=1e-3) == pytest.approx(1.2 + 0.3 * tanh(1e-3 / (0.1 * H)))
    assert worth(margin_m=-1e-3) == pytest.approx(-0.5)


# --- candidates ---------------------------------------------------------------------------------


def moving(eta_rad: float = ETA, speed_mps: float = 0.0) -> Moving:
    now = at_rest(1.0, 8.0)
    return now._replace(line=now.line._replace(eta_rad=eta_rad, speed_mps=speed_mps))


def places(lines: Lines) -> list[tuple[float, float, float]]:
    """Distance in H and height from the aircraft, and lean in degrees."""
    return sorted(
        (round((x - 1.0) / H, 6), round(z - 8.0, 6), round(float(np.degrees(eta)) - 90.0, 3))
        for x, z, eta in zip(*lines, strict=True)
    )


@pytest.mark.parametrize(
    ("lean_deg", "others"),
    [(15.0, (10.0, 25.0)), (17.9, (10.0, 25.0)), (18.1, (10.0, 15.0, 25.0)), (27.0, (10.0, 15.0))],
)
def test_lines_at_eight_distances_and_at_other_leans_at_three(
    lean_deg: float, others: tuple[float, ...]
) -> None:
    """A lean within 3 degrees of the line's is the line's."""
    lines = candidates(moving(radians(90.0 + lean_deg)), TARGET, H, 0.5)
    assert tuple(float(column[0]) for column in lines) == TARGET
    own = (0.03, 0.06, 0.10, 0.16, 0.24, 0.35, 0.50, 0.70)
    expected = [(0.0, 0.0, lean_deg)]  # where it stands still
    expected += [(side * d, 0.0, lean_deg) for d in own for side in (-1.0, 1.0)]
    for lean in others:
        expected += [(side * d, 0.0, lean) for d in (0.06, 0.16, 0.35) for side in (-1.0, 1.0)]
        expected.append((0.0, 0.0, lean))
    assert places(Lines(*(column[1:] for column in lines))) == pytest.approx(sorted(expected))


@pytest.mark.parametrize("speed_mps", [0.6, -0.6])
def test_a_line_that_moves_stops_beyond_where_the_aircraft_is(speed_mps: float) -> None:
    """After v² / 2a, positive upstream, across itself."""
    stop = candidates(moving(speed_mps=speed_mps), TARGET, H, 0.5)
    way = 0.6**2 / (2.0 * 0.5) * (1.0 if speed_mps > 0.0 else -1.0)
    assert stop.x_m[1] == pytest.approx(1.0 - way * sin(ETA))
    assert (stop.z_m[1], stop.eta_rad[1]) == (8.0, ETA)


def lean(degrees: float, x_m: float = 0.0, z_m: float = 8.0) -> TargetLine:
    return TargetLine(x_m, z_m, radians(90.0 + degrees))


def lines_of(*rows: TargetLine) -> Lines:
    """The target first, which is always kept."""
    columns = np.array([TARGET, *rows])
    return Lines(columns[:, 0], columns[:, 1], columns[:, 2])


def kept(leeway: Leeway, *rows: TargetLine) -> list[TargetLine]:
    return [
        TargetLine(*row) for row in zip(*allowed(lines_of(*rows), moving(), H, leeway), strict=True)
    ][1:]


def test_inclinations_have_two_ends() -> None:
    rows = [lean(9.9), lean(10.0), lean(20.0), lean(25.0), lean(25.1)]
    leeway = Leeway(eta_min_rad=radians(100.0), eta_max_rad=radians(115.0))
    assert kept(leeway, *rows) == rows[1:4]
    everything = [TargetLine(0.0, 0.0, 0.0), TargetLine(0.0, 0.0, pi)]
    assert kept(ANY_LINE, *everything) == everything


@pytest.mark.parametrize(
    ("apart_deg", "same"), [(2.9, True), (-2.9, True), (3.1, False), (-3.1, False)]
)
def test_a_refused_lean_is_refused_everywhere_within_three_degrees(
    apart_deg: float, same: bool
) -> None:
    near, far = lean(25.0 + apart_deg), lean(25.0 + apart_deg, x_m=9.0)
    leeway = Leeway(refused=(lean(25.0),))
    assert kept(leeway, near, far) == ([] if same else [near, far])
    # What is refused first is refused as well.
    both = Leeway(refused=(lean(25.0), lean(50.0)))
    assert kept(both, near, lean(50.0)) == ([] if same else [near])


@pytest.mark.parametrize("apart_deg", [0.0, 2.9, -2.9])
@pytest.mark.parametrize("over_m", [0.0, 3.0])
def test_at_the_line_s_own_lean_a_place_is_refused_within_three_hundredths_of_h(
    apart_deg: float, over_m: float
) -> None:
    """Across the refused line, whatever the way along it is."""
    own = lean(15.0 + apart_deg)
    eta = own.eta_rad
    leeway = Leeway(refused=(own,))
    for across, same in (
        (0.0, True),
        (0.029, True),
        (-0.029, True),
        (0.031, False),
        (-0.031, False),
    ):
        x = over_m * np.cos(eta) - across * H * np.sin(eta)
        z = 8.0 + over_m * np.sin(eta) + across * H * np.cos(eta)
        row = TargetLine(float(x), float(z), ETA)
        assert kept(leeway, row) == ([] if same else [row])


def test_at_a_lean_that_is_just_another_one_the_lean_is_refused() -> None:
    own = lean(18.1)  # 3.1 degrees from the line's
    assert kept(Leeway(refused=(own,)), lean(17.0, x_m=15.0)) == []
    assert kept(Leeway(refused=(lean(17.9),)), lean(17.0, x_m=15.0)) != []


# --- fields and the horizon ---------------------------------------------------------------------


def test_fields_are_of_three_winds_and_of_no_trend_beyond_a_fifth() -> None:
    mean = np.zeros(GRID.basis.count)
    mean[0] = 10.0
    fields = likely_fields(
        GRID, mean, np.tile(mean, (4, 1)), 1.05, np.array([0.7, 0.81, 1.19, 1.3])
    )
    assert fields.ends == pytest.approx([1.05, 0.945, 1.155, 0.8, 0.81, 1.19, 1.2])
    # However far it is foreseen to fall or rise, there is a weaker and a stronger one beside it.
    for ahead, foreseen in ((0.85, 0.85), (0.7, 0.8), (1.3, 1.2)):
        ends = likely_fields(GRID, mean, mean[None], ahead).ends[:3]
        assert ends == pytest.approx([foreseen, 0.9 * foreseen, 1.1 * foreseen])
    usual = likely_fields(GRID, mean, mean[None])
    assert usual.ends == pytest.approx([1.0, 0.9, 1.1, 1.0])
    assert usual.wind_mps[:, 0] == pytest.approx([10.0] * 4)


def test_rollouts_look_ahead_for_eight_seconds_and_a_glide_through_the_box() -> None:
    assert horizon_of(0.0) == 8.0
    assert horizon_of(13.3) == pytest.approx(18.0)


# --- the choice ---------------------------------------------------------------------------------


class Flown:
    """What stands for rollouts and wells: what a test says of each candidate."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lines = allowed(
            candidates(at_rest(), TARGET, H, GUARDS.line.acceleration_mps2), at_rest(), H, ANY_LINE
        )
        self.count = len(self.lines.x_m)
        self.out = rollouts((4, self.count))
        self.holds_s = np.full(self.count, 1e9)
        self.asked: list[tuple[float, int]] = []
        self.raised_m = 0.0
        self.diffusion_m2ps = 0.0
        monkeypatch.setattr(plan, "wells", self.wells)

    def wells(self, *given: Any) -> Well:
        assert (given[5] == self.out.x_m[0]).all()
        assert (given[6] == self.out.z_m[0]).all()
        self.diffusion_m2ps = given[7]
        return Well(np.ones(self.count), np.ones(self.count), self.holds_s)

    def roll(self, *given: Any) -> Rollouts:
        self.asked.append(given[6:])
        self.raised_m = float(given[0].mesh.floor.height_m[0] - GRID.mesh.floor.height_m[0])
        return self.out

    def plan(self, diffusion_m2ps: float = 1e-9, **options: Any) -> LinePlan:
        return plan_in(
            *(GRID, AIR, POLAR, GUARDS, at_rest(), TARGET, diffusion_m2ps),
            roll=self.roll,
            **options,
        )

    def lost_at(self, times_s: Floats) -> None:
        """Each is lost at a time, in all fields."""
        self.out = self.out._replace(failed_s=np.tile(times_s, (4, 1)))


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> Flown:
    return Flown(monkeypatch)


def test_a_rollout_has_64_steps_over_ground_that_is_raised(flown: Flown) -> None:
    flown.plan(0.3)
    assert flown.asked == [(horizon_of(H), 64)]
    assert flown.raised_m == pytest.approx(0.5)  # 1.5 m for landing, less the clearance of 1 m
    assert flown.diffusion_m2ps == 0.3


def test_moving_has_its_price(flown: Flown) -> None:
    """5 hundredths, a fifth for each H, and 3 hundredths where the lean is another one."""
    horizon_s = horizon_of(H)
    for i in range(1, flown.count):
        price = 0.05 + 0.2 * abs(float(flown.lines.x_m[i])) / H
        price += 0.03 * (abs(float(flown.lines.eta_rad[i]) - ETA) > 1e-3)
        for more, stays in ((-0.002, True), (0.002, False)):
            times_s = np.full(flown.count, 0.1 * horizon_s)
            times_s[i] += 2.0 * horizon_s * (price + more)
            flown.lost_at(times_s)
            found = flown.plan()
            assert found.stays == stays
            assert found.target == (
                TARGET if stays else TargetLine(*(float(column[i]) for column in flown.lines))
            )
            assert found.worth == pytest.approx(-0.95 + (0.0 if stays else price + more))
            assert found.lasts_s == pytest.approx(times_s[0 if stays else i])


@pytest.mark.parametrize(("worth", "stays"), [(-0.96, True), (-0.94, False)])
def test_a_line_that_is_good_enough_is_kept(flown: Flown, worth: float, stays: bool) -> None:
    times_s = np.full(flown.count, 0.1 * horizon_of(H))
    times_s[3] = horizon_of(H)
    flown.lost_at(times_s)
    assert flown.plan(keep=Keep(worth, weaker=False)).stays == stays


def test_the_best_is_reported_as_it_is_in_the_mean_field(flown: Flown) -> None:
    """All but one are lost; that one soars in three fields of four."""
    flown.lost_at(np.ones(flown.count))
    columns = {}
    values = {"failed_s": inf, "climb_mps": 0.1, "x_m": -2.0, "z_m": 11.0, "margin_m": 4.0}
    for name, value in values.items():
        column = getattr(flown.out, name).copy()
        column[:, 5] = [value, value, value, 3.0 if name == "failed_s" else value]
        columns[name] = column
    flown.out = flown.out._replace(**columns)
    flown.holds_s[5] = 400.0
    found = flown.plan()
    assert not found.stays
    assert (found.chance, found.most_chance, found.stay_chance) == (0.75, 0.75, 0.0)
    assert not found.stay_weaker
    assert (found.place_x_m, found.place_z_m, found.margin_m) == (-2.0, 11.0, 4.0)
    assert found.holds_s == 400.0
    assert found.lasts_s == pytest.approx((3.0 * horizon_of(H) + 3.0) / 4.0)


@pytest.mark.parametrize(
    ("holds_s", "less"), [(0.0, 1.0), (150.0, 0.5), (299.0, 1.0 / 300.0), (301.0, 0.0)]
)
def test_a_place_that_gusts_leave_in_five_minutes_is_worth_less(
    flown: Flown, holds_s: float, less: float
) -> None:
    best = flown.plan(keep=Keep(-9.0, weaker=False))
    assert best.worth == pytest.approx(1.5)
    flown.holds_s[:] = holds_s
    assert flown.plan(keep=Keep(-9.0, weaker=False)).worth == pytest.approx(1.5 - less)
    # Where the mean field does not soar there is no well: less worth it is already.
    climbs = flown.out.climb_mps.copy()
    climbs[0] = -0.1
    flown.out = flown.out._replace(climb_mps=climbs)
    sinks = flown.plan(keep=Keep(-9.0, weaker=False)).worth
    flown.holds_s[:] = 1e9
    assert flown.plan(keep=Keep(-9.0, weaker=False)).worth == sinks


@pytest.mark.parametrize(("climb_mps", "soars"), [(-0.039, True), (-0.041, False), (0.5, True)])
def test_who_settles_slower_than_four_hundredths_soars(
    flown: Flown, climb_mps: float, soars: bool
) -> None:
    flown.out = rollouts((4, flown.count), climb_mps=climb_mps)
    found = flown.plan()
    assert (found.chance, found.most_chance) == ((1.0, 1.0) if soars else (0.0, 0.0))
    assert found.stay_weaker == soars
    lost = rollouts((4, flown.count), failed_s=9.0)
    flown.out = lost
    assert flown.plan().most_chance == 0.0


@pytest.mark.parametrize("diffusion_m2ps", [0.02, 0.18])
def test_a_line_is_held_with_a_lull_beyond_what_is_flown_through(
    flown: Flown, diffusion_m2ps: float
) -> None:
    """White gusts of diffusion D have means over a second of a deviation of √(2 D)."""
    needed = 0.3 + sqrt(2.0 * diffusion_m2ps)
    for more, holds in ((0.01, True), (-0.01, False)):
        asides = np.full((4, flown.count), 50.0)
        asides[1, 0] = needed + more
        flown.out = flown.out._replace(speed_margin_mps=asides)
        found = flown.plan(diffusion_m2ps)
        assert found.stay_chance == (1.0 if holds else 0.75)
        assert found.stay_weaker == holds
        assert found.most_chance == 1.0
    # Which of the fields does not hold it does not matter to the chance.
    flown.out = flown.out._replace(speed_margin_mps=asides[[1, 0, 2, 3]])
    found = flown.plan(diffusion_m2ps)
    assert (found.stay_chance, found.stay_weaker) == (0.75, True)


def test_lines_beyond_the_leeway_are_not_chosen(flown: Flown) -> None:
    leeway = Leeway(eta_min_rad=radians(104.0), eta_max_rad=radians(106.0))
    flown.lines = allowed(flown.lines, at_rest(), H, leeway)
    flown.count = len(flown.lines.x_m)
    flown.out, flown.holds_s = rollouts((4, flown.count)), np.full(flown.count, 1e9)
    assert flown.plan(leeway=leeway).stays
    assert flown.count == 18
