"""Energies of a machine, and the machines that throw best: with the fastest sling, and the most efficient ones.

The paper cites machines without their lengths. What it says of them can only be compared with all such machines within
stated bounds, at the paper's masses and length of arm. Where a machine has the paper's third constraint, a stop that
would act before the launch counts as no throw.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError
from ...models.kinematics import Kinematics
from ...models.machines.registry import model, parameters_type
from ...models.machines.trebuchet import ARM_STOP, PROJECTILE
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ...reference.solver import solve_to_launch

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


SLINGS = (2.0, 14.0)
"""Lengths looked at [m]: up to the paper's whole arm."""

_LENGTHS, _REFINED_LENGTHS = 25, 7  # lengths at first, and in each closer look
_LENGTH_REFINEMENTS = 4  # each a third as wide as the one before: 0.5 m become 6 mm, where the speed is flat to 1e-6
_SLING_DURATION = 4.0  # [s] in which machines of this size launch


@dataclass(frozen=True)
class Launched:
    """What a throw at 45 degrees comes to; speed 0 where there is none, or the arm had passed its stop."""

    speed: float
    """[m/s]"""
    time: float
    """[s]"""
    arm: float
    """[rad]"""


_NONE = Launched(0.0, math.nan, math.nan)


def fastest_sling(name: str) -> tuple[float, Mechanism, Launched] | None:
    """Length [m], machine and throw of a named machine with its fastest sling; None: no sling, or none launches."""
    if "r" not in parameters_type(name).model_fields:
        return None
    lengths = np.linspace(*SLINGS, _LENGTHS)
    found = _looked_at(name, lengths)
    for _ in range(_LENGTH_REFINEMENTS):
        step, middle = lengths[1] - lengths[0], found[0]
        lengths = np.linspace(max(SLINGS[0], middle - step), min(SLINGS[1], middle + step), _REFINED_LENGTHS)
        found = max(found, _looked_at(name, lengths), key=lambda each: each[2].speed)
    return found if found[2].speed > 0 else None


def _looked_at(name: str, lengths: FloatArray) -> tuple[float, Mechanism, Launched]:
    machines = [model(name, parameters_type(name)(r=float(r))) for r in lengths]
    throws = zip(lengths.tolist(), machines, launches(machines, _SLING_DURATION), strict=True)
    return max(throws, key=lambda each: each[2].speed)


def launches(machines: Sequence[Mechanism], duration: float, alone: bool = True) -> Iterable[Launched]:
    """Throws of machines of one kind at 45 degrees.

    Args:
        machines: alike but for their numbers.
        duration: the launch is looked for up to here [s]; where machines are solved alone, at all times.
        alone: whether each may be solved for itself, a tenth of a second each, where heyoka is not installed.

    Raises:
        EngineNotInstalledError: heyoka is not installed, and they may not be solved alone.
    """
    from ...reference.taylor.batch import launch_batch  # a second to import

    try:
        batch = launch_batch(machines, duration=duration)
    except EngineNotInstalledError:
        if not alone:
            raise
        return [_launch(machine) for machine in machines]
    rows = zip(machines, batch.launched, batch.speed, batch.time, batch.q, strict=True)
    return [_checked(machine, q, float(v), float(t)) if ok else _NONE for machine, ok, v, t, q in rows]


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


BOUNDS: dict[str, tuple[float, float]] = {"l1": (7.0, 13.0), "r": SLINGS, "theta0": (1.7, 2.6)}
"""Arm on the sling's side [m], sling [m], start of an arm that begins backward [rad]: 30 to 82 deg below level."""

_GRID = {"l1": 7, "r": 9, "theta0": 5}  # places at first: a metre, 1.5 m and 13 deg apart
_REFINEMENTS = 3  # closer ones, a place to each side of the best: spacings become 4 cm, 6 cm and 0.5 deg
_BESIDE, _CLOSER = 1, 3.0
_DURATION = 5.0  # [s] in which machines of this size launch
_BACKWARD = 1.0  # [rad] a start beyond this is one of an arm that begins backward


@dataclass(frozen=True)
class Widest:
    """The most efficient machine that was found."""

    chosen: dict[str, float]
    """By the names of :data:`BOUNDS`."""
    mechanism: Mechanism
    thrown: Launched
    efficiency: float


def most_efficient(name: str) -> Widest | None:
    """Of all named machines within the bounds; None where none launches, or there is no integrator for so many."""
    grid = {key: np.linspace(*BOUNDS[key], _GRID[key]) for key in _free(name)}
    spacing = {key: float(values[1] - values[0]) for key, values in grid.items()}
    lowest: dict[float, float] = {}
    try:
        best = _best(name, grid, lowest)
        for _ in range(_REFINEMENTS):
            if best is None:
                return None
            spacing = {key: step / _CLOSER for key, step in spacing.items()}
            closer = _best(name, {key: _around(key, best.chosen[key], step) for key, step in spacing.items()}, lowest)
            best = max((best, closer or best), key=lambda each: each.efficiency)
    except EngineNotInstalledError:
        return None
    return best


def _free(name: str) -> list[str]:
    """What may be chosen: the start only of machines whose arm begins backward, which the paper does not describe."""
    fields = parameters_type(name).model_fields
    start = fields["theta0"].default
    return [key for key in BOUNDS if key in fields and (key != "theta0" or start > _BACKWARD)]


def _around(key: str, middle: float, step: float) -> FloatArray:
    places = middle + step * np.arange(-_BESIDE, _BESIDE + 1, dtype=np.float64)
    return np.unique(np.clip(places, *BOUNDS[key]))


def _best(name: str, grid: dict[str, FloatArray], lowest: dict[float, float]) -> Widest | None:
    places = [
        dict(zip(grid, values, strict=True)) for values in itertools.product(*(g.tolist() for g in grid.values()))
    ]
    machines = [_machine(name, place) for place in places]
    throws = launches(machines, _DURATION, alone=False)
    found = list(_rated(places, machines, throws, lowest))
    return max(found, key=lambda each: each.efficiency, default=None)


def _machine(name: str, place: dict[str, float]) -> Mechanism:
    """At the given machine's length of arm."""
    kind = parameters_type(name)
    beam = kind.model_fields["l1"].default + kind.model_fields["l2"].default
    return model(name, kind(**place, l2=beam - place["l1"]))


def _rated(
    places: Sequence[dict[str, float]],
    machines: Sequence[Mechanism],
    throws: Iterable[Launched],
    lowest: dict[float, float],
) -> Iterable[Widest]:
    """Efficiencies of those that launch.

    The lowest position of all does not depend on the start, and a sling hangs straight down in it: one search serves
    all machines of one l1, and `lowest` keeps what it found.
    """
    for place, machine, thrown in zip(places, machines, throws, strict=True):
        if not thrown.speed > 0:
            continue
        top, hanging = potential_energy(machine), thrown_mass(machine) * machine.gravity * place.get("r", 0.0)
        l1 = place["l1"]
        if l1 not in lowest:
            lowest[l1] = top - available_energy(machine) + hanging
        available = top - (lowest[l1] - hanging)
        yield Widest(place, machine, thrown, kinetic_energy(machine, thrown.speed) / available)
