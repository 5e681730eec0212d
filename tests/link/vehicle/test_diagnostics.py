"""What all parts of a session count: everything begins at zero, and each session by itself."""

from __future__ import annotations

from dataclasses import asdict, fields

import pytest

from tgl_soar.link.vehicle.diagnostics import SessionCounters


@pytest.mark.parametrize("name", [field.name for field in fields(SessionCounters)])
def test_nothing_is_counted_before_anything_has_come(name: str) -> None:
    assert asdict(SessionCounters())[name] == 0


def test_what_one_session_counts_no_other_does() -> None:
    one, other = SessionCounters(), SessionCounters()
    one.stale += 1
    assert (one.stale, other.stale) == (1, 0)
