"""Sums over a mechanism's force elements: generalized forces, forces on bodies, energy and power.

The formulas stand with the elements (:mod:`.elements`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, Literal

import numpy as np

from .arrays import ComplexArray, FloatArray, IndexArray
from .elements import (
    GROUND,
    AnyForceElement,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SpringDamper,
)
from .functions import AngleFunction, PointCoefficients
from .kinematics import Kinematics

_Linear = (
    RotationalSpringDamper
    | CubicTorsionSpring
    | ConstantTorque
    | RotorInertia
    | SlideInertia
    | SlideSpringDamper
    | RecordedForce
    | RecordedTorque
)


@dataclass(frozen=True)
class AppliedForces:
    """Forces of a mechanism's force elements; states are shaped (..., n_q)."""

    kinematics: Kinematics

    @cached_property
    def springs(self) -> tuple[tuple[SpringDamper, PointCoefficients], ...]:
        """Elements along a vector between two points, with that vector."""
        return self._along("vector")

    @cached_property
    def rotational(self) -> tuple[tuple[_Linear, AngleFunction], ...]:
        """Elements between angles, with the body's angle less the other's, or along slides."""
        return self._along("angle")

    @cached_property
    def forces(self) -> tuple[tuple[ConstantForce, PointCoefficients], ...]:
        """Elements on a point, with that point."""
        return self._along("point")

    def _along(self, direction: Literal["vector", "angle", "point"]) -> Any:
        elements = self.kinematics.mechanism.force_elements
        chosen = [element for element in elements if element.acts_along == direction]
        return tuple((element, element.direction(self.kinematics)) for element in chosen)

    def at_times(self, t: FloatArray) -> Iterator[tuple[IndexArray, AppliedForces]]:
        """Indices of times (n,) [s] between the same instants, and the forces that act there."""
        for indices, mechanism in self.kinematics.mechanism.at_times(t):
            is_own = mechanism is self.kinematics.mechanism
            yield indices, self if is_own else AppliedForces(Kinematics(mechanism))

    @property
    def terms(self) -> tuple[tuple[AnyForceElement, Any], ...]:
        """Elements, each with what it acts along, in the order of the sums.

        The order decides the last bits of a sum.
        """
        return (*self.springs, *self.rotational, *self.forces)

    def generalized(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray | None = None
    ) -> FloatArray:
        """Generalized forces of all elements [N m or N], shape (..., n_q)."""
        total = np.zeros(q.shape if q.shape == u.shape else np.broadcast_shapes(q.shape, u.shape))
        if not self.kinematics.mechanism.force_elements:
            return total
        rates = self.kinematics.rates(q) if rates is None else rates
        for element, direction in self.terms:
            total += element.generalized(self.kinematics, direction, q, u, rates)
        return total

    def on_bodies(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Resultant force of the elements on each body, in the world [N], shape (..., 2).

        Bodies that no element acts on with a force are left out.
        """
        terms = (e.body_forces(self.kinematics, along, q, u) for e, along in self.terms)
        return _resultants(chain.from_iterable(terms))

    def inertial_on_bodies(self, q: FloatArray, a: FloatArray) -> dict[str, FloatArray]:
        """Resultant force on each body by accelerations a, as :meth:`on_bodies`."""
        terms = (e.inertial_forces(self.kinematics, along, q, a) for e, along in self.terms)
        return _resultants(chain.from_iterable(terms))

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Energy that the elements store [J], shape (...,)."""
        total = np.zeros(q.shape[:-1])
        for element, direction in self.terms:
            total += element.potential_energy(self.kinematics, direction, q)
        return total

    def power(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Power of dampers, constant forces and torques [W], shape (...,).

        Kinetic and potential energy (of gravity and springs) change by its time integral.
        """
        total = np.zeros(q.shape[:-1])
        for element, direction in self.terms:
            total += element.power(self.kinematics, direction, q, u)
        return total


def _resultants(terms: Iterable[tuple[str, ComplexArray]]) -> dict[str, FloatArray]:
    """Sum of the forces on each body but the ground [N], shape (..., 2)."""
    forces: dict[str, FloatArray] = {}
    for body, force in terms:
        if body != GROUND:
            vector = np.stack([force.real, force.imag], axis=-1)
            forces[body] = forces.get(body, 0.0) + vector
    return forces
