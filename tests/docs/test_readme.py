"""The README, how docs/hardware.md installs and how docs/safety.md breaks a flight: every command
and snippet, run as it is printed.

Each command that a page prints is named by the test that proves it; a new one that none names
fails.  What is changed before it is run stands in that test, and is no more than this: ports that
are free, folders of the test for /opt and /etc, a simulated autopilot on the serial line.
Commands that would change this computer (apt, systemctl) are replaced by ones that only write down
what they were asked.
"""

from __future__ import annotations

import itertools
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import hypot
from pathlib import Path
from typing import Any, Final

import pictures
import pytest
from free_ports import free_port
from installed_wheel import Installed
from peers_scene import Scene

from tgl_soar.cli.log_argument import newest_log
from tgl_soar.config.files import manual

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
OF_MAKE = ("ARGS", "MAKEFLAGS", "MAKEOVERRIDES", "MAKELEVEL")  # of the make that runs these tests
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
HARDWARE = (manual() / "hardware.md").read_text(encoding="utf-8")
INSTALLING = HARDWARE.partition("\n## Installing\n")[2].partition("\n## ")[0]
SAFETY = (manual() / "safety.md").read_text(encoding="utf-8")
BREAKING = SAFETY.partition("\n## Break it\n")[2].partition("\n## ")[0]

PROGRAMS = "make|tgl-soar|pip|python|kill|pkill|param set|sudo"
PATIENCE_S = 120.0  # for what takes seconds, were the machine not busy with other things

PROVED: dict[str, str] = {}  # by which test


def proves(*commands: str) -> Callable[[Any], Any]:
    """Names the commands that a test runs."""

    def named(test: Any) -> Any:
        PROVED.update(dict.fromkeys(commands, test.__name__))
        return test

    return named


def commands_in(page: str) -> list[str]:
    """Every command of a page: of its blocks, comments removed, and in its sentences."""
    page = re.sub(r"(?ms)^```.*?^```$", "", page)
    lines = [line.strip() for line in re.findall(r"(?m)^ {4,}(\S.*)$", page)]
    joined = "\n".join(lines).replace("\\\n", "")
    blocks = [re.sub(r"\s+#\s.*", "", line) for line in joined.splitlines()]
    text = re.sub(r"(?m)^ {4,}\S.*$", "", page)
    spans = re.findall(rf"`((?:{PROGRAMS}) [^`]+)`", text)
    return [re.sub(r"\s+", " ", command) for command in (*blocks, *spans)]


def snippet() -> str:
    (only,) = re.findall(r"(?ms)^```python\n(.*?)^```$", README)
    return str(only)


def test_every_command_is_proved() -> None:
    printed = {each for page in (README, INSTALLING, BREAKING) for each in commands_in(page)}
    assert printed - set(PROVED) == set(), "a command that no test runs"
    assert set(PROVED) - printed == set(), "a test of a command that is not printed"
    assert len(re.findall(r"(?m)^ *```", README)) == 2, "a snippet that no test runs"


def test_a_new_command_would_be_seen() -> None:
    page = (
        "Say `tgl-soar fly` or `X`:\n\n    make x \\\n        y   # why\n\n1. so\n\n       sudo b\n"
    )
    assert commands_in(page) == ["make x y", "sudo b", "tgl-soar fly"]


# --- a desk with the programs on its path ------------------------------------------------------


class Desk:
    """A folder to work in, with the programs of an activated environment on the path."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.asked = folder / "asked.txt"  # what was not run, for it would change this computer
        self.bin = folder / "environment" / "bin"
        self.bin.mkdir(parents=True)
        self.program("python", f'exec {shlex.quote(sys.executable)} "$@"')
        self.program("python3", f'exec {shlex.quote(sys.executable)} "$@"')
        self.program("pip", 'exec python -m pip "$@"')
        self.program("tgl-soar", 'exec python -m tgl_soar.cli "$@"')
        self.program("sudo", 'exec "$@"')
        for name in ("apt", "systemctl", "journalctl"):
            self.program(name, f'echo {name} "$@" >> {shlex.quote(str(self.asked))}')
        for name in (".made", ".run", ".test"):  # what make leaves in its environment
            (self.bin.parent / name).touch()
        # Of a path inside tests the package is found by the folders that this process has.
        self.environment = {
            **{name: value for name, value in os.environ.items() if name not in OF_MAKE},
            "PATH": f"{self.bin}:{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), *filter(None, sys.path)]),
            "PYTHONUNBUFFERED": "1",
            "VENV": str(self.bin.parent),
            "XDG_STATE_HOME": str(folder / "state"),
            "HOME": str(folder),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        }

    def program(self, name: str, body: str) -> None:
        path = self.bin / name
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)

    def run(self, command: str, *, code: int = 0, typed: str = "") -> str:
        """One line, by a shell; what it printed."""
        done = subprocess.run(
            ["bash", "--norc", "-c", command],
            cwd=self.folder,
            env=self.environment,
            input=typed,
            capture_output=True,
            text=True,
            timeout=1800,
        )
        assert done.returncode == code, f"{command}\n{done.stdout}\n{done.stderr}"
        return done.stdout + done.stderr

    @contextmanager
    def terminal(self, name: str, *program: str) -> Iterator[Terminal]:
        terminal = Terminal(self, name, program or ("bash", "--norc"))
        try:
            yield terminal
        finally:
            terminal.close()


class Terminal:
    """A program that lines are typed into, and all that is written to it."""

    def __init__(self, desk: Desk, name: str, program: tuple[str, ...]) -> None:
        self._log = desk.folder / f"{name}.txt"
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                program, cwd=desk.folder, env=desk.environment, stdin=subprocess.PIPE,
                stdout=log, stderr=subprocess.STDOUT, text=True, start_new_session=True,
            )  # fmt: skip

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    @property
    def words(self) -> str:
        return self._log.read_text(errors="replace")

    def wait(self, text: str, times: int = 1) -> None:
        until = time.monotonic() + PATIENCE_S
        while self.words.count(text) < times:
            assert time.monotonic() < until, f"no {text!r} in:\n{self.words}"
            time.sleep(0.05)

    def close(self) -> None:
        """End it and what it has started, by its session."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        for pid in _session(self.process.pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(10.0)
        for pid in _session(self.process.pid):
            with suppress(ProcessLookupError):  # it has just ended by itself
                os.kill(pid, signal.SIGKILL)
        self.process.wait()


def _session(leader: int) -> list[int]:
    """The processes of a session that live."""
    reported = subprocess.run(
        ["ps", "-s", str(leader), "-o", "pid=,stat="], capture_output=True, text=True
    )
    rows = [row.split() for row in reported.stdout.splitlines()]
    return [int(pid) for pid, state in rows if not state.startswith("Z")]


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


# --- try it ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Desk, str]:
    """A desk at which the demo was flown, in what stands for the clone, and its output."""
    desk = Desk(tmp_path_factory.mktemp("demo"))
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        (desk.folder / name).symlink_to(ROOT / name)
    return desk, desk.run("make run")


def far_from(path: list[pictures.Point], other: list[pictures.Point]) -> float:
    """How far the farthest point of a path is from another path [m]."""

    def away(p: pictures.Point, a: pictures.Point, b: pictures.Point) -> float:
        along = (b[0] - a[0], b[1] - a[1])
        length2 = along[0] ** 2 + along[1] ** 2
        over = ((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / length2 if length2 else 0.0
        at = max(0.0, min(1.0, over))
        return hypot(p[0] - a[0] - at * along[0], p[1] - a[1] - at * along[1])

    legs = list(itertools.pairwise(other))
    return max(min(away(point, a, b) for a, b in legs) for point in path)


# The pictures show 3 m on some 500 pixels, with a stroke of two: what differs by less than the
# stroke's width is the same picture.
STROKE_M: Final = 0.012


def assert_shows(picture: str, truth: Path) -> None:
    flown, drawn = pictures.path_of(truth), pictures.kept_paths()[picture]
    far_m = max(far_from(flown, drawn), far_from(drawn, flown))
    assert far_m < STROKE_M, f"docs/images/{picture} is of another flight: make pictures"


@proves("make run", "tgl-soar sitl")
def test_the_demo_flies_and_is_the_first_picture(demo: tuple[Desk, str]) -> None:
    desk, printed = demo
    out = desk.folder / "out" / "sitl"
    assert (out / "flight.png").stat().st_size > 10_000
    assert "not held" not in printed
    assert_shows("flight.png", out / "truth.csv")
    assert re.search(r"(?m)^\t\$\(BIN\)/tgl-soar sitl \$\(ARGS\)$", MAKEFILE)


@proves("tgl-soar report LOG")
def test_a_log_becomes_a_page(demo: tuple[Desk, str]) -> None:
    desk, _ = demo
    log = newest_log(desk.folder / "out" / "sitl" / "logs")
    desk.run(f"tgl-soar report {log}")
    assert list((desk.folder / "out" / "report").glob("*.html"))


@proves("tgl-soar sitl --help", "tgl-soar params", "tgl-soar docs")
def test_what_is_only_shown(desk: Desk) -> None:
    assert "--turbulence" in desk.run("tgl-soar sitl --help")
    assert "OP_ENGAGE" in desk.run("tgl-soar params")
    assert "hardware.md" in desk.run("tgl-soar docs")


@proves(". .venv/bin/activate")
def test_an_activated_environment_has_the_program(desk: Desk, installed: Installed) -> None:
    (desk.folder / ".venv").symlink_to(installed.bin.parent)
    # As a program is found: before those of the desk.
    found = desk.run(". .venv/bin/activate; command -v tgl-soar; command -v python")
    assert found.split() == [str(installed.bin / "tgl-soar"), str(installed.bin / "python")]


@proves("make test", "make bench", "make pictures")
def test_make_has_these_targets(desk: Desk) -> None:
    """This is run by the first; the second's measurements have tests of their own; what the third
    makes is compared below and above."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        (desk.folder / name).symlink_to(ROOT / name)
    assert "/pytest -n 2" in desk.run("make -n test")
    assert "python -m benchmarks" in desk.run("make -n bench")
    assert "python tools/pictures.py" in desk.run("make -n pictures")


@pytest.mark.long
@proves("tgl-soar sitl --turbulence 0.03 --report")
def test_a_flight_in_turbulence_and_its_report(desk: Desk) -> None:
    assert "not held" not in desk.run("tgl-soar sitl --turbulence 0.03 --report")
    assert (desk.folder / "out" / "sitl" / "report.html").stat().st_size > 100_000
    assert_shows("report.png", desk.folder / "out" / "sitl" / "truth.csv")


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [
        "tgl-soar sitl --mocap natnet",
        "tgl-soar sitl --site hill --stay 40",
        "tgl-soar sitl --search",
        "tgl-soar sitl --model point-mass --site tunnel_polynomial",
        "tgl-soar sitl --site hill --launch hand --legs c --land",
    ],
)
@proves(
    "tgl-soar sitl --mocap natnet",
    "tgl-soar sitl --site hill --stay 40",
    "tgl-soar sitl --search",
    "tgl-soar sitl --model point-mass --site tunnel_polynomial",
    "tgl-soar sitl --site hill --launch hand --legs c --land",
)
def test_other_flights(desk: Desk, command: str) -> None:
    assert "not held" not in desk.run(command)


@pytest.mark.parametrize("picture", pictures.PICTURES, ids=lambda p: p.name)
def test_every_picture_says_of_which_flight_it_is(picture: pictures.Picture) -> None:
    assert f"docs/images/{picture.name}" in README
    if not picture.firmware:  # else it is made only where there is that program
        kept = pictures.kept_paths()[picture.name]
        assert pictures.digest_in(pictures.IMAGES / picture.name) == pictures.digest(kept)


def test_every_picture_is_made_by_the_command() -> None:
    shown = set(re.findall(r"\(docs/images/([^)]+)\)", README))
    # By tools/page_pictures.py and tools/page_film.py.
    of_a_browser = {"page.png", "drag.webp"}
    assert shown == {picture.name for picture in pictures.PICTURES} | of_a_browser
    assert far_from([(0.0, 0.0), (1.0, 0.5)], [(0.0, 0.0), (2.0, 0.0)]) == 0.5


# --- move it by hand ---------------------------------------------------------------------------


GROUND: Final = "127.0.0.1:14550"


class OpenScene(Scene):
    """Bridge and module in lockstep; no station on the ground is waited for, and one listens."""

    def __init__(self, folder: Path) -> None:
        self.station = f"127.0.0.1:{free_port()}"
        super().__init__(folder)

    def _start(self, name: str, words: list[str]) -> subprocess.Popen[bytes]:
        if name == "bridge":
            words = [word for word in words if word != "--lockstep-gcs"]
            words += ["--gcs", self.station]
        return super()._start(name, words)


def test_the_snippet_moves_the_line(desk: Desk) -> None:
    scene = OpenScene(desk.folder)
    try:
        assert GROUND in snippet()
        with desk.terminal(
            "snippet", sys.executable, "-c", snippet().replace(GROUND, scene.station)
        ) as station:
            scene.pilot.engage()
            assert station.process.wait(PATIENCE_S) == 0, station.words
            assert "the line slides up: 1." in station.words
        scene.pilot.wait("it stands", lambda: abs(scene.pilot.values["line_z"] - 1.7) < 2e-3)
    finally:
        scene.close()


# `sitl` in real time has the ports that the firmwares' simulators have; here it gets others.
ELSEWHERE = """
import sys
from functools import partial
from tgl_soar.sim import sitl, sitl_options, sitl_page
gcs, companion = sys.argv[1:3]
command = sitl.bridge_command
sitl.bridge_command = sitl_page.bridge_command = lambda *given: [
    *command(*given), "--gcs-local", "127.0.0.1:0", "--companion-local", "127.0.0.1:0"
]
sitl_options.SitlOptions = partial(sitl_options.SitlOptions, gcs=gcs, companion=companion)
sys.argv[1:] = sys.argv[3:]
from tgl_soar.cli.__main__ import main
main()
"""


@pytest.mark.long
@proves('make run ARGS="--page"')
def test_the_page_is_served_beside_a_flight(desk: Desk) -> None:
    pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        (desk.folder / name).symlink_to(ROOT / name)
    ports = f"127.0.0.1:{free_port()} 127.0.0.1:{free_port()}"  # other flights may have the usual
    desk.program("tgl-soar", f'exec python -c {shlex.quote(ELSEWHERE)} {ports} "$@"')
    with desk.terminal("flight") as terminal:
        terminal.type('make run ARGS="--page --page-port 0"')
        terminal.wait("engage there; Ctrl-C ends it")
        (address,) = re.findall(r"http://127\.0\.0\.1:\d+/", terminal.words)
        with urllib.request.urlopen(address, timeout=PATIENCE_S) as page:
            assert b"tgl_soar" in page.read()


@pytest.mark.long
@proves("tgl-soar sitl --realtime --legs b --stay 60")
def test_the_snippet_moves_the_line_of_the_demo(desk: Desk) -> None:
    station = f"127.0.0.1:{free_port()}"
    program = (sys.executable, "-c", ELSEWHERE, station, f"127.0.0.1:{free_port()}")
    _, *options = ["tgl-soar", "sitl", "--realtime", "--legs", "b", "--stay", "60"]
    text = snippet().replace(GROUND, station)
    with desk.terminal("demo", *program, *options) as flight:
        with desk.terminal("snippet", sys.executable, "-c", text) as moved:
            assert moved.process.wait(PATIENCE_S) == 0, moved.words
        assert flight.process.wait(PATIENCE_S) == 0, flight.words
        assert re.search(r"b +│ moved by hand", flight.words), flight.words


# --- a real autopilot ----------------------------------------------------------------------------

FIRMWARES: Final = {
    "tgl-soar sitl --autopilot ardupilot --ardupilot ARDUPILOT/build/sitl/bin/arduplane": (
        "ARDUPILOT/build/sitl/bin/arduplane",
        "TGL_SOAR_ARDUPLANE",
    ),
    "tgl-soar sitl --autopilot px4 --px4 PX4/build/px4_sitl_default/bin/px4": (
        "PX4/build/px4_sitl_default/bin/px4",
        "TGL_SOAR_PX4",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("command", FIRMWARES)
@proves(*FIRMWARES)
def test_a_real_autopilot_flies(desk: Desk, command: str) -> None:
    program, variable = FIRMWARES[command]
    if not os.environ.get(variable):
        pytest.skip(f"{variable} names no program")
    desk.run(command.replace(program, shlex.quote(os.environ[variable])))


@pytest.mark.parametrize("command", FIRMWARES)
def test_a_real_autopilot_that_is_not_there_is_reported(desk: Desk, command: str) -> None:
    assert FIRMWARES[command][0] in desk.run(command, code=2).replace("\n", "")


# --- break it ------------------------------------------------------------------------------------

BRIDGE: Final = (
    "python tools/sitl_bridge.py --airframe eclipson_c --site tunnel"
    " --autopilot-parameter RC_OVERRIDE_TIME=0.5"
)
MODULE: Final = (
    "tgl-soar run --airframe eclipson_c --site tunnel --link udp:127.0.0.1:14540 --state none &"
)
MAVPROXY: Final = (
    "mavproxy.py --master=udp:127.0.0.1:14550 --default-modules=param,cmdlong"
    " --target-system=1 --target-component=191"
)
GET_MAVPROXY: Final = "pip install -c constraints.txt MAVProxy"
ENGAGE: Final = "param set OP_ENGAGE 1"


def mavproxy() -> str:
    """The program, where its package is installed."""
    package = pytest.importorskip("MAVProxy")
    return str(Path(package.__file__).parents[4] / "bin" / "mavproxy.py")


@pytest.mark.long
@proves(BRIDGE, MODULE, GET_MAVPROXY, MAVPROXY, ENGAGE, "pkill -9 -P $!", "kill -9 %1")
def test_what_dies_is_handed_over_or_times_out(desk: Desk) -> None:
    station, companion = free_port(), f"127.0.0.1:{free_port()}"
    desk.program("mavproxy.py", f'exec python {mavproxy()} --no-state "$@"')
    for name in ("tools", "constraints.txt"):
        (desk.folder / name).symlink_to(ROOT / name)
    desk.environment["PIP_NO_INDEX"] = "1"  # it is here, as `make test` has it
    desk.run(GET_MAVPROXY)
    ports = f" --gcs 127.0.0.1:{station} --gcs-local 127.0.0.1:0"
    ports += f" --companion {companion} --companion-local 127.0.0.1:0"
    ground = MAVPROXY.replace(GROUND, f"127.0.0.1:{station}")
    module = MODULE.replace("127.0.0.1:14540", companion)
    with (
        desk.terminal("bridge", *shlex.split(BRIDGE + ports)) as bridge,
        desk.terminal("module") as second,
        desk.terminal("ground", *shlex.split(ground)) as third,
    ):
        second.type("set -m")  # as every shell that a person types into
        second.type(module)
        second.wait("ready: can be engaged")
        third.wait("parameters")
        third.type(ENGAGE)
        second.wait("capturing: engaged")
        bridge.wait("launched")

        second.type("pkill -9 -P $!")
        second.wait("the watchdog released the surfaces")
        assert "timed out" not in bridge.words
        second.wait("ready: can be engaged", times=2)
        third.type(ENGAGE)
        second.wait("capturing: engaged", times=2)

        second.type("kill -9 %1")
        bridge.wait("timed out")
        assert second.words.count("the watchdog released the surfaces") == 1


# --- on an aircraft ------------------------------------------------------------------------------

SERIAL: Final = "serial:/dev/ttyAMA0:921600"
MAKE_VENV: Final = "sudo python3 -m venv /opt/tgl_soar"
INSTALL: Final = "sudo /opt/tgl_soar/bin/pip install '.[native]'"
COMPILE: Final = "sudo /opt/tgl_soar/bin/tgl-soar compile"
BEGIN: Final = "sudo /opt/tgl_soar/bin/tgl-soar init /etc/tgl_soar --firmware ardupilot"
PATH: Final = "export PATH=/opt/tgl_soar/bin:$PATH"
ENTER: Final = "cd /etc/tgl_soar"
FILES: Final = "--airframe airframe.toml --site site.toml"
PREFLIGHT: Final = f"tgl-soar preflight --link {SERIAL} {FILES}"
SURFACES: Final = f"tgl-soar surfaces --link {SERIAL} --airframe airframe.toml"
RUN: Final = f"tgl-soar run --link {SERIAL} {FILES}"
SERVICE: Final = (
    "sudo install -m 644 /etc/tgl_soar/tgl-soar.service /etc/systemd/system/",
    "sudo systemctl daemon-reload",
    "sudo systemctl enable --now tgl-soar",
    "journalctl -fu tgl-soar",
)
BUILD: Final = (
    "python3 -m venv .venv",
    ".venv/bin/pip wheel --no-deps --wheel-dir dist .",
)
NEEDED: Final = "sudo apt install python3-venv python3-dev gcc"
INSTALL_WHEEL: Final = (
    "sudo /opt/tgl_soar/bin/pip install 'dist/tgl_soar-0.1.0-py3-none-any.whl[native]'"
)


class Companion(Desk):
    """A desk whose /opt and /etc are folders of the test, without a network."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        del self.environment["PYTHONPATH"]  # what is installed is to be found, not the source
        self.environment |= {"PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0"}
        (folder / "etc" / "systemd" / "system").mkdir(parents=True)

    def here(self, command: str) -> str:
        command = command.replace("/opt/tgl_soar", f"{self.folder}/opt/tgl_soar")
        command = command.replace("/etc/systemd", f"{self.folder}/etc/systemd")
        return command.replace("/etc/tgl_soar", f"{self.folder}/etc/tgl_soar")

    def lend(self, environment: Path) -> None:
        """What a registry would have: the packages that this process has."""
        (site,) = environment.glob("lib/python*/site-packages")
        lent = [path for path in sys.path if Path(path).name == "site-packages"]
        (site / "lent.pth").write_text("\n".join(lent) + "\n")


@pytest.fixture(scope="module")
def companion(tmp_path_factory: pytest.TempPathFactory) -> Companion:
    """Installed from the clone as the README says."""
    companion = Companion(tmp_path_factory.mktemp("companion"))
    companion.run(companion.here(MAKE_VENV))
    companion.lend(companion.folder / "opt" / "tgl_soar")
    companion.run(f"cd {ROOT}; {companion.here(INSTALL)}")
    companion.run(companion.here(BEGIN))
    return companion


@proves(MAKE_VENV, INSTALL, BEGIN, PATH, ENTER, "tgl-soar init")
def test_it_is_installed_from_a_clone(companion: Companion) -> None:
    opt = companion.folder / "opt" / "tgl_soar"
    words = companion.here(f"{PATH}; {ENTER}; command -v tgl-soar; pwd")
    assert companion.run(words).split() == [
        str(opt / "bin" / "tgl-soar"),
        str(companion.folder / "etc" / "tgl_soar"),
    ]
    assert (
        'firmware = "ardupilot"'
        in (companion.folder / "etc" / "tgl_soar" / "airframe.toml").read_text()
    )
    where = companion.run(f"{opt}/bin/python -c 'import tgl_soar; print(tgl_soar.__file__)'")
    assert where.startswith(str(opt))


@pytest.mark.long  # the wheel itself is built, installed and read in tests/cli/test_init.py
@proves(*BUILD, NEEDED, INSTALL_WHEEL)
def test_it_is_installed_from_a_wheel(tmp_path: Path) -> None:
    companion = Companion(tmp_path)
    # pip copies nothing of what a build does not read; the clone is not written to.
    papers = [path.name for path in ROOT.glob("*.md")]
    for name in ("src", "config", "docs", "pyproject.toml", "LICENSE", *papers):
        (tmp_path / name).symlink_to(ROOT / name)
    companion.run(BUILD[0])
    companion.lend(tmp_path / ".venv")
    companion.run(BUILD[1])
    companion.run(NEEDED)
    assert companion.asked.read_text() == "apt install python3-venv python3-dev gcc\n"
    companion.run(companion.here(MAKE_VENV))
    companion.lend(tmp_path / "opt" / "tgl_soar")
    companion.run(companion.here(INSTALL_WHEEL))
    assert "hardware.md" in companion.run(f"{tmp_path}/opt/tgl_soar/bin/tgl-soar docs")


@proves(*SERVICE)
def test_it_becomes_a_service(companion: Companion) -> None:
    companion.asked.unlink(missing_ok=True)
    for command in SERVICE:
        companion.run(companion.here(command))
    assert companion.asked.read_text().splitlines() == [
        "systemctl daemon-reload",
        "systemctl enable --now tgl-soar",
        "journalctl -fu tgl-soar",
    ]
    unit = companion.folder / "etc" / "systemd" / "system" / "tgl-soar.service"
    (line,) = re.findall(r"(?m)^ExecStart=(.*)$", unit.read_text())
    there = [word for word in shlex.split(line) if word.startswith(str(companion.folder))]
    assert len(there) == 3
    assert all(Path(word).is_file() for word in there)


@contextmanager
def on_the_bench(companion: Companion) -> Iterator[Callable[[str], str]]:
    """A simulated autopilot on its stand; how a command is sent to it."""
    link = f"127.0.0.1:{free_port()}"
    airframe = companion.folder / "etc" / "tgl_soar" / "airframe.toml"
    written = airframe.read_text()
    airframe.write_text(written.replace('firmware = "ardupilot"', 'firmware = "bridge"'))
    words = (
        *(sys.executable, "-m", "tgl_soar.sim.bridge", "--launch", "bench"),
        *("--airframe", "eclipson_c", "--site", "tunnel", "--companion", link),
        *("--companion-local", "127.0.0.1:0", "--gcs-local", "127.0.0.1:0"),
        *("--gcs", f"127.0.0.1:{free_port()}"),
        *("--autopilot-parameter", "RC_OVERRIDE_TIME=0.5"),
    )
    ours = Desk(companion.folder / "bench")
    try:
        with ours.terminal("bridge", *words):
            yield lambda command: companion.here(
                f"{PATH}; {ENTER}; {command.replace(SERIAL, f'udp:{link}')}"
            )
    finally:
        airframe.write_text(written)


@proves(PREFLIGHT, SURFACES, RUN)
def test_the_vehicle_is_asked_and_flown(companion: Companion) -> None:
    with on_the_bench(companion) as in_bench:
        assert "ready" in companion.run(in_bench(PREFLIGHT))
        assert "rudder" in companion.run(in_bench(SURFACES), typed="y\n" * 12)
        with companion.terminal("run") as terminal:
            terminal.type(in_bench(RUN))
            terminal.wait("standby: position, attitude and autopilot are there")


@pytest.mark.long
@proves(COMPILE, "tgl-soar compile")
def test_what_flies_is_compiled(companion: Companion) -> None:
    companion.run(companion.here(COMPILE))
    version = companion.here(
        f"{PATH}; tgl-soar run --airframe eclipson_c --site tunnel --state none"
        f" --link udp:127.0.0.1:{free_port()} --timeout 0.1"
    )
    assert "code: native" in companion.run(version, code=3)
