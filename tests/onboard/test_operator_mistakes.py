"""The whole module in closed loop with the simulated Pixhawk, and an operator who slips."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard import engage_switch
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import needs_of, setup_from
from tgl_soar.sim.simulation import Options, Simulation

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
READY, SOARING = 2, 4
COMPANION = 1


class Flight:
    """In lockstep, without sockets: what one sends the other receives at once."""

    def __init__(self, **parameters: float) -> None:
        """`parameters`: of the simulated Pixhawk."""
        airframe, site = load_airframe(AIRFRAME), load_site(SITE)
        self.simulation = Simulation(
            airframe, site, Options(parameters=tuple(parameters.items())), SITE.parent
        )
        self.simulation.add_link(COMPANION, ground=False)
        self.simulation.pixhawk.set_pace(COMPANION)
        values = load_parameters(airframe, AIRFRAME, site, SITE)
        self.onboard = Onboard(
            setup_from(airframe, site, values),
            self._send,
            0.0,
            ModuleOptions(lockstep=True, console=self._reported),
        )
        self.words: list[str] = []  # on the console
        self.texts: list[str] = []  # STATUSTEXT
        self._codec = mavlink.MAVLink(None, 255, 190)

    def _send(self, frame: bytes) -> bool:
        if int.from_bytes(frame[7:10], "little") == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            message = mavlink.MAVLink(None).decode(bytearray(frame))
            if message.chunk_seq:
                self.texts[-1] += message.text
            else:
                self.texts.append(message.text)
        self.simulation.receive(COMPANION, frame)
        return True

    def _reported(self, text: str) -> None:
        self.words.append(text)

    def run(self, seconds: float) -> None:
        simulation, onboard = self.simulation, self.onboard
        for _ in range(round(seconds * simulation.pixhawk.step_hz)):
            simulation.step()
            onboard.idle(simulation.time_s)
            for _, data in simulation.pixhawk.take_datagrams():
                onboard.event(bytes(data), simulation.time_s)

    def station(self, message: Any) -> None:
        frame = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self.onboard.event(bytes(frame), self.simulation.time_s)

    def set(self, name: str, value: float) -> float:
        """As a ground station does; what stands after it."""
        self.station(mavlink.MAVLink_param_set_message(1, 191, name.encode(), value, 9))
        return self.onboard.parameters.values[name]

    @property
    def mode(self) -> int:
        return -1 if self.onboard.output is None else self.onboard.output.mode

    @property
    def is_active(self) -> bool:
        return self.onboard.output is not None and self.onboard.output.active

    @property
    def place(self) -> tuple[float, float]:
        assert self.onboard.output is not None
        vehicle = self.onboard.output.vehicle
        return vehicle.x_m, vehicle.z_m


def soaring() -> Flight:
    flight = Flight()
    flight.run(5.0)
    flight.set("OP_ENGAGE", 1)
    flight.run(10.0)
    assert flight.mode == SOARING
    return flight


SLIPS = (
    ("TGL_Z", 17.0, "outside the fence (FENCE_Z_MAX is 2.85 m)"),
    ("TGL_X", 400.0, "outside the fence (FENCE_X_MAX is 2.25 m)"),
    ("TGL_X", -0.6, "outside the fence (FENCE_X_MIN is -0.5 m)"),
    ("TGL_Z", 0.25, "0.15 m from the ground (CLEAR_MIN is 0.3 m)"),
)
BOUNDS = (("FENCE_Z_MIN", 2.6), ("CLEAR_MIN", 2.0))  # that shut the line out


def test_slips_are_refused_and_the_flight_goes_on_where_it_was() -> None:
    """One after the other in one flight: none leaves anything behind for the next."""
    flight = soaring()
    there, changes = flight.place, dict(flight.onboard.counters.mode_changes)
    for name, slip, why in SLIPS:
        before = flight.onboard.parameters.values[name]
        assert flight.set(name, slip) == before
        flight.run(0.1)
        refusal = f"{name} = {slip:g}: the line's point is {why}; OP_FORCE 1 overrides once"
        assert flight.texts[-1] == refusal
    for name, value in BOUNDS:
        before = flight.onboard.parameters.values[name]
        assert flight.set(name, value) == before
        flight.run(0.1)
        assert flight.texts[-1].startswith(f"{name} = {value:g}: ")
        assert flight.texts[-1].endswith("; OP_FORCE 1 overrides once")
    flight.run(8.0)  # its own fence dropped it after six
    assert flight.mode == SOARING
    assert flight.onboard.counters.mode_changes == changes
    # Calm air: it stays where it was to the noise of its fixes.
    assert flight.place == pytest.approx(there, abs=0.1)


def test_forced_it_goes_there_and_is_dropped_by_the_fence() -> None:
    """What the refusal is for: the same flight without it."""
    flight = soaring()
    flight.set("OP_FORCE", 1)
    assert flight.set("TGL_Z", 17.0) == 17.0
    assert flight.onboard.parameters.values["OP_FORCE"] == 0.0
    flight.run(12.0)
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert any(text.startswith("released") for text in flight.words)


def test_a_bound_that_shuts_the_line_out_passes_by_force() -> None:
    """As the refusal says that it does; the first pulls the aircraft nowhere within a tick."""
    flight = soaring()
    for name, value in BOUNDS:
        before = flight.onboard.parameters.values[name]
        flight.set("OP_FORCE", 1)
        assert flight.set(name, value) == pytest.approx(value)
        assert flight.onboard.parameters.values["OP_FORCE"] == 0.0
        flight.set("OP_FORCE", 1)
        assert flight.set(name, before) == pytest.approx(before)


# --- what the autopilot must be set to --------------------------------------------------------


@cache
def names_read() -> frozenset[str]:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    setup = setup_from(airframe, site, values)
    rows = setup.flavour.requirements(needs_of(airframe, site, values))
    return frozenset(name for row in rows if row.level == "must" for name in row.names)


def test_overrides_that_time_out_too_late_hold_the_engagement_back_until_they_are_mended() -> None:
    flight = Flight(RC_OVERRIDE_TIME=3.0)
    flight.run(8.0)
    assert [text for text in flight.words if text.startswith("cannot be engaged")] == [
        "cannot be engaged: set RC_OVERRIDE_TIME to at most 0.5, it is 3: the surfaces"
        " keep the last command for so long when the module falls silent"
    ]
    assert flight.set("OP_ENGAGE", 1) == 0.0
    flight.run(0.5)
    assert flight.mode == READY
    flight.simulation.pixhawk.parameters.set("RC_OVERRIDE_TIME", 0.5)
    flight.set("OP_ENGAGE", 1)  # its copy is old: it is asked for again
    flight.run(1.0)
    assert flight.set("OP_ENGAGE", 1) == 1.0
    flight.run(0.5)
    assert flight.is_active


def test_an_autopilot_that_is_not_set_up_is_engaged_all_the_same_by_force_which_acts_once() -> None:
    flight = Flight(RC_OVERRIDE_TIME=3.0)
    flight.run(8.0)
    flight.set("OP_FORCE", 1)
    assert flight.set("OP_ENGAGE", 1) == 1.0
    assert flight.onboard.parameters.values["OP_FORCE"] == 0.0
    flight.run(0.5)
    assert flight.is_active
    assert flight.set("OP_ENGAGE", 1) == 1.0  # repeated: it flies already
    flight.set("OP_ENGAGE", 0)
    flight.run(2.0)
    assert flight.set("OP_ENGAGE", 1) == 0.0


@pytest.mark.interpreted
def test_a_force_that_nothing_has_used_is_over_before_the_next_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert engage_switch.FORCE_S == 60.0  # as docs/safety.md says
    monkeypatch.setattr(engage_switch, "FORCE_S", 4.0)
    flight = Flight(RC_OVERRIDE_TIME=3.0)
    flight.run(8.0)
    flight.set("OP_FORCE", 1)
    flight.run(3.0)
    assert flight.onboard.parameters.values["OP_FORCE"] == 1.0
    flight.run(2.0)
    assert flight.onboard.parameters.values["OP_FORCE"] == 0.0
    assert any(text.startswith("OP_FORCE is 0 again") for text in flight.words)
    assert flight.set("OP_ENGAGE", 1) == 0.0


def test_a_pilot_s_command_is_held_back_with_the_same_words() -> None:
    flight = Flight(RC_OVERRIDE_TIME=3.0)
    flight.run(8.0)
    flight.station(mavlink.MAVLink_command_long_message(1, 191, 31010, 0, *(0.0,) * 7))
    flight.run(0.5)
    assert flight.mode == READY
    assert any(
        text.startswith("command refused: set RC_OVERRIDE_TIME to at most 0.5")
        and text.endswith("OP_FORCE 1 overrides once")
        for text in flight.words
    )


def test_a_well_set_up_autopilot_is_read_once_and_changed_never() -> None:
    flight = Flight()
    asked: list[str] = []
    sent = flight._send

    def tap(frame: bytes) -> bool:
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        if message.get_type() == "PARAM_REQUEST_READ":
            asked.append(message.param_id)
        assert message.get_type() != "PARAM_SET"
        return sent(frame)

    flight.onboard.outbox.routes[0].send = tap
    flight.run(20.0)
    there = {name for name in names_read() if name in flight.simulation.pixhawk.parameters}
    assert len(there) > 20
    assert all(asked.count(name) == 1 for name in there)
    assert not any("cannot be engaged" in text or "not known" in text for text in flight.words)
