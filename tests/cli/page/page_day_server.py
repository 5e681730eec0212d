"""A day of `tgl-soar page` as a process of its own: telemetry by UDP, pages by WebSocket.

An operator's page reads every frame and drags the line once a minute; another page takes nothing,
and is opened again every hour.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from free_ports import free_port
from page_by_the_clock import MEASURE, STEP, STEP_S
from page_day import FRAME_S, HOUR_S, A, B, DayLink, Memory
from page_flight import AIRFRAME, SITE, TOKEN

DATAGRAM: Final = 1200  # bytes: what a router packs into one
MINUTE_S: Final = 60.0
FRAMES: Final = round(STEP_S / FRAME_S)  # of telemetry, in a step


class Operator:
    """Reads all frames, and asks."""

    def __init__(self, port: int) -> None:
        self._address = f"ws://127.0.0.1:{port}/live"
        self._socket: Any = None
        self.opened = self.frames = self.moves = 0
        self._ended = False
        self._open()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _open(self) -> None:
        from websockets.sync.client import connect

        opened = connect(self._address, ping_interval=None, close_timeout=0.0)
        self._socket = opened.__enter__()
        self.opened += 1
        self.request("hello", name="a day")

    def _read(self) -> None:
        from websockets.exceptions import ConnectionClosed

        while not self._ended:
            try:
                self._socket.recv()
                self.frames += 1
            except ConnectionClosed:
                if not self._ended:
                    self._open()  # as a page does

    def request(self, what: str, **fields: Any) -> None:
        """One request; a connection that is closed meanwhile takes none."""
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            self._socket.send(json.dumps({"do": what, "token": TOKEN, **fields}))

    def drag(self, minute: int) -> None:
        """Look at two places, and move to the second; and set a gain."""
        x, z = B if minute % 2 else A
        self.request("look", x=0.5 * (x + A[0]), z=z, lean=15.0)
        self.request("look", x=x, z=z, lean=15.0)
        self.request("move", x=x, z=z, lean=15.0)
        self.request("set", name="RHO_P", value=0.5 + 0.001 * (minute % 100))
        self.moves += 1

    def end(self) -> None:
        self._ended = True
        self._socket.close()


class DaysServer:
    """The process, and what a day is made of."""

    def __init__(self, telemetry: list[list[bytes]]) -> None:
        port = free_port()
        self._far_end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far_end.connect(("127.0.0.1", port))
        self._far_end.setblocking(False)
        self._module = DayLink(telemetry)
        self._steps = 0
        self.messages = self.datagrams = 0
        self.processor_s = 0.0
        program = Path(__file__).with_name("page_by_the_clock.py")
        command = [sys.executable, str(program), "--link", f"udp:127.0.0.1:{port}", "--port", "0"]
        command += ["--airframe", str(AIRFRAME), "--site", str(SITE), "--token", TOKEN]
        path = os.pathsep.join(filter(None, [str(program.parent), *sys.path]))
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, "PYTHONPATH": path},
        )
        self._port = self._announced()
        self._asked(STEP)
        self.operator = Operator(self._port)
        self._stalled: socket.socket | None = None

    def _announced(self) -> int:
        """The page's port, of its address."""
        words = ""
        while (found := re.search(r"127\.0\.0\.1:(\d+)/#token", words)) is None:
            line = self._line()
            assert line, words
            words += line.strip()
        return int(found[1])

    def _line(self) -> str:
        assert self._process.stdout is not None
        read = b""
        while not read.endswith(b"\n"):
            byte = self._process.stdout.read(4096)
            if not byte:
                break
            read += byte
        return read.decode()

    def _asked(self, what: bytes) -> dict[str, float]:
        assert self._process.stdin is not None
        self._process.stdin.write(what)
        answer: dict[str, float] = json.loads(self._line())
        return answer

    @property
    def hours(self) -> float:
        """That have gone by."""
        return self._steps * STEP_S / HOUR_S

    def memory_at(self, hours: float) -> Memory:
        """Go on to there."""
        while self.hours < hours:
            self._step()
        found = self._asked(MEASURE)
        return Memory(hours, int(found["blocks"]), int(found["resident_kb"]))

    def _step(self) -> None:
        now_s = HOUR_S + self._steps * STEP_S
        for i in range(FRAMES):
            self._module.step(now_s + i * FRAME_S)
        self._send(self._module.receive(now_s))
        with suppress(BlockingIOError):
            while True:
                self._module.send(self._far_end.recv(2048))
        if self._steps % round(HOUR_S / STEP_S) == 0:
            self._open_a_page_that_takes_nothing()
        if self._steps % round(MINUTE_S / STEP_S) == 1:
            self.operator.drag(self._steps // round(MINUTE_S / STEP_S))
        self._asked(STEP)
        self._steps += 1

    def _send(self, frames: list[bytes]) -> None:
        self.messages += len(frames)
        piece = b""
        for frame in [*frames, b""]:
            if piece and (not frame or len(piece) + len(frame) > DATAGRAM):
                self._far_end.send(piece)
                self.datagrams += 1
                piece = b""
            piece += frame

    def _open_a_page_that_takes_nothing(self) -> None:
        if self._stalled is not None:
            self._stalled.close()
        self._stalled = stalled = socket.create_connection(("127.0.0.1", self._port))
        request = (
            f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n"
        )
        stalled.sendall(request.encode())
        hello = json.dumps({"do": "hello", "token": TOKEN}).encode()
        stalled.sendall(bytes((0x81, 0x80 | len(hello), 0, 0, 0, 0)) + hello)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        self.processor_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        self.operator.end()
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._far_end.close()
        if self._stalled is not None:
            self._stalled.close()
