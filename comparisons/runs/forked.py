"""Calls in processes of their own, each forked from one that has imported what calls need and has never made any.

What a call does to its process, or to itself, ends with it: a crash, a hang, a patched library,
another working directory, the state of a generator of random numbers. The process that forks does
no more than import what the calls before have imported, so that a call costs a fork and not the
start of an interpreter.

Linux only: elsewhere libraries do not survive a fork, and each call has a process that is started
for it.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from typing import Any

from joblib.externals.loky.backend.reduction import dumps

from ...models.errors import SimulationError

AVAILABLE = sys.platform == "linux" and hasattr(os, "pidfd_open")
_TASKS = Path("/proc/self/task")
_FIRST_TO_GO = "1000"  # when memory runs out, the system ends a call before anything else
_PR_SET_PDEATHSIG = 1


def packed(function: Callable[..., Any], *given: Any) -> bytes:
    """A call, so that only the process that makes it loads what it is made of."""
    return bytes(dumps((function, given)))


def unpacked(name: str, answer: bytes | None, ended: int) -> Any:
    """The result of a call.

    Args:
        name: of whose call it is, for messages.
        answer: as :func:`call_forked` gives it.
        ended: how its process ended, in the same way.

    Raises:
        SimulationError: its process ended by itself.
        Exception: whatever the call has raised.
    """
    if answer is None:
        how = f" ({signal.Signals(-ended).name})" if ended < 0 else f" (exit code {ended})"
        raise SimulationError(f"{name} crashed: its process ended by itself{how}.")
    result, error = pickle.loads(answer)
    if error is not None:
        raise error
    return result


def call_forked(
    call: bytes, timeout: float, imports: bool = True
) -> tuple[bytes | None, int | None, bool]:
    """Make a call in a fork of this process.

    Args:
        call: as :func:`packed` makes it.
        timeout: longest wait [s].
        imports: whether to import here afterwards what the call has imported.

    Returns:
        The answer, for :func:`unpacked`, or None from a process that ended by itself; its exit
        code, or minus the signal that ended it, or None if it did not come to an end: it is ended
        then, with all that it has started; and whether this process can be forked again: not if
        those imports have started threads.
    """
    ours, theirs = Pipe(duplex=False)
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        _make(call, theirs)
    theirs.close()
    ended = os.pidfd_open(pid)
    try:
        ready = wait([ours, ended], timeout)
        answer, modules = _received(ours) if ours in ready else (None, ())
    finally:
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        os.close(ended)
        ours.close()
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return answer, code if ready else None, not imports or _import(modules)


def _received(pipe: Connection) -> tuple[bytes | None, tuple[str, ...]]:
    try:
        return pipe.recv_bytes(), tuple(pickle.loads(pipe.recv_bytes()))
    except EOFError:  # it ended in the middle of it
        return None, ()


def _import(modules: tuple[str, ...]) -> bool:
    """Import what a call has imported, so that the next ones need not; whether that has started no threads."""
    threads = len(list(_TASKS.iterdir()))
    for name in modules:
        with suppress(Exception):
            import_module(name)
    return len(list(_TASKS.iterdir())) <= threads


def _make(call: bytes, pipe: Connection) -> None:
    """In the new process: make the call, send what it gives, and end."""
    try:
        os.setpgid(0, 0)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_GO)
        before = set(sys.modules)
        answer = _answer(call)
        sys.stdout.flush()
        sys.stderr.flush()
        pipe.send_bytes(answer)
        pipe.send_bytes(pickle.dumps([name for name in list(sys.modules) if name not in before]))
    finally:
        os._exit(0)


def _answer(call: bytes) -> bytes:
    """Result and error of a call, one of them None."""
    try:
        function, given = pickle.loads(call)
        return bytes(dumps((function(*given), None)))
    except Exception as error:
        return _told(error)
    except BaseException as error:
        return bytes(dumps((None, error)))


def _told(error: Exception) -> bytes:
    """An error, or its text where it does not survive the way."""
    try:
        answer = bytes(dumps((None, error)))
        pickle.loads(answer)
    except Exception:
        answer = bytes(dumps((None, SimulationError(f"{type(error).__name__}: {error}"))))
    return answer
