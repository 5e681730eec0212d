"""The track against motions whose integrals are known, and the filter against matrices."""

from __future__ import annotations

import random
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    errors_at,
    position_taken,
    spread,
    velocity_taken,
)
from tgl_soar.estimation.inertial_track import (
    NODE_S,
    NODES,
    Place,
    Track,
    new_track,
    oldest_s,
    track_at,
    track_moved,
)

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

DT = 0.008
START_S = 2.0
A0 = (1.0, -2.0, 0.5)  # acceleration at the start, m/s²
JERK = (-3.0, 4.0, 1.5)  # m/s³


def flown(t: float) -> Place:
    """Position and velocity after a time of constant jerk, from rest at the origin."""
    h = t - START_S
    x, y, z = (a * h * h / 2.0 + j * h**3 / 6.0 for a, j in zip(A0, JERK, strict=True))
    vx, vy, climb = (a * h + j * h * h / 2.0 for a, j in zip(A0, JERK, strict=True))
    return x, y, z, vx, vy, climb


def acceleration(t: float) -> Vector:
    x, y, z = (a + j * (t - START_S) for a, j in zip(A0, JERK, strict=True))
    return x, y, z


def track_until(steps: int) -> Track:
    track = new_track(START_S)._replace(ax_mps2=A0[0], ay_mps2=A0[1], az_mps2=A0[2])
    for n in range(1, steps + 1):
        t = START_S + n * DT
        track = track_moved(track, t, *acceleration(t))
    return track


@pytest.mark.parametrize("steps", [1, 3, 40, 150])
def test_an_acceleration_that_is_linear_in_time_is_integrated_exactly(steps: int) -> None:
    end = START_S + steps * DT
    track = track_until(steps)
    assert track.time_s == end
    assert track[1:7] == pytest.approx(flown(end), rel=1e-12, abs=1e-12)
    assert track[7:10] == pytest.approx(acceleration(end))
    assert track_at(track, end) == track[1:7]


@pytest.mark.parametrize("ahead_s", [0.0, 0.003, 0.1])
def test_ahead_of_its_last_sample_it_goes_on_with_the_last_acceleration(ahead_s: float) -> None:
    track = track_until(30)
    a = np.array(track[7:10])
    found = np.array(track_at(track, track.time_s + ahead_s))
    p, v = np.array(track[1:4]), np.array(track[4:7])
    assert found[:3] == pytest.approx(p + v * ahead_s + a * ahead_s**2 / 2.0)
    assert found[3:] == pytest.approx(v + a * ahead_s)


def test_a_new_track_rests_in_the_origin() -> None:
    assert track_at(new_track(1.0), 3.0) == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_where_it_was_is_known_exactly_for_as_long_as_it_remembers() -> None:
    """Under constant jerk the track is a cubic, as what is drawn through its nodes."""
    track = track_until(150)
    oldest = oldest_s(track)
    assert track.time_s - oldest == pytest.approx((NODES - 1) * NODE_S, abs=NODE_S + DT)
    assert oldest == track.nodes[0].time_s
    assert [node.time_s for node in track.nodes] == sorted({n.time_s for n in track.nodes})
    for back_s in np.linspace(0.0, track.time_s - oldest, 97):
        t = track.time_s - float(back_s)
        assert track_at(track, t) == pytest.approx(flown(t), rel=1e-9, abs=1e-9)


def test_nodes_are_as_far_apart_as_is_said() -> None:
    gaps = np.diff([node.time_s for node in track_until(150).nodes])
    assert gaps == pytest.approx(NODE_S, abs=1e-9)  # a whole number of samples, met exactly
    slow = new_track(0.0)
    for n in range(1, 20):
        slow = track_moved(slow, 0.1 * n, 0.0, 0.0, 0.0)
    assert np.diff([node.time_s for node in slow.nodes]) == pytest.approx(0.1)


def test_before_its_oldest_node_it_is_straight_and_says_that_it_does_not_know() -> None:
    track = track_until(150)
    first = track.nodes[0]
    found = track_at(track, first.time_s - 0.1)
    assert found[:3] == pytest.approx(np.array(first[1:4]) - 0.1 * np.array(first[4:]))
    assert found[3:] == first[4:]
    young = track_until(3)
    assert oldest_s(young) == -inf  # its beginning is remembered, and before that it stood
    assert track_at(young, START_S - 1.0) == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


# --- the filter ---------------------------------------------------------------------------------


SEEDS = range(5)


def posterior(seed: int) -> tuple[Errors, Floats, Floats]:
    """Errors, and the same as mean (3 of position, velocity, bias; 3 axes) and covariance."""
    dice = np.random.default_rng(seed)
    mean = dice.normal(size=(3, 3))
    root = dice.normal(size=(3, 3))
    p = root @ root.T + 0.1 * np.eye(3)
    covariance = Covariance._make((float(p[i, j]) for i, j in np.argwhere(np.tri(3).T > 0.0)))
    errors = Errors._make([1.0, *mean.ravel().tolist(), covariance])
    return errors, mean, p


def matrix(c: Covariance) -> Floats:
    return np.array([[c.pp, c.pv, c.pb], [c.pv, c.vv, c.vb], [c.pb, c.vb, c.bb]])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("coupling", [0.0, 1.0])
@pytest.mark.parametrize("t", [0.013, 0.7, -0.2])
def test_errors_are_carried_on_by_the_matrix(seed: int, coupling: float, t: float) -> None:
    errors, mean, p = posterior(seed)
    f = np.array([[1.0, t, -coupling * t * t / 2.0], [0.0, 1.0, -coupling * t], [0.0, 0.0, 1.0]])
    found = errors_at(errors, 1.0 + t, coupling)
    assert np.array(found).reshape(2, 3) == pytest.approx((f @ mean)[:2])
    if t > 0.0:
        q, q_b = 0.7, 0.3 * coupling
        noise = q * np.array([[t**3 / 3, t**2 / 2, 0], [t**2 / 2, t, 0], [0, 0, 0]])
        noise += q_b * np.array(
            [
                [t**5 / 20, t**4 / 8, -(t**3) / 6],
                [t**4 / 8, t**3 / 3, -(t**2) / 2],
                [-(t**3) / 6, -(t**2) / 2, t],
            ]
        )
        grown = spread(errors.covariance, t, coupling, q, 0.3)
        assert matrix(Covariance._make(grown)) == pytest.approx(f @ p @ f.T + noise)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("measured", [0, 1])
def test_a_measurement_is_taken_as_by_kalman(seed: int, measured: int) -> None:
    errors, mean, p = posterior(seed)
    dice = random.Random(seed)
    rx, ry, rz = (dice.gauss(0.0, 1.0) for _ in range(3))
    variance = dice.uniform(0.01, 2.0)
    take = (position_taken, velocity_taken)[measured]
    found = take(errors, rx, ry, rz, variance)
    gain = p[:, measured] / (p[measured, measured] + variance)
    assert found.time_s == errors.time_s
    assert np.array(found[1:10]).reshape(3, 3) == pytest.approx(mean + np.outer(gain, (rx, ry, rz)))
    assert matrix(found.covariance) == pytest.approx(p - np.outer(gain, p[measured]))
