"""A simulated flight with the operator's page: what is started, when the page's address is printed,
and how it ends."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.config.files import shipped
from tgl_soar.sim import sitl_page
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import SitlProcesses

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")


class Recorded(SitlProcesses):
    """Processes never started: each has printed some lines by its second check, and the page ends
    at its fourth."""

    made: list[Recorded]

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.folder = folder
        self.commands: dict[str, list[str]] = {}
        self.checks = 0
        self.stopped = 0
        Recorded.made.append(self)

    def start(self, name: str, command: list[str]) -> None:
        assert name not in self.commands
        self.commands[name] = command
        (self.folder / f"{name}.log").write_text("")

    def check(self) -> None:
        self.checks += 1
        if self.checks == 2:
            lines = "begins\n" + sitl_page.ADDRESS + "http://127.0.0.1:8/\n"
            (self.folder / "page.log").write_text(lines)
        if self.checks == 4:
            raise SitlError("the page ended")

    def stop(self) -> None:
        self.stopped += 1


def hosted(
    out: Path, monkeypatch: pytest.MonkeyPatch, **changes: Any
) -> tuple[Recorded, list[str], list[float]]:
    """What was started, which addresses were printed, and the naps."""
    naps: list[float] = []
    addresses: list[str] = []
    Recorded.made = []
    monkeypatch.setattr(sitl_page, "SitlProcesses", Recorded)
    monkeypatch.setattr(sitl_page, "time", SimpleNamespace(sleep=naps.append))
    chosen = {"airframe": AIRFRAME, "site": SITE, "out": out, "realtime": True, **changes}
    with pytest.raises(SitlError, match="the page ended"):
        sitl_page.host(SitlOptions(**chosen), 8765, addresses.append)
    (processes,) = Recorded.made
    return processes, addresses, naps


def value(command: list[str], option: str) -> str:
    assert command.count(option) == 1
    return command[command.index(option) + 1]


def test_bridge_module_and_page_are_started_and_can_reach_one_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    processes, _, _ = hosted(tmp_path, monkeypatch, companion="127.0.0.1:5")
    assert list(processes.commands) == ["bridge", "module", "page"]
    bridge, module, page = processes.commands.values()
    station = bridge[bridge.index("--gcs") + 1]
    assert re.fullmatch(r"127\.0\.0\.1:\d+", station)
    assert value(page, "--link") == f"udp:{station}"
    assert value(page, "--port") == "8765"
    assert value(bridge, "--companion") == "127.0.0.1:5"
    assert value(module, "--link") == "udp:127.0.0.1:5"
    assert value(bridge, "--log") == str(tmp_path / "truth.csv")
    assert "--mocap" not in bridge
    assert "--mocap-server" not in module


def test_a_hall_streams_to_the_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = shipped("sites/tunnel_mocap.toml")
    processes, _, _ = hosted(tmp_path, monkeypatch, mocap=True, site=site)
    bridge, module, _ = processes.commands.values()
    assert value(bridge, "--mocap-local") == value(module, "--mocap-server")
    assert re.fullmatch(r"127\.0\.0\.1:\d+", value(bridge, "--mocap-local"))
    assert value(bridge, "--mocap-local") != bridge[bridge.index("--gcs") + 1]


def test_the_address_is_reported_once_and_all_are_ended_with_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    processes, addresses, naps = hosted(tmp_path, monkeypatch)
    assert addresses == ["http://127.0.0.1:8/"]
    assert processes.checks == 4
    assert naps == [0.2] * 3
    assert processes.stopped == 1


def test_without_a_wind_there_is_no_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = SITE.read_text()
    site = tmp_path / "windless.toml"
    site.write_text(re.sub(r"(?ms)^\[air\b.*?(?=^\[(?!air)|\Z)", "", text))
    Recorded.made = []
    monkeypatch.setattr(sitl_page, "SitlProcesses", Recorded)
    options = SitlOptions(airframe=AIRFRAME, site=site, out=tmp_path / "out")
    with pytest.raises(SitlError, match=r"windless\.toml: no \[air\] table, so there is no wind"):
        sitl_page.host(options, 1, lambda _address: None)
    assert not Recorded.made
    assert not (tmp_path / "out").exists()
