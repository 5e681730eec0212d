"""The command line: `tgl-soar COMMAND`.

`run` is the flying process: it is handed on before anything else is imported, so that the
command line's own libraries never load on board.
"""

from __future__ import annotations

import sys
from typing import Final

INTERPRETED: Final = "--interpreted"


def main() -> None:
    """Entry point of `tgl-soar`."""
    if sys.argv[1:2] == ["run"]:
        from tgl_soar import native

        if INTERPRETED not in sys.argv:
            native.use()
        from tgl_soar.process import main as run

        raise SystemExit(run(sys.argv[2:]))
    from tgl_soar.commands import app

    app()


if __name__ == "__main__":
    main()
