"""The share of a deviation that a suspect explains, its size being fitted by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray


@dataclass(frozen=True)
class Match:
    """A suspect's signature fitted to a deviation."""

    factor: float
    """Of the signature."""
    explained: float
    """1 - |deviation - factor signature| / |deviation|; negative where the suspect makes it worse."""


def match(deviation: FloatArray, signature: FloatArray, fixed: bool = False) -> Match:
    """Fit a signature to a deviation, both flat vectors in units of their size.

    Args:
        deviation, signature: of one shape.
        fixed: the signature counts as it is, its factor is 1.
    """
    size, length = float(np.linalg.norm(deviation)), float(signature @ signature)
    if size == 0.0 or length == 0.0 or not np.isfinite(length):
        return Match(0.0, 0.0)
    factor = 1.0 if fixed else float(signature @ deviation) / length
    left = float(np.linalg.norm(deviation - factor * signature))
    return Match(factor, 1.0 - left / size)
