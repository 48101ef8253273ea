"""Lanes of a batch that come near a singular position, in which their constraints lose rank (:mod:`..singular`).

The singular values of the constraints' Jacobian are taken at both ends of each step. They change no
faster than the Jacobian does; where they may have been small in between, the step's Taylor
polynomials are sampled.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import BoolArray, FloatArray
from ..dependence import scales_of
from .compiled import jacobian_function
from .machine import Structure

_NEAR = (
    0.15  # singular value below which a lane is near; below that the other integrators try a window
)
_POSITIONS = 32  # random ones, for the largest arms
_SAMPLES = np.linspace(0.0, 1.0, 17)  # of a step


class RankGuard:
    """Of the constraints of loops and of active stops.

    Args:
        structure: with loops.
        parameters: of all machines, switches of the stops among them, shape (n_parameters, n).
        q: coordinates at the start, shape (n_q, n).
    """

    def __init__(self, structure: Structure, parameters: FloatArray, q: FloatArray) -> None:
        self._structure, self._function = structure, jacobian_function(structure)
        random, arms = np.random.default_rng(1), np.zeros(())
        for _ in range(_POSITIONS):
            beside = q + random.uniform(-np.pi, np.pi, (len(q), 1))
            arms = np.maximum(arms, np.abs(self._jacobian(beside, parameters)))
        scales = scales_of(np.sum(arms**2, axis=-2), arms)
        self._scales = scales.rows[..., None] * scales.columns[..., None, :]
        self._slopes = np.linalg.norm(self._scales * arms, axis=-2)
        everyone = np.arange(q.shape[1])
        self.near_at_start: BoolArray = ~(self._least(q[:, None], parameters, everyone)[0] > _NEAR)
        """Whether each machine starts there, shape (n,)."""

    def after_step(self, integrator: Any, machines: Any) -> BoolArray:
        """Whether each lane came near a singular position, shape (lanes,).

        Args:
            integrator: with the Taylor coefficients of its last step.
            machines: index of each lane's machine, shape (lanes,).
        """
        q, parameters = self._positions(integrator), integrator.pars
        variation = np.sum(
            np.abs(np.diff(q, axis=1)).sum(axis=1) * self._slopes[machines].T, axis=0
        )
        at_ends = self._least(q[:, [0, -1]], parameters, machines).sum(axis=0)
        near = ~(0.5 * (at_ends - variation) > _NEAR)
        if np.any(near):
            sampled = self._least(q[:, :, near], parameters[:, near], machines[near])
            near[near] = ~(sampled.min(axis=0) > _NEAR)
        return near

    def _positions(self, integrator: Any) -> FloatArray:
        """Samples of the last step, shape (n_q, samples, lanes)."""
        coefficients = integrator.tc[: self._structure.n_q]
        degrees = np.arange(coefficients.shape[1])
        terms = coefficients * integrator.last_h ** degrees[:, None]
        return np.einsum("ikl,sk->isl", terms, _SAMPLES[:, None] ** degrees)

    def _jacobian(self, q: FloatArray, parameters: FloatArray) -> FloatArray:
        """Shape (n, n_constraints, n_q); zero where the coordinates are not finite."""
        parameters = np.ascontiguousarray(parameters[: self._function.nparams])
        values = self._function(np.ascontiguousarray(q), pars=parameters)
        values = values if np.all(np.isfinite(values)) else np.nan_to_num(values)
        return values.T.reshape(q.shape[1], -1, self._structure.n_q)

    def _least(self, q: FloatArray, parameters: FloatArray, machines: Any) -> FloatArray:
        """Least singular value of the active constraints, without units, at q (n_q, samples, n): (samples, n)."""
        jacobian = self._jacobian(q.reshape(len(q), -1), np.tile(parameters, q.shape[1]))
        stops = parameters[self._structure.active].T > 0
        active = np.concatenate(
            [np.ones((len(stops), self._structure.n_loops), dtype=bool), stops], axis=1
        )
        scaled = jacobian.reshape(*q.shape[1:], *jacobian.shape[1:]) * (
            self._scales[machines] * active[..., None]
        )
        values, rank = np.linalg.svd(scaled, compute_uv=False), active.sum(axis=1)
        least = values[..., np.arange(len(rank)), np.minimum(rank, values.shape[-1]) - 1]
        return np.where(rank > values.shape[-1], 0.0, least)
