"""Calls of engines and of the reference on a Dask cluster, in place of processes here.

A Dask worker makes each call in a process of its own (:class:`.process.Worker`): an engine that
crashes or hangs costs its call, and neither the Dask worker nor what else runs there. Only Dask's
public interface is used, so that any cluster will do: `LocalCluster`, Slurm, Kubernetes, ssh.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, NoReturn, Self, cast

from distributed import CancelledError, Client, KilledWorker, WorkerPlugin, get_worker

from ...engines.registry import ANNOUNCED
from ...models.errors import InputError, StudyEndedError
from .process import ProcessError, Worker, answer_to, call_as_bytes, result_of
from .versions import Versions, versions_here

Given = Any
"""An address such as 'tcp://host:8786', the path of a scheduler file, or a distributed.Client."""

_CONNECT = 30.0  # [s] longest wait for a scheduler
_WORKERS = 60.0  # [s] longest wait for its first worker


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

    @cached_property
    def jobs(self) -> int:
        """Threads of all workers when this is first asked: calls that are made at once."""
        return max(1, sum(self.client.nthreads().values()))

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

    def close(self) -> None:
        """Leave the cluster, where it was joined here; it goes on itself."""
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
        return Client(**where, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"cluster {text!r}: no scheduler answers there ({error}); an address such as "
            "tcp://host:8786 or a scheduler file is needed."
        ) from None


def _refuse_no_scheduler_file(path: Path) -> None:
    """Raise InputError if a file is not one that a scheduler writes: distributed only asserts."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"cluster {str(path)!r}: there is no such scheduler file.") from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cluster {str(path)!r} cannot be read: {error}.") from None
    if not isinstance(fields, dict) or "address" not in fields:
        raise InputError(
            f"cluster {str(path)!r} is no scheduler file: it has no field 'address'."
        )


@dataclass
class ClusterWorker(Worker):
    """Makes calls on a cluster; a :class:`.process.Worker` there makes each in a process."""

    cluster: Cluster | None = None

    def _isolated(self, function: Callable[..., Any], runner: Any, given: Any) -> Any:
        assert self.cluster is not None
        call = call_as_bytes(function, runner, given)
        announced = os.environ.get(ANNOUNCED, "")
        client, here = self.cluster.client, self.cluster.versions
        try:
            future = client.submit(
                _call_there, call, self.timeout, self.fresh, announced, here, pure=False
            )
            answer = future.result()
        except KilledWorker:
            message = f"{runner.name} was not run: the workers that began with it were lost."
            raise ProcessError(message) from None
        except (CancelledError, OSError) as error:  # the scheduler is gone
            raise StudyEndedError(
                f"the cluster {self.cluster.address} is lost ({error}); what was finished is kept, "
                "and --resume goes on from there."
            ) from None
        return result_of(answer)

    def close(self) -> None:
        """Leave the cluster, if it was joined for this worker's study."""
        super().close()
        if self.cluster is not None and self.cluster.is_of_study:
            self.cluster.close()


_BESIDE: dict[tuple[float, bool], Worker] = {}
"""Processes beside this one of a Dask worker, by the limit of time and whether each call is fresh.
"""


class _EndProcesses(WorkerPlugin):
    """Plug-in of Dask workers that ends their processes with them."""

    def teardown(self, worker: object) -> None:
        """End the processes of a worker that is about to end."""
        while _BESIDE:
            _BESIDE.popitem()[1].close()


def _worker_there(timeout: float, fresh: bool, jobs: int) -> Worker:
    """Processes beside this one of a Dask worker."""
    # Dask makes its workers daemons, which may have no processes by Python's rule; these end with
    # their parent.
    process = cast("Any", multiprocessing.current_process())
    process._config["daemon"] = False
    return _BESIDE.setdefault((timeout, fresh), Worker(timeout, jobs=jobs, fresh=fresh))


@cache
def _versions_there() -> Versions:
    """Versions in this process of a Dask worker, read once."""
    return versions_here()


def _call_there(call: bytes, timeout: float, fresh: bool, announced: str, here: Versions) -> bytes:
    """Make a call in a process beside a Dask worker; its pickled result and error."""
    os.environ[ANNOUNCED] = announced
    difference = here.difference(_versions_there())  # of workers that joined later
    if difference is not None:
        return answer_to(call, partial(_refuse, difference))
    return answer_to(call, _worker_there(timeout, fresh, get_worker().state.nthreads).call)


def _refuse(difference: str, *_: object) -> NoReturn:
    """Raise the error of a worker that has another version."""
    raise StudyEndedError(f"{difference}; the same is needed wherever runs are made.")
