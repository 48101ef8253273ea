"""Stops at which a motion has derivatives to one side only.

A stop that touches without a force divides the changes of a mechanism's numbers into two kinds:

- It touches at the start, and opens there, because it would have to pull. A change that opens the
  gap leaves the motion smooth; one towards the stop strikes it. Derivatives are those of the motion
  without the stop.
- It is active without force for some time (a body at rest beside a wall, with nothing that presses
  it). A change that presses it on leaves it active; one the other way opens it. Derivatives are
  those of the motion with the stop active.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ..contact import gap_jacobian
from ..solution import Segment
from .dual import Dual
from .variational import VariationalEquations, movable

_TOUCHES = 1e-9  # [m], [rad] and their rates: of gaps and gap speeds at the start that are zero
# Of the largest derivative: gaps, gap speeds and forces that change by less do not change.
_MOVES = 1e-9
_NO_FORCE = 1e-12  # of what the stop would carry if it took all forces on the mechanism


@dataclass(frozen=True)
class Kink:
    """A stop at which derivatives hold to one side."""

    stop: str
    t: float
    """[s]."""
    sides: FloatArray
    """Sides on which derivatives hold: 1 along a direction, -1 against it, 0 both; (m,)."""
    otherwise: str
    """What steps to the other side do, such as "strikes floor, which ..."."""


def kinks_at_start(
    equations: VariationalEquations, q: Dual, u: Dual, taking_part: Sequence[str]
) -> list[Kink]:
    """Kinks of the stops that touch at the start and are left there.

    Args:
        equations: of the motion.
        q, u: the state behind an impact at the start, and its derivatives.
        taking_part: stops that are active, or struck there.
    """
    found: list[Kink] = []
    for stop in equations.mechanism.stops:
        if (
            stop.name in taking_part
            or abs(float(equations.kinematics.gap(stop.name, q.value))) > _TOUCHES
        ):
            continue
        gap, speed, speed_now = equations.gap_tangents(q, u, stop.name)
        sides = _signs(gap, q.tangents)
        if abs(speed_now) <= _TOUCHES:
            sides = np.where(sides == 0, _signs(speed, u.tangents), sides)
        found.append(
            Kink(
                stop.name,
                0.0,
                sides,
                f"strikes {stop.name}, which touches at the start without a force",
            )
        )
    return [kink for kink in found if kink.sides.any()]


def kinks_of_kicks(
    equations: VariationalEquations, q: Dual, u: Dual, active: Sequence[str]
) -> list[Kink]:
    """Kinks of active stops with restitution 1: a step towards them never comes to rest.

    Args:
        equations: of the motion.
        q, u: the start, and its derivatives before the active stops take any of them.
        active: stops that are active from the start on.
    """
    found: list[Kink] = []
    for name in active:
        if equations.mechanism.stop(name).restitution == 1:
            sides = np.where(
                _signs(equations.gap_tangents(q, u, name)[1], u.tangents) == 0, 0.0, np.nan
            )
            found.append(
                Kink(name, 0.0, sides, f"bounces on {name} for ever, because its restitution is 1")
            )
    return [kink for kink in found if kink.sides.any()]


def kinks_along(
    equations: VariationalEquations, segment: Segment, ends: Sequence[tuple[Dual, Dual]]
) -> list[Kink]:
    """Kinks of the stops that are active without force over a whole segment.

    Args:
        segment: of the motion.
        ends: the states at its two ends, with their derivatives.
    """
    idle = [
        name for name in movable(equations, segment.closed) if _is_idle(equations, segment, name)
    ]
    if not idle:
        return []
    forces = [equations.accelerations(q, u, segment.closed)[1] for q, u in ends]
    kinks: list[Kink] = []
    for name in idle:
        k = equations.n_loops + segment.closed.index(name)
        signs = np.array([_signs(force.tangents[k], force.tangents) for force in forces])
        sides = np.where(
            signs[0] * signs[-1] < 0, np.nan, np.where(signs[0] == 0, signs[-1], signs[0])
        )
        otherwise = f"opens {name}, which carries no force from t = {segment.start:.6g} s on"
        kinks.append(Kink(name, segment.start, sides, otherwise))
    return [kink for kink in kinks if kink.sides.any()]


def _is_idle(equations: VariationalEquations, segment: Segment, name: str) -> bool:
    k, angles = equations.n_loops + segment.closed.index(name), equations.kinematics.is_angle > 0
    for t in np.linspace(segment.start, segment.end, 3):
        q, u = np.asarray(segment.interpolant(t), dtype=np.float64).reshape(2, -1)
        row = gap_jacobian(equations, q, (name,))[0]
        mass = equations.mass_matrix(q)
        forces = equations.forces(q, u)
        mobility = float(row @ np.linalg.solve(mass, row))
        turning = float(u @ mass @ u) * np.abs(u[angles]).max(initial=0.0) ** 2
        size = np.sqrt((float(forces @ np.linalg.solve(mass, forces)) + turning) / mobility)
        if abs(float(equations.solve(q, u, segment.closed)[1][k])) > _NO_FORCE * size:
            return False
    return True


def _signs(values: FloatArray, state: FloatArray) -> FloatArray:
    """Signs of derivatives, 0 of those that are rounding of the state's, shape (m,)."""
    size = np.maximum(1.0, np.abs(state).max(axis=0))
    return np.where(np.abs(values) > _MOVES * size, np.sign(values), 0.0)


def sides(kinks: Sequence[Kink], m: int) -> FloatArray:
    """Sides on which derivatives hold: 1, -1, 0 for both, NaN for neither; shape (m,)."""
    each = np.array([kink.sides for kink in kinks]).reshape(-1, m)
    both = (each > 0).any(axis=0) & (each < 0).any(axis=0)
    return np.where(both, np.nan, np.sign(each.sum(axis=0)))  # NaN stays


def one_sided(kinks: Sequence[Kink], names: Sequence[str]) -> list[str]:
    """Sentences on the directions along which derivatives hold to one side, or to none.

    Args:
        kinks: of a motion.
        names: of the directions, shape (m,).
    """
    held = sides(kinks, len(names))
    # Directions on which the same happens to the other side, by what that is.
    alike: dict[str, list[int]] = {}
    for j in np.flatnonzero(held).tolist():
        events = dict.fromkeys(kink.otherwise for kink in kinks if kink.sides[j])
        alike.setdefault(" and ".join(events), []).append(j)
    sentences: list[str] = []
    for event, directions in alike.items():
        up = [names[j] for j in directions if held[j] > 0]
        down = [names[j] for j in directions if held[j] < 0]
        neither = [names[j] for j in directions if np.isnan(held[j])]
        ways: list[str] = []
        if up:
            ways.append(f"an increase of {_listed(up)}")
        if down:
            ways.append(f"a decrease of {_listed(down)}")
        if ways:
            sentences.append(
                f"derivatives hold one way only for {' and '.join(ways)}: the other way {event}"
            )
        if neither:
            sentences.append(f"there is no derivative by {_listed(neither)}: either way {event}")
    return sentences


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
