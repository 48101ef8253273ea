"""Stops as springs: their torques at the start and their damping."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ..contact_events import Contacts
from .constraints import Spring
from .matrices import Matrices, matrices, solve_constrained
from .solver import Solver, State

_DIGITS = 1e-4  # of the largest torque: the rounding error must be smaller


def springs(
    solver: Solver, state: State, active: Contacts, stiffness: float, damping_ratio: float
) -> dict[str, Spring]:
    """A spring for each stop that pushes at a state, in balance there.

    Without the preload a spring would carry no torque at the start, and the torque would then oscillate between zero
    and twice its value at rest.

    Args:
        solver: of the same mechanism with its stops as constraints.
        state: the start.
        active: stops that push there.
        stiffness: of each spring [N m/rad, or N/m on a point].
        damping_ratio: of each spring, with the inertia that the stop carries at the start; 1 is critical.

    Raises:
        InputError: so stiff a spring would turn the rounding of angles or positions into forces that matter.
    """
    row = solver.balance(state, active).row
    torques = {name: solver.torque(row, name) for name in active}
    for name in active:
        _refuse_noise(solver, row, stiffness, name, torques)
    with matrices(solver.system) as here:
        here.set(state.coordinates, state.rates)
        inertias = {name: _inertia(here, name) for name in active}
    return {
        name: Spring(stiffness, 2 * damping_ratio * math.sqrt(stiffness * inertias[name]), torques[name])
        for name in active
    }


def _refuse_noise(solver: Solver, row: FloatArray, stiffness: float, name: str, torques: Mapping[str, float]) -> None:
    """Refuse a stiffness that turns the rounding of angles or positions into a torque or force that matters."""
    mechanism, stop = solver.system.mechanism, solver.system.mechanism.stop(name)
    largest = max(t for other, t in torques.items() if mechanism.stop(other).force_unit == stop.force_unit)
    rounding = solver.system.constraints[name].rounding(solver.values(row))
    most = _DIGITS * largest / rounding
    if 0 < most < stiffness:
        unit, what = stop.force_unit, "angles" if stop.effort == "torque" else "a point's place"
        raise InputError(
            f"stop_stiffness = {stiffness:g} {unit}/{stop.gap_unit} would turn the rounding of {what} into a "
            f"{stop.effort} of {stiffness * rounding:.2g} {unit}, of {largest:.3g} {unit} in the stops; at most "
            f"{most:.2g} is resolved."
        )


def _inertia(here: Matrices, stop: str) -> float:
    """Torque (or force) on a stop's gap that opens it at 1 rad/s^2 (or 1 m/s^2), the others open [kg m^2, kg]."""
    joints, row = here.jacobian(()), here.stop_row(stop)
    opened, _ = solve_constrained(here.mass(), joints, row, np.zeros(len(joints)))
    return 1.0 / float(row @ opened)
