"""Small mechanisms with one element each, and walls on moving bodies.

What every engine must build.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mechanisms import G, body_of, everything, pin
from trebucheck.models.elements import (
    GROUND,
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    WeldJoint,
)
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import StopLaw

HULL = body_of("hull", "a", 2.0, (0.1, 0.05), 0.4)
BOB = body_of("bob", "b", 0.7, (0.3, -0.1), 0.05)
BLOCK = body_of("bob", None, 0.7, (0.3, -0.1), 0.05)
SEA = FreeJoint(name="sea", child="hull", coordinates=("x", "y"))
HINGE = pin("hinge", GROUND, "hull")


def afloat(*bodies: Any, joints: tuple[Any, ...] = (), **changes: Any) -> Mechanism:
    """A free hull with other bodies on it; the coordinates.

    Angles, x and y of the hull, other slides.
    """
    n = sum(body.angle is not None for body in bodies) + 3
    n += sum(len(joint.slides) for joint in joints if joint.child in {body.name for body in bodies})
    fields: dict[str, Any] = {
        "name": "afloat",
        "bodies": (HULL, *bodies),
        "joints": (SEA, *joints),
        "gravity": G,
        "start": (0.4, -0.3, 0.2, 0.5, 0.3)[:n],
        "start_speeds": (1.0, -1.5, 0.7, 0.4, -0.8)[:n],
    }
    return Mechanism(**(fields | changes))


def slot(**changes: Any) -> SlotJoint:
    """A slot of the hull for the bob."""
    fields: dict[str, Any] = {
        "parent": "hull",
        "child": "bob",
        "parent_point": (0.3, 0.2),
        "child_point": (0.05, 0.1),
    }
    return SlotJoint(**({"name": "slot", "axis": (0.6, 0.8), "coordinate": "s"} | fields | changes))


def rail(parent: str, angle: float, **changes: Any) -> PrismaticJoint:
    """A rail of a body or the ground for the block."""
    fields: dict[str, Any] = {
        "parent": parent,
        "child": "bob",
        "parent_point": (0.3, 0.2),
        "child_point": (0.05, 0.1),
    }
    return PrismaticJoint(
        **(
            {"name": "rail", "axis": (0.8, -0.6), "angle": angle, "coordinate": "p"}
            | fields
            | changes
        )
    )


def weld(parent: str = "hull", angle: float = 0.9) -> WeldJoint:
    """The block on the hull."""
    return WeldJoint(
        name="weld",
        parent=parent,
        child="bob",
        parent_point=(0.3, 0.2),
        child_point=(0.05, 0.1),
        angle=angle,
    )


def tied(*elements: Any) -> Mechanism:
    """The hull on its hinge, the bob on the hull, and force elements."""
    return Mechanism(
        name="tied",
        bodies=(HULL, BOB),
        joints=(HINGE, pin("pin", "hull", "bob", (0.6, 0.1))),
        force_elements=elements,
        gravity=G,
        start=(0.4, -0.3),
        start_speeds=(1.0, -1.5),
    )


def braced(joint: Any, mechanism: Mechanism) -> Mechanism:
    """The mechanism with another joint between hull and bob, which closes a loop, at consistent
    points and speeds.
    """
    kinematics, q = Kinematics(mechanism), np.array(mechanism.start)
    at = kinematics.position(kinematics.point("bob", (0.5, 0.2)), q)
    joint = joint.model_copy(update={"parent_point": tuple(at.tolist()), "child_point": (0.5, 0.2)})
    closed = Mechanism(
        **(dict(mechanism) | {"joints": (*mechanism.joints, joint), "start_speeds": ()})
    )
    jacobian = Kinematics(closed).loop_jacobian(q)
    free = np.linalg.svd(jacobian)[2][len(jacobian) :]
    speeds = free.T @ (free @ np.array(mechanism.start_speeds))
    return Mechanism(**(dict(closed) | {"start_speeds": tuple(speeds.tolist())}))


ELEMENTS: dict[str, Mechanism] = {
    "everything": everything(),
    "a free body": afloat(gravity_direction=(0.6, -0.8)),
    "a slot of a body": afloat(BOB, joints=(slot(),)),
    "a rail of a body": afloat(BLOCK, joints=(rail("hull", -1.1),)),
    "a rail of the ground": Mechanism(
        name="block",
        bodies=(BLOCK,),
        joints=(rail(GROUND, 2.0),),
        gravity=G,
        start=(0.3,),
        start_speeds=(1.0,),
    ),
    "a weld": afloat(BLOCK, joints=(weld(),)),
    "a spring and damper": tied(
        SpringDamper(
            name="tie",
            body="bob",
            point=(0.4, 0.1),
            relative_to="hull",
            relative_point=(-0.2, 0.3),
            stiffness=60.0,
            damping=2.0,
            rest_length=0.5,
        )
    ),
    "a spring of no length": tied(
        SpringDamper(
            name="tie", body="bob", point=(0.4, 0.1), relative_point=(0.5, -1.0), stiffness=60.0
        )
    ),
    "springs of angles": tied(
        RotationalSpringDamper(
            name="one", body="bob", relative_to="hull", stiffness=20, damping=0.3, rest_angle=-7
        ),
        RotationalSpringDamper(name="two", body="hull", stiffness=9.0, damping=0.2, rest_angle=0.5),
    ),
    "motors and forces": tied(
        ConstantTorque(name="one", body="bob", relative_to="hull", torque=3.0),
        ConstantTorque(name="two", body=GROUND, relative_to="hull", torque=2.0),
        ConstantForce(name="pull", body="bob", point=(0.4, 0.2), force=(-5.0, 7.0)),
        ConstantForce(name="nothing", body=GROUND, point=(0.4, 0.2), force=(-5.0, 7.0)),
    ),
    "a loop of a slot": braced(
        slot(parent=GROUND, coordinate=None, name="guide"),
        afloat(BOB, joints=(pin("pin", "hull", "bob", (0.6, 0.1)),)),
    ),
    "a loop of a rail": braced(
        rail(GROUND, -0.3, coordinate=None),
        afloat(BOB, joints=(pin("pin", "hull", "bob", (0.6, 0.1)),)),
    ),
    "a loop of a weld": braced(weld(GROUND, -0.3), afloat(BOB, joints=(slot(),))),
}


def lever(
    normal: tuple[float, float], closed: bool, motor: float, on: str = "hull", e: float = 0.0
) -> Mechanism:
    """A hull with a motor on its hinge, and a bob on another hinge that stands on the hull, or
    falls onto it.

    The wall is a side of the hull and the point one of the bob, or (on the ground) the other way
    round.
    """
    start, above = (0.4, 2.9), 0.0 if closed else 0.1
    plain = Mechanism(
        name="lever",
        bodies=(HULL, BOB),
        joints=(HINGE, pin("pin", GROUND, "bob", (1.5, 0.8))),
        force_elements=(ConstantTorque(name="motor", body="hull", torque=motor),),
        gravity=G,
        start=start,
    )
    kinematics, q = Kinematics(plain), np.array(start)
    body, point = ("bob", (0.9, 0.3)) if on == "hull" else (GROUND, (0.6, -0.4))
    at = complex(*kinematics.position(kinematics.point(body, point), q)) * np.exp(1j * q[0])
    offset = normal[0] * at.real + normal[1] * at.imag - above
    wall = PointStop(
        name="wall",
        body=body,
        point=point,
        relative_to="hull",
        normal=normal,
        offset=offset,
        closed=closed,
        restitution=e,
    )
    return Mechanism(**(dict(plain) | {"stops": (wall,)}))


UP, TILTED = (0.0, 1.0), (0.6, 0.8)
WALLS = {
    "released by a motor": (lever(UP, True, 0.0), 0.4, StopLaw.RELEASE_ONCE),
    "impact": (lever(TILTED, False, -9.0, e=0.5), 0.5, StopLaw.UNILATERAL),
    "impact that stays": (lever(UP, False, -4.0), 0.35, StopLaw.UNILATERAL),
    "a point of the ground": (
        lever((0.0, -1.0), False, -30.0, on=GROUND, e=0.7),
        0.35,
        StopLaw.UNILATERAL,
    ),
}
