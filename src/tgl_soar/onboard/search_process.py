"""The search for lift beside the flying process: in a process of its own.

A plan takes a few hundredths of a second of processor time, and numpy tens of megabytes: the tick
has time for neither.  What goes to and fro are datagrams of a pair of sockets.  None is waited for:
one that finds no room is dropped, and where the process dies the flight goes on without a search.
The process ends with the one that flies, whatever ends that: the pair is closed then.

A process that is slow does not fall behind: the map listens to every glimpse, but only the newest
is planned for and answered.

In lockstep, where the time stands still until the tick is through, the search is in the tick's own
process, so that a flight repeats exactly (`SearchHere`).
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from typing import Final

from tgl_soar.control.search.glimpse import Glimpse, LineRequest, SearchTask

LARGEST_BYTES: Final = 65536
NICE: Final = 5
END_S: Final = 1.0  # for the process to end by itself
_MODULE: Final = "tgl_soar.onboard.search_process"


class SearchBeside:
    """The search in a process of its own."""

    def __init__(self) -> None:
        """Errors: OSError where no process can be started."""
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._failure = ""
        self.dropped = 0  # datagrams that found no room
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", _MODULE, str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        self._socket.setblocking(False)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def failure(self) -> str:
        """Why there will be no answer any more."""
        return self._failure

    def begin(self, task: SearchTask) -> bool:
        """Another place, polar or slew than before; whether it was sent."""
        return self._send(task)

    def send(self, glimpse: Glimpse | None) -> bool:
        """What the module knows; whether it was sent."""
        return self._send(glimpse)

    def receive(self) -> LineRequest | None:
        """The newest answer."""
        newest: LineRequest | None = None
        while not self._failure:
            try:
                data = self._socket.recv(LARGEST_BYTES)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._failure = "its process has died"
                break
            newest = pickle.loads(data)  # of our own process, by a socket of nobody else's
        return None if self._failure else newest

    def _send(self, message: SearchTask | Glimpse | None) -> bool:
        if self._failure:
            return False
        try:
            self._socket.send(pickle.dumps(message))
        except BlockingIOError:
            self.dropped += 1
            return False
        except OSError:
            self._failure = "its process has died"
            return False
        return True

    def close(self) -> None:
        """End it."""
        self._socket.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class SearchHere:
    """The search in this process, for flights in lockstep."""

    def __init__(self) -> None:
        from tgl_soar.control.search.lift_search import Seeker

        self._seeker = Seeker()
        self._answer: LineRequest | None = None
        self.failure = ""

    def begin(self, task: SearchTask) -> bool:
        """Another place, polar or slew than before."""
        self._seeker.begin(task)
        return True

    def send(self, glimpse: Glimpse | None) -> bool:
        """What the module knows."""
        self._answer = self._seeker.take(glimpse)
        return True

    def receive(self) -> LineRequest | None:
        """The newest answer."""
        answer, self._answer = self._answer, None
        return answer

    def close(self) -> None:
        """There is nothing to end."""


def serve(ours: socket.socket) -> None:
    """Answer until the other end is closed."""
    from tgl_soar.control.search.lift_search import Seeker

    seeker = Seeker()
    while True:
        try:
            data = ours.recv(LARGEST_BYTES)
        except OSError:
            return
        if not data:
            return
        message = pickle.loads(data)  # of our own process, by a socket of nobody else's
        if isinstance(message, SearchTask):
            seeker.begin(message)
            continue
        is_newest = not select.select([ours], [], [], 0.0)[0]
        answer = seeker.take(message, plans=is_newest)
        if is_newest and answer is not None:
            with suppress(BlockingIOError):
                ours.send(pickle.dumps(answer))


def main(arguments: list[str]) -> int:
    """`python -m tgl_soar.onboard.search_process FD`."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends with the one that flies
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with suppress(OSError):
        os.nice(NICE)
    with socket.socket(fileno=int(arguments[0])) as ours, suppress(BrokenPipeError):
        serve(ours)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
