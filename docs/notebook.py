"""Execute the cells of a Jupyter notebook in this Python alone and keep their output."""

from __future__ import annotations

import ast
import io
import json
from base64 import b64encode
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

Cell = dict[str, Any]


def outputs(source: str, names: dict[str, Any]) -> Iterator[Cell]:
    """Outputs of a code cell: what it prints, and the value of its last expression."""
    statements = ast.parse(source).body
    last = statements[-1] if isinstance(statements[-1], ast.Expr) else None
    if last is not None:
        statements.pop()
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(ast.Module(statements, []), "<cell>", "exec"), names)
        value = (
            eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
            if isinstance(last, ast.Expr)
            else None
        )
    if printed.getvalue():
        yield {
            "output_type": "stream",
            "name": "stdout",
            "text": printed.getvalue().splitlines(keepends=True),
        }
    if value is not None:
        yield {
            "output_type": "execute_result",
            "execution_count": None,
            "metadata": {},
            "data": _shown(value),
        }


def _shown(value: Any) -> dict[str, Any]:
    """Output in the notebook's format; framed HTML pages are left out, as they are too large."""
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if hasattr(value, "_repr_png_"):
        data["image/png"] = b64encode(value._repr_png_()).decode()
    elif hasattr(value, "_repr_html_") and "<iframe" not in (html := value._repr_html_()):
        data["text/html"] = html.splitlines(keepends=True)
    return data


def execute(path: Path) -> None:
    """Execute a notebook's cells in order and write it with their outputs."""
    notebook, names = json.loads(path.read_text(encoding="utf-8")), dict[str, Any]()
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, 1):
        found = list(outputs("".join(cell["source"]), names))
        cell |= {
            "execution_count": number,
            "outputs": [
                {**each, **({"execution_count": number} if "data" in each else {})}
                for each in found
            ],
        }
    path.write_text(json.dumps(notebook, indent=1) + "\n", encoding="utf-8")
