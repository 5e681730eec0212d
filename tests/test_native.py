"""Native code of what flies: made, checked, taken and left alone."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from keyword import iskeyword
from pathlib import Path

import pytest

import tgl_soar
from tgl_soar import native
from tgl_soar.commands import compile as compiling

TESTS = Path(__file__).parent
# The tests of what flies, in this process; those of links and processes are interpreted anyway.
OF_WHAT_FLIES = (
    *("control", "estimation", "link", "onboard", "flightlog/test_flight_log.py"),
    *("test_autopilot.py", "test_geometry.py", "test_links.py", "test_stall_margin.py"),
)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where native code is looked for."""
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path / "native"))
    return tmp_path / "native"


def said(code: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return run.stdout.strip()


USE = "from tgl_soar import native; print(native.use(), native.told(), sep='|')"


# --- the real thing ------------------------------------------------------------------------------


@pytest.mark.first
def test_native_code_does_what_the_source_does(place: Path) -> None:
    """It is made, flies a flight between processes as the source does, to the last bit (`make`
    itself sees to that), is taken by `run`, and passes the tests of what flies."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler")
    words: list[str] = []
    compiling.make(words.append)
    assert len(words) == 2
    assert [path.name for path in place.iterdir()] == [native.folder().name]

    taken = said(
        "from tgl_soar import native; native.use(); import sys, tgl_soar.process;"
        "print(*sorted(name for name, module in sys.modules.items()"
        " if name.startswith('tgl_soar.') and module.__file__.endswith('.so')))"
    )
    assert taken.split() == sorted(native.MODULES)
    for options, ending in (([], ".so"), (["--interpreted"], ".py")):
        flown = said(
            "import sys; from tgl_soar.cli import main\n"
            f"sys.argv = ['tgl-soar', 'run', '-h', *{options}]\n"
            "try: main()\nexcept SystemExit: print(sys.modules['tgl_soar.autopilot'].__file__)"
        )
        assert flown.endswith(ending)

    run = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-p", "no:xdist", "-p", "no:randomly", "-q"),
            *(str(TESTS / name) for name in OF_WHAT_FLIES),
        ],
        cwd=TESTS.parent,
        env={**os.environ, "TGL_SOAR_TEST_NATIVE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-4000:]


# --- where there is none -------------------------------------------------------------------------


def test_without_native_code_the_source_flies_and_it_is_said(place: Path) -> None:
    assert said(USE) == "False|interpreted; `tgl-soar compile` makes it twice as quick"
    assert not place.exists()


def test_native_code_of_another_source_is_not_taken(place: Path) -> None:
    other = place / "native-0123456789abcdef"
    other.mkdir(parents=True)
    (other / native.MANIFEST).write_text("{}", encoding="utf-8")
    assert said(USE).startswith("False|interpreted (what was compiled is of another version)")


@pytest.mark.parametrize("manifest", ["", "{}", "[1]", '{"fields": {}}'])
def test_a_damaged_manifest_grounds_nothing(place: Path, manifest: str) -> None:
    kept = native.folder()
    kept.mkdir(parents=True)
    (kept / native.MANIFEST).write_text(manifest, encoding="utf-8")
    assert place in kept.parents
    assert said(USE).startswith("False|interpreted: what was compiled cannot be used: ")


def test_a_library_that_cannot_be_loaded_grounds_nothing(place: Path) -> None:
    kept = native.folder()
    kept.mkdir(parents=True)
    manifest = {"compiler": "mypyc", "fields": {}}
    (kept / native.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    (kept / f"0123{native.LIBRARY}.so").write_bytes(b"\x7fELF and then nothing")
    (kept / "tgl_soar").mkdir()
    (kept / "tgl_soar" / "autopilot.so").write_bytes(b"\x7fELF")
    assert place in kept.parents
    code = USE + "; import tgl_soar.autopilot; print(tgl_soar.autopilot.__file__[-3:])"
    first, second = said(code).splitlines()
    assert first.startswith("False|interpreted: what was compiled cannot be used: ")
    assert second == ".py"


def test_it_is_of_all_that_flies() -> None:
    """A module that flies is compiled, or changes the name under which native code is kept."""
    key = {
        file.relative_to(native.SOURCE).as_posix()
        for folder in native.FOLDERS
        for file in (native.SOURCE / folder).glob("*.py")
    }
    loaded = said(
        "import sys, tgl_soar.process; print(*(m.__file__ for n, m in sys.modules.items()"
        " if n.split('.')[0] == 'tgl_soar'))"
    )
    package = Path(tgl_soar.__file__).parent
    flies = {Path(file).relative_to(package).as_posix() for file in loaded.split()}
    assert flies <= key
    assert {
        native.file_of(name).relative_to(package).as_posix() for name in native.MODULES
    } <= flies


def test_where_it_cannot_be_kept_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path / "file"))
    with pytest.raises(OSError, match="file"):
        compiling.make(lambda _words: None)


def test_without_a_compiler_it_is_said_what_is_needed(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", str(place / "no-such-compiler"))
    monkeypatch.setattr(native, "MODULES", ("tgl_soar.control.pid",))
    with pytest.raises(compiling.CompileError, match=r"apt install gcc python3-dev"):
        compiling.make(lambda _words: None)
    assert list(place.iterdir()) == []


# --- what mypyc gets wrong, or takes otherwise than Python does ----------------------------------


def pitfalls(tree: ast.Module) -> Iterator[str]:
    """Each was found by the tests of what flies; mypyc 2.4 compiles all of them without a word."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice):
            parts = (node.slice.lower, node.slice.upper)
            if any(isinstance(p, ast.Call) for part in parts if part for p in ast.walk(part)):
                yield f"{node.lineno}: a call in a slice may be made twice"
        elif isinstance(node, ast.Lambda) and node.args.defaults:
            yield f"{node.lineno}: defaults of a lambda are taken once, for all that it makes"
        elif isinstance(node, ast.Attribute) and _is_c_keyword(node.attr):
            yield f"{node.lineno}: {node.attr} is no name in C"
    for node in tree.body:
        if (
            isinstance(node, ast.AnnAssign)
            and ast.unparse(node.annotation).startswith("Final")
            and "..." not in ast.unparse(node.annotation)
            and isinstance(node.value, ast.Tuple)
            and _is_float(node.value)
        ):
            yield f"{node.lineno}: a constant tuple of floats alone counts as not set"


def _is_c_keyword(name: str) -> bool:
    return name in {"_thread", "_Bool", "_Generic"} or (iskeyword(name) and name != "None")


def _is_float(value: ast.expr) -> bool:
    """Whether an element, or each of those that a star puts in, is a float."""
    if isinstance(value, ast.Starred):
        return _is_float(value.value)
    if isinstance(value, ast.BinOp):  # (0.0,) * 3
        return _is_float(value.left)
    if isinstance(value, ast.Tuple):
        return all(map(_is_float, value.elts))
    if isinstance(value, ast.Constant):
        return isinstance(value.value, float)
    return ast.unparse(value).lower() in ("nan", "inf", "float('nan')")


def test_no_pitfall_is_in_what_is_compiled() -> None:
    found = [
        f"{name}, line {pitfall}"
        for name in native.MODULES
        for pitfall in pitfalls(ast.parse(native.file_of(name).read_text(encoding="utf-8")))
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "def f(d, w):\n    return d[w(d) :]",
        "def f(x):\n    return lambda x=x: x",
        "class C:\n    def f(self):\n        self._thread = 1",
        "RATES: Final = (1.0, 2.0)",
        "NO: Final = (NAN, NAN)",
        "NO: Final[Triple] = (nan, *(0.0,) * 2)",
    ],
)
def test_a_planted_pitfall_is_found(text: str) -> None:
    assert len(list(pitfalls(ast.parse(text)))) == 1


def test_what_only_looks_like_a_pitfall_passes() -> None:
    text = (
        "RATES: Final[tuple[float, ...]] = (1.0, 2.0)\nBOTH: Final = (1, 2.0)\n"
        "def f(d, n):\n    return d[n + 1 :], lambda: n, d[len]"
    )
    assert list(pitfalls(ast.parse(text))) == []
