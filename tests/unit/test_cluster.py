"""Runs on a Dask cluster are those made here; what is wrong with a cluster is a sentence."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.comparisons.runs.results import COMPARED, Outcome, Results
from trebucheck.models.errors import SimulationError

# Not imported here: with it comes importlib_metadata, which takes the place of Python's own for all
# tests of the process.
pytestmark = [
    pytest.mark.own_processes,
    pytest.mark.skipif(
        importlib.util.find_spec("distributed") is None,
        reason="Dask is an extra: trebucheck[cluster]",
    ),
]


@pytest.fixture(scope="module")
def running() -> Iterator[Any]:
    """A cluster of two workers, each a process, over loopback."""
    import distributed

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def client(running: Any) -> Iterator[Any]:
    import distributed

    with distributed.Client(running, set_as_default=False) as client:
        yield client


def _figures(results: Results) -> list[object]:
    """All of the runs but for their times."""
    times = dict.fromkeys(("wall_time", "processor_time", "reading_time"))
    return [run.model_copy(update=times) for run in results.runs]


def test_results_are_those_made_here_to_the_last_bit(running: Any) -> None:
    """By the address of the scheduler, with a diagnosis among the calls."""
    how: dict[str, Any] = {"presets": "default", "until": 0.4}
    there = tb.compare("pendulum", ["mujoco", "pymunk"], cluster=running.scheduler_address, **how)
    here = tb.compare("pendulum", ["mujoco", "pymunk"], **how)
    assert _figures(there.results) == _figures(here.results)
    assert any(run.diagnosis and run.diagnosis.causes for run in there.results.runs)
    assert there.results.shared and there.results.jobs == 2 and not here.results.shared


def _end_this_process(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


class _OddError(Exception):
    """Is not made again from its text."""

    def __init__(self, one: int, other: int) -> None:
        super().__init__(f"{one} and {other}")


def _fail(*_: object) -> None:
    raise _OddError(1, 2)


def test_an_error_that_cannot_be_sent_is_its_text(client: Any) -> None:
    with pytest.raises(SimulationError, match="_OddError: 1 and 2"):
        tb.cluster(client).worker(60.0, fresh=True).call(_fail, tb.engine("reference"), None)


def test_an_adapter_that_is_not_there_is_an_engine_that_is_not(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "adapter_only_here.py").write_text("class Engine:\n    name = 'only here'\n")
    monkeypatch.syspath_prepend(tmp_path)
    engine = importlib.import_module("adapter_only_here").Engine()
    with pytest.raises(tb.EngineNotInstalledError, match="'adapter_only_here'"):
        tb.cluster(client).worker(60.0).call(_fail, engine, None)


def test_a_crash_costs_its_call_and_no_worker(client: Any) -> None:
    worker = tb.cluster(client).worker(60.0)
    workers = set(client.scheduler_info()["workers"])
    with pytest.raises(SimulationError, match="crashed: its process ended by itself"):
        worker.call(_end_this_process, tb.engine("reference"), None)
    assert worker.compute(float) == 0.0
    assert set(client.scheduler_info()["workers"]) == workers


def _sleep_there(_: object, told: Path) -> None:
    told.write_text(str(os.getpid()))
    time.sleep(1e4)


def test_calls_that_are_given_up_end_there(client: Any, tmp_path: Path) -> None:
    """As after Ctrl-C: other calls on the same workers go on."""
    worker, other = tb.cluster(client).worker(600.0), tb.cluster(client).worker(60.0)
    assert other.compute(float) == 0.0
    told = tmp_path / "pid"
    with ThreadPoolExecutor(1) as threads:
        call = threads.submit(worker.call, _sleep_there, tb.engine("reference"), told)
        while not told.exists() or not told.read_text():
            time.sleep(0.05)
        worker.close()
        with pytest.raises(tb.TrebucheckError):
            call.result(20.0)
    pid, end = int(told.read_text()), time.monotonic() + 10.0
    while Path(f"/proc/{pid}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists()
    assert other.compute(float) == 0.0


def test_other_versions_there_are_named_with_their_host(client: Any) -> None:
    joined = tb.cluster(client)
    for change, told in (
        ({"trebucheck": "0.0.9"}, "trebucheck is .* and 0.0.9 on"),
        ({"code": "abc"}, "the code of trebucheck is .* and abc on"),
        ({"engines": {"mujoco": "3.0"}}, "engine 'mujoco' is .* and 3.0 on"),
    ):
        joined.versions = replace(joined.versions, **change)
        with pytest.raises(tb.InputError, match=told):
            joined.refuse_other_versions()
        with pytest.raises(tb.InputError, match=told):  # of a worker that joined later
            joined.worker(60.0).compute(float)
        joined = tb.cluster(client)
    # One that is not there: its runs are refused where they are asked for
    joined.versions = replace(joined.versions, engines={"another": "1"})
    joined.refuse_other_versions()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("tcp://127.0.0.1:9", "no scheduler answers there"),
        ("nowhere", "no scheduler answers there"),
        ("absent.json", "there is no such scheduler file"),
        ("broken.json", "cannot be read"),
        ("other.json", "no field 'address'"),
    ],
)
def test_a_cluster_that_is_not_there_is_a_sentence(
    given: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.json").write_text('{"address": ')
    Path("other.json").write_text("[1]")
    monkeypatch.setattr("trebucheck.comparisons.runs.cluster._CONNECT", 0.5)
    with pytest.raises(tb.InputError, match=told):
        tb.compare("pendulum", "mujoco", cluster=given)


def test_a_cluster_serves_several_studies_until_it_is_left(running: Any) -> None:
    how: dict[str, Any] = {"presets": "default", "until": 0.05, "diagnose": False}
    with tb.cluster(running.scheduler_address) as joined:
        for _ in range(2):
            assert tb.compare("pendulum", "mujoco", cluster=joined, **how).results.shared
    assert joined.client.status == "closed"


def test_a_scheduler_file_is_an_address(client: Any, tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text(json.dumps({"address": client.scheduler.address}))
    joined = tb.cluster(file)
    assert joined.is_own and joined.jobs == 2
    joined.close()


def test_a_lost_scheduler_ends_a_study_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    import distributed

    monkeypatch.setattr("trebucheck.comparisons.runs.cluster._CONNECT", 2.0)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        worker = tb.cluster(cluster.scheduler_address).worker(60.0)
        assert worker.compute(float) == 0.0
    with pytest.raises(tb.InputError, match=r"is lost .* --resume"):
        worker.compute(float)
    worker.close()


def test_a_campaign_has_the_same_rows_there(running: Any, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is an extra: trebucheck[campaign]")
    machines = {"model": "pendulum", "values": {"length": [0.5, 1.0, 2.0]}}
    runs = {"engines": ["mujoco", "pymunk"], "until": 0.1, "quantities": ["angle"]}
    given = {"name": "lengths", "chunk": 1, "machines": machines, "runs": runs}
    how = {"there": {"cluster": running.scheduler_address}, "here": {"jobs": 1}}
    kept = ["machine", "run", "outcome", "share", "angle_error", "angle_tolerance"]
    rows = [tb.campaign(given, tmp_path / k, **v).to_pandas(kept) for k, v in how.items()]
    assert rows[0].equals(rows[1]) and len(rows[0]) == 6
    assert tb.open_campaign(tmp_path / "there").file.shared


def test_a_worker_without_an_engine_makes_refused_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import distributed

    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['pymunk'] = None\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        engines: Any = ["pymunk", "mujoco"]
        how: dict[str, Any] = {"cluster": cluster.scheduler_address}
        found = tb.compare("pendulum", engines, presets="default", until=0.1, **how).results
        outcomes = {run.engine: run.outcome for run in found.runs if run.engine in engines}
        assert outcomes["pymunk"] is Outcome.ABSENT and outcomes["mujoco"] in COMPARED
        pytest.importorskip("pyarrow", reason="pyarrow is an extra: trebucheck[campaign]")
        machines = {"model": "pendulum", "values": {"length": [0.5, 1.0]}}
        runs = {"engines": engines, "presets": ["default"], "until": 0.1}
        given = {"name": "absent", "machines": machines, "runs": runs}
        rows = tb.campaign(given, tmp_path / "store", **how).to_pandas()
        absent = rows[rows["engine"] == "pymunk"]
        assert list(absent["outcome"]) == ["not installed"] * 2
        assert absent["message"].str.contains("pymunk").all()
        assert rows[rows["engine"] == "mujoco"]["share"].notna().all()


def _without_times(fields: dict[str, Any]) -> dict[str, Any]:
    """Fields of a JSON object but for those that differ from run to run."""
    return {name: value for name, value in fields.items() if name not in ("wall_time", "command")}


def test_conform_and_certify_say_the_same_there(running: Any, tmp_path: Path) -> None:
    for words, file in (
        (["conform", "mujoco/settings", "--problem", "pendulum"], "conformance.json"),
        (["certify", "--models", "pendulum"], "pendulum.json"),
    ):
        found: list[Any] = []
        for where in ([], ["--cluster", running.scheduler_address]):
            out = tmp_path / f"{words[0]}{len(where)}"
            assert main([*words, *where, "--quiet", "--out", str(out)]) == 0
            text = (out / file).read_text()
            found.append(json.loads(text, object_hook=_without_times))
        assert found[0] == found[1]
