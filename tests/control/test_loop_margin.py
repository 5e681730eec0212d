"""The rule on board against the linear model, and what it refuses."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import product
from math import isnan, radians

import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import close_loop, disk_margin
from tgl_soar.analysis.linear_plant import Condition, linear_plant
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.line_changes import LineChanges
from tgl_soar.config.parameters import ANCHORS, ParameterError, ParameterSet
from tgl_soar.control import loop_margin
from tgl_soar.control.found_gains import SHIPPED
from tgl_soar.control.laws import dynamics_of, laws_from
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.loop_margin import FLOOR, flown, margin_fault
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.types import THEIRS

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
MODEL = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)


@lru_cache(maxsize=1)
def shipped_values() -> ParameterSet:
    return load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)


def both(values: ParameterSet, speed: float, lean: float, inertial: bool) -> tuple[float, float]:
    """The margin by the rule and by the linear model."""
    laws = laws_from(values, SITE.frame())
    condition = Condition(
        model=MODEL,
        servo=servo_params(AIRFRAME.model),
        speed_mps=speed,
        lean_rad=radians(lean),
        sensors=Sensors(imu=MEMS_IMU) if inertial else USUAL_SENSORS,
        command_delay_s=values["CMD_DELAY"],
    )
    plant = linear_plant(condition)
    airspeed = plant.trim.airspeed_mps
    model = disk_margin(close_loop(plant, linear_controller(laws, condition)))
    return loop_margin.disk_margin(flown(laws, values, airspeed, lean, inertial)), model


@pytest.mark.parametrize(
    "changes",
    [
        *({name: 0.0} for name in ("speed_mps", "short_period_radps", "damping", "effect_radps2")),
        *({name: 0.9} for name in ("glide_ratio", "best_glide_mps")),
        {"path_s": 0.0},
    ],
)
def test_a_margin_is_of_an_airframe_of_which_all_is_known(changes: dict[str, float]) -> None:
    known = dynamics_of(shipped_values())
    assert loop_margin.is_known(known)
    assert not loop_margin.is_known(known._replace(**changes))


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize("delay_s", [0.005, 0.0245, 0.04])
@pytest.mark.parametrize("weight", [0.0, 0.75])
def test_the_rule_agrees_with_the_linear_model(
    inertial: bool, delay_s: float, weight: float
) -> None:
    """Within 0.03; what a file errs by takes more (1 dB of the elevator's effect takes 0.1)."""
    values = shipped_values().changed({"CMD_DELAY": delay_s, "ELE_DSP_IMU": weight})
    for speed in (8.5, 12.0, 14.0):
        for lean in (5.0, 15.0, 45.0):
            rule, model = both(values, speed, lean, inertial)
            assert rule == pytest.approx(model, abs=0.03), f"{speed} m/s, {lean} degrees"


@pytest.mark.parametrize("inertial", [True, False])
def test_the_rule_knows_what_is_unstable(inertial: bool) -> None:
    """The gains as they stand on a line leaning 45 degrees, and on one leaning 5 at 14 m/s."""
    as_they_stand = shipped_values().changed({"RHO_SPEED": 0.0, "CMD_DELAY": 0.04})
    for speed, lean in ((8.5, 45.0), (14.0, 5.0), (8.5, 15.0)):
        rule, model = both(as_they_stand, speed, lean, inertial)
        assert rule < FLOOR + 0.02
        assert model < FLOOR
        assert rule == pytest.approx(model, abs=0.03)


def test_every_lean_of_the_shipped_airframe_is_accepted() -> None:
    for lean in (5.0, 15.0, 30.0, 45.0):
        for delay in (0.005, 0.0245, 0.04):
            values = shipped_values().changed({"TGL_LEAN": lean, "CMD_DELAY": delay})
            assert margin_fault(values) == ""


@lru_cache(maxsize=1)
def unseen_values() -> ParameterSet:
    """Of an aircraft that no gain was found on, with the shipped gains."""
    airframe, site = shipped("scenarios/unseen/glider.toml"), shipped("scenarios/unseen/jet.toml")
    return load_parameters(load_airframe(airframe), airframe, load_site(site), site)


@pytest.mark.parametrize("delay_s", [0.0075, 0.0245])
def test_every_lean_of_an_aircraft_that_no_gain_was_found_on_is_accepted(delay_s: float) -> None:
    """Gains yield where the margin would not do: without, 0.49 at 5 degrees with accelerometers,
    and 0.46 at 45 without."""
    values = unseen_values().changed({"CMD_DELAY": delay_s})
    for degree in range(5, 46):
        assert margin_fault(values.changed({"TGL_LEAN": float(degree)})) == ""
    # The shipped aircraft's gains, as the schedule carries them there.
    values = values.changed({name: shipped_values()[name] for name in (*SHIPPED, *ANCHORS)})
    for degree in range(5, 46):
        assert margin_fault(values.changed({"TGL_LEAN": float(degree)})) == ""
    unyielding = values.changed({"DYN_PATH": 0.0})
    laws, firm = laws_from(values, SITE.frame()), laws_from(unyielding, SITE.frame())
    for lean, fraction, inertial in ((5.0, 0.92, True), (45.0, 1.15, False)):
        speed = fraction * values["DYN_BEST"]
        with_it = flown(laws, values, speed, lean, inertial)
        without = with_it._replace(soaring=flown(firm, unyielding, speed, lean, inertial).soaring)
        assert loop_margin.disk_margin(with_it) > FLOOR
        if delay_s < 0.01:
            assert loop_margin.disk_margin(without) < FLOOR


def test_a_line_is_judged_where_it_is_soared() -> None:
    """From 8.5 to 10.6 m/s, of 9.25 at best glide, with accelerometers and without."""
    best_mps = shipped_values()["DYN_BEST"]
    shown = [f"{fraction * best_mps:.1f} m/s" for fraction in (0.92, 1.0, 1.15)]
    assert shown == ["8.5 m/s", "9.3 m/s", "10.6 m/s"]
    found = loop_margin.line_margins(shipped_values())
    places = [
        re.findall(r"and (\S+ m/s), 7.5 ms late, (with(?:out)?) ", each.name) for each in found
    ]
    both = ("without", "with")
    assert [place for (place,) in places] == [(speed, s) for s in both for speed in shown]
    for each, (inertial, fraction) in zip(
        found, product((False, True), (0.92, 1.0, 1.15)), strict=True
    ):
        laws = laws_from(shipped_values(), SITE.frame())
        lean = shipped_values()["TGL_LEAN"]
        loop = flown(laws, shipped_values(), fraction * best_mps, lean, inertial)
        assert each.alpha == loop_margin.disk_margin(loop)


def test_what_has_no_margin_is_refused_with_the_reason() -> None:
    """Per lean and latency: gains as they stand fly 15 degrees at once, and not 45."""
    values = shipped_values().changed({"RHO_SPEED": 0.0})
    assert margin_fault(values.changed({"TGL_LEAN": 15.0})) == ""
    words = margin_fault(values.changed({"TGL_LEAN": 45.0}))
    assert words.startswith("no margin at lean 45 deg and ")
    assert "7.5 ms late" in words
    assert LineBounds().fault(values.changed({"TGL_LEAN": 45.0})) == words
    late = values.changed({"TGL_LEAN": 15.0, "CMD_DELAY": 0.06})
    assert "60 ms late, without accelerometers" in margin_fault(late)


@pytest.mark.parametrize(
    ("name", "value"),
    [("RHO_D_IMU", 2.0), ("RHO_P", 3.5), ("ELE_D", 1.5), ("ELE_D_FILT", 1.0), ("ELE_EFFECT", 90.0)],
)
def test_a_gain_that_leaves_no_margin_is_refused_in_flight(name: str, value: float) -> None:
    """On the ground it is warned of: what engages asks again.  The way back is open."""
    before = shipped_values()
    changes = LineChanges(fault=LineBounds().fault, ringing=LineBounds().ringing)
    with pytest.raises(ParameterError, match=f"{name} = .*: no margin at lean 15 deg.*OP_FORCE 1"):
        changes.set(before, name, value, flying=True)
    warned = changes.set(before, name, value, flying=False)
    assert warned.warning.startswith("no margin at lean 15 deg")
    assert warned.values[name] == pytest.approx(value)
    back = changes.set(warned.values, name, before[name], flying=True)
    assert (back.values[name], back.warning) == (before[name], "")
    forced = changes.set(before.changed({"OP_FORCE": 1.0}), name, value, flying=True)
    assert forced.values[name] == pytest.approx(value)
    assert forced.values["OP_FORCE"] == 0.0
    assert forced.warning.startswith("no margin")


@pytest.mark.parametrize("name", ["ELE_P", "ELE_P_IMU"])
def test_half_a_gain_is_taken_in_flight_with_a_warning(name: str) -> None:
    """Where the aircraft swings that the model says does not, its operator goes back with it."""
    before = shipped_values()
    changes = LineChanges(fault=LineBounds().fault, ringing=LineBounds().ringing)
    taken = changes.set(before, name, 0.5 * before[name], flying=True)
    assert taken.values[name] == pytest.approx(0.5 * before[name])
    assert ": 0.4" in taken.warning


def test_a_margin_is_never_shown_as_more_than_it_is() -> None:
    """1.33 times RHO_D leaves 0.498: refused as 0.50 of 0.5 it would read as a mistake."""
    before = shipped_values()
    words = margin_fault(before.changed({"RHO_D": 1.33 * before["RHO_D"]}))
    assert words.endswith(": 0.49 of 0.5")


def test_a_gain_that_leaves_its_margin_is_taken_without_a_word() -> None:
    changes = LineChanges(fault=LineBounds().fault)
    before = shipped_values().changed({"OP_FORCE": 1.0})
    taken = changes.set(before, "RHO_P", 0.5, flying=True)
    assert (taken.values["RHO_P"], taken.warning) == (0.5, "")
    assert taken.values["OP_FORCE"] == 1.0  # not used up


def test_where_nothing_is_judged_it_is_reported() -> None:
    """Of an airframe that is not known, and by an attitude route, where no ELE_ gain is flown."""
    known, bounds = shipped_values(), LineBounds()
    assert bounds.warning(known) == ""
    unknown = known.changed({"DYN_PATH": 0.0})
    words = "no margin is judged: of the airframe DYN_PATH is not known"
    assert bounds.warning(unknown) == words
    changes = LineChanges(fault=bounds.fault, ringing=bounds.ringing, warning=bounds.warning)
    for flying in (True, False):
        assert changes.set(known, "DYN_PATH", 0.0, flying=flying).warning == words
        assert changes.set(unknown, "ELE_D", 1.5, flying=flying).warning == words
    assert changes.set(unknown, "TGL_X", known["TGL_X"] + 0.01, flying=False).warning == ""
    theirs = LineBounds(loops=THEIRS)
    routed = LineChanges(fault=theirs.fault, ringing=theirs.ringing, warning=theirs.warning)
    taken = routed.set(known, "ELE_D", 1.5, flying=True)
    assert taken.values["ELE_D"] == 1.5
    assert taken.warning == "no margin is judged: the autopilot's own loops hold the attitude"


def test_of_an_unknown_airframe_nothing_is_reported() -> None:
    assert margin_fault(ParameterSet().changed({"TGL_LEAN": 45.0, "RHO_SPEED": 0.0})) == ""


def test_a_delay_that_the_schedule_does_not_know_costs_margin() -> None:
    """One that it knows is what `margin_fault` looks at; 30 ms more leave less than the floor."""
    values = shipped_values().changed({"TGL_LEAN": 15.0})
    known = loop_margin.margin_when_late(values, values["CMD_DELAY"])
    assert known >= FLOOR
    late = loop_margin.margin_when_late(values, values["CMD_DELAY"] + 0.03)
    assert late < FLOOR
    aware = values.changed({"CMD_DELAY": values["CMD_DELAY"] + 0.03})
    assert loop_margin.margin_when_late(aware, aware["CMD_DELAY"]) >= FLOOR
    assert isnan(loop_margin.margin_when_late(ParameterSet(), 0.01))
