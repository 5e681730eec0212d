"""The bridge as a program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from tgl_soar.config.files import ConfigError
from tgl_soar.sim.bridge.bridge import Bridge
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.bridge.lockstep import BridgeError
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
        log = options.simulation.log
        print(f"sitl_bridge: --log {log}: {error.strerror}", file=sys.stderr)
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
