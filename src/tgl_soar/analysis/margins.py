"""Margins over speed, lean and latency: what the loops can bear, on the linear model.

For each condition the loop of pitch with the scheduled gains is opened at the elevator and at e_rho
(`linear_model`), those of roll and heading at the aileron and at the rudder (`lateral_model`; they
know no lean); turbulence gives the spread of e_rho and of the elevator.  The latency is taken to be
known to the schedule (CMD_DELAY).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan, radians
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import asdict

from tgl_soar.analysis.lateral_model import lateral_loop
from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import BREAKS, Margin, activity, close_loop, margin
from tgl_soar.analysis.linear_plant import Condition, Gusts, linear_plant
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params


class MarginCase(NamedTuple):
    """One condition."""

    speed_mps: float
    lean_deg: float
    delay_s: float
    inertial: bool  # with accelerometers


class CaseMargins(NamedTuple):
    """What one condition leaves."""

    case: MarginCase
    elevator: Margin
    line: Margin
    aileron: Margin
    rudder: Margin
    e_rho_m: float  # standard deviation in turbulence; NaN: unstable
    activity: float  # of the elevator

    @property
    def alpha(self) -> float:
        """The disk margin of the worst break."""
        return min(found.alpha for found in self.breaks)

    @property
    def breaks(self) -> tuple[Margin, ...]:
        """Elevator, line, aileron, rudder."""
        return self.elevator, self.line, self.aileron, self.rudder


def case_margins(
    airframe: Airframe, values: ParameterSet, cases: Sequence[MarginCase], gusts: Gusts
) -> Iterator[CaseMargins]:
    """The margins of each case, in order.

    Errors: ValueError for a model that is not complete, or a speed at which it has no glide.
    """
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    servo = servo_params(airframe.model)
    lateral: dict[tuple[float, float, bool], tuple[Margin, Margin]] = {}
    for case in cases:
        known = values.changed({"CMD_DELAY": case.delay_s, "TGL_LEAN": case.lean_deg})
        laws = laws_from(known, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics())
        condition = Condition(
            model=model,
            servo=servo,
            speed_mps=case.speed_mps,
            lean_rad=radians(case.lean_deg),
            sensors=Sensors(imu=MEMS_IMU) if case.inertial else USUAL_SENSORS,
            command_delay_s=case.delay_s,
        )
        loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
        elevator, line = (margin(loop, at) for at in BREAKS)
        spread, moved = nan, nan
        if min(elevator.alpha, line.alpha) > 0.0:
            found = activity(laws, condition, gusts)
            spread, moved = found.e_rho_m, found.elevator
        upright = (case.speed_mps, case.delay_s, case.inertial)
        if upright not in lateral:
            sideways = lateral_loop(laws, condition)
            lateral[upright] = margin(sideways, "aileron"), margin(sideways, "rudder")
        aileron, rudder = lateral[upright]
        yield CaseMargins(
            case=case,
            elevator=elevator,
            line=line,
            aileron=aileron,
            rudder=rudder,
            e_rho_m=spread,
            activity=moved,
        )


def worst(rows: Sequence[CaseMargins]) -> CaseMargins:
    """The case with the least margin."""
    return min(rows, key=lambda row: row.alpha)


def least_gain_db(row: CaseMargins) -> float:
    """The gain, up or down, that the loops bear at every break."""
    return (
        min(min(found.gain_up_db, -found.gain_down_db) for found in row.breaks)
        if row.alpha > 0.0
        else 0.0
    )


def least_phase_deg(row: CaseMargins) -> float:
    """The phase that they bear at every break."""
    return min(found.phase_deg for found in row.breaks)


def least_delay_s(row: CaseMargins) -> float:
    """The further delay that they bear at every break."""
    return min(found.delay_s for found in row.breaks)


def margins_figure(path: Path, rows: Sequence[CaseMargins], floor: float, title: str) -> None:
    """alpha over speed, a panel for each latency and sensor, a line for each lean.

    Errors: ImportError without matplotlib, ValueError for a kind of file that it does not know,
    OSError.
    """
    from matplotlib.figure import Figure

    panels = sorted({(row.case.inertial, row.case.delay_s) for row in rows}, reverse=True)
    leans = sorted({row.case.lean_deg for row in rows})
    figure = Figure(figsize=(3.2 * len(panels), 3.4), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for panel, (inertial, delay_s) in zip(axes, panels, strict=True):
        for lean in leans:
            line = [
                (row.case.speed_mps, row.alpha)
                for row in rows
                if row.case[1:] == (lean, delay_s, inertial)
            ]
            panel.plot(*zip(*line, strict=True), marker="o", label=f"lean {lean:g}°")
        panel.axhline(floor, color="0.5", linestyle="--")
        panel.set_ylim(0.0, max(1.0, max(row.alpha for row in rows)))
        panel.set_xlabel("airspeed [m/s]")
        panel.set_title(f"with{'' if inertial else 'out'} accelerometers, {1e3 * delay_s:.3g} ms")
    axes[0].set_ylabel("disk margin α, the worst break")
    axes[-1].legend()
    figure.suptitle(title)
    figure.savefig(path, dpi=150)


def grid(
    values: ParameterSet,
    speeds_mps: Sequence[float],
    leans_deg: Sequence[float],
    delays_s: Sequence[float],
) -> list[MarginCase]:
    """All of them, with accelerometers first; without alone where the parameters use none."""
    return [
        MarginCase(speed, lean, delay, inertial)
        for inertial in ((True, False) if values["EST_IMU"] else (False,))
        for delay in delays_s
        for lean in leans_deg
        for speed in speeds_mps
    ]
