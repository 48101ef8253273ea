"""An importer on many models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..runs.study import Progress
from . import files
from .checks import check_model
from .process import ImporterProcess
from .results import ImporterResults, ModelResult

TIMESTEP = 1e-3
"""Longest step of the coarser run [s]."""


def check_importer(
    loader: str,
    *,
    python: Path,
    models: Sequence[str] = (),
    timestep: float = TIMESTEP,
    timeout: float = 60.0,
    progress: Progress | None = None,
) -> ImporterResults:
    """Check a loader of MJCF files against certified models.

    Args:
        loader: `module:function`, or `path/to/file.py:function`; see docs/importers.md for what it returns.
        python: the Python that has the importer and NumPy.
        models: names of models of the zoo or machines; all where it is empty.
        timestep: longest step of the coarser of the two runs of each motion [s].
        timeout: longest wait for an answer [s].
        progress: told what is checked.

    Raises:
        InputError: the loader cannot be imported, the Python cannot be run, or there is no such model.
    """
    chosen = [files.expected(name) for name in models or files.names()]
    results: list[ModelResult] = []
    facts: dict[str, Any] = {}
    with ImporterProcess(loader, python, timeout) as process:
        for done, expected in enumerate(chosen):
            if progress is not None:
                progress(expected.name, done, len(chosen))
            result, told = check_model(process, expected, timestep)
            results.append(result)
            facts |= told
    return ImporterResults.made_here(
        loader=loader, timestep=timestep, models=tuple(results), integrator=str(facts.get("integrator", "not stated")),
        precision=facts.get("precision", "float64"),
        versions={str(k): str(v) for k, v in dict(facts.get("versions", {})).items()},
    )  # fmt: skip
