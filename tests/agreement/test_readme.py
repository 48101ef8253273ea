"""The README's table is what the code finds today."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.comparisons.compare.report import quantities
from trebucheck.models.machines.registry import models
from trebucheck.paper.report import summary
from trebucheck.paper.study import study
from trebucheck.reference.certification.certificate import load_certificate

README = Path(__file__).parents[2] / "README.md"
# Two printed digits, and figures near rounding (MuJoCo's, Exudyn's torques) move with the build of the engine.
FACTOR, ROUNDING = 1.3, 3.0


def _rows() -> Iterator[tuple[str, list[str]]]:
    model = ""
    for line in README.read_text().splitlines():
        if line.startswith("**") and line.endswith(" machine**"):
            model = line.strip("*").split()[0].lower()
        elif line.startswith("<!-- end"):
            model = ""
        elif model and line.startswith("| ") and not line.startswith("| engine"):
            yield model, [cell.strip() for cell in line.strip("|").split("|")]


def test_table(engine_name: str) -> None:
    if engine_name == "reference":
        assert not [row for _, row in _rows() if row[0].startswith("reference")]
        return
    results = tb.compare(models(), engines=[engine_name], isolate=False).results
    rows = [(model, row) for model, row in _rows() if row[0].split()[0] == engine_name]
    shown = [run for run in results.runs if run.model in ("fixed", "rolling") or run.preset == "tuned"]
    assert [(model, row[0]) for model, row in rows] == [(run.model, run.label) for run in shown]
    for model, row in rows:
        machine = next(machine for machine in results.machines if machine.model == model)
        run = next(run for run in results.runs if (run.model, run.label) == (model, row[0]))
        for column, printed in zip(quantities(machine), row[2:], strict=True):
            found = column.value(run)
            if not printed:
                assert found is None  # a machine without stops has no torque
                continue
            assert found is not None
            factor = ROUNDING if found < 1e-7 or column.unit == "N m" else FACTOR
            assert float(printed.split()[0]) == pytest.approx(found, rel=factor - 1), (model, row[0], column.title)


def test_the_certified_launch_time() -> None:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    figure = certificate.figure("launch_time")
    assert figure is not None
    text = " ".join(README.read_text().split())
    assert f"{figure.texts[0]} s, known to {figure.uncertainty:.0e} s" in text


def _cells(markdown: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.strip().splitlines()]


@pytest.mark.slow
def test_what_becomes_of_the_paper() -> None:
    """Verdicts and our own values are the reference's: no engine is needed to have them."""
    block = README.read_text().partition("<!-- generated: paper -->\n")[2].partition("<!-- end -->")[0]
    found, printed = _cells(summary(study(["reference"]))), _cells(block)
    assert [row[:3] for row in found] == [row[:3] for row in printed]
    for mine, theirs in zip(found, printed, strict=True):
        if mine[-1] != theirs[-1]:  # four printed digits, the last of which another machine may round otherwise
            assert float(mine[-1].split()[0]) == pytest.approx(float(theirs[-1].split()[0]), rel=2e-3), mine
