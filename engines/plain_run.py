"""The plain loop of an engine that holds stops itself: it is stepped, and a stop without force is called open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from ..models.problem import Problem
from .contact_events import ContactEvents, refuse_moving_gaps
from .event_driver import Observation, Samples
from .protocol import Recording
from .schemes import State

_ROUNDING = 1e-12  # of a number of steps


class OwnStops(Protocol):
    """What the loop needs of an engine, at its present state."""

    def step(self) -> None:
        """Take one time step."""
        ...

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        ...

    def contacts(self) -> Mapping[str, float]:
        """Force of each stop [N m, N], positive where it pushes; those without force may be left out."""
        ...

    def observe(self) -> Observation:
        """What the engine shows."""
        ...


def plain_run(problem: Problem, motion: OwnStops, engine: str, timestep: float) -> Recording:
    """Step an engine through a problem, in whole steps up to its end or just beyond it, and record it after each.

    A stop that was closed is called released at the end of the first step after which it has no force; at the start,
    where it has none after the first step either: the limits of many engines begin without force.

    Raises:
        UnsupportedProblemError: a closed stop starts with a gap that changes.
    """
    refuse_moving_gaps(problem.mechanism, engine)
    events, samples = ContactEvents(problem.mechanism, engine), Samples(problem)
    waiting = {stop.name for stop in problem.mechanism.stops if stop.closed}
    contacts = motion.contacts()
    pushed = {name for name in waiting if contacts.get(name, 0.0) > 0.0}
    samples.add(0.0, motion.state(), contacts, motion.observe())
    for k in range(1, int(np.ceil(problem.duration / timestep * (1 - _ROUNDING))) + 1):
        motion.step()
        samples.steps += 1
        contacts = motion.contacts()
        opened = {name for name in waiting if contacts.get(name, 0.0) <= 0.0}
        for name in opened:
            events.release([name], 0.0 if k == 1 and name not in pushed else k * timestep)
        waiting -= opened
        samples.add(k * timestep, motion.state(), contacts, motion.observe())
    return samples.recording(events)
