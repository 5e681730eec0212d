"""The simulator bridge as a program: `python tools/sitl_bridge.py --help`."""

import sys

from tgl_soar.sim.bridge.process import main

if __name__ == "__main__":
    sys.exit(main())
