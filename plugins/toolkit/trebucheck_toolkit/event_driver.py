"""Drives an engine through the releases and impacts of a problem, each located inside its step.

For engines that move a mechanism with some contacts held, and leave it to others which: what
happens at an event is decided by the rules of :mod:`.contact_events` and :mod:`.impact_law`. States
are in the mechanism's coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from trebucheck.engines.contact_events import (
    AT_REST,
    ContactEvents,
    Contacts,
    active_contacts,
    refuse_moving_gaps,
    resting,
)
from trebucheck.engines.event_location import may_be_met, onto_zero_gap, root_in
from trebucheck.engines.impact import Inertia, resolve_impact
from trebucheck.engines.protocol import Recording
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.trajectory import PointMotion

from .constrained import Solved
from .schemes import State

_ROUNDING = 1e-15  # times closer than this (relatively) are one time


@dataclass(frozen=True)
class Observation:
    """What an engine shows in one state."""

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
    """What the driver needs of an engine."""

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts held."""
        ...

    def solve(self, q: FloatArray, u: FloatArray, held: Contacts) -> Solved:
        """Accelerations and forces in a state, contacts held."""
        ...

    def inertia(self, q: FloatArray) -> Inertia:
        """What impulses do to the speeds."""
        ...

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """What the engine shows in a state."""
        ...


class Samples:
    """States and observations of a run, in order of time."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.steps = problem, 0
        self._rows: list[tuple[float, State, Mapping[str, float], Observation]] = []

    def add(
        self, t: float, state: State, contacts: Mapping[str, float], observation: Observation
    ) -> None:
        """Record an instant [s]; of one that is recorded already (an event's) the later state counts."""
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
        self.problem, self.motion, self.engine, self.timestep, self.locate = (
            problem,
            motion,
            engine,
            timestep,
            locate,
        )
        self.kinematics = Kinematics(problem.mechanism)
        self.events = ContactEvents(problem.mechanism, engine)
        self.samples = Samples(problem)
        self.state: State = initial_state(problem.mechanism)
        self.held: Contacts = ()
        self._parted = set[str]()
        """Open stops that an impact opened."""

    def run(self) -> Recording:
        """Move the mechanism from its start to the problem's end."""
        self._begin()
        duration, steps = self.problem.duration, self.problem.duration / self.timestep
        whole = (
            round(steps)
            if abs(steps - round(steps)) < _ROUNDING * steps * 10
            else int(np.ceil(steps))
        )
        for k in range(whole):
            self._step_through_events(k * self.timestep, min((k + 1) * self.timestep, duration))
        return self.samples.recording(self.events)

    # --- Start
    # -------------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        closed = tuple(stop.name for stop in self.problem.mechanism.stops if stop.closed)
        if not self._unilateral:
            refuse_moving_gaps(self.problem.mechanism, self.engine)
            self._hold(closed, dict.fromkeys(closed, 0.0), 0.0)
        else:
            speeds = {name: self._gap(name, self.state)[1] for name in closed}
            if any(speed < -AT_REST for speed in speeds.values()):
                self._resolve_impact(closed, 0.0)
            else:
                self._hold(closed, speeds, 0.0)
        self._record(0.0)

    @property
    def _unilateral(self) -> bool:
        return self.problem.stop_law is StopLaw.UNILATERAL

    def _hold(self, touching: Contacts, speeds: Mapping[str, float], t: float) -> None:
        """Of contacts with zero gap hold those whose gaps are at rest and that push; the others open at a time [s]."""
        q, u = self.state
        rest = resting(speeds)

        def violated(active: Contacts) -> str | None:
            solved = self.motion.solve(q, u, active)
            return next((name for name in rest if self._violates(name, q, u, solved)), None)

        self.held = active_contacts(rest, violated)
        parting = [name for name in touching if name not in rest]
        self._parted = self._parted - set(rest) | set(parting)
        self.events.release([name for name in touching if name not in self.held], t)

    def _violates(self, name: str, q: FloatArray, u: FloatArray, solved: Solved) -> bool:
        """Whether a contact at rest would pull, or close."""
        if name in solved.contacts:
            return solved.contacts[name] < 0
        k = self.kinematics
        return float(k.gap_jacobian(name, q) @ solved.accelerations + k.gap_bias(name, q, u)) < 0

    # --- Steps
    # -------------------------------------------------------------------------------------------------------

    def _step_through_events(self, start: float, end: float) -> None:
        while end - start > _ROUNDING * end:
            start = self._step_to_event(start, end)

    def _step_to_event(self, start: float, end: float) -> float:
        """Step to the next event, or from one time to another [s]; return the time reached."""
        before, step, met = self.state, end - start, None
        after = self._advanced(step)
        parts = self._meetings(before, after, step)
        if parts:
            met = min(parts, key=lambda name: parts[name])
            step, after = parts[met], self._advanced(parts[met])
        pulling = self._pulling(after)
        if pulling and step > 0.0:
            return self._release_within(before, step, start, end)
        self.state = after
        reached = end if end - (start + step) < _ROUNDING * end else start + step
        if met is not None:
            q = after[0]
            gap = self.kinematics.gap
            self._resolve_impact(
                self.events.touching(reached, met, self.held, lambda n: float(gap(n, q))), reached
            )
        self._record(reached)
        return reached

    def _advanced(self, step: float) -> State:
        """The state a step [s] after the present one."""
        if step <= 0.0:
            return self.state
        self.samples.steps += 1
        return self.motion.advance(self.state, step, self.held)

    def _pulling(self, state: State) -> Contacts:
        """Contacts that would have to pull in a state."""
        solved = self.motion.solve(*state, self.held) if self.held else None
        return (
            () if solved is None else tuple(name for name in self.held if solved.contacts[name] < 0)
        )

    def _release_within(self, before: State, step: float, start: float, end: float) -> float:
        """Release the contact whose force first falls through zero in a step [s]; return the time reached."""

        def least(part: float) -> float:
            return min(self.motion.solve(*self._advanced(part), self.held).contacts.values())

        part = root_in(least, 0.0, step) if self.locate else step
        self.state = self._advanced(part) if part > 0 else before
        reached = end if end - (start + part) < _ROUNDING * end else start + part
        forces = self.motion.solve(*self.state, self.held).contacts
        self._release_all(
            (*self._pulling(self.state), min(forces, key=lambda name: forces[name])), reached
        )
        self._record(reached)
        return reached

    def _release_all(self, names: Contacts, t: float) -> None:
        """Release contacts, and those that would have to pull without them."""
        while names:
            self.held = tuple(name for name in self.held if name not in names)
            self.events.release(names, t)
            names = self._pulling(self.state)

    # --- Impacts
    # -----------------------------------------------------------------------------------------------------

    def _gap(self, name: str, state: State) -> tuple[float, float]:
        """Gap of a stop [rad, m] and its speed."""
        q, u = state
        return float(self.kinematics.gap(name, q)), float(self.kinematics.gap_jacobian(name, q) @ u)

    def _meetings(self, before: State, after: State, step: float) -> dict[str, float]:
        """Open stops that are met in a step [s], and the part of it after which each is."""
        open_stops = (
            [name for name in self.events.releases if name not in self.held]
            if self._unilateral
            else []
        )
        parts = {name: self._meeting(name, before, after, step) for name in open_stops}
        return {name: part for name, part in parts.items() if part is not None}

    def _meeting(self, name: str, before: State, after: State, step: float) -> float | None:
        first, last = self._gap(name, before), self._gap(name, after)
        least = 0.0 if name in self._parted else self.events.rebounds.least_speed(name, *before)
        gaps, speeds = np.array([first[0], last[0]]), np.array([first[1], last[1]])
        if not may_be_met(gaps, speeds, least, step).any():
            return None
        return onto_zero_gap(self._gap_after(name), first[0], (first[1], last[1]), step, least)

    def _gap_after(self, name: str) -> Callable[[float], tuple[float, float]]:
        return lambda part: self._gap(name, self._advanced(part))

    def _resolve_impact(self, touching: Contacts, t: float) -> None:
        """Change the speeds by the impact of all contacts that touch at a time [s]."""
        q, u = self.state
        gaps = {name: self.kinematics.gap_jacobian(name, q) for name in touching}
        inertia = self.motion.inertia(q)
        held = np.reshape([gaps[name] for name in self.held], (-1, len(q)))
        u = inertia.without_drift(u, held)
        closing = {name: float(row @ u) for name, row in gaps.items()}
        restitution = self.events.restitution(closing, q, u)
        impact = resolve_impact(inertia, u, gaps, restitution, self.engine)
        self.events.note_impact(t, impact.impulses)
        self.state = (q, impact.speeds)
        self._hold(touching, impact.left, t)

    def _record(self, t: float) -> None:
        solved = self.motion.solve(*self.state, self.held)
        self.samples.add(t, self.state, solved.contacts, self.motion.observe(*self.state, solved))
