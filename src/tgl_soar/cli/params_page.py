"""The page docs/parameters.md, from the declaration of the parameters."""

from __future__ import annotations

from typing import Final

from tgl_soar.config.parameters import GROUPS, PARAMETERS, Parameter

_HEAD: Final = """\
# Parameters

<!-- Made by `tgl-soar params --markdown > docs/parameters.md`; change the declaration instead. -->

What an operator may change, by `PARAM_SET` to component 191 (QGroundControl's parameter page,
`param set` in MAVProxy), in `[parameters]` of an airframe or site file, or by `tgl-soar params
import`. Later ones count more:

    default  <  airframe file  <  site file  <  stored: changed over the air, or imported

All are REAL32. A set is answered with the value that stands after it: a value out of range, or
one that contradicts the others, is refused, the old one is answered, and a `STATUSTEXT` says
why. What is taken acts on the next tick. `OP_ENGAGE` and `TGL_STAGE` are set over the air alone:
no file engages the module.
"""

_TAIL: Final = """\
## Moving the line

Set `TGL_X`, `TGL_Z` or `TGL_LEAN`: the line slides to its new place at `TGL_SLEW` and turns at
`TGL_ROT_SLEW` about the point nearest the aircraft, so that a step of yours is none for the
aircraft.

**Presets.** `TGL_PRESET` = 1, 2, … puts the line where the first, second, … of `[lines]` in the
site file is. A line without a `lean_deg` of its own has the `TGL_LEAN` of the files, however it
was changed since. Position and lean change as one, and all changed values are sent. When
`TGL_X`, `TGL_Z` or `TGL_LEAN` is then changed, `TGL_PRESET` goes back to 0; setting it to 0
leaves the line where it is. A number that the site does not have is refused with the list of
its lines. In a site file, `TGL_PRESET` in place of `TGL_X` and `TGL_Z` begins on that line.

**Several values as one move.**

| set | then |
|---|---|
| `TGL_STAGE` = 1 | `TGL_X`, `TGL_Z`, `TGL_LEAN` and `TGL_SLEW` are held from here on. Each \
set is checked by its range and answered with the held value, and so is reading. The line that \
stands is flown. |
| `TGL_STAGE` = 0 | All that is held is checked together, and the line moves to all \
of it between two ticks. If anything is refused, nothing is moved: all held values are dropped, \
`TGL_STAGE` is answered as 2, the values that stand are sent, and the reason. |
| `TGL_STAGE` = 2 | What is held is dropped, and the values that stand are sent. |

After 2, begin with 1: 0 is refused, so that a repeated 0 is not mistaken for a move made. While a
move is held `TGL_PRESET` is refused; all other parameters act at once. Engaging flies the line
that stands. There is one held move for all ground stations. A restart drops it.

**A line that leads nowhere.** With a `[contour]` in the site file, made by `tgl-soar site
contour`, a line that does not cross it, or only where excess updraft grows up the line, is taken
with a warning: the aircraft would find no place to stay.

## What is stored

Whatever is changed over the air and differs from the airframe and site files is stored within a
second, and read back at the next start. The file is `<airframe file>-<site file>.params` in
`$XDG_STATE_HOME/tgl_soar`, or else in `~/.local/state/tgl_soar`; `tgl-soar run --state FOLDER`
names another folder, `--state none` stores nothing. A changed airframe or site file still acts
on what was not changed over the air.

The file has a checksum and a copy of the state before (`.previous`). It is written by a thread,
as a new file that takes the old one's place, so that a `kill -9` or a loss of power leaves one of
them whole. A damaged file is set aside (`.damaged`) and the previous copy is used, or, without
one, the values of the files; console and ground station are told. If the disk takes nothing, that
is told once, the flight goes on, and writing is tried again. A stored value that is unknown or
out of range by now is passed over by name.

| command | what it does |
|---|---|
| `tgl-soar params` | lists this page |
| `tgl-soar params show` | values at the next start, and where each comes from |
| `tgl-soar params diff files state` | what was changed over the air; also `default` or any file |
| `tgl-soar params export my.params` | for QGroundControl; `my.parm` for MAVProxy |
| `tgl-soar params import my.parm` | stores a file of either; all of it or nothing |
| `tgl-soar params reset` | forgets what is stored |

The last five need `--airframe` and `--site`, as `tgl-soar run`, and take `--state`. Rows of other
components and unknown names are passed over and told; each bad line is named. A file that a ground
station saved while the module flew holds `OP_ENGAGE` as 2: `import` passes it over, and a module
that is not engaged refuses it.
"""


def page() -> str:
    """The whole page."""
    parts = [_HEAD]
    for group in GROUPS:
        rows = [_row(p) for p in PARAMETERS if p.name.partition("_")[0] in group.prefixes]
        parts.append(
            "\n".join(
                [
                    f"## {group.title}",
                    "",
                    group.sentence,
                    "",
                    "| name | unit | range | default | in flight | meaning |",
                    "|---|---|---|---|---|---|",
                    *rows,
                    "",
                ]
            )
        )
    return "\n".join([*parts, _TAIL])


def _row(p: Parameter) -> str:
    limits = f"{p.minimum:g} … {p.maximum:g}" + (", whole" if p.integer else "")
    cells = (
        f"`{p.name}`", p.unit, limits, f"{p.default:g}", "yes" if p.in_flight else "no", p.meaning
    )  # fmt: skip
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
