"""Which of the two rollouts is flown, compiled or plain."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.search import compiled_rollouts
from tgl_soar.control.search.rollout import roll_out


@pytest.mark.parametrize("there", [True, False])
def test_rollouts_are_compiled_where_that_is_possible(
    there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled_rollouts, "available", lambda: there)
    expected = compiled_rollouts.roll_out_compiled if there else roll_out
    assert compiled_rollouts.fastest_roll_out() is expected
