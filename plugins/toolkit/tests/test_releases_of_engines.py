"""The releases of an engine with which its program runs, of programs that are written here."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

PLUGINS = Path(__file__).parents[2]
RIGHT = "import numpy; print('loading'); q = numpy.array([[0.5], [0.25]])"
SAME = "import numpy; q = numpy.array([[0.5], [0.25001]])"
ELSEWHERE = "import numpy; q = numpy.array([[0.5], [0.3]])"
LONGER = "import numpy; q = numpy.array([[0.5], [0.25], [0.1]])"


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What is found of programs by their releases, of which 1.2 is the tested one."""
    monkeypatch.syspath_prepend(PLUGINS)
    releases = importlib.import_module("releases")

    class Kept(releases.Pypi):
        def __init__(self, programs: Mapping[str, str]) -> None:
            super().__init__("its-package")
            self.programs = programs

        def releases(self) -> list[str]:
            return list(self.programs)

        def install(self, release: str, folder: str) -> None:
            if not self.programs[release]:
                raise RuntimeError
            self.installed = self.programs[release]

        def moved(self, program: str, folder: str) -> Any:
            return super().moved(program or self.installed, folder)

    monkeypatch.setattr(releases, "_python", lambda folder: sys.executable)
    return lambda programs: releases.since(Kept(programs), "1.2", "")


@pytest.mark.parametrize(
    ("before", "how"),
    [
        ("import json; json.gone", "fails: module 'json' has no attribute 'gone'"),
        ("import os; os.abort()", "fails: it ended without a result"),
        (ELSEWHERE, "is off by 2.4e-02 of the swing"),
        (LONGER, "takes other steps"),
        ("", "could not be installed"),
    ],
)
def test_the_row_ends_with_the_first_release_that_differs(
    found: Any, before: str, how: str
) -> None:
    programs = {"1.0": before, "1.1-beta": before, "1.1": SAME, "1.2": RIGHT, "2.0": ELSEWHERE}
    told = found(programs)
    assert told["since"] == "1.1" and told["before"] == "1.0"
    words = (told["how"], told.get("error", "").removeprefix("AttributeError: "))
    assert ": ".join(filter(None, words)) == how


def test_where_all_are_the_same_there_is_none_before(found: Any) -> None:
    told = found({"1.1": SAME, "1.2": RIGHT})
    assert told["since"] == "1.1" and told["before"] is None


def test_a_tested_release_that_does_not_run_is_since_none(found: Any) -> None:
    told = found({"1.1": RIGHT, "1.2": "raise ValueError"})
    assert told["since"] is None and told["before"] == "1.2"
