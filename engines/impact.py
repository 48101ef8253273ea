"""The impact of all contacts that touch, through an engine's full mass matrix and the joints that close loops.

With W the inverse of the mass matrix on the motions that the loops allow, and G the gap Jacobian,
the impulses x solve

    0 <= x  complementary to  G W G^T x + (1 + e) G v >= 0

(Newton's law of restitution, Moreau), all contacts at once (:mod:`.impact_law`); v are speeds in
any coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import SimulationError
from . import impact_law

_RANK = 1e-12  # of the largest singular value: redundant constraints have smaller ones
_NEARLY = (
    1e-6  # the same where errors of positions are undone: near singular positions they would grow
)


@dataclass(frozen=True)
class Impact:
    """What an impact does."""

    speeds: FloatArray
    """After it, shape (n_v,)."""
    impulses: Mapping[str, float]
    """Of the contacts that touch [N m s, or N s for one on a point]."""
    left: Mapping[str, float]
    """Speeds of their gaps after it [rad/s, m/s]."""


@dataclass(frozen=True)
class Inertia:
    """What impulses do to the speeds in one position."""

    mass: FloatArray
    """Full mass matrix, shape (n_v, n_v)."""
    loops: FloatArray
    """Jacobian of the joints that close loops, shape (n_loops, n_v)."""

    def without_drift(self, speeds: FloatArray, active: FloatArray) -> FloatArray:
        """Speeds that violate neither the loops nor the active contacts, whose Jacobian has shape (n_active, n_v).

        Soft constraints leave them speeds of some 1e-9 rad/s, which are none of an impact's.
        """
        return self._allowed(np.concatenate([self.loops, active])) @ speeds

    def move_onto(self, active: FloatArray, residual: FloatArray) -> FloatArray:
        """The least change of the position that makes residuals of the loops and of the active contacts zero, (n_v,).

        Args:
            active: Jacobian of the contacts, shape (n_active, n_v).
            residual: of the loops, then of the contacts, shape (n_loops + n_active,).
        """
        rows = np.concatenate([self.loops, active])
        by_impulse = self._inverse() @ rows.T
        return -by_impulse @ np.linalg.pinv(rows @ by_impulse, _NEARLY, hermitian=True) @ residual

    def response(self) -> FloatArray:
        """W, shape (n_v, n_v)."""
        return self._allowed(self.loops) @ self._inverse()

    def _inverse(self) -> FloatArray:
        # Scaled to a diagonal of ones: joints of a light body and of a heavy one are equally well
        # inverted.
        scale = 1.0 / np.sqrt(np.diag(self.mass))
        return scale[:, None] * np.linalg.inv(scale[:, None] * self.mass * scale) * scale

    def _allowed(self, rows: FloatArray) -> FloatArray:
        """Projection of speeds on those with rows @ speeds = 0, orthogonal in the metric of the mass matrix."""
        by_impulse = self._inverse() @ rows.T
        return (
            np.eye(len(self.mass))
            - by_impulse @ np.linalg.pinv(rows @ by_impulse, _RANK, hermitian=True) @ rows
        )


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
        gaps: gap Jacobian of each contact that touches, shape (n_v,).
        restitution: e of each of them.
        engine: its name in the message.

    Raises:
        SimulationError: no set of contacts takes part.
    """
    names, rows = tuple(gaps), np.array(list(gaps.values()))
    by_impulse = inertia.response() @ rows.T
    coefficients = np.array([restitution[name] for name in names])
    impulses = impact_law.impulses(rows @ by_impulse, rows @ speeds, coefficients)
    if impulses is None:
        raise SimulationError(
            f"{engine} finds no impact of the stops {', '.join(names)} in which all of them push."
        )
    after = speeds + by_impulse @ impulses
    return Impact(
        after,
        dict(zip(names, impulses.tolist(), strict=True)),
        dict(zip(names, (rows @ after).tolist(), strict=True)),
    )
