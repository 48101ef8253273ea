"""Pinocchio against the reference, and what of a run is trebucheck's."""

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.registry import engine_class
from trebucheck.engines.supplied import Own, own, stated
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve
from trebucheck_pinocchio.engine import PinocchioEngine


def test_branches_are_added_depth_first() -> None:
    """With the bodies in the mechanism's order Pinocchio's mass matrix of two branches is wrong."""
    problem = benchmark("n-four-bar").problem().model_copy(update={"duration": 1.0})
    found = tb.engine("pinocchio", timestep=2e-3).simulate(problem)
    truth = solve(problem).trajectory(found.t)
    for name, motion in found.markers.items():
        assert np.abs(motion.position - truth.markers[name].position).max() < 1e-8


def test_it_has_no_preset_of_its_own() -> None:
    assert tuple(engine_class("pinocchio").presets()) == (ASSISTED,)
    for preset in (DEFAULT, SETTINGS):
        with pytest.raises(tb.InputError, match=ASSISTED):
            tb.engine("pinocchio", preset)


@pytest.mark.parametrize("scheme", ["RK4", "semi-implicit Euler"])
def test_its_runs_are_trebuchecks_steps(scheme: str) -> None:
    engine, mechanism = PinocchioEngine(scheme=scheme, locate_releases=False), tb.fixed()
    supplied = stated(engine, mechanism)
    assert supplied is not None and own(supplied) is Own.DYNAMICS
    with pytest.raises(tb.UnsupportedProblemError, match="time steps"):
        engine.script(tb.Problem(mechanism, duration=0.1))
