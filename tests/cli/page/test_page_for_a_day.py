"""The page's memory is flat: of its server over a day, of the page in a browser over half an hour.

A day of the server's, as a process of its own on real sockets with its clock as an argument, and
half an hour of a browser's, with the figures of docs/page.md:

    python -m pytest -m long -s tests/cli/page/test_page_for_a_day.py
"""

from __future__ import annotations

import asyncio
import shutil
import time
from typing import Any, Final, NamedTuple

import pytest

pytest.importorskip("starlette", reason="the extra `page` is not installed")

from page_by_the_clock import STEP_S
from page_day import (
    HOUR_S,
    MOVE_S,
    DayDesk,
    Memory,
    blocks,
    days_pages,
    resident_kb,
    telemetry_of_flight,
)
from page_day_server import DaysServer
from page_flight import Served

MINUTE_H: Final = 1.0 / 60.0
# Lists that are bounded have their own comings and goings: a dictionary that is resized, a frame
# that is longer, a number with other digits.  It is less than one object a second of ten minutes
# (600), or one a minute of a day (1380).
NOISE_BLOCKS: Final = 500


def memory_of(telemetry_s: float, at_hours: list[float]) -> list[Memory]:
    desk = DayDesk(telemetry_of_flight(telemetry_s))
    found: list[Memory] = []

    def measure(hours: float) -> None:
        found.append(Memory(hours, blocks(), resident_kb()))

    asyncio.run(days_pages(desk, measure, at_hours))
    assert desk.station is not None
    assert desk.orders is not None
    assert desk.station.missing == []
    assert desk.orders.undo_count == min(50, int(at_hours[-1] * 3600.0 / MOVE_S))
    return found


@pytest.mark.long
def test_ten_minutes_more_need_no_more_memory() -> None:
    # What is bounded by number is full: 50 lines to undo after 12.5 minutes, 200 texts after 7.
    before, after = memory_of(3.0, [14 * MINUTE_H, 24 * MINUTE_H])
    assert after.blocks - before.blocks < NOISE_BLOCKS


@pytest.mark.long
def test_a_day_of_a_real_server_needs_no_more_memory_than_an_hour() -> None:
    found = []
    with DaysServer(telemetry_of_flight(20.0)) as server:
        for hours in (1.0, 2.0, 6.0, 12.0, 24.0):
            found.append(server.memory_at(hours))
            print(found[-1], flush=True)
    operator, frames = server.operator, round(24 * HOUR_S / STEP_S)
    print(f"{server.messages} messages in {server.datagrams} datagrams", end=", ")
    print(f"{operator.frames} of {frames} frames to a page that was opened", end=" ")
    print(f"{operator.opened} times, {operator.moves} moves; {server.processor_s:.0f} s of a core")
    hour, *_, day = found
    assert operator.moves == 24 * 60
    assert operator.frames > 0.5 * frames  # a page that is slower than a day in minutes drops some
    assert day.blocks - hour.blocks < NOISE_BLOCKS
    # The allocator's own: a thirtieth of what the process has.
    assert day.resident_kb - hour.resident_kb < 4096


class BrowserMemory(NamedTuple):
    """Of the page in a browser, what is garbage left out."""

    heap_kb: float  # of its scripts
    nodes: int  # of its document
    listeners: int


# A number of 16 bytes that stays of every frame of half an hour is 560 kB; a node of every message
# is 900.  Notices, and pieces of the strips for every mode, come and go.
NOISE_KB: Final = 500.0
NOISE_NODES: Final = 300
BROWSERS_HOURS: Final = (0.15, 0.65)  # 200 texts, the most that stay, are there after 7 minutes
PATIENCE_S: Final = 3600.0


def memory_in(page: Any) -> BrowserMemory:
    tools = page.context.new_cdp_session(page)
    tools.send("HeapProfiler.collectGarbage")
    heap = tools.send("Runtime.getHeapUsage")["usedSize"]
    found = tools.send("Memory.getDOMCounters")
    tools.detach()
    return BrowserMemory(heap / 1024, found["nodes"], found["jsEventListeners"])


@pytest.mark.long
def test_half_an_hour_more_in_a_browser_needs_no_more_memory() -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no chromium (Debian: apt install chromium)")
    desk = DayDesk(telemetry_of_flight(5.0))
    served = Served(desk)
    found = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(served.address)
        for hours in BROWSERS_HOURS:
            desk.until_h = hours
            ends_s = time.monotonic() + PATIENCE_S
            last = f"page.model?.rows.at(-1)?.[0] >= 3600 * (1 + {hours}) - 0.3"
            while not (desk.hours >= hours and page.evaluate(last)):
                assert time.monotonic() < ends_s
                page.wait_for_timeout(500)
            page.wait_for_timeout(8000)  # notices stay for seven seconds
            found.append(memory_in(page))
            print(f"after {hours:g} h: {found[-1]}; server: {blocks()} objects")
        browser.close()
    served.end()
    before, after = found
    assert after.heap_kb - before.heap_kb < NOISE_KB
    assert after.nodes - before.nodes < NOISE_NODES
    assert after.listeners == before.listeners
