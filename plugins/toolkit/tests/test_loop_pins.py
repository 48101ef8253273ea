"""Forces of pins that close loops, from the resultants on the bodies that they are on."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, PinJoint
from trebucheck.models.library.registry import benchmark
from trebucheck_toolkit.loop_pins import LoopPins, left_over

INSTANTS = 3


def _mechanism(name: str) -> tb.Mechanism:
    return benchmark(name).problem().mechanism


@pytest.mark.parametrize("name", ["n-four-bar", "squeezer", "three-cranks"])
def test_forces_of_pins_are_what_the_motion_needs_beside_all_others(name: str) -> None:
    """Also where the mechanism is overconstrained: the other joints' forces are known."""
    mechanism, rng = _mechanism(name), np.random.default_rng(7)
    reactions = {joint.name: rng.normal(size=(INSTANTS, 2)) for joint in mechanism.joints}
    applied = {mechanism.bodies[0].name: rng.normal(size=(INSTANTS, 2))}
    accelerations: dict[str, FloatArray] = {}
    for body in mechanism.bodies:
        force = applied.get(body.name, 0.0) + body.mass * np.array(mechanism.gravity_vector)
        for joint in mechanism.joints:
            if body.name in (joint.child, joint.parent):
                force = force + (1 if body.name == joint.child else -1) * reactions[joint.name]
        accelerations[body.name] = np.asarray(force) / body.mass
    closing = {joint.name for joint in mechanism.loop_joints}
    pins = LoopPins(mechanism, "the engine")
    told = {name: force for name, force in reactions.items() if name not in closing}
    asked = {name: accelerations[name] for name in pins.bodies}
    found = pins.forces(left_over(mechanism, asked, told, applied))
    assert found.keys() == closing
    for pin in closing:
        assert found[pin] == pytest.approx(reactions[pin], rel=1e-10)


def test_pins_that_form_a_closed_chain_by_themselves_are_refused() -> None:
    mechanism = _mechanism("n-four-bar")
    (closing,) = mechanism.loop_joints
    assert isinstance(closing, PinJoint) and GROUND not in (closing.child, closing.parent)
    second = closing.model_copy(update={"name": "second"})
    doubled = mechanism.model_copy(update={"joints": (*mechanism.joints, second)})
    with pytest.raises(tb.UnsupportedProblemError, match=r"our adapter of the engine.*second"):
        LoopPins(doubled, "the engine")


def test_without_loops_there_are_no_pins() -> None:
    pins = LoopPins(_mechanism("pendulum"), "the engine")
    assert pins.bodies == [] and pins.forces({}) == {}
