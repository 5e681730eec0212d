"""Parameters changed over the air, before and after a kill of the process that flies."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.parameter_store import Identity, state_file, state_text
from tgl_soar.onboard import process
from tgl_soar.onboard.command_line import RunOptions

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
IDENTITY = Identity(load_airframe(AIRFRAME).airframe.name, load_site(SITE).site.name)
FILE = state_file(Path(), AIRFRAME, SITE, IDENTITY).name


class Flying:
    """The process, with a vehicle and a ground station at the other end of its link."""

    def __init__(self, state: Path | str) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        link = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        files = ["--airframe", str(AIRFRAME), "--site", str(SITE)]
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "tgl_soar.cli", "run", *files, "--link", link),
                *("--state", str(state)),
            ],
            stderr=subprocess.PIPE,
            text=True,
        )
        self.vehicle, self.station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
        self.codec = mavlink.MAVLink(None)
        self.texts: list[str] = []
        self.values: dict[str, float] = {}
        self.address: Any = None
        self._heartbeat_s = 0.0
        self.until(lambda: self.address is not None)

    def until(self, condition: Callable[[], bool], seconds: float = 10.0) -> bool:
        end = time.monotonic() + seconds
        while not condition():
            now = time.monotonic()
            if now > end:
                return False
            if self.address and now - self._heartbeat_s > 0.5:
                self._heartbeat_s = now
                self.send(self.vehicle, mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
            try:
                data, self.address = self.socket.recvfrom(2048)
            except TimeoutError:
                continue
            message = self.codec.decode(bytearray(data))
            if message.get_type() == "STATUSTEXT":
                if message.chunk_seq:
                    self.texts[-1] += message.text
                else:
                    self.texts.append(message.text)
            elif message.get_type() == "PARAM_VALUE":
                self.values[message.param_id] = message.param_value
        return True

    def send(self, sender: Any, message: Any) -> None:
        self.socket.sendto(message.pack(sender), self.address)
        sender.seq = (sender.seq + 1) % 256

    def set(self, name: str, value: float) -> None:
        self.values.pop(name, None)
        message = mavlink.MAVLink_param_set_message(1, 191, name.encode(), value, 9)
        self.send(self.station, message)
        assert self.until(lambda: name in self.values)

    def read(self, name: str) -> float:
        self.values.pop(name, None)
        message = mavlink.MAVLink_param_request_read_message(1, 191, name.encode(), -1)
        self.send(self.station, message)
        assert self.until(lambda: name in self.values)
        return self.values[name]

    def end(self, number: signal.Signals) -> str:
        """What it has printed on the console."""
        self.process.send_signal(number)
        words = self.process.communicate(timeout=10.0)[1]
        self.socket.close()
        return words


def test_changes_survive_a_kill_and_a_damaged_file(tmp_path: Path) -> None:
    file = tmp_path / "deep" / "state" / FILE
    first = Flying(file.parent)
    first.set("TGL_PRESET", 3)
    first.set("RHO_D", 0.5)
    first.set("OP_ENGAGE", 1)
    assert first.until(lambda: file.exists() and b"RHO_D" in file.read_bytes())
    words = first.end(signal.SIGKILL)
    assert f"stored in {file}" in words

    second = Flying(file.parent)
    assert second.read("RHO_D") == 0.5
    assert second.read("TGL_PRESET") == 3.0
    assert second.read("TGL_X") == pytest.approx(1.05)
    assert second.read("OP_ENGAGE") == 0.0  # never engaged at boot
    assert second.until(lambda: any("stored parameters: " in text for text in second.texts))
    second.set("RHO_D", 0.6)
    words = second.end(signal.SIGTERM)  # at once: the last change is written at the end
    assert "stored parameters: TGL_PRESET, TGL_X, TGL_Z, RHO_D" in words

    assert b"RHO_D\t0.6" in file.read_bytes()
    file.write_bytes(file.read_bytes()[:-3])
    third = Flying(file.parent)
    assert third.read("RHO_D") == 0.5  # of the previous copy
    assert third.until(lambda: any("checksum is wrong" in text for text in third.texts))
    assert "checksum is wrong" in third.end(signal.SIGKILL)


@pytest.mark.parametrize("name", [FILE, "eclipson_c-tunnel.params"])  # as version 0.1.0 called it
def test_a_stored_switch_that_moves_a_surface_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The surfaces were moved to other channels since."""
    airframe = load_airframe(AIRFRAME)
    channel = airframe.surfaces.rudder.channel
    store = tmp_path / FILE
    kept = {"OP_RC_CHAN": float(channel)}
    (tmp_path / name).write_bytes(state_text(IDENTITY, kept))
    links = ("udp:127.0.0.1:0",)
    options = RunOptions(airframe=AIRFRAME, site=SITE, links=links, state=tmp_path, timeout_s=0.1)
    end = process.run(options)
    assert end == process.EXIT_CANNOT_START
    words = capsys.readouterr().err
    assert f"{store}: OP_RC_CHAN = {channel}: this channel moves a surface: 1 to 18 but" in words
    assert "tgl-soar params import" in words


def test_without_a_place_to_store_it_flies_on_and_says_so_once(tmp_path: Path) -> None:
    nowhere = tmp_path / "a_file"
    nowhere.write_text("")
    flying = Flying(nowhere)
    flying.set("RHO_D", 0.5)
    assert flying.until(lambda: any("not kept" in text for text in flying.texts))
    flying.set("RHO_D", 0.6)
    assert flying.read("RHO_D") == pytest.approx(0.6)
    words = flying.end(signal.SIGTERM)
    assert words.count("parameters are not kept") == 1
    assert flying.process.returncode == 0


def test_none_stores_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    flying = Flying("none")
    flying.set("RHO_D", 0.5)
    assert "are not stored" in flying.end(signal.SIGTERM)
    assert list(tmp_path.iterdir()) == []


# --- the line over the air --------------------------------------------------------------------


def test_a_line_that_leads_nowhere_is_refused_and_where_it_is_forced_and_stored_not_engaged_on(
    tmp_path: Path,
) -> None:
    def reported(flying: Flying, words: str) -> bool:
        return flying.until(lambda: any(words in text for text in flying.texts))

    flying = Flying(tmp_path)
    flying.set("TGL_STAGE", 1)
    flying.set("TGL_X", 400)
    assert flying.read("TGL_X") == 400.0
    flying.set("TGL_STAGE", 0)
    assert reported(
        flying, "staged move dropped: TGL_STAGE = 0: the line's point is outside the fence"
    )
    assert flying.read("TGL_X") == pytest.approx(0.2)
    flying.set("OP_FORCE", 1)
    flying.set("TGL_X", 400)
    assert flying.read("TGL_X") == 400.0
    assert flying.read("OP_FORCE") == 0.0
    flying.end(signal.SIGTERM)
    again = Flying(tmp_path)
    assert again.read("TGL_X") == 400.0
    assert reported(again, "cannot be engaged: the line's point is outside the fence")
    again.set("OP_ENGAGE", 1)
    assert again.values["OP_ENGAGE"] == 0.0
    assert reported(
        again, "OP_ENGAGE: the line's point is outside the fence (FENCE_X_MAX is 2.25 m);"
    )
    again.set("OP_FORCE", 1)
    again.set("OP_ENGAGE", 1)
    assert again.read("OP_FORCE") == 0.0
    assert "cannot be engaged: the line's point" in again.end(signal.SIGKILL)
