"""`tgl-soar sitl` without a flight: what its options mean, what is refused, what is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.cli import sitl as module
from tgl_soar.cli import sitl_table
from tgl_soar.cli.app import app
from tgl_soar.cli.log_argument import newest_log
from tgl_soar.cli.sitl import (
    SitlAutopilot,
    _mocap_settings,
    _numbers,
)
from tgl_soar.cli.sitl_table import progress_of, show_flight
from tgl_soar.config.files import shipped
from tgl_soar.sim.score import LegScore
from tgl_soar.sim.sitl_landing import Landing
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

CLEARED = {"TGL_SOAR_PX4": "", "TGL_SOAR_ARDUPLANE": "", "COLUMNS": "200"}
NAN = float("nan")


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[SitlOptions]:
    """What would have been flown: the flight itself is left out."""
    asked: list[SitlOptions] = []

    def fly(options: SitlOptions) -> Any:
        asked.append(options)
        return SimpleNamespace(scores=[], flown=[], landing=None)

    monkeypatch.setattr(module, "_fly", fly)
    monkeypatch.setattr(module, "_say_what_flies", lambda _options: None)
    monkeypatch.setattr(module, "show_flight", lambda _options, _flight: None)
    monkeypatch.setattr(module, "_write_pages", lambda *_given, **_named: None)
    return asked


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["sitl", *words], env=CLEARED)
    return done.exit_code, done.output


def test_without_options_the_tunnel_is_flown_by_the_bridges_own_pixhawk(
    flown: list[SitlOptions],
) -> None:
    assert run() == (0, "")
    (options,) = flown
    assert options == SitlOptions(
        airframe=shipped("airframes/eclipson_c.toml"),
        site=shipped("sites/tunnel.toml"),
        out=Path("out/sitl"),
    )


def test_each_option_is_what_is_flown_by(flown: list[SitlOptions]) -> None:
    code, output = run(
        *("--legs", " a, c ,", "--stay", "5", "--set", "TGL_HOLD=1", "--set", " RHO_P = 0.5"),
        *("--model", "point-mass", "--seed", "7", "--turbulence", "0.1", "--receiver", "rtk"),
        *("--realtime", "--gcs-local", "127.0.0.1:0", "--fault", "position.dropout start=20 for=1"),
        *("--autopilot-parameter", "A=1", "--survey", "--land", "--launch", "hand"),
        *("--kill-module", "3", "--out", "here"),
    )
    assert (code, output) == (0, "")
    (options,) = flown
    assert options.legs == ("a", "c")
    assert (options.stay_s, options.seed, options.turbulence) == (5.0, 7, 0.1)
    assert options.settings == (("TGL_HOLD", 1.0), ("RHO_P", 0.5))
    assert (options.model, options.receiver) == ("point-mass", "rtk")
    assert (options.realtime, options.gcs_local) == (True, "127.0.0.1:0")
    assert options.faults == ("position.dropout start=20 for=1",)
    assert options.autopilot_parameters == ("A=1",)
    assert (options.search, options.survey, options.kill_s) == (False, True, 3.0)
    assert (options.by_hand, options.goes_home) == (True, True)
    assert options.out == Path("here")


@pytest.mark.parametrize(("words", "site", "mocap"), [
    ((), "tunnel", False),
    (("--search",), "tunnel_search", False),
    (("--mocap", "natnet"), "tunnel_mocap", True),
    (("--mocap", "natnet", "--search"), "tunnel_mocap", True),
    (("--site", "hill"), "hill", False),
    (("--autopilot", "ardupilot", "--ardupilot", "/bin/true"), "tunnel_mocap", True),
    (("--autopilot", "ardupilot", "--ardupilot", "/bin/true", "--site", "hill"), "hill", False),
])  # fmt: skip
def test_the_site_that_fits_is_flown_at(
    words: tuple[str, ...], site: str, mocap: bool, flown: list[SitlOptions]
) -> None:
    assert run(*words)[0] == 0
    (options,) = flown
    assert (options.site, options.mocap) == (shipped(f"sites/{site}.toml"), mocap)


def test_a_firmware_is_flown_by_its_program_and_route(flown: list[SitlOptions]) -> None:
    words = ("--autopilot", "px4", "--px4", "/bin/true", "--route", "attitude")
    assert run(*words)[0] == 0
    (options,) = flown
    assert (options.autopilot, options.firmware) == ("px4", Path("/bin/true"))
    assert options.route == "attitude"
    assert options.mocap_options == ("--mocap-rate=125",)


@pytest.mark.parametrize(("words", "reported"), [
    (("--autopilot", "px4"), "--autopilot px4: its program is not named: build the target"),
    (("--autopilot", "ardupilot"), "its program is not named: build ArduPlane 4.6 or newer"),
    (("--ardupilot", "/bin/true"), "--ardupilot: is flown with --autopilot ardupilot only"),
    (("--autopilot", "px4", "--px4", "/bin/true", "--ardupilot", "/bin/true"),
     "--ardupilot: is flown with --autopilot ardupilot only"),
    (("--route", "attitude"), "--route attitude: the bridge's own Pixhawk has only one route"),
    (("--receiver", "rtk", "--autopilot", "px4", "--px4", "/bin/true"),
     "--receiver rtk: a real firmware has its own"),
    (("--gcs-local", "127.0.0.1:1"), "ground stations join in real time only; add --realtime"),
    (("--mocap-option", "loss=0.1"), "--mocap-option loss=0.1: there is no motion capture"),
    (("--set", "TGL_HOLD"), "--set TGL_HOLD: write NAME=NUMBER, such as TGL_HOLD=1"),
    (("--set", "TGL_HOLD=x"), "--set TGL_HOLD=x: write NAME=NUMBER"),
    (("--fault", "no.such start=1"), "--fault: "),
    (("--page", "--autopilot", "px4", "--px4", "/bin/true"),
     "--page --autopilot px4: the page flies with the bridge's own Pixhawk"),
    (("--launch", "hand", "--autopilot", "px4", "--px4", "/bin/true"),
     "--launch hand --autopilot px4: a real firmware is launched in the air"),
    (("--page", "--land"), "--page --land: beside the page nobody but its user lands"),
])  # fmt: skip
def test_what_does_not_go_together_is_refused_before_the_flight(
    words: tuple[str, ...], reported: str, flown: list[SitlOptions]
) -> None:
    code, output = run(*words)
    assert code == 2
    assert reported in output
    assert flown == []


def test_in_real_time_and_with_the_page_ground_stations_join(
    flown: list[SitlOptions], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("--realtime", "--gcs-local", "127.0.0.1:0")[0] == 0
    hosted: list[tuple[SitlOptions, int]] = []
    monkeypatch.setattr(module, "_host", lambda options, port: hosted.append((options, port)))
    assert run("--page", "--page-port", "0", "--gcs-local", "127.0.0.1:0")[0] == 0
    ((options, port),) = hosted
    assert (options.realtime, port) == (True, 0)
    assert len(flown) == 2


@pytest.mark.parametrize(("ends", "code", "words"), [
    (KeyboardInterrupt(), 0, "ended; its logs are in here/logs"),
    (SitlError("no way"), 2, "error: no way"),
])  # fmt: skip
def test_a_flight_beside_the_page_says_where_to_engage_and_where_its_logs_are(
    ends: BaseException, code: int, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def host(options: SitlOptions, port: int, announce: Callable[[str], None]) -> None:
        assert (options.out, port) == (Path("here"), 8191)
        announce("http://127.0.0.1:8191/#token=t")
        raise ends

    monkeypatch.setattr("tgl_soar.sim.sitl_page.host", host)
    found, output = run("--page", "--out", "here")
    assert found == code
    assert output.splitlines()[0].startswith("computing the air, and seeking gains")
    assert output.splitlines()[1:] == [
        "the operator's page: http://127.0.0.1:8191/#token=t",
        "engage there; Ctrl-C ends it",
        words,
    ]


def test_a_leg_that_did_not_settle_is_an_exit_code(
    flown: list[SitlOptions], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert flown == []
    ended = SimpleNamespace(
        scores=[SimpleNamespace(settled=False)],
        flown=[SimpleNamespace(by_hand=False, broken_off=False, released="")],
        landing=None,
    )
    monkeypatch.setattr(module, "_fly", lambda _options: ended)
    shown: list[Any] = []
    monkeypatch.setattr(module, "show_flight", lambda _options, flight: shown.append(flight))
    code, output = run()
    assert (code, "a leg did not settle" in output) == (1, True)
    assert shown == [ended]
    ended.flown[0].by_hand = True
    assert run() == (0, "")
    ended.flown[0].leg, ended.flown[0].released = SimpleNamespace(name="b"), "too low"
    code, output = run()
    assert (code, output.split()) == (
        1,
        ["error:", "b:", "the", "module", "disengaged:", "too", "low"],
    )
    ended.flown[0].released = ""
    ended.landing = Landing(time_s=30.0, along_m=4.7, across_m=0.4, sink_mps=0.7)
    assert run() == (0, "")
    ended.landing = Landing(time_s=30.0, along_m=-12.0, across_m=0.4, sink_mps=0.7)
    code, output = run()
    assert code == 1
    assert "error: landed 12.0 m short of the place, 0.4 m across, sink 0.70 m/s; 10 m" in output


def test_the_faults_are_listed_and_nothing_flies(flown: list[SitlOptions]) -> None:
    code, output = run("--fault", "list")
    assert code == 0
    assert "position.dropout" in output
    assert flown == []


@pytest.mark.parametrize("autopilot", [(), ("--autopilot", "ardupilot", "--ardupilot", "true")])
def test_a_sensor_of_px4_fails_with_px4_alone(
    autopilot: tuple[str, ...], flown: list[SitlOptions]
) -> None:
    code, output = run("--fault", "compass.bias start=2 for=5 x=500", *autopilot)
    assert (code, flown) == (2, [])
    assert "--fault compass.bias: only a PX4" in output


@pytest.mark.parametrize(("error", "code", "words"), [
    (SitlError("no way"), 2, "error: no way"), (KeyboardInterrupt(), 130, "stopped"),
    (OSError(28, "No space left on device", "x.ulg"), 2,
     "--out here: x.ulg cannot be written: No space left on device"),
    (OSError(28, "No space left on device"), 2,
     "--out here: here cannot be written: No space left on device"),
])  # fmt: skip
def test_a_flight_that_ends_early_says_why(
    error: BaseException, code: int, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_given: Any) -> Any:
        raise error

    monkeypatch.setattr("tgl_soar.sim.sitl.fly", fails)
    monkeypatch.setattr(module, "_say_what_flies", lambda _options: None)
    found, output = run("--out", "here")
    assert (found, words in output) == (code, True), output


def test_a_rate_that_px4_can_keep_stands_before_what_is_given() -> None:
    px4, builtin = SitlAutopilot.PX4, SitlAutopilot.BUILTIN
    given = ["rate=100", "loss=0.1"]
    assert _mocap_settings(given, px4, by_mocap=True) == (
        *("--mocap-rate=125", "--mocap-rate=100", "--mocap-loss=0.1"),
    )
    assert _mocap_settings(given, builtin, by_mocap=True) == (
        *("--mocap-rate=100", "--mocap-loss=0.1"),
    )
    assert _mocap_settings([], px4, by_mocap=False) == ()
    with pytest.raises(typer.Exit):
        _mocap_settings(given, builtin, by_mocap=False)
    assert _numbers(["A=1", "B = -2.5"]) == (("A", 1.0), ("B", -2.5))


# --- what is shown -----------------------------------------------------------------------------


def score(name: str, **more: float) -> LegScore:
    numbers = {
        "settling_s": 3.25, "rms_e_rho_m": 0.0123, "peak_e_rho_m": 0.045, "mean_x_m": 0.0,
        "mean_z_m": 0.0, "dispersion_m": 0.056, "crossing_m": 0.067,
    }  # fmt: skip
    return LegScore(name=name, **{**numbers, **more})


def test_the_legs_are_shown_in_centimetres(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sitl_table, "console", Console(width=200))
    scores = [
        score("a"),
        score("b", settling_s=float("inf"), crossing_m=NAN),
        score("c"),
    ]
    flight: Any = SimpleNamespace(
        scores=scores,
        flown=[
            SimpleNamespace(by_hand=by_hand, broken_off=False, released="")
            for by_hand in (False, False, True)
        ],
        landing=None,
        notes=("a note [of brackets]",),
        truth={"time_s": [0.0, 30.0, 61.6]},
        wall_s=12.4,
    )
    show_flight(SitlOptions(Path("a"), Path("s"), Path("here")), flight)
    output = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    rows = [row for row in rows if row and row[0] in ("a", "b", "c")]
    assert rows == [
        ["a", "3.2 s", "1.23 cm", "4.5 cm", "5.6 cm", "6.7 cm"],
        ["b", "not held", "1.23 cm", "4.5 cm", "5.6 cm", "–"],
        ["c", "moved by hand", "1.23 cm", "4.5 cm", "5.6 cm", "6.7 cm"],
    ]
    assert "a note [of brackets]\n" in output
    assert "from the line's stop to 2 s with e_rho within 5 cm; rms and peak leave out" in output
    assert "ZEUC: the contour where updraft equals sink; TGL ∩ ZEUC: where the line" in output
    assert output.endswith("62 s of flight in 12 s; logs and figure in here/\n")


@pytest.mark.parametrize(("settles", "cell"), [(3.25, "3.2 s"), (float("inf"), "broken off")])
def test_a_leg_that_a_landing_has_ended_is_shown_with_the_landing(
    settles: float,
    cell: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sitl_table, "console", Console(width=200))
    leg: Any = SimpleNamespace(by_hand=False, broken_off=True, released="")
    flight: Any = SimpleNamespace(
        scores=[score("a", settling_s=settles)],
        flown=[leg],
        notes=(),
        truth={"time_s": [0.0, 30.0]},
        wall_s=12.4,
        landing=Landing(time_s=30.0, along_m=4.7, across_m=0.4, sink_mps=0.7),
    )
    show_flight(SitlOptions(Path("a"), Path("s"), Path("here")), flight)
    output = capsys.readouterr().out
    assert f"│ {cell} " in output
    assert "landed 4.7 m beyond the place, 0.4 m across, sink 0.70 m/s\n" in output


@pytest.mark.parametrize(("values", "cells"), [
    ({}, ["–"] * 6),
    ({"soar_mode": 4.0, "e_rho": 0.0312, "soar_x": 0.256, "soar_z": 1.2, "updraft": 0.75,
      "sink": 1.5}, ["soaring", "+0.031 m", "0.26 m", "1.20 m", "0.75 m/s", "1.50 m/s"]),
    ({"soar_mode": NAN}, ["–"] * 6),
])  # fmt: skip
def test_a_line_of_progress(values: dict[str, float], cells: list[str]) -> None:
    operator: Any = SimpleNamespace(
        telemetry=SimpleNamespace(values=values, time_s=12.34),
        flown=[SimpleNamespace(leg=SimpleNamespace(name=name)) for name in "ab"],
    )
    table = progress_of(operator)
    shown = [next(iter(column.cells)) for column in table.columns]
    assert shown == ["12.3 s", "b", *cells]
    operator.flown = []
    assert list(progress_of(operator).columns[1].cells) == ["–"]


def test_without_a_log_there_is_no_newest(tmp_path: Path) -> None:
    assert newest_log(tmp_path) is None
