"""Gains as parameters: which are whose, and how they are anchored to an aircraft."""

from __future__ import annotations

from math import radians

import pytest

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import (
    INERTIAL,
    PLAIN,
    SETS,
    SHIPPED,
    anchored,
    are_for_another,
    gains_of,
    nobody_gave,
    on_found_aircraft,
    with_gains,
)
from tgl_soar.control.laws import laws_from
from tgl_soar.control.pitch_schedule import pitch_gains, soaring_gains
from tgl_soar.control.target_line import eta_from_lean

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
START = anchored(VALUES, 15.0)


def flown_at(values: ParameterSet, speed_mps: float, lean_deg: float) -> list[float]:
    """All gains that fly there."""
    laws = laws_from(values, SITE.frame())
    eta = eta_from_lean(radians(lean_deg))
    found = []
    for weight, soaring, pitch in (
        (0.0, laws.soaring, laws.pitch),
        (1.0, laws.soaring_imu, laws.pitch_imu),
    ):
        outer = soaring_gains(soaring, laws.schedule, weight, speed_mps, eta).pid
        inner = pitch_gains(pitch, laws.schedule, speed_mps)
        found += [outer.kp, outer.ki, outer.kd, outer.rate_filter_radps]
        found += [inner.kp, inner.ki, inner.kd]
    return found


@pytest.mark.parametrize("lean", [10.0, 15.0, 30.0])
def test_anchored_gains_fly_as_they_did_where_they_are_anchored(lean: float) -> None:
    start = anchored(VALUES, lean)
    assert start["RHO_SPEED"] == VALUES["DYN_SPEED"] != VALUES["RHO_SPEED"]
    assert flown_at(start, VALUES["DYN_SPEED"], lean) == pytest.approx(
        flown_at(VALUES, VALUES["DYN_SPEED"], lean), rel=1e-4
    )


def test_an_airframe_that_is_not_known_is_refused_with_what_lacks() -> None:
    with pytest.raises(ValueError, match=r"DYN_FREQ = 0: .*\[dynamics\]"):
        anchored(VALUES.changed({"DYN_FREQ": 0.0}), 15.0)


@pytest.mark.parametrize(
    "changes", [{"RHO_D": 0.0}, {"ELE_D": 0.0}, {"RHO_D": 0.0, "RHO_D_IMU": 0.0}]
)
def test_a_gain_of_nothing_is_named(changes: dict[str, float]) -> None:
    """Of IMU gains 0 means those without, and is none of nothing."""
    with pytest.raises(ValueError, match=f"{next(iter(changes))} = 0: gains are sought as factors"):
        anchored(VALUES.changed(changes), 15.0)
    assert anchored(VALUES.changed({"RHO_D_IMU": 0.0}), 15.0)["RHO_D_IMU"] > 0.0


@pytest.mark.parametrize("kind", SETS)
def test_integrals_keep_their_time(kind: str) -> None:
    larger = with_gains(START, kind, [1.5 * gain for gain in gains_of(START, kind)])
    suffix = "_IMU" if kind == INERTIAL else ""
    for loop in ("RHO", "ELE"):
        for letter in "PID":
            name = f"{loop}_{letter}{suffix}"
            assert larger[name] == pytest.approx(1.5 * START[name], rel=1e-6)
    other = "_IMU" if kind == PLAIN else ""
    assert larger[f"RHO_P{other}"] == START[f"RHO_P{other}"]


def test_the_shipped_gains_are_those_of_the_shipped_file() -> None:
    """A file that is copied from it has them too."""
    own = {n: v for n, v in AIRFRAME.parameters.items() if n.startswith(("RHO", "ELE"))}
    assert own == SHIPPED


@pytest.mark.parametrize(
    "changes",
    [
        {"RHO_P": 0.41},
        {"ELE_D_IMU": 0.71},
        {"RHO_I": 0.17},
        {"RHO_DF_IMU": 19.0},
        {"ELE_D_FILT": 79.0},
        {"RHO_SPEED": 8.6},
        {"RHO_SPEED": 0.0},
        {"ELE_EFFECT": 32.0},
        {"ELE_LATE": 0.03},
        dict.fromkeys(("RHO_P_IMU", "RHO_D_IMU"), 0.0),
    ],
    ids=str,
)
def test_gains_that_were_given_are_kept(changes: dict[str, float]) -> None:
    assert nobody_gave(VALUES)
    assert not nobody_gave(VALUES.changed(changes))
    assert nobody_gave(VALUES.changed({"TGL_X": 1.0, "AIL_P": 0.5, "PITCH_TRIM": -2.0}))


def test_of_a_file_without_gains_nobody_gave_any() -> None:
    assert nobody_gave(ParameterSet())
    assert not nobody_gave(ParameterSet().changed({"RHO_P": 0.4}))


@pytest.mark.parametrize("name", ["DYN_FREQ", "DYN_DAMP", "DYN_EFFECT", "DYN_LAG"])
def test_another_aircraft_is_one_that_differs_by_more_than_a_twentieth(name: str) -> None:
    """In what turns its loop; the link of the same aircraft is the schedule's matter."""
    at = VALUES.changed({"DYN_SPEED": VALUES["RHO_SPEED"], "DYN_SERVO": 0.1})
    for own, found in (
        ("DYN_FREQ", "ELE_FREQ"),
        ("DYN_DAMP", "ELE_DAMP"),
        ("DYN_EFFECT", "ELE_EFFECT"),
    ):
        at = at.changed({own: at[found]})
    assert on_found_aircraft(at)
    assert not are_for_another(at)
    for factor, alike in ((0.96, True), (1.04, True), (0.94, False), (1.06, False)):
        assert on_found_aircraft(at.changed({name: factor * at[name]})) is alike
        assert are_for_another(at.changed({name: factor * at[name]})) is not alike


def test_the_speed_at_which_an_aircraft_is_known_is_reckoned_with() -> None:
    """The period goes with V, the effect with V²: the same aircraft given at 17 m/s."""
    at = VALUES.changed({"DYN_SPEED": 17.0, "DYN_FREQ": 23.0, "DYN_DAMP": 0.75})
    assert on_found_aircraft(at.changed({"DYN_EFFECT": 124.0}))
    assert not on_found_aircraft(at.changed({"DYN_EFFECT": 31.0}))


def test_an_aircraft_of_which_nobody_knows_is_taken_for_that_of_the_gains() -> None:
    other = VALUES.changed({"DYN_FREQ": 6.0})
    assert are_for_another(other)
    assert on_found_aircraft(other.changed({"DYN_SPEED": 0.0}))
    assert on_found_aircraft(other.changed({"RHO_SPEED": 0.0}))
    assert not are_for_another(other.changed({"DYN_PATH": 0.0}))
