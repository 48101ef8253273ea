"""Plug-ins of engines with trees of joints: motion by forward dynamics or own steps.

A tree is in joint coordinates (:mod:`.joint_coordinates`). With M a + bias = forces it is moved by
a scheme of one's own with stops and loops as multipliers (:class:`TreeMotion`), or by its engine's
step with the engine's joint limits (:class:`LimitedMotion`), whose torque in a step h is what the
step's change of speed leaves over:

    torque = M (v' - v) / h + bias - forces.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from trebucheck.engines.events import Contacts
from trebucheck.engines.inspection import Dynamics, Inspection
from trebucheck.engines.inspection import State as Asked
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import Observation

from .constrained import ConstrainedDynamics, Solved, subtree_sums
from .joint_coordinates import JointCoordinates, Limit
from .plain_run import StepAhead
from .schemes import State


class JointTree(Protocol):
    """An engine's tree of joints, in joint coordinates j, v of shape (n,)."""

    @property
    def coordinates(self) -> JointCoordinates:
        """Its joint coordinates."""
        ...

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """M, shape (n, n)."""
        ...

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Joint forces that would keep the accelerations zero, gravity included, shape (n,)."""
        ...

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Observe; a joint's reaction is all that moves the bodies beyond it but gravity."""
        ...

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        ...

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        ...


class LimitedTree(JointTree, Protocol):
    """A tree with joint limits and a step of its own, at a present state."""

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        ...

    def limit(self, index: int, low: float, high: float) -> None:
        """Set the range of a joint coordinate; infinite ends are none."""
        ...

    def state(self) -> State:
        """The present state."""
        ...

    def step(self, forces: FloatArray) -> Mapping[str, FloatArray]:
        """Take one step under joint forces; return its reactions, as :meth:`observe` does."""
        ...


class TreeDynamics:
    """A tree's forward dynamics in the mechanism's coordinates."""

    def __init__(self, tree: JointTree) -> None:
        self.tree, self.coordinates = tree, tree.coordinates

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Under gravity and generalized forces, shape (n_q,)."""
        to = self.coordinates
        j, v = to.positions(q), to.speeds(u)
        rest = to.forces(applied) - self.tree.bias(j, v)
        return to.mechanism_speeds(
            np.asarray(np.linalg.solve(self.tree.mass_matrix(j), rest), dtype=np.float64)
        )

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Shape (n_q, n_q)."""
        return self.coordinates.mass_matrix(self.tree.mass_matrix(self.coordinates.positions(q)))


class TreeMotion(ConstrainedDynamics):
    """A tree moved by one of :mod:`.schemes`, stops and loops held by multipliers."""

    def __init__(self, tree: JointTree, scheme: str = "RK4") -> None:
        super().__init__(tree.coordinates.mechanism, TreeDynamics(tree))
        self.tree, self.scheme = tree, scheme

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""
        return self.stepped(state, step, held, self.scheme)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Observe the tree, with the forces of its joints and loops."""
        to = self.tree.coordinates
        seen = self.tree.observe(to.positions(q), to.speeds(u), to.speeds(solved.accelerations))
        seen = without_others(seen, self.applied, (q, u), self.forces_on_bodies(q, u, solved))
        return replace(seen, reactions=dict(seen.reactions) | dict(solved.loops))

    def inspect(self, states: Sequence[Asked], roundoff: float = 2.0**-53) -> Inspection:
        """Inspect the built tree in each state; the unit roundoff is that of its numbers."""
        q, u = initial_state(self.mechanism)
        to = self.tree.coordinates
        return Inspection(
            start=to.mechanism_positions(to.positions(q)),
            start_speeds=to.mechanism_speeds(to.speeds(u)),
            dynamics=tuple(self._dynamics(state) for state in states),
            total_mass=self.tree.total_mass(),
            roundoff=roundoff,
        )

    def _dynamics(self, state: Asked) -> Dynamics:
        solved, to = self.solve(state.q, state.u, state.closed), self.tree.coordinates
        j, v = to.positions(state.q), to.speeds(state.u)
        bias = np.linalg.solve(to.sums.T, self.tree.bias(j, v))
        return Dynamics(
            accelerations=solved.accelerations,
            stop_torques=solved.contacts,
            mass_matrix=self.engine.mass_matrix(state.q),
            forces=self.applied.generalized(state.q, state.u) - bias,
            centres=self.tree.centres(j),
            stop_gaps={name: float(self.kinematics.gap(name, state.q)) for name in state.closed},
        )


def without_others(
    seen: Observation, applied: AppliedForces, state: State, on_bodies: Mapping[str, FloatArray]
) -> Observation:
    """An observation with the reactions of joints alone, and the energy of springs.

    Args:
        seen: whose reactions are all that moves the bodies beyond each joint but gravity.
        applied: the springs.
        state: the mechanism's coordinates and speeds.
        on_bodies: all other forces on the bodies, world frame [N].
    """
    mechanism = applied.kinematics.mechanism
    others = subtree_sums(mechanism, on_bodies)
    held = [joint.name for joint in mechanism.tree_joints if joint.held_directions]
    return replace(
        seen,
        potential_energy=seen.potential_energy + float(applied.potential_energy(state[0])),
        reactions={
            name: seen.reactions[name] - others[name] for name in held if name in seen.reactions
        },
    )


class JointLimits:
    """The stops of a mechanism as ranges of joint coordinates.

    Raises:
        UnsupportedProblemError: a stop is on no joint.
    """

    def __init__(self, coordinates: JointCoordinates, engine: str) -> None:
        self.limits: dict[str, Limit] = {}
        for stop in coordinates.mechanism.stops:
            limit = coordinates.limit(stop)
            if limit is None:
                text = (
                    f"our adapter of {engine} builds stops as limits of joints alone, and "
                    f"{stop.name!r} is on none."
                )
                raise UnsupportedProblemError(text)
            self.limits[stop.name] = limit

    @property
    def places(self) -> dict[str, tuple[int, int]]:
        """Joint coordinate of each stop, and the sense in which it pushes it."""
        return {name: (limit.index, limit.sense) for name, limit in self.limits.items()}

    def ranges(self, names: Collection[str]) -> dict[int, tuple[float, float]]:
        """Range of each joint coordinate with stops that those named leave."""
        free = {limit.index: (-np.inf, np.inf) for limit in self.limits.values()}
        return free | Limit.ranges(self.limits[name] for name in names)


_ROUNDING = 1e-9  # of the largest term of a limit's torque: what is left of it by rounding


def torques_of_limits(
    kinematics: Kinematics,
    mass_matrix: FloatArray,
    q: FloatArray,
    whole: FloatArray,
    by_limits: FloatArray,
) -> list[float]:
    """Torque of each stop in a step from the speeds that limits change [N m], zero if it pulls.

    Args:
        kinematics: of the mechanism.
        mass_matrix: of its coordinates, shape (n_q, n_q).
        q: its coordinates before the step.
        whole: change of its speeds in the step, over its length, shape (n_q,).
        by_limits: the same, less that of a step without limits.
    """
    stops = kinematics.mechanism.stops
    rows = [kinematics.gap_jacobian(stop.name, q) for stop in stops]
    held = np.concatenate([np.array(rows), kinematics.loop_jacobian(q)])
    pushing = np.linalg.lstsq(held.T, mass_matrix @ by_limits)[0][: len(stops)]
    rounding = _ROUNDING * np.abs(mass_matrix @ whole).max()
    return np.where(pushing > rounding, pushing, 0.0).tolist()


class LimitedMotion(StepAhead):
    """A tree in its engine's own steps, for :func:`.plain_run.plain_run`.

    Under the release-once law a limit is taken away when it no longer pushes.

    Raises:
        UnsupportedProblemError: there are loops of joints, or stops that are on no joint.
    """

    def __init__(
        self,
        problem: Problem,
        tree: LimitedTree,
        timestep: float,
        engine: str,
        rounding: float = _ROUNDING,
        soft: bool = False,
    ) -> None:
        """Prepare a run.

        Args:
            problem: what is to be moved.
            tree: the engine's.
            timestep: of its step [s].
            engine: whose step it is, for messages.
            rounding: of the largest term of a limit's torque, what is left of it where there is
            none.
            soft: whether limits are springs, which begin without force.
        """
        refuse_loops(problem.mechanism, engine)
        self.tree, self.timestep, self.to, self.rounding = (
            tree,
            timestep,
            tree.coordinates,
            rounding,
        )
        self.limits, self.waits = JointLimits(self.to, engine), soft
        self.applied = AppliedForces(Kinematics(problem.mechanism))
        self.once = problem.stop_law is StopLaw.RELEASE_ONCE
        self.active = {
            stop.name for stop in problem.mechanism.stops if stop.closed or not self.once
        }
        self._set_limits()
        q, u = initial_state(problem.mechanism)
        tree.place(self.to.positions(q), self.to.speeds(u))
        self.step()

    def _show_and_step(self) -> tuple[State, Mapping[str, float], Observation]:
        j, v = self.tree.state()
        q, u = self.to.mechanism_positions(j), self.to.mechanism_speeds(v)
        forces = self.to.forces(self.applied.generalized(q, u))
        # Read before the step: engines look at their present state for it.
        mass, bias = self.tree.mass_matrix(j), self.tree.bias(j, v)
        reactions = self.tree.step(forces)
        after = self.tree.state()
        change = (after[1] - v) / self.timestep
        contacts = self._pushing(mass * change, bias - forces)
        seen = replace(self.tree.observe(j, v, change), reactions=reactions)
        self.tree.place(*after)
        if self.once and not self.waits:
            self._let_go(contacts)
        self.waits = False
        return (
            (q, u),
            contacts,
            without_others(seen, self.applied, (q, u), self.applied.on_bodies(q, u)),
        )

    def _pushing(self, inertial: FloatArray, others: FloatArray) -> dict[str, float]:
        torques = inertial.sum(axis=1) + others
        rounding = self.rounding * max(float(np.abs(inertial).max()), float(np.abs(others).max()))
        found = {
            name: self.limits.places[name][1] * float(torques[self.limits.places[name][0]])
            for name in self.active
        }
        return {name: torque if torque > rounding else 0.0 for name, torque in found.items()}

    def _let_go(self, contacts: Mapping[str, float]) -> None:
        open_now = {name for name in self.active if not contacts[name]}
        if open_now:
            self.active -= open_now
            self._set_limits()

    def _set_limits(self) -> None:
        for index, (low, high) in self.limits.ranges(self.active).items():
            self.tree.limit(index, low, high)


def refuse_loops(mechanism: Mechanism, engine: str) -> None:
    """Refuse joints that close loops.

    Raises:
        UnsupportedProblemError: there are some.
    """
    loops = [joint.name for joint in mechanism.loop_joints]
    if loops:
        raise UnsupportedProblemError(
            f"our adapter of {engine} builds a tree of joints, and {', '.join(loops)} closes a "
            "loop."
        )
