"""What each field of the log means, and the page docs/logs.md.  On the ground only.

A field that a named tuple declares is explained by the comment beside it, there where it is
declared; one without a comment stands in `topics.MEANINGS`, or its name, which has a unit,
says it all.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from functools import cache
from typing import Final, get_type_hints

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.onboard.flightlog import allowance
from tgl_soar.onboard.flightlog.topics import (
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

This page is for everybody who reads a flight: which files a flight leaves, the commands that read,
export and replay them, and every field in them. To look at a flight, begin with
`tgl-soar report LOG`, which makes a page of figures.

`tgl-soar run` writes two files for each flight, into the folder of `--log` (default: `logs` in the
folder of `--state`; `--log none`: no log):

    2026-11-21/14_03_55_flight007.ulg     a ULog: the inputs and decisions of every tick
    2026-11-21/14_03_55_flight007.tlog    the MAVLink frames received and sent on all links

Date and time are UTC; where the computer does not know the time the folder is `undated`. The number
of the flight goes on from day to day.

- **Parts.** A long flight is split into parts (`_part2`, …); each `.ulg` can be read and replayed
  by itself.
- **Limits.** When the logs in the folder exceed `--log-max` megabytes, the oldest are deleted. When
  the disk is full, older flights are deleted as far as the next part needs it, but neither the last
  flight nor the current one: the log ends instead. The first minute of the current flight is always
  kept, even beyond `--log-max`. Deletions are reported to the operator.
- **Failures.** A thread writes, so a slow disk delays no tick; what it cannot take is dropped and
  marked. A full or read-only disk is reported once, and the flight goes on. The files are synced
  every second: a loss of power costs no more than that.
- **Keys.** A frame that contains a signing key is not logged.

The wire is logged up to a rate for each kind of frame, so that nobody can push out older flights by
sending many frames. Ten seconds' worth may come at once; what exceeds it is counted and left out,
and reported to the operator, in the ULog and on the console:

| frames | kB a second | |
|---|---|---|
{allowances}

## Commands

| command | what it does |
|---|---|
| `tgl-soar report LOG` | a page of figures, tables and health |
| `tgl-soar log info LOG` | what a log holds, and what of it is lost |
| `tgl-soar log margins LOG` | the open loop and its margins, from multisines (`EXC_START`) |
| `tgl-soar log export LOG --to csv` | a table for each topic; also `netcdf`, `mcap` |
| `tgl-soar replay LOG` | runs the logged inputs through the laws again, bit for bit |
| `tgl-soar replay LOG --param RHO_P_IMU=0.5` | what another gain would have commanded |
| `ulog_info LOG`, PlotJuggler | any reader of ULogs |
| `mavlogdump.py LOG.tlog` | any reader of MAVLink telemetry logs |

In place of a log `report`, `replay`, `identify`, `polar fit` and `log` take a folder, too, as in
`tgl-soar report out/sitl/logs`: it stands for the newest log in it.

A log that is empty, cut off, damaged, of another version or with a clock that jumped is used as far
as it can be read; what is lost is reported. The exit code is 1 if something was lost and 2 if
nothing could be done; a fit by `polar` or `identify` counts as done if enough is left for it.

This is layout 2 of the log (`ver_log` in its information messages). Logs of layout 1 are read, too:
their columns that had other names (`afresh`, `imu_share`, `throttle_share`, `wind_belief_…`,
`motion_turning_…`, `passage_…`) are found under those of today.

The tests open every kind of log with pyulog and `mavlogdump.py`. PlotJuggler is a desktop program
that no test can install; by hand its ULog reader (`ulog_parser.cpp` of April 2026, compiled by
itself) was found to read the same rows and numbers as pyulog, and a log that is cut off up to the
cut.

## Replay with another gain

    make run ARGS="--turbulence 0.03"
    tgl-soar replay out/sitl/logs
    tgl-soar replay out/sitl/logs --param RHO_P_IMU=0.5 --figure out/replay.png

The first replay ends with *every command is the same, bit for bit*. The second shows what about
half of the shipped gain (0.95) would have commanded while accelerometers are in use:

    the surfaces obeyed the logged commands, and are not held against these
    ┏━━━━━━━━━━━━━━━━━━━━━━┳━━━━━━━━━┳━━━━━━━━━━┳━━━━━━━━━━━━┳━━━━━━━━━┳━━━━━━━━━━┓
    ┃ rms of               ┃ logged  ┃ replayed ┃ difference ┃ largest ┃ at       ┃
    ┡━━━━━━━━━━━━━━━━━━━━━━╇━━━━━━━━━╇━━━━━━━━━━╇━━━━━━━━━━━━╇━━━━━━━━━╇━━━━━━━━━━┩
    │ setpoints_pitch_rad  │ 0.02938 │ 0.02655  │ 0.006312   │ 0.02786 │ 21.930 s │
    │ command_elevator     │ 0.06615 │ 0.1369   │ 0.1418     │ 0.3462  │ 40.570 s │
    │ command_aileron      │ 0.0645  │ 0.0645   │ 0          │ 0       │ –        │
    │ command_rudder       │ 0.03464 │ 0.03464  │ 0          │ 0       │ –        │
    └──────────────────────┴─────────┴──────────┴────────────┴─────────┴──────────┘
    the inputs are the logged ones: the aircraft does not answer to the change

![Logged and replayed commands](images/replay.png)

*The pitch setpoint shrinks with the gain. The elevator grows: the integral of the pitch loop keeps
adding up an error that a real aircraft would have answered.*

**Many logs.** `tgl-soar replay LOG... --out out/replay` keeps a row for each log, and a manifest of
which logs were replayed by which source ([campaigns](campaigns.md#what-is-left)); `--resume` goes
on where it was stopped.

**Speed.** Each replay says how many times faster than the flight it was; in plain Python it is
several times on each processor of a desk computer. `tgl-soar replay --compile` compiles the laws
with numba, once for each version; from then on logs of more than 100 s are replayed several hundred
times faster than they were flown. Where compiled laws differ from the log in one bit, the
interpreted ones replay it again, and their verdict counts. The figures behind this, and of which
computer they are, are in [performance.md](performance.md).

## In pandas

    tgl-soar log export out/sitl/logs --to csv --out out/csv

writes a table for each topic that the flight has, with the columns listed below. Topics have rates
of their own: a row of `tick` is a tick (200 a second), a row of a measurement is a sample that
arrived (50 positions, 20 airspeeds a second). Join two by time, each row with the last one before:

```python
import pandas as pd

tick = pd.read_csv("out/csv/tick.csv")
position = pd.read_csv("out/csv/position.csv")
both = pd.merge_asof(tick, position, on="timestamp", suffixes=("", "_fix"))
print(both[["time_s", "vehicle_z_m", "time_s_fix", "down_m"]].tail())
```

`timestamp` is in microseconds, of the tick in which a row was logged; `time_s` of a measurement is
when it was taken. Three tables are no measurements:

- `parameters.csv`: every parameter by its name, as it stood at the start (`after_tick` 0), then
  each change, and after which tick it was made. Read this one.
- `parameter.csv`: the same changes as the topic [`parameter`](#parameter) has them, by number.
- `words.csv`: what the operator was told, and when.

The simulation writes what really happened into `out/sitl/truth.csv`, 50 rows a second. There
`time_s` is on the autopilot's clock, which the module's `tick` has, too, unless the flight ran in
real time or with a real firmware:

```python
truth = pd.read_csv("out/sitl/truth.csv")
error = pd.merge_asof(tick, truth, on="time_s", direction="nearest")
print((error["vehicle_x_m"] - error["x_m"]).abs().max())
```

| columns of `truth.csv` | meaning |
|---|---|
| `time_s` | the autopilot's clock |
| `x_m`, `y_m`, `z_m` | place, soaring frame |
| `velocity_x_mps`, `velocity_y_mps`, `climb_mps` | over the ground |
| `roll_rad`, `pitch_rad`, `heading_rad` | heading: from straight upwind |
| `wind_x_mps`, `wind_y_mps`, `updraft_mps` | of the air at the aircraft, turbulence included |
| `airspeed_mps`, `alpha_rad` | through that air |
| `elevator`, `aileron`, `rudder`, `brake`, `throttle` | where they stand, −1 … 1 or 0 … 1 |
| `mode` | the autopilot's flight mode by number, not the module's |
| `flying` | 0 before the release, and once it lies on the ground |
| `overridden` | 1: the autopilot obeys the module's commands of the surfaces |

## Topics and fields

Beside the topics below, the ULog's information messages hold version, files and links, and
(`airframe`, `site`) the text of the configuration files. The parameters are logged at the start and
at each change, and texts for the operator as logged messages.

Frames: *NED* and *FRD* are the autopilot's, *soaring* has x downstream, y to the right of an
aircraft facing upwind and z up ([theory.md](theory.md#frames-and-signs)).
"""

_ALLOWANCES: Final = (
    ("sent by the module", allowance.OURS, ""),
    (
        "received on the autopilot's link",
        allowance.AUTOPILOT,
        "a serial line at 921600 baud carries 92",
    ),
    ("received on all other links", allowance.STATIONS, ""),
    (
        "refused",
        allowance.REFUSED,
        "a sample of frames that are signed wrongly or not at all, replayed, from a system that is"
        " neither the vehicle nor among `autopilot.operators` and `position.vision_from`, or of an"
        " unknown message number; together at most a hundredth of `--log-max`",
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
    """What a field means, in words; "" where nothing declares it."""
    meaning = field.meaning or MEANINGS.get(field.owner) or _comments().get(field.owner)
    if meaning:
        return meaning
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
