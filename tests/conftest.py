"""What every test shares."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

# Time is a benchmark's business: a busy machine must not fail a property.
settings.register_profile("project", deadline=None)
settings.load_profile("project")


@pytest.fixture(autouse=True)
def ordinary_process() -> Iterator[None]:
    """No test may leave this process, and those that later tests start, before all others."""
    yield
    left_as = os.sched_getscheduler(0)
    if left_as != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    assert left_as == os.SCHED_OTHER
