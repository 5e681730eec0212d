"""`lift_map` on few places: its maps differ as they should, and its rings hold what they say."""

from __future__ import annotations

import numpy as np

from tgl_soar.analysis.experiments.lift.lift_map import MAPS, RINGS, _grounds, glide, rings_of, rms
from tgl_soar.analysis.search.places import TUNED_ON, place
from tgl_soar.config.files import load_airframe, shipped

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
HILLS = [place("hill", TUNED_ON + k) for k in range(6)]


def test_the_ground_is_worth_more_than_half_of_the_error_on_hills() -> None:
    found = {name: rings_of(HILLS, POLAR, _grounds(HILLS, name), 4.0) for name in MAPS}
    for k in range(1, len(RINGS)):
        blind = rms(found["without the ground"][k].squares)
        assert rms(found["as it flies"][k].squares) < 0.5 * blind
    # It never claims more than it knows: χ² of one degree of freedom.
    for ring in found["as it flies"]:
        assert np.mean(ring.normalised) < 2.0


def test_a_glide_moves_with_the_excess_updraft() -> None:
    there = HILLS[0]
    lift, path = glide(there, POLAR, there.ground, 4.0)
    assert lift.readings == len(path) == 21
    rises = path[-1][1] - path[0][1]
    assert rises != 0.0
    assert np.sign(path[0][0] - path[-1][0]) == np.sign(rises)  # a lean of 15° upwind
