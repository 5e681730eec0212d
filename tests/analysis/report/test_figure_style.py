"""How figures come to disk."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from tgl_soar.analysis.report.figure_style import drawing, save


@pytest.mark.parametrize("name", ["new/picture.png", "new/picture.svg"])
def test_a_figure_that_is_written_is_no_longer_held(tmp_path: Path, name: str) -> None:
    """Whoever draws hundreds would fill the memory, and is warned from twenty on."""
    with drawing() as plt:
        figure, _ = plt.subplots()
        assert plt.fignum_exists(figure.number)
        save(plt, figure, tmp_path / name)
        assert not plt.fignum_exists(figure.number)
    assert (tmp_path / name).stat().st_size > 0
