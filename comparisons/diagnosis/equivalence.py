"""The model-equivalence check: is the built model the mechanism, before any motion?

The built model is inspected in random states under every set of the stops that are closed at the
start, and compared with the reference's equations. What an engine exposes must agree to `EXACT`. A
run whose check fails is not compared: the motion of another mechanism says nothing about the
engine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain, combinations

import numpy as np

from ...engines.inspection import Dynamics, Inspectable, Inspection, State
from ...engines.protocol import Engine
from ...engines.registry import refuse_unbuildable
from ...engines.units import units_of
from ...models.arrays import FloatArray
from ...models.elements import RecordedEffort, refuse_unknown
from ...models.errors import EngineNotInstalledError, SimulationError, UnsupportedProblemError
from ...models.kinematics import immovable_stops, without_stops
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ...reference.contact import active_contacts
from ...reference.equations import Equations, consistent_coordinates, consistent_speeds
from ...reference.reactions import undetermined_forces
from ..runs.results import Check, Equality
from ..runs.scales import size

# In the units that engines build a mechanism in:
_SPREAD = 0.5  # [rad or m] of the coordinates about the start
SPEED = 1.0  # [rad/s or m/s]
_ROUNDING = 1e-12  # [rad/s or m/s], or of the terms whose sum is a gap speed
_OPEN = 0.02  # [rad] least gap of an open stop: beyond the margin at which engines make a contact
_DRAWS = 60  # for one set of stops; if they are never all active, those that are are taken

EXACT = 1e-10
"""Relative tolerance: four digits above rounding, six below the smallest seeded fault."""
ROUNDING = 1e-14
"""Relative error of sums and solutions of well conditioned equations."""
DOUBLE = 2.0**-53
_ROUNDINGS = 1000
"""Roundings of an engine's numbers that a check allows, each in units of its roundoff.

Ten bodies with ten operations each, and a digit that absolute angles lose, being differences of
joint angles. In single precision that is 6e-5, below the smallest seeded fault of 1e-4.
"""
_LEAST = 1e-3  # of the inertial forces: where less acts, as without gravity, there is only rounding


# --------------------------------------------------------------------------------------- states


def random_states(mechanism: Mechanism, n: int = 24, seed: int = 20) -> tuple[State, ...]:
    """States over all sets of stops that are closed at the start, the same ones each time.

    The first one is the start itself, with the stops that are active there; if its speeds move the
    gap of a closed stop, with the nearest ones that do not. Fewer than n come back only where a
    machine allows no state with its other stops open near the start.

    Args:
        mechanism: whose states they are.
        n: how many.
        seed: of the random numbers.
    """
    # An engine that changes the arrays of a state must not change those of the next engine.
    states = _drawn_states(mechanism, n, seed)  # pyright: ignore[reportArgumentType]
    return tuple(replace(state, q=state.q.copy(), u=state.u.copy()) for state in states)


@lru_cache(maxsize=4)
def _drawn_states(mechanism: Mechanism, n: int, seed: int) -> tuple[State, ...]:
    # A state far off a small machine is none that an engine has to get right.
    units = units_of(mechanism)
    equations = Equations(units.mechanism(mechanism))
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    sizes = range(len(closed), -1, -1)
    sets = [*chain.from_iterable(combinations(closed, size) for size in sizes)]
    random = np.random.default_rng(seed)
    states = [_start(equations)]
    for k in range(n - 1):
        state = _state(equations, sets[k % len(sets)], random)
        if state is not None:
            states.append(state)
    return tuple(units.inverse.states(mechanism, states))


def _start(equations: Equations) -> State:
    mechanism = equations.mechanism
    q = np.array(mechanism.start)
    u = np.array(mechanism.start_speeds or [0.0] * len(q))
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    for stop in touching:
        # A start may drive into a closed stop, or off it.
        terms = equations.kinematics.gap_jacobian(stop, q) * u
        if not abs(float(terms.sum())) <= _ROUNDING * max(1.0, float(np.abs(terms).sum())):
            u = consistent_speeds(equations, q, u, touching)
            break
    return State(q, u, active_contacts(equations, q, u, touching))


def _state(
    equations: Equations, touching: tuple[str, ...], random: np.random.Generator
) -> State | None:
    """A state in which exactly these stops are active, else one with fewer; None if none."""
    fallback: State | None = None
    start = np.array(equations.mechanism.start)
    others = [stop.name for stop in equations.mechanism.stops if stop.name not in touching]
    for _ in range(_DRAWS):
        near = start + random.uniform(-_SPREAD, _SPREAD, len(start))
        q = consistent_coordinates(equations, near, touching)
        if q is None or any(float(equations.kinematics.gap(name, q)) < _OPEN for name in others):
            continue
        speeds = random.uniform(-SPEED, SPEED, len(start))
        u = consistent_speeds(equations, q, speeds, touching)
        if active_contacts(equations, q, u, touching) == touching:
            return State(q, u, touching)
        if fallback is None and touching:
            fallback = _state(equations, touching[:-1], random)
    return fallback


# ---------------------------------------------------------------------------- expected quantities


@dataclass(frozen=True)
class Expected:
    """Quantities of the reference's equations in the states; arrays of shape (n_states, ...)."""

    mass: FloatArray
    forces: FloatArray
    accelerations: FloatArray
    torques: tuple[dict[str, float], ...]
    gaps: tuple[dict[str, float], ...]
    """Gaps of all stops, by state [rad or m]."""
    bodies: tuple[str, ...]
    centres: FloatArray
    """Shape (n_states, n_bodies, 2) [m]."""
    inertial: FloatArray
    """Inertia times the largest speed, or 1 in its units, squared; by coordinate, (n_q,)."""
    inertial_torques: dict[str, float]
    """The same by stop, of the lightest coordinate that it acts on."""
    weights: FloatArray | None = None
    """Bounds of gravity's forces, shape (n_q,); given where forces are sums of rounded terms."""

    @cached_property
    def force_scale(self) -> FloatArray:
        """Size of the forces, by coordinate."""
        scale = _scale_of(self.forces, self.inertial)
        return scale if self.weights is None else np.maximum(scale, self.weights)

    @cached_property
    def acceleration_scale(self) -> FloatArray:
        """Size of the accelerations, by coordinate."""
        inertia = self.mass.max(axis=0).diagonal()
        # Of a coordinate that constraints hold still: what the forces that they balance would do.
        balanced = np.abs(self.forces).max(axis=0) if self.weights is None else self.force_scale
        return np.maximum(
            _scale_of(self.accelerations, self.inertial / inertia), balanced / inertia
        )

    @cached_property
    def torque_scales(self) -> dict[str, float]:
        """Size of each stop's torques; of one that carries nothing, from inertial forces."""
        sizes = {name: _LEAST * inertial for name, inertial in self.inertial_torques.items()}
        for torques in self.torques:
            sizes |= {name: max(sizes[name], abs(torque)) for name, torque in torques.items()}
        return sizes

    def as_dynamics(self, like: Sequence[Dynamics]) -> tuple[Dynamics, ...]:
        """The same quantities as another engine exposes, and the gaps of all stops."""
        every: list[Dynamics] = []
        for k, exposed in enumerate(like):
            centres = dict(zip(self.bodies, self.centres[k], strict=True))
            dynamics = Dynamics(
                accelerations=self.accelerations[k],
                stop_torques={n: self.torques[k].get(n, 0.0) for n in exposed.stop_torques},
                mass_matrix=None if exposed.mass_matrix is None else self.mass[k],
                forces=None if exposed.forces is None else self.forces[k],
                centres={n: c for n, c in centres.items() if n in exposed.centres},
                stop_gaps=self.gaps[k],
            )
            every.append(dynamics)
        return tuple(every)


def _scale_of(values: FloatArray, inertial: FloatArray) -> FloatArray:
    """Size of each component over all states; the others' where hardly anything acts on it.

    Args:
        values: shape (n_states, n_components).
        inertial: what the speeds of the states make of each component; the scale where hardly
            anything acts at all.
    """
    scale = np.abs(values).max(axis=0)
    return np.maximum(np.maximum(scale, 1e-3 * scale.max()), _LEAST * inertial)


def expected(
    mechanism: Mechanism, states: Sequence[State], equations: Equations | None = None
) -> Expected:
    """The reference's quantities in the states, or those of other equations."""
    equations = equations or Equations(mechanism)
    q, u = np.array([state.q for state in states]), np.array([state.u for state in states])
    kinematics, units = equations.kinematics, units_of(mechanism)
    # Torques of the closed stops that are unique; states of the same stops are solved at once.
    accelerations, torques = np.empty_like(q), [dict[str, float]() for _ in states]
    for closed in dict.fromkeys(tuple(state.closed) for state in states):
        rows = [k for k, state in enumerate(states) if tuple(state.closed) == closed]
        accelerations[rows], multipliers = equations.solve(q[rows], u[rows], closed)
        _, undetermined = undetermined_forces(equations, q[rows[0]], closed)
        for k, efforts in zip(rows, multipliers[:, equations.n_loops :].tolist(), strict=True):
            every = zip(closed, efforts, strict=True)
            torques[k] = {name: effort for name, effort in every if name not in undetermined}
    gaps = {stop.name: kinematics.gap(stop.name, q).tolist() for stop in mechanism.stops}
    points = [kinematics.point(body.name, body.centre) for body in mechanism.bodies]
    mass = equations.mass_matrix(q)
    least = (SPEED * units.coordinates(mechanism) / units.time) ** 2
    inertial = mass.max(axis=0).diagonal() * np.maximum(np.square(u).max(axis=0), least)
    inertial_torques: dict[str, float] = {}
    for stop in mechanism.stops:
        row = kinematics.gap_jacobian(stop.name, q[0])
        acts = row != 0
        torque = inertial[acts] / np.abs(row[acts]) if acts.any() else inertial
        inertial_torques[stop.name] = float(torque.min() if acts.any() else torque.max())
    return Expected(
        mass=mass,
        forces=equations.forces(q, u),
        accelerations=accelerations,
        torques=tuple(torques),
        gaps=tuple({name: values[k] for name, values in gaps.items()} for k in range(len(states))),
        bodies=tuple(body.name for body in mechanism.bodies),
        centres=np.stack([kinematics.position(point, q) for point in points], axis=1),
        inertial=inertial,
        inertial_torques=inertial_torques,
    )


def scaled_differences(reference: Expected, dynamics: Sequence[Dynamics]) -> FloatArray:
    """Exposed differences, flat, in units of their sizes: M, f, a, torques, centres."""
    parts: list[FloatArray] = []

    def add(
        exposed: Mapping[int, FloatArray | None], right: FloatArray, sizes: FloatArray | float
    ) -> None:
        """Add what is exposed in some states, by their index; sizes are of all states."""
        shown = {k: values for k, values in exposed.items() if values is not None}
        if shown:
            every, rows = np.broadcast_to(sizes, right.shape), list(shown)
            difference = np.array(list(shown.values())) - right[rows]
            parts.append((difference / every[rows]).ravel())

    shown = dict(enumerate(dynamics))
    diagonals = np.sqrt(np.diagonal(reference.mass, axis1=1, axis2=2))
    sizes = diagonals[:, :, None] * diagonals[:, None, :]
    add({k: d.mass_matrix for k, d in shown.items()}, reference.mass, sizes)
    add({k: d.forces for k, d in shown.items()}, reference.forces, reference.force_scale)
    accelerations = {k: d.accelerations for k, d in shown.items()}
    add(accelerations, reference.accelerations, reference.acceleration_scale)
    torques: list[float] = []
    for d, right in zip(dynamics, reference.torques, strict=True):
        for name, torque in right.items():
            difference = d.stop_torques.get(name, math.nan) - torque
            torques.append(difference / reference.torque_scales[name])
    parts.append(np.array(torques))
    reach = float(np.abs(reference.centres).max()) or 1.0
    for i, name in enumerate(reference.bodies):
        add({k: d.centres.get(name) for k, d in shown.items()}, reference.centres[:, i], reach)
    return np.concatenate(parts)


def gap_errors(reference: Expected, dynamics: Sequence[Dynamics]) -> dict[str, float]:
    """Largest error of each stop's gap by the engine's own measure [rad or m]."""
    errors: dict[str, float] = {}
    for engine_values, reference_gaps in zip(dynamics, reference.gaps, strict=True):
        for name, gap in engine_values.stop_gaps.items():
            errors[name] = max(errors.get(name, 0.0), gap - reference_gaps[name], key=_magnitude)
    return errors


def _magnitude(error: float) -> float:
    """The absolute value; infinite of what is not a number, so that it is the largest."""
    return abs(error) if math.isfinite(error) else math.inf


# --------------------------------------------------------------------------------------- checks


def _with_largest_efforts(mechanism: Mechanism) -> Mechanism:
    """The mechanism with those values of its records that act together and are largest."""

    def size(stage: Mechanism) -> float:
        records = (e for e in stage.force_elements if isinstance(e, RecordedEffort))
        return sum(abs(effort) for record in records for effort in record.efforts)

    return max(map(mechanism.at, (0.0, *mechanism.instants)), key=size)


def check_model(engine: Engine, mechanism: Mechanism) -> Equality:
    """Compare an engine's built model with the reference's equations.

    An engine that cannot be inspected passes with `exposed` false: then only its motion can tell.
    States in which its solver finds no accelerations are left out, but for the start. Of a record
    of efforts one value is held, of those that act together the largest; a run follows the others.

    Raises:
        UnsupportedProblemError: the check does not know a class of elements, or the engine cannot
            build the mechanism.
        TrebucheckError: the engine is not installed, or its solver finds no accelerations.
    """
    refuse_unknown("The model-equivalence check", mechanism.elements)
    if not isinstance(engine, Inspectable):
        return Equality(
            exposed=False,
            note=f"{engine.name} does not show its built model; only its motion can tell.",
        )
    # What it does not build is no difference; a rebound is the run's matter.
    refuse_unbuildable(engine, mechanism, StopLaw.RELEASE_ONCE)
    # A stop that nothing moves has no part in the motion, and no run sees it.
    mechanism = without_stops(_with_largest_efforts(mechanism), immovable_stops(mechanism))
    states = random_states(mechanism)
    try:
        asked, (states, inspection) = len(states), _inspected(engine, mechanism, states)
    except (EngineNotInstalledError, UnsupportedProblemError, SimulationError):
        raise  # the run reports it
    except Exception as error:
        note = f"{engine.name} could not be looked into: {type(error).__name__}: {error}"
        return Equality(exposed=True, note=note, checks=(_check("inspection", None, None),))
    checks = tuple(_checks(mechanism, states, inspection))
    if inspection.roundoff > DOUBLE:
        # An engine whose numbers have fewer digits than double.
        allowed = _ROUNDINGS * inspection.roundoff
        reason = f"{_ROUNDINGS} roundings of the engine's numbers, {inspection.roundoff:.1e} each"
        rounded: list[Check] = []
        for check in checks:
            tolerance = max(check.tolerance, allowed * check.tolerance / EXACT)
            rounded.append(check.model_copy(update={"tolerance": tolerance, "reason": reason}))
        checks = tuple(rounded)
    equality = Equality(exposed=True, states=len(states), checks=checks)
    if len(states) == asked or not equality.holds:
        return equality
    note = (
        f"equivalent in {len(states)} of {asked} states; "
        f"in the others {engine.name} finds no accelerations"
    )
    return equality.model_copy(update={"note": note})


def _inspected(
    engine: Inspectable, mechanism: Mechanism, states: Sequence[State]
) -> tuple[Sequence[State], Inspection]:
    """The states in which the engine can be looked into, and what it says there.

    Raises:
        SimulationError: its solver does not find the accelerations at the start, or in most of the
            states.
    """
    try:
        return states, engine.inspect(mechanism, states)
    except SimulationError as error:
        # What a solver cannot do in some state that a motion may never meet says nothing against
        # the model.
        looked, failed = [(states[0], engine.inspect(mechanism, states[:1]))], error
    for state in states[1:]:
        with suppress(SimulationError):
            looked.append((state, engine.inspect(mechanism, [state])))
    if 2 * len(looked) < len(states):
        raise failed
    dynamics = tuple(inspection.dynamics[0] for _, inspection in looked)
    return [state for state, _ in looked], replace(looked[0][1], dynamics=dynamics)


def _checks(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[Check]:
    reference, dynamics = expected(mechanism, states), inspection.dynamics
    if inspection.roundoff > DOUBLE:
        # Bounds of gravity's generalized forces by Schwarz' inequality:
        # sum m g J <= g sqrt(sum m) sqrt(sum m J^2).
        total = sum(body.mass for body in mechanism.bodies)
        inertia = np.einsum("nii->ni", reference.mass).max(axis=0)
        reference = replace(reference, weights=mechanism.gravity * np.sqrt(total * inertia))
    yield from _of_parts(mechanism, reference, inspection)
    solved = _solution_tolerance(mechanism, states)
    accelerations = np.array([d.accelerations for d in dynamics])
    difference = np.abs(accelerations - reference.accelerations)
    check = _by_name(
        "acceleration", mechanism.coordinates, difference, reference.acceleration_scale
    )
    yield check.model_copy(update=solved)
    for name in dict.fromkeys(name for torques in reference.torques for name in torques):
        worst, missing = 0.0, False
        for shown, torques in zip(dynamics, reference.torques, strict=True):
            torque = shown.stop_torques.get(name)
            if name in torques and torque is not None:
                worst = max(abs(torque - torques[name]), worst)
                missing = missing or not math.isfinite(torque)
            elif name in torques:
                missing = True
        value = None if missing else worst / reference.torque_scales[name]
        yield _check("stop torque", name, value).model_copy(update=solved)
    errors = gap_errors(reference, dynamics)
    if errors:
        worst = max(errors, key=lambda name: _magnitude(errors[name]))
        error = abs(errors[worst]) if math.isfinite(errors[worst]) else None
        yield _check("stop position", worst, error, mechanism.stop(worst).gap_unit)


def _of_parts(mechanism: Mechanism, reference: Expected, inspection: Inspection) -> Iterator[Check]:
    """Mass and start; centres, mass matrix and forces, where the engine has them."""
    dynamics, units = inspection.dynamics, units_of(mechanism)
    if inspection.total_mass is not None:
        total = sum(body.mass for body in mechanism.bodies)
        yield _check("total mass", None, abs(inspection.total_mass - total) / total)
    names, lengths = mechanism.coordinates, units.coordinates(mechanism)
    speeds = np.array(mechanism.start_speeds or [0.0] * len(names))
    start = np.abs(inspection.start - np.array(mechanism.start))
    yield _by_name("start", names, start[None], np.maximum(lengths, np.abs(mechanism.start)))
    start = np.abs(inspection.start_speeds - speeds)
    scale = np.maximum(lengths / units.time, np.abs(speeds))
    yield _by_name("start speed", names, start[None], scale)
    bodies, reach = [body.name for body in mechanism.bodies], np.abs(reference.centres).max() or 1.0
    if all(set(bodies) <= set(d.centres) for d in dynamics):
        centres = np.array([[d.centres[name] for name in bodies] for d in dynamics])
        off = np.linalg.norm(centres - reference.centres, axis=2)
        yield _by_name("centre of mass", bodies, off, np.full(len(bodies), reach))
    shown = {name for d in dynamics for name in d.joint_gaps}
    loops = [joint.name for joint in mechanism.loop_joints if joint.name in shown]
    if loops:
        apart = np.array([[d.joint_gaps.get(name, math.nan) for name in loops] for d in dynamics])
        yield _by_name("joint position", loops, np.abs(apart), np.full(len(loops), reach))
    masses = [d.mass_matrix for d in dynamics if d.mass_matrix is not None]
    if len(masses) == len(dynamics):
        scales = np.sqrt(np.einsum("ni,nj->nij", *[np.einsum("nii->ni", reference.mass)] * 2))
        difference = np.abs(np.array(masses) - reference.mass) / scales
        pairs = [f"{a}, {b}" for a in names for b in names]
        rows = difference.reshape(len(masses), -1)
        yield _by_name("mass matrix", pairs, rows, np.ones(len(pairs)))
    forces = [d.forces for d in dynamics if d.forces is not None]
    if len(forces) == len(dynamics):
        difference = np.abs(np.array(forces) - reference.forces)
        yield _by_name("force", names, difference, reference.force_scale)


def _solution_tolerance(mechanism: Mechanism, states: Sequence[State]) -> dict[str, object]:
    """Tolerance and reason of what solves the equations of motion; none where it is `EXACT`.

    Accelerations and forces of constraints solve a least-squares problem with constraints (Gauss).
    Relative changes of its data of a size of rounding change the solution by their multiple with
    the condition number (Wedin, BIT 13 (1973) 217), here one over the least singular value of
    constraints with lengths in parts of the mechanism's size: a wall nearly parallel to the motion
    that it stops holds it with a force that is known to so many digits less.
    """
    equations, length = Equations(mechanism), size(mechanism) or units_of(mechanism).length
    every = [equations.independence(state.q, state.closed, length) for state in states]
    independence = min(map(float, every))
    tolerance = max(EXACT, ROUNDING / independence)
    if tolerance == EXACT:
        return {}
    reason = f"rounding, over the {independence:.2g} by which constraints are independent"
    return {"tolerance": tolerance, "reason": reason}


def _check(name: str, subject: str | None, value: float | None, unit: str = "1") -> Check:
    reason = "the engine's own quantities, to rounding"
    return Check(name=name, subject=subject, value=value, unit=unit, tolerance=EXACT, reason=reason)


def _by_name(
    name: str, subjects: Sequence[str], difference: FloatArray, scale: FloatArray
) -> Check:
    """The worst of all states and subjects, relative to `scale`, shape (n_subjects,).

    `difference` has shape (n_states, n_subjects).
    """
    relative = difference.max(axis=0) / np.where(scale > 0, scale, 1.0)
    worst = int(np.argmax(np.nan_to_num(relative, nan=np.inf)))
    value = float(relative[worst])
    return _check(name, subjects[worst], value if np.isfinite(value) else None)
