"""Lines that lean: what is claimed and reported of them, of made-up scores."""

from __future__ import annotations

from math import hypot, inf

from by_hand import signs

from tgl_soar.analysis.experiments.paper.line_lean import (
    HELD_M,
    ONE_SET,
    SCHEDULED,
    LeanScore,
    along_words,
    downwind_words,
    lean_claims,
    lean_why,
    refusal,
)


def lean_score(
    lean_deg: float, oscillation_m: float, from_line_m: float, survived: int = 8
) -> LeanScore:
    whole = survived == 8
    return LeanScore(
        lean_deg=lean_deg,
        off_perpendicular_deg=lean_deg - 44.0,
        flights=8,
        survived=survived,
        rms_e_rho_m=hypot(oscillation_m, from_line_m) if whole else inf,
        oscillation_m=oscillation_m if whole else inf,
        from_line_m=from_line_m if whole else inf,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        dispersion_m=0.05,
        apart_m=0.02,
        dispersion_formula_m=0.05,
        drift_m=0,
        rate_per_s=1,
        stalled_fraction=0,
        ended="",
        oscillation_error=0.03,
        from_line_error=0.03,
    )


def reported_of_leans(*scores: LeanScore) -> list[bool]:
    return [c.holds for c in lean_claims(list(scores), 44.0, "so")]


def test_lean_asks_for_the_least_at_the_perpendicular_and_more_far_from_it() -> None:
    downwind = lean_score(-10, 0.5, 0.1)
    upright, across = lean_score(10, 0.015, 0.002), lean_score(40, 0.010, 0.001)
    assert reported_of_leans(downwind, upright, across) == [True, True, True]
    # The least is elsewhere; or what is far off is no worse, within two standard errors.
    assert reported_of_leans(downwind, lean_score(10, 0.008, 0.0008), across) == [
        False,
        False,
        True,
    ]
    assert reported_of_leans(downwind, lean_score(10, 0.0105, 0.0018), across) == [
        False,
        True,
        True,
    ]
    # No flight was near the perpendicular, or one was lost.
    assert reported_of_leans(downwind, upright) == [False, False, True]
    lost = lean_score(40, 0.010, 0.001, survived=7)
    assert reported_of_leans(downwind, upright, lost) == [False, False, True]


def test_a_drift_that_is_known_to_a_quarter_decides_nothing_a_fifth_apart() -> None:
    """The rms of eight means: 0.09 against 0.11 cm is within its error, four times is not."""
    across, upright = lean_score(40, 0.010, 0.0009), lean_score(10, 0.015, 0.0011)
    coarse = [s._replace(from_line_error=0.25) for s in (across, upright)]
    claims = lean_claims(coarse, 44.0, "so")
    assert signs(claims) == "✓?✗"
    assert "known to a factor of 2.34" in claims[1].measured
    assert "on the steep side alone, as no lean beyond 74° was flown" in claims[1].measured
    far = [coarse[0], coarse[1]._replace(from_line_m=0.0040)]
    assert signs(lean_claims(far, 44.0, "so")) == "✓✓✗"
    flat = [*coarse, lean_score(75, 0.02, 0.01)]
    assert "steep side" not in lean_claims(flat, 44.0, "so")[1].measured


def test_a_dispersion_that_does_not_follow_its_formula_is_said_not_to() -> None:
    follows = lean_score(40, 0.010, 0.001)
    assert "follows its formula on the lines that were held, 1.00 to 1.00" in along_words([follows])
    apart = follows._replace(dispersion_m=0.13, stalled_fraction=0.04)
    words = along_words([follows, apart])
    assert "does not follow its formula on 1 of 2 lines" in words
    assert "2.60 times it" in words
    assert "stall's incidence 4.0 % of the time" in words
    assert "no lean was held" in along_words([])


def test_a_downwind_lean_is_held_or_lost() -> None:
    across = lean_score(40, 0.010, 0.001)
    for downwind, fails in (
        (lean_score(-10, HELD_M + 0.001, 0.0), True),
        (lean_score(-10, HELD_M - 0.001, 0.0), False),
        (lean_score(-10, 0.010, 0.0, survived=7), True),
    ):
        assert reported_of_leans(downwind, across)[2] is fails
    assert reported_of_leans(across)[2] is False


def test_leans_that_are_accepted_and_not_held_are_named() -> None:
    poor, good = lean_score(5, HELD_M + 0.002, 0.0), lean_score(40, 0.01, 0.001)
    named = lean_why({("with", SCHEDULED): [poor, good]}, 44.0, 0.1, 6.0)
    assert "not held: 5° (with accelerometers, 3.2 cm)" in named
    assert "Every lean flown" in lean_why({("with", SCHEDULED): [good]}, 44.0, 0.1, 6.0)


def test_a_downwind_lean_that_is_held_is_named_where_the_formula_speaks_against_it() -> None:
    held, lost, upwind = (
        lean_score(*of) for of in ((-5, 0.01, 0.0), (-10, 0.1, 0.0), (5, 0.01, 0))
    )
    named = downwind_words({("with", SCHEDULED): [held, upwind], ("with", ONE_SET): [held, lost]})
    assert named == (
        ", far enough out at -5° with accelerometers, -5° with accelerometers and one set of gains"
        " for the line to be held"
    )
    assert downwind_words({("with", SCHEDULED): [lost, upwind]}) == ""


def test_the_module_refuses_flat_lines_and_lines_that_lean_downwind() -> None:
    assert "60" in refusal(90.0)
    assert "TGL_LEAN_MIN" in refusal(-10.0)
    assert refusal(20.0) == ""
