"""From a log's rows to the inputs of each tick, and from its outputs to rows again, plain and by a
kernel: what both make of the same ticks is the same."""

from __future__ import annotations

from math import inf, isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.logs.ulog_reader import FlightLog
from tgl_soar.analysis.replay import logged as module
from tgl_soar.analysis.replay.compiled_ticks import OUTPUT_LEAVES, plain_ticks
from tgl_soar.analysis.replay.logged import ReplayError
from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.onboard.flightlog.topics import (
    STREAMS,
    TOPICS,
    flattener,
    rebuilt,
    record_size,
    rows_type,
)
from tgl_soar.types import NO_AIRSPEED, NO_ATTITUDE, NO_IMU, NO_RANGE, NO_SURFACES, Inputs

COUNT = 6
TICKS = np.arange(101, 101 + COUNT)
SIZE = record_size("tick")
X = "vehicle_x_m"  # one that is logged in single precision


def position(ticks: list[int]) -> dict[str, Any]:
    """Fixes that came before these ticks: the n-th has n + 1 wherever it is a number."""
    rows: dict[str, Any] = {
        leaf.name: np.array([n + 1 for n in range(len(ticks))]).astype(leaf.kind)
        for leaf in TOPICS["position"].leaves
    }
    return {"tick": np.array(ticks), **rows}


def log(**topics: Any) -> FlightLog:
    return FlightLog(path=Path("my.ulg"), topics=topics, parameters={})


def tick(**changes: Any) -> dict[str, Any]:
    given = {"time_s": 0.005 * TICKS, "engage": TICKS > 103}
    return {**given, **changes}


def flight(made: FlightLog, ticks: dict[str, Any] | None = None) -> Any:
    columns = module._columns(made, tick() if ticks is None else ticks, TICKS)
    return module._Flight(
        ticks=TICKS, stamps=(5000 * TICKS).astype(np.uint64), inputs=columns, cuts={},
        changed=False, kernel=None,
    )  # fmt: skip


def same(one: Any, other: Any) -> bool:
    return len(one) == len(other) and all(
        a == b or (a != a and b != b) for a, b in zip(one, other, strict=True)
    )


# --- inputs ---------------------------------------------------------------------------------------


def test_a_tick_has_the_newest_row_that_came_by_then() -> None:
    """Rows carry the tick that had them first: two before the log's own, one at 103, two at 105."""
    made = flight(log(position=position([90, 99, 103, 105, 105])))
    found = module._inputs(made, 0, COUNT)
    assert [each.position.sequence for each in found] == [2, 2, 3, 3, 5, 5]
    assert [each.position.down_m for each in found] == [2.0, 2.0, 3.0, 3.0, 5.0, 5.0]
    assert [each.time_s for each in found] == (0.005 * TICKS).tolist()
    assert [each.engage for each in found] == [False, False, False, True, True, True]
    assert all(isinstance(each, Inputs) for each in found)
    part = module._inputs(made, 2, 5)
    assert [each.position.sequence for each in part] == [3, 3, 5]
    assert [each.time_s for each in part] == (0.005 * TICKS[2:5]).tolist()


def test_before_any_row_there_is_none() -> None:
    found = module._inputs(flight(log(position=position([104]))), 0, COUNT)
    assert [each.position.sequence for each in found] == [0, 0, 0, 1, 1, 1]
    assert isnan(found[0].position.north_m)
    assert same(found[0].attitude, NO_ATTITUDE)
    assert isnan(found[0].autopilot.time_s)
    assert (found[0].autopilot.accepts_surfaces, found[0].autopilot.armed) == (False, False)
    assert same(found[0].imu, NO_IMU)
    assert same(found[0].airspeed, NO_AIRSPEED)
    assert same(found[0].surfaces, NO_SURFACES)
    assert same(found[0].rangefinder, NO_RANGE)


def test_kinds_are_those_of_the_tuples() -> None:
    first = module._inputs(flight(log(position=position([90]))), 0, 1)[0]
    assert (type(first.position.sequence), type(first.position.north_m)) == (int, float)
    assert type(first.engage) is bool


def test_a_plain_input_that_the_log_lacks_is_no_number() -> None:
    ticks = {"time_s": 0.005 * TICKS}
    found = module._inputs(flight(log(), ticks), 0, COUNT)
    assert [isnan(each.engage) for each in found] == [True] * COUNT


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_of_another_layout_is_refused(name: str) -> None:
    rows = {leaf.name: np.zeros(1) for leaf in TOPICS[name].leaves}
    last = TOPICS[name].leaves[-1].name
    del rows[last]
    topics: Any = {name: {"tick": np.array([90]), **rows}}
    with pytest.raises(ReplayError, match=rf"another layout: no {last} in {name}"):
        module._columns(log(**topics), tick(), TICKS)


def test_states_are_read_with_their_ticks_and_whether_they_are_new() -> None:
    leaves = TOPICS["state"].leaves
    rows: dict[str, Any] = {
        leaf.name: np.array([n, n + 1]).astype(leaf.kind) for n, leaf in enumerate(leaves)
    }
    rows |= {"tick": np.array([7, 15]), "reset": np.array([True, False])}
    notes: list[str] = []
    (_, _, one), (_, _, other) = found = module._states(log(state=rows), notes)
    assert [each[:2] for each in found] == [(7, True), (15, False)]
    assert notes == []
    for k, state in enumerate((one, other)):
        assert isinstance(state, AutopilotState)
        assert list(flattener(leaves)(state)) == [rows[leaf.name][k] for leaf in leaves]


# --- rows -----------------------------------------------------------------------------------------


def decided(laws: Any, state: Any, inputs: Inputs) -> Any:
    """Outputs of which each has its own number, beyond the largest in one of the ticks."""
    numbers = [
        (k + int(inputs.engage)) % 2 if leaf.kind is not float else laws + inputs.time_s + k
        for k, leaf in enumerate(OUTPUT_LEAVES)
    ]
    places = {leaf.name: k for k, leaf in enumerate(OUTPUT_LEAVES)}
    numbers[places["time_s"]] = inputs.time_s
    if state == 2:
        numbers[places[X]] = -1e39
    return state + 1, rebuilt(Output, iter(numbers))


def stretch(
    monkeypatch: pytest.MonkeyPatch, begin: int, end: int, *, kernel: bool, at: int = 0
) -> tuple[Any, Any]:
    """(the state that these ticks leave, their rows)."""
    monkeypatch.setattr(module, "step", decided)
    made = flight(log(position=position([99, 103])))
    if kernel:
        made = made._replace(kernel=plain_ticks(decided))
    rows = bytearray(SIZE * (end - begin + at))
    laws: Any = 1000.0
    state: Any = 0
    left = module._stretch(made, laws, state, begin, end, rows, at * SIZE)
    return left, np.frombuffer(bytes(rows), np.dtype(rows_type("tick")))


@pytest.mark.parametrize("kernel", [False, True])
def test_a_row_holds_the_ticks_number_stamp_inputs_and_outputs(
    monkeypatch: pytest.MonkeyPatch, kernel: bool
) -> None:
    left, rows = stretch(monkeypatch, 1, 5, kernel=kernel)
    assert left == 4
    assert rows["tick"].tolist() == [102, 103, 104, 105]
    assert rows["timestamp"].tolist() == [510_000, 515_000, 520_000, 525_000]
    assert rows["time_s"].tolist() == (0.005 * TICKS[1:5]).tolist()
    assert rows["engage"].tolist() == [0, 0, 1, 1]
    names = {leaf.name: k for k, leaf in enumerate(OUTPUT_LEAVES)}
    for field in TOPICS["tick"].fields[4:]:
        if field.name != X:
            for row, time_s, engage in zip(rows, 0.005 * TICKS[1:5], (0, 0, 1, 1), strict=True):
                k = names[field.name]
                whole = OUTPUT_LEAVES[k].kind is not float
                expected = (k + engage) % 2 if whole else 1000.0 + time_s + k
                assert float(row[field.name]) == pytest.approx(expected, rel=1e-6), field.name


@pytest.mark.parametrize("kernel", [False, True])
def test_beyond_the_largest_number_of_a_field_lies_infinity(
    monkeypatch: pytest.MonkeyPatch, kernel: bool
) -> None:
    _, rows = stretch(monkeypatch, 0, 4, kernel=kernel)
    assert np.isfinite(rows[X]).tolist() == [True, True, False, True]
    assert rows[X][2] == -inf
    assert np.isfinite(rows["vehicle_y_m"]).all()


@pytest.mark.parametrize("kernel", [False, True])
def test_rows_stand_behind_those_of_an_earlier_stretch(
    monkeypatch: pytest.MonkeyPatch, kernel: bool
) -> None:
    _, rows = stretch(monkeypatch, 3, 5, kernel=kernel, at=2)
    assert rows["tick"].tolist() == [0, 0, 104, 105]
    _, alone = stretch(monkeypatch, 3, 5, kernel=kernel)
    assert rows[2:].tobytes() == alone.tobytes()


def test_a_kernel_and_the_plain_laws_leave_the_same_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    _, plain = stretch(monkeypatch, 0, COUNT, kernel=False)
    _, made = stretch(monkeypatch, 0, COUNT, kernel=True)
    for field in TOPICS["tick"].fields:
        assert plain[field.name].tobytes() == made[field.name].tobytes(), field.name


def test_a_kernels_whole_numbers_end_at_their_fields_bounds() -> None:
    """Eight bits without a sign: 0 to 255; with one: -128 to 127."""
    places = {leaf.name: k for k, leaf in enumerate(OUTPUT_LEAVES)}

    def kernel(_laws: Any, state: Any, given: Any, taken: Any) -> Any:
        taken[:] = 0.0
        for k, number in enumerate((-1e9, -129.0, -128.0, 127.0, 256.0, 1e9)):
            taken[k, places["mode"]] = taken[k, places["soaring_saturated"]] = number
        assert len(given) == COUNT
        return state

    made = flight(log())._replace(kernel=kernel)
    rows = bytearray(SIZE * COUNT)
    nothing: Any = None
    module._stretch(made, nothing, nothing, 0, COUNT, rows, 0)
    found = np.frombuffer(bytes(rows), np.dtype(rows_type("tick")))
    assert found["mode"].tolist() == [0, 0, 0, 127, 255, 255]
    assert found["soaring_saturated"].tolist() == [-128, -128, -128, 127, 127, 127]
