"""How far an engine's figure may lie from ours: its agreement bars, carried over to figures that have none.

Bars are stated for release times, torques, the energy and the projectile's position. What a position off by a bar
means for another figure is asked of the machine itself: each parameter is changed a little, and the largest ratio of
the figure's change to the largest displacement of the projectile up to the launch is taken. An error of the position
is then allowed to do to the figure what a slightly different machine with that error would.
"""

from __future__ import annotations

import math

import numpy as np

from ...comparisons.runs.tolerances import Bar, bar_for
from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...models.machines.trebuchet import PROJECTILE
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...reference.solver import solve
from .headline import Figures, read
from .multipliers import SHAPES
from .sampled import SampledMotion

_CHANGE = 1e-6  # of a parameter's scale: far above the solver's rounding, far below what bends a response
_TOLERANCE = 1e-12  # of the solver for these: a change of 1e-6 is then known to one part in a million
_TICK = 1e-3  # [s] between samples of the changed machines' motions
_BEND = "bend before the first release"

Amplification = dict[str, float]
"""Largest change of a figure per metre of the projectile's displacement, by the figure's name."""


def amplification(mechanism: Mechanism, parameters: TrebuchetParameters, until: float) -> Amplification:
    """How strongly the figures of a named machine move with its projectile's position.

    Args:
        mechanism: the named machine of the parameters.
        parameters: those it was built from.
        until: end of the motions [s], past all that is read.
    """
    base, path = _moved(mechanism, until)
    found: Amplification = {}
    for name, value in parameters:
        changed = parameters.model_dump() | {name: value + _CHANGE * (abs(value) or 1.0)}
        figures, other = _moved(model(mechanism.name, TrebuchetParameters(**changed)), until)
        ticks = int(base["launch_time"] / _TICK)
        displaced = float(np.linalg.norm(other[:ticks] - path[:ticks], axis=1).max())
        for figure in base.keys() & figures.keys():
            ratio = abs(figures[figure] - base[figure]) / displaced
            if math.isfinite(ratio):
                found[figure] = max(found.get(figure, 0.0), ratio)
    return found


def _moved(mechanism: Mechanism, until: float) -> tuple[Figures, FloatArray]:
    """Figures and the projectile's path, sampled."""
    solution = solve(Problem(mechanism, duration=until), _TOLERANCE, _TOLERANCE)
    trajectory = solution.trajectory(np.arange(0.0, until, _TICK))
    return read(SampledMotion(trajectory), trajectory), trajectory.marker(PROJECTILE).position


def allowances(engine: Engine, mechanism: Mechanism, ours: Figures, amplified: Amplification) -> Figures:
    """The tolerance of each figure of an engine's tuned preset; those without a bar behind them are left out."""
    position = _bar(engine, "position_max", mechanism, PROJECTILE)
    found: Figures = {}
    if position is not None:
        found = {name: position[1] * ratio for name, ratio in amplified.items() if not name.startswith(SHAPES)}
        found[_BEND] = position[1] / _shortest(mechanism)
    for name in ours:
        direct = _direct(engine, mechanism, name, ours)
        if direct is not None:
            found[name] = direct
        elif name.startswith(("energy drift", "stop_torque")):
            found.pop(name, None)  # a position says nothing of them
    return found


def _shortest(mechanism: Mechanism) -> float:
    """Shortest lever [m] on which a body's angle moves its centre."""
    levers = [math.dist(j.child_point, mechanism.body(j.child).centre) for j in mechanism.tree_joints]
    return min(lever for lever in levers if lever > 0)


def _direct(engine: Engine, mechanism: Mechanism, name: str, ours: Figures) -> float | None:
    """From a bar for just this figure."""
    energy = abs(ours.get("total_energy, start", math.nan))
    if name.startswith("energy drift"):
        found = _bar(engine, "energy_drift", mechanism)
        return None if found is None else found[1] * (1.0 if name.endswith("share") else energy)
    for start, metric in (("release_time", "release_time"), ("stop_torque", "stop_torque_max"), ("launch_speed",) * 2):
        if name.startswith(start) and (found := _bar(engine, metric, mechanism)):
            # 'per peak' is met at the start here: a closed rest's torque is largest there, or larger later.
            return found[1] * (abs(ours[name]) if found[0].per else 1.0)
    return None


def _bar(engine: Engine, metric: str, mechanism: Mechanism, subject: str | None = None) -> tuple[Bar, float] | None:
    """The bar of the tuned preset stated for the longest step not above the engine's own, and its value there."""
    step = engine.timestep
    best = None if step is None else bar_for(engine.name, "tuned", metric, subject, mechanism, step)
    if best is None or step is None:
        return None
    return best, best.value * max(1.0, step / best.timestep) ** best.order
