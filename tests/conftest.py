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
from wheel import Installed, install

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
        "onboard/test_guard.py", "onboard/test_realtime.py", "onboard/test_run_process.py",
        "onboard/test_signed_restart.py", "onboard/test_stored_parameters.py",
        "peers/test_mavproxy.py", "peers/test_mavsdk.py", "sim/test_bridge_process.py",
        "sim/test_motive.py", "sim/test_sitl.py",
    ),
    # They compile the same kernels, which takes minutes: once is enough.  What one worker has
    # compiled of one kernel serves the next; another worker would begin at the beginning.
    "kernels": (
        "analysis/experiments/lift/test_powered_search.py",
        "analysis/search/test_compiled_search.py", "analysis/search/test_searchers.py",
        "benchmarks/test_batch.py", "sim/test_compiled.py", "sim/test_kernel_cache.py",
    ),
    # They go through all conditions of each mode: thirty million of some.
    "the walk": ("control/test_reported_faults.py", "control/test_supervisor.py"),
    # They read the logs of one flight, which is flown and written once.
    "one flight": (
        "analysis/logs/test_bad_logs.py", "analysis/logs/test_reading.py",
        "analysis/report/test_flight_report.py", "cli/test_bad_logs_commands.py",
        "cli/test_report_command.py",
    ),
}  # fmt: skip
TESTS = Path(__file__).parent
# Two thirds of the time of all tests: `make test` leaves them to `make ci`.  They need a compiled
# kernel, the clock on the wall, a browser, another program, a whole log and its report, or flights
# that take seconds.
LATER_GROUPS = ("kernels", "real time", "page in a browser", "one flight")
LATER_FILES = (
    "analysis/campaigns/test_drawn_faults.py",
    "analysis/experiments/estimates/test_estimator_experiment.py",
    "analysis/experiments/estimates/test_wind_estimate.py",
    "analysis/experiments/estimates/test_wind_use.py",
    "analysis/experiments/outdoors/test_outdoors.py",
    "analysis/experiments/outdoors/test_windy_hour.py", "analysis/experiments/test_catalogue.py",
    "analysis/experiments/test_concluded.py", "analysis/experiments/test_flights.py",
    "analysis/logs/test_models_from_other_logs.py", "analysis/replay/test_replay.py",
    "analysis/report/test_flight_report.py", "analysis/report/test_point_figure.py",
    "analysis/test_identified_brake.py", "analysis/test_linear_model.py",
    "analysis/test_loop_response.py", "analysis/tuning/test_tune.py",
    "autopilot/test_passage_in_tick.py", "benchmarks/test_batch.py",
    "cli/page/test_measured_air.py", "cli/page/test_orders.py", "cli/page/test_page_for_a_day.py",
    "cli/page/test_server.py", "cli/test_identify_command.py",
    "cli/test_native.py", "cli/test_params.py", "cli/test_rare_command.py", "cli/test_site_init.py",
    "control/test_brake_watch.py", "docs/test_site.py", "estimation/test_cross_wind.py",
    "estimation/test_motion_filter.py", "estimation/test_wind.py", "fuzz/test_hostile.py",
    "onboard/test_operator_slips.py", "onboard/test_operators.py", "onboard/test_survey_switch.py",
    "peers/test_mavproxy_tgl.py", "peers/test_metadata.py", "sim/campaign/test_cluster.py",
    "sim/test_bridge_faults.py", "sim/test_closed_loop.py", "sim/test_frame_resets.py",
    "sim/test_point_mass.py", "sim/test_sideways.py", "tools/test_mutate.py",
    "tools/test_mutation_reach.py", "test_gym.py",
)  # fmt: skip


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of a file go to one worker, which makes once what they share, and native code has no
    seams for some.

    The longest go first: one worker begins with the one group, the other with the next, and the
    many short files at the end are divided so that both end together.
    """
    later = {TESTS / file for file in LATER_FILES}
    group_of = {TESTS / file: name for name, files in ONE_WORKER.items() for file in files}
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            group = group_of.get(item.path) or item.path.relative_to(TESTS).as_posix()
            item.add_marker(pytest.mark.xdist_group(group))
        own = item.get_closest_marker("xdist_group")
        if item.path in later or (own is not None and own.args[0] in LATER_GROUPS):
            item.add_marker(pytest.mark.later)
    items.sort(key=turn)
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
