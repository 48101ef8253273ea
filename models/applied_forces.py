r"""Forces of springs, dampers and motors on a mechanism: generalized forces, forces on bodies, energy and power.

With the generalized direction g of an element (the gradient of a length, an angle or a point's
place) and its effort f,

    spring and damper between points    f = -(k (l - l_0) + c dl/dt)     g = dl/dq
    the same between two angles         f = -(k (b - b_0) + c db/dt)     g = db/dq
    constant force F on a point         Q = Re(conj(F) dz/dq)
    constant torque                     f = T                            g = db/dq

and its generalized force is Q = f g. A spring without damping and rest length has Q = -k Re(conj(d)
dd/dq) of the vector d between its points, which is smooth where they meet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import ComplexArray, FloatArray
from .force_elements import ConstantForce, ConstantTorque, RotationalSpringDamper, SpringDamper
from .joints import GROUND
from .kinematics import Kinematics
from .phasors import PointCoefficients
from .scalar_functions import AngleFunction


@dataclass(frozen=True)
class AppliedForces:
    """Of a mechanism's force elements; states are shaped (..., n_q)."""

    kinematics: Kinematics

    @cached_property
    def springs(self) -> tuple[tuple[SpringDamper, PointCoefficients], ...]:
        """Springs and dampers between points, with the vector to the body's point."""
        between = self.kinematics.between
        return tuple(
            (e, between(e.body, e.point, e.relative_to, e.relative_point))
            for e in self.kinematics.mechanism.force_elements
            if isinstance(e, SpringDamper)
        )

    @cached_property
    def rotational(
        self,
    ) -> tuple[tuple[RotationalSpringDamper | ConstantTorque, AngleFunction], ...]:
        """Springs, dampers and motors between angles, with the body's angle less the other's."""
        return tuple(
            (e, self.kinematics.angle(e.body, e.relative_to))
            for e in self.kinematics.mechanism.force_elements
            if isinstance(e, RotationalSpringDamper | ConstantTorque)
        )

    @cached_property
    def forces(self) -> tuple[tuple[ConstantForce, PointCoefficients], ...]:
        """Constant forces, with the point that they act on."""
        return tuple(
            (e, self.kinematics.point(e.body, e.point))
            for e in self.kinematics.mechanism.force_elements
            if isinstance(e, ConstantForce)
        )

    def generalized(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray | None = None
    ) -> FloatArray:
        """Generalized forces of all elements, shape (..., n_q) [N m or N]."""
        total = np.zeros(q.shape if q.shape == u.shape else np.broadcast_shapes(q.shape, u.shape))
        if not self.kinematics.mechanism.force_elements:
            return total
        rates = self.kinematics.rates(q) if rates is None else rates
        for spring, vector in self.springs:
            gradient = self.kinematics.gradient(vector.coefficients, q, rates)
            force = _pull(spring, self.kinematics.vector(vector, q), np.sum(gradient * u, axis=-1))
            total += (force.conj()[..., None] * gradient).real
        for element, angle in self.rotational:
            total += _torque(element, angle, q, u)[..., None] * angle.coefficients
        for element, point in self.forces:
            gradient = self.kinematics.gradient(point.coefficients, q, rates)
            total += element.force[0] * gradient.real + element.force[1] * gradient.imag
        return total

    def on_bodies(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Resultant force of the elements on each body that one acts on, world frame [N], shape (..., 2)."""
        forces: dict[str, FloatArray] = {}
        for body, force in self._on_points(q, u):
            if body != GROUND:
                forces[body] = forces.get(body, 0.0) + np.stack([force.real, force.imag], axis=-1)
        return forces

    def _on_points(self, q: FloatArray, u: FloatArray) -> Iterator[tuple[str, ComplexArray]]:
        for spring, vector in self.springs:
            force = _pull(
                spring, self.kinematics.vector(vector, q), self.kinematics.rate(vector, q, u)
            )
            yield spring.body, force
            yield spring.relative_to, -force
        for element, _ in self.forces:
            yield element.body, np.full(q.shape[:-1], complex(*element.force))

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Energy of the springs [J], shape (...,)."""
        total = np.zeros(q.shape[:-1])
        for spring, vector in self.springs:
            total += (
                0.5
                * spring.stiffness
                * (np.abs(self.kinematics.vector(vector, q)) - spring.rest_length) ** 2
            )
        for element, angle in self.rotational:
            if isinstance(element, RotationalSpringDamper):
                total += 0.5 * element.stiffness * (angle.value(q) - element.rest_angle) ** 2
        return total

    def power(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Power of the dampers, constant forces and constant torques [W], shape (...,): all that no energy tells.

        Kinetic and potential energy (of gravity and springs) change by its time integral.
        """
        total, vector_of, rate_of = (
            np.zeros(q.shape[:-1]),
            self.kinematics.vector,
            self.kinematics.rate,
        )
        for spring, vector in self.springs:
            if spring.damping:
                total -= (
                    spring.damping * _stretching(vector_of(vector, q), rate_of(vector, q, u)) ** 2
                )
        for element, angle in self.rotational:
            turning = u @ angle.coefficients
            constant = element.torque * turning if isinstance(element, ConstantTorque) else 0.0
            total += (
                constant if isinstance(element, ConstantTorque) else -element.damping * turning**2
            )
        for element, point in self.forces:
            total += (complex(*element.force).conjugate() * rate_of(point, q, u)).real
        return total


def _stretching(vector: ComplexArray, speed: ComplexArray) -> FloatArray:
    """Rate of a vector's length [m/s]."""
    return (vector.conj() * speed).real / np.abs(vector)


def _pull(spring: SpringDamper, vector: ComplexArray, speed: ComplexArray) -> ComplexArray:
    """Force of a spring and damper on the point that the vector leads to [N]."""
    force = -spring.stiffness * vector
    if spring.rest_length or spring.damping:
        size = spring.stiffness * spring.rest_length - spring.damping * _stretching(vector, speed)
        force = force + size * vector / np.abs(vector)
    return force


def _torque(
    element: RotationalSpringDamper | ConstantTorque,
    angle: AngleFunction,
    q: FloatArray,
    u: FloatArray,
) -> FloatArray:
    """Torque of an element on its body [N m]."""
    if isinstance(element, ConstantTorque):
        return element.torque + np.zeros(q.shape[:-1])
    return -element.stiffness * (angle.value(q) - element.rest_angle) - element.damping * (
        u @ angle.coefficients
    )
