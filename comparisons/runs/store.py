"""Finished runs on disk: an interrupted study continues where it stopped."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Generic, TypeVar

import numpy
import scipy

from ...engines.protocol import Engine, EngineOptions
from ...engines.registry import engine_class
from ...models.errors import InputError
from ...models.files import write_text
from ...models.spec import Spec
from ...models.trajectory import Trajectory, load, save
from ...version import __version__

_S = TypeVar("_S", bound=Spec)
_ROOT = Path(__file__).parents[2]
_SHARED = ("models", "reference", "engines", "comparisons/runs")
"""Code that decides the numbers of every run; an engine's own folder does for its runs alone."""
_FAMILY = re.compile(rb"^\s*(?:from|import)\s+(trebucheck_\w+)", re.MULTILINE)


class _Kept(Spec, Generic[_S]):
    """A record as it is on disk."""

    conditions: str  # SHA-256 of everything that made the content, :func:`conditions`
    checksum: str  # SHA-256 of the content
    jobs: int = 1  # runs made at once when its times were taken
    content: _S


class _File(Spec):
    """Record of a trajectory beside its file."""

    sha256: str


@dataclass(frozen=True)
class Store:
    """A folder of NetCDF files, one a run, and one of JSON records.

    Nothing is read unless `resume` is set, and only what was made under exactly the same conditions
    and has not been changed since: every record carries a checksum of its content, every trajectory
    has a record with the checksum of its file. What is broken or of another origin is ignored and
    made anew.
    """

    folder: Path
    resume: bool = False  # use finished runs again
    records: Path | None = None  # folder of what was measured of the runs; None: that is not kept
    # Names of runs used again, and made now
    taken: set[str] = field(default_factory=set[str], init=False, compare=False)
    made: set[str] = field(default_factory=set[str], init=False, compare=False)
    # Number of runs made at once when a run was timed that was taken or kept, by its name
    jobs: dict[str, int] = field(default_factory=dict[str, int], init=False, compare=False)

    @property
    def tally(self) -> str | None:
        """Tell how many runs were taken and how many made; None where none could be taken."""
        if not self.resume:
            return None
        return f"Runs: {len(self.taken)} taken from the folder, {len(self.made)} made now."

    def most_jobs(self, jobs: int) -> int:
        """Most runs at once when those here were timed; `jobs` where none was taken or kept."""
        return max(self.jobs.values(), default=jobs)

    def path(self, model: str, label: str) -> Path:
        """Path at which a trajectory is kept."""
        return self.folder / f"{model}-{label.replace(' ', '-')}.nc"

    def trajectory(self, model: str, label: str, conditions: str) -> Trajectory | None:
        """A kept trajectory of these conditions; None if there is none, or it was changed."""
        path = self.path(model, label)
        # The checksum is compared before the file is opened: HDF5 may end the process over a broken
        # one.
        file = self._read(path.stem, self._beside(path), _File, conditions)
        if file is None or file.sha256 != digest(path):
            return None
        try:
            trajectory = load(path)
        except InputError:
            return None
        self.taken.add(path.stem)
        return trajectory

    def load(self, model: str, label: str) -> Trajectory:
        """A kept trajectory, whatever it was made under.

        Raises:
            InputError: there is none, or its file is broken.
        """
        return load(self.path(model, label))

    def keep(
        self, trajectory: Trajectory, model: str, label: str, conditions: str, jobs: int = 1
    ) -> None:
        """Write a trajectory that was made while so many `jobs` ran at once.

        Raises:
            InputError: the folder cannot be written to.
        """
        path = self.path(model, label)
        save(trajectory, path)
        self.jobs[path.stem] = jobs
        self._write(path.stem, self._beside(path), _File(sha256=digest(path) or ""), conditions)

    def _beside(self, path: Path) -> Path:
        """The record of a trajectory's file."""
        return (self.records or self.folder) / f"{path.name}.json"

    def record(self, name: str, kind: type[_S], conditions: str) -> _S | None:
        """A kept record, made under these conditions; None if there is none, or it was changed."""
        if self.records is None:
            return None
        return self._read(name, self.records / f"{name}.json", kind, conditions)

    def keep_record(self, name: str, record: Spec, conditions: str, jobs: int = 1) -> None:
        """Write a record whose times were taken while so many `jobs` ran at once.

        Raises:
            InputError: the folder cannot be written to.
        """
        if self.records is not None:
            # What was timed before may be timed once more
            self.jobs[name] = max(jobs, self.jobs.get(name, 1))
            self._write(name, self.records / f"{name}.json", record, conditions)

    def _read(self, name: str, path: Path, kind: type[_S], conditions: str) -> _S | None:
        if not (self.resume and path.is_file()):
            return None
        try:
            kept = _Kept[kind].load(path)
        except InputError:
            return None
        if (kept.conditions, kept.checksum) != (conditions, _checksum(kept.content)):
            return None
        self.jobs[name] = max(kept.jobs, self.jobs.get(name, 1))
        return kept.content

    def _write(self, name: str, path: Path, record: Spec, conditions: str) -> None:
        checksum, jobs = _checksum(record), self.jobs[name]
        kept = _Kept[type(record)](
            conditions=conditions, checksum=checksum, jobs=jobs, content=record
        )
        write_text(path, kept.model_dump_json())


def _checksum(record: Spec) -> str:
    return hashlib.sha256(record.model_dump_json().encode()).hexdigest()


def digest(path: Path) -> str | None:
    """SHA-256 of a file; None if there is none that can be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def conditions(*parts: object, engine: Engine | None = None, code: str | None = None) -> str:
    """SHA-256 of everything that makes a number; what was made under other conditions is not used.

    The code that a run depends on, its version, Python, NumPy, SciPy and the kind of machine always
    belong to it; an engine does with its version, its settings and the files of its package, which
    change without a new version while they are being written. So does `code`, a folder of further
    code below the package.
    """
    folders = _SHARED if code is None else (*_SHARED, code)
    made_by: list[object] = [code_digest(*folders), __version__, platform.python_version()]
    made_by += [platform.system(), platform.machine(), numpy.__version__, scipy.__version__]
    if engine is not None:
        cls = engine_class(engine.name)
        made_by += [engine.name, cls.version(), engine.settings, engine_digest(cls.__module__)]
        around = type(engine).__module__
        if around != cls.__module__:  # an engine that is read in another way, say
            file = getattr(sys.modules.get(around), "__file__", None)
            made_by.append(None if file is None else digest(Path(file)))
        # Settings of a built-in engine are all of it; a plug-in's preset may decide more than its
        # settings tell.
        made_by += [] if isinstance(engine, EngineOptions) else [engine.preset]
    text = json.dumps([*made_by, *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def code_digest(*names: str) -> str:
    """SHA-256 of sources and data below these folders of the package.

    The files that lie in `engines` itself are shared by all engines; its folders are one engine's
    each, and belong to the digest of that engine alone.
    """
    paths: list[Path] = []
    for name in names:
        below = (_ROOT / name).glob if name == "engines" else (_ROOT / name).rglob
        paths += [path for kind in ("*.py", "*.json") for path in below(kind)]
    return _digest_of(_ROOT, paths)


@cache
def engine_digest(module: str) -> str:
    """SHA-256 of the package of an engine's module, or of its single file.

    A plug-in's includes the packages named `trebucheck_...` that it imports, such as the toolkit.
    """
    package = __name__.partition(".")[0]
    name, _, inside = module.partition(".")
    if name == package:
        return code_digest(inside.rpartition(".")[0].replace(".", "/"))
    total, waiting, known = hashlib.sha256(), [name], set[str]()
    while waiting:
        name = waiting.pop()
        known.add(name)
        file = getattr(sys.modules.get(name), "__file__", None)
        if file is None:
            continue
        # The files of a package, or a single module
        folder, paths = Path(file).parent, [Path(file)]
        if paths[0].name == "__init__.py":
            paths = [path for kind in ("*.py", "*.so", "*.pyd") for path in folder.rglob(kind)]
        total.update(_digest_of(folder, paths).encode())
        sources = b"\n".join(path.read_bytes() for path in paths if path.suffix == ".py")
        named = {match.decode() for match in _FAMILY.findall(sources)}
        waiting += sorted(named - known - set(waiting))
    return total.hexdigest()


def _digest_of(root: Path, paths: Iterable[Path]) -> str:
    total = hashlib.sha256()
    for path in sorted(paths):
        total.update(str(path.relative_to(root)).encode())
        total.update(path.read_bytes())
    return total.hexdigest()
