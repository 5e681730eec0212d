"""The file in which a search is kept: answers as read back, which search sought them, and what is
reported of a file that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tgl_soar.analysis.tuning.progress_file import ProgressError, ProgressFile


def test_an_answer_is_sought_once_and_is_the_same_as_when_read_back(tmp_path: Path) -> None:
    path = tmp_path / "progress"
    progress = ProgressFile(path, "task")
    assert not path.exists()
    assert progress.answer("one", lambda: (1, (2.5, None))) == [1, [2.5, None]]
    assert progress.answer("one", lambda: pytest.fail("sought again")) == [1, [2.5, None]]
    again = ProgressFile(path, "task")
    assert again.answer("one", lambda: pytest.fail("sought again")) == [1, [2.5, None]]
    assert again.answer("two", lambda: "new") == "new"
    assert set(json.loads(path.read_bytes())["answers"]) == {"one", "two"}


def test_runs_are_kept_with_what_was_there_before_them(tmp_path: Path) -> None:
    path = tmp_path / "progress"
    first = ProgressFile(path, "task")
    first.begin("one process")
    first.answer("one", lambda: 1)
    first.answer("two", lambda: 2)
    second = ProgressFile(path, "task")
    second.begin("two processes")
    assert [(run["by"], run["from"]) for run in second.runs] == [
        ("one process", 0), ("two processes", 2),
    ]  # fmt: skip
    # One that found nothing is not kept.
    assert [run["by"] for run in ProgressFile(path, "task").runs] == ["one process"]


def test_two_files_share_nothing(tmp_path: Path) -> None:
    one, other = (ProgressFile(tmp_path / name, "task") for name in "ab")
    one.begin("me")
    one.answer("q", lambda: 1)
    assert other.runs == []
    assert other.answer("q", lambda: 2) == 2


def test_what_is_done_is_deleted_if_it_is_there(tmp_path: Path) -> None:
    progress = ProgressFile(tmp_path / "progress", "task")
    progress.delete()
    progress.answer("q", lambda: 1)
    progress.delete()
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_used_is_named_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "progress"
    with pytest.raises(ProgressError, match=rf"^{tmp_path}: cannot be read: Is a directory$"):
        ProgressFile(tmp_path, "task")
    for damaged in (b"{", b'{"answers": {}}', b'{"task": "task", "more": 1}', b'{"task": "\xff"}'):
        path.write_bytes(damaged)
        with pytest.raises(ProgressError, match=rf"^{path}: no progress file: .*; delete it$"):
            ProgressFile(path, "task")
    path.write_bytes(b'{"task": "other"}')
    with pytest.raises(ProgressError, match=rf"^{path}: belongs to other files .*--restart"):
        ProgressFile(path, "task")
    path.write_bytes(b'{"task": "task"}')
    assert ProgressFile(path, "task").runs == []
