"""What is asked of the module, until it is confirmed or refused: against the module itself."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from page_flight import RELEASED, SOARING, Flown

from tgl_soar.cli.page.orders import ABORT, ENGAGE, RELEASE, WAITING, Done, Orders
from tgl_soar.cli.page.settling_preview import GhostLine
from tgl_soar.cli.page.station import Station, without_others

A, B, C = GhostLine(0.20, 1.15, 15.0), GhostLine(0.60, 1.60, 15.0), GhostLine(1.05, 2.00, 15.0)
SLICE_S = 0.05


class Desk:
    """A station and its orders beside a flight, by simulated time."""

    def __init__(self) -> None:
        self.flown = Flown()
        self.station = Station(1, 191, 253, None, 1.8e9)
        self.done: list[Done] = []
        self.orders = Orders(self.station, self.done.append)
        self.now_s = 100.0
        self.loses: Callable[[bytes], bool] = lambda _frame: False
        self.run(6.0)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / SLICE_S)):
            self.now_s += SLICE_S
            for data in self.flown.run(SLICE_S):
                self.station.receive(without_others(data), self.now_s, 1.8e9)
            self.station.step(self.now_s)
            self.orders.step(self.now_s)
            for frame in self.station.take_datagrams():
                if not self.loses(frame):
                    self.flown.receive(frame)

    def engaged(self) -> Desk:
        self.orders.command("me", ENGAGE)
        self.run(8.0)
        assert self.flown.mode == SOARING
        return self

    @property
    def words(self) -> list[str]:
        return [done.text for done in self.done]


def test_engage_move_undo_release() -> None:
    desk = Desk().engaged()
    assert desk.words == ["engage: engaging", "engage: done"]
    desk.orders.move("me", B)
    desk.run(1.0)
    assert desk.orders.line() == pytest.approx(B)
    assert desk.flown.value("TGL_Z") == pytest.approx(1.6)
    assert desk.flown.value("TGL_STAGE") == 0.0
    assert desk.done[-1].ok
    assert "confirmed" in desk.words[-1]
    desk.run(6.0)
    assert desk.flown.mode == SOARING
    desk.orders.undo("me")
    desk.run(1.0)
    assert desk.orders.line() == pytest.approx(A)
    desk.orders.command("me", RELEASE)
    desk.run(1.0)
    assert desk.words[-1] == "release: done"
    assert desk.flown.value("OP_ENGAGE") == 0.0


def test_a_refused_line_leaves_everything_as_it_was() -> None:
    desk = Desk().engaged()
    desk.orders.move("me", GhostLine(0.6, 9.0, 15.0))
    desk.run(2.0)
    assert not desk.done[-1].ok
    assert "refused" in desk.words[-1]
    assert "outside the fence" in desk.station.texts[-1].text
    assert desk.orders.line() == pytest.approx(A)
    assert desk.orders.undo_count == 0
    desk.orders.move("me", B)  # what was dropped is not in its way
    desk.run(1.0)
    assert desk.orders.line() == pytest.approx(B)


def test_one_number_is_set_by_itself() -> None:
    desk = Desk()
    sent: list[bytes] = []

    def noted(frame: bytes) -> bool:
        sent.append(frame)
        return False

    desk.loses = noted
    desk.orders.move("me", A._replace(z_m=1.2))
    desk.run(0.5)
    assert desk.orders.line() is not None
    assert not any(b"TGL_STAGE" in frame for frame in sent)
    desk.loses = lambda _frame: False
    desk.orders.move("me", A._replace(z_m=1.25))
    desk.run(0.5)
    assert desk.flown.value("TGL_Z") == pytest.approx(1.25)


def test_lost_frames_are_sent_again() -> None:
    desk = Desk()
    count = 0

    def every_other(_frame: bytes) -> bool:
        nonlocal count
        count += 1
        return count % 2 == 0

    desk.loses = every_other
    desk.orders.move("me", B)
    desk.orders.preset("me", 3, "c")
    desk.run(8.0)
    assert desk.orders.line() == pytest.approx(C)
    assert [done.ok for done in desk.done] == [True, True]


def test_a_dead_link_gives_up_in_words_and_nothing_is_left_over() -> None:
    desk = Desk()
    desk.loses = lambda _frame: True
    desk.orders.move("me", B)
    desk.orders.command("me", ENGAGE)
    desk.run(7.0)
    assert [done.ok for done in desk.done] == [False, False]
    assert all("does not answer" in words for words in desk.words)
    assert not desk.orders.is_busy
    desk.loses = lambda _frame: False
    desk.run(5.0)
    assert desk.flown.value("TGL_Z") == pytest.approx(A.z_m)
    assert desk.flown.value("OP_ENGAGE") == 0.0


def test_a_link_that_dies_while_a_move_is_staged_leaves_the_line() -> None:
    desk = Desk()
    desk.loses = lambda frame: b"TGL_STAGE" in frame and desk.flown.value("TGL_STAGE") == 1.0
    desk.orders.move("me", B)
    desk.run(7.0)
    assert desk.flown.onboard.settings.values["TGL_Z"] == pytest.approx(A.z_m)
    desk.loses = lambda _frame: False
    desk.orders.move("me", C)  # what is staged is gone on with, and not in its way
    desk.run(2.0)
    assert desk.orders.line() == pytest.approx(C)
    assert desk.flown.onboard.settings.values["TGL_Z"] == pytest.approx(C.z_m)


def test_an_abort_goes_at_once_and_drops_what_waits() -> None:
    desk = Desk().engaged()
    desk.orders.move("me", B)
    desk.orders.preset("me", 3, "c")
    desk.orders.command("me", ABORT)
    desk.run(1.0)
    assert desk.words[-1] == "abort: done"
    assert desk.flown.value("OP_ENGAGE") == 0.0
    assert desk.flown.mode != RELEASED
    desk.orders.command("me", ENGAGE)
    desk.run(1.0)
    assert desk.words[-1] == "engage: refused for now"
    assert desk.flown.value("TGL_X") == pytest.approx(A.x_m)


@pytest.mark.parametrize("number", [RELEASE, ABORT])
@pytest.mark.parametrize("loses", [False, True])
@pytest.mark.parametrize("staged", [b"TGL_STAGE", b"TGL_X", b"TGL_Z"])
def test_a_release_in_the_middle_of_a_move_leaves_nothing_staged(
    number: int, loses: bool, staged: bytes
) -> None:
    """Whatever of it has been sent; and though the frame that drops it is lost once."""
    desk = Desk()
    sent = lost = False

    def note(frame: bytes) -> bool:
        nonlocal sent
        sent = sent or staged in frame
        return False

    def lose_one(frame: bytes) -> bool:
        nonlocal lost
        is_first = loses and not lost and b"TGL_STAGE" in frame
        lost = lost or is_first
        return is_first

    desk.loses = note
    desk.orders.move("me", B)
    for _ in range(40):
        desk.run(SLICE_S)
        if sent:
            break
    assert sent
    assert desk.flown.onboard.settings.values["TGL_Z"] == pytest.approx(A.z_m)
    desk.loses = lose_one
    desk.orders.command("me", number)
    desk.run(2.0)
    assert lost == loses
    assert desk.flown.value("TGL_STAGE") != 1.0
    assert not desk.flown.onboard.parameters.line.staged
    assert desk.orders.line() == pytest.approx(A)
    desk.orders.move("me", A._replace(lean_deg=20.0))
    desk.run(2.0)
    assert desk.flown.value("TGL_LEAN") == pytest.approx(20.0)
    assert desk.flown.value("TGL_X") == pytest.approx(A.x_m)
    assert desk.flown.value("TGL_Z") == pytest.approx(A.z_m)


def test_a_station_that_is_no_operator_is_denied() -> None:
    desk = Desk()
    stranger = Station(1, 191, 99, None, 1.8e9)
    desk.station, desk.orders = stranger, Orders(stranger, desk.done.append)
    desk.run(3.0)
    desk.orders.command("me", ENGAGE)
    desk.run(2.0)
    assert desk.words[-1].startswith("engage: denied")
    assert desk.flown.value("OP_ENGAGE") == 0.0


def test_only_so_much_waits() -> None:
    desk = Desk()
    for i in range(WAITING + 1):
        desk.orders.set("me", "RHO_P", 0.5 + 0.001 * i)
    assert desk.words == [f"RHO_P = {0.5 + 0.001 * WAITING:g}: too much is waiting already"]
