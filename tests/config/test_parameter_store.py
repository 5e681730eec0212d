"""Parameters kept over a restart, whatever happens to the disk."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tgl_soar.config import parameter_store
from tgl_soar.config.line_changes import PresetLine
from tgl_soar.config.parameter_files import read_file
from tgl_soar.config.parameter_store import (
    Identity,
    OtherVehicleError,
    ParameterStore,
    Restored,
    StoreError,
    old_state_file,
    read_state,
    restored,
    state_file,
    state_folder,
    state_text,
    to_keep,
)
from tgl_soar.config.parameters import ANCHORS, PITCH_GAINS, ParameterSet, as_wire_value

WHO = Identity("Glider", "Hill")
BASE = ParameterSet().changed({"RHO_P": 0.5})
PRESETS = (PresetLine("a", 1, 2, 15), PresetLine("b", 3, 4, 20))


def store(path: Path) -> ParameterStore:
    return ParameterStore(path, WHO, BASE, PRESETS)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "glider-hill.params"


def saved(path: Path, *changes: dict[str, float]) -> None:
    """Each of the changes written in its turn, by one process."""
    writing = store(path)
    writing.restore()
    for change in changes:
        writing.save(BASE.changed(change))


# --- what is kept -----------------------------------------------------------------------------


def test_a_folder_that_cannot_be_looked_at_is_reported_at_the_start(tmp_path: Path) -> None:
    kept = store(tmp_path / (300 * "n") / "vehicle.params")
    found = kept.restore()
    assert found.values == BASE
    assert "cannot be written: File name too long" in found.notes[-1]
    assert found.notes[-1].endswith("changed parameters are NOT stored")


@pytest.mark.parametrize("looking", [False, True])
def test_a_place_that_cannot_be_written_is_reported_at_the_start(looking: bool) -> None:
    """Not at the first change in flight; a reader needs no place to write."""
    unwritable = Path("/proc/none/vehicle.params")  # where no folder can be made
    kept = store(unwritable)
    found = kept.restore(looking=looking)
    assert found.values == BASE
    assert (kept.refused == "") is looking
    if looking:
        assert (found.notes, found.damaged) == ((), False)
    else:
        assert found.notes[-1].startswith(f"{unwritable}: cannot be written: No such file")
        assert found.notes[-1].endswith("changed parameters are NOT stored")
        assert found.damaged


def test_to_look_whether_it_can_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    file = tmp_path / "new" / "state" / "vehicle.params"
    assert store(file).restore() == Restored(BASE, {}, (), False)
    assert not (tmp_path / "new").exists()
    file.parent.mkdir(parents=True)
    assert store(file).refusal() == ""
    assert [*file.parent.iterdir()] == []


def test_only_what_differs_from_the_files_is_kept() -> None:
    changed = BASE.changed({"OP_ENGAGE": 1, "TGL_STAGE": 1, "RHO_P": 0.5, "TGL_X": 0.1})
    assert to_keep(changed, BASE) == {"TGL_X": as_wire_value(0.1)}


def test_gains_of_another_aircraft_than_the_declared_are_kept_as_one_set() -> None:
    """Where they are designed again, one of them alone would be relative to others."""
    own = BASE.changed({"RHO_SPEED": 9.2, "ELE_FREQ": 7.1, "RHO_P": 0.6})
    kept = to_keep(own.changed({"RHO_D": 0.3}), own)
    assert set(kept) == {*PITCH_GAINS, *ANCHORS}
    assert {"ELE_D_FILT", "RHO_DF_IMU", "ELE_LAG"} <= set(kept)
    assert "ELE_TRIM" not in kept
    assert kept["RHO_D"] == as_wire_value(0.3)
    sought_again = own.changed({"RHO_P": 1.4, "ELE_FREQ": 7.3, "ELE_P": 3.0})
    again, notes = restored(sought_again, kept, ())
    assert [again[name] for name in kept] == list(kept.values())
    assert notes == []
    assert to_keep(own.changed({"TGL_X": 0.1}), own) == {"TGL_X": as_wire_value(0.1)}
    assert set(to_keep(BASE.changed({"RHO_D": 0.3}), BASE)) == {"RHO_D"}


def test_a_gain_that_was_kept_without_its_aircraft_is_reported() -> None:
    own = BASE.changed({"RHO_SPEED": 9.2, "ELE_FREQ": 7.1})
    values, notes = restored(own, {"ELE_P_IMU": 12.0, "TGL_X": 0.1}, ())
    assert values["ELE_P_IMU"] == 12.0
    (note,) = notes
    assert note.startswith("ELE_P_IMU: kept without the aircraft they were for")
    assert "`tgl-soar params reset`" in note
    assert restored(own, {"TGL_X": 0.1}, ())[1] == []
    assert restored(BASE, {"ELE_P_IMU": 12.0}, ())[1] == []


def test_what_was_saved_is_what_the_next_start_has(path: Path) -> None:
    saved(path, {"TGL_X": 0.1, "RHO_D": 0.3})
    got = store(path).restore()
    assert got.values == BASE.changed({"TGL_X": 0.1, "RHO_D": 0.3})
    assert got.kept == {"TGL_X": as_wire_value(0.1), "RHO_D": as_wire_value(0.3)}
    assert (got.notes, got.damaged) == ((), False)
    # And a ground station reads it too.
    assert read_file(path).values == got.kept


def test_the_first_start_is_a_quiet_one(path: Path) -> None:
    assert store(path).restore() == (BASE, {}, (), False)
    assert not path.parent.exists()


def test_files_that_changed_meanwhile_show_through(path: Path) -> None:
    saved(path, {"TGL_X": 0.1})
    newer = ParameterStore(path, WHO, BASE.changed({"RHO_P": 0.9}), PRESETS)
    assert newer.restore().values == BASE.changed({"RHO_P": 0.9, "TGL_X": 0.1})


def test_a_kept_preset_is_on_its_line_or_none(path: Path) -> None:
    saved(path, {"TGL_PRESET": 2, "TGL_X": 3, "TGL_Z": 4, "TGL_LEAN": 20})
    assert store(path).restore().values["TGL_PRESET"] == 2.0
    moved = ParameterStore(path, WHO, BASE, (PRESETS[0], PresetLine("b", 9, 9, 20)))
    got = moved.restore()
    assert (got.values["TGL_PRESET"], got.values["TGL_X"]) == (0.0, 3.0)
    assert "TGL_PRESET = 0: the line stands where it stood" in got.notes[0]


def kept_text(rows: str) -> bytes:
    """A file with a good checksum and any rows."""
    good = state_text(WHO, {}).rpartition(b"# checksum: ")[0]
    text = good + rows.encode()
    return text + f"# checksum: {crc32(text):08x}\n".encode()


def test_what_is_unknown_or_out_of_range_by_now_is_passed_over_by_name(path: Path) -> None:
    path.parent.mkdir()
    rows = ("OLD_GAIN\t1", "RHO_P\t99", "OP_ENGAGE\t1", "TGL_STAGE\t1", "TGL_LEAN\t2", "TGL_X\t7")
    path.write_bytes(kept_text("".join(f"1\t191\t{row}\t9\n" for row in rows)))
    got = store(path).restore()
    assert got.values == BASE.changed({"TGL_X": 7})
    reported = "\n".join(got.notes)
    for words in (
        "OLD_GAIN: no such parameter",
        "RHO_P = 99: allowed 0 to 5",
        "OP_ENGAGE: never set from a file",
        "TGL_STAGE: never set from a file",
        "TGL_LEAN = 2: the line must lean upwind",
    ):
        assert words in reported
    assert path.exists()  # it is not damaged


@given(st.dictionaries(st.sampled_from([p.name for p, _ in BASE if p.in_files]), st.floats(0, 60)))
def test_any_kept_values_give_a_consistent_start(kept: dict[str, float]) -> None:
    values, notes = restored(BASE, kept, PRESETS)
    assert values.changed({}) == values
    for name, value in kept.items():
        assert values[name] == as_wire_value(value) or notes


# --- damage -----------------------------------------------------------------------------------


@settings(max_examples=300)
@given(st.data())
def test_any_damage_is_noticed(data: st.DataObject) -> None:
    """A changed, lost or added byte anywhere; the checksum finds every burst of up to 32 bits."""
    text = state_text(WHO, to_keep(BASE.changed({"TGL_X": 0.1, "RHO_D": 0.3}), BASE))
    at = data.draw(st.integers(0, len(text) - 1))
    other = bytes([data.draw(st.integers(0, 255).filter(lambda b: b != text[at]))])
    for damaged in (text[:at] + other + text[at + 1 :], text[:at], text + other):
        with pytest.raises(StoreError):
            read_state(damaged, WHO, "f")


@given(st.binary(max_size=300))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(StoreError):
        read_state(data, WHO, "f")


def test_a_damaged_file_gives_way_to_the_previous_one_with_loud_words(path: Path) -> None:
    saved(path, {"TGL_X": 1}, {"TGL_X": 2})
    path.write_bytes(path.read_bytes()[:-20])
    reader = store(path)
    got = reader.restore()
    assert got.values["TGL_X"] == 1.0
    assert got.damaged
    assert "checksum is wrong" in got.notes[0]
    assert f"{path}.previous: used in its place" in got.notes
    assert path.with_name(path.name + ".damaged").exists()
    # The next write does not put the damage over the good copy.
    reader.save(BASE.changed({"TGL_X": 3}))
    assert store(path).restore().values["TGL_X"] == 3.0
    assert read_file(f"{path}.previous").values["TGL_X"] == 1.0


def test_without_any_good_copy_the_files_values_are_used_and_the_loss_is_reported(
    path: Path,
) -> None:
    saved(path, {"TGL_X": 1}, {"TGL_X": 2})
    for copy in (path, path.with_name(path.name + ".previous")):
        copy.write_bytes(b"")
    got = store(path).restore()
    assert (got.values, got.kept, got.damaged) == (BASE, {}, True)
    assert "LOST" in got.notes[-1]


# --- of which vehicle -------------------------------------------------------------------------

OTHERS = (
    Identity("Other", "Hill"),
    Identity("Glider", "Other\nhill"),
    Identity("Glider", "Hill", system=2),
    Identity("Glider", "Hill", component=25),
)


def at(folder: Path, who: Identity) -> ParameterStore:
    """The store of a vehicle whose files are called airframe.toml and site.toml."""
    files = folder, "airframe.toml", "site.toml"
    return ParameterStore(state_file(*files, who), who, BASE, PRESETS, old_state_file(*files))


def old_text(who: Identity, kept: dict[str, float]) -> bytes:
    """A file as version 0.1.0 wrote it: no ids among its first lines."""
    lines = state_text(who, kept).rpartition(b"# checksum: ")[0].splitlines(keepends=True)
    text = b"".join(line for line in lines if not line.startswith(b"# vehicle: "))
    return text + f"# checksum: {crc32(text):08x}\n".encode()


@pytest.mark.parametrize("other", OTHERS)
def test_vehicles_of_files_of_the_same_name_have_each_their_own(
    tmp_path: Path, other: Identity
) -> None:
    for round_ in range(3):
        for who, gain in ((WHO, 0.7), (other, 0.9)):
            starting = at(tmp_path, who)
            got = starting.restore()
            assert not got.damaged
            assert got.values == (BASE.changed({"RHO_P": gain}) if round_ else BASE)
            starting.save(BASE.changed({"RHO_P": gain}))
    assert not list(tmp_path.glob("*.damaged"))


@pytest.mark.parametrize("other", OTHERS)
def test_a_first_start_beside_what_another_id_has_kept_is_reported(
    tmp_path: Path, other: Identity
) -> None:
    """As after the id in the airframe file was changed: its parameters seem to be gone."""
    at(tmp_path, other).save(BASE.changed({"RHO_P": 0.9}))
    at(tmp_path, WHO).save(BASE)
    at(tmp_path, WHO).forget()
    (tmp_path / "another-site-1-191-0123abcd.params").touch()
    got = at(tmp_path, WHO).restore()
    (kept,) = (path.name for path in tmp_path.glob("airframe-site-*.params"))
    assert got == (
        BASE, {}, (f"nothing is stored for system 1, component 191; not used: {kept}",), False
    )  # fmt: skip
    at(tmp_path, WHO).save(BASE.changed({"RHO_P": 0.7}))
    assert at(tmp_path, WHO).restore().notes == ()


@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("ending", ["", ".previous"])
def test_what_was_kept_for_another_vehicle_is_neither_flown_nor_written_over(
    path: Path, other: Identity, ending: str
) -> None:
    """As of a file that was copied to the path of ours."""
    file = path.with_name(path.name + ending)
    file.parent.mkdir()
    data = state_text(other, {"TGL_X": 1.0})
    with pytest.raises(OtherVehicleError):
        read_state(data, WHO, "f")
    file.write_bytes(data)
    if ending:
        path.write_bytes(state_text(WHO, {"RHO_D": 0.5}))
    flying = store(path)
    got = flying.restore()
    assert got.values == (BASE.changed({"RHO_D": 0.5}) if ending else BASE)
    if not ending:
        (note,) = got.notes
        assert "of another name or another MAVLink id: neither used nor written over" in note
    flying.start()
    (reported,) = settled(flying, flying_values(0), 0.0)
    assert f"{file.name} is another vehicle's: move it elsewhere" in reported
    flying.stop(flying_values(0))
    for change in (lambda: flying.save(BASE), flying.forget):
        with pytest.raises(FileExistsError):
            change()
    assert file.read_bytes() == data
    assert len(list(path.parent.iterdir())) == 1 + (ending != "")


@pytest.mark.parametrize("ending", ["", ".previous"])
def test_what_an_earlier_version_kept_is_taken_once(tmp_path: Path, ending: str) -> None:
    old = tmp_path / f"airframe-site.params{ending}"
    old.write_bytes(old_text(WHO, {"RHO_P": 0.75}))
    upgraded = at(tmp_path, WHO)
    got = upgraded.restore()
    assert got.values == BASE.changed({"RHO_P": 0.75})
    assert any(old.name in note for note in got.notes)
    upgraded.start()
    assert settled(upgraded, got.values, 0.0) == []  # what was read is written at once
    upgraded.stop(got.values)
    old.write_bytes(old_text(WHO, {"RHO_P": 0.8}))  # by an earlier version that was tried again
    again = at(tmp_path, WHO)
    assert again.restore() == (got.values, got.kept, (), False)
    assert again.forget()
    assert not old.exists()  # or it would come back
    assert at(tmp_path, WHO).restore() == (BASE, {}, (), False)


@pytest.mark.parametrize("other", OTHERS)
def test_what_an_earlier_version_kept_for_another_vehicle_stays_there(
    tmp_path: Path, other: Identity
) -> None:
    old = tmp_path / "airframe-site.params"
    old.write_bytes(old_text(other, {"RHO_P": 0.75}))
    ours = at(tmp_path, WHO)
    assert ours.restore() == (BASE, {}, (), False)
    ours.save(BASE.changed({"RHO_P": 0.9}))
    assert ours.forget()
    assert [file.name for file in tmp_path.iterdir()] == [old.name]
    assert at(tmp_path, other).restore().values["RHO_P"] == 0.75


def test_a_damaged_file_of_an_earlier_version_is_reported_and_left(tmp_path: Path) -> None:
    old = tmp_path / "airframe-site.params"
    old.write_bytes(old_text(WHO, {"RHO_P": 0.75})[:-3])
    got = at(tmp_path, WHO).restore()
    assert (got.values, got.damaged) == (BASE, True)
    assert "LOST" in got.notes[-1]
    assert [file.name for file in tmp_path.iterdir()] == [old.name]


# --- kill -9 ----------------------------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
from tgl_soar.config.parameter_store import Identity, ParameterStore
from tgl_soar.config.parameters import ParameterSet
base = ParameterSet()
store = ParameterStore(Path(sys.argv[1]), Identity("Glider", "Hill"), base)
n = int(store.restore().values["TGL_X"])
while True:
    n = n + 1 if n < 500 else 1
    store.save(base.changed({"TGL_X": n, "TGL_Z": n}))
    print(n, flush=True)
"""


def test_a_kill_at_any_moment_of_writing_leaves_a_good_copy(path: Path) -> None:
    """Killed in the middle of a write, again and again: what was reported as written is there."""
    for attempt in range(12):
        running = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
        )
        assert running.stdout is not None
        running.stdout.readline()  # it writes by now
        time.sleep(0.0037 * attempt)  # each time at another place of the cycle
        os.kill(running.pid, signal.SIGKILL)
        written = [int(line) for line in running.stdout.read().split()] or [0]
        running.wait()
        running.stdout.close()
        got = ParameterStore(path, WHO, ParameterSet()).restore()
        assert not got.damaged, got.notes
        now = int(got.values["TGL_X"])
        assert got.values["TGL_Z"] == now
        if written[-1]:
            assert now in (written[-1], written[-1] % 500 + 1)


@pytest.mark.parametrize("stop_at", range(1, 10))
def test_every_step_of_a_write_may_be_the_last(
    path: Path, stop_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process dies before the n-th call to the disk: the old values or the new ones."""

    class Killed(BaseException):
        pass

    saved(path, {"TGL_X": 1}, {"TGL_X": 2})
    calls = 0

    def counted(original: object) -> object:
        def call(*arguments: object, **names: object) -> object:
            nonlocal calls
            calls += 1
            if calls == stop_at:
                raise Killed
            return original(*arguments, **names)  # type: ignore[operator]

        return call

    writing = store(path)
    writing.restore()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", counted(Path.open))
        patch.setattr(Path, "replace", counted(Path.replace))
        patch.setattr(os, "fsync", counted(os.fsync))
        try:
            writing.save(BASE.changed({"TGL_X": 3}))
        except Killed:
            done = False
        else:
            done = True
    got = store(path).restore()
    assert not got.damaged
    assert got.values["TGL_X"] in ((3.0,) if done else (2.0, 3.0))
    assert done == (stop_at > 7)  # three calls for each of the two files, one for the folder


# --- while flying -----------------------------------------------------------------------------


def test_a_write_leaves_no_file_open(path: Path) -> None:
    """A module that runs for months would have none left."""
    saved(path, {"RHO_P": 0.6})
    before = len(list(Path("/proc/self/fd").iterdir()))
    saved(path, {"RHO_P": 0.7}, {"RHO_P": 0.8})
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def settled(flying: ParameterStore, values: ParameterSet, now_s: float) -> list[str]:
    """What it says until nothing is being written, without time going on."""
    notices = flying.poll(values, now_s)
    end = time.monotonic() + 10.0
    while flying.is_writing:
        assert time.monotonic() < end
        time.sleep(0.0005)
        notices += flying.poll(values, now_s)
    return notices


def flying_values(i: int) -> ParameterSet:
    return BASE.changed({"TGL_X": 1 + i})


def test_changes_are_written_at_once_and_then_once_a_second(path: Path) -> None:
    flying = store(path)
    assert flying.restore().values == BASE
    flying.start()
    assert flying.poll(BASE, 0.0) == []
    for i in range(201):  # two seconds of a slider that is dragged
        assert settled(flying, flying_values(i), i / 100) == []
        assert flying.writes == i // 100 + 1
    assert flying.writes == 3
    assert flying.stop(flying_values(200)) == []
    assert store(path).restore().values["TGL_X"] == 201.0


def test_the_last_change_is_written_when_the_process_ends(path: Path) -> None:
    flying = store(path)
    flying.restore()
    flying.start()
    flying.poll(flying_values(1), 0.0)
    flying.poll(flying_values(2), 0.1)  # within the second: not yet
    assert flying.stop(flying_values(2)) == []
    assert store(path).restore().values["TGL_X"] == 3.0


def test_engaging_writes_nothing(path: Path) -> None:
    flying = store(path)
    flying.restore()
    flying.start()
    flying.poll(BASE.changed({"OP_ENGAGE": 1}), 0.0)
    assert flying.stop(BASE.changed({"OP_ENGAGE": 1})) == []
    assert flying.writes == 0
    assert not path.exists()


def test_going_back_to_the_files_value_is_kept_too(path: Path) -> None:
    saved(path, {"TGL_X": 1})
    flying = store(path)
    flying.restore()
    flying.start()
    flying.poll(BASE, 0.0)
    flying.stop(BASE)
    assert store(path).restore().values == BASE


def test_a_disk_that_takes_nothing_is_reported_once_and_tried_again(path: Path) -> None:
    path.parent.parent.joinpath("state").write_text("a file where the folder should be")
    flying = store(path)
    flying.restore()
    flying.start()
    notices: list[str] = []
    for i in range(300):  # a minute of changes, one every 0.2 s
        notices += settled(flying, flying_values(i), 0.2 * i)
    (reported,) = notices
    assert reported.startswith("parameters are not kept: ")
    assert reported.endswith("flying on")
    assert str(path) in reported
    path.parent.unlink()
    assert settled(flying, flying_values(300), 100.0) == ["parameters are kept again"]
    assert flying.stop(flying_values(300)) == []
    assert store(path).restore().values == flying_values(300)


def test_a_disk_that_hangs_holds_up_neither_the_loop_nor_the_end(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging, release = threading.Event(), threading.Event()

    def hang(_file: int) -> None:
        hanging.set()
        release.wait(30.0)

    monkeypatch.setattr(os, "fsync", hang)
    monkeypatch.setattr(parameter_store, "STOP_S", 0.05)
    flying = store(path)
    flying.restore()
    flying.start()
    flying.poll(flying_values(0), 0.0)
    assert hanging.wait(5.0)
    for i in range(100):
        assert flying.poll(flying_values(i), 0.5 * i) == []
    (reported,) = flying.stop(flying_values(5))
    assert "does not answer" in reported
    release.set()


def test_a_change_taken_back_while_the_disk_writes_is_taken_back_on_the_disk_too(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gain that was tried for a tenth of a second, on a card that takes longer."""
    writing, go_on = threading.Event(), threading.Event()
    real = os.fsync

    def slow(file: int) -> None:
        writing.set()
        assert go_on.wait(30.0)
        real(file)

    flying = store(path)
    flying.restore()
    flying.start()
    before, tried = BASE, flying_values(0)
    flying.poll(before, 0.0)
    monkeypatch.setattr(os, "fsync", slow)
    flying.poll(tried, 2.0)
    assert writing.wait(10.0)
    again = tried.changed({"TGL_X": before["TGL_X"]})
    flying.poll(again, 2.1)  # the disk has not answered yet
    go_on.set()
    settled(flying, again, 2.2)
    settled(flying, again, 4.0)  # the second write is due
    assert store(path).restore().values == before  # as after a kill
    assert flying.writes == 2
    flying.stop(again)
    assert flying.writes == 2  # nothing was left to write


def test_a_clock_that_goes_back_does_not_stop_the_writing(path: Path) -> None:
    """Lockstep: from the computer's clock to the vehicle's."""
    flying = store(path)
    flying.restore()
    flying.start()
    settled(flying, flying_values(0), 5000.0)
    settled(flying, flying_values(1), 3.0)
    assert flying.writes == 2
    flying.stop(flying_values(1))


# --- where ------------------------------------------------------------------------------------


def test_the_state_lies_where_a_users_programs_keep_it() -> None:
    assert state_folder({"HOME": "/h", "XDG_STATE_HOME": "/s"}) == Path("/s/tgl_soar")
    assert state_folder({"HOME": "/h"}) == Path("/h/.local/state/tgl_soar")
    assert state_folder({"HOME": "/h", "XDG_STATE_HOME": "relative"}) == Path(
        "/h/.local/state/tgl_soar"
    )
    assert state_folder({}) is None
    files = Path("/s"), "x/my_glider.toml", Path("hill.toml")
    assert old_state_file(*files) == Path("/s/my_glider-hill.params")
    mine = state_file(*files, Identity("Glider", "Hill", 3, 25))
    assert mine.parent == Path("/s")
    assert re.fullmatch(r"my_glider-hill-3-25-[0-9a-f]{8}\.params", mine.name)


def test_a_file_that_cannot_be_replaced_stays_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    file = tmp_path / "site.toml"
    file.write_bytes(b"old")
    monkeypatch.setattr("tgl_soar.config.parameter_store.os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        parameter_store.write_state(file, b"new", None)
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]
