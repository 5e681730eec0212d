"""What decides a claim, and what a page and a file say of a result: thresholds from both sides."""

from __future__ import annotations

from dataclasses import replace
from math import cos, inf, isnan, nan, radians, sin, sqrt
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tgl_soar.analysis.experiments import context as contexts
from tgl_soar.analysis.experiments.context import (
    Context,
    drawn_air,
    drawn_line,
    turbulence_of,
    with_turbulence,
)
from tgl_soar.analysis.experiments.flights import (
    Flyer,
    ScenarioJob,
    fly_job_compiled,
    legs_named,
    mean_of_flights,
    rms,
    rms_error,
)
from tgl_soar.analysis.experiments.pages import (
    DISPERSED_WORDS,
    aims_page,
    between,
    changed_thresholds,
    counted,
    former_verdicts,
    page,
    pages,
    with_result,
)
from tgl_soar.analysis.experiments.result import (
    DISPERSED_AIRCRAFT,
    POINT_MASS,
    RESOLVED,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    above,
    all_of,
    as_json,
    as_markdown,
    by_model,
    changed_by_dispersion,
    decided,
    missed_by_dispersion,
    plain,
    tables_of,
    unasked_of_dispersed,
    within,
)
from tgl_soar.analysis.experiments.scenario import PlacedLine, load_scenario, prepare
from tgl_soar.analysis.experiments.spread_along_line import (
    Slide,
    dispersion,
    dryden_dispersion,
    leverage,
)
from tgl_soar.analysis.experiments.staleness import (
    PROBES,
    SAME_M,
    differences,
    is_as_written,
    mark,
    marked,
    probed,
)
from tgl_soar.config.files import shipped
from tgl_soar.config.site import HillAir
from tgl_soar.control.target_line import TargetLine

YES, NO = Claim("it does", True, "1 cm"), Claim("it does not", False, "2 cm")
OPEN = Claim("it may", False, "1 ± 2 cm", undecided=True)


def result(*claims: Claim, **more: Any) -> Result:
    table = Table("one", ("a", "b [m]"), (("x", "1"),))
    made = Result(
        name="name", title="title", flown="flown.", claims=claims, why="", tables=(table,),
        numbers={},
    )  # fmt: skip
    return replace(made, **more)


# --- what decides ---------------------------------------------------------------------------------


def test_a_bound_is_kept_missed_or_left_open_by_2_4_standard_errors() -> None:
    """95 % of Student's t with 7 degrees of freedom is 2.365."""
    assert RESOLVED == 2.4
    for off in (0.5, -0.5):
        assert within(off, 0.1, 0.75) is True  # up to 0.74
        assert within(off, 0.1, 0.73) is None
        assert within(off, 0.1, 0.27) is None  # from 0.26
        assert within(off, 0.1, 0.25) is False
    assert within(0.25, 0.0, 0.25) is True
    assert within(nan, 0.1, 1.0) is False
    assert within(0.1, inf, 1.0) is None


def test_a_sign_is_known_beyond_2_4_standard_errors() -> None:
    assert above(0.25, 0.1) is True
    assert above(0.24, 0.1) is None
    assert above(0.23, 0.1) is None
    assert above(-0.23, 0.1) is None
    assert above(-0.25, 0.1) is False
    assert above(nan, 0.1) is False
    assert above(0.0, 0.0) is None


def test_all_hold_or_one_decides() -> None:
    assert all_of([True, True]) is True
    assert all_of(iter([True, None, False])) is False
    assert all_of([None, True]) is None
    assert all_of([]) is False


def test_a_claim_that_is_left_open_does_not_hold() -> None:
    for holds, held, undecided in ((True, True, False), (False, False, False), (None, False, True)):
        claim = decided("text", holds, "1 cm", by_construction=True)
        assert (claim.holds, claim.undecided, claim.by_construction) == (held, undecided, True)
    assert not decided("text", True, "").by_construction
    assert not Claim("text", True, "").by_construction
    assert not Claim("text", True, "").undecided


@pytest.mark.parametrize(
    ("claims", "own", "verdict"),
    [
        ((YES, YES), False, "agrees"),
        ((YES, YES), True, "met"),
        ((YES, OPEN), False, "agrees in part"),
        ((YES, NO), True, "met in part"),
        ((OPEN, OPEN), True, "undecided"),
        ((OPEN, NO), False, "differs"),
        ((NO,), True, "missed"),
        ((), False, "by construction"),
    ],
)
def test_the_verdict(claims: tuple[Claim, ...], own: bool, verdict: str) -> None:
    assert result(*claims, own=own).verdict == verdict


def test_means_of_flights_know_their_error() -> None:
    found = mean_of_flights([1.0, 2.0, 6.0])
    assert found.mean == 3.0
    assert found.apart == pytest.approx(sqrt((4.0 + 1.0 + 9.0) / 2.0))
    assert found.error == pytest.approx(found.apart / sqrt(3.0))
    assert mean_of_flights([4.0]) == (4.0, inf, 0.0)
    two = mean_of_flights([1.0, 3.0])
    assert (two.mean, two.apart, two.error) == pytest.approx((2.0, sqrt(2.0), 1.0))
    none = mean_of_flights([])
    assert isnan(none.mean)
    assert none.error == inf
    assert isnan(none.apart)


def test_a_root_of_a_mean_square_knows_its_error() -> None:
    assert rms([3.0, 4.0]) == pytest.approx(sqrt(12.5))
    assert isnan(rms([]))
    squares = [1.0, 2.0, 6.0]
    assert rms_error(squares) == pytest.approx(0.5 * mean_of_flights(squares).error / 3.0)
    assert rms_error([1.0]) == inf
    assert rms_error([0.0, 0.0]) == inf
    assert rms_error([1.0, 1.0]) == 0.0


# --- by model -------------------------------------------------------------------------------------


def test_what_dispersion_changes_and_misses() -> None:
    given = Claim("an identity", True, "", by_construction=True)
    here = result(YES, NO, given)
    there = result(replace(YES, holds=False), NO, OPEN, replace(NO, text="new"), given)
    assert changed_by_dispersion(here) == []
    assert missed_by_dispersion(here) == []
    both = replace(here, also={DISPERSED_AIRCRAFT: there})
    assert [(a.text, a.holds, b.holds) for a, b in changed_by_dispersion(both)] == [
        ("it does", True, False)
    ]
    assert [claim.text for claim in missed_by_dispersion(both)] == ["it may", "new"]
    kept = replace(here, also={DISPERSED_AIRCRAFT: result(replace(YES, text="new"))})
    assert missed_by_dispersion(kept) == []
    assert unasked_of_dispersed(here) == unasked_of_dispersed(both) == []
    assert [claim.text for claim in unasked_of_dispersed(kept)] == ["it does", "it does not"]
    assert changed_by_dispersion(replace(here, also={POINT_MASS: there})) == []
    assert list(by_model(both)) == ["rigid body", "rigid body, dispersed"]


def test_the_tables_of_one_model_stand_as_they_are() -> None:
    assert tables_of(result(YES)) == result(YES).tables
    other = result(YES, tables=(Table("one", ("a", "b [m]"), (("y", "2"), ("z", "3"))),))
    (table,) = tables_of(result(YES, also={POINT_MASS: other}))
    assert table.title == "one"
    assert table.columns == ("model", "a", "b [m]")
    assert table.rows == (
        ("rigid body", "x", "1"), ("point mass", "y", "2"), ("point mass", "z", "3"),
    )  # fmt: skip
    columns = result(YES, tables=(Table("one", ("a", "c"), (("y", "2"),)),))
    first, second = tables_of(result(YES, also={POINT_MASS: columns}))
    assert (first.title, second.title) == ("Rigid body: one", "Point mass: one")


def test_the_section_has_figures_scenarios_and_seeds_where_there_are_any() -> None:
    bare = as_markdown(result(YES), "images")
    assert bare == (
        "## `name`: title\n\nflown.\n\n**one**\n\n| a | b [m] |\n|---|---|\n| x | 1 |\n\n"
        "**Verdict: agrees.**\n\n- ✓ it does: 1 cm.\n"
    )
    untitled = as_markdown(result(YES, tables=(Table("", ("a",), ()),)), "images")
    assert "flown.\n\n| a |\n|---|\n\n**Verdict" in untitled
    full = as_markdown(
        result(YES, why="because.", figures=("f.png",), scenarios=("s", "t"), seeds=(1, 2)), "here"
    )
    assert "\n\n![title](here/f.png)\n\n" in full
    assert full.endswith(
        "\n\nbecause.\n\nScenario: `config/scenarios/s.toml`, `config/scenarios/t.toml`."
        " Seeds: 1, 2.\n"
    )


def test_reasons_stand_model_by_model_where_they_are_not_the_same() -> None:
    other = result(YES, why="other.")
    text = as_markdown(result(YES, why="one.", also={POINT_MASS: other}), "")
    assert "\n\n*Rigid body*: one.\n\n*Point mass*: other.\n" in text
    text = as_markdown(result(YES, why="", also={POINT_MASS: other}), "")
    assert "*Rigid body*" not in text


def test_json_holds_plain_numbers() -> None:
    numbers = {
        1: np.float64(0.123456789), "b": np.array([1.0, nan]), "c": np.bool_(True),
        "d": np.int64(7), "e": (inf, "word", None, True), "f": 2,
    }  # fmt: skip
    found = plain(numbers)
    assert found == {
        "1": 0.123457, "b": [1.0, None], "c": True, "d": 7, "e": [None, "word", None, True], "f": 2,
    }  # fmt: skip
    assert type(found["c"]) is bool
    assert type(found["d"]) is int
    written = as_json(result(YES, OPEN, own=True, seeds=(3,), scenarios=("s",), badly=("b",)))
    assert written["verdict"] == "met in part"
    assert written["own"] is True
    assert written["claims"][1] == {
        "text": "it may", "holds": False, "measured": "1 ± 2 cm", "by_construction": False,
        "undecided": True,
    }  # fmt: skip
    assert (written["seeds"], written["scenarios"], written["badly"]) == ([3], ["s"], ["b"])
    assert set(written["versions"]) == {"tgl_soar", "python", "numpy", "machine"}


# --- pages ----------------------------------------------------------------------------------------


def test_a_verdict_says_on_how_many_claims_it_rests() -> None:
    given = Claim("an identity", True, "", by_construction=True)
    assert counted(result(YES, NO)) == "agrees in part: 1 of 2"
    assert counted(result(YES, OPEN, given, given)) == (
        "agrees in part: 1 of 2, 1 undecided, and 2 by construction"
    )


def test_pages_are_written_for_what_there_is() -> None:
    ends = {"a probe": (1.0, 2.0)}
    paper, ours = result(YES), result(YES, name="ours", own=True)
    assert set(pages([paper], lambda _: ends)) == {"experiments.md"}
    assert set(pages([ours], lambda _: ends)) == {"aims.md"}
    both = pages([paper, ours], lambda name: {name: (1.0, 2.0)})
    assert [marked(text) for text in both.values()] == [{name: (1.0, 2.0)} for name in both]
    assert pages([], lambda _: ends) == {}
    text = page([paper], ends)
    assert text.startswith("# The paper's experiments, flown in simulation\n\n")
    assert is_as_written(text)
    assert f"\n\n{mark(ends)}\n" in text
    assert '<a id="name"></a>\n\n## `name`: title\n' in text
    assert aims_page([ours], ends).startswith("# Aims of our own, flown in simulation\n\n")


def test_the_summary_has_a_column_for_each_model_that_flew() -> None:
    both = result(YES, also={POINT_MASS: result(NO), DISPERSED_AIRCRAFT: result(OPEN)})
    lines = page([both, result(YES, name="alone")], {}).splitlines()
    at = lines.index(
        "| experiment | what | verdict | of the point mass | of the rigid body, dispersed |"
    )
    assert lines[at + 1 : at + 4] == [
        "|---|---|---|---|---|",
        "| [`name`](#name) | title | agrees: 1 of 1 | differs: 0 of 1 | undecided: 0 of 1,"
        " 1 undecided |",
        "| [`alone`](#alone) | title | agrees: 1 of 1 | – | – |",
    ]


def test_changed_thresholds_and_former_verdicts_are_tables_with_heads() -> None:
    assert changed_thresholds([result(YES)]) == []
    assert former_verdicts([result(YES)]) == []
    changed = result(YES, changed=(ChangedThreshold("c", "was", "is", "why"),) * 2)
    lines = changed_thresholds([changed])
    assert lines[0] == ""
    assert lines[-4:] == [
        "| experiment | claim | was | is | why |", "|---|---|---|---|---|",
        *("| `name` | c | was | is | why |",) * 2,
    ]  # fmt: skip
    lines = former_verdicts([result(YES, name="static"), result(YES)])
    assert lines[-3:] == [
        "| experiment | once | today |", "|---|---|---|",
        "| `static` | agrees: 2 of 2 | agrees: 1 of 1 |",
    ]  # fmt: skip


def test_a_section_is_written_between_its_marks_and_nowhere_else() -> None:
    assert between("a<b>old<e>z", "<b>", "<e>", "new") == "a<b>\n\nnew\n<e>z"
    for text in ("a<b>old", "old<e>z", "old"):
        with pytest.raises(ValueError, match="no marks '<b>' … '<e>' to write between"):
            between(text, "<b>", "<e>", "new")
    begin = "<!-- name: begin; written by `tgl-soar experiment name --docs docs` -->"
    page_ = f"head\n{begin}old<!-- name: end -->\nfoot"
    ends = {"tunnel": (1.0, 2.0)}
    text = with_result(page_, result(YES), "name", ends)
    assert text.startswith(f"head\n{begin}\n\n\nflown.\n")
    assert f"\n\n{mark(ends)}\n<!-- sum of" in text
    assert text.endswith(" -->\n\n<!-- name: end -->\nfoot")
    assert is_as_written(text.partition(begin)[2].partition("<!-- name: end")[0])
    assert "old" not in text
    assert "## `name`" not in text  # the page has a heading of its own
    assert DISPERSED_WORDS not in text
    assert "Thresholds are argued" not in text
    judged = result(YES, changed=(ChangedThreshold("c", "was", "is", "why"),))
    written = with_result(page_, judged, "name", ends)
    assert f"\n| `name` | c | was | is | why |\n\n{mark(ends)}\n" in written


# --- probes ---------------------------------------------------------------------------------------


def test_probes_fly_four_seconds_in_rough_air_and_nothing_changes() -> None:
    """In jet and over hill, with accelerations and a pitot tube, and on the other model."""
    flown = {name: probed(*of) for name, of in PROBES.items()}
    assert len(flown) == 3
    for scenario in flown.values():
        assert scenario.turbulence is not None
        assert scenario.turbulence.intensity == 0.03
        assert (scenario.duration_s, scenario.changes) == (4.0, [])
    tunnel, hill, point = flown.values()
    assert isinstance(hill.air, HillAir)
    assert (hill.sensors.imu, hill.sensors.pitot) == (True, True)
    assert (tunnel.sensors.imu, tunnel.sensors.pitot) == (False, False)
    assert [each.model for each in flown.values()] == ["rigid_body", "rigid_body", "point_mass"]
    assert tunnel.lines == point.lines


def test_ends_are_the_same_to_a_ten_millionth_of_a_metre() -> None:
    assert SAME_M == 1e-7
    ends = {"a": (1.25, 0.5), "b": (1e9, -2.0)}
    text = mark(ends)
    assert differences(text, {**ends, "a": (1.25 + 0.9e-7, 0.5)}) == []
    assert differences(text, {**ends, "a": (1.25 + 1.2e-7, 0.5)}) == ["a: ends 1.2e-07 m elsewhere"]
    nine = mark({"a": (0.12345678912, -0.98765432198)})
    assert "[0.123456789, -0.987654322]" in nine


# --- the spread along a line ----------------------------------------------------------------------

SLIDE = Slide(rate_per_s=0.8, polar_slope=0.2, eta_rad=radians(110.0))


def test_the_spread_is_that_of_the_docstrings_equation() -> None:
    """The variance of a low-pass, (1/λ) ∫ R(t) exp(−λt) dt, integrated numerically."""
    t = np.linspace(0.0, 60.0, 600_001)
    gain = sin(SLIDE.eta_rad) - 0.2 * cos(SLIDE.eta_rad)
    assert leverage(SLIDE) == pytest.approx(gain)

    def variance(r: Any) -> float:
        return float(np.trapezoid(r * np.exp(-0.8 * t), t)) / 0.8 / gain**2

    updraft = variance(0.3**2 * np.exp(-t / 0.5))
    gust = variance((0.2 * 0.4) ** 2 * np.exp(-t / 0.7))
    assert dispersion(SLIDE, 0.3, 0.5, 0.4, 0.7) == pytest.approx(sqrt(updraft + gust), rel=1e-4)
    tau = 0.6
    updraft = variance(0.3**2 * np.exp(-t / tau) * (1.0 - 0.5 * t / tau))
    gust = variance((0.2 * 0.3) ** 2 * np.exp(-t / tau))
    assert dryden_dispersion(SLIDE, 0.3, tau) == pytest.approx(sqrt(updraft + gust), rel=1e-4)
    flipped = SLIDE._replace(eta_rad=SLIDE.eta_rad + radians(180.0))
    assert dryden_dispersion(flipped, 0.3, tau) == pytest.approx(dryden_dispersion(SLIDE, 0.3, tau))
    assert dispersion(flipped, 0.3, 0.5, 0.4, 0.7) > 0.0


@pytest.mark.parametrize("rate", [0.0, -0.5, nan])
def test_a_place_that_does_not_hold_has_no_spread(rate: float) -> None:
    unstable = SLIDE._replace(rate_per_s=rate)
    with pytest.raises(ValueError, match="no stable place: λ = "):
        dispersion(unstable, 0.2, 0.2, 0.2, 0.2)
    with pytest.raises(ValueError, match="no stable place: λ = "):
        dryden_dispersion(unstable, 0.2, 0.2)


# --- what an experiment is given ------------------------------------------------------------------


def test_calm_air_needs_one_flight_unless_aircraft_are_drawn() -> None:
    static = load_scenario(shipped("scenarios/static.toml"))
    many = msgspec.structs.replace(static, seeds=(4, 5, 6))
    assert with_turbulence(many, 0.0).seeds == (4,)
    assert with_turbulence(many, 0.0, every_seed=True).seeds == (4, 5, 6)
    rough = with_turbulence(many, 0.02)
    assert rough.seeds == (4, 5, 6)
    assert rough.turbulence is not None
    assert static.turbulence is not None
    assert rough.turbulence.intensity == 0.02
    assert rough.turbulence.length_scale_m == static.turbulence.length_scale_m


def test_turbulence_is_a_fraction_of_the_wind_and_lasts_its_length() -> None:
    prepared = prepare(with_turbulence(load_scenario(shipped("scenarios/static.toml")), 0.02))
    assert prepared.site.air is not None
    length_m = prepared.site.air.turbulence.length_scale_m
    wind_mps = prepared.field.reference_wind_mps
    assert turbulence_of(prepared) == pytest.approx((0.02 * wind_mps, length_m / wind_mps))


class Keeps(Flyer):
    """Flies nothing, and keeps how it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.plainly: list[ScenarioJob] = []
        self.compiled: list[ScenarioJob] = []

    def fly(self, jobs: Any) -> Any:
        self.plainly = list(jobs)
        return [job.seed for job in self.plainly]

    def each(self, fly: Any, jobs: Any, *, compiled: bool = False) -> Any:
        assert fly is fly_job_compiled
        assert compiled
        self.compiled = list(jobs)
        return [job.seed for job in self.compiled]


def test_many_flights_are_compiled_and_few_or_faulty_ones_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    static = load_scenario(shipped("scenarios/static.toml"))
    faulty = msgspec.structs.replace(static, faults=["position.dropout start=3"])
    jobs = [ScenarioJob(scenario=static, seed=i) for i in range(120)]
    assert Context(Keeps()).compiled_from == 120
    for has_numba, asked, compiles in (
        (True, jobs, True),
        (True, jobs[:119], False),
        (True, [*jobs, ScenarioJob(scenario=faulty, seed=1)], False),
        (False, jobs, False),
    ):
        monkeypatch.setattr(contexts, "available", lambda has=has_numba: has)
        flyer = Keeps()
        Context(flyer).fly_jobs(asked)
        assert len(flyer.compiled) == (len(asked) if compiles else 0)
        assert len(flyer.plainly) == (0 if compiles else len(asked))


def test_flights_come_back_by_scenario_in_the_order_of_seeds() -> None:
    static = load_scenario(shipped("scenarios/static.toml"))
    one, two = (msgspec.structs.replace(static, seeds=seeds) for seeds in ((5, 3), (9,)))
    flyer = Keeps()
    found: Any = Context(flyer, dispersion=True).fly({"one": one, "two": two})
    assert found == {"one": [5, 3], "two": [9]}
    assert all(job.dispersed for job in flyer.plainly)
    Context(flyer).fly({"one": one})
    assert not any(job.dispersed for job in flyer.plainly)


def test_a_quick_scenario_has_one_seed_and_a_model_where_one_is_asked_for() -> None:
    whole = Context(Flyer()).scenario("static")
    assert len(whole.seeds) > 1
    assert Context(Flyer(), quick=True).scenario("static").seeds == whole.seeds[:1]
    assert whole.model is None
    assert Context(Flyer(), model="point_mass").scenario("static").model == "point_mass"
    assert Context(Flyer()).figure("f") is None
    assert Context(Flyer(), figures=Path("here")).figure("f") == Path("here/f.png")


def test_a_figures_line_and_air_are_those_of_the_scenario() -> None:
    prepared = prepare(load_scenario(shipped("scenarios/static.toml")))
    placed = prepared.lines[prepared.scenario.first_line]
    line = drawn_line("a", placed)
    assert placed.crossing is not None
    assert (line.name, line.x0_m, line.z0_m) == ("a", placed.target.x_m, placed.target.z_m)
    assert line.eta_rad == placed.target.eta_rad
    assert line.crossings == [(placed.crossing.x_m, placed.crossing.z_m, True)]
    assert drawn_line("b", PlacedLine(TargetLine(0.0, 1.0, 1.5), None)).crossings == []
    air = drawn_air(prepared, 3.0, "later")
    assert air.field is prepared.field
    assert air.polar == prepared.polar
    assert (air.later_s, air.later_label) == (3.0, "later")
    assert drawn_air(prepared).later_s is None


def test_legs_are_told_apart_by_their_line() -> None:
    class Leg:
        def __init__(self, line: str) -> None:
            self.line = line

    class Flight:
        def __init__(self, *lines: str) -> None:
            self.legs = tuple(map(Leg, lines))

    flights: Any = [Flight("a", "b", "a"), Flight(), Flight("b")]
    assert [leg.line for leg in legs_named(flights, "a")] == ["a", "a"]
    assert len(legs_named(flights, "b")) == 2
