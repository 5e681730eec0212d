"""How a flight between processes has ended on the ground: where, and how hard, by the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.sim.score import ACROSS_M, ALONG_M, SINK_MPS, touches_down_well

NAN: Final = float("nan")


@dataclass(frozen=True)
class Landing:
    """A touchdown, from the landing place; NaN: it did not touch down."""

    time_s: float = NAN  # when
    along_m: float = NAN  # beyond the place
    across_m: float = NAN
    sink_mps: float = NAN

    @property
    def is_well(self) -> bool:
        """Whether it is near enough to the place, and soft enough."""
        return touches_down_well(self.along_m, self.across_m, self.sink_mps)

    def words(self) -> str:
        """One sentence of it."""
        if self.time_s != self.time_s:
            return "not landed: it was in the air when the module disengaged"
        where = "beyond" if self.along_m >= 0.0 else "short of"
        return (
            f"landed {abs(self.along_m):.1f} m {where} the place, {abs(self.across_m):.1f} m"
            f" across, sink {self.sink_mps:.2f} m/s"
        )

    def fault(self) -> str:
        """Why it is no good landing; "": it is."""
        if self.is_well:
            return ""
        allowed = (
            f"{ALONG_M:g} m along, {ACROSS_M:g} m across and {SINK_MPS:g} m/s of sink are allowed"
        )
        return f"{self.words()}; {allowed}"


def touchdown(truth: Mapping[str, NDArray[np.float64]], place: Mapping[str, float]) -> Landing:
    """The last time that a flight came to the ground.

    truth: columns of the bridge's log, with `flying`; place: LND_X and LND_Y.
    """
    flying = truth["flying"] > 0.0
    (ends,) = np.nonzero(flying[:-1] & ~flying[1:])
    if not ends.size or flying[-1]:
        return Landing()
    last = int(ends[-1])
    return Landing(
        time_s=float(truth["time_s"][last + 1]),
        along_m=place["LND_X"] - float(truth["x_m"][last + 1]),
        across_m=float(truth["y_m"][last + 1]) - place["LND_Y"],
        sink_mps=-float(truth["climb_mps"][last]),
    )
