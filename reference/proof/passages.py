"""Times at which a sum of coordinates passes a level along a proved motion."""

from __future__ import annotations

from collections.abc import Sequence

from .balls import Ball, arb, exact
from .events import zeros
from .motion import ProvedMotion
from .steps import Step, TaylorModel


def passages(
    motion: ProvedMotion, factors: Sequence[float], level: float, count: int
) -> list[Ball]:
    """Enclose the first times at which a sum of coordinates passes a level.

    Args:
        motion: in whose precision the context is.
        factors: of the coordinates.
        level: of the sum.
        count: number of times.

    Returns:
        The times [s], each the only one between its neighbours.

    Raises:
        UndecidedZeroError: balls do not tell a passage from a touch.
        IndexError: there are fewer.
    """
    found, n_q = list[Ball](), motion.structure.n_q
    for k, phase in enumerate(motion.phases):
        over = motion.phases[k + 1].start if k + 1 < len(motion.phases) else None
        for step in phase.steps:
            function = _sum(step, factors, 0)
            at_start, *more = function.coefficients
            function = TaylorModel([at_start - level, *more], function.remainder)
            for zero in zeros(function, _sum(step, factors, n_q), step.length):
                t = phase.start + exact(step.start) + zero.time
                if over is not None and not t < over:
                    break  # of a motion that has changed before
                found.append(t)
                if len(found) == count:
                    return found
    raise IndexError(f"{len(found)} passages, not {count}")


def _sum(step: Step, factors: Sequence[float], first: int) -> TaylorModel:
    """A sum of coordinates, or of speeds, of all motions of a step's set."""
    total, remainder = [arb(0)] * len(step.motion[0].coefficients), arb(0)
    for k, factor in enumerate(factors):
        model, off = step.motion[first + k], step.tube.apart[first + k]
        total = [a + factor * c for a, c in zip(total, model.coefficients, strict=True)]
        total[0] = total[0] + abs(factor) * arb(0, off)
        remainder = remainder + factor * model.remainder
    return TaylorModel(total, remainder)
