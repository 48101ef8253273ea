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
from trebucheck.reference.certification.constrained import integrate
from trebucheck.reference.certification.paper import PaperEquations, PaperMotion, PaperSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

PAPER = {False: PaperEquations(rolling=False), True: PaperEquations(rolling=True)}
ACTIVE_SETS = [(), ("hanger rest",), ("sling rest",), ("sling rest", "hanger rest")]

DURATION = 3.0
NEAR = 1e-7
"""Local errors of 1e-10, which the whip grows a thousand times or so."""


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


@pytest.mark.parametrize("rolling", [False, True], ids=["fixed", "rolling"])
def test_same_motion_energies_and_torques(rolling: bool) -> None:
    parameters = tb.TrebuchetParameters(theta0=0.05, m_a=800.0)
    system = PaperSystem(parameters, PAPER[rolling])
    other = PaperMotion(system, integrate(system, DURATION, 1e-10))
    problem = tb.Problem((tb.rolling if rolling else tb.fixed)(parameters), duration=DURATION)
    solution, times = solve(problem), np.linspace(0.0, DURATION, 8)
    assert other.release_times == pytest.approx(solution.release_times, abs=NEAR)
    moved, motion = solution.trajectory(times), solution.motion(times)
    points, kinematics = problem.mechanism.markers, solution.equations.kinematics
    for k, t in enumerate(times.tolist()):
        for found, right in zip(other.state(t), (moved.q[k], moved.u[k]), strict=True):
            assert found == pytest.approx(right, abs=NEAR)
        assert other.energy(t) == pytest.approx(moved.total_energy[k], rel=NEAR)
        torques = {name: values[k] for name, values in moved.stop_torques.items()}
        assert other.stop_torques(t) == pytest.approx(torques, rel=NEAR, abs=1e-3)
        for marker in points:
            exact = kinematics.point_motion(marker, motion.q, motion.u, motion.a)
            for found, right in zip(other.marker(marker.name, t), exact, strict=True):
                assert found == pytest.approx(right[k], abs=1e-5)
    launch, found = solution.launch, other.launch
    assert launch is not None and found is not None
    assert found.time == pytest.approx(launch.time, abs=NEAR)
    assert found.velocity == pytest.approx(launch.velocity, abs=1e-4)
