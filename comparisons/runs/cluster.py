"""Calls of engines and of the reference on a Dask cluster, in place of processes here.

A Dask worker makes each call in a process of its own (:class:`.process.Worker`): an engine that
crashes or hangs costs its call, and neither the Dask worker nor what else runs there. Only Dask's
public interface is used, so that any cluster will do: `LocalCluster`, Slurm, Kubernetes, ssh.
"""

from __future__ import annotations

import json
import logging
import math
import multiprocessing
import os
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple, NoReturn, Self, cast
from uuid import uuid4

from distributed import CancelledError, Client, KilledWorker, WorkerPlugin, get_worker

from ...engines.registry import ANNOUNCED
from ...models.errors import InputError, StudyEndedError
from .process import ProcessError, Worker, answer_to, call_as_bytes, result_of
from .versions import Versions, versions_here

Given = Any
"""An address such as 'tcp://host:8786', the path of a scheduler file, or a distributed.Client."""

_CONNECT = 30.0  # [s] longest wait for a scheduler
_WORKERS = 60.0  # [s] longest wait for its first worker
_LOOK_AGAIN = 5.0  # [s] between looks at the number of workers


@dataclass
class Cluster:
    """A Dask cluster on which calls are made; as a context manager it is left at the end."""

    client: Any
    """A distributed.Client (whose methods are coroutines to type checkers)."""
    is_own: bool = False
    """Whether the client was made here, and is closed where the cluster is left."""
    is_of_study: bool = False
    """Whether it was joined for one study, and is left with its worker."""
    versions: Versions = field(default_factory=versions_here)
    token: str = field(default_factory=lambda: uuid4().hex)
    """Name by which workers tell its calls from those of other clients."""
    _threads: int = field(default=1, init=False)
    _look_again: float = field(default=-math.inf, init=False)  # [s] of the monotonic clock

    @classmethod
    def of(cls, given: Given) -> Self:
        """Connect to a cluster, and hold its versions against those here.

        Raises:
            InputError: no scheduler answers, it has no workers, or a worker has other versions; the
                sentence names host and versions.
        """
        if isinstance(given, cls):
            return given
        is_own = not isinstance(given, Client)
        found = cls(_connected(given) if is_own else given, is_own)
        try:
            found.refuse_other_versions()
            found.client.register_plugin(_EndProcesses(), name=_EndProcesses.__name__)
        except BaseException:
            found.close()
            raise
        return found

    @property
    def jobs(self) -> int:
        """Threads of all workers, which may join and leave: calls that are made at once."""
        now = time.monotonic()
        if now >= self._look_again and self.client.status == "running":
            self._look_again = now + _LOOK_AGAIN
            with suppress(CancelledError, OSError, TimeoutError):  # the calls will say so
                self._threads = max(1, sum(self.client.nthreads().values()))
        return self._threads

    def refuse_other_versions(self) -> None:
        """Raise InputError if a worker has other versions than this process, or there is none."""
        try:
            self.client.wait_for_workers(1, timeout=_WORKERS)
        except TimeoutError:
            raise InputError(
                f"the cluster {self.address} has no worker after {_WORKERS:g} s; start one, e.g. "
                "`dask worker ADDRESS`."
            ) from None
        answers: Mapping[str, object] = self.client.run(_versions_there, on_error="return")
        for address, answer in answers.items():
            if not isinstance(answer, Versions):
                raise InputError(
                    f"worker {address} of the cluster cannot import trebucheck: "
                    f"{type(answer).__name__}: {answer}."
                )
            difference = self.versions.difference(answer)
            if difference is not None:
                _refuse(difference)

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return str(self.client.scheduler.address)

    def worker(self, timeout: float, fresh: bool = False) -> ClusterWorker:
        """Make a worker whose calls are made on the cluster.

        Args:
            timeout: longest wait for a call [s].
            fresh: whether each call has a process that nothing was run in before.
        """
        return ClusterWorker(timeout, jobs=self.jobs, fresh=fresh, cluster=self)

    def end_calls(self, futures: Collection[Any] = ()) -> None:
        """Give up calls, and end the processes that make this client's calls."""
        if self.client.status != "running":  # the scheduler is gone
            return
        with suppress(CancelledError, OSError, TimeoutError):  # it may go meanwhile
            self.client.cancel(list(futures), force=True)
            self.client.run(_end_calls, self.token, on_error="ignore")

    def close(self) -> None:
        """Leave the cluster, which goes on itself; a client that was made here is closed."""
        self.end_calls()
        if self.is_own:
            self.client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _connected(given: object) -> Client:
    """A client of a scheduler by address or file; InputError if none answers."""
    text = str(given)
    is_file = isinstance(given, Path) or text.endswith(".json")
    if is_file:
        _refuse_no_scheduler_file(Path(text))
    where: dict[str, Any] = {"scheduler_file": text} if is_file else {"address": text}
    try:
        client = Client(**where, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"cluster {text!r}: no scheduler answers there ({error}); an address such as "
            "tcp://host:8786 or a scheduler file is needed."
        ) from None
    # A scheduler that is lost is a sentence of ours; distributed logs tracebacks beside it.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    return client


def _refuse_no_scheduler_file(path: Path) -> None:
    """Raise InputError if a file is not one that a scheduler writes: distributed only asserts."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"cluster {str(path)!r}: there is no such scheduler file.") from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cluster {str(path)!r} cannot be read: {error}.") from None
    if not isinstance(fields, dict) or "address" not in fields:
        raise InputError(f"cluster {str(path)!r} is no scheduler file: it has no field 'address'.")


@dataclass
class ClusterWorker(Worker):
    """Makes calls on a cluster; a :class:`.process.Worker` there makes each in a process."""

    cluster: Cluster | None = None
    _waited_for: set[Any] = field(default_factory=set[Any], init=False)

    def _isolated(self, function: Callable[..., Any], runner: Any, given: Any) -> Any:
        assert self.cluster is not None
        call = call_as_bytes(function, runner, given)
        announced = os.environ.get(ANNOUNCED, "")
        client, here = self.cluster.client, self.cluster.versions
        key, future = _Key(self.cluster.token, self.timeout, self.fresh), None
        try:
            future = client.submit(_call_there, call, key, announced, here, pure=False)
            self._waited_for.add(future)
            answer = future.result()
        except KilledWorker:
            message = f"{runner.name} was not run: the workers that began with it were lost."
            raise ProcessError(message) from None
        except (CancelledError, OSError) as error:  # the scheduler is gone
            raise StudyEndedError(
                f"the cluster {self.cluster.address} is lost ({error}); what was finished is kept, "
                "and --resume goes on from there."
            ) from None
        finally:
            self._waited_for.discard(future)
        return result_of(answer)

    def close(self) -> None:
        """Give up calls that are not finished; leave a cluster that was joined for this study."""
        super().close()
        if self.cluster is None:
            return
        if self._waited_for:
            self.cluster.end_calls(self._waited_for)
        if self.cluster.is_of_study:
            self.cluster.close()


class _Key(NamedTuple):
    """Purpose of the processes beside a Dask worker."""

    token: str  # of a client's cluster
    timeout: float  # of a call [s]
    fresh: bool  # whether each call has a process that nothing was run in before


_BESIDE: dict[_Key, tuple[Worker, float]] = {}
"""Processes beside this one of a Dask worker, and their last call by the monotonic clock [s]."""
_CHOOSING = Lock()  # a Dask worker has several threads
_IDLE = 600.0  # [s] without a call, beyond its limit of time, after which a client must be gone


class _EndProcesses(WorkerPlugin):
    """Plug-in of Dask workers that ends their processes with them."""

    def teardown(self, worker: object) -> None:
        """End the processes of a worker that is about to end."""
        for key in list(_BESIDE):
            _end(key)


def _end_calls(token: str) -> None:
    """End the processes that make the calls of one client."""
    for key in [key for key in list(_BESIDE) if key.token == token]:
        _end(key)


def _end(key: _Key) -> None:
    with _CHOOSING:
        ended = _BESIDE.pop(key, None)
    if ended is not None:
        ended[0].close()


def _worker_there(key: _Key, jobs: int) -> Worker:
    """Processes beside this one of a Dask worker."""
    # Dask makes its workers daemons, which may have no processes by Python's rule; these end with
    # their parent.
    process = cast("Any", multiprocessing.current_process())
    process._config["daemon"] = False
    now = time.monotonic()
    with _CHOOSING:
        there = _BESIDE.get(key)
        worker = there[0] if there else Worker(key.timeout, jobs=jobs, fresh=key.fresh)
        _BESIDE[key] = worker, now
        idle = [each for each, (_, last) in _BESIDE.items() if now - last > each.timeout + _IDLE]
    for other in idle:
        _end(other)
    return worker


@cache
def _versions_there() -> Versions:
    """Versions in this process of a Dask worker, read once."""
    return versions_here()


def _call_there(call: bytes, key: _Key, announced: str, here: Versions) -> bytes:
    """Make a call in a process beside a Dask worker; its pickled result and error."""
    os.environ[ANNOUNCED] = announced
    difference = here.difference(_versions_there())  # of workers that joined later
    if difference is not None:
        return answer_to(call, partial(_refuse, difference))
    return answer_to(call, _worker_there(key, get_worker().state.nthreads).call)


def _refuse(difference: str, *_: object) -> NoReturn:
    """Raise the error of a worker that has another version."""
    raise StudyEndedError(f"{difference}; the same is needed wherever runs are made.")
