"""The whole study of the paper: its throws, the further studies, and every claim judged by them."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Any

from pydantic import JsonValue

from ..comparisons.runs.worker import Worker
from ..engines.registry import engine, engine_class, engine_names
from ..models.errors import InputError
from ..models.machines.parameters import TrebuchetParameters
from .apart import Jobs, begun
from .claims import UNREACHED, claims
from .curves import series
from .evidence import Evidence
from .results import Study
from .sections import SECTIONS
from .throws import throw_by_all

MACHINES = ("fixed", "rolling")
"""The paper's two."""

Progress = Callable[[str, int, int], None]
"""Called with what is under way, the number of parts done and of all."""


def study(
    engines: Sequence[str] | None = None,
    parameters: TrebuchetParameters | None = None,
    *,
    sections: Sequence[str] | None = None,
    timeout: float = 600.0,
    progress: Progress | None = None,
) -> Study:
    """Judge every claim of the paper that a solver can reach.

    Args:
        engines: names; all known ones if left out. Those absent or failing become notes.
        parameters: of the machines; the paper's Table I if left out. Its numbers are about no others.
        sections: which of the further studies to make, of those in :data:`.sections.SECTIONS`; all if left out.
        timeout: longest wait for one run of an engine, and for one of the further studies [s].
        progress: called before and after each part.

    Raises:
        InputError: a name is unknown, or a machine does not launch.
        SimulationError: the reference cannot integrate a machine.
    """
    began, p = time.perf_counter(), parameters or TrebuchetParameters()
    names = tuple(dict.fromkeys(engine_names() if engines is None else engines))
    for name in names:
        engine(name)  # a wrong name costs no waiting
    wanted = _sections(sections)
    jobs = {name: partial(SECTIONS[name], p, names) for name in wanted}
    parts = _Parts(len(MACHINES) + len(jobs), progress)
    with begun(jobs, timeout=timeout) as running:
        throws = {name: parts.made(f"throws: {name}", partial(_throw, name, p, names, timeout)) for name in MACHINES}
        found, failures = _gathered(running, parts)
    evidence = Evidence(p, throws, found, failures)
    return Study(
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        versions=_versions(names),
        machines=tuple(throw.mechanism for throw in throws.values()),
        claims=claims(evidence),
        unreached=UNREACHED,
        series=series(evidence),
        sections=_as_data(found, failures),
        seconds=time.perf_counter() - began,
    )


def _sections(asked: Sequence[str] | None) -> list[str]:
    for name in asked or ():
        if name not in SECTIONS:
            raise InputError(f"there is no section {name!r}; there are: {', '.join(SECTIONS)}.")
    return [name for name in SECTIONS if asked is None or name in asked]


def _throw(name: str, parameters: TrebuchetParameters, engines: Sequence[str], timeout: float) -> Any:
    with Worker(timeout) as worker:
        return throw_by_all(name, parameters, engines, worker)


class _Parts:
    """Counts what is done, for whoever watches."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._total, self._progress, self._done = total, progress, 0

    def show(self, what: str) -> None:
        """Say what is under way."""
        if self._progress:
            self._progress(what, self._done, self._total)

    def finish(self, what: str) -> None:
        """Count one more, and say what is under way now."""
        self._done += 1
        self.show(what)

    def made(self, what: str, make: Callable[[], Any]) -> Any:
        """Make a part, shown before and counted after."""
        self.show(what)
        found = make()
        self._done += 1
        return found


def _gathered(running: Jobs, parts: _Parts) -> tuple[dict[str, Any], dict[str, str]]:
    """Results by name, and why others have none."""
    found: dict[str, Any] = {}
    failures: dict[str, str] = {}
    parts.show(", ".join(running.running))
    for name, result, why in running.finished():
        if why is None:
            found[name] = result
        else:
            failures[name] = why
        parts.finish(", ".join(running.running))
    return found, failures


def _as_data(found: dict[str, Any], failures: dict[str, str]) -> dict[str, JsonValue]:
    data: dict[str, JsonValue] = {name: {"failed": why} for name, why in failures.items()}
    for name, each in found.items():
        data[name] = each.model_dump(mode="json")
    return data


def _versions(engines: Sequence[str]) -> dict[str, str]:
    from ..version import __version__

    found = {"trebucheck": __version__, "python": platform.python_version()}
    return found | {name: engine_class(name).version() for name in engines}
