"""Mutants that people made: changes of what matters most, through which wrong code once passed.

`python tools/mutate.py --named` tries them.  Each is a piece of a source, which stands there once,
and what is put in its place.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from mutations import Mutation

SOURCE: Final = Path("src/tgl_soar")


class Named(NamedTuple):
    """A change, by the text that it replaces in a file below `SOURCE`."""

    file: str
    old: str
    new: str
    words: str  # what is wrong then


NAMED: Final = (
    # The supervisor's table and the envelope's constants.
    Named(
        "control/supervisor.py",
        "    Transition(HOLDING, TROUBLED, AIR_SAFE, RECOVERING, GLIDE, REASON_STALL),\n",
        "",
        "holding does not recover from a stall",
    ),
    Named(
        "control/supervisor.py",
        "    Transition(HOLDING, TROUBLED, HIGH_ENOUGH, RECOVERING, GLIDE, REASON_LOW),\n",
        "",
        "holding does not recover from flying low",
    ),
    Named(
        "control/supervisor.py",
        "        Transition(mode, TROUBLED, AIR_SAFE, RECOVERING, GLIDE, REASON_STALL),\n",
        "",
        "a line is flown on in a stall",
    ),
    Named(
        "control/envelope.py",
        "STALL_BEYOND: Final = 0.05",
        "STALL_BEYOND: Final = 0.5",
        "a stall begins ten times as deep",
    ),
    Named(
        "control/envelope.py",
        "CLEAR_FACTOR: Final = 1.3",
        "CLEAR_FACTOR: Final = 0.5",
        "clear of the ground again below the least clearance",
    ),
    # What one law knows of another.
    Named(
        "control/surface_loops.py",
        "            dt_s,\n            state.limited.elevator_blocked,\n",
        "            dt_s,\n            0,\n",
        "the pitch loop is not told that the elevator is blocked",
    ),
    Named(
        "autopilot.py",
        "        blocked = limited.elevator_blocked\n",
        "        blocked = 0\n",
        "the outer loop is not told that the elevator is blocked",
    ),
    Named(
        "control/throttle.py",
        "    quiet_s = 0.0 if called != NOT_CALLED else state.quiet_s + dt_s",
        "    quiet_s = state.quiet_s + (0.0 if called != NOT_CALLED else dt_s)",
        "pauses between calls of the throttle add up",
    ),
    Named(
        "control/search/search.py",
        "        still_s=state.still_s if plan.stays else 0.0,",
        "        still_s=state.still_s,",
        "a line counts as still for the time before it was sent there",
    ),
    # The estimators.
    Named(
        "estimation/position_fixes.py",
        "weight = OFFSET_M * OFFSET_M / (OFFSET_M * OFFSET_M + scatter)",
        "weight = 1.0",
        "all of a difference between two sources is the offset",
    ),
    Named(
        "estimation/position_fixes.py",
        "    if _length(rx, ry, rz) > _velocity_gate(errors.covariance.vv, variance):\n",
        "    if False:\n",
        "any velocity is taken in, however far off",
    ),
    Named(
        "estimation/wind.py",
        "        pitch=tilted,\n",
        "",
        "the axial force's bias knows nothing of the pitch's",
    ),
    Named(
        "estimation/wind.py",
        "flat * flat * delta + 2.0 * flat * posterior.pitch_z",
        "flat * flat * delta - 2.0 * flat * posterior.pitch_z",
        "the sign of the pitch in the updraft's standard deviation",
    ),
    Named(
        "estimation/wind.py",
        "down * down * delta - 2.0 * down * posterior.pitch_x",
        "down * down * delta + 2.0 * down * posterior.pitch_x",
        "the sign of the pitch in the wind's standard deviation",
    ),
    Named(
        "estimation/wind.py",
        "force_x_mps2 - kv * along - moved,",
        "force_x_mps2 - kv * along,",
        "the second force forgets what the first has moved",
    ),
    Named(
        "estimation/accelerometer_bias.py",
        "        + (motion.forward_mps - average.forward_mps) / BIAS_S,\n",
        "        + 0.0,\n",
        "the bias takes a change of speed for its own (x)",
    ),
    Named(
        "estimation/accelerometer_bias.py",
        "average.force_z_mps2 + (motion.down_mps - average.down_mps) / BIAS_S,",
        "average.force_z_mps2,",
        "the bias takes a change of speed for its own (z)",
    ),
    Named(
        "estimation/health.py",
        "        found |= BACKWARDS\n        changed_s = time_s\n",
        "        found |= BACKWARDS\n",
        "a frozen position whose stamps went back is not found out",
    ),
    # The links.
    Named(
        "link/signing.py",
        "            self._streams.clear()\n",
        "            pass\n",
        "streams of another key are kept",
    ),
    Named(
        "link/signing.py",
        "    return frame[-SIGNATURE], source_of(frame)\n",
        "    return 0, source_of(frame)\n",
        "the link's id is ignored",
    ),
    Named(
        "link/signing.py",
        "        return len(self._streams) < MAX_STREAMS\n",
        "        return True\n",
        "any number of streams is kept",
    ),
    Named(
        "link/natnet/clock.py",
        "            self._low_s -= DRIFT * elapsed_s\n",
        "            self._low_s += DRIFT * elapsed_s\n",
        "the clock's bounds close in with time",
    ),
    Named(
        "link/session.py",
        "        self.wind.restarted()\n        self.vehicle.rebase(now_s)",
        "        self.vehicle.rebase(now_s)",
        "the receiver's accuracy outlives the clock",
    ),
    Named(
        "link/sources.py",
        "        if self.chosen and now_s - self._since_s >= DWELL_S:",
        "        if self.chosen:",
        "the source just taken is distrusted for the one before",
    ),
    Named(
        "link/natnet/clock.py",
        "        return self._odd >= RESET_STAMPS and arrival_s - self._odd_from_s >= RESET_S",
        "        return self._odd >= RESET_STAMPS",
        "a burst of late frames is another clock",
    ),
    Named(
        "link/timesync.py",
        "        self.queue_s, self._quickest_s = 0.0, inf",
        "        self.queue_s = 0.0",
        "the quickest way of another line is kept",
    ),
    # The world.
    Named("air/jet.py", "SPREADING = 11.0", "SPREADING = 13.0", "the jet spreads less"),
    Named(
        "air/jet.py",
        "lip_ahead_m: float = 0.5  #",
        "lip_ahead_m: float = 0.9  #",
        "the nozzle's lip stands elsewhere",
    ),
    Named(
        "sim/sensors.py",
        "    force_bias_mps2=0.10,\n    rate_noise_radps=0.01,\n    rate_bias_radps=0.002,\n",
        "    force_bias_mps2=0.0,\n    rate_noise_radps=0.01,\n    rate_bias_radps=0.002,\n",
        "accelerometers without a bias",
    ),
    Named(
        "air/zeuc.py",
        "    return polar_slope(polar, speed) * (u_mps / speed) if u_mps > 0.0 else nan",
        "    return polar_slope(polar, speed) if u_mps > 0.0 else nan",
        "a line's stability forgets that the wind is oblique",
    ),
    Named(
        "sim/world.py",
        "        return _blown(_polynomial_field(air, folder), None, folder, oblique_rad)",
        "        return _blown(_polynomial_field(air, folder), None, folder, 0.0)",
        "a polynomial field is never oblique",
    ),
    # What is made of a flight.
    Named("sim/score.py", "TAIL_S = 8.0", "TAIL_S = 2.0", "a leg's end is a quarter as long"),
    Named(
        "analysis/report/legs.py",
        "SAME_LINE_M = 0.005",
        "SAME_LINE_M = 0.5",
        "a leg has the name of a line far away",
    ),
    Named(
        "analysis/report/legs.py",
        "SAME_LINE_RAD = 0.01",
        "SAME_LINE_RAD = 1.0",
        "a leg has the name of a line of another lean",
    ),
    Named(
        "analysis/report/spectra.py",
        "np.argmax(frequency * density)",
        "np.argmax(density)",
        "the peak is that of the density, not per octave",
    ),
    Named(
        "analysis/experiments/paper/still_lines.py",
        "all_of(part for s in summaries for part in _at_its_place(s, miss_most_m)),",
        "True,",
        "every place is the predicted one",
    ),
    Named(
        "analysis/experiments/paper/still_lines.py",
        "survived == len(flights) and reached and slowest <= settle_most_s,",
        "survived == len(flights) and reached,",
        "a line is reached however long it takes",
    ),
    Named(
        "analysis/experiments/estimates/estimator.py",
        '        lost == 0,\n        f"{lost} of {sum(',
        '        True,\n        f"{lost} of {sum(',
        "no law is ever lost at its margin",
    ),
    Named(
        "analysis/experiments/estimates/wind_estimate.py",
        "        all(n <= HONEST_MOST for s",
        "        True or all(n <= HONEST_MOST for s",
        "every standard deviation is honest",
    ),
    Named(
        "analysis/replay/many.py",
        "        left_out=found.left_out,",
        "        left_out=0,",
        "ticks left out of a replay are in no line",
    ),
    Named(
        "cli/page/orders.py",
        "            self._commands.pop(ENGAGE, None)\n",
        "",
        "an engagement is asked for again after an abort",
    ),
)


def mutation_of(named: Named, source: str) -> Mutation:
    """The change of a source.

    Errors: ValueError where the text does not stand there once.
    """
    if source.count(named.old) != 1:
        raise ValueError(f"{named.file}: {source.count(named.old)} times {named.old!r}, not once")
    at = source.index(named.old)
    start = len(source[:at].encode())
    return Mutation(
        line=source[: at + len(named.old) - len(named.old.lstrip())].count("\n") + 1,
        start=start,
        end=start + len(named.old.encode()),
        text=named.new,
        words=named.words,
    )
