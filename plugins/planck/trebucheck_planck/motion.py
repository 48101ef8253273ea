"""Recordings of planck.js's steps: reactions of joints and torques of limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from trebucheck.engines.point_masses import NoPointMasses
from trebucheck.engines.protocol import Recording
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import FreeJoint
from trebucheck.models.problem import Problem
from trebucheck_toolkit.node_samples import NodeSamples
from trebucheck_toolkit.node_scene import MIRROR, lawful_stops


def recording(samples: NodeSamples, spread: NoPointMasses, problem: Problem) -> Recording:
    """Readings of a motion by bodies and planck.js, with original masses despite moved ones."""
    found, mechanism = samples.recording(), samples.scene.mechanism
    built = lawful_stops(problem)
    torques = dict(
        zip([stop.name for stop in built], samples.told[:, -len(built) :].T, strict=False)
    )
    closed = [stop.name for stop in mechanism.stops if stop.closed]
    none = np.zeros(len(samples.t))
    return replace(
        found,
        potential_energy=found.potential_energy - spread.extra_potential_energy,
        joint_reactions=_reactions(samples, spread),
        stop_torques={
            stop.name: _first_repeated(samples, torques.get(stop.name, none))
            for stop in mechanism.stops
        },
        release_times={name: _release(samples.t, torques[name]) for name in closed},
    )


def _release(t: FloatArray, torque: FloatArray) -> float | None:
    """Release of a closed stop: the beginning of the first step in which it does not push [s]."""
    opened = torque <= 0.0
    return float(t[int(np.argmax(opened))]) if opened.any() else None


def _reactions(samples: NodeSamples, spread: NoPointMasses) -> dict[str, FloatArray]:
    joints = [joint for joint in samples.scene.mechanism.joints if not isinstance(joint, FreeJoint)]
    forces = samples.told[:, : 2 * len(joints)].reshape(len(samples.t), len(joints), 2) * MIRROR
    found: dict[str, FloatArray] = {}
    for index, joint in enumerate(joints):
        velocity = samples.point(joint.child, joint.child_point)[1] * MIRROR
        # Of the step that begins at a sample; the last one's is that of the step before.
        change = np.diff(velocity, axis=0) / np.diff(samples.t)[:, None]
        acceleration = np.concatenate([change, change[-1:]])
        found[joint.name] = _first_repeated(
            samples, spread.reaction(joint.name, forces[:, index], acceleration)
        )
    return found


def _first_repeated(samples: NodeSamples, told: FloatArray) -> FloatArray:
    """The second sample's in the first, where the mechanism moves at the start.

    Impulses bring the velocities of the step before, along its directions, into those of this one;
    the first step's already are, so that it tells nothing of centripetal forces.
    """
    return (
        np.concatenate([told[1:2], told[1:]]) if samples.scene.u.any() and len(told) > 1 else told
    )
