"""Programs of a scene for Node.js, with nothing but an engine's interface.

A program is an ECMAScript module. Save it as `run.mjs` in a folder with the engine's package of npm
and call `node run.mjs`: it prints JSON with `t` [s], `q` and `u`, the mechanism's coordinates and
speeds in each sample, all digits of each number; beside them `states` of the bodies (x, y, angle
and their rates) and what the engine has `told` of each step. :meth:`.NodePackage.run` does so.
Where `binary` is asked for, the same arrays are written as :meth:`.NodePackage.arrays` reads them.

An engine's own part is its template `alone.mjs.j2`, with functions

- `state(name)`: x, y, angle, and their rates of a body;
- `apply(name, force, torque)`: given to a body for the next step;
- `step()`: takes a step, and returns numbers that it tells of it;
- `built()`: numbers that the world holds, for the model check.

The name may be "ground", whose state is zeros and which takes any force.

An engine that knows angles within a turn only calls `counted(name, angle)` in `state`, for the
angle counted on from the start. Each body turns by less than half a turn in a step.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.study import filled_template
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    ConstantForce,
    ConstantTorque,
    ElementTable,
    RotationalSpringDamper,
    RotorInertia,
    SlideSpringDamper,
    SpringDamper,
)
from trebucheck.models.mechanism import Slide
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Vector

from .node_package import ARRAYS
from .node_scene import MIRROR, REFUSED, NodeScene


def node_program(
    module: str,
    scene: NodeScene,
    problem: Problem,
    timestep: float,
    *,
    binary: bool = False,
    tells: bool = False,
    **values: Any,
) -> str:
    """The program of a run.

    Args:
        module: whose templates have the engine's part.
        scene: what is moved.
        problem: for its duration and force elements.
        timestep: [s].
        binary: write arrays as bytes, not as JSON: long runs have millions of numbers.
        tells: write what the engine's part returns of `built()`, too, and take no step.
        values: of the engine's part, which has `scene`, `problem`, `names` of the bodies and `text`
            besides.
    """
    mechanism = scene.mechanism
    known = {"scene": scene, "problem": problem, "names": scene.names, "text": _text}
    engine = filled_template(module, "alone.mjs.j2", **known, **values)
    return filled_template(
        __name__,
        "program.mjs.j2",
        engine=engine,
        names=scene.names,
        timestep=timestep,
        steps=0 if tells else whole_steps(problem.duration, timestep),
        tells=tells,
        loads=[line for each in mechanism.force_elements for line in _LOADS[each](scene, each)],
        angles=[
            (body.name, scene.angles[body.name])
            for body in mechanism.bodies
            if body.angle is not None
        ],
        slides=[_slide(scene, slide) for slide in mechanism.slides],
        binary=binary,
        shared=ARRAYS.as_uri(),
        text=_text,
    )


def _slide(scene: NodeScene, slide: Slide) -> str:
    """Arguments of the program's `slide` for a slide coordinate."""
    joint, along = slide.joint, complex(slide.direction)
    axis = scene.turned_at_start(joint.parent, (along.real, along.imag))
    return (
        f"{_point(scene, joint.parent, joint.parent_point)}, "
        f"{_point(scene, joint.child, joint.child_point)}, {_text(axis)}"
    )


def _text(value: Any) -> str:
    """A value as JavaScript reads it, numbers as float64."""
    if isinstance(value, np.ndarray):
        value = (value + 0.0).tolist()
    return json.dumps(value + 0.0 if isinstance(value, float) else value)


def _point(scene: NodeScene, body: str, point: Vector) -> str:
    return f"{_text(body)}, {_text(scene.offset(body, point))}"


# --- Forces and torques of a step


def _force(scene: NodeScene, element: ConstantForce) -> list[str]:
    if element.body == GROUND:
        return []
    force: FloatArray = np.array(element.force) * MIRROR
    at = f"point({_point(scene, element.body, element.point)})"
    return [f"push({_text(element.body)}, {at}, {_text(force)})"]


def _torque(scene: NodeScene, element: ConstantTorque) -> list[str]:
    both = (element.body, element.torque), (element.relative_to, -element.torque)
    return [f"apply({_text(body)}, [0, 0], {_text(torque)})" for body, torque in both]


def _spring(scene: NodeScene, element: SpringDamper) -> list[str]:
    ends = (element.body, element.point), (element.relative_to, element.relative_point)
    law = ", ".join(map(_text, (element.stiffness, element.damping, element.rest_length)))
    return [f"spring({', '.join(_point(scene, *end) for end in ends)}, {law})"]


def _torsion_spring(scene: NodeScene, element: RotationalSpringDamper) -> list[str]:
    between = scene.angles[element.body] - scene.angles[element.relative_to]
    law = element.stiffness, element.damping, element.rest_angle - between
    bodies = f"{_text(element.body)}, {_text(element.relative_to)}"
    return [f"torsionSpring({bodies}, {', '.join(map(_text, law))})"]


def _slide_spring(scene: NodeScene, element: SlideSpringDamper) -> list[str]:
    law = element.stiffness, element.damping, element.rest_position, element.force
    ends = _slide(scene, scene.mechanism.slide(element.coordinate))
    return [f"slideSpring({ends}, {', '.join(map(_text, law))})"]


def _rotor(_: NodeScene, __: RotorInertia) -> list[str]:
    return []  # a part of its body's inertia


_LOADS: ElementTable[Callable[[NodeScene, Any], list[str]]] = ElementTable(
    "the program for Node.js",
    FORCE_ELEMENTS,
    {
        ConstantForce: _force,
        ConstantTorque: _torque,
        SpringDamper: _spring,
        RotationalSpringDamper: _torsion_spring,
        SlideSpringDamper: _slide_spring,
        RotorInertia: _rotor,
    },
    REFUSED,
)
