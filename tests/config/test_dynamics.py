"""What the schedule takes of an airframe, from its file."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from tgl_soar.config.dynamics import MeasuredDynamics
from tgl_soar.config.files import load_airframe, shipped

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))


def test_the_shipped_model_has_the_short_period_that_its_file_states() -> None:
    """11.5 rad/s, damping 0.75 and 31 rad/s² at 8.5 m/s; best glide 6.4 at 9.2 m/s."""
    at = replace(AIRFRAME, dynamics=MeasuredDynamics(speed_mps=8.5)).all_parameters()
    assert at["DYN_FREQ"] == pytest.approx(11.5, abs=0.05)
    assert at["DYN_DAMP"] == pytest.approx(0.75, abs=0.005)
    assert at["DYN_EFFECT"] == pytest.approx(31.0, abs=0.05)
    assert at["DYN_SERVO"] == pytest.approx(1.0 / 54.0)
    assert at["DYN_GLIDE"] == pytest.approx(6.4, abs=0.1)
    assert at["DYN_BEST"] == pytest.approx(9.2, abs=0.1)


def test_the_elevator_s_lift_is_the_model_s_over_the_mass() -> None:
    """CL_elevator -0.09 at 9.25 m/s; what no elevator has is left out, and the file is taken."""
    own = AIRFRAME.all_parameters()
    table = AIRFRAME.airframe
    force_n = 0.5 * AIRFRAME.model["air_density_kgpm3"] * own["DYN_SPEED"] ** 2 * table.wing_area_m2
    assert own["DYN_LIFT"] == pytest.approx(-0.09 * force_n / table.mass_kg)
    for lift, known in ((-0.9, True), (-20.0, False)):
        model = {**AIRFRAME.model, "CL_elevator": lift}
        assert ("DYN_LIFT" in replace(AIRFRAME, model=model).all_parameters()) is known


def test_what_was_measured_comes_before_what_the_model_says() -> None:
    measured = MeasuredDynamics(short_period_radps=6.6, servo_s=0.03, command_delay_s=0.02)
    found = replace(AIRFRAME, dynamics=measured).all_parameters()
    assert (found["DYN_FREQ"], found["DYN_SERVO"], found["CMD_DELAY"]) == (6.6, 0.03, 0.02)
    by_hand = replace(AIRFRAME, parameters={"DYN_FREQ": 9.0}, dynamics=measured)
    assert by_hand.all_parameters()["DYN_FREQ"] == 9.0


def test_a_servo_of_which_only_the_whole_is_known_is_taken_for_no_more_lag_than_is_usual() -> None:
    for whole_s, lag_s in ((0.012, 0.012), (0.06, 0.0185)):
        measured = MeasuredDynamics(servo_s=whole_s)
        found = replace(AIRFRAME, model={}, dynamics=measured).all_parameters()
        assert (found["DYN_SERVO"], found["DYN_LAG"]) == (whole_s, lag_s)


def test_without_a_model_the_polar_tells_the_glide_and_nothing_tells_the_rest() -> None:
    found = replace(AIRFRAME, model={}).all_parameters()
    assert found["DYN_BEST"] == pytest.approx(9.2, abs=0.3)
    assert found["DYN_GLIDE"] == pytest.approx(6.4, abs=0.2)
    assert not {"DYN_FREQ", "DYN_DAMP", "DYN_EFFECT"} & set(found)


@pytest.mark.parametrize(
    ("route", "delay_s"), [(None, 0.0245), ("override", 0.0245), ("attitude", 0.0145)]
)
def test_arduplane_is_late_by_its_own_table(route: str | None, delay_s: float) -> None:
    autopilot = replace(AIRFRAME.autopilot, firmware="ardupilot", route=route)
    assert replace(AIRFRAME, autopilot=autopilot).all_parameters()["CMD_DELAY"] == delay_s
    assert "CMD_DELAY" not in AIRFRAME.all_parameters()
