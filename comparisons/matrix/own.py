"""What of its runs is each engine's own, and how many verdicts that concerns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from ...engines.supplied import Own, concerned, own, parts
from ...models.problem import StopLaw
from ..report.document import Block, Heading, Note, Text, table, words
from ..runs.results import COMPARED, Outcome
from .results import Matrix, MatrixProblem, MatrixRun

READING = (
    "Own: how much of its runs on a table's problems is the engine's. “all”; “most”: trebucheck decides when stops "
    "open and are met, finds impulses of impacts, or adds or reads forces that the engine has no element for or does "
    "not tell; “steps”: its dynamics and its integrator, but what stops, loops or springs do is trebucheck's; "
    "“dynamics”: its mass matrix, forces, energies and points, in trebucheck's steps. Agreement speaks for an engine's "
    "own parts alone."
)
_UNSTATED = "not stated"


def own_on(matrix: Matrix, label: str, problems: Sequence[MatrixProblem]) -> str:
    """The least that is an engine's in its runs on some problems; '' if it has none."""
    runs = [matrix.run(label, problem.name) for problem in problems]
    found = [_own(matrix, run) for run in runs if run is not None and run.outcome in COMPARED]
    return max(found, key=_DEGREES.index, default="")


_DEGREES = (*map(str, Own), _UNSTATED)


def _own(matrix: Matrix, run: MatrixRun) -> str:
    if run.supplied is None:
        return _UNSTATED
    has = next(problem for problem in matrix.problems if problem.name == run.problem)
    impacts = has.stop_law == StopLaw.UNILATERAL
    return own(
        run.supplied, concerned(stops=has.stops, impacts=impacts, loops=has.loops, elements=has.elements)
    )  # fmt: skip


def agreements(matrix: Matrix) -> Text:
    """How many agreements there are of each degree."""
    counts = Counter(_own(matrix, run) for run in matrix.runs if run.outcome is Outcome.AGREES)
    said = ", ".join(f"{name} in {counts[name]}" for name in _DEGREES if counts[name])
    return Text(f"Of {counts.total()} agreements the engine's own is: {said or 'none'}.")


def table_of_parts(matrix: Matrix) -> Iterator[Block]:
    """A row an engine and preset: what trebucheck supplies."""
    stated = {run.label: run.supplied for run in matrix.runs if run.supplied is not None}
    if stated:
        yield Heading("What is the engine's own", 2)
        yield Note("All but what trebucheck supplies, as each adapter says.")
        rows = [(label, parts(given) or "nothing") for label, given in sorted(stated.items())]
        yield table([words("engine", wrap=False), words("trebucheck supplies")], rows)
