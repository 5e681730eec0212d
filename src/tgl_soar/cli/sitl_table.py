"""What `tgl-soar sitl` shows of a flight: a line while it flies, and the table at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.table import Table

from tgl_soar.autopilot import mode_name
from tgl_soar.cli.console import console, say
from tgl_soar.sim.score import SETTLE_S, SETTLED_FOR_S, SETTLED_M, TAIL_S

if TYPE_CHECKING:
    from tgl_soar.sim.operator import Operator
    from tgl_soar.sim.sitl import SitlFlight
    from tgl_soar.sim.sitl_options import SitlOptions

LEGEND: Final = (
    f"settled after: from the line's stop to {SETTLED_FOR_S:g} s with e_rho within"
    f" {100 * SETTLED_M:g} cm; rms and peak leave out the first {SETTLE_S:g} s",
    "ZEUC: the contour where updraft equals sink; TGL ∩ ZEUC: where the line crosses it, the place"
    f" to settle; mean and dispersion: of the last {TAIL_S:g} s",
)


def show_flight(options: SitlOptions, flight: SitlFlight) -> None:
    """The scores of the legs, and what disturbed them."""
    table = Table(
        "leg",
        "settled after",
        "rms e_rho",
        "peak e_rho",
        "dispersion",
        "mean to TGL ∩ ZEUC",
        title="from the truth of the simulation",
    )
    for score, flown in zip(flight.scores, flight.flown, strict=True):
        settled = f"{score.settling_s:.1f} s" if score.settled else "[red]not held[/red]"
        if flown.broken_off and not score.settled:
            settled = "broken off"
        if flown.released:
            settled = "[red]disengaged[/red]"
        table.add_row(
            score.name,
            "moved by hand" if flown.by_hand else settled,
            f"{score.rms_e_rho_m * 100:.2f} cm",
            f"{score.peak_e_rho_m * 100:.1f} cm",
            f"{score.dispersion_m * 100:.1f} cm",
            f"{score.crossing_m * 100:.1f} cm" if score.crossing_m == score.crossing_m else "–",
        )
    console.print(table)
    if flight.scores:
        for words in LEGEND:
            say(words)
    for note in flight.notes:
        console.print(note, style="yellow", markup=False, highlight=False, soft_wrap=True)
    if flight.landing is not None:
        say(flight.landing.words())
    simulated = flight.truth["time_s"][-1]
    say(f"{simulated:.0f} s of flight in {flight.wall_s:.0f} s; logs and figure in {options.out}/")


def progress_of(operator: Operator) -> Table:
    """One line of the flight as the ground station sees it."""
    values = operator.telemetry.values
    leg = operator.flown[-1].leg.name if operator.flown else "–"

    def number(name: str, form: str, unit: str) -> str:
        value = values.get(name)
        return "–" if value is None else f"{value:{form}} {unit}"

    mode = values.get("soar_mode")
    table = Table("time", "leg", "mode", "e_rho", "x", "z", "updraft", "sink", box=None)
    table.add_row(
        f"{operator.telemetry.time_s:.1f} s",
        leg,
        "–" if mode is None or mode != mode else mode_name(int(mode)),
        number("e_rho", "+.3f", "m"),
        number("soar_x", ".2f", "m"),
        number("soar_z", ".2f", "m"),
        number("updraft", ".2f", "m/s"),
        number("sink", ".2f", "m/s"),
    )
    return table
