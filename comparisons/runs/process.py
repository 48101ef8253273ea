"""Processes in which engines and the reference run: a crash or a hang there ends nothing here.

A call may have a process of its own (`Worker.fresh`), forked from one that has imported what calls
need and has never made any. What such a call does to its process, or to itself, ends with it: a
crash, a hang, a patched library, another working directory, the state of a generator of random
numbers. The process that forks does no more than import what the calls before have imported, so
that a call costs a fork and not the start of an interpreter.

Forks are for Linux only: elsewhere libraries do not survive one, and each such call has a process
that is started for it.
"""

from __future__ import annotations

import gc
import math
import os
import pickle
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent import futures
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib import import_module
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor, process_executor
from joblib.externals.loky.backend.reduction import dumps
from joblib.externals.loky.process_executor import BrokenProcessPool

from ...engines.child_process import end_with_parent
from ...engines.protocol import Engine
from ...models.errors import EngineNotInstalledError, SimulationError, TrebucheckError
from ...models.problem import Problem
from ...models.trajectory import Trajectory


class _Named(Protocol):
    @property
    def name(self) -> str: ...


_Runner = TypeVar("_Runner", bound=_Named)
_Given = TypeVar("_Given")
_Result = TypeVar("_Result")
_K = TypeVar("_K")
_V = TypeVar("_V")
_WARM_UP = 5e-3  # [s] simulated before the timed run: imports and first calls are not counted
_WARM_UP_STEPS = 100  # at most
# A process that is ended while it has processes of its own leaves semaphores behind. loky's tracker
# removes them, and warns of them: it is told not to, by the options that it inherits.
sys.warnoptions.append("ignore:resource_tracker")
_START = 120.0  # [s] longest wait for a process to start
# [s] beyond which a limit of time is none: systems take a wait as milliseconds in 32 bits
_LONGEST_WAIT = 2e6
_LOOK = 0.5  # [s] between looks at the memory that a call takes
_SHARE_OF_MEMORY = 0.75  # that one call may take


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
    """Freezes what a new process has imported, which is what calls need, as later imports are."""
    gc.freeze()


class ProcessError(SimulationError):
    """A call that did not fail by itself: its process crashed, was killed, or lacked memory.

    It may succeed on another machine or at another time, and is made again where a study goes on.
    """


class TimeLimitError(ProcessError):
    """A call that did not come to an end within its limit of time, and was stopped."""

    def __init__(self, message: str, limit: float = math.nan) -> None:
        super().__init__(message)
        self.limit = limit  # [s]


class MemoryLimitError(ProcessError):
    """A call that took more memory than one may, and was stopped."""


@cache
def memory_limit() -> float:
    """Memory that one call may take [bytes]: three quarters of what this machine or container has.

    Infinite on systems other than Linux, where processes are not looked at. Several calls together
    may take more than there is; the system ends the largest then.
    """
    if sys.platform != "linux":
        return math.inf
    limits = [float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))]
    with suppress(OSError, ValueError):  # "max": none
        limits.append(float(Path("/sys/fs/cgroup/memory.max").read_text()))
    return _SHARE_OF_MEMORY * min(limits)


def _memory_of(process: int | None) -> int:
    """Memory of a process [bytes]; 0 of one that has ended, and on systems other than Linux."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def block_sigint() -> Generator[None, None, None]:
    """Keeps a Ctrl-C of the terminal from processes started meanwhile: their owner ends them.

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
    """Name of a computation that is not an engine's run."""

    name: str


def _computed(_: _Computation, compute: Callable[[], _Result]) -> _Result:
    return compute()


class _Process(ProcessPoolExecutor):
    """A process that makes calls; the thread that starts it lasts as long: it ends with both."""

    def __init__(self) -> None:
        super().__init__(max_workers=1, initializer=_begin_process, initargs=(os.getpid(),))
        self._starter = ThreadPoolExecutor(1, "starter")

    def begin(self) -> None:
        """Start the process by its first call.

        Raises:
            BrokenProcessPool: it ended by itself.
            TimeoutError: it did not start in time.
            RuntimeError: the system starts no thread.
        """
        self._starter.submit(_submitted, self, _import_this_module).result().result(_START)

    def wait_for(self, future: Future[Any], timeout: float, memory: float) -> _Stopped | None:
        """Wait for a call, as :func:`_wait_for`."""

        def is_done(seconds: float) -> bool:
            return bool(futures.wait([future], seconds).done)

        return _wait_for(is_done, lambda: list(self._processes or ()), timeout, memory)

    def shutdown(self, wait: bool = True, kill_workers: bool = False) -> None:
        """End the process."""
        flags: Any = self._flags
        with flags.shutdown_lock:
            # loky's thread would fail on a call that it has not begun with: it drops what waits,
            # and then looks for it.
            with suppress(Empty):
                while True:
                    self._work_ids.get_nowait()
            flags.shutdown, flags.kill_workers = True, kill_workers
        super().shutdown(wait=wait, kill_workers=kill_workers)
        self._starter.shutdown(wait=False)


@dataclass
class Worker:
    """Processes that simulate, each started when first needed and again after a crash.

    loky, not multiprocessing: it needs no `if __name__ == "__main__"` in the caller's script.
    """

    timeout: float = 600.0  # longest wait for one run [s], the start of its process apart
    isolate: bool = True  # False: simulate in this process, without a limit of time
    jobs: int = 1  # processes: calls from as many threads are served at once
    fresh: bool = False  # whether each call has a process that nothing was run in before
    memory: float = field(default_factory=memory_limit)  # [bytes] that a call may take
    _started: list[Any] = field(default_factory=list[Any], init=False)
    # One entry a process that serves no call; None for one that is not started
    _idle: SimpleQueue[Any] = field(default_factory=SimpleQueue[Any], init=False)
    _closed: bool = field(default=False, init=False)
    # Whether a process that forks imports what calls have imported
    _imports: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        self.timeout = min(self.timeout, _LONGEST_WAIT)
        for _ in range(self.jobs):
            self._idle.put(None)

    def simulate(self, runner: Engine, problem: Problem) -> Trajectory:
        """Call :func:`simulate_warm` in a process; raises as :meth:`call` does."""
        return self.call(simulate_warm, runner, problem)

    def call(
        self, function: Callable[[_Runner, _Given], _Result], runner: _Runner, given: _Given
    ) -> _Result:
        """Call a module's function on an engine, or on anything with a name, in a process.

        Raises:
            SimulationError: the engine ended its process (a crash of its compiled code), ran out of
                memory, or did not come to an end.
        """
        try:
            if self.isolate:
                return self._isolated(function, runner, given)
            return function(runner, given)
        except MemoryError as error:
            raise ProcessError(f"{runner.name} ran out of memory: {error}.") from None
        except SystemExit as error:
            raise SimulationError(f"{runner.name} ended its process: {error!r}.") from None

    def compute(self, compute: Callable[[], _Result], name: str = "the reference") -> _Result:
        """Call a module's function without arguments, or a partial, in a process.

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
            if pool not in self._started:
                pool = self._start()
                self._make_first_call(pool)
            if self.fresh and FORKS:
                return self._forked(pool, function, runner, given)
            call = _submitted(pool, function, runner, given)
            stopped = pool.wait_for(call, self.timeout, self.memory)
            if stopped is not None:
                pool = self._end(pool)
                raise self._stopped(runner, stopped)
            return call.result()
        except BrokenProcessPool:
            pool = self._end(pool)
            message = f"{runner.name} crashed: its process ended by itself."
            raise ProcessError(message) from None
        except TimeoutError:
            pool = self._end(pool)
            raise self._stopped(runner, _Stopped.TIME) from None
        finally:
            if self.fresh and not FORKS and pool in self._started:
                self._end(pool)
            self._idle.put(pool)
            if self._closed:
                self.close()

    def _forked(
        self, pool: Any, function: Callable[..., _Result], runner: _Named, given: object
    ) -> _Result:
        call = call_as_bytes(function, runner, given)
        future = _submitted(pool, _call_forked, call, self.timeout, self.memory, self._imports)
        answer, ended, safe = future.result(self.timeout + _START)
        if not safe:
            self._imports = False
            self._end(pool)
        if isinstance(ended, _Stopped):
            raise self._stopped(runner, ended)
        if answer is None:
            how = f" ({signal.Signals(-ended).name})" if ended < 0 else f" (exit code {ended})"
            raise ProcessError(f"{runner.name} crashed: its process ended by itself{how}.")
        return cast("_Result", result_of(answer))

    def _start(self) -> Any:
        pool = _Process()
        self._started.append(pool)
        return pool

    def _make_first_call(self, pool: Any) -> None:
        try:
            pool.begin()
        except BrokenProcessPool:
            raise
        except RuntimeError as error:  # there is no memory for a thread
            self._end(pool)
            raise ProcessError(f"no process can be started: {error}.") from None

    def _stopped(self, runner: _Named, why: _Stopped) -> ProcessError:
        if why is _Stopped.TIME:
            message = f"{runner.name} did not finish within {self.timeout:g} s and was stopped."
            return TimeLimitError(message, self.timeout)
        message = f"{runner.name} took more than {self.memory / 1e9:.3g} GB of memory"
        return MemoryLimitError(f"{message} and was stopped.")

    def _end(self, pool: Any) -> None:
        try:
            self._started.remove(pool)
        except ValueError:  # the thread that closes this, or that of the call, was first
            return
        # Its daemon thread frees the semaphores, and is waited for: an interpreter that ends before
        # may stop it between taking a finalizer and calling it, and the resource tracker would
        # report leaked semaphores.
        with suppress(RuntimeError):  # the thread was never started
            pool.shutdown(wait=True, kill_workers=True)

    def close(self) -> None:
        """End the processes; of a later call at its end."""
        self._closed = True
        for pool in list(self._started):
            self._end(pool)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _submitted(pool: Any, *call: Any) -> Any:
    with block_sigint():
        return pool.submit(_with_imports_kept, *call)


def _with_imports_kept(function: Callable[..., _Result], *given: Any) -> _Result:
    """Make a call, and take the modules that it has imported out of collections of garbage.

    loky collects after a call, at most once a second: with the engines' modules, some 180 000
    objects that never go, that took a seventh of a comparison's time.
    """
    modules = len(sys.modules)
    try:
        return function(*given)
    except (Exception, SystemExit):
        raise
    except BaseException as error:
        raise _no_interruption(given[0], error) from None
    finally:
        if len(sys.modules) > modules:
            gc.freeze()


def _no_interruption(runner: object, error: BaseException) -> SimulationError:
    """The error of an engine that raised what is no error, such as KeyboardInterrupt.

    Signals of the terminal are kept from these processes: no user has interrupted it.
    """
    name = getattr(runner, "name", "it")
    return SimulationError(f"{name} raised {type(error).__name__}: {error}.")


def _begin_process(parent: int) -> None:
    """Prepare a process that makes calls, before the first.

    Where psutil is installed, loky ends a process that has grown by 300 MB, as if that were a leak,
    and warns. The modules of engines and a reference are as large, and they are to stay.
    """
    end_with_parent(parent)
    _be_first_to_go()
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize  # pyright: ignore[reportPrivateUsage]


def _be_first_to_go() -> None:
    """Make the system end this process before others when memory runs out (on Linux)."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_GO)


FORKS = sys.platform == "linux" and hasattr(os, "pidfd_open")
_TASKS = Path("/proc/self/task")
_FIRST_TO_GO = "1000"  # when memory runs out, the system ends a call before anything else


class _Stopped(Enum):
    """Why a call was stopped."""

    TIME = "time"
    MEMORY = "memory"


def _wait_for(
    is_done: Callable[[float], bool],
    processes: Callable[[], Iterable[int]],
    timeout: float,
    memory: float,
) -> _Stopped | None:
    """Wait for a call, and look at the memory that its processes take meanwhile.

    Args:
        is_done: waits for so many seconds at most, and tells whether it is done.
        processes: their numbers.
        timeout: longest wait [s].
        memory: that each may take [bytes].

    Returns:
        Why the call is to be stopped; None: it is done.
    """
    end = time.monotonic() + timeout
    while (left := end - time.monotonic()) > 0:
        if is_done(min(left, _LOOK)):
            return None
        if any(_memory_of(process) > memory for process in processes()):
            return _Stopped.MEMORY
    return _Stopped.TIME


def _call_forked(
    call: bytes, timeout: float, memory: float, imports: bool
) -> tuple[bytes | None, int | _Stopped, bool]:
    """Make a call in a fork of this process.

    Args:
        call: pickled function and arguments.
        timeout: longest wait [s].
        memory: that it may take [bytes].
        imports: whether to import here afterwards what the call has imported.

    Returns:
        The pickled result and error, or None from a process that ended by itself; its exit code, or
        minus the signal that ended it, or why it was ended, with all that it has started; and
        whether this process can be forked again: not if those imports have started threads.
    """
    ours, theirs = Pipe(duplex=False)
    sys.stdout.flush()
    sys.stderr.flush()
    parent, pid = os.getpid(), os.fork()
    if pid == 0:
        _make(call, theirs, parent)
    theirs.close()
    ended = os.pidfd_open(pid)
    answer, modules = None, tuple[str, ...]()

    def is_done(seconds: float) -> bool:
        return bool(wait([ours, ended], seconds))

    try:
        stopped = _wait_for(is_done, lambda: [pid], timeout, memory)
        if stopped is None and ours.poll():
            with suppress(EOFError):  # it ended in the middle of it
                answer, modules = ours.recv_bytes(), tuple(pickle.loads(ours.recv_bytes()))
    finally:
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        os.close(ended)
        ours.close()
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return answer, stopped or code, not imports or _import(modules)


def _import(modules: tuple[str, ...]) -> bool:
    """Import what a call has imported, for the next ones; whether that has started no threads."""
    threads = len(list(_TASKS.iterdir()))
    for name in modules:
        with suppress(Exception):
            import_module(name)  # by name: only the call knew which it needs
    return len(list(_TASKS.iterdir())) <= threads


def _make(call: bytes, pipe: Connection, parent: int) -> None:
    """Make the call in the new process, send its result, and end."""
    try:
        os.setpgid(0, 0)
        end_with_parent(parent)
        before = set(sys.modules)
        answer = answer_to(call)
        sys.stdout.flush()
        sys.stderr.flush()
        pipe.send_bytes(answer)
        pipe.send_bytes(pickle.dumps([name for name in list(sys.modules) if name not in before]))
    finally:
        os._exit(0)


def call_as_bytes(function: Callable[..., object], runner: object, given: object) -> bytes:
    """Pickle a call: only the process that makes it loads what it is made of."""
    return bytes(dumps((function, (runner, given))))


def result_of(answer: bytes) -> Any:
    """Unpickle the result of a call; raises the error that it raised."""
    result, error = pickle.loads(answer)
    if error is not None:
        raise error
    return result


def _call_from(call: bytes) -> tuple[Callable[..., object], tuple[object, ...]]:
    """A call's function and arguments; EngineNotInstalledError if their module is not here.

    A worker of a cluster may lack the distribution of an engine's adapter.
    """
    try:
        return pickle.loads(call)
    except ModuleNotFoundError as error:
        text = f"the adapter cannot be imported on {socket.gethostname()}: {error}."
        raise EngineNotInstalledError(text) from None


def answer_to(call: bytes, make: Callable[..., object] | None = None) -> bytes:
    """Make a call, and pickle its result and its error, one of them None.

    Args:
        call: of :func:`call_as_bytes`.
        make: calls the function, its first argument, with the others; None: here.
    """
    given: tuple[object, ...] = (None,)
    try:
        function, given = _call_from(call)
        result = function(*given) if make is None else make(function, *given)
        return bytes(dumps((result, None)))
    except Exception as error:
        try:
            answer = bytes(dumps((None, error)))
            pickle.loads(answer)
        except Exception:  # it does not survive the way: its text does
            text = f"{type(error).__name__}: {error}"
            answer = bytes(dumps((None, SimulationError(text))))
        return answer
    except SystemExit as error:
        return bytes(dumps((None, error)))
    except BaseException as error:
        return bytes(dumps((None, _no_interruption(given[0], error))))


class OnDemand(Mapping[_K, _V]):
    """A mapping whose values are made, once, when they are first asked for."""

    def __init__(self, makers: Mapping[_K, Callable[[], _V]]) -> None:
        self._makers, self._values = dict(makers), dict[_K, _V]()

    def __getitem__(self, key: _K) -> _V:
        if key not in self._values:
            self._values[key] = self._makers[key]()
        return self._values[key]

    def __iter__(self) -> Iterator[_K]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def in_order(
    function: Callable[[_K], _V], items: Iterable[_K], jobs: int, ahead: int | None = None
) -> Generator[_V]:
    """Computes the function's values in the order of the items, several of them at once.

    Args:
        jobs: processes that serve the function's calls. There is a thread more: while one measures
            here what its process gave, the others keep all processes busy.
        ahead: how many values are computed before they are asked for, at most; None: all, of a
            finite number of items.
    """
    if jobs == 1:
        yield from map(function, items)
        return
    threads, waiting = ThreadPoolExecutor(jobs + 1), deque[Future[_V]]()
    try:
        for item in items:
            waiting.append(threads.submit(function, item))
            if ahead is not None and len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:  # no further run is started when this is left early
        threads.shutdown(wait=False, cancel_futures=True)


def all_in_order(function: Callable[[_K], _V], items: Iterable[_K], jobs: int) -> list[_V]:
    """List :func:`in_order`; where one call raises an error, no further ones are started."""
    with closing(in_order(function, items, jobs)) as results:
        return list(results)
