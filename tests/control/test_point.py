"""Where a point on the line may go: within the fence, and clear of the ground."""

from __future__ import annotations

from math import cos, pi, radians, sin

import pytest
from samples import STILL, surfaces_sample

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control import supervisor as modes
from tgl_soar.control.envelope import CLEAR_FACTOR, Limited, clearance, unlimited
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.point import _is_free, point_step, wind_with_brake
from tgl_soar.control.point_hold import (
    DEAD,
    GIVES_WAY,
    HOLDS,
    NO_POINT,
    RESTS,
    BrakeEffect,
    BrakeState,
    brake_effect,
)
from tgl_soar.estimation.aerodynamics import braked
from tgl_soar.estimation.health import BRAKE, GAP
from tgl_soar.types import NO_SURFACES, SurfaceCommand

UP = pi / 2.0
CLEAR_M = 0.5


@pytest.fixture(scope="module")
def laws() -> Laws:
    path, site_path = shipped("airframes/eclipson_c_spoilers.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(path), load_site(site_path)
    values = load_parameters(airframe, path, site, site_path)
    values = values.changed({"TGL_HOLD": 1.0, "CLEAR_MIN": CLEAR_M})
    return laws_from(values, site.frame(), airframe.aerodynamics(), ground=site.known_ground())


def at(x_m: float, z_m: float) -> BrakeState:
    return NO_POINT._replace(x_m=x_m, z_m=z_m)


def test_without_a_point_there_is_nowhere_to_go(laws: Laws) -> None:
    none = laws._replace(brake=laws.brake._replace(wanted=False))
    assert _is_free(laws, at(0.6, 1.6), UP, 0.1)
    assert not _is_free(none, at(0.6, 1.6), UP, 0.1)
    assert not _is_free(laws, NO_POINT, UP, 0.1)


def test_it_stays_within_the_fence(laws: Laws) -> None:
    top = laws.fence.z_max_m
    assert _is_free(laws, at(0.6, top - 0.2), UP, 0.19)
    assert not _is_free(laws, at(0.6, top - 0.2), UP, 0.21)
    downstream = laws.fence.x_max_m
    assert _is_free(laws, at(downstream - 0.2, 1.8), 0.0, 0.19)
    assert not _is_free(laws, at(downstream - 0.2, 1.8), 0.0, 0.21)


def test_it_stays_as_clear_of_the_ground_as_one_that_is_clear_again(laws: Laws) -> None:
    state, eta_rad = at(0.6, 1.6), radians(110.0)
    free = [i for i in range(90) if _is_free(laws, state, eta_rad, -0.01 * i)]
    assert free == list(range(len(free)))  # all the way there, and nothing beyond
    further_m = -0.01 * free[-1]
    x, z = 0.6 + further_m * cos(eta_rad), 1.6 + further_m * sin(eta_rad)
    assert clearance(laws.ground, x, z) == pytest.approx(CLEAR_FACTOR * CLEAR_M, abs=0.01)


# --- in a tick ----------------------------------------------------------------------------------


def held(
    laws: Laws,
    mode: int = modes.SOARING,
    faults: int = 0,
    state: BrakeState | None = None,
    limited: Limited | None = None,
) -> tuple[BrakeState, BrakeEffect]:
    """A point at the line's own, which is held there."""
    x, z = laws.target.x_m, laws.target.z_m
    usual = NO_POINT._replace(
        standing=HOLDS, weight=1.0, x_m=x, z_m=z, ordered_x_m=x, ordered_z_m=z
    )
    out = unlimited(SurfaceCommand(0.0, 0.0, 0.0, 0.5))
    return point_step(
        laws,
        usual if state is None else state,
        out if limited is None else limited,
        mode,
        laws.target.eta_rad,
        vehicle=STILL._replace(x_m=x, z_m=z),
        gain_speed_mps=9.0,
        inertial=False,
        faults=faults,
        dt_s=0.005,
    )


@pytest.mark.parametrize("mode", range(modes.BEATING + 1))
def test_a_point_is_held_on_a_line_that_is_flown_alone(laws: Laws, mode: int) -> None:
    standing = held(laws, mode)[0].standing
    assert standing == (HOLDS if mode in (modes.CAPTURING, modes.SOARING) else RESTS)


def test_a_brake_that_does_not_follow_holds_nothing(laws: Laws) -> None:
    assert held(laws, faults=BRAKE)[0].standing == DEAD
    assert held(laws, faults=BRAKE | GAP)[0].standing == DEAD
    assert held(laws, faults=GAP)[0].standing == HOLDS


def test_what_a_shake_adds_to_the_brake_turns_no_setpoint(laws: Laws) -> None:
    calm = NO_POINT._replace(shake=NO_POINT.shake._replace(shaken=0.2))
    for brake, steady in ((0.5, 0.3), (0.1, 0.0)):
        limited = unlimited(SurfaceCommand(0.0, 0.0, 0.0, brake))
        _, effect = held(laws, state=calm, limited=limited)
        assert effect == pytest.approx(brake_effect(laws.brake, steady, 9.0))
    assert brake_effect(laws.brake, 0.3, 9.0).elevator != 0.0


@pytest.mark.parametrize(("below_m", "goes_on"), [(0.26, True), (0.24, False)])
def test_it_gives_way_up_to_a_quarter_of_a_metre_inside_the_fence(
    laws: Laws, below_m: float, goes_on: bool
) -> None:
    """Up along the line: its brake stands all out."""
    state = held(laws)[0]
    along_m = sin(laws.target.eta_rad)
    fence = laws.fence._replace(z_max_m=state.z_m + below_m * along_m)
    gives = laws.brake._replace(gives_way=True)
    shut = laws._replace(fence=fence, brake=gives)
    yields = state._replace(standing=GIVES_WAY, mean=0.95, brake=0.5)
    assert (held(shut, state=yields)[0].given_way_m > 0.0) is goes_on


def test_the_air_is_read_with_the_brake_as_it_stands(laws: Laws) -> None:
    """As it is read back; else as it was commanded, while we do."""
    limited = unlimited(SurfaceCommand(0.0, 0.0, 0.0, 0.4))
    aero = laws.wind.aerodynamics
    away = surfaces_sample(1, 0.0, (0.0, 0.0, 0.0, 0.7))
    for flying, surfaces, out in (
        (True, NO_SURFACES, 0.4), (False, NO_SURFACES, 0.0), (True, away, 0.7), (False, away, 0.7),
    ):  # fmt: skip
        found = wind_with_brake(laws, limited, flying, surfaces)
        assert found == laws.wind._replace(aerodynamics=braked(aero, out))
    none = laws._replace(brake=laws.brake._replace(available=False))
    assert wind_with_brake(none, limited, True, away) is none.wind
