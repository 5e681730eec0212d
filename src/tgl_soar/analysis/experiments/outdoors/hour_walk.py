"""AOSoar's walk over an hour: it goes on until the module is on its way home.

The walk and its constants are those of `searchers.Walk`.  It gives nothing up: that is the
module's, which breaks off by itself and may use a propeller, as it does for whoever moves the line.
The mode is *searching*, as in a search: lines are asked for outside the site's own contour.
"""

from __future__ import annotations

from tgl_soar.analysis.search.episode import SEARCHING
from tgl_soar.analysis.search.searchers import Walk
from tgl_soar.analysis.search.steered_flight import COLUMN, SteeredFlight
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.supervisor import BREAKING_OFF
from tgl_soar.onboard.line_moves import line_parameters_of
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.compiled import available
from tgl_soar.sim.world import World
from tgl_soar.types import GlidePolar


def walked(
    world: World, values: ParameterSet, polar: GlidePolar, duration_s: float, seed: int
) -> Trajectory:
    """A flight in which the walk moves the line; errors: as of `SteeredFlight`."""
    flight = SteeredFlight(
        world, values.changed(SEARCHING), polar, duration_s, seed, plain=not available()
    )
    walk: Walk | None = None
    while flight.flies:
        look = flight.look()
        if look is None or flight.now is None:
            continue
        if flight.rows[flight.now.steps - 1, COLUMN["mode"]] >= BREAKING_OFF:
            continue
        walk = walk or Walk(look, "hill", seed)
        flight.set(line_parameters_of(walk.look(look).target))
    return flight.trajectory()
