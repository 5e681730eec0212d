"""The Gymnasium environment in plain Python, with nothing of the compiler: what actions command,
what is observed, when an episode ends, and what is refused."""

from __future__ import annotations

import inspect
from math import inf, nan, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from tgl_soar import gym  # noqa: E402
from tgl_soar.air.zeuc import excess_at  # noqa: E402
from tgl_soar.autopilot import mode_name  # noqa: E402
from tgl_soar.sim import compiled_flight  # noqa: E402
from tgl_soar.sim.commanded_flight import (  # noqa: E402
    LINE,
    PITCH,
    SURFACES,
    KnownAboard,
    Standing,
)
from tgl_soar.sim.flight import CRASHED, FLIES  # noqa: E402

PAGE = Path(__file__).parents[1] / "docs/gym.md"


@pytest.fixture(autouse=True)
def plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Delay lines are plain lists: those of the compiler are for compiled flights."""
    monkeypatch.setattr(compiled_flight, "_line", lambda nothing, length: [nothing] * length)


def plain(action: str, **options: Any) -> gym.SoaringEnv:
    """An environment that nothing is compiled for."""
    return gym.SoaringEnv(action, **{"compile": False, "seconds": 1.0, **options})


def at(observation: Any, name: str) -> float:
    """One number of an observation."""
    return float(observation[[each.name for each in gym.OBSERVATION].index(name)])


# --- what the page promises ---------------------------------------------------------------------


def rows_of(page: str, cells: int) -> list[list[str]]:
    """Rows of tables with so many cells, their quotes and typographic signs taken away."""
    lines = [line.replace("−", "-").replace("`", "") for line in page.splitlines()]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "|" in line]
    return [row for row in rows if len(row) == cells]


def test_observations_have_the_names_order_and_ranges_of_the_page() -> None:
    table = [row for row in rows_of(PAGE.read_text(encoding="utf-8"), 5) if "---" not in row[0]][1:]
    assert len(table) == 25
    for (name, _, low, high, _), observed in zip(table, gym.OBSERVATION, strict=True):
        assert observed == (name, float(low), float(high))
    space = plain("line").observation_space
    assert space.low.tolist() == pytest.approx([each.low for each in gym.OBSERVATION])
    assert space.high.tolist() == pytest.approx([each.high for each in gym.OBSERVATION])


@pytest.mark.parametrize(
    ("action", "kind", "size", "ticks"), [("line", LINE, 2, 200), ("pitch", PITCH, 1, 10),
                                          ("surfaces", SURFACES, 3, 4)],
)  # fmt: skip
def test_each_way_to_command_has_its_size_and_its_period(
    action: str, kind: int, size: int, ticks: int
) -> None:
    env = plain(action)
    assert env.action_space.shape == (size,)
    assert (env.action_space.low.tolist(), env.action_space.high.tolist()) == (
        [-1.0] * size, [1.0] * size,
    )  # fmt: skip
    assert env._period == ticks  # of 200 a second
    assert env._given(np.zeros(size)).kind == kind
    assert gym.IDS[action] == f"tgl_soar/{action.capitalize()}-v0"
    spec = gymnasium.spec(gym.IDS[action])
    assert (spec.kwargs, spec.order_enforce) == ({"action": action}, True)


def test_what_is_not_said_is_usual() -> None:
    usual = {
        name: each.default for name, each in inspect.signature(gym.SoaringEnv).parameters.items()
    }
    assert usual == {
        "action": "line", "airframe": "eclipson_c", "site": "tunnel", "turbulence": 0.02,
        "seconds": 30.0, "period_s": None, "dispersion": False, "compile": True,
        "render_mode": None,
    }  # fmt: skip
    assert gym.SoaringEnv.metadata == {"render_modes": []}


# --- what an action commands --------------------------------------------------------------------


def test_a_line_is_shifted_by_half_a_metre_and_leant_by_eight_degrees() -> None:
    env = plain("line")
    env.goal = (0.4, 1.6)
    for action, x_m, lean_deg in (
        ((0.0, 0.0), 0.4, 15.0), ((1.0, 0.0), 0.9, 15.0), ((-0.5, 0.0), 0.15, 15.0),
        ((0.0, 1.0), 0.4, 23.0), ((0.0, -1.0), 0.4, 7.0), ((0.2, 0.5), 0.5, 19.0),
    ):  # fmt: skip
        target = env._given(np.array(action)).target
        assert (target.x_m, target.z_m) == pytest.approx((x_m, 1.6))
        assert target.eta_rad == pytest.approx(0.5 * pi + radians(lean_deg))


def test_a_pitch_goes_from_its_least_to_its_most() -> None:
    env = plain("pitch")
    env.goal = (0.4, 1.6)
    for action, pitch_deg in ((-1.0, -12.0), (0.0, -3.0), (0.5, 1.5), (1.0, 6.0)):
        given = env._given(np.array([action]))
        assert given.pitch_rad == pytest.approx(radians(pitch_deg))
        # The line beside it leads through the place, and is that of the site.
        assert given.target[:2] == (0.4, 1.6)
        assert given.target.eta_rad == pytest.approx(radians(105.0))


def test_surfaces_are_given_as_they_are_and_are_else_the_trim() -> None:
    given = plain("surfaces")._given(np.array([0.1, -0.2, 0.3]))
    assert given.surfaces == (0.1, -0.2, 0.3, 0.0)  # no brake
    assert given.pitch_rad == 0.0
    values = plain("line")._place.values
    trim = tuple(values[name] for name in ("ELE_TRIM", "AIL_TRIM", "RUD_TRIM"))
    for action in ("line", "pitch"):
        env = plain(action)
        assert env._given(np.zeros(gym.SIZES[action])).surfaces[:3] == trim
    assert plain("line")._given(np.zeros(2)).pitch_rad == 0.0


# --- what is observed ---------------------------------------------------------------------------


def test_each_observation_is_what_is_known_under_its_name() -> None:
    env = plain("line")
    env.goal = (0.5, 1.75)
    known = KnownAboard._make(0.01 * n for n in range(1, 1 + len(KnownAboard._fields)))
    env._known[0] = known._replace(x_m=0.25, z_m=2.5, eta_rad=0.5 * pi + 0.125)
    observation = env._observation()
    assert observation.dtype == np.float32
    own = {"goal_x_m": 0.25, "goal_z_m": -0.75, "lean_rad": 0.125}
    for each in gym.OBSERVATION:
        value = own.get(each.name)
        assert at(observation, each.name) == pytest.approx(
            getattr(known, each.name) if value is None else value, rel=1e-6
        )


def test_what_is_not_known_is_nought_and_what_is_out_of_range_is_at_its_edge() -> None:
    env = plain("line")
    assert not env._observation().any()  # nothing is known before a flight
    env._known[:] = inf  # as of margins that are not known: not the best of all
    assert not env._observation().any()
    for number, bound in ((1e9, "high"), (-1e9, "low")):
        env._known[:] = number
        env.goal = (2.0 * number, 2.0 * number)
        expected = [getattr(each, bound) for each in gym.OBSERVATION]
        assert env._observation().tolist() == pytest.approx(expected)


def test_what_is_reported_beside_it_is_the_true_place_the_time_and_the_mode() -> None:
    env = plain("line")
    env.goal = (0.5, 1.75)
    env._steps = 41
    env._rows[39, :4] = 0.195, 1.0, 2.0, 3.0
    env._rows[40, :4] = 0.2, 1.5, 2.25, 2.0
    env._known[0, KnownAboard._fields.index("mode")] = 0.0
    info = env._info(Standing(41, FLIES, 0, False))
    assert (info["time_s"], info["ended"]) == (0.205, "")
    assert (info["x_m"], info["y_m"], info["z_m"]) == (1.5, 2.25, 2.0)
    assert (info["goal_x_m"], info["goal_z_m"]) == (0.5, 1.75)
    assert info["mode"] == mode_name(0)
    env._known[0, KnownAboard._fields.index("mode")] = 2.0
    assert env._info(Standing(41, FLIES, 0, False))["mode"] == mode_name(2)


def test_what_is_hit_lies_a_step_further_than_the_last_row() -> None:
    env = plain("line")
    env._steps = 41
    env._known[0, KnownAboard._fields.index("mode")] = 0.0
    # A step ago at 0.90 and 0.30 m, now at 0.95 and 0.25 m: the board's edge is next.
    env._rows[39, :4] = 0.195, 0.90, 0.2, 0.30
    env._rows[40, :4] = 0.200, 0.95, 0.1, 0.25
    words = env._info(Standing(41, CRASHED, 0, False))["ended"]
    assert words == "hit the board at x 1.00, y 0.00, z 0.20 m"


# --- the place ----------------------------------------------------------------------------------


@pytest.mark.parametrize("along", [0.0, 0.3, 1.0])
def test_a_place_is_where_a_line_between_the_sites_first_and_last_meets_the_contour(
    along: float,
) -> None:
    env = plain("line")
    lines = list(env._place.site.lines.values())
    points = np.array([(line.x_m, line.z_m) for line in lines])
    x0, z0 = (np.interp(along, np.linspace(0.0, 1.0, len(points)), axis) for axis in points.T)
    x, z = env._goal(along)
    polar = env._place.airframe.polar.as_polar()
    assert excess_at(env._place.field, polar, x, z) == pytest.approx(0.0, abs=1e-4)
    # Fifteen degrees downstream of the point, by what it is higher.
    assert x - x0 == pytest.approx(-np.tan(radians(15.0)) * (z - z0), abs=1e-6)


def test_a_site_without_lines_has_one_that_meets_nothing_and_says_so() -> None:
    with pytest.raises(
        ValueError, match=r"site 'tunnel_search': no place .* x -0\.35, z 1\.7 m .*'goal'"
    ):
        plain("line", site="tunnel_search").reset(seed=1)


# --- an episode ---------------------------------------------------------------------------------


def test_a_flight_begins_at_the_tick_in_which_the_module_has_engaged() -> None:
    env = plain("pitch", seconds=0.5)
    observation, info = env.reset(seed=1)
    assert info["time_s"] == pytest.approx(0.205)
    assert (env._steps, info["ended"]) == (41, "")
    assert observation in env.observation_space
    assert at(observation, "goal_x_m") == pytest.approx(info["goal_x_m"] - info["x_m"], abs=0.05)


def test_a_step_takes_a_period_and_gives_what_its_ticks_do() -> None:
    env = plain("pitch", seconds=0.33, period_s=0.05)
    _, info = env.reset(seed=1)
    env.reset(seed=1, options={"goal": (info["x_m"] + 0.6, info["z_m"] - 0.5)})
    time_s = 0.205
    for ticks in (10, 10, 5):
        _, reward, ended, truncated, info = env.step(np.zeros(1))
        time_s += 0.005 * ticks
        assert info["time_s"] == pytest.approx(time_s)
        rows = env._rows[env._steps - ticks : env._steps, gym._PLACE]
        x, y, z = rows.T
        away = np.sqrt((x - env.goal[0]) ** 2 + y**2 + (z - env.goal[1]) ** 2)
        assert 0.3 < away.min() < away.max() < 0.999
        assert reward == pytest.approx(float(np.sum(1.0 - away)) / 200.0)
        assert (ended, truncated) == (False, ticks == 5)


def test_beyond_a_metre_there_is_no_reward_and_none_is_taken() -> None:
    env = plain("pitch", seconds=0.3)
    _, info = env.reset(seed=1)
    env.reset(seed=1, options={"goal": (info["x_m"] + 1.5, info["z_m"])})
    assert env.step(np.zeros(1))[1] == 0.0


def test_a_flight_is_its_seed_whatever_place_is_given() -> None:
    env = plain("pitch", seconds=0.3)
    observation, _ = env.reset(seed=3)
    drawn = env.goal
    again, _ = env.reset(seed=3, options={"goal": (0.4, 1.6)})
    assert env.goal == (0.4, 1.6)
    assert again[2:].tolist() == observation[2:].tolist()  # all but where the place is
    other, _ = env.reset(seed=3, options={"flight": 5})
    assert env.goal == drawn
    assert other[2:].tolist() != observation[2:].tolist()
    next_one, _ = env.reset()  # the next of this seed
    assert next_one[2:].tolist() != observation[2:].tolist()
    assert env.goal != drawn


def test_actions_end_at_one() -> None:
    flown = []
    for elevator in (1.0, 5.0):
        env = plain("surfaces", seconds=0.3)
        env.reset(seed=1)
        observation, *_ = env.step(np.array([elevator, -elevator, 0.0]))
        flown.append(observation.tolist())
    assert flown[0] == flown[1]


def test_a_dive_ends_the_episode_with_its_reason() -> None:
    env = plain("surfaces", seconds=3.0, period_s=0.25)
    env.reset(seed=1)
    ended = truncated = False
    while not (ended or truncated):
        _, _, ended, truncated, info = env.step(np.array([-1.0, 0.0, 0.0]))
    assert (ended, truncated) == (True, False)
    assert info["time_s"] < 2.0
    assert info["ended"].startswith(("disengaged: ", "hit the board at x "))


def test_dispersion_is_another_aircraft_in_the_episode_and_usual_is_the_files_own() -> None:
    for dispersion in (True, False):
        env = plain("line", dispersion=dispersion, seconds=0.3)
        files: Any = env._prepared.world.model
        env.reset(seed=1)
        flown: Any = env._prepared.world.model
        assert (flown.CL_alpha != files.CL_alpha) is dispersion


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("period_s", "ticks"),
    [(0.005, 1), (0.01, 2), (1.0, 200), (3600.0, 720_000), (0.005 * (1.0 + 5e-7), 1),
     (0.1 + 0.2, 60)],
)  # fmt: skip
def test_a_period_is_whole_ticks(period_s: float, ticks: int) -> None:
    assert gym._whole_ticks(period_s, 200.0) == ticks


@pytest.mark.parametrize(
    "period_s", [0.0, -0.005, 1e-9, 0.0024, 0.0076, 0.00501, 0.005 * (1.0 + 3e-6), 3600.005, inf]
)
def test_any_other_period_is_refused_with_its_bounds(period_s: float) -> None:
    with pytest.raises(
        ValueError, match=r"a whole multiple of 0\.005, one tick, from 0\.005 to 3600"
    ):
        gym._whole_ticks(period_s, 200.0)


@pytest.mark.parametrize("turbulence", [0.0, 0.5])
def test_turbulence_goes_up_to_a_half(turbulence: float) -> None:
    env = plain("line", turbulence=turbulence, seconds=0.21)
    assert env._turbulence == pytest.approx(max(turbulence, 1e-6))
    assert env.seconds == 0.21


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"action": "throttle"}, "action 'throttle': one of line, pitch, surfaces"),
        ({"turbulence": -0.01}, r"turbulence -0\.01: 0 to 0\.5"),
        ({"turbulence": 0.51}, r"turbulence 0\.51: 0 to 0\.5"),
        ({"seconds": 0.205}, r"seconds 0\.205: from 0\.21 to 3600; for the first 0\.2 the"),
        ({"seconds": 3600.1}, r"seconds 3600\.1: from 0\.21 to 3600"),
        ({"seconds": nan}, "seconds nan"),
        ({"render_mode": "human"}, "render_mode 'human': there is none"),
        ({"period_s": 0.007}, r"period_s 0\.007: a whole multiple of 0\.005"),
    ],
)
def test_an_option_that_is_none_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        plain(**{"action": "line", **options})


@pytest.mark.parametrize(
    ("options", "checked"),
    [
        ({}, {}),
        ({"goal": [-500, 1000.0]}, {"goal": (-500.0, 1000.0)}),
        ({"goal": (500.0, -100.0), "flight": 0}, {"goal": (500.0, -100.0), "flight": 0}),
        ({"flight": 2**63 - 1}, {"flight": 2**63 - 1}),
        ({"flight": np.int32(7)}, {"flight": 7}),
    ],
)
def test_options_of_a_reset_go_to_their_bounds(
    options: dict[str, Any], checked: dict[str, Any]
) -> None:
    assert gym._checked_options(options) == checked


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"gaol": (0.5, 1.5)}, "reset option 'gaol': one of goal, flight"),
        ({"goal": (-500.1, 1.5)}, r"goal \(-500\.1, 1\.5\): x from -500 to 500 and z from -100 to"),
        ({"goal": (500.1, 1.5)}, "x from -500 to 500"),
        ({"goal": (0.5, -100.1)}, "z from -100 to 1000 m"),
        ({"goal": (0.5, 1000.1)}, "z from -100 to 1000 m"),
        ({"goal": (nan, 1.5)}, "x from -500 to 500"),
        ({"goal": (0.5, nan)}, "x from -500 to 500"),
        ({"goal": (0.5,)}, "z from -100 to 1000 m"),
        ({"goal": 3.0}, "z from -100 to 1000 m"),
        ({"flight": -1}, f"flight -1: a whole number from 0 to {2**63 - 1}"),
        ({"flight": 2**63}, f"flight {2**63}: a whole number from 0 to"),
        ({"flight": 2.0}, r"flight 2\.0: a whole number from 0 to"),
    ],
)
def test_an_option_of_a_reset_that_is_none_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        gym._checked_options(options)


def test_a_step_needs_a_reset_and_finite_numbers_of_its_size() -> None:
    env = plain("line", seconds=0.3)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
        env.step(np.zeros(2))
    env.reset(seed=1)
    for action in ([0.0], [nan, 0.0], [0.0, inf], [0.0, 0.0, 0.0]):
        with pytest.raises(ValueError, match=r"action .*: 2 finite numbers"):
            env.step(action)
    with pytest.raises(ValueError, match="reset option"):
        env.reset(options={"flight": -1})


def test_files_are_found_by_their_names_and_their_paths(tmp_path: Path) -> None:
    assert gym._found("tunnel", "sites").name == "tunnel.toml"
    assert gym._found("tunnel", "sites").is_file()
    own = tmp_path / "own.toml"
    assert gym._found(own, "sites") == own
    assert gym._found(str(own), "sites") == own
