"""Aircraft drawn about an airframe file."""

from __future__ import annotations

from functools import cache
from math import degrees

import pytest
from msgspec.structs import asdict, replace

from tgl_soar.analysis.tuning.aircraft import (
    SLOWER_LINK_S,
    TICK_S,
    Drawn,
    Ranges,
    drawn_aircraft,
    ranges_of_one,
)
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.aircraft import aircraft_model, glide_at

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))


@cache
def forty() -> list[Drawn]:
    return [drawn_aircraft(AIRFRAME, Ranges(), (1, i)) for i in range(40)]


def test_the_file_of_each_has_what_was_drawn_for_it() -> None:
    own = AIRFRAME.all_parameters()
    ratios = [d.known.all_parameters()["DYN_FREQ"] / own["DYN_FREQ"] for d in forty()]
    low, high = Ranges().short_period
    # The reference speed is that of the best glide, which goes with drag's own ratio: unchanged.
    assert low <= min(ratios) < 0.65
    assert 1.15 < max(ratios) <= high
    for drawn in forty():
        known = drawn.known.all_parameters()
        assert known["DYN_DAMP"] == pytest.approx(own["DYN_DAMP"], rel=0.05)
        assert 0.015 <= known["DYN_SERVO"] <= 0.080
        assert 0.005 <= drawn.latency_s <= 0.040
        assert drawn.latency_s / TICK_S == pytest.approx(round(drawn.latency_s / TICK_S))


@pytest.mark.parametrize(
    ("field", "goes_with"),
    [
        ("lift", ("CL_alpha", "CL0")),
        ("drag", ("CD0", "CD_lift")),
        ("effect", ("Cm_elevator", "CL_elevator")),
    ],
)
def test_what_is_drawn_is_a_factor_of_all_that_it_stands_for(
    field: str, goes_with: tuple[str, ...]
) -> None:
    one = (1.0, 1.0)
    right = Ranges(
        short_period=one,
        lift=one,
        drag=one,
        inertia=one,
        effect=one,
        servo_s=(0.02, 0.02),
        latency_s=(0.01, 0.01),
        unknown_effect=one,
        centre_of_gravity=(0.0, 0.0),
    )
    given = AIRFRAME.model
    drawn = drawn_aircraft(AIRFRAME, right._replace(**{field: (1.2, 1.2)}), (1,)).known.model
    for name in ("CL_alpha", "CL0", "CD0", "CD_lift", "Cm_elevator", "CL_elevator"):
        factor = 1.2 if name in goes_with else 1.0
        assert drawn[name] == pytest.approx(factor * given[name]), name


def test_what_no_file_knows_is_in_the_aircraft_alone() -> None:
    errors = []
    for drawn in forty():
        known = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
        errors.append(drawn.true.Cm_elevator / known.Cm_elevator)
        assert drawn.true._replace(
            Cm_elevator=known.Cm_elevator, Cm_alpha=known.Cm_alpha, Cm0=known.Cm0
        ) == pytest.approx(known)
        assert abs(drawn.true.Cm_alpha - known.Cm_alpha) <= 0.0201 * known.CL_alpha
        assert 1.1 < degrees(drawn.sensors.attitude.bias_rad) < 1.2
    assert 0.7 <= min(errors) < 0.8
    assert 1.2 < max(errors) <= 1.3


def test_of_one_aircraft_the_file_is_right_but_for_what_is_left_open() -> None:
    """Nothing that the schedule goes by differs; the elevator's effect and the balance do."""
    own = AIRFRAME.all_parameters()
    latency_s = 0.0075
    ranges = ranges_of_one(AIRFRAME, latency_s)
    effects = []
    for i in range(40):
        drawn = drawn_aircraft(AIRFRAME, ranges, (1, i))
        known = drawn.known.all_parameters()
        for name in ("DYN_FREQ", "DYN_DAMP", "DYN_EFFECT", "DYN_BEST", "DYN_GLIDE", "DYN_LAG"):
            assert known[name] == pytest.approx(own[name], rel=0.02), name
        model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
        effects.append(drawn.true.Cm_elevator / model.Cm_elevator)
        late = drawn.latency_s - latency_s
        assert -TICK_S <= late <= SLOWER_LINK_S + TICK_S
    assert 0.9 <= min(effects) < 0.95
    assert 1.05 < max(effects) <= 1.1


def test_of_one_aircraft_the_servo_must_be_known() -> None:
    model = {k: v for k, v in AIRFRAME.model.items() if k != "servo_lag_radps"}
    with pytest.raises(ValueError, match="servo_lag_radps"):
        ranges_of_one(replace(AIRFRAME, model=model), 0.0075)


def test_each_is_trimmed_near_its_best_glide() -> None:
    """The elevator has room left: it was trimmed on the ground."""
    for drawn in forty():
        best = drawn.known.all_parameters()["DYN_BEST"]
        model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
        speed = max(best, drawn.known.polar.speed_min_mps)
        assert abs(glide_at(model, speed).elevator) < 0.35


def test_a_seed_is_one_aircraft() -> None:
    assert drawn_aircraft(AIRFRAME, Ranges(), (1, 3)) == forty()[3]
    assert drawn_aircraft(AIRFRAME, Ranges(), (2, 3)).true != forty()[3].true


def test_a_model_that_is_not_complete_is_named() -> None:
    model = {name: value for name, value in AIRFRAME.model.items() if name != "Cm_q"}
    with pytest.raises(ValueError, match=r"model\.Cm_q"):
        drawn_aircraft(replace(AIRFRAME, model=model), Ranges(), (1, 1))
