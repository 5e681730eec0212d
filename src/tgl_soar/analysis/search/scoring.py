"""What an episode was worth, and shares with their exact intervals."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.search.episode import Episode
from tgl_soar.control.supervisor import REASON_NOT_FOUND
from tgl_soar.control.supervisor_texts import REASON_TEXTS

END_FRACTION = 0.25  # of the flight planned, over which the last climb is averaged
END_S = 5.0  # so long it neither climbs nor sinks where it has settled
SINKS_MPS = -0.06  # a little more than a claim allows: slower than this is settling in gusts
SETTLED_MPS = 0.10  # over SETTLED_S, from then on for END_S
SETTLED_S = 2.0
WITHDRAWN_S = 3.0  # a claim that is withdrawn later than this before a loss was false


@dataclass(frozen=True)
class Score:
    """One episode of one searcher."""

    kind: str
    seed: int
    words: str
    change: float  # of the wind, from beginning to end
    begins: float  # height at the start over the fence's ceiling
    searcher: str
    soared: bool  # flew to the end, and does not sink there
    settled_s: float  # since when; inf: it did not
    found_s: float  # since when it said so, to the end, where it soared; inf: it did not
    claimed_s: float  # when it said so first; inf: never
    false_claim: bool  # lost, or sinking at the end, while it said that it soars
    given_up: str  # the reason; ""
    in_time: bool  # given up above the height that landing needs
    aloft: bool  # flew to the end of the episode, and was above that height there
    ended: str  # why the module disengaged, or what was hit; ""
    height_left_m: float
    height_lost_m: float  # from the start to the lowest place
    room_m: float  # at the end, least distance to ground and fence
    flown_s: float

    @property
    def duration_s(self) -> float:
        """How long it flew."""
        return self.flown_s


def score(episode: Episode) -> Score:
    """The score of an episode."""
    place, path = episode.place, episode.path
    time, z = path["time_s"], path["z_m"]
    flew_on = not episode.ended and not episode.given_up
    soared = flew_on and mean_climb(time, z, END_FRACTION * place.duration_s) > SINKS_MPS
    over = episode.flown_s
    stood = [t for t, claim in episode.claims if claim]
    last_claim = stood[-1] if stood else inf
    withdrawn = [t for t, claim in episode.claims if not claim and t > last_claim]
    claim_ends = withdrawn[0] if withdrawn else over
    false = bool(stood) and not soared and claim_ends >= over - WITHDRAWN_S
    # In mode searching the tick's own forecast may be first: that is given up, too.
    nowhere = REASON_TEXTS[REASON_NOT_FOUND]
    by_forecast = nowhere in episode.ended
    given_up = nowhere if by_forecast else episode.given_up
    box = place.box
    x_end, z_end = float(path["x_m"][-1]), float(z[-1])
    room = min(episode.height_left_m, x_end - box.x_min_m, box.x_max_m - x_end, box.z_max_m - z_end)
    return Score(
        kind=place.kind,
        seed=place.seed,
        words=place.words,
        change=place.change,
        begins=float(z[0]) / box.z_max_m,
        searcher=episode.searcher,
        soared=soared,
        settled_s=settling_s(time, z) if soared else inf,
        found_s=last_claim if soared and not withdrawn else inf,
        claimed_s=stood[0] if stood else inf,
        false_claim=false,
        given_up=given_up,
        in_time=bool(given_up) and episode.height_left_m >= episode.landing_m,
        aloft=flew_on and episode.height_left_m >= episode.landing_m,
        ended="" if by_forecast else episode.ended,
        height_left_m=episode.height_left_m,
        height_lost_m=float(z[0] - z.min()),
        room_m=room if soared else nan,
        flown_s=over,
    )


def mean_climb(time_s: FloatArray, z_m: FloatArray, over_s: float) -> float:
    """Mean climb [m/s] over the last seconds of a flight."""
    last = time_s >= time_s[-1] - over_s
    if np.count_nonzero(last) < 2:
        return -inf
    return float((z_m[-1] - z_m[last][0]) / (time_s[-1] - time_s[last][0]))


def settling_s(time_s: FloatArray, z_m: FloatArray) -> float:
    """From when on it neither climbs nor sinks for END_S, by means over SETTLED_S; inf: never."""
    if len(time_s) < 2:
        return inf
    step = float(time_s[1] - time_s[0])
    means = max(1, round(SETTLED_S / step))
    calm = np.abs(z_m[means:] - z_m[:-means]) < SETTLED_MPS * means * step
    length = round((END_S - SETTLED_S) / step)
    run = 0
    for k, quiet in enumerate(calm):
        run = run + 1 if quiet else 0
        if run >= length:
            return float(time_s[k - run + 1])
    return inf


def interval(count: int, of: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper and Pearson's exact interval of a share, 0 … 1; (0, 1) of nothing."""
    from scipy.stats import beta

    tail = 0.5 * (1.0 - confidence)
    low = float(beta.ppf(tail, count, of - count + 1)) if count > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, count + 1, of - count)) if count < of else 1.0
    return low, high


def fraction_text(count: int, of: int) -> str:
    """A share in words, with its interval."""
    if of == 0:
        return "–"
    low, high = interval(count, of)
    return f"{count} of {of} ({100 * low:.0f}–{100 * high:.0f} %)"
