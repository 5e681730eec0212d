"""The operator's desk: what a page may ask, who holds the line, and what every page is shown."""

from __future__ import annotations

import asyncio
import time
from functools import cache
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from page_flight import AIRFRAME, SITE
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.broadcast import Viewer
from tgl_soar.cli.page.browser_requests import (
    HOLD_S,
    Abort,
    Drop,
    Engage,
    Hello,
    Hold,
    Look,
    Move,
    Preset,
    Release,
    SetParameter,
    Undo,
)
from tgl_soar.cli.page.desk import READS, Desk, ghost_json, text_json
from tgl_soar.cli.page.measured_air import AirSample
from tgl_soar.cli.page.scene import Place, place_of
from tgl_soar.cli.page.settling_preview import Ghost, GhostLine
from tgl_soar.cli.page.station import ROW, Station, Text
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.onboard.telemetry_values import ARRAY, ARRAY_NAME

A = {"TGL_X": 0.25, "TGL_Z": 1.25, "TGL_LEAN": 15.0, "TGL_STAGE": 0.0}


@cache
def tunnel() -> Place:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    return place_of(airframe, site, load_parameters(airframe, AIRFRAME, site, SITE), SITE.parent)


class Wire:
    """A link that gives what was put on it, a read at a time, and keeps what is sent."""

    def __init__(self, *, is_stream: bool = False) -> None:
        self.is_stream = is_stream
        self.waiting: list[list[bytes]] = []
        self.sent: list[bytes] = []
        self.held: list[float] = []
        self.closed = 0

    def receive(self, _now_s: float) -> list[bytes]:
        return self.waiting.pop(0) if self.waiting else []

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def hold(self, now_s: float) -> None:
        self.held.append(now_s)

    def close(self) -> None:
        self.closed += 1

    def names(self) -> list[str]:
        reader: Any = mavlink.MAVLink(None, 0, 0)
        found = [reader.decode(bytearray(frame)) for frame in self.sent]
        self.sent.clear()
        return [each.get_type() for each in found]


def frame(message: Any, component: int = 191) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, component)))


def named(name: str, value: float) -> bytes:
    return frame(mavlink.MAVLink_named_value_float_message(0, name.encode(), value))


def desk_on(wire: Any = None, **more: Any) -> Desk:
    link: Any = wire or Wire()
    desk = Desk(tunnel(), Station(1, 191, 253, None, 1.8e9), link, None, **more)
    assert desk.station is not None
    desk.station.parameters.update(A)
    return desk


def viewer(number: int, name: str) -> Viewer:
    async def nowhere(_text: str) -> None: ...

    return Viewer(number, name, nowhere)


ANNA, BERT = viewer(1, "Anna"), viewer(2, "Bert")


def answers(desk: Desk) -> list[tuple[bool, str, str]]:
    return [(n["ok"], n["who"], n["text"]) for n in desk._news()["notices"]]


def move(x: float) -> Move:
    return Move(token="", x=x, z=1.25, lean=15.0)


# --- the link ----------------------------------------------------------------------------------


def test_a_turn_takes_what_has_come_and_sends_what_is_due() -> None:
    wire = Wire()
    desk = desk_on(wire)
    wire.waiting = [[named("e_rho", 0.5), named("soar_x", 1.5)], [named("soar_z", 2.5)]]
    desk.turn(10.0)
    now = desk._state(10.0)["now"]
    assert (now["e_rho"], now["soar_x"], now["soar_z"]) == (0.5, 1.5, 2.5)
    assert wire.held == [10.0] * 3
    assert wire.names()[0] == "HEARTBEAT"


def test_what_is_not_of_the_module_keeps_no_peer() -> None:
    wire = Wire()
    desk = desk_on(wire)
    beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    wire.waiting = [[b"garbage", frame(beat, 7)]]
    desk.turn(10.0)
    assert wire.held == []
    assert desk._state(10.0)["received"] == 0.0


def test_a_flood_waits_for_the_next_turn() -> None:
    wire = Wire()
    desk = desk_on(wire)
    wire.waiting = [[named("e_rho", float(i))] for i in range(25)]
    desk.turn(10.0)
    assert READS == 20
    assert desk._state(10.0)["now"]["e_rho"] == 19.0
    desk.turn(10.01)
    assert desk._state(10.01)["now"]["e_rho"] == 24.0


@pytest.mark.parametrize("is_stream", [False, True])
def test_a_frame_over_two_reads_of_a_stream_is_one(is_stream: bool) -> None:
    """A datagram is whole, so that what no page shows is left out of it; a stream has pieces."""
    wire = Wire(is_stream=is_stream)
    desk = desk_on(wire)
    raw = frame(mavlink.MAVLink_raw_imu_message(0, 1, 2, 3, 4, 5, 6, 7, 8, 9))
    whole = named("e_rho", 0.5)
    wire.waiting = [[whole[:15]], [whole[15:]], [raw]]
    desk.turn(10.0)
    assert desk._state(10.0)["now"].get("e_rho") == 0.5
    # The other frame is one of the module's: it was received where it was not left out.
    assert len(wire.held) == (2 if is_stream else 1)


def test_the_time_at_which_the_module_was_received_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(time, "time", lambda: 1.75e9 + 0.12346)
    wire = Wire()
    desk = desk_on(wire)
    wire.waiting = [[named("e_rho", 0.5)]]
    desk.turn(10.0)
    state = desk._state(11.53)
    assert (state["silence_s"], state["alive"]) == (1.5, True)
    assert round(state["received"] - 1.75e9, 6) == 0.123
    assert (state["sent"], state["starts"]) == (0.0, 0)
    desk.take(ANNA, Hold(token=""), 11.5)
    assert round(desk._state(12.5)["sent"] - 1.75e9, 6) == 0.1235
    assert not desk._state(12.5)["alive"]
    assert desk_on()._state(0.0)["silence_s"] is None


def test_it_works_a_hundred_turns_and_twenty_frames_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    desk, clock = desk_on(), SimpleNamespace(now_s=50.0)
    turns: list[float] = []
    frames: list[float] = []
    monkeypatch.setattr(desk, "turn", turns.append)
    monkeypatch.setattr(desk, "show", frames.append)
    monkeypatch.setattr(time, "monotonic", lambda: clock.now_s)

    async def pass_by(seconds: float) -> None:
        clock.now_s += seconds
        if clock.now_s > 52.0:
            raise asyncio.CancelledError

    monkeypatch.setattr(asyncio, "sleep", pass_by)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(desk.work())
    assert len(turns) == pytest.approx(200, abs=2)
    assert frames[0] == 50.0
    assert len(frames) == pytest.approx(40, abs=7)  # a turn of 0.01 s late here and there


def test_frames_that_were_late_are_not_made_up_for(monkeypatch: pytest.MonkeyPatch) -> None:
    desk, clock = desk_on(), SimpleNamespace(now_s=0.0)
    frames: list[float] = []
    times = iter([0.0, 0.01, 5.0, 5.01, 5.02, 5.07])
    monkeypatch.setattr(desk, "turn", lambda _now_s: None)
    monkeypatch.setattr(desk, "show", frames.append)
    monkeypatch.setattr(time, "monotonic", lambda: clock.now_s)

    async def pass_by(_seconds: float) -> None:
        clock.now_s = next(times, -1.0)
        if clock.now_s < 0.0:
            raise asyncio.CancelledError

    monkeypatch.setattr(asyncio, "sleep", pass_by)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(desk.work())
    assert frames[:2] == [0.0, 5.0]
    assert len(frames) <= 4


def test_the_link_is_closed_with_the_desk() -> None:
    wire = Wire()
    desk_on(wire).close()
    assert wire.closed == 1
    Desk(tunnel(), None, None, b"{}").close()


# --- who may ask -------------------------------------------------------------------------------


@pytest.mark.parametrize("request_", [
    Hold(token=""), Look(token="", x=0.5, z=1.5, lean=15.0), move(0.5), Preset(token="", number=1),
    Undo(token=""),
])  # fmt: skip
def test_a_line_that_another_page_holds_is_not_moved(request_: Any) -> None:
    desk = desk_on()
    desk.take(BERT, Hold(token=""), 10.0)
    desk.take(ANNA, request_, 10.0 + HOLD_S)
    assert answers(desk) == [(False, "Anna", "the line is held by Bert")]
    assert desk.orders is not None
    assert not desk.orders.is_busy
    state = desk._state(10.0 + HOLD_S)
    assert (state["holder"], state["holder_name"]) == (2, "Bert")
    desk.take(ANNA, request_, 10.1 + HOLD_S)
    assert "the line is held" not in str(answers(desk))


@pytest.mark.parametrize("request_", [
    Engage(token=""), Release(token=""), Abort(token=""),
    SetParameter(token="", name="RHO_P", value=0.5), Drop(token=""),
])  # fmt: skip
def test_what_does_not_move_the_line_is_anybodys(request_: Any) -> None:
    desk = desk_on()
    desk.take(BERT, Hold(token=""), 10.0)
    desk.take(ANNA, request_, 10.0)
    assert answers(desk) == []
    assert desk._state(10.0)["holder"] == 2


@pytest.mark.parametrize("request_", [Drop(token=""), move(0.5), Preset(token="", number=1),
                                      Undo(token="")])  # fmt: skip
def test_an_operator_that_has_moved_the_line_stops(request_: Any) -> None:
    desk = desk_on()
    desk.take(ANNA, Look(token="", x=0.5, z=1.5, lean=15.0), 10.0)
    assert desk._state(10.0)["ghost"] is not None
    desk.take(ANNA, request_, 10.1)
    state = desk._state(10.1)
    assert (state["holder"], state["holder_name"], state["ghost"]) == (0, "", None)


@pytest.mark.parametrize("request_", [Hold(token=""), Look(token="", x=0.5, z=1.5, lean=15.0)])
def test_a_hand_that_holds_the_line_goes_on_to(request_: Any) -> None:
    desk = desk_on()
    desk.take(ANNA, request_, 10.0)
    assert desk._state(10.0 + HOLD_S)["holder"] == 1
    assert desk._state(10.1 + HOLD_S)["holder"] == 0
    assert desk._state(10.1 + HOLD_S)["ghost"] is None


def test_a_page_that_has_gone_holds_nothing_and_leaves_others_theirs() -> None:
    desk = desk_on()
    desk.take(ANNA, Look(token="", x=0.5, z=1.5, lean=15.0), 10.0)
    desk.leave(BERT)
    assert desk._state(10.0)["holder"] == 1
    assert desk._state(10.0)["ghost"] is not None
    desk.leave(ANNA)
    assert desk._state(10.0)["holder"] == 0
    assert desk._state(10.0)["ghost"] is None


def test_a_recording_takes_no_request() -> None:
    desk = Desk(tunnel(), None, None, b"{}")
    desk.take(ANNA, Engage(token=""), 10.0)
    assert answers(desk) == [(False, "Anna", "this is a recording: nothing can be changed")]
    assert desk._state(10.0) == {"holder": 0, "holder_name": "", "pages": 0}
    desk.turn(10.0)
    assert msgspec.json.decode(desk.scene)["source"] == "recording"


# --- what is asked -----------------------------------------------------------------------------


@pytest.mark.parametrize(("request_", "number"), [
    (Engage(token=""), 31010), (Release(token=""), 31011), (Abort(token=""), 31012),
])  # fmt: skip
def test_a_command_goes_out_at_once(request_: Any, number: int) -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, request_, 10.0)
    reader: Any = mavlink.MAVLink(None, 0, 0)
    (message,) = [reader.decode(bytearray(each)) for each in wire.sent]
    assert (message.get_type(), message.command) == ("COMMAND_LONG", number)


def test_a_move_and_its_undo_are_the_lines_numbers() -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, move(0.5), 10.0)
    assert wire.names() == ["PARAM_SET"]
    state = desk._state(10.0)
    assert (state["busy"], state["undo"]) == (True, 1)
    assert desk_on()._state(10.0)["undo"] == 0
    desk.take(ANNA, Undo(token=""), 10.1)
    assert desk._state(10.1)["undo"] == 0


@pytest.mark.parametrize(("number", "refused"), [(1, False), (3, False), (4, True), (99, True)])
def test_only_lines_of_the_site_are_presets(number: int, refused: bool) -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, Preset(token="", number=number), 10.0)
    assert answers(desk) == ([(False, "Anna", f"the site has no line {number}")] if refused else [])
    assert wire.names() == ([] if refused else ["PARAM_SET"])
    if not refused:
        assert desk.orders is not None
        assert desk.orders._waiting[0].words == f"line {'abc'[number - 1]}"


@pytest.mark.parametrize(("name", "value", "words"), [
    ("NO_SUCH", 1.0, "NO_SUCH: no such parameter"),
    ("RHO_P", 99.0, "RHO_P = 99: allowed 0 to 5 rad/m"),
])  # fmt: skip
def test_a_parameter_that_is_none_or_out_of_its_range_is_not_sent(
    name: str, value: float, words: str
) -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, SetParameter(token="", name=name, value=value), 10.0)
    ((ok, who, text),) = answers(desk)
    assert (ok, who) == (False, "Anna")
    assert text.startswith(words.split(": allowed")[0])
    assert ("allowed" in text) == ("allowed" in words)
    assert wire.names() == []


def test_a_parameter_is_set_as_it_is_asked_for() -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, SetParameter(token="", name="RHO_P", value=0.75), 10.0)
    reader: Any = mavlink.MAVLink(None, 0, 0)
    (message,) = [reader.decode(bytearray(each)) for each in wire.sent]
    assert (message.param_id, message.param_value) == ("RHO_P", 0.75)


def test_a_hello_asks_for_nothing() -> None:
    wire = Wire()
    desk = desk_on(wire)
    desk.take(ANNA, Hello(token=""), 10.0)
    assert (answers(desk), wire.names(), desk._state(10.0)["holder"]) == ([], [], 0)


# --- a line that is looked at ------------------------------------------------------------------


class NotedForesight:
    """What the foresight is asked."""

    def __init__(self) -> None:
        self.asked: Any = None

    def ghost(self, values: Any, wanted: Any, start: Any, *, flying: bool) -> Ghost:
        self.asked = values, wanted, start, flying
        return Ghost(
            line=wanted, refusal="", warning="", place=None, settles_s=None, words="", path=()
        )


LOOK = Look(token="", x=0.5, z=1.5, lean=20.0)
NOW = {"soar_x": 0.3, "soar_z": 1.2, "line_x": 0.2, "line_z": 1.1, "line_lean": 14.0}


@pytest.mark.parametrize(("mode", "flying"), [
    (4.0, True), (2.0, False), (float("nan"), False), (None, False), (3.0, True),
])  # fmt: skip
def test_a_look_begins_where_the_aircraft_is_and_on_the_line_that_it_flies(
    mode: float | None, flying: bool
) -> None:
    desk, foresight = desk_on(), NotedForesight()
    desk._foresight = foresight  # type: ignore[assignment]
    assert desk.station is not None
    desk.station.now.update(NOW if mode is None else {**NOW, "soar_mode": mode})
    desk.take(ANNA, LOOK, 10.0)
    _, wanted, start, was_flying = foresight.asked
    assert wanted == GhostLine(0.5, 1.5, 20.0)
    assert (start.x_m, start.z_m) == (0.3, 1.2)
    assert start.line == ((0.2, 1.1, 14.0) if flying else None)
    assert was_flying == flying


@pytest.mark.parametrize("lost", ["line_x", "line_z", "line_lean"])
def test_a_line_of_which_a_number_is_not_known_is_no_start(lost: str) -> None:
    desk, foresight = desk_on(), NotedForesight()
    desk._foresight = foresight  # type: ignore[assignment]
    assert desk.station is not None
    desk.station.now.update({**NOW, "soar_mode": 4.0, lost: float("nan")})
    desk.take(ANNA, LOOK, 10.0)
    assert foresight.asked[2].line is None


def test_the_modules_values_are_looked_with_and_the_files_where_these_disagree() -> None:
    desk, foresight = desk_on(), NotedForesight()
    desk._foresight = foresight  # type: ignore[assignment]
    assert desk.station is not None
    desk.station.parameters["TGL_SLEW"] = 0.25
    desk.take(ANNA, LOOK, 10.0)
    assert foresight.asked[0]["TGL_SLEW"] == 0.25
    before = foresight.asked[0]
    desk.take(ANNA, LOOK, 10.1)
    assert foresight.asked[0] is before
    desk.station.parameters["FENCE_X_MIN"] = 50.0  # beyond FENCE_X_MAX: in the middle of a change
    desk.take(ANNA, LOOK, 10.2)
    assert foresight.asked[0] == tunnel().values


# --- the measured air --------------------------------------------------------------------------


class Air:
    """What is measured with."""

    drawing = None

    def __init__(self) -> None:
        self.taken: list[tuple[AirSample, bool]] = []
        self.bounds: list[Any] = []
        self.begun = self.drawn = 0

    def begin_again(self) -> None:
        self.begun += 1

    def bound(self, parameters: Any) -> None:
        self.bounds.append(dict(parameters))

    def take(self, sample: AirSample, *, flying: bool) -> None:
        self.taken.append((sample, flying))

    def draw_on(self) -> None:
        self.drawn += 1


def array(time_s: float, **numbers: float) -> bytes:
    data = [0.0] * 58
    for name, value in numbers.items():
        data[ARRAY.index(name)] = value
    return frame(
        mavlink.MAVLink_debug_float_array_message(
            round(time_s * 1e6), ARRAY_NAME.encode(), 191, data
        )
    )


@pytest.mark.parametrize(("mode", "flying"), [(4.0, True), (7.0, False), (float("nan"), False)])
def test_an_array_is_a_sample_of_the_air(mode: float, flying: bool) -> None:
    wire, air = Wire(), Air()
    desk = desk_on(wire)
    desk._air = air  # type: ignore[assignment]
    wire.waiting = [
        [array(2.5, mode=mode, x=0.5, z=1.5, speed_x=-0.25, wind=8.5, updraft=0.75, pushed=0.125)]
    ]
    desk.turn(10.0)
    assert air.taken == [
        (
            AirSample(
                time_s=2.5,
                x_m=0.5,
                z_m=1.5,
                velocity_x_mps=-0.25,
                wind_mps=8.5,
                updraft_mps=0.75,
                pushed_mps=0.125,
            ),
            flying,
        )
    ]
    assert air.bounds == [A]
    assert air.begun == 0
    desk.show(10.0)
    assert air.drawn == 1


def test_a_module_that_was_started_again_begins_the_map_again_once() -> None:
    wire, air = Wire(), Air()
    desk = desk_on(wire)
    desk._air = air  # type: ignore[assignment]
    for start in (5, 6):
        beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, start << 8 | 4, 4, 3)
        wire.waiting = [[frame(beat)], [array(1.0)], [array(2.0)]]
        desk.turn(10.0)
        assert air.begun == start - 5


def test_without_a_map_nothing_is_measured() -> None:
    wire = Wire()
    desk = desk_on(wire, maps=False)
    wire.waiting = [[array(1.0, mode=4.0)]]
    desk.turn(10.0)
    assert desk._state(10.0)["measured"] is None
    assert desk._air is None
    assert desk_on()._air is not None


# --- what pages are shown ----------------------------------------------------------------------


def test_the_news_are_reported_once_and_all_of_them_to_a_new_page() -> None:
    wire = Wire()
    desk = desk_on(wire)
    text = mavlink.MAVLink_statustext_message(6, b"ready", 0, 0)
    wire.waiting = [[frame(text)]]
    desk.turn(10.0)
    desk.turn(10.5)
    first = desk._news()
    assert [row[0] for row in first["rows"]] == [10.0, 10.5]
    assert [each["text"] for each in first["texts"]] == ["ready"]
    assert desk._news() == {"rows": [], "texts": [], "notices": []}
    desk.turn(11.0)
    assert [row[0] for row in desk._news()["rows"]] == [11.0]
    whole = desk._whole_of(11.0)()
    assert [row[0] for row in whole["rows"]] == [10.0, 10.5, 11.0]
    assert [each["text"] for each in whole["texts"]] == ["ready"]
    assert "notices" not in whole
    assert whole["parameters"] == A


def test_no_more_rows_are_new_than_are_kept() -> None:
    desk = desk_on()
    assert desk.station is not None
    for i in range(350):
        desk.station.step(0.25 * i)
    assert len(desk._news()["rows"]) == 300


def test_fifty_notices_wait_for_the_next_frame() -> None:
    desk = desk_on()
    for _ in range(55):
        desk.take(ANNA, SetParameter(token="", name="NO_SUCH", value=1.0), 10.0)
    numbers = [notice["number"] for notice in desk._news()["notices"]]
    assert numbers == list(range(6, 56))


def test_the_scene_says_what_the_columns_are_and_that_it_is_a_flight() -> None:
    scene = msgspec.json.decode(desk_on().scene)
    assert scene["rows"] == list(ROW)
    assert scene["source"] == "live"
    assert scene["site"] == tunnel().scene["site"]


def test_a_ghost_and_a_text_are_rounded_as_a_browser_needs_them() -> None:
    ghost = Ghost(
        line=GhostLine(0.5, 1.5, 20.0),
        refusal="r",
        warning="w",
        place=(1.23456, 2.34567),
        settles_s=3.14159,
        words="",
        path=((0.12345, 1.0), (1.23456, 2.34567)),
    )
    assert ghost_json(ghost) == {
        "x": 0.5,
        "z": 1.5,
        "lean": 20.0,
        "refusal": "r",
        "warning": "w",
        "place": [1.235, 2.346],
        "settles_s": 3.1,
        "words": "",
        "path": [[0.123, 1.0], [1.235, 2.346]],
    }
    blank = ghost_json(ghost._replace(place=None, settles_s=None))
    assert (blank["place"], blank["settles_s"]) == (None, None)
    text = Text(number=3, first=2, wall_s=12.3456, severity=4, source="module", text="t")
    assert text_json(text) == {
        "first": 2,
        "time": 12.3,
        "severity": 4,
        "source": "module",
        "text": "t",
    }


def test_pages_are_counted_and_those_that_are_gone_are_left_out() -> None:
    async def shown() -> tuple[int, int, int]:
        desk = desk_on()

        async def fails(_text: str) -> None:
            raise RuntimeError

        async def takes(_text: str) -> None: ...

        gone = desk.pages.add("gone", fails)
        desk.pages.add("here", takes)
        before = desk._state(10.0)["pages"]
        desk.take(gone, Hold(token=""), 10.0)
        desk.show(10.0)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        desk.show(10.05)
        return before, desk._state(10.05)["pages"], desk._state(10.05)["holder"]

    assert asyncio.run(shown()) == (2, 1, 0)
