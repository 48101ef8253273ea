"""Energies of a machine: of its projectile, of its start, and how much of that there is to be had."""

from __future__ import annotations

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.machines.trebuchet import PROJECTILE
from ...models.mechanism import Mechanism
from ...reference.equations import Equations

_STARTS = 8  # of the search for the lowest position: a linkage has few
_SEED = 1


def thrown_mass(mechanism: Mechanism) -> float:
    """Of the projectile [kg]."""
    mass = mechanism.thrown_mass(next(marker for marker in mechanism.markers if marker.name == PROJECTILE))
    assert mass is not None, f"{mechanism.name} throws a known mass"
    return mass


def kinetic_energy(mechanism: Mechanism, speed: float) -> float:
    """Of the projectile [J], at a speed [m/s]."""
    return 0.5 * thrown_mass(mechanism) * speed**2


def potential_energy(mechanism: Mechanism) -> float:
    """At the start [J]."""
    return float(Kinematics(mechanism).potential_energy(np.array(mechanism.start)))


def available_energy(mechanism: Mechanism) -> float:
    """Potential energy at the start less the least there is, over all positions that the joints allow [J].

    What could be had if nothing but the projectile moved in the end, and every other mass lay as low as it can.
    """
    equations = Equations(mechanism)
    start = np.array(mechanism.start)
    top = potential_energy(mechanism)

    def energy(q: FloatArray) -> float:
        return float(equations.kinematics.potential_energy(q)) / abs(top or 1.0)

    def slope(q: FloatArray) -> FloatArray:
        return -equations.gravity_forces(q) / abs(top or 1.0)

    loops = NonlinearConstraint(equations.loop_residual, 0.0, 0.0, jac=lambda q: equations.constraint_jacobian(q, ()))
    constraints = [loops] if equations.n_loops else []
    random = np.random.default_rng(_SEED)
    starts = [start, *(start + random.uniform(-np.pi, np.pi, (_STARTS, len(start))))]
    found = [
        minimize(energy, q, jac=slope, method="SLSQP", constraints=constraints, options={"ftol": 1e-15}) for q in starts
    ]
    lowest = min(float(each.fun) for each in found if _closes(equations, each.x))
    return top - lowest * abs(top or 1.0)


def _closes(equations: Equations, q: FloatArray) -> bool:
    return bool(np.abs(equations.loop_residual(q)).max(initial=0.0) < 1e-8)
