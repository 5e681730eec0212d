"""What tests share is made once: by one of the workers, or for those of one worker."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import ONE_WORKER, once_for_all, turn
from installed_wheel import Installed


def test_it_is_made_once_while_the_others_wait(tmp_path: Path) -> None:
    made: list[Path] = []

    def make(folder: Path) -> Installed:
        made.append(folder)
        return Installed(folder / "x.whl", folder / "bin")

    with ThreadPoolExecutor(4) as workers:
        found = set(workers.map(lambda _: once_for_all(tmp_path / "wheel", make), range(4)))
    assert found == {Installed(tmp_path / "wheel" / "x.whl", tmp_path / "wheel" / "bin")}
    assert made == [tmp_path / "wheel"]


@pytest.mark.xdist_group("of one worker")
def test_groups_are_handed_out_as_groups(request: pytest.FixtureRequest) -> None:
    """pytest 9.2 with pytest-xdist 3.8 drops them without a message: tests that need real time run
    beside one another, and what a file's tests share is made by each worker."""
    if not request.config.getoption("loadgroup", False):
        pytest.skip("not with --dist loadgroup")
    assert request.node.nodeid.endswith("@of one worker")


def test_the_long_groups_begin_and_short_files_end(request: pytest.FixtureRequest) -> None:
    """With a long group at the end one worker would wait for the other."""
    assert list(ONE_WORKER)[:2] == ["real time", "kernels"]
    turns = [turn(item) for item in request.session.items]
    assert turns == sorted(turns)
    assert turn(request.node) > len(ONE_WORKER)
