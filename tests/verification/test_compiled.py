"""The equations in machine code against NumPy's, and a motion with them against one without."""

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything
from trebucheck.models.kinematics import initial_state
from trebucheck.reference import compiled
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

pytest.importorskip("numba", reason="Numba is not installed: the equations are NumPy's")

_ROUNDING = (
    1e-12  # of the largest: some hundred roundings of matrices that lose two or three digits
)


def _machines() -> list[tb.Mechanism]:
    return [
        tb.fixed(),
        tb.rolling(),
        tb.hinged(),
        tb.floating_arm(),
        everything().model_copy(update={"force_elements": ()}),
    ]


@pytest.mark.parametrize("mechanism", _machines(), ids=lambda m: m.name)
def test_accelerations_and_multipliers_are_numpys(
    mechanism: tb.Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    random, (q, u) = np.random.default_rng(4), initial_state(mechanism)
    states = q + random.uniform(-0.3, 0.3, (5, len(q))), u + random.uniform(-1, 1, (5, len(u)))
    for closed in ((), tuple(stop.name for stop in mechanism.stops if stop.closed)):
        equations = Equations(mechanism)
        assert equations.compiled(q, closed) is not None
        quick = equations.solve(*states, closed)
        with monkeypatch.context() as patch:
            patch.setattr(compiled, "is_available", lambda: False)
            slow = Equations(mechanism).solve(*states, closed)
        for ours, numpys in zip(quick, slow, strict=True):
            assert ours == pytest.approx(numpys, abs=_ROUNDING * np.abs(numpys).max(initial=1.0))


def test_motion_is_that_of_scipys_integrator(monkeypatch: pytest.MonkeyPatch) -> None:
    """Same method, same choice of steps.

    The same evaluations, releases and states, but for rounding.
    """
    problem = tb.Problem(tb.rolling(), duration=2.6)
    quick = solve(problem, 1e-9, 1e-9)
    monkeypatch.setattr(compiled, "is_available", lambda: False)
    slow = solve(problem, 1e-9, 1e-9)
    assert quick.evaluations == slow.evaluations
    assert quick.release_times == pytest.approx(slow.release_times, abs=1e-11)
    t = np.linspace(0.0, 2.6, 101)
    assert quick.motion(t).q == pytest.approx(
        slow.motion(t).q, abs=1e-9
    )  # stretched 43 times by the launch


def test_body_without_inertia_about_its_pin_has_one_sentence() -> None:
    body = tb.Body(name="b", angle="a", mass=1.0, centre=(0, 0), inertia=0.0)
    pin = tb.PinJoint(name="p", parent="ground", child="b", parent_point=(0, 0), child_point=(0, 0))
    mechanism = tb.Mechanism(name="m", bodies=(body,), joints=(pin,), gravity=9.81, start=(0.0,))
    with pytest.raises(tb.SimulationError, match="no unique accelerations"):
        solve(tb.Problem(mechanism, duration=1.0))
