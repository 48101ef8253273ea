"""Processes in which engines run, and the reference beside them: what ends there, ends nothing here."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import TIMEOUT_MAX
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from ...engines.protocol import Engine
from ...models.errors import SimulationError, TrebucheckError
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from . import forked


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Runner = TypeVar("_Runner", bound=_Named)
_Given = TypeVar("_Given")
_Result = TypeVar("_Result")
_WARM_UP = 5e-3  # [s] simulated before the run that is timed: imports and first calls are not the engine's speed
_WARM_UP_STEPS = 100  # at most
_START = 120.0  # [s] longest wait for a process to start


def simulate(runner: Engine, problem: Problem) -> Trajectory:
    """Simulate, as a function that a process can be sent."""
    return runner.simulate(problem)


def simulate_warm(runner: Engine, problem: Problem) -> Trajectory:
    """Simulate, after a short run whose time is not counted."""
    step = runner.timestep or _WARM_UP
    duration = max(step, min(_WARM_UP, _WARM_UP_STEPS * step))
    short = Problem(
        problem.mechanism, duration=min(problem.duration, duration), stop_law=problem.stop_law
    )
    with suppress(TrebucheckError):  # the run itself will say it better
        runner.simulate(short)
    return runner.simulate(problem)


def _import_this_module() -> None:
    """In a new process: what it takes to start is not the time of the first call."""


@contextmanager
def block_sigint() -> Generator[None, None, None]:
    """Processes started meanwhile, and theirs, do not get a Ctrl-C of the terminal: whoever started them ends them.

    The signal is held back here, not lost; a child inherits that. (Systems without signal masks go
    without.)
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass(frozen=True)
class _Computation:
    """What a worker computes that is not an engine's run."""

    name: str


def _computed(_: _Computation, compute: Callable[[], _Result]) -> _Result:
    return compute()


@dataclass
class Worker:
    """Processes that simulate, each started when first needed and again after a crash.

    loky, not multiprocessing: it needs no `if __name__ == "__main__"` in the caller's script.
    """

    timeout: float = 600.0
    """Longest wait for one run [s], the start of its process apart."""
    isolate: bool = True
    """False: simulate in this process, without a limit of time."""
    jobs: int = 1
    """Processes: calls from as many threads are served at once."""
    fresh: bool = False
    """Whether each call has a process of its own, that nothing was run in before."""
    _started: list[Any] = field(default_factory=list[Any], init=False)
    _idle: SimpleQueue[Any] = field(default_factory=SimpleQueue[Any], init=False)
    """One entry a process that serves no call; None for one that is not started."""
    _closed: bool = field(default=False, init=False)
    _imports: bool = field(default=True, init=False)
    """Whether a process that forks imports what calls have imported."""

    def __post_init__(self) -> None:
        self.timeout = min(
            self.timeout, TIMEOUT_MAX
        )  # infinity, too, is a wait that the system can take
        for _ in range(self.jobs):
            self._idle.put(None)

    def simulate(self, runner: Engine, problem: Problem) -> Trajectory:
        """As :func:`simulate_warm`, in a process; raises as :meth:`call` does."""
        return self.call(simulate_warm, runner, problem)

    def call(
        self, function: Callable[[_Runner, _Given], _Result], runner: _Runner, given: _Given
    ) -> _Result:
        """Call a module's function on an engine, or on whatever has a name for messages, in a process.

        Raises:
            SimulationError: the engine ended its process (a crash of its compiled code), ran out of
                memory, or did not come to an end.
        """
        try:
            return (
                self._isolated(function, runner, given) if self.isolate else function(runner, given)
            )
        except MemoryError as error:
            raise SimulationError(f"{runner.name} ran out of memory: {error}.") from None
        except SystemExit as error:
            raise SimulationError(f"{runner.name} ended its process: {error!r}.") from None

    def compute(self, compute: Callable[[], _Result], name: str = "the reference") -> _Result:
        """Call a function without arguments in a process; raises as :meth:`call` does.

        Args:
            compute: a module's function, or a partial of one.
            name: of whose work it is, for messages.

        Raises:
            SimulationError: as :meth:`call`, or its numbers became too large or too small to go on.
        """
        try:
            return self.call(_computed, _Computation(name), compute)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise SimulationError(f"{name} cannot go on: {error}.") from error

    def _isolated(
        self, function: Callable[[_Runner, _Given], _Result], runner: _Runner, given: _Given
    ) -> _Result:
        pool = self._idle.get()
        try:
            pool = pool if pool in self._started else self._start()
            if self.fresh and forked.AVAILABLE:
                return self._forked(pool, function, runner, given)
            return self._submitted(pool, function, runner, given).result(self.timeout)
        except (BrokenProcessPool, TimeoutError) as error:
            pool = self._end(pool)
            crashed = isinstance(error, BrokenProcessPool)
            why = "crashed: its process ended by itself" if crashed else self._too_long
            raise SimulationError(f"{runner.name} {why}.") from None
        finally:
            if self.fresh and not forked.AVAILABLE and pool in self._started:
                self._end(pool)
            self._idle.put(pool)
            if self._closed:
                self.close()

    def _forked(
        self, pool: Any, function: Callable[..., _Result], runner: _Named, given: object
    ) -> _Result:
        call = forked.packed(function, runner, given)
        future = self._submitted(pool, forked.call_forked, call, self.timeout, self._imports)
        answer, ended, safe = future.result(self.timeout + _START)
        if not safe:
            self._imports = False
            self._end(pool)
        if ended is None:
            raise SimulationError(f"{runner.name} {self._too_long}.")
        return cast("_Result", forked.unpacked(runner.name, answer, ended))

    def _submitted(self, pool: Any, *call: Any) -> Any:
        with block_sigint():
            return pool.submit(*call)

    @property
    def _too_long(self) -> str:
        return f"did not finish within {self.timeout:g} s and was stopped"

    def _start(self) -> Any:
        pool = ProcessPoolExecutor(max_workers=1)
        self._started.append(pool)
        with block_sigint():
            ready = pool.submit(_import_this_module)
        ready.result(_START)
        return pool

    def _end(self, pool: Any) -> None:
        self._started.remove(pool)
        pool.shutdown(wait=False, kill_workers=True)

    def close(self) -> None:
        """End the processes; of a later call at its end."""
        self._closed = True
        for pool in list(self._started):
            self._end(pool)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
