"""The parts of a campaign by their numbers: shards, the queue of those that lost their worker,
results in memory, progress, what a worker of a cluster checks, and where results come from."""

from __future__ import annotations

import signal
import struct
import sys
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from zlib import crc32

import pytest
from cheap_flights import CheapResult, cheap_jobs, fly_cheaply

from tgl_soar import __version__
from tgl_soar.sim.campaign import cluster, executors, flight_list, folder, journal, provenance
from tgl_soar.sim.campaign.executors import InLine, LocalProcesses, ShardQueue, WorkerLost, local
from tgl_soar.sim.campaign.flight_list import Campaign, Shard, shard_size, shards
from tgl_soar.sim.campaign.interrupts import interrupts_later
from tgl_soar.sim.campaign.journal import InMemory, Journal, JournalError
from tgl_soar.sim.campaign.manifest import (
    Manifest,
    key_of,
    manifest_of,
    read_manifest,
    run_by,
    write_manifest,
)
from tgl_soar.sim.campaign.run import Progress, fly_all, run

RESULTS = [fly_cheaply(job) for job in cheap_jobs(10)]


# --- shards ---------------------------------------------------------------------------------------


def test_sixteen_shards_a_worker_of_a_thousand_flights_at_most() -> None:
    assert (flight_list.SHARDS_PER_WORKER, flight_list.SHARD_MOST) == (16, 1000)
    for count, workers, size in (
        (0, 1, 1),
        (31, 1, 1),
        (32, 1, 2),
        (320, 2, 10),
        (320, 0, 20),  # as of one
        (16_000, 1, 1000),
        (99_999, 1, 1000),
    ):
        assert shard_size(count, workers) == size


def test_shards_do_not_reach_over_a_gap() -> None:
    found = list(shards(list(range(100, 120)), [range(4), range(5, 6), range(10, 16)], 4))
    assert [(s.first, list(s.jobs)) for s in found] == [
        (0, [100, 101, 102, 103]),
        (5, [105]),
        (10, [110, 111, 112, 113]),
        (14, [114, 115]),
    ]
    assert [s.numbers for s in found] == [
        "flights 0 to 3",
        "flight 5",
        "flights 10 to 13",
        "flights 14 to 15",
    ]


def test_a_campaign_needs_no_parameters_and_no_seeds() -> None:
    plain = Campaign("x", fly_cheaply, cheap_jobs(2))
    assert plain.parameters == {}
    assert plain.seeds is None


# --- which worker flies ---------------------------------------------------------------------------


def test_how_often_a_worker_may_die() -> None:
    assert (executors.AHEAD, executors.ALONE_AFTER, executors.DEATHS_MOST) == (2, 2, 5)
    assert executors.LOOK_S == 0.2


def test_this_process_or_so_many_others() -> None:
    assert isinstance(local(0), InLine)
    assert (InLine().workers, InLine().description, InLine().shares_memory) == (1, "in line", True)
    made = local(3)
    assert isinstance(made, LocalProcesses)
    assert (made.workers, made.description, made.shares_memory) == (3, "3 local processes", True)
    for none in (0, -1):
        with pytest.raises(ValueError, match=f"workers {none}: at least 1"):
            LocalProcesses(none)


def queue_of(count: int, most: int) -> ShardQueue:
    return ShardQueue((Shard(i, [i]) for i in range(count)), most)


def taken(queue: ShardQueue) -> list[int]:
    return [shard.first for shard in queue.take()]


def test_a_queue_hands_out_as_many_as_there_is_room_for() -> None:
    queue = queue_of(3, 2)
    assert queue.left
    assert taken(queue) == [0, 1]
    assert taken(queue) == []
    queue.finished(Shard(0, [0]))
    assert taken(queue) == [2]
    queue.finished(Shard(1, [1]))
    queue.finished(Shard(2, [2]))
    assert queue.left  # that there are no more is not known yet
    assert taken(queue) == []
    assert not queue.left


def test_who_has_lost_a_worker_twice_waits_until_nobody_else_flies() -> None:
    queue = queue_of(5, 2)
    assert taken(queue) == [0, 1]
    queue.died()
    assert taken(queue) == [0, 1]
    queue.finished(Shard(1, [1]))
    assert taken(queue) == [2]
    queue.died()  # 0 for the second time, 2 for the first
    assert taken(queue) == [2]  # 0 is under suspicion: it flies alone
    queue.finished(Shard(2, [2]))
    assert taken(queue) == [0]
    assert taken(queue) == []
    queue.finished(Shard(0, [0]))
    assert taken(queue) == [3, 4]


def test_who_kills_five_workers_is_given_up_with_advice() -> None:
    queue = queue_of(1, 2)
    for _ in range(4):
        assert taken(queue) == [0]
        queue.died()
    assert taken(queue) == [0]
    with pytest.raises(
        WorkerLost, match=r"flight 0: 5 workers died of it, .* Fly it with --workers 0 to see"
    ):
        queue.died()


def test_a_clusters_shard_is_named_when_worker_after_worker_dies_of_it() -> None:
    queue = queue_of(1, 2)
    for _ in range(2):
        [shard] = queue.take()
        queue.died_with(shard)
        assert queue.left
    [shard] = queue.take()
    with pytest.raises(WorkerLost, match="flight 0: worker after worker dies of it"):
        queue.died_with(shard)


# --- results --------------------------------------------------------------------------------------


def test_results_in_memory_are_in_the_order_of_their_flights() -> None:
    kept = InMemory(6)
    assert kept.missing() == [range(6)]
    kept.put(1, ["b", "c"])
    assert (kept.flown, kept.missing()) == (2, [range(1), range(3, 6)])
    kept.put(5, [None])  # what comes to nothing is flown, too
    assert kept.missing() == [range(1), range(3, 5)]
    kept.put(0, ["a"])
    kept.put(3, ["d", "e"])
    assert (kept.flown, kept.missing()) == (6, [])
    assert kept.results() == ["a", "b", "c", "d", "e", None]


def test_a_record_is_first_count_length_and_sum_before_its_data(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    with Journal(path, "digest", 10, CheapResult) as kept:
        kept.put(3, RESULTS[3:5])
        assert kept.damaged == 0
    data = path.read_bytes()
    head = b"tgl_soar flights 1\ndigest 10\n"
    assert data.startswith(head)
    first, count, length, check = struct.unpack_from("<QIII", data, len(head))
    body = data[len(head) + 20 :]
    assert (first, count, length) == (3, 2, len(body))
    assert check == crc32(body, crc32(b"3 2"))


@pytest.mark.parametrize(
    ("first", "count"),
    [(9, 2), (0, 0), (10, 1)],  # beyond the last flight, or none
)
def test_a_record_of_flights_that_there_are_not_is_passed_over(
    tmp_path: Path, first: int, count: int
) -> None:
    path = tmp_path / "flights"
    with Journal(path, "d", 10, CheapResult) as kept:
        kept.put(0, RESULTS[:2])
    good = path.read_bytes()
    body = b"\x90"
    head = struct.pack("<QIII", first, count, 1, crc32(body, crc32(f"{first} {count}".encode())))
    path.write_bytes(good + head + body)
    with Journal(path, "d", 10, CheapResult) as again:
        assert (again.flown, again.damaged) == (2, len(head) + 1)
    assert path.read_bytes() == good  # it is taken off


def test_damage_between_records_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    with Journal(path, "d", 10, CheapResult) as kept:
        kept.put(0, RESULTS[:2])
        size = path.stat().st_size
        kept.put(2, RESULTS[2:4])
    data = path.read_bytes()
    path.write_bytes(data[:size] + b"?" * 7 + data[size:])
    with Journal(path, "d", 10, CheapResult) as again:
        assert (again.flown, again.damaged, again.missing()) == (4, 7, [range(4, 10)])
        assert list(again) == RESULTS[:4]


def test_a_journal_of_another_campaign_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "flights"
    Journal(path, "d", 10, CheapResult).close()
    for digest, count in (("e", 10), ("d", 11)):
        with pytest.raises(JournalError, match="flights of another campaign, of other"):
            Journal(path, digest, count, CheapResult)
    assert journal.MAGIC == b"tgl_soar flights 1\n"


# --- a run ----------------------------------------------------------------------------------------


class Shares(InLine):
    """This process, under another's name, that says what it was given."""

    def __init__(self, *, shares_memory: bool, workers: int = 1) -> None:
        self.shares_memory = shares_memory
        self.workers = workers
        self.sizes: list[int] = []

    def fly(self, fly: Any, shards: Any) -> Any:
        for shard in shards:
            self.sizes.append(len(shard.jobs))
            yield shard, [fly(job) for job in shard.jobs]


@pytest.mark.parametrize("in_one_process", [True, False])
def test_the_first_is_flown_here_where_others_share_what_it_loads(in_one_process: bool) -> None:
    executor, kept = Shares(shares_memory=in_one_process), InMemory(9)
    kept.put(0, [None])
    reported: list[Progress] = []
    run(
        *(fly_cheaply, cheap_jobs(9), executor, kept),
        size=3,
        first_here=True,
        on_progress=reported.append,
    )
    assert executor.sizes == ([3, 3, 1] if in_one_process else [3, 3, 2])
    assert [each.flown for each in reported] == (
        [1, 2, 5, 8, 9] if in_one_process else [1, 4, 7, 9]
    )
    assert kept.results()[1:] == [fly_cheaply(job) for job in cheap_jobs(9)][1:]


def test_all_flights_in_memory_are_the_executors_unless_it_is_asked_for() -> None:
    plain, asked = Shares(shares_memory=True), Shares(shares_memory=True)
    expected = [fly_cheaply(job) for job in cheap_jobs(9)]
    assert fly_all(fly_cheaply, cheap_jobs(9), plain) == expected
    assert fly_all(fly_cheaply, cheap_jobs(9), asked, first_here=True) == expected
    assert (sum(plain.sizes), sum(asked.sizes)) == (9, 8)


def test_where_nothing_is_missing_nothing_is_flown() -> None:
    executor, kept = Shares(shares_memory=True), InMemory(1)
    kept.put(0, [None])
    run(fly_cheaply, cheap_jobs(1), executor, kept, first_here=True)
    assert executor.sizes == []


def test_shards_are_as_large_as_their_number_asks_for() -> None:
    executor, kept = Shares(shares_memory=True, workers=2), InMemory(100)
    run(fly_cheaply, cheap_jobs(100), executor, kept)
    assert executor.sizes[:3] == [3, 3, 3]  # 100 flights in 32 shards


def test_the_rate_is_of_this_run_alone() -> None:
    kept = InMemory(10)
    kept.put(0, [None] * 4)
    times = iter([5.0, 5.0, 7.0, 9.0])
    reported: list[Progress] = []
    run(
        *(fly_cheaply, cheap_jobs(10), InLine(), kept),
        size=3,
        on_progress=reported.append,
        clock=lambda: next(times),
    )
    assert reported[0] == Progress(flown=4, of=10, per_s=0.0, left_s=float("inf"))
    assert reported[1] == Progress(flown=7, of=10, per_s=1.5, left_s=2.0)
    assert reported[2] == Progress(flown=10, of=10, per_s=1.5, left_s=0.0)


def test_ctrl_c_acts_at_the_end_and_as_before_after_it() -> None:
    before = signal.getsignal(signal.SIGINT)
    came = []
    signal.signal(signal.SIGINT, lambda *_: came.append(1))
    try:
        with interrupts_later():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            assert came == []
        assert came == [1]
        signal.raise_signal(signal.SIGINT)
        assert came == [1, 1]
    finally:
        signal.signal(signal.SIGINT, before)


# --- a cluster ------------------------------------------------------------------------------------


def test_how_long_a_cluster_is_waited_for_and_what_memory_is_kept() -> None:
    assert (cluster.PATIENCE_S, cluster.ANSWER_S, cluster.LOOK_S) == (300.0, 10.0, 1.0)
    assert (cluster.M_TRIM_THRESHOLD, cluster.M_MMAP_THRESHOLD) == (-1, -3)  # malloc.h
    assert (cluster.KEPT_BYTES, cluster.LARGE_BYTES) == (268_435_456, 33_554_432)
    assert not cluster.DaskCluster.shares_memory


def test_a_worker_of_another_source_or_library_flies_nothing() -> None:
    ours, here = provenance.source_digest(), provenance.libraries()
    jobs = cheap_jobs(2)
    assert cluster._fly_there(fly_cheaply, jobs, ours, here) == RESULTS[:2]
    with pytest.raises(cluster.ClusterError, match=rf"another source \({ours}\) than who asks \(x"):
        cluster._fly_there(fly_cheaply, jobs, "x", here)
    theirs = {**here, "numpy": "0.1"}
    with pytest.raises(cluster.ClusterError) as raised:
        cluster._fly_there(fly_cheaply, jobs, ours, theirs)
    assert f"flies with numpy {here['numpy']} and not 0.1, whose rounding" in str(raised.value)
    without = {**here, "numpy": ""}
    with pytest.raises(cluster.ClusterError, match="and not none"):
        cluster._fly_there(fly_cheaply, jobs, ours, without)


# --- where results come from ----------------------------------------------------------------------


def test_digests_are_of_whole_contents_to_sixteen_digits(tmp_path: Path) -> None:
    one, two = tmp_path / "1", tmp_path / "2"
    one.write_bytes(b"a")
    two.write_bytes(b"b")
    assert provenance.sha256_of(one) == sha256(b"a").hexdigest()
    assert provenance.sha256_of(tmp_path / "none") == ""
    whole = sha256(b"a").hexdigest() + sha256(b"b").hexdigest()
    assert provenance.files_digest([one, two]) == sha256(whole.encode()).hexdigest()[:16]
    assert provenance.files_digest([two, one]) != provenance.files_digest([one, two])
    assert len(provenance.source_digest()) == 16


def test_four_libraries_and_the_processor_round() -> None:
    found = provenance.libraries()
    assert list(found) == ["numpy", "scipy", "numba", "llvmlite", "processor"]
    assert found["numpy"] == provenance.installed_version("numpy") != ""
    assert provenance.installed_version("no-such-package-here") == ""
    assert set(provenance.provenance()) == {"version", "commit", "source", "libraries"}
    host = provenance.host_metadata()
    assert host["processors"] >= 1
    assert {"host", "system", "machine", "python", "numpy"} <= set(host)


class Processor:
    """As LLVM names it."""

    name, features = "znver3", "+fma,+avx2"

    def get_host_cpu_name(self) -> str:
        return self.name

    def get_host_cpu_features(self) -> Processor:
        return self

    def flatten(self) -> str:
        return self.features


def test_a_processor_that_can_do_other_things_is_another_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A worker on it flies nothing, and no flights are added to those that it flew."""
    here, found = Processor(), []
    monkeypatch.setitem(sys.modules, "llvmlite", SimpleNamespace(binding=here))
    for name, features in (("znver3", "+fma,+avx2"), ("znver3", "-fma,+avx2"), ("skylake", "")):
        here.name, here.features = name, features
        found.append(cast(Any, provenance.compiled_for).__wrapped__())
    assert found[0] == f"znver3 {sha256(b'+fma,+avx2').hexdigest()[:8]}"
    assert len(set(found)) == 3
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    assert cast(Any, provenance.compiled_for).__wrapped__() == ""

    ours = provenance.source_digest()
    theirs = {**provenance.libraries(), "processor": "another"}
    with pytest.raises(cluster.ClusterError, match="let their processors be of one kind"):
        cluster._fly_there(fly_cheaply, cheap_jobs(2), ours, theirs)


def test_a_manifest_is_of_what_is_asked_and_not_of_when() -> None:
    made = manifest_of("x", fly_cheaply, 3, {"a": 1}, (2, 5))
    assert (made.name, made.version, made.flights) == ("x", __version__, 3)
    assert made.flight == "cheap_flights.fly_cheaply"
    assert (made.parameters, made.seeds, made.complete, made.runs) == ({"a": 1}, [2, 5], False, [])
    assert manifest_of("x", fly_cheaply, 3, {}, None).seeds == []
    key = key_of(made)
    assert len(key) == 32
    assert key == key_of(manifest_of("y", fly_cheaply, 3, {"a": 1}, None))
    assert key != key_of(manifest_of("x", fly_cheaply, 4, {"a": 1}, (2, 5)))
    assert key != key_of(manifest_of("x", fly_cheaply, 3, {"a": 2}, (2, 5)))
    begun = run_by("me", 7)
    assert (begun["by"], begun["from"]) == ("me", 7)
    assert begun["begun"].endswith("+00:00")


def test_a_damaged_manifest_is_named(tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    assert read_manifest(path) is None
    path.write_text("{}")
    with pytest.raises(JournalError, match=r"manifest\.json: no manifest of a campaign: "):
        read_manifest(path)
    assert Manifest.__struct_fields__[0] == "name"


def test_the_files_of_a_folder_have_their_names() -> None:
    assert (
        *("flights.journal", "rows.parquet"),
        "manifest.json",
    ) == (folder.JOURNAL, folder.ROWS, folder.MANIFEST)


def test_a_folder_is_finished_where_its_manifest_says_so_and_no_journal_is_left(
    tmp_path: Path,
) -> None:
    assert not folder.is_finished(tmp_path)  # nothing lies there
    made = manifest_of("cheap", fly_cheaply, 2, {}, None)
    for complete in (False, True):
        made.complete = complete
        write_manifest(tmp_path / folder.MANIFEST, made)
        assert folder.is_finished(tmp_path) == complete
    (tmp_path / folder.JOURNAL).touch()
    assert not folder.is_finished(tmp_path)
