"""What our parameters mean, read from the flying module by programs that are not ours."""

from __future__ import annotations

import importlib.util
import json
import lzma
import subprocess
import sys
from pathlib import Path

import pytest
from peers_scene import Scene

from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.link.component_metadata import PARAMETER_FILE, metadata_files

CLIENT = Path(__file__).parent / "mavsdk_metadata.py"


@pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None
    or importlib.util.find_spec("mavsdk.plugins") is None,
    reason="MAVSDK 4 is not installed",
)
def test_mavsdk_reads_the_metadata(tmp_path: Path) -> None:
    """On a link of the module's own: a Pixhawk that does not know COMPONENT_METADATA, as ArduPilot
    and the bridge, does not pass it on."""
    scene = Scene(tmp_path, own_link=True)
    try:
        scene.pilot.engage()
        read = subprocess.run(
            [sys.executable, str(CLIENT), str(scene.module_port)],
            capture_output=True,
            text=True,
            timeout=120.0,
        )
        assert read.returncode == 0, read.stdout[-1000:] + read.stderr[-3000:]
        described = json.loads(read.stdout)
        assert [row["name"] for row in described["parameters"]] == [p.name for p in PARAMETERS]
        assert described == json.loads(lzma.decompress(metadata_files()[PARAMETER_FILE]))
        scene.assert_flies()
    finally:
        scene.close()
