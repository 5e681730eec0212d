"""Native code of what flies, made as `tgl-soar compile` makes it: it flies as the source does."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from test_native import LAWS, passed_by_native_code, printed

from tgl_soar.cli import compile as compiling
from tgl_soar.onboard import native

pytestmark = pytest.mark.first  # it takes minutes


OF_THE_LINES_IN_C = """
import gc, sys
from tgl_soar.onboard import native; native.use()
from tgl_soar_tuples import make
from tgl_soar.types import Setpoints as Kind
whole, pitch = make(Kind, 1.0, 2.0, 3.0), 4.5e-6
print(whole == Kind(1.0, 2.0, 3.0) and type(whole) is Kind and hash(whole) == hash(tuple(whole)))
before = sys.getrefcount(pitch), sys.getrefcount(Kind)
many = [make(Kind, pitch, pitch, pitch) for _ in range(100)]
del many
print((sys.getrefcount(pitch), sys.getrefcount(Kind)) == before)
print(gc.is_tracked(make(Kind, [], [], [])))
errors = 0
for wrong in ((), (3,), (list, 1.0)):
    try: make(*wrong)
    except TypeError: errors += 1
print(errors)
ring = []
ring.append(make(Kind, ring, ring, ring))
del ring
gc.collect()
print(sum(type(o) is Kind and type(o[0]) is list for o in gc.get_objects()))
"""


def test_native_code_does_what_the_source_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is made, flies a flight between processes as the source does, to the last bit (`make`
    itself sees to that), is taken by `run`, and passes the tests of the laws."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler")
    place = tmp_path / "native"
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(place))
    words: list[str] = []
    compiling.make(words.append)
    assert len(words) == 2
    assert {path.name for path in place.iterdir()} == {native.folder().name, "native.lock"}

    taken = printed(
        "from tgl_soar.onboard import native; native.use(); import sys, tgl_soar.onboard.process;"
        "print(*sorted(name for name, module in sys.modules.items()"
        " if name.startswith('tgl_soar.') and module.__file__.endswith('.so')))"
    )
    assert taken.split() == sorted(native.MODULES)
    for options, ending in (([], ".so"), (["--interpreted"], ".py")):
        flown = printed(
            "import sys; from tgl_soar.cli.__main__ import main\n"
            f"sys.argv = ['tgl-soar', 'run', '-h', *{options}]\n"
            "try: main()\nexcept SystemExit: print(sys.modules['tgl_soar.autopilot'].__file__)"
        )
        assert flown.endswith(ending)

    assert printed(OF_THE_LINES_IN_C).split() == ["True", "True", "True", "3", "0"]

    passed_by_native_code(LAWS)
