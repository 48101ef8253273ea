"""Carriers in slots that close loops: the motion and the forces stay those of the mechanism."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.elements import SlotJoint
from trebucheck.models.library.registry import benchmark
from trebucheck_toolkit.slot_carriers import slot_forces, with_carriers


@pytest.mark.parametrize("name", ["slider-crank", "quick-return", "trammel"])
def test_motion_energies_and_forces_are_those_without_carriers(name: str) -> None:
    """The slot of the quick-return mechanism turns: its carrier has forces along it, too."""
    problem = benchmark(name).problem()
    problem = problem.model_copy(update={"duration": problem.duration / 10})
    mechanism, carried = problem.mechanism, with_carriers(problem.mechanism)
    slots = [joint.name for joint in mechanism.loop_joints if isinstance(joint, SlotJoint)]
    assert slots and len(carried.bodies) == len(mechanism.bodies) + len(slots)
    t = np.linspace(0.0, problem.duration, 20)
    told = tb.solve(problem).trajectory(t)
    found = tb.solve(problem.model_copy(update={"mechanism": carried})).trajectory(t)
    known = len(mechanism.coordinates)
    # Of two references to 1e-12 of their coordinates each.
    assert found.q[:, :known] == pytest.approx(told.q, rel=1e-9, abs=1e-9)
    assert found.kinetic_energy == pytest.approx(told.kinetic_energy, rel=1e-8, abs=1e-8)
    forces = slot_forces(mechanism, found.joint_reactions)
    assert forces.keys() == told.joint_reactions.keys()
    for joint, force in told.joint_reactions.items():
        assert forces[joint] == pytest.approx(force, rel=1e-7, abs=1e-7), joint


def test_a_body_that_no_mass_can_be_taken_from_is_refused() -> None:
    mechanism = benchmark("slider-crank").problem().mechanism
    slot = next(joint for joint in mechanism.loop_joints if isinstance(joint, SlotJoint))
    thin = [
        body.model_copy(
            update={"inertia": 1e-6 * body.inertia if body.name == slot.child else body.inertia}
        )
        for body in mechanism.bodies
    ]
    with pytest.raises(tb.UnsupportedProblemError, match=slot.name):
        with_carriers(mechanism.model_copy(update={"bodies": tuple(thin)}))


def test_a_mechanism_without_such_slots_stays_as_it_is() -> None:
    mechanism = benchmark("n-four-bar").problem().mechanism
    assert with_carriers(mechanism).bodies == mechanism.bodies
    assert slot_forces(mechanism, {"pivot 0": 1.0}) == {"pivot 0": 1.0}
