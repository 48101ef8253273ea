"""The commands that the documents print are commands.

Their options exist and their values are of the right kind.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from trebucheck.cli.app import app

ROOT = Path(__file__).parents[2]
ROWS = (
    "compare",
    "diff",
    "converge",
    "explain",
    "recommend",
    "throw",
    "animate",
    "paper",
    "certify",
    "prove",
    "conform",
    "judge",
)


def _printed(name: str) -> Iterator[str]:
    for line in (ROOT / name).read_text(encoding="utf-8").splitlines():
        if line.startswith(("    trebucheck ", "$ trebucheck ")):
            yield line.lstrip("$ ").partition(" | ")[0]


@pytest.mark.parametrize(
    "line", [*_printed("docs/howto.md"), *_printed("docs/tutorial.md"), *_printed("README.md")]
)
def test_printed_commands_are_understood(line: str) -> None:
    command: Any = typer.main.get_command(app)
    words = shlex.split(line, comments=True)[1:]
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    command.make_context(
        command.name, words
    )  # parsed, which refuses what is unknown, and not called


def test_every_question_has_an_example() -> None:
    first = {line.split()[1] for line in _printed("docs/howto.md")}
    assert first == set(ROWS)
