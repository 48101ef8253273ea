"""An importer on many models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import JsonValue
from trebucheck.api.mechanics import InputError, Spec
from trebucheck.api.studies import Progress, Store, conditions, digest

from . import files
from .checks import check_model
from .expected import Expected
from .process import ImporterProcess
from .results import ImporterResults, ModelResult

TIMESTEP = 1e-3
"""Longest step of the coarser run [s]."""
_TOLD = ("integrator", "precision", "versions")


def check_importer(
    loader: str,
    *,
    python: Path,
    models: Sequence[str] = (),
    timestep: float = TIMESTEP,
    timeout: float = 60.0,
    progress: Progress | None = None,
    store: Store | None = None,
) -> ImporterResults:
    """Check a loader of MJCF files against certified models.

    Args:
        loader: `module:function`, or `path/to/file.py:function`; see docs/importers.md for what it
        returns.
        python: the Python that has the importer and NumPy.
        models: names of models of the zoo or machines, and paths of files; all of the zoo and the
            machines where it is empty.
        timestep: longest step of the coarser of the two runs of each motion [s].
        timeout: longest wait for an answer [s].
        progress: told what is checked.
        store: where models that are finished are kept, and taken from; None: nowhere. What was made
            with another file of the loader, step or version of this package is made again; a change
            of the importer's own package is not seen.

    Raises:
        InputError: the loader cannot be imported, the Python cannot be run, there is no such model,
            or the step is none.
    """
    if not (math.isfinite(timestep) and timestep > 0):
        raise InputError(f"timestep = {timestep!r} s must be a finite number greater than zero.")
    chosen = [files.expected(name) for name in models or files.names()]
    kept: list[_Kept] = []
    with ImporterProcess(loader, python, timeout) as process:
        checked = _Checked(process, timestep, store or Store(Path()))
        for done, expected in enumerate(chosen):
            if progress is not None:
                progress(expected.name, done, len(chosen))
            kept.append(checked.of(expected))
    facts: dict[str, Any] = {}
    for each in kept:
        facts |= each.facts
    return ImporterResults.made_here(
        loader=loader,
        timestep=timestep,
        models=tuple(each.result for each in kept),
        integrator=str(facts.get("integrator", "not stated")),
        precision=facts.get("precision", "float64"),
        versions={str(k): str(v) for k, v in dict(facts.get("versions", {})).items()},
    )


class _Kept(Spec):
    """Stored results of a model."""

    result: ModelResult
    facts: Mapping[str, JsonValue]
    """Facts that the importer states of itself."""


@dataclass(frozen=True)
class _Checked:
    """Models, taken from a store or checked now."""

    process: ImporterProcess
    timestep: float
    store: Store

    def of(self, expected: Expected) -> _Kept:
        """A model."""
        made_under = self._conditions(expected)
        record = Path(expected.name).stem
        kept = self.store.record(record, _Kept, made_under)
        if kept is not None:
            self.store.taken.add(record)
            return kept
        result, facts = check_model(self.process, expected, self.timestep)
        kept = _Kept(result=result, facts={name: facts[name] for name in _TOLD if name in facts})
        self.store.made.add(record)
        self.store.keep_record(record, kept, made_under)
        return kept

    def _conditions(self, expected: Expected) -> str:
        name = self.process.loader.rpartition(":")[0]
        data = expected.whole.positions.tobytes().hex()
        process = (
            self.process.loader,
            digest(Path(name)),
            str(self.process.python),
            self.process.timeout,
        )
        return conditions("importer", *process, self.timestep, expected.xml, data)
