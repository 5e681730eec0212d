"""Gains that are sought for an aircraft when it is loaded: on models that nothing was chosen by."""

from __future__ import annotations

import subprocess
import sys
from functools import lru_cache
from math import radians
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import asdict, replace

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import activity, close_loop
from tgl_soar.analysis.linear_model import disk_margin as linear_margin
from tgl_soar.analysis.linear_plant import Condition, Gusts, linear_plant
from tgl_soar.analysis.tuning.aircraft import Drawn, Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.demands import FREQUENCIES_RADPS
from tgl_soar.analysis.tuning.flights import values_of
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    gains_words,
    load_airframe,
    load_flight,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.flown_gains import with_own_gains
from tgl_soar.config.parameters import ANCHORS, ParameterSet
from tgl_soar.control import loop_margin, pitch_design
from tgl_soar.control.found_gains import INERTIAL, SETS, SHIPPED, nobody_gave
from tgl_soar.control.laws import laws_from
from tgl_soar.control.loop_margin import FLOOR, RADPS, flown
from tgl_soar.control.pitch_design import (
    answers,
    disk_margin,
    gust_variances,
    later,
    own_gains,
    pitch_margin,
)
from tgl_soar.link.autopilots import routes
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.types import OURS

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
GLIDER, JET = shipped("scenarios/unseen/glider.toml"), shipped("scenarios/unseen/jet.toml")
SEED = 1811  # of aircraft that served for no choice


class Plane:
    """A drawn aircraft, with the gains sought for it and with those that the schedule carries."""

    def __init__(self, number: int) -> None:
        self.drawn: Drawn = drawn_aircraft(AIRFRAME, Ranges(), (SEED, number))
        self.sought = values_of(VALUES, self.drawn, INERTIAL, seeks=True)
        kept = {name: VALUES[name] for name in (*SHIPPED, *ANCHORS)}
        self.carried = self.sought.changed(kept)

    def condition(
        self, speed: float, lean_deg: float, kind: str, later_s: float = 0.0
    ) -> Condition:
        known: Airframe = self.drawn.known
        return Condition(
            model=aircraft_model(asdict(known.airframe), known.model),
            servo=servo_params(known.model),
            speed_mps=speed * self.sought["DYN_BEST"],
            lean_rad=radians(lean_deg),
            sensors=Sensors(imu=MEMS_IMU) if kind == INERTIAL else USUAL_SENSORS,
            command_delay_s=self.drawn.latency_s + later_s,
        )

    def alpha(self, values: ParameterSet, condition: Condition) -> float:
        laws = laws_from(values, SITE.frame())
        loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
        return linear_margin(loop, FREQUENCIES_RADPS)

    def e_rho_m(self, values: ParameterSet, condition: Condition) -> float:
        gusts = Gusts(0.03, values["DYN_BEST"])
        return activity(laws_from(values, SITE.frame()), condition, gusts).e_rho_m


@lru_cache(maxsize=8)
def plane(number: int) -> Plane:
    return Plane(number)


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize("lift_mps2", [0.0, -6.0])
def test_its_margin_is_the_rule_s(inertial: bool, lift_mps2: float) -> None:
    """One model, twice: once for a search, at all frequencies together."""
    values = VALUES.changed({"DYN_LIFT": lift_mps2, "CMD_DELAY": 0.02})
    laws = laws_from(values, SITE.frame())
    for speed, lean in ((7.7, 15.0), (9.25, 5.0), (9.25, 45.0), (14.0, 30.0)):
        loop = flown(laws, values, speed, lean, inertial)
        known = answers(values, speed, lean, np.array(RADPS))
        assert disk_margin(loop, known) == pytest.approx(loop_margin.disk_margin(loop), rel=1e-9)
        late = loop._replace(delay_s=loop.delay_s + 0.03)
        assert disk_margin(loop, later(known, 0.03)) == pytest.approx(loop_margin.disk_margin(late))
        wild = loop._replace(pitch=loop.pitch._replace(kp=60.0, kd=6.0))
        assert disk_margin(wild, known) == loop_margin.disk_margin(wild) == 0.0
        no_line = loop._replace(soaring=loop.soaring._replace(kp=0.0, ki=0.0, kd=0.0))
        assert pitch_margin(loop, known) == pytest.approx(loop_margin.disk_margin(no_line))
        assert pitch_margin(wild, known) == 0.0


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("gains", ["carried", "sought"])
def test_its_gusts_are_the_linear_model_s(
    number: int, gains: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With accelerometers, whose noise is small; without, fixes add their own."""
    drawn = plane(number)
    monkeypatch.setattr(pitch_design, "LENGTHS_M", (1.5, 1.5))
    values: ParameterSet = getattr(drawn, gains)
    condition = drawn.condition(1.0, 15.0, INERTIAL)
    speed = values["DYN_BEST"]
    known = answers(values, speed, 15.0, pitch_design._GUST_RADPS)
    loop = flown(laws_from(values, SITE.frame()), values, speed, 15.0, True)
    e_rho, elevator = gust_variances(loop, known, 0.03 * speed) ** 0.5
    found = activity(laws_from(values, SITE.frame()), condition, Gusts(0.03, speed))
    assert e_rho == pytest.approx(found.e_rho_m, rel=0.12)
    assert elevator == pytest.approx(found.elevator, rel=0.3)


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("kind", SETS)
def test_a_drawn_aircraft_has_its_margins_and_less_e_rho(number: int, kind: str) -> None:
    """By the linear model of the whole, which the search does not see."""
    drawn = plane(number)
    assert not nobody_gave(drawn.sought)
    for speed, lean in ((0.92, 10.0), (1.0, 15.0), (1.15, 30.0), (1.0, 5.0), (1.15, 45.0)):
        at = drawn.condition(speed, lean, kind)
        assert drawn.alpha(drawn.sought.changed({"TGL_LEAN": lean}), at) >= FLOOR
    usual = drawn.condition(1.0, 15.0, kind)
    before = drawn.e_rho_m(drawn.carried, usual)
    assert drawn.e_rho_m(drawn.sought, usual) < (0.9 if kind == INERTIAL else 0.8) * before
    for speed in (0.92, 1.0, 1.15):
        for later_s, least in ((0.01, FLOOR), (0.03, 0.15)):
            late = drawn.condition(speed, 15.0, kind, later_s=later_s)
            assert drawn.alpha(drawn.sought, late) > least - 0.03


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("inertial", [True, False])
def test_the_pitch_loop_alone_has_its_own(number: int, inertial: bool) -> None:
    """It launches, holds, recovers and lands, and no line is there to be refused."""
    values = plane(number).sought
    laws = laws_from(values, SITE.frame())
    for fraction in (0.92, 1.0, 1.15):
        speed = fraction * values["DYN_BEST"]
        known = answers(values, speed, 15.0, np.array(RADPS))
        loop = flown(laws, values, speed, 15.0, inertial)
        assert pitch_margin(loop, known) > 0.54
        assert pitch_margin(loop, later(known, 0.01)) > 0.39
        assert pitch_margin(loop, later(known, 0.03)) > 0.14


def lacking(values: ParameterSet, inertial: bool, more: float = 0.0) -> float:
    """What all margins that are asked for lack together, by the rule itself.  more: of each."""
    laws, best = laws_from(values, SITE.frame()), values["DYN_BEST"]
    floors = {5.0: 0.55, 10.0: 0.6, 15.0: 0.6, 20.0: 0.6, 30.0: 0.6, 45.0: 0.55}
    places = [(f, lean, floor) for f in (0.92, 1.0, 1.15) for lean, floor in floors.items()]
    short = 0.0
    for fraction, lean, floor in (*places, (1.5, 15.0, 0.55)):
        loop = flown(laws, values, fraction * best, lean, inertial)
        alone = loop._replace(soaring=loop.soaring._replace(kp=0.0, ki=0.0, kd=0.0))
        asked = [(loop, 0.0, floor)]
        if lean == 15.0:
            asked += [(alone, 0.0, 0.55), (loop, 0.01, 0.5), (alone, 0.01, 0.4)]
            asked += [(loop, 0.03, 0.15), (alone, 0.03, 0.15)]
        found = (
            least + more - loop_margin.disk_margin(each._replace(delay_s=each.delay_s + late_s))
            for each, late_s, least in asked
        )
        short += max(0.0, *found)
    return short


@pytest.mark.parametrize("kind", SETS)
@pytest.mark.parametrize(
    "factors",
    [
        {},
        {"ELE_P": 1.5, "RHO_P": 0.3, "RHO_D": 0.3},
        {"ELE_D": 1.6, "RHO_P": 0.3, "RHO_D": 0.3},
        {"RHO_P": 2.0},
        {"RHO_D": 1.5},
        {"RHO_P": 1.2, "RHO_D": 1.2, "ELE_P": 1.2, "ELE_D": 1.2},
    ],
    ids=str,
)
def test_every_margin_that_is_asked_for_counts(kind: str, factors: dict[str, float]) -> None:
    """Of gains as they were sought, and of some that lack one thing or another."""
    sought, suffix = plane(1).sought, "_IMU" if kind == INERTIAL else ""
    changes = {f"{name}{suffix}": f * sought[f"{name}{suffix}"] for name, f in factors.items()}
    values = sought.changed(changes)
    judged = pitch_design._DesignTask(values, kind).judged(values)
    expected = lacking(values, kind == INERTIAL)
    assert judged.short == pytest.approx(expected, abs=1e-6)
    assert (expected > 0.02) is bool(factors)
    if not factors:
        assert lacking(values, kind == INERTIAL, more=0.02) > 0.0  # the search has used it


def test_gains_without_what_is_asked_for_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    known = plane(0).carried
    assert own_gains(known) != {}
    pitch_design._own_gains.cache_clear()
    monkeypatch.setattr(pitch_design, "LEANS_DEG", {15.0: 1.8})  # of hardly any gain alone
    try:
        assert own_gains(known) == {}
    finally:
        pitch_design._own_gains.cache_clear()


@pytest.mark.parametrize("time_s", [0.1, 1.0])
def test_gusts_have_the_strength_that_is_said(time_s: float) -> None:
    """Both spectra sum up to a variance of 1, and w has less of what is slow."""
    radps = np.geomspace(1e-5, 1e5, 20001)
    w, u = pitch_design._dryden(radps, time_s)
    steps = np.gradient(radps)
    assert float(np.sum(w * steps)) == pytest.approx(1.0, rel=0.01)
    assert float(np.sum(u * steps)) == pytest.approx(1.0, rel=0.01)
    assert w[0] == pytest.approx(0.5 * u[0])


def test_a_flying_wing_s_elevator_is_its_lift_too() -> None:
    """Five times the shipped aircraft's: without it the rule would have 0.7 where there is 0.5."""
    model = {**AIRFRAME.model, "CL_elevator": -0.45, "Cm_alpha": 1.4 * AIRFRAME.model["Cm_alpha"]}
    wing = replace(AIRFRAME, model=model)
    values = load_parameters(wing, AIRFRAME_PATH, SITE, SITE_PATH)
    assert values["DYN_LIFT"] == pytest.approx(5.0 * VALUES["DYN_LIFT"], rel=0.05)
    values = values.changed({name: VALUES[name] for name in (*SHIPPED, *ANCHORS)})
    speed = values["DYN_BEST"]
    condition = Condition(
        model=aircraft_model(asdict(wing.airframe), model),
        servo=servo_params(model),
        speed_mps=speed,
        lean_rad=radians(15.0),
        sensors=Sensors(imu=MEMS_IMU),
        command_delay_s=values["CMD_DELAY"],
    )
    plant = linear_plant(condition)
    laws = laws_from(values, SITE.frame())
    truth = linear_margin(close_loop(plant, linear_controller(laws, condition)))
    loop = flown(laws, values, plant.trim.airspeed_mps, 15.0, True)
    assert loop_margin.disk_margin(loop) == pytest.approx(truth, abs=0.02)
    assert loop_margin.disk_margin(loop._replace(lift_mps2=0.0)) > truth + 0.1


def test_the_shipped_aircraft_keeps_its_gains() -> None:
    assert own_gains(VALUES) == {}
    for name, value in AIRFRAME.parameters.items():
        assert VALUES[name] == pytest.approx(value, rel=1e-6)


def unseen(parameters: dict[str, float] | None = None, route: str | None = None) -> ParameterSet:
    plane = load_airframe(GLIDER)
    if parameters is not None:
        plane = replace(plane, parameters=parameters)
    if route is not None:
        plane = replace(plane, autopilot=replace(plane.autopilot, firmware="px4", route=route))
    return load_parameters(plane, GLIDER, load_site(JET), JET)


def test_another_aircraft_s_file_gets_its_own() -> None:
    """Whether its file has a copy of the shipped gains or none."""
    values, given = unseen(), load_airframe(GLIDER).parameters
    assert values["RHO_P_IMU"] != given["RHO_P_IMU"] == SHIPPED["RHO_P_IMU"]
    assert values["RHO_SPEED"] == values["DYN_SPEED"]
    assert values["ELE_FREQ"] == values["DYN_FREQ"]
    assert values["ELE_LATE"] == pytest.approx(values["DYN_SERVO"] + values["CMD_DELAY"])
    assert own_gains(values) == {}  # they are its own now: a second time nothing is sought
    rest = {name: value for name, value in given.items() if name not in SHIPPED}
    bare = unseen(rest)
    assert [bare[name] for name in (*SHIPPED, *ANCHORS)] == [
        values[name] for name in (*SHIPPED, *ANCHORS)
    ]


@pytest.mark.parametrize("name", ["RHO_P_IMU", "ELE_D", "RHO_SPEED"])
def test_what_a_file_gives_is_flown(name: str) -> None:
    given = {**load_airframe(GLIDER).parameters, name: 0.9 * VALUES[name]}
    values = unseen(given)
    for gain in SHIPPED:
        assert values[gain] == pytest.approx(given[gain], rel=1e-6)


@pytest.mark.parametrize("firmware", ["ardupilot", "px4", "paparazzi", "bridge"])
def test_a_firmware_s_own_loops_fly_the_gains_that_the_schedule_carries(firmware: str) -> None:
    link = replace(load_airframe(GLIDER).autopilot, firmware=firmware)
    usual = routes(firmware)[0].name
    for route in routes(firmware):
        named = [None, route.name] if route.name == usual else [route.name]
        for name in named:
            assert replace(link, route=name).holds_attitude is (route.loops != OURS)


def test_where_the_firmware_holds_the_attitude_nothing_is_sought() -> None:
    values = unseen(route="attitude")
    assert values["RHO_P"] == pytest.approx(SHIPPED["RHO_P"])
    assert values["RHO_SPEED"] == VALUES["RHO_SPEED"]


@pytest.mark.parametrize(
    "changes",
    [
        {"CMD_DELAY": 0.19, "DYN_SERVO": 0.1, "DYN_LAG": 0.02, "DYN_DAMP": 0.1},
        {"CMD_DELAY": 0.2, "DYN_SERVO": 0.3},  # later than an anchor may be
        {"DYN_FREQ": 0.5},  # slower than one may be
        {"DYN_EFFECT": 500.0, "DYN_FREQ": 60.0, "DYN_DAMP": 2.0},
        {"DYN_PATH": 1e-4, "DYN_SPEED": 60.0, "DYN_BEST": 1.0},
    ],
    ids=str,
)
def test_what_hardly_flies_gets_margins_or_nothing(changes: dict[str, float]) -> None:
    """The schedule's gains stay, and the rule reports its verdict on them."""
    plain = unseen().changed({name: VALUES[name] for name in (*SHIPPED, *ANCHORS)})
    assert own_gains(plain) != {}
    strange = plain.changed(changes)
    found = with_own_gains(strange, load_airframe(GLIDER).autopilot)
    if found != strange:
        assert min(margin.alpha for margin in loop_margin.line_margins(found)) >= FLOOR
    assert own_gains(found) in ({}, own_gains(strange))


@pytest.mark.parametrize("changes", [{"DYN_FREQ": 0.5}, {"CMD_DELAY": 0.2, "DYN_SERVO": 0.3}])
def test_what_no_anchor_may_be_keeps_what_it_had(changes: dict[str, float]) -> None:
    plain = unseen().changed({name: VALUES[name] for name in (*SHIPPED, *ANCHORS)})
    assert own_gains(plain.changed(changes)) == {}


def test_the_same_is_found_again() -> None:
    values = plane(0).carried
    found = own_gains(values)
    pitch_design._own_gains.cache_clear()
    assert own_gains(values) == found
    assert own_gains(values.changed({"TGL_X": 1.0, "FENCE_X_MAX": 30.0})) == found
    assert own_gains(values.changed({"CMD_DELAY": values["CMD_DELAY"] + 0.01})) != found


@pytest.mark.parametrize(
    ("airframe", "site"), [(AIRFRAME_PATH, SITE_PATH), (GLIDER, JET)], ids=["given", "sought"]
)
def test_a_process_that_flies_keeps_no_numpy(airframe: Path, site: Path, tmp_path: Path) -> None:
    """It locks its memory: what a search needs, another process has loaded for it."""
    code = (
        "import sys; from tgl_soar.config.files import load_flight;"
        f"values = load_flight({str(airframe)!r}, {str(site)!r})[2];"
        "print(values['RHO_P_IMU'], values['ELE_P'], values['RHO_SPEED']);"
        "sys.exit('numpy' in sys.modules or 'scipy' in sys.modules)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], check=False, cwd=tmp_path, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    here = load_flight(airframe, site)[2]
    assert ran.stdout.split() == [str(here[n]) for n in ("RHO_P_IMU", "ELE_P", "RHO_SPEED")]


def test_where_no_other_process_can_be_had_it_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    here = unseen()
    monkeypatch.setattr(sys, "modules", {n: m for n, m in sys.modules.items() if n != "numpy"})
    monkeypatch.setattr(sys, "executable", "/nowhere")
    found = unseen()
    monkeypatch.undo()
    assert [found[name] for name in (*SHIPPED, *ANCHORS)] == [
        here[name] for name in (*SHIPPED, *ANCHORS)
    ]


def test_a_file_without_gains_flies_the_shipped_ones_where_none_are_sought() -> None:
    """The declared ones are of no aircraft that flies here."""
    rest = {n: v for n, v in AIRFRAME.parameters.items() if n not in SHIPPED}
    bare = replace(AIRFRAME, parameters=rest)
    assert load_parameters(bare, AIRFRAME_PATH, SITE, SITE_PATH) == VALUES
    other = {n: v for n, v in load_airframe(GLIDER).parameters.items() if n not in SHIPPED}
    by_attitude = unseen(other, route="attitude")
    assert [by_attitude[n] for n in SHIPPED] == [VALUES[n] for n in SHIPPED]


def words(parameters: dict[str, float] | None = None, route: str | None = None) -> str:
    plane, site = load_airframe(GLIDER), load_site(JET)
    if parameters is not None:
        plane = replace(plane, parameters=parameters)
    if route is not None:
        plane = replace(plane, autopilot=replace(plane.autopilot, firmware="px4", route=route))
    return gains_words(plane, site, load_parameters(plane, GLIDER, site, JET))


def test_whose_gains_they_are_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    given = load_airframe(GLIDER).parameters
    assert words() == "gains of pitch: sought for this aircraft"
    assert words({n: v for n, v in given.items() if n not in SHIPPED}) == words()
    changed = {**given, "RHO_P_IMU": 1.0}
    assert words(changed) == "gains of pitch: as the files give them (RHO_P_IMU); none are sought"
    assert words(route="attitude").endswith("to this aircraft: the autopilot holds the attitude")
    assert gains_words(AIRFRAME, SITE, VALUES) == ""
    monkeypatch.setattr(pitch_design, "own_gains", lambda _values: {})
    assert words().endswith("none have the margins that are asked for")
