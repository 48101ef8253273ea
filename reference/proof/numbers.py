"""Numbers of a mechanism as balls, from its doubles taken exactly.

The equations are those of :mod:`..taylor.expressions`; the numbers in them are computed there in
doubles, and here in ball arithmetic, so that they contain what the mechanism's file says: 9.81 is
the double next to 981/100, and a direction has the length that its two doubles have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...models.elements import GROUND
from ...models.functions import AngleFunction, LineFunction, PointCoefficients, PointFunction
from ...models.kinematics import Kinematics
from ...models.problem import Problem, StopLaw
from ..taylor.numbers import PROJECTILE, force_terms, relevant_stops
from .balls import Ball, acb, arb

Complex = Any
"""A complex ball, flint.acb."""
Row = list[Complex]
"""Coefficients of a point or a force over the coordinates."""
Coordinates = Any
"""Array of complex balls without imaginary part, shape (n_q,): Kinematics multiplies by i."""


def as_coordinates(values: Sequence[Ball]) -> Coordinates:
    """Coordinates, speeds or accelerations as an array."""
    return np.array([acb(value) for value in values], dtype=object)


@dataclass(frozen=True)
class BallKinematics(Kinematics):
    """Kinematics in balls: coefficients and states are arrays of balls, constants are exact.

    Points are complex balls (`vector`, `rate`); what takes their parts as arrays (`position`,
    energies) is not for balls.
    """

    @cached_property
    def attitudes(self) -> dict[str, tuple[int | None, Any]]:
        """Index of the angle that each body turns with, plus a constant [rad], not rounded."""
        known, attitudes = self.tree.attitudes, dict[str, tuple[int | None, Any]]()
        attitudes[GROUND] = None, acb(0)
        for joint in self.tree.joints:
            turned = acb(0)
            if joint.turned_by is not None:
                turned = attitudes[joint.parent][1] + joint.turned_by
            attitudes[joint.child] = known[joint.child][0], turned
        return attitudes

    def _origin(self) -> PointCoefficients:
        return PointCoefficients(acb(0), _zeros(len(self.is_angle)))

    def _angle_closure(self, child: str, parent: str, turned_by: float) -> AngleFunction:
        return self.angle(child, parent)  # accelerations have nothing of its constant

    @cached_property
    def inertias(self) -> Any:
        """Inertias about the centres of mass on the angles, 0 on slides [kg m^2], not rounded."""
        inertias = [arb(0)] * len(self.is_angle)
        for body in self.mechanism.bodies:
            index, _ = self.attitudes[body.name]
            if index is not None:
                inertias[index] += body.inertia
        return inertias


def exact_numbers(problem: Problem, kinematics: BallKinematics) -> list[Ball]:
    """Numbers of a machine, ordered as :attr:`..taylor.numbers.Structure.sections`.

    They are those of :func:`..taylor.numbers.numbers_of`, in the precision of the context.
    """
    mechanism, terms = problem.mechanism, force_terms(kinematics)
    n_q = len(kinematics.is_angle)
    gaps, closures = [kinematics.gaps[n] for n in relevant_stops(problem)], kinematics.loop_closures
    lines = [row for row in (*closures, *gaps) if isinstance(row, LineFunction)]
    springs = [vector for _, vector in terms.springs]
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    gravity = acb(*mechanism.gravity_direction).conjugate() * mechanism.gravity
    weights = _zeros(n_q)
    for body, centre in zip(mechanism.bodies, kinematics.centres, strict=True):
        weights = weights + body.mass * gravity * centre
    for element, point in terms.pulls:
        weights = weights + acb(*element.force).conjugate() * point.coefficients
    lead, projectile = _zeros(n_q), mechanism.marker(PROJECTILE)
    if projectile is not None:
        across = (acb(0, -1) * arb.pi() / 4).exp() * acb(0, -1)
        lead = across * kinematics.point(projectile.body, projectile.point).coefficients

    def points(functions: Sequence[Any]) -> list[Complex]:
        rows = [row.coefficients for row in functions if isinstance(row, PointFunction)]
        return [z for row in rows for z in _waves(row, kinematics)]

    def vectors(rows: Sequence[PointCoefficients]) -> list[Complex]:
        return [z for row in rows for z in _waves(row.coefficients, kinematics, vectors=True)]

    numbers: list[Ball] = []
    for values in (
        _products(kinematics),
        _waves(weights, kinematics),
        points(closures),
        points(gaps),
        _waves(lead, kinematics),
    ):
        numbers += _parts(values)
    numbers += [-acb(gap.constant).real if unilateral else arb(0) for gap in gaps]
    numbers += _parts(vectors([line.vector for line in lines]))
    numbers += _parts([line.direction for line in lines])
    numbers += _parts([line.vector.offset for line in lines])
    numbers += _parts(vectors(springs))
    numbers += _parts([vector.offset for vector in springs])
    spring_data = [(s.stiffness, s.damping, s.rest_length) for s, _ in terms.springs]
    twist_data = [values for values, _ in terms.twists]
    numbers += [arb(x) for row in zip(*spring_data, strict=True) for x in row]
    numbers += [acb(x).real for row in zip(*twist_data, strict=True) for x in row]
    return numbers


def _zeros(n_q: int) -> Any:
    """A row of coefficients that are zero."""
    return np.array([acb(0)] * n_q, dtype=object)


def _parts(values: Sequence[Complex]) -> Iterator[Ball]:
    """Real parts, then imaginary parts."""
    yield from (acb(value).real for value in values)
    yield from (acb(value).imag for value in values)


def _waves(row: Any, kinematics: Kinematics, vectors: bool = False) -> Row:
    """Waves of a row, as :func:`..taylor.numbers._waves`."""
    carried, waves = {k for k, _ in kinematics.carried}, Row()
    for k, c in enumerate(map(acb, row)):
        if kinematics.is_angle[k] > 0:
            waves.append(acb(0, 1) * c.conjugate())
        elif vectors or k in carried:
            waves.append(c.conjugate())
        else:
            waves.append(acb(c.real))
    return waves


def _products(kinematics: BallKinematics) -> Row:
    """Upper triangle of C^H diag(m) C as waves, row by row, the inertias on the diagonal."""
    n_q, n = len(kinematics.is_angle), int(kinematics.is_angle.sum())
    masses = [body.mass for body in kinematics.mechanism.bodies]
    carried, products = {k for k, _ in kinematics.carried}, [acb(0)] * (n_q * n_q)
    for i in range(n_q):
        for j in range(i, n_q):
            entry = acb(0)
            for mass, centre in zip(masses, kinematics.centres, strict=True):
                entry += mass * acb(centre[i]).conjugate() * centre[j]
            if i < n <= j:
                entry *= acb(0, 1)
            level = i >= n and i not in carried and j not in carried
            if level or i == j:
                entry = acb(entry.real)
            if i == j:
                entry += kinematics.inertias[i]
            products[i * n_q + j] = entry
    return products
