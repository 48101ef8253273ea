"""Moves an engine through releases and impacts, each located inside its step.

For engines that move a mechanism with some contacts held, and leave it to others which: the loop is
that of :mod:`trebucheck.engines.events`. States are in the mechanism's coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from trebucheck.engines import events
from trebucheck.engines.events import (
    ContactEvents,
    RestitutionRule,
    SteppedMotion,
    impact_by_rule,
    note_own_releases,
    root_in,
)
from trebucheck.engines.impact import Contacts, Inertia, active_contacts, resting
from trebucheck.engines.protocol import Recording
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import initial_state
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import PointMotion

from .constrained import Solved
from .schemes import State


@dataclass(frozen=True)
class Observation:
    """An engine's points, energies and forces in one state."""

    points: Mapping[str, tuple[FloatArray, FloatArray]]
    """Position [m] and velocity [m/s] of each marker, each of shape (2,)."""
    kinetic_energy: float
    """[J]"""
    potential_energy: float
    """[J], of gravity and springs, zero at the world's origin."""
    reactions: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Force of each joint on its child, world frame [N], shape (2,)."""
    gaps: Mapping[str, float] = field(default_factory=dict[str, float])
    """Distance of the two points of each joint that can part [m]."""


class HeldMotion(Protocol):
    """Interface of an engine for the driver."""

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts held."""
        ...

    def solve(self, q: FloatArray, u: FloatArray, held: Contacts) -> Solved:
        """Accelerations and forces in a state, contacts held."""
        ...

    def inertia(self, q: FloatArray) -> Inertia:
        """Response of the speeds to impulses."""
        ...

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and forces in a state."""
        ...


class Samples:
    """States and observations of a run, in order of time."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.steps = problem, 0
        self._rows: list[tuple[float, State, Mapping[str, float], Observation]] = []

    def add(
        self, t: float, state: State, contacts: Mapping[str, float], observation: Observation
    ) -> None:
        """Record an instant [s], in place of an earlier state at the same time (an event's)."""
        if self._rows and t <= self._rows[-1][0]:
            self._rows.pop()
        self._rows.append((t, state, contacts, observation))

    def recording(self, events: ContactEvents) -> Recording:
        """The samples and events as the engines' common record."""
        times, states, contacts, seen = zip(*self._rows, strict=True)
        mechanism, first = self.problem.mechanism, seen[0]
        return Recording(
            t=np.array(times),
            q=np.array([q for q, _ in states]),
            u=np.array([u for _, u in states]),
            markers={
                name: PointMotion(
                    *(np.array([each.points[name][k] for each in seen]) for k in (0, 1))
                )
                for name in first.points
            },
            kinetic_energy=np.array([each.kinetic_energy for each in seen]),
            potential_energy=np.array([each.potential_energy for each in seen]),
            stop_torques={
                s.name: np.array([each.get(s.name, 0.0) for each in contacts])
                for s in mechanism.stops
            },
            release_times=events.releases,
            joint_reactions={
                name: np.array([each.reactions[name] for each in seen]) for name in first.reactions
            },
            joint_gaps={name: np.array([each.gaps[name] for each in seen]) for name in first.gaps},
            impacts=tuple(events.impacts),
            steps=self.steps,
        )

    def own_recording(self, engine: str) -> Recording:
        """The record of an engine that steps from sample to sample and holds its stops itself."""
        self.steps = len(self._rows) - 1
        noted = ContactEvents(self.problem.mechanism, engine)
        found = self.recording(noted)
        note_own_releases(noted, found.t, found.stop_torques)
        return replace(found, release_times=noted.releases)


class HeldSteps(SteppedMotion[State]):
    """Steps of an engine from state to state, with contacts held."""

    def __init__(
        self, problem: Problem, motion: HeldMotion, engine: str, timestep: float, locate: bool
    ) -> None:
        super().__init__(problem, timestep, locate=locate)
        self.motion, self.engine = motion, engine
        self.samples = Samples(problem)
        self.now: State = initial_state(problem.mechanism)

    def save(self) -> State:
        """The present state."""
        return self.now

    def state(self) -> State:
        """The present state."""
        return self.now

    def coordinates(self, states: Sequence[State]) -> State:
        """Coordinates and speeds, each of shape (n, n_q)."""
        return np.array([q for q, _ in states]), np.array([u for _, u in states])

    def step(self, before: State, step: float) -> None:
        """Take a step [s] from a state; zero restores the state."""
        if step > 0.0:
            self.samples.steps += 1
            self.now = self.motion.advance(before, step, self.held)
        else:
            self.now = before

    def _solved(self) -> Solved:
        return self.motion.solve(*self.now, self.held)

    def pulling(self) -> Contacts:
        """Contacts that would have to pull."""
        forces = self._solved().contacts if self.held else {}
        return tuple(name for name in self.held if forces[name] < 0)

    def opening(self, before: State, step: float, pulling: Contacts) -> tuple[float, Contacts]:
        """Go to where the least force first falls through zero."""

        def least(part: float) -> float:
            self.step(before, part)
            return min(self._solved().contacts.values())

        part = root_in(least, 0.0, step)
        self.step(before, part)
        forces = self._solved().contacts
        return part, (*self.pulling(), min(forces, key=lambda name: forces[name]))

    def let_go(self, names: Contacts) -> None:
        """Do nothing: a contact is held in each call by its name."""

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Hold those of the contacts at rest that push, and record the sample [s]."""
        q, u = self.now

        def violated(active: Contacts) -> str | None:
            solved = self.motion.solve(q, u, active)
            return next((name for name in rest if self._violates(name, q, u, solved)), None)

        self.held = active_contacts(rest, violated)
        self.record(time)
        return self.held

    def _violates(self, name: str, q: FloatArray, u: FloatArray, solved: Solved) -> bool:
        """Tell whether a contact at rest would pull, or close."""
        if name in solved.contacts:
            return solved.contacts[name] < 0
        k = self.kinematics
        return float(k.gap_jacobian(name, q) @ solved.accelerations + k.gap_bias(name, q, u)) < 0

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Change the speeds by the impact of all contacts that touch."""
        q, u = self.now
        gaps = {name: self.kinematics.gap_jacobian(name, q) for name in touching}
        impact = impact_by_rule(
            self.motion.inertia(q),
            u,
            gaps,
            self.held,
            lambda closing, speeds: rule(closing, q, speeds),
            self.engine,
        )
        self.now = (q, impact.speeds)
        return impact.impulses, resting(impact.left)

    def record(self, time: float) -> None:
        """Add the present sample [s]."""
        solved = self._solved()
        self.samples.add(time, self.now, solved.contacts, self.motion.observe(*self.now, solved))

    def recording(self, events: ContactEvents) -> Recording:
        """The samples and events as the engines' common record."""
        return self.samples.recording(events)


class EventDriver:
    """One run of an engine through a problem.

    Raises:
        SimulationError: no set of contacts takes part in an impact, or impacts follow each other
        without end.
        UnsupportedProblemError: under the release-once law, a closed stop starts with a gap that
            changes.
    """

    def __init__(
        self,
        problem: Problem,
        motion: HeldMotion,
        engine: str,
        timestep: float,
        locate: bool = True,
    ) -> None:
        """Prepare a run.

        Args:
            problem: what is to be moved, for how long.
            motion: the engine.
            engine: its name, for messages.
            timestep: [s].
            locate: whether releases are located inside a step; otherwise a stop opens at the end of
                the first step after which it would pull.
        """
        steps = HeldSteps(problem, motion, engine, timestep, locate)
        impacts = problem.stop_law is StopLaw.UNILATERAL
        self._driver = events.EventDriver(problem, steps, engine, impacts=impacts)

    def run(self) -> Recording:
        """Move the mechanism from its start to the problem's end."""
        return self._driver.run()
