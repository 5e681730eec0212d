"""Air that changes: what is claimed of slopes and winds, of made-up shifts."""

from __future__ import annotations

from math import nan

from by_hand import signs

from tgl_soar.analysis.experiments.paper.changing_air import (
    Shift,
    WindShift,
    slope_claims,
    wind_claims,
    wind_why,
)


def test_slope_needs_contour_and_aircraft_to_rise_alike() -> None:
    same = [slope_shift("a", 0.10, 0.0), slope_shift("b", 0.12, 0.01)]
    assert signs(slope_claims(same)) == "✓✓"
    assert signs(slope_claims([slope_shift("a", 0.02, -0.08), same[1]])) == "✓✗"
    # 1.5 cm off, known to 0.4 cm: 2.4 of these go beyond the 2 cm that are asked.
    assert signs(slope_claims([slope_shift("a", 0.10, 0.015), same[1]])) == "✓?"
    assert signs(slope_claims([same[0]._replace(error_m=0.05), same[1]])) == "✓?"


def slope_shift(line: str, flown_m: float, off_m: float) -> Shift:
    return Shift(
        line=line,
        flown_m=flown_m,
        predicted_m=0.1,
        up_m=flown_m,
        error_m=0.004,
        off_m=off_m,
        off_error_m=0.004,
        worst_off_m=2.0 * off_m,
        worst_glide_m=off_m,
    )


def shift(line: str, flown_m: float, predicted_m: float | None = None, lost: int = 0) -> WindShift:
    predicted = flown_m if predicted_m is None else predicted_m
    return WindShift(
        line=line,
        speed_ratio=1.0,
        margin=0.0,
        margin_half_way=0.0,
        first_order_m=0.0,
        half_way_m=0.0,
        predicted_m=predicted,
        flown_m=flown_m,
        polar_error_m=0.0,
        lost=lost,
        dispersion_m=0.03,
        error_m=0.001,
        off_m=flown_m - predicted,
        off_error_m=0.001,
        worst_off_m=flown_m - predicted,
        worst_glide_m=flown_m - predicted,
    )


def test_wind_asks_for_a_rise_a_rest_and_a_fall() -> None:
    small = [shift("a", 0.05), shift("b", 0.03), shift("c", 0.0), shift("d", -0.02)]
    large = [shift("a", 0.05), shift("b", 0.05), shift("c", 0.0), shift("d", -0.03)]
    assert signs(wind_claims(small, large)) == "✓✓✓✓"
    sinking = [*large[:2], shift("c", -0.05), large[3]]
    assert signs(wind_claims(small, sinking)) == "✓✗✓✓"
    unresolved = [*small[:3], shift("d", -0.015)]  # within 2.4 standard errors of 1.4 cm
    assert signs(wind_claims(unresolved, large)) == "?✓✓✓"
    for n, little in ((0, 0.011), (1, 0.011), (3, -0.011)):  # what is called staying
        stays = [shift(s.line, little) if i == n else s for i, s in enumerate(small)]
        assert signs(wind_claims(stays, large)) == "✗✓✓✓"
    nearly = [*small[:2], shift("c", 0.013), small[3]]  # 1.4 cm are asked
    assert signs(wind_claims(nearly, large)) == "?✓✓✓"
    far = [shift("a", 0.063), *large[1:]]  # more than two standard deviations
    assert signs(wind_claims(small, far)) == "✓✓✓✗"
    assert signs(wind_claims(small, [shift("a", 0.059), *large[1:]])) == "✓✓✓?"
    lost = [shift("a", 0.05, lost=1), *large[1:]]
    assert signs(wind_claims(small, lost)) == "✓✗✗✗"
    assert "(1 flights lost)" in wind_claims(small, lost)[1].measured
    nowhere = [shift("a", 0.05, nan), *large[1:]]
    assert signs(wind_claims(small, nowhere)) == "✓✓✗✓"
    astray = [shift("a", 0.3, 0.1), *large[1:]]
    assert signs(wind_claims(small, astray)) == "✓✓✗✗"


def test_what_calm_air_leaves_is_of_both_steps_and_names_its_losses() -> None:
    full = [shift("a", 0.05)]
    calm = [*full, shift("a", 0.161, 0.056, lost=1)]
    assert "agree within 10.5 cm" in wind_why(full, calm, dispersed=True)
    assert "1 of the flights in calm air were lost" in wind_why(full, calm, dispersed=True)
    assert "lost" not in wind_why(full, full)
