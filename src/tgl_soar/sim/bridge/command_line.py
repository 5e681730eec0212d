"""The bridge's command line, and the options that it stands for."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Any

from tgl_soar.config.airframe import MODEL_OPTIONS
from tgl_soar.config.files import airframe_file, site_file
from tgl_soar.sim.bridge.mocap import add_mocap_options, mocap_options
from tgl_soar.sim.bridge.options import BridgeOptions, FirmwareOptions, Pace, PortOptions
from tgl_soar.sim.faults import Fault, FaultError, parse_fault, refusal
from tgl_soar.sim.ports import Address
from tgl_soar.sim.sensors import RECEIVERS
from tgl_soar.sim.simulation import Options, TimedSetting
from tgl_soar.types import FLOAT32_MAX


def parsed(words: Sequence[str]) -> BridgeOptions:
    """The options of a command line.  Errors: SystemExit, with words on the error stream."""
    parser = _parser()
    arguments = parser.parse_args(words)
    builtin = arguments.autopilot == "builtin"
    if why := refusal(arguments.fault, arguments.autopilot):
        parser.error(f"--fault {why}")
    if builtin and any(change.at_s > 0.0 for change in arguments.autopilot_parameter):
        parser.error("--autopilot-parameter NAME=NUMBER@SECONDS needs a firmware: --autopilot")
    if not builtin and arguments.launch == "hand":
        parser.error("--launch hand: a firmware is launched in the air")
    if not builtin and arguments.receiver != "local":
        parser.error(f"--receiver {arguments.receiver}: a firmware has its own")
    return BridgeOptions(
        airframe=arguments.airframe,
        site=arguments.site,
        simulation=_simulation_options(arguments),
        pace=Pace(
            lockstep=arguments.speed == "lockstep",
            lockstep_ground=arguments.lockstep_gcs,
            duration_s=arguments.duration,
            patience_s=arguments.patience,
            start_timeout_s=arguments.start_timeout,
        ),
        ports=PortOptions(
            ground=tuple(arguments.gcs or PortOptions.ground),
            companion=arguments.companion,
            ground_local=arguments.gcs_local,
            companion_local=arguments.companion_local,
        ),
        firmware=None
        if builtin
        else FirmwareOptions(
            arguments.autopilot, arguments.firmware, arguments.firmware_folder, arguments.mission
        ),
        mocap=mocap_options(arguments),
    )


def _simulation_options(arguments: argparse.Namespace) -> Options:
    settings: list[TimedSetting] = arguments.autopilot_parameter
    return Options(
        model=None if arguments.model is None else MODEL_OPTIONS[arguments.model],
        seed=arguments.seed,
        turbulence=arguments.turbulence,
        step_hz=arguments.step_rate,
        pilot=arguments.pilot == "steady",
        held=arguments.launch != "free",
        by_hand=arguments.launch == "hand",
        armed=arguments.launch != "bench",
        truth=not arguments.no_truth,
        uptime_s=arguments.uptime,
        allow_odometry=arguments.odometry,
        faults=tuple(arguments.fault),
        pitot=not arguments.no_pitot,
        receiver=arguments.receiver,
        rangefinder=arguments.rangefinder,
        parameters=tuple((c.name, c.value) for c in settings if c.at_s == 0.0),
        later=tuple(change for change in settings if change.at_s > 0.0),
        record=arguments.record,
        log=arguments.log,
        log_hz=arguments.log_rate,
    )


def _address(text: str) -> Address:
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r}: write HOST:PORT, such as 127.0.0.1:14550")
    return host, int(port)


def _number(low: float, high: float) -> Any:
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: a number from {low:g} to {high:g}")
        return value

    return parse


def _whole(low: int, high: int) -> Any:
    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: a whole number from {low} to {high}")
        return int(text)

    return parse


def _setting(text: str) -> TimedSetting:
    name, _, rest = text.partition("=")
    value, _, at = rest.partition("@")
    try:
        setting = TimedSetting(name.strip(), float(value), float(at or 0.0))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}: write NAME=NUMBER, such as SYSID_MYGCS=255, or NAME=NUMBER@SECONDS"
        ) from None
    if not (abs(setting.value) <= FLOAT32_MAX and 0.0 <= setting.at_s < inf):
        raise argparse.ArgumentTypeError(
            f"{text!r}: NUMBER must be one of 32 bits, and SECONDS finite and not negative"
        )
    return setting


def _fault(text: str) -> Fault:
    try:
        return parse_fault(text)
    except FaultError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sitl_bridge",
        description="A simulated Pixhawk with its aircraft and its air, over MAVLink on UDP.",
    )
    add = parser.add_argument
    add("--airframe", type=airframe_file, required=True, help="airframe file, or a shipped name")
    add(
        "--site", type=site_file, required=True,
        help="site file with [air] and [start], or a shipped name",
    )  # fmt: skip
    add(
        "--model", choices=tuple(MODEL_OPTIONS),
        help="six degrees of freedom, or the paper's point mass (default: the airframe file's)",
    )  # fmt: skip
    add(
        "--gcs", type=_address, action="append", metavar="HOST:PORT",
        help="where a ground station listens; repeat for more (default 127.0.0.1:14550)",
    )  # fmt: skip
    add(
        "--companion", type=_address, default=PortOptions.companion, metavar="HOST:PORT",
        help="where the companion listens (default 127.0.0.1:14540)",
    )  # fmt: skip
    add(
        "--gcs-local", type=_address, default=PortOptions.ground_local, metavar="HOST:PORT",
        help="own port towards ground stations (default 127.0.0.1:18570; port 0: any)",
    )  # fmt: skip
    add(
        "--companion-local", type=_address, metavar="HOST:PORT",
        default=PortOptions.companion_local,
        help="own port towards the companion (default 127.0.0.1:14580; port 0: any)",
    )  # fmt: skip
    add("--seed", type=_whole(0, 2**63), default=1, help="of noise and turbulence (default 1)")
    add(
        "--turbulence", type=_number(0.0, 0.5), metavar="FRACTION",
        help="of the reference wind, 0.03 is 3 %% (default: the site's)",
    )  # fmt: skip
    add("--speed", choices=("realtime", "lockstep"), default="realtime")
    add("--lockstep-gcs", action="store_true", help="lockstep waits for ground stations too")
    add("--duration", type=_number(0.0, 1e9), metavar="S", help="simulated seconds to run")
    add("--log", type=Path, metavar="FILE", help="truth as CSV, or .npz")
    add("--log-rate", type=_whole(1, 400), default=50, metavar="HZ", help="(default 50)")
    add("--step-rate", type=int, choices=(200, 400), default=200, help="steps per second")
    add(
        "--pilot", choices=("steady", "none"), default="steady",
        help="who flies while nobody overrides the surfaces (default: a steady safety pilot)",
    )  # fmt: skip
    add(
        "--launch", choices=("held", "free", "bench", "hand"), default="held",
        help="held at the start until the first override, free at once, disarmed on a bench, or"
        " thrown from a hand before the crest, 2 s after the first override",
    )  # fmt: skip
    add(
        "--autopilot", choices=("builtin", "px4", "ardupilot"), default="builtin",
        help="the simulated Pixhawk, or a real firmware in its place (default: builtin)",
    )  # fmt: skip
    _add_firmware(parser)
    add("--record", type=Path, metavar="FILE", help="traffic of firmware and companion, as .tlog")
    add("--no-truth", action="store_true", help="send no truth to ground stations")
    _add_sensors(parser)
    add(
        "--autopilot-parameter", type=_setting, action="append", default=[],
        metavar="NAME=NUMBER[@S]", help="of the autopilot, of a firmware at S seconds; repeatable",
    )  # fmt: skip
    add(
        "--uptime", type=_number(0.0, 1e7), default=0.0, metavar="S",
        help="time since boot at the start",
    )  # fmt: skip
    add(
        "--fault", type=_fault, action="append", default=[], metavar="'NAME start=S for=S'",
        help="what goes wrong, as 'position.dropout start=20 for=1.5'; repeat for more;"
        " `--fault list` shows all",
    )  # fmt: skip
    add_mocap_options(parser)
    add("--patience", type=_number(0.1, 3600.0), default=5.0, metavar="S", help="(default 5)")
    add("--start-timeout", type=_number(0.1, 3600.0), default=30.0, metavar="S")
    return parser


def _add_sensors(parser: argparse.ArgumentParser) -> None:
    """Of what the autopilot has to tell."""
    add = parser.add_argument
    add("--odometry", action="store_true", help="stream ODOMETRY, which ArduPlane denies")
    add("--rangefinder", action="store_true", help="a laser that looks down: DISTANCE_SENSOR")
    add(
        "--receiver", choices=tuple(RECEIVERS), default="local",
        help="of the simulated Pixhawk: a local system that is exact, satellites that drift by a"
        " metre and two in height, or satellites with carrier-phase corrections (default: local)",
    )  # fmt: skip
    add("--no-pitot", action="store_true", help="VFR_HUD then shows a guess, as ArduPlane does")


def _add_firmware(parser: argparse.ArgumentParser) -> None:
    """Of a real one alone."""
    add = parser.add_argument
    add("--firmware", type=Path, metavar="PATH", help="the firmware's program")
    add(
        "--firmware-folder", type=Path, default=Path("out/firmware"), metavar="DIR",
        help="where the firmware runs and keeps its files (default out/firmware)",
    )  # fmt: skip
    add(
        "--mission", type=Path, metavar="FILE", help="for the firmware, as ground stations write it"
    )
