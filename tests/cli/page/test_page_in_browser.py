"""The page in a real browser, on a simulated flight: what an operator does and what they read.

A chromium of the system's is driven by playwright; without either these tests are skipped.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from math import cos, hypot, nan, radians, sin
from pathlib import Path
from typing import Any

import pytest
from page_flight import (
    PATIENCE_S,
    READY,
    SITE,
    SOARING,
    Flown,
    Flying,
    Served,
    page_on_a_flight,
)
from page_window import PageWindow
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_site, shipped
from tgl_soar.config.line_changes import contour_place
from tgl_soar.config.parameter_groups import group_of
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.link.frames import first_frame

pytest.importorskip("starlette", reason="the extra `page` is not installed")
pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("no chromium (Debian: apt install chromium)", allow_module_level=True)

pytestmark = pytest.mark.xdist_group("page in a browser")
SPOILERS = shipped("airframes/eclipson_c_spoilers.toml")
A, B, C = (0.20, 1.15), (0.60, 1.60), (1.05, 2.00)
NUMBERS = {"NAMED_VALUE_FLOAT", "DEBUG_FLOAT_ARRAY", "ATTITUDE"}
MARKUP = "<img src=x onerror=page.hacked=1><b>bold"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


# Of the notices, all that are ever shown from now on.
NOTES = """() => {
  window.noted = [];
  const place = document.querySelector("#notices");
  const note = () => window.noted.push(place.innerText);
  new MutationObserver(note).observe(place, {childList: true, subtree: true, characterData: true});
}"""


class Window(PageWindow):
    """One that is kept to its errors."""

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        self._context = browser.new_context(
            **{"viewport": {"width": 1300, "height": 850}, **options}
        )
        super().__init__(self._context.new_page())
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)

    def until(self, condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> None:
        super().until(condition, patience_s)

    def shows(self, where: str, text: str) -> None:
        self.until(lambda: text in self.page.inner_text(where))

    def loaded(self) -> Window:
        self.until(lambda: self.value("m?.line != null && m.now.soar_x != null"))
        return self

    def take(self, place: tuple[float, float], to: tuple[float, float]) -> None:
        """Drag the line's point, and keep it in the hand."""
        self.page.mouse.move(*self.at(place))
        self.page.mouse.down()
        self.page.mouse.move(*self.at(to), steps=8)

    def close(self) -> None:
        assert self.errors == []
        self._context.close()


@pytest.fixture
def flight() -> Iterator[tuple[Flying, Served]]:
    with page_on_a_flight() as (flying, served):
        flying.until(lambda flown: flown.mode == READY)
        yield flying, served


def engaged(window: Window, flying: Flying) -> None:
    window.until(lambda: window.page.is_enabled("#engage"))
    window.page.click("#engage")
    flying.until(lambda flown: flown.mode == SOARING)


def test_the_line_is_dragged_and_the_aircraft_settles_at_the_ghost(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    window = Window(browser, served.address).loaded()
    window.until(lambda: "all hold" in window.page.inner_text("#checks-count"))
    engaged(window, flying)
    window.take(A, C)
    window.until(lambda: window.value("m.ghost?.place"))
    window.shows("#ghost-words", "settles at x 1.0")
    window.until(lambda: window.value("Math.abs(m.ghost.x - 1.05) < 0.02"))
    ghost = window.value("m.ghost")
    assert flying.flown.value("TGL_X") == pytest.approx(A[0])  # nothing goes out before
    window.page.mouse.up()
    flying.until(lambda flown: abs(flown.value("TGL_X") - ghost["x"]) < 0.02)
    window.until(lambda: window.value("Math.abs(m.line.x - 1.05) < 0.02"))  # the module's echo
    began_s = flying.flown.simulation.time_s
    flying.until(
        lambda flown: (
            flown.simulation.time_s > began_s + ghost["settles_s"] + 4.0 and flown.mode == SOARING
        )
    )
    x, z = flying.flown.place
    assert hypot(x - ghost["place"][0], z - ghost["place"][1]) < 0.15  # test_settling_preview.py
    window.page.click("#undo")
    flying.until(lambda flown: flown.value("TGL_X") == pytest.approx(A[0]))
    window.page.click("#presets button:nth-child(2)")
    flying.until(lambda flown: flown.value("TGL_X") == pytest.approx(B[0]))
    window.close()


def test_refusals_keys_abort_and_a_reload_while_dragging(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    window = Window(browser, served.address).loaded()
    engaged(window, flying)
    window.take(A, (1.0, 3.1))
    window.shows("#ghost-words", "Would be refused: the line's point is outside the fence")
    window.page.mouse.up()
    window.shows("#message-list", "outside the fence (FENCE_Z_MAX is 2.85 m)")
    window.shows("#notices", "refused")
    assert flying.flown.value("TGL_Z") == pytest.approx(A[1])

    window.page.focus("#plane")
    window.page.keyboard.press("ArrowRight")
    window.page.keyboard.press("Shift+ArrowUp")
    window.page.keyboard.press("Enter")
    flying.until(lambda flown: flown.value("TGL_X") == pytest.approx(0.21))
    assert flying.flown.value("TGL_Z") == pytest.approx(1.25)
    window.until(lambda: window.value("Math.abs(m.line.z - 1.25) < 1e-3"))
    window.page.keyboard.press("ArrowLeft")
    window.page.keyboard.press("Escape")
    window.until(lambda: window.value("m.holder === 0"))

    window.take((0.21, 1.25), B)
    window.until(lambda: window.value("m.holder === m.you"))
    window.page.reload()
    window.loaded()
    window.until(lambda: window.value("m.holder === 0"))
    assert flying.flown.value("TGL_X") == pytest.approx(0.21)

    window.page.evaluate(NOTES)  # a notice goes away again, before it is looked for perhaps
    window.page.click("#abort")
    window.until(lambda: "abort: done" in window.value("noted.join()"))
    flying.until(lambda flown: flown.value("OP_ENGAGE") == 0.0)
    window.shows("#check-list", "missing: not held back")
    window.close()


def test_of_two_windows_one_holds_the_line_and_the_other_sees_it(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    anna, bert = (Window(browser, served.address).loaded() for _ in range(2))
    anna.take(A, B)
    bert.shows("#holder", "holds the line")
    bert.until(lambda: bert.value("m.ghost?.place"))  # it shows where that will end
    bert.page.focus("#plane")
    bert.page.keyboard.press("ArrowUp")
    bert.page.keyboard.press("Enter")
    assert bert.page.is_disabled("#presets button:nth-child(1)")
    anna.page.keyboard.press("Escape")
    bert.until(lambda: bert.page.is_enabled("#presets button:nth-child(1)"))
    assert flying.flown.value("TGL_Z") == pytest.approx(A[1])
    for window in (anna, bert):
        window.close()


def not_numbers(data: bytes) -> bytes:
    """A frame of module or autopilot with NaN for each number that has a fraction."""
    messages = mavlink.MAVLink(None).parse_buffer(bytearray(data)) or []
    if len(messages) != 1 or messages[0].get_type() not in NUMBERS:
        return data
    (message,) = messages
    for field, wire in zip(message.fieldnames, message.fieldtypes, strict=True):
        if wire == "float":
            value = getattr(message, field)
            many = isinstance(value, list | tuple)
            setattr(message, field, [nan] * len(value) if many else nan)
    sender = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
    return bytes(message.pack(sender))


def test_a_bad_link_is_reported_and_harms_nothing(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    window = Window(browser, served.address).loaded()
    module = mavlink.MAVLink(None, 1, 191)
    nothing = mavlink.MAVLink_named_value_float_message(0, b"e_rho", float("nan")).pack(module)
    markup = mavlink.MAVLink_statustext_message(2, MARKUP.encode(), 0, 0).pack(module)

    def corrupted(data: bytes) -> bytes:
        if data[7:10] == b"\xfb\0\0" and b"e_rho" in data:
            return bytes(nothing)
        return bytes(markup) if data[7:10] == b"\xfb\0\0" and b"rtt_ms" in data else data

    engaged(window, flying)
    flying.flown.altered = corrupted
    window.shows("#message-list", MARKUP)
    assert window.page.query_selector("#message-list img") is None
    assert window.value("window.page.hacked") is None
    window.until(lambda: "distance to the line\n–" in window.page.inner_text("#gauge-list"))
    flying.flown.altered = not_numbers
    every = "['soar_x', 'line_x', 'pitch', 'updraft', 'fc_z', 'clearance', 'stall', 'entry']"
    window.until(lambda: window.value(f"{every}.every((name) => Number.isNaN(m.now[name]))"))
    window.shows("#line-words", "no position")
    window.shows("#checks-count", "not known")
    window.until(lambda: "place to settle\n–" in window.page.inner_text("#gauge-list"))
    window.until(lambda: "height over the ground\n–" in window.page.inner_text("#gauge-list"))
    flying.flown.altered = bytes
    window.until(lambda: window.value("Number.isFinite(m.now.soar_x + m.now.fc_state)"))
    assert flying.flown.mode == SOARING
    window.page.click("#release")
    flying.until(lambda flown: flown.mode != SOARING)

    flying.is_cut = True
    window.shows("#banner", "No telemetry for")
    window.until(lambda: window.page.is_disabled("#engage"))
    window.page.click("#presets button:nth-child(2)")
    window.shows("#notices", "the module does not answer")
    flying.is_cut = False
    window.until(lambda: not window.page.is_visible("#banner"))
    assert flying.flown.value("TGL_X") == pytest.approx(A[0])

    window.take(A, B)
    window.until(lambda: window.value("m.holder === m.you"))
    with flying.lock:
        flying.flown.restart_module()
    window.shows("#notices", "started again")
    window.until(lambda: window.value("page.plane.requested === null"))  # out of the hand
    window.page.mouse.up()
    window.loaded()
    assert flying.flown.value("TGL_X") == pytest.approx(A[0])
    window.close()


def test_what_the_module_foresees_and_measures_is_seen(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    window = Window(browser, served.address).loaded()
    assert window.value("getComputedStyle(page.plane.part.foreseen).visibility") == "hidden"
    engaged(window, flying)
    # Where it will stop: a mark on the line that is flown, and a gauge.
    is_visible = "(name) => getComputedStyle(page.plane.part[name]).visibility === 'visible'"
    window.until(lambda: window.page.evaluate(is_visible, "foreseenRing"))
    window.shows("#gauge-list", "place to settle\nz 1.")
    assert not window.page.evaluate(is_visible, "foreseenCross")
    # It lies above the knob of the line, where the aircraft settles there: it takes no pointer.
    mark = "['foreseenRing', 'foreseenTag'].map((n) => getComputedStyle(page.plane.part[n]))"
    assert window.value(f"{mark}.map((style) => style.pointerEvents)") == ["none", "none"]
    # The map of what is measured, in the place of the site's.
    window.until(lambda: window.value("m.measured?.readings > 10"))
    picture = "page.plane.under.firstChild?.getAttribute('href')"
    site = window.value(picture)
    window.page.select_option("#air", "measured")
    window.until(lambda: window.value(picture) not in (None, site))
    window.until(lambda: window.value("page.plane.part.measured.getAttribute('d').length > 20"))
    window.shows("#air-words", "readings")
    # Nowhere to settle: the loudest of all gauges, and a cross.
    module = mavlink.MAVLink(None, 1, 191)
    reported = {b"fc_state": 2.0, b"fc_chance": 0.01, b"fc_time": 1.5, b"fc_z": 0.7}
    frames = {
        name: bytes(mavlink.MAVLink_named_value_float_message(0, name, value).pack(module))
        for name, value in reported.items()
    }

    def sinking(data: bytes) -> bytes:
        is_named = data[7:10] == b"\xfb\0\0"
        return frames.get(data[18:-2], data) if is_named else data

    flying.flown.altered = sinking
    words = "place to settle\nnone: sinks below CLEAR_MIN in 1.5 s"
    window.until(lambda: window.page.inner_text("#gauge-list").startswith(words))
    window.until(lambda: window.page.evaluate(is_visible, "foreseenCross"))
    words = window.value("page.plane.part.foreseenTag.textContent")
    assert words == "no place to settle · 1.5 s"
    assert not window.page.evaluate(is_visible, "foreseenRing")
    # The way home: what it would leave, and where it leads, where there is a place at all.
    assert "height left for landing" not in window.page.inner_text("#gauge-list")
    for name, value in ((b"esc_left", 1.2), (b"esc_time", 12.0)):
        named = mavlink.MAVLink_named_value_float_message(0, name, value)
        frames[name] = bytes(named.pack(module))
    window.shows("#gauge-list", "height left for landing\n1.2 m, gone in 12 s – close")
    assert window.page.query_selector(".landing") is None
    window.value("Object.assign(m.parameters, { LND_X: 0.5, LND_Z: 0.2, LND_LEN: 0.6 }) && 0")
    window.until(lambda: window.page.query_selector(".landing") is not None)
    ends = (
        "['x1', 'x2'].map((name) => Number(document.querySelector('.landing').getAttribute(name)))"
    )
    left, right = window.value(ends)
    assert right - left == pytest.approx(0.6 * window.value("page.plane.scale"))
    flying.flown.altered = bytes
    window.page.click("#release")
    window.until(lambda: not window.page.evaluate(is_visible, "foreseen"))
    window.close()


def test_a_point_is_held_and_dragged_along_the_line(browser: Any) -> None:
    with page_on_a_flight(SPOILERS) as (flying, served):
        flying.until(lambda flown: flown.mode == READY)
        window = Window(browser, served.address).loaded()
        window.page.click("#presets button:nth-child(2)")
        flying.until(lambda flown: flown.value("TGL_X") == pytest.approx(B[0]))
        engaged(window, flying)
        # The part of the line on which the brake can hold it: 0.33 m, as the experiment has it.
        assert window.value("page.plane.part.point.getAttribute('visibility')") == "hidden"
        window.page.click("#hold-point")
        flying.until(lambda flown: flown.value("TGL_HOLD") == 1.0)
        along = flying.flown.value("TGL_ALONG")
        assert -0.4 < along < 0.0  # below where the line alone would settle
        window.until(lambda: window.value("m.parameters.TGL_HOLD === 1"))
        window.shows("#point-words", "held")
        ends = window.value(
            "['x1', 'y1', 'x2', 'y2'].map((n) => +page.plane.part.pointBand.getAttribute(n))"
        )
        width = hypot(ends[2] - ends[0], ends[3] - ends[1]) / window.value("page.plane.scale")
        assert width == pytest.approx(0.33, abs=0.06)
        # Dragged, it stays on the line; nothing goes out before it is released.
        lean = radians(15.0)
        place, to = ((B[0] - a * sin(lean), B[1] + a * cos(lean)) for a in (along, along - 0.06))
        window.take(place, (to[0] + 0.1 * cos(lean), to[1] + 0.1 * sin(lean)))
        assert flying.flown.value("TGL_ALONG") == along
        window.page.mouse.up()
        flying.until(lambda flown: abs(flown.value("TGL_ALONG") - along + 0.06) < 0.016)
        assert flying.flown.value("TGL_X") == pytest.approx(B[0])
        window.page.click("#hold-point")
        flying.until(lambda flown: flown.value("TGL_HOLD") == 0.0)
        window.close()


def test_a_survey_is_begun_and_stopped_and_the_aircraft_moved_along_the_contour(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    window = Window(browser, served.address).loaded()
    engaged(window, flying)
    flying.until(lambda flown: flown.mode == SOARING)
    window.until(lambda: window.page.is_enabled("#survey"))
    window.page.click("#survey")
    flying.until(lambda flown: flown.value("SRV_START") == 1.0)
    window.shows("#survey", "Stop the survey (downstream)")
    assert window.page.is_disabled("#place")
    window.page.click("#survey")
    flying.until(lambda flown: flown.value("SRV_START") == 0.0)
    window.shows("#message-list", "survey ended by the operator")
    window.until(lambda: window.page.is_enabled("#place"))
    assert window.page.inner_text("#place-words") == "elsewhere"
    window.page.fill("#place", "1.2")
    window.page.dispatch_event("#place", "change")
    flying.until(lambda flown: flown.value("TGL_PLACE") == pytest.approx(1.2))
    window.shows("#place-words", "1.20 m")
    x_m, z_m = contour_place(load_site(SITE).contour_for("Eclipson Model C"), 1.2)
    assert flying.flown.value("TGL_X") == pytest.approx(x_m)
    assert flying.flown.value("TGL_Z") == pytest.approx(z_m)
    assert window.errors == []
    window.close()


def test_a_wrong_token_and_a_dead_server_are_reported(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    wrong = Window(browser, served.address[:-1] + "x")
    wrong.shows("#banner", "wrong token")
    wrong.close()
    window = Window(browser, served.address).loaded()
    engaged(window, flying)
    served.end()
    window.shows("#banner", "The flight goes on")
    now_s = flying.flown.simulation.time_s
    flying.until(lambda flown: flown.simulation.time_s > now_s + 3.0)
    assert flying.flown.mode == SOARING
    window.close()


def test_parameters_stand_under_the_topics_that_the_manual_has(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    _, served = flight
    window = Window(browser, served.address).loaded()
    listed = window.value(
        "[...document.querySelectorAll('#parameter-list section')].map((section) => ["
        "section.querySelector('h3').textContent,"
        "[...section.querySelectorAll('code')].map((name) => name.textContent)])"
    )
    wanted: dict[str, list[str]] = {}
    for parameter in PARAMETERS:
        wanted.setdefault(group_of(parameter.name).title, []).append(parameter.name)
    assert dict(listed) == wanted
    assert len(listed) == len(wanted)
    window.close()


def test_on_a_phone_and_in_the_dark(browser: Any, flight: tuple[Flying, Served]) -> None:
    flying, served = flight
    phone = Window(
        browser,
        served.address,
        viewport={"width": 360, "height": 740},
        color_scheme="dark",
        has_touch=True,
    ).loaded()
    assert phone.value("document.documentElement.scrollWidth <= innerWidth")
    assert phone.value("document.documentElement.dataset.theme") == "dark"
    heights = phone.value(
        "[...document.querySelectorAll('.commands button, .presets button')]"
        ".map((b) => b.getBoundingClientRect().height)"
    )
    assert min(heights) >= 44  # a finger's width
    back = "getComputedStyle(document.body).backgroundColor"
    dark = phone.value(back)
    phone.page.click("#theme")
    phone.until(lambda: phone.value(back) != dark)
    engaged(phone, flying)
    phone.page.tap("#release")
    flying.until(lambda flown: flown.value("OP_ENGAGE") == 0.0)
    phone.close()


def test_a_finger_drags_the_line_and_scrolls_the_page_beside_it(
    browser: Any, flight: tuple[Flying, Served]
) -> None:
    flying, served = flight
    phone = Window(
        browser, served.address, viewport={"width": 360, "height": 740}, has_touch=True
    ).loaded()
    finger = phone.page.context.new_cdp_session(phone.page)

    def touch(kind: str, *at: tuple[float, float]) -> None:
        points = [{"x": x, "y": y} for x, y in at]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def stroke(start: tuple[float, float], end: tuple[float, float]) -> None:
        """A finger is put down and moved."""
        touch("touchStart", start)
        (x, y), (to_x, to_y) = start, end
        for i in range(1, 9):
            touch("touchMove", (x + i / 8 * (to_x - x), y + i / 8 * (to_y - y)))

    stroke(phone.at(A), phone.at(B))
    phone.until(lambda: phone.value("m.holder === m.you && m.ghost?.place"))

    def trembles() -> bool:
        """No finger is held quite still, and a busy browser may miss its last move."""
        x, y = phone.at(B)
        for off in (0.5, 0.0):
            touch("touchMove", (x + off, y))
        phone.page.wait_for_timeout(200.0)
        return bool(phone.value("Math.abs(m.ghost?.z - 1.6) < 0.02"))

    phone.until(trembles)
    assert phone.value("scrollY") == 0  # the line has followed the finger, and not the page
    assert flying.flown.value("TGL_X") == pytest.approx(A[0])
    touch("touchEnd")
    flying.until(lambda flown: flown.value("TGL_X") == pytest.approx(B[0], abs=0.02))
    phone.until(lambda: phone.value("Math.abs(m.line.x - 0.6) < 0.02"))

    # A call that comes in takes the touch away.
    before = flying.flown.value("TGL_X")
    line = phone.value("[m.line.x, m.line.z]")
    stroke(phone.at(line), phone.at(A))
    phone.until(lambda: phone.value("m.holder === m.you"))
    touch("touchCancel")
    phone.until(lambda: phone.value("m.holder === 0 && page.plane.requested === null"))
    assert flying.flown.value("TGL_X") == before
    x, y = phone.at(C)
    stroke((x, y), (x, y - 150.0))
    touch("touchEnd")
    phone.until(lambda: phone.value("scrollY > 50"))
    phone.close()


def test_a_recording_is_replayed_with_a_slider(browser: Any, tmp_path: Path) -> None:
    from tgl_soar.cli.page.command import recorded_desk

    log = tmp_path / "flown.tlog"
    flown = Flown()
    with log.open("wb") as file:
        for slice_ in range(150):
            stamp_us = 1_800_000_000_000_000 + slice_ * 100_000
            if slice_ == 60:
                flown.onboard.settings.assign("OP_ENGAGE", 1.0)
            for data in flown.run(0.1):
                while frame := first_frame(data):  # a stamp for each, as stations write it
                    file.write(stamp_us.to_bytes(8, "big") + frame)
                    data = data.removeprefix(frame)
    desk, notes = recorded_desk(log)
    served = Served(desk)
    window = Window(browser, served.address)
    window.until(lambda: window.value("m?.rows.length > 0"))
    assert window.page.is_visible("#replay")
    assert [
        f"the log holds no {kind} file" in n
        for kind, n in zip(("airframe", "site"), notes, strict=True)
    ] == [True] * 2
    assert window.page.inner_text("#banner") == " · ".join(notes)
    slide = "(t) => { const s = document.getElementById('slider'); s.value = t;"
    slide += " s.dispatchEvent(new Event('input')); }"
    window.page.evaluate(slide, 5.5)
    window.shows("#mode", "ready")
    window.page.evaluate(slide, 14.0)
    window.shows("#mode", "soaring")
    place = window.value("[m.now.soar_x, m.now.soar_z]")
    assert place == pytest.approx(flown.place, abs=0.1)
    assert window.value("m.line.x") == pytest.approx(window.value("m.now.line_x"))
    assert window.value("m.measured.readings > 10")
    gauges = window.page.inner_text("#gauge-list")
    assert "place to settle\nz 1." in gauges
    assert "height over the ground\n–" not in gauges
    assert window.page.is_disabled("#engage")
    assert window.page.is_disabled("#presets button:nth-child(1)")
    assert "recording" in window.page.inner_text("#ghost-words")
    assert json.loads(served.desk.recording)["rows"]
    window.close()
    served.end()
