"""Pitches and the slowest airspeed that follow from an airframe file's own glide."""

from __future__ import annotations

from math import degrees

import pytest
from msgspec.structs import asdict, replace

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.glide_limits import FROM_TRIM_DEG
from tgl_soar.sim.aircraft import aircraft_model, glide_at

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
WITHOUT = replace(
    AIRFRAME, parameters={k: v for k, v in AIRFRAME.parameters.items() if k not in FROM_TRIM_DEG}
)


def test_the_trim_is_that_of_a_glide_where_it_soars() -> None:
    """Of the file's own model; the elevator's part of the lift is left out: half a degree."""
    found = WITHOUT.all_parameters()
    glide = glide_at(aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model), 8.7)
    assert found["PITCH_TRIM"] == pytest.approx(degrees(glide.pitch_rad), abs=0.5)
    assert found["PITCH_MIN"] == pytest.approx(found["PITCH_TRIM"] - 10.5)
    assert found["PITCH_MAX"] == pytest.approx(found["PITCH_TRIM"] + 7.5)
    assert found["REC_PITCH"] == pytest.approx(found["PITCH_TRIM"] - 2.5)


def test_a_wing_with_more_camber_flies_with_a_lower_nose() -> None:
    cambered = replace(WITHOUT, model={**WITHOUT.model, "CL0": WITHOUT.model["CL0"] + 0.2})
    lower = cambered.all_parameters()["PITCH_TRIM"] - WITHOUT.all_parameters()["PITCH_TRIM"]
    assert lower == pytest.approx(-degrees(0.2 / WITHOUT.model["CL_alpha"]), abs=0.11)


def test_a_file_that_gives_one_pitch_gives_all_of_its_own() -> None:
    assert AIRFRAME.all_parameters()["PITCH_TRIM"] == AIRFRAME.parameters["PITCH_TRIM"]
    assert "REC_PITCH" not in AIRFRAME.all_parameters()
    one = replace(WITHOUT, parameters={"PITCH_MAX": 5.0}).all_parameters()
    assert set(FROM_TRIM_DEG) & set(one) == {"PITCH_MAX"}
    lacking = {k: v for k, v in AIRFRAME.model.items() if k != "CD_lift"}
    assert not set(FROM_TRIM_DEG) & set(replace(WITHOUT, model=lacking).all_parameters())


def test_the_slowest_airspeed_follows_the_polar() -> None:
    assert AIRFRAME.all_parameters()["SPEED_MIN"] == 6.0  # 0.79 of 7.6 m/s
    slower = replace(AIRFRAME.polar, speed_min_mps=5.0)
    assert replace(AIRFRAME, polar=slower).all_parameters()["SPEED_MIN"] == 4.0  # 3.95
    by_hand = replace(AIRFRAME, parameters={"SPEED_MIN": 7.0})
    assert by_hand.all_parameters()["SPEED_MIN"] == 7.0
