"""What commands print of the shipped files and of a few numbers of our own, word by word.

    python tests/cli/printed.py        records it again

`printed.json` holds what they printed the last time: people read it, and scripts cut it up.
Whoever changes it on purpose records it again.  Numbers may differ by rounding.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Sequence
from math import cos, radians, sin
from pathlib import Path
from typing import Final
from unittest.mock import patch

from typer.testing import CliRunner

from tgl_soar.cli import console as consoles
from tgl_soar.cli.app import app

KEPT: Final = Path(__file__).with_name("printed.json")
NUMBER: Final = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
SAME: Final = 1e-3  # of a number, beside one in the last digit that is printed

# Places of a hall in the site's NED, and how far each is measured beside where it is [m].
CORNERS: Final = ((0.0, 0.0, 0.0), (2.0, 0.0, -0.5), (2.0, 1.5, -1.0), (0.5, 1.0, -2.0))
OFF_M: Final = ((0.001, 0.0), (-0.002, 0.001), (0.0, -0.001), (0.001, 0.002))
COMMANDS: Final = {
    "a line, and one beside all air": "zeuc --line 0.2,1.2,15 --line 9,9,15 --out {}/map.svg",
    "a polar": "polar show",
    "glides": "polar fit {}/glides.csv",
    "glides with a brake": "polar fit {}/braked.csv --compare eclipson_c_spoilers",
    "a hall": "align {}/hall.csv",
    "a hall of a site": "align {}/hall.csv --site tunnel_mocap --up z --tolerance 0.5",
    "a site's contour": "site contour",
    "a hill's contour": "site contour --site hill --bounds -12,0,8,16",
    "a fitted wind": "site misfit --site tunnel_polynomial",
    "a wind record": "site wind {}/wind.csv --hours 0.2 --mean 7 --lulls 12 --veer 30 --seed 2",
    "margins": "margins --speed 9 --lean 20 --delay 12 --turbulence 0.02 --floor 0.1",
    "faults": "sitl --fault list",
    "experiments": "experiment list",
    "values": "params show --airframe eclipson_c --site hill --state {}/state",
    "values that differ": "params diff default files --airframe eclipson_c --site tunnel"
    " --state {}/state",
}


def printed(command: str, folder: Path) -> str:
    """All that a command prints, and its exit code; of other folders only the name."""
    words = [word.replace("{}", str(folder)) for word in command.split()]
    with (
        patch.multiple(consoles.console, _width=160, _height=100),
        patch.multiple(consoles.errors, _width=160, _height=100),
    ):
        ran = CliRunner().invoke(app, words)
    lines = [line.rstrip() for line in ran.output.splitlines()]
    text = "\n".join([*lines, f"exit code {ran.exit_code}"])
    return re.sub(r"(?:/[\w.-]+)+/", "…/", text)


def files(folder: Path) -> Path:
    """What the commands read."""
    speeds = [7.0 + 0.4 * i for i in range(11)]
    glides = [(u, 1.5 + 0.1 * (u - 8.2) ** 2 + 0.02 * (u - 8.2) ** 3) for u in speeds]
    off = [0.01 * (-1) ** i for i in range(len(glides))]
    measured = [(u, s + e) for (u, s), e in zip(glides, off, strict=True)]
    table(folder / "glides.csv", "speed_mps,sink_mps", measured)
    braked = [(u, s + 0.001 * b * u**3, b) for b in (0.0, 1.0) for u, s in measured]
    table(folder / "braked.csv", "speed_mps,sink_mps,brake", braked)
    table(folder / "hall.csv", "hall_x,hall_y,hall_z,north,east,down", hall())
    return folder


def hall() -> list[tuple[float, ...]]:
    """Points in a hall whose z axis points up, turned by 40 degrees and moved."""
    c, s = cos(radians(40.0)), sin(radians(40.0))
    rows: list[tuple[float, ...]] = []
    for (north, east, down), (x_off, z_off) in zip(CORNERS, OFF_M, strict=True):
        n, e = north - 1.0, east + 0.5
        rows.append((c * n + s * e + x_off, s * n - c * e, 0.2 - down + z_off, north, east, down))
    return rows


def table(path: Path, header: str, rows: Sequence[tuple[float, ...]]) -> None:
    """A CSV file."""
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([header, *lines, ""]), encoding="utf-8")


def differences(before: str, now: str) -> list[str]:
    """Lines that say something else, numbers apart that only rounding tells apart."""
    one, other = before.splitlines(), now.splitlines()
    if len(one) != len(other):
        return [f"{len(one)} lines -> {len(other)} lines", *other]
    return [f"{a!r} -> {b!r}" for a, b in zip(one, other, strict=True) if not _alike(a, b)]


def _alike(a: str, b: str) -> bool:
    if NUMBER.sub("#", " ".join(a.split())) != NUMBER.sub("#", " ".join(b.split())):
        return False
    return all(_near(*pair) for pair in zip(NUMBER.findall(a), NUMBER.findall(b), strict=True))


def _near(a: str, b: str) -> bool:
    if a == b:
        return True
    digits = len(a.partition("e")[0].partition(".")[2])
    if not digits or "e" in a:
        return abs(float(a) - float(b)) <= SAME * abs(float(a))
    return abs(float(a) - float(b)) <= 1.001 * 10.0**-digits + SAME * abs(float(a))


def now() -> dict[str, str]:
    """Of all commands."""
    with tempfile.TemporaryDirectory() as place:
        folder = files(Path(place))
        return {name: printed(command, folder) for name, command in COMMANDS.items()}


if __name__ == "__main__":
    KEPT.write_text(json.dumps(now(), indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{KEPT}: {', '.join(COMMANDS)}")
