"""Which tests are not quick: `make test` leaves them out, `make all` runs them all, and `make ci`,
which has twelve minutes, one of seven parts of them: each commit's own, so that commits take turns.

A test of a file that is named here belongs to a part, and so does one whose group for pytest-xdist
is named in `GROUPS`.  The parts take about as long as one another, four minutes of two processors;
a new test that takes seconds goes to the part that it is of.
"""

from __future__ import annotations

from typing import Final

import pytest

# Whole flights of the laws, in plain Python.
LAWS = (
    "autopilot/test_beating_in_tick.py", "autopilot/test_launch_landing_in_tick.py",
    "autopilot/test_pitch_near_ground_in_tick.py", "autopilot/test_point_in_tick.py",
    "autopilot/test_power_in_tick.py", "autopilot/test_rangefinder_in_tick.py",
    "autopilot/test_stall_margin_in_tick.py", "control/test_brake_shake.py",
    "control/test_brake_watch.py", "control/test_stream_conditions.py",
    "docs/test_flown_sections.py",
    "estimation/test_cross_wind.py", "estimation/test_motion_filter.py", "estimation/test_wind.py",
    "onboard/test_attitude_route.py", "onboard/test_onboard_clocks.py",
    "onboard/test_duplicate_autopilot.py", "onboard/test_duplicate_modules.py",
    "onboard/test_excitation_switch.py", "onboard/test_gnss_watch.py", "onboard/test_kept_wire.py",
    "onboard/test_search_switch.py", "onboard/test_station_watch.py",
    "onboard/test_survey_switch.py", "sim/bridge/test_bridge.py",
    "sim/bridge/test_bridge_faults.py", "sim/test_closed_loop.py",
    "sim/test_closed_loop_lateral.py", "sim/test_frame_resets.py", "sim/test_gains_in_flight.py",
    "sim/test_kept_flights.py", "sim/test_oblique_wind.py", "sim/test_wrong_measurements.py",
)  # fmt: skip
# What needs a compiled kernel, which takes minutes to compile.
KERNELS = (
    "analysis/experiments/lift/test_throttle_experiment.py",
    "analysis/search/test_compiled_search.py", "analysis/search/test_searchers.py",
    "benchmarks/test_batch.py", "sim/test_compiled.py", "sim/test_kernel_cache.py",
    "sim/test_point_mass.py", "test_gym.py",
)  # fmt: skip
# Other programs, the clock on the wall, a browser, hostile bytes, the docs as a site.
PROCESSES = (
    "cli/page/test_page_for_a_day.py", "cli/test_native.py", "docs/test_site.py",
    "fuzz/test_fuzz.py", "fuzz/test_hostile.py", "onboard/test_standard_streams.py",
    "peers/test_mavproxy_tgl.py", "peers/test_metadata.py", "sim/campaign/test_cluster.py",
    "tools/test_mutate.py", "tools/test_mutation_reach.py",
)  # fmt: skip
# Models, experiments, campaigns and their figures.
ANALYSIS = (
    "analysis/campaigns/test_drawn_faults.py", "analysis/campaigns/test_safety_timeline.py",
    "analysis/experiments/estimates/test_estimator_experiment.py",
    "analysis/experiments/estimates/test_estimator_flights_numbers.py",
    "analysis/experiments/paper/test_changing_air_numbers.py",
    "analysis/experiments/paper/test_line_lean_numbers.py",
    "analysis/experiments/paper/test_places_numbers.py",
    "analysis/experiments/estimates/test_wind_estimate.py",
    "analysis/experiments/estimates/test_wind_use.py", "analysis/experiments/lift/test_nowhere.py",
    "analysis/experiments/outdoors/test_beating.py", "analysis/experiments/outdoors/test_hour.py",
    "analysis/experiments/outdoors/test_outdoors.py",
    "analysis/experiments/outdoors/test_rangefinder.py", "analysis/experiments/test_catalogue.py",
    "analysis/experiments/test_conclusions.py", "analysis/experiments/test_flights.py",
    "analysis/experiments/test_plans.py",
    "analysis/logs/test_models_from_other_logs.py", "analysis/rare/test_soaring_process.py",
    "analysis/rare/test_splitting.py", "analysis/replay/test_replay.py",
    "analysis/report/test_figures.py", "analysis/report/test_point_figure.py",
    "analysis/survey/test_contour_fit.py", "analysis/test_identification.py",
    "analysis/test_identification_equations.py",
    "analysis/test_identification_brake.py",
    "cli/test_experiment_commands.py", "cli/test_rare_command.py", "tools/test_compare_cfd.py",
    "tools/test_gym_baseline.py", "tools/test_mutations.py",
)  # fmt: skip
# Gains and margins: what is sought for an airframe, and what drawn aircraft are left.
GAINS = (
    "analysis/experiments/loop/test_lateral_rule_numbers.py",
    "analysis/experiments/loop/test_latency_numbers.py",
    "analysis/experiments/loop/test_margin_tables.py",
    "analysis/experiments/test_random_aircraft.py", "analysis/test_linear_model.py",
    "analysis/test_loop_response.py", "analysis/tuning/test_tune.py", "cli/test_tune_command.py",
    "config/test_lateral_gains.py", "control/test_drawn_margins.py",
    "control/test_pitch_design.py",
)  # fmt: skip
# What people do with it: commands, the page, logs and reports, several operators at once.
PEOPLE = (
    "analysis/logs/test_log_exports.py", "analysis/report/test_flight_report.py",
    "benchmarks/test_benchmark_page.py", "cli/page/test_command.py",
    "cli/page/test_measured_air.py", "cli/page/test_orders.py", "cli/page/test_server.py",
    "cli/page/test_settling_preview.py", "cli/page/test_station.py", "cli/test_help.py",
    "cli/test_identify_command.py", "cli/test_init.py", "cli/test_params.py",
    "cli/test_site_init.py", "onboard/flightlog/test_flight_log.py",
    "onboard/test_link_load.py", "onboard/test_operator_mistakes.py", "onboard/test_operators.py",
    "onboard/test_other_links.py",
)  # fmt: skip
# What flies as native code, which takes minutes to make.
NATIVE = ("cli/test_native_made.py",)
PARTS: Final[dict[str, tuple[str, ...]]] = {
    "laws": LAWS,
    "kernels": KERNELS,
    "processes": PROCESSES,
    "analysis": ANALYSIS,
    "gains": GAINS,
    "people": PEOPLE,
    "native": NATIVE,
}
GROUPS: Final = {
    "kernels": "kernels",
    "one flight": "people",
    "page in a browser": "processes",
    "real time": "processes",
}
PART_OF: Final = {file: part for part, files in PARTS.items() for file in files}


def part_of(file: str, group: str) -> str:
    """The part of the tests of a file under `tests/`, of a group; "": they are quick."""
    return PART_OF.get(file) or GROUPS.get(group, "")


def chosen(words: str) -> tuple[str, ...]:
    """The parts that `--later` asks for: all, none, their names, or turn:HASH, a commit's own.

    Errors: `pytest.UsageError`.
    """
    names = tuple(PARTS)
    if words in ("all", "none"):
        return names if words == "all" else ()
    if words.startswith("turn:"):
        try:
            return (names[int(words[5:], 16) % len(names)],)
        except ValueError:  # no repository
            return names[:1]
    asked = tuple(words.split(","))
    unknown = [name for name in asked if name not in names]
    if unknown:
        allowed = ", ".join(("all", "none", "turn:HASH", *names))
        raise pytest.UsageError(f"--later {words}: {', '.join(unknown)} is none of {allowed}")
    return asked
