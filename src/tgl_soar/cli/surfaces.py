"""`tgl-soar surfaces`: move each surface on the ground, and see that it goes the right way."""

from __future__ import annotations

import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.table import Table

from tgl_soar.cli.console import AIRFRAME_FILE, console, errors, fail
from tgl_soar.cli.conversation import Conversation, KeyOption, LinkOption, TimeoutOption
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe
from tgl_soar.config.flown_gains import with_own_gains
from tgl_soar.config.lateral_gains import airframe_parameters
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.loop_margin import FLOOR, margin_when_late
from tgl_soar.link.checks.surface_check import NO_SPEED, SurfaceCheck
from tgl_soar.link.messages import (
    COMMAND_SET_MESSAGE_INTERVAL,
    ID_LOCAL_POSITION_NED,
    ID_SERVO_OUTPUT_RAW,
    CommandLong,
    Source,
)
from tgl_soar.link.signing_keys import SigningError
from tgl_soar.link.transports.base import LinkError
from tgl_soar.onboard.setup import direct_flavour_of, surface_channels
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.onboard.watchdog import ENDS, IGNORED

OUTPUT_HZ: Final = 50.0  # the outputs: their latency is known to 20 ms and less, by many steps
SPEED_HZ: Final = 10.0


def surfaces(
    link: LinkOption,
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)],
    deflection: Annotated[
        float, typer.Option(help="Deflection, as a fraction of full travel.", min=0.1, max=1.0)
    ] = 0.5,
    hold: Annotated[float, typer.Option(help="Seconds at each stop.", min=0.5, max=20.0)] = 1.5,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Ask nothing: compare the outputs only."),
    ] = False,
    armed_on_ground: Annotated[
        bool,
        typer.Option("--armed-on-ground", help="The aircraft is armed, and somebody holds it."),
    ] = False,
    timeout: TimeoutOption = 10.0,
    signing_key: KeyOption = None,
) -> None:
    """Move elevator, aileron and rudder in turn, say which way each must go, and compare the
    autopilot's outputs with the airframe file.

    Exit code 0: all is as in the file and moves as it must; 1: something is wrong; 2: not possible.
    """
    try:
        plane = load_airframe(airframe)
        flavour = direct_flavour_of(plane)
        check = SurfaceCheck(
            surface_channels(plane), flavour, deflection, hold, armed_on_ground=armed_on_ground
        )
        with Conversation(link, plane, flavour, signing_key) as conversation, _ended() as ended:
            bench = _Bench(check, conversation)
            bench.wait_for_autopilot(timeout)
            try:
                wrong = bench.go(_nobody if yes else _asked)
            finally:
                ended.is_over = True  # nothing may come between
                for _ in range(RELEASE_FRAMES):
                    for message in flavour.release():
                        conversation.command(message)
    except (ConfigError, LinkError, SigningError, _Refused) as error:
        fail(error)
    except _Ended as end:
        fail("stopped; the surfaces are released", 128 + end.signal_number)
    code = _reported(check, wrong)
    words = latency_words(check.latencies_s, plane)
    console.print(words, markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(code)


def latency_words(latencies_s: tuple[float, float], plane: Airframe) -> str:
    """What the latency of commands is, least and most, and what it leaves of the loop's margin."""
    values = with_own_gains(ParameterSet().changed(airframe_parameters(plane)), plane.autopilot)
    known_ms = 1e3 * values["CMD_DELAY"]
    least_s, most_s = latencies_s
    if not isfinite(least_s):
        return f"CMD_DELAY {known_ms:.3g} ms: not measured, no output was read back in time"
    words = (
        f"from a command to the output read back: {1e3 * least_s:.0f} to {1e3 * most_s:.0f} ms, the"
        f" way back and the wait for an output with it; CMD_DELAY is {known_ms:.3g} ms"
    )
    left, left_most = (margin_when_late(values, each) for each in latencies_s)
    if not isfinite(left):
        return f"{words}; what it leaves of the loop's margin is not known of this airframe"
    words += (
        "; were all of it delay of commands, it would leave a margin of"
        f" {left:.2f} to {left_most:.2f}"
    )
    if min(left, left_most) >= FLOOR:
        return words
    if left >= FLOOR:
        return (
            f"{words}, of {FLOOR:g}: if the link is that late at times, set CMD_DELAY"
            " (command_delay_s of [dynamics]) to what it then is"
        )
    return (
        f"{words}, of {FLOOR:g}: make the link faster, or set CMD_DELAY (command_delay_s of"
        " [dynamics]) to what it is"
    )


class _Ended(Exception):
    """Somebody has asked the command to end, or its terminal is gone."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal.Signals(signal_number).name)
        self.signal_number = signal_number


class _Signals:
    """Of those that end the command the first one is raised, once; no other comes between."""

    def __init__(self) -> None:
        self.is_over = False

    def __call__(self, number: int, _frame: object) -> None:
        if not self.is_over:
            self.is_over = True
            raise _Ended(number)


@contextmanager
def _ended() -> Iterator[_Signals]:
    """Within, no signal leaves a surface where it is: the command ends in order, or goes on.

    Stopped by ^Z, or because it speaks to a terminal while it is somebody else's turn there, it
    would hold the last command until the autopilot's time-out.
    """
    signals = _Signals()
    before = {number: signal.signal(number, signals) for number in ENDS}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in IGNORED}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Refused(Exception):
    """Nothing may be moved; the message says why."""


class _Bench:
    """The check, talked through with the autopilot."""

    def __init__(self, check: SurfaceCheck, conversation: Conversation) -> None:
        self._check = check
        self._conversation = conversation
        self._requests = [
            _rate_request(conversation.autopilot, message_id, rate_hz)
            for message_id, rate_hz in (
                (ID_SERVO_OUTPUT_RAW, OUTPUT_HZ),
                (ID_LOCAL_POSITION_NED, SPEED_HZ),
            )
        ]

    def wait_for_autopilot(self, timeout_s: float) -> None:
        """Until it has said what it is doing.  Errors: `_Refused`."""
        end_s = time.monotonic() + timeout_s
        while refusal := self._check.refusal(time.monotonic()):
            received = "no heartbeat" not in refusal and refusal != NO_SPEED
            if received or time.monotonic() > end_s:
                raise _Refused(refusal)
            self._turn()

    def go(self, look: Callable[[str], bool | None]) -> list[str]:
        """All stops; what a person said looked wrong.  Errors: `_Refused`."""
        check, wrong = self._check, []
        while not check.done:
            self._turn()
            now_s = time.monotonic()
            if refusal := check.refusal(now_s):
                raise _Refused(f"{refusal}; the surfaces are released")
            for message in check.step(now_s):
                self._conversation.command(message)
            if not check.held(now_s):
                continue
            right = look(check.sight) if check.sight else True
            if right is None:
                continue  # not answered yet: hold it there
            if not right:
                wrong.append(check.sight)
            check.move_on()
        return wrong

    def _turn(self) -> None:
        for message in self._conversation.turn(self._requests):
            self._check.take(message, time.monotonic())


def _rate_request(autopilot: Source, message_id: int, rate_hz: float) -> CommandLong:
    numbers = (float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)
    return CommandLong(
        target_system=autopilot.system,
        target_component=autopilot.component,
        command=COMMAND_SET_MESSAGE_INTERVAL,
        confirmation=0,
        params=numbers,
    )


def _nobody(sight: str) -> bool | None:
    console.print(f"  {sight}", highlight=False)
    return True


class _Asked:
    """Asks a person, without keeping the link waiting."""

    def __init__(self) -> None:
        self._question = ""

    def __call__(self, sight: str) -> bool | None:
        if sight != self._question:
            self._question = sight
            console.print(f"  {sight}?  \\[y/n] ", end="", highlight=False)
        if not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        try:
            line = sys.stdin.readline()
        except OSError:  # in the background of a terminal, or that is gone
            line = ""
        if not line:
            raise _Refused("nobody answers: give --yes to compare the outputs only")
        answer = line.strip().lower()
        if answer in ("y", "yes", "n", "no"):
            self._question = ""
            return answer.startswith("y")
        console.print(f"  y or n: {sight}?  ", end="", highlight=False)
        return None


_asked: Final = _Asked()


def _reported(check: SurfaceCheck, wrong: list[str]) -> int:
    """The table, what is wrong, and the exit code."""
    table = Table("surface", "trim", "negative", "positive", "outputs")
    faults = 0
    for found in check.findings():
        faults += len(found.faults)
        table.add_row(
            found.surface,
            *(_pulse(us) for us in (found.trim_us, found.low_us, found.high_us)),
            "as in the file" if not found.faults else "\n".join(found.faults),
        )
    console.print(table)
    for sight in wrong:
        errors.print(
            f"went the wrong way; it must be: {sight}\n  change `reversed` of that surface in the"
            " airframe file; if the pilot's stick moves it wrongly too, the autopilot's own",
            style="red",
            highlight=False,
            soft_wrap=True,
        )
    return 1 if faults or wrong else 0


def _pulse(us: float) -> str:
    return f"{us:.0f} us" if isfinite(us) else "-"
