"""The command line: `tgl-soar COMMAND`.

`run` is the flying process: it is handed on before anything else is imported, so that the
command line's own libraries never load on board.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from typing import Final

from tgl_soar.onboard import standard_streams

INTERPRETED: Final = "--interpreted"
FULL: Final = (errno.ENOSPC, errno.EDQUOT)


def main() -> None:
    """Entry point of `tgl-soar`.

    Where nobody reads on (`tgl-soar … | head`), it ends without a word about it, and where the disk
    is full (`tgl-soar … > file`), with one.
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
    except OSError as error:
        if error.errno not in FULL or sys.argv[1:2] == ["run"]:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"error: {error.strerror}: what was being written is not whole", file=sys.stderr)
        raise SystemExit(2) from None


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
