"""How much a margin tells of a loss that is to come: the table of docs/campaigns.md.

    python tools/measure_margin.py --turbulence 0.05 --flights 1200

Plain flights of a minute on line a, in air so rough that some are lost.  Twenty times a second it
is asked whether the flight will have ended in 3 s; the last 0.4 s before an end, in which anything
tells it, are left out.  Looks are sorted by the margin, the lowest first, into classes of 30 looks
and more.  What the margin tells is the mean, over the looks before a loss, of the logarithm by
which knowing its class makes the truth more probable than knowing the mean of all (as a share of
the looks before a loss: 0 is nothing).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.rare.soaring_process import OUTLOOK, SHOWN, Outlook, SoaringProcess
from tgl_soar.cli.console import AIRFRAME, SITE
from tgl_soar.cli.rare import case_of
from tgl_soar.sim.flight import FLIES

SOON_S: Final = 3.0
LATE_S: Final = 0.4
LEAST: Final = 30  # looks of a class
CLASSES: Final = 40
NO_NOSE: Final = OUTLOOK._replace(speed_s=0.0, nose_m=0.0)
COLUMN: Final = {name: n for n, name in enumerate(SHOWN)}


class Looks(NamedTuple):
    """Of all flights, one after the other."""

    lost: FloatArray  # 1: the flight has ended SOON_S from now
    margins: dict[str, FloatArray]


def with_alpha(process: SoaringProcess, shown: FloatArray) -> FloatArray:
    """The mean angle of attack of half a second as a share of its own, beside the distances."""
    looks = process.looks_in(0.5)
    alpha = np.convolve(shown[:, COLUMN["alpha_rad"]], np.full(looks, 1.0 / looks))[: len(shown)]
    stall_rad = process.case.airframe.aerodynamics().stall_alpha_rad
    fraction = (stall_rad - alpha) / (stall_rad - process.prepared.world.trim.alpha_rad)
    return np.minimum(fraction, process.margins(shown, NO_NOSE))


def by(outlook: Outlook) -> Callable[..., FloatArray]:
    """The margin by another outlook."""

    def margins(process: SoaringProcess, shown: FloatArray) -> FloatArray:
        return process.margins(shown, outlook)

    return margins


MARGINS: Final[dict[str, Callable[..., FloatArray]]] = {
    "the place alone": by(Outlook(0.0, 0.0, 0.0, 0.0)),
    "and of ½ s of the velocity, as it was until November 2026": by(Outlook(0.5, 0.0, 0.0, 0.0)),
    "and of 0.3 s of the velocity": by(NO_NOSE._replace(gust_s=0.0)),
    "and of the gust": by(NO_NOSE),
    "and of airspeed and pitch: as it is": by(OUTLOOK),
    "of gust and velocity, and a share of the angle of attack": with_alpha,
}


def flown(process: SoaringProcess, seeds: Sequence[int]) -> tuple[Looks, int]:
    """And how many flights were lost."""
    lost: list[FloatArray] = []
    margins: dict[str, list[FloatArray]] = {name: [] for name in MARGINS}
    ended = 0
    for seed in seeds:
        _, flight, shown = process.flown(process.prepared, process.begun(seed), seed)
        lives = flight.standing == FLIES
        ended += not lives
        end_s = np.inf if lives else flight.steps / process.prepared.world.step_hz
        left_s = end_s - shown[:, COLUMN["time_s"]]
        kept = (left_s > LATE_S) & (shown[:, COLUMN["time_s"]] > 2.0)  # from rest at its place
        lost.append((left_s < SOON_S)[kept].astype(float))
        for name, found in margins.items():
            found.append(MARGINS[name](process, shown)[kept])
    joined = {name: np.concatenate(found) for name, found in margins.items()}
    return Looks(np.concatenate(lost), joined), ended


def information(lost: FloatArray, margins: FloatArray) -> float:
    """Nats a look before a loss."""
    sorted_by = lost[np.argsort(margins, kind="stable")]
    edges = np.unique([0, *np.geomspace(LEAST, len(lost), CLASSES).astype(int)])
    of_class = np.diff(np.concatenate([[0.0], np.cumsum(sorted_by)])[edges])
    looks, base = np.diff(edges), lost.mean()
    known = of_class / looks
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = of_class * np.log(known / base)
        gain = np.nan_to_num(gain) + np.nan_to_num(
            (looks - of_class) * np.log((1.0 - known) / (1.0 - base))
        )
    return float(gain.sum() / lost.sum())


def report(looks: Looks) -> str:
    """A table."""
    lines = ["| a margin of | tells [nats] |", "|---|--:|"]
    lines += [
        f"| {name} | {information(looks.lost, of):.2f} |" for name, of in looks.margins.items()
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--turbulence", type=float, default=0.05)
    parser.add_argument("--flights", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    args = parser.parse_args(arguments)
    process = SoaringProcess(case_of(AIRFRAME, SITE, "a", args.turbulence, 60.0))
    looks, ended = flown(process, range(args.seed, args.seed + args.flights))
    if not ended:
        raise SystemExit("none was lost: fly in rougher air")
    print(f"{ended} of {args.flights} flights ended early")
    print(report(looks))


if __name__ == "__main__":
    main()
