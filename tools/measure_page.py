"""The figures of docs/page.md, measured again: `python tools/measure_page.py`.

    mouse to MAVLink      from the browser's clock at the release to the server's at the last frame
    telemetry to pixel    from the server's clock at a message's arrival to the browser's at its
                          drawing
    server                its processor time over the time that went by
    transfer              what the browser was sent until the page stood

The flight is `tgl-soar sitl --page`, in real time, on one computer with the browser, so that both
clocks are one.  The load of the computer is printed beside: figures of a busy one are worse.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median, quantiles
from typing import Any, Final

from page_window import PageWindow, chromium, flight
from websockets.sync.client import ClientConnection, connect

MOVES: Final = 20
WATCHED_S: Final = 20.0
PAGES: Final = 10
MOVE_S: Final = 1.0  # between two


def mouse_to_link_ms(window: PageWindow) -> Iterator[float]:
    """Of moves to and fro, each dragged by the mouse."""
    mouse = window.page.mouse
    window.page.evaluate(
        "() => { const ask = page.hand.ask; page.hand.ask = (what, fields) => {"
        " if (what === 'move') page.moved = fields.at; return ask(what, fields); }; }"
    )
    for i in range(MOVES):
        x, z = window.line()
        side = 0.1 if i % 2 == 0 else -0.1
        mouse.move(*window.at((x, z)))
        mouse.down()
        mouse.move(*window.at((x + side, z + side)), steps=4)
        window.until(lambda: window.value("m.ghost != null"))
        mouse.up()
        window.until(lambda: window.value("m.sent > page.moved - 1 && !m.busy && !m.ghost"))
        yield 1000.0 * window.value("m.sent - page.moved")
        window.page.wait_for_timeout(1000.0 * MOVE_S)


def processor_s(process: int) -> float:
    """Time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def fraction_of_core(process: int, wait: Any) -> float:
    """While `wait` waits."""
    used_s, at_s = processor_s(process), time.monotonic()
    wait()
    return (processor_s(process) - used_s) / (time.monotonic() - at_s)


@contextmanager
def page_of_a_program(address: str) -> Iterator[ClientConnection]:
    """One that needs no browser, and answers no farewell."""
    place, _, token = address.partition("#token=")
    place = place.replace("http", "ws") + "live"
    with connect(place, ping_interval=None, close_timeout=0.0) as socket:
        socket.send(json.dumps({"do": "hello", "token": token}))
        yield socket


def frames_in(socket: ClientConnection, seconds: float) -> int:
    """That a page takes."""
    ends_s, count = time.monotonic() + seconds, 0
    while (left_s := ends_s - time.monotonic()) > 0.0:
        try:
            socket.recv(timeout=left_s)
        except TimeoutError:
            break
        count += 1
    return count


def measure(address: str, server: int, browser: Any) -> None:
    """Print a row each."""
    context = browser.new_context(viewport={"width": 1300, "height": 850})
    page = context.new_page()
    sizes: list[int] = []
    page.on("response", lambda answer: sizes.append(len(answer.body())))
    page.goto(address)
    window = PageWindow(page)
    window.until(lambda: window.value("m?.line != null"))
    row("page and place", f"{sum(sizes) / 1024:.0f} kB")
    window.engage()
    page.wait_for_timeout(1000.0 * WATCHED_S)
    shown_ms = [1000.0 * s for s in window.value("page.measured")]
    nine = quantiles(shown_ms, n=10)[-1]
    row("telemetry to pixel", f"{median(shown_ms):.0f} ms", f"nine in ten: {nine:.0f} ms or less")
    moved_ms = list(mouse_to_link_ms(window))
    row("mouse to MAVLink", f"{median(moved_ms):.0f} ms", f"the slowest: {max(moved_ms):.0f} ms")
    part = fraction_of_core(server, lambda: page.wait_for_timeout(1000.0 * WATCHED_S))
    row("server, one page", f"{100.0 * part:.1f} % of a core")
    many(address, server)


def many(address: str, server: int) -> None:
    """Ten pages, of which the browser's is one; one takes nothing."""
    with ExitStack() as stack:
        pages = [stack.enter_context(page_of_a_program(address)) for _ in range(PAGES - 1)]
        _stalled, *others = pages
        counts: list[int] = []

        def take() -> None:
            with ThreadPoolExecutor(len(others)) as pool:
                counts.extend(pool.map(lambda socket: frames_in(socket, WATCHED_S), others))

        part = fraction_of_core(server, take)
        least = min(counts) / WATCHED_S
        load = f"{100.0 * part:.1f} % of a core"
        row("server, ten pages", load, f"{least:.1f} frames/s or more to each")


def row(what: str, figure: str, more: str = "") -> None:
    print(f"{what:20}  {figure:18}  {more}", flush=True)


def main() -> int:
    print(f"load of the computer: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with flight() as (address, server), chromium() as browser:
        measure(address, server, browser)
    print(f"load of the computer: {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
