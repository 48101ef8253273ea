"""Exudyn's solver for accelerations fails: the run ends with a sentence instead of going on."""

from __future__ import annotations

from typing import Any

import pytest
import trebucheck as tb

pytestmark = pytest.mark.needs("exudyn")


class _Solver:
    """Exudyn's, which does as it is told at its first step."""

    raises = False

    def InitializeSolver(self, *_: Any) -> bool:  # noqa: N802
        if self.raises:
            raise RuntimeError("a page of text")
        return False

    def FinalizeSolver(self, *_: Any) -> None:  # noqa: N802
        pass


@pytest.mark.parametrize("raises", [False, True])
def test_accelerations_that_were_not_found_are_not_those_of_the_last_state(
    raises: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("exudyn")
    from trebucheck.engines.exudyn import solver

    monkeypatch.setattr(_Solver, "raises", raises)
    monkeypatch.setattr(solver.exu, "MainSolverImplicitSecondOrder", _Solver)
    with pytest.raises(tb.SimulationError, match=r"no accelerations at t = 0 s"):
        tb.engine("exudyn").simulate(tb.Problem(tb.fixed(), duration=0.05))
