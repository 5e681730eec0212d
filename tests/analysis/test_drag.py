"""The drag from steady glides, on glides made of a parabola."""

from __future__ import annotations

from math import atan2, cos, sin, sqrt, tan

import numpy as np
import pytest
from scipy import stats

from tgl_soar.analysis.drag import Drag, drag_of
from tgl_soar.analysis.identification import KnownAircraft
from tgl_soar.estimation.polar import GlideStretch

BODY = KnownAircraft(
    mass_kg=0.7,
    wing_area_m2=0.18,
    chord_m=0.16,
    iyy_kgm2=0.02,
    air_density_kgpm3=1.2,
    servo_lag_radps=40.0,
    servo_rate_per_s=10.0,
)
GRAVITY_MPS2 = 9.80665
CD0, CD_LIFT, CD_BRAKE = 0.03, 0.05, 0.04
ATTACHED = (0.3, 0.36, 0.45, 0.55, 0.62, 0.7)  # lift coefficients
ENOUGH = 5


def glide(lift: float, brake: float = 0.0, more: float = 0.0) -> GlideStretch:
    """A steady glide with a lift coefficient: drag over lift is the slope of the path."""
    drag = CD0 + CD_LIFT * lift**2 + CD_BRAKE * brake + more
    angle = atan2(drag, lift)
    weight = BODY.mass_kg * GRAVITY_MPS2
    pressure = weight * cos(angle) / (BODY.wing_area_m2 * lift)
    speed = sqrt(2.0 * pressure / BODY.air_density_kgpm3)
    return GlideStretch(
        pitch_rad=0.0,
        speed_mps=speed * cos(angle),
        sink_mps=speed * cos(angle) * tan(angle),
        duration_s=3.0,
        brake=brake,
    )


def named(found: tuple[Drag, ...]) -> dict[str, float]:
    return {each.name: each.value for each in found}


def test_the_parabola_of_exact_glides_is_found_with_no_band() -> None:
    found = drag_of([glide(lift) for lift in ATTACHED], BODY)
    assert named(found) == pytest.approx({"CD0": CD0, "CD_lift": CD_LIFT})
    assert all(each.half_band < 1e-9 for each in found)


def test_the_brakes_drag_is_told_apart_where_it_moved_by_a_quarter() -> None:
    glides = [glide(lift, 0.5 * (i % 2)) for i, lift in enumerate(ATTACHED)]
    expected = {"CD0": CD0, "CD_lift": CD_LIFT, "CD_brake": CD_BRAKE}
    assert named(drag_of(glides, BODY)) == pytest.approx(expected)
    for out, names in ((0.24, 2), (0.26, 3)):
        moved = [glide(lift, out * (i % 2)) for i, lift in enumerate(ATTACHED)]
        assert len(drag_of(moved, BODY)) == names


def test_slow_glides_whose_flow_may_separate_are_left_out_where_enough_remain() -> None:
    """Above eight tenths of the largest lift: 0.9 and 1.0 with drag that no parabola has."""
    slow = [glide(0.81, more=0.03), glide(1.0, more=0.05)]
    five = [glide(lift) for lift in (*ATTACHED[:4], 0.79)]
    assert named(drag_of([*five, *slow], BODY)) == pytest.approx({"CD0": CD0, "CD_lift": CD_LIFT})
    four = named(drag_of([*five[:4], *slow], BODY))
    assert four["CD_lift"] > 1.2 * CD_LIFT  # all that there is


def test_the_largest_lift_is_that_of_glides_with_the_brake_where_it_stood() -> None:
    """Its lift is another with the brake: the glides with it out are all below its own largest."""
    clean = [glide(lift) for lift in (0.3, 0.4, 0.5, 0.6, 1.0)]
    braked = [glide(lift, 0.5) for lift in (0.25, 0.3, 0.35, 0.39)]
    last = glide(0.5, 0.5, more=0.03)  # separated there, and far below the clean one's largest
    expected = {"CD0": CD0, "CD_lift": CD_LIFT, "CD_brake": CD_BRAKE}
    assert named(drag_of([*clean, *braked, last], BODY)) == pytest.approx(expected)


def test_the_bands_are_those_of_a_regression() -> None:
    """Two of the columns: by scipy, with the t of the glides left over."""
    random = np.random.default_rng(8)
    glides = [glide(lift, more=float(0.002 * random.standard_normal())) for lift in ATTACHED[:5]]
    glides += [glide(0.8 * ATTACHED[0]), glide(2.0, more=1.0)]  # separated, and left out
    shown = glides[:6]
    lifts, drags = [], []
    for each in shown:
        speed2 = each.speed_mps**2 + each.sink_mps**2
        angle = atan2(each.sink_mps, each.speed_mps)
        weight = BODY.mass_kg * GRAVITY_MPS2
        force = 0.5 * BODY.air_density_kgpm3 * speed2 * BODY.wing_area_m2
        lifts.append(weight * cos(angle) / force)
        drags.append(weight * sin(angle) / force)
    line = stats.linregress(np.square(lifts), drags)
    t = stats.t.ppf(0.975, len(shown) - 2)
    zero, by_lift = drag_of(glides, BODY)
    assert (zero.value, by_lift.value) == pytest.approx((line.intercept, line.slope))
    assert zero.half_band == pytest.approx(t * line.intercept_stderr, rel=1e-3)
    assert by_lift.half_band == pytest.approx(t * line.stderr, rel=1e-3)


@pytest.mark.parametrize("n", [0, 1, ENOUGH - 1])
def test_fewer_than_five_glides_are_too_few(n: int) -> None:
    with pytest.raises(ValueError, match=rf"{n} steady glides: too few .* {ENOUGH} at least"):
        drag_of([glide(lift) for lift in ATTACHED[:n]], BODY)
    assert len(drag_of([glide(lift) for lift in ATTACHED[:ENOUGH]], BODY)) == 2
