"""The pictures of the README, made again: `make pictures`.

Each is of one flight of `tgl-soar sitl`, which repeats exactly.  Beside the pictures the paths of
these flights are kept, and each picture carries the digest of its path: so a test flies them again
and says when a picture is of another flight than what is flown today, whatever draws it.

A flight through a real firmware is flown where its program is named: TGL_SOAR_ARDUPLANE.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

from PIL import Image, PngImagePlugin

IMAGES: Final = Path(__file__).parents[1] / "docs" / "images"
PATHS: Final = IMAGES / "paths.json"
KEY: Final = "path"  # under which a PNG carries the digest
ROW_S: Final = 0.1  # between the points of a path that are kept

Point = tuple[float, float]


class Picture(NamedTuple):
    """A figure that a flight leaves."""

    name: str
    options: tuple[str, ...]  # of `tgl-soar sitl`
    figure: str  # in its folder
    firmware: str = ""  # the variable that names the program it needs


PICTURES: Final = (
    Picture("flight.png", (), "flight.png"),
    Picture(
        "report.png", ("--turbulence", "0.03", "--report"), "report-figures/longitudinal.png"
    ),
    Picture(
        "flight-arduplane.png",
        ("--autopilot", "ardupilot", "--turbulence", "0.01"),
        "flight.png",
        "TGL_SOAR_ARDUPLANE",
    ),
)  # fmt: skip


def fly(picture: Picture, out: Path) -> None:
    """Fly it.  Errors: `subprocess.CalledProcessError`."""
    command = [sys.executable, "-m", "tgl_soar.cli", "sitl", "--out", str(out)]
    subprocess.run([*command, *picture.options], check=True)


def path_of(truth: Path) -> list[Point]:
    """x and z [m] of a flight in the soaring frame, to the millimetre."""
    with truth.open(newline="") as file:
        rows = [
            (float(r["time_s"]), float(r["x_m"]), float(r["z_m"])) for r in csv.DictReader(file)
        ]
    kept, due_s = [], 0.0
    for time_s, x_m, z_m in rows:
        if time_s >= due_s:
            kept.append((round(x_m, 3), round(z_m, 3)))
            due_s += ROW_S
    return kept


def digest(path: list[Point]) -> str:
    """The same for the same path."""
    return hashlib.sha256(json.dumps(path).encode()).hexdigest()


def kept_paths() -> dict[str, list[Point]]:
    """Of every picture, by its name."""
    read = json.loads(PATHS.read_text(encoding="utf-8"))
    return {name: [(x, z) for x, z in path] for name, path in read.items()}


def digest_in(picture: Path) -> str:
    """Of the path that a picture was drawn from; empty if it does not say."""
    with Image.open(picture) as image:
        return str(image.info.get(KEY, ""))


def main() -> int:
    paths = kept_paths() if PATHS.exists() else {}
    for picture in PICTURES:
        if picture.firmware and not os.environ.get(picture.firmware):
            print(f"{picture.name}: stays as it is: {picture.firmware} names no program")
            continue
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder)
            fly(picture, out)
            path = path_of(out / "truth.csv")
            metadata = PngImagePlugin.PngInfo()
            metadata.add_text(KEY, digest(path))
            with Image.open(out / picture.figure) as image:
                image.save(IMAGES / picture.name, optimize=True, pnginfo=metadata)
        if not picture.firmware:
            paths[picture.name] = path
        print(f"{IMAGES / picture.name}")
    rows = ",\n".join(f"{json.dumps(name)}: {json.dumps(path)}" for name, path in paths.items())
    PATHS.write_text(f"{{\n{rows}\n}}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
