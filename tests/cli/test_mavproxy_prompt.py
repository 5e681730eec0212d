"""What is typed at MAVProxy's prompt and is no order: the usage, and nothing is sent."""

from __future__ import annotations

import pytest

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed")

from tgl_soar.cli.mavproxy_tgl import USAGE, PromptError, TglModule


@pytest.mark.parametrize(
    "typed",
    [
        "",
        "nonsense",
        "move",
        "move 1",
        "move 1 2 3 4",
        "lean",
        "lean 1 2",
        "status x",
        "engage now",
    ],
)
def test_the_usage_is_reported_for_what_is_no_order(typed: str) -> None:
    module = TglModule.__new__(TglModule)  # without a vehicle: whatever is sent has no receiver
    with pytest.raises(PromptError, match="usage") as refused:
        module._obey(typed.split())
    assert USAGE in str(refused.value)
