"""The place where a benchmark's aircraft hangs in the air, whatever is commanded.

What the module foresees of it is nonsense, and would end the flight within seconds.  So it is
computed and reported as in flight, and not acted upon.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tgl_soar.config.files import shipped

REPORTED: Final = {"FC_ACT": 1.0}


def site_to_hang_in(folder: Path) -> Path:
    """The shipped tunnel with that, as a site file in a folder."""
    text = shipped("sites/tunnel.toml").read_text(encoding="utf-8")
    settings = "".join(f"{name} = {value}\n" for name, value in REPORTED.items())
    before, table, after = text.partition("[parameters]\n")
    path = folder / "hanging.toml"
    path.write_text(f"{before}{table}{settings}{after}", encoding="utf-8")
    return path
