"""Every machine the paper names, at its masses and arm: how much of the available energy the projectile gets."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from ...comparisons.compare.study import Comparison, compare
from ...comparisons.runs.results import Outcome, Run
from ...models.machines.registry import model, models
from ...models.machines.trebuchet import PROJECTILE
from ...models.mechanism import Mechanism
from ...models.spec import Real, Spec
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import reference_uncertainty
from ...reference.solution import Solution
from ...reference.throw.release import Projectile
from ..evidence.engine_runs import Allowed, speed_allowance
from ..evidence.results import EngineValue
from .search import (
    BOUNDS,
    SLINGS,
    Launched,
    available_energy,
    fastest_sling,
    kinetic_energy,
    most_efficient,
    potential_energy,
    thrown_mass,
)


class SlingThrow(Spec):
    """One machine's throw at 45 degrees, by the reference."""

    sling: Real | None = Field(description="length [m]; None: it has no sling")
    launch_time: Real = Field(description="[s]")
    speed: Real = Field(description="of the projectile [m/s]")
    kinetic_energy: Real = Field(description="of the projectile [J]")
    efficiency: Real = Field(description="kinetic energy over the energy available with that sling")
    arm_angle: Real = Field(description="of the arm at the launch [rad]; 3 pi / 2 points straight up")


class WidestThrow(SlingThrow):
    """The throw of the most efficient machine of a kind within the bounds."""

    l1: Real = Field(description="arm on the sling's side [m]; l1 + l2 as given")
    theta0: Real = Field(description="start angle of the arm [rad]")


class MachineEfficiency(Spec):
    """One machine at the paper's masses and arm, with the paper's sling and with its fastest one."""

    name: str
    text: str
    available_energy: Real = Field(description="from the start down to its lowest position of all [J]")
    total_energy: Real = Field(description="the paper's E: of the start, zero at the fulcrum's height [J]")
    table_one: SlingThrow
    fastest_sling: SlingThrow | None = Field(description="with the sling that throws fastest; None: no sling")
    most_efficient: WidestThrow | None = Field(
        default=None, description="of all within the bounds; None: not looked for, since that needs heyoka"
    )
    speed_uncertainty: Real | None = Field(description="of the speed with the paper's sling [m/s]")
    engines: tuple[EngineValue, ...] = Field(default=(), description="efficiency with the paper's sling")
    distances: tuple[EngineValue, ...] = Field(
        default=(), description="largest distance of any marker from ours up to the launch [m], each with its tolerance"
    )


class Machines(Spec):
    """All of them, in the registry's order."""

    machines: tuple[MachineEfficiency, ...]
    slings: tuple[Real, Real] = Field(description="sling lengths looked at, from and to [m]")
    bounds: dict[str, tuple[Real, Real]] = Field(
        description="of l1 [m], r [m] and, where the arm begins backward, theta0 [rad], for the most efficient"
    )
    seconds: Real = Field(description="wall time [s]")

    def named(self, name: str) -> MachineEfficiency:
        """The machine of that name."""
        return next(machine for machine in self.machines if machine.name == name)


def efficiencies(engines: Sequence[str] | None = None) -> Machines:
    """Throw every named machine by the reference and the engines' tuned presets.

    Args:
        engines: names; all if left out, none if empty. One that is absent or fails becomes a note.
    """
    started = time.perf_counter()
    names = tuple(models())
    named = engines if engines is None else tuple(engines) or ("reference",)
    comparison = compare(names, engines=named, presets=("tuned",))
    rows = tuple(_efficiency(name, comparison) for name in names)
    return Machines(machines=rows, slings=SLINGS, bounds=BOUNDS, seconds=time.perf_counter() - started)


def _efficiency(name: str, comparison: Comparison) -> MachineEfficiency:
    mechanism, solution = model(name), comparison.solutions[name]
    launch = solution.launch
    assert launch is not None, f"{name} is a machine that launches"
    arm = float(solution.motion(np.array([launch.time])).q[0, 0])
    available = available_energy(mechanism)
    built = Launched(launch.speed, launch.time, arm)
    best = fastest_sling(name)
    sling = next((body.centre[0] for body in mechanism.bodies if body.name == "sling"), None)
    runs = [run for run in comparison.results.runs if run.model == name and run.engine != "reference"]
    trajectories = {label: t for (machine, label), t in comparison.trajectories.items() if machine == name}
    return MachineEfficiency(
        name=name,
        text=models()[name],
        available_energy=available,
        total_energy=potential_energy(mechanism),
        table_one=_throw(mechanism, available, sling, built),
        fastest_sling=None if best is None else _throw(best[1], available_energy(best[1]), best[0], best[2]),
        most_efficient=_widest(name),
        speed_uncertainty=reference_uncertainty(solution, launch.time).of("launch_speed"),
        engines=tuple(
            _by_engine(run, trajectories.get(run.label), _allowed(run, solution), mechanism, available) for run in runs
        ),
        distances=tuple(_distance(run) for run in runs),
    )


def _throw(mechanism: Mechanism, available: float, sling: float | None, thrown: Launched) -> SlingThrow:
    kinetic = kinetic_energy(mechanism, thrown.speed)
    return SlingThrow(
        sling=sling,
        launch_time=thrown.time,
        speed=thrown.speed,
        kinetic_energy=kinetic,
        efficiency=kinetic / available,
        arm_angle=thrown.arm,
    )


def _widest(name: str) -> WidestThrow | None:
    best = most_efficient(name)
    if best is None:
        return None
    machine = best.mechanism
    throw = _throw(machine, available_energy(machine), best.chosen.get("r"), best.thrown)
    return WidestThrow(**dict(throw), l1=best.chosen["l1"], theta0=machine.start[0])


def _allowed(run: Run, solution: Solution) -> float | None:
    """What the engine's tolerances leave of the launch speed [m/s]."""
    found = {(metric.name, metric.subject): metric.tolerance for metric in run.metrics}
    tolerances = Allowed(found.get(("position_max", PROJECTILE)), found.get(("launch_speed", None)))
    launch = solution.launch
    return None if launch is None else speed_allowance(tolerances, Projectile(solution), launch.time)


def _by_engine(
    run: Run, trajectory: Trajectory | None, allowed: float | None, mechanism: Mechanism, available: float
) -> EngineValue:
    launch = None if trajectory is None else trajectory.launch()
    if launch is None:
        return EngineValue(engine=run.engine, value=None, note=run.message or "its projectile is not launched")
    tolerance = None if allowed is None else thrown_mass(mechanism) * launch.speed * allowed / available
    return EngineValue(
        engine=run.engine, value=kinetic_energy(mechanism, launch.speed) / available, tolerance=tolerance
    )


def _distance(run: Run) -> EngineValue:
    if run.outcome not in (Outcome.OK, Outcome.BROKEN):
        return EngineValue(engine=run.engine, value=None, note=run.message)
    found = [metric for metric in run.metrics if metric.name == "position_max" and metric.value is not None]
    tolerance = next((metric.tolerance for metric in found if metric.subject == PROJECTILE), None)
    return EngineValue(engine=run.engine, value=max(abs(metric.value or 0.0) for metric in found), tolerance=tolerance)
