"""An engine is one package and its registration.

Pymunk's room, copied out and announced by another distribution.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.converge import parameter_names, refinements, swept_parameters
from trebucheck.comparisons.explain import causes_of
from trebucheck.comparisons.recommend import option_sets, snippets
from trebucheck.comparisons.report.plots import engine_colour
from trebucheck.engines.registry import engine_class
from trebucheck.engines.study import ConstraintKinds, EngineStudy

ROOM = Path(__file__).parents[2] / "engines" / "pymunk"
COPY, PACKAGE, COLOUR, NEED = "pymunk-copy", "pymunk_copy", "#123456", "the copy's own need"
CHANGES = {
    "engine.py": ('name: ClassVar[str] = "pymunk"', f'name: ClassVar[str] = "{COPY}"'),
    "study.py": ("second order: leapfrog read at its own times", NEED),
}
"""What makes the copy another engine, and its study its own."""


def _moved_out(folder: Path) -> None:
    """Write pymunk's room as a package of its own, and the metadata of a distribution that
    announces it.
    """
    package = folder / PACKAGE
    (package / "templates").mkdir(parents=True)
    for path in ROOM.glob("templates/*"):
        (package / "templates" / path.name).write_text(path.read_text())
    for path in ROOM.glob("*.py"):
        text = re.sub(r"\bfrom \.\.\.(\w)", r"from trebucheck.\1", path.read_text())
        text = re.sub(r"\bfrom \.\.(\w)", r"from trebucheck.engines.\1", text)
        text = text.replace("from .. import", "from trebucheck.engines import")
        text = text.replace("#D55E00", COLOUR)
        old, new = CHANGES.get(path.name, ("", ""))
        assert old in text, path.name
        (package / path.name).write_text(text.replace(old, new) if old else text)
    info = folder / f"{PACKAGE}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {COPY}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        f"[trebucheck.engines]\n{COPY} = {PACKAGE}.engine:PymunkEngine\n"
    )


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    if not engine_class("pymunk").is_installed():
        pytest.skip("pymunk is not installed here")
    _moved_out(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


def test_it_is_compared_by_its_own_tolerances() -> None:
    assert engine_class(COPY).__module__ == f"{PACKAGE}.engine"  # type: ignore[attr-defined]
    results = tb.compare(
        ["fixed"], ["pymunk", COPY], ["assisted"], isolate=False, diagnose=False, timestep=2e-3
    ).results
    original, copy = results.runs
    assert copy.engine == COPY and copy.equality == original.equality
    assert [metric.value for metric in copy.metrics] == [
        metric.value for metric in original.metrics
    ]
    assert [metric.tolerance for metric in copy.metrics] == [
        metric.tolerance for metric in original.metrics
    ]
    claimed = [metric for metric in copy.metrics if metric.source == "claim"]
    assert len(claimed) >= 4
    for metric in claimed:
        assert metric.holds and metric.reason and f"({NEED})" in metric.reason


def test_its_causes_parameters_option_sets_snippets_and_colour_are_its_own() -> None:
    default = tb.engine(COPY, "default")
    assert (
        causes_of(default) == causes_of(tb.engine("pymunk", "default"))
        and len(causes_of(default)) == 8
    )
    swept, there = swept_parameters(COPY), swept_parameters("pymunk")
    assert [(each.name, each.values, each.expected) for each in swept] == [
        (each.name, each.values, each.expected) for each in there
    ]
    assert (
        {"iterations", "error_bias", "pivot_mass"}
        <= {each.name for each in swept}
        <= set(parameter_names())
    )
    assisted = tb.engine(COPY, "assisted").settings
    found = [each.description for each, _ in refinements(COPY, assisted, (), ConstraintKinds())]
    assert "ten times the pivot mass" in found
    sets = option_sets(COPY)
    assert [each.name for each in sets] == [
        "default",
        "errors undone",
        "settings",
        "leapfrog",
        "converged leapfrog",
        "held lengths",
        "assisted",
    ]
    texts, originals = (
        snippets(name, tb.fixed(), "assisted", {"timestep": 1e-3}) for name in (COPY, "pymunk")
    )
    assert texts["pymunk in Python"] == originals["pymunk in Python"]
    assert f"--engine {COPY} " in texts["trebucheck on the command line"]
    assert engine_colour(COPY) == COLOUR


def test_the_documented_examples_are_what_they_say() -> None:
    own, text = (
        (ROOM.parents[1] / "docs" / f"{page}.md").read_text() for page in ("extending", "plugins")
    )
    scope: dict[str, Any] = {}
    (mechanism, *_), (start, _, study) = (
        re.findall(r"```python\n(.*?)```", page, re.DOTALL) for page in (own, text)
    )
    exec(study, scope)
    scope["mechanism"] = tb.fixed()
    exec(start, scope)
    np.testing.assert_allclose(scope["motion"].position, [scope["place"]], rtol=0, atol=1e-14)
    assert (
        scope["angle"] == 0.0 and scope["turning"] == 0.0
    )  # of the arm of the fixed machine, at rest and level
    exec(mechanism.partition("tb.compare(")[0], scope)
    assert isinstance(scope["STUDY"], EngineStudy) and len(scope["quick_return"].loop_joints) == 1
    for field in fields(EngineStudy):
        assert f"`{field.name}" in text, f"docs/plugins.md does not say what {field.name} is"
