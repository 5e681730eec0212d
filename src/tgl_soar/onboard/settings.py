"""The parameters in force, and what follows from them.

A changed parameter takes effect between two ticks, as one: the next tick flies with new laws,
however many were set since the last one.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.config.line_changes import LineChanges
from tgl_soar.link.engagement import Engagement
from tgl_soar.link.messages import ID_RC_CHANNELS
from tgl_soar.link.parameter_server import ParameterServer
from tgl_soar.link.session import Session
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import Recorder
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.pacing import Pacer
from tgl_soar.onboard.setup import ModuleSetup, bounds_of, laws_of

PILOT_SWITCH_HZ: Final = 10.0


class FlightSettings:
    """What the module flies with now."""

    def __init__(
        self,
        setup: ModuleSetup,
        session: Session,
        pacer: Pacer,
        engagement: Engagement,
        outbox: Outbox,
        recorder: Recorder,
        counters: Counters,
    ) -> None:
        bounds = bounds_of(setup, setup.contour)
        line = LineChanges(
            setup.presets, bounds.fault, setup.contour, bounds.ringing, bounds.warning
        )
        self.server = ParameterServer(setup.own, setup.parameters, outbox.texts, line)
        self.values = self.server.values
        self.laws = laws_of(setup, self.values)
        self.op_engage = 0.0  # of the values
        self.engage = False  # whether it asks for the surfaces
        self._setup = setup
        self._session = session
        self._pacer = pacer
        self._engagement = engagement
        self._outbox = outbox
        self._recorder = recorder
        self._counters = counters
        self._laws_stale = False
        self._take()
        recorder.parameters(self.values)

    def assign(self, name: str, value: float) -> None:
        """A change made by the module itself; every station is sent it."""
        self._outbox.say_all(self.server.assign(name, value))
        self.changed()

    def drop_staged(self) -> None:
        """A staged move is given up by the module itself; every station is sent it."""
        self._outbox.say_all(self.server.drop_staged())
        self.changed()

    def changed(self) -> None:
        """The server has other values: they count from here on."""
        server = self.server
        engages = server.values["OP_ENGAGE"] >= 0.5 and not self.engage
        if engages and server.values["OP_FORCE"] != 0.0:  # it acts once
            self._outbox.say_all(server.assign("OP_FORCE", 0.0))
        before_hz, rate_hz = self.values["LOOP_RATE"], server.values["LOOP_RATE"]
        if rate_hz != before_hz:
            self._session.set_loop_rate(rate_hz)
            self._pacer.set_rate(rate_hz)
        self.values = server.values
        self._laws_stale = True
        self._take()

    def renew_laws(self) -> None:
        """Before a tick, once for however many parameters were set since the last one."""
        if not self._laws_stale:
            return
        self._laws_stale = False
        self._recorder.parameters(self.values)
        self.laws = laws_of(self._setup, self.values)
        self._counters.laws_changed += 1

    def _take(self) -> None:
        """What follows from the values at once."""
        values = self.values
        self.op_engage = values["OP_ENGAGE"]
        self.engage = self.op_engage >= 0.5
        self._outbox.telemetry_bytes_per_s = values["TEL_BUDGET"]
        # The stream of the pilot's channels, where one of them is a switch of ours.
        if values["OP_RC_CHAN"] > 0.0:
            streams = self._session.streams
            streams.want(ID_RC_CHANNELS, "RC_CHANNELS", PILOT_SWITCH_HZ, urgent=True)
        else:
            self._engagement.switch.reset()
