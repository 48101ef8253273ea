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

_APART = 64
"""Calls between two that are timed. The clock takes a microsecond, as long as a short reading."""


@dataclass
class ProcessorClock:
    """Processor time of a run, all threads of its process together."""

    reading: float | None = None
    """Spent in reading so far [s]; None: the adapter does not tell it apart."""
    _reads: bool = False
    _started: float = field(default_factory=time.process_time)

    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return time.process_time() - self._started

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
            self.add(time.process_time() - started)

    def add(self, seconds: float) -> None:
        """Count so much more as reading [s]."""
        self.reading = (self.reading or 0.0) + seconds


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
    """Returns a function that reads one step, for which a part of its calls is timed.

    Each of these stands for all up to the next one; what the clock takes itself is taken off.
    """
    clock = _running.get()
    if clock is None:
        return read
    now, calls = time.process_time, 0

    def timed() -> None:
        nonlocal calls
        calls += 1
        # Not the first: it is slower than the others.
        if calls % _APART:
            read()
            return
        before = now()
        begun = now()
        read()
        ended = now()
        clock.add(_APART * max(0.0, (ended - begun) - (begun - before)))

    return timed
