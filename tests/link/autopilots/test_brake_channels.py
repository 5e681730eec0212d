"""The brake on the wire: one channel of its own, or both ailerons mixed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, airframe_from, load_airframe, shipped
from tgl_soar.link.autopilots.aileron_brake_mixing import mixed, unmixed
from tgl_soar.link.autopilots.base import Flavour, deflections
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.onboard.setup import flavour_of, surface_channels
from tgl_soar.sim.channels import command_of, deflections_of
from tgl_soar.types import NO_SETPOINTS, SurfaceCommand

SPOILER = shipped("airframes/eclipson_c_spoilers.toml")
TEXT = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
ONE = "aileron = { channel = 1, pwm_min = 1100, pwm_trim = 1500, pwm_max = 1900 }\n"
TWO = """aileron_left = { channel = 1 }
aileron_right = { channel = 5, reversed = true }
mixing = { brake_throw = 0.5, brake = "up" }
"""


def airframe(surfaces: str, firmware: str = "bridge") -> Airframe:
    text = TEXT.replace(ONE, surfaces).replace('firmware = "bridge"', f'firmware = "{firmware}"')
    return airframe_from(text, "plane.toml")


def sent(plane: Airframe, surfaces: SurfaceCommand) -> tuple[int, ...]:
    (message,) = flavour_of(plane).commands(surfaces, NO_SETPOINTS)
    return message.channels  # type: ignore[union-attr]


def read_back(plane: Airframe, pulses: tuple[int, ...]) -> SurfaceCommand:
    return deflections(surface_channels(plane), pulses)


def test_a_spoiler_goes_over_all_of_its_channel() -> None:
    plane = load_airframe(SPOILER)
    for brake, pulse in ((0.0, 1100), (0.5, 1500), (1.0, 1900)):
        pulses = sent(plane, SurfaceCommand(0.1, -0.2, 0.3, brake))
        assert pulses[4] == pulse
        assert read_back(plane, pulses) == pytest.approx((0.1, -0.2, 0.3, brake), abs=0.002)


def test_two_ailerons_brake_together_and_roll_apart() -> None:
    plane = airframe(TWO)
    rolls = sent(plane, SurfaceCommand(0.0, 0.5, 0.0, 0.0))
    assert (rolls[0], rolls[4]) == (1700, 1300)  # the right one is reversed
    brakes = sent(plane, SurfaceCommand(0.0, 0.0, 0.0, 1.0))
    assert (brakes[0], brakes[4]) == (1300, 1300)  # left up, and right up by its reversal
    both = sent(plane, SurfaceCommand(0.0, 0.25, 0.0, 0.5))
    assert read_back(plane, both) == pytest.approx((0.0, 0.25, 0.0, 0.5), abs=0.002)


@given(st.floats(-1.0, 1.0), st.floats(0.0, 1.0), st.sampled_from([0.2, 1.0, -0.6]))
def test_mixing_never_takes_roll_and_is_undone(aileron: float, brake: float, throw: float) -> None:
    left, right = mixed(aileron, brake, throw)
    assert max(abs(left), abs(right)) <= 1.0 + 1e-12
    back, braked = unmixed(left, right, throw)
    assert back == pytest.approx(aileron)
    assert -1e-9 <= braked <= brake + 1e-9
    if abs(aileron) + abs(throw) * brake <= 1.0:
        assert braked == pytest.approx(brake)


@pytest.mark.parametrize("surfaces", [ONE, TWO, ONE + "flap = { channel = 6 }\n"])
def test_the_simulated_servos_undo_what_the_module_mixes(surfaces: str) -> None:
    plane = airframe(surfaces).surfaces
    braking = plane.brake is not None
    wanted = SurfaceCommand(0.1, 0.3, -0.2, 0.4 if braking else 0.0)
    assert command_of(plane, deflections_of(plane, wanted)) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("surfaces", "words"),
    [
        ("aileron_left = { channel = 1 }\n", "aileron_right is missing"),
        (TWO.replace("mixing", "#"), "mixing belongs to"),
        (ONE + "mixing = { brake_throw = 0.5 }\n", "mixing belongs to"),
        (ONE + TWO, "either aileron, or"),
        ("", "either aileron, or"),
        (TWO + "flap = { channel = 6 }\n", "one brake only"),
        (ONE + "flap = { channel = 6 }\nspoiler = { channel = 7 }\n", "one brake only"),
        (ONE + "flap = { channel = 2 }\n", "share a channel"),
        (TWO.replace("0.5", "1.5"), "brake_throw"),
        (TWO.replace("up", "sideways"), "mixing.brake"),
    ],
)
def test_surfaces_that_contradict_each_other_are_refused(surfaces: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        airframe(surfaces)


@pytest.mark.parametrize("firmware", ["px4", "paparazzi"])
def test_a_firmware_that_takes_no_fourth_surface_refuses_the_file(firmware: str) -> None:
    with pytest.raises(ConfigError, match="no fourth surface"):
        flavour_of(airframe(TWO, firmware))
    assert flavour_of(airframe(ONE, firmware)).route


def names(flavour: Flavour) -> dict[str, float]:
    rows = flavour.requirements(
        Needs(loop_rate_hz=200.0, override_system=255, external_pose=False, gps=False)
    )
    return {name: row.wanted for row in rows for name in row.names}


def test_what_brakes_repeats_its_channel_at_an_arduplane() -> None:
    wanted = names(flavour_of(airframe(TWO, "ardupilot")))
    assert (wanted["SERVO1_FUNCTION"], wanted["SERVO5_FUNCTION"]) == (51.0, 55.0)
    assert "RCMAP_ROLL" not in wanted
    plain = names(flavour_of(airframe(ONE, "ardupilot")))
    assert plain["SERVO1_FUNCTION"] == 4.0
    assert "SERVO5_FUNCTION" not in plain


def test_releasing_gives_every_channel_back() -> None:
    plane = airframe(TWO, "ardupilot")
    (released,) = flavour_of(plane).release()
    assert [i + 1 for i, pulse in enumerate(released.channels) if pulse == 0][:4] == [1, 2, 4, 5]  # type: ignore[union-attr]
