"""The simulated world around the simulated Pixhawk, step by step: what is reported and logged and
when, who holds the sticks, how an aircraft is launched, lost and carried back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.routing import split_frames
from tgl_soar.sim.simulation import DUPLICATE_UPTIME_S, LOG_COLUMNS, Options, Simulation
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL
from tgl_soar.types import SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
PROPELLER = load_airframe(shipped("airframes/eclipson_c_propeller.toml"))
SITE_PATH = shipped("sites/tunnel.toml")
SITE = load_site(SITE_PATH)
COMPANION, STATION = 1, 2


def simulated(*faults: str, airframe: Any = AIRFRAME, **options: Any) -> Simulation:
    chosen = Options(**{"turbulence": 0.0, "faults": parse_faults(faults), **options})
    made = Simulation(airframe, SITE, chosen, SITE_PATH.parent)
    made.add_link(COMPANION, ground=False)
    made.add_link(STATION, ground=True)
    made.take_events()
    return made


def override(*values: int) -> bytes:
    """Of the system that is obeyed; 65535 leaves a channel as it is."""
    eight = [*values, *[65535] * (8 - len(values))]
    message = mavlink.MAVLink_rc_channels_override_message(1, 1, *eight)
    return bytes(message.pack(mavlink.MAVLink(None, 255, 191)))


LEVEL = override(1500, 1500)


def steps(simulation: Simulation, n: int, *, overridden: bool = False) -> list[str]:
    events = []
    for _ in range(n):
        if overridden:
            simulation.receive(COMPANION, LEVEL)
        simulation.step()
        events += simulation.take_events()
    return events


def received(simulation: Simulation, link: int) -> list[Any]:
    return [
        frame.message
        for to, data in simulation.take_datagrams()
        if to == link
        for frame in split_frames(mavlink.MAVLink(None), data)[0]
    ]


# --- time, log and truth --------------------------------------------------------------------------


def test_a_row_of_the_log_has_these_columns_in_this_order() -> None:
    assert (
        *("time_s", "x_m", "y_m", "z_m", "velocity_x_mps", "velocity_y_mps", "climb_mps"),
        *("roll_rad", "pitch_rad", "heading_rad", "wind_x_mps", "wind_y_mps", "updraft_mps"),
        *("airspeed_mps", "alpha_rad", "elevator", "aileron", "rudder", "brake", "throttle"),
        *("mode", "flying", "overridden"),
    ) == LOG_COLUMNS


def logged(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    with np.load(path) as arrays:
        return dict(arrays)


@pytest.mark.parametrize(("log_hz", "every"), [(50, 4), (200, 1), (400, 1), (40, 5), (20, 10)])
def test_it_is_logged_from_the_first_moment_at_the_rate_that_was_asked_for(
    tmp_path: Path, log_hz: int, every: int
) -> None:
    simulation = simulated(log=tmp_path / "truth.npz", log_hz=log_hz, uptime_s=3.0)
    steps(simulation, 20)
    simulation.close()
    times = logged(tmp_path / "truth.npz")["time_s"]
    assert times == pytest.approx([3.0 + 0.005 * i for i in range(0, 21, every)])


def test_the_log_says_who_flies_in_which_mode(tmp_path: Path) -> None:
    simulation = simulated(log=tmp_path / "truth.npz", log_hz=200)
    steps(simulation, 5)
    steps(simulation, 5, overridden=True)
    simulation.pixhawk.set_mode(FBWA, "a test")
    steps(simulation, 5)
    simulation.close()
    log = logged(tmp_path / "truth.npz")
    assert log["overridden"][[0, 5, 7, 15]].tolist() == [0.0, 0.0, 1.0, 1.0]
    assert log["flying"][[0, 5, 15]].tolist() == [0.0, 0.0, 1.0]
    assert log["mode"][[0, 10, 15]].tolist() == [MANUAL, MANUAL, FBWA]
    assert log["x_m"][0] == SITE.start.x_m if SITE.start else False
    assert log["airspeed_mps"][0] > 5.0


def test_time_that_is_passed_over_is_on_every_clock_but_not_flown(tmp_path: Path) -> None:
    simulation = simulated(
        "autopilot.second start=0 for=99", log=tmp_path / "truth.npz", log_hz=200, uptime_s=1.0
    )
    steps(simulation, 10)
    simulation.pass_over(0.5)
    simulation.pass_over(0.25)
    request = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 2, 5000.0, 0, 0, 0, 0, 0)
    simulation.receive(COMPANION, bytes(request.pack(mavlink.MAVLink(None, 1, 191))))
    steps(simulation, 10)
    simulation.close()
    assert simulation.time_s == pytest.approx(0.1)
    assert simulation.pixhawk.boot_ms == 1850
    assert logged(tmp_path / "truth.npz")["time_s"][-1] == pytest.approx(1.85)
    boots = [
        m.time_boot_ms for m in received(simulation, COMPANION) if m.get_type() == "SYSTEM_TIME"
    ]
    assert max(boots) > 3_601_700  # of the duplicate, which has been running for an hour longer


def test_truth_goes_to_stations_alone_five_times_a_second() -> None:
    simulation = simulated()
    steps(simulation, 200)
    simulation_out = simulation.take_datagrams()
    named: dict[int, list[Any]] = {COMPANION: [], STATION: []}
    for link, data in simulation_out:
        for frame in split_frames(mavlink.MAVLink(None), data)[0]:
            if frame.message.get_type() == "NAMED_VALUE_FLOAT":
                named[link].append(frame.message)
    assert named[COMPANION] == []
    names = ["updraft", "sink", "true_x", "true_y", "true_z", "airspeed"]
    assert [message.name for message in named[STATION]] == names * 5
    assert [m.time_boot_ms for m in named[STATION][::6]] == [200, 400, 600, 800, 1000]
    truth = simulation.world.truth
    last = {message.name: message.value for message in named[STATION][-6:]}
    assert last["updraft"] == pytest.approx(truth.updraft_mps, abs=1e-5)
    assert last["true_x"] == pytest.approx(truth.x_m, abs=1e-5)
    assert last["true_y"] == pytest.approx(truth.y_m, abs=1e-5)
    assert last["true_z"] == pytest.approx(truth.z_m, abs=1e-5)
    assert last["airspeed"] == pytest.approx(truth.airspeed_mps, abs=1e-5)
    polar = AIRFRAME.polar
    v = truth.wind_x_mps  # the sink that a hover over one place costs: a cubic of the wind
    sink = polar.c0 + polar.c1 * v + polar.c2 * v**2 + polar.c3 * v**3
    assert last["sink"] == pytest.approx(sink, abs=1e-4)


def test_truth_may_be_left_out() -> None:
    simulation = simulated(truth=False)
    steps(simulation, 200)
    kinds = {message.get_type() for message in received(simulation, STATION)}
    assert "ATTITUDE" in kinds
    assert "NAMED_VALUE_FLOAT" not in kinds


# --- launch, pilot and loss -----------------------------------------------------------------------


def test_it_is_held_until_a_surface_is_overridden() -> None:
    simulation = simulated()
    assert simulation.booted
    assert steps(simulation, 50) == []
    assert not simulation.flying
    simulation.receive(COMPANION, override(65535, 65535, 1500))  # no surface's channel
    assert steps(simulation, 2) == []
    simulation.receive(COMPANION, LEVEL)
    assert "launched: the surfaces are overridden" in steps(simulation, 2)
    assert simulation.flying


@pytest.mark.parametrize("lacking", ["armed", "mode"])
def test_it_is_freed_armed_and_in_manual_only(lacking: str) -> None:
    simulation = simulated(armed=lacking != "armed")
    if lacking == "mode":
        simulation.pixhawk.set_mode(FBWA, "a test")
    steps(simulation, 5, overridden=True)
    assert simulation.world.held
    simulation.pixhawk.set_mode(MANUAL, "a test")
    simulation.pixhawk.arm(True, force=False)
    assert "launched: the surfaces are overridden" in steps(simulation, 2, overridden=True)


def test_it_may_be_free_from_the_first() -> None:
    assert simulated(held=False).flying


def test_the_pilot_flies_unless_a_surface_is_overridden() -> None:
    simulation = simulated(held=False)
    neutral = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    steps(simulation, 100)
    assert simulation.pixhawk.pilot_sticks not in (None, neutral)
    simulation.receive(COMPANION, LEVEL)
    steps(simulation, 1)
    assert simulation.pixhawk.pilot_sticks == neutral
    held = simulated()
    steps(held, 100)
    assert held.pixhawk.pilot_sticks == neutral


def test_the_pilot_holds_the_place_where_they_took_over() -> None:
    """Wherever they held it before: the sum of its errors is reset too."""
    simulation = simulated(held=False)
    simulation.pixhawk.set_mode(FBWA, "a test")
    steps(simulation, 100)
    simulation.receive(COMPANION, LEVEL)
    steps(simulation, 1)
    state = simulation.world.state
    simulation.world.state = state._replace(
        x_m=state.x_m + 0.3, velocity_x_mps=0.0, velocity_y_mps=0.0, velocity_z_mps=0.0
    )
    simulation.receive(COMPANION, override(0, 0))
    steps(simulation, 1)
    sticks = simulation.pixhawk.pilot_sticks
    assert sticks is not None
    assert sticks.elevator == pytest.approx(0.0, abs=0.05)  # 0.3 m away would ask for 0.15 rad


def test_without_a_pilot_nobody_holds_the_sticks() -> None:
    simulation = simulated(pilot=False, held=False)
    steps(simulation, 10)
    assert simulation.pixhawk.pilot_sticks is None


def test_before_the_first_attitude_the_pilot_sees_nothing() -> None:
    simulation = simulated(held=False)
    steps(simulation, 1)
    assert simulation.pixhawk.pilot_sticks == (0.0, 0.0, 0.0, 0.0)


def test_in_manual_the_pilot_moves_the_surfaces_and_in_fbwa_they_ask_for_no_bank() -> None:
    for mode, moves in ((MANUAL, True), (FBWA, False)):
        simulation = simulated(held=False)
        simulation.pixhawk.set_mode(mode, "a test")
        state = simulation.world.state
        simulation.world.state = state._replace(qx=0.1)
        steps(simulation, 20)
        sticks = simulation.pixhawk.pilot_sticks
        assert sticks is not None
        assert (sticks.aileron != 0.0) == moves


def test_what_is_lost_lies_for_ten_seconds_and_is_held_armed_and_in_manual_again() -> None:
    simulation = simulated(held=False)
    world = simulation.world
    simulation.pixhawk.set_mode(FBWA, "a test")
    steps(simulation, 3)
    world.state = world.state._replace(z_m=-5.0)
    [lost] = steps(simulation, 1)
    assert lost.startswith("lost: ")
    assert (simulation.crashes, simulation.flying) == (1, False)
    simulation.pixhawk.arm(False, force=True)
    assert steps(simulation, 1999) == []  # 200 a second
    events = steps(simulation, 2)
    assert "carried back and held at the start again" in events
    assert world.held
    assert world.crashed == ""
    assert SITE.start is not None
    assert (world.state.x_m, world.state.z_m) == (SITE.start.x_m, SITE.start.z_m)
    assert simulation.pixhawk.mode == MANUAL
    assert simulation.pixhawk.armed
    assert simulation.crashes == 1
    steps(simulation, 5, overridden=True)
    assert simulation.flying
    world.state = world.state._replace(z_m=-5.0)
    assert any(text.startswith("lost: ") for text in steps(simulation, 1))
    assert simulation.crashes == 2


def test_a_motor_runs_only_when_armed() -> None:
    motor = PROPELLER.surfaces.throttle
    assert motor is not None
    values = [65535] * 8
    values[motor.channel - 1] = motor.pwm_max
    for armed, throttle in ((True, 1.0), (False, 0.0)):
        simulation = simulated(airframe=PROPELLER, armed=armed)
        simulation.receive(COMPANION, override(*values))
        steps(simulation, 2)
        assert simulation.world.throttle == throttle


# --- faults, the duplicate and the summary --------------------------------------------------------


def test_a_fault_is_announced_as_it_begins_and_as_it_is_over() -> None:
    simulation = simulated("position.dropout start=0.1 for=0.2")
    events = [(i, text) for i in range(100) for text in steps(simulation, 1)]
    assert [text.partition(":")[0] for _, text in events] == ["fault begins", "fault is over"]
    assert "position.dropout" in events[0][1]
    assert [i for i, _ in events] == pytest.approx([20, 60], abs=1)


def test_a_reboot_is_the_autopilots_silence_and_a_new_clock() -> None:
    simulation = simulated("autopilot.reboot start=0.1 for=0.2", uptime_s=50.0)
    steps(simulation, 30)
    assert not simulation.pixhawk.running
    steps(simulation, 40)
    assert simulation.pixhawk.running
    assert simulation.pixhawk.boot_ms == pytest.approx(50, abs=6)


def test_the_pilot_takes_over_in_fbwa_and_hands_over_in_manual() -> None:
    simulation = simulated("pilot.takes start=0.1 for=0.2", held=False)
    modes = []
    for _ in range(100):
        steps(simulation, 1)
        modes.append(simulation.pixhawk.mode)
    assert set(modes[:19]) == {MANUAL}
    assert set(modes[22:58]) == {FBWA}
    assert set(modes[62:]) == {MANUAL}


def test_a_duplicate_has_run_for_an_hour_longer_and_is_received_while_its_fault_acts() -> None:
    assert DUPLICATE_UPTIME_S == 3600.0
    simulation = simulated("autopilot.second start=0.5 for=0.5")
    request = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 31, 5000.0, 0, 0, 0, 0, 0)
    simulation.receive(COMPANION, bytes(request.pack(mavlink.MAVLink(None, 1, 191))))
    stamped: list[tuple[int, bool]] = []
    beats: list[tuple[int, Any]] = []
    for i in range(300):
        steps(simulation, 1)
        messages = received(simulation, COMPANION)
        stamps = [m.time_boot_ms for m in messages if m.get_type() == "ATTITUDE_QUATERNION"]
        stamped += [(i, stamp >= 3_600_000) for stamp in stamps]
        beats += [(i, m) for m in messages if m.get_type() == "HEARTBEAT"]
    acts = [i for i, is_late in stamped if is_late]
    assert acts == list(range(acts[0], acts[-1] + 1))
    assert (acts[0], acts[-1]) == pytest.approx((99, 198), abs=2)
    assert len([i for i, is_late in stamped if not is_late]) > 290
    assert any(98 <= i <= 101 for i, _ in beats)  # it announces itself
    late = simulated("autopilot.second start=0.5 for=0.5")
    late.remove_link(COMPANION)
    steps(late, 150)
    assert received(late, COMPANION) == []


def test_a_duplicate_speaks_to_companions_alone() -> None:
    simulation = simulated("autopilot.second start=0 for=99")
    steps(simulation, 100)
    stamps = [m.time_boot_ms for m in received(simulation, STATION) if m.get_type() == "ATTITUDE"]
    assert stamps
    assert max(stamps) < 3_600_000


def test_the_summary_counts_what_became_of_the_overrides() -> None:
    simulation = simulated()
    steps(simulation, 3, overridden=True)
    foreign = mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8)
    simulation.receive(COMPANION, bytes(foreign.pack(mavlink.MAVLink(None, 9, 191))))
    steps(simulation, 110)
    assert simulation.summary() == "overrides: 3 accepted, 1 refused, 1 timed out"


def test_poses_are_taken_where_the_site_forwards_them_and_own_parameters_come_last() -> None:
    simulation = simulated(parameters=(("SYSID_MYGCS", 9.0),))
    assert simulation.pixhawk.parameters["SYSID_MYGCS"] == 9.0
    assert simulation.pixhawk.parameters["VISO_TYPE"] == 0.0


def test_sensors_are_fitted_as_asked() -> None:
    plain = simulated()
    steps(plain, 40)
    assert plain.world.imu.sequence > 0
    assert plain.world.airspeed.sequence > 0
    assert plain.world.rangefinder.sequence == 0
    other = simulated(pitot=False, rangefinder=True)
    steps(other, 40)
    assert other.world.airspeed.sequence == 0
    assert other.world.rangefinder.sequence > 0


def test_a_hand_throws_two_seconds_after_the_first_override() -> None:
    path = shipped("sites/hill.toml")
    simulation = Simulation(
        AIRFRAME, load_site(path), Options(turbulence=0.0, by_hand=True), path.parent
    )
    simulation.add_link(COMPANION, ground=False)
    assert steps(simulation, 100) == []
    start = simulation.world.truth
    assert (start.velocity_x_mps, simulation.flying) == (0.0, False)
    assert "thrown in 2 s: the surfaces are overridden" in steps(simulation, 100, overridden=True)
    assert simulation.world.truth.x_m == start.x_m
    events = steps(simulation, 400, overridden=True)
    assert (events[-1], simulation.flying) == ("thrown", True)
    assert simulation.world.truth.x_m < start.x_m - 0.3  # the arm's swing
    # Lost and carried back, it is in the hand again.
    simulation.world.crashed = "lost"
    simulation._lying_until = simulation.world.steps
    steps(simulation, 2)
    assert not simulation.flying
    assert simulation.world.truth.x_m == start.x_m
