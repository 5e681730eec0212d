"""`tgl-soar compile` step by step, without a compiler: what is made, checked, kept and removed."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.cli import compile as compiling
from tgl_soar.cli.app import app
from tgl_soar.onboard import native
from tgl_soar.sim.sitl_options import SitlError


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where native code is kept."""
    folder = tmp_path / "kept"
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(folder))
    return folder


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["compile", *words], env={"COLUMNS": "300"})
    return done.exit_code, done.output


# --- the command -------------------------------------------------------------------------------


@pytest.mark.parametrize(("is_made", "again", "makes"), [
    (True, False, 0), (True, True, 1), (False, False, 1),
])  # fmt: skip
def test_it_is_made_where_it_is_not_there_or_wanted_again(
    is_made: bool, again: bool, makes: int, base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []
    monkeypatch.setattr("tgl_soar.onboard.native.is_made", lambda: is_made)
    monkeypatch.setattr(compiling, "make", made.append)
    before = signal.getsignal(signal.SIGTERM)
    code, output = run(*(["--again"] if again else []))
    assert (code, output) == (0, f"ready: {native.folder()}\n")
    assert len(made) == makes
    assert signal.getsignal(signal.SIGTERM) == before
    assert native.folder().parent == base


@pytest.mark.parametrize(("error", "words"), [
    (compiling.CompileError("no compiler"), "error: no compiler"),
    (OSError(28, "No space left on device"),
     "No space left on device; TGL_SOAR_NATIVE may name another folder to keep native code in"),
])  # fmt: skip
@pytest.mark.usefixtures("base")
def test_what_hinders_it_is_reported(
    error: Exception, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_say: Any) -> None:
        raise error

    monkeypatch.setattr("tgl_soar.onboard.native.is_made", lambda: False)
    monkeypatch.setattr(compiling, "make", fails)
    code, output = run()
    assert (code, words in output) == (1, True), output


def test_removed_is_all_of_it_and_nothing_else(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other, strange = base / "another", base / "strange"
    for folder in (native.folder(), other, strange):
        folder.mkdir(parents=True)
    monkeypatch.setattr("tgl_soar.onboard.native.others", lambda: [other])
    monkeypatch.setattr(compiling, "make", lambda _say: pytest.fail("made"))
    assert run("--remove") == (0, "removed: the source flies\n")
    assert list(base.iterdir()) == [strange]
    assert run("--remove")[0] == 0


# --- making it ---------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["mypyc", "setuptools"])
@pytest.mark.usefixtures("base")
def test_without_mypyc_or_setuptools_the_extra_is_named(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiling, "find_spec", lambda name: None if name == missing else name)
    with pytest.raises(compiling.CompileError, match=r"pip install 'tgl_soar\[native\]'"):
        compiling.make(lambda _words: None)


def collected(_work: Path, made: Path) -> None:
    made.mkdir()
    (made / "code").write_text("new", encoding="utf-8")


@pytest.mark.parametrize("was_there", [False, True])
def test_what_was_checked_is_kept_in_the_place_of_what_was(
    was_there: bool, base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mypyc", reason="mypyc is not installed")
    kept, stale = native.folder(), base / "stale"
    stale.mkdir(parents=True)
    if was_there:
        kept.mkdir()
        (kept / "old").touch()
    left = base / "making-native-left"
    left.mkdir()
    checked: list[Path] = []

    def check(made: Path, work: Path) -> None:
        checked.append(made)
        assert made == work / "made"
        assert (made / kept.name / "code").exists()
        assert not left.exists()  # an earlier one's, that was killed
        assert kept.exists() == was_there
        assert stale.exists()
        assert made.stat().st_mode & 0o777 == 0o700

    lines: list[str] = []
    monkeypatch.setattr("tgl_soar.onboard.native.others", lambda: [stale])
    monkeypatch.setattr(compiling, "_compile", lambda _work: None)
    monkeypatch.setattr(compiling, "_collect", collected)
    monkeypatch.setattr(compiling, "_check", check)
    compiling.make(lines.append)
    assert len(checked) == 1
    assert [path.name for path in kept.iterdir()] == ["code"]
    assert sorted(path.name for path in base.iterdir()) == sorted([kept.name, "native.lock"])
    assert lines[0].startswith(f"compiling {len(native.MODULES)} modules")
    assert lines[1].startswith("flying the source and the native code of it")


def test_what_fails_its_check_changes_nothing(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mypyc", reason="mypyc is not installed")
    kept = native.folder()
    kept.mkdir(parents=True)
    (kept / "old").touch()

    def check(_made: Path, _work: Path) -> None:
        raise compiling.CompileError("it flies otherwise")

    monkeypatch.setattr(compiling, "_compile", lambda _work: None)
    monkeypatch.setattr(compiling, "_collect", collected)
    monkeypatch.setattr(compiling, "_check", check)
    with pytest.raises(compiling.CompileError, match="it flies otherwise"):
        compiling.make(lambda _words: None)
    assert [path.name for path in kept.iterdir()] == ["old"]
    assert sorted(path.name for path in base.iterdir()) == sorted([kept.name, "native.lock"])


def test_one_compiles_at_a_time(tmp_path: Path) -> None:
    with (tmp_path / "native.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with (
            pytest.raises(compiling.CompileError, match="somebody else is compiling into"),
            compiling._alone(tmp_path),
        ):
            pytest.fail("both")
    with compiling._alone(tmp_path):
        pass


# --- the compiler ------------------------------------------------------------------------------


class Compiler:
    """What is called in its place."""

    asked: Any = None
    code, output = 0, "\n".join(f"line {i}" for i in range(30))

    def __init__(self, command: list[str], **more: Any) -> None:
        Compiler.asked = command, more
        self.returncode, self.pid = Compiler.code, 1

    def __enter__(self) -> Compiler:
        return self

    def __exit__(self, *_given: Any) -> None: ...

    def communicate(self) -> tuple[str, None]:
        return Compiler.output, None


@pytest.mark.parametrize("code", [0, 1])
def test_a_copy_of_what_flies_is_compiled(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "tgl_soar.control.pid"
    monkeypatch.setattr(native, "MODULES", (module,))
    monkeypatch.setattr(compiling, "_make_tuples_direct", lambda _work: None)
    monkeypatch.setattr(
        compiling, "subprocess", SimpleNamespace(Popen=Compiler, PIPE=-1, STDOUT=-2)
    )
    monkeypatch.setattr(Compiler, "code", code)
    if code:
        with pytest.raises(compiling.CompileError) as refused:
            compiling._compile(tmp_path)
        lines = str(refused.value).splitlines()
        assert lines[:20] == [f"line {i}" for i in range(10, 30)]
        assert lines[20].startswith("it could not be compiled; a C compiler and Python's headers")
    else:
        compiling._compile(tmp_path)
    command, more = Compiler.asked
    assert command == [sys.executable, "setup.py", "build_ext", "--inplace"]
    assert more["cwd"] == tmp_path
    assert more["start_new_session"]
    assert more["text"]
    assert "-ffp-contract=off" in more["env"]["CFLAGS"]
    assert more["env"]["PATH"] == os.environ["PATH"]
    assert (tmp_path / "tgl_soar/control/pid.py").read_text(encoding="utf-8") == (
        native.file_of(module).read_text(encoding="utf-8")
    )
    key = f'KEY = "{native.source_key()}"\n'
    assert (tmp_path / f"{native.COMPILED_IN}.py").read_text(encoding="utf-8") == key
    setup = (tmp_path / "setup.py").read_text(encoding="utf-8")
    assert "['tgl_soar/control/pid.py', 'tgl_soar_source.py']" in setup
    assert (tmp_path / "direct_tuples.c").exists()
    assert "ignore_missing_imports" in (tmp_path / "mypy.ini").read_text(encoding="utf-8")


def test_what_was_compiled_is_collected_with_its_manifest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed")
    monkeypatch.setattr(native, "MODULES", ("tgl_soar.control.pid",))
    work, made = tmp_path / "work", tmp_path / "made"
    (work / "tgl_soar/control").mkdir(parents=True)
    own = [f"one{native.SUFFIX}", f"tgl_soar/control/pid{native.SUFFIX}"]
    for name in (*own, "tgl_soar/control/pid.py"):
        (work / name).write_bytes(name.encode())
    compiling._collect(work, made)
    files = sorted(str(path.relative_to(made)) for path in made.rglob("*") if path.is_file())
    assert files == sorted([native.MANIFEST, *own])
    manifest = json.loads((made / native.MANIFEST).read_text(encoding="utf-8"))
    assert manifest["key"] == native.source_key()
    assert manifest["python"] == sys.version
    assert manifest["source"] == str(native.SOURCE)
    assert set(manifest["sums"]) == set(own)
    assert set(manifest["fields"]) == {"tgl_soar.control.pid"}
    for path in (made, *made.rglob("*")):
        assert path.stat().st_mode & 0o777 == (0o755 if path.is_dir() else 0o644)


# --- the flight that checks it -----------------------------------------------------------------


def test_the_same_flight_by_both_is_good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[tuple[str, Path]] = []

    def fly(out: Path, kept: Path) -> bytes:
        flown.append((out.name, kept))
        out.mkdir()
        code = "native, by" if out.name == "native" else "interpreted;"
        (out / "module.log").write_text(f"tgl_soar: code: {code} …\n", encoding="utf-8")
        return b"the same"

    monkeypatch.setattr(compiling, "_flown", fly)
    compiling._check(tmp_path / "base", tmp_path)
    assert flown == [("source", tmp_path / "none"), ("native", tmp_path / "base")]


@pytest.mark.parametrize("before", [None, "where it was"])
@pytest.mark.parametrize("fails", [False, True])
def test_the_flight_is_flown_by_the_code_that_was_made(
    before: str | None, fails: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TGL_SOAR_NATIVE", raising=False)
    if before is not None:
        monkeypatch.setenv("TGL_SOAR_NATIVE", before)

    def fly(options: Any, _progress: Any) -> None:
        assert os.environ["TGL_SOAR_NATIVE"] == "the new one"
        assert (options.out, options.stay_s) == (tmp_path, 4.0)
        if fails:
            raise SitlError("no way")
        (tmp_path / "truth.csv").write_bytes(b"truth")

    monkeypatch.setattr("tgl_soar.sim.sitl.fly", fly)
    if fails:
        with pytest.raises(compiling.CompileError, match="should check it failed: no way"):
            compiling._flown(tmp_path, Path("the new one"))
    else:
        assert compiling._flown(tmp_path, Path("the new one")) == b"truth"
    assert os.environ.get("TGL_SOAR_NATIVE") == before
