"""Finished runs on disk: an interrupted study continues where it stopped."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import scipy

from ...models.errors import InputError
from ...models.files import write_text
from ...models.problem import Problem
from ...models.spec import Spec
from ...models.trajectory import Trajectory, load, save

_S = TypeVar("_S", bound=Spec)
_SOURCES = ("models", "reference", "engines", "comparisons")  # what decides the numbers of a run


@dataclass(frozen=True)
class Store:
    """A folder of NetCDF files, one a run, named by model, engine and preset, and one of JSON records.

    Nothing is read unless `resume` is set, and only what was made under exactly the same conditions. A file that is
    broken or of another origin is ignored and made anew.
    """

    folder: Path
    resume: bool = False
    """Use finished runs again."""
    records: Path | None = None
    """Folder of what was measured of the runs; None: that is not kept."""

    def path(self, model: str, label: str) -> Path:
        """Where a trajectory is kept."""
        return self.folder / f"{model}-{label.replace(' ', '-')}.nc"

    def trajectory(
        self, label: str, settings: Mapping[str, object], version: str, problem: Problem
    ) -> Trajectory | None:
        """A kept trajectory of the same mechanism, settings, engine version, duration and law; None if there is none.

        Args:
            label: engine and preset.
            version: of the engine.
        """
        model = problem.mechanism.name
        if not (self.resume and self.path(model, label).is_file()):
            return None
        try:
            trajectory = self.load(model, label)
        except InputError:
            return None
        origin = trajectory.provenance
        same = (
            origin.mechanism_hash == problem.mechanism.content_hash
            and dict(origin.settings) == dict(settings)
            and origin.engine_version == version
            and origin.duration == problem.duration
            and origin.stop_law == problem.stop_law.value
        )
        return trajectory if same else None

    def load(self, model: str, label: str) -> Trajectory:
        """A kept trajectory, whatever it was made under.

        Raises:
            InputError: there is none, or its file is broken.
        """
        return load(self.path(model, label))

    def keep(self, trajectory: Trajectory, model: str, label: str) -> None:
        """Write a trajectory.

        Raises:
            InputError: the folder cannot be written to.
        """
        save(trajectory, self.path(model, label))

    def record(self, name: str, kind: type[_S]) -> _S | None:
        """A kept record; None if there is none that can be read."""
        path = None if self.records is None else self.records / f"{name}.json"
        if path is None or not (self.resume and path.is_file()):
            return None
        try:
            return kind.load(path)
        except InputError:
            return None

    def keep_record(self, name: str, record: Spec) -> None:
        """Write a record.

        Raises:
            InputError: the folder cannot be written to.
        """
        if self.records is not None:
            write_text(self.records / f"{name}.json", record.model_dump_json())


def digest(path: Path) -> str | None:
    """SHA-256 of a file; None if there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


@cache
def code_digest() -> str:
    """SHA-256 of what decides a run's numbers: sources, data and SciPy. What other code measured is not used again."""
    total, root = hashlib.sha256(scipy.__version__.encode()), Path(__file__).parents[2]
    for path in sorted(path for name in _SOURCES for kind in ("*.py", "*.json") for path in (root / name).rglob(kind)):
        total.update(str(path.relative_to(root)).encode())
        total.update(path.read_bytes())
    return total.hexdigest()
