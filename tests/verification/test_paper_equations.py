"""The paper's Lagrangian, differentiated by SymPy, against the equations derived from the
mechanism.
"""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from hypothesis import strategies as st
from trebucheck.reference.certification.paper import PaperEquations
from trebucheck.reference.equations import Equations

PAPER = {False: PaperEquations(rolling=False), True: PaperEquations(rolling=True)}
ACTIVE_SETS = [(), ("hanger rest",), ("sling rest",), ("sling rest", "hanger rest")]


@pytest.mark.slow
@pytest.mark.parametrize("rolling", [False, True], ids=["fixed", "rolling"])
@pytest.mark.parametrize("closed", ACTIVE_SETS, ids=["free", "hanger", "sling", "both"])
@given(parameters=machine_parameters(), seed=st.integers(0, 2**32 - 1))
def test_same_accelerations_and_multipliers(
    rolling: bool, closed: tuple[str, ...], parameters: tb.TrebuchetParameters, seed: int
) -> None:
    n_q = 4 if rolling else 3
    random = np.random.default_rng(seed)
    q, u = random.uniform(-np.pi, np.pi, n_q), random.normal(0.0, 4.0, n_q)
    equations = Equations((tb.rolling if rolling else tb.fixed)(parameters))
    mine = equations.solve(q, u, closed)
    sling, hanger = "sling rest" in closed, "hanger rest" in closed
    accelerations, multipliers = PAPER[rolling].solve(parameters, q, u, sling, hanger)
    # Rounding, magnified by the condition of the mass matrix (some 1e5 where sling and arm align).
    assert mine[0] == pytest.approx(accelerations, rel=1e-9, abs=1e-9)
    # The paper's G1 is minus the sling's gap, its G2 is the hanger's gap.
    signs = [sign for sign, held in ((-1.0, sling), (1.0, hanger)) if held]
    assert mine[1] * signs == pytest.approx(multipliers, rel=1e-9, abs=1e-6)
