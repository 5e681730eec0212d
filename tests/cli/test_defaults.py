"""Every option of every command has the default and the bounds that it had (`defaults.py`)."""

from __future__ import annotations

import json

import pytest
from defaults import KEPT, now


def test_defaults_are_what_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    found = now()
    other = {
        name: (kept.get(name), found.get(name))
        for name in kept | found
        if kept.get(name) != found.get(name)
    }
    assert not other, "meant? python tests/cli/defaults.py"
