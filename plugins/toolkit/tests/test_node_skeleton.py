"""The skeleton of an engine of npm: whole, and red in its first step."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.engines.registry import ANNOUNCED, announce

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="no program `node` is here")


@pytest.fixture
def skeleton(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The written folder; its engine is known by name."""
    assert main(["plugin", "new", "spinner", "--node", "--out", str(tmp_path / "new")]) == 0
    monkeypatch.setenv(ANNOUNCED, "")
    monkeypatch.syspath_prepend(str(tmp_path / "new"))
    announce("trebucheck_spinner.engine:SpinnerEngine")
    yield tmp_path / "new" / "trebucheck_spinner"
    for name in [each for each in sys.modules if each.startswith("trebucheck_spinner")]:
        del sys.modules[name]


def _bring(package: Path) -> None:
    """Put an empty package of npm where npm would install it."""
    folder = package / "node" / "node_modules" / "spinner"
    folder.mkdir(parents=True)
    manifest = {"name": "spinner", "version": "1.2.3", "type": "module", "main": "index.js"}
    (folder / "package.json").write_text(json.dumps(manifest))
    (folder / "index.js").write_text("export {};\n")


def _rod() -> tb.Problem:
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0.5, 0.0), inertia=0.1)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    made = tb.Mechanism(
        name="rod", bodies=(rod,), joints=(pin,), stops=(), gravity=9.81, start=(0.3,)
    )
    return tb.Problem(made, duration=0.1)


def test_what_is_missing_is_said(skeleton: Path) -> None:
    assert skeleton.is_dir()
    with pytest.raises(tb.EngineNotInstalledError, match="python -m trebucheck_spinner"):
        tb.engine("spinner").simulate(_rod())


def test_its_first_run_names_the_first_step(skeleton: Path) -> None:
    _bring(skeleton)
    assert type(tb.engine("spinner")).version() == "1.2.3"
    with pytest.raises(tb.SimulationError, match="step 1 of templates/alone"):
        tb.engine("spinner").simulate(_rod())


def test_a_template_that_is_filled_in_moves(skeleton: Path) -> None:
    """A body that turns at a constant rate about its centre: what the functions return is read."""
    _bring(skeleton)
    (skeleton / "templates" / "alone.mjs.j2").write_text(
        "let angle = 0;\n"
        "function state(name) { return [0, 0, angle, 0, 0, 2]; }\n"
        "function apply() {}\n"
        "function step() { angle += 2 * STEP; return []; }\n"
    )
    found = tb.engine("spinner", timestep=0.01).simulate(_rod())
    assert found.q[:, 0] == pytest.approx(0.3 + 2 * found.t, abs=1e-12)
    assert found.u[:, 0] == pytest.approx(2.0)
