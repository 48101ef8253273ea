"""Numbers of a mechanism as balls, from its doubles taken exactly.

The equations are those of :mod:`..taylor.expressions`; the numbers in them are computed there in
doubles, and here in ball arithmetic, so that they contain what the mechanism's file says: 9.81 is
the double next to 981/100, and a direction has the length that its two doubles have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from ...models.elements import GROUND
from ...models.functions import AngleFunction, LineFunction, PointCoefficients, PointFunction
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Vector
from ..taylor.numbers import PROJECTILE, force_terms, relevant_stops
from .balls import Ball, acb, arb

Complex = Any
"""A complex ball, flint.acb."""
Row = list[Complex]
"""Coefficients of a point or a force over the coordinates."""


def _exact(vector: Vector) -> Complex:
    """A vector of doubles as x + i y."""
    return acb(vector[0], vector[1])


@dataclass(frozen=True)
class BallGeometry:
    """Points and angles of bodies as :class:`...models.kinematics.Kinematics`, in balls.

    It serves the elements as their :class:`...models.elements.base.Geometry`; coefficients are
    arrays of complex balls.
    """

    mechanism: Mechanism
    kinematics: Kinematics

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return len(self.kinematics.is_angle)

    @cached_property
    def attitudes(self) -> dict[str, tuple[int | None, Ball]]:
        """Index of the angle that each body turns with, plus a constant [rad]."""
        known = self.mechanism.tree.attitudes
        attitudes: dict[str, tuple[int | None, Ball]] = {GROUND: (None, arb(0))}
        for joint in self.mechanism.tree.joints:
            turned = arb(0)
            if joint.turned_by is not None:
                turned = attitudes[joint.parent][1] + joint.turned_by
            attitudes[joint.child] = known[joint.child][0], turned
        return attitudes

    @cached_property
    def _frames(self) -> dict[str, PointCoefficients]:
        """The origin of each body's frame, from the ground outwards."""
        zero = np.array([acb(0)] * self.n_q, dtype=object)
        rows = {GROUND: PointCoefficients(cast("complex", acb(0)), cast("Any", zero))}
        slides = {name: k for k, name in enumerate(self.mechanism.tree.coordinates)}
        for joint in self.mechanism.tree.joints:
            at = self._moved(rows[joint.parent], joint.parent, _exact(joint.parent_point))
            frame = self._moved(at, joint.child, -_exact(joint.child_point))
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                frame.coefficients[slides[name]] += self._turned(joint.parent, acb(direction))
            rows[joint.child] = frame
        return rows

    def _turned(self, body: str, vector: Complex) -> Complex:
        turned = self.attitudes[body][1]
        return vector if turned == 0 else vector * (acb(0, -1) * turned).exp()

    def _moved(self, at: PointCoefficients, body: str, arm: Complex) -> PointCoefficients:
        index, arm = self.attitudes[body][0], self._turned(body, arm)
        coefficients = at.coefficients.copy()
        if index is None:
            return PointCoefficients(at.offset + arm, coefficients)
        coefficients[index] += arm
        return PointCoefficients(at.offset, coefficients)

    def point(self, body: str, point: Vector) -> PointCoefficients:
        """The row of a point given in a body's frame (or the ground's)."""
        return self._moved(self._frames[body], body, _exact(point))

    def between(
        self, body: str, point: Vector, other: str, other_point: Vector
    ) -> PointCoefficients:
        """The row of the vector from a point of another body to a body's point."""
        to, start = self.point(body, point), self.point(other, other_point)
        return PointCoefficients(to.offset - start.offset, to.coefficients - start.coefficients)

    def angle(self, body: str, other: str = GROUND) -> AngleFunction:
        """A body's angle less that of another one."""
        constant = self.attitudes[body][1] - self.attitudes[other][1]
        return AngleFunction(constant, self.kinematics.angle(body, other).coefficients)

    def component(
        self, direction: complex, of: str, vector: PointCoefficients, constant: float = 0.0
    ) -> PointFunction | LineFunction:
        """A vector's component along a direction of a body or the ground, plus a constant [m]."""
        index, along = self.attitudes[of][0], self._turned(of, acb(direction))
        if index is not None:
            return LineFunction(self.kinematics, constant, along, index, vector)
        along = along.conjugate()
        offset = (vector.offset * along).real + constant
        return PointFunction(self.kinematics, offset, vector.coefficients * along)

    def position(self, row: PointCoefficients, q: Sequence[Ball]) -> Complex:
        """World position of a point, or a vector between two, x + i y [m]."""
        return self._weighted(row, self._phasors(q)) + row.offset

    def velocity(self, row: PointCoefficients, q: Sequence[Ball], u: Sequence[Ball]) -> Complex:
        """Its derivative with respect to time [m/s]."""
        flow, minus_i = list[Complex](), acb(0, -1)
        turning = dict(self.kinematics.carried)
        for k, (w, q_k, u_k) in enumerate(zip(self._phasors(q), q, u, strict=True)):
            if self.kinematics.is_angle[k] > 0:
                flow.append(minus_i * w * u_k)
            elif k in turning:
                turned = (minus_i * q[turning[k]]).exp()
                flow.append(turned * (u_k + minus_i * q_k * u[turning[k]]))
            else:
                flow.append(acb(u_k))
        return self._weighted(row, flow)

    def acceleration(
        self, row: PointCoefficients, q: Sequence[Ball], u: Sequence[Ball], a: Sequence[Ball]
    ) -> Complex:
        """Its second derivative for accelerations a of the coordinates [m/s^2]."""
        second, minus_i = list[Complex](), acb(0, -1)
        turning = dict(self.kinematics.carried)
        for k, w in enumerate(self._phasors(q)):
            if self.kinematics.is_angle[k] > 0:
                second.append(w * (minus_i * a[k] - u[k] * u[k]))
            elif k in turning:
                c = turning[k]
                inward = q[k] * (minus_i * a[c] - u[c] * u[c])
                turned = (minus_i * q[c]).exp()
                second.append(turned * (a[k] + 2 * minus_i * u[k] * u[c] + inward))
            else:
                second.append(acb(a[k]))
        return self._weighted(row, second)

    def turned(self, body: str, direction: complex, q: Sequence[Ball]) -> Complex:
        """A direction of a body's frame (or the ground's) in the world."""
        index, along = self.attitudes[body][0], self._turned(body, acb(direction))
        return along if index is None else along * (acb(0, -1) * q[index]).exp()

    def _phasors(self, q: Sequence[Ball]) -> Row:
        turning, phasors = dict(self.kinematics.carried), Row()
        for k, q_k in enumerate(q):
            if self.kinematics.is_angle[k] > 0:
                phasors.append((acb(0, -1) * q_k).exp())
            elif k in turning:
                phasors.append((acb(0, -1) * q[turning[k]]).exp() * q_k)
            else:
                phasors.append(acb(q_k))
        return phasors

    def _weighted(self, row: PointCoefficients, w: Row) -> Complex:
        return sum((c * x for c, x in zip(row.coefficients, w, strict=True)), acb(0))

    @cached_property
    def centres(self) -> list[tuple[float, PointCoefficients]]:
        """Mass [kg] and centre of each body."""
        return [(b.mass, self.point(b.name, b.centre)) for b in self.mechanism.bodies]

    @cached_property
    def inertias(self) -> list[Ball]:
        """Inertias about the centres of mass on the angles, 0 on slides [kg m^2]."""
        inertias = [arb(0)] * self.n_q
        for body in self.mechanism.bodies:
            index, _ = self.attitudes[body.name]
            if index is not None:
                inertias[index] += body.inertia
        return inertias


def exact_numbers(problem: Problem, geometry: BallGeometry) -> list[Ball]:
    """Numbers of a machine, ordered as :attr:`..taylor.numbers.Structure.sections`.

    They are those of :func:`..taylor.numbers.numbers_of`, in the precision of the context.
    """
    mechanism, terms = problem.mechanism, force_terms(cast("Kinematics", geometry))
    gaps = [mechanism.stop(name).gap(cast("Any", geometry)) for name in relevant_stops(problem)]
    closures = _loop_closures(geometry)
    lines = [row for row in (*closures, *gaps) if isinstance(row, LineFunction)]
    springs = [vector for _, vector in terms.springs]
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    weights = [acb(0)] * geometry.n_q
    gravity = _exact(mechanism.gravity_direction).conjugate() * mechanism.gravity
    for mass, centre in geometry.centres:
        for k, c in enumerate(centre.coefficients):
            weights[k] += mass * gravity * c
    for element, point in terms.pulls:
        for k, c in enumerate(point.coefficients):
            weights[k] += _exact(element.force).conjugate() * c
    projectile = mechanism.marker(PROJECTILE)
    lead = [acb(0)] * geometry.n_q
    if projectile is not None:
        across = (acb(0, -1) * arb.pi() / 4).exp() * acb(0, -1)
        row = geometry.point(projectile.body, projectile.point)
        lead = [across * c for c in row.coefficients]

    def points(functions: Sequence[Any]) -> list[Complex]:
        rows = [row.coefficients for row in functions if isinstance(row, PointFunction)]
        return [z for row in rows for z in _waves(row, geometry)]

    def vectors(rows: Sequence[PointCoefficients]) -> list[Complex]:
        return [z for row in rows for z in _waves(row.coefficients, geometry, vectors=True)]

    numbers: list[Ball] = []
    for values in (
        _products(geometry),
        _waves(weights, geometry),
        points(closures),
        points(gaps),
        _waves(lead, geometry),
    ):
        numbers += _parts(values)
    numbers += [-gap.constant if unilateral else arb(0) for gap in gaps]
    numbers += _parts(vectors([line.vector for line in lines]))
    numbers += _parts([line.direction for line in lines])
    numbers += _parts([line.vector.offset for line in lines])
    numbers += _parts(vectors(springs))
    numbers += _parts([vector.offset for vector in springs])
    spring_data = [(s.stiffness, s.damping, s.rest_length) for s, _ in terms.springs]
    twist_data = [values for values, _ in terms.twists]
    numbers += [arb(x) for row in zip(*spring_data, strict=True) for x in row]
    numbers += [arb(x) for row in zip(*twist_data, strict=True) for x in row]
    return numbers


def _parts(values: Sequence[Complex]) -> Iterator[Ball]:
    """Real parts, then imaginary parts."""
    yield from (acb(value).real for value in values)
    yield from (acb(value).imag for value in values)


def _loop_closures(geometry: BallGeometry) -> list[Any]:
    """Functions that the loop joints hold at zero, without their constants' full turns."""
    closures: list[Any] = []
    for joint in geometry.mechanism.tree.loop_joints:
        vector = geometry.between(joint.child, joint.child_point, joint.parent, joint.parent_point)
        frame = joint.parent if joint.free_directions else GROUND
        for direction in joint.held_directions:
            closures.append(geometry.component(direction, frame, vector))
        if joint.turned_by is not None:
            closures.append(geometry.angle(joint.child, joint.parent))
    return closures


def _waves(row: Any, geometry: BallGeometry, vectors: bool = False) -> Row:
    """Waves of a row, as :func:`..taylor.numbers._waves`."""
    carried, waves = {k for k, _ in geometry.kinematics.carried}, Row()
    for k, c in enumerate(row):
        if geometry.kinematics.is_angle[k] > 0:
            waves.append(acb(0, 1) * c.conjugate())
        elif vectors or k in carried:
            waves.append(c.conjugate())
        else:
            waves.append(acb(c.real))
    return waves


def _products(geometry: BallGeometry) -> Row:
    """Upper triangle of C^H diag(m) C as waves, row by row, the inertias on the diagonal."""
    n_q, n = geometry.n_q, int(geometry.kinematics.is_angle.sum())
    carried, products = {k for k, _ in geometry.kinematics.carried}, [acb(0)] * (n_q * n_q)
    for i in range(n_q):
        for j in range(i, n_q):
            terms = (
                mass * at.coefficients[i].conjugate() * at.coefficients[j]
                for mass, at in geometry.centres
            )
            entry = sum(terms, acb(0))
            if i < n <= j:
                entry *= acb(0, 1)
            level = i >= n and i not in carried and j not in carried
            if level or i == j:
                entry = acb(entry.real)
            if i == j:
                entry += geometry.inertias[i]
            products[i * n_q + j] = entry
    return products
