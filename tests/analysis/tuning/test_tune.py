"""From an airframe file to gains: the whole way, small."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from msgspec.structs import replace

from tgl_soar.analysis.tuning import flights
from tgl_soar.analysis.tuning import tune as tuning
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.demands import FOR_JUDGING
from tgl_soar.analysis.tuning.progress_file import ProgressError, ProgressFile
from tgl_soar.analysis.tuning.result import airframe_with, as_toml, pareto_figure
from tgl_soar.analysis.tuning.search import cost
from tgl_soar.analysis.tuning.tune import Effort, Task, digest, tune
from tgl_soar.config.files import (
    airframe_from,
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.lateral_gains import lateral_gains
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SETS
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import SurfaceCommand

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH).changed(
    line_parameters(SITE.lines["b"])
)
SMALL = Effort(generations=3, aircraft=1, grid=1, choosing=0, judging=0, judging_linear=2)
TASK = Task(
    airframe=AIRFRAME,
    site_path=SITE_PATH,
    values=VALUES,
    lean_deg=15.0,
    effort=SMALL,
)


class Killed(Exception):
    pass


def tuned_in(folder: Path, killed_at: int = 10**9) -> tuning.Tuned:
    steps = 0

    def report(_words: str, _done: float) -> None:
        nonlocal steps
        steps += 1
        if steps == killed_at:
            raise Killed

    return tune(TASK, ProgressFile(folder / "progress", digest(TASK)), report, InLine())


@pytest.fixture(scope="module")
def tuned(tmp_path_factory: pytest.TempPathFactory) -> tuning.Tuned:
    pytest.importorskip("cma", reason="tuning needs cma")
    return tuned_in(tmp_path_factory.mktemp("tuned"))


def test_the_search_improves_on_where_it_began(tuned: tuning.Tuned) -> None:
    for kind in SETS:
        search = tuning.search_of(TASK, tuned.values, kind)
        first = tuned.candidates[kind][0].given
        assert cost(tuned.after[kind], search) < cost(first, search)
        assert tuned.after[kind].alpha >= TASK.floor
        assert tuned.judged[kind].aircraft == 2


def test_killed_and_run_again_it_finds_the_same(tuned: tuning.Tuned, tmp_path: Path) -> None:
    with pytest.raises(Killed):
        tuned_in(tmp_path, killed_at=6)  # in the search for the second set
    assert tuned_in(tmp_path) == tuned


def test_the_file_says_what_flies_and_what_for(tuned: tuning.Tuned) -> None:
    table = tomllib.loads(as_toml(TASK, tuned, "eclipson_c.toml", "b"))
    assert VALUES.changed(table["parameters"]) == VALUES.changed(tuned.parameters)
    written = table["tuned"]
    assert (written["airframe"], written["line"], written["seed"]) == ("eclipson_c.toml", "b", 1)
    assert written["ranges"]["servo_s"] == [0.015, 0.08]
    for kind in SETS:
        assert written[kind]["after"]["alpha"] == pytest.approx(tuned.after[kind].alpha, abs=1e-3)


def test_an_airframe_file_flies_with_them(tuned: tuning.Tuned) -> None:
    """No number is typed: keys that stand there are replaced, the others added."""
    text = AIRFRAME_PATH.read_text(encoding="utf-8")
    new = airframe_from(airframe_with(text, tuned.parameters), "new.toml")
    values = load_parameters(new, "new.toml", SITE, SITE_PATH)
    for name, value in tuned.parameters.items():
        assert values[name] == value
    assert new.parameters["PITCH_TRIM"] == AIRFRAME.parameters["PITCH_TRIM"]
    assert (new.model, new.polar) == (AIRFRAME.model, AIRFRAME.polar)


@pytest.mark.parametrize(
    "text",
    [
        "[parameters]\n  RHO_P = 0.1\n[polar]\nc0 = 1",
        "[ parameters ] # mine\n'RHO_P' = 0.1 # old\n  [polar]\n  RHO_P = 3",
        '[parameters]\n"RHO_P"=0.1',
    ],
)
def test_a_key_is_replaced_however_it_is_written(text: str) -> None:
    before, table = tomllib.loads(text), tomllib.loads(airframe_with(text, {"RHO_P": 0.5}))
    assert table == {**before, "parameters": {"RHO_P": 0.5}}


@pytest.mark.parametrize("text", ["[airframe]\na = 1", "[parameters]", "[parameters]\n[polar]\n"])
def test_a_file_without_any_gains_gets_them(text: str) -> None:
    table = tomllib.loads(airframe_with(text, {"RHO_P": 0.5, "RHO_SPEED": 9.0}))
    assert table["parameters"] == {"RHO_P": 0.5, "RHO_SPEED": 9.0}
    assert table.keys() == tomllib.loads(text).keys() | {"parameters"}


def test_the_figure_has_both_trades_of_both_sets(tuned: tuning.Tuned, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    pareto_figure(tmp_path / "pareto.svg", tuned, 0.5, "aircraft")
    assert (tmp_path / "pareto.svg").read_text(encoding="utf-8").count('id="axes_') == 4


def test_other_options_are_another_task() -> None:
    tasks = [
        TASK,
        TASK._replace(seed=2),
        TASK._replace(floor=0.6),
        TASK._replace(values=VALUES.changed({"CMD_DELAY": 0.02})),
        TASK._replace(effort=SMALL._replace(generations=4)),
    ]
    assert len({digest(task) for task in tasks}) == len(tasks)


def test_another_wind_record_is_another_task(tmp_path: Path) -> None:
    """The site file names it, and stays the same."""
    site, record = tmp_path / "site.toml", tmp_path / "hour.csv"
    site.write_text(
        '[site]\nname = "hill"\n[air]\nkind = "hill"\nwind_mps = 7.0\nradius_m = 8.0\n'
        'record = "hour.csv"\n'
    )
    record.write_text("time_s,wind_mps,veer_deg\n0,7,0\n")
    before = digest(TASK._replace(site_path=site))
    assert digest(TASK._replace(site_path=site)) == before
    record.write_text("time_s,wind_mps,veer_deg\n0,6,0\n")
    assert digest(TASK._replace(site_path=site)) != before


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("sim.campaign.manifest.source_digest", "0123456789abcdef"),
        ("sim.campaign.manifest.libraries", {"numpy": "0.1"}),
        ("analysis.tuning.tune.installed_version", "0.1"),  # of cma
    ],
)
def test_what_another_program_has_found_is_another_task(
    name: str, other: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same version: a change of a law or of what rounds changes the answers."""
    path = tmp_path / "progress"
    ProgressFile(path, digest(TASK)).answer("what", lambda: 1)
    ProgressFile(path, digest(TASK))
    monkeypatch.setattr(f"tgl_soar.{name}", lambda *_: other)
    with pytest.raises(ProgressError, match="or to another version of this program or of its lib"):
        ProgressFile(path, digest(TASK))


def test_another_commit_of_the_same_source_is_the_same_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = digest(TASK)
    monkeypatch.setattr("tgl_soar.sim.campaign.manifest.commit", lambda: "another")
    assert tuning.manifest(TASK).commit == "another"
    assert digest(TASK) == before


# --- in flight -----------------------------------------------------------------------------------

FIELD = flights.FlyingPlace(airframe=AIRFRAME, site_path=SITE_PATH, ranges=Ranges(), duration_s=1.0)


def test_a_command_arrives_whole_ticks_later() -> None:
    """Of a step of the elevator the late world shows nothing for just so many ticks."""

    def moved(world: World, count: int) -> list[float]:
        world.held = True
        found = []
        for _ in range(count):
            world.step(SurfaceCommand(0.5, 0.0, 0.0))
            found.append(world.state.elevator)
        return found

    at_once = moved(make_world(AIRFRAME, SITE), 10)
    late = moved(flights.LateWorld(make_world(AIRFRAME, SITE), 3), 13)
    trim = make_world(AIRFRAME, SITE).trim.elevator
    assert late[:3] == pytest.approx([trim] * 3)
    assert late[3:] == pytest.approx(at_once)


@pytest.mark.parametrize("kind", SETS)
def test_an_aircraft_flies_with_what_its_file_says(kind: str) -> None:
    drawn, _, _ = flights.soaring_aircraft(FIELD, VALUES, (1, FOR_JUDGING, 0))
    values = flights.values_of(VALUES, drawn, kind)
    assert values["EST_IMU"] == (1.0 if kind == INERTIAL else 0.0)
    assert values["CMD_DELAY"] == pytest.approx(drawn.latency_s)
    assert values["DYN_FREQ"] == pytest.approx(drawn.known.all_parameters()["DYN_FREQ"], rel=1e-6)
    assert values["RHO_P"] == VALUES["RHO_P"]  # a search judges its own gains
    sought = flights.values_of(VALUES, drawn, kind, seeks=True)
    assert sought["RHO_SPEED"] == sought["DYN_SPEED"]
    for name in ("PITCH_MIN", "PITCH_MAX", "REC_PITCH"):
        assert values[name] - values["PITCH_TRIM"] == pytest.approx(
            VALUES[name] - VALUES["PITCH_TRIM"], abs=1e-5
        )


def test_an_aircraft_flies_with_the_roll_and_heading_gains_of_its_own_file() -> None:
    """A servo of another lag and other inertia want other gains; what the file gives stands."""
    drawn, _, _ = flights.soaring_aircraft(FIELD, VALUES, (1, FOR_JUDGING, 0))
    values = flights.values_of(VALUES, drawn, INERTIAL)
    for name, gain in lateral_gains(drawn.known).items():
        assert values[name] == pytest.approx(gain, rel=1e-6)
    assert values["AIL_P"] != pytest.approx(VALUES["AIL_P"], rel=0.01)
    slowest = drawn.known.all_parameters()["SPEED_MIN"]
    assert values["SPEED_MIN"] == pytest.approx(slowest, rel=1e-6)
    given = replace(drawn.known, parameters={**drawn.known.parameters, "AIL_P": 0.75})
    values = flights.values_of(VALUES.changed({"AIL_P": 0.75}), drawn._replace(known=given), PLAIN)
    assert values["AIL_P"] == 0.75


def test_a_site_where_none_can_soar_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flights, "REDRAWN_MAX", 2)
    nowhere = VALUES.changed({"TGL_X": 0.0, "TGL_Z": 400.0})
    with pytest.raises(ValueError, match=r"tunnel\.toml: name another --site"):
        flights.soaring_aircraft(FIELD, nowhere, (1, FOR_JUDGING, 0))


def test_the_lost_count_in_the_mean() -> None:
    rows = [
        flights.DrawnFlight(up=up, rms_e_rho_m=rms_m, duration_s=1.0, ended="" if up else "too low")
        for up, rms_m in ((True, 0.01), (False, 0.5))
    ]
    found = flights.survival(rows)
    assert (found.up, found.of) == (1, 2)
    assert found.rms_e_rho_m == pytest.approx((0.5 * (0.01**2 + 0.5**2)) ** 0.5)


def test_who_rings_is_far_from_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """In calm air the shipped gains hold the line once settled; the largest that parameters allow,
    as they stand, throw the aircraft from stop to stop."""
    monkeypatch.setattr(flights, "available", lambda: False)
    attempt = flights.Attempt(VALUES, PLAIN, (1, FOR_JUDGING, 0), 0.0)
    field = FIELD._replace(duration_s=9.0)
    largest = {"RHO_P": 5.0, "RHO_D": 5.0, "ELE_P": 20.0, "ELE_D": 5.0, "RHO_SPEED": 0.0}
    ringing = attempt._replace(values=VALUES.changed(largest))
    flown, rung = (flights.fly_attempt(field, each) for each in (attempt, ringing))
    assert flown.up
    assert flown.rms_e_rho_m < 0.03
    assert rung.rms_e_rho_m > 0.1
