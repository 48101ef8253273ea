"""Stops as springs: what they carry at the start, and how they are damped."""

from __future__ import annotations

import math

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.mechanism import Stop
from .build import Spring
from .matrices import Closed, Matrices, matrices, solve_constrained
from .solver import Solver, State

_ROUNDING = 1e-15  # [rad] of the difference of two angles of some radians; [m per m] of a point's place
_DIGITS = 1e-4  # of the largest torque, that are to stand above the rounding


def springs(solver: Solver, state: State, closed: Closed, stiffness: float, damping_ratio: float) -> dict[str, Spring]:
    """A spring for each stop that pushes at a state, in balance there.

    Without the preload a spring would first have to be pressed: the machine would start with a fall onto it, and the
    torque with an oscillation from zero to twice what it should be.

    Args:
        solver: of the same mechanism with its stops as constraints.
        state: the start.
        closed: stops that push there.
        stiffness: of each spring [N m/rad, or N/m on a point].
        damping_ratio: of each spring, with the inertia that the stop holds at the start; 1 is critical.

    Raises:
        InputError: so stiff a spring would turn the rounding of angles or places into forces that matter.
    """
    row = solver.balance(state, closed).row
    torques = {name: solver.torque(row, name) for name in closed}
    of_angles = [name for name in closed if isinstance(solver.system.mechanism.stop(name), Stop)]
    _refuse_noise_of_angles(stiffness, max((torques[name] for name in of_angles), default=0.0))
    for name in closed:
        if name not in of_angles:
            _refuse_noise_of_place(stiffness, torques[name], row[solver.columns["stop", name, "Position"]])
    with matrices(solver.system) as here:
        here.set(state.coordinates, state.rates)
        inertias = {name: _inertia(here, name) for name in closed}
    return {
        name: Spring(stiffness, 2 * damping_ratio * math.sqrt(stiffness * inertias[name]), torques[name])
        for name in closed
    }


def _refuse_noise_of_angles(stiffness: float, torque: float) -> None:
    most = _DIGITS * torque / _ROUNDING
    if 0 < most < stiffness:
        raise InputError(
            f"stop_stiffness = {stiffness:g} N m/rad would turn the rounding of angles into a torque of "
            f"{stiffness * _ROUNDING:.2g} N m, of {torque:.3g} N m in the stops; at most {most:.2g} is resolved."
        )


def _refuse_noise_of_place(stiffness: float, force: float, place: FloatArray) -> None:
    rounding = _ROUNDING * max(1.0, float(np.abs(place).max()))
    most = _DIGITS * force / rounding
    if 0 < most < stiffness:
        raise InputError(
            f"stop_stiffness = {stiffness:g} N/m would turn the rounding of a point's place into a force of "
            f"{stiffness * rounding:.2g} N, of {force:.3g} N in its stop; at most {most:.2g} is resolved."
        )


def _inertia(here: Matrices, stop: str) -> float:
    """Torque (or force) on a stop's gap that opens it at 1 rad/s^2 (or 1 m/s^2), the others open [kg m^2, kg]."""
    joints, row = here.jacobian(()), here.stop_row(stop)
    opened, _ = solve_constrained(here.mass(), joints, row, np.zeros(len(joints)))
    return 1.0 / float(row @ opened)
