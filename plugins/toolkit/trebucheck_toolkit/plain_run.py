"""Loop of an engine that holds stops itself: a stop without force is called open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from trebucheck.engines.events import ContactEvents, refuse_moving_gaps
from trebucheck.engines.protocol import Recording
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples

from .schemes import State

_ROUNDING = 1e-12  # of a number of steps


class OwnStops(Protocol):
    """Interface of an engine for the loop, at its present state."""

    def step(self) -> None:
        """Take one time step."""
        ...

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        ...

    def contacts(self) -> Mapping[str, float]:
        """Force of each stop [N m, N], positive where it pushes; zeros may be left out."""
        ...

    def observe(self) -> Observation:
        """Points, energies and forces."""
        ...


class StepAhead:
    """An engine one step ahead: forces at an instant are those of the step that begins there.

    Subclasses give :meth:`_show_and_step`, and call :meth:`step` once when they are ready.
    """

    _shown: tuple[State, Mapping[str, float], Observation]

    def _show_and_step(self) -> tuple[State, Mapping[str, float], Observation]:
        """Take the next step; return the present state, with forces and observation in it."""
        raise NotImplementedError

    def step(self) -> None:
        """Show the present state, and take the step that begins there."""
        self._shown = self._show_and_step()

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self._shown[0]

    def contacts(self) -> Mapping[str, float]:
        """Force of each limit [N m], in the step that begins."""
        return self._shown[1]

    def observe(self) -> Observation:
        """Points, energies and forces of the shown state."""
        return self._shown[2]


def plain_run(problem: Problem, motion: OwnStops, engine: str, timestep: float) -> Recording:
    """Step an engine in whole steps up to a problem's end or just beyond, recording each.

    A stop that was closed is called released at the end of the first step after which it has no
    force; at the start, where it has none after the first step either: the limits of many engines
    begin without force.

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
