"""Results show themselves by the installed renderer, or by what a distribution registers."""

from __future__ import annotations

import subprocess
import sys

import pytest
from trebucheck.comparisons.report import pages
from trebucheck.comparisons.report.document import Document
from trebucheck.models.shown import Reported, report_with

_ALONE = """
import sys
import trebucheck as tb
assert not any(name.startswith("trebucheck.comparisons") for name in sys.modules)
motion = tb.engine("reference").simulate(tb.Problem(tb.model("pendulum"), duration=0.2))
assert motion.document().title.startswith("pendulum")
assert motion.animate()._repr_html_().startswith("<iframe")
assert motion.plot().axes
"""


@pytest.mark.slow
def test_importing_the_package_alone_is_enough_and_imports_no_report() -> None:
    found = subprocess.run(
        [sys.executable, "-c", _ALONE], check=False, capture_output=True, text=True
    )
    assert found.returncode == 0, found.stderr


class _Result(Reported):
    def headline(self) -> str:
        return "result"


def test_a_result_without_a_report_is_named() -> None:
    with pytest.raises(TypeError, match="_Result"):
        pages.document(_Result())


def test_a_distribution_registers_the_report_of_its_own_results() -> None:
    class _Other(_Result):
        pass

    report_with(_Other, lambda result: Document(f"page of {result}", ()))
    assert _Other().document().title == "page of result"
    assert "page of result" in _Other()._repr_html_()
