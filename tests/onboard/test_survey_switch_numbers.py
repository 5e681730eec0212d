"""The switch of the survey, tick by tick: when it looks, what it says, and where the line stays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from test_search_switch_numbers import IDLE, POLAR

from tgl_soar.control import supervisor as modes
from tgl_soar.control import survey
from tgl_soar.control.survey import SurveyState
from tgl_soar.control.target_line import TargetLine
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard import survey_switch
from tgl_soar.onboard.survey_switch import SurveySwitch, look_of

Switch: Any = SurveySwitch
START = TargetLine(1.0, 2.0, 1.8)


class Bench:
    """Parameters, an operator, and a law with the test's output."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.values = {"SRV_START": 1.0, "SRCH_START": 0.0, "TGL_HOLD": 0.0}
        self.values |= {"FC_ACT": 1.0, "CLEAR_MIN": 1.0}
        self.laws: Any = SimpleNamespace(
            wind=SimpleNamespace(aerodynamics=POLAR), line=SimpleNamespace(speed_mps=0.123)
        )
        self.texts: list[tuple[int, str]] = []
        self.moved: list[TargetLine] = []
        self.allowed: set[TargetLine] | None = None  # None: all
        self.fence = ""
        self.looks = 0
        self.changes: dict[str, Any] = {}  # of the state, by the next look
        patch.setattr(survey_switch, "bounds_of", lambda *_: None)
        patch.setattr(survey_switch, "open_fence", lambda _: self.fence)
        patch.setattr(survey_switch, "is_moved", self._is_moved)
        patch.setattr(survey_switch, "survey_task", lambda _: None)
        patch.setattr(survey_switch, "survey_moved", self._looked)
        patch.setattr(survey_switch, "survey_place", lambda _: (4.444, 5.555))
        self.switch = Switch(None, self, self)
        self.now_s = 100.0

    def _is_moved(self, _settings: Any, _bounds: Any, line: TargetLine) -> bool:
        self.moved.append(line)
        return self.allowed is None or line in self.allowed

    def _looked(self, _task: Any, state: SurveyState, look: Any, _move: Any) -> SurveyState:
        self.looks += 1
        return state._replace(time_s=look.time_s, **self.changes)

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value

    def tell(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    def tick(
        self, after_s: float = 0.2, mode: int = modes.SOARING, *, active: bool = True, **line: Any
    ) -> None:
        self.now_s += after_s
        vehicle = IDLE.vehicle._replace(time_s=self.now_s)
        place = {"x_m": START.x_m, "z_m": START.z_m, "eta_rad": START.eta_rad, "moving": False}
        self.switch.tick(
            IDLE._replace(
                time_s=self.now_s,
                vehicle=vehicle,
                mode=mode,
                active=active,
                line=IDLE.line._replace(**(place | line)),
            )
        )

    def surveys(self) -> Bench:
        self.tick()
        self.texts.clear()
        return self

    @property
    def standing(self) -> float:
        return self.values["SRV_START"]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


# --- what may be set ----------------------------------------------------------------------------


def test_what_a_survey_needs_is_asked_in_this_order(bench: Bench) -> None:
    bench.values["SRV_START"] = 0.0
    refusal = bench.switch.refusal
    assert refusal(1.0) == "it does not soar on a line that stands still"  # no tick yet
    bench.tick()
    assert refusal(1.0) == ""
    bench.tick(moving=True)
    assert "stands still" in refusal(1.0)
    bench.tick(mode=modes.CAPTURING)
    assert "stands still" in refusal(1.0)
    bench.tick()
    bench.fence = "the fence is open"
    assert refusal(1.0) == "the fence is open"
    bench.values["CLEAR_MIN"] = 0.0
    assert refusal(1.0).startswith("CLEAR_MIN is 0")
    bench.values["FC_ACT"] = 0.0
    assert refusal(1.0).startswith("the forecast is off")
    none = SimpleNamespace(aerodynamics=SimpleNamespace(polar=SimpleNamespace(c0=float("nan"))))
    bench.laws = SimpleNamespace(wind=none, line=bench.laws.line)
    assert "no [polar]" in refusal(1.0)
    bench.values["TGL_HOLD"] = 1.0
    assert refusal(1.0).startswith("a point of the line is held")
    for search, blocks in ((1.0, True), (2.0, True), (3.0, True), (4.0, False), (0.0, False)):
        bench.values["SRCH_START"] = search
        assert refusal(1.0).startswith("a search has the line") == blocks
    for value in (2.0, 3.0, -1.0):
        assert refusal(value).startswith("set 1 to survey")
    assert refusal(0.0) == ""


def test_one_at_a_time(bench: Bench) -> None:
    bench.surveys()
    assert bench.switch.refusal(1.0) == "a survey is under way"
    assert bench.switch.refusal(0.0) == ""


# --- looks --------------------------------------------------------------------------------------


def test_it_begins_with_the_speed_of_its_line(bench: Bench) -> None:
    bench.tick()
    assert bench.texts == [(SEVERITY_INFO, "survey: downstream at 0.12 m/s")]
    assert bench.looks == 0


@pytest.mark.parametrize(
    ("after_s", "looks"), [(survey.LOOK_S - 0.001, 0), (survey.LOOK_S, 1), (-0.01, 1)]
)
def test_it_looks_at_its_interval_and_at_once_with_another_clock(
    bench: Bench, after_s: float, looks: int
) -> None:
    bench.surveys().tick(after_s)
    assert bench.looks == looks


@pytest.mark.parametrize(
    ("mode", "held"), [(modes.CAPTURING, True), (modes.SOARING, True), (modes.HOLDING, False)]
)
def test_a_look_is_what_a_tick_knows(mode: int, held: bool) -> None:
    vehicle = IDLE.vehicle._replace(time_s=7.0, x_m=1.0, z_m=2.0, climb_mps=3.0)
    air, margins = IDLE.air._replace(airspeed_mps=9.0), IDLE.margins._replace(stall_rad=0.1)
    output = IDLE._replace(mode=mode, vehicle=vehicle, air=air, margins=margins)
    look = look_of(output)
    assert look[:6] == (7.0, 1.0, 2.0, 3.0, 9.0, 0.1)
    assert (look.line, look.forecast, look.held) == (output.line, output.forecast, held)


def test_without_one_nothing_is_looked_at(bench: Bench) -> None:
    bench.values["SRV_START"] = 0.0
    for _ in range(3):
        bench.tick()
    bench.tick(active=False)
    assert (bench.looks, bench.texts, bench.moved) == (0, [], [])


# --- words of its way ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("standing", "way"), [(survey.UPSTREAM, "upstream"), (survey.HOMEWARD, "home")]
)
@pytest.mark.parametrize(
    ("reason", "severity"),
    [(survey.AT_FENCE, SEVERITY_INFO), (survey.REACHED, SEVERITY_INFO),
     (survey.DRIFTS, SEVERITY_WARNING), (survey.OFF_LINE, SEVERITY_WARNING)],
)  # fmt: skip
def test_a_turn_is_reported_and_shown(
    bench: Bench, standing: int, way: str, reason: int, severity: int
) -> None:
    bench.surveys()
    bench.changes = {"standing": standing, "reason": reason}
    bench.tick()
    why = survey.SURVEY_TEXTS[reason]
    assert bench.texts == [(severity, f"survey: {way} from x 4.44, z 5.55 m: {why}")]
    assert bench.standing == standing
    bench.tick()
    assert len(bench.texts) == 1


def test_every_fifteen_seconds_it_says_where_it_is(bench: Bench) -> None:
    bench.surveys()
    bench.tick(14.9)
    assert bench.texts == []
    bench.tick(0.2)
    assert bench.texts == [(SEVERITY_INFO, "survey: downstream, x 4.44, z 5.55 m")]
    bench.tick(14.7)
    assert len(bench.texts) == 1
    bench.changes = {"standing": survey.UPSTREAM}
    bench.tick(0.2)  # a turn says it too, and the time counts from there
    assert len(bench.texts) == 2
    bench.tick(14.9)
    assert len(bench.texts) == 2
    bench.tick(0.2)
    assert bench.texts[2][1].startswith("survey: upstream, ")
    bench.tick(-100.0)  # another clock
    assert len(bench.texts) == 4


# --- ends ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reason", "severity", "words"),
    [
        (survey.REACHED, SEVERITY_INFO, "survey: done"),
        (survey.DRIFTS, SEVERITY_WARNING, "survey ended: it climbs or sinks; the line is home"),
    ],
)
def test_home_again_it_is_done_or_was_cut_short(
    bench: Bench, reason: int, severity: int, words: str
) -> None:
    bench.surveys()
    bench.changes = {"standing": survey.DONE, "reason": reason}
    bench.tick()
    assert (bench.texts, bench.standing, bench.moved) == ([(severity, words)], 0.0, [])
    bench.tick()
    assert bench.looks == 1


HERE = TargetLine(3.0, 4.0, START.eta_rad)
MEAN = TargetLine(4.444, 5.555, START.eta_rad)


@pytest.mark.parametrize(
    ("allowed", "tried", "stays"),
    [
        (None, [HERE], "stays"),
        ({MEAN}, [HERE, MEAN], "stays"),
        ({START}, [HERE, MEAN, START], "goes home"),
        (set(), [HERE, MEAN, START], "goes on to where it was sent: set it by hand"),
    ],
)
@pytest.mark.parametrize("why", ["stopped", "operator", "guard", "gain"])
def test_the_line_stays_where_it_is_or_as_near_as_it_may(
    bench: Bench, allowed: set[TargetLine] | None, tried: list[TargetLine], stays: str, why: str
) -> None:
    bench.surveys().allowed = allowed
    here: dict[str, Any] = {"x_m": 3.0, "z_m": 4.0}
    if why == "stopped":
        bench.changes = {"standing": survey.STOPPED, "reason": survey.DRIFTS}
        bench.tick(**here)
        text = f"survey ended: it climbs or sinks; the line {stays}"
    elif why == "operator":
        bench.values["SRV_START"] = 0.0
        bench.tick(0.005, **here)
        text = f"survey ended by the operator; the line {stays}"
    elif why == "guard":
        bench.fence = "the fence is open"
        bench.tick(**here)
        text = f"survey ended: the fence is open; the line {stays}"
    else:
        bench.tick(0.005, **here)
        bench.switch.taken_back("RHO_P")
        text = f"survey ended by RHO_P: the line {stays}"
    assert bench.moved == tried
    severity = SEVERITY_INFO if why in ("operator", "gain") else SEVERITY_WARNING
    assert bench.texts == [(severity, text)]
    assert bench.standing == 0.0
    bench.switch.taken_back("TGL_X")  # it is over
    assert len(bench.texts) == 1


@pytest.mark.parametrize(
    "name", ["TGL_X", "TGL_Z", "TGL_LEAN", "TGL_PRESET", "TGL_PLACE", "TGL_HOLD", "TGL_ALONG"]
)
def test_who_has_said_where_the_line_is_to_be_has_it_there(bench: Bench, name: str) -> None:
    bench.surveys().switch.taken_back(name)
    assert bench.texts == [(SEVERITY_INFO, f"survey ended: {name} was set by hand")]
    assert (bench.moved, bench.standing) == ([], 0.0)


def test_before_its_first_tick_it_is_taken_back_without_a_line(bench: Bench) -> None:
    bench.switch.taken_back("TGL_SLEW")
    assert bench.texts == [(SEVERITY_INFO, "survey ended: TGL_SLEW was set by hand")]
    assert bench.standing == 0.0


@pytest.mark.parametrize("search", [1.0, 2.0, 3.0, 4.0])
def test_a_search_or_the_end_of_control_ends_it(bench: Bench, search: float) -> None:
    bench.surveys().values["SRCH_START"] = search
    bench.tick(0.005)
    words = [] if search == 4.0 else [(SEVERITY_WARNING, "survey ended: a search has begun")]
    assert bench.texts == words
    bench.values["SRCH_START"], bench.values["SRV_START"] = 0.0, 1.0
    bench.tick()
    bench.texts.clear()
    bench.tick(0.005, active=False)
    assert bench.texts == [(SEVERITY_WARNING, "survey ended: it does not soar any more")]
    assert bench.standing == 0.0
