"""The operator of the simulated flight, with the module's side of the wire played by hand."""

from __future__ import annotations

from math import inf, isfinite, isnan, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.operator import Operator, OperatorError, PlannedLeg

LEG = PlannedLeg("a", {"TGL_X": 0.25, "TGL_Z": 1.5, "TGL_LEAN": 15.0}, stay_s=2.0)


class Module:
    """Component 191 of vehicle 1, as far as an operator can see it."""

    def __init__(self, operator: Operator) -> None:
        self.operator = operator
        self.codec = mavlink.MAVLink(None, 1, 191)
        self.received = mavlink.MAVLink(None)
        self.received.robust_parsing = True
        self.sets: list[tuple[str, float]] = []
        self.values: dict[str, float] = {}
        self.line_follows = True
        self.obeys = True
        self.loses = 0  # so many sets are lost on the way
        self.mode = 4.0
        self.slides_mps = inf  # the line, along x
        self._x_m, self._time_s = 0.0, 0.0

    def say(self, message: Any) -> None:
        self.operator.receive(bytes(message.pack(self.codec)))

    def second(self, time_s: float) -> None:
        """One look at the telemetry, one step of the operator, and the answers."""
        boot_ms = round(time_s * 1e3)
        self.say(self.codec.heartbeat_encode(18, 8, 0, 0, 4))
        shown = {"soar_x": 0.0, "soar_mode": self.mode}
        target_m, most_m = self.values.get("TGL_X", 0.0), self.slides_mps * (time_s - self._time_s)
        self._x_m = min(target_m, self._x_m + most_m) if isfinite(most_m) else target_m
        self._x_m = nan if isnan(self.slides_mps) else self._x_m
        self._time_s = time_s
        if self.line_follows:
            shown |= {
                "line_x": self._x_m,
                "line_z": self.values.get("TGL_Z", 0.0),
                "line_lean": self.values.get("TGL_LEAN", 0.0),
            }
        for name, value in shown.items():
            self.say(self.codec.named_value_float_encode(boot_ms, name.encode(), value))
        for data in self.operator.step(time_s):
            for message in self.received.parse_buffer(bytearray(data)) or ():
                if message.get_type() == "PARAM_SET":
                    self._set(message)

    def _set(self, message: Any) -> None:
        assert (message.target_system, message.target_component) == (1, 191)
        assert message.param_type == mavlink.MAV_PARAM_TYPE_REAL32
        self.sets.append((message.param_id, message.param_value))
        if self.loses > 0:
            self.loses -= 1
            return
        if self.obeys:
            self.values[message.param_id] = message.param_value
        value = self.values.get(message.param_id, -1.0)
        self.say(self.codec.param_value_encode(message.param_id.encode(), value, 9, 50, 0))


def run(module: Module, seconds: float) -> None:
    run_on(module, 0.0, seconds)


def run_on(module: Module, from_s: float, seconds: float) -> None:
    for i in range(round(seconds * 20)):
        if module.operator.done:
            return
        module.second(from_s + i * 0.05)


def test_called_again_without_news_it_does_nothing() -> None:
    """So a lockstep flight does not depend on how often a slow machine calls."""
    module = Module(Operator([LEG, LEG], 1, 191))
    for i in range(400):
        if module.operator.done:
            break
        module.second(i * 0.05)
        if module.sets and module.sets[-1][0] in module.operator.telemetry.parameters:
            module.operator.step(i * 0.05)  # the answers were news
        assert module.operator.step(i * 0.05) == []
    assert module.operator.done


def test_it_sets_the_line_engages_waits_and_is_done() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    run(module, 20.0)
    assert operator.done
    assert [name for name, _ in module.sets] == ["TGL_X", "TGL_Z", "TGL_LEAN", "OP_ENGAGE"]
    flown = operator.flown[0]
    assert flown.asked_s >= 1.0  # it has looked at the position for a second first
    assert flown.ended_s - flown.stopped_s == pytest.approx(2.0, abs=0.06)


def test_where_it_is_set_to_it_waits_until_the_vehicle_is_armed() -> None:
    operator = Operator([LEG], 1, 191, when_armed=True)
    module = Module(operator)
    autopilot = mavlink.MAVLink(None, 1, 1)
    run(module, 5.0)
    assert module.sets == []
    operator.receive(bytes(autopilot.heartbeat_encode(1, 12, 128 | 1, 0, 4).pack(autopilot)))
    for i in range(600, 1000):
        module.second(0.01 * i)
    assert ("OP_ENGAGE", 1.0) in module.sets


@pytest.mark.parametrize(
    ("texts", "why"),
    [
        (["Preflight Fail: Airspeed invalid\t", "EKF3 active"], "Preflight Fail: Airspeed invalid"),
        (["PreArm: RC not found", "PreArm: GPS 1: Bad fix"], "PreArm: GPS 1: Bad fix"),
        (["a", "b", "c", "d"], "b; c; d"),
        (["b", "c", "d", "d", "d"], "b; c; d"),
        ([], "nothing"),
    ],
)
def test_a_vehicle_that_is_never_armed_is_not_waited_for_for_ever(
    texts: list[str], why: str
) -> None:
    operator = Operator([LEG], 1, 191, when_armed=True)
    operator.telemetry.texts = texts
    operator.telemetry.time_s = 180.0
    operator.step(0.0)
    operator.telemetry.time_s = 180.1
    with pytest.raises(OperatorError, match=f"^not armed 180 s after its start: {why}$"):
        operator.step(1.0)
    Operator([LEG], 1, 191).step(1.0)  # one that need not be armed


def test_a_lost_set_is_sent_again() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.loses = 3
    run(module, 20.0)
    assert operator.done
    assert [name for name, _ in module.sets].count("TGL_X") == 4


def test_a_refused_set_is_reported_with_the_modules_words() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.obeys = False
    module.say(module.codec.statustext_encode(4, b"TGL_X = 0.25: not t", 7, 0))
    module.say(module.codec.statustext_encode(4, b"oday", 7, 1))
    with pytest.raises(OperatorError, match=r"TGL_X = 0.25 was not confirmed.*not today"):
        run(module, 30.0)


def test_a_line_that_never_arrives_ends_the_flight() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.line_follows = False
    with pytest.raises(OperatorError, match="did not come to its target"):
        run(module, 60.0)


def test_a_line_that_is_on_its_way_is_waited_for() -> None:
    """Over a large hill lines lie tens of metres apart, and one slides at 0.3 m/s."""
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.slides_mps = LEG.parameters["TGL_X"] / 70.0
    run(module, 80.0)
    assert operator.done
    assert operator.flown[0].stopped_s - operator.flown[0].asked_s > 60.0


def test_a_line_that_stops_on_its_way_ends_the_flight() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.slides_mps = LEG.parameters["TGL_X"] / 70.0
    run(module, 30.0)
    module.slides_mps = 0.0
    with pytest.raises(OperatorError, match="did not come to its target within 40 s"):
        run_on(module, 30.0, 45.0)


def test_a_line_that_is_no_number_does_not_move() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    module.slides_mps = nan
    with pytest.raises(OperatorError, match="did not come to its target within 40 s"):
        run(module, 60.0)


def test_a_module_that_disengages_ends_the_flight() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    run(module, 2.0)
    module.say(module.codec.statustext_encode(3, b"released: position lost"))
    module.say(module.codec.param_value_encode(b"OP_ENGAGE", 0.0, 9, 50, 0))
    with pytest.raises(OperatorError, match=r"disengaged by itself: .*position lost"):
        run(module, 2.0)


def released(module: Module, reason: str, seconds: float, *, ready: bool = True) -> None:
    """The module disengages, says so a moment later, and is ready again after a second."""
    begun = module.operator.telemetry.time_s
    module.values["OP_ENGAGE"] = 0.0
    module.say(module.codec.param_value_encode(b"OP_ENGAGE", 0.0, 9, 50, 0))
    module.mode = 1.0
    for i in range(1, round(seconds * 20) + 1):
        if i == 4:
            module.say(module.codec.statustext_encode(3, f"released: {reason}".encode()))
        if i == 20 and ready:
            module.mode = 2.0
        if not module.operator.done:
            module.second(begun + i * 0.05)


def test_what_is_set_with_a_leg_and_is_not_its_line_is_not_waited_for() -> None:
    leg = PlannedLeg("a", {**LEG.parameters, "TGL_HOLD": 1.0}, stay_s=2.0)
    operator = Operator([leg], 1, 191)
    module = Module(operator)
    run(module, 10.0)
    assert operator.done
    assert ("TGL_HOLD", 1.0) in module.sets


def test_a_release_that_was_to_be_seen_is_watched_and_ends_well() -> None:
    operator = Operator([LEG], 1, 191, watch_s=3.0)
    module = Module(operator)
    run(module, 2.0)
    released(module, "autopilot in failsafe", 2.0)
    assert not operator.done
    before = operator.telemetry.time_s
    released(module, "autopilot in failsafe", 2.0)
    assert operator.done
    assert operator.flown[0].ended_s <= before
    assert module.sets.count(("OP_ENGAGE", 1.0)) == 1


def test_after_a_hiccup_of_the_machine_the_leg_is_flown_again() -> None:
    operator = Operator([LEG, LEG], 1, 191, again=1)
    module = Module(operator)
    run(module, 5.0)  # on the second leg
    assert len(operator.flown) == 2
    first = operator.flown[0]
    engaged = module.sets.count(("OP_ENGAGE", 1.0))
    released(module, "attitude lost", 10.0)
    assert operator.done
    assert operator.hiccups == ["released: attitude lost"]
    assert module.sets.count(("OP_ENGAGE", 1.0)) == engaged + 1
    assert operator.flown[0] is first
    assert len(operator.flown) == 2
    assert operator.flown[1].ended_s - operator.flown[1].stopped_s >= LEG.stay_s


def test_it_engages_again_only_so_often_and_only_after_a_hiccup() -> None:
    operator = Operator([LEG] * 9, 1, 191, again=1)
    module = Module(operator)
    run(module, 3.0)
    released(module, "attitude lost", 3.0)
    with pytest.raises(OperatorError, match=r"disengaged by itself: .*attitude lost"):
        released(module, "attitude lost", 3.0)
    operator = Operator([LEG], 1, 191, again=1)
    module = Module(operator)
    run(module, 3.0)
    with pytest.raises(OperatorError, match=r"disengaged by itself: .*outside the fence"):
        released(module, "outside the fence", 3.0)


def test_a_module_that_does_not_become_ready_again_is_not_waited_for_for_ever() -> None:
    operator = Operator([LEG], 1, 191, again=1)
    module = Module(operator)
    run(module, 3.0)
    with pytest.raises(OperatorError, match="not ready again within 60 s"):
        released(module, "position lost", 62.0, ready=False)


def test_a_line_moved_by_another_station_is_noted_and_flown_on() -> None:
    operator = Operator([LEG], 1, 191)
    module = Module(operator)
    run(module, 2.5)
    assert operator.flown[0].stopped_s > 0.0
    module.values["TGL_Z"] = 1.7
    module.say(module.codec.param_value_encode(b"TGL_Z", 1.7, 9, 50, 0))
    for i in range(50, 100):
        module.second(i * 0.05)
    assert operator.done
    flown = operator.flown[0]
    assert flown.by_hand
    assert flown.found == {
        "TGL_X": pytest.approx(LEG.parameters["TGL_X"]),
        "TGL_Z": pytest.approx(1.7),
        "TGL_LEAN": pytest.approx(LEG.parameters["TGL_LEAN"]),
    }
    assert 2.5 <= flown.moved_s <= 2.6


def test_a_line_that_nobody_has_moved_is_the_legs_own() -> None:
    operator = Operator([LEG], 1, 191)
    run(Module(operator), 6.0)
    assert (operator.flown[0].found, operator.flown[0].moved_s) == ({}, -inf)


def test_it_answers_the_lockstep_barrier_and_ignores_other_vehicles() -> None:
    operator = Operator([LEG], 1, 191)
    bridge = mavlink.MAVLink(None, 1, 1)
    operator.receive(bytes(bridge.timesync_encode(0, 12345).pack(bridge)))
    other = mavlink.MAVLink(None, 2, 191)
    operator.receive(bytes(other.heartbeat_encode(18, 8, 0, 0, 4).pack(other)))
    received = mavlink.MAVLink(None)
    answers = [m for data in operator.step(0.0) for m in received.parse_buffer(bytearray(data))]
    assert [m.ts1 for m in answers if m.get_type() == "TIMESYNC"] == [12345]
    assert not operator.telemetry.module_alive


def test_garbage_is_no_news() -> None:
    operator = Operator([LEG], 1, 191)
    operator.receive(b"\xfd\x09\x00" + bytes(range(256)))
    assert operator.telemetry.values == {}
