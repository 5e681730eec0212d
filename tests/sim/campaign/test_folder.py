"""A campaign's folder: begun, stopped, killed, gone on with, and its table in the end."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cheap_flights import CheapJob, cheap_campaign, cheap_jobs, fly_cheaply

from tgl_soar.sim.campaign.executors import InLine, LocalProcesses
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS, ROWS_CSV, CampaignFolder
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.manifest import read_manifest
from tgl_soar.sim.campaign.run import Progress

COUNT = 60
EXPECTED = [fly_cheaply(job) for job in cheap_jobs(COUNT)]


class Stop(Exception):
    """It is stopped."""


def stop_after(flights: int) -> object:
    def on_progress(progress: Progress) -> None:
        if progress.flown >= flights:
            raise Stop

    return on_progress


def stopped(path: Path, after: int = 20) -> None:
    with CampaignFolder(path, cheap_campaign(COUNT)) as folder, pytest.raises(Stop):
        folder.fly(InLine(), stop_after(after), size=5)  # type: ignore[arg-type]


def test_what_was_flown_is_kept_and_gone_on_with(tmp_path: Path) -> None:
    stopped(tmp_path)
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), resume=True) as folder:
        assert folder.flown == 20
        folder.fly(LocalProcesses(2))
        assert list(folder) == EXPECTED
    manifest = read_manifest(tmp_path / MANIFEST)
    assert manifest is not None
    assert [each["from"] for each in manifest.runs] == [0, 20]
    assert [each["by"] for each in manifest.runs] == ["in line", "2 local processes"]
    assert (manifest.flights, manifest.seeds) == (COUNT, [0, COUNT])


def test_an_unfinished_campaign_is_not_written_over(tmp_path: Path) -> None:
    stopped(tmp_path)
    with pytest.raises(JournalError, match=r"not finished: go on with --resume, or begin"):
        CampaignFolder(tmp_path, cheap_campaign(COUNT))
    with pytest.raises(JournalError, match="another campaign"):
        CampaignFolder(tmp_path, cheap_campaign(COUNT + 1), resume=True)
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), restart=True) as folder:
        assert folder.flown == 0


def test_the_table_holds_every_flight_and_is_the_same_whoever_flew(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    tables = []
    for name, executor, size in (("a", InLine(), 60), ("b", LocalProcesses(3), 4)):
        with CampaignFolder(tmp_path / name, cheap_campaign(COUNT)) as folder:
            folder.fly(executor, size=size)
            assert folder.finish()
        assert not (tmp_path / name / JOURNAL).exists()
        tables.append((tmp_path / name / ROWS).read_bytes())
    assert tables[0] == tables[1]
    with pytest.raises(JournalError, match="complete already: see `tgl-soar campaign report"):
        CampaignFolder(tmp_path / "a", cheap_campaign(COUNT), resume=True)


def test_a_finished_campaign_goes_only_where_that_is_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    with CampaignFolder(tmp_path, cheap_campaign(COUNT)) as folder:
        folder.fly(InLine())
        folder.finish()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(JournalError, match=r"a finished campaign's flights.*--restart"):
        CampaignFolder(tmp_path, cheap_campaign(COUNT))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    for options in ({"again": True}, {"restart": True}):
        with CampaignFolder(tmp_path, cheap_campaign(COUNT), **options) as folder:
            assert not (tmp_path / ROWS).exists()
            folder.fly(InLine())
            folder.finish()


@pytest.mark.parametrize("name", [ROWS, JOURNAL])
def test_what_is_of_nobody_known_is_left_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"somebody's")
    for again in (False, True):
        with pytest.raises(JournalError, match="--restart"):
            CampaignFolder(tmp_path, cheap_campaign(COUNT), again=again)
    assert (tmp_path / name).read_bytes() == b"somebody's"


@pytest.mark.parametrize("options", [{}, {"resume": True}, {"restart": True}])
def test_two_processes_do_not_share_a_folder(tmp_path: Path, options: dict[str, bool]) -> None:
    """From the first moment: the second deletes nothing, whatever its options."""
    with CampaignFolder(tmp_path, cheap_campaign(COUNT)) as folder:
        with pytest.raises(JournalError, match="another process flies this campaign"):
            CampaignFolder(tmp_path, cheap_campaign(COUNT), **options)
        folder.fly(InLine())
        assert list(folder) == EXPECTED
        folder.finish()


@pytest.mark.parametrize("damage", [b"{", None])
def test_a_manifest_that_is_lost_costs_no_flights(tmp_path: Path, damage: bytes | None) -> None:
    stopped(tmp_path)
    manifest = tmp_path / MANIFEST
    manifest.unlink() if damage is None else manifest.write_bytes(damage)
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), resume=True) as folder:
        assert folder.flown == 20
        folder.fly(InLine())
        assert list(folder) == EXPECTED


def test_flights_of_other_libraries_are_not_mixed_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped(tmp_path)
    monkeypatch.setattr("tgl_soar.sim.campaign.manifest.libraries", lambda: {"numba": ""})
    with pytest.raises(JournalError, match="another campaign"):
        CampaignFolder(tmp_path, cheap_campaign(COUNT), resume=True)


def test_a_table_that_cannot_be_written_leaves_nothing_of_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")

    class Full(parquet.ParquetWriter):  # type: ignore[misc,name-defined]
        def write_table(self, *_: object) -> None:
            raise OSError(28, "No space left on device")

    with CampaignFolder(tmp_path, cheap_campaign(COUNT)) as folder:
        folder.fly(InLine())
        with monkeypatch.context() as context:
            context.setattr(parquet, "ParquetWriter", Full)
            with pytest.raises(JournalError, match="No space left") as refused:
                folder.finish()
    assert f"all {COUNT} flights are kept: mend that, then go on with --resume" in str(
        refused.value
    )
    assert {path.name for path in tmp_path.iterdir()} == {JOURNAL, MANIFEST}
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), resume=True) as folder:
        assert folder.flown == COUNT


def test_without_pyarrow_the_flights_stay_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tgl_soar.sim.campaign.folder.available", lambda: False)
    with CampaignFolder(tmp_path, cheap_campaign(COUNT)) as folder:
        folder.fly(InLine())
        assert not folder.finish()
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), resume=True) as folder:
        assert list(folder) == EXPECTED


def test_a_campaign_of_nothing(tmp_path: Path) -> None:
    campaign: Campaign[CheapJob, object] = Campaign("none", fly_cheaply, [])
    with CampaignFolder(tmp_path, campaign) as folder:
        folder.fly(InLine())
        folder.finish()


# --- real processes -------------------------------------------------------------------------------


def started(
    path: Path, count: int, workers: int = 2, nap_s: float = 0.004
) -> subprocess.Popen[str]:
    here = Path(__file__).parent
    return subprocess.Popen(
        [sys.executable, "cheap_flights.py", str(path), str(count), str(workers), str(nap_s)],
        cwd=here,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def counts(process: subprocess.Popen[str]) -> Iterator[int]:
    """How many flights it says are kept."""
    assert process.stdout is not None
    for line in process.stdout:
        yield int(line.split()[-1])


def killed_until_done(path: Path, count: int, kills: int, draw: random.Random) -> int:
    """Kill it after a few more flights, or sooner, and start it again; how often it was killed."""
    killed = 0
    while True:
        process = started(path, count)
        begun = next(reported := counts(process))
        wanted = (
            begun + draw.randrange(0, max(1, count // (kills + 1))) if killed < kills else count
        )
        for flown in reported:
            if flown >= wanted and killed < kills:
                time.sleep(draw.uniform(0.0, 0.02))  # at any moment of what it does
                process.kill()
                killed += 1
                break
        process.communicate(timeout=60)
        if process.returncode == 0:
            return killed


@pytest.mark.parametrize("kills", [2, pytest.param(10, marks=pytest.mark.long)])
def test_killed_at_random_it_flies_the_same_flights(tmp_path: Path, kills: int) -> None:
    count = 200 * kills
    assert killed_until_done(tmp_path, count, kills, random.Random(kills)) == kills
    with CampaignFolder(tmp_path, cheap_campaign(count), resume=True) as folder:
        assert folder.flown == count
        assert list(folder) == [fly_cheaply(job) for job in cheap_jobs(count)]


def test_ctrl_c_leaves_what_is_done(tmp_path: Path) -> None:
    """It comes to all processes at once, as from a terminal."""
    process = started(tmp_path, 400)
    assert any(flown >= 20 for flown in counts(process))
    os.killpg(process.pid, signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    kept = int(out.split()[-1])
    assert out.splitlines()[-1] == f"stopped {kept}"
    with CampaignFolder(tmp_path, cheap_campaign(400), resume=True) as folder:
        assert 20 <= folder.flown == kept < 400


def test_no_worker_outlives_a_parent_that_is_killed(tmp_path: Path) -> None:
    process = started(tmp_path, 1000, nap_s=0.02)
    assert next(flown for flown in counts(process) if flown) > 0
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        pytest.skip("no list of children on this system")
    workers = [int(pid) for pid in children.read_text().split()]
    assert len(workers) == 2
    process.kill()
    process.communicate(timeout=60)  # ends with the last of those that hold its output
    deadline = time.monotonic() + 30.0
    while any(Path(f"/proc/{pid}/cwd").exists() for pid in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_rows_as_text_stand_beside_the_journal(tmp_path: Path) -> None:
    with CampaignFolder(tmp_path, cheap_campaign(COUNT)) as folder:
        folder.fly(InLine())
        assert [result for _, result in folder.flights()] == EXPECTED
        assert [job for job, _ in folder.flights()] == cheap_jobs(COUNT)
        folder.tabulate_as_csv()
        text = (tmp_path / ROWS_CSV).read_text(encoding="utf-8").splitlines()
        assert text[0] == "flight,value,name,seed,nap_s,deadly,raises"
        assert text[2] == f"1,{EXPECTED[1].value!r},n1,1,0.0,,False"
        assert len(text) == COUNT + 1
        (tmp_path / ROWS_CSV).unlink()
        (tmp_path / (ROWS_CSV + ".new")).mkdir()
        with pytest.raises(JournalError, match=r"rows.csv: cannot be written: .*go on with --resu"):
            folder.tabulate_as_csv()
    (tmp_path / (ROWS_CSV + ".new")).rmdir()
    (tmp_path / ROWS_CSV).touch()
    with CampaignFolder(tmp_path, cheap_campaign(COUNT), restart=True):
        assert not (tmp_path / ROWS_CSV).exists()  # of flights that are no more
