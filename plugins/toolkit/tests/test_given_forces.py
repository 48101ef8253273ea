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


@pytest.mark.parametrize(
    "name", ["squeezer", "motor", "thrown-plate", "spring-pendulum", "damped-oscillator"]
)
def test_their_power_is_that_of_the_elements_and_the_program_gives_the_same(name: str) -> None:
    mechanism = benchmark(name).problem().mechanism
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
