"""By what the module judges a gain: the airframe file's own dynamics, and whose loops fly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.config.parameter_store import Identity, ParameterStore
from tgl_soar.onboard import process
from tgl_soar.onboard.setup import bounds_from, bounds_of, setup_from

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)


@pytest.mark.parametrize(
    ("name", "factor", "loop"), [("AIL_P", 7.5, "in roll"), ("ELE_D", 5.0, "at lean 15 deg")]
)
def test_a_gain_that_swings_is_known_to_the_module_and_on_the_ground(
    name: str, factor: float, loop: str
) -> None:
    setup = setup_from(AIRFRAME, SITE, VALUES)
    assert setup.lateral == lateral_dynamics(AIRFRAME)
    swings = VALUES.changed({name: factor * VALUES[name]})
    for bounds in (bounds_of(setup, setup.contour), bounds_from(AIRFRAME, SITE)):
        assert bounds.ringing(VALUES) == bounds.warning(VALUES) == ""
        assert bounds.ringing(swings).startswith(f"no margin {loop}")


def test_by_an_attitude_route_no_elevator_is_ours_to_judge() -> None:
    pilot = replace(AIRFRAME.autopilot, firmware="ardupilot", route="attitude")
    airframe = replace(AIRFRAME, autopilot=pilot)
    setup = setup_from(airframe, SITE, VALUES)
    swings = VALUES.changed({"ELE_D": 5.0 * VALUES["ELE_D"], "AIL_P": 7.5 * VALUES["AIL_P"]})
    for bounds in (bounds_of(setup, setup.contour), bounds_from(airframe, SITE)):
        assert bounds.ringing(swings) == bounds.fault(swings) == ""
        assert "the autopilot's own loops hold the attitude" in bounds.warning(VALUES)


def test_what_is_not_judged_is_reported_at_start() -> None:
    unknown = setup_from(AIRFRAME, SITE, VALUES.changed({"DYN_PATH": 0.0}))
    words = [text for _, text in process._words_of_place(unknown)]
    assert "no margin is judged: of the airframe DYN_PATH is not known" in words
    known = process._words_of_place(setup_from(AIRFRAME, SITE, VALUES))
    assert not any("judged" in text for _, text in known)


def test_the_autopilot_is_asked_for_what_the_stored_values_need(tmp_path: Path) -> None:
    """Of the firmware's rate and its own landing, where they were changed over the air."""
    setup = setup_from(AIRFRAME, SITE, VALUES)
    assert setup.needs is not None
    assert (setup.needs.loop_rate_hz, setup.needs.lands) == (VALUES["LOOP_RATE"], False)
    who = Identity(AIRFRAME.airframe.name, SITE.site.name)
    store = ParameterStore(tmp_path / "a.params", who, VALUES, setup.presets)
    store.restore()
    store.save(VALUES.changed({"LND_BY": 1.0, "LOOP_RATE": 250.0}))
    again = ParameterStore(tmp_path / "a.params", who, VALUES, setup.presets)
    flown, words = process._restored(setup, again)
    assert any("LND_BY" in text for _, text in words)
    assert flown.parameters["LOOP_RATE"] == 250.0
    assert flown.needs == setup.needs._replace(loop_rate_hz=250.0, lands=True)
    assert process._restored(setup, None) == (setup, [])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("usual", None),
        ("raw_imu", 27),  # as MAVLink numbers them
        ("scaled_imu", 26),
        ("highres_imu", 105),
        ("none", 0),
    ],
)
def test_accelerations_come_in_the_message_that_the_airframe_file_names(
    name: Any, message: int | None
) -> None:
    airframe = replace(AIRFRAME, autopilot=replace(AIRFRAME.autopilot, imu=name))
    assert setup_from(airframe, SITE, VALUES).imu == message
