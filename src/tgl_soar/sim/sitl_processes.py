"""The bridge and the module of a flight: their files, their commands, and their processes."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

from tgl_soar.config.site import PositionSettings, Site, air_files
from tgl_soar.sim.child_process import with_parent
from tgl_soar.sim.firmware.sensors import SOMEWHERE
from tgl_soar.sim.injection import OVERRIDE_TIME_S
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

LOGS_MB = 500.0  # of all flights in a folder
# What `tgl-soar sitl` leaves in its folder of one flight, beside the logs.  The figures of the
# report's page are those of `analysis/report/flight_page.py`.
PROCESS_LOGS = ("bridge.log", "module.log", "page.log")
PAGES = ("summary.json", "flight.png", "search.png", "report.html", "companion.tlog")
FIGURES = (
    *("plane", "places", "point", "survey", "longitudinal", "lateral", "spectra", "loop", "health"),
)


def free_address() -> str:
    """A UDP port on the loopback interface that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def airframe_for(options: SitlOptions) -> Path:
    """The airframe file as a real firmware flies it, in the folder `flown` of the flight."""
    text = options.airframe.read_text()
    lines = [f'firmware = "{options.autopilot}"']
    if options.route is not None:
        lines.append(f'route = "{options.route}"')
        text = re.sub(r"(?m)^route *=.*\n", "", text)
    changed, count = re.subn(r"(?m)^firmware *=.*$", "\n".join(lines), text)
    if count != 1:
        raise SitlError(f"{options.airframe}: no line firmware = … in [autopilot] to replace")
    return _copy(options, options.airframe, changed)


def site_for(options: SitlOptions, site: Site) -> Path:
    """The site file as it is flown with a real firmware, in the folder `flown` of the flight.

    Where a tracker measures the position it is forwarded to the firmware as well.  Where satellites
    do, the site needs a place on earth: a firmware's local NED begins wherever it was started.
    """
    if site.mocap is not None and site.forward is None:
        added = "[forward]\n"
    elif site.mocap is None and site.position == PositionSettings():
        place = f"{{ latitude_deg = {SOMEWHERE.latitude_deg}, longitude_deg ="
        place += f" {SOMEWHERE.longitude_deg}, altitude_m = {SOMEWHERE.altitude_m} }}"
        added = f'[position]\nsources = ["global_position"]\nhome = {place}\n'
    else:
        return options.site
    text = _with_whole_paths(options.site.read_text(), site, options.site.parent.resolve())
    return _copy(options, options.site, f"{text}\n{added}")


def _with_whole_paths(text: str, site: Site, folder: Path) -> str:
    """A site file of a folder that names the files of its air from anywhere.

    Errors: `SitlError` where one is written in another way than in quotes, as with escapes.
    """
    files = [] if site.air is None else air_files(site.air, folder)
    missing = set(files)

    def whole(found: re.Match[str]) -> str:
        path = folder / found[4]
        if path not in files:
            return found[0]
        missing.discard(path)
        return f"{found[1]}{found[2]}{json.dumps(str(path), ensure_ascii=False)}"

    changed = re.sub(r"""\b(file|record)( *= *)(["'])(.*?)\3""", whole, text)
    if missing:
        raise SitlError(f"the site's [air]: write the name of {min(missing)} as plain text")
    return changed


def _copy(options: SitlOptions, source: Path, text: str) -> Path:
    """A file as it is flown, beside nothing of the user's.  Errors: `SitlError`, OSError."""
    path = options.out / "flown" / source.name
    if path.resolve() == source.resolve():
        raise SitlError(f"{source}: this is what the flight would overwrite; choose another --out")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def bridge_command(
    options: SitlOptions, truth_file: Path, operator: str, companion: str, mocap: str
) -> list[str]:
    """The bridge, for a companion and an operator at their addresses; mocap: "" for none."""
    command = [
        *(sys.executable, "-P", "-m", "tgl_soar.sim.bridge"),
        *("--airframe", str(options.airframe), "--site", str(options.site)),
        *("--companion", companion, "--gcs", operator),
        *("--seed", str(options.seed), "--log", str(truth_file)),
        *("--speed", "realtime" if options.realtime else "lockstep"),
        *("--receiver", options.receiver),
    ]
    if options.model is not None:
        command += ["--model", options.model]
    if options.by_hand:
        command += ["--launch", "hand"]
    if not options.pitot:
        command.append("--no-pitot")
    if options.autopilot == "builtin":
        command += ["--autopilot-parameter", f"RC_OVERRIDE_TIME={OVERRIDE_TIME_S:g}"]
    else:
        command += ["--autopilot", options.autopilot, "--firmware", str(options.firmware)]
        command += ["--firmware-folder", str(options.out / "firmware")]
        command += ["--record", str(options.out / "companion.tlog")]
    if options.mission is not None:
        command += ["--mission", str(options.mission)]
    for setting in options.autopilot_parameters:
        command += ["--autopilot-parameter", setting]
    for fault in options.faults:
        command += ["--fault", fault]
    if options.turbulence is not None:
        command += ["--turbulence", str(options.turbulence)]
    if mocap:
        command += ["--mocap", "natnet", "--mocap-local", mocap, *options.mocap_options]
    if options.realtime:
        command += ["--gcs", options.gcs, "--gcs-local", options.gcs_local]
        command += ["--companion-local", "127.0.0.1:0"]
    else:
        anywhere = "127.0.0.1:0"
        command += ["--lockstep-gcs", "--gcs-local", anywhere, "--companion-local", anywhere]
    return command


def module_command(options: SitlOptions, companion: str, mocap: str) -> list[str]:
    """What flies, as the companion at an address."""
    command = [
        *(sys.executable, "-P", "-m", "tgl_soar.cli", "run"),
        *("--airframe", str(options.airframe), "--site", str(options.site)),
        *("--link", f"udp:{companion}", "--state", "none"),
        *("--log", str(options.out / "logs"), "--log-max", f"{LOGS_MB:g}"),
    ]
    if mocap:
        command += ["--mocap-server", mocap]
    return command if options.realtime else [*command, "--lockstep"]


def page_command(options: SitlOptions, station: str, port: int) -> list[str]:
    """The operator's page, as a ground station at an address."""
    return [
        *(sys.executable, "-P", "-m", "tgl_soar.cli", "page"),
        *("--airframe", str(options.airframe), "--site", str(options.site)),
        *("--link", f"udp:{station}", "--port", str(port)),
    ]


def prepared(options: SitlOptions) -> Path:
    """The folder of the flight, without what the one before has left there but its logs, and where
    the truth will be in it.  Errors: `SitlError`."""
    truth_file = options.out / "truth.csv"
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        if any((options.out / name).exists() for name in (truth_file.name, PROCESS_LOGS[0])):
            _clear(options.out)
        truth_file.unlink(missing_ok=True)
    except OSError as error:
        raise SitlError(
            f"--out {options.out}: cannot be written: {error.strerror}; name another folder"
        ) from None
    return truth_file


def _clear(folder: Path) -> None:
    """Remove the files of an earlier flight by their names, and nothing else.  Errors: OSError."""
    for name in (*PROCESS_LOGS, *PAGES):
        (folder / name).unlink(missing_ok=True)
    figures = folder / "report-figures"
    for name in FIGURES:
        for ending in ("svg", "png"):
            (figures / f"{name}.{ending}").unlink(missing_ok=True)
    (figures / "numbers.json").unlink(missing_ok=True)
    if figures.is_dir() and not any(figures.iterdir()):
        figures.rmdir()


class SitlProcesses:
    """The processes of a flight, each with its output in a file of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: list[str]) -> None:
        """Start one by a name."""
        with self._log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(
                with_parent(command),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def check(self) -> None:
        """Errors: `SitlError` with its last words if one has ended."""
        for name, process in self._running.items():
            code = process.poll()
            if code is not None:
                raise SitlError(f"the {name} ended with exit code {code}\n{self.last_words()}")

    def kill(self, name: str) -> None:
        """By SIGKILL, and expect it no more."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def last_words(self) -> str:
        """The last lines that each has printed."""
        words = []
        for name in self._running:
            lines = self._log(name).read_text(errors="replace").splitlines()[-6:]
            words += [f"  {name}: {line}" for line in lines]
        return "\n".join(words)

    def pid(self, name: str) -> int:
        """Of one by its name."""
        return self._running[name].pid

    def lines_with(self, name: str, words: str) -> list[str]:
        """The lines of one that hold these words."""
        lines = self._log(name).read_text(errors="replace").splitlines()
        return [line for line in lines if words in line]

    def printed(self, name: str) -> list[str]:
        """All lines of one; none where it was not started."""
        log = self._log(name)
        return log.read_text(errors="replace").splitlines() if log.exists() else []

    def stop(self) -> None:
        """Ask all to end, the module first; kill what does not."""
        for process in reversed(self._running.values()):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(5.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"
