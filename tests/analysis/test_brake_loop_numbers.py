"""The two loops that hold a point, put together by transfer functions, and the aircraft in them
against that of the linear model."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin
from typing import Any

import numpy as np
import pytest
from test_brake_loop_equations import DT_S, condition, laws

from tgl_soar.analysis.brake_loop import FREQUENCIES_RADPS, BrakeMargin, _opened, brake_margin
from tgl_soar.analysis.linear_plant import linear_plant
from tgl_soar.control.point_hold import brake_effect
from tgl_soar.sim.aircraft import braked
from tgl_soar.types import polar_sink

SPEED_MPS = 9.0
# x, z, their rates, pitch, its rate, elevator, brake; five of the laws; then what is on its way.
BODY, LAWS = 8, 5


@lru_cache(maxsize=4)
def opened(delay_s: float = 0.01) -> Any:
    return _opened(laws(), condition(delay_s=delay_s))


def margins(lean_deg: float, gains: dict[str, float]) -> BrakeMargin:
    """By the algebra of two loops between which the aircraft lies.

    q is what the brake's law asks by, of place and speed along the line; a the elevator asked for.
    """
    known, there = laws(**gains), condition(lean_deg)
    parts, brake = _opened(known, there), known.brake
    z = np.exp(1j * FREQUENCIES_RADPS * DT_S)
    q = np.array([brake.kp_per_s, 1.0]) @ parts.along

    def gain(row: Any, column: Any) -> Any:
        resolvents = z[:, None, None] * np.eye(len(parts.a)) - parts.a
        return (row.ravel() @ np.linalg.solve(resolvents, column[None])[:, :, 0].T).ravel()

    brake_q, brake_a = gain(q, parts.brake), gain(parts.gains, parts.brake) + parts.through
    elevator_q, elevator_a = gain(q, parts.elevator), gain(parts.gains, parts.elevator)
    # The sink that is wanted, over that of the whole brake at this speed.
    polar = known.wind.aerodynamics.polar
    slope = (polar_sink(polar, SPEED_MPS + 1e-4) - polar_sink(polar, SPEED_MPS - 1e-4)) / 2e-4
    # A line's direction is 90 degrees and its lean.
    lean = radians(lean_deg)
    scale = (cos(lean) + slope * sin(lean)) / (brake.sink * SPEED_MPS**3)
    law = scale * (brake.kv + brake.ki_per_s * DT_S / (z - 1.0))

    along = -law * (brake_q + elevator_q * brake_a / (1.0 - elevator_a))
    held = -(elevator_a + brake_a * law * elevator_q / (1.0 - law * brake_q))
    alphas = [np.min(2.0 * abs(1.0 + L) / abs(1.0 - L)) for L in (along, held, -elevator_a)]
    crossed = FREQUENCIES_RADPS[np.abs(along) >= 1.0]
    return BrakeMargin(
        alpha=float(alphas[0]),
        crossover_radps=float(crossed.max(initial=0.0)),
        elevator_alpha=float(alphas[1]),
        line_alpha=float(alphas[2]),
    )


@pytest.mark.parametrize("lean_deg", [10.0, 25.0])
@pytest.mark.parametrize(
    "gains", [{}, {"BRK_V": 1.4, "BRK_P": 0.9, "BRK_I": 0.5}], ids=["shipped", "other"]
)
def test_both_loops_are_what_their_transfer_functions_make_of_them(
    lean_deg: float, gains: dict[str, float]
) -> None:
    found = brake_margin(laws(**gains), condition(lean_deg))
    assert found.alpha > 0.0
    assert found == pytest.approx(margins(lean_deg, gains), rel=1e-4)


def test_the_aircraft_is_that_of_the_linear_model_with_half_of_the_brake() -> None:
    """In the same sheared air, with the same elevator, which lags as much as the brake."""
    there = condition(delay_s=DT_S)
    plant = linear_plant(there._replace(model=braked(there.model, 0.5), command_delay_s=0.0))
    a = opened(DT_S).a
    assert a[:7, :7] == pytest.approx(plant.a[:7, :7], rel=1e-5, abs=1e-7)
    assert not a[:BODY, BODY : BODY + LAWS].any()  # the loop is open
    lag = a[6, 6]
    assert 0.3 < lag < 1.0
    assert a[7, 7] == pytest.approx(lag, rel=1e-6)
    waiting = BODY + LAWS
    assert a[6, waiting] == pytest.approx(1.0 - lag, rel=1e-5)  # what waited is taken now
    assert a[7, waiting + 1] == pytest.approx(1.0 - lag, rel=1e-5)
    assert a[6, waiting + 1] == pytest.approx(0.0, abs=1e-9)


def test_more_of_the_brake_slows_it_down_and_lets_it_sink() -> None:
    """Next to nothing of x and z within a tick, less speed, more sink; to first order it turns the
    aircraft as its own moment does."""
    a = opened().a
    assert a[2, 7] < 0.0 or a[3, 7] < 0.0
    assert a[3, 7] < 0.0  # it spoils lift
    assert abs(a[1, 7]) < abs(a[3, 7]) * DT_S


@pytest.mark.parametrize(("delay_s", "waits"), [(0.0, 1), (0.005, 1), (0.0076, 2), (0.02, 4)])
def test_both_commands_wait_for_as_many_ticks(delay_s: float, waits: int) -> None:
    """From the last place of its line to the first; only what is first moves a surface."""
    parts = opened(delay_s)
    size = BODY + LAWS + 2 * waits
    assert len(parts.a) == size
    elevators, brakes = BODY + LAWS, BODY + LAWS + waits
    for into, first, surface in ((parts.elevator, elevators, 6), (parts.brake, brakes, 7)):
        last = first + waits - 1
        expected = np.zeros(size)
        expected[last] = 1.0
        moved = np.delete(into[:, 0], np.arange(BODY, BODY + LAWS))  # the laws see it at once
        assert moved == pytest.approx(np.delete(expected, np.arange(BODY, BODY + LAWS)), abs=1e-9)
        for n in range(first, last):
            assert parts.a[n, n + 1] == pytest.approx(1.0)
        assert parts.a[surface, first] > 0.05


def test_the_line_asks_at_once_for_what_the_brakes_feed_forward_does() -> None:
    """Without accelerations the elevator is that of the feed-forward, and what pitch's gain makes
    of its angle: as it makes of an angle that is flown, the other way round."""
    known, there = laws(), condition(imu=False)
    parts = _opened(known, there)
    more, less = (brake_effect(known.brake, 0.5 + d, SPEED_MPS) for d in (1e-4, -1e-4))
    elevator = (more.elevator - less.elevator) / 2e-4
    pitch_rad = (more.pitch_rad - less.pitch_rad) / 2e-4
    assert parts.gains[0, 4] != 0.0
    assert parts.through == pytest.approx(elevator - parts.gains[0, 4] * pitch_rad, rel=1e-4)
