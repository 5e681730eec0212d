"""What every test shares."""

import fcntl
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from drawn_again import shows_what_it_showed  # noqa: F401 - a fixture
from hypothesis import settings
from installed_wheel import Installed, install
from slow_tests import PARTS, chosen, part_of

from tgl_soar.onboard import native

# Workers, and the processes that tests start, share what is compiled; a clone keeps it.  That
# goes for byte code too: without it each of a hundred processes compiles the source once more.
os.environ.setdefault("XDG_CACHE_HOME", str(Path(__file__).parents[1] / ".cache"))
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# A linear algebra of several threads waits for them in circles, on the other worker's processor.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Time is a benchmark's business: a busy machine must not fail a property.
# Tests with a number of examples of their own keep it; `make long` gives the others many.
settings.register_profile("project", deadline=None, max_examples=50)
settings.register_profile("long", deadline=None, max_examples=1000)
settings.load_profile("project")

# Set by the test of native code, which has the tests of what flies run once more.
NATIVE = "TGL_SOAR_TEST_NATIVE" in os.environ
if NATIVE:
    assert native.use(), native.words()


# Tests that one worker takes one after the other, by file.
ONE_WORKER: dict[str, tuple[str, ...]] = {
    # They need real time: beside one another they would take it from each other.
    "real time": (
        "cli/test_preflight_command.py", "cli/test_surfaces_command.py", "docs/test_readme.py",
        "onboard/test_realtime.py", "onboard/test_run_process.py", "onboard/test_signed_restart.py",
        "onboard/test_stored_parameters.py", "onboard/test_watchdog.py", "peers/test_mavproxy.py",
        "peers/test_mavsdk.py", "sim/bridge/test_bridge_process.py", "sim/test_motive.py",
        "sim/test_sitl.py",
    ),
    # They compile the same kernels, which takes minutes: once is enough.  What one worker has
    # compiled of one kernel serves the next; another worker would begin at the beginning.
    "kernels": (
        "analysis/experiments/lift/test_throttle_experiment.py",
        "analysis/search/test_compiled_search.py", "analysis/search/test_searchers.py",
        "benchmarks/test_batch.py", "sim/test_compiled.py", "sim/test_kernel_cache.py",
    ),
    # They go through all conditions of each mode: thirty million of some.
    "the walk": ("control/test_stream_conditions.py", "control/test_supervisor.py"),
    # They read the logs of one flight, which is flown and written once.
    "one flight": (
        "analysis/logs/test_bad_logs.py", "analysis/logs/test_open_log.py",
        "analysis/report/test_flight_report.py", "cli/test_bad_logs_commands.py",
        "cli/test_report_command.py",
    ),
}  # fmt: skip
TESTS = Path(__file__).parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """Which tests that are not quick are run: see tests/slow_tests.py."""
    words = "tests that are not quick: all, none, some of " + ", ".join(PARTS) + ", or turn:HASH"
    parser.addoption("--later", default="all", metavar="PARTS", help=words)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says which they were."""
    words = terminalreporter.config.getoption("later")
    if words != "all":
        parts = ", ".join(chosen(words)) or "none of the others"
        terminalreporter.write_line(f"the quick tests, and {parts} (tests/slow_tests.py)")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Tests of a file go to one worker, which makes once what they share, and native code has no
    seams for some.

    The longest go first: one worker begins with the one group, the other with the next, and the
    many short files at the end are divided so that both end together.
    """
    parts = chosen(config.getoption("later"))
    kept: list[pytest.Item] = []
    left: list[pytest.Item] = []
    group_of = {TESTS / file: name for name, files in ONE_WORKER.items() for file in files}
    for item in items:
        file = item.path.relative_to(TESTS).as_posix()
        own = item.get_closest_marker("xdist_group")
        group = own.args[0] if own is not None else group_of.get(item.path) or file
        if own is None:
            item.add_marker(pytest.mark.xdist_group(group))
        part = part_of(file, group)
        if part:
            item.add_marker(pytest.mark.later)
        (kept if not part or part in parts else left).append(item)
    if left:
        config.hook.pytest_deselected(items=left)
    items[:] = sorted(kept, key=turn)
    if NATIVE:
        for item in items:
            if item.get_closest_marker("interpreted"):
                item.add_marker(pytest.mark.skip(reason="native code has no seam for it"))


def turn(item: pytest.Item) -> int:
    """Where in the order of all tests it stands: alike are those whose order does not matter."""
    if item.get_closest_marker("first"):
        return 0
    mark = item.get_closest_marker("xdist_group")
    assert mark is not None
    groups = list(ONE_WORKER)
    return 1 + (groups.index(mark.args[0]) if mark.args[0] in groups else len(groups))


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The project's wheel, installed where nothing of the source is; once for all workers."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "wheel"
    return once_for_all(folder, install)


def once_for_all(folder: Path, make: Callable[[Path], Installed]) -> Installed:
    """What one worker makes in a folder while others wait for it."""
    folder.mkdir(exist_ok=True)
    made = folder / "made.pickle"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            made.write_bytes(pickle.dumps(make(folder)))
        found = pickle.loads(made.read_bytes())
    assert isinstance(found, Installed)
    return found


def entered_kernels() -> int:
    """How many compiled kernels have been called for in this process."""
    module = sys.modules.get("tgl_soar.sim.compiled")
    return 0 if module is None else module._entry.cache_info().currsize


_allowed = 0  # kernels that tests which may compile have called for in this process


@pytest.fixture(autouse=True)
def compiled_by_one_worker(request: pytest.FixtureRequest) -> Iterator[None]:
    """No test compiles a kernel that another worker compiles beside it, nor does what it shares
    with others of its file (which is made before this begins)."""
    global _allowed
    yield
    groups = [mark.args[0] for mark in request.node.iter_markers("xdist_group")]
    called_for, allowed = entered_kernels(), _allowed
    _allowed = called_for  # the next test is not blamed for it
    if "kernels" not in groups and not request.node.get_closest_marker("long"):
        assert called_for == allowed, "a kernel: it belongs to tests/conftest.py's kernels"


@pytest.fixture(autouse=True)
def ordinary_process() -> Iterator[None]:
    """No test may leave this process, and those that later tests start, before all others."""
    yield
    left_as = os.sched_getscheduler(0)
    if left_as != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    assert left_as == os.SCHED_OTHER
