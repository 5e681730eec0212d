"""Disk margins of the two loops that hold a point, over speed and lean: `analysis.brake_loop`.

With the link that gains were found with.  What a later one leaves of the elevator's loop is for
`tgl-soar margins` to say; the brake's is looked at 17 ms later too.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import radians
from typing import Final, NamedTuple

from tgl_soar.analysis.brake_loop import BrakeMargin, brake_margin
from tgl_soar.analysis.experiments.result import Claim, Table
from tgl_soar.analysis.experiments.scenario import PreparedScenario
from tgl_soar.analysis.linear_plant import Condition, field_gradient
from tgl_soar.control.laws import laws_from
from tgl_soar.control.loop_margin import FLOOR
from tgl_soar.sim.aircraft import AircraftModel
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.servos import servo_params
from tgl_soar.sim.world import flown_aircraft

SPEEDS_MPS: Final = (8.7, 10.0, 12.0)
LEANS_DEG: Final = (10.0, 15.0, 25.0)
LINK_S: Final = 0.0075  # from a tick to the servo, as the shipped gains have it
LATER_S: Final = 0.017  # overrides through an autopilot at 50 Hz, beside that


class PointMargin(NamedTuple):
    """At one place and speed, the least over the leans."""

    place: str
    speed_mps: float
    margin: BrakeMargin
    later_alpha: float  # of the brake's loop, with commands LATER_S later


def point_margins(places: dict[str, PreparedScenario]) -> list[PointMargin]:
    """At the point of each scenario's first line.  Errors: ValueError without a glide."""
    found = []
    for name, prepared in places.items():
        line = prepared.lines[prepared.scenario.first_line].target
        gradient = field_gradient(prepared.field, line.x_m, line.z_m)
        for speed in SPEEDS_MPS:
            near, late = (
                _least([_margin(prepared, gradient, speed, lean, later_s) for lean in LEANS_DEG])
                for later_s in (0.0, LATER_S)
            )
            found.append(PointMargin(name, speed, near, late.alpha))
    return found


def _margin(
    prepared: PreparedScenario,
    gradient: tuple[float, float, float, float],
    speed_mps: float,
    lean_deg: float,
    later_s: float,
) -> BrakeMargin:
    airframe = prepared.airframe
    model = flown_aircraft(airframe)
    assert isinstance(model, AircraftModel)
    values = prepared.values.changed({"TGL_HOLD": 1.0})
    return brake_margin(
        laws_from(values, prepared.site.frame(), airframe.aerodynamics()),
        Condition(
            model=model,
            servo=servo_params(airframe.model),
            speed_mps=speed_mps,
            lean_rad=radians(lean_deg),
            sensors=Sensors(imu=MEMS_IMU),
            command_delay_s=LINK_S + later_s,
            gradient_per_s=gradient,
        ),
    )


def _least(margins: Sequence[BrakeMargin]) -> BrakeMargin:
    return BrakeMargin(
        alpha=min(m.alpha for m in margins),
        crossover_radps=max(m.crossover_radps for m in margins),
        elevator_alpha=min(m.elevator_alpha for m in margins),
        line_alpha=min(m.line_alpha for m in margins),
    )


def margins_claim(margins: Sequence[PointMargin]) -> Claim:
    """Of both loops, and of the brake's with later commands too."""
    brake = min(min(m.margin.alpha, m.later_alpha) for m in margins)
    elevator = min(m.margin.elevator_alpha for m in margins)
    alone = min(m.margin.line_alpha for m in margins)
    return Claim(
        f"both loops have a disk margin of at least {FLOOR:g}",
        min(brake, elevator) >= FLOOR,
        f"the brake's {brake:.2f}, the elevator's {elevator:.2f} ({alone:.2f} without the brake)",
    )


def margins_table(margins: Sequence[PointMargin]) -> Table:
    """The least over leans of 10 to 25 degrees."""
    columns = (
        "place", "speed [m/s]", "α of the brake's loop", "crossover [rad/s]",
        f"{1000 * LATER_S:.0f} ms later", "α of the elevator's", "the same, brake at rest",
    )  # fmt: skip
    rows = tuple(
        (
            m.place,
            f"{m.speed_mps:g}",
            f"{m.margin.alpha:.2f}",
            f"{m.margin.crossover_radps:.1f}",
            f"{m.later_alpha:.2f}",
            f"{m.margin.elevator_alpha:.2f}",
            f"{m.margin.line_alpha:.2f}",
        )
        for m in margins
    )
    words = f"Disk margins, the least of leans of {LEANS_DEG[0]:g}° to {LEANS_DEG[-1]:g}°"
    return Table(words, columns, rows)
