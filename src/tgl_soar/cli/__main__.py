"""The command line: `tgl-soar COMMAND`.

`run` is the flying process: it is handed on before anything else is imported, so that the
command line's own libraries never load on board.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final

INTERPRETED: Final = "--interpreted"
FULL: Final = (errno.ENOSPC, errno.EDQUOT)
STOPPED: Final = 128 + signal.SIGINT


def main() -> None:
    """Entry point of `tgl-soar`.

    Ctrl-C ends it with a word from the first moment, `run` without one and with 0, as in flight.
    Where nobody reads on (`tgl-soar … | head`), it ends without a word about it, and where the disk
    is full (`tgl-soar … > file`), with one.
    """
    begin_loading()
    from tgl_soar.onboard import standard_streams

    standard_streams.reserve()
    try:
        try:
            _command()
        finally:
            if sys.stdout is not None:  # closed by whoever started it
                sys.stdout.flush()
    except KeyboardInterrupt:  # before a command, or `run`, has taken it for its own
        if sys.argv[1:2] == ["run"]:
            raise SystemExit(0) from None
        print("error: stopped", file=sys.stderr)
        raise SystemExit(STOPPED) from None
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's own flush
        raise SystemExit(128 + signal.SIGPIPE) from None
    except OSError as error:
        if error.errno not in FULL or sys.argv[1:2] == ["run"]:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"error: {error.strerror}: what was being written is not whole", file=sys.stderr)
        raise SystemExit(2) from None


def stop_at_once(number: int, _frame: object) -> None:
    """Ctrl-C's handler while libraries load: nothing is open yet that had to be closed.

    Raised in the middle of one, a KeyboardInterrupt would come out of it as anything.
    """
    if sys.argv[1:2] == ["run"]:
        os._exit(0)
    os.write(2, b"error: stopped\n")
    os._exit(128 + number)


def begin_loading() -> None:
    """Until `loaded`, Ctrl-C ends the process at once; unless somebody else handles it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        with suppress(ValueError):  # only the main thread may
            signal.signal(signal.SIGINT, stop_at_once)


def loaded() -> None:
    """Ctrl-C is a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is stop_at_once:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _command() -> None:
    try:
        command = _loaded_command()
    finally:
        loaded()
    command()


def _loaded_command() -> Callable[[], None]:
    """What was typed, with all that it needs."""
    if sys.argv[1:2] == ["run"]:
        from tgl_soar.onboard import native

        if INTERPRETED not in sys.argv:
            native.use()
        from tgl_soar.onboard.process import main as run

        def fly() -> None:
            raise SystemExit(run(sys.argv[2:]))

        return fly
    from tgl_soar.cli.commands import asked

    return asked(sys.argv[1:])


if __name__ == "__main__":
    main()
