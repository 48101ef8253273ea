"""Recordings of engines that step rigid bodies by themselves, in Cartesian coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import JsonValue
from trebucheck.engines.point_masses import NoPointMasses
from trebucheck.engines.protocol import Recording
from trebucheck.engines.study import (
    REFINEMENT,
    Cause,
    ConstraintKinds,
    Intervention,
    time_step_cause,
)
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import FreeJoint, Stop
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem

from .gap_releases import OPENING, releases
from .node_samples import NodeSamples
from .node_scene import MIRROR, NodeScene


def own_program(title: str) -> Callable[[Any, Mechanism, float], dict[str, str]]:
    """Snippets of an engine for its study: the program of its run, where nothing assists it.

    Args:
        title: the engine and its language.
    """

    def snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
        if engine.assisted_by:
            return {}
        return {title: engine.script(Problem(mechanism, duration=duration))}

    return snippets


def caused_by(
    changes: Mapping[str, tuple[str, Mapping[str, JsonValue]]],
) -> Callable[[Any, ConstraintKinds], tuple[Cause, ...]]:
    """Causes of errors for a study, the same with all settings, and after them the time step.

    Args:
        changes: by the name of a cause its reason, and the options that take it out.
    """

    def causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
        own = (Cause(name, why, Intervention(out)) for name, (why, out) in changes.items())
        return *own, time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT})

    return causes


@dataclass(frozen=True)
class BodySteps:
    """The states of a scene's bodies after each step of an engine, and what the steps took.

    A step's forces are those at its beginning, where the engine computes them; those of the last
    sample are those of the last step. Where the engine makes its impulses hold after its positions
    have moved, they are those at the step's end (`at_end`), and the first sample has the first
    step's.

    Args:
        problem: what is moved.
        scene: the bodies as they are read.
        spread: the mechanism that the engine was given.
        t: start and end of each step [s], shape (n + 1,).
        states: centres of mass, angles, and their rates as in the scene, mirrored and from the
            start, shape (n + 1, bodies, 6).
        forces: of each joint that holds anything on its child, in the scene's axes, shape
            (n, joints, 2) [N]; None: the engine tells none.
        torques: of each stop that was built, zero where it does not push, shape (n,) [N m]; None:
            the engine tells none, and releases are those of the gaps.
        slop: angle by which limits may give way without being open [rad].
        opening: gap from which releases are looked back for (:mod:`.gap_releases`) [rad]; None:
            torques tell them, where there are any. They do not where rounding opens limits that
            are held, and closes them after their release.
        at_end: whether a step's forces are those at its end.
    """

    problem: Problem
    scene: NodeScene
    spread: NoPointMasses
    t: FloatArray
    states: FloatArray
    forces: FloatArray | None = None
    torques: Mapping[str, FloatArray] | None = None
    slop: float = OPENING
    opening: float | None = None
    at_end: bool = False

    def recording(self, q: FloatArray, u: FloatArray) -> Recording:
        """A recording with the coordinates and speeds that the engine's program has read."""
        found = self.samples.recording()
        potential = found.potential_energy - self.spread.extra_potential_energy
        found = replace(found, q=q, u=u, potential_energy=potential)
        if self.forces is not None:
            found = replace(found, joint_reactions=self._reactions(self.forces))
        if self.torques is None:
            return replace(found, release_times=releases(self.samples, self.opening or OPENING))
        stops = self.problem.mechanism.stops
        none = np.zeros(len(self.t) - 1)
        torques = {stop.name: self.torques.get(stop.name, none) for stop in stops}
        return replace(
            found,
            stop_torques={name: self._at_samples(torque) for name, torque in torques.items()},
            release_times=releases(self.samples, self.opening)
            if self.opening is not None
            else {
                stop.name: self._release(stop, torques[stop.name])
                if stop.closed and isinstance(stop, Stop)
                else None
                for stop in stops
            },
        )

    def _release(self, stop: Stop, torque: FloatArray) -> float | None:
        """End of the last step in which a closed stop pushes before it is open [s]; None: never.

        A limit that holds a joint from one side pauses where rounding or the correction of other
        joints leaves the angle short of it. It has opened where its gap is more than the engine's
        slop, or at the end after the longest of its pauses.
        """
        opened = np.flatnonzero(self.samples.gap(stop) > self.slop)
        end = int(opened[0]) if len(opened) else len(torque)
        pushing = np.flatnonzero(torque[:end] > 0.0)
        if not len(pushing):
            return 0.0
        *pauses, last = np.diff(np.append(pushing, end)).tolist()
        ended = len(opened) or last > max(pauses, default=1)
        return float(self.t[pushing[-1] + 1]) if ended else None

    @cached_property
    def samples(self) -> NodeSamples:
        """The same as samples of the scene."""
        return NodeSamples(self.scene, self.t, self.states)

    def _reactions(self, forces: FloatArray) -> dict[str, FloatArray]:
        """Force of each joint on its child with the masses of the mechanism [N]."""
        holding = [
            joint for joint in self.scene.mechanism.joints if not isinstance(joint, FreeJoint)
        ]
        reactions: dict[str, FloatArray] = {}
        for index, joint in enumerate(holding):
            _, velocity = self.samples.point(joint.child, joint.child_point)
            acceleration = np.diff(velocity * MIRROR, axis=0) / np.diff(self.t)[:, None]
            reactions[joint.name] = self._at_samples(
                self.spread.reaction(joint.name, forces[:, index] * MIRROR, acceleration)
            )
        return reactions

    def _at_samples(self, of_steps: FloatArray) -> FloatArray:
        parts = [of_steps[:1], of_steps] if self.at_end else [of_steps, of_steps[-1:]]
        return np.concatenate(parts)
