"""What a flight puts on its line, added up; and the report that it is too much."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import threading
import tty
from pathlib import Path

import pytest
from module_process import AIRFRAME, SITE, arguments
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.link.open_link import baud_of
from tgl_soar.link.transports.base import LinkError
from tgl_soar.onboard import process
from tgl_soar.onboard.link_load import RATES_BAUD, USED_MAX, LineLoad, load_of
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import ModuleSetup, setup_from


def flown(**changes: float) -> ModuleSetup:
    plane, place = load_airframe(AIRFRAME), load_site(SITE)
    setup = setup_from(plane, place, load_parameters(plane, AIRFRAME, place, SITE))
    return setup._replace(parameters=setup.parameters.changed(changes))


def test_it_is_the_sum_of_what_is_asked_for_and_sent() -> None:
    slow, fast = load_of(flown(LOOP_RATE=100.0)), load_of(flown(LOOP_RATE=200.0))
    override, attitude, accelerations = 30, 32 + 12, 29 + 12
    assert fast.to_autopilot - slow.to_autopilot == pytest.approx(100 * override)
    quiet = load_of(flown(TEL_BUDGET=400.0))
    talkative = load_of(flown(TEL_BUDGET=2400.0))
    assert talkative.to_autopilot - quiet.to_autopilot == 2000
    assert fast.to_companion - slow.to_companion == pytest.approx(100 * (attitude + accelerations))
    assert fast.to_autopilot == pytest.approx(200 * override + 2400 + 21, abs=30)


def test_the_pages_rates_are_judged_as_the_page_says() -> None:
    load = load_of(flown())
    assert not load.is_carried_by(57_600)
    assert not load.is_carried_by(115_200)
    assert load.is_carried_by(460_800)
    assert load.is_carried_by(921_600)
    signed = load_of(flown(), signed=True)
    assert signed.to_autopilot - load.to_autopilot == pytest.approx(200 * 13 + 13)


def test_the_page_lists_the_rates_that_are_asked_for() -> None:
    """docs/hardware.md, `to the companion`: each message that it requests, and how often."""
    page = (Path(__file__).parents[2] / "docs/hardware.md").read_text(encoding="utf-8")
    table = page.partition("| to the companion | Hz |")[2].partition("| **from the companion** |")[
        0
    ]
    rows = [row.split("|")[1:3] for row in table.splitlines() if row.startswith("| ")]
    listed = {
        name: float(rate) for what, rate in rows for name in re.findall(r"`([A-Z_]{7,})`", what)
    }
    module = Onboard(flown(OP_RC_CHAN=7.0), lambda _: True, 0.0)
    wanted = {each.name: each.rate_hz for each in module.session.streams.all_wanted()}
    often = {name: rate_hz for name, rate_hz in wanted.items() if rate_hz >= 10.0}
    assert {"LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW", "RC_CHANNELS"} <= often.keys()
    assert often == {name: listed[name] for name in often}


def test_the_page_counts_whole_messages() -> None:
    """docs/hardware.md: payload and header of a message, times its rate, as the sum has them."""
    page = (Path(__file__).parents[2] / "docs/hardware.md").read_text(encoding="utf-8")
    table = page.partition("| to the companion | Hz |")[2].partition("\n\n")[0]
    sizes = {name: int(size) for name, size in re.findall(r"`([A-Z_]+)` \((\d+) \+ 12", table)}
    messages = {message.msgname: message.unpacker.size for message in mavlink.mavlink_map.values()}
    assert {"RAW_IMU", "HIGHRES_IMU", "SERVO_OUTPUT_RAW"} <= sizes.keys()
    ours = {"RC_CHANNELS_OVERRIDE": 18}  # the channels 9 to 18 are zeros, and cut off
    assert sizes == {name: ours.get(name, messages[name]) for name in sizes}
    for cells in (row.split("|")[1:4] for row in table.splitlines() if " + 12" in row):
        each = [(int(size) + 12) * float(cells[1]) for size in re.findall(r"(\d+) \+ 12", cells[0])]
        assert [float(n.replace(" ", "")) for n in cells[2].split(" or ")] == pytest.approx(
            each, abs=50.0
        )


def test_the_way_out_is_the_lowest_rate_that_carries_it() -> None:
    carried = USED_MAX * 115_200 / 10
    assert LineLoad(carried, 1.0).refusal(115_200) == ""
    assert "take 230400 baud" in LineLoad(1.0, carried + 1.0).refusal(115_200)
    assert "lower LOOP_RATE" in LineLoad(1.0, RATES_BAUD[-1] / 1.0).refusal(921_600)


@pytest.mark.parametrize(
    ("link", "baud"),
    [("serial:/dev/ttyX:57600", 57_600), ("serial:/dev/ttyX", 921_600), ("udp:127.0.0.1:1", None)],
)
def test_only_a_serial_line_has_a_rate(link: str, baud: int | None) -> None:
    assert baud_of(link) == baud
    with pytest.raises(LinkError):
        baud_of("serial:/dev/ttyX:fast")


def slow_line(tmp_path: Path) -> tuple[int, str]:
    far, near = pty.openpty()
    tty.setraw(near)
    device = tmp_path / "ttyTEST"
    device.symlink_to(os.ttyname(near))
    return far, f"serial:{device}:57600"


def test_a_flight_over_it_begins_with_a_warning(tmp_path: Path) -> None:
    far, link = slow_line(tmp_path)
    flight = [sys.executable, "-m", "tgl_soar.cli", "run", *arguments(link, "--timeout", "0.1")]
    ended = subprocess.run(flight, capture_output=True, text=True, timeout=60.0, check=False)
    os.close(far)
    assert ended.returncode == process.EXIT_NO_AUTOPILOT
    assert "too slow: 57600 baud carries 5760 bytes" in ended.stderr


def test_preflight_fails_over_it(tmp_path: Path) -> None:
    far, link = slow_line(tmp_path)
    beats, ended = mavlink.MAVLink(None, 1, 1), threading.Event()

    def beat() -> None:
        while not ended.wait(0.2):
            os.write(far, mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3).pack(beats))

    vehicle = threading.Thread(target=beat)
    vehicle.start()
    try:
        ended_as = subprocess.run(
            [
                *(sys.executable, "-m", "tgl_soar.cli", "preflight", "--link", link),
                *("--airframe", "eclipson_c", "--site", "tunnel"),
            ],
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
            env={"COLUMNS": "160", "PYTHONPATH": ":".join(sys.path)},
        )
    finally:
        ended.set()
        vehicle.join()
        os.close(far)
    assert ended_as.returncode == 1
    assert "too slow: 57600 baud" in ended_as.stdout
    assert "take 460800 baud" in ended_as.stdout
