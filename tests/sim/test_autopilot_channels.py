"""The simulated autopilot's channels: overrides by the rules of their message, and pulse widths by
calibrations of three points."""

from __future__ import annotations

import pytest

from tgl_soar.config.airframe import Mixing, Surface, Surfaces, Throttle
from tgl_soar.sim.channels import (
    CHANNELS,
    LEAVE,
    NEUTRAL,
    Overrides,
    command_of,
    deflection_from_pwm,
    deflections_of,
    pwm_from_deflection,
    pwm_from_stick,
    stick_from_pwm,
    throttle_from_pwm,
)
from tgl_soar.types import SurfaceCommand

UNEVEN = 1000, 1400, 2000  # 400 below the middle, 600 above it


def on_all(overrides: Overrides) -> list[int | None]:
    return [overrides.on(channel) for channel in range(1, CHANNELS + 1)]


# --- overrides ------------------------------------------------------------------------------------


def test_there_are_eighteen_channels_and_none_is_overridden_at_first() -> None:
    overrides = Overrides()
    assert (CHANNELS, LEAVE) == (18, 65535)
    assert on_all(overrides) == [None] * 18
    assert not overrides.any
    assert overrides.expire(10_000, 1.0) == []


def test_each_value_stands_on_its_own_channel() -> None:
    overrides = Overrides()
    overrides.take(range(1101, 1119), step=3)
    assert on_all(overrides) == list(range(1101, 1119))
    assert overrides.any


@pytest.mark.parametrize(
    ("channel", "value", "left"),
    [
        (1, 0, None),  # 0 releases one of the first eight
        (8, 0, None),
        (9, 0, 1500),  # and leaves one of the others
        (18, 0, 1500),
        (1, 65535, 1500),  # 65535 leaves all
        (8, 65535, 1500),
        (9, 65535, 1500),
        (18, 65535, 1500),
        (8, 65534, 65534),  # 65534 is a value there
        (9, 65534, None),  # and releases one of the others
        (18, 65534, None),
        (1, 1, 1),
        (9, 1, 1),
    ],
)
def test_what_leaves_and_what_releases_differs_between_the_channels(
    channel: int, value: int, left: int | None
) -> None:
    """RC_CHANNELS_OVERRIDE of common.xml."""
    overrides = Overrides()
    overrides.take([1500] * 18, step=0)
    values = [LEAVE] * 18
    values[channel - 1] = value
    overrides.take(values, step=1)
    assert overrides.on(channel) == left
    others = [pwm for i, pwm in enumerate(on_all(overrides), 1) if i != channel]
    assert others == [1500] * 17


def test_a_message_of_eight_values_says_nothing_of_the_others() -> None:
    overrides = Overrides()
    overrides.take([1500] * 18, step=0)
    overrides.take([1600] * 8, step=1)
    assert on_all(overrides) == [1600] * 8 + [1500] * 10


def test_an_override_ends_when_it_has_not_been_repeated() -> None:
    overrides = Overrides()
    overrides.take([1500, 1600, *[LEAVE] * 16], step=10)
    overrides.take([1500, *[LEAVE] * 17], step=15)
    assert overrides.expire(29, 20.0) == []
    assert overrides.expire(30, 20.0) == [2]
    assert (overrides.on(1), overrides.on(2)) == (1500, None)
    assert overrides.any
    assert overrides.expire(34, 20.0) == []
    assert overrides.expire(35, 20.0) == [1]
    assert not overrides.any
    assert overrides.expire(99, 20.0) == []  # each ends once


def test_what_leaves_does_not_repeat() -> None:
    overrides = Overrides()
    overrides.take([1500, *[LEAVE] * 17], step=0)
    overrides.take([LEAVE] * 18, step=15)
    assert overrides.expire(20, 20.0) == [1]


def test_all_are_released_at_once() -> None:
    overrides = Overrides()
    overrides.take([1500] * 18, step=0)
    overrides.clear()
    assert on_all(overrides) == [None] * 18
    assert not overrides.any


# --- calibration ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pwm", "stick"),
    [(1000, -1.0), (1200, -0.5), (1400, 0.0), (1700, 0.5), (2000, 1.0), (900, -1.0), (2100, 1.0)],
)
@pytest.mark.parametrize("reverse", [False, True])
def test_a_pulse_is_read_by_three_points_and_limited_to_their_ends(
    pwm: float, stick: float, reverse: bool
) -> None:
    expected = -stick if reverse else stick
    assert stick_from_pwm(pwm, *UNEVEN, reverse) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("stick", "pwm"),
    [(-1.0, 1000), (-0.5, 1200), (0.0, 1400), (0.5, 1700), (1.0, 2000), (-1.5, 1000), (1.5, 2000)],
)
@pytest.mark.parametrize("reverse", [False, True])
def test_a_stick_becomes_a_pulse_by_the_same_points(stick: float, pwm: int, reverse: bool) -> None:
    assert pwm_from_stick(-stick if reverse else stick, *UNEVEN, reverse) == pwm


def test_a_pulse_is_a_whole_number_the_nearest() -> None:
    for stick, pwm in ((0.0009, 1401), (0.0008, 1400), (-0.0013, 1399), (-0.0012, 1400)):
        assert pwm_from_stick(stick, *UNEVEN, False) == pwm
        assert isinstance(pwm_from_stick(stick, *UNEVEN, False), int)


def test_a_surface_moves_by_the_airframe_files_table() -> None:
    surface = Surface(2, *UNEVEN, reversed=True)
    assert deflection_from_pwm(surface, 1200) == 0.5
    assert pwm_from_deflection(surface, 0.5) == 1200
    assert pwm_from_deflection(surface, -0.5) == 1700


@pytest.mark.parametrize(
    ("pwm", "throttle"), [(1000, 0.0), (1250, 0.5), (1500, 1.0), (900, 0.0), (1600, 1.0)]
)
def test_a_motor_is_commanded_from_its_closed_pulse_up(pwm: float, throttle: float) -> None:
    assert throttle_from_pwm(Throttle(3, 1000, 1500), pwm) == throttle


# --- what the channels do together ----------------------------------------------------------------

PLAIN = Surfaces(elevator=Surface(2), aileron=Surface(1), rudder=Surface(4))
FLAP = Surfaces(elevator=Surface(2), aileron=Surface(1), rudder=Surface(4), flap=Surface(6))


def ailerons(throw: float) -> Surfaces:
    return Surfaces(
        elevator=Surface(2),
        rudder=Surface(4),
        aileron_left=Surface(1),
        aileron_right=Surface(5),
        mixing=Mixing(abs(throw), "up" if throw > 0.0 else "down"),
    )


@pytest.mark.parametrize(
    ("surfaces", "command", "deflections"),
    [
        (PLAIN, SurfaceCommand(0.1, 0.2, 0.3, 0.4), (0.1, 0.2, 0.3)),
        # A flap goes over all of its channel: retracted is -1.
        (FLAP, SurfaceCommand(0.1, 0.2, 0.3, 0.0), (0.1, 0.2, 0.3, -1.0)),
        (FLAP, SurfaceCommand(0.1, 0.2, 0.3, 0.25), (0.1, 0.2, 0.3, -0.5)),
        (FLAP, SurfaceCommand(0.1, 0.2, 0.3, 1.0), (0.1, 0.2, 0.3, 1.0)),
        # Left down and right up by the roll, both up by the brake: elevator, left, rudder, right.
        (ailerons(0.5), SurfaceCommand(0.1, 0.2, 0.3, 0.8), (0.1, -0.2, 0.3, 0.6)),
        (ailerons(-0.5), SurfaceCommand(0.1, 0.2, 0.3, 0.8), (0.1, 0.6, 0.3, -0.2)),
    ],
)
def test_commands_become_deflections_of_channels_and_back(
    surfaces: Surfaces, command: SurfaceCommand, deflections: tuple[float, ...]
) -> None:
    assert deflections_of(surfaces, command) == pytest.approx(deflections)
    back = command_of(surfaces, deflections)
    brakes = surfaces.brake is not None
    assert back == pytest.approx(command if brakes else command._replace(brake=0.0))


def test_a_brake_is_between_nothing_and_all() -> None:
    """Ailerons that roll against each other look like a brake of either sign."""
    assert command_of(ailerons(0.5), (0.0, 0.6, 0.0, -0.6)).brake == 0.0
    assert command_of(ailerons(0.5), (0.0, -0.6, 0.0, 0.6)).brake == 1.0


def test_neutral_is_everything_in_the_middle_and_no_brake() -> None:
    assert NEUTRAL == (0.0, 0.0, 0.0, 0.0)
