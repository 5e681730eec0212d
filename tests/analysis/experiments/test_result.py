"""A result and its verdict, as JSON, as Markdown and on its page, apart from any flight."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments import catalogue
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.pages import DISPERSED_WORDS, counted, page, pages, with_result
from tgl_soar.analysis.experiments.result import (
    DISPERSED_AIRCRAFT,
    POINT_MASS,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    all_of,
    as_json,
    as_markdown,
    decided,
    plain,
)

YES, NO = Claim("it does", True, "1 cm"), Claim("it does not", False, "2 cm")


def result(*claims: Claim) -> Result:
    table = Table("one", ("a", "b [m]"), (("x", "1"),))
    return Result(
        name="name",
        title="title",
        flown="flown.",
        claims=claims,
        why="because.",
        tables=(table,),
        numbers={"n": 1.0},
        figures=("f.png",),
    )


@pytest.mark.parametrize(
    ("claims", "verdict"),
    [((YES, YES), "agrees"), ((YES, NO), "agrees in part"), ((NO, NO), "differs")],
)
def test_the_verdict_follows_from_the_claims(claims: tuple[Claim, ...], verdict: str) -> None:
    assert result(*claims).verdict == verdict


def test_flights_that_ended_badly_are_folded_model_by_model() -> None:
    """The empty lines are what GitHub and Sphinx read a list within HTML by."""
    far = replace(result(YES), badly=("landing 1: far",))
    many = replace(result(NO), badly=("landing 2: far", "lull 3: hard"))
    both = replace(far, also={DISPERSED_AIRCRAFT: many})
    lines = as_markdown(both, "images").splitlines()
    ends = lines.index("</details>") + 1
    assert lines[ends - 6 : ends] == [
        "<details>",
        "<summary>Rigid body: 1 flight that did not end well</summary>",
        "",
        "- landing 1: far",
        "",
        "</details>",
    ]
    assert lines[ends:] == [
        "",
        "<details>",
        "<summary>Rigid body, dispersed: 2 flights that did not end well</summary>",
        "",
        "- landing 2: far",
        "- lull 3: hard",
        "",
        "</details>",
    ]
    assert lines[ends - 7] == ""
    assert "<details>" not in as_markdown(result(YES), "images")
    assert as_json(both)["also"][DISPERSED_AIRCRAFT]["badly"] == ["landing 2: far", "lull 3: hard"]


def test_a_result_tells_everything_in_json_and_markdown() -> None:
    reported = as_json(result(YES, NO))
    assert json.loads(json.dumps(reported)) == reported
    assert reported["versions"]["tgl_soar"]
    text = as_markdown(result(YES, NO), "images")
    for words in (
        "| a | b [m] |",
        "| x | 1 |",
        "images/f.png",
        "agrees in part",
        "✓",
        "✗",
        "because",
    ):
        assert words in text
    whole = page([result(YES, NO)], {})
    assert as_markdown(result(YES, NO), "images/experiments") in whole
    assert "| [`name`](#name) | title | agrees in part: 1 of 2 |" in whole
    assert "| `speed` | agrees in part: 1 of 2 | differs: 0 of 1 |" in page(
        [replace(result(NO), name="speed"), result(YES)], {}
    )
    assert "| once | today |" not in whole


def test_what_is_true_by_construction_is_marked_and_decides_nothing() -> None:
    given = Claim("an identity", True, "0", by_construction=True)
    assert result(NO, given).verdict == "differs"
    assert result(YES, given).verdict == "agrees"
    assert result(given).verdict == "by construction"
    assert counted(result(YES, NO, given)) == "agrees in part: 1 of 2, and 1 by construction"
    assert "- ✓ an identity (true by construction): 0." in as_markdown(result(given), "images")


def test_what_is_undecided_does_not_hold_and_is_marked() -> None:
    left_open = Claim("it may", False, "1 ± 2 cm", undecided=True)
    assert result(YES, left_open).verdict == "agrees in part"
    assert result(left_open).verdict == "undecided"
    assert result(NO, left_open).verdict == "differs"
    assert counted(result(YES, left_open)) == "agrees in part: 1 of 2, 1 undecided"
    assert "- ? undecided: it may: 1 ± 2 cm." in as_markdown(result(left_open), "images")
    with pytest.raises(ValueError, match="undecided does not hold"):
        Claim("it may", True, "", undecided=True)
    pair = replace(
        result(YES), also={DISPERSED_AIRCRAFT: result(replace(left_open, text=YES.text))}
    )
    assert "**Dispersion changes:** “it does” (✓ → ?)." in as_markdown(pair, "").splitlines()
    assert decided("x", None, "").undecided
    assert all_of([True, None]) is None
    assert all_of([None, False]) is False
    assert all_of([]) is False


@pytest.mark.parametrize(
    ("claims", "verdict"), [((YES,), "met"), ((YES, NO), "met in part"), ((NO,), "missed")]
)
def test_our_own_aims_stand_on_a_page_of_their_own(claims: tuple[Claim, ...], verdict: str) -> None:
    ours = replace(result(*claims), name="ours", own=True)
    assert ours.verdict == verdict
    written = pages([result(YES), ours], lambda _: {})
    assert list(written) == ["experiments.md", "aims.md"]
    assert "`name`" in written["experiments.md"]
    assert "`ours`" not in written["experiments.md"]
    assert "`ours`" in written["aims.md"]
    assert "`name`" not in written["aims.md"]


def on_both(point: Result) -> Result:
    return replace(result(YES, NO), why="", also={POINT_MASS: point})


def test_both_models_stand_beside_each_other_in_every_table() -> None:
    point = replace(result(YES, YES), tables=(Table("one", ("a", "b [m]"), (("x", "7"),)),))
    text = as_markdown(on_both(point), "images")
    for row in (
        "| model | a | b [m] |",
        "| rigid body | x | 1 |",
        "| point mass | x | 7 |",
        "| claim | rigid body | point mass |",
        "| it does | ✓ 1 cm | ✓ 1 cm |",
        "| it does not | ✗ 2 cm | – |",
        "**Verdict: rigid body agrees in part, point mass agrees.**",
        "*Point mass*: because.",
    ):
        assert row in text.splitlines()
    assert "Rigid body*" not in text  # which has nothing to say beside its claims
    whole = page([on_both(point), replace(result(YES), name="alone")], {})
    assert "| [`name`](#name) | title | agrees in part: 1 of 2 | agrees: 2 of 2 |" in whole
    assert "| [`alone`](#alone) | title | agrees: 1 of 1 | – |" in whole
    assert as_json(on_both(point))["also"]["point mass"]["verdict"] == "agrees"


def test_a_table_with_measurements_in_its_head_stands_by_itself() -> None:
    other = replace(result(YES), tables=(Table("two", ("a", "b [m]"), (("x", "7"),)),))
    text = as_markdown(on_both(other), "images").splitlines()
    heads = [line for line in text if line.startswith(("**Rigid", "**Point", "| a |", "| x |"))]
    assert heads == [
        *("**Rigid body: one**", "| a | b [m] |", "| x | 1 |"),
        *("**Point mass: two**", "| a | b [m] |", "| x | 7 |"),
    ]


def test_a_section_with_dispersed_aircraft_says_what_they_are() -> None:
    begin = "<!-- name: begin; written by `tgl-soar experiment name --docs docs` -->"
    marks = f"{begin}<!-- name: end -->"
    alone, both = result(YES), replace(result(YES), also={DISPERSED_AIRCRAFT: result(YES)})
    assert DISPERSED_WORDS not in with_result(marks, alone, "name", {})
    assert DISPERSED_WORDS in with_result(marks, both, "name", {})


def test_what_both_models_say_alike_is_reported_once() -> None:
    text = as_markdown(replace(result(YES), also={POINT_MASS: result(YES)}), "images")
    assert text.count("because.") == 1
    assert "Point mass*" not in text


def test_what_dispersion_changes_is_reported_in_words() -> None:
    otherwise = replace(YES, holds=False, measured="9 cm")
    text = as_markdown(
        replace(result(YES, NO), also={DISPERSED_AIRCRAFT: result(otherwise, NO)}), ""
    )
    assert "**Dispersion changes:** “it does” (✓ → ✗)." in text.splitlines()
    assert "| it does | ✓ 1 cm | ✗ 9 cm |" in text.splitlines()
    assert "Not asked" not in text
    text = as_markdown(replace(result(NO), also={DISPERSED_AIRCRAFT: result(YES, NO)}), "")
    assert "Dispersion changes none of these." in text.splitlines()
    text = as_markdown(replace(result(YES), also={DISPERSED_AIRCRAFT: result(YES, NO)}), "")
    asked = f"**Dispersion changes:** “{NO.text}”, asked of dispersed flights alone (✗)."
    assert asked in text.splitlines()
    text = as_markdown(replace(result(YES, NO), also={DISPERSED_AIRCRAFT: result(NO)}), "")
    assert "Dispersion changes none of these." in text.splitlines()
    assert "**Not asked of dispersed flights:** “it does” (✓)." in text.splitlines()
    assert "ispersion changes" not in as_markdown(on_both(result(NO)), "")


def test_an_experiment_is_flown_by_all_that_can_fly_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str | None, bool, bool]] = []

    def run(name: str, context: Context) -> Result:
        asked.append((name, context.model, context.dispersion, context.figures is not None))
        return result(YES)

    monkeypatch.setattr(catalogue, "run", run)
    context = Context(flyer=Flyer(), figures=Path())
    assert list(catalogue.run_whole("static", context).also) == [POINT_MASS, DISPERSED_AIRCRAFT]
    assert list(catalogue.run_whole("incidence", context).also) == [DISPERSED_AIRCRAFT]
    assert list(catalogue.run_whole("field", context).also) == []
    assert asked == [
        ("static", "rigid_body", False, True),
        ("static", "point_mass", False, False),
        ("static", "rigid_body", True, False),
        ("incidence", "rigid_body", False, True),
        ("incidence", "rigid_body", True, False),
        ("field", "rigid_body", False, True),
    ]


def test_tables_that_are_not_the_same_are_not_put_together() -> None:
    with pytest.raises(ValueError, match="zip"):
        as_markdown(on_both(replace(result(YES), tables=())), "images")


def test_a_changed_threshold_is_listed_with_its_reason() -> None:
    assert "was" not in page([result(YES)], {}).split("\n\n")[-2]
    changed = ChangedThreshold("it moves", "15 cm", "5 cm", "as far as it strays")
    reported = page([replace(result(YES), changed=(changed,))], {})
    assert "| `name` | it moves | 15 cm | 5 cm | as far as it strays |" in reported


def test_json_has_no_numbers_that_are_none() -> None:
    assert plain({"a": float("nan"), "b": (float("inf"), 1.0)}) == {"a": None, "b": [None, 1.0]}
