"""How far a small policy comes in `tgl_soar.gym` beside our own law, for docs/gym.md.

For each way to command, a linear policy a = tanh(W o + b) is sought by CMA-ES, o the observation
less its mean, over its standard deviation, both of flights by our law.  Every generation flies its
candidates on the same few new flights.  What is found, the mean of the last generation, is flown on
flights that it has never seen, and so are our law (the line through the place, never moved) and
what it began as: by the aircraft and in the air that it was sought in, and by aircraft unlike their
file in air unlike the site's, of which neither it nor our law is told.

    python tools/gym_baseline.py --docs docs
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from math import sqrt
from pathlib import Path
from typing import Any, Final, NamedTuple

import cma
import numpy as np

from tgl_soar.analysis.experiments.pages import between
from tgl_soar.analysis.experiments.staleness_probes import stamped
from tgl_soar.gym import KINDS, OBSERVATION, SIZES, SoaringEnv

TESTED: Final = 1_000_000  # flights from this seed on are never trained on
SIGMA: Final = 0.1  # of a weight, at the start
NEAR_M: Final = 0.25  # from the place: there
OURS: Final = "our law"
WORDS: Final = ("commands", "policy", "by")  # columns of no numbers

Policy = Callable[[Any], Any]
FloatArray = np.ndarray[Any, np.dtype[np.float64]]


class Flown(NamedTuple):
    """One episode."""

    gain: float  # the rewards' sum
    seconds: float
    away_m: float  # from the place, when it ended
    ended: str  # "" for one that came to its end


class Reached(NamedTuple):
    """What a policy reaches on flights that it has not seen."""

    flights: int
    gain: float
    error: float  # of it: its standard error
    there: float  # share that ends near the place
    lost: float  # share that ends early
    causes: dict[str, int]


class Figure(NamedTuple):
    """The same by both."""

    action: str
    policy: str
    parameters: int
    own: Reached  # as it was sought
    unlike: Reached  # dispersed


def fly(env: SoaringEnv, policy: Policy, seed: int) -> Flown:
    """One episode of this flight's seed."""
    observation, info = env.reset(seed=seed)
    gain, over = 0.0, False
    while not over:
        observation, reward, ended, truncated, info = env.step(policy(observation))
        gain += reward
        over = ended or truncated
    away = float(np.hypot(info["x_m"] - info["goal_x_m"], info["z_m"] - info["goal_z_m"]))
    return Flown(gain, info["time_s"], away, info["ended"].partition(" at x")[0])


def scaling(seconds: float, turbulence: float, compile: bool) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation of every observation in flights by our law."""
    env = SoaringEnv("line", seconds=seconds, turbulence=turbulence, compile=compile, period_s=0.1)
    observations: list[Any] = []

    def law(observation: Any) -> Any:
        observations.append(observation)
        return np.zeros(SIZES["line"])

    for seed in range(4):
        fly(env, law, seed)
    return np.mean(observations, axis=0), np.maximum(np.std(observations, axis=0), 1e-3)


def linear(weights: FloatArray, size: int, mean: FloatArray, spread: FloatArray) -> Policy:
    """a = tanh(W o + b)."""
    table = weights.reshape(size, len(OBSERVATION) + 1)

    def policy(observation: Any) -> Any:
        return np.tanh(table[:, 1:] @ ((observation - mean) / spread) + table[:, 0])

    return policy


def train(
    env: SoaringEnv, made: Callable[[FloatArray], Policy], count: int, args: argparse.Namespace
) -> tuple[FloatArray, list[float]]:
    """The weights found, and the mean reward of each generation."""
    draw = np.random.default_rng(args.seed)
    strategy = cma.CMAEvolutionStrategy(
        np.zeros(count),
        SIGMA,
        {
            "randn": lambda *shape: draw.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
            "verb_log": 0,
        },
    )
    curve: list[float] = []
    for generation in range(args.generations):
        seeds = range(generation * args.episodes, (generation + 1) * args.episodes)
        points = strategy.ask()
        gains = [float(np.mean([fly(env, made(p), s).gain for s in seeds])) for p in points]
        strategy.tell(points, [-gain for gain in gains])
        curve.append(float(np.mean(gains)))
        if generation % 10 == 9:
            print(f"{env.action}: generation {generation + 1}, {curve[-1]:.2f}", flush=True)
    return np.asarray(strategy.result.xfavorite), curve


def reached(env: SoaringEnv, policy: Policy, seeds: Sequence[int]) -> Reached:
    """Of flights that it has never seen."""
    flown = [fly(env, policy, seed) for seed in seeds]
    gains = np.array([each.gain for each in flown])
    causes = Counter(each.ended for each in flown if each.ended)
    near = sum(not each.ended and each.away_m < NEAR_M for each in flown)
    return Reached(
        flights=len(flown),
        gain=float(gains.mean()),
        error=float(gains.std(ddof=1)) / sqrt(len(flown)),
        there=near / len(flown),
        lost=sum(causes.values()) / len(flown),
        causes=dict(causes.most_common()),
    )


def figure(
    envs: Sequence[SoaringEnv], name: str, parameters: int, policy: Policy, seeds: Sequence[int]
) -> Figure:
    """By the aircraft that it was sought with, and by others."""
    own, unlike = (reached(env, policy, seeds) for env in envs)
    return Figure(action=envs[0].action, policy=name, parameters=parameters, own=own, unlike=unlike)


def table(figures: Sequence[Figure], seconds: float) -> str:
    """For docs/gym.md."""
    columns = ("at the place", "ended early", "by")
    head = ["commands", "policy", "numbers sought", f"reward of {seconds:g}", *columns]
    head += ["reward, unlike the file", *columns]
    rule = ["---" if column in WORDS else "--:" for column in head]
    rows = [
        [f.action, f.policy, str(f.parameters or "·"), *cells(f.own), *cells(f.unlike)]
        for f in figures
    ]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, rule, *rows))


def cells(found: Reached) -> tuple[str, str, str, str]:
    """Of a table."""
    by = ", ".join(f"{cause} ({count})" for cause, count in list(found.causes.items())[:3])
    gain = f"{found.gain:.2f} ± {found.error:.2f}"
    return gain, f"{100 * found.there:.0f} %", f"{100 * found.lost:.1f} %", by


def draw(path: Path, curves: dict[str, list[float]], ours: float) -> None:
    """The rewards of the generations.  Errors: ImportError without matplotlib."""
    from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

    with drawing() as plt:
        shown, axis = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
        for (name, curve), colour in zip(curves.items(), PALETTE[1:], strict=False):
            axis.plot(range(1, len(curve) + 1), curve, color=colour, label=f"CMA-ES, {name}")
        axis.axhline(ours, color=PALETTE[0], label=OURS)
        axis.set_xlabel("generation")
        axis.set_ylabel("reward of an episode")
        axis.set_ylim(bottom=0.0)
        axis.legend()
        save(plt, shown, path)


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--actions", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--generations", type=int, default=150)
    parser.add_argument("--episodes", type=int, default=4, help="a candidate")
    parser.add_argument("--test", type=int, default=200, help="flights never seen")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--turbulence", type=float, default=0.02)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plain", action="store_true", help="fly uncompiled")
    parser.add_argument("--out", type=Path, default=Path("out/gym"))
    parser.add_argument("--docs", type=Path, help="write gym.md's table and figure here")
    return parser.parse_args(arguments)


BEGIN: Final = "<!-- baseline: begin; written by `python tools/gym_baseline.py --docs docs` -->"
END: Final = "<!-- baseline: end -->"


def main(arguments: Sequence[str] | None = None) -> None:
    args = parsed(arguments)
    begun = time.monotonic()
    mean, spread = scaling(args.seconds, args.turbulence, not args.plain)
    seeds = range(TESTED, TESTED + args.test)
    figures: list[Figure] = []
    curves: dict[str, list[float]] = {}
    weights: dict[str, list[float]] = {}
    for action in args.actions:
        envs = tuple(
            SoaringEnv(
                action,
                seconds=args.seconds,
                turbulence=args.turbulence,
                dispersion=dispersion,
                compile=not args.plain,
            )
            for dispersion in (False, True)
        )
        size = SIZES[action]
        count = size * (len(OBSERVATION) + 1)

        def made(point: FloatArray, size: int = size) -> Policy:
            return linear(np.asarray(point), size, mean, spread)

        start = OURS if action == "line" else "a = 0"
        figures.append(figure(envs, start, 0, made(np.zeros(count)), seeds))
        found, curves[action] = train(envs[0], made, count, args)
        weights[action] = found.tolist()
        figures.append(figure(envs, "linear, CMA-ES", count, made(found), seeds))
        print(table(figures[-2:], args.seconds), flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "baseline.json").write_text(
        json.dumps(
            {
                "figures": [
                    f._asdict() | {"own": f.own._asdict(), "unlike": f.unlike._asdict()}
                    for f in figures
                ],
                "curves": curves,
                "weights": weights,
                "mean": mean.tolist(),
                "spread": spread.tolist(),
            },
            indent=1,
        )
        + "\n",
        encoding="utf-8",
    )
    written = table(figures, args.seconds)
    print(written, f"{time.monotonic() - begun:.0f} s")
    if args.docs is not None:
        page = args.docs / "gym.md"
        section = stamped(page.name, "baseline", written)
        try:
            text = between(page.read_text(encoding="utf-8"), BEGIN, END, section)
        except ValueError as error:
            raise SystemExit(f"{page}: {error}") from None
        page.write_text(text, encoding="utf-8")
        ours = next((f.own.gain for f in figures if f.policy == OURS), float("nan"))
        draw(args.docs / "images" / "gym.png", curves, ours)


if __name__ == "__main__":
    main()
