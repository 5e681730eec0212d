"""Datagrams to the search's process and back, whose other end is the test; and how that ends."""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tgl_soar.control.search import lift_search
from tgl_soar.control.search.glimpse import LOOKING, Glimpse, LineRequest, SearchTask
from tgl_soar.control.target_line import TargetLine
from tgl_soar.onboard.flightlog.topics import rebuilt
from tgl_soar.onboard.search_process import (
    END_S,
    LARGEST_BYTES,
    NICE,
    SearchBeside,
    SearchHere,
    main,
    serve,
)

# Processes, sockets and the searcher are put in the place of the real ones.
pytestmark = pytest.mark.interpreted

DIED = "its process has died"


def task_of(clearance_min_m: float) -> SearchTask:
    blank: SearchTask = rebuilt(SearchTask, iter([0.0] * 1000))
    return blank._replace(clearance_min_m=clearance_min_m)


def glimpse_of(number: int) -> Glimpse:
    blank: Glimpse = rebuilt(Glimpse, iter([0.0] * 1000))
    return blank._replace(search=number)


def answer_of(number: int) -> LineRequest:
    return LineRequest(
        target=TargetLine(1.0, 2.0, 3.0),
        status=LOOKING,
        reason=0,
        place_x_m=0.5,
        place_z_m=1.5,
        over_ground_m=1.0,
        time_s=7.0,
        search=number,
    )


class Child:
    """A process that the test plays: the far end of its socket, and how it ends."""

    pid = 4321

    def __init__(self, command: list[str], **named: Any) -> None:
        self.command, self.named = command, named
        (self.handed,) = named["pass_fds"]
        self.far = socket.socket(fileno=os.dup(self.handed))
        self.done: list[Any] = []
        self.ends = True

    def wait(self, timeout_s: float | None = None) -> int:
        self.done.append(("wait", timeout_s))
        if not self.ends:
            self.ends = True
            raise subprocess.TimeoutExpired("search", timeout_s or 0.0)
        return 0

    def kill(self) -> None:
        self.done.append("killed")


class Beside:
    """The search in a process of its own, and that process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        made: list[Child] = []

        def popen(*given: Any, **named: Any) -> Child:
            made.append(Child(*given, **named))
            return made[0]

        monkeypatch.setattr(subprocess, "Popen", popen)
        self.search = SearchBeside()
        (self.child,) = made

    def answer(self, number: int) -> None:
        self.child.far.send(pickle.dumps(answer_of(number)))


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Iterator[Beside]:
    made = Beside(monkeypatch)
    yield made
    made.child.far.close()
    made.search.close()


# --- to and fro -----------------------------------------------------------------------------------


def test_the_flight_never_waits_for_the_process(beside: Beside) -> None:
    """Looked up in the socket: a test that is kept waiting would not end."""
    assert not beside.search._socket.getblocking()


def test_the_process_is_started_with_its_end_of_the_pair_and_one_thread(beside: Beside) -> None:
    child = beside.child
    module = "tgl_soar.onboard.search_process"
    assert child.command == [sys.executable, "-P", "-m", module, str(child.handed)]
    assert child.named["stdin"] == subprocess.DEVNULL  # no terminal's words are read by it
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # it leaves other processors alone
        assert child.named["env"][name] == "1"
    assert child.named["env"]["PATH"] == os.environ["PATH"]
    assert beside.search.pid == Child.pid
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(child.handed)  # it is the process's alone: where that dies, we see it


def test_the_process_runs_no_code_of_the_folder_that_it_is_started_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pickle.py").write_text("open('run', 'w').close()\nraise SystemExit(3)\n")
    monkeypatch.chdir(tmp_path)
    search = SearchBeside()
    search.close()
    assert not (tmp_path / "run").exists()
    assert search._process.returncode != 3


def test_what_the_module_knows_arrives_as_it_is_sent(beside: Beside) -> None:
    sent = [task_of(0.3), glimpse_of(2), None]
    assert beside.search.begin(task_of(0.3))
    assert beside.search.send(glimpse_of(2))
    assert beside.search.send(None)
    assert [pickle.loads(beside.child.far.recv(LARGEST_BYTES)) for _ in sent] == sent
    assert (beside.search.dropped, beside.search.failure) == (0, "")


def test_of_several_answers_the_newest_counts_once(beside: Beside) -> None:
    assert beside.search.receive() is None
    for number in (1, 2, 3):
        beside.answer(number)
    assert beside.search.receive() == answer_of(3)
    assert beside.search.receive() is None
    assert beside.search.failure == ""


def test_what_finds_no_room_is_dropped_and_counted_and_waited_for_by_nobody(
    beside: Beside,
) -> None:
    sent = 0
    while beside.search.send(glimpse_of(sent)):
        sent += 1
        assert sent < 100_000
    assert beside.search.dropped == 1
    assert not beside.search.begin(task_of(0.3))
    assert beside.search.dropped == 2
    assert beside.search.failure == ""
    while sent:
        sent -= 1
        beside.child.far.recv(LARGEST_BYTES)
    assert beside.search.send(glimpse_of(0))


def test_where_the_process_has_died_there_is_no_answer_any_more(beside: Beside) -> None:
    beside.answer(1)
    beside.child.far.close()
    assert beside.search.receive() is None  # not even the last one: its line is of a dead search
    assert beside.search.failure == DIED
    assert not beside.search.send(glimpse_of(1))
    assert beside.search.receive() is None
    assert beside.search.dropped == 0


def test_a_death_is_seen_as_something_is_sent_too(beside: Beside) -> None:
    beside.child.far.close()
    assert not beside.search.send(glimpse_of(1))
    assert beside.search.failure == DIED


def test_a_socket_that_fails_is_a_process_that_has_died(beside: Beside) -> None:
    beside.search.close()
    assert beside.search.receive() is None
    assert beside.search.failure == DIED


# --- the end --------------------------------------------------------------------------------------


def test_it_ends_by_the_pair_that_is_closed_and_is_waited_for(beside: Beside) -> None:
    beside.search.close()
    assert beside.child.far.recv(LARGEST_BYTES) == b""  # which ends it: see below
    assert beside.child.done == [("wait", END_S)]


def test_a_process_that_does_not_end_in_time_is_killed(beside: Beside) -> None:
    beside.child.ends = False
    beside.search.close()
    assert beside.child.done == [("wait", END_S), "killed", ("wait", None)]
    assert END_S < 2.0  # the end of a flight waits for it, beside much else


# --- what the process does ------------------------------------------------------------------------


class Searcher:
    """What it was given; it answers each glimpse of an even number."""

    def __init__(self) -> None:
        self.done: list[Any] = []
        searchers.append(self)

    def begin(self, task: SearchTask) -> None:
        self.done.append(task)

    def take(self, glimpse: Glimpse | None, *, plans: bool = True) -> LineRequest | None:
        number = None if glimpse is None else glimpse.search
        self.done.append((number, plans))
        return answer_of(number) if number is not None and number % 2 == 0 else None


searchers: list[Searcher] = []


@pytest.fixture
def searching(monkeypatch: pytest.MonkeyPatch) -> None:
    searchers.clear()
    monkeypatch.setattr(lift_search, "Seeker", Searcher)


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(10.0)
    with ours, theirs:
        yield ours, theirs


Pair = tuple[socket.socket, socket.socket]


@pytest.mark.usefixtures("searching")
def test_the_process_listens_to_all_and_plans_and_answers_the_newest_alone(pair: Pair) -> None:
    ours, theirs = pair
    messages = (task_of(0.3), glimpse_of(2), glimpse_of(4), None, glimpse_of(6))
    for message in messages:
        ours.send(pickle.dumps(message))
    server = threading.Thread(target=serve, args=(theirs,))
    server.start()
    assert pickle.loads(ours.recv(LARGEST_BYTES)) == answer_of(6)
    ours.shutdown(socket.SHUT_WR)
    server.join(10.0)
    assert not server.is_alive()
    (searcher,) = searchers
    assert searcher.done == [
        task_of(0.3),
        (2, False),
        (4, False),
        (None, False),
        (6, True),
    ]
    theirs.close()
    assert ours.recv(LARGEST_BYTES) == b""  # there was no other answer


@pytest.mark.usefixtures("searching")
def test_a_glimpse_without_an_answer_gets_none_and_the_next_one_its_own(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pair
    waits_s: list[float] = []
    look = select.select

    def looked(*given: Any) -> Any:
        waits_s.append(given[-1])
        return look(*given)

    monkeypatch.setattr(select, "select", looked)
    server = threading.Thread(target=serve, args=(theirs,))
    server.start()
    ours.send(pickle.dumps(glimpse_of(1)))
    ours.send(pickle.dumps(glimpse_of(2)))
    assert pickle.loads(ours.recv(LARGEST_BYTES)) == answer_of(2)
    ours.shutdown(socket.SHUT_WR)
    server.join(10.0)
    assert set(waits_s) == {0.0}  # an answer does not wait for a later glimpse


@pytest.mark.usefixtures("searching")
def test_a_broken_pair_ends_it(pair: Pair) -> None:
    _, theirs = pair
    theirs.close()
    serve(theirs)  # and nothing is raised


@pytest.mark.usefixtures("searching")
def test_the_process_ends_with_the_flying_one_alone_and_comes_after_all_others(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pair
    ignored: dict[int, Any] = {}
    asked: list[Any] = []
    monkeypatch.setattr(signal, "signal", ignored.__setitem__)
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda *given: asked.append((*given[:2], given[2].sched_priority))
    )
    monkeypatch.setattr(os, "nice", asked.append)
    codes: list[int] = []
    fd = str(os.dup(theirs.fileno()))
    process = threading.Thread(target=lambda: codes.append(main([fd])))
    process.start()
    ours.send(pickle.dumps(glimpse_of(2)))
    assert pickle.loads(ours.recv(LARGEST_BYTES)) == answer_of(2)
    ours.shutdown(socket.SHUT_WR)
    process.join(10.0)
    assert codes == [0]
    numbers = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM)
    assert ignored == dict.fromkeys(numbers, signal.SIG_IGN)
    assert asked == [(0, os.SCHED_OTHER, 0), NICE]
    assert NICE > 0


def test_neither_a_system_that_gives_no_priority_nor_a_flight_that_is_over_is_an_error(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pair

    class Late(Searcher):
        def take(self, glimpse: Glimpse | None, *, plans: bool = True) -> LineRequest | None:
            ours.close()  # the flying process is gone before it has an answer
            return super().take(glimpse, plans=plans)

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(lift_search, "Seeker", Late)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "nice", refuse)
    ours.send(pickle.dumps(glimpse_of(2)))
    assert main([str(os.dup(theirs.fileno()))]) == 0
    assert searchers[-1].done == [(2, True)]


# --- in lockstep ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("searching")
def test_in_lockstep_the_search_answers_at_once_and_once() -> None:
    here = SearchHere()
    (searcher,) = searchers
    assert here.receive() is None
    assert here.begin(task_of(0.3))
    assert here.send(glimpse_of(2))
    assert here.receive() == answer_of(2)
    assert here.receive() is None
    assert here.send(None)
    assert here.receive() is None
    here.close()
    assert searcher.done == [task_of(0.3), (2, True), (None, True)]
    assert here.failure == ""
