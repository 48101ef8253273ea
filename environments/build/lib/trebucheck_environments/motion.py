"""Reference motion of a machine at the times of an episode's actions, and its releases there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from trebucheck.api.mechanics import (
    Flight,
    FloatArray,
    InputError,
    Mechanism,
    Projectile,
    characteristic_time,
    fly,
)

from .best_throw import BestThrow

Observation = NDArray[np.float32]

BOUND = 100.0
"""Bound of observed speeds and slides, which are scaled; most are of order one to thirty."""
_BLOCK = 256  # times that are read from the solution at once


@dataclass(frozen=True)
class State:
    """State of the machine with its projectile, at one time."""

    q: FloatArray
    u: FloatArray
    velocity: FloatArray
    """Velocity of the projectile [m/s], shape (2,)."""


@dataclass(frozen=True)
class _Block:
    """States at several times, one a row."""

    q: FloatArray
    u: FloatArray
    velocity: FloatArray
    observed: Observation


class Motion:
    """The first sweep of one machine, in control steps; the last one may be shorter.

    Stops close again, as MuJoCo's do, and without rebound. The release changes nothing that came
    before it, so there is no need to step: states are read from the reference's continuous
    solution.
    """

    def __init__(self, best: BestThrow, control_step: float) -> None:
        self._best, self._control_step = best, control_step
        self._scales = _scales(self.projectile.mechanism)
        self._block, self._read = 0, self._block_at(self._times(0))

    @property
    def projectile(self) -> Projectile:
        """Body that is thrown."""
        return self._best.projectile

    @property
    def steps(self) -> int:
        """Control steps until the sweep is over."""
        return math.ceil(self._best.sweep_end / self._control_step)

    def time(self, step: int) -> float:
        """After so many control steps [s]."""
        return min(step * self._control_step, self._best.sweep_end)

    def state(self, step: int) -> State:
        """After so many control steps; at an impact, after it."""
        block, row = self._at(step)
        return State(block.q[row], block.u[row], block.velocity[row])

    def observation(self, step: int) -> Observation:
        """After so many control steps, without units."""
        block, row = self._at(step)
        return block.observed[row].copy()

    def _at(self, step: int) -> tuple[_Block, int]:
        """Values of the solution around a step, and the row in them."""
        block, row = divmod(step, _BLOCK)
        if block != self._block:
            self._block, self._read = block, self._block_at(self._times(block))
        return self._read, row

    def _times(self, block: int) -> FloatArray:
        steps = range(block * _BLOCK, min((block + 1) * _BLOCK, self.steps + 1))
        return np.array([self.time(step) for step in steps])

    def _block_at(self, times: FloatArray) -> _Block:
        motion = self.projectile.solution.motion(times)
        kinematics = self.projectile.solution.equations.kinematics
        _, velocity, _ = kinematics.point_motion(
            self.projectile.marker, motion.q, motion.u, motion.a
        )
        angles, slides = np.split(motion.q, [len(self.projectile.mechanism.angles)], axis=1)
        plain = np.concatenate([np.cos(angles), np.sin(angles), slides, motion.u, velocity], axis=1)
        observed = np.clip(plain / self._scales, -BOUND, BOUND).astype(np.float32)
        return _Block(motion.q, motion.u, velocity, observed)

    def thrown(self, step: int) -> Flight | None:
        """The flight of a release then; None if it never comes up to the landing's height."""
        try:
            return fly(self.projectile.release_at(self.time(step)), self._best.surroundings)
        except InputError:
            return None


def _scales(mechanism: Mechanism) -> FloatArray:
    """Units of the observation's components."""
    time = characteristic_time(mechanism)
    length, turning = mechanism.gravity * time**2, len(mechanism.angles)
    sliding = len(mechanism.coordinates) - turning
    own = [1.0] * 2 * turning + [length] * sliding
    return np.array([*own, *[1 / time] * turning, *[length / time] * (sliding + 2)])
