"""`python -m tgl_soar.sim.bridge`: the bridge as a program."""

import sys

from tgl_soar.sim.bridge.process import main

if __name__ == "__main__":
    sys.exit(main())
