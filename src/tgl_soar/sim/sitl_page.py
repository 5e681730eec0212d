"""A flight in real time with the operator's page beside it: `tgl-soar sitl --page`.

Nobody engages and nobody moves the line but whoever opens the page: bridge and module fly until
somebody ends them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, NoReturn

from tgl_soar.config.files import load_flight
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import (
    SitlProcesses,
    bridge_command,
    free_address,
    module_command,
    page_command,
    prepared,
)

ADDRESS: Final = "the operator's page: "
LOOK_S: Final = 0.2


def host(options: SitlOptions, port: int, opened: Callable[[str], None]) -> NoReturn:
    """Fly until interrupted; `opened` is called with the page's address once it is served.

    Errors: `SitlError`, `tgl_soar.config.files.ConfigError`.
    """
    _, site, _ = load_flight(options.airframe, options.site)
    if site.air is None:
        raise SitlError(f"{options.site}: no [air] table, so there is no wind to fly in")
    truth_file = prepared(options)
    station, mocap = free_address(), free_address() if options.mocap else ""
    processes = SitlProcesses(options.out)
    try:
        processes.start(
            "bridge", bridge_command(options, truth_file, station, options.companion, mocap)
        )
        processes.start("module", module_command(options, options.companion, mocap))
        processes.start("page", page_command(options, station, port))
        shown = False
        while True:
            processes.check()
            if not shown and (lines := processes.lines_with("page", ADDRESS)):
                opened(lines[-1].partition(ADDRESS)[2])
                shown = True
            time.sleep(LOOK_S)
    finally:
        processes.stop()
