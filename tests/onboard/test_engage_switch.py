"""OP_ENGAGE moment by moment: who may turn it, what turns it back, and what is reported of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.config.line_changes import OVERRIDE
from tgl_soar.control import supervisor as modes
from tgl_soar.link.commands import ABORT, ENGAGE, NOTHING, RELEASE
from tgl_soar.link.engagement import Engagement, PilotSwitch
from tgl_soar.link.messages import (
    ID_RC_CHANNELS,
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    Heartbeat,
    RcChannels,
    Source,
)
from tgl_soar.link.presence import Presence
from tgl_soar.onboard.engage_switch import EngageSwitch
from tgl_soar.onboard.gnss_watch import GnssWatch
from tgl_soar.onboard.station_watch import StationWatch

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies

Switch: Any = EngageSwitch
OWN, STATION, OTHER = Source(1, 191), Source(255, 190), Source(254, 190)
ON, OFF, MIDDLE = 1900, 1100, 1500


class Bench:
    """All that stands around the switch, as a test sets it."""

    def __init__(self) -> None:
        self.values = {"OP_RC_CHAN": 0.0, "OP_RC_ON": 1700.0, "OP_RC_OFF": 1300.0}
        self.values |= {"OP_FORCE": 0.0, "OP_ENGAGE": 0.0, "OP_GCS_LOSS": 0.0, "OP_GCS_S": 5.0}
        self.values |= {"GPS_ACC_H": 0.0, "GPS_ACC_V": 0.0}
        self.texts: list[tuple[int, str]] = []
        self.console_words: list[str] = []
        self.beats = self.asked_again = 0
        self.asked: list[dict[str, bool]] = []
        self.line_fault = self.held_back = ""
        self.received: list[int] = []
        self.is_active = False
        self.accuracy = (float("nan"), float("nan"))
        self.counts = True
        self.engagement = Engagement()
        self.presence = Presence(5)
        self.presence.mode = modes.READY
        session = SimpleNamespace(
            presence=self.presence,
            receiver=SimpleNamespace(counts=True, known=lambda _: self.accuracy),
            inquiry=SimpleNamespace(held_back=lambda: self.held_back, ask_again=self._ask_again),
            streams=SimpleNamespace(received=self.received.append),
            heartbeat=self._beat,
        )
        self.server = SimpleNamespace(line=SimpleNamespace(fault=lambda _: self.line_fault))
        commands = SimpleNamespace(engagement=self._engagement)
        self.switch = Switch(OWN, self, session, self.engagement, commands, self, self, 0.0)

    @property
    def engage(self) -> bool:
        return self.values["OP_ENGAGE"] != 0.0

    @property
    def op_engage(self) -> float:
        return self.values["OP_ENGAGE"]

    def _ask_again(self) -> None:
        self.asked_again += 1

    def _beat(self) -> str:
        self.beats += 1
        return "beat"

    def _engagement(self, **how: bool) -> list[Any]:
        self.asked.append(how)
        return []

    def say(self, message: Any) -> None:
        assert message == "beat"

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value

    def tell(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    def console(self, text: str) -> None:
        self.console_words.append(text)

    def flies(self, mode: int = modes.SOARING) -> Bench:
        self.presence.mode, self.is_active = mode, True
        self.values["OP_ENGAGE"] = 1.0
        return self

    def lands(self, mode: int = modes.READY) -> None:
        self.presence.mode, self.is_active = mode, False

    def pulse(self, now_s: float, pulse_us: int, stamp_ms: int = 0) -> None:
        channels = (1500, 1500, 1500, 1500, pulse_us)
        self.switch.take_pilot_switch(RcChannels(5, channels, stamp_ms), now_s)


@pytest.fixture
def bench() -> Bench:
    return Bench()


# --- may it -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        (modes.READY, ""),
        (modes.STANDBY, ""),
        (modes.RELEASED, "it has just disengaged"),
        (modes.FAILED, "it has failed"),
    ],
)
def test_the_mode_says_whether_it_can_be_engaged(bench: Bench, mode: int, why: str) -> None:
    bench.presence.mode = mode
    found = bench.switch.refusal(10.0)
    assert found.startswith(why)
    assert bool(found) == bool(why)


@pytest.mark.parametrize(
    ("after_s", "may"), [(0.0, False), (3.99, False), (4.01, True), (-1.0, True)]
)
def test_what_asked_for_this_engagement_does_not_ask_for_the_next(
    bench: Bench, after_s: float, may: bool
) -> None:
    bench.flies().switch.turn_back(100.0)
    assert not bench.engage
    bench.lands()
    found = bench.switch.refusal(100.0 + after_s)
    assert found == ("" if may else "it has disengaged by itself: try again after 4 s")
    bench.values["OP_ENGAGE"] = 1.0  # engaged again meanwhile
    assert bench.switch.refusal(100.0 + after_s) == ""


def test_a_refused_entry_may_be_tried_again_at_once(bench: Bench) -> None:
    bench.values["OP_ENGAGE"] = 1.0
    bench.switch.turn_back(100.0)
    assert bench.switch.refusal(100.1) == ""


@pytest.mark.parametrize("by", [STATION, None])
@pytest.mark.parametrize(
    ("after_s", "late"), [(0.0, False), (3.99, False), (4.01, True), (-1.0, True)]
)
def test_who_has_released_may_engage_again_and_others_later(
    bench: Bench, by: Source | None, after_s: float, late: bool
) -> None:
    bench.flies().switch.released(100.0, by)
    bench.values["OP_ENGAGE"] = 0.0
    bench.lands()
    now_s = 100.0 + after_s
    for station in (STATION, OTHER):
        refused = station != by and not late
        words = "somebody else has released: try again after 4 s"
        assert bench.switch.refusal(now_s, station) == (words if refused else "")
    assert bench.switch.refusal(now_s) == ""  # the pilot


@pytest.mark.parametrize("released_s", [101.0, 200.0])
def test_after_an_abort_and_its_release_others_engage_later(
    bench: Bench, released_s: float
) -> None:
    """What another station repeats must not undo an abort either."""
    bench.flies().switch.turn(ABORT, "system 255", 100.0, STATION)
    bench.lands()
    bench.switch.turn(RELEASE, "system 255", released_s, STATION)
    words = "somebody else has released: try again after 4 s"
    assert bench.switch.refusal(released_s + 3.99, OTHER) == words
    assert bench.switch.refusal(released_s + 3.99, STATION) == ""
    assert bench.switch.refusal(released_s + 4.01, OTHER) == ""


def test_who_releases_what_was_not_engaged_keeps_nobody_waiting(bench: Bench) -> None:
    bench.switch.released(100.0, STATION)
    assert bench.switch.refusal(100.1, OTHER) == ""


def duplicate(mode: int = 0, start: int = 9) -> Heartbeat:
    return Heartbeat(
        type=18, autopilot=8, base_mode=1, custom_mode=start << 8 | mode, system_status=4
    )


def test_beside_a_duplicate_nobody_engages_and_who_flies_flies_on(bench: Bench) -> None:
    bench.switch.meet_duplicate(duplicate(), 100.0)
    assert bench.switch.refusal(100.1).startswith("another module has our identity")
    assert bench.switch.refusal(105.1) == ""
    bench.is_active = True
    assert bench.switch.refusal(100.1) == ""


def test_only_who_asks_to_engage_has_the_autopilot_asked_again(bench: Bench) -> None:
    assert (bench.switch.request_refusal(1.0), bench.asked_again) == ("", 0)
    bench.held_back = "not set up"
    words = f"not set up; {OVERRIDE}"
    assert (bench.switch.refusal(1.0), bench.asked_again) == (words, 0)
    assert (bench.switch.request_refusal(1.0), bench.asked_again) == (words, 1)


def test_what_is_unfit_is_refused_but_for_who_forces_it_or_flies(bench: Bench) -> None:
    bench.values["GPS_ACC_H"], bench.accuracy = 2.0, (3.0, 1.0)
    refusal = bench.switch.refusal
    assert refusal(1.0) == f"receiver uncertain by 3.0 m: above GPS_ACC_H; {OVERRIDE}"
    bench.held_back = "not set up"
    assert refusal(1.0) == f"not set up; {OVERRIDE}"
    bench.line_fault = "the line is out"
    assert refusal(1.0) == f"the line is out; {OVERRIDE}"
    bench.values["OP_FORCE"] = 1.0
    assert refusal(1.0) == ""
    bench.values["OP_FORCE"], bench.values["OP_ENGAGE"] = 0.0, 1.0
    assert refusal(1.0) == ""
    # A refusal that OP_FORCE does not override.
    bench.values["OP_FORCE"], bench.values["OP_GCS_LOSS"] = 1.0, 1.0
    assert refusal(1.0).startswith("no ground station for 5 s")
    bench.engagement.abort("system 9")
    assert refusal(1.0).startswith("aborted by system 9")
    bench.values["OP_RC_CHAN"] = 5.0
    assert refusal(1.0) == "the pilot's switch: no RC_CHANNELS are received (OP_RC_CHAN = 5)"


# --- turned -------------------------------------------------------------------------------------


def test_engaged_and_released_it_is_shown_and_reported_on_the_console(bench: Bench) -> None:
    bench.switch.turn(ENGAGE, "system 255", 10.0, STATION)
    assert (bench.op_engage, bench.asked) == (1.0, [])
    bench.switch.turn(ENGAGE, "system 255", 10.1, STATION)  # again: how does it go?
    assert bench.asked == [{"flying": False, "settled": False, "withdrawn": True}]
    bench.flies()
    bench.switch.turn(RELEASE, "system 255", 11.0, STATION)
    assert bench.op_engage == 0.0
    bench.switch.turn(RELEASE, "system 255", 11.0, STATION)
    bench.switch.turn(NOTHING, "system 255", 11.0, STATION)
    assert bench.console_words == ["engaged by system 255", "released by system 255"]
    assert bench.texts == []
    assert len(bench.asked) == 1


def test_an_abort_holds_back_until_a_release(bench: Bench) -> None:
    bench.flies()
    bench.switch.turn(ABORT, "system 9", 10.0, STATION)
    assert bench.op_engage == 0.0
    words = "aborted by system 9: no engagement until released"
    assert bench.texts == [(SEVERITY_WARNING, words)]
    bench.lands()
    assert bench.switch.refusal(99.0).startswith("aborted by system 9")
    bench.switch.turn(RELEASE, "system 255", 100.0, STATION)
    assert bench.switch.refusal(101.0) == ""


@pytest.mark.parametrize("request_", [RELEASE, ABORT])
@pytest.mark.parametrize("flying", [False, True])
def test_an_engagement_whose_mode_has_not_come_is_withdrawn(
    bench: Bench, request_: int, flying: bool
) -> None:
    bench.values["OP_ENGAGE"] = 1.0
    bench.presence.mode = modes.SOARING if flying else modes.READY
    bench.switch.turn(request_, "system 9", 10.0, STATION)
    assert len(bench.asked) == (0 if flying else 1)


@pytest.mark.parametrize(
    ("mode", "flying", "settled", "withdrawn"),
    [
        (modes.BOOT, False, False, True),
        (modes.STANDBY, False, False, True),
        (modes.READY, False, False, True),
        (modes.CAPTURING, True, False, False),
        (modes.SOARING, True, True, False),
        (modes.RELEASED, False, False, False),
    ],
)
def test_progress_is_reported_to_the_station_that_engaged(
    bench: Bench, mode: int, flying: bool, settled: bool, withdrawn: bool
) -> None:
    bench.presence.mode = mode
    bench.switch.report_progress()
    bench.switch.report_progress(ended=True)
    assert bench.asked == [
        {"flying": flying, "settled": settled, "withdrawn": withdrawn},
        {"flying": False, "settled": False, "withdrawn": False},
    ]


@pytest.mark.parametrize("engaged", [False, True])
def test_a_mode_that_does_not_come_ends_the_engagement(bench: Bench, engaged: bool) -> None:
    bench.values["OP_ENGAGE"] = float(engaged)
    bench.switch.mode_change_failed("no mode", 10.0)
    assert bench.texts == [(SEVERITY_ERROR, "no mode")]
    assert bench.op_engage == 0.0
    assert len(bench.asked) == int(engaged)
    assert bool(bench.switch.refusal(10.1)) == engaged  # a station's repeat is ignored


# --- what it shows ------------------------------------------------------------------------------


@pytest.mark.parametrize(("after_s", "shown"), [(0.99, 1.0), (1.01, 2.0)])
def test_engaged_for_a_second_it_shows_what_engages_nothing_from_a_file(
    bench: Bench, after_s: float, shown: float
) -> None:
    bench.switch.show_engaged(100.0)
    bench.flies()
    bench.switch.show_engaged(100.0 + after_s)
    assert bench.op_engage == shown
    bench.switch.show_engaged(200.0)
    assert bench.op_engage == 2.0
    bench.lands()
    bench.values["OP_ENGAGE"] = 1.0
    bench.switch.show_engaged(300.0)
    assert bench.op_engage == 1.0


@pytest.mark.parametrize(("after_s", "over"), [(59.9, False), (60.1, True)])
def test_a_force_that_nothing_uses_within_a_minute_is_over(
    bench: Bench, after_s: float, over: bool
) -> None:
    bench.switch.end_force(100.0)
    bench.values["OP_FORCE"] = 1.0
    bench.switch.end_force(100.0 + after_s)
    assert (bench.values["OP_FORCE"] == 0.0) == over
    words = "OP_FORCE is 0 again: nothing was forced within 60 s"
    assert bench.texts == ([(SEVERITY_WARNING, words)] if over else [])


def test_with_another_clock_nothing_that_was_timed_counts(bench: Bench) -> None:
    bench.flies().switch.turn_back(1000.0)
    bench.values["OP_FORCE"] = 1.0
    bench.lands()
    bench.switch.restart(5.0)
    assert bench.switch.refusal(5.0) == ""
    bench.switch.end_force(64.9)
    assert bench.values["OP_FORCE"] == 1.0
    bench.flies().switch.show_engaged(5.9)
    assert bench.op_engage == 1.0
    bench.switch.released(5.0, STATION)
    bench.switch.restart(5.0)
    bench.values["OP_ENGAGE"] = 0.0
    bench.lands()
    assert bench.switch.refusal(5.0, OTHER) == ""


# --- the pilot's switch -------------------------------------------------------------------------


def with_switch(bench: Bench) -> Bench:
    bench.values["OP_RC_CHAN"] = 5.0
    return bench


def test_from_low_to_high_it_engages_and_low_it_releases(bench: Bench) -> None:
    with_switch(bench).pulse(10.0, ON)
    assert not bench.engage  # it was high when it was received first
    bench.pulse(10.1, OFF)
    assert bench.switch.refusal(10.1) == "the pilot's switch is low (OP_RC_CHAN)"
    bench.pulse(10.2, MIDDLE)
    assert not bench.engage
    assert bench.switch.refusal(10.2) == ""
    bench.pulse(10.3, ON)
    assert bench.engage
    assert bench.console_words == ["engaged by the pilot's switch"]
    bench.pulse(10.4, OFF)
    bench.pulse(10.5, OFF)
    assert not bench.engage
    assert bench.console_words[1:] == ["released by the pilot's switch"]
    assert bench.received == [ID_RC_CHANNELS] * 6


def test_a_switch_that_cannot_engage_says_why(bench: Bench) -> None:
    with_switch(bench).pulse(10.0, OFF)
    bench.presence.mode = modes.FAILED
    bench.pulse(10.1, ON)
    words = "the pilot's switch cannot engage: it has failed: start it again"
    assert bench.texts == [(SEVERITY_WARNING, words)]
    assert not bench.engage


def test_a_switch_that_goes_low_takes_an_abort_back_and_one_that_stays_low_does_not(
    bench: Bench,
) -> None:
    with_switch(bench).pulse(10.0, OFF)
    bench.engagement.abort("system 9")
    bench.pulse(10.1, OFF)
    bench.pulse(10.2, MIDDLE)
    assert "aborted" in bench.switch.refusal(10.2)
    bench.pulse(10.3, OFF)
    bench.pulse(10.4, MIDDLE)
    assert bench.switch.refusal(10.4) == ""


@pytest.mark.parametrize(
    ("silent_s", "is_reported", "ends"),
    [(0.99, False, False), (1.01, True, False), (3.01, False, True)],
)
def test_a_switch_that_falls_silent_in_flight_is_reported_and_ends_it(
    bench: Bench, silent_s: float, is_reported: bool, ends: bool
) -> None:
    with_switch(bench).pulse(10.0, MIDDLE)
    bench.flies()
    for _ in range(2):
        bench.switch.watch_pilot_switch(10.0 + silent_s)
    why = "no RC_CHANNELS are received (OP_RC_CHAN = 5)"
    warned = (SEVERITY_WARNING, f"the pilot's switch is silent, disengaging in 2 s: {why}")
    ended = (SEVERITY_ERROR, f"disengaged: the pilot's switch is silent: {why}")
    assert bench.texts == [warned] * is_reported + [ended] * ends
    assert bench.engage != ends


def test_a_silence_is_reported_again_after_the_switch_was_there(bench: Bench) -> None:
    with_switch(bench).pulse(10.0, MIDDLE)
    bench.flies()
    for now_s in (11.5, 12.0):
        bench.switch.watch_pilot_switch(now_s)
    bench.pulse(12.1, MIDDLE)
    bench.switch.watch_pilot_switch(12.2)
    bench.switch.watch_pilot_switch(13.5)
    assert len(bench.texts) == 2
    bench.lands()
    bench.values["OP_ENGAGE"] = 0.0
    bench.switch.watch_pilot_switch(99.0)  # on the ground nothing is reported
    assert len(bench.texts) == 2


@pytest.mark.parametrize(
    ("channels", "count", "channel", "why"),
    [
        ((1500,) * 5, 5, 5, ""),
        ((1500,) * 5, 4, 5, "RC_CHANNELS have 4 channels (OP_RC_CHAN = 5)"),
        ((1500,) * 5, 5, 6, "RC_CHANNELS have 5 channels (OP_RC_CHAN = 6)"),
        ((1500,) * 5, 9, 6, "RC_CHANNELS have 5 channels (OP_RC_CHAN = 6)"),
        ((1500,) * 4 + (699,), 5, 5, "no pulses on its channel: 699 us (OP_RC_CHAN = 5)"),
        ((1500,) * 4 + (700,), 5, 5, ""),
        ((1500,) * 4 + (2300,), 5, 5, ""),
        ((1500,) * 4 + (2301,), 5, 5, "no pulses on its channel: 2301 us (OP_RC_CHAN = 5)"),
        ((1500,) * 4 + (0,), 5, 1, ""),
    ],
)
def test_a_switch_is_a_channel_with_pulses(
    channels: tuple[int, ...], count: int, channel: int, why: str
) -> None:
    switch = PilotSwitch()
    switch.take(RcChannels(count, channels), 10.0, channel, 1700.0, 1300.0)
    assert switch.missing(10.1, channel) == why
    assert switch.missing(10.1, 0) == ""
    assert switch.missing(11.1, channel) == (
        f"no RC_CHANNELS are received (OP_RC_CHAN = {channel})"
    )
    assert "no RC_CHANNELS" in switch.missing(10.1, 7)


def test_a_low_before_a_silence_primes_nothing() -> None:
    for gap_s, engages in ((0.99, ENGAGE), (1.01, NOTHING)):
        switch = PilotSwitch()
        taken = [
            switch.take(RcChannels(5, (0, 0, 0, 0, pulse)), now_s, 5, 1700.0, 1300.0)
            for pulse, now_s in ((OFF, 10.0), (ON, 10.0 + gap_s), (ON, 10.1 + gap_s))
        ]
        assert taken == [RELEASE, engages, NOTHING]


@pytest.mark.parametrize(
    ("first_ms", "then_ms", "late"),
    [
        *((90_000, 90_001, False), (90_000, 90_000, True), (90_000, 89_000, True)),
        (90_000, 30, False),  # it has restarted
        *((90_000, 0, False), (0, 50, False)),  # no stamp
        *((2**32 - 10, 5, False), (5, 2**32 - 10, True)),  # they begin again
    ],
)
def test_a_low_that_a_later_message_has_overtaken_is_not_taken(
    first_ms: int, then_ms: int, late: bool
) -> None:
    switch = PilotSwitch()
    switch.take(RcChannels(1, (MIDDLE,), first_ms), 10.0, 1, 1700.0, 1300.0)
    found = switch.take(RcChannels(1, (OFF,), then_ms), 10.1, 1, 1700.0, 1300.0)
    assert found == (NOTHING if late else RELEASE)
    assert switch.is_low != late
    if late:  # the newest stays the one that later ones are compared with
        again = switch.take(RcChannels(1, (OFF,), first_ms), 10.2, 1, 1700.0, 1300.0)
        assert again == NOTHING


# --- another module -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("engage", "active", "theirs", "ends"),
    [
        (True, True, modes.SOARING, True),
        (True, True, modes.READY, False),
        (True, False, modes.READY, True),
        (False, False, modes.SOARING, False),
    ],
)
def test_of_two_modules_one_flies_or_none(
    bench: Bench, engage: bool, active: bool, theirs: int, ends: bool
) -> None:
    bench.flies()
    bench.values["OP_ENGAGE"], bench.is_active = float(engage), active
    bench.switch.meet_duplicate(duplicate(theirs), 100.0)
    who = "another module is system 1, component 191, too"
    both = " and engaged" if theirs == modes.SOARING else ""
    if ends:
        assert bench.texts == [(SEVERITY_ERROR, f"disengaged: {who}{both}")]
    else:
        assert bench.texts[0][0] == SEVERITY_WARNING
        assert bench.texts[0][1].startswith(f"{who}: stop one")
    assert bench.beats == int(ends)
    assert bench.engage == (engage and not ends)


def test_a_duplicate_is_reported_every_ten_seconds_and_our_own_echo_never(bench: Bench) -> None:
    for now_s, count in ((100.0, 1), (109.9, 1), (110.1, 2), (50.0, 3)):
        bench.switch.meet_duplicate(duplicate(), now_s)
        assert len(bench.texts) == count
    bench.switch.meet_duplicate(duplicate(start=5), 200.0)
    assert len(bench.texts) == 3


# --- stations and receiver ----------------------------------------------------------------------


@pytest.mark.parametrize(("loss", "ends"), [(0.0, False), (1.0, True), (2.0, False)])
def test_a_station_that_falls_silent_in_flight(bench: Bench, loss: float, ends: bool) -> None:
    bench.flies().values["OP_GCS_LOSS"] = loss
    bench.switch.stations.received(100.0)
    bench.switch.watch(104.9)
    assert bench.texts == []
    for now_s in (105.1, 106.0):
        bench.switch.watch(now_s)
    words = "no ground station for 5 s"
    expected = [(SEVERITY_ERROR, f"disengaged: {words}")]
    assert bench.texts == (expected if ends else [(SEVERITY_WARNING, f"{words}: flying on")])
    assert bench.engage != ends
    bench.texts.clear()
    bench.switch.stations.received(107.0)
    assert bench.texts == ([] if ends else [(SEVERITY_INFO, "a ground station is there again")])


def test_a_station_is_asked_for_where_its_loss_counts(bench: Bench) -> None:
    stations: Any = StationWatch
    watch = stations(bench, bench)
    assert watch.refusal(10.0) == ""
    for loss in (1.0, 2.0):
        bench.values["OP_GCS_LOSS"] = loss
        assert watch.refusal(10.0).startswith("no ground station for 5 s")
    watch.received(10.0)
    assert watch.refusal(14.9) == ""
    assert watch.refusal(15.1) != ""
    watch.restart()
    bench.values |= {"OP_ENGAGE": 1.0, "OP_GCS_LOSS": 2.0}
    assert watch.look(11.0) == ""
    assert bench.texts == []  # there was none: nothing was lost
    watch.received(12.0)
    assert bench.texts == [(SEVERITY_INFO, "a ground station is there again")]


def test_a_receiver_that_becomes_worse_is_reported_until_it_is_a_fifth_better(
    bench: Bench,
) -> None:
    bench.values |= {"GPS_ACC_H": 2.0, "GPS_ACC_V": 3.0, "OP_ENGAGE": 1.0}
    worse = (SEVERITY_WARNING, "receiver uncertain by 2.1 m: above GPS_ACC_H")
    better = (SEVERITY_INFO, "the receiver is accurate enough again")
    watch: Any = GnssWatch
    receiver = SimpleNamespace(counts=True, known=lambda _: bench.accuracy)
    gnss = watch(bench, receiver, bench)
    for accuracy, texts in (
        *(((1.9, 2.9), []), ((2.1, 2.9), [worse]), ((1.7, 2.9), []), ((1.61, 2.0), [])),
        *(((1.59, 2.39), [better]), ((1.5, 2.9), [])),
    ):
        bench.texts.clear()
        bench.accuracy = accuracy
        for _ in range(2):
            gnss.look(1.0)
        assert bench.texts == texts
    bench.accuracy = (1.0, 3.1)
    assert gnss.refusal(1.0) == "receiver uncertain by 3.1 m up: above GPS_ACC_V"
    bench.values["GPS_ACC_V"] = 0.0  # asks for nothing
    assert gnss.refusal(1.0) == ""
    bench.values["GPS_ACC_V"] = 3.0
    gnss.look(1.0)
    bench.values["OP_ENGAGE"] = 0.0
    gnss.look(1.0)
    bench.values["OP_ENGAGE"] = 1.0
    bench.texts.clear()
    gnss.look(1.0)  # another flight
    assert len(bench.texts) == 1
    receiver.counts = False
    assert gnss.refusal(1.0) == ""
