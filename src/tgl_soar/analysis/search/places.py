"""Random places to search in: tunnels and hills, as sites with a field of their own.

    tunnel   a board at 18–28° in the open jet
    hill     potential flow over half an elliptic cylinder: half its width 5–40 m, its height
             0.12–1 of that; with the semi-axes a and b, r = (a + b)/2, c² = (a² − b²)/4,
             s = (ζ + √(ζ² − 4c²))/2 (Joukowski),  u − i w = U (1 − r²/s²) / (1 − c²/s²)
    a third of both in a shear: u and w times 1 + k (z − z_middle)/H, which is no potential flow
    wind 7–11 m/s; in half of the episodes it changes, by 0.85–1.2, in a few seconds
    gusts (Dryden) of 1–5 %, polar ± 10 %

Seeds: `TUNED_ON` and `PUBLISHED` are apart; nothing was chosen by the second.
"""

from __future__ import annotations

from math import cos, radians, sin, tan
from typing import Final, Literal, NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.grid import GridField
from tgl_soar.air.gusts import ScaledField, Schedule
from tgl_soar.air.jet import SlopeJet
from tgl_soar.config.site import (
    GroundProfile,
    HillAir,
    JetAir,
    Site,
    SiteOrigin,
    Start,
    TurbulenceSettings,
)
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.types import Ground

Kind = Literal["tunnel", "hill"]
KINDS: Final[tuple[Kind, ...]] = ("tunnel", "hill")
TUNED_ON: Final = 10_000  # the first of the seeds that the search was built with
PUBLISHED: Final = 1_001  # the first of those whose flights are published; those below were seen

BOARD_M: Final = 2.45
WIND_MPS: Final = (7.0, 11.0)
GUSTS: Final = (0.01, 0.05)
POLAR_ERROR: Final = 0.10
CHANGE: Final = (0.85, 1.2)
SHEAR: Final = (0.1, 0.35)  # of the wind over H
LAUNCH_WIND_MPS: Final = (7.8, 11.5)  # at rest over the ground: slower stalls, faster is no polar's
DURATION_S: Final = {"tunnel": 40.0, "hill": 90.0}
GRID_NODES: Final = 120  # along the longer side of a field on a grid


class SearchPlace(NamedTuple):
    """One place, its air, and where the aircraft begins."""

    kind: Kind
    seed: int
    site: Site
    field: WindField
    ground: Ground
    box: Box
    duration_s: float
    sink_factor: float  # of the true aircraft's drag
    change: float  # of the wind, from beginning to end
    words: str
    dispersed: bool = False  # the aircraft differs from its file by more than its sink


def place(kind: Kind, seed: int) -> SearchPlace:
    """The place of a seed."""
    # The tunnel's stream is also that of the turbulence of this seed, the hill's that of its roll
    # gusts (`sim.white_noise`); one of its own would draw other places than the published ones.
    # Place and gusts are independent all the same: the size of a normal number, not its sign, has a
    # rank correlation of 0.10 with the uniform one of the same bits, and these here are a dozen,
    # which are the gusts' start and their first steps.  Nothing of it is left in a second of gusts.
    rng = np.random.default_rng((seed, kind == "hill"))
    return (_hill if kind == "hill" else _tunnel)(seed, rng)


def _air(rng: np.random.Generator, duration_s: float) -> tuple[float, float, Schedule, float]:
    """Wind [m/s], gusts, the wind's factor in time, and its last value."""
    wind = float(rng.uniform(*WIND_MPS))
    gusts = float(rng.uniform(*GUSTS))
    last = float(rng.uniform(*CHANGE)) if rng.random() < 0.5 else 1.0
    begins = float(rng.uniform(0.1, 0.35)) * duration_s
    takes = float(rng.uniform(0.1, 0.25)) * duration_s
    return wind, gusts, Schedule([0.0, begins, begins + takes], [1.0, 1.0, last]), last


def _tunnel(seed: int, rng: np.random.Generator) -> SearchPlace:
    duration = DURATION_S["tunnel"]
    wind, gusts, factor, last = _air(rng, duration)
    slope_deg = float(rng.integers(18, 29))
    shear = float(rng.uniform(*SHEAR)) if rng.random() < 1.0 / 3.0 else 0.0
    tip_x, tip_z = (BOARD_M * f(radians(slope_deg)) for f in (cos, sin))
    box = Box(x_min_m=-0.5, x_max_m=tip_x - 0.05, z_min_m=0.15, z_max_m=2.85)
    steady: WindField = SlopeJet(wind, radians(slope_deg))
    if shear > 0.0:
        x, z = np.arange(-1.5, 4.0, 0.04), np.arange(0.0, 4.2, 0.04)
        u, w = _sheared(steady, x, z, shear, box)
        solid = (
            z[None, :]
            < np.where((x > 0.0) & (x <= tip_x), x * tan(radians(slope_deg)), 0.0)[:, None]
        )
        steady = GridField(
            x, None, z, u, None, w, reference_wind_mps=wind, solid=solid, outside="edge"
        )
    profile = [(-2.0, 0.0), (0.0, 0.0), (tip_x, tip_z)]

    def start() -> tuple[float, float]:
        x = float(rng.uniform(-0.3, 1.9))
        floor = max(0.0, x * tan(radians(slope_deg)))
        return x, float(rng.uniform(floor + 0.5, 2.55))

    begin = _launched(steady, start)
    parameters = {
        "WPT_X": -5.5, "CLEAR_MIN": 0.30, "FENCE_Y_MAX": 1.3, **_fence(box),
    }  # fmt: skip
    air = JetAir(wind_mps=wind, slope_deg=slope_deg, turbulence=TurbulenceSettings(intensity=gusts))
    site = _site("random tunnel", parameters, air, begin, profile)
    words = f"{wind:.1f} m/s, {slope_deg:.0f}°, gusts {100 * gusts:.0f} %" + _changes(last, shear)
    return SearchPlace(
        kind="tunnel",
        seed=seed,
        site=site,
        field=ScaledField(steady, factor),
        ground=site.known_ground(),
        box=box,
        duration_s=duration,
        sink_factor=float(rng.uniform(1.0 - POLAR_ERROR, 1.0 + POLAR_ERROR)),
        change=last,
        words=words,
    )


def _hill(seed: int, rng: np.random.Generator) -> SearchPlace:
    duration = DURATION_S["hill"]
    wind, gusts, factor, last = _air(rng, duration)
    half = float(rng.uniform(5.0, 40.0))
    height = half * float(rng.uniform(0.12, 1.0))
    shear = float(rng.uniform(*SHEAR)) if rng.random() < 1.0 / 3.0 else 0.0
    top = 3.0 * height + 5.0
    box = Box(x_min_m=-(half + 2.0 * height + 3.0), x_max_m=0.0, z_min_m=0.5, z_max_m=top)
    margin = 0.3 * box.height_m
    step = max(box.x_max_m - box.x_min_m, top) / GRID_NODES
    x = np.arange(box.x_min_m - margin, box.x_max_m + margin, step)
    z = np.arange(0.0, top + margin, step)
    u, w = ellipse_wind(wind, half, height, *np.meshgrid(x, z, indexing="ij"))
    if shear > 0.0:
        shape = 1.0 + shear * (z[None, :] - 0.5 * top) / box.height_m
        u, w = u * shape, w * shape
    inside = (x[:, None] / half) ** 2 + (z[None, :] / height) ** 2 < 1.0
    steady = GridField(
        x, None, z, u, None, w, reference_wind_mps=wind, solid=inside, outside="edge"
    )
    angles = np.linspace(np.pi, 0.0, 8)
    profile = [(half * float(np.cos(a)), height * float(np.sin(a))) for a in angles]

    def start() -> tuple[float, float]:
        x = float(rng.uniform(-(half + height), -0.15 * half))
        floor = height * (max(0.0, 1.0 - (x / half) ** 2)) ** 0.5
        return x, floor + float(rng.uniform(3.0, 5.0 + height))

    begin = _launched(steady, start)
    parameters = {
        "WPT_X": box.x_min_m - 20.0, "CLEAR_MIN": 1.0, "FENCE_Y_MAX": 16.0, "TGL_SLEW": 0.75,
        **_fence(box),
    }  # fmt: skip
    air = HillAir(
        wind_mps=wind,
        radius_m=half,
        turbulence=TurbulenceSettings(intensity=gusts, length_scale_m=5.0),
    )
    site = _site("random hill", parameters, air, begin, profile)
    words = (
        f"{wind:.1f} m/s, {2 * half:.0f} m wide, {height:.1f} m high, gusts {100 * gusts:.0f} %"
    ) + _changes(last, shear)
    return SearchPlace(
        kind="hill",
        seed=seed,
        site=site,
        field=ScaledField(steady, factor),
        ground=site.known_ground(),
        box=box,
        duration_s=duration,
        sink_factor=float(rng.uniform(1.0 - POLAR_ERROR, 1.0 + POLAR_ERROR)),
        change=last,
        words=words,
    )


def ellipse_wind(
    wind_mps: float, half_width_m: float, height_m: float, x_m: FloatArray, z_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Wind u, w [m/s] over half an elliptic cylinder; zero inside it.  Milne-Thomson, 6.33."""
    r = 0.5 * (half_width_m + height_m)
    c2 = 0.25 * (half_width_m**2 - height_m**2)
    zeta = np.asarray(x_m) + 1j * np.asarray(z_m)
    root = np.sqrt(zeta * zeta - 4.0 * c2 + 0j)
    # The branch outside the circle: the root has the sign of ζ's real part, above the slit.
    root = np.where((root * np.conj(zeta)).real < 0.0, -root, root)
    s = 0.5 * (zeta + root)
    inside = (zeta.real / half_width_m) ** 2 + (zeta.imag / height_m) ** 2 < 1.0
    s = np.where(inside, 2.0 * r, s)
    f = wind_mps * (1.0 - r * r / (s * s)) / (1.0 - c2 / (s * s))
    return np.where(inside, 0.0, f.real), np.where(inside, 0.0, -f.imag)


def _sheared(
    field: WindField, x_m: FloatArray, z_m: FloatArray, shear: float, box: Box
) -> tuple[FloatArray, FloatArray]:
    xx, zz = np.meshgrid(x_m, z_m, indexing="ij")
    u, _, w = field.wind(xx, 0.0, zz)
    shape = 1.0 + shear * (zz - 0.5 * (box.z_min_m + box.z_max_m)) / box.height_m
    return u * shape, w * shape


def _launched(field: WindField, draw) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """The first of random places where an aircraft at rest over the ground would fly."""
    x, z = draw()
    for _ in range(200):
        if LAUNCH_WIND_MPS[0] <= field.wind_at(x, 0.0, z, 0.0)[0] <= LAUNCH_WIND_MPS[1]:
            break
        x, z = draw()
    return x, z


def _fence(box: Box) -> dict[str, float]:
    return {
        "FENCE_X_MIN": box.x_min_m,
        "FENCE_X_MAX": box.x_max_m,
        "FENCE_Z_MIN": box.z_min_m,
        "FENCE_Z_MAX": box.z_max_m,
    }


def _site(
    name: str,
    parameters: dict[str, float],
    air: JetAir | HillAir,
    begin: tuple[float, float],
    profile: list[tuple[float, float]],
) -> Site:
    line = {"TGL_X": begin[0], "TGL_Z": begin[1]}
    return Site(
        site=SiteOrigin(name=name),
        parameters={**parameters, **line},
        air=air,
        start=Start(x_m=begin[0], z_m=begin[1]),
        ground=GroundProfile(profile=profile),
    )


def _changes(last: float, shear: float) -> str:
    words = "" if last == 1.0 else f", wind × {last:.2f}"
    return words + (f", sheared by {shear:.2f}" if shear > 0.0 else "")
