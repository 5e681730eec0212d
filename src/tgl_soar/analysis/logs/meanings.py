"""What each field of the log means, and the page docs/logs.md.  On the ground only.

A field that a named tuple declares is explained by the comment beside it, there where it is
declared; one without a comment stands in `declaration.MEANINGS`, or its name, which has a unit,
says it all.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from functools import cache
from typing import Final, get_type_hints

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.control.supervisor import MODE_NAMES, REASON_TEXTS
from tgl_soar.onboard.flightlog import allowance
from tgl_soar.onboard.flightlog.declaration import (
    MEANINGS,
    SUFFIXES,
    TOPICS,
    Field,
    Topic,
    frame_of,
    is_named_tuple,
    unit_of,
)
from tgl_soar.types import Inputs

_COMMENTED: Final = re.compile(r"\s+(\w+): [^#]+#\s*(.+)")

_TITLE: Final = """\
# Flight logs

<!-- Made by `tgl-soar log fields > docs/logs.md`; change the declaration instead. -->

`tgl-soar run` leaves two files of each flight in the folder of `--log` (`logs` in that of
`--state` where it is not given; `--log none`: nowhere):

    2026-11-21/14_03_55_flight007.ulg     a ULog: every tick, what it had and what it decided
    2026-11-21/14_03_55_flight007.tlog    the MAVLink frames that came or went on any link

Day and hour are UTC; where the computer does not know the time the folder is `undated`. Flights
are counted through. A long flight is cut into parts (`_part2`, …), of which each `.ulg` can be
read and replayed by itself. When all logs in the folder exceed `--log-max` megabytes, the oldest
are deleted. When the disk gets full, older flights are deleted too, and no more of them than the
next part needs, but never the last flight nor the one being flown: rather the log ends. Of the
flight being flown the first minute always stays, though that be more than `--log-max`. What was
deleted is told the operator. A thread writes: a slow disk holds up no tick, and what it cannot
take is dropped and marked. A full or read-only disk is told once, and the flight goes on. Every
second all is synced to the disk, so that a loss of power costs no more than that. A frame that
carries a signing key is not written down.

Whoever sends much does not decide how soon older flights go. Of each kind of frame so many bytes a
second are written down, with ten seconds' worth at once; what is more is counted and left out, of
which the operator, the ULog and the console are told:

| frames | kB a second | |
|---|---|---|
{allowances}

| command | what it does |
|---|---|
| `tgl-soar log info LOG` | what a log holds, and what of it is lost |
| `tgl-soar log margins LOG` | the open loop and its margins, from multisines (`EXC_START`) |
| `tgl-soar log export LOG --to csv` | a table for each topic; also `netcdf`, `mcap` |
| `tgl-soar replay LOG` | flies the logged inputs through the laws again, bit for bit |
| `tgl-soar replay LOG --param RHO_P_IMU=1.2` | what another gain would have commanded |
| `ulog_info LOG`, PlotJuggler | any reader of ULogs |
| `mavlogdump.py LOG.tlog` | any reader of MAVLink telemetry logs |

What cannot be read of a log, empty, cut off, damaged, of another version or with a clock that
jumped, is said, and the rest is used. The exit code is 1 where something was lost and 2 where
nothing could be done; a fit of `polar` or `identify` counts as done, if enough is left for it.

The tests open every kind of log with pyulog and `mavlogdump.py`. PlotJuggler, a desktop program, is
installed by neither `pip install plotjuggler` nor `apt install plotjuggler` (Debian 12), so no test
opens a log with it. Tried by hand instead: its ULog reader (`ulog_parser.cpp` of April 2026,
compiled by itself) finds every row of every topic of a flight with the numbers that pyulog finds,
the parameters and the texts, and reads a log that is cut off up to the cut.

## Another gain

    make run ARGS="--turbulence 0.03"
    tgl-soar replay out/sitl/logs/*/*.ulg
    tgl-soar replay out/sitl/logs/*/*.ulg --param RHO_P_IMU=1.2 --figure out/replay.png

The first replay ends with *every command is the same, bit for bit*. The second says what a gain of
1.2 in place of 1.8 would have commanded while accelerometers are heard:

    the surfaces obeyed the logged commands, and are not held against these
    ┏━━━━━━━━━━━━━━━━━━━━━━┳━━━━━━━━━┳━━━━━━━━━━┳━━━━━━━━━━━━┳━━━━━━━━━┳━━━━━━━━━━┓
    ┃ rms of               ┃ logged  ┃ replayed ┃ difference ┃ largest ┃ at       ┃
    ┡━━━━━━━━━━━━━━━━━━━━━━╇━━━━━━━━━╇━━━━━━━━━━╇━━━━━━━━━━━━╇━━━━━━━━━╇━━━━━━━━━━┩
    │ setpoints_pitch_rad  │ 0.03075 │ 0.0265   │ 0.006251   │ 0.02903 │ 21.610 s │
    │ command_elevator     │ 0.07478 │ 0.2497   │ 0.2639     │ 0.569   │ 55.710 s │
    │ command_aileron      │ 0.00618 │ 0.00618  │ 0          │ 0       │ –        │
    │ command_rudder       │ 0.02652 │ 0.02652  │ 0          │ 0       │ –        │
    └──────────────────────┴─────────┴──────────┴────────────┴─────────┴──────────┘
    the inputs are the logged ones: the aircraft does not answer to the change

![Logged and replayed commands](images/replay.png)

*The pitch setpoint shrinks as the gain does. The elevator runs away: the pitch loop's integral goes
on adding up an error that an aircraft would have answered.*

## How fast

A replay takes about as long as the laws in plain Python take: 30 to 50 times faster than the
flight on each processor. `tgl-soar replay --compile` compiles them once for each version, with
numba; from then on logs of more than 100 s are replayed over 1000 times faster than they were
flown. It is the same source. Where the compiled laws would differ from the log in one bit, the
plain ones fly it again, and only they say that it differs.

Writing, replay and report are timed by `make bench ARGS="--only log --only report"`; the newest
figures stand in [performance.md](performance.md).

## What is in it

The ULog's information messages tell version, files and links, `airframe` and `site` hold the text
of the configuration files, the parameters stand at the beginning and at each change, and the words
for the operator are logged messages.

Frames: *NED* and *FRD* are the autopilot's, *soaring* has x downstream, y to the right of an
aircraft facing upwind and z up (docs/theory.md). Angles without a frame are named in the text.
"""

_ALLOWANCES: Final = (
    ("of ours", allowance.OURS, ""),
    ("on the autopilot's link", allowance.AUTOPILOT, "a serial line at 921600 baud carries 92"),
    ("on all other links", allowance.STATIONS, ""),
    (
        "refused",
        allowance.REFUSED,
        "a sample: signed wrongly or not at all, replayed, of a system that is neither the"
        " vehicle nor among `autopilot.operators` and `position.vision_from`, or of a number that"
        " is not known; in all a hundredth of `--log-max`",
    ),
)


@cache
def _comments() -> dict[str, str]:
    """What stands beside the fields of all named tuples in the log, by "NamedTuple.field"."""
    found: dict[str, str] = {}
    for kind in _kinds(Inputs, Output, AutopilotState):
        for line in inspect.getsource(kind).splitlines():
            if match := _COMMENTED.fullmatch(line):
                found[f"{kind.__name__}.{match[1]}"] = match[2]
    return found


def _kinds(*kinds: type) -> Iterator[type]:
    for kind in kinds:
        yield kind
        yield from _kinds(*(k for k in get_type_hints(kind).values() if is_named_tuple(k)))


def meaning_of(field: Field) -> str:
    """What a field means, in words; "" where nobody has said it."""
    told = field.said or MEANINGS.get(field.owner) or _comments().get(field.owner)
    if told:
        return told
    name = field.owner.partition(".")[2]
    suffix = next((suffix for suffix, _ in SUFFIXES if name.endswith(suffix)), "")
    return name.removesuffix(suffix).replace("_", " ") if suffix else ""


def page() -> str:
    """docs/logs.md."""
    topics = (f"\n## {t.name}\n\n{t.meaning}\n\n{_table(t)}" for t in TOPICS.values())
    title = _TITLE.replace("{allowances}\n", "".join(map(_allowance_row, _ALLOWANCES)))
    modes = f"\n## Modes\n\n{_numbered(MODE_NAMES)}"
    reasons = f"\n## Reasons of a change of mode\n\n{_numbered(REASON_TEXTS)}"
    return "".join((title, *topics, modes, reasons))


def _allowance_row(row: tuple[str, int, str]) -> str:
    frames, bytes_per_s, words = row
    return f"| {frames} | {bytes_per_s / 1000:g} | {words} |\n"


def _table(topic: Topic) -> str:
    rows = ["| field | type | unit | frame | meaning |", "|---|---|---|---|---|"]
    rows += [
        f"| `{f.name}` | {f.kind} | {unit_of(f)} | {frame_of(f)} | {meaning_of(f)} |"
        for f in topic.fields
    ]
    return "\n".join(rows) + "\n"


def _numbered(words: tuple[str, ...]) -> str:
    rows = ["| number | meaning |", "|---|---|"]
    rows += [f"| {i} | {word or '–'} |" for i, word in enumerate(words)]
    return "\n".join(rows) + "\n"
