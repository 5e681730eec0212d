"""Any log that is known here, opened by what is in it and not by what it is called."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tgl_soar.analysis.logs import dataflash
from tgl_soar.analysis.logs.dataflash import Dataflash, read_dataflash
from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.logs.module_log import read_module_log
from tgl_soar.analysis.logs.parts import joined, later_parts
from tgl_soar.analysis.logs.tlog import Tlog, read_tlog
from tgl_soar.analysis.logs.ulog_reader import LogError, bytes_of, log_from, read_log
from tgl_soar.link.frames import MARKER_V1, MARKER_V2

from .px4 import read_px4

ULOG: Final = b"ULog"
KNOWN: Final = (
    "the module's flight log and PX4's (ULog), ArduPilot's DataFlash log (.bin), and MAVLink"
    " telemetry logs (.tlog)"
)


def read_flight(path: str | Path) -> FlightData:
    """Read a log, with the parts that follow it.  What could not be read is reported in `lost`.

    Errors: `LogError` where nothing could be; ImportError naming the extra that is needed.
    """
    path = Path(path)
    return flight_from(bytes_of(path), path)


def flight_from(data: bytes, path: Path) -> FlightData:
    """The flight in a log's bytes, likewise.

    path: what it and its errors call it, and beside which its later parts stand.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # damage may have made them any numbers
        return _read(data, path)


def _read(data: bytes, path: Path) -> FlightData:
    if not data.strip(b"\0"):
        raise LogError(f"{path}: {'only zeros' if data else 'empty'}: there is no flight in it")
    if data.startswith(ULOG):
        log = log_from(data, path)
        if not log.is_ours:
            return read_px4(log)
        flights, lost = [read_module_log(log)], []
        for part in later_parts(path):
            try:
                flights.append(read_module_log(read_log(part)))
            except LogError as error:
                lost.append(str(error))
        flight = joined(flights)
        return replace(flight, lost=(*flight.lost, *lost))
    if data.startswith(dataflash.MAGIC):
        return read_dataflash(path.name, Dataflash(path, data))
    if len(data) > 8 and data[8] in (MARKER_V1, MARKER_V2):
        return read_tlog(path.name, Tlog(path, data))
    for what, magic in (("ULog", ULOG), ("DataFlash log", dataflash.MAGIC + b"\x80")):
        at = data.find(magic, 0, 65536)
        if at > 0:
            raise LogError(
                f"{path}: {at} bytes of something else stand before a {what}: cut them off"
            )
    raise LogError(f"{path}: no log that is known here; known are {KNOWN}")
