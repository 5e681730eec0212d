"""`tgl-soar init`: what it writes is taken by what reads it, from the source and from the wheel."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from free_ports import free_port
from installed_wheel import Installed
from typer.testing import CliRunner

from tgl_soar.cli import init, service_unit
from tgl_soar.cli.app import app
from tgl_soar.cli.log_layouts import foxglove, plotjuggler
from tgl_soar.config.files import (
    load_airframe,
    load_parameters,
    load_site,
    manual,
    shipped,
    shipped_names,
)
from tgl_soar.link.commands import ABORT, ENGAGE, RELEASE
from tgl_soar.link.open_link import check_link
from tgl_soar.link.transports.base import LinkError
from tgl_soar.onboard import process
from tgl_soar.sim.world import site_field

FILES = {
    "airframe.toml", "site.toml", "tgl-soar.service", "qgc_actions.json", "plotjuggler.xml",
    "foxglove.json", "README.md",
}  # fmt: skip
ANALYZE = shutil.which("systemd-analyze") or ""


def begun(folder: Path, *options: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["init", str(folder), *options])
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("init") / "place"
    begun(folder)
    return folder


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# --- the files ------------------------------------------------------------------------------


@pytest.mark.parametrize("site", shipped_names("sites"))
@pytest.mark.parametrize("firmware", ["bridge", "ardupilot", "px4", "paparazzi"])
def test_airframe_and_site_are_read(tmp_path: Path, site: str, firmware: str) -> None:
    begun(tmp_path, "--from", site, "--airframe", "eclipson_c", "--firmware", firmware)
    assert {path.name for path in tmp_path.iterdir()} == FILES
    plane_file, place_file = tmp_path / "airframe.toml", tmp_path / "site.toml"
    plane, place = load_airframe(plane_file), load_site(place_file)
    assert plane.autopilot.firmware == firmware
    assert place.lines
    load_parameters(plane, plane_file, place, place_file)
    assert place_file.read_text().startswith("#")


GRID = """\
[air]
kind = "grid"
file = "winds/air.npz"
record = "hour.csv"
wind_mps = 7.0
zero_cells = "solid"
"""


def drafted(folder: Path, air: str = GRID) -> Path:
    """A site file of one's own, and what its [air] names."""
    text = shipped("sites/hill.toml").read_text(encoding="utf-8")
    text, count = re.subn(r"(?ms)^\[air\].*?(?=^\[)", f"{air}\n", text)
    assert count == 1
    (folder / "winds").mkdir(parents=True)
    path = folder / "site.toml"
    path.write_text(text, encoding="utf-8")
    x, z = np.linspace(-20.0, 5.0, 6), np.linspace(0.0, 20.0, 5)
    nodes = np.ones((6, 5))
    np.savez(folder / "winds" / "air.npz", x=x, z=z, u=7.0 * nodes, w=0.0 * nodes)
    (folder / "hour.csv").write_text("time_s,wind_mps,veer_deg\n0,7,0\n60,7,0\n")
    return path


def test_a_site_file_of_ones_own_comes_with_the_wind_that_it_names(tmp_path: Path) -> None:
    path = drafted(tmp_path / "my_hill")
    place = tmp_path / "place"
    begun(place, "--from", str(path))
    assert {*tree(place)} == {*FILES, "winds/air.npz", "hour.csv"}
    site = load_site(place / "site.toml")
    assert site == load_site(path)
    assert site_field(site, place).wind(0.0, -1.0, 0.0, 1.0)[0] == pytest.approx(7.0)
    assert (place / "site.toml").read_text(encoding="utf-8").startswith(path.read_text())
    assert "#[position]" in (place / "site.toml").read_text(encoding="utf-8")
    assert oct((place / "winds/air.npz").stat().st_mode)[-3:] == "644"
    text = path.read_text(encoding="utf-8")
    path.write_text(text + '\n[position]\nsources = ["local_position"]\n', encoding="utf-8")
    begun(place, "--from", str(path), "--force")
    assert (place / "site.toml").read_bytes() == path.read_bytes()


def test_the_drafts_own_folder_can_become_that_of_the_service(tmp_path: Path) -> None:
    path = drafted(tmp_path / "my_hill")
    before = tree(path.parent)
    begun(path.parent, "--from", str(path))
    after = tree(path.parent)
    assert {*after} == {*FILES, *before}
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize(
    ("air", "words"),
    [
        (GRID.replace("winds/", ""), 'air.file = "air.npz": No such file'),
        (GRID.replace("winds/", "../"), 'air.file = "../air.npz": outside of the site\'s folder'),
        (GRID.replace("winds/air.npz", "a.foam"), 'air.file = "a.foam": a case of many files'),
        (GRID.replace("7.0", "-7.0"), "air.wind_mps = -7.0"),
    ],
)
def test_a_site_file_whose_wind_cannot_come_along_is_refused(
    tmp_path: Path, air: str, words: str
) -> None:
    path = drafted(tmp_path / "my_hill", air)
    output = begun(tmp_path / "place", "--from", str(path), code=2).replace("\n", "")
    assert str(path) in output
    assert words in output
    assert not (tmp_path / "place").exists()


@pytest.mark.parametrize("firmware", ["bridge", "ardupilot"])
def test_the_firmware_is_not_said_to_be_another_one(tmp_path: Path, firmware: str) -> None:
    begun(tmp_path, "--firmware", firmware)
    (line,) = re.findall(r"(?m)^firmware = .*$", (tmp_path / "airframe.toml").read_text())
    assert line.startswith(f'firmware = "{firmware}"')
    assert ("the aircraft's own" in line) == (firmware == "bridge")
    assert "on the aircraft" not in line


def test_for_another_aircraft_all_that_is_another_is_listed(folder: Path) -> None:
    """Its mass alone would leave inertias, moments and gains of the shipped one."""
    step = (folder / "README.md").read_text().partition("## 2.")[2].partition("## 3.")[0]
    for word in ("`name`", "span", "inertia", "`[model]`", "`[polar]`", "gains", "`[contour]`"):
        assert word in step
    assert "`tgl-soar docs files`" in step
    assert "## A new aircraft\n" in (manual() / "files.md").read_text()
    assert "the gains (RHO_…, ELE_…) are to be deleted" in (folder / "airframe.toml").read_text()


@pytest.mark.parametrize("heading", ["Satellites", "Motion capture"])
def test_what_a_real_place_needs_is_there_to_be_uncommented(folder: Path, heading: str) -> None:
    text = (folder / "site.toml").read_text()
    block = text.partition(f"# {heading}")[2].partition("\n\n")[0]
    tables = "\n".join(line[1:] for line in block.splitlines()[1:])
    assert "[position]" in tables
    place = folder.parent / f"{heading}.toml"
    place.write_text(f"{text}\n{tables}\n")
    assert load_site(place).position.sources in (["global_position"], ["mocap"])


def test_params_take_the_folder(folder: Path) -> None:
    files = ["--airframe", str(folder / "airframe.toml"), "--site", str(folder / "site.toml")]
    result = CliRunner().invoke(app, ["params", "show", *files, "--state", str(folder / "state")])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("command", "code", "reported"),
    [("run", process.EXIT_NO_AUTOPILOT, "no autopilot"), ("preflight", 2, "no heartbeat")],
)
def test_what_flies_takes_the_folder(folder: Path, command: str, code: int, reported: str) -> None:
    """A link that is there and silent: the files were read, the link was opened and given up."""
    words = ["--airframe", "airframe.toml", "--site", "site.toml", "--timeout", "1"]
    words += ["--link", f"udp:127.0.0.1:{free_port()}"]
    if command == "run":
        words += ["--state", "none"]
    ended = subprocess.run(
        [sys.executable, "-m", "tgl_soar.cli", command, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ended.returncode == code, ended.stderr
    assert reported in ended.stderr


def test_the_layouts_are_those_of_the_log(folder: Path) -> None:
    """tests/cli/test_log_layouts.py holds them against one."""
    assert (folder / "plotjuggler.xml").read_text() == plotjuggler()
    assert (folder / "foxglove.json").read_text() == foxglove()


def test_qgroundcontrol_takes_the_actions(folder: Path) -> None:
    """It refuses a file with a key that it does not know, or with one of another type."""
    read = json.loads((folder / "qgc_actions.json").read_text())
    assert {key: read[key] for key in ("version", "fileType")} == {
        "version": 1,
        "fileType": "MavlinkActions",
    }
    assert set(read) == {"version", "fileType", "actions"}
    for action in read["actions"]:
        assert {key: type(value) for key, value in action.items()} == {
            "label": str,
            "description": str,
            "mavCmd": int,
            "compId": int,
        }
    sent = [(action["mavCmd"], action["compId"]) for action in read["actions"]]
    assert sent == [(ENGAGE, 191), (RELEASE, 191), (ABORT, 191)]


# --- the unit -------------------------------------------------------------------------------


def test_the_unit_starts_this_program_with_these_files(folder: Path) -> None:
    (line,) = re.findall(r"(?m)^ExecStart=(.*)$", (folder / "tgl-soar.service").read_text())
    words = shlex.split(line)
    assert Path(words[0]).is_absolute()
    assert Path(words[0]).exists()
    run = words.index("run")
    options = dict(zip(words[run + 1 :: 2], words[run + 2 :: 2], strict=True))
    assert options == {
        "--state": "/var/lib/tgl_soar",
        "--airframe": str(folder / "airframe.toml"),
        "--site": str(folder / "site.toml"),
        "--link": init.LINK,
    }


@pytest.mark.skipif(not ANALYZE, reason="no systemd-analyze here")
@pytest.mark.parametrize("needed", ["/opt/tgl_soar", "home"])
def test_systemd_finds_nothing_wrong_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, needed: str
) -> None:
    if needed == "home":
        monkeypatch.setattr(service_unit, "_owner", lambda _needed: "daemon")
    text = service_unit.unit(["/bin/true", "with a space", "100%", "$HOME"], [Path(needed)])
    unit = tmp_path / "tgl-soar.service"
    unit.write_text(text)
    found = subprocess.run([ANALYZE, "verify", str(unit)], capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (0, "")
    assert '"with a space" 100%% $$HOME' in text


def test_in_a_home_the_service_runs_as_whose_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A user of its own could not read there; no service runs as root."""
    monkeypatch.setattr(service_unit, "_HOMES", (tmp_path,))
    shared = service_unit.unit(["/bin/true"], [Path("/opt/tgl_soar"), Path("/etc/tgl_soar")])
    assert "DynamicUser=yes\n" in shared
    assert "ProtectHome=yes\n" in shared

    monkeypatch.setattr(Path, "owner", lambda _path: "pi")
    homely = service_unit.unit(["/bin/true"], [tmp_path / "not" / "there"])
    assert "User=pi\n" in homely
    assert "DynamicUser" not in homely
    assert "ProtectHome=read-only\n" in homely
    monkeypatch.setattr(Path, "owner", lambda _path: "root")
    assert "DynamicUser=yes\n" in service_unit.unit(["/bin/true"], [tmp_path])


def test_what_no_service_can_read_is_reported(tmp_path: Path) -> None:
    assert service_unit.hidden([Path("/tmp/x"), Path("/root/x")]) == [
        Path("/tmp/x"),
        Path("/root/x"),
    ]
    assert service_unit.hidden([Path("/opt/x"), Path("/etc/x"), Path("/home/pi/x")]) == []
    assert service_unit.hidden([Path("/tmpfs")]) == []
    if service_unit.hidden([tmp_path]):
        assert f"no service can read {tmp_path}" in begun(tmp_path)


def test_the_service_can_read_what_a_careful_user_writes(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        begun(tmp_path / "place")
    finally:
        os.umask(before)
    assert (tmp_path / "place").stat().st_mode & 0o777 == 0o755
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "place").iterdir()} == {0o644}


# --- all or nothing -------------------------------------------------------------------------


def test_nothing_is_replaced_unasked(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text("mine")
    assert "has site.toml already: --force replaces" in begun(tmp_path, code=2)
    assert tree(tmp_path) == {"site.toml": b"mine"}
    (tmp_path / "notes.txt").write_text("mine too")
    begun(tmp_path, "--force")
    assert set(tree(tmp_path)) == FILES | {"notes.txt"}
    assert tree(tmp_path)["site.toml"] != b"mine"
    assert tree(tmp_path)["notes.txt"] == b"mine too"


@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("after", [0, 3])
def test_a_full_disk_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: bool, after: int
) -> None:
    folder = tmp_path / "place"
    if there:
        begun(folder)
    before = tree(tmp_path)
    left = [after]
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if not left[0]:
            write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        left[0] -= 1
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    reported = begun(folder, "--force", code=2)
    assert "No space left on device" in reported
    monkeypatch.undo()
    assert tree(tmp_path) == before
    assert folder.exists() == there


@pytest.mark.parametrize(
    ("options", "reported"),
    [
        (("--from", "hil"), "--from hil: not known; must be one of hill, tunnel"),
        (("--airframe", "x"), "--airframe x: not known; must be one of eclipson_c"),
        (("--firmware", "x"), "--firmware x: not known; must be one of bridge"),
        (("--link", "x"), "unknown kind"),
    ],
)
def test_what_is_not_known_is_refused(
    tmp_path: Path, options: tuple[str, ...], reported: str
) -> None:
    assert reported in begun(tmp_path / "new", *options, code=2)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("firmware", "flown"), [("", "px4"), ("ardupilot", "ardupilot")])
def test_an_airframe_of_ones_own_is_taken(tmp_path: Path, firmware: str, flown: str) -> None:
    """Its firmware too, unless another one is named; and it is not called a copy of another."""
    text = shipped("airframes/eclipson_c.toml").read_text().replace('"Eclipson Model C"', '"own"')
    own = tmp_path / "own.toml"
    own.write_text(text.replace('firmware = "bridge"', 'firmware = "px4"'))
    options = ["--firmware", firmware] if firmware else []
    begun(tmp_path / "new", "--airframe", str(own), *options)
    plane = load_airframe(tmp_path / "new" / "airframe.toml")
    assert (plane.airframe.name, plane.autopilot.firmware) == ("own", flown)
    assert "a copy of `own.toml`" in (tmp_path / "new" / "README.md").read_text()
    assert not (tmp_path / "new" / "airframe.toml").read_text().startswith("# A copy")


def test_where_nothing_can_be_written_the_folder_is_named(tmp_path: Path) -> None:
    assert "error: /proc/none: cannot be written: " in begun(Path("/proc/none"), code=2)
    own = tmp_path / "own.toml"
    own.write_text("[airframe]\n")
    assert f"{own}: airframe.name: missing" in begun(
        tmp_path / "new", "--airframe", str(own), code=2
    )


def test_a_file_in_the_place_of_the_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "new" / "newer"):
        assert f"{tmp_path / 'file'}: is a file: name a folder" in begun(folder, code=2)
    os.mkfifo(tmp_path / "pipe")  # nor in that of any other thing that is no folder
    assert f"{tmp_path / 'pipe'}: is a file: name a folder" in begun(tmp_path / "pipe", code=2)


@pytest.mark.parametrize(
    ("link", "fine"),
    [
        ("serial:/dev/ttyAMA0:921600", True),
        ("udp:127.0.0.1:14540", True),
        ("tcp:localhost:5760", True),
        ("serial:", False),
        ("udpout:14540", False),
        ("udp:127.0.0.1:0", False),
        ("usb:1", False),
    ],
)
def test_a_link_is_checked_and_not_opened(link: str, fine: bool) -> None:
    if fine:
        check_link(link)
    else:
        with pytest.raises(LinkError, match="link"):
            check_link(link)


# --- from the wheel -------------------------------------------------------------------------


def test_the_wheel_makes_the_same_folder(installed: Installed, tmp_path: Path) -> None:
    made = installed.run("tgl-soar", "init", "place", "--from", "hill", folder=tmp_path)
    assert made.returncode == 0, made.stderr
    folder = tmp_path / "place"
    assert {path.name for path in folder.iterdir()} == FILES
    (line,) = re.findall(r"(?m)^ExecStart=(.*)$", (folder / "tgl-soar.service").read_text())
    assert shlex.split(line)[:2] == [str(installed.bin / "tgl-soar"), "run"]
    assert f"`{installed.bin / 'tgl-soar'}`" in (folder / "README.md").read_text()
    shown = installed.run(
        *("tgl-soar", "params", "show", "--airframe", "airframe.toml", "--site", "site.toml"),
        *("--state", "state"),
        folder=folder,
    )
    assert shown.returncode == 0, shown.stderr
    begun(tmp_path / "source", "--from", "hill")
    for name in ("airframe.toml", "site.toml", "qgc_actions.json", "plotjuggler.xml"):
        assert (folder / name).read_bytes() == (tmp_path / "source" / name).read_bytes()


def test_the_wheel_knows_names_and_has_the_manual(installed: Installed, tmp_path: Path) -> None:
    shown = installed.run(
        *("tgl-soar", "params", "show", "--airframe", "eclipson_c", "--site", "hill"),
        *("--state", "state"),
        folder=tmp_path,
    )
    assert shown.returncode == 0, shown.stderr
    pages = installed.run("tgl-soar", "docs", folder=tmp_path)
    assert pages.returncode == 0, pages.stderr
    places = [line.split("  ")[0] for line in pages.stdout.splitlines()]
    assert [Path(place).name for place in places] == sorted(p.name for p in manual().glob("*.md"))
    assert all(Path(place).is_relative_to(installed.bin.parent) for place in places)
    page = installed.run("tgl-soar", "docs", "hardware", folder=tmp_path)
    assert page.stdout == (manual() / "hardware.md").read_text()
    assert (
        "there are aims, architecture"
        in installed.run("tgl-soar", "docs", "x", folder=tmp_path).stderr
    )


def test_in_the_wheel_readme_and_manual_find_one_another(installed: Installed) -> None:
    with zipfile.ZipFile(installed.wheel) as wheel:
        names = set(wheel.namelist())
        pages = [n for n in names if re.fullmatch(r"tgl_soar/(docs/[\w/-]+|[A-Z]+)\.md", n)]
        assert len(pages) > 25
        missing = []
        for page in pages:
            text = re.sub(r"(?m)^(    .*|```(.|\n)*?^```)$", "", wheel.read(page).decode())
            for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
                target = (Path("/") / page).parent / link
                inside = str(target.resolve()).removeprefix("/")
                if inside not in names:
                    missing.append((page, link))
        assert missing == []
