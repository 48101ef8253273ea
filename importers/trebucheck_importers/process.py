"""An importer behind a pipe: restarted after a crash, ended when it does not answer."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import TIMEOUT_MAX, Thread
from typing import Any, Self

from trebucheck.api.engines import ending_with_parent
from trebucheck.api.mechanics import InputError, SimulationError, shortened

from . import worker


@dataclass
class ImporterProcess:
    """A loader in a process of its own.

    Raises:
        InputError: the Python cannot be run, or the loader cannot be imported.
    """

    loader: str
    """`module:function`, or `path/to/file.py:function`."""
    python: Path
    timeout: float = 60.0
    """Longest wait for an answer, and for its package to be imported [s]."""
    printed: list[str] = field(default_factory=list[str], init=False)
    """Lines it printed since the list was emptied."""
    _process: subprocess.Popen[str] | None = field(default=None, init=False)
    _loaded: str | None = field(default=None, init=False)
    """The file that was loaded last; again, where the process had to be started again."""
    _lines: SimpleQueue[str] = field(default_factory=SimpleQueue[str], init=False)

    def __post_init__(self) -> None:
        name, _, function = self.loader.rpartition(":")
        if not name or not function:
            raise InputError(
                f"loader {self.loader[:60]!r} must be a module and a function, my_package:load, or "
                "my_file.py:load."
            )
        if name.endswith(".py") and not Path(name).is_file():
            raise InputError(f"loader {self.loader[:200]!r}: there is no file {name[:200]!r}.")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def call(self, name: str, *arguments: object) -> Any:
        """Ask the importer and return its answer.

        Raises:
            InputError: it cannot be started.
            SimulationError: it raised an error, crashed or gave no answer in time.
        """
        if self._process is None:
            self._start()
            if name != "load" and self._loaded is not None:
                self._ask({"call": "load", "arguments": [self._loaded]})
        self._loaded = str(arguments[0]) if name == "load" else self._loaded
        answer = self._ask({"call": name, "arguments": arguments})
        if "error" in answer:
            raise SimulationError(shortened(str(answer["error"])))
        return answer["value"]

    def _start(self) -> None:
        command = [str(self.python), worker.__file__, self.loader, str(Path.cwd())]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                preexec_fn=ending_with_parent(),  # noqa: PLW1509 (a system call)
            )
        except OSError as error:
            raise InputError(
                f"--python {str(self.python)[:200]!r} cannot be run: {error.strerror}."
            ) from None
        self._lines = SimpleQueue()
        Thread(target=_hand_on, args=(self._process, self._lines), daemon=True).start()
        try:
            answer = self._answer(self.timeout)
        except SimulationError as error:
            raise InputError(
                f"loader {self.loader[:200]!r} cannot be started with {self.python}: {error}"
            ) from None
        if "error" in answer:
            self._end()
            raise InputError(
                f"loader {self.loader[:200]!r} cannot be imported: "
                f"{shortened(str(answer['error']))}."
            )

    def _ask(self, request: Mapping[str, object]) -> Mapping[str, Any]:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # it ended: the answer will say so
            process.stdin.write(json.dumps(request, default=_listed) + "\n")
            process.stdin.flush()
        return self._answer(self.timeout)

    def _answer(self, timeout: float) -> Mapping[str, Any]:
        try:
            line = self._lines.get(timeout=min(timeout, TIMEOUT_MAX))
        except Empty:
            self._end()
            raise SimulationError(f"no answer within {timeout:g} s.") from None
        if not line:
            raise SimulationError(self._ended())
        answer = json.loads(line)
        if answer["printed"]:
            self.printed.append(answer["printed"])
        return answer

    def _ended(self) -> str:
        """Tell how it ended by itself."""
        process, self._process = self._process, None
        assert process is not None
        with suppress(BrokenPipeError):
            process.stdin.close() if process.stdin else None
        process.stdin = None
        told = process.communicate()[1].strip().splitlines()
        code = process.returncode
        how = (
            f"crashed ({signal.Signals(-code).name})"
            if code < 0
            else f"ended with exit code {code}"
        )
        return f"the process {how}{': ' + told[-1] if told else ''}."

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def _hand_on(process: subprocess.Popen[str], lines: SimpleQueue[str]) -> None:
    """Its answers; at its end an empty one."""
    assert process.stdout is not None
    with suppress(ValueError):  # the pipe is closed when the process is ended
        for line in process.stdout:
            lines.put(line)
    lines.put("")


def _listed(value: Any) -> Sequence[Any]:
    return value.tolist()
