"""Campaigns that are disturbed: nothing that was finished is lost, and nothing stands twice.

`CAMPAIGN_FAULTS=100 CAMPAIGN_FAULTS_SEED=7 pytest tests/meta/test_campaign_faults.py` seeds more.
A full disk needs a file system of its own, which only the system's administrator can mount.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import campaign_faults
import pytest
import trebucheck as tb
from campaign_faults import Client, Fault, rows
from trebucheck.engines.registry import ANNOUNCED

_NUMBER = int(os.environ.get("CAMPAIGN_FAULTS", "1"))
_SEED = int(os.environ.get("CAMPAIGN_FAULTS_SEED", "1"))
_END = 120.0  # [s] longest wait for a command to end
_LEFT = 5.0  # [s] after which no process of a killed command may be there

pytestmark = [
    pytest.mark.own_processes,
    pytest.mark.skipif(sys.platform != "linux", reason="processes are found by /proc"),
    pytest.mark.skipif(
        importlib.util.find_spec("pyarrow") is None
        or importlib.util.find_spec("distributed") is None,
        reason="pyarrow and Dask are extras: trebucheck[campaign,cluster]",
    ),
]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict[str, Any]], float]:
    """Rows of the campaign without a fault, and the time it takes [s]."""
    place = tmp_path_factory.mktemp("undisturbed")
    (place / "faults.toml").write_text(campaign_faults.DESCRIBED)
    began = time.monotonic()
    client = Client(place, campaign_faults.environment(place / "mark"))
    running = client.start("run", "faults.toml", "--out", "store", "--jobs", "2")
    text, _ = running.communicate(timeout=_END)
    assert running.returncode == 0, text
    return rows(tb.open_campaign(place / "store")), time.monotonic() - began


@contextmanager
def _disk(place: Path) -> Iterator[None]:
    """A small file system in a folder."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", place], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", place], check=True)


def _strike(
    fault: Fault, running: subprocess.Popen[str], dask: list[subprocess.Popen[bytes]], store: Path
) -> None:
    """Make what happens while a campaign is under way happen."""
    if fault.kind == "client":
        running.kill()
    elif fault.kind == "process":
        found = campaign_faults.descendants(running.pid)
        if found:
            os.kill(found[fault.chosen % len(found)], signal.SIGKILL)
    elif fault.kind == "disk":
        campaign_faults.fill(store.parent, fault.chosen % 20_000)
    elif fault.kind == "scheduler":
        dask[0].kill()
    elif fault.kind == "dask-worker":
        dask[1 + fault.chosen % 2].kill()


def _faults_of(
    fault: Fault, whole: list[dict[str, Any]], took: float, place: Path
) -> Iterator[str]:
    """What is wrong with a campaign that a fault has met."""
    place.mkdir()
    (place / "faults.toml").write_text(campaign_faults.DESCRIBED)
    mark = place / "mark"
    client = Client(place, campaign_faults.environment(mark))
    with ExitStack() as stack:
        where, dask = ["--jobs", "2"], list[subprocess.Popen[bytes]]()
        if fault.kind in campaign_faults.ON_CLUSTER:
            dask = stack.enter_context(campaign_faults.cluster(place, client.environment))
            where = ["--cluster", "scheduler.json"]
        if fault.kind == "disk":
            stack.enter_context(_disk(place / "disk"))
        store = place / "disk" / "store"
        running = client.start("run", "faults.toml", "--out", str(store), *where)
        time.sleep(fault.when * took)
        if fault.kind in ("crash", "hang"):
            mark.write_text(fault.kind)
        else:
            _strike(fault, running, dask, store)
        try:
            text, _ = running.communicate(timeout=_END)
        except subprocess.TimeoutExpired:
            yield "the command does not end"
            os.killpg(running.pid, signal.SIGKILL)
            text, _ = running.communicate()
        if "Traceback" in text:
            yield f"a traceback: {text}"
        if running.returncode not in (0, 2, -signal.SIGKILL):
            yield f"exit code {running.returncode}: {text}"
        end = time.monotonic() + _LEFT
        while campaign_faults.in_session(running.pid) and time.monotonic() < end:
            time.sleep(0.1)
        if left := campaign_faults.in_session(running.pid):
            yield f"{len(left)} processes are left"
        (store.parent / "filler").unlink(missing_ok=True)
        mark.unlink(missing_ok=True)
        finished = campaign_faults.finished_files(store)
        words = ("resume", str(store)) if finished else ("run", "faults.toml", "--out", str(store))
        again = client.start(*words, "--jobs", "2")
        text, _ = again.communicate(timeout=_END)
        if again.returncode != 0:
            yield f"resume: exit code {again.returncode}: {text}"
            return
        after = campaign_faults.finished_files(store)
        if any(after.get(name) != digest for name, digest in finished.items()):
            yield "a finished chunk was made again"
        if rows(tb.open_campaign(store)) != whole:
            yield "its rows are others"


def test_a_disturbed_campaign_ends_up_as_an_undisturbed_one(
    undisturbed: tuple[list[dict[str, Any]], float],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(ANNOUNCED, campaign_faults.ENGINES)
    wrong: list[str] = []
    for k, fault in enumerate(campaign_faults.faults(_NUMBER, _SEED)):
        if fault.kind == "disk" and os.geteuid() != 0:
            print(k, fault, "left out: only the administrator can mount a disk", sep="; ")
            continue
        found = list(_faults_of(fault, *undisturbed, tmp_path / str(k)))
        print(k, fault, *found, sep="; ", flush=True)
        wrong += [f"{fault}: {what}" for what in found]
    assert not wrong, "\n".join(wrong)
