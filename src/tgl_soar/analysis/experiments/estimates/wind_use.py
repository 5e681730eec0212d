"""`wind_use`: what the laws gain, or lose, by using the wind and updraft that are read on board."""

from __future__ import annotations

from math import degrees, isfinite
from typing import Final, NamedTuple

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    FLIGHT_S,
    SETTLE_S,
    EstimatorFlight,
    EstimatorScore,
    Ratios,
    fly_named,
    paired_ratios,
    places,
    score,
)
from tgl_soar.analysis.experiments.result import (
    ChangedThreshold,
    Claim,
    Result,
    Table,
    decided,
)
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors

TURBULENCES: Final = (0.01, 0.03, 0.05)
SEEDS: Final = tuple(range(1, 12))
SENSORS: Final = Sensors(imu=MEMS_IMU, airspeed=PITOT)
WORTH: Final = 0.05  # of e_rho: less is not worth a law that may read the wind wrongly
CHANGED: Final = (
    ChangedThreshold(
        "none of it is worth 5 %",
        "the best ratio of the pairs that were scored",
        "the best of those where every pair was scored and as many were lost; a better one of the"
        " pairs that are left leaves it undecided",
        "what is lost before it is scored had the roughest air, and leaves the ratio of the rest",
    ),
)
NEITHER: Final = "neither"
USES: Final[dict[str, tuple[tuple[str, float], ...]]] = {
    NEITHER: (),
    "`WIND_FF` 0.3": (("WIND_FF", 0.3),),
    "`WIND_FF` 0.7": (("WIND_FF", 0.7),),
    "`WIND_TRIM` 1": (("WIND_TRIM", 1.0),),
    "`WIND_TRIM` 1, `WIND_TRIM_T` 0.5": (("WIND_TRIM", 1.0), ("WIND_TRIM_T", 0.5)),
}


def wind_use(context: Context) -> Result:
    """The same air with each use of it, paired with flights that use neither."""
    lines = places()[:1] if context.quick else places()
    seeds = SEEDS[:1] if context.quick else SEEDS
    named = {
        f"{use}, {turbulence:g}": [
            EstimatorFlight(
                line=line,
                seed=seed,
                sensors=SENSORS,
                turbulence=turbulence,
                changes=changes,
                dispersed=context.dispersion,
            )
            for line in lines
            for seed in seeds
        ]
        for turbulence in TURBULENCES
        for use, changes in USES.items()
    }
    flown = fly_named(context.flyer, {}, named)
    rows, scores, compared = [], {}, {}
    for turbulence in TURBULENCES:
        plain = flown[f"{NEITHER}, {turbulence:g}"]
        for use in USES:
            name = f"{use}, {turbulence:g}"
            scores[name] = score(flown[name])
            ratios = paired_ratios(flown[name], plain)
            rows.append(_row(turbulence, use, scores[name], ratios))
            compared[name] = Compared(ratios, scores[name].lost, score(plain).lost)
    return Result(
        name="wind_use",
        title="what the laws may make of the wind they read",
        flown=f"Flights of {FLIGHT_S:g} s on the lines {', '.join(lines)} of the tunnel, the first"
        f" {SETTLE_S:g} s not scored, with accelerometers and a pitot tube. `WIND_TRIM` puts the"
        " pitch of the steady glide at the local wind's speed in the place of `PITCH_TRIM`,"
        " `WIND_FF` takes out a share of the incidence that a gust of updraft makes; both are off"
        " as shipped. Ratios are of flights in the same air with the same noise.",
        claims=(
            worth_claim(compared),
        ),
        why="",
        tables=(
            Table(
                "flights",
                (
                    "turbulence", "used", "flights", "lost", "rms y [cm]", "rms bank [°]",
                    "rms e_rho [mm]",
                    "of neither's",
                    "activity, of neither's",
                ),
                tuple(rows),
            ),
        ),
        numbers={name: each._asdict() for name, each in scores.items()},
        figures=(),
        scenarios=(),
        seeds=seeds,
        changed=CHANGED,
    )  # fmt: skip


class Compared(NamedTuple):
    """A use beside flights that use neither, in one turbulence."""

    ratios: Ratios
    lost: int
    lost_of_neither: int

    @property
    def whole(self) -> bool:
        """Whether the ratio is of every flight: all were scored, as many lasted."""
        return self.ratios.left_out == 0 and self.lost == self.lost_of_neither


def worth_claim(compared: dict[str, Compared]) -> Claim:
    """By the ratios of all flights; one of the flights that are left decides nothing, as those
    that were lost had the roughest air.  It does not hold where there is no ratio at all."""
    worth = 1.0 - WORTH
    better = {name: c for name, c in compared.items() if c.ratios.e_rho <= worth}
    whole = {name: c for name, c in better.items() if c.whole}
    best = min((c.ratios.e_rho for c in compared.values() if c.whole), default=1.0)
    measured = any(isfinite(c.ratios.e_rho) for c in compared.values())
    open_words = "; ".join(
        f"{name}: {c.ratios.e_rho:.2f}{c.ratios.words}, {c.lost} lost against {c.lost_of_neither}"
        for name, c in better.items()
        if not c.whole
    )
    return decided(
        f"none of it is worth {100 * WORTH:g} % of rms e_rho, so all of it may stay off",
        False if whole or not measured else None if better else True,
        f"the best is {best:.2f} of neither's"
        + (
            f"; not to be compared, as the flights lost are not the same: {open_words}"
            if open_words
            else ""
        ),
    )


def _row(turbulence: float, use: str, of: EstimatorScore, ratios: Ratios) -> tuple[str, ...]:
    return (
        f"{100 * turbulence:g} %",
        use,
        f"{of.flights}",
        f"{of.lost}",
        f"{100 * of.y_m:.1f}",
        f"{degrees(of.bank_rad):.1f}",
        f"{1e3 * of.e_rho_m:.1f}",
        f"{ratios.e_rho:.2f}{ratios.words}",
        f"{ratios.activity:.2f}",
    )
