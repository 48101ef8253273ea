"""Cost of campaigns, and what follows at any size: `python benchmarks/campaigns.py [PART...]`.

Parts: `launches` (machines thrown into a store, from 1e3 to 1e5, with the memory that it takes),
`chunks` (runs of an engine by chunks of 1 to 64 machines, beside the bare loop), `lanes` (two
processes against one), `loopback` (the same on Dask workers), `scheduler` (empty tasks on a Dask
cluster, 1e3 and 1e4 of them). All where none is named. No test reads this; the figures of
`docs/scale.md` are its output.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trebucheck as tb
from trebucheck.comparisons.campaigns.design import Design
from trebucheck.comparisons.campaigns.run import make_rows
from trebucheck.comparisons.campaigns.spec import Campaign

_VALUES = {"l1": {"min": 8.0, "max": 11.0}, "m_cw": {"min": 1e3, "max": 4e3, "scale": "log"}}


def _described(number: int, chunk: int | None, **asked: Any) -> Campaign:
    machines = {"model": "fixed", "design": "sobol", "number": number, "values": _VALUES}
    return Campaign.of({"name": "cost", "machines": machines, "chunk": chunk, **asked})


def _runs(number: int, chunk: int) -> Campaign:
    return _described(number, chunk, runs={"engines": ["mujoco"], "presets": ["settings"]})


def _into_a_store(described: Campaign, jobs: int | None, cluster: Any = None) -> tuple[float, int]:
    """Wall time of a campaign [s], and bytes of its rows."""
    folder = Path(tempfile.mkdtemp())
    try:
        began = time.perf_counter()
        tb.campaign(described, folder, jobs=jobs, cluster=cluster)
        took = time.perf_counter() - began
        size = sum(path.stat().st_size for path in folder.rglob("*.parquet"))
    finally:
        shutil.rmtree(folder)
    return took, size


def launches() -> None:
    """Throw machines into a store on two processes."""
    print("launches on 2 processes: machines, seconds, launches a second, bytes a row, memory [MB]")
    sizes, times, few = (10_000, 30_000, 100_000), list[float](), 512  # of a chunk for each
    _into_a_store(_described(few, None, launches={}), 2)  # files are in the system's memory then
    start, _ = _into_a_store(_described(few, None, launches={}), 2)
    print(f"{few} machines, which is mostly starting, importing and compiling: {start:.2f} s")
    for number in sizes:
        took, size = _into_a_store(_described(number, None, launches={}), 2)
        times.append((took - start) / (number - few))
        largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
        print(
            f"{number:8d} {took:8.2f} {number / took:8.0f} ({1 / times[-1]:.0f} without the start) "
            f"{size / number:6.1f} {largest:8.0f}"
        )
    slope, _ = np.polyfit(np.log(sizes), np.log(times), 1)
    print(f"exponent without the start: {1 + slope:.3f}")


def chunks() -> None:
    """Run an engine chunk by chunk on one process, beside the bare loop of the same runs."""
    number = 32
    make_rows(_runs(2, 2), Design(_runs(2, 2)).part(0, 2))  # imports, and starts the engine
    began = time.perf_counter()
    make_rows(_runs(number, number), Design(_runs(number, number)).part(0, number))
    bare = time.perf_counter() - began
    print(f"bare loop of {number} machines: {bare / number:.4f} s each")
    print("machines a chunk, seconds each, overhead, bytes a row")
    for chunk in (1, 4, 16, 32):
        took, size = _into_a_store(_runs(number, chunk), 1)
        start, _ = _into_a_store(_runs(1, 1), 1)  # processes and imports
        each = (took - start) / (number - 1)
        print(f"{chunk:4d} {each:8.4f} {each / (bare / number) - 1:8.1%} {size / number:8.0f}")


def lanes() -> None:
    """Run the same campaign on one process and on two."""
    described = _runs(96, 8)
    one, two = (_into_a_store(described, jobs)[0] for jobs in (1, 2))
    start = _into_a_store(_runs(2, 1), 2)[0]
    ratio = (one - start) / (two - start)
    print(
        f"96 machines: {one:.1f} s on one process, {two:.1f} s on two, of which {start:.1f} s to "
        f"start: {ratio:.2f} times as quick"
    )


def loopback() -> None:
    """Run the same campaign on one Dask worker, on two, and on one process without Dask."""
    from distributed import LocalCluster

    described, times = _runs(96, 8), list[float]()
    cluster: Any  # whose constructor is a coroutine to type checkers
    for workers in (1, 2):
        with LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=":0"
        ) as cluster:
            address = cluster.scheduler_address
            start = _into_a_store(_runs(2, 1), None, address)[0]
            times.append(_into_a_store(described, None, address)[0] - start)
    start = _into_a_store(_runs(2, 1), 1)[0]
    here = _into_a_store(described, 1)[0] - start
    print(
        f"96 machines without the start: {times[0]:.1f} s on one Dask worker, {times[1]:.1f} s on "
        f"two, {times[0] / times[1]:.2f} times as quick; {here:.1f} s on one process here: "
        f"overhead of Dask {times[0] / here - 1:.1%}"
    )


def _nothing(_: int) -> bytes:
    return b"x" * 20_000  # as many bytes as a chunk's rows


def scheduler() -> None:
    """Send empty tasks to a Dask cluster, in the manner of a campaign."""
    from distributed import Client, LocalCluster, as_completed

    print("empty tasks on a Dask cluster of 2 workers: tasks, seconds, milliseconds each")
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, Client(cluster) as client:
        for number in (1_000, 10_000):
            began, waiting = time.perf_counter(), as_completed()
            for k in range(number):
                waiting.add(client.submit(_nothing, k, pure=False))
                if waiting.count() >= 64:
                    next(waiting).release()
            for future in waiting:
                future.release()
            took = time.perf_counter() - began
            print(f"{number:8d} {took:8.2f} {1e3 * took / number:8.3f}")


_PARTS: dict[str, Callable[[], None]] = {
    "launches": launches,
    "chunks": chunks,
    "lanes": lanes,
    "loopback": loopback,
    "scheduler": scheduler,
}

if __name__ == "__main__":
    asked = argparse.ArgumentParser(description="Cost of campaigns.")
    asked.add_argument("parts", nargs="*", choices=[*_PARTS, "all"], default="all")
    parts = asked.parse_args().parts
    for name in _PARTS if "all" in parts else parts:
        _PARTS[name]()
