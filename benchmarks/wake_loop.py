"""Our loop alone: how late it wakes.

`python -m benchmarks.wake_loop COUNT PERIOD_NS BEGIN_NS [native]`: lateness [ns] to stdout.
"""

from __future__ import annotations

import socket
import sys
import time
from array import array

from tgl_soar.onboard import native


def wake(count: int, period_ns: int, begin_ns: int) -> array[int]:
    """As the flying process waits for a tick where no sample comes."""
    from tgl_soar.onboard import pacing, realtime  # native code, where that was asked for

    late = array("q", [1]) * count
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        waiting, waiter = (silent.fileno(),), pacing.Waiter(time.monotonic)
        realtime.prepare()
        due_ns = begin_ns
        for i in range(count):
            due_s = due_ns * 1e-9
            while waiter.wait(waiting, due_s, due_s)[0] < due_s:
                pass
            late[i] = time.monotonic_ns() - due_ns
            due_ns += period_ns
    return late


if __name__ == "__main__":
    if "native" in sys.argv:
        native.use()
    sys.stdout.buffer.write(wake(*(int(text) for text in sys.argv[1:4])).tobytes())
