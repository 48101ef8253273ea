r"""A machine for the Taylor integrator: a vector of numbers, and the structure that says which of them are zero.

All that :mod:`..equations` computes with complex rates is a sum of real waves Re(z e^{i phase}) with constant z:

    M_ij = Re(z e^{i(q_i - q_j)})                           z = K_ij (and the inertias on the diagonal)
    b_i  = sum_j Im(z e^{i(q_i - q_j)}) u_j^2
    Q_i  = Re(z e^{i q_i})                                  z = i W_i
    G_kj = Re(z e^{i q_j}),  gamma_k = -sum_j Im(z e^{i q_j}) u_j^2   z = i conj(L_kj)
    gap_k = sum_j Im(z e^{i q_j}) - limit                   of a stop on a point: the same z as its gradient's

and the same without the phase and the i of a coordinate that is a slide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...models.kinematics import AngleFunction, Kinematics, PointCoefficients, PointFunction
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw

Real = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]
RealType = type[np.float64] | type[np.longdouble]

PROJECTILE = "projectile"


@dataclass(frozen=True)
class Structure:
    """What a compiled integrator depends on: sizes, stops, and which numbers are zero."""

    n_angles: int
    n_slides: int
    n_loops: int
    gap_rows: tuple[tuple[int, ...] | None, ...]
    """Gradient of each stop's gap; None for a stop on a point, whose gradient is a row of waves."""
    closes: bool
    """Whether stops may close (unilateral law)."""
    present: tuple[bool, ...]
    """Which of the numbers are runtime parameters, the others being zero."""
    throws: bool
    """Whether there is a projectile, whose launch can be located."""

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return self.n_angles + self.n_slides

    @property
    def n_states(self) -> int:
        """Number of variables the integrator has: q, u and an observer."""
        return 2 * self.n_q + 1

    @property
    def n_stops(self) -> int:
        """Number of stops that may ever be active."""
        return len(self.gap_rows)

    @property
    def point_stops(self) -> tuple[int, ...]:
        """Numbers of the stops on points."""
        return tuple(k for k, row in enumerate(self.gap_rows) if row is None)

    @property
    def sections(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of what the numbers are, in their order; the first axis is real, imaginary."""
        n_q = self.n_q
        shapes: dict[str, tuple[int, ...]] = {"products": (n_q, n_q), "weights": (n_q,)}
        shapes |= {"loops": (self.n_loops, n_q), "points": (len(self.point_stops), n_q), "lead": (n_q,)}
        return {name: (2, *shape) for name, shape in shapes.items()} | {"limits": (self.n_stops,)}

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
    gaps = [kinematics.gaps[name] for name in relevant_stops(problem)]
    rows = [gap.coefficients if isinstance(gap, AngleFunction) else None for gap in gaps]
    n_angles = len(problem.mechanism.angles)
    return Structure(
        n_angles=n_angles,
        n_slides=len(problem.mechanism.coordinates) - n_angles,
        n_loops=len(kinematics.loop_closures),
        gap_rows=tuple(None if row is None else tuple(int(entry) for entry in row) for row in rows),
        closes=problem.stop_law is StopLaw.UNILATERAL,
        present=tuple(bool(flag) for flag in present),
        throws=bool(np.any(projectile_row(problem.mechanism, kinematics).coefficients)),
    )


def numbers_of(problem: Problem, kinematics: Kinematics, real: RealType) -> Real:
    """All numbers of a machine as one vector, computed in the precision asked for; order as in `Structure.sections`."""
    mechanism, angles = problem.mechanism, kinematics.is_angle > 0
    masses = kinematics.masses.astype(real)
    centres = _wide(kinematics.centres, real)
    gaps = [kinematics.gaps[name] for name in relevant_stops(problem)]

    def rows(of: Sequence[PointFunction]) -> Complex:
        coefficients = np.array([row.coefficients for row in of], dtype=np.complex128).reshape(len(of), len(angles))
        return _waves(_wide(coefficients, real), angles)

    # The component across the launch direction is Im(e^{-i angle} v) = Re(-i e^{-i angle} v).
    lead = _wide(projectile_row(mechanism, kinematics).coefficients, real) * (np.exp(-1j * real(LAUNCH_ANGLE)) * -1j)
    sections = (
        _products(centres, masses, kinematics.inertias.astype(real), angles),
        # Q = Re(conj(w') W) = Re(conj(W) w') with W = -i g C^H m.
        _waves((masses @ centres) * (1j * real(mechanism.gravity)), angles),
        # Rows L with Re(L w' u) the rates of the loops' constraints, and the gap speeds of the stops on points.
        rows([closure for closure in kinematics.loop_closures if isinstance(closure, PointFunction)]),
        rows([gap for gap in gaps if isinstance(gap, PointFunction)]),
        _waves(lead, angles),
    )
    parts = [np.stack([section.real, section.imag]).ravel() for section in sections]
    unilateral = problem.stop_law is StopLaw.UNILATERAL
    # What is taken off the waves (or angles) of a gap.
    limits = [-gap.constant * unilateral for gap in gaps]
    return cast("Real", np.concatenate([*parts, np.array(limits, dtype=real)]).astype(real))


def _wide(values: NDArray[np.complex128], real: RealType) -> Complex:
    return values.astype(np.result_type(real, np.complex64))


def _waves(rows: Complex, angles: NDArray[np.bool_]) -> Complex:
    """Waves z with Re(row w') = Re(z e^{iq}) for an angle, w' = -i e^{-iq}, and Re(z) for a slide, w' = 1."""
    return cast("Complex", np.where(angles, 1j * rows.conj(), rows.real))


def _products(centres: Complex, masses: Real, inertias: Real, angles: NDArray[np.bool_]) -> Complex:
    """Upper triangle of C^H diag(m) C as waves: H_ij = conj(w'_i) K_ij w'_j."""
    products = np.triu((centres.conj().T * masses) @ centres)
    n = int(angles.sum())
    products[:n, n:] *= 1j
    products[n:, n:] = products[n:, n:].real
    np.fill_diagonal(products, products.diagonal().real + inertias)
    return cast("Complex", products)


def projectile_row(mechanism: Mechanism, kinematics: Kinematics) -> PointCoefficients:
    """The projectile's position; zeros where a machine throws nothing."""
    projectile = mechanism.marker(PROJECTILE)
    if projectile is None:
        return PointCoefficients(0j, np.zeros(len(kinematics.is_angle), dtype=np.complex128))
    return kinematics.point(projectile.body, projectile.point)


def rests_of(mechanism: Mechanism) -> frozenset[str]:
    """Stops that hold the projectile's own body at the start."""
    bodies = {marker.body for marker in mechanism.markers if marker.name == PROJECTILE}
    return frozenset(stop.name for stop in mechanism.stops if stop.closed and stop.body in bodies)
