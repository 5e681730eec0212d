"""Gains at another lean: what is kept, that nothing steps, and that any number passes."""

from __future__ import annotations

from math import cos, isfinite, pi, radians, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.lean_gains import GRAVITY_MPS2, FoundAt, gains_at_lean
from tgl_soar.control.pid import PidGains
from tgl_soar.control.soaring import SoaringGains
from tgl_soar.control.target_line import eta_from_lean

GAINS = SoaringGains(
    PidGains(
        kp=1.8,
        ki=0.2,
        kd=0.355,
        rate_filter_radps=59.0,
        integral_max=0.14,
        output_min=-0.21,
        output_max=0.1,
    ),
    2.1,
)
SPEED = 8.5
FOUND_AT = FoundAt(eta_from_lean(radians(15.0)), SPEED)


def at(lean_deg: float, found_at: FoundAt = FOUND_AT) -> PidGains:
    return gains_at_lean(GAINS, found_at, eta_from_lean(radians(lean_deg))).pid


def crossover(pid: PidGains, lean_deg: float) -> float:
    lean = radians(lean_deg)
    return pid.kp * SPEED * sin(lean) + pid.kd * GRAVITY_MPS2 * cos(lean)


def test_at_the_lean_of_the_finding_they_are_the_gains_as_found() -> None:
    assert gains_at_lean(GAINS, FOUND_AT, FOUND_AT.eta_rad) is GAINS


def test_without_a_speed_they_are_flown_as_they_stand() -> None:
    """The paper's law, on every line."""
    plain = FOUND_AT._replace(airspeed_mps=0.0)
    assert all(at(lean, plain) is GAINS.pid for lean in (5.0, 15.0, 45.0))


@given(st.floats(0.0, 60.0))
def test_the_loop_crosses_over_where_it_did(lean_deg: float) -> None:
    assert crossover(at(lean_deg), lean_deg) == pytest.approx(crossover(GAINS.pid, 15.0))


@given(st.floats(15.1, 60.0))
def test_beyond_the_crossover_the_gain_falls_as_far_as_it_did(lean_deg: float) -> None:
    kept = GAINS.pid.kd * SPEED * sin(radians(15.0))
    assert at(lean_deg).kd * SPEED * sin(radians(lean_deg)) == pytest.approx(kept)


@given(st.floats(0.0, 14.9))
def test_a_line_that_leans_less_is_held_as_stiffly(lean_deg: float) -> None:
    kept = GAINS.pid.kp * cos(radians(15.0))
    assert at(lean_deg).kp * cos(radians(lean_deg)) == pytest.approx(kept)


@given(st.floats(0.0, 60.0), st.floats(0.0, 0.1))
def test_a_line_that_turns_changes_no_gain_by_a_step(lean_deg: float, turned_deg: float) -> None:
    """At 30 deg/s, the fastest that TGL_ROT_SLEW may be, a tick of 5 ms turns it by 0.15 degrees.

    The steepest is at the lean of the finding: d(ln kd)/dl = 1 / tan l beyond it, 6.5 % a degree,
    and kp V / (g kd) less tan l before it, 7.4 %.
    """
    before, after = at(lean_deg), at(min(60.0, lean_deg + turned_deg))
    for one, other in ((before.kp, after.kp), (before.kd, after.kd), (before.ki, after.ki)):
        assert abs(other - one) <= 0.08 * turned_deg * max(one, other) + 1e-12


@given(st.floats(0.0, 60.0))
def test_limits_and_filter_are_those_of_the_finding(lean_deg: float) -> None:
    found = gains_at_lean(GAINS, FOUND_AT, eta_from_lean(radians(lean_deg)))
    assert found.slew_radps == GAINS.slew_radps
    assert found.pid[3:] == GAINS.pid[3:]
    assert found.pid.ki / found.pid.kp == pytest.approx(GAINS.pid.ki / GAINS.pid.kp)


@given(st.floats(), st.floats(5.0, 45.0), st.floats(0.0, 60.0), st.floats(0.0, 5.0))
def test_whatever_the_line_the_gains_are_finite_and_act_the_right_way(
    eta_rad: float, found_deg: float, speed: float, kp: float
) -> None:
    """A line of NaN, one that lies down, one that leans downwind; no airspeed to speak of; no P."""
    gains = GAINS._replace(pid=GAINS.pid._replace(kp=kp))
    found_at = FoundAt(eta_from_lean(radians(found_deg)), speed)
    pid = gains_at_lean(gains, found_at, eta_rad).pid
    for gain in (pid.kp, pid.ki, pid.kd):
        assert isfinite(gain)
        assert gain >= 0.0


def test_a_line_that_leans_downwind_is_flown_as_an_upright_one() -> None:
    assert at(-40.0) == at(0.0)
    assert gains_at_lean(GAINS, FOUND_AT, pi).pid == pytest.approx(at(60.0))
