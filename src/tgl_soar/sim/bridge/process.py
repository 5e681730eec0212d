"""The bridge as a program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from tgl_soar.config.files import ConfigError
from tgl_soar.sim.bridge.bridge import Bridge
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.bridge.lockstep import BridgeError
from tgl_soar.sim.bridge.options import BridgeOptions
from tgl_soar.sim.faults import catalogue_text
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.ports import PortError
from tgl_soar.sim.truth_log import TruthLogError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bridge; the exit code: 0 well, 2 wrong set-up or no room for a log, 3 nobody came."""
    words = list(sys.argv[1:] if argv is None else argv)
    if ["--fault", "list"] in [words[i : i + 2] for i in range(len(words))]:
        _list_faults()
        return 0
    options = parsed(words)
    try:
        bridge = Bridge(options)
    except (ConfigError, PortError, FirmwareError, ValueError) as error:
        print(f"sitl_bridge: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"sitl_bridge: {_file_of(error, options)}: {error.strerror}", file=sys.stderr)
        return 2
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, bridge.stop)
    code = 0
    try:
        bridge.run()
    except (BridgeError, FirmwareError) as error:
        print(f"sitl_bridge: {error}", file=sys.stderr)
        code = 3
    except TruthLogError as error:
        print(f"sitl_bridge: --log {error}", file=sys.stderr)
        code = 2
    finally:
        code = _close(bridge) or code
    print(bridge.summary(), flush=True)
    return code


def _file_of(error: OSError, options: BridgeOptions) -> str:
    """The file or folder that an error is of, with the option that names it."""
    if not error.filename:  # it was open: the log's first line was written
        return f"--log {options.simulation.log}"
    named = {"--log": options.simulation.log, "--record": options.simulation.record}
    if options.firmware is not None:
        named["--firmware-folder"] = options.firmware.folder
    at = Path(os.fsdecode(error.filename))
    for option, path in named.items():
        # A folder above it may be what is missing, or a file within.
        if path is not None and (at == path or at in path.parents or path in at.parents):
            return f"{option} {path}"
    return str(at)


def _close(bridge: Bridge) -> int:
    """End it; the exit code."""
    try:
        bridge.close()
    except TruthLogError as error:
        print(f"sitl_bridge: --log {error}", file=sys.stderr)
        return 2
    return 0


def _list_faults() -> None:
    """Print the catalogue, to its end or as far as it is read: `head` goes when it has enough."""
    try:
        print(catalogue_text(), flush=True)
    except BrokenPipeError:
        # What is still in the buffer would fail once more when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
