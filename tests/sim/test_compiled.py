"""Compiled flights against plain ones: the same source, so the same flight."""

from __future__ import annotations

import gc
import random
import sys
from collections.abc import Callable
from functools import lru_cache, partial
from math import inf, nan, radians
from typing import Literal

import msgspec
import numpy as np
import pytest

from tgl_soar.air.field import WindField
from tgl_soar.air.grid import GridField
from tgl_soar.air.gusts import BlendedField, Gust, GustyField, ScaledField, Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet
from tgl_soar.config.site import Site, Tether
from tgl_soar.control.envelope import EnvelopeLimits, limit_surfaces
from tgl_soar.control.laws import laws_from
from tgl_soar.control.point_hold import ABOVE_BAND, HOLDS
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.closed_loop import Change, ClosedLoop, Trajectory, fly
from tgl_soar.sim.compiled import available, compiled
from tgl_soar.sim.compiled_air import UnknownFieldError, air_inside, air_wind, as_air
from tgl_soar.sim.compiled_flight import (
    CompiledLoop,
    CompiledWorld,
    begun,
    fly_compiled,
    fly_on,
    prepare,
)
from tgl_soar.sim.faults import Fault, parse_fault
from tgl_soar.sim.flight import Row, fly_ticks
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import (
    AUTOPILOT_ATTITUDE,
    MEMS_IMU,
    MOTION_CAPTURE,
    PITOT,
    READ_BACK,
    USUAL_SENSORS,
    Sensors,
)
from tgl_soar.sim.world import World, build_field, make_world
from tgl_soar.types import SurfaceCommand

needs_numba = pytest.mark.skipif(not available(), reason="numba is not installed")

FLIGHT_S = 10.0
# The same operations in the same order: what is left are the last bits of sines and logarithms,
# which a stable loop does not let grow.
AGREE = 1e-6
# One more of everything, at rates and delays of their own.
ALL_SENSORS = Sensors(
    position=MOTION_CAPTURE,
    attitude=AUTOPILOT_ATTITUDE,
    imu=MEMS_IMU._replace(delay_s=0.01),
    airspeed=PITOT,
    surfaces=READ_BACK,
)


@lru_cache(maxsize=4)
def place(
    name: str, airframe_name: str = "eclipson_c"
) -> tuple[Airframe, Site, ParameterSet, WindField, tuple[Change, ...]]:
    """A shipped site, its field, and two of its lines to move between."""
    airframe_path = shipped(f"airframes/{airframe_name}.toml")
    site_path = shipped(f"sites/{name}.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    assert site.air is not None
    changes = tuple(
        Change(5.0 * i, line_parameters(line)) for i, line in enumerate(site.lines.values())
    )
    values = load_parameters(airframe, airframe_path, site, site_path)
    return airframe, site, values, build_field(site.air), changes[:2]


def both(
    name: str,
    seed: int,
    turbulence: float,
    field: WindField | None = None,
    changes: tuple[Change, ...] | None = None,
    duration_s: float = FLIGHT_S,
    sensors: Sensors = USUAL_SENSORS,
    airframe_name: str = "eclipson_c",
) -> tuple[Trajectory, Trajectory]:
    """The same flight, plain and all compiled."""
    airframe, site, values, site_field, lines = place(name, airframe_name)
    changes = lines if changes is None else changes
    field = field or site_field
    world, other = (
        make_world(airframe, site, seed=s, turbulence=turbulence, field=field, sensors=sensors)
        for s in (seed, seed + 1)  # the prepared one's own seed must play no part
    )
    fast = fly_compiled(prepare(other, duration_s), seed, values, changes)
    return fly(world, values, changes, duration_s), fast


def assert_same(plain: Trajectory, fast: Trajectory) -> None:
    assert fast.ended == plain.ended
    assert fast.ticks == plain.ticks
    for name in Row._fields:
        np.testing.assert_allclose(fast[name], plain[name], rtol=0.0, atol=AGREE, err_msg=name)


@needs_numba
@pytest.mark.parametrize("turbulence", [0.0, 0.03])
@pytest.mark.parametrize("name", ["tunnel", "hill"])
def test_a_compiled_flight_is_the_plain_one(name: str, turbulence: float) -> None:
    plain, fast = both(name, 5, turbulence)
    assert plain.ended == ""
    assert plain["target_changes"][-1] == 2.0
    assert np.ptp(plain["x_m"]) > 0.02  # it did fly
    assert_same(plain, fast)


def holders(value: object) -> list[int]:
    """How many hold each array and each list within nested tuples."""
    if isinstance(value, tuple):
        return [count for part in value for count in holders(part)]
    if isinstance(value, np.ndarray):
        return [sys.getrefcount(value)]
    return [value._opaque.refcount] if hasattr(value, "_opaque") else []


@needs_numba
def test_a_compiled_flight_releases_all_that_it_was_handed() -> None:
    """A kernel counts no references: what is freed once too often is no array any more."""
    airframe, site, values, field, _ = place("tunnel")
    world = make_world(airframe, site, seed=5, turbulence=0.01, field=field)
    parts, flight = begun(prepare(world, 1.0), 5)
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
    rows = np.empty((200, len(Row._fields)))
    gc.collect()  # the tunnel's arrays are those of other tests' flights, which may not be gone yet
    before = holders((parts, rows))
    # 17 of the air, 2 of the turbulence, 11 of the sensors, and the rows
    assert len(before) == 31
    flown = fly_on(parts, laws, flight, 200, 0, rows)
    assert flown.steps == 200
    gc.collect()  # whoever has just compiled may hold what it compiled for, until then
    assert holders((parts, rows)) == before


@needs_numba
def test_a_taut_tether_is_the_same_compiled() -> None:
    airframe, site, values, field, changes = place("tunnel")
    assert site.start is not None
    tether = Tether(x_m=site.start.x_m, z_m=site.start.z_m - 0.3, length_m=0.35)
    tied = msgspec.structs.replace(site, tether=tether)
    world, other = (
        make_world(airframe, tied, seed=s, turbulence=0.01, field=field) for s in (5, 6)
    )
    plain = fly(world, values, changes, 2.0)
    assert max(np.hypot(plain["x_m"] - tether.x_m, plain["z_m"] - tether.z_m)) > tether.length_m
    assert_same(plain, fly_compiled(prepare(other, 2.0), 5, values, changes))


@needs_numba
@pytest.mark.parametrize("turbulence", [0.0, 0.03])
@pytest.mark.parametrize("name", ["tunnel", "hill"])
def test_a_plain_module_in_a_compiled_world_flies_the_same(name: str, turbulence: float) -> None:
    airframe, site, values, field, changes = place(name)
    world = make_world(airframe, site, seed=5, turbulence=turbulence, field=field)
    fast = CompiledWorld(prepare(world, FLIGHT_S), 5)
    np.testing.assert_equal(fast.position, world.position)  # nothing has arrived yet
    np.testing.assert_allclose(fast.wind, world.wind, rtol=0.0, atol=AGREE)
    plain = fly(world, values, changes, FLIGHT_S)
    assert_same(plain, fly(fast, values, changes, FLIGHT_S))
    with pytest.raises(ValueError, match="prepared for 2000 steps"):
        fast.step(SurfaceCommand(0.0, 0.0, 0.0))


@needs_numba
def test_with_every_sensor_a_compiled_flight_is_the_plain_one() -> None:
    plain, fast = both("tunnel", 5, 0.03, sensors=ALL_SENSORS)
    assert plain.ended == ""
    assert_same(plain, fast)


@needs_numba
def test_every_sensor_gives_a_compiled_world_the_same_samples() -> None:
    airframe, site, _, field, _ = place("tunnel")
    world, other = (
        make_world(airframe, site, seed=s, turbulence=0.03, field=field, sensors=ALL_SENSORS)
        for s in (5, 6)
    )
    fast = CompiledWorld(prepare(other, 1.0), 5)
    world.held = fast.held = True
    for step in range(200):
        for sensed in ("position", "attitude", "imu", "airspeed", "surfaces"):
            plain, kernel = getattr(world, sensed), getattr(fast, sensed)
            assert kernel.sequence == plain.sequence
            np.testing.assert_allclose(kernel, plain, rtol=0.0, atol=AGREE, err_msg=sensed)
        if step == 50:
            world.held = fast.held = False
        command = SurfaceCommand(0.1 + 0.001 * step, -0.02, 0.03)
        world.step(command)
        fast.step(command)
    assert (world.imu.sequence, world.airspeed.sequence, world.surfaces.sequence) == (199, 50, 50)


@needs_numba
def test_air_that_changes_in_time_is_the_same_compiled() -> None:
    """A board that is tilted, wind that rises, and a gust: all that compiled flights know."""
    blended = BlendedField(
        SlopeJet(8.5, 0.40), SlopeJet(8.5, 0.42), Schedule([1.0, 4.0], [0.0, 1.0])
    )
    rising = ScaledField(blended, Schedule([2.0, 6.0], [1.0, 1.05]))
    gusty = GustyField(
        rising, [Gust(start_s=3.0, duration_s=1.0, u_mps=0.3, v_mps=0.1, w_mps=-0.2)]
    )
    plain, fast = both("tunnel", 3, 0.01, gusty)
    assert_same(plain, fast)
    calm, _ = both("tunnel", 3, 0.01)
    assert np.max(np.abs(plain["x_m"] - calm["x_m"])) > 0.02  # the air did change


@needs_numba
def test_a_flight_that_ends_early_ends_alike() -> None:
    """Thrown into the board by a gust; left behind by a line that moves too fast."""
    field = place("tunnel")[3]
    gusty = GustyField(
        field, [Gust(start_s=2.0, duration_s=0.6, u_mps=-6.0, v_mps=0.0, w_mps=-3.0)]
    )
    # The site's fence and the forecast would end the flight before: here there are none.
    x, z = PARAMETERS[INDEX["FENCE_X_MIN"]], PARAMETERS[INDEX["FENCE_Z_MIN"]]
    gone = {"FENCE_X_MIN": x.minimum, "FENCE_Z_MIN": z.minimum, "FC_ACT": 0.0}
    no_fence = Change(0.0, gone)
    plain, fast = both("tunnel", 3, 0.0, gusty, (no_fence,))
    assert plain.ended.startswith("hit the board")
    assert_same(plain, fast)
    disengaged = Change(3.0, {"CAPTURE_MAX": 0.1, "TGL_SLEW": 1.0, "TGL_ACCEL": 5.0, "TGL_X": 0.5})
    plain, fast = both("tunnel", 3, 0.03, None, (disengaged,))
    assert plain.ended == "disengaged: e_rho beyond CAPTURE_MAX"
    assert_same(plain, fast)


@needs_numba
def test_a_command_that_is_not_a_number_is_judged_alike() -> None:
    limits = EnvelopeLimits(
        deflection_max=0.8,
        rate_max_per_s=4.0,
        alpha_max_rad=0.2,
        speed_min_mps=6.0,
        sink_max_mps=5.0,
        clearance_min_m=0.0,
        glide_pitch_rad=-0.05,
        brake_throw=0.0,
        elevator_room=inf,
        elevator_per_radps=0.0,
    )
    last = SurfaceCommand(0.1, -0.2, 0.3, 0.4)
    for value in (nan, inf, -inf, 0.5, -2.0):
        wanted = SurfaceCommand(value, 0.0, -value, value)
        plain = limit_surfaces(limits, last, wanted, 0.5, 1.0, True, 0.005)
        assert compiled(limit_surfaces)(limits, last, wanted, 0.5, 1.0, True, 0.005) == plain


def flown_with_faults(
    world: World, faults: list[Fault], ticks: int, kind: type[ClosedLoop] = ClosedLoop
) -> list[tuple[float, ...]]:
    loop = kind(world, place("tunnel")[2], Injection(faults, 3))
    rows: list[tuple[float, ...]] = []
    for _ in range(ticks):
        output = loop.tick()
        rows.append((output.mode, *output.command, world.state.x_m, world.state.z_m))
    return rows


@needs_numba
def test_faults_act_alike_in_a_plain_and_in_a_compiled_world() -> None:
    faults = [
        parse_fault("position.loss start=1 for=2 fraction=0.3"),
        parse_fault("attitude.bias start=1.5 for=1 roll=4 pitch=-2 heading=1"),
        parse_fault("elevator.slow start=2 for=1 rate=1.5"),
        parse_fault("air.gust start=2 for=1 along=0.7 up=0.3"),
        parse_fault("air.stop start=3 for=1 to=0.9"),
        parse_fault("position.dropout start=3 for=1.4"),
    ]
    airframe, site, _, field, _ = place("tunnel")
    air = Injection(faults, 3).field(field)

    def world() -> World:
        return make_world(airframe, site, seed=3, turbulence=0.02, field=air, sensors=ALL_SENSORS)

    plain = flown_with_faults(world(), faults, 900)
    fast = flown_with_faults(CompiledWorld(prepare(world(), 5.0), 3), faults, 900, CompiledLoop)
    assert {MODE_NAMES[int(row[0])] for row in plain} >= {"ready", "capturing"}
    for a, b in zip(plain, fast, strict=True):
        assert a == pytest.approx(b, abs=AGREE)


@needs_numba
def test_what_is_set_between_two_ticks_acts_in_a_compiled_loop_too() -> None:
    """A parameter, and where the aircraft is put."""
    airframe, site, values, field, _ = place("tunnel")
    rows = []
    for loop_kind, compiles in ((ClosedLoop, False), (CompiledLoop, True)):
        world = make_world(
            airframe, site, seed=3, turbulence=0.02, field=field, sensors=ALL_SENSORS
        )
        if compiles:
            world = CompiledWorld(prepare(world, 6.0), 3)
        loop = loop_kind(world, values.changed(line_parameters(site.lines["b"])))
        for k in range(900):
            if k == 500:
                before = world.state
                loop.change({"TGL_Z": loop.values["TGL_Z"] + 0.2})
                world.state = before._replace(y_m=before.y_m + 0.1)
            loop.tick()
        rows.append((world.state.x_m, world.state.y_m, world.state.z_m))
    assert rows[0] == pytest.approx(rows[1], abs=AGREE)
    assert abs(before.z_m - rows[0][2]) > 0.05


@needs_numba
def test_an_hour_is_flown_without_drift() -> None:
    """Time and the laws' memories, over 720,000 ticks of one flight; `campaign long` does more."""
    airframe, site, values, field, _ = place("tunnel")
    line = line_parameters(site.lines["b"])
    world = make_world(airframe, site, seed=1, turbulence=0.01, field=field)
    flight = fly_compiled(prepare(world, 3600.0), 1, values.changed(line), ())
    assert flight.ended == ""
    assert flight.ticks == 720_000
    assert np.array_equal(flight["time_s"], np.arange(720_000) * (1.0 / 200))
    e_rho = flight["e_rho_m"]
    first, last = e_rho[12_000:132_000], e_rho[-120_000:]  # ten minutes, without the capture
    assert np.sqrt(np.mean(last**2)) < 1.2 * np.sqrt(np.mean(first**2)) < 0.05


def grid(depth: int, outside: Literal["nan", "edge", "still"]) -> GridField:
    """Random wind, a corner of it solid; depth: nodes along y, 0 for a plane."""
    rng = np.random.default_rng(7)
    x, y, z = np.linspace(-6.0, 3.0, 19), np.linspace(-2.0, 2.0, max(depth, 2)), np.arange(9.0)
    shape = (19, depth, 9) if depth else (19, 9)
    u, v, w = 8.5 + rng.standard_normal((3, *shape))
    solid = np.zeros(shape, dtype=bool)
    solid[8:14, ..., :2] = True
    return GridField(
        x, y if depth else None, z, u, v, w, reference_wind_mps=8.5, solid=solid, outside=outside
    )


@pytest.mark.parametrize(
    "made",
    [
        partial(SlopeJet, 9.0, 0.40),
        partial(HillField, 7.0, 8.0),
        partial(HillField, 7.0, 8.0, 0.14),
        partial(HillField, 7.0, 8.2, 0.0, 8.0),
        partial(HillField, 7.0, 7.8, 0.0, 8.0),
        partial(grid, 0, "nan"),
        partial(grid, 0, "edge"),
        partial(grid, 3, "nan"),
        partial(grid, 3, "still"),
    ],
)
def test_the_air_as_data_is_the_field_everywhere(made: Callable[[], WindField]) -> None:
    """Also on edges, in the ground, and outside."""
    field = made()
    air = as_air(field)
    rng = random.Random(4)
    places = [(rng.uniform(-10, 10), rng.uniform(-3, 3), rng.uniform(-1, 10)) for _ in range(5000)]
    places += [(x, 0.0, z) for x in (0.0, 1.0, -6.0, -8.0) for z in (0.0, 0.4, 8.0, -1e-9)]
    assert {field.inside(*p) for p in places} == {True, False}
    for place in places:
        np.testing.assert_allclose(
            air_wind(air, *place), field.wind_at(*place, 0.0), rtol=0.0, atol=1e-12
        )
        assert air_inside(air, *place) == field.inside(*place)


@needs_numba
def test_a_measured_grid_is_flown_alike() -> None:
    """The tunnel's field, read off at nodes."""
    jet = place("tunnel")[3]
    x, z = np.arange(-1.0, 1.5, 0.05), np.arange(0.0, 4.0, 0.05)
    u, _, w = jet.wind(x[:, np.newaxis], 0.0, z)
    solid = z < 0.4245 * np.maximum(x[:, np.newaxis], 0.0)
    field = GridField(x, None, z, u, None, w, reference_wind_mps=8.5, solid=solid)
    plain, fast = both("tunnel", 3, 0.01, field)
    assert plain.ended == ""
    assert_same(plain, fast)


def test_an_unknown_field_is_named() -> None:
    class Still:
        reference_wind_mps = 8.0
        wind: Callable[..., None]

        def wind_at(self, *_: float) -> tuple[float, float, float]:
            return 8.5, 0.0, 1.4

        def inside(self, *_: float) -> bool:
            return True

    with pytest.raises(UnknownFieldError, match="Still"):
        as_air(Still())  # type: ignore[arg-type]


@needs_numba
def test_changes_come_at_the_same_tick() -> None:
    """Also at times that are no sum of steps, twice at once, and after the end."""
    lines = [c.parameters for c in place("tunnel")[4]]
    times = (0.0, 0.3, 0.3, 0.5050001, 0.7 - 1e-12, 5.0)
    changes = tuple(Change(t, lines[i % 2]) for i, t in enumerate(times))
    plain, fast = both("tunnel", 2, 0.0, None, changes, 1.0)
    assert plain["target_changes"][-1] == 5.0
    np.testing.assert_array_equal(fast["target_changes"], plain["target_changes"])


@needs_numba
def test_a_multisine_is_the_same_compiled() -> None:
    changes = (Change(7.0, {"EXC_START": 1.0}), Change(9.5, {"EXC_START": 0.0}))
    plain, fast = both("tunnel", 3, 0.01, None, changes, 10.0, ALL_SENSORS)
    runs = (plain["time_s"] > 7.5) & (plain["time_s"] < 9.5)
    assert np.std(plain["injected_rad"][runs]) > radians(0.2)
    assert not np.any(plain["injected_rad"][plain["time_s"] > 9.51])
    assert_same(plain, fast)


@needs_numba
def test_a_point_is_held_alike_compiled() -> None:
    """Within the band, then far above it, where the law comes to an end and the brake is shaken."""
    changes = (
        Change(0.0, {"TGL_HOLD": 2.0, "TGL_ALONG": -0.1}),
        Change(8.0, {"TGL_ALONG": 0.3}),
    )
    plain, fast = both(
        "tunnel", 3, 0.01, None, changes, 20.0, ALL_SENSORS, airframe_name="eclipson_c_spoilers"
    )
    assert {HOLDS, ABOVE_BAND} <= set(plain["point"])
    assert np.ptp(plain["brake"]) > 0.3
    late = plain["time_s"] > 14.0
    assert np.ptp(plain["brake"][late]) > 0.15  # it is shaken
    assert_same(plain, fast)


@needs_numba
def test_a_throttle_opens_alike_compiled() -> None:
    """On a line upstream of the board without a place to settle, and after its budget is gone."""
    changes = (
        Change(0.0, {"THR_BUDGET": 0.6}),
        Change(3.0, {"TGL_X": -0.3, "TGL_Z": 1.3}),
    )
    name = "eclipson_c_propeller"
    plain, fast = both("tunnel", 3, 0.01, None, changes, 12.0, ALL_SENSORS, airframe_name=name)
    assert 0.1 < plain["throttle"].max() < 1.0
    assert plain["throttle"].sum() / 200.0 == pytest.approx(0.6)
    assert_same(plain, fast)


@needs_numba
def test_only_functions_of_the_kernel_have_one() -> None:
    with pytest.raises(KeyError):
        compiled(make_world)
    assert compiled(fly_ticks) is compiled(fly_ticks)
