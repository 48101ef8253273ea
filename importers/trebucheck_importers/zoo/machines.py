"""The named machines as zoo models: their own files, and joints that read zero at the start."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path

from trebucheck.api.mechanics import GROUND, Mechanism, Stop, StopLaw, model
from trebucheck.api.mjcf import Variant, inertias, mjcf, mjcf_path, stored_motion

from .model import FileVariant, JointCoordinate, ZooModel

_VARIANTS = {
    "without sensors": Variant(sensors=False),
    "finite inertia": Variant(finite_inertia=True),
    "without sensors, finite inertia": Variant(sensors=False, finite_inertia=True),
}


def machine_model(name: str) -> ZooModel:
    """A machine, its file as it is published, and its motion to the launch.

    Raises:
        InputError: there is no machine of that name.
    """
    mechanism = model(name)
    text = Path(mjcf_path(name)).read_text()
    worldbody = ET.fromstring(text).find("worldbody")
    assert worldbody is not None
    names = [joint.get("name", "") for joint in worldbody.iter("joint")]
    start = dict(zip(mechanism.coordinates, mechanism.start, strict=True))
    joints = tuple(
        JointCoordinate(joint, weights, -sum(weight * start[q] for q, weight in weights.items()))
        for joint, weights in zip(names, _weights(mechanism, GROUND), strict=True)
    )
    return ZooModel(
        name,
        f"the {name} machine",
        mechanism,
        joints,
        limits=dict(_limits(mechanism, joints)),
        needs=("limits", "loops") if mechanism.loop_joints else ("limits",),
        stop_law=StopLaw.RELEASE_ONCE,
        text=text,
        variants=dict(_variants(mechanism, text)),
    )


def _variants(mechanism: Mechanism, text: str) -> Iterator[tuple[str, FileVariant]]:
    """Variants of a machine's file that differ; finite inertia may move some mass to the ground."""
    seen = {text}
    for name, variant in _VARIANTS.items():
        other = mjcf(mechanism, motion=stored_motion(mechanism), variant=variant)
        if other not in seen:
            yield (
                name,
                FileVariant(
                    other, sum(each.mass for each in inertias(mechanism, variant).values())
                ),
            )
        seen.add(other)


def _weights(mechanism: Mechanism, parent: str) -> Iterator[Mapping[str, float]]:
    """Weights of the joints below a body, depth first, slides before hinges."""
    angles = {body.name: body.angle for body in mechanism.bodies}
    for body in mechanism.children(parent):
        joint = mechanism.joint_of(body.name)
        yield from ({slide: 1.0} for slide in joint.slides)
        if body.angle is not None:
            outer = angles.get(parent)
            yield {body.angle: 1.0} | ({} if outer is None else {outer: -1.0})
        yield from _weights(mechanism, body.name)


def _limits(
    mechanism: Mechanism, joints: tuple[JointCoordinate, ...]
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Limits of the stops that act between a body and its parent; their other end is far away."""
    angles = {body.name: body.angle for body in mechanism.bodies}
    far = 1e10
    for stop in mechanism.stops:
        if isinstance(stop, Stop) and stop.relative_to == mechanism.joint_of(stop.body).parent:
            own, other = angles[stop.body], angles.get(stop.relative_to)
            of = {} if own is None else {own: 1.0} | ({} if other is None else {other: -1.0})
            joint = next(joint for joint in joints if dict(joint.weights) == of)
            end = stop.sense * stop.limit + joint.zero
            yield joint.joint, (end, far) if stop.sense > 0 else (-far, end)
