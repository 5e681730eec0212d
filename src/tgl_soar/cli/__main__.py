"""The command line: `tgl-soar COMMAND`.

`run` is the flying process: it is handed on before anything else is imported, so that the
command line's own libraries never load on board.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import Final

from tgl_soar.onboard import standard_streams

INTERPRETED: Final = "--interpreted"


def main() -> None:
    """Entry point of `tgl-soar`.

    Where nobody reads on (`tgl-soar … | head`), it ends without a word about it.
    """
    standard_streams.reserve()
    try:
        try:
            _command()
        finally:
            if sys.stdout is not None:  # closed by whoever started it
                sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's own flush
        raise SystemExit(128 + signal.SIGPIPE) from None


def _command() -> None:
    if sys.argv[1:2] == ["run"]:
        from tgl_soar.onboard import native

        if INTERPRETED not in sys.argv:
            native.use()
        from tgl_soar.onboard.process import main as run

        raise SystemExit(run(sys.argv[2:]))
    from tgl_soar.cli.commands import asked

    asked(sys.argv[1:])()


if __name__ == "__main__":
    main()
