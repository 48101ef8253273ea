"""`make importers`: what is installed is stated to the version, and one that cannot run costs only
itself.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

IMPORTERS = Path(__file__).parents[2] / "importers"
ADAPTERS = sorted(path.parent for path in IMPORTERS.glob("*/load.py"))


@pytest.fixture
def runner() -> Any:
    spec = importlib.util.spec_from_file_location("importers_run", IMPORTERS / "run.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("folder", ADAPTERS, ids=lambda path: path.name)
def test_requirements_state_versions_and_a_size(folder: Path) -> None:
    lines = (folder / "requirements.txt").read_text().splitlines()
    assert re.fullmatch(r"# about \d+ MB", lines[0])
    stated = [line for line in lines if not line.startswith("#")]
    assert stated and all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in stated)


@pytest.mark.parametrize(
    "path", sorted(IMPORTERS.glob("*/results.json")), ids=lambda path: path.parent.name
)
def test_results_name_no_place_on_a_machine(path: Path) -> None:
    assert not re.search(r"/(?:tmp|home|root|work|Users|var)/", path.read_text())


def test_one_that_cannot_be_installed_or_run_costs_only_itself(
    runner: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[str] = []

    def environment(name: str) -> Path:
        if name == "drake":
            raise runner.CannotRunError("cannot be installed")
        return Path(name)

    def check(_: str, name: str, python: Path) -> None:
        assert python == Path(name)
        if name == "mjx":
            raise runner.CannotRunError("the check ended with exit code 2")
        ran.append(name)

    monkeypatch.setattr(runner, "environment", environment)
    monkeypatch.setattr(runner, "check", check)
    assert runner.main("trebucheck", "dart", "drake", "mjx", "newton") == 1
    told = capsys.readouterr()
    assert ran == ["dart", "newton"] and "newton (4 of 4)" in told.out
    assert told.err.splitlines() == [
        "drake: cannot be installed; its results are as they were.",
        "mjx: the check ended with exit code 2; its results are as they were.",
    ]
    assert runner.main("trebucheck", "griffin") == 2
    assert "no importer 'griffin'" in capsys.readouterr().err
    assert runner.main("trebucheck", "dart") == 0


def test_what_pip_says_becomes_a_sentence(runner: Any) -> None:
    said = (
        "WARNING: x\nERROR: Could not find a version\nERROR: No matching distribution found "
        "for "
        "drake==1.51.1\n"
    )
    assert re.fullmatch(
        r"cannot be installed with Python [\d.]+ on \w+ \w+: there is no wheel of drake==1.51.1",
        runner.failed_installation(said),
    )
    assert runner.failed_installation("ERROR: no space left").endswith(": no space left")
