"""Pages that `generate.py` executes, Markdown and notebooks; the test of the examples, too."""

from __future__ import annotations

import ast
import io
import json
import os
import re
import subprocess
import sys
import tempfile
from base64 import b64encode
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

_BLOCK = re.compile(r"(```console\n)(.*?)(```)", re.DOTALL)
_WIDTH = "80"


def refresh_page(page: Path) -> None:
    """Rewrite a page with fresh output below each command; any exit code is accepted."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "COLUMNS": _WIDTH, "PATH": path}
    # All commands of a page share a folder, in the order of the page.
    with tempfile.TemporaryDirectory() as folder:

        def run(match: re.Match[str]) -> str:
            parts: list[str] = []
            for line in match[2].splitlines():
                if line.startswith("$ "):
                    done = subprocess.run(
                        line[2:],
                        shell=True,
                        cwd=folder,
                        env=environment,
                        capture_output=True,
                        text=True,
                        check=False,
                    )
                    answer = "\n".join(text.rstrip() for text in done.stdout.splitlines())
                    parts.append(line + "\n" + answer.strip("\n") + "\n")
            return match[1] + "\n".join(parts) + match[3]

        page.write_text(_BLOCK.sub(run, page.read_text(encoding="utf-8")), encoding="utf-8")


def refresh_notebook(path: Path) -> None:
    """Execute a notebook's cells in order, in this Python, and write it with their outputs."""
    notebook, names = json.loads(path.read_text(encoding="utf-8")), dict[str, Any]()
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, 1):
        cell["execution_count"] = number
        cell["outputs"] = list(outputs("".join(cell["source"]), names))
        for output in cell["outputs"]:
            if "data" in output:
                output["execution_count"] = number
    path.write_text(json.dumps(notebook, indent=1) + "\n", encoding="utf-8")


def outputs(source: str, names: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Outputs of a code cell: what it prints, and the value of its last expression."""
    statements, value = ast.parse(source).body, None
    last = statements.pop() if isinstance(statements[-1], ast.Expr) else None
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(ast.Module(statements, []), "<cell>", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    if printed.getvalue():
        lines = printed.getvalue().splitlines(keepends=True)
        yield {"output_type": "stream", "name": "stdout", "text": lines}
    if value is None:
        return
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_png_"):
        data["image/png"] = b64encode(value._repr_png_()).decode()
    elif hasattr(value, "_repr_html_") and "<iframe" not in (html := value._repr_html_()):
        data["text/html"] = html.splitlines(keepends=True)  # framed pages are too large
    yield {"output_type": "execute_result", "execution_count": None, "metadata": {}, "data": data}
