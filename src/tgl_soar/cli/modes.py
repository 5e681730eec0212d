"""`tgl-soar modes`: the supervisor's table as a page."""

from __future__ import annotations

from typing import Final

import typer

from tgl_soar.control import supervisor
from tgl_soar.control.envelope import CUT_TEXTS
from tgl_soar.control.supervisor import ACTION_TEXTS, TRANSITIONS
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES, REASON_TEXTS
from tgl_soar.estimation.health import FAULT_TEXTS

MAKE: Final = "tgl-soar modes > docs/modes.md"

_HEAD: Final = f"""\
# Modes

<!-- Made by `{MAKE}`; change the table in `control/supervisor.py` instead. -->

This page is for operators and developers: every mode of the module, and every change of mode with
its conditions and its reason. A diagram is in [architecture.md](architecture.md#the-modes).

One table decides. In every tick the rows of the current mode are tried from top to bottom. The
first row is taken for which all conditions under *when* hold and none under *unless*. Its reason is
sent as a `STATUSTEXT`: the new mode, a colon, and the reason. If no row fits, the mode stays.

| number (`soar_mode`) | mode | commands the surfaces |
|---|---|---|
"""

_TIMERS: Final = f"""\

The supervisor itself measures how long a condition lasts:

| condition | holds when |
|---|---|
| {CONDITION_TEXTS[supervisor.STILL_READY.bit_length() - 1]} | all entry checks have held within the last {supervisor.READY_S:g} s |
| {CONDITION_TEXTS[supervisor.SETTLED.bit_length() - 1]} | the mode has lasted {supervisor.MINIMUM_S:g} s |
| {CONDITION_TEXTS[supervisor.LONG_GAP.bit_length() - 1]} | *holding* has lasted {supervisor.LONG_GAP_S:g} s |
| {CONDITION_TEXTS[supervisor.TIME_UP.bit_length() - 1]} | *holding* has lasted `AGE_POS_MAX`, or *recovering* `REC_TIME` |
| {CONDITION_TEXTS[supervisor.TROUBLED.bit_length() - 1]} | the aircraft stalls, or is too low, for {supervisor.TROUBLE_S:g} s |
| {CONDITION_TEXTS[supervisor.CLEARED.bit_length() - 1]} | it does neither, by a margin, for {supervisor.CLEAR_S:g} s |
"""  # noqa: E501


def modes() -> None:
    """Print docs/modes.md: the modes and every change from one to another."""
    typer.echo(page(), nl=False)


def page() -> str:
    """The page docs/modes.md."""
    lines = [
        f"| {number} | {name} | {'yes' if supervisor.is_flying(number) else 'no'} |"
        for number, name in enumerate(MODE_NAMES)
    ]
    text = _HEAD + "\n".join(lines) + "\n" + _TIMERS
    for mode, name in enumerate(MODE_NAMES):
        rows = [row for row in TRANSITIONS if row.source == mode]
        text += f"\n## From {name}\n\n"
        if not rows:
            text += "Only a restart of the module leaves this mode.\n"
            continue
        text += "| when | unless | to | action | reason |\n|---|---|---|---|---|\n"
        for row in rows:
            text += (
                f"| {_conditions(row.all_of)} | {_conditions(row.none_of)} | {MODE_NAMES[row.to]}"
                f" | {ACTION_TEXTS[row.action]} | {REASON_TEXTS[row.reason]} |\n"
            )
    return (
        text
        + _words("Faults of the streams", "`Health.faults`", FAULT_TEXTS)
        + _words("Limits of the envelope", "`Output.cut`", CUT_TEXTS)
    )


def _conditions(bits: int) -> str:
    return ", ".join(text for i, text in enumerate(CONDITION_TEXTS) if bits >> i & 1)


def _words(title: str, name: str, texts: tuple[str, ...]) -> str:
    rows = "".join(f"| {1 << i} | {text} |\n" for i, text in enumerate(texts))
    return f"\n## {title}\n\nThe bits of {name}, in the flight log:\n\n| bit | |\n|---|---|\n{rows}"
