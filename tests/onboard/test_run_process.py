"""`tgl-soar run` as a process: how it starts, what it says when it cannot, how it ends."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from free_ports import free_port
from module_process import PATIENCE_S, Module, arguments
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.onboard.process import EXIT_NO_AUTOPILOT, EXIT_OK

HEAVY = ("numpy", "scipy", "matplotlib", "rich", "typer", "pymavlink.mavutil", "serial", "pyulog")


def test_the_command_that_flies_loads_nothing_that_does_not_fly() -> None:
    """`tgl-soar run`, up to its first look at the airframe file."""
    code = "import sys\nfrom tgl_soar.cli.__main__ import main\n"
    code += "sys.argv[1:] = 'run --airframe no --site no --link udp:127.0.0.1:1'.split()\n"
    code += "try:\n    main()\nexcept SystemExit as end:\n    assert end.code, end\n"
    code += "print(*sorted(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert [name for name in HEAVY if name in loaded] == []
    ours = [name for name in loaded if name.startswith("tgl_soar.")]
    assert [name for name in ours if name.split(".")[1] in ("sim", "analysis", "air", "gym")] == []


@pytest.fixture
def module() -> Iterator[Module]:
    made = Module()
    yield made
    made.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_is_stopped_by_a_signal_and_gives_the_surfaces_back(
    module: Module, number: signal.Signals
) -> None:
    assert module.receive().get_type() == "HEARTBEAT"
    module.send(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
    begun = time.monotonic()
    engaged = stopped = False
    kinds: list[str] = []
    pulses: list[int] = []
    while not kinds or kinds[-1] != "tgl_soar stopped":
        stamp = round((time.monotonic() - begun) * 1e3)
        noise = 1e-6 * (stamp % 7)  # nothing that is measured repeats itself
        module.send(mavlink.MAVLink_attitude_quaternion_message(stamp, 1, noise, 0, 0, 0, 0, 0))
        module.send(
            mavlink.MAVLink_local_position_ned_message(stamp, -0.6, 0, -1.2 + noise, 0, 0, 0)
        )
        message = module.receive()
        kinds.append(message.get_type())
        if kinds[-1] == "STATUSTEXT":
            kinds[-1] = message.text
        if kinds[-1] == "RC_CHANNELS_OVERRIDE":
            pulses.append(message.chan2_raw)
        if not engaged and time.monotonic() - begun > 0.3:
            engaged = True
            module.command(mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9))
        if not stopped and len(pulses) > 20:
            stopped = True
            module.process.send_signal(number)
        assert time.monotonic() - begun < 10.0
    assert module.process.wait(5.0) == EXIT_OK
    assert pulses[-5:] == [0] * 5
    assert pulses[-6] != 0
    assert "Traceback" not in module.words()


def test_without_an_autopilot_it_gives_up_where_a_timeout_is_set() -> None:
    module = Module("--timeout", "0.2")
    try:
        assert module.process.wait(5.0) == EXIT_NO_AUTOPILOT
        assert "no autopilot on udpout:127.0.0.1" in module.words()
    finally:
        module.close()


def test_it_speaks_over_a_serial_line_and_survives_that_the_line_is_cut(tmp_path: Path) -> None:
    device = tmp_path / "ttyTEST"

    def plug() -> int:
        far, near = pty.openpty()
        tty.setraw(near)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(near))
        os.close(near)
        return far

    def first_message(far: int) -> Any:
        """Of what comes from now on; a cut frame before it is skipped."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        begun = time.monotonic()
        while time.monotonic() - begun < 8.0:
            select.select([far], [], [], 0.1)
            try:
                data = os.read(far, 4096)
            except OSError:  # our end is not open yet
                time.sleep(0.02)
                continue
            for message in parser.parse_buffer(data) or []:
                if message.get_type() != "BAD_DATA":
                    return message
        raise AssertionError("nothing came")

    far = plug()
    command = [sys.executable, "-m", "tgl_soar.cli", "run", *arguments(f"serial:{device}:921600")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert first_message(far).get_type() == "HEARTBEAT"
            os.close(far)
            time.sleep(0.1)  # a real cut of a real line: the process must see that it hung up
            far = plug()
            assert first_message(far).get_type() == "HEARTBEAT"
            process.send_signal(signal.SIGTERM)
            assert process.wait(5.0) == EXIT_OK
        finally:
            process.kill()
            os.close(far)


def test_an_open_unsigned_link_is_warned_of_and_a_loopback_is_not() -> None:
    module = Module("--link", f"udp:0.0.0.0:{free_port()}", "--timeout", "0.2")
    assert module.process.wait(5.0) == EXIT_NO_AUTOPILOT
    words = module.words()
    module.close()
    warnings = [line for line in words.splitlines() if "WARNING" in line]
    assert len(warnings) == 1
    assert "udp:0.0.0.0" in warnings[0]
    assert "unsigned" in warnings[0]


SECOND_SIGNAL = """
import signal, sys
from tgl_soar.onboard import process

stop = process.StopFlag()
process._stop_on_signals(stop)
left = 30

def again(*_):
    global left
    left -= 1
    if left > 0:
        signal.raise_signal(signal.SIGTERM)

sys.setprofile(again)
signal.raise_signal(signal.SIGINT)
sys.setprofile(None)
print(stop.is_set())
"""


def test_a_second_signal_in_the_middle_of_the_first_one_ends_it_all_the_same() -> None:
    """Ctrl-C sends both, a moment apart; at every step of the first one's handler."""
    handled = subprocess.run(
        [sys.executable, "-c", SECOND_SIGNAL],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert handled.stdout == "True\n", handled.stderr
