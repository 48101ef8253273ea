"""Models of hinges, slides and ranges, and of where and how bodies hang on them."""

from __future__ import annotations

import math
from typing import Any

from trebucheck.api.mechanics import (
    GROUND,
    FreeJoint,
    Mechanism,
    PointStop,
    SlotJoint,
    Stop,
    WeldJoint,
)

from .model import ZooModel
from .parts import block, body, mechanism, of, pin, rail, rod

_PIVOT = (of("pivot", a=1),)
_RAIL = (of("rail", s=1),)
_ELBOW = (of("shoulder", a=1), of("elbow", b=1, a=-1))


def range_of_angle(low: float, high: float) -> tuple[Stop, Stop]:
    """Ends of a range of the rod's angle [rad]."""
    return (
        Stop(name="low", body="rod", sense=1, limit=low, closed=False),
        Stop(name="high", body="rod", sense=-1, limit=-high, closed=False),
    )


def range_of_slide(low: float, high: float) -> tuple[PointStop, PointStop]:
    """Ends of a range of the block's height [m]."""
    return (
        PointStop(name="low", body="block", point=(0, 0), normal=(0, 1), offset=low, closed=False),
        PointStop(
            name="high", body="block", point=(0, 0), normal=(0, -1), offset=-high, closed=False
        ),
    )


def chain(name: str, *relative: float, speeds: tuple[float, ...] = (), **changes: Any) -> Mechanism:
    """Two links that hang, started with these values of the joints [rad] and speeds [rad/s]."""
    bodies = (body("upper", "a", 1.0, (0, -0.25), 0.02), body("lower", "b", 0.5, (0, -0.2), 0.008))
    joints = (pin("shoulder", GROUND, "upper"), pin("elbow", "upper", "lower", (0, -0.5)))
    started = tuple(sum(speeds[: i + 1]) for i in range(len(speeds)))
    return mechanism(
        name, bodies, joints, (relative[0], sum(relative)), start_speeds=started, **changes
    )


def _offset_centre() -> Mechanism:
    bodies = (
        body("upper", "a", 1.5, (0.2, -0.1), 0.03),
        body("lower", "b", 0.8, (-0.1, -0.25), 0.012),
    )
    joints = (
        pin("shoulder", GROUND, "upper", (0.1, 0.2)),
        pin("elbow", "upper", "lower", (0.5, 0.1)),
    )
    return mechanism("offset-centre", bodies, joints, (0.1, -0.2))


def _nested_frames() -> Mechanism:
    bodies = (
        body("upper", "a", 1.5, (0.2, 0.05), 0.03),
        body("lower", "b", 0.8, (0.3, 0.2), 0.012),
    )
    joints = (
        pin("shoulder", GROUND, "upper", (0.1, 0.3)),
        pin("elbow", "upper", "lower", (0.4, 0)),
    )
    return mechanism("nested-frames", bodies, joints, (0.6, 1.0))


def _frame() -> Mechanism:
    at = (0.1 + 0.2 * math.cos(0.5), 0.3 - 0.2 * math.sin(0.5))
    return rod("frame", start=0.7, joint=pin("pivot", GROUND, "rod", at))


def _fixed_body() -> Mechanism:
    bodies = (body("rod", "a", 2.0, (0.3, 0), 0.06), body("bracket", None, 0.5, (0.1, 0), 0.004))
    weld = WeldJoint(
        name="weld",
        parent="rod",
        child="bracket",
        parent_point=(0.6, 0),
        child_point=(0, 0),
        angle=0.7,
    )
    return mechanism("fixed-body", bodies, (pin("pivot", GROUND, "rod"), weld), (0.2,))


def _slide_on_link() -> Mechanism:
    bodies = (
        body("link", "a", 1.0, (0.1, 0), 0.05),
        body("slider", None, 0.4, (0.05, 0.02), 0.004),
    )
    joints = (
        pin("pivot", GROUND, "link", (0, 1)),
        rail("rail", "slider", (0.8, 0.6), "s", "link", (0.2, 0.05)),
    )
    return mechanism("slide-on-link", bodies, joints, (0.3, 0.1), start_speeds=(2.0, -0.5))


def _turned_slide() -> Mechanism:
    slot = SlotJoint(
        name="slot",
        child="rod",
        parent_point=(0, 0),
        child_point=(0, 0),
        axis=(math.sin(0.5), math.cos(0.5)),
        coordinate="s",
    )
    return rod("turned-slide", joint=slot, start=(0.8, 0.2), start_speeds=(2.0, 1.0))


def _planar_free() -> Mechanism:
    free = FreeJoint(name="free", child="plate", coordinates=("x", "y"))
    return mechanism(
        "planar-free",
        (body("plate", "a", 1.2, (0.1, 0.05), 0.03),),
        (free,),
        (0.4, 0.0, 1.0),
        start_speeds=(-3.0, 1.0, 4.0),
    )


def _two_trees() -> Mechanism:
    bodies = (body("left", "a", 2.0, (0.3, 0), 0.06), body("right", "b", 1.0, (0, -0.4), 0.03))
    joints = (pin("left pivot", GROUND, "left"), pin("right pivot", GROUND, "right", (2, 0)))
    return mechanism("two-trees", bodies, joints, (0.2, -0.8))


def joint_models() -> tuple[ZooModel, ...]:
    """Hinges and slides, ranges, chains and frames."""
    third = math.radians(30)
    inclined = block("inclined-slide", (0.6, -0.8), start=-0.1)
    offset = rod("joint-offset", joint=pin("pivot", GROUND, "rod", (0.1, 0.45), (-0.1, 0.05)))
    on_range = rod("hinge-limit", stops=range_of_angle(-1.0, 0.8))
    on_slide = block("slide-limit", start=0.3, stops=range_of_slide(-0.4, 2.0))
    degrees = rod(
        "degrees",
        start=0.2 + third,
        stops=range_of_angle(third - math.pi / 2, third + math.radians(150)),
    )
    free = (of("x", x=1), of("z", y=1), of("turn", a=1))
    trees = (of("left_pivot", a=1), of("right_pivot", b=1))
    return (
        ZooModel("hinge", "one hinge", rod("hinge"), _PIVOT),
        ZooModel("slide", "one slide", block("slide", start=0.5, start_speeds=(3.0,)), _RAIL),
        ZooModel("inclined-slide", "an axis that is not of length one", inclined, _RAIL),
        ZooModel("negative-axis", "a hinge about -y", rod("negative-axis"), (of("pivot", a=-1),)),
        ZooModel("joint-offset", "a hinge away from its body's origin", offset, _PIVOT),
        ZooModel(
            "joint-ref",
            "ref: a joint value of the drawn position",
            rod("joint-ref"),
            (of("pivot", 0.5, a=1),),
        ),
        ZooModel(
            "hinge-limit", "range of a hinge", on_range, _PIVOT, {"pivot": (-1.0, 0.8)}, ("limits",)
        ),
        ZooModel(
            "slide-limit", "range of a slide", on_slide, _RAIL, {"rail": (-0.4, 2.0)}, ("limits",)
        ),
        ZooModel(
            "degrees",
            "angles in degrees",
            degrees,
            (of("pivot", -third, a=1),),
            {"pivot": (-math.pi / 2, math.radians(150))},
        ),
        ZooModel("chain", "two links, no armature", chain("chain", 0.9, -0.5), _ELBOW),
        ZooModel("offset-centre", "centres of mass off every line", _offset_centre(), _ELBOW),
        ZooModel(
            "nested-frames",
            "turned frames",
            _nested_frames(),
            (of("shoulder", -0.5, a=1), of("elbow", b=1, a=-1)),
        ),
        ZooModel("frame", "a frame element", _frame(), (of("pivot", -0.5, a=1),)),
        ZooModel("fixed-body", "a body without a joint", _fixed_body(), _PIVOT),
        ZooModel(
            "slide-on-link", "a slide in a link that turns", _slide_on_link(), (*_PIVOT, *_RAIL)
        ),
        ZooModel(
            "turned-slide",
            "a slide and a hinge on a turned body",
            _turned_slide(),
            (*_RAIL, of("pivot", -0.5, a=1)),
        ),
        ZooModel("planar-free", "two slides and a hinge on one body", _planar_free(), free),
        ZooModel("two-trees", "two bodies on the ground", _two_trees(), trees),
        ZooModel(
            "start-speeds",
            "a start in motion",
            chain("start-speeds", 0.0, 0.0, speeds=(3.0, -2.0)),
            _ELBOW,
        ),
        ZooModel(
            "keyframe",
            "the second of two keyframes",
            chain("keyframe", 1.2, 0.3, speeds=(-0.5, 1.0)),
            _ELBOW,
        ),
    )
