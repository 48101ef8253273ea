"""Runs of a campaign: chunks of machines, each in a process here or on a cluster, in any order.

A chunk's process moves the reference, and measures; engines run in a process beside it, so that one
that crashes, hangs or fills the memory costs its run alone. A chunk whose own process ends is made
once more, and then machine by machine; what fails even so is a row that says so, and is made again
when the campaign is taken up.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.compute as pc

from ...engines.registry import engine_class, presets_of
from ...models.errors import (
    SimulationError,
    StudyEndedError,
)
from ...models.library.registry import library_problem
from ...models.trajectory import Trajectory, save
from ..runs.process import ProcessError, Worker
from ..runs.runner import failure
from ..runs.store import conditions
from ..runs.study import Progress, Study
from .design import DesignPart
from .launched import failed_launch, launch_rows, prepare_process
from .machines import (
    EngineCase,
    MovedMachine,
    again,
    machine_of,
    parameters,
    refuse_impossible,
)
from .spec import Campaign, Runs
from .store import CampaignStore
from .table import DIGITS, Chunk, as_parquet, from_parquet, kept_quantities, run_row, schema_of

_AHEAD = 2  # chunks under way for each process: one of them waits
_MOST_AT_ONCE = 10_000  # chunks under way, each of which has a thread here
_Item = TypeVar("_Item")
_Made = TypeVar("_Made")


def run(
    described: Campaign,
    out: Path,
    *,
    jobs: int | None = None,
    cluster: Any = None,
    progress: Progress | None = None,
    command: str | None = None,
) -> CampaignStore:
    """Run what is missing of a campaign; as :func:`.campaign.campaign`."""
    refuse_impossible(described)
    where = Study(engines=(), jobs=jobs, cluster=cluster, timeout=_longest(described))
    where = where.on_idle_cores()
    store = CampaignStore.begin(out, described, command=command, **where.times)
    finished = store.finished()
    missing = (chunk for chunk in range(store.chunks) if chunk not in finished)
    done = len(finished)
    if progress is not None:
        progress("", done, store.chunks)
    with where.worker() as worker:
        make = partial(_make, store, worker)
        if described.runs is None and where.cluster is None and done < store.chunks:
            _start(worker, min(where.at_once, store.chunks - done))
        with closing(unordered(make, missing, lambda: where.at_once)) as made:
            for chunk in made:
                done += 1
                if progress is not None:
                    progress(f"chunk {chunk}", done, store.chunks)
    return store


def _start(worker: Worker, processes: int) -> None:
    """Start processes that throw machines, while this one makes the first of them.

    One that does not start is started again by its first chunk, which says what is wrong.
    """
    threads = ThreadPoolExecutor(processes)
    for _ in range(processes):
        threads.submit(worker.compute, prepare_process, "the start of a process")
    threads.shutdown(wait=False)


def _longest(described: Campaign) -> float:
    """Longest wait for a chunk [s]: its runs are limited by themselves."""
    runs = described.runs
    if runs is None:
        return float("inf")
    parts = len(runs.engines) * len(runs.presets) * max(len(runs.timesteps), 1) + 1
    return 60.0 + 4 * parts * described.chunk_size(sys.maxsize) * runs.timeout


def unordered(
    function: Callable[[_Item], _Made], items: Iterable[_Item], jobs: Callable[[], int]
) -> Generator[_Made]:
    """Compute a function's values several at once, in the order in which they are finished.

    Args:
        function: serves calls from several threads.
        items: taken as processes become free.
        jobs: tells how many processes serve the calls now; workers of a cluster join and leave.
    """
    threads, running = ThreadPoolExecutor(_MOST_AT_ONCE), set[Future[_Made]]()
    try:
        for item in items:
            running.add(threads.submit(function, item))
            if len(running) >= min(_AHEAD * jobs(), _MOST_AT_ONCE):
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                for each in finished:
                    yield each.result()
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for each in finished:
                yield each.result()
    finally:
        threads.shutdown(wait=False, cancel_futures=True)


def _make(store: CampaignStore, worker: Worker, chunk: int) -> int:
    """Make the rows of a chunk that are missing, and write them; its number."""
    kept = store.read(chunk)
    made = _made(store.campaign, worker, store.part(chunk), kept, chunk)
    for name, motion in made.motions.items():
        save(motion, store.folder / "trajectories" / name)
    store.write(chunk, made.content)
    return chunk


def _made(
    described: Campaign, worker: Worker, machines: DesignPart, kept: Any, chunk: int
) -> Chunk:
    """Make a chunk in a process, once more where that ends, and then machine by machine."""
    if described.runs is None:
        make = partial(launch_rows, described, machines)
    else:
        make = partial(make_rows, described, machines, kept)
    try:
        return worker.compute(make, f"chunk {chunk}")
    except ProcessError:
        pass  # another process may come to the end of it
    try:
        return worker.compute(make, f"chunk {chunk}")
    except ProcessError as error:
        reason = error
    if len(machines) == 1:
        return _failed_rows(described, machines, reason)
    parts = [
        _made(described, worker, one, _of_machine(kept, int(one.numbers[0])), chunk)
        for one in machines.each()
    ]
    table = pa.concat_tables([from_parquet(part.content) for part in parts])
    motions = {name: motion for part in parts for name, motion in part.motions.items()}
    return Chunk(as_parquet(table.combine_chunks()), motions)


def _of_machine(kept: Any, number: int) -> Any:
    """Rows of one machine among those that are kept."""
    return None if kept is None else kept.filter(pc.field("machine") == number)


def _failed_rows(described: Campaign, machine: DesignPart, reason: ProcessError) -> Chunk:
    """Rows of a machine whose process ended again and again."""
    if described.runs is None:
        return failed_launch(described, machine, str(reason))
    (row,) = machine.rows()
    cases = _cases(described.runs)
    rows = [_failed(described, row, case, reason) for case in cases]
    return Chunk(as_parquet(_table(described, rows)))


# --- In a process


def make_rows(described: Campaign, machines: DesignPart, kept: Any = None) -> Chunk:
    """Run engines on some machines, and make their rows.

    Args:
        described: the campaign, which asks for runs.
        machines: their numbers and values.
        kept: rows that are there already, of which those are made again that
            :meth:`.CampaignStore.is_to_repeat`; None: there are none.
    """
    assert described.runs is not None
    rows, motions = list[dict[str, Any]](), dict[str, Trajectory]()
    for values in machines.rows():
        before = [] if kept is None else _of_machine(kept, values["machine"]).to_pylist()
        for row, motion in _runs(described, described.runs, values, before):
            rows.append(row)
            if motion is not None:
                motions[_motion_name(row)] = motion
    return Chunk(as_parquet(_table(described, rows)), motions)


def _cases(runs: Runs) -> list[EngineCase]:
    """Runs on a machine, in the order of their rows."""
    return [
        EngineCase(engine, preset, step)
        for engine in runs.engines
        for preset in presets_of(engine, runs.presets)
        for step in runs.timesteps or (None,)
    ]


def _runs(
    described: Campaign, runs: Runs, row: dict[str, Any], before: list[dict[str, Any]]
) -> Iterator[tuple[dict[str, Any], Trajectory | None]]:
    """Rows of a machine, and its motions where they are kept.

    Args:
        before: its rows of an earlier time, in the same order; empty: none.
    """
    cases = _cases(runs)
    machine: MovedMachine | None = None
    asked = [True] * len(cases)
    for k, (row_before, case) in enumerate(zip(before, cases, strict=False)):
        same = (row_before["engine"], row_before["preset"]) == (case.engine, case.preset)
        asked[k] = not same or CampaignStore.is_to_repeat(row_before)
    error: Exception | None = None
    if any(asked):
        try:
            machine = MovedMachine(machine_of(described, row), runs, _beside(runs.timeout))
        except StudyEndedError:
            raise
        except Exception as raised:  # a machine may be as odd as its values
            error = raised
    for k, case in enumerate(cases):
        if not asked[k]:
            yield before[k], None
        elif machine is None:
            yield _failed(described, row, case, error), None
        else:
            yield _one(described, row, case, machine, runs.trajectories)


def _one(
    described: Campaign,
    row: dict[str, Any],
    case: EngineCase,
    machine: MovedMachine,
    keeps_motion: bool,
) -> tuple[dict[str, Any], Trajectory | None]:
    """Row of one run, and its motion where it is kept."""
    engine, compared = machine.engine(case), machine.compared
    finished = machine.run(case, engine)
    made = run_row(row, compared.machine, finished.run, kept_quantities(described))
    made |= {
        "run": conditions(*compared.runner.conditions, engine=engine)[:DIGITS],
        "process_failed": finished.record.process_failed,
        "host": platform.node(),
        "repeat": _repeat(described, row, case),
    }
    if finished.motion is None or not keeps_motion:
        return made, None
    return made, finished.motion()


def _failed(
    described: Campaign, row: dict[str, Any], case: EngineCase, error: Exception | None
) -> dict[str, Any]:
    """Row of a run that was not begun, as the machine could not be built or moved."""
    outcome, message = failure(error or SimulationError("the reference was not solved"))
    return {
        **row,
        "engine": case.engine,
        "preset": case.preset,
        "timestep": case.timestep,
        "engine_version": engine_class(case.engine).version(),
        "outcome": outcome.value,
        "message": message,
        "process_failed": isinstance(error, ProcessError),
        "host": platform.node(),
        "repeat": _repeat(described, row, case),
    }


def _table(described: Campaign, rows: list[dict[str, Any]]) -> Any:
    return pa.Table.from_pylist(rows, schema=schema_of(described))


def _motion_name(row: Mapping[str, Any]) -> str:
    step = "" if row["timestep"] is None else f"-{row['timestep']!r}"
    return f"{row['machine']}-{row['engine']}-{row['preset']}{step}.nc"


def _repeat(described: Campaign, row: Mapping[str, Any], case: EngineCase) -> str:
    """Commands that make a run again on its own."""
    runs, machines = described.runs, described.machines
    assert runs is not None
    given, words = machines.model, list[str]()
    number = int(row["machine"])
    named = isinstance(given, str) and machines.values.keys() <= parameters(given)
    if named:
        words += ["--model", str(given)]
        for name in machines.values:
            words += ["--set", f"{name}={float(row[name])!r}"]
    else:
        words += ["--model", f"machine-{number}.json"]
    if named:
        return again(words, runs, case)
    # Its file has no duration and no law of a problem of the library
    problem = library_problem(given) if isinstance(given, str) else None
    first = f"trebucheck campaign machine . {number} > machine-{number}.json"
    return f"{first}; {again(words, runs, case, problem)}"


_BESIDE: dict[float, Worker] = {}
"""The process beside this one in which engines run, by the limit of time."""


def _beside(timeout: float) -> Worker:
    """The process in which this one's engines run, started when it is first needed."""
    return _BESIDE.setdefault(timeout, Worker(timeout))
