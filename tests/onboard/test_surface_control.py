"""Commanding the surfaces and handing them over, tick by tick: what goes out, and when."""

from __future__ import annotations

from math import inf, nan
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import CHANNELS

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.messages import SEVERITY_WARNING
from tgl_soar.link.mode_change import ANSWER_S
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.surface_control import (
    RELEASE_FRAMES,
    SurfaceControl,
    is_finite_command,
    outlast_cut_frame,
)
from tgl_soar.types import (
    OURS,
    THEIRS,
    THEIRS_WITH_RUDDER,
    AutopilotStatus,
    Setpoints,
    SurfaceCommand,
)

# An outbox that only records stands for the whole one, which native code refuses.
pytestmark = pytest.mark.interpreted

T_S = 50.0
TICK_S = 0.005
FBWA, GUIDED, LOITER, CIRCLE = 5, 15, 12, 1  # ArduPlane's custom modes
COMMAND = SurfaceCommand(0.1, -0.2, 0.3)
SETPOINTS = Setpoints(0.05, 0.1, 1.0)
WHOLE_FRAME = 10 + 255 + 2 + 13  # header, payload, checksum, signature of a MAVLink 2 frame


class Outbox:
    """Records its arguments."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.cut = False  # a frame may have been
        self.release_bytes = 70
        self.autopilot = SimpleNamespace(clear_for_release=self._clear)

    def _clear(self) -> bool:
        self.sent.append("cleared")
        return self.cut

    def command(self, messages: Any) -> None:
        self.sent.append(("command", messages))

    def hand_over(self, messages: Any) -> int:
        self.sent.append(("release", messages))
        return self.release_bytes

    def tell(self, severity: int, text: str) -> None:
        self.sent.append((severity, text))

    def say_all(self, messages: Any, only: Any) -> None:
        assert only is self.autopilot
        self.sent += [("said", message) for message in messages]

    def take(self, kind: str = "") -> list[Any]:
        """What was sent since the last call; of one kind."""
        taken, self.sent[:] = self.sent[:], []
        return [each for each in taken if not kind or each[0] == kind]


class Scene:
    """A surface control, and what it has sent."""

    def __init__(self, route: str = "override", firmware: str = "ardupilot") -> None:
        self.outbox, self.counters = Outbox(), Counters()
        self.flavour = flavour(firmware, route, CHANNELS, 1)
        outbox: Any = self.outbox
        self.control = SurfaceControl(
            self.flavour, outbox, self.counters, lambda: self.outbox.sent.append("before first")
        )
        self.now_s = T_S
        self.custom_mode = FBWA
        self.received_s = T_S
        self.failsafe = False
        self.pitch_rad = 0.04

    def status(self) -> AutopilotStatus:
        return AutopilotStatus(
            time_s=self.received_s,
            accepts_surfaces=self.custom_mode == GUIDED,
            armed=True,
            failsafe=self.failsafe,
        )

    def tick(self, *, active: bool, command: SurfaceCommand = COMMAND) -> None:
        output: Any = SimpleNamespace(
            active=active,
            command=command,
            setpoints=SETPOINTS,
            throttle=SimpleNamespace(fraction=0.6),
        )
        self.control.tick(output, self.now_s, self.status())
        self.now_s += TICK_S

    def change(self, *, engage: bool = True, ready: bool = True) -> str:
        session: Any = SimpleNamespace(status=self.status(), custom_mode=self.custom_mode)
        return self.control.change_mode(
            self.now_s, session, engage=engage, ready=ready, pitch_rad=self.pitch_rad
        )

    def receive(self, custom_mode: int, after_s: float = 1.0, *, failsafe: bool = False) -> None:
        """The next heartbeat."""
        self.now_s += after_s
        self.received_s, self.custom_mode, self.failsafe = self.now_s, custom_mode, failsafe


def modes(messages: list[Any]) -> list[float]:
    """The modes that were asked for."""
    assert all(m.command == mavlink.MAV_CMD_DO_SET_MODE for _, m in messages)
    return [m.params[1] for _, m in messages]


# --- commands -------------------------------------------------------------------------------------


def test_the_watchdog_knows_before_the_first_command_and_is_notified_once() -> None:
    scene = Scene()
    for _ in range(2):
        scene.tick(active=True)
    expected = ("command", scene.flavour.commands(COMMAND, SETPOINTS, 0.6))
    assert scene.outbox.take() == ["before first", expected, expected]
    assert scene.counters.surface_frames == 2
    assert scene.control.in_control


def test_without_surfaces_nothing_goes_out() -> None:
    scene = Scene()
    scene.tick(active=False)
    assert scene.outbox.take() == []
    assert not scene.control.in_control


def test_what_is_no_number_is_not_sent_and_hands_nothing_over() -> None:
    """The autopilot's own limit for silence is what counts then, and the next tick's command."""
    scene = Scene()
    scene.tick(active=True)
    scene.outbox.take()
    scene.tick(active=True, command=COMMAND._replace(elevator=nan))
    assert scene.outbox.take() == []
    assert scene.control.is_active
    assert scene.counters.surface_frames == 1


@pytest.mark.parametrize(
    ("loops", "counts"),
    [
        (OURS, {"elevator", "aileron", "rudder"}),
        (THEIRS_WITH_RUDDER, {"pitch_rad", "roll_rad", "rudder"}),
        (THEIRS, {"pitch_rad", "roll_rad"}),
    ],
)
def test_a_command_is_made_of_numbers_as_far_as_its_route_says_it(
    loops: int, counts: set[str]
) -> None:
    refused = set()
    for name in ("elevator", "aileron", "rudder", "pitch_rad", "roll_rad", "heading_rad"):
        is_surface = name in SurfaceCommand._fields
        output: Any = SimpleNamespace(
            command=COMMAND._replace(**{name: nan}) if is_surface else COMMAND,
            setpoints=SETPOINTS if is_surface else SETPOINTS._replace(**{name: inf}),
        )
        if not is_finite_command(output, loops):
            refused.add(name)
    assert refused == counts


@pytest.mark.parametrize(
    ("firmware", "route", "enters"),
    [
        ("ardupilot", "override", False),
        ("ardupilot", "attitude", True),
        ("px4", "attitude", True),
    ],
)
def test_a_mode_is_entered_where_the_route_has_one(firmware: str, route: str, enters: bool) -> None:
    assert Scene(route, firmware).control.enters_mode is enters


# --- handing over ---------------------------------------------------------------------------------


def test_the_release_is_repeated_ten_times_a_second_and_then_all_is_over() -> None:
    scene = Scene()
    scene.tick(active=True)
    scene.outbox.take()
    released_s: list[float] = []
    for _ in range(200):
        at_s = scene.now_s
        scene.tick(active=False)
        released_s += [at_s - T_S - TICK_S] * len(scene.outbox.take("release"))
        assert scene.control.in_control == (len(released_s) < RELEASE_FRAMES)
    assert released_s == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1.01 * TICK_S)
    assert scene.counters.release_frames == len(released_s) == RELEASE_FRAMES


def test_what_is_on_its_way_is_discarded_before_the_first_release() -> None:
    scene = Scene()
    scene.tick(active=True)
    scene.outbox.take()
    scene.tick(active=False)
    assert scene.outbox.take() == ["cleared", ("release", scene.flavour.release())]


def test_taken_again_the_surfaces_are_released_no_more() -> None:
    scene = Scene()
    for active in (True, False, True):
        scene.tick(active=active)
    assert scene.outbox.take().count("before first") == 2
    scene.now_s += 1.0
    scene.tick(active=True)
    assert [each[0] for each in scene.outbox.take()] == ["command"]


def test_where_a_frame_was_cut_releases_outlast_it() -> None:
    scene = Scene()
    scene.outbox.cut = True
    scene.tick(active=True)
    scene.tick(active=False)
    at_once = len(scene.outbox.take("release"))
    swallowed = (at_once - 2) * scene.outbox.release_bytes  # but that of the tick, and the last
    assert WHOLE_FRAME <= swallowed <= WHOLE_FRAME + scene.outbox.release_bytes


@pytest.mark.parametrize("size", [1, 30, 279, WHOLE_FRAME, 400])
def test_whatever_a_cut_frame_takes_for_its_own_end_one_more_release_follows(size: int) -> None:
    sizes: list[int] = []

    def release() -> int:
        sizes.append(size)
        return size

    outlast_cut_frame(release)
    assert sum(sizes[:-1]) >= WHOLE_FRAME
    assert sum(sizes) < 2 * (WHOLE_FRAME + size)


def test_a_route_that_hands_over_by_silence_does_not_go_round_for_ever() -> None:
    empty = iter((0, 0))
    outlast_cut_frame(lambda: next(empty))
    assert list(empty) == []


def test_on_the_way_out_of_control_the_mode_is_left_given_way_or_the_pilots() -> None:
    class ModeSpy:
        def __init__(self) -> None:
            self.asked: list[Any] = []
            self.is_changing = False

        def leave(self, *given: float, failsafe: bool) -> None:
            self.asked.append(("leave", *given, failsafe))

        def give_way(self) -> None:
            self.asked.append("give way")

        def stop(self) -> None:
            self.asked.append("stop")

    received_s = T_S - 0.3
    for mode, failsafe, words in (
        (GUIDED, False, ("leave", T_S + TICK_S, received_s, False)),
        (GUIDED, True, ("leave", T_S + TICK_S, received_s, True)),
        (CIRCLE, True, "give way"),
        (FBWA, False, "stop"),
    ):
        scene, spy = Scene("attitude"), ModeSpy()
        control: Any = scene.control
        control.mode_change = spy
        scene.received_s, scene.custom_mode, scene.failsafe = received_s, mode, failsafe
        scene.tick(active=True)
        assert spy.asked == []
        scene.tick(active=False)
        scene.tick(active=False)
        assert spy.asked == [words]


# --- the mode that obeys --------------------------------------------------------------------------


def test_the_mode_is_asked_for_at_the_next_heartbeat_and_level_setpoints_stream_before() -> None:
    scene = Scene("attitude")
    assert scene.change() == ""
    level = scene.flavour.commands(SurfaceCommand(0, 0, 0), Setpoints(scene.pitch_rad, 0.0, 0.0))
    assert scene.outbox.take() == ["before first", ("command", level)]
    assert scene.control.in_control
    scene.receive(FBWA)
    scene.change()
    (asked, command) = scene.outbox.take()
    assert modes([asked]) == [GUIDED]
    assert command == ("command", level)
    scene.receive(GUIDED)
    scene.change()
    assert scene.outbox.take() == []
    assert not scene.control.in_control  # the tick takes over from here


def test_an_attitude_that_is_not_known_is_not_streamed() -> None:
    scene = Scene("attitude")
    scene.pitch_rad = nan
    scene.change()
    assert scene.outbox.take() == ["before first"]


@pytest.mark.parametrize(
    ("engage", "ready", "mode"),
    [(False, True, FBWA), (True, False, FBWA), (True, True, GUIDED)],
    ids=["not asked to", "not ready", "it obeys already"],
)
def test_no_mode_is_asked_for_where(engage: bool, ready: bool, mode: int) -> None:
    scene = Scene("attitude")
    scene.custom_mode = mode
    for _ in range(3):
        scene.change(engage=engage, ready=ready)
        scene.receive(mode)
    assert scene.outbox.take() == []


def test_a_mode_that_is_on_its_way_is_not_begun_again() -> None:
    scene = Scene("attitude")
    for _ in range(3):
        scene.change()
    assert scene.outbox.take().count("before first") == 1


def test_an_engagement_that_is_withdrawn_leaves_the_mode_that_may_come_yet() -> None:
    scene = Scene("attitude")
    scene.change()
    scene.receive(FBWA)
    scene.change()
    scene.outbox.take()
    scene.change(engage=False)
    assert scene.outbox.take() == []  # nothing streams any more
    scene.receive(GUIDED, ANSWER_S / 2)  # the request was on its way
    scene.change(engage=False)
    assert modes(scene.outbox.take()) == [FBWA]


def test_why_a_mode_did_not_come_is_returned_once() -> None:
    scene = Scene("attitude")
    scene.change()
    scene.receive(LOITER)
    assert scene.change() == "not engaged: the pilot has chosen another mode"
    assert scene.change(engage=False) == ""


def test_a_mode_that_a_failsafe_gives_back_is_left_again_and_reported() -> None:
    scene = Scene("attitude")
    scene.custom_mode = GUIDED
    scene.tick(active=True)
    scene.receive(CIRCLE, failsafe=True)
    scene.tick(active=False)
    scene.receive(CIRCLE, failsafe=True)
    scene.change(engage=False)
    scene.outbox.take()
    scene.receive(GUIDED)
    scene.change(engage=False)
    reported, *requests = scene.outbox.take()
    assert reported == (
        SEVERITY_WARNING,
        "back in GUIDED after the autopilot's failsafe: asking it to leave",
    )
    route = scene.flavour.route
    assert modes(requests) == [route.mode_to_leave]


# --- the end, and another clock -------------------------------------------------------------------


def test_at_the_end_all_releases_go_at_once_each_with_the_request_to_leave() -> None:
    scene = Scene("attitude")
    scene.custom_mode = GUIDED
    scene.tick(active=True)
    scene.outbox.take()
    scene.control.stop(obeys=True)
    cleared, *rest = scene.outbox.take()
    assert cleared == "cleared"
    assert [each[0] for each in rest] == ["release", "said"] * RELEASE_FRAMES
    assert set(modes(rest[1::2])) == {float(scene.flavour.route.mode_to_leave)}
    assert not scene.control.in_control


def test_at_the_end_the_pilots_mode_stays() -> None:
    scene = Scene("attitude")
    scene.tick(active=True)
    scene.control.stop(obeys=False)
    assert scene.outbox.take("said") == []


def test_at_the_end_nothing_is_released_that_is_not_ours() -> None:
    scene = Scene("attitude")
    scene.custom_mode = GUIDED
    scene.control.stop(obeys=True)
    assert scene.outbox.take() == []


@pytest.mark.parametrize("what", ["commanding", "releasing", "entering"])
def test_with_another_clock_all_that_was_timed_is_forgotten(what: str) -> None:
    scene = Scene("attitude")
    if what == "entering":
        scene.change()
    else:
        scene.tick(active=True)
    if what == "releasing":
        scene.tick(active=False)
    assert scene.control.in_control
    scene.control.restart()
    assert not scene.control.in_control
    scene.outbox.take()
    scene.now_s += 10.0
    scene.tick(active=False)
    assert scene.outbox.take() == []
