"""What workers share is made by one of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from conftest import once_for_all
from wheel import Installed


def test_it_is_made_once_while_the_others_wait(tmp_path: Path) -> None:
    made: list[Path] = []

    def make(folder: Path) -> Installed:
        made.append(folder)
        return Installed(folder / "x.whl", folder / "bin")

    with ThreadPoolExecutor(4) as workers:
        found = set(workers.map(lambda _: once_for_all(tmp_path / "wheel", make), range(4)))
    assert found == {Installed(tmp_path / "wheel" / "x.whl", tmp_path / "wheel" / "bin")}
    assert made == [tmp_path / "wheel"]
