"""Studies that do not need each other, each in a process of its own, two at a time: one that dies costs only itself."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from typing import Any

from joblib.externals.loky.process_executor import ProcessPoolExecutor

from ..comparisons.runs.worker import block_sigint
from ..models.errors import TrebucheckError

Job = Callable[[], Any]
Outcome = tuple[str, Any, str | None]
"""Name, result, and why there is none."""


_WARNINGS = "PYTHONWARNINGS"


class Jobs:
    """Jobs under way."""

    def __init__(self, jobs: Mapping[str, Job], at_once: int, timeout: float) -> None:
        self._waiting, self._at_once, self._timeout = deque(jobs.items()), at_once, timeout
        self._running: dict[Future[Any], tuple[str, ProcessPoolExecutor]] = {}
        self._fill()

    def _fill(self) -> None:
        while self._waiting and len(self._running) < self._at_once:
            name, job = self._waiting.popleft()
            # A pool each: loky declares a whole pool broken when one process dies.
            with _quiet_tracker():
                pool = ProcessPoolExecutor(max_workers=1)
            with block_sigint():
                self._running[pool.submit(job)] = (name, pool)

    @property
    def running(self) -> list[str]:
        """Names of the jobs under way."""
        return [name for name, _ in self._running.values()]

    def finished(self) -> Iterator[Outcome]:
        """Each as it comes to its end."""
        while self._running:
            done, _ = wait(self._running, timeout=self._timeout, return_when=FIRST_COMPLETED)
            if not done:
                yield from self._given_up()
            for future in done:
                name, pool = self._running.pop(future)
                pool.shutdown()  # its process is idle: no need to kill it
                self._fill()
                yield name, *_result(future)

    def _given_up(self) -> Iterator[Outcome]:
        for name in self.running:
            yield name, None, f"it did not finish within {self._timeout:g} s and was stopped"
        self._stop()
        self._fill()

    def _stop(self) -> None:
        for _, pool in self._running.values():
            pool.shutdown(wait=True, kill_workers=True)
        self._running.clear()

    def close(self) -> None:
        """End every process."""
        self._waiting.clear()
        self._stop()


@contextmanager
def _quiet_tracker() -> Generator[None, None, None]:
    """A process that tracks locks, started meanwhile, removes those of killed jobs without telling the user of each.

    loky starts it with the first pool; it lives on after us and has nothing but the environment to be told by.
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


@contextmanager
def begun(jobs: Mapping[str, Job], at_once: int = 2, timeout: float = 600.0) -> Generator[Jobs, None, None]:
    """Start jobs, of modules' functions, and end their processes with the block.

    Args:
        jobs: by name.
        at_once: how many at a time.
        timeout: longest wait for the next of them to finish [s].
    """
    running = Jobs(jobs, at_once, timeout)
    try:
        yield running
    finally:
        running.close()


def _result(future: Future[Any]) -> tuple[Any, str | None]:
    try:
        return future.result(), None
    except TrebucheckError as error:
        return None, str(error)
    except Exception as error:  # whatever goes wrong in one study, the others are to be told of
        return None, f"{type(error).__name__}: {error}"
