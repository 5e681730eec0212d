"""The parts of an identification one by one: servo, model, derivatives, weights and covariance,
each by the equations of its page in plain numbers, one manoeuvre after the other."""

from __future__ import annotations

from math import cos, exp, isnan, sin, sqrt
from typing import Any

import numpy as np
import pytest
from identified_aircraft import BODY, GRAVITY_MPS2
from identified_aircraft import TRUE as DERIVATIVES

from tgl_soar.analysis import identification as module
from tgl_soar.analysis.identification import (
    BRAKE_NAMES,
    COLOUR_S,
    DELAY_MAX_S,
    NAMES,
    Fit,
    _Point,
    _Problem,
    short_period,
)
from tgl_soar.analysis.manoeuvres import QUIET_S, STEP_S, LongitudinalLog

TRUE = tuple(DERIVATIVES[name] for name in NAMES)
BRAKED = tuple(DERIVATIVES[name] for name in BRAKE_NAMES)
WARM = round(QUIET_S / STEP_S)
ROWS = [slice(WARM + 40, WARM + 80), slice(WARM + 110, WARM + 135)]
COUNT = WARM + 150
STEPS = (40, 25)


def flown(brake: bool = False, seed: int = 1, lift: bool = True, **changes: Any) -> LongitudinalLog:
    """Measurements of no real flight; smooth, but for the stick."""
    time_s = np.arange(COUNT) * STEP_S
    random = np.random.default_rng(seed)
    stick = np.where((time_s * 7.0).astype(int) % 3 == 0, 0.1, -0.05)
    columns: dict[str, Any] = {
        "time_s": time_s, "elevator": stick, "pitch_rad": 0.05 * np.sin(3.0 * time_s),
        "pitch_rate_radps": 0.1 * np.cos(3.0 * time_s), "roll_rad": np.zeros(COUNT),
        "airspeed_mps": 9.0 + 0.3 * np.sin(2.0 * time_s),
        "path_angle_rad": -0.1 + 0.01 * random.standard_normal(COUNT),
        "lift_force_mps2": 9.8 + random.standard_normal(COUNT) if lift else None,
        "brake": np.where(time_s > 0.5 * time_s[-1], 0.5, 0.0) if brake else None,
    }  # fmt: skip
    return LongitudinalLog(**{**columns, **changes})


def problem(brake: bool = False, **changes: Any) -> _Problem:
    return _Problem(flown(brake, **changes), BODY, ROWS, brake=brake)


# --- the servo ------------------------------------------------------------------------------------


def test_a_step_goes_through_delay_and_lag() -> None:
    """Small enough that the rate is no limit: 1 - exp(-lag t) from the delay on."""
    command = np.zeros(COUNT)
    command[ROWS[0].start + 5 :] = 0.2
    stands = problem()._servo(command, np.array([0.0, 3 * STEP_S]))
    assert stands.shape == (2, 40, 2)
    for at, late in enumerate((0, 3)):
        for k in range(40):
            since = max(0, k - 5 - late) * STEP_S
            expected = 0.2 * (1.0 - exp(-BODY.servo_lag_radps * since))
            assert stands[at, k, 0] == pytest.approx(expected, abs=1e-12)
    # By the second manoeuvre it stands.
    assert stands[:, :, 1] == pytest.approx(np.full((2, 40), 0.2), rel=1e-6)


def test_a_large_step_is_as_fast_as_the_servo() -> None:
    for size in (5.0, -5.0):
        command = np.zeros(COUNT)
        command[ROWS[0].start :] = size
        stands = problem()._servo(command, np.zeros(1))[0, :, 0]
        way = np.sign(size) * 8.0 * STEP_S * np.arange(20)
        assert stands[:20] == pytest.approx(way)


def test_a_delay_between_two_steps_is_between_them() -> None:
    """Half of a command that has come half a step ago; beyond the log's ends it stands."""
    command = np.zeros(COUNT)
    command[ROWS[0].start] = 0.1  # one step long
    whole, half, next_one = problem()._servo(command, np.array([0.0, 0.5, 1.0]) * STEP_S)
    assert half[:, 0] == pytest.approx(0.5 * (whole[:, 0] + next_one[:, 0]))
    assert half[:, 0].max() > 0.0
    early = _Problem(flown(), BODY, [slice(2, 10), slice(COUNT - 8, COUNT)], brake=False)
    ends = early._servo(np.linspace(1.0, 2.0, COUNT), np.array([0.0]))
    assert ends[0, 0, 0] == pytest.approx(1.0, abs=0.03)
    assert ends[0, -1, 1] == pytest.approx(2.0, abs=0.03)  # a lag of three steps


def test_what_was_commanded_before_a_manoeuvre_is_not_forgotten() -> None:
    command = np.zeros(COUNT)
    command[: ROWS[0].start] = 0.2
    stands = problem()._servo(command, np.zeros(1))[0, :, 0]
    assert stands[0] == pytest.approx(0.2, rel=1e-6)
    fall = [0.2 * exp(-BODY.servo_lag_radps * STEP_S * k) for k in range(10)]
    assert stands[:10] == pytest.approx(fall, rel=1e-6)


# --- the model ------------------------------------------------------------------------------------


def by_hand(
    made: _Problem, log: LongitudinalLog, which: int, values: Any, start: Any, errors: Any,
    brake: bool,
) -> Any:  # fmt: skip
    """One manoeuvre by Heun's rule, number by number: q, theta, alpha, C_L at each step."""
    rows = ROWS[which]
    steps = STEPS[which]
    delay = np.array([values[7]])
    elevator = made._servo(log.elevator, delay)[0, :steps, which]
    out = np.zeros(steps)
    if brake:
        assert log.brake is not None
        out = made._servo(log.brake, delay)[0, :steps, which]
    speed = module._smoothed(log.airspeed_mps)[rows]
    cl0, cla, cle, cm0, cma, cmq, cme = values[:7]
    clb, cmb = values[8:] if brake else (0.0, 0.0)
    rho, s, c = BODY.air_density_kgpm3, BODY.wing_area_m2, BODY.chord_m
    m, inertia = BODY.mass_kg, BODY.iyy_kgm2

    def lift(alpha: float, k: int) -> float:
        return float(cl0 + cla * alpha + cle * elevator[k] + clb * out[k])

    def change(alpha: float, q: float, theta: float, k: int) -> tuple[float, float, float]:
        v = speed[k]
        turn = cm0 + cma * sin(alpha) + cme * elevator[k] + cmb * out[k] + c / (2.0 * v) * cmq * q
        return (
            q - rho * s * v / (2.0 * m) * lift(alpha, k) + GRAVITY_MPS2 / v * cos(theta - alpha),
            rho * s * c * v * v / (2.0 * inertia) * turn,
            q,
        )

    now = np.array(start, dtype=float)
    found = []
    for k in range(steps):
        alpha, q, theta = now.tolist()
        found.append((q + errors[0], theta, alpha + errors[1], lift(alpha, k) + errors[2]))
        if k + 1 < steps:
            first = np.array(change(alpha, q, theta, k))
            ahead = now + STEP_S * first
            second = np.array(change(ahead[0], ahead[1], ahead[2], k + 1))
            now = now + 0.5 * STEP_S * (first + second)
    return np.array(found).T


@pytest.mark.parametrize("brake", [False, True])
def test_each_manoeuvre_flies_by_the_equations(brake: bool) -> None:
    made, log = problem(brake), flown(brake)
    values = np.array((*TRUE, *(BRAKED if brake else ())))
    starts = np.array([[0.04, 0.05], [0.1, -0.2], [-0.03, 0.02]])
    errors = np.array([0.01, -0.005, 0.02])
    sets = (
        np.stack([values, 1.1 * values]), np.stack([starts, starts]), np.stack([errors, 0 * errors])
    )  # fmt: skip
    found = made._fly(*sets)
    assert found.shape == (2, 4, 40, 2)
    for which, steps in enumerate(STEPS):
        for at, (v, e) in enumerate(((values, errors), (1.1 * values, 0.0 * errors))):
            expected = by_hand(made, log, which, v, starts[:, which], e, brake)
            assert found[at, :, :steps, which] == pytest.approx(expected, abs=1e-11)


def test_without_accelerometers_there_are_three_outputs() -> None:
    """Likewise where their samples do not cover a manoeuvre."""
    bare = problem(lift=False)
    assert bare._measured.shape == (3, 40, 2)
    holes = flown()
    assert holes.lift_force_mps2 is not None
    force = holes.lift_force_mps2.copy()
    force[ROWS[1].start + 3] = np.nan
    assert problem(lift_force_mps2=force)._measured.shape == (3, 40, 2)
    force[ROWS[1].start + 3], force[0] = 9.8, np.nan  # outside of all manoeuvres
    assert problem(lift_force_mps2=force)._measured.shape == (4, 40, 2)
    values = np.array(TRUE)
    given = (values[None], np.zeros((1, 3, 2)), np.ones((1, 3)))
    assert bare._fly(*given) == pytest.approx(problem()._fly(*given)[:, :3])


def test_measured_are_rate_pitch_angle_of_attack_and_lift_coefficient() -> None:
    made, log = problem(), flown()
    speed = module._smoothed(log.airspeed_mps)
    pressure = 0.5 * 1.2 * speed**2
    assert log.lift_force_mps2 is not None
    expected = (
        log.pitch_rate_radps, log.pitch_rad, log.pitch_rad - log.path_angle_rad,
        0.7 * log.lift_force_mps2 / (pressure * 0.18),
    )  # fmt: skip
    for which, (rows, steps) in enumerate(zip(ROWS, STEPS, strict=True)):
        for n, column in enumerate(expected):
            assert made._measured[n, :steps, which] == pytest.approx(column[rows])
    assert made._counts.sum(axis=0).tolist() == [40, 25]
    assert made._counts[:25, 1].all()
    starts = made._starts()
    for which, rows in enumerate(ROWS):
        first = [column[rows.start] for column in (expected[2], expected[0], expected[1])]
        assert starts[:, which] == pytest.approx(first)


def point() -> _Point:
    starts = np.array([[0.04, 0.05], [0.1, -0.2], [-0.03, 0.02]])
    return _Point(np.array(TRUE), starts, np.array([0.01, -0.005, 0.02]))


def test_beyond_a_manoeuvres_end_nothing_counts() -> None:
    made, here = problem(), point()
    modelled = made._fly(*(part[None] for part in here))[0]
    residuals, jacobian = made._linearised(here)
    for found in (made._residuals(here), residuals):
        assert found[:, :40, 0] == pytest.approx((made._measured - modelled)[:, :, 0])
        assert found[:, :25, 1] == pytest.approx((made._measured - modelled)[:, :25, 1])
        assert not found[:, 25:, 1].any()
    assert not jacobian[:, :, 25:, 1].any()
    assert jacobian[:, :, :25, 1].any()


def test_derivatives_are_of_unknowns_errors_and_starts_in_turn() -> None:
    """By other steps, one at a time; constant errors are those of one output each."""
    made, here = problem(), point()
    _, jacobian = made._linearised(here)
    assert jacobian.shape == (8 + 3 + 3, 4, 40, 2)

    def fly(values: Any, starts: Any, errors: Any) -> Any:
        return np.where(made._counts, made._fly(values[None], starts[None], errors[None])[0], 0.0)

    steps = (1e-4, 1e-3, 1e-4, 1e-5, 1e-4, 1e-2, 1e-4, 0.5 * STEP_S)
    for i, step in enumerate(steps):
        moved = step * np.eye(8)[i]
        more = fly(here.unknowns + moved, here.starts, here.errors)
        less = fly(here.unknowns - moved, here.starts, here.errors)
        expected = (more - less) / (2.0 * step)
        assert jacobian[i] == pytest.approx(expected, rel=1e-3, abs=1e-4), NAMES[i]
    for i, output in ((0, 0), (1, 2), (2, 3)):
        expected = np.zeros((4, 40, 2))
        expected[output] = made._counts
        assert jacobian[8 + i] == pytest.approx(expected)
    for i in range(3):
        moved = np.zeros((3, 2))
        moved[i] = 1e-4
        more = fly(here.unknowns, here.starts + moved, here.errors)
        less = fly(here.unknowns, here.starts - moved, here.errors)
        assert jacobian[11 + i] == pytest.approx((more - less) / 2e-4, rel=1e-3, abs=1e-4)


# --- the fit --------------------------------------------------------------------------------------


def test_a_step_moves_everything_and_the_delay_stays_possible() -> None:
    step = np.arange(8.0 + 3.0 + 6.0)
    found = point().moved(0.01 * step)
    expected = np.array(TRUE) + 0.01 * step[:8]
    assert found.unknowns == pytest.approx(expected)
    assert found.errors == pytest.approx(point().errors + 0.01 * step[8:11])
    assert found.starts == pytest.approx(point().starts + 0.01 * step[11:].reshape(3, 2))
    for moved, delay in ((0.5, DELAY_MAX_S), (-0.5, 0.0), (0.2, 0.233)):
        only = np.zeros(17)
        only[7] = moved
        assert point().moved(only).unknowns[7] == pytest.approx(delay)
    assert DELAY_MAX_S == 0.3


def test_weights_are_one_over_the_rms_of_what_counts() -> None:
    made = problem()
    residuals = np.where(made._counts, np.array([0.1, 0.2, 0.4, 0.0])[:, None, None], 0.0)
    assert made._weights(residuals) == pytest.approx([10.0, 5.0, 2.5, 1e6])


def test_stacked_are_weighted_columns_and_each_manoeuvres_starts_are_its_own() -> None:
    made = problem()
    residuals, jacobian = made._linearised(point())
    weights = np.array([2.0, 3.0, 5.0, 7.0])
    r, a = made._stacked(residuals, jacobian, weights)
    w = weights[:, None, None]
    assert r == pytest.approx((residuals * w).ravel())
    assert a.shape == (4 * 40 * 2, 8 + 3 + 3 * 2)
    for i in range(11):
        assert a[:, i] == pytest.approx((jacobian[i] * w).ravel())
    for i in range(3):
        for which in range(2):
            only = np.zeros((4, 40, 2))
            only[:, :, which] = (jacobian[11 + i] * w)[:, :, which]
            assert a[:, 11 + 2 * i + which] == pytest.approx(only.ravel())


def test_the_covariance_sums_scores_of_one_time_with_those_shortly_after() -> None:
    """Bread, meat, bread; the meat's weights fall to nothing over `COLOUR_S`; n - p are free."""
    made = problem()
    residuals, jacobian = made._linearised(point())
    weights = np.array([2.0, 3.0, 5.0, 7.0])
    found = made._covariance(residuals, jacobian, weights)
    r, a = made._stacked(residuals, jacobian, weights)
    lags = round(COLOUR_S / STEP_S)
    unknowns = a.shape[1]
    score = (a * r[:, None]).reshape(4, 40, 2, unknowns).sum(axis=0)
    meat = np.zeros((unknowns, unknowns))
    for which in range(2):
        for k in range(40):
            for j in range(40):
                weight = 1.0 - abs(k - j) / lags
                if weight > 0.0 and abs(k - j) < 39:
                    meat += weight * np.outer(score[k, which], score[j, which])
    bread = np.linalg.pinv(a.T @ a)
    n = 4 * (40 + 25)
    assert found == pytest.approx(bread @ meat @ bread * n / (n - unknowns), rel=1e-4)


def test_an_angle_of_attack_askew_is_another_wings() -> None:
    """C_L0 and C_m0 take its error with the slopes; all else stays as it is."""
    turn = problem()._measured_alpha(point())
    expected = np.eye(8, 11)
    expected[0, 9], expected[3, 9] = -TRUE[1], -TRUE[4]
    assert turn.tolist() == expected.tolist()


def solved(brake: bool) -> tuple[Any, Any, Any]:
    """Unknowns and covariance of measurements that the model itself has made."""
    log = flown(brake)
    values = np.array((*TRUE, *(BRAKED if brake else ())))
    made = problem(brake)
    starts, errors = point().starts, np.zeros(3)
    q, theta, path, force = (np.zeros(COUNT) for _ in range(4))
    for which, (rows, steps) in enumerate(zip(ROWS, STEPS, strict=True)):
        flight = by_hand(made, log, which, values, starts[:, which], errors, brake)
        q[rows], theta[rows], path[rows] = flight[0], flight[1], flight[1] - flight[2]
        speed = module._smoothed(log.airspeed_mps)[rows]
        force[rows] = flight[3] * 0.5 * 1.2 * 0.18 / 0.7 * speed**2
        assert len(speed) == steps
    exact = problem(
        brake, pitch_rate_radps=q, pitch_rad=theta, path_angle_rad=path, lift_force_mps2=force
    )
    return exact, values, starts


def test_a_flight_of_the_model_is_found_again() -> None:
    exact, values, _ = solved(brake=False)
    found, covariance = exact.solve()
    assert found == pytest.approx(values, rel=1e-3, abs=1e-4)
    assert covariance.shape == (8, 8)
    # The stick's samples alone leave the delay uncertain: a twelfth of the square of their step.
    assert sqrt(covariance[7, 7]) == pytest.approx(STEP_S / sqrt(12.0), rel=0.01)


def test_a_manoeuvre_is_shown_from_the_start_that_suits_it_best() -> None:
    """The unknowns stay what they are."""
    exact, values, _ = solved(brake=True)
    fits = exact.fits(values, fitted=False)
    assert [len(fit.time_s) for fit in fits] == [*STEPS]
    for fit, rows in zip(fits, ROWS, strict=True):
        assert not fit.fitted
        assert fit.time_s == pytest.approx(flown().time_s[rows])
        assert fit.elevator == pytest.approx(flown().elevator[rows])
        assert fit.model_pitch_rate_radps == pytest.approx(fit.pitch_rate_radps, abs=1e-4)
    assert exact.fits(values, fitted=True)[0].fitted
    assert values[:8] == pytest.approx(TRUE)


def test_units_that_are_wrong_do_not_converge(monkeypatch: pytest.MonkeyPatch) -> None:
    made = problem()
    here = point()
    monkeypatch.setattr(
        made, "_descend", lambda *_: here._replace(unknowns=np.array((*[np.nan] * 7, 0.03)))
    )
    with pytest.raises(module.IdentificationError, match="does not converge: are the units"):
        made.solve()


# --- numbers of what is found ---------------------------------------------------------------------


def test_airspeed_is_a_mean_over_a_fifth_of_a_second() -> None:
    """Twenty-one samples about each; the first and the last stand for what lies beyond."""
    speed = np.arange(60.0) ** 2
    padded = np.concatenate([np.full(10, speed[0]), speed, np.full(10, speed[-1])])
    expected = [padded[n : n + 21].mean() for n in range(60)]
    assert module._smoothed(speed) == pytest.approx(expected)
    holes = speed.copy()
    holes[20:23] = np.nan
    found = module._smoothed(holes)
    assert np.flatnonzero(np.isnan(found)).tolist() == [20, 21, 22]
    filled = speed.copy()
    filled[20:23] = np.interp([20.0, 21.0, 22.0], [19.0, 23.0], speed[[19, 23]])
    kept = ~np.isnan(holes)
    assert found[kept] == pytest.approx(module._smoothed(filled)[kept])
    none = np.full(5, np.nan)
    assert np.isnan(module._smoothed(none)).all()


def test_the_short_period_is_the_matrixs_and_none_where_it_diverges() -> None:
    speed = 9.0
    force = 0.5 * 1.2 * speed**2 * 0.18
    z_alpha = -force * 5.0 / (0.7 * speed)
    m_alpha, m_q = force * 0.16 / 0.02 * np.array([-0.5, -9.0 * 0.16 / (2.0 * speed)])
    roots = np.linalg.eigvals(np.array([[z_alpha, 1.0], [m_alpha, m_q]]))
    frequency, damping = short_period(5.0, -0.5, -9.0, BODY, speed)
    assert frequency == pytest.approx(abs(roots[0]))
    assert damping == pytest.approx(-roots[0].real / abs(roots[0]))
    level = float(z_alpha * m_q / (force * 0.16 / 0.02))  # C_m_alpha of no stiffness at all
    assert all(isnan(n) for n in short_period(5.0, level * 1.001, -9.0, BODY, speed))
    assert short_period(5.0, level * 0.999, -9.0, BODY, speed)[0] > 0.0


def test_effect_and_delay_follow_from_what_is_found() -> None:
    found = module._derived(np.array((*TRUE, *BRAKED)), BODY, 9.0)
    assert found[:2] == short_period(5.0, -0.5, -9.0, BODY, 9.0)
    assert found[2] == pytest.approx(0.5 * 1.2 * 81.0 * 0.18 * 0.16 / 0.02 * 0.3)
    assert found[3] == pytest.approx(0.033 + 1.0 / 30.0)


def test_explained_is_the_fraction_of_the_rates_variance_about_each_mean() -> None:
    def fit(measured: Any, modelled: Any) -> Fit:
        nothing = np.zeros(len(measured))
        return Fit(
            time_s=nothing, elevator=nothing, pitch_rate_radps=np.array(measured),
            model_pitch_rate_radps=np.array(modelled), fitted=False,
        )  # fmt: skip

    fits = [fit([1.0, 3.0], [1.0, 2.0]), fit([5.0, 5.0, 8.0], [5.0, 5.0, 6.0])]
    assert module._explained(fits) == pytest.approx(1.0 - (1.0 + 4.0) / (2.0 + 6.0))


# --- the brake ------------------------------------------------------------------------------------


def test_what_a_brake_lacks_is_reported() -> None:
    log = flown(brake=True)
    assert log.brake is not None
    lacks = module._brake_lacks
    assert lacks(flown(), ROWS) == "the log holds no brake"
    low, high = slice(0, 10), slice(COUNT - 10, COUNT)
    assert lacks(log, [low, high]) == ""
    words = lacks(log, [low])
    assert words.startswith("the brake stays within 0.00 and 0.00: move it by 0.25 or more out of")
    holes = log.brake.copy()
    holes[5] = np.nan
    hidden = flown(brake=True)
    hidden = LongitudinalLog(**{**vars(hidden), "brake": holes})
    assert lacks(hidden, [low, high]) == "the log does not hold the brake in all manoeuvres"
    assert lacks(hidden, [slice(6, 10), high]) == ""


@pytest.mark.parametrize(("out", "enough"), [(0.249, False), (0.251, True)])
def test_a_brake_must_move_by_a_quarter(out: float, enough: bool) -> None:
    moved = np.where(np.arange(COUNT) > 5, 0.1 + out, 0.1)
    log = LongitudinalLog(**{**vars(flown()), "brake": moved})
    found = module._brake_lacks(log, [slice(0, 10)])
    assert (found == "") == enough
    if not enough:
        assert found.startswith("the brake stays within 0.10 and 0.35")
