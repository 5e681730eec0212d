"""What one writes first: an answer to each attitude through `mavutil`.

`python -m benchmarks.mavutil_responder LINK PRIORITY`, for `latency`.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from pymavlink import mavutil


def main(link: str, priority: int) -> None:
    connection = mavutil.mavlink_connection(
        link, baud=921_600, source_system=255, source_component=191, dialect="ardupilotmega"
    )
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    connection.mav.heartbeat_send(18, 8, 0, 0, 4)
    while True:
        message = connection.recv_match(type="ATTITUDE_QUATERNION", blocking=True)
        pulse = 1500 + int(400.0 * message.q3)
        connection.mav.rc_channels_override_send(1, 1, *[pulse] * 4, *[65535] * 4, *[0] * 10)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
