"""Processes in which engines run.

What a call does to its own says a sentence, and no other call notices it.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from trebucheck.comparisons.runs import process
from trebucheck.comparisons.runs.process import Worker
from trebucheck.models.errors import SimulationError

pytestmark = pytest.mark.own_processes


@dataclass(frozen=True)
class _Engine:
    name: str = "it"


class _OddError(Exception):
    """Is not made again from its text."""

    def __init__(self, one: int, other: int) -> None:
        super().__init__(f"{one} and {other}")


def _crash(*_: object) -> None:
    ctypes.string_at(0)


def _end(*_: object) -> None:
    os._exit(0)


def _exit(*_: object) -> None:
    sys.exit(3)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _fill(*_: object) -> None:
    np.ones(1 << 58)


def _fail(*_: object) -> None:
    raise _OddError(1, 2)


def _frozen(*_: object) -> int:
    return gc.get_freeze_count()


def _importing(*_: object) -> None:
    import turtledemo  # noqa: F401  (nothing else does)


def _hang(*_: object) -> None:
    time.sleep(3600)


def _give_a_generator(*_: object) -> object:
    return (_ for _ in ())


def _corrupt(*_: object) -> int:
    os.chdir("/")
    os.environ["TREBUCHECK_TEST"] = "corrupt"
    sys.path.clear()
    np.seterr(all="raise")
    np.random.seed(1)
    np.random.random(7)
    math.sqrt = None  # type: ignore[assignment]
    return os.getpid()


def _state(*_: object) -> tuple[object, ...]:
    found = (
        os.environ.get("TREBUCHECK_TEST"),
        tuple(sys.path),
        str(np.geterr()),
        callable(math.sqrt),
    )
    return Path.cwd(), *found, np.random.get_state()[2]


FAULTS: dict[Callable[..., object], str] = {
    _crash: "it crashed: its process ended by itself (SIGSEGV).",
    _end: "it crashed: its process ended by itself (exit code 0).",
    _exit: "it ended its process: SystemExit(3).",
    _interrupt: "it raised KeyboardInterrupt: .",
    _fill: "it ran out of memory: ",
    _fail: "_OddError: 1 and 2",
    _give_a_generator: "TypeError: cannot pickle 'generator' object",
}
linux = pytest.mark.skipif(
    not process.FORKS, reason="each call has a process that is started for it here"
)


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker(60.0, fresh=True) as worker:
        yield worker


@linux
@pytest.mark.parametrize("fault", FAULTS)
def test_what_a_call_does_to_its_process_is_a_sentence(
    fault: Callable[..., object], worker: Worker
) -> None:
    with pytest.raises((SimulationError, TypeError)) as caught:
        worker.call(fault, _Engine(), None)
    assert FAULTS[fault].removeprefix("TypeError: ") in str(caught.value)


@pytest.mark.parametrize("fresh", [False, True])
def test_what_is_no_error_of_a_call_ends_nothing_here(fresh: bool) -> None:
    with Worker(60.0, fresh=fresh) as worker:
        for fault in (_interrupt, _exit):
            with pytest.raises(SimulationError, match=r"it (raised|ended)"):
                worker.call(fault, _Engine(), None)


@pytest.mark.parametrize("limit", [2147484.0, 1e308, math.inf])
@pytest.mark.parametrize("fresh", [False, True])
def test_a_limit_of_time_may_be_as_long_as_one_likes(limit: float, fresh: bool) -> None:
    with Worker(limit, fresh=fresh) as worker:
        assert worker.compute(float) == 0.0


HANGING = """
import os, time
from trebucheck.comparisons.runs.process import Worker

def hang():
    print(os.getpid(), flush=True)
    time.sleep(600)

with Worker(600.0, fresh={fresh}) as worker:
    worker.compute(hang)
"""


@linux
@pytest.mark.parametrize("fresh", [False, True])
def test_a_process_ends_with_the_one_that_started_it(fresh: bool) -> None:
    """Also where that is killed, and can end nothing itself."""
    script = [sys.executable, "-c", HANGING.format(fresh=fresh)]
    with subprocess.Popen(script, stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        worker = int(started.stdout.readline())
        os.kill(worker, 0)
        started.kill()
        # At the end of what holds standard output: of the worker, too
        assert started.stdout.read() == ""
    deadline = time.monotonic() + 5.0
    while Path(f"/proc/{worker}").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}").exists()


@linux
def test_what_a_call_changes_no_other_call_sees(worker: Worker) -> None:
    before = worker.call(_state, _Engine(), None)
    assert worker.call(_corrupt, _Engine(), None) != worker.call(_corrupt, _Engine(), None)
    assert worker.call(_state, _Engine(), None) == before


@linux
def test_a_call_that_hangs_is_ended_and_the_next_one_is_served(worker: Worker) -> None:
    (pool,) = worker._started
    worker.timeout = 0.2
    with pytest.raises(SimulationError, match=r"it did not finish within 0\.2 s and was stopped\."):
        worker.call(_hang, _Engine(), None)
    worker.timeout = 60.0
    assert worker.call(_state, _Engine(), None) and worker._started == [pool]


@linux
def test_a_process_in_which_imports_start_threads_forks_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert process._import(("no_such_module", "math"))
    thread, go_on = Event(), Event()
    other = Thread(target=lambda: (thread.set(), go_on.wait(60)))
    monkeypatch.setattr(process, "import_module", lambda _: (other.start(), thread.wait(60)))
    assert not process._import(("threads",))
    go_on.set()


@pytest.mark.slow
def test_where_nothing_can_be_forked_each_call_has_a_process_that_is_started_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process, "FORKS", False)
    with Worker(60.0, fresh=True) as worker:
        worker.call(_corrupt, _Engine(), None)
        place, variable, *_ = worker.call(_state, _Engine(), None)
        assert (place, variable) == (Path.cwd(), None) and not worker._started


@linux
def test_a_process_that_is_ended_from_two_sides_is_ended_once() -> None:
    """The call's thread, which has seen its process end, and the one that closes the worker."""
    worker = Worker(60.0)
    assert worker.compute(float) == 0.0
    (pool,) = worker._started
    worker.close()
    worker._end(pool)
    assert not worker._started


def test_closing_while_a_call_has_not_begun_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a full disk ends a campaign: a thread of loky failed, and printed a traceback."""
    failed: list[object] = []
    monkeypatch.setattr(threading, "excepthook", failed.append)
    worker = Worker(60.0)
    assert worker.compute(float) == 0.0
    (pool,) = worker._started
    call = process._submitted(pool, process._computed, process._Computation("it"), float)
    worker.close()
    assert call.done() and not failed


def _grow(*_: object) -> None:
    kept: list[object] = []
    while True:
        kept.append(np.ones(1_000_000))
        time.sleep(0.01)


@linux
@pytest.mark.parametrize("fresh", [False, True])
def test_a_call_that_takes_too_much_memory_is_ended_and_the_next_one_is_served(
    fresh: bool,
) -> None:
    with Worker(60.0, fresh=fresh) as worker:
        assert worker.memory == process.memory_limit() < math.inf
        worker.memory = 1e9
        with pytest.raises(process.MemoryLimitError, match=r"it took more than 1 GB of memory"):
            worker.call(_grow, _Engine(), None)
        assert worker.call(_state, _Engine(), None)


LEFT_BEHIND = """
import multiprocessing.util
import threading
import time

from trebucheck.comparisons.runs.process import Worker


def left():
    finalizers = multiprocessing.util._finalizer_registry.values()
    return sum("loky" in str(f._args) for f in finalizers), threading.active_count()


before = left()
with Worker(60.0, jobs=2) as worker:
    assert worker.compute(float) == 0.0
    assert left()[0] > before[0]
deadline = time.monotonic() + 5.0
while left() != before and time.monotonic() < deadline:
    time.sleep(0.05)
assert left() == before, (left(), before)
"""


def test_a_closed_worker_leaves_no_semaphores_and_no_threads() -> None:
    """A script that ended with semaphores left was told of leaks; a process of its own, for others.

    Pools that other tests keep have semaphores and threads, too.
    """
    done = subprocess.run(
        [sys.executable, "-c", LEFT_BEHIND], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "leaked" not in done.stderr


class _Stillborn:
    """A pool whose process ends before it can be sent anything."""

    def __init__(self, **_: object) -> None:
        self.ended = False

    def begin(self) -> None:
        raise process.BrokenProcessPool("it ended")

    def shutdown(self, **_: object) -> None:
        self.ended = True


def test_a_process_that_does_not_start_is_a_failure_and_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pools: list[_Stillborn] = []

    def made(**options: object) -> _Stillborn:
        pools.append(_Stillborn(**options))
        return pools[-1]

    monkeypatch.setattr(process, "_Process", made)
    with Worker() as worker:
        with pytest.raises(SimulationError, match="it crashed: its process ended by itself"):
            worker.call(_end, _Engine(), None)
        assert [pool.ended for pool in pools] == [True]


def test_modules_are_no_garbage_to_collect_after_each_call() -> None:
    # loky collects after calls: 180 000 objects of engines' modules took a seventh of a comparison.
    with Worker() as worker:
        imported = worker.call(_frozen, _Engine(), None)
        worker.call(_importing, _Engine(), None)
        more = worker.call(_frozen, _Engine(), None)
    assert 10_000 < imported < more


@pytest.mark.parametrize("fails", [False, True])
def test_only_after_an_import_are_modules_taken_out_of_collections(
    fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the call fails after it."""
    frozen: list[int] = []
    monkeypatch.setattr(process.gc, "freeze", lambda: frozen.append(1))
    assert process._with_imports_kept(divmod, 7, 2) == (3, 1) and not frozen

    def imports() -> str:
        sys.modules["imported_by_this_test"] = sys
        return str(1 / (not fails))

    try:
        if fails:
            with pytest.raises(ZeroDivisionError):
                process._with_imports_kept(imports)
        else:
            assert process._with_imports_kept(imports) == "1.0"
    finally:
        del sys.modules["imported_by_this_test"]
    assert frozen == [1]
