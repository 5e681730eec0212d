"""What prose says of a table is what the table says: where flights change, words must too."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scipy.stats import chi2

DOCS = Path(__file__).parents[2] / "docs"


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def words(name: str) -> str:
    return " ".join(page(name).split())


def rows(text: str, begins: str) -> list[list[str]]:
    """The cells of every row whose first begin so."""
    found = [line.strip().strip("|").split("|") for line in text.splitlines()]
    cells = [[cell.strip() for cell in row] for row in found if len(row) > 1]
    return [row for row in cells if row[0].startswith(begins)]


def test_the_dispersed_campaign_is_the_one_of_its_table() -> None:
    _, dispersed = rows(page("safety.md"), "**all**")
    flights, _, flying, _, lost = (int(cell.strip("*")) for cell in dispersed[1:6])
    quoted = re.search(
        r"Of ([\d,]+) such flights .*?(none|one|\d+) was lost", page("safety.md"), re.S
    )
    assert quoted
    assert (int(quoted[1].replace(",", "")), flying) == (flights, 0)
    assert {"none": 0, "one": 1}.get(quoted[2], quoted[2]) == lost
    # Of which so many flights would show no more in one of twenty, by Poisson's distribution.
    most = 100 * float(chi2.ppf(0.95, 2 * (lost + 1))) / 2.0 / flights
    assert f"{most:.2f} % of such flights are lost (95 %, one-sided)" in words("safety.md")


def test_brakes_that_are_not_given_up_are_counted_as_in_the_table() -> None:
    shipped = [row[1:] for row in rows(page("point.md"), "rigid body") if row[0] == "rigid body"]
    stuck, half = (
        {
            row[0].split(", ")[1]: (int(row[5]), int(row[1]))
            for row in shipped
            if row[0].startswith(f"brake.{kind}, ")
        }
        for kind in ("stuck", "one_side")
    )

    def counted(counts: list[tuple[int, int]]) -> str:
        return " of ".join(str(sum(each)) for each in zip(*counts, strict=True))

    text = words("point.md")
    assert f"{counted([*stuck.values()])} brakes that had jammed as a whole were given up" in text
    assert (
        f"{counted([stuck['tunnel']])} in the tunnel and {counted([stuck['hill']])} on the hill"
        in text
    )
    assert f"and {counted([*half.values()])} of which one half had jammed" in text
    lasted = [row[2] for row in shipped if row[0] in ("tunnel", "hill")]
    dispersed = [re.fullmatch(r"(\d+) of (\d+)", cell) for cell in lasted]
    lost = sum(int(found[2]) - int(found[1]) for found in dispersed if found)
    assert lost == 0
    assert "None of those 1,200 flights" in text
    held = [int(row[4]) for row in shipped if row[0] == "hill" and " of " in row[2]]
    assert f"it is held for {min(held)} to {max(held)} % of the time" in text


def test_landings_that_were_too_hard_are_those_of_the_table() -> None:
    section, text = page("outdoors.md"), words("outdoors.md")
    table = section.partition("**Landings")[2].partition("![")[0]
    commanded = [
        row
        for row in rows(table, "rigid body")
        if row[1].startswith(("by command", "with accelerometers"))
    ]

    def counts(model: str) -> tuple[int, int]:
        """As they should, and all."""
        found = [re.match(r"(\d+) of (\d+) \(", row[2]) for row in commanded if row[0] == model]
        pairs = [(int(each[1]), int(each[2])) for each in found if each]
        return sum(a for a, _ in pairs), sum(b for _, b in pairs)

    def hard(model: str) -> list[tuple[str, float]]:
        """Sensors and sink [m/s] of break-offs by command that met the ground too hard."""
        folded = section.partition(f"<summary>{model}:")[2].partition("</details>")[0]
        found = re.findall(r"- landing( with accelerometers)? \d+ .*, sink ([\d.]+) m/s", folded)
        return [(kind, float(sink)) for kind, sink in found if float(sink) >= 1.5]

    well, count = counts("rigid body")
    assert well == count
    assert hard("Rigid body") == []
    assert f"all {count} that broke off by command touched down as they should" in text
    well, count = counts("rigid body, dispersed")
    stalled = hard("Rigid body, dispersed")
    plain = sum(not kind for kind, _ in stalled)
    fraction = round(100 * well / count)
    assert f"Of {count} dispersed break-offs by command" in text
    assert (
        f"{well} ({fraction} %) touched down as they should, {len(stalled)} met the ground" in text
    )
    assert f"at 1.5 to {max(sink for _, sink in stalled):.1f} m/s of sink, {plain} of these" in text
    assert f"and {count - well - len(stalled)} came down softly" in text


@pytest.mark.parametrize("gains", ["gains for each lean", "one set of gains"])
def test_the_decision_on_leans_has_the_figures_that_were_measured(gains: str) -> None:
    decision = page("decisions/leaning-line.md")
    (leans,) = rows(decision, "lean")
    (stated,) = rows(decision, gains)
    table = page("experiments.md").partition(f"**{gains}, without accelerometers**")[2]
    table = table.partition("\n**")[0]
    (head,) = rows(table, "model")
    column = head.index("rms e_rho [cm]")
    measured = {
        float(row[1]): row[column] for row in rows(table, "rigid body") if row[0] == "rigid body"
    }
    for lean, value in zip(leans[1:], stated[1:], strict=True):
        degrees = 0.0 if lean == "upright" else float(lean.strip("°").replace("−", "-"))
        assert value == measured[degrees], lean
