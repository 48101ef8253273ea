"""What tests need, but do not test, is made once: motions of the reference, and idle processes.

A test that asks for a motion again, or by another path, gets the one that is known. Tests of the
reference itself (`tests/verification`), and those with the mark `own_motions` or `own_processes`,
get none of another test. Where a test has replaced a function that is asked here, nothing is kept.
"""

from __future__ import annotations

import os
import sys
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import pytest
from trebucheck.comparisons.runs import runner, stretching
from trebucheck.comparisons.runs.process import Worker
from trebucheck.engines.registry import ANNOUNCED
from trebucheck.reference import solver
from trebucheck.reference.equations import Equations

_LARGEST = 200
"""Results of each kind that are kept: a solution takes some 0.1 to 10 MB."""


class Kept:
    """Results by their arguments, those asked for last."""

    def __init__(self) -> None:
        self.on = True
        self._results: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The result that is known, or a new one."""
        if not self.on:
            return make()
        if key not in self._results:
            self._results[key] = make()
        self._results.move_to_end(key)
        while len(self._results) > _LARGEST:
            self._results.popitem(last=False)
        return self._results[key]


MOTIONS, STRETCHINGS, UNCERTAINTIES = Kept(), Kept(), Kept()
_run, _stretching, _uncertainties = (
    solver._integrate,
    stretching.stretching_until,
    runner.reference_uncertainties,
)
# A test that replaces one of them wants it to be called.
_ASKED = {
    (module, name): getattr(module, name)
    for module, name in (
        (solver, "integrate_segment"),
        (solver, "ActiveSet"),
        (stretching, "solve"),
        (runner, "solve"),
        (runner, "measure"),
    )
}


def _as_ever() -> bool:
    return all(getattr(module, name) is value for (module, name), value in _ASKED.items())


@wraps(_run)
def _shared_run(problem: Any, equations: Any, *limits: float) -> Any:
    if type(equations) is not Equations or not _as_ever():
        return _run(problem, equations, *limits)
    return MOTIONS.get((problem, *limits), lambda: _run(problem, equations, *limits))


# The arguments are part of a result, so that no other object gets their identities.
@wraps(_stretching)
def _shared_stretching(solution: Any, end: float, scales: Any) -> Any:
    if not _as_ever():
        return _stretching(solution, end, scales)
    key = id(solution), end, scales.model_dump_json()
    return STRETCHINGS.get(key, lambda: (_stretching(solution, end, scales), solution))[0]


@wraps(_uncertainties)
def _shared_uncertainties(*arguments: Any) -> Any:
    if not _as_ever() or len(arguments) != 6:
        return _uncertainties(*arguments)
    solution, end, scales, thrown, invariants_to, growth = arguments
    key = id(solution), end, scales.model_dump_json(), thrown, invariants_to, id(growth)
    return UNCERTAINTIES.get(key, lambda: (_uncertainties(*arguments), solution, growth))[0]


def share_motions() -> None:
    """From now on; :func:`switch_motions` says for which tests."""
    solver._integrate = _shared_run
    stretching.stretching_until = runner.stretching_until = _shared_stretching
    runner.reference_uncertainties = _shared_uncertainties


def switch_motions(on: bool) -> None:
    """Whether motions of other tests are taken."""
    for kept in (MOTIONS, STRETCHINGS, UNCERTAINTIES):
        kept.on = on


# --- processes

_MOST_IDLE = 3
Idle = list[tuple[Hashable, Any]]
"""Processes, and what they were started with."""


def _works(process: Any) -> bool:
    """Whether a process neither crashed nor is being ended."""
    return process._flags.broken is None and not process._flags.shutdown


def _has_ended(process: Any) -> bool:
    """Whether a process has come to the end of its calls, of which it is told a little later."""
    for _ in range(20):
        if not _works(process):
            return False
        if not process._pending_work_items and not process._running_work_items:
            return True
        time.sleep(5e-3)
    return False


@contextmanager
def shared_processes(idle: Idle) -> Iterator[None]:
    """Processes of a worker go on to the next one.

    To start one takes longer than most tests. It finds the plug-ins of the path and the
    environment that it was started with: with another one a new process is needed.
    """
    start, close = Worker._start, Worker.close

    def started_with(worker: Worker) -> Hashable:
        return worker.fresh, tuple(sys.path), os.environ.get(ANNOUNCED)

    def taken(worker: Worker) -> Any:
        key = started_with(worker)
        for place, (with_, process) in enumerate(idle):
            if with_ == key and _works(process):
                del idle[place]
                worker._started.append(process)
                return process
        return start(worker)

    def given_back(worker: Worker) -> None:
        key = started_with(worker)
        for process in [process for process in worker._started if _has_ended(process)]:
            worker._started.remove(process)
            idle.append((key, process))
        close(worker)
        while len(idle) > _MOST_IDLE:
            idle.pop(0)[1].shutdown(wait=True, kill_workers=True)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Worker, "_start", taken)
        patch.setattr(Worker, "close", given_back)
        yield
