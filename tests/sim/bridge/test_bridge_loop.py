"""How the bridge lets time go on: what a step takes in and gives out, when it is over, by the clock
and in lockstep, and how its program ends."""

from __future__ import annotations

import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.config.files import ConfigError, shipped
from tgl_soar.onboard import realtime
from tgl_soar.sim.bridge import bridge as module
from tgl_soar.sim.bridge import process
from tgl_soar.sim.bridge.bridge import Bridge
from tgl_soar.sim.bridge.lockstep import BridgeError, Lockstep
from tgl_soar.sim.bridge.mocap import MocapOptions, motive_server
from tgl_soar.sim.bridge.options import BridgeOptions, FirmwareOptions, Pace, PortOptions
from tgl_soar.sim.bridge.slowness import TOO_SLOW, Slowness
from tgl_soar.sim.bridge.traffic import Traffic
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.motive import BEGAN_S, MotiveOptions
from tgl_soar.sim.ports import PortError, Ports
from tgl_soar.sim.simulation import Options, Simulation
from tgl_soar.sim.truth_log import TruthLogError

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
HALL = shipped("sites/tunnel_mocap.toml")
ANYWHERE = ("127.0.0.1", 0)
PORTS = PortOptions(ground_local=ANYWHERE, companion_local=ANYWHERE)


class Run:
    """A bridge on a clock of our own, and all that it did, in order."""

    def __init__(self, patched: pytest.MonkeyPatch, *, site: Path = SITE, **options: Any) -> None:
        self.now_s = 50.0
        self.took_s: dict[int, float] = {}  # steps that take longer than a millisecond
        self.done: list[str] = []
        self.reports: list[str] = []
        self.mail = 0
        patched.setattr(module, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        patched.setattr(realtime, "_set_priority", lambda _priority: True)
        patched.setattr(Ports, "wait", self._wait)
        patched.setattr(Traffic, "report", lambda _, text: self.reports.append(text))
        options.setdefault("pace", Pace(duration_s=0.05))
        self.bridge = Bridge(BridgeOptions(AIRFRAME, site, ports=PORTS, **options))
        assert isinstance(self.bridge.simulation, Simulation)
        self.simulation: Simulation = self.bridge.simulation
        step = self.simulation.step

        def slow() -> None:
            self.done.append("step")
            step()
            self.now_s += self.took_s.get(self.simulation.world.steps, 0.001)

        patched.setattr(self.simulation, "step", slow)
        for name in ("deliver", "serve_mocap", "expose", "flush", "serve"):
            self.watch(patched, Traffic, name)
        drain = Traffic.drain

        def drained(traffic: Traffic, port: Any) -> None:
            self.done.append("drain ground" if port.ground else "drain companion")
            drain(traffic, port)

        patched.setattr(Traffic, "drain", drained)

    def watch(self, patched: pytest.MonkeyPatch, owner: Any, name: str) -> None:
        plain = getattr(owner, name)

        def watched(self_: Any, *arguments: Any, **named: Any) -> Any:
            self.done.append(name)
            return plain(self_, *arguments, **named)

        patched.setattr(owner, name, watched)

    def _wait(self, seconds: float, *_which: Any) -> bool:
        if self.mail:
            self.mail -= 1
            self.now_s += 0.001
            return True
        self.now_s += seconds
        return False


def test_a_step_takes_in_first_and_shows_the_aircraft_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Run(monkeypatch, pace=Pace(duration_s=0.005))
    run.bridge.run()
    run.bridge.close()
    begun = run.done.index("deliver")
    assert run.done[begun:] == ["deliver", "serve_mocap", "step", "expose", "flush"]
    assert run.done[:begun] == ["drain companion", "drain ground"]


def test_by_the_clock_every_step_has_its_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """200 steps of 5 ms, the first at once."""
    run = Run(monkeypatch, pace=Pace(duration_s=1.0))
    run.took_s = {100: 0.02}  # four steps late: caught up with
    run.bridge.run()
    assert run.simulation.world.steps == 200
    assert run.now_s == pytest.approx(50.0 + 199 * 0.005 + 0.001)
    assert run.bridge.wall_s == pytest.approx(199 * 0.005 + 0.001)
    assert run.bridge.slowness.given_up_s == 0.0
    assert run.reports == []
    run.bridge.close()


@pytest.mark.parametrize(("late_steps", "given_up"), [(4.5, False), (5.5, True)])
def test_more_than_five_steps_are_given_up(
    monkeypatch: pytest.MonkeyPatch, late_steps: float, given_up: bool
) -> None:
    """The aircraft's clock runs on by as much as is given up."""
    run = Run(monkeypatch, pace=Pace(duration_s=1.0))
    late_s = 0.005 * late_steps
    run.took_s = {100: 0.005 + late_s}
    run.bridge.run()
    lost_s = late_s if given_up else 0.0
    assert run.bridge.slowness.given_up_s == pytest.approx(lost_s)
    assert run.now_s == pytest.approx(50.0 + 199 * 0.005 + 0.001 + lost_s)
    assert run.simulation.pixhawk.boot_ms == pytest.approx(1000 + 1000 * lost_s, abs=1)
    run.bridge.close()


def test_what_arrives_before_a_deadline_is_served(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, pace=Pace(duration_s=0.01))
    run.mail = 2
    run.bridge.run()
    assert run.done.count("serve") == 2
    assert run.done.count("flush") == 2 + 2  # after each, and after each step
    run.bridge.close()


def test_it_is_over_at_the_step_nearest_to_its_duration(monkeypatch: pytest.MonkeyPatch) -> None:
    for duration_s, steps in ((0.0, 0), (0.0024, 0), (0.0026, 1), (0.05, 10), (0.0524, 10)):
        run = Run(monkeypatch, pace=Pace(duration_s=duration_s))
        run.bridge.run()
        assert run.simulation.world.steps == steps
        run.bridge.close()


def test_without_a_duration_it_runs_until_it_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Run(monkeypatch, pace=Pace())
    step = run.simulation.step

    def counted() -> None:
        step()
        if run.simulation.world.steps == 30:
            run.bridge.stop(signal.SIGTERM, None)

    monkeypatch.setattr(run.simulation, "step", counted)
    assert not run.bridge.stopping
    run.bridge.run()
    assert run.simulation.world.steps == 30
    assert run.bridge.stopping
    run.bridge.close()


def test_the_summary_counts_steps_time_crashes_and_what_was_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Run(monkeypatch, pace=Pace(duration_s=0.5))
    assert "0.00 s (0.0 x real time)" in run.bridge.summary()
    run.bridge.run()
    run.bridge.wall_s = 0.25
    assert run.bridge.summary() == (
        "100 steps, 0.500 s simulated in 0.25 s (2.0 x real time);"
        " overrides: 0 accepted, 0 refused, 0 timed out; 0 crashes; 0.00 s given up"
    )
    run.bridge.close()


# --- lockstep -------------------------------------------------------------------------------------


class Participants:
    """Lockstep's part of a bridge: which is missing, how many steps, and when each side is met."""

    def __init__(self, patched: pytest.MonkeyPatch, run: Run, missing: int = 0) -> None:
        self.met: list[tuple[str, int]] = []
        self._run, self.missing = run, missing
        patched.setattr(Lockstep, "gather", lambda _: self.meet("gather"))
        patched.setattr(Lockstep, "meet_companions", lambda _: self.meet("companions"))
        patched.setattr(Lockstep, "meet_stations", lambda _: self.meet("stations"))
        patched.setattr(Lockstep, "readmit", lambda _: self._readmit())
        patched.setattr(
            Lockstep, "is_peer_missing", property(lambda _: self.missing > 0), raising=True
        )

    def meet(self, who: str) -> None:
        self.met.append((who, self._run.simulation.world.steps))

    def _readmit(self) -> None:
        self.missing -= 1


def test_in_lockstep_companions_are_met_after_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch, pace=Pace(lockstep=True, duration_s=0.02))
    participants = Participants(monkeypatch, run)
    run.bridge.run()
    assert participants.met == [("gather", 0), *(("companions", i) for i in range(1, 5))]
    assert run.now_s == pytest.approx(50.004)  # no time is waited for
    assert run.done.count("drain ground") == run.done.count("flush") == 4
    run.bridge.close()


@pytest.mark.parametrize(("step_hz", "every"), [(200, 10), (400, 20)])
def test_stations_are_met_every_50_ms_where_they_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, step_hz: int, every: int
) -> None:
    run = Run(
        monkeypatch,
        pace=Pace(lockstep=True, lockstep_ground=True, duration_s=0.1),
        simulation=Options(step_hz=step_hz),
    )
    participants = Participants(monkeypatch, run)
    run.bridge.run()
    stations = [step for who, step in participants.met if who == "stations"]
    assert stations == [every, 2 * every]
    assert "drain ground" not in run.done
    run.bridge.close()


def test_while_a_peer_is_missing_time_goes_on_at_its_natural_pace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Run(monkeypatch, pace=Pace(lockstep=True, duration_s=0.1))
    run.took_s = {5: 0.2}  # the autopilot's clock does not count that
    participants = Participants(monkeypatch, run, missing=10)
    run.bridge.run()
    assert [who for who, _ in participants.met].count("companions") == 20
    # Ten by the clock, the fifth of which ends 0.2 s after its deadline at 15 ms, and a deadline
    # later there is no haste to catch up: four more of 5 ms.  The other ten take 1 ms each.
    assert run.now_s - 50.0 == pytest.approx(0.215 + 4 * 0.005 + 10 * 0.001)
    assert run.bridge.slowness.given_up_s == 0.0
    assert run.simulation.pixhawk.boot_ms == 100
    run.bridge.close()


# --- a hall ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_halls_clock_is_simulated_time_in_lockstep_else_a_computers(
    monkeypatch: pytest.MonkeyPatch, lockstep: bool
) -> None:
    """It has been on for BEGAN_S longer."""
    clocks: list[Any] = []

    def made(options: Any, site: Any, clock_s: Any, *, step_hz: int) -> Any:
        assert step_hz == 200
        clocks.append(clock_s)
        return motive_server(options, site, clock_s, step_hz=step_hz)

    monkeypatch.setattr(module, "motive_server", made)
    run = Run(
        monkeypatch,
        site=HALL,
        pace=Pace(lockstep=lockstep, duration_s=0.05),
        simulation=Options(uptime_s=300.0),
        mocap=MocapOptions("127.0.0.1:0", MotiveOptions()),
    )
    Participants(monkeypatch, run)
    run.bridge.run()
    assert BEGAN_S == 5000.0
    expected = 300.05 if lockstep else 5000.0 + run.now_s
    assert clocks[0]() == pytest.approx(expected)
    run.bridge.close()


# --- a firmware -----------------------------------------------------------------------------------


def test_a_firmware_without_a_program_is_refused() -> None:
    with pytest.raises(ValueError, match="--autopilot px4: give its program with --firmware"):
        Bridge(
            BridgeOptions(
                AIRFRAME, SITE, ports=PORTS, firmware=FirmwareOptions(name="px4", program=None)
            )
        )


def test_a_firmware_that_has_not_booted_is_stepped_until_it_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Run(monkeypatch, pace=Pace(duration_s=0.02))
    booted = property(lambda simulation: simulation.world.steps >= 3)
    monkeypatch.setattr(Simulation, "booted", booted)
    run.bridge.run()
    step = ["deliver", "serve_mocap", "step", "expose"]
    assert run.done[:7] == [*step, "drain ground", "drain companion", "flush"]
    assert run.simulation.world.steps == 4
    run.bridge.close()


def test_who_stops_it_does_not_wait_for_a_boot(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(monkeypatch)
    monkeypatch.setattr(Simulation, "booted", property(lambda _: False))
    run.bridge.stop()
    run.bridge.run()
    assert run.simulation.world.steps == 0
    run.bridge.close()


# --- the program ----------------------------------------------------------------------------------

WORDS = ["--airframe", "eclipson_c", "--site", "tunnel", "--log", "x.csv"]


class Program:
    """What `main` makes of a bridge that fails in some way."""

    def __init__(self, patched: pytest.MonkeyPatch) -> None:
        self.opens: Exception | None = None
        self.runs: Exception | None = None
        self.closes: Exception | None = None
        self.did: list[str] = []
        patched.setattr(process, "Bridge", self._open)
        patched.setattr(signal, "signal", self._on)
        self.signals: dict[int, Any] = {}

    def _on(self, number: int, handler: Any) -> None:
        self.signals[number] = handler

    def _open(self, _options: Any) -> Any:
        if self.opens is not None:
            raise self.opens
        return self

    def stop(self, *_: object) -> None:
        self.did.append("stop")

    def run(self) -> None:
        self.did.append("run")
        if self.runs is not None:
            raise self.runs

    def close(self) -> None:
        self.did.append("close")
        if self.closes is not None:
            raise self.closes

    def summary(self) -> str:
        return "the summary"


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch) -> Program:
    return Program(monkeypatch)


def test_a_flight_that_is_over_ends_with_0_and_its_summary(
    program: Program, capsys: pytest.CaptureFixture[str]
) -> None:
    assert process.main(WORDS) == 0
    assert program.did == ["run", "close"]
    assert capsys.readouterr().out == "the summary\n"
    assert program.signals == {
        signal.SIGTERM: program.stop,
        signal.SIGINT: program.stop,
    }


@pytest.mark.parametrize(
    ("error", "printed"),
    [
        (ConfigError("no file"), "no file"),
        (PortError("no port"), "no port"),
        (FirmwareError("no program"), "no program"),
        (ValueError("no rate"), "no rate"),
        (OSError(28, "No space left on device"), "--log x.csv: No space left on device"),
        (OSError(20, "Not a directory", "x.csv"), "--log x.csv: Not a directory"),
        (OSError(2, "No such file or directory", "y"), "y: No such file or directory"),
    ],
)
def test_a_wrong_set_up_ends_with_2(
    program: Program, capsys: pytest.CaptureFixture[str], error: Exception, printed: str
) -> None:
    program.opens = error
    assert process.main(WORDS) == 2
    assert capsys.readouterr() == ("", f"sitl_bridge: {printed}\n")
    assert program.did == []


@pytest.mark.parametrize(
    ("at", "named"),
    [
        ("/a/fw", "--firmware-folder /a/fw"),
        ("/a/fw/px4.log", "--firmware-folder /a/fw"),
        ("/a", "--firmware-folder /a/fw"),
        ("/b/c.tlog", "--record /b/c.tlog"),
        ("/b", "--record /b/c.tlog"),
        ("/elsewhere", "/elsewhere"),
    ],
)
def test_a_file_that_cannot_be_written_is_named_with_its_option(
    program: Program, capsys: pytest.CaptureFixture[str], at: str, named: str
) -> None:
    program.opens = OSError(13, "Permission denied", at)
    words = ["--autopilot", "px4", "--firmware-folder", "/a/fw", "--record", "/b/c.tlog"]
    assert process.main([*WORDS[: WORDS.index("--log")], *words]) == 2
    assert capsys.readouterr().err == f"sitl_bridge: {named}: Permission denied\n"


@pytest.mark.parametrize(
    ("error", "code", "printed"),
    [
        (BridgeError("nobody came"), 3, "nobody came"),
        (FirmwareError("it has gone"), 3, "it has gone"),
        (TruthLogError("x.csv: no room"), 2, "--log x.csv: no room"),
    ],
)
def test_a_flight_that_breaks_off_says_why_and_is_summed_up(
    program: Program, capsys: pytest.CaptureFixture[str], error: Exception, code: int, printed: str
) -> None:
    program.runs = error
    assert process.main(WORDS) == code
    assert capsys.readouterr() == ("the summary\n", f"sitl_bridge: {printed}\n")
    assert program.did == ["run", "close"]


def test_a_log_that_finds_no_room_at_the_end_ends_with_2(
    program: Program, capsys: pytest.CaptureFixture[str]
) -> None:
    program.closes = TruthLogError("x.csv: no room")
    assert process.main(WORDS) == 2
    assert capsys.readouterr() == ("the summary\n", "sitl_bridge: --log x.csv: no room\n")


def test_the_catalogue_of_faults_needs_no_other_option(
    program: Program, capsys: pytest.CaptureFixture[str]
) -> None:
    assert process.main(["--fault", "list"]) == 0
    assert "position.dropout" in capsys.readouterr().out
    assert process.main([*WORDS, "--fault", "list", "--nonsense"]) == 0
    assert program.did == []


# --- slowness -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lost_s", "after_s", "reports"),
    [
        (0.149, 1.1, False),
        (0.151, 1.1, True),
        (0.151, 0.9, False),  # no more than once a second
        (0.149, 10.1, False),  # less than a twentieth of the time
    ],
)
def test_a_hiccup_is_longer_than_150_ms(lost_s: float, after_s: float, reports: bool) -> None:
    slowness = Slowness(100.0)
    slowness.lose(lost_s)
    assert bool(slowness.report(100.0 + after_s)) == reports


@pytest.mark.parametrize(("each_s", "reports"), [(0.049, False), (0.051, True)])
def test_a_twentieth_of_ten_seconds_is_slow(each_s: float, reports: bool) -> None:
    slowness = Slowness(100.0)
    for _ in range(10):
        slowness.lose(each_s)
    assert slowness.report(109.9) == ""
    text = slowness.report(110.0)
    assert bool(text) == reports
    if reports:
        assert text == (
            f"{TOO_SLOW}: 0.51 s of the last 10.0 s were given up, 0.05 s at once;"
            " close other programs, or fly in lockstep"
        )
    assert slowness.report(120.0) == ""  # it counts again
    assert slowness.given_up_s == pytest.approx(10 * each_s)
