"""The whole study of the paper: its throws, the further studies, and every claim judged by them.

The further studies are computed from the paper's parameters alone and do not need each other: each
runs in a process of its own, two at a time, so that one that dies costs only itself.
"""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any

from pydantic import JsonValue
from trebucheck.api.engines import engine, engine_class, engine_names
from trebucheck.api.mechanics import InputError, Spec, TrebuchetParameters, fixed
from trebucheck.api.studies import Counter, Progress, Worker, failure

from .curves import series
from .design.efficiency import efficiencies
from .design.study import design_rolling
from .drag.study import drag_study
from .evidence.claims import BEST_L1, Claim, Proved, Study, Unreached
from .evidence.proved import Enclosures
from .evidence.quantities import ARM_ARRIVAL
from .evidence.throws import MachineThrow, throw_by_all
from .evidence.verdicts import FIXED, ROLLING, Evidence, Row, undecided
from .identification.study import identify
from .rows import fitted, machine, machines, rolling, sweep, throw
from .sweep.study import WITH_ENGINES, fulcrum_sweep

MACHINES = (FIXED, ROLLING)
"""The paper's two."""

Compute = Callable[[TrebuchetParameters, Sequence[str]], Spec]
_WARNINGS = "PYTHONWARNINGS"


def _identification(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    return identify(parameters)


def _drag(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    return drag_study(fixed(parameters))


def _sweep(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    positions = (*WITH_ENGINES, BEST_L1.value)  # every engine is to confirm a number in print
    with Worker() as worker:
        return fulcrum_sweep(parameters, engines=engines, worker=worker, with_engines=positions)


def _design(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    with Worker() as worker:
        return design_rolling(parameters, engines=engines, worker=worker)


def _machines(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    return efficiencies(engines)


# The longest first: two run at a time.
SECTIONS: dict[str, Compute] = {
    "design": _design,
    "machines": _machines,
    "sweep": _sweep,
    "identification": _identification,
    "drag": _drag,
}
"""The further studies by name, each computed from the paper's parameters and the engines' names."""


THROWS = (machine, throw, rolling)
"""Modules of the rows on the two machines and their throws."""
_UNPROVED = {
    "drag": "a flight with drag is not enclosed",
    "sweep": "the claim is of motions over a sweep, which are enclosed one by one only",
    "design": "the machine was found by a search, which proves no optimum",
    "identification": "the start was fitted",
    "machines": "the machines were found by a search, which proves no optimum",
}
"""Why claims of the further studies that are no formulas of the two throws are not proved."""
_ROWS: dict[str, tuple[str, Callable[[Any, Evidence], Iterable[Row]]]] = {
    "drag": ("Table II", fitted.drag_rows),
    "sweep": ("Sec. V, Fig. 5", sweep.rows),
    "design": ("Sec. VI", lambda design, _: machines.design_rows(design)),
    "identification": ("Sec. II", lambda identification, _: fitted.start_rows(identification)),
    "machines": ("Secs. I, VI", lambda efficiency, _: machines.efficiency_rows(efficiency)),
}
"""Section of the paper and rows of each further study."""
_INPUT = "what the machine is made of: the solvers start from it"
UNREACHED = (
    Unreached(
        where="Table I",
        printed="l1 10, l2 4, h 10, r 6 m; m_a 1000, m_b 60, m_cw 3000 kg",
        why=_INPUT,
    ),
    Unreached(where="Table I", printed="g 9.81 m/s²", why="a fact of nature, given to the solvers"),
    Unreached(
        where="Table II",
        printed="g 1.62, 3.71, 9.81, 8.87 m/s²; ρ 0, 0.02, 1.2, 65",
        why="facts of other worlds, given to the solvers; the unit of ρ, printed m/kg³, is taken "
        "as kg/m³",
    ),
    Unreached(
        where="Sec. V",
        printed="3 to 5",
        why="of a machine in another publication; the row on it says what is missing",
    ),
    Unreached(
        where="Figs. 2 to 7",
        printed="axes and curves",
        why="pictures without a table: only what text and captions say of them can be held against "
        "ours",
    ),
    Unreached(
        where="Eqs. (1), (6), (7), (11)",
        printed="λ, γ, G1, G2, R",
        why="definitions, which are followed here",
    ),
)
"""Numbers of the paper out of a solver's reach, with reasons, so that every number is counted."""

_ORDER = ("I", "Eq", "II", "III", "IV", "Fig", "Table", "V", "VI", "VII")
_LOCATION = re.compile(r"Secs?\. ([IV]+)|(Eq|Fig|Table)")


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
        parameters: of the machines; the paper's Table I if left out. Its numbers are about no
        others.
        sections: which of the further studies to make, of those in :data:`SECTIONS`; all if left
        out.
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
    others = [name for name in names if name != "reference"]
    jobs = {name: partial(SECTIONS[name], p, others) for name in _sections(sections)}
    parts = Counter(len(MACHINES) + len(jobs), progress)
    with Jobs(jobs, timeout) as running:
        throws: dict[str, MachineThrow] = {}
        for name in MACHINES:
            parts.start(f"throws: {name}")
            throws[name] = _throw(name, p, names, timeout)
        results, failures = _results(running, parts)
        parts.show("proofs")
        enclosures = Enclosures(
            {name: throw.mechanism for name, throw in throws.items()},
            {name: throw.launch_time for name, throw in throws.items()},
            {name: throw.values[ARM_ARRIVAL] for name, throw in throws.items()},
        )
    evidence = Evidence(p, throws, results, failures, enclosures)
    return Study(
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        versions=_versions(names),
        machines=tuple(throw.mechanism for throw in throws.values()),
        claims=claims(evidence),
        unreached=UNREACHED,
        series=series(evidence),
        sections=_as_data(results, failures),
        seconds=time.perf_counter() - began,
    )


def _sections(requested: Sequence[str] | None) -> list[str]:
    for name in requested or ():
        if name not in SECTIONS:
            raise InputError(f"there is no section {name!r}; there are: {', '.join(SECTIONS)}.")
    return [name for name in SECTIONS if requested is None or name in requested]


def _throw(
    name: str, parameters: TrebuchetParameters, engines: Sequence[str], timeout: float
) -> MachineThrow:
    with Worker(timeout) as worker:
        return throw_by_all(name, parameters, engines, worker)


def _results(running: Jobs, parts: Counter) -> tuple[dict[str, Spec], dict[str, str]]:
    """Results by name, and why others have none."""
    results: dict[str, Spec] = {}
    failures: dict[str, str] = {}
    parts.show(", ".join(running.names))
    for name, result, why in running.finished():
        if why is None:
            results[name] = result
        else:
            failures[name] = why
        parts.done += 1
        parts.show(", ".join(running.names))
    return results, failures


def _as_data(results: Mapping[str, Spec], failures: Mapping[str, str]) -> dict[str, JsonValue]:
    data: dict[str, JsonValue] = {name: {"failed": why} for name, why in failures.items()}
    for name, each in results.items():
        data[name] = each.model_dump(mode="json")
    return data


def claims(evidence: Evidence) -> tuple[Claim, ...]:
    """List the claims of the paper that a solver can reach, in the order of the paper."""
    all_claims = [row.claim(evidence) for group in THROWS for row in group.rows(evidence)]
    for name in _ROWS:
        all_claims += _of_section(name, evidence)
    return tuple(sorted(all_claims, key=lambda claim: order(claim.where)))


def _of_section(name: str, evidence: Evidence) -> list[Claim]:
    (where, rows), why = _ROWS[name], evidence.failures.get(name)
    if name in evidence.sections:
        try:
            return [
                _with_reason(row.claim(evidence), _UNPROVED[name])
                for row in rows(evidence.sections[name], evidence)
            ]
        except Exception as error:  # rows of other studies must not be lost with these
            why = f"{type(error).__name__}: {error}"
    if why is None:
        return []  # the study was not requested
    quantity, failed = (
        f"everything that the study '{name}' computes",
        undecided(f"its computation failed: {why}"),
    )
    return [Row(f"all of {name}", where, "", quantity, None, failed).claim(evidence)]


def _with_reason(claim: Claim, why: str) -> Claim:
    """A claim whose number has no enclosure, with the reason of its study."""
    if claim.proved.value is not None:
        return claim
    return claim.model_copy(update={"proved": Proved(why=why)})


def order(where: str) -> int:
    """Index, in the paper's order, of the first section, equation, figure or table named."""
    match = _LOCATION.match(where)
    return len(_ORDER) if match is None else _ORDER.index(match[1] or match[2])


def _versions(engines: Sequence[str]) -> dict[str, str]:
    from trebucheck import __version__

    versions = {"trebucheck": __version__, "python": platform.python_version()}
    return versions | {name: engine_class(name).version() for name in engines}


@dataclass(frozen=True)
class _Job:
    name: str
    compute: Callable[[], Any]


class Jobs:
    """Functions of modules under way, in processes of their own that end with the `with` block.

    Args:
        jobs: by name, in the order in which they start.
        timeout: longest wait for one of them [s].
        at_once: how many at a time.
    """

    def __init__(
        self, jobs: Mapping[str, Callable[[], Any]], timeout: float = 600.0, at_once: int = 2
    ) -> None:
        self._worker = Worker(timeout, jobs=at_once)
        self._threads = ThreadPoolExecutor(at_once)
        self._jobs = [_Job(name, compute) for name, compute in jobs.items()]
        self._futures: dict[Future[tuple[Any, str | None]], str] = {}
        self._quiet = _quiet_tracker()

    def __enter__(self) -> Jobs:
        self._quiet.__enter__()
        self._futures = {self._threads.submit(self._alone, job): job.name for job in self._jobs}
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._worker.close()
        self._quiet.__exit__(None, None, None)

    def _alone(self, job: _Job) -> tuple[Any, str | None]:
        """Its result, and why there is none."""
        try:
            return self._worker.compute(job.compute, job.name), None
        except Exception as error:  # whatever goes wrong in one study, the others must go on
            return None, failure(error)[1]

    @property
    def names(self) -> list[str]:
        """Names of the jobs under way."""
        return [name for future, name in self._futures.items() if future.running()]

    def finished(self) -> Iterator[tuple[str, Any, str | None]]:
        """Name, result and why there is none, of each as it comes to its end."""
        for future in as_completed(self._futures):
            yield self._futures[future], *future.result()


@contextmanager
def _quiet_tracker() -> Generator[None, None, None]:
    """Start the resource tracker early; it then removes locks of killed jobs without messages.

    loky starts it with the first pool; it outlives the jobs and can only be told through the
    environment.
    """
    before = os.environ.get(_WARNINGS)
    os.environ[_WARNINGS] = ",".join(filter(None, [before, "ignore:resource_tracker"]))
    try:
        yield
    finally:
        if before is None:
            del os.environ[_WARNINGS]
        else:
            os.environ[_WARNINGS] = before
