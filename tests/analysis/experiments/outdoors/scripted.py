"""A loop with a script for each tick, for what experiments say of a flight: nothing is
computed in it, so that a test knows where the aircraft is, what its fixes are, and when it ends."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any, Final, NamedTuple

import pytest

from tgl_soar.control.supervisor import SOARING
from tgl_soar.geometry import SoaringFrame, ned_from_soaring
from tgl_soar.types import PositionFix

FRAME: Final = SoaringFrame(5.0, -3.0, 1.0, 0.7)  # of no particular place and direction
STEP_HZ: Final = 10


class Moment(NamedTuple):
    """One tick."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 10.0
    vz_mps: float = 0.0
    fix_x_m: float = 0.0  # beside the truth
    fix_z_m: float = 0.0
    correction_m: float = 0.0  # of the rangefinder
    mode: int = SOARING
    reason: int = 0
    crashed: str = ""


class ScriptedWorld:
    """Where the script says that the aircraft is."""

    def __init__(self, script: Callable[[float], Moment], ground: Any) -> None:
        self.step_hz, self.frame, self.ground = STEP_HZ, FRAME, ground
        self.ticks = 0
        self._script = script

    @property
    def time_s(self) -> float:
        return self.ticks / STEP_HZ

    @property
    def now(self) -> Moment:
        return self._script(self.time_s)

    @property
    def state(self) -> Any:
        now = self.now
        return SimpleNamespace(
            x_m=now.x_m, y_m=now.y_m, z_m=now.z_m, velocity_z_mps=now.vz_mps
        )  # fmt: skip

    @property
    def crashed(self) -> str:
        return self.now.crashed

    @property
    def position(self) -> PositionFix:
        now = self.now
        north, east, down = ned_from_soaring(
            FRAME, now.x_m + now.fix_x_m, now.y_m, now.z_m + now.fix_z_m
        )
        return PositionFix(
            sequence=self.ticks,
            time_s=self.time_s,
            north_m=north,
            east_m=east,
            down_m=down,
            velocity_north_mps=0.0,
            velocity_east_mps=0.0,
            velocity_down_mps=0.0,
        )


class ScriptedLoop:
    """Ticks through a script; keeps what the operator set, and whether it was engaged then."""

    def __init__(
        self, script: Callable[[float], Moment], values: dict[str, float], ground: Any = None
    ) -> None:
        self.world = ScriptedWorld(script, ground)
        self.values = dict(values)
        self.engage = True
        self.engaged: list[bool] = []  # at each tick
        self.changes: list[tuple[float, dict[str, float]]] = []

    def change(self, parameters: dict[str, float]) -> None:
        self.changes.append((self.world.time_s, parameters))
        self.values = self.values | parameters  # a new one, as a loop's is

    def tick(self) -> Any:
        self.engaged.append(self.engage)
        self.world.ticks += 1
        now = self.world.now
        self.given = self.world.position
        return SimpleNamespace(
            mode=now.mode,
            reason=now.reason,
            ground_range=SimpleNamespace(correction_m=now.correction_m),
        )


def air_of_seeds(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, flies: Callable[[int], object]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Winds [m/s] and turbulence that a module asks a world for, with each of thirty seeds."""
    asked: list[tuple[float, float]] = []

    def made(_airframe: Any, site: Any, _seed: int, **wanted: Any) -> Any:
        asked.append((site.air.wind_mps, wanted["turbulence"]))
        raise StopIteration

    monkeypatch.setattr(module, "flown_world", made)
    for seed in range(30):
        with pytest.raises(StopIteration):
            flies(seed)
    winds, gusts = zip(*asked, strict=True)
    return winds, gusts
