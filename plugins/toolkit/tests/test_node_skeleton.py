"""The skeleton of an engine of npm: whole, and each of its steps red until it is done."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.registry import ANNOUNCED, announce
from trebucheck_toolkit import node_program

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
        name="rod",
        bodies=(rod,),
        joints=(pin,),
        stops=(),
        gravity=9.81,
        start=(0.3,),
        start_speeds=(2.0,),
    )
    return tb.Problem(made, duration=0.1)


STATE = "let angle = 0;\nfunction state(name) { return [0, 0, angle, 0, 0, 2]; }\n"
HALF = f"{-0.5 * math.cos(0.3)}, {-0.5 * math.sin(0.3)}"  # from its centre of mass to the pin
BUILT = f"function built() {{ return [1, 0.1, 0, 0, 0, 0, {HALF}, 0, 0, 0, 9.81]; }}\n"
STEP = "function step() { angle += 2 * STEP; return []; }\n"


def test_what_is_missing_is_said(skeleton: Path) -> None:
    assert skeleton.is_dir()
    with pytest.raises(tb.EngineNotInstalledError, match="python -m trebucheck_spinner"):
        tb.engine("spinner").simulate(_rod())


def test_each_step_is_named_until_it_is_done(skeleton: Path) -> None:
    """Steps are in the order in which a check asks for them: the model first, then the motion."""
    _bring(skeleton)
    assert type(tb.engine("spinner")).version() == "1.2.3"
    template = skeleton / "templates" / "alone.mjs.j2"
    written = template.read_text()
    for step, function in enumerate((STATE, BUILT, STEP), 1):
        with pytest.raises(AssertionError, match=f"step {step} of templates/alone"):
            tb.check("spinner", _rod(), angle=10.0, isolate=False)
        name = re.search(r"function (\w+)", function)
        assert name is not None
        left = rf"function {name[1]}\(.*?^}}\n"
        written = re.sub(left, function, written, flags=re.MULTILINE | re.DOTALL)
        template.write_text(written)
    tb.check("spinner", _rod(), angle=10.0, isolate=False)


def test_the_model_check_reads_what_is_built(skeleton: Path) -> None:
    _bring(skeleton)
    template = skeleton / "templates" / "alone.mjs.j2"
    for mass, holds in ((1, True), (2, False)):
        template.write_text(STATE + BUILT.replace("[1,", f"[{mass},") + STEP)
        assert check_model(tb.engine("spinner"), _rod().mechanism).holds is holds


def test_its_comment_has_every_name_that_the_program_takes(skeleton: Path) -> None:
    folder = Path(node_program.__file__).parent / "templates"
    program = re.sub(r"{{.*?}}", "", (folder / "program.mjs.j2").read_text())
    declared = re.findall(r"^(?:const|function|import) ([^(;\n]*)", program, re.MULTILINE)
    names = {
        name for each in declared for name in re.findall(r"[A-Za-z]+", each.partition(" from")[0])
    }
    head = (skeleton / "templates" / "alone.mjs.j2").read_text().partition("const engine")[0]
    said = head.partition("has: ")[2]
    assert names and names <= set(re.findall(r"\w+", said))


def test_a_package_of_npm_has_its_name_and_version(tmp_path: Path) -> None:
    new = ["plugin", "new", "oimo", "--out", str(tmp_path / "new")]
    for wrong in ("", "oimophysics", "Oimo@1", "oimo physics@1", 'oimo@"1"'):
        assert main([*new, "--package", wrong]) == 2
    assert not (tmp_path / "new").exists()
    assert main([*new, "--package", "@its/oimo-physics@^1.2.2"]) == 0
    folder = tmp_path / "new" / "trebucheck_oimo"
    manifest = json.loads((folder / "node" / "package.json").read_text())
    assert manifest["dependencies"] == {"@its/oimo-physics": "^1.2.2"}
    assert '"@its/oimo-physics"' in (folder / "engine.py").read_text()


def test_a_template_that_is_filled_in_moves(skeleton: Path) -> None:
    """A body that turns at a constant rate about its centre: what the functions return is read."""
    _bring(skeleton)
    (skeleton / "templates" / "alone.mjs.j2").write_text(STATE + STEP)
    found = tb.engine("spinner", timestep=0.01).simulate(_rod())
    assert found.q[:, 0] == pytest.approx(0.3 + 2 * found.t, abs=1e-12)
    assert found.u[:, 0] == pytest.approx(2.0)
