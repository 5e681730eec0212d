"""The pictures of the operator's page: docs/images/page.png and page-phone.png.

    python tools/page_pictures.py

The flight is `tgl-soar sitl --page`, in real time: from a to b, and there the line is in the hand,
on its way to c.  With `--dark FILE` the first one is taken in the dark, too.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from page_window import PageWindow, chromium, flight, opened

IMAGES: Final = Path(__file__).parents[1] / "docs" / "images"
DESK: Final = {"width": 1440, "height": 900}
PHONE: Final = {"width": 390, "height": 844}
SOARED_MS: Final = 14_000  # on each of both lines, so that the air around them is measured
NOTICES_MS: Final = 8_000  # until they have gone


def settled(window: PageWindow, line: int) -> None:
    """On one of the site's lines, for a while."""
    window.page.click(f"#presets button:nth-child({line})")
    window.until(
        lambda: window.value(f"m.parameters.TGL_PRESET === {line} && m.mode === 'soaring'")
    )
    window.page.wait_for_timeout(SOARED_MS)


def taken_to_last(window: PageWindow) -> None:
    """The line is in the hand, over the last of the site's."""
    last = window.value("m.scene.presets.at(-1)")
    mouse = window.page.mouse
    mouse.move(*window.at(window.line()))
    mouse.down()
    mouse.move(*window.at((last["x"], last["z"])), steps=8)
    reached = (
        "Math.hypot(m.ghost?.x - page.plane.requested.x,"
        " m.ghost?.z - page.plane.requested.z) < 0.005"
    )
    window.until(lambda: window.value(reached))


def main() -> int:
    with flight() as (address, _server), chromium() as browser:
        desk = opened(browser, address, viewport=DESK)
        desk.engage()
        for line in (1, 2):
            settled(desk, line)
        phone = opened(
            browser, address, viewport=PHONE, color_scheme="dark", device_scale_factor=1.5
        )
        desk.page.wait_for_timeout(NOTICES_MS)
        taken_to_last(desk)
        desk.page.screenshot(path=str(IMAGES / "page.png"))
        if sys.argv[1:2] == ["--dark"]:
            desk.page.evaluate("document.getElementById('theme').click()")  # the hand is full
            desk.page.screenshot(path=sys.argv[2])
        desk.page.keyboard.press("Escape")
        phone.until(lambda: phone.value("m.holder === 0"))
        phone.page.screenshot(path=str(IMAGES / "page-phone.png"))
    print(*(IMAGES / name for name in ("page.png", "page-phone.png")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
