"""What is compiled of what flies, and whose code is taken; `tests/cli/test_native.py` makes it."""

from __future__ import annotations

import grp
import json
import os
import pwd
import stat
import subprocess
import sys
from collections import Counter
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import pytest

from tgl_soar.onboard import native

pytestmark = pytest.mark.interpreted

# Of what the flying process loads, what stays as its source has it.
STAYS = {
    "the folders themselves": (
        "", "config", "control", "control.search", "estimation", "link", "link.autopilots",
        "link.natnet", "link.transports", "link.vehicle", "onboard", "onboard.flightlog",
    ),
    "reads or writes files": (
        "config.airframe", "config.files", "config.parameter_files", "config.parameter_store",
        "config.site", "config.strict", "link.component_metadata", "link.signing_keys",
        "onboard.flightlog.files",
    ),
    "declares, or judges what is given before a flight or between two ticks": (
        "config.dynamics", "config.flown_gains", "config.glide_limits", "config.lateral_dynamics",
        "config.lateral_gains", "config.line_changes", "config.parameter_rules",
        "config.parameters", "config.stall_limit",
        "control.lateral_margin", "control.line_bounds", "control.loop_margin",
        "control.search.glimpse", "control.supervisor_texts", "control.survey",
        "link.autopilots.aileron_brake_mixing", "link.autopilots.requirements", "link.messages",
        "onboard.flightlog.topics", "onboard.setup",
    ),
    "starts, opens or watches the process": (
        "link.natnet.sockets", "onboard.command_line", "onboard.console", "onboard.link_load",
        "onboard.mocap", "onboard.native", "onboard.process", "onboard.search_process",
        "onboard.watchdog", "onboard.watchdog_release",
    ),
    "looks in a tick whether something was asked for or has come, seldom anything": (
        "link.mission", "link.tracked_attitude", "link.vehicle.autopilot_wind",
        "link.vehicle.estimator_status",
        "link.vehicle.gnss_accuracy", "onboard.excitation_switch", "onboard.firmware_landing",
        "onboard.gnss_watch", "onboard.launch_landing_switch", "onboard.line_moves",
        "onboard.search_switch", "onboard.station_watch", "onboard.survey_switch",
        "onboard.switches",
    ),
}  # fmt: skip


def test_of_what_the_flying_process_loads_all_is_compiled_but_for_what_stays() -> None:
    code = "import sys, tgl_soar.onboard.process; print(*sys.modules)"
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {name for name in run.stdout.split() if name.partition(".")[0] == "tgl_soar"}
    stays = {f"tgl_soar.{name}".rstrip(".") for names in STAYS.values() for name in names}
    assert loaded - set(native.MODULES) == stays
    assert set(native.MODULES) <= loaded
    assert set(Counter(native.MODULES).values()) == {1}


def test_native_code_is_of_this_interpreter_and_of_this_source() -> None:
    assert native.SUFFIX in EXTENSION_SUFFIXES
    assert f"{sys.version_info.major}{sys.version_info.minor}" in native.SUFFIX
    assert native.file_of("tgl_soar.onboard.native") == Path(native.__file__)
    assert native.file_of("tgl_soar.types").is_file()
    assert native.SOURCE.name == "tgl_soar"
    sources = native.sources()
    assert {native.file_of(name) for name in native.MODULES} <= set(sources)
    folders = {file.relative_to(native.SOURCE).parts[0] for file in sources}
    assert {"config", "control", "estimation", "link", "onboard", "types.py"} <= folders
    assert not folders & {"sim", "analysis", "air", "cli"}


# --- where it is kept -----------------------------------------------------------------------------


def test_it_lies_beside_the_byte_code_or_where_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGL_SOAR_NATIVE", "")
    assert native.base() == native.SOURCE / "__pycache__"
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path))
    assert native.base() == tmp_path
    monkeypatch.setattr(native, "source_key", lambda: "0123456789abcdef" * 4)
    assert native.folder() == tmp_path / "native-0123456789abcdef"


def test_its_name_changes_with_the_source_and_with_what_compiles_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("types.py", "link/frames.py", "cli/compile.py", "sim/world.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("A = 1\n")
    monkeypatch.setattr(native, "SOURCE", tmp_path)
    keys = [native.source_key()]
    for name, changes in (
        ("types.py", True),
        ("link/frames.py", True),
        ("cli/compile.py", True),
        ("sim/world.py", False),  # it does not fly
    ):
        (tmp_path / name).write_text("A = 2\n")
        keys.append(native.source_key())
        assert (keys[-1] != keys[-2]) is changes
    monkeypatch.setattr(native, "SUFFIX", ".cpython-399.so")
    assert native.source_key() != keys[-1]


def test_folders_of_other_versions_for_this_interpreter_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path))
    monkeypatch.setattr(native, "source_key", lambda: "f" * 64)
    good = {"python": sys.version, "source": str(native.SOURCE)}
    manifests = {
        "native-ffffffffffffffff": json.dumps(good),  # it is ours
        "native-1": json.dumps(good),
        "native-2": json.dumps({**good, "python": "3.99"}),
        "native-3": json.dumps({**good, "source": "/elsewhere"}),
        "native-4": "no json",
        "native-5": "[]",
        "native-6": json.dumps({"python": sys.version}),
        "photos-1": json.dumps(good),
        "native-0": json.dumps(good),
    }
    for name, text in manifests.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / native.MANIFEST).write_text(text)
    (tmp_path / "native-7").mkdir()  # without any
    assert [path.name for path in native.others()] == ["native-0", "native-1"]


def test_the_sum_of_every_file_of_native_code_is_known_by_its_place(tmp_path: Path) -> None:
    (tmp_path / "tgl_soar").mkdir()
    (tmp_path / f"tgl_soar/a{native.SUFFIX}").write_bytes(b"")
    (tmp_path / f"b{native.SUFFIX}").write_bytes(b"abc")
    (tmp_path / "b.py").write_bytes(b"no native code")
    # As `sha256sum` prints them of nothing and of "abc" (FIPS 180-2).
    assert native.sums(tmp_path) == {
        f"tgl_soar/a{native.SUFFIX}": (
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
        ),
        f"b{native.SUFFIX}": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
    }


# --- whose it is ----------------------------------------------------------------------------------

OWN_USER = 4242


def about(mode: int = 0o755, uid: int = 0, gid: int = 0) -> Any:
    return SimpleNamespace(st_mode=mode, st_uid=uid, st_gid=gid)


class Users:
    """Groups and their members, whatever this computer has."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.members: dict[int, list[str]] = {}
        monkeypatch.setattr(os, "geteuid", lambda: OWN_USER)
        monkeypatch.setattr(grp, "getgrgid", lambda gid: SimpleNamespace(gr_mem=self.members[gid]))
        monkeypatch.setattr(pwd, "getpwuid", lambda _uid: SimpleNamespace(pw_name="pilot"))
        self._monkeypatch = monkeypatch

    def refuses(self, status: Any, **named: Any) -> str:
        self._monkeypatch.setattr(os, "fstat", lambda _fd: status)
        try:
            native._check_trust(0, Path("/kept"), **named)
        except PermissionError as error:
            return str(error)
        return ""


@pytest.fixture
def users(monkeypatch: pytest.MonkeyPatch) -> Users:
    return Users(monkeypatch)


@pytest.mark.parametrize(("uid", "is_ours"), [(0, True), (OWN_USER, True), (1, False)])
def test_only_root_s_and_our_own_files_are_flown(users: Users, uid: int, is_ours: bool) -> None:
    words = users.refuses(about(uid=uid))
    assert words == ("" if is_ours else f"/kept belongs to another user (uid {uid})")


OTHERS = "others may write to /kept: chmod go-w /kept"


@pytest.mark.parametrize(
    ("mode", "sticky_will_do", "words"),
    [
        (0o755, False, ""),
        (0o744, False, ""),
        (0o757, False, OTHERS),
        (0o775, False, OTHERS),
        (0o1777, False, OTHERS),
        (0o1777, True, ""),  # as /tmp is: what is ours stays ours
        (0o1775, True, ""),
        (0o777, True, OTHERS),
        (0o775, True, OTHERS),
    ],
)
def test_nobody_else_may_write_to_it(
    users: Users, mode: int, sticky_will_do: bool, words: str
) -> None:
    status = about(mode | stat.S_IFDIR, OWN_USER, OWN_USER + 1)
    assert users.refuses(status, sticky_will_do=sticky_will_do) == words


@pytest.mark.parametrize(
    ("gid", "members", "is_private"),
    [
        (OWN_USER, [], True),
        (OWN_USER, ["pilot"], True),
        (OWN_USER, ["pilot", "friend"], False),
        (OWN_USER, ["friend"], False),
        (OWN_USER, None, True),  # it has no name, and so no members
        (OWN_USER + 1, [], False),
    ],
)
def test_a_group_may_write_that_is_its_owner_s_alone(
    users: Users, gid: int, members: list[str] | None, is_private: bool
) -> None:
    if members is not None:
        users.members[gid] = members
    assert (users.refuses(about(0o775, OWN_USER, gid)) == "") is is_private


def test_what_is_opened_is_no_link_and_named_where_it_lies(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"abc")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    folder = os.open(tmp_path, os.O_PATH)
    try:
        with native._opened("file", folder, tmp_path / "file") as descriptor:
            assert native._bytes_of(descriptor) == b"abc"
            assert not os.get_inheritable(descriptor)
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
        for how in (os.O_RDONLY, os.O_PATH):
            with (
                pytest.raises(PermissionError, match=f"{tmp_path}/link is a symbolic link"),
                native._opened("link", folder, tmp_path / "link", how),
            ):
                pass
        with (
            pytest.raises(FileNotFoundError, match=f"{tmp_path}/none"),
            native._opened("none", folder, tmp_path / "none"),
        ):
            pass
    finally:
        os.close(folder)


# --- what it is taken by --------------------------------------------------------------------------


class Kind(NamedTuple):
    """As mypyc leaves one: without the types of its fields."""

    a: float


def finder_of(**manifest: Any) -> native._Finder:
    held = native._Held(
        {"fields": {}, **manifest},
        {f"0123__mypyc{native.SUFFIX}": 7, f"tgl_soar/autopilot{native.SUFFIX}": 8},
    )
    return native._Finder(Path("/kept"), held)


def test_modules_are_found_in_the_open_files_and_named_where_they_lie() -> None:
    finder = finder_of()
    assert finder.libraries == ["0123__mypyc"]
    spec = finder.find_spec("tgl_soar.autopilot")
    assert spec is not None
    assert spec.origin == "/proc/self/fd/8"
    assert finder.find_spec("tgl_soar.types") is None
    with pytest.raises(ImportError, match=f"/kept/tgl_soar/autopilot{native.SUFFIX}: "):
        spec.loader.create_module(spec)  # type: ignore[union-attr]  # 8 is no such file


def test_fields_come_back_once_their_module_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    finder = finder_of(fields={"made": {"Kind": {"a": "int"}}, "other": {"Kind": {"a": "str"}}})
    made = ModuleType("made")
    before = dict(Kind.__annotations__)
    try:
        finder.give_back()
        monkeypatch.setitem(sys.modules, "made", made)
        finder.give_back()  # it is being loaded yet
        assert Kind.__annotations__ == before
        vars(made)["Kind"] = Kind
        finder.give_back()
        assert Kind.__annotations__ == {"a": "int"}
        Kind.__annotations__ = {}
        finder.give_back()  # once
        assert Kind.__annotations__ == {}
    finally:
        Kind.__annotations__ = before


def test_where_nothing_was_compiled_the_source_flies_and_it_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(native, "_reported", "")
    monkeypatch.setenv("TGL_SOAR_NATIVE", str(tmp_path))
    finders = list(sys.meta_path)
    assert not native.use()
    assert native.words() == "interpreted; `tgl-soar compile` makes it more than twice as fast"
    native.folder().mkdir()
    first = native.MODULES[0]
    monkeypatch.setitem(sys.modules, first, ModuleType(first))
    assert not native.use()
    cannot = "interpreted: what was compiled cannot be used: "
    assert native.words() == f"{cannot}{first} was imported before it"
    assert sys.meta_path == finders
