"""The operator's page in chromium, on a flight of `tgl-soar sitl --page` in real time.

It needs playwright (PyPI) and chromium (Debian: apt install chromium).
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

PATIENCE_S: Final = 120.0
ADDRESS: Final = re.compile(r"http://127\.0\.0\.1:\d+/#token=[\w-]+")
PAGE_COMMAND: Final = "\0page\0"  # among the words of the server's process
PROBLEM: Final = "this needs chromium (Debian: apt install chromium)"


class PageWindow:
    """A window with the page, and an operator's hand."""

    def __init__(self, page: Any) -> None:
        self.page = page

    def value(self, script: str) -> Any:
        """What an expression comes to; `m` is the page's model."""
        return self.page.evaluate(f"(() => {{ const m = window.page?.model; return {script}; }})()")

    def until(self, condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> None:
        """Wait.  Errors: TimeoutError with what the page shows."""
        ends_s = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > ends_s:
                raise TimeoutError(self.page.inner_text("body"))
            time.sleep(0.05)

    def engage(self) -> None:
        """As soon as the entry checks hold, until the aircraft soars."""
        self.until(lambda: self.value("m?.line != null && m.mode === 'ready'"))
        self.page.click("#engage")
        self.until(lambda: self.value("m.mode === 'soaring'"))

    def line(self) -> tuple[float, float]:
        """The point of the module's line [m]."""
        x, z = self.value("[m.line.x, m.line.z]")
        return x, z

    def at(self, place: tuple[float, float]) -> tuple[float, float]:
        """Where a place of the plane is in the window."""
        x, y = self.page.evaluate(
            "([x, z]) => { const b = page.plane.svg.getBoundingClientRect();"
            " return [b.left + page.plane.X(x), b.top + page.plane.Z(z)]; }",
            list(place),
        )
        return x, y


@contextmanager
def flight() -> Iterator[tuple[str, int]]:
    """The page's address, and its server's process.  Errors: RuntimeError."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tgl_soar.cli", "sitl", "--page", "--page-port", "0"]
        command += ["--turbulence", "0.01", "--out", folder]
        log = Path(folder) / "console.txt"
        with log.open("wb") as output:
            process = subprocess.Popen(
                command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        try:
            yield _address(process, log), _server(process.pid)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    ends_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < ends_s and process.poll() is None:
        # A console folds long lines.
        if found := ADDRESS.search(log.read_text().replace("\n", "")):
            return found[0].removesuffix("engage")
        time.sleep(0.1)
    raise RuntimeError(log.read_text())


def _server(parent: int) -> int:
    """The process of `tgl-soar page` among a process's children.  Errors: RuntimeError."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    for child in children:
        if PAGE_COMMAND in Path(f"/proc/{child}/cmdline").read_text():
            return int(child)
    raise RuntimeError("the page's server does not run")


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser of the system's.  Errors: SystemExit where there is none."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        raise SystemExit(PROBLEM)
    from playwright import sync_api as playwright  # a window itself needs none

    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


def opened(browser: Any, address: str, **options: Any) -> PageWindow:
    """The page in a new window, its parameters known."""
    page = browser.new_context(**options).new_page()
    page.goto(address)
    window = PageWindow(page)
    window.until(lambda: window.value("m?.line != null && m.now.soar_x != null"))
    return window
