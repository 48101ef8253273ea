"""How far an engine's quantity may lie from ours: its tolerances, carried over to quantities that have none.

Tolerances are stated for release times, torques, the energy and the projectile's position. What an error of the
position means for another quantity is estimated on the machine itself: each parameter is changed a little, and the
largest ratio of the quantity's change to the largest displacement of the projectile up to the launch is taken. An error
of the position is then allowed to do to the quantity what a slightly different machine with that error would.
"""

from __future__ import annotations

import math

import numpy as np

from ..comparisons.runs.tolerances import AppliedTolerance, is_table_one, tolerance_for
from ..engines.protocol import Engine
from ..models.arrays import FloatArray
from ..models.machines.parameters import TrebuchetParameters
from ..models.machines.registry import model
from ..models.machines.trebuchet import PROJECTILE
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..reference.solver import solve
from .quantities import BEND, LAUNCH_TIME, TOTAL_ENERGY, Readings, ThrowQuantity, read
from .sampled import SampledMotion

_CHANGE = 1e-6  # of a parameter's scale: far above the solver's rounding, far below what bends a response
_TOLERANCE = 1e-12  # of the solver for these: a change of 1e-6 is then known to one part in a million
_TICK = 1e-3  # [s] between samples of the changed machines' motions

Amplification = dict[ThrowQuantity, float]
"""Largest change of a quantity per metre of the projectile's displacement."""


def amplification(mechanism: Mechanism, parameters: TrebuchetParameters, until: float) -> Amplification:
    """How strongly the quantities of a named machine change with its projectile's position.

    Args:
        mechanism: the named machine of the parameters.
        parameters: those it was built from.
        until: end of the motions [s], past all that is read.
    """
    base, path = _moved(mechanism, until)
    found: Amplification = {}
    for name, value in parameters:
        changed = parameters.model_dump() | {name: value + _CHANGE * (abs(value) or 1.0)}
        values, other = _moved(model(mechanism.name, TrebuchetParameters(**changed)), until)
        ticks = int(base[LAUNCH_TIME] / _TICK)
        displaced = float(np.linalg.norm(other[:ticks] - path[:ticks], axis=1).max())
        for quantity in base.keys() & values.keys():
            ratio = abs(values[quantity] - base[quantity]) / displaced
            if math.isfinite(ratio):
                found[quantity] = max(found.get(quantity, 0.0), ratio)
    return found


def _moved(mechanism: Mechanism, until: float) -> tuple[Readings, FloatArray]:
    """Quantities and the projectile's path, sampled."""
    solution = solve(Problem(mechanism, duration=until), _TOLERANCE, _TOLERANCE)
    trajectory = solution.trajectory(np.arange(0.0, until, _TICK))
    return read(SampledMotion(trajectory), trajectory), trajectory.marker(PROJECTILE).position


def allowances(engine: Engine, mechanism: Mechanism, ours: Readings, amplified: Amplification) -> Readings:
    """The tolerance of each quantity of an engine's tuned preset; those without one behind them are left out."""
    position = _applied(engine, "position_max", mechanism, PROJECTILE)
    found: Readings = {}
    if position is not None:
        found = {quantity: position.value * ratio for quantity, ratio in amplified.items() if quantity.follows_position}
        found[BEND] = position.value / _shortest(mechanism)
    for quantity in ours:
        direct = _direct(engine, mechanism, quantity, ours)
        if direct is not None:
            found[quantity] = direct
    return found


def _shortest(mechanism: Mechanism) -> float:
    """Shortest lever [m] on which a body's angle moves its centre."""
    levers = [math.dist(j.child_point, mechanism.body(j.child).centre) for j in mechanism.tree_joints]
    return min(lever for lever in levers if lever > 0)


def _direct(engine: Engine, mechanism: Mechanism, quantity: ThrowQuantity, ours: Readings) -> float | None:
    """From a tolerance of just this quantity."""
    found = None if quantity.metric is None else _applied(engine, quantity.metric, mechanism)
    if found is None:
        return None
    if quantity.metric == "energy_drift":
        return found.value if quantity.unit != "J" else found.value * abs(ours.get(TOTAL_ENERGY, math.nan))
    # 'per peak' is met at the start here: a closed stop's torque is largest there, or larger later.
    return found.value * (abs(ours[quantity]) if found.stated.per else 1.0)


def _applied(engine: Engine, metric: str, mechanism: Mechanism, subject: str | None = None) -> AppliedTolerance | None:
    """The tolerance of the tuned preset at the engine's own step."""
    table_one = is_table_one(mechanism)
    return tolerance_for(engine.name, "tuned", metric, subject, mechanism, engine.timestep, table_one=table_one)
