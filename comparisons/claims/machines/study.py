"""Every machine the paper names, at its masses and arm: how much of the available energy the projectile gets."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from ....models.arrays import FloatArray
from ....models.mechanism import Mechanism
from ....models.registry import model, models
from ....models.trajectory import Trajectory
from ....models.trebuchet import PROJECTILE
from ....reference.certificate import reference_uncertainty
from ....reference.equations import Equations
from ....reference.release import Projectile
from ....reference.solution import Solution
from ...campaign import Comparison, compare
from ...results import Outcome, Run
from ..results import EngineValue
from ..sweep.engines import Allowed, speed_allowance
from .results import MachineEfficiency, Machines, SlingThrow
from .slings import SLINGS, Launched, fastest_sling

_STARTS = 8  # of the search for the lowest position: a linkage has few
_SEED = 1


def efficiencies(engines: Sequence[str] | None = None) -> Machines:
    """Throw every named machine by the reference and the engines' tuned presets.

    Args:
        engines: names; all if left out. One that is absent or fails becomes a note.
    """
    started = time.perf_counter()
    names = tuple(models())
    comparison = compare(names, engines=engines, presets=("tuned",))
    rows = tuple(_efficiency(name, comparison) for name in names)
    return Machines(machines=rows, slings=SLINGS, seconds=time.perf_counter() - started)


def _efficiency(name: str, comparison: Comparison) -> MachineEfficiency:
    mechanism, solution = model(name), comparison.solutions[name]
    launch = solution.launch
    assert launch is not None, f"{name} is a machine that launches"
    arm = float(solution.motion(np.array([launch.time])).q[0, 0])
    available, mass = available_energy(mechanism), _thrown(mechanism)
    built = Launched(launch.speed, launch.time, arm)
    best = fastest_sling(name)
    sling = next((body.centre[0] for body in mechanism.bodies if body.name == "sling"), None)
    runs = [run for run in comparison.results.runs if run.model == name and run.engine != "reference"]
    trajectories = {label: t for (machine, label), t in comparison.trajectories.items() if machine == name}
    return MachineEfficiency(
        name=name,
        text=models()[name],
        available_energy=available,
        total_energy=float(Equations(mechanism).kinematics.potential_energy(np.array(mechanism.start))),
        table_one=_throw(sling, built, mass, available),
        fastest_sling=None if best is None else _throw(best[0], best[2], mass, available_energy(best[1])),
        speed_uncertainty=reference_uncertainty(solution, launch.time).of("launch_speed"),
        engines=tuple(
            _by_engine(run, trajectories.get(run.label), _allowed(run, solution), mass, available) for run in runs
        ),
        distances=tuple(_distance(run) for run in runs),
    )


def _thrown(mechanism: Mechanism) -> float:
    mass = mechanism.thrown_mass(next(marker for marker in mechanism.markers if marker.name == PROJECTILE))
    assert mass is not None, f"{mechanism.name} throws a known mass"
    return mass


def _throw(sling: float | None, thrown: Launched, mass: float, available: float) -> SlingThrow:
    kinetic = 0.5 * mass * thrown.speed**2
    return SlingThrow(
        sling=sling,
        launch_time=thrown.time,
        speed=thrown.speed,
        kinetic_energy=kinetic,
        efficiency=kinetic / available,
        arm_angle=thrown.arm,
    )


def _allowed(run: Run, solution: Solution) -> float | None:
    """What the engine's bars leave of the launch speed [m/s]."""
    found = {(metric.name, metric.subject): metric.tolerance for metric in run.metrics}
    bars = Allowed(found.get(("position_max", PROJECTILE)), found.get(("launch_speed", None)))
    launch = solution.launch
    return None if launch is None else speed_allowance(bars, Projectile(solution), launch.time)


def _by_engine(
    run: Run, trajectory: Trajectory | None, allowed: float | None, mass: float, available: float
) -> EngineValue:
    launch = None if trajectory is None else trajectory.launch()
    if launch is None:
        return EngineValue(engine=run.engine, value=None, note=run.message or "its projectile is not launched")
    tolerance = None if allowed is None else mass * launch.speed * allowed / available
    return EngineValue(engine=run.engine, value=0.5 * mass * launch.speed**2 / available, tolerance=tolerance)


def _distance(run: Run) -> EngineValue:
    if run.outcome not in (Outcome.OK, Outcome.BROKEN):
        return EngineValue(engine=run.engine, value=None, note=run.message)
    found = [metric for metric in run.metrics if metric.name == "position_max" and metric.value is not None]
    bar = next((metric.tolerance for metric in found if metric.subject == PROJECTILE), None)
    return EngineValue(engine=run.engine, value=max(abs(metric.value or 0.0) for metric in found), tolerance=bar)


def available_energy(mechanism: Mechanism) -> float:
    """Potential energy at the start less the least there is, over all positions that the joints allow [J].

    What could be had if nothing but the projectile moved in the end, and every other mass lay as low as it can.
    """
    equations = Equations(mechanism)
    start = np.array(mechanism.start)
    top = float(equations.kinematics.potential_energy(start))

    def energy(q: FloatArray) -> float:
        return float(equations.kinematics.potential_energy(q)) / abs(top or 1.0)

    def slope(q: FloatArray) -> FloatArray:
        return -equations.gravity_forces(q) / abs(top or 1.0)

    loops = NonlinearConstraint(equations.loop_gaps, 0.0, 0.0, jac=lambda q: equations.constraint_jacobian(q, ()))
    constraints = [loops] if equations.n_loops else []
    random = np.random.default_rng(_SEED)
    starts = [start, *(start + random.uniform(-np.pi, np.pi, (_STARTS, len(start))))]
    found = [
        minimize(energy, q, jac=slope, method="SLSQP", constraints=constraints, options={"ftol": 1e-15}) for q in starts
    ]
    lowest = min(float(each.fun) for each in found if _closes(equations, each.x))
    return top - lowest * abs(top or 1.0)


def _closes(equations: Equations, q: FloatArray) -> bool:
    return bool(np.abs(equations.loop_gaps(q)).max(initial=0.0) < 1e-8)
