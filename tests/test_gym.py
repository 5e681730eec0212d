"""The closed loop as a Gymnasium environment: the one world, the one tick, and others' commands."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("numba")  # delay lines of prepared flights are its lists

from gymnasium.utils.env_checker import check_env  # noqa: E402

from tgl_soar import gym  # noqa: E402
from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS  # noqa: E402
from tgl_soar.autopilot import initial_state  # noqa: E402
from tgl_soar.autopilot import step as autopilot_step  # noqa: E402
from tgl_soar.control.envelope import STALL_BEYOND  # noqa: E402
from tgl_soar.sim.closed_loop import fly  # noqa: E402
from tgl_soar.sim.commanded_flight import (  # noqa: E402
    PITCH,
    SURFACES,
    OutsideCommand,
    Standing,
    given_loops,
    given_pitch,
)
from tgl_soar.sim.compiled_flight import begun  # noqa: E402
from tgl_soar.sim.flight import CRASHED, Row, inputs_at  # noqa: E402
from tgl_soar.sim.world import make_world  # noqa: E402
from tgl_soar.sim.world_step import world_step  # noqa: E402
from tgl_soar.types import SurfaceCommand  # noqa: E402

DT_S = 1.0 / 200.0


def plain(action: str, **options: Any) -> gym.SoaringEnv:
    """An environment that nothing is compiled for."""
    return gym.SoaringEnv(action, **{"compile": False, "seconds": 1.0, **options})


def at(observation: Any, name: str) -> float:
    """One number of an observation."""
    return float(observation[[each.name for each in gym.OBSERVATION].index(name)])


@pytest.mark.parametrize("action", gym.KINDS)
def test_it_passes_gymnasiums_own_checks(action: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what it warns of is a fault, too
        check_env(plain(action, seconds=3.0), skip_render_check=True)


def test_it_is_made_by_its_names() -> None:
    for name, kind in gym.IDS.items():
        env = gymnasium.make(kind, compile=False, seconds=1.0)
        observation, _ = env.reset(seed=1)
        assert env.unwrapped.action == name
        assert observation in env.observation_space


def test_several_fly_side_by_side() -> None:
    envs = gymnasium.make_vec(gym.IDS["pitch"], num_envs=2, compile=False, seconds=1.0)
    observation, _ = envs.reset(seed=5)
    again, _ = plain("pitch").reset(seed=5)
    assert observation.shape == (2, len(gym.OBSERVATION))
    assert np.array_equal(observation[0], again)
    assert not np.array_equal(observation[0], observation[1])  # each has a flight of its own
    _, reward, *_ = envs.step(np.zeros((2, 1), dtype=np.float32))
    assert reward.shape == (2,)


def with_power(place: Any) -> Any:
    """A place where a propeller may turn for a second, if there is one."""
    return place._replace(values=place.values.changed({"THR_BUDGET": 1.0}))


@pytest.mark.parametrize(
    ("airframe", "goal", "seconds", "opened"),
    [("eclipson_c", (0.5, 1.5), 2.0, 0.0), ("eclipson_c_propeller", (-0.25, 1.25), 5.0, 0.1)],
)
def test_a_line_that_is_never_moved_is_a_flight_by_the_module_alone(
    monkeypatch: pytest.MonkeyPatch,
    airframe: str,
    goal: tuple[float, float],
    seconds: float,
    opened: float,
) -> None:
    """The same world, the same tick; also where no lift holds the aircraft, but a propeller."""
    made = gym._place
    monkeypatch.setattr(gym, "_place", lambda *files: with_power(made(*files)))
    env = plain("line", airframe=airframe, seconds=seconds, period_s=0.5)
    env.reset(seed=1, options={"flight": 7, "goal": goal})  # which a parameter can hold
    over = False
    while not over:
        *_, ended, over, _ = env.step(np.zeros(2, dtype=np.float32))
        assert not ended
    place = env._place
    world = make_world(
        place.airframe,
        place.site,
        seed=7,
        turbulence=0.02,
        field=place.field,
        sensors=SENSORS[EVERY_SENSOR],
    )
    line = dict(zip(("TGL_X", "TGL_Z"), goal, strict=True))
    flown = fly(world, place.values.changed(line), (), seconds)
    assert flown["throttle"].max() >= opened
    names = list(Row._fields)
    for name in ("x_m", "z_m", "e_rho_m", "elevator", "updraft_mps"):
        # The white numbers of a prepared flight agree to the last bits of sines and logarithms.
        column = env._rows[: flown.ticks, names.index(name)]
        assert column == pytest.approx(flown[name], abs=1e-9), name


def test_the_place_is_on_the_contour_and_drawn_again() -> None:
    env = plain("line")
    places = set()
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        places.add(env.goal)
        air = env._place.field.wind_at(info["goal_x_m"], 0.0, info["goal_z_m"], 0.0)
        polar = env._place.airframe.polar.as_polar()
        sink = polar.c0 + air[0] * (polar.c1 + air[0] * (polar.c2 + air[0] * polar.c3))
        assert air[2] == pytest.approx(sink, abs=1e-4)
        assert at(observation, "goal_x_m") == pytest.approx(
            info["goal_x_m"] - info["x_m"], abs=0.05
        )
    assert len(places) == 4


def test_an_episode_is_its_seed() -> None:
    def episode(seed: int) -> tuple[Any, ...]:
        env = plain("surfaces", seconds=0.6)
        observation, _ = env.reset(seed=seed)
        found = [observation]
        for _ in range(5):
            observation, reward, *_ = env.step(np.full(3, 0.1, dtype=np.float32))
            found.append(np.append(observation, reward))
        return tuple(np.concatenate(found))

    assert episode(3) == episode(3)
    assert episode(3) != episode(4)


@pytest.mark.parametrize("action", gym.KINDS)
def test_the_shortest_episode_has_one_tick_under_an_action(action: str) -> None:
    env = plain(action, seconds=gym.SECONDS_MIN)
    _, info = env.reset(seed=1)
    env.reset(seed=1, options={"goal": (info["x_m"], info["z_m"])})
    _, reward, ended, over, info = env.step(np.zeros(env.action_space.shape))
    assert (ended, over) == (False, True)
    assert info["time_s"] == pytest.approx(0.21)
    assert reward == pytest.approx(DT_S, rel=0.05)  # within centimetres of the goal


def test_where_no_line_meets_the_contour_a_place_must_be_given() -> None:
    """The site to search in has its start as its only line, with no place to settle."""
    env = plain("line", site="tunnel_search")
    with pytest.raises(
        ValueError, match=r"site 'tunnel_search': no place .* x -0\.35, z 1\.7 m .*'goal'"
    ):
        env.reset(seed=1)
    _, info = env.reset(seed=1, options={"goal": (0.4, 1.6)})
    assert (info["goal_x_m"], info["goal_z_m"]) == (0.4, 1.6)
    *_, ended, _, info = env.step(np.zeros(2))
    assert not ended


def test_the_reward_is_time_at_the_place() -> None:
    env = plain("pitch")
    _, info = env.reset(seed=1)
    here = info["x_m"], info["z_m"]
    env.reset(seed=1, options={"goal": here})
    _, near, *_ = env.step(np.zeros(1))
    env.reset(seed=1, options={"goal": (here[0] + 0.5, here[1])})
    _, half, *_ = env.step(np.zeros(1))
    env.reset(seed=1, options={"goal": (here[0] + 1.5, here[1])})
    _, far, *_ = env.step(np.zeros(1))
    period = gym.PERIODS_S["pitch"]
    assert near == pytest.approx(period, rel=0.05)  # it moves by centimetres
    assert half == pytest.approx(0.5 * period, rel=0.1)
    assert far == 0.0


def test_what_the_module_hands_over_ends_the_episode() -> None:
    """Full throw downwards is a dive: upset, off the line or too low within two seconds."""
    time_s, why = dive(compile=False)
    assert time_s < 2.0
    assert why.startswith(("disengaged: ", "hit the board at x "))


def test_what_ends_in_the_last_tick_of_its_time_is_not_cut_off_as_well() -> None:
    """A learner would else count on what comes after: there is nothing."""
    time_s, why = dive(compile=False)
    env = plain("surfaces", seconds=time_s)
    env.reset(seed=1)
    ended = truncated = False
    while not (ended or truncated):
        _, _, ended, truncated, info = env.step(np.array([-1.0, 0.0, 0.0]))
    assert (ended, truncated) == (True, False)
    assert (info["time_s"], info["ended"]) == (time_s, why)


def test_what_is_hit_is_reported_with_its_place() -> None:
    env = plain("line")
    env.reset(seed=1)
    inside_the_board = env._rows[env._steps - 1, :4].copy()
    inside_the_board[1:] = 1.0, 0.0, 0.2  # 23 degrees of slope: the board is 0.42 m high there
    env._rows[env._steps - 2 : env._steps, :4] = inside_the_board
    standing = Standing(env._steps, CRASHED, 0, False)
    assert env._info(standing)["ended"] == "hit the board at x 1.00, y 0.00, z 0.20 m"


def test_what_is_not_known_yet_is_nought_and_nothing_leaves_its_range() -> None:
    env = plain("line")
    env.reset(seed=1)
    env._known[:] = np.nan
    assert not env._observation().any()
    env._known[:] = 1e9
    assert env._observation() in env.observation_space


def test_commands_go_through_the_modules_limiter() -> None:
    """From one tick to the next no further than the surfaces may: SURF_RATE."""
    env = plain("surfaces", period_s=DT_S)
    observation, _ = env.reset(seed=1)
    most = env._laws.envelope.rate_max_per_s * DT_S
    before = at(observation, "elevator")
    for _ in range(4):
        observation, *_ = env.step(np.array([1.0, 0.0, 0.0]))
        assert at(observation, "elevator") - before == pytest.approx(most, rel=1e-5)
        before = at(observation, "elevator")


def ticks(env: gym.SoaringEnv, count: int) -> Any:
    """(laws, state before, inputs, state after, output) of some tick by the module alone."""
    env.reset(seed=1)
    parts, flight = begun(env._prepared, 3)
    laws = env._laws._replace(target=env._given(np.zeros(env.action_space.shape)).target)
    state, world, command, held = initial_state(), flight.world, flight.command, True
    for n in range(count):
        inputs, before = inputs_at(n * DT_S, world.samples, True), state
        state, output = autopilot_step(laws, state, inputs)
        if output.active:
            command, held = output.command, False
        world = world_step(parts, world, n + 1, command, held)
    assert output.active
    return laws, before, inputs, state, output


def test_our_own_pitch_setpoint_given_from_outside_moves_the_surfaces_as_before() -> None:
    laws, before, inputs, after, output = ticks(plain("pitch"), 180)
    given = OutsideCommand(
        PITCH, laws.target, output.setpoints.pitch_rad, SurfaceCommand(0.0, 0.0, 0.0)
    )
    dt_s = inputs.time_s - before.time_s  # DT_S, but for its last digit
    loops, setpoints = given_loops(laws, given, before.loops, after.memory, inputs, output, dt_s)
    assert setpoints == output.setpoints
    assert loops == after.loops


def test_given_surfaces_are_what_the_next_tick_takes_as_commanded() -> None:
    laws, before, inputs, after, output = ticks(plain("surfaces"), 180)
    wanted = output.command._replace(aileron=output.command.aileron + 0.01)
    given = OutsideCommand(SURFACES, laws.target, 0.0, wanted)
    loops, _ = given_loops(laws, given, before.loops, after.memory, inputs, output, DT_S)
    assert loops.limited.command == wanted
    assert loops.pitch == before.loops.pitch  # our loops rest


def test_a_given_pitch_stays_within_range_and_off_the_stall() -> None:
    laws, _, _, _, output = ticks(plain("pitch"), 180)
    limits = laws.soaring.pid
    well = output._replace(margins=output.margins._replace(stall_rad=1.0, clearance_m=10.0))
    assert given_pitch(laws, well, 0.0, 1.0) == limits.output_max
    assert given_pitch(laws, well, 0.0, -1.0) == limits.output_min
    stalls = well._replace(margins=well.margins._replace(stall_rad=-STALL_BEYOND))
    assert given_pitch(laws, stalls, 0.0, limits.output_max) < limits.output_max


def test_dispersion_flies_another_aircraft_in_each_episode() -> None:
    env = plain("line", dispersion=True, seconds=0.5)
    slopes = set()
    for seed in (1, 2):
        env.reset(seed=seed)
        model: Any = env._prepared.world.model
        slopes.add(model.CL_alpha)
    assert len(slopes) == 2
    assert env._laws.wind.aerodynamics == env._place.airframe.aerodynamics()  # which knows nothing


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"action": "throttle"}, "action 'throttle': one of line, pitch, surfaces"),
        ({"turbulence": -0.1}, "turbulence -0.1: 0 to 0.5"),
        ({"seconds": 0.0}, "seconds 0.0: from 0.21 to 3600; for the first 0.2 the aircraft is"),
        ({"seconds": 0.205}, "seconds 0.205: from 0.21 to 3600"),
        ({"seconds": np.inf}, "seconds inf: from 0.21 to 3600"),
        ({"seconds": np.nan}, "seconds nan: from 0.21 to 3600"),
        ({"seconds": 1e7}, "seconds 10000000.0: from 0.21 to 3600"),
        ({"period_s": 0.001}, "period_s 0.001: a whole multiple of 0.005"),
        ({"period_s": 0.007}, "period_s 0.007: a whole multiple of 0.005"),
        ({"period_s": np.inf}, "period_s inf: .* from 0.005 to 3600"),
        ({"period_s": np.nan}, "period_s nan: a whole multiple"),
        ({"render_mode": "human"}, "render_mode 'human': there is none"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        plain(**{"action": "line", **options})


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"gaol": (0.5, 1.5)}, "reset option 'gaol': one of goal, flight"),
        ({"goal": (np.nan, 1.5)}, r"goal \(nan, 1.5\): x from -500 to 500 and z from"),
        ({"goal": (0.5, np.inf)}, "z from -100 to 1000 m"),
        ({"goal": (0.5,)}, "z from -100 to 1000 m"),
        ({"goal": 3.0}, "z from -100 to 1000 m"),
        ({"flight": -1}, "flight -1: a whole number from 0 to"),
        ({"flight": 2.7}, "flight 2.7: a whole number from 0 to"),
    ],
)
def test_bad_reset_options_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        plain("line").reset(seed=1, options=options)


def test_a_step_before_a_reset_is_reported() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        plain("line").step(np.zeros(2))


def test_a_flights_reward_does_not_hang_on_the_period() -> None:
    """At the edge of reach: some ticks are within it, some are not, and the bound is each one's."""
    sums = []
    _, info = plain("line").reset(seed=1)
    for period_s in (0.005, 0.1):
        env = plain("pitch", period_s=period_s)
        env.reset(seed=1, options={"flight": 7, "goal": (info["x_m"] + 0.99, info["z_m"])})
        sums.append(sum(env.step(np.zeros(1))[1] for _ in range(round(0.2 / period_s))))
    assert sums[0] == pytest.approx(sums[1], rel=1e-9)
    assert sums[0] > 0.0


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], [0.0, 0.0, 0.0]])
def test_bad_actions_are_refused(action: list[float]) -> None:
    env = plain("line")
    env.reset(seed=1)
    with pytest.raises(ValueError, match="2 finite numbers"):
        env.step(action)


def dive(compile: bool) -> tuple[float, str]:
    """When and why a flight ends whose elevator is all down."""
    env = plain("surfaces", seconds=5.0, compile=compile)
    env.reset(seed=1)
    ended, info = False, dict[str, Any]()
    while not ended:
        *_, ended, _, info = env.step(np.array([-1.0, 0.0, 0.0]))
    return info["time_s"], info["ended"]


@pytest.mark.long
def test_compiled_and_plain_end_alike() -> None:
    assert dive(compile=True) == dive(compile=False)


@pytest.mark.long
@pytest.mark.parametrize("action", gym.KINDS)
def test_compiled_and_plain_fly_alike(action: str) -> None:
    """Tolerance: what sines and logarithms of two compilers differ by grows in the loop."""
    check_env(gym.SoaringEnv(action, seconds=3.0), skip_render_check=True)  # compiled
    episodes = []
    for compile in (True, False):
        env = gym.SoaringEnv(action, compile=compile, seconds=1.5)
        observation, _ = env.reset(seed=2)
        found, over = [observation], False
        while not over:
            action_now = 0.1 * np.sin(np.arange(gym.SIZES[action]) + len(found))
            observation, _, ended, truncated, _ = env.step(action_now)
            found.append(observation)
            over = ended or truncated
        episodes.append(np.array(found))
    assert episodes[0] == pytest.approx(episodes[1], abs=1e-5)
