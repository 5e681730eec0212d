"""What every test shares."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

from tgl_soar import realtime

# Time is a benchmark's business: a busy machine must not fail a property.
settings.register_profile("project", deadline=None)
settings.load_profile("project")


@pytest.fixture(autouse=True)
def ordinary_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A module that runs within a test leaves the tests' process an ordinary one.

    Otherwise it, and every process that a later test starts, would run before all others on the
    machine, with its memory locked and no garbage collected.
    """
    monkeypatch.setattr(realtime, "prepare", lambda *_wishes, **_how: [])
    monkeypatch.setattr(realtime, "_set_priority", lambda _priority: False)
    yield
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
