"""A weave keeps so much of the way upwind, and turns the nose so far off, as it has to."""

from __future__ import annotations

from math import cos, nan, sin

import pytest

from tgl_soar.control.weaving import WEAVE_RADPS, mean_cosine, weave_angle


@pytest.mark.parametrize("half_width_m", [4.0, 9.0, 15.0])
@pytest.mark.parametrize("chi", [0.2, 0.5, 0.9, 1.4])
def test_what_a_weave_keeps_upwind_is_what_a_flown_one_covers(
    chi: float, half_width_m: float
) -> None:
    """Integrated tick by tick, to the right and back, turning so that it just fills its width."""
    speed, dt = 8.4, 1e-3
    turns_m = speed * (1.0 - cos(chi)) / WEAVE_RADPS
    if turns_m > half_width_m:  # `weave_angle` gives what fits
        assert weave_angle(-1.0, half_width_m, speed, chi) < chi
        return
    psi, y, x, t, right, ways = 0.0, -half_width_m, 0.0, 0.0, True, 0
    while ways < 2:
        turning_m = speed * (1.0 - cos(psi)) / WEAVE_RADPS
        left_m = half_width_m - y if right else half_width_m + y
        wanted = 0.0 if left_m <= turning_m and t > dt else (chi if right else -chi)
        psi += max(-WEAVE_RADPS * dt, min(WEAVE_RADPS * dt, wanted - psi))
        x, y, t = x + speed * cos(psi) * dt, y + speed * sin(psi) * dt, t + dt
        if abs(psi) < 1e-9:
            right, ways = not right, ways + 1
            psi = 0.0
    assert x / (speed * t) == pytest.approx(mean_cosine(chi, half_width_m, speed), abs=0.003)


def test_the_nose_is_as_far_off_as_is_needed_and_no_farther() -> None:
    for cosine in (0.95, 0.8, 0.7):
        chi = weave_angle(cosine, 15.0, 8.4, 1.4)
        assert mean_cosine(chi, 15.0, 8.4) == pytest.approx(cosine, abs=0.01)
        assert mean_cosine(chi, 15.0, 8.4) <= cosine
        if cosine < 0.9:  # narrower it turns more often
            assert weave_angle(cosine, 10.0, 8.4, 1.4) > chi
    assert weave_angle(0.2, 15.0, 8.4, 1.4) == pytest.approx(1.4)
    assert weave_angle(0.2, 15.0, 8.4, 0.5) == pytest.approx(0.5)
    # Turns alone fill 4 m to either side: V (1 − cos chi) / omega of them.
    narrow = weave_angle(0.2, 4.0, 8.4, 1.4)
    assert 8.4 * (1.0 - cos(narrow)) / WEAVE_RADPS == pytest.approx(4.0, abs=0.05)
    for cosine, width, most in ((1.0, 15.0, 1.4), (nan, 15.0, 1.4), (0.5, 0.0, 1.4), (0.5, 15, 0)):
        assert weave_angle(cosine, width, 8.4, most) == 0.0
