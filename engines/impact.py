"""Impacts of adapters: which contacts push, and by what impulses.

Newton's law of restitution with complementarity (Moreau 1988; Glocker and Pfeiffer, Nonlinear
Dynamics 7, 1995): with v the speeds of the gaps before an impact and v+ after it, the impulses p of
the contacts that touch are

    0 <= p  complementary to  v+ + e v >= 0,        v+ = v + A p,

A being the inverse inertia that they feel. v+ is unique; impulses of redundant contacts are not.
Where these have different e, the one that asks for the highest speed pushes and the others part.
Where contacts stand against each other no v+ may give each its rebound: then none of them rebounds.

With W the inverse of an engine's mass matrix on the motions that its loops allow, and G the gap
Jacobian, A is G W G^T (:class:`Inertia`, :func:`resolve_impact`), in any coordinates.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import SimulationError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.problem import SETTLED, speed_scale

AT_REST = 1e-9  # [rad/s, m/s] gap speeds below this are rounding errors of an impact's solution
_ROUNDING = 1e-10  # of the largest impulse, or speed: error of those that are zero
_RANK = 1e-12  # of the largest singular value: redundant constraints have smaller ones
# The same where errors of positions are undone: near singular positions they would grow.
_NEARLY = 1e-6

Contacts = tuple[str, ...]  # names of stops, in the order of the mechanism's


# --- Which contacts push


def resting(speeds: Mapping[str, float], rounding: float = AT_REST) -> Contacts:
    """Contacts that neither part nor close, by the speeds of their gaps [rad/s, m/s]."""
    return tuple(name for name, speed in speeds.items() if abs(speed) <= rounding)


def active_contacts(touching: Contacts, violated: Callable[[Contacts], str | None]) -> Contacts:
    """The touching contacts that push while the others open, all decided at once.

    This is the complementarity problem 0 <= force, complementary to gap acceleration (or speed) >=
    0. Murty's least-index pivoting (Opsearch 11, 1974) moves the first contact that violates its
    condition to the other side until none does; it ends because the problem has one solution. A set
    that comes up twice means zeros, whose sign is that of their rounding errors: it is accepted.

    Args:
        touching: contacts with zero gap and zero gap speed.
        violated: by a set of active contacts, the first one of `touching` that would have to pull
            while it is active, or close while it is inactive, or None.
    """
    active, tried = touching, set[Contacts]()
    while touching and active not in tried and (wrong := violated(active)):
        tried.add(active)
        active = tuple(name for name in touching if (name in active) != (name == wrong))
    return active


def pushing(touching: Contacts, violated: Callable[[Contacts], str | None]) -> Contacts | None:
    """The contacts that push in an impact; None if no set of them fulfils the law.

    `violated` is as for :func:`active_contacts`: one that breaks the law if a set of them pushes.
    """
    active = active_contacts(touching, violated)
    if violated(active) is None:
        return active
    # Pivoting has no end where redundant contacts ask for different speeds: the sets are tried one
    # by one, the largest first.
    for size in range(len(touching), -1, -1):
        for chosen in itertools.combinations(touching, size):
            if violated(chosen) is None:
                return chosen
    return None


# --- Impulses


def impulses(matrix: FloatArray, speeds: FloatArray, restitution: FloatArray) -> FloatArray | None:
    """Impulses of the contacts that touch [N m s, N s]; None if none exist.

    Redundant contacts get the impulses of the least norm.

    Args:
        matrix: A, symmetric and positive semidefinite, shape (n, n).
        speeds, restitution: v [rad/s, m/s] and e, each of shape (n,).
    """
    rebounding = _complementary(matrix, (1.0 + restitution) * speeds)
    return _complementary(matrix, speeds) if rebounding is None else rebounding


def _complementary(matrix: FloatArray, offset: FloatArray) -> FloatArray | None:
    """The p >= 0 complementary to matrix p + offset >= 0, or None."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    scaled, target = scale[:, None] * matrix * scale, -scale * offset
    rounding = _ROUNDING * np.abs(target).max(initial=0.0)
    names = tuple(map(str, range(len(offset))))

    def solution(active: Contacts) -> FloatArray:
        where = [int(name) for name in active]
        result = np.zeros(len(names))
        result[where] = np.linalg.lstsq(scaled[np.ix_(where, where)], target[where], _RANK)[0]
        return result

    def violated(active: Contacts) -> str | None:
        result = solution(active)
        left, acts = scaled @ result - target, np.isin(names, active)
        pulls = acts & (result < -rounding)
        closes = ~acts & (left < -rounding)
        parts = acts & (abs(left) > rounding)
        wrong = pulls | closes if (pulls | closes).any() else parts
        return names[int(np.argmax(wrong))] if wrong.any() else None

    active = pushing(names, violated)
    return None if active is None else scale * np.maximum(solution(active), 0.0)


# --- Impacts by a mass matrix


@dataclass(frozen=True)
class Impact:
    """Speeds and impulses of one impact."""

    speeds: FloatArray  # after it, shape (n_v,)
    impulses: Mapping[str, float]  # of the contacts that touch [N m s, or N s for one on a point]
    left: Mapping[str, float]  # speeds of their gaps after it [rad/s, m/s]


def inverse(mass: FloatArray) -> FloatArray:
    """Inverse of a mass matrix, scaled to a diagonal of ones: for light and heavy bodies alike."""
    scale = 1.0 / np.sqrt(np.diag(mass))
    return scale[:, None] * np.linalg.inv(scale[:, None] * mass * scale) * scale


def mass_matrix(kinematics: Kinematics, q: FloatArray) -> FloatArray:
    """Mass matrix of a mechanism in positions q, shape (..., n_q) -> (..., n_q, n_q)."""
    jacobian = kinematics.gradient(
        kinematics.centres, q[..., None, :], kinematics.rates(q)[..., None, :]
    )
    products = (np.swapaxes(jacobian.conj(), -1, -2) * kinematics.masses) @ jacobian
    return products.real + kinematics.inertia_matrix


@dataclass(frozen=True)
class Inertia:
    """Response of the speeds to impulses in one position."""

    mass: FloatArray  # full mass matrix, shape (n_v, n_v)
    loops: FloatArray  # Jacobian of the joints that close loops, shape (n_loops, n_v)

    def without_drift(self, speeds: FloatArray, active: FloatArray) -> FloatArray:
        """Speeds (n_v,) that violate neither loops nor active contacts of Jacobian (n_active, n_v).

        Soft constraints leave them speeds of some 1e-9 rad/s, which are none of an impact's.
        """
        return self._allowed(np.concatenate([self.loops, active])) @ speeds

    def move_onto(self, active: FloatArray, residual: FloatArray) -> FloatArray:
        """The least change of the position that makes residuals zero, shape (n_v,).

        Residuals are those of the loops, then of the active contacts, shape (n_loops + n_active,).
        """
        rows = np.concatenate([self.loops, active])
        by_impulse = inverse(self.mass) @ rows.T
        return -by_impulse @ np.linalg.pinv(rows @ by_impulse, _NEARLY, hermitian=True) @ residual

    def response(self) -> FloatArray:
        """W, shape (n_v, n_v)."""
        return self._allowed(self.loops) @ inverse(self.mass)

    def _allowed(self, rows: FloatArray) -> FloatArray:
        """Projection of speeds on those with rows @ speeds = 0, orthogonal in the mass metric."""
        by_impulse = inverse(self.mass) @ rows.T
        response = np.linalg.pinv(rows @ by_impulse, _RANK, hermitian=True)
        return np.eye(len(self.mass)) - by_impulse @ response @ rows


def resolve_impact(
    inertia: Inertia,
    speeds: FloatArray,
    gaps: Mapping[str, FloatArray],
    restitution: Mapping[str, float],
    engine: str,
) -> Impact:
    """The impact of the contacts that touch.

    Args:
        inertia: at the position there.
        speeds: before, without drift, shape (n_v,).
        gaps, restitution: gap Jacobian (n_v,) and e of each contact that touches.
        engine: its name in the message.

    Raises:
        SimulationError: no set of contacts takes part.
    """
    names, rows = tuple(gaps), np.array(list(gaps.values()))
    by_impulse = inertia.response() @ rows.T
    coefficients = np.array([restitution[name] for name in names])
    solution = impulses(rows @ by_impulse, rows @ speeds, coefficients)
    if solution is None:
        raise SimulationError(
            f"{engine} finds no impact of the stops {', '.join(names)} in which all of them push."
        )
    after = speeds + by_impulse @ solution
    return Impact(
        after,
        dict(zip(names, solution.tolist(), strict=True)),
        dict(zip(names, (rows @ after).tolist(), strict=True)),
    )


# --- Least speeds of rebounds


class Rebounds:
    """Least speeds at which the stops of one motion rebound; see :data:`SETTLED`."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._kinematics = Kinematics(mechanism)
        self._energy = 0.0

    def note_impact(self, q: FloatArray, u: FloatArray) -> None:
        """Take the state before an impact into account, each of shape (n_q,)."""
        self._energy = max(self._energy, float(self._kinematics.kinetic_energy(q, u)))

    def least_speed(self, stop: str, q: FloatArray, u: FloatArray | None = None) -> float:
        """Closing speed of a stop's gap at q below which it does not rebound [rad/s, m/s].

        Speeds u there are taken into account as those before an impact are.
        """
        now = 0.0 if u is None else float(self._kinematics.kinetic_energy(q, u))
        # Speed of the gap by a unit impulse of its stop, loops kept closed [1/(kg m^2), 1/kg].
        row, loops = self._kinematics.gap_jacobian(stop, q), self._kinematics.loop_jacobian(q)
        n, m = len(row), len(loops)
        mass, system = mass_matrix(self._kinematics, q), np.zeros((n + m, n + m))
        size = float(np.abs(mass).max())
        system[:n, :n], system[n:, :n], system[:n, n:] = mass / size, loops, loops.T
        # Loops may be redundant: the motion is unique all the same.
        response = np.linalg.lstsq(system, np.append(row / size, np.zeros(m)))[0][:n]
        return SETTLED * speed_scale(max(self._energy, now), float(row @ response))
