"""The bridge's command line: what each option becomes, what each number may be, and what stands
for a choice that was not made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tgl_soar.config.files import load_site, shipped
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.bridge.mocap import MocapOptions, motive_server
from tgl_soar.sim.bridge.options import BridgeOptions, FirmwareOptions, Pace, PortOptions
from tgl_soar.sim.motive import HallFault, MotiveOptions
from tgl_soar.sim.simulation import Options, TimedSetting

FILES = ["--airframe", "eclipson_c", "--site", "tunnel"]
MOCAP = ["--mocap", "natnet"]


def given(*words: str) -> BridgeOptions:
    return parsed([*FILES, *words])


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as ended:
        given(*words)
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_the_defaults_are_a_held_flight_in_real_time_at_the_usual_ports() -> None:
    assert Options() == Options(
        model=None,
        seed=1,
        turbulence=None,
        step_hz=200,
        pilot=True,
        held=True,
        armed=True,
        truth=True,
        uptime_s=0.0,
        allow_odometry=False,
        faults=(),
        pitot=True,
        receiver="local",
        rangefinder=False,
        parameters=(),
        later=(),
        record=None,
        log=None,
        log_hz=50,
    )
    assert Pace() == Pace(
        lockstep=False,
        lockstep_ground=False,
        duration_s=None,
        patience_s=5.0,
        start_timeout_s=30.0,
    )
    assert PortOptions() == PortOptions(
        ground=(("127.0.0.1", 14550),),
        companion=("127.0.0.1", 14540),
        ground_local=("127.0.0.1", 18570),
        companion_local=("127.0.0.1", 14580),
    )
    plain = given()
    assert (plain.firmware, plain.mocap) == (None, None)


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        (["--model", "rigid-body"], {"model": "rigid_body"}),
        (["--seed", "7"], {"seed": 7}),
        (["--turbulence", "0.03"], {"turbulence": 0.03}),
        (["--step-rate", "400"], {"step_hz": 400}),
        (["--pilot", "none"], {"pilot": False}),
        (["--launch", "free"], {"held": False}),
        (["--launch", "hand"], {"by_hand": True}),
        (["--launch", "bench"], {"armed": False}),
        (["--no-truth"], {"truth": False}),
        (["--uptime", "12.5"], {"uptime_s": 12.5}),
        (["--odometry"], {"allow_odometry": True}),
        (["--no-pitot"], {"pitot": False}),
        (["--rangefinder"], {"rangefinder": True}),
        (["--receiver", "rtk"], {"receiver": "rtk"}),
        (["--record", "x.tlog"], {"record": Path("x.tlog")}),
        (["--log", "x.csv", "--log-rate", "20"], {"log": Path("x.csv"), "log_hz": 20}),
        (["--autopilot-parameter", "A=1.5"], {"parameters": (("A", 1.5),)}),
    ],
)
def test_an_option_of_the_simulation_is_what_it_says(
    words: list[str], changes: dict[str, Any]
) -> None:
    assert given(*words).simulation == Options(**changes)


def test_a_fault_may_be_given_several_times() -> None:
    faults = given(
        *("--fault", "position.dropout start=20 for=1.5"),
        *("--fault", "imu.dropout start=3 for=1"),
    ).simulation.faults
    assert [fault.kind.name for fault in faults] == ["position.dropout", "imu.dropout"]


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        (["--speed", "lockstep"], {"lockstep": True}),
        (["--lockstep-gcs"], {"lockstep_ground": True}),
        (["--duration", "9.5"], {"duration_s": 9.5}),
        (["--patience", "0.5"], {"patience_s": 0.5}),
        (["--start-timeout", "2"], {"start_timeout_s": 2.0}),
    ],
)
def test_an_option_of_the_pace_is_what_it_says(words: list[str], changes: dict[str, Any]) -> None:
    assert given(*words).pace == Pace(**changes)


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        (["--gcs", "127.0.0.1:1", "--gcs", "h:2"], {"ground": (("127.0.0.1", 1), ("h", 2))}),
        (["--companion", "h:65535"], {"companion": ("h", 65535)}),
        (["--gcs-local", "0.0.0.0:0"], {"ground_local": ("0.0.0.0", 0)}),
        (["--companion-local", "::1:5"], {"companion_local": ("::1", 5)}),
    ],
)
def test_an_address_is_a_host_and_a_port(words: list[str], changes: dict[str, Any]) -> None:
    assert given(*words).ports == PortOptions(**changes)


@pytest.mark.parametrize("address", ["14550", ":14550", "host:", "host:x", "h:65536", "h:-1", ""])
def test_what_is_no_address_is_refused_with_an_example(
    capsys: pytest.CaptureFixture[str], address: str
) -> None:
    error = refused(capsys, "--companion", address)
    assert f"{address!r}: write HOST:PORT, such as 127.0.0.1:14550" in error


@pytest.mark.parametrize(
    ("option", "low", "high"),
    [
        ("--turbulence", "0", "0.5"),
        ("--duration", "0", "1e+09"),
        ("--uptime", "0", "1e+07"),
        ("--patience", "0.1", "3600"),
        ("--start-timeout", "0.1", "3600"),
    ],
)
def test_a_number_is_taken_to_both_ends_of_its_range(
    capsys: pytest.CaptureFixture[str], option: str, low: str, high: str
) -> None:
    given(option, low)
    given(option, high)
    below, above = f"{float(low) - 1e-3:g}", f"{float(high) * 1.001:g}"
    for bad in (below, above, "nan", "some"):
        error = refused(capsys, f"{option}={bad}")
        assert f"{bad!r}: a number from {low} to {high}" in error


@pytest.mark.parametrize(
    ("option", "low", "high"), [("--log-rate", 1, 400), ("--seed", 0, 9223372036854775808)]
)
def test_a_whole_number_is_taken_to_both_ends_of_its_range(
    capsys: pytest.CaptureFixture[str], option: str, low: int, high: int
) -> None:
    given(option, str(low))
    given(option, str(high))
    for bad in (str(low - 1), str(high + 1), "1.5", "x"):
        error = refused(capsys, f"{option}={bad}")
        assert f"{bad!r}: a whole number from {low} to {high}" in error


@pytest.mark.parametrize("rate", ["100", "201", "0"])
def test_steps_are_200_or_400_a_second(capsys: pytest.CaptureFixture[str], rate: str) -> None:
    assert given("--step-rate", "200").simulation.step_hz == 200
    assert "--step-rate" in refused(capsys, "--step-rate", rate)


def test_which_files_are_needed_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    for i, option in ((2, "--airframe"), (0, "--site")):
        with pytest.raises(SystemExit):
            parsed(FILES[i : i + 2])
        assert f"required: {option}" in capsys.readouterr().err


def test_a_wrong_fault_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert "positon.dropout" in refused(capsys, "--fault", "positon.dropout start=1 for=1")


# --- a firmware -----------------------------------------------------------------------------------


def test_a_firmware_has_a_program_a_folder_and_a_mission() -> None:
    firmware = given("--autopilot", "px4").firmware
    assert firmware == FirmwareOptions(
        name="px4", program=None, folder=Path("out/firmware"), mission=None
    )
    words = ["--firmware", "p", "--firmware-folder", "f", "--mission", "m"]
    firmware = given("--autopilot", "ardupilot", *words).firmware
    assert firmware == FirmwareOptions(
        name="ardupilot", program=Path("p"), folder=Path("f"), mission=Path("m")
    )


def test_a_parameter_of_a_firmware_may_be_set_later() -> None:
    words = ["--autopilot-parameter", " A =1", "--autopilot-parameter", "B=2@30"]
    words += ["--autopilot-parameter", "C=3@0.5"]
    simulation = given("--autopilot", "px4", *words).simulation
    assert simulation.parameters == (("A", 1.0),)
    assert simulation.later == (TimedSetting("B", 2.0, 30.0), TimedSetting("C", 3.0, 0.5))


def test_the_simulated_pixhawk_takes_parameters_at_the_start_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    error = refused(capsys, "--autopilot-parameter", "B=2@30")
    assert "--autopilot-parameter NAME=NUMBER@SECONDS needs a firmware: --autopilot" in error
    assert given("--autopilot-parameter", "B=2@0").simulation.parameters == (("B", 2.0),)


@pytest.mark.parametrize("autopilot", [[], ["--autopilot", "ardupilot"]])
def test_sensors_that_the_bridge_does_not_simulate_cannot_fail(
    autopilot: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    fault = ["--fault", "compass.bias start=2 for=5 x=500"]
    assert "--fault compass.bias: only a PX4" in refused(capsys, *autopilot, *fault)
    (given_to_px4,) = given("--autopilot", "px4", *fault).simulation.faults
    assert given_to_px4.kind.name == "compass.bias"


@pytest.mark.parametrize("text", ["A=1e39@5", "A=nan", "A=inf", "A=3@-1", "A=3@nan", "A=3@inf"])
def test_a_setting_that_would_never_be_made_is_refused(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    error = refused(capsys, "--autopilot", "px4", "--autopilot-parameter", text)
    assert f"{text!r}: NUMBER must be one of 32 bits, and SECONDS finite and not negative" in error


@pytest.mark.parametrize("text", ["A", "A=", "A=x", "A=1@x", "A=1@2@3"])
def test_what_is_no_setting_is_refused_with_an_example(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    error = refused(capsys, "--autopilot-parameter", text)
    assert f"{text!r}: write NAME=NUMBER, such as SYSID_MYGCS=255, or NAME=NUMBER@S" in error


def test_a_firmware_has_its_own_receiver(capsys: pytest.CaptureFixture[str]) -> None:
    error = refused(capsys, "--autopilot", "px4", "--receiver", "satellites")
    assert "--receiver satellites: a firmware has its own" in error
    assert given("--autopilot", "px4", "--receiver", "local").firmware is not None


# --- motion capture -------------------------------------------------------------------------------


def test_a_hall_streams_as_motive_does_by_default() -> None:
    assert given(*MOCAP).mocap == MocapOptions(
        "127.0.0.1:1510",
        MotiveOptions(
            version=(4, 1),
            rate_hz=100,
            latency_s=0.01,
            jitter_s=0.0,
            noise_m=0.0005,
            loss=0.0,
            faults=(),
            seed=1,
            restarted_clock=True,
        ),
    )


def test_each_option_of_the_hall_is_what_it_says() -> None:
    words = [
        *("--mocap-local", "127.0.0.1:0", "--mocap-version", "3.1", "--mocap-rate", "50"),
        *("--mocap-latency", "0.02", "--mocap-jitter", "0.003", "--mocap-noise", "0.004"),
        *("--mocap-loss", "0.05", "--mocap-fault", "untracked:10:11.5", "--seed", "9"),
        *("--mocap-fault", "jump:0:1", "--speed", "lockstep"),
    ]
    assert given(*MOCAP, *words).mocap == MocapOptions(
        "127.0.0.1:0",
        MotiveOptions(
            version=(3, 1),
            rate_hz=50,
            latency_s=0.02,
            jitter_s=0.003,
            noise_m=0.004,
            loss=0.05,
            faults=(HallFault("untracked", 10.0, 11.5), HallFault("jump", 0.0, 1.0)),
            seed=9,
            restarted_clock=False,  # in lockstep every clock is the vehicle's
        ),
    )


@pytest.mark.parametrize(
    "text", ["untracked", "untracked:1", "untracked:1:2:3", "blind:1:2", "jump:2:2", "jump:-1:2"]
)
def test_what_is_no_fault_of_a_hall_is_refused_with_an_example(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    error = refused(capsys, *MOCAP, "--mocap-fault", text)
    assert f"{text!r}: write KIND:FROM:UNTIL, such as untracked:10:11.5, KIND one of" in error
    assert "silent, untracked, frozen, vanish, jump, swap, late, restart" in error


@pytest.mark.parametrize("option", ["latency", "jitter", "noise", "loss"])
def test_a_number_of_the_hall_is_from_0_to_1(option: str) -> None:
    site = load_site(shipped("sites/tunnel_mocap.toml")).mocap
    assert site is not None
    for value in ("-0.001", "1.001", "nan"):
        options = given(*MOCAP, "--mocap-local", "127.0.0.1:0", f"--mocap-{option}={value}").mocap
        assert options is not None
        with pytest.raises(ValueError, match=f"--mocap-{option} {value}: a number from 0 to 1"):
            motive_server(options, site, lambda: 0.0, step_hz=200)
    for value in ("0", "1"):
        options = given(*MOCAP, "--mocap-local", "127.0.0.1:0", f"--mocap-{option}={value}").mocap
        assert options is not None
        motive_server(options, site, lambda: 0.0, step_hz=200).close()


@pytest.mark.parametrize("local", ["1510", ":1510", "127.0.0.1:x"])
def test_the_halls_own_port_is_an_address(local: str) -> None:
    site = load_site(shipped("sites/tunnel_mocap.toml")).mocap
    assert site is not None
    with pytest.raises(ValueError, match=f"--mocap-local '{local}': write HOST:PORT"):
        motive_server(MocapOptions(local, MotiveOptions()), site, lambda: 0.0, step_hz=200)


def test_the_site_file_says_how_the_hall_streams() -> None:
    site = load_site(shipped("sites/tunnel_mocap.toml")).mocap
    assert site is not None
    options = MocapOptions("127.0.0.1:0", MotiveOptions(multicast=True))
    server = motive_server(options, site, lambda: 0.0, step_hz=200)
    made = server.motive.options
    server.close()
    assert not made.multicast  # unicast, it says
    assert (made.group, made.data_port) == ("239.255.42.99", 1511)
