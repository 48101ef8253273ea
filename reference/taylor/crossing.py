"""Singular positions on the Taylor integrator's way: it stops beside them, and goes on behind (:mod:`..singular`).

Its series have poles in such a position, so its steps shrink before it and rounding decides on the
branch. The motion across it is the one that the DOP853 solver takes, in doubles.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.launch import lead
from ...models.phasors import PointCoefficients
from ..contact import ActiveSet, PostEventState
from ..equations import Equations
from ..singular import Watch
from ..solver import Event, EventFinder, first_events, releases
from ..window import Window

_SAMPLES = 33  # of a window, in search of a launch


class Crossing:
    """Watches the steps under one active set, and takes the motion across; a callback of heyoka's.

    Args:
        equations: of the mechanism.
        initial: state from which the active set holds.
        finder: of the events after it.
    """

    def __init__(self, equations: Equations, initial: PostEventState, finder: EventFinder) -> None:
        self.n_q = len(initial.q)
        self._watch = Watch(equations, initial.closed, initial.q)
        self._locate = finder.first
        self._kinematics = equations.kinematics

    def __call__(self, integrator: Any) -> bool:
        """Whether the integration may take another step."""
        q, u = self._state(integrator)
        return not self._watch.nears(q, u * float(integrator.last_h))

    def cross(
        self, integrator: Any, until: float, launched: PointCoefficients | None
    ) -> tuple[Window, list[Event]] | None:
        """Move the integrator across, to its first events there or to `until` [s]; None if it may go on by itself.

        Args:
            integrator: heyoka's, beside a singular position.
            until: [s].
            launched: the point whose launch is looked for, if it is.

        Raises:
            SimulationError: the speed does not tell the branch, a stop opens in the singular
                position, or the point is launched beside it, which is looked for on Taylor's
                polynomials alone.
        """
        window = self._watch.window_from(float(integrator.time), *self._state(integrator))
        if window is None:
            return None
        end, events = first_events(
            self._locate, window.dense_output(), window.start, min(window.end, until)
        )
        window = window.until(end, releases(events))
        if launched is not None and self._passes_launch(window, launched):
            raise SimulationError(
                f"the Taylor integrator looks for no launch beside a singular position, from t = {window.start:.6g} s "
                f"to {window.end:.6g} s; DOP853 does."
            )
        q, u = self._watch.projected(*window.dense_output()(end).reshape(2, -1))
        integrator.time = type(integrator.time)(end)
        integrator.state[: 2 * self.n_q] = np.concatenate([q, u])
        return window, events

    def _passes_launch(self, window: Window, point: PointCoefficients) -> bool:
        states = window.dense_output()(np.linspace(window.start, window.end, _SAMPLES)).reshape(
            2, self.n_q, -1
        )
        leads = lead(self._kinematics.velocity(point, states[0].T, states[1].T))
        return bool(np.any((leads[1:] < 0) & (leads[:-1] >= 0)))

    def _state(self, integrator: Any) -> FloatArray:
        return np.array(integrator.state[: 2 * self.n_q], dtype=np.float64).reshape(2, -1)


class Crossings:
    """The crossing of each active set of a motion; None without loops of joints, whose constraints may lose rank."""

    def __init__(self, equations: Equations, active_set: ActiveSet) -> None:
        self._equations, self._active_set = equations, active_set
        self._last: tuple[PostEventState, Crossing] | None = None

    def of(self, initial: PostEventState) -> Crossing | None:
        """Of the steps after a state."""
        if not self._equations.n_loops:
            return None
        if self._last is None or self._last[0] is not initial:
            finder = EventFinder(
                self._equations, initial, self._active_set.event_functions(initial)
            )
            self._last = initial, Crossing(self._equations, initial, finder)
        return self._last[1]


class WindowOutput:
    """A window read as heyoka's continuous output: states with the observer's column, which nobody reads."""

    def __init__(self, window: Window) -> None:
        self._dense = window.dense_output()
        self.times = np.array([window.start, window.end])

    def __call__(self, t: FloatArray) -> FloatArray:
        """States (n, 2 n_q + 1) at times [s], shape (n,)."""
        times = np.asarray(t, dtype=np.float64)
        return np.column_stack([self._dense(times).T, np.zeros(len(times))])
