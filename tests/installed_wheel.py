"""The project as a user without a clone has it: a wheel, installed, and nothing of the source."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Installed(NamedTuple):
    """A virtual environment with the wheel in it."""

    wheel: Path
    bin: Path

    def run(self, *words: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
        """One of its programs in a folder."""
        program, *rest = map(str, words)
        without = ("PYTHONPATH", "TGL_SOAR_TEST_NATIVE")
        return subprocess.run(
            [str(self.bin / program), *rest],
            cwd=folder,
            env={key: value for key, value in os.environ.items() if key not in without},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
        )


def build(folder: Path) -> Path:
    """The wheel, by the project's own build backend."""
    code = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    built = subprocess.run(
        [sys.executable, "-c", code, str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return folder / built.stdout.split()[-1]


def install(folder: Path) -> Installed:
    """Build and install it without a network: what it depends on is lent by this environment."""
    wheel = build(folder)
    home = folder / "venv"
    venv.create(home, symlinks=True)
    installed = Installed(wheel, home / "bin")
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "--python", str(installed.bin / "python")),
            *("install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"),
            str(wheel),
        ],
        check=True,
        timeout=120,
    )
    (site,) = home.glob("lib/python*/site-packages")
    # A path alone: what is installed there as editable, such as this project, is not followed.
    lent = [path for path in sys.path if Path(path).name == "site-packages"]
    (site / "lent.pth").write_text("\n".join(lent) + "\n")
    return installed
