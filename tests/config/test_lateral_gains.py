"""Gains of roll, heading and bank: from the airframe's effects, with margins on any aircraft."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi, tan

import numpy as np
import pytest
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.lateral_gains import LATENCY_S, lateral_gains
from tgl_soar.control.heading import leading_speed
from tgl_soar.control.lateral_schedule import (
    heading_gains,
    lateral_bandwidth,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.laws import SIDEWAYS_FILTER_RADPS, laws_from
from tgl_soar.geometry import SoaringFrame, euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import AircraftModel, AircraftState, aircraft_model, glide_at, step
from tgl_soar.types import SurfaceCommand

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME = load_airframe(AIRFRAME_PATH)
NAMES = (
    *("AIL_P", "AIL_I", "AIL_D", "RUD_P", "RUD_D", "SIDE_P", "SIDE_I"),
    *("LAT_SPEED", "LAT_LATE"),
)
WAYPOINT_M = 6.0  # from the tunnel's lines
HOLD_S = 0.0025  # half of a tick
FREQUENCIES = np.geomspace(0.05, 200.0, 400)
Floats = NDArray[np.float64]


def changed(**model: float) -> Airframe:
    return replace(AIRFRAME, model={**AIRFRAME.model, **model})


def test_the_shipped_aircraft_flies_with_them() -> None:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    gains = lateral_gains(AIRFRAME)
    assert set(gains) == set(NAMES)
    for name, gain in gains.items():
        assert values[name] == pytest.approx(gain, rel=1e-6)


def test_what_the_file_gives_stands() -> None:
    given = replace(AIRFRAME, parameters={**AIRFRAME.parameters, "AIL_P": 0.75})
    values = load_parameters(given, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    assert values["AIL_P"] == 0.75
    assert values["AIL_D"] == pytest.approx(lateral_gains(AIRFRAME)["AIL_D"], rel=1e-6)


@pytest.mark.parametrize("missing", ["Cl_p", "servo_lag_radps", "Cn_rudder"])
def test_a_file_without_a_model_has_the_defaults(missing: str) -> None:
    model = {name: value for name, value in AIRFRAME.model.items() if name != missing}
    assert lateral_gains(replace(AIRFRAME, model=model)) == {}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("servo_lag_radps", value) for value in (0.0, -1.0)),
        ("servo_delay_s", -0.001),
    ],
)
def test_a_model_that_no_gain_fits_has_the_defaults(name: str, value: float) -> None:
    assert lateral_gains(changed(**{name: value})) == {}


def test_a_servo_without_a_pure_delay_has_gains() -> None:
    assert lateral_gains(changed(servo_delay_s=0.0))


def test_half_the_effect_takes_twice_the_gain_and_a_slow_servo_less() -> None:
    gains = lateral_gains(AIRFRAME)
    weak = lateral_gains(changed(Cl_aileron=0.5 * AIRFRAME.model["Cl_aileron"]))
    assert weak["AIL_P"] == pytest.approx(2.0 * gains["AIL_P"])
    assert weak["SIDE_P"] == gains["SIDE_P"]
    slow = lateral_gains(changed(servo_lag_radps=1.0 / 0.08))
    late = 1.0 / AIRFRAME.model["servo_lag_radps"] + LATENCY_S
    assert slow["AIL_P"] == pytest.approx(gains["AIL_P"] * late / (0.08 + LATENCY_S))


def linear(model: AircraftModel, speed_mps: float) -> tuple[Floats, Floats]:
    """d/dt of (y, v_y, roll, heading, p, r) by itself, and by aileron and rudder: differences."""
    glide = glide_at(model, speed_mps)
    wind = (glide.horizontal_mps, 0.0, glide.sink_mps)
    short_s = 1e-5

    def rate(x: Floats, surfaces: Floats) -> Floats:
        q = quaternion_from_euler(x[2], glide.pitch_rad, x[3])
        aileron, rudder = surfaces
        state = AircraftState(
            x_m=0.0,
            y_m=x[0],
            z_m=0.0,
            velocity_x_mps=0.0,
            velocity_y_mps=x[1],
            velocity_z_mps=0.0,
            qw=q[0],
            qx=q[1],
            qy=q[2],
            qz=q[3],
            roll_rate_frd_radps=x[4],
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=x[5],
            elevator=glide.elevator,
            aileron=aileron,
            rudder=rudder,
        )
        command = SurfaceCommand(glide.elevator, aileron, rudder)
        after = step(model, state, command, wind, wind, short_s)
        roll, _, heading = euler_from_quaternion(after.qw, after.qx, after.qy, after.qz)
        now = np.array(
            [
                *(after.y_m, after.velocity_y_mps, roll, heading),
                *(after.roll_rate_frd_radps, after.yaw_rate_frd_radps),
            ]
        )
        return (now - x) / short_s

    small = 1e-4
    a = [(rate(small * e, np.zeros(2)) - rate(-small * e, np.zeros(2))) for e in np.eye(6)]
    b = [(rate(np.zeros(6), small * e) - rate(np.zeros(6), -small * e)) for e in np.eye(2)]
    return np.array(a).T / (2.0 * small), np.array(b).T / (2.0 * small)


def disk_margins(
    airframe: Airframe,
    speed_mps: float,
    late_s: float,
    changes: Mapping[str, float] | None = None,
) -> tuple[float, float]:
    """Of the loops opened at aileron and rudder, one at a time, the other closed; 0: unstable.

    changes: factors of the parameters that the file gives.
    """
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    a, b = linear(model, speed_mps)
    servo = airframe.model["servo_lag_radps"]
    values = load_parameters(airframe, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    values = values.changed({name: by * values[name] for name, by in (changes or {}).items()})
    laws = laws_from(values.changed({"CMD_DELAY": late_s}), SoaringFrame(0.0, 0.0, 0.0, 0.0))
    schedule = laws.lateral_schedule
    f = lateral_bandwidth(schedule, 0.0)
    ail = roll_gains(laws.roll, schedule, f, speed_mps)
    rud = heading_gains(laws.heading, schedule, f, speed_mps).pid
    side = sideways_gains(laws.sideways, schedule, f)
    leading = leading_speed(
        laws.heading, side.kd, WAYPOINT_M + laws.heading.waypoint_x_m, speed_mps
    )
    y, v, roll, heading, p, r = np.eye(6)

    def opened(w: float) -> NDArray[np.complex128]:
        s = 1j * w
        plant = np.linalg.solve(s * np.eye(6) - a, b)
        actuator = servo / (s + servo) * np.exp(-s * (late_s + HOLD_S))
        filtered = 1.0 / (1.0 + s / (2.0 * pi * 40.0))
        setpoint = -y / WAYPOINT_M
        sideways = side.kd / (1.0 + s / SIDEWAYS_FILTER_RADPS) + side.ki / s
        bank = sideways * (leading * setpoint - v)
        aileron = (ail.kp + ail.ki / s) * (bank - roll) - ail.kd * filtered * p
        rudder = rud.kp * (setpoint - heading) - rud.kd * filtered * r
        return np.asarray(-actuator * np.array([aileron, rudder]) @ plant)

    if not settles(a, opened):
        return 0.0, 0.0
    worst = [0.0, 0.0]
    for w in FREQUENCIES:
        loop = opened(w)
        for k, other in ((0, 1), (1, 0)):
            closed = loop[k, k] - loop[k, other] * loop[other, k] / (1.0 + loop[other, other])
            worst[k] = max(worst[k], abs(1.0 / (1.0 + closed) - 0.5))
    return 1.0 / worst[0], 1.0 / worst[1]


def settles(a: Floats, opened: Callable[[float], NDArray[np.complex128]]) -> bool:
    """Whether all of the closed loop decays: Nyquist's criterion of det(1 + L), times what the
    aircraft and the two integrals of the laws have of their own, over as many poles at -1.

    That is 1 far above all, and real far below; of each growing root it turns back by half a turn.
    """
    turns = 0.0
    before = complex(1.0)
    for k, w in enumerate(np.geomspace(1e-3, 1e3, 600)):
        s = 1j * w
        whole = np.linalg.det(s * np.eye(6) - a) * np.linalg.det(np.eye(2) + opened(w))
        now = complex(whole * s**2 / (s + 1.0) ** 8)
        if k > 0:
            turns += float(np.angle(now / before))
        before = now
    return turns > -0.5 * pi


@pytest.mark.parametrize(
    "changes",
    [
        {"AIL_P": 7.5},
        {"RUD_D": 15.0},
        {"SIDE_P": 6.0},
        {"SIDE_P": 0.05, "SIDE_I": 20.0},  # an integral alone, that swings slowly
    ],
)
def test_what_is_unstable_has_no_margin(changes: dict[str, float]) -> None:
    """|1 / (1 + L) - 1/2| is as small as ever on the far side of -1: it shows no stability."""
    assert disk_margins(AIRFRAME, 8.7, 0.0245, changes) == (0.0, 0.0)
    assert min(disk_margins(AIRFRAME, 8.7, 0.0245)) > 0.5


@pytest.mark.parametrize("servo_s", [0.015, 0.0185, 0.030, 0.080])
@pytest.mark.parametrize("late_s", [0.005, 0.0245, 0.040, 0.080])
def test_every_latency_and_servo_leaves_a_disk_margin_of_a_half(
    servo_s: float, late_s: float
) -> None:
    """0.5 is the floor of a good loop (4.4 dB and 28 degrees at once), from slow to fast air."""
    airframe = changed(servo_lag_radps=1.0 / servo_s)
    for speed in (7.6, 10.0, 14.0):
        assert min(disk_margins(airframe, speed, late_s)) >= 0.5


@pytest.mark.parametrize(
    "model",
    [
        {"Cl_aileron": 0.07, "Cn_rudder": 0.036},
        {"Cl_aileron": 0.13, "Cn_rudder": 0.062},
        {"Cl_p": -0.32, "Cl_beta": -0.09},
        {"Cl_p": -0.58, "Cn_beta": 0.11},
    ],
)
def test_so_does_an_aircraft_of_other_effects(model: dict[str, float]) -> None:
    assert min(disk_margins(changed(**model), 8.7, 0.0245)) >= 0.5


def test_the_model_of_this_test_is_the_aircraft() -> None:
    """A bank accelerates sideways by g, less what the sideslip alpha · roll takes of it (6 %); the
    aileron has the file's effect."""
    model = aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model)
    a, b = linear(model, 8.7)
    assert a[1, 2] == pytest.approx(0.94 * 9.8, rel=0.05)
    assert b[4, 0] == pytest.approx(67.0 * (8.7 / 8.5) ** 2, rel=0.05)
    assert a[3, 4] == pytest.approx(0.0, abs=tan(0.1))
