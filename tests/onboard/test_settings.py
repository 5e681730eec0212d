"""A changed parameter: what follows at once, what waits for the next tick, and what is notified."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from test_module import setup

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.link.engagement import Engagement
from tgl_soar.link.messages import ID_RC_CHANNELS, ParamSet, RcChannels, Source
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.telemetry import StatusTexts
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.settings import FlightSettings

# Its surroundings only record calls, which native code refuses.
pytestmark = pytest.mark.interpreted

STATION = Source(255, 190)
LOW_US = 1100  # of a switch


class Scene:
    """The settings, and what they reported to others."""

    def __init__(self, **values: float) -> None:
        self.reported: list[tuple[str, float]] = []
        self.rates_hz: list[tuple[str, float]] = []
        self.logged: list[ParameterSet] = []
        self.streams = StreamRequests(1)
        self.engagement, self.counters = Engagement(), Counters()
        outbox: Any = SimpleNamespace(
            say_all=self._say_all, texts=StatusTexts(), telemetry_bytes_per_s=0.0
        )
        self.outbox = outbox
        session: Any = SimpleNamespace(
            streams=self.streams,
            set_loop_rate=lambda hz: self.rates_hz.append(("session", hz)),
        )
        pacer: Any = SimpleNamespace(set_rate=lambda hz: self.rates_hz.append(("pacer", hz)))
        recorder: Any = SimpleNamespace(parameters=self.logged.append)
        self.settings = FlightSettings(
            setup()._replace(parameters=ParameterSet().changed(values)),
            session,
            pacer,
            self.engagement,
            outbox,
            recorder,
            self.counters,
        )

    def _say_all(self, messages: Any) -> None:
        self.reported += [(m.param_id, m.param_value) for m in messages]

    def set(self, name: str, value: float) -> None:
        """By a station, through the server."""
        message = ParamSet(
            target_system=1, target_component=191, param_id=name, param_value=value, param_type=9
        )
        self.settings.server.handle(STATION, message, 10.0, flying=False)
        self.settings.changed()


def test_from_the_start_all_that_follows_from_the_values_stands() -> None:
    scene = Scene(TEL_BUDGET=1234.0, OP_RC_CHAN=7.0)
    assert scene.outbox.telemetry_bytes_per_s == 1234.0
    assert [values["TEL_BUDGET"] for values in scene.logged] == [1234.0]
    assert scene.streams.wanted(ID_RC_CHANNELS) is not None
    assert not scene.settings.engage
    assert scene.rates_hz == []


def test_a_change_by_the_module_itself_is_in_force_at_once_and_sent_to_every_station() -> None:
    scene = Scene()
    scene.settings.assign("TEL_BUDGET", 5000.0)
    assert scene.reported == [("TEL_BUDGET", 5000.0)]
    assert scene.outbox.telemetry_bytes_per_s == 5000.0
    assert scene.settings.values["TEL_BUDGET"] == 5000.0


def test_a_staged_move_that_is_dropped_is_sent_to_every_station() -> None:
    scene = Scene()
    scene.set("TGL_STAGE", 1.0)
    scene.set("TGL_X", 0.25)
    assert scene.settings.server.line.staged == {"TGL_X": 0.25}
    scene.settings.drop_staged()
    assert ("TGL_X", 0.0) in scene.reported
    assert dict(scene.reported)["TGL_STAGE"] == 2.0  # which is: dropped
    assert scene.settings.values["TGL_STAGE"] == 2.0


# --- laws -----------------------------------------------------------------------------------------


def test_the_next_tick_flies_with_new_laws_once_however_many_parameters_were_set() -> None:
    scene = Scene()
    before = scene.settings.laws
    scene.settings.renew_laws()
    assert scene.settings.laws is before  # nothing was set
    scene.set("TGL_CAPTURE", 0.07)
    scene.set("TGL_CAPTURE", 0.08)
    assert scene.settings.laws is before  # a tick may be under way
    scene.settings.renew_laws()
    renewed = scene.settings.laws
    assert renewed is not before
    assert renewed != before
    assert scene.counters.laws_changed == 1
    assert [round(values["TGL_CAPTURE"], 2) for values in scene.logged[1:]] == [0.08]
    scene.settings.renew_laws()
    assert scene.settings.laws is renewed
    assert scene.counters.laws_changed == 1


# --- the loop's rate ------------------------------------------------------------------------------


def test_another_rate_is_passed_to_loop_and_session_and_the_same_is_not() -> None:
    scene = Scene()
    scene.set("LOOP_RATE", 250.0)
    assert sorted(scene.rates_hz) == [("pacer", 250.0), ("session", 250.0)]
    scene.set("TGL_CAPTURE", 0.07)
    assert len(scene.rates_hz) == 2


# --- engaging -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("value", "engages"), [(0.0, False), (1.0, True), (2.0, True)])
def test_whether_the_surfaces_are_asked_for(value: float, engages: bool) -> None:
    """2 is what OP_ENGAGE reads in flight."""
    scene = Scene()
    scene.settings.assign("OP_ENGAGE", value)
    assert scene.settings.engage is engages
    assert scene.settings.op_engage == value


def test_what_overrides_a_refusal_acts_once() -> None:
    scene = Scene()
    scene.settings.assign("OP_FORCE", 1.0)
    assert scene.settings.values["OP_FORCE"] == 1.0  # engaging uses it up, and nothing else
    scene.reported.clear()
    scene.settings.assign("OP_ENGAGE", 1.0)
    assert scene.reported == [("OP_ENGAGE", 1.0), ("OP_FORCE", 0.0)]
    assert scene.settings.values["OP_FORCE"] == 0.0


def test_engaging_without_an_override_says_nothing_of_it() -> None:
    scene = Scene()
    scene.settings.assign("OP_ENGAGE", 1.0)
    assert scene.reported == [("OP_ENGAGE", 1.0)]


def test_engaged_already_an_override_waits_for_what_it_was_set_for() -> None:
    scene = Scene()
    scene.settings.assign("OP_ENGAGE", 1.0)
    scene.settings.assign("OP_FORCE", 1.0)
    scene.settings.assign("OP_ENGAGE", 2.0)
    assert scene.settings.values["OP_FORCE"] == 1.0


# --- the pilot's switch ---------------------------------------------------------------------------


def test_the_pilots_channels_are_asked_for_before_all_else_where_one_is_a_switch_of_ours() -> None:
    scene = Scene()
    scene.streams.want(30, "ATTITUDE", 50.0)
    scene.set("OP_RC_CHAN", 1.0)  # the lowest channel there is
    stream, other = scene.streams.all_wanted()
    assert (stream.message_id, stream.name) == (ID_RC_CHANNELS, "RC_CHANNELS")
    assert other.name == "ATTITUDE"
    # The way out of a flight: a pilot's hand takes a tenth of a second, and ten in a row may fail
    # before a silence is reported after one second (`link.engagement`).
    assert stream.rate_hz == 10.0


def channels(pulse_us: int, stamp_ms: int) -> RcChannels:
    return RcChannels(18, (pulse_us,) * 18, stamp_ms)


def test_without_a_switch_nobody_is_held_back_by_what_it_was_last() -> None:
    scene = Scene(OP_RC_CHAN=7.0)
    switch = scene.engagement.switch
    switch.take(channels(LOW_US, 1000), 1.0, 7, 1700.0, 1300.0)
    scene.set("TGL_CAPTURE", 0.07)
    assert switch.is_low  # it stands
    scene.set("OP_RC_CHAN", 0.0)
    assert not switch.is_low
    assert scene.engagement.held_back() == ""
