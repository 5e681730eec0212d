#!/usr/bin/env python3
"""What a real firmware does by itself, and what becomes of the flight: docs/autopilots.md.

    python tools/measure_failsafes.py ardupilot override --firmware .../bin/arduplane
    python tools/measure_failsafes.py ardupilot attitude --firmware PATH --only radio --out out/fs
    python tools/measure_failsafes.py px4 attitude --firmware .../bin/px4
    python tools/measure_failsafes.py px4 attitude --firmware PATH --only estimator --seed 1 2 3
    python tools/measure_failsafes.py px4 attitude --firmware PATH --only compass --param ESC_AUTO=1

Each trial is a flight over the hill by satellites, in calm air, as `tgl-soar sitl` flies it: the
module soars leg a, then something fails.  A row says when the module has disengaged and by which
words, what modes the firmware was in, and how the aircraft is at the end: `WATCH_S` after the
module has disengaged, or after the failure where it has not.  Times are since the failure.

The simulated pilot flies by the sticks whenever the module does not, as far as their transmitter is
received.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Final

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.batch_options import changes_of
from tgl_soar.config.files import shipped
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

FAILS_S: Final = 80.0  # it has aligned after some 25 s, and soars leg a from then on
WATCH_S: Final = 20.0
STATION: Final = 254  # system id of the operator of `tgl-soar sitl`
AT: Final = f"@{FAILS_S:g}"
# As preflight asks for.
GOOD: Final = ("THR_FAILSAFE=1", "FS_SHORT_ACTN=2", "FS_LONG_ACTN=2")
BATTERY: Final = (
    "BATT_MONITOR=4",
    "BATT_LOW_VOLT=10.5",
    "BATT_LOW_TIMER=2",
    f"SIM_BATT_VOLTAGE=9{AT}",
)
FENCE: Final = ("FENCE_TYPE=1", "FENCE_ALT_MAX=1", f"FENCE_ENABLE=1{AT}")  # above the start


@dataclass(frozen=True)
class Trial:
    """One thing that fails."""

    name: str
    settings: tuple[str, ...]  # of the firmware
    fault: str = ""  # of the catalogue, without its start; several with "; " between them
    watched_s: float = 30.0  # where the module flies on
    fails_s: float = FAILS_S
    stands_s: float = 40.0  # its line stands by then
    station: bool = False  # the operator is the firmware's own ground station


def _radio(words: str, fault: str, *settings: str) -> Trial:
    return Trial(f"radio: {words}", settings or GOOD, fault)


def _link(seconds: float) -> Trial:
    fault = f"link.down for={seconds:g}; link.up for={seconds:g}"
    return Trial(f"link to the module: silent for {seconds:g} s", GOOD, fault)


def _gps(words: str, *settings: str) -> Trial:
    return Trial(f"estimator: {words}", (*GOOD, *settings), watched_s=60.0)


def _at(seconds: float, fails_s: float = FAILS_S) -> str:
    return f"@{fails_s + seconds:g}"


ARDUPILOT: Final = (
    _radio("no pulses for 2 s", "transmitter.silent for=2"),
    _radio("no pulses for good", "transmitter.silent for=999"),
    _radio("throttle low for 2 s", "transmitter.failsafe for=2"),
    _radio("throttle low for good", "transmitter.failsafe for=999"),
    _radio("throttle low for 2 s, FS_SHORT_ACTN 0", "transmitter.failsafe for=2",
           "THR_FAILSAFE=1", "FS_SHORT_ACTN=0", "FS_LONG_ACTN=2"),
    _radio("throttle low for good, FS_SHORT_ACTN 3", "transmitter.failsafe for=999",
           "THR_FAILSAFE=1", "FS_SHORT_ACTN=3", "FS_LONG_ACTN=2"),
    _radio("throttle low for good, FS_LONG_ACTN 0", "transmitter.failsafe for=999",
           "THR_FAILSAFE=1", "FS_SHORT_ACTN=2", "FS_LONG_ACTN=0"),
    _radio("throttle low for good, THR_FAILSAFE 0", "transmitter.failsafe for=999",
           "THR_FAILSAFE=0", *GOOD[1:]),
    _radio("throttle low for good, THR_FAILSAFE 2", "transmitter.failsafe for=999",
           "THR_FAILSAFE=2", *GOOD[1:]),
    _radio("no pulses for good, THR_FAILSAFE 0", "transmitter.silent for=999",
           "THR_FAILSAFE=0", *GOOD[1:]),
    *(_link(seconds) for seconds in (1.5, 4.0, 8.0)),
    Trial("station: silent for good, FS_GCS_ENABL 1", (*GOOD, "FS_GCS_ENABL=1"),
          "station.silent for=999", station=True),
    Trial("station: silent for good, FS_GCS_ENABL 1, FS_LONG_ACTN 0",
          (*GOOD[:2], "FS_LONG_ACTN=0", "FS_GCS_ENABL=1"), "station.silent for=999", station=True),
    Trial("battery: low, BATT_FS_LOW_ACT 0", (*GOOD, *BATTERY, "BATT_FS_LOW_ACT=0")),
    Trial("battery: low, BATT_FS_LOW_ACT 1 (RTL)", (*GOOD, *BATTERY, "BATT_FS_LOW_ACT=1")),
    Trial("fence: too high, FENCE_ACTION 0", (*GOOD, *FENCE, "FENCE_ACTION=0")),
    Trial("fence: too high, FENCE_ACTION 1 (RTL)", (*GOOD, *FENCE, "FENCE_ACTION=1")),
    Trial("fence: too high, FENCE_ACTION 6 (GUIDED)", (*GOOD, *FENCE, "FENCE_ACTION=6")),
    _gps("no fix for 2 s", f"SIM_GPS_DISABLE=1{AT}", f"SIM_GPS_DISABLE=0{_at(2)}"),
    _gps("no fix for 5 s", f"SIM_GPS_DISABLE=1{AT}", f"SIM_GPS_DISABLE=0{_at(5)}"),
    _gps("no fix for 15 s", f"SIM_GPS_DISABLE=1{AT}", f"SIM_GPS_DISABLE=0{_at(15)}"),
    _gps("fixes 3 m to the north for 20 s",
         f"SIM_GPS_GLITCH_X=2.7e-5{AT}", f"SIM_GPS_GLITCH_X=0{_at(20)}"),
    _gps("fixes 30 m to the north from then on", f"SIM_GPS_GLITCH_X=27e-5{AT}"),
    _gps("barometer drifts by 2 cm/s from then on", f"SIM_BARO_DRIFT=0.02{AT}"),
    _gps("first compass off by 60 mG from then on", f"SIM_MAG1_OFS_X=60{AT}"),
    _gps("first accelerometer off by 3 m/s² from then on", f"SIM_ACC1_BIAS_X=3{AT}"),
)  # fmt: skip
PX4_FAILS_S: Final = 40.0
PX4_STANDS_S: Final = 8.0


def _then(seconds: float) -> str:
    return _at(seconds, PX4_FAILS_S)


# PX4's battery is a model of its own, which drains while it is armed.
PX4_CHECKED: Final = ("CBRK_SUPPLY_CHK=0", "SIM_BAT_MIN_PCT=0", "SIM_BAT_DRAIN=86400")
PX4_BATTERY: Final = (*PX4_CHECKED, f"SIM_BAT_DRAIN=2{_then(0)}")
PX4_FENCE: Final = (f"GF_MAX_VER_DIST=1{_then(0)}",)  # over home, at the origin: below the aircraft


def _px4(words: str, fault: str, *settings: str, watched_s: float = 25.0) -> Trial:
    return Trial(
        words, settings, fault, watched_s=watched_s, fails_s=PX4_FAILS_S, stands_s=PX4_STANDS_S
    )


def _sensor(words: str, fault: str, *settings: str) -> Trial:
    """Of PX4: its readings come from us."""
    return _px4(f"estimator: {words}", fault, *settings, watched_s=53.0)


PX4: Final = (
    _px4("all, as asked for: radio for 2 s, battery after 5 s, fence after 12 s",
         "transmitter.silent for=2",
         *PX4_CHECKED, f"SIM_BAT_DRAIN=2{_then(5)}", f"GF_MAX_VER_DIST=1{_then(12)}",
         "GF_ACTION=1"),
    _px4("station: silent for good", "station.silent for=999"),
    _px4("radio: none for good", "transmitter.silent for=999"),
    _px4("radio: none for 2 s, COM_RCL_EXCEPT 0", "transmitter.silent for=2", "COM_RCL_EXCEPT=0"),
    _px4("radio: none for good, COM_RCL_EXCEPT 0", "transmitter.silent for=999",
         "COM_RCL_EXCEPT=0"),
    _px4("radio: none for good, COM_RCL_EXCEPT 0, NAV_RCL_ACT 3 (Land)",
         "transmitter.silent for=999", "COM_RCL_EXCEPT=0", "NAV_RCL_ACT=3"),
    _px4("station: silent for good, NAV_DLL_ACT 2 (Return)", "station.silent for=999",
         "NAV_DLL_ACT=2", "COM_DL_LOSS_T=5"),
    _px4("battery: empty, COM_LOW_BAT_ACT 3 (Return, Land)", "", *PX4_BATTERY,
         "COM_LOW_BAT_ACT=3"),
    _px4("fence: too high, GF_ACTION 2 (Hold)", "", *PX4_FENCE, "GF_ACTION=2"),
    _px4("fence: too high, GF_ACTION 3 (Return)", "", *PX4_FENCE, "GF_ACTION=3"),
    _sensor("no fix for 2 s", "satellites.lost for=2"),
    _sensor("no fix for 5 s", "satellites.lost for=5"),
    _sensor("no fix for 15 s", "satellites.lost for=15"),
    _sensor("no fix for good", "satellites.lost for=999"),
    _sensor("receiver silent for 15 s", "satellites.silent for=15"),
    _sensor("satellites not used for 15 s (EKF2_GPS_CTRL 0)", "",
            f"EKF2_GPS_CTRL=0{_then(0)}", f"EKF2_GPS_CTRL=7{_then(15)}"),
    _sensor("fixes 3 m to the north for 20 s", "satellites.bias for=20 north=3"),
    _sensor("fixes 30 m to the north from then on", "satellites.bias for=999 north=30"),
    _sensor("barometer drifts by 2 cm/s from then on", "barometer.drift for=999 by=0.02"),
    _sensor("barometer silent for good", "barometer.silent for=999"),
    _sensor("compass off by 60 mG from then on", "compass.bias for=999 x=60"),
    _sensor("compass silent for good", "compass.silent for=999"),
    _sensor("accelerometer off by 3 m/s² from then on", "accelerometer.bias for=999 x=3"),
)  # fmt: skip
TRIALS: Final = {"ardupilot": ARDUPILOT, "px4": PX4}
PX4_MODES: Final = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD",
                    7: "STABILIZED", 10: "TERMINATION"}  # fmt: skip
PX4_AUTO: Final = {3: "HOLD", 4: "MISSION", 5: "RETURN", 6: "LAND", 9: "PRECLAND"}


@dataclass(frozen=True)
class Outcome:
    """What became of one flight; times since the failure."""

    released_s: float  # inf: not
    words: str  # of the module
    modes: list[tuple[float, str]]
    texts: list[str]  # of the firmware
    says: list[str]  # the module, from when it soars
    lost_s: float  # inf: not
    lost_x_m: float  # where, downstream of the hill's axis
    rms_e_m: float  # of e_rho, while the module flew on
    away_m: float  # at most, from where it was when it failed
    aside_m: float  # at most, of that to either side
    released_m: float  # away when the module disengaged; NaN: it did not


def mode_word(firmware: str, custom_mode: int) -> str:
    """As the firmware's own pages call it."""
    if firmware == "px4":
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        return PX4_AUTO.get(sub, f"AUTO {sub}") if main == 4 else PX4_MODES.get(main, str(main))
    names = mavutil.mode_mapping_bynumber(mavlink.MAV_TYPE_FIXED_WING) or {}
    return str(names.get(custom_mode, custom_mode))


def outcome(
    firmware: str, fails_s: float, folder: Path, line: tuple[float, float, float]
) -> Outcome:
    """Of a flight in a folder; line: x0 [m], z0 [m], eta [rad]."""
    with (folder / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    truth = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    since = truth["time_s"] - fails_s
    after = since >= 0.0
    commanded = since[(truth["overridden"] > 0.0) & after]
    released = float(commanded[-1]) if commanded.size and commanded[-1] < since[-1] - 1.0 else inf
    down = since[after & (truth["flying"] == 0.0)]
    x0, z0, eta = line
    e = np.cos(eta) * (truth["z_m"] - z0) - np.sin(eta) * (truth["x_m"] - x0)
    flown = after & (since < min(released, down[0] if down.size else inf))
    begin = int(np.argmax(after))
    in_air = after & (since < (down[0] if down.size else inf))
    moved = np.array([truth[name] - truth[name][begin] for name in ("x_m", "y_m", "z_m")])
    away = np.linalg.norm(moved, axis=0)
    changes = [
        (float(s), mode_word(firmware, int(mode)))
        for (_, before), (s, mode) in pairwise(
            zip(since[begin - 1 :], truth["mode"][begin - 1 :], strict=True)
        )
        if mode != before
    ]
    module = (folder / "module.log").read_text(errors="replace")
    bridge = (folder / "bridge.log").read_text(errors="replace")
    words = re.findall(r"released: (.*)", module)
    return Outcome(
        released_s=released,
        words=words[-1] if words else "",
        modes=changes,
        texts=re.findall(r"it reports: (.*)", bridge),
        says=re.findall(r"tgl_soar: (.*)", module.partition("soaring: on the line")[2]),
        lost_s=float(down[0]) if down.size else inf,
        lost_x_m=float(truth["x_m"][since >= down[0]][0]) if down.size else inf,
        rms_e_m=float(np.sqrt(np.mean(e[flown] ** 2))) if flown.any() else float("nan"),
        away_m=float(away[in_air].max()),
        aside_m=float(np.abs(moved[1][in_air]).max()),
        released_m=float(away[after & (since <= released)][-1]) if released < inf else float("nan"),
    )


def flown(
    trial: Trial,
    firmware: str,
    route: str,
    program: Path,
    folder: Path,
    seed: int,
    parameters: tuple[tuple[str, float], ...] = (),
) -> Outcome:
    """Fly a trial; parameters: of the module.  Errors: `SitlError`."""
    airframe = shipped("airframes/eclipson_c.toml")
    if trial.station:
        text = re.sub(r"(?m)^override_system_id *= *\d+", f"override_system_id = {STATION}",
                      airframe.read_text())  # fmt: skip
        folder.mkdir(parents=True, exist_ok=True)
        airframe = folder / "with_station.toml"
        airframe.write_text(text)
    flight = fly(
        SitlOptions(
            airframe=airframe,
            site=shipped("sites/hill.toml"),
            out=folder,
            legs=("a",),
            stay_s=trial.fails_s - trial.stands_s + trial.watched_s,
            seed=seed,
            # With settings that the module refuses, too.
            settings=(("OP_FORCE", 1.0), *parameters),
            faults=tuple(
                fault if "start=" in fault else f"{fault} start={trial.fails_s:g}"
                for fault in trial.fault.split("; ")
                if fault
            ),
            autopilot=firmware,
            firmware=program,
            route=route,
            autopilot_parameters=trial.settings,
            watch_s=WATCH_S,
        ),
        lambda _: None,
    )
    report = (folder / "bridge.log").read_text(errors="replace")
    if missed := re.search(r"\S+ (did not take|is not set to) .*", report):
        raise SitlError(missed[0])
    return outcome(firmware, trial.fails_s, folder, flight.lines[0])


def row(name: str, found: Outcome) -> str:
    """Of the table."""
    module = "flies on" if found.released_s == inf else f"{found.released_s:.1f} s: {found.words}"
    if found.released_s == inf and found.rms_e_m == found.rms_e_m:
        module += f", e_rho {100 * found.rms_e_m:.1f} cm rms"
    if found.released_s < inf:
        module += f" ({found.released_m:.1f} m away)"
    module += f", {found.away_m:.1f} m away at most, {found.aside_m:.1f} m to the side"
    modes = ", ".join(f"{mode} {s:.1f} s" for s, mode in found.modes) or "no change"
    end = "flies"
    if found.lost_s < inf:
        end = f"**on the ground after {found.lost_s:.1f} s at x = {found.lost_x_m:.0f} m**"
    return f"| {name} | {modes} | {module} | {end} |"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("autopilot", choices=TRIALS)
    parser.add_argument("route")
    parser.add_argument("--firmware", type=Path, metavar="PATH", required=True, help="its program")
    parser.add_argument("--only", default="", metavar="WORDS", help="trials whose name has these")
    parser.add_argument("--seed", type=int, nargs="+", default=[1], help="a flight of each")
    parser.add_argument("--out", type=Path, default=Path("out/failsafes"), help="folder")
    parser.add_argument("--param", dest="parameters", nargs="+", default=[],
                        metavar="NAME=VALUE", help="of the module")  # fmt: skip
    parser.add_argument("--texts", action="store_true", help="what the firmware says, too")
    arguments = parser.parse_args()
    print("| what fails | modes of the firmware | the module | the aircraft |\n|---|---|---|---|")
    for number, trial in enumerate(TRIALS[arguments.autopilot]):
        if arguments.only not in trial.name:
            continue
        folder = arguments.out / f"{arguments.autopilot}-{arguments.route}-{number}"
        for seed in arguments.seed:
            name = trial.name if len(arguments.seed) == 1 else f"{trial.name}, seed {seed}"
            try:
                found = flown(
                    trial,
                    arguments.autopilot,
                    arguments.route,
                    arguments.firmware,
                    folder / f"seed{seed}",
                    seed,
                    tuple(changes_of(arguments.parameters).items()),
                )
            except SitlError as error:
                print(f"| {name} | not flown: {str(error).splitlines()[0]} | | |", flush=True)
                continue
            print(row(name, found), flush=True)
            if arguments.texts:
                said = [f"    {text}" for text in found.texts]
                said += [f"    module: {text}" for text in found.says]
                print("\n".join(said), file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
