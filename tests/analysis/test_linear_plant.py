"""The linear aircraft against the one that is flown: from a steady glide, tick by tick, with small
commands, small gusts and air that differs from place to place."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
import pytest
from msgspec.structs import asdict
from numpy.typing import NDArray

from tgl_soar.air.gusts import DRYDEN_STILL, dryden_params, dryden_step
from tgl_soar.analysis.linear_plant import (
    Condition,
    Gusts,
    Periodic,
    Plant,
    differences,
    field_gradient,
    linear_plant,
    without_idle,
)
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.aircraft import aircraft_model, glide_at, gliding_state, step
from tgl_soar.sim.sensors import USUAL_SENSORS
from tgl_soar.sim.servos import servo_params, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
SERVO = servo_params(AIRFRAME.model)
SPEED_MPS = 8.5
TICKS = 60
SMALL = 1e-5  # of a command and of white numbers: what is not linear is far less
GUSTS = Gusts(0.05, 9.0, 2.0)
SHEARED = (1.5, -1.0, 2.5, 0.5)  # du/dx, du/dz, dw/dx, dw/dz

Floats = NDArray[np.float64]


def condition(
    gradient: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0), **changes: float
) -> Condition:
    there = Condition(
        model=MODEL,
        servo=SERVO,
        speed_mps=SPEED_MPS,
        lean_rad=radians(20.0),
        sensors=USUAL_SENSORS,
        gradient_per_s=gradient,
    )
    return there._replace(**changes)  # type: ignore[arg-type]


def driven() -> tuple[Floats, Floats]:
    """Commands, and white numbers of both gusts."""
    random = np.random.default_rng(5)
    return random.standard_normal(TICKS), random.standard_normal((TICKS, 2))


def flown(there: Condition, gusts: Gusts | None, dt: float) -> Floats:
    """e_rho, its rate, pitch and pitch rate after each tick, for inputs of size 1."""
    commands, white = driven()
    trim = glide_at(there.model, there.speed_mps)
    servo = there.servo._replace(delay_s=there.servo.delay_s + there.command_delay_s)
    surface = servo_start(servo, dt, trim.elevator)
    u_x, u_z, w_x, w_z = there.gradient_per_s
    air = DRYDEN_STILL
    gust = (0.0, 0.0, 0.0)
    state = gliding_state(trim, (trim.horizontal_mps, 0.0, trim.sink_mps))
    lean = there.lean_rad
    found = []

    def wind(x: float, z: float, blown: tuple[float, float, float]) -> tuple[float, float, float]:
        return (
            trim.horizontal_mps + u_x * x + u_z * z + blown[0],
            0.0,
            trim.sink_mps + w_x * x + w_z * z + blown[2],
        )

    for k in range(TICKS):
        before = gust
        if gusts is not None:
            params = dryden_params(
                gusts.intensity, gusts.reference_wind_mps, gusts.length_scale_m, dt
            )
            air, gust = dryden_step(params, air, *(SMALL * white[k, [0, 0, 1]]).tolist())
        surface = servo_step(servo, surface, trim.elevator + SMALL * commands[k], dt)
        x, z = state.x_m, state.z_m
        vx, vz = state.velocity_x_mps, state.velocity_z_mps
        state = step(
            there.model,
            state,
            SurfaceCommand(surface.deflection, 0.0, 0.0),
            wind(x, z, before),
            wind(x + vx * dt, z + vz * dt, gust),
            dt,
        )
        _, pitch, _ = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
        # A line that leans downstream by an angle: upstream of it is -x and -z of its normal.
        across = (
            -sin(lean) * state.z_m - cos(lean) * state.x_m,
            -sin(lean) * state.velocity_z_mps - cos(lean) * state.velocity_x_mps,
        )
        found.append([*across, pitch - trim.pitch_rad, state.pitch_rate_frd_radps])
    return np.array(found) / SMALL


def predicted(plant: Plant) -> Floats:
    commands, white = driven()
    x, found = np.zeros(len(plant.a)), []
    for k in range(TICKS):
        x = plant.a @ x + plant.b_command[:, 0] * commands[k] + plant.b_gust @ white[k]
        found.append(plant.c @ x)
    return np.array(found)


def alike(there: Condition, gusts: Gusts | None, dt: float = 0.005) -> None:
    ours, theirs = predicted(linear_plant(there, gusts)), flown(there, gusts, dt)
    for n in range(4):
        scale = float(np.abs(theirs[:, n]).max())
        assert scale > 0.0
        assert ours[:, n] == pytest.approx(theirs[:, n], abs=2e-5 * scale), n


@pytest.mark.parametrize("gradient", [(0.0, 0.0, 0.0, 0.0), SHEARED], ids=["even", "sheared"])
@pytest.mark.parametrize("gusts", [None, GUSTS], ids=["calm", "gusts"])
def test_small_commands_and_gusts_do_what_they_do_in_flight(
    gradient: tuple[float, float, float, float], gusts: Gusts | None
) -> None:
    alike(condition(gradient), gusts)


def test_a_late_command_is_on_its_way_for_as_long() -> None:
    """Two ticks and a part of one, beyond the servo's own delay."""
    alike(condition(command_delay_s=0.0125), GUSTS)


def test_its_tick_is_that_of_the_condition() -> None:
    alike(condition(step_hz=100), GUSTS, dt=0.01)
    assert condition().step_hz == 200
    assert condition().command_delay_s == 0.0


def test_without_gusts_white_numbers_move_nothing() -> None:
    assert not linear_plant(condition()).b_gust.any()
    assert linear_plant(condition(), GUSTS).b_gust.any()
    assert Gusts(0.05, 9.0).length_scale_m == 1.5


def test_in_even_air_the_place_along_the_line_is_no_state() -> None:
    """Of x and z the distance from the line alone; in sheared air both say something."""
    even, sheared = linear_plant(condition()), linear_plant(condition(SHEARED))
    assert len(sheared.a) == len(even.a) + 1
    assert even.c[0].tolist() == [1.0, *[0.0] * (len(even.a) - 1)]
    assert sheared.c[0, :2] == pytest.approx([-cos(radians(20.0)), -sin(radians(20.0))])
    # Position, velocities, pitch and its rate, deflection; commands on their way; four of gusts.
    waiting = len(servo_start(SERVO, 0.005).pending)
    assert len(even.a) == 6 + waiting + 4


def test_a_speed_without_a_glide_is_refused() -> None:
    with pytest.raises(ValueError, match="no steady glide at 3"):
        linear_plant(condition(speed_mps=3.0))


def test_differences_are_the_derivative_at_the_place() -> None:
    found = differences(
        lambda v: np.array([v[0] ** 2 * v[1], v[1] ** 3, v[0]]), np.array([2.0, 3.0])
    )
    assert found == pytest.approx(np.array([[12.0, 4.0], [0.0, 27.0], [1.0, 0.0]]), abs=1e-7)


def test_the_gradient_of_a_field_is_taken_at_the_place_in_the_middle() -> None:
    class Curved:
        reference_wind_mps = 8.0

        def wind_at(self, x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
            return (x * z) * (1.0 + y + t), 0.0, (x * x - 3.0 * z) * (1.0 + y - t)

    found = field_gradient(Curved(), 2.0, 5.0)  # type: ignore[arg-type]
    assert found == pytest.approx((5.0, 2.0, 4.0, -3.0), abs=1e-6)


def test_a_state_that_hardly_moves_is_idle_and_one_that_moves_more_is_not() -> None:
    """A tick may change it by 1e-9 of any state, or of any input, in any tick of the period."""
    eye, none = np.eye(2), np.zeros((2, 1))
    c, d = np.array([[1.0, 2.0]]), np.zeros((1, 1))

    def kept(a: Floats, b: Floats) -> int:
        found = without_idle(Periodic([eye, a], [none, b], [c, c], [d, d]))
        assert [len(each) for each in (*found.a, *found.b)] == [len(found.a[0])] * 4
        assert found.c[0].shape == (1, len(found.a[0]))
        return len(found.a[0])

    for size, count in ((0.5e-9, 0), (2e-9, 1)):
        for sign in (1.0, -1.0):
            moved = np.array([[1.0, sign * size], [0.0, 1.0]])
            assert kept(moved, none) == count
            driven_by = np.array([[0.0], [sign * size]])
            assert kept(eye, driven_by) == count
