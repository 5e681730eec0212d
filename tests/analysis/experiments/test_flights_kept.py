"""What experiments fly is kept, and found again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.experiments import flights
from tgl_soar.analysis.experiments.aircraft import dispersed, identification
from tgl_soar.analysis.experiments.aircraft.dispersed import LinearMargin
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import estimator_flights, wind_estimate
from tgl_soar.analysis.experiments.flights import FlownFolder, Flyer, ScenarioJob
from tgl_soar.analysis.experiments.lift import nowhere, search, throttle
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import load_scenario
from tgl_soar.cli import experiment
from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.sim.campaign.encoding import decoder, digest, result_type
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.campaign.folder import CampaignFolder
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.rows import columns_of


@pytest.mark.parametrize(
    "fly",
    [
        flights.fly_job,
        flights.fly_job_compiled,
        estimator_flights.fly_scored,
        estimator_flights.fly_scored_compiled,
        estimator_flights.watch,
        identification.examine,
        search.fly_search,
        nowhere.fly_line,
        throttle.fly_powered,
        wind_estimate.look_on,
        dispersed.margin_of,
        dispersed._fly,
    ],
)
def test_what_every_experiment_flies_can_be_kept(fly: Callable[[Any], Any]) -> None:
    kind: Any = result_type(fly)
    decoder(kind)
    assert columns_of(kind)


def margin(seed: int) -> LinearMargin:
    flown.append(seed)
    return LinearMargin(alpha=0.5 * seed)


flown: list[int] = []


def fly_twice(folder: FlownFolder) -> list[list[LinearMargin]]:
    flyer = Flyer(executor=InLine(), folder=folder)
    folder.begin("one")
    try:
        return [flyer.each(margin, seeds) for seeds in ([1, 2], [3])]
    finally:
        folder.close()


def test_an_experiment_that_is_run_again_finds_its_flights(tmp_path: Path) -> None:
    flown.clear()
    first = fly_twice(FlownFolder(tmp_path))
    assert flown == [1, 2, 3]
    assert fly_twice(FlownFolder(tmp_path, resume=True)) == first
    assert flown == [1, 2, 3]
    with pytest.raises(JournalError, match="--resume, or begin again with --restart"):
        fly_twice(FlownFolder(tmp_path))
    assert fly_twice(FlownFolder(tmp_path, restart=True)) == first
    assert len(flown) == 6


def test_no_list_goes_before_every_list_has_its_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fills at the second table leaves both lists to be gone on with."""
    pytest.importorskip("pyarrow")
    flown.clear()
    folder = FlownFolder(tmp_path)
    first = fly_twice(folder)
    whole = CampaignFolder.tabulate

    def full(self: CampaignFolder[Any, Any]) -> bool:
        if self.path.name.startswith("02"):
            raise JournalError("No space left")
        return whole(self)

    again = FlownFolder(tmp_path, resume=True)
    flyer = Flyer(executor=InLine(), folder=again)
    again.begin("one")
    assert [flyer.each(margin, seeds) for seeds in ([1, 2], [3])] == first
    with monkeypatch.context() as context:
        context.setattr(CampaignFolder, "tabulate", full)
        with pytest.raises(JournalError, match="No space left"):
            again.finish()
    again.close()
    assert fly_twice(FlownFolder(tmp_path, resume=True)) == first
    assert flown == [1, 2, 3]


def test_one_that_is_flown_again_and_stopped_can_be_gone_on_with(tmp_path: Path) -> None:
    """Lists that the second run did not come to are those of the first, and flown once more."""
    pytest.importorskip("pyarrow")
    folder = FlownFolder(tmp_path)
    first = fly_twice(folder)
    again = FlownFolder(tmp_path, resume=True)
    flyer = Flyer(executor=InLine(), folder=again)
    again.begin("one")
    for seeds in ([1, 2], [3]):
        flyer.each(margin, seeds)
    again.finish()
    again.close()
    second = FlownFolder(tmp_path)
    second.begin("one")
    Flyer(executor=InLine(), folder=second).each(margin, [1, 2])
    second.close()
    flown.clear()
    assert fly_twice(FlownFolder(tmp_path, resume=True)) == first
    assert flown == [3]


def test_another_site_by_the_same_name_is_another_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A job holds the path of --field, and not what stands there, nor in the files of its air."""
    flown.clear()
    site, wind = tmp_path / "site.toml", tmp_path / "hour.csv"
    site.write_text(
        '[site]\nname = "hill"\n[air]\nkind = "hill"\nwind_mps = 7.0\nradius_m = 8.0\n'
        'record = "hour.csv"\n'
    )
    wind.write_text("time_s,wind_mps,veer_deg\n0,7,0\n")

    def stopped(_name: str, context: Context) -> Result:
        context.flyer.each(margin, [1, 2])
        raise KeyboardInterrupt

    monkeypatch.setattr(experiment, "run_experiment", stopped)
    words = ["experiment", "places", "--field", str(site), "--workers", "0", "--quick"]
    words += ["--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, words).exit_code == 130
    assert CliRunner().invoke(app, [*words, "--resume"]).exit_code == 130
    assert flown == [1, 2]
    whole = site.read_text()
    for changed, text in (
        (site, whole.replace("7.0", "6.0")),
        (wind, wind.read_text() + "9,8,0\n"),
    ):
        kept = changed.read_text()
        changed.write_text(text)
        refused = CliRunner().invoke(app, [*words, "--resume"])
        assert refused.exit_code == 2, refused.output
        assert "flights of another campaign" in refused.stderr
        changed.write_text(kept)
    assert CliRunner().invoke(app, [*words, "--resume"]).exit_code == 130
    assert flown == [1, 2]


def test_other_jobs_are_another_campaign(tmp_path: Path) -> None:
    fly_twice(FlownFolder(tmp_path))
    folder = FlownFolder(tmp_path, resume=True)
    folder.begin("one")
    with pytest.raises(JournalError, match="another campaign"):
        Flyer(folder=folder).each(margin, [1, 5])


def test_jobs_of_a_scenario_have_a_digest() -> None:
    scenario = load_scenario(shipped("scenarios/static.toml"))
    one, other = ScenarioJob(scenario=scenario, seed=1), ScenarioJob(scenario=scenario, seed=2)
    assert digest(one) == digest(
        ScenarioJob(scenario=load_scenario(shipped("scenarios/static.toml")), seed=1)
    )
    assert digest(one) != digest(other)
