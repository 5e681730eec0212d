"""The demands' places one by one: at which speed, lean and latency, with which sensors and what the
schedule has there; and how what they give is put together."""

from __future__ import annotations

from math import inf, radians, sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.linear_plant import Gusts
from tgl_soar.analysis.tuning import demands as module
from tgl_soar.analysis.tuning.aircraft import Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.demands import (
    FOR_CHOICE,
    FOR_JUDGING,
    FOR_SEARCH,
    Demands,
    Given,
    drawn_place,
    given_by,
    place_margin,
    places_of,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.found_gains import INERTIAL, PLAIN, anchored
from tgl_soar.sim.aircraft import aircraft_model, highest_pitch_glide
from tgl_soar.sim.sensors import MEMS_IMU

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = anchored(load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH), 15.0)
DEMANDS = Demands(airframe=AIRFRAME, values=VALUES, aircraft=0)
BEST = VALUES["DYN_BEST"]
SLOWEST = max(
    0.82 * BEST,
    1.001
    * highest_pitch_glide(aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)).horizontal_mps,
)
LEANS = (VALUES["TGL_LEAN_MIN"], VALUES["RHO_LEAN"], VALUES["TGL_LEAN_MAX"])


@pytest.fixture(autouse=True)
def _light(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plant of a condition is tested elsewhere."""
    monkeypatch.setattr(
        module,
        "linear_plant",
        lambda condition, gusts: SimpleNamespace(condition=condition, gusts=gusts),
    )


def where(place: Any) -> tuple[float, float, float]:
    condition = place.plant.condition
    return condition.speed_mps, condition.lean_rad, condition.command_delay_s


@pytest.mark.parametrize(
    ("grid", "speeds", "leans"),
    [
        (1, (BEST,), LEANS[1:2]),
        (2, (SLOWEST, 1.51 * BEST), LEANS[::2]),
        (3, (SLOWEST, BEST, 1.51 * BEST), LEANS),
    ],
)
def test_margins_are_asked_on_a_grid_of_speed_lean_and_latency(
    grid: int, speeds: tuple[float, ...], leans: tuple[float, ...]
) -> None:
    own = VALUES["CMD_DELAY"]
    low, high = Ranges().latency_s
    delays = {1: (own,), 2: (min(low, own), max(high, own))}.get(
        grid, (min(low, own), own, max(high, own))
    )
    found = places_of(DEMANDS._replace(grid=grid), PLAIN).margin
    expected = [(v, radians(lean), d) for v in speeds for lean in leans for d in delays]
    assert [where(place) for place in found] == [pytest.approx(each) for each in expected]
    for place, (_, lean_rad, delay_s) in zip(found, expected, strict=True):
        assert place.known == {
            "CMD_DELAY": delay_s,
            "TGL_LEAN": pytest.approx(np.degrees(lean_rad)),
        }


def test_gusts_are_asked_at_three_speeds_where_it_soars_and_the_reference_lean() -> None:
    found = places_of(DEMANDS._replace(turbulence=0.05), PLAIN)
    own, lean = VALUES["CMD_DELAY"], radians(VALUES["RHO_LEAN"])
    expected = [(factor * BEST, lean, own) for factor in (0.92, 1.0, 1.15)]
    assert [where(place) for place in found.gusts] == [pytest.approx(each) for each in expected]
    assert found.turbulence == Gusts(0.05, BEST)


def test_a_place_is_named_by_its_numbers() -> None:
    place = places_of(DEMANDS._replace(grid=1), INERTIAL).margin[0]
    delay = f"{1e3 * VALUES['CMD_DELAY']:.3g} ms"
    assert place.name == f"{BEST:.1f} m/s, lean {LEANS[1]:.0f} deg, {delay}, {INERTIAL}"


def test_only_gains_for_accelerometers_are_asked_with_them() -> None:
    found = [places_of(DEMANDS._replace(grid=1), kind).margin[0] for kind in (INERTIAL, PLAIN)]
    assert [place.plant.condition.sensors.imu for place in found] == [MEMS_IMU, None]


def test_as_many_aircraft_are_drawn_as_are_asked_for_each_by_a_seed_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert len({FOR_SEARCH, FOR_CHOICE, FOR_JUDGING}) == 3
    monkeypatch.setattr(module, "drawn_place", lambda _demands, kind, seed: (kind, seed))
    found: Any = places_of(DEMANDS._replace(aircraft=3, grid=1, seed=8), PLAIN).margin[1:]
    assert list(found) == [(PLAIN, (8, FOR_SEARCH, n)) for n in range(3)]
    usual = places_of(Demands(airframe=AIRFRAME, values=VALUES), PLAIN)
    assert len(usual.margin) == 27 + 6
    assert usual.turbulence.intensity == 0.03
    assert DEMANDS.grid == 3


def test_a_drawn_aircraft_is_asked_near_the_usual_speed_and_lean() -> None:
    """Two thirds to twice the reference lean, within what lines may lean by."""
    for n in range(12):
        seed = (1, FOR_SEARCH, n)
        place = drawn_place(DEMANDS, PLAIN, seed)
        drawn = drawn_aircraft(AIRFRAME, Ranges(), seed)
        speed, lean_rad, delay_s = where(place)
        known = drawn.known.all_parameters()
        least = highest_pitch_glide(aircraft_model(asdict(drawn.known.airframe), drawn.known.model))
        usual = known["DYN_BEST"] * np.array([0.92, 1.15])
        assert max(usual[0], least.horizontal_mps) * 0.999 <= speed
        assert speed <= max(usual[1], 1.0011 * least.horizontal_mps) * 1.001
        assert 0.66 * LEANS[1] <= np.degrees(lean_rad) <= min(LEANS[2], 2.0 * LEANS[1])
        assert delay_s == drawn.latency_s == place.known["CMD_DELAY"]
        assert place.known["TGL_LEAN"] == pytest.approx(np.degrees(lean_rad))
        dynamics = {name for name in known if name.startswith("DYN_")}
        assert place.known.keys() == dynamics | {"CMD_DELAY", "TGL_LEAN"}
        assert place.known["DYN_FREQ"] == known["DYN_FREQ"]
        assert place.name.startswith(f"aircraft {seed}, {speed:.1f} m/s, lean ")
    places = [where(drawn_place(DEMANDS, PLAIN, (2, 0, n)))[:2] for n in range(12)]
    assert len({*places}) == 12


def test_a_lean_beyond_those_of_lines_is_none() -> None:
    for asked, found in ((1.0, LEANS[0]), (LEANS[0] + 1.0, LEANS[0] + 1.0), (89.0, LEANS[2])):
        place = module._place(AIRFRAME, VALUES, PLAIN, 9.0, asked, 0.01)
        assert place.known["TGL_LEAN"] == found
        assert place.plant.condition.lean_rad == pytest.approx(radians(found))


# --- what gains give ------------------------------------------------------------------------------


def given(
    monkeypatch: pytest.MonkeyPatch, margins: list[float], gusts: list[tuple[float, float] | None]
) -> Given:
    """Margins at places m0, m1 …; e_rho and activity at g0, g1 …, None where it is unstable."""
    by_name: dict[str, Any] = {f"m{n}": each for n, each in enumerate(margins)}
    by_name |= {f"g{n}": each for n, each in enumerate(gusts)}

    def active(name: str, condition: str, turbulence: str) -> Any:
        assert (condition, turbulence) == (f"at {name}", "gusts")
        if by_name[name] is None:
            raise ValueError("unstable")
        return SimpleNamespace(e_rho_m=by_name[name][0], elevator=by_name[name][1])

    monkeypatch.setattr(module, "place_margin", lambda place, _values: by_name[place.name])
    monkeypatch.setattr(module, "_laws", lambda place, _values: place.name)
    monkeypatch.setattr(module, "activity", active)

    def place(name: str) -> Any:
        return SimpleNamespace(name=name, plant=SimpleNamespace(condition=f"at {name}"))

    places: Any = SimpleNamespace(
        margin=[place(name) for name in by_name if name[0] == "m"],
        gusts=[place(name) for name in by_name if name[0] == "g"],
        turbulence="gusts",
    )
    return given_by(places, VALUES)


def test_the_least_margin_counts_and_the_mean_square_of_what_gusts_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = given(monkeypatch, [0.6, 0.5, 0.7], [(0.01, 0.1), (0.02, 0.2), (0.04, 0.3)])
    assert (found.alpha, found.worst) == (0.5, "m1")
    assert found.e_rho_m == pytest.approx(sqrt((1.0 + 4.0 + 16.0) / 3.0) / 100.0)
    assert found.elevator == pytest.approx(sqrt((0.01 + 0.04 + 0.09) / 3.0))


def test_who_is_unstable_in_gusts_anywhere_has_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    found = given(monkeypatch, [0.6], [(0.01, 0.1), None, (0.04, 0.3)])
    assert found == Given(alpha=0.0, e_rho_m=inf, elevator=inf, worst="g1")


def test_a_margin_is_that_of_the_values_that_are_known_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known: list[Any] = []
    monkeypatch.setattr(module, "laws_from", lambda values, _frame: values)
    monkeypatch.setattr(
        module, "linear_controller", lambda laws, condition: known.append((laws, condition))
    )
    monkeypatch.setattr(module, "close_loop", lambda plant, _controller: plant)
    monkeypatch.setattr(
        module, "disk_margin", lambda _loop, at: (len(at), float(at[0]), float(at[-1]))
    )
    place = places_of(DEMANDS._replace(grid=1), PLAIN).margin[0]
    place = place._replace(known={"CMD_DELAY": 0.0375})
    found: Any = place_margin(place, VALUES)
    assert found == (60, pytest.approx(0.5), pytest.approx(200.0))
    ((laws, condition),) = known
    assert laws["CMD_DELAY"] == pytest.approx(0.0375)
    assert condition is place.plant.condition
