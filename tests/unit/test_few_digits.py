"""The model check of engines whose numbers have 24 bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.equations import Equations

SINGLE = float(np.finfo(np.float32).eps / 2)


@dataclass
class Rounded:
    """The reference's equations, said in single precision, of a mechanism whose first body is too
    heavy by a part.
    """

    fault: float = 0.0
    roundoff: float = SINGLE
    name = "rounded"
    capabilities = ReferenceEngine.capabilities

    def inspect(self, mechanism: tb.Mechanism, states: tuple[State, ...]) -> Inspection:
        first = mechanism.bodies[0]
        heavy = first.model_copy(update={"mass": first.mass * (1 + self.fault)})
        equations = Equations(
            mechanism.model_copy(update={"bodies": (heavy, *mechanism.bodies[1:])})
        )
        return Inspection(
            start=np.float32(mechanism.start),
            start_speeds=np.float32(mechanism.start_speeds or np.zeros(len(mechanism.start))),
            dynamics=tuple(self._dynamics(equations, state) for state in states),
            roundoff=self.roundoff,
        )

    @staticmethod
    def _dynamics(equations: Equations, state: State) -> Dynamics:
        accelerations, torques = equations.solve(state.q, state.u, state.closed)
        return Dynamics(
            accelerations=np.float32(accelerations),
            stop_torques=dict(
                zip(state.closed, np.float32(torques[equations.n_loops :]).tolist(), strict=True)
            ),
            mass_matrix=np.float32(equations.mass_matrix(state.q)),
            forces=np.float32(equations.forces(state.q, state.u)),
        )


MECHANISMS = [tb.fixed(), tb.rolling(), benchmark("spring-pendulum").problem().mechanism]


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda each: each.name)
def test_rounding_to_24_bits_is_no_fault_of_an_engine_that_says_so(mechanism: tb.Mechanism) -> None:
    engine: Any = Rounded()
    assert check_model(engine, mechanism).holds
    claims_more: Any = Rounded(roundoff=2.0**-53)
    assert not check_model(claims_more, mechanism).holds


@pytest.mark.parametrize("mechanism", MECHANISMS[:2], ids=lambda each: each.name)
def test_a_fault_of_a_thousandth_is_found_all_the_same(mechanism: tb.Mechanism) -> None:
    engine: Any = Rounded(fault=1e-3)
    found = check_model(engine, mechanism)
    assert "mass matrix" in {check.name for check in found.checks if not check.holds}
