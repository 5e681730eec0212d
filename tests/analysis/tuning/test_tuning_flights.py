"""Flights of drawn aircraft, made up: which stay up, what is scored of each, where an aircraft may
hover, and how late a command comes."""

from __future__ import annotations

from functools import lru_cache
from math import cos, degrees, pi, radians, sin, sqrt
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import asdict, replace

from tgl_soar.air.zeuc import Crossing, ZeucError
from tgl_soar.analysis.experiments.spread_along_line import Slide, dryden_dispersion, leverage
from tgl_soar.analysis.tuning import flights
from tgl_soar.analysis.tuning.aircraft import Drawn, Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.flights import DrawnFlight, FlyingPlace, line_of, survival
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import INERTIAL, PLAIN
from tgl_soar.sim.aircraft import aircraft_model, glide_at
from tgl_soar.sim.compiled_flight import CompiledWorld
from tgl_soar.sim.world import World
from tgl_soar.types import GlidePolar, SurfaceCommand

PATH = Path("sites/none.toml")
PLACE = FlyingPlace(
    airframe=load_airframe(shipped("airframes/eclipson_c.toml")), site_path=PATH, ranges=Ranges()
)
VALUES = ParameterSet().changed({"TGL_X": 1.0, "TGL_Z": 2.0, "TGL_LEAN": 15.0})


def test_unless_more_is_asked_for_gains_are_judged_for_half_a_minute_on_the_given_line() -> None:
    assert PLACE[3:] == (30.0, 0.0, None, 0.0, False)
    assert PLACE._fields[3:] == (
        "duration_s", "unknown_late_s", "speed_ratio", "roughest", "seeks",
    )  # fmt: skip


def test_a_line_leans_upwind_by_its_angle_from_upright() -> None:
    assert line_of(VALUES) == pytest.approx((1.0, 2.0, 0.5 * pi + radians(15.0)), abs=1e-6)


def test_the_root_of_the_mean_square_is_of_all() -> None:
    rows = [
        DrawnFlight(up=up, rms_e_rho_m=rms, duration_s=1.0, ended="")
        for up, rms in ((True, 0.1), (True, 0.2), (False, 0.4))
    ]
    found = survival(rows)
    assert (found.up, found.of) == (2, 3)
    assert found.rms_e_rho_m == pytest.approx(sqrt((0.01 + 0.04 + 0.16) / 3.0))
    assert survival([]) == (0, 0, 0.0)


# --- late commands --------------------------------------------------------------------------------


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_until_the_first_command_arrives_the_surfaces_stand_at_trim(
    ticks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[SurfaceCommand] = []
    monkeypatch.setattr(World, "step", lambda _self, command: taken.append(command))
    world: Any = SimpleNamespace(trim=SimpleNamespace(elevator=0.1))
    late = flights.LateWorld(world, ticks)
    sent = [SurfaceCommand(0.2 + 0.1 * n, 0.3, 0.4) for n in range(5)]
    for command in sent:
        late.step(command)
    at_trim = [SurfaceCommand(0.1, 0.0, 0.0)] * ticks
    assert taken == [*at_trim, *sent][:5]
    assert late.trim is world.trim


@pytest.mark.parametrize(("late_s", "ticks"), [(0.0, 0), (0.0124, 2), (0.0126, 3), (0.02, 4)])
def test_a_lateness_is_flown_in_whole_ticks(
    late_s: float, ticks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(flights, "available", lambda: False)
    monkeypatch.setattr(flights, "LateWorld", lambda world, ticks: ("late", world, ticks))
    monkeypatch.setattr(flights, "ClosedLoop", lambda world, values: ("loop", world, values))
    monkeypatch.setattr(flights, "_flown", lambda *what: given.append(what))
    world: Any = object()
    flights.fly_late(world, 5, VALUES, late_s, 12.0)
    assert given == [(("loop", ("late", world, ticks), VALUES), line_of(VALUES), 12.0)]


# --- what is scored -------------------------------------------------------------------------------


def flown_whole(
    monkeypatch: pytest.MonkeyPatch, ticks: int, ended: str = "", step_hz: float = 100.0
) -> DrawnFlight:
    """Off the line by 4 m at first, by 1 m until 8 s and by 0.1 m from then on; to the side and
    banked likewise."""
    x0, z0, eta = line_of(VALUES)
    off = np.where(np.arange(ticks) < 8.0 * step_hz, 1.0, 0.1)
    off[0] = 4.0
    columns = {
        "x_m": x0 - off * sin(eta) + 3.0 * cos(eta),
        "z_m": z0 + off * cos(eta) + 3.0 * sin(eta),
        "y_m": 2.0 * off,
        "roll_rad": 3.0 * off,
    }

    class Rows:
        def __getitem__(self, name: str) -> Any:
            return columns[name]

    rows: Any = Rows()
    rows.ticks, rows.ended = ticks, ended
    monkeypatch.setattr(flights, "available", lambda: True)
    monkeypatch.setattr(flights, "prepare", lambda world, seconds: (world, seconds))
    monkeypatch.setattr(flights, "fly_compiled", lambda *_: rows)
    world: Any = SimpleNamespace(step_hz=step_hz)
    return flights.fly_whole(world, 5, VALUES, 12.0)


def test_a_whole_flight_is_scored_from_eight_seconds_on(monkeypatch: pytest.MonkeyPatch) -> None:
    found = flown_whole(monkeypatch, 1200)
    assert found.up
    assert found.duration_s == 12.0
    assert found.rms_e_rho_m == pytest.approx(0.1)
    assert found.rms_y_m == pytest.approx(0.2)
    assert found.rms_bank_rad == pytest.approx(0.3)


def test_of_a_flight_that_ended_before_all_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    found = flown_whole(monkeypatch, 800, "disengaged: too low")
    assert not found.up
    assert (found.duration_s, found.ended) == (8.0, "too low")
    assert found.rms_e_rho_m == pytest.approx(sqrt((16.0 + 799.0) / 800.0))
    one_more = flown_whole(monkeypatch, 801, "too low")
    assert one_more.rms_e_rho_m == pytest.approx(0.1)


# --- where it hovers ------------------------------------------------------------------------------

POLAR = GlidePolar(c0=3.22, c1=-0.48, c2=0.03, c3=0.0, speed_min_mps=6.0, speed_max_mps=14.0)
AT = Crossing(x_m=1.0, z_m=2.0, wind_mps=9.0, updraft_mps=1.3, excess_slope_per_s=-0.4, stable=True)


def drawn(stall_rad: float = 0.2) -> Any:
    return SimpleNamespace(
        known=SimpleNamespace(polar=SimpleNamespace(as_polar=lambda: POLAR)),
        true=SimpleNamespace(stall_alpha_rad=stall_rad),
    )


def hovering(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> Crossing | None:
    """Over level ground: a glide at 0.1 rad, 10 m up, 1 m of least clearance, a fence of ± 20 m."""
    case = {
        "at": AT, "alpha_rad": 0.1, "stall_rad": 0.2, "ground_m": -8.0, "dispersion_m": 0.1,
        "fence_z_m": (-20.0, 20.0), "fence_x_m": (-20.0, 20.0), "winds_mps": [], "clear_min_m": 1.0,
        "forbidden": lambda _x, _z: False, **changes,
    }  # fmt: skip

    def glide(_model: Any, wind_mps: float) -> Any:
        case["winds_mps"].append(wind_mps)
        if case["alpha_rad"] is None:
            raise ValueError("no such glide")
        return SimpleNamespace(alpha_rad=case["alpha_rad"])

    def outside(_fence: Any, x: float, _y: float, z: float) -> bool:
        low, high = case["fence_z_m"]
        left, right = case["fence_x_m"]
        inside = low <= z <= high and left <= x <= right
        return not inside or case["forbidden"](x, z)

    monkeypatch.setattr(flights, "stable_crossing", lambda *_: case["at"])
    monkeypatch.setattr(flights, "glide_at", glide)
    monkeypatch.setattr(flights, "clearance", lambda _ground, _x, z: z - case["ground_m"])
    monkeypatch.setattr(flights, "_dispersion_m", lambda *_: case["dispersion_m"])
    monkeypatch.setattr(flights, "outside", outside)
    site: Any = SimpleNamespace(frame=lambda: None, known_ground=lambda: None)
    laws = SimpleNamespace(ground=None, fence=None, target=SimpleNamespace(eta_rad=0.5 * pi + 0.2))
    monkeypatch.setattr(flights, "laws_from", lambda *_, **__: laws)
    air: Any = None
    values = VALUES.changed({"CLEAR_MIN": case["clear_min_m"]})
    return flights._hovering(drawn(case["stall_rad"]), site, air, values, 0.03)


def test_an_aircraft_hovers_where_line_and_contour_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    winds_mps: list[float] = []
    assert hovering(monkeypatch, winds_mps=winds_mps) is AT
    assert winds_mps == [9.0]
    assert hovering(monkeypatch, at=None) is None
    assert hovering(monkeypatch, alpha_rad=None) is None


@pytest.mark.parametrize(("alpha_rad", "clear"), [(0.164, True), (0.166, False)])
def test_a_glide_keeps_two_degrees_from_the_stall(
    monkeypatch: pytest.MonkeyPatch, alpha_rad: float, clear: bool
) -> None:
    assert (hovering(monkeypatch, alpha_rad=alpha_rad) is AT) == clear


@pytest.mark.parametrize(("ground_m", "clear"), [(-0.01, True), (0.01, False)])
def test_it_hovers_at_twice_the_least_clearance(
    monkeypatch: pytest.MonkeyPatch, ground_m: float, clear: bool
) -> None:
    """Two metres up, where the least is one."""
    assert (hovering(monkeypatch, ground_m=ground_m, dispersion_m=0.0) is AT) == clear


@pytest.mark.parametrize(("factor", "clear"), [(0.99, True), (1.01, False)])
def test_four_deviations_along_the_line_stay_clear_of_ground_and_fence(
    monkeypatch: pytest.MonkeyPatch, factor: float, clear: bool
) -> None:
    """The line leans by 0.2 rad: a metre along it is cos 0.2 up and sin 0.2 upwind."""
    for room_m, changes in (
        (9.0 / cos(0.2), {}),  # from 10 m over the ground down to the least of 1 m
        (3.0 / cos(0.2), {"fence_z_m": (-20.0, 5.0)}),
        (3.0 / cos(0.2), {"fence_z_m": (-1.0, 20.0)}),
        (1.0 / sin(0.2), {"fence_x_m": (0.0, 20.0)}),  # its upper end lies upwind
        (1.0 / sin(0.2), {"fence_x_m": (-20.0, 2.0)}),
    ):
        along_m = factor * room_m / 4.0
        found = hovering(monkeypatch, dispersion_m=along_m, **changes)
        assert (found is AT) == clear, changes


def test_the_upper_end_of_the_line_lies_upwind(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the lower one downwind: a corner of the fence there is in the way, the others are not."""
    for upwind, above, clear in (
        *((True, True, False), (True, False, True)),
        *((False, True, True), (False, False, False)),
    ):

        def corner(x: float, z: float, upwind: bool = upwind, above: bool = above) -> bool:
            return (x < AT.x_m - 0.01) == upwind and (z > AT.z_m) == above

        found = hovering(monkeypatch, forbidden=corner)
        assert (found is AT) == clear, (upwind, above)


def test_the_dispersion_is_that_of_a_slide_in_drydens_gusts() -> None:
    """With the polar's slope at the wind there, and the contour's own rate of return."""
    site: Any = SimpleNamespace(air=SimpleNamespace(turbulence=SimpleNamespace(length_scale_m=4.0)))
    air: Any = SimpleNamespace(reference_wind_mps=8.0)
    eta = 0.5 * pi + 0.2
    found = flights._dispersion_m(drawn(), site, air, AT, eta, 0.05)
    slope = -0.48 + 2.0 * 0.03 * 9.0  # of a parabola the difference is exact
    slide = Slide(rate_per_s=1.0, polar_slope=slope, eta_rad=eta)
    slide = slide._replace(rate_per_s=0.4 / leverage(slide))
    assert found == pytest.approx(dryden_dispersion(slide, 0.05 * 8.0, 4.0 / 8.0))
    assert found > 0.0


# --- which aircraft fly ---------------------------------------------------------------------------


def test_aircraft_are_drawn_until_one_has_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """The contour has no such wind for the first, the second has no place on its line."""
    tried: list[tuple[int, ...]] = []

    def draw(_airframe: Any, _ranges: Any, seed: tuple[int, ...]) -> Any:
        tried.append(seed)
        return seed

    def with_line(_field: Any, _site: Any, _air: Any, seed: Any, _values: Any) -> Any:
        if seed[-1] == 0:
            raise ZeucError("no such wind")
        return ("line", seed)

    monkeypatch.setattr(flights, "_place", lambda path: ("site", "air") if path == PATH else None)
    monkeypatch.setattr(flights, "drawn_aircraft", draw)
    monkeypatch.setattr(flights, "_with_line", with_line)
    monkeypatch.setattr(flights, "_hovering", lambda seed, *_: AT if seed[-1] == 2 else None)
    found: Any = flights.soaring_aircraft(PLACE, VALUES, (1, 9))
    assert found == ((1, 9, 2), AT, ("line", (1, 9, 2)))
    tried.clear()
    monkeypatch.setattr(flights, "_hovering", lambda *_: None)
    with pytest.raises(
        ValueError, match=r"of 50 aircraft like .* none has a place to soar on this"
    ):
        flights.soaring_aircraft(PLACE, VALUES, (1, 9))
    assert tried == [(1, 9, n) for n in range(50)]


def test_the_line_goes_through_the_contour_at_a_fraction_of_the_best_glides_speed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(flights, "search_bounds", lambda site: ("bounds", site))
    monkeypatch.setattr(
        flights,
        "place_at_speed_ratio",
        lambda air, polar, bounds, ratio: (
            (-3.0, 4.0 * ratio)
            if (air, polar, bounds) == ("air", POLAR, ("bounds", "site"))
            else None
        ),
    )
    given: Any = ("site", "air", drawn(), VALUES)
    assert flights._with_line(PLACE, *given) is VALUES
    moved = flights._with_line(PLACE._replace(speed_ratio=1.5), *given)
    assert (moved["TGL_X"], moved["TGL_Z"]) == (-3.0, 6.0)
    assert moved["TGL_LEAN"] == 15.0


def test_a_site_without_air_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flights, "load_site", lambda _path: SimpleNamespace(air=None))
    with pytest.raises(ValueError, match=r"sites/calm\.toml: no \[air\] to fly in: name another"):
        flights._place(Path("sites/calm.toml"))


class Looped:
    """A closed loop of made-up flight, ten ticks a second: off the line by 1 m until 8 s and by
    0.1 m from then on, to the side and banked likewise."""

    def __init__(self, crash_s: float = 99.0, mode: str = "soaring", mode_s: float = 99.0) -> None:
        self.ticks = 0
        self.world: Any = SimpleNamespace(
            step_hz=10.0, state=None, crashed=False, why_lost=lambda _state: "hit the board"
        )
        self._crash_s, self._mode, self._mode_s = crash_s, mode, mode_s

    def tick(self) -> Any:
        self.ticks += 1
        time_s = self.ticks / 10.0
        x0, z0, eta = line_of(VALUES)
        off = 1.0 if time_s <= 8.0 else 0.1
        self.world.state = SimpleNamespace(
            x_m=x0 - off * sin(eta), z_m=z0 + off * cos(eta), y_m=2.0 * off,
            qw=cos(0.1 * off), qx=sin(0.1 * off), qy=0.0, qz=0.0,
        )  # fmt: skip
        self.world.crashed = time_s >= self._crash_s
        mode = self._mode if time_s >= self._mode_s else "soaring"
        return SimpleNamespace(mode=mode, reason="why")


def looped(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> DrawnFlight:
    monkeypatch.setattr(flights, "mode_name", lambda mode: mode)
    monkeypatch.setattr(flights, "reason_text", lambda reason: f"because of {reason}")
    loop: Any = Looped(**changes)
    return flights._flown(loop, line_of(VALUES), 10.0)


def test_a_flight_is_scored_from_eight_seconds_on(monkeypatch: pytest.MonkeyPatch) -> None:
    found = looped(monkeypatch)
    assert (found.up, found.ended, found.duration_s) == (True, "", 10.0)
    assert found.rms_e_rho_m == pytest.approx(0.1)
    assert found.rms_y_m == pytest.approx(0.2)
    assert found.rms_bank_rad == pytest.approx(0.02)


def test_a_crash_ends_a_flight_and_all_of_it_counts_where_it_was_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = looped(monkeypatch, crash_s=8.0)
    assert (found.up, found.ended, found.duration_s) == (False, "hit the board", 8.0)
    assert found.rms_e_rho_m == pytest.approx(1.0)
    assert found.rms_y_m == pytest.approx(2.0)
    assert found.rms_bank_rad == pytest.approx(0.2)
    assert looped(monkeypatch, crash_s=8.1).rms_e_rho_m == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("mode", "over"), [("released", True), ("failed", True), ("recovering", False)]
)
def test_who_is_handed_back_is_up_no_more(
    monkeypatch: pytest.MonkeyPatch, mode: str, over: bool
) -> None:
    found = looped(monkeypatch, mode=mode, mode_s=9.0)
    assert found.up != over
    assert found.ended == ("because of why" if over else "")
    assert found.duration_s == (9.0 if over else 10.0)


@pytest.mark.parametrize(("up_m", "clear"), [(0.81, True), (0.79, False)])
def test_the_least_clearance_counts_twice_whatever_it_is(
    monkeypatch: pytest.MonkeyPatch, up_m: float, clear: bool
) -> None:
    """Of 0.4 m: 0.8 m, at 2 m of height."""
    changes = {"ground_m": 2.0 - up_m, "dispersion_m": 0.0, "clear_min_m": 0.4}
    assert (hovering(monkeypatch, **changes) is AT) == clear


# --- with which parameters, and in which world ---------------------------------------------------


@lru_cache(maxsize=1)
def one() -> Drawn:
    return drawn_aircraft(PLACE.airframe, Ranges(), (4,))


def trim_deg(drawn: Drawn, values: ParameterSet) -> float:
    """Of the file that it would have, at its best glide."""
    model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
    return degrees(glide_at(model, values["DYN_BEST"]).pitch_rad)


@pytest.mark.parametrize(("kind", "uses"), [(PLAIN, 0.0), (INERTIAL, 1.0)])
def test_an_aircraft_flies_with_its_own_trim_latency_and_sensors(kind: str, uses: float) -> None:
    """What is allowed of pitch is allowed about the trim."""
    given = VALUES.changed({"EST_IMU": 1.0 - uses, "RHO_P": 0.37})
    values = flights.values_of(given, one(), kind)
    assert values["EST_IMU"] == uses
    assert values["CMD_DELAY"] == pytest.approx(one().latency_s)
    assert values["DYN_BEST"] > one().known.polar.speed_min_mps
    assert values["PITCH_TRIM"] == pytest.approx(trim_deg(one(), values), abs=1e-4)
    shift = values["PITCH_TRIM"] - VALUES["PITCH_TRIM"]
    assert abs(shift) > 1e-3
    for name in ("PITCH_MIN", "PITCH_MAX", "REC_PITCH"):
        assert values[name] - VALUES[name] == pytest.approx(shift, abs=1e-5)
    assert values["RHO_P"] == pytest.approx(0.37)
    assert values["DYN_FREQ"] == pytest.approx(one().known.all_parameters()["DYN_FREQ"], rel=1e-6)


def test_what_the_file_gives_in_its_parameters_is_in_the_values_already() -> None:
    """And is not put in once more from the drawn one."""
    fixed = replace(one().known, parameters={"AIL_P": 0.75})
    assert flights.values_of(VALUES, one(), PLAIN)["AIL_P"] != VALUES["AIL_P"]
    own = flights.values_of(VALUES, one()._replace(known=fixed), PLAIN)
    assert own["AIL_P"] == VALUES["AIL_P"]


def test_gains_of_pitch_are_sought_for_an_aircraft_only_where_it_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(flights, "own_gains", lambda values: {"RHO_P": values["CMD_DELAY"] + 0.5})
    assert flights.values_of(VALUES, one(), PLAIN)["RHO_P"] == VALUES["RHO_P"]
    sought = flights.values_of(VALUES, one(), PLAIN, seeks=True)
    assert sought["RHO_P"] == pytest.approx(one().latency_s + 0.5)  # its delay is known


@pytest.mark.parametrize(("turbulence", "blows"), [(0.05, 0.05), (0.0, 1e-6)])
def test_an_attempt_starts_downstream_of_where_it_hovers_and_flies_what_is_true(
    monkeypatch: pytest.MonkeyPatch, turbulence: float, blows: float
) -> None:
    made: list[Any] = []
    site = load_site(shipped("sites/tunnel.toml"))

    def make(known: Any, where: Any, **more: Any) -> Any:
        made.append((known, where.start, more))
        return SimpleNamespace(parts=SimpleNamespace(_replace=lambda **parts: parts))

    monkeypatch.setattr(flights, "_place", lambda _path: (site, "air"))
    monkeypatch.setattr(flights, "soaring_aircraft", lambda *_: (one(), AT, VALUES))
    monkeypatch.setattr(flights, "make_world", make)
    monkeypatch.setattr(flights, "fly_late", lambda *what: what)
    field = PLACE._replace(duration_s=12.0, unknown_late_s=0.01)
    attempt = flights.Attempt(VALUES, INERTIAL, (1, 2, 3), turbulence)
    world, seed, values, late_s, duration_s = flights.fly_attempt(field, attempt)  # type: ignore[misc]
    ((known, start, more),) = made
    assert known is one().known
    assert (start.x_m, start.z_m) == (AT.x_m + 0.3, AT.z_m)
    assert more["turbulence"] == blows
    assert (more["field"], more["sensors"], more["seed"]) == ("air", one().sensors, seed)
    assert world.parts == {"model": one().true}
    assert late_s == pytest.approx(one().latency_s + 0.01)
    assert (duration_s, values["EST_IMU"]) == (12.0, 1.0)
    again = flights.fly_attempt(field, attempt)[1]
    other = flights.fly_attempt(field, attempt._replace(seed=(1, 2, 4)))[1]
    assert again == seed != other
    assert 1000 < int(seed) < 2**31  # not one of a few


def test_where_numba_is_there_a_late_flight_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []
    monkeypatch.setattr(flights, "available", lambda: True)
    monkeypatch.setattr(flights, "prepare", lambda world, seconds: (world, seconds))
    monkeypatch.setattr(flights, "LateCompiledWorld", lambda *what: what)
    monkeypatch.setattr(flights, "CompiledLoop", lambda world, values: ("loop", world, values))
    monkeypatch.setattr(flights, "_flown", lambda *what: given.append(what))
    world: Any = object()
    flights.fly_late(world, 5, VALUES, 0.02, 12.0)
    assert given == [(("loop", ((world, 12.0), 5, 4), VALUES), line_of(VALUES), 12.0)]


def test_a_late_compiled_world_is_made_for_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    taken: list[Any] = []
    monkeypatch.setattr(CompiledWorld, "__init__", lambda _self, *what: made.append(what))
    monkeypatch.setattr(CompiledWorld, "step", lambda _self, command: taken.append(command))
    prepared: Any = SimpleNamespace(world=SimpleNamespace(trim=SimpleNamespace(elevator=0.1)))
    late = flights.LateCompiledWorld(prepared, 6, 1)
    sent = [SurfaceCommand(0.2, 0.3, 0.4), SurfaceCommand(0.5, 0.6, 0.7)]
    for command in sent:
        late.step(command)
    assert made == [(prepared, 6)]
    assert taken == [SurfaceCommand(0.1, 0.0, 0.0), sent[0]]


def test_where_it_is_not_a_whole_flight_is_flown_tick_by_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(flights, "available", lambda: False)
    monkeypatch.setattr(flights, "ClosedLoop", lambda world, values: ("loop", world, values))
    monkeypatch.setattr(flights, "_flown", lambda *what: given.append(what))
    world: Any = object()
    flights.fly_whole(world, 5, VALUES, 12.0)
    assert given == [(("loop", world, VALUES), line_of(VALUES), 12.0)]


def test_a_site_is_read_once_with_its_air_beside_its_file(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Any] = []
    site = SimpleNamespace(air="there")
    monkeypatch.setattr(flights, "load_site", lambda path: read.append(path) or site)  # type: ignore[func-returns-value]
    monkeypatch.setattr(flights, "site_field", lambda site, folder: (site, folder))
    path = Path("sites/known_once.toml")
    for _ in range(2):
        found: Any = flights._place(path)
        assert found == (site, (site, Path("sites")))
    assert read == [path]
