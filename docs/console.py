"""Run the commands in the `console` blocks of a Markdown page and write their output below each."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"(```console\n)(.*?)(```)", re.DOTALL)
_WIDTH = "80"


def commands(text: str) -> list[str]:
    """The lines after a prompt."""
    return [
        line[2:]
        for block in BLOCK.findall(text)
        for line in block[1].splitlines()
        if line.startswith("$ ")
    ]


def answer(command: str, folder: Path) -> str:
    """Output of a command line run in that folder; any exit code is accepted (1 is a verdict)."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    own = {**os.environ, "COLUMNS": _WIDTH, "PATH": path}
    done = subprocess.run(
        command, shell=True, cwd=folder, env=own, capture_output=True, text=True, check=False
    )
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip("\n")


def refresh(page: Path) -> None:
    """Rewrite a page with fresh output; its commands share a folder, in the order of the page."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:

        def run(match: re.Match[str]) -> str:
            parts = [
                f"$ {command}\n{answer(command, Path(folder))}\n" for command in commands(match[0])
            ]
            return match[1] + "\n".join(parts) + match[3]

        page.write_text(BLOCK.sub(run, text), encoding="utf-8")
