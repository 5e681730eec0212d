"""What the module reports without being asked: numbers of the tick, its mode, load and trouble."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians
from typing import Final

from tgl_soar import autopilot
from tgl_soar.config.parameter_store import ParameterStore
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.forecast import SETTLES, UNKNOWN, forecast_words
from tgl_soar.control.point_hold import HOLDS, LINE_ONLY, POINT_TEXTS, RESTS
from tgl_soar.control.supervisor import FAILED, HOLDING, REASON_NOWHERE, RECOVERING, RELEASED
from tgl_soar.control.throttle import CALLED_TEXTS, CLOSED, NOT_CALLED, OFF, OPEN, USED_UP
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.session import Session
from tgl_soar.link.signing import Signing
from tgl_soar.onboard.clocking import Clocking
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import Recorder
from tgl_soar.onboard.heading_watch import HeadingWords
from tgl_soar.onboard.links import ModuleLinks
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.telemetry_values import Panel

LOAD_REPORT_S: Final = 10.0  # between two words about the same
FEWEST_REPORTED: Final = 10  # late ticks, or commands left out; fewer are not worth a word
KEPT_IS_DAMAGED: Final = "the signing timestamp that was kept is damaged: the clock is used instead"


class Reports:
    """What was reported, and when."""

    def __init__(
        self,
        session: Session,
        clocking: Clocking,
        links: ModuleLinks,
        outbox: Outbox,
        panel: Panel,
        recorder: Recorder,
        store: ParameterStore | None,
        first_words: Sequence[tuple[int, str]],
    ) -> None:
        """`first_words`: severity and text, reported once the autopilot is received."""
        self._session = session
        self._clocking = clocking
        self._links = links
        self._outbox = outbox
        self._panel = panel
        self._recorder = recorder
        self._store = store
        self._first_words = list(first_words)
        self._busy_s = self._slow_line_s = float("-inf")  # when reported last
        self._late = self._left_out = 0  # up to then
        self._words = (ForecastWords(), FrameWords(), ReckoningWords(), PointWords(), PowerWords())
        self._heading = HeadingWords()
        for _, text in self._first_words:
            outbox.console(text)

    def tell_words(self, now_s: float, values: ParameterSet) -> None:
        """What keeps parameters and the log has to say, and the first words."""
        if self._store is not None:
            for text in self._store.poll(values, now_s):
                self._outbox.tell(SEVERITY_WARNING, text)
        for text in self._recorder.poll():
            self._outbox.tell(SEVERITY_WARNING, text)
        if self._first_words and self._session.has_heartbeat:
            for severity, text in self._first_words:
                self._outbox.say_words(severity, text)
            self._first_words.clear()

    def show(
        self, output: autopilot.Output, now_s: float, counters: Counters, values: ParameterSet
    ) -> None:
        """The numbers of a tick, as telemetry, and what has changed with it, in words."""
        for words in self._words:
            self._outbox.tell_all(words.look(output))
        self._outbox.tell_all(self._heading.look(output, radians(values["VEER_MAX"])))
        session, sheds = self._session, self._clocking.load_shedding.no_telemetry
        self._links.measure_loss(now_s, self._clocking.pacer.counters, counters)
        loss, round_trip_s = self._links.loss, session.round_trip_s
        self._panel.look(output, session.vehicle_time_s, loss, round_trip_s)
        self._outbox.send_telemetry(now_s, sheds=sheds)

    def tell_load(self, now_s: float, left_out: int) -> None:
        """A computer or a line that does not keep up.  `left_out`: commands, since the start."""
        ticks = self._clocking.pacer.counters
        late = ticks.late + ticks.skipped - self._late
        is_due = not now_s < self._busy_s + LOAD_REPORT_S
        if is_due and self._clocking.load_shedding.no_telemetry and late >= FEWEST_REPORTED:
            self._busy_s, self._late = now_s, ticks.late + ticks.skipped
            self._outbox.tell(SEVERITY_WARNING, f"computer too busy: {late} ticks late")
        missing = left_out - self._left_out
        is_due = not now_s < self._slow_line_s + LOAD_REPORT_S
        if is_due and missing >= FEWEST_REPORTED:
            self._slow_line_s, self._left_out = now_s, left_out
            remedy = "raise its baud rate or lower LOOP_RATE"
            text = f"link too slow: {missing} commands left out; {remedy}"
            self._outbox.tell(SEVERITY_WARNING, text)


def mode_words(output: autopilot.Output) -> list[tuple[int, str]]:
    """What is to be said of a tick with another mode: severities and texts."""
    severity = SEVERITY_INFO
    if output.mode in (HOLDING, RECOVERING):
        severity = SEVERITY_WARNING
    elif output.mode in (RELEASED, FAILED):
        severity = SEVERITY_ERROR
    reason, name = autopilot.reason_text(output.reason), autopilot.mode_name(output.mode)
    words = [(severity, f"{name}: {reason}" if reason else name)]
    faults = autopilot.fault_text(output.health.faults)
    if severity != SEVERITY_INFO and faults:
        words.append((SEVERITY_WARNING, faults))
    forecast = forecast_words(output.forecast)
    if output.reason == REASON_NOWHERE and forecast:
        words.append((SEVERITY_WARNING, forecast))
    return words


class ForecastWords:
    """Reports once that no place to settle is foreseen, where that ends nothing; and its end."""

    def __init__(self) -> None:
        self._standing = UNKNOWN

    def look(self, output: autopilot.Output) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        standing, before = output.forecast.standing, self._standing
        self._standing = standing
        if standing == before or output.reason == REASON_NOWHERE:
            return []
        if standing > SETTLES:
            return [(SEVERITY_WARNING, f"no place to settle: {forecast_words(output.forecast)}")]
        if before > SETTLES and output.active:
            return [(SEVERITY_INFO, "a place to settle is foreseen again")]
        return []


class FrameWords:
    """Reports that the source of position has moved its frame in flight, and by how much."""

    def __init__(self) -> None:
        self._shift = (0.0, 0.0, 0.0)

    def look(self, output: autopilot.Output) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        quality, before = output.quality, self._shift
        self._shift = quality.shift_x_m, quality.shift_y_m, quality.shift_z_m
        if self._shift == before or not output.active:
            return []
        # Rounded before it is shown: no −0.0.
        x, y, z = (round(a - b, 1) + 0.0 for a, b in zip(self._shift, before, strict=True))
        moved = f"position was reset by {x:+.1f} {y:+.1f} {z:+.1f} m (x y z)"
        return [(SEVERITY_WARNING, f"{moved}: the line moves with it")]


class ReckoningWords:
    """Reports that the autopilot only dead reckons its position, and when that is over."""

    def __init__(self) -> None:
        self._reckoned = False

    def look(self, output: autopilot.Output) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        before, self._reckoned = self._reckoned, output.quality.reckoned_s > 0.0
        if self._reckoned == before or not output.active:
            return []
        if self._reckoned:
            return [(SEVERITY_WARNING, "position is only dead reckoned: fixes are missing")]
        return [(SEVERITY_INFO, "position is measured again")]


class PointWords:
    """Reports how the point on the line stands, when that changes."""

    def __init__(self) -> None:
        self._standing = LINE_ONLY

    def look(self, output: autopilot.Output) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        standing, before = output.point.standing, self._standing
        self._standing = standing
        if standing == before:
            return []
        good = standing in (LINE_ONLY, HOLDS, RESTS)
        severity = SEVERITY_INFO if good else SEVERITY_WARNING
        return [(severity, f"point: {POINT_TEXTS[standing]}")]


class PowerWords:
    """Reports why the throttle opens, that it is closed, and that its budget is used up."""

    def __init__(self) -> None:
        self._standing = OFF
        self._called = NOT_CALLED

    def look(self, output: autopilot.Output) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        now, standing, called = output.throttle, self._standing, self._called
        self._standing, self._called = now.standing, now.called
        if now.standing == OPEN and (standing != OPEN or called != now.called):
            if now.called == NOT_CALLED:
                return []
            return [(SEVERITY_WARNING, f"throttle: {CALLED_TEXTS[now.called]}")]
        if standing == now.standing or standing not in (OPEN, CLOSED):
            return []
        if now.standing == USED_UP:
            return [(SEVERITY_WARNING, f"throttle used up: {now.used_s:.1f} s")]
        if standing == OPEN:
            return [(SEVERITY_INFO, f"throttle closed: {now.used_s:.1f} s used")]
        return []


def start_faults(settings: FlightSettings, signing: Signing) -> list[tuple[int, str]]:
    """What stands against the flight from its start: severities and texts."""
    words: list[tuple[int, str]] = []
    if fault := settings.server.line.fault(settings.values):
        words.append((SEVERITY_WARNING, f"cannot be engaged: {fault}"))
    if signing.kept_is_damaged:
        words.append((SEVERITY_WARNING, KEPT_IS_DAMAGED))
    return words
