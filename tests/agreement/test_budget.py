"""Error budgets of the real engines: nine tenths of every error have a name.

Steps are longer than the presets' own, where runs are dear, so that the whole takes seconds.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import again
from trebucheck.comparisons.explain import Budget, Share, budget, causes_of, with_filtered_torques
from trebucheck.comparisons.runs.record import EngineRuns
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.engines.registry import engine, engine_class, with_options
from trebucheck.models.library.trebuchet import HANGER_REST, TrebuchetParameters, fixed, rolling
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem

EXPLAINED = 0.9  # the stated need
_STEPS = {"mujoco": 4e-3, "pymunk": 4e-3, "exudyn": 4e-3}

# Away from Table I in every length, mass and start angle, one of each kind: all stops push at the
# start.
OTHERS = {
    "fixed": TrebuchetParameters(
        l1=8.6,
        l2=4.9,
        r=7.2,
        h=8.4,
        m_b=57.0,
        m_cw=3700.0,
        m_a=850.0,
        theta0=0.09,
        phi0=3.21,
        alpha0=-0.51,
    ),
    "rolling": TrebuchetParameters(
        l1=11.1,
        l2=4.0,
        r=6.5,
        h=11.9,
        m_b=120.0,
        m_cw=3570.0,
        m_a=1860.0,
        theta0=0.01,
        phi0=3.23,
        alpha0=-0.49,
    ),
}


@pytest.fixture(scope="module")
def machines() -> dict[str, EngineRuns]:
    """Runs by machine, remembered over all tests."""
    made: dict[str, Mechanism] = {"fixed": fixed(), "rolling": rolling()}
    made |= {"other fixed": fixed(OTHERS["fixed"]), "other rolling": rolling(OTHERS["rolling"])}
    return {name: EngineRuns(Runner(machine)) for name, machine in made.items()}


def _budget(trials: EngineRuns, name: str, preset: str) -> Budget:
    if not engine_class(name).is_installed():
        pytest.skip(f"{name} is not installed here")
    return budget(trials, engine(name, preset, timestep=_STEPS[name]))


def _share(found: Budget, quantity: str, cause: str) -> Share:
    of = found.quantity(quantity)
    assert of is not None
    return next(share for share in of.shares if share.cause == cause)


def _check(found: Budget) -> None:
    assert found.message is None
    assert not [cause for cause in found.causes if cause.message]
    for name in ("position", f"{HANGER_REST} torque"):
        quantity = found.quantity(name)
        assert quantity is not None and quantity.explained is not None
        assert quantity.explained >= EXPLAINED, (name, quantity.explained)
        fractions = [share.fraction or 0.0 for share in (*quantity.shares, quantity.rest)]
        assert math.fsum(fractions) == pytest.approx(
            1.0, abs=1e-9
        )  # rounding of sums over a thousand times


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "name", "preset"),
    [
        *(("fixed", name, preset) for name in _STEPS for preset in ("assisted", "default")),
        pytest.param("rolling", "mujoco", "default", marks=again),
        pytest.param("rolling", "exudyn", "assisted", marks=again),
        pytest.param("rolling", "mujoco", "assisted", marks=again),
        pytest.param("rolling", "pymunk", "assisted", marks=again),
        pytest.param("rolling", "pymunk", "default", marks=again),
        pytest.param("rolling", "exudyn", "default", marks=again),
    ],
)
def test_nine_tenths_of_each_error_are_explained(
    machines: dict[str, EngineRuns], machine: str, name: str, preset: str
) -> None:
    _check(_budget(machines[machine], name, preset))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "name", "preset"),
    [
        pytest.param("other fixed", "mujoco", "default", marks=again),
        pytest.param("other fixed", "pymunk", "assisted", marks=again),
        ("other rolling", "exudyn", "assisted"),
    ],
)
def test_on_another_machine_too(
    machines: dict[str, EngineRuns], machine: str, name: str, preset: str
) -> None:
    _check(_budget(machines[machine], name, preset))


@pytest.mark.slow
def test_the_causes_are_the_ones_that_are_known(machines: dict[str, EngineRuns]) -> None:
    """What each engine's documentation and equations say of it."""
    trials = machines["fixed"]
    softness = _share(_budget(trials, "mujoco", "assisted"), "position", "constraint softness")
    assert (softness.fraction or 0.0) > 0.9
    # Linear in 1 - d: doubling it tells the same share as a true removal, but for the 1/64 that
    # this one leaves.
    assert softness.second == pytest.approx((softness.fraction or 0.0) * 64 / 63, rel=0.01)
    assert (
        _share(_budget(trials, "pymunk", "assisted"), "position", "time step").fraction or 0.0
    ) > 0.9
    # A limit of Chipmunk's has no force at the start, and in its first step that of two; shorter
    # steps, taken out last, have nothing left to take.
    limit = _share(
        _budget(trials, "pymunk", "settings"), f"{HANGER_REST} torque", "documented elements"
    )
    assert (limit.first or 0.0) > 0.9
    located = _share(
        _budget(trials, "exudyn", "default"), f"{HANGER_REST} release", "event location"
    )
    assert (located.fraction or 0.0) > 0.9


def test_softness_written_out_is_the_softness_that_follows_the_step() -> None:
    """The time step is refined with limits that stay as they were.

    First they must be as they were.
    """
    pytest.importorskip("mujoco")
    for integrator in ("RK4", "Euler"):
        assisted = MujocoEngine(integrator=integrator)
        finer = next(c for c in causes_of(assisted) if c.name == "time step").options
        written = with_options(assisted, {"solref": finer["solref"]})
        problem = Problem(fixed(), duration=0.2)
        assert np.array_equal(assisted.simulate(problem).q, written.simulate(problem).q)


def test_exudyns_multipliers_alternate_and_the_filter_finds_it() -> None:
    """Half of the assisted torque's error changes sign with every step.

    What the filter leaves is smooth.
    """
    pytest.importorskip("exudyn")
    trials = EngineRuns(Runner(rolling()))
    run = engine("exudyn", timestep=1e-3).simulate(Problem(rolling(), duration=0.5))
    exact = trials.solution.trajectory(run.t).stop_torque(HANGER_REST)
    raw = (run.stop_torque(HANGER_REST) - exact)[3:-3]
    filtered = (with_filtered_torques(run).stop_torque(HANGER_REST) - exact)[3:-3]
    rough, smooth = (np.abs(np.diff(values)).mean() for values in (raw, filtered))
    assert (
        smooth < 0.1 * rough
    )  # an alternating error jumps by twice itself at each step, a smooth one by order h
    assert np.sqrt(np.mean(filtered**2)) < np.sqrt(np.mean(raw**2))
