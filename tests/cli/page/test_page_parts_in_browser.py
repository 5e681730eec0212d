"""Parts of the page in a real browser, without a flight: frames are put into it as the server's."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import pytest
from free_ports import free_port
from page_flight import TOKEN, Served, desk_on
from page_window import PageWindow

from tgl_soar.control.supervisor import is_flying
from tgl_soar.control.supervisor_texts import MODE_NAMES

pytest.importorskip("starlette", reason="the extra `page` is not installed")
pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("no chromium (Debian: apt install chromium)", allow_module_level=True)

pytestmark = pytest.mark.xdist_group("page in a browser")
LINE = "{TGL_X: 0.2, TGL_Z: 1.15, TGL_LEAN: 15.0, CLEAR_MIN: 0.3}"
KEY = "new KeyboardEvent('keydown', {key: '%s', shiftKey: true, cancelable: true})"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def served() -> Iterator[Served]:
    server = Served(desk_on(free_port()))
    yield server
    server.end()


def window_on(browser: Any, served: Served, width: int = 1280, height: int = 720) -> PageWindow:
    page = browser.new_page(viewport={"width": width, "height": height})
    page.goto(served.address)
    assert served.address.endswith(TOKEN)
    window = PageWindow(page)
    window.until(lambda: window.value("m?.connected && m.pages > 0"))
    window.page.evaluate(f"page.live.onFrame({{parameters: {LINE}, alive: true}})")
    return window


def test_a_page_that_is_opened_later_reports_no_restart_that_it_did_not_see(
    browser: Any, served: Served
) -> None:
    station = served.desk.station
    station.starts = 1
    window = window_on(browser, served)
    window.until(lambda: window.value("m.starts === 1"))
    window.page.wait_for_timeout(200.0)
    assert window.page.inner_text("#notices") == ""
    frame = "{starts: 2, notices: [{ok: false, text: 'z: refused'}]}"
    window.page.evaluate(f"page.live.onFrame({frame})")
    window.until(lambda: "started again" in window.page.inner_text("#notices"))
    assert "z: refused" in window.page.inner_text("#notices")
    window.page.close()


def test_every_mode_has_a_level_and_colours_the_strips_where_the_module_flies_or_has_ended(
    browser: Any, served: Served
) -> None:
    window = window_on(browser, served)
    modes = range(len(MODE_NAMES))
    flying = window.page.evaluate(
        "(modes) => modes.map((mode) => { page.model.now.soar_mode = mode;"
        " return page.model.flying; })",
        list(modes),
    )
    assert flying == [is_flying(mode) for mode in modes]
    # A row of each mode in turn: a band of each, in the colour of its level.  A row of the server's
    # own may come in between.
    script = (
        "async (modes) => { const m = page.model; const rows = modes.map((mode) => {"
        " const row = m.scene.rows.map(() => 0); row[0] = mode + 1;"
        " row[m.columns.soar_mode] = mode; return row; });"
        " page.live.onFrame({whole: true, now: {soar_mode: 4}, rows});"
        " for (const i of [0, 1]) await new Promise(requestAnimationFrame);"
        " return [...document.querySelector('.strip svg g').children].map((b) => b.style.fill); }"
    )
    drawn: list[str] = []

    def is_whole() -> bool:
        drawn[:] = window.page.evaluate(script, list(modes))
        return len(drawn) == len(MODE_NAMES)

    window.until(is_whole)
    levels = dict.fromkeys(("capturing", "holding", "searching", "launching"), "warn")
    levels |= dict.fromkeys(("landing", "beating"), "warn")
    levels |= dict.fromkeys(("recovering", "breaking off", "released", "failed"), "bad")
    levels["soaring"] = "good"
    assert drawn == [f"var(--{levels.get(name, 'soft')})" for name in MODE_NAMES]
    window.page.close()


def test_notices_of_all_frames_between_two_drawings_are_shown(browser: Any, served: Served) -> None:
    window = window_on(browser, served)
    window.page.evaluate(
        "() => { const tell = (text) => page.live.onFrame({notices: [{ok: true, text}]});"
        " tell('first'); tell('second'); page.live.onFrame({received: 1}); }"
    )
    window.until(lambda: "second" in window.page.inner_text("#notices"))
    assert "first" in window.page.inner_text("#notices")
    assert window.value("m.notices.length") == 0
    many = "for (let i = 0; i < 99; i++) m.apply({notices: [{ok: true, text: `${i}`}]})"
    kept = window.page.evaluate(
        f"() => {{ const m = page.model; {many}; return m.notices.map((n) => n.text); }}"
    )
    assert kept == [str(i) for i in range(49, 99)]
    window.page.close()


@pytest.mark.parametrize(
    ("clearance", "level"),
    [(3.0, "good"), (0.2, "bad"), (0.0, "bad"), (-0.2, "bad"), ("NaN", "none")],
)
def test_the_gauge_of_the_height_is_red_below_its_limit_and_below_the_ground(
    clearance: Any, level: str, browser: Any, served: Served
) -> None:
    window = window_on(browser, served)
    window.page.evaluate(f"page.live.onFrame({{now: {{clearance: {clearance}}}}})")
    row = "[...document.querySelectorAll('#gauge-list > *')].find((r) => r.textContent"
    row += ".startsWith('height over the ground'))"
    window.until(lambda: window.value(f"{row}?.dataset.level") == level, 20.0)
    window.page.close()


def test_keys_lean_the_line_no_further_than_the_hand_and_enter_leaves_a_drag_alone(
    browser: Any, served: Served
) -> None:
    window = window_on(browser, served)
    for key, lean in (("}", 60), ("{", -60)):
        found = window.page.evaluate(
            f"() => {{ for (let i = 0; i < 60; i++) page.hand.pressed({KEY % key});"
            " const { lean } = page.plane.requested; page.hand.cancel(); return lean; }"
        )
        assert found == lean
    window.page.mouse.move(*window.at((0.2, 1.15)))
    window.page.mouse.down()
    window.page.mouse.move(*window.at((0.3, 1.25)), steps=3)
    window.page.keyboard.press("Enter")
    window.page.mouse.move(*window.at((0.4, 1.35)), steps=3)
    assert window.value("page.plane.requested?.x") == pytest.approx(0.4, abs=0.02)
    window.page.mouse.up()
    assert window.value("page.hand.drag === null && page.plane.requested === null")
    assert window.value("m.connected")
    window.page.close()


# --- where things stand ------------------------------------------------------------------------

SIZES = ((1400, 957), (1920, 1080), (1200, 800), (390, 844))
# Long words in every place that has some: numbers with a sign, a gauge at its limit, a message.
FULL = """() => {
  const now = { soar_x: -10.12, soar_z: -1.15, pitch: -12.9, roll: -179.9, pitch_sp: -12.0,
    fc_state: 3, fc_time: 1.5, clearance: 0.2, battery_v: 11.4, battery: 0.15, age_pos: 9.99,
    age_ap: 99.9, esc_left: 0.1, esc_time: 99, e_rho: -1.234, pt_state: 2, pt_off: -0.123,
    brake: 1, entry: 0xffffff, soar_mode: 4 };
  const texts = [{ first: 1, time: 1, count: 1, severity: 4, source: "module",
    text: "refused: the line's point is outside the fence (FENCE_Z_MAX is 2.85 m)" }];
  const parameters = { ...page.model.parameters, TGL_PLACE: -1, CAPTURE_MAX: 0.5, TGL_HOLD: 1 };
  page.live.onFrame({ now, texts, parameters, alive: true });
}"""
# Of the texts of the page those that leave their box, as "box: text".
OVER = """() => {
  const over = [];
  const walk = document.createTreeWalker(document.querySelector("main"), NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const of = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || of.closest("select, #plane, #message-list")) continue;
    const box = of.closest("#attitude, .card");
    const [inner, edge] = [document.createRange(), box.getBoundingClientRect()];
    inner.selectNodeContents(walk.currentNode);
    for (const r of inner.getClientRects()) {
      const is_over = r.left < edge.left + 5 || r.right > edge.right - 5;
      if (r.width && is_over) over.push(`${box.id}: ${of.textContent}`);
    }
  }
  const [pitch, roll] = document.querySelectorAll("#attitude text");
  const room = roll.getBoundingClientRect().left - pitch.getBoundingClientRect().right;
  if (room < 2) over.push("pitch and roll");
  if (document.documentElement.scrollWidth > innerWidth) over.push("the page itself");
  return over;
}"""


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_no_text_leaves_its_card(width: int, height: int, browser: Any, served: Served) -> None:
    window = window_on(browser, served, width=width, height=height)
    window.page.evaluate(FULL)
    window.until(lambda: "elsewhere" in window.page.inner_text("#place-words"))
    window.until(lambda: "at its limit" in window.page.inner_text("#gauge-list"))
    assert window.page.evaluate(OVER) == []
    window.page.close()


@pytest.mark.parametrize(("width", "height"), SIZES[:2])
def test_the_plane_has_most_of_a_wide_screen_and_messages_a_sixth(
    width: int, height: int, browser: Any, served: Served
) -> None:
    window = window_on(browser, served, width=width, height=height)
    sides = "['plane-box', 'messages', 'checks'].map((n) => document.getElementById(n))"
    sides += ".map((e) => e.getBoundingClientRect())"
    plane, messages, checks = (window.value(f"{sides}[{i}].toJSON()") for i in range(3))
    assert plane["width"] > 0.59 * width
    assert messages["width"] < 0.17 * width
    assert checks["bottom"] <= height  # nobody scrolls for them
    window.page.close()


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_no_aircraft_and_no_contour_covers_a_name(
    width: int, height: int, browser: Any, served: Served
) -> None:
    """An arch as surveys measure them: its top is in its middle, its ends are lower."""
    window = window_on(browser, served, width=width, height=height)
    arch = [[0.05 + 0.1 * i, 1.9 - 0.9 * (1.0 - 0.1 * i) ** 2] for i in range(13)]
    drawing = {"contour": [arch], "cells": [[1]], "x": 0, "z": 1, "step": 1, "readings": 9}
    window.page.evaluate("(measured) => page.live.onFrame({measured})", drawing)
    window.until(lambda: window.value("page.plane.part.measuredTag.textContent === 'measured'"))
    covered = window.page.evaluate(
        """async () => {
          const box = (e) => e.getBoundingClientRect();
          const meet = (a, b) => a.left < b.right && b.left < a.right
            && a.top < b.bottom && b.top < a.bottom;
          const covered = [];
          const { plane, model } = page;
          const curve = plane.part.measured;
          const edge = box(plane.svg);
          const tag = box(plane.part.measuredTag);
          for (let s = 0; s < curve.getTotalLength(); s++) {
            const { x, y } = curve.getPointAtLength(s);
            const at = new DOMRect(edge.left + x, edge.top + y, 0, 0);
            if (meet(tag, at)) { covered.push("measured"); break; }
          }
          for (const preset of model.scene.presets) {
            page.live.onFrame({ now: { soar_x: preset.x, soar_z: preset.z, pitch: 10 } });
            plane.update();
            const texts = [...plane.svg.querySelectorAll("text")];
            const name = texts.find((t) => t.textContent === preset.name);
            if (meet(box(name), box(plane.part.craft))) covered.push(preset.name);
          }
          return covered;
        }"""
    )
    assert covered == []
    window.page.close()
