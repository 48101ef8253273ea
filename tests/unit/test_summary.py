"""summary.md: what a pull request is shown of a comparison, and nothing that results.json does not
say.
"""

from __future__ import annotations

import re

import pytest
import trebucheck as tb
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.report.pages.compare import summary
from trebucheck.comparisons.runs.results import (
    Diagnosis,
    Metric,
    Outcome,
    RankedCause,
    Results,
    Run,
)

pytest.importorskip("pymunk")


@pytest.fixture(scope="module")
def results() -> Results:
    """A pendulum in an engine, with the command line of somebody."""
    made = tb.compare(
        ["pendulum"],
        ["pymunk", "reference"],
        presets=["settings", "assisted"],  # the default disagrees
        until=0.5,
        isolate=False,
        diagnose=False,
    ).results
    return made.made_by("trebucheck compare --model pendulum")


def _text(results: Results) -> str:
    return markdown.text(summary(results), signs=True)


def _disagreeing(run: Run, number: int = 0) -> Run:
    """The run under another name, with one broken tolerance and a cause."""
    broken = Metric(
        name="position_max",
        subject="tip",
        value=7.7,
        unit="m",
        tolerance=1.0,
        source="need",
        reason="so",
    )
    causes = (
        RankedCause(name="another mass", kind="machine", amount="1 kg | 2 kg", explained=1.0),
    )
    fields = {
        "preset": f"p{number}",
        "outcome": Outcome.DISAGREES,
        "metrics": (broken,),
        "diagnosis": Diagnosis(leads="position_max (tip)", causes=causes, likeliest=1),
    }
    return run.model_copy(update=fields)


def test_it_begins_with_the_verdict_and_ends_with_what_can_be_opened(results: Results) -> None:
    text = _text(results)
    # Two runs of an engine; the reference against itself is counted nowhere.
    assert text.startswith("✓ Agreement holds. Runs: 2 agree;")
    assert "| pendulum | pymunk assisted | ✓ " in text and "✓ agrees" in text
    shown, opened = text.split("<details>", 1)
    assert (
        "pymunk" in shown and "reference assisted" not in shown and "reference assisted" in opened
    )
    assert "```\ntrebucheck compare --model pendulum\n```" in shown
    assert text.count("<details>") == text.count("</details>") == 2
    assert "Made by" not in _text(results.made_by(None))


def test_its_numbers_are_those_of_the_results(results: Results) -> None:
    """Each error of the table, to its two digits.

    No column of a quantity that a pendulum does not have.
    """
    row = re.search(r"^\| pendulum \| pymunk settings \|(.*)$", _text(results), re.MULTILINE)
    assert row
    cells = [cell.strip() for cell in row[1].split("|")]
    run = next(run for run in results.runs if run.label == "pymunk settings")
    largest = {
        0: max(abs(m.value or 0) for m in run.metrics if m.name == "position_max"),
        1: max(abs(m.value or 0) for m in run.metrics if m.name == "joint_reaction_relative"),
        2: max(abs(m.value or 0) for m in run.metrics if m.name == "energy_drift_kinetic"),
    }
    for column, value in largest.items():
        assert float(cells[column].removeprefix("✓ ")) == pytest.approx(value, rel=0.05)
    assert cells[3] == f"✓ agrees {len(run.judged)}/{len(run.judged)}"


def test_what_broke_comes_with_its_likeliest_cause(results: Results) -> None:
    text = _text(
        results.model_copy(update={"runs": (_disagreeing(results.runs[0]), *results.runs[1:])})
    )
    assert text.startswith("✗ Agreement does not hold.")
    line = next(line for line in text.splitlines() if line.startswith("- ✗ **"))
    assert "position_max (tip): 7.7e0 m, tolerance 1.0e0 m" in line
    assert "likeliest: another mass (1 kg | 2 kg)." in line


def test_of_many_runs_those_that_disagree_are_shown(results: Results) -> None:
    """Thirty lines and no more; the rest can be opened."""
    run = next(run for run in results.runs if run.engine == "pymunk")
    agreeing = [run.model_copy(update={"preset": f"a{i}"}) for i in range(40)]
    runs = (*agreeing, *(_disagreeing(run, i) for i in range(9)))
    shown, opened = _text(results.model_copy(update={"runs": runs})).split("<details>", 1)
    assert all(f"| pymunk p{i} |" in shown for i in range(9)) and "| pymunk a39 |" in opened
    assert len([line for line in shown.splitlines() if line]) <= 32
    assert shown.count("- ✗ **") == 6 and opened.count("another mass") == 3


def test_a_run_without_a_motion_says_why(results: Results) -> None:
    failed = results.runs[0].model_copy(
        update={
            "outcome": Outcome.FAILED,
            "metrics": (),
            "message": "it left\nthe <img src=x> numbers",
        }
    )
    text = _text(results.model_copy(update={"runs": (failed,)}))
    assert "It left the &lt;img src=x> numbers." in text and "✗ failed" in text
