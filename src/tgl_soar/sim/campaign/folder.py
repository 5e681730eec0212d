"""A campaign's folder: its flights as they are flown, then its table and where it comes from.

flights.journal   while it is flown
rows.parquet      one row a flight;  rows.csv: likewise, of campaigns that write it without pyarrow
manifest.json     version, commit, source, parameters, seeds, computers
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Generic, TypeVar

from tgl_soar.sim.campaign.encoding import result_type
from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.journal import Journal, JournalError
from tgl_soar.sim.campaign.manifest import (
    key_of,
    manifest_of,
    now,
    read_manifest,
    run_by,
    table_metadata,
    write_manifest,
)
from tgl_soar.sim.campaign.rows import available, write_csv, write_rows
from tgl_soar.sim.campaign.run import OnProgress, run, silent

JOURNAL: Final = "flights.journal"
ROWS: Final = "rows.parquet"
ROWS_CSV: Final = "rows.csv"
MANIFEST: Final = "manifest.json"

Job = TypeVar("Job")
Flown = TypeVar("Flown")


def is_finished(folder: Path) -> bool:
    """Whether a campaign lies there that has nothing left to go on with."""
    try:
        found = read_manifest(folder / MANIFEST)
    except JournalError:
        return False
    return found is not None and found.complete and not (folder / JOURNAL).exists()


class CampaignFolder(Generic[Job, Flown]):
    """One campaign in one folder; a context manager."""

    def __init__(
        self,
        path: Path,
        campaign: Campaign[Job, Flown],
        *,
        resume: bool = False,
        restart: bool = False,
        again: bool = False,
    ) -> None:
        """resume: go on with what is there; restart: delete it; again: delete it if it is a
        finished campaign.  None of them: begin, where nothing lies there.

        The folder is this process's alone from here on until it is closed.
        Errors: `JournalError`; TypeError for flights that cannot be kept.
        """
        self.path = path
        self.campaign = campaign
        self.manifest = manifest_of(
            campaign.name, campaign.fly, len(campaign.jobs), campaign.parameters, campaign.seeds
        )
        self._kind = result_type(campaign.fly)
        manifest, journal = self.manifest, path / JOURNAL
        self._lock = _locked(path)
        try:
            if resume and not restart:
                manifest.runs = self._runs_before(journal)
            else:
                self._begin(journal, restart=restart, again=again)
            self._journal = Journal(journal, key_of(manifest), len(campaign.jobs), self._kind)
        except BaseException:
            os.close(self._lock)
            raise

    def __enter__(self) -> CampaignFolder[Job, Flown]:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """No more is flown; what is there stays."""
        self._journal.close()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    @property
    def damaged(self) -> int:
        """How many bytes of what was kept before are of no use; their flights are missing."""
        return self._journal.damaged

    @property
    def flown(self) -> int:
        """How many flights are kept."""
        return self._journal.flown

    def fly(
        self,
        executor: Executor,
        on_progress: OnProgress = silent,
        *,
        size: int | None = None,
        first_here: bool = False,
    ) -> None:
        """Fly what is missing.  Errors: those of `run`; all that was flown is kept."""
        self.manifest.runs.append(run_by(executor.description, self._journal.flown))
        self._write_manifest()
        campaign = self.campaign
        run(
            campaign.fly,
            campaign.jobs,
            executor,
            self._journal,
            on_progress=on_progress,
            size=size,
            first_here=first_here,
        )

    def __iter__(self) -> Iterator[Flown]:
        """The results in the order of the flights, read from the disk."""
        return iter(self._journal)

    def finish(self) -> bool:
        """Write the table and the manifest and delete the journal; without pyarrow there is no
        table, and the journal stays.  Whether there is a table.  Errors: `JournalError`."""
        written = self.tabulate()
        self.conclude()
        return written

    def tabulate(self) -> bool:
        """Write the table, of which nothing else depends yet.  Whether there is one: without
        pyarrow there is none.  Errors: `JournalError`."""
        written = available()
        if written:
            kept = table_metadata(self.manifest)
            with self._or_kept(ROWS):
                write_rows(self.path / ROWS, self._job, self._kind, self.flights(), kept)
        return written

    def tabulate_as_csv(self) -> None:
        """Write the rows as CSV, beside the journal, of which they can become a table later.

        Errors: `JournalError`.
        """
        with self._or_kept(ROWS_CSV):
            write_csv(self.path / ROWS_CSV, self._job, self._kind, self.flights())

    def flights(self) -> Iterator[tuple[Job, Flown]]:
        """Every flight's job and its result, in order, read from the disk."""
        jobs = self.campaign.jobs
        return zip(map(jobs.__getitem__, range(len(jobs))), self, strict=True)

    @property
    def _job(self) -> Any:
        """The type of the jobs."""
        jobs = self.campaign.jobs
        return type(jobs[0]) if len(jobs) else object

    @contextmanager
    def _or_kept(self, name: str) -> Iterator[None]:
        """What cannot be written costs no flight.  Errors: `JournalError`."""
        try:
            yield
        except OSError as error:
            raise JournalError(
                f"{self.path / name}: cannot be written: {error}; all {len(self.campaign.jobs)}"
                " flights are kept: mend that, then go on with --resume"
            ) from None

    def conclude(self, *, keep: bool = False) -> None:
        """All is done: the manifest says so, and where there is a table the journal goes.

        keep: it stays, as who flew it reads more of a flight than a table holds.
        """
        self.manifest.complete = True
        self.manifest.runs[-1]["ended"] = now()
        self._write_manifest()
        if (self.path / ROWS).exists() and not keep:
            (self.path / JOURNAL).unlink()

    def _runs_before(self, journal: Path) -> list[dict[str, Any]]:
        """Of what is gone on with.  Its journal says what it is of: a manifest that is damaged or
        gone loses no more than who flew it."""
        try:
            found = read_manifest(self.path / MANIFEST)
        except JournalError:
            if not journal.exists():
                raise
            return []
        if found is not None and found.complete and not journal.exists():
            raise JournalError(
                f"{self.path}: complete already: see `tgl-soar campaign report {self.path}`"
            )
        return [] if found is None else found.runs

    def _begin(self, journal: Path, *, restart: bool, again: bool) -> None:
        """Delete what may be.  Errors: `JournalError` for what may not."""
        if not restart:
            manifest = read_manifest(self.path / MANIFEST)
            finished = manifest is not None and manifest.complete
            if journal.exists() and not finished:
                raise JournalError(
                    f"{journal}: flights of a campaign that was not finished: go on with --resume,"
                    " or begin again with --restart"
                )
            if (finished or (self.path / ROWS).exists()) and not (finished and again):
                raise JournalError(
                    f"{self.path}: a finished campaign's flights are there: name another folder, or"
                    " write over them with --restart"
                )
        for name in (JOURNAL, ROWS, ROWS_CSV, MANIFEST):
            with suppress(FileNotFoundError):
                (self.path / name).unlink()

    def _write_manifest(self) -> None:
        path = self.path / MANIFEST
        try:
            write_manifest(path, self.manifest)
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {error.strerror}") from None


def _locked(path: Path) -> int:
    """The folder, held by this process.  Errors: `JournalError`."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        held = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise JournalError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(held)
        raise JournalError(f"{path}: another process flies this campaign") from None
    return held
