"""The line and its switch at the prompt of MAVProxy: `module load tgl`, then `tgl …`.

    tgl move X Z [LEAN]    the line's point [m], and its lean [deg]; all of it moves together
    tgl lean DEG           its lean alone
    tgl preset NAME        a line of the site file, by name or number
    tgl site FILE          that site file
    tgl engage|release|abort
    tgl status             mode, line, aircraft, what engaging lacks
    tgl component N        the module's component, where it is not 191

It asks by the same parameters and commands as every station, and repeats what is not answered
(`page.orders`).  What it prints as confirmed is the module's echo; why something was refused the
module says by STATUSTEXT, which MAVProxy prints itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import isfinite
from typing import Any, Final

from MAVProxy.modules.lib import mp_module
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.orders import ABORT, ENGAGE, RELEASE, Done, Orders
from tgl_soar.cli.page.settling_preview import GhostLine
from tgl_soar.cli.page.station import StationAnswer
from tgl_soar.config.airframe import COMPONENT_ID
from tgl_soar.config.files import ConfigError, load_site
from tgl_soar.config.line_changes import LINE
from tgl_soar.config.parameters import INDEX, ParameterError, checked_value
from tgl_soar.config.site import Site
from tgl_soar.control.supervisor import ENTRY, is_flying
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES
from tgl_soar.estimation.health import FAULT_TEXTS
from tgl_soar.onboard.telemetry_values import FAST, HELD_BACK, SLOW

NAME: Final = "tgl"
FETCH_S: Final = 2.0  # between two requests for parameters that are missing
SILENCE_S: Final = 3.0  # three heartbeats: the module counts as silent
WANTED: Final = (*LINE, "TGL_STAGE", "TGL_PRESET")
SWITCH: Final = {"engage": ENGAGE, "release": RELEASE, "abort": ABORT}
USAGE: Final = (
    "tgl move X Z [LEAN] | lean DEG | preset NAME | site FILE | engage | release | abort | status"
    " | component N"
)
_HELD_BACK_TEXT: Final = "held back (abort, switch, line or set-up; tgl engage says which)"


class PromptError(Exception):
    """What was typed cannot be done; the text says why."""


class MavproxyStation:
    """The module as MAVProxy's links show it; what `Orders` sets and commands goes out there."""

    def __init__(self, master: Callable[[], Any], target_system: Callable[[], int]) -> None:
        """master: the link that MAVProxy sends on now.  target_system: 0: whichever is there."""
        self.component = COMPONENT_ID
        self.parameters: dict[str, float] = {}
        self.values: dict[str, float] = {}
        self.on_answer: Callable[[StationAnswer], None] = lambda _answer: None
        self._master = master
        self._target_system = target_system
        self._system = 0  # the one that was received
        self._start: int | None = None  # the number that the module drew at its start
        self._received_s = float("-inf")
        self._fetched_s = float("-inf")

    @property
    def system(self) -> int:
        """The module's system; 0: not known yet."""
        return self._target_system() or self._system

    def silence_s(self, now_s: float) -> float:
        """Since the last message of the module; inf: none yet."""
        return now_s - self._received_s

    def change_component(self, component: int) -> None:
        """Another module: nothing is known of it."""
        self.component, self._start = component, None
        self._received_s = float("-inf")
        self.parameters.clear()
        self.values.clear()

    def take(self, message: Any, now_s: float) -> None:
        """One message, whoever sent it."""
        if message.get_srcComponent() != self.component:
            return
        if message.get_srcSystem() != (self._target_system() or message.get_srcSystem()):
            return
        self._system, self._received_s = message.get_srcSystem(), now_s
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._take_start(message.custom_mode >> 8)
            self.values["soar_mode"] = float(message.custom_mode & 0xFF)
        elif kind == "NAMED_VALUE_FLOAT" and message.name in (*FAST, *SLOW):
            self.values[message.name] = message.value
        elif kind == "PARAM_VALUE" and message.param_id in INDEX:
            name, value = message.param_id, message.param_value
            self.parameters[name] = value
            self.on_answer(StationAnswer(kind="value", name=name, value=value))
        elif kind == "PARAM_ERROR" and self._is_for_us(message):
            self.on_answer(StationAnswer(kind="error", name=message.param_id))
        elif kind == "COMMAND_ACK" and self._is_for_us(message):
            command, result = message.command, message.result
            self.on_answer(StationAnswer(kind="ack", command=command, result=result))

    def _take_start(self, number: int) -> None:
        """Another number than before: the module was started again."""
        if number != self._start:
            self._start = number
            self.parameters.clear()
            self.values.clear()

    def _is_for_us(self, message: Any) -> bool:
        return message.target_system in (0, self._master().mav.srcSystem)

    def set(self, name: str, value: float) -> None:
        """One PARAM_SET."""
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        self._master().mav.param_set_send(self.system, self.component, name.encode(), value, kind)

    def command(self, number: int, confirmation: int) -> None:
        """One COMMAND_LONG without parameters."""
        fields = (number, confirmation, 0, 0, 0, 0, 0, 0, 0)
        self._master().mav.command_long_send(self.system, self.component, *fields)

    def fetch(self, now_s: float) -> None:
        """Ask for what is not known of the line."""
        if self.silence_s(now_s) > SILENCE_S or now_s - self._fetched_s < FETCH_S:
            return
        self._fetched_s = now_s
        for name in WANTED:
            if name not in self.parameters:
                self._master().mav.param_request_read_send(
                    self.system, self.component, name.encode(), -1
                )


class TglModule(mp_module.MPModule):  # type: ignore[misc]
    """The command `tgl`."""

    def __init__(self, mpstate: Any) -> None:
        # Other vehicles' too: those of our component are picked out by `MavproxyStation`.
        super().__init__(
            mpstate, NAME, "target gradient line of tgl_soar", public=True, multi_vehicle=True
        )
        self.station = MavproxyStation(mpstate.master, lambda: self.settings.target_system)
        self.orders = Orders(self.station, self._done)
        self._site: Site | None = None
        self._wanted_preset: tuple[str, GhostLine] | None = None
        completions = ["<move|lean|preset|engage|release|abort|status|component>"]
        self.add_command(NAME, self.cmd_tgl, USAGE, [*completions, "site (FILENAME)"])

    # --- MAVProxy's hooks -----------------------------------------------------------------------

    def mavlink_packet(self, packet: Any) -> None:
        """A message has come."""
        self.station.take(packet, time.monotonic())

    def idle_task(self) -> None:
        """Repeat what was not answered."""
        now_s = time.monotonic()
        self.station.fetch(now_s)
        self.orders.step(now_s)
        self._compare_preset()

    def unload(self) -> None:
        """The command goes with the module."""
        self.remove_command(NAME)

    def cmd_tgl(self, words: list[str]) -> None:
        """One line that was typed."""
        try:
            self._obey(words)
        except (PromptError, ParameterError, ConfigError) as error:
            _print(str(error))
        else:
            self.orders.step(time.monotonic())

    # --- typed ----------------------------------------------------------------------------------

    def _obey(self, words: list[str]) -> None:
        known: dict[str, tuple[Callable[..., None], range]] = {
            "move": (self._move, range(2, 4)),
            "lean": (self._lean, range(1, 2)),
            "preset": (self._preset, range(1, 2)),
            "site": (self._read_site, range(1, 2)),
            "status": (self._status, range(1)),
            "component": (self._component, range(1, 2)),
        }
        name, *rest = words or [""]
        if name in SWITCH and not rest:
            self._known_system()
            self.orders.command(NAME, SWITCH[name])
        elif name in known and len(rest) in known[name][1]:
            known[name][0](*rest)
        else:
            raise PromptError(f"usage: {USAGE}")

    def _move(self, x: str, z: str, lean: str | None = None) -> None:
        line = self._line()
        self.orders.move(
            NAME,
            GhostLine(
                _value("TGL_X", x),
                _value("TGL_Z", z),
                line.lean_deg if lean is None else _value("TGL_LEAN", lean),
            ),
        )

    def _lean(self, lean: str) -> None:
        self.orders.move(NAME, self._line()._replace(lean_deg=_value("TGL_LEAN", lean)))

    def _line(self) -> GhostLine:
        """As the module has it.  Errors: `PromptError`."""
        self._known_system()
        line = self.orders.line()
        if line is None:
            raise PromptError("the module's line is not known yet: try again in a moment")
        return line

    def _known_system(self) -> None:
        if self.station.system == 0:
            raise PromptError(
                f"no module is known: component {self.station.component} was not received, and"
                " target_system is 0 (set target_system N; tgl component N)"
            )

    def _preset(self, name: str) -> None:
        self._known_system()
        if name.isdecimal():
            value = checked_value("TGL_PRESET", float(name))
            if value == 0.0:
                raise PromptError("tgl preset 0: lines are counted from 1")
            self.orders.preset(NAME, int(value), name)
            return
        if self._site is None:
            raise PromptError(f"tgl preset {name}: no site file: tgl site FILE, or give a number")
        lines = self._site.lines
        if name not in lines:
            known = ", ".join(lines) or "none"
            raise PromptError(f"tgl preset {name}: the site's lines are {known}")
        line = lines[name]
        lean = float("nan") if line.lean_deg is None else line.lean_deg
        self._wanted_preset = name, GhostLine(line.x_m, line.z_m, lean)
        self.orders.preset(NAME, list(lines).index(name) + 1, name)

    def _compare_preset(self) -> None:
        """Once it is confirmed: the module may have been started with another site file."""
        now, wanted = self.orders.line(), self._wanted_preset
        if wanted is None or self.orders.is_busy or now is None:
            return
        self._wanted_preset = None
        name, line = wanted
        differs = [abs(a - b) > 1e-3 for a, b in zip(now, line, strict=True)]  # NaN: any lean
        if self.station.parameters.get("TGL_PRESET") != 0.0 and any(differs):
            _print(
                f"WARNING: the module's line is x {now.x_m:.2f} m, z {now.z_m:.2f} m, and not"
                f" {name} of this site file, x {line.x_m:.2f} m, z {line.z_m:.2f} m: the module"
                " was started with another one"
            )

    def _read_site(self, file: str) -> None:
        self._site = load_site(file)
        lines = ", ".join(f"{i} {name}" for i, name in enumerate(self._site.lines, 1))
        _print(f"site {self._site.site.name}: lines {lines or 'none'}")

    def _component(self, number: str) -> None:
        if not number.isdecimal() or not 1 <= int(number) <= 255:
            raise PromptError(f"tgl component {number}: must be 1 to 255")
        self.station.change_component(int(number))

    # --- shown ----------------------------------------------------------------------------------

    def _done(self, done: Done) -> None:
        if not done.ok and "line" in done.text:
            self._wanted_preset = None
        _print(done.text)

    def _status(self) -> None:
        station = self.station
        silence_s = station.silence_s(time.monotonic())
        if silence_s > SILENCE_S:
            since = (
                "was not received yet" if silence_s == float("inf") else f"{silence_s:.0f} s ago"
            )
            _print(f"SILENT: component {station.component} of system {station.system}: {since}")
        for line in status_lines(station.values, self.orders.line()):
            _print(line)


def status_lines(values: dict[str, float], line: GhostLine | None) -> list[str]:
    """What telemetry reports, in words.  values: by the names of `NAMED_VALUE_FLOAT`."""
    number = values.get("soar_mode", -1.0)
    mode = int(number) if 0 <= number < len(MODE_NAMES) else -1
    name = "mode not known" if mode < 0 else MODE_NAMES[mode]
    shown = [f"{name}: e_rho {_of(values, 'e_rho', 'm')}"]
    if line is not None:
        shown.append(
            f"line set    x {line.x_m:.2f} m, z {line.z_m:.2f} m, lean {line.lean_deg:.1f} deg"
        )
    x, z, lean = (_of(values, f"line_{name}", unit) for name, unit in _LINE_UNITS)
    shown.append(f"line flown  x {x}, z {z}, lean {lean}")
    shown.append(f"aircraft    x {_of(values, 'soar_x', 'm')}, z {_of(values, 'soar_z', 'm')}")
    shown.append(
        f"air         airspeed {_of(values, 'airspeed', 'm/s')},"
        f" updraft {_of(values, 'updraft', 'm/s')}, excess {_of(values, 'excess', 'm/s')}"
    )
    if mode >= 0 and not is_flying(mode):
        entry = _bits(values, "entry")
        lacks = [words for i, words in enumerate(CONDITION_TEXTS) if (entry & ENTRY) >> i & 1]
        known = "nothing" if "entry" in values else "not known"
        shown.append(f"engaging lacks: {', '.join(lacks) or known}")
        if entry & HELD_BACK:
            shown.append(_HELD_BACK_TEXT)
    faults = _bits(values, "faults")
    if words := [words for i, words in enumerate(FAULT_TEXTS) if faults >> i & 1]:
        shown.append(f"faults: {', '.join(words)}")
    return shown


_LINE_UNITS: Final = (("x", "m"), ("z", "m"), ("lean", "deg"))


def _of(values: dict[str, float], name: str, unit: str) -> str:
    value = values.get(name, float("nan"))
    return f"{value:.2f} {unit}" if isfinite(value) else "not known"


def _bits(values: dict[str, float], name: str) -> int:
    value = values.get(name, 0.0)
    return int(value) if isfinite(value) and value >= 0.0 else 0


def _value(name: str, text: str) -> float:
    """Errors: `PromptError` for what is no number; `ParameterError` for one outside its range."""
    try:
        value = float(text)
    except ValueError:
        raise PromptError(f"{name}: {text!r} is no number") from None
    return checked_value(name, value)


def _print(text: str) -> None:
    print(f"tgl: {text}")


def init(mpstate: Any) -> TglModule:
    """MAVProxy's way in."""
    return TglModule(mpstate)
