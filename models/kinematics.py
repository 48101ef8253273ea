"""Kinematics of a mechanism: points, angles, gaps of stops, loop closures, energies."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from .arrays import ComplexArray, FloatArray, as_vectors
from .elements import ELEMENTS, GROUND
from .errors import UnsupportedProblemError
from .functions import (
    AngleFunction,
    LineFunction,
    Phasors,
    PointCoefficients,
    PointFunction,
    ScalarFunction,
    weighted,
)
from .mechanism import Marker, Mechanism, Tree
from .spec import Vector, as_complex

_ROUNDING = 1e-12  # of the greatest derivatives of a gap: those of one that nothing changes


@dataclass(frozen=True)
class Kinematics(Phasors):
    """Point kinematics of a mechanism; arrays of states are shaped (n, n_q).

    Raises:
        UnsupportedProblemError: an element is of an unknown class.
    """

    mechanism: Mechanism

    def __post_init__(self) -> None:
        for element in self.mechanism.elements:
            if type(element) not in ELEMENTS:
                raise UnsupportedProblemError(
                    f"{self.mechanism.name!r} cannot be solved: {element.name!r} is a "
                    f"{type(element).__name__}, which is no known element."
                )

    @cached_property
    def tree(self) -> Tree:
        """The mechanism's tree."""
        return self.mechanism.tree

    @cached_property
    def is_angle(self) -> FloatArray:
        """1.0 for an angle, 0.0 for a slide; shape (n_q,)."""
        return np.array([1.0] * len(self.tree.angles) + [0.0] * len(self.tree.slides))

    @cached_property
    def carried(self) -> tuple[tuple[int, int], ...]:
        """Index of each slide along a line that turns, and of the angle that it turns with."""
        angles = (self.tree.attitudes[slide.joint.parent][0] for slide in self.tree.slides)
        first = len(self.tree.angles)
        return tuple((k, angle) for k, angle in enumerate(angles, start=first) if angle is not None)

    @cached_property
    def attitudes(self) -> dict[str, tuple[int | None, float]]:
        """Angle that each body and the ground turn with, as :attr:`.mechanism.Tree.attitudes`."""
        return self.tree.attitudes

    def _origin(self) -> PointCoefficients:
        """The world's origin, whose numbers are of the kind that all rows have."""
        shape = (*np.shape(self.mechanism.gravity), len(self.is_angle))
        return PointCoefficients(0j, np.zeros(shape, dtype=np.complex128))

    @cached_property
    def _frames(self) -> dict[str, PointCoefficients]:
        """The origin of each body's frame, from the ground outwards."""
        rows = {GROUND: self._origin()}
        slides = {name: k for k, name in enumerate(self.tree.coordinates)}
        for joint in self.tree.joints:
            at = self._moved(rows[joint.parent], joint.parent, as_complex(joint.parent_point))
            frame = self._moved(at, joint.child, -as_complex(joint.child_point))
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                frame.coefficients[..., slides[name]] += self._turned(joint.parent, direction)
            rows[joint.child] = frame
        return rows

    def _turned(self, body: str, vector: complex) -> complex:
        """A vector of a body's frame, turned by the constant part of the body's angle."""
        turned = self.attitudes[body][1]
        return vector if isinstance(turned, float) and not turned else vector * np.exp(-1j * turned)

    def _moved(self, at: PointCoefficients, body: str, arm: complex) -> PointCoefficients:
        """A point at an arm from another one, in a body's frame [m]; coefficients are copied."""
        index = self.attitudes[body][0]
        arm = self._turned(body, arm)
        coefficients = at.coefficients.copy()
        if index is None:
            return PointCoefficients(at.offset + arm, coefficients)
        coefficients[..., index] += arm
        return PointCoefficients(at.offset, coefficients)

    def point(self, body: str, point: Vector) -> PointCoefficients:
        """The row of a point given in a body's frame (or the ground's)."""
        return self._moved(self._frames[body], body, as_complex(point))

    def between(
        self, body: str, point: Vector, other: str, other_point: Vector
    ) -> PointCoefficients:
        """The row of the vector from a point of another body to a body's point."""
        to, start = self.point(body, point), self.point(other, other_point)
        return PointCoefficients(to.offset - start.offset, to.coefficients - start.coefficients)

    def angle(self, body: str, other: str = GROUND) -> AngleFunction:
        """A body's angle, or its angle less that of another one."""
        row, constant = np.zeros(len(self.is_angle)), 0.0
        for name, sign in ((body, 1.0), (other, -1.0)):
            index, turned = self.attitudes[name]
            constant += sign * turned
            if index is not None:
                row[index] += sign
        row.flags.writeable = False  # shared by all callers
        return AngleFunction(constant, row)

    def slide(self, coordinate: str) -> AngleFunction:
        """A slide coordinate, as a function of all."""
        row = np.zeros(len(self.is_angle))
        row[self.tree.coordinates.index(coordinate)] = 1.0
        row.flags.writeable = False  # shared by all callers
        return AngleFunction(0.0, row, is_length=True)

    def slide_axis(self, coordinate: str, q: FloatArray) -> ComplexArray:
        """Direction of a slide in the world, x + i y of length 1, shape (...,)."""
        slide = self.mechanism.slide(coordinate)
        return self.in_world(slide.joint.parent, slide.direction, q)

    def in_world(self, body: str, direction: complex, q: Any) -> Any:
        """A direction of a body's frame (or the ground's) in the world, x + i y, shape (...,)."""
        return direction * np.exp(-1j * self.angle(body).value(q))

    def component(
        self, direction: complex, of: str, vector: PointCoefficients, constant: float = 0.0
    ) -> PointFunction | LineFunction:
        """A vector's component along a direction of a body or the ground, plus a constant [m]."""
        index, direction = self.attitudes[of][0], self._turned(of, direction)
        if index is not None:
            return LineFunction(self, constant, direction, index, vector)
        along = direction.conjugate()
        coefficients = vector.coefficients * np.asarray(along)[..., None]
        return PointFunction(self, (vector.offset * along).real + constant, coefficients)

    def position(self, row: PointCoefficients, q: FloatArray) -> FloatArray:
        """World position [m], shape (..., 2)."""
        return as_vectors(self.vector(row, q))

    def velocity(self, row: PointCoefficients, q: FloatArray, u: FloatArray) -> FloatArray:
        """World velocity [m/s], shape (..., 2)."""
        return as_vectors(self.rate(row, q, u))

    def speed_scale(self, row: PointCoefficients) -> float:
        """A scale of speeds [m/s]: of a fall by all arms of a point, plus its speed at the start.

        That of the body which has the largest, if it is larger: a point that loops hold fast has
        but rounding for one.
        """
        gravity = np.asarray(self.mechanism.gravity)[..., None]
        start_speeds = np.abs(initial_state(self.mechanism)[1])[..., None, :]

        def scales(coefficients: ComplexArray) -> FloatArray:
            arms = np.abs(coefficients)
            falls = gravity * (arms @ self.is_angle)
            return np.sqrt(falls) + np.sum(arms * start_speeds, axis=-1)

        of_point = scales(row.coefficients[..., None, :])[..., 0]
        return cast("float", np.maximum(of_point, scales(self.centres).max(axis=-1)))

    def acceleration(
        self, row: PointCoefficients, q: FloatArray, u: FloatArray, a: FloatArray
    ) -> FloatArray:
        """World acceleration [m/s^2] for generalized accelerations a, shape (..., 2)."""
        return as_vectors(weighted(self.second_flow(q, u, a), row.coefficients))

    def point_motion(
        self, marker: Marker, q: FloatArray, u: FloatArray, a: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] of a marker, shapes (..., 2)."""
        row = self.point(marker.body, marker.point)
        return self.position(row, q), self.velocity(row, q, u), self.acceleration(row, q, u, a)

    @cached_property
    def centres(self) -> ComplexArray:
        """Coefficients of the bodies' centres of mass, shape (n_bodies, n_q)."""
        points = [self.point(body.name, body.centre) for body in self.mechanism.bodies]
        return np.stack([point.coefficients for point in points], axis=-2)

    @cached_property
    def masses(self) -> FloatArray:
        """Masses of the bodies [kg], shape (n_bodies,)."""
        return np.array([body.mass for body in self.mechanism.bodies]).T

    @cached_property
    def inertias(self) -> FloatArray:
        """Inertias about the centres of mass on the angles, 0 on slides [kg m^2], shape (n_q,)."""
        inertias = np.zeros((*np.shape(self.mechanism.gravity), len(self.is_angle)))
        for body in self.mechanism.bodies:
            index, _ = self.attitudes[body.name]
            if index is not None:
                inertias[..., index] += body.inertia
        return inertias

    @cached_property
    def rotor_inertias(self) -> FloatArray | None:
        """Parts of the mass matrix that are the same in every state, of force elements.

        Shape (..., n_q, n_q) [kg m^2]; None where no element has one.
        """
        parts = [element.mass_matrix(self) for element in self.mechanism.force_elements]
        known = [part for part in parts if part is not None]
        return np.sum(known, axis=0) if known else None

    @cached_property
    def inertia_matrix(self) -> FloatArray:
        """Part of the mass matrix that is the same in every state, shape (..., n_q, n_q)."""
        diagonal = self.inertias[..., None] * np.eye(len(self.is_angle))
        return diagonal if self.rotor_inertias is None else diagonal + self.rotor_inertias

    def momentum(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Linear momentum of all bodies [kg m/s], shape (..., 2)."""
        return as_vectors(weighted(self.flow(q, u, self.rates(q)), self.masses @ self.centres))

    def kinetic_energy(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Kinetic energy [J], shape (...,)."""
        speeds = self.flow(q, u, self.rates(q)) @ self.centres.T
        doubled = np.abs(speeds) ** 2 @ self.masses + u**2 @ self.inertias
        return 0.5 * doubled + self.rotor_energy(u)

    def rotor_energy(self, u: FloatArray) -> FloatArray:
        """Kinetic energy of rotors, beyond that of the bodies [J], shape (...,)."""
        if self.rotor_inertias is None:
            return np.zeros(u.shape[:-1])
        return 0.5 * np.sum((u @ self.rotor_inertias) * u, axis=-1)

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Potential energy of gravity [J], zero at the world's origin, shape (...,)."""
        upwards = -as_complex(self.mechanism.gravity_direction).conjugate()
        offsets = np.array([self.point(b.name, b.centre).offset for b in self.mechanism.bodies])
        heights = ((self.phasors(q) @ self.centres.T + offsets) * upwards).real
        return self.mechanism.gravity * heights @ self.masses

    def gap(self, stop: str, q: FloatArray) -> FloatArray:
        """Gap of a stop [its gap_unit], shape (...,)."""
        return self.gaps[stop].value(q)

    def gap_jacobian(self, stop: str, q: FloatArray) -> FloatArray:
        """Jacobian of a stop's gap with respect to q, shape (..., n_q)."""
        return np.broadcast_to(self.gaps[stop].jacobian(q, self.rates(q)), q.shape)

    def gap_bias(self, stop: str, q: FloatArray, u: FloatArray) -> FloatArray:
        """The gap's acceleration without accelerations of q, d/dt(Jacobian) u, shape (...,)."""
        return self.gaps[stop].bias(q, u, self.curvature(q, u))

    @cached_property
    def gaps(self) -> dict[str, ScalarFunction]:
        """Gaps of the stops."""
        return {stop.name: stop.gap(self) for stop in self.mechanism.stops}

    @cached_property
    def loop_closures(self) -> tuple[ScalarFunction, ...]:
        """Functions that the joints that close a loop, and couplers, hold at zero.

        The child's point less the parent's along each held direction of the parent's frame (of a
        pin or weld: along x and y of the world); then, where the joint holds it, the child's angle
        less the parent's, full turns apart. Couplers come last.
        """
        closures: list[ScalarFunction] = []
        for joint in self.tree.loop_joints:
            vector = self.between(joint.child, joint.child_point, joint.parent, joint.parent_point)
            frame = joint.parent if joint.free_directions else GROUND
            for direction in joint.held_directions:
                closures.append(self.component(direction, frame, vector))
            if joint.turned_by is not None:
                closures.append(self._angle_closure(joint.child, joint.parent, joint.turned_by))
        return (*closures, *self.couplings.values())

    @cached_property
    def couplings(self) -> dict[str, AngleFunction]:
        """Functions that the couplers hold at zero [rad or m]."""
        return {
            coupler.name: coupler.closure(self.tree.coordinates, self.is_angle)
            for coupler in self.mechanism.couplers
        }

    def _angle_closure(self, child: str, parent: str, turned_by: float) -> AngleFunction:
        """A child's angle less the parent's and a constant [rad], full turns apart at the start."""
        angle = self.angle(child, parent)
        error = angle.value(initial_state(self.mechanism)[0]) - turned_by
        full_turns = np.round(error / (2 * math.pi)) * 2 * math.pi
        constant = angle.constant - turned_by - full_turns
        return AngleFunction(cast("float", constant), angle.coefficients)

    def loop_residual(self, q: FloatArray) -> FloatArray:
        """Values of the loop closures [m or rad], shape (..., n_loops)."""
        residual = np.empty((*q.shape[:-1], len(self.loop_closures)))
        for k, closure in enumerate(self.loop_closures):
            residual[..., k] = closure.value(q)
        return residual

    def loop_jacobian(self, q: FloatArray) -> FloatArray:
        """Jacobian of the loop closures, shape (..., n_loops, n_q)."""
        rates = self.rates(q)
        jacobian = np.empty((*q.shape[:-1], len(self.loop_closures), q.shape[-1]))
        for k, closure in enumerate(self.loop_closures):
            jacobian[..., k, :] = closure.jacobian(q, rates)
        return jacobian


def initial_state(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Coordinates q and speeds u at t = 0, each of shape (n_q,)."""
    q = np.array(mechanism.start, dtype=np.float64).T
    if not mechanism.start_speeds:
        return q, np.zeros_like(q)
    return q, np.array(mechanism.start_speeds, dtype=np.float64).T


def immovable_stops(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of stops whose gap no coordinate changes, such as stops between welded bodies.

    They have no part in the motion. A stop of a body against itself is none of them: it is an error
    of the description.
    """
    if not mechanism.stops:
        return ()
    kinematics, random = Kinematics(mechanism), np.random.default_rng(2)
    q = initial_state(mechanism)[0] + np.vstack([np.zeros(1), random.uniform(-1, 1, (2, 1))])

    immovable: list[str] = []
    for stop in mechanism.stops:
        rows = np.abs(kinematics.gap_jacobian(stop.name, q))
        moves = (rows > _ROUNDING * kinematics.gaps[stop.name].amplitudes).any()
        if stop.body != stop.relative_to and not moves:
            immovable.append(stop.name)
    return tuple(immovable)


def without_stops(mechanism: Mechanism, names: Collection[str]) -> Mechanism:
    """The same mechanism without some of its stops."""
    left = tuple(stop for stop in mechanism.stops if stop.name not in names)
    return mechanism.model_copy(update={"stops": left}) if names else mechanism
