"""A loop's connection, response, poles, margins and activity, each on small loops whose numbers are
known otherwise: tick by tick, by formula, or by gathering variance for long enough."""

from __future__ import annotations

from math import atan, degrees, inf, log, log10, pi, sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from tgl_soar.analysis import linear_model as module
from tgl_soar.analysis.linear_controller import NOISES
from tgl_soar.analysis.linear_model import (
    BREAKS,
    FREQUENCIES_RADPS,
    Loop,
    activity,
    close_loop,
    disk_margin,
    is_stable,
    margin,
    open_loop,
    poles,
    promised_gain_db,
    promised_phase_rad,
    response,
    sensitivity,
)
from tgl_soar.analysis.linear_plant import TRUTH, Gusts, Periodic
from tgl_soar.sim.sensors import MEMS_IMU, Sensors

INPUTS, OUTPUTS = 4 + NOISES, 2 + TRUTH
STEP_S = 0.01


def small(seed: int = 1, states: int = 3, ticks: int = 2, size: float = 0.5) -> Loop:
    """A stable loop of a few ticks."""
    random = np.random.default_rng(seed)

    def many(*shape: int) -> list[Any]:
        return [random.standard_normal(shape) for _ in range(ticks)]

    a = many(states, states)
    a = [each * size / np.abs(np.linalg.eigvals(each)).max() for each in a]
    system = Periodic(a, many(states, INPUTS), many(OUTPUTS, states), many(OUTPUTS, INPUTS))
    return Loop(STEP_S, system)


# --- connected ------------------------------------------------------------------------------------


def test_plant_and_controller_are_connected_tick_by_tick() -> None:
    """What is injected into the command moves the plant alone, what is injected into the setpoint
    goes through the controller; gusts move the plant, noises are measured."""
    random = np.random.default_rng(2)
    states, own, ticks = 3, 2, 2
    plant: Any = SimpleNamespace(
        a=0.3 * random.standard_normal((states, states)),
        b_command=random.standard_normal((states, 1)),
        b_gust=random.standard_normal((states, 2)),
        c=random.standard_normal((TRUTH, states)),
        condition=SimpleNamespace(step_hz=50.0),
    )
    width = TRUTH + 1 + NOISES
    controller = Periodic(
        [0.3 * random.standard_normal((own, own)) for _ in range(ticks)],
        [0.3 * random.standard_normal((own, width)) for _ in range(ticks)],
        [0.3 * random.standard_normal((2, own)) for _ in range(ticks)],
        [0.1 * random.standard_normal((2, width)) for _ in range(ticks)],
    )
    loop = close_loop(plant, controller)
    assert loop.step_s == 0.02
    assert loop.breaks == BREAKS == ("elevator", "e_rho")
    for source in range(INPUTS):
        x, k, state = np.zeros(states), np.zeros(own), np.zeros(states + own)
        for n in range(5):
            put = np.zeros(INPUTS)
            put[source] = 1.0 + 0.5 * n
            measured = np.concatenate([plant.c @ x, put[1:2], put[4:]])
            ka, kb, kc, kd = (part[n % ticks] for part in controller)
            out = kc @ k + kd @ measured
            a, b, c, d = (part[n % ticks] for part in loop.system)
            assert c @ state + d @ put == pytest.approx(np.concatenate([out, plant.c @ x]))
            command = out[0] + put[0]
            x = plant.a @ x + plant.b_command[:, 0] * command + plant.b_gust @ put[2:4]
            k = ka @ k + kb @ measured
            state = a @ state + b @ put


# --- poles and responses --------------------------------------------------------------------------


def test_poles_are_those_of_the_map_over_a_period_the_slowest_first() -> None:
    loop = small()
    period = loop.system.a[1] @ loop.system.a[0]
    found = poles(loop)
    expected = np.log(np.linalg.eigvals(period).astype(complex)) / (2 * STEP_S)
    assert sorted(found, key=abs) == pytest.approx(sorted(expected, key=abs))
    assert np.all(np.diff(found.real) <= 1e-9)


def diagonal(*values: float) -> Loop:
    states = len(values)
    system = Periodic(
        [np.diag(values)], [np.zeros((states, INPUTS))], [np.zeros((OUTPUTS, states))],
        [np.zeros((OUTPUTS, INPUTS))],
    )  # fmt: skip
    return Loop(STEP_S, system)


def test_what_is_forgotten_within_a_tick_is_no_pole() -> None:
    assert poles(diagonal(0.5, 0.9, 1e-9)) == pytest.approx([log(0.9) / STEP_S, log(0.5) / STEP_S])


@pytest.mark.parametrize(("value", "stable"), [(0.999, True), (1.001, False), (-1.001, False)])
def test_a_loop_is_stable_whose_poles_all_decay(value: float, stable: bool) -> None:
    assert is_stable(diagonal(0.5, value)) == stable
    assert (disk_margin(diagonal(0.5, value)) > 0.0) == stable
    if not stable:
        assert margin(diagonal(0.5, value), "elevator") == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("ticks", [1, 3])
def test_a_response_is_what_a_sine_leaves_of_its_own_frequency(ticks: int) -> None:
    """Tick by tick, once the transient has decayed, over whole periods."""
    loop = small(ticks=ticks)
    radps = np.array([2.0 * pi * 2.0, 2.0 * pi * 12.5])  # of which 600 ticks hold whole periods
    for source, out in ((0, 0), (4, 3)):
        found = response(loop, source, out, radps)
        for w, answer in zip(radps.tolist(), found, strict=True):
            state = np.zeros(3, dtype=complex)
            total = 0.0 + 0.0j
            for n in range(300 + 600):
                wave = np.exp(1j * w * n * STEP_S)
                a, b, c, d = (part[n % ticks] for part in loop.system)
                if n >= 300:
                    total += (c[out] @ state + d[out, source] * wave) / wave
                state = a @ state + b[:, source] * wave
            assert answer == pytest.approx(total / 600.0, rel=1e-6)


def test_sensitivity_and_open_loop_are_of_the_break_that_is_named() -> None:
    loop, radps = small(), np.array([1.0, 10.0])
    for at, number in (("elevator", 0), ("e_rho", 1)):
        s = 1.0 + response(loop, number, number, radps)
        assert sensitivity(loop, at, radps) == pytest.approx(s)
        assert open_loop(loop, at, radps) == pytest.approx(1.0 / s - 1.0)


# --- margins --------------------------------------------------------------------------------------


def test_a_disk_margin_promises_gain_and_phase() -> None:
    assert promised_gain_db(2.0 / 3.0) == pytest.approx(20.0 * log10(2.0))
    assert promised_phase_rad(2.0 * (sqrt(2.0) - 1.0)) == pytest.approx(pi / 4.0)
    assert promised_gain_db(2.0) == promised_gain_db(2.1) == inf
    assert promised_gain_db(0.0) == 0.0


def lag(gain: float) -> Any:
    """An integrator with two lags: its phase is -180 degrees at 1 rad/s, where it is gain / 2."""
    s = 1j * FREQUENCIES_RADPS
    return gain / (s * (1.0 + s) ** 2)


def test_gain_phase_and_delay_margins_are_those_of_a_loop_that_is_a_formula() -> None:
    up, down = module._gain_margins_db(lag(0.5))
    assert up == pytest.approx(20.0 * log10(4.0), abs=0.01)
    assert down == -inf
    phase, delay = module._phase_margin(FREQUENCIES_RADPS, lag(0.5))
    crossing = brentq(lambda w: 0.5 / (w * (1.0 + w * w)) - 1.0, 0.1, 1.0)
    expected = 90.0 - 2.0 * degrees(atan(crossing))
    assert phase == pytest.approx(expected, abs=0.02)
    assert delay == pytest.approx(np.radians(expected) / crossing, rel=1e-3)


def test_a_loop_beyond_minus_one_has_a_margin_downwards() -> None:
    """Three integrators and two leads: 2 gain at 1 rad/s, where its phase comes up to -180."""
    s = 1j * FREQUENCIES_RADPS
    up, down = module._gain_margins_db(2.0 * (1.0 + s) ** 2 / s**3)
    assert up == inf
    assert down == pytest.approx(-20.0 * log10(4.0), abs=0.01)
    up, down = module._gain_margins_db(0.25 * (1.0 + s) ** 2 / s**3)
    assert up == pytest.approx(20.0 * log10(2.0), abs=0.01)
    assert down == -inf


def test_a_loop_that_crosses_at_minus_one_bears_no_gain() -> None:
    """It rings as it stands: none is left upwards, and none is lacking."""
    up, down = module._gain_margins_db(np.array([-1.0 + 0.1j, -1.0 - 0.1j]))
    assert (up, down) == (0.0, -inf)


def test_the_nearest_crossings_count() -> None:
    """Along the negative axis at -0.2, -0.5, -2 and -5, by straight pieces; the positive axis and
    what touches nothing count for nothing."""
    places = []
    for real in (-0.2, -0.5, -2.0, -5.0, 13.0):
        places += [complex(real, 0.1), complex(real, -0.1)]
    up, down = module._gain_margins_db(np.array(places))
    # Between two crossings the path crosses again, halfway: -0.35, -1.25, -3.5.
    assert up == pytest.approx(-20.0 * log10(0.5))
    assert down == pytest.approx(-20.0 * log10(1.25))
    assert module._gain_margins_db(np.array([1.0 + 0.1j, 1.0 - 0.1j])) == (inf, -inf)
    uneven = np.array([-0.4 + 0.3j, -0.8 - 0.1j])  # crosses at three quarters
    assert module._gain_margins_db(uneven)[0] == pytest.approx(-20.0 * log10(0.7))


def test_a_loop_that_leads_bears_a_delay_of_nearly_a_turn() -> None:
    """30 degrees past -180 where the gain is 1: the phase margin is 30, and a delay must use up
    the other 330."""
    radps = np.array([4.0, 9.0])
    size = np.array([1.5, 1.0 / 1.5])  # in the middle of the logarithms 1, at 6 rad/s
    loop = -size * np.exp(-1j * np.radians(30.0))
    phase, delay = module._phase_margin(radps, loop)
    assert phase == pytest.approx(30.0)
    assert delay == pytest.approx(np.radians(330.0) / 6.0)
    phase, delay = module._phase_margin(radps, -size * np.exp(1j * np.radians(30.0)))
    assert phase == pytest.approx(30.0)
    assert delay == pytest.approx(np.radians(30.0) / 6.0)
    turning = -np.array([1.5, 1.0 / 1.5]) * np.exp(1j * np.radians([20.0, 40.0]))
    assert module._phase_margin(radps, turning)[0] == pytest.approx(30.0)
    three = np.array([2.0, 4.0, 8.0])  # of two crossings the least phase and the least delay
    two = -np.array([2.0, 0.5, 2.0]) * np.exp(1j * np.radians([50.0, 50.0, 60.0]))
    phase, delay = module._phase_margin(three, two)
    assert phase == pytest.approx(50.0)
    assert delay == pytest.approx(np.radians(55.0) / sqrt(32.0))
    assert module._phase_margin(radps, np.full(2, 0.5 + 0.0j)) == (inf, inf)


def test_the_margin_of_a_break_is_where_its_sensitivity_is_farthest_from_a_half(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = diagonal(0.5)
    shapes = {"elevator": lag(0.5), "e_rho": lag(1.0)}
    monkeypatch.setattr(
        module, "sensitivity",
        lambda _loop, at, radps: 1.0 / (1.0 + np.interp(radps, FREQUENCIES_RADPS, shapes[at])),
    )  # fmt: skip
    alphas = {}
    for at, shape in shapes.items():
        found = margin(loop, at)
        distance = np.abs(1.0 / (1.0 + shape) - 0.5)
        worst = int(np.argmax(distance))
        alphas[at] = 1.0 / distance[worst]
        assert found.alpha == pytest.approx(alphas[at])
        assert found.at_radps == FREQUENCIES_RADPS[worst]
        up, down = module._gain_margins_db(shape)
        phase, delay = module._phase_margin(FREQUENCIES_RADPS, shape)
        assert found[2:] == pytest.approx((up, down, phase, delay))
    assert disk_margin(loop) == pytest.approx(min(alphas.values()))
    few = np.array([FREQUENCIES_RADPS[20]])
    only = [np.abs(1.0 / (1.0 + shape[20]) - 0.5) for shape in shapes.values()]
    assert disk_margin(loop, few) == pytest.approx(1.0 / max(only))


def test_frequencies_reach_from_slow_swings_to_a_ticks_own() -> None:
    assert FREQUENCIES_RADPS[[0, -1]] == pytest.approx([0.2, 300.0])
    assert len(FREQUENCIES_RADPS) == 260
    assert np.diff(np.log(FREQUENCIES_RADPS)) == pytest.approx(np.full(259, log(1500.0) / 259.0))


# --- activity -------------------------------------------------------------------------------------


@pytest.mark.parametrize("inertial", [True, False])
def test_activity_is_what_gusts_and_noise_leave_in_the_long_run(
    monkeypatch: pytest.MonkeyPatch, inertial: bool
) -> None:
    """Variance gathered tick by tick for long enough, then averaged over a period."""
    sensors = Sensors(imu=MEMS_IMU) if inertial else Sensors()
    condition: Any = SimpleNamespace(sensors=sensors, speed_mps=9.0)
    loop = small(seed=5)
    given: list[Any] = []

    def noted(what: Any, result: Any) -> Any:
        given.append(what)
        return result

    monkeypatch.setattr(module, "linear_plant", lambda *what: noted(what, "plant"))
    monkeypatch.setattr(module, "linear_controller", lambda *_, errors: f"with errors: {errors}")
    monkeypatch.setattr(module, "close_loop", lambda *what: noted(what, loop))
    laws: Any = "laws"
    gusts = Gusts(0.03, 9.0)
    found = activity(laws, condition, gusts)
    assert given == [(condition, gusts), ("plant", "with errors: True")]
    position, attitude = sensors.position, sensors.attitude
    noises = [position.noise_m, position.velocity_noise_mps, attitude.noise_rad]
    if inertial:
        noises += [MEMS_IMU.rate_noise_radps, MEMS_IMU.force_noise_mps2]
    else:
        noises += [attitude.rate_noise_radps, 0.0]
    white = np.diag(np.square([0.0, 0.0, 1.0, 1.0, *noises]))
    variance = np.zeros((3, 3))
    total = np.zeros(OUTPUTS)
    for n in range(400):
        a, b, c, d = (part[n % 2] for part in loop.system)
        if n >= 398:
            total += 0.5 * np.diag(c @ variance @ c.T + d @ white @ d.T)
        variance = a @ variance @ a.T + b @ white @ b.T
    sigma = np.sqrt(total)
    assert found.elevator == pytest.approx(sigma[0])
    assert found.e_rho_m == pytest.approx(sigma[2])
    assert found.pitch_rad == pytest.approx(sigma[4])
    assert found.pitch_rate_radps == pytest.approx(sigma[5])


def test_an_unstable_loop_has_no_activity(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "linear_plant", lambda *_: None)
    monkeypatch.setattr(module, "linear_controller", lambda *_, **__: None)
    monkeypatch.setattr(module, "close_loop", lambda *_: diagonal(1.01))
    condition: Any = SimpleNamespace(speed_mps=9.5)
    laws: Any = None
    with pytest.raises(ValueError, match=r"unstable at 9\.5 m/s: there is no steady activity"):
        activity(laws, condition, Gusts(0.03, 9.0))
