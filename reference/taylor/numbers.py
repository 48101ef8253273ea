r"""A machine for the Taylor integrator: a vector of numbers, and which of them are zero.

All that :mod:`..equations` computes with complex rates is a sum of real waves Re(z e^{i phase})
with constant z:

    M_ij = Re(z e^{i(q_i - q_j)})                     z = K_ij (and the inertias on the diagonal)
    b_i  = sum_j Im(z e^{i(q_i - q_j)}) u_j^2         the same z
    Q_i  = Re(z e^{i q_i})                            z = i W_i
    G_kj = Re(z e^{i q_j}),  gamma_k = -sum_j Im(z e^{i q_j}) u_j^2       z = i conj(L_kj)
    gap_k = sum_j Im(z e^{i q_j}) - limit             of a stop on a point: z as of its gradient

and the same without the phase and the i of a coordinate that is a slide. A slide along a line that
turns with the angle q_c has the phase of that angle, and, since its w is q_k e^{-i q_c}, a
derivative by q_c as well: q_k times its wave, turned by a right angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import ComplexArray
from ...models.elements import (
    FORCE_ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SpringDamper,
)
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import (
    AngleFunction,
    Kinematics,
    LineFunction,
    PointCoefficients,
    PointFunction,
    ScalarFunction,
)
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import as_complex

Real = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]
RealType = type[np.float64] | type[np.longdouble]
Row = tuple[float, ...] | int | None
"""Gradient of a constraint: constant, of angles or a coupler; the number of the angle with which
the line of a point's component turns; or None, of a direction that does not turn: a row of waves.
"""

PROJECTILE = "projectile"


@dataclass(frozen=True)
class Structure:
    """Structure that a compiled integrator depends on: sizes, stops, and which numbers are zero."""

    n_angles: int
    n_slides: int
    carried: tuple[tuple[int, int], ...]
    """Index of each slide along a line that turns, and of the angle that it turns with."""
    loop_rows: tuple[Row, ...]  # of each constraint of the loop joints
    gap_rows: tuple[Row, ...]  # of each stop that may ever be active
    springs: tuple[bool, ...]
    """Of each spring and damper between points, whether its force depends on its length."""
    twists: tuple[tuple[float, ...], ...]
    """Gradient of the angle of each spring, damper or motor between angles, or of its slide."""
    closes: bool  # whether stops may close (unilateral law)
    present: tuple[bool, ...]  # which of the numbers are runtime parameters, the others being zero
    throws: bool  # whether there is a projectile, whose launch can be located

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return self.n_angles + self.n_slides

    @property
    def n_stops(self) -> int:
        """Number of stops that may ever be active."""
        return len(self.gap_rows)

    @property
    def n_loops(self) -> int:
        """Number of constraints of the loop joints."""
        return len(self.loop_rows)

    @property
    def sections(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the sections of numbers; the first axis is real, imaginary."""
        n_q, n_springs = self.n_q, len(self.springs)
        lines = sum(isinstance(row, int) for row in self.loop_rows + self.gap_rows)
        return {
            "products": (2, n_q, n_q),
            "weights": (2, n_q),
            "loops": (2, self.loop_rows.count(None), n_q),
            "points": (2, self.gap_rows.count(None), n_q),
            "lead": (2, n_q),
            "limits": (self.n_stops,),
            "lines": (2, lines, n_q),
            "directions": (2, lines),
            "line_offsets": (2, lines),
            "springs": (2, n_springs, n_q),
            "spring_offsets": (2, n_springs),
            "spring_data": (3, n_springs),
            "twist_data": (6, len(self.twists)),
        }

    # Switches follow the numbers among the parameters.

    @property
    def n_numbers(self) -> int:
        """Number of parameters that are numbers of the machine."""
        return sum(self.present)

    @property
    def active(self) -> slice:
        """Parameters that say whether a stop is active (1) or free (0)."""
        return slice(self.n_numbers, self.n_numbers + self.n_stops)

    @property
    def watched(self) -> slice:
        """Parameters that say whether a stop's closing is an event."""
        return slice(self.active.stop, self.active.stop + self.closes * self.n_stops)

    @property
    def launch(self) -> int:
        """The parameter that says whether the launch is an event."""
        return int(self.watched.stop)

    @property
    def n_parameters(self) -> int:
        """Number of all runtime parameters."""
        return self.launch + self.throws  # heyoka wants no parameter that no expression uses


def relevant_stops(problem: Problem) -> tuple[str, ...]:
    """Stops that may ever be active: under release-once, an open one never closes."""
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    return tuple(stop.name for stop in problem.mechanism.stops if stop.closed or unilateral)


def structure_of(problem: Problem, kinematics: Kinematics, present: NDArray[np.bool_]) -> Structure:
    """The structure a problem's numbers belong to."""

    def senses(angle: AngleFunction) -> tuple[float, ...]:
        return tuple(float(entry) for entry in angle.coefficients)

    for coupler in problem.mechanism.couplers:
        if any(np.ndim(ratio) for ratio in coupler.weights.values()):
            raise UnsupportedProblemError(
                f"the Taylor integrator cannot use {coupler.name!r} (coupler) with other ratios "
                "in each machine of a batch."
            )

    def row(function: ScalarFunction) -> Row:
        if isinstance(function, AngleFunction):
            return senses(function)
        return function.body if isinstance(function, LineFunction) else None

    terms = force_terms(kinematics)
    springs = [bool(np.any(s.rest_length) or np.any(s.damping)) for s, _ in terms.springs]
    n_angles = len(problem.mechanism.angles)
    return Structure(
        n_angles=n_angles,
        n_slides=len(problem.mechanism.coordinates) - n_angles,
        carried=kinematics.carried,
        loop_rows=tuple(row(closure) for closure in kinematics.loop_closures),
        gap_rows=tuple(row(kinematics.gaps[name]) for name in relevant_stops(problem)),
        springs=tuple(springs),
        twists=tuple(senses(angle) for _, angle in terms.twists),
        closes=problem.stop_law is StopLaw.UNILATERAL,
        present=tuple(bool(flag) for flag in present),
        throws=bool(np.any(projectile_row(problem.mechanism, kinematics).coefficients)),
    )


@dataclass
class _ForceTerms:
    """Force elements of a mechanism by the terms of the equations that they make."""

    springs: list[tuple[SpringDamper, PointCoefficients]] = field(default_factory=list[Any])
    """Springs and dampers between points, with the vector to the body's point."""
    twists: list[tuple[tuple[float, ...], AngleFunction]] = field(default_factory=list[Any])
    """Torques as functions of an angle b = sum of coordinates + its constant: k, c, T_0, k_3 and
    b_3 of T_0 - k (b - constant) - c db/dt - k_3 (b - constant - b_3)^3."""
    pulls: list[tuple[ConstantForce, PointCoefficients]] = field(default_factory=list[Any])
    """Constant forces, with the point that they act on."""


def _spring(terms: _ForceTerms, kinematics: Kinematics, e: SpringDamper) -> None:
    vector = kinematics.between(e.body, e.point, e.relative_to, e.relative_point)
    terms.springs.append((e, vector))


def _pull(terms: _ForceTerms, kinematics: Kinematics, e: ConstantForce) -> None:
    terms.pulls.append((e, kinematics.point(e.body, e.point)))


def _twist(numbers: Callable[[Any, float], tuple[float, ...]]) -> _AddTerms:
    """Add a torque with these numbers, of the element and of its angle's constant."""

    def add(terms: _ForceTerms, kinematics: Kinematics, e: Any) -> None:
        angle = kinematics.angle(e.body, e.relative_to)
        terms.twists.append((numbers(e, angle.constant), angle))

    return add


def _linear(e: RotationalSpringDamper, constant: float) -> tuple[float, ...]:
    return e.stiffness, e.damping, e.stiffness * (e.rest_angle - constant), 0.0, 0.0, 0.0


def _cubic(e: CubicTorsionSpring, constant: float) -> tuple[float, ...]:
    relaxed = e.rest_angle - constant
    return e.stiffness, 0.0, e.stiffness * relaxed, e.cubic_stiffness, relaxed, 0.0


def _along_slide(terms: _ForceTerms, kinematics: Kinematics, e: SlideSpringDamper) -> None:
    constant = e.force + e.stiffness * e.rest_position
    numbers = (e.stiffness, e.damping, constant, 0.0, 0.0, 0.0)
    terms.twists.append((numbers, kinematics.slide(e.coordinate)))


def _drive(terms: _ForceTerms, kinematics: Kinematics, e: SlideInertia) -> None:
    terms.twists.append(((0.0, 0.0, 0.0, 0.0, 0.0, e.inertia), kinematics.slide(e.coordinate)))


_AddTerms = Callable[[_ForceTerms, Kinematics, Any], None]
_TERMS: ElementTable[_AddTerms] = ElementTable(
    "The Taylor integrator",
    FORCE_ELEMENTS,
    {
        SpringDamper: _spring,
        RotationalSpringDamper: _twist(_linear),
        CubicTorsionSpring: _twist(_cubic),
        ConstantForce: _pull,
        ConstantTorque: _twist(lambda e, _: (0.0, 0.0, e.torque, 0.0, 0.0, 0.0)),
        RotorInertia: _twist(lambda e, _: (0.0, 0.0, 0.0, 0.0, 0.0, e.inertia)),
        SlideSpringDamper: _along_slide,
        SlideInertia: _drive,
    },
    {
        RecordedForce: "a record of efforts changes over time",
        RecordedTorque: "a record of efforts changes over time",
    },
)


def force_terms(kinematics: Kinematics) -> _ForceTerms:
    """The terms of a mechanism's force elements, from the elements' own numbers."""
    terms = _ForceTerms()
    for element in kinematics.mechanism.force_elements:
        _TERMS[element](terms, kinematics, element)
    return terms


def numbers_of(problem: Problem, kinematics: Kinematics, real: RealType) -> Real:
    """Numbers of a machine as one vector, in this precision, ordered as `sections`.

    Of stacked machines (:mod:`...models.stacked`) one vector for each, shape (n, n_numbers).
    """
    mechanism, terms = problem.mechanism, force_terms(kinematics)
    machines, n_q = np.shape(mechanism.gravity), len(kinematics.is_angle)
    masses, centres = kinematics.masses.astype(real), _wide(kinematics.centres, real)
    gaps = [kinematics.gaps[name] for name in relevant_stops(problem)]
    lines = [row for row in (*kinematics.loop_closures, *gaps) if isinstance(row, LineFunction)]
    spring_data = [(s.stiffness, s.damping, s.rest_length) for s, _ in terms.springs]
    twist_data = [numbers for numbers, _ in terms.twists]

    def stacked(values: Sequence[complex | ComplexArray], *size: int) -> ComplexArray:
        """Values, each of one size or the same for all machines, along a last axis."""
        columns = np.empty((*machines, *size, len(values)), dtype=np.complex128)
        for k, value in enumerate(values):
            columns[..., k] = value
        return columns

    def waves(rows: Sequence[ComplexArray], vectors: bool = False) -> Complex:
        return _waves(_wide(stacked(rows, n_q).swapaxes(-1, -2), real), kinematics, vectors)

    def points(functions: Sequence[ScalarFunction]) -> Complex:
        """Rows L with Re(L w' u) the rates of loops' constraints, or the speeds of gaps."""
        return waves([row.coefficients for row in functions if isinstance(row, PointFunction)])

    # The component across the launch direction is Im(e^{-i angle} v) = Re(-i e^{-i angle} v).
    across = np.exp(-1j * real(LAUNCH_ANGLE)) * -1j
    lead = _wide(projectile_row(mechanism, kinematics).coefficients, real) * across
    # Coefficients c of weights and constant forces, whose generalized forces are Re(c w').
    direction = _wide(np.array(as_complex(mechanism.gravity_direction)).conj(), real)
    gravity = direction * np.asarray(mechanism.gravity, dtype=real)
    weights = (masses[..., None, :] @ centres)[..., 0, :] * gravity[..., None]
    for element, point in terms.pulls:
        force = np.array(as_complex(element.force)).conj()[..., None]
        weights = weights + _wide(force * point.coefficients, real)
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    springs = [vector for _, vector in terms.springs]
    sections: dict[str, Complex] = {
        "products": _products(centres, masses, kinematics, real),
        "weights": _waves(weights, kinematics),
        "loops": points(kinematics.loop_closures),
        "points": points(gaps),
        "lead": _waves(lead, kinematics),
        # What is taken off the waves (or angles) of a gap.
        "limits": stacked([-gap.constant * unilateral for gap in gaps]),
        "lines": waves([line.vector.coefficients for line in lines], vectors=True),
        "directions": stacked([line.direction for line in lines]),
        "line_offsets": stacked([line.vector.offset for line in lines]),
        "springs": waves([vector.coefficients for vector in springs], vectors=True),
        "spring_offsets": stacked([vector.offset for vector in springs]),
        "spring_data": stacked([x for row in zip(*spring_data, strict=True) for x in row]),
        "twist_data": stacked([x for row in zip(*twist_data, strict=True) for x in row]),
    }
    parts: list[Real] = []
    for name, section in sections.items():
        flat = section.reshape(*machines, -1)
        parts.append(flat.real)
        if name not in ("limits", "spring_data", "twist_data"):
            parts.append(flat.imag)
    return cast("Real", np.concatenate(parts, axis=-1).astype(real))


def _wide(values: NDArray[np.complex128], real: RealType) -> Complex:
    return values.astype(np.result_type(real, np.complex64))


def _waves(rows: Complex, kinematics: Kinematics, vectors: bool = False) -> Complex:
    """Waves z with Re(row w') = Re(z e^{iq}) of an angle, w' = -i e^{-iq}; of a slide Re(z).

    Of vectors both parts of row w' are needed, and of a slide on a line that turns always.
    """
    slides = rows.conj() if vectors else rows.real.astype(rows.dtype)
    for k, _ in kinematics.carried:
        slides[..., k] = rows[..., k].conj()
    return cast("Complex", np.where(kinematics.is_angle > 0, 1j * rows.conj(), slides))


def _products(centres: Complex, masses: Real, kinematics: Kinematics, real: RealType) -> Complex:
    """Upper triangle of C^H diag(m) C as waves: H_ij = conj(w'_i) K_ij w'_j."""
    products = np.triu((centres.conj().swapaxes(-1, -2) * masses[..., None, :]) @ centres)
    n, carried = int(kinematics.is_angle.sum()), {k for k, _ in kinematics.carried}
    products[..., :n, n:] *= 1j
    for k in (k for k in range(n, products.shape[-1]) if k not in carried):
        level = [j for j in range(n, k + 1) if j not in carried]
        products[..., level, k] = products[..., level, k].real
    diagonal = np.einsum("...ii->...i", products)  # a view
    diagonal[...] = diagonal.real + kinematics.inertias.astype(real)
    return cast("Complex", products)


def projectile_row(mechanism: Mechanism, kinematics: Kinematics) -> PointCoefficients:
    """The projectile's position; zeros where a machine throws nothing."""
    projectile = mechanism.marker(PROJECTILE)
    if projectile is None:
        return PointCoefficients(0j, np.zeros_like(kinematics.centres[..., 0, :]))
    return kinematics.point(projectile.body, projectile.point)


def rests_of(mechanism: Mechanism) -> frozenset[str]:
    """Stops that hold the projectile's own body at the start."""
    bodies = {marker.body for marker in mechanism.markers if marker.name == PROJECTILE}
    return frozenset(stop.name for stop in mechanism.stops if stop.closed and stop.body in bodies)
