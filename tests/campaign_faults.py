"""Faults of a campaign under way, drawn by a seed: what is killed, what fills, and when."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import trebucheck as tb
from trebucheck.comparisons.campaigns.store import CampaignStore
from trebucheck.comparisons.campaigns.table import COSTS
from trebucheck.engines.pymunk.engine import PymunkEngine
from trebucheck.engines.registry import ANNOUNCED

MARK = "TREBUCHECK_FAULT_MARK"
"""Environment variable with the file whose presence makes the next run of `faulty` fail."""
ENGINES = "faulty=campaign_faults:Faulty"
KINDS = {
    "client": 25,
    "process": 25,
    "disk": 10,
    "crash": 10,
    "hang": 10,
    "dask-worker": 10,
    "scheduler": 10,
}
"""Kinds of a fault, and how many of a hundred."""
ON_CLUSTER = ("dask-worker", "scheduler")
_LIMIT = 30.0  # [s] for a run
DESCRIBED = f"""
name = "faults"
chunk = 2

[machines]
model = "pendulum"
values.length = {{ min = 0.5, max = 2.0, steps = 3 }}
values.amplitude = {{ min = 0.2, max = 2.0, steps = 3 }}

[runs]
engines = ["mujoco", "faulty"]
presets = ["settings"]
until = 0.1
timeout = {_LIMIT}
"""


class Faulty(PymunkEngine):
    """pymunk, one of whose runs crashes or hangs, as a file says."""

    name = "faulty"

    def simulate(self, problem: tb.Problem) -> tb.Trajectory:
        mark = Path(os.environ.get(MARK, "/nowhere"))
        taken = mark.with_suffix(f".{os.getpid()}")
        with suppress(FileNotFoundError):
            mark.rename(taken)  # of several runs at once one only
            _fail(taken.read_text())
        return super().simulate(problem)


def _fail(how: str) -> NoReturn:
    if how == "crash":
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(1e4)
    raise AssertionError("it was not ended")


@dataclass(frozen=True)
class Fault:
    """What happens, and after which part of the time that an undisturbed campaign takes."""

    kind: str
    when: float
    chosen: int
    """Number by which one of several processes is chosen."""


def faults(number: int, seed: int) -> Iterator[Fault]:
    """Draw faults."""
    drawn = random.Random(seed)
    for _ in range(number):
        kind = drawn.choices(list(KINDS), list(KINDS.values()))[0]
        yield Fault(kind, drawn.random(), drawn.randrange(1 << 30))


def rows(store: CampaignStore) -> list[dict[str, Any]]:
    """Rows of a campaign, without what tells where and how quickly they were made."""
    table = store.to_pandas().drop(columns=list(COSTS))
    return json.loads(table.to_json(orient="records", double_precision=15))


def finished_files(store: Path) -> dict[str, str]:
    """Hashes of the chunks' files that are there and have no row to be made again."""
    if not (store / "campaign.json").is_file():
        return {}
    opened = tb.open_campaign(store)
    missing = set(range(opened.chunks)) - opened.finished()
    paths = [opened.path(chunk) for chunk in range(opened.chunks) if chunk not in missing]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


@dataclass
class Client:
    """A campaign's command as a user starts it."""

    place: Path
    environment: dict[str, str]

    def start(self, *words: str) -> subprocess.Popen[str]:
        """Start a command in a session of its own."""
        command = [sys.executable, "-m", "trebucheck", "campaign", *words, "--quiet"]
        return subprocess.Popen(
            command,
            cwd=self.place,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )


def environment(mark: Path) -> dict[str, str]:
    """Environment of clients and workers, in which the engine `faulty` is announced."""
    here = str(Path(__file__).parent)
    return os.environ | {
        ANNOUNCED: ENGINES,
        "PYTHONPATH": here,
        MARK: str(mark),
        "OPENBLAS_NUM_THREADS": "1",
    }


@contextmanager
def cluster(place: Path, given: dict[str, str]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """A scheduler and two workers, each a process; the scheduler stands first."""
    file = place / "scheduler.json"
    quiet: dict[str, Any] = {
        "cwd": place,
        "env": given,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "start_new_session": True,
    }
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    alone = ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    running = [subprocess.Popen([*dask, *alone], **quiet)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file)]
    try:
        while not file.is_file() or not file.read_text().strip():
            time.sleep(0.1)
        running += [
            subprocess.Popen([*worker, "--nthreads", "1", "--no-dashboard", "--no-nanny"], **quiet)
            for _ in range(2)
        ]
        yield running
    finally:
        for process in running:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        file.unlink(missing_ok=True)


def descendants(pid: int) -> list[int]:
    """Processes that a process has started, and that those have, by /proc.

    Without loky's resource trackers, which print tracebacks of their own where one was killed.
    """
    parents = {number: int(fields[1]) for number, fields in _processes()}
    found, again = set[int](), {pid}
    while again:
        again = {child for child, parent in parents.items() if parent in again} - found
        found |= again
    return sorted(pid for pid in found if not _is_tracker(pid))


def _is_tracker(pid: int) -> bool:
    try:
        return b"resource_tracker" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def in_session(session: int) -> list[int]:
    """Processes of a session that have not ended, by /proc."""
    return [
        number for number, fields in _processes() if int(fields[3]) == session and fields[0] != "Z"
    ]


def _processes() -> Iterator[tuple[int, list[str]]]:
    """Number of each process, and its state, parent, group, session and so on, by /proc."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended meanwhile
            yield int(path.parent.name), path.read_text().rpartition(")")[2].split()


def fill(folder: Path, leave: int) -> None:
    """Fill the disk of a folder but for so many bytes."""
    free = shutil.disk_usage(folder).free
    with suppress(OSError):  # the campaign has written meanwhile: the disk is full already
        (folder / "filler").write_bytes(bytes(max(0, free - leave)))
