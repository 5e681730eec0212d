"""The switch of the search, tick by tick: what it reports, how late an answer may be, how it ends.

Ticks, parameters and the engine are as a test writes them down: nothing flies.
"""

from __future__ import annotations

from math import cos, hypot, nan, sin
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.autopilot import Output, initial_state, step
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control import supervisor as modes
from tgl_soar.control.forecast import SEARCH_FIRST, SETTLES
from tgl_soar.control.laws import (
    SEARCH_GIVEN_UP,
    SEARCH_LOOKS,
    SEARCH_NONE,
    SEARCH_OFF,
    SEARCH_SOARS,
    laws_from,
)
from tgl_soar.control.search import glimpse as g
from tgl_soar.control.target_line import TargetLine
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard import search_switch
from tgl_soar.onboard.search_switch import SearchSwitch
from tgl_soar.types import NO_ATTITUDE, NO_FIX, AutopilotStatus, Inputs

Switch: Any = SearchSwitch
LAWS = laws_from(ParameterSet(), SoaringFrame(0.0, 0.0, 0.0, 0.0))
_, IDLE = step(
    LAWS,
    initial_state(),
    Inputs(
        time_s=1.0,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False),
        engage=False,
    ),
)
POLAR = SimpleNamespace(polar=SimpleNamespace(c0=1.0))
LINE = TargetLine(3.0, 4.0, 1.8)


class Engine:
    """Says what a test lets it say."""

    def __init__(self) -> None:
        self.tasks: list[Any] = []
        self.sent: list[Any] = []
        self.room = self.begins = True
        self.failure = ""
        self.answer: g.LineRequest | None = None

    def begin(self, task: Any) -> bool:
        self.tasks.append(task)
        return self.begins

    def send(self, glimpse: Any) -> bool:
        self.sent.append(glimpse)
        return self.room

    def receive(self) -> g.LineRequest | None:
        answer, self.answer = self.answer, None
        return answer


class Bench:
    """A switch between parameters, an operator and an engine."""

    def __init__(self, patch: pytest.MonkeyPatch, engine: Engine | None = None) -> None:
        self.values = {"SRCH_START": SEARCH_OFF, "FC_ACT": 0.0, "CLEAR_MIN": 1.0}
        self.values |= {"TGL_LEAN_MIN": 5.0, "TGL_LEAN_MAX": 45.0}
        self.laws: Any = SimpleNamespace(
            wind=SimpleNamespace(aerodynamics=POLAR), throttle=LAWS.throttle
        )
        self.texts: list[tuple[int, str]] = []
        self.engine = engine or Engine()
        self.moved: list[TargetLine] = []
        self.may_move = True
        self.fence = ""
        patch.setattr(search_switch, "bounds_of", lambda *_: None)
        patch.setattr(search_switch, "open_fence", lambda _: self.fence)
        patch.setattr(search_switch, "is_moved", self._is_moved)
        patch.setattr(search_switch, "task_of", lambda _: g.task_of(LAWS))
        self.switch = Switch(None, self, self, self.engine)
        self.now_s = 100.0

    def _is_moved(self, _settings: Any, _bounds: Any, line: TargetLine) -> bool:
        self.moved.append(line)
        return self.may_move

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value

    def tell(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    def tick(
        self,
        after_s: float = 0.005,
        mode: int = modes.SEARCHING,
        *,
        active: bool = True,
        air: tuple[float, float] = (9.0, 1.0),
        pushed: float = 0.0,
        **changes: Any,
    ) -> None:
        self.now_s += after_s
        output: Output = IDLE._replace(
            time_s=self.now_s,
            mode=mode,
            active=active,
            vehicle=IDLE.vehicle._replace(time_s=self.now_s, climb_mps=-0.1),
            air=IDLE.air._replace(wind_mps=air[0], updraft_mps=air[1], airspeed_mps=9.0),
            throttle=IDLE.throttle._replace(climb_mps=pushed, used_s=0.0),
        )
        self.switch.tick(output._replace(**changes))

    def searches(self) -> Bench:
        """A search that was asked once, in this tick."""
        self.values["SRCH_START"] = SEARCH_LOOKS
        self.tick()
        self.tick(0.2)
        self.texts.clear()
        return self

    def says(self, **changes: Any) -> None:
        """An answer to the last glimpse."""
        last = [each for each in self.engine.sent if each is not None][-1]
        answer = g.LineRequest(
            target=LINE,
            status=g.LOOKING,
            reason=g.NO_REASON,
            place_x_m=nan,
            place_z_m=nan,
            over_ground_m=4.26,
            time_s=last.now.time_s,
            search=last.search,
        )
        self.engine.answer = answer._replace(**changes)

    @property
    def standing(self) -> float:
        return self.values["SRCH_START"]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


# --- glimpses -----------------------------------------------------------------------------------


def test_a_glimpse_has_the_means_since_the_one_before(bench: Bench) -> None:
    bench.tick()
    for wind, updraft, pushed, after_s in (
        *((8.0, 1.0, 0.0, 0.05), (9.0, 2.0, 0.3, 0.05), (10.0, 0.0, 0.6, 0.05)),
        *((9.0, 3.0, 0.3, 0.05),),
    ):
        assert bench.engine.sent == []
        bench.tick(after_s, air=(wind, updraft), pushed=pushed)
    (now,) = bench.engine.sent
    assert (now.wind_mps, now.updraft_mps) == pytest.approx((9.0, 1.5))
    assert now.pushed_mps == pytest.approx(0.3)
    assert now.now.time_s - now.before.time_s == pytest.approx(0.2)
    assert (now.seeks, now.refused, now.search) == (False, None, 0)
    # The next one begins from nothing.
    bench.tick(0.2, air=(5.0, -1.0))
    assert bench.engine.sent[1][3:5] == (5.0, -1.0)
    assert bench.engine.sent[1].before == now.now


@pytest.mark.parametrize(("after_s", "due"), [(0.199, False), (0.2, True), (-0.01, True)])
def test_a_glimpse_is_due_after_two_tenths_or_with_another_clock(
    bench: Bench, after_s: float, due: bool
) -> None:
    bench.tick()
    bench.tick(after_s)
    assert len(bench.engine.sent) == int(due)


@pytest.mark.parametrize("mode", [modes.HOLDING, modes.RECOVERING, modes.LAUNCHING])
def test_without_a_place_or_in_a_hand_nothing_is_looked_at(bench: Bench, mode: int) -> None:
    bench.tick()
    bench.tick(0.2, mode)
    bench.tick(0.2)  # the first of the next two
    assert bench.engine.sent == []
    bench.tick(0.2)
    assert len(bench.engine.sent) == 1


def test_the_engine_is_sent_its_task_once_and_again_where_it_had_no_room(bench: Bench) -> None:
    bench.engine.begins = False
    for _ in range(3):
        bench.tick(0.2)
    assert (len(bench.engine.tasks), bench.engine.sent) == (2, [])
    bench.engine.begins = True
    for _ in range(3):
        bench.tick(0.2)
    assert (len(bench.engine.tasks), len(bench.engine.sent)) == (3, 3)
    assert bench.engine.tasks[0].eta_min_rad == pytest.approx(1.5708 + 0.0873, abs=1e-3)
    assert bench.engine.tasks[0].eta_max_rad == pytest.approx(1.5708 + 0.7854, abs=1e-3)
    bench.laws = SimpleNamespace(wind=bench.laws.wind, throttle=bench.laws.throttle)
    bench.tick(0.2)  # other laws with the same task
    assert len(bench.engine.tasks) == 3
    bench.values["TGL_LEAN_MIN"] = 6.0
    bench.laws = SimpleNamespace(wind=bench.laws.wind, throttle=bench.laws.throttle)
    bench.tick(0.2)
    assert len(bench.engine.tasks) == 4


def test_without_an_engine_it_does_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch)
    bench.switch = Switch(None, bench, bench, None)
    bench.values["SRCH_START"] = SEARCH_LOOKS
    for _ in range(5):
        bench.tick(1.0)
    assert bench.texts == []
    bench.tick(0.2, active=False)
    assert bench.switch.refusal() == "there is no search in this process"


# --- answers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "shown"), [(g.LOOKING, SEARCH_LOOKS), (g.SOARING, SEARCH_SOARS)]
)
def test_a_line_that_is_asked_for_is_flown_once(bench: Bench, status: int, shown: int) -> None:
    bench.searches().says(status=status)
    bench.tick()
    assert bench.moved == [LINE]
    assert bench.standing == shown
    bench.says(status=status)
    bench.tick()
    assert len(bench.moved) == 1  # it is there already
    bench.says(status=status, target=LINE._replace(x_m=3.5))
    bench.tick()
    assert len(bench.moved) == 2
    assert bench.texts == []


def test_the_line_s_point_is_where_the_aircraft_is_to_settle(bench: Bench) -> None:
    """The foot of the perpendicular from the place; where that is refused, the line's own."""
    bench.may_move = False
    bench.searches().says(place_x_m=5.0, place_z_m=2.0)
    bench.tick()
    foot, own = bench.moved
    assert own == LINE
    assert foot.eta_rad == LINE.eta_rad
    along = (cos(LINE.eta_rad), sin(LINE.eta_rad))
    way = (5.0 - LINE.x_m) * along[0] + (2.0 - LINE.z_m) * along[1]
    assert (foot.x_m, foot.z_m) == pytest.approx(
        (LINE.x_m + way * along[0], LINE.z_m + way * along[1])
    )
    assert hypot(foot.x_m - 5.0, foot.z_m - 2.0) > 0.5
    # The refusal is in the next glimpse, and in that one alone.
    bench.tick(0.2)
    bench.tick(0.2)
    assert [each.refused for each in bench.engine.sent[-2:]] == [LINE, None]


def test_a_refusal_that_found_no_room_is_reported_again(bench: Bench) -> None:
    bench.may_move = False
    bench.searches().says()
    bench.tick()
    bench.engine.room = False
    bench.tick(0.2)
    bench.engine.room = True
    bench.tick(0.2)
    bench.tick(0.2)
    assert [each.refused for each in bench.engine.sent[-3:]] == [LINE, LINE, None]


def test_given_up_it_says_why_and_how_high(bench: Bench) -> None:
    bench.searches().says(status=g.GIVEN_UP, reason=g.TOO_LOW)
    bench.tick()
    assert bench.standing == SEARCH_GIVEN_UP
    assert bench.texts == [(SEVERITY_WARNING, f"search: {g.REASONS[2]}; 4.3 m over the ground")]
    assert bench.moved == []


@pytest.mark.parametrize(
    ("changes", "obeyed"),
    [({}, True), ({"search": 0}, False), ({"search": 2}, False), ({"time_s": nan}, False)],
)
def test_an_answer_is_of_this_search(bench: Bench, changes: dict[str, Any], obeyed: bool) -> None:
    bench.searches().says(**changes)
    bench.tick()
    assert (bench.moved != []) == obeyed


@pytest.mark.parametrize(
    ("age_s", "obeyed"), [(2.99, True), (3.01, False), (-0.01, False), (0.0, True)]
)
def test_an_answer_is_of_a_glimpse_of_three_seconds_ago_at_most(
    bench: Bench, age_s: float, obeyed: bool
) -> None:
    bench.searches()
    bench.says(time_s=bench.now_s + 0.005 - age_s)
    bench.tick(0.005)
    assert (bench.moved != []) == obeyed


@pytest.mark.parametrize(("silent_s", "ends"), [(2.99, False), (3.01, True)])
@pytest.mark.parametrize("answered", [False, True])
def test_three_seconds_without_an_answer_end_it(
    bench: Bench, silent_s: float, ends: bool, answered: bool
) -> None:
    bench.values["SRCH_START"] = SEARCH_LOOKS
    bench.tick()
    began_s = bench.now_s
    if answered:
        bench.tick(0.2)
        bench.says()
        bench.tick(0.01)
        began_s = bench.now_s - 0.01  # the glimpse's own time
    bench.tick(began_s + silent_s - bench.now_s)
    assert (bench.standing == SEARCH_OFF) == ends
    assert bench.texts == ([(SEVERITY_ERROR, "search ended: no answer for 3 s")] if ends else [])


def test_an_old_answer_does_not_make_a_new_one_older(bench: Bench) -> None:
    bench.searches()
    bench.says(time_s=bench.now_s - 2.0)
    bench.tick(0.5)
    bench.tick(2.0)  # 2.7 s after it was asked first
    assert bench.standing == SEARCH_LOOKS


@pytest.mark.parametrize("mode", [modes.HOLDING, modes.RECOVERING])
def test_nobody_is_late_who_is_not_asked(bench: Bench, mode: int) -> None:
    bench.searches()
    for _ in range(5):
        bench.tick(2.0, mode)
    assert bench.standing == SEARCH_LOOKS
    bench.tick(2.99)
    assert bench.standing == SEARCH_LOOKS
    bench.tick(0.02)
    assert bench.standing == SEARCH_OFF


# --- ends ---------------------------------------------------------------------------------------


def test_an_engine_that_fails_or_a_guard_that_is_taken_away_ends_it(bench: Bench) -> None:
    bench.searches()
    bench.engine.failure = "it has died"
    bench.tick()
    assert bench.texts == [(SEVERITY_ERROR, "search ended: it has died")]
    assert bench.standing == SEARCH_OFF
    bench.engine.failure = ""
    bench.searches()
    bench.fence = "open"
    bench.tick()
    assert bench.texts == [(SEVERITY_ERROR, "search ended: open")]
    assert bench.standing == SEARCH_OFF


def test_an_engine_that_fails_while_it_is_asked_ends_it(bench: Bench) -> None:
    bench.searches()

    def dies() -> None:
        bench.engine.failure = "it has died"

    bench.engine.receive = dies  # type: ignore[method-assign]
    bench.tick()
    assert bench.texts == [(SEVERITY_ERROR, "search ended: it has died")]
    assert bench.standing == SEARCH_OFF


def test_what_carries_it_is_asked_for_the_sink_of_now_and_for_no_climb(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[float, ...]] = []

    def can_hold(_: Any, used_s: float, climb_mps: float, airspeed_mps: float) -> bool:
        asked.append((used_s, climb_mps, airspeed_mps))
        return True

    monkeypatch.setattr(search_switch, "can_hold", can_hold)
    bench.tick()
    bench.tick(0.2)
    for climb_mps in (-0.4, 0.3):
        bench.tick(0.2, vehicle=IDLE.vehicle._replace(time_s=bench.now_s, climb_mps=climb_mps))
    assert asked == [(0.0, -0.1, 9.0), (0.0, -0.4, 9.0), (0.0, 0.0, 9.0)]
    assert bench.engine.sent[-1].carried


def test_what_a_search_needs(bench: Bench) -> None:
    assert bench.switch.refusal() == ""
    bench.fence = "open"
    assert bench.switch.refusal() == "open"
    bench.values["CLEAR_MIN"] = 0.0
    assert bench.switch.refusal().startswith("CLEAR_MIN is 0")
    bench.laws = SimpleNamespace(
        wind=SimpleNamespace(aerodynamics=SimpleNamespace(polar=SimpleNamespace(c0=nan)))
    )
    assert "no [polar]" in bench.switch.refusal()
    bench.engine.failure = "it has died"
    assert bench.switch.refusal() == "it has died"
    bench.tick(mode=modes.LANDING)
    assert bench.switch.refusal().startswith("it goes home")


def test_the_operators_line_is_theirs(bench: Bench) -> None:
    bench.switch.taken_back()
    assert bench.texts == []
    bench.searches()
    bench.switch.taken_back()
    assert bench.texts == [(SEVERITY_INFO, "search ended: the line was set by hand")]
    assert bench.standing == SEARCH_OFF
    bench.switch.taken_back()
    assert len(bench.texts) == 1


@pytest.mark.parametrize(
    ("mode", "where"),
    [
        (modes.BREAKING_OFF, "goes home"),
        (modes.LANDING, "goes home"),
        (modes.BEATING, "beats along the ridge"),
    ],
)
@pytest.mark.parametrize("standing", [SEARCH_LOOKS, SEARCH_SOARS, SEARCH_GIVEN_UP, SEARCH_OFF])
def test_without_a_line_it_is_over_and_reported_where_it_was_under_way(
    bench: Bench, mode: int, where: str, standing: int
) -> None:
    bench.searches()
    bench.values["SRCH_START"] = standing
    bench.tick(0.005, mode)
    assert bench.standing == SEARCH_OFF
    under_way = standing in (SEARCH_LOOKS, SEARCH_SOARS)
    assert bench.texts == ([(SEVERITY_INFO, f"search ended: it {where}")] if under_way else [])
    assert bench.switch.refusal().startswith(f"it {where}")
    # What was asked before is not obeyed after it.
    bench.says()
    bench.values["SRCH_START"] = SEARCH_LOOKS
    bench.tick()
    assert bench.moved == []


def test_with_the_flight_all_is_over_and_the_engine_is_notified_until_it_knows(
    bench: Bench,
) -> None:
    bench.searches()
    sent = len(bench.engine.sent)
    bench.engine.room = False
    for _ in range(3):
        bench.tick(0.005, active=False)
    assert bench.engine.sent[sent:] == [None, None, None]
    bench.engine.room = True
    for _ in range(3):
        bench.tick(0.005, active=False)
    assert bench.engine.sent[sent:] == [None] * 4
    assert bench.standing == SEARCH_OFF
    assert bench.texts == []
    # The next flight's search is another one.
    bench.searches()
    assert bench.engine.sent[-1].search > 1
    assert len(bench.engine.tasks) == 2


def test_an_end_that_found_no_room_is_sent_before_the_next_flight_is_looked_at(
    bench: Bench,
) -> None:
    bench.searches()
    bench.engine.room = False
    bench.tick(0.005, active=False)
    sent = len(bench.engine.sent)
    bench.tick(0.2)
    bench.tick(0.2)
    assert bench.engine.sent[sent:] == [None]
    bench.engine.room = True
    bench.tick(0.2)
    assert bench.engine.sent[sent + 1] is None
    assert bench.engine.sent[sent + 2] is not None


# --- by itself ----------------------------------------------------------------------------------


def foreseen(standing: int) -> dict[str, Any]:
    return {"forecast": IDLE.forecast._replace(standing=standing)}


@pytest.mark.parametrize(
    ("act", "standing", "begins"),
    [
        (SEARCH_FIRST, SETTLES + 1, True),
        (SEARCH_FIRST, SETTLES, False),
        (SEARCH_FIRST - 1, SETTLES + 1, False),
        (SEARCH_FIRST + 1, SETTLES + 1, False),
    ],
)
def test_it_begins_by_itself_where_no_place_is_foreseen(
    bench: Bench, act: float, standing: int, begins: bool
) -> None:
    bench.values["FC_ACT"] = act
    bench.tick(mode=modes.SOARING, **foreseen(standing))
    assert (bench.standing == SEARCH_LOOKS) == begins
    words = (SEVERITY_WARNING, "no place to settle is foreseen: searching")
    assert bench.texts == ([words] if begins else [])


def test_once_in_a_flight_and_after_that_fc_act_4_acts_as_2(bench: Bench) -> None:
    bench.values["FC_ACT"] = SEARCH_FIRST
    bench.tick(mode=modes.SOARING, **foreseen(SETTLES + 1))
    bench.switch.taken_back()
    bench.texts.clear()
    for _ in range(3):
        bench.tick(mode=modes.SOARING, **foreseen(SETTLES + 1))
    assert bench.standing == SEARCH_NONE
    assert bench.texts == [(SEVERITY_WARNING, "FC_ACT 4 acts as 2: its search is over")]
    bench.tick(active=False)
    assert bench.standing == SEARCH_OFF
    bench.tick(mode=modes.SOARING, **foreseen(SETTLES + 1))  # another flight
    assert bench.standing == SEARCH_LOOKS


def test_where_it_cannot_begin_that_is_shown_and_where_it_can_again_that_too(bench: Bench) -> None:
    bench.values["FC_ACT"] = SEARCH_FIRST
    bench.fence = "open"
    bench.tick(mode=modes.SOARING)
    assert bench.standing == SEARCH_NONE
    assert bench.texts == [(SEVERITY_WARNING, "FC_ACT 4 acts as 2: open")]
    bench.fence = ""
    bench.tick(mode=modes.SOARING)
    assert bench.standing == SEARCH_OFF
    bench.fence = "open"
    bench.values["FC_ACT"] = 2.0
    bench.tick(mode=modes.SOARING)
    assert bench.standing == SEARCH_OFF
    bench.values["SRCH_START"] = SEARCH_GIVEN_UP  # which is not overwritten
    bench.values["FC_ACT"] = SEARCH_FIRST
    bench.tick(mode=modes.SOARING)
    assert bench.standing == SEARCH_GIVEN_UP
    assert len(bench.texts) == 1


def test_on_the_ground_setting_fc_act_4_says_what_it_lacks(bench: Bench) -> None:
    bench.fence = "open"
    bench.switch.act_was_set()
    assert bench.texts == []
    bench.values["FC_ACT"] = SEARCH_FIRST
    bench.switch.act_was_set()
    assert bench.texts == [(SEVERITY_WARNING, "FC_ACT 4 acts as 2: open")]
    bench.fence = ""
    bench.switch.act_was_set()
    bench.fence = "open"
    bench.tick()  # in control the next tick takes it
    bench.texts.clear()
    bench.switch.act_was_set()
    assert bench.texts == []
