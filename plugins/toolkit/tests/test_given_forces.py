"""Forces given to bodies against the generalized forces of the same elements."""

from __future__ import annotations

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import benchmark
from trebucheck_toolkit.given_forces import GivenForces, program


class _Powers:
    """Bodies of a mechanism in a state, that sum up the power of what they are given."""

    def __init__(self, mechanism: tb.Mechanism, q: FloatArray, u: FloatArray) -> None:
        self.mechanism, self.q, self.u = mechanism, q, u
        self.kinematics, self.power = Kinematics(mechanism), 0.0

    def centre(self, name: str) -> tuple[complex, complex]:
        row = self.kinematics.point(name, self.mechanism.body(name).centre)
        place = self.kinematics.position(row, self.q)
        return complex(*place), complex(*self.kinematics.velocity(row, self.q, self.u))

    def push(self, name: str, place: complex, force: complex) -> None:
        (centre, speed), turning = self.centre(name), self._turning(name)
        self.power += (force.conjugate() * (speed - 1j * turning * (place - centre))).real

    def twist(self, name: str, torque: float) -> None:
        self.power += torque * self._turning(name)

    def _turning(self, name: str) -> float:
        return float(self.kinematics.angle(name).coefficients @ self.u)


def bead() -> tb.Mechanism:
    """A block that a spring, a damper and a motor hold on a rod that swings."""
    spring = tb.SlideSpringDamper(
        name="spring", body="block", relative_to="rod", coordinate="s", stiffness=90.0, damping=3.0,
        rest_position=0.3, force=7.0,
    )  # fmt: skip
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0.1, 0.2), child_point=(0.0, 0.1)
    )
    rail = tb.PrismaticJoint(
        name="rail", parent="rod", child="block", parent_point=(0.1, 0.2), child_point=(0.3, 0.0),
        axis=(0.8, 0.6), coordinate="s", angle=0.4,
    )  # fmt: skip
    return tb.Mechanism(
        name="bead",
        bodies=(
            tb.Body(name="rod", angle="b", mass=1.0, centre=(0.5, 0.1), inertia=0.08),
            tb.Body(name="block", mass=2.5, centre=(0.1, 0.0), inertia=0.1),
        ),
        joints=(pin, rail),
        force_elements=(spring,),
        gravity=9.81,
        start=(0.4, 0.3),
    )


MECHANISMS = [
    *(
        benchmark(name).problem().mechanism
        for name in ("squeezer", "motor", "thrown-plate", "spring-pendulum", "damped-oscillator")
    ),
    bead(),
]


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda mechanism: mechanism.name)
def test_their_power_is_that_of_the_elements_and_the_program_gives_the_same(
    mechanism: tb.Mechanism,
) -> None:
    rng = np.random.default_rng(26)
    q = np.array(mechanism.start) + 0.1 * rng.normal(size=len(mechanism.coordinates))
    u = rng.normal(size=len(q))
    bodies = _Powers(mechanism, q, u)
    GivenForces(mechanism).give(bodies, q, u)
    generalized = AppliedForces(bodies.kinematics).generalized(q, u)
    scale = float(np.abs(generalized) @ np.abs(u))
    assert bodies.power == pytest.approx(float(generalized @ u), abs=1e-12 * scale)
    definitions, statements = program(mechanism)
    again = _Powers(mechanism, q, u)
    known = {"centre": again.centre, "push": again.push, "twist": again.twist, "q": q, "u": u}
    exec("\n".join(["import cmath", *definitions, *statements]), known)
    assert again.power == bodies.power
