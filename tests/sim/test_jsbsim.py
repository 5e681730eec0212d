"""The aircraft against JSBSim on the same coefficients: step responses in still and moving air.

JSBSim gets an aircraft written from our model: the same laws of force and moment, in its own
words and units, integrated by its own code on its own round earth.  What must agree is
everything that our code does with them: axes, signs, rotation, inertial coupling, wind.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest
from field_step import step_in_field
from msgspec.structs import asdict

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.aircraft import (
    AircraftModel,
    AircraftState,
    Wind,
    aircraft_model,
    glide_at,
    gliding_state,
)
from tgl_soar.types import SurfaceCommand

jsbsim = pytest.importorskip("jsbsim")

FOOT_M = 0.3048
DT_S = 0.0025  # ours
# JSBSim's forces come from the state one step before: its steps are so much shorter that this
# lag of 0.06 ms hardly shows.  What is left shrinks with it.
STEPS_OF_JSBSIM = 40

# Rates: a full roll command begins with 20 rad/s², times that lag, twice.  Angles: those rates
# over the 0.2 s that they last.  Velocities: air thins by 1e-4 in each metre of height there and
# not here; 2 m of it are 2e-4 of g for a second.  Any sign or axis gone wrong shows 100 times
# as much.
RATE_RADPS, ANGLE_RAD, VELOCITY_MPS = 3e-3, 5e-4, 2e-3
MOVES_AT_LEAST = 0.03  # m/s and rad: ten times the largest tolerance

Surfaces = Callable[[float], SurfaceCommand]
WindOf = Callable[[float], Wind]


def _sum(*terms: str) -> str:
    return f"<sum>{''.join(terms)}</sum>"


def _product(*factors: str | float) -> str:
    return f"<product>{''.join(map(_atom, factors))}</product>"


def _atom(item: str | float) -> str:
    if isinstance(item, float):
        return f"<value>{item!r}</value>"
    return item if item.startswith("<") else f"<property>{item}</property>"


def _softplus(argument: str, width: float) -> str:
    inner = f"<exp><quotient>{argument}<value>{width!r}</value></quotient></exp>"
    return _product(width, f"<ln>{_sum('<value>1</value>', inner)}</ln>")


def _function(name: str, body: str) -> str:
    return f'<function name="{name}">{body}</function>'


def _aircraft_xml(m: AircraftModel) -> str:
    """The model as a JSBSim aircraft."""
    alpha, beta = "aero/alpha-rad", "aero/beta-rad"
    elevator, aileron, rudder = (f"fcs/{s}-pos-norm" for s in ("elevator", "aileron", "rudder"))
    p, q, r = (f"velocities/{s}-aero-rad_sec" for s in "pqr")
    above = _softplus(f"<difference>{_atom(alpha)}{_atom(m.stall_alpha_rad)}</difference>",
                      m.stall_width_rad)  # fmt: skip
    below = _softplus(f"<difference>{_atom(m.stall_alpha_negative_rad)}{_atom(alpha)}</difference>",
                      m.stall_width_rad)  # fmt: skip
    cosine = f"<cos>{_atom(alpha)}</cos>"
    sin_beta = f"<sin>{_atom(beta)}</sin>"
    shape = _product(cosine, cosine, _sum(_atom(3.0), _product(-2.0, cosine)))
    attached = f"<difference>{_atom(alpha)}{_atom('test/above')}</difference>"
    linear = _sum(_atom(m.CL0), _product(m.CL_alpha, _sum(attached, _atom("test/below"))))
    lift = _sum(_product(linear, shape), _product(m.CL_elevator, elevator))
    drag = _sum(
        _atom(m.CD0),
        _product(m.CD_lift, "test/cl", "test/cl"),
        _product(m.CD_separated, f"<sin>{_sum(_atom('test/above'), _atom('test/below'))}</sin>"),
        _product(m.CD_beta, sin_beta, sin_beta),
    )
    side = _sum(_product(m.CY_beta, sin_beta), _product(m.CY_rudder, rudder))
    by_span = "aero/bi2vel"
    roll = _sum(
        _product(m.Cl_beta, sin_beta),
        _product(by_span, m.Cl_p, p),
        _product(by_span, m.Cl_r, r),
        _product(m.Cl_aileron, aileron),
    )
    pitch = _sum(
        _atom(m.Cm0),
        _product(m.Cm_alpha, f"<sin>{_atom(alpha)}</sin>"),
        _product("aero/ci2vel", m.Cm_q, q),
        _product(m.Cm_elevator, elevator),
    )
    yaw = _sum(
        _product(m.Cn_beta, sin_beta),
        _product(by_span, m.Cn_p, p),
        _product(by_span, m.Cn_r, r),
        _product(m.Cn_rudder, rudder),
        _product(m.Cn_aileron, aileron),
    )
    force = ("aero/qbar-psf", "metrics/Sw-sqft")
    axes = {
        "DRAG": _product(*force, drag),
        "SIDE": _product(*force, side),
        "LIFT": _product(*force, "test/cl"),
        "ROLL": _product(*force, "metrics/bw-ft", roll),
        "PITCH": _product(*force, "metrics/cbarw-ft", pitch),
        "YAW": _product(*force, "metrics/bw-ft", yaw),
    }
    written = "".join(
        f'<axis name="{name}">{_function(f"test/{name}", body)}</axis>'
        for name, body in axes.items()
    )
    origin = '<location name="{}" unit="M"><x>0</x><y>0</y><z>0</z></location>'
    return f"""<?xml version="1.0"?>
<fdm_config name="glider" version="2.0" release="ALPHA">
<fileheader><author>tests</author><description>written from our own model</description></fileheader>
<metrics>
<wingarea unit="M2">{m.wing_area_m2}</wingarea><wingspan unit="M">{m.span_m}</wingspan>
<chord unit="M">{m.chord_m}</chord>{origin.format("AERORP")}{origin.format("EYEPOINT")}
</metrics>
<mass_balance>
<ixx unit="KG*M2">{m.ixx_kgm2}</ixx><iyy unit="KG*M2">{m.iyy_kgm2}</iyy>
<izz unit="KG*M2">{m.izz_kgm2}</izz><emptywt unit="KG">{m.mass_kg}</emptywt>
{origin.format("CG")}
</mass_balance>
<ground_reactions/><propulsion/><flight_control name="none"/>
<aerodynamics>
{_function("test/above", above)}{_function("test/below", below)}{_function("test/cl", lift)}
{written}
</aerodynamics>
</fdm_config>
"""


# A sphere that does not turn, with one standard gravity at its surface.
_RADIUS_M = 6_371_000.0
_PLANET_XML = f"""<?xml version="1.0"?>
<planet name="still">
<semimajor_axis unit="M">{_RADIUS_M}</semimajor_axis>
<semiminor_axis unit="M">{_RADIUS_M}</semiminor_axis>
<rotation_rate unit="RAD/SEC">0</rotation_rate>
<GM unit="M3/SEC2">{9.80665 * _RADIUS_M**2!r}</GM>
<J2>0</J2>
</planet>
"""


def _model() -> AircraftModel:
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    return aircraft_model(asdict(airframe.airframe), airframe.model)


def _jsbsim(folder: Path, model: AircraftModel, start: AircraftState, wind: Wind) -> Any:
    """JSBSim in our state: our upwind NED is its NED, our wind from the north."""
    place = folder / "glider"
    place.mkdir(exist_ok=True)
    (place / "glider.xml").write_text(_aircraft_xml(model))
    planet = folder / "still.xml"
    planet.write_text(_PLANET_XML)
    fdm = jsbsim.FGFDMExec(str(folder))
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(folder))
    assert fdm.load_planet(str(planet), False)
    assert fdm.load_model("glider")
    fdm.set_dt(DT_S / STEPS_OF_JSBSIM)
    fdm["simulation/gravity-model"] = 0
    roll, pitch, yaw = euler_from_quaternion(start.qw, start.qx, start.qy, start.qz)
    fdm["ic/lat-geod-deg"] = 0.0
    fdm["ic/h-sl-ft"] = 100.0  # air and gravity change by 1e-5 of themselves in a metre
    fdm["ic/phi-rad"], fdm["ic/theta-rad"], fdm["ic/psi-true-rad"] = roll, pitch, yaw
    fdm["ic/vn-fps"] = -start.velocity_x_mps / FOOT_M
    fdm["ic/ve-fps"] = start.velocity_y_mps / FOOT_M
    fdm["ic/vd-fps"] = -start.velocity_z_mps / FOOT_M
    _steer(fdm, SurfaceCommand(start.elevator, start.aileron, start.rudder))
    assert fdm.run_ic()
    _blow(fdm, wind)  # initial conditions begin in still air
    return fdm


def _same_air(fdm: Any, model: AircraftModel) -> AircraftModel:
    """The model in JSBSim's air and gravity at its height."""
    return model._replace(
        air_density_kgpm3=fdm["atmosphere/rho-slugs_ft3"] * 515.3788183931961,
        gravity_mps2=fdm["accelerations/gravity-ft_sec2"] * FOOT_M,
    )


def _blow(fdm: Any, wind: Wind) -> None:
    fdm["atmosphere/wind-north-fps"] = -wind[0] / FOOT_M
    fdm["atmosphere/wind-east-fps"] = wind[1] / FOOT_M
    fdm["atmosphere/wind-down-fps"] = -wind[2] / FOOT_M


def _steer(fdm: Any, surfaces: SurfaceCommand) -> None:
    fdm["fcs/elevator-pos-norm"] = surfaces.elevator
    fdm["fcs/aileron-pos-norm"] = surfaces.aileron
    fdm["fcs/rudder-pos-norm"] = surfaces.rudder


def _theirs(fdm: Any) -> tuple[float, ...]:
    """Velocity over the ground [m/s, soaring], angles [rad], body rates [rad/s]."""
    return (
        -fdm["velocities/v-north-fps"] * FOOT_M,
        fdm["velocities/v-east-fps"] * FOOT_M,
        -fdm["velocities/v-down-fps"] * FOOT_M,
        fdm["attitude/phi-rad"],
        fdm["attitude/theta-rad"],
        (fdm["attitude/psi-rad"] + pi) % (2.0 * pi) - pi,
        fdm["velocities/p-rad_sec"],
        fdm["velocities/q-rad_sec"],
        fdm["velocities/r-rad_sec"],
    )


def _ours(state: AircraftState) -> tuple[float, ...]:
    """The same nine numbers of our state."""
    return (
        *state[3:6],
        *euler_from_quaternion(state.qw, state.qx, state.qy, state.qz),
        *state[10:13],
    )


def _largest_differences(
    folder: Path, surfaces: Surfaces, wind: WindOf, duration_s: float
) -> tuple[list[float], list[float]]:
    """Largest difference of the nine numbers over a flight, and the largest excursion."""
    model = _model()
    first = wind(0.0)
    trim = glide_at(model, 8.55)
    state = gliding_state(trim, first)
    fdm = _jsbsim(folder, model, state, first)
    model = _same_air(fdm, model)
    start = _ours(state)
    differences, excursions = [0.0] * 9, [0.0] * 9
    for k in range(round(duration_s / DT_S)):
        time = k * DT_S
        new = surfaces(time)
        # a step of the surfaces is one in JSBSim: hold them over the whole of ours
        state = state._replace(elevator=new.elevator, aileron=new.aileron, rudder=new.rudder)
        state = step_in_field(model, state, new, lambda *place: wind(place[3]), time, DT_S)
        _steer(fdm, new)
        for j in range(STEPS_OF_JSBSIM):
            _blow(fdm, wind(time + j * DT_S / STEPS_OF_JSBSIM))
            fdm.run()
        for i, (a, b, c) in enumerate(zip(_ours(state), _theirs(fdm), start, strict=True)):
            differences[i] = max(differences[i], abs(a - b))
            excursions[i] = max(excursions[i], abs(a - c))
    return differences, excursions


NEUTRAL = 0.0041  # elevator of the glide at 8.55 m/s


def _elevator_up(time_s: float) -> SurfaceCommand:
    """Into the stall and out of it: 0.2 of the travel for 0.6 s."""
    return SurfaceCommand(NEUTRAL + (0.2 if 0.1 <= time_s < 0.7 else 0.0), 0.0, 0.0)


def _elevator_down(time_s: float) -> SurfaceCommand:
    return SurfaceCommand(NEUTRAL - (0.2 if time_s >= 0.1 else 0.0), 0.0, 0.0)


def _aileron(time_s: float) -> SurfaceCommand:
    return SurfaceCommand(NEUTRAL, 0.3 if 0.1 <= time_s < 0.5 else 0.0, 0.0)


def _rudder(time_s: float) -> SurfaceCommand:
    return SurfaceCommand(NEUTRAL, 0.0, 0.5 if 0.1 <= time_s < 0.6 else 0.0)


def _all_three(time_s: float) -> SurfaceCommand:
    on = 1.0 if 0.1 <= time_s < 0.6 else -0.5 if time_s < 1.2 else 0.0
    return SurfaceCommand(NEUTRAL + 0.1 * on, 0.3 * on, -0.4 * on)


def _hands_off(time_s: float) -> SurfaceCommand:  # noqa: ARG001 - nothing moves
    return SurfaceCommand(NEUTRAL, 0.0, 0.0)


def _still(time_s: float) -> Wind:  # noqa: ARG001
    return 0.0, 0.0, 0.0


def _slope(time_s: float) -> Wind:  # noqa: ARG001
    return 8.55, 0.0, 1.35


def _gusts(time_s: float) -> Wind:
    return (
        8.55 + 0.8 * sin(2.0 * time_s),
        0.6 * sin(3.0 * time_s),
        1.35 + 0.5 * (1.0 - cos(4.0 * time_s)),
    )


@pytest.mark.parametrize(
    ("surfaces", "wind", "moves"),
    [
        (_elevator_up, _still, (4,)),
        (_elevator_down, _slope, (0, 4)),
        (_aileron, _slope, (1, 3, 5)),
        (_rudder, _slope, (3, 5)),
        (_all_three, _still, (1, 3, 4, 5)),
        (_hands_off, _gusts, (0, 1, 2, 3, 4, 5)),
        (_all_three, _gusts, (1, 3, 4, 5)),
    ],
)
def test_step_responses_agree(
    tmp_path: Path, surfaces: Surfaces, wind: WindOf, moves: tuple[int, ...]
) -> None:
    difference, excursion = _largest_differences(tmp_path, surfaces, wind, 2.0)
    assert min(excursion[i] for i in moves) > MOVES_AT_LEAST, "the flight must show something"
    assert max(difference[0:3]) < VELOCITY_MPS
    assert max(difference[3:6]) < ANGLE_RAD
    assert max(difference[6:9]) < RATE_RADPS
