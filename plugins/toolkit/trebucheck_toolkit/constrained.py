r"""Constraint multipliers for engines with forward dynamics, and without stops and loops.

With the engine's accelerations a_0 under all applied forces, its mass matrix M and the rows G of
what is held (the gaps of the active contacts, the closures of the loops),

    a = a_0 + M^{-1} G^T f,    G a + dG/dt u = 0    so that    G M^{-1} G^T f = -(G a_0 + dG/dt u).

Of redundant rows f is the solution of the least norm, and a is unique all the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from trebucheck.engines.impact import Contacts, Inertia, inverse
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, PointStop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism

from .schemes import SCHEMES, State

_RANK = 1e-12  # of the largest singular value: redundant constraints have smaller ones


class ForwardDynamics(Protocol):
    """Dynamics of an engine, in the mechanism's coordinates."""

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Under gravity and generalized forces [N m, N], nothing held; all of shape (n_q,)."""
        ...

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Shape (n_q, n_q)."""
        ...


@dataclass(frozen=True)
class Solved:
    """Accelerations and forces in one state, some contacts held."""

    accelerations: FloatArray
    """Shape (n_q,)."""
    contacts: Mapping[str, float]
    """Force of each held contact [N m, N], positive where it pushes."""
    loops: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Force of each joint that closes a loop on its child, world frame [N], shape (2,)."""
    generalized: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Generalized forces of the force elements and of what is held, shape (n_q,) [N m, N]."""


class ConstrainedDynamics:
    """An engine's forward dynamics with contacts and loops held."""

    def __init__(self, mechanism: Mechanism, engine: ForwardDynamics) -> None:
        self.mechanism, self.engine = mechanism, engine
        self.kinematics = Kinematics(mechanism)
        self.applied = AppliedForces(self.kinematics)
        self._last: tuple[FloatArray, FloatArray, Contacts, Solved] | None = None

    def solve(self, q: FloatArray, u: FloatArray, held: Contacts) -> Solved:
        """Accelerations and forces in a state, with contacts held; the last ones are kept."""
        last = self._last
        if last is None or last[2] != held or not (_same(last[0], q) and _same(last[1], u)):
            last = self._last = (q, u, held, self._solved(q, u, held))
        return last[3]

    def _solved(self, q: FloatArray, u: FloatArray, held: Contacts) -> Solved:
        applied = self.applied.generalized(q, u)
        free = self.engine.accelerations(q, u, applied)
        rows, bias = self._rows(q, u, held)
        if not len(rows):
            return Solved(free, {}, generalized=applied)
        accelerations, forces = held_still(free, self.engine.mass_matrix(q), rows, bias)
        contacts = dict(zip(held, forces[: len(held)].tolist(), strict=True))
        loops = self._loop_forces(q, forces[len(held) :])
        return Solved(accelerations, contacts, loops, applied + rows.T @ forces)

    def projected(
        self, q: FloatArray, u: FloatArray, held: Contacts
    ) -> tuple[FloatArray, FloatArray]:
        """The state without drift from loops and held contacts, nearest in the mass metric."""
        rows, _ = self._rows(q, u, held)
        if not len(rows):
            return q, u
        response = inverse(self.engine.mass_matrix(q)) @ rows.T
        gaps = [float(self.kinematics.gap(name, q)) for name in held]
        drift = np.append(gaps, self.kinematics.loop_residual(q))
        q = q - response @ _least_norm(rows @ response, drift)
        return q, u - response @ _least_norm(rows @ response, rows @ u)

    def stepped(self, state: State, step: float, held: Contacts, scheme: str) -> State:
        """The state a step [s] later by one of :mod:`.schemes`, held without drift."""
        after = SCHEMES[scheme](lambda q, u: self.solve(q, u, held).accelerations, state, step)
        return self.projected(*after, held)

    def inertia(self, q: FloatArray) -> Inertia:
        """Response of the speeds to impulses."""
        return Inertia(self.engine.mass_matrix(q), self.kinematics.loop_jacobian(q))

    def forces_on_bodies(
        self, q: FloatArray, u: FloatArray, solved: Solved
    ) -> dict[str, FloatArray]:
        """Force on each body without gravity and the tree's joints, world frame [N], (2,)."""
        forces = self.applied.on_bodies(q, u)

        def add(body: str, force: FloatArray) -> None:
            if body != GROUND:
                forces[body] = forces.get(body, 0.0) + force

        for joint in self.mechanism.loop_joints:
            add(joint.child, solved.loops[joint.name])
            add(joint.parent, -solved.loops[joint.name])
        for stop in self.mechanism.point_stops:
            if stop.name in solved.contacts:
                force = self._force_of(stop, solved.contacts[stop.name], q)
                add(stop.body, force)
                add(stop.relative_to, -force)
        return forces

    def _force_of(self, stop: PointStop, force: float, q: FloatArray) -> FloatArray:
        return force * self._in_world(complex(*stop.normal), stop.relative_to, q)

    def _in_world(self, vector: complex, body: str, q: FloatArray) -> FloatArray:
        if body != GROUND:
            vector *= complex(np.exp(-1j * self.kinematics.angle(body).value(q)))
        return np.array([vector.real, vector.imag])

    def _rows(self, q: FloatArray, u: FloatArray, held: Contacts) -> tuple[FloatArray, FloatArray]:
        """G and dG/dt u: the held contacts' rows, then those of the loops."""
        k = self.kinematics
        if not held and not k.loop_closures:
            return np.zeros((0, len(q))), np.zeros(0)
        contacts = np.reshape([k.gap_jacobian(name, q) for name in held], (-1, len(q)))
        bias = [float(k.gap_bias(name, q, u)) for name in held]
        if not k.loop_closures:
            return contacts, np.array(bias)
        curvature = k.curvature(q, u)
        bias += [float(closure.bias(q, u, curvature)) for closure in k.loop_closures]
        return np.concatenate([contacts, k.loop_jacobian(q)]), np.array(bias)

    def _loop_forces(self, q: FloatArray, multipliers: FloatArray) -> dict[str, FloatArray]:
        """World forces of the loops' joints on their children, from the multipliers."""
        values = multipliers.tolist()
        return {
            name: self._in_world(sum((values[k] * d for k, d in along), 0j), frame, q)
            for name, frame, along in self._loop_directions
        }

    @cached_property
    def _loop_directions(self) -> list[tuple[str, str, list[tuple[int, complex]]]]:
        """Name of each loop's joint, the body that its directions turn with, its multipliers'."""
        found, k = list[tuple[str, str, list[tuple[int, complex]]]](), 0
        for joint in self.mechanism.loop_joints:
            frame = joint.parent if joint.free_directions else GROUND
            found.append((joint.name, frame, list(enumerate(joint.held_directions, k))))
            k += len(joint.held_directions) + joint.holds_angle
        return found


def held_still(
    free: FloatArray, mass_matrix: FloatArray, rows: FloatArray, bias: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Accelerations where rows G are held, and their forces: G a + bias = 0.

    Args:
        free: accelerations with nothing held, shape (n,).
        mass_matrix: shape (n, n).
        rows: G, shape (m, n).
        bias: dG/dt u, shape (m,).
    """
    response = inverse(mass_matrix) @ rows.T
    forces = _least_norm(rows @ response, -(rows @ free + bias))
    return free + response @ forces, forces


def subtree_sums(mechanism: Mechanism, forces: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Sum of forces on all bodies beyond each joint of the tree [N], shape (2,)."""
    sums = {body.name: forces.get(body.name, np.zeros(2)) for body in mechanism.bodies}
    joints = mechanism.tree_joints
    for joint in reversed(joints):
        if joint.parent != GROUND:
            sums[joint.parent] = sums[joint.parent] + sums[joint.child]
    return {joint.name: sums[joint.child] for joint in joints}


def _same(one: FloatArray, other: FloatArray) -> bool:
    """Tell whether two states are equal; engines give a state that was set as another array."""
    return one is other or bool((one == other).all())


def _least_norm(matrix: FloatArray, target: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    return scale * np.linalg.lstsq(scale[:, None] * matrix * scale, scale * target, _RANK)[0]
