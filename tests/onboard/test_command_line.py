"""What each option of `run` asks for, and what it says of a value that it does not take."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from module_process import AIRFRAME, SITE

from tgl_soar.onboard import realtime
from tgl_soar.onboard.command_line import RunOptions, options_of

LINK = "udp:127.0.0.1:14550"
GIGABYTE, MEGABYTE = 10**9, 10**6
MISUSED = 2  # the code of a command line that is not understood, as argparse ends with it


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(realtime, "processors", lambda: {0, 1, 3, 12})
    return tmp_path


def options(*more: str) -> RunOptions:
    return options_of(["--airframe", str(AIRFRAME), "--site", str(SITE), "--link", LINK, *more])


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        options_of(list(arguments))
    assert ended.value.code == MISUSED
    return capsys.readouterr().err


def refused_option(capsys: pytest.CaptureFixture[str], *more: str) -> str:
    words = ("--airframe", str(AIRFRAME), "--site", str(SITE), "--link", LINK)
    return refused(capsys, *words, *more)


# --- what is flown --------------------------------------------------------------------------------


def test_without_options_it_flies_guarded_and_keeps_parameters_and_logs(home: Path) -> None:
    found = options()
    assert found == RunOptions(
        airframe=AIRFRAME,
        site=SITE,
        links=(LINK,),
        state=home / "tgl_soar",
        log=home / "tgl_soar/logs",
        watched=True,
    )._replace(airframe=found.airframe, site=found.site)
    assert Path(found.airframe) == AIRFRAME
    assert Path(found.site) == SITE
    assert found.log_bytes == GIGABYTE
    assert not found.lockstep
    assert found.timeout_s is None
    assert found.realtime == realtime.RealtimeOptions(None, None, False)


def test_who_flies_without_a_command_line_asks_for_nothing_but_the_flight() -> None:
    """Nothing is stored, watched or given up."""
    found = RunOptions(airframe="a", site="s", links=())
    assert (found.lockstep, found.watched, found.state, found.log) == (False, False, None, None)
    assert found.log_bytes == GIGABYTE
    assert not realtime.RealtimeOptions().power_saving


@pytest.mark.parametrize("left_out", ["--airframe", "--site", "--link"])
def test_a_flight_needs(left_out: str, capsys: pytest.CaptureFixture[str]) -> None:
    given = {"--airframe": str(AIRFRAME), "--site": str(SITE), "--link": LINK}
    del given[left_out]
    words = refused(capsys, *(word for pair in given.items() for word in pair))
    assert f"required: {left_out}" in words


def test_shipped_files_are_known_by_their_names() -> None:
    found = options_of(["--airframe", "eclipson_c", "--site", "hill", "--link", LINK])
    assert Path(found.airframe).name == "eclipson_c.toml"
    assert Path(found.site).name == "hill.toml"
    assert Path(found.site).is_file()


def test_links_stand_in_the_order_in_which_they_are_given() -> None:
    assert options("--link", "tcp:a:1", "--link", "tcp:b:2").links == (LINK, "tcp:a:1", "tcp:b:2")


@pytest.mark.parametrize(
    ("words", "field", "value"),
    [
        (("--lockstep",), "lockstep", True),
        (("--timeout", "7.5"), "timeout_s", 7.5),
        (("--mocap-server", "10.0.0.2:1510"), "mocap_server", "10.0.0.2:1510"),
        (("--no-watchdog",), "watched", False),
        (("--lockstep",), "watched", False),  # a simulation is hung up as it likes
        (("--interpreted",), "watched", True),  # which the caller looks at
        (("--log-max", "10"), "log_bytes", 10 * MEGABYTE),
        (("--log-max", "1500.5"), "log_bytes", 1_500_500_000),
    ],
)
def test_an_option_asks_for(words: tuple[str, ...], field: str, value: Any) -> None:
    assert getattr(options(*words), field) == value


def test_an_abbreviated_option_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert "unrecognized arguments: --lock" in refused_option(capsys, "--lock")


# --- where things are kept ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "state", "log"),
    [
        (("--state", "s"), "s", "s/logs"),
        (("--state", "none"), None, None),
        (("--state", "none", "--log", "l"), None, "l"),
        (("--state", "s", "--log", "none"), "s", None),
        (("--state", "s", "--log", "l"), "s", "l"),
    ],
)
def test_logs_lie_beside_the_parameters_unless_it_is_said_where(
    words: tuple[str, ...], state: str | None, log: str | None
) -> None:
    found = options(*words)
    assert found.state == (None if state is None else Path(state))
    assert found.log == (None if log is None else Path(log))


# --- keys -----------------------------------------------------------------------------------------


def test_a_key_signs_and_its_exceptions_are_asked_for_one_by_one() -> None:
    assert options().secret == (None, False, False)
    assert options("--signing-key", "k").secret == (Path("k"), False, False)
    found = options("--signing-key", "k", "--unsigned-autopilot").secret
    assert (found.unsigned_autopilot, found.allow_setup) == (True, False)
    found = options("--signing-key", "k", "--allow-setup-signing").secret
    assert (found.unsigned_autopilot, found.allow_setup) == (False, True)


@pytest.mark.parametrize("option", ["--unsigned-autopilot", "--allow-setup-signing"])
def test_an_exception_without_a_key_is_refused(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"{option}" in refused_option(capsys, option)
    assert "need --signing-key" in refused_option(capsys, option)


# --- the computer ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "spin_us", "power_saving"),
    [
        ((), None, False),
        (("--spin", "0"), 0.0, False),
        (("--spin", "2000"), 2000.0, False),
        (("--power-saving",), 0.0, True),
        (("--power-saving", "--spin", "50"), 50.0, True),
    ],
)
def test_how_long_it_stays_awake(
    words: tuple[str, ...], spin_us: float | None, power_saving: bool
) -> None:
    found = options(*words).realtime
    assert found.spin_s == (None if spin_us is None else pytest.approx(1e-6 * spin_us))
    assert found.power_saving is power_saving


@pytest.mark.parametrize("processor", [0, 3, 12])
def test_a_processor_that_is_there_may_be_asked_for(processor: int) -> None:
    assert options("--cpu", str(processor)).realtime.processor == processor


@pytest.mark.parametrize(
    ("option", "value", "allowed"),
    [
        ("--cpu", "2", "a processor of this computer: 0, 1, 3, 12"),
        ("--cpu", "-1", "a processor of this computer: 0, 1, 3, 12"),
        ("--cpu", "²", "a processor of this computer: 0, 1, 3, 12"),  # a digit, and no number
        ("--cpu", "٣", "a processor of this computer: 0, 1, 3, 12"),
        ("--cpu", "first", "a processor of this computer: 0, 1, 3, 12"),
        ("--spin", "-0.1", "0 to 2000 microseconds"),
        ("--spin", "2000.5", "0 to 2000 microseconds"),
        ("--spin", "nan", "0 to 2000 microseconds"),
        ("--spin", "long", "0 to 2000 microseconds"),
        ("--log-max", "9.9", "a number of megabytes, 10 or more"),
        ("--log-max", "1.1e9", "a number of megabytes, 10 or more"),
        ("--log-max", "inf", "a number of megabytes, 10 or more"),
        ("--log-max", "nan", "a number of megabytes, 10 or more"),
        ("--log-max", "all", "a number of megabytes, 10 or more"),
        ("--timeout", "0", "a number of seconds above 0, 86400 at most; for no limit leave it out"),
        ("--timeout", "86401", "a number of seconds above 0, 86400 at most"),
        ("--timeout", "nan", "a number of seconds above 0, 86400 at most"),
        ("--timeout", "soon", "a number of seconds above 0, 86400 at most"),
    ],
)
def test_what_cannot_be_had_is_reported_with_what_can(
    option: str, value: str, allowed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = refused_option(capsys, f"{option}={value}")
    assert f"argument {option}: {value}: must be {allowed}" in words


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--timeout", "0.001"),
        ("--timeout", "86400"),  # a day
        ("--log-max", "1e9"),
        ("--spin", "1e-3"),
    ],
)
def test_what_is_just_allowed_is_taken(option: str, value: str) -> None:
    found = options(option, value)
    taken = (found.timeout_s, found.log_bytes, found.realtime.spin_s)
    scale = {"--timeout": 1.0, "--log-max": 1e6, "--spin": 1e-6}[option]
    assert any(each == pytest.approx(scale * float(value)) for each in taken if each is not None)


def test_the_help_names_every_option_and_its_default(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        options_of(["--help"])
    assert ended.value.code == 0
    words = " ".join(capsys.readouterr().out.split())
    for option in (
        "--airframe", "--site", "--link", "--lockstep", "--timeout", "--signing-key",
        "--unsigned-autopilot", "--allow-setup-signing", "--state", "--log", "--log-max",
        "--no-watchdog", "--cpu", "--spin", "--power-saving", "--mocap-server", "--interpreted",
    ):  # fmt: skip
        assert f"{option} " in words
    assert "Default: 1000" in words  # megabytes
    assert "at most 200" in words  # microseconds
