"""A run in a process of its own: an engine that takes its process down does not take the report with it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from ...engines.protocol import Engine
from ...models.errors import SimulationError, TrebucheckError
from ...models.problem import Problem
from ...models.trajectory import Trajectory


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Runner = TypeVar("_Runner", bound=_Named)
_Given = TypeVar("_Given")
_Result = TypeVar("_Result")
_WARM_UP = 5e-3  # [s] simulated before the run that is timed: imports and first calls are not the engine's speed


def simulate_warm(runner: Engine, problem: Problem) -> Trajectory:
    """Simulate, after a short run whose time is not counted."""
    step = runner.timestep or _WARM_UP
    short = Problem(problem.mechanism, duration=min(problem.duration, max(_WARM_UP, step)), stop_law=problem.stop_law)
    with suppress(TrebucheckError):  # the run itself will say it better
        runner.simulate(short)
    return runner.simulate(problem)


@contextmanager
def block_sigint() -> Generator[None, None, None]:
    """Processes started meanwhile, and theirs, do not get a Ctrl-C of the terminal: whoever started them ends them.

    The signal is held back here, not lost; a child inherits that. (Systems without signal masks go without.)
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass
class Worker:
    """One process that simulates, started when first needed and again after each crash.

    loky, not multiprocessing: it needs no `if __name__ == "__main__"` in the caller's script.
    """

    timeout: float = 600.0
    """Longest wait for one run [s]."""
    isolate: bool = True
    """False: simulate in this process, without a limit of time."""
    _pool: Any = field(default=None, init=False)

    def simulate(self, runner: Engine, problem: Problem) -> Trajectory:
        """As :func:`simulate_warm`, in that process; raises as :meth:`call` does."""
        return self.call(simulate_warm, runner, problem)

    def call(self, function: Callable[[_Runner, _Given], _Result], runner: _Runner, given: _Given) -> _Result:
        """Call a module's function on an engine, or on whatever has a name for messages, in that process.

        Raises:
            SimulationError: the engine ended its process (a crash of its compiled code, or out of memory), or did
                not come to an end.
        """
        if not self.isolate:
            return function(runner, given)
        if self._pool is None:
            self._pool = ProcessPoolExecutor(max_workers=1)
        with block_sigint():
            future = self._pool.submit(function, runner, given)
        try:
            return future.result(self.timeout)
        except TerminatedWorkerError:
            self.close()
            raise SimulationError(f"{runner.name} crashed: its process ended by itself.") from None
        except TimeoutError:
            self.close()
            raise SimulationError(f"{runner.name} did not finish within {self.timeout:g} s and was stopped.") from None

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, kill_workers=True)
            self._pool = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
