"""Rounding to single precision as a cause, told by runs at other time steps.

Shorter steps do not take such a deviation out: there are more of them, and each is rounded. Three
kinds of runs tell its parts:

- Steps of two and four times the length. Rounding matters less in them; what grows with them as h^p
  is the step's own error, d(4h) - d(2h) = (4^p - 2^p) c h^p.
- Steps that differ by 1e-4 of their length. The step's error differs by as little, but every sum is
  rounded otherwise: the distance of such motions is sqrt(2) times what rounding makes of one.
- Half the step. What remains of the deviation without the step's error, and is larger there by half
  or more, is made by the number of steps; it falls as 1 / h or 1 / h^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from ...models.arrays import FloatArray
from ..runs.results import RankedCause

Run = Callable[[float], FloatArray | None]
"""Deviation of the engine at another step [s]; None where it cannot be run."""

_ALIKE = (1.0 - 1e-4, 1.0 + 1e-4)  # of the step: of other roundings, and of the same error else
_ORDERS = (1, 2)  # of the integrators of engines in single precision
_POWERS = (1, 2)  # of 1 / h: roundings add up with the steps, and twice from speeds to positions
_GROWN = 1.5  # times at half the step: what grows by less may be noise


def rounding_causes(deviation: FloatArray, step: float, run: Run) -> Iterator[RankedCause]:
    """The step's own error, rounding, and both, with the shares that runs tell of them.

    Args:
        deviation: of the engine at its step, flat.
        step: [s].
        run: the engine at other steps.
    """
    noise = _noise(deviation, [run(factor * step) for factor in _ALIKE])
    if noise is None:
        return
    of_step, order = _error_of_step(deviation, run(2 * step), run(4 * step))
    half = run(step / 2)
    growing, power = 0.0 * deviation, 0
    if half is not None:
        growing, power = _growing(deviation - of_step, half - of_step / 2**order)
    alone = _share(deviation, of_step, 0.0)
    rounded = max(_share(deviation, part, noise) for part in (0.0 * deviation, growing))
    both = _share(deviation, of_step + growing, noise)

    def cause(name: str, amount: str, explained: float) -> RankedCause:
        return RankedCause(
            name=name, kind="settings", amount=amount, explained=explained, confirmed=True
        )

    size = float(np.linalg.norm(deviation))
    in_steps = f"steps of {2 * step:.3g} and {4 * step:.3g} s show an error of order {order}"
    in_sums = f"in steps that differ by 1e-4 motions are {noise / size:.2g} of the deviation apart"
    if power:
        in_sums += f", and a part grows with shorter steps as 1/h^{power}"
    yield cause("time step", in_steps, alone)
    yield cause("rounding to single precision", in_sums, rounded)
    if 1.0 - both < (1.0 - max(alone, rounded)) / 2:
        yield cause("time step, rounding to single precision", f"{in_steps}; {in_sums}", both)


def _noise(deviation: FloatArray, alike: list[FloatArray | None]) -> float | None:
    """Size of what rounding makes of a motion at random; None where no run tells it."""
    apart = [float(np.linalg.norm(other - deviation)) for other in alike if other is not None]
    return math.sqrt(np.mean(np.square(apart)) / 2) if apart else None


def _error_of_step(
    deviation: FloatArray, twice: FloatArray | None, four_times: FloatArray | None
) -> tuple[FloatArray, int]:
    """Part of the deviation that grows with the step, and its order; zeros where none does."""
    nothing = 0.0 * deviation
    if twice is None or four_times is None:
        return nothing, _ORDERS[0]
    parts = {order: (four_times - twice) / (4**order - 2**order) for order in _ORDERS}
    order = max(parts, key=lambda order: _share(deviation, parts[order], 0.0))
    helps = _share(deviation, parts[order], 0.0) > 0
    return (parts[order] if helps else nothing), order


def _growing(rest: FloatArray, rest_at_half: FloatArray) -> tuple[FloatArray, int]:
    """Part of a rest that shorter steps make larger, and its power of 1/h; 0: there is none."""
    nothing = 0.0 * rest
    if not float(np.linalg.norm(rest_at_half)) > _GROWN * float(np.linalg.norm(rest)) > 0.0:
        return nothing, 0
    parts = {power: rest_at_half / 2**power for power in _POWERS}
    power = max(parts, key=lambda power: _share(rest, parts[power], 0.0))
    return (parts[power], power) if _share(rest, parts[power], 0.0) > 0 else (nothing, 0)


def _share(deviation: FloatArray, part: FloatArray, noise: float) -> float:
    """Share of a deviation that a part of it and noise of this size explain together."""
    left = float(np.linalg.norm(deviation - part)) ** 2 - noise**2
    return 1.0 - math.sqrt(max(0.0, left)) / float(np.linalg.norm(deviation))
