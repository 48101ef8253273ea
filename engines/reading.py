"""The processor time that an adapter takes to read an engine, told apart from the engine's steps.

Reading is what brings positions, forces and energies out of the engine after or between its steps.
It is none of the steps, and none of what trebucheck does in the engine's place. What the engine
itself computes in its steps because it is asked for, as MuJoCo and Exudyn do their sensors, is part
of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from statistics import median

_APART = 16
"""Calls between two that are timed. The clock takes a microsecond, as long as a short reading."""


@dataclass
class _Sampled:
    """Readings of single steps, some of which are timed."""

    calls: int = 0
    times: list[float] = field(default_factory=list[float])
    """Times of those that are timed [s]."""

    @property
    def total(self) -> float:
        """Time of all [s]: a median, as one that is interrupted would stand for many."""
        return self.calls * median(self.times) if self.times else 0.0


@dataclass
class ProcessorClock:
    """Processor time of a run, all threads of its process together."""

    _blocks: float | None = None
    _sampled: list[_Sampled] = field(default_factory=list[_Sampled])
    _reads: bool = False
    _started: float = field(default_factory=time.process_time)

    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return time.process_time() - self._started

    @property
    def reading(self) -> float | None:
        """Time spent in reading so far [s]; None: the adapter does not tell it apart."""
        if self._blocks is None and not self._sampled:
            return None
        return (self._blocks or 0.0) + sum(sampled.total for sampled in self._sampled)

    @contextmanager
    def read(self) -> Generator[None]:
        """Count a block as reading; once where blocks are nested."""
        if self._reads:
            yield
            return
        self._reads, started = True, time.process_time()
        try:
            yield
        finally:
            self._reads = False
            self._blocks = (self._blocks or 0.0) + time.process_time() - started

    def sampled(self, read: Callable[[], None]) -> Callable[[], None]:
        """Returns a function that reads a step, and is timed now and then.

        What the clock takes itself is taken off.
        """
        now, sampled = time.process_time, _Sampled()
        self._sampled.append(sampled)

        def timed() -> None:
            sampled.calls += 1
            if sampled.calls % _APART != 1:
                read()
                return
            before = now()
            begun = now()
            read()
            ended = now()
            sampled.times.append(max(0.0, (ended - begun) - (begun - before)))

        return timed


_running: ContextVar[ProcessorClock | None] = ContextVar("clock of the run", default=None)


@contextmanager
def clocked() -> Generator[ProcessorClock]:
    """Measure a run, with what the adapter calls reading in it."""
    clock = ProcessorClock()
    token = _running.set(clock)
    try:
        yield clock
    finally:
        _running.reset(token)


@contextmanager
def timed_reading() -> Generator[None]:
    """Count a block, or a function that this decorates, as reading of the present run."""
    clock = _running.get()
    if clock is None:  # an adapter's parts are used without a run as well
        yield
        return
    with clock.read():
        yield


def read_each_step(read: Callable[[], None]) -> Callable[[], None]:
    """Returns a function that reads one step; some of its calls are timed, and stand for all."""
    clock = _running.get()
    return read if clock is None else clock.sampled(read)
