"""The page docs/parameters.md, from the declaration of the parameters."""

from __future__ import annotations

from textwrap import fill
from typing import Final

from tgl_soar.config.parameter_groups import GROUPS, group_of
from tgl_soar.config.parameters import PARAMETERS, Parameter

_HEAD: Final = """\
# Parameters

<!-- Made by `tgl-soar params --markdown > docs/parameters.md`; change the declaration instead. -->

This page is the reference for operators and authors of airframe and site files: every
parameter with its unit, range, default and meaning, then how to move the line, and what is stored.

A parameter is set by `PARAM_SET` to component 191 (QGroundControl's parameter page, `param set` in
MAVProxy), in `[parameters]` of an airframe or site file, or by `tgl-soar params import`. A later
source overrides an earlier one:

    default  <  airframe file  <  site file  <  stored: changed over the air, or imported

All are REAL32. A set is answered with the value that holds after it. A value out of range, or one
that contradicts the others, is refused: the answer is the old value, and a `STATUSTEXT` says why.
An accepted value acts on the next tick. *In flight* means: may it change while the module is
engaged?

{only_over_the_air}
"""

_TAIL: Final = """\
## Moving the line

Set `TGL_X`, `TGL_Z` or `TGL_LEAN`: the line slides to its new place at `TGL_SLEW` and turns at
`TGL_ROT_SLEW` about the point nearest the aircraft. So the aircraft never meets a step.

**Presets.** `TGL_PRESET` = 1, 2, … puts the line on the first, second, … line of `[lines]` in the
site file. A line without a `lean_deg` of its own has the `TGL_LEAN` of the files, even if it was
changed since. Position and lean change together, and all changed values are sent. When
`TGL_X`, `TGL_Z` or `TGL_LEAN` is then changed, `TGL_PRESET` goes back to 0; setting it to 0
leaves the line where it is. A number that the site does not have is refused with the list of
its lines. In a site file, `TGL_PRESET` in place of `TGL_X` and `TGL_Z` begins on that line.

**Several values as one move.**

| set | then |
|---|---|
| `TGL_STAGE` = 1 | From now on new values of `TGL_X`, `TGL_Z`, `TGL_LEAN` and `TGL_SLEW` are held \
back. Each is checked against its range; the answer, and every read, shows the held value. The \
line flown does not change. |
| `TGL_STAGE` = 0 | All held values are checked together and applied between two ticks. If one \
is refused, none is applied: all are discarded, `TGL_STAGE` becomes 2, and the values in force are \
sent with the reason. |
| `TGL_STAGE` = 2 | The held values are discarded, and the values in force are sent. |

After 2, begin with 1: 0 is refused, so that a repeated 0 does not look like a successful move.
While values are held `TGL_PRESET` is refused; all other parameters act at once. Engaging flies the
line in force, not the held one. There is one set of held values for all ground stations. A restart
discards it, and so do 60 s without another value of it, with a `STATUSTEXT`. A station whose link
has dropped leaves no half move behind, and cannot make one when it comes back: until somebody sets
`TGL_STAGE` to 1 or 2, new values of these four are refused.

**A line by which no aircraft can be held** (outside the fence, too near to the ground, not crossing
the site's contour, too far away) is refused with the reason:
[operator.md](operator.md#what-is-refused-of-a-line).

## What is stored

A value that is changed over the air and differs from the airframe and site files is stored within a
second, and read back at the next start. The folder is `$XDG_STATE_HOME/tgl_soar`, or else
`~/.local/state/tgl_soar`; `tgl-soar run --state FOLDER` names another one, `--state none` stores
nothing. For everything that was not changed over the air, a new airframe or site file still counts.

Each vehicle has a file of its own. It is called
`<airframe file>-<site file>-<system id>-<component id>-<digits>.params`, for example
`eclipson_c-hill-1-191-4397b15e.params`; the digits follow from `name` in `[airframe]` and `[site]`
and from the ids, all of which stand in the file's first lines. What was stored for a vehicle of
another name or id is not used, moved or written over: whoever changes one of these starts without
stored values, and takes them along by `tgl-soar params export` before and `import` after. What
version 0.1.0 stored as `<airframe file>-<site file>.params` is read at the first start, and left
there.

The file has a checksum and a copy of its previous version (`.previous`). A thread writes a new file
and renames it over the old one, so that one of them stays whole after a `kill -9` or a loss of
power. A damaged file is set aside (`.damaged`), and the previous copy is used, or, without one, the
values of the files; console and ground stations show it. If the file cannot be written, that is
reported once, the flight goes on, and writing is tried again. A stored value that is unknown, or no
longer in range, is skipped and named.

| command | what it does |
|---|---|
| `tgl-soar params` | lists this page |
| `tgl-soar params show` | values at the next start, and where each comes from |
| `tgl-soar params diff files state` | what was changed over the air; also `default` or any file |
| `tgl-soar params export my.params` | writes a file for QGroundControl; `my.parm` for MAVProxy |
| `tgl-soar params import my.parm` | stores a file of either; all of it or nothing |
| `tgl-soar params reset` | deletes what is stored |

The last five need `--airframe` and `--site`, as `tgl-soar run` does, and accept `--state`. Rows of
other components and unknown names are skipped and listed; each bad line is named. A file that a
ground station saved while the module flew holds `OP_ENGAGE` as 2: `import` skips it, and a module
that is not engaged refuses it.
"""


def page() -> str:
    """The whole page."""
    *names, last = [f"`{p.name}`" for p in PARAMETERS if not p.in_files]
    text = (
        f"{', '.join(names)} and {last} can only be set over the air: no file engages the module."
    )
    parts = [_HEAD.format(only_over_the_air=fill(text, 100, break_on_hyphens=False))]
    for group in GROUPS:
        rows = [_row(p) for p in PARAMETERS if group_of(p.name) is group]
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
