"""The film of the line being dragged from a to c, on the real page: docs/images/drag.webp.

    python tools/page_film.py

The flight is `tgl-soar sitl --page`, in real time.  Of all pictures every n-th is kept, with the
smallest n that fits, and stands as long as it stood but no longer than `LONGEST_S`: a computer that
is busy with other things films a slow hand.
"""

from __future__ import annotations

import base64
import io
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from page_window import PageWindow, chromium, flight, opened
from PIL import Image

FILM: Final = Path(__file__).parents[1] / "docs" / "images" / "drag.webp"
LARGEST_KB: Final = 600
SIZE: Final = {"width": 1120, "height": 700}
STEPS: Final = 20  # of the hand
STEP_S: Final = 0.1
PICTURE_S: Final = 0.25  # between two
FIRST_S: Final = 1.0
LONGEST_S: Final = 0.5
LAST_S: Final = 3.0
QUALITY: Final = 50
SETTLED_M: Final = 0.15  # in turbulent air, as tests/cli/page/test_settling_preview.py argues it
TOO_LONG_S: Final = 60.0
# The hand is where a mouse's arrow would be: a browser without a screen draws none.
ARROW: Final = """() => {
  const arrow = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  arrow.setAttribute("viewBox", "0 0 20 28");
  arrow.style.cssText = "position:fixed; left:0; top:0; width:20px; height:28px; z-index:9;"
    + "pointer-events:none";
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", "M1 1V21L6 16.5 9.5 25 13 23.5 9.5 15.5 16 15Z");
  path.style.cssText = "fill:#111;stroke:#fff;stroke-width:1.5";
  arrow.append(path);
  document.body.append(arrow);
  addEventListener("pointermove", (e) => {
    arrow.style.transform = `translate(${e.clientX}px, ${e.clientY}px)`;
  }, true);
}"""


class Film:
    """Pictures of a window as chromium draws them, and when each was drawn."""

    def __init__(self, window: PageWindow) -> None:
        self._pictures: list[Any] = []
        self._at_s: list[float] = []
        self._drawn: list[dict[str, Any]] = []
        self._page = window.page
        self._tools = window.page.context.new_cdp_session(window.page)
        self._tools.on("Page.screencastFrame", lambda drawn: self._drawn.append(drawn))
        self._tools.send("Page.startScreencast", {"format": "png"})

    def __len__(self) -> int:
        return len(self._pictures)

    def roll(self, seconds: float) -> None:
        """Go on for so long; a picture every `PICTURE_S` at most."""
        ends_s = time.monotonic() + seconds
        while time.monotonic() < ends_s:
            self._page.wait_for_timeout(10)
            for drawn in self._drawn:
                at_s = drawn["metadata"]["timestamp"]
                if not self._at_s or at_s - self._at_s[-1] >= PICTURE_S:
                    png = io.BytesIO(base64.b64decode(drawn["data"]))
                    self._pictures.append(Image.open(png).convert("RGB"))
                    self._at_s.append(at_s)
                self._tools.send("Page.screencastFrameAck", {"sessionId": drawn["sessionId"]})
            self._drawn.clear()

    def cut(self) -> None:
        """What was filmed so far is left out, but for the last picture."""
        self._pictures, self._at_s = self._pictures[-1:], self._at_s[-1:]

    def write(self, path: Path, every: int) -> int:
        """Every n-th picture and the last; the kilobytes."""
        kept = [*range(0, len(self) - 1, every), len(self) - 1]
        at_s = [self._at_s[i] for i in kept]
        stands_s = [min(b - a, LONGEST_S) for a, b in pairwise(at_s)]
        first, *others = (self._pictures[i] for i in kept)
        first.save(
            path,
            save_all=True,
            append_images=others,
            duration=[round(1000.0 * s) for s in (*stands_s, LAST_S)],
            loop=0,
            quality=QUALITY,
            method=3,
        )
        return path.stat().st_size // 1024


def play(window: PageWindow, film: Film) -> None:
    """Engage at a, take the line, carry it to c, let it go, and wait for the aircraft."""
    presets = window.value("m.scene.presets")
    start, end = presets[0], presets[-1]
    window.engage()
    window.until(lambda: window.value("Math.abs(m.now.e_rho) < 0.05"))
    mouse = window.page.mouse
    mouse.move(*window.at((start["x"], start["z"])))
    film.roll(STEP_S)
    film.cut()
    film.roll(FIRST_S)
    mouse.down()
    for step in range(1, STEPS + 1):
        part = step / STEPS
        x, z = (start[name] + part * (end[name] - start[name]) for name in ("x", "z"))
        mouse.move(*window.at((x, z)))
        film.roll(STEP_S)
    reached = (
        "Math.hypot(m.ghost.x - page.plane.requested.x, m.ghost.z - page.plane.requested.z) < 0.005"
    )
    window.until(lambda: window.value(reached))
    film.roll(FIRST_S)
    x, z = window.value("m.ghost.place")
    mouse.up()
    ends_s = time.monotonic() + TOO_LONG_S
    away = f"Math.hypot(m.now.soar_x - {x}, m.now.soar_z - {z})"
    while window.value(away) > SETTLED_M and time.monotonic() < ends_s:
        film.roll(PICTURE_S)
    film.roll(FIRST_S)
    if window.value(away) > SETTLED_M:
        raise SystemExit("the aircraft did not settle at the ghost: film it again")


def main() -> int:
    with flight() as (address, _server), chromium() as browser:
        window = opened(browser, address, viewport=SIZE)
        window.page.evaluate(ARROW)
        film = Film(window)
        play(window, film)
    for every in range(1, len(film)):
        size_kb = film.write(FILM, every)
        if size_kb <= LARGEST_KB:
            print(f"{FILM}: every {every}. of {len(film)} pictures, {size_kb} kB")
            return 0
    raise SystemExit(f"{FILM}: {size_kb} kB, more than {LARGEST_KB}")


if __name__ == "__main__":
    sys.exit(main())
