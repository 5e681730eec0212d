"""Native code of what flies: made, checked, taken and left alone."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tgl_soar
from tgl_soar.cli import compile as compiling
from tgl_soar.cli.app import app
from tgl_soar.onboard import native
from tgl_soar.onboard.process import main

TESTS = Path(__file__).parents[1]
# The tests of what flies, in one process; those of links and processes are interpreted anyway.
LAWS = ("autopilot", "control", "estimation", "test_geometry.py")
LINKS = ("link", "onboard")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where native code is looked for."""
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path / "native"))
    return tmp_path / "native"


def printed(code: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return run.stdout.strip()


USE = "from tgl_soar.onboard import native; print(native.use(), native.words(), sep='|')"


# --- the real thing ------------------------------------------------------------------------------


def passed_by_native_code(folders: tuple[str, ...]) -> None:
    """The tests of folders, which native code that is there runs."""
    run = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-n", "0", "-p", "no:randomly", "-q"),
            *(str(TESTS / name) for name in folders),
        ],
        cwd=TESTS.parent,
        env={**os.environ, "TGL_SOAR_TEST_NATIVE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-4000:]


@pytest.mark.long
@pytest.mark.first
@pytest.mark.usefixtures("place")
def test_native_code_passes_the_tests_of_links_and_of_the_flying_process() -> None:
    """Those of the laws it passes in `test_native_made.py`, which is not so long."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler")
    compiling.make(lambda _: None)
    passed_by_native_code(LINKS)


# --- where there is none -------------------------------------------------------------------------


def test_without_native_code_the_source_flies_and_it_is_reported(place: Path) -> None:
    assert printed(USE) == "False|interpreted; `tgl-soar compile` makes it more than twice as fast"
    assert not place.exists()


def made_at(
    kept: Path, *, python: str = sys.version, source: Path = native.SOURCE, key: str = ""
) -> Path:
    """A folder as `compile` leaves it, with a library that is none."""
    kept.mkdir(parents=True)
    (kept / f"0123{native.LIBRARY}{native.SUFFIX}").write_bytes(b"\x7fELF and then nothing")
    (kept / "tgl_soar").mkdir()
    (kept / "tgl_soar" / f"autopilot{native.SUFFIX}").write_bytes(b"\x7fELF")
    manifest = {"compiler": "mypyc", "python": python, "source": str(source), "fields": {}}
    manifest |= {"sums": native.sums(kept), "key": key or native.source_key()}
    (kept / native.MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    kept.chmod(0o755)
    return kept


CANNOT = "False|interpreted: what was compiled cannot be used: "


def test_native_code_of_another_source_is_not_taken(place: Path) -> None:
    made_at(place / "native-0123456789abcdef")
    assert printed(USE).startswith("False|interpreted (what was compiled is of another version)")


def test_only_what_is_ours_is_removed(place: Path) -> None:
    kept, old = made_at(native.folder()), made_at(place / "native-0123456789abcdef")
    (place / "native-photos").mkdir()
    theirs = [
        place / "native-photos",
        made_at(place / "native-1123456789abcdef", python="3.99"),
        made_at(place / "native-2123456789abcdef", source=place),
    ]
    assert native.others() == [old]
    assert CliRunner().invoke(app, ["compile", "--remove"]).exit_code == 0
    assert not kept.exists()
    assert not old.exists()
    assert all(folder.exists() for folder in theirs)


@pytest.mark.parametrize("manifest", ["", "{}", "[1]", '{"fields": {}}'])
def test_a_damaged_manifest_grounds_nothing(place: Path, manifest: str) -> None:
    (made_at(native.folder()) / native.MANIFEST).write_text(manifest, encoding="utf-8")
    assert place in native.folder().parents
    assert not native.is_made()
    assert printed(USE).startswith(CANNOT)


def test_code_that_was_cut_off_on_the_disk_is_never_loaded(place: Path) -> None:
    """A whole process would die of it."""
    kept = made_at(native.folder())
    assert place in kept.parents
    assert native.is_made()
    for file in kept.rglob(f"*{native.SUFFIX}"):
        whole = file.read_bytes()
        file.write_bytes(whole[:3])
        assert not native.is_made()
        assert printed(USE) == CANNOT + "it is damaged: compile it again"
        file.write_bytes(whole)
    assert native.is_made()


def test_what_others_may_write_to_is_not_run(place: Path) -> None:
    made_at(native.folder()).chmod(0o777)
    kept = native.folder()
    assert printed(USE) == f"{CANNOT}others may write to {kept}: chmod go-w {kept}"
    assert place in kept.parents


# --- whose it is -------------------------------------------------------------------------------


as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
OTHER_USER: int = 12345  # no user of this computer


def test_an_old_folder_under_a_new_name_is_not_taken(place: Path) -> None:
    made_at(place / "native-0123456789abcdef", key="0" * 64).rename(native.folder())
    assert not native.is_made()
    assert printed(USE) == f"{CANNOT}it was made of another version of the source: compile it again"


@pytest.mark.parametrize("above", [0, 1, 2])
def test_a_folder_that_others_can_put_another_in_place_of_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, above: int
) -> None:
    """At any height above it; but not where others may add to it and take nothing away (/tmp)."""
    base = tmp_path / "a" / "b" / "c"
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(base))
    made_at(native.folder())
    assert native.is_made()
    writable = [base, *base.parents][above]
    writable.chmod(0o777)
    assert not native.is_made()
    assert printed(USE) == f"{CANNOT}others may write to {writable}: chmod go-w {writable}"
    writable.chmod(0o1777)
    assert native.is_made()


@as_root
@pytest.mark.parametrize("what", ["base", "folder", "inside", "library", "manifest"])
def test_what_belongs_to_another_user_is_not_run(place: Path, what: str) -> None:
    kept = made_at(native.folder())
    library = next(kept.rglob(f"*{native.SUFFIX}"))
    theirs = {
        "base": place,
        "folder": kept,
        "inside": kept / "tgl_soar",
        "library": library,
        "manifest": kept / native.MANIFEST,
    }[what]
    os.chown(theirs, OTHER_USER, -1)
    assert printed(USE) == f"{CANNOT}{theirs} belongs to another user (uid {OTHER_USER})"


@as_root
@pytest.mark.parametrize("group", [0, OTHER_USER])
def test_a_group_may_write_only_if_it_is_its_owner_s_own(place: Path, group: int) -> None:
    """Ubuntu gives each user a group of their own, and makes folders writable by it."""
    kept = made_at(native.folder())
    os.chown(place, 0, group)
    place.chmod(0o775)
    assert native.is_made() == (group == 0)
    assert kept.exists()


@pytest.mark.parametrize("what", ["folder", "library"])
def test_a_link_is_not_followed(place: Path, what: str) -> None:
    kept = made_at(native.folder())
    link = kept if what == "folder" else next(kept.rglob(f"*{native.SUFFIX}"))
    link.rename(place / "elsewhere")
    link.symlink_to(place / "elsewhere")
    assert printed(USE) == f"{CANNOT}{link} is a symbolic link"


def test_a_base_that_is_a_link_to_a_folder_of_ours_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "data")
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path / "link"))
    made_at(native.folder())
    assert native.is_made()
    (tmp_path / "data").chmod(0o777)
    assert not native.is_made()


def test_a_library_that_others_may_write_to_is_not_run(place: Path) -> None:
    file = next(made_at(native.folder()).rglob(f"*{native.SUFFIX}"))
    file.chmod(0o666)
    assert place in file.parents
    assert printed(USE) == f"{CANNOT}others may write to {file}: chmod go-w {file}"


def test_what_was_checked_is_what_is_loaded(place: Path) -> None:
    """Whatever is put in its place between the two: the folder, or a file in it."""
    kept = made_at(native.folder())
    whole = {file.name: file.read_bytes() for file in kept.rglob(f"*{native.SUFFIX}")}
    held = native._held(kept, native.source_key())
    finder = native._Finder(kept, held)
    kept.rename(place / "away")
    for file in made_at(kept).rglob(f"*{native.SUFFIX}"):
        file.write_bytes(b"theirs")
    for name, (library, _) in finder._files.items():
        spec = finder.find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        assert Path(spec.origin).read_bytes() == whole[Path(library).name]
    held.close()


def test_nothing_stays_open_of_what_is_refused(place: Path) -> None:
    kept = made_at(native.folder())
    assert place in kept.parents
    before = len(list(Path("/proc/self/fd").iterdir()))
    next(kept.rglob(f"*{native.SUFFIX}")).write_bytes(b"damaged")
    assert not native.is_made()
    kept.chmod(0o777)
    assert not native.is_made()
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_library_says_of_what_source_it_was_made(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the manifest of a current one was put beside it."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler")
    current, kept = native.source_key(), native.folder()
    monkeypatch.setattr(native, "MODULES", ("tgl_soar.control.pid",))
    monkeypatch.setattr(native, "source_key", lambda: "old")
    compiling._compile(tmp_path)
    compiling._collect(tmp_path, kept)
    assert place in kept.parents
    as_old = (
        f"from tgl_soar.onboard import native; native.folder = lambda: native.Path({str(kept)!r})\n"
    )
    as_old += "native.source_key = lambda: 'old'\n"
    flown = printed(as_old + USE + "; from tgl_soar.control import pid; print(pid.__file__)")
    assert flown.splitlines()[0].startswith("True|native, by mypyc")
    assert flown.splitlines()[1] == str(kept / "tgl_soar/control" / f"pid{native.SUFFIX}")
    manifest = kept / native.MANIFEST
    manifest.write_text(manifest.read_text().replace('"key": "old"', f'"key": "{current}"'))
    refused = printed(USE + "; from tgl_soar.control import pid; print(pid.__file__)").splitlines()
    words = "its code is of another version of the source: compile it again"
    assert refused == [CANNOT + words, str(native.SOURCE / "control/pid.py")]


def test_nothing_is_compiled_where_it_would_not_be_flown(place: Path) -> None:
    place.mkdir()
    place.chmod(0o777)
    with pytest.raises(compiling.CompileError, match=f"would not be used: others may .* {place}"):
        compiling.make(lambda _words: None)
    assert list(place.iterdir()) == []


# --- what cannot be loaded ----------------------------------------------------------------------


def test_a_library_that_cannot_be_loaded_grounds_nothing(place: Path) -> None:
    made_at(native.folder())
    assert place in native.folder().parents
    code = USE + "; import tgl_soar.autopilot; print(tgl_soar.autopilot.__file__[-3:])"
    first, second = printed(code).splitlines()
    library = native.folder() / f"0123{native.LIBRARY}{native.SUFFIX}"
    assert first.startswith(f"{CANNOT}{library}: ")
    assert second == ".py"


def test_where_some_of_it_is_imported_already_the_source_flies_on(place: Path) -> None:
    """Else there would be two of each kind of tuple."""
    made_at(native.folder())
    assert place in native.folder().parents
    assert (
        printed("import tgl_soar.types; " + USE) == CANNOT + "tgl_soar.types was imported before it"
    )


def test_what_did_not_fly_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The module falls back to the source, which flies as the source does."""

    def flown(out: Path, _kept: Path) -> bytes:
        out.mkdir()
        (out / "module.log").write_text("tgl_soar: code: interpreted: for a reason\n")
        return b"the same"

    monkeypatch.setattr(compiling, "_flown", flown)
    with pytest.raises(compiling.CompileError, match="cannot be loaded here: interpreted: for a"):
        compiling._check(tmp_path, tmp_path)


def test_what_flies_otherwise_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flown(out: Path, _kept: Path) -> bytes:
        out.mkdir()
        code = "native, by" if out.name == "native" else "interpreted;"
        (out / "module.log").write_text(f"tgl_soar: code: {code} …\n", encoding="utf-8")
        return out.name.encode()

    monkeypatch.setattr(compiling, "_flown", flown)
    with pytest.raises(compiling.CompileError, match="flies differently from its source"):
        compiling._check(tmp_path, tmp_path)


def test_two_do_not_compile_into_the_same_place(place: Path) -> None:
    place.mkdir()
    with (place / "native.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(compiling.CompileError, match="somebody else is compiling into"):
            compiling.make(lambda _words: None)


def test_a_compile_that_is_ended_leaves_nothing_behind(place: Path) -> None:
    place.mkdir()
    (place / "making-native-left-by-a-kill").mkdir()
    command = [sys.executable, "-m", "tgl_soar.cli", "compile"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        while not (compilers := compilers_in(place)) and run.poll() is None:
            time.sleep(0.05)
        run.send_signal(signal.SIGTERM)
    assert run.returncode == 1
    assert compilers
    until_s = time.monotonic() + 10.0
    while compilers_in(place) and time.monotonic() < until_s:  # killed, and not yet gone
        time.sleep(0.05)
    assert not compilers_in(place)
    assert [path.name for path in place.iterdir()] == ["native.lock"]


def compilers_in(place: Path) -> list[int]:
    """The processes that work in a folder below."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if place in (process / "cwd").readlink().parents:
                found.append(int(process.name))
    return found


def test_an_abbreviated_option_does_not_slip_through(capsys: pytest.CaptureFixture[str]) -> None:
    """`--interp` would be understood once and overlooked once."""
    with pytest.raises(SystemExit):
        main(["--airframe", "a", "--site", "s", "--link", "udp:1", "--interp"])
    assert "--interp" in capsys.readouterr().err


def test_it_is_of_all_that_flies() -> None:
    """A module that flies is compiled, or changes the name under which native code is kept."""
    key = {file.relative_to(native.SOURCE).as_posix() for file in native.sources()}
    loaded = printed(
        "import sys, tgl_soar.onboard.process; print(*(m.__file__ for n, m in sys.modules.items()"
        " if n.split('.')[0] == 'tgl_soar'))"
    )
    package = Path(tgl_soar.__file__).parent
    flies = {Path(file).relative_to(package).as_posix() for file in loaded.split()}
    assert flies <= key
    assert {
        native.file_of(name).relative_to(package).as_posix() for name in native.MODULES
    } <= flies


def test_where_it_cannot_be_kept_it_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path / "file"))
    with pytest.raises(OSError, match="file"):
        compiling.make(lambda _words: None)


def test_without_a_compiler_it_is_reported_what_is_needed(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", str(place / "no-such-compiler"))
    monkeypatch.setattr(native, "MODULES", ("tgl_soar.control.pid",))
    with pytest.raises(compiling.CompileError, match=r"apt install gcc python3-dev"):
        compiling.make(lambda _words: None)
    assert [path.name for path in place.iterdir()] == ["native.lock"]
