"""An engine's run with some of its causes taken out or made larger."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from pydantic import JsonValue

from ...engines.protocol import Capabilities, Engine
from ...engines.registry import with_options
from ...engines.study import Intervention
from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import PointMotion, Trajectory
from ..runs.trials import Trial, Trials

LAST_BITS = 1e-15
"""Relative change of gravity (without it, of the start speeds), a few units in the last place: what it does to a run is
roundoff."""
_SHAPIRO = np.array([-1.0, 4.0, 10.0, 4.0, -1.0]) / 16.0
_EVEN = 1e-6  # relative difference of steps that are meant to be equal: rounding of the times


@dataclasses.dataclass(frozen=True)
class Reread:
    """An engine whose runs are read otherwise."""

    engine: Engine
    own_kinematics: bool
    """Markers and energies are taken from its coordinates by the machine's kinematics."""
    filtered_torques: bool
    """Torques are rid of what changes sign with every step."""

    @property
    def name(self) -> str:
        """Of the engine."""
        return self.engine.name

    @property
    def capabilities(self) -> Capabilities:
        """Of the engine."""
        return self.engine.capabilities

    @property
    def timestep(self) -> float | None:
        """Of the engine [s]."""
        return self.engine.timestep

    @property
    def preset(self) -> str:
        """Of the engine."""
        return self.engine.preset

    @property
    def settings(self) -> dict[str, JsonValue]:
        """The engine's options and how it is read: what a trial is remembered by."""
        ways: dict[str, JsonValue] = {
            "own_kinematics": self.own_kinematics,
            "filtered_torques": self.filtered_torques,
        }
        return {**self.engine.settings, **ways}

    def simulate(self, problem: Problem) -> Trajectory:
        """As the engine does it, read otherwise."""
        trajectory = self.engine.simulate(problem)
        if self.own_kinematics:
            trajectory = by_kinematics(trajectory)
        return with_filtered_torques(trajectory) if self.filtered_torques else trajectory


def by_kinematics(trajectory: Trajectory) -> Trajectory:
    """The same motion, its markers and energies computed from q and u."""
    kinematics, q, u = Kinematics(trajectory.mechanism), trajectory.q, trajectory.u
    rows = {m.name: kinematics.point(m.body, m.point) for m in trajectory.mechanism.markers}
    return dataclasses.replace(
        trajectory,
        markers={
            name: PointMotion(kinematics.position(row, q), kinematics.velocity(row, q, u))
            for name, row in rows.items()
        },
        kinetic_energy=kinematics.kinetic_energy(q, u),
        potential_energy=kinematics.potential_energy(q),
    )


def with_filtered_torques(trajectory: Trajectory) -> Trajectory:
    """The same motion, its torques rid of what alternates from sample to sample.

    By the filter of fourth order of Shapiro (Smoothing, filtering, and boundary effects, 1970),
    (-1, 4, 10, 4, -1)/16, which leaves every cubic as it is. Samples stay as they are where the
    five are not equally spaced, or a stop releases among them.
    """
    t = trajectory.t
    if len(t) < len(_SHAPIRO):
        return trajectory
    spans = np.lib.stride_tricks.sliding_window_view(np.diff(t), len(_SHAPIRO) - 1)
    even = spans.max(axis=1) - spans.min(axis=1) <= _EVEN * spans.max(axis=1)
    for time in trajectory.release_times.values():
        if time is not None and time > 0:
            even &= (time < t[:-4]) | (time > t[4:])
    inside = np.flatnonzero(even) + 2
    torques: dict[str, FloatArray] = {}
    for name, torque in trajectory.stop_torques.items():
        filtered = torque.copy()
        filtered[inside] = np.convolve(torque, _SHAPIRO, mode="same")[inside]
        torques[name] = filtered
    return dataclasses.replace(trajectory, stop_torques=torques)


def varied(trials: Trials, base: Engine, done: Sequence[Intervention], last_bits: int = 0) -> Trial:
    """The trial of a base with some interventions made, the later ones over the earlier ones.

    Args:
        trials: of one machine.
        base: the run that is explained.
        done: interventions.
        last_bits: +1 or -1 changes gravity, or without it the start speeds, by as many
            :data:`LAST_BITS`.

    Raises:
        InputError: an option of an intervention is not valid.
    """
    options: dict[str, JsonValue] = {}
    for intervention in done:
        options |= intervention.options
    engine = with_options(base, options)
    kinematics = any(intervention.own_kinematics for intervention in done)
    filtered = any(intervention.filtered_torques for intervention in done)
    if kinematics or filtered:
        engine = Reread(engine, kinematics, filtered)
    given = _given(trials.mechanism, done, last_bits)
    return trials.trial(engine, of=None if given == trials.mechanism else given)


def _given(mechanism: Mechanism, done: Sequence[Intervention], last_bits: int) -> Mechanism:
    changes: dict[str, object] = {}
    factor = 1.0 + last_bits * LAST_BITS
    if last_bits and mechanism.gravity:
        changes["gravity"] = mechanism.gravity * factor
    elif last_bits:
        changes["start_speeds"] = tuple(speed * factor for speed in mechanism.start_speeds)
    for intervention in done:
        if intervention.point_inertia is not None:
            given = {"inertia": intervention.point_inertia}
            changes["bodies"] = tuple(
                body if body.inertia else body.model_copy(update=given) for body in mechanism.bodies
            )
    return mechanism.model_copy(update=changes)
