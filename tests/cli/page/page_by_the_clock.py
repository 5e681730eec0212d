"""`tgl-soar page`, unchanged but for its clock, which goes on as its input is written to.

A byte there is `STEP`: the clock goes on by `STEP_S`, or `MEASURE`: what the process has in memory.
Each is answered by a line.  So a day goes by as fast as the server gets through it.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from typing import Final

from page_day import HOUR_S, blocks, resident_kb

STEP, MEASURE = b"s", b"m"
STEP_S: Final = 0.5

_now_s = HOUR_S


def _take() -> None:
    """What has come from the input."""
    global _now_s
    written = os.read(0, 64)
    if not written:
        os._exit(0)  # whoever wrote has gone
    for byte in written:
        if byte == MEASURE[0]:
            _answer({"blocks": blocks(), "resident_kb": resident_kb()})
            continue
        _now_s += STEP_S
        # What is due by now is done in the loop's next turn, and answered for after it.
        asyncio.get_running_loop().call_soon(_answer, {"now_s": _now_s})


def _answer(what: dict[str, float]) -> None:
    os.write(1, json.dumps(what).encode() + b"\n")


def main() -> None:
    """The command, with the words that follow."""
    time.monotonic = lambda: _now_s
    from tgl_soar.cli.app import app
    from tgl_soar.cli.page.desk import Desk

    work = Desk.work

    async def work_by_the_clock(desk: Desk) -> None:
        asyncio.get_running_loop().add_reader(0, _take)
        await work(desk)

    Desk.work = work_by_the_clock  # type: ignore[assignment, method-assign]
    app(["page", *sys.argv[1:]])


if __name__ == "__main__":
    main()
