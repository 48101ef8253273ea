"""Models of equalities and contacts."""

from __future__ import annotations

import math

from trebucheck.api.mechanics import GROUND, FreeJoint, Mechanism, PointStop, SlotJoint, WeldJoint

from .model import ZooModel
from .parts import body, mechanism, of, pin, rail, rod

_PIVOT = (of("pivot", a=1),)


def _connect() -> Mechanism:
    bodies = (
        body("crank", "a", 1.0, (0, -0.5), 0.1),
        body("coupler", "b", 2.0, (1.5, -0.5), 0.5),
        body("rocker", "c", 1.5, (0, -1), 0.4),
    )
    joints = (
        pin("crank pin", GROUND, "crank"),
        pin("elbow", "crank", "coupler", (0, -1)),
        pin("rocker pin", GROUND, "rocker", (3, 0)),
        pin("loop", "coupler", "rocker", (3, -1), (0, -2)),
    )
    return mechanism("connect", bodies, joints, (0.0, 0.0, 0.0), start_speeds=(2.0, 0.0, 1.0))


def _weld() -> Mechanism:
    bodies = (body("rod", "a", 2.0, (0.3, 0), 0.06), body("plate", "b", 0.5, (0.1, 0), 0.004))
    joints = (
        pin("pivot", GROUND, "rod"),
        FreeJoint(name="free", child="plate", coordinates=("x", "y")),
        WeldJoint(
            name="weld", parent="rod", child="plate", parent_point=(0.6, 0.1), child_point=(0, 0)
        ),
    )
    return mechanism("weld", bodies, joints, (0.0, 0.0, 0.6, 0.1))


def _joint_equality() -> Mechanism:
    """Joint equality: the weight falls twice the cart's way, along (-1, -2) seen from the cart."""
    bodies = (body("cart", None, 3.0, (0, 0), 0.01), body("weight", None, 1.0, (0, 0), 0.01))
    size = math.hypot(1, 2)
    line = SlotJoint(
        name="line",
        parent="cart",
        child="weight",
        parent_point=(1, 0),
        child_point=(0, 0),
        axis=(-1 / size, -2 / size),
    )
    joints = (
        rail("track", "cart", (1, 0), "s"),
        rail("shaft", "weight", (0, -1), "h", at=(1, 0)),
        line,
    )
    return mechanism("joint-equality", bodies, joints, (0.0, 0.0))


def constraint_models() -> tuple[ZooModel, ...]:
    """Equalities of points, bodies and joints; contacts that act, and geoms that have none."""
    floor = PointStop(
        name="floor", body="rod", point=(0.6, 0), normal=(0, 1), offset=-0.35, closed=False
    )
    loop = (of("crank", a=1), of("elbow", b=1, a=-1), of("rocker", c=1))
    welded = (of("pivot", a=1), of("x", -0.6, x=1), of("z", -0.1, y=1), of("turn", b=1))
    coupled = (of("cart", s=1), of("weight", h=1))
    return (
        ZooModel("connect", "a loop by connect", _connect(), loop, needs=("loops",)),
        ZooModel("weld", "a weld of two trees", _weld(), welded, needs=("loops",)),
        ZooModel(
            "joint-equality", "two coupled joints", _joint_equality(), coupled, needs=("loops",)
        ),
        ZooModel("no-contact", "geoms without contact", rod("no-contact"), _PIVOT),
        ZooModel(
            "contact",
            "a ball on the ground",
            rod("contact", stops=(floor,)),
            _PIVOT,
            needs=("contact",),
        ),
    )
