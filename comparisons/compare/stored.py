"""A comparison that was written before, read again from its folder."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from ...models.errors import InputError
from ...models.files import read_bytes
from ...models.trajectory import load
from ..runs.results import COMPARED, FORMAT, Results
from ..runs.store import Store
from ..runs.study import Until
from .study import Comparison


def stored(folder: str | Path) -> Comparison:
    """Results and motions of a comparison; the reference is solved again, no engine runs.

    Raises:
        InputError: the folder holds no comparison, or a file of it cannot be read.
    """
    results = read_results(folder)
    store = Store(Path(folder) / "trajectories")
    kept = {(run.model, run.label): store.path(run.model, run.label) for run in results.ran}
    missing = [str(path) for path in kept.values() if not path.is_file()]
    if missing:
        raise InputError(f"trajectory {missing[0]!r} is missing; make the comparison again.")
    solutions = {
        m.model: Until("time", m.compared_to).solve(m.mechanism, m.stop_law)[0]
        for m in results.machines
    }
    return Comparison(
        results, solutions, {key: load(path) for key, path in kept.items()}, repeated=True
    )


def read_results(path: str | Path) -> Results:
    """Results of a comparison.

    Args:
        path: of results.json, or of the folder that holds it.

    Raises:
        InputError: the file is not there, is of another kind or format, or is broken.
    """
    path = Path(path)
    path = path / "results.json" if path.is_dir() else path
    _refuse_others(path)
    results = Results.load(path)
    runs = Counter((run.model, run.engine, run.preset) for run in results.runs)
    twice = [name for name, number in runs.items() if number > 1]
    if twice:
        raise InputError(f"{path}: the run {', '.join(twice[0])} is there twice; once is needed.")
    known = {machine.model for machine in results.machines}
    unknown = [
        run.model for run in results.runs if run.outcome in COMPARED and run.model not in known
    ]
    if unknown:
        raise InputError(
            f"{path}: there are runs of {unknown[0]!r}, which is not among the machines."
        )
    return results


def _refuse_others(path: Path) -> None:
    """Refuse a file of another kind or format in one sentence, before each of its fields has one of its own."""
    text = read_bytes(path, Results.largest_file)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError(
            f"{path} is not JSON; the results.json of `trebucheck compare` is needed."
        ) from None
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        has = "no format" if found is None else f"format {str(found)[:60]!r}"
        raise InputError(
            f"{path} has {has}; a results.json of `trebucheck compare` has {FORMAT!r}: make it again."
        )
