"""Trajectories on disk: an interrupted comparison goes on where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...models.dataset import load, save
from ...models.errors import InputError
from ...models.problem import Problem
from ...models.trajectory import Trajectory


@dataclass(frozen=True)
class Store:
    """A folder of NetCDF files, one a run, named by model, engine and preset."""

    folder: Path
    resume: bool = False
    """Take a file again if it holds exactly the run that is asked for."""

    def path(self, model: str, label: str) -> Path:
        """Where a run is kept."""
        return self.folder / f"{model}-{label.replace(' ', '-')}.nc"

    def kept_or_made(
        self, label: str, settings: Mapping[str, object], problem: Problem, make: Callable[[], Trajectory]
    ) -> Trajectory:
        """The kept trajectory if it may be used, else a new one, which is kept.

        Raises:
            InputError: the folder cannot be written to.
        """
        path = self.path(problem.mechanism.name, label)
        kept = self._kept(path, settings, problem) if self.resume else None
        if kept is not None:
            return kept
        made = make()
        save(made, path)
        return made

    def _kept(self, path: Path, settings: Mapping[str, object], problem: Problem) -> Trajectory | None:
        if not path.is_file():
            return None
        try:
            trajectory = load(path)
        except InputError:
            return None  # a broken file is made anew
        found = trajectory.provenance
        same = (
            found.mechanism_hash == problem.mechanism.content_hash
            and dict(found.settings) == dict(settings)
            and found.duration == problem.duration
            and found.stop_law == problem.stop_law.value
        )
        return trajectory if same else None
