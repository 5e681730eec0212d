"""A flight between processes without its processes: how datagrams and time are carried between the
bridge and the operator, when the module is killed, and what is made of what was flown."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from math import inf, isnan, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tgl_soar.config.files import load_flight, load_site, shipped
from tgl_soar.sim import sitl
from tgl_soar.sim.bridge.slowness import TOO_SLOW
from tgl_soar.sim.operator import FlownLeg, Operator, OperatorError
from tgl_soar.sim.sitl import SitlFlight, fly, passed, plan
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import SitlProcesses
from tgl_soar.sim.world import site_field

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
BRIDGE, STRANGER = ("127.0.0.1", 1), ("127.0.0.1", 2)
ROUND_S = 0.0625  # of the clock, from one look at the socket to the next


def options(out: Path, **changes: Any) -> SitlOptions:
    return SitlOptions(**{"airframe": AIRFRAME, "site": SITE, "out": out, **changes})


# --- datagrams and time ---------------------------------------------------------------------------


class Script:
    """What arrives, one entry a look: (sender, its words), or None.  An operator that takes words
    that begin with a time for telemetry, and is done after the last."""

    def __init__(self, arrives: list[tuple[tuple[str, int], str] | None]) -> None:
        self.arrives = arrives
        self.looks = 0
        self.received: list[str] = []
        self.steps: list[float] = []
        self.sent: list[tuple[bytes, tuple[str, int]]] = []
        self.killed: list[tuple[str, float]] = []
        self.checks = 0
        self.shown: list[float] = []
        self.telemetry = SimpleNamespace(time_s=nan)
        self.flown: list[FlownLeg] = []

    @property
    def done(self) -> bool:
        return self.looks >= len(self.arrives)

    @property
    def now_s(self) -> float:
        return 1000.0 + ROUND_S * self.looks

    def select(self, *_: object) -> tuple[list[int], list[int], list[int]]:
        self.looks += 1
        return ([1] if self.arrives[self.looks - 1] is not None else []), [], []

    def recvfrom(self, _size: int) -> tuple[bytes, tuple[str, int]]:
        arrived = self.arrives[self.looks - 1]
        assert arrived is not None
        return arrived[1].encode(), arrived[0]

    def sendto(self, data: bytes, to: tuple[str, int]) -> None:
        self.sent.append((data, to))

    def receive(self, data: bytes) -> bool:
        words = data.decode()
        self.received.append(words)
        if words == "noise":
            return False
        self.telemetry.time_s = float(words)
        return True

    def step(self, now_s: float) -> list[bytes]:
        self.steps.append(now_s)
        return [f"at {now_s:g}".encode()]

    def kill(self, name: str) -> None:
        self.killed.append((name, self.telemetry.time_s))

    def check(self) -> None:
        self.checks += 1

    def last_words(self) -> str:
        return "  bridge: the last"


def operated(script: Script, monkeypatch: pytest.MonkeyPatch, chosen: SitlOptions) -> float | None:
    monkeypatch.setattr(sitl, "time", SimpleNamespace(monotonic=lambda: script.now_s))
    monkeypatch.setattr(sitl, "select", SimpleNamespace(select=script.select))
    one = cast(Any, script)
    return sitl._operate(one, one, one, lambda _: script.shown.append(script.now_s), chosen)


def test_who_speaks_first_and_is_understood_is_the_bridge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrives = [(STRANGER, "noise"), (BRIDGE, "1"), (STRANGER, "9"), (BRIDGE, "2"), None]
    script = Script([*arrives])
    assert operated(script, monkeypatch, options(tmp_path)) is None
    assert script.received == ["noise", "1", "2"]
    assert script.checks == 5
    assert not script.killed
    assert {to for _, to in script.sent} == {BRIDGE}


def test_once_there_is_simulated_time_the_operator_acts_on_what_comes_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before that by the clock of the wall, and nothing is sent."""
    script = Script([None, None, (BRIDGE, "1.5"), None, (BRIDGE, "2.5"), None, None])
    operated(script, monkeypatch, options(tmp_path))
    assert script.steps == [1000.0 + ROUND_S, 1000.0 + 2 * ROUND_S, 1.5, 2.5]
    assert script.sent == [(b"at 1.5", BRIDGE), (b"at 2.5", BRIDGE)]


def test_progress_is_shown_at_intervals_and_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than a tenth of a second apart: every second round of a sixteenth."""
    script = Script([None] * 5)
    operated(script, monkeypatch, options(tmp_path))
    rounds = [round((now_s - 1000.0) / ROUND_S) for now_s in script.shown]
    assert rounds == [2, 4, 5]


@pytest.mark.parametrize(
    ("kill_s", "killed_s"), [(None, None), (3.0, 8.0), (2.9, 8.0), (3.1, 9.0), (7.0, None)]
)
def test_the_module_is_killed_once_so_long_after_its_line_first_stood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kill_s: float | None, killed_s: float | None
) -> None:
    script = Script([(BRIDGE, str(second)) for second in (4, 5, 6, 7, 8, 9, 10)])
    legs = plan(load_site(SITE), load_flight(AIRFRAME, SITE)[2], options(tmp_path))
    script.flown = [FlownLeg(legs[0], 1.0, stopped_s=5.0), FlownLeg(legs[1], 8.0, stopped_s=1.0)]
    found = operated(script, monkeypatch, options(tmp_path, kill_s=kill_s))
    assert found == killed_s
    assert script.killed == ([] if killed_s is None else [("module", killed_s)])


def test_nothing_is_killed_before_a_line_has_stood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Script([(BRIDGE, str(second)) for second in (4, 50, 600)])
    assert operated(script, monkeypatch, options(tmp_path, kill_s=1.0)) is None
    assert not script.killed


@pytest.mark.parametrize(
    ("realtime", "spoken", "waits_s"),
    [(True, False, 120.0), (False, False, 120.0), (True, True, 20.0), (False, True, 120.0)],
)
def test_a_silent_bridge_is_given_up_with_its_last_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, realtime: bool, spoken: bool, waits_s: float
) -> None:
    first: tuple[tuple[str, int], str] | None = (BRIDGE, "1") if spoken else None
    script = Script([first, *[None] * round(130 / ROUND_S)])
    with pytest.raises(SitlError, match=f"nothing received .* for {waits_s:g} s") as raised:
        operated(script, monkeypatch, options(tmp_path, realtime=realtime))
    assert "may be too busy for real time" in str(raised.value)
    assert str(raised.value).endswith("\n  bridge: the last")
    began_s = ROUND_S * spoken
    assert waits_s < script.now_s - 1000.0 - began_s <= waits_s + ROUND_S


# --- its processes --------------------------------------------------------------------------------


class Started(SitlProcesses):
    """Processes that are not started."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.commands: dict[str, list[str]] = {}
        self.stopped = 0

    def start(self, name: str, command: list[str]) -> None:
        self.commands[name] = command

    def stop(self) -> None:
        self.stopped += 1


def flown_by(
    chosen: SitlOptions, done: Callable[[], bool]
) -> tuple[Started, float | None, SitlError | None]:
    class Stub:
        @property
        def done(self) -> bool:
            return done()

    processes, operator = Started(chosen.out), cast(Operator, Stub())
    try:
        truth = chosen.out / "truth.csv"
        killed_s = sitl._fly(chosen, truth, operator, processes, lambda _: None)
    except SitlError as error:
        return processes, None, error
    return processes, killed_s, None


def value(command: list[str], option: str) -> str:
    assert command.count(option) == 1
    return command[command.index(option) + 1]


def at_once() -> bool:
    return True


@pytest.mark.parametrize("realtime", [True, False])
def test_bridge_and_module_are_started_and_ended(tmp_path: Path, realtime: bool) -> None:
    chosen = options(tmp_path, realtime=realtime, companion="127.0.0.1:7")
    processes, killed_s, error = flown_by(chosen, at_once)
    assert (killed_s, error, processes.stopped) == (None, None, 1)
    assert list(processes.commands) == ["bridge", "module"]
    bridge, module = processes.commands.values()
    assert value(module, "--link") == "udp:" + value(bridge, "--companion")
    assert (value(bridge, "--companion") == "127.0.0.1:7") == realtime
    assert "--mocap-server" not in module


def test_a_halls_poses_go_from_the_bridge_to_the_module(tmp_path: Path) -> None:
    processes, _, _ = flown_by(options(tmp_path, mocap=True), at_once)
    bridge, module = processes.commands.values()
    assert value(bridge, "--mocap-local") == value(module, "--mocap-server")


@pytest.mark.parametrize("is_of_machine", [True, False])
@pytest.mark.parametrize("realtime", [True, False])
def test_an_operator_who_gives_up_ends_all_with_a_hint_in_real_time_where_it_may_help(
    tmp_path: Path, realtime: bool, is_of_machine: bool
) -> None:
    def gives_up() -> bool:
        raise OperatorError("no answer", is_of_machine=is_of_machine)

    processes, _, error = flown_by(options(tmp_path, realtime=realtime), gives_up)
    assert processes.stopped == 1
    assert error is not None
    assert str(error).startswith("no answer\n")
    assert ("may be too busy for real time" in str(error)) == (realtime and is_of_machine)


class Running:
    """A process that ends when it is asked to, unless it hangs."""

    def __init__(self, name: str, done: list[str], *, hangs: bool = False) -> None:
        self.name, self.done, self.hangs = name, done, hangs
        self.returncode: int | None = None

    def poll(self) -> int | None:
        return self.returncode

    def send_signal(self, number: int) -> None:
        self.done.append(f"{self.name} is sent {number}")

    def kill(self) -> None:
        self.done.append(f"{self.name} is killed")
        self.hangs = False

    def wait(self, timeout: float = inf) -> None:
        if self.hangs:
            raise subprocess.TimeoutExpired(self.name, timeout)
        self.done.append(f"{self.name} is waited for")
        self.returncode = 0


def test_processes_are_ended_the_last_first_and_one_that_hangs_is_killed(tmp_path: Path) -> None:
    processes, done = SitlProcesses(tmp_path), list[str]()
    running = {name: Running(name, done) for name in ("bridge", "module", "page")}
    running["module"].hangs = True
    running["page"].returncode = 1
    processes._running.update(cast(Any, running))
    processes.stop()
    assert done == [
        "module is sent 15",
        "module is killed",
        "module is waited for",
        "bridge is sent 15",
        "bridge is waited for",
    ]
    processes.stop()
    assert len(done) == 5


# --- what was flown -------------------------------------------------------------------------------


def flight_of(
    chosen: SitlOptions,
    monkeypatch: pytest.MonkeyPatch,
    legs: Callable[[Operator], list[FlownLeg]],
    *,
    killed_s: float | None = None,
    bridge_says: str = "",
    module_says: str = "",
) -> tuple[SitlFlight, Operator]:
    """A flight whose truth is that the aircraft stands at x 0.5, z 1.2 m for 60 s."""
    operators: list[Operator] = []

    def flown(_options: object, truth: Path, operator: Operator, *_: object) -> float | None:
        operator.flown = legs(operator)
        operator.hiccups = ["first", "second"] if bridge_says else []
        operators.append(operator)
        rows = [f"{0.1 * i:.1f},0.5,1.2,0,0" for i in range(601)]
        truth.write_text("\n".join(["time_s,x_m,z_m,y_m,roll_rad", *rows]) + "\n")
        (chosen.out / "bridge.log").write_text(bridge_says)
        (chosen.out / "module.log").write_text(module_says)
        return killed_s

    monkeypatch.setattr(sitl, "_fly", flown)
    return fly(chosen, lambda _: None), operators[0]


def stood(operator: Operator, place: int, **changes: Any) -> FlownLeg:
    times = {"stopped_s": 10.0 + place, "ended_s": 30.0 + place}
    return FlownLeg(operator._legs[place], 1.0, **{**times, **changes})


def test_each_leg_is_scored_at_its_own_line_and_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One on the site's line; one on what a search has found; none of the survey."""
    chosen = options(tmp_path, legs=("a",), search=True, survey=True, seed=7, turbulence=0.02)
    found = {"TGL_X": 0.6, "TGL_Z": 1.1, "TGL_LEAN": 0.0}
    times = iter([100.0, 107.5])
    monkeypatch.setattr(sitl, "time", SimpleNamespace(monotonic=lambda: next(times)))
    flight, operator = flight_of(
        chosen,
        monkeypatch,
        lambda o: [stood(o, 0, found=found), stood(o, 1, by_hand=True), stood(o, 2)],
        killed_s=12.5,
        module_says="tgl_soar: no fence\ntgl_soar: ready: can be engaged\ntgl_soar: later\n",
    )
    assert [leg.name for leg in operator._legs] == ["search", "a", "survey"]
    assert [score.name for score in flight.scores] == ["search", "a"]
    assert [leg.leg.name for leg in flight.flown] == ["search", "a"]
    site = load_site(SITE)
    line = site.lines["a"]
    assert flight.lines[0] == pytest.approx((0.6, 1.1, 0.5 * 3.141592653589793))
    assert flight.lines[1][:2] == pytest.approx((line.x_m, line.z_m))
    place = flight.crossings[1]
    assert place is not None
    polar = load_flight(AIRFRAME, SITE)[0].polar.as_polar()
    wind = site_field(site).wind_at(place.x_m, 0.0, place.z_m, 0.0)
    sink = polar.c0 + polar.c1 * wind[0] + polar.c2 * wind[0] ** 2 + polar.c3 * wind[0] ** 3
    assert wind[2] == pytest.approx(sink, abs=0.01)
    assert (flight.killed_s, flight.wall_s) == (12.5, 7.5)
    assert flight.notes == (
        "the module: no fence",
        "search: still 0.5 m from its place: give a longer --stay",
        "search: a place claimed after 9.0 s, at x 0.60 m, z 1.10 m",
    )
    assert flight.truth["time_s"][-1] == 60.0

    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["seed"], summary["turbulence"]) == (7, 0.02)
    assert (summary["site"], summary["airframe"]) == ("tunnel.toml", "eclipson_c.toml")
    assert summary["killed_s"] == 12.5
    assert summary["passed"] == passed(flight)
    search, a = summary["legs"]
    assert search["line"] == pytest.approx(list(flight.lines[0]))
    assert (search["by_hand"], a["by_hand"]) == (False, True)
    assert (search["stood_s"], a["stood_s"]) == ([10.0, 30.0], [11.0, 31.0])
    assert a["predicted"] == pytest.approx([place.x_m, place.z_m])
    assert a["name"] == "a"


def went_home(operator: Operator, legs: list[FlownLeg]) -> list[FlownLeg]:
    operator._homeward_s = 40.0
    return legs


FELL = "time_s,x_m,z_m,y_m,roll_rad,flying,climb_mps"


@pytest.mark.parametrize(
    ("x_m", "climb_mps", "is_well"),
    [(-32.7, -0.7, True), (-38.1, -0.7, False), (-32.7, -1.6, False)],
)
def test_a_flight_that_ends_at_the_landing_place_is_as_good_as_its_landing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, x_m: float, climb_mps: float, is_well: bool
) -> None:
    """The leg from which it broke off was over too early to be held; the place is at x -28 m."""
    chosen = options(tmp_path, site=shipped("sites/hill.toml"), legs=("a",))

    def flown(_options: object, truth: Path, operator: Operator, *_: object) -> None:
        leg = stood(operator, 0, broken_off=True, found={"TGL_X": 9, "TGL_Z": 1, "TGL_LEAN": 0})
        operator.flown = went_home(operator, [leg])
        rows = [f"{0.1 * i:.1f},0.5,1.2,0,0,1,{climb_mps}" for i in range(500)]
        rows += [f"{0.1 * i:.1f},{x_m},0,0.4,0,0,0" for i in range(500, 520)]
        truth.write_text("\n".join([FELL, *rows]) + "\n")
        (chosen.out / "bridge.log").write_text("")

    monkeypatch.setattr(sitl, "_fly", flown)
    flight = fly(chosen, lambda _: None)
    assert flight.landing is not None
    assert flight.landing.along_m == pytest.approx(-28.0 - x_m)
    assert (flight.landing.is_well, passed(flight)) == (is_well, is_well)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["landing"]["sink_mps"] == -climb_mps
    assert (summary["landing"]["well"], summary["passed"]) == (is_well, is_well)
    assert summary["legs"][0]["broken_off"]


@pytest.mark.parametrize("how", [{"broken_off": True, "stopped_s": nan}, {"broken_off": False}])
def test_a_search_that_was_over_before_it_found_a_line_has_no_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: dict[str, Any]
) -> None:
    """It broke off, or gave up and the module has disengaged."""
    flight, _ = flight_of(
        options(tmp_path, search=True), monkeypatch, lambda o: [stood(o, 0, **how)]
    )
    assert flight.scores == []


def test_what_is_no_number_is_null_in_the_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Never settled, and nowhere to settle: JSON has neither Infinity nor NaN."""
    far = {"TGL_X": 9.0, "TGL_Z": 1.1, "TGL_LEAN": 0.0}
    flight_of(options(tmp_path, legs=("a",)), monkeypatch, lambda o: [stood(o, 0, found=far)])

    def refused(word: str) -> None:
        raise AssertionError(word)

    text = (tmp_path / "summary.json").read_text()
    (leg,) = json.loads(text, parse_constant=refused)["legs"]
    assert (leg["settling_s"], leg["crossing_m"], leg["predicted"]) == (None, None, None)


@pytest.mark.parametrize("by_hand", [True, False])
def test_a_leg_that_never_settles_fails_unless_another_operator_has_moved_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_hand: bool
) -> None:
    far = {"TGL_X": 9.0, "TGL_Z": 1.1, "TGL_LEAN": 0.0}
    here = {"TGL_X": 0.5, "TGL_Z": 1.2, "TGL_LEAN": 0.0}
    flight, _ = flight_of(
        options(tmp_path, legs=("a", "b")),
        monkeypatch,
        lambda o: [stood(o, 0, found=here), stood(o, 1, found=far, by_hand=by_hand)],
    )
    assert [score.settled for score in flight.scores] == [True, False]
    assert passed(flight) == by_hand


def test_a_leg_on_which_the_module_disengaged_is_not_passed_though_it_had_settled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = {"TGL_X": 0.5, "TGL_Z": 1.2, "TGL_LEAN": 0.0}
    for released in ("", "too low"):
        flight, _ = flight_of(
            options(tmp_path / released, legs=("a",)),
            monkeypatch,
            lambda o, why=released: [stood(o, 0, found=here, released=why)],  # type: ignore[misc]
        )
        assert flight.scores[0].settled
        assert passed(flight) == (not released)


def test_what_the_machine_has_interrupted_is_noted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    says = "begins\nthis machine is too slow for real time: 0.1 s\nends\n"
    assert TOO_SLOW in says
    flight, _ = flight_of(
        options(tmp_path, legs=("a",)), monkeypatch, lambda o: [stood(o, 0)], bridge_says=says
    )
    again = "engaged again after a hiccup of this machine: "
    assert flight.notes[:3] == (f"{again}first", f"{again}second", says.splitlines()[1])


@pytest.mark.parametrize(
    ("changes", "again"),
    [
        ({}, 0),
        ({"realtime": True}, 3),
        ({"realtime": True, "faults": ("position.dropout start=2 for=1",)}, 0),
        ({"realtime": True, "kill_s": 1.0}, 0),
    ],
)
def test_only_real_time_without_faults_is_flown_again_after_a_hiccup(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], again: int
) -> None:
    site = shipped("sites/hill.toml")
    chosen = options(tmp_path, site=site, legs=("a",), watch_s=4.0, goes_home=True, **changes)
    _, operator = flight_of(chosen, monkeypatch, lambda o: [stood(o, 0)])
    assert operator._again == again
    assert (operator._when_armed, operator._watch_s, operator._goes_home) == (False, 4.0, True)
    autopilot = load_flight(AIRFRAME, SITE)[0].autopilot
    assert operator._target == (autopilot.system_id, autopilot.component_id)


def test_a_firmware_is_engaged_once_it_is_armed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = options(tmp_path, legs=("a",), autopilot="px4", firmware=tmp_path / "px4")
    _, operator = flight_of(chosen, monkeypatch, lambda o: [stood(o, 0)])
    assert operator._when_armed
    assert (tmp_path / "flown" / "eclipson_c.toml").exists()
    assert (tmp_path / "flown" / "tunnel.toml").exists()


# --- the plan -------------------------------------------------------------------------------------


def test_a_survey_begins_on_the_last_line_and_may_last_three_minutes(tmp_path: Path) -> None:
    site, values = load_site(SITE), load_flight(AIRFRAME, SITE)[2]
    *_, last, survey = plan(site, values, options(tmp_path, legs=("a", "b"), survey=True))
    assert survey.parameters == {**last.parameters, "SRV_START": 1.0}
    assert (last.name, survey.name, survey.stay_s) == ("b", "survey", 180.0)
    assert (last.surveys, survey.surveys, survey.searches) == (False, True, False)
    with pytest.raises(SitlError, match="a survey begins on a line: name one by --legs"):
        plan(site, values, options(tmp_path, search=True, survey=True))


def test_a_search_is_asked_for_with_the_settings_of_all_legs(tmp_path: Path) -> None:
    site, values = load_site(SITE), load_flight(AIRFRAME, SITE)[2]
    chosen = options(tmp_path, search=True, settings=(("TGL_HOLD", 1.0),), stay_s=5.0)
    (search,) = plan(site, values, chosen)
    assert search.parameters == {"TGL_HOLD": 1.0, "SRCH_START": 1.0}
    assert (search.stay_s, search.searches, search.surveys) == (5.0, True, False)
    every = plan(site, values, options(tmp_path, stay_s=5.0))
    assert [leg.name for leg in every] == list(site.lines)
    assert {leg.stay_s for leg in every} == {5.0}
    assert every[0].parameters["TGL_LEAN"] == values["TGL_LEAN"]


def test_how_long_a_flight_waits_for_whom() -> None:
    assert (sitl.START_S, sitl.SILENCE_S, sitl.SURVEY_S) == (120.0, 20.0, 180.0)
    assert (sitl.AGAIN, sitl.STOOD_S) == (3, 2.0)
    assert isnan(FlownLeg(cast(Any, None), 1.0).stopped_s)
    assert FlownLeg(cast(Any, None), 1.0).moved_s == -inf


def test_what_is_flown_unless_it_is_chosen_otherwise(tmp_path: Path) -> None:
    """All lines for 16 s each, in lockstep, with the simulated autopilot and nothing wrong."""
    plain = options(tmp_path)
    assert (plain.legs, plain.stay_s, plain.settings, plain.seed) == ((), 16.0, (), 1)
    assert plain.pitot
    chosen = (plain.realtime, plain.mocap, plain.search, plain.survey, plain.goes_home)
    assert chosen == (False,) * 5
    assert (plain.faults, plain.mocap_options, plain.autopilot_parameters) == ((), (), ())
    assert (plain.autopilot, plain.receiver) == ("builtin", "local")
    nothing = (plain.model, plain.turbulence, plain.firmware, plain.route, plain.kill_s)
    assert nothing == (None,) * 5
    assert (plain.mission, plain.watch_s) == (None, None)
    addresses = (plain.gcs, plain.gcs_local, plain.companion)
    assert addresses == ("127.0.0.1:14550", "127.0.0.1:18570", "127.0.0.1:14540")
