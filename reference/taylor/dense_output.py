"""The Taylor integrator's continuous output, read as SciPy's."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from .machine import RealType


class TaylorOutput:
    """heyoka's continuous output, called as SciPy's: times (n,) to states (2 n_q, n), doubles."""

    def __init__(self, start: float, output: Any, real: RealType) -> None:
        self._starts = [start]
        self._outputs = [output]
        self._real = real

    def add(self, start: float, output: Any) -> None:
        """Go on with another piece from `start` [s]."""
        self._starts.append(start)
        self._outputs.append(output)

    @property
    def ts(self) -> FloatArray:
        """Ends of the integrator's steps [s], as SciPy's solution has them."""
        return np.concatenate(
            [np.asarray(output.times, dtype=np.float64) for output in self._outputs]
        )

    def __call__(self, t: FloatArray) -> FloatArray:
        """States (2 n_q, n) at times [s], shape (n,); (2 n_q,) at one."""
        times = np.atleast_1d(np.asarray(t, dtype=self._real))
        of = np.searchsorted(self._starts[1:], times, side="right")
        pieces = [
            self._outputs[k](times[of == k])[:, :-1].T
            for k in range(len(self._outputs))
            if np.any(of == k)
        ]
        if len(pieces) == 1 and np.ndim(t) == 0:
            return np.array(pieces[0][:, 0], dtype=np.float64)
        states = np.empty((len(pieces[0]), len(times)))
        for k, piece in zip(np.unique(of), pieces, strict=True):
            states[:, of == k] = piece
        return states
