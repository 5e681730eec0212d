"""How a simulated flight starts its bridge, its module and its page; how its processes are watched
and ended; how a leg's line, score and verdict are read."""

from __future__ import annotations

import re
import sys
from math import inf, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.report import flight_page
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import air_files
from tgl_soar.sim import sitl
from tgl_soar.sim.operator import FlownLeg, PlannedLeg
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import (
    FIGURES,
    SitlProcesses,
    airframe_for,
    bridge_command,
    free_address,
    module_command,
    page_command,
    prepared,
    site_for,
)

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def options(out: Path, **chosen: Any) -> SitlOptions:
    return SitlOptions(**{"airframe": AIRFRAME, "site": SITE, "out": out, **chosen})


def bridge(out: Path, mocap: str = "", **chosen: Any) -> list[str]:
    return bridge_command(options(out, **chosen), out / "truth.csv", "o:1", "c:2", mocap)


def value(command: list[str], option: str) -> str:
    assert command.count(option) == 1
    return command[command.index(option) + 1]


def test_in_lockstep_the_bridge_waits_for_both_at_ports_of_its_own(tmp_path: Path) -> None:
    command = bridge(tmp_path)
    assert command[:4] == [sys.executable, "-P", "-m", "tgl_soar.sim.bridge"]
    assert value(command, "--airframe") == str(AIRFRAME)
    assert value(command, "--site") == str(SITE)
    assert (value(command, "--companion"), value(command, "--gcs")) == ("c:2", "o:1")
    assert value(command, "--log") == str(tmp_path / "truth.csv")
    assert value(command, "--speed") == "lockstep"
    assert value(command, "--gcs-local") == value(command, "--companion-local") == "127.0.0.1:0"
    assert "--lockstep-gcs" in command
    assert value(command, "--autopilot-parameter") == "RC_OVERRIDE_TIME=0.5"
    for absent in ("--model", "--no-pitot", "--autopilot", "--mission", "--fault", "--turbulence"):
        assert absent not in command
    assert "--mocap" not in command


def test_by_the_clock_it_speaks_to_a_station_of_the_users_too(tmp_path: Path) -> None:
    command = bridge(tmp_path, realtime=True, gcs="h:14550", gcs_local="h:18570")
    assert value(command, "--speed") == "realtime"
    assert [command[i + 1] for i, word in enumerate(command) if word == "--gcs"] == [
        "o:1",
        "h:14550",
    ]
    assert value(command, "--gcs-local") == "h:18570"
    assert value(command, "--companion-local") == "127.0.0.1:0"
    assert "--lockstep-gcs" not in command


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        ({"seed": 7}, ["--seed", "7"]),
        ({"model": "point-mass"}, ["--model", "point-mass"]),
        ({"pitot": False}, ["--no-pitot"]),
        ({"receiver": "rtk"}, ["--receiver", "rtk"]),
        ({"turbulence": 0.02}, ["--turbulence", "0.02"]),
        ({"turbulence": 0.0}, ["--turbulence", "0.0"]),
        ({"mission": Path("m.txt")}, ["--mission", "m.txt"]),
        ({"faults": ("a start=1", "b")}, ["--fault", "a start=1", "--fault", "b"]),
        ({"autopilot_parameters": ("A=1",)}, ["--autopilot-parameter", "A=1"]),
    ],
)
def test_what_is_chosen_is_passed_on(
    tmp_path: Path, chosen: dict[str, Any], words: list[str]
) -> None:
    command = bridge(tmp_path, **chosen)
    begins = [i for i in range(len(command)) if command[i : i + len(words)] == words]
    assert len(begins) == 1


def test_a_firmware_is_named_with_its_program_folder_and_record(tmp_path: Path) -> None:
    command = bridge(tmp_path, autopilot="px4", firmware=Path("bin/px4"))
    assert value(command, "--autopilot") == "px4"
    assert value(command, "--firmware") == "bin/px4"
    assert value(command, "--firmware-folder") == str(tmp_path / "firmware")
    assert value(command, "--record") == str(tmp_path / "companion.tlog")
    assert "--autopilot-parameter" not in command


def test_a_hall_streams_at_its_address(tmp_path: Path) -> None:
    command = bridge(tmp_path, mocap="m:3", mocap_options=("--mocap-rate=50",))
    assert value(command, "--mocap") == "natnet"
    assert value(command, "--mocap-local") == "m:3"
    assert "--mocap-rate=50" in command


def test_the_module_is_the_companion_at_its_address(tmp_path: Path) -> None:
    command = module_command(options(tmp_path), "c:2", "")
    assert command[:5] == [sys.executable, "-P", "-m", "tgl_soar.cli", "run"]
    assert value(command, "--link") == "udp:c:2"
    assert value(command, "--state") == "none"
    assert value(command, "--log") == str(tmp_path / "logs")
    assert value(command, "--log-max") == "500"
    assert command[-1] == "--lockstep"
    assert "--mocap-server" not in command
    real = module_command(options(tmp_path, realtime=True), "c:2", "m:3")
    assert value(real, "--mocap-server") == "m:3"
    assert "--lockstep" not in real


def test_the_page_is_a_station(tmp_path: Path) -> None:
    command = page_command(options(tmp_path), "s:4", 8080)
    assert command[:5] == [sys.executable, "-P", "-m", "tgl_soar.cli", "page"]
    assert (value(command, "--link"), value(command, "--port")) == ("udp:s:4", "8080")


def test_a_free_address_can_be_had() -> None:
    host, _, port = free_address().rpartition(":")
    assert host == "127.0.0.1"
    assert 0 < int(port) < 65536


# --- files for a firmware -------------------------------------------------------------------------


def test_the_airframe_file_is_flown_with_the_firmwares_name_and_route(tmp_path: Path) -> None:
    for route, lines in ((None, 1), ("override", 2)):
        path = airframe_for(options(tmp_path, autopilot="px4", route=route))
        text = path.read_text()
        assert 'firmware = "px4"' in text
        assert ('route = "override"' in text) == (lines == 2)
        assert path == tmp_path / "flown" / AIRFRAME.name
    bad = tmp_path / "bad.toml"
    bad.write_text("[autopilot]\n")
    with pytest.raises(SitlError, match=r"bad\.toml: no line firmware = … in \[autopilot\]"):
        airframe_for(options(tmp_path, airframe=bad, autopilot="px4"))


def test_a_site_gets_a_place_on_earth_or_forwards_its_poses(tmp_path: Path) -> None:
    path = site_for(options(tmp_path), load_site(SITE))
    assert path == tmp_path / "flown" / SITE.name
    placed = load_site(path)
    assert placed.position.home is not None
    assert placed.position.home.latitude_deg == 51.99
    assert tuple(placed.position.sources) == ("global_position",)
    assert site_for(options(tmp_path, site=path), placed) == path  # it has one
    hall = shipped("sites/tunnel_mocap.toml")
    forwards = site_for(options(tmp_path, site=hall), load_site(hall))
    assert load_site(forwards).forward is not None
    assert site_for(options(tmp_path, site=forwards), load_site(forwards)) == forwards


def test_the_users_own_files_stay_as_they_are(tmp_path: Path) -> None:
    """Also where the flight is to lie in their folder."""
    airframe, site = tmp_path / "airframe.toml", tmp_path / "site.toml"
    airframe.write_text(AIRFRAME.read_text())
    site.write_text(SITE.read_text())
    before = airframe.read_text(), site.read_text()
    mine = options(tmp_path, airframe=airframe, site=site, autopilot="px4")
    assert airframe_for(mine) != airframe
    assert site_for(mine, load_site(site)) != site
    assert (airframe.read_text(), site.read_text()) == before
    flown = tmp_path / "flown" / "airframe.toml"
    with pytest.raises(SitlError, match="would overwrite; choose another --out"):
        airframe_for(options(tmp_path, airframe=flown, autopilot="px4"))


def test_a_route_of_the_airframe_file_gives_way_to_the_one_that_is_chosen(tmp_path: Path) -> None:
    airframe = tmp_path / "airframe.toml"
    text = AIRFRAME.read_text()
    airframe.write_text(re.sub(r"(?m)^(firmware *=.*)$", r'\1\nroute = "override"', text))
    for route, flown in ((None, "override"), ("attitude", "attitude")):
        chosen = options(tmp_path, airframe=airframe, autopilot="ardupilot", route=route)
        assert load_airframe(airframe_for(chosen)).autopilot.route == flown


def test_the_files_of_a_sites_air_are_found_from_its_copy(tmp_path: Path) -> None:
    site = tmp_path / "my hill.toml"
    text = shipped("sites/hill.toml").read_text()
    record = tmp_path / "winds" / "day.csv"
    for written in ('record = "winds/day.csv"', "record='./winds/day.csv' # of a day"):
        site.write_text(re.sub(r"(?m)^(radius_m.*)$", rf"\1\n{written}", text))
        copied = site_for(options(tmp_path / "out", site=site), load_site(site))
        air = load_site(copied).air
        assert copied != site
        assert air is not None
        assert air_files(air, copied.parent) == [record]
    site.write_text(re.sub(r"(?m)^(radius_m.*)$", r'\1\nrecord = "d\\u0061y.csv"', text))
    with pytest.raises(SitlError, match=r"write the name of .*day\.csv as plain text"):
        site_for(options(tmp_path / "out", site=site), load_site(site))


def test_the_truth_of_a_flight_before_is_deleted(tmp_path: Path) -> None:
    out = tmp_path / "new" / "flight"
    truth = prepared(options(out))
    assert truth == out / "truth.csv"
    truth.write_text("old")
    assert prepared(options(out)) == truth
    assert not truth.exists()


# --- processes ------------------------------------------------------------------------------------


def test_a_process_that_ends_is_named_with_its_last_six_lines(tmp_path: Path) -> None:
    processes = SitlProcesses(tmp_path)
    script = "import sys\nfor i in range(9): print('line', i)\nsys.exit(3)"
    processes.start("bridge", [sys.executable, "-c", script])
    processes._running["bridge"].wait(30.0)
    with pytest.raises(SitlError) as raised:
        processes.check()
    text = str(raised.value).splitlines()
    assert text[0] == "the bridge ended with exit code 3"
    assert text[1:] == [f"  bridge: line {i}" for i in range(3, 9)]
    assert processes.lines_with("bridge", "line 1") == ["line 1"]


def test_a_process_that_is_killed_is_expected_no_more_and_others_are_asked_to_end(
    tmp_path: Path,
) -> None:
    processes = SitlProcesses(tmp_path)
    for name in ("bridge", "module"):
        processes.start(name, [sys.executable, "-c", "import time; time.sleep(60)"])
    module = processes._running["module"]
    assert processes.pid("module") == module.pid
    processes.check()
    processes.kill("module")
    assert module.returncode == -9
    processes.check()
    running = processes._running["bridge"]
    processes.stop()
    assert running.returncode == -15
    processes.stop()  # nothing is left to end


# --- what a flight came to ------------------------------------------------------------------------


def flown(name: str = "a", **changes: Any) -> FlownLeg:
    leg = PlannedLeg(name, {"TGL_X": 1.0, "TGL_Z": 2.0, "TGL_LEAN": 15.0}, stay_s=2.0)
    return FlownLeg(leg, 1.0, **changes)


def test_a_legs_line_is_its_point_and_its_angle() -> None:
    assert sitl._line(flown().leg.parameters) == pytest.approx((1.0, 2.0, pi / 2 + pi / 12))


def test_a_leg_is_scored_from_when_its_line_stood_to_its_end() -> None:
    """It stands 1 m from a line that is upright: before and after it is elsewhere."""
    time = np.linspace(0.0, 40.0, 401)
    stands = (time >= 10.0) & (time <= 30.0)
    truth = {
        "time_s": time,
        "x_m": np.where(stands, 1.0, 50.0),
        "z_m": np.full(401, 2.0),
        "y_m": np.full(401, 0.5),
        "roll_rad": np.full(401, 0.25),
    }
    leg = flown(stopped_s=10.0, ended_s=30.0)
    [score] = sitl._scores([leg], [(2.0, 2.0, pi / 2)], [None], truth)
    assert score.name == "a"
    assert score.rms_e_rho_m == pytest.approx(1.0)
    assert (score.rms_y_m, score.rms_bank_rad) == (0.5, 0.25)
    assert (score.mean_x_m, score.mean_z_m) == (1.0, 2.0)


@pytest.mark.parametrize("ended_s", [0.0, 10.0, 9.97, 40.0, 41.0])
def test_a_leg_that_was_over_at_once_is_scored_where_it_was(ended_s: float) -> None:
    """A search that gives up at its first look lasts no longer than a row of the truth."""
    time = np.linspace(0.0, 40.0, 401)
    truth = {
        "time_s": time,
        "x_m": 1.0 + 0.1 * time,
        "z_m": np.full(401, 2.0),
        "y_m": np.zeros(401),
        "roll_rad": np.zeros(401),
    }
    leg = flown(stopped_s=ended_s, ended_s=ended_s)
    [score] = sitl._scores([leg], [(2.0, 2.0, pi / 2)], [None], truth)
    assert score.mean_x_m == pytest.approx(1.0 + 0.1 * min(ended_s, 40.0), abs=0.011)
    assert not score.settled


OF_A_FLIGHT = (
    *("truth.csv", "summary.json", "flight.png", "search.png", "report.html", "companion.tlog"),
    *("bridge.log", "module.log", "page.log", "report-figures/numbers.json"),
)


def test_what_an_earlier_flight_has_left_does_not_look_like_the_new_one_s(tmp_path: Path) -> None:
    """Its logs stay, and so does whatever else lies there."""
    page = Path(flight_page.__file__).read_text(encoding="utf-8").partition("def _wanted")[2]
    drawn = set(re.findall(r'(?m)^ {12}"(\w+)",$', page))
    assert drawn == set(FIGURES)
    figures = [f"report-figures/{name}.{end}" for name in FIGURES for end in ("svg", "png")]
    kept = ["logs/a.ulg", "notes.txt", "report-figures/mine.png", "flown/site.toml"]
    for name in (*OF_A_FLIGHT, *figures, *kept):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("of the flight before")
    prepared(options(tmp_path))
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert left == set(kept)
    (tmp_path / "report-figures" / "mine.png").unlink()
    (tmp_path / "truth.csv").touch()
    prepared(options(tmp_path))
    assert not (tmp_path / "report-figures").exists()


def test_a_folder_without_a_flight_keeps_all_that_is_in_it(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("somebody's own")
    prepared(options(tmp_path))
    assert (tmp_path / "report.html").exists()


@pytest.mark.parametrize(
    ("moved_s", "later_alone"), [(20.0, True), (28.0, True), (28.5, False), (-inf, False)]
)
def test_a_leg_that_was_moved_by_hand_is_scored_on_the_line_that_is_flown(
    moved_s: float, later_alone: bool
) -> None:
    """From 20 s on it is held on another one; after a move at the very end all of it counts."""
    time = np.linspace(0.0, 40.0, 401)
    zeros = np.zeros(401)
    truth = {"time_s": time, "x_m": np.where(time >= 20.0, 3.0, 2.0), "z_m": zeros + 2.0}
    truth |= {"y_m": zeros, "roll_rad": zeros}
    leg = flown(stopped_s=10.0, ended_s=30.0, moved_s=moved_s)
    [score] = sitl._scores([leg], [(3.0, 2.0, pi / 2)], [None], truth)
    assert (score.rms_e_rho_m == 0.0) == later_alone
    assert score.rms_e_rho_m == 0.0 or score.rms_e_rho_m > 0.5


@pytest.mark.parametrize(("load", "named"), [(2.5, True), (2.0, False), (1.0, False)])
def test_a_load_is_named_where_it_is_above_the_processors(load: float, named: bool) -> None:
    hint = sitl.busy_hint(load, 2)
    assert (f"whose load is {load:.1f} on 2 processors" in hint) == named
    assert "may be too busy for real time: close other programs, or fly in lockstep" in hint


def test_a_truth_of_fewer_than_two_rows_is_no_flight(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("time_s,x_m\n0,1\n")
    with pytest.raises(SitlError, match=r"truth\.csv: the bridge logged no flight"):
        sitl._read_truth(path)
    path.write_text("time_s,x_m\n0,1\n0.5,2\n")
    truth = sitl._read_truth(path)
    assert truth["time_s"].tolist() == [0.0, 0.5]
    assert truth["x_m"].tolist() == [1.0, 2.0]
