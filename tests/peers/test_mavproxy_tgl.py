"""`module load tgl` in a real MAVProxy: the line is moved, engaged and refused at its prompt."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import pytest
from installed_wheel import build
from peers_scene import SITE, BadRadio, Scene
from test_mavproxy import PROGRAM, MavProxy

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="MAVProxy is not installed")


@pytest.fixture(params=[False, True], ids=["good-link", "bad-radio"])
def flight(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Scene, MavProxy]]:
    scene = Scene(tmp_path)
    radio = BadRadio(scene.port, seed=3) if request.param else None
    scene.pilot.wait("a position", lambda: scene.pilot.values.get("soar_x", 0.0) > 0.1, 60.0)
    station = MavProxy(tmp_path, radio.port if radio else scene.port, "param,cmdlong")
    try:
        yield scene, station
    finally:
        station.close()
        scene.close()
        if radio is not None:
            radio.close()


def asked(station: MavProxy, line: str, answer: str) -> None:
    """A line typed until it is answered: a radio may lose all that was printed about it."""
    for _ in range(8):
        since = station.type(line)
        until = time.monotonic() + 12.0
        while time.monotonic() < until:
            if answer in station.words[since:]:
                return
            again = ("does not answer", "not known yet", "no module is known")
            if any(words in station.words[since:] for words in again):
                break
            time.sleep(0.02)
        time.sleep(1.0)
    raise AssertionError(f"{line}: no {answer!r} in\n{station.words}")


def test_the_line_is_moved_at_the_prompt(flight: tuple[Scene, MavProxy]) -> None:
    scene, station = flight
    pilot, values = scene.pilot, scene.pilot.values
    asked(station, "module load tgl", "Loaded module tgl")
    asked(station, "tgl status", "line set    x 0.20 m, z 1.15 m, lean 15.0 deg")
    asked(station, "tgl engage", "tgl: engage: done")

    # All three at once: the line between, of the new x and the old z, is never flown.
    asked(station, "tgl move 0.5 1.45 12", "tgl: line to x 0.50 m, z 1.45 m, lean 12.0°: confirmed")
    pilot.wait("its x is there", lambda: abs(values["line_x"] - 0.5) < 1e-3)
    pilot.wait("its z is there", lambda: abs(values["line_z"] - 1.45) < 1e-3)
    pilot.wait("its lean is there", lambda: abs(values["line_lean"] - 12.0) < 1e-2)
    assert pilot.parameters["TGL_STAGE"] == 0.0
    asked(station, "tgl lean 15", "lean 15.0°: confirmed")
    pilot.wait("it leans", lambda: abs(values["line_lean"] - 15.0) < 1e-3)

    asked(station, "tgl preset a", "no site file: tgl site FILE")
    asked(station, f"tgl site {SITE}", "lines 1 a, 2 b, 3 c")
    asked(station, "tgl preset d", "the site's lines are a, b, c")
    asked(station, "tgl preset a", "tgl: line a: confirmed")
    pilot.wait("line a", lambda: pilot.parameters["TGL_PRESET"] == 1.0)

    # Refused here, by the module, and for a word that is no number: nothing moves.
    asked(station, "tgl lean 80", "TGL_LEAN = 80: allowed -60 to 60 deg")
    asked(station, "tgl move 0.2 upwards", "TGL_Z: 'upwards' is no number")
    asked(station, "tgl move 0.2 17", "refused")
    asked(station, "tgl", "usage: tgl move X Z")
    assert pilot.parameters["TGL_PRESET"] == 1.0
    assert pilot.parameters["TGL_STAGE"] != 1.0
    scene.assert_flies()

    asked(station, "tgl abort", "tgl: abort: done")
    pilot.wait("on the ground's side", lambda: values["soar_mode"] < 3.0)
    asked(station, "tgl engage", "tgl: engage: refused for now")
    asked(station, "tgl release", "tgl: release: done")
    station.type("module unload tgl")
    asked(station, "tgl status", "Unknown command")


def test_a_wheel_has_it_where_mavproxy_looks(tmp_path: Path) -> None:
    with ZipFile(build(tmp_path)) as wheel:
        names = set(wheel.namelist())
    assert {"tgl.py", "tgl_soar/cli/mavproxy_tgl.py"} <= names


def test_status_is_in_words() -> None:
    module = pytest.importorskip("tgl_soar.cli.mavproxy_tgl")
    nothing = module.status_lines({}, None)
    assert nothing[0] == "mode not known: e_rho not known"
    values = {"soar_mode": 1.0, "e_rho": 0.1, "entry": 4.0 + 1.0, "faults": 1.0, "updraft": 1.25}
    lines = module.status_lines(
        {**values, "airspeed": float("nan")}, module.GhostLine(0.2, 1.1, 15)
    )
    assert lines[0] == "standby: e_rho 0.10 m"
    assert "line set    x 0.20 m, z 1.10 m, lean 15.0 deg" in lines
    assert "air         airspeed not known, updraft 1.25 m/s, excess not known" in lines
    assert "engaging lacks: position fresh" in lines
    assert any(line.startswith("held back") for line in lines)
    assert "faults: position has gaps" in lines
    assert not any("lacks" in line for line in module.status_lines({"soar_mode": 4.0}, None))
