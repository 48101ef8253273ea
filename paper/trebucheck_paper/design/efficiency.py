"""Efficiency of every machine that the paper names: as given, with its fastest sling, at its best.

The paper cites machines without their lengths. What it says of them can only be compared with all
such machines within stated bounds, at the paper's masses and length of arm. Where a machine has the
paper's third constraint, a stop that would act before the launch counts as no throw.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy.optimize import NonlinearConstraint, minimize
from trebucheck.api.engines import ASSISTED
from trebucheck.api.mechanics import (
    ARM_STOP,
    PROJECTILE,
    EngineNotInstalledError,
    Equations,
    FloatArray,
    Kinematics,
    Mechanism,
    Projectile,
    Real,
    Solution,
    Spec,
    Trajectory,
    model,
    models,
    parameters_type,
    reference_uncertainty,
    solve_to_launch,
)
from trebucheck.api.studies import Comparison, Outcome, Run, compare

from ..evidence.claims import EngineValue
from ..evidence.engine_runs import Allowed, speed_allowance

SLINGS = (2.0, 14.0)
"""Lengths looked at [m]: up to the paper's whole arm."""
BOUNDS: dict[str, tuple[float, float]] = {"l1": (7.0, 13.0), "r": SLINGS, "theta0": (1.7, 2.6)}
"""Bounds of l1 and r [m], and of theta0 of an arm that begins backward [rad]: 30 to 82 deg down."""
_STARTS = 8  # of the search for the lowest position: a linkage has few
_SEED = 1
_LENGTHS, _REFINED_LENGTHS = 25, 7  # lengths at first, and in each closer look
# Each a third as wide as the one before: 0.5 m become 6 mm, where the speed is flat to 1e-6.
_LENGTH_REFINEMENTS = 4
_SLING_DURATION = 4.0  # [s] in which machines of this size launch
# Points of the coarse grid, with spacings of 1 m, 1.5 m and 13 deg.
_GRID = {"l1": 7, "r": 9, "theta0": 5}
# Finer grids, one point to each side of the best: spacings become 4 cm, 6 cm and 0.5 deg.
_REFINEMENTS = 3
_BESIDE, _CLOSER = 1, 3.0
_DURATION = 5.0  # [s] in which machines of this size launch
_BACKWARD = 1.0  # [rad] a start beyond this is one of an arm that begins backward


class SlingThrow(Spec):
    """One machine's throw at 45 degrees, by the reference."""

    sling: Real | None = Field(description="length [m]; None: it has no sling")
    launch_time: Real = Field(description="[s]")
    speed: Real = Field(description="of the projectile [m/s]")
    kinetic_energy: Real = Field(description="of the projectile [J]")
    efficiency: Real = Field(description="kinetic energy over the energy available with that sling")
    arm_angle: Real = Field(
        description="of the arm at the launch [rad]; 3 pi / 2 points straight up"
    )


class WidestThrow(SlingThrow):
    """The throw of the most efficient machine of a kind within the bounds."""

    l1: Real = Field(description="arm on the sling's side [m]; l1 + l2 as given")
    theta0: Real = Field(description="start angle of the arm [rad]")


class MachineEfficiency(Spec):
    """One machine with the paper's masses and arm, with the paper's sling and with its fastest."""

    name: str
    text: str
    available_energy: Real = Field(
        description="from the start down to its lowest position of all [J]"
    )
    total_energy: Real = Field(
        description="the paper's E: of the start, zero at the fulcrum's height [J]"
    )
    table_one: SlingThrow
    fastest_sling: SlingThrow | None = Field(
        description="with the sling that throws fastest; None: no sling"
    )
    most_efficient: WidestThrow | None = Field(
        default=None,
        description="of all within the bounds; None: not looked for, since that needs heyoka",
    )
    speed_uncertainty: Real | None = Field(description="of the speed with the paper's sling [m/s]")
    engines: tuple[EngineValue, ...] = Field(
        default=(), description="efficiency with the paper's sling"
    )
    distances: tuple[EngineValue, ...] = Field(
        default=(),
        description="largest distance of any marker from ours up to the launch [m], each with its "
        "tolerance",
    )


class Machines(Spec):
    """Rows in the registry's order."""

    machines: tuple[MachineEfficiency, ...]
    slings: tuple[Real, Real] = Field(description="sling lengths looked at, from and to [m]")
    bounds: dict[str, tuple[Real, Real]] = Field(
        description="of l1 [m], r [m] and, where the arm begins backward, theta0 [rad], for the "
        "most efficient"
    )
    seconds: Real = Field(description="wall time [s]")

    def named(self, name: str) -> MachineEfficiency:
        """The machine of that name."""
        return next(machine for machine in self.machines if machine.name == name)


def thrown_mass(mechanism: Mechanism) -> float:
    """Mass of the projectile [kg]."""
    mass = mechanism.thrown_mass(
        next(marker for marker in mechanism.markers if marker.name == PROJECTILE)
    )
    assert mass is not None, f"{mechanism.name} throws a known mass"
    return mass


def kinetic_energy(mechanism: Mechanism, speed: float) -> float:
    """Kinetic energy of the projectile [J], at a speed [m/s]."""
    return 0.5 * thrown_mass(mechanism) * speed**2


def potential_energy(mechanism: Mechanism) -> float:
    """Value at the start [J]."""
    return float(Kinematics(mechanism).potential_energy(np.array(mechanism.start)))


def available_energy(mechanism: Mechanism) -> float:
    """Potential energy at the start less its minimum over all positions that the joints allow [J].

    An upper bound of the projectile's kinetic energy: nothing else moves in the end, and the
    potential energy is least.
    """
    equations = Equations(mechanism)
    start = np.array(mechanism.start)
    top = potential_energy(mechanism)

    def energy(q: FloatArray) -> float:
        return float(equations.kinematics.potential_energy(q)) / abs(top or 1.0)

    def slope(q: FloatArray) -> FloatArray:
        return -equations.gravity_forces(q) / abs(top or 1.0)

    loops = NonlinearConstraint(
        equations.loop_residual, 0.0, 0.0, jac=lambda q: equations.constraint_jacobian(q, ())
    )
    constraints = [loops] if equations.n_loops else []
    random = np.random.default_rng(_SEED)
    starts = [start, *(start + random.uniform(-np.pi, np.pi, (_STARTS, len(start))))]
    minima = [
        minimize(
            energy, q, jac=slope, method="SLSQP", constraints=constraints, options={"ftol": 1e-15}
        )
        for q in starts
    ]
    lowest = min(float(each.fun) for each in minima if _closes(equations, each.x))
    return top - lowest * abs(top or 1.0)


def _closes(equations: Equations, q: FloatArray) -> bool:
    return bool(np.abs(equations.loop_residual(q)).max(initial=0.0) < 1e-8)


@dataclass(frozen=True)
class Launched:
    """Result of a throw at 45 degrees; speed 0 without a launch, or past the arm's stop."""

    speed: float
    """[m/s]"""
    time: float
    """[s]"""
    arm: float
    """[rad]"""


_NONE = Launched(0.0, math.nan, math.nan)


def fastest_sling(name: str) -> tuple[float, Mechanism, Launched] | None:
    """Length [m], machine and throw of a named machine's fastest sling; None: none launches."""
    if "r" not in parameters_type(name).model_fields:
        return None
    lengths = np.linspace(*SLINGS, _LENGTHS)
    fastest = _fastest_of(name, lengths)
    for _ in range(_LENGTH_REFINEMENTS):
        step, middle = lengths[1] - lengths[0], fastest[0]
        lengths = np.linspace(
            max(SLINGS[0], middle - step), min(SLINGS[1], middle + step), _REFINED_LENGTHS
        )
        fastest = max(fastest, _fastest_of(name, lengths), key=lambda each: each[2].speed)
    return fastest if fastest[2].speed > 0 else None


def _fastest_of(name: str, lengths: FloatArray) -> tuple[float, Mechanism, Launched]:
    machines = [model(name, parameters_type(name)(r=float(r))) for r in lengths]
    throws = zip(lengths.tolist(), machines, launches(machines, _SLING_DURATION), strict=True)
    return max(throws, key=lambda each: each[2].speed)


def launches(
    machines: Sequence[Mechanism], duration: float, alone: bool = True
) -> Iterable[Launched]:
    """Throws of machines of one kind at 45 degrees.

    Args:
        machines: alike but for their numbers.
        duration: end of the search for the launch [s]; where machines are solved alone, at all
        times.
        alone: whether each may be solved for itself, a tenth of a second each, where heyoka is not
            installed.

    Raises:
        EngineNotInstalledError: heyoka is not installed, and they may not be solved alone.
    """
    from trebucheck.api.mechanics import launch_batch

    try:
        batch = launch_batch(machines, duration=duration)
    except EngineNotInstalledError:
        if not alone:
            raise
        return [_launch(machine) for machine in machines]
    rows = zip(machines, batch.launched, batch.speed, batch.time, batch.q, strict=True)
    found = [
        _checked(machine, q, float(v), float(t)) if ok else _NONE for machine, ok, v, t, q in rows
    ]
    return [_launch(machines[i]) if i in batch.failures else throw for i, throw in enumerate(found)]


def _launch(machine: Mechanism) -> Launched:
    solution = solve_to_launch(machine)
    if solution.launch is None:
        return _NONE
    q = solution.motion(np.array([solution.launch.time])).q[0]
    return _checked(machine, q, solution.launch.speed, solution.launch.time)


def _checked(machine: Mechanism, q: FloatArray, speed: float, time: float) -> Launched:
    has_stop = any(stop.name == ARM_STOP for stop in machine.stops)
    if has_stop and float(Kinematics(machine).gap(ARM_STOP, q)) <= 0:
        return _NONE
    return Launched(speed, time, float(q[0]))


@dataclass(frozen=True)
class Widest:
    """The most efficient machine that was found."""

    chosen: dict[str, float]
    """Chosen values by the names of :data:`BOUNDS`."""
    mechanism: Mechanism
    thrown: Launched
    efficiency: float


def most_efficient(name: str) -> Widest | None:
    """Most efficient of all named machines within the bounds; None without launch or integrator."""
    grid = {key: np.linspace(*BOUNDS[key], _GRID[key]) for key in _free(name)}
    spacing = {key: float(values[1] - values[0]) for key, values in grid.items()}
    lowest: dict[float, float] = {}
    try:
        best = _best(name, grid, lowest)
        for _ in range(_REFINEMENTS):
            if best is None:
                return None
            spacing = {key: step / _CLOSER for key, step in spacing.items()}
            closer = _best(
                name,
                {key: _around(key, best.chosen[key], step) for key, step in spacing.items()},
                lowest,
            )
            best = max((best, closer or best), key=lambda each: each.efficiency)
    except EngineNotInstalledError:
        return None
    return best


def _free(name: str) -> list[str]:
    """Free parameters; the start only of machines whose arm begins backward (not in the paper)."""
    fields = parameters_type(name).model_fields
    start = fields["theta0"].default
    return [key for key in BOUNDS if key in fields and (key != "theta0" or start > _BACKWARD)]


def _around(key: str, middle: float, step: float) -> FloatArray:
    values = middle + step * np.arange(-_BESIDE, _BESIDE + 1, dtype=np.float64)
    return np.unique(np.clip(values, *BOUNDS[key]))


def _best(name: str, grid: dict[str, FloatArray], lowest: dict[float, float]) -> Widest | None:
    points = [
        dict(zip(grid, values, strict=True))
        for values in itertools.product(*(g.tolist() for g in grid.values()))
    ]
    machines = [_machine(name, point) for point in points]
    throws = launches(machines, _DURATION, alone=False)
    rated = list(_rated(points, machines, throws, lowest))
    return max(rated, key=lambda each: each.efficiency, default=None)


def _machine(name: str, point: dict[str, float]) -> Mechanism:
    """Value at the given machine's length of arm."""
    kind = parameters_type(name)
    beam = kind.model_fields["l1"].default + kind.model_fields["l2"].default
    return model(name, kind(**point, l2=beam - point["l1"]))


def _rated(
    points: Sequence[dict[str, float]],
    machines: Sequence[Mechanism],
    throws: Iterable[Launched],
    lowest: dict[float, float],
) -> Iterable[Widest]:
    """Efficiencies of those that launch.

    The lowest position of all does not depend on the start, and a sling hangs straight down in it:
    one search serves all machines of one l1, and `lowest` keeps its result.
    """
    for point, machine, thrown in zip(points, machines, throws, strict=True):
        if not thrown.speed > 0:
            continue
        top, hanging = (
            potential_energy(machine),
            thrown_mass(machine) * machine.gravity * point.get("r", 0.0),
        )
        l1 = point["l1"]
        if l1 not in lowest:
            lowest[l1] = top - available_energy(machine) + hanging
        available = top - (lowest[l1] - hanging)
        yield Widest(point, machine, thrown, kinetic_energy(machine, thrown.speed) / available)


def efficiencies(engines: Sequence[str] | None = None) -> Machines:
    """Throw every named machine by the reference and the engines' assisted presets.

    Args:
        engines: names; all if left out, none if empty. One that is absent or fails becomes a note.
    """
    started = time.perf_counter()
    names = tuple(models())
    named = engines if engines is None else tuple(engines) or ("reference",)
    comparison = compare(names, engines=named, presets=(ASSISTED,), diagnose=False)
    rows = tuple(_efficiency(name, comparison) for name in names)
    return Machines(
        machines=rows, slings=SLINGS, bounds=BOUNDS, seconds=time.perf_counter() - started
    )


def _efficiency(name: str, comparison: Comparison) -> MachineEfficiency:
    mechanism, solution = model(name), comparison.solutions[name]
    launch = solution.launch
    assert launch is not None, f"{name} is a machine that launches"
    arm = float(solution.motion(np.array([launch.time])).q[0, 0])
    available = available_energy(mechanism)
    built = Launched(launch.speed, launch.time, arm)
    best = fastest_sling(name)
    sling = next((body.centre[0] for body in mechanism.bodies if body.name == "sling"), None)
    runs = [
        run for run in comparison.results.runs if run.model == name and run.engine != "reference"
    ]
    trajectories = {
        label: t for (machine, label), t in comparison.trajectories.items() if machine == name
    }
    return MachineEfficiency(
        name=name,
        text=models()[name],
        available_energy=available,
        total_energy=potential_energy(mechanism),
        table_one=_throw(mechanism, available, sling, built),
        fastest_sling=None
        if best is None
        else _throw(best[1], available_energy(best[1]), best[0], best[2]),
        most_efficient=_widest(name),
        speed_uncertainty=reference_uncertainty(solution, launch.time).of("launch_speed"),
        engines=tuple(
            _by_engine(
                run, trajectories.get(run.label), _allowed(run, solution), mechanism, available
            )
            for run in runs
        ),
        distances=tuple(_distance(run) for run in runs),
    )


def _throw(
    mechanism: Mechanism, available: float, sling: float | None, thrown: Launched
) -> SlingThrow:
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
    """Tolerance of the launch speed [m/s] that follows from the engine's tolerances."""
    tolerance_of = {(metric.name, metric.subject): metric.tolerance for metric in run.metrics}
    tolerances = Allowed(
        tolerance_of.get(("position_max", PROJECTILE)), tolerance_of.get(("launch_speed", None))
    )
    launch = solution.launch
    return (
        None if launch is None else speed_allowance(tolerances, Projectile(solution), launch.time)
    )


def _by_engine(
    run: Run,
    trajectory: Trajectory | None,
    allowed: float | None,
    mechanism: Mechanism,
    available: float,
) -> EngineValue:
    launch = None if trajectory is None else trajectory.launch()
    if launch is None:
        return EngineValue(
            engine=run.engine, value=None, note=run.message or "its projectile is not launched"
        )
    tolerance = (
        None if allowed is None else thrown_mass(mechanism) * launch.speed * allowed / available
    )
    return EngineValue(
        engine=run.engine,
        value=kinetic_energy(mechanism, launch.speed) / available,
        tolerance=tolerance,
    )


def _distance(run: Run) -> EngineValue:
    if run.outcome not in (Outcome.AGREES, Outcome.DISAGREES):
        return EngineValue(engine=run.engine, value=None, note=run.message)
    errors = [
        metric
        for metric in run.metrics
        if metric.name == "position_max" and metric.value is not None
    ]
    tolerance = next((metric.tolerance for metric in errors if metric.subject == PROJECTILE), None)
    return EngineValue(
        engine=run.engine,
        value=max(abs(metric.value or 0.0) for metric in errors),
        tolerance=tolerance,
    )
