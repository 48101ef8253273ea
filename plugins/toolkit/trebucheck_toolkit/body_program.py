"""Programs of bodies in Cartesian coordinates in Python, with nothing but an engine's interface.

The counterpart of :mod:`.node_program` for engines in Python. y points upwards, angles are
anticlockwise, points of a body are given from its centre of mass, and places, forces and
velocities are complex numbers x + i y. A program leaves `t` [s], `q` and `u`, the mechanism's
coordinates and speeds in each sample, `states` of the bodies (x, y, angle and their rates, shape
(n + 1, bodies, 6)) and what the engine has `told` of each step (shape (n, numbers)).
:func:`run_program` runs it.

An engine's own part is its template `alone.py.j2`, which imports the engine and defines

- `state(name)`: x, y, angle, and their rates of a body other than the ground, counted on through
  full turns;
- `push(name, at, force)`, `twist(name, torque)`: a force at a place and a torque, given to a body
  other than the ground for the next step;
- `step()`: takes a step, and returns a list of numbers that the engine tells of it.

It has the values `problem`, `frames`, `names` of the bodies, `text`, `upright`, `pushed` and
`twisted` (whether the program calls these functions), and those of the engine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool
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
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Mechanism, Slide
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Vector

from .node_scene import MIRROR, REFUSED, NodeScene

_Result = TypeVar("_Result")


class Frames(Protocol):
    """Frames in which an engine has a mechanism's bodies, about their centres of mass."""

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism that is built."""
        ...

    def place(self, body: str, point: Vector) -> complex:
        """A body's point from its centre of mass [m]; of the ground the point."""
        ...

    def direction(self, body: str, vector: Vector) -> complex:
        """A vector of a body's frame."""
        ...

    def turn(self, body: str) -> float:
        """Clockwise angle of the body where its angle in the engine is zero [rad]."""
        ...


class UprightScene:
    """Frames of a scene with y upwards: every body has the angle 0 at the start."""

    def __init__(self, scene: NodeScene) -> None:
        self.scene, self.mechanism = scene, scene.mechanism

    def place(self, body: str, point: Vector) -> complex:
        """A body's point from its centre of mass at the start [m]; of the ground the point."""
        return complex(*(self.scene.offset(body, point) * MIRROR))

    def direction(self, body: str, vector: Vector) -> complex:
        """A vector of a body's frame at the start."""
        return complex(*(self.scene.turned_at_start(body, vector) * MIRROR))

    def turn(self, body: str) -> float:
        """Clockwise angle of a body at the start [rad]."""
        return self.scene.angles[body]


def body_program(
    module: str, frames: Frames, problem: Problem, timestep: float, **values: Any
) -> str:
    """The program of a run.

    Args:
        module: whose templates have the engine's part.
        frames: what is moved.
        problem: for its duration and force elements.
        timestep: [s].
        values: of the engine's part.
    """
    mechanism = problem.mechanism
    lines = load_lines(frames, mechanism)
    calls = {line.partition("(")[0] for line in lines}
    shared = {
        "names": [body.name for body in mechanism.bodies],
        "pushed": bool(calls & {"push", "spring", "slide_spring"}),
        "twisted": bool(calls & {"twist", "torsion_spring"}),
        "text": program_text,
        "upright": upright,
    }
    engine = filled_template(
        module, "alone.py.j2", problem=problem, frames=frames, **shared, **values
    )
    return filled_template(
        __name__,
        "program.py.j2",
        engine=engine,
        timestep=timestep,
        steps=whole_steps(problem.duration, timestep),
        loads=lines,
        calls=calls,
        angles=[(b.name, frames.turn(b.name)) for b in mechanism.bodies if b.angle is not None],
        slides=[_slide(frames, slide) for slide in mechanism.slides],
        **shared,
    )


def load_lines(frames: Frames, mechanism: Mechanism) -> list[str]:
    """Calls of a program that give the bodies the forces and torques of a step.

    Their functions are `push`, `twist`, `spring`, `torsion_spring` and `slide_spring`, as
    `program.py.j2` has them, and `point`, whose first value is a place.
    """
    return [line for each in mechanism.force_elements for line in _LOADS[each](frames, each)]


def run_program(program: str) -> dict[str, FloatArray]:
    """Run a program here, and return `t`, `q`, `u`, `states` and `told`."""
    found: dict[str, Any] = {}
    exec(compile(program, "<program>", "exec"), found)
    arrays = {name: found[name] for name in ("t", "q", "u", "states", "told")}
    found.clear()  # its functions hold it: an engine's world would stay until cycles are broken
    return arrays


def apart(function: Callable[..., _Result], *given: Any) -> _Result:
    """Call a function in a process that is started for it.

    Libraries may keep memory that forks share: with those the second run in forks of a process that
    has loaded them hangs or crashes.

    Raises:
        SimulationError: the process ended by itself.
    """
    try:
        with ProcessPoolExecutor(max_workers=1) as process:
            return process.submit(function, *given).result()
    except BrokenProcessPool as error:
        raise SimulationError(f"the process of the run ended by itself: {error}") from None


def scene_states(frames: Frames, scene: NodeScene, states: FloatArray) -> FloatArray:
    """States of a program in a scene's axes, mirrored and with angles from the start."""
    mirrored = states * np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    names = [body.name for body in scene.mechanism.bodies]
    mirrored[..., 2] -= [scene.angles[name] - frames.turn(name) for name in names]
    return mirrored


def upright(vector: Any) -> tuple[float, ...]:
    """A vector of a scene with y upwards."""
    mirrored: FloatArray = np.array(vector) * MIRROR
    return tuple((mirrored + 0.0).tolist())


def program_text(value: Any) -> str:
    """A value as Python reads it, numbers as float64."""
    if isinstance(value, tuple):
        return f"({', '.join(map(program_text, value))})"
    return repr(value + 0.0) if isinstance(value, float) else repr(value)


def _slide(frames: Frames, slide: Slide) -> str:
    """Arguments of the program's `slide` for a slide coordinate."""
    joint, along = slide.joint, complex(slide.direction)
    axis = frames.direction(joint.parent, (along.real, along.imag))
    ends = (joint.parent, joint.parent_point), (joint.child, joint.child_point)
    return f"{', '.join(_end(frames, *end) for end in ends)}, {axis!r}"


# --- Forces and torques of a step


def _end(frames: Frames, body: str, point: Vector) -> str:
    return f"{body!r}, {frames.place(body, point)!r}"


def _force(frames: Frames, element: ConstantForce) -> list[str]:
    if element.body == GROUND:
        return []
    at = f"point({_end(frames, element.body, element.point)})[0]"
    return [f"push({element.body!r}, {at}, {complex(*element.force)!r})"]


def _torque(_: Frames, element: ConstantTorque) -> list[str]:
    both = (element.body, -element.torque), (element.relative_to, element.torque)
    return [f"twist({body!r}, {torque!r})" for body, torque in both if body != GROUND]


def _spring(frames: Frames, element: SpringDamper) -> list[str]:
    ends = (element.body, element.point), (element.relative_to, element.relative_point)
    law = program_text((element.stiffness, element.damping, element.rest_length))[1:-1]
    return [f"spring({', '.join(_end(frames, *end) for end in ends)}, {law})"]


def _torsion_spring(frames: Frames, element: RotationalSpringDamper) -> list[str]:
    rest = element.rest_angle - (frames.turn(element.body) - frames.turn(element.relative_to))
    law = program_text((element.stiffness, element.damping, rest))[1:-1]
    return [f"torsion_spring({element.body!r}, {element.relative_to!r}, {law})"]


def _slide_spring(frames: Frames, element: SlideSpringDamper) -> list[str]:
    law = element.stiffness, element.damping, element.rest_position, element.force
    ends = _slide(frames, frames.mechanism.slide(element.coordinate))
    return [f"slide_spring({ends}, {program_text(law)[1:-1]})"]


def _rotor(_: Frames, __: RotorInertia) -> list[str]:
    return []  # a part of its body's inertia


_LOADS: ElementTable[Callable[[Frames, Any], list[str]]] = ElementTable(
    "the program of bodies",
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
