"""An engine of npm: whether it is here, how it is installed, and what its program takes and gives.

Programs of a few lines stand for Node.js and npm.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from trebucheck.models.errors import SimulationError
from trebucheck_toolkit.node_package import ARRAYS, NodePackage


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> NodePackage:
    """A package that is not installed, without Node.js and npm on the path."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "plug-in").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    return NodePackage("Cube 2D", "@cubes/cube", "cubes", tmp_path / "plug-in")


def program(package: NodePackage, name: str, text: str) -> None:
    path = package.folder.parent / "bin" / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def unpack(package: NodePackage) -> None:
    folder = package.folder / "node_modules" / "@cubes" / "cube"
    folder.mkdir(parents=True)
    (folder / "package.json").write_text(json.dumps({"version": "1.2.3"}))


def test_a_package_is_installed_if_it_and_node_are_here(package: NodePackage) -> None:
    assert not package.is_installed() and "no program `node`" in package.absence()
    unpack(package)
    assert not package.is_installed() and package.version() == "not installed"
    program(package, "node", "exit 0")
    assert package.is_installed() and package.version() == "1.2.3"


def test_a_package_without_its_folder_is_brought_by_a_command(package: NodePackage) -> None:
    program(package, "node", "exit 0")
    assert not package.is_installed() and package.version() == "not installed"
    assert "`python -m cubes`" in package.absence()


def test_npm_installs_in_the_folder_and_its_exit_code_is_told(package: NodePackage) -> None:
    with pytest.raises(SystemExit, match="no program `npm`"):
        package.install()
    for code in (0, 3):
        program(package, "npm", f"echo $1 in $PWD >> asked; exit {code}")
        with pytest.raises(SystemExit) as ended:
            package.install()
        assert ended.value.code == code
    assert (package.folder / "asked").read_text() == 2 * f"install in {package.folder}\n"


def test_what_programs_write_arrays_with_is_installed() -> None:
    assert "module.exports" in ARRAYS.read_text()


def test_arrays_are_those_that_the_program_writes(package: NodePackage) -> None:
    states = np.arange(6.0).reshape(3, 2) / 7
    shape = json.dumps({"states": states.shape}).encode() + b"\n"
    (package.folder / "states").write_bytes(shape + states.astype("<f8").tobytes())
    # It does not end by itself: what it has written is enough.
    program(
        package,
        "node",
        f"PATH={os.defpath}; cat > asked; echo $1 $2 > arguments; cat states; sleep 600",
    )
    assert np.array_equal(package.arrays("run();")["states"], states)
    assert (package.folder / "asked").read_text() == "run();"
    assert (package.folder / "arguments").read_text().split() == ["--input-type=module", "-"]


def test_a_program_that_fails_is_an_error_with_its_last_words(package: NodePackage) -> None:
    program(package, "node", "echo the cubes are gone >&2; exit 1")
    with pytest.raises(SimulationError, match="Cube 2D failed: the cubes are gone"):
        package.arrays("run();")


def test_a_program_that_ends_within_its_arrays_is_an_error(package: NodePackage) -> None:
    program(package, "node", """echo '{"states": [3, 2]}'; echo out of cubes >&2; exit 1""")
    with pytest.raises(SimulationError, match="Cube 2D failed: out of cubes"):
        package.arrays("run();")


MOVING = """
import sys
from pathlib import Path
from trebucheck_toolkit.node_package import NodePackage

getattr(NodePackage("Cube 2D", "@cubes/cube", "cubes", Path(sys.argv[1])), sys.argv[2])("")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process with its parent")
@pytest.mark.parametrize("call", ["arrays", "run"])
def test_a_program_ends_with_the_process_that_started_it(package: NodePackage, call: str) -> None:
    """Also where that is killed, and can end nothing itself."""
    program(package, "node", f"PATH={os.defpath}; echo $$ >> began; exec sleep 600")
    began = package.folder / "began"
    script = [sys.executable, "-c", MOVING, str(package.folder), call]
    with subprocess.Popen(script) as started:
        while not began.exists() or not began.read_text().endswith("\n"):
            assert started.poll() is None
            time.sleep(0.01)
        started.kill()
    place, deadline = Path("/proc", began.read_text().strip()), time.monotonic() + 5.0
    while place.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not place.exists()
