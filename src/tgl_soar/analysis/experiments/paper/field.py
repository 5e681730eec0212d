"""`field`: the hill of potential flow, an illustrative polar, and three places on the contour.

The polar is a parabola, made so that both its slow and its fast place sink 1.7 m/s:

    sink = 1.5 + 0.2 (u − 9)²        1.7 m/s at u = 8 and u = 10, least 1.5 m/s at 9

[b] is its best glide, where sink = u d sink/du, u² = 9² + 1.5 / 0.2, u = 9.407 m/s.  It is no
aircraft's; nothing is flown.
"""

from __future__ import annotations

from math import degrees, hypot
from typing import Final, NamedTuple

from tgl_soar.air.gusts import ScaledField
from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import Bounds, WindSensitivity, stable_crossing, wind_sensitivity
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import perpendicular_lean, place_at_speed_ratio
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.types import GlidePolar, polar_sink, polar_slope

SINK_MPS: Final = 1.7
WIND_MPS: Final = 8.0
RADIUS_M: Final = 20.0
STRONGER: Final = 1.05  # the wind that shows which way each place moves
LEAST_MPS, CURVATURE, MIDDLE_MPS = 1.5, 0.2, 9.0
POLAR: Final = GlidePolar(
    c0=LEAST_MPS + CURVATURE * MIDDLE_MPS**2,
    c1=-2.0 * CURVATURE * MIDDLE_MPS,
    c2=CURVATURE,
    c3=0.0,
    speed_min_mps=6.8,
    speed_max_mps=11.5,
)
BOUNDS: Final[Bounds] = (-60.0, 0.0, 1.0, 50.0)


class HillPosition(NamedTuple):
    """One of the three places."""

    name: str
    x_m: float
    z_m: float
    wind_mps: float
    updraft_mps: float
    lean_rad: float  # perpendicular to the contour
    sensitivity: WindSensitivity
    shift_m: float  # along the line, when the wind is STRONGER times as strong
    stable: bool


def positions() -> list[HillPosition]:
    """[a], [b] and [c] on the hill."""
    field = HillField(WIND_MPS, RADIUS_M)
    stronger = ScaledField(field, STRONGER)
    best = best_glide_speed(POLAR)
    reach = ((SINK_MPS - LEAST_MPS) / CURVATURE) ** 0.5
    found = []
    for name, speed in (("a", MIDDLE_MPS - reach), ("b", best), ("c", MIDDLE_MPS + reach)):
        x, z = place_at_speed_ratio(field, POLAR, BOUNDS, speed / best)
        lean = perpendicular_lean(field, POLAR, x, z)
        target = TargetLine(x, z, eta_from_lean(lean))
        here = stable_crossing(field, POLAR, target)
        there = stable_crossing(stronger, POLAR, target)
        assert here is not None
        assert there is not None
        shift = hypot(there.x_m - here.x_m, there.z_m - here.z_m)
        found.append(
            HillPosition(
                name=name,
                x_m=here.x_m,
                z_m=here.z_m,
                wind_mps=here.wind_mps,
                updraft_mps=here.updraft_mps,
                lean_rad=lean,
                sensitivity=wind_sensitivity(field, POLAR, here, target.eta_rad),
                shift_m=shift if there.z_m > here.z_m else -shift,
                stable=here.stable,
            )
        )
    return found


def claims_of(places: list[HillPosition]) -> tuple[Claim, ...]:
    """What the three places say."""
    a, b, c = places
    return (
        Claim(
            f"[a] and [c] lie on the contour with the same sink of {SINK_MPS} m/s at different"
            " speeds",
            all(abs(p.updraft_mps - SINK_MPS) < 0.005 for p in (a, c)) and a.wind_mps < c.wind_mps,
            f"updraft {a.updraft_mps:.3f} m/s in {a.wind_mps:.2f} m/s of wind at [a],"
            f" {c.updraft_mps:.3f} m/s in {c.wind_mps:.2f} m/s at [c]",
        ),
        Claim(
            "an aircraft stays at each of them on a line perpendicular to the contour",
            all(p.stable for p in places),
            "excess updraft falls going up each line",
        ),
        Claim(
            "a little more wind lifts the place on the slow side [a], leaves best glide [b] where"
            " it is, and lowers the place beyond [c]",
            a.sensitivity.along_m_per_mps > 0.0 > c.sensitivity.along_m_per_mps
            and abs(b.sensitivity.margin) < 0.002,
            "sink/u − d sink/du is "
            + ", ".join(f"{p.sensitivity.margin:+.3f} at [{p.name}]" for p in places),
            # sink/u − S′ is 0 at best glide by its definition, and falls with speed on a parabola.
            by_construction=True,
        ),
    )


def why(places: list[HillPosition]) -> str:
    """How far the three are from standing still, and what the module would fly there."""
    b = places[1]
    refused = [
        f"[{p.name}]" for p in places if degrees(p.lean_rad) < ParameterSet()["TGL_LEAN_MIN"]
    ]
    return (
        "The parabola, the wind and the radius are ours. [b] holds still to first order only:"
        f" {100 * (STRONGER - 1):.0f} % more wind move it by {b.shift_m:+.2f} m"
        + (", as past best glide sink grows faster than updraft." if b.shift_m < 0.0 else ".")
        + (
            f" The perpendicular at {' and '.join(refused)} leans downwind, or less upwind than the"
            " module takes (see `lean`): it flies such places on lines that lean upwind."
            if refused
            else " The module takes each of these lines."
        )
    )


def run(context: Context) -> Result:
    """Compute and draw."""
    places = positions()
    rows = tuple(
        (
            f"[{p.name}]",
            f"{p.x_m:.1f}",
            f"{p.z_m:.1f}",
            f"{p.wind_mps:.2f}",
            f"{p.updraft_mps:.3f}",
            f"{polar_slope(POLAR, p.wind_mps):+.3f}",
            f"{p.sensitivity.margin:+.3f}",
            f"{degrees(p.lean_rad):.0f}",
            f"{p.sensitivity.along_m_per_mps:+.2f}",
            f"{p.shift_m:+.2f}",
        )
        for p in places
    )
    path = context.figure("field")
    if path is not None:
        from tgl_soar.analysis.report.positions_figure import MarkedPlace, positions_figure

        field = HillField(WIND_MPS, RADIUS_M)
        positions_figure(
            path,
            field,
            ScaledField(field, STRONGER),
            POLAR,
            BOUNDS,
            RADIUS_M,
            [
                MarkedPlace(
                    name=p.name,
                    x_m=p.x_m,
                    z_m=p.z_m,
                    wind_mps=p.wind_mps,
                    updraft_mps=p.updraft_mps,
                    lean_rad=p.lean_rad,
                )
                for p in places
            ],
            f"ZEUC in {100 * (STRONGER - 1):.0f} % more wind",
        )
    return Result(
        name="field",
        title="three places on a hill of potential flow",
        flown=f"Half cylinder of {RADIUS_M:g} m radius in {WIND_MPS:g} m/s of wind, and a parabola"
        f" as polar, sink = {LEAST_MPS:g} + {CURVATURE:g} (u − {MIDDLE_MPS:g})², which is no"
        " aircraft's: it is made so that two speeds share a sink of 1.7 m/s. Nothing is flown.",
        claims=claims_of(places),
        why=why(places),
        tables=(
            Table(
                "",
                (
                    "place", "x [m]", "z [m]", "wind u [m/s]", "updraft = sink [m/s]", "S′",
                    "sink/u − S′", "perpendicular lean [°]", "shift per m/s, first order [m]",
                    f"shift in {100 * (STRONGER - 1):.0f} % more wind [m]",
                ),
                rows,
            ),
        ),
        numbers={"best_glide_mps": best_glide_speed(POLAR), "sink_at_best_glide_mps": polar_sink(
            POLAR, best_glide_speed(POLAR)), "places": [p._asdict() | {
                "sensitivity": p.sensitivity._asdict()} for p in places]},
        figures=() if path is None else (path.name,),
    )  # fmt: skip
