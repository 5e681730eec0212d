"""Whether a page of experiments is of the laws, the aircraft and the air that there are now.

A page carries the ends of a few short flights, its probes.  Whoever flies them again and comes out
elsewhere has changed what flies, and the page's figures are older than that.  A change of the code
that changes no flight leaves a page as it is.  Beside the probes stands a sum of what was written,
so that nobody changes a verdict or a figure by hand without its being noticed.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Final

import msgspec

from tgl_soar.analysis.experiments.flights import ScenarioJob, fly_job
from tgl_soar.analysis.experiments.scenario import Scenario, SensorSpec, load_scenario
from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import shipped

# Until an aircraft released 0.3 m from its line is on it, and has answered turbulence.
PROBED_S: Final = 4.0
# Processors round otherwise, in the last of some 16 digits; a flight's loop is stable, so that
# nothing of it grows.  A gain changed by a ten-thousandth moves the end by more.
SAME_M: Final = 1e-7
# Air, sensors and model: between them they use all that the experiments fly with.
PROBES: Final[dict[str, tuple[str, SensorSpec, ModelKind]]] = {
    "tunnel": ("static", SensorSpec(), "rigid_body"),
    "hill, accelerations and pitot": ("speed", SensorSpec(imu=True, pitot=True), "rigid_body"),
    "point mass": ("static", SensorSpec(), "point_mass"),
}
OLDER: Final = "> **The figures on this page are older than the laws.**"
NOTICE: Final = re.compile(
    r"> \*\*The figures (on this page|of this section) are older than the laws\.\*\*"
    r" `[^`]+` flies them anew\."
)
SUM: Final = re.compile(r"<!-- sum of what was written: ([0-9a-f]+) -->")
MARK: Final = re.compile(r"<!-- probes, x and z at the end \[m\]: (.*) -->")

Ends = dict[str, tuple[float, float]]


def probed(scenario: str, sensors: SensorSpec, model: ModelKind) -> Scenario:
    """The flight of a probe: rough air, one seed, short."""
    loaded = load_scenario(shipped(f"scenarios/{scenario}.toml"))
    assert loaded.turbulence is not None
    rough = msgspec.structs.replace(loaded.turbulence, intensity=0.03)
    return msgspec.structs.replace(
        loaded, sensors=sensors, model=model, duration_s=PROBED_S, changes=[], turbulence=rough
    )


def probe() -> Ends:
    """Where each probe ends now, x and z [m]."""
    ends: Ends = {}
    for name, (scenario, sensors, model) in PROBES.items():
        flown = fly_job(ScenarioJob(scenario=probed(scenario, sensors, model), seed=1))
        ends[name] = (float(flown.path["x_m"][-1]), float(flown.path["z_m"][-1]))
    return ends


def mark(ends: Ends) -> str:
    """The line of a page that holds the ends."""
    digits = {name: [round(x, 9), round(z, 9)] for name, (x, z) in ends.items()}
    return f"<!-- probes, x and z at the end [m]: {json.dumps(digits)} -->"


def sealed(written: str, ends: Ends) -> str:
    """What was written, with its probes and its sum."""
    return f"{written}\n{mark(ends)}\n<!-- sum of what was written: {_sum(written)} -->\n"


def is_as_written(page: str) -> bool:
    """Whether it is what a command wrote, to its sum and no further, but for blanks and a notice
    that it is older."""
    written, probes, rest = page.partition("<!-- probes,")
    found = SUM.search(rest)
    return (
        bool(probes)
        and found is not None
        and found[1] == _sum(written)
        and not rest[found.end() :].strip()
        and MARK.fullmatch((probes + rest[: found.start()]).strip()) is not None
    )


def _sum(written: str) -> str:
    words = " ".join(NOTICE.sub("", " ".join(written.split())).split())
    return hashlib.sha256(words.encode()).hexdigest()[:16]


def marked(page: str) -> Ends | None:
    """The ends that a page holds; None: it holds none."""
    found = MARK.search(page)
    return None if found is None else {k: (x, z) for k, (x, z) in json.loads(found[1]).items()}


def differences(page: str, now: Ends) -> list[str]:
    """What of a page is older than what flies, in words."""
    then = marked(page)
    if then is None:
        return ["the page holds no probes"]
    if list(then) != list(now):
        return [f"the page has the probes {', '.join(then)}; there are {', '.join(now)}"]
    apart = {
        name: max(abs(a - b) for a, b in zip(then[name], now[name], strict=True)) for name in now
    }
    return [f"{name}: ends {d:.1e} m elsewhere" for name, d in apart.items() if not d <= SAME_M]
