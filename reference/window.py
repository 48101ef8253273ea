"""A window of time across a singular position, in which the motion is one polynomial (:mod:`.singular` finds it)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import DenseOutput

from ..models.arrays import FloatArray
from ..models.errors import SimulationError
from .collocation import Polynomial

BESIDE = 1e-3  # of a window's half: as near to a singular position counts as in it
_POLE = 1e-5  # of a window's half


@dataclass(frozen=True)
class SingularPassage:
    """A singular position that the motion went through on its smooth branch."""

    time: float
    """[s]"""
    time_uncertainty: float
    """[s]"""
    uncertainty: float
    """By which the coordinates behind it differ between two polynomials [rad, m of the largest arm's part]."""
    lost: int
    """How many of the independent constraints depend on the others there."""


@dataclass(frozen=True)
class Window:
    """The motion from beside a singular position to beside it again, and the passages in it."""

    start: float
    end: float
    passages: tuple[SingularPassage, ...]
    motion: Polynomial
    forces: FloatArray
    """Legendre series of the multipliers, times the distances from all poles in halves of the window."""
    poles: FloatArray
    """Times of all passages, also of those after `end` [s]."""

    def until(self, end: float, releases: bool) -> Window:
        """The part up to `end` [s], where a stop opens or not.

        Raises:
            SimulationError: a stop's torque passes a pole there instead of zero.
        """
        if releases and np.any(np.abs(self.poles - end) < BESIDE * self.motion.half):
            raise SimulationError(
                f"the reference gave up at t = {end:.6g} s: a stop opens in a singular position, in which its torque "
                "grows beyond all bounds."
            )
        return replace(
            self,
            end=end,
            passages=tuple(passage for passage in self.passages if passage.time <= end),
        )

    def dense_output(self) -> DenseOutput:
        """As that of an integrator's step."""
        return _WindowOutput(self)

    def accelerations(self, t: FloatArray) -> FloatArray:
        """Of the branch at times t [s], shape (n, n_q)."""
        return self.motion.values(self.motion.a, t)

    def multipliers(self, t: FloatArray) -> FloatArray:
        """Shape (n, n_constraints); as 1/(t - time) beside a passage unless the branch needs no such force.

        Within a hundred-thousandth of the window the mean of both sides is given: the finite part.
        """
        near = _POLE * self.motion.half
        of = (
            np.argmin(np.abs(t[:, None] - self.poles), axis=1)
            if len(self.poles)
            else np.zeros(len(t), dtype=int)
        )
        pole = self.poles[of] if len(self.poles) else np.full(len(t), np.inf)
        inside = np.abs(t - pole) < near
        sides = [np.where(inside, pole + side * near, t) for side in (-1.0, 1.0)]
        return 0.5 * np.sum(
            [self.motion.values(self.forces, at) / self._distances(at) for at in sides], axis=0
        )

    def _distances(self, t: FloatArray) -> FloatArray:
        return np.prod((t[:, None] - self.poles) / self.motion.half, axis=1)[:, None]


class _WindowOutput(DenseOutput):
    def __init__(self, window: Window) -> None:
        super().__init__(window.start, window.end)
        self._motion = window.motion

    def _call_impl(self, t: FloatArray) -> FloatArray:
        m = self._motion
        return np.concatenate([m.values(m.q, t), m.values(m.u, t)], axis=-1).T
