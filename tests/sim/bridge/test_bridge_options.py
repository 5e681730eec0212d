"""The bridge by its options alone: what it opens, and that nothing of it stays open."""

from __future__ import annotations

from math import hypot
from pathlib import Path

import pytest
from free_ports import free_port

from tgl_soar.config.files import ConfigError, load_airframe, load_site, shipped
from tgl_soar.geometry import soaring_from_ned
from tgl_soar.sim.bridge.bridge import Bridge
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.bridge.mocap import MocapOptions
from tgl_soar.sim.bridge.options import BridgeOptions, Pace, PortOptions
from tgl_soar.sim.motive import MotiveOptions
from tgl_soar.sim.point_mass import PointMass
from tgl_soar.sim.ports import Port
from tgl_soar.sim.simulation import Options, Simulation

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def test_a_command_line_without_choices_means_the_defaults() -> None:
    given = parsed(["--airframe", "eclipson_c", "--site", "tunnel"])
    assert given == BridgeOptions(AIRFRAME, SITE)


def test_the_model_is_chosen_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    files = ["--airframe", "eclipson_c", "--site", "tunnel"]
    given = parsed([*files, "--model", "point-mass"]).simulation
    assert given.model == "point_mass"
    chosen = Simulation(load_airframe(AIRFRAME), load_site(SITE), given, SITE.parent)
    assert isinstance(chosen.world.model, PointMass)
    with pytest.raises(SystemExit):
        parsed([*files, "--model", "glider"])
    reported = capsys.readouterr().err
    assert "glider" in reported
    assert "rigid-body" in reported
    assert "point-mass" in reported


def test_the_receiver_is_chosen_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    """It changes the errors of the positions, and is refused for a real firmware."""
    files = ["--airframe", "eclipson_c", "--site", "hill"]
    airframe, site = load_airframe(AIRFRAME), load_site(shipped("sites/hill.toml"))
    off = {}
    for name in ("local", "satellites", "rtk"):
        given = parsed([*files, "--receiver", name, "--launch", "held"]).simulation
        simulation = Simulation(airframe, site, given, SITE.parent)
        while simulation.world.position.sequence < 2:
            simulation.step()
        world, fix = simulation.world, simulation.world.position
        x, y, z = soaring_from_ned(world.frame, fix.north_m, fix.east_m, fix.down_m)
        off[name] = hypot(x - world.state.x_m, y - world.state.y_m, z - world.state.z_m)
    assert off["local"] < 0.05
    assert off["rtk"] < 0.1
    assert off["satellites"] > 0.2
    with pytest.raises(SystemExit):
        parsed([*files, "--receiver", "rtk", "--autopilot", "ardupilot", "--firmware", "x"])
    assert "--receiver rtk: a firmware has its own" in capsys.readouterr().err


def test_where_motion_capture_fails_what_was_opened_before_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[Simulation] = []
    monkeypatch.setattr(Simulation, "close", lambda simulation: closed.append(simulation))
    local = ("127.0.0.1", free_port())
    options = BridgeOptions(
        AIRFRAME,
        SITE,
        simulation=Options(log=tmp_path / "truth.csv"),
        pace=Pace(duration_s=0.0),
        ports=PortOptions(ground_local=local, companion_local=("127.0.0.1", 0)),
        mocap=MocapOptions("127.0.0.1:0", MotiveOptions()),
    )
    with pytest.raises(ConfigError, match=r"tunnel\.toml: --mocap natnet needs a \[mocap\] table"):
        Bridge(options)
    assert len(closed) == 1
    Port("ground", "--gcs-local", local, ground=True).socket.close()  # it is free again
