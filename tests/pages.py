"""A page of every command, small.

What its document shows in a browser is what a large one shows.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import trebucheck as tb
from trebucheck.comparisons.compare import Comparison
from trebucheck.comparisons.converge import converge_study
from trebucheck.comparisons.diff import diff
from trebucheck.comparisons.explain import explain_study
from trebucheck.comparisons.matrix import Matrix
from trebucheck.comparisons.problems import check
from trebucheck.comparisons.recommend import Accuracy, recommend_study
from trebucheck.comparisons.report.document import Document
from trebucheck.comparisons.report.pages import compare as compare_report
from trebucheck.comparisons.report.pages import converge as converge_report
from trebucheck.comparisons.report.pages import diff as diff_report
from trebucheck.comparisons.report.pages import explain as explain_report
from trebucheck.comparisons.report.pages import matrix as matrix_report
from trebucheck.comparisons.report.pages import problems as problems_report
from trebucheck.comparisons.report.pages import recommend as recommend_report
from trebucheck.comparisons.report.pages import throw as throw_report
from trebucheck.comparisons.report.pages.run import certificate_report
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.comparisons.runs.study import Study
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.certification.certificate import load_certificate
from trebucheck.reference.sensitivity.release import sensitivities_of
from trebucheck.reference.throw.throw import perform
from trebucheck_paper import report as paper_report
from trebucheck_paper.evidence.claims import Claim, EngineValue, Quantity, Series
from trebucheck_paper.evidence.claims import Study as Paper
from trebucheck_paper.evidence.verdicts import Row, as_printed

COMMAND = (
    "trebucheck compare --models fixed,pendulum --engines reference,pymunk --timestep 0.004 "
    "--out "
    "report"
)


@cache
def comparison() -> Comparison:
    """Two machines, an engine that agrees in one preset, and a run that could not be made."""
    found = tb.compare(["fixed", "pendulum"], ["reference", "pymunk"], timestep=4e-3, isolate=False)
    runs = list(found.results.runs)
    absent = runs[-1].model_copy(
        update={
            "engine": "exudyn",
            "outcome": Outcome.ABSENT,
            "metrics": (),
            "message": "engine 'exudyn' is not installed here: pip install exudyn",
        }
    )
    results = found.results.model_copy(update={"runs": (*runs, absent), "command": COMMAND})
    return replace(found, results=results)


def _study(model: str) -> Study:
    return Study([model], ["pymunk"], presets=["default"], until=1.0, isolate=False)


def _throw() -> Document:
    performance = perform(tb.rolling(), {}, best=True)
    sensitive, _ = sensitivities_of(performance, "rolling", tb.TrebuchetParameters())
    return throw_report.document(
        performance, performance.throw.model_copy(update={"sensitivities": sensitive})
    )


def _recommend() -> Document:
    found = recommend_study(
        Study(["pendulum"], ["pymunk"], isolate=False), Accuracy(position=1e-2), neighbours=0
    )
    return recommend_report.document(found)


def _diff() -> Document:
    """An engine's upgrade that makes its errors ten times larger."""
    old = comparison().results
    worse = [
        run.model_copy(
            update={
                "engine_version": "99.0",
                "metrics": tuple(
                    m.model_copy(update={"value": 10 * m.value}) if m.value is not None else m
                    for m in run.metrics
                ),
            }
        )
        if run.engine == "pymunk"
        else run
        for run in old.runs
    ]
    return diff_report.document(diff(old, old.model_copy(update={"runs": tuple(worse)})))


def _paper() -> Document:
    def claim(
        name: str, where: str, ours: float, unit: str, printed: str, *engines: EngineValue
    ) -> Claim:
        quantity = Quantity(value=ours, uncertainty=1e-9, unit=unit)
        return Row(name, where, printed, f"the {name}", quantity, as_printed).judged(
            quantity, engines
        )

    engines = [
        EngineValue(engine=name, value=v, tolerance=1e-3)
        for name, v in (("mujoco", 99.4), ("pymunk", 99.5))
    ]
    claims = (
        claim("launch speed", "Sec. V", 99.4, "m/s", "99.4 m/s", *engines),
        claim("lever ratio", "Secs. V, VII", 1.82, "", "2.42:1"),
    )
    x, y = (0.0, 0.5, 1.0), (1.0, 1.5, 2.0)
    line = Series(figure="Fig. 4", name="reference", x=x, y=y, x_label="t [s]", y_label="range [m]")
    return paper_report.document(
        Paper(
            made="2000-01-01T00:00:00+00:00",
            versions={"trebucheck": "0"},
            machines=(tb.fixed(),),
            claims=claims,
            series=(line,),
            sections={"drag": {"failed": "it crashed"}},
            seconds=1.0,
        )
    )


@cache
def matrix() -> Matrix:
    """The runs that the repository keeps, of all engines on all problems."""
    root = Path(__file__).parents[1]
    return tb.matrix(sorted(root.glob("*/results/*.json"))).made_by("trebucheck matrix FILES")


def _certify() -> Document:
    certificate = load_certificate(tb.fixed())
    assert certificate is not None
    return certificate_report(certificate)


DOCUMENTS = {
    "compare": lambda: compare_report.document(comparison()),
    "throw": _throw,
    "converge": lambda: converge_report.document(converge_study(_study("pendulum"), ["timestep"])),
    "explain": lambda: explain_report.document(explain_study(_study("pendulum"))),
    "recommend": _recommend,
    "diff": _diff,
    "problems": lambda: problems_report.document(check(benchmark("pendulum"))),
    "paper": _paper,
    "certify": _certify,
    "matrix": lambda: matrix_report.document(matrix()),
}
"""By command."""
