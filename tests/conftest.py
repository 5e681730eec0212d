"""What every test shares."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings
from wheel import Installed, install

from tgl_soar.onboard import native

# Time is a benchmark's business: a busy machine must not fail a property.
settings.register_profile("project", deadline=None)
settings.load_profile("project")

# Set by the test of native code, which has the tests of what flies run once more.
NATIVE = "TGL_SOAR_TEST_NATIVE" in os.environ
if NATIVE:
    assert native.use(), native.told()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest test goes first; native code has no seams for some."""
    items.sort(key=lambda item: item.get_closest_marker("first") is None)
    if NATIVE:
        for item in items:
            if item.get_closest_marker("interpreted"):
                item.add_marker(pytest.mark.skip(reason="native code has no seam for it"))


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The project's wheel, installed where nothing of the source is."""
    return install(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(autouse=True)
def ordinary_process() -> Iterator[None]:
    """No test may leave this process, and those that later tests start, before all others."""
    yield
    left_as = os.sched_getscheduler(0)
    if left_as != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    assert left_as == os.SCHED_OTHER
