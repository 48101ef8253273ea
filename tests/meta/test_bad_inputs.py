"""Bad inputs by a seed: each is refused by a sentence, in time, and without a traceback.

`BAD_INPUTS=1600 BAD_INPUTS_SEED=7 pytest tests/meta/test_bad_inputs.py` tries more, and others.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import bad_inputs
import pytest
from bad_inputs import Case
from trebucheck.__main__ import main

_NUMBER = int(os.environ.get("BAD_INPUTS", "30"))
_SEED = int(os.environ.get("BAD_INPUTS_SEED", "27"))
_LIMIT = 120.0  # [s] for a call, whose runs have 20 s

pytestmark = [
    pytest.mark.own_processes,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="each call has a fork of this process"),
]


def test_every_parameter_has_bad_values() -> None:
    assert bad_inputs.without_values() == []


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad-inputs")
    bad_inputs.write_files(folder)
    return folder


def _called(case: Case, folder: Path, place: Path) -> tuple[int | None, str, str]:
    """Exit code, standard output and error of a call in a process of its own.

    The code is None where it had not ended in time.
    """
    for name in folder.iterdir():
        (place / name.name).symlink_to(name)
    for name, content in case.files.items():
        (place / name).write_text(content)
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        code = 70
        try:
            os.setpgid(0, 0)
            os.chdir(place)
            for stream, name in ((1, "printed"), (2, "said")):
                os.dup2(os.open(f".{name}", os.O_WRONLY | os.O_CREAT), stream)
            sys.stdout, sys.stderr = (
                os.fdopen(number, "w", closefd=False, encoding="utf-8") for number in (1, 2)
            )
            code = main(list(case.words))
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    end = time.monotonic() + _LIMIT
    done, status = 0, 0
    while not done and time.monotonic() < end:
        done, status = os.waitpid(pid, os.WNOHANG)
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    if not done:
        os.waitpid(pid, 0)
    texts = [(place / f".{name}").read_text(errors="replace") for name in ("printed", "said")]
    return os.waitstatus_to_exitcode(status) if done else None, *texts


def _faults(case: Case, code: int | None, printed: str, said: str) -> Iterator[str]:
    """What is wrong with how a call ended."""
    if code is None:
        yield f"it had not ended after {_LIMIT:g} s"
        return
    if code not in (0, 1, 2):
        yield f"exit code {code}"
    if "Traceback" in printed + said:
        yield "a traceback"
    if code == 0 and not case.may_be_right:
        yield "it was taken"
    if code == 2:
        if not said.strip():
            yield "no sentence"
        elif not case.names_the_value(said):
            yield "the sentence does not name the value"
    if code and not (printed + said).strip():
        yield "not a word"


def test_bad_inputs_get_a_sentence(prepared: Path, tmp_path: Path) -> None:
    wrong: list[str] = []
    for k, case in enumerate(bad_inputs.cases(_NUMBER, _SEED)):
        place = tmp_path / str(k)
        place.mkdir()
        code, printed, said = _called(case, prepared, place)
        faults = list(_faults(case, code, printed, said))
        if code == 2 and any((place / name).exists() for name in ("out", "out.html")):
            faults.append("something was written")
        if faults:
            line = shlex.join(word[:80] for word in case.words)
            last = said.strip().splitlines()[-1:] or [""]
            wrong.append(f"{', '.join(faults)}: {line} [{case.parameter}]\n    -> {last[0][:300]}")
    assert not wrong, f"{len(wrong)} of {_NUMBER}:\n" + "\n".join(wrong)
