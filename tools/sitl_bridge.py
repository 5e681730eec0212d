"""The simulator bridge as a program: `python tools/sitl_bridge.py --help`."""

import sys

from tgl_soar.cli.__main__ import STOPPED, begin_loading, loaded

if __name__ == "__main__":
    begin_loading()
    from tgl_soar.sim.bridge.process import main

    loaded()
    try:
        sys.exit(main())
    except KeyboardInterrupt:  # while it builds its world; then it ends in order
        print("error: stopped", file=sys.stderr)
        sys.exit(STOPPED)
