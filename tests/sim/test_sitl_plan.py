"""What the flight between processes is to be, and what it refuses before any process is started."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from errno import ENOSPC
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.sim import sitl, sitl_page
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.sitl import busy_hint, fly, plan
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import bridge_command

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
SITE_MOCAP = shipped("sites/tunnel_mocap.toml")


def options(out: Path, **changes: Any) -> SitlOptions:
    return SitlOptions(**{"airframe": AIRFRAME, "site": SITE, "out": out, **changes})


def quietly(_operator: object) -> None:
    return None


def test_motion_capture_needs_a_site_that_has_it(tmp_path: Path) -> None:
    with pytest.raises(SitlError, match=r"tunnel\.toml: no \[mocap\] table"):
        fly(options(tmp_path, mocap=True), quietly)


def test_a_landing_needs_a_place_to_land_at(tmp_path: Path) -> None:
    with pytest.raises(SitlError, match=r"tunnel\.toml: no \[landing\] table.* --site hill"):
        fly(options(tmp_path, goes_home=True), quietly)
    assert not list(tmp_path.iterdir())


def test_a_throw_needs_ground_to_stand_on(tmp_path: Path) -> None:
    """The tunnel's board rises up to the very end of its fence."""
    text = shipped("sites/hill.toml").read_text(encoding="utf-8")
    flat, bare = tmp_path / "flat.toml", tmp_path / "bare.toml"
    (profile,) = re.findall(r"(?ms)^\[ground\]\nprofile = \[.*?^\]$", text)
    flat.write_text(text.replace(profile, "[ground]\nprofile = [[-9.0, 0.0], [9.0, 0.0]]"))
    bare.write_text(text.replace(profile, ""))
    for site, why in (
        (bare, r"bare\.toml: no \[ground\] table"),
        (flat, r"flat\.toml: \[ground\] profile: the ground does not rise"),
        (SITE, r"tunnel\.toml: a hand at x .* has no 1 m of room in the fence; .* --site hill"),
    ):
        with pytest.raises(SitlError, match=why):
            fly(options(tmp_path / "out", site=site, by_hand=True), quietly)
    assert not (tmp_path / "out").exists()


def test_the_first_leg_begins_in_the_hand_and_no_other(tmp_path: Path) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    first, *others = plan(site, values, options(tmp_path, by_hand=True))
    assert first.to_set() == [*first.parameters.items(), ("LNC_START", 1.0)]
    assert not any(("LNC_START", 1.0) in leg.to_set() for leg in others)
    plain, *_ = plan(site, values, options(tmp_path))
    assert plain.to_set() == list(first.parameters.items())
    for by_hand in (False, True):
        asked = options(tmp_path, by_hand=by_hand)
        words = bridge_command(asked, tmp_path / "truth.csv", "127.0.0.1:9", "127.0.0.1:10", "")
        assert parsed(words[4:]).simulation.by_hand == by_hand


def test_a_firmware_flies_the_airframe_file_with_its_name_and_gets_the_hall_s_poses(
    tmp_path: Path,
) -> None:
    """Fails at the missing program, with both files as they would be flown in the folder."""
    flown = options(
        tmp_path,
        site=SITE_MOCAP,
        mocap=True,
        autopilot="px4",
        firmware=tmp_path / "px4",
        route="manual_control",
    )
    with pytest.raises(SitlError, match="there is no program"):
        fly(flown, quietly)
    airframe = load_airframe(tmp_path / "flown" / "eclipson_c.toml")
    assert (airframe.autopilot.firmware, airframe.autopilot.route) == ("px4", "manual_control")
    assert load_site(tmp_path / "flown" / "tunnel_mocap.toml").forward is not None


def test_an_output_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(SitlError, match=r"--out .*file: cannot be written"):
        fly(options(tmp_path / "file"), quietly)


def test_an_unknown_leg_is_named(tmp_path: Path) -> None:
    with pytest.raises(SitlError, match=r"no line named 'q'; it has a, b, c"):
        fly(options(tmp_path, legs=("q",)), quietly)


def test_what_finds_no_room_on_the_disk_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_given: object) -> None:
        raise OSError(ENOSPC, os.strerror(ENOSPC), "out/summary.json")

    monkeypatch.setattr(sitl, "fly", full)
    ended = CliRunner().invoke(app, ["sitl", "--out", str(tmp_path)])
    assert ended.exit_code == 2
    words = f"--out {tmp_path}: out/summary.json cannot be written: No space left on device"
    assert words in " ".join(ended.output.split())


@pytest.mark.parametrize("how", ["--realtime", "--page"])
def test_who_flies_in_real_time_may_choose_the_port_of_stations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    flown: list[SitlOptions] = []

    def begun(options: SitlOptions, *_rest: object) -> None:
        flown.append(options)
        raise SitlError("enough")

    monkeypatch.setattr(sitl, "fly", begun)
    monkeypatch.setattr(sitl_page, "host", begun)
    port = ["--gcs-local", "127.0.0.1:0", "--out", str(tmp_path)]
    assert "enough" in CliRunner().invoke(app, ["sitl", how, *port]).output
    assert flown[0].gcs_local == "127.0.0.1:0"
    assert "add --realtime" in CliRunner().invoke(app, ["sitl", *port]).output


def test_what_takes_so_long_is_said_before_the_page_has_an_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hosted(_options: SitlOptions, _port: int, opened: Callable[[str], None]) -> None:
        opened("http://127.0.0.1:8/")
        raise SitlError("enough")

    monkeypatch.setattr(sitl_page, "host", hosted)
    printed = CliRunner().invoke(app, ["sitl", "--page", "--out", str(tmp_path)]).output
    assert printed.index("computing the air") < printed.index("the operator's page: http")


def test_a_busy_machine_is_named() -> None:
    assert "whose load is 6.0 on 2 processors" in busy_hint(6.0, 2)
    assert "load" not in busy_hint(0.5, 2)
    assert "without --realtime" in busy_hint(0.5, 2)


@pytest.mark.parametrize(("realtime", "waits_s"), [(True, 20.0), (False, 120.0)])
def test_a_machine_that_is_only_slow_ends_no_flight_in_lockstep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, realtime: bool, waits_s: float
) -> None:
    """One datagram of the bridge, then silence."""
    now = [0.0]

    def select(_read: object, *_rest: object) -> tuple[list[int], list[int], list[int]]:
        now[0] += 1.0
        return ([1] if now[0] == 1.0 else []), [], []

    monkeypatch.setattr(sitl, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(sitl, "select", SimpleNamespace(select=select))
    operator = SimpleNamespace(
        done=False,
        flown=[],
        telemetry=SimpleNamespace(time_s=0.0),
        receive=lambda _data: True,
        step=lambda _now_s: [],
    )
    station = SimpleNamespace(recvfrom=lambda _size: (b"", ("127.0.0.1", 1)))
    processes = SimpleNamespace(check=lambda: None, last_words=lambda: "")
    with pytest.raises(SitlError, match=f"nothing received from the bridge for {waits_s:g} s"):
        sitl._operate(
            cast(Any, operator),
            cast(Any, station),
            cast(Any, processes),
            quietly,
            options(tmp_path, realtime=realtime),
        )
    assert waits_s < now[0] < waits_s + 3.0


def test_who_searches_names_legs_or_none(tmp_path: Path) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    alone = plan(site, values, options(tmp_path, search=True))
    assert [(leg.name, leg.searches) for leg in alone] == [("search", True)]
    more = plan(site, values, options(tmp_path, search=True, legs=("b",)))
    assert [leg.name for leg in more] == ["search", "b"]
    assert "TGL_X" in more[1].parameters


def test_parameters_of_the_module_are_set_with_each_leg(tmp_path: Path) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    held = (("TGL_HOLD", 1.0), ("TGL_ALONG", -0.25))
    legs = plan(site, values, options(tmp_path, legs=("b", "c"), settings=held))
    for leg in legs:
        assert (leg.parameters["TGL_HOLD"], leg.parameters["TGL_ALONG"]) == (1.0, -0.25)
        assert "TGL_X" in leg.parameters
    for wrong, says in ((("TGL_HODL", 1.0), "no such parameter"), (("TGL_HOLD", 3.0), "allowed 0")):
        with pytest.raises(SitlError, match=says):
            plan(site, values, options(tmp_path, settings=(wrong,)))


def test_the_bridge_s_aircraft_has_a_pitot_tube_unless_it_is_to_have_none(tmp_path: Path) -> None:
    for pitot in (True, False):
        asked = options(tmp_path, pitot=pitot)
        words = bridge_command(asked, tmp_path / "truth.csv", "127.0.0.1:9", "127.0.0.1:10", "")
        assert parsed(words[4:]).simulation.pitot == pitot
