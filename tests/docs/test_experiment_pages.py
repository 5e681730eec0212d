"""The pages of experiments are of what flies now, and of the experiments that there are."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import msgspec
import pytest

from tgl_soar.analysis import experiments
from tgl_soar.analysis.experiments import staleness
from tgl_soar.analysis.experiments.catalogue import TOGETHER
from tgl_soar.analysis.experiments.flights import ScenarioJob, fly_job
from tgl_soar.analysis.experiments.pages import AIMS, ONCE, OWN_PAGES, PAPER, page
from tgl_soar.analysis.experiments.result import ChangedThreshold
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.analysis.experiments.staleness_probes import probe_for_page
from tgl_soar.config.files import shipped

DOCS = Path(__file__).parents[2] / "docs"
MAKE = "tgl-soar experiment all --docs docs"
PAGES = {PAPER: list(TOGETHER["paper"]), AIMS: list(TOGETHER["aims"])}


@pytest.fixture(scope="module")
def now() -> staleness.Ends:
    return probe_for_page(PAPER)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_of_what_flies_or_says_that_it_is_older(name: str) -> None:
    """A page that is not flown again after a change of the laws begins with a notice."""
    text = (DOCS / name).read_text(encoding="utf-8")
    older = staleness.differences(text, probe_for_page(name))
    listed = re.findall(r"^\| \[`(\w+)`\]", text, flags=re.MULTILINE)
    if listed != PAGES[name]:
        older.append(f"it lists {', '.join(listed)}; there are {', '.join(PAGES[name])}")
    older += wrong_seeds(text)
    says_so = staleness.OLDER in text
    assert says_so == bool(older), f"docs/{name}: {older}; {MAKE}, or begin with {staleness.OLDER}"
    assert not says_so or MAKE in text.partition(staleness.OLDER)[2].partition("\n\n")[0]


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_what_a_command_wrote(name: str) -> None:
    text = (DOCS / name).read_text(encoding="utf-8")
    assert staleness.is_as_written(text), f"docs/{name}: edited by hand; {MAKE}"


@pytest.mark.parametrize("name", PAGES)
def test_a_verdict_counts_the_claims_of_its_section(name: str) -> None:
    """The table at the top against the claims below, model by model."""
    text = (DOCS / name).read_text(encoding="utf-8")
    summary = re.findall(r"^\| \[`(\w+)`\]\(#\w+\) \| [^|]* \|(.*)\|$", text, re.MULTILINE)
    assert summary
    for each, cells in summary:
        section = text.partition(f'<a id="{each}"></a>')[2].partition('<a id="')[0]
        verdicts = [cell.strip() for cell in cells.split("|")]
        verdicts = [cell for cell in verdicts if cell != "–"]
        claims = claims_of(section.partition("**Verdict")[2])
        assert len(verdicts) == len(claims[0][1]), each
        for model, verdict in enumerate(verdicts):
            assert verdict.endswith(": " + counts(claims, model)), (each, model)
            words = verdict.partition(":")[0]
            assert words in section.partition("**Verdict")[2].partition("**")[0], each


def thresholds() -> list[ChangedThreshold]:
    """Of all experiments, as they judge now."""
    modules = (
        importlib.import_module(found.name)
        for found in pkgutil.walk_packages(experiments.__path__, f"{experiments.__name__}.")
    )
    values = [value for module in modules for value in vars(module).values()]
    listed = [each for value in values if isinstance(value, tuple) for each in value]
    found = [each for each in (*values, *listed) if isinstance(each, ChangedThreshold)]
    return list(dict.fromkeys(found))


@pytest.mark.parametrize("changed", thresholds(), ids=lambda changed: changed.claim[:40])
def test_a_threshold_stands_on_a_page_as_it_judges_now(changed: ChangedThreshold) -> None:
    row = f"| {changed.claim} | {changed.was} | {changed.now} | {changed.why} |"
    pages = [(DOCS / name).read_text(encoding="utf-8") for name in (*PAGES, *OWN_PAGES.values())]
    assert any(row in page for page in pages), f"{MAKE}: no page has {row}"


def claims_of(judged: str) -> list[tuple[bool, list[str]]]:
    """Of each claim below a verdict: whether it is one by construction, and its sign by model."""
    listed = re.findall(r"^- ([✓✗?]) (.*)$", judged, re.MULTILINE)
    if listed:
        return [("(true by construction)" in words, [sign]) for sign, words in listed]
    table = judged.partition("| claim |")[2].partition("\n\n")[0].splitlines()[2:]
    rows = [line.strip("| ").split(" | ") for line in table]
    return [("(true by construction)" in row[0], [cell[0] for cell in row[1:]]) for row in rows]


def counts(claims: list[tuple[bool, list[str]]], model: int) -> str:
    signs = [each[model] for given, each in claims if not given and each[model] != "–"]
    words = f"{signs.count('✓')} of {len(signs)}"
    if undecided := signs.count("?"):
        words += f", {undecided} undecided"
    given = sum(given and each[model] != "–" for given, each in claims)
    return f"{words}, and {given} by construction" if given else words


@pytest.mark.parametrize("name", PAGES)
def test_what_was_reported_once_stands_beside_what_is_reported_now(name: str) -> None:
    text = (DOCS / name).read_text(encoding="utf-8")
    summary = dict(
        re.findall(r"^\| \[`(\w+)`\]\(#\w+\) \| [^|]* \| ([^|]*) \|", text, re.MULTILINE)
    )
    rows = re.findall(r"^\| `(\w+)` \| ([^|]*) \| ([^|]*) \|$", text, re.MULTILINE)
    assert {each for each, _, _ in rows} == ONCE.keys() & summary.keys()
    for each, once, today in rows:
        assert (once, today) == (ONCE[each], summary[each])


def wrong_seeds(text: str) -> list[str]:
    """Scenarios that are flown with other seeds than a page says, or are there no more."""
    listed = re.findall(r"`config/scenarios/(\w+)\.toml`\. Seeds: ([\d, ]+)\.", text)
    wrong = []
    for name, seeds in listed:
        path = shipped("scenarios") / f"{name}.toml"
        if not path.is_file():
            wrong.append(f"there is no scenario {name}")
        elif ", ".join(map(str, load_scenario(path).seeds)) != seeds:
            wrong.append(f"{name} is flown with other seeds than {seeds}")
    return wrong


def test_seeds_are_compared_with_the_scenario() -> None:
    assert wrong_seeds("Scenario: `config/scenarios/lean.toml`. Seeds: 1, 2.") != []
    assert wrong_seeds("Scenario: `config/scenarios/lost.toml`. Seeds: 1.") == [
        "there is no scenario lost"
    ]
    seeds = ", ".join(map(str, load_scenario(shipped("scenarios/lean.toml")).seeds))
    assert wrong_seeds(f"Scenario: `config/scenarios/lean.toml`. Seeds: {seeds}.") == []


def test_a_gain_changed_by_a_ten_thousandth_is_noticed(now: staleness.Ends) -> None:
    """And rounding is not: a page keeps nine digits."""
    written = page([], now)
    assert staleness.differences(written, now) == []
    scenario = staleness.probed(*staleness.PROBES["tunnel"])
    gain = 1.0001 * prepare(scenario).values["RHO_P"]
    other = msgspec.structs.replace(scenario, parameters={"RHO_P": gain})
    flown = fly_job(ScenarioJob(scenario=other, seed=1))
    end = float(flown.path["x_m"][-1]), float(flown.path["z_m"][-1])
    (reported,) = staleness.differences(written, now | {"tunnel": end})
    assert reported.startswith("tunnel: ends ")


def test_a_page_without_probes_or_with_others_is_older(now: staleness.Ends) -> None:
    assert staleness.differences("# A page\n", now) == ["the page holds no probes"]
    fewer = {"tunnel": now["tunnel"]}
    (reported,) = staleness.differences(page([], fewer), now)
    assert reported.startswith("the page has the probes tunnel;")
    nowhere = {name: (float("nan"), z) for name, (_, z) in now.items()}
    assert len(staleness.differences(page([], now), nowhere)) == len(now)
